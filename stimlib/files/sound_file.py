"""A sound file during writing, and the check that it holds what was written.

Libsndfile gets a file descriptor instead of a name, so no link or pipe can be put in
its place; reading back checks the written file, even if another file has its name by
then.
"""

from __future__ import annotations

import errno
import hashlib
import math
import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SinkError
from ..system import safe_files
from .formats import BITS

# of the samples of a subtype
TYPES = {"FLOAT": "float32", "DOUBLE": "float64"} | dict.fromkeys(BITS, "int32")
COMMENTED = {"WAV", "RF64", "CAF", "FLAC"}  # W64 has no place for a text
LINKS = os.link in os.supports_follow_symlinks
"""False on Windows, where a rename replaces nothing."""
PIECE = 1 << 16  # frames that are read at once


class Draft(AbstractContextManager["Draft"]):
    """A new sound file that is open for writing.

    Parameters
    ----------
    path : Path
        The final name, for messages.
    at : Path
        The temporary name.
    fs, channels, format, subtype
        As for libsndfile.
    comment : str
        A text stored in the file, if the format allows one.

    Raises
    ------
    SinkError
        The path cannot be written; later: the disk is full, or another program changed
        the file.
    """

    def __init__(
        self,
        path: Path,
        at: Path,
        fs: int,
        channels: int,
        format: str,
        subtype: str,
        comment: str = "",
    ):
        self.path, self.at, self.frames, self.type = path, at, 0, TYPES[subtype]
        self._put = hashlib.sha256()
        self._busy = Lock()  # an interrupt may close it while another thread puts
        sf = soundfile()
        self.raw = open(safe_files.create(at), "r+b", buffering=0)
        try:
            with disk(path, self.raw):
                self._sound = sf.SoundFile(
                    sound_of(self.raw),
                    "w",
                    samplerate=fs,
                    channels=channels,
                    subtype=subtype,
                    format=format,
                    closefd=False,
                )
                if comment and format in COMMENTED:
                    self._sound.comment = comment
        except BaseException:
            self.raw.close()
            raise

    def __exit__(self, *exception: object) -> None:
        # an error before is the one to report
        with self._busy, suppress(soundfile().SoundFileError):
            self._sound.close()
        self.raw.close()

    def put(self, samples: NDArray[Any]) -> None:
        """Append samples, shape (n, channels), in the data type of the subtype.

        ``seal`` verifies the samples.
        """
        self._put.update(np.ascontiguousarray(samples).data)
        self.frames += len(samples)
        with self._busy, disk(self.path, self.raw):
            self._sound.write(samples)
            if self._sound.frames != self.frames:
                # soundfile's own assertion, which python -O removes
                raise AssertionError("short write")

    def seal(self) -> str:
        """Complete the file on disk, verify its contents, and return its SHA-256."""
        with disk(self.path, self.raw):
            self._sound.close()
            _undate(self.raw)
            os.fsync(self.raw.fileno())
            digest, got, frames, hashed = hashlib.sha256(), hashlib.sha256(), 0, 0

            def hash_to(end: float) -> None:
                nonlocal hashed
                while hashed < end and (
                    part := safe_files.read_at(self.raw.fileno(), 1 << 18, hashed)
                ):
                    digest.update(part)
                    hashed += len(part)

            # always before it is read: who changes the file after it was proven changes
            # its hash
            hash_to(1)
            with suppress(soundfile().SoundFileError), reading(self.raw) as f:
                most = PIECE * 8 * f.channels + (1 << 16)  # bytes, of one reading
                while frames <= self.frames:
                    hash_to(self.raw.tell() + most)
                    samples = f.read(PIECE, dtype=self.type, always_2d=True)
                    if not len(samples):
                        break
                    got.update(np.ascontiguousarray(samples).data)
                    frames += len(samples)
            hash_to(math.inf)
            if (frames, got.digest()) != (self.frames, self._put.digest()):
                raise self._changed()
        return digest.hexdigest()

    def _changed(self) -> SinkError:
        # libsndfile reports an error of the disk at once, except when it completes a
        # FLAC file: then it is silent
        changed = f"another program changed {self.at.name} while it was written"
        return SinkError(f"cannot write {self.path}: {_reason(self.raw) or changed}")

    def is_at(self, path: Path) -> bool:
        """Return whether a path still refers to this file."""
        try:
            return os.path.samestat(os.lstat(path), os.fstat(self.raw.fileno()))
        except (OSError, ValueError):  # on Windows it is closed before it is moved
            return False

    def move(self, path: Path, overwrite: bool) -> None:
        """Rename the file to its final name."""
        if not self.is_at(self.at):
            raise self._changed()
        if not safe_files.NOFOLLOW:  # Windows renames no file that is open
            self.raw.close()
        move(self.at, path, overwrite)


