"""The laws that every block keeps, whoever wrote it; see design.md.  The table of
blocks is ``contract.py``.
"""

import dataclasses as dc
import re
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from contract import DEAF, EACH, TABLE, missing
from laws import (
    STRESS,
    assert_same,
    cut_at,
    float_words,
    garbage,
    guarded,
    impulse_response,
    kept,
    pair,
    played,
    random_cuts,
    raw,
    rows,
    run,
    some_sets,
)
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, SceneError, blocks as b
from stimlib.core.graph import Block, reach, registry, signals
from stimlib.core.guard import Guard
from stimlib.core.subsystems import Enabled

# where the engine does something else, too; others have the same step and other numbers
VARIED = re.compile("contact|nested|live|param|enabled|gated|segment")


def case(e, fs, chosen, name=""):
    """Of a table of tests; in `make stress` alone where it is not chosen."""
    marks = [] if chosen else [pytest.mark.stress]
    return pytest.param(e, fs, id=name or f"{e.name}-{fs:g}", marks=marks)


TURNS = [  # of an example's rates each has its turn
    (e, fs, fs == e.rates[k % len(e.rates)]) for k, e in enumerate(TABLE) for fs in e.rates
]
FORMS = kept(
    case(e, fs, turn and (e is EACH[e.cls] or VARIED.search(e.name))) for e, fs, turn in TURNS
)
LTI = kept(case(e, fs, turn) for e, fs, turn in TURNS if e.lti)
# no drawn mutant fell to an example alone that is not the first of its class
EACH_FIRST = [case(e, e.rates[0], e is EACH[e.cls], e.name) for e in TABLE]
EACH_DRIVEN = [p for p in EACH_FIRST if p.values[0].inputs]
FIRST, DRIVEN = kept(EACH_FIRST), kept(EACH_DRIVEN)
LAWS = [
    pytest.param(e, fs, law, id=f"{e.name}-{fs:g}-{k}")
    for e in TABLE
    for fs in e.rates
    for k, law in enumerate(e.laws)
]


def driven(entry, fs, n, seed=0):
    """A compiled processor and rows for its inputs."""
    proc = stimlib.compile(entry.scene(), fs)
    return proc, rows(proc, entry.x(n, fs, seed), entry.inputs)


def test_every_block_is_in_the_table():
    """Once by each name."""
    assert len({e.name for e in TABLE}) == len(TABLE)
    assert missing() == set(), (
        "tests/contract.py: add an Entry to TABLE for each of these classes, which says what drives"
        " it and its laws (docs/howto/add_a_block.rst)"
    )


# 1 ------------------------------------------------------------------------------------
SIZES = [1, 7, 64]
if STRESS:
    SIZES += [2, 3, 5, 11, 13, 31, 61, 63, 65, 67, 127, 128, 129, 131, 257, 509, 1021, 1024]
    SIZES += [2053, 4096, 4099, 8191, 8192, 8193]


@pytest.mark.parametrize(("entry", "fs"), FORMS)
def test_law_1_cuts_change_nothing(entry, fs):
    n = 2 * 8193 + 1 if STRESS else 1000
    proc, x = driven(entry, fs, n)
    rng = np.random.default_rng(1)
    sets = some_sets(proc, n, rng)
    whole, end = run(proc, x, (), sets), proc.state
    for cuts in (*(cut_at(n, size) for size in SIZES), random_cuts(n, rng)):
        proc.reset()
        assert_same(run(proc, x, cuts, sets), whole, f"cuts at {cuts[:5]}..")
        assert_same(proc.state, end, "state")


