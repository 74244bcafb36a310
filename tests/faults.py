"""Faults that a verifier must see: put into a block, into delivered samples, into what
a file says.

``FAULTS`` maps the name of each to a function of a folder, which gives the checks that
failed, or why it was refused.
"""

import contextlib
import dataclasses as dc
import hashlib
import importlib
import json
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

import stimlib
from stimlib import Input, Scene, StimlibError, blocks as b, constant
from stimlib.blocks.contact import Button, Detents, StaticLimit, StickSlip, Wall
from stimlib.blocks.events import Integrate
from stimlib.blocks.filters import (
    CascadeState,
    Delay,
    Differentiator,
    Taps,
    Track,
    TrackVelocity,
    track,
    track_velocity,
)
from stimlib.blocks.fractional import ShortMemory, Springpot, SpringpotLive
from stimlib.blocks.impedance import FirstOrder, Gate, GateState, Velocity, VelocityState, pole_gain
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
from stimlib.blocks.sources import Ring
from stimlib.blocks.surfaces import Grating, LinearBump, SineBump, SpatialNoise
from stimlib.blocks.tables import Lut
from stimlib.blocks.texture import Texture
from stimlib.blocks.viscoelastic import (
    KelvinChain,
    MaxwellArms,
    Series,
    compliance_kelvin_voigt,
    maxwell,
)
from stimlib.core.maths import copy, modes as modes_sum, pairs, where
from stimlib.files import audio as file
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
from stimlib.targets.numba import engine as target

U = np.uint64
MOTION = {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.015, rise=0.25)}
SEED = 5


def scaled(f, change):
    """A design(fs) whose parameters are changed."""

    def design(self, fs):
        p, s = f(self, fs)
        return change(p), s

    return design


def louder(p):
    return p._replace(r=p.r * 10**0.01, d=p.d * 10**0.01)


def steeper(p):
    return p._replace(taps=p.taps * 1.01)


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


PERIOD, FEW, LEAD = U(16383), U(500), U(1 << 62)


def periodic(key, m):
    return deviates(key, m & PERIOD)  # 32768 samples


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


def strong_spring(x, k, right=None):
    return stimlib.blocks.spring(x, k) * 1.01


# name: (owner, attribute, replacement, groups of which at least one check must fail)
MUTATIONS = {
    "pink 0.2 dB off, in the design": (
        PinkNoise,
        "design",
        scaled(PinkNoise.design, louder),
        {"a2"},
    ),
    "pink 0.2 dB off, in the compiled residues": (target, "_parameter_words", wrong_words, {"a1"}),
    "FIR gain 1 % off": (Differentiator, "design", scaled(Differentiator.design, steeper), {"a2"}),
    "one tap off by 1e-4": (
        Differentiator,
        "design",
        scaled(Differentiator.design, off_tap),
        {"a2"},
    ),
    "gate inverted": (Gate, "tile", staticmethod(inverted_tile), {"d"}),
    "gate early by one sample": (Gate, "tile", staticmethod(early_tile), {"d"}),
    "one noise for both fingers": (White, "start", one_stream, {"c"}),
    "seed ignored": (White, "start", no_seed, {"c"}),
    "noise that repeats every 32768 samples": (White, "tile", staticmethod(periodic_tile), {"c"}),
    "deviates of one radius from sample 1000 on": (White, "tile", staticmethod(flat_tile), {"c"}),
    "rate doubled": (
        Velocity,
        "design",
        scaled(Velocity.design, lambda p: p._replace(fs=2 * p.fs)),
        {"a2", "d"},
    ),
    "k 1 % off": (
        importlib.import_module("stimlib.scenes.squeeze"),
        "spring",
        strong_spring,
        {"d"},
    ),
    "state that depends on the cut": (Modes, "tile", staticmethod(forgetful_tile), {"b"}),
}


def failed(scene=None, motion=MOTION, seed=SEED, seconds=2.0, **words):
    scene = scene or squeeze()
    rendering = stimlib.render(scene, motion, 8000, seconds, seed=seed, **words)
    return [c for c in stimlib.verify(scene, motion, rendering).checks if not c.passed]


# Numbers of a block's design, and a scene that has it ---------------------------------
X, WAVE = Input("x", "m"), {"x": sinusoid(0.01, 3.0)}
N = constant(1.0, "N/m")
PROFILE = [0.0, 0.03, 0.05, 0.07, 0.1], [1.0, 1.6, 1.84, 1.6, 1.0]


def times(name, factor, more=0.0):
    return lambda p: p._replace(**{name: getattr(p, name) * factor + more})


def scene_of(block):
    return Scene({"y": block})


