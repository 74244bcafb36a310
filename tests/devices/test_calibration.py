"""Calibration: a simulated actuator is recovered, kept, and undone."""

import dataclasses
import json
from contextlib import suppress
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from actuators import ACTUATORS, Played, figures
from commands import ran
from devices.servers import played
from laws import STRESS
from refusals import refused
from scipy.signal import freqz, lfilter

import stimlib
from stimlib import BadValue, RecordingError, SinkError, UnitError
from stimlib.checks import verify, verify_log
from stimlib.devices import Calibration, NullSink, calibrate, check_level, load_calibration
from stimlib.devices.calibration import difference
from stimlib.experiments import Experiment, Stimulus, Timing, Trial, choice, present
from stimlib.files import read, read_log, replay
from stimlib.plate import Sweep
from stimlib.run import Inverse, Safety
from stimlib.scenes import tone

FS = 4000.0
BAND = (80.0, 400.0)


def actuator(fs=FS, freq=180.0, q=5.0, gain=4.0):
    """A resonance as a digital filter, in m/s^2 for 1.0: its coefficients b, a."""
    w = 2 * np.pi * freq / fs
    r = np.exp(-w / 2 / q)
    a = [1.0, -2 * r * np.cos(w), r * r]
    return [gain / abs(1 / np.polyval(a[::-1], np.exp(-1j * w)))], a


def response(f, fs=FS):
    b, a = actuator(fs)
    return b[0] / np.polyval(a[::-1], np.exp(-2j * np.pi * f / fs))


F = np.arange(80.0, 401.0)
MADE = Calibration(F, response(F), 0 * F, "m/s^2")


def taken(rng, noise, takes=5, seconds=4.0):
    n = int(seconds * FS)
    t = np.arange(n) / FS
    sweep = np.sin(2 * np.pi * (50 * t + 400 / (2 * 3.5) * t * t)) * (t < 3.5)  # 50 to 450 Hz
    return Sweep(sweep, lfilter(*actuator(), sweep) + noise * rng.normal(size=(takes, n)), FS)


def test_the_uncertainty_holds_in_95_of_100():
    """Each run its own noise, 20 dB below the signal, and each frequency too."""
    rng, runs = np.random.default_rng(4), 40 if STRESS else 6
    at, inside = np.arange(90.0, 391.0, 20.0), []
    for _ in range(runs):
        found = calibrate(taken(rng, 0.3), "m/s^2", BAND)
        for f in at:
            apart = abs(found.full_scale(f) / abs(response(f)) - 1)
            inside.append(apart <= found.error(f) + 1e-3)
    assert 0.93 < np.mean(inside) < 0.99, np.mean(inside)


def test_without_noise_it_is_the_response():
    found = calibrate(taken(np.random.default_rng(0), 0.0), "m/s^2", BAND, resolution=1.0)
    apart, inside = np.abs(found.gain / response(found.freq) - 1), found._inside
    assert apart[inside].max() < 2e-3 and (apart < found.uncertainty + 1e-3)[inside].all()
    assert found.band == BAND and found.freq[0] < 60 and found.freq[-1] > 440
    both = calibrate(taken(np.random.default_rng(0), 0.0), "m/s^2", BAND, sensor=0.02)
    assert both.error(100.0) == pytest.approx(0.02, abs=2e-3)
    # on friday the response is late
    monday, friday = (Calibration(BAND, g, [0.01] * 2, "N") for g in ([2.0, 2.0], [1.7, -1.7]))
    assert difference(monday, friday, 100.0) == pytest.approx([-0.15])


@pytest.mark.parametrize(("low", "resolution"), [(80.0, 20.0), (85.5, 10.0), (151.9, 5.0)])
def test_what_is_driven_throughout_is_known_up_to_half_the_rate_and_no_further(low, resolution):
    rng = np.random.default_rng(8)
    u = rng.normal(size=(4, 4000))
    taken = Sweep(u, 2 * u + 0.01 * rng.normal(size=u.shape), 2000.0)
    for high in (400.0, 1000.0):
        made = calibrate(taken, "m/s^2", (low, high), resolution=resolution)
        assert 1000 - resolution < made.freq[-1] < 1000
        np.testing.assert_allclose(made.gain, 2.0, atol=0.02)


