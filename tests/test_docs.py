"""The user guide builds without a warning, and what it says is true: every snippet runs."""

import csv
import doctest
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from stimlib import blocks
from stimlib.cli import app
from stimlib.motion.generators import GENERATORS

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(p for p in DOCS.rglob("*.rst") if not {"_build", "generated"} & set(p.parts))
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def text_of(*pages: str) -> str:
    return "\n".join(p.read_text() for p in PAGES if not pages or p.name in pages)


def test_docs_build_without_warnings(tmp_path):
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", str(tmp_path / "trees")]
    done = subprocess.run([*command, str(DOCS), str(tmp_path / "html")], capture_output=True, text=True, timeout=900)
    assert (done.returncode, done.stderr) == (0, "")
    made = {p.relative_to(tmp_path / "html").with_suffix(".rst") for p in (tmp_path / "html").rglob("*.html")}
    assert {p.relative_to(DOCS) for p in PAGES} <= made
    for page in (tmp_path / "html").rglob("*.html"):  # whoever reads it offline misses nothing
        outside = re.findall(r'(?:src|href)="(?:https?:)?//([^/"]+)', re.sub(r"<a .*?>", "", page.read_text()))
        assert not outside, f"{page.name} loads something from {outside}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(DOCS)))
def test_snippets_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert doctest.testfile(str(page), module_relative=False, optionflags=OPTIONS).failed == 0


def test_every_block_function_has_its_place():
    known = set(re.findall(r"autofunction:: stimlib\.blocks\.(\w+)", text_of()))
    assert known == set(blocks.__all__)


def test_every_motion_has_its_place():
    assert set(re.findall(r"autoclass:: (\w+)", text_of("motion.rst"))) == set(GENERATORS)


def test_the_command_line_page_is_complete():
    page = text_of("cli.rst")
    for name, command in typer.main.get_command(app).commands.items():
        section = page.partition(f"stimlib {name}")[2].partition("\n---")[2].partition("\n---")[0]
        assert section, f"stimlib {name} is not in cli.rst"
        told = set(re.findall(r"^``(--[a-z-]+)``", section, re.MULTILINE))
        assert told == {o for p in command.params for o in p.opts if o.startswith("--")}, f"options of stimlib {name}"


def test_guide_prints_what_the_examples_print():
    from test_examples import PRINTED

    for printed in PRINTED.values():
        for line in printed.splitlines():
            pages = ("first_stimulus.rst", "add_a_block.rst", "fitting.rst", "bumps.rst", "batches.rst")
            assert f"   {line}\n" in text_of(*pages)


def test_every_test_in_the_table_of_findings_exists():
    rows = list(csv.reader((DOCS / "findings.csv").read_text().splitlines()))
    root = DOCS.parent
    for finding, _, what, test in rows:
        assert what and (test or finding == "I10"), finding
        path, _, name = test.partition("::")
        assert not test or re.search(rf"^ *def {name}\(", (root / path).read_text(), re.M), test
    assert {r[0] for r in rows} >= {
        f"{c}{n}" for c, last in (("M", 6), ("C", 2), ("V", 10), ("I", 10)) for n in range(1, last + 1)
    }
