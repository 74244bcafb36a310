"""Laws 1, 2, 3, 6 and 8 on generated graphs, and what `enabled` means, written a second
time.
"""

from collections import Counter

import numpy as np
import pytest
from contract import TABLE
from hypothesis import Phase, given, settings, strategies as st
from laws import STRESS, Set, assert_same, guarded, mostly, pair, raw, rows, run, twins

import stimlib
from stimlib import Input, Param, Scene, SceneError, blocks as b, constant
from stimlib.blocks.noise import PinkNoise, White
from stimlib.core.graph import Block, reach
from stimlib.core.guard import Guard
from stimlib.core.loop_code import Cycle
from stimlib.core.program import lower
from stimlib.core.subsystems import Enabled

LENGTH = 130
S = constant(0.125, "s")
NUMBERS = [-2.0, -0.5, 0.25, 0.75, 1.0, 3.0]


class Builder:
    """Draws a graph: a pool of blocks that Inputs reach or not, from which further
    blocks are made.
    """

    def __init__(self, draw, tiles=True):
        self.draw, self.tiles = draw, tiles
        self.streams = 0
        self.autonomous = [
            Param("a", draw(number)),
            Param("c", draw(number)),
            b.white_noise(draw(small), shared=True),
        ]
        self.signals = [Input("x1"), Input("x2"), *self.autonomous]
        self.gates = []

    def choose(self, pool):
        return self.draw(st.sampled_from(pool[:-7:-1]))  # the newest, so that graphs grow deep

    def fresh_noise(self, seed):
        self.streams += 1
        return White(seed, self.streams, True)

    def block(self, pool, fresh=False):
        """A new block over blocks of the pool; ``fresh``: with noise that nothing else
        uses.
        """
        draw, x, y, z = self.draw, self.choose(pool), self.choose(pool), self.choose(pool)
        noise = self.fresh_noise(draw(small)) if fresh else White(draw(small), 77, True)
        taps = draw(st.lists(st.sampled_from(NUMBERS), min_size=1, max_size=20))
        knots = np.cumsum(
            [-1.0, *draw(st.lists(st.sampled_from([0.1, 0.5, 1.5]), min_size=1, max_size=5))]
        )
        values = draw(st.lists(st.sampled_from(NUMBERS), min_size=len(knots), max_size=len(knots)))
        kinds = [
            lambda: x + y,
            lambda: x - y,
            lambda: x * y,
            lambda: x / (2.0 + b.tanh(y)),
            lambda: x / y,
            lambda: -x,
            lambda: abs(x),
            lambda: x > y,
            lambda: x >= y,
            lambda: x > draw(number),
            lambda: draw(number) * x,
            lambda: x + draw(number),
            lambda: b.where(x, y, z),
            lambda: b.maximum(x, y),
            lambda: b.minimum(x, draw(number)),
            lambda: b.clip(x, -1.0, y),
            lambda: b.sqrt(abs(x)),
            lambda: b.sqrt(x),
            lambda: b.exp(b.clip(x, -20.0, 3.0)),
            lambda: b.log(1.5 + b.tanh(x)),
            lambda: b.sin(x),
            lambda: b.cos(x),
            lambda: b.tanh(x),
            lambda: b.nonzero(x),
            lambda: Guard(x),
            lambda: b.fir(x, taps),
            lambda: b.fir(x, [*taps, 1.0, -1.0]),
            lambda: b.delay(x, samples=1 + len(taps)),
            lambda: S * b.differentiator(x, 150.0, 350.0, order=20, tol=0.1),
            lambda: S * b.velocity(x, 40.0 * len(taps) ** 0.5),
            lambda: S * b.velocity(x, 7.0),
            lambda: b.first_order(x, 0.01 * len(taps)),
            lambda: b.pinking(x, 10.0, 0.1),
            lambda: b.pinking(x, 40.0, 1.0),
            lambda: b.loading(x, 0.5, 0.1),
            lambda: b.loading(b.velocity(x, 30.0), resolution=1e-3),
            lambda: b.lut(
                x,
                knots,
                values,
                draw(st.sampled_from(["linear", "pchip", "cubic"])),
                draw(st.sampled_from(["hold", "zero"])),
            ),
            lambda: b.lut(b.tanh(x), [-1.0, 0.0, 1.0], values[:2] + [0.5], outside="error"),
            lambda: noise,
            lambda: PinkNoise(noise, 0.5, 20.0, 0.5),
            lambda: self.other(x, y, z),
            lambda: self.other(x, y, z),
            *[lambda: self.looped(x, y)] * 5,
            lambda: b.enabled(self.choose(self.autonomous), by=x > y),
            lambda: self.gated(x, y),
            lambda: self.gated(x, y),
        ]
        return draw(st.sampled_from(kinds))()

    def other(self, *signals):
        """A block that is not written out above, by its example in the table."""
        cls = self.draw(st.sampled_from(sorted({e.cls for e in OTHERS})))
        entry = self.draw(st.sampled_from([e for e in OTHERS if e.cls == cls]))
        block = entry.make(
            *(constant(1.0, entry.unit) * v for v, _ in zip(signals, entry.drive, strict=False))
        )
        return block / constant(1.0, "" if str(block.dim) == "1" else str(block.dim))

    def looped(self, *signals, depth=0):
        """A loop, perhaps with another inside; of two values that it hands out one may
        lie off the way around.
        """

        def body(last):
            pool = [*signals, last]
            for _ in range(self.draw(st.integers(1, 3))):
                x, y = self.choose(pool), self.choose(pool)
                kinds = [
                    lambda x=x, y=y: x * b.tanh(y),
                    lambda x=x, y=y: x - 0.5 * y,
                    lambda x=x, y=y: x + 0.5,
                    lambda x=x, y=y: b.delay(x, 3),
                    lambda x=x, y=y: b.first_order(x, 0.02),
                    lambda x=x, y=y: b.maximum(x, y),
                    lambda x=x, y=y: S * b.velocity(x, 20.0, contact=y > -0.5),
                    lambda x=x, y=y: b.sin(x),
                ]
                if self.tiles:
                    kinds += [
                        lambda x=x, y=y: b.fir(x, [0.5, -0.25, 0.25]),
                        lambda x=x, y=y: b.loading(x, 0.5, 0.1),
                    ]
                if depth == 0:
                    kinds += [lambda x=x: self.looped(x, last, depth=1)] * 4
                pool.append(self.draw(st.sampled_from(kinds))())
            whole = 0.25 * last + 0.25 * b.tanh(pool[-1])  # the newest depends on last, mostly
            if self.tiles and self.draw(st.booleans()):
                whole = whole + 0.125 * b.fir(last, [0.5, -0.25, 0.25])
            return whole + 0.125 * signals[-1] if depth else whole, self.choose(pool)

        y, other = b.loop(body, start=self.draw(number))
        return y + 0.5 * other

    def gated(self, x, y):
        """An autonomous graph of its own behind a gate, perhaps with a gate inside."""
        inside = [
            Param("a", self.autonomous[0].value),
            PinkNoise(self.fresh_noise(1), 0.3, 20.0, 0.5),
            self.fresh_noise(2),
        ]
        for _ in range(self.draw(st.integers(0, 3))):
            inside.append(self.block_inside(inside))
        gate = self.draw(
            st.sampled_from(
                [x > y, x, b.loading(y, 0.3, 0.1), b.enabled(self.choose(self.autonomous), by=x)]
            )
        )
        return b.enabled(inside[-1], by=gate)

    def block_inside(self, pool):
        x, y = self.choose(pool), self.choose(pool)
        kinds = [
            x * y,
            x + 0.5,
            b.delay(x, 3),
            b.fir(x, [1.0, -0.5, 0.25]),
            b.first_order(x, 0.02),
            b.loading(x, 0.5, 0.1),
            b.enabled(y, by=x),
            b.enabled(b.pinking(x, 40.0, 1.0), by=y > 0.2),
        ]
        return self.draw(st.sampled_from(kinds))


