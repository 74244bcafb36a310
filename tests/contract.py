"""One table of all blocks: what each looks like, what drives it, and which physical law it claims to follow.

Every final class of stimlib must have an example here (``missing`` finds them by reflection); the laws of
``tests/test_laws.py`` then run over all of them.  A physical law is written here from the papers, not from the code.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature

import numpy as np

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib import blocks as b
from stimlib.blocks.actuator import ForceLimit, Tally, force_limit, motor_current, slew_limit, static_limit
from stimlib.blocks.carrier import bump, carrier
from stimlib.blocks.fractional import PathLength
from stimlib.blocks.modes import PinkNoise
from stimlib.blocks.noise import White
from stimlib.blocks.relaxation import (
    compliance_generalized_kelvin_voigt,
    compliance_kelvin_voigt,
    compliance_maxwell,
    generalized_maxwell,
    maxwell,
    standard_linear_solid,
)
from stimlib.blocks.tracking import track, track_velocity
from stimlib.graph import Block, Guard, registry


# What drives an input ------------------------------------------------------------------------------------------------
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
    """A finger: presses and releases a few centimetres, holds in between, read in steps of 1 um."""
    t = np.arange(n) / fs
    raw = 0.02 * (1 - np.cos(2 * np.pi * 9 * t + rng.uniform(0, 6))) * (np.sin(2 * np.pi * 1.3 * t) > -0.3)
    return np.round(raw * 1e6) * 1e-6


def phase(rng, n, fs):
    """A finger over bumps, up to many of them in one sample."""
    return np.cumsum(rng.standard_normal(n) * rng.choice([0.0, 1e-5, 1e-2, 0.3, 4.0], n // 50 + 1).repeat(50)[:n])


def angle(rng, n, fs):
    return 30 * rng.standard_normal(n)


# The table -----------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Law:
    """|got/law - 1| <= tol at f, where got = shape(response); see ``tests/test_laws.py``."""

    f: Callable[[float], np.ndarray]
    law: Callable[[np.ndarray, float], np.ndarray]
    tol: float
    of: Callable[[np.ndarray, float], np.ndarray] = lambda H, fs: H
    size: Callable[[np.ndarray], np.ndarray] = np.abs  # error is relative to this of the law


@dataclass(frozen=True)
class Entry:
    """An example of a block class.

    ``make`` gives the block over inputs named like its arguments; ``drive`` names the signal of each input.
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

    @property
    def inputs(self) -> tuple[str, ...]:
        return tuple(signature(self.make).parameters)

    def block(self) -> Block:
        return self.make(*(Input(n, self.unit) for n in self.inputs))

    def scene(self, **more) -> Scene:
        """The block as output y, and times a live number as output z."""
        block = self.block()
        return Scene({"y": block, "z": Param("live", 1.25) * block, **more})

    def x(self, n: int, fs: float, seed: int = 0) -> np.ndarray:
        """Rows for the inputs of ``block``, in the order of its arguments."""
        rng = np.random.default_rng([seed, n])
        return np.array([d(rng, n, fs) for d in self.drive]).reshape(len(self.drive), n)


def band(low, high, points=400):
    return lambda fs: np.geomspace(low, high(fs), points)


def below_nyquist(fs):
    return np.linspace(0, fs / 2, 201)


def pink_law(f_low, tol_db, psd):
    """S1/f within tol_db; ``psd`` makes a one-sided density of a response."""
    return Law(band(f_low, lambda fs: 0.45 * fs), lambda f, fs: 1 / f, 10 ** (tol_db / 10) - 1, psd)


def differentiator_laws(passband, stopband, order, tol):
    """i 2 pi f behind a delay of order/2 samples up to the pass edge; nothing from the stop edge on."""

    def straight(H, fs):
        f = np.linspace(1.0, passband(fs), 500)
        return H * np.exp(1j * np.pi * f * order(fs) / fs)

    def edge(f, fs):
        return np.full(f.shape, 2 * np.pi * passband(fs))

    laws = [Law(lambda fs: np.linspace(1.0, passband(fs), 500), lambda f, fs: 2j * np.pi * f, tol, straight)]
    if stopband:
        laws.append(
            Law(lambda fs: np.linspace(stopband(fs), fs / 2, 500), edge, 1e-6, lambda H, fs: 2 * np.pi * passband(fs) + H)
        )
    return tuple(laws)


