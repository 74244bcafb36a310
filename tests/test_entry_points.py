"""A call without a dispatcher: machine code looks at the arrays itself, anew each
time.
"""

import pickle
import sys

import numpy as np
import pytest
from laws import assert_same
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Scene
from stimlib.targets.llvm import entry_points


@pytest.fixture(scope="module")
def proc():
    return stimlib.compile(Scene({"y": Input("x") + Input("z")}), 1000)


def unaligned(shape):
    return np.zeros(8 * np.prod(shape) + 1, np.uint8)[1:].view(float).reshape(shape)


def fixed(a):
    a.flags.writeable = False


@pytest.mark.filterwarnings("ignore:Setting the (dtype|shape)")  # which numpy 2.5 would not have
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x, out: setattr(x, "dtype", np.int64), "x must be float64 .* int64"),
        (lambda x, out: setattr(x, "dtype", ">f8"), "x must be float64 .* >f8"),
        (lambda x, out: setattr(out, "dtype", "m8[s]"), "out must be float64 .* timedelta64"),
        (lambda x, out: setattr(x, "shape", (1, 10)), r"x must be .* got shape \(1, 10\)"),
        (lambda x, out: setattr(x, "shape", (10,)), r"x must be .* got shape \(10,\)"),
        (lambda x, out: setattr(out, "shape", (1, 1, 5)), r"out must be .* got shape \(1, 1, 5\)"),
        (lambda x, out: setattr(out, "shape", (1, 5, 1)), r"out must be .* got shape \(1, 5, 1\)"),
        (lambda x, out: x.resize((1, 5), refcheck=False), r"x must be .* got shape \(1, 5\)"),
        (lambda x, out: out.resize((1, 4), refcheck=False), r"out must be .* got shape \(1, 4\)"),
        (lambda x, out: fixed(out), "out is read-only"),
    ],
)  # fmt: skip
def test_what_an_array_has_become_is_seen(proc, change, words):
    """It was good, and called with; nothing that was found then is trusted."""
    x, out, index = np.ones((2, 5)), np.zeros((1, 5)), proc.index
    proc.process(x, out)
    change(x, out)
    refused(BadValue, words, proc.process, x, out)
    assert proc.index == index + 5


@pytest.mark.parametrize(
    ("x", "out", "words"),
    [
        (unaligned((2, 5)), np.zeros((1, 5)), "x is not aligned"),
        (np.ones((2, 5)), unaligned((1, 5)), "out is not aligned"),
        (np.ma.masked_array(np.ones((2, 5)), True), None, "got MaskedArray"),
        (np.ones((2, 5)), np.ma.masked_array(np.ones((1, 5))), "got MaskedArray"),
    ],
)
def test_what_compiled_code_cannot_take_is_refused(proc, x, out, words):
    refused(BadValue, words, proc.process, x, out)


def test_arrays_of_other_makers(proc, tmp_path):
    """An unpickled array has a type object of its own; a mapped file is of a class
    derived from numpy's.
    """
    x = np.random.default_rng(0).standard_normal((2, 5))
    other = pickle.loads(pickle.dumps(x))
    assert other.dtype is not x.dtype, "or this tests nothing"
    mapped = np.memmap(tmp_path / "x", float, "w+", shape=(2, 5))
    out = np.memmap(tmp_path / "y", float, "w+", shape=(1, 5))
    mapped[:] = x
    assert proc.process(mapped, out) is out
    for y in (proc.process(other), np.asarray(out)):
        assert_same(y, x[:1] + x[1:])


def test_a_call_keeps_and_takes_nothing(proc):
    """References are as before, whatever the call says; wrong numbers of arguments are
    refused before they are looked at.
    """
    x, out = np.ones((2, 5)), np.zeros((1, 5))
    before = [sys.getrefcount(v) for v in (x, out, 0, 1)]
    for _ in range(100):
        assert proc._run(x, out) == 0
        for wrong in ((x, x), (x,), (), (x, out, out), (None, 1)):
            assert proc._run(*wrong) == 1
    after = [sys.getrefcount(v) for v in (x, out, 0, 1)]
    assert all(abs(a - b) < 20 for a, b in zip(before, after, strict=True))


def test_another_layout_of_arrays_costs_time_and_nothing_else(monkeypatch, proc, caplog):
    """Numpy's arrays have their words one further on, as another release may."""
    word = entry_points._word
    monkeypatch.setattr(entry_points, "_word", lambda address, k: word(address, k + 1))
    entry_points.array_words.cache_clear()
    with caplog.at_level("INFO"):
        assert entry_points.array_words() is None and "lays out its arrays" in caplog.text
    scene = stimlib.scenes.squeeze()
    slow = stimlib.compile(scene, 8000)
    monkeypatch.undo()
    entry_points.array_words.cache_clear()
    assert "checked" in slow._run.__qualname__ and "checked" not in repr(proc._run)
    x = 0.02 * np.sin(np.arange(1000.0)) * np.ones((2, 1))
    assert_same(slow.process(x), stimlib.compile(scene, 8000, target="python").process(x))
    assert slow.many(seeds=[1, 2]).process(x).shape == (2, 2, 1000)
    memory = np.ones(2001)
    overlapping = memory[1:].reshape(2, 1000), memory[:-1].reshape(2, 1000)
    for wrong in [(x, x[:1]), (x[:, ::2], None), (x.astype("f4"), None), overlapping]:
        refused(BadValue, None, slow.process, *wrong)
    assert slow._run(x) == slow._run(x, 3) == slow._run(x[0], x) == 1
