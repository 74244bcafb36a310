"""The file sink: writes a processor's outputs to a sound file, and reads it back.

Every file NAME has a sidecar NAME.json that describes its samples, because no audio
format can store a unit. Both are written to temporary names and moved into place
together at the end, so both are complete or absent. Their bytes depend only on the
signal and on the versions in the sidecar; they contain no dates.
"""

from __future__ import annotations

import hashlib
import os
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import definitions
from ..core.graph import Input
from ..core.program import warn_beyond
from ..core.scene import Scene
from ..core.units import pretty
from ..errors import BadValue, Count, FaultError, SinkError, counted, outside, public, shown
from ..motion.source import Motion, frames_of, sources_of, warn_fast
from ..run.driver import rows_of, walk
from ..run.processor import Processor
from ..run.rendering import Rendering, fault_text
from ..system import safe_files
from ..system.limits import limits
from ..system.progress import progress as bar
from ..version import __version__
from .commit import Put, check_place, publish
from .formats import (
    BITS,
    BYTES,
    FORMATS,
    Array,
    check_format,
    encode,
    format_of,
    full_scales,
    interleaved,
    physical,
)
from .sidecar import FileReport, describe, load, read_of, sidecar_of
from .sound_file import PIECE, reading, reason, soundfile

STEP = 1.0  # s of signal that is written at once, at most
# in libsndfile's log, where a file is shorter than it says: the bytes stated and there
CUT = r"^ *(?:data|SSND|BODY|Data Size|riff|Riff size) *: (\d+) \(should be (\d+)\)"
DATA = r"^ *data : (\d+)"  # of CAF: the bytes stated, of which 4 count edits
LAWS = ("ULAW", "ALAW", "PCM_S8")  # subtypes of one byte
NEARLY = 1.79e308  # the largest float less more than what rounding a sample adds to it


