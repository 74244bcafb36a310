"""Sources of motion for a scene's inputs: functions of time, or samples."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.graph import bare
from ..core.program import number
from ..errors import BadValue, UnknownName, counted, line_of, outside
from .generators import GENERATORS

if TYPE_CHECKING:
    from ..core.scene import Scene

Array = NDArray[np.float64]
Motion = Mapping[str, Callable[[np.ndarray], np.ndarray] | np.ndarray]
"""Mapping from input names to positions: functions of time (arrays in s), or samples at
fs.
"""

SHORT = 512  # samples, up to which motions of one kind are computed together
FEWEST = 4  # of them

HAND = 1.0
"""The largest speed of a human hand in m/s."""


class Sources(dict[str, Any]):
    """Checked sources of motion by input, in the processor's order."""

    @cached_property
    def groups(self) -> list[tuple[list[int], Any]]:
        """Places of generators of one kind, and one generator with all their numbers.

        Each of its fields of floats is a column. Its positions have the bits of theirs,
        as each operation is done element by element.
        """
        kinds: dict[Any, list[int]] = {}
        sources = list(self.values())
        for k in {id(source): k for k, source in reversed([*enumerate(sources)])}.values():
            source = sources[k]
            if type(source) in GENERATORS.values() and not hasattr(source, "motion"):
                facts = [(f.name, getattr(source, f.name)) for f in fields(source)]
                key = tuple((n, type(v) if isinstance(v, float) else v) for n, v in facts)
                kinds.setdefault((type(source), key), []).append(k)
        found = []
        for (_, key), places in kinds.items():
            if len(places) >= FEWEST:
                one = copy.copy(sources[places[0]])
                for name in (name for name, v in key if v is float):
                    column = np.array([[getattr(sources[k], name)] for k in places])
                    object.__setattr__(one, name, column)
                found.append((places, one))
        return found


def warn_fast(sources: Mapping[str, Any], scene: Scene, seconds: float, fs: float = 0.0) -> None:
    """Warn if a motion is faster than a human hand, or beyond the travel of a device.

    The first 100 s of generators and arrays in metres are checked every 10 ms, arrays
    only if ``fs`` is given; recordings have their own ``max_speed``.  The travel is the
    argument of that name of the scene ``squeeze``; for it, recordings and other
    functions of time are checked, too.
    """
    inputs = scene.inputs  # a walk of the whole graph, so once
    travel = {
        name: float((part.given or {})["travel"])
        for part in scene.parts
        if part.law == "squeeze" and (part.given or {}).get("travel")
        for name in part.inputs.values() or inputs
    }
    t = np.arange(0.0, min(seconds, 100.0), 0.01)
    for name, source in sources.items():
        if str(inputs[name].dim) != "m":
            continue
        if type(source) in GENERATORS.values():
            with np.errstate(all="ignore"):
                x, every = source(t), 0.01
            remedy = f"check that the lengths of {type(source).__name__} are in m"
        elif isinstance(source, np.ndarray) and fs:
            step = max(1, round(0.01 * fs))
            x, every = source[: round(min(seconds, 100.0) * fs) : step], step / fs
            remedy = (
                f"its array is taken as sampled at fs = {fs:g} Hz; if it was recorded at another"
                f" rate, say 500 Hz, give stimlib.motion.recorded.recording({{'t_s': t, '{name}':"
                f" x}}, {{'{name}': '{name}'}}).motion_for(scene.inputs), and check that it is in m"
            )
        elif callable(source) and name in travel:
            try:
                x, every, remedy = positions({name: source}, 0, t.size, 100.0)[0], np.inf, ""
            except BadValue:
                continue  # the rendering raises it, with its own sample
        else:
            continue
        with np.errstate(all="ignore"):
            reach = float(np.ptp(x)) if x.size else 0.0
            speed = float(np.abs(np.diff(x)).max(initial=0.0) / every)
        if reach > travel.get(name, np.inf):
            text = f"{name} moves by {reach:.4g} m, beyond the travel of {travel[name]:g} m; give a"
            text += " shorter motion, or travel= of your device"
            warnings.warn(text, RuntimeWarning, stacklevel=outside())
        if speed > HAND:
            text = f"{name} moves at {speed:.4g} m/s, faster than a hand ({HAND:g} m/s): {remedy}"
            warnings.warn(text, RuntimeWarning, stacklevel=outside())
            return


def check_names(what: str, given: Mapping[str, Any], expected: tuple[str, ...], kind: str) -> None:
    """Raise UnknownName unless two collections of names agree.

    The error lists the wrong names and the expected ones.
    """
    wrong = [f"{n} is missing" for n in expected if n not in given]
    wrong += [f"there is no {kind} {n}" for n in given if n not in expected]
    if wrong:
        raise UnknownName(
            f"{what}: {', '.join(wrong)}; the {kind}s are: {', '.join(expected) or 'none'}"
        )


