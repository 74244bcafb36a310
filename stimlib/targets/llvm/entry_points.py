"""Python entry points to compiled code, without a dispatcher.

A call by ctypes takes longer than a squeeze takes for a sample.

The code looks at its arguments itself (``runtime.process``), where numpy's binary
interface has the words of an array.  That numpy and Python are laid out so is compared
with an array before anything is called; where they are not, ``checked`` looks at the
arguments in Python, which takes some 5 us more.
"""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from .rows import ALIGNED, C_ORDER, DTYPE_BITS, WRITEABLE

METH_FASTCALL = 0x80
logger = logging.getLogger(__name__)


class _Method(ctypes.Structure):
    """The C structure PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("code", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


# PYFUNCTYPE keeps Python's lock, which is faster kept than given away
ENTRY = ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64)


@cache
def _method(address: int) -> Any:
    """Return a method definition, which must outlive its functions."""
    # one for each address, for ever: Python keeps a pointer to it in each function
    return _Method(b"process", address, METH_FASTCALL, None)


def function(address: int, context: int) -> Callable[..., int]:
    """Return a builtin function for machine code at an address.

    It receives a number in addition to its arguments.
    """
    # PyCFunction_NewEx(method, self, module): self is the context's address, a Python
    # int, which the code gets as its first argument
    make = ctypes.PYFUNCTYPE(
        ctypes.py_object, ctypes.POINTER(_Method), ctypes.py_object, ctypes.c_void_p
    )(("PyCFunction_NewEx", ctypes.pythonapi))
    return make(ctypes.byref(_method(address)), context, None)


def fit(arrays: tuple[Any, ...], rows: tuple[int, int]) -> bool:
    """Return whether (x, out) are what ``runtime.process`` takes, for so many rows."""
    if len(arrays) != 2 or any(type(array) is not np.ndarray for array in arrays):
        return False
    motion, out = arrays
    samples = out.shape[-1] if out.ndim == 2 else -1
    shapes = motion.shape == (rows[0], samples) and out.shape == (rows[1], samples)
    # carray: contiguous, aligned and writeable
    laid = motion.flags.c_contiguous and motion.flags.aligned and out.flags.carray
    if not (shapes and laid and motion.dtype == out.dtype == float):
        return False
    apart = out.ctypes.data - motion.ctypes.data
    # rows that overlap by whole rows are read before they are written; of others, a
    # sample would be written before it is read
    return not (motion.size and -out.nbytes < apart < motion.nbytes and apart % (8 * samples))


def checked(address: int, context: int, rows: tuple[int, int]) -> Callable[..., int]:
    """Return a Python version of ``function``: 0, or 1 if the arrays do not fit."""
    entry = ENTRY(address)

    def process(*arrays: Any) -> int:
        if not fit(arrays, rows):
            return 1
        motion, out = arrays
        entry(context, motion.ctypes.data, out.ctypes.data, out.shape[1])
        return 0

    return process


def _word(address: int, index: int) -> int:
    return ctypes.c_int64.from_address(address + 8 * index).value


@cache
def array_words() -> tuple[int, int] | None:
    """Return two words that identify an array of float64: its type, and its dtype.

    None if arrays are not laid out in memory as the compiled code expects.
    """
    array = np.zeros((3, 5))
    # kind, letter and order of bytes lie side by side in a dtype, as in this text
    dtype = array.dtype
    letters = int.from_bytes(f"{dtype.kind}{dtype.char}{dtype.byteorder}".encode(), "little")
    flags = C_ORDER | ALIGNED | WRITEABLE
    # type, data, axes and dtype of the array; its shape; the letters of its dtype
    seen = (
        [_word(id(array), index) for index in (1, 2, 3, 7)]
        + [_word(_word(id(array), 4), index) for index in (0, 1)]
        + [_word(id(dtype), 3)]
    )
    # an int fills half of a word, and what else is there is not ours
    seen[2], seen[-1] = seen[2] & 0xFFFFFFFF, seen[-1] & DTYPE_BITS
    wanted = [
        id(np.ndarray),
        array.ctypes.data,
        array.ndim,
        id(dtype),
        *array.shape,
        dtype.num << 32 | letters,
    ]
    if seen != wanted or _word(id(array), 8) & flags != flags:
        logger.info("numpy %s lays out its arrays in an unknown way: slower calls", np.__version__)
        return None
    return id(np.ndarray), seen[-1]
