"""Correct renderings of every kind, drawn at random: scenes, rates from 1 to 192 kHz,
tolerances, seeds, hands, parameters.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

import stimlib
from stimlib import Block, Input, Param, Scene, blocks as b, constant
from stimlib.blocks import maxwell, track
from stimlib.motion import (
    constant_speed,
    jittered,
    minimum_jerk,
    quantised,
    ramp_and_hold,
    sinusoid,
)
from stimlib.scenes import bumps, squeeze, viscoelastic


class HighParams(NamedTuple):
    p: float


class HighState(NamedTuple):
    x: float
    y: float


@dataclass(frozen=True, eq=False)
class OwnHighPass(Block):
    """A block of a user: y[n] = p (y[n-1] + x[n] - x[n-1])."""

    x: Block
    tau: float

    def design(self, fs):
        return HighParams(self.tau * fs / (1 + self.tau * fs)), HighState(0.0, 0.0)

    @staticmethod
    def step(p, s, x):
        y = p.p * (s.y + x - s.x)
        return y, HighState(x, y)

    @staticmethod
    def transfer(p, z):
        return p.p * (1 - 1 / z) / (1 - p.p / z)


def hand(rng, top):
    """A motion, moving or held."""
    kind = rng.integers(0, 8)
    held = np.full(200000, top * rng.random())
    return (
        held,
        held + 1e-6 * (np.arange(200000) // int(rng.integers(10, 999)) % 2),
        minimum_jerk(depth=top * rng.uniform(0.1, 1.0), rise=rng.uniform(0.05, 0.4)),
        ramp_and_hold(top * rng.uniform(0.1, 1.0), rng.uniform(0.05, 1.0)),
        sinusoid(top * rng.uniform(0.05, 0.5), rng.uniform(0.3, 8.0)),
        quantised(minimum_jerk(depth=top), 1e-6),
        jittered(
            quantised(ramp_and_hold(top, 0.1), 1e-6), 1e-6, rate=900.0, seed=int(rng.integers(99))
        ),
        np.zeros(200000),
    )[kind]


def _squeeze(rng):
    fs = float(rng.choice([4000, 8000, 16000, 48000, 96000]))
    fingers, contact = int(rng.integers(1, 3)), bool(rng.integers(2))
    words = {
        "k": rng.uniform(100, 5000),
        "A": rng.choice([0.0, 0.1, 3.4, 20.0]),
        "fingers": fingers,
        "contact": contact,
        "seed": int(rng.integers(1000)),
        "passband": 800.0 if fs < 8000 else 1000.0,
        "f_low": rng.choice([5.0, 10.0, 30.0]),
        "tol_db": rng.choice([0.01, 0.1, 1.0]),
        "cutoff": rng.choice([30.0, 100.0, 300.0]),
        "limits": bool(rng.integers(3) == 0),
    }
    motion = {f"x{i + 1}": hand(rng, 0.03) for i in range(fingers)}
    if contact:
        motion["contact"] = (lambda f: lambda t: 1.0 * (np.sin(f * t) > -0.4))(rng.uniform(1, 40))
    return squeeze(**words), motion, fs, {"k": rng.uniform(100, 5000), "level": rng.uniform(0, 2)}


def _viscoelastic(rng):
    fs = float(rng.choice([1000, 8000, 48000, 96000, 192000]))
    alpha = float(rng.choice([0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0, rng.random()]))
    scene = viscoelastic(
        alpha, scheme=str(rng.choice(["gl", "l1"])), tol=float(10 ** -rng.uniform(4, 14))
    )
    return scene, {"y": hand(rng, 0.03)}, fs, {"firmness": rng.uniform(0.1, 3)}


def _live_order(rng):
    fs = float(rng.choice([1000, 8000, 48000]))
    part = b.springpot(Input("y", "m"), 100.0, Param("alpha", 0.5), str(rng.choice(["gl", "l1"])))
    return (
        Scene({"force": Param("firmness", 1.0) * part}, "viscoelastic"),
        {"y": hand(rng, 0.03)},
        fs,
        {"alpha": rng.random()},
    )


def _bumps(rng):
    fs = float(rng.choice([2000, 8000, 48000, 192000]))
    profile = [0.0, 0.03, 0.05, 0.07, 0.1], 1 + rng.random(5)
    words = (
        {},
        {"limit": 120.0},
        {"limit": 120.0, "headroom": "scale"},
        {"displacement": profile},
        {"displacement": profile, "limit": 150.0},
    )
    wave = str(rng.choice(["square", "sine", "sawtooth", "half_sine"]))
    scene = bumps(
        wave,
        int(rng.integers(1, 30)),
        rng.uniform(0.05, 1),
        rng.uniform(0, 8),
        **words[rng.integers(5)],
    )
    x = constant_speed(rng.uniform(0.001, 1.0), 0.1) if rng.integers(3) else hand(rng, 0.1)
    return (
        scene,
        {"x": x},
        fs,
        {"freq": rng.choice([0.0, 1.0, 158.0, rng.uniform(0, 900)]), "duty": rng.uniform(0.05, 1)},
    )


def _own(rng):
    fs = float(rng.choice([4000, 8000, 44100, 48000, 192000]))
    x = Input("x", "m")
    noise = b.enabled(
        b.pink_noise(1.0, int(rng.integers(99)), f_low=10.0), by=x > constant(0.005, "m")
    )
    force = maxwell(
        OwnHighPass(x, 0.05) + track(x, 20.0), 200.0, tau=float(10 ** rng.uniform(-6, 2))
    )
    outputs = {
        "f": force,
        "n": Param("g", 1.0) * noise + b.white_noise(500),
        "d": b.delay(b.first_order(x, 0.01), 7),
    }
    return Scene(outputs), {"x": hand(rng, 0.02)}, fs, {"g": rng.uniform(-1, 1)}


KINDS = {
    "squeeze": _squeeze,
    "viscoelastic": _viscoelastic,
    "live order": _live_order,
    "bumps": _bumps,
    "own": _own,
}


def rendering(rng):
    """(kind, scene, motion, function of both that renders it)."""
    kind = str(rng.choice(list(KINDS)))
    scene, motion, fs, params = KINDS[kind](rng)
    seconds, seed = min(rng.uniform(0.05, 2.0), 100000 / fs), int(rng.integers(2**63))
    given = params if rng.integers(2) else {}
    return kind, scene, motion, lambda s, m: replace(stimlib.render(s, m, fs, seconds, given, seed))
