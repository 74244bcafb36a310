"""AHAP, .haptic and .hjif: what is read against closed forms, what is written against
the rules of each format, what is lost, and what is refused.
"""

import csv
import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from commands import ran
from memory import most_memory
from refusals import refused

import stimlib
from stimlib.blocks import at, grain, loop, oscillator, ring, rising, timeline, white_noise
from stimlib.errors import BadValue, FaultError, SceneFileError, UnitError
from stimlib.files import PatternDevice, read_pattern, write_pattern
from stimlib.files.pattern_analysis import analysed, analytic, loss
from stimlib.files.pattern_text import INTENSITY, SHARPNESS, read_ahap, read_hjif

ROOT = Path(__file__).parents[2]
FILES = ROOT / "tests" / "patterns"
FS, TAU, TAP = 8000.0, 0.0073, "HapticTransient"
PARAMETERS = {"HapticIntensity": 1.0, "HapticSharpness": 0.5}


def played(path, device=None, seconds=None):
    """Time and samples of a file's first output."""
    made = read_pattern(path, device)
    seconds = made.seconds + 0.01 if seconds is None else seconds
    y = stimlib.render(made.scene, fs=FS, seconds=seconds)
    return y.t, y.y[0]


def wave(t, start, hertz, phase=0.0):
    """A sine that begins at a time; its phase is the sum of the frequencies before."""
    f = np.where(t >= start, np.interp(t, *np.transpose(hertz)), 0.0)
    return np.sin(2 * np.pi * np.append(0.0, np.cumsum(f)[:-1]) / FS + phase)


def line(t, *points):
    """A course that is 0 before and from its end on."""
    x, y = np.transpose(points)
    return np.where((t >= x[0]) & (t < x[-1]), np.interp(t, x, y), 0.0)


def struck(t, time, height, hertz):
    z = t - round(time * FS) / FS
    return np.where(z >= 0, height * np.exp(-z / TAU) * np.sin(2 * np.pi * hertz * z), 0.0)


def ahap(folder, *items):
    path = folder / "made.ahap"
    path.write_text(json.dumps({"Pattern": [*items]}))
    return path


def happens(kind="HapticContinuous", **values):
    parameters = [{"ParameterID": n, "ParameterValue": v} for n, v in values.items() if n[0] != "_"]
    given = {"EventType": kind, "Time": values.get("_at", 0.0), "EventParameters": parameters}
    return {"Event": given | ({"EventDuration": values["_for"]} if "_for" in values else {})}


def step(name, at, value):
    return {"Parameter": {"ParameterID": name, "Time": at, "ParameterValue": value}}


def tap(at, height, sharpness=0.0):
    return happens(TAP, **{"HapticIntensity": height, "HapticSharpness": sharpness, "_at": at})


MIDDLE = [(0, 182.5), (1, 182.5)]  # Hz of half the sharpness


def curved(name, *points):
    """A curve of a parameter through these times and values."""
    points = [{"Time": at, "ParameterValue": value} for at, value in points]
    curve = {"ParameterID": name, "Time": 0.0, "ParameterCurveControlPoints": points}
    return {"ParameterCurve": curve}


