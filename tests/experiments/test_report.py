"""Tables of answers, and the page: whole, self-contained, the same for the same
answers, with what is wrong told.
"""

import dataclasses as dc
import re
import sys
from functools import partial

import numpy as np
import pytest
from experiments.some import experiment
from matplotlib.figure import Figure
from refusals import refused

from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    PsychometricObserver,
    fitted,
    grouped,
    plain,
    psychometric,
    repeated,
    report,
    simulate,
    to_pandas,
    wilson,
    write_report,
)


@pytest.fixture(scope="module")
def answers():
    columns = simulate(experiment(), PsychometricObserver(2.34, 0.3), 2)
    more = {"participant": "P<03>", "number": 1, "condition": "silent", "track": "high"}
    for level in (1.0, 2.0, 3.0):  # who felt every difference
        row = more | {"level": level, "outcome": float(level > 2)}
        for name, column in columns.items():
            column.append(row.get(name))
    return columns


def test_the_page_is_whole_and_tells_what_is_wrong(answers, tmp_path):
    fits = fitted(answers)
    assert list(fits) == [(who, "silent") for who in ("P01", "P02", "P<03>")]
    own = grouped(answers, ["participant"])[("P02",)]
    assert repr(fits["P02", "silent"]) == repr(psychometric(own["level"], own["outcome"]))
    tables = {"Found": [wilson(3, 4)], "ANOVA": repeated([[1.0, 2.0], [2.0, 2.5]])}
    told = {"fits": fits, "tables": tables, "notes": ["<as printed>"], "unit": "N/mm"}
    first, again, bare = (tmp_path / name for name in ("a.html", "b.html", "c.html"))
    for path in (first, again):
        write_report(path, "A & B", "First.\n\nSecond.", answers, **told)
    page = first.read_text("utf-8")
    assert page == again.read_text("utf-8")
    asked = [answers["participant"].count(who) for who in ("P01", "P02")]
    for text in (
        "<h1>A &amp; B</h1>",
        "<p>First.</p><p>Second.</p>",
        "&lt;as printed&gt;",
        "P&lt;03&gt; silent: no level has both answers",
        f"{fits['P01', 'silent'].pse:.4g}",
        "0.75",
        "level / N/mm",
        f"{sum(asked) + 3}; of a participant 3 to {max(asked)}",
        "<li>Some answers are simulated: an observer model gave them, and no participant.</li>",
        "<li>silent: no PSE could be fitted.</li>",
        "<li>Left out: P&lt;03&gt; silent: no level",
    ):
        assert text in page
    assert "P<03>" not in page and page.count("<svg") == 3 and page.count("<h2>") == 10
    assert not re.search(r"<script|(?:src|href)=\"http", page)
    empty = {name: [""] * len(answers["track"]) for name in ("track", "simulated")}
    write_report(bare, "None", "", answers | empty)
    assert "<svg" not in bare.read_text("utf-8") and "are simulated" not in bare.read_text("utf-8")


def drawings(monkeypatch):
    """The drawings of a page, in their order, as they are asked for."""
    drawn = []
    monkeypatch.setattr(report, "svg", lambda draw, size: drawn.append(draw) or "")
    return drawn


def axes_of(draw):
    draw(figure := Figure())
    return figure.axes[0]


def test_pictures_show_proportions_their_curve_and_the_tracks(monkeypatch, tmp_path):
    drawn = drawings(monkeypatch)
    at, asked, yes = [-2, -1, 0, 1, 2], [4, 8, 8, 8, 4], [0, 2, 4, 6, 4]
    rows = {name: [name[0]] * 32 for name in ("participant", "condition", "track")}
    rows |= {"level": np.repeat(at, asked).tolist(), "number": list(range(1, 33))}
    rows["outcome"] = [k < y for n, y in zip(asked, yes, strict=True) for k in range(n)]
    (fit,) = fitted(rows).values()
    fits = {("p", "c"): dc.replace(fit, pse_interval=(-np.inf, 1.0))}
    write_report(tmp_path / "a.html", "", "", rows, fits=fits)
    page = (tmp_path / "a.html").read_text("utf-8")
    assert f"<li>c: PSE {fit.pse:.3g}, 95 % interval -inf to 1 (1 of 1 fits).</li>" in page
    assert "half-way up, where 50 % of the answers say yes, or more.</li>" in page
    first, second, third = map(axes_of, drawn)
    (points,), (curve, interval), (track,) = first.collections, first.lines, third.lines
    shown = np.column_stack([at, np.divide(yes, asked)])
    assert np.ma.getdata(points.get_offsets()).tolist() == shown.tolist()
    x, y = curve.get_data()
    assert (x[0], x[-1]) == (-2, 2) and y == pytest.approx(fit(x))
    assert list(interval.get_xdata()) == [-2, 1]
    assert [list(v) for v in track.get_data()] == [rows["number"], rows["level"]]
    residual, low, high = second.lines  # of stretches of 4 and 3 trials
    p, said = fit(rows["level"]), np.array(rows["outcome"])
    first, last = (
        (said[k] - p[k]).sum() / np.sqrt((p[k] * (1 - p[k])).sum())
        for k in (slice(4), slice(-3, None))
    )
    at, sums = residual.get_data()
    assert (len(at), at[0], at[-1]) == (10, 2.5, 31)
    assert [sums[0], sums[-1]] == pytest.approx([first, last])
    assert [*low.get_ydata(), *high.get_ydata()] == [-1.96, -1.96, 1.96, 1.96]
    two = {"session": [1] * 16 + [2] * 16, "number": [*range(1, 17)] * 2}
    write_report(tmp_path / "a.html", "", "", rows | two, fits=fits)
    assert axes_of(drawn[4]).lines[0].get_ydata().tolist() == sums.tolist()
    assert [line.get_xdata()[0] for line in axes_of(drawn[5]).lines] == [1, 1]