def velocity_law(cutoff):
    """d = (x[n] - x[n-1]) fs through two poles y += g (x - y), g = 1 - exp(-2 pi cutoff/fs): the documented formula."""

    def law(f, fs):
        z, p = np.exp(2j * np.pi * f / fs), np.exp(-2 * np.pi * cutoff / fs)
        return fs * (z - 1) / z * ((1 - p) * z / (z - p)) ** 2

    return Law(lambda fs: np.linspace(0.1, fs / 2, 300), law, 1e-12)


def ramp_invariant(tau):
    """1/(1 + i w tau) of straight lines between samples: all aliases of the lag behind the spectrum of a triangle."""

    def law(f, fs):
        k = np.arange(-20000, 20001)
        g = f[:, None] + k * fs
        return np.sum(np.sinc(g / fs) ** 2 / (1 + 2j * np.pi * g * tau), axis=1)

    return Law(lambda fs: np.linspace(0.1, fs / 2, 40), law, 1e-7)


def held_lag(cutoff, more):
    """w^2/(s + w)^2 of an input held for a sample, at the end of that sample: all aliases behind the spectrum of a hold."""

    def law(f, fs):
        k = np.arange(-20000, 20001)
        g = f[:, None] + k * fs
        z = np.exp(2j * np.pi * f / fs)
        hold = np.sinc(g / fs) * np.exp(-1j * np.pi * g / fs)
        return z * np.sum(hold / (1 + 1j * g / cutoff) ** 2, axis=1) * more(z, fs)

    return Law(lambda fs: np.linspace(0.1, fs / 2, 40), law, 1e-6)


def lag(tau):
    """1/(1 + i w tau), a decade below the sample rate."""
    return Law(band(0.1, lambda fs: fs / 400), lambda f, fs: 1 / (1 + 2j * np.pi * f * tau), 3e-5)


def delayed(samples):
    return Law(below_nyquist, lambda f, fs: np.exp(-2j * np.pi * f * samples / fs), 1e-12)


def sum_of(taps):
    def law(f, fs):
        return sum(h * np.exp(-2j * np.pi * f * k / fs) for k, h in enumerate(taps))

    return Law(below_nyquist, law, 1e-12, size=lambda h: np.full(h.shape, np.abs(h).max()))


UNEVEN = [0.3, -1.2, 0.0, 2.5, 1e-3, -0.7, 0.2, 0.9, -0.4, 0.05, 3.0]
SHAPE = [0.0, 0.5, -0.25, 1.0, 0.75], [-1.0, 0.3, 0.9, 1.0, 2.0]
KNOTS, VALUES = [-1.5, -0.5, 0.0, 0.6, 2.0], [2.0, -1.0, 0.0, 0.5, -0.3]
FS8 = (8000.0, 48000.0)


def wide_order(fs):
    return 2 * round(64 * fs / 8000)


