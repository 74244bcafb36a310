"""Laws of single blocks: right in every composition, and blind to no change."""

from dataclasses import dataclass

import numpy as np
import pytest
from contract import TABLE, Lagging, ours
from laws import mostly
from refusals import refused
from stress import compositions, mutants

import stimlib
from stimlib import BadValue, Block, Input, Param, Scene, blocks as b, constant
from stimlib.checks import local, rows
from stimlib.run.processor import Change
from stimlib.run.safety import GAIN, Safety, protect

N, FS = 1500, 8000.0
# in ``local`` itself
WIRED = {"Input", "Param", "Const", "Pick", "Tap", "Loop", "Last", "Enabled", "Segment", "White"}


def run_of(entry, n=N, changes=(), fs=FS):
    scene, x = entry.scene(), dict(zip(entry.inputs, entry.x(n, fs, 5), strict=True))
    params = {name: p.value for name, p in scene.params.items()}
    return local.Run(scene.outputs, fs, 3, x, n, params, changes, local.spans(n, 7))


def test_every_class_has_a_law():
    assert ours().keys() - set(rows.LAWS) - WIRED == set(), (
        "stimlib/checks/families, in its family: write what each of these classes makes of"
        ' its inputs in plain numpy, below @law("CLASS") (docs/howto/add_a_check.rst)'
    )
    assert set(rows.LAWS) - ours().keys() == set(), "stimlib/checks: laws of classes that are gone"
    assert not WIRED & set(rows.LAWS)


EXACT = [
    "Input",
    "Mul",
    "Add",
    "Sub",
    "Div",
    "Neg",
    "Abs",
    "Where",
    "Maximum",
    "Minimum",
    "Sqrt",
    "NotBelowZero",
    "ForceLimit",
    "Tally",
    "Active",
    "Guard",
    "Delay",
    "First",
    "Time",
    "SampleAndHold",
    "OnceWithin",
    "Enabled",
    "Segment",
    "Last",
    "Greater",
    "AtLeast",
    "Equal",
    "NotEqual",
    "Nonzero",
    "Edge",
    "Hysteresis",
    "Interval",
    "Every",
    "At",
    "PulseTrain",
    "Vibration",
]
SEEN = {  # by which part a row must be larger to be refused: a few tolerances
    **dict.fromkeys(EXACT, 5e-16),
    **dict.fromkeys(["Exp", "Log", "Sin", "Cos", "Tanh"], 1.5e-15),
    **dict.fromkeys(["SlewLimit", "Midpoint"], 3e-15),
    "Taps": 3e-14,
    "White": 1e-13,
    "Differentiator": 6e-14,
    **dict.fromkeys(
        ["LinearBump", "SineBump", "Playback", "Timeline", "Burst", "MovingAverage", "Grain"], 3e-13
    ),
    **dict.fromkeys(["Dent", "Param", "Grating", "Lut", "Polynomial", "Sos", "PoleSwap"], 4e-12),
    **dict.fromkeys(
        [
            "Count",
            "PathLength",
            "StaticLimit",
            "MaxwellArms",
            "KelvinChain",
            "FirstOrder",
            "Filter",
        ],
        6e-12,
    ),
    **dict.fromkeys(
        [
            "Carrier",
            "Oscillator",
            "SpatialNoise",
            "Velocity",
            "Integrate",
            "Track",
            "Mode",
            "Resonator",
        ],
        5e-11,
    ),
    "Ring": 3e-10,
    "Chirp": 3e-8,
    "Series": 5e-8,
    "TableBump": 6e-7,
    "Texture": 3e-7,
    "StickSlip": 3e-6,
    "Shape": 6e-6,
    **dict.fromkeys(["DelayAvatar", "FrameAvatar"], 3e-6),  # 1e-9 s of their lags and waits
}


