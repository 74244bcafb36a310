"""Recordings: every policy and every bad file on small files, what equal times mean,
time in another unit, the same bits at every cut, and real recordings.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from pandas import Categorical, DataFrame
from refusals import refused
from scipy.interpolate import PchipInterpolator

import stimlib
from stimlib import BadValue, Input, RecordingError, UnknownName
from stimlib.files import audio as file
from stimlib.motion import Recording, parse_map, parse_source, parse_where, pchip, recording

DATA = Path(__file__).parents[2].parent / "shared" / "data"
FS = 8000.0


@pytest.fixture
def csv(tmp_path):
    """Writes a file of this text, or of these columns, and returns its path."""

    def write(text=None, name="log.csv", **columns):
        path = tmp_path / name
        if path.suffix == ".npz" and text is None:
            np.savez(path, **columns)
        elif text is None:
            rows = [columns, *zip(*columns.values(), strict=True)]
            path.write_text("".join(",".join(map(str, row)) + "\n" for row in rows))
        else:
            path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return write


def steady(n=50):
    """0.1 m/s, 100 reports a second."""
    return {"t_s": (np.arange(n) * 0.01).round(9), "x": (np.arange(n) * 1e-3).round(9)}


def times(r: Recording) -> np.ndarray:
    return np.arange(-100, int(r.duration * FS) + 200) / FS


# -- what the position is


def test_position_is_pchip_through_the_reports_and_held_outside(csv):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.006, 0.02, 60)).round(6)
    x, y = np.cumsum(rng.normal(0, 1e-4, (2, 60)), axis=1).round(7)
    r = recording(csv(t_s=t, x_m=x, y_mm=1000 * y), {"x": "x_m", "y": "y_mm*1e-3", "z": "x_m*2"})
    t = t - t[0]
    at = np.concatenate([t, np.linspace(0, t[-1], 5001)])
    for name, values in (("x", x), ("y", y), ("z", 2 * x)):
        assert_allclose(r.motion[name](at), PchipInterpolator(t, values)(at), rtol=0, atol=1e-15)
    assert r.motion["x"]([-5.0, 1e9]).tolist() == [x[0], x[-1]] and r.duration == t[-1]
    assert r.info["jumps"] == r.info["lifts"] == r.info["gaps"] == []


FORCE = {"t_s": [0, 0.01], "f": [1, 2]}
OTHER = {"Force (N)": [1, 2], "force_\u00b5N": [1, 2], "a-b": [1, 2]}


@pytest.mark.parametrize(
    "text, scale, offset",
    [
        ("f", 1, 0),
        (" f ", 1, 0),
        ("f*5e-4", 5e-4, 0),
        ("5e-4*f", 5e-4, 0),
        ("f*5e-4+0.01", 5e-4, 0.01),
        ("f-3", 1, -3),
        ("3-f", -1, 3),
        ("(f - 2)*0.5", 0.5, -1),
        ("-(f+1)/4", -0.25, -0.25),
        ("+f*1e-3*2", 2e-3, 0),
        ("'f'*2", 2, 0),
        ("'Force (N)'*2 - 1", 2, -1),
        ("Force (N)", 1, 0),
        ("force_\u00b5N*1e-6", 1e-6, 0),
        ("a-b", 1, 0),
        ("1/2*f", 0.5, 0),
        ("f*10**-3 - 2**0.5", 1e-3, -(2**0.5)),
    ],
)
def test_linear_conversion(text, scale, offset):
    r = recording(FORCE | OTHER, {"x": text}, max_speed=None)
    assert_allclose(r.motion["x"]([0.0, 0.01]), [scale + offset, 2 * scale + offset], rtol=1e-14)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "2",
        "2**f",
        "f**f",
        "2**2",
        "(-2)**0.5*f",
        "f*9**9**9",
        "0**-1*f",
        "f/0",
        "f*0",
        "tan(f)",
        "f[0]",
        "f.real",
        "f,f",
        "f*",
    ]
    + [
        "f if f else f",
        "lambda: f",
        "f*True",
        "f*1e999",
        "f + 1e999",
        "f*1j",
        "f f",
        "f; f",
        "f := 3",
    ]
    + ["hypot(f)", "hypot(*f)", "sin(f, f)", "abs(x=f)", "f.sqrt(f)", "sqrt(2)", "hypot(f, f)(f)"]
    + ["f*1" + "0" * 400, "(" * 300 + "f" + ")" * 300, "-" * 900 + "f" * 200, "__import__('os')"]
    + ["f\x00", "f*1e200*1e200", "f % 2", "f//2", "~f", "not f"],
)
def test_expressions_that_are_refused(text):
    refused(BadValue, "x:", recording, FORCE, {"x": text})


@given(st.text(alphabet="f0129.e+-*/() '", max_size=20))
def test_any_expression_is_read_or_refused(text):
    try:
        taken = recording(FORCE, {"x": text}, max_speed=None)
    except BadValue:
        return
    assert np.isfinite(taken.motion["x"]([0.0, 0.005, 0.01])).all()


# -- which rows


TRIALS = "grasp,trial,t_s,f\n" + "".join(
    f"{grasp},{trial},{i / 100},{f + i}\n"
    for grasp, f in (("pinch", 10), ("power", 50))
    for trial in (1, 2)
    for i in range(4)
)


@pytest.mark.parametrize(
    "where",
    [
        {"grasp": "power", "trial": 2},
        {"grasp": " power ", "trial": "2.0"},
        {"trial": np.int64(2), "grasp": "power"},
    ],
)
def test_where_selects_rows(csv, where):
    r = recording(csv(TRIALS), {"x": "f*1e-4"}, where=where)
    assert r.info["reports"] == 4 and r.motion["x"](0.0) == 50 * 1e-4
    assert "np." not in repr(r)


def test_where_compares_numbers_as_numbers(csv):
    table = {"t_s": [0, 0.01, 0.02], "x": [1, 2, 3], "on": [False, True, True]}
    table |= {"g": np.float32([0.1, 1.7, 1.7])}
    path = csv("t_s;x;g\n0,0;1;0,1\n0,01;2;1,234\n0,02;3;1,234\n")
    table |= {"n": ["", 1, 1.0], "id": ["a1", "01", "1.0"]}  # one is missing, one no number
    chosen = {"g": 1.7}, {"on": True}, {"n": 1}, {"n": "1.0"}, {"id": 1}
    for source, where in (*((table, where) for where in chosen), (path, {"g": 1.234})):
        assert recording(source, {"x": "x*1e-3"}, where=where).motion["x"](0.0) == 2e-3


N = np.arange(40)
OFF = {"t_s": N * 0.01 + (N > 30), "contact": np.where(N == 30, 0, 1)}  # 1 s in the air


def gap(seconds, **more):
    c, late = steady(40) | more, np.arange(40) >= 20
    return c | {"t_s": (c["t_s"] + (seconds - 0.01) * late).round(9)}


# -- contact


LIFT = (
    "t_s,x,contact\n0,9,0\n0.01,1,1\n0.02,2,1\n0.03,8,0\n0.04,7,0\n0.05,5,1\n0.06,6,1\n0.07,3,0\n"
)
TOUCH = LIFT.replace("contact", "touch")
LONE = "t_s,x,contact\n0,1,0\n0.01,2,1\n0.02,3,0\n0.03,4,1\n0.04,5,1\n"
TOUCHING = {"contact": np.where(np.arange(40) == 20, 0, 1)}
READ = {  # a table, how it is read; times, the positions and contact at them, and facts
    "two reports are joined by a line": (
        "t_s,x\n5.0,1\n5.1,2\n",
        {},
        {0.0: (1, 1), 0.025: (1.25, 1), 0.05: (1.5, 1), 0.1: (2, 1)},
        {"start": 5.0, "period": pytest.approx(0.1)},
    ),
    "off contact the position is held": (
        LIFT,
        {},
        {0.0: (1, 0), 0.005: (1, 0), 0.01: (1, 1), 0.015: (1.5, 1), 0.02: (2, 0), 0.025: (2, 0)}
        | {0.045: (2, 0), 0.049999: (2, 0), 0.05: (5, 1), 0.055: (5.5, 1), 0.06: (6, 0)}
        | {0.065: (6, 0), 0.07: (6, 0), 1.0: (6, 0)},
        {"lifts": [(2, 0.0), (5, 0.03), (9, 0.07)], "contact": "contact"},
    ),
    "a stretch of one report is a constant": (
        LONE,
        {},
        {0.0: (2, 0), 0.01: (2, 0), 0.02: (2, 0), 0.0299: (2, 0), 0.03: (4, 1)}
        | {0.035: (4.5, 1), 0.04: (5, 1), 9.0: (5, 1)},
        {},
    ),
    "one report in contact": (LONE[: LONE.index("0.03")], {}, {0.0: (2, 0), 0.01: (2, 0)}, {}),
    "a still finger touches until it lifts": (  # reports at 0.19, 2.19 (lifted) and 2.2
        gap(2.0, x=np.arange(40.0), **TOUCHING),
        {"reports": "on_change"},
        {t: (19, 1) for t in (0.19, 1.0, 2.1799)}
        | {t: (19, 0) for t in (2.1801, 2.19, 2.1999)}
        | {2.2: (21, 1)},
        {"silences": 1},
    ),
    "a gap off contact is none": (
        gap(5.0, x=np.arange(40.0), **TOUCHING),
        {},
        {0.19: (19, 0), 1.0: (19, 0), 5.2: (21, 1)},
        {"lifts": [(20, pytest.approx(5.19))]},
    ),
    "a gap after a lift is none": (
        gap(5.0, x=np.arange(40.0), contact=np.where(N == 19, 0, 1)),
        {},
        {0.19: (18, 0), 1.0: (18, 0), 5.19: (20, 1)},
        {"lifts": [(19, pytest.approx(0.19))]},
    ),
    "a jump within the silence of a still finger": (
        gap(2.0, x=np.arange(40) + 50.0 * (np.arange(40) >= 20)),
        {"reports": "on_change"},
        {1.0: (19, 1), 2.17: (19, 1), 2.181: (19, 0), 2.189: (19, 0), 2.19: (70, 1)},
        {"jumps": [(20, pytest.approx(5.1))]},
    ),
    "no jump in so long a time": (
        gap(2.0, x=np.arange(40) + 50.0 * (np.arange(40) >= 20)),
        {"max_gap": 3.0},
        {0.19: (19, 1), 2.19: (70, 1)},
        {"jumps": []},
    ),
    "a text of half a character": (
        {"t_s": [0, 0.01], "x": [1, 2], "note": ["\ud800", ""]},
        {},
        {0.0: (1, 1), 0.01: (2, 1)},
        {},
    ),
    "contact may be ignored": (
        LIFT,
        {"contact": False},
        {0.0: (9, 1), 0.03: (8, 1)},
        {"lifts": []},
    ),
    "contact of another name is none": (TOUCH, {}, {0.0: (9, 1), 0.03: (8, 1)}, {"lifts": []}),
    "contact of another name is named": (
        TOUCH,
        {"contact": "touch"},
        {0.0: (1, 0), 0.015: (1.5, 1), 0.03: (2, 0)},
        {"lifts": [(2, 0.0), (5, 0.03), (9, 0.07)], "contact": "touch"},
    ),
    "a gap is joined up to the limit": (
        gap(0.1, x=np.arange(40.0)),
        {},
        {0.19: (19, 1), 0.29: (20, 1)},
        {"silences": 0, "gaps": []},
    ),
    "a longer gap is joined if it is said": (
        gap(0.15, x=np.arange(40.0)),
        {"max_gap": 0.15},
        {0.19: (19, 1), 0.265: (19.5, 1), 0.34: (20, 1)},
        {"silences": 0, "gaps": []},
    ),
    "who is silent holds still until one period before the next report": (
        gap(3.0, x=np.arange(40.0)),
        {"reports": "on_change"},
        {t: (19, 1) for t in (0.19, 1.0, 3.1799)} | {3.19: (20, 1)},
        {"silences": 1, "jumps": [], "gaps": [(20, pytest.approx(3.0))]},
    ),
    "one missing report is no silence": (
        {"t_s": [0, 0.01, 0.02, 0.04, 0.05, 0.06], "x": [0, 1, 2, 4, 5, 6]},
        {"reports": "on_change"},
        {t: (100 * t, 1) for t in (0.015, 0.02, 0.025, 0.03, 0.035, 0.04, 0.045)},
        {"silences": 0},
    ),
    "equal rows with one time count once": (
        {"t_s": [0, 0.01, 0.01, 0.01, 0.02], "x": [1, 2, 2, 2, 3]},
        {},
        {0.0: (1, 1), 0.005: (1.5, 1), 0.01: (2, 1), 0.015: (2.5, 1)},
        {"repeats": 2},
    ),
    "time in another unit": (
        {"ms": 1.7e12 + np.arange(3) * 10, "x": np.arange(3)},
        {"time": "ms*1e-3"},
        {0.0: (0, 1), 0.02: (2, 1)},
        {"start": 1.7e9},
    ),
    "rows that are not selected need be no numbers": (
        "trial,t_s,x,note\n1,0,0,\n1,0.01,1,a\n2,nan,missing,b\n",
        {"where": {"trial": 1}},
        {0.01: (1, 1)},
        {"reports": 2},
    ),
    **{
        f"good text {k}": (text, {}, {0.0: (1, 1), 0.01: (2, 1)}, {"reports": 2})
        for k, text in enumerate(
            [
                "\ufefft_s,x\n0,1\n0.01,2\n",
                "t_s,x\r\n0,1\r\n0.01,2\r\n",
                "t_s,x\r0,1\r0.01,2",
                "t_s, x\n 0, 1\n0.01 ,2\n\n \n",
                "t_s;x\n0,00;1,0\n0,01;2,0\n",
                "t_s;note;x\r\n0,00;a;1\r\n0.01;b;2,0\r\n",
                '"t_s";"x"\n"0,0";1,0\n0,01;2\n',
                '"t_s","x"\n"0","1"\n"0.01","2"\n',
                ",t_s,x\n0,0,1\n1,0.01,2\n",
                't_s,x,note\n0,1,"a\nb"\n0.01,2,c\n',
            ]
        )
    },
}


@pytest.mark.parametrize("name", READ)
def test_positions_and_contact(csv, name):
    table, how, course, facts = READ[name]
    r = recording(csv(table) if isinstance(table, str) else table, {"x": "x*1e-3"}, **how)
    x, contact = np.transpose([*course.values()])
    assert_allclose(r.motion["x"]([*course]), x * 1e-3, rtol=1e-9, atol=1e-9)
    assert r.contact([*course]).tolist() == contact.tolist()
    assert facts.items() <= r.info.items() and r.has_lifts == bool(r.info["lifts"])
    assert set(r.contact(times(r))) <= {0.0, 1.0}


def test_positions_do_not_depend_on_the_order_of_times():
    r = recording(jumping(20, n=60), {"x": "x"})
    reports = np.arange(60) * r.info["period"]
    t = np.sort([*np.linspace(-0.1, r.duration + 0.1, 3000), *reports, *reports])
    for f in (r.motion["x"], r.contact):
        assert np.array_equal(f(t), f(t[::-1])[::-1]) and np.array_equal(f(t), [*map(f, t)])


# -- jumps


def jumping(*at, n=400):
    c = steady(n)
    return c | {"x": c["x"] + 0.05 * sum(np.arange(n) >= i for i in at)}


def test_a_jump_breaks_contact_of_all_and_is_no_motion():
    r = recording(jumping(20, n=60) | {"y": steady(60)["x"]}, {"x": "x", "y": "y"})
    assert r.info["jumps"] == [(20, pytest.approx(5.1))] and not r.has_lifts
    t = times(r)
    assert np.array_equal(r.contact(t) == 0, (t >= 0.19) & (t < 0.2))
    for name, after in (("x", 0.07), ("y", 0.02)):
        assert r.motion[name]([0.19, 0.195, 0.1999]).tolist() == [0.019] * 3
        assert r.motion[name](0.2) == pytest.approx(after)
    touching = r.contact(t) > 0
    speed = np.abs(np.diff(r.motion["x"](t)) * FS)[touching[1:] & touching[:-1]]
    assert speed.max() < 0.1 * 1.0001
    v = stimlib.blocks.velocity(Input("x", "m"), contact=Input("contact"))
    made = stimlib.Scene({"v": v, "y": 1.0 * Input("y", "m")})
    v = stimlib.render(made, r.motion_for(made.inputs), FS, r.duration, target="python")["v"]
    assert 0.05 < v.max() < 0.1 * 1.0001  # no bump is invented


TWO = jumping(100) | {"p": np.arange(400) * 100}


@pytest.mark.parametrize(
    ("table", "columns", "how", "jumps"),
    [
        (TWO, {"x": "x"}, {"max_speed": None}, 0),
        (TWO, {"x": "x"}, {"max_speed": 6}, 0),
        (TWO, {"x": "x"}, {"max_speed": 1.0}, 1),
        (TWO, {"p": "p"}, {"max_speed": 1e4}, 0),  # up to rounding
        (TWO, {"x": "x", "p": "p"}, {"max_speed": {"x": 1.0}}, 1),
        (TWO, {"x": "x", "p": "p"}, {"max_speed": {"x": 1.0, "p": None}}, 1),
        (jumping(9, 20, n=50), {"x": "x"}, {}, 2),
        (jumping(9, 20, 30, n=350), {"x": "x"}, {}, 3),
    ],
)
def test_jumps_are_faster_than_max_speed_and_few(table, columns, how, jumps):
    assert len(recording(table, columns, **how).info["jumps"]) == jumps


# -- equal times, time in another unit, and large numbers

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
def test_equal_times_are_spread_or_one_report(csv, how, stamps, x, reports, lift):
    r = recording(csv(COARSE), COLUMNS, time=MS, repeats=how, max_speed=None)
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
        (every(0.51), {"max_gap": 0.5}, "slow for a hand"),
        (NAMED, {"time": "'Time (s)'*2"}, r"time=\"\('Time \(s\)'\*2\)\*1e-3\""),
    ],
)
def test_times_that_are_refused(csv, text, how, says):
    refused(RecordingError, says, recording, csv(text), **{"columns": {"x": "x"}} | how)


@pytest.mark.parametrize(
    ("text", "how", "knots"),
    [
        (SILENT, {"repeats": "spread", "reports": "on_change"}, [0, 0.01, 0.015]),  # no silence
        (NAMED, {"time": "('Time (s)'*2)*1e-3"}, [0, 0.016, 0.032]),
        (every(1e-7), {"max_speed": None}, [0, 1e-7, 2e-7]),
        (every(0.49), {"max_gap": 0.5}, [0, 0.49, 0.98]),
        (every(0.7), {"max_gap": 0.7}, [0, 0.7, 1.4]),
        *((every(0.1), {"repeats": repeats}, [0, 0.1, 0.2]) for repeats in REPEATS),
    ],
)
def test_times_that_are_taken(csv, text, how, knots):
    r = recording(csv(text), {"x": "x"}, **how)
    assert r.motion["x"]._knots[:3] == pytest.approx(knots)
    assert r.motion["x"](knots) == pytest.approx([0.0, 0.001, 0.002])


@pytest.mark.parametrize(
    ("scale", "unit", "factor"), [(1e3, "ms", "1e-3"), (1e6, "us", "1e-6"), (1e9, "ns", "1e-9")]
)
@pytest.mark.parametrize("reports", ["always", "on_change"])
def test_time_in_another_unit_is_asked_about(csv, scale, unit, factor, reports):
    path = csv(every(0.008 * scale, "t"))
    how = {"columns": {"x": "x"}, "reports": reports}
    says = rf'time in {unit}\? write time="t\*{factor}"; .*max_gap'
    error = refused(RecordingError, says, recording, path, time="t", **how)
    assert f"{8e-3 * scale:g}" in str(error)
    for more, period in (
        ({"time": f"t*{factor}"}, 0.008),
        ({"time": "t", "max_gap": 0.008 * scale}, 0.008 * scale),
    ):
        assert recording(path, **how, **more).info["period"] == pytest.approx(period)


LARGE = ["1e308", "-1e308", "1e309", "5e-324", "1e-308", "1e17", "0", "-0.0", "1e150"]


@pytest.mark.parametrize(
    "options",
    [{}, {"repeats": "spread"}, {"reports": "on_change"}, {"repeats": "mean", "max_gap": 1e300}],
)
def test_any_number_gives_a_motion_or_an_error(csv, options):
    rng = np.random.default_rng(7)
    for _ in range(80):
        n = int(rng.integers(2, 6))
        t, x = (np.array(LARGE)[rng.integers(0, len(LARGE), n)] for _ in "tx")
        t = sorted(t, key=float) if rng.random() < 0.5 else [f"{i * 0.01}" for i in range(n)]
        path = csv(t_s=t, x=x)
        try:
            r = recording(path, {"x": "x", "y": "x*1e-308"}, max_speed=None, **options)
        except RecordingError:
            continue
        at = np.linspace(-0.1, 1.1, 31) * r.duration
        assert all(np.isfinite(f(at)).all() for f in (r.motion["x"], r.motion["y"], r.contact))


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


# -- how it meets a scene


def test_one_mapping_serves_all_fingers():
    r = recording(steady(), {"x": "x"})
    assert set(r.motion_for(["x"])) == {"x"}
    two = r.motion_for(("x1", "x2"))
    assert two["x1"] is two["x2"] is r.motion["x"]
    own = recording(steady(), {"x": "x", "x2": "x*2"})
    assert own.motion_for(["x1", "x2", "x3"])["x2"] is own.motion["x2"]
    assert r.motion_for(["x1", "contact"])["contact"] is r.contact
    for inputs, missing in ((["y"], "y"), (["x", "x1"], "x1"), (["xa"], "xa"), (["1"], "1")):
        refused(UnknownName, f"nothing is recorded for {missing}", r.motion_for, inputs)
    two = recording({"t_s": [0.0, 0.01], "a": [0, 0]}, {"x": "a", "y": "a"})
    refused(UnknownName, "no input y; .*: x; leave y out of the columns", two.motion_for, ["x"])
    refused(UnknownName, "no input x; the inputs are: none", r.motion_for, [])


def test_lifts_and_jumps_need_a_scene_that_can_know(csv):
    lifted = recording(csv(LIFT), {"x": "x*1e-3"}), "a lift at row 2 .*contact=True"
    jumped = recording(jumping(100), {"x": "x"}), "a jump at row 100 "
    for r, says in (lifted, jumped):
        refused(BadValue, says + r".*Input\(\"contact\"\)", r.motion_for, ["x1", "x2"])
        assert r.motion_for(["x", "contact"])["contact"] is r.contact


@pytest.mark.parametrize(
    ("unit", "lifted", "zero"),
    [
        ("m", {}, False),
        ("rad", {}, False),
        ("N", {}, True),
        ("N/m^2", {}, True),
        ("N", {"a": "hold"}, False),
        ("m/s", {"a": "zero"}, True),
        ("m/s", {"a": "hold"}, False),
        ("m/s", {}, None),
    ],
)
def test_a_lifted_finger_holds_a_position_and_exerts_no_force(csv, unit, lifted, zero):
    """By the input's unit, or as it is said; the text in a sidecar makes it again."""
    r = recording(csv(LIFT), {"x": "x*1e-3", "a": "x*1e-3"}, lifted=lifted)
    inputs = {"x": Input("x", "m"), "a1": Input("a1", unit), "contact": Input("contact")}
    if zero is None:
        whole = recording(csv(**steady()), {"a": "x"}).motion_for({"a": inputs["a1"]})
        assert list(whole) == ["a"], "nothing lifts there"
        refused(
            BadValue, "a1 is in m/s, .*say lifted={'a': 'zero'} or 'hold'", r.motion_for, inputs
        )
        return
    motion, t = r.motion_for(inputs), np.linspace(-0.01, 0.15, 400)
    x, a, on = (motion[name](t) for name in ("x", "a1", "contact"))
    held = recording(csv(LIFT), {"x": "x*1e-3"}).motion["x"](t)
    assert np.array_equal(x, held) and {0.0, 1.0} == {*on} and (x[on == 0] != 0).any()
    assert np.array_equal(a, x * on if zero else x)
    assert np.array_equal(parse_source(repr(motion["a1"]), pinned=True)(t), a)
    assert motion["a1"].info is r.info


