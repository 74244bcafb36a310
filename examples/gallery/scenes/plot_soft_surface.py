"""
A soft surface with a nodule
============================

A pen goes over a hard nodule. Look at the avatar: it waits there, and goes less deep.
See :doc:`/reference/scenes/soft_surface`.
"""

import stimlib
from stimlib.motion import minimum_jerk
from stimlib.scenes import soft_surface
from stimlib.soft import nodules

stroke = minimum_jerk(depth=0.1, rise=1.0, hold=0.2, fall=1.0)
scene = soft_surface("combined", S=nodules([(0.05, 0.06, 0.006)]))
hand = {"x": stroke, "y": lambda t: 0.06 + 0.005 * t, "press": lambda t: 0.5 + 0.1 * t}
result = stimlib.render(scene, hand, fs=1000, seconds=2.4)
figure = result.plot()
