"""Where a sink's motion comes from.

A mapping of input names to arrays is a recording in real time; with functions of time in it, a scripted source.  ``Live``
takes what ``Sink.push`` is given, and ``Signals`` reads the inputs of an audio device.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import BadValue
from ..motion.source import check_names, positions, sources_of


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording: column i is the motion of sample i, whatever the device loses.

    Parameters
    ----------
    x : ndarray of float64, shape (n_inputs, n)
        Rows in the order of the processor's inputs, in their units.  What is not finite is stopped by the guard.
    """

    x: np.ndarray

    def __post_init__(self):
        x = np.ascontiguousarray(self.x, np.float64)
        if x.ndim != 2 or x.shape[1] < 1:
            raise BadValue(f"a recording must have the shape (n_inputs, n) with n > 0, got {np.shape(self.x)}")
        object.__setattr__(self, "x", x)


@dataclass(frozen=True, eq=False)
class Scripted:
    """A source that follows functions of time, computed a little ahead by an ordinary thread.

    Parameters
    ----------
    motion : dict of str to callable or ndarray
        As for ``stimlib.render``; arrays end the session with their last sample.
    """

    motion: Mapping[str, Any]


@dataclass(frozen=True)
class Live:
    """Columns that ``Sink.push`` is given while it plays, such as a tracker's.

    Each column is one sample's motion.  When none is there the last is held; a tracker slower than the sample rate may
    push one column per report.

    Parameters
    ----------
    keep : float
        Seconds of columns that may wait; what is older is skipped, so that no delay grows.
    """

    keep: float = 0.05

    def __post_init__(self):
        if not 0 < self.keep <= 1.0:
            raise BadValue(f"Live: keep = {self.keep} s must be above 0, at most 1")


@dataclass(frozen=True)
class Signal:
    """An audio input as a position: scale * sample + offset.

    Parameters
    ----------
    scale : float
        Value, in the input's unit, of a sample of 1.0.
    offset : float
        Value of a sample of 0.
    connect : str, optional
        Port to connect to, such as ``"system:capture_1"``; by default none is.
    """

    scale: float
    offset: float = 0.0
    connect: str | None = None

    def __post_init__(self):
        for name in ("scale", "offset"):
            if not np.isfinite(float(getattr(self, name))):
                raise BadValue(f"Signal: {name} = {getattr(self, name)} must be finite")


@dataclass(frozen=True, eq=False)
class Signals:
    """Motion from the inputs of the device itself, one ``Signal`` for each input of the scene."""

    inputs: Mapping[str, Signal] = field(default_factory=dict)


Source = Recorded | Scripted | Live | Signals


def source_of(motion: Any, inputs: tuple[str, ...]) -> Source | None:
    """The source for a sink's ``motion``, checked against the inputs of its scene.

    Parameters
    ----------
    motion : Recorded, Scripted, Live, Signals, mapping or None
    inputs : tuple of str

    Returns
    -------
    Recorded, Scripted, Live, Signals, or None for a scene without inputs

    Raises
    ------
    BadValue, UnknownName
        A scene with inputs and no motion; inputs missing or surplus; arrays of a wrong shape.

    Examples
    --------
    >>> import numpy as np
    >>> source_of({"x": np.zeros(3)}, ("x",)).x.shape
    (1, 3)
    """
    if not inputs:
        if isinstance(motion, Mapping):
            check_names("motion", motion, inputs, "input")
        return None
    if motion is None:
        raise BadValue(
            f"this scene needs the motion of {', '.join(inputs)}: give motion={{name: array or function of time}}, "
            "Live() or Signals({..})"
        )
    if isinstance(motion, Scripted):
        sources_of(motion.motion, inputs, 1)
    elif isinstance(motion, Recorded):
        if motion.x.shape[0] != len(inputs):
            raise BadValue(f"the recording has {motion.x.shape[0]} rows, the scene has the inputs {', '.join(inputs)}")
    elif isinstance(motion, Signals):
        check_names("motion", motion.inputs, inputs, "input")
    elif isinstance(motion, Mapping):
        sources = sources_of(motion, inputs, 1)
        if any(callable(s) for s in sources.values()):
            return Scripted(motion)
        n = min(len(s) for s in sources.values())
        return Recorded(np.stack([s[:n] for s in sources.values()]))
    elif not isinstance(motion, Live):
        sources_of(motion, inputs, 1)  # which says what it must be
    return motion


def length(source: Source | None) -> int | None:
    """Samples until a source ends, or None."""
    if isinstance(source, Recorded):
        return source.x.shape[1]
    if isinstance(source, Scripted):
        return min((len(s) for s in source.motion.values() if not callable(s)), default=None)
    return None


class Feeder(threading.Thread):
    """Keeps a scripted motion ahead of the samples.

    Parameters
    ----------
    pump : stimlib.devices.pump.Pump
    source : Scripted
    failed : callable
        Called with the exception when a function of the motion raises or is not finite.
    """

    def __init__(self, pump: Any, source: Scripted, failed: Callable[[Exception], None]):
        super().__init__(name="stimlib motion", daemon=True)
        self._pump, self._failed = pump, failed
        self._sources = sources_of(source.motion, pump.proc.inputs, 1)
        self._end = length(source)
        self._over = threading.Event()

    def fill(self) -> None:
        """As many columns as the ring takes now."""
        pump = self._pump
        while not self._over.is_set():
            at = pump.next_motion()
            stop = min(at + 1024, at + pump.motion_room(), *([] if self._end is None else [self._end]))
            if stop <= at:
                return
            pump.put_motion(positions(self._sources, at, stop, pump.proc.fs))

    def run(self) -> None:
        try:
            while not self._over.is_set():
                self.fill()
                time.sleep(0.0005 if self._pump.hurried else 0.01)
        except Exception as e:
            self._failed(e)

    def stop(self) -> None:
        self._over.set()
