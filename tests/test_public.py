"""Every function and class of the reference: arguments of a wrong kind get an error of
stimlib's that says its name.

What is public is what ``docs`` documents.  Each is called with sensible arguments, then
with each of them wrong.
"""

import dataclasses as dc
import functools
import importlib
import inspect
import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from experiments.some import QUESTION, SPRING, TASK, experiment, observer, simulate
from laws import STRESS
from scipy import signal

import stimlib
from stimlib import (
    Block,
    Input,
    RecordingError,
    SceneFileError,
    SinkError,
    StimlibError,
    blocks as b,
    constant,
)
from stimlib.design.texture import made_up
from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    Cursor,
    Stimulus,
    Trial,
    assign,
    columns,
    psychometric,
    read,
)
from stimlib.experiments.likelihood import Sets
from stimlib.experiments.papers import roughness
from stimlib.fitting import maxwell_force
from stimlib.plate import Patch, Plate, Resonance
from stimlib.run import Safety

DOCS = Path(__file__).parent.parent / "docs"


def documented() -> dict[str, object]:
    """Every function and class of the reference, by its full name."""
    names = []
    for page in sorted(DOCS.rglob("*.rst")):
        module = "stimlib"
        for line in page.read_text("utf-8").splitlines():
            if found := re.match(r"\s*\.\. currentmodule:: (\S+)", line):
                module = found[1]
            elif found := re.match(r"\s*\.\. auto(?:function|class):: (\S+)", line):
                names.append(
                    found[1] if found[1].startswith("stimlib.") else f"{module}.{found[1]}"
                )
    return {name: resolve(name) for name in dict.fromkeys(names)}


def resolve(name: str) -> object:
    """A name as Sphinx finds it: in the longest part that is a module."""
    parts = name.split(".")
    for k in range(len(parts) - 1, 0, -1):
        try:
            return functools.reduce(
                getattr, parts[k:], importlib.import_module(".".join(parts[:k]))
            )
        except ModuleNotFoundError:
            continue
    raise LookupError(name)


def test_every_argument_of_a_function_is_in_its_docstring():
    functions = {n: f for n, f in documented().items() if inspect.isfunction(f)}
    kinds = inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL
    absent = []
    for name, f in functions.items():
        _, listed, part = (inspect.getdoc(f) or "").partition("Parameters\n----------\n")
        there = re.findall(r"^(\w+)", part.replace(", ", "\n"), re.M)
        wanted = [p for p in inspect.signature(f).parameters.values() if p.kind not in kinds]
        absent += [f"{name}: {p.name}" for p in wanted if listed and p.name not in there]
    assert absent == [] and len(functions) > 200


# Sensible arguments -------------------------------------------------------------------
FS = 1000.0
X, Y, U, F, V = Input("x", "m"), Input("y", "m"), Input("u"), Input("f", "N"), Input("v", "m/s")
VOLT = constant(1.0, "V") * U
T = np.arange(400) / FS
HAND = 0.01 * (1 - np.cos(2 * np.pi * 5 * T))
FORCE = 100 * HAND + 3 * np.gradient(HAND, 1 / FS)
STEP = 0.01 * np.minimum(T / 0.02, 1.0)
HELD = maxwell_force(T, STEP, 50.0, [(100.0, 0.05)])
LEVELS, YES, ASKED = [1.0, 2.0, 3.0, 4.0], [1, 4, 7, 9], [10, 10, 10, 10]
SECONDS = np.arange(2000) / FS
SWEEP = np.sin(2 * np.pi * (50 + 50 * SECONDS) * SECONDS)
RING = signal.lfilter([1.0], [1.0, -1.12, 0.91], SWEEP)  # at 150 Hz, q = 10
PEAK = Resonance(150.0, 10.0, 0.1, 0.1, np.ones(1), np.ones(1), np.zeros(1), 99)
FIT = psychometric(LEVELS, YES, ASKED)
RUB = np.random.default_rng(1).normal(size=9000)
MODEL = made_up(2)
SOFT = stimlib.soft.array(np.eye(3))
PLATE = Plate(0.1, 0.07, 1e-3, 70e9, 0.22, 2500.0, terms=4)
PATCH = Patch(0.05, 0.03, 0.02, 0.01, -1.8e-10, 2e-4)
TRIAL = Trial(
    "silent",
    (Stimulus("spring"), Stimulus("spring")),
    ("softer",),
    2.0,
    scores={"first": 0.0, "second": 1.0},
)
TEXT = "a_1"
RUN = {"motion": {"x": HAND}, "fs": FS, "target": "python"}


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """Files and results that arguments name: a session, its log, a rendering, a scene
    file.
    """
    folder = tmp_path_factory.mktemp("public")
    simulate(folder / "data")
    result = stimlib.render(SPRING, {"x": HAND}, FS, target="python")
    SPRING.save(folder / "scene.json")
    assign(folder / "orders.json", "P01", ["A", "B"])
    return {"folder": folder, "saved": read(folder / "data/pair/P01-s1"), "rendering": result}


