"""What equal times mean, time in another unit, the largest numbers there are, and
cubics with the bits of scipy's.
"""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import refused

from stimlib.errors import BadValue, RecordingError
from stimlib.motion import pchip as blocks
from stimlib.motion.pchip import cubics
from stimlib.motion.recorded import recording

# a tablet: stamps in ms, two or three reports in some of them
COARSE = "t_ms,x_mm,contact\n0,1,1\n10,2,1\n10,3,1\n20,4,1\n20,5,1\n20,6,0\n30,7,1\n30,8,1\n"
COLUMNS = {"x": "x_mm*1e-3"}
MS = "t_ms*1e-3"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.csv"


def reports_of(r):
    knots = r.motion["x"]._knots
    return knots, r.motion["x"](knots) * 1e3, r.contact(knots)


# -- equal times


def test_equal_times_name_the_option_and_how_many_rows(path):
    path.write_text(COARSE)
    refused(
        RecordingError,
        r'row 4: the same time as row 3 and other .*\(such rows: 4\) choose repeats="spread"',
        recording,
        path,
        COLUMNS,
        time=MS,
    )


def test_spread_up_to_the_next_stamp(path):
    path.write_text(COARSE)
    r = recording(path, COLUMNS, time=MS, repeats="spread", max_speed=None)
    t, x, contact = reports_of(r)
    # the report in the air, at 26.7 ms, is none of the track's
    stamps = [0, 10, 15, 20, 20 + 10 / 3, 30, 35]
    assert_allclose(t, np.array(stamps) * 1e-3, rtol=1e-12)
    assert_allclose(x, [1, 2, 3, 4, 5, 7, 8], rtol=1e-12)
    assert r.info["reports"] == 8 and r.info["repeats"] == 4 and "equal times: 4" in str(r)
    assert r.info["lifts"] == [(7, pytest.approx(0.08 / 3))]
    assert r.duration == pytest.approx(0.035)


def test_spread_does_not_reach_over_a_silence(path):
    path.write_text("t_s,x\n0,0\n0.01,1\n0.01,2\n3,3\n3.01,4\n3.02,5\n")
    r = recording(path, {"x": "x*1e-3"}, repeats="spread", reports="on_change")
    assert r.motion["x"]._knots[:3] == pytest.approx([0, 0.01, 0.015])


@pytest.mark.parametrize(
    "how, x, contact, rows",
    [("last", [1, 3, 8], [1, 1, 0, 1], [3]), ("mean", [1, 2.5, 7.5], [1, 1, 0, 1], [3])],
)
def test_one_report_for_each_stamp(path, how, x, contact, rows):
    path.write_text(COARSE)
    r = recording(path, COLUMNS, time=MS, repeats=how, max_speed=None)
    # from 0.01 to the lift at 0.02 there is no contact
    assert r.contact([0.0, 0.01, 0.02, 0.03]).tolist() == [1, 0, 0, 1]
    t = r.motion["x"]._knots
    assert_allclose(t, [0, 0.01, 0.03], rtol=1e-12)
    assert_allclose(r.motion["x"](t) * 1e3, x, rtol=1e-12)
    assert (
        r.info["reports"] == 4
        and r.info["repeats"] == 4
        and r.info["lifts"] == [(5, pytest.approx(0.02))]
    )


def test_repeats_is_in_the_spec_and_checked(path):
    path.write_text(COARSE)
    r = recording(path, COLUMNS, time=MS, repeats="mean", max_speed=None)
    assert "repeats='mean'" in repr(r) and repr(eval(repr(r), {"recording": recording})) == repr(r)
    refused(
        BadValue,
        "repeats = 'first' must be one of",
        recording,
        path,
        COLUMNS,
        time=MS,
        repeats="first",
    )


@pytest.mark.parametrize("how", [None, "last", "mean", "spread"])
def test_without_equal_times_the_option_changes_nothing(path, how):
    path.write_text("t_s,x\n0,0\n0.01,0.001\n0.03,0.002\n")
    r = recording(path, {"x": "x"}, repeats=how)
    assert (
        r.motion["x"]([0.0, 0.005, 0.02]).tolist()
        == recording(path, {"x": "x"}).motion["x"]([0.0, 0.005, 0.02]).tolist()
    )


def test_nothing_but_one_time(path):
    path.write_text("t_s,x\n1,0\n1,0.001\n1,0.002\n")
    for how in ("last", "mean", "spread"):
        refused(
            RecordingError,
            "give at least two rows with rising time",
            recording,
            path,
            {"x": "x"},
            repeats=how,
        )


# -- the unit of time


