"""What a step may say: every remedy is named with file and line; every step that
stimlib ships passes.
"""

import importlib
import itertools
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from contract import TABLE as TABLE_OF_BLOCKS
from laws import assert_same, cut_at, played, rows, run
from refusals import refused

import stimlib
from stimlib import Block, Input, Scene, SceneError, UnitError, constant
from stimlib.blocks import fir, loop
from stimlib.core import steps
from stimlib.core.loop_code import Cycle
from stimlib.core.maths import where
from stimlib.core.program import design_of, program_of

x = Input("x")

# What authors write in a file of theirs -----------------------------------------------
MODULE = """
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
import stimlib
from stimlib.core import maths
from stimlib.core.graph import Block
from stimlib.core.maths import sin, where

EXPONENTS = (1, 2)
TABLE = np.ones(3)

class State(NamedTuple):
    y: float

class Gain(NamedTuple):
    gain: float

class Numbers(NamedTuple):
    table: np.ndarray
    seed: np.uint64
    gain: float

class Memory(NamedTuple):
    line: np.ndarray
    n: np.uint64
    y: float

class Contact(NamedTuple):
    last: float
    cold: float

LESS = -1

def recovers(v):
    return recovers(v)

def clipped(numbers):
    numbers[0] = 1.0
    return 0.0

def powered(v):
    return v**2  # powered

def made(gain):
    def step(p, s, x):
        return gain * x, s
    return staticmethod(step)

@dataclass(frozen=True, eq=False)
class Mine(Block):
    x: Block
"""
DESIGN = "def design(self, fs):\n    return Gain(2.0), State(0.0)\n"
ARRAYS = """def design(self, fs):
    return Numbers(np.zeros(3), np.uint64(1), 1.0), Memory(np.zeros(3), np.uint64(1), 1.0)
"""
STATIC = "@staticmethod\ndef step(p, s, x):\n"
SERIES = (
    "@staticmethod\ndef tile(p, s, x, y):\n    maths.series(powered, p, s, x, y)\n    return s\n"
)
GOOD = STATIC + "    return p.gain * x, State(x)\n"
NUMBER = itertools.count()


def body(*lines):
    """A step of these lines."""
    return STATIC + textwrap.indent("\n".join(lines), "    ") + "\n"


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """Makes the class Mine of these members in a file of its own; and where the line is
    that ends with a mark.
    """
    monkeypatch.syspath_prepend(tmp_path)

    def write(members):
        file = tmp_path / f"of_an_author_{next(NUMBER)}.py"
        whole = members if "def design" in members else DESIGN + members
        file.write_text(MODULE + textwrap.indent(whole, "    "))

        def at(mark):
            ends = [line.endswith(mark) for line in file.read_text().splitlines()]
            return f"{file}:{ends.index(True) + 1}: "

        return importlib.import_module(file.stem).Mine, at

    return write