def arguments(made: dict) -> dict[str, dict[str, object]]:
    """Arguments without a default, by function; under "" by their names alone."""
    folder, saved, result = made["folder"], made["saved"], made["rendering"]
    answers = columns([saved])
    proc = stimlib.compile(SPRING, FS, "python")
    groups = {"a": [1.0, 2.0, 4.0, 3.0], "b": [2.0, 3.0, 5.0, 5.5]}
    return {
        "": {
            "x": X,
            "y": Y,
            "u": U,
            "f": F,
            "v": V,
            "event": U,
            "gate": U,
            "freq": 100.0,
            "q": 5.0,
            "seed": 1,
            "low": 50.0,
            "high": 100.0,
            "cutoff": 50.0,
            "psd": 1.0,
            "times": [0.1, 0.2],
            "start": 0.1,
            "duration": 0.1,
            "f0": 10.0,
            "f1": 20.0,
            "seconds": 0.1,
            "chi": 3.0,
            "alpha": 0.5,
            "elements": [(50.0, 0.01)],
            "k": 3.0,
            "value": 1.0,
            "spacing": 0.01,
            "S": SOFT,
            "distance": X,
            "depth": Y,
            "force": F,
            "chi1": 3.0,
            "alpha1": 0.3,
            "alpha2": 0.5,
            "period": 0.01,
            "taps": [0.1, 0.2],
            "tau": 0.1,
            "normal": constant(1.0, "N"),
            "arms": [(50.0, 0.1)],
            "k0": 10.0,
            "k1": 5.0,
            "samples": [0.0, 1.0, 0.0],
            "rate": 500.0,
            "parts": [(1.0, 0.7, 0.3)],
            "on": 0.5,
            "off": 0.2,
            "knots": [0.0, 1.0],
            "values": [0.0, 1.0],
            "table": np.eye(4),
            "a": U,
            "b": U,
            "c": U,
            "psd_1hz": 1.0,
            "refractory": 0.01,
            "points": [(0.0, 0.0), (0.1, 1.0)],
            "rows": [[0.2, 0.3, 0.2, 1.0, -0.5, 0.3]],
            "speed": V,
            "w": 6.0,
            "model": PLATE,
            "length": 0.1,
            "width": 0.05,
            "waveform": "square",
            "duty": 0.5,
            "amplitude": 1.0,
            "fs": FS,
            "scene": SPRING,
            "motion": {"x": HAND},
            "rendering": result,
            "proc": proc,
            "name": TEXT,
            "text": "What?",
            "condition": "silent",
            "question": "softer",
            "questions": ("softer",),
            "participant": "P01",
            "trial": TRIAL,
            "experiment": experiment(),
            "design": ConstantStimuli(((TASK, 2.0),)),
            "task": TASK,
            "observer": observer,
            "answers": answers,
            "columns": answers,
            "sessions": [saved],
            "saved": saved,
            "found": [saved],
            "safety": 10.0,
            "most": 3,
            "kind": "choice",
            "rng": np.random.default_rng(1),
            "gain": 2.0,
            "decay": 0.1,
        },
        "amplifier": {"x": VOLT},
        "clip": {"x": U, "low": 0.0, "high": 1.0},
        "compliance_kelvin_voigt": {"b": 2.0},
        "compliance_maxwell": {"b": 2.0},
        "compliance_generalized_kelvin_voigt": {"k0": 1.0},
        "cos": {"x": U},
        "creep_compliance": {"t": T, "k0": 1.0},
        "delay": {"samples": 3},
        "playback": {"rate": 500.0},
        "grain": {"rate": 500.0},
        "differentiator": {"passband": 100.0},
        "enabled": {"block": b.white_noise(1), "by": U > 0.0},
        "equalize": {"x": VOLT, "displacement": ([0.0, 0.1], [1.0, 2.0])},
        "exp": {"x": U},
        "friction": {},
        "indentation": {"force": F, "S": U},
        "kelvin_voigt": {"b": 2.0},
        "load_texture": {"path": "none"},
        "loading": {"v": V, "on": 0.5, "off": 0.2},
        "log": {"x": U},
        "loop": {"f": lambda y: 0.5 * y},
        "maxwell": {"b": 2.0},
        "springpot_series": {"k": 3.0},
        "mode_shape": {"c": [[0.5, 0.0, 0.2]]},
        "motor_current": {"motor_constant": constant(1.0, "N/A")},
        "press": {"level": U},
        "relaxation_modulus": {"t": T[1:]},
        "save_texture": {"model": MODEL, "path": folder / "texture.xml"},
        "segment": {"block": b.white_noise(1)},
        "sin": {"x": U},
        "skin_drive": {"dp": constant(1.0, "N/s") * U, "m": 1.0, "B": 1.0},
        "stimlib.blocks.texture": {"model": MODEL},
        "tanh": {"x": U},
        "vibration": {"wait": constant(0.1, "s")},
        "wall": {},
        "sqrt": {"x": U},
        # Running
        "Scene": {"outputs": {"y": X}},
        "load": {"path": folder / "scene.json"},
        "compile": {"target": "python"},
        "Processor": {"target": "python"},
        "render": RUN,
        "stream": RUN,
        "verify": {"scene": SPRING, "motion": {"x": HAND}, "rendering": result},
        "protect": {"safety": Safety(10.0)},
        "Safety": {"full_scale": 10.0},
        "definitions": {},
        "unit": {"text": "N"},
        "agreement": {},
        "draw": {},
        "fit": {"target": FORCE, "params": {"k": 2.0}},
        # Analysis
        "line_spectrum": {"rate": 10.0, "freq": 158.0, "top": 500.0},
        "sampled_rms": {"rate": 10.0, "freq": 158.0},
        "cues": {"y": HAND, "f": FORCE},
        "cues_of": {"y": HAND},
        "listen": {"output": "force", "path": folder / "a.wav"},
        "stimlib.analysis.vibration": {"y": HAND},
        "needed_damping": {"response": lambda f: 1j * f},
        "detection_threshold": {},
        "sensation_level": {"y": HAND, "unit": "m"},
        "stimlib.analysis.felt": {"mass": 0.1},
        "weighted_rms": {"acceleration": FORCE},
        "difference_steps": {"first": 1.0, "second": 2.0},
        "stimlib.design.levels.amplitude": {"level": "2 m/s^2 rms", "unit": "m/s^2"},
        "stimlib.analysis.picture": {"path": folder / "a.png"},
        "judged": {"f": np.arange(1.0, 100.0), "W": np.ones(99)},
        "tail": {"c": np.ones(5), "s": 3.0},
        "made_up": {},
        # Fitting
        "maxwell_force": {"t": T, "y": HAND},
        "springpot_force": {"t": T, "y": HAND},
        "springpot_series_force": {"t": T, "y": HAND, "k": 100.0},
        "mittag_leffler": {"x": T},
        "thin": {"t": T},
        "fit_springpot": {"t": T, "y": STEP, "f": HELD},
        "fit_generalized_maxwell": {"t": T, "y": STEP, "f": HELD, "arms": 1},
        "welch": {"x": FORCE, "segment": 64},
        "burg": {"stretches": [np.random.default_rng(1).normal(size=200)], "order": 2},
        "fit_texture": {"acceleration": RUB, "speed": 0.1 + 0 * RUB, "force": 1 + 0 * RUB},
        # Motion
        "recording": {"source": {"t_s": T, "x": HAND}, "columns": {"x": "x"}},
        "parse_source": {"text": "minimum_jerk()"},
        "parse_motion": {"text": "minimum_jerk()"},
        "parse_map": {"items": ["x=a"]},
        "parse_where": {"text": "a=b"},
        # Experiments
        "Experiment": {"version": "1", "scenes": {"spring": SPRING}, "questions": (QUESTION,)},
        "Cursor": {"input": "x"},
        "choice": {"choices": ("a", "b")},
        "rating": {"low": "smooth", "high": "rough"},
        "analogue": {"low": "smooth", "high": "rough"},
        "ranking": {"items": ("A", "B")},
        "Stimulus": {"scene": "spring"},
        "Trial": {"stimuli": (Stimulus("spring"),)},
        "Answer": {"values": {"softer": "first"}},
        "outcome": {"answer": Answer({"softer": "first"})},
        "observed": {},
        "TwoInterval": {
            "standard": Stimulus("spring"),
            "comparison": Stimulus("spring"),
            "varies": "k",
        },
        "OneInterval": {"stimuli": {"red": Stimulus("a"), "green": Stimulus("b")}},
        "Rate": {"stimulus": Stimulus("spring")},
        "Staircase": {"start": 2.0, "bounds": (0.5, 8.0)},
        "ConstantStimuli": {"items": ((TASK, 2.0),)},
        "Interleaved": {"tracks": {"a": ConstantStimuli(((TASK, 2.0),))}},
        "Sequential": {"parts": {"a": ConstantStimuli(((TASK, 2.0),))}},
        "shuffled": {"purpose": "parts", "names": ["a", "b"]},
        "turn_of": {"turns": 4},
        "assign": {"path": "orders.json", "orders": ["A", "B"]},
        "assigned": {"path": folder / "orders.json"},
        "Quest": {"levels": (1.0, 2.0), "means": (1.0, 2.0), "deviations": (0.5, 1.0)},
        "graeco_latin": {"n": 4},
        "williams": {"n": 4},
        "check_graeco_latin": {"square": stimlib.experiments.latin_squares.graeco_latin(4)},
        "Question": {"choices": ("a", "b")},
        "prompted": {"question": QUESTION},
        "followed": {"x": HAND, "cursor": Cursor("x", 0.01)},
        "Session": {"data": folder / "more"},
        "folder_of": {"experiment": "pair", "data": folder / "data"},
        "read": {"folder": folder / "data/pair/P01-s1"},
        "stimlib.experiments.sessions": {"experiment": "pair", "data": folder / "data"},
        "psychometric": {"levels": LEVELS, "yes": YES, "trials": ASKED},
        "integrated": {"values": [1.0, 2.0], "sds": [0.5, 0.3]},
        "likelihood_ratio": {
            "simple": [FIT],
            "full": [psychometric(LEVELS, YES, ASKED, lapse="free")],
        },
        "psychometrics": {
            "data": {"P01": {"level": LEVELS, "outcome": [0, 1, 0, 1], "chance": [0.5] * 4}}
        },
        "profile": {"sets": Sets(*np.array([LEVELS, YES, ASKED], float))},
        "bootstrap": {"sets": Sets(*np.array([LEVELS, YES, ASKED], float)), "n": 20},
        "fitted": {},
        "detection": {"hits": 8, "signals": 10, "false_alarms": 2, "noises": 10},
        "diagnosis": {"hits": 8, "signals": 10, "correct_rejections": 7, "noises": 10},
        "wilson": {"k": 3, "n": 10},
        "forced_choice": {"correct": 8, "trials": 10},
        "roc": {"signal": [1, 2, 3, 4], "noise": [4, 3, 2, 1]},
        "distances": {"cues": {"a": [1.0, 2.0, 3.0, 4.0]}, "answers": [0, 0, 1, 1]},
        "recorded": {"position": "x", "force": "force"},
        "displayed": {"folder": folder, "record": saved.records[0]},
        "jnd_from_dprime": {"d": [1.0, 2.0], "increment": [1.0, 2.0]},
        "line": {"x": LEVELS, "y": YES},
        "fechner": {"intensity": LEVELS, "rating": LEVELS},
        "bradley_terry": {"rankings": [("a", "b"), ("b", "a")]},
        "stevens": {"intensity": LEVELS, "rating": LEVELS},
        "shapiro": {"values": [1.0, 2.0, 4.0, 3.0]},
        "anova": {"groups": groups},
        "kruskal": {"groups": groups},
        "dunn": {"groups": groups},
        "paired": {"a": groups["a"], "b": groups["b"]},
        "repeated": {"values": np.random.default_rng(1).normal(size=(6, 3))},
        "mixed": {
            "columns": {
                "y": LEVELS * 3,
                "x": [0, 1] * 6,
                "participant": ["a"] * 4 + ["b"] * 4 + ["c"] * 4,
            },
            "formula": "y ~ x",
        },
        "PsychometricObserver": {"pse": 2.0, "sigma": 1.0},
        "Listener": {"scenes": {"spring": SPRING}, "measure": "rms", "sigma": 0.1},
        "simulate": {"participants": 1},
        "power": {
            "observer": lambda rng: observer,
            "analyse": lambda c: (1.0, 0.0),
            "participants": 1,
            "experiments": 1,
        },
        "grouped": {"by": ["condition"]},
        "times_text": {"times": {"a": [1.0, 2.0], "b": [3.0]}},
        "to_pandas": {"rows": [Answer({})], "names": ()},
        "plain": {"rows": [Answer({})], "names": ()},
        "write_report": {"path": folder / "a.html", "title": "A", "method": "B"},
        "pair_of": {"session": 1},
        "blinded": {},
        "seed_of": {"words": ("a",)},
        "stimlib.experiments.stream": {"words": ("a",)},
        "feels": {"softer": 0.5},
        "hit": {"condition": "vibration, 30 degrees", "marks": [[0.0, 0.0]]},
        "text": {"rows": []},
        "stimlib.experiments.papers.roughness.rms": {"name": next(iter(roughness.STIMULI))},
        "swing": {"name": next(iter(roughness.STIMULI))},
        "stimlib.experiments.papers.ugrip.fits": {},
        "jnds": {},
        # Files and logs
        "as_scene": {"path": folder / "none.wav"},
        "stimlib.files.read": {"path": folder / "none.wav"},
        "save": {"path": folder / "b.caf"},
        "write": {"path": folder / "c.caf", "motion": {"x": HAND}, "seconds": 0.1},
        "read_log": {"folder": folder / "none"},
        "header": {"safety": Safety(10.0)},
        # Plates and soft surfaces
        "Plate": {"thickness": 1e-3, "E": 7e10, "nu": 0.2, "rho": 2500.0},
        "Patch": {"x": 0.05, "y": 0.03, "d31": -1.8e-10, "thickness": 2e-4},
        "plate": {"voltage": VOLT, "model": dc.replace(PLATE, terms=8, patches=(PATCH,))},
        "half_sine": {"u": T},
        "amplifier_load": {"voltage": T, "capacitance": 1e-8, "fs": FS},
        "best_gain": {"rate": 10.0, "drive": 1.0},
        "envelope_behind": {"rate": 10.0},
        "identify": {"drive": SWEEP, "response": RING},
        "drift": {"found": [PEAK] * 3, "temperature": [20.0, 21.0, 23.0]},
        "read_sweep": {"source": {"t": T, "u": T, "y": T}, "drive": "u", "response": "y"},
        "array": {"levels": np.eye(3)},
        "image": {"path": folder / "none.png"},
        "stimlib.soft.nodules": {"balls": [(0.02, 0.02, 0.005, 0.01)]},
        "sides": {"left": "A1", "right": "B1"},
        "surface": {"indenters": [(0.01, 0.01, 0.002)]},
        "fit_frame": {"measured": {0: 150.0}, "vary": ("E",)},
        # Sweeps
        "grid": {"axes": {"k": [1.0, 2.0]}},
        "stimlib.sweep.measured": {"measures": "rms"},
        "measure": {"figures": {"a": "N"}},
        "stimlib.sweep.rendering": {"make": SPRING, "rows": {"k": [1.0]}, "at": 0},
        "sweep": {
            "make": SPRING,
            "rows": {"k": [1.0]},
            "measures": "rms",
            "workers": 0,
            "progress": False,
            "dry": True,
        },
    }


