"""Laws of the blocks of the family ``texture``."""

from __future__ import annotations

import numpy as np

from ...core.program import lead
from .. import laws
from ..rows import law


@law("Texture", since=lambda b, fs, x: round(fs / b.rate) * (b.lsf.shape[1] + b.ma.shape[1] + 14))
def _texture(b, fs, x, y):
    every, want = round(fs / b.rate), y.copy()
    # the model's own samples, from where it began
    first = 0 if x.rest else -(x.at + lead(fs) * b.autonomous) % every
    noise, speed, force = (row[first:] for row in x)
    want[first:] = laws.texture(b.model, speed, force, noise, every, None if x.rest else y[first:])
    # of which the roundings are, also where it rests
    most = float(np.max(b.model.gain * np.sqrt(b.model.variance)))
    return want, 1e-7 * max(float(np.abs(want).max(initial=0.0)), most)
