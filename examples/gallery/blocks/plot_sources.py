"""
Sources
=======

The course of a trial. See :doc:`/reference/blocks/sources`.
"""

import stimlib
from stimlib.blocks import time, timeline

level = timeline([(0.0, 0.0), (0.2, 1.0), (0.6, 1.0), (0.6, 0.5), (1.0, 0.0)], kind="cosine")
scene = stimlib.Scene({"level": level, "time": time()})
result = stimlib.render(scene, {}, fs=8000, seconds=1.2)
figure = result.plot()