# 2, 3 ---------------------------------------------------------------------------------
@pytest.mark.parametrize(("entry", "fs"), FORMS)
def test_laws_2_and_3_compiled_is_the_reference_in_output_and_state(entry, fs):
    n = 260
    procs = pair(entry.scene(), fs)
    x = rows(procs[0], entry.x(n, fs), entry.inputs)
    rng = np.random.default_rng(2)
    sets, cuts = some_sets(procs[0], n, rng), [1, 2, 9, 73, 137, *random_cuts(n, rng, 3)]
    assert_same(procs[0].state, procs[1].state, "state before sample 0")
    states = [[], []]
    y = [
        run(p, x, cuts, sets, lambda p, kept=kept: kept.append(p.state))
        for p, kept in zip(procs, states, strict=True)
    ]
    assert_same(*y, "llvm and python")
    for k, (s, t) in enumerate(zip(*states, strict=True)):
        assert_same(s, t, f"state after part {k}")
    assert procs[0].fault == procs[1].fault is None
    assert np.any(y[0]), "the example is silent"


@pytest.mark.parametrize(("entry", "fs"), FIRST)
def test_law_3_a_state_goes_on_in_any_processor(entry, fs):
    n, at, scene = 96, 43, entry.scene()
    procs = *pair(scene, fs), *pair(scene, fs, seed=77)
    fresh = procs[0].state
    x = rows(procs[0], entry.x(n, fs), entry.inputs)
    sets = some_sets(procs[0], at, np.random.default_rng(3))
    whole = run(procs[0], x, (at,), sets)
    procs[0].reset()
    run(procs[0], x[:, :at], (), sets)
    middle = procs[0].state
    for proc in procs:
        proc.process(np.ascontiguousarray(x[:, 5:30]))  # whatever was there before
        proc.state = middle
        assert_same(proc.state, middle, "what was put in")
        assert proc.index == at
        assert_same(run(proc, x[:, at:]), whole[:, at:], f"going on in {proc}")
        proc.reset(0)
        assert_same(proc.state, fresh, "after reset")
        assert proc.index == 0 and proc.log == [] and proc.params["live"] == 1.25
        assert_same(run(proc, x, (at,), sets), whole, "after reset")


@pytest.mark.parametrize("target", ["llvm", "python"])
def test_law_3_a_foreign_state_is_refused(target):
    x = Input("x")

    def made(block, fs=1000):
        return stimlib.compile(Scene({"y": block}), fs, target)

    proc, same_size = made(b.delay(x, 3)), made(b.first_order(x, 1.0) + Input("z"))
    good = proc.state
    another = "another scene or sample rate"
    for to, state, says in (
        *((proc, made(y).state, None) for y in (b.delay(x, 4), b.fir(x, [1, 2, 3]), x)),
        *((proc, s, None) for s in (good[:-1], good.view(np.float64), np.r_[good, good], 3)),
        (same_size, made(b.first_order(x, 1.0)).state, another),
        (proc, made(b.delay(x, 3), 2000).state, another),
    ):
        refused(BadValue, says, setattr, to, "state", state)
    assert_same(proc.state, good, "what is refused changes nothing")


@pytest.mark.parametrize(
    "entry", [pytest.param(p.values[0], id=p.id, marks=p.marks) for p in DRIVEN]
)
def test_law_6_what_is_no_number_is_a_fault(entry):
    """At its sample, or one later; not silently nothing, but where it only chooses."""
    fs, at = min(entry.rates), 41
    for row, name in enumerate(entry.inputs):
        x = entry.x(48, fs, seed=6)
        x[row, at] = np.nan
        bad = np.flatnonzero(~np.isfinite(raw(entry.scene(), fs, x, entry.inputs)[0]))
        late = entry.name in ("delay_1", "ring", "ring_live") and row == 0
        assert (bad[:1].tolist() == [at + late]) or name in DEAF.get(entry.name, ()), (
            f"a NaN in {name} at sample {at} is not in the output of {entry.name} there: choose so"
            " that it stays (where(y > x, y, x) ends a NaN in y and keeps one in x); if this input"
            " only chooses, add it to DEAF in tests/contract.py"
        )


@pytest.mark.parametrize("name", ["friction", "stick_slip", "wall", "detents", "button", "grating"])
def test_the_mean_over_a_way_is_half_a_sample_late(name):
    proc = stimlib.compile(next(e for e in TABLE if e.name == name).scene(), 1000, "python")
    assert proc.latency["y", proc.inputs[0]] == (0.5, 0.5)


