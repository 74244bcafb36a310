"""Sources rest where nobody hears them, and no sample tells."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from laws import STRESS, Set, assert_same, random_cuts, rows, run

import stimlib
from stimlib import Input, Param, Scene, blocks as b, constant
from stimlib.core import silence
from stimlib.core.units import ONE

FS = 1000.0
X, A = Input("x"), Param("A", 0.0)
BURST = b.burst(b.at([0.02, 0.2]), 0.05, 0.01)


def kinds(block):
    """The classes of a scene's program that have to do with rest."""
    made = Scene({"y": block}).program.instances
    return sorted(
        f"{name}({type(one.block.contact).__name__})"
        if name in ("RestingWhite", "Carrier")
        else name
        for name, one in zip([type(one.block).__name__ for one in made], made, strict=True)
        if name in ("RestingWhite", "Carrier", "White", "Mul", "RestingMul")
    )


TONE, NOISE = b.carrier(50.0), b.white_noise(1)
B, BY = Param("B", 0.5), "RestingWhite(Sounding)"


@pytest.mark.parametrize(
    ("block", "made"),
    [
        (TONE * BURST, ["Carrier(Sounding)", "RestingMul"]),
        (BURST * NOISE, ["RestingMul", "RestingWhite(Sounding)"]),
        (NOISE * A, ["RestingMul", "RestingWhite(Sounding)"]),
        (
            (TONE - 0.5 * NOISE + 1.0) * BURST,
            ["Carrier(Sounding)", "Mul", "RestingMul", "RestingWhite(Sounding)"],
        ),
        (b.where(X, TONE, -NOISE), ["Carrier(Input)", "RestingWhite(Otherwise)"]),
        (b.where(-TONE, X, X + 1.0), ["Carrier(Const)"]),  # what chooses is heard always
        (TONE * BURST + TONE, ["Carrier(Const)", "RestingMul"]),
        (TONE * BURST + TONE * (X > 0.0), ["Carrier(Const)", "RestingMul", "RestingMul"]),
        (abs(TONE) * BURST, ["Carrier(Const)", "Mul"]),
        (TONE * X, ["Carrier(Const)", "Mul"]),
        (b.carrier(50.0, contact=X) * BURST, ["Carrier(Input)", "Mul"]),
        (b.carrier(50.0, contact=0.0) * BURST, ["Carrier(Const)", "Mul"]),
        (b.carrier(constant(50.0, "Hz") * X) * BURST, ["Carrier(Const)", "Mul", "Mul"]),
        (b.pink_noise(1.0, seed=2) * BURST, ["Mul", "White"]),
        ((TONE * A) * (B * NOISE), ["Carrier(Sounding)", *["RestingMul"] * 3, BY]),
        ((TONE * A) * (TONE * A), ["Carrier(Sounding)", *["RestingMul"] * 2]),
        # of products that wait for each other, neither does
        (
            ((TONE * A) * (NOISE * B)) * ((b.carrier(60.0) * A) * (b.white_noise(2) * B)),
            [*["Carrier(Sounding)"] * 2, *["RestingMul"] * 7, BY, BY],
        ),
        ((TONE + 1.0) * (A * NOISE), ["Carrier(Sounding)", *["RestingMul"] * 2, BY]),
        (TONE * BURST - 2.0 * TONE * BURST, ["Carrier(Sounding)", "Mul", *["RestingMul"] * 2]),
        (b.loop(lambda last: (0.5 * last + NOISE) * A), ["White"]),
        (b.enabled(NOISE * A, by=X), ["RestingMul", "RestingWhite(Sounding)"]),
    ],
)
def test_what_rests(block, made):
    assert kinds(block) == sorted(made)


@pytest.mark.parametrize(
    ("block", "says"),
    [
        (A * TONE * BURST, BURST),
        (BURST * (TONE * A), BURST),
        (A * (BURST * TONE), BURST),
        ((A * TONE) * (BURST * NOISE), BURST * NOISE),
    ],
)
def test_a_burst_says_it_rather_than_a_parameter(block, says):
    (tone,) = (one.block for one in Scene({"y": block}).program.instances if one.block.rated)
    assert repr(tone.contact.x) == repr(says)


F = Param("F", 31.0, "Hz")
SOUND = b.playback(np.resize([0.5, 0.0, -0.0, -1.0], 70), rate=FS)
GATES = [A, B, F / constant(1.0, "Hz"), BURST, SOUND, X, X > 0.0, b.nonzero(X), X == 0.0]
GATES += [b.envelope(X > 0.5, 0.002, 0.003, 0.5, 0.001), b.hysteresis(X, 0.5, -0.5)]
GATES += [b.loading(constant(1.0, "m/s") * X, on=0.5, off=0.2), b.burst(0.1 * A * X, 0.03)]


