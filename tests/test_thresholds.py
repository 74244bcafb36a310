"""Levels above the threshold of detection, against published figures and closed forms
that use nothing of the code under test.
"""

import numpy as np
import pytest
import scipy
from refusals import refused

import stimlib
from stimlib.analysis import detection_threshold, difference_steps, sensation_level
from stimlib.design.levels import amplitude
from stimlib.errors import BadValue, UnitError, UnknownName
from stimlib.motion import constant_speed, minimum_jerk
from stimlib.scenes import bumps, bumps_set, squeeze

FS = 8000.0
T = np.arange(16000) / FS


def db(ratio):
    return 20 * np.log10(ratio)


def tone(freq, peak, seconds=2.0):
    return peak * np.sin(2 * np.pi * freq * T) * (np.abs(T - 1) <= seconds / 2)


@pytest.mark.parametrize(("a", "b"), [(0.5, 4.0), (7.5, 4.0), (158.0, 185.0), (3e-7, 3e300)])
def test_differences_are_counted_in_steps_of_a_fifth_and_of_three_tenths(a, b):
    found = difference_steps(a, b)
    assert found == pytest.approx(difference_steps(b, a), rel=1e-12)
    for w, steps in ((0.3, found.least), (0.2, found.most)):
        low, n = min(a, b), 0
        while low * (1 + w) <= max(a, b):
            low, n = low * (1 + w), n + 1
        assert n == int(steps)  # steps of w that fit between
        assert low * (1 + w) ** (steps - n) == pytest.approx(max(a, b), rel=1e-9)


def test_what_differs_by_less_than_a_fifth_is_not_told_apart():
    for ratio, word in {1.19: "not told apart", 1.25: "unsure", 1.31: "told apart"}.items():
        assert str(difference_steps(2.0, 2.0 * ratio)).endswith(f": {word}")
    assert difference_steps(1.0, 1.0) == (0.0, 0.0)
    refused(BadValue, "second = 0 must be a number above 0", difference_steps, 1.0, 0)


# Published figures --------------------------------------------------------------------
def test_the_threshold_at_250_hz_is_20_db_below_1_um():
    """The anchor, assumed, for 2.9 cm^2 on the thenar eminence; exact here. It falls by
    12 dB in each octave from 40 Hz on (after Gescheider and Verrillo 1979): 12.04 here.
    """
    assert detection_threshold(250.0) == pytest.approx(amplitude("-20 dB re 1 um", "m"), rel=1e-12)
    assert detection_threshold(320.0) == detection_threshold(250.0)
    f = np.array([40.0, 62.5, 80.0, 125.0])
    slopes = detection_threshold(f) / detection_threshold(2 * f)
    assert db(slopes) == pytest.approx([12.0] * 4, abs=0.05)


def test_the_threshold_is_flat_up_to_40_hz_and_does_not_summate_there():
    """The same sources, 25 and 40 Hz; both channels meet at 40 Hz for 2.9 cm^2."""
    low = detection_threshold([25.0, 30.0, 40.0])
    assert np.ptp(low) == 0 and db(low[0] / 1e-6) == pytest.approx(11.84, abs=0.01)
    assert detection_threshold(40.0, channel="P") == pytest.approx(low[2], rel=1e-12)
    for area in (0.02e-4, 0.5e-4):
        assert (detection_threshold([25.0, 40.0], area=area) == low[0]).all()


@pytest.mark.parametrize("freq", [80.0, 160.0, 320.0])
@pytest.mark.parametrize("area", [0.02e-4, 0.3e-4, 1.4e-4])
def test_a_doubled_area_lowers_the_threshold_by_3_db(freq, area):
    """Verrillo 1963: 80 to 320 Hz, 0.02 to 2.9 cm^2, 3 dB; 3.01 here.

    At the finger tip so from 0.025 to 0.1 cm^2 at 300 Hz (Gescheider et al. 2002).
    """
    one, two = (detection_threshold(freq, a, channel="P") for a in (area, 2 * area))
    assert db(one / two) == pytest.approx(3.0, abs=0.02)
    tip = [detection_threshold(300.0, a * 1e-4, "P") for a in (0.025, 0.1)]
    assert db(tip[0] / tip[1]) == pytest.approx(6.0, abs=0.03)


