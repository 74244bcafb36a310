"""From a relaxation test to a stimulus: fit a springpot and Maxwell arms, then render
the tissue that was measured.

python examples/fit_tissue.py [--data FILE.csv] [--plot FILE]

FILE.csv has a line of names, then time (s), displacement (m) and force (N): a ramp, and
a hold.  Without it the program makes up a recording: 2 mm in 0.1 s, held for a minute,
forces wrong by 1 %.
"""

import argparse

import numpy as np

import stimlib
from stimlib.fitting import fit_generalized_maxwell, fit_springpot, springpot_force
from stimlib.motion import ramp_and_hold


# [record]
def made_up() -> np.ndarray:
    t = np.r_[0.0, np.geomspace(5e-3, 60.0, 80)]
    y = np.minimum(0.02 * t, 2e-3)
    noise = np.random.default_rng(0).standard_normal(t.size)
    return np.array([t, y, springpot_force(t, y, 300.0, 0.15) * (1 + 0.01 * noise)])


# [fit]
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--data", metavar="FILE.csv", help="your own recording: time, displacement, force in SI"
    )
    parser.add_argument(
        "--plot", metavar="FILE", help="also draw forces and errors of the springpot"
    )
    given = parser.parse_args()

    t, y, f = np.loadtxt(given.data, delimiter=",", skiprows=1).T[:3] if given.data else made_up()
    y = y - y[0]
    hold = t > t[np.argmax(y >= 0.999 * y.max())]
    spot = fit_springpot(t, y, f, where=hold)
    arms = fit_generalized_maxwell(t, y, f, arms=2, where=hold)
    print(spot)
    print(arms)

    # [render]
    place = stimlib.Input("y", "m")
    scene = stimlib.Scene({"springpot": spot.block(place), "arms": arms.block(place)})
    motion = ramp_and_hold(depth=float(y.max()), rise=0.1)
    result = stimlib.render(scene, {"y": motion}, fs=1000, seconds=2.0)
    for name in result.outputs:
        print(f"{name}: {result[name].max():.3f} N, after two seconds {result[name][-1]:.3f} N")
    # [end]
    if given.plot is not None:
        spot.plot(given.plot)


if __name__ == "__main__":
    main()
