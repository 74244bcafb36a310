"""What is loaded when: heavy libraries only where they are used."""

import builtins
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from stimlib.system.packages import EXTRAS, PROJECTS

SWEEP = ("pyarrow", "dask", "distributed", "cloudpickle")
HEAVY = (
    "numba",
    "jax",
    "scipy",
    "pint",
    "matplotlib",
    "soundfile",
    "llvmlite",
    "rich",
    "typer",
    "jack",
    "sounddevice",
    *SWEEP,
)
NOT_TO_RUN = {*HEAVY, "scipy.linalg", "numba.np.linalg", "optax", "pandas", "IPython"} - {
    "numba",
    "llvmlite",
    "scipy",
}
"""What a compiled scene runs without; numba asks scipy for its version."""


def loaded(code, of=HEAVY):
    text = f"{code}\nimport sys; print(*[m for m in {tuple(of)} if m in sys.modules])"
    return set(
        subprocess.run(
            [sys.executable, "-c", text], capture_output=True, text=True, check=True
        ).stdout.split()
    )


def test_import_loads_nothing_heavy():
    assert loaded("import stimlib") == set()


@pytest.mark.parametrize(
    "module",
    [
        "stimlib.blocks",
        "stimlib.core.graph",
        "stimlib.core.scene",
        "stimlib.run.processor",
        "stimlib.core.maths",
        "stimlib.files.audio",
        "stimlib.files.log_writer",
        "stimlib.files.log_reader",
        "stimlib.motion.generators",
    ],
)
def test_definitions_load_no_target(module):
    assert loaded(f"import {module}") == set()


def test_building_a_scene_loads_no_target():
    code = "import stimlib; stimlib.Scene({'y': stimlib.blocks.velocity(stimlib.Input('x')) > 0.0})"
    assert loaded(code) == set(), "units that are written as '' need no library"
    assert (
        loaded("import stimlib; from stimlib.scenes import *; squeeze(), viscoelastic(), bumps()")
        == set()
    )
    assert (
        loaded("from stimlib.scenes import *; click(), detents(), friction(), wall(), impact()")
        == set()
    )


def test_the_packages_of_sweeps_are_loaded_where_they_are_used():
    assert loaded("import stimlib.sweep.engines", (*SWEEP, "scipy.signal")) == set(), (
        "nor does each worker load what proofs use"
    )
    code = """import sys; sys.modules["pyarrow"] = None
import stimlib.sweep
scene = stimlib.Scene({"y": stimlib.Input("x") * 1})
try: stimlib.sweep.sweep(scene, {"seed": [1]}, motion=abs, measures="rms", fs=1000)
except stimlib.MissingPackage as e: print(e)"""
    assert {"pyarrow,", "install", "'stimlib[sweep]'"} <= loaded(code)


def test_the_interpreter_needs_no_compiler():
    code = (
        "import stimlib; stimlib.compile(stimlib.Scene({'y': stimlib.Input('x') * 2}), 1000,"
        " target='python')"
    )
    assert loaded(code) == set()


def test_what_was_compiled_before_runs_without_the_compiler_and_all_else():
    code = """import numpy as np, stimlib
scene = stimlib.Scene({"y": stimlib.Param("k", 1.0, "N/m") * stimlib.Input("x", "m")})
stimlib.compile(scene, 1000).process(np.ones((1, 8)))"""
    exec(code, {})  # into the cache
    assert loaded(code, NOT_TO_RUN) == set()
    # which numba loads then
    more = "import numba\nassert numba.njit(lambda x: np.dot(x, x))(np.ones(3)) == 3.0"
    assert loaded(f"{code}\n{more}", NOT_TO_RUN) == {"numba.np.linalg", "scipy.linalg"}


def test_a_squeeze_loads_no_network_and_no_masked_arrays():
    code = "import stimlib; stimlib.compile(stimlib.scenes.squeeze(), 8000, target='python')"
    assert loaded(code, ("ssl", "http.client", "urllib.request", "numpy.ma")) == set()


def test_a_low_pass_filter_loads_no_scipy():
    scene = "stimlib.Scene({'y': stimlib.blocks.bandpass(stimlib.Input('x'), 80.0, 400.0)})"
    code = f"import stimlib; stimlib.compile({scene}, 8000, target='python')"
    assert loaded(code, ("scipy",)) == set()


