"""What a step may say: every remedy is named with file and line; every step that
stimlib ships passes.
"""

import importlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from contract import TABLE as TABLE_OF_BLOCKS
from contract import ours
from laws import assert_same

import stimlib
from stimlib import Input, Scene, constant
from stimlib.core import maths, steps
from stimlib.core.cycles import Cycle
from stimlib.core.graph import Block
from stimlib.core.maths import fma, sin, where
from stimlib.core.program import design_of, program_of
from stimlib.errors import SceneError, UnitError

x = Input("x")
LIMIT = 4.0
EXPONENTS = (1, 2)
TABLE = np.ones(3)


class State(NamedTuple):
    y: float


class Numbers(NamedTuple):
    table: np.ndarray
    seed: np.uint64
    gain: float


class Memory(NamedTuple):
    line: np.ndarray
    n: np.uint64
    y: float


def twice(v):
    return 2.0 * v


def clipped(v):
    return where(v > LIMIT, LIMIT, twice(v) * 0.5)


def recovers(v):
    return recovers(v)


def powered(v):
    return v**2


def refused(step, *words, target="numba"):
    """Compiling a block with this step is a SceneError that has these words, and the
    place of the line marked # here.
    """
    cls = dataclass(frozen=True, eq=False)(
        type(
            "Mine",
            (Block,),
            {"__annotations__": {"x": Block}, "step": staticmethod(step), "__module__": __name__},
        )
    )
    with pytest.raises(SceneError) as e:
        stimlib.compile(Scene({"y": cls(x)}), 1000, target)
    message = str(e.value)
    for word in words:
        assert word in message, message
    return message


def line_of(marker):
    lines = Path(__file__).read_text().splitlines()
    return next(k for k, line in enumerate(lines, 1) if line.endswith(f"# {marker}"))


def test_if_is_refused():
    def step(p, s, x):
        if x > 0.0:  # here: if
            x = 0.0
        return x, s

    refused(step, f"{__file__}:{line_of('here: if')}", "where(c, a, b)", "step")


def test_conditional_expression_is_refused():
    def step(p, s, x):
        y = x
        return (y if y > 0.0 else 0.0), s  # here: ifexp

    refused(step, f":{line_of('here: ifexp')}", "where(c, a, b)")


def test_power_is_refused():
    def step(p, s, x):
        return x**2, s  # here: pow

    refused(step, f":{line_of('here: pow')}", "**", "multiply")


@pytest.mark.parametrize("word", ["and", "or", "not", "while"])
def test_words_that_choose_at_run_time_are_refused(word):
    def both(p, s, x):
        return (x > 0.0) and (x < 1.0), s

    def either(p, s, x):
        return (x > 0.0) or (x < 1.0), s

    def no(p, s, x):
        return not x, s

    def loop(p, s, x):
        while x > 0.0:
            x = x - 1.0
        return x, s

    refused(
        {"and": both, "or": either, "not": no, "while": loop}[word],
        f"`{word}`" if word in ("while", "not") else "`and`/`or`",
    )


def test_other_loops_are_refused():
    def step(p, s, x):
        for k in EXPONENTS:
            x = x * k
        return x, s

    refused(step, "for i in range(..)")


def test_numpy_functions_are_refused():
    def step(p, s, x):
        return np.sin(x), s  # here: numpy

    refused(step, f":{line_of('here: numpy')}", "np.sin", "stimlib.core.maths")


def test_builtin_functions_are_refused():
    def step(p, s, x):
        return round(x), s

    refused(step, "'round'", "stimlib.core.maths")


def test_unknown_names_are_refused():
    def step(p, s, x):
        return x * nowhere, s  # noqa: F821

    refused(step, "'nowhere'", "not defined")


def test_closures_are_refused():
    gain = 3.0

    def step(p, s, x):
        return gain * x, s

    refused(step, "closes over gain", "design(fs)")


def test_lambdas_are_refused():
    refused(lambda p, s, x: (x, s), "def")


def test_arrays_of_the_module_are_refused():
    def step(p, s, x):
        return x * TABLE[0], s

    refused(step, "'TABLE'", "design(fs)")


