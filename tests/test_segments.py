"""A segment is a rendering of what is in it: sample 0, states at rest, noises and
motion of its own, on every target.
"""

import numpy as np
import pytest
from contract import EACH, TABLE
from laws import assert_same, mostly, random_cuts, rows, run
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, SceneError, UnknownName, blocks as b, constant
from stimlib.core.program import first_states
from stimlib.core.subsystems import Segment

SEEDS = (None, 5, None)
# each class on one target; the interpreter takes its time
CHOSEN = [(e.name, "llvm" if k % 4 else "python") for k, e in enumerate(EACH.values())]


def stretches(rng, count, longest):
    """First sample of each of several intervals, and the one after its last; the first
    may begin at 0, two may touch.
    """
    ends = np.cumsum(
        [(rng.choice([0, 1, 70, 200]), rng.integers(2, longest)) for _ in range(count)]
    )
    return [(int(a), int(z)) for a, z in ends.reshape(-1, 2)]


def in_turn(outputs, at, fs):
    """The outputs of a scene in each interval: output k of interval i is called
    name_i.
    """
    return Scene({
        f"{name}_{i}": b.segment(block, a / fs, (z - a) / fs, seed)
        for i, ((a, z), seed) in enumerate(zip(at, SEEDS, strict=False))
        for name, block in outputs.items()
    })  # fmt: skip


def check(scene, x, names, fs, at, target, rng, sets=()):
    """Samples of each interval are those of the scene alone, in random cuts; all others
    are 0.
    """
    whole = stimlib.compile(in_turn(scene.outputs, at, fs), fs, target, seed=7)
    alone = stimlib.compile(scene, fs, target)
    for name, value in sets:
        whole.set(name, value, 0.0)
    n = x.shape[1]
    y = dict(
        zip(whole.outputs, run(whole, rows(whole, x, names), random_cuts(n, rng)), strict=True)
    )
    for i, (a, z) in enumerate(at):
        alone.reset(7 if SEEDS[i] is None else SEEDS[i])
        for name, value in sets:
            alone.set(name, value, 0.0)
        wanted = run(alone, rows(alone, np.ascontiguousarray(x[:, a:z]), names))
        for name, row in zip(alone.outputs, wanted, strict=True):
            got = y[f"{name}_{i}"]
            assert_same(got[a:z], row, f"{name} in interval {i}, {a} to {z}")
            assert not got[:a].any() and not got[z:].any(), "nothing of it runs outside"


# Of every block -----------------------------------------------------------------------
@pytest.mark.parametrize(
    "case", mostly(CHOSEN, [(e.name, t) for e in TABLE for t in ("llvm", "python")]), ids="-".join
)
def test_a_segment_is_a_rendering(case):
    name, target = case
    k, entry = next((k, e) for k, e in enumerate(TABLE) if e.name == name)
    rng = np.random.default_rng(k)
    fs, count = float(rng.choice(entry.rates)), int(rng.integers(2, 4))
    at = stretches(rng, count, 400 if target == "llvm" else 60)
    x = entry.x(at[-1][1] + 100, fs, seed=k)
    check(entry.scene(), x, list(entry.inputs), fs, at, target, rng, [("live", 0.75)])


# What stands beside it ----------------------------------------------------------------
X = Input("x", "m")


def test_parts_of_one_run_share_it_and_others_do_not():
    """Of one time and seed all run together; equal blocks in other segments have states
    of their own.
    """
    noise = b.white_noise(3)
    together = Scene({"y": b.segment(noise, 0.0, 0.1), "z": b.segment(2.0 * noise, 0.0, 0.1)})
    assert sum(q.block.noise_key is not None for q in together.program.instances) == 1
    for start, seed in ((0.05, None), (0.0, 1)):
        apart = Scene(
            {"y": b.segment(noise, 0.0, 0.1), "z": b.segment(b.white_noise(3), start, 0.1, seed)}
        )
        y, z = stimlib.render(apart, {}, 1000, 0.2).y
        k = round(1000 * start)
        assert sum(q.block.noise_key is not None for q in apart.program.instances) == 2
        assert np.array_equal(y[:100], z[k : k + 100]) == (seed is None)
    refused(
        SceneError,
        "two noise sources have the key seed=3",
        Scene,
        {"y": b.segment(noise, 0.0, 0.1), "z": b.segment(b.white_noise(3), 0.0, 0.1)},
    )


def test_a_segment_begins_and_lasts_to_the_nearest_sample():
    for fs, start, duration, wanted in (
        (1000, 0.0106, 0.0026, [11, 12, 13]),
        (1000, 0.0104, 0.0024, [10, 11]),
        (8, 0.0625, 0.125, [1]),
    ):
        y = stimlib.compile(
            Scene({"y": b.segment(b.elapsed() + constant(1.0, "s"), start, duration)}), fs, "python"
        ).process(20)[0]
        assert np.flatnonzero(y).tolist() == wanted


def test_equal_segments_in_different_ones_are_apart():
    inner = [b.segment(b.white_noise(3), 0.0, 0.01) for _ in range(2)]
    scene = Scene({"y": b.segment(inner[0], 0.0, 0.02) + b.segment(inner[1], 0.05, 0.02)})
    y = stimlib.compile(scene, 1000, "python").process(80)[0]
    assert np.array_equal(y[:10], y[50:60]) and np.flatnonzero(y).tolist() == [
        *range(10),
        *range(50, 60),
    ]


