"""Clocks and gaps of recordings: wraps, steps back, drift, jitter and missing numbers,
each by itself and injected into real recordings.
"""

import numpy as np
import pytest
from hands import DATA
from refusals import refused
from written import written

from stimlib.errors import RecordingError
from stimlib.motion import parse_source, parse_where, recording

T = np.arange(400) * 0.004
X = 0.01 * np.sin(5 * T)
COUNTS = {"t_us": 2**32 - 800_000 + 4000 * np.arange(400), "x": X}
US = {"time": "t_us*1e-6"}


def table(t, x=X, **more):
    return {"t_s": t, "x": x, **more}


def error_of(r, t=T, x=X):
    """The largest error of the position between the first and the last report."""
    at = np.linspace(t[0], t[-1], 20_001)
    return np.abs(
        r.motion["x"](at - t[0]) - recording(table(t, x), {"x": "x"}).motion["x"](at - t[0])
    ).max()


# -- wraps


def test_a_row_that_comes_too_late_in_a_short_recording_is_no_wrap():
    short = {"t_s": [0.0, 0.02, 0.01, 0.03], "x": [0.0, 0.2, 0.1, 0.3]}
    refused(RecordingError, "put the rows into the order of time", recording, short, {"x": "x"})


@pytest.mark.parametrize(
    ("size", "unit"),
    [(n, unit) for n in (2**16, 2**24, 2**32) for unit in (1e-6, 1e-3)]
    + [(65.536, 1), (10**7, 1e-6), (0.5, 1)],
)
def test_a_clock_that_wraps_is_recognised_and_unwrapped(size, unit):
    step = 0.004 / unit if unit > 1e-6 or size > 2**16 else 40
    n = np.arange(400)
    counts = size - 20.5 * step + step * n
    counts = counts if unit == 1 else np.round(counts)
    wrapped = {"t": counts % size, "x": X}
    how = {"time": f"t*{unit}", "max_speed": None}
    says = rf"say wrap={size:.12g}$" if size not in (10**7, 0.5) else "if the clock was set back"
    refused(RecordingError, says, recording, wrapped, {"x": "x"}, **how)
    r = recording(wrapped, {"x": "x"}, wrap=size, **how)
    assert r.info["clock"] == {"wraps": int(counts[-1] // size)} and " of the clock)" in str(r)
    assert r.motion["x"]._knots == pytest.approx((counts - counts[0]) * unit, rel=1e-9, abs=1e-9)
    assert f"wrap={size}" in repr(r)


@pytest.mark.parametrize(
    ("t", "how", "says"),
    [
        (COUNTS["t_us"], {"wrap": 65536}, "row 399, .* span 1596000, more than wrap = 65536"),
        (COUNTS["t_us"], {"wrap": 1595000}, "span 1596000, more than wrap = 1595000"),
        (np.where(T > 0.801, T - 0.604, T) * 1e6, {"wrap": 1.7e6}, "goes back from 0.8 to 0.2"),
    ],
)
def test_a_wrap_that_is_none_is_refused(t, how, says):
    refused(RecordingError, says, recording, {"t_us": t, "x": X}, {"x": "x"}, **US, **how)


@pytest.mark.parametrize("late", [[4, 3, 5], [2, 4, 3, 5], [1, 2, 4, 5, 3, 6]])
@pytest.mark.parametrize("reports", ["always", "on_change"])
def test_a_row_from_before_the_wrap_that_comes_too_late_is_refused(late, reports):
    """Of 4 rows before the wrap; it was taken for two wraps, 65 s apart."""
    order = [*late, *range(max(late) + 1, 400)]
    given = {"ms": (65496 + 10 * np.array(order)) % 65536, "x": np.zeros(len(order))}
    how = {"time": "ms*1e-3", "wrap": 65536, "reports": reports}
    refused(RecordingError, "that comes too late", recording, given, {"x": "x"}, **how)


# -- steps back


def test_a_clock_that_was_set_back_is_told_from_rows_out_of_order():
    """Sorted, the rows of a clock set back, by two rows or by 16, would be a zigzag."""
    for by, to in ((0.01, "0.794"), (0.064, "0.74")):
        back = np.where(T > 0.801, T - by, T)
        says = f"row 201: time goes back from 0.8 to {to} s; if the clock was set back, say rate="
        # a column of many values does not say which recording a row is of
        refused(RecordingError, says, recording, table(back, n=T), {"x": "x"})
    order = np.arange(400)
    order[[100, 101, 300, 302]] = order[[101, 100, 302, 300]]
    says = "3 of 400 rows come too late; put the rows into the order of time"
    refused(RecordingError, says, recording, table(T[order], X[order]), {"x": "x"})
    for more, says in ((0.025, "say wrap=65536"), (0.035, "if another recording begins here")):
        late = np.append(T[:16], (T[16:] + more) % 65.536e-3) * 1e6  # of half a wrap at most
        refused(RecordingError, says, recording, {"t_us": late, "x": X}, {"x": "x"}, **US)
        if more < 0.03:
            r = recording({"t_us": late, "x": X}, {"x": "x"}, wrap=65536, **US)
            assert r.duration == pytest.approx(T[-1] + more)
    says = "if another recording begins here"
    for other in (T[:200], T[:200] - 64.0):  # or a wrap of milliseconds with 0.7 s lost
        refused(RecordingError, says, recording, table(np.append(T[:200], other)), {"x": "x"})
    r = recording(table(back), {"x": "x"}, rate=250)
    assert r.info["clock"]["set_back"] == [(201, pytest.approx(-0.06))]
    assert "clock set back in 1 row" in str(r) and error_of(r) < 1e-9


# -- jitter and drift


def jittered(t, size=2e-3, seed=1):
    return t + size * np.random.default_rng(seed).random(len(t))


def test_an_even_rate_is_fitted_to_the_stamps():
    true = T * (1 + 2e-3)  # the device is slow: 249.5 Hz
    r = recording(table(jittered(true)), {"x": "x"}, rate=250)
    c = r.info["clock"]
    assert c["rate"] == pytest.approx(250 / 1.002, rel=2e-4) and c["set_back"] == []
    assert c["drift"] == pytest.approx(-2e-3, abs=2e-4)
    assert 4e-4 < c["residual_rms"] < 7e-4 and c["residual_max"] < 1.2e-3
    assert (
        "times fitted: drift -1915 ppm, residual 0.00057 s rms" in str(r)
        and error_of(r, true) < 3e-5
    )
    for size in (5e-3, 3e-2):  # stamps go back, and the next rows make it good
        back = jittered(T, size)
        c = recording(table(back), {"x": "x"}, rate=250).info["clock"]
        assert (np.diff(back) < 0).any() and c["set_back"] == [] and abs(c["drift"]) < size / 5
        c = recording(table(back - 0.1 * (T > 0.801)), {"x": "x"}, rate=250).info["clock"]
        assert 201 in [row for row, _ in c["set_back"]] and abs(c["drift"]) < size / 5
    for period, gap in ((0.004, 0.15), (0.02, 0.25)):  # more than 10 periods and 0.1 s
        even, how = np.arange(400) * period, {"columns": {"x": "x"}, "rate": 1 / period}
        silent, short = (jittered(even + s * (even >= 200 * period)) for s in (gap, 0.09))
        r = recording(table(silent), reports="on_change", **how)
        assert np.ptp(r.motion["x"]._knots[[199, 201]]) == pytest.approx(gap + period, abs=6e-4)
        refused(RecordingError, "a file that lacks rows", recording, table(short), **how)
    # rows without a time are left out, and have come
    given = table(lost(jittered(T), *range(100, 109), 250))
    r = recording(given, {"x": "x"}, rate=250, missing="interpolate")
    assert error_of(r) < 3e-5 and r.info["reports"] == 390
    # rows without anything, such as those that part trials in a spreadsheet, have not
    parted = table(np.insert(jittered(T), [150] * 3, np.nan), np.insert(X, [150] * 3, np.nan))
    r = recording(parted, {"x": "x"}, rate=250, missing="interpolate")
    assert error_of(r) < 3e-5 and r.info["reports"] == 400
    coarse = np.floor(T * 50) / 50  # five rows in each packet
    refused(RecordingError, "repeats=", recording, table(coarse), {"x": "x"})
    r = recording(table(coarse), {"x": "x"}, rate=250)
    assert error_of(r) < 3e-5 and r.info["clock"]["set_back"] == []


def test_a_second_clock_gives_the_times_and_the_first_the_rate():
    device = 7.0 + T * (1 - 50e-6)
    for stamps in (jittered(T), jittered(T, 0.02)):  # whose order is lost
        r = recording(table(stamps, us=device * 1e6), {"x": "x"}, clock="us*1e-6")
        c = r.info["clock"]
        size = 0.02 if stamps.max() > T[-1] + 0.003 else 2e-3
        assert c["residual_rms"] == pytest.approx(size / 12**0.5, rel=0.1)
        assert abs(c["drift"] - 50e-6) < size * 0.2 and error_of(r) < size * 5e-3
    wrapped = (device * 1e6 + 2**32 - 7.8e6) % 2**32
    r = recording(table(T, us=wrapped), {"x": "x"}, clock="us*1e-6", wrap=2**32)
    assert r.info["clock"]["wraps"] == 1 and error_of(r) < 1e-9
    assert r.info["clock"]["residual_max"] < 1e-9
    given = table(T, us=lost(device * 1e6, 7))
    assert recording(given, {"x": "x"}, clock="us*1e-6", missing="hold").info["reports"] == 399
    early = table(T - 0.05 * (T == T[200]), us=device * 1e6)
    c = recording(early, {"x": "x"}, clock="us*1e-6").info["clock"]
    assert c["residual_max"] == pytest.approx(0.05, rel=0.01)
    assert "wrap=4294967296, clock='us*1e-6'" in repr(r)


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({"rate": 253.0}, "the rows come at 250 Hz, not 253 Hz; correct rate"),
        ({"clock": "us"}, "1 s of clock is 1e-06 s of time; check the units"),
        ({"clock": "same"}, "row 0: clock has one time"),
        ({"clock": "-us*1e-6"}, "time goes back"),
        ({"clock": "none"}, "clock needs column none"),
        ({"time": "back", "rate": 250.0}, "time goes back in most rows; reverse them"),
        ({"time": "lost", "missing": "gap", "rate": 250.0}, "no row has a time; use another"),
        ({"time": "lost", "missing": "gap", "wrap": 9.0}, "no row has a time"),
        ({"time": "lost", "missing": "gap", "clock": "t_s"}, "no row has a time"),
    ],
)
def test_clocks_that_are_refused(how, says):
    given = table(T, us=T * 1e6, same=np.ones(400), back=-T, lost=T * np.nan)
    refused(RecordingError, says, recording, given, {"x": "x"}, **how)