@st.composite
def composed(draw, most=9):
    """Sources, what lets them through, and sums and choices of both."""
    sources = [
        b.carrier(draw(st.sampled_from([31.0, 499.0, F])), draw(st.sampled_from([None, "half"]))),
        b.white_noise(draw(st.integers(0, 3)), shared=True),
        b.oscillator(77.0, "triangle"),
    ]
    gates = [*GATES, b.enabled(sources[1], by=X), b.segment(BURST * sources[1], 0.03, 0.2, seed=1)]
    pool = [*sources, sources[0] * draw(st.sampled_from(gates))]
    for _ in range(draw(st.integers(2, most))):
        one, other = draw(st.sampled_from(pool[-5:])), draw(st.sampled_from(pool))
        gate = draw(st.sampled_from([*gates, *pool[-2:]]))
        makers = [
            lambda one=one, gate=gate: one * gate,
            lambda one=one, gate=gate: gate * one,
            lambda one=one, other=other: one - other,
            lambda one=one, other=other: 0.5 * one + other,
            lambda one=one: -one,
            lambda one=one, other=other, gate=gate: b.where(gate, one, other),
            lambda one=one: b.first_order(one, 0.01),
            lambda one=one: b.delay(one, 70),
            lambda one=one: b.tanh(one),
            lambda one=one, other=other: one / (1.5 + b.tanh(other)),
            lambda one=one, other=other: one / other,
        ]
        pool.append(draw(st.sampled_from(makers))())
    return pool[-1], draw(st.sampled_from(pool))


def shown(v):
    """A signal with numbers for what is none, at which the guard would fade it out."""
    return b.where(v - v == 0.0, v, b.where(v > 0.0, 7e9, b.where(v < 0.0, -7e9, 8e9)))


def stretches(rng, n):
    """Motion in stretches: of zeros with either sign, of numbers, of everything."""
    values = [[0.0], [-0.0], [0.0, -0.0, 1.0, -2.0], [0.0, -0.0, 0.5, np.nan, np.inf, -np.inf]]
    lengths = rng.choice([1, 3, 20, 64, 130], n, p=[0.1, 0.1, 0.3, 0.3, 0.2])
    parts = [
        rng.standard_normal(k) if (of := rng.integers(5)) == 4 else rng.choice(values[of], k)
        for k in lengths[: np.searchsorted(np.cumsum(lengths), n) + 1]
    ]
    return np.concatenate(parts)[None, :n]


def no_bit_tells(blocks, seed, size, n=300):
    """Compare the samples of compositions that rest with those that do not.

    Beside all that they are made of, and without rest; the interpreter makes one of the
    three.
    """
    rng = np.random.default_rng(seed)
    motion, interpreted = stretches(rng, n), rng.integers(3)
    sets = [
        Set(int(rng.integers(n)), name, float(rng.choice(values)), float(rng.choice(ramps)))
        for name, values in (
            ("A", [0.0, -0.0, 5e-324, -1.3]),
            ("B", [0.0, 2.0]),
            ("F", [0.0, 99.0]),
        )
        for ramps in ([0.0, 0.004, 0.07],) * 2
    ]
    cuts = range(0, n, size) if size else random_cuts(n, rng)

    def samples(outputs, turn):
        scene = Scene(outputs)

        def made(target, cuts):
            proc = stimlib.compile(scene, FS, target, seed)
            moves = [one for one in sets if one.name in proc.params]
            return run(proc, rows(proc, motion, ["x"]), cuts, moves)

        y = made("llvm", cuts)
        if turn == interpreted:
            assert_same(made("python", ()), y, "llvm and python")
        return y[: len(blocks)]

    roots = {f"y{k}": shown(one) for k, one in enumerate(blocks)}
    y = samples(roots, 0)
    beside = {
        f"z{k}": one for k, one in enumerate(stimlib.core.graph.reach(blocks)) if one.dim == ONE
    }
    assert_same(samples(roots | beside, 1), y, "with all that it is made of beside it")
    with pytest.MonkeyPatch.context() as patched:
        whole = silence._contacts

        def throughout(nodes, roots):
            contacts, products = whole(nodes, roots)
            return dict.fromkeys(contacts), products

        patched.setattr(silence, "_contacts", throughout)
        assert_same(samples(roots, 2), y, "without rest")
    return y


@settings(max_examples=900 if STRESS else 40, deadline=None)
@given(composed(), st.integers(0, 999), st.sampled_from([0, 1, 7, 64, 100]))
def test_no_bit_tells_who_rested(blocks, seed, size):
    """Nor the sign of a zero, nor what is no number."""
    no_bit_tells(blocks[:1], seed, size)


def test_a_source_at_rest_goes_on():
    """After a rest that begins and ends within tiles it is where it would be."""
    n = np.arange(400)
    # within a tile, for one sample, and for all but one
    x = ((n > 70) & (n < 90)) | (n == 205) | ((n >= 256) & (n != 290))
    for source in (TONE, NOISE):
        gated, alone = (
            stimlib.compile(Scene({"y": y}), FS).process(
                x[None, :] * 1.0 if k else np.empty((0, 400))
            )
            for k, y in enumerate((source * 1.0, source * (X > 0.0)))
        )
        assert_same(alone[0], np.where(x, gated[0], 0.0), f"{source}")
