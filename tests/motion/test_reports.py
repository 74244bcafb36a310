"""What equal times mean, time in another unit, the largest numbers there are, and
cubics with the bits of scipy's.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import refused
from scipy.interpolate import PchipInterpolator

from stimlib.errors import RecordingError
from stimlib.motion import pchip
from stimlib.motion.recorded import recording

# a tablet: stamps in ms, two or three reports in some of them
COARSE = "t_ms,x_mm,contact\n0,1,1\n10,2,1\n10,3,1\n20,4,1\n20,5,1\n20,6,0\n30,7,1\n30,8,1\n"
COLUMNS = {"x": "x_mm*1e-3"}
MS = "t_ms*1e-3"
ONE_TIME = "t_s,x\n1,0\n1,0.001\n1,0.002\n"
NAMED = "Time (s),x\n0,0\n8,0.001\n16,0.002\n"
SILENT = "t_s,x\n0,0\n0.01,0.001\n0.01,0.002\n3,0.003\n3.01,0.004\n3.02,0.005\n"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.csv"


# -- equal times


STAMPS = [0, 10, 15, 20, 20 + 10 / 3, 30, 35]  # the report in the air, at 26.7 ms, is none


@pytest.mark.parametrize(
    ("how", "stamps", "x", "reports", "lift"),
    [
        ("spread", STAMPS, [1, 2, 3, 4, 5, 7, 8], 8, (7, pytest.approx(0.08 / 3))),
        # from 0.01 to the lift at 0.02 there is no contact
        ("last", [0, 10, 30], [1, 3, 8], 4, (5, pytest.approx(0.02))),
        ("mean", [0, 10, 30], [1, 2.5, 7.5], 4, (5, pytest.approx(0.02))),
    ],
)
def test_equal_times_are_spread_or_one_report(path, how, stamps, x, reports, lift):
    path.write_text(COARSE)
    r = recording(path, COLUMNS, time=MS, repeats=how, max_speed=None)
    knots = r.motion["x"]._knots
    assert_allclose(knots, np.array(stamps) * 1e-3, rtol=1e-12)
    assert_allclose(r.motion["x"](knots) * 1e3, x, rtol=1e-12)
    assert (r.info["reports"], r.info["repeats"], r.info["lifts"]) == (reports, 4, [lift])
    assert "equal times: 4" in str(r) and r.duration == pytest.approx(stamps[-1] * 1e-3)
    assert r.contact([0.0, 0.01, 0.027, 0.03]).tolist() == [1, how == "spread", 0, 1]
    assert f"repeats='{how}'" in repr(r)
    assert repr(eval(repr(r), {"recording": recording})) == repr(r)


@pytest.mark.parametrize(
    ("text", "how", "says"),
    [
        (COARSE, {"columns": COLUMNS, "time": MS}, r'row 4: .*such rows: 4\).*repeats="spread"'),
        *(
            (ONE_TIME, {"repeats": how}, "two rows with rising time")
            for how in ("last", "mean", "spread")
        ),
        (NAMED, {"time": "Time (s)"}, r"time=\"'Time \(s\)'\*1e-3\""),
        (NAMED, {"time": "'Time (s)'*2"}, r"time=\"\('Time \(s\)'\*2\)\*1e-3\""),
    ],
)
def test_times_that_are_refused(path, text, how, says):
    path.write_text(text)
    refused(RecordingError, says, recording, path, **{"columns": {"x": "x"}} | how)


@pytest.mark.parametrize(
    ("text", "how", "knots"),
    [
        (SILENT, {"repeats": "spread", "reports": "on_change"}, [0, 0.01, 0.015]),  # no silence
        (NAMED, {"time": "('Time (s)'*2)*1e-3"}, [0, 0.016, 0.032]),
    ],
)
def test_times_that_are_taken(path, text, how, knots):
    path.write_text(text)
    r = recording(path, {"x": "x"}, **how)
    assert r.motion["x"]._knots[:3] == pytest.approx(knots)


@pytest.mark.parametrize("how", ["last", "mean", "spread"])
def test_without_equal_times_the_option_changes_nothing(path, how):
    path.write_text("t_s,x\n0,0\n0.01,0.001\n0.03,0.002\n")
    a, b = (recording(path, {"x": "x"}, repeats=repeats).motion["x"] for repeats in (how, None))
    assert a([0.0, 0.005, 0.02]).tolist() == b([0.0, 0.005, 0.02]).tolist()


# -- the unit of time


@pytest.mark.parametrize(
    ("scale", "unit", "factor"), [(1e3, "ms", "1e-3"), (1e6, "us", "1e-6"), (1e9, "ns", "1e-9")]
)
@pytest.mark.parametrize("reports", ["always", "on_change"])
def test_time_in_another_unit_is_asked_about(path, scale, unit, factor, reports):
    rows = [f"{0.008 * i * scale:.0f},{0.001 * i}\n" for i in range(20)]
    path.write_text("t,x\n" + "".join(rows))
    how = {"columns": {"x": "x"}, "reports": reports}
    says = rf'time in {unit}\? write time="t\*{factor}"; .*max_gap'
    error = refused(RecordingError, says, recording, path, time="t", **how)
    assert f"{8e-3 * scale:g}" in str(error)
    for more, period in (
        ({"time": f"t*{factor}"}, 0.008),
        ({"time": "t", "max_gap": 0.008 * scale}, 0.008 * scale),
    ):
        assert recording(path, **how, **more).info["period"] == pytest.approx(period)


@pytest.mark.parametrize(
    ("period", "says"),
    [(0.9e-7, "no clock gives"), (1e-7, None), (0.49, None), (0.51, "slow for a hand")],
)
def test_periods_of_a_hand_have_limits(path, period, says):
    path.write_text("t_s,x\n" + "".join(f"{period * i!r},0\n" for i in range(5)))
    if says:
        refused(RecordingError, says, recording, path, {"x": "x"})
    else:
        r = recording(path, {"x": "x"}, max_gap=None if period < 0.4 else 0.5)
        assert r.info["period"] == pytest.approx(period)


# -- large numbers


LARGE = ["1e308", "-1e308", "1e309", "5e-324", "1e-308", "1e17", "0", "-0.0", "1e150"]


@pytest.mark.parametrize(
    "options",
    [{}, {"repeats": "spread"}, {"reports": "on_change"}, {"repeats": "mean", "max_gap": 1e300}],
)
def test_any_number_gives_a_motion_or_an_error(path, options):
    rng = np.random.default_rng(7)
    for _ in range(80):
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


# -- cubics


def test_cubics_have_the_bits_of_scipy(monkeypatch):
    """Stretch by stretch, in blocks of any size, which is the most that is worked on at
    once.
    """
    rng = np.random.default_rng(0)
    for trial in range(200):
        monkeypatch.setattr(pchip, "BLOCK", int(rng.integers(1, 9)) if trial % 2 else 1 << 16)
        n = int(rng.integers(1, 30))
        t, x = np.cumsum(rng.uniform(0.001, 0.02, n)), np.cumsum(rng.normal(0, 1, n))
        if trial % 3:
            x = rng.integers(-3, 4, n) * rng.choice([1e-3, 1.0, 1e100], n)
        whole = rng.random(n - 1) < rng.choice([0.5, 0.9, 1.0])
        expected = np.zeros((4, n))
        expected[3] = x
        edges = np.flatnonzero(np.diff(np.concatenate([[False], whole, [False]]).astype(int)))
        for a, b in edges.reshape(-1, 2):
            expected[:, a:b] = PchipInterpolator(t[a : b + 1], x[a : b + 1]).c
        assert np.array_equal(pchip.cubics(t, x, whole), expected)