@public
def write(
    path: str | os.PathLike[str],
    proc: Processor,
    motion: Motion | None = None,
    seconds: float | None = None,
    *,
    format: str | None = None,
    subtype: str | None = None,
    full_scale: float | str | Mapping[str, float] | None = None,
    dither: int | None = None,
    block: Count = 8192,
    progress: bool | str = True,
    overwrite: bool = True,
) -> FileReport:
    """Render a processor along a motion into an audio file with a sidecar.

    The processor continues from its current state; time 0 of the motion is the first
    sample written. The file's samples are value / full_scale: rounded once to float32
    in FLOAT, and exact in DOUBLE. In PCM_16, PCM_24 and PCM_32 they are the whole
    numbers rint(value / full_scale * 2**(bits - 1)), half to even, limited to the range
    of the format; limited samples are counted.

    Memory use does not grow with the duration. The written data are read back and
    compared before the file gets its name. After an error or an interrupt, a previous
    file at ``path`` is still there and no temporary file is left. A run that is killed
    outright leaves a file whose name ends in ".part", which nothing reads.

    Motion and processor run in the calling thread; hashing, encoding and writing run in
    other threads.

    Parameters
    ----------
    path : path
        Where to write; the sidecar is ``path`` + ".json". The suffix sets the format:
        .wav (up to 4 GiB), .rf64, .w64, .caf or .flac.
    proc : Processor
        x (n_inputs, n) -> y (n_outputs, n); one channel per output, in the processor's
        order.
    motion : mapping of input name to function or array
        Per input of the processor, a function of time (array of n/fs in s -> array of
        the same shape, in the input's unit), or an array, one value per sample, at
        least as long as the file.
    seconds : float, s
        Duration, rounded to whole samples.
    format : {"wav", "rf64", "w64", "caf", "flac"}, optional
        Format, if it differs from the suffix.
    subtype : {"FLOAT", "DOUBLE", "PCM_16", "PCM_24", "PCM_32"}, optional
        FLOAT by default; in FLAC PCM_24 (default) or PCM_16.
    full_scale : float or mapping of output name to float, optional
        Value, in the output's unit, that is 1.0 in the file; 1 in the output's unit by
        default. A single number is allowed only if all outputs have the same unit. PCM
        requires a full scale, because it cannot store values above it.
    dither : int, optional
        Seed of triangular dither of one step, added before PCM is rounded, so that the
        rounding error is stationary noise, independent of the signal.  None by default.
    block : int
        Samples per call of the processor; it does not affect the bytes.
    progress : bool or "always"
        A progress bar on stderr: True if that is a terminal, "always" even if not,
        False never.
    overwrite : bool
        Whether an existing file may be replaced; a link is replaced, not followed. If
        not, a file that appears during writing is kept as well.

    Returns
    -------
    FileReport

    Raises
    ------
    BadValue
        A number out of range, or a motion of the wrong shape or not finite; a parameter
        that is set while the file is written.
    UnknownName
        An input without a motion, or a motion or full scale for something that does not
        exist.
    UnitError
        One full scale for outputs with different units.
    SinkError
        The path cannot be written; the disk is full; the format cannot hold the signal;
        another program changed the file during writing.
    FaultError
        The processor reports a fault; no file is written.

    Warns
    -----
    RuntimeWarning
        Samples exceed full scale: a float format keeps them, but players and most sound
        cards clip them; PCM has clipped them. Or a generator moves faster than a hand,
        as for ``render``.

    Examples
    --------
    >>> import stimlib, tempfile
    >>> scene = stimlib.Scene(
    ...     {"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> spring = stimlib.compile(scene, fs=8000)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = write(
    ...         folder + "/spring.wav",
    ...         spring,
    ...         {"x": lambda t: 0.02 * t},
    ...         seconds=1.0,
    ...         full_scale=50.0,
    ...     )
    ...     y, sidecar = read(folder + "/spring.wav")
    >>> report.frames, round(report.peak["force"], 3)
    (8000, 39.995)
    >>> y.shape, sidecar["channels"][0]["unit"]
    ((1, 8000), 'N')
    """
    frames = frames_of(seconds, proc.fs)

    def blocks(sources: dict[str, Any], most: int) -> Iterator[Array]:
        warn_fast(sources, proc.scene, frames / proc.fs, proc.fs)
        return (
            y for _, y in walk(proc, rows_of(sources, proc.fs), frames, block=min(int(block), most))
        )

    return _write(
        Path(path),
        proc,
        motion,
        frames,
        blocks,
        format,
        subtype,
        full_scale,
        dither,
        progress,
        overwrite,
    )


@public
def save(
    path: str | os.PathLike[str],
    rendering: Rendering,
    *,
    format: str | None = None,
    subtype: str | None = None,
    full_scale: float | str | Mapping[str, float] | None = None,
    dither: int | None = None,
    progress: bool | str = False,
    overwrite: bool = True,
) -> FileReport:
    """Write the samples of a rendering as `write` would; see ``Rendering.save``.

    Parameters
    ----------
    path : path
        Where to write; the sidecar is ``path`` + ".json".
    rendering : Rendering
    format, subtype, full_scale, dither, progress, overwrite
        As in `write`.

    Returns
    -------
    FileReport

    Raises
    ------
    BadValue, UnitError, SinkError
        As `write`.
    FaultError
        An output of the rendering was NaN or infinite; no file is written.

    Examples
    --------
    >>> import numpy as np, stimlib, tempfile
    >>> scene = stimlib.Scene(
    ...     {"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> rendering = stimlib.render(scene, {"x": np.array([0.0, 0.01])}, fs=8000)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = save(folder + "/spring.wav", rendering, subtype="DOUBLE")
    ...     read(folder + "/spring.wav")[0]
    array([[ 0., 20.]])
    """
    path, y, frames = Path(path), rendering.y, rendering.y.shape[1]
    if rendering.fault is not None:
        raise FaultError(fault_text(*rendering.fault, rendering.fs, f"{path} was not written"))
    # for what it says: it does not run
    proc = Processor(rendering.scene, rendering.fs, seed=rendering.seed)
    for name, value in rendering.params.items():
        if value != proc.params[name]:
            proc.set(name, value, ramp=0.0)

    def blocks(sources: dict[str, Any], most: int) -> Iterator[Array]:
        return (y[:, at : at + most] for at in range(0, frames, most))

    return _write(
        path,
        proc,
        rendering.motion,
        frames,
        blocks,
        format,
        subtype,
        full_scale,
        dither,
        progress,
        overwrite,
    )