def test_few_taps_make_nothing_outside_of_the_band_larger():
    device, f = ACTUATORS["180 Hz, Q 12"], np.arange(60.0, 601.0)
    made = Calibration(f, device.gain(f), 0 * f, "m/s^2", band=BAND)
    taps, error, *_ = made._inverse(FS, 345)
    gain = np.abs(freqz(taps, 1, f, fs=FS)[1] * device.gain(f))
    assert gain[~made._inside].max() <= 1.005 and np.abs(gain - 1)[made._inside].max() <= error
    # beyond what was measured, the device may have its largest gain
    beyond = np.abs(freqz(MADE.inverse(FS), 1, np.arange(445.0, 1000.0), fs=FS)[1])
    assert beyond.max() * np.abs(MADE.gain).max() <= 0.25


def test_the_inverse_filter_keeps_the_shape():
    """Noise in the band comes out as it was asked for, later by half the taps."""
    noise = stimlib.blocks.band_noise(120.0, 300.0, psd=1e-3, seed=3, order=8)
    wanted = stimlib.Scene({"signal": stimlib.constant(1.0, "m/s^2") * noise})
    drive = MADE.drive(wanted, FS)
    y = stimlib.render(wanted, fs=FS, seconds=3.0)["signal"]
    got = lfilter(*actuator(), stimlib.render(drive, fs=FS, seconds=3.0)["signal"])
    late = MADE.inverse(FS).size // 2
    assert np.std(got[4000 + late :] - y[4000:-late]) < 5e-3 * np.std(y)
    assert str(drive.outputs["signal"].dim) == "1"


