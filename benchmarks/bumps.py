"""The bumps scene: against the same formulas in numpy, area against point sampling, and what silence costs.

Run with ``make bench``.  All figures come from one process; jobs take turns; medians of the rounds are printed, and ratios
are medians of ratios within a round.
"""

from __future__ import annotations

from math import pi

import numpy as np
from bench import interleaved, machine, medians, ratio, save

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
    blocks = [np.array([{"contact": touching}.get(n, x)[a : a + BLOCK] for n in proc.inputs]) for a in range(0, x.size, BLOCK)]
    out = np.empty((len(proc.outputs), BLOCK))

    def run():
        proc.reset()
        for b in blocks:
            proc.process(b, out)

    return run


class Vectorised:
    """gain A e c in numpy: the scene's formulas on whole arrays, state carried from chunk to chunk."""

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


def row(what, value):
    return {"what": what, "ns_per_sample": value}


def main():
    rows: list[dict[str, object]] = []
    for waveform in ("square", "sine", "sawtooth"):
        x = stroke(0.1)
        check(waveform, x)
        ours, numpy = f"stimlib, {waveform}, 0.1 m/s", f"numpy, {waveform}, 0.1 m/s"
        times = interleaved({ours: puller(bumps(waveform, NB, DUTY, A), x), numpy: chunks(waveform, x)})
        rows += [row(k, v / N * 1e9) for k, v in medians(times).items()]
        rows.append(row("ratio: numpy / stimlib", ratio(times, numpy, ours)))
    for waveform in ("square", "sine", "sawtooth"):
        for speed in (0.02, 0.1, 0.5):
            x = stroke(speed)
            jobs = {s: puller(bumps(waveform, NB, DUTY, A, sampling=s), x) for s in ("area", "point")}
            u = {f"{s} alone": puller(Scene({"e": bump(Input("x"), waveform, DUTY, s)}), x * NB / 0.1) for s in ("area", "point")}
            times = interleaved(jobs | u)
            place = f"{waveform}, {speed:g} m/s, {speed * NB / 0.1:g} bumps/s"
            rows += [row(f"{place}: {k}", v / N * 1e9) for k, v in medians(times).items()]
            rows.append(row(f"{place}: ratio area / point", ratio(times, "area", "point")))
            rows.append(row(f"{place}: ratio area / point, alone", ratio(times, "area alone", "point alone")))
    x = stroke(0.1)
    jobs = {
        "sine, contact": puller(bumps("sine", NB, DUTY, A, contact=True), x),
        "sine, no contact": puller(bumps("sine", NB, DUTY, A, contact=True), x, 0.0),
        "sine, amplitude 0": puller(bumps("sine", NB, DUTY, 0.0, contact=True), x),
        "x through, guarded": puller(Scene({"y": Input("x")}), x),
    }
    times = interleaved(jobs)
    rows += [row(k, v / N * 1e9) for k, v in medians(times).items()]
    rows.append(row("ratio: contact / no contact", ratio(times, "sine, contact", "sine, no contact")))
    rows.append(row("ratio: contact / amplitude 0", ratio(times, "sine, contact", "sine, amplitude 0")))
    save("bumps", [{"what": machine(), "ns_per_sample": ""}, *rows])


if __name__ == "__main__":
    main()
