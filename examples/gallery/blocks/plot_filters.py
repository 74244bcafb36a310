"""
Filters
=======

One noise stays between 100 and 300 Hz; the band of the other one moves. Look at the two
spectra, and listen for the sweep. See :doc:`/reference/blocks/filters`.
"""

import stimlib
from stimlib.analysis import listen
from stimlib.blocks import bandpass, svf, white_noise
from stimlib.motion import constant_speed

sweep = svf(white_noise(seed=2), stimlib.Input("f", "Hz"), q=20, mode="bandpass")
scene = stimlib.Scene({"band": bandpass(white_noise(seed=1), 100, 300, order=4), "sweep": sweep})
result = stimlib.render(scene, {"f": constant_speed(300.0, 900.0)}, fs=8000, seconds=2.5)
listen(result, "sweep", "sweep.wav")
figure = result.plot()