LATE = curved(INTENSITY, (0.0, 0.0), (0.5, 1.0))
READ = {  # a file, or the items of an AHAP, and its samples at times t; how near, if not 1e-6
    "a tick of MPEG is a sine of 8 ms": (
        "tick1.hjif",
        lambda t: 0.8980392217636108 * line(t, (0, 1), (0.008, 1)) * np.sin(2 * np.pi * 125 * t),
    ),
    "an effect of the library starts again at its place": (
        "double_tick.hjif",
        lambda t: sum(
            0.9450980424880981
            * line(t, (s, 1), (s + 0.024, 1))
            * wave(t, s, [(s, 166), (s + 1, 166)])
            for s in (0.0, 0.421)
        ),
    ),
    "keyframes of amplitude and frequency, and a transient": (
        "boing.hjif",
        lambda t: (
            line(
                t, (0.015, 0.4901961088180542), (0.115, 0.23921573162078857), (0.265, -0.0039215684)
            )
            * wave(t, 0.015, [(0.015, 159), (0.265, 218)])
            + struck(t, 0.0, 0.6313725709915161, 300)
        ),
    ),
    "curves of intensity and sharpness": (
        "3_points.ahap",
        lambda t: line(t, (0, 0), (2, 0.4472136), (4, 0.6324555)) * wave(t, 0, [(0, 65), (4, 300)]),
    ),
    "a curve is relative to its time": (
        [
            happens(HapticIntensity=0.5, HapticSharpness=1.0, _for=1.0),
            {"ParameterCurve": LATE["ParameterCurve"] | {"Time": 0.25}},
        ],
        lambda t: (
            line(t, (0, 0.5), (0.25 - 1e-6, 0.5), (0.25, 0.0), (0.75, 0.5), (1.0, 0.5))
            * wave(t, 0, [(0, 300), (1, 300)])
        ),
    ),
    "an envelope times a curve is no straight line": (
        [
            happens(**PARAMETERS, AttackTime=0.4, _for=0.8),
            curved(INTENSITY, (0.0, 1.0), (0.2, 0.5), (0.4, 1.0)),
        ],
        lambda t: (
            line(t, (0, 0), (0.4, 1), (0.8, 1))
            * np.interp(t, [0, 0.2, 0.4], [1, 0.5, 1])
            * wave(t, 0, MIDDLE)
        ),
        4e-3,  # of 16 lines
    ),
    "a curve as long as its event": (
        [
            happens(**PARAMETERS, AttackTime=0.4, _for=0.8),
            curved(INTENSITY, (0.0, 1.0), (0.8, 0.0)),
        ],
        lambda t: line(t, (0, 0), (0.4, 1), (0.8, 1)) * (1 - t / 0.8) * wave(t, 0, MIDDLE),
        4e-3,  # of 16 lines
    ),
    "sharpness is clamped along a curve": (
        [
            happens(HapticSharpness=0.3, _for=0.8),
            curved(SHARPNESS, (0.0, -0.7), (0.8, 0.9)),
        ],
        lambda t: line(t, (0, 1), (0.8, 1)) * wave(t, 0, [(0.2, 65), (0.7, 300), (0.8, 300)]),
    ),
    "dynamic parameters step and sharpness is clamped": (
        [
            happens(HapticIntensity=0.8, HapticSharpness=0.5, _for=1.0),
            step("HapticIntensityControl", 0.4, 0.5),
            step("HapticSharpnessControl", 0.2, 0.9),
        ],
        lambda t: (
            np.where(t < 0.4 - 1e-9, 0.8, 0.4)
            * (t < 1.0)
            * wave(t, 0, [(0, 182.5), (0.2 - 1e-6, 182.5), (0.2, 300), (1, 300)])
        ),
    ),
    **{
        f"envelope {k} of Apple": (
            [happens(**PARAMETERS, **given, _at=0.1, _for=0.6)],
            lambda t, points=points: line(t, *points) * wave(t, 0.1, MIDDLE),
        )
        for k, (given, points) in enumerate(
            [
                ({"AttackTime": 0.2, "ReleaseTime": 0.3}, [(0.1, 0), (0.3, 1), (0.7, 1), (1, 0)]),
                ({"Sustained": 0, "DecayTime": 0.4}, [(0.1, 1), (0.5, 0)]),
                ({"Sustained": 0, "AttackTime": 0.05}, [(0.1, 0), (0.15, 1), (0.151, 0)]),
                ({}, [(0.1, 1), (0.7, 1)]),
            ]
        )
    },
    "transients ring and two at one time add up": (
        [tap(0.01, 0.5), tap(0.01, 0.25), tap(0.2, 1.0)],
        lambda t: struck(t, 0.01, 0.75, 65) + struck(t, 0.2, 1.0, 65),
    ),
    "full intensity and half the sharpness where nothing is stated": (
        [happens(_for=0.1)],
        lambda t: line(t, (0, 1), (0.1, 1)) * np.sin(2 * np.pi * 182.5 * t),
    ),
    "lines and emphasis of .haptic": (
        "ramp_down_with_emp.haptic",
        lambda t: (
            line(t, (0, 0.3), (2, 0)) * wave(t, 0, [(0, 65), (2, 65)])
            + struck(t, 2.0, 1.0, 65 + 0.7 * 235)
        ),
    ),
    "a line of frequency of .haptic": (
        "freq_ramp_up.haptic",
        lambda t: line(t, (0, 1), (2, 1)) * wave(t, 0, [(0, 300), (2, 65)]),
    ),
}


# What has no effect -------------------------------------------------------------------
SOUND = {"EventType": "AudioCustom", "Time": 0.2, "EventWaveformPath": "a.wav"}


def test_what_of_a_file_has_no_effect_is_noted(tmp_path):
    """Fields of no format, curves beyond the last event, and sound that is skipped."""
    odd = happens(**PARAMETERS, _for=1.0)
    odd["Event"]["Loudness"], odd["Note"] = 1.0, None
    steps = curved(INTENSITY, (0.0, 1.0), (2.5, 0.5)), step("HapticSharpnessControl", 1.0009, 0)
    slow = step("HapticDecayTimeControl", 0.5, 0.5)
    hum = SOUND | {"EventType": "AudioContinuous", "EventDuration": 9.0}
    path = ahap(tmp_path, odd, tap(0.5, 1.0), odd, *steps, {"Event": SOUND}, {"Event": hum}, slow)
    made = read_pattern(path, skip_sound=True)
    no_field = "is no field of this format and was ignored"
    assert made.notes == [
        f"$.Pattern[..].Event.Loudness {no_field} (2 x)",
        f"$.Pattern[..].Note {no_field} (2 x)",
        "$.Pattern[7] changes times of envelopes (HapticDecayTimeControl) and was ignored",
        "$.Pattern[5].Event is sound (AudioCustom) and was skipped",
        "$.Pattern[6].Event is sound (AudioContinuous) and was skipped",
        "$.Pattern[3] goes on to 2.5 s, and the vibration ends at 1 s",
    ]
    del odd["Event"]["Loudness"], odd["Note"]
    assert made.scene == read_pattern(ahap(tmp_path, odd, tap(0.5, 1.0), odd, *steps)).scene
    frequency = [{"time": 0.0, "frequency": 0.5}, {"time": 9.0, "frequency": 0.5}]
    late = changed("button1.haptic", put(*LINES, "frequency", frequency), tmp_path)
    (said,) = read_pattern(late, skip_sound=True).notes
    assert "envelopes.frequency goes on to 9 s" in said


def test_whole_files_of_each_format_and_our_own_have_no_notes(tmp_path):
    for path in sorted(FILES.glob("*.*")):
        if path.suffix != ".txt":
            made = read_pattern(path)
            assert not made.notes, (path, made.notes)
    made = read_pattern(FILES / "ramp_down_with_emp.haptic")
    for name in ("a.ahap", "a.haptic", "a.hjif"):
        write_pattern(tmp_path / name, made)
        assert read_pattern(tmp_path / name).notes == []


