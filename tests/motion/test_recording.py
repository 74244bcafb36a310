"""Recordings: every policy and every bad file on small files, the same bits at every
cut, and real recordings.
"""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from refusals import refused

import stimlib
from stimlib import Input
from stimlib.errors import BadValue, RecordingError, StimlibError, UnknownName
from stimlib.files import audio as file
from stimlib.motion.recorded import Recording, parse_source, recording
from stimlib.motion.text import parse_map, parse_where

DATA = Path(__file__).parents[2].parent / "shared" / "data"
FS = 8000.0


@pytest.fixture
def csv(tmp_path):
    """Writes a CSV file of this text, or of these columns."""

    def write(text: str | None = None, name: str = "log.csv", **columns) -> Path:
        if text is None:
            rows = zip(*columns.values(), strict=True)
            text = (
                ",".join(columns)
                + "\n"
                + "".join(",".join(str(v) for v in row) + "\n" for row in rows)
            )
        path = tmp_path / name
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return write


def unread(says, *given, **how):
    """The error where no recording is read from this, and ``says`` is why."""
    return refused(RecordingError, says, recording, *given, **how)


def steady(n: int = 50, period: float = 0.01, speed: float = 0.1) -> dict:
    t = np.arange(n) * period
    return {"t_s": t.round(9), "x": (speed * t).round(9)}


def times(r: Recording) -> np.ndarray:
    return np.arange(-100, int(r.duration * FS) + 200) / FS


# -- what the position is


def test_position_is_pchip_through_the_reports_and_held_outside(csv):
    from scipy.interpolate import PchipInterpolator

    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.006, 0.02, 60)).round(6)
    x, y = np.cumsum(rng.normal(0, 1e-4, (2, 60)), axis=1).round(7)
    r = recording(csv(t_s=t, x_m=x, y_mm=1000 * y), {"x": "x_m", "y": "y_mm*1e-3"})
    t = t - t[0]
    assert_allclose(r.motion["x"](t), x, rtol=0, atol=1e-18)
    assert_allclose(r.motion["y"](t), y, rtol=0, atol=1e-15)
    inside = np.linspace(0, t[-1], 5001)
    for name, values in (("x", x), ("y", y)):
        assert_allclose(
            r.motion[name](inside), PchipInterpolator(t, values)(inside), rtol=0, atol=1e-15
        )
    assert r.motion["x"]([-5.0, 1e9]).tolist() == [x[0], x[-1]]
    assert (
        r.duration == t[-1]
        and not r.has_lifts
        and r.info["jumps"] == r.info["lifts"] == r.info["gaps"] == []
    )
    assert r.contact([-1.0, 0.0, 0.3, 99.0]).tolist() == [1.0] * 4


def test_two_reports_are_joined_by_a_line(csv):
    r = recording(csv("t_s,x\n5.0,0.01\n5.1,0.02\n"), {"x": "x"})
    assert_allclose(r.motion["x"]([0.0, 0.025, 0.05, 0.1]), [0.01, 0.0125, 0.015, 0.02], rtol=1e-14)
    assert r.info["start"] == 5.0 and r.duration == pytest.approx(0.1)


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
    ],
)
def test_linear_conversion(csv, text, scale, offset):
    f = [1.0, 2.0, 4.0]
    path = csv(**{"t_s": [0, 0.01, 0.02], "f": f, "Force (N)": f, "force_\u00b5N": f, "a-b": f})
    r = recording(path, {"x": text}, max_speed=None)
    assert_allclose(
        r.motion["x"]([0.0, 0.01, 0.02]), scale * np.array(f) + offset, rtol=1e-15, atol=1e-18
    )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "2",
        "f*f",
        "f+f",
        "f**2",
        "1/f",
        "f/0",
        "f*0",
        "sin(f)",
        "f[0]",
        "f.real",
        "f if f else f",
        "lambda: f",
        "f,f",
        "f*True",
        "f*1e999",
        "f*1j",
        "f*",
        "f f",
        "f; f",
        "f*1" + "0" * 400,
        "(" * 300 + "f" + ")" * 300,
        "-" * 900 + "f" * 200,
        "__import__('os')",
        "f*'2'",
        "f := 3",
        "f\x00",
        "f*1e200*1e200",
        "f % 2",
        "f//2",
        "~f",
        "not f",
    ],
)
def test_expressions_that_are_refused(csv, text):
    refused(BadValue, "x:", recording, csv(t_s=[0, 0.01], f=[1, 2]), {"x": text})


@given(st.text(alphabet="f0129.e+-*/() '", max_size=20))
def test_any_expression_is_read_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    if not path.exists():
        path.write_text("t_s,f\n0,1\n1,2\n")
    try:
        taken = recording(path, {"x": text}, max_speed=None, max_gap=2.0)
    except BadValue:
        return
    assert np.isfinite(taken.motion["x"]([0.0, 0.5, 1.0])).all()


def test_time_may_be_converted_and_starts_at_zero(csv):
    path = csv(ms=[1_700_000_000_000, 1_700_000_000_010, 1_700_000_000_020], x=[0, 1e-3, 2e-3])
    r = recording(path, {"x": "x"}, time="ms*1e-3")
    assert r.duration == pytest.approx(0.02, abs=1e-6) and r.info["start"] == 1.7e9
    refused(BadValue, "runs backwards", recording, path, {"x": "x"}, time="-ms")


def test_inputs_may_share_a_column(csv):
    r = recording(csv(**steady()), {"a": "x", "b": "x*2"})
    t = times(r)
    assert_allclose(2 * r.motion["a"](t), r.motion["b"](t), rtol=1e-12)


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


