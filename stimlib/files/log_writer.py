"""Writing of a session's log during playback; see `log_reader` for its format."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import definitions
from ..core.scene import Scene
from ..errors import BadValue, SinkError, StimlibError, public
from ..run.safety import Safety, protect
from ..system import fields, safe_files
from ..version import __version__
from .formats import check_format
from .log_reader import COUNT, MAX_LOST, checked
from .sound_file import Draft

SPAN = 0.25  # s of delivered samples under one hash


class LogWriter(AbstractContextManager["LogWriter"]):
    """A writer of a session's log during playback, called from one thread.

    The data of every call have been handed to the operating system when it returns.
    After an error, every further call except ``close`` raises it again.

    Parameters
    ----------
    folder : path
        The folder to create; it must be missing or empty.
    header : dict
        Description of the session, see ``stimlib.devices.sink.Sink.header``.
    record : bool
        Also write the delivered frames, to delivered.caf.

    Raises
    ------
    SinkError
        The folder already exists or cannot be created; later: the disk is full.
    BadValue
        A header that cannot be replayed.

    Examples
    --------
    A session by hand: what a sink does.

    >>> import tempfile, numpy as np, stimlib
    >>> from stimlib.files import LogWriter, header, read_log, replay
    >>> from stimlib.run.safety import Safety, protect, to_device
    >>> scene, safety = (
    ...     stimlib.Scene(
    ...         {"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")}
    ...     ),
    ...     Safety(50.0),
    ... )
    >>> proc, x = (
    ...     stimlib.compile(protect(scene, safety), fs=8000),
    ...     np.full((1, 800), 0.01),
    ... )
    >>> folder = tempfile.TemporaryDirectory()
    >>> with LogWriter(
    ...     folder.name, header(scene, safety, 8000.0, channels=["force", None])
    ... ) as log:
    ...     proc.set("sink_gain", 1.0, ramp=160 / 8000)
    ...     log.event(0, "set", name="sink_gain", value=1.0, ramp=160)
    ...     log.motion(x)
    ...     log.delivered(
    ...         to_device(proc.process(x), safety.scales(("force",)), [0, -1])
    ...     )
    ...     log.close({"produced": 800})
    >>> print(replay(read_log(folder.name)))
    800 frames replayed, 0 lost; 1 of 1 hashes match
    >>> folder.cleanup()
    """

    def __init__(
        self, folder: str | os.PathLike[str], header: Mapping[str, Any], record: bool = False
    ):
        self.folder = Path(folder)
        self._head = checked(dict(header), "header", BadValue)
        if record:
            check_format("CAF", "FLOAT", self._head.fs, 1, 0)
        self._inputs, self._channels = len(self._head.inputs), len(self._head.channels)
        self._span = max(1, round(SPAN * self._head.fs))
        # the next delivered frame; the first that is not under a hash yet
        self._at = self._from = 0
        self._rows = self._rows_from = 0  # the same of the motion
        self._digest, self._seen = hashlib.sha256(), hashlib.sha256()
        self._jumps: list[dict[str, Any]] = []  # frames that are lost, ahead of what was delivered
        self._error: SinkError | None = None
        self._record: Draft | None = None
        self._open = ExitStack()
        try:
            self.folder.mkdir(exist_ok=True)
            if any(self.folder.iterdir()):
                raise SinkError(
                    f"{self.folder} is there already and not empty: give each session a log of"
                    " its own"
                )
            text = json.dumps(header, indent=1, allow_nan=False, default=_plain) + "\n"
            safe_files.publish(self.folder / "session.json", text)
            self._events = self._new("events.jsonl")
            self._motion = self._new("motion.f64") if self._inputs else None
            if record:
                at = self.folder / "delivered.caf"
                self._record = self._open.enter_context(
                    Draft(at, at, round(self._head.fs), self._channels, "CAF", "FLOAT")
                )
        except (OSError, ValueError) as e:
            self._open.close()
            if isinstance(e, StimlibError):
                raise
            raise SinkError(
                f"cannot make the log {self.folder}: {getattr(e, 'strerror', None) or e}"
            ) from e

    def _new(self, name: str) -> Any:
        return self._open.enter_context(open(self.folder / name, "xb", buffering=0))

    def __exit__(self, *exception: object) -> None:
        self.close()

    def motion(self, x: NDArray[np.float64]) -> None:
        """Append the motion of the samples produced next, shape (n_inputs, n).

        The samples may have been delivered or lost.
        """
        if self._motion is None:
            return
        if x.ndim != 2 or len(x) != self._inputs or x.dtype != np.float64:
            raise BadValue(
                f"log: motion must be float64 of shape ({self._inputs}, n); got {x.dtype} {x.shape}"
            )
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
        """Append frames, shape (n, channels), as delivered to the device."""
        if frames.ndim != 2 or frames.shape[1] != self._channels or frames.dtype != np.float32:
            raise BadValue(
                f"log: frames must be float32 of shape (n, {self._channels}); got {frames.dtype}"
                f" {frames.shape}"
            )
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

        ``set`` has name, value and ramp (in samples, as applied). ``lost`` has the
        number of frames from ``at`` on that were produced but not delivered. ``gap``
        has the number of frames that the log does not cover. Other events are kept
        unchanged.
        """
        self._check()
        event = {"at": at, "kind": kind} | data
        if kind in ("hash", "motion") or not COUNT(_plain_int(at)):
            raise BadValue(
                f"log: event {event}: the log writes hashes itself; 'at' is a sample index"
            )
        if kind in ("lost", "gap"):
            free = max([self._at, *(j["at"] + j["frames"] for j in self._jumps)])
            few = fields.whole(int(MAX_LOST * self._head.fs))
            if at < free or not few(_plain_int(data.get("frames"))):
                raise BadValue(
                    f"log: event {event}: frames up to {free} are accounted for; 'frames' is a"
                    " number of samples"
                )
            self._jumps.append(event)
            self._jump()
        else:
            self._line(event)

    def close(self, report: Mapping[str, Any] | None = None) -> None:
        """Close the log; with a report, mark it as cleanly ended.

        The report is JSON data with the number of samples ``produced``.
        """
        try:
            if self._error is None and not self._events.closed:
                self._hash()
                self._hash_motion()
                if report is not None:
                    text = json.dumps(report, indent=1, allow_nan=False, default=_plain) + "\n"
                    safe_files.publish(self.folder / "report.json", text)
        except SinkError:
            raise
        except OSError as e:
            self._fail(e)
        finally:
            self._end()

    def _jump(self) -> None:
        """Skip lost frames where they begin."""
        while self._jumps and self._jumps[0]["at"] == self._at:
            self._hash()
            self._line(self._jumps[0])
            jump = self._jumps.pop(0)
            self._at = self._from = int(jump["at"] + jump["frames"])

    def _hash(self) -> None:
        self._hashed("hash", self._from, self._at, self._digest)
        self._from, self._digest = self._at, hashlib.sha256()

    def _hash_motion(self) -> None:
        self._hashed("motion", self._rows_from, self._rows, self._seen)
        self._rows_from, self._seen = self._rows, hashlib.sha256()

    def _hashed(self, kind: str, at: int, to: int, digest: Any) -> None:
        if to > at:
            self._line({"at": at, "kind": kind, "to": to, "sha256": digest.hexdigest()})

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
            self._error = SinkError(
                f"cannot write the log {self.folder}: {getattr(e, 'strerror', None) or e}"
            )
        self._end()
        raise self._error from e

    def _end(self) -> None:
        """Close the files with their current contents."""
        with suppress(OSError):
            self._open.close()


