"""A control loop in Python: read a position, compute samples, write a force."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.scene import Scene
from ..errors import BadValue
from . import words
from .process import account, fifo
from .sink import Sink
from .sources import Live, columns_of

Read = Callable[[], Mapping[str, Any] | ArrayLike | None]
Write = Callable[[NDArray[np.float64]], Any]
MISSES = 100_000


class ControlLoop(Sink):
    """A sink for your own device, which reads, computes and writes in each period.

    Use it for force devices, motor drivers and microcontrollers at about 1 kHz.
    Samples, safety stage, log and replay are the same as for every sink.

    Parameters
    ----------
    scene : Scene
    safety : Safety or float
        Limits, in the outputs' units; nothing beyond ``full_scale`` is written.
    read : callable
        Returns a number, or a row of n samples, in its unit for each input by name, as
        in ``{"x": 0.01, "y": 0.02}``; a list of one number does for one input. Or None
        if there is no new value: the last position is then held,
        and after 50 ms without a value the outputs fade out until one arrives.  A scene
        without inputs needs no ``read``.
    write : callable
        Takes the outputs in their units, shape (n_outputs,), or (n_outputs, block).
    watchdog : float
        If a period takes more than this many seconds beyond its length, for instance
        because ``read`` hangs, another thread writes zeros once, and the session ends.
    spin : float
        Seconds before each deadline that are waited for without sleeping; it lowers the
        lateness and keeps one core busy.
    **options
        See ``Sink``; ``block`` of ``open`` is the number of samples in a period, 1 by
        default.

    Raises
    ------
    BadValue
        Not callable; a watchdog not above 0.

    Notes
    -----
    Deadlines are absolute: a late period does not delay later ones.  A period that is
    late by its whole length loses its samples, which the report and the log list one by
    one. If every period takes longer than its length, most samples are lost, and only
    the report and the log show it.  Python's garbage collector, other threads of the
    program and the system decide how late a period is; write a servo loop that must
    never be late in C.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.devices import ControlLoop
    >>> spring = stimlib.Scene(
    ...     {"force": stimlib.constant(100.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> written = []
    >>> with ControlLoop(
    ...     spring, 5.0, read=lambda: [0.01], write=written.append, realtime=False
    ... ) as loop:
    ...     loop.open(rate=1000)
    ...     loop.start(seconds=0.3)
    ...     loop.wait()
    >>> bool(abs(max(written)[0] - 1.0) < 1e-6), written[-1]  # N, and at the end none
    (True, array([0.]))
    """

    device = "control loop"
    leads = False

    def __init__(
        self,
        scene: Any,
        safety: Any = None,
        read: Read | None = None,
        write: Write | None = None,
        *,
        watchdog: float = 0.1,
        spin: float = 0.0,
        **options: Any,
    ):
        reads = isinstance(scene, Scene) and scene.inputs
        if not callable(write) or (reads and not callable(read)):
            raise BadValue("ControlLoop: read and write must be functions")
        times = isinstance(watchdog, int | float) and isinstance(spin, int | float)
        if not (times and 0 < watchdog <= 10 and 0 <= spin <= 0.01):
            raise BadValue(
                f"ControlLoop: watchdog = {watchdog!r} s must be above 0, at most 10, and spin ="
                f" {spin!r} s from 0 to 0.01"
            )
        super().__init__(scene, safety, motion=Live() if reads else None, **options)
        self._read, self._write = read, write
        self._watchdog, self._spin = watchdog, spin
        self.misses: deque[tuple[int, int]] = deque(maxlen=MISSES)
        """First sample and number of each stretch that was lost; a session that follows
        counts its own samples.
        """
        self._late = np.zeros(2000, np.int64)  # periods by lateness, in steps of 10 us

    def lateness(self, *percent: float) -> list[float]:
        """Return percentiles, in s, of the lateness of periods, at most 10 us too high.

        Parameters
        ----------
        *percent : float
            0 to 100.

        Examples
        --------
        ``loop.lateness(50, 99, 99.9)``
        """
        counts = np.cumsum(self._late)
        if not counts[-1]:
            return [0.0 for _ in percent]
        wanted = np.array(percent) / 100 * counts[-1]
        return [1e-5 * (k + 1) for k in np.searchsorted(counts, np.maximum(wanted, 1)).tolist()]

    def _open(self) -> None:
        self.block = self.block or 1
        self.silent_for = self._watchdog + self.block / self.rate
        self._frames = self.make_frames()
        scales = self.safety.scales(self.proc.outputs)
        self._scales = np.array([[scales[i] if i >= 0 else 0.0] for i in self.map])
        self.start_loop(self._loop)

    def _loop(self) -> None:
        if self.realtime and not fifo():
            self._refused.append("real-time priority (ulimit -r)")
        n = self.block or 1
        period, start, k = 1e9 * n / self.rate, time.monotonic_ns(), 0
        while not self.closing and not self._hangs:
            k += 1
            due = start + int(k * period)
            if (early := due - time.monotonic_ns()) > 1e9 * self._spin:
                time.sleep(1e-9 * early - self._spin)
            while (late := time.monotonic_ns() - due) < 0:
                pass
            lost = int(late / period)
            k += lost
            self._late[min(late // 10_000, self._late.size - 1)] += 1
            self._period(n, lost)
        self._put(np.zeros_like(self._frames))

    def _period(self, n: int, lost: int) -> None:
        """Read the inputs, compute one block and write it."""
        pump = self.newest.pump
        if pump.state == words.RUNNING and self._read is not None:
            try:
                if (x := self._read()) is not None:
                    if not isinstance(x, Mapping) and np.ndim(x) == 1:
                        x = np.asarray(x)[:, None]
                    pump.put_motion(columns_of("read: ", x, pump.proc.inputs))
            except BaseException as e:
                self.newest._fail(e, what="read failed")
                self._read = None
        at, before = pump.index, pump.read("LOST")
        self.pump.block(n, lost * n)
        if gone := pump.read("LOST") - before:
            self.misses.append((at, gone))
        if not self._hangs:
            self._put(self._frames)

    def _put(self, frames: NDArray[np.float32]) -> None:
        y = frames * self._scales
        try:
            self._write(y[:, 0] if self.block == 1 else y)
        except BaseException as e:
            if not self._device_gone:
                self.device_lost(f"write failed: {account(e)}")

    def device_lost(self, why: str) -> None:
        """Write zeros from this thread if the loop hangs, and record the loss."""
        super().device_lost(why)
        if self._hangs:
            self._put(np.zeros_like(self._frames))

    gone = "a period has not ended for {:g} s: zeros were written."

    def _close(self) -> None:
        """End the loop; where it hangs, write zeros from this thread."""
        self.pump.write("STATE", words.CLOSED)
        if self._thread:
            self._thread.join(min(self.silent_for, 0.5))
            if self._thread.is_alive() and not self._hangs:
                self._hangs = True
                self._put(np.zeros_like(self._frames))
        super()._close()

    def _latency(self) -> float:
        return (self.block or 1) / self.rate
