"""Different bumps of equal RMS, which the paper's subjects felt as equally rough: a
sine and a sawtooth.

python examples/equal_rms_bumps.py [--plot FILE]
"""

import argparse

import numpy as np

import stimlib
from stimlib.analysis.am import envelope_mean_square, rms
from stimlib.scenes import bumps

FS, SPEED = 8000, 0.02  # Hz, m/s


def equal_amplitude(
    waveform: str, duty: float, other: str, other_duty: float, other_amplitude: float
) -> float:
    """Amplitude of one kind of bumps that has the RMS of another."""
    ratio = envelope_mean_square(other, other_duty) / envelope_mean_square(waveform, duty)
    return other_amplitude * float(np.sqrt(ratio))


def rendered_rms(scenes, x) -> float:
    """Of one stroke, before the amplifier, over the carrier phases of these scenes."""
    squares = [np.mean(stimlib.render(scene, {"x": x}, FS).y ** 2) for scene in scenes]
    return float(np.sqrt(np.mean(squares))) / 50


def main() -> None:
    sine = ("sine", 6, 0.5, 4.0)
    sawtooth = ("sawtooth", 6, 0.8, equal_amplitude("sawtooth", 0.8, "sine", 0.5, 4.0))
    x = SPEED * np.arange(int(0.1 / SPEED * FS)) / FS  # one stroke over 0.1 m
    for waveform, nb, duty, amplitude in (sine, sawtooth):
        scenes = [bumps(waveform, nb, duty, amplitude, phase=2 * np.pi * k / 8) for k in range(8)]
        said, seen = rms(waveform, duty, amplitude), rendered_rms(scenes, x)
        print(
            f"{waveform:8s} duty {duty}, A = {amplitude:.3f} V: {said:.3f} V rms, rendered"
            f" {seen:.3f} V"
        )
    # [end]

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", metavar="FILE", help="also draw both voltages over the stroke")
    if (path := parser.parse_args().plot) is not None:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8, 5), layout="constrained")
        for axes, stimulus in zip(
            figure.subplots(2, 1, sharex=True), (sine, sawtooth), strict=True
        ):
            axes.plot(1e3 * x, stimlib.render(bumps(*stimulus), {"x": x}, FS).y[0], linewidth=0.3)
            axes.set_title(f"{stimulus[0]}, {stimulus[3]:.3g} V")
            axes.set_ylabel("voltage (V)")
        axes.set_xlabel("position (mm)")
        figure.savefig(path)


if __name__ == "__main__":
    main()
