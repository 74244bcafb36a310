"""A first stimulus: thumb and index finger squeeze a virtual spring that crackles while
it is being compressed.

python examples/first_stimulus.py [--plot FILE]
"""

import argparse
from math import pi

import numpy as np

import stimlib
from stimlib.blocks import constant, differentiator, enabled, loading, pink_noise, spring, velocity
from stimlib.motion import minimum_jerk


def scene() -> stimlib.Scene:
    k = stimlib.Param("k", 2000.0, "N/m")  # live: proc.set("k", 1500.0)
    A = stimlib.Param("A", 3.4)
    tau = constant(1 / 8000, "s")
    outputs = {}
    for finger in (1, 2):
        x = stimlib.Input(f"x{finger}", "m")
        v = velocity(x, cutoff=100.0)
        noise = differentiator(
            pink_noise(1 / pi, seed=7, stream=finger, f_low=10.0), passband=1000.0
        )
        crackle = enabled(noise, by=loading(v))
        outputs[f"force{finger}"] = spring(x, k) + A * (k * tau * v) * (tau * crackle)
    return stimlib.Scene(outputs)


# [render]
def main() -> None:
    motion = minimum_jerk(depth=0.02, rise=0.3, hold=0.2, fall=0.3, rest=0.4)
    result = stimlib.render(scene(), {"x1": motion, "x2": motion}, fs=8000, seconds=2.0)
    vibration = result.y - 2000.0 * motion(result.t)
    print(result)
    for name, force, dF in zip(result.outputs, result.y, vibration, strict=True):
        print(
            f"{name}: largest {force.max():.2f} N, vibration {1000 * np.sqrt(np.mean(dF**2)):.2f}"
            " mN rms"
        )
    # [end]

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--plot", metavar="FILE", help="also draw the motion, the forces and their spectra"
    )
    if (path := parser.parse_args().plot) is not None:
        from stimlib.analysis import picture

        picture(result, path)


if __name__ == "__main__":
    main()
