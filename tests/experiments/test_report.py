"""Tables of answers, and the page: whole, self-contained, the same for the same
answers, with what is wrong told.
"""

import dataclasses as dc
import re

import numpy as np
import pytest
from experiments.some import experiment
from refusals import refused

from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    Psychometric,
    fitted,
    grouped,
    plain,
    psychometric,
    repeated,
    simulate,
    to_pandas,
    wilson,
    write_report,
)


@pytest.fixture(scope="module")
def answers():
    columns = simulate(experiment(), Psychometric(2.34, 0.3), 2)
    more = {
        "participant": "P<03>",
        "number": 1,
        "condition": "silent",
        "track": "high",
        "outcome": 1.0,
    }
    for level in (1.0, 2.0, 3.0):  # who felt every difference
        row = more | {"level": level, "outcome": float(level > 2)}
        for name, column in columns.items():
            column.append(row.get(name))
    return columns


def test_each_group_is_fitted_by_its_own_answers(answers):
    fits = fitted(answers, interval="none", log=True)
    assert list(fits) == [("P01", "silent"), ("P02", "silent"), ("P<03>", "silent")]
    of = [k for k, who in enumerate(answers["participant"]) if who == "P02"]
    alone = psychometric(
        [answers["level"][k] for k in of],
        [answers["outcome"][k] for k in of],
        interval="none",
        log=True,
    )
    assert repr(fits["P02", "silent"]) == repr(alone)


def test_the_page_is_whole_and_tells_what_is_wrong(answers, tmp_path):
    fits = fitted(answers)
    tables = {"Found": [wilson(3, 4)], "ANOVA": repeated([[1.0, 2.0], [2.0, 2.5]])}
    for name in ("a.html", "b.html"):
        write_report(
            tmp_path / name,
            "A & B",
            "First.\n\nSecond.",
            answers,
            fits=fits,
            tables=tables,
            notes=["<as printed>"],
            unit="N/mm",
        )
    page = (tmp_path / "a.html").read_text()
    assert page == (tmp_path / "b.html").read_text()
    assert (
        "<h1>A &amp; B</h1>" in page
        and "<p>First.</p><p>Second.</p>" in page
        and "&lt;as printed&gt;" in page
    )
    assert "P&lt;03&gt; silent: no level has both answers" in page and "P<03>" not in page
    assert f"{fits['P01', 'silent'].pse:.4g}" in page and "0.75" in page and page.count("<svg") == 3
    assert "level / N/mm" in page and page.count("<h2>") == 8
    asked = [answers["participant"].count(who) for who in ("P01", "P02", "P<03>")]
    assert asked[2] == 3 and f"{sum(asked)}; of a participant 3 to {max(asked)}" in page
    assert not re.search(r"<script|(?:src|href)=\"http", page)
    bare = answers | {name: [""] * len(answers["track"]) for name in ("track", "simulated")}
    write_report(tmp_path / "c.html", "None", "", bare)
    without = (tmp_path / "c.html").read_text()
    assert "<svg" not in without
    assert "simulated, all or some" in page and "simulated, all" not in without


def test_pictures_show_proportions_their_curve_and_the_tracks(monkeypatch, tmp_path):
    from matplotlib.figure import Figure

    drawn = []

    def kept(draw, size):
        draw(figure := Figure())
        drawn.append(figure.axes[0])
        return ""

    monkeypatch.setattr("stimlib.experiments.report.svg", kept)
    at, asked, yes = [-2, -1, 0, 1, 2], [4, 8, 8, 8, 4], [0, 2, 4, 6, 4]
    rows = {
        "level": np.repeat(at, asked).tolist(),
        "outcome": [k < y for n, y in zip(asked, yes, strict=True) for k in range(n)],
    }
    rows |= {
        "participant": ["a"] * 32,
        "condition": ["b"] * 32,
        "track": ["t"] * 32,
        "number": list(range(1, 33)),
    }
    fits = {key: dc.replace(fit, pse_interval=(-np.inf, 1.0)) for key, fit in fitted(rows).items()}
    write_report(tmp_path / "a.html", "", "", rows, fits=fits)
    (points,), (curve, interval), (track,) = drawn[0].collections, drawn[0].lines, drawn[2].lines
    assert np.ma.getdata(points.get_offsets()).tolist() == [
        [-2, 0],
        [-1, 0.25],
        [0, 0.5],
        [1, 0.75],
        [2, 1],
    ]
    x, y = curve.get_data()
    assert (
        (x[0], x[-1]) == (-2, 2)
        and y == pytest.approx(fits["a", "b"](x))
        and list(interval.get_xdata()) == [-2, 1]
    )
    assert [list(v) for v in track.get_data()] == [rows["number"], rows["level"]]
    residual, low, high = drawn[1].lines  # of stretches of 4 and 3 trials
    p, said = fits["a", "b"](rows["level"]), np.array(rows["outcome"])
    first = (said[:4] - p[:4]).sum() / np.sqrt((p[:4] * (1 - p[:4])).sum())
    last = (said[-3:] - p[-3:]).sum() / np.sqrt((p[-3:] * (1 - p[-3:])).sum())
    at, sums = residual.get_data()
    assert (len(at), at[0], at[-1]) == (10, 2.5, 31)
    assert [sums[0], sums[-1]] == pytest.approx([first, last])
    assert [*low.get_ydata(), *high.get_ydata()] == [-1.96, -1.96, 1.96, 1.96]


