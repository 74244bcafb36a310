"""
What events make
================

A ring, a grain and a burst of noise every 0.25 s. Look at their different decays, and
listen for three kinds of taps. See :doc:`/reference/blocks/sources`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import bandpass, burst, every, grain, ring, white_noise

beat = every(0.25)
noise = bandpass(white_noise(seed=1), 100, 300, order=4)
outputs = {"ring": ring(beat, 150, decay=0.02), "grain": grain(beat, [1.0, -0.5, 0.2], rate=400.0)}
scene = stimlib.Scene({**outputs, "burst": noise * burst(beat, duration=0.1, ramp=0.02)})
result = stimlib.render(scene, {}, fs=8000, seconds=1.0)
listen(result, "ring", "rings.wav")
figure = result.plot()
