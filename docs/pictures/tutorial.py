"""What the tutorial's programs draw: python docs/pictures/tutorial.py writes
tutorial_*.png beside itself.
"""

import runpy
from pathlib import Path

import stimlib
from stimlib.motion import minimum_jerk

HERE = Path(__file__).parent
hand = minimum_jerk(depth=0.02)
stroke = minimum_jerk(depth=0.04, rise=0.5, hold=0.3, fall=0.5, rest=0.2)
cloth = runpy.run_path(str(HERE.parents[1] / "examples" / "ribbed_cloth.py"))["scene"]
for name, scene, motion, seconds in (
    ("squeeze", stimlib.scenes.squeeze(), {"x1": hand, "x2": hand}, 2.0),
    ("cloth", cloth(), {"x": stroke}, 1.5),
):
    figure = stimlib.render(scene, motion, fs=8000, seconds=seconds).plot()
    figure.savefig(HERE / f"tutorial_{name}.png", dpi=80, metadata={"Software": None})
