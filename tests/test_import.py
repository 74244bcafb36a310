"""What is loaded when: heavy libraries only where they are used."""

import builtins
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from devices.servers import played
from laws import STRESS

import stimlib
from stimlib.core.graph import registry
from stimlib.devices import NullSink
from stimlib.motion import minimum_jerk
from stimlib.scenes import SHIPPED
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
# what a scene is compiled and runs without
NOT_TO_RUN = {*HEAVY, "scipy.linalg", "optax", "pandas", "IPython"} - {"llvmlite"}


def loaded(code, of=HEAVY):
    text = f"{code}\nimport sys; print(*[m for m in {tuple(of)} if m in sys.modules])"
    return set(subprocess.check_output([sys.executable, "-c", text], text=True).split())


def test_definitions_scenes_and_the_interpreter_load_nothing_heavy():
    """Modules that define and read, scenes, and what runs them in Python."""
    code = """import stimlib, stimlib.motion.generators
from stimlib.files import audio, log_reader, log_writer
from stimlib.scenes import *
squeeze(), viscoelastic(), bumps(), click(), detents(), friction(), wall(), impact()
x = stimlib.Input("x")
y = stimlib.blocks.bandpass(x, 80.0, 400.0)
for block in (x * 2, stimlib.blocks.velocity(x) > 0.0, y):
    stimlib.compile(stimlib.Scene({"y": block}), 1000, target="python")"""
    assert loaded(code) == set(), "units that are written as '' need no library"
    # nor does what fits a curve, or each worker of a sweep, load what it does not use
    code += "\nstimlib.compile(squeeze(), 8000, target='python')"
    code += "\nimport stimlib.fitting.relaxation, stimlib.sweep.scheduler"
    of_fits = "scipy.optimize", "scipy.linalg", "scipy.signal", "matplotlib", "numba", "pint"
    of_all = "ssl", "http.client", "urllib.request", "numpy.ma"
    assert loaded(code, (*of_fits, *SWEEP, *of_all)) == set()


def test_a_command_starts_without_numpy_and_a_search_for_garbage():
    code = """import gc
from stimlib.__main__ import main
sys.argv = ["stimlib", "--version"]
try: main()
except SystemExit: assert gc.get_threshold()[0] >= 50_000"""
    said = {"stimlib", stimlib.__version__}
    assert loaded(f"import sys\n{code}", ("numpy", "rich")) == said | {"rich"}


def test_a_scene_file_defines_its_own_classes_alone():
    assert all(hasattr(stimlib.blocks, name) for name in stimlib.blocks.__all__)  # all are there
    made = {n for n, c in registry.items() if c.__module__.startswith("stimlib.blocks.")}
    code = "from stimlib.core.scene import _define, registry"
    code = f"{code}\n_define({made!r})\nassert {made!r} <= registry.keys(), registry.keys()"
    assert loaded(code) == set() and len(made) > 80
    few = "bumps", "contact", "friction", "viscoelastic"
    read = f"import stimlib; stimlib.Scene.from_dict({SHIPPED['wall']().to_dict()!r})"
    assert loaded(read, (f"stimlib.blocks.{m}" for m in few)) == {
        "stimlib.blocks.contact",
        "stimlib.blocks.friction",
    }


def test_a_scene_compiles_and_runs_without_numba_and_all_else(tmp_path, monkeypatch):
    """Twice: into an empty cache, and from there; then without the compiler, too."""
    monkeypatch.setenv("STIMLIB_CACHE", str(tmp_path))
    tmp_path.chmod(0o700)
    code = """import sys
sys.modules["numba"] = None
import numpy as np, stimlib
scene = stimlib.Scene({"y": stimlib.Param("k", 1.0, "N/m") * stimlib.Input("x", "m")})
stimlib.compile(scene, 1000).process(np.ones((1, 8)))
del sys.modules["numba"]"""
    assert loaded(code, NOT_TO_RUN) == set() and any(tmp_path.glob("runtime_*"))
    code = "import llvmlite.binding as llvm\nllvm.create_pass_builder = None\n" + code
    assert loaded(code, NOT_TO_RUN) == set()


