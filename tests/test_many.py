"""Many copies of a scene at once: the bits of each are those of a processor of its
own.
"""

import gc
import sys
import threading
import weakref

import numpy as np
import pytest
from laws import Set, assert_same, run
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnknownName, blocks, constant

FS, N = 1000, 400
both = pytest.mark.parametrize("target", ["llvm", "python"])
x, z = Input("x"), Input("z")
noise = blocks.enabled(blocks.pink_noise(1.0, seed=1, f_low=20.0), by=x)
speed = constant(1.0, "s") * blocks.velocity(x, 50.0, contact=z)
SCENE = Scene(
    {"y": Param("a", 1.0) * noise + blocks.delay(z, 5), "v": speed + blocks.white_noise(2)}
)
SEEDS = [3, 3, 0, 2**64 - 1, 5]


def made(target="llvm", seeds=SEEDS, threads=2, scene=SCENE):
    return stimlib.compile(scene, FS, target).many(seeds, threads)


def motions(copies=5, n=N):
    return np.random.default_rng(4).standard_normal((copies, 2, n))


def alone(target, u, sets):
    """Each copy by a processor of its own, in one go but for its settings."""
    procs = [stimlib.compile(SCENE, FS, target, seed) for seed in SEEDS]
    return np.stack([run(p, u[k], (), sets.get(k, ())) for k, p in enumerate(procs)])


@pytest.mark.parametrize(("threads", "block"), [(1, 1), (2, 63), (2, 400), (5, 65)])
def test_each_copy_is_a_processor_of_its_own(monkeypatch, threads, block):
    """Whatever is set where, in any number of threads, at any cut."""
    monkeypatch.setattr("stimlib.run.many.WORTHWHILE", 1)
    u = motions()
    sets = {
        0: [Set(0, "a", 2.0, 0.0)],
        1: [Set(70, "a", -1.0, 0.05), Set(300, "a", 3.0, 0.0)],
        4: [Set(301, "a", 0.5, 0.2)],
    }
    runs = made(threads=threads)
    y = np.empty((5, 2, N))
    places = sorted({*range(0, N, block), N, 70, 300, 301})
    for start, stop in zip(places, places[1:], strict=False):
        for k, calls in sets.items():
            for s in calls:
                if s.at == start:
                    runs[k].set(s.name, s.value, s.ramp)
        y[..., start:stop] = runs.process(np.ascontiguousarray(u[..., start:stop]))
    assert_same(y, alone("llvm", u, sets))
    assert [p.index for p in runs] == [N] * 5 and len(runs[1].log) == 2


@both
def test_one_motion_for_all(target, tmp_path):
    u = motions(1, 80)
    runs, wanted = made(target), made(target).process(np.repeat(u, 5, axis=0))
    out = np.full((5, 2, 80), np.nan)
    u.flags.writeable = False
    assert runs.process(u[0], out) is out
    assert_same(out, wanted)
    assert_same(out[0], out[1], "equal seeds")
    assert not np.any(out[0, 1] == out[2, 1]), "other seeds"
    mapped = np.memmap(tmp_path / "x", float, "w+", shape=u.shape)
    mapped[:], copies = u, made(target)
    assert_same(np.asarray(copies.process(mapped[0])), wanted)
    kept = np.memmap(tmp_path / "y", float, "w+", shape=out.shape)
    copies.reset()
    assert_same(np.asarray(copies.process(u[0], kept)), wanted)
    assert runs.process(np.zeros((2, 0))).shape == (5, 2, 0)


def test_more_outputs_than_inputs():
    u = motions()[:, :1].copy()
    y = made(scene=Scene({"a": 2.0 * x, "b": 3.0 * x, "c": blocks.delay(x, 1)})).process(u)
    late = np.pad(u[:, 0, :-1], ((0, 0), (1, 0)))
    assert_same(y, np.stack([2.0 * u[:, 0], 3.0 * u[:, 0], late], axis=1))


def test_in_place_but_not_shifted():
    u = motions()
    wanted = made().process(u)
    memory = np.zeros(u.size + 3)
    own = memory[:-3].reshape(u.shape)
    own[:] = u
    runs = made()
    for given, out in ((own, memory[3:].reshape(u.shape)), (own[0], own)):
        refused(BadValue, "out and x share memory", runs.process, given, out)
    assert_same(own, u, "nothing has run")
    assert_same(runs.process(own, own), wanted)


