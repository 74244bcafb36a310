"""The file sink: a processor's outputs in an audio file, and back.

Every file NAME has a sidecar NAME.json that says what the samples are, because no audio format has room for a unit.
Both are complete or absent: they are written beside their place and moved there at the end. The bytes of both depend
on the signal and on the versions in the sidecar only; there are no dates in them.

While a file is written, NAME.part has its samples so far and NAME.part.json says what they are. The header of NAME.part is
kept up to date, so a run that is killed leaves a file that can be read; `recover` makes NAME of it.
"""

import hashlib
import json
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import definitions, fields, regular
from ..core.bounds import limits
from ..core.program import warn_beyond
from ..errors import BadValue, FaultError, SinkError, UnitError, shown
from ..motion.source import check_names, frames_of, sources_of
from ..run.processor import Processor
from ..run.rendering import Rendering, fault_text
from ..run.walk import rows_of, walk
from ..version import __version__
from .draft import PIECE, TYPES, Draft, disk, fill, move, reading, reason, sha256, soundfile

Array = NDArray[np.float64]

# format of libsndfile -> subtypes that we write, the default first
FORMATS = {
    "WAV": ("FLOAT", "DOUBLE"),
    "RF64": ("FLOAT", "DOUBLE"),
    "W64": ("FLOAT", "DOUBLE"),
    "CAF": ("FLOAT", "DOUBLE"),
    "FLAC": ("PCM_24",),
}
BYTES = {"FLOAT": 4, "DOUBLE": 8, "PCM_24": 3}
MAX_WAV = 2**32 - 4096  # bytes of samples; the sizes in a WAV header have 32 bits, and 4096 is ample for the rest
NEARLY = 1.79e308  # the largest float less more than what rounding a sample adds to it
STEP = 0.25  # s of signal that is written at once, at most: what a killed run can lose
# NAME.part of a format whose header cannot be kept up to date: FLAC is coded when all is there
JOURNAL = {"FLAC": "CAF"}
# libsndfile stops at 1024; a CAF file with 400 channels is damaged by libsndfile 1.2.2
MAX_CHANNELS = {"WAV": 1024, "RF64": 1024, "W64": 1024, "CAF": 256, "FLAC": 8}

_COUNT = fields.whole(2**53)
_CHANNEL = {"name": fields.text, "unit": fields.text, "full_scale": fields.positive}
_CHANGE = {"at": _COUNT, "name": fields.text, "value": fields.number, "ramp": fields.not_negative}
BEGUN: dict[str, fields.Test] = {  # what a sidecar says of a file that is being written
    "stimlib": fields.text,
    "format": fields.one_of(*FORMATS),
    "subtype": fields.one_of(*BYTES),
    "fs": fields.between(1, 2**31 - 1),
    "frames": _COUNT,
    "channels": fields.list_of(fields.record(_CHANNEL)),
    "seed": fields.whole(2**64 - 1),
    "params": fields.table_of(fields.number),
    "index": _COUNT,
    "log": fields.list_of(fields.record(_CHANGE)),
    "motion": fields.table_of(fields.text),
    "scene": fields.table,
    "scene_hash": fields.text,
    "definitions": definitions.TEST,
}
_RECOVERED = {"recovered": fields.record({"frames": _COUNT})}
DONE: dict[str, fields.Test] = BEGUN | {  # and of one that is complete
    "channels": fields.list_of(fields.record(_CHANNEL | {"clips": fields.maybe(_COUNT), "peak": fields.not_negative})),
    "sha256": fields.maybe(fields.text),
    "versions": fields.table_of(fields.maybe(fields.text)),
    "file_sha256": fields.text,
}


@dataclass(frozen=True)
class FileReport:
    """What `write` wrote; its str is one line.

    Attributes
    ----------
    path : Path
        The audio file.
    frames : int
        Samples per output.
    seconds : float, s
        frames / fs.
    clips : dict of str to int
        Per output, how many samples were limited to full scale; 0 in formats that hold floats, None where a FLAC file was
        recovered.
    peak : dict of str to float
        Per output, the largest absolute value, in the output's unit; of the samples as stored where they were recovered.
    sidecar : Path
        The JSON file.

    Examples
    --------
    >>> print(FileReport(Path("a.wav"), 8000, 1.0, {"force": 0}, {"force": 40.0}, Path("a.wav.json")))
    a.wav: 8000 frames, 1 s, peak force 40
    """

    path: Path
    frames: int
    seconds: float
    clips: dict[str, int | None]
    peak: dict[str, float]
    sidecar: Path

    def __str__(self) -> str:
        peaks = ", ".join(f"{name} {value:.4g}" for name, value in self.peak.items())
        clips = ", ".join(f"{name} {count}" for name, count in self.clips.items() if count)
        line = f"{self.path}: {self.frames} frames, {self.seconds:.6g} s, peak {peaks}"
        return shown(line + (f", samples clipped: {clips}" if clips else ""))


