"""Which vibrations are felt: shipped scenes on the devices that they state, and what
storing them in 16 bits costs.

python examples/is_it_felt.py [--area 2.9e-4] [--plot FILE]
"""

import argparse

import numpy as np

import stimlib
from stimlib.analysis import sensation_level
from stimlib.motion import constant_speed, minimum_jerk, sinusoid
from stimlib.scenes import bumps, squeeze, texture

FS = 8000  # Hz
STROKE = {"x": sinusoid(0.05, 1.0), "force": sinusoid(0.2, 1.0, 1.0)}
STIMULI = {
    "squeeze, A = 3.4": (squeeze(fingers=1), {"x1": minimum_jerk()}),
    "squeeze, A = 0.34": (squeeze(fingers=1, A=0.34), {"x1": minimum_jerk()}),
    "bumps, A = 4 V": (bumps(), {"x": constant_speed(0.1, 0.1)}),
    "texture": (texture(), STROKE),
}


def sixteen_bits(y: np.ndarray, full_scale: float) -> np.ndarray:
    """What rounding to 16 bits changes."""
    step = full_scale / 2**15
    return np.round(y / step) * step - y


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--area", type=float, help="of the contact, in m^2")
    parser.add_argument("--plot", help="file for a picture of the first squeeze")
    args = parser.parse_args()
    contact = {} if args.area is None else {"area": args.area}
    for name, (scene, motion) in STIMULI.items():
        y = stimlib.render(scene, motion, FS, 1.0)
        print(f"{name}: {y.felt(**contact)}")
    scene, motion = STIMULI["squeeze, A = 3.4"]
    y = stimlib.render(scene, motion, FS, 1.0)
    lost = sensation_level(sixteen_bits(y["force1"], 50.0), FS, "N", mass=0.1, **contact)
    print(f"16 bits of 50 N: {lost.pacinian:.0f} dB SL")
    if args.plot:
        y.plot().savefig(args.plot)


if __name__ == "__main__":
    main()
