"""What is loaded when: heavy libraries only where they are used."""

import subprocess
import sys

import pytest

HEAVY = ("numba", "jax", "scipy", "pint", "matplotlib", "soundfile", "llvmlite", "rich", "typer", "jack", "sounddevice")

WITH_UNITS = {"pint", "scipy"}  # pint itself loads scipy where there is one


def loaded(code):
    text = f"{code}\nimport sys; print(*[m for m in {HEAVY} if m in sys.modules])"
    return set(subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True).stdout.split())


def test_import_loads_nothing_heavy():
    assert loaded("import stimlib") == set()


@pytest.mark.parametrize(
    "module", ["stimlib.blocks", "stimlib.core.graph", "stimlib.core.scene", "stimlib.run.processor", "stimlib.core.maths"]
)
def test_definitions_load_no_target(module):
    assert loaded(f"import {module}") == set()


def test_building_a_scene_loads_no_target():
    code = "import stimlib; stimlib.Scene({'y': stimlib.blocks.velocity(stimlib.Input('x')) > 0.0})"
    assert loaded(code) == set(), "units that are written as '' need no library"
    assert loaded("import stimlib; stimlib.scenes.squeeze()") <= WITH_UNITS


def test_the_interpreter_needs_no_compiler():
    code = "import stimlib; stimlib.compile(stimlib.Scene({'y': stimlib.Input('x') * 2}), 1000, target='python')"
    assert loaded(code) <= WITH_UNITS


def test_every_public_name_is_there():
    code = "import stimlib; [getattr(stimlib, n) for n in stimlib.__all__]; assert set(stimlib.__all__) <= set(dir(stimlib))"
    loaded(code)
    loaded("from stimlib import *")


def test_an_unknown_name_is_an_attribute_error():
    import stimlib

    with pytest.raises(AttributeError, match="no attribute 'squeze'"):
        _ = stimlib.squeze
