"""A stimulus of one's own: ribbed cloth under a finger that strokes it.

python examples/ribbed_cloth.py [--plot FILE]
"""

import argparse
from math import pi

import numpy as np

import stimlib
from stimlib.blocks import clip, constant, sin, velocity, white_noise
from stimlib.motion import minimum_jerk


def scene() -> stimlib.Scene:
    x = stimlib.Input("x", "m")
    height = stimlib.Param("height", 0.2, "N")
    grain = stimlib.Param("grain", 0.02, "N")
    ribs = sin(2 * pi * x / constant(2e-3, "m"))  # fixed to the place: one rib every 2 mm
    speed = abs(velocity(x, cutoff=20.0)) / constant(0.1, "m/s")
    rustle = clip(speed, 0, 1) * white_noise(seed=1)  # fixed to time: only while the finger moves
    return stimlib.Scene({"force": height * ribs + grain * rustle})


# [render]
def main() -> None:
    stroke = minimum_jerk(depth=0.04, rise=0.5, hold=0.3, fall=0.5, rest=0.2)
    result = stimlib.render(scene(), {"x": stroke}, fs=8000, seconds=1.5)
    moving = abs(np.gradient(stroke(result.t), result.t)) > 0.01
    print(result)
    for what, part in (("stroking", moving), ("holding", ~moving)):
        force = result["force"][part]
        print(f"{what}: {force.std():.3f} N rms, between {force.min():.2f} and {force.max():.2f} N")
    # [end]

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--plot", metavar="FILE", help="also draw the motion, the force and its spectrum"
    )
    if (path := parser.parse_args().plot) is not None:
        result.plot().savefig(path)


if __name__ == "__main__":
    main()
