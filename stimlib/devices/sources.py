"""The sources of a sink's motion.

A mapping from input names to arrays plays as a recording in real time; if it contains
functions of time, it is a scripted source.  ``Live`` uses the motion passed to
``Sink.push``, and ``Signals`` reads the inputs of an audio device.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ..errors import BadValue, MotionError, Upto1, counted, public, said_as, shortened
from ..motion.source import check_names, positions, sources_of
from . import words
from .rows import AT_ONCE, MOST, REMEDIES


@public
@dataclass(frozen=True, eq=False)
class Recorded:
    """A recorded motion, whose column i always drives sample i.

    Parameters
    ----------
    x : ndarray of float64, shape (n_inputs, n)
        Rows in the order of the processor's inputs, in their units.  NaN and infinity
        stop the outputs.
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
    """A motion given by functions of time.

    An ordinary thread computes the motion slightly ahead of playback.

    Parameters
    ----------
    motion : dict of str to callable or ndarray
        As for ``stimlib.render``; arrays end the session with their last sample.
    """

    motion: Mapping[str, Any]


@public
@dataclass(frozen=True)
class Live:
    """Motion from ``Sink.push`` during playback, for instance from a tracker.

    Each column is the motion of one sample.  When no column is waiting, the last is
    held, so a tracker slower than the sample rate may push one column per report.

    Parameters
    ----------
    keep : float
        Length, in seconds, of the queue of columns; older ones are skipped, so that the
        delay does not grow.
    """

    keep: Upto1 = 0.05


SILENT = 0.05
"""Seconds without motion after which a source counts as silent."""
# seconds from sample 0 on in which the first row of a stream that stops must come
FIRST = 1.0
NONE = "no motion was received"
NEVER = (  # by ``Live`` and by ``Signals``
    f"{NONE}: nothing was pushed in time: call Sink.push while the session plays",
    f"{NONE}: an input of the device is not connected: connect all, see Signal(connect=..)",
)
Receive = Callable[[float], tuple[Sequence[Any], ...]]
JUMP = 1.0  # s: by more, a sender's clock was set
NUMBERS: Any = (int, float, np.integer, np.floating)
UNLIKE = {IndexError: "too short", KeyError: "no such label", TypeError: "no labels"}


@public
@dataclass(frozen=True, eq=False)
class Stream(Live):
    """Motion that another program or device sends during playback.

    Parameters
    ----------
    keep : float
        See ``Live``.
    receive : callable
        ``receive(timeout)`` waits at most ``timeout`` seconds and returns rows of
        numbers and the sender's time of each in s (nan if it sends none), both empty if
        nothing came: ``lsl_motion``, ``osc_motion``, ``udp_motion``, ``serial_motion``
        or your own function.  It may reconnect by itself.  A function that rejects rows
        returns, as a third, a list of ``(reason, received)`` pairs, one for each: a
        short fixed phrase such as ``"no numbers"``, and the beginning of what came.
    columns : dict of str to int or str
        For each input, the index of its number in a row, from 0; or the label of the
        number, in rows such as ``x:0.01`` or ``{"x": 0.01}``.
    scale : dict of str to float, optional
        Factor of an input where the sender has another unit, such as 1e-3 for mm.
    limits : dict of str to (float, float), optional
        Range of an input, in its unit: a row outside the range is rejected, so that an
        outlier causes no motion.
    silence : {"fade", "hold", "stop"}
        After 50 ms without a row: fade out until there is one again, hold the last
        position, or end the session with an error.  With "stop", the first row may come
        up to 1 s after sample 0.  A session in which no row was taken at all is always
        an error.
    """

    receive: Receive | None = None
    columns: Mapping[str, int | str] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    silence: Literal["fade", "hold", "stop"] = "fade"
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self):
        if not callable(self.receive):
            raise BadValue("Stream: receive must be a function, such as lsl_motion('hand')")
        for name, k in self.columns.items():
            if not isinstance(k, str) and k < 0:
                raise BadValue(
                    f"Stream: columns[{name!r}] = {k!r} must be a whole number from 0, or a label"
                )
        for what, given in (("scale", self.scale), ("limits", self.limits)):
            check_names(f"Stream: {what}", {**self.columns, **given}, tuple(self.columns), "column")
        for name, factor in self.scale.items():
            if not isinstance(factor, NUMBERS) or not 0 < abs(factor) < math.inf:
                raise BadValue(
                    f"Stream: scale[{name!r}] = {factor!r} must be a finite number, not 0"
                )
        for name, (low, high) in self.limits.items():
            if not low < high:
                raise BadValue(f"Stream: limits[{name!r}] = ({low:g}, {high:g}) must rise")