def write(
    path: str | os.PathLike[str],
    proc: Processor,
    motion: Mapping[str, Callable[[Array], Any] | NDArray[Any]],
    seconds: float,
    *,
    format: str | None = None,
    subtype: str | None = None,
    full_scale: float | Mapping[str, float] | None = None,
    block: int = 8192,
    progress: bool | str = True,
    overwrite: bool = True,
) -> FileReport:
    """Run a processor over a motion and write its outputs to an audio file with a sidecar.

    The processor goes on from the state it is in; time 0 of the motion is the first sample written. The file's samples
    are value / full_scale: rounded once to float32 in FLOAT, as they are in DOUBLE. In FLAC they are the 24-bit codes
    rint(value / full_scale * 2**23), half to even, limited to -2**23 .. 2**23 - 1; the samples limited are counted.

    Memory does not grow with the duration. What was written is read back and compared before it gets its name. If anything
    fails, or on an interrupt, whatever was at ``path`` before is still there and nothing is left beside it. A run that is
    killed outright leaves ``path`` + ".part", of which `recover` makes a file; it lacks a quarter of a second at most.

    Parameters
    ----------
    path : path
        Where to write; the sidecar is ``path`` + ".json". The suffix says the format: .wav (up to 4 GiB), .rf64, .w64,
        .caf or .flac.
    proc : Processor
        x (n_inputs, n) -> y (n_outputs, n); one channel per output, in the processor's order.
    motion : mapping of input name to function or array
        Per input of the processor, a function of time (array of n/fs in s -> array of the same shape, in the input's
        unit), or an array, one value per sample, at least as long as the file.
    seconds : float, s
        Duration, rounded to whole samples.
    format : {"wav", "rf64", "w64", "caf", "flac"}, optional
        Format, if the suffix does not say it.
    subtype : {"FLOAT", "DOUBLE", "PCM_24"}, optional
        FLOAT (default) or DOUBLE; PCM_24 in FLAC.
    full_scale : float or mapping of output name to float, optional
        Value, in the output's unit, that is 1.0 in the file; 1 in the output's unit by default. One number serves all
        outputs only if they have the same unit. FLAC needs it: it has nothing above full scale.
    block : int
        Samples per call of the processor; no effect on the bytes.
    progress : bool or "always"
        A progress bar on stderr: True if that is a terminal, "always" even if not, False never.
    overwrite : bool
        Whether a file that exists may be replaced; a link there is replaced, not followed. If not, a file that comes while
        this one is written is left alone too.

    Returns
    -------
    FileReport

    Raises
    ------
    BadValue
        A number out of range, or a motion of the wrong shape or not finite.
    UnknownName
        An input without a motion, or a motion or full scale for something that does not exist.
    UnitError
        One full scale for outputs with different units.
    SinkError
        The place cannot be written, or is just being written by another run; the disk is full; the format cannot hold the
        signal; another program changed the file while it was written; a link or a pipe has one of the names NAME.part,
        NAME.part.json, NAME.new.part and NAME.json.part.
    FaultError
        The processor reports a fault; no file is written.

    Warns
    -----
    RuntimeWarning
        Samples pass full scale: a float format keeps them, and players and most sound cards clip them; FLAC has clipped them.

    Examples
    --------
    >>> import stimlib, tempfile
    >>> scene = stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")})
    >>> spring = stimlib.compile(scene, fs=8000)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = write(folder + "/spring.wav", spring, {"x": lambda t: 0.02 * t}, seconds=1.0, full_scale=50.0)
    ...     y, sidecar = read(folder + "/spring.wav")
    >>> report.frames, round(report.peak["force"], 3)
    (8000, 39.995)
    >>> y.shape, sidecar["channels"][0]["unit"]
    ((1, 8000), 'N')
    """
    if isinstance(block, bool) or not isinstance(block, int | np.integer) or block < 1:
        raise BadValue(f"block must be a whole number of samples above 0, got {block!r}")
    frames = frames_of(seconds, proc.fs)

    def blocks(sources: dict[str, Any], most: int) -> Iterator[Array]:
        return (y for _, y in walk(proc, rows_of(sources, proc.fs), frames, block=min(int(block), most)))

    return _write(Path(path), proc, motion, frames, blocks, format, subtype, full_scale, progress, overwrite)


