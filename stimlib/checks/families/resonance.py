"""The law of the touch screen: every stage from the finger to the displacement."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
from numpy.polynomial import legendre

from .. import laws
from ..evidence import Asked, Check, law_of
from ..linear import COMPLEX, LONG, PI, Modes, _two, digital, response, straight
from ..rows import FADED, ULP, Rows, law, near

TOL = 1e-6


def swapped(v: np.ndarray, fs: float, freq: float, q: float, gain: float) -> np.ndarray:
    """Return the response of a pole swap.

    Its zeros are the discrete poles of a mode, its poles those of a mode ``gain`` times
    as wide, and it is 1 at the mode's frequency.
    """

    def at(q):
        return np.poly(
            np.exp(
                2
                * np.pi
                * freq
                / fs
                * (-0.5 / q + 1j * np.array([1, -1]) * np.sqrt(1 - 0.25 / q**2))
            )
        ).real

    b, a = at(q), at(q / gain)
    return scipy.signal.lfilter(
        b / abs(scipy.signal.freqz(b, a, [2 * np.pi * freq / fs])[1][0]), a, v
    )


def oscillated(v: np.ndarray, fs: float, freq: float, q: float) -> np.ndarray:
    """Return the motion of a mass on a spring, for inputs linear between samples.

    It is computed by scipy's triangle-hold equivalent.
    """
    w = 2 * np.pi * freq
    b, a, _ = scipy.signal.cont2discrete(([w * w], [1, w / q, w * w]), 1 / fs, "foh")
    return scipy.signal.lfilter(b[0], a, v)


@law_of("touch_screen")
def touch_screen(a: Asked) -> list[Check]:
    """Check voltage and displacement of the touch screen.

    Voltage: envelope, carrier, profile, pole swap and amplifier; displacement: the sum
    over modes.
    """
    from ...plate.model import Plate
    from ...plate.patch import Patch
    from ...plate.profile import mode_fit
    from ...plate.vibrate import LOOKED_AT, driven, series_of

    g, x, fs, A = a.given, a.x["x"], a.fs, a.live("A")
    if not isinstance(g["waveform"], str):
        a.e.skipped.append(f"{a.title('voltage')}: the law knows the named waveforms, not tables")
        return []
    model = {**g["model"], "patches": [Patch(**p) for p in g["model"]["patches"]]}
    glass = Plate(**model)
    resonance, origin, line, q = (
        glass.carrier(),
        (glass.length - g["length"]) / 2,
        glass.width / 2,
        1 / glass.damping,
    )
    places = g["length"] * np.linspace(0.0, 1.0, 5)  # where the thesis measures displacement
    knots, moved = mode_fit(glass, origin, line, clamp="known")(
        places, np.abs(glass.shape(0, origin + places, line))
    )
    # so rounded as in the scene
    u, on, duty = x * (g["bumps"] / g["length"]), (A != 0).astype(float), a.held("duty", 1e-6, 1.0)
    last, touching = laws.ways(u, on)
    shape, lost = laws.bump_envelope(last, u, g["waveform"], duty) * touching
    v = A * shape * laws.carried(*laws.turning(a.held("freq", 0.0, fs / 2), fs), g["rectify"])
    factor = laws.profile_gain(x, np.ones(x.size), knots, moved, "cubic")[0]
    asked = g["gain"] * np.abs(A) * factor  # at the top of a bump
    v, lost = v * factor, lost * asked
    low, high = glass.voltages
    v = g["gain"] * swapped(v, fs, resonance, q, g["swap"])
    a.say(f"resonance {resonance:.6g} Hz, q = {q:g}, answers {g['swap']:g} times as fast")
    a.say(
        f"amplifier {g['gain']:g}, {low:g} .. {high:g} V, {int(np.sum((v < low) | (v > high)))}"
        " samples held there"
    )
    v = np.clip(v, low, high)
    if lost.any():  # at most this is left of it behind the pole swap
        lost = scipy.signal.fftconvolve(
            lost, np.abs(swapped(np.eye(1, x.size)[0], fs, resonance, q, g["swap"]))
        )[: x.size]
    top = max(float(asked.max(initial=0.0)), float(np.abs(v).max(initial=0.0)), 1e-300)
    a.expect("voltage", v, (TOL + a.slack) * top)
    error = a.far((a.y["voltage"] - v) / (1 + lost / (TOL * top))) / top
    text = "of the largest voltage that is asked for"
    checks = [
        a.begins({"freq": resonance}),
        Check("d", f"{a.title('voltage')}: every stage, written again", error, TOL, text),
    ]
    if g["finger"]:
        a.e.skipped.append(f"{a.title('displacement')}: a plate that the finger loads has no law")
        return checks
    chosen, force = driven(glass, g["modes"], None)
    w2 = glass.solved(LOOKED_AT)[0]
    s, at = (
        np.clip(2 * (x + origin) / glass.length - 1, -1, 1),
        np.full(x.size, 2 * line / glass.width - 1),
    )
    driving = np.where(np.isnan(a.y["voltage"]), v, a.y["voltage"])
    d, still = np.zeros(x.size), 0.0  # what the largest voltage moves at rest, somewhere
    for k in chosen:
        series, largest = series_of(glass, k)
        scale = force[k] * largest / w2[k]
        d += (
            scale
            * oscillated(driving, fs, np.sqrt(w2[k]) / (2 * np.pi), q)
            * legendre.legval2d(s, at, series)
        )
        still += abs(scale) * top
    a.say(f"plate: largest displacement {1e6 * np.abs(d).max():.4g} um, modes: {len(chosen)}")
    return [
        *checks,
        a.near(
            "displacement", d, TOL, "sum over the plate's modes, written again", max(still, 1e-300)
        ),
    ]


@law("Shape", since=0)
def _shape(b, fs, x, y):
    places = np.clip(2 * x[0] / b.length - 1, -1, 1), np.clip(2 * x[1] / b.width - 1, -1, 1)
    knots, parts = np.linspace(-1, 1, 257), []
    for at, terms in zip(places, b.c.shape, strict=True):
        slopes = legendre.legval(knots, legendre.legder(np.eye(terms)))
        parts.append(
            scipy.interpolate.CubicHermiteSpline(
                knots, legendre.legvander(knots, terms - 1), slopes.T
            )(at)
        )
    whole, size = legendre.legval2d(*places, b.c), float(np.abs(b.c).sum())
    want = np.einsum("ki,ij,kj->k", parts[0], b.c, parts[1])
    steep = max(b.c.shape) ** 2  # of the last term, by which a rounding of the place counts
    return np.where(np.abs(want - whole) < 1e-6 * size, want, whole), (1e-13 + ULP * steep) * size


def _svf_rings(b: Any, fs: float, x: Rows) -> float:
    slowest = float(np.minimum(x[1], fs / 2 - x[1]).min())
    wide = max(0.5, float(x[2].max()), 1 / max(float(x[2].min()), 1e-3))
    return FADED * fs * wide / (math.pi * slowest) if slowest > 0 else math.inf


@law("Svf", since=_svf_rings)
def _svf(b, fs, x, y):
    high, band, low = {
        "lowpass": (0, 0, 1),
        "bandpass": (0, 1, 0),
        "highpass": (1, 0, 0),
        "notch": (1, 0, 1),
    }[b.mode]
    g = np.tan(np.pi * np.clip(x[1] / fs, 0, 0.5)).tolist()
    k = (1 / np.maximum(x[2], 1e-3)).tolist()
    want, s1, s2 = np.zeros(y.size), 0.0, 0.0
    for n, v in enumerate(x[0].tolist()):
        bp = (g[n] * (v - s2) + s1) / (1 + g[n] * (g[n] + k[n]))
        lp = s2 + g[n] * bp
        hp = v - k[n] * bp - lp
        s1, s2 = 2 * bp - s1, 2 * lp - s2
        want[n] = high * hp + band * k[n] * bp + low * lp
    # at fs/2 and above what passes is a rounding
    least = 4e-15 * (1 + max(k)) * float(np.abs(x[0]).max())
    return want, max(near(want, 1e-9)[1], least)


@response("Mode")
def _mode(b, fs):
    a, c = 2 * PI * b.freq / LONG(fs), 0.5 / LONG(b.q)
    h = np.sqrt(1 - c * c)
    L = a * np.array([-c + 1j * h, -c - 1j * h])
    return Modes(*straight(L, a / (2j * h) * np.array([1, -1])))


@response("Resonator")
def _resonator(b, fs):
    w = 2 * PI * b.freq / LONG(fs)
    t = np.tan(w / 2)
    c = (1 + t * t) * np.tan(w / b.q / 2)
    zeros = np.array([1j * t, -1j * t]) if b.notched else np.zeros(1, COMPLEX)
    return digital(zeros, _two(np.array([-c], COMPLEX), t * t), LONG(1) if b.notched else c)


@response("PoleSwap")
def _pole_swap(b, fs):
    r = b.freq / LONG(fs)
    narrow, wide = LONG(b.q), b.q / LONG(b.gain)
    turns = [
        2 * PI * r * (-0.5 / q + np.array([1j, -1j]) * np.sqrt(COMPLEX(1 - 0.25 / q**2)))
        for q in (narrow, wide)
    ]
    zeros, poles = (np.tanh(turn / 2) for turn in turns)
    s = 1j * np.tan(PI * r)
    size = np.abs(np.prod(s - poles) / np.prod(s - zeros))
    return digital(zeros, poles, size)
