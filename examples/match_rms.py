"""Two waveforms, one RMS: the sawtooth bumps and the sine bumps that are as strong as
given square ones, found by gradients.

python examples/match_rms.py [--plot FILE]
"""

import argparse

import numpy as np

import stimlib
from stimlib.motion import minimum_jerk
from stimlib.scenes import bumps

FS = 8000  # Hz


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def main() -> None:
    # a finger goes over the bumps and back
    motion = {"x": minimum_jerk(depth=0.1, rise=2.0, hold=0.1, fall=2.0)}
    square = stimlib.render(bumps("square", duty=0.5, amplitude=4.0), motion, FS, seconds=4.2)[
        "voltage"
    ]

    sawtooth = bumps("sawtooth", duty=0.8)
    amplitude = stimlib.fit(sawtooth, motion, square, {"A": 4.0}, "rms", fs=FS, seconds=4.2)
    sine = bumps("sine", amplitude=6.0)
    duty = stimlib.fit(sine, motion, square, {"duty": (0.5, 0, 1)}, "rms", fs=FS, seconds=4.2)

    print(f"square   A = 4.0000 V, duty 0.5000: {rms(square):.6f} V rms")
    for name, fit in (("sawtooth", amplitude), ("sine", duty)):
        A, d = (fit.scene.params[p].value for p in ("A", "duty"))
        voltage = stimlib.render(fit.scene, motion, FS, seconds=4.2)["voltage"]
        print(f"{name:8} A = {A:.4f} V, duty {d:.4f}: {rms(voltage):.6f} V rms")
    # [end]

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", metavar="FILE", help="also draw the three voltages")
    if (path := parser.parse_args().plot) is not None:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8, 6), layout="constrained")
        rows = {
            "square": square,
            "sawtooth": amplitude.signals["voltage"],
            "sine": duty.signals["voltage"],
        }
        for axes, (name, voltage) in zip(
            figure.subplots(3, 1, sharex=True, sharey=True), rows.items(), strict=True
        ):
            axes.plot(np.arange(voltage.size) / FS, voltage, linewidth=0.3)
            axes.set(title=name, ylabel="voltage (V)")
        axes.set_xlabel("time (s)")
        figure.savefig(path)


if __name__ == "__main__":
    main()
