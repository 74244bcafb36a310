"""Sources of motion for a live scene: pointers, a sine, a held value, a stream."""

from __future__ import annotations

import math
import threading
import time
import weakref
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..blocks.fir_filters import moving_average
from ..core.graph import Block, Input
from ..core.scene import Scene
from ..devices.sources import NONE, none_of, positions_of
from ..errors import BadValue, need, shortened
from ..motion.generators import sinusoid
from ..motion.recorded import LIFTED
from ..motion.source import positions
from ..run.processor import Processor, compile
from .protocol import FINGERS, POINTERS

Array = NDArray[np.float64]
Row = dict[Any, float]
Reports = dict[int, list[tuple[float, ...]]]
SMOOTH = 8.0
"""Bandwidth in Hz of the smoothing of a pointer, which delays by 40 ms."""
# parts of its length, of three means in turn: of all threes this has the least above
# four times the bandwidth
MEANS = 0.404, 0.335, 0.261
DELAY = 0.025
"""Seconds by which a pointer's motion is delayed, so that the next report has come when
the samples before it are made: 17 ms between two reports at 60 Hz, the way to the
server, and a block.
"""
KEPT = 128  # reports of each finger
WINDOW = 1.0  # s over which two clocks are compared
CHANGE = 0.1
"""Seconds in which an input blends to a new source."""
CATCH_UP = 0.15
"""Seconds in which the motion of a pointer catches up with a report that came too late,
or after a rest.
"""


class Clock:
    """The offset of another clock, from times that arrive late by varying amounts.

    It is the smallest of the last one to two seconds.
    """

    def __init__(self) -> None:
        self._before, self._least, self._until = math.inf, math.inf, -math.inf

    def offset(self, then: float, now: float) -> float:
        """Return now - then of the report that was least late."""
        if now > self._until:
            self._before = self._least if now < self._until + WINDOW else math.inf
            self._least, self._until = math.inf, now + WINDOW
        self._least = min(self._least, now - then)
        return min(self._before, self._least)


def first_sources(
    scene: Scene, ranges: Mapping[str, tuple[float, float]], given: Mapping[str, Any]
) -> dict[str, dict[str, Any]]:
    """Return the initial source of every input.

    Inputs x1, x2, .. share an axis, and inputs that are not positions hold a value.
    """
    found: dict[str, dict[str, Any]] = {}
    axes: dict[str, str] = {}
    for name in scene.inputs:
        low, high = ranges[name]
        unit = str(scene.inputs[name].dim)
        if name in given:
            kind = "given"
        elif name in ("contact", "press"):
            kind = {"contact": "contact", "press": "pressure"}[name]
        elif unit in ("m", "m/s") or name == "angle":
            kind = axes.setdefault(
                name.rstrip("0123456789"), ("u", "v")[len(axes)] if len(axes) < 2 else "value"
            )
        else:
            kind = "value"
        rest = min(max(0.0, low), high) if kind != "value" else (low + high) / 2
        found[name] = {
            "from": kind,
            "finger": 0,
            "low": low,
            "high": high,
            "freq": 1.0,
            "value": rest,
            "channel": 0,
            "scale": 1.0,
        }
    return found


def following(n: int, bandwidth: float = SMOOTH) -> Scene:
    """Return the scene that smooths n inputs: x0, x1, .. to y0, y1, ..

    Three moving averages of 2/(pi bandwidth) seconds in all delay by half of that. What
    is above 4 bandwidth Hz is 50 dB weaker, and a step becomes a curve whose second
    derivative is continuous.
    """
    outputs: dict[str, Block] = {}
    for k in range(n):
        y: Block = Input(f"x{k}")
        for part in MEANS:
            y = moving_average(y, part * 2 / (math.pi * bandwidth), onset="steady")
        outputs[f"y{k}"] = y
    return Scene(outputs)


