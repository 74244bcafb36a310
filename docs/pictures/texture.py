"""A measured texture under a tool: python docs/pictures/texture.py writes texture.png
beside it.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import welch

import stimlib
from stimlib.blocks import texture
from stimlib.design.texture import made_up
from stimlib.motion import ramp_and_hold, sinusoid

HAND = {"x": sinusoid(0.04, 0.8), "force": ramp_and_hold(depth=2.5, rise=2.0)}
STEADY = (0.03, 0.3), (0.12, 2.0)  # m/s, N


def picture() -> Figure:
    """Strokes above, spectra of steady ones below."""
    fig = Figure(figsize=(8, 6.8), layout="constrained")
    axes = fig.subplot_mosaic([["x"], ["force"], ["a"], ["psd"]], height_ratios=(1, 1, 1.6, 2.2))
    made = stimlib.render(stimlib.scenes.texture(), HAND, fs=8000, seconds=2.5)
    t = np.arange(made.y.shape[1]) / made.fs
    axes["x"].plot(t, 1e3 * HAND["x"](t))
    axes["x"].set(ylabel="position\n/ mm")
    axes["force"].plot(t, HAND["force"](t))
    axes["force"].set(ylabel="force\n/ N")
    axes["a"].plot(t, made["acceleration"], lw=0.4)
    axes["a"].set(xlabel="time / s", ylabel="acceleration\n/ (m/s²)")
    for name in ("x", "force"):
        axes[name].tick_params(labelbottom=False)
    for v, f in STEADY:
        y = stimlib.compile(stimlib.Scene({"a": texture(v, f, made_up(), seed=1)}), 8000).process(
            np.empty((0, 480_000))
        )[0]
        hz, psd = welch(y, 8000, nperseg=4096)
        lines = axes["psd"].semilogy(hz, psd, lw=0.8, label=f"60 s at {1e3 * v:g} mm/s and {f:g} N")
        own = np.arange(1.0, 500.0)
        axes["psd"].semilogy(own, made_up().psd(own, v, f), "--", color="k", lw=1)
        lines[0].set_alpha(0.8)
    axes["psd"].plot([], [], "--", color="k", lw=1, label="model")
    axes["psd"].set(
        xlim=(0, 700),
        ylim=(1e-7, 1e-1),
        xlabel="frequency / Hz",
        ylabel="PSD of the acceleration\n/ ((m/s²)²/Hz)",
    )
    axes["psd"].legend(fontsize=8)
    for ax in axes.values():
        ax.grid(alpha=0.3)
    return fig


if __name__ == "__main__":
    picture().savefig(Path(__file__).with_name("texture.png"), dpi=90)
