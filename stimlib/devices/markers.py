"""Markers: samples at which something happened, sent to other programs.

A marker is stamped with the time at which its sample leaves the device, not with the
time of the call that reports it. To this end, the device's clock is fitted to the
host's clock during playback.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import BadValue, SinkError, counted, shortened

WINDOW, RECENT = 30.0, 1.0
"""Length in s of the window for fitting the device's clock, and of that around a start
at a given time: a server that was late before has moved its clock.
"""

FEW, EARLY = 20, 2e-3
"""With fewer calls than FEW, their spread is not known, and the uncertainty is at least
EARLY seconds.
"""


@dataclass(frozen=True)
class Marker:
    """A marker of a session.

    Attributes
    ----------
    name : str
        Name of the output that rose, or the name given to ``Sink.mark``.
    value : float
        The output's value there, or as given.
    sample : int
    time : float, s
        When the sample leaves the device, on the host's monotonic clock
        (``time.monotonic``); the device's own latency is included as it reports it.
    uncertainty : float, s
        95 % of the device's calls deviated less than this from the fitted clock; at
        least 2 ms during the first 20 calls.
    lost : bool
        Whether the device skipped the sample, so that nobody felt it.
    """

    name: str
    value: float
    sample: int
    time: float
    uncertainty: float
    lost: bool = False


def checked_name(where: str, name: Any) -> str:
    """Return a marker's name, which any sender can send.

    Raises
    ------
    BadValue
        No text, more than 256 characters, or control characters.
    """
    if not isinstance(name, str) or len(name) > 256 or not name.isprintable():
        raise BadValue(
            f"{where} = {shortened(name)} must be a text of at most 256 characters, none of them a"
            " control character"
        )
    return name


class Clock:
    """The device's clock as a line over the host's, fitted to block start times.

    A call can be late but never early, so the line is fitted to the earliest call of
    each second.

    Parameters
    ----------
    fs : float
        Nominal sample rate in Hz.

    Attributes
    ----------
    zero : int
        The frame of sample 0.
    window : float, s
        Earlier blocks are forgotten.

    Examples
    --------
    >>> from stimlib.devices.markers import Clock
    >>> clock = Clock(1000.0)
    >>> for k in range(100):
    ...     clock.add(10 * k, 5_000_000_000 + 10_000_000 * k)
    >>> clock.time(500)
    (5.5, 0.0)
    """

    def __init__(self, fs: float):
        self.fs, self.zero, self.window = fs, 0, WINDOW
        self._pairs: deque[tuple[int, int]] = deque()
        self._line: tuple[float, float, float, int, int] | None = None
        self._lock = threading.Lock()

    def add(self, frame: int, ns: int) -> None:
        """Add the first frame of a block and the time in ns when the block began."""
        with self._lock:
            if not self._pairs or self._pairs[-1][0] != frame:
                self._pairs.append((frame, ns))
                self._line = None
            while frame - self._pairs[0][0] > self.window * self.fs:
                self._pairs.popleft()

    @property
    def begun(self) -> bool:
        """Whether a block has been seen."""
        return bool(self._pairs)

    def time(self, sample: int) -> tuple[float, float]:
        """Return a sample's time in s, and its uncertainty; nan before any block."""
        with self._lock:
            if not self._pairs:
                return float("nan"), float("nan")
            if self._line is None:
                self._line = self._fitted()
            offset, slope, error, at, ns = self._line
        n = sample + self.zero - at
        return (ns + 1e9 * n / self.fs + offset + slope * n) * 1e-9, error * 1e-9

    def _fitted(self) -> tuple[float, float, float, int, int]:
        at, ns = self._pairs[0]
        n = np.array([s - at for s, _ in self._pairs], float)
        late = np.array([t - ns for _, t in self._pairs]) - 1e9 * n / self.fs
        seconds = (n / self.fs).astype(int)
        first = [int(np.argmin(np.where(seconds == s, late, np.inf))) for s in np.unique(seconds)]
        if len(first) < 4:  # too short for a drift
            offset, slope = float(late.min()), 0.0
        else:
            slope, offset = np.polyfit(n[first], late[first], 1).tolist()
        error = float(np.quantile(np.abs(late - offset - slope * n), 0.95))
        if len(n) < FEW:
            error = max(error, 1e9 * EARLY)
        return offset, slope, error, at, ns


