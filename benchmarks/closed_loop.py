"""Which shipped force scenes come to rest on virtual devices, in which hands.

    PYTHONPATH=tests python benchmarks/closed_loop.py            print
    PYTHONPATH=tests python benchmarks/closed_loop.py --record   and keep both tables

Each hand is thrown at the scene from 10 mm away. A cell has how many of five hands
come to rest, and the damping that the worst hand needs. Then random force scenes on
random devices (``tests/looped.py``), with the passivity controller and without, also
with faults of the hardware; then how fast that is, and what the controller costs.
"""

from __future__ import annotations

import csv
import io
import sys
import time
from pathlib import Path

import numpy as np
from looped import BOUND, FAULTS, judged

import stimlib
from stimlib import Input, Scene, scenes
from stimlib.blocks import button, spring
from stimlib.errors import StimlibError
from stimlib.run.safety import GAIN, Passivity, Safety, protect
from stimlib.virtual import Device, Hand, swept_damping, try_on

TABLES = Path(__file__).parents[1] / "docs" / "tutorial"
RUNS, OF_FAULTS = 1000, 200
RADIUS = 0.02  # m, of the knob that is the device of a torque
DEVICES = {  # assumed: a light device of one axis at three rates
    "1 kHz, 3 ms": (1000.0, Device(0.08, 0.4, coulomb=0.02, encoder=20e-6, delay=3e-3)),
    "4 kHz, 1 ms": (4000.0, Device(0.08, 0.4, coulomb=0.02, encoder=20e-6, delay=1e-3)),
    "10 kHz, 0 ms": (10_000.0, Device(0.08, 0.4, coulomb=0.02, encoder=20e-6)),
}
HANDS = {  # assumed, from a finger laid on to a firm grip
    "none": Hand(),
    "laid on": Hand(0.005, 0.5, 30.0),
    "light": Hand(0.02, 1.0, 100.0),
    "usual": Hand(0.05, 3.0, 300.0),
    "firm": Hand(0.1, 6.0, 800.0),
}
SCENES = {  # of a soft surface the force follows the pressure, held at half
    "wall": scenes.wall(),
    "viscoelastic": scenes.viscoelastic(),
    "friction": scenes.friction(),
    "ultrasonic_friction": scenes.ultrasonic_friction(),
    "grating": scenes.grating(),
    "detents": scenes.detents(),
    "click": scenes.click(),
    "button, the block": Scene({"force": button(Input("x", "m"), 2.0).force}),
    "impact": scenes.impact(),
    "squeeze": scenes.squeeze(fingers=1),
    "soft_surface": scenes.soft_surface(),
}
AXES = {"soft_surface": ("force", "x")}


def cell(name: str, fs: float, device: Device) -> str:
    scene = SCENES[name]
    r = RADIUS if name == "detents" else 1.0  # of a torque: all lengths as angles
    turned = Device(
        device.mass * r**2, device.damping * r**2, device.coulomb * r, device.encoder / r,
        delay=device.delay,
    )  # fmt: skip
    how = {"fs": fs, "axis": AXES.get(name)}
    held = {"motion": {"press": 0.5, "y": 0.05}} if name in AXES else {}
    try:
        trials = [
            try_on(
                scene, turned, Hand(h.mass * r**2, h.damping * r**2, h.stiffness * r**2),
                start=-0.01 / r, aim=0.01 / r, push=0.3 * r, seconds=3.0, **how, **held,
            )
            for h in HANDS.values()
        ]  # fmt: skip
        swept = {"delay": device.delay, "center": 0.005 / r, "amplitude": 1e-3 / r, "size": 200}
        needed = swept_damping(scene, **how, **swept)[1].max()
    except StimlibError as e:
        return str(e).partition(":")[0] + " refuses"
    rest = sum(trial.settles for trial in trials)
    unit = "mN m s" if r < 1 else "N s/m"
    size = f"{needed * (1e3 if r < 1 else 1):.2g} {unit}" if needed > 1e-9 else "none"
    return f"{rest} of {len(trials)}; {size}"


def bounded(fault: str, runs: int) -> list[str]:
    """One row: what random scenes gave with the controller and without."""
    rows = [judged(seed, fault) for seed in range(runs)]
    on, off, error, force, changed, leaps = (
        np.array([row[k] for row in rows])
        for k in ("on", "off", "error", "force", "changed", "leaps")
    )
    part = np.percentile(error[changed > 0] / force[changed > 0].clip(1e-9), 50)
    return [
        fault,
        f"{runs}",
        f"{np.sum(off > BOUND)}",
        f"{1e3 * off.max():.3g} mJ",
        f"{np.sum(on > BOUND * (1 + 1e-9))}",
        f"{1e3 * on.max():.5g} mJ",
        f"{np.sum(changed == 0)}",
        f"{100 * part:.0f} %; {np.percentile(error, 95):.2g} N",
        f"{np.sum(leaps > 0)}",
        f"{sum(1 for row in rows if row['told'])}",
    ]


OF_RANDOM = [
    "fault", "runs", "off: above the bound", "off: most given", "on: above the bound",
    "on: most given", "on: not changed", "on: error of the force", "on: positions not trusted",
    "told of the hardware",
]  # fmt: skip


def cost() -> str:
    """Nanoseconds a sample of the controller, in turns with the same stage without."""
    scene = Scene({"force": spring(Input("x", "m"), 1000.0)})
    x, out = 0.01 * np.sin(np.arange(64) / 400.0)[None], np.empty((1, 64))
    procs = []
    for passivity in (None, Passivity(10.0, 2.0), Passivity(1e-3, 2.0, delay=0.003)):
        procs.append(stimlib.compile(protect(scene, Safety(50.0, passivity=passivity)), 8000))
        procs[-1].set(GAIN, 1.0, ramp=0.0)

    def seconds(proc):
        begun = time.process_time()
        for _ in range(5000):
            proc.process(x, out)
        return (time.process_time() - begun) / 5000 / 64

    off, idle, acts = np.median([[seconds(p) for p in procs] for _ in range(15)], axis=0) * 1e9
    return (
        f"safety stage {off:.1f} ns a sample; with observer and controller {idle:.1f},"
        f" and {acts:.1f} where it acts"
    )


def record(name: str, rows: list[list[str]]) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    (TABLES / name).write_text(text.getvalue(), "utf-8")


def main() -> None:
    tables = {"closed_loop.csv": [["scene", *DEVICES]], "passivity_controller.csv": [OF_RANDOM]}
    for name in SCENES:
        row = [name, *(cell(name, *how) for how in DEVICES.values())]
        tables["closed_loop.csv"].append(row)
        print(*row, sep=", ", flush=True)
    for fault in FAULTS if "--shipped" not in sys.argv else ():
        row = bounded(fault, RUNS if fault == "none" else OF_FAULTS)
        tables["passivity_controller.csv"].append(row)
        print(*row, sep=", ", flush=True)
    if "--record" in sys.argv[1:]:
        for name, rows in tables.items():
            record(name, rows)
    print(cost())
    for what, (fs, device) in DEVICES.items():
        begun = time.process_time()
        try_on(SCENES["wall"], device, HANDS["light"], fs=fs, seconds=10.0)
        print(f"{what}: {10.0 / (time.process_time() - begun):.0f} times real time")


if __name__ == "__main__":
    main()
