"""What happens at an event: decaying sinusoids, recorded transients, bursts and
envelopes, against formulas in long double.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from scipy import signal

from stimlib.blocks import burst, envelope, grain, ring
from stimlib.core.graph import Block

from .problem import Ladder, Method, Problem, Signal, always, apart, on, own

FS, SAMPLES = 8000.0, 1 << 15
LD = np.longdouble
PI = 4 * np.arctan(LD(1))
AT = np.arange(1, 8) * 4001 + 17
EVENTS = np.zeros(SAMPLES)
EVENTS[AT] = 1.0 + 0.25 * np.arange(AT.size)
RATES = 1000.0, 2000.0, 4000.0, 8000.0, 16000.0


def at_each(table: np.ndarray) -> Signal:
    """A table added from each event on, as far as the signal goes and down to its last
    digit, in memory that is used again.
    """
    far = np.flatnonzero(np.abs(table) > 1e-17 * np.abs(table).max())[-1] + 1
    table, memory = table[:far], {}

    def run(x: np.ndarray) -> np.ndarray:
        y, part = memory.setdefault(x.size, (np.empty(x.size), np.empty(far)))
        y.fill(0.0)
        for k in (x != 0).nonzero()[0]:
            here = y[k : k + far]
            here += np.multiply(table[: here.size], x[k], out=part[: here.size])
        return y

    return run


def summed(table: np.ndarray) -> np.ndarray:
    """The same of EVENTS, in long double."""
    y = np.zeros(SAMPLES + table.size, LD)
    for k in AT:
        y[k : k + table.size] += LD(EVENTS[k]) * table
    return y[:SAMPLES].astype(float)


def error(wanted: np.ndarray, f: Signal) -> float:
    return apart(f(EVENTS), wanted)


# A decaying sinusoid ------------------------------------------------------------------
def decaying(freq: float, decay: float) -> np.ndarray:
    t = np.arange(SAMPLES, dtype=LD) / LD(FS)
    return np.exp(-t / LD(decay)) * np.sin(2 * PI * LD(freq) * t)


def two_poles(decay: float, kind: Any, freq: float) -> Signal:
    """The same poles in direct form."""
    rho, w = np.exp(-1 / (decay * FS)), 2 * np.pi * freq / FS
    b, a = (
        np.array([0.0, rho * np.sin(w)], kind),
        np.array([1.0, -2 * rho * np.cos(w), rho * rho], kind),
    )
    return lambda x: signal.lfilter(b, a, x.astype(kind))


def one_pole(decay: float, freq: float) -> Signal:
    """One complex pole, which is the rotation itself."""
    pole = np.exp(-1 / (decay * FS) + 2j * np.pi * freq / FS)
    return lambda x: signal.lfilter([1.0], [1.0, -pole], x).imag


@cache
def _turns() -> Callable[..., None]:
    from numba import njit

    @njit(error_model="numpy", fastmath={"contract"})
    def run(x, y, re, im):
        s, t, size = 0.0, 0.0, re.size - 1
        for n in range(0, x.size, size):
            part, came = y[n : n + size], x[n : n + size]
            for j in range(part.size):
                part[j] = s * im[j] + t * re[j]
            s, t = s * re[size] - t * im[size], s * im[size] + t * re[size]
            for i in range(part.size):
                v = came[i]
                if v != 0.0:
                    for j in range(i, part.size):
                        part[j] += v * im[j - i]
                    s += v * re[size - i]
                    t += v * im[size - i]

    return run


def powers(decay: float, freq: float) -> Signal:
    """The same pole from block to block; inside, its powers in long double, from each
    event on.
    """
    run, t, y = _turns(), np.arange(129, dtype=LD) / LD(FS), np.empty(SAMPLES)
    fall, angle = np.exp(-t / LD(decay)), 2 * PI * LD(freq) * t
    re, im = (fall * np.cos(angle)).astype(float), (fall * np.sin(angle)).astype(float)

    def ringing(x: np.ndarray) -> np.ndarray:
        run(x, y, re, im)
        return y

    return ringing


def rings() -> list[Method]:
    """Each rings for ten periods."""
    found = []
    for freq in (1000.0, 100.0, 10.0, 1.0):
        decay = 10 / freq
        shape = decaying(freq, decay)
        wanted = summed(shape)
        ladders: dict[str, Ladder] = {
            "stimlib ring, Hz": ([freq], own(lambda x, freq: ring(x, freq, 10 / freq), FS)),
            "two poles in scipy lfilter, Hz": ([freq], partial(two_poles, decay, float)),
            "two poles in scipy lfilter, float32, Hz": (
                [freq],
                partial(two_poles, decay, np.float32),
            ),
            "one complex pole in scipy lfilter, Hz": ([freq], partial(one_pole, decay)),
            "powers of one pole in blocks, compiled, Hz": ([freq], partial(powers, decay)),
            "numpy, a table at each event, Hz": ([freq], always(at_each(shape.astype(float)))),
        }
        found += on(EVENTS, partial(error, wanted), ladders)
    return found


# A recorded transient -----------------------------------------------------------------
def grains_of(shape: np.ndarray, event: Block, _: int) -> Block:
    return grain(event, shape, FS)


def convolved(shape: np.ndarray, x: np.ndarray) -> np.ndarray:
    return signal.oaconvolve(x, shape)[: x.size]


def grains() -> list[Method]:
    found = []
    for n in (64, 512, 4096):
        shape = np.random.default_rng(n).standard_normal(n) * np.hanning(n)
        wanted = summed(shape.astype(LD))
        ladders: dict[str, Ladder] = {
            "stimlib grain, samples": ([n], own(partial(grains_of, shape), FS)),
            "scipy lfilter, samples": ([n], always(partial(signal.lfilter, shape, [1.0]))),
            "oaconvolve, whole file, samples": ([n], always(partial(convolved, shape))),
            "numpy, a table at each event, samples": ([n], always(at_each(shape))),
        }
        found += on(EVENTS, partial(error, wanted), ladders)
    return found


# What opens and closes ----------------------------------------------------------------
SECONDS, BURST, RAMP = 1.0, 0.3003, 0.0507  # s: no whole samples at any rate
ATTACK, DECAY, SUSTAIN, RELEASE = 0.0207, 0.05, 0.5, 0.1
OPEN, CLOSE = 0.25, 0.75


def raised(t: np.ndarray) -> np.ndarray:
    """A burst, t after it began."""
    edge = np.clip(np.minimum(t, LD(BURST) - t) / LD(RAMP), 0, 1)
    return (np.sin(PI / 2 * edge) ** 2).astype(float)


def bursts_at(fs: float) -> list[Method]:
    n, first = int(SECONDS * fs), int(OPEN * fs)
    x = np.zeros(n)
    x[first] = 1.0
    wanted = raised((np.arange(n) - first + LD(0.5)) / LD(fs))
    length = round(BURST * fs)
    lean = np.minimum((np.arange(length) + 0.5) / RAMP / fs, 1)  # up, and read backwards down

    def formula(x: np.ndarray) -> np.ndarray:
        """Of each event, in float64."""
        y = np.zeros(x.size)
        for k in np.flatnonzero(x):
            t = (np.arange(length + 1) + 0.5) / fs
            edge = np.clip(np.minimum(t, BURST - t) / RAMP, 0, 1)
            y[k : k + t.size] += (np.sin(np.pi / 2 * edge) ** 2)[: x.size - k]
        return y

    one = np.zeros(length + 1)
    one[0] = 1.0
    ladders = {
        "numpy, the formula at each event, fs": ([fs], always(formula)),
        "numpy, a table at each event, fs": ([fs], always(at_each(formula(one)))),
        "stimlib burst, fs": ([fs], own(lambda x, _: burst(x, BURST, RAMP), fs)),
        "scipy tukey at each event, fs": (
            [fs],
            always(at_each(signal.windows.tukey(length, 2 * RAMP / BURST))),
        ),
        "straight ramps by numpy, fs": ([fs], always(at_each(np.minimum(lean, lean[::-1])))),
    }
    return on(x, lambda f: apart(f(x), wanted), ladders)


def attacked(t: np.ndarray, number: type = LD) -> np.ndarray:
    """From the opening on, as long as the gate is open."""
    top, attack = 1 / -np.expm1(number(-1.5)), number(ATTACK)  # 1.5 time constants
    late = SUSTAIN + (1 - number(SUSTAIN)) * np.exp(-(t - attack) / number(DECAY))
    return np.where(t < attack, -top * np.expm1(-1.5 * t / attack), late)


def adsr(t: np.ndarray, number: type = LD) -> np.ndarray:
    """From the opening on; CLOSE - OPEN later it falls."""
    gate, t = number(CLOSE) - number(OPEN), np.maximum(t, 0)
    fallen = attacked(gate, number) * np.exp(-(t - gate) / number(RELEASE))
    return np.where(t < gate, attacked(t, number), fallen).astype(float)


def staged(fs: float) -> Signal:
    """Stage by stage, each a filter of one pole by Euler's rule."""
    top = 1 / -np.expm1(-1.5)

    def run(gate: np.ndarray) -> np.ndarray:
        y, last = np.zeros(gate.size), 0.0
        first, end = np.flatnonzero(np.diff(gate, prepend=0.0, append=0.0))[:2]
        full = first + round(ATTACK * fs)
        for a, b, tau, to in (
            (first, full, ATTACK / 1.5, top),
            (full, end, DECAY, SUSTAIN),
            (end, gate.size, RELEASE, 0.0),
        ):
            g = 1 / (tau * fs)
            y[a:b], _ = signal.lfilter(
                [g], [1.0, g - 1.0], np.full(b - a, to), zi=[(1.0 - g) * last]
            )
            last = y[b - 1]
        return y

    return run


