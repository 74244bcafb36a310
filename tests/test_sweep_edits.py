"""An edit between two runs of a sweep: its figures are those of today's source, or the
folder is refused.
"""

import json
import os
import subprocess
import sys
import types

import numpy as np
import pytest
from edited import swept
from laws import STRESS, mostly

from stimlib import BadValue

HEAD = """
import array, collections, dataclasses, decimal, enum, fractions, functools, types
import numpy as np
import stimlib
from stimlib import Block, Input, Scene
from stimlib.blocks import lowpass
from stimlib.sweep import measure
x = Input("x")
"""
PLAIN = (
    "def make(a): return Scene({'y': a * x})\n@measure('1')\ndef figure(run): return"
    " run['y'][-1]\nhand = np.ones(100)\n"
)
MAKE = "\ndef make(a):\n    return Scene({'y': VALUE * a * x})\n"
FIGURE = "\n@measure('1')\ndef figure(run):\n    return VALUE * run['y'][-1]\n"
OF_CLASS = """
class Base:
    off = 1.0
    def value(self): return self.off
class Study(Base):
    gain = K
    def __init__(self, k=1.0): self.k = k
    @property
    def half(self): return self.k / 2
    @staticmethod
    def fixed(): return K
    @classmethod
    def of(cls): return cls.gain
    def __call__(self, a): return self.make(a)
    def make(self, a): return Scene({'y': K * self.k * self.gain * self.value() * a * x})
    def figure(self, run): return K * self.k * self.value() * run['y'][-1]
"""
BLOCK = """
from typing import NamedTuple
class P(NamedTuple):
    g: float
def helper(v): return 2.0 * v
@dataclasses.dataclass(frozen=True, eq=False)
class Own(Block):
    x: Block
    def design(self, fs): return P(np.float64(G * fs)), ()
    @staticmethod
    def step(p, s, x): return helper(p.g * x), ()
def make(a): return Scene({'y': Own(a * x)})
"""


