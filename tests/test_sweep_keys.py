"""By what a row is known again: whatever changes its figures changes its key, and
making the same thing again does not.
"""

import dataclasses
import functools
import importlib
import importlib.metadata
import json
import os
import re
import subprocess
import sys
import types
import typing
from collections import deque

import numba
import numpy as np
import pandas
import pyarrow
import pytest
import scipy.signal
from refusals import refused
from scipy.interpolate import CubicSpline
from scipy.stats import norm

from stimlib import BadValue, Block, Input, Param, Scene, UnknownName, constant
from stimlib.motion.generators import minimum_jerk
from stimlib.sweep import grid, measure, sweep
from stimlib.sweep.identity import identity
from stimlib.sweep.keys import motion_digest, row_keys
from stimlib.sweep.rows import table_of
from stimlib.sweep.store import Store
from stimlib.sweep.study import planned

RUN = {"motion": np.ones(400), "fs": 8000, "progress": False, "workers": 0}
SPRING = Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")})


class Hand:
    def __init__(self, depth):
        self.depth = depth

    def __call__(self, t):
        return self.depth * t

    def back(self, t):
        return -self.depth * t


def level(run, low=0.0, high=1.0):
    return low + high


def of(value):
    return lambda run: value


def ring(length):
    """Return a list in a list; the inner one holds itself, or the outer one."""
    inner: list = []
    outer = [inner]
    inner.append((inner, outer)[length - 1])
    return outer


def guarded(a, b):
    try:
        return a(b)
    except ZeroDivisionError:
        return b


def partial_of(k):
    return functools.update_wrapper(functools.partial(level, low=k), level)


def with_number(f, k):
    f.k = k
    return f


def of_child(shared):
    """Return a function of a tree: the child of the second branch is that of the first,
    or one of its own.
    """
    root, branch = (types.SimpleNamespace() for _ in range(2))
    root.a, root.b, branch.level = types.SimpleNamespace(up=root), branch, 1.0
    branch.child = root.a if shared else types.SimpleNamespace(up=branch)
    return lambda run: root.b.child.up.b


guarded_nowhere = types.FunctionType(guarded.__code__.replace(co_exceptiontable=b""), globals())


def own_block(k):
    @dataclasses.dataclass(frozen=True, eq=False)
    class Own(Block):
        x: Block

        def design(self, fs):
            return k, ()

        @staticmethod
        def step(p, s, x):
            return p * x, ()

    return Own(Input("x"))


def named_array(array):
    return lambda run: array.sum()


class Rows(list):
    """A list of one's own."""


class Names(set):
    """A set of one's own."""


def scene_of_own(gain):
    return type("Own", (Scene,), {"level": lambda self: gain})({"y": 1.0 * Input("x")})


def private_module(gain):
    module = types.ModuleType("of_private")
    module.__gain = gain
    return module


