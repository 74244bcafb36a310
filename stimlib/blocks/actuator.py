"""From a wanted force to what a motor is given: the skin's damper, limits, current."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.graph import NONE, ONE, Block, Map, as_block, same_unit
from ..core.maths import TINY, fma, where
from ..errors import Above0, BadValue, Count, public
from .friction import held, quantity, within
from .impedance import signal_in
from .tables import lut


class Geometry(NamedTuple):
    """Geometry factor of a motor over position."""

    x: tuple[float, ...]  # m, rising
    gamma: tuple[float, ...]  # without unit, above 0


PLACEHOLDER_GAMMA = Geometry((0.0, 0.01, 0.02, 0.03, 0.04), (0.85, 0.96, 1.0, 0.96, 0.85))
"""NOT measured: the paper prints no numbers for Gamma(x).  A symmetric guess over the
0.04 m of travel, so that scenes run before a device has been calibrated; replace it by
a measurement."""


@public
def skin_drive(dp: Block, m: Block | float, B: Block | float) -> Block:
    """Compute the motor force that applies a given force to the skin.

    dF = -(m/B) dp/dt.

    Above 100 Hz the finger pad acts as a damper, p = -B dx/dt, and the device as an
    inertia much larger than the pad's, F = m d2x/dt2.

    Parameters
    ----------
    dp : Block
        dp/dt in N/s, such as a ``differentiator`` of pink noise in N.
    m : float or Block
        Moving mass of the device in kg; live when it is a ``Param``.
    B : float or Block
        Damping of the skin in N s/m; live when it is a ``Param``.

    Returns
    -------
    Block
        In N.

    Raises
    ------
    UnitError
        A signal in another unit.
    BadValue
        A number or parameter m or B not above 0.

    References
    ----------
    The UGrip paper, section 1.1, eq. (1).

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.blocks import constant, differentiator, pink_noise
    >>> from stimlib.blocks import skin_drive
    >>> p = constant(0.01, "N") * pink_noise(psd_1hz=1.0, seed=1, f_low=10.0)
    >>> str(skin_drive(differentiator(p, passband=1000.0), m=0.2, B=1.5).dim)
    'N'
    """
    mass = quantity("skin_drive", "m", m, "kg", False)
    ratio = mass / quantity("skin_drive", "B", B, "N*s/m", False)
    return -ratio * signal_in("skin_drive", "dp", dp, "N/s")


@dataclass(frozen=True, eq=False)
class ForceLimit(Map):
    """A force clipped to -peak .. peak, and 0 where peak is below 0.

    NaN and infinity pass, so that the guard of the output detects them; where peak is
    NaN, so is the force.
    """

    x: Block
    peak: Block

    def units(self, *u):
        return same_unit("compare", self.x, self.peak, *u)

    def steepest(self, fs, z, H, value):
        return H[0] if H[1] is None else None

    @staticmethod
    def step(p, s, x, peak):
        return where(x - x == 0.0, within(x, held(peak)), x), s


@public
def force_limit(force: Block, peak: Block | float = 100.0) -> Block:
    """Clip a force to the motor's peak force in both directions.

    Parameters
    ----------
    force : Block
        In N.
    peak : float or Block
        In N; live when it is a ``Param``.  A signal below 0 counts as 0.

    Returns
    -------
    Block
        In N.

    Raises
    ------
    UnitError
        A signal in another unit.
    BadValue
        A number or parameter not above 0.

    Notes
    -----
    Infinity is not made into the peak force: it passes, and the output's guard stops it
    as a fault.

    References
    ----------
    The UGrip paper, section 2.1: "more than 37 N of static or 100 N of peak force".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import force_limit
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"F": force_limit(stimlib.Input("force", "N"))}), fs=1000
    ... )
    >>> proc.process(np.array([[90.0, 120.0, -300.0]]))
    array([[  90.,  100., -100.]])
    """
    return ForceLimit(
        signal_in("force_limit", "force", force, "N"),
        quantity("force_limit", "peak", peak, "N", False),
    )


KNEE = 0.81  # of the mean square: 0.9 of the limit


# Parameters of `StaticLimit` at a sample rate.
#   most  limit^2
#   span  most - knee
StaticParams = namedtuple("StaticParams", "a most knee span cap")

# State of `StaticLimit` between samples.
#   m  mean square of the output
StaticState = namedtuple("StaticState", "m")


@dataclass(frozen=True, eq=False)
class StaticLimit(Block):
    """A limit on the mean square of a force, applied as a slow gain G.

    y = G(m) x;  m += a (y^2 - m),  a = 1 - exp(-1/(tau fs)).

    G(m) = 1 up to m = K, then falls linearly to 0 at m = L^2; K = 0.81 L^2. |x| is
    clipped at sqrt(K + (L^2 - K)/a).
    """

    x: Block
    limit: Above0
    tau: Above0
    begins_early = False

    def design(self, fs):
        a = -math.expm1(-1 / (self.tau * fs))
        most = self.limit * self.limit
        knee = KNEE * most
        return StaticParams(
            a, most, knee, most - knee, math.sqrt(knee + (most - knee) / a)
        ), StaticState(0.0)

    @staticmethod
    def step(p, s, x):
        gain = where(s.m > p.knee, (p.most - s.m) / p.span, 1.0)
        held = where(x > p.cap, p.cap, where(x < -p.cap, -p.cap, x))
        y = gain * where(x - x == 0.0, held, x)
        return y, StaticState(fma(p.a, fma(y, y, TINY) - s.m, s.m))


@public
def static_limit(force: Block, limit: float = 37.0, tau: float = 10.0) -> Block:
    """Limit the mean square of a force to what a motor can sustain.

    The limit is a slowly changing gain.

    With L = limit, K = (0.9 L)^2 and the running mean m of the output's square,

    y[n] = G x[n],  G = min(1, (L^2 - m[n-1])/(L^2 - K)),
    m[n] = m[n-1] + a (y[n]^2 - m[n-1]),  a = 1 - exp(-1/(tau fs)).

    Parameters
    ----------
    force : Block
        In N.
    limit : float
        Static force L in N.
    tau : float
        Time constant of the mean in s.

    Returns
    -------
    Block
        In N.

    Raises
    ------
    UnitError
        A signal in another unit.
    BadValue
        limit or tau not above 0.

    Notes
    -----
    - Bound: m <= L^2 at every sample, for any input (to rounding).  Write t for G where
      it is below 1, m = L^2 - (L^2 - K) t. Then m + a (t^2 x^2 - m) <= L^2 is t^2 a x^2
      <= (L^2 - K) t + a m, which holds for every t in 0 .. 1 as long as a x^2 <= L^2 -
      K + a K.  Larger |x| are clipped there: 4.6 kN at 8 kHz and 1.6 kN at 1 kHz for
      the default numbers, so that behind ``force_limit`` this never happens.
    - Transparent: as long as the mean square of the input stays at or below K, it
      passes bit for bit.
    - No click: G is a function of m, which is continuous: |dG/dt| <= max(x^2, L^2)/(tau
      (L^2 - K)), 3.8 per second for 100 N.
    - A constant force x settles at G x with (G x)^2 + (L^2 - K) G = L^2: 90 N at 35.6
      N, 36 N at 33.6 N.  It takes about tau K/x^2 until it begins to fall: 1.5 s for 90
      N.
    - After reset the motor is cold, m = 0.

    References
    ----------
    The UGrip paper, section 2.1: "more than 37 N of static or 100 N of peak force".
    The rule is our own.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import static_limit
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"F": static_limit(stimlib.Input("force", "N"))}), fs=1000
    ... )
    >>> y = proc.process(np.full((1, 60_000), 90.0))[0]  # a firm grip for a minute
    >>> y[[0, 1000, -1]].round(1)
    array([90. , 90. , 35.6])
    """
    return StaticLimit(signal_in("static_limit", "force", force, "N"), limit, tau)


# Parameters of `SlewLimit` at a sample rate.
#   step  most that y moves in one sample
SlewParams = namedtuple("SlewParams", "step")

# State of `SlewLimit` between samples.
SlewState = namedtuple("SlewState", "y")


@dataclass(frozen=True, eq=False)
class SlewLimit(Block):
    """A signal that follows x by at most rate/fs per sample.

    NaN and infinity pass, so that the guard of the output detects them.
    """

    x: Block
    rate: Above0
    begins_early = False

    def design(self, fs):
        return SlewParams(self.rate / fs), SlewState(0.0)

    @staticmethod
    def step(p, s, x):
        high, low = s.y + p.step, s.y - p.step
        y = where(x > high, high, where(x < low, low, x))
        finite = x - x == 0.0
        return where(finite, y, x), SlewState(where(finite, y, s.y))


@public
def slew_limit(x: Block, rate: float) -> Block:
    """Limit the rate of change of a signal.

    Use it, for example, for the fastest change of force that a transmission tolerates.

    y[n] = min(max(x[n], y[n-1] - rate/fs), y[n-1] + rate/fs), y[-1] = 0.

    Parameters
    ----------
    x : Block
    rate : float
        In the unit of x per second, above 0.

    Returns
    -------
    Block
        In the unit of x; x itself, bit for bit, where it moves no faster.

    Raises
    ------
    BadValue
        rate not above 0.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import slew_limit
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"F": slew_limit(stimlib.Input("force", "N"), rate=1000.0)}),
    ...     fs=1000,
    ... )
    >>> proc.process(np.array([[0.5, 3.0, 3.0, 2.9, 0.0]]))
    array([[0.5, 1.5, 2.5, 2.9, 1.9]])
    """
    return SlewLimit(as_block(x), rate)


# Parameters of `ResponseLimit` at a sample rate: a row for each phase.
#   k     what one sample adds to each bounded number
#   per   1/k
#   keep  0 after the last number of each kind
ResponseParams = namedtuple("ResponseParams", "k per keep phases")

# State of `ResponseLimit` between samples.
#   ahead  what the samples so far will still make, in parts of its bounds
#   at     phase
ResponseState = namedtuple("ResponseState", "ahead at")


@dataclass(frozen=True, eq=False)
class ResponseLimit(Block):
    """A signal limited so that the response of what follows stays within bounds.

    The output is the largest part of x after which the response would stay within its
    bounds if only zeros followed. Zero is therefore always possible, and the bounds
    hold whatever x does (a reference governor).

    ``response`` is the response to one sample of 1.0, ``most`` the bound of its
    magnitude, and ``slew`` that of its change per second. Every ``every``-th sample of
    the response is bounded, which is enough if its frequencies are low.
    """

    x: Block
    response: np.ndarray
    most: Above0
    slew: Above0 | None
    every: Count

    begins_early = False  # its phase counts from sample 0

    def design(self, fs):
        padded = np.append(self.response, np.zeros(self.every + -self.response.size % self.every))
        rows = padded.reshape(-1, self.every)[:, ::-1].T  # the last phase is bounded itself
        with np.errstate(all="ignore"):
            kinds = [rows / self.most]
            if self.slew is not None:
                kinds.append(np.diff(rows, prepend=0.0) * (fs / self.every / self.slew))
        k, keep = np.hstack(kinds).ravel(), np.ones((len(kinds), rows.shape[1]))
        if not np.isfinite(k).all():
            raise BadValue("ResponseLimit: most or slew is too small for the response; raise it")
        keep[:, -1] = 0.0
        per = 1.0 / np.where(np.abs(k) < 1e-300, 1e-300, k)
        state = ResponseState(np.zeros(keep.size + 1), 0.0)
        return ResponseParams(k, per, keep.ravel(), float(self.every)), state

    @staticmethod
    def step(p, s, x):
        n, at = p.keep.size, where(s.at > 0.0, where(s.at < p.phases, s.at, 0.0), 0.0)
        after, low, high = where(at + 1.0 < p.phases, at + 1.0, 0.0), -1e300, 1e300
        row, moved = n * np.int64(at), n * np.int64(where(after > 0.0, 0.0, 1.0))
        for i in range(n):
            a, b = (1.0 - s.ahead[i]) * p.per[row + i], (-1.0 - s.ahead[i]) * p.per[row + i]
            least, most = where(a < b, a, b), where(a < b, b, a)
            low, high = where(least > low, least, low), where(most < high, most, high)
        low, high = where(low < 0.0, low, 0.0), where(high > 0.0, high, 0.0)
        y = where(x > high, high, where(x < low, low, x))
        kept = where(x - x == 0.0, y, 0.0)
        for i in range(n):
            s.ahead[i] = s.ahead[i] + p.k[row + i] * kept
        for i in range(moved):
            s.ahead[i] = p.keep[i] * s.ahead[i + 1]
        return where(x - x == 0.0, y, x), ResponseState(s.ahead, after)


# Parameters of `Passive` at a sample rate.
#   reach   m, farthest that the measured position moves in one sample
#   creep   m, farthest that the true one moves in one sample
#   rest    part of a sample of the delay, beyond whole samples
#   blur    m, half a step of the encoder
#   half    J, half of the bound
#   brake   N/m, the largest damping over one sample
#   rate    J, that a sample may give on purpose
#   still   the most samples for which a reading may stay although the hand moves
#   ahead   samples until a force begins, rounded up
#   sure    N, that the device makes of a larger force at least
#   lost    a 0 for each force in a row that the device may not take
#   times   how often a force may act
PassiveParams = namedtuple(
    "PassiveParams", "reach creep rest blur half brake most rate still ahead sure lost times"
)

# State of `Passive` between samples.
#   sent   the forces under way, and those that may still act, in a ring
#   low    least that acts in the place of each
#   high   most that acts in the place of each
#   size   largest that acts in the place of each
#   due    J, charged for the change to each, while readings may stay
#   at     where the next one goes
#   put    N, the last one
#   last   position; its first is none
#   begun  0 before the first sample
#   room   J, that may still be given, whatever the motion
#   work   J, that was observed to have been taken
#   given  J, the most that was observed to have been given
#   leaps  positions that were not trusted
#   same   samples since the position changed
PassiveState = namedtuple(
    "PassiveState", "sent low high size due at put last begun room work given leaps same"
)


@dataclass(frozen=True, eq=False)
class Passive(Block):
    """A force that gives no more energy than a bound, beyond what it has got.

    An observer sums the work of each force along the motion in which it acts, after the
    delay.  Each force that is sent is first charged with the most that it could give,
    |y| reach, and this is settled when its motion is known.  So ``room`` is never below
    0, which is the proof.  While it is below half of the bound, damping is added, in
    proportion to what is missing; and |y| never exceeds what ``room`` can pay for.
    """

    x: Block
    over: Block
    gain: Block  # of the fade
    most: float
    bound: Above0
    power: float  # W, that x gives on purpose
    damping: float
    speed: Above0
    late: float  # s
    encoder: float
    still: float = 0.0  # s
    lost: int = 0
    sure: float | None = None  # N
    begins_early = False

    def design(self, fs):
        late = round(self.late * fs, 9)
        p = PassiveParams(
            self.speed / fs + self.encoder, self.speed / fs, late % 1.0, self.encoder / 2,
            self.bound / 2, self.damping * fs, self.most, self.power / fs, self.still * fs,
            math.ceil(late), 1e300 if self.sure is None else self.sure, np.zeros(self.lost),
            1.0 + self.lost,
        )  # fmt: skip
        sent, low, high, size, due = np.zeros((5, int(late) + 2 + self.lost))
        rest = NONE, 0.0, 0.0, 0.0, self.bound, 0.0, 0.0, NONE, 0.0
        return p, PassiveState(sent, low, high, size, due, *rest)

    @staticmethod
    def step(p, s, x, over, gain):
        n, more = np.uint64(s.sent.size), np.uint64(p.lost.size)
        at = where(s.at < n, s.at, NONE)  # a state may come from anywhere
        a, b = at + more, at + more + ONE
        a, b = where(a < n, a, a - n), where(b < n, b, b - n)
        before, now = s.sent[a], s.sent[b]
        moved = where(s.begun > 0.0, over - s.last, 0.0)
        # a leap is no motion, nor is one from or to NaN: the worst counts
        known = where(abs(moved) <= p.reach, 1.0, 0.0) > 0.0
        # the true position may be so far from a reading that stays: from the last one,
        # from this one, and where the force changes in between
        same = where(moved == 0.0, s.same + s.begun, 0.0)
        then = p.creep * where(s.same < p.still, s.same, p.still)
        off = p.creep * where(same < p.still, same, p.still)
        middle = then + p.rest * (off - then)
        # what acts lies between two forces
        low = p.rest * s.low[a] + (1.0 - p.rest) * s.low[b]
        high = p.rest * s.high[a] + (1.0 - p.rest) * s.high[b]
        held = p.reach * (p.rest * s.size[a] + (1.0 - p.rest) * s.size[b])
        done = where(known, where(moved > 0.0, low, high) * moved, -held)
        # what a reading that stays may hide, for each change of the force, or at a leap
        hidden = where(known, middle * abs(now - before), then * abs(before))
        back = where(known, then * abs(before) - off * abs(now) - hidden, 0.0)
        room = s.room + (held + done) + p.rate
        room = room + (s.due[b] + back)
        room = where(room > 0.0, room, 0.0)
        short = where(room < p.half, 1.0 - room / p.half, 0.0)
        y = where(known, where(short > 0.0, x + gain * p.brake * short * moved, x), x)
        # forces that were sent may act in the place of this one and of later ones
        top, lowest, highest, free, i = 0.0, 1e300, -1e300, room, at
        for _ in range(p.lost.size):
            i = where(i > NONE, i, n) - ONE
            f = s.sent[i]
            top = where(abs(f) > top, abs(f), top)
            lowest, highest = where(f < lowest, f, lowest), where(f > highest, f, highest)
            free = free - p.reach * top
        free = where(free > 0.0, free, 0.0)
        # a force pays for its motion, and a larger one for the way there and back
        each = p.reach * p.times
        later = p.creep * where(same + p.ahead < p.still, same + p.ahead, p.still)
        rise = 2.0 * (p.blur + later)
        other, put = free / (each + rise), abs(s.put)
        rises = each * put < free
        own = where(rises, free + rise * put, free) / where(rises, each + rise, each)
        up, down = where(s.put > 0.0, own, other), where(s.put < 0.0, own, other)
        most = p.most * gain
        up, down = where(up < most, up, most), where(down < most, down, most)
        y = where(y > up, up, where(y < -down, -down, y))
        sent = where(x - x == 0.0, y, 0.0)
        lowest, highest = where(lowest < sent, lowest, sent), where(highest > sent, highest, sent)
        s.sent[at] = sent
        s.low[at] = where(lowest < p.sure, lowest, p.sure)
        s.high[at] = where(highest > -p.sure, highest, -p.sure)
        s.size[at] = where(-s.low[at] > s.high[at], -s.low[at], s.high[at])
        # the true position, half a step away, makes another work of each change, and of
        # the way back to 0; so does one that is farther away
        changed = abs(sent - s.put) + abs(sent) - put
        s.due[at] = later * changed
        work = s.work + done - p.blur * abs(now - before) - hidden
        least = work - p.blur * abs(now) - where(known, off * abs(now), 0.0)
        after = where(at + ONE < n, at + ONE, NONE)
        return where(x - x == 0.0, y, x), PassiveState(
            s.sent,
            s.low,
            s.high,
            s.size,
            s.due,
            after,
            sent,
            over,
            1.0,
            room - p.reach * s.size[at] - (p.blur + later) * changed,
            work,
            where(-least > s.given, -least, s.given),
            s.leaps + where(known, NONE, ONE),
            same,
        )


# Parameters of `Tally` at a sample rate.
TallyParams = namedtuple("TallyParams", "error")

# State of `Tally` between samples.
#   most  largest change
#   peak  largest value before
TallyState = namedtuple("TallyState", "n most peak")


@dataclass(frozen=True, eq=False)
class Tally(Block):
    """The signal x, with a count of the samples that a stage has changed.

    ``before`` is the signal ahead of that stage, ``after`` the one behind it. The state
    counts the changes above ``error`` times the largest ``before``, and keeps the
    largest.
    """

    x: Block
    before: Block
    after: Block
    stage: str
    output: str
    error: float = 0.0

    def units(self, *u):
        return same_unit("compare", self.x, self.before, *u[:2])

    def design(self, fs):
        return TallyParams(self.error), TallyState(NONE, 0.0, 0.0)

    @staticmethod
    def step(p, s, x, before, after):
        peak, size = where(abs(before) > s.peak, abs(before), s.peak), abs(after - before)
        count = where(size > p.error * peak, ONE, NONE)
        return x, TallyState(s.n + count, where(size > s.most, size, s.most), peak)


@public
def motor_current(
    force: Block,
    x: Block,
    motor_constant: Block | float,
    geometry: tuple[ArrayLike, ArrayLike] = PLACEHOLDER_GAMMA,
    kind: Literal["pchip", "linear"] = "pchip",  # which stay between neighbouring values
) -> Block:
    """Compute the voice-coil current for a force: I = F/(n B Gamma(x)).

    Parameters
    ----------
    force : Block
        F in N.
    x : Block
        Position in m.
    motor_constant : float or Block
        n B in N/A, the force per current where Gamma = 1; live when it is a ``Param``.
    geometry : (positions, values), two array_like of shape (m,)
        Gamma, the proportion of the magnet's flux that passes through the coil, without
        unit, over rising positions in m; held beyond the first and last.  The default
        ``PLACEHOLDER_GAMMA`` is **not measured**: the paper prints no numbers.
    kind : {"pchip", "linear"}
        Between the positions; both stay between neighbouring values, so Gamma stays
        above 0.

    Returns
    -------
    Block
        In A.

    Raises
    ------
    UnitError
        A signal in another unit.
    BadValue
        Gamma, or a number or parameter motor_constant, not above 0; positions that do
        not rise; another kind.

    References
    ----------
    The UGrip paper, section 2.1: F(x) = n B I Gamma(x).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import motor_current
    >>> force, x = stimlib.Input("force", "N"), stimlib.Input("x", "m")
    >>> current = motor_current(
    ...     force,
    ...     x,
    ...     motor_constant=10.0,
    ...     geometry=([0.0, 0.04], [0.5, 1.0]),
    ...     kind="linear",
    ... )
    >>> proc = stimlib.compile(stimlib.Scene({"I": current}), fs=8000)
    >>> proc.process(np.array([[10.0, 10.0], [0.0, 0.04]]))
    array([[2., 1.]])
    """
    gamma = np.asarray(geometry[1], float)
    if not (gamma > 0).all():
        at = int(np.argmin(gamma > 0))
        raise BadValue(
            f"motor_current: Gamma[{at}] = {gamma.flat[at]:g} must be above 0, as all of Gamma"
        )
    constant_ = quantity("motor_current", "motor_constant", motor_constant, "N/A", False)
    factor = lut(signal_in("motor_current", "x", x, "m"), geometry[0], gamma, kind=kind)
    return signal_in("motor_current", "force", force, "N") / (constant_ * factor)
