"""The laws of blocks on their input rows, in plain numpy.

Nothing of a block's design or step is used.

``LAWS`` has a function for each class; ``linear`` adds those of linear blocks.  It
takes the block, the sample rate in Hz, the rows of its input signals and the row that
was seen, from where the block began (``Rows.rest``) or from any later sample on.  It
returns the row that this should be, and how far from it a correct one may be; or None
where the law does not cover the block's numbers.  A block of several outputs has
several rows.  Most laws use what was seen only where a rounding decides, or for the
sample before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..core.graph import Const
from ..core.program import lead
from . import laws, soft, surfaces, touch

Row = np.ndarray


class Rows(list[Row]):
    """The rows of a block's signals."""

    at = 0  # the sample that they begin with, below 0 where the block begins before sample 0
    rest = True  # whether the block began there
    seed = 0  # of the run
    past: int = 0  # what ``SUMS`` makes of all samples before, from sample 0 on


Law = Callable[[Any, float, Rows, Row], tuple[Row, Any] | None]
LAWS: dict[str, Law] = {}
SINCE: dict[str, Callable[[Any, float, Rows], float] | float] = {}
"""By the name of a class."""
FADED = 48.0  # time constants, after which 1e-21 of a state is left
ULP = 2.0**-52
TIE = 1e-9  # of a place: so near to an edge either side is right


def law(
    *names: str, since: Callable[[Any, float, Rows], float] | float = math.inf
) -> Callable[[Law], Law]:
    """Enter a law for the classes of these names.

    It says how many samples it must have seen of a block that began before them.
    """

    def enter(f: Law) -> Law:
        LAWS.update(dict.fromkeys(names, f))
        SINCE.update(dict.fromkeys(names, since))
        return f

    return enter


def since(b: Any, fs: float, x: Rows) -> int:
    """Return the first sample that a law covers, where its block began before.

    Never is 2^62.
    """
    first = SINCE.get(type(b).__name__, math.inf)
    with np.errstate(all="ignore"):
        n = first(b, fs, x) if callable(first) else first
    return math.ceil(n) if n < 2.0**62 else 1 << 62


def near(want: Row, tol: float = 1e-12) -> tuple[Row, float]:
    """Return a row, and a part of its largest value."""
    return want, tol * float(np.abs(want[np.isfinite(want)]).max(initial=1e-300))


def touched(contact: Row) -> Iterator[slice]:
    """Each stretch of contact."""
    on = np.r_[False, contact > 0, False]
    for a, b in zip(
        np.flatnonzero(on[1:] & ~on[:-1]), np.flatnonzero(on[:-1] & ~on[1:]), strict=True
    ):
        yield slice(a, b)


def begun(x: Rows, tol: Any) -> Any:
    """Return a tolerance, and none before the first contact in a stretch."""
    known = x.rest | (np.cumsum(np.diff(x[-1] > 0, prepend=x[-1][:1] > 0) & (x[-1] > 0)) > 0)
    return np.where(known, tol, np.inf)


def before(x: Row, contact: Row) -> Row:
    """Where each sample's way began; at the first sample of a contact where it is."""
    return laws.ways(x, contact)[0]


# Arithmetic ---------------------------------------------------------------------------
def _maps(exact: dict[str, Callable], rounded: dict[str, Callable]) -> None:
    def of(f: Callable, ulps: float) -> Law:
        return lambda b, fs, x, y: (w := np.asarray(f(*x), float), ulps * (ULP * np.abs(w) + 5e-17))

    for fs, ulps in ((exact, 0.0), (rounded, 1.8)):
        for name, f in fs.items():
            law(name, since=0)(of(f, ulps))


_maps(
    {
        "Add": np.add,
        "Sub": np.subtract,
        "Mul": np.multiply,
        "Div": np.divide,
        "Neg": np.negative,
        "Abs": np.abs,
        "Greater": np.greater,
        "AtLeast": np.greater_equal,
        "Equal": np.equal,
        "NotEqual": np.not_equal,
        "Maximum": np.maximum,
        "Minimum": np.minimum,
        "Sqrt": np.sqrt,
        "Nonzero": lambda x: x != 0,
        "Where": lambda c, a, b: np.where(c > 0, a, b),
        "NotBelowZero": lambda x: np.where(x < 0, np.nan, x),
        "ForceLimit": lambda x, peak: np.where(
            np.isfinite(x), np.minimum(np.maximum(x, -peak), peak), x
        ),
        "Tally": lambda x, before: x,
    },
    {"Exp": np.exp, "Log": np.log, "Sin": np.sin, "Cos": np.cos, "Tanh": np.tanh},
)


