"""Scenes and measures that the workers of sweeps import: each loads this file, and not
the tests with all that they use.
"""

import os
import signal
import sys
import time

from stimlib import Input, Scene
from stimlib.motion.generators import minimum_jerk
from stimlib.sweep import measure

HANDS = {"slow": minimum_jerk(depth=0.02), "fast": minimum_jerk(depth=0.02, rise=0.1)}


@measure("N")
def deadly(r):
    if r.params["k"] == 7.0:
        os._exit(3)
    return r["force"][-1]


@measure("N")
def last(r):
    """Slow enough to be killed in the middle; and k = 7 ends its process."""
    time.sleep(0.01)
    return r["force1"][-1]


@measure("N")
def deadly_in_the_middle(r):
    if (
        r.params["k"] == 7.0
        and r.params["A"] == 3.4
        and r.seed == 2
        and r.motion["x1"] == HANDS["fast"]
    ):
        os.kill(os.getpid(), signal.SIGKILL)
    return r["force1"][-1]


class Unspeakable(Exception):
    def __str__(self):
        raise RuntimeError("no text")


def poisoned(kind="none"):
    """Do harm while the scene is made."""
    match kind:
        case "exit":
            os._exit(3)
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "leave":
            sys.exit(4)
        case "interrupt":
            raise KeyboardInterrupt
        case "generator":
            raise GeneratorExit
        case "unspeakable":
            raise Unspeakable
        case "hang":
            time.sleep(600)
        case "large":
            bytearray(10**12)
    return Scene({"y": 1.0 * Input("x")})
