"""A shipped scene is whole: what is missing of one is said by file and remedy."""

import inspect
import json
import re
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

import stimlib
from stimlib import BadValue
from stimlib.checks.scenes import SCENES
from stimlib.motion.text import parse_motion
from stimlib.scenes import ROWS, SHIPPED, pulse, tone, wall
from stimlib.scenes.about import PAPERS, about, meanings

ROOT = Path(__file__).parents[2]


def test_papers_are_cited_as_in_the_docs():
    docs = " ".join(
        (ROOT / "docs/reference/papers.rst").read_text("utf-8").replace("*", "").split()
    )
    docs = docs.replace("Our copy gives the title; the rest is the publisher's record", "")
    for name, text in PAPERS.items():
        assert name in docs and all(part in docs for part in text.split(". ")), name


def test_a_page_says_what_the_parts_of_a_scene_are(monkeypatch):
    x, k = stimlib.Input("x", "m"), stimlib.Param("k", 200.0, "N/m")

    def spring(x, p, fs):
        """F = ``k`` x
        (Hooke).

        More of it.
        """

    said = about(stimlib.Scene({"force": k * x}, law=spring))
    assert said["laws"] == ["F = k x (Hooke)"] and not said["meanings"]
    both = about(stimlib.Scene.combine(a=wall(), b=tone(), c=wall()))
    assert both["felt"] == [ROWS["wall"].felt, ROWS["tone"].felt]
    assert both["meanings"] == {
        f"{part}_{name}": text
        for part, of in (("a", "wall"), ("b", "tone"), ("c", "wall"))
        for name, text in meanings(of).items()
    }
    monkeypatch.setattr(SHIPPED["wall"], "__doc__", None)  # as python -OO has it
    assert about(stimlib.Scene.combine(a=wall(), b=tone(), c=wall())) == both and both["fixed"]


def test_every_module_of_scenes_is_imported():
    folder = ROOT / "stimlib" / "scenes"
    shipped = {path.stem for path in folder.glob("*.py") if "@shipped(" in path.read_text("utf-8")}
    left = shipped - set(stimlib.scenes.__all__)
    assert not left, f"stimlib/scenes/__init__.pyi: add `from .{left} import NAME as NAME`"


def test_every_scene_has_a_law_and_every_law_a_scene():
    assert SHIPPED.keys() - SCENES.keys() == set(), (
        'write its law in its family in stimlib/checks/families, below @law_of("NAME"): see'
        " docs/howto/add_a_check.rst"
    )
    assert SCENES.keys() - SHIPPED.keys() == set(), (
        "write the scene of this name in stimlib/scenes: see docs/howto/add_a_scene.rst"
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_a_scene_keeps_its_law_and_every_argument(name):
    """In a file too, and whatever becomes of its data."""
    scene = SHIPPED[name]()
    (part,) = scene.parts
    assert part.law == name
    assert list(part.given) == list(inspect.signature(SHIPPED[name]).parameters)
    kept = stimlib.Scene.from_dict(json.loads(json.dumps(scene.to_dict(), allow_nan=False)))
    scene.to_dict()["law"][0]["given"].clear()
    assert kept.hash == scene.hash and kept.parts == (part,)


def test_an_argument_that_was_given_or_replaced_is_kept():
    assert SHIPPED["wall"](500.0, at=0.01).parts[0].given == {
        "k": 500.0,
        "b": 2.0,
        "at": 0.01,
        "contact": False,
    }
    kept = SHIPPED["soft_surface"](mode="deformation").parts[0].given
    assert kept["mode"] == "deformation" and kept["S"] is not None


@pytest.mark.filterwarnings("ignore:touch_screen.* are held")
@pytest.mark.parametrize("name", SHIPPED)
def test_the_row_drives_every_input_and_the_law_sees_every_output(name):
    scene, row = SHIPPED[name](), ROWS[name]
    where = f"stimlib/scenes, @shipped above {name}"
    assert row.drive.keys() == scene.inputs.keys(), f"{where}: drive has a motion for each input"
    motion = {n: parse_motion(m) for n, m in row.drive.items()}
    y = stimlib.render(scene, motion, fs=8000, seconds=0.6)
    still = [n for n in y.scene.outputs if np.ptp(y[n]) == 0]
    assert not still, f"{where}: drive leaves {still} constant"
    report = stimlib.verify(scene, motion, y)
    assert report.passed, str(report)
    where = f"stimlib/checks, law of {name}"
    assert report.evidence.numbers, f"{where}: a.say() the numbers that it has"
    of_law = [c.name for c in report.checks if c.group == "d"]
    unseen = [n for n in scene.outputs if not any(n in c for c in of_law)]
    assert not unseen, f"{where}: it says nothing of {unseen}"


@pytest.mark.parametrize("name", SHIPPED)
def test_the_row_is_for_readers_and_a_page_tells_of_the_scene(name):
    scene, row = SHIPPED[name](), ROWS[name]
    where = f"stimlib/scenes, @shipped above {name}"
    assert re.search(r" \(.+\)$", row.words), f"{where}: words ends with its source in parentheses"
    lacks = scene.params.keys() - meanings(name).keys()
    assert not lacks, f"stimlib/scenes, docstring of {name}: say `live as ``{lacks}``` of one"
    assert row.do and row.felt, f"{where}: do and felt say what one does and feels"
    known = {n.rstrip("0123456789") for n in (*scene.inputs, *scene.params)}
    unknown = {n for n in row.ranges if n.rstrip("0123456789") not in known}
    assert not unknown, f"{where}: ranges of {unknown}, which it lacks"
    page = ROOT / "docs" / "reference" / "scenes" / f"{name}.rst"
    assert page.is_file(), f"write {page}, as wall.rst beside it"
    last = f".. autofunction:: stimlib.scenes.{name}\n"
    assert last in page.read_text("utf-8"), f"{page}: end with `{last}`"


def test_tone_and_pulse_begin_as_they_are_described():
    """0.5 s in each second, and 5 ms in each half second, on one channel."""
    y = stimlib.render(tone(), fs=1000, seconds=2.5)
    assert y.outputs == ("signal",) and np.abs(y["signal"]).max() == pytest.approx(0.5, abs=2e-3)
    heard = np.flatnonzero(y["signal"]) / 1000
    assert heard.min() < 0.004 and not ((heard % 1) > 0.5).any()
    assert {int(t) for t in heard} == {0, 1, 2} and heard[heard < 1].max() > 0.49
    p = stimlib.render(pulse(), fs=1000, seconds=1.2)
    at = [k + start for start in (0, 500, 1000) for k in range(5)]
    assert p.outputs == ("signal",) and np.flatnonzero(p["signal"] == 0.5).tolist() == at


@pytest.mark.parametrize("make", [tone, pulse])
def test_a_burst_ends_before_the_next_begins(make):
    make(duration=2.0, period=1.0, repeats=1)
    make(duration=0.5, period=0.5)
    refused(BadValue, "ends before the next", make, duration=2.0, period=1.0, repeats=2)
