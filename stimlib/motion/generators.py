"""Motion generators: positions as pure functions of time.

A generator is called with times in seconds and returns positions in metres. It has no
state, so parts of a motion can be computed in any order, and every position has the
same bits on every machine, however the time axis is divided. Only plus, minus, times,
divide, fmod, rint, floor, comparisons and integer arithmetic are used, which round the
same way everywhere. numpy's own sin and cos are not used, because their last bit may
depend on the processor and on the length of the array.

The classes have lower-case names because users call them like functions, and because
the repr of a motion is then the call that makes it: ``text.parse_motion(repr(m)) ==
m``. A sidecar or a command line contains a motion as this one line.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from math import isfinite, nan, pi, ulp
from typing import Annotated, Any, get_args, get_origin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import BadValue, shortened

Array = NDArray[np.float64]


def _float(value: Any, holds: Callable[[float], bool] = isfinite) -> float | None:
    try:
        number = nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return number if isfinite(number) and holds(number) else None


def _int(value: Any, low: int, high: int) -> int | None:
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return int(value) if whole and low <= value <= high else None


# What a field takes: its type, the same in words, and a function that returns it as a
# plain value, or None if it is not one
Number = Annotated[float, "a finite number", _float]
Positive = Annotated[float, "a finite number above 0", lambda v: _float(v, lambda x: x > 0)]
NotNegative = Annotated[float, "a finite number, 0 or above", lambda v: _float(v, lambda x: x >= 0)]
Count = Annotated[int, "a whole number from 0 to 2**53", lambda v: _int(v, 0, 2**53)]
Repeats = Annotated[int, "a whole number from 1 to 2**53", lambda v: _int(v, 1, 2**53)]
Seed = Annotated[int, "a whole number from 0 to 2**64 - 1", lambda v: _int(v, 0, 2**64 - 1)]
Flag = Annotated[
    bool, "True or False", lambda v: bool(v) if isinstance(v, bool | np.bool_) else None
]
Function = Annotated[
    Callable[[Array], Array],
    "a motion, such as minimum_jerk()",
    lambda v: v if callable(v) else None,
]


class Motion:
    """A position in metres as a function of the time in seconds.

    This is the base class of all generators. A generator defines ``_position(t)``,
    element by element, for a one-dimensional float64 array, and annotates its fields
    with their permitted types and ranges.

    Raises
    ------
    BadValue
        At construction, if a field has an invalid value, such as a number that is not
        finite or out of range.
    """

    def __call__(self, t: ArrayLike) -> Array:
        """Return the position at the times t.

        Parameters
        ----------
        t : array_like, any shape, s
            Finite times.

        Returns
        -------
        ndarray of float64, shape of t, m

        Examples
        --------
        >>> minimum_jerk(depth=0.02)([0.0, 0.15, 0.3]).tolist()
        [0.0, 0.01, 0.02]
        """
        time = np.asarray(t, dtype=np.float64)
        return self._position(time.reshape(-1)).reshape(time.shape)

    def _position(self, t: Array) -> Array:
        raise NotImplementedError

    def __post_init__(self) -> None:
        """Convert each field to the type of its annotation.

        Numpy scalars become plain numbers, because their repr differs.
        """
        for f in fields(self):  # type: ignore[arg-type]
            given = getattr(self, f.name)
            if given is None and f.default is None:
                continue
            _, wanted, read = get_args(
                next(a for a in (f.type, *get_args(f.type)) if get_origin(a) is Annotated)
            )
            if (value := read(given)) is None:
                raise BadValue(
                    f"{type(self).__name__}: {f.name} must be {wanted}, got {shortened(given)}"
                )
            object.__setattr__(self, f.name, value)


@dataclass(frozen=True)
class minimum_jerk(Motion):
    """Repeated squeezes: a minimum-jerk rise, a hold, a minimum-jerk fall and a rest.

    The rise is ``start + depth (10 s^3 - 15 s^4 + 6 s^5)`` with s from 0 to 1 over
    ``rise`` seconds; the fall is its mirror image. The period is rise + hold + fall +
    rest. The position is ``start`` before time 0 and after the last squeeze.

    Parameters
    ----------
    depth : float, m
        Distance of the squeeze; negative for an opening movement.
    start : float, m
        Position at rest.
    rise, fall : float, s
        Durations of the two movements, above 0.
    hold, rest : float, s
        Durations at ``start + depth`` and at ``start``, 0 or above.
    repeats : int or None
        Number of squeezes; None for no end.

    References
    ----------
    T. Flash and N. Hogan, "The coordination of arm movements", J. Neurosci. 5 (1985),
    the point-to-point solution.

    Examples
    --------
    >>> squeeze = minimum_jerk(depth=0.02, rise=0.3, hold=0.2, fall=0.3, rest=0.4)
    >>> squeeze([0.0, 0.15, 0.4, 0.65, 1.0, 1.4]).round(4).tolist()
    [0.0, 0.01, 0.02, 0.01, 0.0, 0.0158]
    """

    depth: Number = 0.02
    start: Number = 0.0
    rise: Positive = 0.3
    hold: NotNegative = 0.2
    fall: Positive = 0.3
    rest: NotNegative = 0.4
    repeats: Repeats | None = None

    def _position(self, t: Array) -> Array:
        period = self.rise + self.hold + self.fall + self.rest
        u = np.maximum(t, 0.0)
        if self.repeats is not None:
            u = np.where(t < self.repeats * period, u, 0.0)
        u = _fmod(u, period)
        s = self.fall - (u - (self.rise + self.hold))
        s /= self.fall  # the fall: 1 or more before it begins, when the rise is 1 or less
        np.clip(np.minimum(s, u / self.rise, out=s), 0.0, 1.0, out=s)
        return self.start + self.depth * (s * s * s * (10.0 + s * (6.0 * s - 15.0)))


@dataclass(frozen=True)
class sinusoid(Motion):
    """A sinusoid, ``mean + amplitude sin(2 pi freq t + phase)``.

    The phase is reduced in turns, not in radians, so a motion of several hours has no
    drift, and sin is a polynomial of fixed order (error below 3e-16 of the amplitude)
    with the same bits on every machine.

    Parameters
    ----------
    amplitude : float, m
        Half the distance between the two ends.
    freq : float, Hz
        Frequency, above 0.
    mean : float, m
        Middle of the motion.
    phase : float, rad
        Phase at time 0.

    Examples
    --------
    >>> sinusoid(0.01, 1.0, mean=0.02)([0.0, 0.25, 0.5, 3600.75]).tolist()
    [0.02, 0.03, 0.02, 0.01]
    """

    amplitude: Number
    freq: Positive
    mean: Number = 0.0
    phase: Number = 0.0

    def _position(self, t: Array) -> Array:
        return self.mean + self.amplitude * _sin_turns(self.freq * t + self.phase / (2 * pi))


@dataclass(frozen=True)
class ramp_and_hold(Motion):
    """A ramp at constant speed from 0 to ``depth``, a hold and an optional return.

    The return is a ramp at constant speed as well.

    Parameters
    ----------
    depth : float, m
        Position of the hold.
    rise : float, s
        Duration of the ramp, above 0.
    start_time : float, s
        When the ramp starts, 0 or above.
    hold : float or None, s
        Duration of the hold; None for no end.
    fall : float or None, s
        Duration of the ramp back to 0; required if ``hold`` is given, and otherwise not
        allowed.

    Raises
    ------
    BadValue
        As for all motions, and if only one of hold and fall is given.

    Examples
    --------
    >>> ramp_and_hold(0.01, rise=0.5, start_time=1.0, hold=2.0, fall=0.25)(
    ...     [0.5, 1.25, 3.0, 3.625, 4.0]
    ... ).tolist()
    [0.0, 0.005, 0.01, 0.005, 0.0]
    """

    depth: Number
    rise: Positive
    start_time: NotNegative = 0.0
    hold: NotNegative | None = None
    fall: Positive | None = None

    def __post_init__(self) -> None:
        if (self.hold is None) != (self.fall is None):
            raise BadValue("ramp_and_hold: give both hold and fall, or neither to hold for ever")
        super().__post_init__()

    def _position(self, t: Array) -> Array:
        u = t - self.start_time
        s = np.minimum(np.maximum(u / self.rise, 0.0), 1.0)
        if self.hold is not None and self.fall is not None:
            falling = u - (self.rise + self.hold)
            s = np.minimum(s, np.maximum((self.fall - falling) / self.fall, 0.0))
        return self.depth * s


@dataclass(frozen=True)
class constant_speed(Motion):
    """Strokes at constant speed, once or back and forth.

    Back and forth, the position is an endless triangle wave between ``start`` and
    ``start + length``; otherwise it is one stroke, after which it stays at the far end.
    The position is ``start`` before time 0.

    Parameters
    ----------
    speed : float, m/s
        Speed, above 0.
    length : float, m
        Length of a stroke, above 0.
    start : float, m
        Where the first stroke starts.
    back_and_forth : bool
        Whether strokes are repeated in both directions.

    Examples
    --------
    >>> constant_speed(0.1, 0.05)([0.0, 0.25, 0.5, 0.75, 1.0]).round(6).tolist()
    [0.0, 0.025, 0.05, 0.025, 0.0]
    >>> constant_speed(0.1, 0.05, back_and_forth=False)([0.25, 0.5, 0.75]).tolist()
    [0.025, 0.05, 0.05]
    """

    speed: Positive
    length: Positive
    start: Number = 0.0
    back_and_forth: Flag = True

    def _position(self, t: Array) -> Array:
        way = self.speed * np.maximum(t, 0.0)
        if not self.back_and_forth:
            return self.start + np.minimum(way, self.length)
        way = _fmod(way, 2 * self.length)
        return self.start + np.minimum(way, 2 * self.length - way)


@dataclass(frozen=True)
class staircase_hold(Motion):
    """A staircase of positions, each held for a time.

    The position begins at ``start`` and moves by one ``step`` after each ``dwell``,
    ``n_steps`` times. If the dwell is a whole number of samples, the position changes
    on exactly that sample. The last position is held without end.

    Parameters
    ----------
    step : float, m
        Height of a step; negative for a descending staircase.
    n_steps : int
        Number of steps, 0 or above; there are n_steps + 1 positions.
    dwell : float, s
        Duration of each position but the last, above 0.
    start : float, m
        First position.

    Examples
    --------
    >>> staircase_hold(0.001, n_steps=2, dwell=0.1)([0.0, 0.1, 0.15, 0.2, 0.3]).tolist()
    [0.0, 0.001, 0.001, 0.002, 0.002]
    """

    step: Number
    n_steps: Count
    dwell: Positive
    start: Number = 0.0

    def _position(self, t: Array) -> Array:
        level = _floor(t / self.dwell)
        return self.start + self.step * np.minimum(np.maximum(level, 0.0), float(self.n_steps))


@dataclass(frozen=True)
class quantised(Motion):
    """A motion as an encoder reports it, rounded to whole codes (half to even).

    Parameters
    ----------
    motion : Motion
        The true motion: any function of time that returns metres.
    resolution : float, m
        Distance between two codes, above 0; the squeeze device of the UGrip paper has 1
        um.

    Examples
    --------
    >>> quantised(constant_speed(0.1, 0.05), 0.01)([0.0, 0.12, 0.18, 0.26]).tolist()
    [0.0, 0.01, 0.02, 0.03]
    """

    motion: Function
    resolution: Positive

    def _position(self, t: Array) -> Array:
        return np.rint(self.motion(t) / self.resolution) * self.resolution


@dataclass(frozen=True)
class jittered(Motion):
    """A motion with the toggling of an encoder at the edge between two codes.

    ``amplitude_codes * resolution`` is added during about half of the intervals of
    1/rate seconds. Inside `quantised`, with an amplitude of one code, a held position
    toggles between two adjacent codes: ``quantised(jittered(m, q, rate, seed), q)``.
    The mean position increases by half the amplitude.

    Interval i = floor(t rate) adds the amplitude when the top bit of number i of a
    SplitMix64 generator is set. That generator is a function of the index, so any
    interval can be computed without the earlier ones. An interval of a whole number of
    samples starts on exactly that sample.

    Parameters
    ----------
    motion : Motion
        The motion without jitter: any function of time that returns metres.
    resolution : float, m
        Distance between two codes, above 0.
    rate : float, Hz
        Intervals per second, above 0.
    seed : int
        From 0 to 2**64 - 1; two motions with the same seed and rate toggle together.
    amplitude_codes : float
        Amplitude of the jitter in codes, 0 or above.

    References
    ----------
    G. Steele, D. Lea, C. Flood, "Fast splittable pseudorandom number generators",
    OOPSLA 2014, fig. 14.

    Examples
    --------
    >>> held = ramp_and_hold(0.01, rise=0.1)
    >>> quantised(jittered(held, 0.001, rate=10, seed=3), 0.001)(
    ...     [1.0, 1.1, 1.2, 1.3]
    ... ).tolist()
    [0.01, 0.01, 0.011, 0.01]
    """

    motion: Function
    resolution: Positive
    rate: Positive
    seed: Seed = 0
    amplitude_codes: NotNegative = 1.0

    def _position(self, t: Array) -> Array:
        index = _floor(t * self.rate).astype(np.int64).astype(np.uint64)
        # mixed first, so that neighbouring seeds are far apart in the generator's
        # period
        start = _splitmix64(np.array([self.seed], dtype=np.uint64), np.array([0], dtype=np.uint64))
        up = _splitmix64(start, index) >> np.uint64(63)
        return self.motion(t) + up * (self.amplitude_codes * self.resolution)


GENERATORS: dict[str, type[Motion]] = {
    c.__name__: c
    for c in (
        minimum_jerk,
        sinusoid,
        ramp_and_hold,
        constant_speed,
        staircase_hold,
        quantised,
        jittered,
    )
}


def _floor(q: Array) -> Array:
    """Return the floor of a rounded quotient q, as if q had no rounding error.

    A quotient q that should be a whole number may be up to 1.5 ulp too small, which
    would delay an edge by one sample.
    """
    return np.floor(q * (1 + 4 * ulp(1.0)))


def _fmod(x: Array, period: Any) -> Array:
    """Return np.fmod(x, period) for x >= 0: the same bits, in a quarter of its time.

    With n = floor(x / period) below 2**25, and the period as a sum of two numbers of 26
    and 27 bits, both products are exact, and so are the differences, which are whole
    numbers of the last bits of x or of the period. The quotient is rounded, so n may be
    one too large.
    """
    if x.size < 1024:
        return np.fmod(x, period)
    with np.errstate(over="ignore"):
        n = np.floor(x / period)
        mantissa, exponent = np.frexp(period)
        high = np.ldexp(np.floor(np.ldexp(mantissa, 26)), exponent - 26)
    if not n.max() < 2.0**25:  # nor with nan
        return np.fmod(x, period)
    r = x - n * high
    r -= n * (period - high)
    return r + np.where(r < 0, period, 0.0) if r.min() < 0 else r


# Taylor coefficients of sin(x)/x and cos(x) in x^2; on |x| <= pi/4 what is left out is
# below 3e-18
SIN = [
    1.0,
    -1 / 6,
    1 / 120,
    -1 / 5040,
    1 / 362880,
    -1 / 39916800,
    1 / 6227020800,
    -1 / 1307674368000,
]
COS = [
    1.0,
    -1 / 2,
    1 / 24,
    -1 / 720,
    1 / 40320,
    -1 / 3628800,
    1 / 479001600,
    -1 / 87178291200,
    1 / 20922789888000,
]


def _sin_turns(turns: Array) -> Array:
    """Return sin(2 pi turns), computed from + - * and rint only."""
    r = turns - np.rint(turns)  # exact, as is the next difference
    quarter = np.rint(4.0 * r)  # -2 .. 2
    x = 2 * pi * (r - 0.25 * quarter)
    x2 = x * x
    sin = x * _horner(SIN, x2)
    cos = _horner(COS, x2)
    value = np.where(np.abs(quarter) == 1.0, cos, sin)
    return np.where((quarter == -1.0) | (np.abs(quarter) == 2.0), -value, value)


def _horner(coefficients: list[float], x: Array) -> Array:
    y = np.full_like(x, coefficients[-1])
    for c in reversed(coefficients[:-1]):
        y = y * x + c
    return y


def _splitmix64(start: NDArray[np.uint64], index: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return number ``index`` of the SplitMix64 generator with the given state.

    Arithmetic is modulo 2**64.
    """
    z: NDArray[np.uint64] = start + (index + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
