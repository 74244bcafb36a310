"""Which statements of the four sources does stimlib implement, and what shows it?

    python benchmarks/papers.py --record

runs every test and computes every figure that papers.toml names, and writes the tables
of docs/reference/papers_lines.rst; it takes some minutes on two cores.  Without
--record it only checks.  Names of rows (ugrip, or li2016.eq-3) limit it to these rows.
--falsify runs the tests of all rows with the numbers that they compare 2 % off
(tests/off.py), and records which of them fail then, as they should, and which do not;
it takes some minutes, too, and names of rows limit it.
"""

from __future__ import annotations

import ast
import csv
import io
import os
import re
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from bench import options
from timing import machine

from stimlib.system.progress import progress

ROOT = Path(__file__).parents[1]
DATA = Path(__file__).with_suffix(".toml")
DOCS = ROOT / "docs"
TABLES = DOCS / "reference" / "papers_lines"
SOURCES = ("ugrip", "caldiran", "li2016", "touchscreen")
"""Labels of the sources in docs/reference/papers.rst."""
VERDICTS = ("works", "differs", "not here", "open")
ERRATA = "errata"
RED = TABLES / "red.txt"
"""Tests that fail if the numbers that they compare are 2 % off."""
FALSIFIED = TABLES / "falsified.txt"


# Rows ---------------------------------------------------------------------------------
@dataclass(frozen=True)
class Figure:
    """A number that is computed: ``of`` is an expression, ``within`` its tolerance.

    It must be what the source printed, unless ``ours`` says which number follows
    instead.
    """

    of: str
    printed: Any = None
    ours: Any = None
    within: float | list[float] = 0.0


@dataclass(frozen=True)
class Row:
    """A statement of a source; see the top of papers.toml."""

    source: str
    key: str
    at: str
    says: str
    here: tuple[str, ...] = ()
    tests: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    verdict: str = ""
    open: str = ""
    note: str = ""
    must: str = ""
    read: bool = False

    @property
    def name(self) -> str:
        return f"{self.source}.{self.key}"


@dataclass(frozen=True)
class Data:
    """All of papers.toml."""

    setup: str
    topics: Mapping[str, str]
    rows: tuple[Row, ...]

    def of(self, source: str) -> list[Row]:
        return [r for r in self.rows if r.source == source]

    def verdict(self, row: Row) -> str:
        return self.topics.get(row.open, "open") if row.open else row.verdict


def read(text: str | None = None) -> Data:
    """Read the rows; a field that no row has raises an error with the row's name."""
    raw = tomllib.loads(DATA.read_text("utf-8") if text is None else text)
    rows = []
    for source in (*SOURCES, ERRATA):
        for key, given in raw.get(source, {}).items():
            known = {f.name for f in fields(Row)} - {"source", "key"}
            if extra := given.keys() - known:
                raise ValueError(f"{source}.{key}: no field {min(extra)}; use {sorted(known)}")
            words = {k: tuple(v) if isinstance(v, list) else v for k, v in given.items()}
            words["figures"] = tuple(Figure(**f) for f in words.get("figures", ()))
            rows.append(Row(source, key, **words))
    return Data(raw["setup"], raw["open"], tuple(rows))


@cache
def documented() -> set[str]:
    """Names to which the docs can link: what a page of the reference documents."""
    names = set()
    for page in (p for part in ("howto", "reference") for p in DOCS.glob(f"{part}/**/*.rst")):
        module = owner = "stimlib"
        for line in page.read_text("utf-8").splitlines():
            if found := re.match(r" *\.\. currentmodule:: (\S+)", line):
                module = found[1]
            elif found := re.match(r" *\.\. auto(?:function|class|data):: (\S+)", line):
                owner = found[1] if found[1].startswith("stimlib.") else f"{module}.{found[1]}"
                names.add(owner)
            elif found := re.match(r" +:members: (.+)", line):
                names |= {f"{owner}.{member.strip()}" for member in found[1].split(",")}
    return names