# 5 ------------------------------------------------------------------------------------
@pytest.mark.parametrize(("entry", "fs"), LTI)
def test_law_5a_impulse_response_is_the_response(entry, fs):
    proc = stimlib.compile(Scene({"y": entry.block()}), fs)
    n = entry.settle
    for name in proc.inputs:
        proc.reset()
        h = impulse_response(proc, "y", name, n)
        assert np.abs(h[-n // 8 :]).max() <= 1e-14 * np.abs(h).max() or not h[-1], (
            "not settled: take a longer run"
        )
        got, said = np.fft.rfft(h), proc.response("y", name, np.fft.rfftfreq(n, 1 / fs))
        assert np.abs(got - said).max() <= 1e-12 * np.abs(said).max()


def source_of(proc):
    return [*proc.inputs, *proc.program.noises][0]


@pytest.mark.parametrize(("entry", "fs", "law"), LAWS)
def test_law_5b_response_is_the_physics(entry, fs, law):
    proc = stimlib.compile(Scene({"y": entry.block()}), fs, "python")
    assert law.error(lambda f: proc.response("y", source_of(proc), f), fs) <= law.tol


# 6 ------------------------------------------------------------------------------------
BAD = [  # of the three each has its turn
    pytest.param(
        p.values[0], bad, id=f"{p.id}-{bad}", marks=[pytest.mark.stress, *p.marks][k % 3 == j :]
    )
    for k, p in enumerate(EACH_DRIVEN)
    for j, bad in enumerate((np.nan, np.inf, -np.inf))
]


@pytest.mark.parametrize(("entry", "bad"), kept(BAD))
def test_law_6_outputs_stay_finite(entry, bad):
    fs = min(entry.rates)
    at, n = 41, 41 + int(0.02 * fs) + 60
    x = entry.x(n, fs, seed=6)
    for row in range(len(x)):
        broken = x.copy()
        broken[row, at] = bad
        wanted = [guarded(r, fs) for r in raw(entry.scene(), fs, broken, entry.inputs)]
        faults = [(i, name) for (_, i), name in zip(wanted, "yz", strict=True) if i is not None]
        assert faults or not entry.lti or entry.cls == "Guard", "a sum that loses what is no number"
        for proc in pair(entry.scene(), fs):
            y = run(proc, rows(proc, broken, entry.inputs), (13, 60, 61))
            assert_same(y, np.array([w for w, _ in wanted]), f"input {row}, {proc}")
            assert np.isfinite(y).all()
            assert proc.fault == (min(faults)[::-1] if faults else None)
            proc.process(rows(proc, x[:, :20], entry.inputs))
            assert (proc.fault is None) == (not faults), "latched until reset"
            proc.reset()
            assert proc.fault is None


def test_law_6_the_fade_is_as_documented():
    """Last finite value, then straight to 0 in 20 ms, latched until reset; 0 if there
    is none.
    """
    proc = stimlib.compile(Scene({"y": Input("x"), "other": 2 * Input("x")}), 1000)
    x = np.full((1, 60), 4.0)
    for at, last in ((10, 4.0), (0, 0.0)):
        x[0, at] = np.nan
        fade = np.r_[np.full(at, 4.0), last * (1 - np.arange(21) / 20), np.zeros(60)][:60]
        np.testing.assert_allclose(proc.process(x), [fade, 2 * fade], rtol=1e-15)
        assert proc.fault == ("other", at) and not proc.process(np.ones((1, 50))).any()
        proc.reset()
        np.testing.assert_array_equal(proc.process(np.ones((1, 5)))[0], 1.0)
        proc.reset()


def test_law_6_a_device_has_its_own_steps_where_half_a_second_has_room_for_them():
    for steps, samples in ((None, 20), (1, 20), (300, 300), (500, 500), (501, 500), (1e9, 500)):
        assert Guard(Input("x"), steps).samples(1000) == samples
    assert Guard(Input("x"), 1e9).samples(1001) == 501  # 500.5, as whole samples


@pytest.mark.parametrize("hold", ["last", "zero"])
@pytest.mark.parametrize(("entry", "fs"), DRIVEN)
def test_law_6_nothing_decays_into_denormals(entry, fs, hold):
    """They would cost a hundred times more per sample, for ever."""
    proc, x = driven(entry, fs, int(fs))
    proc.process(x)
    held = np.repeat(x[:, -1:] if hold == "last" else np.zeros((len(x), 1)), int(10 * fs), axis=1)
    floats = float_words(proc)
    for _ in range(6):
        y = proc.process(held)
        v = np.abs(proc.state[floats].view(np.float64))
        assert np.all((v == 0) | (v >= 1e-300)), v[(v != 0) & (v < 1e-300)]
        assert np.all((y == 0) | (np.abs(y) >= 1e-300))


# 7 ------------------------------------------------------------------------------------
@pytest.mark.parametrize(("entry", "fs"), LTI)
def test_law_7_linear(entry, fs):
    """And what comes in later goes out later."""
    proc = stimlib.compile(Scene({"y": entry.block()}), fs)
    x, z = (entry.x(600, fs, seed) for seed in (7, 8))
    x[:, 0] = z[:, 0] = 0.0

    def f(x):
        proc.reset()
        return run(proc, rows(proc, x, entry.inputs))[0]

    a, c = 0.7, -2.3
    wanted = a * f(x) + c * f(z)
    parts = abs(a) * f(np.abs(x)), abs(c) * f(np.abs(z)), wanted
    scale = sum(np.abs(part).max() for part in parts)
    np.testing.assert_allclose(f(a * x + c * z), wanted, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(f(-4.0 * x), -4.0 * f(x), rtol=0, atol=1e-180)  # exact
    y, wanted = f(np.concatenate([np.zeros((len(x), 77)), x], axis=1)), f(x)
    np.testing.assert_allclose(y[:77], 0.0, atol=1e-180)
    atol = max(1e-180, entry.late * np.abs(wanted).max())
    np.testing.assert_allclose(y[77:], wanted, rtol=0, atol=atol)


# Contact ------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "name",
    sorted(n for n, c in registry.items() if c.resettable and c.__module__.startswith("stimlib.")),
)
def test_each_contact_is_a_run_of_its_own(name):
    entry = next(e for e in TABLE if e.cls == name)
    found = next(q for q in reach([entry.block()]) if type(q).__name__ == name)
    names = signals(type(found))
    inputs = {s: Input(s, str(getattr(found, s).dim).replace("1", "")) for s in names}
    block = dc.replace(found, **inputs, **({"onset": "steady"} if hasattr(found, "onset") else {}))
    y = getattr(block, block.outputs[0]) if block.outputs else block
    proc = stimlib.compile(Scene({"y": y}), entry.rates[0])
    rng = np.random.default_rng(8)
    lengths = [9, 1, 1, 40, 2, 20, 3, 1, 30, 100, 64]  # off contact, in contact, ..
    touch = np.repeat(np.arange(len(lengths)) % 2, lengths)
    n, ends = touch.size, np.cumsum(lengths)
    drive = {s: rng.uniform(0.1, 0.9, n) for s in names} | {
        names[0]: np.cumsum(rng.standard_normal(n))
    }
    # nobody looks at it off contact
    drive = {s: np.where(touch, v, np.nan) for s, v in drive.items()} | {names[-1]: touch}
    x = rows(proc, np.array([drive[s] for s in names]), names)
    y = run(proc, x, random_cuts(n, rng))
    assert proc.fault is None and y.any() and not y[0, touch == 0].any()
    for start, stop in zip(ends[:-1:2], ends[1::2], strict=True):
        proc.reset()
        assert_same(
            proc.process(np.ascontiguousarray(x[:, start:stop])),
            y[:, start:stop],
            f"contact from {start} to {stop}",
        )


# 8 ------------------------------------------------------------------------------------
@pytest.mark.parametrize(("entry", "fs"), FIRST)
def test_law_8_what_else_is_heard_changes_nothing(entry, fs):
    block, x = entry.block(), entry.x(400, fs, seed=9)
    alone = stimlib.compile(Scene({"y": block}), fs)
    y = run(alone, rows(alone, x, entry.inputs))[0]
    unit = entry.unit if entry.inputs else str(block.dim).removeprefix("1")
    name = entry.inputs[0] if entry.inputs else "other"
    gate = Input(name, unit) - stimlib.constant(0.001, unit) > 0.0
    # what runs inside enabled cannot also run outside: that is an error of its own
    children = () if isinstance(block, Enabled) else block.children
    noise = b.pink_noise(1.0, seed=2**63, stream=9)
    for what, outputs in {
        "output": {
            "before": Input("other") * 2.0,
            "y": block,
            "after": b.delay(Input("other"), 200),
        },
        "noise": {"before": noise, "y": block},
        "gate": {"gated": b.enabled(b.fir(noise, [1.0, 2.0]), by=gate), "y": block},
        "gate behind it": {"y": block, "gated": b.enabled(noise, by=abs(b.nonzero(block)) > 0.5)},
        "monitor": {**{f"monitor{i}": c for i, c in enumerate(children)}, "y": block},
        "twice": {"y": block, "again": block},
    }.items():
        proc = stimlib.compile(Scene(outputs), fs)
        got = proc.process(rows(proc, x, list(entry.inputs)))
        assert_same(got[list(outputs).index("y")], y, f"with another {what}")


@pytest.mark.parametrize("target", ["llvm", "python"])
def test_law_8_a_gate_that_no_input_reaches_starts_where_it_starts(target):
    """Another autonomous output must not run the gated clock before sample 0."""
    y = b.enabled(b.white_noise(1), by=Param("a", 1.0))
    beside = played({"y": y, "z": b.white_noise(2)}, 5, target=target)
    assert_same(beside[0], played(y, 5, target=target))


# Bounds -------------------------------------------------------------------------------
class Numbers(NamedTuple):
    table: np.ndarray
    at: float


@dataclass(frozen=True, eq=False)
class Trespass(Block):
    x: Block

    def design(self, fs):
        return Numbers(np.zeros(3), 0.0), Numbers(np.zeros(3), 0.0)

    @staticmethod
    def step(p, s, x):
        return x + p.table[np.int64(s.at)], Numbers(s.table, s.at + 1.0)


def test_bounds_are_checked_by_the_interpreter():
    proc = stimlib.compile(Scene({"y": Trespass(Input("x"))}), 1000, "python")
    refused(SceneError, "Trespass.step: IndexError", proc.process, np.ones((1, 4)))


# compiled code has the bits of the interpreter (laws 1 and 3), which raises where an
# index is beyond an array
@pytest.mark.stress
@pytest.mark.parametrize(("entry", "fs"), FIRST)
def test_no_block_reads_or_writes_beyond_its_arrays(entry, fs):
    """From good states and from many others; and the same bits."""
    ours, wanted = pair(entry.scene(), fs)
    rng = np.random.default_rng(16)  # of whose settings none is refused
    x = rows(ours, entry.x(700, fs), entry.inputs)
    cuts, sets = random_cuts(700, rng), some_sets(ours, 700, rng)
    assert_same(run(ours, x, cuts, sets), run(wanted, x, cuts, sets), entry.name)
    for state in garbage(wanted, rng, 60):
        wanted.state = state
        wanted.process(x[:, :130].copy())


@pytest.mark.parametrize(("entry", "fs"), FIRST)
def test_law_3_whatever_a_state_says_means_the_same_everywhere(entry, fs):
    """No index is taken from it as it is: neither beyond an array nor, as Python would,
    from an array's end.
    """
    procs = pair(entry.scene(), fs)
    rng = np.random.default_rng(12)
    x = rows(procs[0], entry.x(5, fs), entry.inputs)
    for state in garbage(procs[0], rng, 12 if STRESS else 6):
        got = []
        for proc in procs:
            proc.state = state
            got.append(proc.process(x))
        nan = np.isnan(got)
        np.testing.assert_array_equal(*nan)
        assert_same(*np.where(nan, 0.0, got), f"{entry.name} from {state}")
