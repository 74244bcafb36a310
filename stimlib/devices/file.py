"""The file sink: a processor's outputs in an audio file, and back.

Every file NAME has a sidecar NAME.json that says what the samples are, because no audio format has room for a unit.
Both are complete or absent: they are written beside their place and moved there at the end. The bytes of both depend
on the signal and on the versions in the sidecar only; there are no dates in them.
"""

import hashlib
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..errors import BadValue, FaultError, SinkError, UnitError
from ..processor import Processor
from ..rendering import check_names, frames_of, pull, sources_of, warn_beyond

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
# libsndfile stops at 1024; a CAF file with 400 channels is damaged by libsndfile 1.2.2
MAX_CHANNELS = {"WAV": 1024, "RF64": 1024, "W64": 1024, "CAF": 256, "FLAC": 8}


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
        Per output, how many samples were limited to full scale; 0 in formats that hold floats.
    peak : dict of str to float
        Per output, the largest absolute value, in the output's unit.
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
    clips: dict[str, int]
    peak: dict[str, float]
    sidecar: Path

    def __str__(self) -> str:
        peaks = ", ".join(f"{name} {value:.4g}" for name, value in self.peak.items())
        clips = ", ".join(f"{name} {count}" for name, count in self.clips.items() if count)
        line = f"{self.path}: {self.frames} frames, {self.seconds:.6g} s, peak {peaks}"
        return line + (f", samples clipped: {clips}" if clips else "")


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

    Memory does not grow with the duration. If anything fails, or on an interrupt, whatever was at ``path`` before is
    still there and nothing is left beside it.

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
        Whether a file that exists may be replaced.

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
        The place cannot be written, the disk is full, or the format cannot hold the signal.
    FaultError
        The processor reports a fault; no file is written.

    Examples
    --------
    >>> import stimlib, tempfile
    >>> scene = stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")})
    >>> spring = stimlib.compile(scene, fs=8000)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = write(folder + "/spring.wav", spring, {"x": lambda t: 0.02 * t}, seconds=1.0)
    ...     y, sidecar = read(folder + "/spring.wav")
    >>> report.frames, round(report.peak["force"], 3)
    (8000, 39.995)
    >>> y.shape, sidecar["channels"][0]["unit"]
    ((1, 8000), 'N')
    """
    path = Path(path)
    sidecar = _sidecar(path)
    frames = frames_of(seconds, proc.fs)
    format, subtype = _format(path, format, subtype)
    _check_format(format, subtype, proc, frames)
    sources = sources_of(motion, proc.inputs, frames)
    scales = _full_scales(full_scale, proc, format)
    if isinstance(block, bool) or not isinstance(block, int | np.integer) or block < 1:
        raise BadValue(f"block must be a whole number of samples above 0, got {block!r}")
    if not (isinstance(progress, bool) or progress == "always"):
        raise BadValue(f"progress must be True, False or 'always', got {progress!r}")
    _check_place(path, sidecar, overwrite)
    warn_beyond(proc, frames)
    if proc.fault is not None:
        name, index = proc.fault
        raise FaultError(f"output {name} stopped earlier, at sample {index} of the processor: reset it; {path} was not written")

    part, sidecar_part = _part(path), _part(sidecar)
    info: dict[str, Any] = {
        "stimlib": __version__,
        "format": format,
        "subtype": subtype,
        "fs": proc.fs,
        "frames": frames,
        "channels": [],
        "seed": proc.seed,
        "params": dict(proc.params),
        "index": proc.index,
        "log": [change._asdict() for change in proc.log],
        "motion": {name: _describe(source) for name, source in sources.items()},
        "scene": proc.scene.to_dict(),
        "scene_hash": proc.scene.hash,
    }
    complete = False
    try:
        clips, peak, info["sha256"] = _run(path, proc, sources, frames, format, subtype, scales, int(block), progress)
        info["channels"] = [
            {"name": n, "unit": proc.units[n], "full_scale": s, "clips": int(c), "peak": float(p)}
            for n, s, c, p in zip(proc.outputs, scales.tolist(), clips, peak, strict=True)
        ]
        info["versions"] = _versions()
        with _disk(path):
            _sync(part)
            info["file_sha256"] = _file_sha256(part)
            sidecar_part.write_bytes((json.dumps(info, indent=1, allow_nan=False) + "\n").encode())
            _sync(sidecar_part)
            complete = True
            os.replace(part, path)
            os.replace(sidecar_part, sidecar)
            _sync_folder(path.parent)
    except BaseException:
        with suppress(OSError):
            if complete and not part.exists():  # interrupted between the moves: the first cannot be taken back
                os.replace(sidecar_part, sidecar)
        for p in (part, sidecar_part):
            with suppress(OSError):
                p.unlink()
        raise
    clip_counts = {c["name"]: c["clips"] for c in info["channels"]}
    peaks = {c["name"]: c["peak"] for c in info["channels"]}
    return FileReport(path, frames, frames / proc.fs, clip_counts, peaks, sidecar)


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
        had changed, the `Change`s), motion, scene, scene_hash, versions, sha256 (of the signal before it was scaled and
        rounded: the float64 values in physical units, little-endian, all outputs of sample 0, then of sample 1, ...)
        and file_sha256 (of the audio file). With index 0, scene, seed, log and motion give the signal again.

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
    sf = _soundfile()
    path = Path(path)
    sidecar = _sidecar(path)
    if not path.is_file():
        raise SinkError(f"there is no file {path}")
    info = _load_sidecar(path, sidecar)
    frames, channels = info["frames"], info["channels"]
    try:
        with sf.SoundFile(path) as f:
            if (f.samplerate, f.channels) != (info["fs"], len(channels)):
                raise SinkError(
                    f"{sidecar} does not belong to {path}: it says {len(channels)} channels at {info['fs']:g} Hz, "
                    f"the file has {f.channels} at {f.samplerate} Hz"
                )
            # a FLAC file whose end was never written says 2**63 - 1 frames
            if f.frames < frames or f.frames == 2**63 - 1:
                raise SinkError(f"{path} is truncated: {sidecar} says {frames} frames, the file has fewer")
            if f.frames > frames:
                raise SinkError(f"{sidecar} does not belong to {path}: {frames} frames against {f.frames}")
            integer = f.subtype == "PCM_24"
            samples = f.read(dtype="int32" if integer else "float64", always_2d=True)
    except sf.SoundFileError as error:
        raise SinkError(f"{path} cannot be read: it is damaged, truncated or not an audio file ({error})") from error
    if len(samples) != frames:
        raise SinkError(f"{path} is truncated: {sidecar} says {frames} frames, {len(samples)} can be read")
    if _file_sha256(path) != info["file_sha256"]:
        raise SinkError(f"{sidecar} does not belong to {path}, or the file was changed: file_sha256 differs")
    return _physical(samples, np.array([c["full_scale"] for c in channels])), info


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
    >>> from stimlib.devices.file import stored
    >>> stored(np.array([[0.1]]), {"subtype": "PCM_24", "channels": [{"name": "f", "full_scale": 1.0}]})
    array([[0.10000002]])
    """
    scales = np.array([c["full_scale"] for c in sidecar["channels"]])
    samples, _ = _encode(y, scales, sidecar["subtype"], tuple(c["name"] for c in sidecar["channels"]))
    return _physical(samples.astype(np.float64) if sidecar["subtype"] == "FLOAT" else samples, scales)