TABLES = [{"x": np.zeros(5000)}, {"x": np.zeros(5000)}]
TABLES[1]["x"][2500] = 1.0
CACHED = [functools.cache(lambda t: t), functools.cache(lambda t: 2 * t)]
COMPILED = [numba.njit(lambda t: t), numba.njit(lambda t: 2 * t)]
PAIRS = {
    "splines": (CubicSpline([0, 1, 2], [0, 1, 2]), CubicSpline([0, 1, 2], [0, 1, 3])),
    "objects": (Hand(0.01), Hand(0.02)),
    "methods": (Hand(0.01).back, Hand(0.02).back),
    "methods by name": (Hand(0.01).back, Hand(0.01).__call__),
    "ufuncs": (np.sin, np.cos),
    "lambdas of one line": (lambda t: 0.01 * t, lambda t: 0.02 * t),
    "cached": tuple(CACHED),
    "keywords": (functools.partial(level, low=1, high=2), functools.partial(level, high=1, low=2)),
    "large arrays in a dict": tuple(map(of, TABLES)),
    "named splines": (of(CubicSpline([0, 1, 2], [0, 1, 2])), of(CubicSpline([0, 1, 2], [0, 1, 3]))),
    "named compiled functions": tuple(map(of, COMPILED)),
    "scenes": (of(Scene({"y": constant(1.0) * 2})), of(Scene({"y": constant(1.0) * 3}))),
    "blocks": (of(2.0 * Input("x")), of(3.0 * Input("x"))),
    "defaults": (lambda run, a=TABLES[0]: a, lambda run, a=TABLES[1]: a),
    "types of arrays": (np.zeros(2), np.zeros(2, np.int64)),
    "shapes of arrays": (np.zeros((2, 3)), np.zeros((3, 2))),
    "types of numbers": (np.float32(1.0), np.float64(1.0)),
    "setters": tuple(property(level, lambda run, v, k=k: k) for k in (1.0, 2.0)),
    "cached properties": tuple(functools.cached_property(of(k)) for k in (1.0, 2.0)),
    "what handles an exception": (guarded, guarded_nowhere),
    "attributes": (lambda run: run.fs, lambda run: run.seed),
    "names of arguments": (lambda low, high: low - high, lambda high, low: high - low),
    "names of keywords": (lambda *, low, high: low - high, lambda *, high, low: high - low),
    "kinds of arguments": (lambda *a: a, lambda **a: a),
    "locals by name": (lambda run: [locals() for a in "x"], lambda run: [locals() for b in "x"]),
    "defaults of keywords": (lambda run, *, a=1.0: a, lambda run, *, a=2.0: a),
    "arrays called as a function of numpy": (named_array(np.zeros(2)), named_array(np.ones(2))),
    "metaclasses": tuple(
        of(type("M", (type,), {"__call__": f})("C", (), {})) for f in (of(1.0), of(2.0))
    ),
    "what a compiled method is of": (of([1.0].count), of([2.0].count)),
    "names of compiled methods": (of([1.0].count), of([1.0].index)),
    "blocks of one's own": tuple(of(Scene({"y": own_block(k)})) for k in (1.0, 2.0)),
    "lists of one's own": (of(Rows([1.0])), of(Rows([2.0]))),
    "options of a compiled function": (of(numba.njit(level)), of(numba.njit(fastmath=True)(level))),
    "patterns": (of(re.compile("a")), of(re.compile("b"))),
    "globals of a nested function": tuple(
        eval("lambda r: lambda: lambda: K", {"K": k}) for k in (1, 2)
    ),
    "lists and tuples": (of([1.0]), of((1.0,))),
    "what wraps a function of numpy": tuple(functools.wraps(np.sum)(of(k)) for k in (1.0, 2.0)),
    "versions that are stated": tuple(measure("N", version=v)(level) for v in "12"),
    "getters": tuple(property(of(k)) for k in (1.0, 2.0)),
    "views of arrays": (np.arange(4.0)[:3:2], np.arange(4.0)[1::2]),
    "where a cycle closes": (ring(1), ring(2)),
    "queues behind others": tuple(
        of([deque([k]) for k in (*range(20), last)]) for last in (20, 21)
    ),
    "units of one version": tuple(measure(u, version="1")(level) for u in ("N", "m")),
    "names of one version": tuple(measure("N", version="1")(f) for f in (level, guarded)),
    "keywords of a partial that has the name of its function": tuple(map(partial_of, (1.0, 2.0))),
    "attributes of what is cached": tuple(
        with_number(functools.cache(of(0.0)), k) for k in (1.0, 2.0)
    ),
    "types in compiled functions": tuple(
        numba.njit(locals={"low": t})(level) for t in (numba.float32, numba.float64)
    ),
    "names of functions": (of(level), of(guarded)),
    "scenes of a class of one's own": (of(scene_of_own(1.0)), of(scene_of_own(2.0))),
    "sets of one's own": (of(Names("abc")), of(Names("abd"))),
    "private numbers of a module": (of(private_module(1.0)), of(private_module(2.0))),
    "children of another parent": tuple(map(of_child, (True, False))),
    "what is prepared": tuple(
        measure("N", prepare=lambda x, fs, g=g: g)(level) for g in (1.0, 2.0)
    ),
}


@pytest.mark.parametrize("name", PAIRS)
def test_what_does_something_else_is_something_else(name):
    one, other = PAIRS[name]
    assert identity(one, name) != identity(other, name)


def test_compiled_functions_of_other_signatures_are_others():
    """Compiled as they are made: not in the table above, which each worker makes."""
    one, other = (numba.njit(f"{t}(float64)")(lambda low: low) for t in ("float32", "float64"))
    assert identity(one, "f") != identity(other, "f")


