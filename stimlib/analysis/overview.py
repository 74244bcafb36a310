"""Overview picture of a rendering: signals over time, and details of each output.

The details of an output are its vibration, its course over position and its spectrum.

Signals share a panel only where their samples are identical, or where their names
differ by digits alone; these have lines of different kinds, so none hides another. A
panel has no more signals than there are kinds of lines.
"""

from __future__ import annotations

import dataclasses as dc
import html
import io
import os
import re
from base64 import b64encode
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import cycle
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core.graph import Input, reach
from ..core.scene import Scene
from ..core.units import pretty
from ..errors import BadValue, MissingPackage, SinkError, public, shown
from ..run.rendering import Rendering
from ..system import safe_files
from ..system.packages import package, plain_style
from .listening import CUTOFF, vibration

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 1500  # per curve: more cannot be seen
MOST = 12  # rows: of a scene with more signals the first are drawn
CLOSEUP = 0.06  # s
PLACES = "m", "rad"
NEGLIGIBLE = 1e-5  # of a signal: what vibrates less is rounding
UNSEEN = 0.05  # of a signal: what vibrates less is not seen in its curve
BINS = 20  # of positions
TURNS = 8  # of a vibration; a step has fewer
INPUT, OUTPUT, LAW = "#0072b2", "#d55e00", "k"  # Okabe and Ito's, for the colour-blind
LINES = "-", "--", ":", "-."
FLOOR = 1e-12  # of the top: what of a spectrum is below is rounding
FORMATS = (".png", ".svg", ".pdf")


class Against(NamedTuple):
    """A measured spectrum and its law's PSD, both of shape (n,), in unit^2/Hz."""

    title: str
    unit: str
    f: np.ndarray  # Hz
    measured: np.ndarray
    law: np.ndarray
    low: np.ndarray
    """Lower edge of the band of correct renderings."""
    high: np.ndarray
    """Upper edge of the band of correct renderings."""


class Row(NamedTuple):
    """Signals over time in one panel: samples and colour by name, and their unit."""

    curves: dict[str, tuple[np.ndarray, str]]
    unit: str


class Signals(NamedTuple):
    """The signals to draw: the scene, its sample rate in Hz, and samples by name."""

    scene: Scene
    fs: float
    inputs: Mapping[str, np.ndarray]
    outputs: Mapping[str, np.ndarray]

    def unit(self, name: str) -> str:
        """Return the unit of an input or output; an angle is in rad."""
        block = (self.scene.inputs | self.scene.outputs)[name]
        return "rad" if isinstance(block, Input) and block.unit == "rad" else f"{block.dim}"

    def kind(self, name: str) -> tuple[str, str]:
        """Return what signals in one panel share: unit, and name but for digits."""
        return self.unit(name), name.rstrip("0123456789")

    def over(self, output: str) -> str | None:
        """Return the input over which an output is drawn, or None.

        This is a position or angle on which it depends, the one that its name begins
        with or the first, or its only input.
        """
        found = {b.name for b in reach([self.scene.outputs[output]]) if isinstance(b, Input)}
        names = [n for n in self.scene.inputs if n in found]
        places = [n for n in names if self.unit(n) in PLACES]
        places.sort(key=lambda n: -len(n) * output.startswith(n))  # x10, not x1
        return next(iter(places or (names if len(names) == 1 else ())), None)

    def detailed(self) -> list[str]:
        """Return the outputs with details: no input as it came, no output twice.

        An output that shares the panel of an input is seen beside it.
        """
        drawn = {y.tobytes() for y in self.inputs.values()}
        kinds = {self.kind(name) for name in self.inputs}
        first = {y.tobytes(): name for name, y in reversed([*self.outputs.items()])}
        names = [
            n
            for data, n in reversed([*first.items()])
            if data not in drawn and self.kind(n) not in kinds
        ]
        return (names or list(self.outputs))[:MOST]