# -- missing numbers


def lost(x, *rows, by=np.nan):
    x = np.array(x, dtype=object if isinstance(by, str) else float)
    x[list(rows)] = by
    return x


@pytest.mark.parametrize(
    ("by", "sentinels"),
    [(np.nan, ()), ("", ()), ("n/a", ()), ("NA", ()), (-9999, (-9999,)), (".", (".",)),
        ("-9999", ("-9999",)), ("LOST", (-1, "LOST")),
        (np.inf, (np.inf, np.nan))],
)  # fmt: skip
@pytest.mark.parametrize("how", ["gap", "hold", "interpolate"])
def test_a_missing_number_is_no_contact_or_bridged(tmp_path, by, sentinels, how):
    x = lost(X, 0, 100, 101, 399, by=by)
    path = written(
        tmp_path / "log.csv", "t_s,x\n" + "".join(f"{t},{v}\n" for t, v in zip(T, x, strict=True))
    )
    given = {"missing": how, "sentinels": sentinels}
    for source, first in ((table(T, x), 0), (path, 2)):
        says = f"row {first}, column x: .*missing="
        refused(RecordingError, says, recording, source, {"x": "x"}, sentinels=sentinels)
        r = recording(source, {"x": "x"}, **given)
        assert repr(parse_source(repr(r))) == repr(r) if first else True
        done = {"gap": "no contact", "hold": "held"}.get(how, "interpolated")
        assert f"x: 4 missing numbers, {done}" in str(r)
        assert r.info["jumps"] == [] and r.duration == T[-1]
        assert r.has_lifts == (how == "gap")
        at = np.array([0.0, 0.396, 0.398, 0.402, 0.409, 1.59])
        assert r.contact(at).tolist() == ([0, 0, 0, 0, 1, 1] if how == "gap" else [1] * 6)
        value = r.motion["x"](0.402)
        wanted = X[99] if how != "interpolate" else np.interp(0.402, T[[99, 102]], X[[99, 102]])
        assert value == pytest.approx(wanted, abs=5e-6)
        assert r.motion["x"](T[[99, 102]]) == pytest.approx(X[[99, 102]])
        assert r.motion["x"](T[[0, 399]]) == pytest.approx(X[[1, 398]])  # held, not beyond