MISTAKES = [
    # what a step may not say
    (body("if x > 0.0:  # here", "    x = 0.0", "return x, s"), "where(c, a, b)"),
    (body("y = x", "return (y if y > 0.0 else 0.0), s  # here"), "where(c, a, b)"),
    (body("return x**2, s  # here"), "multiply"),
    (body("return (x > 0.0) and (x < 1.0), s"), "`and`/`or`"),
    (body("return not x, s"), "`not`"),
    (body("while x > 0.0:", "    x = x - 1.0", "return x, s"), "`while`"),
    (body("for k in EXPONENTS:", "    x = x * k", "return x, s"), "for i in range(..)"),
    (body("return np.sin(x), s  # here"), "np.sin"),
    (body("return round(x), s"), "'round'"),
    (body("return x * nowhere, s"), "'nowhere' is not defined"),
    ("step = made(3.0)\n", "closes over gain"),
    (body("try:", "    return x, s", "finally:", "    pass"), "straight-line"),
    (body("return powered(x), s"), "powered"),
    (body("return recovers(x), s"), ""),
    (body("return s.n + np.uint64(18446744073709551616), s"), ""),
    (body("maths.each(f=recovers)", "return x, s"), ""),
    (GOOD + SERIES, "powered"),
    (body("return x.item(), s"), "x.item"),
    (
        body("return stimlib.core.maths.sqrt(x), s  # here"),
        "write `from stimlib.core import maths` above the class, and maths.sqrt here",
    ),
    (body("return x // 1, s  # here"), "use maths.floor(a / b)"),
    (body("y = min(x, 1.0)  # here", "return y, s"), "write where(a < b, a, b) for 'min'"),
    # what authors forget
    (
        "def step(self, p, s, x):  # here\n    return x, s\n",
        "Mine.step: write @staticmethod above it: it has no self and is step(p, s, x)",
    ),
    (
        "@staticmethod  # here\ndef step(p, s):\n    return 1.0, s\n",
        "Mine.step: it takes (p, s) and must take step(p, s, x)",
    ),
    (
        "resettable = True\n@staticmethod  # here\ndef step(p, s):\n    return 1.0, s\n",
        "a resettable block has a signal that resets it, the last one",
    ),
    (
        "resettable = True\ndef design(self, fs):  # here\n    return (), Contact(0.0, 0.0)\n"
        + GOOD,
        "design: cold = 0.0 in the state",
    ),
    ("", "Mine has neither a step nor a tile: write step(p, s, x)"),
    (
        body("return p.gain * x  # here"),
        "must return two things, the sample and the new state State(..)",
    ),
    (body("return x, ()  # here"), "must return two things"),
    ("@staticmethod\ndef step(p, s, x):  # here\n    x = 2.0 * x\n", "must return two things"),
    (
        body("s.y = x  # here", "return x, s"),
        "s.y cannot be set: parameters and state are tuples; return a new state",
    ),
    (
        body("return p.gian * x, s  # here"),
        "Mine.step: p.gian is not there: design gives the parameters gain",
    ),
    (
        (
            "@staticmethod\ndef tile(p, s, x, y):  # here\n    for i in range(x.size):\n       "
            " y[i] = x[i]\n"
        ),
        "Mine.tile: it must fill y and return the new state State(..)",
    ),
    (
        "def design(self, fs):\n    return Gain(1.0 / 0), State(0.0)\n" + GOOD,
        "Mine.design: ZeroDivisionError: ",
    ),
    (
        "def design(self, fs):  # here\n    return (1.0,), (2.0,)\n" + GOOD,
        "Mine.design: it must return parameters and state",
    ),
    ("def design(self, fs):\n    return Gain(2.0)\n" + GOOD, "two NamedTuples"),
    (
        'def design(self, fs):  # here\n    return Gain("2"), State(0.0)\n' + GOOD,
        "Mine.design: parameters 'gain' is a str; floats",
    ),
    (
        "def design(self, fs):  # here\n    return Gain(np.exp(1j)), State(0.0)\n" + GOOD,
        "Mine.design: parameters 'gain' is a complex128; floats",
    ),
    (
        "def design(self, fs):\n    return Gain(np.zeros((2, 2))), State(0.0)\n" + GOOD,
        "(2, 2) of float64",
    ),
    (
        body("return x, State(x, x)  # here"),
        "State(x, x): it is State(y): too many positional arguments",
    ),
    (
        body("return x, State()  # here"),
        "State(): it is State(y): missing a required argument: 'y'",
    ),
    (body("return x, Gain(x)  # here"), "Mine.step: the new state must be the State(..) of design"),
    (
        body("return x, State(0)  # here"),
        "the new state's y must be a float as in design, and is 0; write 1.0",
    ),
    (
        ARRAYS + body("return x, Memory(maths.words(p.table), s.n, s.y)  # here"),
        "the new state's line must be ",
    ),
    (body("return (x, x), s  # here"), "Mine.step: the sample must be one number"),
    (body("y += x  # here", "return y, State(y)"), "Mine.step: UnboundLocalError"),
    (
        body("y = where(x > 0, x)  # here", "return y, State(y)"),
        "it is where(c, a, b): missing a required argument: 'b'",
    ),
    (body("return sin(x, 1), s  # here"), "it is sin(x): too many"),
    (body("return sin(x=x), s  # here"), "give the arguments by place"),
    (body("return x * s.y[0], s  # here"), "only arrays have an index"),
    (body('return x + "1", s  # here'), "'1' is not a number"),
    # what would have other bits, or other samples, where it is compiled
    (body("return maths.as_float(x), s  # here"), "as_float converts a np.uint64, not a float"),
    (body("return maths.as_float(-1), s  # here"), "out of bounds for uint64"),
    (body("return maths.unbits(s.y), s  # here"), "unbits takes the bits of a float as np.uint64"),
    (ARRAYS + body("p.table[0] = x  # here", "return x, s"), "only into arrays of its own state"),
    (
        ARRAYS + body("line = p.table", "line[:] = x  # here", "return x, s"),
        "only into arrays of its own state",
    ),
    (
        "@staticmethod\ndef tile(p, s, x, y):\n    x[:] = 0.0  # here\n    return s\n",
        "a tile into its outputs",
    ),
    (  # where the rehearsal on zeros does not get
        "@staticmethod\ndef tile(p, s, x, y):\n    if x[0] > 1.0:\n        x[0] = 1.0  # here\n"
        "    return s\n",
        "x[0] cannot be set: a step may write only into arrays",
    ),
    (
        ARRAYS + "@staticmethod\ndef tile(p, s, x, y):\n    if x[0] > 1.0:\n"
        "        p.table[0] += x[0]  # here\n    return s\n",
        "p.table[0] cannot be set: a step may write only into arrays",
    ),
    (
        ARRAYS + "@staticmethod\ndef tile(p, s, x, y):\n    table = p.table\n    if x[0] > 1.0:\n"
        "        row = table[1:]\n        row[0] += x[0]  # here\n    return s\n",
        "row[0] cannot be set: a step may write only into arrays",
    ),
    (
        "@staticmethod\ndef tile(p, s, x, y):\n    if x[0] > 1.0:\n"
        "        y[0] = clipped(x[1:])  # here\n    return s\n",
        "clipped: numbers[0] cannot be set: a step may write only into arrays",
    ),
    (
        "def design(self, fs):  # here\n    return Gain(10**400), State(0.0)\n" + GOOD,
        "Mine.design: parameters 'gain' is a int; floats",
    ),
    (
        body("for _ in range(p.gain):  # here", "    x = 2.0 * x", "return x, s"),
        "range counts whole ones: range(np.int64(n))",
    ),
    (
        body("n = 2.0 * x", "for _ in range(n):  # here", "    x = 2.0 * x", "return x, s"),
        "range counts whole ones: range(np.int64(n))",
    ),
]