@public
def picture(
    rendering: Rendering, path: str | os.PathLike, spectra: Mapping[str, Against] | None = None
) -> None:
    """Draw a rendering: each signal over time, and each output in detail.

    The details are a close-up of its vibration, its course over position, and its
    spectrum.

    The vibration is computed by ``stimlib.analysis.listening.vibration``. A spectrum
    ends 12 decades below its top.

    Parameters
    ----------
    rendering : Rendering
    path : str or Path
        PNG, SVG or PDF, by its suffix.
    spectra : dict of str to Against, optional
        For each output, the spectrum to draw instead, with its reference law and band,
        as ``stimlib.verify(..).spectra()`` returns them.

    Raises
    ------
    SinkError
        The file cannot be written, or has another suffix.

    Examples
    --------
    >>> import pathlib, tempfile, stimlib
    >>> from stimlib.analysis import picture
    >>> from stimlib.motion import minimum_jerk
    >>> squeezed = stimlib.render(
    ...     stimlib.scenes.squeeze(fingers=1),
    ...     {"x1": minimum_jerk()},
    ...     fs=8000,
    ...     seconds=1.0,
    ... )
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "squeeze.png"
    >>> picture(squeezed, path)
    >>> path.stat().st_size > 10000
    True
    """
    check_place(path)
    with plain_style():
        save(figure(rendering, spectra), path)


def save(drawn: Figure, path: str | os.PathLike) -> None:
    """Write a figure atomically to a path that ``check_place`` accepts."""
    data = io.BytesIO()
    drawn.savefig(data, dpi=110, format=Path(path).suffix[1:].lower())
    safe_files.publish(path, data.getvalue())


def check_place(
    path: str | os.PathLike, what: str = "picture", formats: Sequence[str] = FORMATS
) -> None:
    """Raise an error before drawing if a picture cannot be written to a path.

    Parameters
    ----------
    path : str or Path
    what : str
        Name of the picture, for error messages.
    formats : sequence of str
        Suffixes that it may have.

    Raises
    ------
    MissingPackage
        matplotlib is not there, which draws it.
    SinkError
        Another suffix; a folder is there, or none to write into.

    Examples
    --------
    >>> from stimlib.analysis.overview import check_place
    >>> check_place("squeeze.xyz")
    Traceback (most recent call last):
    stimlib.errors.SinkError: cannot write the picture squeeze.xyz: its name must ...
    """
    package("matplotlib", f"a {what}")
    if os.path.isdir(path):
        raise SinkError(f"cannot write the {what} {path}: it is a folder")
    if Path(path).suffix.lower() not in formats:
        raise SinkError(
            f"cannot write the {what} {path}: its name must end in one of {', '.join(formats)}"
        )
    if not Path(path).absolute().parent.is_dir():
        raise SinkError(
            f"cannot write the {what} {path}: the folder {Path(path).parent} is not there; make it"
            " first"
        )


def figure(rendering: Rendering, spectra: Mapping[str, Against] | None = None) -> Figure:
    """Return the picture as a matplotlib figure; see ``Rendering.plot``.

    The figure is not registered with pyplot.

    Parameters
    ----------
    rendering : Rendering
    spectra : dict of str to Against, optional
        As for ``picture``.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    BadValue
        A rendering of no sample.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.analysis.overview import figure
    >>> scene = stimlib.Scene({"y": 2 * stimlib.Input("x", "m")})
    >>> figure(stimlib.render(scene, {"x": abs}, fs=1000, seconds=1.0)).axes[
    ...     0
    ... ].get_ylabel()
    'x'
    """
    Figure = package("matplotlib.figure", "a picture").Figure
    n = rendering.y.shape[1]
    if not n:
        raise BadValue("the rendering has no sample to draw")
    t = rendering.t
    inputs = {
        name: np.asarray(m(t) if callable(m) else m, np.float64)[:n]
        for name, m in rendering.motion.items()
    }
    s = Signals(
        rendering.scene, rendering.fs, inputs, {name: rendering[name] for name in rendering.outputs}
    )
    above, below = heights(s)
    fig: Any = Figure(figsize=(12, above + below), layout="constrained")
    rows = rows_of(s)
    title = "\n".join(shown(line) for line in (title_of(rendering), *cut_from(s, rows)))
    fig.suptitle(title.replace("$", r"\$"))
    top, bottom = fig.subfigures(2, 1, height_ratios=(above, below))
    over_time(top, rows, s.fs)
    close_by(bottom, s, spectra or {})
    return fig