def _write(
    path: Path,
    proc: Processor,
    motion: Mapping[str, Any] | None,
    frames: int,
    blocks: Callable[[dict[str, Any], int], Iterator[Array]],
    format: str | None,
    subtype: str | None,
    full_scale: float | str | Mapping[str, float] | None,
    dither: int | None,
    progress: bool | str,
    overwrite: bool,
) -> FileReport:
    """Check the arguments, then write the samples that ``blocks`` yields."""
    format, subtype = format_of(path, format, subtype)
    check_format(format, subtype, proc.fs, len(proc.outputs), frames)
    sources = sources_of(motion, proc.inputs, frames)
    scales = full_scales(full_scale, proc, subtype)
    if dither is not None and (subtype not in BITS or not 0 <= dither < 2**64):
        raise BadValue(
            f"dither = {dither!r}: give a seed from 0 to 2**64 - 1, and a subtype of whole numbers"
            f" ({', '.join(BITS)}), not {subtype}"
        )
    if not (isinstance(progress, bool) or progress == "always"):
        raise BadValue(f"progress must be True, False or 'always', got {progress!r}")
    check_place(path, sidecar_of(path), overwrite)
    warn_beyond(proc.program, proc.fs, frames)
    if proc.fault is not None:
        name, index = proc.fault
        raise FaultError(
            f"output {name} stopped earlier, at sample {index} of the processor: reset it; {path}"
            " was not written"
        )

    info: dict[str, Any] = {
        "stimlib": __version__,
        "format": format,
        "subtype": subtype,
        "dither": dither,
        "fs": proc.fs,
        "frames": frames,
        "channels": [
            {"name": n, "unit": proc.units[n], "full_scale": s}
            for n, s in zip(proc.outputs, scales.tolist(), strict=True)
        ],
        "seed": proc.seed,
        "params": dict(proc.params),
        "index": proc.index,
        "log": [change._asdict() for change in proc.log],
        "motion": {name: describe(source) for name, source in sources.items()},
        **read_of(sources),
        "scene": proc.scene.to_dict(),
        "scene_hash": proc.scene.hash,
        "definitions": definitions.definitions(proc.scene),
    }
    parts = blocks(sources, max(1, int(STEP * proc.fs)))
    report = publish(
        path, info, lambda put: _run(put, path, proc, parts, info, scales, progress), overwrite
    )
    if beyond := _beyond(report, info):
        warnings.warn(beyond, RuntimeWarning, stacklevel=outside())
    return report


def _run(
    put: Put,
    path: Path,
    proc: Processor,
    blocks: Iterable[Array],
    info: dict[str, Any],
    scales: Array,
    progress: bool | str,
) -> tuple[NDArray[np.int64], Array, str]:
    """Write the samples to a temporary file.

    Return clips and peaks per output, and the hash of the signal.
    """
    outputs, fs, first, subtype = proc.outputs, proc.fs, proc.index, info["subtype"]
    done = 0
    clips = np.zeros(len(outputs), dtype=np.int64)
    peak = np.zeros(len(outputs))
    digest = hashlib.sha256()

    with bar("writing", info["frames"], progress) as advance:
        for y in blocks:
            if len(proc.log) != len(info["log"]):
                raise BadValue(
                    f"write: parameter {proc.log[-1].name} was set while {path} was being written;"
                    " its sidecar lacks the change; set it before, or make it a signal of the scene"
                )
            if proc.fault is not None:
                name, index = proc.fault
                raise FaultError(fault_text(name, index - first, fs, f"{path} was not written"))
            digest.update(interleaved(y, "<f8").data)
            np.maximum(peak, np.abs(y).max(axis=1), out=peak)
            samples, clipped = encode(y, scales, subtype, outputs, done, info["dither"])
            if peak.max() > NEARLY:
                good = np.isfinite(physical(samples, scales)).all(axis=1)
                if not good.all():
                    raise SinkError(
                        f"output {outputs[int(np.argmin(good))]} is too near the largest float to"
                        f" be read back from {subtype}: use DOUBLE and a power of two up to"
                        " 2.0**1023 as full_scale"
                    )
            clips += clipped
            put(samples)
            done += y.shape[1]
            advance(y.shape[1])
    return clips, peak, digest.hexdigest()


