"""The log of a session, and its replay: everything that shaped what a device was given, by sample index.

A log is a folder:

``session.json``
    what was compiled: the scene, seed, parameters, safety stage, channels, versions
``events.jsonl``
    one JSON object a line: parameters that were set, frames that were lost, hashes of what was delivered and of the motion
``motion.f64``
    the motion as the processor saw it: float64, little-endian, all inputs of sample 0, then of sample 1, ...
``delivered.caf``
    what was delivered, if the writer was asked to record it
``report.json``
    at a clean end only

Nothing of it waits in memory for long, so a process that is killed leaves a log that lacks half a second at most. A log is data:
reading it runs nothing of it.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import definitions, fields, regular
from ..core.bounds import limits
from ..core.scene import Scene
from ..errors import BadValue, SceneError, SinkError, StimlibError, shown
from ..run.processor import Change, Processor
from ..run.safety import GAIN, Safety, protect, to_device
from ..run.walk import Rows, walk
from ..version import __version__
from . import audio as file
from .draft import Draft

SPAN = 0.25  # s of delivered samples under one hash
MAX_INDEX = 2**53  # beyond, a float no longer tells two samples apart
MAX_LOST = 86400.0  # s in one stretch; nobody plays on after that
MAX_LINE = 1 << 20  # bytes of one event

_COUNT = fields.whole(MAX_INDEX)
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
    "block": _COUNT,
    "started": fields.text,
}
_HASH = fields.Test("64 hex digits", lambda v: fields.text(v) and len(v) == 64 and set(v) <= set("0123456789abcdef"))
_RAMP = fields.Test("a number of samples", lambda v: fields.number(v) and 0 <= v <= MAX_INDEX and v == int(v))
EVENTS: dict[str, dict[str, fields.Test]] = {
    "set": {"name": fields.text, "value": fields.number, "ramp": _RAMP},
    "hash": {"to": _COUNT, "sha256": _HASH},
    "motion": {"to": _COUNT, "sha256": _HASH},
    "lost": {"frames": _COUNT},
    "gap": {"frames": _COUNT},
}


class Event(NamedTuple):
    """Something that happened at a sample."""

    at: int
    kind: str
    data: dict[str, Any]


class Span(NamedTuple):
    """Frames at .. to - 1 and their sha256 (little-endian, all channels of a frame, then the next)."""

    at: int
    to: int
    sha256: str


# -- writing


class LogWriter:
    """Writes a session's log while it plays; all methods are called from one ordinary thread.

    Every call is on its way to the disk when it returns. After an error every further call raises it again, except
    ``close``.

    Parameters
    ----------
    folder : path
        Made; it must not exist, or be empty.
    header : dict
        What the session is made of, see ``stimlib.devices.sink.Sink.header``.
    record : bool
        Also write the delivered frames, to delivered.caf.

    Raises
    ------
    SinkError
        The folder is there already or cannot be made; later: the disk is full.
    BadValue
        A header that cannot be replayed.

    Examples
    --------
    A session by hand: what a sink does.

    >>> import tempfile, numpy as np, stimlib
    >>> from stimlib.files.log import LogWriter, header, read_log, replay
    >>> from stimlib.run.safety import Safety, protect, to_device
    >>> scene, safety = stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")}), Safety(50.0)
    >>> proc, x = stimlib.compile(protect(scene, safety), fs=8000), np.full((1, 800), 0.01)
    >>> folder = tempfile.TemporaryDirectory()
    >>> with LogWriter(folder.name, header(scene, safety, 8000.0, channels=["force", None])) as log:
    ...     proc.set("sink_gain", 1.0, ramp=160 / 8000)
    ...     log.event(0, "set", name="sink_gain", value=1.0, ramp=160)
    ...     log.motion(x)
    ...     log.delivered(to_device(proc.process(x), safety.scales(("force",)), [0, -1]))
    ...     log.close({"produced": 800})
    >>> print(replay(read_log(folder.name)))
    800 frames replayed, 0 lost; 1 of 1 hashes match
    >>> folder.cleanup()
    """

    def __init__(self, folder: str | os.PathLike[str], header: Mapping[str, Any], record: bool = False):
        self.folder = Path(folder)
        self._head = _header(dict(header), "header", BadValue)
        self._inputs, self._channels = len(self._head.inputs), len(self._head.channels)
        self._span = max(1, round(SPAN * self._head.fs))
        self._at = self._from = 0  # the next delivered frame; the first that is not under a hash yet
        self._rows = self._rows_from = 0  # the same of the motion
        self._digest, self._seen = hashlib.sha256(), hashlib.sha256()
        self._jumps: list[dict[str, Any]] = []  # frames that are lost, ahead of what was delivered
        self._error: SinkError | None = None
        self._record: Draft | None = None
        self._open = ExitStack()
        try:
            self.folder.mkdir(exist_ok=True)
            if any(self.folder.iterdir()):
                raise SinkError(f"{self.folder} is there already and not empty: give each session a log of its own")
            text = json.dumps(header, indent=1, allow_nan=False, default=_plain) + "\n"
            regular.publish(self.folder / "session.json", text)
            self._events = self._open.enter_context(open(self.folder / "events.jsonl", "xb", buffering=0))
            self._motion = self._open.enter_context(open(self.folder / "motion.f64", "xb", buffering=0)) if self._inputs else None
            if record:
                at = self.folder / "delivered.caf"
                self._record = self._open.enter_context(Draft(at, at, round(self._head.fs), self._channels, "CAF", "FLOAT"))
        except (OSError, ValueError) as e:
            self._open.close()
            if isinstance(e, StimlibError):
                raise
            raise SinkError(f"cannot make the log {self.folder}: {getattr(e, 'strerror', None) or e}") from e

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def motion(self, x: NDArray[np.float64]) -> None:
        """Append motion, shape (n_inputs, n), of the samples that were produced next, delivered or lost."""
        if self._motion is None:
            return
        if x.ndim != 2 or len(x) != self._inputs or x.dtype != np.float64:
            raise BadValue(f"log: motion must be float64 of shape ({self._inputs}, n); got {x.dtype} {x.shape}")
        self._write(self._motion, np.ascontiguousarray(x.T, "<f8").tobytes())
        while x.shape[1]:
            stop = (self._rows // self._span + 1) * self._span
            part = x[:, : stop - self._rows]
            self._seen.update(np.ascontiguousarray(part.T, "<f8").data)
            self._rows += part.shape[1]
            x = x[:, part.shape[1] :]
            if self._rows == stop:
                self._hash_motion()

    def delivered(self, frames: NDArray[np.float32]) -> None:
        """Append frames, shape (n, channels), as they went to the device."""
        if frames.ndim != 2 or frames.shape[1] != self._channels or frames.dtype != np.float32:
            raise BadValue(f"log: frames must be float32 of shape (n, {self._channels}); got {frames.dtype} {frames.shape}")
        if self._record is not None and len(frames):
            self._check()
            try:
                self._record.put(frames)
            except SinkError as e:
                self._fail(e)
        while len(frames):
            self._jump()
            stop = (self._at // self._span + 1) * self._span
            part = frames[: min([stop, *(j["at"] for j in self._jumps[:1])]) - self._at]
            self._digest.update(np.ascontiguousarray(part, "<f4").data)
            self._at += len(part)
            frames = frames[len(part) :]
            if self._at == stop:
                self._hash()
        self._jump()

    def event(self, at: int, kind: str, **data: Any) -> None:
        """Append an event at a sample index.

        ``set`` has name, value and ramp, in samples as applied. ``lost`` has frames: so many from ``at`` on were produced and not
        delivered. ``gap`` has frames of which the log knows nothing. Others are kept as they are.
        """
        self._check()
        event = {"at": at, "kind": kind} | data
        if kind in ("hash", "motion") or not _COUNT(_plain_int(at)):
            raise BadValue(f"log: event {event}: the log writes hashes itself; 'at' is a sample index")
        if kind in ("lost", "gap"):
            free = max([self._at, *(j["at"] + j["frames"] for j in self._jumps)])
            if at < free or not fields.whole(int(MAX_LOST * self._head.fs))(_plain_int(data.get("frames"))):
                raise BadValue(f"log: event {event}: frames up to {free} are accounted for; 'frames' is a number of samples")
            self._jumps.append(event)
            self._jump()
        else:
            self._line(event)

    def close(self, report: Mapping[str, Any] | None = None) -> None:
        """End the log; with a report (JSON data), as a clean end."""
        try:
            if self._error is None and not self._events.closed:
                self._hash()
                self._hash_motion()
                if report is not None:
                    text = json.dumps(report, indent=1, allow_nan=False, default=_plain) + "\n"
                    regular.publish(self.folder / "report.json", text)
        except SinkError:
            raise
        except OSError as e:
            self._fail(e)
        finally:
            self._end()

    def _jump(self) -> None:
        """Over what is lost, where it begins."""
        while self._jumps and self._jumps[0]["at"] == self._at:
            self._hash()
            self._line(self._jumps[0])
            jump = self._jumps.pop(0)
            self._at = self._from = int(jump["at"] + jump["frames"])

    def _hash(self) -> None:
        if self._at > self._from:
            self._line({"at": self._from, "kind": "hash", "to": self._at, "sha256": self._digest.hexdigest()})
        self._from, self._digest = self._at, hashlib.sha256()

    def _hash_motion(self) -> None:
        if self._rows > self._rows_from:
            self._line({"at": self._rows_from, "kind": "motion", "to": self._rows, "sha256": self._seen.hexdigest()})
        self._rows_from, self._seen = self._rows, hashlib.sha256()

    def _line(self, event: dict[str, Any]) -> None:
        try:
            text = json.dumps(event, allow_nan=False, default=_plain)
        except ValueError as e:
            raise BadValue(f"log: event {event} is not JSON data with finite numbers") from e
        self._write(self._events, text.encode() + b"\n")

    def _write(self, f: Any, data: bytes) -> None:
        self._check()
        try:
            while data:  # a full disk takes a part, and tells why it does not take the rest
                data = data[f.write(data) :]
            f.flush()
        except OSError as e:
            self._fail(e)

    def _check(self) -> None:
        if self._error is not None:
            raise self._error
        if self._events.closed:
            raise SinkError(f"the log {self.folder} is closed")

    def _fail(self, e: Exception) -> None:
        if self._error is None:
            self._error = SinkError(f"cannot write the log {self.folder}: {getattr(e, 'strerror', None) or e}")
        self._end()
        raise self._error from e

    def _end(self) -> None:
        """Close the files; what they have is what there will be."""
        with suppress(OSError):
            self._open.close()


def header(
    scene: Scene,
    safety: Safety,
    fs: float,
    *,
    seed: int = 0,
    params: Mapping[str, float] | None = None,
    channels: list[str | None] | None = None,
    device: str = "",
    block: int = 0,
    started: str = "",
) -> dict[str, Any]:
    """What a log says first, for sessions that are not played by a sink.

    Parameters
    ----------
    scene : Scene
        Without the safety stage.
    safety : Safety
    fs : float
        Hz.
    seed, params
        Of the run; params are parameters that differ from the scene's at the start.
    channels : list of str or None, optional
        The output of each channel of the device, None for silence; by default every output in order.
    device, block, started
        For the reader only.

    Returns
    -------
    dict
    """
    proc = Processor(protect(scene, safety), fs, seed=seed)
    return {
        "stimlib": __version__,
        "versions": {"numpy": np.__version__},
        "scene": scene.to_dict(),
        "scene_hash": scene.hash,
        "definitions": definitions.definitions(scene),
        "fs": float(fs),
        "seed": seed,
        "params": dict(params or {}),
        "safety": safety.to_dict(),
        "inputs": list(proc.inputs),
        "outputs": list(proc.outputs),
        "units": proc.units,
        "channels": list(proc.outputs) if channels is None else channels,
        "device": device,
        "block": block,
        "started": started,
    }


def _plain_int(v: Any) -> Any:
    return int(v) if isinstance(v, np.integer) else v


def _plain(v: Any) -> Any:
    if isinstance(v, np.generic):
        return v.item()
    raise ValueError(f"{type(v).__name__} is not JSON data")


# -- reading


class _Header(NamedTuple):
    scene: Scene
    safety: Safety
    fs: float
    seed: int
    params: dict[str, float]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    channels: tuple[int, ...]  # number of the output, -1 for silence


class MotionFile:
    """The rows of motion.f64, read where they are asked for.

    It is not mapped: a file that another program cuts would end the process then. Here that is a SinkError.

    Attributes
    ----------
    shape : (n, n_inputs)
    """

    def __init__(self, path: Path, inputs: int):
        self.path = path
        with open(regular.opened(path), "rb") as f:
            rows, self.rest = divmod(os.fstat(f.fileno()).st_size, 8 * inputs)
        self.shape = (rows, inputs)

    def __len__(self) -> int:
        return self.shape[0]

    def beyond(self, row: int) -> int:
        """Bytes from a row on; negative where rows are missing."""
        return 8 * self.shape[1] * (len(self) - row) + self.rest

    @property
    def T(self) -> NDArray[np.float64]:
        """All of it, shape (n_inputs, n)."""
        return self[:].T

    def __getitem__(self, key: Any) -> NDArray[np.float64]:
        """Rows [at:to], or [at:to, columns]."""
        rows, *columns = key if isinstance(key, tuple) else (key,)
        at, to, step = rows.indices(len(self))
        if step != 1:
            raise BadValue("log: motion is read row after row, log.motion[at:to]")
        x = np.empty((max(0, to - at), self.shape[1]), "<f8")
        try:
            with open(regular.opened(self.path), "rb", buffering=0) as f:
                f.seek(8 * at * self.shape[1])
                into = memoryview(x.reshape(-1)).cast("B")
                while got := f.readinto(into):
                    into = into[got:]
        except OSError as e:
            raise e if isinstance(e, SinkError) else SinkError(f"cannot read {self.path}: {e.strerror}") from e
        if into:
            raise SinkError(f"{self.path} was cut since the log was read: another program changed it")
        return x[:, columns[0]] if columns else x

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self[:].astype(dtype or np.float64, copy=False)


@dataclass(frozen=True, eq=False)
class SessionLog:
    """What ``read_log`` found. Sample indices count from the start of the session.

    Attributes
    ----------
    folder : Path
    header : dict
        session.json as it is.
    scene : Scene
        As the researcher wrote it; what ran is ``protect(scene, safety)``.
    safety : Safety
    fs : float, Hz
    seed : int
    params : dict of str to float
        Parameters that differed from the scene's at the start.
    inputs, outputs : tuple of str
    channels : tuple of int
        For each channel of the device the number of its output, or -1.
    events : list of Event
        All lines of events.jsonl, in their order.
    spans : list of Span
        Delivered frames (float32) under a hash, in order.
    motion_spans : list of Span
        Rows of motion (float64) under a hash, in order.
    lost : list of (at, frames)
        Produced and not delivered.
    motion : MotionFile of float64, shape (n, n_inputs)
        As the processor saw it; slices of it are read from the file, ``numpy.asarray(log.motion)`` reads all.
    frames : int
        Samples that can be replayed and are accounted for, as delivered or lost.
    logged : int
        Samples that the session produced, as far as the log tells; more than frames where motion or lines are missing.
    report : dict or None
        What the sink reported at a clean end.
    notes : list of str
        What is odd about the log.
    """

    folder: Path
    header: dict[str, Any]
    scene: Scene
    safety: Safety
    fs: float
    seed: int
    params: dict[str, float]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    channels: tuple[int, ...]
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
        """The ``set`` events, in order of sample index, as `Processor.set` takes them."""
        sets = [Change(e.at, e.data["name"], e.data["value"], e.data["ramp"] / self.fs) for e in self.events if e.kind == "set"]
        return sorted(sets, key=lambda c: c.at)


def read_log(folder: str | os.PathLike[str]) -> SessionLog:
    """Read and check a session's log, also of a session that was killed.

    Parameters
    ----------
    folder : path

    Returns
    -------
    SessionLog

    Raises
    ------
    SinkError
        A file is missing or is not what a log has there; the message names file, line and what is wrong. What a killed
        process leaves (a last line cut short, no report) is no error; ``notes`` tells it.

    Examples
    --------
    See `LogWriter`.
    """
    folder = Path(folder)
    if not os.path.lexists(folder):
        raise SinkError(f"there is no log {folder}")
    if not os.path.lexists(folder / "session.json"):
        raise SinkError(f"{folder} is no log: that is the folder that a sink wrote, with session.json in it")
    raw = _json(folder / "session.json")
    head = _header(raw, str(folder / "session.json"), SinkError)
    notes: list[str] = []
    events = _events(folder / "events.jsonl", head, notes)
    motion = MotionFile(folder / "motion.f64", len(head.inputs)) if head.inputs else np.empty((0, 0))
    report = _json(folder / "report.json") if os.path.isfile(folder / "report.json") else None
    if report is None:
        notes.append("no report: the session was killed, or its log could not be ended")

    spans, seen, lost, end, known = [], [], [], 0, None
    gaps: list[tuple[int, int]] = []  # one after the other is one
    for e in events:
        if e.kind == "motion":
            seen.append(Span(e.at, e.data["to"], e.data["sha256"]))
        if e.kind == "hash":
            spans.append(Span(e.at, e.data["to"], e.data["sha256"]))
            end = e.data["to"]
        elif e.kind in ("lost", "gap"):
            end = e.at + e.data["frames"]
            if e.kind == "lost":
                lost.append((e.at, e.data["frames"]))
            else:
                if e.data.get("delivered") is False:
                    lost.append((e.at, e.data["frames"]))
                begin = gaps.pop()[0] if gaps and gaps[-1][1] == e.at else e.at
                gaps.append((begin, end))
                known = e.at if known is None and head.inputs else known
    notes += [f"a gap of {stop - at} samples at {at}, of which the log knows nothing" for at, stop in gaps]
    frames = end if known is None else known
    produced = int(report["produced"]) if report is not None and _COUNT(report.get("produced")) else end
    if produced != end:
        notes.append(f"the report says {produced} samples, hashes and losses end at {end}")
    if isinstance(motion, MotionFile):
        more = motion.beyond(seen[-1].to if seen else 0)
        if report is not None and more > 0:  # a session that ended has all of it under a hash
            notes.append(f"motion.f64 has {more} bytes more than the session wrote")
        elif motion.rest:
            notes.append("the last frame of motion is cut short")
        if len(motion) < frames:
            notes.append(f"motion ends at sample {len(motion)}, hashes and losses at {frames}")
        frames = min(frames, len(motion))
    limits.check("log_samples", frames, f"{folder}: samples", SinkError)
    notes += definitions.changed(raw["definitions"], head.scene)
    if raw["stimlib"] != __version__:
        notes.append(shown(f"written by stimlib {raw['stimlib'][:40]}, this is {__version__}"))
    return SessionLog(folder, raw, *head, events, spans, seen, lost, motion, frames, max(end, produced), report, notes)


def _json(path: Path) -> dict[str, Any]:
    try:
        return fields.parse(regular.read(path, "sidecar_bytes"))
    except ValueError as e:
        raise SinkError(f"{path}: not JSON as a log has it ({e})") from e


def _header(data: dict[str, Any], where: str, error: type[StimlibError]) -> _Header:
    """session.json, checked; raises error."""

    def need(good: bool, what: str) -> None:
        if not good:
            raise error(f"{where}: {what}")

    try:
        fields.require(data, FIELDS)
    except ValueError as e:
        raise error(f"{where}: {e}") from e
    try:
        scene = Scene.from_dict(data["scene"])
        safety = Safety(**data["safety"])
        outputs = tuple(scene.outputs)
        safety.scales(outputs)
        known = protect(scene, safety).params
    except (StimlibError, ValueError, TypeError, OverflowError, RecursionError) as e:
        raise error(f"{where}: scene or safety cannot be used: {str(e)[:500]}") from e
    need(scene.hash == data["scene_hash"], "scene_hash is not that of the scene: one of them was changed")
    said, found = definitions.hashes(data["definitions"], scene)
    need(said == found, "definitions are not those of the scene's own blocks, or do not have their hashes: they were changed")
    need(tuple(data["outputs"]) == outputs, f"outputs must be those of the scene, {', '.join(outputs)}")
    inputs = data["inputs"]
    need(set(inputs) <= set(scene.inputs), f"inputs must be of {', '.join(scene.inputs) or 'none'}")
    need(len(set(inputs)) == len(inputs), "an input is there twice")
    channels = data["channels"]
    need(0 < len(channels) <= 1024, "channels must be a list of 1 to 1024 output names or null")
    need({*channels} <= {*outputs, None}, "channels must be names of outputs, or null")
    params = data["params"]
    for name in params:
        need(name in known, f"params: there is no parameter {name!r}")
    numbers = tuple(-1 if c is None else outputs.index(c) for c in channels)
    start = {n: float(v) for n, v in params.items()}
    return _Header(scene, safety, float(data["fs"]), data["seed"], start, tuple(inputs), outputs, numbers)


def _events(path: Path, head: _Header, notes: list[str]) -> list[Event]:
    """events.jsonl, checked line by line. Frames are accounted for from 0 on, without a hole, each once."""
    params = set(head.scene.params) | {GAIN}
    found: list[Event] = []
    end = {"delivered": 0, "motion": 0, "lost": 0}
    with open(regular.opened(path), "rb") as f:
        limits.check("events_bytes", os.fstat(f.fileno()).st_size, f"{path}: bytes", SinkError)
        for number in range(1, 1 << 62):
            try:
                line = f.readline(MAX_LINE)
            except OSError as e:
                raise SinkError(f"cannot read {path}: {e.strerror}") from e
            if not line.endswith(b"\n"):
                if len(line) == MAX_LINE:
                    raise SinkError(f"{path}, line {number}: longer than {MAX_LINE} bytes")
                if line:
                    notes.append(f"the last line of {path.name} is cut short")
                break
            try:
                found.append(_event(line, head.fs, params))
                _account(found[-1], end)
            except ValueError as problem:
                raise SinkError(f"{path}, line {number}: {problem}") from None
    limits.check("lost_samples", end["lost"], f"{path}: samples that are lost", SinkError)
    return found


def _event(line: bytes, fs: float, params: set[str]) -> Event:
    """One line; ValueError tells what is wrong with it."""

    def need(good: bool, what: str) -> None:
        if not good:
            raise ValueError(what)

    data = fields.parse(line)
    at, kind = data.pop("at", None), data.pop("kind", None)
    need(_COUNT(at), f"'at' must be a sample index, not {str(at)[:40]}")
    need(fields.text(kind), "'kind' must be a text")
    need(kind == kind[:100], "'kind' is too long")
    fields.require(data, EVENTS.get(kind, {}))
    if kind == "set":
        need(data["name"] in params, f"there is no parameter {data['name'][:40]!r}")
    elif kind in ("hash", "motion"):
        need(at < data["to"] <= at + math.ceil(fs), "'to' must be after 'at', by one second at most")
    elif kind in ("lost", "gap"):
        need(data["frames"] <= MAX_LOST * fs, "'frames' must be a number of samples, a day at most")
    return Event(at, kind, data)


def _account(e: Event, end: dict[str, int]) -> None:
    """Count the samples that this event accounts for; ValueError if it does not go on where the last ended."""
    if e.kind in ("hash", "lost", "gap", "motion"):
        what = "motion" if e.kind == "motion" else "delivered"
        if e.at != end[what]:
            known = f"but what is accounted for ends at {end[what]}: lines are missing or moved"
            raise ValueError(f"{e.kind} from sample {e.at} on, {known}")
        end[what] = e.at + e.data["frames"] if e.kind in ("lost", "gap") else e.data["to"]
        end["lost"] += e.data["frames"] if e.kind in ("lost", "gap") else 0


# -- replay


@dataclass(frozen=True)
class Replay:
    """What ``replay`` found; its str is one line, ``matches`` the verdict.

    Attributes
    ----------
    frames : int
        Samples replayed, delivered or lost.
    lost : int
        Of these, lost.
    spans : int
        Hashes that were compared.
    wrong : list of (at, to)
        Delivered frames that are not those of the replay.
    missing : int
        Samples that the log accounts for and that could not be replayed.
    changed : list of (at, to)
        Rows of the motion that are not those that were written.
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
        """Whether every hash of the log was compared and is that of the replayed samples, or of the motion."""
        return not (self.wrong or self.missing or self.changed)

    def __str__(self) -> str:
        line = f"{self.frames} frames replayed, {self.lost} lost; {self.spans - len(self.wrong)} of {self.spans} hashes match"
        if self.wrong:
            line += f", the first that does not is of frames {self.wrong[0][0]} to {self.wrong[0][1]}"
        if self.missing:
            line += f"; {self.missing} frames cannot be replayed"
        if self.changed:
            line += f"; the motion was changed, first in samples {self.changed[0][0]} to {self.changed[0][1]}"
        return shown("; ".join([line, *self.notes]))