def save(
    path: str | os.PathLike[str],
    rendering: Rendering,
    *,
    format: str | None = None,
    subtype: str | None = None,
    full_scale: float | Mapping[str, float] | None = None,
    progress: bool | str = False,
    overwrite: bool = True,
) -> FileReport:
    """Write the samples of a rendering as `write` would have written them; ``Rendering.save`` is this.

    Parameters
    ----------
    path : path
        Where to write; the sidecar is ``path`` + ".json".
    rendering : Rendering
    format, subtype, full_scale, progress, overwrite
        As in `write`.

    Returns
    -------
    FileReport

    Raises
    ------
    BadValue, UnitError, SinkError
        As `write`.
    FaultError
        An output of the rendering was not finite; no file is written.

    Examples
    --------
    >>> import numpy as np, stimlib, tempfile
    >>> scene = stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")})
    >>> rendering = stimlib.render(scene, {"x": np.array([0.0, 0.01])}, fs=8000)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = save(folder + "/spring.wav", rendering, subtype="DOUBLE")
    ...     read(folder + "/spring.wav")[0]
    array([[ 0., 20.]])
    """
    path, y, frames = Path(path), rendering.y, rendering.y.shape[1]
    if rendering.fault is not None:
        raise FaultError(fault_text(*rendering.fault, rendering.fs, f"{path} was not written"))
    proc = Processor(rendering.scene, rendering.fs, seed=rendering.seed)  # for what it says: it does not run
    for name, value in rendering.params.items():
        if value != proc.params[name]:
            proc.set(name, value, ramp=0.0)

    def blocks(sources: dict[str, Any], most: int) -> Iterator[Array]:
        return (y[:, at : at + most] for at in range(0, frames, most))

    return _write(path, proc, rendering.motion, frames, blocks, format, subtype, full_scale, progress, overwrite)


def _write(
    path: Path,
    proc: Processor,
    motion: Mapping[str, Any],
    frames: int,
    blocks: Callable[[dict[str, Any], int], Iterator[Array]],
    format: str | None,
    subtype: str | None,
    full_scale: float | Mapping[str, float] | None,
    progress: bool | str,
    overwrite: bool,
) -> FileReport:
    """Check, and write what blocks(checked motion, most samples) gives."""
    format, subtype = _format(path, format, subtype)
    _check_format(format, subtype, proc.fs, len(proc.outputs), frames)
    sources = sources_of(motion, proc.inputs, frames)
    scales = _full_scales(full_scale, proc, format)
    if not (isinstance(progress, bool) or progress == "always"):
        raise BadValue(f"progress must be True, False or 'always', got {progress!r}")
    _check_place(path, _sidecar(path), overwrite)
    warn_beyond(proc.program, proc.fs, frames)
    if proc.fault is not None:
        name, index = proc.fault
        raise FaultError(f"output {name} stopped earlier, at sample {index} of the processor: reset it; {path} was not written")

    info: dict[str, Any] = {
        "stimlib": __version__,
        "format": format,
        "subtype": subtype,
        "fs": proc.fs,
        "frames": frames,
        "channels": [
            {"name": n, "unit": proc.units[n], "full_scale": s} for n, s in zip(proc.outputs, scales.tolist(), strict=True)
        ],
        "seed": proc.seed,
        "params": dict(proc.params),
        "index": proc.index,
        "log": [change._asdict() for change in proc.log],
        "motion": {name: _describe(source) for name, source in sources.items()},
        "scene": proc.scene.to_dict(),
        "scene_hash": proc.scene.hash,
        "definitions": definitions.definitions(proc.scene),
    }
    parts = blocks(sources, max(1, int(STEP * proc.fs)))

    def run(draft: Draft) -> tuple[NDArray[np.int64], Array, str]:
        return _run(draft, proc, parts, frames, subtype, scales, progress)

    report = _whole(path, info, run, overwrite)
    if beyond := _beyond(report, info):
        warnings.warn(beyond, RuntimeWarning, stacklevel=2)
    return report


def _beyond(report: FileReport, info: dict[str, Any]) -> str:
    """Which outputs pass full scale, what becomes of them, and the remedy; empty where none does."""
    peaks = {c["name"]: report.peak[c["name"]] for c in info["channels"]}
    passed = [c for c in info["channels"] if peaks[c["name"]] > c["full_scale"]]
    if not passed:
        return ""
    told = ", ".join(f"{c['name']} reaches {peaks[c['name']]:.4g} {c['unit']} of {c['full_scale']:g}" for c in passed)
    if len({c["unit"] for c in info["channels"]}) == 1:
        needed = f"{1.01 * max(peaks.values()):.3g}"
    else:
        needed = ", ".join(f"{name}: {1.01 * peak:.3g}" for name, peak in peaks.items() if peak > 0)
    then = "players clip there, though the file does not" if info["subtype"] != "PCM_24" else "the file is clipped there"
    return shown(f"{report.path}: samples pass full scale ({told}); {then}: give a full scale (--full-scale) of {needed}")


