"""Moving a file and its sidecar into place together, and recovery after a kill."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SinkError, public
from ..system import safe_files
from ..system.limits import limits
from .formats import BITS, JOURNAL, Array, physical
from .partial import TYPES, Draft, comment_of, disk, fill, move, reading, reason, sha256, soundfile
from .sidecar import BEGUN, FileReport, load, part_of, report_of, sidecar_of, text_of, versions

Put = Callable[[NDArray[Any]], None]
"""Function that takes the next samples, shape (n, channels), in the subtype's data
type.
"""
Run = Callable[[Put], tuple[NDArray[np.int64], Array, str | None]]
"""Function that fills a file, and returns clipped samples and peak of each output, and
the hash of the signal.
"""


def check_place(path: Path, sidecar: Path, overwrite: bool) -> None:
    """Raise SinkError if a file or its sidecar cannot be written."""
    if not path.name or os.path.isdir(path):
        raise SinkError(f"{path} is a folder; give the name of a file in it")
    if not os.path.isdir(path.parent):
        raise SinkError(f"there is no folder {path.parent}; make it first")
    for p in (path, sidecar):
        if os.path.exists(p) and not os.path.isfile(p):
            raise SinkError(f"{p} is there and not an ordinary file")
        if os.path.lexists(p) and not overwrite:
            raise SinkError(f"{p} is there already, and overwrite=False")
    for p in (part_of(path), sidecar_of(part_of(path)), _new(path), part_of(sidecar)):
        safe_files.check(p)
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise SinkError(f"folder {path.parent} is not writable")


def publish(path: Path, info: dict[str, Any], run: Run, overwrite: bool) -> FileReport:
    """Write a file with ``run``; move file and sidecar into place together, or neither.

    During writing, NAME.part has the samples so far.
    """
    try:
        with _locked(path) as begun:
            safe_files.remove(_new(path), part_of(sidecar_of(path)))  # of a run that was killed
            with disk(path):
                fill(begun, text_of(info))
            _fill(path, info, run, overwrite)
            safe_files.remove(part_of(path), sidecar_of(part_of(path)))  # which are closed
    except BaseException:
        _clean(path)
        raise
    return report_of(path, info)


def _fill(path: Path, info: dict[str, Any], run: Run, overwrite: bool) -> None:
    """Write a file with ``run``, and move it and its sidecar into place."""
    part, format = part_of(path), info["format"]
    with ExitStack() as stack:
        draft = stack.enter_context(
            _draft(path, _new(path) if format in JOURNAL else part, info, format)
        )
        put = draft.put
        if format in JOURNAL:
            journal = stack.enter_context(_draft(path, part, info, JOURNAL[format]))

            def put(samples: NDArray[Any]) -> None:
                journal.append(samples)
                draft.put(samples)

        clips, peak, info["sha256"] = run(put)
        if draft.frames != info["frames"]:
            raise SinkError(
                f"cannot write {path}: {draft.frames} frames came, not {info['frames']}"
            )
        for c, clipped, largest in zip(info["channels"], clips, peak, strict=True):
            c |= {"clips": int(clipped), "peak": float(largest)}
        _move(draft, path, info, overwrite)


def _draft(path: Path, at: Path, info: dict[str, Any], format: str) -> Draft:
    channels = len(info["channels"])
    return Draft(path, at, int(info["fs"]), channels, format, info["subtype"], comment_of(info))


def _move(draft: Draft, path: Path, info: dict[str, Any], overwrite: bool) -> None:
    """Verify a file, then move it and its sidecar into place."""
    sidecar, ready = sidecar_of(path), part_of(sidecar_of(path))
    info["versions"], info["file_sha256"] = versions(), draft.seal()
    complete = False
    try:
        with disk(path):
            with open(safe_files.create(ready), "r+b", buffering=0) as f:
                fill(f, text_of(info))
                os.fsync(f.fileno())
            complete = True
            draft.move(path, overwrite)
            try:
                move(ready, sidecar, overwrite)
            except SinkError:
                os.unlink(path)  # ours, and nothing without its sidecar
                raise
            safe_files.settle(path.parent)
    except BaseException:
        with suppress(OSError):
            # interrupted between the moves: the first cannot be taken back
            if complete and draft.is_at(path):
                move(ready, sidecar, overwrite)
        raise


@public
def recover(
    path: str | os.PathLike[str],
    to: str | os.PathLike[str] | None = None,
    *,
    overwrite: bool = False,
) -> FileReport:
    """Make a file from the data that a killed run of `stimlib.files.audio.write` left.

    Samples and bytes are those that `write` would have written in a shorter run. In the
    sidecar, ``"recovered"`` is the number of frames that the run was to write. The
    sha256 of the unrounded signal and, for FLAC, the number of clipped samples are
    unknown and None; the peak is that of the stored samples. `read` and ``stimlib
    verify`` accept the file like any other.

    Parameters
    ----------
    path : path
        The file that the run was to write; the run left ``path`` + ".part" and ``path``
        + ".part.json".
    to : path, optional
        Where to write instead, with the same suffix.
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    FileReport

    Raises
    ------
    SinkError
        There is nothing to recover, or not a single sample; the run is still alive; the
        leftover files were changed; a file already exists; or the path cannot be
        written. The leftover files are then kept.

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
    part, sidecar = part_of(path), sidecar_of(part_of(path))
    if not os.path.lexists(part):
        log = (
            "; a log needs nothing, see stimlib replay"
            if os.path.isfile(path / "session.json")
            else ""
        )
        raise SinkError(f"nothing to recover: there is no {part}{log}")
    load(part, sidecar, BEGUN)
    with _locked(path):
        with ExitStack() as stack:
            info = load(part, sidecar, BEGUN)
            check_place(to, sidecar_of(to), overwrite)
            raw = stack.enter_context(open(safe_files.opened(part, os.O_RDWR), "rb", buffering=0))
            info |= {
                "sha256": None,
                "recovered": {"frames": info["frames"]},
                "frames": _frames_left(part, raw, info),
            }
            draft = stack.enter_context(_draft(to, _new(to), info, info["format"]))
            try:
                peak = _copy(part, raw, draft, info)
                for c, largest in zip(info["channels"], peak, strict=True):
                    clips = None if info["subtype"] in BITS else 0
                    c |= {"clips": clips, "peak": float(largest)}
                _move(draft, to, info, overwrite)
            except BaseException:
                safe_files.remove(_new(to), part_of(sidecar_of(to)))
                raise
        safe_files.remove(part, sidecar, _new(path))
    return report_of(to, info)