@pytest.mark.parametrize(
    "where, message",
    [
        (
            None,
            (
                r"row 6: time goes back from 0.03 to 0 s; .*where: grasp \(pinch, power\), trial"
                r" \(1, 2\)"
            ),
        ),
        ({"trial": 1}, r"row 10: time goes back .*where: grasp \(pinch, power\); else"),
        ({"grasp": "pinhc"}, "no row has grasp=pinhc; .*grasp has pinch, power"),
        ({"grasp": "pinch", "trial": 9}, "no row has grasp=pinch and trial=9; .*trial has 1, 2"),
        ({"trial": "one"}, "no row has trial=one; .*trial has 1, 2"),
        (
            {"level": "easy"},
            "where needs column level, and there is none; the columns are: grasp, trial, t_s, f",
        ),
    ],
)
def test_selections_that_are_refused(csv, where, message):
    unread(message, csv(TRIALS), {"x": "f*1e-4"}, where=where)


def test_rows_that_are_not_selected_need_not_be_numbers(csv):
    path = csv("trial,t_s,x,note\n1,0,0,\n1,0.01,0.001,a\n2,nan,missing,b\n")
    assert recording(path, {"x": "x"}, where={"trial": 1}).info["reports"] == 2


# -- repeats, gaps, silence


def test_equal_rows_with_one_time_stamp_count_once(csv):
    once, twice = steady(9), steady(9)
    for name in twice:
        twice[name] = np.repeat(twice[name], [1, 3, 1, 1, 2, 1, 1, 1, 1])
    a, b = recording(csv(**once), {"x": "x"}), recording(csv(**twice, name="twice.csv"), {"x": "x"})
    assert b.info["repeats"] == 3 and a.info["repeats"] == 0
    assert np.array_equal(a.motion["x"](times(a)), b.motion["x"](times(a)))


def test_other_values_at_one_time_are_an_error(csv):
    unread(
        "row 4: the same time as row 3 and other values; remove",
        csv("t_s,x\n0,0\n0.01,0.001\n0.01,0.002\n0.02,0.003\n"),
        {"x": "x"},
    )
    with pytest.raises(RecordingError, match="row 3: the same time as row 2"):  # contact counts too
        recording(csv("t_s,x,contact\n0,0,1\n0,0,0\n0.02,0.003,1\n"), {"x": "x"})


def gap(seconds: float) -> dict:
    c = steady(40)
    c["t_s"] = np.where(np.arange(40) < 20, c["t_s"], c["t_s"] + seconds - 0.01).round(9)
    return c


def test_always_joins_gaps_to_the_limit_and_no_longer(csv):
    r = recording(csv(**gap(0.1)), {"x": "x"})
    assert 0.019 < r.motion["x"](0.24) < 0.02 and r.info["silences"] == 0
    unread(
        r"row 22: a gap of 0.15 s .* 0.1 s; use reports=\"on_change\" .* max_gap=0.16",
        csv(**gap(0.15)),
        {"x": "x"},
    )
    recording(csv(**gap(0.15)), {"x": "x"}, max_gap=0.15 + 1e-9)
    slow = gap(0.15)
    slow["t_s"] = 2 * slow["t_s"]  # 10 periods are 0.2 s now
    unread("longer than 0.2 s", csv(**slow), {"x": "x"})


def test_no_gap_off_contact(csv):
    c = gap(5.0)
    c["contact"] = np.where(np.arange(40) == 20, 0, 1)
    assert recording(csv(**c), {"x": "x"}).info["lifts"] == [(22, pytest.approx(5.19))]


def test_on_change_holds_still_until_one_period_before_the_next_report(csv):
    r = recording(csv(**gap(3.0)), {"x": "x"}, reports="on_change")
    last, following = 0.19, 3.19
    assert (
        r.info["silences"] == 1
        and r.info["gaps"] == [(22, pytest.approx(3.0))]
        and not r.info["jumps"]
    )
    held = r.motion["x"](np.linspace(last, following - 0.01, 1001))
    assert_allclose(held, 0.019, rtol=0, atol=1e-15)
    moving = r.motion["x"](np.linspace(following - 0.01, following, 101))
    assert (np.diff(moving) > 0).all() and moving[-1] == 0.02
    assert (r.contact(times(r)) == 1).all()


def test_one_missing_report_is_not_silence(csv):
    c = {name: np.delete(values, [10, 20, 30]) for name, values in steady().items()}
    r = recording(csv(**c), {"x": "x"}, reports="on_change")
    assert r.info["silences"] == 0
    speed = np.diff(r.motion["x"](np.arange(3900) / FS)) * FS
    assert_allclose(speed, 0.1, rtol=1e-6)  # the point does not stop


# -- contact


LIFT = (
    "t_s,x,contact\n0,9,0\n0.01,1,1\n0.02,2,1\n0.03,8,0\n0.04,7,0\n0.05,5,1\n0.06,6,1\n0.07,3,0\n"
)


def test_off_contact_the_position_is_held_and_contact_is_zero(csv):
    r = recording(csv(LIFT), {"x": "x*1e-3"})
    assert (
        r.has_lifts
        and r.info["lifts"] == [(2, 0.0), (5, 0.03), (9, 0.07)]
        and r.info["contact"] == "contact"
    )
    t = np.array(
        [0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.045, 0.049999, 0.05, 0.055, 0.06, 0.065, 0.07, 1.0]
    )
    assert r.contact(t).tolist() == [0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0]
    x = [1, 1, 1, 1.5, 2, 2, 2, 2, 5, 5.5, 6, 6, 6, 6]
    assert_allclose(r.motion["x"](t), np.array(x) * 1e-3, rtol=1e-12)
    assert np.unique(r.contact(times(r))).tolist() == [0.0, 1.0]


