"""Patterns of other programs: AHAP, .haptic and .hjif files in, and out by analysis."""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from ..core.scene import Scene
from ..core.units import pretty
from ..errors import (
    BadValue,
    FaultError,
    SceneFileError,
    UnitError,
    counted,
    public,
    said_as,
    shown,
)
from ..run.processor import Processor
from ..run.rendering import Rendering, fault_text, render
from ..system import fields, safe_files
from .pattern_analysis import Band, analysed, events_of, loss
from .pattern_table import Pattern, PatternDevice, block_of
from .pattern_text import FORMATS, compare, read_ahap, simple


@dataclass(frozen=True)
class ImportedPattern:
    """A pattern of another program as a scene.

    Attributes
    ----------
    scene : Scene
        One output, ``vibration``, or ``channel1``, ``channel2``, ..
    seconds : float
        Its length.
    patterns : list of Pattern
        What the file says of each output, amplitudes 0 to 1.
    device : PatternDevice
        How its numbers were read.
    notes : list of str
        What of the file has no effect, by its JSON path: fields that the format does
        not have, dynamic parameters of envelopes, curves that go on after the
        vibration, and sound that was skipped.
    """

    scene: Scene
    seconds: float
    patterns: list[Pattern]
    device: PatternDevice
    notes: list[str]


@dataclass(frozen=True)
class PatternReport:
    """The report of a pattern that was written; its str has a line for each output.

    Attributes
    ----------
    path : Path
    full_scale : float
        Amplitude that is 1 in the file, in the unit of the outputs.
    unit : str
    points, taps : int
        Points of all amplitudes and frequencies, and transients, of all outputs.
    lost : dict of str to (float, float, list of (float, float, float))
        For each output: RMS of what the way back loses, over the RMS of the output, in
        dB, of the samples and of their envelopes; and for each octave its middle in Hz,
        the level of the output, and that of the file's scene, in dB re 1 unit RMS.
    """

    path: Path
    full_scale: float
    unit: str
    points: int
    taps: int
    lost: dict[str, tuple[float, float, list[Band]]]

    def __str__(self) -> str:
        one = f"{self.full_scale:.4g} {pretty(self.unit)}".strip()
        lines = [
            f"{self.path}: {counted(self.points, 'point')},"
            f" {counted(self.taps, 'transient')}; 1 stands for {one}"
        ]
        for name, (error, shape, bands) in self.lost.items():
            least = max((level for _, level, _ in bands), default=0.0) - 40
            heard = [f"{f:.4g} Hz {x:.1f} -> {y:.1f}" for f, x, y in bands if max(x, y) > least]
            lines.append(
                f"{name}: read back, it differs by {error:.1f} dB in samples, {shape:.1f} dB in its"
                " envelope (of the original's RMS: -20 dB is a tenth); octaves, original -> file,"
                f" in dB re 1 {pretty(self.unit) or 'unit'}: {', '.join(heard)}"
            )
        return shown("\n".join(lines))


@public
def read_pattern(
    path: str | os.PathLike[str],
    device: PatternDevice | None = None,
    skip_sound: bool = False,
) -> ImportedPattern:
    """Read an AHAP, .haptic or .hjif file as a scene.

    Continuous vibration is an ``oscillator`` with a ``timeline`` for its amplitude and
    one for its frequency; transients strike a ``ring``. Where a format leaves the
    physical vibration to the device, ``device`` says it.

    Parameters
    ----------
    path : path
        .ahap, .haptic (version 1) or .hjif. The file is data: nothing in it is run, and
        files that it names are not opened.
    device : PatternDevice, optional
        Full scale with its unit, frequencies, and the ring of a transient.
    skip_sound : bool
        Leave out the events of sound of an AHAP file, which are otherwise refused.

    Returns
    -------
    ImportedPattern

    Raises
    ------
    SceneFileError
        Not a file of this format, or what cannot be read: wavelet bands, sound, spatial
        perceptions; the message has the JSON path. Or too large, see
        ``stimlib.limits``.
    BadValue
        More points in one line than ``stimlib.limits.table_knots``.

    Examples
    --------
    >>> import pathlib, tempfile, stimlib
    >>> from stimlib.files import PatternDevice, read_pattern
    >>> text = '''{"Version": 1.0, "Pattern": [{"Event": {"Time": 0.1,
    ...     "EventType": "HapticContinuous", "EventDuration": 0.5, "EventParameters": [
    ...         {"ParameterID": "HapticIntensity", "ParameterValue": 0.5}]}}]}'''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "buzz.ahap")
    ...     _ = file.write_text(text)
    ...     buzz = read_pattern(file, PatternDevice(full_scale=2.0, unit="m/s^2"))
    >>> y = stimlib.render(buzz.scene, fs=8000, seconds=buzz.seconds)["vibration"]
    >>> buzz.seconds, round(float(abs(y).max()), 2)
    (0.6, 1.0)
    """
    path, device = Path(path), device or PatternDevice()
    shape, read, _ = format_of(path)
    data = safe_files.read(path, "scene_bytes", SceneFileError)
    if skip_sound and read is read_ahap:
        read = partial(read_ahap, skip_sound=True)
    with said_as(SceneFileError, str(path), ValueError, RecursionError):
        tree = fields.parse(data)
        unknown = Counter(re.sub(r"\[\d+\]", "[..]", place) for place in compare(tree, shape))
        patterns = read(tree, device)
    many = [f"channel{k + 1}" for k in range(len(patterns))]
    names, scale = many if len(many) > 1 else ["vibration"], device.full_scale or 1.0
    outputs = {n: block_of(p, scale, device) for n, p in zip(names, patterns, strict=True)}
    seconds = max(p.seconds for p in patterns)
    notes = [
        *(f"{at} is no field of this format and was ignored ({n} x)" for at, n in unknown.items()),
        *(note for p in patterns for note in p.notes),
    ]
    return ImportedPattern(Scene(outputs), seconds, patterns, device, [shown(n) for n in notes])


