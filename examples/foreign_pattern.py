"""A tap with a fading buzz for a phone, as AHAP, .haptic and .hjif, and what
each of them loses.

python examples/foreign_pattern.py [FOLDER]
"""

import sys
import tempfile
from pathlib import Path

import stimlib
from stimlib.blocks import at, oscillator, ring, timeline
from stimlib.files import PatternDevice, read_pattern, write_pattern


def scene() -> stimlib.Scene:
    tap = ring(5.0 * at(0.1), freq=180, decay=0.0073)
    pitch = timeline([(0.2, 120.0), (1.0, 200.0)], unit="Hz")
    buzz = timeline([(0.2, 0.0), (0.3, 2.0), (1.0, 0.0)]) * oscillator(pitch)
    return stimlib.Scene({"acceleration": stimlib.constant(1.0, "m/s^2") * (tap + buzz)})


def main(folder: Path) -> None:
    made = stimlib.render(scene(), fs=8000, seconds=1.1)
    for suffix in (".ahap", ".haptic", ".hjif"):
        print(write_pattern(folder / f"tap{suffix}", made, PatternDevice(f_lo=80, f_hi=230)))
    back = read_pattern(folder / "tap.haptic", PatternDevice(5.0, "m/s^2", f_lo=80, f_hi=230))
    print(back.scene, f"{back.seconds:g} s")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        main(Path(sys.argv[1] if len(sys.argv) > 1 else temporary))