def test_contact_may_be_ignored_named_and_absent(csv):
    r = recording(csv(LIFT), {"x": "x*1e-4"}, contact=False)
    assert (
        not r.has_lifts
        and r.motion["x"](0.03) == pytest.approx(8e-4)
        and (r.contact(times(r)) == 1).all()
    )
    renamed = csv(LIFT.replace("contact", "touch"), name="touch.csv")
    assert not recording(renamed, {"x": "x*1e-4"}).has_lifts
    assert recording(renamed, {"x": "x*1e-4"}, contact="touch").has_lifts
    for contact in ("contact", True):
        unread(
            "contact needs column contact, and there is none", renamed, {"x": "x"}, contact=contact
        )


def test_a_stretch_of_one_report_is_a_constant(csv):
    r = recording(
        csv("t_s,x,contact\n0,1,0\n0.01,2,1\n0.02,3,0\n0.03,4,1\n0.04,5,1\n"), {"x": "x*1e-3"}
    )
    assert r.motion["x"]([0.0, 0.01, 0.02, 0.0299, 0.03]).tolist() == [
        0.002,
        0.002,
        0.002,
        0.002,
        0.004,
    ]
    assert r.contact([0.01, 0.0299, 0.03, 0.04, 9.0]).tolist() == [0, 0, 1, 1, 1]
    alone = recording(
        csv("t_s,x,contact\n0,1,0\n0.01,2,1\n0.02,3,0\n", name="one.csv"), {"x": "x*1e-3"}
    )
    assert (alone.motion["x"](times(alone)) == 0.002).all() and not alone.contact(
        times(alone)
    ).any()


def test_on_change_a_still_finger_touches_until_it_lifts(csv):
    c = gap(2.0)
    c["contact"] = np.where(np.arange(40) == 20, 0, 1)
    # reports at 0.19 (touching), 2.19 (lifted), 2.20
    r = recording(csv(**c), {"x": "x"}, reports="on_change")
    assert r.contact([0.19, 1.0, 2.1799, 2.1801, 2.19, 2.1999, 2.2]).tolist() == [
        1,
        1,
        1,
        0,
        0,
        0,
        1,
    ]
    assert recording(csv(**c), {"x": "x"}).contact([0.19, 1.0]).tolist() == [0, 0]


@pytest.mark.parametrize("value, shown", [("2", "2"), ("0.5", "0.5"), ("-1", "-1")])
def test_contact_is_zero_or_one(csv, value, shown):
    unread(
        f"row 3, column contact: contact is {shown}; use a column of 0 and 1",
        csv(f"t_s,x,contact\n0,0,1\n0.01,0,{value}\n"),
        {"x": "x"},
    )


def test_never_in_contact(csv):
    unread(
        "column contact: never in contact; use contact=False",
        csv("t_s,x,contact\n0,0,0\n0.01,0,0\n"),
        {"x": "x"},
    )


# -- jumps


def jumping(*at: int, n: int = 400) -> dict:
    c = steady(n)
    for i in at:
        c["x"] = c["x"] + np.where(np.arange(n) >= i, 0.05, 0.0)
    return c


def test_a_jump_breaks_contact_and_is_no_motion(csv):
    r = recording(csv(**jumping(100)), {"x": "x"})
    assert r.info["jumps"] == [(102, pytest.approx(5.1))] and not r.has_lifts
    t = times(r)
    assert np.array_equal(r.contact(t) == 0, (t >= 0.99) & (t < 1.0))
    assert r.motion["x"]([0.99, 0.995, 0.9999]).tolist() == [0.099] * 3 and r.motion["x"](
        1.0
    ) == pytest.approx(0.15)
    touching = r.contact(t) > 0
    speed = np.abs(np.diff(r.motion["x"](t)) * FS)[touching[1:] & touching[:-1]]
    assert speed.max() < 0.1 * 1.0001
    scene = stimlib.Scene(
        {"v": stimlib.blocks.velocity(stimlib.Input("x", "m"), contact=stimlib.Input("contact"))}
    )
    v = stimlib.render(scene, r.motion_for(scene.inputs), FS, seconds=r.duration, target="python")[
        "v"
    ]
    assert 0.05 < v.max() < 0.1 * 1.0001  # no bump is invented


def test_a_jump_of_one_input_breaks_all(csv):
    c = jumping(100)
    r = recording(csv(**c, y=steady(400)["x"]), {"x": "x", "y": "y"})
    assert len(r.info["jumps"]) == 1 and (r.motion["y"]([0.99, 0.995]) == 0.099).all()


def test_max_speed(csv):
    path = csv(**jumping(100), p=np.arange(400) * 100)
    assert recording(path, {"x": "x"}, max_speed=None).info["jumps"] == []
    assert recording(path, {"x": "x"}, max_speed=6).info["jumps"] == []
    assert len(recording(path, {"x": "x", "p": "p"}, max_speed={"x": 1.0}).info["jumps"]) == 1
    assert (
        len(recording(path, {"x": "x", "p": "p"}, max_speed={"x": 1.0, "p": None}).info["jumps"])
        == 1
    )
    unread(r"row 3: p moves at 1e\+04 m/s, faster than a hand", path, {"x": "x", "p": "p"})


def test_many_jumps_are_a_wrong_unit(csv):
    message = (
        r"row 3: x moves at 100 m/s, faster than a hand \(max_speed is 1 m/s\), in this report and"
        r" 398 others; check the unit"
    )
    unread(message, csv(**steady(400)), {"x": "x*1e3"})
    with pytest.raises(RecordingError, match="row 3: .*faster than a hand"):  # nothing but jumps
        recording(csv("t_s,x\n0,0\n0.01,1\n"), {"x": "x"})
    assert len(recording(csv(**jumping(9, 20, n=50)), {"x": "x"}).info["jumps"]) == 2
    unread("row 11: .* and 2 others", csv(**jumping(9, 20, 30, n=250)), {"x": "x"})
    assert len(recording(csv(**jumping(9, 20, 30, n=350)), {"x": "x"}).info["jumps"]) == 3