@law("Dent", since=0)
def _dent(b, fs, x, y):
    rho, d, r = np.abs(x[0]), x[1], b.radius
    foot = np.maximum(2 * r, d)  # where the skirt of a ball that is deeper than its radius ends
    with np.errstate(invalid="ignore", divide="ignore"):
        ball = np.maximum(d - r + np.sqrt(np.maximum(r * r - rho * rho, 0)), 0)
        skirt = np.where(d > r, np.maximum((d - r) * (foot - rho) / (foot - r), 0), 0)
    want = np.where(rho <= r, ball, skirt)
    want = np.where(d <= (1 - math.sqrt(0.75)) * r, 0, want)  # nobody else's place is so near
    return near(np.where(d > 0, np.where(rho == 0, d, want), 0))


@law("First", since=1)
def _first(b, fs, x, y):
    return np.full(y.size, x[0][0] if x.rest else y[0]), 0.0


# Limits -------------------------------------------------------------------------------
@law("StaticLimit", since=lambda b, fs, x: FADED * b.tau * fs)
def _static_limit(b, fs, x, y):
    from scipy.signal import lfilter

    a, most = -np.expm1(-1 / (b.tau * fs)), b.limit**2
    mean = np.r_[0.0, lfilter([a], [1, a - 1], y**2)[:-1]]
    cap = math.sqrt(most * (0.81 + 0.19 / a))
    want = np.minimum(1.0, (most - mean) / (0.19 * most)) * np.clip(x[0], -cap, cap)
    return want, (1e-12 + 2.0**-50 * b.tau * fs) * max(float(np.abs(x[0]).max()), 1e-300)


@law("SlewLimit", since=1)
def _slew_limit(b, fs, x, y):
    last = np.r_[0.0, y[:-1]]
    return near(np.clip(x[0], last - b.rate / fs, last + b.rate / fs), 1e-15)


@law("Follower", since=1)
def _follower(b, fs, x, y):
    last = np.r_[0.0, y[:-1]]
    up, down = (
        1.0 if t * fs <= 1e-3 else 1 - math.exp(-1 / (t * fs)) for t in (b.attack, b.release)
    )
    return near(last + np.where(np.abs(x[0]) > last, up, down) * (np.abs(x[0]) - last), 1e-14)


# Time ---------------------------------------------------------------------------------
def sample_of(t: Row, fs: float) -> Row:
    """Return the sample at each time."""
    return np.rint(t * fs).astype(np.int64)


@law("Time", since=0)
def _time(b, fs, x, y):
    return np.arange(x.at, x.at + y.size) / fs, 0.0


@law("Interval", since=0)
def _interval(b, fs, x, y):
    n, first = np.arange(x.at, x.at + y.size), math.floor(b.begin * fs + 0.5)
    return (n >= first) & (b.duration is None or n < first + math.floor(b.duration * fs + 0.5)), 0.0


@law("Every", since=0)
def _every(b, fs, x, y):
    n = sample_of(x[0], fs)
    k = np.arange(int(n.max(initial=0) / (b.period * fs)) + 2)
    return np.isin(n, np.floor(k * (b.period * fs) + 0.5)), 0.0


@law("At", since=0)
def _at(b, fs, x, y):
    at = np.floor(b.times * fs + 0.5)
    return (
        np.sum(at[:, None] == sample_of(x[0], fs), axis=0)
        if at.size < 1000
        else np.isin(sample_of(x[0], fs), at)
    ), 0.0


@law("Timeline", since=0)
def _timeline(b, fs, x, y):
    t, want = x[0], np.full(y.size, b.values[0])
    for t0, t1, v0, v1 in zip(b.times, b.times[1:], b.values, b.values[1:], strict=False):
        z = (t - t0) / (t1 - t0) if t1 > t0 else np.zeros(t.size)
        w = {"step": 0 * z, "linear": z, "cosine": (1 - np.cos(np.pi * z)) / 2}[b.kind]
        want = np.where(t >= t0, v0 + (v1 - v0) * w, want)
    return near(np.where(t >= b.times[-1], b.values[-1], want), 1e-13)


@law("Chirp", since=0)
def _chirp(b, fs, x, y):
    n = sample_of(x[0], fs)
    t, f0, f1 = n / np.longdouble(fs), np.longdouble(b.f0), np.longdouble(b.f1)
    linear = b.kind == "linear" or b.f0 == b.f1
    c = 0 if linear else np.log(f1 / f0) / np.longdouble(b.seconds)
    turns = (
        f0 * t + (f1 - f0) / (2 * np.longdouble(b.seconds)) * t * t
        if linear
        else f0 * np.expm1(c * t) / c
    )
    want = np.sin(2 * np.longdouble(np.pi) * (turns - np.floor(turns))).astype(float)
    return np.where((n >= 0) & (n < b.seconds * fs), want, 0), (
        1e-14 + 4e-19 * np.abs(turns.astype(float)) if linear else 1e-8
    )


