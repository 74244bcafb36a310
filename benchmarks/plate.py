"""The plate: displacement under a moving finger beside a low-pass and an integrator,
and how long a plate's modes take.

python benchmarks/plate.py             print
python benchmarks/plate.py --record    and keep the figures in results/plate.csv
"""

from __future__ import annotations

import numpy as np
from bench import Row, compared, main, row, under
from timing import interleaved, medians

import stimlib
from stimlib import Input, Scene, blocks as b
from stimlib.plate import Finger, Plate, plate

FS, N = 8000, 1 << 15
T = np.arange(N) / FS
GIVEN = {
    "x": 0.103 + 0.05 * np.sin(2 * T),
    "y": 0.07 + 0.01 * np.sin(T),
    "v": 50 * np.sin(2 * np.pi * 158 * T),
}
X, Y, V = Input("x", "m"), Input("y", "m"), Input("v", "V")


def puller(block):
    """A job that renders a block at once."""
    proc = stimlib.compile(Scene({"y": block}), FS)
    rows = np.array([GIVEN[name] for name in proc.inputs])
    out = np.empty((1, N))
    return lambda: proc.process(rows, out)


def finger() -> list[Row]:
    """A stroke of 0.1 m/s at most; the low-pass says how fast the machine is."""
    glass = Plate.paper(measured=True)
    jobs = {"low-pass of order 2": puller(b.lowpass(V, 300))}
    jobs |= {
        f"plate, {k} mode{'s' * (k > 1)}": puller(plate(X, Y, V, glass, modes=k)) for k in (1, 3)
    }
    jobs["plate, 3 modes, loaded by the finger"] = puller(
        plate(X, Y, V, glass, finger=Finger(1e-4, 1.0, 500.0))
    )
    return under("under the finger", compared(jobs, N, "low-pass of order 2", 15))


def modes() -> list[Row]:
    """Six modes of a bare plate, and of one with four patches, from its sizes on."""
    jobs = {
        "six modes": lambda: Plate.paper().modes(6),
        "six modes, with patches": lambda: Plate.paper(patches=True).modes(6),
    }
    return [
        row(name, seconds * 1e3, "ms") for name, seconds in medians(interleaved(jobs, 9)).items()
    ]


def measure() -> list[Row]:
    """All rows."""
    return finger() + modes()


if __name__ == "__main__":
    main("plate", __doc__, measure)
