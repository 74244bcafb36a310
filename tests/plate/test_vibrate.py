"""The plate in a scene: against an integration in time, and what equalisation and
compensation leave.
"""

from dataclasses import replace

import numpy as np
import pytest
from laws import STRESS, played
from refusals import refused
from scipy.integrate import solve_ivp

import stimlib
from stimlib import BadValue, Input, Scene, UnitError
from stimlib.blocks import amplifier, equalize, mode, mode_shape, pole_swap
from stimlib.plate import Finger, Plate, best_gain, envelope_behind, half_sine, mode_fit, plate

GLASS = replace(Plate.paper(measured=True), terms=12)
FS = 8000
X, Y, V = Input("x", "m"), Input("y", "m"), Input("v", "V")


def stroke(n):
    """A finger that strokes across the plate, 0.5 m/s and slower, and a voltage with
    edges.
    """
    t = np.arange(n) / FS
    drive = 40 * np.sin(2 * np.pi * 159 * t) * (np.sin(2 * np.pi * 90 * t) > -0.2)
    return {"x": 0.053 + 0.05 * np.sin(10 * t), "y": 0.07 + 0.02 * np.sin(7 * t), "v": drive}


def pulled(scene, rows):
    return played(scene.outputs, rows, fs=FS, target="python")[0]


def integrated(rows, finger=None, modes=2):
    """The same modes by an integrator that knows the voltage as straight lines, sample
    after sample.
    """
    force, w2 = GLASS.forces(16), GLASS.solved(16)[0]
    driven = [k for k in range(16) if abs(force[k]) / w2[k] > 1e-6 * max(abs(force) / w2)][:modes]
    phi = np.array([GLASS.shape(k, rows["x"], rows["y"]) for k in driven])
    w2, F, loss = w2[driven], force[driven], np.sqrt(w2[driven]) * GLASS.damping
    m, c, k = (finger.mass, finger.damping, finger.stiffness) if finger else (0.0, 0.0, 0.0)
    state, out, at = np.zeros(2 * modes), [], np.r_[0.0, rows["v"]]
    for i, a in enumerate((phi**2).T):

        def slope(t, s, i=i, a=a):
            v = at[i] + (at[i + 1] - at[i]) * t * FS
            q, p = s[:modes], s[modes:]
            return np.r_[p, (F * v - (w2 + k * a) * q - (loss + c * a) * p) / (1 + m * a)]

        state = solve_ivp(slope, (0, 1 / FS), state, "DOP853", rtol=1e-12, atol=1e-22).y[:, -1]
        out.append(phi[:, i] @ state[:modes])
    return np.array(out)


def test_the_block_is_what_an_integrator_finds():
    rows = stroke(24000 if STRESS else 40)
    want = integrated(rows)
    got = pulled(Scene({"d": plate(X, Y, V, GLASS, modes=2)}), rows)
    assert np.abs(got - want).max() <= 1e-8 * np.abs(want).max()


def test_a_finger_makes_a_mode_slower_and_weaker():
    rows = stroke(320)
    finger = Finger(1e-3, 2.0, 1000.0)
    want = integrated(rows, finger, modes=1)
    got = pulled(Scene({"d": plate(X, Y, V, GLASS, modes=1, finger=finger)}), rows)
    without = pulled(Scene({"d": plate(X, Y, V, GLASS, modes=1)}), rows)
    assert np.abs(got - want).max() < 0.02 * np.abs(want).max() < 0.2 * np.abs(without - want).max()


def test_at_a_place_it_is_the_plates_own_response():
    centre = GLASS.length / 2, GLASS.width / 2
    proc = stimlib.compile(Scene({"d": plate(*centre, V, GLASS)}), 48000, "python")
    f = np.array([50.0, GLASS.carrier(), 300.0])
    np.testing.assert_allclose(
        proc.response("d", "v", f), GLASS.frf("patches", centre, f, modes=9), rtol=2e-3
    )


def test_a_shape_is_held_beyond_its_edges_and_nan_comes_through():
    scene = Scene({"y": mode_shape(X, Y, [[0.1, 0.2], [0.3, 0.4]], 0.2, 0.1)})
    rows = {"x": np.array([-1.0, 0.05, 9.0, np.inf]), "y": np.array([0.0, 0.025, 0.1, 0.1])}
    np.testing.assert_allclose(
        pulled(scene, rows), [0.1 - 0.2 - 0.3 + 0.4, 0.1 - 0.1 - 0.15 + 0.1, 1.0, 1.0], atol=1e-12
    )


KNOTS = np.arange(5) * 0.025


