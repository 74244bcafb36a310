"""Session logs: everything that determined the delivered samples, by sample index.

A log is a folder:

``session.json``
    the compiled program: scene, seed, parameters, safety stage, channels, versions
``events.jsonl``
    one JSON object per line: parameters set, frames lost, hashes of the delivered
    frames and of the motion
``motion.f64``
    the motion as the processor saw it: float64, little-endian, all inputs of sample 0,
    then of sample 1, ...
``delivered.caf``
    the delivered frames, if the writer was asked to record them
``report.json``
    at a clean end only

Data are written promptly, so the log of a killed process lacks at most half a second. A
log is plain data: reading it executes nothing.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import definitions
from ..core.scene import Scene
from ..errors import BadValue, SinkError, StimlibError, counted, public, said_as, shown
from ..run.processor import Change
from ..run.safety import GAIN, Safety, protect
from ..system import fields, safe_files
from ..system.limits import limits
from ..version import __version__

MAX_INDEX = 2**53  # beyond, a float no longer tells two samples apart
MAX_LOST = 86400.0  # s in one stretch; nobody plays on after that

COUNT = fields.whole(MAX_INDEX)
FIELDS: dict[str, fields.Test] = {
    "stimlib": fields.text,
    "versions": fields.table,
    "scene": fields.table,
    "scene_hash": fields.text,
    "definitions": definitions.TEST,
    "fs": fields.between(1, 1e7),  # Hz
    "seed": fields.whole(2**64 - 1),
    "params": fields.table_of(fields.number),
    "safety": fields.table,
    "inputs": fields.list_of(fields.text),
    "outputs": fields.list_of(fields.text),
    "units": fields.table_of(fields.text),
    "channels": fields.list_of(fields.maybe(fields.text)),
    "device": fields.text,
    "block": COUNT,
    "started": fields.text,
}
_HASH = fields.Test(
    "64 hex digits",
    lambda v: fields.text(v) and len(v) == 64 and set(v) <= set("0123456789abcdef"),
    {"type": "string", "pattern": "^[0-9a-f]{64}$"},
)
_RAMP = fields.Test(
    "a number of samples",
    lambda v: fields.number(v) and 0 <= v <= MAX_INDEX and v == int(v),
    {"type": "integer", "minimum": 0, "maximum": MAX_INDEX},
)
EVENTS: dict[str, dict[str, fields.Test]] = {
    "set": {"name": fields.text, "value": fields.number, "ramp": _RAMP},
    "hash": {"to": COUNT, "sha256": _HASH},
    "motion": {"to": COUNT, "sha256": _HASH},
    "lost": {"frames": COUNT},
    "gap": {"frames": COUNT},
    "rise": {"frames": COUNT},
    "fall": {"frames": COUNT},
    "rows": {"silent": fields.text},
}


class Event(NamedTuple):
    """An event of the session at a sample index."""

    at: int
    kind: str
    data: dict[str, Any]


class Span(NamedTuple):
    """A range of frames and its SHA-256.

    The hash covers little-endian words, frame by frame, with all channels of a frame
    together.
    """

    at: int
    to: int
    sha256: str


@dataclass(frozen=True, eq=False)
class Header:
    """The header of a log, which is its first record."""

    scene: Scene
    safety: Safety
    fs: float
    seed: int
    params: dict[str, float]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    channels: tuple[int, ...]  # number of the output, -1 for silence


class MotionFile:
    """The rows of motion.f64, read on demand.

    The file is not memory-mapped, because the process would crash if another program
    truncated it. Reading a truncated file raises SinkError instead.

    Attributes
    ----------
    shape : (n, n_inputs)
    """

    def __init__(self, path: Path, inputs: int):
        self.path = path
        with open(safe_files.opened(path), "rb") as f:
            rows, self.rest = divmod(os.fstat(f.fileno()).st_size, 8 * inputs)
        self.shape = (rows, inputs)

    def __len__(self) -> int:
        return self.shape[0]

    def beyond(self, row: int) -> int:
        """Return the number of bytes after a row; negative if rows are missing."""
        return 8 * self.shape[1] * (len(self) - row) + self.rest

    @property
    def T(self) -> NDArray[np.float64]:
        """All rows, shape (n_inputs, n)."""
        return self[:].T

    def __getitem__(self, key: Any) -> NDArray[np.float64]:
        """Return rows [at:to], or [at:to, columns]."""
        rows, *columns = key if isinstance(key, tuple) else (key,)
        at, to, step = rows.indices(len(self))
        if step != 1:
            raise BadValue("log: motion is read row after row, log.motion[at:to]")
        x = np.empty((max(0, to - at), self.shape[1]), "<f8")
        try:
            with open(safe_files.opened(self.path), "rb", buffering=0) as f:
                f.seek(8 * at * self.shape[1])
                into = memoryview(x.reshape(-1)).cast("B")
                while got := f.readinto(into):
                    into = into[got:]
        except SinkError:
            raise
        except OSError as e:
            raise SinkError(f"cannot read {self.path}: {e.strerror}") from e
        if into:
            raise SinkError(
                f"{self.path} was cut since the log was read: another program changed it"
            )
        return x[:, columns[0]] if columns else x

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self[:].astype(dtype or np.float64, copy=False)


@dataclass(frozen=True, eq=False)
class SessionLog(Header):
    """The contents of a log, as ``read_log`` found them.

    Sample indices count from the start of the session.

    Attributes
    ----------
    folder : Path
    header : dict
        The contents of session.json, unchanged.
    scene : Scene
        The scene as written; the session ran ``protect(scene, safety)``.
    safety : Safety
    fs : float, Hz
    seed : int
    params : dict of str to float
        Parameters that differed from the scene's at the start.
    inputs, outputs : tuple of str
    channels : tuple of int
        For each channel of the device, the number of its output, or -1.
    events : list of Event
        All lines of events.jsonl, in their order.
    spans : list of Span
        Ranges of delivered frames (float32) with a hash, in order.
    motion_spans : list of Span
        Ranges of motion rows (float64) with a hash, in order.
    lost : list of (at, frames)
        Frames that were produced but not delivered.
    motion : MotionFile of float64, shape (n, n_inputs)
        The motion as the processor received it; slices are read from the file on
        demand, and ``numpy.asarray(log.motion)`` reads all of it.
    frames : int
        Number of samples that can be replayed and are recorded as delivered or lost.
    logged : int
        Number of samples that the session produced according to the log; larger than
        ``frames`` if motion or lines are missing.
    report : dict or None
        The sink's report, if the session ended cleanly.
    notes : list of str
        Irregularities of the log.
    """

    folder: Path
    header: dict[str, Any]
    events: list[Event]
    spans: list[Span]
    motion_spans: list[Span]
    lost: list[tuple[int, int]]
    motion: MotionFile | NDArray[np.float64]
    frames: int
    logged: int
    report: dict[str, Any] | None
    notes: list[str]

    @property
    def changes(self) -> list[Change]:
        """The ``set`` events in order of sample index, as for `Processor.set`."""
        sets = [
            Change(e.at, e.data["name"], e.data["value"], e.data["ramp"] / self.fs)
            for e in self.events
            if e.kind == "set"
        ]
        return sorted(sets, key=lambda c: c.at)


@public
def read_log(folder: str | os.PathLike[str]) -> SessionLog:
    """Read and check the log of a session, even of a killed one.

    Parameters
    ----------
    folder : path

    Returns
    -------
    SessionLog

    Raises
    ------
    SinkError
        A file is missing or invalid; the message names file, line and problem. The
        traces of a killed process (an incomplete last line, no report) are not errors;
        ``notes`` lists them.

    Examples
    --------
    See `LogWriter`.
    """
    folder = Path(folder)
    if not os.path.lexists(folder):
        raise SinkError(f"there is no log {folder}")
    if not os.path.lexists(folder / "session.json"):
        raise SinkError(
            f"{folder} is no log: that is the folder that a sink wrote, with session.json in it"
        )
    raw = _json(folder / "session.json")
    head = checked(raw, str(folder / "session.json"), SinkError)
    notes: list[str] = []
    events = _events(folder / "events.jsonl", head, notes)
    motion: MotionFile | NDArray[np.float64] = np.empty((0, 0))
    if head.inputs:
        motion = MotionFile(folder / "motion.f64", len(head.inputs))
    ended = os.path.isfile(folder / "report.json")
    report = _json(folder / "report.json") if ended else None
    spans, seen, lost, gaps = _spans(events)
    end = max([0, *(s.to for s in (*spans, *gaps)), *(at + n for at, n in lost)])
    for gap in gaps:
        size = gap.to - gap.at
        notes.append(
            f"a gap of {counted(size, 'sample')} at {gap.at}, of which the log knows nothing"
        )
    produced, hashed = _produced(report, end, notes), seen[-1].to if seen else 0
    if ended:  # a session that ended has both of each sample
        produced = max(produced, hashed)
    frames = gaps[0].at if gaps and head.inputs else end
    if isinstance(motion, MotionFile):
        more = motion.beyond(hashed)
        if ended and more > 0:  # a session that ended has all of it under a hash
            notes.append(f"motion.f64 has {counted(more, 'byte')} more than the session wrote")
        elif motion.rest:
            notes.append("the last frame of motion is cut short")
        if len(motion) < frames:
            notes.append(f"motion ends at sample {len(motion)}, hashes and losses at {frames}")
        frames = min(frames, len(motion))
    limits.check("log_samples", frames, f"{folder}: samples", SinkError)
    notes += definitions.changed(raw["definitions"], head.scene)
    if raw["stimlib"] != __version__:
        notes.append(shown(f"written by stimlib {raw['stimlib'][:40]}, this is {__version__}"))
    return SessionLog(
        **vars(head),
        folder=folder,
        header=raw,
        events=events,
        spans=spans,
        motion_spans=seen,
        lost=lost,
        motion=motion,
        frames=frames,
        logged=max(end, produced),
        report=report,
        notes=notes,
    )


def _spans(
    events: Sequence[Event],
) -> tuple[list[Span], list[Span], list[tuple[int, int]], list[Span]]:
    """Return the hashed ranges of frames and motion, the lost ranges, and the gaps.

    Adjacent gaps are merged.
    """
    spans: list[Span] = []
    seen: list[Span] = []
    lost: list[tuple[int, int]] = []
    gaps: list[Span] = []
    for e in events:
        if e.kind in ("hash", "motion"):
            hashed = spans if e.kind == "hash" else seen
            hashed.append(Span(e.at, e.data["to"], e.data["sha256"]))
        if e.kind == "lost" or (e.kind == "gap" and e.data.get("delivered") is False):
            lost.append((e.at, e.data["frames"]))
        if e.kind == "gap":
            begin = gaps.pop().at if gaps and gaps[-1].to == e.at else e.at
            gaps.append(Span(begin, e.at + e.data["frames"], ""))
    return spans, seen, lost, gaps


def _produced(report: dict[str, Any] | None, end: int, notes: list[str]) -> int:
    """Return the number of produced samples, and note irregularities of the report."""
    if report is None:
        notes.append("no report: the session was killed, or its log could not be ended")
        return end
    if not COUNT(report.get("produced")):
        notes.append("the report has no number of samples produced")
        return end
    produced = int(report["produced"])
    if produced != end:
        notes.append(
            f"the report says {counted(produced, 'sample')}, hashes and losses end at {end}"
        )
    return produced


def _json(path: Path) -> dict[str, Any]:
    with said_as(SinkError, f"{path}: not JSON as a log has it", ValueError):
        return fields.parse(safe_files.read(path, "sidecar_bytes"))


def checked(data: dict[str, Any], where: str, error: type[StimlibError]) -> Header:
    """Return the header that session.json describes, or raise an error."""
    with said_as(error, where, ValueError):
        fields.require(data, FIELDS)
        return _header(data)


def _need(good: bool, what: str) -> None:
    if not good:
        raise ValueError(what)


def _header(data: dict[str, Any]) -> Header:
    """Return the header that session.json describes, or raise ValueError."""
    try:
        scene = Scene.from_dict(data["scene"])
        safety = Safety(**data["safety"])
        outputs = tuple(scene.outputs)
        safety.scales(outputs)
        known = protect(scene, safety).params
    except (StimlibError, ValueError, TypeError, OverflowError, RecursionError) as e:
        raise ValueError(f"scene or safety cannot be used: {str(e)[:500]}") from e
    _need(
        scene.hash == data["scene_hash"],
        "scene_hash is not that of the scene: one of them was changed",
    )
    said, found = definitions.hashes(data["definitions"], scene)
    _need(
        said == found,
        "definitions are not those of the scene's own blocks, or do not have their hashes: they"
        " were changed",
    )
    _need(
        tuple(data["outputs"]) == outputs,
        f"outputs must be those of the scene, {', '.join(outputs)}",
    )
    inputs = data["inputs"]
    _need(
        set(inputs) <= set(scene.inputs), f"inputs must be of {', '.join(scene.inputs) or 'none'}"
    )
    _need(len(set(inputs)) == len(inputs), "an input is there twice")
    channels = data["channels"]
    _need(0 < len(channels) <= 1024, "channels must be a list of 1 to 1024 output names or null")
    _need({*channels} <= {*outputs, None}, "channels must be names of outputs, or null")
    params = data["params"]
    for name in params:
        _need(name in known, f"params: there is no parameter {name!r}")
    numbers = tuple(-1 if c is None else outputs.index(c) for c in channels)
    start = {n: float(v) for n, v in params.items()}
    return Header(
        scene, safety, float(data["fs"]), data["seed"], start, tuple(inputs), outputs, numbers
    )


def _events(path: Path, head: Header, notes: list[str]) -> list[Event]:
    """Read events.jsonl and check every line.

    Each frame from 0 on must be recorded exactly once, without gaps.
    """
    params = set(head.scene.params) | {GAIN}
    found: list[Event] = []
    end = {"delivered": 0, "motion": 0, "lost": 0}
    *lines, rest = safe_files.read(path, "events_bytes").split(b"\n")
    if rest:
        notes.append(f"the last line of {path.name} is cut short")
    for number, line in enumerate(lines, 1):
        try:
            found.append(_event(line, head.fs, params))
            _account(found[-1], end)
        except ValueError as problem:
            raise SinkError(f"{path}, line {number}: {problem}") from None
    limits.check("lost_samples", end["lost"], f"{path}: samples that are lost", SinkError)
    return found


def _event(line: bytes, fs: float, params: set[str]) -> Event:
    """Return the event of one line; raise ValueError with the problem of the line."""
    data = fields.parse(line)
    at, kind = data.pop("at", None), data.pop("kind", None)
    _need(COUNT(at), f"'at' must be a sample index, not {at!r:.40}")
    _need(fields.text(kind), "'kind' must be a text")
    _need(kind == kind[:100], "'kind' is too long")
    fields.require(data, EVENTS.get(kind, {}))
    if kind == "set":
        _need(data["name"] in params, f"there is no parameter {data['name'][:40]!r}")
    elif kind in ("hash", "motion"):
        _need(
            at < data["to"] <= at + math.ceil(fs), "'to' must be after 'at', by one second at most"
        )
    elif kind in ("lost", "gap"):
        _need(data["frames"] <= MAX_LOST * fs, "'frames' must be samples, a day at most")
    return Event(at, kind, data)


def _account(e: Event, end: dict[str, int]) -> None:
    """Count the samples of an event; raise ValueError if there is a gap before it."""
    if e.kind in ("hash", "lost", "gap", "motion"):
        what = "motion" if e.kind == "motion" else "delivered"
        if e.at != end[what]:
            known = f"but what is accounted for ends at {end[what]}: lines are missing or moved"
            raise ValueError(f"{e.kind} from sample {e.at} on, {known}")
        end[what] = e.at + e.data["frames"] if e.kind in ("lost", "gap") else e.data["to"]
        end["lost"] += e.data["frames"] if e.kind in ("lost", "gap") else 0