RESULTS = set("""
    Rendering Report Check Shows Drawing Against Recording Cues Power Effect Detection Distance
    Coefficient ForcedChoice Estimate Roc Jnds Explained Found Located Sorted Ratings Law
    Comparison Fit LikelihoodRatio MaterialFit SpringpotFit MaxwellFit Bin TextureFit FrameFit
    DifferenceThreshold
    Placement Resonance Sweep Drift FileReport PatternReport Replay SessionReport MotionFile
    SessionLog Loopback Device Saved Record Forecast Copies Levels TextureModel
    stimlib.plate.Answer Prompt
    Texts AmplifierLoad Exported Felt MotorCalibration
""".split())  # fmt: skip
"""Classes that functions return, and nobody else makes."""

ELSEWHERE = {
    "Block": "abstract",
    "above_zero": "called by scenes, with their names",
    "law_of": "enters what it is given into the table of laws",
    "FrontEnd": "a protocol",
    "Keyed": "no arguments",
    "Limits": "tests/test_system_limits.py",
    "Input": "tests/test_graph.py",
    "Param": "tests/test_graph.py",
    "LogWriter": "made by sinks",
    "ExperimentPage": "a page",
    "Server": "a page",
    "person": "answers trials of its own experiment alone",
    "jnds": "answers of its own experiment alone",
    "explained": "as jnds",
    "analysis": "as jnds",
    "comparisons": "as jnds",
    "stimlib.experiments.papers.ugrip.fits": "as jnds",
    "stimlib.experiments.papers.firmness.weber_fractions": "as jnds",
    "judged": "a step of verify",
    "tail": "a step of verify",
    "burg": "a step of fit_texture",
    "welch": "a step of fit",
    "certainty": "a step of verify",
    "write_frames": "the end of write",
    "Stream": "a page",
    "Function": "made by compile",
    "Finger": "of numbers alone, all with defaults",
}
"""Not called here, and why."""

