"""Dry friction from positions alone: Coulomb, Dahl, LuGre, stick-slip."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass
from typing import Literal

from ..core.graph import Block, Const, as_block, scratch
from ..core.maths import each, exp, floor, log, where
from ..core.parameter import Param
from ..core.response import backward
from ..errors import Above0, BadValue, From0, UnitError, public
from .impedance import signal_in, with_unit
from .movement import Over, PlaceState

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
LEAST = 1e-300  # m of a slip: shorter ones count as none
# below the first, lengths are multiplied by the second before they are squared
SHORT, LONGER = 1e-150, 2.0**1000


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


def quantity(who: str, name: str, v, text: str, zero: bool = True) -> Block:
    """Return an ``amount``; raise UnitError if it is a signal in another unit."""
    return signal_in(who, name, amount(who, name, v, text, zero), text)


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
    """Return exp(-a) and the mean of the decay, (1 - exp(-a))/a, for a >= 0.

    The third is what is missing from the mean to 1, which is small where a is.
    """
    e = exp(-a)
    missing = a * (1 / 2 - a * (1 / 6 - a * (1 / 24 - a * (1 / 120 - a / 720))))
    mean = where(a < 0.01, 1.0 - missing, over(1.0 - e, a))
    return e, mean, where(a < 0.01, missing, 1.0 - mean)


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


def begun(s, x, limit, stiffness):
    """Return stiffness, slip deflection and deflection of a sample, and its way."""
    k = held(stiffness)
    c = deflection(limit, k)
    return k, c, within(softened(s.z, s.k, k), c), where(s.cold > 0.0, 0.0, x - s.last)


# The laws -----------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Coulomb(Friction):
    """Coulomb friction with a spring: dz = dx while |z| < c."""

    @staticmethod
    def step(p, s, x, limit, stiffness):
        k, c, z, dx = begun(s, x, limit, stiffness)
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
        k, c, z, dx = begun(s, x, limit, stiffness)
        b, u, a = p.elastic * c, sign(dx) * z, abs(dx)
        rest = held(b - u)  # of the elastic way
        e = where(a > rest, rest, a)
        flow, d = a - e, c - (u + e)
        left, mean, _ = relax(where(c > b, over(flow, c - b), 0.0))
        after = where(a > rest, c - d * left, u + a)
        r = over(e, a)
        m = where(a <= rest, u + 0.5 * a, r * (u + 0.5 * e) + (1.0 - r) * (c - d * mean))
        return k * sign(dx) * m, FrictionState(x, sign(dx) * after, k, 0.0)


def drawn(z, c, dx):
    """Return by how much a path of Dahl's law deflects, at its end and in the mean.

    The law is dz = (1 - s z/c) dx. A path that is short beside c keeps its digits.
    """
    a, room = where(c > 0.0, over(abs(dx), c), 0.0), sign(dx) * c - z
    left, mean, missing = relax(a)
    return room * where(a < 0.01, a * mean, 1.0 - left), room * missing


@dataclass(frozen=True, eq=False)
class Dahl(Friction):
    """Dahl friction: dz = (1 - s z/c) dx, where s is the direction of dx."""

    @staticmethod
    def step(p, s, x, limit, stiffness):
        k, c, z, dx = begun(s, x, limit, stiffness)
        more, mean = drawn(z, c, dx)
        return k * (z + mean), FrictionState(x, z + more, k, 0.0)


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
        k, _, z, dx = begun(s, x, static, stiffness)
        c = deflection(limit, k)
        more, mean = drawn(z, c, dx)
        more, mean = where(c > 0.0, more, 0.0 * c - z), where(c > 0.0, z + mean, 0.0 * c)
        return k * mean + p.damping * more + p.viscosity * dx, FrictionState(x, z + more, k, 0.0)


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
        k, c, z, dx = begun(s, x, limit, stiffness)
        q = c - p.left * c
        t = z + dx
        more = abs(t) - c
        sticks = where(q > LEAST, 1.0, 0.0)
        # whole ones, between the first slip and the last
        teeth = where(more > 0.0, floor(over(more, q)) * q, 0.0)
        rest = between(more - teeth, 0.0, q)
        up = where(c < SHORT, LONGER, 1.0)
        area = 0.5 * (up * (c - z)) * (c + z) + up * teeth * (c - 0.5 * q)
        area = area + up * rest * (c - q + 0.5 * rest)
        mean = where(more > 0.0, sign(t) * over(area, up * abs(dx)), z + 0.5 * dx)
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
                f" be at least damping (static/mu - 1) = {float(damping * (ratio - 1))!r} N s/m; or"
                " set passive=False, to reproduce a paper"
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