@pytest.fixture(scope="module")
def soft():
    """A plate whose clamps give way, and its true profile over the explored 0.1 m."""
    paper = Plate.paper()
    model = replace(paper, clamp_stiffness=15 * paper.stiffness / paper.length)
    return model, lambda x: np.abs(model.shape(0, 0.053 + np.asarray(x), model.width / 2))


def test_a_mode_through_knots_is_exact_and_keeps_out_their_noise(soft):
    model, truth = soft
    x = np.linspace(0, 0.1, 65)
    fit = mode_fit(Plate.paper(), origin=0.053)  # it does not know how soft they are
    np.testing.assert_allclose(fit(KNOTS, truth(KNOTS))[1], truth(x), rtol=1e-5)
    rng = np.random.default_rng(0)
    worst = [
        np.abs(
            truth(x) / fit(KNOTS, truth(KNOTS) * (1 + 0.01 * rng.standard_normal(5)))[1] - 1
        ).max()
        for _ in range(20)
    ]
    assert np.quantile(worst, 0.95) <= 0.023
    moved = mode_fit(Plate.paper(), origin=0.050)(KNOTS, truth(KNOTS))[1]  # the ruler is 3 mm off
    np.testing.assert_allclose(moved, truth(x), rtol=1e-5)


def test_equalize_takes_the_mode(soft):
    model, truth = soft
    fit = mode_fit(model, origin=0.053, clamp="known")
    scene = Scene({"v": equalize(X, (KNOTS, truth(KNOTS)), signal=Input("u", "V"), kind=fit)})
    x = np.linspace(0, 0.1, 20).repeat(2)
    v = pulled(scene, {"x": x, "u": np.ones(40)})[1::2]
    np.testing.assert_allclose(v * truth(x[::2]), truth(0.05), rtol=1e-4)
    # a clamp that is known is not fitted: one that is wrong stays wrong
    stiff = mode_fit(Plate.paper(), origin=0.053, clamp="known")(KNOTS, truth(KNOTS))[1]
    assert np.abs(stiff / truth(np.linspace(0, 0.1, 65)) - 1).max() > 1e-3


def test_knots_that_are_too_few_or_another_shape_are_told(soft):
    model, truth = soft
    fit = mode_fit(model, origin=0.053)
    for ask, match in (
        (lambda: fit(KNOTS[:3], truth(KNOTS[:3])), "3 knots cannot tell"),
        (lambda: mode_fit(model, origin=0.12)(KNOTS, truth(KNOTS)), "from the edges"),
        (lambda: fit(KNOTS, truth(KNOTS) * [1, 1, 0.4, 1, 1]), "knot 2"),
        (lambda: fit(KNOTS, truth(KNOTS + 0.025)), "give origin= within 20 mm"),
        (lambda: fit(KNOTS, truth(KNOTS) * [1, 1, 0, 1, 1]), "above 0"),
        (lambda: fit(0 * KNOTS, truth(KNOTS)), "must rise"),
        (lambda: mode_fit(model, origin=np.nan), "origin = nan is not finite"),
        (
            lambda: equalize(X, (KNOTS, truth(KNOTS)), kind=mode_fit),
            "mode_fit: model = .* must be a Plate",
        ),
        (
            lambda: equalize(X, (KNOTS, truth(KNOTS)), kind="mode"),
            r"stimlib.plate.mode_fit\(model\)",
        ),
        (
            lambda: mode_fit(replace(model, edges="CCCC", clamp_stiffness=None), y=0.0),
            "nothing moves",
        ),
        (lambda: mode_fit(model, clamp="free"), "one of fit, known"),
        (lambda: mode_fit(model, y=1.0), "outside the plate"),
    ):
        refused(BadValue, match, ask)


def test_the_swap_gives_back_the_depth_of_modulation_at_its_price():
    before, after = (envelope_behind(158.0, 10.0, 20.0, gain) for gain in (1, 4))
    assert 0.39 < before.depth < 0.41 and before.drive == pytest.approx(1.0)
    assert after.depth >= 0.85 and after.drive == pytest.approx(2.0, abs=0.05)
    assert (
        envelope_behind(158.0, 10.0, 90.0, 4).depth > 3.5 * envelope_behind(158.0, 10.0, 90.0).depth
    )
    # it goes by rate over frequency
    np.testing.assert_allclose(envelope_behind(0.5, 10.0, 0.5 * 20 / 158, 4)[:4], after[:4])
    np.testing.assert_allclose(half_sine([0.1, 0.7], 0.4), [np.sin(np.pi / 4), 0], rtol=1e-15)
    half = envelope_behind(158.0, 10.0, 20.0, 4, lambda u: 0.5 * half_sine(u))
    np.testing.assert_allclose(half[:4], after[:4])
    assert best_gain(158.0, 10.0, 45.0, 1e6) == pytest.approx(20.0)  # all that a swap may have
    # where the voltage without a swap rounds to above 1
    assert best_gain(360.84141223071293, 12.067601992448894, 8.348727644281727, 1.0) == 1.0
    gain = best_gain(158.0, 10.0, 45.0, 1.8)
    assert envelope_behind(158.0, 10.0, 45.0, gain).drive == pytest.approx(1.8, rel=1e-6)