WRITTEN_OUT = (
    "Input Const Param Add Sub Mul Div Neg Abs Greater AtLeast Where Maximum Minimum Sqrt Exp Log"
    " Sin Cos Tanh Nonzero Guard Delay Taps Differentiator Loading Velocity FirstOrder Pinking"
    " PinkNoise White Enabled Lut Loop Last Tap Pick"
).split()
# a scene with an input of its own
OTHERS = [e for e in TABLE if e.cls not in WRITTEN_OUT and e.name != "bumps"]
number = st.sampled_from(NUMBERS)
small = st.integers(0, 3)


@st.composite
def scenes(draw, tiles=True):
    builder = Builder(draw, tiles)
    for _ in range(draw(st.integers(6, 14))):
        if draw(st.booleans()):
            builder.signals.append(builder.block(builder.signals))
        else:
            builder.autonomous.append(new := builder.block(builder.autonomous))
            builder.signals.append(new)
    y, z = builder.signals[-1], builder.choose(builder.signals[2:])
    if draw(st.booleans()):
        z = z - builder.other(*(builder.choose(builder.signals) for _ in range(3)))
    if draw(st.sampled_from([False, False, True])):
        z = z + b.enabled(
            b.enabled(PinkNoise(builder.fresh_noise(3), 0.3, 20.0, 0.5), by=builder.fresh_noise(2))
            * Param("a", builder.autonomous[0].value)
            - 0.25,
            by=builder.choose(builder.signals),
        )
    outputs = {"y": y + 0.25 * z, "z": z} if draw(st.booleans()) else {"y": y - 0.0625 * z}
    try:
        return Scene(outputs)
    except SceneError as e:
        # what the builder cannot know beforehand: numbers folded to nan, or a noise
        # that ends up on two clocks
        assert "with the plain numbers" in str(e) or "two clocks" in str(e), e
        return Scene({"y": Input("x1") * builder.autonomous[0]})