def test_energies_of_two_tones_sum_in_the_pacinian_channel():
    """Two tones at the threshold are 3 dB above it (Makous et al. 1995); one of 250 Hz
    and 6 dB below adds 0.97 dB.
    """
    a, b = (tone(f, detection_threshold(f)) for f in (130.0, 250.0))
    assert sensation_level(a, FS, "m").pacinian == pytest.approx(0.0, abs=0.1)
    assert sensation_level(a + b, FS, "m").pacinian == pytest.approx(10 * np.log10(2), abs=0.15)
    less = sensation_level(a + 10 ** (-6 / 20) * b, FS, "m").pacinian
    assert less == pytest.approx(10 * np.log10(1 + 10**-0.6), abs=0.15)


def test_amplitudes_do_not_sum_over_time_in_the_other_channel_and_energies_do():
    """10 log10(1 - exp(-t/0.2 s)), Zwislocki 1960: a burst of 50 ms is 6.6 dB below a
    long one; a non-Pacinian tone of 30 Hz keeps its level.
    """
    long = sensation_level(tone(200.0, 1e-6), FS, "m").pacinian
    for seconds in (0.04, 0.1, 0.2, 0.5):
        found = sensation_level(tone(200.0, 1e-6, seconds), FS, "m").pacinian
        assert found - long == pytest.approx(10 * np.log10(1 - np.exp(-seconds / 0.2)), abs=0.2)
    short, long = (sensation_level(tone(30.0, 1e-5, s), FS, "m").non_pacinian for s in (0.2, 2.0))
    assert short == pytest.approx(long, abs=1.5)
    # 10 um, 3.9 um at the threshold; near the edge of the band up to 0.5 dB more
    assert long == pytest.approx(db(10 / 3.90625), abs=0.5)


@pytest.mark.parametrize(("freq", "limit", "margin"), [(125.0, 0.7, 1.97), (31.5, 0.3, 8.86)])
def test_a_second_source_in_acceleration_is_above_the_thresholds(freq, limit, margin):
    """Lindsell and Griffin 1998 (HSE report 197/1998), for measurements as in ISO
    13091-1 with a probe of 6 mm: 0.7 m/s^2 rms at 125 Hz and 0.3 at 31.5 Hz end the
    normal range, so the mean of healthy persons is below.
    """
    rms = detection_threshold(freq, np.pi * 0.003**2) * (2 * np.pi * freq) ** 2 / np.sqrt(2)
    assert db(limit / rms) == pytest.approx(margin, abs=0.02)


def test_above_44_db_the_weaker_channel_is_not_known():
    """Maskers of up to 44 dB SL (Gescheider, O'Malley and Verrillo 1983)."""
    below, above, low, quiet = (
        sensation_level(tone(f, peak * 10 ** (level / 20)), FS, "m")
        for f, peak, level in (
            (250.0, 1e-7, 43.8),
            (250.0, 1e-7, 44.2),
            (30.0, 3.90625e-6, 46),
            (30.0, 3.90625e-6, 40),
        )
    )
    assert below.non_pacinian == pytest.approx(43.8 - db(3.90625e-6 / 1e-7), abs=0.1)
    assert np.isnan(above.non_pacinian) and above.pacinian == pytest.approx(44.2, abs=0.1)
    assert above.level == above.pacinian and "non-Pacinian unknown: felt" in str(above)
    assert np.isnan(low.pacinian) and low.non_pacinian == pytest.approx(46, abs=0.5)
    assert quiet.pacinian < 40 - 20  # the ends of a record are no clicks


W = 2 * np.pi * 100.0