@pytest.mark.parametrize("fs", [1200.0, 4000.0])
def test_the_error_that_is_stated_holds_for_the_filter_and_for_the_model(fs):
    """At 1200 Hz the shortest causal response is a tenth off."""
    device, f = ACTUATORS["180 Hz, Q 12"], np.arange(60.0, 601.0)
    made = Calibration(f, device.gain(f), 0 * f, "m/s^2", band=BAND)
    scene = stimlib.Scene({"y": stimlib.constant(1.0, "m/s^2")})
    stated = made.safety(scene, Safety(1.0), fs).inverse
    gain, inside = device.gain(f), (f >= BAND[0]) & (f <= BAND[1])
    model = np.abs(freqz(stated.response, 1, f, fs=fs)[1] / gain - 1)[inside]
    late = np.exp(-2j * np.pi * f * (len(stated.taps) // 2) / fs)
    whole = np.abs(freqz(stated.taps, 1, f, fs=fs)[1] * gain / late - 1)[inside]
    assert 0.9 * np.quantile(model, 0.9) <= stated.error < 0.25
    assert whole.max() <= stated.error and (np.quantile(model, 0.9) > 0.05) == (fs < 2000)


def test_a_file_is_the_calibration(tmp_path):
    made = calibrate(taken(np.random.default_rng(1), 0.1), "m/s^2", BAND, parts={"sensor": "7"})
    made.save(path := tmp_path / "a.json")
    again = load_calibration(path)
    for name in ("freq", "gain", "uncertainty"):
        assert np.array_equal(getattr(again, name), getattr(made, name))
    assert (again.unit, again.date, again.parts) == (made.unit, made.date, {"sensor": "7"})
    data = json.loads(path.read_text())
    for wrong in (
        {"freq": [1.0]},
        {"unit": "loud"},
        {"uncertainty": [-1.0]},
        {"gain_real": "x"},
        {"gain_imag": [0.0, 0.0]},
    ):
        path.write_text(json.dumps(data | wrong))
        refused(SinkError, "is not a calibration", load_calibration, path)
    refused(SinkError, None, load_calibration, tmp_path / "nothing.json")


def rig(rng, noise, gain=1.0):
    """Return a sink whose input hears what the actuator makes of its output."""

    def sink(scene, safety, motion, **options):
        drive = stimlib.Scene({"drive": scene.outputs["drive"]})
        u = stimlib.render(drive, fs=FS, seconds=1.1)["drive"] / safety.full_scale["drive"]
        heard = gain * lfilter(*actuator(), u) + noise * rng.normal(size=u.size)
        return NullSink(scene, safety, motion={"response": heard}, clocked=False, **options)

    return sink


def test_the_right_device_passes_and_one_of_1_db_more_or_less_is_refused():
    """Each run its own noise, in the calibration and in the check."""
    rng, passed = np.random.default_rng(7), 0
    runs = 100 if STRESS else 10
    for k in range(runs):
        made = calibrate(taken(rng, 0.05), "m/s^2", BAND)
        tone = (FS, *((180.0, 2.0), (300.0, 0.3))[k % 2])
        with suppress(RecordingError):
            check_level(made, rig(rng, 0.05), None, *tone)
            passed += 1
        if k < 20:
            changed = rig(rng, 0.05, 10 ** ((-0.05, 0.05)[k // 2 % 2]))
            refused(RecordingError, "check_level", check_level, made, changed, None, *tone)
    assert passed >= 0.95 * runs, passed


def test_a_level_says_what_it_is_and_what_it_should_be():
    rng, made = np.random.default_rng(8), dataclasses.replace(MADE, uncertainty=0.02 + 0 * F)
    low, high = (10 ** (db / 20) for db in (-1, 0.5))

    def checked(gain=1.0, noise=0.0, freq=180.0, level=2.0, **options):
        return check_level(made, rig(rng, noise, gain), None, FS, freq, level, **options)

    assert abs(checked()) < 1e-3
    assert checked(low, tolerance=1.1) == pytest.approx(-1.0, abs=1e-3)
    for error, says, given in (
        (
            RecordingError,
            r"1\.78 m/s² at 180 Hz .* 2 m/s².* -1\.00 dB, .* 0\.17 dB; check",
            {"gain": low},
        ),
        (RecordingError, "0.50 dB, more than 0.40 dB", {"gain": high, "tolerance": 0.4}),
        (RecordingError, "never changes: check the cable", {"gain": 0.0}),
        # of this noise little is left in a second
        (RecordingError, "more than 0.1[789] dB", {"gain": 10 ** (-0.5 / 20), "noise": 0.05}),
        *(
            (RecordingError, r"difference of -?\d+\.\d\d dB", {"gain": 0.0, "noise": noise})
            for noise in (1e-3, 1.0, 10.0)
        ),
        *(
            (BadValue, r"amplitude = .* at most full_scale = (4\.0|3\.99)", {"level": level})
            for level in (0.0, -1.0, 4.1)
        ),
        (BadValue, "outside of 80 to 400 Hz", {"freq": 79.0}),
    ):
        refused(error, says, checked, **given)


def test_limits_are_in_the_unit_of_the_calibration():
    scene = tone(freq=100.0, amplitude=3.0, unit="m/s^2")  # more than the actuator makes
    beside = Calibration([80.0, 100.0, 200.0, 400.0], [9.0, 2.0, 3.0, 9.0], np.zeros(4), "m/s^2")
    within = dataclasses.replace(beside, band=(100.0, 200.0))
    assert within.limits(scene).full_scale == {"signal": 3.0} and within.full_scale(100.0) == 2.0


def displayed(scene, tmp_path, **options):
    """Play and return the report, and what the device got, for sample 0 on."""
    log = Path(mkdtemp(dir=tmp_path))
    sink = played(NullSink(scene, log=log, clocked=False, **options), 1.5, fs=FS)
    assert verify_log(read_log(log)).passed
    assert replay(read_log(log), tmp_path / "played.wav").matches
    frames = read(tmp_path / "played.wav")[0]
    return sink.report(), frames / sink.safety.scales(tuple(scene.outputs))[:, None]


def test_a_sink_makes_what_the_scene_asks_for(tmp_path):
    """Its limits are in the calibration's unit; a pulse without one stays beside it."""
    wanted = tone(freq=100.0, amplitude=0.5, duration=1.4, period=1.5, unit="m/s^2")
    scene = stimlib.Scene({**wanted.outputs, "trigger": stimlib.blocks.burst(0.25, 0.1)})
    y = stimlib.render(scene, fs=FS, seconds=1.5)
    report, (drive, trigger) = displayed(scene, tmp_path, calibration=MADE)
    late = MADE.inverse(FS).size // 2
    reached = lfilter(*actuator(), drive)
    assert np.abs(reached[late + 400 : 5600] - y["signal"][400 : 5600 - late]).max() < 4e-3
    assert np.array_equal(trigger[late:], y["trigger"][:-late])
    assert report.clips == {}
    limited = Safety({"signal": 0.2, "trigger": 1.0})
    report, (drive, _) = displayed(scene, tmp_path, calibration=MADE, safety=limited)
    assert set(report.clips) == {"clip", "skin"}  # a clipped tone has a larger fundamental
    assert 0.19 < np.abs(lfilter(*actuator(), drive)).max() < 0.2 * 1.01


def test_more_than_the_device_has_is_limited_and_counted(tmp_path):
    wanted = tone(freq=100.0, amplitude=1.9, duration=1.4, period=1.5, unit="m/s^2")
    report, (drive,) = displayed(wanted, tmp_path, calibration=MADE)  # at 100 Hz it makes 1.1
    assert report.clips["drive"]["signal"] > 1000 and np.abs(drive).max() == 1.0
    assert f"{report.clips['drive']['signal']} samples limited (drive)" in str(report)


EVERY = [
    pytest.param(
        n, 200 if n[:3] != "420" else 50, marks=() if n[:3] == "420" else pytest.mark.stress
    )
    for n in ACTUATORS
]


@pytest.mark.parametrize(("name", "stimuli"), [("180 Hz, Q 12", 10), *EVERY], ids=str)
def test_what_is_felt_stays_within_what_is_stated(name, stimuli):
    """By a simulation of its own: gain in and outside of the band, value and slew."""
    part, outside, stated, value, slew, _ = figures(name, stimuli)
    assert part <= 1.0 and outside <= 1.0 + stated
    assert value <= 1.0 + stated and slew <= 1.06 + stated


def test_a_tone_at_its_limit_passes_and_one_above_reaches_it():
    device = ACTUATORS["180 Hz, Q 12"]
    made, t = device.calibrated(np.random.default_rng(5)), np.arange(int(FS)) / FS
    played = Played(device, made, 2.0)
    faded = np.interp(t, [0, 0.2, 0.8, 1], [0, 1, 1, 0]) * np.sin(2 * np.pi * 180 * t)
    z, watch = played(1.95 * faded)
    assert watch.counts() == {} and 1.93 < np.abs(z[2000:4000]).max() < 1.97
    z, watch = played(3.0 * faded)
    assert {"clip", "skin"} <= watch.counts().keys()
    assert 1.95 < np.abs(z).max() <= 2.0 * (1 + played.inverse.error)


def test_the_error_stated_covers_the_bias_of_the_resolution():
    """Over frequency, at the resonance and without noise; a coarse one is refused."""
    for name, resolution in (("180 Hz, Q 12", 2.0), ("180 Hz, Q 12", 0.5), ("250 Hz, Q 20", 1.0)):
        device, rng = ACTUATORS[name], np.random.default_rng(6)
        made = device.calibrated(rng, 1e-5, resolution)
        apart = np.abs(np.abs(made.gain) / np.abs(device.gain(made.freq)) - 1)[made._inside]
        within = apart <= made.uncertainty[made._inside]
        assert within.mean() >= 0.95, (name, resolution, within.mean())
        assert made.uncertainty.max() < 0.05
    coarse, rng = ACTUATORS["180 Hz, Q 12"].calibrated, np.random.default_rng(6)
    refused(BadValue, "resolution = 9 Hz is too coarse at 1[78].* Hz", coarse, rng, resolution=9.0)


def test_what_lies_outside_is_in_the_report_the_log_and_its_check(tmp_path):
    made = ACTUATORS["180 Hz, Q 12"].calibrated(np.random.default_rng(5))
    scene = tone(freq=700.0, amplitude=0.2, duration=1.9, period=2.0, unit="m/s^2")
    report, _ = displayed(scene, tmp_path, calibration=made)
    told = report.outside["signal"]
    assert told["level"] == pytest.approx(0.2, rel=0.1) and told["samples"] > 4000
    assert f"{told['samples']} samples of signal outside" in str(report)
    log = read_log(next(p for p in tmp_path.iterdir() if p.is_dir()))
    last = [e for e in log.events if e.kind == "clip"][-1]
    assert last.data["outside"] == report.outside == log.report["outside"]
    for wrong in ({"outside": {}}, {"clips": {"skin": {"signal": 1}}}):
        checked = verify_log(dataclasses.replace(log, report=log.report | wrong))
        assert [c.name for c in checked.checks if not c.passed] == ["log: limits as reported"]


ACTUATOR = """\
import stimlib
from stimlib.scenes import tone

def vibration():
    return tone(freq=100.0, amplitude=0.5, duration=1.4, period=1.5, unit="m/s^2")
"""


def test_commands_take_the_file(tmp_path, monkeypatch):
    """A level in RMS, through the calibration's file, in a log and in a sound file."""
    monkeypatch.chdir(tmp_path)
    MADE.save("a.json")
    Path("own.py").write_text(ACTUATOR)
    words = ["own.py:vibration", "--calibration", "a.json", "--fs", "4000", "--seconds", "1.5"]
    words += ["--set", "amplitude=0.3 m/s^2 rms"]
    ran(["play", *words, "--fast", "--log", "b.stimlog"])
    assert replay(read_log("b.stimlog"), "b.wav").matches
    ran(["render", *words, "--out", "c.wav"])
    assert verify("c.wav").passed
    for name, scale in (("b.wav", np.abs(MADE.gain).max()), ("c.wav", 1.0)):
        felt = lfilter(*actuator(), read(name)[0][0] / scale)[2000:4000]
        assert np.std(felt) == pytest.approx(0.3, rel=0.01)


def test_an_experiment_on_a_calibrated_device_is_recorded_in_its_unit(tmp_path):
    wanted = tone(freq=100.0, duration=0.3, period=1.0, repeats=1, unit="m/s^2")
    trial = Trial("loud", (Stimulus("tone", {"amplitude": 0.4}),), ("felt",))
    timing = Timing(before=0.2, interval=0.5, ramp=0.02)
    e = Experiment(
        "vibration", "1", {"tone": wanted}, lambda who, session: None,
        (choice("felt", "Did you feel it?", "yes", "no"),), fs=FS, safety=1.0, timing=timing,
        bounds={"amplitude": (0.0, 1.0)},
    )  # fmt: skip
    marks = []
    plain, with_it = (
        present(e, trial, "null", tmp_path / str(k), calibration=c, send=s)
        for k, c, s in ((0, None, ()), (1, MADE, marks.append))
    )
    assert with_it["peak"] == plain["peak"] and with_it["rms"] == plain["rms"]
    late = MADE.inverse(FS).size // 2
    assert {m.name: m.sample for m in marks} == {
        "trial": 0,
        "stimulus": with_it["intervals"][0][0] + late,
    }
    assert with_it["produced"] == plain["produced"] + late
    replay(read_log(tmp_path / "1"), tmp_path / "d.wav")
    reached = lfilter(*actuator(), read(tmp_path / "d.wav")[0][0])[late:]
    a, b = with_it["intervals"][0]
    assert np.abs(reached[a:b]).max() == pytest.approx(0.4, rel=0.05)


@pytest.mark.parametrize(
    ("call", "error", "says"),
    [
        (lambda c: c.full_scale(79.0), BadValue, "79 Hz is outside of 80 to 400 Hz"),
        (lambda c: c.full_scale("100"), BadValue, "freq = '100' must be a number"),
        (lambda c: c.error(401.0), BadValue, "outside"),
        (lambda c: c.drive(tone(unit="N"), FS), UnitError, "signal is in N"),
        (lambda c: c.inverse(FS, 100), BadValue, "must be odd"),
        (lambda c: c.limits(tone()), UnitError, "signal is in 1"),
        (lambda c: c.safety(tone(unit="N"), Safety(1.0), FS), UnitError, "signal is in N"),
        (lambda c: NullSink(tone(), calibration=c), UnitError, "calibrated in m/s"),
        (lambda c: Inverse([1.0, 2.0], [1.0]), BadValue, "2 taps must be an odd number"),
        (lambda c: Inverse([1.0], [1.0], 0), BadValue, "every = 0 at least 1"),
        (lambda c: Inverse([1.0], [1.0], error=0.0), BadValue, "error = 0.* above 0"),
        (lambda c: Inverse([0.0], [1.0]), BadValue, "taps must be .* not all 0"),
        (lambda c: Inverse([1.0], [np.nan]), BadValue, "response must be a row of finite"),
        (lambda c: Safety(1.0, inverse="x"), BadValue, "inverse = 'x' must be a Inverse"),
        (lambda c: c.drive(tone(unit="m/s^2"), 800.0), BadValue, "above 833 Hz"),
        (
            lambda c: Calibration(
                f := np.arange(60.0, 601.0), response(f), 0 * f, "m/s^2", band=BAND
            ).safety(tone(unit="m/s^2"), Safety(1.0), 1000.0),
            BadValue,
            "at fs = 1000 Hz no response fits .* give a higher sample rate",
        ),
        (
            lambda c: c.drive(tone(unit="m/s^2"), FS, 5),
            BadValue,
            "5 taps invert .* error of",
        ),
        (lambda c: Calibration([1, 2], [1, 2, 3], [0, 0], "N"), BadValue, "gain must be a row"),
        (lambda c: Calibration([2, 1], [1, 2], [0, 0], "N"), BadValue, "freq must rise"),
        (lambda c: Calibration([1, 2], [1, np.nan], [0, 0], "N"), BadValue, "not finite"),
        (lambda c: Calibration([1, 2], [1, 2], [0, 0], "loud"), UnitError, "loud"),
        (lambda c: Calibration([1], [1], [0], "N"), BadValue, "2 or more"),
        (lambda c: Calibration([1, 2], [1, 0], [0, 0], "N"), BadValue, "at 2 Hz is 0"),
        (lambda c: Calibration([1, 2], [1e-300, 1e-300], [0, 0], "N"), BadValue, "no actuator"),
        (lambda c: Calibration([1, 2], [1e300, 1e300], [0, 0], "N"), BadValue, "no actuator"),
        (
            lambda c: Calibration([40, 1200], [1, 1], [0, 0], "N", band=(80, 400)),
            BadValue,
            "none of freq",
        ),
        (lambda c: Calibration([1, 2], [1e-10, 1.0], [0, 0], "N"), BadValue, "at 1 Hz"),
    ],
)
def test_bad_use(call, error, says):
    refused(error, says, call, MADE)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"takes": 2}, "2 takes: three or more"),
        ({"band": (80.0, 82.0)}, "hold two resolutions"),
        ({"band": (80.0, 3000.0)}, "between 0 and 2000 Hz"),
        ({"resolution": 0.1}, "three steps"),
        ({"band": (80.0, 1900.0)}, "drives nothing at 4.. Hz"),
        ({"sensor": -1.0}, "0 or above"),
    ],
)
def test_bad_sweeps(change, says):
    sweep = taken(np.random.default_rng(0), 0.1, takes=change.pop("takes", 3))
    refused(BadValue, says, calibrate, sweep, "m/s^2", **({"band": BAND} | change))