DEVICES = re.compile(
    r"stimlib\.(speed|devices|live|demo|checks\.power|design\.fractional|motion\.generators)\b"
)
"""Need a device, a browser or long; generators check their own fields: tests/devices,
tests/live, tests/test_speed.py.
"""

PUBLIC = {
    name: made
    for name, made in documented().items()
    if not {name, name.split(".")[-1]} & (RESULTS | set(ELSEWHERE))
    and not DEVICES.match(made.__module__)
}


class Odd:
    """What no function asks for."""


MISSING = Odd()
"""What only a log or a session would have: of such functions these arguments alone are
tried.
"""


def sensible(name: str, known: dict) -> dict[str, object]:
    """Arguments with which a call is sensible."""
    given = dict(known.get(name, known.get(name.split(".")[-1], {})))
    for p in inspect.signature(PUBLIC[name]).parameters.values():
        # scenes with inputs need one
        needed = p.default is p.empty or (p.name == "motion" and name.startswith("stimlib.sweep"))
        if needed and p.name not in given and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD):
            given[p.name] = known[""].get(p.name, MISSING)
    return given


def call(name: str, given: dict):
    """Call with arguments by name; of a generator its first."""
    f, args, named = PUBLIC[name], [], dict(given)
    parameters = inspect.signature(f).parameters.values()
    if any(p.kind is p.VAR_POSITIONAL for p in parameters):
        for p in parameters:
            if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) and p.name in named:
                args.append(named.pop(p.name))
            elif p.kind is p.VAR_POSITIONAL:
                args += named.pop(p.name, ())
    for p in parameters:
        if p.kind is p.VAR_KEYWORD:
            named |= named.pop(p.name, {})
        elif p.kind is p.POSITIONAL_ONLY and p.name in named:
            args.append(named.pop(p.name))
    y = f(*args, **named)
    return next(y, None) if inspect.isgenerator(y) else y


