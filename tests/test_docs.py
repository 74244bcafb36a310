"""The user guide builds without a warning, and what it says is true: every snippet
runs.
"""

import csv
import doctest
import importlib
import logging
import pkgutil
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from collections import Counter
from pathlib import Path

import docs_pages
import pytest
import typer
from commands import ran
from live.chromium import where as chromium

from stimlib import blocks
from stimlib.cli import app
from stimlib.core import graph, pointwise, subsystems
from stimlib.devices.engine import native
from stimlib.devices.null import NullSink
from stimlib.motion.generators import GENERATORS
from stimlib.targets.llvm.engine import runtime

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MADE = {"_build", "gallery"}  # by make docs
PAGES = sorted(p for p in DOCS.rglob("*.rst") if not MADE & set(p.relative_to(DOCS).parts))
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def text_of(*pages: str) -> str:
    return "\n".join(p.read_text("utf-8") for p in PAGES if not pages or p.name in pages)


def build(builder, folder, gallery=False):
    """From a copy, because the gallery is written beside the pages; its scripts are run
    in test_gallery.py, and here if asked for.
    """
    shutil.copytree(DOCS, folder / "docs", ignore=shutil.ignore_patterns(*MADE))
    for name in ("benchmarks", "examples", "stimlib"):
        (folder / name).symlink_to(ROOT / name)
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-b",
        builder,
        *([] if gallery else ["-D", "plot_gallery=0", "-D", "smartquotes=0"]),
    ]
    done = subprocess.run([*command, "docs", "made"], cwd=folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "made"


def test_the_page_says_that_jax_has_not_run_on_a_gpu_until_it_has():
    ran = (ROOT / "benchmarks" / "results" / "jax_gpu.csv").exists()
    assert ("has not run on a GPU yet" in text_of("batches.rst")) != ran


def test_docs_have_no_warnings(tmp_path):
    """Everything is read and every reference found; no page is written."""
    build("dummy", tmp_path)


@pytest.mark.stress
@pytest.mark.xdist_group("chromium")
@pytest.mark.skipif(
    chromium() is None, reason="Chromium is not installed: tests/devices/install.sh installs it"
)
def test_pages_in_a_browser(tmp_path):
    """Code, tables and pictures at three widths, the front page, search and copying."""
    assert docs_pages.faults_of(build("html", tmp_path, gallery=True)) == []


def test_words_that_people_search_for_are_on_a_page():
    """The search of the pages finds what stands there; it looks for the parts of a
    hyphenated word."""
    pages = [set(re.findall(r"\w+", p.read_text("utf-8").lower())) for p in PAGES]
    for word in docs_pages.SEARCHED:
        parts = set(re.findall(r"\w+", word.lower()))
        assert any(parts <= page for page in pages), f"say on a page what there is for {word}"


def test_reference_pages_show_their_pages_of_the_gallery():
    """All of a family of blocks, and the one of a scene."""
    for page in (p for p in PAGES if p.parent.name in ("blocks", "scenes") and p.stem != "index"):
        own = [f.stem for f in (ROOT / "examples" / "gallery" / page.parent.name).glob("plot_*.py")]
        whole = page.parent.name == "scenes"
        own = [n for n in own if (n[5:] if whole else n.split("_")[1]) == page.stem]
        shown = (
            page.read_text("utf-8").partition("\n.. shown::\n\n")[2].partition("\n\n")[0].split()
        )
        assert sorted(shown) == [f"{page.parent.name}/{n}" for n in sorted(own)] != [], (
            f"{page}: list below `.. shown::` the programs examples/gallery/{page.parent.name}/"
            f"plot_{page.stem}*.py, and write one where there is none"
        )


def test_pages_with_a_springpot_say_its_scheme_and_both_errors():
    played = re.compile(
        r"^(>>>|\.\.\.) .*\b(springpot|viscoelastic|compliance|firmness|bounciness)\(", re.M
    )
    pages = [page for page in PAGES if played.search(page.read_text("utf-8"))]
    assert len(pages) > 6
    for page in pages:
        assert ".. include:: /reference/blocks/springpot_schemes.inc\n" in page.read_text(
            "utf-8"
        ), page


STUDIES = ("analysis", "bounciness", "nodules", "roughness")
LONG = {"howto/sweep.rst", "howto/batches.rst", "howto/statistics.rst"}
LONG |= {"explanation/verification.rst"}
LONG |= {f"reference/experiments_{name}.rst" for name in STUDIES}
"""Pages that take up to half a minute, of what tests of these rooms show with less."""


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=name, marks=pytest.mark.stress if name in LONG else ())
        for page in PAGES
        for name in [str(page.relative_to(DOCS))]
    ],
)
def test_snippets_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert doctest.testfile(str(page), module_relative=False, optionflags=OPTIONS).failed == 0


