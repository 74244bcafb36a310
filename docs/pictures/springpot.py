"""Pictures of the springpot: python docs/pictures/springpot.py writes springpot_*.svg
beside itself and prints what reference/blocks/fractional.rst has.

Everything is rendered by stimlib.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.special import gamma

import stimlib
from stimlib import Input, Scene, constant
from stimlib.blocks import (
    compliance_generalized_kelvin_voigt,
    compliance_kelvin_voigt,
    compliance_maxwell,
    equal_force,
    maxwell,
    spring,
    springpot,
    springpot_stiffness,
)
from stimlib.blocks.fractional import creep_compliance, maxwell_stiffness
from stimlib.motion import ramp_and_hold

HERE = Path(__file__).parent
FS, W = 1000, 2 * np.pi  # the thesis' sample rate and frequency
ORDERS = (0.0, 0.25, 0.5, 0.75, 1.0)
Y, F = Input("y", "m"), Input("f", "N")
# told apart by people who do not see red and green as others do (Okabe and Ito)
SPRING, DASHPOT, ARM, POT, KELVIN_VOIGT = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7"


def run(block, x):
    return stimlib.compile(Scene({"out": block}), FS).process(x[None])[0]


def save(fig, name):
    fig.savefig(HERE / f"springpot_{name}.svg", metadata={"Date": None})


def dots(ax, t, law, color, every=100, first=25):
    ax.plot(
        t[first::every], law[first::every], "o", color=color, ms=4.5, mfc="white", mew=1.1, zorder=3
    )


# Figure 2.3 ---------------------------------------------------------------------------
def phase():
    """Phase of a Maxwell arm over time constant and frequency."""
    tau, w = np.geomspace(1e-2, 1e2, 41), np.geomspace(1e-2, 1e2, 41)
    phi = np.array([np.degrees(maxwell_stiffness(1.0, float(one), w).phase) for one in tau]).T
    fig = Figure(figsize=(6, 4.5), layout="constrained")
    ax = fig.subplots()
    ax.set(xscale="log", yscale="log", xlabel="time constant tau, s", ylabel="frequency w, rad/s")
    filled = ax.contourf(tau, w, phi, np.linspace(0, 90, 19), cmap="autumn")
    lines = ax.contour(tau, w, phi, [10.0, 80.0], colors=["blue", "black"])
    ax.clabel(lines, fmt="%.0f°")
    fig.colorbar(filled, label="phase of force over displacement, degrees")
    save(fig, "maxwell_phase")


# Figure 3.3 ---------------------------------------------------------------------------
def history(alpha=0.5):
    """Full sum, the thesis' two methods of 100 points, and ours."""
    chi, t = equal_force(300.0, 0.0, alpha, W), np.arange(3 * FS) / FS
    movements = {
        "pressed at 1 Hz": 0.005 * (1 - np.cos(W * t)),
        "pressed in 0.1 s, then held": ramp_and_hold(depth=0.01, rise=0.1, start_time=0.1)(t),
    }
    methods = [
        ("thesis: last 100 samples", POT, "-", {"scheme": "gl-short-memory"}),
        ("thesis: 100 samples of all", ARM, "-", {"scheme": "gl-downsampled", "horizon": 3.0}),
        ("springpot, tol = 1e-6", "#7fb0ff", "-", {"tol": 1e-6}),
        ("springpot, tol = 1e-10", "#1f5fd0", "--", {"tol": 1e-10}),
        ("springpot, tol = 1e-14", "#0b2a66", "-", {"tol": 1e-14}),
    ]
    j = np.arange(1, t.size, dtype=np.longdouble)
    v = np.cumprod(np.r_[1, (j - alpha) / j])
    fig = Figure(figsize=(10, 7), layout="constrained")
    rows = fig.subplots(3, 2, sharex=True, sharey="row", height_ratios=(1, 2.6, 2.6))
    for (top, middle, below), (title, y) in zip(rows.T, movements.items(), strict=True):
        full = chi * FS**alpha * np.convolve(v, np.diff(y, prepend=y[0]))[: t.size]
        top.plot(t, 1e3 * y, color="0.3", lw=1)
        top.set_title(title)
        middle.plot(t, full, color="0.75", lw=6, label="full sum, up to 3000 samples")
        for name, color, style, how in methods:
            f = run(springpot(Y, chi, alpha, **{"scheme": "gl"} | how), y)
            error = np.abs(f - full).astype(float) / float(np.abs(full).max())
            below.semilogy(
                t[::3], np.where(error > 0, error, np.nan)[::3], color=color, lw=0.9, label=name
            )
            print(f"{title}: {name}: {error.max():.2g}")
            if how.get("tol", 1e-10) == 1e-10:
                middle.plot(t, f, style, color=color, lw=1.6)
        below.set(
            ylim=(1e-18, 10), yticks=10.0 ** np.arange(-18, 1, 3), xlabel="time / s", xlim=(0, 3)
        )
    for row, name in zip(rows, ("y / mm", "force / N", "error / largest force"), strict=True):
        row[0].set_ylabel(name)
        for ax in row:
            ax.grid(alpha=0.3)
    (band, name), (lines, names) = (ax.get_legend_handles_labels() for ax in rows[1:, 0])
    fig.legend(band + lines, name + names, loc="outside lower center", ncols=3)
    save(fig, "history")