def test_on_change_judges_the_speed_by_the_time_of_the_motion(csv):
    c = gap(2.0)
    # 0.051 m within 2 s, or within one period
    c["x"] = c["x"] + np.where(np.arange(40) >= 20, 0.05, 0.0)
    assert recording(csv(**c), {"x": "x"}, max_gap=3.0).info["jumps"] == []
    r = recording(csv(**c), {"x": "x"}, reports="on_change")
    assert r.info["jumps"] == [(22, pytest.approx(5.1))]
    assert r.contact([1.0, 2.17, 2.181, 2.189, 2.19]).tolist() == [1, 1, 0, 0, 1]


# -- how it meets a scene


def scene(*inputs: str) -> stimlib.Scene:
    return stimlib.Scene(
        {
            f"y{i}": stimlib.Input(name, "1" if name == "contact" else "m") * 1.0
            for i, name in enumerate(inputs)
        }
    )


def test_one_mapping_serves_all_fingers(csv):
    r = recording(csv(**steady()), {"x": "x"})
    assert set(r.motion_for(["x"])) == {"x"}
    two = r.motion_for(("x1", "x2"))
    assert two["x1"] is two["x2"] is r.motion["x"]
    own = recording(csv(**steady()), {"x": "x", "x2": "x*2"})
    assert own.motion_for(["x1", "x2", "x3"])["x2"] is own.motion["x2"]
    both = r.motion_for(["x1", "contact"])
    assert both["contact"] is r.contact


@pytest.mark.parametrize(
    "inputs, message",
    [
        (["y"], "nothing is recorded for y, the scene has no input x; the inputs are: y"),
        (["x", "x1"], "nothing is recorded for x1"),
        (["xa"], "nothing is recorded for xa"),
        (["1"], "nothing is recorded for 1"),
        ([], "no input x; the inputs are: none"),
    ],
)
def test_inputs_that_do_not_fit(csv, inputs, message):
    refused(UnknownName, message, recording(csv(**steady()), {"x": "x"}).motion_for, inputs)


def test_lifts_and_jumps_need_a_scene_that_can_know(csv):
    lifted, jumped = (
        recording(csv(LIFT), {"x": "x*1e-3"}),
        recording(csv(**jumping(100), name="jump.csv"), {"x": "x"}),
    )
    refused(
        BadValue,
        r"a lift at row 2 \(3 in all\), .*; make it with contact=True .*Input\(\"contact\"\),"
        r" or .*contact=False",
        lifted.motion_for,
        ["x"],
    )
    refused(BadValue, r"a jump at row 102 .*Input\(\"contact\"\)$", jumped.motion_for, ["x1", "x2"])
    for r in (lifted, jumped):
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


