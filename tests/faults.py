"""Faults of blocks that a verifier must see.

``FAULTS`` maps the name of each to what is replaced, and to the scene in which it is
seen.
"""

import contextlib
import dataclasses as dc
import importlib
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

import stimlib
from stimlib import Input, Scene, blocks as b, constant
from stimlib.blocks.actuator import StaticLimit
from stimlib.blocks.bumps import LinearBump, SineBump
from stimlib.blocks.contact import Button, Detents, Wall
from stimlib.blocks.creep import KelvinChain, compliance_kelvin_voigt
from stimlib.blocks.filters import CascadeState, Delay
from stimlib.blocks.fir_filters import Differentiator, Taps
from stimlib.blocks.friction import StickSlip
from stimlib.blocks.impedance import FirstOrder, Gate, GateState, Velocity, VelocityState, pole_gain
from stimlib.blocks.integrals import Integrate
from stimlib.blocks.noise import (
    ONE,
    Modes,
    Pinking,
    PinkNoise,
    White,
    WhiteState,
    deviates,
    noise_key,
    pair_of_words,
    radius,
    turn,
)
from stimlib.blocks.oscillators import Carrier
from stimlib.blocks.resonance import Resonator, section
from stimlib.blocks.series import Series
from stimlib.blocks.sources import Ring
from stimlib.blocks.springpots import ShortMemory, Springpot, SpringpotLive
from stimlib.blocks.surfaces import Grating, SpatialNoise
from stimlib.blocks.tables import Lut
from stimlib.blocks.texture import Texture
from stimlib.blocks.tracking import Track, TrackVelocity, track, track_velocity
from stimlib.blocks.viscoelastic import MaxwellArms, maxwell
from stimlib.core.maths import copy, modes as modes_sum, pairs, where
from stimlib.motion.generators import constant_speed, minimum_jerk, ramp_and_hold, sinusoid
from stimlib.scenes import (
    bumps,
    click,
    detents,
    friction,
    grating,
    impact,
    squeeze,
    texture,
    viscoelastic,
    wall,
)
from stimlib.targets.llvm import engine as target

U = np.uint64
MOTION = {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.015, rise=0.25)}
SEED = 5


def scaled(f, change):
    """A design(fs) whose parameters are changed."""

    def design(self, fs):
        p, s = f(self, fs)
        return change(p), s

    return design


def times(names, factor, more=0.0):
    """A change of these parameters."""
    return lambda p: p._replace(**{n: getattr(p, n) * factor + more for n in names.split()})


def remade(f, **fields):
    """A design(fs) of a block of other numbers."""

    def design(self, fs):
        return f(dc.replace(self, **fields), fs)

    return design


def off_tap(p):
    taps = p.taps.copy()
    taps[40] += 1e-4 * np.abs(taps).max()
    return p._replace(taps=taps)


def inverted_tile(p, s, x, y):
    g = s.g
    for i in range(y.size):
        g = where(x[i] > where(g > 0.0, p.off, p.on), 0.0, 1.0)
        y[i] = g
    return GateState(g)


def early_tile(p, s, x, y):
    g = s.g
    for i in range(y.size):
        j = where(i + 1 < y.size, i + 1.0, i + 0.0)
        g = where(x[np.int64(j)] > where(g > 0.0, p.off, p.on), 1.0, 0.0)
        y[i] = g
    return GateState(g)


def forgetful_tile(p, s, x, y, w):
    s.q[0] = s.q[0] * 0.999
    modes_sum(p.p, p.r, s.q, p.d, x, y, w)
    return s


PERIOD, FEW, LEAD = U(511), U(500), U(1 << 62)


def periodic(key, m):
    return deviates(key, where(m > LEAD, m, m & PERIOD))  # 1024 samples


def periodic_tile(p, s, y, w):
    odd = np.int64(s.n & ONE)
    pairs(periodic, s.key, s.n >> ONE, w[: y.size + odd])
    copy(w[odd : odd + y.size], y)
    return WhiteState(s.key, s.n + U(y.size))