# Read ---------------------------------------------------------------------------------
@pytest.mark.parametrize("name", READ)
def test_a_file_is_read_as_its_closed_form(name, tmp_path):
    source, form, *near = READ[name]
    path = FILES / source if isinstance(source, str) else ahap(tmp_path, *source)
    t, y = played(path)
    assert np.abs(y - form(t)).max() < (near or [1e-6])[0]


def test_the_device_gives_units_frequencies_and_the_power_both_ways(tmp_path):
    device = PatternDevice(2.0, "m/s^2", 100.0, 200.0, power=2.0)
    continuous = happens(HapticIntensity=0.5, HapticSharpness=0.5, _for=0.5)
    made = read_pattern(ahap(tmp_path, continuous, tap(0.8, 0.5)), device)
    y = stimlib.render(made.scene, fs=FS, seconds=0.5)
    assert np.abs(y.y[0] - 2.0 * 0.25 * np.sin(2 * np.pi * 150 * y.t)).max() < 1e-6
    assert stimlib.compile(made.scene, FS).units["vibration"] == "m/s**2"
    assert made.patterns[0].taps[0][1] == pytest.approx(0.25)
    write_pattern(tmp_path / "back.ahap", made)
    items = json.loads((tmp_path / "back.ahap").read_text())["Pattern"]
    (event,) = [i["Event"] for i in items if i.get("Event", {}).get("EventType") == TAP]
    assert event["EventParameters"][0]["ParameterValue"] == pytest.approx(0.5)


def test_a_transient_without_a_frequency_has_two_periods_in_22_ms(tmp_path):
    frame = {"relative_position": 0, "amplitude_modulation": 0.5}
    path = changed("boing.hjif", put(*EFFECT, "keyframes", [frame]), tmp_path)
    assert read_pattern(path).patterns[0].taps == [(0.0, 0.5, pytest.approx(2 / 0.022))]


def test_curves_gains_channels_and_a_triangle():
    made = read_pattern(FILES / "two_channels.hjif")
    y = stimlib.render(made.scene, fs=FS, seconds=1.1)
    assert y.outputs == ("channel1", "channel2") and made.seconds == 1.0
    points = [(0.1, 0.0), (0.2, 1.0), (0.4, -1.0), (0.6, 0.0)]
    straight = line(y.t, *points)
    cubic = np.zeros_like(y.t)
    for (a, x), (b, z) in zip(points, points[1:], strict=False):
        h, inside = b - a, (y.t >= a) & (y.t < b)  # Effect::EvaluateKeyframes
        cubic[inside] = (x + (z - x) * (3 * h + 2 * (a - y.t)) * (y.t - a) ** 2 / h**3)[inside]
    assert np.abs(y["channel1"] - 0.5 * (straight + cubic)).max() < 4e-3  # of 16 lines
    top = np.abs(y["channel2"])
    assert top[y.t < 0.25].max() == 0.0 and 0.75 < top.max() <= 0.8
    turns = np.append(0.0, np.cumsum(np.where(y.t < 0.25, 0.0, 60.0))[:-1]) / FS + 1.5 / 2 / np.pi
    part = (y.t >= 0.25) & (y.t < 0.26)
    x = turns - 0.25  # Effect::computeBaseSignal
    triangle = 0.2 * (1 - 4 * np.abs(np.round(x) - x))
    assert np.abs(y["channel2"] - triangle)[part].max() < 0.08  # its frequency rises


@pytest.mark.parametrize("signal, sign", [("SawToothUp", 1.0), ("SawToothDown", -1.0)])
def test_saw_teeth_begin_at_their_middle_and_frequencies_have_limits(signal, sign, tmp_path):
    """Effect::computeBaseSignal: 2 (x - floor(x + 1/2)) of x periods, up or down."""
    frames = [
        {"relative_position": 0, "amplitude_modulation": 0.5, "frequency_modulation": 400},
        {"relative_position": 100, "amplitude_modulation": 0.5},
    ]
    effect = {"position": 0, "base_signal": signal, "keyframes": frames}
    band = {"band_type": "VectorialWave", "upper_frequency_limit": 100, "effects": [effect]}
    tree = json.loads((FILES / "tick1.hjif").read_text()) | {"timescale": 1000}
    tree["perceptions"][0]["channels"] = [{"gain": 0.5, "bands": [band]}]
    (tmp_path / "saw.hjif").write_text(json.dumps(tree))
    t, y = played(tmp_path / "saw.hjif", seconds=0.1)
    part = 100 * t - np.floor(100 * t + 0.5)
    far = np.abs(part) < 0.4  # from the jump
    assert np.abs(y - 0.5 * sign * part)[far].max() < 0.02


# Write --------------------------------------------------------------------------------
def test_a_step_down_stays_one_in_core_haptics(tmp_path):
    points = [(0.0, 0.8), (1.0, 0.8), (1.0, 0.2), (2.0, 0.2)]
    line = [{"time": t, "amplitude": a} for t, a in points]
    made = read_pattern(changed("button1.haptic", put(*LINES, "amplitude", line), tmp_path))
    write_pattern(tmp_path / "a.ahap", made)
    (voice,) = read_pattern(tmp_path / "a.ahap").patterns[0].voices
    found = np.interp([0.01, 0.5, 0.99, 1.01, 1.5, 1.99], *np.array(voice.amplitude).T)
    assert found == pytest.approx([0.8, 0.8, 0.8, 0.2, 0.2, 0.2], abs=1e-4)


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_a_straight_fade_stays_one_where_intensity_is_another_power(power, tmp_path):
    line = [{"time": t, "amplitude": 1.0 - t} for t in (0.0, 1.0)]
    made = read_pattern(changed("button1.haptic", put(*LINES, "amplitude", line), tmp_path))
    device, t = PatternDevice(power=power), np.linspace(0.0, 1.0, 101)
    write_pattern(tmp_path / "a.ahap", made, device)
    (voice,) = read_pattern(tmp_path / "a.ahap", device).patterns[0].voices
    assert np.abs(np.interp(t, *np.array(voice.amplitude).T) - (1.0 - t)).max() < 0.02


