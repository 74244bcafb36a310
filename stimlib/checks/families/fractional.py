"""Laws of the blocks of the family ``fractional``, and of ``viscoelastic``."""

from __future__ import annotations

import math

import numpy as np

from ...core.graph import Block, Input
from .. import laws
from ..evidence import Asked, Check, law_of
from ..linear import LONG, response, taps
from ..rows import law, near, touched


@law("PathLength", since=1)
def _path_length(b, fs, x, y):
    want = np.zeros(y.size)
    for k, s in enumerate(touched(x[1])):
        first = 0.0 if b.onset == "step" and k == 0 and x.rest else x[0][s.start]
        want[s] = np.cumsum(np.abs(np.diff(x[0][s], prepend=first))) + (
            0.0 if x.rest or s.start else y[0]
        )
    return near(want, 1e-15 * y.size)


@law("Accuracy", since=0)
def _accuracy(b, fs, x, y):
    # what they are worth, tests/blocks/test_fractional.py says
    from ...blocks.springpots import bounds_of_orders

    knots, bounds = bounds_of_orders(b.tol, b.horizon * fs)
    return near(np.interp(x[0], knots, (1.02 + 2 * b.tol) * bounds))


POINTS = 64  # at which a sum over the whole history is made


@law("Springpot", since=1)
def _springpot(b, fs, x, y):
    want, tol = np.zeros(y.size), np.zeros(y.size)
    for k, s in enumerate(touched(x[1])):
        step = b.onset == "step" and k == 0 and x.rest
        way = np.r_[0.0, x[0][s]] if step else x[0][s]
        force, size = laws.springpot_convolution(way, fs, b.scheme, b.order)
        want[s], tol[s] = force[int(step) :], (b.tol + 1e-12) * size.max() + 1e-300
        # of a contact that began before nothing is said
        tol[s] = np.inf if not x.rest and s.start == 0 else tol[s]
        tol[s.start + int(b.horizon * fs) : s.stop] = np.inf  # beyond it nothing is said
    return want, tol


@law("SpringpotLive", since=1)
def _springpot_live(b, fs, x, y):
    want, tol = np.where(x[2] > 0, y, 0), np.full(y.size, 1e-300)
    for k, s in enumerate(touched(x[2])):
        if not x.rest and s.start == 0:
            want[s] = y[s]
            continue
        step = int(b.onset == "step" and k == 0 and x.rest)
        way, order = np.r_[np.zeros(step), x[0][s]], np.r_[np.zeros(step), x[1][s]]
        at = np.unique(np.linspace(step, way.size - 1, POINTS).astype(int))
        at = at[(order[at] >= 0) & (order[at] <= 1)]
        force, size = laws.springpot_sum(way, fs, b.scheme, order, at)
        want[s.start + at - step], tol[s.start + at - step] = (
            force,
            (b.tol + 1e-12) * np.maximum(size, 1e-300),
        )
    return want, tol


@law("Downsampled", since=1)
def _downsampled(b, fs, x, y):
    want, tol = np.where(x[1] > 0, y, 0), np.full(y.size, 1e-300)
    for c, s in enumerate(touched(x[1])):
        if not x.rest and s.start == 0:
            want[s] = y[s]
            continue
        way = x[0][s] - (0.0 if b.onset == "step" and c == 0 and x.rest else x[0][s.start])
        for k in np.unique(np.linspace(0, way.size - 1, POINTS).astype(int)):
            m = max(1, math.ceil(k / 100))
            past = way[k::-m].astype(np.longdouble)
            j = np.arange(1, past.size, dtype=np.longdouble)
            weights = np.cumprod(np.r_[np.longdouble(1), (j - 1 - b.order) / j])
            scale = (np.longdouble(fs) / m) ** np.longdouble(b.order)
            if k < math.ceil(b.horizon * fs):
                want[s.start + k] = weights @ past * scale
                tol[s.start + k] = 1e-12 * np.abs(weights) @ np.abs(past) * scale + 1e-300
    return want, tol