def envelopes_at(fs: float) -> list[Method]:
    t = np.arange(int(SECONDS * fs)) / fs
    x = ((t >= OPEN) & (t < CLOSE)).astype(float)
    wanted = adsr((np.arange(t.size) + 1 - int(OPEN * fs)) / LD(fs))

    def timed(x: np.ndarray) -> np.ndarray:
        """From the gate's first and last sample on, in float64."""
        y, opens = np.zeros(x.size), int(np.argmax(x))
        y[opens:] = adsr((np.arange(x.size - opens) + 1) / fs, float)
        return y

    since = (np.arange(t.size) + 1) / fs
    held, falls = attacked(since, float), np.exp(-since / RELEASE)

    def tabled(x: np.ndarray) -> np.ndarray:
        """Two tables: from the gate's opening on, and from its closing on."""
        y, opens = np.zeros(x.size), int(x.argmax())
        closes = opens + int(x[opens:].argmin())
        y[opens:closes] = held[: closes - opens]
        np.multiply(falls[: x.size - closes], y[closes - 1], out=y[closes:])
        return y

    corners = [OPEN, OPEN + ATTACK, OPEN + ATTACK + DECAY, CLOSE, CLOSE + RELEASE]
    ladders = {
        "stimlib envelope, fs": (
            [fs],
            own(lambda x, _: envelope(x, ATTACK, DECAY, SUSTAIN, RELEASE), fs),
        ),
        "Euler in scipy lfilter, stage by stage, fs": ([fs], staged),
        "straight lines by numpy, fs": (
            [fs],
            always(lambda x: np.interp(t, corners, [0.0, 1.0, SUSTAIN, SUSTAIN, 0.0])),
        ),
    }
    ladders["numpy, the formula, fs"] = [fs], always(timed)
    ladders["numpy, tables, fs"] = [fs], always(tabled)
    return on(x, lambda f: apart(f(x), wanted), ladders)


def at_rates(make) -> list[Method]:
    return [m for fs in RATES for m in make(fs)]


FORMULA = "largest error to the formula in continuous time"
PROBLEMS = (
    Problem(
        "ring",
        "decaying sinusoids of 1 Hz to 1 kHz at 8 kHz",
        "largest error, of the maximum",
        SAMPLES,
        rings,
        asked=True,
    ),
    Problem(
        "grain",
        "a recorded transient at each of 7 events in 4 s",
        "largest error, of the maximum",
        SAMPLES,
        grains,
        asked=True,
    ),
    Problem(
        "burst",
        "a burst of 300.3 ms with ramps",
        FORMULA,
        1000,
        partial(at_rates, bursts_at),
        "a millisecond",
        asked=True,
    ),
    Problem(
        "envelope",
        "attack, decay, sustain, release",
        FORMULA,
        1000,
        partial(at_rates, envelopes_at),
        "a millisecond",
        asked=True,
    ),
)