@pytest.mark.parametrize(("members", "says"), MISTAKES)
def test_mistakes_of_authors_name_class_file_line_and_remedy(mine, members, says):
    cls, at = mine(members)
    for target in ("python", "llvm", "jax"):
        message = str(
            refused(SceneError, None, stimlib.compile, Scene({"y": cls(x)}), 1000, target)
        )
        assert says in message and "llvm" not in message, message
        if "# here" in members:
            assert message.startswith(at("# here")), message
        if "powered" in members:
            assert at("# powered")[:-2] in message, "a helper is held to the same rules"


@pytest.mark.parametrize(
    ("members", "mark", "says"),
    [
        ("step = staticmethod(lambda p, s, x: (x, s))\n", None, "Mine.<lambda>: write it with def"),
        (body("return x * TABLE[0], s"), None, "Mine.step uses 'TABLE'"),
        (
            "class Own(NamedTuple):\n    y: float\n\n" + body("return Mine.Own(x).y, s"),
            None,
            "define its NamedTuples outside of the class",
        ),
        (
            (
                "@staticmethod\ndef tile(p, s, x, y):\n    for i in range(y.size):\n        if x[i]"
                " > 2.0:\n            y[i] = x[i] + s  # here\n    return s\n"
            ),
            "# here",
            "Mine.tile: it does not compile: ",
        ),
    ],
)
def test_what_only_the_compiler_sees_is_one_line_too(mine, members, mark, says):
    cls, at = mine(members)
    message = str(refused(SceneError, None, stimlib.compile, Scene({"y": cls(x)}), 1000))
    assert message.startswith((at(mark) if mark else "compile: ") + "Mine."), message
    assert says in message and "\n" not in message, message


WORDS = body("v = np.uint64({})  # here", "return maths.as_float(v), s")


