"""Which shipped force scenes come to rest on virtual devices, in which hands.

    python benchmarks/closed_loop.py            print
    python benchmarks/closed_loop.py --record   and keep the table of docs/tutorial

Each hand is thrown at the scene from 10 mm away. A cell has how many of five hands
come to rest, and the damping that the worst hand needs. Then random force scenes on
random devices (``tests/looped.py``), with the passivity controller and without, and with
faults of the hardware; then how fast that is.
"""

from __future__ import annotations

import csv
import io
import sys
import time
from pathlib import Path

import stimlib
from stimlib import scenes
from stimlib.errors import StimlibError
from stimlib.virtual import Device, Hand, swept_damping, try_on

TABLE = Path(__file__).parents[1] / "docs" / "tutorial" / "closed_loop.csv"
RUNS = {"none": 1000}  # and of each fault:
SOME = 200
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
SCENES = {
    "wall": scenes.wall(),
    "viscoelastic": scenes.viscoelastic(),
    "friction": scenes.friction(),
    "grating": scenes.grating(),
    "click": scenes.click(),
    "impact": scenes.impact(),
    "squeeze": scenes.squeeze(fingers=1),
}


def cell(scene: stimlib.Scene, fs: float, device: Device) -> str:
    try:
        trials = [
            try_on(scene, device, hand, fs=fs, start=-0.01, aim=0.01, push=0.3, seconds=3.0)
            for hand in HANDS.values()
        ]
        needed = swept_damping(scene, fs=fs, delay=device.delay, center=0.005, size=200)[1].max()
    except StimlibError as e:
        return str(e).partition(":")[0] + " refuses"
    rest = sum(trial.settles for trial in trials)
    return f"{rest} of {len(trials)}; {max(0.0, needed):.2g} N s/m"


def main() -> None:
    rows = [["scene", *DEVICES]]
    for name, scene in SCENES.items():
        rows.append([name, *(cell(scene, *how) for how in DEVICES.values())])
        print(*rows[-1], sep=", ", flush=True)
    if "--record" in sys.argv[1:]:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        TABLE.write_text(text.getvalue(), "utf-8")
    for what, (fs, device) in DEVICES.items():
        begun = time.process_time()
        try_on(SCENES["wall"], device, HANDS["light"], fs=fs, seconds=10.0)
        print(f"{what}: {10.0 / (time.process_time() - begun):.0f} times real time")


if __name__ == "__main__":
    main()
