"""A rendering at a glance: motion, outputs and their spectra."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np

from ..core import regular
from ..errors import SinkError
from ..run.rendering import Rendering


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
    data = io.BytesIO()
    try:
        fig.savefig(data, dpi=110, format=Path(path).suffix[1:] or "png")
    except ValueError as e:
        raise SinkError(f"cannot write the picture {path}: {e}") from e
    regular.publish(path, data.getvalue())


def _curves(ax, t, curves, units, what):
    for name, y in curves.items():
        ax.plot(t, y, lw=0.8, label=name)
    ax.set(xlabel="time / s", ylabel=f"{what} / " + ", ".join(sorted(set(units.values()))), xlim=(0, t[-1] if t.size > 1 else 1))
    ax.grid(alpha=0.3)
    ax.legend(loc="upper right")