def flat(key, m):
    a, b = pair_of_words(key, m)
    r = where(m < FEW, radius(a), where(m > LEAD, radius(a), 1.4142135623730951))
    c, d = turn(b)
    return r * c, r * d


def flat_tile(p, s, y, w):
    odd = np.int64(s.n & ONE)
    pairs(flat, s.key, s.n >> ONE, w[: y.size + odd])
    copy(w[odd : odd + y.size], y)
    return WhiteState(s.key, s.n + U(y.size))


def one_stream(self, p, s, seed):
    return s._replace(key=noise_key(seed, self.seed, 1, 0))


def no_seed(self, p, s, seed):
    return s._replace(key=noise_key(0, self.seed, self.stream, 0))


def wrong_words(p, sizes, right=target._parameter_words):
    if "ModesParams" in type(p).__name__:
        p = p._replace(r=p.r * 10**0.01)
    return right(p, sizes)


def strong_spring(x, k):
    return stimlib.blocks.spring(x, k) * 1.01


X, WAVE = Input("x", "m"), {"x": sinusoid(0.01, 3.0)}
N = constant(1.0, "N/m")


def scene_of(block):
    return Scene({"y": block})


# Numbers of a block's design, and a scene that has it ---------------------------------
STROKE = {"x": sinusoid(0.03, 1.0), "force": sinusoid(0.8, 3.0, mean=1.0)}
# name: (class, change of its design, or another design, scene, motion)
DESIGNS = {
    "pole of the velocity 1 % off": (Velocity, times("g", 1.01), squeeze(), MOTION),
    "lag 1 % off": (FirstOrder, times("now", 1.01), scene_of(b.first_order(X, 0.01)), WAVE),
    "tracker 1 % off": (Track, times("q", 1.01), scene_of(track(X)), WAVE),
    "tracked rate 1 % off": (TrackVelocity, times("fs", 1.01), scene_of(track_velocity(X)), WAVE),
    "Maxwell arm 1e-6 off": (
        MaxwellArms,
        times("r", 1 + 1e-6),
        scene_of(maxwell(X, 200.0, 4.0)),
        WAVE,
    ),
    "Kelvin-Voigt element 1e-6 off": (
        KelvinChain,
        times("r", 1 + 1e-6),
        scene_of(compliance_kelvin_voigt(N * X, 200.0, 4.0)),
        WAVE,
    ),
    "sum of samples 1e-9 off": (
        Integrate,
        times("now", 1 + 1e-9),
        scene_of(b.compliance(N * X, 2.0, 1.0, scheme="gl")),
        WAVE,
    ),
    "a FIR tap 1e-9 off": (
        Taps,
        times("taps", 1, 1e-9),
        scene_of(b.fir(X, [0.5, 0.5])),
        WAVE,
    ),
    "pinking 0.02 dB off": (
        Pinking,
        times("r d", 1.0023),
        scene_of(b.pinking(X, 10.0)),
        WAVE,
    ),
    "springpot 1e-3 off": (Springpot, times("scale", 1.001), viscoelastic(0.5), {"y": WAVE["x"]}),
    "springpot 1e-8 off": (
        Springpot,
        times("scale", 1 + 1e-8),
        viscoelastic(0.5),
        {"y": WAVE["x"]},
    ),
    "live springpot 1e-6 off": (
        SpringpotLive,
        times("a", 1 + 1e-6),
        Scene(
            {
                "force": (
                    stimlib.Param("firmness", 1.0)
                    * b.springpot(Input("y", "m"), 100.0, stimlib.Param("alpha", 0.5))
                )
            },
            "viscoelastic",
        ),
        {"y": WAVE["x"]},
    ),
    "springpot in series 1e-3 off": (
        Series,
        times("pot", 1.001),
        scene_of(b.springpot_series(X, 25.0, 0.5, k=400.0, scheme="gl")),
        WAVE,
    ),
    "short memory 1e-6 off": (
        ShortMemory,
        times("taps", 1 + 1e-6),
        scene_of(b.springpot(X, 3.0, 0.4, "gl-short-memory")),
        WAVE,
    ),
    "sawtooth 1e-3 off": (
        LinearBump,
        times("slope", 1.001),
        bumps("sawtooth"),
        {"x": sinusoid(0.05, 1.0)},
    ),
    "sine bumps as half sines": (
        SineBump,
        times("half", 0.0, 1.0),
        bumps("sine", duty=0.2),
        {"x": sinusoid(0.05, 1.0)},
    ),
    "carrier 1e-5 off": (
        Carrier,
        times("high", 1 + 1e-5),
        bumps(),
        {"x": constant_speed(0.05, 0.1)},
    ),
    "static limit 1 % higher": (
        StaticLimit,
        times("most", 1.01),
        squeeze(fingers=1, limits=True),
        {"x1": ramp_and_hold(0.06, 0.3)},
    ),
    "measured profile 1e-4 off": (
        Lut,
        times("c", 1 + 1e-4),
        bumps(displacement=(np.linspace(0, 0.1, 9), 1 + np.sin(np.linspace(0, 3.0, 9)))),
        {"x": constant_speed(0.05, 0.1)},
    ),
    "delay of one sample more": (
        Delay,
        remade(Delay.design, samples=6),
        scene_of(b.delay(X, 5)),
        WAVE,
    ),
    "order of a springpot 1e-6 off": (
        Springpot,
        remade(Springpot.design, order=0.5 + 1e-6),
        viscoelastic(0.5),
        {"y": WAVE["x"]},
    ),
    "drop of a button 1e-3 off": (
        Button,
        times("drop", 1.001),
        click(),
        {"x": sinusoid(1.3e-3, 3.0, 1e-3)},
    ),
    "detents 1e-3 off": (Detents, times("per", 1.001), detents(), {"angle": sinusoid(1.0, 2.0)}),
    "slips 1e-3 off": (StickSlip, times("left", 1.001), friction(), {"x": sinusoid(0.02, 2.0)}),
    "wall 1e-3 off": (Wall, times("fs", 1.001), wall(), {"x": sinusoid(2e-3, 5.0)}),
    "ring 1e-3 off": (Ring, times("per", 1.001), impact(), {"x": sinusoid(5e-3, 3.0)}),
    **{
        f"{owner.__name__}'s {name} 1e-6 off": (
            owner,
            times(name, 1 + 1e-6, 1e-9),
            grating(),
            {"x": sinusoid(0.05, 1.0)},
        )
        for owner, name in (
            (Grating, "per"),
            (Grating, "start"),
            (SpatialNoise, "at"),
            (SpatialNoise, "own"),
        )
    },
    **{
        f"texture's {name} 1e-3 off": (Texture, times(name, 1.001), texture(), STROKE)
        for name in ("gain", "lsf", "per_force", "rows")
    },
}


