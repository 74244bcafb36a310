"""Measures of a sweep: figures of a rendering, by name or by your own functions."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..analysis.physical_cues import Cues, cues_of
from ..checks.local import read_only
from ..checks.verification import verify
from ..core.scene import Scene
from ..core.units import unit
from ..errors import BadValue, StimlibError, UnknownName, counted, need, public
from ..motion.source import positions, sources_of
from ..run.rendering import Rendering

Array = np.ndarray
# of the third octaves of a decade, IEC 61260-1
NOMINAL = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)


@dataclass(frozen=True)
class Measure:
    """A measure of a rendering, made by `measure` or from a name."""

    name: str
    units: Mapping[str, str]
    """Unit of each figure, in order."""
    function: Callable[..., Any]
    """Function of a rendering and the result of ``prepare``, which returns one number
    for each figure.
    """
    prepare: Callable[[dict[str, Array], float], Any] | None = None
    """Function of the inputs (name to samples) and fs, called once for each motion, for
    everything that depends on the motion alone.
    """
    version: str | None = None
    """Version stated by the author, in place of the content of the functions."""

    def __call__(self, rendering: Rendering, ready: Any = None) -> list[float]:
        """Return the figures of a rendering, or raise BadValue."""
        try:
            values = self.function(rendering, ready)
            if type(values) is not list or any(type(v) is not float for v in values):
                given = np.ravel(values)
                if given.dtype.kind in "cUS":
                    raise TypeError(f"{given[:3].tolist()} are no real numbers")
                values = [float(v) for v in given]
        except StimlibError as e:
            raise BadValue(f"{self.name}: {e}") from e
        except Exception as e:
            raise BadValue(f"{self.name}: {type(e).__name__}: {e}") from e
        if len(values) != len(self.units):
            raise BadValue(
                f"{self.name} gives {counted(len(values), 'number')}, and has {len(self.units)}:"
                f" {', '.join(self.units)}"
            )
        return values


@public
def measure(
    unit_: str | None = None,
    /,
    *,
    prepare: Callable[[dict[str, Array], float], Any] | None = None,
    version: str | None = None,
    **figures: str,
) -> Callable[[Callable[..., Any]], Measure]:
    """Turn a function of a rendering into a measure for a sweep.

    Parameters
    ----------
    unit_ : str, optional
        Unit of a single figure, which has the function's name.
    prepare : callable, optional
        ``prepare(inputs, fs)``, called once for each motion with its samples by input
        name, shape (n,); its result is the second argument of the function.
    version : str, optional
        A version that identifies the figures in a stored sweep, instead of the content
        of the functions. Give it if a function uses something whose content cannot be
        inspected, and change it after each change.
    **figures : str
        Names and units of several figures; the function then returns a number for each,
        in this order.

    Returns
    -------
    decorator
        A decorator that returns a ``Measure``.

    Raises
    ------
    BadValue, UnitError
        Neither a unit nor figures, or both; or an invalid unit.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.sweep import measure, measured
    >>> @measure("N")
    ... def lowest(rendering):
    ...     return rendering["force"].min()
    >>> @measure(first="s", largest="N")
    ... def onset(rendering):
    ...     force = rendering["force"]
    ...     return rendering.t[np.argmax(force > 1.0)], force.max()
    >>> scene = stimlib.Scene(
    ...     {"force": stimlib.constant(1000.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> run = stimlib.render(scene, {"x": np.array([0.0, 0.001, 0.002])}, fs=1000)
    >>> measured(run, [lowest, onset])
    {'lowest': 0.0, 'first': 0.002, 'largest': 2.0}
    """
    if (unit_ is None) == (not figures):
        raise BadValue(
            'measure: give the unit of the figure, measure("N"), or several by name,'
            ' measure(onset="s", slope="N/s")'
        )

    for text in figures.values() if unit_ is None else [unit_]:
        unit(text)

    def made(function: Callable[..., Any]) -> Measure:
        name = function.__name__
        units = figures if unit_ is None else {name: unit_}
        called = function if prepare else partial(_alone, function)
        return Measure(name, units, called, prepare, version)

    return made


def _alone(function: Callable[[Rendering], Any], rendering: Rendering, _: None) -> Any:
    return function(rendering)


def measures_of(asked: Sequence[str | Measure] | str | Measure, scene: Scene) -> list[Measure]:
    """Return the measures of a scene from names, calls and functions.

    Parameters
    ----------
    asked : str, Measure or sequence of them
        Names, such as ``"rms"`` or ``"band(20, 1000, force1)"``; see `NAMED`.

    Raises
    ------
    UnknownName
        No such measure, or no such output or input.
    BadValue
        An invalid text, a function without units, or a figure that occurs twice.

    Examples
    --------
    >>> from stimlib.scenes import squeeze
    >>> from stimlib.sweep.measures import measures_of
    >>> [
    ...     dict(m.units)
    ...     for m in measures_of(["peak", "band(20, 1000, force1)"], squeeze())
    ... ]
    [{'peak_force1': 'N', 'peak_force2': 'N'}, {'band_20_1000_force1': 'N'}]
    """
    listed = [asked] if isinstance(asked, str | Measure) or callable(asked) else list(asked)
    found = [_measure(one, scene) for one in listed]
    figures = [name for m in found for name in m.units]
    if twice := [name for name in figures if figures.count(name) > 1]:
        raise BadValue(f"measures: the figure {twice[0]} is there twice")
    return found


@public
def measured(
    rendering: Rendering, measures: Sequence[str | Measure] | str | Measure
) -> dict[str, float]:
    """Return the figures of one rendering, as a sweep computes them.

    Parameters
    ----------
    rendering : Rendering
    measures : str, Measure or sequence of them
        As for ``sweep``.

    Returns
    -------
    dict of str to float
        In the units of the measures.

    Raises
    ------
    UnknownName, BadValue
        As ``sweep``.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.motion import sinusoid
    >>> from stimlib.sweep import measured
    >>> scene = stimlib.Scene(
    ...     {"force": stimlib.constant(1000.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> run = stimlib.render(scene, {"x": sinusoid(0.001, 50)}, fs=8000, seconds=1.0)
    >>> {
    ...     name: round(v, 6)
    ...     for name, v in measured(run, ["rms", "peak", "band(20, 100)"]).items()
    ... }
    {'rms_force': 0.707107, 'peak_force': 1.0, 'band_20_100_force': 0.707107}
    """
    found = measures_of(measures, rendering.scene)
    inputs = tuple(rendering.scene.inputs)
    if not (n := rendering.y.shape[1]):
        raise BadValue("measured: the rendering has no sample; give a longer one")
    x = positions(sources_of(rendering.motion, inputs, n), 0, n, rendering.fs)
    values = figures_of(found, rendering, prepared(found, inputs, x, rendering.fs))
    return dict(zip((name for m in found for name in m.units), values, strict=True))


def prepared(found: Sequence[Measure], inputs: Sequence[str], x: Array, fs: float) -> list[Any]:
    """Return the part of each measure that depends on the inputs alone.

    The measures cannot change the samples.
    """
    given = dict(zip(inputs, read_only(x), strict=True)) or {"": np.empty(x.shape[1])}
    return [m.prepare(given, fs) if m.prepare else None for m in found]


def figures_of(found: Sequence[Measure], rendering: Rendering, ready: Sequence[Any]) -> list[float]:
    """Return the figures of all measures.

    A measure cannot change the data of the next one.
    """
    if rendering.y.flags.writeable:  # that of a row of a sweep is not
        rendering = replace(
            rendering, y=read_only(rendering.y), motion=unwritable(rendering.motion)
        )
    return [v for m, r in zip(found, ready, strict=True) for v in m(rendering, r)]


def unwritable(motion: Mapping[str, Any]) -> dict[str, Any]:
    """Return a motion whose arrays cannot be written."""
    return {n: read_only(s) if isinstance(s, np.ndarray) else s for n, s in motion.items()}


def _measure(asked: Any, scene: Scene) -> Measure:
    if isinstance(asked, Measure):
        return asked
    if not isinstance(asked, str):
        name = getattr(asked, "__name__", None) or type(asked).__name__
        raise BadValue(
            f'measures: {name} has no units: write @measure("N") above the function, with the unit'
            " of its figure"
        )
    name, args = _call(asked)
    if name not in NAMED:
        raise UnknownName(
            f"measures: there is no {name!r}; there are {', '.join(NAMED)}, and functions with"
            " @measure"
        )
    try:
        return NAMED[name](scene, *args)
    except TypeError as e:
        raise BadValue(f"measures: {asked!r}: write {EXAMPLES[name]}") from e


def _call(text: str) -> tuple[str, list[float | str]]:
    """Parse a measure's name and its arguments.

    Arguments are numbers or names; nothing is evaluated.
    """
    try:
        match ast.parse(text.strip(), mode="eval").body:
            case ast.Name(name):
                return name, []
            case ast.Call(ast.Name(name), args, []):
                return name, [a.id if isinstance(a, ast.Name) else _number(a) for a in args]
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        pass
    raise BadValue(
        f"measures: {text!r:.80} is no measure: write a name, or a call such as band(20, 1000,"
        " force1)"
    )


def _number(node: ast.expr) -> float:
    value = ast.literal_eval(node)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(value)
    return float(value)


# Those with names ---------------------------------------------------------------------
def _outputs(scene: Scene, names: Sequence[Any], what: str) -> list[str]:
    """Return the named outputs, or all outputs."""
    need(f"measures: {what}", names, scene.outputs, "output")
    return list(names) or list(scene.outputs)


def _of_outputs(
    name: str, f: Callable[[Array, Any], float], scene: Scene, *outputs: Any
) -> Measure:
    """Return the measure that is a function of one output, for some outputs or all."""
    names = _outputs(scene, outputs, name)
    units = {f"{name}_{n}": str(scene.outputs[n].dim) for n in names}
    return Measure(name, units, partial(_of_each, f, names))


def _of_each(
    f: Callable[..., float], names: Sequence[str], rendering: Rendering, ready: Any
) -> list[float]:
    return [f(rendering[n], ready) for n in names]


def _rms(y: Array, _: Any) -> float:
    """Return the root of the mean square, sqrt(mean(y^2))."""
    return math.sqrt(np.add.reduce(np.square(y)) / y.size)  # np.mean, without its checks


def _peak(y: Array, _: Any) -> float:
    """Return the largest magnitude, max |y|."""
    return float(np.abs(y).max())


def band(scene: Scene, low: Any, high: Any, *outputs: Any) -> Measure:
    """Return the measure band, the RMS within a frequency band.

    It is the root of the integral of the PSD from low (Hz) to below high. The PSD is
    that of the whole record without its mean, under a Hann window:
    ``scipy.signal.periodogram(y, fs, "hann")``.  A band above fs/2, or between two
    lines of the spectrum (of a short record), is nan.
    """
    edges = _edges(low, high, "band")
    names = _outputs(scene, outputs, "band")
    units = {f"band_{edges[0]:g}_{edges[1]:g}_{n}": str(scene.outputs[n].dim) for n in names}
    return Measure("band", units, partial(_of_each, _band, names), partial(_bins, (edges,)))


def _band(y: Array, ready: Any) -> float:
    window, (part,), step = ready
    if part.stop <= part.start:
        return math.nan
    return math.sqrt(np.sum(_density(y, window, part)) * step)


def psd(scene: Scene, low: Any = 10.0, high: Any = 1000.0, *outputs: Any) -> Measure:
    """Return the measure psd, the mean PSD in each third octave, in unit^2/Hz.

    The PSD is one-sided, as for ``band``. Centre frequencies 10^(k/10) Hz are from low
    to high (Hz), with the names of IEC 61260-1.  A third octave between two lines of
    the spectrum (of a short record) is nan.
    """
    low, high = _edges(low, high, "psd")
    names = _outputs(scene, outputs, "psd")
    nominal = {k: NOMINAL[k % 10] * 10.0 ** (k // 10) for k in range(-40, 60)}
    thirds = [k for k, f in nominal.items() if low * 0.99 <= f <= high * 1.01]
    if not thirds:
        raise BadValue(
            f"measures: psd: no third octave has its centre from {low:g} to {high:g} Hz; widen"
            f" that, or give band({low:g}, {high:g})"
        )
    units = {
        f"psd_{nominal[k]:g}_{n}": str(scene.outputs[n].dim ** 2 / unit("Hz"))
        for n in names
        for k in thirds
    }
    edges = tuple((10 ** ((k - 0.5) / 10), 10 ** ((k + 0.5) / 10)) for k in thirds)
    return Measure("psd", units, partial(_psd, names), partial(_bins, edges))


def _psd(names: Sequence[str], rendering: Rendering, ready: Any) -> list[float]:
    window, parts, _ = ready
    densities = [_density(rendering[n], window, slice(None)) for n in names]
    return [
        float(np.mean(d[p])) if p.stop > p.start else math.nan for d in densities for p in parts
    ]


def _edges(low: Any, high: Any, what: str) -> tuple[float, float]:
    if isinstance(low, str) or isinstance(high, str) or not 0 <= low <= high:
        raise BadValue(f"measures: {what}: give the band in Hz, lower edge first: {EXAMPLES[what]}")
    return low, high


def _bins(
    edges: Sequence[tuple[float, float]], x: dict[str, Array], fs: float
) -> tuple[Array, list[slice], float]:
    """Return the window, the spectral lines in each band, and the line spacing.

    The window is scaled to give a density; the spacing is in Hz.
    """
    n = next(iter(x.values())).size
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n)
    f = np.fft.rfftfreq(n, 1 / fs)
    parts = [slice(*(int(i) for i in np.searchsorted(f, e))) for e in edges]
    return window / math.sqrt(fs * np.sum(np.square(window))), parts, fs / n


def _density(y: Array, window: Array, part: slice) -> Array:
    """Return the one-sided power spectral density at some lines, in unit^2/Hz."""
    power = np.square(np.abs(np.fft.rfft((y - np.mean(y)) * window)))
    power[1 : None if y.size % 2 else -1] *= 2
    return power[part]


def cues(scene: Scene, *names: Any) -> Measure:
    """Return the measure of physical cues, such as ``cues(x1, force1)``.

    See `stimlib.analysis.cues`.

    By default, displacement and force are the only input in m and the only output in N.
    """
    pair = list(names) or [
        *(n for n, b in scene.inputs.items() if b.dim == unit("m")),
        *(n for n, b in scene.outputs.items() if b.dim == unit("N")),
    ]
    if len(pair) != 2 or pair[0] not in scene.inputs or pair[1] not in scene.outputs:
        raise BadValue(
            "measures: cues: name a displacement and a force, such as cues(x1, force1); inputs:"
            f" {', '.join(scene.inputs)}; outputs: {', '.join(scene.outputs)}"
        )
    x, force = pair
    units = {f"{name}_{force}": CUE_UNITS[name] for name in Cues._fields}
    return Measure("cues", units, partial(_cues, force), partial(_moved, x))


def _moved(x: str, inputs: dict[str, Array], fs: float) -> Any:
    return cues_of(inputs[x], fs)


def _cues(force: str, rendering: Rendering, ready: Any) -> Sequence[float]:
    return ready(rendering[force])


def verified(scene: Scene) -> Measure:
    """Return the measure that is 1 if ``stimlib.verify`` passes, else 0."""
    return Measure("verify", {"verified": "1"}, _verified)


def _verified(rendering: Rendering, _: None) -> float:
    return float(verify(rendering.scene, rendering.motion, rendering).passed)


CUE_UNITS = {
    "frequency": "1/s", "phi": "1", "W": "J", "loss_factor": "1", "eta_as_printed": "1",
    "k_S": "N/m", "k_L": "N/m", "k_I": "N/m", "k_fit": "N/m", "k_peak": "N/m",
    "b_L": "N*s/m", "b_fit": "N*s/m",
    "f_max": "N", "f_mean": "N", "y_max": "m", "y_mean": "m", "v_max": "m/s", "v_mean": "m/s",
}  # fmt: skip
"""Unit of each field of ``stimlib.analysis.Cues``."""

NAMED: dict[str, Callable[..., Measure]] = {
    "rms": partial(_of_outputs, "rms", _rms),
    "peak": partial(_of_outputs, "peak", _peak),
    "band": band,
    "psd": psd,
    "cues": cues,
    "verify": verified,
}
"""Measures by name; ``rms`` applies to all outputs, ``rms(force1)`` to one."""
EXAMPLES = {
    "rms": "rms or rms(force1)",
    "peak": "peak or peak(force1)",
    "band": "band(20, 1000) or band(20, 1000, force1)",
    "psd": "psd, psd(20, 500) or psd(20, 500, force1)",
    "cues": "cues or cues(x1, force1)",
    "verify": "verify",
}