def _finish_move(path: Path) -> FileReport | None:
    """Finish the move of a run that was killed between moving file and sidecar."""
    ready = part_of(sidecar_of(path))
    if not (os.path.isfile(path) and os.path.isfile(ready)):
        return None
    try:
        info = load(path, ready)
        with open(safe_files.opened(path), "rb", buffering=0) as raw:
            check_size(path, raw, info["frames"], len(info["channels"]))
            if sha256(raw) != info["file_sha256"]:
                return None
    except SinkError:
        return None
    with _locked(path):
        with disk(path):
            safe_files.check(ready)
            os.replace(ready, sidecar_of(path))
        safe_files.remove(part_of(path), sidecar_of(part_of(path)))
    return report_of(path, info)


def _frames_left(part: Path, raw: Any, info: dict[str, Any]) -> int:
    """Return the number of frames in an open file that a killed run left.

    The file must have the format that its sidecar states.
    """
    try:
        with reading(raw) as f:
            found = (f.samplerate, f.channels, f.format, f.subtype)
            frames = int(f.frames)
    except soundfile().SoundFileError as e:
        raise SinkError(
            f"nothing to recover: {part} has no samples yet, or was damaged ({reason(e)});"
            " remove it"
        ) from e
    wanted = (
        info["fs"],
        len(info["channels"]),
        JOURNAL.get(info["format"], info["format"]),
        info["subtype"],
    )
    if found != wanted:
        raise SinkError(
            f"{sidecar_of(part)} does not belong to {part}: it says {wanted}, the file is {found}"
        )
    if not 0 < frames <= info["frames"]:
        raise SinkError(
            f"nothing to recover: {part} has {frames} of {info['frames']} frames; remove it"
        )
    check_size(part, raw, frames, len(info["channels"]))
    return frames


def check_size(path: Path, raw: Any, frames: int, channels: int) -> None:
    """Raise an error if a file, or its samples in memory, would exceed the limits."""
    limits.check(
        "audio_bytes", 8.0 * frames * channels, f"{path}: bytes of samples in memory", SinkError
    )
    limits.check("audio_bytes", os.fstat(raw.fileno()).st_size, f"{path}: bytes", SinkError)


def _copy(source: Path, raw: Any, draft: Draft, info: dict[str, Any]) -> Array:
    """Copy the frames of an open file into a draft, and return the peak of each output.

    The number of frames is in ``info``.
    """
    frames, scales = info["frames"], np.array([c["full_scale"] for c in info["channels"]])
    peak = np.zeros(len(scales))
    try:
        with reading(raw) as f:
            while draft.frames < frames:
                part = f.read(
                    min(8192, frames - draft.frames), dtype=TYPES[info["subtype"]], always_2d=True
                )
                if not len(part):
                    raise SinkError(
                        f"{source} is truncated: {frames} frames wanted, {draft.frames} can be read"
                    )
                draft.put(part)
                peak = np.maximum(peak, np.abs(physical(part, scales)).max(axis=1))
    except soundfile().SoundFileError as e:
        raise SinkError(f"{source} cannot be read to its end, it was damaged ({reason(e)})") from e
    if not np.isfinite(peak).all():
        raise SinkError(f"{source} has samples that are not finite: it was damaged")
    return peak


def _new(path: Path) -> Path:
    """Return the temporary path of a file when NAME.part is used for something else."""
    return path.with_name(path.name + ".new.part")


def _clean(path: Path) -> None:
    """Remove the files of a failed run, unless they belong to another run."""
    begun = sidecar_of(part_of(path))
    with suppress(OSError), open(safe_files.opened(begun, os.O_RDWR), "rb", buffering=0) as f:
        if safe_files.held(f.fileno()) and os.path.samestat(os.fstat(f.fileno()), os.lstat(begun)):
            safe_files.remove(part_of(path), _new(path), part_of(sidecar_of(path)), begun)
    safe_files.sweep(begun)


@contextmanager
def _locked(path: Path) -> Iterator[Any]:
    """Open NAME.part.json under an exclusive lock.

    The operating system releases the lock if the process is killed.
    """
    sidecar = sidecar_of(part_of(path))
    with ExitStack() as stack:
        with disk(path):
            f = safe_files.alone(stack, sidecar, path)
        yield f