@pytest.mark.parametrize(
    "entry",
    [e for e in TABLE if FS in e.rates and e.name != "differentiator_order"],
    ids=lambda e: e.name,
)
def test_each_block_of_the_table_is_held_and_each_change_is_seen(entry, monkeypatch):
    """Each row a few tolerances larger, of the other sign, a sample late, or not 0
    where it is: what changes is refused.
    """
    blind, one = [], local._one

    def watch(block, run, seen):
        found, (part,) = one(block, run, seen), seen
        y = part.rows[id(block)]
        more = max(SEEN.get(type(block).__name__, 3e-9), 100 * getattr(block, "tol", 0.0))
        for k, row in enumerate(np.atleast_2d(y) if not found.why else []):
            size = np.abs(row).max()
            for name, other in {
                "size": (1 + more) * row,
                "sign": -row,
                "late": np.roll(row, 1),
                "zero": np.where(row == 0, 1e-2 * size, row),
            }.items():
                whole = y.copy()
                np.atleast_2d(whole)[k] = other
                changed = part._replace(rows={**part.rows, id(block): whole})
                least = 0 if name == "size" else 1e-6 * size
                if np.abs(other - row).max() > least and one(block, run, [changed]).error <= 1:
                    blind.append((block, k, name))
        return found

    monkeypatch.setattr(local, "_one", watch)
    found = local.held(run_of(entry))
    far = {h.kind: f"{h.error:.3g} tolerances from its law" for h in found if not h.error <= 1}
    assert not far, "one of the two is wrong, the block or its law in stimlib/checks/families"
    assert {h.why for h in found if not isinstance(h.block, Lagging)} <= {""}
    assert not [each for each in blind if not isinstance(each[0], Lagging)], (
        "the law accepts these changes of an output (block, output, change): narrow its tolerance"
    )


def moves(scene, n):
    """Changes of parameters, at once and along ramps."""
    rng = np.random.default_rng(3)
    some = sorted((int(at), name) for name in scene.params for at in rng.integers(1, n, 4))
    return [
        Change(at, name, float(rng.uniform(0.2, 0.9)), float(rng.choice([0.0, 0.01, 0.1])))
        for at, name in some
    ]


LATER = [
    "enabled_live",
    "enabled_nested",
    "enabled_by_param",
    "segment_nested",
    "lowpass_slow",
    "pink_noise",
    "integrate",
    "square",
    "count",
    "carrier_param",
    "track_contact",
    "friction_coulomb",
    "compliance_chain",
    "ring_live",
    "elapsed_gated",
    "envelope",
    "white_shared",
    "springpot_contact",
    "delay_70",
    "crossing",
    "crossing_split",
    "pulse_train",
    "pulse_train_regular",
    "button",
    "button_live",
    "vibration",
    "texture",
    "stick_slip_live",
    "cursor_frames",
    "avatar",
    "avatar_frames",
]


# of these the last stretch has no row of the class that is not 0, or it has not been
# seen for long enough there
UNSEEN = {
    "enabled_live",
    "enabled_nested",
    "enabled_by_param",
    "segment_nested",
    "track_contact",
    "ring_live",
    "elapsed_gated",
}


@pytest.mark.parametrize("name", mostly(LATER[::3], LATER))
def test_stretches_of_a_long_run_are_held_also_where_parameters_move(name, monkeypatch):
    """And the samples of one of them 1 part in 1000 larger are refused."""
    entry, n, spoiled = next(e for e in TABLE if e.name == name), 50_000, []
    run = run_of(entry, n, moves(entry.scene(), n))
    assert (
        len(run.spans) == 1 + local.PLACES
        and sum(z - a for a, z in run.spans) == local.FIRST + local.PLACES * local.LATER
    )
    one = local._one

    def watch(block, run, seen):
        found, rest = one(block, run, seen), seen[-1].rows
        late = seen[-1]._replace(rows={**rest, id(block): 1.001 * rest[id(block)]})
        if (
            type(block).__name__ == entry.cls
            and found.samples > local.FIRST
            and late.rows[id(block)].any()
        ):
            spoiled.append(one(block, run, [*seen[:-1], late]).error > 1)
        return found

    monkeypatch.setattr(local, "_one", watch)
    assert not [h for h in local.held(run) if not h.error <= 1]
    assert all(spoiled) and (spoiled or name in UNSEEN)


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_a_pulse_before_whose_period_a_stretch_begins_is_held_where_its_jitter_is_a_number(jitter):
    """And of another jitter from the next period on: the samples that nothing is said
    of are not counted.
    """
    n = local.FIRST + 5 * local.LATER
    for moved, least in ((constant(jitter), n - local.LATER), (jitter * Input("j"), local.FIRST)):
        scene = Scene({"y": b.pulse_train(0.9, moved)})
        run = local.Run(scene.outputs, FS, 3, {"j": np.ones(n)}, n, {}, [], local.spans(n, 7))
        (train,) = (h for h in local.held(run) if h.kind == "PulseTrain")
        assert train.error == 0 and least <= train.samples <= n - local.LATER