@public
@dataclass(frozen=True)
class Signal:
    """An audio input used as a position, scale * sample + offset.

    Parameters
    ----------
    scale : float
        Value, in the input's unit, of a sample of 1.0.
    offset : float
        Value of a sample of 0.
    connect : str, optional
        Port to connect to, such as ``"system:capture_1"``; none by default.
    """

    scale: float
    offset: float = 0.0
    connect: str | None = None


@public
@dataclass(frozen=True, eq=False)
class Signals:
    """Motion from a device's inputs, with one ``Signal`` for each scene input."""

    inputs: Mapping[str, Signal] = field(default_factory=dict)


Source = Recorded | Scripted | Live | Signals  # a ``Stream`` is a ``Live``


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
                f"the recording has {counted(motion.x.shape[0], 'row')}, the scene has the inputs"
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
    elif isinstance(motion, Stream):
        check_names("motion", motion.columns, inputs, "input")
    elif not isinstance(motion, Live):
        sources_of(motion, inputs, 1)  # which says what it must be
    return motion


def length(source: Source | None) -> int | None:
    """Return the length of a source in samples, or None if it is unlimited."""
    if isinstance(source, Recorded):
        return source.x.shape[1]
    if isinstance(source, Scripted):
        return min((len(s) for s in source.motion.values() if not callable(s)), default=None)
    return None


def columns_of(what: str, given: Any, names: Sequence[str], n: int | None = None) -> np.ndarray:
    """Return the motion that a user gave as a new float64 array of columns.

    Rows of several inputs are given by name, so that none can take another's place.

    Parameters
    ----------
    what : str
        Prefix of error messages, such as "push: ".
    given : dict of str to array_like, or array_like of shape (n_inputs, n)
        Real numbers of any type and layout: a row, or one number, for each input. An
        array is for one input alone, or where no ``what`` names a user's call.
    names : sequence of str
        Names of the inputs, one for each row.
    n : int, optional
        Required number of columns; by default any.

    Raises
    ------
    BadValue
        No real numbers, another shape, or a number that is masked or not finite; an
        array for several inputs.
    UnknownName
        Other names than those of the inputs.

    Examples
    --------
    >>> columns_of("push: ", [[1, 2]], ["x"])
    array([[1., 2.]])
    >>> columns_of("push: ", {"y": 3.0, "x": 1.0}, ["x", "y"])
    array([[1.],
           [3.]])
    """
    x: Any = given
    if isinstance(given, Mapping):
        check_names(what.removesuffix(": "), given, tuple(names), "input")
        x = [given[name] for name in names]
    elif what and len(names) > 1:
        rows = ", ".join(f"{name!r}: .." for name in names)
        raise BadValue(f"{what}the rows of an array have no names; give {{{rows}}}")
    # rows of several lengths; integers that are masked
    with said_as(BadValue, f"{what}x must be numbers", TypeError, ValueError):
        if isinstance(given, Mapping):
            x = [np.atleast_1d(np.ma.filled(row, np.nan)) for row in x]
        x = np.ma.filled(x, np.nan)
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