class Inputs:
    """The motion of a live scene, computed block by block.

    A page reports a pointer 60 to 1000 times a second, in whole pixels.  The motion is
    a straight line from report to report, by their time stamps and ``delay`` later.
    Where a report comes later still, the motion catches up within 0.15 s. Then u, v,
    pressure, value and stream are smoothed (`following`), because a hand does not jump.
    So neither the rate of the reports nor the pixels are felt in the stimulus. Contact
    is not smoothed.  If the scene has an input for contact or pressure, a hovering
    finger moves nothing, and a returning finger begins where it lands.

    One thread calls ``columns``; another may call the other methods at the same time,
    and none of them blocks.

    Like a ``Receiver``, it counts the motion since ``count``: ``rows`` of the stream,
    those ``rejected`` by reason, and what is ``missing``.

    Parameters
    ----------
    scene : Scene
    fs : float
        Hz.
    ranges : mapping of str to (low, high)
        Ranges of the inputs.
    given : mapping of str to callable, optional
        Motions of inputs, as functions of time for ``stimlib.render``; they are the
        initial sources of these inputs.
    bandwidth : float
        Bandwidth of the smoothing in Hz, at most fs/4; it delays by 1/(pi bandwidth).
    delay : float
        Seconds by which the motion of pointers is delayed. 0: a block has the newest
        report, held.
    stream : callable, optional
        Receives rows from another program or device, as for
        ``stimlib.devices.Stream``; a thread calls it from now on.

    Raises
    ------
    UnknownName
        A motion for an input that does not exist.
    BadValue
        A motion that is not a function of time, or a bandwidth above fs/4.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.live.inputs import Inputs
    >>> scene = stimlib.Scene({"y": 2 * stimlib.Input("x", "m")})
    >>> inputs = Inputs(scene, 8000.0, {"x": (0.0, 0.1)}, delay=0.0)
    >>> inputs.sources["x"]["from"]
    'u'
    >>> inputs.move(0, 0.5, 0.0, 0.0, 1, t=1.0)
    >>> inputs.columns(0, 2000)[0, -1].round(6)
    np.float64(0.05)
    """

    def __init__(
        self,
        scene: Scene,
        fs: float,
        ranges: Mapping[str, tuple[float, float]],
        given: Mapping[str, Any] | None = None,
        bandwidth: float = SMOOTH,
        delay: float = DELAY,
        stream: Callable[[float], tuple[Any, ...]] | None = None,
    ):
        need("motion", given or (), scene.inputs, "input")
        for name, motion in (given or {}).items():
            if not callable(motion):
                raise BadValue(
                    f"motion of {name}: a live scene has no end, so give a function of time, not"
                    f" {type(motion).__name__}"
                )
        self.fs, self.bandwidth = fs, bandwidth
        self.fingers = [(0.0, 0.0, 0.0, 0.0)] * FINGERS  # u, v, pressure, on
        self.delay, self._samples = delay, Clock()
        self._moves: deque[tuple[float, float, float]] = deque(maxlen=KEPT)
        self.newest = [0.0, 0.0]  # time stamp of the newest move, and when it came
        self._forget()
        self.row: dict[Any, float] = {}  # the newest of the stream
        self.stream, self.stream_error, self.jitter = stream, "", 0.0
        self.count()
        self.sources: dict[str, dict[str, Any]] = {}
        self.names: list[str] = []
        self._units: dict[str, str] = {}
        self._follow: Processor | None = None
        self.change(scene, ranges, given or {}, self.smoothing(scene))
        if stream is not None:
            threading.Thread(
                target=_listen, args=(weakref.ref(self), stream), name="stimlib stream", daemon=True
            ).start()

    def smoothing(self, scene: Scene) -> Processor | None:
        """Return the filter for the inputs of a scene."""
        n = len(scene.inputs)
        if not 0 < self.bandwidth <= self.fs / 4:
            raise BadValue(
                f"smoothing of pointers: a bandwidth of {self.bandwidth:g} Hz does not fit fs ="
                f" {self.fs:g} Hz; give at most {self.fs / 4:g} Hz"
            )
        return compile(following(n, self.bandwidth), self.fs) if n else None

    def change(
        self,
        scene: Scene,
        ranges: Mapping[str, tuple[float, float]],
        given: Mapping[str, Any],
        follow: Processor | None,
        since: int = 0,
    ) -> None:
        """Become the inputs of another scene, whose session begins at sample ``since``.

        The fingers stay where they are, and inputs of the same name and unit have the
        source that they had. While ``columns`` is called, its thread must call this.
        """
        units = {n: str(b.dim) for n, b in scene.inputs.items()}
        old = {n: s for n, s in self.sources.items() if units.get(n) == self._units[n]}
        if list(units) != self.names:
            self._follow = follow
            # sample of the source's change; None: the next
            self._changed: dict[str, float | None] = dict.fromkeys(units, -math.inf)
            self._last, self._from = np.zeros(len(units)), np.zeros(len(units))
            # of each input's way before it is smoothed: where its target, contact and
            # itself ended, what it has to catch up with since when, its jumps so far
            self._ends: list[tuple[float, float, float] | None] = [None] * len(units)
            self._late: list[list[tuple[int, float]]] = [[] for _ in units]
            self._landed = np.zeros(len(units))
        self.given, self._units, self.names = dict(given), units, list(units)
        self._forces = {n for n, unit in units.items() if LIFTED.get(unit) == "zero"}
        self.sources = first_sources(scene, ranges, self.given) | old
        self._since += since
        self._see_touch()

    def count(self) -> None:
        """Begin to count the motion of a session."""
        self._since = 0
        self._moved, self.rows = set[int](), 0  # fingers; rows that were in range
        self.rejected, self.examples = Counter[str](), dict[str, str]()

    def missing(self, moved: bool = True) -> str:
        """Return what to say if an input awaits a pointer or a stream and none came."""
        sources = list(self.sources.values())
        streams = any(s["from"] == "stream" for s in sources)
        if streams and (self.stream_error or not self.rows):
            return (
                f"the stream has ended: {self.stream_error}"
                if self.stream_error
                else none_of(self.stream, self)
            )
        away = {s["finger"] for s in sources if s["from"] in POINTERS} - self._moved
        # the page counts fingers from 1
        return f"{NONE}: no pointer moved on the page (finger {min(away) + 1})" if away else ""

    def take(
        self, rows: Sequence[Any], times: Sequence[float] = (), rejected: Sequence[Any] = ()
    ) -> None:
        """Keep the newest row of the stream; count rows that are no motion, by reason.

        A number outside of its source's range is counted, too, and limited to it.
        """
        sources, wrong = list(self.sources.values()), [*rejected]
        columns = [
            (s["channel"], s["scale"], s["low"], s["high"])
            for s in sources
            if s["from"] == "stream"
        ]
        for row in rows:
            # numbers with labels are taken in their order
            values = [*row.values()] if isinstance(row, Mapping) and 0 not in row else row
            keys = [*values] if isinstance(values, Mapping) else [*range(len(values))]
            every = [(k, 1.0, -math.inf, math.inf) for k in keys]
            _, why = positions_of(values, math.nan, [*columns, *every])
            if why in (None, "outside its limits"):
                self.row = {k: values[k] for k in keys}
            wrong += [(why, shortened(row, 40))] if why else []
            self.rows += not why
        self.rejected.update(why for why, _ in wrong)
        self.examples = dict(reversed(wrong)) | self.examples

    def _see_touch(self) -> None:
        self.touches = any(s["from"] in ("contact", "pressure") for s in self.sources.values())

    def move(self, finger: int, u: float, v: float, p: float, on: float, t: float = 0.0) -> None:
        """Move a finger, with effect ``delay`` after t, the time in ms on its page."""
        before, now, reports = self.fingers[finger], time.perf_counter(), self._reports[finger]
        if on or not self.touches:
            self._moved.add(finger)
        else:
            u, v = before[:2]
        self.fingers[finger] = (u, v, p if on else 0.0, float(on))
        at = 1e-3 * t + self._page.offset(1e-3 * t, now) if t else now
        last = reports[-1][0]
        # where it was until it landed, left, or began to move; both at once
        held = at if self.touches and on != before[3] else at - CATCH_UP
        rests = [(held - 1e-6, *before)] if held > last else []
        reports.extend([*rests, (max(at, last), *self.fingers[finger])])
        self._moves.append((at, t, now))

    def lift(self) -> None:
        """Lift all fingers at once."""
        self.fingers = [(u, v, 0.0, 0.0) for u, v, _, _ in self.fingers]
        self._forget()

    def _forget(self) -> None:
        """Let fingers be where they are, without how they came there."""
        self._page = Clock()
        self._reports = [deque([(-math.inf, *f)], KEPT) for f in self.fingers]  # time and finger

    def choose(self, name: str, **source: Any) -> None:
        """Choose another source for an input, or change the numbers of its source.

        Raises
        ------
        UnknownName
            No such input.
        BadValue
            A range that does not rise; source ``given`` without a given motion, or
            ``stream`` without a stream.
        """
        need("source", [name], self.names, "input")
        made = self.sources[name] | source
        if made["from"] == "given" and name not in self.given:
            raise BadValue(f"source: nothing was given for {name}: start with --motion '{name}=..'")
        if made["from"] == "stream" and (self.stream is None or self.stream_error):
            raise BadValue(
                f"source: the stream has ended: {self.stream_error}"
                if self.stream_error
                else "source: there is no stream: start with --stream, such as --stream lsl:NAME"
            )
        if not made["low"] < made["high"]:
            raise BadValue(
                f"source of {name}: low = {made['low']:g} must be below high = {made['high']:g}"
            )
        self._changed[name] = None
        self.sources[name] = made
        self._see_touch()

    def columns(self, at: int, n: int) -> Array:
        """Return the motion of samples at .. at + n - 1, shape (n_inputs, n).

        Raises
        ------
        BadValue
            A given motion that is not finite, or ends.
        """
        x = np.empty((len(self.names), n))
        if self._follow is None:
            return x
        sources, t = dict(self.sources), self._times(at, n)
        # read once: what comes meanwhile would reach some inputs of a finger, not all
        fingers = {s["finger"] for s in sources.values()}
        known = self.row, {f: [*self._reports[f]] for f in fingers}
        landed = np.zeros((len(self.names), n))
        for k, source in enumerate(sources.values()):
            x[k], landed[k] = self._way(k, source, t, at, *known)
        followed = self._follow.process(x - landed) + landed
        for k, (name, source) in enumerate(sources.items()):
            if source["from"] != "contact":
                x[k] = followed[k]
            if source["from"] in ("sine", "given"):
                begin, low, high = self._since + at, source["low"], source["high"]
                motion = (
                    self.given[name]
                    if source["from"] == "given"
                    else sinusoid((high - low) / 2, source["freq"], (high + low) / 2, -math.pi / 2)
                )
                x[k] = positions({name: motion}, begin, begin + n, self.fs)[0]
            if source["from"] != "contact":
                self._go_over(k, name, x[k], at)
            self._last[k] = x[k, -1]
        return x

    def _times(self, at: int, n: int) -> Array:
        """Return when the pointers were where samples at - 1 .. at + n - 1 are."""
        if at == 0:  # a session begins
            self._samples = Clock()
            self._late = [[] for _ in self.names]
        t, now = (at + np.arange(-1, n)) / self.fs, time.perf_counter()
        t += self._samples.offset(at / self.fs, now) - self.delay if self.delay else math.inf
        while self._moves and self._moves[0][0] <= t[-1]:
            _, *self.newest = self._moves.popleft()
        return t

    def _way(
        self, k: int, source: Mapping[str, Any], t: Array, at: int, row: Row, fingers: Reports
    ) -> tuple[Array, Array]:
        """Return an input before it is smoothed, and its jumps at landings.

        Without these jumps it goes on where it was, also if what is known now of the
        sample before is not what it had: the rest is caught up with.
        """
        zero = self.touches and self.names[k] in self._forces
        x, on = (np.broadcast_to(v, len(t)) for v in self._held(source, t, zero, row, fingers))
        end, touched, last = self._ends[k] or (x[0], on[0], x[0])
        chosen, length = self._changed[self.names[k]] is None, CATCH_UP * self.fs
        # what the source before had to catch up with is nothing to the new one
        late = self._late[k] = [j for j in self._late[k] if at - j[0] < length and not chosen]
        if end != x[0] and source["from"] in POINTERS[:3] and self.delay and not chosen:
            late.append((at, end - x[0]))
        way, landed = x[1:].copy(), np.full(len(t) - 1, self._landed[k])
        for begin, jump in late:
            part = np.clip((at + 1 - begin + np.arange(len(way))) / length, 0.0, 1.0)
            way += jump * (1 - part) ** 2 * (1 + 2 * part)
        for i in np.flatnonzero(np.diff(on[1:], prepend=touched) > 0):
            before = way[i - 1] if i else last
            way[i:] = x[i + 1 :]
            landed[i:] += way[i] - before
            late.clear()
        self._ends[k], self._landed[k] = (x[-1], on[-1], way[-1]), landed[-1]
        return way, landed

    def _held(
        self, source: Mapping[str, Any], t: Array, zero: bool, row: Row, fingers: Reports
    ) -> tuple[Array | float, Array | float]:
        """Return an input's target, and whether the finger is in contact.

        ``zero``: a lifted finger makes it 0, as it does a force.
        """
        kind, low, high = source["from"], source["low"], source["high"]
        if kind == "stream":
            there = source["channel"] in row
            v = row[source["channel"]] * source["scale"] if there else max(0.0, low)
            return min(max(v, low), high), 1.0
        if kind not in POINTERS and not (zero and kind == "value"):
            return source["value"], 1.0
        reports = fingers[source["finger"]]
        k = len(reports) - 1
        while k > 0 and reports[k][0] > t[0]:
            k -= 1
        times, *place, touched = np.array(reports[k:]).T
        on = touched[np.maximum(0, np.searchsorted(times, t, "right") - 1)]
        if kind == "contact":
            return on, 1.0
        x = source["value"]
        if kind != "value":
            x = low + np.interp(t, times, place[POINTERS.index(kind)]) * (high - low)
        if zero:
            return x * on, 1.0
        return x, on if self.touches and kind != "pressure" else 1.0

    def _go_over(self, k: int, name: str, row: Array, at: int) -> None:
        """Blend linearly from the old source of an input to the new one."""
        since = self._changed[name]
        if since is None:
            since = self._changed[name] = at
            self._from[k] = self._last[k]
        # a new session counts from 0: what was chosen in the last one is what it has
        elif since >= at:
            since = self._changed[name] = -math.inf
        length = CHANGE * self.fs
        if at - since < length:
            w = np.minimum(1.0, (at - since + 1 + np.arange(len(row))) / length)
            row[:] = self._from[k] + w * (row - self._from[k])


def _listen(to: weakref.ref[Inputs], stream: Callable[[float], tuple[Any, ...]]) -> None:
    """Keep the newest row of a stream until it fails or its inputs are gone."""
    while True:
        try:
            found = stream(0.1)
            if (inputs := to()) is not None:
                inputs.take(*found)
        except Exception as e:
            if (inputs := to()) is not None:
                inputs.stream_error = str(e) or type(e).__name__
            return
        if inputs is None:
            return
        del inputs  # while it waits, too