@both
def test_a_fault_is_that_of_one_copy(target):
    scene = Scene({"y": 1.0 / x})
    u = np.ones((3, 1, 50))
    u[1, 0, 20] = 0.0
    runs = made(target, range(3), scene=scene)
    y = runs.process(u)
    assert runs.fault == [None, ("y", 20), None] == [p.fault for p in runs]
    assert (y[[0, 2]] == 1.0).all() and np.isfinite(y).all()
    runs.reset()
    assert runs.fault == [None] * 3


@both
def test_state_and_reset(target):
    u = motions(n=60)
    runs = made(target)
    fresh, y = runs.state, runs.process(u)
    later = runs.state
    assert fresh.shape == (5, runs[0].state.size) and fresh.dtype == np.uint64
    rest = runs.process(u)
    runs.state = later
    assert_same(runs.process(u), rest)
    runs.set("a", 7.0)
    runs.reset()
    assert [p.params["a"] for p in runs] == [1.0] * 5 and runs[0].log == []
    assert_same(runs.state, fresh)
    runs.reset(SEEDS[::-1])
    assert [p.seed for p in runs] == SEEDS[::-1]
    assert_same(runs.state, fresh[::-1])
    assert_same(runs.process(np.ascontiguousarray(u[::-1])), y[::-1])


def test_more_seeds_than_are_remembered():
    runs = made(seeds=range(3))
    fresh = runs.state
    for first in range(3, 60, 3):
        runs.reset(range(first, first + 3))
    assert len(runs[0]._fresh) <= 11
    runs.reset(range(3))
    assert_same(runs.state, fresh)


def test_copies_run_alone_and_do_not_touch_what_they_were_made_of():
    proc, u, wanted = stimlib.compile(SCENE, FS, seed=3), motions(), made().process(motions())
    fresh = proc.state
    assert_same(proc.process(u[0]), wanted[0])
    proc.set("a", 9.0)
    runs = proc.many(SEEDS)
    for k in (4, 1):
        assert_same(runs[k].process(u[k]), wanted[k])
    assert [p.index for p in runs] == [0, N, 0, 0, N]
    runs.set("a", 0.0)
    assert proc.params == {"a": 9.0} and len(proc.log) == 1 and proc.index == N
    assert len(runs) == 5 and runs[-1].seed == 5 and [p.seed for p in runs[:2]] == [3, 3]
    runs.reset()
    assert_same(runs[0].state, fresh)
    assert repr(made(threads=1)) == "Copies(5 of Processor(x, z -> y, v, fs=1000, llvm), 1 threads)"


# threads ------------------------------------------------------------------------------
def test_copies_run_without_pythons_lock():
    """Another thread gets the lock while they run, although nobody has to give it
    away.
    """
    runs, u = made(threads=1), np.zeros((1, 2, 20000))
    out = np.empty((5, 2, 20000))
    asked, answered = threading.Event(), []
    thread = threading.Thread(target=lambda: (asked.wait(), answered.append(True)))
    usual = sys.getswitchinterval()
    try:
        sys.setswitchinterval(10.0)  # longer than the runs below take
        thread.start()  # until it waits
        asked.set()
        for _ in range(100):
            runs._run(np.zeros(1, np.int64), u, out)
            if answered:
                break
        assert answered, "Python's lock was held throughout"
    finally:
        sys.setswitchinterval(usual)
        thread.join()


def test_an_error_in_another_thread_is_told(monkeypatch):
    monkeypatch.setattr("stimlib.run.many.WORTHWHILE", 1)
    runs, began = made(), threading.Event()

    def broken(turn, x, out):
        if threading.current_thread() is threading.main_thread():
            assert began.wait(20)
            return
        began.set()
        raise MemoryError("no room")

    monkeypatch.setattr(runs, "_run", broken)
    refused(MemoryError, "no room", runs.process, motions())


