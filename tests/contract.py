"""One table of all blocks: what each looks like, what drives it, and which physical law
it claims to follow.

Every final class of stimlib must have an example here (``missing`` finds them by
reflection); the laws of ``tests/test_laws.py`` then run over all of them.  Physical
laws are those of ``stimlib.design.responses`` and of ``closed_forms``, with the numbers
that each example should have written by hand.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature
from typing import NamedTuple

import closed_forms
import numpy as np

import stimlib
from stimlib import Input, Param, Scene, blocks as b, constant
from stimlib.blocks import (
    bump,
    carrier,
    compliance_generalized_kelvin_voigt,
    compliance_kelvin_voigt,
    compliance_maxwell,
    generalized_maxwell,
    maxwell,
    standard_linear_solid,
    track,
    track_velocity,
)
from stimlib.blocks.actuator import (
    ForceLimit,
    Passive,
    ResponseLimit,
    Tally,
    force_limit,
    motor_current,
    slew_limit,
    static_limit,
)
from stimlib.blocks.noise import PinkNoise, White
from stimlib.blocks.onset import First
from stimlib.blocks.springpots import PathLength
from stimlib.core.graph import Block, registry
from stimlib.core.guard import Guard
from stimlib.design import responses as law
from stimlib.design.responses import Law
from stimlib.design.texture import made_up

for name in b.__all__:
    getattr(b, name)  # registers all classes

# The gain of a differentiator at its pass edge is the scale of errors in its stop band.
EDGE = 2 * np.pi * 1000.0
STOP_BAND = Law(
    lambda fs: np.linspace(1500.0, fs / 2, 500),
    lambda f, fs: np.full(f.shape, EDGE),
    1e-6,
    "stop band",
    lambda H, f, fs: EDGE + H,
)


RINGS = np.exp(-np.arange(40) / 9) * np.cos(np.arange(40) / 2)


# What drives an input -----------------------------------------------------------------
def normal(rng, n, fs):
    return rng.standard_normal(n)


def positive(rng, n, fs):
    return np.abs(rng.standard_normal(n)) + 1e-3


def ties(rng, n, fs):
    """Few values, so that comparisons meet equality; zeros of both signs."""
    return rng.choice([-1.0, -0.5, -0.0, 0.0, 0.5, 1.0, 2.0], n)


def held(rng, n, fs):
    """Steps with long holds."""
    return np.repeat(rng.standard_normal(n // 29 + 1), 29)[:n]


def squeeze(rng, n, fs):
    """A finger: presses and releases a few centimetres, holds in between, read in steps
    of 1 um.
    """
    t = np.arange(n) / fs
    raw = (
        0.02
        * (1 - np.cos(2 * np.pi * 9 * t + rng.uniform(0, 6)))
        * (np.sin(2 * np.pi * 1.3 * t) > -0.3)
    )
    return np.round(raw * 1e6) * 1e-6


def phase(rng, n, fs):
    """A finger over bumps, up to many of them in one sample."""
    return np.cumsum(
        rng.standard_normal(n) * rng.choice([0.0, 1e-5, 1e-2, 0.3, 4.0], n // 50 + 1).repeat(50)[:n]
    )


def angle(rng, n, fs):
    return 30 * rng.standard_normal(n)


def sparse(rng, n, fs):
    """Events: the first sample, and one in fifty, of any height."""
    y = np.where(rng.random(n) < 0.02, rng.standard_normal(n), 0.0)
    y[:1] = 1.5
    return y


def timed(x):
    """What begins with a run: the time, noise in a gate, a parameter in there, a delay,
    and a filter that has settled.
    """
    noise = Param("g", 0.5) * b.delay(b.pink_noise(1.0, 4, 1, 20.0), 9)
    return b.elapsed() / constant(0.01, "s") * b.delay(x, 3) + b.enabled(noise, by=x > 0.0)


# The table ----------------------------------------------------------------------------
@dataclass(frozen=True)
class Entry:
    """An example of a block class.

    ``make`` gives the block over inputs named like its arguments; ``drive`` names the
    signal of each input.
    """

    name: str
    cls: str
    make: Callable[..., Block]
    drive: tuple[Callable, ...] = ()
    lti: bool = False
    laws: tuple[Law, ...] = ()
    rates: tuple[float, ...] = (8000.0, 1000.0)
    unit: str = ""
    settle: int = 1 << 16  # samples until the impulse response is below rounding
    # whether its output jumps where an input passes a place: the derivative is that of
    # the parts between
    edges: bool = False
    # how far samples may move where the block began earlier, in parts of the largest
    late: float = 0.0

    @property
    def inputs(self) -> tuple[str, ...]:
        return tuple(signature(self.make).parameters)

    def block(self) -> Block:
        return self.make(*(Input(n, self.unit) for n in self.inputs))

    def scene(self, **more) -> Scene:
        """The block as output y, and times a parameter as output z."""
        block = self.block()
        return Scene({"y": block, "z": Param("live", 1.25) * block, **more})

    def x(self, n: int, fs: float, seed: int = 0) -> np.ndarray:
        """Rows for the inputs of ``block``, in the order of its arguments."""
        rng = np.random.default_rng([seed, n])
        return np.array([d(rng, n, fs) for d in self.drive]).reshape(len(self.drive), n)


# Laws of what is put together from blocks, written from its formula -------------------
def kelvin_voigt(k, b):
    """k + i w b, half a sample late, within (w/fs)^2/8."""

    def formula(f, fs):
        return (k + 2j * np.pi * f * b) * np.exp(-1j * np.pi * f / fs)

    return Law(
        law.band(1e-3, lambda fs: fs / 100), formula, (np.pi / 100) ** 2 / 2, f"{k:g} + i w {b:g}"
    )


def creep(chi, alpha):
    """1/(chi (i w)^alpha) of forces that are straight between samples: all aliases
    behind the spectrum of a triangle.
    """

    def formula(f, fs):
        part, end = f / fs, law.ALIASES[-1] + 0.5
        g = part[:, None] + law.ALIASES
        near = np.sum(np.sinc(g) ** 2 / (1j * g) ** alpha, axis=1)
        # all further aliases, nearly: the integrals of (i x)^-alpha/x^2 from both ends
        # on
        far = 2 * np.cos(np.pi * alpha / 2) * end ** -(1 + alpha) / (1 + alpha)
        return (near + (np.sin(np.pi * part) / np.pi) ** 2 * far) / (
            chi * (2 * np.pi * fs) ** alpha
        )

    return Law(
        law.whole_band(40),
        formula,
        1e-7,
        f"1/({chi:g} (i w)^{alpha:g}) of straight lines",
        size=law.largest,
    )


def power(chi, alpha):
    """chi (i w)^alpha, far below the sample rate."""
    low = law.band(0.01, lambda fs: fs / 1000)
    return Law(low, lambda f, fs: chi * (2j * np.pi * f) ** alpha, 4e-3, f"{chi:g} (i w)^{alpha:g}")


def state_variable(freq, q, passes):
    """(m2 s^2 + m1 s/q + m0)/(s^2 + s/q + 1) at s = i tan(pi f/fs)/tan(pi freq/fs)."""
    m2, m1, m0 = passes

    def formula(f, fs):
        s = 1j * np.tan(np.pi * f / fs) / np.tan(np.pi * freq / fs)
        return (m2 * s * s + m1 * s / q + m0) / (s * s + s / q + 1)

    return Law(
        law.whole_band(200),
        formula,
        1e-10,
        f"two poles at {freq:g} Hz, q = {q:g}",
        size=law.largest,
    )


UNEVEN = [0.3, -1.2, 0.0, 2.5, 1e-3, -0.7, 0.2, 0.9, -0.4, 0.05, 3.0]
SHAPE = [0.0, 0.5, -0.25, 1.0, 0.75], [-1.0, 0.3, 0.9, 1.0, 2.0]
ROWS = [[0.2, 0.3, 0.2, 1.0, -0.5, 0.3], [1.0, -1.0, 0.0, 2.0, -1.8, 0.0]]
BENT = [[0.5, 0.0, 0.2], [0.1, -0.3, 0.0], [-0.4, 0.0, 0.1]]
KNOTS, VALUES = [-1.5, -0.5, 0.0, 0.6, 2.0], [2.0, -1.0, 0.0, 0.5, -0.3]
FS8 = (8000.0, 48000.0)
MADE_UP = made_up(2, (0.0, 0.05, 0.15), (0.0, 1.0, 2.5))


TABLE = [
    Entry("input", "Input", lambda x: x, (normal,), lti=True, laws=(law.delay(0),)),
    Entry("const", "Const", lambda x: x + 2.5, (normal,)),
    Entry("param", "Param", lambda x: Param("b", 0.7) * x, (normal,), lti=True),
    Entry("add", "Add", lambda x, y: x + y, (normal, normal), lti=True),
    Entry("sub", "Sub", lambda x, y: x - y, (normal, normal), lti=True),
    Entry("mul", "Mul", lambda x, y: x * y, (normal, normal)),
    Entry("mul_number", "Mul", lambda x: 2.5 * x, (normal,), lti=True),
    Entry("div", "Div", lambda x, y: x / y, (normal, positive)),
    Entry("div_number", "Div", lambda x: x / 3.0, (normal,), lti=True),
    Entry("neg", "Neg", lambda x: -x, (normal,), lti=True),
    Entry("abs", "Abs", lambda x: abs(x), (ties,)),
    Entry("greater", "Greater", lambda x, y: x > y, (ties, ties), edges=True),
    Entry("at_least", "AtLeast", lambda x, y: x >= y, (ties, ties), edges=True),
    Entry("equal", "Equal", lambda x, y: x == y, (ties, ties), edges=True),
    Entry("not_equal", "NotEqual", lambda x, y: x != y, (ties, ties), edges=True),
    Entry("where", "Where", lambda x, y, z: b.where(x, y, z), (ties, normal, normal), edges=True),
    Entry("maximum", "Maximum", lambda x, y: b.maximum(x, y), (ties, ties)),
    Entry("minimum", "Minimum", lambda x, y: b.minimum(x, y), (ties, ties)),
    Entry("clip", "Minimum", lambda x: b.clip(x, -0.5, 0.7), (normal,)),
    Entry("sqrt", "Sqrt", lambda x: b.sqrt(x), (positive,)),
    Entry("exp", "Exp", lambda x: b.exp(x), (normal,)),
    Entry("log", "Log", lambda x: b.log(x), (positive,)),
    Entry("sin", "Sin", lambda x: b.sin(x), (angle,)),
    Entry("cos", "Cos", lambda x: b.cos(x), (angle,)),
    Entry("tanh", "Tanh", lambda x: b.tanh(x), (angle,)),
    Entry("nonzero", "Nonzero", lambda x: b.nonzero(x), (ties,), edges=True),
    Entry("guard", "Guard", lambda x: Guard(x), (normal,), lti=True),
    Entry(
        "delay_1",
        "Delay",
        lambda x: b.delay(x, samples=1),
        (normal,),
        lti=True,
        laws=(law.delay(1),),
    ),
    Entry(
        "delay_70",
        "Delay",
        lambda x: b.delay(x, samples=70),
        (normal,),
        lti=True,
        laws=(law.delay(70),),
    ),
    Entry(
        "delay_seconds",
        "Delay",
        lambda x: b.delay(x, seconds=0.01),
        (normal,),
        lti=True,
        laws=(law.delay(80),),
        rates=(8000.0,),
    ),
    Entry(
        "fir",
        "Taps",
        lambda x: b.fir(x, UNEVEN),
        (normal,),
        lti=True,
        laws=(closed_forms.sum_of(UNEVEN),),
    ),
    Entry(
        "fir_1",
        "Taps",
        lambda x: b.fir(x, [-2.0]),
        (normal,),
        lti=True,
        laws=(closed_forms.sum_of([-2.0]),),
    ),
    Entry(
        "differentiator",
        "Differentiator",
        lambda x: b.differentiator(x, passband=1000.0),
        (normal,),
        lti=True,
        rates=FS8,
        laws=(law.differentiator(1000.0, None, 1e-6), STOP_BAND),
    ),
    Entry(
        "differentiator_wide",
        "Differentiator",
        lambda x: b.differentiator(x),
        (normal,),
        lti=True,
        rates=(8000.0,),
        laws=(law.differentiator(None, None, 1e-6),),
    ),
    Entry(
        "differentiator_order",
        "Differentiator",
        lambda x: b.differentiator(x, 100.0, 400.0, order=40, tol=1e-4),
        (normal,),
        lti=True,
        rates=(1000.0, 1200.0),
        laws=(law.differentiator(100.0, 40, 1e-4),),
    ),
    Entry("loading", "Loading", lambda x: b.loading(b.velocity(x)), (squeeze,), edges=True),
    Entry("loading_given", "Loading", lambda x: b.loading(x, on=0.6, off=0.2), (normal,)),
    Entry(
        "velocity",
        "Velocity",
        lambda x: b.velocity(x),
        (squeeze,),
        lti=True,
        laws=(law.velocity(100.0),),
    ),
    Entry(
        "velocity_20",
        "Velocity",
        lambda x: b.velocity(x, 20.0),
        (held,),
        lti=True,
        laws=(law.velocity(20.0),),
    ),
    Entry(
        "velocity_contact",
        "Velocity",
        lambda x, c: b.velocity(x, 30.0, contact=c > 0.0),
        (squeeze, held),
    ),
    Entry(
        "track",
        "Track",
        lambda x: track(x, 40.0, max_jump=None),
        (held,),
        lti=True,
        laws=(law.tracker(40.0),),
    ),
    Entry(
        "track_velocity",
        "TrackVelocity",
        lambda x: track_velocity(x, 40.0, max_jump=None),
        (held,),
        lti=True,
        laws=(law.tracker(40.0, rate=True),),
    ),
    Entry(
        "track_contact",
        "Track",
        lambda x, c: track(x, 20.0, contact=c > 0.0, max_jump=0.5),
        (squeeze, held),
    ),
    Entry(
        "track_velocity_contact",
        "TrackVelocity",
        lambda x, c: track_velocity(x, 20.0, contact=c > 0.0),
        (squeeze, held),
    ),
    Entry(
        "bump_square",
        "LinearBump",
        lambda u, d: bump(u, "square", 0.3 + 0.2 * b.sin(d)),
        (phase, held),
    ),
    Entry(
        "bump_sawtooth",
        "LinearBump",
        lambda u, c: bump(u, "sawtooth", 0.7, contact=c > -0.5),
        (phase, held),
    ),
    Entry(
        "bump_point",
        "LinearBump",
        lambda u: bump(u, "square", 0.4, sampling="point"),
        (phase,),
        edges=True,
    ),
    Entry(
        "bump_sine",
        "SineBump",
        lambda u, c: bump(u, "sine", Param("duty", 0.5), contact=c > -0.5),
        (phase, held),
    ),
    Entry("bump_half_sine", "SineBump", lambda u: bump(u, "half_sine", 0.8), (phase,)),
    Entry("bump_table", "TableBump", lambda u: bump(u, [0.0, 0.2, 1.0, 0.3], 0.6), (phase,)),
    Entry("carrier", "Carrier", lambda: carrier(158.0, phase=0.3)),
    Entry("carrier_half", "Carrier", lambda: carrier(158.0, "half")),
    Entry(
        "carrier_live",
        "Carrier",
        lambda x: carrier(constant(100.0, "Hz") * abs(x), "full"),
        (held,),
    ),
    Entry("carrier_param", "Carrier", lambda: carrier(Param("f", 80.0, "Hz"), "half")),
    Entry("force_limit", "ForceLimit", lambda x: force_limit(x, 0.5), (normal,), unit="N"),
    Entry(
        "static_limit", "StaticLimit", lambda x: static_limit(x, 0.9, tau=0.05), (normal,), unit="N"
    ),
    Entry("slew_limit", "SlewLimit", lambda x: slew_limit(x, 900.0), (normal,)),
    Entry(
        "tally",
        "Tally",
        lambda x: Tally(x, x, ForceLimit(x, constant(0.5)), "clip", "y"),
        (normal,),
    ),
    Entry(
        "response_limit",
        "ResponseLimit",
        lambda x: ResponseLimit(x, RINGS, 1.5, None, 1),
        (normal,),
    ),
    Entry(
        "response_limit_slew",
        "ResponseLimit",
        lambda x: ResponseLimit(x, RINGS, 2.0, 1500.0, 3),
        (held,),
    ),
    Entry("active", "Active", lambda x: b.active(x, 0.5), (normal,), lti=True, unit="N"),
    Entry(
        "passive",
        "Passive",
        lambda x: Passive(
            constant(60.0, "N/m") * x,
            x,
            constant(0.9),
            1.5,
            2e-3,
            1e-3,
            3.0,
            0.5,
            0.0035,
            1e-5,
            0.02,
            2,
            1.0,
        ),
        (squeeze,),
        unit="m",
    ),
    Entry(
        "motor_current",
        "Div",
        lambda x: motor_current(constant(1.0, "N/m") * x, x, 10.0),
        (squeeze,),
        unit="m",
    ),
    Entry(
        "first_order",
        "FirstOrder",
        lambda x: b.first_order(x, 0.01),
        (normal,),
        lti=True,
        laws=(closed_forms.ramp_invariant(0.01), law.lag(0.01)),
    ),
    Entry(
        "first_order_slow",
        "FirstOrder",
        lambda x: b.first_order(x, 0.2),
        (held,),
        lti=True,
        rates=(1000.0, 4000.0),
        laws=(closed_forms.ramp_invariant(0.2), law.lag(0.2)),
    ),
    Entry(
        "first_order_fast",
        "FirstOrder",
        lambda x: b.first_order(x, 1e-5),
        (normal,),
        lti=True,
        laws=(closed_forms.ramp_invariant(1e-5),),
    ),
    Entry(
        "kelvin_voigt",
        "Add",
        lambda x: b.kelvin_voigt(x, 300.0, 2.0),
        (squeeze,),
        lti=True,
        unit="m",
        laws=(kelvin_voigt(300.0, 2.0),),
    ),
    Entry(
        "kelvin_voigt_smooth",
        "Add",
        lambda x: b.kelvin_voigt(x, 300.0, 2.0, 100.0),
        (squeeze,),
        lti=True,
        unit="m",
    ),
    Entry(
        "spring",
        "Mul",
        lambda x: b.spring(x, Param("k", 2000.0, "N/m")),
        (squeeze,),
        lti=True,
        unit="m",
    ),
    Entry(
        "pinking",
        "Pinking",
        lambda x: b.pinking(x, f_low=10.0),
        (normal,),
        lti=True,
        rates=(8000.0, 1000.0),
        laws=(law.pinking(10.0, 0.01),),
    ),
    Entry(
        "pinking_coarse",
        "Pinking",
        lambda x: b.pinking(x, f_low=30.0, tol_db=1.0),
        (held,),
        lti=True,
        rates=(1000.0, 48000.0),
        laws=(law.pinking(30.0, 1.0),),
    ),
    Entry(
        "pinking_many",
        "Pinking",
        lambda x: b.pinking(x, f_low=5.0, tol_db=1e-5),
        (normal,),
        lti=True,
        rates=(8000.0,),
        laws=(law.pinking(5.0, 1e-5),),
    ),
    Entry(
        "pink_noise",
        "PinkNoise",
        lambda: b.pink_noise(psd_1hz=0.25, seed=3, stream=2),
        laws=(law.pink_noise(0.25, 1.0, 0.01),),
        rates=(8000.0, 1000.0, 48000.0),
    ),
    Entry(
        "coloured_noise",
        "ColouredNoise",
        lambda: b.coloured_noise(2.0, seed=3, stream=4, rms=0.3, f_low=20.0),
        laws=law.coloured_noise(2.0, 0.3, 20.0, 0.01),
        rates=(8000.0, 1000.0, 48000.0),
    ),
    Entry(
        "coloured_noise_rising",
        "ColouredNoise",
        lambda: b.coloured_noise(-1.0, seed=3, stream=5, tol_db=0.1),
        laws=law.coloured_noise(-1.0, 1.0, 1.0, 0.1),
        rates=(8000.0,),
    ),
    Entry(
        "pink_of_white", "PinkNoise", lambda: PinkNoise((w := White(1)), 2.0, 20.0, 0.1) + 0.5 * w
    ),
    Entry(
        "white",
        "White",
        lambda: b.white_noise(seed=2**64 - 1, stream=2**32 - 1),
        laws=(law.delay(0),),
    ),
    Entry(
        "white_shared",
        "White",
        lambda x: b.white_noise(5) * x - b.where(x, x, b.delay(b.white_noise(6), 3)),
        (normal,),
    ),
    Entry(
        "resting_white",
        "White",
        lambda x: b.white_noise(7) * (x > 0.0) - 0.5 * (b.white_noise(8) * b.nonzero(x)),
        (ties,),
        edges=True,
    ),
    Entry(
        "resting_carrier",
        "Carrier",
        lambda x: (b.carrier(300.0) + 0.1 * b.carrier(97.0)) * (x > 0.0) + b.carrier(97.0),
        (ties,),
        edges=True,
    ),
    Entry(
        "resting_sides",
        "Where",
        lambda x: b.where(x, 0.1 - b.carrier(200.0), 2.0 * b.white_noise(9)),
        (ties,),
        edges=True,
    ),
    Entry(
        "texture",
        "Texture",
        lambda v, f: b.texture(
            constant(0.1, "m/s") * v, constant(1.0, "N") * f, MADE_UP, seed=21, shared=True
        ),
        (held, positive),
    ),
    Entry("enabled", "Enabled", lambda x: b.enabled(b.white_noise(4), by=x), (ties,), edges=True),
    Entry(
        "enabled_held",
        "Enabled",
        lambda x: b.enabled(b.delay(b.pink_noise(1.0, 4, 1, 5.0), 9), by=b.loading(x, 0.1, 0.05)),
        (held,),
    ),
    Entry(
        "enabled_live",
        "Enabled",
        lambda x: b.enabled(Param("g", 0.5) * b.white_noise(4) + Param("h", 1.0), by=x > 0.3),
        (normal,),
    ),
    Entry(
        "enabled_nested",
        "Enabled",
        lambda x: b.enabled(
            0.5
            + b.enabled(
                b.fir(b.white_noise(4), UNEVEN),
                by=b.enabled(b.white_noise(7), by=b.white_noise(8) - Param("g", -0.2)) > 0.1,
            ),
            by=b.loading(x, 0.6, 0.0001),
        ),
        (held,),
    ),
    Entry(
        "enabled_by_param",
        "Enabled",
        lambda x: x * b.enabled(b.white_noise(4), by=b.nonzero(Param("g", 1.0))),
        (normal,),
    ),
    Entry("enabled_const", "Enabled", lambda x: b.enabled(constant(2.0), by=x), (normal,)),
    Entry(
        "segment",
        "Segment",
        lambda x, c: b.segment(
            b.velocity(x, 30.0, contact=c > 0.0) * b.white_noise(4), 0.003, 0.1, seed=3
        ),
        (squeeze, held),
    ),
    Entry(
        "segments",
        "Segment",
        lambda x: sum(b.segment(timed(x), start, 0.0105) for start in (0.0, 0.011, 0.09)),
        (held,),
    ),
    Entry(
        "segment_nested",
        "Segment",
        lambda x: b.segment(
            x
            + b.segment(b.loop(lambda last: 0.5 * last + x), 0.0, 0.01)
            + b.segment(timed(x), 0.005),
            0.002,
            0.02,
        ),
        (held,),
    ),
    Entry(
        "segment_gated",
        "Enabled",
        lambda x: b.enabled(b.segment(b.elapsed() + constant(1.0, "s"), 0.001, 0.004), by=x),
        (ties,),
        edges=True,
    ),
    Entry(
        "interval", "Interval", lambda x: b.where(b.segment(x, 0.004, 0.01).by, x, -x), (normal,)
    ),
    Entry(
        "differentiated_pink",
        "Enabled",
        lambda x: (
            b.velocity(x)
            * b.enabled(
                b.differentiator(b.pink_noise(1 / np.pi, 7, f_low=10.0), 1000.0),
                by=b.loading(b.velocity(x)),
            )
        ),
        (squeeze,),
        rates=(8000.0,),
    ),
    Entry("lut", "Lut", lambda x: b.lut(x, KNOTS, VALUES), (normal,)),
    Entry(
        "lut_two",
        "Lut",
        lambda x: b.lut(x, [0.0, 1.0], [1.0, -1.0], outside="zero"),
        (ties,),
        edges=True,
    ),
    Entry("lut_even", "Lut", lambda x: b.lut(x, 0.1 * np.arange(-9, 30), np.cos), (normal,)),
    Entry(
        "lut_pchip",
        "Lut",
        lambda x: b.lut(x, KNOTS, VALUES, kind="pchip", outside="zero"),
        (normal,),
    ),
    Entry(
        "lut_cubic",
        "Lut",
        lambda x: b.lut(b.clip(x, -1.5, 2.0), KNOTS, VALUES, kind="cubic", outside="error"),
        (normal,),
    ),
    Entry(
        "squeeze",
        "Enabled",
        lambda x1: stimlib.scenes.squeeze(fingers=1).outputs["force1"],
        (squeeze,),
        rates=(8000.0,),
        unit="m",
    ),
]


# Relaxation and creep -----------------------------------------------------------------
SOFT = [(50.0, 1e-5), (30.0, 1e-3), (20.0, 0.02), (10.0, 0.2)]


TABLE += [
    Entry(
        "maxwell",
        "MaxwellArms",
        lambda y: maxwell(y, 200.0, 4.0),
        (squeeze,),
        lti=True,
        unit="m",
        laws=(closed_forms.arms([200.0], [0.02]),),
        rates=(8000.0, 1000.0, 48000.0),
    ),
    Entry(
        "maxwell_damper",
        "MaxwellArms",
        lambda y: maxwell(y, 1e13, 4.0),
        (held,),
        lti=True,
        unit="m",
        laws=(
            closed_forms.running_sum()._replace(
                law=lambda f, fs: 4.0 * fs * law.difference(f, fs), tol=1e-8
            ),
        ),
    ),
    Entry(
        "maxwell_step",
        "MaxwellArms",
        lambda y: maxwell(y, Param("k", 3.0, "N/m"), tau=0.05, onset="step"),
        (held,),
        lti=True,
        unit="m",
        laws=(closed_forms.arms([3.0], [0.05]),),
    ),
    Entry(
        "maxwell_contact",
        "MaxwellArms",
        lambda y, c: maxwell(y, 200.0, 4.0, contact=c > constant(0.0, "m")),
        (squeeze, held),
        unit="m",
    ),
    Entry(
        "generalized_maxwell",
        "MaxwellArms",
        lambda y: generalized_maxwell(y, 70.0, SOFT),
        (squeeze,),
        lti=True,
        unit="m",
        laws=(closed_forms.arms(*zip(*SOFT, strict=True), 70.0),),
    ),
    Entry(
        "generalized_maxwell_many",
        "MaxwellArms",
        lambda y, c: generalized_maxwell(
            y, 5.0, [(1.0 + i, 1e-6 * 10**i) for i in range(19)], onset="step", contact=c > 0.0
        ),
        (held, held),
        unit="m",
    ),
    Entry(
        "standard_linear_solid",
        "MaxwellArms",
        lambda y: standard_linear_solid(y, Param("k0", 7.0, "N/m"), 3.0, 0.1),
        (squeeze,),
        lti=True,
        unit="m",
        laws=(closed_forms.arms([3.0], [0.1], 7.0),),
    ),
    Entry(
        "compliance_kelvin_voigt",
        "KelvinChain",
        lambda f: compliance_kelvin_voigt(f, 200.0, 4.0),
        (held,),
        lti=True,
        unit="N",
        laws=(closed_forms.chain(0.0, [1 / 200], [0.02], 0.0),),
    ),
    Entry(
        "compliance_maxwell",
        "KelvinChain",
        lambda f: compliance_maxwell(f, 200.0, 4.0),
        (held,),
        unit="N",
        laws=(closed_forms.chain(1 / 200, [], [], 1 / 4),),
    ),
    Entry(
        "compliance_live",
        "KelvinChain",
        lambda f: compliance_maxwell(f, constant(50.0, "N/m") + Param("k", 1.0, "N/m"), tau=0.1),
        (normal,),
        unit="N",
        laws=(closed_forms.chain(1 / 51, [], [], 1 / 5.1),),
    ),
    Entry(
        "compliance_chain",
        "KelvinChain",
        lambda f: compliance_generalized_kelvin_voigt(f, SOFT, k0=70.0),
        (normal,),
        lti=True,
        unit="N",
        laws=(closed_forms.chain(1 / 70, [1 / k for k, _ in SOFT], [tau for _, tau in SOFT], 0.0),),
    ),
]


# Springpots ---------------------------------------------------------------------------
def unit_interval(a):
    return b.clip(abs(a), 0.0, 1.0)


TABLE += [
    Entry(
        "springpot",
        "Springpot",
        lambda y: b.springpot(y, 25.0, 0.35, "gl"),
        (squeeze,),
        unit="m",
        laws=(power(25.0, 0.35),),
    ),
    Entry(
        "springpot_l1",
        "Springpot",
        lambda y: b.springpot(y, 25.0, 0.7, "l1", tol=1e-6),
        (squeeze,),
        unit="m",
        laws=(power(25.0, 0.7),),
    ),
    Entry(
        "springpot_spring",
        "Springpot",
        lambda y: b.springpot(y, 2000.0, 0.0, "gl"),
        (squeeze,),
        unit="m",
    ),
    Entry(
        "springpot_dashpot",
        "Springpot",
        lambda y: b.springpot(y, 2.0, 1.0, "gl"),
        (squeeze,),
        unit="m",
    ),
    Entry(
        "springpot_short",
        "Springpot",
        lambda y: b.springpot(y, 3.0, 0.4, "gl", tol=1e-6, horizon=0.008),
        (normal,),
        lti=True,
        unit="m",
        settle=1 << 18,
    ),
    Entry(
        "springpot_contact",
        "Springpot",
        lambda y, c: b.springpot(y, 1.0, 0.2, "gl", onset="step", contact=c > 0.0),
        (squeeze, held),
    ),
    Entry(
        "springpot_live",
        "SpringpotLive",
        lambda y, a: b.springpot(y, 25.0, unit_interval(a), "gl"),
        (squeeze, held),
    ),
    Entry(
        "springpot_live_l1",
        "SpringpotLive",
        lambda y, a: b.springpot(y, 25.0, unit_interval(a), "l1"),
        (squeeze, normal),
    ),
    Entry(
        "springpot_chi",
        "NotBelowZero",
        lambda y, c: b.springpot(y, abs(c), 0.35, "gl"),
        (squeeze, normal),
    ),
    Entry(
        "springpot_bound",
        "Accuracy",
        lambda y, c: b.springpot(y, 25.0, 0.35, "gl", contact=c > 0.0, certificate=True)[1],
        (squeeze, held),
    ),
    Entry(
        "springpot_path", "PathLength", lambda y, c: PathLength(y, c < 0.0, "step"), (squeeze, held)
    ),
    Entry(
        "springpot_downsampled",
        "Downsampled",
        lambda y, c: b.springpot(y, 25.0, 0.35, "gl-downsampled", horizon=80.0, contact=c > 0.0),
        (squeeze, held),
        rates=(1000.0,),
    ),
    Entry(
        "springpot_short_memory",
        "ShortMemory",
        lambda y, c: b.springpot(y, 25.0, 0.35, "gl-short-memory", contact=c > 0.0),
        (squeeze, held),
        rates=(1000.0, 8000.0),
    ),
    Entry(
        "series_spring",
        "Series",
        lambda y: b.springpot_series(y, 25.0, 0.35, k=400.0),
        (squeeze,),
        unit="m",
    ),
    Entry(
        "series_dashpot",
        "Series",
        lambda y, c: b.springpot_series(y, 25.0, 0.6, b=2.0, scheme="gl", contact=c > 0.0),
        (squeeze, held),
    ),
    Entry(
        "compliance", "Integrate", lambda f: b.compliance(f, 25.0, 0.35, "gl"), (normal,), unit="N"
    ),
    Entry(
        "compliance_l1",
        "Springpot",
        lambda f: b.compliance(f, 25.0, 0.35, "l1", tol=1e-12),
        (normal,),
        unit="N",
        laws=(creep(25.0, 0.35),),
    ),
    Entry(
        "compliance_dashpot",
        "Integrate",
        lambda f: b.compliance(f, 25.0, 1.0, "gl"),
        (normal,),
        unit="N",
    ),
    Entry(
        "springpot_last_100",
        "ShortMemory",
        lambda y: b.springpot(y, 25.0, 0.35, "gl-short-memory"),
        (squeeze,),
        lti=True,
        unit="m",
    ),
]


# Bumps, equalisation ------------------------------------------------------------------
HUMP = [1.0, 1.8, 2.0, 1.9, 1.1]


def touch(rng, n, fs):
    """Contact, lost now and then."""
    return np.repeat(rng.choice([1.0, 1.0, 1.0, 0.0], n // 37 + 1), 37)[:n]


TABLE += [
    Entry("bump_duty", "SineBump", lambda u, d: b.bump(u, "sine", d), (phase, held)),
    Entry(
        "bump_point_sine",
        "SineBump",
        lambda u, c: b.bump(u, "half_sine", 0.4, sampling="point", contact=c),
        (phase, touch),
        edges=True,
    ),
    Entry("bump_whole", "LinearBump", lambda u: b.bump(u, "square", 1.0), (phase,)),
    Entry(
        "bump_table_contact",
        "TableBump",
        lambda u, d, c: b.bump(u, [0.0, 1.0], d, contact=c),
        (phase, held, touch),
    ),
    Entry("carrier_contact", "Carrier", lambda c: b.carrier(157.9, "half", contact=c), (touch,)),
    Entry(
        "carrier_fm",
        "Carrier",
        lambda f, c: b.carrier(constant(90.0, "Hz") * f, "half", contact=c),
        (held, touch),
    ),
    Entry(
        "carrier_enabled", "Enabled", lambda x: b.enabled(b.carrier(158.0, "half"), by=x), (touch,)
    ),
    Entry(
        "equalize",
        "Midpoint",
        lambda x: b.equalize(x, (KNOTS, HUMP), limit=1.5, signal=Param("v", 1.0)),
        (normal,),
    ),
    Entry(
        "equalize_contact",
        "Midpoint",
        lambda x, c: b.equalize(
            x, (KNOTS, HUMP), 1.5, "scale", contact=c, kind="cubic", outside="zero"
        ),
        (normal, touch),
    ),
    Entry(
        "lut_polynomial",
        "Polynomial",
        lambda x: b.lut(x, KNOTS, VALUES, kind="polynomial", outside="zero"),
        (normal,),
    ),
    Entry(
        "bumps",
        "LinearBump",
        lambda x, contact: stimlib.scenes.bumps("sawtooth", contact=True).outputs["voltage"] * 1.0,
        (squeeze, touch),
        unit="m",
    ),
]


# Several outputs, loops and what they hand out ----------------------------------------
def rubbed(x):
    """Bristles under a mass that x pushes (LuGre): a loop in a loop, of which both
    values are heard.
    """

    def move(v):
        z = b.loop(
            lambda z: (z + 1e-3 * v) / (1.0 + abs(v) / (1.0 + 0.5 * b.exp(-((100.0 * v) ** 2))))
        )
        return v + 0.01 * (0.5 * x - 1e3 * z - 0.4 * v), z

    v, z = b.loop(move)
    return v + 100.0 * z


@dataclass(frozen=True, eq=False)
class Lagging(Block):
    """Means of this sample and the last, and half their difference: a block of a
    user's, with two outputs.
    """

    x: Block
    outputs = ("mean", "rise")

    def units(self, *u):
        return u[0], u[0]

    def design(self, fs):
        return (), Lagged(0.0)

    @staticmethod
    def step(p, s, x):
        return (0.5 * (x + s.x), 0.5 * (x - s.x)), Lagged(x)

    def through(self, p, fs, z, H, value):
        return 0.5 * (1 + 1 / z) * H[0], 0.5 * (1 - 1 / z) * H[0]


class Lagged(NamedTuple):
    x: float


def parts(x):
    lagging = Lagging(x)
    return lagging.mean - 0.25 * lagging.rise


def halves(x):
    low, high = b.loop(lambda last: (last + 0.1 * (x - last), x - last), start=0.5)
    return low - 0.3 * high


TABLE += [
    Entry(
        "loop", "Loop", lambda x: b.loop(lambda last: last + 0.1 * (x - last)), (normal,), lti=True
    ),
    Entry(
        "loop_start",
        "Last",
        lambda x: b.loop(lambda last: 0.9 * last + 0.0 * x, start=3.0),
        (normal,),
    ),
    Entry(
        "loop_delay",
        "Loop",
        lambda x: b.loop(lambda last: x - 0.5 * b.delay(last, 9)),
        (held,),
        lti=True,
    ),
    Entry(
        "loop_param",
        "Loop",
        lambda x: b.loop(lambda last: last + Param("g", 0.1) * (x - last)),
        (held,),
    ),
    Entry("loop_nested", "Tap", rubbed, (normal,)),
    Entry("loop_taps", "Tap", halves, (held,)),
    Entry("outputs", "Pick", parts, (normal,), lti=True),
    Entry(
        "loop_enabled",
        "Loop",
        lambda x: b.enabled(b.loop(lambda last: 0.9 * last + b.white_noise(3)), by=x),
        (ties,),
    ),
]


# Filters ------------------------------------------------------------------------------
def butter(band, edges, order):
    return closed_forms.family(band, edges, order, "butterworth", 1.0, 60.0)


TABLE += [
    Entry("first", "First", lambda x: First(x), (normal,)),
    Entry(
        "lowpass_steady",
        "First",
        lambda x: b.lowpass(x, 60.0, 4, "elliptic", onset="steady"),
        (squeeze,),
        laws=(closed_forms.family("lowpass", [60.0], 4, "elliptic", 1.0, 60.0),),
    ),
    Entry(
        "lowpass",
        "Filter",
        lambda x: b.lowpass(x, 100.0),
        (normal,),
        lti=True,
        laws=(butter("lowpass", [100.0], 2),),
    ),
    Entry(
        "lowpass_slow",
        "Filter",
        lambda x: b.lowpass(x, 0.1, 3),
        (held,),
        lti=True,
        settle=1 << 20,
        laws=(butter("lowpass", [0.1], 3),),
    ),
    Entry(
        "lowpass_bessel",
        "Filter",
        lambda x: b.lowpass(x, 60.0, 7, "bessel"),
        (normal,),
        lti=True,
        laws=(closed_forms.family("lowpass", [60.0], 7, "bessel", 1.0, 60.0),),
    ),
    Entry(
        "highpass",
        "Filter",
        lambda x: b.highpass(x, 40.0, 5, "chebyshev1", ripple=0.5),
        (normal,),
        lti=True,
        laws=(closed_forms.family("highpass", [40.0], 5, "chebyshev1", 0.5, 60.0),),
    ),
    Entry(
        "bandpass",
        "Filter",
        lambda x: b.bandpass(x, 80.0, 300.0, 3),
        (normal,),
        lti=True,
        laws=(butter("bandpass", [80.0, 300.0], 3),),
    ),
    Entry(
        "bandstop",
        "Filter",
        lambda x: b.bandstop(x, 40.0, 70.0, 4, "elliptic", attenuation=50.0),
        (normal,),
        lti=True,
        laws=(closed_forms.family("bandstop", [40.0, 70.0], 4, "elliptic", 1.0, 50.0),),
    ),
    Entry(
        "sos",
        "Sos",
        lambda x: b.sos(x, ROWS),
        (normal,),
        lti=True,
        laws=(law.biquads(np.array(ROWS)),),
    ),
    Entry(
        "resonator",
        "Resonator",
        lambda x: b.resonator(x, 158.0, 20.0),
        (normal,),
        lti=True,
        laws=(closed_forms.resonance(158.0, 20.0),),
    ),
    Entry(
        "notch",
        "Resonator",
        lambda x: b.notch(x, 50.0, 3.0),
        (normal,),
        lti=True,
        laws=(closed_forms.resonance(50.0, 3.0, True),),
    ),
    Entry(
        "mode",
        "Mode",
        lambda x: b.mode(x, 158.0, 10.0),
        (normal,),
        lti=True,
        laws=(closed_forms.oscillator(158.0, 10.0),),
    ),
    Entry(
        "mode_shape",
        "Shape",
        lambda x, y: b.mode_shape(0.05 * x, 0.05 * y, BENT, 0.1, 0.07),
        (normal, held),
        unit="m",
    ),
    Entry(
        "pole_swap",
        "PoleSwap",
        lambda x: b.pole_swap(x, 158.0, 10.0, 4.0),
        (normal,),
        lti=True,
        laws=(closed_forms.pole_swap(158.0, 10.0, 4.0),),
    ),
    Entry(
        "svf",
        "Svf",
        lambda x: b.svf(x, 120.0, 2.0, "highpass"),
        (normal,),
        lti=True,
        laws=(state_variable(120.0, 2.0, (1, 0, 0)),),
    ),
    Entry(
        "svf_live",
        "Svf",
        lambda x, f, q: b.svf(x, constant(200.0, "Hz") * abs(f), abs(q), "bandpass"),
        (normal, held, held),
    ),
    Entry(
        "svf_param",
        "Svf",
        lambda x: b.svf(x, Param("f", 80.0, "Hz"), Param("q", 5.0), "notch"),
        (normal,),
    ),
    Entry(
        "integrate",
        "Integrate",
        lambda x: b.integrate(x),
        (normal,),
        laws=(closed_forms.integral(0.0),),
    ),
    Entry(
        "integrate_leak",
        "Integrate",
        lambda x: b.integrate(x, 30.0),
        (held,),
        lti=True,
        laws=(closed_forms.integral(30.0),),
    ),
    Entry(
        "moving_average",
        "MovingAverage",
        lambda x: b.moving_average(x, 0.01),
        (normal,),
        lti=True,
        rates=(8000.0,),
        laws=(closed_forms.mean_of(80),),
        late=1e-15,  # its sums begin anew each 80 samples
    ),
    Entry(
        "moving_average_short",
        "MovingAverage",
        lambda x: b.moving_average(x, 0.002),
        (normal,),
        lti=True,
        rates=(8000.0,),
        laws=(closed_forms.mean_of(16),),
    ),
    Entry(
        "envelope_follower", "Follower", lambda x: b.envelope_follower(x, 0.002, 0.03), (normal,)
    ),
]


# Events -------------------------------------------------------------------------------
CLICK = [1.0, -0.6, 0.3, 0.1, -0.05]


def seconds(v):
    return constant(0.02, "s") * abs(v)


TABLE += [
    Entry("rising", "Edge", lambda x, y: b.rising(x, y), (normal, held), edges=True),
    Entry("falling", "Edge", lambda x: b.falling(x, 0.25), (ties,), edges=True),
    Entry("crossing", "Crossing", lambda x: b.crossing(x, 0.3, 0.1), (phase,), edges=True),
    Entry(
        "crossing_split",
        "Crossing",
        lambda x: b.crossing(x, 0.07, split=True),
        (phase,),
        edges=True,
    ),
    Entry("hysteresis", "Hysteresis", lambda x: b.hysteresis(x, 0.5, -0.5), (normal,), edges=True),
    Entry("count", "Count", lambda e: b.count(e), (sparse,)),
    Entry(
        "sample_and_hold",
        "SampleAndHold",
        lambda x, e: b.sample_and_hold(x, e),
        (normal, sparse),
        edges=True,
    ),
    Entry("deadband", "Loop", lambda x, f: b.deadband(x, 0.1, abs(f)), (normal, held), edges=True),
    Entry("once_within", "OnceWithin", lambda e: b.once_within(e, 0.01), (sparse,), edges=True),
    Entry("elapsed", "Time", lambda: b.elapsed()),
    Entry(
        "elapsed_gated",
        "Enabled",
        lambda x: b.enabled(b.elapsed() + constant(1.0, "s"), by=x),
        (touch,),
    ),
    Entry("every", "Every", lambda: b.every(0.0011)),
    Entry("at", "At", lambda: b.at([0.0, 0.01, 0.0100001, 0.02])),
    Entry(
        "timeline",
        "Timeline",
        lambda: b.timeline([(0.0, 1.0), (0.01, -1.0), (0.01, 0.5), (0.03, 2.0)], "cosine"),
    ),
    Entry(
        "timeline_step", "Timeline", lambda: b.timeline([(0.001, 1.0), (0.02, -1.0)], "step", "N")
    ),
    Entry(
        "ring",
        "Ring",
        lambda e: b.ring(e, 150.0, 0.008),
        (sparse,),
        lti=True,
        laws=(law.ring(150.0, 0.008, "sine"),),
    ),
    Entry(
        "ring_cosine",
        "Ring",
        lambda e: b.ring(e, 90.0, 0.005, "cosine"),
        (sparse,),
        lti=True,
        laws=(law.ring(90.0, 0.005, "cosine"),),
    ),
    Entry(
        "ring_live",
        "Ring",
        lambda e, f, d: b.ring(e, constant(200.0, "Hz") * abs(f), seconds(d)),
        (sparse, held, held),
    ),
    Entry(
        "grain",
        "Grain",
        lambda e: b.grain(e, CLICK, rate=8000.0),
        (sparse,),
        lti=True,
        rates=(8000.0,),
        laws=(closed_forms.sum_of(CLICK),),
    ),
    Entry(
        "grain_slower",
        "Grain",
        lambda e: b.grain(e, CLICK, rate=400.0, unit="N"),
        (sparse,),
        lti=True,
    ),
    Entry("burst", "Burst", lambda e: b.burst(e, 0.03, 0.01), (sparse,)),
    Entry("burst_once", "Burst", lambda: b.burst(0.01, 0.05)),
    Entry(
        "envelope",
        "Envelope",
        lambda g: b.envelope(g, 0.002, 0.005, 0.4, 0.003),
        (touch,),
        edges=True,
    ),
]


# Sources ------------------------------------------------------------------------------
TABLE += [
    Entry("triangle", "Oscillator", lambda: b.oscillator(158.0, "triangle", phase=0.4)),
    Entry(
        "sawtooth",
        "Oscillator",
        lambda x: b.oscillator(constant(300.0, "Hz") * abs(x), "sawtooth"),
        (held,),
        edges=True,
    ),
    Entry(
        "square",
        "Oscillator",
        lambda d: b.oscillator(Param("f", 90.0, "Hz"), "square", 0.5 + 0.4 * b.tanh(d)),
        (held,),
        edges=True,
    ),
    Entry("pulse", "Oscillator", lambda: b.oscillator(41.0, "pulse", 0.2)),
    Entry(
        "pulse_train",
        "PulseTrain",
        lambda x, j: b.pulse_train(constant(200.0, "Hz") * abs(x), 0.2 * j),
        (held, normal),
        edges=True,
    ),
    Entry("pulse_train_regular", "PulseTrain", lambda: b.pulse_train(89.7)),
    Entry("chirp", "Chirp", lambda: b.chirp(20.0, 400.0, 0.5)),
    Entry("chirp_exponential", "Chirp", lambda: b.chirp(400.0, 20.0, 0.02, "exponential")),
    Entry("playback", "Playback", lambda: b.playback(UNEVEN, rate=1000.0, unit="N")),
    Entry("playback_loop", "Playback", lambda: b.playback(UNEVEN, rate=500.0, loop=True)),
    Entry(
        "playback_at",
        "Scanned",
        lambda x: b.playback(UNEVEN, rate=1000.0, unit="N", at=seconds(x)),
        (normal,),
    ),
    Entry(
        "playback_at_loop",
        "Scanned",
        lambda x: b.playback(UNEVEN, rate=9000.0, loop=True, at=seconds(x)),
        (normal,),
    ),
    Entry(
        "band_noise",
        "BandNoise",
        lambda: b.band_noise(80.0, 300.0, 0.01, seed=3, shared=True),
        laws=(closed_forms.band_noise(80.0, 300.0, 0.01, 4),),
    ),
]


# Surfaces -----------------------------------------------------------------------------
RIBS = [(1.0, 0.7, 0.3), (0.37, -0.4, 2.0)]
HILLS = np.array(
    [
        [0.0, 1.0, -0.5, 2.0],
        [1.0, 1.5, 0.3, -1.0],
        [0.2, 0.4, 3.0, 1.0],
        [-2.0, 0.5, 0.5, 0.6],
        [1.0, 2.0, 1.0, 0.0],
    ]
)


def heights(grid):
    return grid.value + 0.3 * grid.slope_x - 0.7 * grid.slope_y


TABLE += [
    Entry(
        "spatial_noise",
        "SpatialNoise",
        lambda u: b.spatial_noise(u, 1.5, 7, shortest=0.7, longest=3.0),
        (phase,),
    ),
    Entry(
        "spatial_noise_contact",
        "SpatialNoise",
        lambda u, c: b.spatial_noise(u, 1.5, 7, shortest=0.7, longest=3.0, contact=c),
        (phase, touch),
    ),
    Entry("grating", "Grating", lambda u: b.grating(u, RIBS), (phase,)),
    Entry(
        "lut2",
        "LinearGrid",
        lambda x, y: heights(b.lut2(x, y, HILLS, 0.6, (-1.0, -1.2), unit="N")),
        (normal, held),
    ),
    Entry(
        "lut2_cubic",
        "CubicGrid",
        lambda x, y: heights(b.lut2(x, y, HILLS, (0.6, 0.5), -1.2, "cubic", "N")),
        (normal, held),
    ),
    Entry(
        "grating_contact",
        "Grating",
        lambda u, c: b.grating(u, RIBS, "N", contact=c),
        (phase, touch),
    ),
]


# Friction and contact -----------------------------------------------------------------
def newtons(f):
    """A force, below 0 too where f is."""
    return constant(1.0, "N/m") * f


TABLE += [
    Entry("friction", "ElastoPlastic", lambda x: b.friction(x, 20.0), (squeeze,), unit="m"),
    Entry(
        "friction_live",
        "ElastoPlastic",
        lambda x, f: b.friction(x, newtons(f), 0.6, Param("k", 3.0, "N/m"), elastic=0.3),
        (phase, held),
        unit="m",
    ),
    Entry(
        "friction_coulomb",
        "Coulomb",
        lambda x: b.friction(x, 1.0, 0.5, 100.0, "coulomb"),
        (squeeze,),
        unit="m",
    ),
    Entry(
        "friction_soft",
        "Coulomb",
        lambda x, f: b.friction(x, newtons(f), 0.5, constant(2.0, "1/m") * newtons(f), "coulomb"),
        (phase, normal),
        unit="m",
    ),
    Entry(
        "friction_dahl",
        "Dahl",
        lambda x, c: b.friction(x, 1.0, 0.5, 100.0, "dahl", contact=c > constant(0.0, "m")),
        (squeeze, held),
        unit="m",
    ),
    Entry(
        "friction_lugre",
        "LuGre",
        lambda x, f: b.friction(
            x, newtons(f), 0.5, 100.0, "lugre", static=0.8, damping=0.1, viscosity=0.2
        ),
        (squeeze, held),
        unit="m",
    ),
    Entry(
        "friction_stribeck",
        "Stribeck",
        lambda x: b.friction(x, 1.0, 0.5, 100.0, static=0.8, speed=0.3),
        (squeeze,),
        unit="m",
    ),
    Entry(
        "friction_stribeck_power",
        "StribeckPower",
        lambda x: b.friction(x, 1.0, 0.5, 100.0, static=0.8, speed=0.3, exponent=1.3),
        (squeeze,),
        unit="m",
    ),
    Entry(
        "stick_slip",
        "StickSlip",
        lambda x: b.stick_slip(x, 1.0, 0.8, 0.5, 100.0),
        (squeeze,),
        unit="m",
        edges=True,
    ),
    Entry(
        "stick_slip_live",
        "StickSlip",
        lambda x, f: b.stick_slip(x, newtons(f), 0.8, 0.3, 2.0),
        (phase, normal),
        unit="m",
        edges=True,
    ),
    Entry("wall", "Wall", lambda x: b.wall(x, 300.0, 2.0, 0.01), (squeeze,), unit="m"),
    Entry(
        "wall_live",
        "Wall",
        lambda x, k: b.wall(x, constant(1.0, "N/m^2") * k, 0.002, 0.1, 0.003),
        (phase, held),
        unit="m",
        edges=True,
    ),
    Entry(
        "wall_contact",
        "Wall",
        lambda x, c: b.wall(x, 300.0, hunt_crossley=0.2, contact=c > constant(0.0, "m")),
        (squeeze, held),
        unit="m",
    ),
    Entry(
        "detents",
        "Detents",
        lambda x: b.detents(x, 1.0, constant(0.3, "N/m") * x),
        (phase,),
        unit="m",
    ),
    Entry("detents_slow", "Detents", lambda x: b.detents(x, 2e-3), (squeeze,), unit="m"),
    Entry(
        "button",
        "Button",
        lambda x: (
            (k := b.button(x, 2.0, 0.4, 0.01)).force + newtons(constant(0.1, "m") * k.pressed)
        ),
        (squeeze,),
        unit="m",
        edges=True,
    ),
    Entry(
        "button_live",
        "Button",
        lambda x, f: 2.0 * b.button(x, newtons(abs(f)), 0.3, 0.5, 0.2).force,
        (phase, held),
        unit="m",
        edges=True,
    ),
]


# Soft objects -------------------------------------------------------------------------
SOFT_MAP = np.array([[0.0, 0.1, 0.3, 0.1], [0.2, 0.9, 1.0, 0.2], [0.0, 0.4, 0.7, 0.0]]), 0.03, 0.02


def finger(rng, n, fs):
    """A few strokes over two centimetres."""
    return 0.01 * (
        1 + np.sin(2 * np.pi * rng.uniform(3, 9) * np.arange(n) / fs + rng.uniform(0, 6))
    )


def heard(place, *, wait=0.0):
    return (
        place.x
        - 0.25 * place.y
        + (constant(2.0, "m/s") * (place.wait + place.lag) if wait else 0.0)
    )


TABLE += [
    Entry(
        "stiffness_map",
        "Minimum",
        lambda x, y: b.stiffness_map(x, y, SOFT_MAP),
        (finger, normal),
        unit="m",
    ),
    Entry(
        "cursor", "Cursor", lambda x, y: heard(b.cursor(x, y, SOFT_MAP)), (finger, finger), unit="m"
    ),
    Entry(
        "cursor_contact",
        "Cursor",
        lambda x, y, c: heard(b.cursor(x, y, SOFT_MAP, contact=c > 0.0)),
        (finger, finger, touch),
        unit="m",
    ),
    Entry(
        "cursor_frames",
        "CursorFrames",
        lambda x, y, c: heard(b.cursor(x, y, SOFT_MAP, "frames", c > 0.0, frame=0.0021)),
        (finger, finger, touch),
        unit="m",
        edges=True,
    ),
    Entry(
        "avatar",
        "DelayAvatar",
        lambda x, y, c: heard(
            b.delay_avatar(x, y, constant(30.0, "N/m") * x, contact=c > 0.0, most=0.02), wait=1
        ),
        (finger, finger, touch),
        unit="m",
        edges=True,
    ),
    Entry(
        "avatar_frames",
        "FrameAvatar",
        lambda x, y, c: heard(
            b.delay_avatar(
                x, y, constant(30.0, "N/m") * x, "frames", c > 0.0, frame=0.0021, notice=0.01
            ),
            wait=1,
        ),
        (finger, finger, touch),
        unit="m",
        edges=True,
    ),
    Entry(
        "vibration",
        "Vibration",
        lambda e: b.vibration(constant(0.01, "s") * abs(e), 0.71),
        (sparse,),
        edges=True,
    ),
    Entry(
        "dent",
        "Dent",
        lambda x, d: b.deformation([x, 0.5 * x], [d, 0.7 * d]),
        (finger, finger),
        unit="m",
        edges=True,
    ),
    Entry(
        "indentation",
        "Minimum",
        lambda f: b.indentation(b.press(f), b.clip(f, 0.0, 1.0)),
        (normal,),
        edges=True,
    ),
]


# Inputs of entries that only choose, or that are late or out of contact where
# ``tests/test_laws.py`` puts what is no number.
DEAF = {
    **dict.fromkeys(
        [
            "velocity_contact",
            "track_contact",
            "track_velocity_contact",
            "bump_sawtooth",
            "bump_sine",
            "segment",
            "maxwell_contact",
            "springpot_contact",
            "springpot_bound",
            "springpot_downsampled",
            "springpot_short_memory",
            "series_dashpot",
            "bump_point_sine",
            "carrier_contact",
            "carrier_fm",
            "equalize_contact",
            "spatial_noise_contact",
            "grating_contact",
            "friction_dahl",
            "wall_contact",
        ],
        "c",
    ),
    **dict.fromkeys(
        [
            "nonzero",
            "guard",
            "delay_70",
            "delay_seconds",
            "loading",
            "loading_given",
            "enabled",
            "enabled_held",
            "enabled_live",
            "enabled_nested",
            "enabled_const",
            "segments",
            "segment_nested",
            "segment_gated",
            "carrier_enabled",
            "loop_enabled",
            "first",
            "falling",
            "crossing",
            "crossing_split",
            "hysteresis",
            "elapsed_gated",
            "dent",
            "resting_white",
            "resting_carrier",
            "resting_sides",
        ],
        "x",
    ),
    "greater": ("x", "y"),
    "at_least": ("x", "y"),
    "equal": ("x", "y"),
    "not_equal": ("x", "y"),
    "where": ("x", "z"),
    "maximum": "y",
    "minimum": "y",
    "texture": ("v", "f"),
    "generalized_maxwell_many": ("y", "c"),
    "springpot_path": ("y", "c"),
    "bump_table_contact": ("u", "d", "c"),
    "bumps": ("x", "contact"),
    "rising": ("x", "y"),
    "sample_and_hold": ("x", "e"),
    "deadband": ("x", "f"),
    "envelope": "g",
    "pulse_train": ("x", "j"),
    "wall_live": "k",
    "cursor_contact": ("x", "y", "c"),
    "cursor_frames": ("x", "y", "c"),
    "avatar": ("x", "y", "c"),
    "avatar_frames": ("x", "y", "c"),
    "vibration": "e",
}


def ours() -> dict[str, type[Block]]:
    """Every final class of stimlib, wherever it is defined (by the layers, not in the
    checks or the command line).
    """
    for m in pkgutil.walk_packages(stimlib.__path__, "stimlib."):
        if m.name.split(".")[1] not in ("checks", "cli", "__main__"):
            importlib.import_module(m.name)
    return {
        n: c
        for n, c in registry.items()
        if c.__module__.split(".")[0] == "stimlib" and ".checks." not in c.__module__
    }


EACH = {e.cls: e for e in reversed(TABLE)}
"""The first example of each class."""


def missing() -> set[str]:
    """Those without an example."""
    return set(ours()) - {e.cls for e in TABLE}