def test_a_command_does_not_search_for_garbage_while_it_starts():
    code = """import gc, sys
from stimlib.__main__ import main
sys.argv = ["stimlib", "--version"]
try: main()
except SystemExit: print(gc.get_threshold()[0] >= 50_000)"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("True\n")


def test_help_needs_no_numpy():
    assert loaded("import stimlib.cli", ("numpy", "rich")) == {"rich"}


def test_every_public_name_is_there():
    code = (
        "import stimlib; [getattr(stimlib, n) for n in stimlib.__all__]; assert"
        " set(stimlib.__all__) <= set(dir(stimlib))"
    )
    loaded(code)
    loaded("from stimlib import *")


def test_a_star_hides_nothing_that_is_built_in():
    from stimlib import blocks

    assert not set(blocks.__all__) & {*dir(builtins), *sys.stdlib_module_names}


def test_an_unknown_name_is_an_attribute_error():
    import stimlib

    with pytest.raises(AttributeError, match="squeze"):
        _ = stimlib.squeze


MISSING = {
    "plot": {
        "result.plot()": "a picture needs the package matplotlib",
        "stimlib.draw(scene, 'graph.png')": "a picture of a graph needs the package matplotlib",
        "stimlib.verify(scene, {}, result).to_html('a.html')": "a page",
        "next(stimlib.demo.demo('demo'))": "the demo",
        "soft.picture(result)": "a picture",
        "soft.film(result, 'a.gif')": "a film",
        "soft.image('a.png', width=0.01)": "a map from a picture",
        "psychometric([1, 2, 3], [1, 5, 9], [10] * 3).plot()": "a picture",
        "bench.picture([], 'a.png')": "a picture",
        "relaxed().plot('a.png')": "a picture",
    },
    "fit": {
        "stimlib.compile(scene, 1000, 'jax')": "target='jax' needs the package jax",
        "stimlib.fit(scene, {}, [0.0], {'k': 1.0}, fs=1000)": "fit needs the package jax",
        "plate.fit_frame(plate.Plate.paper(), {0: 158.0})": "fit_frame needs the package jax",
    },
    "sweep": {
        "stimlib.sweep.sweep(scene, {'seed': [1]}, motion={}, measures='rms', fs=1000)": "a sweep",
    },
    "live": {"scene.live()": "the live page"},
    "experiments": {
        "mixed({'participant': [1, 2], 'y': [1.0, 2.0]}, 'y ~ 1')": "mixed needs the package",
        "to_pandas([psychometric([1, 2, 3], [1, 5, 9], [10] * 3)])": "a table of results",
    },
    "lab": {
        "stimlib.devices.lsl_markers()": "lsl_markers needs the package pylsl",
        "stimlib.devices.lsl_motion('hand')": "lsl_motion needs the package pylsl",
        "stimlib.devices.lsl_streams()": "lsl_streams needs the package pylsl",
        "stimlib.devices.serial_markers('/dev/null', {})": "serial_markers needs the package pyser",
        "stimlib.devices.serial_motion('/dev/null')": "serial_motion needs the package pyserial",
    },
}


@pytest.mark.parametrize("extra", MISSING)
def test_a_package_that_is_missing_is_named_with_what_installs_it(extra, tmp_path):
    """Each public way to it ends in one typed error with the command, in no other."""
    calls = MISSING[extra]
    code = f"""import numpy as np, sys
from stimlib.system.packages import EXTRAS
sys.modules |= dict.fromkeys(EXTRAS[{extra!r}])
import stimlib, stimlib.demo, stimlib.sweep
from stimlib import plate, soft
from stimlib.experiments import mixed, psychometric, to_pandas
from stimlib.speed import bench
def relaxed():
    from stimlib.fitting import fit_generalized_maxwell
    t = np.linspace(0.0, 1.0, 60)
    y = np.minimum(t, 0.1)
    return fit_generalized_maxwell(t, y, y * (1 + np.exp(-t)), arms=1)
scene = stimlib.Scene({{"y": stimlib.Param("k", 1.0) * stimlib.blocks.elapsed()}})
result = stimlib.render(scene, fs=1000, seconds=0.01, motion={{}})
"""
    code += "".join(
        f"try: {call}\nexcept stimlib.MissingPackage as e: print(e)\n"
        f"except BaseException as e: print({call!r}, repr(e))\nelse: print({call!r}, 'passes')\n"
        for call in calls
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    lines = run.stdout.splitlines()
    assert len(lines) == len(calls), run.stderr + run.stdout
    for line, words in zip(lines, calls.values(), strict=True):
        assert line.startswith(words), line
        assert line.endswith(f": pip install 'stimlib[{extra}]'"), line


def test_the_extras_bring_what_their_errors_say():
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    for extra, names in EXTRAS.items():
        brought = {re.split(r"[<>=]", r)[0] for r in project["optional-dependencies"][extra]}
        assert {PROJECTS.get(name, name) for name in names} <= brought, extra
