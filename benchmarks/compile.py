"""How long it takes to begin: the command, a scene cold and from the cache, and a large
one.

    python benchmarks/compile.py             print
    python benchmarks/compile.py --record    and keep the figures in results/compile.csv

Each figure is the median of fresh processes that take turns; only the empty cache is
filled once.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from functools import partial

from bench import Row, main, row
from timing import interleaved, medians

from stimlib.scenes import SHIPPED

CODE = """
import tempfile
import time
import stimlib
from stimlib import Input, Param, Scene, constant, enabled
from stimlib.blocks import *
x, k = Input("x"), Param("k", 1.0)
def every_class():
    y = x + k - 2.0 * x / (1.0 + abs(-x))
    y = y + where(x > 0.5, exp(-abs(x)), log(1.0 + x * x)) + where(x >= 0.1, sin(x), cos(x))
    y = y + tanh(x) + sqrt(abs(x))
    y = y + maximum(x, 0.1) + minimum(x, k) + nonzero(x)
    y = y + lut(x, [0, 1, 2], [0, 1, 0]) + delay(x, samples=3)
    y = y + first_order(x, 0.1) + fir(x, [1.0, 2.0]) + pinking(x)
    y = y + velocity(x) / constant(1.0, "1/s")
    n = differentiator(pink_noise(1.0, seed=1, f_low=10), passband=1000)
    n = enabled(n, by=loading(velocity(x)))
    arm = generalized_maxwell(x * constant(1.0, "m"), 1.0, [(1.0, 0.1)])
    bumps = bump(x, "sine", 0.5) * bump(x, "square", 0.5) * bump(x, [0, 1], 0.5)
    m = springpot(x, 1.0, 0.5, "gl") + springpot(x, k, 0.5 * k, "l1") + arm / constant(1.0, "N")
    m = m + track(x) + bumps * carrier(158.0)
    m = m + lut(x, [0, 1, 2, 3], [0, 1, 0, 2], kind="polynomial")
    m = m + track_velocity(x) / constant(1.0, "1/s")
    return Scene({"y": y, "n": n, "m": m})
def squeeze():
    return stimlib.scenes.squeeze()
def chain(n=10000):
    y = x
    for i in range(n // 8):
        y = minimum(maximum(first_order(y + k, 0.1 + 1e-6 * i) * 0.5, -5.0), tanh(where(y, y, x)))
    return Scene({"y": y})
trivial = Scene({"y": x})
"""


LINES = {
    "first compile of a process (starts LLVM)": "stimlib.compile(trivial, 8000)",
    "squeeze from the cache, LLVM started": (
        "stimlib.compile(trivial, 8000); s = squeeze(); start = time.perf_counter(); "
        "stimlib.compile(s, 8000)"
    ),
    "squeeze again in the same process": (
        "s = squeeze(); stimlib.compile(s, 8000); start = time.perf_counter(); "
        "stimlib.compile(squeeze(), 8000)"
    ),
    "10 000 mixed blocks: build, save, compile": (
        "s = chain(); s.save(tempfile.mkdtemp() + '/s.json'); stimlib.compile(s, 8000)"
    ),
}
COMMANDS = {
    "python, doing nothing": ["-c", ""],
    "import stimlib": ["-c", "import stimlib"],
    "stimlib --version": ["-m", "stimlib", "--version"],
    "stimlib list": ["-m", "stimlib", "list"],
}
QUICK = "--help", "list", "show squeeze", "devices", "play tone --sink null --seconds 0.05"
"""Commands whose CPU time counts, beside a short render of each shipped scene."""
RENDER = "-m stimlib render squeeze --motion minimum_jerk() --seconds 1 --quiet".split()
RENDER += ["--full-scale", "50", "--out"]


def process(words: list[str], cache: str) -> str:
    """What a process of Python prints."""
    done = subprocess.run(
        [sys.executable, *words],
        env=os.environ | {"STIMLIB_CACHE": cache},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def children() -> float:
    """CPU seconds of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def short_of(scene: str, file: str) -> list[str]:
    """The words that render a tenth of a second of a shipped scene at rest."""
    made = SHIPPED[scene]()
    still = [word for n in made.inputs for word in ("--motion", f"{n}=sinusoid(0, 1)")]
    units = {str(b.dim) for b in made.outputs.values()}
    full = ",".join(f"{n}=50" for n in made.outputs) if units != {"1"} else "1"
    return ["-m", "stimlib", "render", scene, *still, *f"--seconds 0.1 --full-scale {full}".split(),
            "--quiet", "--out", file]  # fmt: skip


def fresh(line: str, cache: str) -> float:
    """Seconds of a statement in a fresh process, after the imports above."""
    code = CODE + f"start = time.perf_counter()\n{line}\nprint(time.perf_counter() - start)"
    return float(process(["-c", code], cache).split()[-1])


def measure(rounds: int = 5) -> list[Row]:
    """All rows."""
    with tempfile.TemporaryDirectory() as folder:
        cache = f"{folder}/cache"
        commands = COMMANDS | {"stimlib render, 1 s of squeeze": [*RENDER, f"{folder}/a.wav"]}
        rows = [
            row(
                "the classes above cold, empty cache",
                fresh("stimlib.compile(every_class(), 8000)", cache),
                "s",
            )
        ]
        inside: dict[str, list[float]] = {name: [] for name in LINES}
        for _ in range(rounds):
            for name, line in LINES.items():
                inside[name].append(fresh(line, cache))
        whole = interleaved(
            {name: partial(process, words, cache) for name, words in commands.items()}, rounds, 1
        )
        jobs = {f"stimlib {words}": ["-m", "stimlib", *words.split()] for words in QUICK}
        jobs["stimlib verify, 1 s of squeeze"] = ["-m", "stimlib", "verify", f"{folder}/a.wav"]
        jobs |= {f"stimlib render {n}": short_of(n, f"{folder}/{n}.wav") for n in SHIPPED}
        spent = interleaved(
            {f"{name}: CPU": partial(process, words, cache) for name, words in jobs.items()},
            rounds,
            1,
            children,
        )
    took = medians(inside | whole | spent)
    return rows + [row(name, seconds, "s") for name, seconds in took.items()]


if __name__ == "__main__":
    main("compile", __doc__, measure)