SIMPLE = [p.name for p in sorted(FILES.glob("*.*")) if p.suffix in (".ahap", ".haptic", ".hjif")]


@pytest.mark.parametrize("name", SIMPLE)
def test_what_was_read_is_written_in_its_format(name, tmp_path):
    """Without an analysis nothing but rounding is lost; integer Hz turn the phase."""
    made = read_pattern(FILES / name)
    report = write_pattern(tmp_path / f"b{Path(name).suffix}", made)
    alone = max(len(p.voices) for p in made.patterns) < 2
    for _, envelope, bands in report.lost.values():
        assert envelope < (-12.0 if alone else -25.0)
        assert envelope < -70 or name.endswith(".ahap")
        loud = max(level for _, level, _ in bands)
        assert all(abs(a - b) < (3.0 if alone else 6.0) for _, a, b in bands if a > loud - 12)


def of_haptic(tree):
    """Rules of NiceVibrations, core/datamodel/src/v1.rs, validate()."""
    lines = tree["signals"]["continuous"]["envelopes"]
    for key in ("amplitude", "frequency"):
        times = [p["time"] for p in lines[key]]
        assert times == sorted(times) and all(0 <= p[key] <= 1 for p in lines[key])
    for p in lines["amplitude"]:
        emphasis = p.get("emphasis", p | {"frequency": 0})
        assert p["amplitude"] <= emphasis["amplitude"] <= 1 and 0 <= emphasis["frequency"] <= 1


def of_hjif(tree):
    """Whole positions and frequencies."""
    assert (tree["profile"], tree["version"]) == ("Main", "2023")
    assert tree["timescale"] in (4000, 8000)
    for band in tree["perceptions"][0]["channels"][0]["bands"]:
        frames = band["effects"][0]["keyframes"]
        at = [frame["relative_position"] for frame in frames]
        assert at == sorted(at) and 0 <= at[0] <= at[-1] < 2**16
        hertz = [frame.get("frequency_modulation", 0) for frame in frames]
        assert {type(v) for v in at + hertz} == {int}


@pytest.mark.parametrize(
    "name", ["overlap.ahap", "boing.hjif", "rubberband.ahap", "heartbeats.hjif"]
)
@pytest.mark.parametrize("suffix, rules", [(".haptic", of_haptic), (".hjif", of_hjif)])
def test_what_is_written_keeps_the_rules_of_its_format(name, suffix, rules, tmp_path):
    write_pattern(tmp_path / f"a{suffix}", read_pattern(FILES / name))
    rules(json.loads((tmp_path / f"a{suffix}").read_text()))


@pytest.mark.parametrize(("suffix", "most"), [(".ahap", 8.0), (".haptic", 8.0), (".hjif", -40.0)])
def test_a_tone_comes_back_with_its_level_and_frequency(tmp_path, suffix, most):
    scene = stimlib.Scene({"a": timeline([(0, 0), (0.5, 3), (1, 0)], unit="N") * oscillator(150)})
    report = write_pattern(tmp_path / f"a{suffix}", stimlib.render(scene, fs=FS, seconds=1.0))
    error, envelope, bands = report.lost["a"]
    assert error < most and envelope < -45 and report.unit == "N"
    assert report.full_scale == pytest.approx(3.0, rel=0.01)
    before, after = next((a, b) for f, a, b in bands if f == 125)
    # rms of a triangle of sines: 3 / sqrt(3) / sqrt(2)
    assert before == pytest.approx(20 * np.log10(3 / 6**0.5), abs=0.05)
    assert after == pytest.approx(before, abs=0.1)
    hertz = np.array(read_pattern(tmp_path / f"a{suffix}").patterns[0].voices[0].frequency)[:, 1]
    assert np.abs(hertz - 150).max() < 1.0 or suffix != ".haptic"


HEIGHTS = timeline([(0, 0.5), (0.1, -1.0), (0.205, 0.3)], "step", "N")
RISEN = rising(stimlib.Input("x", "m"), stimlib.Param("at", 0.01, "m"))
CLICK = np.exp(-np.arange(400) / FS / TAU) * np.sin(2 * np.pi * 200 * np.arange(400) / FS)
LINES_OF_40_S = timeline([(k * 1.0, 0.2 + 0.1 * (k % 3)) for k in range(41)]) * oscillator(
    timeline([(0, 100), (40, 250)], unit="Hz")
)
TAPPED = {  # a scene, how it is rendered, its format, and times, heights and Hz of transients
    "rings": (
        ring(at([0.05, 0.2, 0.21]) * HEIGHTS, 120.0, TAU)
        + 0.2 * timeline([(0, 1)], unit="N") * oscillator(200),
        {"seconds": 0.5},
        ".hjif",
        [(0.05, 0.5, 120), (0.2, -1.0, 120), (0.21, 0.3, 120)],
    ),
    "on a constant force": (
        2.0 + ring(at([0.1]), 200.0, TAU) + grain(at([0.3]), CLICK, FS),
        {"seconds": 0.5},
        ".hjif",
        [(0.1, 1.0, 200), (0.3, 1.0, 200)],
    ),
    "of the same motion and parameters": (
        ring(0.5 * RISEN, 150, TAU),
        {"seconds": 0.3, "motion": {"x": lambda t: 0.1 * t}, "params": {"at": 0.02}},
        ".haptic",
        [(0.2, 0.5, 150)],
    ),
    "none in the body of a loop": (
        loop(lambda y: ring(rising(y + oscillator(10), 0.5), 150, TAU)),
        {"seconds": 0.5},
        ".hjif",
        [],
    ),
    "before the lines": (
        timeline([(0, 0), (0.5, 1)], "step") * oscillator(150) + ring(at([0.1]), 100.0, TAU),
        {"seconds": 2.0},
        ".ahap",
        [(0.1, 1.0, 100)],
    ),
    "between the lines of Core Haptics": (
        LINES_OF_40_S + ring(at([10.0, 20.0]), 100.0, TAU),
        {"seconds": 40.0, "fs": 2000.0},
        ".ahap",
        [(10.0, 1.0, 100), (20.0, 1.0, 100)],
    ),
}


