"""Offline use of a processor: a scene driven by a motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .errors import BadValue, UnknownName
from .processor import Processor, compile
from .scene import Scene

Motion = Mapping[str, Callable[[np.ndarray], np.ndarray] | np.ndarray]
"""Input name to position: a function of time (array of s), or samples at fs."""


def frames_of(proc: Processor, motion: Motion, seconds: float | None) -> int:
    """Number of samples to run: of the given time, else of the shortest recording."""
    missing, surplus = set(proc.inputs) - set(motion), set(motion) - set(proc.inputs)
    if missing or surplus:
        what = "; ".join(
            f"{word} {', '.join(sorted(names))}" for word, names in (("missing", missing), ("not an input:", surplus)) if names
        )
        raise UnknownName(f"motion: {what} (the scene's inputs are {', '.join(proc.inputs) or 'none'})")
    lengths = {}
    for name, m in motion.items():
        if not callable(m):
            if np.ndim(m) != 1 or np.asarray(m).dtype != np.float64:
                raise BadValue(f"motion {name!r}: float64 samples or a function of time are wanted, got {type(m).__name__}")
            lengths[name] = len(m)
    if seconds is None:
        if not lengths:
            raise BadValue("motion given as functions of time goes on for ever: say how many seconds to render")
        return min(lengths.values())
    if not (math.isfinite(seconds) and seconds > 0):
        raise BadValue(f"seconds = {seconds}: a time above 0 is wanted")
    n = round(seconds * proc.fs)
    for name, length in lengths.items():
        if length < n:
            raise BadValue(f"motion {name!r} has {length} samples, {n} are needed for {seconds:g} s at {proc.fs:g} Hz")
    return n


def stream(proc: Processor, motion: Motion, seconds: float | None = None, block: int = 8192) -> Iterator[np.ndarray]:
    """Pull a processor along a motion, block after block, in flat memory.

    Parameters
    ----------
    proc : Processor
    motion : dict of str to callable or ndarray
        For every input a pure function of time (array of s -> array in the input's unit) or float64 samples at fs.
    seconds : float, optional
        Length; by default that of the shortest array.
    block : int
        Samples per block; the samples do not depend on it.

    Yields
    ------
    ndarray, shape (n_outputs, n)
        Valid until the next block.

    Raises
    ------
    BadValue, UnknownName
        Inputs missing or surplus, too short, or endless.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> proc = stimlib.compile(stimlib.Scene({"y": 2 * stimlib.Input("x")}), fs=1000, target="python")
    >>> sum(y.shape[1] for y in stimlib.stream(proc, {"x": np.ones(100)}, block=30))
    100
    """
    n = frames_of(proc, motion, seconds)
    x, y = np.empty((len(proc.inputs), block)), np.empty((len(proc.outputs), block))
    for start in range(0, n, block):
        m = min(block, n - start)
        if m < block:
            x, y = np.empty((len(proc.inputs), m)), np.empty((len(proc.outputs), m))
        for row, name in zip(x, proc.inputs, strict=True):
            source = motion[name]
            row[:] = source(np.arange(start, start + m) / proc.fs) if callable(source) else source[start : start + m]
        yield proc.process(x, y)


@dataclass(frozen=True, eq=False)
class Rendering:
    """What ``render`` gives: the samples and everything needed to make them again."""

    scene: Scene
    fs: float
    seed: int
    params: dict[str, float]
    y: np.ndarray
    """Samples, shape (n_outputs, n), in the outputs' units."""
    outputs: tuple[str, ...]
    fault: tuple[str, int] | None = None
    motion: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.outputs:
            raise UnknownName(f"no output {name!r}; there is {', '.join(self.outputs)}")
        return self.y[self.outputs.index(name)]

    @property
    def t(self) -> np.ndarray:
        """Time of each sample in s."""
        return np.arange(self.y.shape[1]) / self.fs

    def __repr__(self):
        return f"Rendering({', '.join(self.outputs)}: {self.y.shape[1] / self.fs:g} s at {self.fs:g} Hz)"


def render(
    scene: Scene,
    motion: Motion,
    fs: float,
    seconds: float | None = None,
    params: Mapping[str, float] | None = None,
    seed: int = 0,
    target: str = "numba",
) -> Rendering:
    """Drive a scene with a motion and keep the samples.

    Parameters
    ----------
    scene : Scene
    motion : dict of str to callable or ndarray
        See ``stream``.
    fs : float
        Sample rate in Hz.
    seconds : float, optional
        Length; by default that of the shortest array.
    params : dict of str to float, optional
        Live numbers that differ from the scene's, from the first sample on.
    seed : int
        Key of all noise.
    target : {"numba", "python"}

    Returns
    -------
    Rendering

    Raises
    ------
    BadValue, UnknownName
        As ``compile``, ``stream`` and ``Processor.set``.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> scene = stimlib.Scene({"force": stimlib.Param("k", 2000.0, "N/m") * stimlib.Input("x", "m")})
    >>> stimlib.render(scene, {"x": np.array([0.0, 0.01])}, fs=8000, params={"k": 1000.0})["force"]
    array([ 0., 10.])
    """
    proc = compile(scene, fs, target, seed)
    for name, value in (params or {}).items():
        proc.set(name, value, ramp=0.0)
    n = frames_of(proc, motion, seconds)
    y = np.empty((len(proc.outputs), n))
    at = 0
    for part in stream(proc, motion, seconds):
        y[:, at : at + part.shape[1]] = part
        at += part.shape[1]
    return Rendering(scene, proc.fs, seed, dict(proc.params), y, proc.outputs, proc.fault, dict(motion))