TABLE = [
    Entry("input", "Input", lambda x: x, (normal,), lti=True, laws=(delayed(0),)),
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
    Entry("greater", "Greater", lambda x, y: x > y, (ties, ties)),
    Entry("at_least", "AtLeast", lambda x, y: x >= y, (ties, ties)),
    Entry("equal", "Equal", lambda x, y: x == y, (ties, ties)),
    Entry("not_equal", "NotEqual", lambda x, y: x != y, (ties, ties)),
    Entry("where", "Where", lambda x, y, z: b.where(x, y, z), (ties, normal, normal)),
    Entry("maximum", "Maximum", lambda x, y: b.maximum(x, y), (ties, ties)),
    Entry("minimum", "Minimum", lambda x, y: b.minimum(x, y), (ties, ties)),
    Entry("clip", "Minimum", lambda x: b.clip(x, -0.5, 0.7), (normal,)),
    Entry("sqrt", "Sqrt", lambda x: b.sqrt(x), (positive,)),
    Entry("exp", "Exp", lambda x: b.exp(x), (normal,)),
    Entry("log", "Log", lambda x: b.log(x), (positive,)),
    Entry("sin", "Sin", lambda x: b.sin(x), (angle,)),
    Entry("cos", "Cos", lambda x: b.cos(x), (angle,)),
    Entry("tanh", "Tanh", lambda x: b.tanh(x), (angle,)),
    Entry("nonzero", "Nonzero", lambda x: b.nonzero(x), (ties,)),
    Entry("guard", "Guard", lambda x: Guard(x), (normal,), lti=True),
    Entry("delay_1", "Delay", lambda x: b.delay(x, samples=1), (normal,), lti=True, laws=(delayed(1),)),
    Entry("delay_70", "Delay", lambda x: b.delay(x, samples=70), (normal,), lti=True, laws=(delayed(70),)),
    Entry(
        "delay_seconds", "Delay", lambda x: b.delay(x, seconds=0.01), (normal,), lti=True,
        laws=(Law(below_nyquist, lambda f, fs: np.exp(-2j * np.pi * f * 0.01), 1e-12),),
    ),
    Entry("fir", "Taps", lambda x: b.fir(x, UNEVEN), (normal,), lti=True, laws=(sum_of(UNEVEN),)),
    Entry("fir_1", "Taps", lambda x: b.fir(x, [-2.0]), (normal,), lti=True, laws=(sum_of([-2.0]),)),
    Entry(
        "differentiator", "Differentiator", lambda x: b.differentiator(x, passband=1000.0), (normal,), lti=True, rates=FS8,
        laws=differentiator_laws(lambda fs: 1000.0, lambda fs: 1500.0, wide_order, 1e-6),
    ),
    Entry(
        "differentiator_wide", "Differentiator", lambda x: b.differentiator(x), (normal,), lti=True, rates=(8000.0,),
        laws=differentiator_laws(lambda fs: 0.45 * fs, None, wide_order, 1e-6),
    ),
    Entry(
        "differentiator_order", "Differentiator", lambda x: b.differentiator(x, 100.0, 400.0, order=40, tol=1e-4), (normal,),
        lti=True, rates=(1000.0, 1200.0), laws=differentiator_laws(lambda fs: 100.0, None, lambda fs: 40, 1e-4),
    ),
    Entry("loading", "Loading", lambda x: b.loading(b.velocity(x)), (squeeze,)),
    Entry("loading_given", "Loading", lambda x: b.loading(x, on=0.6, off=0.2), (normal,)),
    Entry("velocity", "Velocity", lambda x: b.velocity(x), (squeeze,), lti=True, laws=(velocity_law(100.0),)),
    Entry("velocity_20", "Velocity", lambda x: b.velocity(x, 20.0), (held,), lti=True, laws=(velocity_law(20.0),)),
    Entry("velocity_contact", "Velocity", lambda x, c: b.velocity(x, 30.0, contact=c > 0.0), (squeeze, held)),
    Entry(
        "track", "Track", lambda x: track(x, 40.0, max_jump=None), (held,), lti=True, laws=(held_lag(40.0, lambda z, fs: 1.0),),
    ),
    Entry(
        "track_velocity", "TrackVelocity", lambda x: track_velocity(x, 40.0, max_jump=None), (held,), lti=True,
        laws=(held_lag(40.0, lambda z, fs: fs * (1 - 1 / z)),),
    ),
    Entry("track_contact", "Track", lambda x, c: track(x, 20.0, contact=c > 0.0, max_jump=0.5), (squeeze, held)),
    Entry("track_velocity_contact", "TrackVelocity", lambda x, c: track_velocity(x, 20.0, contact=c > 0.0), (squeeze, held)),
    Entry("bump_square", "LinearBump", lambda u, d: bump(u, "square", 0.3 + 0.2 * b.sin(d)), (phase, held)),
    Entry("bump_sawtooth", "LinearBump", lambda u, c: bump(u, "sawtooth", 0.7, contact=c > -0.5), (phase, held)),
    Entry("bump_point", "LinearBump", lambda u: bump(u, "square", 0.4, sampling="point"), (phase,)),
    Entry("bump_sine", "SineBump", lambda u, c: bump(u, "sine", Param("duty", 0.5), contact=c > -0.5), (phase, held)),
    Entry("bump_half_sine", "SineBump", lambda u: bump(u, "half_sine", 0.8), (phase,)),
    Entry("bump_table", "TableBump", lambda u: bump(u, [0.0, 0.2, 1.0, 0.3], 0.6), (phase,)),
    Entry("carrier", "Carrier", lambda: carrier(158.0, phase=0.3)),
    Entry("carrier_half", "Carrier", lambda: carrier(158.0, "half")),
    Entry("carrier_live", "Carrier", lambda x: carrier(constant(100.0, "Hz") * abs(x), "full"), (held,)),
    Entry("carrier_param", "Carrier", lambda: carrier(Param("f", 80.0, "Hz"), "half")),
    Entry("force_limit", "ForceLimit", lambda x: force_limit(x, 0.5), (normal,), unit="N"),
    Entry("static_limit", "StaticLimit", lambda x: static_limit(x, 0.9, tau=0.05), (normal,), unit="N"),
    Entry("slew_limit", "SlewLimit", lambda x: slew_limit(x, 900.0), (normal,)),
    Entry("tally", "Tally", lambda x: Tally(ForceLimit(x, constant(0.5)), x, "clip", "y"), (normal,)),
    Entry("motor_current", "Div", lambda x: motor_current(constant(1.0, "N/m") * x, x, 10.0), (squeeze,), unit="m"),
    Entry(
        "first_order", "FirstOrder", lambda x: b.first_order(x, 0.01), (normal,), lti=True, laws=(ramp_invariant(0.01), lag(0.01))
    ),
    Entry(
        "first_order_slow", "FirstOrder", lambda x: b.first_order(x, 0.2), (held,), lti=True, rates=(1000.0, 4000.0),
        laws=(ramp_invariant(0.2), lag(0.2)),
    ),
    Entry("first_order_fast", "FirstOrder", lambda x: b.first_order(x, 1e-5), (normal,), lti=True, laws=(ramp_invariant(1e-5),)),
    Entry("kelvin_voigt", "Add", lambda x: b.kelvin_voigt(x, 300.0, 2.0), (squeeze,), lti=True, unit="m"),
    Entry("spring", "Mul", lambda x: b.spring(x, Param("k", 2000.0, "N/m")), (squeeze,), lti=True, unit="m"),
    Entry(
        "pinking", "Pinking", lambda x: b.pinking(x, f_low=10.0), (normal,), lti=True, rates=(8000.0, 1000.0),
        laws=(pink_law(10.0, 0.01, lambda H, fs: 2 * np.pi * abs(H) ** 2 / fs),),
    ),
    Entry(
        "pinking_coarse", "Pinking", lambda x: b.pinking(x, f_low=30.0, tol_db=1.0), (held,), lti=True, rates=(1000.0, 48000.0),
        laws=(pink_law(30.0, 1.0, lambda H, fs: 2 * np.pi * abs(H) ** 2 / fs),),
    ),
    Entry(
        "pinking_many", "Pinking", lambda x: b.pinking(x, f_low=5.0, tol_db=1e-5), (normal,), lti=True, rates=(8000.0,),
        laws=(pink_law(5.0, 1e-5, lambda H, fs: 2 * np.pi * abs(H) ** 2 / fs),),
    ),
    Entry(
        "pink_noise", "PinkNoise", lambda: b.pink_noise(psd_1hz=0.25, seed=3, stream=2),
        laws=(pink_law(1.0, 0.01, lambda H, fs: abs(H) ** 2 * 2 / fs / 0.25),), rates=(8000.0, 1000.0, 48000.0),
    ),
    Entry("pink_of_white", "PinkNoise", lambda: PinkNoise((w := White(1)), 2.0, 20.0, 0.1) + 0.5 * w),
    Entry("white", "White", lambda: b.white_noise(seed=2**64 - 1, stream=2**32 - 1), laws=(delayed(0),)),
    Entry("white_shared", "White", lambda x: b.white_noise(5) * x - b.where(x, x, b.delay(b.white_noise(6), 3)), (normal,)),
    Entry("enabled", "Enabled", lambda x: b.enabled(b.white_noise(4), by=x), (ties,)),
    Entry("enabled_held", "Enabled", lambda x: b.enabled(b.delay(b.pink_noise(1.0, 4, 1, 5.0), 9), by=b.loading(x, 0.1, 0.05)),
        (held,)),
    Entry("enabled_live", "Enabled", lambda x: b.enabled(Param("g", 0.5) * b.white_noise(4) + Param("h", 1.0), by=x > 0.3),
        (normal,)),
    Entry(
        "enabled_nested", "Enabled",
        lambda x: b.enabled(
            0.5 + b.enabled(b.fir(b.white_noise(4), UNEVEN),
                by=b.enabled(b.white_noise(7), by=b.white_noise(8) - Param("g", -0.2)) > 0.1),
            by=b.loading(x, 0.6, 0.0001),
        ),
        (held,),
    ),
    Entry("enabled_by_param", "Enabled", lambda x: x * b.enabled(b.white_noise(4), by=b.nonzero(Param("g", 1.0))), (normal,)),
    Entry("enabled_const", "Enabled", lambda x: b.enabled(constant(2.0), by=x), (normal,)),
    Entry(
        "differentiated_pink", "Enabled",
        lambda x: b.velocity(x) * b.enabled(b.differentiator(b.pink_noise(1 / np.pi, 7, f_low=10.0), 1000.0),
            by=b.loading(b.velocity(x))),
        (squeeze,), rates=(8000.0,),
    ),
    Entry("lut", "Lut", lambda x: b.lut(x, KNOTS, VALUES), (normal,)),
    Entry("lut_two", "Lut", lambda x: b.lut(x, [0.0, 1.0], [1.0, -1.0], outside="zero"), (ties,)),
    Entry("lut_pchip", "Lut", lambda x: b.lut(x, KNOTS, VALUES, kind="pchip", outside="zero"), (normal,)),
    Entry("lut_cubic", "Lut", lambda x: b.lut(b.clip(x, -1.5, 2.0), KNOTS, VALUES, kind="cubic", outside="error"), (normal,)),
    Entry("squeeze", "Enabled", lambda x1: stimlib.scenes.squeeze(fingers=1).outputs["force1"], (squeeze,), rates=(8000.0,),
        unit="m"),
]  # fmt: skip