@pytest.mark.parametrize("name", TAPPED)
def test_rings_of_a_scene_become_transients(name, tmp_path):
    block, how, suffix, taps = TAPPED[name]
    path, made = (
        tmp_path / f"a{suffix}",
        stimlib.render(stimlib.Scene({"a": block}), **{"fs": FS} | how),
    )
    report = write_pattern(path, made)
    assert report.taps == len(taps) and report.points + len(taps) > 1
    found = sorted(read_pattern(path).patterns[0].taps)
    for (t, a, f), (time, height, hertz) in zip(found, taps, strict=True):
        assert (t, f) == (pytest.approx(time, abs=2e-4), pytest.approx(hertz, abs=2))
        assert a * report.full_scale == pytest.approx(height, abs=0.25)
    if suffix == ".ahap":  # the limits of Core Haptics
        items = json.loads(path.read_text())["Pattern"]
        events = [i["Event"] for i in items if "Event" in i]
        assert max(e.get("EventDuration", 0) for e in events) <= 30.0
        curves = [
            i["ParameterCurve"]["ParameterCurveControlPoints"]
            for i in items
            if "ParameterCurve" in i
        ]
        assert max(map(len, curves)) <= 16 and min(p["Time"] for c in curves for p in c) >= 0
        values = [p["ParameterValue"] for e in events for p in e["EventParameters"]]
        assert 0 <= min(values) and max(values) <= 1


def test_the_loss_is_that_of_known_signals(tmp_path):
    y = np.sin(2 * np.pi * 250 * (np.arange(8000) / FS))
    error, envelope, bands = loss(y, 0.9 * y, FS)
    assert error == pytest.approx(-20, abs=1e-6) and envelope == pytest.approx(-20, abs=1e-6)
    levels = {f: (a, b) for f, a, b in bands}
    lower = -3.0103 - 0.9151
    assert levels.pop(250) == (pytest.approx(-3.0103, abs=1e-3), pytest.approx(lower, abs=1e-3))
    assert max(a for a, _ in levels.values()) < -60  # a tone is in one octave
    error, envelope, _ = loss(y, -y, FS)  # a phase is lost, an envelope is not
    assert error == pytest.approx(6.0206, abs=1e-3) and envelope < -150
    made = stimlib.render(stimlib.Scene({"a": white_noise(1)}), fs=FS, seconds=0.5)
    report = write_pattern(tmp_path / "a.hjif", made)
    assert report.lost["a"][0] > -1.0 and "read back, it differs by" in str(report)
    slow = stimlib.render(stimlib.Scene({"a": oscillator(25)}), fs=80.0, seconds=2.0)
    assert "read back" in str(write_pattern(tmp_path / "a.hjif", slow))  # below all octaves


# Refuse -------------------------------------------------------------------------------
def changed(name, change, folder):
    """A file, or a text, with a change."""
    text = change
    if callable(change):
        tree = json.loads((FILES / name).read_text())
        change(tree)
        text = json.dumps(tree)
    (folder / name).write_text(text)
    return folder / name


BAND = "perceptions", 0, "channels", 0, "bands", 0


def put(*keys):
    *way, last, value = keys

    def change(tree):
        for key in way:
            tree = tree[key]
        tree[last] = value

    return change


EFFECT = (*BAND, "effects", 0)
LINES = "signals", "continuous", "envelopes"
TAP_AT = f'"EventType": "{TAP}", "Time"'


