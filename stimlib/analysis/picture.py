"""A rendering at a glance: motion, outputs and their spectra."""

from __future__ import annotations

import dataclasses as dc
import html
import io
import os
from base64 import b64encode
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core import regular
from ..errors import SinkError, shown
from ..run.rendering import Rendering

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure(rendering: Rendering) -> Figure:
    """Inputs over time, outputs over time and the outputs' power spectral densities; ``Rendering.plot`` is this.

    Parameters
    ----------
    rendering : Rendering

    Returns
    -------
    matplotlib.figure.Figure
        Yours to change; pyplot does not know it.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.analysis.picture import figure
    >>> scene = stimlib.Scene({"y": 2 * stimlib.Input("x", "m")})
    >>> fig = figure(stimlib.render(scene, {"x": abs}, fs=1000, seconds=1.0))
    >>> [ax.get_ylabel() for ax in fig.axes]
    ['input / m', 'output / m', 'PSD / (m)²/Hz']
    """
    from matplotlib.figure import Figure
    from scipy.signal import welch

    scene, t = rendering.scene, rendering.t
    inputs = {n: (m(t) if callable(m) else np.asarray(m)[: t.size]) for n, m in rendering.motion.items()}
    fig = Figure(figsize=(9, 7.5 if inputs else 5), layout="constrained")
    axes = iter(fig.subplots(3 if inputs else 2, 1))
    if inputs:
        _curves(next(axes), t, inputs, {n: str(b.dim) for n, b in scene.inputs.items()}, "input")
    outputs = {n: rendering[n] for n in rendering.outputs}
    units = {n: str(b.dim) for n, b in scene.outputs.items()}
    _curves(next(axes), t, outputs, units, "output")
    ax = next(axes)
    for name, y in outputs.items():
        f, S = welch(y, rendering.fs, nperseg=min(4096, y.size), detrend="linear")
        ax.loglog(f[1:], np.maximum(S[1:], 1e-30), lw=0.9, label=name)
    ax.set(xlabel="frequency / Hz", ylabel="PSD / " + ", ".join(f"({u})²/Hz" for u in sorted(set(units.values()))))
    ax.grid(alpha=0.3, which="both")
    ax.legend(loc="upper right")
    return fig


def picture(rendering: Rendering, path: str | os.PathLike) -> None:
    """Draw inputs over time, outputs over time and the outputs' power spectral densities.

    Parameters
    ----------
    rendering : Rendering
    path : str or Path
        PNG, SVG or PDF, by its suffix.

    Raises
    ------
    SinkError
        The file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile, stimlib
    >>> from stimlib.analysis.picture import picture
    >>> from stimlib.motion.generators import minimum_jerk
    >>> squeezed = stimlib.render(stimlib.scenes.squeeze(fingers=1), {"x1": minimum_jerk()}, fs=8000, seconds=1.0)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "squeeze.png"
    >>> picture(squeezed, path)
    >>> path.stat().st_size > 10000
    True
    """
    data = io.BytesIO()
    try:
        figure(rendering).savefig(data, dpi=110, format=Path(path).suffix[1:] or "png")
    except ValueError as e:
        raise SinkError(f"cannot write the picture {path}: {e}") from e
    regular.publish(path, data.getvalue())


def html_of(rendering: Rendering, seconds: float = 10.0) -> str:
    """What a notebook shows of a rendering: its text, and the picture of its first seconds.

    Parameters
    ----------
    rendering : Rendering
    seconds : float
        Length of what is drawn.

    Returns
    -------
    str
        HTML without scripts, the picture in it.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.analysis.picture import html_of
    >>> scene = stimlib.Scene({"y": 2 * stimlib.Input("x", "m")})
    >>> html_of(stimlib.render(scene, {"x": abs}, fs=1000, seconds=1.0))[:46]
    '<pre>Rendering(y: 1 s at 1000 Hz)</pre><img al'
    """
    first = max(1, round(seconds * rendering.fs))
    cut = f" (the first {seconds:g} s)" if rendering.y.shape[1] > first else ""
    data = io.BytesIO()
    figure(dc.replace(rendering, y=rendering.y[:, :first])).savefig(data, dpi=80, format="png")
    text = html.escape(shown(f"{rendering!r}{cut}"))
    return (
        f'<pre>{text}</pre><img alt="inputs, outputs, spectra" src="data:image/png;base64,{b64encode(data.getvalue()).decode()}">'
    )


def _curves(ax, t, curves, units, what):
    for name, y in curves.items():
        ax.plot(t, y, lw=0.8, label=name)
    ax.set(xlabel="time / s", ylabel=f"{what} / " + ", ".join(sorted(set(units.values()))), xlim=(0, t[-1] if t.size > 1 else 1))
    ax.grid(alpha=0.3)
    ax.legend(loc="upper right")
