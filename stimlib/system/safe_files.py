"""Safe use of regular files: reading within a limit, and writing atomically.

A file from others may be a pipe that never ends, or a link to something that must not
be overwritten.  Everything that reads or writes a whole file goes through here.
"""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from importlib import import_module
from io import FileIO
from itertools import chain, count
from pathlib import Path
from typing import Any

from ..errors import SinkError, StimlibError, reason, said_as
from .limits import limits

# Windows has no links and pipes to be careful of at a path, and reads text by default
NOFOLLOW, NONBLOCK = getattr(os, "O_NOFOLLOW", 0), getattr(os, "O_NONBLOCK", 0)
BINARY = getattr(os, "O_BINARY", 0)
FAR = 2**40  # a byte of a file that nobody reads, for the locks of Windows


def read(path: str | os.PathLike[str], limit: str, error: type[StimlibError] = SinkError) -> bytes:
    """Return all bytes of a regular file.

    Parameters
    ----------
    path : path
    limit : str
        Name of the limit on its size, see ``stimlib.limits``.
    error : type
        What is raised.

    Raises
    ------
    error
        Missing, not a regular file, not readable, or too large.

    Examples
    --------
    >>> from stimlib.system import safe_files
    >>> safe_files.read("/dev/zero", "scene_bytes")
    Traceback (most recent call last):
    stimlib.errors.SinkError: cannot read /dev/zero: it is not a regular file
    """
    with open(opened(path, error=error), "rb") as f:
        size = os.fstat(f.fileno()).st_size
        limits.check(limit, size, f"{path}: bytes", error)
        with said_as(error, f"cannot read {path}", OSError):
            data = f.read(size + 1)  # of a size that is not there would be taken from the memory
        if len(data) > size:
            raise error(f"cannot read {path}: it grows while it is read; wait until it is written")
        return data


def opened(
    path: str | os.PathLike[str], flags: int = os.O_RDONLY, error: type[StimlibError] = SinkError
) -> int:
    """Open a regular file without waiting, and return its descriptor.

    Anything but a regular file is refused. With flags for writing, it must be a file of
    stimlib's own: not reached through a link, and without a second name.
    """
    writes = bool(flags & (os.O_WRONLY | os.O_RDWR))
    what = f"cannot {'write' if writes else 'read'} {path}"
    if writes and os.path.islink(path):
        check(path, error)
    with said_as(error, what, OSError, ValueError):
        # a pipe without a writer would wait for ever
        fd = os.open(path, flags | NONBLOCK | BINARY | (NOFOLLOW if writes else 0), 0o666)
    info = os.fstat(fd)
    if not stat.S_ISREG(info.st_mode) or (writes and info.st_nlink > 1):
        os.close(fd)
        kind = "a directory, " if stat.S_ISDIR(info.st_mode) else ""
        raise error(f"{what}: it is {kind}not a regular file" + (" of its own" if writes else ""))
    return fd


def check(path: str | os.PathLike[str], error: type[StimlibError] = SinkError) -> None:
    """Raise an error unless a path is free or names a regular file to replace.

    Links are not followed.
    """
    try:
        mode = os.lstat(path).st_mode
    except FileNotFoundError:
        return
    except (OSError, ValueError) as e:
        raise error(f"cannot write {path}: {reason(e)}") from e
    if not stat.S_ISREG(mode):
        kind = (
            "a link"
            if stat.S_ISLNK(mode)
            else "a folder"
            if stat.S_ISDIR(mode)
            else "not a regular file"
        )
        raise error(
            f"cannot write {path}: it is there already and is {kind}; remove it, or write to"
            " another place"
        )


def create(path: str | os.PathLike[str], error: type[StimlibError] = SinkError) -> int:
    """Create an empty file for reading and writing, and return its descriptor.

    A file that a killed run left in its place is removed first.

    The name must be one that belongs to stimlib, such as NAME.part.
    """
    check(path, error)
    with said_as(error, f"cannot write {path}", OSError, ValueError):
        with suppress(FileNotFoundError):
            os.unlink(path)
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | NOFOLLOW | BINARY, 0o666)


def taken(
    stack: ExitStack, at: str | os.PathLike[str], error: type[StimlibError] = SinkError
) -> FileIO | None:
    """Open a lock file for this run alone, or return None if another run has it.

    It stays open until the stack or the process ends; the stack removes it, too.  The
    stack owns the file before it is locked, so that an interrupt at any moment releases
    it.
    """
    while True:
        check(at, error)
        if not NOFOLLOW:  # Windows removes no file that is open
            stack.callback(remove, at)
        f = stack.enter_context(open(opened(at, os.O_RDWR | os.O_CREAT, error), "r+b", buffering=0))
        if not held(f.fileno()):
            return None
        with suppress(FileNotFoundError):  # whoever had it just moved or removed it
            if os.path.samestat(os.fstat(f.fileno()), os.lstat(at)):
                stack.callback(remove, at)
                return f