@law("Scanned", since=0)
def _scanned(b, fs, x, y):
    from ..design.filters import HALF, resampled  # as of ``Playback``

    # samples beside the table that are resampled with it
    more = 1 + b.loop * math.ceil(HALF * max(1.0, b.rate / fs))
    table = resampled(
        np.pad(b.samples, more, "wrap" if b.loop else "constant"),
        b.rate,
        8 * b.rate,
        fs,
        "playback",
    )
    table, n = table[8 * more - 2 :], 8 * b.samples.size  # two samples before its first
    u = x[0] * (8 * b.rate)
    k = np.floor(u)
    inside = b.loop | ((k >= 0) & (k < n))
    j = np.arange(6.0)
    # Lagrange's
    weights = [np.prod([(u - k + 2 - m) / (i - m) for m in j if m != i], axis=0) for i in j]
    first = np.where(inside, k % n, 0).astype(int)
    want = np.sum([w * table[first + i] for i, w in enumerate(weights)], axis=0)
    return near(np.where(inside, want, 0), 1e-9)


@law("Playback", since=0)
def _playback(b, fs, x, y):
    from ..design.filters import resampled  # how it keeps waves, tests/blocks/test_events.py says

    n, table = sample_of(x[0], fs), resampled(b.samples, b.rate, fs)
    inside = (n >= 0) & (b.loop | (n < table.size))
    return near(np.where(inside, table[n % table.size], 0), 1e-13)


# Events -------------------------------------------------------------------------------
@law("Edge", since=1)
def _edge(b, fs, x, y):
    above = x[0] > x[1]
    return np.diff(above, prepend=above[0]) & (above == b.up), 0.0


@law("Crossing", since=2)
def _crossing(b, fs, x, y):
    u, half = x[0] / b.spacing, b.hysteresis / b.spacing / 2

    def passed(cell: int) -> Row:
        want, carry = np.zeros(u.size), 0.0
        for n in range(1, u.size):
            to = min(max(cell, math.floor(u[n] - half)), math.floor(u[n] + half))
            moved, want[n] = to - cell, carry
            # the middle of the lines that it has passed
            line = (cell + to + 1) / 2 + math.copysign(half, moved)
            part = (line - u[n - 1]) / (u[n] - u[n - 1]) if moved and u[n] != u[n - 1] else 0.0
            carry = moved * min(max(part, 0.0), 1.0) * b.split
            want[n] += moved - carry
            cell = to
        return want

    want = passed(math.floor(u[0] - half * (not x.rest)))
    tol = 1e-9 * max(1.0, float(np.abs(want).max())) if b.split else 0.0
    return want, tol if x.rest else np.where(want == passed(math.floor(u[0] + half)), tol, np.inf)


@law("Count", since=1)
def _count(b, fs, x, y):
    return near(np.cumsum(x[0]) + (0.0 if x.rest else y[0] - x[0][0]), 1e-15 * x[0].size)


@law("SampleAndHold", since=1)
def _sample_and_hold(b, fs, x, y):
    last = np.maximum.accumulate(np.where(x[1] != 0, np.arange(y.size), -1))
    return np.where(last >= 0, x[0][last], 0 if x.rest else y[0]), 0.0


@law("OnceWithin", since=1)
def _once_within(b, fs, x, y):
    want, wait = np.zeros(y.size), max(1, round(min(b.refractory * fs, 2.0**62)))
    # the first that was let through is known to be
    free = 0 if x.rest else int(np.argmax(np.r_[y != 0, True]))
    for n in np.flatnonzero(x[0]):
        if n >= free:
            want[n], free = x[0][n], n + wait
    return want, 0.0


@law("Hysteresis", "Loading", since=1)
def _gate(b, fs, x, y):
    on, off = b.on, b.off
    if on is None or off is None:
        on, off = laws.gate_thresholds(b.resolution, b.v.cutoff, fs)
    n, begins = np.arange(y.size), 0 if x.rest else y[0]
    opened = np.maximum.accumulate(np.where((x[0] > on) | (begins > 0) & (n == 0), n, -1))
    return opened > np.maximum.accumulate(np.where(x[0] > off, -1, n)), 0.0


@law("PulseTrain", since=0)
def _pulse_train(b, fs, x, y):
    phase, step = phases(x, fs)
    n, after = np.arange(y.size), phase + step
    wraps = after < phase
    jitter = np.clip((0.5 + np.nan_to_num(x[1])) * 2.0**64, 0.0, 2.0**64 - 2.0**11).astype(
        np.uint64
    )
    # where this period began; at first that of the period before
    last = np.maximum.accumulate(np.where(wraps, n, -1))
    first, known = (
        (jitter[0], isinstance(b.jitter, Const)) if x.past >> 64 else (np.uint64(1 << 63), True)
    )
    now = np.where(last < 0, first, jitter[last])
    mark = np.r_[first, now[:-1]]
    want = ((phase <= mark) & (wraps | (mark < after))) + 1.0 * (wraps & (now < after))
    return want, np.where(np.r_[known, (last[:-1] >= 0) | known], 0.0, np.inf)