def title_of(rendering: Rendering) -> str:
    """Return what a picture shows: the scene, its parameters and the sample rate."""
    params = rendering.scene.params
    # in the unit that was stated: Hz and rad/s are the same dimension
    units = {k: f" {pretty(p.unit)}".removesuffix(" 1").rstrip() for k, p in params.items()}
    numbers = [f"{k} = {v:g}{units[k]}" for k, v in rendering.params.items()]
    said = [*(part.law for part in rendering.scene.parts), *numbers]
    more = [f"and {len(said) - MOST} more"] * (len(said) > MOST)
    return ", ".join([*said[:MOST], *more, f"{rendering.fs:g} Hz"])


def cut_from(s: Signals, rows: list[Row]) -> list[str]:
    """Return a line on how many outputs are drawn, or none where all are."""
    seen = {name for row in rows for label in row.curves for name in label.split(" = ")}
    over, close = sum(name in seen for name in s.outputs), len(s.detailed())
    if over == len(s.outputs) and not MOST == close < over:
        return []
    return [f"{over} of {len(s.outputs)} outputs over time, {close} in detail"]


def html_of(rendering: Rendering, seconds: float = 10.0) -> str:
    """Return the HTML of a rendering for a notebook: its text and a picture.

    The picture shows its first seconds, if it can be drawn.

    Parameters
    ----------
    rendering : Rendering
    seconds : float
        Duration of the drawn part.

    Returns
    -------
    str
        HTML without scripts, with the picture, or why there is none.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.analysis.overview import html_of
    >>> scene = stimlib.Scene({"y": 2 * stimlib.Input("x", "m")})
    >>> html_of(stimlib.render(scene, {"x": abs}, fs=1000, seconds=1.0))[:46]
    '<pre>Rendering(y: 1 s at 1000 Hz)</pre><img al'
    """
    first = max(1, round(seconds * rendering.fs))
    cut = f" (the first {seconds:g} s)" if rendering.y.shape[1] > first else ""
    data = io.BytesIO()
    text = f"<pre>{html.escape(shown(f'{rendering!r}{cut}'))}</pre>"
    try:
        with plain_style():
            drawn = figure(dc.replace(rendering, y=rendering.y[:, :first]))
            drawn.savefig(data, dpi=80, format="png")
    except (BadValue, MissingPackage) as e:  # no sample, no matplotlib
        return f"{text}<p>{html.escape(str(e))}</p>"
    return (
        f'{text}<img alt="inputs, outputs, spectra"'
        f' src="data:image/png;base64,{b64encode(data.getvalue()).decode()}">'
    )


def heights(s: Signals) -> tuple[float, float]:
    """Return the heights in inches of the ``over_time`` and ``close_by`` panels."""
    return 0.6 + 1.1 * len(rows_of(s)), 3.0 * len(s.detailed())


