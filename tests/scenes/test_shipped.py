"""A shipped scene is whole: what is missing of one is said by file and remedy."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

import stimlib
from stimlib.checks.scenes import SCENES
from stimlib.motion.text import parse_motion
from stimlib.scenes import ROWS, SHIPPED

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("path", sorted((ROOT / "stimlib" / "scenes").glob("*.py")))
def test_every_module_of_scenes_is_imported(path):
    if "@shipped(" in path.read_text():
        assert path.stem in vars(stimlib.scenes), (
            f"stimlib/scenes/__init__.py: add `from .{path.stem} import NAME as NAME`"
        )


def test_every_scene_has_a_law_and_every_law_a_scene():
    assert SHIPPED.keys() - SCENES.keys() == set(), (
        'write its law in a module of stimlib/checks, below @law_of("NAME"), and name a new module'
        " in MODULES of stimlib/checks/scenes.py: see docs/howto/add_a_check.rst"
    )
    assert SCENES.keys() - SHIPPED.keys() == set(), (
        "write the scene of this name in stimlib/scenes: see docs/howto/add_a_scene.rst"
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_a_scene_keeps_its_law_and_every_argument(name):
    where = f"stimlib/scenes: end {name} with Scene(.., law={name!r}, given=given)"
    (part,) = SHIPPED[name]().parts
    assert part.law == name, where
    arguments = inspect.signature(SHIPPED[name]).parameters
    assert part.given.keys() == arguments.keys(), f"{where}, and begin with given = dict(locals())"


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
    of_law = [c.name for c in report.checks if c.group == "d"]
    assert report.evidence.numbers, (
        f"stimlib/checks, law of {name}: a.say() the numbers that it has"
    )
    unseen = [n for n in scene.outputs if not any(n in c for c in of_law)]
    assert not unseen, f"stimlib/checks, law of {name}: it says nothing of {unseen}"


@pytest.mark.parametrize("name", SHIPPED)
def test_the_row_is_for_readers_and_pages(name):
    scene, row = SHIPPED[name](), ROWS[name]
    assert re.search(r" \(.+\)$", row.words), (
        f"stimlib/scenes, @shipped above {name}: words ends with its source in parentheses"
    )
    known = {n.rstrip("0123456789") for n in (*scene.inputs, *scene.params)}
    unknown = {n for n in row.ranges if n.rstrip("0123456789") not in known}
    assert not unknown, (
        f"stimlib/scenes, @shipped above {name}: ranges of {unknown}, which it lacks"
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_a_scene_has_a_page(name):
    page = ROOT / "docs" / "reference" / "scenes" / f"{name}.rst"
    assert page.is_file(), f"write docs/reference/scenes/{name}.rst, as wall.rst beside it"
    assert f".. autofunction:: stimlib.scenes.{name}\n" in page.read_text(), (
        f"docs/reference/scenes/{name}.rst: end with `.. autofunction:: stimlib.scenes.{name}`"
    )