def _beyond(report: FileReport, info: dict[str, Any]) -> str:
    """Return a warning for outputs that exceed full scale, with its remedy.

    The text is empty if no output does.
    """
    peaks = {c["name"]: report.peak[c["name"]] for c in info["channels"]}
    passed = [c for c in info["channels"] if peaks[c["name"]] > c["full_scale"]]
    if not passed:
        return ""
    told = ", ".join(
        f"{c['name']} reaches {peaks[c['name']]:.4g} {pretty(c['unit'])}".removesuffix(" 1")
        + f" of {c['full_scale']:g}"
        for c in passed
    )
    if len({c["unit"] for c in info["channels"]}) == 1:
        needed = f"{1.01 * max(peaks.values()):.3g}"
    else:
        needed = ", ".join(f"{name}: {1.01 * peak:.3g}" for name, peak in peaks.items() if peak > 0)
    then = (
        "players clip there, though the file does not"
        if info["subtype"] not in BITS
        else "the file is clipped there"
    )
    return shown(
        f"{report.path}: samples pass full scale ({told}); {then}: give a full scale (--full-scale)"
        f" of {needed}"
    )


@public
def write_frames(
    path: str | os.PathLike[str], blocks: Iterable[NDArray[np.float32]], info: dict[str, Any]
) -> FileReport:
    """Write frames unchanged, such as those that a device was given.

    The same rules as for `write` apply.

    Parameters
    ----------
    path : path
        With a suffix of a format that holds floats.
    blocks : iterable of ndarray of float32, shape (n, channels)
    info : dict
        The sidecar, with fs, frames and channels (a list of name, unit, full_scale); it
        is completed as for a file without a scene.

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
    >>> info = {
    ...     "fs": 8000.0,
    ...     "frames": 2,
    ...     "channels": [{"name": "force", "unit": "N", "full_scale": 50.0}],
    ... }
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = write_frames(folder + "/a.wav", [np.float32([[0.5], [1.0]])], info)
    ...     read(folder + "/a.wav")[0]
    array([[25., 50.]])
    """
    path = Path(path)
    floats = [f".{name.lower()}" for name, subtypes in FORMATS.items() if "FLOAT" in subtypes]
    if path.suffix.lower() not in floats:
        raise SinkError(
            f"frames are floats and are written as they are: {path.name!r} must end in one of"
            f" {', '.join(floats)}"
        )
    format, subtype = format_of(path, None, "FLOAT")
    fs, frames, names = info["fs"], info["frames"], [c["name"] for c in info["channels"]]
    check_format(format, subtype, fs, len(names), frames)
    check_place(path, sidecar_of(path), True)
    blank: dict[str, Any] = {
        "stimlib": __version__,
        "format": format,
        "subtype": subtype,
        "dither": None,
        "seed": 0,
        "params": {},
        "index": 0,
        **{"log": [], "motion": {}, "scene": {}, "scene_hash": "", "definitions": {}},
    }
    scales = np.array([c["full_scale"] for c in info["channels"]])

    def run(put: Put) -> tuple[NDArray[np.int64], Array, None]:
        peak = np.zeros(len(names))
        for part in blocks:
            put(part)
            peak = np.maximum(peak, np.abs(part).max(axis=0, initial=0.0) * scales)
        return np.zeros(len(names), dtype=np.int64), peak, None

    return publish(path, blank | info, run, True)