@response("ShortMemory")
def _short_memory(b, fs):
    j = np.arange(1, max(1, round(b.seconds * fs)), dtype=LONG)
    return taps(LONG(fs) ** b.order * np.cumprod(np.r_[LONG(1), (j - 1 - b.order) / j]))


@law_of("viscoelastic")
def _viscoelastic(a: Asked) -> list[Check]:
    """Check the springpot's force against the full sum over the history.

    It compares a selection of samples, in extended precision.
    """
    from ...blocks import exp, springpot, track

    g, y, n, touching = a.given, a.x["y"], a.n, a.contact > 0
    order = a.live("alpha") if g["live"] else np.full(n, g["alpha"])
    gain = a.live("firmness") * g["chi_0"] / g["w"] ** order
    chi = g["chi_0"] / g["w"] ** g["alpha"]
    at_1_hz = chi * (2 * np.pi) ** g["alpha"]
    a.say(
        f"chi = {chi:.6g}, alpha = {g['alpha']:.6g}: as strong at 1 Hz as {at_1_hz:.4g} N/m, for"
        " firmness 1"
    )
    contact = Input("contact") if "contact" in a.x else None
    horizon = 60.0 if g["scheme"] == "gl-downsampled" else 86400.0
    way: Block = Input("y", "m")
    if g["smoothing"] is not None:
        way = track(way, g["smoothing"], contact=1.0 if contact is None else contact)
        y = a.render(way)
    alpha = Input("alpha") if g["live"] else g["alpha"]
    a.x["alpha"] = order
    strength = g["chi_0"] * exp(-math.log(g["w"]) * alpha) if g["live"] else chi
    block = springpot(way, strength, alpha, g["scheme"], g["tol"], horizon, contact=contact)
    same = a.near(
        "force", a.live("firmness") * a.render(block), 1e-14, "springpot of these numbers"
    )
    name, silent = a.title("force"), a.silent("force", ~touching)
    guided = [
        a.near(f"guide_{across}", g["guide"] * a.x[across], 1e-15, "guide times the distance")
        for across in ("x", "z")
        if g.get("guide") is not None  # not in scenes that were kept before 0.2
    ]
    if g["scheme"] not in ("gl", "l1"):
        a.e.skipped.append(f"{name}: only the full sum's own schemes, gl and l1, have a law")
        return [same, silent, *guided]
    starts = np.flatnonzero(touching & ~np.r_[False, touching[:-1]])
    stops = np.flatnonzero(touching & ~np.r_[touching[1:], False]) + 1
    over, tol = np.zeros(n), g["tol"]
    for i, j in zip(starts, stops, strict=True):
        at = np.unique(np.linspace(0, j - i - 1, max(2, round(64 * (j - i) / n))).astype(int))
        force, size = laws.springpot_sum(y[i:j], a.fs, g["scheme"], order[i:j], at)
        k = gain[i:j][at]
        bound = np.abs(k) * (
            (tol + 64 * 2.0**-53) * np.maximum(size, 1e-300) + (1e-15 + a.slack) * np.abs(force)
        )
        over[i:j][at] = (a.y["force"][i:j][at] - k * force) / np.maximum(bound, 1e-300)

    def everywhere() -> np.ndarray:
        want = np.zeros(n)
        for i, j in zip(starts, stops, strict=True):
            want[i:j] = laws.springpot_convolution(y[i:j], a.fs, g["scheme"], order[0])[0]
        return gain * want

    # the sum of the absolute values of its terms is at most that over all steps of the
    # position
    most = float(2 * a.fs ** g["alpha"] * np.abs(np.diff(y, prepend=0.0)).sum())
    if np.ptp(order) == 0:  # else every sample would need a sum of its own
        a.expect("force", everywhere, float(np.abs(gain).max(initial=0.0) * (tol + 1e-13) * most))
    text = f"tol = {tol:g}, alpha = {g['alpha']:g}, {g['scheme']}: error over its certificate"
    return [
        same,
        Check("d", f"{name}: full sum over the history", a.far(over), 1.0, text),
        silent,
        *guided,
    ]
