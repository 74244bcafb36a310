"""From a wanted force to what a motor is given: the skin's damper, limits of force, and
current.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import units as un
from ..core.graph import NONE, ONE, Block, Const, Map, as_block, constant, positive, same_unit
from ..core.maths import TINY, fma, where
from ..core.units import unit
from ..errors import BadValue, UnitError, public
from .table import lut


class Geometry(NamedTuple):
    """Geometry factor over position."""

    x: tuple[float, ...]  # m, rising
    gamma: tuple[float, ...]  # without unit, above 0


PLACEHOLDER_GAMMA = Geometry((0.0, 0.01, 0.02, 0.03, 0.04), (0.85, 0.96, 1.0, 0.96, 0.85))
"""NOT measured: the paper prints no numbers for Gamma(x).  A symmetric guess over the
0.04 m of travel, so that scenes run before a device has been calibrated; replace it by
a measurement."""


def _quantity(who: str, name: str, v: Block | float, text: str) -> Block:
    """A number above 0 gets the unit; a signal must have it."""
    b = as_block(v)
    if isinstance(b, Const):
        if not (math.isfinite(b.value) and b.value > 0):
            raise BadValue(f"{who}: {name} = {b.value:g} must be a finite number above 0")
        if b.dim == un.ONE:
            return constant(b.value, text)
    if b.dim != unit(text):
        raise UnitError(f"{who}: {name} {b!r} is in [{b.dim}], not in [{text}]")
    return b


def _signal(who: str, name: str, v: Block | float, text: str) -> Block:
    b = as_block(v)
    if b.dim != unit(text):
        raise UnitError(f"{who}: {name} {b!r} is in [{b.dim}], not in [{text}]")
    return b


@public
def skin_drive(dp: Block, m: Block | float, B: Block | float) -> Block:
    """Force of a motor that lets the skin feel the force p: dF = -(m/B) dp/dt.

    Above 100 Hz the finger pad is a damper, p = -B dx/dt, and the device an inertia
    much greater than the pad's, F = m d2x/dt2.

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
        A number m or B not above 0.

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
    ratio = _quantity("skin_drive", "m", m, "kg") / _quantity("skin_drive", "B", B, "N*s/m")
    return -ratio * _signal("skin_drive", "dp", dp, "N/s")


@dataclass(frozen=True, eq=False)
class ForceLimit(Map):
    """x held between -peak and peak; what is not finite passes, for the output's guard
    to see.
    """

    x: Block
    peak: Block

    def units(self, *u):
        return same_unit("compare", self.x, self.peak, *u)

    def steepest(self, fs, z, H, value):
        return H[0] if H[1] is None else None

    @staticmethod
    def step(p, s, x, peak):
        y = where(x > peak, peak, where(x < -peak, -peak, x))
        return where(x - x == 0.0, y, x), s


@public
def force_limit(force: Block, peak: Block | float = 100.0) -> Block:
    """Clip a force at the peak force of the motor, on both sides.

    Parameters
    ----------
    force : Block
        In N.
    peak : float or Block
        In N; live when it is a ``Param``.

    Returns
    -------
    Block
        In N.

    Raises
    ------
    UnitError
        A signal in another unit.
    BadValue
        A number not above 0.

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
        _signal("force_limit", "force", force, "N"), _quantity("force_limit", "peak", peak, "N")
    )


KNEE = 0.81  # of the mean square: 0.9 of the limit


class StaticParams(NamedTuple):
    a: float
    most: float  # limit^2
    knee: float
    span: float  # most - knee
    cap: float


class StaticState(NamedTuple):
    m: float  # mean square of the output


@dataclass(frozen=True, eq=False)
class StaticLimit(Block):
    """y = G(m) x;  m += a (y^2 - m),  a = 1 - exp(-1/(tau fs)).

    G(m) = 1 up to m = K, then falls along a line to 0 at m = L^2; K = 0.81 L^2.  |x| is
    clipped at sqrt(K + (L^2 - K)/a).
    """

    x: Block
    limit: float
    tau: float

    def check(self):
        positive(self, "limit", "tau")

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
    """Keep the mean square of a force below that of the static force a motor can bear,
    by a gain that moves slowly.

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
    return StaticLimit(_signal("static_limit", "force", force, "N"), limit, tau)


class SlewParams(NamedTuple):
    step: float  # most that y moves in one sample


class SlewState(NamedTuple):
    y: float


@dataclass(frozen=True, eq=False)
class SlewLimit(Block):
    """y follows x by at most rate/fs in one sample; what is not finite passes, for the
    output's guard to see.
    """

    x: Block
    rate: float

    def check(self):
        positive(self, "rate")

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
    """Follow a signal no faster than a rate, such as the fastest change of force that a
    transmission bears.

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


class TallyState(NamedTuple):
    n: np.uint64


@dataclass(frozen=True, eq=False)
class Tally(Block):
    """x, with a count in its state of the samples at which a stage made something else
    of ``before``.
    """

    x: Block
    before: Block
    stage: str
    output: str

    def units(self, *u):
        return same_unit("compare", self.x, self.before, *u)

    def design(self, fs):
        return (), TallyState(NONE)

    @staticmethod
    def step(p, s, x, before):
        return x, TallyState(s.n + where(x == before, NONE, ONE))


@public
def motor_current(
    force: Block,
    x: Block,
    motor_constant: Block | float,
    geometry: tuple[ArrayLike, ArrayLike] = PLACEHOLDER_GAMMA,
    kind: str = "pchip",
) -> Block:
    """Current of a voice coil for a wanted force: I = F/(n B Gamma(x)).

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
        Gamma or a number motor_constant not above 0; positions that do not rise;
        another kind.

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
    if kind not in ("pchip", "linear"):
        raise BadValue(
            f"motor_current: kind = {kind!r}; choose pchip or linear, which stay between"
            " neighbouring values"
        )
    if len(geometry) != 2:
        raise BadValue("motor_current: geometry is a pair (positions, values)")
    gamma = np.asarray(geometry[1], float)
    if not (gamma > 0).all():
        raise BadValue(
            f"motor_current: Gamma must be above 0 everywhere; value {int(np.argmin(gamma > 0))}"
            " is not"
        )
    constant_ = _quantity("motor_current", "motor_constant", motor_constant, "N/A")
    factor = lut(_signal("motor_current", "x", x, "m"), geometry[0], gamma, kind=kind)
    return _signal("motor_current", "force", force, "N") / (constant_ * factor)
