"""The figures of a verification: signals, the law's signals, and spectra."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from ..analysis.overview import (
    INPUT,
    OUTPUT,
    Against,
    Row,
    Signals,
    close_by,
    curve,
    heights,
    over_time,
    rows_of,
)  # fmt: skip
from ..system.packages import plain_style
from .evidence import Evidence, Tap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

THIRD = "#009e73"  # the green of Okabe and Ito
OUTPUTS = 6  # of so many there are pictures: a layout's time grows with the square of its rows


def figures(e: Evidence) -> Iterator[tuple[str, str]]:
    """Yield the title and SVG of each figure."""
    s = Signals(
        e.scene,
        e.fs,
        {n: e.x[e.proc.inputs.index(n)] for n in e.scene.inputs},
        dict(list(zip(e.scene.outputs, e.shown, strict=True))[:OUTPUTS]),
    )
    above, below = heights(s)
    some = (
        f", the first {OUTPUTS} of {len(e.scene.outputs)} outputs"
        if len(e.scene.outputs) > OUTPUTS
        else ""
    )
    yield f"Signals over time{some}", svg(lambda fig: over_time(fig, rows_of(s), e.fs), (12, above))
    yield (
        "Each output close by: vibration, over position, spectrum",
        svg(lambda fig: close_by(fig, s, spectra_of(e)), (12, below)),
    )
    if e.fingers:
        yield (
            "Vibration, rate and gate (the UGrip paper, figure 4)",
            svg(lambda fig: _fingers(fig, e), (12, 5)),
        )
    if e.curves:
        yield "What the law is made of", svg(lambda fig: _curves(fig, s, e), (12, 6))


def svg(draw: Callable[[Figure], Any], size: tuple[float, float]) -> str:
    """Draw a figure of a size in inches as SVG, with the same text on every run.

    ``draw`` gets the empty figure.
    """
    with plain_style(svg_hashsalt="stimlib", svg_fonttype="none", font_size=9):
        from matplotlib.figure import Figure

        fig = Figure(figsize=size, layout="constrained")
        draw(fig)
        out = io.StringIO()
        fig.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def _fingers(fig, e):
    """Draw a column for each finger, on the same scales."""
    axes = fig.subplots(3, len(e.fingers), squeeze=False, sharex=True, sharey="row")
    t = np.arange(e.x.shape[1]) / e.fs
    for (top, middle, bottom), (name, finger) in zip(axes.T, e.fingers.items(), strict=True):
        curve(top, t, e.y[list(e.scene.outputs).index(name)] - finger.mean, color=OUTPUT)
        curve(middle, t, finger.v, color=INPUT)
        curve(bottom, t, finger.gate.astype(float), color=THIRD)
        top.set_title(name)
        bottom.set(xlabel="time / s", xlim=(0, max(t[-1], 1 / e.fs)))
    for ax, label in zip(axes[:, 0], ("force - k x / N", "rate / (m/s)", "gate"), strict=True):
        ax.set_ylabel(label)
    for ax in axes.flat:
        ax.grid(alpha=0.3)


def _curves(fig, s, e):
    """Draw the motion, the delivered signals and the law's signals, in close-up."""
    rows = rows_of(s) + [Row({name: (y, THIRD)}, "1") for name, y in e.curves.items()]
    parts = [
        row._replace(curves={name: (y[e.closeup], c) for name, (y, c) in row.curves.items()})
        for row in rows
    ]
    over_time(fig, parts, e.fs, e.closeup.start or 0)


def spectra_of(e: Evidence) -> dict[str, Against]:
    """Return spectra by output, as ``Report.spectra`` gives them."""
    found = {tap.output: _of_noise(tap) for tap in e.taps if tap.spectrum and tap.model}
    for name, law in e.wanted.items():
        want, apart = law()
        y = e.y[list(e.scene.outputs).index(name)]
        if y.size < 2:
            continue  # one sample has no line but its mean, which is left out
        size = min(8192, y.size)
        with np.errstate(over="ignore", invalid="ignore"):  # squares of huge numbers are not drawn
            f, (measured, model) = scipy.signal.welch(
                np.array([y, want]), e.fs, nperseg=size, detrend=False
            )
            # of so much at every sample, with a sign that alternates: no other
            # difference has a higher line under the Hann window
            most = np.sqrt(np.square(np.max(apart)) * size / 1.5 / e.fs)
            low, high = np.maximum(np.sqrt(model) - most, 0) ** 2, (np.sqrt(model) + most) ** 2
        if not np.isfinite([measured, high]).all():
            continue
        unit = f"{e.scene.outputs[name].dim}"
        found[name] = Against(
            f"spectrum of {name}, and of its law",
            unit,
            *(a[1:] for a in (f, measured, model, low, high)),
        )
    return found


def _of_noise(tap: Tap) -> Against:
    """Return the third-octave spectrum of a gated noise, with its model and limits."""
    s: Any = tap.spectrum
    model: Any = tap.model
    centre = np.array([np.sqrt(b.f_low * b.f_high) for b in s.bands])
    bins, level = np.array([b.bins for b in s.bands]), model(centre)
    p = 1e-6 / (len(s.bands) + 1) / 2
    low, high = (f(bins, p) / bins for f in (scipy.special.gammaincinv, scipy.special.gammainccinv))
    return Against(
        f"noise in {tap.output} before gate and rate",
        f"{tap.block.dim}",
        centre,
        level * np.array([b.ratio for b in s.bands]),
        level,
        level * low,
        level * high,
    )
