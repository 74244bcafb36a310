"""A block of your own: a one-pole low-pass filter, used in a scene and run on both
targets.

python examples/own_block.py [--plot FILE]
"""

import argparse
import math
from collections import namedtuple
from dataclasses import dataclass

import numpy as np

import stimlib
from stimlib.core.maths import flush, fma

LARGEST = 0.45  # of fs


OnePoleParams = namedtuple("OnePoleParams", "g")  # numbers that design makes once per sample rate
OnePoleState = namedtuple("OnePoleState", "y")  # everything that the next sample depends on


def towards(y, x, g):
    """A helper: written like a step, and compiled into it."""
    return flush(fma(g, x - y, y))


@dataclass(frozen=True, eq=False)
class OnePole(stimlib.Block):
    """First-order low-pass, y += g (x - y), g = 1 - exp(-2 pi cutoff / fs)."""

    x: stimlib.Block  # an input signal
    cutoff: float  # a design number, in Hz

    def design(self, fs):
        if not 0 < self.cutoff < LARGEST * fs:
            raise stimlib.BadValue(
                f"OnePole.cutoff = {self.cutoff:g} Hz must be above 0 and below {LARGEST * fs:g} Hz"
            )
        return OnePoleParams(-math.expm1(-2 * math.pi * self.cutoff / fs)), OnePoleState(0.0)

    @staticmethod
    def step(p, s, x):
        y = towards(s.y, x, p.g)
        return y, OnePoleState(y)

    @staticmethod
    def transfer(p, z):
        return p.g / (1 - (1 - p.g) / z)


# [use]
def scene() -> stimlib.Scene:
    x = stimlib.Input("x", "m")
    return stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * OnePole(x, cutoff=50.0)})


def main() -> None:
    x = np.full((1, 400), 0.01)  # a step of 10 mm
    compiled = stimlib.compile(scene(), fs=8000)
    reference = stimlib.compile(scene(), fs=8000, target="python")
    y = compiled.process(x)
    same = np.array_equal(y, reference.process(x))
    print(f"force after 50 ms: {y[0, -1]:.4f} N")
    print(f"compiled and reference samples are {'equal, bit for bit' if same else 'DIFFERENT'}")
    gain = abs(compiled.response("force", "x", np.array([0.0, 50.0])))
    print(f"gain at 50 Hz: {20 * math.log10(gain[1] / gain[0]):.2f} dB")
    # [end]

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", metavar="FILE", help="also draw the step response")
    if (path := parser.parse_args().plot) is not None:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6, 3), layout="constrained")
        axes = figure.subplots()
        axes.plot(np.arange(400) / 8, y[0])
        axes.set(xlabel="time / ms", ylabel="force / N")
        figure.savefig(path)
    if not same:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
