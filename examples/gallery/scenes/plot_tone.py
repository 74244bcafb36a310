"""
A vibration of one frequency
============================

Three bursts of 80 Hz. Look at the ramps of 50 ms: a burst without them begins and ends
with a click. Listen for the three bursts. See :doc:`/reference/scenes/tone`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.scenes import tone

scene = tone(freq=80.0, duration=0.2, ramp=0.05, period=0.4, repeats=3)
result = stimlib.render(scene, fs=8000, seconds=1.2)
listen(result, "signal", "tone.wav")
figure = result.plot()