# Figure 1.1 ---------------------------------------------------------------------------
def relaxation(k=100.0, b=10.0, tau=0.3, chi=60.0, alpha=0.3, depth=0.01, force=1.0):
    """Ramps and holds on springs and dashpots, and steps of force: blocks as lines, the
    continuous law as dots.
    """
    fig = Figure(figsize=(11, 6.8), layout="constrained")
    (a, b1, b2), (c, d, e) = fig.subplots(2, 3)
    start, n = 0.2, 2 * FS
    t = np.arange(n) / FS
    for ax, rise, style in ((b1, 0.1, "-"), (b2, 0.8, "--")):
        y = ramp_and_hold(depth=depth, rise=rise, start_time=start)(t)
        on, off, v = np.maximum(t - start, 0), np.maximum(t - start - rise, 0), depth / rise
        a.plot(t, 1e3 * y, style, color="0.2", label=f"in {rise:g} s")
        rows = (
            ("spring", SPRING, spring(Y, k), k * y),
            ("dashpot", DASHPOT, springpot(Y, b, 1.0), b * v * ((on > 0) & (off == 0))),
            (
                "Maxwell arm",
                ARM,
                maxwell(Y, k, tau=tau),
                k * v * tau * (np.exp(-off / tau) - np.exp(-on / tau)),
            ),
            (
                f"springpot, alpha = {alpha:g}",
                POT,
                springpot(Y, chi, alpha, scheme="l1"),
                chi * v / gamma(2 - alpha) * (on ** (1 - alpha) - off ** (1 - alpha)),
            ),
        )
        for name, color, block, law in rows:
            f = run(block, y)
            ax.plot(t, f, style, color=color, lw=1.3)
            dots(ax, t, law, color)
            far = np.minimum(abs(t - start), abs(t - start - rise)) > 0.01
            print(
                f"ramp of {rise:g} s: {name}: off the law by"
                f" {np.abs(f - law)[far].max() / np.abs(law).max():.1g}"
            )
        ax.set(title=f"force, pressed in {rise:g} s", ylabel="force / N", ylim=(-0.05, 1.45))
    a.set(title="stress relaxation: what is done", ylabel="displacement / mm")
    a.legend(loc="lower right")

    n, end = 4 * FS, 2.0
    t = np.arange(n) / FS
    f = force * ((t >= start) & (t < end))
    c.plot(t, f, color="0.2")
    rows = (
        ("spring", SPRING, F / constant(k, "N/m"), {"k0": k}),
        ("dashpot", DASHPOT, compliance_generalized_kelvin_voigt(F, [], b=5 * b), {"b": 5 * b}),
        ("Maxwell arm", ARM, compliance_maxwell(F, k, b=5 * b), {"k0": k, "b": 5 * b}),
        (
            "Kelvin-Voigt",
            KELVIN_VOIGT,
            compliance_kelvin_voigt(F, k, tau=tau),
            {"elements": [(k, tau)]},
        ),
        (f"springpot, alpha = {alpha:g}", POT, None, {"springpot": (chi, alpha)}),
    )
    for name, color, block, what in rows:
        late = 0.0 if block is None else 0.5 / FS  # a step takes one sample
        on, off = (
            np.where(t < at, 0, creep_compliance(np.maximum(t - at + late, 0), **what))
            for at in (start, end)
        )
        law = force * (on - off)
        if block is None:
            creep = law
            d.plot(t, 1e3 * law, ":", color=color, lw=1.2)
            d.plot([], [], color=color, lw=1.3, label=name)
        else:
            got = run(block, f)
            d.plot(t, 1e3 * got, color=color, lw=1.3, label=name)
            far = np.minimum(abs(t - start), abs(t - end)) > 0.01
            print(
                f"creep: {name}: off the law by"
                f" {np.abs(got - law)[far].max() / np.abs(law).max():.1g}"
            )
        dots(d, t, 1e3 * law, color, 200, 50)
    back = run(springpot(Y, chi, alpha, scheme="l1"), creep)
    e.plot(t, back, color=POT, lw=1.3)
    dots(e, t, f, POT, 200, 50)
    far = np.minimum(abs(t - start), abs(t - end))
    off = np.abs(back - f)[far > 0.02].max()
    print(
        f"force of the springpot along its creep: off by {off:.1g} N beyond 20 ms, at most"
        f" {back.max():.3g} N"
    )
    c.set(title="creep: what is done", ylabel="force / N")
    d.set(title="displacement", ylabel="displacement / mm", ylim=(-1, 52))
    e.set(title="force of a springpot moved like that", ylabel="force / N", ylim=(-0.35, 1.45))
    lines, names = d.get_legend_handles_labels()
    (law,) = d.plot([], [], "o", color="0.2", ms=4.5, mfc="white", mew=1.1)
    fig.legend([*lines, law], [*names, "the continuous law"], loc="outside lower center", ncols=6)
    for ax in (a, b1, b2, c, d, e):
        ax.set(xlabel="time / s", xlim=(0, 2 if ax in (a, b1, b2) else 4))
        ax.grid(alpha=0.3)
    save(fig, "relaxation")


