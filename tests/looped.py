"""Force scenes, devices and hands by chance, passive and not, for closed loops."""

import dataclasses as dc

import numpy as np

from stimlib import Input, Scene, constant
from stimlib.blocks import button, detents, fir, friction, oscillator, spring, wall, white_noise
from stimlib.run.safety import Passivity, Safety
from stimlib.virtual import Device, Faults, Hand, try_on

X = Input("x", "m")
BOUND, MOST = 0.02, 20.0  # J, N
FAULTS = {
    "none": Faults(),
    "encoder jumps by 5 mm": Faults(jump=(0.5, 5e-3)),
    "sensor stuck for 0.5 s": Faults(stuck=(0.5, 1.0)),
    "a tenth of the readings dropped": Faults(dropped=0.1),
    "a tenth of the forces lost": Faults(lost=0.1),
    "amplifier saturated at 0.5 N": Faults(saturated=(0.5, 0.5)),
}

STATED = {  # what the controller is told that may fail
    "encoder jumps by 5 mm": {},
    "sensor stuck for 0.5 s": {"still": 0.5},
    "a tenth of the readings dropped": {"still": 0.01},
    "a tenth of the forces lost": {"lost": 6},
    "amplifier saturated at 0.5 N": {"sure": 0.5},
}


def laws(rng, fs):
    """The laws that forces have, with numbers by chance; half of them may be active."""
    k = 10 ** rng.uniform(1.5, 3.5)
    return [
        lambda: spring(X, k),
        lambda: wall(X, k, b=rng.uniform(0.0, 2.0), at=rng.uniform(-5e-3, 5e-3)),
        lambda: detents(X, rng.uniform(1e-3, 1e-2), rng.uniform(0.05, 1.0)),
        lambda: button(X, rng.uniform(0.5, 3.0)).force,
        lambda: friction(X, constant(rng.uniform(0.5, 3.0), "N"), mu=rng.uniform(0.2, 1.0)),
        lambda: constant(rng.uniform(-3.0, 3.0) * fs, "N/m") * fir(X, [1.0, -1.0]),
        lambda: -1.0 * spring(X, 0.3 * k),
        lambda: constant(rng.uniform(-3.0, 3.0), "N"),
        lambda: constant(rng.uniform(0.1, 3.0), "N") * oscillator(rng.uniform(2.0, 200.0)),
        lambda: constant(rng.uniform(0.05, 0.5), "N") * white_noise(int(rng.integers(1000))),
        lambda: spring(fir(X, np.ones(9) / 9), k),
    ]


def drawn(seed):
    """A scene, a device, a hand, what ``try_on`` takes besides, and a safety stage."""
    rng = np.random.default_rng([seed, 69])
    fs = float(rng.choice([1000, 4000, 10_000]))
    known = laws(rng, fs)
    force = 0.0 * spring(X, 1.0)
    for k in rng.choice(len(known), rng.integers(1, 4), replace=False):
        force = force + known[k]()
    late, step = rng.choice([0.0, 1e-3, 3e-3]), rng.choice([0.0, 1e-6, 2e-5, 1e-4])
    handle = 0.03 * (rng.random() < 0.2)
    device = Device(
        mass=10 ** rng.uniform(-1.5, -0.5),
        damping=rng.uniform(0.0, 1.0),
        coulomb=float(rng.choice([0.0, 0.02, 0.2])),
        encoder=float(step),
        delay=float(late),
        compliance=1e-4 * (handle > 0),
        handle=handle,
    )
    mass, damping, grip = rng.uniform(0.0, 0.1), rng.uniform(0.2, 6.0), 10 ** rng.uniform(1.0, 3.0)
    hand = Hand(mass, damping, grip, tremor=float(rng.choice([0.0, 1e-4, 1e-3])))
    size, rate = rng.uniform(2e-3, 0.02), rng.uniform(0.5, 3.0)
    words = {
        "fs": fs,
        "start": rng.uniform(-0.01, 0.01),
        "aim": lambda t: size * np.sin(2 * np.pi * rate * t),
        "push": rng.uniform(-0.5, 0.5),
        "seed": seed,
    }
    passive = Passivity(BOUND, 2.0, speed=2.0, delay=device.delay, encoder=device.encoder)
    return Scene({"force": force}), device, hand, words, Safety(MOST, passivity=passive)


def judged(seed, fault="none"):
    """Give what one of them did with the controller, and the energy given without."""
    scene, device, hand, words, safety = drawn(seed)
    words = words | {"faults": FAULTS[fault]}
    if fault != "none":
        safety = dc.replace(safety, passivity=dc.replace(safety.passivity, **STATED[fault]))
    on = try_on(scene, device, hand, safety=safety, **words)
    off = try_on(scene, device, hand, safety=dc.replace(safety, passivity=None), **words)
    asked = np.clip(on.asked, -MOST, MOST)
    told = on.told["energy"]["force"]
    return {
        "on": on.given,
        "off": off.given,
        "observed": told["given"],
        "most": float(np.abs(on.force).max()),
        "error": float(np.sqrt(np.mean((on.force - asked) ** 2))),
        "force": float(np.sqrt(np.mean(asked**2))),
        "changed": on.told["clips"].get("passivity", {}).get("force", 0),
        "leaps": told["leaps"],
        "told": on.told["hardware"],
    }
