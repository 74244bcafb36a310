"""Analysis of samples as a pattern, and what the way back loses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..blocks.sources import Grain, Ring
from ..core.graph import Const, reach
from ..core.scene import Scene
from ..errors import SceneError
from ..run.rendering import Rendering, render
from .pattern_table import TAP_SECONDS, Pattern, PatternDevice, Point, Voice

Array = NDArray[np.float64]
Band = tuple[float, float, float]  # middle in Hz; two levels in dB

LOWEST = 20.0  # Hz; what is slower is no vibration
GRID = 0.002  # s between the points of which a few are kept
SMOOTH = 0.01  # s over which the frequency is averaged
QUIET = 0.1  # of the peak, where no frequency is measured
BANDS = 1000.0 * 2.0 ** np.arange(-5, 3)  # Hz, middles of octaves (IEC 61260-1)


def events_of(rendering: Rendering, name: str) -> list[Point]:
    """Return the samples at which a scene's rings and grains are struck, with the Hz.

    The frequency of a grain is 0: not known.
    """
    found: list[Point] = []
    for block in reach([rendering.scene.outputs[name]]):
        if isinstance(block, Ring | Grain):
            hertz = block.freq if isinstance(block, Ring) else Const(0.0, "Hz")
            try:
                part = Scene({"event": block.event, "hertz": hertz})
            except SceneError:  # it is in the body of a loop
                continue
            motion = {n: rendering.motion[n] for n in part.inputs}
            values = {n: v for n, v in rendering.params.items() if n in part.params}
            seconds = rendering.y.shape[1] / rendering.fs
            made = render(part, motion, rendering.fs, seconds, values, rendering.seed)
            at = np.flatnonzero(made["event"])
            found += zip(at.tolist(), made["hertz"][at].tolist(), strict=True)
    return sorted(found)


def analysed(y: Array, fs: float, events: list[Point], device: PatternDevice) -> Pattern:
    """Return samples as a pattern: taps at the events, and one voice for all else.

    A tap has the height of a ring that is fitted, by least squares with a
    constant force below it, to the samples after its event. The voice has the magnitude
    and the instantaneous frequency of the analytic signal (Gabor, J. IEE 93 (1946), p.
    429), above 20 Hz.
    """
    rest, taps, top = y.astype(np.float64), [], np.abs(y).max()
    ends = [at for at, _ in events[1:]] + [len(y)] * bool(events)
    for (start, hertz), later in zip(events, ends, strict=True):
        at = int(start)
        tail = rest[at : at + round(12 * device.decay * fs)]
        window = tail[: max(4, min(int(later) - at, round(TAP_SECONDS * fs)))]
        window = window - window.mean()  # a force below it is no part of the tap
        if not hertz:
            spectrum = np.abs(np.fft.rfft(window * np.hanning(len(window)), 8192))
            hertz = float(np.argmax(spectrum)) * fs / 8192
        t = np.arange(len(tail)) / fs
        ring = np.exp(-t / device.decay) * np.sin(2 * np.pi * hertz * t)
        near = ring[: len(window)] - ring[: len(window)].mean()
        height = float(window @ near / max(near @ near, 1e-30))
        if abs(height) > 0.001 * top:
            tail -= height * ring
            taps.append((at / fs, height, hertz))
    z = analytic(rest, fs)
    step = max(1, round(GRID * fs))
    level, t = mean(np.abs(z), step)[::step], np.arange(0, len(z), step) / fs
    peak, loud = float(level.max()), level > QUIET * level.max()
    if peak <= 1e-6 * top:
        return Pattern([], taps)
    turn = mean(np.append(z[1:] * z[:-1].conj(), 0.0), max(1, round(SMOOTH * fs)))[::step]
    hertz_at = np.maximum(0.0, np.angle(turn) * fs / (2 * np.pi))
    first, last = np.flatnonzero(level > 0.01 * peak)[[0, -1]]
    part = slice(max(0, first - 1), last + 2)
    amplitude = thinned(t[part], level[part], 0.01 * peak)
    amplitude.append((amplitude[-1][0] + 1 / fs, amplitude[-1][1]))
    start, frequency = amplitude[0][0], thinned(t[loud], hertz_at[loud], 0.1 * peak / level[loud])
    frequency = [(start, frequency[0][1]), *frequency]
    # the phase with which the wave is most like the signal
    now = np.arange(len(z)) / fs
    turns = np.cumsum(np.interp(now, *np.array(frequency).T) * (now >= start)) / fs
    phase = float(np.angle(z @ np.exp(-2j * np.pi * (turns - frequency[0][1] / fs))) + np.pi / 2)
    return Pattern([Voice(amplitude, frequency, "sine", phase % (2 * np.pi))], taps)


def analytic(y: Array, fs: float) -> Any:
    """Return the analytic signal above 20 Hz, shape (n,)."""
    n = 2 ** int(np.ceil(np.log2(len(y) + round(0.1 * fs))))
    spectrum = np.fft.fft(y, n)
    spectrum *= 2.0 * (np.fft.fftfreq(n, 1 / fs) >= LOWEST)
    return np.fft.ifft(spectrum)[: len(y)]


def mean(x: Any, width: int) -> Any:
    """Return the running mean over a number of samples, centred."""
    total, k = np.cumsum(np.append(0.0, x)), np.arange(len(x))
    low, high = np.maximum(0, k - width // 2), np.minimum(len(x), k + (width + 1) // 2)
    return (total[high] - total[low]) / (high - low)


def thinned(t: Array, v: Array, tolerance: Any) -> list[Point]:
    """Return points between which straight lines come as near as the tolerance.

    Source: Douglas and Peucker, Cartographica 10 (1973), with the distance in v.
    """
    keep, todo, limit = {0, len(t) - 1}, [(0, len(t) - 1)], np.broadcast_to(tolerance, t.shape)
    while todo:
        a, b = todo.pop()
        line = np.interp(t[a : b + 1], [t[a], t[b]], [v[a], v[b]])
        off = np.abs(v[a : b + 1] - line) / limit[a : b + 1]
        k = a + int(np.argmax(off))
        if off[k - a] > 1.0 and a < k < b:
            keep.add(k)
            todo += [(a, k), (k, b)]
    return [(float(t[k]), float(v[k])) for k in sorted(keep)]


def loss(y: Array, back: Array, fs: float) -> tuple[float, float, list[Band]]:
    """Return what is lost from y to back, of the same length.

    The RMS of the difference of the samples, and of their envelopes, in dB of the RMS
    of y; and for each octave its middle in Hz, and both levels in dB re 1 unit RMS.
    """
    envelopes = [mean(np.abs(analytic(x, fs)), round(SMOOTH * fs)) for x in (y, back)]
    lost = [decibels(a - b) - decibels(a) for a, b in ((y, back), envelopes)]
    f, bands = np.fft.rfftfreq(len(y), 1 / fs), []
    spectra = [(2 * len(f)) ** 0.5 * np.abs(np.fft.rfft(x)) / len(y) for x in (y, back)]
    for middle in BANDS[BANDS * 2**0.5 < fs / 2].tolist():
        inside = (f >= middle / 2**0.5) & (f < middle * 2**0.5)
        bands.append((middle, *(decibels(s * inside) for s in spectra)))
    return lost[0], lost[1], bands


def decibels(x: Array) -> float:
    """Return the level of samples in dB re 1 RMS, -200 at least."""
    return float(20 * np.log10(max(np.sqrt(np.mean(np.abs(x) ** 2)), 1e-10)))
