"""What sounds by itself: waves, sweeps, pulses and recordings, against Fourier series
and formulas in long double.
"""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np
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
    """The formula with its phase in long double, as the reference."""
    return lambda x: swept(kind)


def sweep_error(wanted: np.ndarray, f: Signal) -> float:
    return apart(f(wanted), wanted)


def sweeps() -> list[Method]:
    found = []
    for kind in ("linear", "exponential"):
        wanted = swept(kind)
        ladders: dict[str, Ladder] = {
            "stimlib chirp": ([kind], own(lambda kind: chirp(F0, F1, LASTS, kind), FS, ())),
            "scipy chirp": ([kind], partial(by_scipy, number=float)),
            "scipy chirp, float32": ([kind], partial(by_scipy, number=np.float32)),
            "numpy cumsum of the frequency": ([kind], added_up),
            "numpy, the formula in long double": ([kind], by_formula),
        }
        found += on(np.zeros(SAMPLES), partial(sweep_error, wanted), ladders)
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