# Formulas that blocks had, and that were not what their docstring says
def warped(self, fs):
    """A resonance whose width shrinks towards fs/2: g/q in place of (1 + g^2) tan(pi
    freq/(q fs)).
    """
    g = np.tan(np.pi * self.freq / fs)
    return section(g, g / self.q, "notch" if self.notched else "bandpass"), CascadeState(
        *np.zeros((4, 1))
    )


class LateParams(NamedTuple):
    g: float
    fs: float


def late_design(self, fs):
    return LateParams(pole_gain(100.0, fs), fs), VelocityState(0.0, 0.0, 0.0, 1.0)


LATE = {
    "design": late_design,
    "tile": None,
    "work": None,
    "step": staticmethod(Velocity.step),
    "transfer": staticmethod(Velocity.transfer),
}


HONEST_LAG = FirstOrder.design


def rounded_leak(self, fs):
    """A lag by exp(-1/(tau fs)), whose gain at 0 Hz is 1e-7 off for 1e6 s."""
    a = 1 / (self.tau * fs)
    now = a / 2 - a * a / 6 + a**3 / 24
    p, s = HONEST_LAG(self, fs)
    return type(p)(np.exp(-a), now, -np.expm1(-a) - now), s


OLD = {  # name: (class, what is replaced, block)
    "short memory in samples": (
        ShortMemory,
        {"design": remade(ShortMemory.design, seconds=100 / 8000)},
        b.springpot(X, 3.0, 0.4, "gl-short-memory"),
    ),
    "creep half a sample early": (
        Springpot,
        {"design": remade(Springpot.design, scheme="l1")},  # of a force held between samples
        b.compliance(N * X, 2.0, 0.5, "l1"),
    ),
    "a resonator that warps": (Resonator, {"design": warped}, b.resonator(X, 700.0, 20.0)),
    "a notch that warps": (Resonator, {"design": warped}, b.notch(X, 700.0, 5.0)),
    "a spring half a sample early": (
        Taps,
        {"design": remade(Taps.design, taps=np.array([1.0, 0.0]))},  # before that of its damper
        b.kelvin_voigt(X, 300.0, 10.0),
    ),
    "a lag whose leak is rounded": (
        FirstOrder,
        {"design": rounded_leak},
        b.first_order(X, 1e6),
    ),
    "a damper that lags": (Springpot, LATE, b.kelvin_voigt(X, 300.0, 2.0)),
}


