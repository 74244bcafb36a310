"""Start a worker, and end it when the process that wanted it has ended in any way.

A pool runs this file as a program, one for each worker.  It imports nothing but the
standard library, so it starts within milliseconds.  The worker leads a session, which
it cannot leave.  So a signal to its process group also reaches the processes that it
has started, except those that have moved into a session of their own.  SIGKILL also
ends a process that is stopped, ignores SIGTERM or is busy in C.  All of this is POSIX;
see `stimlib.system.pool` for Windows.
"""

import math
import os
import select
import signal
import sys
import time
from contextlib import suppress
from typing import Any

system: Any = os  # of which Windows has a part: no process groups
numbers: Any = signal
POSSIBLE = hasattr(os, "killpg")
PATIENCE = 2.0  # s from SIGTERM to SIGKILL, for a worker to take back what it writes
TICK = 0.2  # s between two looks at what has no file descriptor to wait for


def watch(driver: int, command: list[str]) -> int:
    """Run a worker until it ends, or until its driver has ended or sends SIGTERM.

    Parameters
    ----------
    driver : int
        Process ID of the parent.
    command : list of str
        The worker, which has stdin and stdout of this process.

    Returns
    -------
    int
        Exit status of the worker, negative for a signal.
    """
    wake, write = os.pipe()
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write)
    for number in (numbers.SIGHUP, numbers.SIGINT, numbers.SIGTERM, numbers.SIGCHLD):
        signal.signal(number, lambda *_: None)  # it is read below; a worker has the default
    worker = system.fork()
    if not worker:
        system.setsid()
        os.execv(command[0], command)
    until = math.inf
    while not (ended := system.waitpid(worker, system.WNOHANG))[0]:
        told = select.select([wake], [], [], TICK)[0] and os.read(wake, 1)[0] == numbers.SIGTERM
        if time.monotonic() > until:
            _tell(worker, numbers.SIGKILL)
        elif until == math.inf and (told or os.getppid() != driver):
            _tell(worker, numbers.SIGTERM, numbers.SIGCONT)
            until = time.monotonic() + PATIENCE
    _tell(worker, numbers.SIGKILL)  # what it has started
    return system.waitstatus_to_exitcode(ended[1])


def _tell(group: int, *signals: int) -> None:
    """Send signals to a worker and the processes that it has started."""
    # macOS answers PermissionError where only zombies are left
    with suppress(ProcessLookupError, PermissionError):
        for number in signals:
            system.killpg(group, number)


if __name__ == "__main__":
    status = watch(int(sys.argv[1]), sys.argv[2:])
    os._exit(status if status >= 0 else 128 - status)