def test_a_rendering_and_its_sidecar(csv, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    csv(LIFT)
    r = recording("log.csv", {"x": "x*1e-3"})
    made = scene("x1", "x2", "contact")
    report = file.write(
        "a.wav",
        stimlib.compile(made, FS, "python"),
        r.motion_for(made.inputs),
        0.08,
        progress=False,
    )
    y, _ = file.read("a.wav")
    assert y.shape == (3, 640) and report.frames == 640
    motion = json.loads(Path("a.wav.json").read_text())["motion"]
    assert motion["x1"] == motion["x2"] == repr(r.motion["x"]) and motion["contact"] == repr(
        r.contact
    )
    again = parse_source(motion["x1"], pinned=True)
    assert np.array_equal(again(times(r)), r.motion["x"](times(r)))
    Path("log.csv").write_text(LIFT.replace("0.06,6", "0.06,7"))
    refused(
        RecordingError,
        "SHA-256 is .*, not .*; find the file that was meant",
        parse_source,
        motion["x1"],
        pinned=True,
    )


def test_repr_is_one_line_that_makes_it_again(csv):
    path = csv(
        TRIALS.replace("f\n", "f,contact\n", 1)
        .replace("\n", ",1\n")
        .replace("contact,1", "contact")
    )
    options = dict(
        where={"grasp": "pinch", "trial": 1},
        reports="on_change",
        max_speed={"x": 2, "y": None},
        max_gap=np.float64(3.0),
    )
    for more in (
        {"where": options["where"]},
        options,
        options | {"contact": False, "time": "t_s*2", "max_speed": None},
    ):
        r = recording(path, {"x": "f*1e-4", "y": "(f-1)*2e-4"}, **more)
        again = parse_source(repr(r), pinned=True)
        assert (
            repr(again) == repr(r)
            and "\n" not in repr(r)
            and " at 0x" not in repr(r)
            and "np." not in repr(r)
        )
        assert again.info == r.info | {"file": again.info["file"]}
        for name in ("x", "y"):
            assert np.array_equal(again.motion[name](times(r)), r.motion[name](times(r)))
    assert repr(parse_source(repr(r.motion["y"]))) == repr(r.motion["y"]) and repr(
        parse_source(repr(r.contact))
    ) == repr(r.contact)
    refused(BadValue, "nothing is recorded for 'z'", parse_source, f"{r!r}.motion['z']")
    assert (
        repr(r.motion["x"]) == repr(r) + ".motion['x']" and repr(r.contact) == repr(r) + ".contact"
    )
    assert str(r).endswith("4 reports, 0.06 s, median 50 Hz") and "\n" not in str(r)


# -- the same bits


@settings(max_examples=60)
@given(data=st.data(), reports=st.sampled_from(["always", "on_change"]))
def test_same_bits_however_time_is_cut(tmp_path_factory, data, reports):
    n = data.draw(st.integers(2, 30))
    steps = data.draw(
        st.lists(st.sampled_from([0.001, 0.008, 0.01, 0.0123, 0.05, 0.099]), min_size=n, max_size=n)
    )
    x = data.draw(st.lists(st.integers(-100, 100), min_size=n, max_size=n))
    contact = data.draw(st.lists(st.sampled_from([1, 1, 1, 0]), min_size=n, max_size=n))
    contact[data.draw(st.integers(0, n - 1))] = 1
    path = tmp_path_factory.getbasetemp() / "cut.csv"
    rows = zip(np.cumsum(steps).round(6), x, contact, strict=True)
    path.write_text("t_s,x,contact\n" + "".join(f"{t},{v},{c}\n" for t, v, c in rows))
    r = recording(path, {"x": "x*1e-3"}, reports=reports, max_speed=None)
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
    check_speed(r, path, "x", 1e-3)


def check_speed(r: Recording, path: Path, column: str, scale: float) -> None:
    """Within a stretch PCHIP is at most 1.5 times as fast as the fastest step; 3 times
    in its first and last interval.

    An inner derivative is a weighted harmonic mean of the two secants, or 0, so at most
    the larger one, M; with it the cubic's slope 6s(1-s)d + (1-s)(1-3s)d0 + s(3s-2)d1 is
    at most 1.5 M. At an end of a stretch scipy limits the derivative to 3 times the
    secant, and 3(1-s)^2 + ... <= 3.
    """
    t, position = times(r), r.motion[column]
    knots = position._knots  # the reports in contact, and where silences end
    x = position(knots)
    touching = r.contact(knots[:-1]) > 0
    secant = np.where(touching, np.abs(np.diff(x)) / np.diff(knots), 0.0)
    starts = touching & ~np.append(False, touching[:-1])
    ends = touching & ~np.append(touching[1:], False)
    if not touching.any():
        return
    bound = np.zeros(len(secant))
    for a, b in zip(np.flatnonzero(starts), np.flatnonzero(ends), strict=True):
        bound[a : b + 1] = 1.5 * secant[a : b + 1].max()
        bound[a], bound[b] = max(bound[a], 3 * secant[a]), max(bound[b], 3 * secant[b])
    k = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(secant) - 1)
    on = r.contact(t) > 0
    whole = (
        on[:-1]
        & on[1:]
        & (np.searchsorted(knots[1:][ends], t[1:]) == np.searchsorted(knots[1:][ends], t[:-1]))
    )
    local = np.array([bound[a : b + 1].max() for a, b in zip(k[:-1], k[1:], strict=True)])
    speed = np.abs(np.diff(position(t))) * FS
    assert (speed[whole] <= local[whole] * (1 + 1e-9) + 1e-11).all()


# -- bad files


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "the file is empty; give"),
        (" \n\n", "the file is empty"),
        ("\ufeff", "the file is empty"),
        ("t_s,x\n", "names of columns and no rows"),
        ("t_s,x\n0,1\n", "row 2: one report is not a motion; give at least two rows"),
        ("t_s,x\n0,1\n0,1\n", "row 2: one report is not a motion"),
        (
            "t_s,y\n0,1\n1,2\n",
            r"x needs column x, and there is none; the columns are: t_s, y; use one of those",
        ),
        ("t,x\n0,1\n1,2\n", "time needs column t_s, and there is none"),
        ("t_s|x\n0|1\n1|2\n", "separate columns by commas, not by '\\|'"),
        ("t_s;x\n0;1\n1;1.234,5\n", "row 3, column x: '1.234,5' is not a number"),
        ("t_s\tx\n0\t1\n", "separate columns by commas, not by '\\\\t'"),
        ("0,1\n0.01,1\n", "the first line must name the columns"),
        ("t_s,x,x\n0,1,2\n1,2,3\n", "row 1, column x: 2 columns have this name; rename"),
        ("t_s, x,x \n0,1,2\n", "row 1, column x: 2 columns have this name"),
        (
            "t_s,x\n0,0\n0.01\n",
            "row 3, column x: 1 fields for 2 columns, missing field; correct the row",
        ),
        ("t_s,x\n0,0\n0.01,1,\n", "row 3: 3 fields for 2 columns, surplus field"),
        (
            "t_s,x\n0,0\n0,01,0,1\n",
            r"row 3: 4 fields for 2 columns, surplus field; .*decimals with a point",
        ),
        ("t_s,x\n0,0\n\n0.01,0.1\n", "row 3: the line is blank; remove it"),
        ("\nt_s,x\n0,0\n0.01,0.1\n", "row 1: the line is blank; put the names"),
        (
            "t_s,x\n0,0\n0.01,abc\n",
            "row 3, column x: 'abc' is not a number; correct or remove the row",
        ),
        ("t_s,x\n0,0\n0.01,\n", "row 3, column x: there is no number"),
        ("t_s,x\n0,0\n0.01,1_0\n", "row 3, column x: '1_0' is not a number"),
        ("t_s,x\n0,0\n0.01,\u0661\n", "row 3, column x: '\u0661' is not a number"),
        ("t_s,x\n0,0\n0.01," + "z" * 99 + "\n", r"row 3, column x: 'z{37}\.\.\.' is not a number"),
        ("t_s,x\n0,0\n0.01,nan\n", "row 3, column x: nan is not finite"),
        ("t_s,x\n0,0\n0.01,-inf\n", "row 3, column x: -inf is not finite"),
        ("t_s,x\n0,0\nnan,1\n", "row 3, column t_s: nan is not finite"),
        (
            "t_s,x\n0,0\n0.02,0\n0.01,0\n",
            "row 4: time goes back from 0.02 to 0.01 s; put the rows into the order of time",
        ),
        ('t_s,x\n0,"0\n0.01,0\n', "row 3: not CSV"),
        ("t_s,x\n0," + "1" * 140_000 + "\n", "row 2: not CSV"),
        ("t_s,x\n0,0\n0.01,1\0\n", "not a text file; save it as CSV text in UTF-8"),
        ("t_s,x\n0,0\n".encode("utf-16"), "UTF-16 text; save it as CSV text in UTF-8"),
        ("t_s,x\n0,0\n".encode("utf-16-be"), "not a text file"),
        (b"t_s,x\n0,0\n0.01,\xb5\n", "row 3: not UTF-8 text, byte 0xb5"),
        (b"PK\x03\x04\x14\0\0\0", "not a text file"),
    ],
    ids=repr,
)
def test_bad_csv(csv, text, message):
    path = csv(text)
    error = unread(message, path, {"x": "x"}, max_speed=None, max_gap=9.0)
    assert str(error).startswith(str(path)) and "; " in str(error) and "\n" not in str(error)