@pytest.mark.parametrize(
    "text",
    "s.n + 1|s.n - 1|3 * s.n|s.n % 3|s.n % np.int64(3)"
    "|7 - where(x > 0.0, s.n, p.seed)|(s.n & p.seed) + 1"
    "|np.uint64(x) % 3|maths.bits(x) + 1|np.uint64(2) * np.int64(x)|s.n << 64|np.int64(x) >> 70"
    "|s.n >> np.uint64(64)|s.n << LESS".split("|"),
)
def test_whole_numbers_that_differ_between_targets_are_refused(mine, text):
    """Compiled, a word and a whole number have no common kind, and a shift by 64 gives
    anything.
    """
    cls, at = mine(ARRAYS + WORDS.format(text))
    says = "a shift by " if "<<" in text or ">>" in text else "write np.uint64(1), not 1"
    for target in ("python", "llvm"):
        error = refused(SceneError, None, stimlib.compile, Scene({"y": cls(x)}), 1000, target)
        assert says in str(error) and at("# here") in str(error), error


@pytest.mark.parametrize("target", ["python", "llvm"])
def test_whole_numbers_of_one_kind_have_the_bits_of_whole_numbers(mine, target):
    n = (1 << 63) + 12345
    texts = {
        "s.n * p.seed + np.uint64(7)": n * n + 7,
        "s.n % np.uint64(1000)": n % 1000,
        "(s.n >> 3) ^ (s.n & 255) | (s.n << np.uint64(63))": (n >> 3) ^ (n & 255) | (n << 63),
        "np.int64(-7) % 3 + 2 * 5": -7 % 3 + 10,
    }
    made = ARRAYS.replace("np.uint64(1)", f"np.uint64({n})")
    for text, wanted in texts.items():
        end = "return where(x > 0.0, maths.as_float(v >> 32), maths.as_float(v << 32)), s"
        cls, _ = mine(made + body(f"v = np.uint64({text})", end))
        y = stimlib.compile(Scene({"y": cls(x)}), 1000, target).process(np.array([[1.0, 0.0]]))
        assert y[0].tolist() == [wanted % 2**64 >> 32, (wanted << 32) % 2**64], text


def test_a_step_that_fails_while_it_runs_says_where(mine):
    cls, at = mine(ARRAYS + body("s.line[np.int64(x)] = x  # here", "return x, s"))
    processor = stimlib.compile(Scene({"y": cls(x)}), 1000, "python")
    e = refused(SceneError, "Mine.step: IndexError", processor.process, np.array([[0.0, 7.0]]))
    assert processor.index == 1  # as its states
    assert str(e).startswith(at("# here"))


@pytest.mark.parametrize(
    "change",
    [
        ("2.0 * x", "3.0 * x"),
        ("class State", "\nclass State"),
        pytest.param(
            ("@static", "x = 0\n\n    @static"),
            marks=pytest.mark.skipif(
                sys.version_info >= (3, 13), reason="Python finds the text there, and it is equal"
            ),
        ),
        ("2.0 * x", "(2.0 * x"),
    ],
)
def test_a_step_whose_file_was_edited_after_import_is_refused_by_the_compiler(mine, change):
    """The text is read when a step is first compiled: another one would give other
    samples than the interpreter's.
    """
    cls, at = mine(body("return 2.0 * x, s"))
    file = Path(at("@staticmethod").rsplit(":", 2)[0])
    text, scene = file.read_text(), Scene({"y": cls(x)})
    file.write_text(text.replace(*change))
    refused(
        SceneError, r"no longer what was imported.*start Python again", stimlib.compile, scene, 1000
    )
    file.write_text(text)
    stimlib.compile(scene, 1000)


# What a step may say ------------------------------------------------------------------
class State(NamedTuple):
    y: float


class Numbers(NamedTuple):
    table: np.ndarray
    seed: np.uint64
    gain: float


def test_a_step_changed_in_place_is_compiled_again():
    """As a notebook does when a cell runs again."""

    @dataclass(frozen=True, eq=False)
    class Changed(Block):
        x: Block

        @staticmethod
        def step(p, s, x):
            return x + 1.0, s

    def other(p, s, x):
        return x + 2.0, s

    assert played(Changed(x), [0.0]) == 1.0
    scene = Scene({"y": Changed(x)})
    assert stimlib.render(scene, {"x": np.zeros(1)}, 1000)["y"] == 1.0
    Changed.step = staticmethod(other)
    for target in ("llvm", "python"):
        assert stimlib.render(scene, {"x": np.zeros(1)}, 1000, target=target)["y"] == 2.0
        assert played(Changed(x), [0.0], target=target) == 2.0
        assert played(own(step=staticmethod(low))(x), [1.0], target=target) == 2.0


