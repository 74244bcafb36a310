"""The user's folder for what is kept between processes: compiled code and designs.

Nobody else can write there.
"""

from __future__ import annotations

import atexit
import concurrent.futures.thread  # noqa: F401 - has its hooks of a fork before one can wait here
import getpass
import os
import shutil
import stat
import tempfile
import threading
import warnings
from contextlib import suppress
from importlib import _bootstrap
from pathlib import Path
from typing import Any

import platformdirs

from ..errors import SinkError

lock = threading.RLock()
imports: Any = _bootstrap


def _hold() -> None:
    """Take the lock at a moment at which no thread imports a part of stimlib."""
    locks = getattr(imports, "_module_locks", {})  # private: without it, a fork does not wait
    for _ in range(100):
        lock.acquire()
        # a module that is looked for is in no public table
        if not (busy := [n for n in list(locks) if n.startswith("stimlib")]):
            return
        lock.release()  # which the import may need
        for name in busy:
            imports._lock_unlock_module(name)
    lock.acquire()


# a child has no thread that would finish an entry, or an import, and free what it holds
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_hold, after_in_parent=lock.release, after_in_child=lock.release)
_folder: Path | None = None


def folder() -> Path:
    """Return the folder: $STIMLIB_CACHE or the user's cache, or a temporary one.

    A RuntimeWarning says why it is temporary.

    Raises
    ------
    SinkError
        There is no folder for temporary files either.
    """
    global _folder
    wanted = chosen()
    with lock:
        if _folder is None or (_folder != wanted and not _folder.name.startswith("stimlib-tmp-")):
            try:
                _folder = private(wanted)
            except OSError as e:
                temporary(wanted, e)
        assert _folder is not None
        return _folder


def chosen() -> Path:
    """Return $STIMLIB_CACHE or the user's cache, without a check that it is usable.

    A user without a home, as in a container, has one among the temporary files.
    """
    if told := os.environ.get("STIMLIB_CACHE"):
        return Path(told).absolute()
    with suppress(RuntimeError):
        own = Path(platformdirs.user_cache_dir("stimlib"))
        if own.is_absolute():  # older releases give ~ as it is
            return own
    user = os.getuid() if hasattr(os, "getuid") else getpass.getuser()
    return Path(tempfile.gettempdir(), f"stimlib-{user}").absolute()


def private(wanted: Path) -> Path:
    """Make a folder if needed; raise OSError if other users can write to it."""
    for place in reversed((wanted, *wanted.parents)):
        if not place.exists():
            place.mkdir(mode=0o700, exist_ok=True)  # whatever the umask is
    _check_private(wanted.resolve())
    with tempfile.TemporaryFile(dir=wanted) as f:
        f.write(b"\0" * 65536)
    return wanted


def _check_private(place: Path) -> None:
    """Raise OSError unless a folder is private.

    It must be ours, nobody else may write to it, and nobody may replace it.
    """
    if problem := open_to_others(os.stat(place)):
        raise PermissionError(
            f"{problem}, but its contents are executed; make sure that it is yours, and `chmod"
            " go-w` it"
        )
    for above in place.parents:
        mode = os.stat(above).st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            raise PermissionError(
                f"everybody may replace the contents of {above}, but the cache is executed; `chmod"
                " o-w` it"
            )


def open_to_others(info: os.stat_result) -> str:
    """Return what keeps a folder or file from being private, if anything."""
    if not hasattr(os, "geteuid"):
        return ""  # no modes and owners on this system
    if info.st_uid not in (os.geteuid(), 0):
        return f"it belongs to user {info.st_uid}"
    return "others may write to it" if info.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else ""


def temporary(wanted: Path, why: OSError) -> None:
    """Use a temporary folder for this process instead, and warn why."""
    global _folder
    wrong = f"the cache folder {wanted} cannot be written safely ({why.strerror or why})"
    try:
        _folder = Path(tempfile.mkdtemp(prefix="stimlib-tmp-"))
    except OSError as e:
        raise SinkError(
            f"{wrong}, nor can a temporary one ({e.strerror}); set STIMLIB_CACHE to a folder of"
            " your own"
        ) from None
    atexit.register(shutil.rmtree, _folder, ignore_errors=True)
    warnings.warn(
        f"{wrong}: compiling into {_folder} for this process; set STIMLIB_CACHE to a folder of"
        " your own",
        RuntimeWarning,
        stacklevel=2,
    )
