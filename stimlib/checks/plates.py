"""The law of the touch screen: every stage from the finger's place to the displacement, written again."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial import legendre

from ..core.graph import Add, Block, Const, Mul, reach
from ..errors import SceneError
from . import laws
from .evidence import Check, Evidence, live

TOL = 1e-6


def swapped(v: np.ndarray, fs: float, freq: float, q: float, gain: float) -> np.ndarray:
    """Zeros on the samples' poles of a mode, poles on those of one ``gain`` times as wide; 1 at the mode's frequency."""
    from scipy.signal import freqz, lfilter

    def at(q):
        return np.poly(np.exp(2 * np.pi * freq / fs * (-0.5 / q + 1j * np.array([1, -1]) * np.sqrt(1 - 0.25 / q**2)))).real

    b, a = at(q), at(q / gain)
    return lfilter(b / abs(freqz(b, a, [2 * np.pi * freq / fs])[1][0]), a, v)


def oscillated(v: np.ndarray, fs: float, freq: float, q: float) -> np.ndarray:
    """A mass on a spring, driven by straight lines between samples: scipy's triangle-hold equivalent."""
    from scipy.signal import cont2discrete, lfilter

    w = 2 * np.pi * freq
    b, a, _ = cont2discrete(([w * w], [1, w / q, w * w]), 1 / fs, "foh")
    return lfilter(b[0], a, v)


def carried(freq: np.ndarray, fs: float, rectify: str | None) -> np.ndarray:
    """The carrier whose mode names how it is rectified."""
    if rectify == "half":
        return laws.carrier_half(freq, fs)
    step = freq.astype(np.longdouble) / np.longdouble(fs)
    turns = np.cumsum(step) - step
    return np.sin(2 * np.longdouble(np.pi) * (turns - np.floor(turns))).astype(float)


def touch_screen(e: Evidence) -> list[Check]:
    """Voltage: envelope, carrier, profile, pole swap and amplifier; displacement: the sum over modes."""
    from ..blocks.bump import Bump
    from ..blocks.carrier import Carrier
    from ..blocks.maps import Maximum, Minimum
    from ..blocks.plates import PoleSwap
    from ..blocks.svf import Svf
    from ..blocks.table import Lut

    root = e.scene.outputs["voltage"]
    blocks = reach([root])
    first: Any = {kind: next((b for b in blocks if isinstance(b, kind)), None) for kind in (Bump, Carrier, Lut, PoleSwap)}
    envelope, carrier, table, swap = first.values()
    if not hasattr(envelope, "waveform") or carrier.rectify == "full" or carrier.phase:
        e.skipped.append("voltage: the law knows the named waveforms on a carrier that is whole or half")
        return []
    x, fs = e.x[e.proc.inputs.index("x")], e.fs
    per_metre = next(b.value for b in reach([envelope.children[0]]) if isinstance(b, Const))
    A = live(e, "A")
    touching = (A != 0).astype(float)
    v = (
        A
        * laws.bump_envelope(x * per_metre, touching, envelope.waveform, live(e, "duty"))
        * carried(live(e, "freq"), fs, carrier.rectify)
    )
    v = v * laws.profile_gain(x, np.ones(x.size), table.knots, table.values, table.kind)[0]
    gain = next(b.a.value for b in blocks if isinstance(b, Mul) and isinstance(b.a, Const) and b.b is swap)
    ends: Any = [next(b.b for b in blocks if isinstance(b, kind)) for kind in (Maximum, Minimum)]
    low, high = (b.value for b in ends)
    v = gain * swapped(v, fs, swap.freq, swap.q, swap.gain)
    e.numbers.append(f"resonance {swap.freq:.6g} Hz, q = {swap.q:g}, answers {swap.gain:g} times as fast")
    e.numbers.append(f"amplifier {gain:g}, {low:g} .. {high:g} V, {int(np.sum((v < low) | (v > high)))} samples held there")
    v = np.clip(v, low, high)
    shown = dict(zip(e.scene.outputs, e.y, strict=True))
    top = float(np.abs(v).max()) or 1.0
    e.wanted["voltage"] = lambda: (v, TOL * top)
    checks = [
        Check("d", "voltage: every stage", float(np.abs(shown["voltage"] - v).max()) / top, TOL, "of its peak, written again")
    ]
    if any(isinstance(b, Svf) for b in reach(e.scene.outputs.values())):
        e.skipped.append("displacement: a plate that the finger loads has no law")
        return checks
    parts = _parts(e.scene.outputs["displacement"])
    d = np.zeros(x.size)
    for scale, (mode, shape) in parts:
        origin = next(b.value for b in reach([shape.x]) if isinstance(b, Const))
        s = np.clip(2 * (x + origin) / shape.length - 1, -1, 1)
        at = np.full(x.size, 2 * shape.y.value / shape.width - 1)
        d += scale * oscillated(shown["voltage"], fs, mode.freq, mode.q) * legendre.legval2d(s, at, shape.c)
    top = float(np.abs(d).max()) or 1.0
    e.wanted["displacement"] = lambda: (d, TOL * top)
    e.numbers.append(f"plate: {len(parts)} modes, largest displacement {1e6 * top:.4g} um")
    text = "sum over modes, of its peak, written again"
    checks.append(Check("d", "displacement: the plate", float(np.abs(shown["displacement"] - d).max()) / top, TOL, text))
    return checks


def _parts(root: Block) -> list[tuple[float, list[Any]]]:
    """(factor, [mode, shape]) of each part of the sum."""
    from ..blocks.plates import Mode, Shape

    if isinstance(root, Add):
        return _parts(root.a) + _parts(root.b)
    match root:
        case Mul(a=Mul(a=Const(value=scale), b=Mode() as mode), b=Shape() as shape):
            return [(scale, [mode, shape])]
    raise SceneError("the displacement is no sum of modes times shapes")