class Gain(NamedTuple):
    gain: float


def designed(self, fs):
    return Gain(2.0), State(0.0)


def low(p: Gain, s: State, x: "float") -> "tuple[float, State]":
    """Types and a docstring are allowed, and the fields of a tuple by name."""
    return p.gain * x, State(y=x)


class Contact(NamedTuple):
    last: float
    cold: float


def own(**members):
    members = {
        "__annotations__": {"x": Block},
        "__module__": __name__,
        "design": designed,
        **members,
    }
    return dataclass(frozen=True, eq=False)(type("Mine", (Block,), members))


@pytest.mark.parametrize("returned", ["", "N", None, 1.0])
def test_units_returns_a_unit(returned):
    mine = own(units=lambda self, *u: returned, step=staticmethod(low))
    error = refused(SceneError, r"Mine.units: it returned .*core.units.unit", mine, x)
    assert __file__ in str(error)
    mine = own(units=lambda self, *u: u[0] * "m", step=staticmethod(low))
    refused(UnitError, r"write unit\('m'\)", mine, x)


def test_every_block_we_ship_keeps_what_it_asks_of_others():
    for entry in TABLE_OF_BLOCKS:
        program = program_of(entry.scene())
        design = design_of(program, entry.rates[0])
        assert len(design) == len(program.instances)
        for q, (p, s) in zip(program.instances, design, strict=True):
            blocks = (
                zip(q.block.members, q.block.parts(p, s), strict=True)
                if isinstance(q.block, Cycle)
                else [(q.block, (p, s))]
            )
            for block, numbers in blocks if q.kind == "block" else ():
                steps.rehearse(block, *numbers)
                if block.definition is (cls := type(block)):
                    steps.check_block(cls, None, *map(type, numbers))


# Contact ------------------------------------------------------------------------------
def summed(p, s, x):
    return where(s.cold > 0.0, x, s.last + x), Contact(x, 0.0)


def summed_cold_negative(p, s, x):
    return where(s.cold > 0.0, x, s.last + x), Contact(x, -1.0)


def summed_tile(p, s, x, y):
    last = where(s.cold > 0.0, 0.0, s.last)
    for i in range(x.size):
        y[i], last = last + x[i], x[i]
    return Contact(last, s.cold)


def first_told(p, s, x):
    return where(s.cold > 1.5, x + 100.0, x), Contact(x, 0.0)


@pytest.mark.parametrize("target", ["python", "llvm"])
def test_the_first_contact_is_the_first_however_late_it_is(target):
    """What design says of cold is there until a sample in contact."""
    mine = own(
        step=staticmethod(first_told),
        design=lambda self, fs: ((), Contact(0.0, 2.0)),
        resettable=True,
        __annotations__={"x": Block, "contact": Block},
    )
    proc = stimlib.compile(Scene({"y": mine(x, Input("touch"))}), 1000, target)
    given = rows(proc, np.array([np.arange(1.0, 8.0), [0, 0, 1, 1, 0, 1, 1]]), ["x", "touch"])
    for cut in (7, 1):
        assert run(proc, given, cut_at(7, cut))[0].tolist() == [0, 0, 103, 4, 0, 6, 7]
        proc.reset()


def clearing_tile(p, s, x, y, w):
    for i in range(w.size):
        w[i] = 0.0
    for i in range(x.size):
        y[i] = x[i] + w[i]
    return Contact(0.0, 0.0)


def test_all_of_the_scratch_is_there_wherever_a_contact_begins():
    """And as much as the block wants that wants most."""
    much, little = (
        own(
            tile=staticmethod(clearing_tile),
            work=staticmethod(lambda p, size=size: size),
            resettable=True,
            design=lambda self, fs: ((), Contact(0.0, 1.0)),
            __annotations__={"x": Block, "contact": Block},
        )
        for size in (1000, 64)
    )
    for classes in ((much, little), (little,)):
        blocks = {f"y{k}": cls(x, Input("touch")) for k, cls in enumerate(classes)}
        proc = stimlib.compile(Scene(blocks), 1000)
        for begin in (1, 8, 40, 63):
            moved, touch = np.arange(1.0, 65.0), np.arange(64.0) >= begin
            y = proc.process(rows(proc, np.array([moved, touch]), ["x", "touch"]))
            assert_same(y, np.stack([moved * touch] * len(classes)))


