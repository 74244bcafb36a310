"""Checks of the arguments of a processor: seeds and arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import BadValue, counted
from ..system.limits import limits


def key(seed: Any) -> int:
    """Return the noise key of a run, its seed; raise BadValue if that is invalid."""
    if not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**64:
        raise BadValue(f"seed = {seed!r} must be a whole number from 0 to 2**64 - 1")
    return int(seed)


def length(values: Any) -> int | None:
    """Return the length of a sequence, or None for anything else."""
    try:  # len of a table counts its names, and a set has no order
        return None if isinstance(values, Mapping | set) else len(values)
    except TypeError:
        return None


def columns(n: Any, inputs: tuple[str, ...]) -> np.ndarray:
    """Return an empty motion of n samples, shape (0, n), for a scene without inputs."""
    if inputs:
        explain("x", n, inputs, (len(inputs), None))
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 0:
        wanted = "a number of samples, or an array of shape (0, n)"
        raise BadValue(f"process: x = {n!r:.80} must be {wanted}; this scene has no inputs")
    limits.check("render_bytes", 8 * int(n), f"process: bytes of {counted(int(n), 'sample')}")
    return np.empty((0, int(n)))


def explain(name: str, a: Any, rows: tuple[str, ...], *shapes: tuple[int | None, ...]) -> None:
    """Raise BadValue with the reason unless ``process`` accepts an array."""
    texts = [str(shape).replace("None", "n").replace(",)", ")") for shape in shapes]
    wanted = f"float64 of shape {' or '.join(texts)}, rows {', '.join(rows) or '(none)'}"
    if not isinstance(a, np.ndarray) or isinstance(a, np.ma.MaskedArray):
        raise BadValue(f"process: {name} must be an array, {wanted}; got {type(a).__name__}")
    if not any(
        a.ndim == len(shape) and all(w in (None, n) for n, w in zip(a.shape, shape, strict=True))
        for shape in shapes
    ):
        raise BadValue(f"process: {name} must be {wanted}; got shape {a.shape}")
    if a.dtype != np.float64:
        raise BadValue(
            f"process: {name} must be {wanted}; got {a.dtype}: convert with {name}.astype(float)"
        )
    if not a.flags.c_contiguous:
        raise BadValue(f"process: {name} must be C-contiguous; use np.ascontiguousarray({name})")
    if not a.flags.aligned:
        raise BadValue(f"process: {name} is not aligned in memory; use {name}.copy()")
    if name == "out" and not a.flags.writeable:
        raise BadValue("process: out is read-only")
