"""Replay of a session from its log, and comparison with the log's hashes."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace as changed

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Scene
from ..errors import BadValue, SceneError, SinkError, counted, public, said_as, shown
from ..run.driver import Rows, walk
from ..run.processor import Change, Processor
from ..run.safety import protect, to_device
from ..version import __version__
from . import audio as file
from .log_reader import SessionLog, Span


@dataclass(frozen=True)
class Replay:
    """The result of ``replay``; its str is one line, and ``matches`` is the verdict.

    Attributes
    ----------
    frames : int
        Number of replayed samples, whether delivered or lost.
    lost : int
        Number of lost samples among these.
    spans : int
        Number of compared hashes.
    wrong : list of (at, to)
        Ranges of delivered frames that differ from the replay.
    missing : int
        Number of samples in the log that could not be replayed.
    changed : list of (at, to)
        Ranges of motion rows that have changed since they were written.
    notes : list of str
    """

    frames: int
    lost: int
    spans: int
    wrong: list[tuple[int, int]]
    missing: int
    changed: list[tuple[int, int]]
    notes: list[str]

    @property
    def matches(self) -> bool:
        """Whether every hash of the log agrees with the replayed data."""
        return not (self.wrong or self.missing or self.changed)

    def __str__(self) -> str:
        line = (
            f"{counted(self.frames, 'frame')} replayed, {self.lost} lost;"
            f" {self.spans - len(self.wrong)} of"
            f" {self.spans} hashes match"
        )
        if self.wrong:
            line += (
                f", the first that does not is of frames {self.wrong[0][0]} to {self.wrong[0][1]}"
            )
        if self.missing:
            line += f"; {counted(self.missing, 'frame')} cannot be replayed"
        if self.changed:
            line += (
                f"; the motion was changed, first in samples {self.changed[0][0]} to"
                f" {self.changed[0][1]}"
            )
        return shown("; ".join([line, *self.notes]))


def processor(log: SessionLog, scene: Scene | None = None, target: str = "llvm") -> Processor:
    """Return the processor in its state before the session's first sample.

    By default it includes the safety stage.

    Raises
    ------
    SinkError
        The scene cannot be compiled.
    """
    with said_as(SinkError, f"{log.folder}: the scene cannot be compiled", SceneError, BadValue):
        proc = Processor(
            protect(log.scene, log.safety) if scene is None else scene, log.fs, target, log.seed
        )
        for name, value in log.params.items():
            if name in proc.params:
                proc.set(name, value, ramp=0.0)
        proc.process(np.zeros((len(proc.inputs), 0)))
    return proc


def without_inverse(log: SessionLog) -> SessionLog:
    """Return a log with frames as they were before the calibration's inverse filter.

    The frames are replayed in the outputs' units and without delay; their hashes differ
    from those of the log.
    """
    return changed(log, safety=changed(log.safety, inverse=None))


def motion_of(log: SessionLog, proc: Processor) -> Rows:
    """Return the logged motion in the processor's order, read on demand.

    Raises
    ------
    SinkError
        The log lacks the motion of an input.
    """
    if missing := set(proc.inputs) - set(log.inputs):
        raise SinkError(f"{log.folder}: the log has no motion of {', '.join(sorted(missing))}")
    columns = [log.inputs.index(name) for name in proc.inputs]
    if not columns:
        return np.empty((0, log.frames))
    return lambda at, stop: np.ascontiguousarray(log.motion[at:stop, columns].T)


def changes_of(log: SessionLog, proc: Processor) -> list[Change]:
    """Return the logged changes of those parameters that the processor has."""
    return [c for c in log.changes if c.name in proc.params]


def delivered(
    log: SessionLog, block: int = 8192, proc: Processor | None = None
) -> Iterator[tuple[int, NDArray[np.float32], bool]]:
    """Yield the replayed frames in order and without gaps.

    Each item is (at, frames (n, channels), whether they were delivered or lost). A
    given processor must come from ``processor(log)``; afterwards it can be inspected,
    for instance for faults.
    """
    proc, scales = processor(log) if proc is None else proc, log.safety.scales(log.outputs)
    lost = [(a, a + n) for a, n in log.lost if n]
    k = 0
    for at, y in walk(proc, motion_of(log, proc), log.frames, changes_of(log, proc), block=block):
        frames = to_device(y, scales, log.channels)
        begin = 0
        while begin < len(frames):
            here = at + begin
            while k < len(lost) and lost[k][1] <= here:
                k += 1
            inside = k < len(lost) and lost[k][0] <= here
            edge = lost[k][inside] if k < len(lost) else log.frames
            stop = min(len(frames), edge - at)
            yield here, frames[begin:stop], not inside
            begin = stop


@public
def replay(log: SessionLog, out: str | os.PathLike[str] | None = None, block: int = 8192) -> Replay:
    """Compute the delivered samples again and compare them with the log's hashes.

    Parameters
    ----------
    log : SessionLog
    out : path, optional
        A FLOAT sound file to write the samples to, as given to the device, without lost
        frames.
    block : int
        Samples computed at a time; it does not affect the result.

    Returns
    -------
    Replay

    Raises
    ------
    SinkError
        The scene cannot be compiled; the file cannot be written.

    Examples
    --------
    See `stimlib.files.log_writer.LogWriter`.
    """
    lost = sum(min(n, max(0, log.frames - at)) for at, n in log.lost)
    compared = Hashes(log.spans)

    def frames() -> Iterator[NDArray[np.float32]]:
        for at, part, given in delivered(log, block):
            if given:
                compared.add(at, part)
                yield part

    if out is None:
        for _ in frames():
            pass
    else:
        scales, units = log.safety.scales(log.outputs), log.header["units"]
        channels = []
        for i, c in enumerate(log.channels):
            name, scale = (f"channel{i}", 1.0) if c < 0 else (log.outputs[c], float(scales[c]))
            unit = "1" if c < 0 else str(units.get(name, "1"))
            channels.append({"name": name, "unit": unit, "full_scale": scale})
        what = protect(log.scene, log.safety)
        info = {
            "stimlib": __version__,
            "fs": log.fs,
            "frames": log.frames - lost,
            "channels": channels,
            "seed": log.seed,
            "params": log.params,
            "index": 0,
            "log": [c._asdict() for c in log.changes],
            "motion": dict.fromkeys(log.inputs, f"log of {log.frames} samples"),
            "lost": [{"at": at, "frames": n} for at, n in log.lost],
            "scene": what.to_dict(),
            "scene_hash": what.hash,
            "definitions": log.header["definitions"],
        }
        file.write_frames(out, frames(), info)
    return Replay(
        log.frames,
        lost,
        compared.done,
        compared.wrong,
        log.logged - log.frames,
        changed_motion(log),
        log.notes,
    )


def changed_motion(log: SessionLog) -> list[tuple[int, int]]:
    """Return the ranges (at, to) of the motion whose hash has changed.

    Only rows that exist are compared.
    """
    rows = len(log.motion)

    def sha256(s: Span) -> str:
        return hashlib.sha256(np.ascontiguousarray(log.motion[s.at : s.to], "<f8").data).hexdigest()

    return [(s.at, s.to) for s in log.motion_spans if s.to <= rows and sha256(s) != s.sha256]


class Hashes:
    """A comparison of frames, given in order, with the hashed ranges of a log.

    ``done`` is the number of compared ranges, and ``wrong`` lists those that differ.
    """

    def __init__(self, spans: list[Span]):
        self.spans, self.done = spans, 0
        self.wrong: list[tuple[int, int]] = []
        self._digest = hashlib.sha256()

    def add(self, at: int, frames: NDArray[np.float32]) -> None:
        """Add delivered frames, beginning at sample ``at``."""
        while len(frames) and self.done < len(self.spans):
            span = self.spans[self.done]
            frames, at = frames[max(0, span.at - at) :], max(at, span.at)  # a gap has no hash
            part = frames[: span.to - at]
            self._digest.update(np.ascontiguousarray(part, "<f4").data)
            at += len(part)
            frames = frames[len(part) :]
            if at == span.to:
                if self._digest.hexdigest() != span.sha256:
                    self.wrong.append((span.at, span.to))
                self.done += 1
                self._digest = hashlib.sha256()
