"""Formats of sound files: what each can hold, and how it encodes samples."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.units import pretty
from ..errors import BadValue, SinkError, UnitError
from ..motion.source import check_names
from ..run.processor import Processor

Array = NDArray[np.float64]

# format of libsndfile -> subtypes that we write, the default first
ANY = ("FLOAT", "DOUBLE", "PCM_16", "PCM_24", "PCM_32")
FORMATS = {"WAV": ANY, "RF64": ANY, "W64": ANY, "CAF": ANY, "FLAC": ("PCM_24", "PCM_16")}
BITS = {"PCM_16": 16, "PCM_24": 24, "PCM_32": 32}  # of whole numbers
BYTES = {"FLOAT": 4, "DOUBLE": 8} | {name: bits // 8 for name, bits in BITS.items()}
# bytes of samples; the sizes in a WAV header have 32 bits, and 4096 is ample for the
# rest
MAX_WAV = 2**32 - 4096
# libsndfile stops at 1024; a CAF file with 400 channels is damaged by libsndfile 1.2.2
MAX_CHANNELS = {"WAV": 1024, "RF64": 1024, "W64": 1024, "CAF": 256, "FLAC": 8}


def format_of(path: Path, format: str | None, subtype: str | None) -> tuple[str, str]:
    """Return the format and subtype of a file, as given or from its name."""
    name = (path.suffix[1:] if format is None else str(format).lstrip(".")).upper()
    if name not in FORMATS:
        known = ", ".join("." + f.lower() for f in FORMATS)
        what = f"suffix of {path.name!r}" if format is None else f"format {format!r}"
        raise SinkError(f"{what} is not known; write one of {known}")
    sub = FORMATS[name][0] if subtype is None else str(subtype).upper()
    if sub not in FORMATS[name]:
        raise SinkError(
            f"{name} is written with subtype {', '.join(FORMATS[name][:-1])} or"
            f" {FORMATS[name][-1]}, not {subtype!r}"
        )
    return name, sub


def check_format(format: str, subtype: str, fs: float, channels: int, frames: int) -> None:
    """Raise SinkError unless rate, channels and duration fit the format."""
    if not (fs.is_integer() and 1 <= fs < 2**31):
        raise SinkError(
            f"an audio file needs a whole number of samples per second, not fs = {fs!r} Hz"
        )
    if format == "FLAC" and fs > 65535 and (fs > 655350 or fs % 10):
        raise SinkError(
            f"FLAC holds fs up to 65535 Hz, and multiples of 10 Hz up to 655350 Hz, not {fs:g} Hz"
        )
    most = MAX_CHANNELS[format]
    if channels > most:
        remedy = ".wav" if channels <= MAX_CHANNELS["WAV"] else "several files"
        raise SinkError(f"{format} holds up to {most} channels, not {channels}: write {remedy}")
    size = frames * channels * BYTES[subtype]
    if format == "WAV" and size > MAX_WAV:
        raise SinkError(
            f"WAV holds at most 4 GiB, this needs {size / 2**30:.2f} GiB: write .rf64, .w64 or .caf"
        )
    if format == "FLAC" and frames >= 2**36:
        raise SinkError(f"FLAC holds fewer than 2**36 frames, not {frames}")


def full_scales(full_scale: Any, proc: Processor, subtype: str) -> Array:
    """Return the full scale of each output, after checking it."""
    outputs = proc.outputs
    units = {proc.units[name] for name in outputs}
    if full_scale is None and subtype in BITS:
        unit = pretty(*units) if len(units) == 1 else "each output's unit, by name"
        unit = "the largest value that the file shall hold" if unit == "1" else f"in {unit}"
        raise BadValue(
            f"{subtype} has no samples above full scale: give full_scale, {unit}, or --full-scale"
        )
    if isinstance(full_scale, Mapping):
        check_names("full_scale", full_scale, outputs, "output")
        values = [full_scale[name] for name in outputs]
    else:
        if full_scale is not None and len(units) > 1:
            has = ", ".join(f"{name} ({pretty(proc.units[name])})" for name in outputs)
            option = ",".join(f"{name}=.." for name in outputs)
            raise UnitError(
                f"outputs have different units: {has}; give full_scale as a mapping by output name,"
                f" on the command line --full-scale {option}"
            )
        values = [1.0 if full_scale is None else full_scale] * len(outputs)
    try:
        scales = np.array([float(v) for v in values], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise BadValue(
            f"full_scale = {full_scale!r} is no number, nor a number for each output by its name"
        ) from None
    if not (np.isfinite(scales) & (scales > 0)).all():
        raise BadValue(f"full_scale must be finite and above 0, got {full_scale!r}")
    return scales


def interleaved(y: NDArray[Any], type: Any) -> NDArray[Any]:
    """Return samples, shape (n_outputs, n), as frames, shape (n, n_outputs)."""
    frames = np.empty(y.shape[::-1], type)
    for c, row in enumerate(y):  # four times as fast as frames.T[:] = y
        frames[:, c] = row
    return frames


def dither_of(seed: int, channels: int, at: int, n: int) -> Array:
    """Return triangular dither of samples at .. at + n - 1, shape (channels, n).

    It lies between -1 and 1 step. A sample has the same dither, however the file is
    cut.

    Source: Vanderkooy and Lipshitz, J. Audio Eng. Soc. 32 (1984): the sum of two
    uniform numbers, so that mean and variance of the rounding error do not depend on
    the signal.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.files.formats import dither_of
    >>> whole = dither_of(7, 2, 0, 1000)
    >>> np.array_equal(dither_of(7, 2, 301, 5), whole[:, 301:306])
    True
    >>> bool(abs(whole).max() < 1), round(float(np.var(whole)), 2)  # 1/6
    (True, 0.17)
    """
    first = at // 2  # one step of the counter makes four numbers
    rows = []
    for channel in range(channels):
        bits = np.random.Philox(key=[seed, channel])
        bits.advance(first)
        u = np.random.Generator(bits).random((at - 2 * first + n, 2))
        rows.append((u[:, 0] - u[:, 1])[at - 2 * first :])
    return np.array(rows).reshape(channels, n)


def encode(
    y: Array,
    scales: Array,
    subtype: str,
    outputs: tuple[str, ...],
    at: int = 0,
    dither: int | None = None,
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return samples as libsndfile expects them, and the number of limited samples.

    The samples have shape (n, n_outputs), and the counts are per output.  The first
    sample is the file's sample ``at``; ``dither`` is the seed of the dither, or None.
    """
    with np.errstate(over="ignore"):
        v = y / scales[:, None]
        if subtype in BITS:
            step, top = 32 - BITS[subtype], 2.0 ** (BITS[subtype] - 1)
            v *= top
            if dither is not None:
                v += dither_of(dither, len(v), at, v.shape[1])
            codes, limited = np.rint(v, out=v), np.zeros(len(v), dtype=np.int64)
            if codes.size and (codes.min() < -top or codes.max() > top - 1):
                limited = np.count_nonzero((codes < -top) | (codes > top - 1), axis=1)
                codes = np.clip(codes, -top, top - 1)
            whole = interleaved(codes, np.int32)
            whole <<= step  # libsndfile keeps the upper bits of the 32 as they are
            return whole, limited
        samples = interleaved(v, np.float32 if subtype == "FLOAT" else np.float64)
    if not np.isfinite(samples).all():
        name = outputs[int(np.argwhere(~np.isfinite(samples))[0][1])]
        raise SinkError(
            f"output {name} / full_scale is too large for {subtype}: use a larger full_scale"
        )
    return samples, np.zeros(len(outputs), dtype=np.int64)


