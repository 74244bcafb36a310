"""The sink of a page, which makes blocks in real time and passes them on."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Scene
from ..devices import words
from ..devices.crossfade import Following
from ..devices.sink import CLOSE_WITHIN, Sink
from ..devices.sources import Live, columns_of
from ..errors import line_of
from ..run.safety import Safety

LATE = 0.25
"""Largest delay behind the clock, in s, that is caught up; samples beyond that are
lost, as on a device without samples.
"""
MOST_LOST = 0.5
"""Largest number of seconds lost at once; a process that was stopped for longer
continues from there.
"""


class PageSink(Sink):
    """A sink whose device is a browser page.

    Parameters
    ----------
    scene, safety, **options
        See ``Sink``.
    feed : callable
        ``feed(at, n)`` returns the motion of samples at .. at + n - 1, shape (n_inputs,
        n), as finite real numbers of any type, which are copied.
    counted : Inputs, optional
        What counts the motion that ``feed`` returns: a session in which none came is an
        error. By default that is not known.
    take : callable
        ``take(at, x, y)`` receives each block: motion (float64), and frames as for a
        device, shape (n_outputs, n) of float32. The arrays are overwritten after it
        returns, and its result is ignored.

    Notes
    -----
    Both are called in the sink's own thread and must not block: after 2 s in one of
    them the session ends with a ``SinkError`` and without a fade.  If ``feed`` fails,
    see ``Sink``, it is not called again, and the motion is held while the session fades
    out; ``take`` always receives the fade.  Late blocks, up to 0.25 s of them, are made
    at once, so that scheduling jitter loses no sound; beyond that, samples are lost and
    reported.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.live.sink import PageSink
    >>> scene, peaks = stimlib.Scene({"y": 2 * stimlib.Input("x")}), []
    >>> def take(at, x, y):
    ...     peaks.append(float(y.max()))
    >>> with PageSink(
    ...     scene, 4.0, feed=lambda at, n: np.ones((1, n)), take=take
    ... ) as sink:
    ...     sink.open(8000)
    ...     sink.start(seconds=0.1)
    ...     sink.wait()
    >>> max(peaks)
    0.5
    """

    device = "page"
    leads = False  # a page has no frames before sample 0
    silent_for = 2.0
    gone = "feed or take has not returned for {:g} s: neither may wait."

    def __init__(
        self,
        scene: Scene,
        safety: Safety | float | None = None,
        *,
        feed: Callable[[int, int], NDArray[np.float64]],
        take: Callable[[int, NDArray[np.float64], NDArray[np.float32]], None],
        counted: Any = None,
        **options: Any,
    ):
        motion = Live(1.0) if isinstance(scene, Scene) and scene.inputs else None
        super().__init__(scene, safety, motion=motion, realtime=False, **options)
        self._feed, self._take, self._stands, self._counted = feed, take, False, counted
        self._places = line_of(feed), line_of(take)
        self._x = np.zeros((len(scene.inputs) if motion else 0, 1))
        self._now: Sink = self  # the session that plays; the one before holds its motion
        self._coming: tuple[Following, threading.Event] | None = None
        self.switched: Callable[[Sink, int], None] = lambda made, since: None
        """Called in the sink's thread where another session follows, with it and its
        first sample of the motion; ``feed`` then returns the motion of its inputs.
        """
        self.late = self.busy = 0.0
        """Seconds behind the clock, and part of a block's time that making it took,
        each of late.
        """

    def _open(self) -> None:
        self.block = self.block or max(1, round(0.004 * self.rate))
        self.buffer = self.make_frames()
        self.start_loop(self._loop)

    def _loop(self) -> None:
        period = (self.block or 1) / self.rate
        due = time.perf_counter()
        while self.pump.state != words.CLOSED:
            now = time.perf_counter()
            if now < due:
                time.sleep(due - now)
                continue
            self.late = now - due
            self._switch()
            lost = 0
            if self.late > LATE:
                lost, due = round(min(self.late, MOST_LOST) * self.rate), now
            due += period
            pump = self._now.pump
            state = pump.state  # read once: a start just now has its first block next turn
            if state == words.RUNNING:
                self._make(lost if pump.read("DELIVERED") else 0)
                self.busy += 0.02 * ((time.perf_counter() - now) / period - self.busy)
            elif state != words.IDLE:  # silence
                self._block(np.repeat(self._x, self.block or 1, axis=1), 0)

    def _make(self, lost: int) -> None:
        """Make one block, after ``lost`` samples that are discarded."""
        pump, n = self._now.pump, self.block or 1
        x = np.repeat(self._x, lost + n, axis=1)
        if not self._stands:
            try:
                x = columns_of("", self._feed(pump.index, lost + n), pump.proc.inputs, lost + n)
            except BaseException as e:
                self._stands = True
                self._now._fail(e, what=f"{self._places[0]}feed failed")
        self._x = x[:, -1:].copy()  # `take` may write into what it is given
        if len(x):
            pump.put_motion(x)
        self._block(x, lost)

    def _link(self, made: Following) -> None:
        """Let the thread that makes blocks begin a session, between two blocks."""
        self._coming = made, (taken := threading.Event())
        taken.wait(CLOSE_WITHIN)

    def _switch(self) -> None:
        """Begin the session that is to follow, if there is one."""
        if self._coming is None:
            return
        (made, taken), self._coming = self._coming, None
        old, self._now = self._now, made
        made.link(old.pump.index)
        rows = dict(zip(old.proc.inputs, self._x, strict=True))
        self._x = np.array([rows.get(n, [0.0]) for n in made.proc.inputs]).reshape(-1, 1)
        self.switched(made, old.pump.index)
        taken.set()

    def _block(self, x: NDArray[np.float64], lost: int) -> None:
        """Let the device take a block, after ``lost`` samples, and show what it got."""
        pump = self._now.pump
        begun, fallen = pump.read("DELIVERED"), pump.read("FELL")
        self.pump.block(self.block or 1, lost)
        made = pump.read("DELIVERED") - begun
        first = pump.index - made
        made += pump.read("FELL") - fallen  # after the last sample
        if made:
            try:
                self._take(first, x[:, lost : lost + made], self.buffer[:, :made])
            except BaseException as e:
                self._now._fail(e, what=f"{self._places[1]}take failed")