STROKE = {"x": sinusoid(0.03, 1.0), "force": sinusoid(0.8, 3.0, mean=1.0)}
# name: (class, change of its design or fields of the block instead, scene, motion)
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
        scene_of(b.compliance(N * X, 2.0, 1.0)),
        WAVE,
    ),
    "a FIR tap 1e-9 off": (
        Taps,
        lambda p: p._replace(taps=p.taps + 1e-9),
        scene_of(b.fir(X, [0.5, 0.5])),
        WAVE,
    ),
    "pinking 0.02 dB off": (
        Pinking,
        lambda p: p._replace(r=p.r * 1.0023, d=p.d * 1.0023),
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
        lambda p: p._replace(half=1.0),
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
    "delay of one sample more": (Delay, {"samples": 6}, scene_of(b.delay(X, 5)), WAVE),
    "order of a springpot 1e-6 off": (
        Springpot,
        {"order": 0.5 + 1e-6},
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


def design_fault(owner, change, scene, motion):
    def other(self, fs):
        return honest(dc.replace(self, **change), fs)

    honest = owner.design
    replacement = other if isinstance(change, dict) else scaled(honest, change)

    def run(folder):
        with patch.object(owner, "design", replacement):
            return failed(scene, motion, seconds=1.5)

    return run


# Formulas that blocks had, and that were not what their docstring says
def warped(self, fs):
    """A resonance whose width shrinks towards fs/2: g/q in place of (1 + g^2) tan(pi
    freq/(q fs)).
    """
    g = np.tan(np.pi * self.freq / fs)
    return section(g, g / self.q, "notch" if self.notched else "bandpass"), CascadeState(
        *np.zeros((4, 1))
    )


HONEST_KERNEL = Springpot.design


def half_a_sample_early(self, fs):
    """Creep with the weights of a force that is held between samples."""
    return HONEST_KERNEL(dc.replace(self, scheme="l1"), fs)


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


def hundred_samples(self, fs):
    """The last 100 samples, whatever the rate is."""
    return HONEST_SHORT(dc.replace(self, seconds=100 / fs), fs)


HONEST_SHORT, HONEST_TAPS, HONEST_LAG = ShortMemory.design, Taps.design, FirstOrder.design


def at_the_sample(self, fs):
    """The spring's position at the sample, half a sample before that of its damper."""
    return HONEST_TAPS(dc.replace(self, taps=np.array([1.0, 0.0])), fs)


def rounded_leak(self, fs):
    """A lag by exp(-1/(tau fs)), whose gain at 0 Hz is 1e-7 off for 1e6 s."""
    a = 1 / (self.tau * fs)
    now = a / 2 - a * a / 6 + a**3 / 24
    p, s = HONEST_LAG(self, fs)
    return type(p)(np.exp(-a), now, -np.expm1(-a) - now), s


OLD = {
    "short memory in samples": (
        ShortMemory, {"design": hundred_samples}, b.springpot(X, 3.0, 0.4, "gl-short-memory"),
    ),
    "creep half a sample early": (
        Springpot, {"design": half_a_sample_early}, b.compliance(N * X, 2.0, 0.5, "l1"),
    ),
    "a resonator that warps": (Resonator, {"design": warped}, b.resonator(X, 700.0, 20.0)),
    "a notch that warps": (Resonator, {"design": warped}, b.notch(X, 700.0, 5.0)),
    "a spring half a sample early": (
        Taps, {"design": at_the_sample}, b.kelvin_voigt(X, 300.0, 10.0),
    ),
    "a lag whose leak is rounded": (
        FirstOrder, {"design": rounded_leak}, b.first_order(X, 1e6),
    ),
    "a damper that lags": (Springpot, LATE, b.kelvin_voigt(X, 300.0, 2.0)),
}  # fmt: skip


def old_fault(owner, replaced, block):
    def run(folder):
        with contextlib.ExitStack() as stack:
            for attribute, replacement in replaced.items():
                stack.enter_context(patch.object(owner, attribute, replacement))
            return failed(scene_of(block), WAVE, seconds=0.5)

    return run


# Delivered samples --------------------------------------------------------------------
def shift(y):
    return np.roll(y, 1, axis=1)


def bit(y):
    y[1, 4321] = np.nextafter(y[1, 4321], 1e9)
    return y


def hole(y):
    y[:, 5000:5008] = 0.0
    return y


SAMPLES = {
    "one bit of one sample": bit,
    "channels swapped": lambda y: y[::-1].copy(),
    "one sample late": shift,
    "sign of a channel": lambda y: y * [[1.0], [-1.0]],
    "1e-12 too loud": lambda y: y * (1 + 1e-12),
    "an offset of 1e-9 N": lambda y: y + 1e-9,
    "eight samples lost": hole,
    "the second half repeated": lambda y: np.hstack([y[:, :8000], y[:, :8000]]),
    "one channel for both": lambda y: y[[0, 0]],
    "not a number at the end": lambda y: np.where(np.arange(y.shape[1]) == 15999, np.nan, y),
}


def sample_fault(change):
    def run(folder):
        r = stimlib.render(squeeze(), MOTION, 8000, 2.0, seed=SEED)
        return [
            c
            for c in stimlib.verify(squeeze(), MOTION, dc.replace(r, y=change(r.y.copy()))).checks
            if not c.passed
        ]

    return run


OTHERWISE = {
    "another seed": {"seed": SEED + 1},
    "another motion": {"motion": MOTION | {"x1": minimum_jerk(depth=0.0200001)}},
    "another stiffness": {"params": {"k": 2000.001}},
    "another sample rate": {"fs": 8001.0},
}


def otherwise_fault(words):
    def run(folder):
        given = {"motion": MOTION, "fs": 8000.0, "seed": SEED, "params": None} | words
        played = stimlib.render(
            squeeze(), given["motion"], given["fs"], 1.0, given["params"], given["seed"]
        )
        claimed = dc.replace(
            stimlib.render(squeeze(), MOTION, 8000, 1.0, seed=SEED), y=played.y[:, :8000].copy()
        )
        return [c for c in stimlib.verify(squeeze(), MOTION, claimed).checks if not c.passed]

    return run


# What a file says ---------------------------------------------------------------------
def channel(k, **what):
    return lambda d: d["channels"][k].update(what)


def swap_names(d):
    a, b = d["channels"]
    a["name"], b["name"] = b["name"], a["name"]


def other_k(d):
    next(b for b in d["scene"]["blocks"] if b["fields"].get("name") == "k")["fields"]["value"] = (
        1000.0
    )


EDITS = {
    "a key of a channel more": lambda d: d["channels"][0].update(gain=2.0),
    "clips not counted": lambda d: d["channels"][0].update(clips=None),
    "format": lambda d: d.update(format="RF64"),
    "subtype": lambda d: d.update(subtype="DOUBLE"),
    "fs": lambda d: d.update(fs=8001.0),
    "frames": lambda d: d.update(frames=7999),
    "channel names": swap_names,
    "unit": channel(0, unit="mN"),
    "full scale": channel(1, full_scale=2.0),
    "clips": channel(1, clips=1),
    "clips moved": lambda d: (d["channels"][0].update(clips=1), d["channels"][1].update(clips=-1)),
    "peak": lambda d: d["channels"][0].update(peak=10 * d["channels"][0]["peak"]),
    "peak by a bit": (
        lambda d: d["channels"][1].update(peak=float(np.nextafter(d["channels"][1]["peak"], 0)))
    ),
    "seed": lambda d: d.update(seed=4),
    "params": lambda d: d["params"].update(k=1700.0),
    "params, one more": lambda d: d["params"].update(b=1.0),
    "index": lambda d: d.update(index=1),
    "log, value": lambda d: d["log"][0].update(value=1801.0),
    "log, ramp": lambda d: d["log"][0].update(ramp=0.1),
    "log, at": lambda d: d["log"][0].update(at=100),
    "log, lost": lambda d: d.update(log=[]),
    "log, one more, late": (
        lambda d: d["log"].append({"at": 5, "name": "k", "value": 1800.0, "ramp": 0.0})
    ),
    "motion, an input less": lambda d: d["motion"].pop("x2"),
    "scene, k": other_k,
    "scene, law": lambda d: d["scene"].update(law=None),
    "scene_hash": lambda d: d.update(scene_hash="0" * 64),
    "definitions, of no block": lambda d: d.update(
        definitions={"click_block": {"sha256": "0" * 64, "text": ""}}
    ),
    "sha256": lambda d: d.update(sha256="0" * 64),
    "sha256, none": lambda d: d.update(sha256=None),
    "a key more": lambda d: d.update(calibrated=True),
}
FILE_MOTION = {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.01)}


def honest_file(folder):
    """Bytes and sidecar of a correct file."""
    proc = stimlib.compile(squeeze(), 8000, seed=3)
    proc.set("k", 1800.0, ramp=0.0)
    file.write(folder / "honest.wav", proc, FILE_MOTION, 1.0, progress=False)
    return (folder / "honest.wav").read_bytes(), json.loads(
        (folder / "honest.wav.json").read_text()
    )


def verified(folder, audio, told, name="a.wav"):
    """The report of a file with this sidecar, whose hash of the file is made again."""
    (folder / name).write_bytes(audio)
    told = told | {"file_sha256": hashlib.sha256(audio).hexdigest()}
    (folder / f"{name}.json").write_text(json.dumps(told))
    return stimlib.verify(squeeze(), FILE_MOTION, folder / name)


def step_fault(owner, attribute, replacement, groups):
    def run(folder):
        with patch.object(owner, attribute, replacement):
            return failed(seconds=15.0 if "tile" in attribute and owner is White else 2.0)

    return run


FAULTS = (
    {name: step_fault(*fault) for name, fault in MUTATIONS.items()}
    | {name: design_fault(*fault) for name, fault in DESIGNS.items()}
    | {f"old formula: {name}": old_fault(*fault) for name, fault in OLD.items()}
    | {f"samples: {name}": sample_fault(change) for name, change in SAMPLES.items()}
    | {f"played otherwise: {name}": otherwise_fault(words) for name, words in OTHERWISE.items()}
)


def caught(name: str, folder: Path) -> list[str]:
    """The checks that see a fault, or why it is refused; empty if nothing does."""
    try:
        return [f"({c.group}) {c.name}" for c in FAULTS[name](folder)]
    except StimlibError as error:
        return [f"refused: {error}"]
