"""A sink without a device, in real time or as fast as possible."""

from __future__ import annotations

from typing import Any

from .process import fifo
from .sink import Sink


class NullSink(Sink):
    """A sink without a device that runs the same compiled code as one with a device.

    Parameters
    ----------
    clocked : bool
        If true, run in real time, and lose samples when the machine is late; otherwise
        run as fast as possible, without losses.
    **options
        See ``Sink``.

    Examples
    --------
    See ``Sink``.
    """

    device = "null"

    def __init__(self, scene, safety=None, *, clocked: bool = True, **options: Any):
        self.clock = clocked
        super().__init__(scene, safety, **options)

    def _open(self) -> None:
        self.block = self.block or 64
        self._frames = self.make_frames()
        if not self.clock:
            self.pump.write("WAIT", 1_000_000)
        self.start_loop(self._loop)

    def _loop(self) -> None:
        if self.clock and self.realtime and not fifo():
            self._refused.append("real-time priority (ulimit -r)")
        self.pump.native.null(self.pump.context, self.block, self.rate, int(self.clock))

    def _latency(self) -> float:
        return (self.block or 0) / self.rate if self.clock else 0.0