def format_of(path: Path) -> tuple[Any, Any, Any]:
    """Return shape, reader and writer of a file's format, from its name."""
    if path.suffix.lower() == ".hmpg":
        raise BadValue(
            f"{path}: the binary form of .hjif is neither read nor written; MPEG's reference"
            " software converts between the two: Decoder -f a.hmpg -o a.hjif"
        )
    if path.suffix.lower() not in FORMATS:
        raise BadValue(f"{path}: the suffix is not known; use one of {', '.join(FORMATS)}")
    return FORMATS[path.suffix.lower()]


@public
def write_pattern(
    path: str | os.PathLike[str],
    rendering: Rendering | ImportedPattern,
    device: PatternDevice | None = None,
    fs: float = 8000.0,
) -> PatternReport:
    """Write an AHAP, .haptic or .hjif file, and report what it loses.

    A rendering is analysed: the envelope and the instantaneous frequency of each output
    become points, and the events of ``ring`` and ``grain`` in its scene become
    transients. Only vibration above 20 Hz is kept, and one frequency at a time; noise
    becomes a wavering tone. Another program's pattern is taken over as it is where the
    format can say it, or else rendered and analysed.

    Parameters
    ----------
    path : path
        .ahap and .haptic hold one output, .hjif any number.
    rendering : Rendering or ImportedPattern
    device : PatternDevice, optional
        As for `read_pattern`; the full scale is by default the largest amplitude.
    fs : float
        Rate in Hz at which an ImportedPattern is rendered.

    Returns
    -------
    PatternReport

    Raises
    ------
    BadValue
        What the format cannot say: several outputs, a frequency outside ``f_lo`` ..
        ``f_hi``, an amplitude above ``full_scale``, silence.
    UnitError
        Outputs with different units.
    FaultError
        An output of the rendering was not finite; no file is written.
    SinkError
        The path cannot be written.

    Examples
    --------
    >>> import tempfile, stimlib
    >>> from stimlib.blocks import oscillator, timeline
    >>> from stimlib.files import write_pattern
    >>> fading = timeline([(0, 1.0), (1, 0.0)]) * oscillator(150)
    >>> made = stimlib.render(stimlib.Scene({"a": fading}), fs=8000, seconds=1.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = write_pattern(folder + "/fading.hjif", made)
    >>> [level < -20 for level in report.lost["a"][:2]]
    [True, True]
    """
    path, patterns, scale = Path(path), None, 0.0
    _, read, write = format_of(path)
    if isinstance(rendering, ImportedPattern):
        given, scale = rendering, rendering.device.full_scale or 1.0
        device = device or given.device
        rendering = render(given.scene, fs=fs, seconds=max(given.seconds, 1 / fs))
        if path.suffix.lower() == ".hjif" or simple(given.patterns):
            patterns = [p.scaled(scale) for p in given.patterns]
    if rendering.fault is not None:
        raise FaultError(fault_text(*rendering.fault, rendering.fs, f"{path} was not written"))
    device, names, fs = device or PatternDevice(), rendering.outputs, rendering.fs
    units = {str(Processor(rendering.scene, fs).units[n]) for n in names}
    if len(units) > 1:
        raise UnitError(
            f"the outputs are in {pretty(', '.join(sorted(units)))}; write one at a time"
        )
    if patterns is None:
        patterns = [analysed(rendering[n], fs, events_of(rendering, n), device) for n in names]
    peak, unit = max(p.peak for p in patterns), "".join(units - {"1"})
    if not all(rendering[n].any() for n in names) or not peak:
        raise BadValue(f"{', '.join(names)}: nothing moves above 20 Hz; there is nothing to write")
    scale = device.full_scale or max(scale, peak)
    if peak > scale * (1 + 1e-9):
        raise BadValue(
            f"full_scale = {scale:g} {pretty(unit)} is below the amplitude, {peak:.4g}"
            f" {pretty(unit)}; give a larger one (--full-scale), or none"
        )
    device = replace(device, full_scale=scale, unit=unit)
    tree = write([p.scaled(1 / scale) for p in patterns], device)
    back, lost = read(tree, device), {}
    for name, pattern in zip(names, back, strict=True):
        y, scene = rendering[name], Scene({name: block_of(pattern, scale, device)})
        lost[name] = loss(y, render(scene, fs=fs, seconds=y.size / fs)[name], fs)
    safe_files.publish(path, json.dumps(tree, indent=1, allow_nan=False) + "\n")
    points = sum(len(v.amplitude) + len(v.frequency) for p in back for v in p.voices)
    return PatternReport(path, scale, unit, points, sum(len(p.taps) for p in back), lost)