# Relaxation and creep ------------------------------------------------------------------------------------------------
SOFT = [(50.0, 1e-5), (30.0, 1e-3), (20.0, 0.02), (10.0, 0.2)]


def arms_law(k0, arms):
    """k0 + sum k i w tau/(1 + i w tau) of straight lines between samples: a spring less a lag."""
    lags = [(k, ramp_invariant(tau).law) for k, tau in arms]
    total = k0 + sum(k for k, _ in arms)

    def law(f, fs):
        return total - sum(k * lag_of(f, fs) for k, lag_of in lags)

    return Law(lambda fs: np.linspace(0.1, fs / 2, 40), law, 1e-7, size=lambda h: np.full(h.shape, total))


def chain_law(j0, elements, flow):
    """j0 + sum 1/(k (1 + i w tau)) + flow/(i w) of straight lines between samples; an integral is then the trapezoidal rule."""
    lags = [(k, ramp_invariant(tau).law) for k, tau in elements]

    def law(f, fs):
        z = np.exp(2j * np.pi * f / fs)
        return j0 + sum(lag_of(f, fs) / k for k, lag_of in lags) + flow / 2 / fs * (z + 1) / (z - 1)

    return Law(lambda fs: np.linspace(0.1, fs / 2, 40), law, 1e-7)