def test_a_parameter_moves_within_a_segment_and_copies_are_apart():
    scene = Scene(
        {
            "y": b.segment(
                Param("a", 1.0) * b.enabled(Param("a", 1.0) * b.white_noise(1), by=X),
                0.01,
                0.05,
                seed=4,
            )
        }
    )
    x = np.where(np.arange(90) % 30 < 20, 1.0, -1.0)[None]
    wanted = {}
    for target in ("llvm", "python"):
        proc = stimlib.compile(scene, 1000, target)
        both = proc.many([0, 9])
        for p in (proc, both[1]):
            p.process(np.ascontiguousarray(x[:, :25]))
            p.set("a", 3.0, 0.01)
        rest = proc.process(np.ascontiguousarray(x[:, 25:]))
        assert_same(
            both[1].process(np.ascontiguousarray(x[:, 25:])),
            rest,
            "a run's own seed does not reach it",
        )
        wanted[target] = rest
        assert not proc.process(x).any(), "a segment runs once"
    assert_same(*wanted.values())
    assert wanted["llvm"].any()


@pytest.mark.parametrize(
    ("make", "error", "why"),
    [
        (lambda: b.segment(X, -1.0), BadValue, "start = -1.0 s must be 0 or above"),
        (lambda: b.segment(X, 0.0, 0.0), BadValue, "duration = 0.0 s above 0"),
        (lambda: b.segment(X, 0.0, 1.0, seed=-1), BadValue, "seed = -1 must be a whole number"),
        (lambda: Segment(X, X, None), BadValue, "a segment lasts for an Interval, not Input"),
        (lambda: b.enabled(b.segment(X, 0.0), by=X), SceneError, "would need the input 'x'"),
        (
            lambda: Scene({"y": b.loop(lambda y: b.segment(0.5 * y, 0.0))}),
            SceneError,
            r"Segment\(.*inside a loop",
        ),
        (
            lambda: Scene({"y": Param("a", 1.0) * X}).renamed({"c": "d"}),
            UnknownName,
            "there is no parameter 'c'; there are a",
        ),
    ],
)
def test_what_makes_no_sense(make, error, why):
    refused(error, why, make)


def test_renamed_parameters_keep_a_loop_and_its_samples():
    """Also of two loops that were one object: each has a last value of its own."""
    y = b.loop(lambda last: last + Param("a", 0.5) * (X - last), unit="m")
    scene = Scene({"y": y, "z": 2.0 * y})
    twice = [
        b.segment(v, k / 10, 0.1)
        for k in (0, 1)
        for v in scene.renamed({"a": f"a_{k}"}).outputs.values()
    ]
    proc = stimlib.compile(Scene({f"y{k}": v for k, v in enumerate(twice)}), 1000)
    proc.set("a_1", 0.25, 0.0)
    y = proc.process(np.ones((1, 200)))
    for k, a in ((0, 0.5), (1, 0.25)):
        wanted = stimlib.render(scene, {"x": np.ones(100)}, 1000, params={"a": a}).y
        assert_same(y[2 * k : 2 * k + 2, 100 * k : 100 * k + 100], wanted, f"a = {a}")


@pytest.mark.parametrize("n", mostly([20], [3, 20, 60, 100]))
def test_a_run_that_ends_before_a_segment_has_none_of_it_on_jax(n):
    scene = in_turn(
        {"y": b.enabled(b.white_noise(1), by=b.white_noise(2)) * X}, [(5, 40), (60, 90)], 1000.0
    )
    f = stimlib.compile(scene, 1000, "jax")
    x = np.sin(np.arange(n))
    y, wanted = f({}, {"x": x}), stimlib.render(scene, {"x": x}, 1000)
    for name in f.outputs:
        assert np.abs(np.asarray(y[name]) - wanted[name]).max() < 1e-12


def test_verify_holds_the_noise_of_every_segment(monkeypatch):
    """Gated and not, each with the seed of its segment; another seed is refused."""
    noise = b.enabled(b.differentiator(b.pink_noise(1.0, 7, f_low=10.0), 1000.0), by=X)
    scene = in_turn({"y": X * noise, "w": b.white_noise(9)}, [(100, 4100), (4200, 8200)], 8000.0)
    motion = {"x": np.sin(np.arange(8400) / 300)}
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000))
    assert report.passed
    names = [c.name for c in report.checks if c.group == "c"]
    assert (
        sum("noise as displayed" in n for n in names) == 2
        and sum("generator" in n for n in names) == 4
    )
    assert any("segment(0.525, 0.5, seed=5): generator" in n for n in names)

    def forgetful(program, design, start):
        return first_states(program._replace(seeds=[None] * len(program.seeds)), design, start)

    monkeypatch.setattr("stimlib.core.program.first_states", forgetful)
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000))
    assert {c.name for c in report.checks if not c.passed} >= {
        "white(9, 0) in segment(0.525, 0.5, seed=5): generator",
        "y_1: noise as displayed",
    }