@st.composite
def changes(draw, n=LENGTH):
    return draw(
        st.lists(
            st.builds(
                Set,
                st.integers(0, n - 1),
                st.sampled_from(["a", "c"]),
                st.sampled_from([-1.0, 0.0, 0.3, 2.0]),
                st.sampled_from([0.0, 0.01, 0.3]),
            ),
            max_size=4,
        )
    )


def motion(rng, n):
    """Rows for x1 and x2: smooth, noisy, held, sometimes zero."""
    t = np.arange(n) / 100
    smooth = np.sin(2 * np.pi * rng.uniform(0.5, 9) * t + rng.uniform(0, 6))
    x = np.stack([smooth * rng.choice([0.1, 1, 3]), np.repeat(rng.standard_normal(n), 7)[:n]])
    x[:, n // 2 : n // 2 + 9] = 0.0
    return x[rng.permutation(2)]


def words(proc):
    """The state; the sign of a nan in it is the processor's business, and LLVM's."""
    state = proc.state
    return np.where(state == 0xFFF8 << 48, np.uint64(0x7FF8 << 48), state)


def check(scene, fs, seed, cuts, sets):
    """Laws 1, 2, 3 and 6 on one scene; the samples."""
    fast, slow = pair(scene, fs, seed)
    sets = [s for s in sets if s.name in fast.params]
    x = rows(fast, motion(np.random.default_rng(seed), LENGTH), ["x1", "x2"])
    assert_same(words(slow), words(fast), "state before sample 0")
    wanted = run(fast, x, (), sets)
    end = words(fast)
    middle = []
    assert_same(
        run(slow, x, cuts, sets, lambda p: middle.append((p.index, words(p)))),
        wanted,
        "llvm and python",
    )
    assert_same(words(slow), end, "last state")
    assert slow.fault == fast.fault
    assert np.isfinite(wanted).all()
    for size in (1, 7, 64):
        fast.reset()
        states = []
        assert_same(
            run(
                fast,
                x,
                [*range(0, LENGTH, size), *cuts],
                sets,
                lambda p, kept=states: kept.append((p.index, words(p))),
            ),
            wanted,
            "cut",
        )
        known = dict(states)
        for at, state in middle:
            assert_same(known[at], state, f"state at {at}")
    at, state = middle[len(middle) // 2]
    other = stimlib.compile(scene, fs, seed=seed + 1)
    other.state = state
    assert_same(
        run(
            other,
            x[:, at:],
            (),
            [Set(s.at - at, s.name, s.value, s.ramp) for s in sets if s.at >= at],
        ),
        wanted[:, at:],
        "going on",
    )
    return x, wanted


def check_independence(scene, fs, seed, x, sets):
    """Law 8: each output alone, and with more beside it, has the same bits."""
    everything = stimlib.compile(scene, fs, seed=seed)
    sets = [s for s in sets if s.name in everything.params]
    y = dict(zip(everything.outputs, run(everything, x, (), sets), strict=True))
    noise = b.pink_noise(1.0, 2**60, f_low=30.0)
    extra = {"more": noise, "gated": b.enabled(b.white_noise(2**60 + 1), by=Input("x2"))}
    for name in scene.outputs:
        for outputs in ({name: scene.outputs[name]}, {**extra, name: scene.outputs[name]}):
            proc = stimlib.compile(Scene(outputs), fs, seed=seed)
            mine = [s for s in sets if s.name in proc.params]
            got = run(proc, rows(proc, x, list(everything.inputs)), (), mine)
            assert_same(got[list(outputs).index(name)], y[name], f"{name} among {list(outputs)}")


GRAPHS = 120 if STRESS else 10  # each is compiled anew


def test_generated_graphs_keep_the_laws():
    seen: Counter = Counter()
    structures = set()

    @settings(max_examples=7 * GRAPHS // 2, phases=[Phase.generate])
    @given(
        scenes(),
        st.sampled_from([1000.0, 2000.0]),
        st.integers(0, 5),
        st.lists(st.integers(0, LENGTH), max_size=5),
        changes(),
    )
    def one(scene, fs, seed, cuts, sets):
        program = lower(scene.outputs)
        if program.hash in structures:
            return
        x, y = check(scene, fs, seed, cuts, sets)
        if len(structures) % 3 == 0 or STRESS:
            check_independence(scene, fs, seed, x, sets)
        structures.add(program.hash)
        seen.update(
            {type(q.block).__name__ for q in program.instances}
            | {type(b).__name__ for b in reach(scene.outputs.values())}
        )
        cycles = [q.block for q in program.instances if isinstance(q.block, Cycle)]
        seen["loops"] += bool(cycles)
        seen["loops in loops"] += any(len(c.ends) > 1 for c in cycles)
        seen["loops with tiles"] += any(
            m.definition.step is None for c in cycles for m in c.members
        )
        seen["several outputs"] += any(q.kind == "pick" for q in program.instances)
        seen["nested"] += any(p > 1 for p in program.parents)
        seen["enabled"] += len(program.parents) > 2
        seen["live inside"] += any(
            q.clock > 1
            and any(
                program.instances[a].clock == 0 and program.instances[a].kind == "block"
                for a in q.args
            )
            for q in program.instances
        )
        seen["set"] += any(s.name in program.params for s in sets)
        seen["two outputs"] += len(scene.outputs) == 2
        seen["audible"] += bool(y.any())

    one()
    assert len(structures) >= GRAPHS
    # chance has left a few out; the table grows
    for cls in sorted({e.cls for e in TABLE} - set(seen)) if STRESS else ():
        entry = next(e for e in TABLE if e.cls == cls)
        x = [Input("x1"), Input("x2"), Param("a", 0.5) * Input("x1")]
        block = entry.make(
            *(constant(1.0, entry.unit) * v for v, _ in zip(x, entry.drive, strict=False))
        )
        block = block / constant(1.0, "" if str(block.dim) == "1" else str(block.dim))
        scene = Scene(
            {"y": block - b.enabled(b.white_noise(1), by=x[1]), "z": b.first_order(block, 0.01)}
        )
        fs = min(entry.rates)  # one at which its parameters hold
        sampled, _ = check(scene, fs, 1, [3, 70], [])
        check_independence(scene, fs, 1, sampled, [])
        seen.update({type(q.block).__name__ for q in lower(scene.outputs).instances})
    assert not STRESS or {e.cls for e in TABLE} - set(seen) == set(), (
        "a block that no generated graph has"
    )
    for what, least in {
        "nested": 0.1,
        "enabled": 0.2,
        "live inside": 0.05,
        "set": 0.3,
        "two outputs": 0.3,
        "audible": 0.75,
        "loops": 0.25,
        "loops in loops": 0.05,
        "loops with tiles": 0.05,
        "several outputs": 0.1,
    }.items():
        # of ten, an older hypothesis draws one where another draws three
        assert seen[what] >= (least * GRAPHS if STRESS else 1), f"{what}: only {seen[what]}"


# The second opinion on enabled --------------------------------------------------------
@st.composite
def gated_scenes(draw):
    builder = Builder(draw)
    gate = draw(
        st.sampled_from(
            [
                Input("x1"),
                Input("x1") > Input("x2"),
                b.loading(Input("x2"), 0.3, 0.1),
                b.delay(Input("x1") > 0.2, 5),
                -Input("x2"),
            ]
        )
    )
    inside = [
        builder.fresh_noise(0),
        PinkNoise(builder.fresh_noise(1), 0.3, 20.0, 0.5),
        Param("a", 0.7),
    ]
    for _ in range(draw(st.integers(0, 5))):
        inside.append(builder.block_inside(inside))
    return inside[-1], gate


@settings(max_examples=40 if STRESS else 6)
@given(gated_scenes(), st.integers(0, 5))
def test_enabled_samples_in_a_row_are_the_stream_that_was_never_gated(gated, seed):
    block, gate = gated
    fs, names = 1000.0, ["x1", "x2"]
    both = Scene({"y": b.enabled(block, by=gate), "g": gate})
    x = motion(np.random.default_rng(seed), 150)
    on = raw(Scene({"g": gate}), fs, x, names)[0] > 0
    y = raw(both, fs, x, names)[0]
    free = raw(Scene({"y": block}), fs, np.zeros((0, 150)), [])[0]
    assert_same(y[on], free[: on.sum()], "enabled samples")
    assert not y[~on].any()
    proc = stimlib.compile(both, fs)
    assert_same(proc.process(rows(proc, x, names))[0], guarded(y, fs)[0], "llvm")


@pytest.mark.parametrize("target", ["llvm", "python"])
def test_a_nan_condition_is_closed(target):
    proc = stimlib.compile(Scene({"y": b.enabled(b.white_noise(1), by=Input("x"))}), 1000, target)
    y = proc.process(np.array([[1.0, np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-320]]))[0]
    assert list(y != 0) == [True, False, True, False, False, False, True]
    assert proc.fault is None


def test_a_live_number_in_gates_is_that_of_its_sample():
    """On a ramp, in a gate and in gates inside it: one that is always open, and one
    that is not.
    """
    x, a = Input("x"), Param("a", 1.0)
    inside = [
        2.0 * a,
        b.enabled(2.0 * a, by=Param("open", 1.0)),
        b.enabled(2.0 * a, by=b.white_noise(1)),
    ]
    outputs = {"a": a} | {f"y{k}": b.enabled(v, by=x) for k, v in enumerate(inside)}
    proc = stimlib.compile(Scene(outputs), 1000)
    for on in (np.ones(200, bool), np.random.default_rng(0).random(200) < 0.7):
        proc.set("a", proc.params["a"] + 1.0, 0.15)
        y = proc.process(np.where(on, 1.0, -1.0)[None])
        wanted = np.where(on, 2.0 * y[0], 0.0)
        assert_same(y[1], wanted)
        assert_same(y[2], wanted)
        assert_same(y[3], np.where(y[3] == 0.0, 0.0, wanted))
        assert 40 < np.sum(y[3] != 0.0) < 160


def test_what_is_in_a_closed_gate_rests():
    """For whole tiles: another gate, and a block that remembers its last input."""
    place = 3.0 * b.first_order(b.white_noise(1), 0.01)
    inside = {
        "noise": b.enabled(b.white_noise(2), by=Param("open", 1.0)),
        "bump": b.bump(place, "sawtooth", 0.5),
    }
    scene = Scene({name: b.enabled(v, by=Input("x")) for name, v in inside.items()})
    twins(scene, 1000, np.repeat([1.0, 0.0, 1.0, 0.0], [70, 130, 70, 64])[None])


def test_two_gates_own_two_copies():
    """The same noise, shared, behind two gates: each gets the stream from its start."""
    noise = b.white_noise(1, shared=True)
    first, second = b.enabled(noise, by=Input("x1")), b.enabled(noise, by=Input("x2"))
    proc = stimlib.compile(Scene({"y": first, "z": second}), 1000)
    y = proc.process(np.array([[1.0, 0.0, 1.0, 1.0], [0.0, 1.0, 1.0, 0.0]]))
    np.testing.assert_array_equal(y[0, [0, 2]], y[1, [1, 2]])


@pytest.mark.parametrize("gates", mostly({12}, [12, 64]))
def test_every_sample_a_gate_of_its_own(gates):
    """Gates inside each other, all open and then one closed: clocks need no stack."""
    block: Block = b.white_noise(3)
    for k in range(gates):
        block = b.enabled(block, by=Param(f"g{k}", 1.0))
    fast, slow = pair(Scene({"y": block * Input("x")}), 1000)
    assert len(fast.program.parents) == gates + 2
    for proc in (fast, slow):
        proc.process(np.ones((1, 3)))
        proc.set("g7", 0.0, ramp=0)
    assert_same(fast.process(np.ones((1, 3))), slow.process(np.ones((1, 3))))
    assert_same(fast.state, slow.state)
    assert sum(isinstance(q, Enabled) for q in reach([block])) == gates