TABLE += [
    Entry(
        "maxwell",
        "MaxwellArms",
        lambda y: maxwell(y, 200.0, 4.0),
        (squeeze,),
        lti=True,
        unit="m",
        laws=(arms_law(0.0, [(200.0, 0.02)]),),
        rates=(8000.0, 1000.0, 48000.0),
    ),
    Entry(
        "maxwell_damper",
        "MaxwellArms",
        lambda y: maxwell(y, 1e13, 4.0),
        (held,),
        lti=True,
        unit="m",
        laws=(Law(lambda fs: np.linspace(0.1, fs / 2, 40), lambda f, fs: 4.0 * fs * (1 - np.exp(-2j * np.pi * f / fs)), 1e-8),),
    ),
    Entry(
        "maxwell_step",
        "MaxwellArms",
        lambda y: maxwell(y, Param("k", 3.0, "N/m"), tau=0.05, onset="step"),
        (held,),
        lti=True,
        unit="m",
        laws=(arms_law(0.0, [(3.0, 0.05)]),),
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
        laws=(arms_law(70.0, SOFT),),
    ),
    Entry(
        "generalized_maxwell_many",
        "MaxwellArms",
        lambda y, c: generalized_maxwell(y, 5.0, [(1.0 + i, 1e-6 * 10**i) for i in range(19)], onset="step", contact=c > 0.0),
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
        laws=(arms_law(7.0, [(3.0, 0.1)]),),
    ),
    Entry(
        "compliance_kelvin_voigt",
        "KelvinChain",
        lambda f: compliance_kelvin_voigt(f, 200.0, 4.0),
        (held,),
        lti=True,
        unit="N",
        laws=(chain_law(0.0, [(200.0, 0.02)], 0.0),),
    ),
    Entry(
        "compliance_maxwell",
        "KelvinChain",
        lambda f: compliance_maxwell(f, 200.0, 4.0),
        (held,),
        unit="N",
        laws=(chain_law(1 / 200, [], 1 / 4),),
    ),
    Entry(
        "compliance_live",
        "KelvinChain",
        lambda f: compliance_maxwell(f, constant(50.0, "N/m") + Param("k", 1.0, "N/m"), tau=0.1),
        (normal,),
        unit="N",
        laws=(chain_law(1 / 51, [], 1 / 5.1),),
    ),
    Entry(
        "compliance_chain",
        "KelvinChain",
        lambda f: compliance_generalized_kelvin_voigt(f, SOFT, k0=70.0),
        (normal,),
        lti=True,
        unit="N",
        laws=(chain_law(1 / 70, SOFT, 0.0),),
    ),
]


