"""Run time against error: what the recorded tables say of errors is what this code has;
of times nothing is tested.
"""

import csv
import importlib.util
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from laws import STRESS
from refusals import refused

from stimlib.errors import SinkError, UnknownName

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))
precision, noise = importlib.import_module("precision"), importlib.import_module("problems.noise")
importlib.import_module("bench")
sys.path.remove(str(ROOT / "benchmarks"))  # it has modules with the names of folders of tests
from precision import Point, best, measure, problems  # noqa: E402
from problems.problem import Method, Problem, on, searched  # noqa: E402

RECORDED = ROOT / "benchmarks" / "work_precision"
ALL = problems()
OTHER = {"springpot_gl": " l1", "springpot_l1": " gl"}  # a scheme that has another limit
LEFT = {"springpot_l1": 1.2e-4}  # what the scheme itself leaves of the derivative
KEPT = precision.recorded(RECORDED)


def stub(ran=None, error=0.5, job=None, family="stimlib", knob="1"):
    """A method that computes nothing, and notes what of it runs."""
    ran = [] if ran is None else ran
    return Method(
        family, knob, job or (lambda: ran.append("job")), lambda: ran.append("error") or error
    )


def problem(*methods, name="p", title="", samples=1000):
    return Problem(name, title, "error", samples, lambda: list(methods))


def nothing(family, problem="p", knob="1"):
    return Point(problem, family, knob, math.nan, math.nan, "why")


@pytest.fixture
def asked(monkeypatch):
    """Make these the problems that there are."""
    return lambda *those: monkeypatch.setattr(precision, "problems", lambda only=(): list(those))


def test_the_table_of_the_docs_is_the_one_that_was_recorded():
    with (ROOT / "docs" / "explanation" / "work_precision.csv").open(newline="") as f:
        assert [tuple(row) for row in csv.reader(f)] == precision.summary(KEPT)
    page = ROOT / "docs" / "explanation" / "work_precision.rst"
    assert page.with_suffix(".inc").read_text("utf-8") == precision.spoken(KEPT)
    assert all(f"\n|{p.name}|\n" in page.read_text("utf-8") for p in ALL), (
        "a sentence below each picture"
    )


def test_what_was_measured_before_an_interruption_is_kept_whole(tmp_path, asked):
    def ended():
        raise KeyboardInterrupt

    asked(problem(stub(), name="a"), problem(stub(job=ended), name="b"))
    refused(KeyboardInterrupt, None, precision.regenerate, tmp_path, shown=False)
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv", "work_a.svg"}


@pytest.mark.parametrize("problem", ALL, ids=lambda p: p.name)
def test_errors_are_those_that_were_recorded(problem):
    """And every rung that says a tolerance keeps it; JAX, which compiles long, at
    length only.
    """
    methods = [m for m in problem.methods() if STRESS or "JAX" not in m.family]
    # it has as many samples as its time is divided by, or is as long
    if (made := methods[0].job()) is not None:
        rate = float(methods[0].knob) / 1000 if problem.per == "a millisecond" else 1.0
        assert np.size(made) == pytest.approx(rate * problem.samples, rel=3e-3)
    known = {(p.family, p.knob): p for p in KEPT if p.problem == problem.name}
    for p in measure(problem._replace(methods=lambda: methods), timed=False):
        was = known[p.family, p.knob]
        assert bool(p.failed) == bool(was.failed) and not (p.failed and "stimlib" in p.family), p
        # 3.6 times on another processor; 42 % with another scipy
        if any(part in p.family for part in ("LSODA", "scipy chirp, float32", "Savitzky-Golay")):
            assert 0.1 < p.error / was.error < 10, p
            continue
        digits = 1e-14 if "JAX" not in p.family else 1e-7  # below that sums in another order count
        near = 0.1 if "fitted arms" in p.family else 0.05  # 9 % with another scipy
        assert p.error == pytest.approx(was.error, rel=near, abs=digits, nan_ok=True), p
        promised = re.match(r"stimlib .*(tol|tol_db|dB)$", p.family) and "float32" not in p.family
        if promised and OTHER.get(p.problem, "-") not in p.family:
            assert p.error <= max(1.7 * float(p.knob), LEFT.get(p.problem, 0.0)), p


def test_every_recorded_table_has_a_problem_and_a_picture():
    names = {p.name for p in ALL}
    assert {p.stem for p in RECORDED.glob("*.csv")} == names
    assert {p.stem.removeprefix("work_") for p in RECORDED.glob("*.svg")} == names


def bad(knob):
    raise ValueError("a package that fails")


def test_what_fails_is_a_row_that_says_so():
    ladders = {
        "cannot be made": ([1], bad),
        "fails": ([1], lambda k: bad),
        "nan": ([2.5], lambda k: lambda x: x * np.nan),
    }
    p = Problem("p", "", "", 3, lambda: on(np.ones(3), lambda f: f(np.ones(1))[0], ladders))
    points = measure(p, rounds=1)
    assert all(math.isnan(q.error) and math.isnan(q.ns) for q in points)
    failed = [(q.knob, q.failed) for q in points]
    assert failed == [("1", "ValueError: a package that fails")] * 2 + [("2.5", "not finite")]