@pytest.mark.parametrize("how", ["hold", "interpolate"])
def test_a_gap_is_bridged_up_to_its_longest_length(how):
    given = table(T, lost(X, *range(100, 150)))
    says = (
        'row 100: x is missing for 0.204 s, longer than 0.1 s; say missing="gap", or max_gap=0.2042'
    )
    refused(RecordingError, says, recording, given, {"x": "x"}, missing=how)
    for rows in (range(50), range(350, 400)):  # before the first number, and after the last
        end = table(T, lost(X, *rows))
        refused(RecordingError, "max_gap=0.2002", recording, end, {"x": "x"}, missing=how)
    r = recording(given, {"x": "x"}, missing=how, max_gap=0.204)
    assert "0.204 s at most" in str(r) and not r.has_lifts
    assert recording(given, {"x": "x"}, missing="gap").contact([0.39, 0.5, 0.6]).tolist() == [
        1,
        0,
        1,
    ]
    off = given | {"contact": np.where((T > 0.39) & (T < 0.61), 0, 1)}  # where it does not matter
    assert recording(off, {"x": "x"}, missing=how).has_lifts
    # numbers off contact are not of a touch: at its ends its own hold
    on = ~np.isin(np.arange(400), [90, 91, 97, 98, 105, 106, 112, 113])
    x = lost(np.where(on, X, 9.0), 92, 96, 107, *range(99, 105), 109)
    r = recording(table(T, x) | {"contact": on}, {"x": "x"}, missing=how)
    wanted = X[[93, 95, 108, 109 if how == "interpolate" else 108]]
    assert r.motion["x"](T[[92, 96, 107, 109]] + 1e-9) == pytest.approx(wanted, abs=1e-5)
    assert r.contact(T[[95, 101, 107]]).tolist() == [1, 0, 1] and "no contact in 6 rep" in str(r)


