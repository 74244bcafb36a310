"""Walls, squeeze films, detents and buttons."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass
from typing import Any

from ..core import pointwise
from ..core.graph import Block, as_block, constant
from ..core.maths import where
from ..core.units import unit
from ..errors import Above0, BadValue, UnitError, public
from .friction import amount, averaging, held, quantity
from .impedance import with_unit
from .movement import PI, Over, PlaceState, averaged, sine_of_half_turns

# Walls, detents and buttons from positions alone: each sample is the mean force over
# the straight way since the last one.
#
# A mean over the way has the work of the force itself, so nothing is conserved or lost
# but what the force over place says. Only sums and products are used, no mathematical
# library.


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
        quantity("squeeze_film", name, v, text)
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
    mean rate of p, averaged over the path of p.
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
        now = x - at
        before = where(s.cold > 0.0, now, s.last)
        low, high = where(before < now, before, now), where(before < now, now, before)
        v = p.fs * (now - before)
        K, w = held(k) * held(1.0 + held(c) * v), held(b) * v
        # how deep the damper still takes the spring away, when it leaves
        free = where(w < 0.0, -w / K, 0.0)
        a = where(low > free, low, free)
        part = where(high > low, (high - a) / (high - low), 1.0)
        y = part * (0.5 * K * (a + high) + w)
        return where(high > a, y, where(high > free, K * high + w, now - now)), PlaceState(now, 0.0)


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
        Place in m.  One that moves is damped as a hand that moves towards it.
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
                f"button: back = {self.back!r} must lie in drop at = {self.drop * self.at!r} .. at"
                f" = {self.at!r}: above that range the button would supply energy, and below it"
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
        re-contact, as at the first sample, the button is pressed if x >= at. That is
        no snap: ``rising(button.pressed) * delay(contact > 0, 1)`` leaves it out.

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