@cache
def defined(file: str) -> set[str]:
    """Tests of a file, as pytest names them; nothing is imported."""
    path = ROOT / file
    if not path.is_file():
        return set()
    found = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        inside = node.body if isinstance(node, ast.ClassDef) else []
        found |= {f"{node.name}::{n.name}" for n in inside if isinstance(n, ast.FunctionDef)}
        if isinstance(node, ast.FunctionDef):
            found.add(node.name)
    return found


def problems(data: Data) -> Iterator[str]:
    """What is wrong with the rows themselves, each with the name of its row."""
    for topic, verdict in data.topics.items():
        if verdict not in VERDICTS:
            yield f"open, {topic}: {verdict!r} must be one of {', '.join(VERDICTS)}"
    for row in data.rows:
        for test in row.tests:
            file, _, name = test.partition("::")
            if name not in defined(file):
                yield f"{row.name}: no test {test}"
        for name in row.here:
            page = DOCS / f"{name[1:]}.rst"
            if not page.is_file() if name.startswith("/") else name not in documented():
                yield f"{row.name}: no page documents {name}"
        for figure in row.figures:
            try:
                compile(figure.of, row.name, "eval")
            except SyntaxError as e:
                yield f"{row.name}: {figure.of}: {e.msg}"
            if figure.printed is None and figure.ours is None:
                yield f"{row.name}: {figure.of}: say what is printed, or ours"
        if not (row.at and row.says):
            yield f"{row.name}: say where (at) and what (says)"
        if row.source == ERRATA:
            if not row.must or not row.note:
                yield f"{row.name}: say what it must be (must) and how we know (note)"
            continue
        if row.open and row.open not in data.topics:
            yield f"{row.name}: open = {row.open!r} is not in the table of open topics"
        if bool(row.open) == bool(row.verdict) or row.verdict not in ("", *VERDICTS[:3]):
            yield f"{row.name}: give either open, or as verdict one of {VERDICTS[:3]}"
        if row.verdict == "works" and not row.here:
            yield f"{row.name}: it works, so say where it is (here)"
        if row.verdict != "works" and not row.note:
            yield f"{row.name}: say what differs or is missing, and why (note)"


# What shows it ------------------------------------------------------------------------
class Counted:
    """A plugin of pytest: outcomes of tests by their name without parameters."""

    def __init__(self, advance: Any):
        self.advance, self.known = advance, 0
        self.outcomes: dict[str, Counter[str]] = {}

    def pytest_xdist_node_collection_finished(self, ids: Sequence[str]) -> None:
        if not self.known:
            self.known = len(ids)
            self.advance(0, more=self.known)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call" or report.outcome != "passed":
            name = re.sub(r"@[^@]*$", "", report.nodeid).partition("[")[0]
            self.outcomes.setdefault(name, Counter())[report.outcome] += 1
            self.advance(report.when == "call" or report.outcome == "skipped")


def tested(nodes: Iterable[str], workers: int = 2) -> dict[str, Counter[str]]:
    """Run tests in one pytest process with workers, and count the outcomes of each."""
    import pytest

    if not (nodes := sorted(set(nodes))):
        return {}
    # workers have this path too, and it has modules with the names of folders of tests
    sys.path[:] = [p for p in sys.path if Path(p) != DATA.parent]
    said = io.StringIO()
    words = ["-q", "-s", f"--rootdir={ROOT}", "-p", "no:cacheprovider", f"-n{workers}"]
    words += ["--dist=loadgroup", "--no-loadscope-reorder"]
    with progress("tests", 0) as advance, redirect_stdout(said):
        counted = Counted(advance)
        pytest.main([*words, *(f"{ROOT}/{node}" for node in nodes)], plugins=[counted])
    if set(nodes) - counted.outcomes.keys() or any(c["failed"] for c in counted.outcomes.values()):
        print(said.getvalue()[-20000:], file=sys.stderr)
    return counted.outcomes