@law("Burst", since=lambda b, fs, x: round(b.duration * fs))
def _burst(b, fs, x, y):
    n, want = round(b.duration * fs), np.zeros(y.size)
    t, ramp = np.arange(n) + 0.5, min(max(0.5, b.ramp * fs), n / 2)
    shape = np.sin(np.pi / 2 * np.minimum(np.minimum(t, n - t) / ramp, 1)) ** 2
    for at in np.flatnonzero(x[0]):
        part = want[at : at + n]
        part[:] = x[0][at] * shape[: part.size]
        want[at + n :] = 0
    return near(want, 1e-13)


@law("Envelope", since=1)
def _envelope(b, fs, x, y):
    want, last, stage = np.zeros(y.size), 0.0 if x.rest else y[0], "release"
    # in which stage it is, it says where it is released
    tol = np.where(x.rest | (np.cumsum(x[0] <= 0) > 0), 1e-9, np.inf)
    level = {"attack": 1 / (1 - math.exp(-1.5)), "decay": b.sustain, "release": 0.0}
    keep = {"attack": b.attack / 1.5, "decay": b.decay, "release": b.release}
    keep = {name: math.exp(-1 / (t * fs)) if t * fs > 1e-3 else 0.0 for name, t in keep.items()}
    for n, gate in enumerate(x[0] > 0):
        last = last if x.rest else y[max(n - 1, 0)]
        stage = "release" if not gate else "attack" if stage == "release" else stage
        last = level[stage] + keep[stage] * (last - level[stage])
        if stage == "attack" and last >= 1 - 1e-9:
            last, stage = 1.0, "decay"
        want[n] = last
    return want, tol


@law("Ring", since=lambda b, fs, x: FADED * max(1.0, fs * float(x[2].max())))
def _ring(b, fs, x, y):
    pole = np.exp(-1 / (fs * np.maximum(x[2], 1 / fs)) + 2j * np.pi * np.clip(x[1] / fs, 0, 0.5))
    q, want = 0j, np.zeros(y.size, complex)
    for n, (p, event) in enumerate(zip(pole.tolist(), x[0].tolist(), strict=True)):
        want[n] = q = p * q + event
    return near(want.imag if b.onset == "sine" else want.real, 1e-10)


@law("Vibration", since=0)
def _vibration(b, fs, x, y):
    want = soft.motor(x[0], fs, b.factor)
    # where it is off, nothing is left
    return want, np.where(x.rest | (want > 0) | (np.cumsum(y == 0) > 0), 0.0, np.inf)


# Waves --------------------------------------------------------------------------------
def turning(freq: Row, fs: float) -> Row:
    """Return turns that each sample takes, in 2^-64, to the nearest.

    The remainders of two divisions are exact.
    """
    f, turns = np.clip(np.nan_to_num(freq), 0, fs / 2), np.zeros(freq.size, np.uint64)
    for _ in range(2):
        rest = np.fmod(2.0**32 * f, fs)
        turns = (turns << 32) + np.rint((2.0**32 * f - rest) / fs).astype(np.uint64)
        f = rest
    return turns + (2 * f >= fs)


SUMS = {"Carrier": turning, "Oscillator": turning, "PulseTrain": turning}
"""What is added up of a block's first row before a stretch that begins later."""


def phases(x: Rows, fs: float) -> tuple[Row, Row]:
    """Return the phase at each sample, and what that sample adds to it.

    It counts from sample 0 on.
    """
    step = np.where(np.arange(x.at, x.at + x[0].size) < 0, np.uint64(0), turning(x[0], fs))
    return np.cumsum(step) - step + np.uint64(x.past % 2**64), step


def turns_of(x: Rows, fs: float, phase: float) -> tuple[Row, Row]:
    """Return turns at each sample from a phase in rad on, and those per sample."""
    t = phases(x, fs)[0].astype(np.longdouble) / 2.0**64 + phase / (2 * np.longdouble(math.pi))
    return t - np.floor(t), turning(x[0], fs).astype(np.longdouble) / 2.0**64


@law("Carrier", since=0)
def _carrier(b, fs, x, y):
    t, step = turns_of(x, fs, b.phase)
    want = laws.carried(t, step, b.rectify)
    return np.where(x[1] > 0, want, 0), 1e-11


WAVES: dict[str, tuple[Callable, Callable]] = {  # of turns 0 .. 1: the wave, its integral
    "triangle": (
        lambda u, d: 1 - 4 * np.abs((u + 0.25) % 1 - 0.5),
        lambda u, d: np.where((v := (u + 0.25) % 1) < 0.5, 2 * v * v - v, 3 * v - 2 * v * v - 1),
    ),
    "sawtooth": (lambda u, d: 2 * (u % 1) - 1, lambda u, d: (u % 1) ** 2 - u % 1),
    "square": (
        lambda u, d: np.where(u % 1 < d, 1, -1),
        lambda u, d: 2 * (np.floor(u) * d + np.minimum(u % 1, d)) - u,
    ),
    "pulse": (lambda u, d: u % 1 < d, lambda u, d: np.floor(u) * d + np.minimum(u % 1, d)),
}


