"""Where a sink's motion comes from.

A mapping of input names to arrays is a recording in real time; with functions of time
in it, a scripted source.  ``Live`` takes what ``Sink.push`` is given, and ``Signals``
reads the inputs of an audio device.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import BadValue, public
from ..motion.source import check_names, positions, sources_of


@public
@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording: column i is the motion of sample i, whatever the device loses.

    Parameters
    ----------
    x : ndarray of float64, shape (n_inputs, n)
        Rows in the order of the processor's inputs, in their units.  What is not finite
        is stopped by the guard.
    """

    x: np.ndarray

    def __post_init__(self):
        x = np.ascontiguousarray(self.x, np.float64)
        if x.ndim != 2 or x.shape[1] < 1:
            raise BadValue(
                f"a recording must have the shape (n_inputs, n) with n > 0, got {np.shape(self.x)}"
            )
        object.__setattr__(self, "x", x)


@public
@dataclass(frozen=True, eq=False)
class Scripted:
    """A source that follows functions of time.

    An ordinary thread computes it a little ahead.

    Parameters
    ----------
    motion : dict of str to callable or ndarray
        As for ``stimlib.render``; arrays end the session with their last sample.
    """

    motion: Mapping[str, Any]


@public
@dataclass(frozen=True)
class Live:
    """Columns that ``Sink.push`` is given while it plays, such as a tracker's.

    Each column is one sample's motion.  When none is there the last is held; a tracker
    slower than the sample rate may push one column per report.

    Parameters
    ----------
    keep : float
        Seconds of columns that may wait; what is older is skipped, so that no delay
        grows.
    """

    keep: float = 0.05

    def __post_init__(self):
        if not 0 < self.keep <= 1.0:
            raise BadValue(f"Live: keep = {self.keep} s must be above 0, at most 1")


@public
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


@public
@dataclass(frozen=True, eq=False)
class Signals:
    """Motion from the device's inputs, one ``Signal`` for each scene input."""

    inputs: Mapping[str, Signal] = field(default_factory=dict)


Source = Recorded | Scripted | Live | Signals


def source_of(motion: Any, inputs: tuple[str, ...]) -> Source | None:
    """Return the source for a sink's ``motion``, checked against the scene's inputs.

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
        A scene with inputs and no motion; inputs missing or surplus; arrays of a wrong
        shape.

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
            f"this scene needs the motion of {', '.join(inputs)}: give motion={{name: array or"
            " function of time}, Live() or Signals({..})"
        )
    if isinstance(motion, Scripted):
        sources_of(motion.motion, inputs, 1)
    elif isinstance(motion, Recorded):
        if motion.x.shape[0] != len(inputs):
            raise BadValue(
                f"the recording has {motion.x.shape[0]} rows, the scene has the inputs"
                f" {', '.join(inputs)}"
            )
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
    """Return the samples until a source ends, or None."""
    if isinstance(source, Recorded):
        return source.x.shape[1]
    if isinstance(source, Scripted):
        return min((len(s) for s in source.motion.values() if not callable(s)), default=None)
    return None


def columns_of(what: str, given: Any, names: Sequence[str], n: int | None = None) -> np.ndarray:
    """Return the columns of a motion that a user gave, as a new array of float64.

    Parameters
    ----------
    what : str
        Begins each error, such as "push: ".
    given : array_like, shape (n_inputs, n)
        Real numbers of any type and layout.
    names : sequence of str
        Of the inputs, one for each row.
    n : int, optional
        Number of columns that there must be; by default any.

    Raises
    ------
    BadValue
        No real numbers, another shape, or a number that is masked or not finite.

    Examples
    --------
    >>> columns_of("push: ", [[1, 2]], ["x"])
    array([[1., 2.]])
    """
    try:
        x = np.ma.filled(given, np.nan)
    except (TypeError, ValueError) as e:  # rows of several lengths; integers that are masked
        raise BadValue(f"{what}x must be numbers ({e})") from None
    shape = f"({len(names)}, {'n' if n is None else n}), rows {', '.join(names) or 'none'}"
    if x.dtype.kind not in "biuf":
        raise BadValue(
            f"{what}x must be numbers of shape {shape}; got {type(given).__name__} of {x.dtype}"
        )
    if x.ndim != 2 or len(x) != len(names) or n not in (None, x.shape[1]):
        raise BadValue(f"{what}x must be of shape {shape}; got {x.shape}")
    x = np.array(x, np.float64, order="C")
    for row, column in np.argwhere(~np.isfinite(x))[:1]:
        value = x[row, column]
        raise BadValue(
            f"{what}{names[row]} is {value} in column {column}: give the last known value instead"
        )
    return x


class Feeder(threading.Thread):
    """Keeps a scripted motion ahead of the samples.

    Parameters
    ----------
    pump : stimlib.devices.engine.Pump
    source : Scripted
    failed : callable
        ``failed(error, what="the motion failed")`` is called when a function of the
        motion raises or gives no finite numbers.
    """

    # how often it has looked for room; while a function does not return they stay the
    # same
    turns = 0

    def __init__(self, pump: Any, source: Scripted, failed: Callable[..., None]):
        super().__init__(name="stimlib motion", daemon=True)
        self._pump, self._failed = pump, failed
        self._sources = sources_of(source.motion, pump.proc.inputs, 1)
        self._end = length(source)
        self._stands, self._last = False, np.zeros((len(self._sources), 1))
        self._over = threading.Event()

    def fill(self) -> None:
        """Write as many columns as the ring takes now."""
        pump = self._pump
        while not self._over.is_set():
            at = pump.next_motion()
            stop = min(
                at + 1024, at + pump.motion_room(), *([] if self._end is None else [self._end])
            )
            if stop <= at:
                return
            x = np.repeat(self._last, stop - at, axis=1) if self._stands else self.columns(at, stop)
            self._last = x[:, -1:]
            pump.put_motion(x)

    def columns(self, at: int, stop: int) -> np.ndarray:
        """Return the motion of samples at .. stop - 1, shape (n_inputs, stop - at)."""
        return positions(self._sources, at, stop, self._pump.proc.fs)

    def run(self) -> None:
        """Fill the motion until the source is over, and keep an error."""
        while not self._over.is_set():
            try:
                self.fill()
            except BaseException as e:  # it stands still while the session fades
                self._stands = True
                self._failed(e, what="the motion failed")
            self.turns += 1
            time.sleep(0.0005 if self._pump.hurried else 0.01)

    def stop(self) -> None:
        """End the thread."""
        self._over.set()
