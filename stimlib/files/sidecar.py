"""The sidecar of a sound file, which describes the samples and is always checked."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from ..core import definitions
from ..errors import SinkError, counted, said_as, shown
from ..system import fields, safe_files
from .formats import BYTES, FORMATS
from .sound_file import soundfile

_COUNT = fields.whole(2**53)
_CHANNEL = {"name": fields.text, "unit": fields.text, "full_scale": fields.positive}
_CHANGE = {"at": _COUNT, "name": fields.text, "value": fields.number, "ramp": fields.not_negative}
DONE: dict[str, fields.Test] = {  # what a sidecar says
    "stimlib": fields.text,
    "format": fields.one_of(*FORMATS),
    "subtype": fields.one_of(*BYTES),
    "dither": fields.maybe(fields.whole(2**64 - 1)),
    "fs": fields.between(1, 2**31 - 1),
    "frames": _COUNT,
    "channels": fields.list_of(
        fields.record(_CHANNEL | {"clips": _COUNT, "peak": fields.not_negative})
    ),
    "sha256": fields.maybe(fields.text),
    "versions": fields.table_of(fields.maybe(fields.text)),
    "file_sha256": fields.text,
    "seed": fields.whole(2**64 - 1),
    "params": fields.table_of(fields.number),
    "index": _COUNT,
    "log": fields.list_of(fields.record(_CHANGE)),
    "motion": fields.table_of(fields.text),
    "scene": fields.table,
    "scene_hash": fields.text,
    "definitions": definitions.TEST,
}


@dataclass(frozen=True)
class FileReport:
    """The report of a written file; its str is one line.

    Attributes
    ----------
    path : Path
        The audio file.
    frames : int
        Samples per output.
    seconds : float, s
        frames / fs.
    clips : dict of str to int
        For each output, the number of samples limited to full scale; 0 in float
        formats.
    peak : dict of str to float
        For each output, the largest absolute value, in the output's unit.
    sidecar : Path
        The JSON file.

    Examples
    --------
    >>> print(
    ...     FileReport(
    ...         Path("a.wav"),
    ...         8000,
    ...         1.0,
    ...         {"force": 0},
    ...         {"force": 40.0},
    ...         Path("a.wav.json"),
    ...     )
    ... )
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
        return shown(
            f"{self.path}: {counted(self.frames, 'frame')}, {self.seconds:.6g} s, peak {peaks}"
            + (f", samples clipped: {clips}" if clips else "")
        )


def report_of(path: Path, info: dict[str, Any]) -> FileReport:
    """Return the report of a file, from its sidecar's data."""
    clips, peak = ({c["name"]: c[what] for c in info["channels"]} for what in ("clips", "peak"))
    return FileReport(
        path, info["frames"], info["frames"] / info["fs"], clips, peak, sidecar_of(path)
    )


def sidecar_of(path: Path) -> Path:
    """Return the path of a file's sidecar."""
    return path.with_name(path.name + ".json")


def told(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read and check the sidecar of a file, without reading the file.

    `stimlib.files.read` also compares it with the file.

    Raises
    ------
    SinkError
        The sidecar is missing, or was not written by stimlib.
    """
    return load(Path(path), sidecar_of(Path(path)))


def load(path: Path, sidecar: Path) -> dict[str, Any]:
    """Read and check a sidecar."""
    if not os.path.lexists(sidecar):
        raise SinkError(
            f"{path} has no sidecar {sidecar.name}, which has its units and full scale: put it back"
            " beside the file, or read the bare numbers with soundfile"
        )
    with said_as(SinkError, f"{sidecar} is not a sidecar that stimlib wrote", ValueError):
        info = fields.parse(safe_files.read(sidecar, "sidecar_bytes"))
        fields.require(info, DONE)
        if (
            info["subtype"] not in FORMATS[info["format"]]
            or not info["channels"]
            or info["fs"] != int(info["fs"])
        ):
            raise ValueError("there is no file of that format, subtype, fs and channels")
    return info


def text_of(info: dict[str, Any]) -> bytes:
    """Return the text of a sidecar, as bytes."""
    return (json.dumps(info, indent=1, allow_nan=False) + "\n").encode()


def describe(source: Any) -> str:
    """Return a motion as text."""
    if isinstance(source, np.ndarray):
        return f"array({len(source)})"
    # the address in the repr of a function would make two equal runs differ
    return re.sub(r" at 0x[0-9A-Fa-f]+", "", repr(source))


def read_of(sources: Mapping[str, Any]) -> dict[str, Any]:
    """Return what was skipped or assumed in the files of recordings, if anything."""
    notes = {name: getattr(s, "info", {}).get("read") for name, s in sources.items()}
    found = {name: list(texts) for name, texts in notes.items() if texts}
    return {"motion_read": found} if found else {}


def versions() -> dict[str, str]:
    """Return the versions of the packages that affect the bytes of a file."""
    sf = soundfile()
    used = {p: metadata.version(p) for p in ("numpy", "scipy", "llvmlite")}
    return used | {"soundfile": sf.__version__, "libsndfile": sf.__libsndfile_version__}