@law("Oscillator", since=0)
def _oscillator(b, fs, x, y):
    t, step = turns_of(x, fs, b.phase)
    wave, integral = WAVES[b.waveform]
    d = np.clip(x[1], 0, 1).astype(np.longdouble)
    still = step == 0
    mean = (integral(t + step / 2, d) - integral(t - step / 2, d)) / np.where(still, 1, step)
    return np.where(still, wave(t, d), mean).astype(float), (
        1e-11 + 1e-18 / np.where(still, 1, step)
    ).astype(float)


# Places -------------------------------------------------------------------------------
@law("LinearBump", "SineBump", since=1)
def _bump(b, fs, x, y):
    last = before(x[0], x[2]) if b.sampling == "area" else x[0]
    want, lost = laws.bump_envelope(last, x[0], b.waveform, np.clip(x[1], 1e-6, 1))
    return np.where(x[2] > 0, want, 0), 1e-13 + lost


@law("TableBump", since=1)
def _table_bump(b, fs, x, y):
    u, d, contact = x[0].astype(np.longdouble), np.clip(x[1], 1e-6, 1), x[2]
    v = np.array(b.values)
    knots, sums = (
        np.linspace(0, 1, v.size),
        np.r_[0.0, np.cumsum((v[1:] + v[:-1]) / 2)] / (v.size - 1),
    )

    def integral(u: Row) -> Row:
        z = np.minimum((u - np.floor(u)) / d, 1)
        k = np.minimum((z * (v.size - 1)).astype(int), v.size - 2)
        r = z - knots[k]
        return d * (
            np.floor(u) * sums[-1] + sums[k] + r * (v[k] + r * (v[k + 1] - v[k]) * (v.size - 1) / 2)
        )

    last = before(u, contact) if b.sampling == "area" else u
    way = u - last
    z = (u - np.floor(u)) / d
    point = np.where(z < 1, np.interp(z.astype(float), knots, v), 0)
    still = np.abs(way) < 1e-9
    edge = still & (np.minimum(np.abs(z - 1), np.abs(u - np.rint(u))) < 1e-8)
    want = np.where(still, point, (integral(u) - integral(last)) / np.where(still, 1, way)).astype(
        float
    )
    size = max(float(np.abs(v).max()), 1e-300)
    return np.where(contact > 0, want, 0), np.where(edge, np.inf, 1e-7 * size / np.minimum(d, 1))


@law("Grating", since=1)
def _grating(b, fs, x, y):
    u, contact = x
    wavelength, depth, _ = b.parts.T
    tol = np.abs(depth) @ (1e-12 + 2.0**-44 * np.abs(u) / wavelength[:, None])
    return np.where(contact > 0, surfaces.gratings(before(u, contact), u, b.parts), 0), tol


@law("SpatialNoise", since=1)
def _spatial_noise(b, fs, x, y):
    u, contact = x
    return (
        np.where(contact > 0, surfaces.roughness(before(u, contact), u, b), 0),
        3e-11 + 2.0**-40 * np.abs(u) / b.shortest,
    )


@law("Midpoint", since=1)
def _midpoint(b, fs, x, y):
    return near(np.where(x[1] > 0, (before(x[0], x[1]) + x[0]) / 2, 0), 1e-15)


@law("PathLength", since=1)
def _path_length(b, fs, x, y):
    want = np.zeros(y.size)
    for k, s in enumerate(touched(x[1])):
        first = 0.0 if b.onset == "step" and k == 0 and x.rest else x[0][s.start]
        want[s] = np.cumsum(np.abs(np.diff(x[0][s], prepend=first))) + (
            0.0 if x.rest or s.start else y[0]
        )
    return near(want, 1e-15 * y.size)


@law("Detents", since=1)
def _detents(b, fs, x, y):
    size = np.abs(x[1]) * (1e-9 + 2.0**-44 * np.abs(x[0]) / b.spacing)
    return touch.detents(x[0], x[2], b.spacing, x[1]), size


@law("Wall", since=1)
def _wall(b, fs, x, y):
    place, k, damping, at, c, contact = x
    speed = (place - before(place, contact)) * fs
    grown = np.maximum(k, 0) * np.maximum(1 + np.maximum(c, 0) * speed, 0)
    return near(touch.wall(place, contact, fs, grown, np.maximum(damping, 0), at), 1e-9)


@law("Button", since=1)
def _button(b, fs, x, y):
    force, pressed = touch.button(
        x[0], x[2], x[1], b.drop, b.at, b.back, None if x.rest else y[1, 0]
    )
    return np.array([force, pressed]), np.array([[near(force, 1e-9)[1]], [0.0]])


# Friction -----------------------------------------------------------------------------
def forgotten(force: Callable[[float], Row], rest: bool) -> tuple[Row, Any]:
    """Return a force that begins at rest, or from where its past is forgotten.

    Where it began before, both ends of what is possible must lead to the same.
    """
    if rest:
        return near(force(0.0), 1e-13)  # of which (1 - exp(-a))/a loses 4e-14 where a is 0.01
    want, tol = near(force(1e200))
    return want, np.where(np.abs(want - force(-1e200)) < 0.1 * tol, tol, np.inf)