def test_pink_noise_that_starts_from_another_state_is_refused():
    run = local.Run({"y": b.pink_noise(1.0, 3)}, FS, 3, {}, 300, {}, [], [(0, 300)])
    found, (part,) = local._held(run)
    (pink,) = (h.block for h in found if type(h.block).__name__ == "PinkNoise")
    row = part.rows[id(pink)]
    decay = pink.design(FS)[0].p.max() ** np.arange(row.size)
    for size, seen in ((0.0, False), (0.1, True)):
        changed = part._replace(
            rows={**part.rows, id(pink): row + size * np.abs(row).max() * decay}
        )
        assert (local._one(pink, run, [changed]).error > 1) is seen


@pytest.mark.parametrize("seed", mostly(range(3), range(8)))
def test_random_compositions_are_not_refused(seed):
    """The short form of ``tests/stress/compositions.py``."""
    found = compositions.refused(seed)
    assert found is None or not found[0]


def test_inputs_and_parameters_without_any_effect_are_of_no_harm():
    x, none = Input("x"), 0 * Param("p", 2.0)
    gate = b.enabled(constant(0.0), by=Input("h"))
    scene = Scene({"y": x + none + gate, "z": b.segment(none + x + gate, 0.01, 0.02)})
    motion = {"x": np.sin(np.arange(100.0))}
    assert stimlib.verify(scene, motion, stimlib.render(scene, motion, 1000)).passed


def test_what_no_input_reaches_passes_behind_its_safety_stage():
    """What is before the guards begins before sample 0, at rest or not, and what is
    behind does not.
    """
    noise, tone = b.lowpass(b.white_noise(1), 50.0, 2), b.oscillator(21.0, "square", phase=0.3)
    x = constant(1e-3, "m") * (b.oscillator(37.0, phase=0.3) + 0.25)
    outputs = {
        "filtered": noise,
        "late": b.delay(b.moving_average(tone, 0.01), 5),
        "gated": b.enabled(b.highpass(b.white_noise(2), 30.0), by=b.white_noise(3) > 0.0),
        "speed": b.velocity(x),
        "held": b.velocity(constant(0.7, "m")),
        "springpot": b.springpot(x, 300.0, 0.5),
        "friction": b.friction(x, 1.0, law="coulomb"),
        "cursor": b.cursor(x, x, ([[0, 1], [0, 1]], 0.01, 0.01)).x,
    }
    safe = protect(Scene(outputs), Safety(dict.fromkeys(outputs, 2.0)))
    rendering = stimlib.render(safe, {}, FS, 0.05, {GAIN: 1.0})
    assert stimlib.verify(safe, {}, rendering).passed
    rendering.y[0, 30] += 1e-9
    assert not stimlib.verify(safe, {}, rendering).passed


@pytest.mark.parametrize(
    "cls",
    mostly(
        ["Delay", "Carrier"], ["Delay", "Filter", "MaxwellArms", "Carrier", "OnceWithin", "Svf"]
    ),
)
def test_a_wrong_step_or_design_is_refused(cls):
    """The short form of ``tests/stress/mutants.py``: in compositions that no scene
    is.
    """
    said = list(mutants.sampled(cls, 1))
    assert {what.split(",")[0] for *_, what in said} <= {"caught", "equal", "rounding"}, said
    assert {kind for kind, _, what in said if what == "caught"} == set(mutants.KINDS), said


