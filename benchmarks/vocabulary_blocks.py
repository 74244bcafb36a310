"""The vocabulary: filters against scipy's biquads, events in silence against a copy,
and what each other word costs.

    python benchmarks/vocabulary_blocks.py             print
    python benchmarks/vocabulary_blocks.py --record    and keep the figures

They are kept in results/vocabulary_blocks.csv.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from bench import Row, compared, main, row, under
from scipy import signal
from timing import interleaved, medians

import stimlib
from stimlib import Block, Input, Scene, blocks as b, constant
from stimlib.design.texture import made_up

FS, N, BLOCK = 8000, 1 << 16, 4096
X, F = Input("x"), Input("f", "Hz")
RNG = np.random.default_rng(0)
NOISE, SILENCE = RNG.standard_normal(N), np.zeros(N)
EVENTS = np.where(RNG.random(N) < 0.001, 1.0, 0.0)
SHAPE = RNG.standard_normal(800)
SURFACE, PRESS = (
    made_up(10, np.linspace(0, 0.2, 7), np.linspace(0, 3, 9)),
    F * constant(0.005, "N s"),
)
# at 1 m/s, where noise over place costs most
STROKE, PLACE = np.arange(N) / FS, X * constant(1.0, "m")
SWEEP = 300 + 200 * np.sin(np.arange(N) / 50)


def puller(block: Block, x: np.ndarray = NOISE) -> Callable[[], None]:
    """A job that streams a block in calls of 4096 samples."""
    proc, given = stimlib.compile(Scene({"y": block}), FS), {"x": x, "f": SWEEP}
    rows = [
        np.array([given[n][a : a + BLOCK] for n in proc.inputs]).reshape(-1, BLOCK)
        for a in range(0, N, BLOCK)
    ]
    out = np.empty((1, BLOCK))

    def run() -> None:
        for r in rows:
            proc.process(r, out)

    return run


def biquads(sos: np.ndarray) -> Callable[[], object]:
    """The same in scipy, all in one call, as it is fastest."""
    return lambda: signal.sosfilt(sos, NOISE)


def filters() -> list[Row]:
    """Each order of a low-pass, and a band-pass, beside scipy."""
    found = []
    for order in (2, 4, 8, 12):
        jobs = {
            "stimlib": puller(b.lowpass(X, 300, order)),
            "sosfilt": biquads(signal.butter(order, 300, fs=FS, output="sos")),
        }
        found += under(f"low-pass of order {order}", compared(jobs, N, "stimlib", 9))
    sos = signal.ellip(4, 1, 60, [100, 300], "bandpass", fs=FS, output="sos")
    jobs = {"stimlib": puller(b.bandpass(X, 100, 300, 4, "elliptic")), "sosfilt": biquads(sos)}
    return found + under("elliptic band-pass of order 4", compared(jobs, N, "stimlib", 9))


def silence() -> list[Row]:
    """What waits for an event."""
    words = {
        "ring": b.ring(X, 150, 0.01),
        "grain of 800 samples": b.grain(X, SHAPE, FS),
        "burst": b.burst(X, 0.02, 0.005),
    }
    words |= {
        "rising": b.rising(X, 0.5),
        "crossing": b.crossing(X, 0.01),
        "once within": b.once_within(X, 0.01),
    }
    words |= {"envelope": b.envelope(X)}
    jobs = {"a copy": puller(1.0 * X, SILENCE)} | {
        name: puller(word, SILENCE) for name, word in words.items()
    }
    return under("silence", compared(jobs, N, "a copy", 15))


def others() -> list[Row]:
    """All else, each alone."""
    hz = constant(1.0, "Hz")
    jobs = {
        "svf": puller(b.svf(X, 300, 2.0)),
        "svf, cutoff that moves": puller(b.svf(X, F, 2.0)),
        "integrate": puller(b.integrate(X)),
        "moving average of 80": puller(b.moving_average(X, 0.01)),
        "envelope follower": puller(b.envelope_follower(X)),
        "envelope": puller(b.envelope(X)),
        "ring, 8 events a second": puller(b.ring(X, 150, 0.01), EVENTS),
        "ring, frequency that moves": puller(b.ring(X, F, 0.01), EVENTS),
        "grain of 800, 8 events a second": puller(b.grain(X, SHAPE, FS), EVENTS),
        "sawtooth, frequency that moves": puller(b.oscillator(F, "sawtooth") + X),
        "chirp": puller(X + b.chirp(20, 400, 9.0)),
        "pulse train": puller(X + b.pulse_train(F + 0.0 * hz)),
        "every": puller(X + b.every(0.01)),
        "texture of order (20, 18), a model each ms": puller(
            b.texture(X * constant(0.1, "m/s"), PRESS, SURFACE, seed=1)
        ),
        "noise over place, four decades, at 1 m/s": puller(b.spatial_noise(PLACE), STROKE),
        "grating of two parts": puller(
            b.grating(PLACE, [(1e-3, 1.0, 0.0), (3e-4, 0.5, 0.0)]), STROKE
        ),
        "friction, elastoplastic": puller(b.friction(PLACE, 1.0), STROKE),
        "timeline": puller(X + b.timeline([(0, 0), (1, 1), (5, 0)])),
    }
    return [row(name, seconds / N * 1e9) for name, seconds in medians(interleaved(jobs, 9)).items()]


def measure() -> list[Row]:
    """All rows."""
    return filters() + silence() + others()


if __name__ == "__main__":
    main("vocabulary_blocks", __doc__, measure)