@law("Coulomb", since=1)
def _coulomb(b, fs, x, y):
    return forgotten(lambda z: touch.dragged(x[0], x[2], x[3], x[1], touch.coulomb, z), x.rest)


def _exponential(z: float, c: float, over: float, a: float) -> tuple[float, float]:
    """Of dz = (c - z)/over da along a way a: the end and the mean."""
    if over <= 0 or a == 0:
        return (z, z) if a == 0 else (c, c)
    return c - (c - z) * math.exp(-a / over), c + (c - z) * math.expm1(-a / over) * over / a


@law("Dahl", since=1)
def _dahl(b, fs, x, y):
    return forgotten(
        lambda z: touch.dragged(
            x[0], x[2], x[3], x[1], lambda n, z, a, c: _exponential(z, c, c, a), z
        ),
        x.rest,
    )


@law("ElastoPlastic", since=1)
def _elasto_plastic(b, fs, x, y):
    def slide(n: int, z: float, a: float, c: float) -> tuple[float, float]:
        free = min(a, max(b.elastic * c - z, 0.0))
        rest = a - free
        end, mean = _exponential(z + free, c, c - b.elastic * c, rest)
        return end, (free * (z + free / 2) + rest * mean) / a if a else z

    return forgotten(lambda z: touch.dragged(x[0], x[2], x[3], x[1], slide, z), x.rest)


@law("LuGre", since=1)
def _lugre(b, fs, x, y):
    place, limit, static, k, contact = x
    moved = np.zeros(y.size)

    def slide(n: int, z: float, a: float, c: float) -> tuple[float, float]:
        g = min(max(limit[n], 0.0) / k[n], 1e150) if k[n] > 0 else 0.0
        end, mean = _exponential(z, g, g, a) if g > 0 else (0.0, 0.0)
        moved[n] = end - z
        return end, mean

    way = np.where(contact > 0, place - before(place, contact), 0)

    def force(z: float) -> Row:
        return touch.dragged(place, k, contact, static, slide, z) + fs * (
            b.damping * np.where(way < 0, -1, 1) * moved + b.viscosity * way
        )

    return forgotten(force, x.rest)


@law("Stribeck", since=1)
def _stribeck(b, fs, x, y):
    v = (x[0] - before(x[0], x[2])) * fs / b.speed
    return near(
        np.where(x[2] > 0, x[1] * (1 + b.rise * np.exp(-(np.minimum(np.abs(v), 1e150) ** 2))), 0)
    )


@law("StickSlip", since=1)
def _stick_slip(b, fs, x, y):
    want, begin = touch.stick_slip(x[0], x[3], x[2], x[1], b.left, y, x.rest)
    tol = touch.TOL * max(float(np.abs(want).max()), touch.LEAST)
    return want, np.where(np.arange(y.size) < begin, np.inf, tol)


# Tables -------------------------------------------------------------------------------
@law("Lut", "Polynomial", since=0)
def _table(b, fs, x, y):
    from scipy import interpolate

    kind = getattr(b, "kind", "polynomial")
    low, high = b.knots.min(), b.knots.max()
    at = np.clip(x[0], low, high)
    if kind == "linear":
        want = np.interp(at, b.knots, b.values)
    elif kind == "polynomial":  # Lagrange's formula
        k, u = b.knots.astype(np.longdouble), at.astype(np.longdouble)
        parts = [
            np.prod([(u - k[j]) / (k[i] - k[j]) for j in range(k.size) if j != i], axis=0)
            for i in range(k.size)
        ]
        want = (b.values @ np.array(parts)).astype(float)
    else:
        want = {"pchip": interpolate.PchipInterpolator, "cubic": interpolate.CubicSpline}[kind](
            b.knots, b.values
        )(at)
    want = np.where(
        (at == x[0]) | (b.outside == "hold"), want, 0.0 if b.outside == "zero" else np.nan
    )
    return want, 1e-13 * (np.abs(b.values).max() / 3 + np.abs(want)) + 1e-300


