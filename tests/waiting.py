"""Waiting for what comes, however busy the machine is."""

import shutil
import time

# before a command: it ends with the program that starts it, even one that is killed
ENDS_TOO = ["setpriv", "--pdeathsig", "KILL"] if shutil.which("setpriv") else []


def until(there, what="", seconds=300.0, every=0.005):
    """Return the first true value of ``there()``, which is asked every 5 ms.  The limit
    only ends a hang; ``what`` may tell what there is instead.
    """
    end = time.monotonic() + seconds
    while not (found := there()):
        assert time.monotonic() < end, what() if callable(what) else what
        time.sleep(every)
    return found