def physical(samples: NDArray[Any], scales: Array) -> Array:
    """Convert file samples, shape (n, n_outputs), to physical units, (n_outputs, n)."""
    with np.errstate(over="ignore", invalid="ignore"):  # of files that stimlib did not write
        values = (
            samples * 2.0**-31
            if samples.dtype == np.int32
            else samples.astype(np.float64, copy=False)
        )
        return np.ascontiguousarray((values * scales).T)


def stored(y: Array, sidecar: dict[str, Any], at: int = 0) -> Array:
    """Return a signal as it reads from a file in this sidecar's format.

    It is rounded like the result of `stimlib.files.read`.

    Parameters
    ----------
    y : ndarray of float64, shape (n_outputs, n)
    sidecar : dict
    at : int
        Index in the file of the first sample.

    Returns
    -------
    ndarray of float64, shape (n_outputs, n)

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.files.formats import stored
    >>> stored(
    ...     np.array([[0.1]]),
    ...     {"subtype": "PCM_24", "channels": [{"name": "f", "full_scale": 1.0}]},
    ... )
    array([[0.10000002]])
    """
    scales = np.array([c["full_scale"] for c in sidecar["channels"]])
    names = tuple(c["name"] for c in sidecar["channels"])
    samples, _ = encode(y, scales, sidecar["subtype"], names, at, sidecar.get("dither"))
    return physical(samples, scales)