# Springpots ----------------------------------------------------------------------------------------------------------
def power_law(chi, alpha):
    """chi (i w)^alpha, far below the sample rate."""
    return Law(band(0.01, lambda fs: fs / 1000), lambda f, fs: chi * (2j * np.pi * f) ** alpha, 4e-3)


def unit_interval(a):
    return b.clip(abs(a), 0.0, 1.0)


TABLE += [
    Entry("springpot", "Springpot", lambda y: b.springpot(y, 25.0, 0.35), (squeeze,), unit="m",
        laws=(power_law(25.0, 0.35),)),
    Entry("springpot_l1", "Springpot", lambda y: b.springpot(y, 25.0, 0.7, "l1", tol=1e-6), (squeeze,), unit="m",
        laws=(power_law(25.0, 0.7),)),
    Entry("springpot_spring", "Springpot", lambda y: b.springpot(y, 2000.0, 0.0), (squeeze,), unit="m"),
    Entry("springpot_dashpot", "Springpot", lambda y: b.springpot(y, 2.0, 1.0), (squeeze,), unit="m"),
    Entry("springpot_short", "Springpot", lambda y: b.springpot(y, 3.0, 0.4, tol=1e-6, horizon=0.008), (normal,), lti=True,
        unit="m", settle=1 << 18),
    Entry("springpot_contact", "Springpot", lambda y, c: b.springpot(y, 1.0, 0.2, onset="step", contact=c > 0.0),
        (squeeze, held)),
    Entry("springpot_live", "SpringpotLive", lambda y, a: b.springpot(y, 25.0, unit_interval(a)), (squeeze, held)),
    Entry("springpot_live_l1", "SpringpotLive", lambda y, a: b.springpot(y, 25.0, unit_interval(a), "l1"), (squeeze, normal)),
    Entry("springpot_chi", "NotBelowZero", lambda y, c: b.springpot(y, abs(c), 0.35), (squeeze, normal)),
    Entry("springpot_bound", "Accuracy", lambda y, c: b.springpot(y, 25.0, 0.35, contact=c > 0.0, certificate=True)[1],
        (squeeze, held)),
    Entry("springpot_path", "PathLength", lambda y, c: PathLength(y, c > 0.0, "step"), (squeeze, held)),
    Entry("springpot_downsampled", "Downsampled",
        lambda y, c: b.springpot(y, 25.0, 0.35, "gl-downsampled", horizon=80.0, contact=c > 0.0), (squeeze, held),
        rates=(1000.0,)),
    Entry("springpot_short_memory", "ShortMemory",
        lambda y, c: b.springpot(y, 25.0, 0.35, "gl-short-memory", contact=c > 0.0), (squeeze, held), rates=(1000.0, 8000.0)),
    Entry("series_spring", "Series", lambda y: b.springpot_series(y, 25.0, 0.35, k=400.0), (squeeze,), unit="m"),
    Entry("series_dashpot", "Series", lambda y, c: b.springpot_series(y, 25.0, 0.6, b=2.0, scheme="gl", contact=c > 0.0),
        (squeeze, held)),
    Entry("compliance", "Integral", lambda f: b.compliance(f, 25.0, 0.35), (normal,), unit="N"),
    Entry("compliance_dashpot", "Integral", lambda f: b.compliance(f, 25.0, 1.0), (normal,), unit="N"),
    Entry("springpot_last_100", "ShortMemory", lambda y: b.springpot(y, 25.0, 0.35, "gl-short-memory"), (squeeze,), lti=True,
        unit="m"),
]  # fmt: skip