def _physical(samples: NDArray[Any], scales: Array) -> Array:
    """Samples (n, n_outputs) of a file in physical units, (n_outputs, n)."""
    values = samples * 2.0**-31 if samples.dtype == np.int32 else samples
    return np.ascontiguousarray((values * scales).T)


# -- what may be written where


def _sidecar(path: Path) -> Path:
    return path.with_name(path.name + ".json")


def _part(path: Path) -> Path:
    return path.with_name(path.name + ".part")


def _soundfile() -> Any:
    return import_module("soundfile")  # here and not above: it loads a shared library


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


def _check_format(format: str, subtype: str, proc: Processor, frames: int) -> None:
    """The processor's rate, outputs and duration fit the format."""
    fs, channels = proc.fs, len(proc.outputs)
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
    if not path.name or path.is_dir():
        raise SinkError(f"{path} is a folder; give the name of a file in it")
    if not path.parent.is_dir():
        raise SinkError(f"there is no folder {path.parent}; make it first")
    for p in (path, sidecar):
        if p.exists() and not p.is_file():
            raise SinkError(f"{p} is there and not an ordinary file")
        if p.exists() and not overwrite:
            raise SinkError(f"{p} is there already, and overwrite=False")
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
    path: Path,
    proc: Processor,
    sources: dict[str, Any],
    frames: int,
    format: str,
    subtype: str,
    scales: Array,
    block: int,
    progress: bool | str,
) -> tuple[NDArray[np.int64], Array, str]:
    """Write the audio file beside its place; clips and peaks per output, and the hash of the signal."""
    outputs, fs, first = proc.outputs, proc.fs, proc.index
    clips = np.zeros(len(outputs), dtype=np.int64)
    peak = np.zeros(len(outputs))
    digest = hashlib.sha256()
    last: NDArray[Any] = np.empty((0, len(outputs)))
    with _bar(frames, progress) as advance, _audio(path, int(fs), len(outputs), format, subtype) as f:
        done = 0
        for y in pull(proc, sources, frames, block):
            done += y.shape[1]
            if proc.fault is not None:
                name, index = proc.fault
                at = index - first
                raise FaultError(f"output {name} is not finite at sample {at} ({at / fs:.6g} s); {path} was not written")
            digest.update(np.ascontiguousarray(y.T, dtype="<f8").data)
            peak = np.maximum(peak, np.abs(y).max(axis=1))
            last, clipped = _encode(y, scales, subtype, outputs)
            clips += clipped
            with _disk(path):
                f.write(last)
                if f.frames != done:
                    raise AssertionError("short write")  # soundfile's own assertion, which python -O removes
            advance(y.shape[1])
    _check_end(path, frames, last)
    return clips, peak, digest.hexdigest()