def write_frames(path: str | os.PathLike[str], blocks: Iterable[NDArray[np.float32]], info: dict[str, Any]) -> FileReport:
    """Write frames as they are, such as those that a device was given, with the laws of `write`.

    Parameters
    ----------
    path : path
        With a suffix of a format that holds floats.
    blocks : iterable of ndarray of float32, shape (n, channels)
    info : dict
        The sidecar, with fs, frames and channels (a list of name, unit, full_scale); it is completed here, as that of a file
        without a scene.

    Returns
    -------
    FileReport

    Raises
    ------
    SinkError
        As `write`.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> info = {"fs": 8000.0, "frames": 2, "channels": [{"name": "force", "unit": "N", "full_scale": 50.0}]}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = write_frames(folder + "/a.wav", [np.float32([[0.5], [1.0]])], info)
    ...     read(folder + "/a.wav")[0]
    array([[25., 50.]])
    """
    path = Path(path)
    floats = [f".{name.lower()}" for name, subtypes in FORMATS.items() if "FLOAT" in subtypes]
    if path.suffix.lower() not in floats:
        raise SinkError(f"frames are floats and are written as they are: {path.name!r} must end in one of {', '.join(floats)}")
    format, subtype = _format(path, None, "FLOAT")
    fs, frames, names = info["fs"], info["frames"], [c["name"] for c in info["channels"]]
    _check_format(format, subtype, fs, len(names), frames)
    _check_place(path, _sidecar(path), True)
    blank: dict[str, Any] = {"stimlib": __version__, "format": format, "subtype": subtype, "seed": 0, "params": {}, "index": 0}
    blank |= {"log": [], "motion": {}, "scene": {}, "scene_hash": "", "definitions": {}}
    scales = np.array([c["full_scale"] for c in info["channels"]])

    def run(draft: Draft) -> tuple[NDArray[np.int64], Array, None]:
        peak = np.zeros(len(names))
        for part in blocks:
            draft.put(part)
            peak = np.maximum(peak, np.abs(part).max(axis=0, initial=0.0) * scales)
        return np.zeros(len(names), dtype=np.int64), peak, None

    return _whole(path, blank | info, run, True)


Run = Callable[[Draft], tuple[NDArray[np.int64], Array, str | None]]


def _whole(path: Path, info: dict[str, Any], run: Run, overwrite: bool) -> FileReport:
    """Let run fill NAME.part, and put it and its sidecar to their places, or nothing."""
    part, format = _part(path), info["format"]
    try:
        with _locked(path) as begun, ExitStack() as stack:
            _remove(_new(path), _part(_sidecar(path)))  # of a run that was killed
            with disk(path):
                fill(begun, _text(info))
            draft = stack.enter_context(_draft(path, part, info, JOURNAL.get(format, format)))
            clips, peak, info["sha256"] = run(draft)
            if draft.frames != info["frames"]:
                raise SinkError(f"cannot write {path}: {draft.frames} frames came, {info['frames']} were told")
            for c, clipped, largest in zip(info["channels"], clips, peak, strict=True):
                c |= {"clips": int(clipped), "peak": float(largest)}
            if format in JOURNAL:
                draft.finish()
                coded = stack.enter_context(_draft(path, _new(path), info, format))
                _copy(part, draft.raw, coded, info)
                draft.same(coded)
                draft = coded
            _move(draft, path, info, overwrite)
            _remove(part, _sidecar(part))
    except BaseException:
        _clean(path)
        raise
    return _report(path, info)


def _draft(path: Path, at: Path, info: dict[str, Any], format: str) -> Draft:
    return Draft(path, at, int(info["fs"]), len(info["channels"]), format, info["subtype"])


def recover(path: str | os.PathLike[str], to: str | os.PathLike[str] | None = None, *, overwrite: bool = False) -> FileReport:
    """Make a file of what a run of `write` left when it was killed.

    The samples are those that `write` would have written in a shorter run, and so are the file's bytes. Its sidecar says
    ``"recovered"``: the frames that were wanted. In it, sha256 (of the signal before it was rounded) and, for FLAC, the number
    of samples clipped are None, since nobody knows them; peak is that of the samples as stored. `read` takes the
    file, and ``stimlib verify`` proves it, like any other.

    Parameters
    ----------
    path : path
        The file that was to be written; what is left is ``path`` + ".part" and ``path`` + ".part.json".
    to : path, optional
        Where to write instead, with the same suffix.
    overwrite : bool
        Whether a file that exists may be replaced.

    Returns
    -------
    FileReport

    Raises
    ------
    SinkError
        There is nothing to recover, or not one sample; the run is still alive; what is left was changed; a file is there
        already; the place cannot be written. What is left stays there then.

    Examples
    --------
    >>> recover("missing.wav")
    Traceback (most recent call last):
    stimlib.errors.SinkError: nothing to recover: there is no missing.wav.part
    """
    path = Path(path)
    if path.suffix == ".part":
        path = path.with_suffix("")
    to = path if to is None else Path(to)
    if to.suffix.lower() != path.suffix.lower():
        raise SinkError(f"{to} must end in {path.suffix!r}, as the file that was to be written")
    if (done := _finish_move(path)) is not None:
        return done
    part, sidecar = _part(path), _sidecar(_part(path))
    if not os.path.lexists(part):
        log = "; a log needs nothing, see stimlib replay" if os.path.isfile(path / "session.json") else ""
        raise SinkError(f"nothing to recover: there is no {part}{log}")
    _load_sidecar(part, sidecar, BEGUN)
    with _locked(path), ExitStack() as stack:
        info = _load_sidecar(part, sidecar, BEGUN)
        _check_place(to, _sidecar(to), overwrite)
        raw = stack.enter_context(open(regular.opened(part, os.O_RDWR), "rb", buffering=0))
        info |= {"sha256": None, "recovered": {"frames": info["frames"]}, "frames": _frames_left(part, raw, info)}
        draft = stack.enter_context(_draft(to, _new(to), info, info["format"]))
        try:
            peak = _copy(part, raw, draft, info)
            for c, largest in zip(info["channels"], peak, strict=True):
                c |= {"clips": None if info["subtype"] == "PCM_24" else 0, "peak": float(largest)}
            _move(draft, to, info, overwrite)
        except BaseException:
            _remove(_new(to), _part(_sidecar(to)))
            raise
        _remove(part, sidecar)
    return _report(to, info)


