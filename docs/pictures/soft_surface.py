"""A recorded pen over the block with three nodules: python
docs/pictures/soft_surface.py [FOLDER] writes pictures beside itself.

FOLDER is pen-pressure of the recordings, by default beside the repository.
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

import stimlib
from stimlib.motion import recording
from stimlib.scenes import soft_surface
from stimlib.soft import block, film, picture

DATA = Path(__file__).parents[2] / "shared" / "data" / "pen-pressure"
MAP = block(turn=1.66)  # so that the loops come near all three


def hand(folder):
    """The loops enlarged to the surface, 8 mm inside its edges; the pen's levels to
    0.95 of the range.
    """
    return recording(
        Path(folder) / "pen_loops.csv",
        {
            "x": "(x_raw - 4034)*3.404e-6 + 0.008",
            "y": "(y_raw - 2860)*8.184e-6 + 0.008",
            "press": "pressure_raw/23825",
        },
        reports="on_change",
        max_speed={"press": None},  # which is no movement
    )


def rendered(folder, mode="combined", fs=1000):
    """The scene, the hand, and the rendering."""
    pen, scene = hand(folder), soft_surface(mode, S=MAP, contact=True)
    motion = pen.motion_for(tuple(scene.inputs))
    return scene, motion, stimlib.render(scene, motion, fs=fs, seconds=pen.duration)


def way(result):
    """Map, way of the avatar, depth and force."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    extent = (0, 1000 * MAP.width, 0, 1000 * MAP.height)
    left.imshow(MAP.levels, origin="lower", extent=extent, cmap="cividis", vmin=0, vmax=1)
    on = result["force"] > 0
    left.plot(1000 * result["x1"][on], 1000 * result["y1"][on], ".", color="white", markersize=1)
    left.set(xlabel="x / mm", ylabel="y / mm", title="level S, and the avatar")
    right.plot(result.t, 1000 * result["depth1"], label="depth / mm")
    right.plot(result.t, result["force"], label="force / N")
    right.set(xlabel="time / s")
    right.legend()
    return figure


if __name__ == "__main__":
    result = rendered(sys.argv[1] if len(sys.argv) > 1 else DATA)[2]
    film(result, Path(__file__).with_suffix(".gif"), fps=12, stop=1.6)
    for name, figure in (("soft_surface", picture(result)), ("soft_surface_pen", way(result))):
        figure.savefig(Path(__file__).with_name(f"{name}.png"), dpi=80, metadata={"Software": None})
