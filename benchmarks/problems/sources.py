"""What sounds by itself: waves, sweeps, pulses and recordings, against Fourier series
and formulas in long double or in 120 bits.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from itertools import product
from math import factorial

import numpy as np
from mpmath import mp
from scipy import interpolate, signal

from stimlib.blocks import chirp, oscillator, playback, pulse_train

from .problem import Ladder, Method, Problem, Signal, always, apart, on, own, searched

FS, SAMPLES = 8000.0, 1 << 16
LD = np.longdouble
PI = 4 * np.arctan(LD(1))

# A sawtooth ---------------------------------------------------------------------------
# Hz: a whole number without a common factor with fs, and the end of what a finger feels
FREQ, FELT = 201, 1000
SECOND = np.arange(8000)
# of a decimation's window, and of its edge over half the rate: what is felt must pass
SHAPES, CUTS = np.arange(0.0, 21.0), np.arange(0.3, 1.11, 0.1)


def aliases(f: Signal) -> float:
    """Largest line below 1 kHz that is no harmonic, over the first harmonic: of one
    second each line is one bin.
    """
    lines = np.abs(np.fft.rfft(f(np.zeros(8000))[:8000]))[:FELT]
    others = np.arange(FELT) % FREQ != 0
    return float(lines[others].max() / lines[FREQ])


def turns(n: np.ndarray) -> np.ndarray:
    """Phase of a sample, 0 to 1."""
    return n * (FREQ / FS) % 1.0


def polyblep(x: np.ndarray) -> np.ndarray:
    """The jump gets the step response of a linear interpolator (Valimaki and
    Huovilainen 2007).
    """
    p, d = turns(np.arange(x.size)), FREQ / FS
    y, after, before = 2.0 * p - 1.0, p < d, p > 1 - d
    a, b = p[after] / d, (p[before] - 1) / d
    y[after] -= 2 * a - a * a - 1
    y[before] -= b * b + 2 * b + 1
    return y


def parabolic(x: np.ndarray) -> np.ndarray:
    """Differences of the wave's integral (differentiated parabolic waveform, Valimaki
    2005).
    """
    return np.diff((2 * turns(np.arange(-1, x.size)) - 1) ** 2) * FS / (4 * FREQ)


def oversampled(n: int) -> Signal:
    """Made at n times the rate and brought down by scipy's filter, as long as its
    default, whose window and edge are searched.
    """

    def windowed(beta: float, edge: float) -> Signal:
        h = signal.firwin(20 * n + 1, edge / n, window=("kaiser", beta))

        def run(x: np.ndarray) -> np.ndarray:
            return signal.resample_poly(
                2 * turns(np.arange(-200 * n, (x.size + 200) * n) / n) - 1, 1, n, window=h
            )[200 : 200 + x.size]

        return run

    return searched(aliases, product(SHAPES, CUTS), windowed)


def additive(x: np.ndarray) -> np.ndarray:
    """All harmonics below fs/2."""
    p, y = 2 * np.pi * turns(np.arange(x.size)), np.zeros(x.size)
    for k in range(1, int(FS / 2 / FREQ) + 1):
        y -= 2 / np.pi / k * np.sin(k * p)
    return y


def sawtooth() -> list[Method]:
    return on(
        np.zeros(SAMPLES),
        aliases,
        {
            "stimlib oscillator, by area": (
                [FREQ],
                own(lambda freq: oscillator(freq, "sawtooth"), FS, ()),
            ),
            "points, scipy sawtooth": (
                [FREQ],
                always(lambda x: signal.sawtooth(2 * np.pi * FREQ / FS * np.arange(x.size))),
            ),
            "polyBLEP in numpy": ([FREQ], always(polyblep)),
            "parabolic (DPW) in numpy": ([FREQ], always(parabolic)),
            "points at n times the rate, scipy resample_poly, n": ([2, 4, 8, 16], oversampled),
            "sum of harmonics in numpy": ([FREQ], always(additive)),
        },
    )


# A sweep ------------------------------------------------------------------------------
F0, F1, LASTS = 10.0, 1000.0, SAMPLES / FS
SOME = slice(None, None, 15)  # of the samples, against which errors are held


@cache
def exact(kind: str) -> np.ndarray:
    """Some samples of the formula, in 120 bits: of 4000 turns, long double is 5e-15
    off.
    """
    with mp.workprec(120):
        t = [mp.mpf(n) / FS for n in range(SAMPLES)[SOME]]
        if kind == "linear":
            turns = [F0 * v + (mp.mpf(F1) - F0) / (2 * mp.mpf(LASTS)) * v * v for v in t]
        else:
            a = mp.log(mp.mpf(F1) / F0) / LASTS
            turns = [F0 / a * mp.expm1(a * v) for v in t]
        return np.array([float(mp.sin(2 * mp.pi * mp.frac(p))) for p in turns])


def swept(kind: str) -> np.ndarray:
    t, ratio = np.arange(SAMPLES, dtype=LD) / LD(FS), LD(F1) / LD(F0)
    if kind == "linear":
        phase = LD(F0) * t + (LD(F1) - LD(F0)) * t * t / (2 * LD(LASTS))
    else:
        phase = LD(F0) * LD(LASTS) / np.log(ratio) * np.expm1(t / LD(LASTS) * np.log(ratio))
    return np.sin(2 * PI * (phase - np.floor(phase))).astype(float)


def added_up(kind: str) -> Signal:
    """A phase that adds up the frequency of the middle between two samples."""

    def run(x: np.ndarray) -> np.ndarray:
        z = (np.arange(x.size - 1) + 0.5) / x.size
        f = F0 + (F1 - F0) * z if kind == "linear" else F0 * (F1 / F0) ** z
        return np.sin(2 * np.pi / FS * np.r_[0.0, np.cumsum(f)])

    return run


def by_scipy(kind: str, number: type) -> Signal:
    method = {"linear": "linear", "exponential": "logarithmic"}[kind]
    return lambda x: signal.chirp(
        (np.arange(x.size) / FS).astype(number), F0, LASTS, F1, method, phi=-90
    )


def by_formula(kind: str) -> Signal:
    """The formula with its phase in long double."""
    return lambda x: swept(kind)


@cache
def _sines() -> Callable[..., None]:
    from numba import njit

    c0, *c = ((-1) ** k * (2 * PI) ** (2 * k + 1) / LD(factorial(2 * k + 1)) for k in range(11))
    c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10 = (float(v) for v in (c0, *c))
    whole = 1.5 * 2.0**52  # a sum with it is rounded to a whole number

    @njit(error_model="numpy", fastmath={"contract"})
    def run(y, phase, freq, inner, square):
        for b in range(phase.size):
            p, f, part = phase[b], freq[b], y[b * inner.size : (b + 1) * inner.size]
            for j in range(part.size):
                x = (f * inner[j] + square[j]) + p
                x = x - ((x + whole) - whole)
                x = np.copysign(0.25 - abs(abs(x) - 0.25), x)
                z = x * x
                s = c6 + z * (c7 + z * (c8 + z * (c9 + z * c10)))
                s = z * (c1 + z * (c2 + z * (c3 + z * (c4 + z * (c5 + z * s)))))
                part[j] = x * c0 + x * s

    return run


def by_blocks(kind: str, block: int = 64) -> Signal:
    """The phase in long double in the middle of each block, and a polynomial of the
    sine in a compiled loop.
    """
    run, y = _sines(), np.empty(SAMPLES)
    a, k = np.log(LD(F1) / LD(F0)) / LD(LASTS), (LD(F1) - LD(F0)) / (2 * LD(LASTS))
    j = (np.arange(block, dtype=LD) - block // 2) / LD(FS)
    linear = kind == "linear"
    inner = (j if linear else np.expm1(a * j)).astype(float)
    square = (k * j * j * linear).astype(float)

    def sweep(x: np.ndarray) -> np.ndarray:
        t = np.arange(block // 2, x.size, block, dtype=LD) / LD(FS)
        if linear:
            freq = LD(F0) + 2 * k * t
            phase = (LD(F0) + k * t) * t
        else:
            freq = LD(F0) / a * np.exp(a * t)
            phase = freq - LD(F0) / a
        phase -= np.rint(phase)
        run(y, phase.astype(float), freq.astype(float), inner, square)
        return y

    return sweep


def sweep_error(kind: str, f: Signal) -> float:
    return apart(f(np.zeros(SAMPLES))[SOME], exact(kind))


def sweeps() -> list[Method]:
    found = []
    for kind in ("linear", "exponential"):
        ladders: dict[str, Ladder] = {
            "stimlib chirp": ([kind], own(lambda kind: chirp(F0, F1, LASTS, kind), FS, ())),
            "scipy chirp": ([kind], partial(by_scipy, number=float)),
            "scipy chirp, float32": ([kind], partial(by_scipy, number=np.float32)),
            "numpy cumsum of the frequency": ([kind], added_up),
            "a polynomial of the phase in blocks, compiled": ([kind], by_blocks),
            "numpy, the formula in long double": ([kind], by_formula),
        }
        found += on(np.zeros(SAMPLES), partial(sweep_error, kind), ladders)
    return found


# Pulses -------------------------------------------------------------------------------
RATE = 157.9  # Hz


def pulses_at(fs: float) -> list[Method]:
    n = int(8 * fs)

    def late(f: Signal) -> float:
        """Largest error of an event's time in s."""
        found = np.flatnonzero(f(np.zeros(n))) / fs
        wanted = (np.arange(found.size) + 0.5) / RATE
        return float(np.abs(found - wanted).max())

    def phase(kind: type) -> Signal:
        def run(x: np.ndarray) -> np.ndarray:
            p = np.cumsum(np.full(x.size, RATE / fs, kind), dtype=kind) + kind(0.5)
            return np.diff(np.floor(p), prepend=0.0)

        return run

    def counted(x: np.ndarray) -> np.ndarray:
        y, period = np.zeros(x.size), round(fs / RATE)
        y[period // 2 :: period] = 1.0
        return y

    def at_times(x: np.ndarray) -> np.ndarray:
        y, k = np.zeros(x.size), np.arange(x.size * RATE / fs + 1)
        at = np.rint((k + 0.5) / RATE * fs).astype(int)
        y[at[at < x.size]] = 1.0
        return y

    return on(np.zeros(n), late, {
        "numpy, the times by the formula, fs": ([fs], always(at_times)),
        "stimlib pulse_train, fs": ([fs], own(lambda _: pulse_train(RATE), fs, ())),
        "numpy cumsum of the phase, fs": ([fs], always(phase(np.float64))),
        "the same in float32, fs": ([fs], always(phase(np.float32))),
        "a count of whole samples, fs": ([fs], always(counted)),
    })  # fmt: skip


def pulses() -> list[Method]:
    return [m for fs in (1000.0, 2000.0, 4000.0, 8000.0, 16000.0, 48000.0) for m in pulses_at(fs)]


# A recording --------------------------------------------------------------------------
RECORDED, UP = 1000.0, 8
# of Kaiser's window, and the edge of the filter over half the recording's rate
BETAS, EDGES = np.arange(2.0, 21.0), np.arange(0.9, 1.11, 0.05)
# Hz, rad
TONES = [
    (1.0, 20.3, 0.2),
    (0.8, 97.7, 1.3),
    (0.5, 251.1, 2.1),
    (0.3, 333.9, 0.4),
    (0.2, 418.3, 1.9),
]


def vibration(t: np.ndarray) -> np.ndarray:
    """Up to 0.42 of the recording's rate."""
    return sum((a * np.sin(2 * np.pi * f * t + p) for a, f, p in TONES), np.zeros_like(t))


def recordings() -> list[Method]:
    t = np.arange(1 << 14) / FS
    known = np.arange(t.size // UP) / RECORDED
    taken = vibration(known)
    inside = slice(1600, -1600)  # what is near its ends has nothing beside it

    def error(f: Signal) -> float:
        return apart(f(t)[inside], vibration(t)[inside])

    def copied(reach: int) -> Signal:
        made, y = searched(error, product([reach], BETAS, EDGES), windowed)(t), np.empty(t.size)

        def run(t: np.ndarray) -> np.ndarray:
            np.copyto(y, made)
            return y

        return run

    def matrix(reach: int, beta: float, edge: float, rows: int = 16) -> Signal:
        """The same sums as a product of matrices: so many samples of the recording at
        once, with those around them.
        """
        h = signal.firwin(2 * reach * UP + 1, edge / UP, window=("kaiser", beta)) * UP
        at = np.arange(UP * rows) - UP * np.arange(-2 * reach, rows)[:, None]
        full = np.where((at >= 0) & (at < h.size), h[np.clip(at, 0, h.size - 1)], 0.0)
        z, shape = np.zeros(taken.size + 2 * reach), (taken.size // rows, full.shape[0])
        near, y = np.empty(shape), np.empty((shape[0], full.shape[1]))
        around = np.lib.stride_tricks.as_strided(z, shape, (rows * z.itemsize, z.itemsize))

        def run(t: np.ndarray) -> np.ndarray:
            z[reach : reach + taken.size] = taken
            np.copyto(near, around)
            return np.matmul(near, full, out=y).reshape(-1)[: t.size]

        return run

    def windowed(reach: int, beta: float, edge: float) -> Signal:
        h = signal.firwin(2 * reach * UP + 1, edge / UP, window=("kaiser", beta))
        return lambda t: signal.resample_poly(taken, UP, 1, window=h)[: t.size]

    return on(
        t,
        error,
        {
            "stimlib playback, made when it is compiled": (
                [""],
                own(lambda _: playback(taken, RECORDED), FS, ()),
            ),
            "stimlib playback at a time that is a signal": (
                [""],
                own(lambda t, _: playback(taken, RECORDED, at=t), FS, "s"),
            ),
            "scipy resample_poly, samples to each side": (
                [5, 10, 20, 40, 80],
                lambda reach: searched(error, product([reach], BETAS, EDGES), windowed),
            ),
            "sums of resample_poly as a product of matrices, samples to each side": (
                [20, 28, 40],
                lambda reach: searched(error, product([reach], BETAS, EDGES), matrix),
            ),
            "a copy of resample_poly made before, samples to each side": ([40], copied),
            "scipy resample, whole file": ([""], always(lambda t: signal.resample(taken, t.size))),
            "scipy CubicSpline": ([""], always(interpolate.CubicSpline(known, taken))),
            "numpy interp": ([""], always(lambda t: np.interp(t, known, taken))),
        },
    )


PROBLEMS = (
    Problem(
        "sawtooth",
        "a sawtooth of 201 Hz at 8 kHz",
        "largest alias below 1 kHz, of the first harmonic",
        SAMPLES,
        sawtooth,
    ),
    Problem(
        "chirp",
        "sweeps from 10 Hz to 1 kHz in 8 s, at 8 kHz",
        "largest error",
        SAMPLES,
        sweeps,
        asked=True,
    ),
    Problem(
        "pulses",
        "pulses of 157.9 Hz for 8 s",
        "largest error of an event's time, s",
        8000,
        pulses,
        "a millisecond",
        asked=True,
    ),
    Problem(
        "playback",
        "a recording of 1 kHz with content to 418 Hz, at 8 kHz",
        "largest error, of the maximum",
        1 << 14,
        recordings,
    ),
)