def _frames_left(part: Path, raw: Any, info: dict[str, Any]) -> int:
    """Frames of an open file that a run left, which must be of the kind that its sidecar says."""
    try:
        with reading(raw) as f:
            found = (f.samplerate, f.channels, f.format, f.subtype)
            frames = int(f.frames)
    except soundfile().SoundFileError as e:
        raise SinkError(f"nothing to recover: {part} has no samples yet, or was damaged ({reason(e)}); remove it") from e
    wanted = (info["fs"], len(info["channels"]), JOURNAL.get(info["format"], info["format"]), info["subtype"])
    if found != wanted:
        raise SinkError(f"{_sidecar(part)} does not belong to {part}: it says {wanted}, the file is {found}")
    if not 0 < frames <= info["frames"]:
        raise SinkError(f"nothing to recover: {part} has {frames} of {info['frames']} frames; remove it")
    _check_size(part, raw, frames, len(info["channels"]))
    return frames


def _check_size(path: Path, raw: Any, frames: int, channels: int) -> None:
    """Neither the bytes of a file nor those of its samples in memory may be more than is meant."""
    limits.check("audio_bytes", 8.0 * frames * channels, f"{path}: bytes of samples in memory", SinkError)
    limits.check("audio_bytes", os.fstat(raw.fileno()).st_size, f"{path}: bytes", SinkError)


def _report(path: Path, info: dict[str, Any]) -> FileReport:
    clips, peak = ({c["name"]: c[what] for c in info["channels"]} for what in ("clips", "peak"))
    return FileReport(path, info["frames"], info["frames"] / info["fs"], clips, peak, _sidecar(path))


def read(path: str | os.PathLike[str]) -> tuple[Array, dict[str, Any]]:
    """Read a file that `write` wrote, in physical units, and check it against its sidecar.

    Parameters
    ----------
    path : path
        The audio file.

    Returns
    -------
    y : ndarray of float64, shape (n_outputs, frames)
        The file's samples times full scale, in the units of ``sidecar["channels"]``. With a full scale that is a power
        of two, DOUBLE gives back every bit of the signal and FLOAT its float32 rounding.
    sidecar : dict
        stimlib (version), format, subtype, fs (Hz), frames, channels (a list of name, unit, full_scale, clips, peak),
        seed, params (when the file began), index (samples that the processor had done before), log (what `Processor.set`
        had changed, the `Change`s), motion, scene, scene_hash, definitions (the files of your own blocks: a record),
        versions, sha256 (of the signal before it was scaled and rounded: the float64 values in physical units,
        little-endian, all outputs of sample 0, then of sample 1, ...) and file_sha256 (of the audio file). With index 0,
        scene, seed, log and motion give the signal again. A file that was
        recovered also has recovered; see `recover`.

    Raises
    ------
    SinkError
        When a file is missing, cannot be read, is truncated, or does not belong to its sidecar.

    Examples
    --------
    See `write`.

    >>> read("missing.wav")
    Traceback (most recent call last):
    stimlib.errors.SinkError: there is no file missing.wav
    """
    path = Path(path)
    sidecar = _sidecar(path)
    if not os.path.isfile(path):
        raise SinkError(f"there is no file {path}{_hint(path)}")
    info = _load_sidecar(path, sidecar)
    frames, scales = info["frames"], np.array([c["full_scale"] for c in info["channels"]])
    try:
        with open(regular.opened(path), "rb", buffering=0) as raw, reading(raw) as f:
            if (f.samplerate, f.channels) != (info["fs"], len(scales)):
                raise SinkError(
                    f"{sidecar} does not belong to {path}: it says {len(scales)} channels at {info['fs']:g} Hz, "
                    f"the file has {f.channels} at {f.samplerate} Hz"
                )
            # a FLAC file whose end was never written says 2**63 - 1 frames
            if f.frames < frames or f.frames == 2**63 - 1:
                raise SinkError(f"{path} is truncated: {sidecar} says {frames} frames, the file has fewer")
            if f.frames > frames:
                raise SinkError(f"{sidecar} does not belong to {path}: {frames} frames against {f.frames}")
            _check_size(path, raw, frames, len(scales))
            if sha256(raw) != info["file_sha256"]:
                raise SinkError(f"{sidecar} does not belong to {path}, or the file was changed: file_sha256 differs{_hint(path)}")
            if f.subtype != info["subtype"]:
                raise SinkError(f"{sidecar} does not belong to {path}: {info['subtype']} against {f.subtype}")
            return _samples(path, f, scales, frames), info
    except soundfile().SoundFileError as e:
        raise SinkError(f"{path} cannot be read: it is damaged, truncated or not an audio file ({reason(e)})") from e