def comment_of(info: dict[str, Any]) -> str:
    """Return a comment that describes the channels, in case the sidecar is lost.

    Examples
    --------
    >>> from stimlib.files.sound_file import comment_of
    >>> comment_of({"channels": [{"name": "force", "unit": "N", "full_scale": 50.0}]})
    'force [N]: 1.0 is 50.0'
    """
    return "; ".join(
        f"{c['name']} [{c['unit']}]: 1.0 is {c['full_scale']!r}" for c in info["channels"]
    )[:1000]


def move(source: Path, path: Path, overwrite: bool) -> None:
    """Rename a file to its final name.

    Without ``overwrite``, SinkError is raised if anything has this name, even if it
    appeared just now.
    """
    if overwrite:
        os.replace(source, path)
        return
    try:
        if not LINKS:
            os.rename(source, path)
            return
        try:
            os.link(source, path, follow_symlinks=False)
        except OSError as e:
            if e.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK):
                raise
            # no links here: take the name first
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
            os.replace(source, path)
        else:
            os.unlink(source)
    except FileExistsError:
        raise SinkError(f"{path} is there already, and overwrite=False") from None


def reading(f: Any) -> Any:
    """Return an open file as a sound file, positioned at its beginning."""
    f.seek(0)
    return soundfile().SoundFile(sound_of(f), closefd=False)


def sound_of(f: Any) -> Any:
    """Return the form of an open file that libsndfile accepts.

    This is the file descriptor, except on Windows, where the descriptors of Python and
    of libsndfile differ.
    """
    return f.fileno() if safe_files.NOFOLLOW else f


def reason(error: Exception) -> str:
    """Return the message of a libsndfile error, without the number of the file."""
    return getattr(error, "error_string", None) or str(error)


@contextmanager
def disk(path: Path, raw: Any = None) -> Iterator[None]:
    """Convert exceptions inside the block to errors of the disk or of libsndfile.

    The processor and the motion must run outside the block, so that their errors are
    not converted.
    """
    try:
        yield
    except SinkError:
        raise
    except OSError as e:
        raise SinkError(f"cannot write {path}: {e.strerror or e}") from e
    except (soundfile().SoundFileError, AssertionError) as e:
        raise SinkError(f"cannot write {path}: {_reason(raw) or reason(e)}") from e


def _reason(raw: Any) -> str | None:
    """Return the reason why the system does not allow writing.

    libsndfile does not report it, so a write is tried without libsndfile.
    """
    try:
        if raw is not None:
            raw.seek(0, os.SEEK_END)
            for _ in range(64):
                raw.write(bytes(65536))
    except OSError as e:
        return e.strerror
    return None


def _undate(f: Any) -> None:
    """Set the date in the PEAK chunk of a WAV or RF64 file to 0.

    libsndfile has a command that leaves the chunk out, but does not obey it in RF64.
    """
    head, at = safe_files.read_at(f.fileno(), 12, 0), 12
    while head[:4] in (b"RIFF", b"RF64"):
        chunk = safe_files.read_at(f.fileno(), 8, at)
        name, size = chunk[:4], int.from_bytes(chunk[4:], "little")
        if name == b"PEAK":
            f.seek(at + 12)  # behind name, size and the chunk's version
            f.write(bytes(4))
        if name in (b"PEAK", b"data", b""):
            break
        at += 8 + size + size % 2


def soundfile() -> Any:
    """Import and return the package soundfile.

    It is imported only when needed, because it loads a shared library.
    """
    return import_module("soundfile")
