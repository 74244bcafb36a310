"""Designs that take long, kept on the disk for other processes.

A file is named by the text of this folder, the versions, the machine and the arguments.
It holds numbers only, so reading it runs no code; if it is not what was written, the
design is made again.
"""

from __future__ import annotations

import hashlib
import io
import platform
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np

from ..system import safe_files
from ..system.cache_folder import chosen, open_to_others, private
from ..system.linear_algebra import one_thread

T = TypeVar("T")
SLOW = 0.05  # s of processor time; a design that takes less is not kept


def kept(design: Callable[..., T]) -> Callable[..., T]:
    """Keep the results of a function of numbers: NamedTuples of arrays and floats.

    The function must not depend on anything else. Arrays are read-only.

    Examples
    --------
    >>> from typing import NamedTuple
    >>> from stimlib.design.kept import kept
    >>> Line = NamedTuple("Line", [("slope", float)])
    >>> @kept
    ... def line(rise: float, run: float) -> Line:
    ...     return Line(rise / run)
    >>> line(1.0, 2.0)
    Line(slope=0.5)
    """

    @wraps(design)
    def made(*args: Any, **named: Any) -> T:
        key = repr((_salt(), design.__module__, args, sorted(named.items())))
        sum_ = hashlib.sha256(key.encode()).hexdigest()
        path = chosen() / f"{design.__name__}_{sum_[:32]}.npz"
        with suppress(Exception):  # whatever a file may hold
            return _read(path, get_type_hints(design)["return"])
        began = time.thread_time()
        with one_thread():
            found = design(*args, **named)
        if time.thread_time() - began > SLOW:
            with suppress(OSError):  # a full disk, or no folder of ours
                private(path.parent)
                _write(path, found)
        return found

    return made


@cache
def _salt() -> str:
    texts = [p.read_text("utf-8") for p in sorted(Path(__file__).parent.glob("*.py"))]
    of = texts, np.__version__, platform.machine(), platform.node()
    return hashlib.sha256(repr(of).encode()).hexdigest()


def _read(path: Path, kind: Any) -> Any:
    if open_to_others(path.parent.stat()) or open_to_others(path.lstat()):
        raise PermissionError
    data = safe_files.read(path, "sidecar_bytes")
    if hashlib.sha256(data[32:]).digest() != data[:32]:
        raise ValueError
    with np.load(io.BytesIO(data[32:]), allow_pickle=False) as stored:
        values = [stored[name] for name in kind._fields]
    for v in values:
        v.setflags(write=False)
    return kind(*(v if v.ndim else float(v) for v in values))


def _write(path: Path, found: Any) -> None:
    data = io.BytesIO()
    np.savez(data, **found._asdict())
    safe_files.publish(path, hashlib.sha256(data.getbuffer()).digest() + data.getvalue())
    path.chmod(0o600)
