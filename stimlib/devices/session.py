"""The report of a session, and the thread that writes the session's log."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..errors import FaultError, SinkError, counted
from ..run.safety import Watch, said_of_energy
from . import words
from .engine import Pump
from .markers import Markers
from .rows import REMEDIES
from .sources import SILENT


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
        Frames that the device skipped; they were produced and discarded, to keep the
        timing correct.
    underruns : int
        Number of times the device skipped frames.
    clips : dict
        Samples that the safety stage changed, {stage: {output: count}}: "peak",
        "static", "slew" and "clip" are limits of the output; with a calibration,
        "drive" is the device's range, and "skin" the limit of the predicted output.
    faults : dict of str to int
        Outputs that were stopped because of NaN or infinity, with the sample index of
        each.
    block_time : dict of str to float, s
        Time of the callback: "p50", "p99", "p99.9", "max", at most 12.5 % too high.
    lateness : dict of str to float, s
        How late the callback began, in the same percentiles: after the beginning of the
        callback before, and the duration of its block.  0 if it began early.
    latency : float, s
        From the callback to the device, as the device reports it.
    stale : int
        Number of times the motion failed to arrive.
    unlogged : int
        Samples missing in the log because it was more than 4 s behind.
    skipped : int
        Columns of a live motion that were skipped because they came too fast.
    markers, lost_markers, unsent_markers : int
        Markers reported; those at samples that the device skipped; and those that a
        sender had not accepted by the end.
    rows : int
        Rows of a stream that were accepted.
    rejected : dict of str to int
        Rows of a stream that were rejected, by the reason.
    jitter : float, s
        For a stream with the sender's times: 99 % of the rows came within this time
        after the earliest.
    start_error : float or None, s
        For a start at a given time: how much later than that sample 0 left the device,
        as measured by the computer's clock.
    silent : str
        Empty, or what to say of a session whose motion in real time never came.
    quiet : float, s
        How long, at the end, the last position was held because no new one came.
    rise, fall : int
        Frames of the fade-in before sample 0, and of the fade-out after the last
        sample. They do not count as produced.  If they are 0, the fades lie on the
        samples, as with a real-time motion or after a stop.
    outside : dict
        Content outside of the calibrated band, which the device does not reproduce,
        {output: {"samples": .., "level": ..}}: how many samples it was larger than the
        stated error, and its largest value in the output's unit.
    energy : dict
        What passivity controllers observed and did, {output: {"given": .., "work": ..,
        "most": .., "leaps": .., "speed": .., "unit": ..}}: see
        ``stimlib.run.safety.Watch.energy``.  The samples that they changed are in
        ``clips``, as "passivity".
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
    outside: dict[str, dict[str, Any]] = field(default_factory=dict)
    markers: int = 0
    lost_markers: int = 0
    unsent_markers: int = 0
    rows: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    jitter: float = 0.0
    lateness: dict[str, float] = field(default_factory=dict)
    silent: str = ""
    quiet: float = 0.0
    start_error: float | None = None
    energy: dict[str, dict[str, Any]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain JSON data."""
        return asdict(self)

    def __str__(self) -> str:
        taken, late = (
            ", ".join(f"{k} {v * 1e6:.0f} us" for k, v in times.items())
            for times in (self.block_time, self.lateness)
        )
        line = (
            f"{counted(self.produced, 'sample')}, {self.delivered} delivered, {self.lost} lost in"
            f" {counted(self.underruns, 'underrun')}; blocks {taken}; late {late}"
        )
        more = [
            f"{counted(sum(v.values()), 'sample')} limited ({k})" for k, v in self.clips.items()
        ]
        more += [
            f"{counted(v['samples'], 'sample')} of {k} outside of the calibrated band, up"
            f" to {v['level']:.3g}"
            for k, v in self.outside.items()
        ]
        more += said_of_energy(self.energy)
        more += [f"output {k} failed at sample {v}" for k, v in self.faults.items()]
        reasons = sorted(self.rejected, key=lambda why: -self.rejected[why])
        rest = (
            (self.stale, f"motion stale {counted(self.stale, 'time')}"),
            (self.unlogged, f"{counted(self.unlogged, 'sample')} not logged"),
            (self.skipped, f"{counted(self.skipped, 'column')} of motion came too fast"),
            (
                self.markers,
                f"{counted(self.markers, 'marker')}, {self.lost_markers} lost"
                + f", {self.unsent_markers} not sent" * bool(self.unsent_markers),
            ),
            (self.silent, self.silent),
            (
                self.quiet > SILENT and not self.silent,
                f"the last position was held for the last {self.quiet:.3g} s",
            ),
            (
                self.start_error is not None,
                f"began {1e3 * (self.start_error or 0.0):.3f} ms after the given time",
            ),
            (self.rows, f"{counted(self.rows, 'row')} of motion"),
            (
                self.rejected and not self.silent,
                f"{counted(sum(self.rejected.values()), 'row')} rejected: "
                + ", ".join(f"{self.rejected[why]} {why}" for why in reasons)
                + f" ({REMEDIES.get(''.join(reasons[:1]), 'see its receive')})",
            ),
            (self.rise, f"faded in over {counted(self.rise, 'frame')} before sample 0"),
            (not self.rise, "faded in over the first samples"),
            (self.fall, f"faded out over {counted(self.fall, 'frame')} after the last sample"),
        )
        more += [text for count, text in rest if count]
        return "; ".join([line, *more])


