"""The description of a scene for a page: ranges, full scales and what is drawn."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from ..analysis.overview import vibrates
from ..blocks.cursors import Cursor, CursorFrames
from ..blocks.tables import CubicGrid
from ..core.graph import reach
from ..core.program import rate
from ..core.scene import Scene
from ..errors import BadValue, need
from ..motion.generators import sinusoid
from ..run.rendering import Rendering, render
from ..scenes import ROWS
from ..scenes.about import about

Range = tuple[float, float]
UNITS: dict[str, Range] = {"m": (0.0, 0.1), "N": (0.0, 2.0), "m/s": (-0.5, 0.5)}
"""Ranges of inputs by unit; 0 to 1 for other units."""
FASTEST = 768000.0  # Hz, of a page: the highest rate for which Chromium makes an AudioContext
MAP = 128
"""Largest number of columns and rows of a surface sent to a page."""


def ranges_of(scene: Scene, given: Mapping[str, Range] | None = None) -> dict[str, Range]:
    """Return a range for every input (for the pointer) and every parameter.

    Parameters
    ----------
    scene : Scene
    given : mapping of str to (low, high), optional
        In the units of the scene; they override the ranges suggested by law, unit or
        value.

    Raises
    ------
    UnknownName
        A name that is neither an input nor a parameter.
    BadValue
        A range that is invalid, or does not contain the parameter's value.

    Examples
    --------
    >>> from stimlib.live.describe import ranges_of
    >>> from stimlib.scenes import bumps
    >>> ranges_of(bumps(), {"A": (0, 7.5)})
    {'x': (0.0, 0.1), 'A': (0.0, 7.5), 'duty': (0.05, 1.0), 'freq': (0.0, 395.0)}
    """
    given = dict(given or {})
    need("range", given, [*scene.inputs, *scene.params], "input or parameter")
    for name, (low, high) in given.items():
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise BadValue(f"range of {name}: {low:g} to {high:g} must be finite and rise")
    known: dict[str, Range] = {}
    for part in scene.parts:
        if part.law in ROWS:
            known |= {part.inputs.get(n, n): r for n, r in ROWS[part.law].ranges.items()}
    found: dict[str, Range] = {
        name: UNITS.get(str(b.dim), (0.0, 1.0)) for name, b in scene.inputs.items()
    }
    if surface := _surface(scene):
        found |= {"x": (0.0, surface["width"]), "y": (0.0, surface["height"])}
    found |= {name: _around(b.value, str(b.dim)) for name, b in scene.params.items()}
    found |= {n: r for n, r in known.items() if n in found} | {
        n: (float(a), float(b)) for n, (a, b) in given.items()
    }
    for name, p in scene.params.items():
        low, high = found[name]
        if name in given and not low <= p.value <= high:
            raise BadValue(
                f"range of {name}: {low:g} to {high:g} does not hold its value {p.value:g}"
            )
        found[name] = min(low, p.value), max(high, p.value)
    return found


def _around(value: float, unit: str) -> Range:
    """Return a range for a slider around a parameter's value."""
    if value == 0 or (unit == "1" and 0 < value <= 1):
        return 0.0, 1.0
    return (0.0, 2.5 * value) if value > 0 else (2.5 * value, 0.0)


def page_rate(fs: float) -> float:
    """Return a sample rate; raise BadValue if it is above that of any AudioContext.

    A page presents nothing faster, and the second of samples that sets the full scales
    would fill the memory.

    Examples
    --------
    >>> from stimlib.live.describe import page_rate
    >>> page_rate(8000)
    8000.0
    """
    if rate(fs) > FASTEST:
        raise BadValue(
            f"fs = {fs:g} Hz is faster than a page can present; give at most {FASTEST:g} Hz, the"
            " highest sample rate of a browser's audio"
        )
    return float(fs)


def full_scales(scene: Scene, fs: float, ranges: Mapping[str, Range]) -> dict[str, float]:
    """Return default full scales for the outputs of a scene.

    Each is at least twice the output's peak during one second in which every input
    sweeps its range.

    Parameters
    ----------
    scene : Scene
    fs : float
        Hz.
    ranges : mapping
        ``ranges_of(scene)``.

    Returns
    -------
    dict of str to float
        Rounded up to 1, 2 or 5 times a power of ten; 1 for an output that is 0 or not
        finite.

    Raises
    ------
    BadValue
        A sample rate of more than 768 kHz; see ``page_rate``.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.live.describe import full_scales
    >>> scene = stimlib.Scene(
    ...     {"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> full_scales(scene, 8000.0, {"x": (0.0, 0.01)})
    {'force': 50.0}
    """
    made = _swept(scene, page_rate(fs), tuple(ranges[name] for name in scene.inputs))
    return {name: _round_up(2 * float(np.abs(made[name]).max())) for name in scene.outputs}


@lru_cache(1)
def _swept(scene: Scene, fs: float, ranges: tuple[Range, ...]) -> Rendering:
    """Return one second of a scene in which every input sweeps its range."""
    motion: dict[str, Any] = {
        name: np.ones(round(fs))
        if name == "contact"
        else sinusoid((high - low) / 2, 1.0, (high + low) / 2, -math.pi / 2)
        for name, (low, high) in zip(scene.inputs, ranges, strict=True)
    }
    with warnings.catch_warnings():
        # that a sweep of a whole pad is faster than a hand
        warnings.simplefilter("ignore", RuntimeWarning)
        return render(scene, motion, fs=fs, seconds=1.0)