def test_comprehensions_try_and_with_are_refused():
    def comprehension(p, s, x):
        return [x for _ in range(3)][0], s

    def attempt(p, s, x):
        try:
            return x, s
        finally:
            pass

    def inner(p, s, x):
        f = lambda v: v  # noqa: E731
        return f(x), s

    for step in (comprehension, attempt, inner):
        refused(step, "straight-line")


def test_a_helper_is_held_to_the_same_rules():
    def step(p, s, x):
        return powered(x), s

    refused(
        step,
        "powered",
        "**",
        f":{Path(__file__).read_text().splitlines().index('    return v**2') + 1}",
    )


def test_a_helper_that_calls_itself_is_refused():
    def step(p, s, x):
        return recovers(x), s

    refused(step)


def test_methods_are_refused():
    def step(p, s, x):
        return x.item(), s

    refused(step, "x.item")


def test_a_step_of_the_wrong_shape_says_which_class():
    def step(p, s, x):
        return x

    refused(step, "Mine")


@dataclass(frozen=True, eq=False)
class Everything(Block):
    """All that a step may use."""

    x: Block

    def design(self, fs):
        return Numbers(np.array([0.5, 0.25, 2.0]), np.uint64(2**63 + 5), 0.9), Memory(
            np.zeros(5), np.uint64(3), 0.0
        )

    @staticmethod
    def step(p, s, x):
        i = np.int64(s.n % np.uint64(s.line.size))
        old = s.line[i]
        s.line[i] = x
        total = 0.0
        for k in range(p.table.size):
            total += p.table[k] * old
        y = maths.flush(fma(p.gain, s.y, total)) + sin(x) + clipped(abs(-x)) + (x != x)
        n = ((s.n + p.seed) >> np.uint64(1)) ^ np.uint64(12345)
        y = where((n & np.uint64(1)) == np.uint64(0), y, maths.unbits(maths.bits(y)) * LIMIT)
        a, (c, d) = y, (1.0, 2.0)
        return a + c - d / 4.0 + maths.as_float(n) * 1e-25, Memory(
            s.line, s.n + np.uint64(1), maths.tanh(y)
        )


def test_what_a_step_may_use_has_the_same_bits_everywhere():
    scene = Scene({"y": Everything(x)})
    u = np.random.default_rng(0).standard_normal((1, 200))
    procs = [stimlib.compile(scene, 1000, t) for t in ("numba", "python")]
    assert_same(*(p.process(u) for p in procs))
    assert_same(*(p.state for p in procs))


def test_every_step_and_tile_we_ship_is_straight_line():
    written = {(f, f is c.tile) for c in ours().values() for f in (c.step, c.tile) if f is not None}
    assert len(written) > 20
    for f, tile in written:
        steps.check(f, tile)
    for c in ours().values():
        assert (
            c.step is not None
            or c.tile is not None
            or c.__name__ in ("Input", "Const", "Enabled", "Segment", "Pick", "Loop", "Last", "Tap")
        ), c


def test_blocks_import_no_target_and_no_plotting_at_module_level():
    for path in Path(stimlib.__file__).parent.glob("blocks/*.py"):
        for line in path.read_text().splitlines():
            assert not re.match(
                r"(import|from) (numba|jax|scipy|soundfile|matplotlib|pint)\b", line
            ), f"{path}: {line}"


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

    u = np.zeros((1, 1))
    assert stimlib.compile(Scene({"y": Changed(x)}), 1000).process(u) == 1.0
    Changed.step = staticmethod(other)
    for target in ("numba", "python"):
        assert stimlib.compile(Scene({"y": Changed(x)}), 1000, target).process(u) == 2.0


# What authors forget ------------------------------------------------------------------
class Gain(NamedTuple):
    gain: float


def designed(self, fs):
    return Gain(2.0), State(0.0)


def low(p, s, x):
    return p.gain * x, State(x)


def with_self(self, p, s, x):  # here: self
    return x, s


def few(p, s):  # here: few
    return 1.0, s


def state_forgotten(p, s, x):
    return p.gain * x  # here: state


