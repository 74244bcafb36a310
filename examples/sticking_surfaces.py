"""Surfaces without a block of one's own: one that sticks and slips, a texture on top,
and LuGre's friction as a loop.

python examples/sticking_surfaces.py [--plot FILE]
"""

import argparse

import numpy as np

import stimlib
from stimlib.blocks import constant, exp, friction, loop, stick_slip, texture, velocity
from stimlib.design.texture import made_up
from stimlib.motion import minimum_jerk


def squeaks() -> stimlib.Scene:
    x = stimlib.Input("x", "m")
    press = stimlib.Param("press", 1.0, "N")
    # or load_texture("mesh.xml")
    vibration = texture(velocity(x, cutoff=50), press, made_up(), seed=1)
    moving = constant(0.02, "kg") * vibration  # of the finger's tip
    return stimlib.Scene(
        {"force": stick_slip(x, press, static=0.8, kinetic=0.5, stiffness=1000.0) + moving}
    )


def lugre(fs: float) -> stimlib.Scene:
    x, k = stimlib.Input("x", "m"), constant(1000.0, "N/m")
    # the way of a sample, a little smoothed
    dx = constant(1 / fs, "s") * velocity(x, cutoff=0.49 * fs)
    slow = dx / constant(0.02 / fs, "m")  # Stribeck's speed of 20 mm/s
    g = constant(0.6, "N") + constant(0.3, "N") * exp(-(slow**2))
    z = loop(lambda z: (z + dx) / (1 + k * abs(dx) / g), unit="m")  # Euler's backward rule
    return stimlib.Scene(
        {"loop": k * z, "block": friction(x, 1.0, 0.6, k, "lugre", static=0.9, speed=0.02)}
    )


# [end]
def main() -> None:
    stroke = {"x": minimum_jerk(depth=0.04, rise=0.5, hold=0.3, fall=0.5)}
    squeak = stimlib.render(squeaks(), stroke, fs=8000, seconds=1.4)
    force = squeak["force"]
    falls = np.diff(force[:4000]) < -0.1
    slips = np.sum(falls[1:] & ~falls[:-1])
    print(
        f"stroking: {slips} slips in 40 mm, largest {np.abs(force).max():.2f} N; held:"
        f" {np.ptp(force[5600:6400]):.3f} N"
    )
    bristles = stimlib.render(lugre(8000), stroke, fs=8000, seconds=1.4)
    apart = np.abs(bristles["loop"] - bristles["block"]).max()
    most, fast = np.abs(bristles["block"]).max(), bristles["block"][2000]
    print(f"LuGre: {most:.3f} N at most, {fast:.3f} N while fast; the loop is within {apart:.3f} N")

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", metavar="FILE", help="also draw the forces")
    if (path := parser.parse_args().plot) is not None:
        from stimlib.analysis import picture

        picture(squeak, path)


if __name__ == "__main__":
    main()