@pytest.mark.parametrize("first", [1.0, 2.0])
@pytest.mark.parametrize("target", ["python", "llvm", "jax"])
def test_the_engine_alone_says_where_a_contact_begins(target, first):
    moves = np.array([np.arange(1.0, 13.0), [0, 1, 1, 1, 0, 0, 1, 1, 0, 1, 1, 1]])
    for step in (summed, summed_cold_negative, summed_tile):
        members = {
            "tile" if step is summed_tile else "step": staticmethod(step),
            "design": lambda self, fs: ((), Contact(0.0, first)),
        }
        mine = own(**members, resettable=True, __annotations__={"x": Block, "contact": Block})
        if target == "jax" and step is summed_tile:
            continue  # has no step to run
        for on, wanted in (
            (Input("touch"), [0, 2, 5, 7, 0, 0, 7, 15, 0, 10, 21, 23]),
            (constant(1.0), 2 * moves[0] - 1),
        ):
            proc = stimlib.compile(Scene({"y": mine(x, on)}), 1000, target)
            given = rows(proc, moves, ["x", "touch"])
            y = proc(motion=given)["y"] if target == "jax" else proc.process(given)[0]
            assert y.tolist() == list(wanted), (step.__name__, y)


@pytest.mark.parametrize("t", [np.array([3, 5]), np.array([3, 5], np.float32)], ids=str)
def test_parameters_that_are_whole_or_short_numbers_are_floats_to_the_compiler(t):
    def step(p, s, x):
        return x * p.table[1], s

    block = own(
        design=lambda self, fs: (Numbers(t, np.uint64(0), 1.0), ()), step=staticmethod(step)
    )
    for target in ("llvm", "python"):
        y = stimlib.compile(Scene({"y": block(x)}), 1000, target).process(np.full((1, 2), 2.0))
        assert y.tolist() == [[10.0, 10.0]]


@pytest.mark.parametrize("zero", [0, np.int64(0), np.float32(0.0)], ids=lambda v: type(v).__name__)
@pytest.mark.parametrize("target", ["llvm", "python", "jax"])
def test_a_state_that_begins_with_a_whole_or_short_number_is_a_float(target, zero):
    def step(p, s, x):
        return s.y + 0.1 * x, State(s.y + 0.1 * x)

    summing = own(design=lambda self, fs: ((), State(zero)), step=staticmethod(step))
    looped = loop(lambda last: 0.5 * last + summing(last + x))
    proc = stimlib.compile(Scene({"y": summing(x), "z": looped}), 1000, target)
    given = np.ones((1, 4))
    y = [*proc(motion=given).values()] if target == "jax" else proc.process(given)
    assert np.abs(y[0] - [0.1, 0.2, 0.3, 0.4]).max() < 1e-12
    assert np.abs(y[1] - [0.1, 0.26, 0.466, 0.7156]).max() < 1e-12


def above(p, s, x):
    return x > 0.0, s


def whole(p, s, x):
    return np.int64(where(x > 0.0, 1.5, 0.5)), s


def counting(p, s, x):
    return where(x > 0.0, 1, 0), s


@pytest.mark.parametrize("step", [above, whole, counting], ids=lambda f: f.__name__)
@pytest.mark.parametrize("target", ["llvm", "python", "jax"])
def test_samples_that_are_comparisons_or_whole_numbers_are_floats(target, step):
    block = own(step=staticmethod(step))
    both = block(x) + block(Input("touch"))
    scene = Scene({"y": both - block(x), "z": fir(block(x), [0.5, 0.25]), "n": -block(x)})
    proc = stimlib.compile(scene, 1000, target)
    given = rows(proc, np.array([[1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0]]), ["x", "touch"])
    y = (
        proc(motion=given)
        if target == "jax"
        else dict(zip("yzn", proc.process(given), strict=True))
    )
    assert y["y"].tolist() == [1, 1, 0, 1] and y["n"].tolist() == [-1, 0, -1, -1]
    assert y["z"].tolist() == [0.5, 0.25, 0.5, 0.75]
