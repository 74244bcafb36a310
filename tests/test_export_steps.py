"""Steps of users in C: what Python means, or a refusal with file and line."""

import shutil
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from exported import GCC, compared
from refusals import refused

import stimlib
from stimlib import Block, Input, Scene, compile
from stimlib.blocks import delay, springpot
from stimlib.core import maths
from stimlib.core.maths import where
from stimlib.errors import SceneError
from stimlib.export import export_c
from stimlib.export.translate import Unit
from stimlib.export.values import DOUBLE, FLOATS

LESS, MANY = -3, 100000


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
class WholeNumbers(Block):
    x: Block
    design = own

    @staticmethod
    def step(p, s, x):
        k = np.int64(40.0)
        y = x * -3 + where(x > 0.0, -1, 1) - -1 - LESS * -LESS
        y = y + MANY * MANY + (1 << 40) + (1 << (k & 63)) + 3000000000 - x * 100000 * 100000
        u = s.u * np.uint64(0x9E3779B97F4A7C15) + np.uint64(1)
        for _ in range(3):
            k = k * 6364136223846793005 + 1442695040888963407
        y = y + ((1 << 40) >> 37) + maths.as_float(1 << (s.u & np.uint64(40)))
        y = y + maths.as_float(np.int64(-40.0) - np.int64(x))
        y = y + (k >> 32) + p.a[abs(np.int64(-3.0))] + maths.as_float(u >> np.uint64(40))
        return y, S(y, u, s.buf)


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
        linux = bool_ = 1.0
        for i in range(3):
            gamma_ = gamma_ + i_1 * i + n_1 + t_1 - st_i1
        return gamma - 3.0 * gamma_ + p.short * p.long + linux + bool_, s


@dataclass(frozen=True, eq=False)
class Choices(Block):
    x: Block
    design = own

    @staticmethod
    def tile(p, s, x, y):
        n = np.int64(p.long) or 3
        g = (p.long - 4.0 or 3.0) * (p.short and 2)
        words = maths.words(s.buf)
        y[:] = x
        for i in range(y.size):
            words[-1] += np.uint64(3)
            s.buf[1:15] = s.buf[:14]
            s.buf[0] = y[i]
            y[i] = s.buf[-3] * g * n + (x[i] > 0.0 or s.buf[4]) + maths.as_float(words[15])
        return s


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


def squared(p, a):
    return a * a


def both(key, k):
    return 0.5 * maths.as_float(k ^ key), maths.as_float(k)


@dataclass(frozen=True, eq=False)
class ByAttribute(Block):
    x: Block
    design = own
    work = staticmethod(lambda p: 64)

    @staticmethod
    def tile(p, s, x, y, w):
        maths.each(squared, (), (x,), y)
        maths.pairs(both, s.u, s.u, w[: y.size])
        for i in range(y.size):
            y[i] += w[0]
        return s


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
def test_steps_mean_in_c_what_they_mean_in_python(tmp_path):
    @dataclass(frozen=True, eq=False)
    class Local(Block):  # its name in Python has <locals>
        x: Block
        design = own

        @staticmethod
        def step(p, s, x):
            return x * p.short, s

    x, way = Input("x"), 1.3 * np.sin(np.arange(200) / 7)
    blocks = [make(x) for make in (WholeNumbers, Places, Names, Choices, Kinds, Local)]
    scene = Scene({f"y{k}": block for k, block in enumerate(blocks)})
    samples = export_c(scene, 1000, tmp_path, {"x": way}, seconds=0.2).samples
    checks = ["-fsanitize=undefined", "-fno-sanitize-recover"]
    said = compared(tmp_path, "stimulus", GCC, options=[*checks, "-lm"])
    assert said == f"0 of {samples} samples differ\n"


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
def test_each_and_pairs_by_attribute_run_in_the_processor_and_in_c(tmp_path):
    scene, way = Scene({"y": ByAttribute(Input("x"))}), np.sin(np.arange(100) / 7)
    y = [compile(scene, 1000, target).process(way[None].copy()) for target in ("python", "numba")]
    assert y[0].tobytes() == y[1].tobytes() and np.ptp(y[0]) > 0.1
    samples = export_c(scene, 1000, tmp_path, {"x": way}, seconds=0.1).samples
    said = compared(tmp_path, "stimulus", GCC, options=["-lm"])
    assert said == f"0 of {samples} samples differ\n"


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
def test_a_long_delay_has_no_table_of_its_zeros(tmp_path):
    x = Input("x", "m")
    off = x > stimlib.constant(0.0, "m")
    scene = Scene({"y": delay(x, samples=90000), "v": springpot(x, 1.0, 0.5, contact=off)})
    way = np.sin(np.arange(300) / 7)
    samples = export_c(scene, 1000, tmp_path, {"x": way}, seconds=0.3).samples
    assert (tmp_path / "stimulus.c").stat().st_size < 40000
    said = compared(tmp_path, "stimulus", GCC, options=["-lm"])
    assert said == f"0 of {samples} samples differ\n"


def contained(x, a):
    return x in (1.0, 2.0)


def whole_arrays(x, a):
    return a * x


def every_second(x, a):
    return a[::2]


def shape(x, a):
    return a.ndim


def index_float(x, a):
    return a[x]


def shifted_float(x, a):
    return (x > 0.0) << x


def unpacked(x, a):
    y, z = a
    return y + z


def compared_kinds(x, a):
    return maths.bits(x) > -1


def rest_of_word(x, a):
    return maths.bits(x) % 7


def shifted_by_64(x, a):
    return maths.as_float(maths.bits(x) >> np.uint64(64))


def shifted_by_a_signal(x, a):
    return maths.as_float(1 << np.int64(x))


def kind_in_a_loop(x, a):
    u = np.uint64(1)
    for _ in range(2):
        u = x
    return u


@pytest.mark.parametrize(
    "step, why",
    [
        (contained, "is and in have no form in C"),
        (whole_arrays, "arithmetic with an array or a tuple"),
        (every_second, "a slice with a step"),
        (shape, "ndim has no form in C"),
        (index_float, "an index that is, or becomes, a float"),
        (shifted_float, "<< of a float"),
        (unpacked, "parts of an array"),
        (compared_kinds, "a uint64 beside a whole number"),
        (shifted_by_64, "by 64 or more, << and >> differ between targets"),
        (shifted_by_a_signal, "by 64 or more, << and >> differ between targets"),
        (rest_of_word, "% differs between targets; beside a uint64"),
    ],
)
def test_what_c_has_no_form_for_is_refused_with_its_line(step, why):
    line = step.__code__.co_firstlineno + 1
    refused(SceneError, f":{line}: {step.__name__}: {why}", Unit().function, step, [DOUBLE, FLOATS])


def test_a_kind_that_changes_in_a_loop_is_refused_with_its_line():
    line = kind_in_a_loop.__code__.co_firstlineno + 3
    says = f":{line}: kind_in_a_loop: u changes its kind"
    refused(SceneError, says, Unit().function, kind_in_a_loop, [DOUBLE, FLOATS])