@law("LinearGrid", "CubicGrid", since=0)
def _grid(b, fs, x, y):
    from scipy.interpolate import RectBivariateSpline

    (n, m), (dx, dy), (x0, y0) = b.table.shape, b.spacing, b.origin
    i, j = x0 + dx * np.arange(n), y0 + dy * np.arange(m)
    degree = 1 if type(b).__name__ == "LinearGrid" else 3
    f = RectBivariateSpline(i, j, b.table, kx=min(degree, n - 1), ky=min(degree, m - 1), s=0)
    px, py = np.clip(x[0], i[0], i[-1]), np.clip(x[1], j[0], j[-1])
    if degree == 3:
        slopes = [f.ev(px, py, 1, 0), f.ev(px, py, 0, 1)]
    else:  # straight within a piece
        u, v = (
            np.minimum(np.floor((p - s[0]) / d), s.size - 2)
            for p, s, d in ((px, i, dx), (py, j, dy))
        )
        slopes = [
            (f.ev(i[0] + (u + 1) * dx, py) - f.ev(i[0] + u * dx, py)) / dx,
            (f.ev(px, j[0] + (v + 1) * dy) - f.ev(px, j[0] + v * dy)) / dy,
        ]
    want = np.array([f.ev(px, py), *slopes])
    want[1, (x[0] < i[0]) | (x[0] > i[-1])] = 0
    want[2, (x[1] < j[0]) | (x[1] > j[-1])] = 0
    size = max(float(np.abs(b.table).max()), 1e-300)
    u, v = (x[0] - x0) / dx, (x[1] - y0) / dy
    # slopes of the two sides differ
    joint = np.minimum(np.abs(u - np.rint(u)), np.abs(v - np.rint(v))) < TIE
    tol = np.full((3, y.shape[1]), 1e-9 * size)
    tol[1:] /= np.array([[dx], [dy]])
    tol[1:, joint] = np.inf
    return want, tol


@law("Accuracy", since=0)
def _accuracy(b, fs, x, y):
    # what they are worth, tests/blocks/test_fractional.py says
    from ..blocks.fractional import bounds_of_orders

    knots, bounds = bounds_of_orders(b.tol, b.horizon * fs)
    return near(np.interp(x[0], knots, (1.02 + 2 * b.tol) * bounds))


@law("Guard", since=0)
def _guard(b, fs, x, y):
    return x[0], 0.0  # rows end where one is not finite


@law("Shape", since=0)
def _shape(b, fs, x, y):
    from numpy.polynomial import legendre
    from scipy.interpolate import CubicHermiteSpline

    places = np.clip(2 * x[0] / b.length - 1, -1, 1), np.clip(2 * x[1] / b.width - 1, -1, 1)
    knots, parts = np.linspace(-1, 1, 257), []
    for at, terms in zip(places, b.c.shape, strict=True):
        slopes = legendre.legval(knots, legendre.legder(np.eye(terms)))
        parts.append(CubicHermiteSpline(knots, legendre.legvander(knots, terms - 1), slopes.T)(at))
    whole, size = legendre.legval2d(*places, b.c), float(np.abs(b.c).sum())
    want = np.einsum("ki,ij,kj->k", parts[0], b.c, parts[1])
    steep = max(b.c.shape) ** 2  # of the last term, by which a rounding of the place counts
    return np.where(np.abs(want - whole) < 1e-6 * size, want, whole), (1e-13 + ULP * steep) * size


# Filters of live numbers --------------------------------------------------------------
def _svf_rings(b: Any, fs: float, x: Rows) -> float:
    slowest = float(np.minimum(x[1], fs / 2 - x[1]).min())
    wide = max(0.5, float(x[2].max()), 1 / max(float(x[2].min()), 1e-3))
    return FADED * fs * wide / (math.pi * slowest) if slowest > 0 else math.inf


@law("Svf", since=_svf_rings)
def _svf(b, fs, x, y):
    high, band, low = {
        "lowpass": (0, 0, 1),
        "bandpass": (0, 1, 0),
        "highpass": (1, 0, 0),
        "notch": (1, 0, 1),
    }[b.mode]
    g = np.tan(np.pi * np.clip(x[1] / fs, 0, 0.5)).tolist()
    k = (1 / np.maximum(x[2], 1e-3)).tolist()
    want, s1, s2 = np.zeros(y.size), 0.0, 0.0
    for n, v in enumerate(x[0].tolist()):
        bp = (g[n] * (v - s2) + s1) / (1 + g[n] * (g[n] + k[n]))
        lp = s2 + g[n] * bp
        hp = v - k[n] * bp - lp
        s1, s2 = 2 * bp - s1, 2 * lp - s2
        want[n] = high * hp + band * k[n] * bp + low * lp
    return near(want, 1e-9)


@law("Texture", since=lambda b, fs, x: round(fs / b.rate) * (b.lsf.shape[1] + b.ma.shape[1] + 14))
def _texture(b, fs, x, y):
    every, want = round(fs / b.rate), y.copy()
    # the model's own samples, from where it began
    first = 0 if x.rest else -(x.at + lead(fs) * b.autonomous) % every
    noise, speed, force = (row[first:] for row in x)
    want[first:] = laws.texture(b.model, speed, force, noise, every, None if x.rest else y[first:])
    # of which the roundings are, also where it rests
    most = float(np.max(b.model.gain * np.sqrt(b.model.variance)))
    return want, 1e-7 * max(float(np.abs(want).max(initial=0.0)), most)


# Orders -------------------------------------------------------------------------------
POINTS = 64  # at which a sum over the whole history is made


