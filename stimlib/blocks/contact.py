"""Contact forces (friction, walls, detents, buttons) and the limits of a motor."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import pointwise
from ..core.graph import (
    NONE,
    ONE,
    Block,
    Const,
    Map,
    as_block,
    constant,
    in_unit,
    same_unit,
    scratch,
)
from ..core.maths import TINY, each, exp, floor, fma, log, where
from ..core.parameter import Param
from ..core.response import backward
from ..core.units import unit
from ..errors import Above0, BadValue, Count, From0, UnitError, public
from .impedance import with_unit
from .movement import Over, PlaceState, gap, sinpi
from .tables import lut

# Dry friction -----------------------------------------------------------------------
# Dry friction from positions alone: each sample is the mean force over the straight way
# since the last one.
#
# A surface is a spring of stiffness k whose deflection z is held within c = limit/k.
# Every step begins alike: where the stiffness has changed, z keeps its force on a rise
# and its place on a fall; then z is held within c, which may have fallen. Both only
# lose energy. The laws differ in how z follows the way, and each is solved exactly for
# a straight one. So the work of any motion, sum F dx, is at least the energy k z^2/2
# that is stored.
FARTHEST = 1e100  # m before anything slips: a spring without any stiffness


def amount(who: str, name: str, v, text: str, zero: bool = True, why: str = "") -> Block:
    """Return a quantity as a signal with the given unit.

    A plain number gets the unit. BadValue if a number or a parameter is below 0 (or is
    0, where that makes no sense).
    """
    b = with_unit(v, text)
    if isinstance(b, (Const, Param)) and not (b.value >= 0 if zero else b.value > 0):
        raise BadValue(
            f"{who}: {name} = {b.value:g} must be {'0 or above' if zero else 'above 0'}{why}"
        )
    return b


# What all laws begin with -------------------------------------------------------------
# State of `Friction` between samples.
#   last  x
#   z     deflection
#   k     of the last sample
FrictionState = namedtuple("FrictionState", "last z k cold")


def held(v):
    """Return a signal limited to values of 0 and above; NaN stays NaN."""
    return where(v > 0.0, v, where(v == v, 0.0, v))


def between(v, low, high):
    """Return v clipped to low .. high; NaN where any of the three is NaN."""
    return where(v > high, high, where(v < low, low, where(high == high, v, high)))


def within(z, c):
    """Return z clipped to -c .. c; NaN where c is NaN."""
    return between(z, -c, c)


def sign(x):
    """Return the direction of a movement as -1 or 1."""
    return where(x < 0.0, -1.0, 1.0)


def deflection(limit, k):
    """Return the deflection at which a spring of stiffness k reaches the limit force.

    The result is finite even for a very soft spring.
    """
    c = held(limit) / k
    return where(k > 0.0, where(c > FARTHEST, FARTHEST, c), where(k == k, 0.0, k))


def softened(z, before, k):
    """Return the deflection of a spring after its stiffness has changed to k.

    It is z min(1, before/k), so the stored energy never grows.
    """
    return where(before < k, z * over(before, k), z)


def over(a, b):
    """Return a/b, or a where b is 0.

    Callers do not use the result where b is 0, but a division by 0 would make
    derivatives NaN.
    """
    return a / where(b == 0.0, 1.0, b)


def relax(a):
    """Return exp(-a) and the mean of the decay, (1 - exp(-a))/a, for a >= 0."""
    e = exp(-a)
    near = 1.0 - a * (1 / 2 - a * (1 / 6 - a * (1 / 24 - a * (1 / 120 - a / 720))))
    return e, where(a < 0.01, near, over(1.0 - e, a))


def averaging(fs, z, k, b=0.0):
    """Return the frequency response of a spring k and a damper b in parallel.

    The spring's force is averaged over each sample period.
    """
    d = backward(z)
    return k * (1.0 - 0.5 * d) + b * fs * d


@dataclass(frozen=True, eq=False)
class Friction(Over, abstract=True):
    """Base class of friction modelled as a spring that slips at a limit force.

    Limit force and stiffness are signals.
    """

    x: Block
    limit: Block  # of the force
    stiffness: Block
    contact: Block

    def units(self, *u):
        if u[0] * u[2] != u[1]:
            raise UnitError(
                f"friction: stiffness [{u[2]}] times x [{u[0]}] is [{u[0] * u[2]}], and mu times"
                f" normal [{u[1]}]: they must be one unit; plain numbers are N/m and N, so over"
                f" this x give a stiffness such as constant(1000.0, '{u[1] / u[0]}')"
            )
        return u[1]

    def design(self, fs):
        return (), FrictionState(0.0, 0.0, 0.0, 1.0)

    def steepest(self, fs, z, H, value):
        """Return the response during sticking, plus the effect of a changing limit."""
        if H[0] is None or value[2] is None:
            return None
        return averaging(fs, z, value[2]) * H[0] + (0.0 if H[1] is None else H[1])


# The laws -----------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Coulomb(Friction):
    """Coulomb friction with a spring: dz = dx while |z| < c."""

    @staticmethod
    def step(p, s, x, limit, stiffness):
        k = held(stiffness)
        c = deflection(limit, k)
        z = within(softened(s.z, s.k, k), c)
        dx = where(s.cold > 0.0, 0.0, x - s.last)
        t = z + dx
        after, left = within(t, c), c - sign(dx) * z
        slips = sign(dx) * (c - 0.5 * left * over(left, abs(dx)))
        return k * where(after == t, z + 0.5 * dx, slips), FrictionState(x, after, k, 0.0)


# Parameters of elastic blocks at a sample rate.
ElasticParams = namedtuple("ElasticParams", "elastic")


@dataclass(frozen=True, eq=False)
class ElastoPlastic(Friction):
    """Dahl friction with an elastic range.

    While s z < b = elastic c the contact is elastic, dz = dx; beyond, dz = (1 - (s z -
    b)/(c - b)) dx, where s is the direction of dx.
    """

    elastic: float

    def check(self):
        if not 0 <= self.elastic < 1:
            raise BadValue(
                f"friction: elastic = {self.elastic:g} must be 0 or above and below 1; a spring up"
                " to the limit is law='coulomb'"
            )

    def design(self, fs):
        return ElasticParams(self.elastic), FrictionState(0.0, 0.0, 0.0, 1.0)

    @staticmethod
    def step(p, s, x, limit, stiffness):
        k = held(stiffness)
        c = deflection(limit, k)
        z = within(softened(s.z, s.k, k), c)
        dx = where(s.cold > 0.0, 0.0, x - s.last)
        b, u, a = p.elastic * c, sign(dx) * z, abs(dx)
        rest = held(b - u)  # of the elastic way
        e = where(a > rest, rest, a)
        flow, d = a - e, c - (u + e)
        left, mean = relax(where(c > b, over(flow, c - b), 0.0))
        after = where(a > rest, c - d * left, u + a)
        r = over(e, a)
        m = where(a <= rest, u + 0.5 * a, r * (u + 0.5 * e) + (1.0 - r) * (c - d * mean))
        return k * sign(dx) * m, FrictionState(x, sign(dx) * after, k, 0.0)


def drawn(z, c, dx):
    """Return the final and the mean deflection of Dahl's law along a path.

    The law is dz = (1 - s z/c) dx.
    """
    to = sign(dx) * c
    left, mean = relax(where(c > 0.0, over(abs(dx), c), 0.0))
    return to + (z - to) * left, to + (z - to) * mean


@dataclass(frozen=True, eq=False)
class Dahl(Friction):
    """Dahl friction: dz = (1 - s z/c) dx, where s is the direction of dx."""

    @staticmethod
    def step(p, s, x, limit, stiffness):
        k = held(stiffness)
        c = deflection(limit, k)
        after, mean = drawn(
            within(softened(s.z, s.k, k), c), c, where(s.cold > 0.0, 0.0, x - s.last)
        )
        return k * mean, FrictionState(x, after, k, 0.0)


# Parameters of `LuGre` at a sample rate.
#   damping    times fs
#   viscosity  times fs
LuGreParams = namedtuple("LuGreParams", "damping viscosity")


@dataclass(frozen=True, eq=False)
class LuGre(Over):
    """LuGre friction: Dahl's law with a limit g(v), a damper and viscosity.

    F = k z + damping dz/dt + viscosity v; z is clipped at the deflection of the static
    limit.
    """

    x: Block
    limit: Block  # g(v)
    static: Block  # g(0)
    stiffness: Block
    contact: Block
    damping: From0
    viscosity: From0

    def units(self, *u):
        same = Friction.units(self, u[0], u[1], u[3])  # type: ignore[arg-type]
        if u[2] != same:
            raise UnitError(f"friction: the static limit is [{u[2]}], and the limit [{same}]")
        return same

    def design(self, fs):
        return LuGreParams(self.damping * fs, self.viscosity * fs), FrictionState(
            0.0, 0.0, 0.0, 1.0
        )

    def steepest(self, fs, z, H, value):
        """Return the response during sticking, plus the effect of a changing limit."""
        if H[0] is None or value[3] is None:
            return None
        return averaging(fs, z, value[3], self.damping + self.viscosity) * H[0] + (
            0.0 if H[1] is None else H[1]
        )

    @staticmethod
    def step(p, s, x, limit, static, stiffness):
        k = held(stiffness)
        z = within(softened(s.z, s.k, k), deflection(static, k))
        dx = where(s.cold > 0.0, 0.0, x - s.last)
        c = deflection(limit, k)
        after, mean = drawn(z, c, dx)
        after, mean = where(c > 0.0, after, 0.0 * c), where(c > 0.0, mean, 0.0 * c)
        return k * mean + p.damping * (after - z) + p.viscosity * dx, FrictionState(
            x, after, k, 0.0
        )


# Around the laws ----------------------------------------------------------------------
# Parameters of `Stribeck` at a sample rate.
#   per  fs/speed
StribeckParams = namedtuple("StribeckParams", "rise per exponent")


@dataclass(frozen=True, eq=False)
class StribeckCurve(Block, abstract=True):
    """Stribeck curve: limit (1 + rise exp(-(v/speed)^exponent)).

    v is the mean speed during a sample.
    """

    x: Block
    limit: Block
    contact: Block
    rise: float
    speed: Above0
    exponent = 2.0
    resettable = True

    def check(self):
        if not 1 <= self.exponent < math.inf:
            raise BadValue(
                f"friction: exponent = {self.exponent:g} must be a number from 1 on: below,"
                " friction falls infinitely steeply at rest"
            )

    def units(self, *u):
        return u[1]

    def design(self, fs):
        per = min(fs / self.speed, 1e300)
        return StribeckParams(self.rise, per, float(self.exponent)), PlaceState(0.0, 1.0)

    def steepest(self, fs, z, H, value):
        """Return the negative damping at the steepest fall of the Stribeck curve.

        With d the exponent it is where (v/speed)^d = (d - 1)/d; for d = 2 its slope is
        -rise sqrt(2/e)/speed times the limit.
        """
        if H[0] is None or value[1] is None:
            return None
        at = (self.exponent - 1) / self.exponent
        fall = self.exponent * at**at * math.exp(-at) / self.speed
        return averaging(fs, z, 0.0, -value[1] * self.rise * fall) * H[0]


@dataclass(frozen=True, eq=False)
class Stribeck(StribeckCurve):
    """Stribeck curve with the exponent 2."""

    @staticmethod
    def step(p, s, x, limit):
        v = where(s.cold > 0.0, 0.0, p.per * (x - s.last))
        return limit * (1.0 + p.rise * exp(-v * v)), PlaceState(x, 0.0)


def lowered(p, v, limit):
    """Return the limit at a speed, with any exponent."""
    v = abs(v)
    power = where(v > 0.0, exp(p.exponent * log(where(v > 0.0, v, 1.0))), 0.0)
    return limit * (1.0 + p.rise * exp(-power))


@dataclass(frozen=True, eq=False)
class StribeckPower(StribeckCurve):
    """Stribeck curve with any exponent from 1 on."""

    exponent: float

    @staticmethod
    def step(p, s, x, limit):
        v = where(s.cold > 0.0, 0.0, p.per * (x - s.last))
        return lowered(p, v, limit), PlaceState(x, 0.0)

    work = scratch(64)

    @staticmethod
    def tile(p, s, x, limit, y, w):
        v = w[: y.size]
        v[0] = where(s.cold > 0.0, 0.0, p.per * (x[0] - s.last))
        for i in range(1, y.size):
            v[i] = p.per * (x[i] - x[i - 1])
        each(lowered, p, (v, limit), y)
        return PlaceState(x[y.size - 1], 0.0)


# Parameters of `StickSlip` at a sample rate.
#   left  part of the force that a slip leaves
StickSlipParams = namedtuple("StickSlipParams", "left")


@dataclass(frozen=True, eq=False)
class StickSlip(Friction):
    """A spring that sticks until it slips: a sawtooth force over position.

    When |z| reaches c, it drops to left c; up to there dz = dx. Any number of slips may
    lie in one sample.

    Each slip shortens the deflection by q = c - left c. The area under the sawtooth is
    the sum of the part up to c, of whole teeth (each q long, with the mean c - q/2),
    and of the rest, which begins at left c. No part is negative, so nothing cancels,
    however many slips there are.
    """

    left: float

    def check(self):
        if not 0 <= self.left < 1:
            raise BadValue(
                f"stick_slip: left = {self.left:g} must be 0 or above and below 1: a slip makes the"
                " force smaller"
            )

    def design(self, fs):
        return StickSlipParams(self.left), FrictionState(0.0, 0.0, 0.0, 1.0)

    @staticmethod
    def step(p, s, x, limit, stiffness):
        k = held(stiffness)
        c = deflection(limit, k)
        q = c - p.left * c
        z = within(softened(s.z, s.k, k), c)
        dx = where(s.cold > 0.0, 0.0, x - s.last)
        t = z + dx
        more = abs(t) - c
        sticks = where(q > TINY, 1.0, 0.0)
        # whole ones, between the first slip and the last
        teeth = where(more > 0.0, floor(over(more, q)) * q, 0.0)
        rest = between(more - teeth, 0.0, q)
        area = 0.5 * (c - z) * (c + z) + teeth * (c - 0.5 * q) + rest * (c - q + 0.5 * rest)
        mean = where(more > 0.0, sign(t) * over(area, abs(dx)), z + 0.5 * dx)
        none = 0.0 * q  # where nothing can stick
        after = where(sticks > 0.0, where(more > 0.0, sign(t) * (c - q + rest), t), none)
        return k * where(sticks > 0.0, mean, none), FrictionState(x, after, k, 0.0)


@public
def friction(
    x: Block,
    normal: Block | float,
    mu: Block | float = 0.6,
    stiffness: Block | float = 1000.0,
    law: Literal["elastoplastic", "coulomb", "dahl", "lugre"] = "elastoplastic",
    *,
    elastic: float = 0.7,
    static: float | None = None,
    speed: float = 0.02,
    exponent: float = 2.0,
    damping: float = 0.0,
    viscosity: float = 0.0,
    passive: bool = True,
    contact: Block | float = 1.0,
) -> Block:
    r"""Compute dry friction, including sticking, from position alone.

    Each sample is the mean force over the straight path since the last sample.

    A spring of the given stiffness between finger and surface has the deflection z. It
    slips at c = mu normal/stiffness. With s the direction of dx, and b = elastic c:

    * ``"coulomb"``: dz = dx while \|z\| < c (a Prandtl element, a god object on a
      line);
    * ``"elastoplastic"``: dz = dx while s z < b, then dz = (1 - (s z - b)/(c - b)) dx.
      Below b it is a spring, so nothing drifts;
    * ``"dahl"``: dz = (1 - s z/c) dx. It **drifts** under vibration that never reaches
      c;
    * ``"lugre"``: Dahl's law with c(v) from the Stribeck curve, and F = stiffness z +
      damping dz/dt + viscosity v. It drifts too.

    If ``static`` is given, the coefficient of friction is mu + (static - mu)
    exp(-(v/speed)^exponent), where v is the mean speed during the sample: it is larger
    at low speed.

    Parameters
    ----------
    x : Block
        Position in m.
    normal : float or Block
        Normal force in N. A signal below 0 counts as 0: no friction.
    mu : float or Block
        Coefficient of friction while sliding.
    stiffness : float or Block
        In N/m; 500 to 1500 for a finger pad. A signal below 0 counts as 0: no friction.
    law : {"elastoplastic", "coulomb", "dahl", "lugre"}
        The last two are for those who reproduce a paper.
    elastic : float
        Part b/c of the way to the limit that is a spring, for ``"elastoplastic"``; 0 or
        above, below 1.
    static : float, optional
        Coefficient at rest, not below mu, which must be a number then; usually 1.2 to
        1.5 times mu.
    speed : float
        Stribeck's speed in m/s, usually 5 to 50 mm/s.
    exponent : float
        Of Stribeck's curve, at least 1: 2 in the LuGre paper, 1 in Tustin's model.
    damping, viscosity : float
        In N s/m, for ``"lugre"``.
    passive : bool
        Refuse what may give energy: LuGre takes no more than it got only if viscosity
        >= damping (static/mu - 1).  False, to reproduce a paper whose numbers break it.
    contact : Block
        Where it is not above 0 the force is 0 and x is not looked at. At re-contact, as
        at the first sample, z = 0.

    Returns
    -------
    Block
        Force of the hand on the surface in N, in the direction of the movement: sum F
        dx is the work taken from the hand.

    Raises
    ------
    BadValue
        A normal force, mu, damping or viscosity below 0; stiffness or speed not above
        0; exponent below 1; elastic outside [0, 1); static below mu, or with a mu that
        is a signal; damping or viscosity for another law; an unknown law; a LuGre that
        is not passive.
    UnitError
        Units that do not fit: stiffness times x is the unit of mu times normal. So
        torques over angles are fine.

    Notes
    -----
    Passive: over any motion, and for signals normal, mu and stiffness that change as
    they like, sum F dx >= stiffness z^2/2 up to rounding. Where the stiffness rises, z
    falls so that the force stays; else a stiffness that follows the normal force, as
    that of fingers does, gives energy. That holds for the force at the time of the
    movement; a device that is a sample late needs damping: see
    ``stimlib.analysis.passivity.needed_damping``.

    References
    ----------
    Dahl, "A solid friction model", Aerospace Corp. TOR-158 (1968). Canudas de Wit,
    Olsson, Åström and Lischinsky, "A new model for control of systems with friction",
    IEEE Trans. Autom. Control 40 (1995), eqs. 1 to 4. Dupont, Hayward, Armstrong and
    Altpeter, "Single state elastoplastic friction models", IEEE Trans. Autom. Control
    47 (2002); its sine is a straight line here, which has a solution. Hayward and
    Armstrong, "A new computational model of friction applied to haptic rendering"
    (2000): friction from positions.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import friction
    >>> x = stimlib.Input("x", "m")
    >>> proc = stimlib.compile(
    ...     stimlib.Scene(
    ...         {"F": friction(x, normal=1.0, mu=0.5, stiffness=1000.0, law="coulomb")}
    ...     ),
    ...     fs=1000,
    ... )
    >>> proc.process(1e-3 * np.array([[0.0, 0.2, 0.4, 1.0, 2.0, 1.9]])).round(
    ...     3
    ... )  # 0.5 mm stick
    array([[0.   , 0.1  , 0.3  , 0.492, 0.5  , 0.45 ]])
    """
    if law != "lugre" and (damping or viscosity):
        raise BadValue(
            "friction: damping and viscosity belong to law='lugre'; with another law, add"
            " constant(b,"
            " 'N*s/m') * velocity(x)"
        )
    x, contact = as_block(x), as_block(contact)
    normal = amount("friction", "normal", normal, "N", why=": it presses the surfaces together")
    mu, k = (
        amount("friction", "mu", mu, ""),
        amount("friction", "stiffness", stiffness, "N/m", zero=False),
    )
    limit = most = mu * normal
    if static is not None:
        ratio = _ratio(mu, static)
        if law == "lugre" and passive and viscosity < damping * (ratio - 1):
            raise BadValue(
                f"friction: this LuGre gives energy at some speeds: viscosity = {viscosity:g} must"
                f" be at least damping (static/mu - 1) = {damping * (ratio - 1):g} N s/m; or set"
                " passive=False, to reproduce a paper"
            )
        curve = x, limit, contact, ratio - 1, speed
        most = ratio * limit
        limit = Stribeck(*curve) if exponent == 2 else StribeckPower(*curve, exponent)
    if law == "lugre":
        return LuGre(x, limit, most, k, contact, damping, viscosity)
    if law == "elastoplastic":
        return ElastoPlastic(x, limit, k, contact, elastic)
    return (Coulomb if law == "coulomb" else Dahl)(x, limit, k, contact)


def _ratio(mu: Block, static: float) -> float:
    """Return static/mu; raise BadValue where it cannot be computed."""
    if not isinstance(mu, Const):
        raise BadValue(
            "friction: static needs a mu that is a plain number; multiply normal by the signal"
            " instead"
        )
    if not static >= mu.value > 0:
        raise BadValue(
            f"friction: static = {static!r} must be at least mu = {mu.value:g}, and mu above 0"
        )
    return static / mu.value


@public
def stick_slip(
    x: Block,
    normal: Block | float,
    static: Block | float = 0.8,
    kinetic: float = 0.5,
    stiffness: Block | float = 1000.0,
    contact: Block | float = 1.0,
) -> Block:
    """Compute the force of a surface that sticks like a spring and slips repeatedly.

    The force is a sawtooth over position: it rises to static * normal, then falls to a
    fraction of it.

    The teeth are (static - kinetic) normal/stiffness apart, at any speed; moving at
    speed v thus gives a vibration with the frequency v divided by this distance. Each
    sample is the exact mean over its path, with any number of slips.

    Parameters
    ----------
    x : Block
        Position in m.
    normal : float or Block
        Normal force in N. A signal below 0 counts as 0: no friction.
    static, kinetic : float
        Coefficients at which it slips, and which a slip leaves: 0 <= kinetic < static.
    stiffness : float or Block
        In N/m. A signal below 0 counts as 0: no friction.
    contact : Block
        Where it is not above 0 the force is 0 and x is not looked at. At re-contact, as
        at the first sample, nothing is strained.

    Returns
    -------
    Block
        Force of the hand on the surface in N, as of ``friction``.

    Raises
    ------
    BadValue
        A normal force below 0, a stiffness not above 0, kinetic outside [0, static).
    UnitError
        Units that do not fit, as of ``friction``.

    Notes
    -----
    Passive, as ``friction``: every slip loses (static^2 - kinetic^2) normal^2/(2
    stiffness).

    References
    ----------
    Our own; the sawtooth of Hayward and Armstrong, "A new computational model of
    friction applied to haptic rendering" (2000), with the slip at its place inside the
    sample.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import stick_slip
    >>> scene = stimlib.Scene(
    ...     {
    ...         "F": stick_slip(
    ...             stimlib.Input("x", "m"),
    ...             normal=1.0,
    ...             static=0.8,
    ...             kinetic=0.4,
    ...             stiffness=1000.0,
    ...         )
    ...     }
    ... )
    >>> proc = stimlib.compile(scene, fs=1000)
    >>> proc.process(1e-3 * np.array([[0.0, 0.4, 0.8, 1.0, 1.2, 5.2]])).round(
    ...     3
    ... )  # teeth of 0.4 mm
    array([[0. , 0.2, 0.6, 0.5, 0.7, 0.6]])
    """
    normal = amount("stick_slip", "normal", normal, "N", why=": it presses the surfaces together")
    top = amount("stick_slip", "static", static, "", zero=False)
    if not isinstance(top, Const):
        raise BadValue(
            "stick_slip: static must be a plain number; multiply normal by the signal instead"
        )
    k = amount("stick_slip", "stiffness", stiffness, "N/m", zero=False)
    return StickSlip(as_block(x), top * normal, k, as_block(contact), kinetic / top.value)


# Walls, detents and buttons ---------------------------------------------------------
# Walls, detents and buttons from positions alone: each sample is the mean force over
# the straight way since the last one.
#
# A mean over the way has the work of the force itself, so nothing is conserved or lost
# but what the force over place says. Only sums and products are used, no mathematical
# library.
PI = 3.141592653589793


@public
def squeeze_film(
    normal: Block | float,
    amplitude: Block | float,
    gap: Above0 = 10e-6,
    area: Above0 = 1e-4,
    pressure: Above0 = 101325.0,
) -> Block:
    """Compute the load of a finger on a plate that vibrates by ultrasound.

    The air between finger and plate has no time to flow out, and its mean pressure
    rises. It carries a part of the normal force, and the roughness of the skin the
    rest:

    N' = max(0, normal - area pressure (sqrt((1 + 3/2 e^2)/(1 - e^2)) - 1)), e =
    amplitude/gap.

    Dry friction follows from N': ``friction(x, squeeze_film(normal, a), mu)``.

    Parameters
    ----------
    normal : float or Block
        Normal force in N.
    amplitude : float or Block
        Amplitude of the plate's vibration in m, such as ``first_order(V, q/(pi freq))``
        times the displacement for each volt: the envelope of a plate that is driven at
        its resonance.  Its sign does not count.
    gap : float
        Mean distance between plate and skin in m.
    area : float
        Of the film of air in m^2.
    pressure : float
        Of the air around, in Pa.

    Returns
    -------
    Block
        In N, from 0 (the finger floats) to the normal force.

    Raises
    ------
    BadValue
        gap, area or pressure not above 0; a normal force or an amplitude below 0.
    UnitError
        A normal force that is not in N, an amplitude that is not in m.

    Notes
    -----
    Valid where air cannot escape, for squeeze numbers 12 eta w (area/pi)/(pressure
    gap^2) of 10 and above (eta = 18.5 uPa s; 131 for these defaults at 30 kHz), and for
    amplitudes below the gap: e^2 is held at 0.98. For small e the pressure is 5/4 e^2
    above that of the air around.

    The gap is a constant here. That of a finger grows while air lifts it, so friction
    falls more slowly near its end than here; the default is our own choice, which
    halves 0.5 N at 1.4 um. Fit the gap to the friction of your own plate.

    References
    ----------
    Salbu, "Compressible squeeze films and squeeze bearings", Journal of Basic
    Engineering 86 (1964) 355: the limit of large squeeze numbers. Wiertlewski, Fenton
    Friesen and Colgate, "Partial squeeze film levitation modulates fingertip friction",
    PNAS 113 (2016) 9210: asperities and air share the load. The touch-screen thesis,
    chapter 7, has it as future work.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import squeeze_film
    >>> load = squeeze_film(0.5, stimlib.Input("a", "m"))
    >>> proc = stimlib.compile(stimlib.Scene({"load": load}), fs=1000)
    >>> proc.process(1e-6 * np.array([[0.0, 1.0, 1.4, 2.0]])).round(3)
    array([[0.5  , 0.373, 0.25 , 0.   ]])
    """
    press, a = (
        _signal("squeeze_film", name, amount("squeeze_film", name, v, text), text)
        for name, v, text in (("normal", normal, "N"), ("amplitude", amplitude, "m"))
    )
    part = a / constant(gap, "m")
    e2 = pointwise.minimum(part * part, 0.98)
    over = pointwise.sqrt((1.0 + 1.5 * e2) / (1.0 - e2)) - 1.0
    return pointwise.maximum(press - constant(area * pressure, "N") * over, constant(0.0, "N"))


def not_too_small(owner: Block, *names: str) -> None:
    """Raise BadValue unless each length and its reciprocal are finite and above 0."""
    for name in names:
        if not math.isfinite(1 / getattr(owner, name)):
            raise BadValue(
                f"{name} = {getattr(owner, name):g} is too small to divide by; check the unit"
            )


# Walls --------------------------------------------------------------------------------
# Parameters of `Wall` at a sample rate.
WallParams = namedtuple("WallParams", "fs")


@dataclass(frozen=True, eq=False)
class Wall(Over):
    """A wall: the mean force of a spring and a damper over the path inside it.

    F(p) = max(0, K p + b v) for p = x - at > 0, with K = k max(0, 1 + c v) and v the
    mean speed, averaged over the path of p.
    """

    x: Block
    k: Block
    b: Block
    at: Block
    c: Block  # s/m
    contact: Block

    def units(self, *u):
        force = u[1] * u[0]
        if u[2] * u[0] / unit("s") != force or u[3] != u[0] or u[4] * u[0] != unit("s"):
            raise UnitError(
                f"wall: k [{u[1]}] times x [{u[0]}] is [{force}], so b must be"
                f" [{force / u[0] * unit('s')}], not [{u[2]}], at [{u[0]}], not [{u[3]}], and"
                f" hunt_crossley [{unit('s') / u[0]}], not [{u[4]}]"
            )
        return force

    def design(self, fs):
        return WallParams(fs), PlaceState(0.0, 1.0)

    def steepest(self, fs, z, H, value):
        """Return the response in contact, or None if it depends on the depth.

        How much a damping that grows with the depth is cannot be known.
        """
        if H[0] is None or None in value[1:3] or value[4] != 0:
            return None
        return averaging(fs, z, *value[1:3]) * H[0]

    @staticmethod
    def step(p, s, x, k, b, at, c):
        before = where(s.cold > 0.0, x, s.last) - at
        now = x - at
        low, high = where(before < now, before, now), where(before < now, now, before)
        v = p.fs * (now - before)
        K, w = held(k) * held(1.0 + held(c) * v), held(b) * v
        # how deep the damper still takes the spring away, when it leaves
        free = where(w < 0.0, -w / K, 0.0)
        a = where(low > free, low, free)
        part = where(high > low, (high - a) / (high - low), 1.0)
        y = part * (0.5 * K * (a + high) + w)
        return where(high > a, y, where(high > free, K * high + w, now - now)), PlaceState(x, 0.0)


@public
def wall(
    x: Block,
    k: Block | float = 1000.0,
    b: Block | float = 0.0,
    at: Block | float = 0.0,
    hunt_crossley: Block | float = 0.0,
    contact: Block | float = 1.0,
) -> Block:
    """Compute the force of a wall: a spring and a damper that push but never pull.

    With the depth p = x - at and its rate v, F = max(0, k p (1 + c v) + b v) where p >
    0, else 0. Each sample is the exact mean over its path, also where contact begins or
    ends within it.

    Parameters
    ----------
    x : Block
        Position in m; the wall is above ``at``. For one below use ``-wall(-x, k, b,
        -at)``.
    k, b : float or Block
        Stiffness in N/m, damping in N s/m. A signal below 0 counts as 0. The damper
        makes a step of force at contact.
    at : float or Block
        Place in m.
    hunt_crossley : float or Block
        Damping c in s/m that grows with the depth, without a step at contact: about 1.5
        (1 - e)/v for a restitution e of an impact at the speed v.  1 + c v counts as 0
        where it is below.
    contact : Block
        Where it is not above 0 the force is 0 and x is not looked at. At re-contact, as
        at the first sample, v = 0.

    Returns
    -------
    Block
        Force of the hand on the wall in N, 0 or above: sum F dx is the work taken from
        the hand.

    Raises
    ------
    BadValue
        A number or parameter k, b or hunt_crossley below 0.
    UnitError
        Units that do not fit; plain numbers have those above.

    Notes
    -----
    Passive while k and ``at`` stand still: sum F dx >= k p^2/2.
    A k that rises in contact gives energy, and so does a wall that moves.
    A device that is late needs damping of its own, k T/2 + b and more:
    ``stimlib.analysis.passivity.needed_damping``.

    References
    ----------
    Colgate and Schenkel, "Passivity of a class of sampled-data systems", J. Robotic
    Systems 14 (1997): the virtual wall. Hunt and Crossley, "Coefficient of restitution
    interpreted as damping in vibroimpact", J. Applied Mechanics 42 (1975).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import wall
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"F": wall(stimlib.Input("x", "m"), k=1000.0, b=2.0)}),
    ...     fs=1000,
    ... )
    >>> proc.process(1e-3 * np.array([[-1.0, 1.0, 2.0, 2.0, -2.0]])).round(
    ...     3
    ... )  # half of the second sample touches
    array([[0.  , 2.25, 3.5 , 2.  , 0.  ]])
    """
    k, b = amount("wall", "k", k, "N/m"), amount("wall", "b", b, "N*s/m")
    c = amount("wall", "hunt_crossley", hunt_crossley, "s/m")
    return Wall(as_block(x), k, b, with_unit(at, "m"), c, as_block(contact))


# Detents ------------------------------------------------------------------------------
# Parameters of detent blocks at a sample rate.
#   per  1/spacing
DetentParams = namedtuple("DetentParams", "per")


def sine_of_half_turns(h):
    """Return sin(pi h), h in half turns."""
    r = h - 2.0 * floor(0.5 * h + 0.5)  # -1 .. 1
    return sinpi(where(r > 0.5, 1.0 - r, where(r < -0.5, -1.0 - r, r)))


def averaged(d):
    """Return sin(pi d)/(pi d), the effect on a sinusoid of averaging over d periods."""
    near = abs(d) < 1.0
    return where(
        near, 1.0 - gap(where(near, d, 0.0)), sine_of_half_turns(d) / (PI * where(near, 1.0, d))
    )


@dataclass(frozen=True, eq=False)
class Detents(Over):
    """Force of detents: the mean of depth sin(2 pi x/spacing) over each movement.

    The mean from x0 to x1 is depth sin(pi (x0 + x1)/spacing) sinc((x1 - x0)/spacing).
    """

    x: Block
    depth: Block
    contact: Block
    spacing: Above0

    def check(self):
        not_too_small(self, "spacing")

    def units(self, *u):
        return u[1]

    def design(self, fs):
        return DetentParams(1 / self.spacing), PlaceState(0.0, 1.0)

    def steepest(self, fs, z, H, value):
        """Return the response at rest."""
        return (
            None
            if H[0] is None or value[1] is None
            else averaging(fs, z, 2 * PI * value[1] / self.spacing) * H[0]
        )

    @staticmethod
    def step(p, s, x, depth):
        u, last = p.per * x, p.per * where(s.cold > 0.0, x, s.last)
        return depth * sine_of_half_turns(last + u) * averaged(u - last), PlaceState(x, 0.0)


@public
def detents(
    x: Block, spacing: float, depth: Block | float = 1.0, contact: Block | float = 1.0
) -> Block:
    """Compute the force of detents: regularly spaced positions that attract the hand.

    F = depth sin(2 pi x/spacing).

    The rest positions are the multiples of the spacing. Each sample is the exact mean
    over its path, however long that is. So the detents neither supply nor absorb work
    between rest positions, and a fast hand misses none of them.

    Parameters
    ----------
    x : Block
        Position in m, or angle of a knob in rad.
    spacing : float
        In the unit of x, above 0.
    depth : float or Block
        Largest force in N, or signal of any unit, such as N m of a knob.
    contact : Block
        Where it is not above 0 the force is 0 and x is not looked at. At re-contact the
        way between counts nothing.

    Returns
    -------
    Block
        Force of the hand in the unit of depth: sum F dx is the work taken from the
        hand.

    Raises
    ------
    BadValue
        A spacing not above 0; a number or parameter depth below 0.

    Notes
    -----
    Conserves energy while depth stands still: over any closed way sum F dx = 0 up to
    rounding.  Its stiffness is 2 pi depth/spacing at rest:
    ``stimlib.analysis.passivity.needed_damping``.  Friction is added with ``+
    friction(..)``.

    References
    ----------
    Our own; the mean of a sinusoid over a way is that of ``bump``.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import detents
    >>> angle, turn = stimlib.Input("angle", "rad"), 2 * np.pi
    >>> torque = detents(angle, spacing=turn / 24, depth=stimlib.constant(0.02, "N m"))
    >>> proc = stimlib.compile(stimlib.Scene({"torque": torque}), fs=1000)
    >>> proc.process(turn / 24 * np.array([[0.25, 0.25, 0.5, 1.5, 2.0]])).round(4) + 0.0
    array([[ 0.02  ,  0.02  ,  0.0127,  0.    , -0.0127]])
    """
    return Detents(as_block(x), amount("detents", "depth", depth, "N"), as_block(contact), spacing)


# Buttons ------------------------------------------------------------------------------
# Parameters of `Button` at a sample rate.
#   drop  of the force at the snap, as a part of the peak
ButtonParams = namedtuple("ButtonParams", "at back drop")

# State of `Button` between samples.
ButtonState = namedtuple("ButtonState", "last pressed cold")


@dataclass(frozen=True, eq=False)
class Button(Over):
    """A button: the mean force over the path, with a snap.

    F = peak (max(0, x)/at - drop q), where q is 1 from the snap at x >= at until x <
    back, else 0.
    """

    x: Block
    peak: Block
    contact: Block
    at: Above0
    back: Above0
    drop: float
    outputs = ("force", "pressed")

    def check(self):
        not_too_small(self, "at", "back")
        if not 0 <= self.drop < 1:
            raise BadValue(
                f"button: drop = {self.drop:g} must be 0 or above and below 1, a part of the peak"
                " force"
            )
        if not self.drop * self.at <= self.back <= self.at:
            raise BadValue(
                f"button: back = {self.back:g} must lie in drop at = {self.drop * self.at:g} .. at"
                f" = {self.at:g}: above that range the button would supply energy, and below it"
                " pull the finger"
            )

    def units(self, *u):
        return u[1], unit("")

    def design(self, fs):
        return ButtonParams(self.at, self.back, self.drop), ButtonState(0.0, 0.0, 1.0)

    def steepest(self, fs, z, H, value):
        """Return the response between snaps, as a snap only absorbs energy."""
        return (
            None
            if H[0] is None or value[1] is None
            else (averaging(fs, z, value[1] / self.at) * H[0], 0.0 * H[0])
        )

    @staticmethod
    def step(p, s, x, peak):
        last = where(s.cold > 0.0, x, s.last)
        was = where(s.pressed > 0.0, 1.0, 0.0)
        now = where(was > 0.0, where(x < p.back, 0.0, 1.0), where(x >= p.at, 1.0, 0.0))
        way = x - last
        low, high = where(way < 0.0, x, last), where(way < 0.0, last, x)
        snap = where(now > was, p.at, p.back)
        # of the way beyond the snap, which is pressed
        part = (high - snap) / where(way == 0.0, 1.0, high - low)
        share = where(now == was, now, where(way == 0.0, now, part))
        rest = where(low > 0.0, low, 0.0)
        pushed = where(
            high > 0.0,
            0.5 * (rest + high) * where(high > low, (high - rest) / (high - low), 1.0),
            high - high,
        )
        return (peak * (pushed / p.at - p.drop * share), now), ButtonState(x, now, 0.0)


@public
def button(
    x: Block,
    peak: Block | float = 2.0,
    drop: float = 0.4,
    at: float = 1e-3,
    back: float | None = None,
    contact: Block | float = 1.0,
) -> Any:
    """Compute the force of a button that snaps.

    The force rises linearly, drops at the snap, and rises again; on release it comes
    back at a smaller depth.

    F = peak (x/at - drop q) for x > 0: q becomes 1 where x reaches ``at``, with the
    force at its peak, and 0 again where x falls below ``back``. Each sample is the
    exact mean over its path, with the snap at its position within the sample. Add a
    ``wall`` for the bottom, and a ``ring`` of ``rising(button.pressed)`` for a
    vibration or a sound at the snap.

    Parameters
    ----------
    x : Block
        Travel in m, 0 where the finger meets the button.
    peak : float or Block
        Force at the snap in N, 0 or above.
    drop : float
        Part of the peak by which the force falls, 0 .. 1.
    at, back : float
        Travel in m of the snap, and of the way back; back = 0.8 at by default, between
        drop at and at.
    contact : Block
        Where it is not above 0 force and pressed are 0 and x is not looked at; at
        re-contact, as at the first sample, the button is pressed if x >= at.

    Returns
    -------
    Block
        Two signals: ``.force`` of the hand in N, 0 or above, and ``.pressed``, 1 behind
        the snap, else 0.

    Raises
    ------
    BadValue
        peak below 0, drop outside [0, 1), at not above 0, back outside [drop at, at].

    Notes
    -----
    Passive while peak stands still: each press and release loses peak drop (at - back).

    References
    ----------
    Our own, of two straight lines, and so are its numbers.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import button
    >>> key = button(stimlib.Input("x", "m"), peak=2.0, drop=0.5, at=1e-3)
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"F": key.force, "pressed": key.pressed}), fs=1000
    ... )
    >>> proc.process(1e-3 * np.array([[0.0, 0.5, 1.5, 1.5, 0.9, 0.7]])).round(3) + 0.0
    array([[0. , 0.5, 1.5, 2. , 1.4, 1.1],
           [0. , 0. , 1. , 1. , 1. , 0. ]])
    """
    peak = amount("button", "peak", peak, "N")
    return Button(
        as_block(x), peak, as_block(contact), at, 0.8 * at if back is None else back, drop
    )


# The actuator: limits of force, slew and current ------------------------------------
# From a wanted force to what a motor is given: the skin's damper, limits of force, and
# current.
class Geometry(NamedTuple):
    """Geometry factor of a motor over position."""

    x: tuple[float, ...]  # m, rising
    gamma: tuple[float, ...]  # without unit, above 0


PLACEHOLDER_GAMMA = Geometry((0.0, 0.01, 0.02, 0.03, 0.04), (0.85, 0.96, 1.0, 0.96, 0.85))
"""NOT measured: the paper prints no numbers for Gamma(x).  A symmetric guess over the
0.04 m of travel, so that scenes run before a device has been calibrated; replace it by
a measurement."""


def _quantity(who: str, name: str, v: Block | float, text: str) -> Block:
    """Return a quantity as a signal with the given unit.

    A plain number, which must be above 0, gets the unit; a signal must have it already.
    """
    b = as_block(v)
    if isinstance(b, Const):
        if not (math.isfinite(b.value) and b.value > 0):
            raise BadValue(f"{who}: {name} = {b.value:g} must be a finite number above 0")
    return _signal(who, name, with_unit(b, text), text)


def _signal(who: str, name: str, v: Block | float, text: str) -> Block:
    b = as_block(v)
    in_unit(f"{who}: {name}", b, b.dim, text)
    return b


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
    """A force clipped to -peak .. peak.

    NaN and infinity pass, so that the guard of the output detects them.
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
    """Clip a force to the motor's peak force in both directions.

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
    return StaticLimit(_signal("static_limit", "force", force, "N"), limit, tau)


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
    gamma = np.asarray(geometry[1], float)
    if not (gamma > 0).all():
        at = int(np.argmin(gamma > 0))
        raise BadValue(
            f"motor_current: Gamma[{at}] = {gamma.flat[at]:g} must be above 0, as all of Gamma"
        )
    constant_ = _quantity("motor_current", "motor_constant", motor_constant, "N/A")
    factor = lut(_signal("motor_current", "x", x, "m"), geometry[0], gamma, kind=kind)
    return _signal("motor_current", "force", force, "N") / (constant_ * factor)