def frames_of(seconds: float | None, fs: float) -> int:
    """Return the number of samples in a duration, at least one."""
    frames = number(seconds, "seconds") * fs
    if not isfinite(frames) or round(frames) < 1:
        raise BadValue(
            f"seconds must be finite and at least one sample, got {frames / fs:g} s at fs ="
            f" {fs:g} Hz"
        )
    return round(frames)


def sources_of(
    motion: Mapping[str, Any] | None, inputs: tuple[str, ...], frames: int
) -> dict[str, Any]:
    """Return the source of each input, a function or a float64 array.

    The sources are in the processor's order. None is allowed for a scene without
    inputs.
    """
    motion = {} if motion is None else motion
    if not isinstance(motion, Mapping):
        raise BadValue(
            "motion must map each input name to a function of time or an array, got"
            f" {type(motion).__name__}{_hint(motion)}"
        )
    check_names("motion", motion, inputs, "input")
    sources = Sources()
    for name in inputs:
        source = motion[name]
        if isinstance(source, type):
            raise BadValue(
                f"motion of {name} is the class {source.__name__}: call it, {source.__name__}(..),"
                " for a motion"
            )
        if not callable(source):
            if hint := _hint(source):
                raise BadValue(f"motion of {name} is a {type(source).__name__}{hint}")
            try:
                source = np.asarray(bare(source))
            except (TypeError, ValueError):  # rows of several lengths
                source = np.array("")
            if source.dtype.kind not in "iuf":
                raise BadValue(
                    f"motion of {name} must be a function of time or an array of real numbers, got"
                    f" {source.dtype}"
                )
            source = source.astype(np.float64, copy=False)
            if source.ndim != 1 or len(source) < frames:
                raise BadValue(
                    f"motion of {name}: need one dimension, at least {counted(frames, 'sample')};"
                    f" got {source.shape}{_shaped(source)}"
                )
        sources[name] = source
    return sources


def _hint(given: Any) -> str:
    """Return a hint on how a recording or a table becomes a scene's motion.

    It is for errors about a table that is passed directly.
    """
    if hasattr(given, "motion_for"):
        return ": give rec.motion_for(scene.inputs) of a recording rec"
    if hasattr(given, "columns"):
        return (
            ': first rec = stimlib.motion.recorded.recording(table, {"x": "x_mm*1e-3"}), then'
            " rec.motion_for(scene.inputs)"
        )
    return ""


def _still(given: Array) -> str:
    """Return a hint on how a single number becomes an input's motion."""
    if given.ndim:
        return ""
    return f"; for one that stands still give lambda t: np.full_like(t, {given.item()!r})"


def _shaped(given: Array) -> str:
    """Return a hint on how a 2-D array becomes an input's motion."""
    if given.ndim != 2:
        return _still(given)
    return (
        "; give positions alone, one dimension such as a.ravel() of a column, or with their times"
        " t_s, in s, stimlib.motion.recorded.recording({'t_s': a[0], 'x': a[1]}, {'x':"
        " 'x'}).motion_for(scene.inputs)"
    )


def positions(sources: dict[str, Any], start: int, stop: int, fs: float) -> Array:
    """Return the motion of samples start .. stop - 1, (n_inputs, stop - start)."""
    x = np.empty((len(sources), stop - start))
    t = np.arange(start, stop, dtype=np.float64)
    t /= fs
    first: dict[int, Array] = {}  # what several inputs share is asked for once
    done = _together(sources, t, x)
    for k, (row, (name, source)) in enumerate(zip(x, sources.items(), strict=True)):
        if k in done:
            first[id(source)] = row
            continue
        if id(source) in first:
            row[:] = first[id(source)]
            continue
        first[id(source)] = row
        if callable(source):
            try:
                values = source(t.copy())
                if type(values) is not np.ndarray:
                    values = np.ma.filled(values, np.nan)  # a mask would be lost
            except (TypeError, ValueError) as e:
                if isinstance(e, BadValue):
                    raise
                remedy = (
                    "it gets an array of times, so write it with numpy: np.sin for math.sin,"
                    " np.where for if"
                )
                raise BadValue(
                    f"{line_of(source)}motion of {name}: {type(e).__name__}: {e}; {remedy}"
                ) from e
            if values.shape != t.shape or values.dtype.kind not in "iuf":
                raise BadValue(
                    f"motion of {name} must give one number per time: {t.shape} float64 in, "
                    f"{values.shape} {values.dtype} out{_still(values)}"
                )
            row[:] = values
        else:
            row[:] = source[start:stop]
        if not np.isfinite(row).all():
            at = start + int(np.flatnonzero(~np.isfinite(row))[0])
            raise BadValue(f"motion of {name} is not finite at sample {at} ({at / fs:.6g} s)")
    return x


def _together(sources: dict[str, Any], t: Array, x: Array) -> set[int]:
    """Fill the rows of generators of one kind in a short block; return their places.

    None are returned if a position is not finite, so that the error names its input.
    """
    done: set[int] = set()
    for places, one in sources.groups if isinstance(sources, Sources) and t.size <= SHORT else ():
        with np.errstate(all="ignore"):
            x[places] = one._position(t[None])
        done.update(places)
    return done if np.isfinite(x[list(done)]).all() else set()