def state_forgotten_by_name(p, s, x):
    y = maths.sqrt(x)
    return y  # here: state by name


def state_lost(p, s, x):
    return x, ()  # here: lost


def state_set(p, s, x):
    s.y = x  # here: set
    return x, s


def dividing_in_design(self, fs):
    return Gain(1.0 / 0), State(0.0)


def nothing_returned(p, s, x):  # here: nothing
    x = 2.0 * x


def misspelt(p, s, x):
    return p.gian * x, s  # here: gian


def misspelt_state(p, s, x):
    return x + s.z, s  # here: z


def tile_without_state(p, s, x, y):  # here: tile
    for i in range(x.size):
        y[i] = x[i]


def dotted(p, s, x):
    return stimlib.core.maths.sqrt(x), s  # here: dotted


def plain_tuples(self, fs):  # here: plain
    return (1.0,), (2.0,)


def only_parameters(self, fs):
    return Gain(2.0)


def no_design(self, fs):
    pass


def text_in_design(self, fs):  # here: text
    return Gain("2"), State(0.0)


def matrix_in_design(self, fs):
    return Gain(np.zeros((2, 2))), State(0.0)


def too_many(p, s, x):
    return x, State(x, x)  # here: too many


def too_few(p, s, x):
    return x, State()  # here: too few


def two_arguments(p, s, x):
    y = where(x > 0, x)  # here: two
    return y, State(y)


def wrong_tuple(p, s, x):
    return x, Gain(x)  # here: wrong tuple


def not_set(p, s, x):
    y += x  # noqa: F821  # here: not set
    return y, State(y)


def sine_of_two(p, s, x):
    return sin(x, 1), s  # here: sine


def abs_of_two(p, s, x):
    return abs(x, 2), s  # here: abs


def index_of_number(p, s, x):
    return x * s.y[0], s  # here: index


def text(p, s, x):
    return x + "1", s  # here: str


def unknown_field(p, s, x):
    return x, State(y=x, q=1.0)  # here: q


def named_argument(p, s, x):
    return sin(x=x), s  # here: named


def floor_division(p, s, x):
    return x // 1, s  # here: floor


def smaller(p, s, x):
    y = min(x, 1.0)  # here: min
    return y, s


def float_range(p, s, x):
    for _ in range(p.gain):  # here: range
        x = 2.0 * x
    return x, s


def local_float_range(p, s, x):
    n = 2.0 * x
    for _ in range(n):  # here: local range
        x = 2.0 * x
    return x, s


def two_samples(p, s, x):
    return (x, x), s  # here: pair


def whole_state(p, s, x):
    return x, State(0)  # here: whole


def other_array(p, s, x):
    return x, Memory(maths.words(p.table), s.n, s.y)  # here: array


def with_arrays(self, fs):
    return Numbers(np.zeros(3), np.uint64(1), 1.0), Memory(np.zeros(3), np.uint64(1), 1.0)


class Contact(NamedTuple):
    last: float
    cold: float


def cold_in_design(self, fs):  # here: cold
    return (), Contact(0.0, 0.0)


def own(**members):
    members = {
        "__annotations__": {"x": Block},
        "__module__": __name__,
        "design": designed,
        **members,
    }
    return dataclass(frozen=True, eq=False)(type("Mine", (Block,), members))