class Recorder:
    """The consumer of the ring buffers, which writes the log in sample order.

    Parameters
    ----------
    pump : Pump
    watch : Watch
        Watch of the same processor.
    writer : LogWriter or None
        An object with the methods of ``stimlib.files.log_writer.LogWriter``.
    fail : callable
        ``fail(error, earliest)`` fades the session out, from that sample on.
    markers : Markers
    latency : callable
        Returns the seconds from the callback to the device.
    received : callable
        Returns what came of a motion in real time, see ``Sink._received``.
    """

    def __init__(
        self,
        pump: Pump,
        watch: Watch,
        writer: Any,
        fail: Callable[[Exception, int], None],
        markers: Markers,
        latency: Callable[[], float],
        received: Callable[[], dict[str, Any]],
    ):
        self.pump, self.watch, self.writer, self._fail = pump, watch, writer, fail
        self.markers, self._latency, self._received = markers, latency, received
        self.see: Callable[[int, np.ndarray, np.ndarray], None] | None = None
        self._column = np.zeros((len(pump.proc.inputs), 1))  # the newest motion
        self.stales = 0  # how often the motion stayed away
        self._cursor = 0  # frames that the log has
        self._pending: list[tuple[int, str, dict[str, Any]]] = []
        self._gone: list[str] = []  # outputs that have failed
        # what the log has; of a motion that is not counted and came it needs no more
        self._counts: dict[str, dict[str, Any]] = {"clip": {"counts": {}}, "rows": {"silent": ""}}
        self._counted_at = time.monotonic()

    def drain(self) -> None:
        """Log everything that has arrived, in sample order, and then the counts.

        The counts are those of samples that the safety stage changed.
        """
        writer, p = self.writer, self.pump
        # read first: what is lost of it has its event by now
        committed = p.read("DELIVERED") + p.read("LOST")
        pair = p.timed()
        if pair is not None:
            self.markers.clock.add(*pair)
            self.markers.clock.zero = p.read("BEGAN")
        if writer is not None and p.read("DROPPED"):
            raise SinkError(
                f"the log cannot follow: more than {words.EVENTS} changes and losses wait for"
                " the disk"
            )
        while len(x := p.motion()):
            self._column = x[-1:].T.copy()
            if writer is not None:
                writer.motion(x.T.copy())
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
            if self.see is not None:
                self.see(self._cursor - 1, self._column, part[-1:].T)
        self._put_events(self._cursor if p.read("LOG") else 2**63)
        self._tell(committed)
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
        """Log the rest, and then the report."""
        for _ in range(3):
            self.drain()
        self._put_events(2**63)
        # a mark after the end is at the next sample
        self._tell(self.pump.index + (self.pump.index > 0))
        self._put_counts()
        self.markers.end(0.5)
        if self.writer is not None:
            self.writer.close(report().to_dict())

    def _tell(self, until: int) -> None:
        """Send and log the markers before a sample."""
        for m in self.markers.due(until, self._latency):
            facts = asdict(m)
            self._put(facts.pop("sample"), "mark", **facts)

    def _put_counts(self) -> None:
        self._counted_at = time.monotonic()
        more = {"outside": self.watch.outside(), "energy": self.watch.energy()}
        clip = {"counts": self.watch.counts()} | {k: v for k, v in more.items() if v}
        for kind, now in ("clip", clip), ("rows", self._received()):
            if now and now != self._counts[kind]:
                self._counts[kind] = now
                self._put(self.pump.index, kind, **now)

    def _put_events(self, until: int) -> None:
        """Log the events at or before a sample."""
        while self._pending and self._pending[0][0] <= until:
            at, kind, more = self._pending.pop(0)
            self.stales += kind == "stale"
            if kind == "mark":
                self.markers.add(at, more["name"], more["value"])
                continue
            if kind == "lost":
                self.markers.gap(at, more["frames"])
            if kind in ("lost", "gap"):
                self._cursor = max(self._cursor, at + more["frames"])
                until = max(until, self._cursor) if until < 2**62 else until
            self._put(at, kind, **more)

    def _put(self, at: int, kind: str, **more: Any) -> None:
        if self.writer is not None:
            self.writer.event(at, kind, **more)