@public
def header(
    scene: Scene,
    safety: Safety,
    fs: float,
    *,
    seed: int = 0,
    params: Mapping[str, float] | None = None,
    channels: list[str | None] | None = None,
    device: str = "",
    block: int | None = 0,
    started: str = "",
) -> dict[str, Any]:
    """Return the header of a session log, as JSON data.

    Parameters
    ----------
    scene : Scene
        Without the safety stage.
    safety : Safety
    fs : float
        Hz.
    seed, params
        Seed and parameters of the run; params differ from the scene's at the start.
    channels : list of str or None, optional
        The output of each channel of the device, None for silence; by default every
        output in order.
    device, block, started
        Information for a reader, without effect on a replay.

    Returns
    -------
    dict
    """
    made = protect(scene, safety)
    named = {**made.inputs, **made.params, **made.outputs}
    versions = {p: metadata.version(p) for p in ("numpy", "scipy", "llvmlite")}
    return {
        "stimlib": __version__,
        "versions": {"python": platform.python_version(), **versions},
        "scene": scene.to_dict(),
        "scene_hash": scene.hash,
        "definitions": definitions.definitions(scene),
        "fs": float(fs),
        "seed": seed,
        "params": dict(params or {}),
        "safety": safety.to_dict(),
        "inputs": list(made.program.inputs),
        "outputs": list(made.outputs),
        "units": {name: str(b.dim) for name, b in named.items()},
        "channels": list(made.outputs) if channels is None else channels,
        "device": device,
        "block": block or 0,  # as where a device chooses anew each time
        "started": started,
    }


def _plain_int(v: Any) -> Any:
    return int(v) if isinstance(v, np.integer) else v


def _plain(v: Any) -> Any:
    if isinstance(v, np.generic):
        return v.item()
    raise ValueError(f"{type(v).__name__} is not JSON data")