def behind(clock: Callable[[], float]) -> float:
    """Return by how many seconds ``time.monotonic`` is ahead of another clock.

    Examples
    --------
    >>> import time
    >>> abs(behind(lambda: time.monotonic() - 5.0) - 5.0) < 1e-3
    True
    """
    readings = [(time.monotonic(), clock(), time.monotonic()) for _ in range(9)]
    before, theirs, after = min(readings, key=lambda r: r[2] - r[0])
    return (before + after) / 2 - theirs


Send = Callable[[Marker], None]


class Markers:
    """The markers of a session, on their way from the device to the senders.

    A separate thread calls the senders, so a slow one does not delay the device.

    Parameters
    ----------
    fs : float
        Hz.
    send : sequence of callable
        Each is called with every ``Marker``, in the order of samples.
    failed : callable
        ``failed(error, what=text)`` is called when one of them raises.
    """

    def __init__(self, fs: float, send: Sequence[Send], failed: Callable[..., None]):
        self.clock, self.lost, self.count = Clock(fs), 0, 0
        self.unsent = 0  # known at the end
        self._sent = 0
        self._send, self._failed = tuple(send), failed
        self._waiting: list[tuple[int, str, float]] = []
        self._gaps: list[tuple[int, int]] = []  # samples that were lost
        self._lock = threading.Lock()
        self._queue: queue.SimpleQueue[Marker | None] = queue.SimpleQueue()
        self.thread = threading.Thread(target=self._run, name="stimlib markers", daemon=True)

    def add(self, sample: int, name: str, value: float) -> None:
        """Add a marker, to be sent as soon as its sample has left the device."""
        with self._lock:
            self._waiting.append((sample, name, value))
            self._waiting.sort(key=lambda m: m[0])

    def gap(self, sample: int, frames: int) -> None:
        """Record a range of samples that the device has skipped."""
        self._gaps = [*self._gaps[-99:], (sample, sample + frames)]

    def due(self, until: int, latency: Callable[[], float]) -> list[Marker]:
        """Send and return the markers of samples before ``until``.

        They wait until the clock has seen a block, which gives them their times.
        """
        with self._lock:
            n = sum(sample < until for sample, _, _ in self._waiting) if self.clock.begun else 0
            ready, self._waiting = self._waiting[:n], self._waiting[n:]
        behind = latency() if ready else 0.0
        told = [
            Marker(name, value, sample, at + behind, uncertainty, lost)
            for sample, name, value in ready
            for at, uncertainty in [self.clock.time(sample)]
            for lost in [any(first <= sample < end for first, end in self._gaps)]
        ]
        for marker in told:
            self._queue.put(marker)
        self.count += len(told)
        self.lost += sum(m.lost for m in told)
        return told

    def end(self, seconds: float) -> None:
        """Wait a limited time until all markers are sent, and count the unsent ones."""
        self._queue.put(None)
        if self.thread.ident is not None:  # it was started
            self.thread.join(seconds)
        self.unsent = self.count - self._sent if self._send else 0
        if self.unsent:
            why = f"{self.unsent} of {counted(self.count, 'marker')} not sent: a sender is too slow"
            self._failed(SinkError(f"{why}, or has failed; the log has all of them"))

    def _run(self) -> None:
        try:
            while (marker := self._queue.get()) is not None:
                for send in self._send:
                    send(marker)
                self._sent += 1
        except BaseException as e:
            self._failed(e, what="a marker could not be sent")