@pytest.mark.parametrize(
    "text",
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
    ],
    ids=repr,
)
def test_good_csv(csv, text):
    r = recording(csv(text), {"x": "x*1e-3"})
    assert r.motion["x"]([0.0, 0.01]).tolist() == [0.001, 0.002]


def test_row_is_the_line_in_the_file(csv):
    unread("row 5, column x: 'c'", csv('t_s,x,note\n0,1,"a\nb"\n0.01,2,c\n0.02,c,c\n'), {"x": "x"})


def test_numbers_that_overflow(csv):
    unread(
        r"row 3, column x: 1e300 \* 1e\+100 \+ 0 overflows; check the unit",
        csv("t_s,x\n0,1e-100\n0.01,1e300\n"),
        {"x": "x*1e100"},
        max_speed=None,
    )
    unread(
        "row 4: the step to this report is too large for its time",
        csv("t_s,x\n0,0\n0.01,1e300\n0.0100000001,-1e300\n"),
        {"x": "x"},
        max_speed=None,
    )


@settings(max_examples=150)
@given(
    st.binary(max_size=60)
    | st.text(alphabet='t_sx,\n01.-e" ', max_size=60).map(lambda s: ("t_s,x\n" + s).encode())
)
def test_any_bytes_are_read_or_refused(tmp_path_factory, data):
    for suffix in ("csv", "npz"):
        path = tmp_path_factory.getbasetemp() / f"bytes.{suffix}"
        path.write_bytes(data)
        try:
            recording(path, {"x": "x"})
        except RecordingError as error:
            assert str(error).startswith(str(path))


def test_places_that_cannot_be_read(tmp_path):
    for path, reason in (
        (tmp_path / "no.csv", "No such file"),
        (tmp_path, "directory"),
        ("a\0b", "null"),
    ):
        unread(f"cannot be read .*{reason}.*; give the name", path, {"x": "x"})
    refused(
        BadValue,
        "give the name of a file, a DataFrame or a dict of arrays, got int 3",
        recording,
        3,
        {"x": "x"},
    )


# -- tables in memory


class Frame:
    """What a DataFrame of pandas has of a mapping: keys and columns, and neither a
    length of columns nor items.
    """

    def __init__(self, **columns):
        self.columns = columns

    def keys(self):
        return iter(self.columns)

    def __getitem__(self, name):
        return self.columns[name]


def test_a_table_in_memory_is_what_its_file_is(csv):
    columns = steady() | {"trial": ["a", "b"] * 25, "contact": np.arange(50) != 20}
    path = csv(**columns | {"contact": columns["contact"].astype(int)})
    for table in (
        columns,
        Frame(**columns),
        columns | {"x": columns["x"].astype(str).astype(object)},
    ):
        for where in ({}, {"trial": "a"}):
            wanted, found = (
                recording(path, {"x": "x*2"}, where=where),
                recording(table, {"x": "x*2"}, where=where),
            )
            t = times(wanted)
            assert found.motion["x"](t).tobytes() == wanted.motion["x"](t).tobytes()
            assert found.contact(t).tobytes() == wanted.contact(t).tobytes()
            assert [(row + 2, at) for row, at in found.info["lifts"]] == wanted.info["lifts"]


def test_a_table_in_memory_has_a_hash_and_keeps_no_hold_of_the_table():
    columns = steady()
    r = recording(columns, {"x": "x"})
    assert repr(r).startswith("recording('dict in memory', {'x': 'x'}, sha256='") and str(
        r
    ).startswith("dict in memory: 50 rep")
    before = r.motion["x"](times(r))
    assert (
        recording(columns, {"x": "x"}, sha256=r.info["sha256"]).info["sha256"] == r.info["sha256"]
    )
    columns["x"][7] += 1e-6
    assert np.array_equal(r.motion["x"](times(r)), before)
    unread(
        "dict in memory: SHA-256 is .* not .*; find the file that was meant",
        columns,
        {"x": "x"},
        sha256=r.info["sha256"],
    )


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (
            {"y": np.ones(3)},
            "dict in memory, column y: 3 values, but t_s has 50; give columns of equal length",
        ),
        ({"y": np.ones((50, 2))}, r"column y: shape \(50, 2\); give one-dimensional columns"),
        ({"y": 3.0}, r"column y: shape \(\); give one-dim"),
        ({"y": [[1], [2, 3]] * 25}, "column y: shape .*; give one-dim"),
        ({1: np.ones(50), "1": np.ones(50)}, "column 1: two columns have this name; rename one"),
        (
            {"x": [0.1] * 49 + [None]},
            "row 49, column x: 'None' is not a number; correct or remove the row",
        ),
        (
            {"x": np.ma.array([0.1] * 50, mask=[False] * 9 + [True] + [False] * 40)},
            "row 9, column x: '--' is not a number",
        ),
        ({"x": [0.1] * 49 + [np.nan]}, "row 49, column x: nan is not finite"),
        ({"x": np.ones(50) * 1j}, "row 0, column x: '1j' is not a number"),
        (
            {"t_s": np.arange(50).astype("datetime64[s]")},
            "row 0, column t_s: '1970-01-01T00:00:00' is not a number",
        ),
    ],
)
def test_a_table_in_memory_that_is_none(more, says):
    unread(says, steady() | more, {"x": "x"})
    unread("dict in memory: there are no columns", {}, {"x": "x"})


