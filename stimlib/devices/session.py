"""The report of a session, and the thread that brings the session to its log."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..errors import FaultError, SinkError
from ..run.safety import Watch
from .engine import Pump


@dataclass(frozen=True)
class SessionReport:
    """The report of a session.

    Attributes
    ----------
    produced : int
        Samples that the processor has run: delivered + lost.
    delivered : int
        Frames that the device took.
    lost : int
        Frames that the device skipped; they were produced and discarded, so that time
        stays right.
    underruns : int
        How often it skipped.
    clips : dict
        Samples that the safety stage changed, {"peak", "static", "slew" or "clip":
        {output: count}}.
    faults : dict of str to int
        Outputs that were stopped because they were not finite, and the sample index of
        each.
    block_time : dict of str to float, s
        Time of the callback: "p50", "p99", "p99.9", "max", at most 12.5 % too high.
    latency : float, s
        From the callback to the device, as the device reports it.
    stale : int
        How often the motion stayed away.
    unlogged : int
        Samples missing in the log because it was more than 4 s behind.
    skipped : int
        Columns of a live motion that came too fast.
    rise, fall : int
        Frames before sample 0, in which the device rose to it, and after the last
        sample, in which it fell to silence. They are not among those produced.  Without
        them the fades lie on the samples: of a hand in real time, of a stop.
    """

    produced: int
    delivered: int
    lost: int
    underruns: int
    clips: dict[str, dict[str, int]]
    faults: dict[str, int]
    block_time: dict[str, float]
    latency: float
    stale: int = 0
    unlogged: int = 0
    skipped: int = 0
    rise: int = 0
    fall: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON data."""
        return asdict(self)

    def __str__(self) -> str:
        t = ", ".join(f"{k} {v * 1e6:.0f} us" for k, v in self.block_time.items())
        line = (
            f"{self.produced} samples, {self.delivered} delivered, {self.lost} lost in"
            f" {self.underruns} underruns; blocks {t}"
        )
        more = [f"{sum(v.values())} samples limited ({k})" for k, v in self.clips.items()]
        more += [f"output {k} failed at sample {v}" for k, v in self.faults.items()]
        more += [f"motion stale {self.stale} times"] if self.stale else []
        more += [f"{self.unlogged} samples not logged"] if self.unlogged else []
        more += [f"{self.skipped} columns of motion came too fast"] if self.skipped else []
        more += [
            "faded in over"
            f" {f'{self.rise} frames before sample 0' if self.rise else 'the first samples'}"
        ]
        more += [f"faded out over {self.fall} frames after the last sample"] if self.fall else []
        return "; ".join([line, *more])


class Recorder:
    """A reader of the callback's rings that writes the log in the order of samples.

    Parameters
    ----------
    pump : Pump
    watch : Watch
        Of the same processor.
    writer : LogWriter or None
        An object with the methods of ``stimlib.files.log_writer.LogWriter``.
    fail : callable
        ``fail(error, earliest)`` fades the session out, from that sample on.
    """

    def __init__(
        self, pump: Pump, watch: Watch, writer: Any, fail: Callable[[Exception, int], None]
    ):
        self.pump, self.watch, self.writer, self._fail = pump, watch, writer, fail
        self.stales = 0  # how often the motion stayed away
        self._cursor = 0  # frames that the log has
        self._pending: list[tuple[int, str, dict[str, Any]]] = []
        self._gone: list[str] = []  # outputs that have failed
        self._counts: dict[str, dict[str, int]] = {}
        self._counted_at = time.monotonic()

    def drain(self) -> None:
        """Log everything that has come, in the order of samples, then the counts.

        The counts are those of the safety stage.
        """
        writer, p = self.writer, self.pump
        if writer is not None and p.read("DROPPED"):
            raise SinkError(
                f"the log cannot follow: more than {p.native.EVENTS} changes and losses wait for"
                " the disk"
            )
        while len(x := p.motion()):
            if writer is not None:
                writer.motion(np.ascontiguousarray(x.T))
        while True:
            frames = p.frames()
            self._pending += p.events()  # an event is there before the frames that follow it
            self._pending.sort(key=lambda e: e[0])
            if not len(frames):
                break
            while len(frames):
                self._put_events(self._cursor)
                stop = min((e[0] for e in self._pending), default=2**63)
                part = frames[: max(1, stop - self._cursor)]
                if writer is not None:
                    writer.delivered(part.copy())
                self._cursor += len(part)
                frames = frames[len(part) :]
        self._put_events(self._cursor if p.read("LOG") else 2**63)
        faults = self.watch.faults()
        for name in sorted((n for n in faults if n not in self._gone), key=faults.__getitem__):
            self._gone.append(name)
            self._put(faults[name], "fault", output=name)
            why = FaultError(
                f"output {name} was not finite at sample {faults[name]}: the session was faded out"
            )
            # its own fade comes first: two at once would be steeper
            self._fail(why, faults[name] + self.watch.fade + 1)
        if time.monotonic() - self._counted_at >= 1.0:
            self._put_counts()

    def end(self, report: Callable[[], SessionReport]) -> None:
        """Log the rest and then the report."""
        for _ in range(3):
            self.drain()
        self._put_events(2**63)
        self._put_counts()
        if self.writer is not None:
            self.writer.close(report().to_dict())

    def _put_counts(self) -> None:
        counts = self.watch.counts()
        self._counted_at = time.monotonic()
        if counts != self._counts:
            self._counts = counts
            self._put(self.pump.index, "clip", counts=counts)

    def _put_events(self, until: int) -> None:
        """Log the events at or before a sample."""
        while self._pending and self._pending[0][0] <= until:
            at, kind, more = self._pending.pop(0)
            self.stales += kind == "stale"
            if kind in ("lost", "gap"):
                self._cursor = max(self._cursor, at + more["frames"])
                until = max(until, self._cursor) if until < 2**62 else until
            self._put(at, kind, **more)

    def _put(self, at: int, kind: str, **more: Any) -> None:
        if self.writer is not None:
            self.writer.event(at, kind, **more)