def test_two_columns_at_two_rates_in_one_file(tmp_path):
    """A force at 50 Hz in rows at 250 Hz, or in rows of its own at the same times."""
    force = 2 + np.sin(3 * T)
    slow = np.where(np.arange(400) % 5 == 0, force, np.nan)
    columns = {"x": "x", "f": "f"}
    wanted = recording({"t_s": T[::5], "f": force[::5]}, {"f": "f"}, max_speed=None)
    how = {"missing": "interpolate", "max_speed": {"x": 1.0}}
    at = np.linspace(0, T[395], 5001)
    one = recording(table(T, f=slow), columns, **how)
    path = tmp_path / "long.tsv"
    rows = [(t, x, "") for t, x in zip(T, X, strict=True)]
    rows += [(t, "", f) for t, f in zip(T[::5], force[::5], strict=True)]
    path.write_text(
        "t_s\tx\tf\n" + "".join(f"{t}\t{x}\t{f}\n" for t, x, f in sorted(rows, key=lambda r: r[0]))
    )
    for r in (one, recording(path, columns, **how)):
        assert np.array_equal(r.motion["x"](at), recording(table(T), {"x": "x"}).motion["x"](at))
        assert np.abs(r.motion["f"](at) - wanted.motion["f"](at)).max() < 1e-4
        assert r.motion["f"](T[:396:5]) == pytest.approx(force[:396:5])


def test_a_row_without_a_time_or_contact(tmp_path):
    path = written(
        tmp_path / "log.csv",
        "t_s,x,contact\n0,0,1\n,,\n0.01,1,\n0.02,2,0\n0.03,3,\n0.04,4,1\n0.05,5,1\n",
    )
    r = recording(path, {"x": "x*1e-3"}, missing="hold")
    assert r.info["reports"] == 6 and "1 row without a time left out" in str(r)
    assert r.info["lifts"] == [(5, 0.02)] and r.contact([0.005, 0.025, 0.035, 0.045]).tolist() == [
        1,
        0,
        0,
        1,
    ]
    r = recording(path, {"x": "x*1e-3"}, missing="gap")
    assert [row for row, _ in r.info["lifts"]] == [4]
    refused(
        RecordingError,
        "no number for x",
        recording,
        table(T, lost(X, *range(400))),
        {"x": "x"},
        missing="hold",
    )