# Wrong arguments ----------------------------------------------------------------------
VALUES = {
    "None": None,
    "text": "no such text",
    "object": Odd(),
    "list": [],
    "dict": {},
    "-1": -1,
    "1.5": 1.5,
    "nan": float("nan"),
    "True": True,
    "function": lambda *a, **k: 0.0,
    "block": V * V,
    "matrix": np.zeros((2, 3)),
    "strings": ["a", "b"],
    "objects": [("a", Odd())],
    "bytes": b"x",
    "beyond": 10**400,
    "pair": (0.1, 0.2),
    "complex": 1j,
    "odd values": {"x": Odd()},
    "set": {1},
    "odd array": np.array([Odd(), None]),
}
ROOMS = re.compile(r"stimlib\.(fitting|analysis|design|plate|experiments(?!.papers|.report))\b")
"""Where numbers that are far too large, too small or too few are tried, too."""
ENDS = 0.0, -1.0, 1e-300, 1e-160, 1e160, 1e300, np.nan, np.inf


def extremes(v) -> Iterator[tuple[str, object]]:
    """A number or a row of them at its ends, in other forms and sizes; each row of a
    table.
    """
    kind = "O" if isinstance(v, (dict, Block, bool)) else np.array(v, object).ravel()
    if isinstance(v, dict):
        for name, row in v.items():
            yield from ((f"{name}, {what}", v | {name: w}) for what, w in extremes(row))
    elif len(kind) and all(isinstance(x, (int, float)) for x in kind):
        a = np.array(v, float)
        if not a.ndim:
            yield from (
                (f"{k:g}", int(k) if isinstance(v, int) and abs(k) < 2 else k) for k in ENDS
            )
            return
        with np.errstate(all="ignore"):
            yield from ((f"times {k:g}", a * k) for k in ENDS)
        yield from ((f"last {k:g}", np.r_[a.ravel()[:-1], k].reshape(a.shape)) for k in ENDS)
        forms = a.tolist(), a.round().astype(int), a[:0], a[:1], a[:2], a[None], np.float64(1.0)
        yield from ((f"form {k}", form) for k, form in enumerate(forms))