def test_the_same_made_again_is_the_same():
    for make in (
        lambda: CubicSpline([0, 1, 2], [0, 1, 3]),
        lambda: Hand(0.01).back,
        lambda: of({"b": np.ones(3), "a": {"x", "y"}}),
        lambda: of(scene_of_own(1.0)),
    ):
        assert identity(make(), "f") == identity(make(), "f")
    assert identity({0, 8}, "f") == identity({8, 0}, "f"), "sets that are listed in another order"
    assert identity(of(Names("abc")), "f") == identity(of(Names("cba")), "f")
    one, same = Hand(0.01), Hand(0.01)
    one.width, one.height, same.height, same.width = 1.0, 2.0, 2.0, 1.0
    assert identity(one, "f") == identity(same, "f"), "attributes that were set in another order"
    before, kept = identity(lambda run: norm.cdf(run.fs), "f"), norm.random_state
    norm.random_state = 1  # of numpy's as a rule, which whoever draws changes
    assert identity(lambda run: norm.cdf(run.fs), "f") == before, "what a package made"
    norm.random_state = kept


USES = {
    "an attribute": "import own_study.helper as h\ndef f(r): return h.level(r)",
    "the module itself": "import own_study.helper as h\ndef f(r): return vars(h)",
    "a submodule that is passed on": (
        "import own_study.helper\ndef g(m): return m.level\ndef f(r): return g(own_study.helper)"
    ),
    "a submodule's dict": (
        "import own_study.helper\ndef f(r): return own_study.helper.__dict__[''.join(['lev',"
        " 'el'])]"
    ),
    "a property of the module": "import own_study.helper as h\ndef f(r): return h.other",
    "a submodule": "import own_study.helper\ndef f(r): return own_study.helper.level(r)",
    "a late import": "def f(r):\n    import own_study.helper as h\n    return h.level(r)",
    "a late name": "def f(r):\n    from own_study.helper import level\n    return level(r)",
    "a late submodule": (
        "def f(r):\n    import own_study.helper\n    return own_study.helper.level(r)"
    ),
    "a late relative name": "def f(r):\n    from .helper import level\n    return level(r)",
    "a late name after 300 others": (
        "def f(r):\n"
        + "".join(f"    r.n{n} = {n}.5\n" for n in range(300))
        + "    from .helper import level\n    return level(r)"
    ),
    "a number of the package": (
        "def f(r):\n    import own_study.helper\n    return own_study.number"
    ),
    "one that may be missing": (
        """
import own_study.helper as h
def f(r):
    try:
        import no_such_package
    except ImportError:
        return h.level(r)
"""
    ),
    "a module's __getattr__": "import own_study.helper as h\ndef f(r): return h.other",
}


def own_study(monkeypatch, text, **attributes):
    """Let own_study.helper be a module with this text and these attributes; return
    it.
    """
    package, helper = types.ModuleType("own_study"), types.ModuleType("own_study.helper")
    package.__path__, package.helper = [], helper
    vars(helper).update(attributes)
    exec(text, vars(helper))
    monkeypatch.setitem(sys.modules, "own_study", package)
    monkeypatch.setitem(sys.modules, "own_study.helper", helper)
    return helper


def assert_counts(made, what=""):
    """What is made of 1 is not what is made of 2, and that is the same again."""
    one, two, again = (identity(made(k), "f") for k in (1, 2, 2))
    assert one != two == again, what


@pytest.mark.parametrize("use", USES)
def test_a_helper_counts_however_it_is_reached(monkeypatch, use):
    def made(k):
        name = "__getattr__" if use == "a module's __getattr__" else "level"
        helper = own_study(monkeypatch, f"def {name}(r): raise AttributeError({k})")
        if use == "a property of the module":
            other = {"other": property(vars(helper).pop("level"))}
            helper.__class__ = type("Kind", (types.ModuleType,), other)
        if use == "a number of the package":
            sys.modules["own_study"].number, helper.level = k, None
        scope = {"__name__": "own_study.measures", "__package__": "own_study"}
        exec(USES[use], scope)
        return scope["f"]

    assert_counts(made)


