"""Moving a file and its sidecar into place together."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SinkError, counted
from ..system import safe_files
from .formats import Array
from .sidecar import FileReport, report_of, sidecar_of, text_of, versions
from .sound_file import Draft, comment_of, disk, move

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
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise SinkError(f"folder {path.parent} is not writable")


def publish(path: Path, info: dict[str, Any], run: Run, overwrite: bool) -> FileReport:
    """Write a file with ``run``; move file and sidecar into place, or neither.

    A run that is killed leaves a file whose name ends in .part, which nothing reads;
    the same rendering makes the same file again.
    """
    channels, sidecar = info["channels"], sidecar_of(path)
    part, ready = map(safe_files.part_of, (path, sidecar))
    for p in (part, ready):
        safe_files.check(p)
    try:
        with Draft(
            path,
            part,
            int(info["fs"]),
            len(channels),
            info["format"],
            info["subtype"],
            comment_of(info),
        ) as draft:
            clips, peak, info["sha256"] = run(draft.put)
            if draft.frames != info["frames"]:
                raise SinkError(
                    f"cannot write {path}: {counted(draft.frames, 'frame')} came, not"
                    f" {info['frames']}"
                )
            for c, clipped, largest in zip(channels, clips, peak, strict=True):
                c |= {"clips": int(clipped), "peak": float(largest)}
            info["versions"], info["file_sha256"] = versions(), draft.seal()
            with disk(path):
                with open(safe_files.create(ready), "wb") as f:
                    f.write(text_of(info))
                    f.flush()
                    os.fsync(f.fileno())
                try:
                    draft.move(path, overwrite)
                    try:
                        move(ready, sidecar, overwrite)
                    except SinkError:
                        os.unlink(path)  # ours, and nothing without its sidecar
                        raise
                except BaseException:
                    with suppress(OSError):
                        # interrupted between the moves: the first cannot be taken back
                        if draft.is_at(path):
                            move(ready, sidecar, overwrite)
                    raise
                safe_files.settle(path.parent)
    except BaseException:
        safe_files.remove(part, ready)
        raise
    return report_of(path, info)
