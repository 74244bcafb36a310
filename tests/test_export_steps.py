"""Steps of users in C: what Python means, or a refusal with file and line."""

import runpy
import shutil
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from exported import GCC, EveryNodeOfAStep, EveryNodeOfATile, same
from refusals import refused

import stimlib
from stimlib import Block, Input, Scene, SceneError, compile
from stimlib.blocks import delay, lut, springpot
from stimlib.core import maths
from stimlib.export import export_c
from stimlib.export.translate import Unit

EDGES = [0.0, -0.0, 1.0, -1.0, 1.5, -2.0, 2.5, -2.5, -3.0, 5.0, -7.5, 1e-250, -1e-250, 1e-251]
EDGES += [-1e-189, -0.3, 0.3, 99.5, -99.5, -6.0, 6.0, 2.0, 3.0]
needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")


class P(NamedTuple):
    short: float
    long: float
    a: np.ndarray


class S(NamedTuple):
    y: float
    u: np.uint64
    buf: np.ndarray


def double(x):
    return x * 2, ()


def own(self, fs):
    table = np.arange(1.0, 9.0) + len(type(self).__name__)  # each class has another beside it
    return P(0.5, 4.0, table), S(0.25, np.uint64(77), np.zeros(16))


@dataclass(frozen=True, eq=False)
class Places(Block):
    x: Block
    design = own

    @staticmethod
    def step(p, s, x):
        i, j = 1, -2
        i, j = j, i
        t = (x, 2.0 * x, 5.0 * x)
        a = b = x = x + 1.0
        z, _ = double(a)
        y = p.a[-1] + p.a[i] * p.a[j] + p.a[np.int64(x * 0.1) - 1] + t[-1] + t[0]
        tail, head = p.a[-3:], p.a[:-2]
        y = y + tail[0] + head[head.size - 1] + z + b
        for k in range(3):
            y = y + k + p.a[k - 2]
        else:
            y = y + 100.0
        return y, s


@dataclass(frozen=True, eq=False)
class Names(Block):
    x: Block
    design = own

    @staticmethod
    def step(p, s, x):
        gamma = x
        gamma_ = 2.0 * x
        i_1 = n_1 = t_1 = 5.0 * x
        st_i1 = 0.5
        linux = bool_ = explicit = nullptr = DBL_MAX = 1.0
        for i in range(3):
            gamma_ = gamma_ + i_1 * i + n_1 + t_1 - st_i1
        gamma_ = gamma_ + explicit + nullptr + DBL_MAX
        return gamma - 3.0 * gamma_ + p.short * p.long + linux + bool_, s


def halved(k, n):
    n = n * n % 7
    k = 0.5 * k
    return k + n


def halved_often(k):
    below = k % 5
    for _ in range(3):
        k = 0.5 * k
    return k + below


def from_last(a, k):
    y = a[k]
    for k in range(2):
        y = y + a[k]
    return y


@dataclass(frozen=True, eq=False)
class Kinds(Block):
    """Names that stand for one kind after the other, as Python's do."""

    x: Block
    design = own

    @staticmethod
    def step(p, s, x):
        k = np.int64(x * 9.0) * 6364136223846793005
        y = maths.as_float(np.uint64(k % 1000))  # with all digits
        k = k * 5e-20
        u = s.u + np.uint64(1)
        y = (
            y
            + np.int64(x * 9.0) / 4
            + k
            + halved(np.int64(x * 20.0), -3)
            + halved_often(np.int64(x * 30.0))
        )
        x = maths.bits(x)
        y = y + maths.as_float(x >> np.uint64(60)) + from_last(p.a, np.int64(-2.0))
        x = (y, x)
        return x[0], S(buf=s.buf, y=y, u=u ^ x[1])


def has_the_same_bits(scene, way, folder, *checks):
    samples = export_c(scene, 1000, folder, {"x": way}, seconds=len(way) / 1000).samples
    return same(folder, "stimulus", samples, GCC, options=[*checks, "-lm"])