@pytest.mark.parametrize("what", ["module", "class", "object", "function"])
def test_the_file_of_what_is_compiled_counts(monkeypatch, tmp_path, what):
    def made(k):
        (tmp_path / "helper.so").write_bytes(bytes([k]))
        helper = own_study(monkeypatch, "", __file__=str(tmp_path / "helper.so"))
        kind = type("Model", (), {"__module__": "own_study.helper", "level": float.hex})
        function = types.SimpleNamespace(__module__="own_study.helper", __qualname__="level")
        return of({"module": helper, "class": kind, "object": kind(), "function": function}[what])

    assert_counts(made)


@pytest.mark.parametrize(
    ("use", "where", "name", "now"),
    [
        (lambda r: scipy.signal.welch(r), scipy, "__version__", "0"),
        (of(scipy.signal.welch), scipy, "__version__", "0"),
        (of([scipy.signal]), scipy, "__version__", "0"),
        (lambda r: norm.cdf(r), scipy, "__version__", "0"),
        (lambda r: scipy.signal.welch(r), importlib.metadata, "version", lambda name: "0"),
        (lambda r: np.pi, np, "pi", 3.0),
        (lambda r: getattr(np, "pi"), np, "pi", 3.0),  # noqa: B009
    ],
)
def test_another_version_or_number_of_a_package_is_something_else(
    monkeypatch, use, where, name, now
):
    """It states its version, or has that of its installation."""
    if where is importlib.metadata:
        monkeypatch.delattr(scipy, "__version__")
    before = identity(use, "f")
    monkeypatch.setattr(where, name, now)
    assert identity(use, "f") != before


def imported_by_name(run):
    import importlib

    return importlib.import_module("helper").K


def taken_from_all_modules(run):
    import sys

    return sys.modules["helper"].K


def evaluated(run):
    import builtins as plain

    return plain.eval("K")


def under_another_name(found):
    return lambda run: found("K")


@pytest.mark.parametrize(
    ("use", "says"),
    [
        (lambda r: sys.modules["helper"], "modules finds code by a name"),
        (lambda r: sys._getframe().f_locals, "_getframe finds code by a name"),
        (lambda r: Block.__subclasses__(), "uses __subclasses__, .* cannot be seen"),
        (np.frompyfunc(level, 1, 1), "numpy.ufunc, .* cannot be seen"),
        (functools.update_wrapper(functools.cache(of(1.0)), level), "_lru_cache_wrapper, whose"),
        (of(v for v in [1.0]), "generator, whose"),
        (typing.TypeVar("Lost"), "TypeVar, whose"),
        (imported_by_name, "import_module finds code by a name"),
        (taken_from_all_modules, "modules finds code by a name"),
        (evaluated, "eval finds code by a name"),
        *(
            (under_another_name(f), f"uses {f.__name__}, .* cannot be seen")
            for f in (eval, exec, globals, importlib.import_module)
        ),
    ],
)
def test_what_cannot_be_seen_is_refused(use, says):
    refused(BadValue, says, identity, use, "f")


def test_a_motion_is_known_by_every_sample_of_its_inputs_in_any_order():
    def digest(motion):
        return motion_digest(motion, "", 8000, None)

    one, two, end = np.ones(400), np.full(400, 2.0), np.r_[np.ones(399), 2.0]
    assert digest(one) == digest([1.0] * 400) != digest(end)
    found = digest({"x": one, "z": two})
    assert found == digest({"z": two, "x": one}) != digest({"x": two, "z": one})
    assert digest({"x": one}) != digest({"z": one})


def test_each_column_of_a_row_counts_with_its_type(monkeypatch):
    def keys(rows):
        words = {"motion": np.ones(4), "measures": "peak", "fs": 8000.0, "seconds": None}
        planning = planned(made, table_of(rows), words | {"live": ["k"], "kept": True})
        digests = {name: digest for name, (digest, _) in planning.motions.items()}
        return row_keys(planning.plan, planning.table, digests).to_pylist()

    def made(a=0.0):
        return Scene({"y": a * Param("k", 1.0) * Input("x")})

    rows = {"a": [0.0, 1.0, 1.0, 1.0, 1.0], "k": [0.0, 0.0, 1.0, 1.0, 1.0], "seed": [0, 0, 0, 1, 2]}
    found = keys(rows)
    assert len(set(found)) == 5
    assert keys(dict(reversed(rows.items()))) == found
    assert keys({"a": [0], "k": [0.0]}) != keys({"a": [0.0], "k": [0.0]}) == found[:1]
    monkeypatch.setattr("stimlib.sweep.keys.CHUNK", 2)
    assert keys(rows) == found


