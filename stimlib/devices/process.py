"""What the sinks of a process share: signals, locked memory and a final fade-out."""

from __future__ import annotations

import atexit
import ctypes
import gc
import os
import signal
import threading
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

from ..errors import SinkError, StimlibError
from ..system.pool import terminable

# Real time ----------------------------------------------------------------------------
MCL_CURRENT, MCL_ONFAULT = 1, 4


def libc() -> Any:
    """Return the C library of this process, or None on Windows."""
    try:
        return ctypes.CDLL(None)
    except TypeError:
        return None


def keep_loaded(library: str) -> None:
    """Keep a library in memory until the process ends.

    The threads of a library may still run when its device hangs.
    """
    ctypes.CDLL(library, mode=getattr(os, "RTLD_NOW", 0) | getattr(os, "RTLD_NODELETE", 0))


def begin(thread: threading.Thread) -> threading.Thread:
    """Start a thread; raise SinkError if the system allows no more threads."""
    try:
        thread.start()
    except RuntimeError as e:
        raise SinkError(
            f"{thread.name}: {e}: end other programs, or allow this one more (ulimit -u, ulimit -v)"
        ) from None
    return thread


def account(e: BaseException) -> str:
    """Return kind, text and location of an error that a user's function raised.

    Each of the three may be missing, because reading them runs the user's code, which
    may fail as well.
    """
    kind, text, place = "an error", "its text cannot be made", "its place cannot be found"
    with suppress(BaseException):
        text = str(e)[:500]
    if isinstance(e, StimlibError):
        return text
    with suppress(BaseException):
        kind = type(e).__name__
    with suppress(BaseException):
        *_, (frame, line) = traceback.walk_tb(e.__traceback__)
        place = f"{frame.f_code.co_filename}:{line}"
    return f"{kind}: {text} ({place})"


def fifo(priority: int = 60) -> bool:
    """Give the calling thread real-time priority (SCHED_FIFO), if permitted."""
    system: Any = os
    try:
        system.sched_setscheduler(0, system.SCHED_FIFO, system.sched_param(priority))
    except (OSError, AttributeError):  # Windows and macOS have none
        return False
    return True


# The process, which several sinks may share -------------------------------------------
ENDS = tuple(getattr(signal, n) for n in ("SIGTERM", "SIGHUP") if hasattr(signal, n))
"""Signals that end a program at once unless they are handled: `kill`, and a closed
terminal.
"""

abandoned: list[Any] = []  # memory that a device which never let go may still use
open_sinks: set[Any] = set()  # a device may call as long as its sink is open, so they are kept
playing: set[Any] = set()  # from start to close
# for whoever begins or ends to play: signals and memory are the process's
_process = threading.RLock()
_ends = ExitStack()  # while somebody plays, termination signals are exceptions


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def begin_playing(sink: Any) -> list[str]:
    """Make termination signals end the program like an exception.

    The ``with`` statement and atexit can then fade out. The garbage collector is kept
    away from existing objects. Return, in words, what real time needs but is not
    permitted here.
    """
    with _process:
        playing.add(sink)
        _ends.enter_context(terminable())
        if sink.realtime:
            gc.collect()
            gc.freeze()
            library = libc()
            if not hasattr(library, "mlockall") or library.mlockall(MCL_CURRENT | MCL_ONFAULT):
                return ["locking memory (ulimit -l)"]
    return []


def end_playing(sink: Any) -> None:
    """Restore the process settings that the first sink changed, after the last sink."""
    with _process:
        if sink not in playing:
            return
        playing.discard(sink)
        if not playing and _in_main_thread():
            _ends.close()
        if sink.realtime and not any(other.realtime for other in playing):
            gc.unfreeze()
            if hasattr(library := libc(), "munlockall"):
                library.munlockall()


@contextmanager
def signals_wait() -> Iterator[None]:
    """Defer Ctrl-C and other termination signals until the body has finished.

    A signal in the middle of a fade would turn the fade into a click.
    """
    if not _in_main_thread():
        yield
        return
    came: list[int] = []
    handlers = {s: signal.getsignal(s) for s in (signal.SIGINT, *ENDS)}
    kept = {s: h for s, h in handlers.items() if h not in (None, signal.SIG_IGN)}
    for s in kept:
        signal.signal(s, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for s, handler in kept.items():
            signal.signal(s, handler)
        for s in dict.fromkeys(came):
            signal.raise_signal(s)


@atexit.register
def close_all() -> None:
    """Close all open sinks."""
    with signals_wait():
        for sink in list(open_sinks):
            with suppress(Exception):  # the others are to fade too
                sink.close()
