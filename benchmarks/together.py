"""What is seen and what is felt begin together: 200 bursts and 200 pictures.

``python benchmarks/together.py [SINK] > FILE.csv``, on a display, with PsychoPy: a
burst every 0.3 s on a sink, and at the time at which it leaves the device a circle on a
window of PsychoPy. The offset is from the burst's marker to the end of the flip.
"""

from __future__ import annotations

import csv
import sys
import time

import numpy as np

from stimlib import Scene
from stimlib.blocks import burst, every, oscillator
from stimlib.devices import make

PERIOD, TRIALS, FS = 0.3, 200, 48000


def main(kind: str) -> None:
    from psychopy import visual

    window = visual.Window((400, 300), units="norm", color="black")
    circle = visual.Circle(window, radius=0.2, fillColor="white")
    frames = [window.flip() for _ in range(60)]
    start = every(PERIOD)
    scene = Scene(
        {
            "force": oscillator(250.0) * burst(start, 0.1, ramp=0.01),
            "onset": burst(start, 0.005),
        }
    )
    told, flips = [], []
    options = {"markers": ["onset"], "send": told.append}
    with make(kind, scene, 10.0, **options) as sink:
        sink.open(FS, channels=["force"])
        sink.start(PERIOD * (TRIALS + 3))
        time.sleep(2 * PERIOD)
        for k in range(3, TRIALS + 3):
            due, _ = sink.time_of(round(k * PERIOD * FS))
            circle.draw()
            time.sleep(max(0.0, due - time.monotonic() - 2e-3))
            while time.monotonic() < due - 2e-4:
                pass
            window.flip()
            flips.append(time.monotonic())
            time.sleep(0.1)
            window.flip()
        sink.wait()
    felt = {m.sample: m for m in told}
    shown = [felt[round(k * PERIOD * FS)] for k in range(3, TRIALS + 3)]
    offsets = 1e3 * (np.array(flips) - [m.time for m in shown])
    rows = {
        "trials": len(offsets),
        "lost": sum(m.lost for m in shown),
        "frame_ms": 1e3 * float(np.median(np.diff(frames))),
        "offset_median_ms": float(np.median(offsets)),
        "jitter_5_95_ms": float(np.ptp(np.percentile(offsets, [5, 95]))),
        "largest_ms": float(np.abs(offsets).max()),
        "uncertainty_ms": 1e3 * max(m.uncertainty for m in shown),
    }
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(["sink", *rows])
    out.writerow([kind, *(f"{v:.3g}" for v in rows.values())])


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "null")
