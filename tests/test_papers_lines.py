"""The rows of benchmarks/papers.toml, which state what of the four sources is here:
each is whole and names what exists, and the page shows them.  The command runs them.
"""

import ast
import csv
import dataclasses
import itertools
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import off
import pytest

ROOT = Path(__file__).parents[1]
ROW = """
setup = ""
[open]
"a topic" = "open"
[ugrip.row]
at = "1.1"
says = "something"
"""
HERE = 'here = ["stimlib.blocks.pinking"]\n'
TEST = "tests/test_papers_lines.py::test_rows_are_whole_and_name_what_is_there"


BENCH = "papers"  # see tests/conftest.py


def test_rows_are_whole_and_name_what_is_there(bench):
    data = bench.read()
    assert list(bench.problems(data)) == []
    assert [len(data.of(source)) > 50 for source in bench.SOURCES] == [True] * 4


def test_the_tables_are_those_of_the_rows(bench):
    """Every cell, but the values of figures."""

    def table(name):
        return list(csv.reader((bench.TABLES / f"{name}.csv").read_text("utf-8").splitlines()))

    data, again = bench.read(), "; run benchmarks/papers.py --record"
    assert table("counts") == bench.counts(data), f"counts{again}"
    for source in (*bench.SOURCES, bench.ERRATA):
        lines = table(source)
        assert len(lines) == len(data.of(source)), f"{source}{again}"
        for row, cells in zip(data.of(source), lines, strict=True):
            assert cells == bench.line(data, row, bench.values_in(cells)), f"{row.name}{again}"
            assert {figure.of for figure in row.figures} <= bench.values_in(cells).keys(), row.name
    ran = (bench.TABLES / "ran.txt").read_text("utf-8")
    figures = sum(len(row.figures) for row in data.rows)
    tests = {test for row in data.rows for test in row.tests}
    assert f"{len(tests)} tests" in ran and f"{figures} figures" in ran, f"ran.txt{again}"


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (f'{HERE}verdict = "works"', None),
        (f'{HERE}tests = ["{TEST}"]\nverdict = "works"', None),
        ('open = "a topic"\nnote = "missing"', None),
        (f'{HERE}tests = ["{TEST}s"]\nverdict = "works"', f"no test {TEST}s"),
        ('tests = ["tests/none.py::test_a"]\nopen = "a topic"\nnote = "n"', "no test tests/none"),
        ('verdict = "works"', "say where it is"),
        ('here = ["stimlib.blocks.none"]\nverdict = "works"', "no page documents stimlib.blocks"),
        ('here = ["/howto/none"]\nverdict = "works"', "no page documents /howto/none"),
        ('verdict = "differs"', "say what differs"),
        (f'{HERE}note = "n"', "give either open, or as verdict"),
        (f'{HERE}verdict = "works"\nopen = "a topic"', "give either open, or as verdict"),
        ('verdict = "perhaps"\nnote = "n"', "give either open, or as verdict"),
        ('open = "another"\nnote = "n"', "not in the table of open topics"),
        (f'{HERE}figures = [{{of = "1 +", ours = 2}}]\nverdict = "works"', "1 +: invalid syntax"),
        (f'{HERE}figures = [{{of = "1"}}]\nverdict = "works"', "say what is printed, or ours"),
        ('verdict = "differs"\nnote = "n"\n[errata.a]\nat = "1"\nsays = "b"', "what it must be"),
    ],
)
def test_a_row_that_is_wrong_is_named(bench, more, said):
    found = list(bench.problems(bench.read(ROW + more)))
    assert len(found) == bool(said) and all(said in why for why in found)
    assert all(why.startswith(("ugrip.row: ", "errata.a: ")) for why in found)


def test_a_field_that_no_row_has_is_named(bench):
    with pytest.raises(ValueError, match=r"ugrip\.row: no field test; use"):
        bench.read(ROW + 'test = "a"')


def test_a_topic_that_is_merged_is_one_line(bench):
    """Its rows count as what the line says, and lose their notes."""
    text = ROW + HERE + 'open = "a topic"\nnote = "It is missing."'
    data = bench.read(text)
    assert bench.line(data, data.rows[0], {})[2:] == [
        ":obj:`~stimlib.blocks.pinking`",
        "read, no test",
        "**open** (a topic): It is missing.",
    ]
    assert bench.counts(data)[0] == [":ref:`ugrip`", "0", "0", "0", "1", "1", "1"]
    merged = bench.read(text.replace('"a topic" = "open"', '"a topic" = "works"'))
    assert bench.line(merged, merged.rows[0], {})[4] == "works"
    assert bench.counts(merged)[0] == [":ref:`ugrip`", "1", "0", "0", "0", "1", "1"]
    assert list(bench.problems(bench.read(text.replace('= "open"', '= "merged"')))) == [
        "open, a topic: 'merged' must be one of works, differs, not here, open"
    ]