@public
def read(path: str | os.PathLike[str]) -> tuple[Array, dict[str, Any]]:
    """Read a file that `write` wrote, in physical units, and check its sidecar.

    Parameters
    ----------
    path : path
        The audio file.

    Returns
    -------
    y : ndarray of float64, shape (n_outputs, frames)
        The file's samples times full scale, in the units of ``sidecar["channels"]``. If
        full scale is a power of two, DOUBLE returns every bit of the signal, and FLOAT
        its float32 rounding.
    sidecar : dict
        stimlib (version), format, subtype, dither (its seed or None), fs (Hz), frames,
        channels (a list of name, unit, full_scale, clips, peak), seed, params (at the
        start of the file), index (samples processed before), log (the `Change`s made by
        `Processor.set`), motion, scene, scene_hash, definitions (the files of your own
        blocks: a record), versions, sha256 (of the signal before it was scaled and
        rounded: the float64 values in physical units, little-endian, all outputs of
        sample 0, then of sample 1, ...) and file_sha256 (of the audio file). With index
        0, scene, seed, log and motion reproduce the signal.

    Raises
    ------
    SinkError
        A file is missing, cannot be read, is truncated, or does not match its sidecar.

    Examples
    --------
    See `write`.

    >>> read("missing.wav")
    Traceback (most recent call last):
    stimlib.errors.SinkError: there is no file missing.wav
    """
    stored = Stored(path)
    return stored[:, : stored.shape[1]], stored.sidecar


class Stored:
    """A checked file written by `write`, whose samples are read on demand.

    Attributes
    ----------
    sidecar : dict
    shape : (n_outputs, frames)

    Raises
    ------
    SinkError
        As `read`.
    """

    def __init__(self, path: str | os.PathLike[str]):
        self.path = path = Path(path)
        sidecar = sidecar_of(path)
        if not os.path.isfile(path):
            raise SinkError(f"there is no file {path}")
        self.sidecar = info = load(path, sidecar)
        self.shape = channels, frames = len(info["channels"]), info["frames"]
        with _sound(path) as (raw, f):
            # a FLAC file whose end was never written says 2**63 - 1 frames
            if f.frames < frames or f.frames == 2**63 - 1:
                raise SinkError(
                    f"{path} is truncated: {sidecar} says {counted(frames, 'frame')}, the file has"
                    f" {f.frames if f.frames < frames else 'fewer'}; copy it again"
                )
            for what, said, there in (
                ("channels", channels, f.channels),
                ("Hz", info["fs"], f.samplerate),
                ("frames", frames, f.frames),
                ("subtype", info["subtype"], f.subtype),
            ):
                if said != there:
                    raise SinkError(
                        f"{sidecar} does not belong to {path}: {what} {said} against {there}"
                    )
            size, held = os.fstat(raw.fileno()).st_size, 8.0 * frames * channels
            limits.check("audio_bytes", held, f"{path}: bytes of samples in memory", SinkError)
            limits.check("audio_bytes", size, f"{path}: bytes", SinkError)
            raw.seek(0)
            if hashlib.file_digest(raw, "sha256").hexdigest() != info["file_sha256"]:
                raise SinkError(
                    f"{sidecar} does not belong to {path}, or the file was changed: file_sha256"
                    f" differs"
                )

    def __getitem__(self, key: tuple[slice, slice]) -> Array:
        """Return samples [:, at:stop] in physical units."""
        at, stop, _ = key[1].indices(self.shape[1])
        scales = np.array([c["full_scale"] for c in self.sidecar["channels"]])
        with _sound(self.path) as (_, f):
            return _samples(self.path, f, scales, at, stop)