@pytest.mark.parametrize(
    ("unit", "factor", "words"),
    [
        ("m", 1.0, {}),
        ("m/s", W, {}),
        ("m/s^2", W * W, {}),
        ("N", 0.02 * W * W, {"mass": 0.02}),
        ("m", 1 / 3e-7, {"gain": 3e-7}),
    ],
)
def test_a_motion_is_felt_alike_in_every_unit(unit, factor, words):
    found = sensation_level(factor * 1e-6 * np.sin(W * T) + 5.0, FS, unit, **words)
    assert found.pacinian == pytest.approx(db(1e-6 / (1e-7 * 2.5**2)), abs=0.1)
    assert found.outside < 0.01


@pytest.mark.parametrize(
    ("level", "word"),
    [
        (10.1, ": felt"),
        (9.9, "near the threshold"),
        (-9.9, "near the threshold"),
        (-10.1, "not felt"),
    ],
)
def test_near_the_threshold_persons_differ(level, word):
    assert word in str(sensation_level(tone(250.0, 1e-7 * 10 ** (level / 20)), FS, "m"))


# Signals ------------------------------------------------------------------------------


def test_what_is_outside_of_the_ranges_does_not_count_and_is_told():
    high = sensation_level(tone(1000.0, 1e-6), FS, "m")
    assert high.outside > 0.99 and high.level < -30
    half = sensation_level(tone(250.0, 1e-6) + tone(500.0, 1e-6), FS, "m")
    assert half.outside == pytest.approx(0.5, abs=0.01)
    assert half.pacinian == pytest.approx(20.0, abs=0.1)
    silence = sensation_level(np.zeros(1000), FS, "m")
    assert silence.level == -np.inf and silence.outside == 0 and "not felt" in str(silence)
    assert sensation_level(0.01 * T, FS, "m").level < -60, "a hand that moves"


# Scenes and reports -------------------------------------------------------------------
def test_the_default_squeeze_is_felt_and_with_a_level_of_1_it_is_not():
    """The figures of the docstring, and of docs/reference/felt.rst."""
    press = {"x1": minimum_jerk()}
    found = {
        (level, mass): stimlib.render(squeeze(fingers=1, level=level), press, FS, 1.0).felt(
            mass=mass
        )
        for level, mass in ((9.0, 0.1), (8.0, 0.1), (1.0, 0.1), (1.0, 0.011))
    }
    default, less, quiet, lighter = (level.pacinian for level in found.values())
    assert default == pytest.approx(quiet + db(9.0), abs=0.01)
    assert [default, less, quiet] == pytest.approx([10.4, 9.4, -8.7], abs=0.1) and lighter > 10
    assert "felt" in str(found[9.0, 0.1]) and "near" in str(found[8.0, 0.1])
    y = stimlib.render(squeeze(fingers=1), press, FS, 1.0)
    assert y.felt().pacinian == default
    # by hand: the acceleration of 0.1 kg in parts of the threshold, squared, over 0.2 s
    f, lines = np.fft.rfftfreq(8000, 1 / FS), np.fft.rfft(y["force1"] - 2000 * press["x1"](y.t))
    in_band = (f >= 40) & (f <= 320)
    threshold = 1e-7 * np.maximum(250 / np.maximum(f, 1), 1) ** 2 * (2 * np.pi * f) ** 2
    parts = np.fft.irfft(np.where(in_band, lines / 0.1 / np.maximum(threshold, 1e-9), 0))
    leak = 1 - np.exp(-1 / (0.2 * FS))
    energy = scipy.signal.lfilter([leak], [1, leak - 1], 2 * parts**2)  # 1 for a tone there
    assert 10 * np.log10(energy.max()) == pytest.approx(default, abs=0.05)


def test_the_report_says_what_is_felt_and_what_rounding_costs(tmp_path):
    scene, motion = squeeze(), {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.01)}
    y = stimlib.render(scene, motion, FS, 1.0)
    y.save(tmp_path / "a.wav", full_scale=50.0, subtype="PCM_16")
    one, two = (n for n in stimlib.verify(tmp_path / "a.wav").evidence.numbers if ": Pacinian" in n)
    assert (one[:7], two[:7]) == ("force1:", "force2:")
    assert "mass 0.1, area 0.00029" in one
    assert float(one.partition("PCM_16 changes it by ")[2].split()[0]) == pytest.approx(-38, abs=1)


