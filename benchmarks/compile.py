"""How long a scene takes to be ready: cold, from the cache, and large.

Each figure is the median of fresh processes (or of rounds, where it says so).  Run: python benchmarks/compile.py
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile

from bench import machine, save

CODE = """
import tempfile
import time
import stimlib
from stimlib import Input, Param, Scene, constant, enabled
from stimlib.blocks import *
x, k = Input("x"), Param("k", 1.0)
def every_class():
    y = x + k - 2.0 * x / (1.0 + abs(-x))
    y = y + where(x > 0.5, exp(-abs(x)), log(1.0 + x * x)) + where(x >= 0.1, sin(x), cos(x)) + tanh(x) + sqrt(abs(x))
    y = y + maximum(x, 0.1) + minimum(x, k) + nonzero(x) + lut(x, [0, 1, 2], [0, 1, 0]) + delay(x, samples=3)
    y = y + first_order(x, 0.1) + fir(x, [1.0, 2.0]) + pinking(x) + velocity(x) / constant(1.0, "1/s")
    n = enabled(differentiator(pink_noise(1.0, seed=1, f_low=10), passband=1000), by=loading(velocity(x)))
    arm = generalized_maxwell(x * constant(1.0, "m"), 1.0, [(1.0, 0.1)])
    m = springpot(x, 1.0, 0.5) + springpot(x, k, 0.5 * k, "l1") + arm \\
        / constant(1.0, "N") + track(x) + bump(x, "sine", 0.5) * bump(x, "square", 0.5) * bump(x, [0, 1], 0.5) * carrier(158.0)
    m = m + lut(x, [0, 1, 2, 3], [0, 1, 0, 2], kind="polynomial") + track_velocity(x) / constant(1.0, "1/s")
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


def fresh(line: str, cache: str, rounds: int) -> float:
    """Median seconds of a statement in fresh processes, after the imports above and numba's own."""
    times = []
    for _ in range(rounds):
        code = CODE + f"start = time.perf_counter()\n{line}\nprint(time.perf_counter() - start)"
        env = os.environ | {"STIMLIB_CACHE": cache}
        done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        times.append(float(done.stdout.split()[-1]))
    return statistics.median(times)


def main():
    rows: list[dict[str, object]] = [{"what": machine(), "seconds": ""}]
    with tempfile.TemporaryDirectory() as cache:
        line = "stimlib.compile(every_class(), 8000)"
        rows.append({"what": "these classes cold, empty cache", "seconds": fresh(line, cache, 1)})
        line = "stimlib.compile(trivial, 8000)"
        rows.append({"what": "first compile of a process (starts numba)", "seconds": fresh(line, cache, 5)})
        line = "stimlib.compile(trivial, 8000); s = squeeze(); start = time.perf_counter(); stimlib.compile(s, 8000)"
        rows.append({"what": "squeeze from the cache, numba started", "seconds": fresh(line, cache, 5)})
        line = "s = squeeze(); stimlib.compile(s, 8000); start = time.perf_counter(); stimlib.compile(squeeze(), 8000)"
        rows.append({"what": "squeeze again in the same process", "seconds": fresh(line, cache, 5)})
        line = "s = chain(); s.save(tempfile.mkdtemp() + '/s.json'); stimlib.compile(s, 8000)"
        rows.append({"what": "10 000 mixed blocks: build, save, compile", "seconds": fresh(line, cache, 3)})
    save("compile", rows)


if __name__ == "__main__":
    main()
