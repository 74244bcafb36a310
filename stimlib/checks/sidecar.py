"""Is what a file says of itself true?  Every key of its sidecar against the file, the
scene and the samples made again.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np

from ..core import definitions
from ..errors import shown
from ..files.formats import stored
from ..files.sidecar import describe
from ..version import __version__
from .evidence import Check, Evidence

# what is held, and what is for the reader alone
HELD = {
    "format",
    "subtype",
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
TOLD = {"stimlib", "versions", "recovered"}

NOISE = 0.01  # of what changes within FAST: 40 dB below
DEEP = 1e-5  # of the whole signal: 100 dB below
CLIPPED = 0.25  # of the signal's rms, taken by clipping
FAST = 0.025  # s


def says(e: Evidence) -> list[Check]:
    """The sidecar of a file, key by key; samples, clips and the storage are compared
    elsewhere.
    """
    import soundfile as sf

    told = e.sidecar
    assert told is not None and e.path is not None
    found = sf.info(e.path)
    channels = told["channels"]
    recovered = "recovered" in told
    # of a run that was killed, the peak is of what is stored
    signal = stored(e.y, told) if recovered else e.y
    keys = {"name", "unit", "full_scale", "clips", "peak"}
    pairs: dict[str, tuple[Any, Any]] = {  # what it says, and what is so
        "format": ((told.get("format"), told.get("subtype")), (found.format, found.subtype)),
        "channel names": ([c["name"] for c in channels], list(e.scene.outputs)),
        "units": ([c["unit"] for c in channels], [str(b.dim) for b in e.scene.outputs.values()]),
        "peaks": (
            [c.get("peak") for c in channels],
            np.abs(signal).max(axis=1, initial=0.0).tolist(),
        ),
        "scene": (_hash(told.get("scene")), e.scene.hash),
        "definitions": definitions.hashes(told["definitions"], e.scene),
        "parameters": (told.get("params"), e.proc.params),
        "names of the motion": (sorted(told.get("motion", {})), sorted(e.motion)),
        "keys": (sorted(told.keys() - TOLD), sorted(HELD)),
        "keys of channels": ([sorted(c) for c in channels], [sorted(keys)] * len(channels)),
        "clips": (
            [c["clips"] is None for c in channels],
            [recovered and told.get("subtype") == "PCM_24"] * len(channels),
        ),
        "frames": (
            min(told["frames"], told["recovered"]["frames"] if recovered else told["frames"]),
            told["frames"],
        ),
    }
    bad = {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
    text = "; ".join(
        f"{name}: {says!s:.200}, and not {is_so!s:.200}" for name, (says, is_so) in bad.items()
    ) or ", ".join(pairs)
    checks = [Check("e", "sidecar: what it says", len(bad), 0, text)]
    if not recovered:
        sha = hashlib.sha256(np.ascontiguousarray(e.y.T, "<f8").data).hexdigest()
        checks.append(
            Check(
                "b",
                "sidecar: hash of the signal",
                int(sha != told.get("sha256")),
                0,
                "before it was rounded",
            )
        )
    _tell(e, told)
    return checks


def _hash(scene: Any) -> str:
    return hashlib.sha256(
        json.dumps(scene, sort_keys=True, separators=(",", ":")).encode()
    ).hexdigest()


def _tell(e: Evidence, told: dict[str, Any]) -> None:
    """What no check can hold."""
    e.skipped += definitions.changed(told["definitions"], e.scene)
    if told.get("stimlib") != __version__:
        e.skipped.append(
            f"for the reader only: written by stimlib {shown(told.get('stimlib'))}, this is"
            f" {__version__}"
        )
    if "recovered" in told:
        e.skipped.append(
            f"hash of the signal: the run was killed after {told['frames']} of"
            f" {told['recovered'].get('frames')} samples"
        )
    for name, source in e.motion.items():
        there, here = (
            told["motion"].get(name),
            describe(source if callable(source) else np.asarray(source)),
        )
        if there != here:
            e.skipped.append(
                f"motion of {name}: the sidecar says {shown(there)}, it was verified with"
                f" {shown(here)}"
            )
        length = (
            getattr(source, "info", {}).get("duration") if callable(source) else len(source) / e.fs
        )
        if length is not None and round(length * e.fs) > e.x.shape[1]:
            e.skipped.append(
                f"motion of {name}: the file ends {length - e.x.shape[1] / e.fs:.6g} s before it"
            )


def clipped(e: Evidence) -> list[int]:
    """Samples of each channel that the file's format cannot hold."""
    assert e.sidecar is not None
    if e.sidecar["subtype"] != "PCM_24":
        return [0] * len(e.y)
    codes = (
        np.rint(y / c["full_scale"] * 2**23)
        for y, c in zip(e.y, e.sidecar["channels"], strict=True)
    )
    return [int(np.sum((c > 2**23 - 1) | (c < -(2**23)))) for c in codes]


def storage(e: Evidence) -> list[Check]:
    """Whether the stored samples carry the stimulus: what rounding added, and what
    clipping took.
    """
    from scipy.ndimage import uniform_filter1d

    checks: list[Check] = []
    assert e.sidecar is not None
    size = max(2, round(FAST * e.fs))
    clips = clipped(e)
    for k, (name, b) in enumerate(e.scene.outputs.items()):
        y, error = e.y[k], e.shown[k] - e.y[k]
        scale = np.abs(y).max(initial=0.0) or 1.0
        y, error = y / scale, error / scale  # squares of 1e200 would be too large
        whole = _rms(y)
        if clips[k]:
            checks.append(
                Check(
                    "e",
                    f"{name}: clipped",
                    _rms(error),
                    CLIPPED * whole,
                    f"{clips[k]} samples; rms of what it took, of the peak",
                )
            )
            continue
        fast = _rms(y - uniform_filter1d(y, size))
        text = (
            f"rms of rounding to {e.sidecar['subtype']}, of the peak {scale:.3g} {b.dim}; {NOISE:g}"
            " of what is fast may be noise"
        )
        if not _rms(error) <= max(NOISE * fast, DEEP * whole):
            text += f"; write it with a full scale of about {1.01 * scale:.3g}"
        checks.append(
            Check(
                "e",
                f"{name}: stored finely enough",
                _rms(error),
                max(NOISE * fast, DEEP * whole),
                text,
            )
        )
    return checks


def _rms(y: np.ndarray) -> float:
    with np.errstate(over="ignore"):  # of a full scale that nobody means: it is inf then, and fails
        return float(np.sqrt(np.mean(y * y))) if y.size else 0.0
