"""End the workers of a pool when the process that started them has ended in any way.

A pool runs this file as a program.  It imports nothing but the standard library, so it
starts within milliseconds.  Each worker leads a session, which it cannot leave.  So a
signal to the worker's process group also reaches the processes that the worker has
started, except those that have moved into a session of their own.  SIGKILL also ends a
process that is stopped, ignores SIGTERM or is busy in C.  All of this is POSIX; see
`stimlib.system.pool` for Windows.
"""

import os
import select
import signal
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

killpg: Any = getattr(os, "killpg", None)  # Windows has no process groups
POSSIBLE = killpg is not None
SIGHUP, SIGCONT, SIGKILL = (
    getattr(signal, name, signal.SIGTERM) for name in ("SIGHUP", "SIGCONT", "SIGKILL")
)
PATIENCE = 2.0  # s from SIGTERM to SIGKILL, for a worker to take back what it writes
TICK = 0.2  # s between two looks at what has no file descriptor to wait for


def tell(groups: Iterable[int], *signals: int) -> None:
    """Send signals to workers and the processes that they have started.

    Parameters
    ----------
    groups : iterable of int
        Process groups, each with the process ID of its worker.
    *signals : int
        Sent one after another.
    """
    for group in groups:
        # macOS answers PermissionError where only zombies are left
        with suppress(ProcessLookupError, PermissionError):
            for number in signals:
                killpg(group, number)


def watch(driver: int) -> None:
    """Wait for the end of a process, then end its workers.

    Parameters
    ----------
    driver : int
        Process ID of the parent.  It writes the process ID of each worker to stdin, as
        eight bytes: once when the worker has started, and again when it has ended.  A
        fork of the parent may keep stdin open, so the parent's process ID is watched
        too.
    """
    for number in (SIGHUP, signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    while os.getppid() == driver:
        if select.select([0], [], [], TICK)[0]:
            if not (report := os.read(0, 8)):
                break
            groups ^= {int.from_bytes(report)}
    tell(groups, signal.SIGTERM, SIGCONT)
    time.sleep(PATIENCE)
    tell(groups, SIGKILL)


if __name__ == "__main__":
    watch(int(sys.argv[1]))