@pytest.mark.parametrize(
    "name, change, says",
    [
        ("pop.ahap", put("Pattern", {}), r"\$\.Pattern is not a list; write"),
        ("pop.ahap", put("Pattern", [3]), r"\$\.Pattern\[0\] is not an object"),
        ("pop.ahap", put("Pattern", 0, "Event", "Time", -1), r"Event\.Time = -1 is out of range"),
        ("pop.ahap", put("Pattern", 0, "Event", "Time", 1e9), "Time = 1000000000.0 is out of"),
        ("pop.ahap", put("Pattern", 0, "Event", "Time", True), "Time = True is out of range"),
        (
            "pop.ahap",
            put("Pattern", 0, "Event", "EventType", "AudioCustom"),
            r"\$\.Pattern\[0\]\.Event\.EventType = 'AudioCustom' cannot be read; take .*skip_sound",
        ),
        (
            "pop.ahap",
            put("Pattern", 0, "Event", "EventParameters", 0, "ParameterID", "Loudness"),
            "= 'Loudness' cannot be read; use HapticIntensity",
        ),
        (
            "rubberband.ahap",
            put("Pattern", 3, "ParameterCurve", "ParameterCurveControlPoints", 1, "Time", 9),
            r"\$\.Pattern\[3\] goes back in time; give",
        ),
        (
            "rubberband.ahap",
            put("Pattern", 3, "ParameterCurve", "ParameterCurveControlPoints", []),
            r"\$\.Pattern\[3\] has no points",
        ),
        (
            "dynamic.ahap",
            lambda tree: tree["Pattern"][0]["Event"].pop("EventDuration"),
            r"\$\.Pattern\[0\]\.Event\.EventDuration is missing; give it",
        ),
        ("button1.haptic", put("version", "major", 2), r"\$\.version\.major = 2 is out of range"),
        (
            "button1.haptic",
            put(*LINES, "amplitude", 2, "emphasis", "amplitude", 1.5),
            r"amplitude\[2\]\.emphasis\.amplitude = 1.5 is out of range; use 0 to 1",
        ),
        (
            "button1.haptic",
            put(*LINES, "amplitude", 2, "time", 1.0),
            r"\$\.signals\.continuous\.envelopes\.amplitude goes back in time",
        ),
        ("button1.haptic", put(*LINES, "amplitude", []), "amplitude has no points"),
        (
            "tick1.hjif",
            put(*BAND, "band_type", "WaveletWave"),
            "'WaveletWave' cannot be read; synthesise it with MPEG's reference software",
        ),
        (
            "tick1.hjif",
            put(*EFFECT, "keyframes", 0, "relative_position", 65534),
            r"bands\[0\]\.effects\[0\]\.keyframes goes back in time",
        ),
        ("tick1.hjif", put(*EFFECT, "keyframes", []), "keyframes has no points"),
        (
            "tick1.hjif",
            put("perceptions", 0, "perception_modality", "Stiffness"),
            "'Stiffness' cannot be read; use Vibrotactile",
        ),
        ("tick1.hjif", put("perceptions", []), r"\$\.perceptions has no channels"),
        ("double_tick.hjif", put(*EFFECT, "id", 7), r"effects\[0\]\.id is not in effect_library"),
        ("tick1.hjif", put("timescale", 0), r"\$\.timescale = 0 is out of range"),
        (
            "double_tick.hjif",
            lambda tree: tree["perceptions"][0]["effect_library"].extend(
                tree["perceptions"][0]["effect_library"]
            ),
            r"effect_library has an id twice",
        ),
        ("two_channels.hjif", put(*BAND, "curve_type", "Bezier"), "'Bezier' cannot be read"),
        ("a.ahap", f'{{"Pattern": [{{"Event": {{{TAP_AT}: NaN}}}}]}}', "not a finite"),
        ("a.ahap", f'{{"Pattern": [{{"Event": {{{TAP_AT}: 1e999}}}}]}}', "not a finite"),
        ("a.ahap", '{"Pattern": ' + "[" * 100_000, "nested too deeply"),
        ("a.ahap", '{"Pattern": [{"Event": {"Time": 0, "Time": 1}}]}', "there twice"),
        ("a.ahap", "{}", r"\$\.Pattern is missing"),
    ],
)
def test_a_file_that_cannot_be_read_says_where_and_what_to_do(name, change, says, tmp_path):
    refused(SceneFileError, says, read_pattern, changed(name, change, tmp_path))


def hjif_of(n, effects=1):
    frames = [{"relative_position": k, "amplitude_modulation": 0.5} for k in range(n)]
    band = {
        "band_type": "Curve",
        "curve_type": "Cubic",
        "effects": [{"keyframes": frames}] * effects,
    }
    return {"perceptions": [{"channels": [{"bands": [band]}]}]}


@pytest.mark.parametrize(
    ("call", "tree", "says", "points"),
    [
        (read_hjif, lambda: hjif_of(2000), "320.. .*limits.scene_blocks", 2000),
        (
            read_ahap,
            lambda: {
                "Pattern": [
                    curved(INTENSITY, *((k / 2000, 0.5) for k in range(2000))),
                    happens(_for=1.0),
                ]
            },
            "320.. .*limits.scene_blocks",
            2000,
        ),
        (read_hjif, lambda: hjif_of(1200, 2), r"effects\[1\]: points so far", 7 * 1200),
    ],
)
def test_curves_of_too_many_points_are_refused_before_they_are_made(
    call, tree, says, points, monkeypatch
):
    """The points of the file are in memory, and sixteen times as many of those curves
    alone that are within the limits.
    """
    monkeypatch.setattr(stimlib.limits, "scene_blocks", 20_000)
    _, most = most_memory(refused, SceneFileError, says, *(call, tree(), PatternDevice(power=2.0)))
    assert most < 600 * points


def test_counts_and_sizes_are_bounded(tmp_path, monkeypatch):
    path = ahap(tmp_path, *[happens("HapticTransient")] * 20)
    monkeypatch.setattr(stimlib.limits, "scene_blocks", 10)
    refused(SceneFileError, r"\$\.Pattern: items: 20 is more than limits", read_pattern, path)
    many = changed("fill1.hjif", put(*BAND, "curve_type", "Unknown"), tmp_path)
    refused(SceneFileError, "points so far", read_pattern, many)
    monkeypatch.setattr(stimlib.limits, "scene_bytes", 100)
    refused(SceneFileError, "bytes: ", read_pattern, path)


