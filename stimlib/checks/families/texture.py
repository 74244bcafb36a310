"""Laws of the block and the scene ``texture``."""

from __future__ import annotations

import numpy as np

from ...analysis import spectra
from ...core.program import lead
from ...errors import counted
from .. import laws
from ..evidence import Asked, Check, law_of
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


# relative: at speed 0 and force 0 the variance is a rounding, of which the square root
# is taken
TOL = 1e-7


@law_of("texture")
def _texture_scene(a: Asked) -> list[Check]:
    """Check the acceleration of a measured texture by computing it anew.

    While speed and force are constant, its spectrum is checked as well.
    """
    from ...design.texture import TextureModel

    g, n, name = a.given, a.n, a.title("acceleration")
    model = TextureModel(**g["model"])
    every = round(a.fs / model.rate)
    speed = laws.squeeze_finger(
        a.x["x"], np.zeros(n), a.contact, a.fs, 0.0, 0.0, g["cutoff"], 1.0, 0.0
    ).v
    force = a.x["force"] * a.contact
    want = a.live("level") * laws.texture(
        model, speed, force, laws.white(a.seed, g["seed"], 0, 0, n), every
    )
    a.say(
        f"{counted(len(model.speed), 'model')} of order {model.lsf.shape[1]}, {model.ma.shape[1]},"
        f" at {model.rate:g} Hz"
    )
    # of which the roundings are
    most = float(np.abs(a.live("level")).max() * np.max(model.gain * np.sqrt(model.variance)))
    checks = [
        a.near("acceleration", want, TOL, "the models' recursion, written again", max(most, 1e-300))
    ]
    steady = slice(n // 4 // every * every, None, every)
    v, N = abs(speed[steady]), force[steady]
    flat = (a.window == 1).all() and not np.ptp(a.live("level"))
    if (
        np.ptp(v) > 1e-3 * v.mean()
        or np.ptp(N) > 1e-3 * N.mean()
        or not flat
        or not want[steady].any()
    ):
        a.e.skipped.append(f"{name}: speed and force move, so it has no one spectrum")
        return checks
    gain = a.live("level")[0]

    def psd(f):
        return gain**2 * model.psd(f, v.mean(), N.mean())

    s = spectra.test_spectrum(a.y["acceleration"][steady], model.rate, psd, 5.0, 0.49 * model.rate)
    if s is not None:
        text = f"{s.level_db:+.3f} dB over {N.size / model.rate:.3g} s"
        p, share = -np.log10(max(s.p, 1e-300)), -np.log10(a.e.share)
        checks.append(
            Check("c", f"{name}: spectrum, {counted(len(s.bands), 'band')}", p, share, text)
        )
    return checks
