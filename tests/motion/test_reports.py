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
REPEATS = "last", "mean", "spread"
ONE_TIME = "t_s,x\n1,0\n1,0.001\n1,0.002\n"
NAMED = "Time (s),x\n0,0\n8,0.001\n16,0.002\n"
SILENT = "t_s,x\n0,0\n0.01,0.001\n0.01,0.002\n3,0.003\n3.01,0.004\n3.02,0.005\n"


def every(period, name="t_s"):
    """Twenty reports so far apart; the position is 1 mm more in each."""
    return f"{name},x\n" + "".join(f"{period * i!r},{0.001 * i}\n" for i in range(20))


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
        *((ONE_TIME, {"repeats": how}, "two rows with rising time") for how in REPEATS),
        (NAMED, {"time": "Time (s)"}, r"time=\"'Time \(s\)'\*1e-3\""),
        *(
            (every(period), {"max_speed": None}, says)
            for period, says in ((0.9e-7, "no clock gives"), (0.51, "slow for a hand"))
        ),
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
        (every(1e-7), {"max_speed": None}, [0, 1e-7, 2e-7]),
        (every(0.49), {"max_gap": 0.5}, [0, 0.49, 0.98]),
        *((every(0.1), {"repeats": repeats}, [0, 0.1, 0.2]) for repeats in REPEATS),
    ],
)
def test_times_that_are_taken(path, text, how, knots):
    path.write_text(text)
    r = recording(path, {"x": "x"}, **how)
    assert r.motion["x"]._knots[:3] == pytest.approx(knots)
    assert r.motion["x"](knots) == pytest.approx([0.0, 0.001, 0.002])


@pytest.mark.parametrize(
    ("scale", "unit", "factor"), [(1e3, "ms", "1e-3"), (1e6, "us", "1e-6"), (1e9, "ns", "1e-9")]
)
@pytest.mark.parametrize("reports", ["always", "on_change"])
def test_time_in_another_unit_is_asked_about(path, scale, unit, factor, reports):
    path.write_text(every(0.008 * scale, "t"))
    how = {"columns": {"x": "x"}, "reports": reports}
    says = rf'time in {unit}\? write time="t\*{factor}"; .*max_gap'
    error = refused(RecordingError, says, recording, path, time="t", **how)
    assert f"{8e-3 * scale:g}" in str(error)
    for more, period in (
        ({"time": f"t*{factor}"}, 0.008),
        ({"time": "t", "max_gap": 0.008 * scale}, 0.008 * scale),
    ):
        assert recording(path, **how, **more).info["period"] == pytest.approx(period)


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