def test_the_table_has_our_figures_and_theirs():
    """A problem in which all of ours failed keeps its line."""
    theirs = Point("table", "scipy", "8", 1e-7, 6.0)
    ours = Point("table", "stimlib a", "1e-6", 1e-6, 2.0)
    first, *cells = (c for column in precision.table([ours, theirs]).columns for c in column.cells)
    assert (first, *cells[:1]) == ("table", "largest error to the smooth profile, of its maximum")
    assert cells[1:] == ["stimlib a 1e-6", "1.0e-06", "scipy 8", "1.0e-07", "3", "0 of 1"]
    failed = nothing("stimlib a", "table")
    (line,) = best([failed, theirs])
    assert (line.ours, line.other, line.reached) == (failed, theirs, False)
    summed = "stimlib a 1", "nan", "scipy 8", "1.0e-07", "nan", "0 of 1"
    assert math.isnan(line.times) and precision.summary([failed, theirs])[0][3:] == summed
    assert best([failed])[0].ours is failed and precision.table([failed, theirs]).row_count == 1
    assert best([nothing("stimlib JAX", "pink"), Point("pink", "scipy", "1", 1e-3, 5.0)]) == []


def test_the_line_of_a_problem():
    rows = [
        nothing("stimlib a", knob="0"),
        Point("p", "stimlib a", "1", 1e-3, 1.0),
        Point("p", "stimlib a", "2", 1e-6, 2.0),
        Point("p", "stimlib on JAX", "2", 1e-9, 1.0),
        Point("p", "scipy", "1", 1e-5, 1.0),
        Point("p", "numpy", "1", 1.009e-6, 6.0),
        Point("p", "numpy", "2", 1e-7, 8.0),
        nothing("broken"),
        Point("q", "stimlib b", "1", 1e-9, 5.0),
        Point("q", "far", "", 1e-2, 1.0),
        Point("q", "near", "", 1e-3, 10.0),
        Point("r", "stimlib c", "", 0.0, 1.0),
        Point("lowpass", "stimlib", "8", 1e-9, 1.0),
        Point("lowpass", "scipy", "8", 1e-5, 1.0),
        Point("lowpass", "scipy", "80", 1e-9, 1.0),
    ]
    p, q, r, lowpass = best(rows)
    assert (lowpass.other.knob, lowpass.reached) == ("8", False)  # another cutoff is another filter
    assert (p.ours, p.other, p.reached, p.times) == (rows[2], rows[5], True, 3.0)
    assert (q.other.family, q.reached, q.times) == ("near", False, 2.0)
    assert r.other is None and math.isnan(r.times)


def test_a_point_is_beaten_in_error_and_time():
    ours = Point("p", "stimlib a", "1", 1e-6, 2.0)
    for error, ns, lost in ((1e-6, 1.0, 1), (1e-9, 1.0, 1), (1e-9, 1.9, 0), (1.1e-6, 0.1, 0)):
        assert len(precision.beaten([ours, Point("p", "scipy", "", error, ns)])) == lost
    for other in (nothing("scipy"), Point("p", "stimlib on JAX", "", 0.0, 0.1)):
        assert not precision.beaten([ours, other])
    asked = ours._replace(problem="lowpass"), Point("lowpass", "scipy", "2", 0.0, 0.1)
    assert not precision.beaten(asked)  # another cutoff is another filter


def test_free_parameters_are_searched():
    def made(k):
        if k == 3:
            raise ValueError("no design")
        return lambda x: x if k < 5 else x * np.nan

    tried = [(k,) for k in range(7)]
    f = searched(lambda f: abs(float(f(np.ones(1))[0]) - 1), tried, made)
    assert f(2.0) == 2.0


def test_the_command(tmp_path, asked):
    """A folder that is not there is told before anything is measured."""
    ran = []
    asked(problem(stub(ran), name="tiny", title="a tiny problem"))
    refused(SinkError, None, precision.regenerate, tmp_path / "missing", shown=False)
    assert not ran
    precision.regenerate(tmp_path, ["tiny"], rounds=2, shown=False)
    assert ran.count("job") >= 5  # once to warm up, and twice or more in each of two rounds
    assert "a tiny problem" in (tmp_path / "work_tiny.svg").read_text("utf-8")
    head, _, row = (tmp_path / "tiny.csv").read_text().splitlines()[:3]
    assert re.match("# .*numpy", head) and row.startswith("tiny,stimlib,1,0.5,")


def test_names_of_problems():
    assert [p.name for p in problems(["arm", "pink"])] == ["arm", "pink"]
    refused(UnknownName, "no problem violet; there are pink, ", problems, ["violet"])
