"""AHAP, .haptic and .hjif: the JSON of each, read to and written from one table.

Every file is first compared with a shape, which bounds counts and numbers; an error
names the place as a JSON path.

Sources: Apple, "Representing haptic patterns in AHAP files" and CHHapticParameter.h;
Lofelt, "Haptic Data Model", version 1.0.0 (NiceVibrations, core/datamodel); ISO/IEC
23090-31 by its reference software (MPEGGroup/HapticReferenceSoftware: IOJson, Effect,
Band, AhapEncoder).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sized
from itertools import pairwise
from typing import Any

import numpy as np

from ..errors import BadValue, SceneFileError, shortened
from ..system import fields
from ..system.limits import limits
from .pattern_analysis import thinned
from .pattern_table import TAP_SECONDS, Pattern, PatternDevice, Point, Tap, Voice

Tree = dict[str, Any]

JUMP = 1e-6  # s that a jump of a curve takes
SPIKE = 2e-4  # s around a tap in which the curves of AHAP let it through
SHORTEST = 1e-3  # s of a decay
FINER = 16  # parts of a straight line where what is made of it is curved
CURVE_POINTS, EVENT_SECONDS = 16, 30.0  # the most that Core Haptics takes
INTENSITY, SHARPNESS = "HapticIntensityControl", "HapticSharpnessControl"
WAVES = {  # base signal -> waveform, phase, sign
    "Sine": ("sine", 0.0, 1.0),
    "Square": ("square", 0.0, 1.0),
    "Triangle": ("triangle", 0.0, 1.0),
    "SawToothUp": ("sawtooth", math.pi, 1.0),
    "SawToothDown": ("sawtooth", math.pi, -1.0),
}
CANNOT = {  # what is refused -> what to do
    "WaveletWave": "synthesise it with MPEG's reference software, and convert the sound file",
    "Timeline": "write its effects one by one",
    "AudioCustom": "take the event out or skip it (skip_sound=True, --skip-sound), and convert its"
    " sound file by itself",
    "AudioContinuous": "take the event out or skip it (skip_sound=True, --skip-sound)",
}
SOUNDS = ("AudioCustom", "AudioContinuous")

# The shapes of the files ("?": may be missing): an object, a list of what all items
# are, the least and the largest number, the known texts, or None where nothing is read.
# Apple's numbers are clamped where they are read.
TIME, PART, ANY = (0.0, 86_400.0), (0.0, 1.0), (-1e9, 1e9)
ENVELOPE = {"AttackTime": 0.0, "DecayTime": 0.0, "ReleaseTime": 0.0, "Sustained": 1.0}
EVENT = {"HapticIntensity": 1.0, "HapticSharpness": 0.5} | ENVELOPE
AUDIO = ("AudioVolume", "AudioPitch", "AudioPan", "AudioBrightness")
CONTROLS = tuple(
    f"{name}Control"
    for name in (
        "HapticIntensity HapticSharpness HapticAttackTime HapticDecayTime"
        " HapticReleaseTime AudioAttackTime AudioDecayTime AudioReleaseTime"
    ).split()
    + [*AUDIO]
)


def unread(names: str) -> Tree:
    """Return a shape of fields that the format has and nothing here reads."""
    return {f"{name}?": None for name in names.split()}


VALUE: Tree = {"Time?": TIME, "ParameterValue": ANY}
AHAP: Tree = {
    "Version?": None,
    "Metadata?": None,
    "Pattern": [
        {
            "Event?": {
                "EventType": ("HapticContinuous", "HapticTransient", *SOUNDS),
                **unread("EventWaveformPath EventWaveformUseVolumeEnvelope"),
                **unread("EventWaveformLoopEnabled"),
                "Time?": TIME,
                "EventDuration?": TIME,
                "EventParameters?": [VALUE | {"ParameterID": (*EVENT, *AUDIO)}],
            },
            "Parameter?": VALUE | {"ParameterID": CONTROLS},
            "ParameterCurve?": {
                "ParameterID": CONTROLS,
                "Time?": TIME,
                "ParameterCurveControlPoints": [VALUE],
            },
        }
    ],
}
HAPTIC: Tree = {
    "version": {"major": (1, 1), **unread("minor patch")},
    "metadata?": None,
    "signals": {
        "continuous": {
            "envelopes": {
                "amplitude": [
                    {
                        "time": TIME,
                        "amplitude": PART,
                        "emphasis?": {"amplitude": PART, "frequency": PART},
                    }
                ],
                "frequency?": [{"time": TIME, "frequency": PART}],
            }
        }
    },
}
FRAME: Tree = {
    "relative_position?": ANY,
    "amplitude_modulation?": (-1.0, 1.0),
    "frequency_modulation?": (0.0, 1e6),
}
EFFECT: Tree = unread("semantic_keywords") | {
    "effect_type?": ("Basis", "Reference"),
    "id?": ANY,
    "position?": (0.0, 1e9),
    "phase?": ANY,
    "base_signal?": tuple(WAVES),
    "keyframes?": [FRAME],
}
BAND: Tree = unread("block_length priority") | {
    "band_type": ("Transient", "VectorialWave", "Curve"),
    "curve_type?": ("Unknown", "Linear", "Cubic"),
    "lower_frequency_limit?": (0.0, 1e6),
    "upper_frequency_limit?": (0.0, 1e6),
    "effects": [EFFECT],
}
OVER_TIME = "Vibrotactile Vibration Force Pressure Acceleration Velocity Position Other"
HJIF: Tree = unread("version profile level date description avatars syncs") | {
    "timescale?": (1.0, 1e6),
    "perceptions": [
        unread(
            "id avatar_id description unit_exponent perception_unit_exponent reference_devices"
            " effect_semantic_scheme priority"
        )
        | {
            "perception_modality": tuple(OVER_TIME.split()),
            "effect_library?": [EFFECT | {"effect_type?": ("Basis",), "id": ANY}],
            "channels": [
                unread(
                    "id description mixing_coefficient mixing_weight body_part_mask actuator_target"
                    " actuator_resolution body_part_target reference_device_id frequency_sampling"
                    " sample_count vertices direction priority"
                )
                | {"gain?": (-1e6, 1e6), "bands": [BAND]}
            ],
        }
    ],
}


def wrong(path: str, what: str, remedy: str) -> SceneFileError:
    """Return the error for a place of a file."""
    return SceneFileError(f"{path} {what}; {remedy}")


def compare(value: Any, shape: Any, path: str = "$") -> Iterator[str]:
    """Yield the path of each field that a shape does not have, see the table of shapes.

    Raises
    ------
    SceneFileError
        The value has not the shape.
    """
    if shape is None:
        return
    if isinstance(shape, dict):
        if not isinstance(value, dict):
            raise wrong(path, "is not an object", "write it as {..}")
        for key, inner in shape.items():
            name = key.rstrip("?")
            if name in value:
                yield from compare(value[name], inner, f"{path}.{name}")
            elif name == key:
                raise wrong(f"{path}.{name}", "is missing", "give it")
        known = shape.keys() | {key.rstrip("?") for key in shape}
        yield from (f"{path}.{name}" for name in value if name not in known)
    elif isinstance(shape, list):
        if not isinstance(value, list):
            raise wrong(path, "is not a list", "write it as [..]")
        limits.check("scene_blocks", len(value), f"{path}: items", SceneFileError)
        for k, item in enumerate(value):
            yield from compare(item, shape[0], f"{path}[{k}]")
    elif isinstance(shape[0], str):
        if not (isinstance(value, str) and value in shape):
            remedy = CANNOT.get(str(value), f"use {', '.join(shape)}")
            raise wrong(path, f"= {shortened(value)} cannot be read", remedy)
    elif not (fields.number(value) and shape[0] <= value <= shape[1]):
        low, high = shape
        raise wrong(path, f"= {shortened(value)} is out of range", f"use {low:g} to {high:g}")


def rising(points: list[Any], path: str) -> list[Any]:
    """Return points, after checking that there are some and that their times rise."""
    times = [p[0] for p in points]
    if not times or times[0] < 0.0 or times[-1] > TIME[1] or times != sorted(times):
        why = "goes back in time" if times else "has no points"
        raise wrong(path, why, "give points from 0 to 86400 s, sorted by time")
    return points


def beyond(path: str, end: float, seconds: float) -> list[str]:
    """Return the note on a curve that goes on after the end of the vibration, if so."""
    return [f"{path} goes on to {end:g} s, and the vibration ends at {seconds:g} s"] * (
        end > seconds + SHORTEST
    )


def few_enough(line: Sized, path: str) -> None:
    """Raise SceneFileError before a line gets more points than a pattern may have."""
    limits.check("scene_blocks", FINER * len(line), f"{path}: points of a curve", SceneFileError)


def finer(row: np.ndarray) -> np.ndarray:
    """Return numbers, and points on the straight lines between them."""
    few_enough(row, "$.Pattern")
    k = np.arange(FINER * (row.size - 1) + 1) / FINER
    return np.interp(k, np.arange(row.size), row)


def course(points: list[Point], start: float) -> list[Point]:
    """Return a curve from a time on; before its first point it has that value."""
    t, v = np.array(points).T
    return [(start, float(np.interp(start, t, v))), *(p for p in points if p[0] > start)]


# AHAP ---------------------------------------------------------------------------------
def read_ahap(tree: Tree, device: PatternDevice, skip_sound: bool = False) -> list[Pattern]:
    """Return the pattern of an AHAP file; limit values out of range, as Apple does."""
    curves: dict[str, list[list[Point]]] = {INTENSITY: [], SHARPNESS: []}
    notes: list[str] = []
    ends: dict[str, float] = {}
    for k, item in enumerate(tree["Pattern"]):
        p = item.get("ParameterCurve") or item.get("Parameter") or {}
        if p.get("ParameterID") in curves:
            points = p.get("ParameterCurveControlPoints", [p | {"Time": 0.0}])
            line = [(p.get("Time", 0.0) + c.get("Time", 0.0), c["ParameterValue"]) for c in points]
            curves[p["ParameterID"]].append(rising(line, f"$.Pattern[{k}]"))
            ends[f"$.Pattern[{k}]"] = line[-1][0]
        elif (name := p.get("ParameterID", "")).startswith("Haptic"):
            notes.append(f"$.Pattern[{k}] changes times of envelopes ({name}) and was ignored")
    lines = joined(curves[INTENSITY], 1.0, 0.0), joined(curves[SHARPNESS], 0.0, -1.0)
    pattern, size = Pattern([], []), 0
    for k, item in enumerate(tree["Pattern"]):
        if not (event := item.get("Event")):
            continue
        if (sound := event["EventType"]) in SOUNDS:
            if not skip_sound:
                raise wrong(
                    f"$.Pattern[{k}].Event.EventType", f"= {sound!r} cannot be read", CANNOT[sound]
                )
            notes.append(f"$.Pattern[{k}].Event is sound ({sound}) and was skipped")
            continue
        given = EVENT | {
            p["ParameterID"]: min(1.0, max(0.0, p["ParameterValue"]))
            for p in event.get("EventParameters", [])
        }
        amplitude, frequency = modulated(envelope(event, given), lines, given, device)
        if event["EventType"] == "HapticContinuous" and "EventDuration" not in event:
            raise wrong(f"$.Pattern[{k}].Event.EventDuration", "is missing", "give it in s")
        if event["EventType"] == "HapticTransient":
            pattern.taps.append((*amplitude[0], frequency[0][1]))
        else:
            pattern.voices.append(Voice(amplitude, frequency))
        size += len(amplitude)
        limits.check("scene_blocks", size, f"$.Pattern[{k}]: points so far", SceneFileError)
    for path, end in ends.items():
        notes += beyond(path, end, pattern.seconds)
    return [pattern._replace(notes=tuple(notes))]


def joined(curves: list[list[Point]], default: float, low: float) -> np.ndarray:
    """Return the course of a dynamic parameter, shape (2, n): times and values.

    A curve holds its last value until the next begins.
    """
    line = [(-JUMP, default)]
    for curve in sorted(curves, key=lambda c: c[0][0]):
        start, cut = curve[0][0] - JUMP, line[-1]
        while len(line) > 1 and line[-1][0] >= start:
            cut = line.pop()
        t, v = zip(line[-1], cut, strict=True)
        line.append((start, float(np.interp(start, t, v))))
        for at, value in curve:
            line.append((max(at, line[-1][0] + JUMP), min(1.0, max(low, value))))
    return np.array(line).T


def envelope(event: Tree, given: dict[str, float]) -> list[Point]:
    """Return the envelope of an event: attack, and release or decay.

    Apple states neither curve nor unit of the three times; they are read as straight
    lines in s.
    """
    at, duration = event.get("Time", 0.0), event.get("EventDuration", 0.0)
    if event["EventType"] == "HapticTransient":
        return [(at, 1.0)]
    attack = min(given["AttackTime"], duration)
    rise = [(at, 0.0), (at + attack, 1.0)] if attack else [(at, 1.0)]
    if given["Sustained"] < 0.5:
        return [*rise, (at + attack + max(SHORTEST, given["DecayTime"]), 0.0)]
    end = at + max(duration, attack + JUMP)
    return [*rise, (end, 1.0), *([(end + r, 0.0)] if (r := given["ReleaseTime"]) else [])]


def modulated(
    shape: list[Point], lines: tuple[Any, Any], given: dict[str, float], device: PatternDevice
) -> tuple[list[Point], list[Point]]:
    """Return amplitude and frequency of an event under the curves."""
    t, v = np.array(shape).T
    inner = [x[np.searchsorted(x, t[0], "right") : np.searchsorted(x, t[-1])] for x, _ in lines]
    grid = np.unique(np.concatenate([t, *inner]))
    # where a sharpness that is no step reaches 0 or 1
    far = given["HapticSharpness"] + np.interp(grid, *lines[1]) - np.array([[0.0], [1.0]])
    i, n = np.nonzero((far[:, 1:] * far[:, :-1] < 0.0) & (np.diff(grid) > 2 * JUMP))
    edges = grid[n] + np.diff(grid)[n] * far[i, n] / (far[i, n] - far[i, n + 1])
    grid = np.unique(np.append(grid, edges))
    if device.power != 1.0 or (v.min() < 1.0 and np.ptp(np.interp(grid, *lines[0]))):  # curved
        grid = finer(grid)
    control, sharper = (np.interp(grid, *line) for line in lines)
    a = (given["HapticIntensity"] * np.interp(grid, t, v) * control) ** device.power
    sharp = np.clip(given["HapticSharpness"] + sharper, 0.0, 1.0).tolist()
    times, f = grid.tolist(), map(device.hertz, sharp)
    return list(zip(times, a.tolist(), strict=True)), list(zip(times, f, strict=True))


def write_ahap(patterns: list[Pattern], device: PatternDevice) -> Tree:
    """Return an AHAP file of one pattern."""
    amplitude, frequency, taps = only(patterns, "AHAP", device)
    lines: Any = [np.array([(0.0, 1.0)]).T, np.array([(0.0, 0.0)]).T]
    loud = [(t, a ** (1 / device.power)) for t, a, _ in taps]
    events: list[Tree] = []
    if amplitude:
        start, end = amplitude[0][0], amplitude[-1][0]
        line = amplitude
        if device.power != 1.0:  # between two points intensity is straight, and amplitude is not
            x, a = map(finer, np.array(amplitude).T)
            slope = np.maximum(a, 0.001) ** (1 / device.power - 1) / device.power
            line = thinned(x, a ** (1 / device.power), 0.01 * slope)
        level = [*line, (end + SPIKE, 1.0)]
        sharp = [*((t, device.part(f)) for t, f in frequency), (end + SPIKE, 0.0)]
        dull = [(t, -device.part(f)) for t, _, f in taps]
        lines = [let_through(level, loud, 1.0), let_through(sharp, dull, 0.0)]
        starts = [
            start + k * EVENT_SECONDS for k in range(math.ceil((end - start) / EVENT_SECONDS))
        ]
        events = [
            event_of("HapticContinuous", at, 1.0, 0.0, round(min(EVENT_SECONDS, end - at), 6))
            for at in starts
        ]
    for (t, intensity), (_, _, f) in zip(loud, taps, strict=True):
        held = amplitude and t >= amplitude[0][0]  # the curves act on taps, too
        level_at, sharp_at = (np.interp(t, *line) if held else line[1][-1] for line in lines)
        sharpness = max(0.0, device.part(f) - sharp_at)
        events.append(
            event_of("HapticTransient", t, min(1.0, intensity / max(level_at, 1e-9)), sharpness)
        )
    for name, line in zip((INTENSITY, SHARPNESS), lines, strict=True):
        points = line.T.tolist()
        for k in range(0, len(points) - 1, CURVE_POINTS - 1):
            part = points[k : k + CURVE_POINTS]
            control = [
                {"Time": round(t - part[0][0], 6), "ParameterValue": round(v, 5)} for t, v in part
            ]
            curve = {"ParameterID": name, "Time": round(part[0][0], 6)}
            events.append({"ParameterCurve": curve | {"ParameterCurveControlPoints": control}})
    return {"Version": 1.0, "Metadata": {"Project": "stimlib"}, "Pattern": events}


def let_through(line: list[Point], asked: list[Point], full: float) -> np.ndarray:
    """Return a course that has its full value at taps that it would weaken.

    For 0.2 ms on each side of a tap that is stronger (or less sharp) than the vibration
    around it, the curve lets it through.
    """
    t, v = np.array(line).T
    inside = [(at, x) for at, x in asked if t[0] <= at <= t[-1]]
    times = np.array([at for at, x in inside if x > (2 * full - 1) * np.interp(at, t, v)])
    far = lambda at, gap: np.abs(times - at).min(initial=1.0) > gap  # noqa: E731
    sides = [(at, np.interp(at, t, v)) for at in (*(times - SPIKE), *(times + SPIKE)) if at > 0]
    kept = [p for p in line if far(p[0], SPIKE)] + [p for p in sides if far(p[0], SPIKE / 2)]
    points = [*kept, *((at, full) for at in times)]
    return np.array(sorted(points, key=lambda p: p[0])).T  # a jump stays one down


def event_of(
    kind: str, at: float, intensity: float, sharpness: float, duration: float | None = None
) -> Tree:
    """Return an event of AHAP; a transient has no duration."""
    values = {"HapticIntensity": intensity, "HapticSharpness": sharpness}
    parameters = [
        {"ParameterID": name, "ParameterValue": round(float(v), 5)} for name, v in values.items()
    ]
    return {
        "Event": {"Time": round(at, 6), "EventType": kind, "EventParameters": parameters}
        | ({"EventDuration": duration} if duration is not None else {})
    }


# .haptic ------------------------------------------------------------------------------
def read_haptic(tree: Tree, device: PatternDevice) -> list[Pattern]:
    """Return the pattern of a .haptic file, version 1."""
    lines, path = tree["signals"]["continuous"]["envelopes"], "$.signals.continuous.envelopes"
    amplitude = [(p["time"], p["amplitude"]) for p in lines["amplitude"]]
    rising(amplitude, f"{path}.amplitude")
    silent = next((k for k, (_, a) in enumerate(amplitude) if a), 1) - 1
    del amplitude[: max(0, silent)]  # the wave begins where it can be heard
    frequency = [(p["time"], device.hertz(p["frequency"])) for p in lines.get("frequency", [])]
    line = rising(frequency or [(0.0, device.f_lo)], f"{path}.frequency")  # 0 by default
    taps = [
        (p["time"], p["emphasis"]["amplitude"], device.hertz(p["emphasis"]["frequency"]))
        for p in lines["amplitude"]
        if "emphasis" in p
    ]
    notes = beyond(f"{path}.frequency", line[-1][0], amplitude[-1][0])
    return [Pattern([Voice(amplitude, course(line, amplitude[0][0]))], taps, tuple(notes))]


def write_haptic(patterns: list[Pattern], device: PatternDevice) -> Tree:
    """Return a .haptic file of one pattern, version 1."""
    line, frequency, taps = only(patterns, ".haptic", device)
    line = [(line[0][0], 0.0), *line, (line[-1][0], 0.0)] if line else line
    t, v = np.array(line or [(0.0, 0.0)]).T
    points: list[Tree] = [{"time": round(at, 6), "amplitude": round(a, 5)} for at, a in line]
    for at, a, f in taps:
        under = round(float(np.interp(at, t, v)), 5)  # an emphasis is not below it
        emphasis = {"amplitude": max(under, round(a, 5)), "frequency": round(device.part(f), 5)}
        points.append({"time": round(at, 6), "amplitude": under, "emphasis": emphasis})
    hertz = [{"time": round(at, 6), "frequency": round(device.part(f), 5)} for at, f in frequency]
    lines = {"amplitude": sorted(points, key=lambda p: p["time"]), "frequency": hertz}
    return {
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": {"editor": "stimlib"},
        "signals": {"continuous": {"envelopes": lines}},
    }


# .hjif --------------------------------------------------------------------------------
def read_hjif(tree: Tree, device: PatternDevice) -> list[Pattern]:
    """Return the patterns of a .hjif file, one for each channel of all perceptions."""
    patterns, size = [], 0
    for i, perception in enumerate(tree["perceptions"]):
        effects = perception.get("effect_library", [])
        library = {effect["id"]: effect for effect in effects}
        if len(library) < len(effects):
            path = f"$.perceptions[{i}].effect_library"
            raise wrong(path, "has an id twice", "give each effect its own")
        for j, channel in enumerate(perception["channels"]):
            pattern = Pattern([], [])
            for k, band in enumerate(channel["bands"]):
                for n, effect in enumerate(band["effects"]):
                    path = f"$.perceptions[{i}].channels[{j}].bands[{k}].effects[{n}]"
                    per_second = tree.get("timescale", 1000)
                    size += read_effect(pattern, band, effect, library, per_second, path)
                    limits.check("scene_blocks", size, f"{path}: points so far", SceneFileError)
            patterns.append(pattern.scaled(channel.get("gain", 1.0)))
    if not patterns:
        raise wrong("$.perceptions", "has no channels", "give one at least")
    return patterns


def read_effect(
    pattern: Pattern, band: Tree, effect: Tree, library: Tree, per_second: float, path: str
) -> int:
    """Add an effect to the pattern of its channel, and return its number of points."""
    start = effect.get("position", 0.0)
    if effect.get("effect_type") == "Reference":
        if effect.get("id") not in library:
            raise wrong(f"{path}.id", "is not in effect_library", "add the effect there")
        effect = library[effect["id"]]
    frames = [
        ((start + f.get("relative_position", 0.0)) / per_second, f)
        for f in effect.get("keyframes", [])
    ]
    at, end = start / per_second, rising(frames, f"{path}.keyframes")[-1][0]
    amplitude, frequency = (
        [(t, f[key]) for t, f in frames if key in f]
        for key in ("amplitude_modulation", "frequency_modulation")
    )
    if band["band_type"] == "Transient":
        hertz = dict(frequency)
        pattern.taps.extend((t, a, hertz.get(t) or 2 / TAP_SECONDS) for t, a in amplitude)
    elif band["band_type"] == "Curve":
        rising(amplitude, f"{path}.keyframes")
        if band.get("curve_type") == "Cubic":  # level at its points
            few_enough(amplitude, path)
            z = np.arange(1, FINER + 1) / FINER
            amplitude[1:] = [
                (a + (b - a) * p, x + (y - x) * p * p * (3 - 2 * p))
                for (a, x), (b, y) in pairwise(amplitude)
                for p in z.tolist()
            ]
        pattern.voices.append(Voice(amplitude, [], "curve"))
    elif frequency:  # else it is a wave of 0 Hz
        low, high = band.get("lower_frequency_limit", 0.0), band.get("upper_frequency_limit", 1e6)
        shape, turned, sign = WAVES[effect.get("base_signal", "Sine")]
        line = [(t, sign * a) for t, a in amplitude or [(at, 1.0)]]
        line = course(line, at) + [(end, line[-1][1])] * (end > line[-1][0])
        held = [(t, min(max(low, high), max(low, f))) for t, f in frequency]
        phase = effect.get("phase", 0.0) + turned
        pattern.voices.append(Voice(line, course(held, at), shape, phase))
    return max(len(frames), len(amplitude))


def write_hjif(patterns: list[Pattern], device: PatternDevice) -> Tree:
    """Return a .hjif file with one channel for each pattern."""
    longest = max(p.seconds for p in patterns)
    # the binary form has 16 bits for a position; profile Main has 48 000 at most
    per_second = next((n for n in (8000, 4000, 2000) if n * longest < 2**16), 1000)
    channels = []
    for k, pattern in enumerate(patterns):
        taps = [
            (t, {"amplitude_modulation": round(a, 6), "frequency_modulation": round(f)})
            for t, a, f in sorted(pattern.taps)
        ]
        bands = [band_of("Transient", taps, 0.0, Voice([], []), per_second)] if taps else []
        for voice in pattern.voices:
            frames = [(t, {"amplitude_modulation": round(a, 6)}) for t, a in voice.amplitude]
            frames += [(t, {"frequency_modulation": round(f)}) for t, f in voice.frequency]
            kind = "VectorialWave" if voice.frequency else "Curve"
            frames.sort(key=lambda frame: frame[0])
            bands.append(band_of(kind, frames, voice.amplitude[0][0], voice, per_second))
        channels.append(
            {
                "id": k,
                "description": f"channel {k + 1}",
                "gain": 1.0,
                "mixing_weight": 1.0,
                "body_part_mask": 0,
                "bands": bands,
            }
        )
    return {
        "version": "2023",
        "profile": "Main",
        "level": 1,
        "date": "2023-01-01",  # the same bytes on every day
        "description": "stimlib",
        "timescale": per_second,
        "avatars": [],
        "perceptions": [
            {
                "id": 0,
                "avatar_id": 0,
                "description": "stimlib",
                "perception_modality": "Vibrotactile",
                "unit_exponent": -3,
                "perception_unit_exponent": 0,
                "reference_devices": [],
                "effect_library": [],
                "channels": channels,
            }
        ],
        "syncs": [{"timestamp": 0, "timescale": per_second}],
    }


def band_of(kind: str, frames: list[Any], start: float, voice: Voice, per_second: int) -> Tree:
    """Return a band of .hjif with one effect."""
    at = round(start * per_second)
    wave = next((n for n, (shape, _, _) in WAVES.items() if shape == voice.shape), "Sine")
    keys = [{"relative_position": round(t * per_second) - at} | frame for t, frame in frames]
    effect = {
        "effect_type": "Basis",
        "position": at,
        "phase": round((voice.phase - WAVES[wave][1]) % (2 * math.pi), 6),
        "base_signal": wave,
        "keyframes": keys,
    }
    return {
        "band_type": kind,
        "curve_type": "Unknown" if kind != "Curve" else "Linear",
        "lower_frequency_limit": 0,
        "upper_frequency_limit": max(1000, *(f.get("frequency_modulation", 0) for f in keys)),
        "effects": [effect],
    }


# All ----------------------------------------------------------------------------------
def only(
    patterns: list[Pattern], name: str, device: PatternDevice
) -> tuple[list[Point], list[Point], list[Tap]]:
    """Return amplitude, frequency and taps of the only pattern, after checking it."""
    if len(patterns) > 1:
        raise BadValue(
            f"{name} holds one channel, not {len(patterns)}; write .hjif, or a scene of one output"
        )
    voice = patterns[0].voices[0] if patterns[0].voices else Voice([], [])
    taps = sorted((t, abs(a), f) for t, a, f in patterns[0].taps)
    t, hertz = np.array(voice.frequency or [(0.0, device.f_lo)]).T
    heard = [(a, float(np.interp(at, t, hertz))) for at, a in voice.amplitude]
    margin = 0.02 * (device.f_hi - device.f_lo)
    for a, f in heard + [(a, f) for _, a, f in taps]:
        if a > 0.1 * patterns[0].peak and not -margin <= f - device.f_lo <= (
            device.f_hi - device.f_lo + margin
        ):
            raise BadValue(
                f"{name} holds {device.f_lo:g} to {device.f_hi:g} Hz, and there are {f:.4g} Hz;"
                " give f_lo and f_hi around it (--f-lo, --f-hi), or write .hjif"
            )
    return [(t, max(0.0, a)) for t, a in voice.amplitude], voice.frequency, taps


def simple(patterns: list[Pattern]) -> bool:
    """Return whether AHAP and .haptic can say patterns without an analysis."""
    voices = [v for p in patterns for v in p.voices]
    return len(voices) <= len(patterns) == 1 and all(
        v.shape == "sine" and min(a for _, a in v.amplitude) > -0.01 for v in voices
    )


# suffix -> shape, reader and writer
FORMATS: dict[str, tuple[Tree, Any, Any]] = {
    ".ahap": (AHAP, read_ahap, write_ahap),
    ".haptic": (HAPTIC, read_haptic, write_haptic),
    ".hjif": (HJIF, read_hjif, write_hjif),
}