def held(fd: int) -> bool:
    """Lock an open file or folder, and return whether that succeeded.

    It also returns True if the file system has no locks. On Windows one byte far beyond
    the end is locked, so that others can still read the file.
    """
    try:
        fcntl = import_module("fcntl")
    except ImportError:
        msvcrt, here = import_module("msvcrt"), os.lseek(fd, 0, os.SEEK_CUR)
        os.lseek(fd, FAR, os.SEEK_SET)
        try:
            msvcrt.locking(fd, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(fd, here, os.SEEK_SET)
        return True
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # a file system without locks
    return True


def remove(*paths: str | os.PathLike[str]) -> None:
    """Remove files if they exist."""
    for path in paths:
        with suppress(OSError):
            os.unlink(path)


def read_at(fd: int, size: int, at: int) -> bytes:
    """Return bytes of an open file from an offset, without moving its position."""
    if hasattr(os, "pread"):
        return os.pread(fd, size, at)
    here = os.lseek(fd, 0, os.SEEK_CUR)
    os.lseek(fd, at, os.SEEK_SET)
    try:
        return os.read(fd, size)
    finally:
        os.lseek(fd, here, os.SEEK_SET)


def publish(
    path: str | os.PathLike[str], data: bytes | str, error: type[StimlibError] = SinkError
) -> None:
    """Write a small file atomically.

    After an interruption the path holds the complete new file or what was there before.

    Parameters
    ----------
    path : path
        A link there is replaced, not followed; a folder, a pipe or a device is not.
        A temporary file beside it ends in ".part"; a run that is killed leaves it.
    data : bytes or str
        Text is written as UTF-8.
    error : type
        What is raised.

    Raises
    ------
    error
        The place cannot be written; whatever was there before still is.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from stimlib.system import safe_files
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "a.txt"
    >>> safe_files.publish(path, "whole")
    >>> path.read_text()
    'whole'
    """
    publish_all({path: data}, error)


def publish_all(files: Mapping[Any, bytes | str], error: type[StimlibError] = SinkError) -> None:
    """Write small files that belong together, each as ``publish`` does.

    All are on the disk before the first is moved into place, so that a full disk or a
    name that is taken leaves what was there before.
    """
    parts: list[tuple[Path, Path]] = []
    path = Path()
    try:
        for path, data in ((Path(name), data) for name, data in files.items()):
            if not os.path.islink(path):  # which takes any name
                check(path, error)
            parts.append((part_of(path), path))
            with open(create(parts[-1][0], error), "wb") as f:
                f.write(data if isinstance(data, bytes) else data.encode())
                f.flush()
                os.fsync(f.fileno())
        for part, path in parts:
            os.replace(part, path)
            settle(path.parent)
    except BaseException as e:
        remove(*(part for part, _ in parts))
        if isinstance(e, (OSError, ValueError)) and not isinstance(e, StimlibError):
            raise error(f"cannot write {path}: {reason(e)}") from e
        raise


def part_of(path: Path) -> Path:
    """Return a temporary name beside a file, which no other run has."""
    return path.with_name(f"{path.name}.{os.getpid()}-{secrets.token_hex(4)}.part")


def unused(path: Path) -> Path:
    """Return a path, or the first of NAME-2, NAME-3, .. that is free."""
    others = (path.with_name(f"{path.stem}-{k}{path.suffix}") for k in count(2))
    return next(p for p in chain([path], others) if not p.exists())


def settle(folder: Path) -> None:
    """Flush a folder's file names to the disk, if the file system supports it."""
    with suppress(OSError):
        fd = os.open(folder, os.O_RDONLY | BINARY)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


def make_folder(path: str | os.PathLike[str], error: type[StimlibError] = SinkError) -> Path:
    """Make a folder, and any missing folders above it."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as e:
        raise error(f"cannot make the folder {path}: {reason(e)}; name another") from e
    return Path(path)


def lock(folder: str | os.PathLike[str], busy: str, error: type[StimlibError] = SinkError) -> int:
    """Lock a folder, and return the descriptor that holds the lock.

    The lock lasts until the descriptor is closed or the process ends, however it ends.

    Parameters
    ----------
    folder : path
    busy : str
        What is said where somebody else has it.
    error : type
        What is raised then.
    """
    with said_as(error, f"cannot work in {folder}", OSError):
        if NOFOLLOW:
            fd = os.open(folder, os.O_RDONLY)
        else:  # Windows opens no folder
            fd = os.open(f"{folder}.lock", os.O_RDWR | os.O_CREAT | BINARY, 0o666)
    if not held(fd):
        os.close(fd)
        raise error(busy)
    return fd