@contextmanager
def _audio(path: Path, fs: int, channels: int, format: str, subtype: str) -> Iterator[Any]:
    """The audio file beside its place, open for writing."""
    sf = _soundfile()
    with _disk(path):
        _part(path).write_bytes(b"")  # tells why not, if it cannot; libsndfile says "System error" only
        f = sf.SoundFile(_part(path), "w", samplerate=fs, channels=channels, subtype=subtype, format=format)
    try:
        yield f
    except BaseException:
        with suppress(sf.SoundFileError):  # the first error is the one to report
            f.close()
        raise
    with _disk(path):
        f.close()
        _undate(_part(path))


def _undate(path: Path) -> None:
    """Set the date in the PEAK chunk of a WAV or RF64 file to 0.

    libsndfile has a command that leaves the chunk out, but does not obey it in RF64.
    """
    with open(path, "rb+") as f:
        head = f.read(12)
        while head[:4] in (b"RIFF", b"RF64"):
            name, size = f.read(4), int.from_bytes(f.read(4), "little")
            if name == b"PEAK":
                f.seek(4, os.SEEK_CUR)  # the chunk's version
                f.write(bytes(4))
            if name in (b"PEAK", b"data", b""):
                break
            f.seek(size + size % 2, os.SEEK_CUR)


def _check_end(path: Path, frames: int, last: NDArray[Any]) -> None:
    """The file has all frames and ends with the samples last written.

    libsndfile reports an error of the disk at once, except when it completes a FLAC file: then it is silent.
    """
    with _disk(path), _soundfile().SoundFile(_part(path)) as f:
        if f.frames != frames:
            raise AssertionError("the file is too short")
        f.seek(frames - len(last))
        if not np.array_equal(f.read(dtype=last.dtype.name, always_2d=True), last):
            raise AssertionError("the file does not end with the last samples")


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
def _disk(path: Path) -> Iterator[None]:
    """What goes wrong inside is an error of the disk or of libsndfile, not of the processor or the motion."""
    try:
        yield
    except SinkError:
        raise
    except OSError as error:
        raise SinkError(f"cannot write {path}: {error.strerror or error}") from error
    except (_soundfile().SoundFileError, AssertionError) as error:
        raise SinkError(f"cannot write {path}: {_reason(_part(path)) or error}") from error


def _reason(part: Path) -> str | None:
    """Why the system does not let us write; libsndfile keeps it to itself, so try again without it."""
    try:
        with open(part, "ab", buffering=0) as f:
            for _ in range(64):
                f.write(bytes(65536))
    except OSError as error:
        return error.strerror
    return None


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


def _load_sidecar(path: Path, sidecar: Path) -> dict[str, Any]:
    if not sidecar.is_file():
        raise SinkError(f"{path} has no sidecar {sidecar.name}; without it units and full scale are not known")
    try:
        info: dict[str, Any] = json.loads(sidecar.read_bytes())
        typed = [(info["frames"], int), (info["fs"], float), (info["file_sha256"], str)]
        for c in info["channels"]:
            typed += [(c["name"], str), (c["unit"], str), (c["full_scale"], float)]
        if not all(isinstance(value, kind) for value, kind in typed):
            raise TypeError("a value has the wrong type")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SinkError(f"{sidecar} is not a sidecar that stimlib wrote") from error
    return info


def _sync(path: Path) -> None:
    with open(path, "rb+") as f:
        os.fsync(f.fileno())


def _sync_folder(folder: Path) -> None:
    """The new names are on the disk too, where the system can do that."""
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            with suppress(OSError):
                os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _file_sha256(path: Path) -> str:
    with open(path, "rb") as f:
        return hashlib.file_digest(f, "sha256").hexdigest()


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _versions() -> dict[str, str | None]:
    sf = _soundfile()
    return {
        "numpy": np.__version__,
        "numba": _version("numba"),
        "soundfile": sf.__version__,
        "libsndfile": sf.__libsndfile_version__,
    }