class Fault(NamedTuple):
    """What is replaced, groups of which at least one check must fail, and where."""

    owner: Any
    replaced: dict
    groups: set
    scene: Any = None  # two fingers
    motion: dict = MOTION
    seconds: float = 1.5


def failed(scene=None, motion=MOTION, seconds=1.5):
    """The checks that fail; two fingers are made now, with what is replaced."""
    scene = scene or squeeze()
    rendering = stimlib.render(scene, motion, 8000, seconds, seed=SEED)
    return [c for c in stimlib.verify(scene, motion, rendering).checks if not c.passed]


def caught(fault):
    """The groups of the checks that see it."""
    with contextlib.ExitStack() as stack:
        for attribute, replacement in fault.replaced.items():
            stack.enter_context(patch.object(fault.owner, attribute, replacement))
        return {c.group for c in failed(*fault[3:])}


FAULTS = {
    "pink 0.2 dB off, in the design": Fault(
        PinkNoise, {"design": scaled(PinkNoise.design, times("r d", 10**0.01))}, {"a2"}
    ),
    "pink 0.2 dB off, in the compiled residues": Fault(
        target, {"_parameter_words": wrong_words}, {"a1"}
    ),
    "FIR gain 1 % off": Fault(
        Differentiator, {"design": scaled(Differentiator.design, times("taps", 1.01))}, {"a2"}
    ),
    "one tap off by 1e-4": Fault(
        Differentiator, {"design": scaled(Differentiator.design, off_tap)}, {"a2"}
    ),
    "gate inverted": Fault(Gate, {"tile": staticmethod(inverted_tile)}, {"d"}),
    "gate early by one sample": Fault(Gate, {"tile": staticmethod(early_tile)}, {"d"}),
    "one noise for both fingers": Fault(White, {"start": one_stream}, {"c"}),
    "seed ignored": Fault(White, {"start": no_seed}, {"c"}),
    "noise that repeats every 1024 samples": Fault(
        White, {"tile": staticmethod(periodic_tile)}, {"c"}
    ),
    "deviates of one radius from sample 1000 on": Fault(
        White, {"tile": staticmethod(flat_tile)}, {"c"}
    ),
    "rate doubled": Fault(
        Velocity, {"design": scaled(Velocity.design, times("fs", 2))}, {"a2", "d"}
    ),
    "k 1 % off": Fault(
        importlib.import_module("stimlib.scenes.squeeze"), {"spring": strong_spring}, {"d"}
    ),
    "state that depends on the cut": Fault(Modes, {"tile": staticmethod(forgetful_tile)}, {"b"}),
}
FAULTS |= {
    name: Fault(
        owner,
        {"design": change if change.__name__ == "design" else scaled(owner.design, change)},
        {"d"} if any(part.given for part in scene.parts) else set(),
        scene,
        motion,
    )
    for name, (owner, change, scene, motion) in DESIGNS.items()
}
FAULTS |= {
    name: Fault(owner, replaced, set(), scene_of(block), WAVE, 0.5)
    for name, (owner, replaced, block) in OLD.items()
}