def test_missing_numbers_in_every_row_and_in_equal_rows():
    """Two inputs that are never there together; and what is merged as one report."""
    even = np.arange(0, 400, 2)
    given = table(T, lost(X, *even), y=lost(X, *even + 1))
    columns = {"x": "x", "y": "y"}
    says = "a number is missing in every row"
    refused(RecordingError, says, recording, given, columns, missing="gap")
    t = np.insert(T, 100, T[100])
    given = table(t, lost(np.insert(X, 100, X[100]), 100, 101), contact=np.arange(401) > 0)
    assert recording(given, {"x": "x"}, missing="hold").info["repeats"] == 1


@pytest.mark.parametrize(
    ("repeats", "every", "x"),
    [
        ("spread", 0.01, [0, 1, 2, 3, 4, 5, 6, 7, 7]),
        ("mean", 0.03, [1, 4, 7]),
        ("last", 0.03, [2, 5, 7]),
    ],
)
def test_missing_numbers_among_rows_of_one_time(repeats, every, x):
    rows = lost(np.arange(9), 1, 4, 6, 8)
    given = table(np.repeat([0.0, 0.03, 0.06], 3), rows)
    how = {"repeats": repeats, "missing": "interpolate", "max_speed": None}
    r = recording(given, {"x": "x"}, **how)
    assert r.motion["x"](every * np.arange(len(x))) == pytest.approx(x)


def test_what_a_missing_number_is_not(tmp_path):
    for word in "NaN -nan NULL None <NA> #NA #N/A --".split():
        r = recording(table(T, lost(X, 7, by=word)), {"x": "x"}, missing="hold")
        assert "x: 1 missing numbers" in str(r)
    for value, says in (
        ("inf", "inf is not finite"),
        ("lost", "'lost' is not a number.*sentinels=\\('lost',"),
    ):
        given = table(T, lost(X, 7, by=value))
        refused(
            RecordingError, f"row 7, column x: {says}", recording, given, {"x": "x"}, missing="gap"
        )
    negative = table(T, lost(X, 7, by=-1))
    refused(
        RecordingError,
        "row 7, column x: the result is nan for x = -1",
        recording,
        negative,
        {"x": "sqrt(x + 0.5)"},
        missing="gap",
    )


def test_sentinels_in_single_precision_and_of_decimal_commas_are_found(tmp_path):
    single = np.where(T == T[7], -9.9, 0.5).astype(np.float32)
    path = written(
        tmp_path / "log.csv",
        "t_s;x\n" + "".join(f"0,{i};{-9 if i == 7 else 1},9\n" for i in range(1, 10)),
    )
    for given, sentinel in ((table(T, single), -9.9), (path, "-9,9"), (path, -9.9)):
        r = recording(given, {"x": "x"}, missing="hold", sentinels=(sentinel,), max_gap=1)
        assert "x: 1 missing numbers" in str(r)
    r = recording(table(T, X * 0), {"x": "x"}, missing="hold", sentinels=(1e-60, -1e300))
    assert "missing" not in str(r)


@pytest.mark.parametrize("sentinel", [0, "0"])
@pytest.mark.parametrize("texts", [False, True])
def test_no_contact_is_no_missing_contact_nor_0_s_a_missing_time(sentinel, texts):
    touch = np.array([1, 1, 0, 1])
    given = {"t_s": [0.0, 0.1, 0.2, 0.3], "x": [1, "" if texts else 0, 2, 3], "contact": touch}
    given = {name: [str(v) for v in values] for name, values in given.items()} if texts else given
    r = recording(given, {"x": "x"}, missing="hold", sentinels=(sentinel,), max_speed=None)
    assert r.info["lifts"] == [(2, pytest.approx(0.2))] and r.info["reports"] == 4