@pytest.mark.parametrize(
    "scale, unit, factor",
    [(1e3, "ms", "1e-3"), (1e6, "us", "1e-6"), (1e9, "ns", "1e-9")],
    ids=lambda v: str(v),
)
@pytest.mark.parametrize("reports", ["always", "on_change"])
def test_time_in_another_unit_is_asked_about(path, scale, unit, factor, reports):
    t = np.arange(20) * 0.008
    path.write_text("t,x\n" + "".join(f"{v * scale:.0f},{0.001 * i}\n" for i, v in enumerate(t)))
    message = (
        rf"{8e-3 * scale:g}.* s from report to report, .*; time in {unit}\? write"
        rf' time="t\*{factor}"; if it is in s, give max_gap'
    )
    refused(
        RecordingError,
        message.replace("e+0", "e.0"),
        recording,
        path,
        {"x": "x"},
        time="t",
        reports=reports,
    )
    assert recording(path, {"x": "x"}, time=f"t*{factor}", reports=reports).info[
        "period"
    ] == pytest.approx(0.008)
    slow = recording(path, {"x": "x"}, time="t", reports=reports, max_gap=0.008 * scale)
    assert slow.info["period"] == pytest.approx(0.008 * scale)


@pytest.mark.parametrize(
    ("period", "why"),
    [
        (0.9e-7, "which no clock gives"),
        (1.1e-7, ""),
        (0.49, ""),
        (0.51, "which is slow for a hand"),
    ],
)
def test_periods_of_a_hand_have_limits(path, period, why):
    path.write_text("t_s,x\n" + "".join(f"{period * i!r},0\n" for i in range(5)))
    if why:
        refused(RecordingError, why, recording, path, {"x": "x"})
    else:
        assert recording(path, {"x": "x"}, max_gap=None if period < 0.4 else 0.5).info[
            "period"
        ] == pytest.approx(period)


def test_the_conversion_that_is_proposed_can_be_typed(path):
    path.write_text("Time (s),x\n0,0\n8,0.001\n16,0.002\n")
    refused(
        RecordingError,
        r"write time=\"'Time \(s\)'\*1e-3\"",
        recording,
        path,
        {"x": "x"},
        time="Time (s)",
    )
    refused(
        RecordingError,
        r"write time=\"\('Time \(s\)'\*2\)\*1e-3\"",
        recording,
        path,
        {"x": "x"},
        time="'Time (s)'*2",
    )
    assert recording(path, {"x": "x"}, time="('Time (s)'*2)*1e-3").info["period"] == 0.016


def test_recorded_hands_are_fast_enough():
    """From the fastest, a puck, to the slowest, a force sensor: far from half a
    second.
    """
    data = Path(__file__).parents[2].parent / "shared" / "data"
    if not data.is_dir():
        pytest.skip("the folder of human recordings is not beside the repository")
    for name in ("touch-evemu/hand_puck_tablet.csv", "fingertip-force/finger_on_texture_12hz.csv"):
        t = np.loadtxt(data / name, delimiter=",", skiprows=1, usecols=0)
        assert 0.003 < np.median(np.diff(t)) < 0.1


# -- large numbers


LARGE = ["1e308", "-1e308", "1e309", "5e-324", "1e-308", "1e17", "0", "-0.0", "1e150"]


@pytest.mark.parametrize(
    "options",
    [{}, {"repeats": "spread"}, {"reports": "on_change"}, {"repeats": "mean", "max_gap": 1e300}],
)
def test_any_number_gives_a_motion_or_an_error(path, options):
    rng = np.random.default_rng(7)
    for _ in range(150):
        n = int(rng.integers(2, 6))
        t, x = (np.array(LARGE)[rng.integers(0, len(LARGE), n)] for _ in "tx")
        t = sorted(t, key=float) if rng.random() < 0.5 else [f"{i * 0.01}" for i in range(n)]
        path.write_text("t_s,x\n" + "".join(f"{a},{b}\n" for a, b in zip(t, x, strict=True)))
        try:
            r = recording(path, {"x": "x", "y": "x*1e-308"}, max_speed=None, **options)
        except RecordingError:
            continue
        at = np.linspace(-0.1, 1.1, 31) * r.duration
        assert all(np.isfinite(f(at)).all() for f in (r.motion["x"], r.motion["y"], r.contact))


def test_a_time_that_no_clock_has(path):
    path.write_text("t_s,x\n0,0\n1e308,1\n")
    refused(
        RecordingError,
        "row 3, column t_s: time 1e.308 s; check the unit",
        recording,
        path,
        {"x": "x"},
    )


# -- cubics


def test_cubics_have_the_bits_of_scipy(monkeypatch):
    """Stretch by stretch, in blocks of any size, which is the most that is worked on at
    once.
    """
    from scipy.interpolate import PchipInterpolator

    rng = np.random.default_rng(0)
    for trial in range(400):
        monkeypatch.setattr(blocks, "BLOCK", int(rng.integers(1, 9)) if trial % 2 else 1 << 16)
        n = int(rng.integers(1, 30))
        t = np.cumsum(rng.uniform(0.001, 0.02, n))
        x = (
            rng.integers(-3, 4, n) * rng.choice([1e-3, 1.0, 1e100], n)
            if trial % 3
            else np.cumsum(rng.normal(0, 1, n))
        )
        whole = rng.random(n - 1) < rng.choice([0.5, 0.9, 1.0])
        expected = np.zeros((4, n))
        expected[3] = x
        edges = np.flatnonzero(np.diff(np.concatenate([[False], whole, [False]]).astype(int)))
        for a, b in edges.reshape(-1, 2):
            expected[:, a:b] = PchipInterpolator(t[a : b + 1], x[a : b + 1]).c
        assert np.array_equal(cubics(t, x, whole), expected)
