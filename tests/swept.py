"""Scenes and measures that the workers of sweeps import: each loads this file, and not
the tests with all that they use.
"""

import os
import signal
import sys
import time

from stimlib import Input, Scene
from stimlib.motion.generators import minimum_jerk
from stimlib.scenes import squeeze
from stimlib.sweep import grid, measure

HANDS = {"slow": minimum_jerk(depth=0.02), "fast": minimum_jerk(depth=0.02, rise=0.1)}
SCENE = squeeze(fingers=1)
ROWS = grid(motion=HANDS, A=[0.5, 3.4], k=[500.0, 7.0], seed=range(4))
WORDS = {"motion": HANDS, "fs": 8000, "seconds": 0.05, "progress": False}
HELD = {"A": 3.4, "k": 500.0}  # of the fast hand: none of the rows that are tried first


@measure("N", version="1")
def last(r):
    """While the file STIMLIB_HELD is there, the rows of HELD wait."""
    held = r.params.items() >= HELD.items() and r.motion["x1"] == HANDS["fast"]
    while held and os.path.exists(os.environ.get("STIMLIB_HELD", "")):
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


@measure("N")
def hangs(r):
    time.sleep(600)


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
        case "large":
            bytearray(4 * 10**9)
    return Scene({"y": 1.0 * Input("x")})