def test_arguments_of_all_kinds_tell_rows_apart(tmp_path):
    def made(shape="flat", twice=False, k=1.0):
        gain = {"flat": 1.0, "steep": 3.0}[shape] * (2.0 if twice else 1.0)
        return Scene({"y": gain * Param("k", k) * Input("x")})

    rows = grid(shape=["flat", "steep"], twice=[False, True])
    words = RUN | {"measures": "peak", "out": tmp_path}
    assert sweep(made, rows, live=[], **words)["peak_y"].to_pylist() == [1.0, 2.0, 3.0, 6.0]
    for error, says, others, live in (
        (BadValue, "other arguments: name", {"k": [1.0]}, []),
        (BadValue, "other live, arguments: name", {"k": [1.0]}, ["k"]),
        (UnknownName, "live: there is no column of the rows 'k'", rows, ["k"]),
    ):
        refused(error, says, sweep, made, others, live=live, **words)


def test_other_versions_are_another_sweep_and_the_folder_tells_its_motions(tmp_path, monkeypatch):
    words = RUN | {"measures": "peak", "out": tmp_path, "seconds": 0.05}
    hand = minimum_jerk(depth=0.02)
    for name, motion in (("a", np.ones(400)), ("b", hand)):
        sweep(SPRING, {"motion": [name], "k": [1.0]}, **words | {"motion": {name: motion}})
    told = json.loads((tmp_path / "_sweep.json").read_text())
    assert set(told["motion"]) == {"a", "b"} and repr(hand) in told["motion"]["b"]
    monkeypatch.setattr("stimlib.sweep.keys.version", lambda package: "0")
    refused(BadValue, "other versions: name", sweep, SPRING, {"k": [1.0]}, **words)


AGAIN = """
import pandas as pd
from scipy.stats import norm
from stimlib.sweep.identity import identity
table, law = pd.DataFrame({"w": [1.0, 2.0]}), norm(0, 1)
found = identity(lambda run: table, "f"), identity(lambda run: law, "f")
"""


def test_objects_of_packages_are_known_again_in_another_process():
    exec(AGAIN, here := {"__name__": "__main__"})
    words = [sys.executable, "-c", f"{AGAIN}\nprint(*found)"]
    env = os.environ | {"PYTHONHASHSEED": "2"}
    there = subprocess.run(words, capture_output=True, text=True, env=env)
    assert there.stdout.split() == [*here["found"]], there.stderr


def test_small_parts_are_merged_and_the_folder_reads_as_one_table(tmp_path, monkeypatch):
    monkeypatch.setattr("stimlib.sweep.store.MANY", 4)
    words = RUN | {"measures": "peak", "out": tmp_path}
    for k in range(6):
        sweep(SPRING, {"k": [float(k)]}, **words)
    assert len(list(tmp_path.glob("part-*"))) == 3
    # another column is another kind of part, which is not merged with these
    sweep(SPRING, {"k": [1.0], "motion": ["b"]}, **words | {"motion": {"b": np.full(400, 2.0)}})
    assert sorted(pandas.read_parquet(tmp_path)["k"]) == [0.0, 1.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert sweep(SPRING, {"k": np.arange(7.0)}, **words)["peak_force"].to_pylist() == list(range(7))


def test_a_merge_done_again_keeps_its_part_and_both_a_failure_and_its_success(
    tmp_path, monkeypatch
):
    """As after a kill between its two steps."""
    monkeypatch.setattr("stimlib.sweep.store.MANY", 2)
    store = object.__new__(Store)
    store.folder = tmp_path
    rows = {"key": [b"a", b"a", b"b"], "content": [b"c"] * 3, "error": ["failed", None, None]}
    whole = pyarrow.table(rows)
    parts = {store._publish(t): t for t in (whole, whole.slice(0, 1), whole.slice(1, 2))}
    store._merge(parts)
    assert [*tmp_path.iterdir()] == [next(iter(parts))]
    assert pandas.read_parquet(tmp_path)["error"].isna().tolist() == [False, True, True]
    store.tables = [whole]  # the success is what a row has
    assert store.done(["error"])["error"].to_pylist() == [None, None, "failed"]