TONE = oscillator(150)
UNSAID = [  # outputs, a device, the error and what it says
    ({"a": TONE, "b": TONE}, {}, BadValue, "one channel, not 2; write .hjif"),
    ({"a": oscillator(700)}, {}, BadValue, "65 to 300 Hz, .*(69|70).* Hz; give f_lo"),
    ({"a": oscillator(312)}, {}, BadValue, "65 to 300 Hz, .*3[01].* Hz"),
    ({"a": 0 * TONE}, {}, BadValue, "nothing moves above 20 Hz"),
    ({"a": TONE, "b": timeline([(0, 1)], unit="N")}, {}, UnitError, "are in 1, N"),
    ({"a": TONE / timeline([(0, 1), (0.1, 0)])}, {}, FaultError, "was not written"),
    ({"a": TONE}, {"full_scale": 0.9}, BadValue, "full_scale = 0.9 .*below"),
]


@pytest.mark.parametrize(("outputs", "device", "error", "says"), UNSAID)
def test_what_a_format_cannot_say_is_refused(outputs, device, error, says, tmp_path):
    made = stimlib.render(stimlib.Scene(outputs), fs=FS, seconds=0.3, on_fault="ignore")
    refused(error, says, write_pattern, *(tmp_path / "a.ahap", made, PatternDevice(**device)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: PatternDevice(f_lo=300.0), "f_lo = 300 Hz .*below"),
        (lambda: PatternDevice(decay=0.0), "decay = 0.0"),
        (lambda: write_pattern("a.ahp", read_pattern(FILES / "pop.ahap")), "suffix is not known"),
        (lambda: read_pattern("a.txt"), "suffix is not known"),
        (lambda: read_pattern("a.hmpg"), "binary form of .hjif is neither .*-o a.hjif"),
    ],
)
def test_devices_and_names_that_are_none(call, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(BadValue, says, call)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("part", "refuses"), [(0.2, True), (0.05, False)])
def test_what_is_a_tenth_of_the_peak_or_less_may_be_at_any_frequency(part, refuses, tmp_path):
    items = [happens(HapticIntensity=0.5, HapticSharpness=0.3, _for=1.0)]
    items += [step("HapticIntensityControl", 0.5, part), step("HapticSharpnessControl", 0.5, 0.7)]
    made = read_pattern(ahap(tmp_path, *items), PatternDevice(f_hi=400.0))
    words = tmp_path / "b.haptic", made, PatternDevice()
    if refuses:
        refused(BadValue, "65 to 300 Hz, .*400 Hz", write_pattern, *words)
    else:
        assert write_pattern(*words).points > 2


@pytest.mark.parametrize("n", [15, 16, 17, 31, 32])
def test_a_curve_of_ahap_has_2_to_16_points(n, tmp_path):
    curve = curved(INTENSITY, *((0.1 * k, 0.5 + 0.01 * k) for k in range(n)))
    path = ahap(tmp_path, happens(**PARAMETERS, _for=0.1 * (n - 1)), curve)
    write_pattern(tmp_path / "b.ahap", read_pattern(path))
    items = json.loads((tmp_path / "b.ahap").read_text())["Pattern"]
    curves = [i["ParameterCurve"] for i in items if "ParameterCurve" in i]
    assert {2 <= len(c["ParameterCurveControlPoints"]) <= 16 for c in curves} == {True}


# What counts in an analysis: each number against a signal around it -------------------
FINE, DEVICE = 8000, PatternDevice()


def voice_of(y):
    """The amplitude and frequency of samples without events: (n, 2) each."""
    (voice,) = analysed(y, FINE, [], DEVICE).voices
    return np.array(voice.amplitude), np.array(voice.frequency)


def sines(*parts):
    """Sines one after the other: seconds, amplitude, Hz each, in one phase."""
    a, f = np.concatenate([np.tile(p[1:], (round(p[0] * FINE), 1)) for p in parts]).T
    return a * np.sin(2 * np.pi * np.cumsum(f) / FINE)


