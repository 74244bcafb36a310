"""A tap with a fading buzz for a phone, as AHAP, .haptic and .hjif, and what each of
them loses.

python examples/foreign_pattern.py [--plot picture.png] [--out FOLDER]
"""

import argparse
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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", help="file for a picture of the scene read back")
    parser.add_argument("--out", help="folder for the patterns; by default one that is removed")
    args = parser.parse_args()
    made = stimlib.render(scene(), fs=8000, seconds=1.1)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(args.out or temporary)
        for suffix in (".ahap", ".haptic", ".hjif"):
            path = folder / f"tap{suffix}"
            report = write_pattern(path, made, PatternDevice(f_lo=80, f_hi=230))
            samples, envelope, _ = report.lost["acceleration"]
            print(f"{path.name}: {report.points} points, {report.taps} transient; lost:", end=" ")
            print(f"{samples:.0f} dB of the samples, {envelope:.0f} dB of the envelope")
        device = PatternDevice(5.0, "m/s^2", f_lo=80, f_hi=230)
        back = read_pattern(folder / "tap.haptic", device)
    print(f"{back.scene}, {back.seconds:.2f} s")
    if args.plot:
        stimlib.render(back.scene, fs=8000, seconds=back.seconds).plot().savefig(args.plot)


if __name__ == "__main__":
    main()