# name: (source, old text, new text); what a source does not define is plain: y = a x,
# its last sample, ones.
VALUES = {  # what comes before, the value that is used, and what is edited
    "a global of a function": ("K = 1.0", "K", "K = 1.0", "K = 5.0"),
    "a property": ("K = 1.0" + OF_CLASS, "Study().half", "self.k / 2", "self.k / 3"),
    "a static method": ("K = 1.0" + OF_CLASS, "Study.fixed()", "K = 1.0", "K = 2.0"),
    "a class method": ("K = 1.0" + OF_CLASS, "Study.of()", "gain = K", "gain = 2.0"),
    "a plain object": ("class C: pass\nc = C()\nc.v = 1.0", "c.v", "c.v = 1.0", "c.v = 2.0"),
    "slots": ("class C:\n    __slots__ = ('v',)\nc = C()\nc.v = 1.0", "c.v", "v = 1.0", "v = 2.0"),
    "a namespace": ("c = types.SimpleNamespace(v=1.0)", "c.v", "v=1.0", "v=2.0"),
    "a decimal": ("c = decimal.Decimal('1.5')", "float(c)", "1.5", "2.5"),
    "a fraction": ("c = fractions.Fraction(1, 2)", "float(c)", "(1, 2)", "(1, 3)"),
    "a range": ("c = range(2)", "len(c)", "range(2)", "range(3)"),
    "an array of Python": ("c = array.array('d', [1])", "c[0]", "[1]", "[2]"),
    "a proxy of a dict": ("c = types.MappingProxyType({'v': 1})", "c['v']", "'v': 1", "'v': 2"),
    "an array": ("c = np.array([1.0, 2.0])", "c[1]", "2.0", "3.0"),
    "a member of an enum": ("class C(enum.Enum):\n    V = 1.0", "C.V.value", "V = 1.0", "V = 2.0"),
    "a helper's helper": (
        "def g(): return 1.0\ndef f(): return g()",
        "f()",
        "return 1.0",
        "return 2.0",
    ),
    "a function's attribute": ("def f(): return f.v\nf.v = 1.0", "f()", "f.v = 1.0", "f.v = 2.0"),
    "globals by text": ("K = 1.0", "globals()['K']", "K = 1.0", "K = 2.0"),
    "an attribute by text": (
        "c = types.SimpleNamespace(v=1.0)",
        "getattr(c, 'v')",
        "v=1.0",
        "v=2.0",
    ),
    "evaluated text": ("K = '1.0'", "eval(K)", "'1.0'", "'2.0'"),
}
OF_MAKE = {
    name: (before + MAKE.replace("VALUE", value), old, new)
    for name, (before, value, old, new) in VALUES.items()
} | {
    "a number in the function": ("def make(a): return Scene({'y': 2.0 * a * x})", "2.0", "3.0"),
    "a global of a method": ("K = 1.0" + OF_CLASS + "make = Study().make", "K = 1.0", "K = 5.0"),
    "a global of __call__": (
        "K = 1.0" + OF_CLASS + "def make(a): return Study()(a)",
        "K = 1.0",
        "K = 5.0",
    ),
    "a base class's attribute": (
        "K = 1.0" + OF_CLASS + "make = Study().make",
        "off = 1.0",
        "off = 4.0",
    ),
    "a base class's method": (
        "K = 1.0" + OF_CLASS + "make = Study().make",
        "return self.off",
        "return 3 * self.off",
    ),
    "an attribute of the class": (
        "K = 1.0" + OF_CLASS + "make = Study().make",
        "gain = K",
        "gain = 7.0",
    ),
    "an attribute set later": (
        "K = 1.0" + OF_CLASS + "s = Study()\ns.k = 2.0\nmake = s.make",
        "s.k = 2.0",
        "s.k = 3.0",
    ),
    "an argument of the object": (
        "K = 1.0" + OF_CLASS + "make = Study(1.0).make",
        "Study(1.0)",
        "Study(2.0)",
    ),
    "a default": ("def make(a, k=1.0): return Scene({'y': k * a * x})", "k=1.0", "k=2.0"),
    "a keyword's default": (
        "def make(a, *, k=1.0): return Scene({'y': k * a * x})",
        "k=1.0",
        "k=2.0",
    ),
    "a closure": (
        "def of(k):\n    def f(a): return Scene({'y': k * a * x})\n    return f\nmake = of(1.0)",
        "of(1.0)",
        "of(2.0)",
    ),
    "a partial": (
        "def f(a, k): return Scene({'y': k * a * x})\nmake = functools.partial(f, k=1.0)",
        "k=1.0",
        "k=2.0",
    ),
    "a decorator": (
        "def d(f): return lambda a: f(2.0 * a)\n@d\ndef make(a): return Scene({'y': a * x})",
        "2.0 * a",
        "3.0 * a",
    ),
    "a filter's cutoff": ("def make(a): return Scene({'y': lowpass(a * x, 50.0)})", "50.0", "80.0"),
    "an output's name": ("def make(a): return Scene({'y': a * x, 'z': x})", "'z'", "'w'"),
    "an own block's design": ("G = 1.0" + BLOCK, "G * fs", "G * fs * fs"),
    "a global of an own block's design": ("G = 1.0" + BLOCK, "G = 1.0", "G = 3.0"),
    "a helper of an own block's step": ("G = 1.0" + BLOCK, "return 2.0 * v", "return 4.0 * v"),
    "an own block's step": ("G = 1.0" + BLOCK, "helper(p.g * x)", "helper(p.g * x + x)"),
}
FIGURES = {f"{name}, in a measure": row for name, row in VALUES.items()} | {
    "a cached helper": ("@functools.cache\ndef f(v): return 1.0 * v", "f(1)", "1.0 * v", "2.0 * v"),
    "a patched package": (
        "np.of_a_test = lambda v: 1.0 * v",
        "np.of_a_test(1)",
        "1.0 * v",
        "2.0 * v",
    ),
    "a counter of a package": ("c = collections.Counter(a=1)", "c['a']", "a=1", "a=2"),
    "a large array": ("c = np.zeros(5000)\nc[2500] = 1.0", "c.sum()", "= 1.0", "= 2.0"),
    "a dataclass": (
        "@dataclasses.dataclass\nclass C:\n    v: float = 1.0\nc = C()",
        "c.v",
        "1.0",
        "2.0",
    ),
    "the type of a number": (
        "c = 3",
        "(c / 2 if isinstance(c, float) else c // 2)",
        "c = 3",
        "c = 3.0",
    ),
}
OF_MEASURE = {
    name: (before + FIGURE.replace("VALUE", value), old, new)
    for name, (before, value, old, new) in FIGURES.items()
} | {
    "a method as a measure": (
        "K = 1.0" + OF_CLASS + "figure = measure(figure='1')(Study().figure)",
        "K = 1.0",
        "K = 2.0",
    ),
    "a base class, in a measure": (
        "K = 1.0" + OF_CLASS + "figure = measure(figure='1')(Study().figure)",
        "off = 1.0",
        "off = 2.0",
    ),
    "what is prepared": (
        "K = 1.0\n@measure('1', prepare=lambda x, fs: K)\ndef figure(run, k): return k",
        "K = 1.0",
        "K = 2.0",
    ),
    "a stated version": (
        "K = 1.0\n@measure('1', version='1')\ndef figure(run): return K",
        "K = 1.0\n@measure('1', version='1')",
        "K = 2.0\n@measure('1', version='2')",
    ),
}
OF_MOTION = {
    "a motion's number": ("def hand(t): return 1.0 + t", "1.0 + t", "2.0 + t"),
    "a motion's global": ("K = 1.0\ndef hand(t): return K + t", "K = 1.0", "K = 2.0"),
    "a motion of an object": (
        "class H:\n    k = 1.0\n    def __call__(self, t): return self.k + t\nhand = H()",
        "k = 1.0",
        "k = 2.0",
    ),
    "a motion's samples": ("hand = 1.5 * np.arange(100)", "1.5", "2.5"),
}
EDITS = OF_MAKE | OF_MEASURE | OF_MOTION
NOT_RUN = {
    "a comment": ("K = 1.0  # a" + MAKE.replace("VALUE", "K"), "# a", "# b"),
    "a docstring": (
        "def figure_(run):\n    'One.'\n    return 1.0\nfigure = measure(figure='1')(figure_)",
        "One.",
        "Two.",
    ),
    "a local's name": ("@measure('1')\ndef figure(run):\n    v = 1.0\n    return v", "v", "w"),
    "the order of definitions": (
        "def f(): return 1.0\nK = 2.0" + FIGURE.replace("VALUE", "f() * K"),
        "def f(): return 1.0\nK = 2.0",
        "K = 2.0\ndef f(): return 1.0",
    ),
    "an empty line": ("K = 1.0" + FIGURE.replace("VALUE", "K"), "K = 1.0", "\n\nK = 1.0"),
    "a number that nothing uses": (
        "K = 1.0\nL = 1.0" + FIGURE.replace("VALUE", "K"),
        "L = 1.0",
        "L = 2.0",
    ),
    "a function that nothing uses": (
        "def g(): return 1.0" + MAKE.replace("VALUE", "1.0"),
        "return 1.0",
        "return 2.0",
    ),
    "another way to the same scene": (
        "K = 1.0" + MAKE.replace("VALUE", "(K + K)"),
        "(K + K)",
        "2 * K",
    ),
    "an annotation": (
        "def f(v: int): return 1.0" + FIGURE.replace("VALUE", "f(1)"),
        "v: int",
        "v: float",
    ),
    "a helper's name": ("def f(): return 1.0" + MAKE.replace("VALUE", "f()"), "f()", "g()"),
    "parentheses": ("K = 1.0" + FIGURE.replace("VALUE", "K"), "K *", "(K) *"),
    "an unused import": (
        "import math" + FIGURE.replace("VALUE", "1.0"),
        "import math",
        "import math, random",
    ),
    "a sum of numbers": (FIGURE.replace("VALUE", "6.0"), "6.0", "(2.0 * 3.0)"),
    "a class's docstring": (
        "K = 1.0" + OF_CLASS.replace("Base):", "Base):\n    'One.'") + "make = Study().make",
        "One.",
        "Two.",
    ),
    "a comment beside an own block": ("G = 1.0  # a" + BLOCK, "# a", "# b"),
    "the order of methods": (
        "class C:\n    def a(self): return 1.0\n    def b(self): return 2.0"
        + FIGURE.replace("VALUE", "C().a()"),
        "    def a(self): return 1.0\n    def b(self): return 2.0",
        "    def b(self): return 2.0\n    def a(self): return 1.0",
    ),
    "a local's annotation": (
        "@measure('1')\ndef figure(run):\n    v: int = 1.0\n    return v",
        "v: int",
        "v: float",
    ),
    "lines within a call": (
        FIGURE.replace("VALUE", "max(1.0, 2.0)"),
        "max(1.0, 2.0)",
        "max(\n1.0,\n2.0)",
    ),
    "the place in the file": (
        "def g(): return 3.0" + FIGURE.replace("VALUE", "1.0"),
        "def g(): return 3.0",
        "",
    ),
    "a factory's body": (
        "def make(a):\n    y = a * x\n    return Scene({'y': y})",
        "y = a * x",
        "y = x * a if False else a * x",
    ),
    "an attribute of a module that nothing uses": (
        "m = types.ModuleType('m')\nm.v, m.w = 1.0, 2.0" + FIGURE.replace("VALUE", "abs(m.v)"),
        "1.0, 2.0",
        "1.0, 3.0",
    ),
}


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Sweep what a source makes, with figures that are kept."""
    monkeypatch.setattr(np, "of_a_test", None, raising=False)
    monkeypatch.setitem(sys.modules, "of_an_edit", module := types.ModuleType("of_an_edit"))

    def run(text, out=tmp_path / "out"):
        text, path = HEAD + PLAIN + text, tmp_path / f"{abs(hash(text))}.py"
        path.write_text(text)
        vars(module).clear()
        vars(module).update(__name__="of_an_edit", __file__=str(path))
        exec(compile(text, path, "exec", dont_inherit=True), vars(module))
        return swept(module, out)

    return run


@pytest.mark.parametrize("name", mostly(list(EDITS)[::4], EDITS))
def test_no_edit_leaves_figures_of_old_source(kept, name):
    source, old, new = EDITS[name]
    assert source.count(old) >= 1
    edited = source.replace(old, new)
    try:
        before = kept(source)
    except BadValue as e:
        assert "cannot be seen" in str(e), e
        return
    after = kept(edited, None)
    if name != "an output's name":
        assert not before.equals(after), "the edit shows in the figures"
    with pytest.raises(BadValue, match="of another scene or motion|with other measures"):
        if kept(edited).equals(after):
            raise BadValue("run anew, of another scene or motion")


@pytest.mark.parametrize("name", mostly(list(NOT_RUN)[::2], NOT_RUN))
def test_what_is_not_run_makes_no_row_run_again(kept, name, tmp_path):
    source, old, new = NOT_RUN[name]
    before = kept(source)
    parts = set(tmp_path.rglob("part-*"))
    assert old in source and kept(source.replace(old, new)).equals(before)
    assert set(tmp_path.rglob("part-*")) == parts


PLACES = ("script", "module", "package", "reloaded", "notebook")


@pytest.mark.parametrize("workers", mostly([0], [0, 1]))
@pytest.mark.parametrize("place", mostly(["package", "notebook"], PLACES))
def test_wherever_the_source_is_an_edit_counts_and_what_is_not_run_does_not(
    place, workers, tmp_path
):
    """All edits in make stress, a few of them with rows in a process of their own; else
    a few edits, others for each place.
    """
    step = 1 if STRESS and not workers else 34
    at = PLACES.index(place) % step
    start = HEAD + "np.of_a_test = None\n" + PLAIN
    cases = {**dict(list(EDITS.items())[at::step]), **dict(list(NOT_RUN.items())[at::step])}
    given = [
        (name, start + source, start + source.replace(old, new))
        for name, (source, old, new) in cases.items()
    ]
    command = [
        sys.executable,
        os.path.join(os.path.dirname(__file__), "edited.py"),
        place,
        str(tmp_path),
        str(workers),
    ]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    ran = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, env=env)
    told = dict(map(json.loads, ran.stdout.splitlines()))
    assert told.keys() == cases.keys(), ran.stderr
    right = {name: ("refused", "run again") if name in EDITS else ("kept",) for name in cases}
    assert not {name: what for name, what in told.items() if not what.startswith(right[name])}
