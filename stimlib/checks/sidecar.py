"""Checks of a sidecar against its file.

Every key of its sidecar is compared with the file, the scene and the samples made
again.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any, NamedTuple

import numpy as np

from ..core import definitions
from ..errors import counted, shown
from ..files.formats import BITS, dither_of
from ..files.sidecar import describe, read_of
from ..files.sound_file import COMMENTED, comment_of
from ..version import __version__
from .evidence import Check, Evidence

# what is held, and what is for the reader alone
HELD = {
    "format",
    "subtype",
    "dither",
    "fs",
    "frames",
    "channels",
    "seed",
    "params",
    "index",
    "log",
    "motion",
    "scene",
    "scene_hash",
    "definitions",
    "sha256",
    "file_sha256",
}
TOLD = {"stimlib", "versions", "motion_read"}

NOISE = 0.01  # of what changes within FAST: 40 dB below
DEEP = 1e-5  # of the whole signal: 100 dB below
CLIPPED = 0.25  # of the signal's rms, taken by clipping
FAST = 0.025  # s


def says(e: Evidence, sums: Sums) -> list[Check]:
    """Check the sidecar of a file, key by key.

    Samples, clips and the storage format are compared elsewhere.
    """
    import soundfile as sf

    told = e.sidecar
    assert told is not None and e.path is not None
    with sf.SoundFile(e.path) as found:
        comment = found.comment
    channels, outputs = told["channels"], e.scene.outputs
    keys = ["clips", "full_scale", "name", "peak", "unit"]
    stated = {key: [c.get(key) for c in channels] for key in keys}
    scene = json.dumps(told.get("scene"), sort_keys=True, separators=(",", ":"))
    pairs: dict[str, tuple[Any, Any]] = {  # what it says, and what is so
        "format": ((told.get("format"), told.get("subtype")), (found.format, found.subtype)),
        "channel names": (stated["name"], list(outputs)),
        "units": (stated["unit"], [str(b.dim) for b in outputs.values()]),
        "peaks": (stated["peak"], sums.peaks.tolist()),
        "scene": (hashlib.sha256(scene.encode()).hexdigest(), e.scene.hash),
        "definitions": definitions.hashes(told["definitions"], e.scene),
        "parameters": (told.get("params"), e.proc.params),
        "names of the motion": (sorted(told.get("motion", {})), sorted(e.motion)),
        "keys": (sorted(told.keys() - TOLD), sorted(HELD)),
        "keys of channels": (list(map(sorted, channels)), [keys] * len(channels)),
        "comment": (comment, comment_of(told) if told["format"] in COMMENTED else ""),
        "clips": ([c is None for c in stated["clips"]], [False] * len(channels)),
    }
    bad = [
        f"{name}: {says!s:.200}, and not {is_so!s:.200}"
        for name, (says, is_so) in pairs.items()
        if says != is_so
    ]
    text = "; ".join(bad) or ", ".join(pairs)
    wrong = int(sums.sha256 != told.get("sha256"))
    _tell(e, told)
    return [
        Check("e", "sidecar: what it says", len(bad), 0, text),
        Check("b", "sidecar: hash of the signal", wrong, 0, "before it was rounded"),
    ]


def _tell(e: Evidence, told: dict[str, Any]) -> None:
    """List what no check can compare."""
    e.skipped += definitions.changed(told["definitions"], e.scene)
    if told.get("stimlib") != __version__:
        e.skipped.append(
            f"for the reader only: written by stimlib {shown(told.get('stimlib'))}, this is"
            f" {__version__}"
        )
    read, now = (t.get("motion_read") for t in (told, read_of(e.motion)))
    if read != now:
        e.skipped.append(
            f"lines and cells of the motion: the sidecar says {shown(read)}, it was verified"
            f" with {shown(now)}"
        )
    for name, source in e.motion.items():
        function = callable(source)
        there = told["motion"].get(name)
        here = describe(source if function else np.asarray(source))
        if there != here:
            e.skipped.append(
                f"motion of {name}: the sidecar says {shown(there)}, it was verified with"
                f" {shown(here)}"
            )
        info = getattr(source, "info", {})
        length = info.get("duration") if function else len(source) / e.fs
        if length is not None and round(length * e.fs) > e.frames:
            e.skipped.append(
                f"motion of {name}: the file ends {length - e.frames / e.fs:.6g} s before it"
            )


class Sums(NamedTuple):
    """The results of one pass over all samples of a file, for each output."""

    peaks: np.ndarray
    clips: np.ndarray  # samples that the file's format cannot hold
    sha256: str  # of the signal
    scales: np.ndarray  # the largest sample, or 1
    # over the scale: of the signal, of what is fast in it, and of what storage added;
    # shape (3, n_outputs)
    rms: np.ndarray


def sums_of(e: Evidence) -> Sums:
    """Return the results of all stretches of a file."""
    assert e.sidecar is not None
    full = np.array([c["full_scale"] for c in e.sidecar["channels"]])[:, None]
    size, digest = max(2, round(FAST * e.fs)), hashlib.sha256()
    peaks, tops, clips = np.zeros(len(e.y)), np.zeros(len(e.y)), np.zeros(len(e.y), int)
    parts = []  # of each stretch: its scale, mean squares over that, part of all samples
    for s in e.stretches():
        top = np.abs(s.y).max(axis=1, initial=0.0)
        peaks = np.fmax(peaks, top)
        digest.update(np.ascontiguousarray(s.y.T, "<f8").data)
        if bits := BITS.get(e.sidecar["subtype"]):
            seed, most = e.sidecar["dither"], 2 ** (bits - 1)
            noise = 0.0 if seed is None else dither_of(seed, len(s.y), s.at, s.y.shape[1])
            codes = np.rint(s.y / full * most + noise)
            clips += np.sum((codes > most - 1) | (codes < -most), axis=1)
        squares, scale = np.zeros((3, len(e.y))), np.where(top > 0, top, 1.0)
        for k, (y, got) in enumerate(zip(s.y, s.shown, strict=True)):
            error, y = (got - y) / scale[k], y / scale[k]  # squares of 1e200 would be too large
            squares[:, k] = [_square(row) for row in (y, y - _smoothed(y, size), error)]
        tops = np.fmax(tops, top)
        parts.append((scale, squares, s.y.shape[1] / e.frames))
    scales = np.where(tops > 0, tops, 1.0)
    with np.errstate(over="ignore"):
        rms = np.sqrt(
            np.sum(
                [squares * (scale / scales) ** 2 * share for scale, squares, share in parts], axis=0
            )
        )
    return Sums(peaks, clips, digest.hexdigest(), scales, rms)


def storage(e: Evidence, sums: Sums | None = None) -> list[Check]:
    """Check whether the stored samples represent the stimulus well enough.

    The check reports the error added by rounding and by clipping.
    """
    checks: list[Check] = []
    assert e.sidecar is not None
    sums = sums_of(e) if sums is None else sums
    for k, (name, b) in enumerate(e.scene.outputs.items()):
        whole, fast, error = sums.rms[:, k].tolist()
        scale, clips = float(sums.scales[k]), int(sums.clips[k])
        if clips:
            text = f"{counted(clips, 'sample')}; rms of what it took, of the peak"
            checks.append(Check("e", f"{name}: clipped", error, CLIPPED * whole, text))
            continue
        peak = f"{scale:.3g} {b.dim}".removesuffix(" 1")
        text = (
            f"rms of rounding to {e.sidecar['subtype']}, for a peak of {peak}; it may"
            f" be {NOISE:.0%} of the vibration"
        )
        if not error <= max(NOISE * fast, DEEP * whole):
            text += f"; write it with a full scale of about {1.01 * scale:.3g}"
        checks.append(
            Check(
                "e", f"{name}: stored finely enough", error, max(NOISE * fast, DEEP * whole), text
            )
        )
    return checks


def _smoothed(y: np.ndarray, n: int) -> np.ndarray:
    """Return the mean of n samples around each, mirrored at the ends."""
    around = np.pad(y, (n // 2 + 1, n - n // 2 - 1), "symmetric")  # scipy.ndimage loads slowly
    around[0] = 0.0
    sums = np.cumsum(around)
    return (sums[n:] - sums[:-n]) / n


def _square(y: np.ndarray) -> float:
    with np.errstate(over="ignore"):  # of a full scale that nobody means: it is inf then, and fails
        return float(np.mean(y * y)) if y.size else 0.0