# Bumps, equalisation -------------------------------------------------------------------------------------------------
HUMP = [1.0, 1.8, 2.0, 1.9, 1.1]


def touch(rng, n, fs):
    """Contact, lost now and then."""
    return np.repeat(rng.choice([1.0, 1.0, 1.0, 0.0], n // 37 + 1), 37)[:n]


TABLE += [
    Entry("bump_duty", "SineBump", lambda u, d: b.bump(u, "sine", d), (phase, held)),
    Entry("bump_point_sine", "SineBump", lambda u, c: b.bump(u, "half_sine", 0.4, sampling="point", contact=c), (phase, touch)),
    Entry("bump_whole", "LinearBump", lambda u: b.bump(u, "square", 1.0), (phase,)),
    Entry("bump_table_contact", "TableBump", lambda u, d, c: b.bump(u, [0.0, 1.0], d, contact=c), (phase, held, touch)),
    Entry("carrier_contact", "Carrier", lambda c: b.carrier(157.9, "half", contact=c), (touch,)),
    Entry("carrier_fm", "Carrier", lambda f, c: b.carrier(constant(90.0, "Hz") * f, "half", contact=c), (held, touch)),
    Entry("carrier_enabled", "Enabled", lambda x: b.enabled(b.carrier(158.0, "half"), by=x), (touch,)),
    Entry("equalize", "Midpoint", lambda x: b.equalize(x, (KNOTS, HUMP), limit=1.5, signal=Param("v", 1.0)), (normal,)),
    Entry("equalize_contact", "Midpoint",
        lambda x, c: b.equalize(x, (KNOTS, HUMP), 1.5, "scale", contact=c, kind="cubic", outside="zero"), (normal, touch)),
    Entry("lut_polynomial", "Polynomial", lambda x: b.lut(x, KNOTS, VALUES, kind="polynomial", outside="zero"), (normal,)),
    Entry("bumps", "LinearBump",
        lambda x, contact: stimlib.scenes.bumps("sawtooth", contact=True).outputs["voltage"] * 1.0, (squeeze, touch), unit="m"),
]  # fmt: skip


def ours() -> dict[str, type[Block]]:
    """Every final class of stimlib, wherever it is defined (by the layers, not in the checks or the command line)."""
    for m in pkgutil.walk_packages(stimlib.__path__, "stimlib."):
        if m.name.split(".")[1] not in ("checks", "cli", "__main__"):
            importlib.import_module(m.name)
    return {n: c for n, c in registry.items() if c.__module__.split(".")[0] == "stimlib"}


def missing() -> set[str]:
    """Those without an example."""
    return set(ours()) - {e.cls for e in TABLE}