def _round_up(v: float) -> float:
    if not (math.isfinite(v) and v > 0):
        return 1.0
    ten = 10.0 ** math.floor(math.log10(v))
    return next(k * ten for k in (1.0, 2.0, 5.0, 10.0, 20.0) if k * ten >= v)


def description(
    scene: Scene,
    ranges: Mapping[str, Range],
    full: Mapping[str, float],
    given: Mapping[str, Any],
    fs: float = 8000.0,
) -> dict[str, Any]:
    """Return the scene's fields of the first message to a page.

    The fields are inputs, params, outputs, view and about; see ``protocol``.

    Parameters
    ----------
    scene : Scene
    ranges, full : mapping
        Results of ``ranges_of`` and ``full_scales``.
    given : mapping
        Inputs for which the caller gave a generator or recording.
    fs : float
        Sample rate in Hz, at which an output vibrates or does not.

    Examples
    --------
    >>> from stimlib.live.describe import description, ranges_of
    >>> from stimlib.scenes import wall
    >>> description(wall(), ranges_of(wall()), {"force": 50.0}, {})["outputs"]
    [{'name': 'force', 'unit': 'N', 'full': 50.0, 'vibrates': False}]
    """
    said = about(scene)
    meanings = said.pop("meanings")
    made = _swept(scene, page_rate(fs), tuple(ranges[name] for name in scene.inputs))
    found: dict[str, Any] = {"inputs": [], "params": [], "outputs": [], "about": said}
    for name, b in scene.inputs.items():
        low, high = ranges[name]
        found["inputs"].append(
            {"name": name, "unit": "rad" if b.unit == "rad" else f"{b.dim}"}
            | {"low": low, "high": high, "given": name in given}
        )
    for name, p in scene.params.items():
        low, high = ranges[name]
        found["params"].append(
            {"name": name, "unit": str(p.dim), "value": p.value, "low": low, "high": high}
            | {"meaning": meanings.get(name, "")}
        )
    for name, out in scene.outputs.items():
        found["outputs"].append({"name": name, "unit": str(out.dim), "full": full[name]})
        found["outputs"][-1]["vibrates"] = vibrates(made[name], fs)
    return found | {"view": view_of(scene)}


def view_of(scene: Scene, params: Mapping[str, float] | None = None) -> dict[str, Any] | None:
    """Return what a page draws of a scene, or None if it has no picture.

    A soft object is found by its map; for other scenes, the row of a shipped scene
    says it (`stimlib.scenes.shipped.shipped`).

    Parameters
    ----------
    scene : Scene
    params : dict of str to float, optional
        Parameters that differ from the scene's.

    Returns
    -------
    dict or None
        See ``view`` of `stimlib.live.protocol`; lengths in m.

    Examples
    --------
    >>> from stimlib.live.describe import view_of
    >>> from stimlib.scenes import bumps, viscoelastic, wall
    >>> view_of(viscoelastic())
    {'kind': 'plate', 'length': 0.04, 'values': ['y']}
    >>> view_of(bumps(bumps=2), {"duty": 0.25})["hidden"]
    [[0.0, 0.0125], [0.05, 0.0625]]
    >>> view_of(wall()) is None
    True
    """
    if surface := _surface(scene):
        return surface
    start = {name: p.value for name, p in scene.params.items()} | dict(params or {})
    for part in scene.parts:
        if part.law in ROWS and part.given is not None and (view := ROWS[part.law].view):
            names = part.inputs
            made = view({n: start.get(names.get(n, n), v) for n, v in part.given.items()})
            return made | {"values": [names.get(n, n) for n in made["values"]]}
    return None


def _surface(scene: Scene) -> dict[str, Any] | None:
    """Return the parts of a soft object that a page draws: its map and its avatars."""
    maps = [
        b for b in reach(scene.outputs.values()) if isinstance(b, (CubicGrid, Cursor, CursorFrames))
    ]
    outputs, inputs = scene.outputs, scene.inputs
    if (
        not maps
        or not {"x", "y"} <= inputs.keys()
        or not (numbers := [k for k in ("", *"123") if {f"x{k}", f"y{k}"} <= outputs.keys()])
    ):
        return None
    b: Any = maps[0]
    if isinstance(b, CubicGrid):
        levels, (width, height) = (
            b.table.T,
            (float(v) for v in b.spacing * (np.array(b.table.shape) - 1)),
        )
    else:
        levels, width, height = b.levels, b.width, b.height
    rows, columns = (np.linspace(0, n - 1, min(n, MAP)).round().astype(int) for n in levels.shape)
    return {
        "kind": "surface",
        "width": width,
        "height": height,
        "columns": len(columns),
        "rows": len(rows),
        "levels": levels[np.ix_(rows, columns)].round(4).ravel().tolist(),
        "inputs": {"x": "x", "y": "y", "press": "press" if "press" in inputs else None},
        "avatars": [
            {"x": f"x{k}", "y": f"y{k}", "depth": d if (d := f"depth{k}") in outputs else None}
            for k in numbers
        ],
        "values": [n for k in numbers for n in (f"x{k}", f"y{k}", f"depth{k}") if n in outputs],
        "force": "force" if "force" in outputs else None,
    }