def rows_of(s: Signals) -> list[Row]:
    """Return the rows of a picture.

    Identical signals are one curve. What vibrates in an output has a row of its own
    where it would not be seen in that of the output.
    """
    same: dict[tuple[str, bytes], list[str]] = {}
    signals = {**s.inputs, **s.outputs}
    for name, y in signals.items():
        same.setdefault((s.unit(name), y.tobytes()), []).append(name)
    rows: dict[Any, Row] = {}
    alike: Counter[tuple[str, str]] = Counter()
    for (unit, _), names in same.items():
        y, color = signals[names[0]], INPUT if names[0] in s.inputs else OUTPUT
        kind = s.kind(names[0])
        row = rows.setdefault((kind, alike[kind] // len(LINES)), Row({}, unit))
        alike[kind] += 1
        row.curves[" = ".join(names)] = y, color
        if color == OUTPUT and hidden(y, s.fs):
            name = f"{names[0]}, above {CUTOFF:g} Hz"
            rows[name] = Row({name: (vibration(y, s.fs), color)}, unit)
    return list(rows.values())[:MOST]


def over_time(fig: Any, rows: list[Row], fs: float, start: int = 0) -> None:
    """Draw a panel over time for each row, beginning at sample ``start``."""
    axes = fig.subplots(len(rows), 1, squeeze=False, sharex=True)[:, 0]
    size = 1
    for ax, (curves, unit) in zip(axes, rows, strict=True):
        for (name, (y, color)), line in zip(curves.items(), cycle(LINES), strict=False):
            label = re.sub("^_", " _", name)  # matplotlib leaves out what begins with one
            curve(ax, (start + np.arange(y.size)) / fs, y, color=color, ls=line, label=label)
            size = y.size
        _axes(ax, fill(", ".join(curves), 13, break_long_words=False), unit, most=10)
        if len(curves) > 1:
            ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    axes[-1].set(xlabel="time / s", xlim=(start / fs, (start + max(size - 1, 1)) / fs))


def close_by(fig: Any, s: Signals, spectra: Mapping[str, Against]) -> None:
    """Draw the details of each output: vibration, course over position, spectrum.

    The vibration is shown where it is largest, if the output ``vibrates``; the course
    is shown if the output depends on a position or angle, or on one input alone, unless
    it is noise over it. Vibration that is ``hidden`` in the output is shown by itself.
    """
    names = s.detailed()
    for row, name in zip(fig.subfigures(len(names), 1, squeeze=False)[:, 0], names, strict=True):
        y, source, own = s.outputs[name], s.over(name), vibrates(s.outputs[name], s.fs)
        shown_as = f"{name}, above {CUTOFF:g} Hz" if own and hidden(y, s.fs) else name
        fast = vibration(y, s.fs) if shown_as != name else y
        within = None
        if source is not None:
            x = s.inputs[source]
            within = (x.min(), x.max()) if shown_as != name else _within(x, y)
        widths = [1] * own + [1 if own else 2] * (within is not None) + [1]
        grid = {"wspace": 0.06, "width_ratios": widths}
        axes = row.subplots(1, len(widths), squeeze=False, gridspec_kw=grid)[0]
        if own:
            _vibration(axes[0], s, name, fast, shown_as)
        if source is not None and within is not None:
            _over_position(axes[-2], s, fast, shown_as, s.unit(name), source, within)
        against(axes[-1], spectra[name]) if name in spectra else _density(axes[-1], s, name)


def hidden(y: np.ndarray, fs: float) -> bool:
    """Return whether a signal vibrates so little that its curve does not show it."""
    if fs <= 2 * CUTOFF or not np.isfinite(y).all() or not vibrates(y, fs):
        return False
    fast = vibration(y, fs)[_inner(y, fs)]
    top = np.abs(fast).max()
    turns = np.count_nonzero(np.diff(np.sign(fast[np.abs(fast) > top / 4])))
    return bool(turns >= TURNS and NEGLIGIBLE * np.ptp(y) < top < UNSEEN * np.ptp(y))


def _within(x: np.ndarray, y: np.ndarray) -> tuple[float, float] | None:
    """Return the range of positions to draw a signal over.

    That is all of it, or a tenth where more would be a filled area, or None where that
    would be one too, because the signal is not the same at the same position.
    """
    low, high, wide = float(x.min()), float(x.max()), float(np.ptp(x))
    bins = np.minimum((x - low) / (wide or 1.0) * BINS, BINS - 1).astype(int)
    starts = np.flatnonzero(np.diff(bins, prepend=-1))  # of each way through a bin
    sizes = np.diff(starts, append=x.size)
    y = y / (np.abs(y).max() or 1.0)  # or squares overflow
    means, squares = (np.add.reduceat(v, starts) / sizes for v in (y, y * y))
    if not np.mean(squares - means**2 > np.var(y) / 4) > 0.9:
        return low, high
    steps = np.diff(y[np.argsort(x, kind="stable")])
    return None if np.mean(steps**2) > np.var(y) else (low + 0.45 * wide, low + 0.55 * wide)


def vibrates(y: np.ndarray, fs: float) -> bool:
    """Return whether a signal vibrates by itself, rather than having a corner only.

    From one octave to the next, the power of a corner, such as the contact with a wall,
    falls to an eighth, and that of a step to a half.
    """
    if y.size < fs / 5 or fs <= 4 * CUTOFF:
        return True  # too few octaves to say
    from scipy.signal import periodogram

    with np.errstate(over="ignore", invalid="ignore"):
        if not np.abs(vibration(y, fs)[_inner(y, fs)]).max() > NEGLIGIBLE * np.ptp(y):
            return not np.isfinite(y).all()
        f, S = periodogram(y, fs, "hann", detrend="linear")
    low, middle, high = (
        S[(f >= a * CUTOFF) & (f < b * CUTOFF)].sum() for a, b in ((0.5, 1), (1, 2), (2, fs))
    )
    return not low > 3 * middle > 9 * high


def _inner(y: np.ndarray, fs: float) -> slice:
    """Return the part without the ends, where slow and fast are not told apart."""
    edge = max(1, round(CLOSEUP * fs / 2)) + round(fs / CUTOFF / 2)
    return slice(edge, y.size - edge) if y.size > 2 * edge else slice(None)


def curve(ax: Any, t: np.ndarray, y: np.ndarray, **style: Any) -> None:
    """Draw a curve by the smallest and largest value in each of POINTS intervals."""
    some = extremes(y, y.size // POINTS)
    ax.plot(t[some], y[some], **({"lw": 0.7} | style))


def extremes(y: np.ndarray, step: int) -> np.ndarray:
    """Return where a signal is smallest and largest in each interval of some samples.

    So no extreme value is lost; of two samples or less all are returned.
    """
    if step < 3:
        return np.arange(y.size)
    tiles = np.pad(y, (0, -y.size % step), mode="edge").reshape(-1, step)
    places = np.array([tiles.argmin(axis=1), tiles.argmax(axis=1)])
    return np.unique(places + step * np.arange(len(tiles)))


def _axes(ax: Any, name: str, unit: str, most: int = 4, over: str = "1") -> None:
    """Label an axis with units of one prefix, such as 20 mm or 0.5 N.

    Numbers without a unit are printed without a prefix.
    """
    from matplotlib.ticker import MaxNLocator

    for axis, u in ((ax.yaxis, unit), (ax.xaxis, over)):
        if u != "1":
            axis.set_major_formatter(partial(_tick, axis, u))
    ax.xaxis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
    ax.set_ylabel(shown(name))
    ax.grid(alpha=0.3)


def _tick(axis: Any, unit: str, value: float, _: int) -> str:
    """Return the label of a value; all labels of an axis have the same prefix."""
    from matplotlib.ticker import EngFormatter

    top = np.abs(axis.get_view_interval()).max()
    # a power holds for the prefix, too: 1 mm² is 1e-6 m², and 1 km⁻¹ is 0.001 m⁻¹
    plain = re.match(r"(?!kg)[A-Za-z]+(?![^·/])", unit) and top > 0
    power = 3 * int(np.clip(np.floor(np.log10(top) / 3 + 1e-9), -8, 8)) if plain else 0
    number = f"{value / 10.0**power:.12g}".replace("-", "\N{MINUS SIGN}")
    return f"{number} {EngFormatter.ENG_PREFIXES[power]}{unit}" if value else "0"


def _vibration(ax: Any, s: Signals, name: str, drawn: np.ndarray, shown_as: str) -> None:
    y = s.outputs[name]
    fast = vibration(y, s.fs) if s.fs > 2 * CUTOFF else y
    half = max(1, round(CLOSEUP * s.fs / 2))
    inner = _inner(y, s.fs)
    at = (inner.start or 0) + int(np.abs(fast[inner]).argmax())
    part = slice(max(0, at - half), at + half)
    curve(ax, np.arange(y.size)[part] / s.fs, drawn[part], color=OUTPUT)
    _axes(ax, shown_as, s.unit(name))
    ax.set(xlabel="time / s", title="vibration, where it is largest", xmargin=0)


def _over_position(
    ax: Any,
    s: Signals,
    y: np.ndarray,
    name: str,
    unit: str,
    source: str,
    within: tuple[float, float],
) -> None:
    x, by_itself = s.inputs[source], y is not s.outputs.get(name)
    back = round(0.01 * s.fs) + 1  # 10 ms: the codes of an encoder go to and fro
    inward = x > np.r_[np.full(min(back, x.size), x[0]), x[:-back]]
    inside = (x >= within[0]) & (x <= within[1])
    at = np.flatnonzero(inside)
    # with the sample behind each pass, which is not drawn and parts it from the next
    some = np.union1d(at[extremes(y[at], at.size // 3000)], np.flatnonzero(np.diff(inside)) + 1)
    for mask, label, style in (
        (~inward, "back, or held", {"lw": 3, "color": "0.75", "zorder": 3 if by_itself else 1}),
        (inward, "forwards", {"lw": 0.8, "color": OUTPUT}),
    ):
        # the wider one below shows on both sides
        ax.plot(x[some], np.where(mask & inside, y, np.nan)[some], **style, label=label)
    place = "position, " * (s.unit(source) in PLACES)
    part = ", a tenth of it" * (not inside.all())
    _axes(ax, name, unit, over=s.unit(source))
    ax.set(xlabel=shown(source), title=shown(f"over {place}{source}{part}"))
    if part:
        ax.set_xlim(within)
    _legend(ax)


def _legend(ax: Any) -> None:
    """Draw a legend between panel and title, where it covers no curve."""
    ax.legend(
        loc="lower center",
        bbox_to_anchor=(0.5, 0.98),
        ncols=3,
        frameon=False,
        fontsize="small",
        columnspacing=1,
    )
    ax.set_title(ax.get_title(), pad=20)


def _density(ax: Any, s: Signals, name: str) -> None:
    from scipy.signal import welch

    y = s.outputs[name]
    with np.errstate(over="ignore", invalid="ignore"):  # squares of huge numbers are not drawn
        f, S = welch(y, s.fs, nperseg=min(4096, y.size), detrend="linear")
    S = np.maximum(S[1:], 1e-30)
    ax.loglog(f[1:], S, lw=0.9, color=OUTPUT)
    _spectral(ax, s.unit(name), f"spectrum of {name}")
    if S.size and np.isfinite(S).all():
        ax.set_ylim(bottom=max(0.3 * S.min(), FLOOR * S.max()))


def against(ax: Any, a: Against) -> None:
    """Draw a spectrum with its reference law and the band of correct renderings.

    The legend names the band if it is visible.
    """
    bands = a.f.size < 100
    bottom = max(1e-30, FLOOR * a.law.max(), 0.3 * min(a.low.min(), a.measured.min()))
    decades = np.log10(np.maximum([a.low, a.high, a.measured], bottom))
    # wider than the lines, at some frequencies
    seen = (decades[1] - decades[0] > 0.03 * np.ptp(decades)).mean() > 0.02
    ax.fill_between(
        a.f, np.maximum(a.low, 1e-30), a.high, color="0.85", label="correct" if seen else None
    )
    ax.loglog(
        a.f,
        a.measured,
        **({"ls": "", "marker": "o", "ms": 3} if bands else {"lw": 3, "alpha": 0.4}),
        color=INPUT,
        label="rendered",
    )
    ax.loglog(a.f, a.law, "--", color=LAW, lw=0.8, label="law")  # thin, on the wide one
    _spectral(ax, a.unit, a.title)
    ax.set_ylim(bottom=bottom)
    _legend(ax)


def _spectral(ax: Any, unit: str, title: str) -> None:
    square = "1" if unit == "1" else f"{unit}²" if unit.isalpha() else f"({unit})²"
    ax.set(xlabel="frequency / Hz", ylabel=f"PSD / {square}/Hz", title=shown(title))
    ax.grid(alpha=0.3)
