"""Compiled code as functions of Python, without numba's dispatcher.

The dispatcher takes longer than a squeeze takes for a sample.

The code looks at its arguments itself (``runtime.process``), where numpy's binary
interface has the words of an array.  That numpy and Python are laid out so is held
against an array before anything is called.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ...errors import StimlibError
from .intrinsics import ALIGNED, C_ORDER, NUMBERS, WRITEABLE

METH_FASTCALL = 0x80


class _Method(ctypes.Structure):
    """PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("code", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_new = ctypes.PYFUNCTYPE(
    ctypes.py_object, ctypes.POINTER(_Method), ctypes.py_object, ctypes.c_void_p
)(("PyCFunction_NewEx", ctypes.pythonapi))


@cache
def _method(address: int) -> Any:
    """Return a method definition, which must outlive its functions."""
    return _Method(b"process", address, METH_FASTCALL, None)


def function(address: int, me: int) -> Callable[..., int]:
    """Return a builtin function for machine code at an address.

    It gets a number beside its arguments.
    """
    return _new(ctypes.byref(_method(address)), me, None)


def _word(address: int, k: int) -> int:
    return ctypes.c_int64.from_address(address + 8 * k).value


@cache
def array_words() -> tuple[int, int]:
    """Return what identifies an array of float64: its type, and that of its numbers.

    Raises
    ------
    StimlibError
        Arrays do not lie in memory as the compiled code expects it.
    """
    a = np.zeros((3, 5))
    letters = int.from_bytes(f"{a.dtype.kind}{a.dtype.char}{a.dtype.byteorder}".encode(), "little")
    flags = C_ORDER | ALIGNED | WRITEABLE
    seen = (
        [_word(id(a), k) for k in (1, 2, 3, 7)]
        + [_word(_word(id(a), 4), k) for k in (0, 1)]
        + [_word(id(a.dtype), 3)]
    )
    seen[2], seen[-1] = seen[2] & 0xFFFFFFFF, seen[-1] & NUMBERS
    wanted = [
        id(np.ndarray),
        a.ctypes.data,
        a.ndim,
        id(a.dtype),
        *a.shape,
        a.dtype.num << 32 | letters,
    ]
    if seen != wanted or _word(id(a), 8) & flags != flags:
        raise StimlibError(
            f"numpy {np.__version__} lays out its arrays in a way that stimlib does not know:"
            " install numpy 2.4"
        )
    return id(np.ndarray), seen[-1]