def processor(log: SessionLog, scene: Scene | None = None, target: str = "numba") -> Processor:
    """The processor as the session had it before its first sample; by default with the safety stage.

    Raises
    ------
    SinkError
        The scene cannot be compiled.
    """
    try:
        proc = Processor(protect(log.scene, log.safety) if scene is None else scene, log.fs, target, log.seed)
        for name, value in log.params.items():
            if name in proc.params:
                proc.set(name, value, ramp=0.0)
        proc.process(np.zeros((len(proc.inputs), 0)))
    except (SceneError, BadValue) as e:
        raise SinkError(f"{log.folder}: the scene cannot be compiled: {e}") from e
    return proc


def motion_of(log: SessionLog, proc: Processor) -> Rows:
    """The logged motion, rows as the processor has them, read where they are asked for.

    Raises
    ------
    SinkError
        The log has not the motion of an input.
    """
    if missing := set(proc.inputs) - set(log.inputs):
        raise SinkError(f"{log.folder}: the log has no motion of {', '.join(sorted(missing))}")
    columns = [log.inputs.index(name) for name in proc.inputs]
    if not columns:
        return np.empty((0, log.frames))
    return lambda at, stop: np.ascontiguousarray(log.motion[at:stop, columns].T)


def changes_of(log: SessionLog, proc: Processor) -> list[Change]:
    """The logged changes of parameters that the processor has."""
    return [c for c in log.changes if c.name in proc.params]