# what a command, or the render of a shipped scene, loads beyond numpy, typer and rich
LOADS = {
    "--help": "",
    "list": "",
    "show squeeze": "",
    "devices": "jack sounddevice",
    "render squeeze --motion minimum_jerk() --seconds 0.05 --out b.wav": "llvmlite soundfile",
    "replay log": "llvmlite",
    "play tone --sink null --seconds 0.05": "llvmlite stimlib.devices.sink",
    "verify --log log": "llvmlite scipy",
    "verify noise.wav": "llvmlite scipy scipy.linalg scipy.special soundfile",
    "verify a.wav": "llvmlite scipy soundfile",
    **dict.fromkeys(sorted(SHIPPED) if STRESS else ["bumps", "squeeze"], "llvmlite"),
    # least squares of its noise; a spline of its map; units of its table; its modes
    "grating": "llvmlite scipy scipy.linalg scipy.optimize scipy.special",
    "soft_surface": "llvmlite scipy scipy.interpolate scipy.linalg scipy.optimize scipy.special",
    "texture": "cloudpickle dask llvmlite pint scipy",  # pint looks for dask
    "touch_screen": "llvmlite scipy scipy.interpolate scipy.linalg scipy.optimize scipy.special",
}
LOOKED_FOR = (
    *HEAVY,
    *"pydantic stimlib.devices.sink stimlib.plate.fit stimlib.motion.recorded".split(),
    *"pandas optax uvicorn serial pylsl scipy.special scipy.linalg scipy.interpolate".split(),
    *"scipy.optimize scipy.signal scipy.stats".split(),
)
# one process, of which each is a fork: what all of them load is loaded once
EACH = """
import contextlib, io, os, sys, warnings
warnings.simplefilter("ignore")
import numpy, stimlib, stimlib.cli
from stimlib.scenes import SHIPPED
def run(words):
    if words in SHIPPED:
        scene = SHIPPED[words]()
        motion = {n: (lambda t: 0.0 * t) for n in scene.inputs}
        return stimlib.render(scene, motion, fs=8000, seconds=0.01)
    sys.argv = ["stimlib", *words.split()]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        stimlib.cli.app()
each, looked_for = map(eval, sys.argv[1:])
for words in each:
    if not (child := os.fork()):
        with contextlib.suppress(SystemExit):
            run(words)
        print(words, *sorted(m for m in looked_for if m in sys.modules), sep="|", flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_what_each_command_and_scene_loads(tmp_path, monkeypatch):
    """Their CPU time is in benchmarks/results/compile.csv."""
    monkeypatch.chdir(tmp_path)
    stimlib.render(SHIPPED["tone"](), fs=8000, seconds=0.05).save("a.wav", full_scale=10.0)
    squeeze, motion = SHIPPED["squeeze"](fingers=1), {"x1": minimum_jerk()}
    stimlib.render(squeeze, motion, fs=8000, seconds=1.0).save("noise.wav", full_scale=50.0)
    played(NullSink(SHIPPED["tone"](), 10.0, log="log", clocked=False), 0.05, patience=60)
    words = [sys.executable, "-c", EACH, repr([*LOADS]), repr(LOOKED_FOR)]
    run = subprocess.run(words, capture_output=True, text=True)
    found = {name: " ".join(m) for name, *m in (s.split("|") for s in run.stdout.splitlines())}
    common = {"typer", "rich"}  # of the command line
    found = {name: " ".join(m for m in of.split() if m not in common) for name, of in found.items()}
    assert found.keys() == LOADS.keys(), run.stderr
    there = {"devices": " ".join(m for m in ("jack", "sounddevice") if m in found["devices"])}
    if "pandas" in found["texture"]:  # dask 2025.5 loads it, and what it needs
        there["texture"] = "cloudpickle dask llvmlite pandas pint pyarrow scipy"
        there["texture"] += " scipy.linalg scipy.special"
    assert found == LOADS | there, run.stderr


def test_public_names_are_there_and_hide_nothing_that_is_built_in():
    assert set(stimlib.__all__) <= set(dir(stimlib))
    exec("from stimlib import *", {})
    assert not set(stimlib.blocks.__all__) & {*dir(builtins), *sys.stdlib_module_names}
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


def test_a_package_that_is_missing_is_named_with_what_installs_it(tmp_path):
    """Each public way to it ends in one typed error with the command, in no other."""
    calls = {call: (extra, *told) for extra, of in MISSING.items() for call, *told in of.items()}
    code = """import numpy as np, sys
from stimlib.system.packages import EXTRAS
sys.modules |= dict.fromkeys(sum(map(list, EXTRAS.values()), []))
import stimlib, stimlib.demo, stimlib.sweep
from stimlib import plate, soft
from stimlib.experiments import mixed, psychometric, to_pandas
def relaxed():
    from stimlib.fitting import fit_generalized_maxwell
    t = np.linspace(0.0, 1.0, 60)
    y = np.minimum(t, 0.1)
    return fit_generalized_maxwell(t, y, y * (1 + np.exp(-t)), arms=1)
scene = stimlib.Scene({"y": stimlib.Param("k", 1.0) * stimlib.blocks.elapsed()})
result = stimlib.render(scene, fs=1000, seconds=0.01, motion={})
"""
    code += "".join(
        f"try: {call}\nexcept stimlib.MissingPackage as e: print(e)\n"
        f"except BaseException as e: print({call!r}, repr(e))\nelse: print({call!r}, 'passes')\n"
        for call in calls
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    lines = run.stdout.splitlines()
    assert len(lines) == len(calls), run.stderr + run.stdout
    for line, (extra, words) in zip(lines, calls.values(), strict=True):
        assert line.startswith(words), line
        assert line.endswith(f": pip install 'stimlib[{extra}]'"), line


def test_the_extras_bring_what_their_errors_say():
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    for extra, names in EXTRAS.items():
        brought = {re.split(r"[<>=]", r)[0] for r in project["optional-dependencies"][extra]}
        assert {PROJECTS.get(name, name) for name in names} <= brought, extra