@pytest.mark.parametrize("target", ["python", "numba", "jax"])
@pytest.mark.parametrize(
    ("members", "line", "says"),
    [
        (
            {"step": with_self},
            "self",
            "Mine.step: write @staticmethod above it: it has no self and is step(p, s, x)",
        ),
        (
            {"step": staticmethod(few)},
            "few",
            "Mine.step: it takes (p, s) and must take step(p, s, x)",
        ),
        (
            {"step": staticmethod(state_forgotten)},
            "state",
            "must return two things, the sample and the new state State(..)",
        ),
        (
            {"step": staticmethod(state_forgotten_by_name)},
            "state by name",
            "must return two things",
        ),
        ({"step": staticmethod(state_lost)}, "lost", "must return two things"),
        (
            {"step": staticmethod(state_set)},
            "set",
            "s.y cannot be set: parameters and state are tuples; return a new state",
        ),
        (
            {"step": staticmethod(low), "design": dividing_in_design},
            None,
            "Mine.design: ZeroDivisionError: ",
        ),
        ({"step": staticmethod(nothing_returned)}, "nothing", "must return two things"),
        (
            {"step": staticmethod(misspelt)},
            "gian",
            "Mine.step: p.gian is not there: design gives the parameters gain",
        ),
        (
            {"step": staticmethod(misspelt_state)},
            "z",
            "Mine.step: s.z is not there: design gives the state y",
        ),
        (
            {"tile": staticmethod(tile_without_state)},
            "tile",
            "Mine.tile: it must fill y and return the new state State(..)",
        ),
        (
            {"step": staticmethod(low), "design": plain_tuples},
            "plain",
            "Mine.design: it must return parameters and state",
        ),
        ({"step": staticmethod(low), "design": only_parameters}, None, "two NamedTuples"),
        ({"step": staticmethod(low), "design": no_design}, None, "and returned None"),
        (
            {"step": staticmethod(low), "design": text_in_design},
            "text",
            "Mine.design: parameters 'gain' is a str; floats",
        ),
        ({"step": staticmethod(low), "design": matrix_in_design}, None, "(2, 2) of float64"),
        (
            {"step": staticmethod(few), "resettable": True},
            "few",
            "a resettable block has a signal that resets it, the last one",
        ),
        (
            {"step": staticmethod(few), "resettable": True, "design": cold_in_design},
            "cold",
            "design: cold = 0.0 in the state",
        ),
        ({}, None, "Mine has neither a step nor a tile: write step(p, s, x)"),
        (
            {"step": staticmethod(too_many)},
            "too many",
            "State(x, x): it is State(y): too many positional arguments",
        ),
        (
            {"step": staticmethod(too_few)},
            "too few",
            "State(): it is State(y): missing a required argument: 'y'",
        ),
        (
            {"step": staticmethod(two_arguments)},
            "two",
            "it is where(c, a, b): missing a required argument: 'b'",
        ),
        (
            {"step": staticmethod(wrong_tuple)},
            "wrong tuple",
            "Mine.step: the new state must be the State(..) of design",
        ),
        ({"step": staticmethod(not_set)}, "not set", "Mine.step: UnboundLocalError"),
        ({"step": staticmethod(sine_of_two)}, "sine", "it is sin(x): too many"),
        ({"step": staticmethod(abs_of_two)}, "abs", "it is abs(x): too many"),
        ({"step": staticmethod(index_of_number)}, "index", "only arrays have an index"),
        ({"step": staticmethod(text)}, "str", "'1' is not a number"),
        (
            {"step": staticmethod(unknown_field)},
            "q",
            "it is State(y): got an unexpected keyword argument 'q'",
        ),
        ({"step": staticmethod(named_argument)}, "named", "give the arguments by place"),
        ({"step": staticmethod(floor_division)}, "floor", "use maths.floor(a / b)"),
        ({"step": staticmethod(smaller)}, "min", "write where(a < b, a, b) for 'min'"),
        (
            {"step": staticmethod(float_range)},
            "range",
            "range counts whole ones: range(np.int64(n))",
        ),
        (
            {"step": staticmethod(local_float_range)},
            "local range",
            "range counts whole ones: range(np.int64(n))",
        ),
        ({"step": staticmethod(two_samples)}, "pair", "Mine.step: the sample must be one number"),
        (
            {"step": staticmethod(whole_state)},
            "whole",
            "the new state's y must be a float as in design, and is 0; write 1.0",
        ),
        (
            {"step": staticmethod(other_array), "design": with_arrays},
            "array",
            "the new state's line must be ",
        ),
    ],
)
def test_mistakes_of_authors_name_class_file_line_and_remedy(members, line, says, target):
    with pytest.raises(SceneError) as e:
        stimlib.compile(Scene({"y": own(**members)(x)}), 1000, target)
    assert says in str(e.value) and "numba" not in str(e.value), e.value
    if line:
        assert str(e.value).startswith(f"{__file__}:{line_of(f'here: {line}')}: "), e.value