@pytest.mark.parametrize(
    ("guess", "label", "drawn"),
    [
        (0.5, "proportion correct", "proportion correct"),
        (None, "proportion of more", "proportion of yes"),
    ],
)
def test_curves_of_a_detection_are_proportions_correct(guess, label, drawn, tmp_path):
    rows = {"participant": ["P01"] * 60, "condition": ["a"] * 60, "track": [""] * 60}
    rows |= {"number": list(range(1, 61)), "level": [1.0, 2.0, 3.0] * 20}
    rows["outcome"] = [1, 1, 1] * 10 + [0, 1, 1] * 9 + [0, 0, 1]
    fits = fitted(rows, guess=guess, lapse=0.02, interval="none")
    assert fits["P01", "a"].plot().axes[0].get_ylabel() == drawn
    write_report(tmp_path / "page.html", "Tones", "2IFC.", rows, fits=fits)
    text = (tmp_path / "page.html").read_text("utf-8")
    assert re.findall("proportion correct|proportion of more", text)[0] == label


@pytest.mark.filterwarnings("error")
def test_residuals_of_a_curve_that_has_reached_1_are_0(tmp_path, monkeypatch):
    drawn, level = drawings(monkeypatch), [2.0] * 10 + [2.05] * 10 + [2.1] * 10 + [50.0] * 100
    rows = {"level": level, "outcome": [0] * 8 + [1, 1] + [0, 1] * 5 + [1] * 110}
    rows |= {"number": list(range(130))}
    rows |= {name: [""] * 130 for name in ("participant", "condition", "track")}
    write_report(tmp_path / "a.html", "t", "m", rows, fits=fitted(rows))
    sums = axes_of(drawn[1]).lines[0].get_ydata()
    assert abs(sums[-5:]).max() < 1e-6 and np.isfinite(sums).all()
    rows["number"] = ["x"] * 130
    write_report(tmp_path / "a.html", "t", "m", rows, fits=fitted(rows))
    refused(BadValue, "number must be rows of numbers", drawn[-1], Figure())


def test_results_are_tables(monkeypatch):
    parts = {("P1", "a"): wilson(1, 4), ("P1", "b"): wilson(3, 4)}
    one = to_pandas(parts, ["who", "condition"])
    assert list(one.columns) == ["who", "condition", "value", "low", "high", "k", "n"]
    assert list(one["k"]) == [1, 3]
    fit = psychometric([1, 2, 3, 4], [1, 4, 15, 19], [20] * 4, interval="none")
    (row,) = plain([fit])
    assert (row["slope"], row["intercept"], row["jnd"]) == (fit.slope, fit.intercept, fit.jnd)
    assert list(grouped({"b": [2, 1], "a": ["x", "y"]}, ["b", "a"])) == [(2, "x"), (1, "y")]
    monkeypatch.setitem(sys.modules, "pandas", None)
    refused(ImportError, r"stimlib\[experiments\]", to_pandas, parts)


def test_hostile_names_and_levels_make_a_page(tmp_path):
    """Tags, a formula that is none, control characters, half a character; levels that
    no logarithm takes.
    """
    who, path = "<script>x</script>$\\frac{\x00\ud800\u202e", tmp_path / "a.html"
    rows = {"participant": [who] * 8, "condition": ["]]>"] * 8, "track": ["<b>$_"] * 8}
    rows |= {who: [who] * 8, "number": list(range(8)), "level": [-3.0, 1.0, 0.0, 1.0] * 2}
    rows["outcome"] = [0, 1, 1, 1, 0, 0, 1, 1]
    by = [who, "condition"]
    fits = fitted(rows, by, interval="none")
    told = {"fits": fits, "by": by, "tables": {who: fits.values()}, "notes": [who], "unit": who}
    write_report(path, who, who, rows, **told)
    page = path.read_bytes().decode()
    assert not re.search("<script|<b>|\x00|\u202e", page)
    assert page.count("&lt;script&gt;x&lt;/script&gt;$\\frac{") >= 6 and page.count("<svg") == 3
    assert re.findall(r'id="(\w+tick_\d+)"', page)


def test_what_does_not_fit_is_refused(answers, tmp_path):
    fits, page = fitted(answers, interval="none"), partial(write_report, tmp_path / "a", "", "")
    untracked = {k: v for k, v in answers.items() if k != "track"}
    for call, why in (
        (lambda: grouped(answers, ["person"]), "no column 'person'; there are participant"),
        (lambda: fitted({"participant": [], "condition": [], "level": []}), "'outcome'"),
        (lambda: grouped({"who": ["a", "b"], "level": [1]}, ["who"]), "level 1"),
        (lambda: grouped(answers, "participant"), "by = 'participant' must be a list"),
        (lambda: plain(fits, ["participant"]), "a name for each"),
        (lambda: page(untracked), "no column 'track'"),
        (lambda: page(answers, fits=fits, by=["participant"]), r"a fit of \('P01', 'silent'\)"),
    ):
        refused((BadValue, UnknownName), why, call)
    assert not list(tmp_path.iterdir())
