"""Two stimuli without a block of one's own: a click at every 5 mm, and a burst of noise
with raised-cosine ramps.

python examples/clicks_and_bursts.py [--plot FILE]
"""

import argparse

import numpy as np

import stimlib
from stimlib.blocks import bandpass, burst, constant, crossing, every, ring, white_noise
from stimlib.motion import constant_speed


def clicks() -> stimlib.Scene:
    x = stimlib.Input("x", "m")
    passed = crossing(x, spacing=0.005, hysteresis=1e-4)
    return stimlib.Scene({"force": constant(0.5, "N") * ring(passed, freq=150, decay=0.01)})


def bursts() -> stimlib.Scene:
    noise = bandpass(white_noise(seed=1), 100, 300, order=4)
    envelope = burst(every(0.5), duration=0.2, ramp=0.02)
    return stimlib.Scene({"voltage": constant(2.0, "V") * noise * envelope})


# [end]
def main() -> None:
    click = stimlib.render(clicks(), {"x": constant_speed(0.1, 0.052)}, fs=8000, seconds=1.0)
    noise = stimlib.render(bursts(), {}, fs=8000, seconds=1.0)
    loud = np.abs(click.y[0]) > 0.3
    starts = np.flatnonzero(loud[1:] & ~loud[:-1])
    print(
        f"clicks: {1 + np.sum(np.diff(starts) > 200)} of them, largest"
        f" {np.abs(click.y).max():.3f} N"
    )
    level = [
        np.sqrt(np.mean(noise.y[0, int(8000 * t) : int(8000 * (t + 0.16))] ** 2))
        for t in (0.02, 0.25, 0.52)
    ]
    print("bursts: " + ", ".join(f"{v:.2f}" for v in level) + " V rms in, between and in them")

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", metavar="FILE", help="also draw the clicks")
    if (path := parser.parse_args().plot) is not None:
        from stimlib.analysis import picture

        picture(click, path)


if __name__ == "__main__":
    main()