@pytest.mark.parametrize(
    ("of", "words", "value", "right"),
    [
        ("two", {"printed": 2}, "2", True),
        ("two / 3", {"printed": 0.67, "within": 0.005}, "0.66667", True),
        ("two / 3", {"printed": 0.67, "within": 0.003}, "0.66667", False),
        ("two", {"printed": 3, "ours": 2}, "2", True),
        ("two", {"printed": 2, "ours": 3}, "2", False),
        ("[two, 1]", {"printed": [2, 1]}, "[2, 1]", True),
        ("[two, 1]", {"printed": [2, 1, 0]}, "[2, 1]", False),
        ("two > 1", {"printed": True}, "True", True),
        ("two > 1", {"printed": False}, "True", False),
        ("['a']", {"printed": ["a"]}, "['a']", True),
        ("['a']", {"printed": ["b"]}, "['a']", False),
    ],
)
def test_a_figure_is_held_to_what_is_printed(bench, of, words, value, right):
    assert bench.value_of(bench.Figure(of, **words), {"two": 2.0}) == (value, right)


def test_each_row_has_a_check_that_turns_red_if_its_value_is_2_percent_off(bench):
    """A figure (see the next test), or a test that failed with such numbers when
    ``benchmarks/papers.py --falsify`` ran it; but for errata of words.
    """
    data, red = bench.read(), set(bench.RED.read_text("utf-8").splitlines())
    assert red <= {test for row in data.rows for test in row.tests}, "run --falsify again"
    assert [r.name for r in data.rows if not (r.figures or red & set(r.tests) or r.read)] == []
    read = [r for r in data.rows if r.read]
    assert not [r.name for r in read if r.figures or r.tests or r.source != bench.ERRATA]


def test_no_figure_holds_for_a_value_that_is_2_percent_off(bench):
    """Of each number in it, in both directions; 0 is off by 2 % of the largest."""
    data, values = bench.read(), bench.kept()
    holding = []
    for name, figure in [(row.name, figure) for row in data.rows for figure in row.figures]:
        right = figure.printed if figure.ours is None else figure.ours
        if np.asarray(right).dtype.kind in "bU":
            continue  # any other value fails
        numbers = np.atleast_1d(np.asarray(right, float))
        for k, by in itertools.product(range(numbers.size), (-0.02, 0.02)):
            wrong = numbers.copy()
            wrong[k] += by * (abs(wrong[k]) or np.max(abs(numbers)) or 1.0)
            given = wrong.tolist() if np.ndim(right) else float(wrong[0])
            off = dataclasses.replace(figure, of=values[figure.of], ours=given)
            if bench.value_of(off, {"nan": np.nan, "inf": np.inf})[1]:
                holding.append(f"{name}: {figure.of}: {given}")
    assert holding == []


@pytest.mark.parametrize(
    ("test", "red"),
    [
        ("assert abs(f() - 1.0) < 1e-3", True),
        ("assert f() == pytest.approx(1.0)", True),
        ("np.testing.assert_allclose(f(), 1.0)", True),
        ("assert [f(), 0.0] == [1.0, 0.0]", True),
        ("assert f() < 1.01", True),
        ("assert f() < 2.0", False),
        ("assert f()", False),
    ],
)
def test_a_falsified_test_fails_where_it_holds_a_number(test, red):
    code = compile(ast.fix_missing_locations(off.Falsify().visit(ast.parse(test))), "test", "exec")
    names = {"f": lambda: 1.0, "pytest": pytest, "np": np, "__off__": off.off}
    if red:
        with pytest.raises(AssertionError):
            exec(code, names)
    else:
        exec(code, names)


def test_outcomes_are_those_of_all_cases_of_a_test(bench):
    counted = bench.Counted(lambda done, more=0: None)
    for words in (
        "a.py::test_a[1]@a.py call passed",
        "a.py::test_a[2@x]@a.py call failed",
        "a.py::test_a[2@x]@a.py teardown passed",
        "a.py::test_b setup skipped",
    ):
        made = dict(zip(("nodeid", "when", "outcome"), words.split(), strict=True))
        counted.pytest_runtest_logreport(SimpleNamespace(**made))
    both = {"passed": 1, "failed": 1}
    assert counted.outcomes == {"a.py::test_a": both, "a.py::test_b": {"skipped": 1}}