def test_of_a_combined_scene_each_output_has_its_device():
    both = stimlib.Scene.combine(a=squeeze(fingers=1), b=bumps())
    y = stimlib.render(both, {"a_x1": minimum_jerk(), "b_x": constant_speed(0.1, 0.1)}, FS, 1.0)
    middle = db(bumps_set()[40].displacement / detection_threshold(158.0, 1e-4))
    assert middle == pytest.approx(49.0, abs=0.1)
    assert y.felt("b_voltage").pacinian == pytest.approx(middle, abs=3.0)
    assert y.felt("a_force1").pacinian == pytest.approx(10.4, abs=0.1)
    # of another motion: neither the scene's mass nor its gain
    for name, unit, area in (("a_force1", "m/s^2", 2.9e-4), ("b_voltage", "m/s", 1e-4)):
        assert y.felt(name, unit=unit).level == sensation_level(y[name], FS, unit, area).level
    assert y.felt("b_voltage", unit="m").level == y.felt("b_voltage").level
    refused(UnknownName, "force3", y.felt, "force3")
    plain = stimlib.Scene({"y": stimlib.constant(1.0, "m") * stimlib.Input("x")})
    y = stimlib.render(plain, {"x": tone(250.0, 1e-6)}, FS)
    assert y.felt().pacinian == pytest.approx(20, abs=0.1)


@pytest.mark.parametrize(
    ("call", "given", "words", "why"),
    [
        *(
            (detection_threshold, ([100.0, freq],), words, "outside of")
            for freq, words in ((24.9, {}), (321.0, {}), (39.0, {"channel": "P"}), (np.nan, {}))
        ),
        (detection_threshold, (100.0, 3e-4), {}, "area = 0.0003 m.2 is outside"),
        (detection_threshold, (100.0,), {"channel": "RA"}, "one of P, NP"),
        (sensation_level, (T, FS, "m", 1e-6), {}, "area = 1e-06 m.2 is outside"),
        (sensation_level, (T, FS, "V"), {}, "in V is no motion"),
        (sensation_level, (T, FS, "N"), {"mass": None}, "mass = None; give mass="),
        (sensation_level, (T, FS, "N"), {"mass": 0.0}, "mass = 0.0; give mass="),
        (sensation_level, (T, FS, "m"), {"mass": 0.1}, "leave mass out"),
        (sensation_level, ([0.0, np.nan], FS, "m"), {}, "not finite"),
        (sensation_level, (T, FS, "m"), {"gain": np.inf}, "gain = inf is not finite"),
        (sensation_level, (np.zeros((2, 9)), FS, "m"), {}, "row of numbers"),
        (sensation_level, (T, 20.0, "m"), {}, "cutoff"),
    ],
)
def test_what_no_level_is_known_for(call, given, words, why):
    refused((BadValue, UnitError), why, call, *given, **words)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e300, 1e150, 1e-150, 1e-300])
def test_levels_of_any_size_are_logarithms(size):
    """The square of such a number is infinite, or 0."""
    got = sensation_level(size * tone(250.0, 1.0), FS, "m")
    assert got.pacinian == pytest.approx(140 + 20 * np.log10(size), abs=0.1)
    gained = sensation_level(size * tone(250.0, 1.0), FS, "m", gain=1e-6 / size)
    assert (gained.pacinian, gained.non_pacinian) == pytest.approx((20.0, -11.8), abs=0.1)


# What cannot be said ------------------------------------------------------------------


def test_a_rate_that_holds_no_vibration_has_no_line_in_the_report():
    scene, motion = bumps(freq=8.0), {"x": constant_speed(0.01, 0.1)}
    for fs, lines in ((50.0, 0), (60.0, 1)):
        report = stimlib.verify(scene, motion, stimlib.render(scene, motion, fs, 2.0))
        assert report.passed and sum("dB SL" in n for n in report.evidence.numbers) == lines