# -- columns combined


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("hypot(a, b)", np.hypot),
        ("hypot(a, b - a, 3)", lambda a, b: np.sqrt(a**2 + (b - a) ** 2 + 9)),
        (
            "min(a, b, 2) + max(1, a, b, 3)",
            lambda a, b: np.minimum(a, b.clip(max=2)) + np.maximum(b, a.clip(3)),
        ),
        ("b - a", lambda a, b: b - a),
        ("(b - a)*1e-3 + 2", lambda a, b: (b - a) * 1e-3 + 2),
        ("-(a*b)/4", lambda a, b: -(a * b) / 4),
        ("sqrt(a**2 + b**2)", np.hypot),
        ("a/b", lambda a, b: a / b),
        ("abs(a) + max(a, b) - min(a, 'b')", lambda a, b: abs(a) + abs(a - b)),
        ("atan2(b, a)", lambda a, b: np.arctan2(b, a)),
        (
            "b*cos(radians(a)) - sin(radians(a))",
            lambda a, b: b * np.cos(np.radians(a)) - np.sin(np.radians(a)),
        ),
        ("sqrt(2)*a", lambda a, b: 2**0.5 * a),
    ],
)
def test_columns_are_combined(text, wanted):
    rng = np.random.default_rng(0)
    a, b = rng.uniform(-5, 5, 400), rng.uniform(1, 5, 400)
    r = recording({"t_s": T, "a": a, "b": b}, {"x": text}, max_speed=None)
    assert r.motion["x"](T) == pytest.approx(wanted(a, b), rel=1e-12, abs=1e-12)
    assert repr(r.motion["x"]).count(text.replace("'", "\\'")) >= 1 - ("'" in text)


def test_times_of_two_columns():
    given = {"sec": np.floor(T) + 7, "nsec": np.round((T % 1) * 1e9), "x": X}
    r = recording(given, {"x": "x"}, time="sec + nsec*1e-9")
    assert r.motion["x"]._knots == pytest.approx(T, abs=1e-12)


# -- real recordings

REAL = {
    "grip": ("grip-trials/grip_p1.csv", "force_N*5e-4",
        {"where": parse_where("grasp=pinch,level=easy,trial=1")}, 5e-5),
    "puck": ("touch-evemu/hand_puck_tablet.csv", "x_mm*1e-3", {}, 1e-3),
    "force": ("fingertip-force/finger_on_texture_12hz.csv", "fz_N*5e-4", {}, 4e-4),
}  # fmt: skip


def columns_of(name):
    """Times and positions of a real recording, and the error that is stated for it."""
    file, column, how, error = REAL[name]
    if not (DATA / file).is_file():
        pytest.skip("the recordings are not beside the project")
    r = recording(DATA / file, {"x": column}, **how)
    t = r.motion["x"]._knots
    return t, r.motion["x"](t), error


@pytest.mark.parametrize("name", REAL)
def test_wraps_drift_and_gaps_injected_into_a_real_recording(name):
    """Wraps: to a microsecond. Drift against a second clock: to a tenth of a jitter of
    1 ms. Gaps of three reports: within the error stated for each, in m.
    """
    t, x, error = columns_of(name)
    speed = np.abs(np.diff(x) / np.diff(t)).max()
    how = {"columns": {"x": "x"}, "max_gap": 1.0}
    counts = np.round(t * 1e6 + 2**32 - 1e6) % 2**32
    r = recording({"us": counts, "x": x}, time="us*1e-6", wrap=2**32, **how)
    assert r.info["clock"]["wraps"] == 1 and error_of(r, t, x) < 3 * speed * 1e-6
    counts = np.round(t * 1e3 + 65_000) % 2**16
    refused(
        RecordingError, "say wrap=65536$", recording, {"ms": counts, "x": x}, time="ms*1e-3", **how
    )
    r = recording({"ms": counts, "x": x}, time="ms*1e-3", wrap=2**16, **how)
    assert r.info["clock"]["wraps"] == 1 and error_of(r, t, x) < 3 * speed * 1e-3
    stamps = jittered(t, 1e-3)
    r = recording(table(stamps, x, us=t * 1e6 * (1 + 80e-6) + 5e6), clock="us*1e-6", **how)
    apart = t[0] + (r.motion["x"]._knots - t)
    assert np.abs(apart - apart.mean()).max() < 1e-4
    assert abs(r.info["clock"]["drift"] + 80e-6) < 1e-4
    holes = x.copy()
    for at in range(7, len(x) - 4, 40):
        holes[at : at + 3] = np.nan
    r = recording(table(t, holes), missing="interpolate", **how)
    assert error_of(r, t, x) < error
    r = recording(table(t, holes), missing="gap", **how)
    touching = r.contact(t) > 0
    assert np.array_equal(r.motion["x"](t)[touching], x[touching]) and not touching.all()