SAFE = {  # of each plain kind, what it takes or may take: all others must be refused
    "float": {"-1", "1.5"},
    "int": {"-1", "beyond"},
    "bool": {"True"},
    "str": {"text"},
    "None": {"None"},
    "Block": {"-1", "1.5", "block"},
    "str | os.PathLike": {"text"},
}


def refused(annotation: str) -> set[str]:
    """Names of the values that an annotation of plain kinds rules out; none of any
    other annotation.
    """
    kinds = [
        k.strip()
        for k in (
            annotation.replace("os.PathLike[str]", "str").replace("os.PathLike", "str").split("|")
        )
    ]
    return (
        set(VALUES) - set().union(*(SAFE[k] for k in kinds))
        if all(k in SAFE for k in kinds)
        else set()
    )


MAY_FAIL = set(
    """
    load_texture as_scene stimlib.files.read read_log image displayed ratings
    found located spent sorted_rightly text cues_text recorded
    """.split()
)
"""Whose sensible arguments would be a file or the data of a whole experiment: here they
are refused, too.
"""


def tried(name: str, known: dict) -> list[str]:
    """What is wrong with a function: sensible arguments that it refuses, and values of
    another kind that it takes, or refuses without its name.
    """
    short, given, wrong = name.split(".")[-1], sensible(name, known), []
    lacking = any(v is MISSING for v in given.values())
    # it runs when its values are asked for
    late = inspect.isgeneratorfunction(inspect.unwrap(PUBLIC[name]))
    rooms = ROOMS.match(PUBLIC[name].__module__)
    warnings.simplefilter("error" if rooms else "ignore", RuntimeWarning)
    if not lacking and not {name, short} & MAY_FAIL:
        call(name, given)
    for place, p in enumerate(inspect.signature(PUBLIC[name]).parameters.values()):
        if lacking and given.get(p.name) is not MISSING:
            continue
        if p.kind is p.VAR_KEYWORD and p.annotation == "Any":
            continue  # options of another function: an unknown one is Python's own error
        must = refused(p.annotation) if isinstance(p.annotation, str) else set()
        if isinstance(p.default, float) and not np.isfinite(p.default):
            must = must - {"nan"}
        # a third of them, others of other parameters
        values = VALUES | dict(extremes(given.get(p.name, p.default)) if rooms else ())
        for what in list(values) if STRESS else list(values)[(place + len(name)) % 3 :: 3]:
            value = values[what]
            if value is p.default:
                continue  # which is what the sensible call has
            put = {p.VAR_POSITIONAL: (value,), p.VAR_KEYWORD: {"some": value}}.get(p.kind, value)
            try:
                call(name, sensible(name, known) | {p.name: put})
            except (RecordingError, SceneFileError, SinkError):
                pass  # which name the file or the device
            except StimlibError as e:
                if not late and not str(e).lower().startswith(short.lower()):
                    wrong.append(f"{name}: {p.name} = {what}: the name is missing in: {e}")
            except Exception as e:
                # a warning in the function's own words says what it doubts
                if not isinstance(e, RuntimeWarning) or not str(e).startswith(f"{short}: "):
                    wrong.append(f"{name}: {p.name} = {what}: {type(e).__name__}: {e}")
            else:
                if what in must:
                    wrong.append(f"{name}: {p.name} = {what} is taken, not {p.annotation}")
    return wrong


@pytest.mark.parametrize("module", sorted({f.__module__ for f in PUBLIC.values()}))
@pytest.mark.filterwarnings("ignore")
def test_an_argument_of_a_wrong_kind_is_refused_by_the_name_of_the_function(
    module, made, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # where some texts are paths
    names = [name for name, f in PUBLIC.items() if f.__module__ == module]
    known = arguments(made)
    wrong = [said for name in names for said in tried(name, known)]
    assert not wrong, "\n".join(wrong)


def test_blocks_are_documented():
    assert {f"stimlib.blocks.{n}" for n in b.__all__} <= set(PUBLIC) | {
        "stimlib.blocks.deformation"
    }
    assert Block not in PUBLIC.values()