def test_an_error_is_the_largest_distance_over_its_tolerance():
    nan, inf = np.nan, np.inf
    for y, want, tol, error in (
        (1.0, 0.0, 0.5, 2.0), (0.0, 1.0, 0.5, 2.0), (1.0, 0.0, 0.0, inf),
        (1.0, 1.0, 0.0, 0.0), (1.0, 5.0, inf, 0.0),
        (nan, 1.0, 1.0, inf), (1.0, nan, 1.0, inf), (nan, nan, 1.0, 0.0), (inf, 1.0, 1.0, inf),
    ):  # fmt: skip
        assert local._error(np.array([0.0, y]), [0.0, want], tol) == error


@pytest.mark.parametrize(("at", "ramp"), [(100, 0.0), (5, 0.01), (5, 0.0)])
def test_a_parameter_may_move_in_a_segment_and_as_it_begins(at, ramp):
    scene = Scene({"y": b.segment(Param("k", 1.0) * Input("x"), 0.01, 0.02)})  # samples 80 to 239
    run = local.Run(
        scene.outputs,
        FS,
        3,
        {"x": np.ones(N)},
        N,
        {"k": 1.0},
        [Change(at, "k", 2.0, ramp)],
        [(0, N)],
    )
    assert [(h.error, h.why) for h in local.held(run) if type(h.block).__name__ == "Segment"] == [
        (0.0, "")
    ]


class Twice(Block, abstract=True):
    @staticmethod
    def step(p, s, x):
        return 2.0 * x, s


def own(law):
    """The report of a scene with a block that states this law."""

    @dataclass(frozen=True, eq=False)
    class Own(Twice):
        x: Block

    Own.law = law
    scene, x = Scene({"y": Own(Input("x"))}), {"x": np.linspace(-1, 1, 100)}
    return stimlib.verify(scene, x, stimlib.render(scene, x, fs=1000))


@pytest.mark.parametrize(("factor", "passes"), [(2.0, True), (2.0 + 1e-12, False)])
def test_a_block_of_ones_own_states_its_law(factor, passes):
    report = own(lambda self, fs, rows, y: factor * rows[0])
    bad = [c.name for c in report.checks if not c.passed]
    assert [name.rpartition(".")[2] for name in bad] == ([] if passes else ["Own"])
    assert not [text for text in report.evidence.skipped if "nothing but its own step" in text]


def test_a_law_that_says_nothing_of_these_numbers_is_no_law():
    report = own(lambda self, fs, rows, y: None)
    (held,) = (h for h in report.evidence.held if type(h.block).__name__ == "Own")
    assert report.passed and held.why.startswith("no law") and not held.samples


@pytest.mark.parametrize(
    ("law", "says"),
    [
        (lambda self, rows: 2 * rows[0], "raises TypeError: .* 4 were given"),
        (lambda self, fs, rows, y: 1 / 0, "raises ZeroDivisionError"),
        (lambda self, fs, rows, y: np.multiply(y, 0, out=y), "ValueError: .*read-only"),
        (lambda self, fs, rows, y: rows[0].fill(0.0), "ValueError: .*read-only"),
        (lambda self, fs, rows, y: (3 * rows[0], -1.0), "tolerance that is not 0 or above"),
        (lambda self, fs, rows, y: (3 * rows[0], np.nan), "tolerance that is not 0 or above"),
        (lambda self, fs, rows, y: (2 * rows[0], np.ones(3)), r"of the shape \(3,\)"),
        (lambda self, fs, rows, y: (2 * rows[0], 0.1, 3), "returned 3 things"),
    ],
)
def test_a_law_that_proves_nothing_is_refused(law, says):
    """An exception was "not checked"; the output set to 0 by its law, and a tolerance
    below 0, passed.
    """
    refused(BadValue, f"Own.law .*{says}", own, law)


def test_a_law_of_stimlibs_own_that_raises_is_not_for_the_user_to_correct(monkeypatch):
    monkeypatch.setitem(rows.LAWS, "Abs", lambda *of: 1 / 0)
    scene, x = Scene({"y": abs(Input("x"))}), {"x": np.ones(N)}
    run = local.Run(scene.outputs, FS, 3, x, N, {}, [], [(0, N)])
    refused(ZeroDivisionError, None, local.held, run)