def test_what_is_slower_than_20_hz_is_no_vibration():
    for hertz, passes in ((16.0, False), (24.0, True)):
        inside = np.abs(analytic(sines((1.0, 1.0, hertz)), FINE))[FINE // 4 : -FINE // 4]
        assert abs(inside - passes).max() < 0.1


def test_points_are_2_ms_apart_and_within_a_hundredth_of_the_peak_and_a_tenth_of_a_hertz():
    t = np.arange(2 * FINE) / FINE
    shape, hertz = 0.6 + 0.4 * np.sin(2 * np.pi * 9.0 * t), 150 + 2.0 * np.sin(4.0 * np.pi * t)
    amplitude = voice_of(shape * np.sin(2 * np.pi * 250.0 * t))[0]
    frequency = voice_of(np.sin(2 * np.pi * np.cumsum(hertz) / FINE))[1]
    at = amplitude[:-1, 0]
    assert np.allclose(at * 500, np.round(at * 500)) and np.diff(at).min() == pytest.approx(0.002)
    swell, turn = (amplitude, shape, 0.002, 0.02), (frequency, hertz, 0.05, 0.2)
    for points, wanted, least, most in (swell, turn):
        error = np.abs(np.interp(t, *points.T) - wanted)[(t > 0.1) & (t < 1.9)].max()
        assert least < error < most and len(points) < 300


def test_the_frequency_is_a_mean_over_10_ms_where_it_is_loud():
    _, frequency = voice_of(sines((0.5, 1.0, 100.0), (0.5, 1.0, 200.0)))
    t = np.arange(0.4, 0.6, 1e-4)
    f = np.interp(t, *frequency.T)
    between = np.ptp(t[(f > 110) & (f < 190)])  # a mean of a step is a line, here 0.8 of it
    assert 0.006 < between < 0.011 and abs(f - np.where(t < 0.5, 100, 200))[[0, -1]].max() < 0.5
    for quiet, heard in ((0.05, False), (0.2, True)):
        _, frequency = voice_of(sines((0.5, 1.0, 100.0), (0.5, quiet, 200.0)))
        assert (frequency[-1, 1] > 190) == heard


def test_a_voice_begins_at_a_hundredth_of_the_peak():
    for before, begins in ((0.005, 0.5), (0.02, 0.0)):
        amplitude, _ = voice_of(sines((0.5, before, 150.0), (0.5, 1.0, 150.0)))
        assert amplitude[0, 0] == pytest.approx(begins, abs=0.1)


def test_a_tap_is_a_thousandth_of_the_samples_or_it_is_none():
    since = np.maximum(0.0, (np.arange(FINE) / FINE) - 0.25)
    for height, taps in ((0.0007, 0), (0.0015, 1), (-0.5, 1)):
        y = height * np.exp(-since / DEVICE.decay) * np.sin(2 * np.pi * 170.0 * since)
        y[-1] = 1.0  # the largest sample
        found = analysed(y, FINE, [(FINE // 4, 170.0)], DEVICE).taps
        assert len(found) == taps
        for when, tap, hertz in found:
            assert (when, hertz) == (0.25, 170.0) and tap == pytest.approx(height, rel=1e-6)


@pytest.mark.parametrize("hertz", [120.0, 200.0])
def test_the_frequency_of_a_tap_that_is_not_known_is_that_of_its_peak(hertz):
    t = np.arange(FINE // 2) / FINE
    y = np.exp(-t / 0.05) * np.sin(2 * np.pi * hertz * t)
    ((_, _, found),) = analysed(y, FINE, [(0, 0.0)], DEVICE).taps
    assert found == pytest.approx(hertz, abs=10.0)  # of 22 ms


# Command ------------------------------------------------------------------------------
def test_convert_both_ways(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    source = str(FILES / "ramp_down_with_emp.haptic")
    ran(["convert", source, "a.wav", "--full-scale", "2", "--unit", "N"])
    y, info = stimlib.files.read("a.wav")
    assert info["channels"][0]["unit"] == "N" and 0.5 < np.abs(y).max() <= 2.0
    ran(["convert", source, "a.json", "--unit", "N"])
    assert stimlib.compile(stimlib.load("a.json"), FS).units["vibration"] == "N"
    said = ran("convert a.json b.hjif --seconds 2.1").stdout
    assert "1 transient;" in said and "in dB re 1 N" in said
    ran("convert a.wav c.ahap --f-hi 400")
    sound = ahap(tmp_path, happens(**PARAMETERS, _for=0.1), {"Event": SOUND})
    told = ran(["convert", str(sound), "s.haptic", "--skip-sound"]).stderr
    assert "note:" in told and "Pattern[1].Event is sound (AudioCustom) and was skipped" in told
    found = json.loads(ran("convert b.hjif d.haptic --json").stdout)
    assert found["path"] == "d.haptic" and found["taps"] == 1
    ran("convert tone e.haptic --seconds 0.4")
    path = ahap(tmp_path, happens(HapticIntensity=0.3, _for=0.5), tap(0.1, 0.7, 0.4))
    ran(["convert", path, "default.json"])
    assert stimlib.load("default.json").hash == read_pattern(path).scene.hash


@pytest.mark.parametrize(
    "words, says",
    [
        (["squeeze", "a.hjif"], "no motion for x1"),
        (["squeeze", "a.ahap", "--motion", "minimum_jerk()"], "AHAP holds one channel"),
        (["nothing.ahap", "a.wav"], "error: cannot read nothing.ahap"),
        (["a.wav", "a.json"], "cannot read a.wav"),
        (["a.hmpg", "a.wav"], "the binary form of .hjif is neither read nor"),
        ([FILES / "pop.ahap", "a.mp3"], ".hjif for a pattern, .caf, .flac, .rf64, .w64, .wav for"),
        (["tone", "a.json", "--set", "freq=100"], "--set: no scene is rendered from"),
        (["tone", "a.json", "--seconds", "2"], "--seconds: no scene is rendered from"),
        (["tone", "a.json", "--fs", "4000"], "--fs: no scene is rendered from"),
        (["a.wav", "a.hjif", "--fs", "4000"], "--fs: no scene is rendered from a.wav"),
        (["wall", "a.json", "--motion", "minimum_jerk()", "--seed", "3"], "--motion, --seed: "),
        ([FILES / "pop.ahap", "a.wav", "--set", "k=1"], "--set: no scene is rendered from"),
        ([FILES / "pop.ahap", "a.hjif", "--seconds", "0"], "--seconds: no scene is rendered"),
        ([FILES / "pop.ahap", "a.hjif", "--max-gap", "1"], "--max-gap: no scene is rendered"),
        ([FILES / "pop.ahap", "a.wav", "--f-lo", "500"], "--f-lo = 500 Hz is not below"),
    ],
)
def test_convert_says_what_is_wrong(words, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran(["convert", *words], 2, says)


def test_the_table_of_losses_is_that_of_the_command():
    """docs/howto/patterns.csv, made by ``benchmarks/patterns.py --record``."""
    table = runpy.run_path(str(ROOT / "benchmarks" / "patterns.py"))
    with open(table["TABLE"], encoding="utf-8") as f:
        written = list(csv.reader(f))
    found = table["rows"]()
    assert [row[:4] for row in found] == [row[:4] for row in written] and len(found) > 30
    for one, two in zip(found[1:], written[1:], strict=True):
        for a, b in zip(one[4:], two[4:], strict=True):
            assert (a == "refused") == (b == "refused"), one
            if a != "refused":
                levels = np.array([row.split(" / ") for row in (a, b)], float)
                assert np.abs(np.diff(np.maximum(levels, -60), axis=0)).max() <= 2, one