def none_of(receive: Any, came: Any) -> str:
    """Return what to say of a stream from which no row was taken in time.

    Parameters
    ----------
    receive : callable
        Of the stream; its ``place``, if it has one, is where rows should come.
    came : object
        With ``rows``, ``rejected`` and ``examples``, as a `Receiver` has them.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> why = "outside its limits"
    >>> examples = {why: "[12.7]"}
    >>> came = SimpleNamespace(rows=0, rejected=Counter({why: 193}), examples=examples)
    >>> none_of(None, came)[24:]
    '193 rows came and none was taken: 193 outside its limits (first: [12.7]): ...'
    """
    if not (rejected := (Counter({"too late": came.rows}) + came.rejected).most_common()):
        at = getattr(receive, "place", "the receiver")
        return f"{NONE}: no row came at {at}: is the sender running, and does it send there?"
    first = {why: f" (first: {row})" for why, row in came.examples.copy().items()}
    each = ", ".join(f"{n} {why}{first.get(why, '')}" for why, n in rejected)
    remedies = REMEDIES | {"too late": "start the sender before the session"}
    rows = counted(sum(n for _, n in rejected), "row")
    remedy = remedies.get(rejected[0][0], "see its receive")
    return f"{NONE}: {rows} came and none was taken: {each}: {remedy}"


def positions_of(
    row: Any,
    at: float,
    columns: Sequence[tuple[Any, ...]],
    newest: tuple[float, list[float]] = (-math.inf, []),
) -> tuple[list[float], str | None]:
    """Return the positions of a row, and the reason why it is rejected.

    A column is the key of a number in the row, its scale, and its range.
    """
    if isinstance(row, (str, bytes)):  # whose items are letters
        return [], "no numbers"
    try:
        found = [row[k] for k, *_ in columns]
    except (LookupError, TypeError) as e:  # the row is shorter, or of another kind
        return [], UNLIKE.get(type(e), "no numbers")
    x = [
        float(v) * scale if isinstance(v, NUMBERS) and -1e308 < v < 1e308 else math.nan
        for v, (_, scale, *_) in zip(found, columns, strict=True)
    ]
    wrong = {
        "no numbers": not all(isinstance(v, NUMBERS) and v is not bool(v) for v in found),
        "not finite": not all(map(math.isfinite, x)),
        "outside its limits": not all(
            low <= v <= high for v, (*_, low, high) in zip(x, columns, strict=True)
        ),
        "out of order": 0.0 < newest[0] - at <= JUMP,
        "repeated": (at, x) == newest,
    }
    return x, next(filter(wrong.get, wrong), None)