def test_the_blocks_do_what_the_model_of_envelopes_says():
    n = np.arange(FS)
    u = (n * 20 / FS) % 1
    v = np.where(u < 0.5, np.sin(2 * np.pi * u), 0) * np.sin(2 * np.pi * 158 * n / FS)
    for gain in (1.0, 4.0):
        drive = pole_swap(V, 158.0, 10.0, gain)
        proc = stimlib.compile(Scene({"y": 0.1 * mode(drive, 158.0, 10.0), "v": drive}), FS)
        y, d = proc.process(v[None])[:, FS // 2 :]
        lines = np.fft.fft(y)
        lines[lines.size // 2 :] = 0
        envelope, model = 2 * np.abs(np.fft.ifft(lines)), envelope_behind(158.0, 10.0, 20.0, gain)
        assert np.ptp(envelope) == pytest.approx(model.depth, abs=0.03)
        assert np.abs(d).max() == pytest.approx(model.drive, abs=0.15)


@pytest.mark.parametrize(
    ("ask", "error", "match"),
    [
        (lambda: mode(V, 158.0, 0.4), BadValue, "does not ring"),
        (lambda: mode_shape(X, Y, [[]], 0.2, 0.1), BadValue, r"mode_shape: c .* shape \(1, 0\)"),
        (lambda: pole_swap(V, 158.0, 10.0, 20.0), BadValue, "below 2 q = 20"),
        (lambda: pole_swap(V, 158.0, 10.0, 4.0, v_max=-1.0), BadValue, "v_max"),
        (lambda: amplifier(X), UnitError, "must be in V"),
        (lambda: amplifier(V, lowest=5.0, highest=1.0), BadValue, "must be below"),
        (
            lambda: amplifier(V, 50.0, *Plate.paper().voltages),
            BadValue,
            "amplifier: lowest = -inf is not finite",
        ),
        (lambda: plate(X, Y, X, GLASS), UnitError, "must be in V"),
        (lambda: plate(V, Y, V, GLASS), UnitError, "must be in m"),
        (lambda: plate(X, Y, V, Plate.paper()), BadValue, "no patches"),
        (lambda: plate(X, Y, V, GLASS, modes=17), BadValue, "the patches drive"),
        (lambda: plate(X, Y, V, "glass"), BadValue, "model = 'glass' must be a Plate"),
        (lambda: plate(X, Y, V, GLASS, finger=True), BadValue, "finger = True must be a Finger"),
        (lambda: Finger(mass=-1.0), BadValue, "mass"),
        (lambda: envelope_behind(158.0, 10.0, 0.0), BadValue, "above 0"),
        (lambda: envelope_behind(158.0, 10.0, 20.0, 4.0, lambda u: 1.0), BadValue, "is constant"),
        (lambda: envelope_behind(158.0, np.inf, 20.0), BadValue, "q = inf is not finite"),
        (
            lambda: envelope_behind(158.0, 10.0, 20.0, 4.0, "square"),
            BadValue,
            "envelope = .square. must be a function",
        ),
        (
            lambda: envelope_behind(158.0, 10.0, 20.0, 4.0, lambda u: np.arange(3.0)),
            BadValue,
            "function of an array",
        ),
        (lambda: best_gain(158.0, 10.0, 20.0, 0.5), BadValue, "1 or above"),
        (lambda: half_sine([0.1], 0.0), BadValue, "duty = 0.0 must be"),
    ],
)
def test_drives_that_make_no_sense_are_told(ask, error, match):
    refused(error, match, ask)


def test_a_limit_holds_and_an_amplifier_knows_its_patches():
    scene = Scene({"v": pole_swap(V, 158.0, 10.0, 4.0, v_max=1.5)})
    assert np.abs(pulled(scene, {"v": np.where(np.arange(200) % 50 < 25, 1.0, -1.0)})).max() == 1.5
    assert GLASS.voltages == (-100.0, 400.0)
    assert pulled(
        Scene({"v": amplifier(V, 50.0, *GLASS.voltages)}), {"v": np.array([-9.0, 3.0, 9.0])}
    ).tolist() == [
        -100,
        150,
        400,
    ]