@contextmanager
def _sound(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open a sound file; yield the file, and the form of it that reads samples."""
    try:
        with open(safe_files.opened(path), "rb", buffering=0) as raw, reading(raw) as f:
            yield raw, f
    except soundfile().SoundFileError as e:
        raise SinkError(
            f"{path} cannot be read: it is damaged, truncated or no sound file ({reason(e)})"
        ) from e


@public
def as_scene(path: str | os.PathLike[str]) -> tuple[Scene, dict[str, Array], float]:
    """Return a sound file as a scene, with its motion and its sample rate.

    The outputs of the scene are the file's channels.

    Parameters
    ----------
    path : path
        A file written by `write` keeps its names and physical units; of two channels of
        one name, and of any other sound file, the outputs are channel1, channel2, ..

    Returns
    -------
    scene : Scene
    motion : dict of str to ndarray, shape (n,)
    fs : float
        Hz.

    Raises
    ------
    SinkError
        As `read`; or the file is not a sound file, ends before the last frame of its
        header, or has NaN or infinite samples.
    BadValue
        More samples than ``stimlib.limits.render_bytes``.

    Examples
    --------
    >>> import stimlib, tempfile
    >>> scene = stimlib.Scene({"force": stimlib.constant(2.0, "N")})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = stimlib.render(scene, fs=1000, seconds=0.003).save(
    ...         folder + "/a.wav", full_scale=4.0
    ...     )
    ...     as_scene(folder + "/a.wav")
    (Scene(force [N] -> force [N]), {'force': array([2., 2., 2.])}, 1000.0)
    """
    path = Path(path)
    info: dict[str, Any] = {}
    if sidecar_of(path).exists():
        y, info = read(path)
    else:
        with _sound(path) as (_, f):
            limits.check("render_bytes", 8 * f.frames * f.channels, f"{path}: bytes of its samples")
            y, info["fs"] = f.read(f.frames, "float64", True).T, f.samplerate
            if lost := lost_frames(f, y.shape[1]):
                raise SinkError(
                    f"{path} is cut short: the last {lost} of its {y.shape[1] + lost} frames"
                    " are missing; copy it again, or save what is left with a sound editor"
                )
    if not y.size or not np.isfinite(y).all():
        raise SinkError(
            f"{path} has no samples, or some that are not finite: there is nothing to play"
        )
    channels = info.get("channels", [{"unit": "1"}] * len(y))
    units = {c.get("name"): c["unit"] for c in channels}
    if len(units) < len(y) or None in units:  # two channels of a session may have one output
        units = {f"channel{k + 1}": c["unit"] for k, c in enumerate(channels)}
    scene = Scene({n: Input(n, "" if unit == "1" else unit) for n, unit in units.items()})
    return scene, dict(zip(scene.outputs, np.ascontiguousarray(y), strict=True)), float(info["fs"])


def lost_frames(f: Any, n: int) -> int:
    """Return how many frames an open sound file lacks of those that its header states.

    n: those that can be read. libsndfile reports the sizes in its log alone.
    """
    sizes = re.search(CUT, f.extra_info, re.M)
    size = BYTES.get(f.subtype, 1) * f.channels
    # what writes into a pipe states nearly 2**31 or 2**32 bytes: as many as come
    known = sizes and (int(sizes[1]) + 4096) % 2**31 > 4096
    lost = int(sizes[1]) - int(sizes[2]) if sizes and known else 0
    if (
        f.format == "CAF"
        and f.subtype in {*BYTES, *LAWS}
        and (data := re.search(DATA, f.extra_info, re.M))
    ):
        lost = int(data[1]) - 4 - f.frames * size
    return max(f.frames - n, -(-lost // size))


def _samples(path: Path, f: Any, scales: Array, first: int, stop: int) -> Array:
    """Return samples first .. stop - 1 of an open sound file in physical units.

    The shape is (n_outputs, stop - first).
    """
    try:
        y = np.empty((len(scales), stop - first))
    except MemoryError:
        raise SinkError(
            f"{path}: {counted(stop - first, 'frame')} of {counted(len(scales), 'channel')} do not"
            " fit into memory"
        ) from None
    if first:
        f.seek(first)
    at = first
    while at < stop:
        part = f.read(
            min(PIECE, stop - at),
            dtype="int32" if f.subtype in BITS else "float64",
            always_2d=True,
        )
        if not len(part):
            raise SinkError(
                f"{path} is truncated: {counted(stop, 'frame')} wanted, {at} can be read"
            )
        y[:, at - first : at - first + len(part)] = physical(part, scales)
        at += len(part)
    if not np.isfinite(y).all():
        raise SinkError(f"{path} has samples that are not finite: stimlib did not write it")
    return y