def test_a_frame_of_pandas(csv):
    pandas = pytest.importorskip("pandas")
    path = csv(**steady() | {"trial": ["a", "b"] * 25})
    frame = pandas.read_csv(path)
    for table in (
        frame,
        frame.convert_dtypes(),
        frame.astype({"trial": "category"}),
        frame.set_index(frame.index * 3),
    ):
        wanted, found = (
            recording(path, {"x": "x"}, where={"trial": "b"}),
            recording(table, {"x": "x"}, where={"trial": "b"}),
        )
        assert (
            found.motion["x"](times(wanted)).tobytes()
            == wanted.motion["x"](times(wanted)).tobytes()
        )
    twice = pandas.concat([frame, frame["x"]], axis=1)
    unread(r"DataFrame in memory, column x: ", twice, {"x": "x"})


# -- npz


def npz(folder: Path, **arrays) -> Path:
    np.savez(folder / "log.npz", **arrays)
    return folder / "log.npz"


def test_npz_is_as_good_as_csv(csv, tmp_path):
    t, x = np.arange(30) * 0.01, np.sin(np.arange(30)) * 1e-4
    contact, kind = np.arange(30) > 3, np.where(np.arange(30) < 25, "a", "b")
    a = recording(
        npz(tmp_path, t_s=t, x=x, contact=contact, kind=kind), {"x": "x"}, where={"kind": "a"}
    )
    c = csv(
        t_s=map(repr, t.tolist()), x=map(repr, x.tolist()), contact=contact.astype(int), kind=kind
    )
    b = recording(c, {"x": "x"}, where={"kind": "a"})
    for name in ("x", "contact"):
        f, g = a.motion_for(["x", "contact"])[name], b.motion_for(["x", "contact"])[name]
        assert np.array_equal(f(times(a)), g(times(a)))
    assert (
        a.info["lifts"] == [(0, 0.0)] and b.info["lifts"] == [(2, 0.0)] and a.info["reports"] == 25
    )


T = np.arange(5) * 0.01


@pytest.mark.parametrize(
    "arrays, message",
    [
        ({}, "there are no arrays"),
        ({"t_s": T}, "x needs column x, and there is none; the columns are: t_s"),
        (
            {"t_s": T, "x": T[:4]},
            "column x: 4 values, but t_s has 5; save one-dimensional arrays of equal length",
        ),
        ({"t_s": T, "x": T, "fs": 100.0}, r"column fs: shape \(\)"),
        ({"t_s": T, "x": np.ones((5, 2))}, r"column x: shape \(5, 2\); save one-dimensional"),
        ({"t_s": T, "x": T * 1j}, "column x: not an array of numbers"),
        ({"t_s": T, "x": np.array([None] * 5)}, "column x: cannot be read as npz .*allow_pickle"),
        (
            {"t_s": T, "x": np.array(["0", "1", "", "2", "3"])},
            "row 2, column x: there is no number",
        ),
        ({"t_s": T, "x": np.array([0, 0, 0, np.nan, 0])}, "row 3, column x: nan is not finite"),
        ({"t_s": -T, "x": T}, "row 1: time goes back from -?0 to -0.01 s"),
        ({"t_s": T[:0], "x": T[:0]}, "no rows"),
        ({"t_s": T[:1], "x": T[:1]}, "row 0: one report is not a motion"),
    ],
)
def test_bad_npz(tmp_path, arrays, message):
    unread(message, npz(tmp_path, **arrays), {"x": "x"})


def test_files_that_are_no_npz(tmp_path):
    good = npz(tmp_path, t_s=T, x=T).read_bytes()
    path = tmp_path / "bad.npz"
    for data in (
        good[:-30],
        good[:40],
        b"t_s,x\n0,1\n",
        b"PK\x03\x04",
        good.replace(b"NUMPY", b"NUMPX"),
    ):
        path.write_bytes(data)
        unread("cannot be read as npz|not an array", path, {"x": "x"})
    np.save(tmp_path / "bad.npy", T)
    (tmp_path / "bad.npy").rename(path)
    unread("cannot be read as npz", path, {"x": "x"})
    with zipfile.ZipFile(path, "w") as z:
        z.writestr("x.txt", "hello")
    unread("not an array", path, {"x": "x"})


# -- arguments and texts