@pytest.mark.parametrize(
    "page",
    [p for p in PAGES if "code-block:: console" in p.read_text("utf-8")],
    ids=lambda p: p.stem,
)
def test_what_a_page_types_into_a_terminal_prints_what_it_says(page, tmp_path, monkeypatch):
    """Lines with $ are run by the shell's rules; the lines below are what must come,
    `...` anything.
    """
    runtime(), native()  # a command that compiles them would say so
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    text = re.sub(r" \\\n +", " ", page.read_text("utf-8"))  # which a shell continues
    said = re.findall(r"^   \$ stimlib (.*)\n((?:   (?!\$).*\n)*)", text, re.MULTILINE)
    assert len(said) == text.count("   $ ")
    for command, wanted in said:
        done = ran(shlex.split(command), 2 if wanted.startswith("   error:") else 0)
        assert doctest.OutputChecker().check_output(
            textwrap.dedent(wanted), done.output, OPTIONS
        ), (command, done.output)


def python_blocks() -> dict[str, str]:
    """All Python that is printed and no doctest: blocks of pages, and of the README."""
    found = {
        "README.md": re.findall(
            r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL
        )
    }
    for page in PAGES:
        blocks = re.findall(r"code-block:: python\n\n((?:   .*\n|\n)+)", page.read_text("utf-8"))
        found[str(page.relative_to(DOCS))] = [textwrap.dedent(b) for b in blocks]
    return {f"{name} {i}": text for name, texts in found.items() for i, text in enumerate(texts)}


@pytest.mark.parametrize("name", python_blocks())
def test_python_runs_as_it_is_pasted(name, tmp_path, monkeypatch, capsys):
    """By itself, with its own imports: nothing is raised, and nothing complains; on no
    device in the place of one.
    """
    monkeypatch.chdir(tmp_path)

    def quiet(scene, safety, *, name=None, **options):
        return NullSink(scene, safety, clocked=False, **options)

    monkeypatch.setattr("stimlib.devices.JackSink", quiet)
    monkeypatch.setattr("stimlib.devices.PortAudioSink", quiet)
    markers = [f"{kind}_markers" for kind in ("lsl", "osc", "serial", "parallel")]
    for transport in ("lsl_motion", *markers):
        monkeypatch.setattr(
            f"stimlib.devices.{transport}", lambda *where, **how: lambda given: ([], [])
        )
    monkeypatch.setattr("stimlib.live.share.compiled", lambda folder: b"")  # not for a browser
    level = logging.getLogger("stimlib").level
    exec(compile(python_blocks()[name], name, "exec"), {"__name__": "pasted"})
    logging.getLogger("stimlib").setLevel(level)
    assert "Traceback" not in capsys.readouterr().err, "an error in a thread or a child"


def test_no_page_says_a_paragraph_twice():
    """A merge once left four sections of a page twice, one of them out of date."""
    for page in PAGES:
        said = [" ".join(p.split()) for p in page.read_text("utf-8").split("\n\n")]
        assert [p for p in set(said) if len(p) > 80 and said.count(p) > 1] == [], page


FAMILY = {  # of modules that are not named by it
    "loops": "graph",
    "subsystems": "graph",
    "actuator": "contact",
    "friction": "contact",
    "clock": "events",
    "envelopes": "events",
    "integrals": "events",
    "fir_filters": "filters",
    "tracking": "filters",
    "avatars": "soft",
    "cursors": "soft",
    "creep": "viscoelastic",
    "series": "viscoelastic",
    "bumps": "surfaces",
    "equalization": "surfaces",
}


