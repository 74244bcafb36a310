"""
A button that clicks
====================

A button is pressed and released twice. Look at the force over the travel: it falls at
the snap, and a vibration rings there. Listen for the clicks. See
:doc:`/reference/scenes/click`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.motion import minimum_jerk
from stimlib.scenes import click

hand = minimum_jerk(depth=2.1e-3, rise=0.15, hold=0.1, fall=0.15, rest=0.2)
result = stimlib.render(click(), {"x": hand}, fs=8000, seconds=1.2)
listen(result, "force", "click.wav")
figure = result.plot()
