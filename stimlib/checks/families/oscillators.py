"""Laws of the blocks of the family ``oscillators``, and of the scene ``bumps``."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any, cast

import numpy as np

from ...core.graph import Const
from ...errors import counted
from .. import laws
from ..evidence import Asked, Check, law_of
from ..rows import Row, Rows, law, turning


@law("PulseTrain", since=0)
def _pulse_train(b, fs, x, y):
    phase, step = phases(x, fs)
    n, after = np.arange(y.size), phase + step
    wraps = after < phase
    jitter = np.clip((0.5 + np.nan_to_num(x[1])) * 2.0**64, 0.0, 2.0**64 - 2.0**11).astype(
        np.uint64
    )
    # where this period began; the first one at sample 0
    last = np.maximum.accumulate(np.where(wraps, n, -1))
    first = jitter.take(-x.at, mode="clip")
    known = x.at <= 0 or isinstance(b.jitter, Const)
    now = np.where(last < 0, first, jitter[last])
    mark = np.r_[first, now[:-1]]
    want = ((phase <= mark) & (wraps | (mark < after))) + 1.0 * (wraps & (now < after))
    return want, np.where(np.r_[known, (last[:-1] >= 0) | known], 0.0, np.inf)


def phases(x: Rows, fs: float) -> tuple[Row, Row]:
    """Return the phase at each sample, and its increment at that sample.

    The phase counts from sample 0 on.
    """
    step = np.where(np.arange(x.at, x.at + x[0].size) < 0, np.uint64(0), turning(x[0], fs))
    return np.cumsum(step) - step + np.uint64(x.past % 2**64), step


def turns_of(x: Rows, fs: float, phase: float) -> tuple[Row, Row]:
    """Return the phase in turns at each sample, and the turns per sample.

    The phase starts at a value given in rad.
    """
    t = phases(x, fs)[0].astype(np.longdouble) / 2.0**64 + phase / (2 * np.longdouble(math.pi))
    return t - np.floor(t), turning(x[0], fs).astype(np.longdouble) / 2.0**64


@law("Carrier", since=0)
def _carrier(b, fs, x, y):
    t, step = turns_of(x, fs, b.phase)
    want = laws.carried(t, step, b.rectify)
    return np.where(x[1] > 0, want, 0), 1e-11


WAVES: dict[str, tuple[Callable, Callable]] = {  # of turns 0 .. 1: the wave, its integral
    "triangle": (
        lambda u, d: 1 - 4 * np.abs((u + 0.25) % 1 - 0.5),
        lambda u, d: np.where((v := (u + 0.25) % 1) < 0.5, 2 * v * v - v, 3 * v - 2 * v * v - 1),
    ),
    "sawtooth": (lambda u, d: 2 * (u % 1) - 1, lambda u, d: (u % 1) ** 2 - u % 1),
    "square": (
        lambda u, d: np.where(u % 1 < d, 1, -1),
        lambda u, d: 2 * (np.floor(u) * d + np.minimum(u % 1, d)) - u,
    ),
    "pulse": (lambda u, d: u % 1 < d, lambda u, d: np.floor(u) * d + np.minimum(u % 1, d)),
}


@law("Oscillator", since=0)
def _oscillator(b, fs, x, y):
    t, step = turns_of(x, fs, b.phase)
    wave, integral = WAVES[b.waveform]
    d = np.clip(x[1], 0, 1).astype(np.longdouble)
    still = step == 0
    mean = (integral(t + step / 2, d) - integral(t - step / 2, d)) / np.where(still, 1, step)
    return np.where(still, wave(t, d), mean).astype(float), (
        1e-11 + 1e-18 / np.where(still, 1, step)
    ).astype(float)


def _within(a: Asked, want: np.ndarray, highest: np.ndarray) -> np.ndarray:
    """Return the voltage scaled to its limit, or clipped there."""
    limit = a.given["limit"]
    if a.given["headroom"] == "scale":
        want = want * (limit / np.maximum(limit, highest))
    held = a.kept["held"] = a.kept.get("held", 0) + int(np.sum(np.abs(want[a.e.led :]) >= limit))
    a.say(f"limited to {limit:g} V, {counted(held, 'sample')} held there", "limit")
    return np.clip(want, -limit, limit)


@law_of("bumps")
def _bumps(a: Asked) -> list[Check]:
    """Check the voltage of bumps, V = gain A e(x/wavelength) c(t), computed anew.

    At constant speed the spectral model is checked as well.

    With equalisation the voltage is multiplied by d_max/d between the last two
    positions; with a limit it is scaled, or clipped, or both.
    """
    from ...analysis import am

    g, n, name = a.given, a.n, a.title("voltage")
    if not isinstance(g["waveform"], str):
        a.e.skipped.append(f"{name}: the law knows the named waveforms, not tables")
        return []
    if g["sampling"] != "area":
        a.e.skipped.append(f"{name}: the law covers bumps that are sampled by their area")
        return []
    A, duty, freq, gain = (
        a.live("A"),
        a.held("duty", 1e-6, 1.0),
        a.held("freq", 0.0, a.fs / 2),
        g["gain"],
    )
    # so rounded as in the scene: at an edge that counts
    contact, u = a.contact * (A != 0), a.x["x"] * (g["bumps"] / g["length"])
    last, touching = laws.ways(u, contact)
    shape, lost = laws.bump_envelope(last, u, g["waveform"], duty) * touching
    turns, step = laws.turning(freq, a.fs)
    turns += a.kept.get("turns", g["phase"] / (2 * np.longdouble(np.pi)))
    a.kept["turns"] = turns[-1]  # at a sample that the next stretch has, too
    wave = laws.carried(turns, step, g["rectify"])
    if a.part.span is None:
        a.e.curves |= {"envelope": shape, "carrier": wave}
        edges = np.flatnonzero(np.diff(np.floor(u))) + 1
        whole_bumps = ((i, j) for i, j in pairwise(edges) if np.ptp(u[i:j]) > 0.9)
        a.e.closeup = slice(*next(whole_bumps, (0, n)))
    want, highest = gain * A * shape * wave, gain * np.abs(A)
    a.say(
        f"amplifier {gain:g}, wavelength {1000 * g['length'] / g['bumps']:.4g} mm, {g['waveform']}"
    )
    if g["displacement"] is not None:
        knots, d = np.array(g["displacement"])
        kind = "polynomial" if knots.size <= 6 else "cubic"
        factor, most = laws.profile_gain(a.x["x"], contact, knots, d, kind)
        want, highest = want * factor, highest * most
        a.say(f"equalised by {len(knots)} measured places ({kind}), at most {most:.4g} times")
    if g["limit"] is not None:
        want = _within(a, want, highest)
    top = float(highest.max()) or 1.0
    a.expect("voltage", want, (1e-6 + a.slack) * top)
    error = a.far((a.y["voltage"] - want) / (1 + lost * highest / top / 1e-6)) / top
    text = "of the peak voltage, written again"
    checks = [
        Check("d", f"{name}: envelope times carrier", error, 1e-6, text),
        a.silent("voltage", contact <= 0),
    ]
    speed, still = (
        np.diff(u) * a.fs,
        np.ptp(A) == np.ptp(duty) == np.ptp(freq) == 0 and (a.window == 1).all(),
    )
    steady = (
        still
        and g["rectify"] == "half"
        and g["limit"] is None
        and g["displacement"] is None
        and contact.all()
    )
    if (
        steady
        and n > 2
        and speed[0]
        and np.ptp(speed) < 1e-6 * abs(speed[0])
        and abs(u[-1] - u[0]) >= 1
    ):
        whole = int(abs(u[-1] - u[0]))
        y = a.y["voltage"][1 : 1 + round(whole / abs(speed[0]) * a.fs)] / top
        wave = cast(Any, g["waveform"])
        model = am.sampled_rms(wave, duty[0], 1.0, abs(speed[0]), freq[0], a.fs)
        limit = 0.005 + am.meeting(
            wave, duty[0], abs(speed[0]), freq[0], a.fs, whole / abs(speed[0])
        )
        if limit > 0.2:
            a.e.skipped.append(
                f"{name}: rms of the line spectrum: bumps and carrier meet, so it depends on their"
                " phases"
            )
        else:
            text = (
                f"{counted(whole, 'bump')} at {abs(speed[0]):.3g}/s; lines that meet may add the"
                " rest"
            )
            rms = float(np.sqrt(np.mean(y**2)))
            checks.append(
                Check("d", f"{name}: rms of the line spectrum", abs(rms / model - 1), limit, text)
            )
    return checks


@law_of("bump_grid")
def _bump_grid(a: Asked) -> list[Check]:
    """Check the scene ``bump_grid``: two envelopes times a carrier, computed anew."""
    g, name, A = a.given, a.title("voltage"), a.live("A")
    if not isinstance(g["waveform"], str):
        a.e.skipped.append(f"{name}: the law knows the named waveforms, not tables")
        return []
    want = (
        g["gain"]
        * A
        * laws.carried(*laws.turning(a.held("freq", 0.0, a.fs / 2), a.fs), g["rectify"])
    )
    lost, on = np.zeros(a.n), (A != 0).astype(float)
    top = g["gain"] * float(np.abs(A).max(initial=0.0)) or 1.0
    for place, n, size, duty in (
        ("x", "along", "length", "duty"),
        ("y", "across", "width", "duty_y"),
    ):
        if g[n]:
            u = a.x[place] * (g[n] / g[size])  # so rounded as in the scene
            last, touching = laws.ways(u, on)
            shape, less = (
                laws.bump_envelope(last, u, g["waveform"], a.held(duty, 1e-6, 1.0)) * touching
            )
            want, lost = want * shape, lost + less
            a.say(f"bumps of {1e3 * g[size] / g[n]:.4g} mm along {place}, {g['waveform']}")
    a.say(f"amplifier {g['gain']:g}")
    a.expect("voltage", want, (1e-6 + a.slack) * top)
    error = a.far((a.y["voltage"] - want) / (1 + lost / 1e-6)) / top
    text = "of the peak voltage, written again"
    return [Check("d", f"{name}: two envelopes times carrier", error, 1e-6, text)]


def bursts(a: Asked) -> np.ndarray:
    """Return the envelope of ``tone`` and ``pulse``, from the time in each period."""
    g, n = a.given, a.kept.get("first", 0) + np.arange(a.n)
    a.kept["first"] = int(n[-1])  # a sample that the next stretch has, too
    long, endless = round(g["duration"] * a.fs), g["repeats"] is None
    k = np.arange(n[-1] // max(g["period"] * a.fs, 1) + 2 if endless else g["repeats"])
    starts = np.floor((k * (g["period"] * a.fs) if endless else k * g["period"] * a.fs) + 0.5)
    t = n - starts[np.searchsorted(starts, n, "right") - 1] + 0.5
    rise = np.clip(np.minimum(t, long - t) / min(max(0.5, g["ramp"] * a.fs), long / 2), 0, 1)
    a.say(f"{g['duration']:g} s with ramps of {g['ramp']:g} s, {g['repeats'] or 'endless'} times")
    return np.where(t < long, np.sin(np.pi / 2 * rise) ** 2, 0)


def on_channels(a: Asked, want: np.ndarray, tol: float, text: str) -> list[Check]:
    """Check that each of the requested channels equals this row."""
    apart, wanted = abs(len(a.y) - a.given["channels"]), a.given["channels"]
    count = Check("d", "channels: as many as were asked for", apart, 0, f"beside {wanted}")
    return [count, *(a.near(name, want, tol, text) for name in a.y)]


@law_of("tone")
def _tone(a: Asked) -> list[Check]:
    """Check the scene ``tone``, y = amplitude e(t) sin(2 pi freq t).

    Its time and its cosines are computed independently of the blocks.
    """
    turns, _ = laws.turning(a.held("freq", 0.0, a.fs / 2), a.fs)
    turns += a.kept.get("turns", 0)
    a.kept["turns"] = turns[-1]
    want = a.live("amplitude") * bursts(a) * laws.carried(turns, turns, None)
    return on_channels(a, want, 1e-9, "a sinusoid in bursts")


@law_of("pulse")
def _pulse(a: Asked) -> list[Check]:
    """Check the scene ``pulse``, y = amplitude e(t).

    Its time and its cosines are computed independently of the blocks.
    """
    want = a.live("amplitude") * bursts(a)
    return on_channels(a, want, 1e-12, "pulses")