@needs_gcc
def test_steps_mean_in_c_what_they_mean_in_python(tmp_path):
    @dataclass(frozen=True, eq=False)
    class Local(Block):  # its name in Python has <locals>
        x: Block
        design = own

        @staticmethod
        def step(p, s, x):
            return x * p.short, s

    x, way = Input("x"), 1.3 * np.sin(np.arange(200) / 7)
    blocks = [make(x) for make in (Places, Names, Kinds, Local)]
    scene = Scene({f"y{k}": block for k, block in enumerate(blocks)})
    assert has_the_same_bits(scene, way, tmp_path, "-fsanitize=undefined", "-fno-sanitize-recover")


@needs_gcc
@pytest.mark.parametrize("block", [EveryNodeOfAStep, EveryNodeOfATile])
def test_nodes_have_the_bits_of_the_interpreter_in_the_processor_and_in_c(block, tmp_path):
    made = block(Input("x"))
    scene = Scene({n: getattr(made, n) for n in block.outputs} or {"y": made})
    way = np.resize(EDGES, 300)
    first, other = (
        compile(scene, 1000, target).process(way[None, :46].copy()) for target in ("python", "llvm")
    )
    assert first.tobytes() == other.tobytes() and np.unique(first).size > 10
    assert has_the_same_bits(scene, way, tmp_path)


@needs_gcc
def test_a_long_delay_has_no_table_of_its_zeros(tmp_path):
    x = Input("x", "m")
    off = x > stimlib.constant(0.0, "m")
    scene = Scene({"y": delay(x, samples=90000), "v": springpot(x, 1.0, 0.5, contact=off)})
    assert has_the_same_bits(scene, np.sin(np.arange(300) / 7), tmp_path)
    assert (tmp_path / "stimulus.c").stat().st_size < 40000


BITS = "maths.bits(x)"


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("return maths.where(x is not a, 1.0, 2.0)", "`is` and `in` with a number"),
        ("return a * x", "arithmetic with a whole array"),
        ("return a[::2]", "a slice of a number, or with a step"),
        ("return a.ndim", "a.ndim: only fields"),
        ("return abs(np.sin(x))", "a call of sin"),
        ("return a[x]", "an index that is a float"),
        ("return a[:x].size", "an index that is a float"),
        ("return (x > 0.0) << x", "a shift of a float"),
        ("y, z = a", "a number has no parts"),
        ("return x and maths._less_half_pi(x)[0]", "a tuple of a helper behind `and`"),
        (f"return {BITS} > -1", "a uint64 and a whole number"),
        (f"return {BITS} + np.int64(x)", "a uint64 and a whole number"),
        ("for i in range(0, 4, np.int64(x)): x += i", "the step of a range must be"),
        ("a[1:3] = a[2:4] = maths.words(a)[1:3]", "elements of another kind"),
        ("u = np.uint64(1)\n    for _ in range(2):\n        u = x", "u is u8 and becomes f8"),
    ],
)
def test_what_c_has_no_form_for_is_refused_with_its_line(body, says, tmp_path):
    path = tmp_path / "own.py"
    head = "import numpy as np\nfrom stimlib.core import maths\ndef f(x, a):\n"
    path.write_text(f"{head}    {body}\n    return x\n")
    f, line = runpy.run_path(str(path))["f"], 4 + body.count("\n")
    error = refused(SceneError, f"own.py:{line}: f: {says}", Unit().function, f, ["f8", "f8*"])
    assert "so it cannot be exported" in str(error)


@needs_gcc
@pytest.mark.parametrize("jitter", [0.0, 0.4, 0.8])
def test_a_table_finds_the_piece_at_its_knots(jitter, tmp_path):
    rng = np.random.default_rng(3)
    knots = 0.3 * np.arange(40) - 5.0
    knots[1:-1] = np.sort(knots[1:-1] + 0.3 * jitter * rng.uniform(-1, 1, 38))
    x = np.concatenate([knots, *np.nextafter(knots, [[-9], [99]]), [-6.0, 8.0]])
    # lines with a jump of the slope at each knot; a wrong piece has other last bits
    scene = Scene({"y": lut(Input("x"), knots, rng.standard_normal(40))})
    made = export_c(scene, 1000, tmp_path, {"x": x}, "table", x.size / 1000)
    assert same(tmp_path, "table", made.samples, GCC)