# Figures 2.4 and 2.5 ------------------------------------------------------------------
def stiffness(chi0=300.0, depth=0.01):
    """Forces of equal size at 1 Hz, k_C in polar coordinates, storage and loss,
    phase.
    """
    fig = Figure(figsize=(11, 7.6), layout="constrained")
    grid = fig.add_gridspec(2, 2)
    wave, polar = fig.add_subplot(grid[0, 0]), fig.add_subplot(grid[0, 1], projection="polar")
    size, phase = fig.add_subplot(grid[1, 0]), fig.add_subplot(grid[1, 1])
    t, f = np.arange(3 * FS + 1) / FS, np.geomspace(0.1, 500, 200)
    y = depth * np.sin(W * t)
    wave.plot(t, chi0 * y, color="0.8", lw=5, label="y times 300 N/m")
    shades = mpl.colormaps["viridis"](np.linspace(0, 0.85, len(ORDERS)))
    few = f[::12]
    for alpha, color in zip(ORDERS, shades, strict=True):
        chi = equal_force(chi0, 0.0, alpha, W)
        proc = stimlib.compile(Scene({"f": springpot(Y, chi, alpha, scheme="l1")}), FS)
        wave.plot(t, proc.process(y[None])[0], color=color, lw=1.2, label=f"alpha = {alpha:g}")
        law, sampled = springpot_stiffness(chi, alpha, W * f), proc.response("f", "y", few)
        size.loglog(f, np.where(law.storage > 1e-9, law.storage, np.nan), color=color, lw=1.3)
        size.loglog(f, np.where(law.loss > 1e-9, law.loss, np.nan), "--", color=color, lw=1.3)
        phase.semilogx(f, np.degrees(law.phase), color=color, lw=1.3)
        phase.semilogx(few, np.degrees(np.angle(sampled)), "o", color=color, ms=4, mfc="white")
        for hz, mark in ((0.5, "v"), (1.0, "o"), (2.0, "^")):
            k = springpot_stiffness(chi, alpha, W * hz)
            polar.plot(k.phase, k.magnitude, mark, color=color, ms=6, clip_on=False, zorder=3)
        polar.plot([0, alpha * np.pi / 2], [0, chi * (2 * W) ** alpha], color=color, lw=1)
        at = np.searchsorted(few, 100.0)
        off = abs(sampled[at]) / springpot_stiffness(chi, alpha, W * few[at]).magnitude - 1
        print(
            f"alpha {alpha:g}: at {few[at]:.0f} Hz phase {np.degrees(np.angle(sampled[at])):.1f}"
            f" deg, |k| off by {abs(off):.2g}"
        )
    wave.set(
        title="force of equal size at 1 Hz",
        xlabel="time / s",
        ylabel="force / N",
        xlim=(0, 3),
        ylim=(-3.6, 5.6),
    )
    wave.legend(loc="upper center", ncols=3, fontsize=8)
    polar.set(thetamin=0, thetamax=90, rmax=620, rticks=[150, 300, 450, 600])
    polar.set_title("k_C at 0.5 (▾), 1 (●) and 2 Hz (▴); along: N/m", pad=12)
    size.set(
        title="storage (line) and loss (dashed) / N/m", xlabel="frequency / Hz", ylim=(20, 2e5)
    )
    phase.set(
        title="phase of the force / degrees; dots: block at 1 kHz",
        xlabel="frequency / Hz",
        yticks=np.linspace(0, 90, 5),
    )
    for ax in (wave, size, phase):
        ax.grid(alpha=0.3)
    save(fig, "stiffness")


if __name__ == "__main__":
    mpl.rcParams.update({"svg.hashsalt": "stimlib", "font.size": 9})
    for draw in (phase, history, relaxation, stiffness):
        draw()
