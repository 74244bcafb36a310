"""
Sources
=======

A sweep, waves and the course of a trial. Look at how the sweep gets denser, and listen
to it. See :doc:`/reference/blocks/sources`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import band_noise, chirp, oscillator, timeline

level = timeline([(0.0, 0.0), (0.2, 1.0), (0.6, 1.0), (0.6, 0.5), (1.0, 0.0)], kind="cosine")
waves = {w: oscillator(5.0, w) for w in ("triangle", "square", "sawtooth")}
outputs = {
    "sweep": level * chirp(20, 400, seconds=1.0, kind="exponential"),
    "noise": band_noise(100, 300, 0.01, seed=1),
}
result = stimlib.render(stimlib.Scene({**outputs, **waves}), {}, fs=8000, seconds=1.0)
listen(result, "sweep", "sweep.wav")
figure = result.plot()