def plus_one(p, s, x):
    return x, Memory(s.line, s.n + 1, s.y)


def hidden(p, s, x, y):
    for i in range(y.size):
        if x[i] > 2.0:
            y[i] = x[i] + s  # here: hidden
    return s


@pytest.mark.parametrize(
    ("members", "line", "says"),
    [
        (
            {"step": staticmethod(plus_one), "design": with_arrays},
            "plus_one",
            "beside a np.uint64 write np.uint64(1), not 1",
        ),
        ({"tile": staticmethod(hidden)}, "here: hidden", "Mine.tile: it does not compile: "),
    ],
)
def test_what_only_the_compiler_sees_is_one_line_too(members, line, says):
    with pytest.raises(SceneError) as e:
        stimlib.compile(Scene({"y": own(**members)(x)}), 1000)
    at = line_of(line) if "here" in line else plus_one.__code__.co_firstlineno
    assert (
        str(e.value).startswith(f"{__file__}:{at}: Mine.")
        and says in str(e.value)
        and "\n" not in str(e.value)
    ), e.value


def beyond(p, s, x):
    s.line[np.int64(x)] = x  # here: beyond
    return x, s


def test_a_step_that_fails_while_it_runs_says_where():
    processor = stimlib.compile(
        Scene({"y": own(step=staticmethod(beyond), design=with_arrays)(x)}), 1000, "python"
    )
    with pytest.raises(SceneError, match="Mine.step: IndexError") as e:
        processor.process(np.array([[0.0, 7.0]]))
    assert str(e.value).startswith(f"{__file__}:{line_of('here: beyond')}: ")


def noted(p: Gain, s: State, x: "float") -> "tuple[float, State]":
    """Types and a docstring are allowed, and the fields of a tuple by name."""
    return x, State(y=p.gain * x)


def test_types_may_be_noted():
    for target in ("numba", "python"):
        process = stimlib.compile(
            Scene({"y": own(step=staticmethod(noted))(x)}), 1000, target
        ).process
        assert process(np.ones((1, 1))) == 1.0


def summed(p, s, x):
    return where(s.cold > 0.0, x, s.last + x), Contact(x, 0.0)


def summed_cold_kept(p, s, x):
    return where(s.cold > 0.0, x, s.last + x), Contact(x, s.cold)


def summed_cold_negative(p, s, x):
    return where(s.cold > 0.0, x, s.last + x), Contact(x, -1.0)


def summed_tile(p, s, x, y):
    last = where(s.cold > 0.0, 0.0, s.last)
    for i in range(x.size):
        y[i], last = last + x[i], x[i]
    return Contact(last, s.cold)


def first_told(p, s, x):
    return where(s.cold > 1.5, x + 100.0, x), Contact(x, 0.0)


@pytest.mark.parametrize("target", ["python", "numba"])
def test_the_first_contact_is_the_first_however_late_it_is(target):
    """What design says of cold is there until a sample in contact."""
    mine = own(
        step=staticmethod(first_told),
        design=lambda self, fs: ((), Contact(0.0, 2.0)),
        resettable=True,
        __annotations__={"x": Block, "contact": Block},
    )
    run = stimlib.compile(Scene({"y": mine(x, Input("touch"))}), 1000, target)
    given = {"x": np.arange(1.0, 8.0), "touch": np.array([0, 0, 1, 1, 0, 1, 1.0])}
    given = np.array([given[name] for name in run.inputs])
    for cut in (7, 1):
        y = np.concatenate(
            [run.process(np.ascontiguousarray(given[:, k : k + cut]))[0] for k in range(0, 7, cut)]
        )
        assert y.tolist() == [0, 0, 103, 4, 0, 6, 7]
        run.reset()


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
        run = stimlib.compile(Scene(blocks), 1000)
        for begin in (1, 8, 40, 63):
            touch = np.arange(64.0) >= begin
            given = {"x": np.arange(1.0, 65.0), "touch": touch.astype(float)}
            y = run.process(np.array([given[name] for name in run.inputs]))
            assert_same(y, np.stack([given["x"] * touch] * len(classes)))