def delivered(
    log: SessionLog, block: int = 8192, proc: Processor | None = None
) -> Iterator[tuple[int, NDArray[np.float32], bool]]:
    """Replayed frames (at, frames (n, channels), whether they were delivered or lost), in order and without a hole.

    A processor, if given, must be one of ``processor(log)``; it then tells what happened, as its faults.
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


def replay(log: SessionLog, out: str | os.PathLike[str] | None = None, block: int = 8192) -> Replay:
    """Make the delivered samples again and compare them with the log's hashes.

    Parameters
    ----------
    log : SessionLog
    out : path, optional
        A sound file to write them to, FLOAT: what the device was given, lost frames left out.
    block : int
        Samples at a time; no effect on the result.

    Returns
    -------
    Replay

    Raises
    ------
    SinkError
        The scene cannot be compiled; the file cannot be written.

    Examples
    --------
    See `LogWriter`.
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
        names = [(log.outputs[c], log.header["units"], c) if c >= 0 else None for c in log.channels]
        scales = log.safety.scales(log.outputs)
        channels = [
            {"name": f"channel{i}", "unit": "1", "full_scale": 1.0}
            if n is None
            else {"name": n[0], "unit": str(n[1].get(n[0], "1")), "full_scale": float(scales[n[2]])}
            for i, n in enumerate(names)
        ]
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
    return Replay(log.frames, lost, compared.done, compared.wrong, log.logged - log.frames, changed_motion(log), log.notes)


def changed_motion(log: SessionLog) -> list[tuple[int, int]]:
    """Spans (at, to) of the motion whose hash is not the one that was written with it; of the rows that are there."""
    rows = len(log.motion)

    def sha256(s: Span) -> str:
        return hashlib.sha256(np.ascontiguousarray(log.motion[s.at : s.to], "<f8").data).hexdigest()

    return [(s.at, s.to) for s in log.motion_spans if s.to <= rows and sha256(s) != s.sha256]


class Hashes:
    """Compares frames, given in order, with spans; ``done`` spans were compared, ``wrong`` lists those that differ."""

    def __init__(self, spans: list[Span]):
        self.spans, self.done = spans, 0
        self.wrong: list[tuple[int, int]] = []
        self._digest, self._bad = hashlib.sha256(), False

    def add(self, at: int, frames: NDArray[np.float32]) -> None:
        """Frames from sample ``at`` on, all of them delivered."""
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