def told(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The sidecar of a file alone, checked; see `read`, which compares it with the file too.

    Raises
    ------
    SinkError
        It is missing, or stimlib did not write it.
    """
    return _load_sidecar(Path(path), _sidecar(Path(path)))


def _samples(path: Path, f: Any, scales: Array, frames: int) -> Array:
    """All samples of an open sound in physical units, (n_outputs, frames)."""
    try:
        y = np.empty((len(scales), frames))
    except MemoryError:
        raise SinkError(f"{path}: {frames} frames of {len(scales)} channels do not fit into memory") from None
    at = 0
    while at < frames:
        part = f.read(PIECE, dtype="int32" if f.subtype == "PCM_24" else "float64", always_2d=True)
        if not len(part):
            raise SinkError(f"{path} is truncated: {frames} frames wanted, {at} can be read")
        y[:, at : at + len(part)] = _physical(part, scales)
        at += len(part)
    if not np.isfinite(y).all():
        raise SinkError(f"{path} has samples that are not finite: stimlib did not write it")
    return y


def stored(y: Array, sidecar: dict[str, Any]) -> Array:
    """What `read` gives back of a signal that was written with this sidecar's format: its rounding, nothing else.

    Parameters
    ----------
    y : ndarray of float64, shape (n_outputs, n)
    sidecar : dict

    Returns
    -------
    ndarray of float64, shape (n_outputs, n)

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.files.audio import stored
    >>> stored(np.array([[0.1]]), {"subtype": "PCM_24", "channels": [{"name": "f", "full_scale": 1.0}]})
    array([[0.10000002]])
    """
    scales = np.array([c["full_scale"] for c in sidecar["channels"]])
    samples, _ = _encode(y, scales, sidecar["subtype"], tuple(c["name"] for c in sidecar["channels"]))
    return _physical(samples, scales)


def _physical(samples: NDArray[Any], scales: Array) -> Array:
    """Samples (n, n_outputs) of a file in physical units, (n_outputs, n)."""
    with np.errstate(over="ignore", invalid="ignore"):  # of files that stimlib did not write
        values = samples * 2.0**-31 if samples.dtype == np.int32 else samples.astype(np.float64, copy=False)
        return np.ascontiguousarray((values * scales).T)


# -- what may be written where


def _sidecar(path: Path) -> Path:
    return path.with_name(path.name + ".json")


def _part(path: Path) -> Path:
    return path.with_name(path.name + ".part")


def _new(path: Path) -> Path:
    """A copy on its way to its place: a FLAC file being coded, or a file being recovered."""
    return path.with_name(path.name + ".new.part")


def _remove(*paths: Path) -> None:
    for p in paths:
        with suppress(OSError):
            p.unlink()


def _format(path: Path, format: str | None, subtype: str | None) -> tuple[str, str]:
    name = (path.suffix[1:] if format is None else str(format).lstrip(".")).upper()
    if name not in FORMATS:
        known = ", ".join("." + f.lower() for f in FORMATS)
        what = f"suffix of {path.name!r}" if format is None else f"format {format!r}"
        raise SinkError(f"{what} is not known; write one of {known}")
    sub = FORMATS[name][0] if subtype is None else str(subtype).upper()
    if sub not in FORMATS[name]:
        raise SinkError(f"{name} is written with subtype {' or '.join(FORMATS[name])}, not {subtype!r}")
    return name, sub


def _check_format(format: str, subtype: str, fs: float, channels: int, frames: int) -> None:
    """Rate, channels and duration fit the format."""
    if not (fs.is_integer() and 1 <= fs < 2**31):
        raise SinkError(f"an audio file needs a whole number of samples per second, not fs = {fs!r} Hz")
    if format == "FLAC" and fs > 65535 and (fs > 655350 or fs % 10):
        raise SinkError(f"FLAC holds fs up to 65535 Hz, and multiples of 10 Hz up to 655350 Hz, not {fs:g} Hz")
    most = MAX_CHANNELS[format]
    if channels > most:
        raise SinkError(f"{format} holds up to {most} channels, not {channels}")
    size = frames * channels * BYTES[subtype]
    if format == "WAV" and size > MAX_WAV:
        raise SinkError(f"WAV holds at most 4 GiB, this needs {size / 2**30:.2f} GiB: write .rf64, .w64 or .caf")
    if format == "FLAC" and frames >= 2**36:
        raise SinkError(f"FLAC holds fewer than 2**36 frames, not {frames}")


def _check_place(path: Path, sidecar: Path, overwrite: bool) -> None:
    if not path.name or os.path.isdir(path):
        raise SinkError(f"{path} is a folder; give the name of a file in it")
    if not os.path.isdir(path.parent):
        raise SinkError(f"there is no folder {path.parent}; make it first")
    for p in (path, sidecar):
        if os.path.exists(p) and not os.path.isfile(p):
            raise SinkError(f"{p} is there and not an ordinary file")
        if os.path.lexists(p) and not overwrite:
            raise SinkError(f"{p} is there already, and overwrite=False")
    for p in (_part(path), _sidecar(_part(path)), _new(path), _part(sidecar)):
        regular.check(p)
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise SinkError(f"folder {path.parent} is not writable")


def _full_scales(full_scale: float | Mapping[str, float] | None, proc: Processor, format: str) -> Array:
    outputs = proc.outputs
    units = {proc.units[name] for name in outputs}
    if full_scale is None and format == "FLAC":
        unit = next(iter(units)) if len(units) == 1 else "each output's unit, by name"
        raise BadValue(f"FLAC has no samples above full scale: give full_scale, in {unit}")
    if isinstance(full_scale, Mapping):
        check_names("full_scale", full_scale, outputs, "output")
        values = [full_scale[name] for name in outputs]
    else:
        if full_scale is not None and len(units) > 1:
            has = ", ".join(f"{name} ({proc.units[name]})" for name in outputs)
            raise UnitError(f"outputs have different units: {has}; give full_scale as a mapping by output name")
        values = [1.0 if full_scale is None else full_scale] * len(outputs)
    try:
        scales = np.array([float(v) for v in values], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise BadValue(f"full_scale must be a number or a mapping by output name, got {full_scale!r}") from None
    if not (np.isfinite(scales) & (scales > 0)).all():
        raise BadValue(f"full_scale must be finite and above 0, got {full_scale!r}")
    return scales


# -- the run


def _run(
    draft: Draft,
    proc: Processor,
    blocks: Iterable[Array],
    frames: int,
    subtype: str,
    scales: Array,
    progress: bool | str,
) -> tuple[NDArray[np.int64], Array, str]:
    """Write the samples beside their place; clips and peaks per output, and the hash of the signal."""
    outputs, fs, first = proc.outputs, proc.fs, proc.index
    clips = np.zeros(len(outputs), dtype=np.int64)
    peak = np.zeros(len(outputs))
    digest = hashlib.sha256()
    with _bar(frames, progress) as advance:
        for y in blocks:
            if proc.fault is not None:
                name, index = proc.fault
                raise FaultError(fault_text(name, index - first, fs, f"{draft.path} was not written"))
            digest.update(np.ascontiguousarray(y.T, dtype="<f8").data)
            peak = np.maximum(peak, np.abs(y).max(axis=1))
            samples, clipped = _encode(y, scales, subtype, outputs)
            if peak.max() > NEARLY and not (good := np.isfinite(_physical(samples, scales)).all(axis=1)).all():
                name = outputs[int(np.argmin(good))]
                remedy = "use DOUBLE and a power of two up to 2.0**1023 as full_scale"
                raise SinkError(f"output {name} is too near the largest float to be read back from {subtype}: {remedy}")
            clips += clipped
            draft.put(samples)
            advance(y.shape[1])
    return clips, peak, digest.hexdigest()


def _copy(source: Path, raw: Any, draft: Draft, info: dict[str, Any]) -> Array:
    """Put the frames of an open file that info tells into a draft; the peak per output."""
    frames, scales = info["frames"], np.array([c["full_scale"] for c in info["channels"]])
    peak = np.zeros(len(scales))
    try:
        with reading(raw) as f:
            while draft.frames < frames:
                part = f.read(min(8192, frames - draft.frames), dtype=TYPES[info["subtype"]], always_2d=True)
                if not len(part):
                    raise SinkError(f"{source} is truncated: {frames} frames wanted, {draft.frames} can be read")
                draft.put(part)
                peak = np.maximum(peak, np.abs(_physical(part, scales)).max(axis=1))
    except soundfile().SoundFileError as e:
        raise SinkError(f"{source} cannot be read to its end, it was damaged ({reason(e)})") from e
    if not np.isfinite(peak).all():
        raise SinkError(f"{source} has samples that are not finite: it was damaged")
    return peak


def _encode(y: Array, scales: Array, subtype: str, outputs: tuple[str, ...]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Samples as they go to libsndfile, (n, n_outputs), and how many were limited per output."""
    with np.errstate(over="ignore"):
        v = y.T / scales
        if subtype == "PCM_24":
            codes = np.rint(v * 2.0**23)
            limited = np.minimum(np.maximum(codes, -(2.0**23)), 2.0**23 - 1)
            # libsndfile keeps the upper 24 of the 32 bits as they are
            return np.left_shift(limited.astype(np.int32), 8, order="C"), (limited != codes).sum(axis=0)
        samples = np.ascontiguousarray(v, dtype=np.float32 if subtype == "FLOAT" else np.float64)
    if not np.isfinite(samples).all():
        name = outputs[int(np.argwhere(~np.isfinite(samples))[0][1])]
        raise SinkError(f"output {name} / full_scale is too large for {subtype}: use a larger full_scale")
    return samples, np.zeros(len(outputs), dtype=np.int64)


@contextmanager
def _bar(frames: int, progress: bool | str) -> Iterator[Callable[[int], None]]:
    """A progress bar; the function it gives is called with the samples just done."""
    if not progress or (progress is True and not (sys.stderr and sys.stderr.isatty())):
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("writing", total=frames)
        yield lambda done: bar.advance(task, done)


# -- the sidecar


def _describe(source: Any) -> str:
    if isinstance(source, np.ndarray):
        return f"array({len(source)})"
    # the address in the repr of a function would make two equal runs differ
    return re.sub(r" at 0x[0-9A-Fa-f]+", "", repr(source))


def _load_sidecar(path: Path, sidecar: Path, tests: dict[str, fields.Test] = DONE) -> dict[str, Any]:
    """What a sidecar says, checked."""
    if not os.path.lexists(sidecar):
        raise SinkError(f"{path} has no sidecar {sidecar.name}; without it units and full scale are not known{_hint(path)}")
    try:
        info = fields.parse(regular.read(sidecar, "sidecar_bytes"))
        fields.require(info, tests | _RECOVERED if "recovered" in info else tests)
        if info["subtype"] not in FORMATS[info["format"]] or not info["channels"] or info["fs"] != int(info["fs"]):
            raise ValueError("there is no file of that format, subtype, fs and channels")
    except ValueError as e:
        raise SinkError(f"{sidecar} is not a sidecar that stimlib wrote: {e}") from e
    return info


def _hint(path: Path) -> str:
    """What to do where a run that was killed left something."""
    left = next((p for p in (_part(path), _part(_sidecar(path))) if os.path.isfile(p)), None)
    return f"; a run that was killed left {left.name}: try stimlib recover {path}" if left else ""


def _text(info: dict[str, Any]) -> bytes:
    return (json.dumps(info, indent=1, allow_nan=False) + "\n").encode()


# -- to their places


def _clean(path: Path) -> None:
    """Remove what a run that failed left beside its place, if it is not another run's."""
    begun = _sidecar(_part(path))
    with suppress(OSError), open(regular.opened(begun, os.O_RDWR), "rb", buffering=0) as f:
        if _lock(f):
            _remove(_part(path), _new(path), _part(_sidecar(path)), begun)


def _move(draft: Draft, path: Path, info: dict[str, Any], overwrite: bool) -> None:
    """A file and its sidecar to their places, when it has been proven."""
    sidecar, ready = _sidecar(path), _part(_sidecar(path))
    info["versions"], info["file_sha256"] = _versions(), draft.seal()
    complete = False
    try:
        with disk(path):
            with open(regular.create(ready), "r+b", buffering=0) as f:
                fill(f, _text(info))
                os.fsync(f.fileno())
            complete = True
            draft.move(path, overwrite)
            try:
                move(ready, sidecar, overwrite)
            except SinkError:
                os.unlink(path)  # ours, and nothing without its sidecar
                raise
            regular.settle(path.parent)
    except BaseException:
        with suppress(OSError):
            if complete and draft.is_at(path):  # interrupted between the moves: the first cannot be taken back
                move(ready, sidecar, overwrite)
        raise


def _finish_move(path: Path) -> FileReport | None:
    """Of a run that was killed between the two moves, do the second."""
    ready = _part(_sidecar(path))
    if not (os.path.isfile(path) and os.path.isfile(ready)):
        return None
    try:
        info = _load_sidecar(path, ready)
        with open(regular.opened(path), "rb", buffering=0) as raw:
            _check_size(path, raw, info["frames"], len(info["channels"]))
            if sha256(raw) != info["file_sha256"]:
                return None
    except SinkError:
        return None
    with _locked(path):
        with disk(path):
            regular.check(ready)
            os.replace(ready, _sidecar(path))
        _remove(_part(path), _sidecar(_part(path)))
    return _report(path, info)


@contextmanager
def _locked(path: Path) -> Iterator[Any]:
    """NAME.part.json, open and held by us alone as long as we are at it; the system lets go of it when we are killed."""
    sidecar = _sidecar(_part(path))
    with ExitStack() as stack:
        with disk(path):
            while True:
                f = stack.enter_context(open(regular.opened(sidecar, os.O_RDWR | os.O_CREAT), "r+b", buffering=0))
                if not _lock(f):
                    raise SinkError(f"{path} is being written by another run")
                with suppress(FileNotFoundError):  # whoever had it just removed it
                    if os.path.samestat(os.fstat(f.fileno()), os.lstat(sidecar)):
                        break
        yield f


def _lock(f: Any) -> bool:
    """Whether nobody else holds the file; True where the system cannot tell."""
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(f, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _versions() -> dict[str, str | None]:
    sf = soundfile()
    return {
        "numpy": np.__version__,
        "numba": _version("numba"),
        "soundfile": sf.__version__,
        "libsndfile": sf.__libsndfile_version__,
    }