@pytest.mark.parametrize(
    ("guess", "label"), [(0.5, "proportion correct"), (None, "proportion of more")]
)
def test_curves_of_a_detection_are_proportions_correct(guess, label, tmp_path):
    rows = {"participant": ["P01"] * 60, "condition": ["a"] * 60, "track": [""] * 60}
    rows |= {"number": list(range(1, 61)), "level": [1.0, 2.0, 3.0] * 20}
    rows["outcome"] = [1, 1, 1] * 10 + [0, 1, 1] * 9 + [0, 0, 1]
    fits = fitted(rows, guess=guess, lapse=0.02, interval="none")
    fit = fits["P01", "a"]
    assert fit.guess == (guess or 0.02)
    drawn = "proportion correct" if guess else "proportion of yes"
    assert fit.plot().axes[0].get_ylabel() == drawn
    write_report(tmp_path / "page.html", "Tones", "2IFC.", rows, fits=fits)
    text = (tmp_path / "page.html").read_text()
    assert {name for name in ("proportion correct", "proportion of more") if name in text} == {
        label
    }


@pytest.mark.filterwarnings("error")
def test_residuals_of_a_curve_that_has_reached_1_are_0(tmp_path, monkeypatch):
    from stimlib.experiments import report

    drawn = []
    monkeypatch.setattr(report, "svg", lambda draw, size: drawn.append(draw) or "")
    level = [2.0] * 10 + [2.05] * 10 + [2.1] * 10 + [50.0] * 100
    outcome = [0] * 9 + [1] + [0, 1] * 5 + [1] * 9 + [0] + [1] * 100
    rows = {"level": level, "outcome": outcome, "number": list(range(130))}
    rows |= {name: [""] * 130 for name in ("participant", "condition", "track")}
    write_report(tmp_path / "a.html", "t", "m", rows, fits=fitted(rows))
    figure = pytest.importorskip("matplotlib.figure").Figure()
    drawn[1](figure)
    sums = figure.axes[0].lines[0].get_ydata()
    assert abs(sums[-5:]).max() < 1e-6 and np.isfinite(sums).all()
    rows["number"] = ["x"] * 130
    write_report(tmp_path / "a.html", "t", "m", rows, fits=fitted(rows))
    refused(BadValue, "report: number must be rows of numbers", drawn[-1], figure)


def test_results_are_tables():
    one = to_pandas({("P1", "a"): wilson(1, 4), ("P1", "b"): wilson(3, 4)}, ["who", "condition"])
    assert list(one.columns) == ["who", "condition", "value", "low", "high", "k", "n"] and list(
        one["k"]
    ) == [1, 3]
    fit = psychometric([1, 2, 3, 4], [1, 4, 15, 19], [20] * 4, interval="none")
    assert plain([fit])[0]["slope"] == fit.slope and plain([fit])[0]["jnd"] == fit.jnd
    assert plain([fit])[0]["intercept"] == fit.intercept


def test_what_is_missing_is_said(answers):
    refused(UnknownName, "no column 'person'; there are participant", grouped, answers, ["person"])
    refused(UnknownName, "'outcome'", fitted, {"participant": [], "condition": [], "level": []})
    assert list(grouped({"b": [2, 1], "a": ["x", "y"]}, ["b", "a"])) == [(2, "x"), (1, "y")]
    refused(BadValue, "level 1", grouped, {"who": ["a", "b"], "level": [1]}, ["who"])


@pytest.mark.parametrize("level", [[-3.0, 1.0] * 4, [0.0, 1.0] * 4])
def test_hostile_names_and_levels_make_a_page(level, tmp_path):
    """Tags, a formula that is none, control characters, half a character; levels that
    no logarithm takes.
    """
    who = "<script>x</script>$\\frac{\x00\ud800\u202e"
    rows = {
        "participant": [who] * 8,
        "condition": ["]]>"] * 8,
        "track": ["<b>$_"] * 8,
        "number": list(range(8)),
    }
    rows |= {"level": level, "outcome": [0, 1, 1, 1, 0, 0, 1, 1]}
    rows[who] = rows["participant"]
    fits = fitted(rows, by := [who, "condition"], interval="none")
    write_report(
        tmp_path / "a.html",
        who,
        who,
        rows,
        fits=fits,
        by=by,
        tables={who: fits.values()},
        notes=[who],
        unit=who,
    )
    page = (tmp_path / "a.html").read_bytes().decode()
    assert (
        "<script" not in page and "<b>" not in page and "\x00" not in page and "\u202e" not in page
    )
    assert page.count("&lt;script&gt;x&lt;/script&gt;$\\frac{") >= 6 and page.count("<svg") == 3
    assert [ax for ax in re.findall(r'id="(\w+tick_\d+)"', page)]


def test_a_page_of_answers_that_do_not_fit_is_an_error(answers, tmp_path):
    fits = fitted(answers, interval="none")
    refused(
        UnknownName,
        "no column 'track'",
        write_report,
        tmp_path / "a",
        "",
        "",
        {k: v for k, v in answers.items() if k != "track"},
    )
    refused(
        UnknownName,
        r"a fit of \('P01', 'silent'\).*by = participant",
        write_report,
        tmp_path / "a",
        "",
        "",
        answers,
        fits=fits,
        by=["participant"],
    )
    refused(BadValue, "grouped: by = 'participant' must be a list", grouped, answers, "participant")
    refused(BadValue, "a name for each", plain, fits, ["participant"])
    assert not list(tmp_path.iterdir())


def test_without_pandas_a_table_says_what_to_install(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pandas", None)
    refused(ImportError, r"stimlib\[experiments\]", to_pandas, [wilson(1, 2)])