def test_a_jump_is_a_lift_of_a_force():
    r = recording(jumping(100) | {"f": np.ones(400)}, {"x": "x", "f": "f"}, max_speed={"x": 1})
    inputs = {"x": Input("x", "m"), "f": Input("f", "N"), "contact": Input("contact")}
    assert r.motion_for(inputs)["f"]([0.98, 0.995, 1.0]).tolist() == [1, 0, 1] and not r.has_lifts


def test_a_rendering_and_its_sidecar(csv, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    csv(LIFT)
    r = recording("log.csv", {"x": "x*1e-3"})
    made = stimlib.Scene({"y": Input("x1", "m") + Input("x2", "m"), "z": 1 * Input("contact")})
    proc = stimlib.compile(made, FS, "python")
    file.write("a.wav", proc, r.motion_for(made.inputs), 0.08, progress=False)
    y, info = file.read("a.wav")
    assert y.shape == (2, 640)
    motion = info["motion"]
    assert motion["x1"] == motion["x2"] == repr(r.motion["x"])
    assert motion["contact"] == repr(r.contact)
    csv(LIFT.replace("0.06,6", "0.06,7"))
    refused(RecordingError, "SHA-256 is .*, not", parse_source, motion["x1"], pinned=True)


@pytest.mark.parametrize(
    "how",
    [
        {"where": {"grasp": "pinch", "trial": 1}},
        {"reports": "on_change", "max_speed": {"x": 2, "y": None}, "max_gap": np.float64(3.0)},
        {"contact": False, "time": "t_s*2", "max_speed": None},
    ],
)
def test_repr_is_one_line_that_makes_it_again(csv, how):
    path = csv(TRIALS.replace("f\n", "f,contact\n", 1).replace("\n", ",1\n").replace("t,1", "t"))
    how = {"where": {"grasp": "pinch", "trial": 1}} | how
    r = recording(path, {"x": "f*1e-4", "y": "(f-1)*2e-4"}, **how)
    again = parse_source(repr(r), pinned=True)
    assert repr(again) == repr(r) and not re.search(r"\n| at 0x|np\.", repr(r))
    assert again.info == r.info | {"file": again.info["file"]}
    for name in ("x", "y"):
        assert repr(r.motion[name]) == f"{r!r}.motion['{name}']"
        assert repr(parse_source(repr(r.motion[name]))) == repr(r.motion[name])
        assert np.array_equal(again.motion[name](times(r)), r.motion[name](times(r)))
    assert repr(parse_source(repr(r.contact))) == repr(r.contact) == repr(r) + ".contact"
    refused(BadValue, "nothing is recorded for 'z'", parse_source, f"{r!r}.motion['z']")
    assert "4 reports" in str(r) and "median" in str(r) and "\n" not in str(r)


# -- the same bits


@settings(max_examples=60)
@given(data=st.data(), reports=st.sampled_from(["always", "on_change"]))
def test_same_bits_however_time_is_cut(data, reports):
    n = data.draw(st.integers(2, 30))
    some = lambda of: data.draw(st.lists(of, min_size=n, max_size=n))  # noqa: E731
    t = np.cumsum(some(st.sampled_from([0.001, 0.008, 0.01, 0.0123, 0.05, 0.099]))).round(6)
    x, contact = some(st.integers(-100, 100)), some(st.sampled_from([1, 1, 1, 0]))
    contact[data.draw(st.integers(0, n - 1))] = 1
    table = {"t_s": t, "x": x, "contact": contact}
    r = recording(table, {"x": "x*1e-3"}, reports=reports, max_speed=None)
    t = times(r)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(t)), max_size=6)))
    for f in (r.motion["x"], r.contact):
        whole = f(t)
        assert whole.dtype == np.float64 and np.isfinite(whole).all()
        assert np.array_equal(np.concatenate([f(part) for part in np.split(t, cuts)]), whole)
        assert np.array_equal(f(t[::-1]), whole[::-1]) and f(t[len(t) // 2]) == whole[len(t) // 2]
        shifted = np.empty(len(t) + 1)[1:]  # another alignment in memory
        shifted[:] = t
        assert np.array_equal(f(shifted), whole)


# -- bad files


BAD = [  # a text
    ("", "empty; give"),
    (" \n\n", "empty"),
    ("\ufeff", "empty"),
    ("t_s,x\n", "no rows"),
    ("t_s,x\n0,1\n", "row 2: one report"),
    ("t_s,x\n0,1\n0,1\n", "row 2: one report"),
    ("t_s,y\n0,1\n1,2\n", "column x, .*the columns are: t_s, y"),
    ("t,x\n0,1\n1,2\n", "time needs column t_s"),
    (",Time (s),x\n1,0,1\n2,1,2\n", r"""such as time="'Time \(s\)'\*1e-3" """),
    ("t_s|x\n0|1\n", "row 2: one report"),
    ("t_s;x\n0;1\n1;1.234,5\n", "row 3, column x: '1.234,5'"),
    ("t_s\tx\n0\t1\n", "row 2: one report"),
    ("0,1\n0.01,1\n", "must name the columns"),
    ("t_s,x,x\n0,1,2\n1,2,3\n", "column x: 2 columns"),
    ("t_s, x,x \n0,1,2\n", "column x: 2 columns"),
    ("t_s,x\n0,0\n0.01\n", "row 3, column x: 1 field"),
    ("t_s,x\n0,0\n0.01,1,\n", "row 3: 3 fields"),
    ("t_s,x\n0,0\n0,01,0,1\n", "row 3: 4 fields .*decimals"),
    ("t_s,x\n0,0\n0.01,abc\n", "row 3, column x: 'abc'"),
    ("t_s,x\n0,0\n0.01,\n", "row 3, column x: .*no number"),
    ("t_s,x\n0,0\n0.01,1_0\n", "row 3, column x: '1_0'"),
    ("t_s,x\n0,0\n0.01,\u0661\n", "row 3, column x: '\u0661'"),
    ("t_s,x\n0,0\n0.01," + "z" * 99 + "\n", r"row 3, column x: 'z{37}\.\.\.'"),
    ("t_s,x\n0,0\n0.01,nan\n", "row 3, column x: nan"),
    ("t_s,x\n0,0\n0.01,-inf\n", "row 3, column x: -inf"),
    ("t_s,x\n0,0\nnan,1\n", "row 3, column t_s: nan"),
    ("t_s,x\n0,0\n0.02,0\n0.01,0\n", "row 4: .*goes back from 0.02"),
    ('t_s,x\n0,"0\n0.01,0\n', "row 3: not CSV"),
    ("t_s,x\n0," + "1" * 140_000 + "\n", "row 2: not CSV"),
    ("t_s,x\n0,0\n0.01,1\0\n", "not a text file"),
    ("t_s,x\n0,0\n".encode("utf-16"), "row 2: one report"),
    ("t_s,x\n0,0\n".encode("utf-16") + b"0", "not UTF-16-LE text"),
    ("\ufefft_s,x\n0,0\n".encode() + b"\xb5", "not UTF-8 text"),
    ("t_s,x\n0,0\n".encode("utf-16-be"), "not a text file"),
    (b"t_s,x\n0,0\n0.01,\xb5\n", "row 3, column x: '\xb5'"),
    (b"t_s,x\n0,0\n0.01,\x81\n", "row 3: .*byte 0x81"),
    (b"PK\x03\x04\x14\0\0\0", "not a text file"),
    ('t_s,x,note\n0,1,"a\nb"\n0.01,2,c\n0.02,c,c\n', "row 5, column x: 'c'"),
    ("t_s,x\n0,0\n0.01,1e300\n0.0100000001,-1e300\n", "row 4: .*too large for its time"),
    ("# by hand\n#,t_s,x\n1,0,0\n2,0.01,c\n", "row 4, column x: 'c'"),  # names begin with #
    ("t_s,x\n0,0\n5e-324,1\n1e-323,2\n", "no clock gives"),
    ("t_s,x\n0,0\n1e308,1\n", "row 3, column t_s: time 1e.308"),
    ("t_s,x\n0,0\n0.01,1\n0.01,2\n0.02,3\n", "row 4: the same time as row 3"),
    ("t_s,x,contact\n0,0,1\n0,0,0\n0.02,3,1\n", "row 3: the same time as row 2"),  # contact counts
    *(
        (f"t_s,x,contact\n0,0,1\n0.01,0,{v}\n", f"row 3, column contact: contact is {v}")
        for v in ("2", "0.5", "-1")
    ),
    ("t_s,x,contact\n0,0,0\n0.01,0,0\n", "column contact: never in contact"),
]
FIVE = {"t_s": np.arange(5) * 0.01, "x": np.arange(5) * 0.01}
BAD_NPZ = [  # arrays, beside or instead of good ones
    (None, "no arrays"),
    ({"x": None}, "column x, .*the columns are: t_s"),
    ({"x": np.ones(4)}, "column x: 4 values, but t_s has 5"),
    ({"fs": 100.0}, r"column fs: shape \(\)"),
    ({"x": np.ones((5, 2))}, r"column x: shape \(5, 2\)"),
    ({"x": FIVE["x"] * 1j}, "column x: not an array of numbers"),
    ({"x": np.array([None] * 5)}, "column x: .*allow_pickle"),
    ({"x": np.array(["0", "1", "", "2", "3"])}, "row 2, column x: .*no number"),
    ({"x": np.array([0, 0, 0, np.nan, 0])}, "row 3, column x: nan"),
    ({"t_s": -FIVE["t_s"]}, "row 1: time goes back from -?0 to -0.01"),
    ({"t_s": FIVE["t_s"][:0], "x": FIVE["x"][:0]}, "no rows"),
    ({"t_s": FIVE["t_s"][:1], "x": FIVE["x"][:1]}, "row 0: one report"),
]
BAD_MEMORY = [  # columns in memory, beside or instead of good ones, and how they are read
    ({"y": np.ones(3)}, {}, "dict in memory, column y: 3 values, but t_s has 50"),
    ({"y": np.ones((50, 2))}, {}, r"column y: shape \(50, 2\)"),
    ({"y": 3.0}, {}, r"column y: shape \(\)"),
    ({"y": [[1], [2, 3]] * 25}, {}, "column y: shape"),
    ({1: np.ones(50), "1": np.ones(50)}, {}, "column 1: two columns"),
    ({"x": [0.1] * 49 + [None]}, {}, "row 49, column x: 'None'"),
    ({"x": np.ma.array([0.1] * 50, mask=[False] * 49 + [True])}, {}, "row 49, column x: '--'"),
    ({"x": [0.1] * 49 + [np.nan]}, {}, "row 49, column x: nan"),
    ({"x": np.ones(50) * 1j}, {}, "row 0, column x: '1j'"),
    ({"t_s": np.arange(50).astype("datetime64[s]")}, {}, "1 s from report to report"),
    ({}, {"sha256": "0" * 64}, "SHA-256 is .* not"),
    ({}, {"contact": "contact"}, "contact needs column contact"),
    ({}, {"columns": {"x": "hypot(x, z)"}}, "x needs column z, and there is none"),
    ({}, {"columns": {"x": "1/(x - x)"}}, "row 0, column x: the result is inf for x = 0"),
    ({}, {"columns": {"x": "(-x)**0.5"}}, "row 1, column x: the result is nan"),
    ({}, {"contact": True}, "contact needs column contact"),
    (gap(0.15), {}, r"row 20: a gap of 0.15 s .*on_change.* max_gap=0.16"),
    ({"t_s": 1.1e12 + np.arange(50)}, {}, r"row 0, column t_s: time 1.1e\+12 s; check the unit"),
    (gap(0.15, **OFF), {}, "row 20: a gap .* or max_gap=0.16 to join it"),
    (gap(0.15) | {"t_s": 2 * gap(0.15)["t_s"]}, {}, "longer than 0.2 s"),  # 10 periods
    (jumping(100), {"columns": {"x": "x*1e3"}}, "row 1: x moves at 100 m/s, .* 398 others"),
    (jumping(9, 20, 30, n=250), {}, "row 9: .* and 2 others"),
    (FIVE, {"columns": {"x": "x*1e300"}, "max_speed": None, "time": "t_s*1e-9"}, "no clock gives"),
    (
        FIVE | {"x": [0, 1, 2, 3, 1e300]},
        {"columns": {"x": "x*1e100"}},
        "row 4, column x: .* inf for x = 1e.300",
    ),
]


@pytest.mark.parametrize(("text", "says"), BAD, ids=repr)
def test_bad_csv(csv, text, says):
    path = csv(text)
    how = {"max_speed": None, "max_gap": 9.0}
    error = refused(RecordingError, says, recording, path, {"x": "x"}, **how)
    assert str(error).startswith(str(path)) and "; " in str(error) and "\n" not in str(error)


@pytest.mark.parametrize(("change", "says"), BAD_NPZ)
def test_bad_npz(csv, change, says):
    arrays = {} if change is None else FIVE | change
    path = csv(name="log.npz", **{k: v for k, v in arrays.items() if v is not None})
    refused(RecordingError, says, recording, path, {"x": "x"})


@pytest.mark.parametrize(("change", "how", "says"), BAD_MEMORY)
def test_a_table_in_memory_that_is_none(change, how, says):
    refused(RecordingError, says, recording, steady() | change, **{"columns": {"x": "x"}} | how)


@pytest.mark.parametrize(
    ("where", "says"),
    [
        (None, r"row 6: .*grasp \(pinch, power\), trial \(1, 2\)"),
        ({"trial": 1}, r"row 10: .*grasp \(pinch, power\); else"),
        ({"grasp": "pinhc"}, "grasp=pinhc; .*grasp has pinch, power"),
        ({"grasp": "pinch", "trial": 9}, "pinch and trial=9; .*trial has 1, 2"),
        ({"trial": "one"}, "trial=one; .*trial has 1, 2"),
        ({"level": "easy"}, "column level, .*: grasp, trial, t_s, f"),
    ],
)
def test_selections_that_are_refused(csv, where, says):
    refused(RecordingError, says, recording, csv(TRIALS), {"x": "f*1e-4"}, where=where)


@pytest.mark.parametrize(
    "change, says",
    [
        ({"columns": {}}, "columns must map"),
        ({"columns": "x=x"}, "columns = .* dict"),
        ({"columns": {"x": 3}}, "columns must map"),
        ({"columns": {"x": "x", "contact": "touch"}}, "use contact='touch'"),
        ({"where": "trial=1"}, "where = .* dict"),
        ({"where": {"trial": [1]}}, "where must map"),
        ({"contact": 1.0}, "contact = 1.0"),
        ({"reports": "sometimes"}, "reports = 'sometimes'"),
        ({"repeats": "first"}, "repeats = 'first'"),
        ({"max_speed": 0}, "max_speed must be"),
        ({"max_speed": float("nan")}, "max_speed = nan"),
        ({"max_speed": {"x": -1.0}}, "max_speed must be"),
        ({"max_speed": {"y": 1.0}}, "no input 'y'; it has x"),
        ({"max_speed": True}, "max_speed = True"),
        ({"max_gap": "long"}, "max_gap = 'long'"),
        ({"max_gap": float("inf")}, "max_gap = inf"),
        ({"sha256": "1234567"}, "sha256 must be"),
        ({"sha256": 5}, "sha256 = 5"),
        ({"time": "2"}, "time: cannot read"),
        ({"time": "-t_s"}, "runs backwards"),
        ({"wrap": 0}, "wrap must be"),
        ({"rate": float("inf")}, "rate = inf|rate must be"),
        ({"clock": "t_s", "rate": 250.0}, "give either clock or rate"),
        ({"time": "t_s + x", "wrap": 5.0}, "wrap: give a single column"),
        ({"missing": "skip"}, "missing = 'skip'"),
        ({"sentinels": -9999}, "sentinels = -9999"),
        ({"lifted": {"y": "zero"}}, "no input 'y'; it has x"),
        ({"lifted": {"x": "up"}}, "lifted = .* one of hold, zero"),
        ({"table": 3}, "DataFrame .* int 3"),
        ({"table": {}}, "there are no columns"),
    ],
)
def test_arguments_out_of_range(change, says):
    given = {"table": steady(), "columns": {"x": "x"}} | change
    refused(BadValue, says, recording, given.pop("table"), given.pop("columns"), **given)


# -- tables in memory


TABLES = {
    "a dict": lambda columns, csv: columns,
    "texts": lambda columns, csv: columns | {"x": columns["x"].astype(str).astype(object)},
    "an archive": lambda columns, csv: csv(name="log.npz", **columns),
    "a DataFrame": lambda columns, csv: DataFrame(columns),
    "a DataFrame of its own types": lambda columns, csv: DataFrame(columns).convert_dtypes(),
    "a DataFrame of two levels": lambda columns, csv: DataFrame(
        {("hand", "x") if n == "x" else (n, ""): v for n, v in columns.items()}
    ),
    "a DataFrame of categories": lambda columns, csv: DataFrame(
        columns | {"trial": Categorical(columns["trial"])}
    ),
}


@pytest.mark.parametrize("kind", TABLES)
@pytest.mark.parametrize("where", [{}, {"trial": "a"}])
def test_a_table_in_memory_or_an_archive_is_what_its_file_is(csv, kind, where):
    columns = steady() | {"trial": np.array(["a", "b"] * 25), "contact": np.arange(50) != 20}
    path = csv(**columns | {"contact": columns["contact"].astype(int)})
    wanted = recording(path, {"x": "x*2"}, where=where)
    x = {"x": "'hand.x'*2" if "levels" in kind else "x*2"}
    found, t = recording(TABLES[kind](columns, csv), x, where=where), times(wanted)
    assert found.motion["x"](t).tobytes() == wanted.motion["x"](t).tobytes()
    assert found.contact(t).tobytes() == wanted.contact(t).tobytes()
    assert [(row + 2, at) for row, at in found.info["lifts"]] == wanted.info["lifts"]


def test_a_frame_of_pandas_with_two_columns_of_one_name_is_refused():
    table = DataFrame(steady() | {"y": np.zeros(50)}).set_axis(["t_s", "x", "x"], axis=1)
    refused(RecordingError, "DataFrame in memory, column x", recording, table, {"x": "x"})


def test_a_table_in_memory_has_a_hash_and_keeps_no_hold_of_the_table():
    columns = steady()
    r = recording(columns, {"x": "x"})
    assert repr(r).startswith("recording('dict in memory', {'x': 'x'}, sha256='")
    assert str(r).startswith("dict in memory: 50 rep")
    before, known = r.motion["x"](times(r)), r.info["sha256"]
    assert recording(columns, {"x": "x"}, sha256=known).info["sha256"] == known
    columns["x"][7] += 1e-6
    assert np.array_equal(r.motion["x"](times(r)), before)
    refused(RecordingError, "SHA-256", recording, columns, {"x": "x"}, sha256=known)


# -- arguments and texts


def test_texts_of_the_command_line():
    assert parse_map(["x=force_N*5e-4", "y='a=b'*2"]) == {"x": "force_N*5e-4", "y": "'a=b'*2"}
    assert parse_where(" grasp = pinch,trial=1") == {"grasp": "pinch", "trial": "1"}
    for bad in ([""], ["x"], ["=x"], ["x="], ["x=a", "x=b"], "x=a"):
        refused(BadValue, "map", parse_map, bad)
    for text in ("", "grasp", "grasp=", "a=1,,b=2", "a=1,a=2"):
        refused(BadValue, "where", parse_where, text)


# -- real recordings

needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="the folder of human recordings is not beside the repository"
)
TOUCH = "touch-evemu/"
# file, mapping, options, lifts; the scales of raw units are guesses that make the
# speeds human
REAL = [
    (
        "grip-trials/grip_p1.csv",
        {"x": "force_N*5e-4"},
        {"where": parse_where("grasp=pinch,level=easy,trial=1")},
        0,
    ),
    (
        TOUCH + "finger_touchpad_horizontal.csv",
        {"x": "x_raw*2e-5", "y": "y_raw*2e-5"},
        {"reports": "on_change"},
        4,
    ),
    (TOUCH + "finger_touchpad_slow.csv", {"x": "x_raw*2e-5"}, {"reports": "on_change"}, 1),
    (TOUCH + "finger_touchscreen_updown.csv", {"y": "y_raw*1e-4"}, {}, 1),
    (
        TOUCH + "finger_tablet_circle.csv",
        {"x": "x_raw*3e-5", "y": "y_raw*3e-5"},
        {"reports": "on_change"},
        1,
    ),
    (TOUCH + "hand_puck_tablet.csv", {"x": "x_mm*1e-3", "y": "y_mm*1e-3"}, {}, 0),
    (TOUCH + "hand_puck_tablet.csv", {"x": "x_mm*1e-3"}, {"reports": "on_change"}, 0),
    ("pen-pressure/pen_loops.csv", {"x": "x_raw*5e-6", "y": "y_raw*5e-6"}, {}, 2),
    ("pen-pressure/pen_loops.csv", {"x": "x_raw*5e-6"}, {"reports": "on_change"}, 2),
    ("fingertip-force/finger_on_texture_12hz.csv", {"x": "-fz_N*5e-4"}, {}, 0),
]


@needs_data
@pytest.mark.parametrize("name, columns, options, lifts", REAL, ids=lambda v: str(v)[:40])
def test_real_recordings(name, columns, options, lifts):
    r = recording(DATA / name, columns, **options)
    assert len(r.info["lifts"]) == lifts and r.has_lifts == bool(lifts)
    assert r.info["jumps"] == [] and r.info["repeats"] == 0
    t = times(r)
    for motion in r.motion.values():
        held = np.interp(t, motion._knots, motion(motion._knots))
        # near the straight lines between the reports
        assert np.abs(motion(t) - held)[r.contact(t) > 0].max() < 0.003