@pytest.mark.parametrize(
    "change, message",
    [
        ({"columns": {}}, "columns must map"),
        ({"columns": "x=x"}, "columns = .* must be a dict"),
        ({"columns": {"x": 3}}, "columns must map names to texts"),
        ({"columns": {"x": "x", "contact": "touch"}}, "use contact='touch'"),
        ({"where": "trial=1"}, "where = .* must be a dict"),
        ({"where": {"trial": [1]}}, "where must map"),
        ({"contact": 1.0}, "contact = 1.0 must be"),
        ({"reports": "sometimes"}, "reports = 'sometimes' must be one of"),
        ({"max_speed": 0}, "max_speed must be"),
        ({"max_speed": float("nan")}, "max_speed = nan is not finite"),
        ({"max_speed": {"x": -1.0}}, "max_speed must be"),
        ({"max_speed": {"y": 1.0}}, "columns has no input 'y'; it has x"),
        ({"max_speed": True}, "max_speed = True must be"),
        ({"max_gap": "long"}, "max_gap = 'long' must be"),
        ({"max_gap": float("inf")}, "max_gap = inf is not finite"),
        ({"sha256": "1234567"}, "sha256 must be"),
        ({"sha256": 5}, "sha256 = 5 must be a text"),
        ({"time": "2"}, "time: cannot read"),
        ({"lifted": {"y": "zero"}}, "lifted: columns has no input 'y'; it has x"),
        ({"lifted": {"x": "up"}}, "lifted = .* one of hold, zero"),
    ],
)
def test_arguments_out_of_range(csv, change, message):
    refused(BadValue, message, recording, csv(**steady()), **{"columns": {"x": "x"}} | change)


def test_texts_of_the_command_line():
    assert parse_map(["x=force_N*5e-4", "y='a=b'*2"]) == {"x": "force_N*5e-4", "y": "'a=b'*2"}
    assert parse_where(" grasp = pinch,trial=1") == {"grasp": "pinch", "trial": "1"}
    for bad in ([""], ["x"], ["=x"], ["x="], ["x=a", "x=b"], "x=a"):
        refused(BadValue, "map", parse_map, bad)
    for text in ("", "grasp", "grasp=", "a=1,,b=2", "a=1,a=2"):
        refused(BadValue, "where", parse_where, text)


def test_errors_are_stimlibs_own():
    assert issubclass(RecordingError, BadValue) and issubclass(RecordingError, StimlibError)


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
    assert (
        len(r.info["lifts"]) == lifts
        and r.has_lifts == bool(lifts)
        and r.info["jumps"] == []
        and r.info["repeats"] == 0
    )
    t = times(r)
    for column in columns:
        check_speed(r, DATA / name, column, 1.0)
        whole = r.motion[column](t)
        parts = [r.motion[column](t[i : i + 997]) for i in range(0, len(t), 997)]
        assert np.array_equal(np.concatenate(parts), whole)
        held = np.interp(t, *reports_of(r, column))
        # near the straight lines between the reports
        assert np.abs(whole - held)[r.contact(t) > 0].max() < 0.003


def reports_of(r: Recording, column: str) -> tuple[np.ndarray, np.ndarray]:
    knots = r.motion[column]._knots
    return knots, r.motion[column](knots)


@needs_data
def test_the_hand_does_not_stop_where_one_report_is_missing():
    """A quarter of the puck's intervals are two periods long, in the middle of its
    motion.
    """
    path = DATA / TOUCH / "hand_puck_tablet.csv"
    a, b = (recording(path, {"x": "x_mm*1e-3"}, reports=how) for how in ("always", "on_change"))
    assert np.array_equal(a.motion["x"](times(a)), b.motion["x"](times(a)))


@needs_data
def test_pchip_has_the_speed_of_the_hand_and_holding_has_spikes():
    r = recording(DATA / TOUCH / "hand_puck_tablet.csv", {"x": "x_mm*1e-3"})
    t = np.arange(0, r.duration, 1 / FS)
    knots, x = reports_of(r, "x")
    hand = np.abs(np.diff(x) / np.diff(knots)).max()
    spikes = np.abs(np.diff(x[np.searchsorted(knots, t, side="right") - 1])).max() * FS
    assert np.abs(np.diff(r.motion["x"](t))).max() * FS < 1.5 * hand < spikes / 10


@needs_data
def test_what_real_files_ask_for():
    trials = DATA / "grip-trials/grip_p1.csv"
    unread(
        r"row 296: time goes back .*grasp \(pinch, power\), level \(.*\), trial \(1, 2, 3,"
        r" 4, 5\)",
        trials,
        {"x": "force_N*5e-4"},
    )
    unread(
        "faster than a hand .*check the unit in the mapping of x",
        DATA / TOUCH / "hand_puck_tablet.csv",
        {"x": "x_mm"},
    )
    with pytest.raises(
        BadValue, match=r"a lift at row 118 \(4 in all\).*use squeeze\(contact=True\)"
    ):
        touch = recording(DATA / TOUCH / "finger_touchpad_horizontal.csv", {"x": "x_raw*2e-5"})
        touch.motion_for(["x1", "x2"], "use squeeze(contact=True)")
    unread(
        'a gap of .*reports="on_change"',
        DATA / TOUCH / "stylus_slow_pressure_ramp.csv",
        {"x": "x_mm*1e-3"},
        contact=False,
    )


@needs_data
def test_a_grip_drives_the_squeeze():
    from stimlib.scenes import squeeze

    r = recording(
        DATA / "grip-trials/grip_p1.csv",
        {"x": "force_N*5e-4"},
        where=parse_where("grasp=pinch,level=easy,trial=1"),
    )
    made = squeeze(A=0.0)
    y = stimlib.render(made, r.motion_for(made.inputs), FS, seconds=r.duration, target="python")
    assert np.array_equal(y["force1"], y["force2"])
    assert_allclose(y["force1"], 2000 * r.motion["x"](y.t), rtol=1e-12)


@pytest.mark.parametrize("more", [{}, {"max_gap": 1.0}])
def test_a_period_that_no_clock_has_is_refused(csv, more):
    unread(
        "4.94066e-324 s from report to report, which no clock gives; write the column",
        csv("t_s,x\n0,0\n5e-324,1\n1e-323,2\n"),
        {"x": "x"},
        **more,
    )