@pytest.mark.parametrize("first", [1.0, 2.0])
@pytest.mark.parametrize("target", ["python", "numba", "jax"])
def test_the_engine_alone_says_where_a_contact_begins(target, first):
    touch = np.array([0, 1, 1, 1, 0, 0, 1, 1, 0, 1, 1, 1.0])
    moves = {"x": np.arange(1.0, 13.0), "touch": touch}
    for step in (summed, summed_cold_kept, summed_cold_negative, summed_tile):
        members = {
            "tile" if step is summed_tile else "step": staticmethod(step),
            "design": lambda self, fs: ((), Contact(0.0, first)),
        }
        mine = own(**members, resettable=True, __annotations__={"x": Block, "contact": Block})
        if target == "jax" and step is summed_tile:
            continue  # has no step to run
        for on, wanted in (
            (Input("touch"), [0, 2, 5, 7, 0, 0, 7, 15, 0, 10, 21, 23]),
            (constant(1.0), 2 * moves["x"] - 1),
        ):
            run = stimlib.compile(Scene({"y": mine(x, on)}), 1000, target)
            given = np.array([moves[name] for name in run.inputs])
            y = run(motion=given)["y"] if target == "jax" else run.process(given)[0]
            assert y.tolist() == list(wanted), (step.__name__, y)


def test_a_module_in_front_of_maths_is_an_error_that_says_what_to_write():
    refused(
        dotted,
        f":{line_of('here: dotted')}",
        "write `from stimlib.core import maths` above the class, and maths.sqrt here",
    )


@pytest.mark.parametrize("returned", ["", "N", None, 1.0])
def test_units_returns_a_unit(returned):
    with pytest.raises(SceneError, match=r"Mine.units: it returned .*stimlib.core.units.unit") as e:
        own(units=lambda self, *u: returned, step=staticmethod(low))(x)
    assert __file__ in str(e.value)
    with pytest.raises(UnitError, match=r"'m' is not a unit: write unit\('m'\)"):
        own(units=lambda self, *u: u[0] * "m", step=staticmethod(low))(x)


def test_every_block_we_ship_keeps_what_it_asks_of_others():
    for entry in TABLE_OF_BLOCKS:
        program = program_of(entry.scene())
        design = design_of(program, entry.rates[0])
        assert len(design) == len(program.instances)
        for q, (p, s) in zip(program.instances, design, strict=True):
            of_loop = isinstance(q.block, Cycle)
            blocks = (
                zip(q.block.members, q.block.made.parts(p, s), strict=True)
                if of_loop
                else [(q.block, (p, s))]
            )
            for block, numbers in blocks if q.kind == "block" else ():
                steps.rehearse(block, *numbers)


EDITED = """
from dataclasses import dataclass
from typing import NamedTuple
from stimlib.core.graph import Block

class P(NamedTuple):
    gain: float

@dataclass(frozen=True, eq=False)
class Edited(Block):
    x: Block

    def design(self, fs):
        return P(2.0), ()

    @staticmethod
    def step(p, s, x):
        return p.gain * x + 1.0, s
"""


@pytest.mark.parametrize(
    "change",
    [
        ("+ 1.0", "- 1.0"),
        ("+ 1.0", "+ 3.0"),
        ("class P", "\nclass P"),
        ("@static", "x = 0\n\n    @static"),
        ("p.gain", "(p.gain"),
    ],
)
def test_a_step_whose_file_was_edited_after_import_is_refused_by_the_compiler(
    tmp_path, monkeypatch, change
):
    """The text is read when a step is first compiled: another one would give other
    samples than the interpreter's.
    """
    file = tmp_path / f"edited_{abs(hash(change))}.py"
    file.write_text(EDITED)
    monkeypatch.syspath_prepend(tmp_path)
    scene = Scene({"y": importlib.import_module(file.stem).Edited(x)})
    file.write_text(EDITED.replace(*change))
    with pytest.raises(SceneError, match=r"no longer what was imported.*start Python again"):
        stimlib.compile(scene, 1000)
    file.write_text(EDITED)
    stimlib.compile(scene, 1000)