class Receiver(threading.Thread):
    """A thread that converts the rows of a stream into motion.

    Parameters
    ----------
    pump : stimlib.devices.engine.Pump
    source : Stream
    failed : callable
        ``failed(error, what=text)`` is called when ``receive`` raises, or when a stream
        with ``silence="stop"`` falls silent.
    """

    turns = 0
    rows = 0  # taken
    # the newest row that came before the session, until that runs; then None
    _early: list[Any] | None = None

    def __init__(self, pump: Any, source: Stream, failed: Callable[..., None]):
        super().__init__(name="stimlib stream", daemon=True)
        self._pump, self._source, self._failed = pump, source, failed
        self.rejected: Counter[str] = Counter()  # rows, by the reason
        self.examples: dict[str, str] = {}  # the first of each reason
        self._columns = [
            (
                source.columns[n],
                source.scale.get(n, 1.0),
                *source.limits.get(n, (-np.inf, np.inf)),
            )
            for n in pump.proc.inputs
        ]
        self._newest: tuple[float, list[float]] = (-math.inf, [])  # the sender's time, positions
        self.over = threading.Event()  # set: it ends
        self._late: deque[float] = deque(maxlen=10_000)  # arrival less the sender's time

    @property
    def jitter(self) -> float:
        """Time in s after the earliest, within which 99 % of the rows arrived."""
        late = np.array(self._late)
        return float(np.quantile(late, 0.99) - late.min()) if late.size else 0.0

    def run(self) -> None:
        """Receive rows until the session ends; report an error to the session."""
        heard, patience, self._early = time.monotonic(), FIRST, []
        while not self.over.is_set():
            try:
                self._asked = time.monotonic()
                found = self._source.receive(0.02)  # type: ignore[misc]
                self.turns += 1
                if self._take(*found):
                    heard, patience = time.monotonic(), SILENT
                elif self._pump.state != words.RUNNING:
                    heard = time.monotonic()
                elif self._source.silence == "stop" and time.monotonic() - heard > patience:
                    raise MotionError(
                        f"no motion has come for {1e3 * SILENT:g} ms:"
                        f" {counted(self.rows, 'row')} came before,"
                        f" {self.rejected.total()} rejected"
                        if self.rows
                        else self.missing(False)
                    )
            except BaseException as e:
                self._failed(e, what="the stream failed")
                return

    def missing(self, moved: bool) -> str:
        """Return what to say of a session that has not moved, or an empty text."""
        return "" if moved else none_of(self._source.receive, self)

    def _take(
        self,
        rows: Sequence[Any],
        times: Sequence[float],
        rejected: Sequence[tuple[str, str]] = (),
    ) -> int:
        """Put the valid rows into the ring buffer, and return how many there were."""
        now, taken, refused = time.monotonic(), [], [*rejected]
        for row, at in zip(rows, times, strict=True):
            x, why = positions_of(row, at, self._columns, self._newest)
            if why:
                refused.append((why, shortened(row, 40)))
                continue
            taken.append(x)
            if math.isfinite(at):
                self._newest = at, x
                if self._late and abs(now - at - self._late[-1]) > JUMP:
                    self._late.clear()  # the sender has set its clock
                self._late.append(now - at)
        self.rejected.update(why for why, _ in refused)
        self.examples = {why: came[:40] for why, came in reversed(refused)} | self.examples
        self.rows += len(taken)
        if self._early is not None:  # what has waited at a port is old: its newest row counts
            newest = [*self._early, *taken][-1:]
            waits = self._pump.state == words.IDLE or (
                len(rows) + len(rejected) >= MOST and now - self._asked < AT_ONCE
            )
            self._early, taken = (newest, []) if waits else (None, newest)
        left = np.array(taken, np.float64, order="F").T
        while left.size and not self.over.is_set():  # more than the ring holds: the newest count
            left = np.ascontiguousarray(left[:, self._pump.put_motion(left) :])
            time.sleep(0.001 if left.size else 0.0)
        return len(taken)


class Feeder(threading.Thread):
    """A thread that computes a scripted motion ahead of playback.

    Parameters
    ----------
    pump : stimlib.devices.engine.Pump
    source : Scripted
    failed : callable
        ``failed(error, what="the motion failed")`` is called when a function of the
        motion raises or does not return finite numbers.
    """

    # how often it has looked for room or made rows; while a function does not return
    # they stay the same
    turns = 0

    def __init__(self, pump: Any, source: Scripted, failed: Callable[..., None]):
        super().__init__(name="stimlib motion", daemon=True)
        self._pump, self._failed = pump, failed
        self._sources = sources_of(source.motion, pump.proc.inputs, 1)
        self._end = length(source)
        self._stands, self._last = False, np.zeros((len(self._sources), 1))
        self.over = threading.Event()  # set: it ends

    def fill(self) -> None:
        """Write as many columns as the ring buffer has room for."""
        while not self.over.is_set():
            at = self._pump.next_motion()
            stop = min(
                at + 1024,
                at + self._pump.motion_room(),
                *([] if self._end is None else [self._end]),
            )
            if stop <= at:
                return
            x = np.repeat(self._last, stop - at, axis=1) if self._stands else self.columns(at, stop)
            self._last = x[:, -1:]
            self._pump.put_motion(x)
            self.turns += 1  # here, too: who takes it at once leaves room for ever

    def columns(self, at: int, stop: int) -> np.ndarray:
        """Return the motion of samples at .. stop - 1, shape (n_inputs, stop - at)."""
        return positions(self._sources, at, stop, self._pump.proc.fs)

    def run(self) -> None:
        """Write the motion until it ends; after an error, hold the last position."""
        while not self.over.is_set():
            try:
                self.fill()
            except BaseException as e:  # it stands still while the session fades
                self._stands = True
                self._failed(e, what="the motion failed")
            self.turns += 1
            time.sleep(0.0005 if self._pump.hurried else 0.01)
