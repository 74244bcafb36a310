"""The bumps scene: against the same formulas in numpy, area against point sampling, and
what silence costs.

python benchmarks/bumps.py             print
python benchmarks/bumps.py --record    and keep the figures in results/bumps.csv
"""

from __future__ import annotations

from math import pi

import numpy as np
from bench import TIMES, Row, compared, main, row, under
from timing import interleaved, medians, ratio

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import bump
from stimlib.scenes.bumps import bumps

FS, N, BLOCK, CHUNK = 8000, 1 << 18, 8192, 16384  # numpy is fastest in chunks of 16384
NB, DUTY, A, FREQ = 18, 0.5, 4.0, 158.0


def stroke(speed, n=N):
    """Position of a finger that goes to and fro over 0.1 m at constant speed (m/s)."""
    t = np.arange(n) * (speed / FS) % 0.2
    return np.minimum(t, 0.2 - t)


def puller(scene, x, contact=1.0):
    """A job that streams a scene in blocks."""
    proc = stimlib.compile(scene, FS)
    touching = np.full(x.size, contact)
    blocks = [
        np.array([{"contact": touching}.get(n, x)[a : a + BLOCK] for n in proc.inputs])
        for a in range(0, x.size, BLOCK)
    ]
    out = np.empty((len(proc.outputs), BLOCK))

    def run():
        proc.reset()
        for b in blocks:
            proc.process(b, out)

    return run


class Vectorised:
    """gain A e c in numpy: the scene's formulas on whole arrays, state carried from
    chunk to chunk.
    """

    def __init__(self, waveform):
        self.waveform, self.last = waveform, None
        self.phase, self.step = np.uint64(0), np.uint64(round(FREQ / FS * 2**64))

    def mean(self, a, b):
        if self.waveform == "square":
            return np.ones_like(a), 1.0
        if self.waveform == "sawtooth":
            return 0.5 * (a + b), 0.5
        h = 1 / np.sin(pi * DUTY / 2) ** 2
        e = 1 - h * np.sin(pi * DUTY * (0.5 * (a + b) - 0.5)) ** 2
        return e - (1 - np.sinc(DUTY * (b - a))) * (e + h / 2 - 1), 1 - h / 2 * (1 - np.sinc(DUTY))

    def __call__(self, x):
        u = x * (NB / 0.1)
        u = np.concatenate([u[:1] if self.last is None else self.last, u])
        self.last = u[-1:]
        k = np.floor(u)
        w = u - k
        z = np.where(w < DUTY, w / DUTY, 1.0)
        a, b, du, periods = z[:-1], z[1:], u[1:] - u[:-1], k[1:] - k[:-1]
        mean, whole = self.mean(a, b)
        y = DUTY * (periods * whole + (b - a) * mean)
        on = w < DUTY
        with np.errstate(invalid="ignore"):
            e = np.where((periods == 0) & on[1:] & on[:-1], mean, np.where(du == 0, 0.0, y / du))
        n = np.arange(x.size, dtype=np.uint64)
        turns = ((self.phase + np.uint64(1 << 62) + n * self.step) >> np.uint64(11)) * 2.0**-53
        self.phase += np.uint64(x.size) * self.step
        t = np.where(turns < 0.5, 2 * turns - 0.5, 1.5 - 2 * turns)
        q = FREQ / FS
        part = np.sin(pi / 2 * np.maximum(t + q, 0.0)) ** 2 / np.sin(pi * q)
        return 50 * A * e * np.where(t >= q, np.sin(pi * t), part)


def chunks(waveform, x):
    """A job that runs the numpy version."""
    parts = [x[a : a + CHUNK] for a in range(0, x.size, CHUNK)]

    def run():
        f = Vectorised(waveform)
        with np.errstate(over="ignore"):
            return [f(p) for p in parts]

    return run


def check(waveform, x):
    """Both give the same samples."""
    proc = stimlib.compile(bumps(waveform, NB, DUTY, A), FS)
    difference = np.abs(proc.process(x[None])[0] - np.concatenate(chunks(waveform, x)())).max()
    assert difference < 1e-8 * 50 * A, difference


def measure() -> list[Row]:
    """All rows."""
    rows: list[Row] = []
    x = stroke(0.1)
    for waveform in ("square", "sine", "sawtooth"):
        check(waveform, x)
        jobs = {"stimlib": puller(bumps(waveform, NB, DUTY, A), x), "numpy": chunks(waveform, x)}
        rows += under(f"{waveform}, 0.1 m/s", compared(jobs, N, "stimlib"))
    for waveform in ("square", "sine", "sawtooth"):
        for speed in (0.02, 0.1, 0.5):
            x = stroke(speed)
            jobs = {
                s: puller(bumps(waveform, NB, DUTY, A, sampling=s), x) for s in ("area", "point")
            }
            u = {
                f"{s} alone": puller(
                    Scene({"e": bump(Input("x"), waveform, DUTY, s)}), x * NB / 0.1
                )
                for s in ("area", "point")
            }
            times = interleaved(jobs | u)
            found = [row(k, v / N * 1e9) for k, v in medians(times).items()]
            found.append(row("ratio: area / point", ratio(times, "area", "point"), TIMES))
            found.append(
                row("ratio: area / point, alone", ratio(times, "area alone", "point alone"), TIMES)
            )
            rows += under(f"{waveform}, {speed:g} m/s, {speed * NB / 0.1:g} bumps/s", found)
    x = stroke(0.1)
    jobs = {
        "contact": puller(bumps("sine", NB, DUTY, A, contact=True), x),
        "no contact": puller(bumps("sine", NB, DUTY, A, contact=True), x, 0.0),
        "amplitude 0": puller(bumps("sine", NB, DUTY, 0.0, contact=True), x),
        "x through, guarded": puller(Scene({"y": Input("x")}), x),
    }
    return rows + under("sine, silence", compared(jobs, N, "contact"))


if __name__ == "__main__":
    main("bumps", __doc__, measure)