def test_every_block_function_has_its_place():
    """On the page of one family, which the index lists."""
    folder = DOCS / "reference" / "blocks"
    index, told = (folder / "index.rst").read_text("utf-8"), []
    for page in sorted(folder.glob("*.rst")):
        names = re.findall(r"autofunction:: stimlib\.blocks\.(\w+)$", page.read_text("utf-8"), re.M)
        heading = f".. rubric:: :doc:`{page.stem}`\n\n.. functions:: {page.stem}\n"
        assert not names or heading in index, (
            f"docs/reference/blocks/index.rst: add the heading and the functions of {page.stem}"
        )
        for name in names:
            module = getattr(blocks, name).__module__.split(".")[-1]
            family = FAMILY.get(module, module)
            assert family == page.stem, (
                f"docs/reference/blocks/{page.name}: {name} belongs on the page of {family}"
            )
        told += names
    families = [
        importlib.import_module(f"stimlib.blocks.{m.name}")
        for m in pkgutil.iter_modules(blocks.__path__)
    ]
    families += [graph, pointwise, subsystems]
    made = {
        n
        for family in families
        for n, f in vars(family).items()
        if hasattr(f, "__wrapped__") and "Block" in str(f.__annotations__.get("return"))
    }
    assert made <= set(blocks.__all__), (
        f"stimlib/blocks/__init__.pyi: import {made - set(blocks.__all__)}, or remove @public"
    )
    bare = [n for n in blocks.__all__ if not hasattr(getattr(blocks, n), "__wrapped__")]
    assert bare == [], f"stimlib/blocks: write @public of stimlib.errors above {bare}"
    assert Counter(told) == Counter(blocks.__all__), (
        "docs/reference/blocks: write `.. autofunction:: stimlib.blocks.NAME` on the page of its"
        f" family, once; {set(blocks.__all__) - set(told)} are on none"
    )


def test_every_motion_has_its_place():
    assert set(re.findall(r"autoclass:: (\w+)", text_of("motion.rst"))) == set(GENERATORS)


def test_the_command_line_page_is_complete():
    page, known = text_of("cli.rst"), {}
    for name, command in typer.main.get_command(app).commands.items():
        known |= (
            {f"{name} {n}": c for n, c in command.commands.items()}
            if hasattr(command, "commands")
            else {name: command}
        )
    for name, command in known.items():
        section = page.partition(f"stimlib {name}")[2].partition("\n---")[2].partition("\n---")[0]
        assert section, f"stimlib {name} is not in cli.rst"
        assert set(re.findall(r"^``(--[a-z0-9-]+)``", section, re.MULTILINE)) == {
            o for p in command.params for o in p.opts if o.startswith("--")
        }, f"options of stimlib {name}"


def test_guide_prints_what_the_examples_print():
    from test_examples import PRINTED

    for printed in PRINTED.values():
        for line in printed.splitlines():
            assert f"   {line}\n" in text_of()


def table(name):
    return list(csv.reader((DOCS / "explanation" / name).read_text("utf-8").splitlines()))


def exists(test):
    path, _, name = test.partition("::")
    return re.search(rf"^ *def {name}\(", (ROOT / path).read_text("utf-8"), re.M)


def test_every_test_in_the_table_of_findings_exists():
    rows = table("findings.csv")
    for finding, _, what, test in rows:
        assert what and (test or finding == "I10"), finding
        assert not test or exists(test), test
    assert {r[0] for r in rows} >= {
        f"{c}{n}"
        for c, last in (("M", 6), ("C", 2), ("V", 10), ("I", 10), ("P", 6))
        for n in range(1, last + 1)
    }


def test_a_page_chooses_tests_that_exist():
    """By words of their names, or by the name of what a reader adds."""
    chosen = []
    for page in [*PAGES, ROOT / "CONTRIBUTING.md"]:
        text = re.sub(r"\s+\\?\s*", " ", page.read_text("utf-8"))
        chosen += re.findall(r'pytest ((?:tests\S* )+)-k "?((?:\w+ or )*\w+)', text)
    assert len(chosen) > 4
    for paths, words in chosen:
        files = [
            f
            for p in paths.split()
            for f in ([ROOT / p] if ".py" in p else ROOT.glob(p + "/**/*.py"))
        ]
        names = re.findall(r"def (test_\w+)", "\n".join(f.read_text("utf-8") for f in files))
        for word in {*words.split(" or ")} - {"NAME", "karnopp", "viscous"}:
            assert any(word in name for name in names), f"{word} names no test of {paths}"


def test_the_tables_of_reliability_are_those_of_its_tests():
    from stress.randomness import FAILED, STREAMS
    from stress.test_reliability import MUST

    *seen, (_, versions, _) = table("reliability.csv")
    assert [row[:2] for row in seen] == [list(row) for row in MUST.items()] and all(
        row[2] for row in seen
    )
    assert "stimlib" in versions
    for case, must, test in table("reliability_elsewhere.csv"):
        assert case and must and exists(test), test
    *found, last = table("randomness.csv")
    assert {*STREAMS} <= {row[0] for row in found} and "dieharder" in last[0]
    assert all(FAILED <= float(p) <= 1 and said != "FAILED" for _, _, _, p, said in found)