@law("Springpot", since=1)
def _springpot(b, fs, x, y):
    want, tol = np.zeros(y.size), np.zeros(y.size)
    for k, s in enumerate(touched(x[1])):
        step = b.onset == "step" and k == 0 and x.rest
        way = np.r_[0.0, x[0][s]] if step else x[0][s]
        force, size = laws.springpot_convolution(way, fs, b.scheme, b.order)
        want[s], tol[s] = force[int(step) :], (b.tol + 1e-12) * size.max() + 1e-300
        # of a contact that began before nothing is said
        tol[s] = np.inf if not x.rest and s.start == 0 else tol[s]
        tol[s.start + int(b.horizon * fs) : s.stop] = np.inf  # beyond it nothing is said
    return want, tol


@law("SpringpotLive", since=1)
def _springpot_live(b, fs, x, y):
    want, tol = np.where(x[2] > 0, y, 0), np.full(y.size, 1e-300)
    for k, s in enumerate(touched(x[2])):
        if not x.rest and s.start == 0:
            want[s] = y[s]
            continue
        step = int(b.onset == "step" and k == 0 and x.rest)
        way, order = np.r_[np.zeros(step), x[0][s]], np.r_[np.zeros(step), x[1][s]]
        at = np.unique(np.linspace(step, way.size - 1, POINTS).astype(int))
        at = at[(order[at] >= 0) & (order[at] <= 1)]
        force, size = laws.springpot_sum(way, fs, b.scheme, order, at)
        want[s.start + at - step], tol[s.start + at - step] = (
            force,
            (b.tol + 1e-12) * np.maximum(size, 1e-300),
        )
    return want, tol


@law("Downsampled", since=1)
def _downsampled(b, fs, x, y):
    want, tol = np.where(x[1] > 0, y, 0), np.full(y.size, 1e-300)
    for c, s in enumerate(touched(x[1])):
        if not x.rest and s.start == 0:
            want[s] = y[s]
            continue
        way = x[0][s] - (0.0 if b.onset == "step" and c == 0 and x.rest else x[0][s.start])
        for k in np.unique(np.linspace(0, way.size - 1, POINTS).astype(int)):
            m = max(1, math.ceil(k / 100))
            past = way[k::-m].astype(np.longdouble)
            j = np.arange(1, past.size, dtype=np.longdouble)
            weights = np.cumprod(np.r_[np.longdouble(1), (j - 1 - b.order) / j])
            scale = (np.longdouble(fs) / m) ** np.longdouble(b.order)
            if k < math.ceil(b.horizon * fs):
                want[s.start + k] = weights @ past * scale
                tol[s.start + k] = 1e-12 * np.abs(weights) @ np.abs(past) * scale + 1e-300
    return want, tol


@law("Velocity", since=lambda b, fs, x: 1.3 * FADED * fs / (2 * math.pi * b.cutoff) + 1)
def _velocity(b, fs, x, y):
    # of digits, by two poles so near to 1
    lost = 2.0**-50 / math.expm1(-2 * math.pi * b.cutoff / fs) ** 2
    return near(
        laws.squeeze_finger(x[0], 0 * x[0], x[1], fs, 0.0, 0.0, b.cutoff, 1.0, 0.0).v, 1e-11 + lost
    )


# Soft objects -------------------------------------------------------------------------
@law("Cursor", since=1)
def _cursor(b, fs, x, y):
    S, on, hand = soft.levels(*soft.table_of(b)), x[2] > 0, np.array(x[:2])
    last = np.c_[np.zeros((2, 1)), y[:, :-1]]
    way = np.diff(hand, prepend=0.0)
    first = soft.starts(on)
    ratio = soft.speed_ratio(S(*((last + y) / 2)))
    want = np.where(first, hand, np.where(on, last + ratio * way, last))
    scale = max(float(np.abs(way[:, on & ~first]).max(initial=0.0)), 1e-6)
    table, width, height = soft.table_of(b)
    piece = min(v / max(n - 1, 1) for v, n in zip((height, width), table.shape, strict=True))
    far = np.hypot(*way)  # beyond a piece of the map five steps of Newton's method may be too few
    tol = 1e-12 * scale + 8 * ULP * float(np.abs(y).max())  # otherwise they reach the last digits
    return want, np.where(
        on & ((far > piece) | (far * soft.steepest(S, last, way) > 0.5)), np.inf, tol
    )


@law("CursorFrames", since=1)
def _cursor_frames(b, fs, x, y):
    S = soft.levels(*soft.table_of(b))
    want = soft.by_frames(S, y, np.array(x[:2]), x[2] > 0, b.frame * fs, (b.slowest, b.fastest))
    return want, begun(x, near(want, 1e-9)[1])


@law("DelayAvatar", "FrameAvatar", since=1)
def _avatar(b, fs, x, y):
    if type(b).__name__ == "DelayAvatar":
        places, due, lag = soft.delayed(x[:3], y[3], x[3] > 0, fs, b)
    else:
        places, due, lag = soft.delayed_by_frames(x[:3], y[3], x[3] > 0, fs, b, y[2])
    size = max(float(np.abs(places).max(initial=0.0)), 1e-300)
    return np.array([*places, lag, due]), begun(x, 1e-9 * np.array([[size], [size], [1.0], [1.0]]))