def falsified(nodes: Iterable[str]) -> set[str]:
    """Return the tests that fail if each number that they compare is 2 % off."""
    words = ["-v", "-n2", "--dist=loadscope", "--tb=no", "-p", "off", "-p", "no:cacheprovider"]
    paths = os.pathsep.join([str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")])
    ran = subprocess.Popen(
        [sys.executable, "-m", "pytest", *words, *sorted(set(nodes))],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        text=True,
    )
    red, lines, done = set(), [], 0
    with ran, progress("tests 2 % off", 100) as advance:
        for line in ran.stdout or ():
            lines.append(line)
            if found := re.match(r"\[gw\d+\] \[ *(\d+)%\] (\w+) (tests/[^\s\[@]+)", line):
                red |= {found[3]} if found[2] == "FAILED" else set()
                advance(int(found[1]) - done)
                done = int(found[1])
    if ran.returncode not in (0, 1):
        raise RuntimeError("".join(lines)[-4000:])
    return red


def value_of(figure: Figure, names: dict[str, Any]) -> tuple[str, bool]:
    """Compute a figure: its value as text, and whether it is as the row says."""
    value = eval(figure.of, names)
    expected = figure.printed if figure.ours is None else figure.ours
    if isinstance(expected, bool) or np.asarray(expected).dtype.kind == "U":
        return str(value), value == expected
    got, want = np.asarray(value, float), np.asarray(expected, float)
    right = got.shape == want.shape and bool(np.all(np.abs(got - want) <= figure.within))
    digits = [f"{v + 0.0:.5g}" for v in got.ravel()]
    return digits[0] if got.ndim == 0 else f"[{', '.join(digits)}]", right


# Tables -------------------------------------------------------------------------------
def red_tests() -> set[str]:
    return set(RED.read_text("utf-8").splitlines()) if RED.is_file() else set()


def values_in(cells: Sequence[str]) -> dict[str, str]:
    """Return the values of figures in a line of a table."""
    return dict(re.findall(r"``([^`]+)`` = (.+?)(?= \(printed|; ``|\)?$)", cells[3]))


def kept() -> dict[str, str]:
    """Return the values of figures in the tables."""
    values = {}
    for source in (*SOURCES, ERRATA):
        for cells in csv.reader((TABLES / f"{source}.csv").read_text("utf-8").splitlines()):
            values |= values_in(cells)
    return values


def link(name: str) -> str:
    return f":doc:`{name}`" if name.startswith("/") else f":obj:`~{name}`"


def shown(row: Row, values: Mapping[str, str]) -> str:
    """What shows a row: tests by their files, and figures with their values."""
    files: dict[str, list[str]] = {}
    red = red_tests()
    for test in row.tests:
        file, _, name = test.partition("::")
        files.setdefault(file, []).append(f"``{name}``" + "\\*" * (test not in red))
    parts = [f"{file}: {', '.join(names)}" for file, names in files.items()]
    for figure in row.figures:
        text = f"``{figure.of}`` = {values.get(figure.of, '?')}"
        parts.append(text + (f" (printed: {figure.printed})" if figure.printed is not None else ""))
    return "; ".join(parts) or "read, no test"


def line(data: Data, row: Row, values: Mapping[str, str]) -> list[str]:
    """A line of a table of the page."""
    if row.source == ERRATA:
        known = "" if not (row.tests or row.figures) else f" ({shown(row, values)})"
        return [row.at, row.says, row.must, f"{row.note}{known}"]
    verdict = data.verdict(row)
    note = "" if row.open and verdict == "works" else row.note
    said = f"**{verdict}**" if verdict != "works" else verdict
    said += f" ({row.open})" if verdict == "open" else ""
    here = ", ".join(map(link, row.here)) or "-"
    return [row.at, row.says, here, shown(row, values), f"{said}: {note}" if note else said]


def counts(data: Data) -> list[list[str]]:
    """Rows by source and verdict, and those that no test or figure shows."""
    lines = []
    for title, rows in (
        *((f":ref:`{source}`", data.of(source)) for source in SOURCES),
        ("**all**", [r for r in data.rows if r.source != ERRATA]),
    ):
        found = Counter(data.verdict(r) for r in rows)
        unseen = sum(not (r.tests or r.figures) for r in rows)
        lines.append([title, *(str(found[v]) for v in VERDICTS), str(len(rows)), str(unseen)])
    return lines


def write(data: Data, values: Mapping[str, str], ran: str) -> None:
    """Write the tables that the page shows."""
    TABLES.mkdir(exist_ok=True)
    tables = {s: [line(data, r, values) for r in data.of(s)] for s in (*SOURCES, ERRATA)}
    for name, lines in (tables | {"counts": counts(data)}).items():
        with (TABLES / f"{name}.csv").open("w", newline="", encoding="utf-8") as f:
            csv.writer(f, lineterminator="\n").writerows(lines)
    (TABLES / "ran.txt").write_text(ran + "\n", "utf-8")


def main(given: Any) -> int:
    data = read()
    if wrong := list(problems(data)):
        print(*wrong, sep="\n", file=sys.stderr)
        return 1
    asked = [r for r in data.rows if not given.rows or {r.source, r.name} & set(given.rows)]
    if given.falsify:
        tests = {t for r in asked for t in r.tests}
        others = {t for r in data.rows for t in r.tests} - tests
        began, red = time.monotonic(), others & red_tests() | falsified(tests)
        RED.write_text("\n".join(sorted(red)) + "\n", "utf-8")
        rows = [r for r in data.rows if r.tests or r.figures]
        still = [r.name for r in rows if not (r.figures or red & set(r.tests))]
        said = (
            f"{time.strftime('%Y-%m-%d', time.gmtime())}: {len(rows) - len(still)} of"
            f" {len(rows)} rows turn red, {sum(bool(red & set(r.tests)) for r in rows)} by a test"
            f" and {sum(bool(r.figures) for r in rows)} by an expression; {len(red)} of"
            f" {len(tests | others)} tests do"
        )
        if not given.rows:
            ran = f"{said} ({time.monotonic() - began:.0f} s; {machine()})."
            FALSIFIED.write_text(ran + "\n", "utf-8")
        write(data, kept(), (TABLES / "ran.txt").read_text("utf-8").strip())
        print(said, *(f"still green: {t}" for t in sorted((tests | others) - red)), sep="\n")
        print(*(f"a row that no check turns red: {name}" for name in still), sep="\n")
        return 0
    began, names, values = time.monotonic(), {"__name__": "papers"}, {}
    exec(compile(data.setup, f"{DATA.name}, setup", "exec"), names)
    with progress("figures", sum(len(r.figures) for r in asked)) as advance:
        for row in asked:
            for figure in row.figures:
                try:
                    values[figure.of], right = value_of(figure, names)
                except Exception as e:
                    wrong.append(f"{row.name}: {figure.of}: {type(e).__name__}: {e}")
                else:
                    if not right:
                        want = figure.printed if figure.ours is None else figure.ours
                        wrong.append(
                            f"{row.name}: {figure.of} is {values[figure.of]}, not {want} within"
                            f" {figure.within}"
                        )
                advance(1)
    outcomes = tested(t for r in asked for t in r.tests)
    for row in asked:
        for test in row.tests:
            found = outcomes.get(test, Counter())
            if found["failed"] or not found["passed"]:
                why = "failed" if found["failed"] else "skipped" if found else "did not run"
                wrong.append(f"{row.name}: {test} {why}")
    cases = sum(c["passed"] for c in outcomes.values())
    ran = (
        f"{time.strftime('%Y-%m-%d', time.gmtime())}: {len(outcomes)} tests ({cases} cases) and"
        f" {sum(len(r.figures) for r in asked)} figures in {time.monotonic() - began:.0f} s;"
        f" {machine()}."
    )
    print(ran)
    for cells in counts(data):
        print("  ".join(f"{cell:<24}" if k == 0 else f"{cell:>4}" for k, cell in enumerate(cells)))
    if wrong:
        print(*wrong, sep="\n", file=sys.stderr)
    elif given.record and not given.rows:
        write(data, values, ran)
    return bool(wrong)


if __name__ == "__main__":
    parser = options(__doc__, cores=None)
    parser.add_argument("--falsify", action="store_true", help="record which tests fail 2 % off")
    parser.add_argument("rows", nargs="*", help="names of sources or rows; all by default")
    sys.exit(main(parser.parse_args()))