# what cannot be meant -----------------------------------------------------------------
@both
def test_a_wrong_block_says_what_is_wanted(target):
    runs = made(target)
    for bad, says in (
        (np.zeros((3, 5)), r"\(2, n\) or \(5, 2, n\).*x, z.*\(3, 5\)"),
        (np.zeros((4, 2, 5)), r"\(5, 2, n\).*\(4, 2, 5\)"),
        (np.zeros(5), r"\(5,\)"),
        (np.zeros((5, 2, 5), np.float32), "float32.*astype"),
        (np.zeros((5, 2, 10))[..., ::2], "C-contiguous.*ascontiguousarray"),
        ([[1.0], [2.0]], "array.*list"),
    ):
        refused(BadValue, f"process: x .*{says}", runs.process, bad)
    shape = r"out must be float64 of shape \(5, 2, 4\).*got shape \(2, 4\)"
    refused(BadValue, shape, runs.process, np.zeros((2, 4)), np.zeros((2, 4)))
    assert [p.index for p in runs] == [0] * 5, "nothing has run"


@pytest.mark.parametrize(
    ("seeds", "threads", "words"),
    [
        (64, None, "range"),
        ({1, 2}, None, "range"),
        ("abc", None, "seed = 'a'"),
        ([], None, "range"),
        ([0, -1], None, "seed = -1"),
        (range(10**15), None, "limits.state_bytes"),
        (iter([1]), None, "range"),
        ([0.5], None, "seed = 0.5"),
        ([0], 0, "threads = 0"),
        ([0], 1.5, "threads = 1.5"),
        ([0], "two", "threads = 'two'"),
    ],
)
def test_copies_that_make_no_sense(seeds, threads, words):
    refused(BadValue, words, stimlib.compile(SCENE, FS).many, seeds, threads)


@both
def test_the_memory_of_copies_is_counted_before_it_is_taken(monkeypatch, target):
    """What each runs in, and its state at sample 0."""
    proc = stimlib.compile(Scene({"y": blocks.delay(x, 1000)}), FS, target)
    monkeypatch.setattr(stimlib.limits, "state_bytes", 1e6)
    refused(BadValue, "50000 processors.*limits.state_bytes", proc.many, range(50000))
    if target == "llvm":
        each = proc.many([0])[0]._engine.nbytes + proc.state.nbytes
        monkeypatch.setattr(stimlib.limits, "state_bytes", 3 * each)
        proc.many(range(3))
        monkeypatch.setattr(stimlib.limits, "state_bytes", 3 * each - 1)
        refused(BadValue, "of 3 processors", proc.many, range(3))


@both
def test_all_copies_are_changed_or_none(target):
    runs = made(target)
    runs.process(motions(n=20))
    before = runs.state
    wrong = before.copy()
    wrong[4, 0] = 0
    for error, words, change in [
        (BadValue, "5 copies, got 4", lambda: runs.set("a", [1.0] * 4)),
        (BadValue, "finite", lambda: runs.set("a", [1.0, 1.0, 1.0, 1.0, np.nan])),
        (BadValue, "must be a number", lambda: runs.set("a", "12345")),
        (BadValue, "must be a number", lambda: runs.set("a", dict.fromkeys(range(5), 1.0))),
        (BadValue, "ramp", lambda: runs.set("a", 1.0, -1.0)),
        (UnknownName, "no parameter 'b'", lambda: runs.set("b", 1.0)),
        (BadValue, "5 copies, got 1", lambda: runs.reset([1])),
        (BadValue, "seed = -1", lambda: runs.reset([1, 2, 3, 4, -1])),
        (BadValue, "5 copies, not 7", lambda: runs.reset(7)),
        (BadValue, "5 copies, got 1000000000000", lambda: runs.reset(range(10**12))),
        (BadValue, "another scene", lambda: setattr(runs, "state", wrong)),
        (BadValue, "5 copies, got 4", lambda: setattr(runs, "state", before[:4])),
    ]:
        refused(error, words, change)
    assert_same(runs.state, before)
    assert [p.seed for p in runs] == SEEDS and all(p.log == [] for p in runs)


def test_what_a_thread_runs_lives_as_long_as_it():
    """Its caller may have been interrupted, twice, and have gone."""
    runs = made()
    work, memory = runs._run, weakref.ref(runs[0]._engine)
    del runs
    gc.collect()
    assert memory() is not None
    del work
    gc.collect()
    assert memory() is None
