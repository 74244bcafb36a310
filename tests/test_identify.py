"""stimlib.fit finds what was rendered, with the derivatives that differences give, and
says what it cannot do.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from laws import mostly
from refusals import refused
from scipy import signal, stats

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnknownName
from stimlib.blocks import first_order, pink_noise, spring, springpot, velocity, white_noise
from stimlib.fitting.scene import Range, _log_psd
from stimlib.scenes import bumps

FS, N = 1000, 600
T = np.arange(N) / FS
X = 0.01 * np.sin(9 * T) ** 2 + 0.002 * np.sin(60 * T)
y = Input("y", "m")
static = Scene({"force": spring(y, Param("k", 300.0, "N/m")) + Param("b", 2.0, "N/m^2") * (y * y)})
damped = Scene(
    {"force": spring(y, Param("k", 300.0, "N/m")) + Param("b", 2.0, "N*s/m") * velocity(y)}
)


def rendered(scene, motion=None, fs=FS, seconds=None, **params):
    return stimlib.render(scene, {"y": X} if motion is None else motion, fs, seconds, params).y[0]


# Coordinates --------------------------------------------------------------------------
@pytest.mark.parametrize(
    "r",
    [
        Range(3e-9, 0.0, math.inf),
        Range(-2e6, -math.inf, 0.0),
        Range(0.3, 0.0, 1.0),
        Range(5.0, 2.0, math.inf),
        Range(50.0, 1.0, 1e6),
        Range(4.0, -math.inf, math.inf),
        Range(0.0, -1.0, 3.0),
    ],
)
def test_coordinates_start_at_zero_rise_and_stay_inside(r):
    u = np.array([-math.inf, -50, -1, -1e-3, 0, 1e-3, 1, 50, math.inf])
    v = r.value(u)
    assert v[4] == pytest.approx(r.start, rel=1e-14, abs=1e-15)
    assert np.all((v >= r.low) & (v <= r.high)) and np.all(np.diff(v) >= 0)
    assert np.all(np.diff(v[2:7]) > 0)
    with jax.enable_x64(True):
        assert np.allclose(r.value(jnp.asarray(u), jnp), v, rtol=1e-12)


# Derivatives --------------------------------------------------------------------------
class Walk:
    """An optimiser that goes where it is told, and writes the gradients down."""

    def __init__(self, moves):
        self.moves, self.seen = np.array(moves), []

    def transformation(self):
        def update(grad, state, params=None):
            jax.debug.callback(lambda i, g: self.seen.append((int(i), np.array(g))), state, grad)
            return jnp.asarray(self.moves)[state], state + 1

        return optax.GradientTransformation(lambda params: jnp.zeros((), int), update)


noisy = Scene({"y": Param("a", 2.0) * white_noise(1) + Param("p", 3.0) * pink_noise(10.0, seed=2)})
SMOOTH = {
    "force": (damped, {"y": X}, X * 500, {"k": 200.0, "b": (3.0, 0, 9)}, {}),
    "rms": (damped, {"y": X}, 7.0, {"k": 200.0, "b": (3.0, 0, 9)}, {}),
    "log_psd": (
        noisy,
        {},
        lambda f: 1 / f,
        {"a": 1.0, "p": (1.0, 0, 9)},
        {"band": (20.0, 400.0), "seconds": 4.0},
    ),
}


@pytest.mark.parametrize("loss", SMOOTH)
def test_gradients_match_central_differences(loss):
    scene, motion, target, params, options = SMOOTH[loss]
    h = 1e-5
    walk = Walk([(h, 0), (-2 * h, 0), (h, h), (0, -2 * h)])
    fit = stimlib.fit(
        scene,
        motion,
        target,
        params,
        loss,
        fs=FS,
        steps=4,
        tol=1e-12,
        optimiser=walk.transformation(),
        **options,
    )
    jax.effects_barrier()
    difference = (fit.history[[1, 3]] - fit.history[[2, 4]]) / (2 * h)
    assert dict(walk.seen)[0] == pytest.approx(difference, rel=1e-5)


# What was rendered comes back ---------------------------------------------------------
def test_a_springpot_and_a_spring_come_back():
    pot = springpot(y, Param("chi", 1.0), Param("alpha", 0.1), "l1")
    scene = Scene({"force": spring(y, Param("k", 1.0, "N/m")) + pot})
    force = rendered(scene, k=800.0, chi=60.0, alpha=0.3)
    start = {"k": 300.0, "chi": 150.0, "alpha": (0.5, 0, 1)}
    fit = stimlib.fit(scene, {"y": X}, force, start, fs=FS)
    assert fit.converged and fit.loss < 1e-20 and fit.history[0] > 0.01
    assert fit.params == pytest.approx({"k": 800.0, "chi": 60.0, "alpha": 0.3}, rel=1e-7)
    for found in (fit.signals["force"], rendered(fit.scene)):
        assert found == pytest.approx(force, abs=1e-8)
    assert fit.history[-1] == fit.loss and fit.steps == len(fit.history) - 1


def test_a_bound_holds_where_the_best_lies_beyond():
    target, start = rendered(static, k=50.0, b=2.0), {"k": (300.0, 100.0, 500.0)}
    fit = stimlib.fit(static, {"y": X}, target, start, fs=FS, steps=50)
    assert set(fit.params) == {"k"} and 100.0 <= fit.params["k"] < 100.1


def test_what_a_target_does_not_tell_has_no_bounds():
    scene = Scene({"force": Param("k", 2.0, "N/m") * y * Param("gain", 3.0)})
    starts = {"k": 1.0, "gain": (1.0, -math.inf, math.inf)}
    for more in ({}, {"gain": (1.0, 0.5, math.inf)}, {"gain": (1.0, 0.5, 20.0)}):
        fit = stimlib.fit(scene, {"y": X}, 6.0 * X + 1e-6 * np.sin(1e3 * T), starts | more, fs=FS)
        _, low, high = (starts | more)["gain"]
        assert fit.intervals == {"k": (0.0, math.inf), "gain": (low, high)}


def test_a_linear_fit_is_that_of_least_squares_with_its_intervals():
    """Where weights leave samples out, of the others."""
    some = T < 0.3
    columns = np.stack([rendered(static, k=1.0, b=0.0), rendered(static, k=0.0, b=1.0)], axis=1)
    noise = 0.05 * np.random.default_rng(4).standard_normal(N)
    target = np.where(some, columns @ [400.0, 5e4] + noise, 77.0)
    fit = stimlib.fit(
        static, {"y": X}, target, {"k": 300.0, "b": 2e4}, fs=FS, weight=np.where(some, 1.0, 0.0)
    )
    best, (rest,) = np.linalg.lstsq(columns[some], target[some])[:2]
    free = np.sum(some & (X != 0)) - 2
    error = np.sqrt(np.diag(np.linalg.inv(columns[some].T @ columns[some])) * rest / free)
    wide = 2 * stats.t.ppf(0.975, free) * error / best
    assert fit.converged and list(fit.params.values()) == pytest.approx(best, rel=1e-6)
    assert fit.loss == pytest.approx(rest / np.sum(target[some] ** 2), rel=1e-9)
    assert [np.diff(np.log(i))[0] for i in fit.intervals.values()] == pytest.approx(wide, rel=0.01)
    lines = str(fit).splitlines()
    assert lines[1].startswith("k  ") and lines[1].endswith("300  N/m")
    assert f"error {math.sqrt(fit.loss):.3g}; {fit.steps} steps, converged" in lines[-1]


def test_several_outputs_by_name_and_functions_of_time():
    two = Scene(
        {
            "f": spring(y, Param("k", 300.0, "N/m")),
            "g": first_order(y, 0.01) * Param("c", 2.0),
            "h": 2 * y,
        }
    )
    motion = {"y": lambda t: 0.01 * np.sin(9 * t)}
    target = stimlib.render(two, motion, FS, 0.4, {"k": 123.0, "c": -0.7})
    fit = stimlib.fit(
        two,
        motion,
        {n: target[n] for n in "fg"},
        {"k": 300.0, "c": (2.0, -math.inf, math.inf)},
        fs=FS,
    )
    assert fit.params == pytest.approx({"k": 123.0, "c": -0.7}, rel=1e-7)
    assert set(fit.signals) == {"f", "g", "h"} and fit.signals["h"].shape == (400,)


def test_a_loss_and_an_optimiser_of_ones_own():
    def largest(signals, target):
        return jnp.max(jnp.abs(signals["force"])) / target - jnp.log(
            jnp.max(jnp.abs(signals["force"]))
        )

    fit = stimlib.fit(
        static,
        {"y": X},
        8.0,
        {"k": 300.0},
        largest,
        fs=FS,
        steps=400,
        optimiser=optax.adam(optax.exponential_decay(0.1, 20, 0.8)),
    )
    assert np.abs(rendered(fit.scene)).max() == pytest.approx(8.0, rel=1e-4)
    assert fit.intervals == {} and "loss -1.08" in str(fit) and fit.converged


# Spectra and levels -------------------------------------------------------------------
@pytest.mark.stress
def test_levels_of_noise_from_a_recording_of_other_noise():
    """16 s hold 61 segments, so ln of a level scatters by about 0.01; differences of
    less than four of that pass.
    """
    recorded = stimlib.render(noisy, {}, FS, 16.0, {"a": 3.0, "p": 0.3}, seed=5).y[0]
    fit = stimlib.fit(
        noisy,
        {},
        recorded,
        {"a": 1.0, "p": 1.0},
        "log_psd",
        fs=FS,
        seconds=16.0,
        band=(15.0, 450.0),
    )
    assert fit.converged and fit.params == pytest.approx({"a": 3.0, "p": 0.3}, rel=0.04)


@pytest.mark.parametrize("low", mostly([2.0, 16.0], [2.0, 15.0, 16.0, 100.0]))
def test_a_psd_in_its_three_forms(low):
    """A signal, its PSD from scipy, and a function, at all bins of the band; at least
    four bins below it.
    """
    n = 2 ** math.ceil(math.log2(4 * FS / low))
    x = stimlib.render(noisy, {}, FS, 20.0).y[0]
    f, P = signal.welch(x, FS, nperseg=n)
    forms = {"signal": x, "pair": (f, P), "function": lambda g: P[np.searchsorted(f, g)]}
    with jax.enable_x64(True):
        wanted = _log_psd(forms, x.size, FS, (low, 450.0)).wanted
    for form in forms:
        assert wanted[form] == pytest.approx(np.log(P[(f >= low) & (f <= 450)]), abs=1e-11), form


def test_bumps_get_the_rms_of_others():
    x = {"x": 0.02 * np.arange(8000) / 8000}
    square = rendered(bumps("square", 18), x, 8000)
    fit = stimlib.fit(bumps("sawtooth", 18), x, square, {"A": 4.0}, "rms", fs=8000)
    assert fit.converged
    assert np.mean(rendered(fit.scene, x, 8000) ** 2) == pytest.approx(
        np.mean(square**2), rel=1e-12
    )
    # sqrt(d)/2 over sqrt(d/12), averaged over the carrier
    assert fit.params["A"] == pytest.approx(4 * math.sqrt(3), rel=0.01)


# What cannot be done ------------------------------------------------------------------
gate = Scene({"y": (y > Param("place", 0.005, "m")) * Param("gain", 2.0)})
pair = Scene({"f": Param("k", 2.0) * y, "g": 2 * y})
WRONG = {
    "there is no parameter 'q'; there are k, b": (static, X, {"q": 1.0}, {}),
    "start of 0": (static, X, {"k": 0.0}, {}),
    "between 0 and 1": (static, X, {"k": (3.0, 0, 1)}, {}),
    "not at an end": (static, X, {"k": (0, 0, 1)}, {}),
    "start or (start, low, high)": (static, X, {"k": (1.0, 2.0)}, {}),
    "must be finite": (static, X, {"k": math.nan}, {}),
    "must map names": (static, X, {}, {}),
    "not finite at sample 3": (static, np.where(np.arange(N) == 3, np.nan, X), {"k": 1.0}, {}),
    "0 throughout": (static, 0 * X, {"k": 1.0}, {}),
    "at least 601 samples": (static, np.ones(601), {"k": 1.0}, {}),
    "the target of force has 600": (static, X, {"k": 1.0}, {"seconds": 0.5}),
    "no output 'f'": (static, {"f": X}, {"k": 1.0}, {}),
    "weight must be 600": (static, X, {"k": 1.0}, {"weight": -X}),
    "weight must be 600 finite numbers from 0 on, not all 0; got <U3": (
        static,
        X,
        {"k": 1.0},
        {"weight": "abc"},
    ),
    "must be one row of real numbers, got complex128 (600,)": (static, X + 0j, {"k": 1.0}, {}),
    "must be one row of real numbers, got object ()": (static, None, {"k": 1.0}, {}),
    "must be one row of real numbers, got float64 (1, 600)": (static, X[None], {"k": 1.0}, {}),
    "seed = 1.5": (static, X, {"k": 1.0}, {"seed": 1.5}),
    "weight belongs to": (static, 1.0, {"k": 1.0}, {"weight": X, "loss": "rms"}),
    "the outputs f, g": (pair, X, {"k": 1.0}, {}),
    "needs band": (static, X, {"k": 1.0}, {"loss": "log_psd"}),
    "must rise within": (static, X, {"k": 1.0}, {"loss": "log_psd", "band": (10, 501)}),
    "too short for 16 segments": (static, X, {"k": 1.0}, {"loss": "log_psd", "band": (10, 400)}),
    "holds no bin": (static, X, {"k": 1.0}, {"loss": "log_psd", "band": (300.1, 300.2)}),
    "must reach over": (
        static,
        (np.array([1.0, 90.0]), np.ones(2)),
        {"k": 1.0},
        {"loss": "log_psd", "band": (80, 400)},
    ),
    "must be finite and above 0 at each": (
        static,
        lambda f: f - 200.0,
        {"k": 1.0},
        {"loss": "log_psd", "band": (80, 400)},
    ),
    "as (f, P)": (static, (np.ones(3),), {"k": 1.0}, {"loss": "log_psd", "band": (80, 400)}),
    "must be above 0, got -1": (static, -1.0, {"k": 1.0}, {"loss": "rms"}),
    "choose one of force, log_psd, rms": (static, X, {"k": 1.0}, {"loss": "psd"}),
    "whole number above 0": (static, X, {"k": 1.0}, {"steps": 0}),
    "tol = 0": (static, X, {"k": 1.0}, {"tol": 0}),
    "optax.GradientTransformation": (static, X, {"k": 1.0}, {"optimiser": "adam"}),
    "place: no effect on the loss at the start": (gate, X, {"gain": 1.0, "place": 0.004}, {}),
    "the loss must be one number, got an array (600,)": (
        static,
        X,
        {"k": 1.0},
        {"loss": lambda s, t: s["force"]},
    ),
    "loss must be a finite number, it is nan": (
        static,
        X,
        {"k": 1.0},
        {"loss": lambda s, t: jnp.log(-(s["force"][1] ** 2))},
    ),
    "the derivative by k is not finite at the start, k = 1": (
        static,
        X,
        {"k": 1.0},
        {"loss": lambda s, t: jnp.abs(s["force"][0] * 0.0) ** 0.5},
    ),
}


@pytest.mark.parametrize("says", WRONG)
def test_what_is_wrong_is_said(says):
    scene, target, params, options = WRONG[says]
    given = stimlib.fit, scene, {"y": X}, target, params
    assert says in str(refused((BadValue, UnknownName), None, *given, fs=FS, **options))


def test_a_gate_has_an_effect_with_a_surrogate():
    target = rendered(gate, place=0.006)
    fit = stimlib.fit(
        gate,
        {"y": X},
        target,
        {"place": 0.004},
        fs=FS,
        surrogate=0.05,
        optimiser=optax.adam(0.05),
        steps=60,
    )
    assert fit.loss < fit.history[0] / 10


def test_a_start_at_the_truth_stays_there():
    target = np.asarray(stimlib.compile(static, FS, target="jax")({"k": 300.0}, {"y": X})["force"])
    fit = stimlib.fit(static, {"y": X}, target, {"k": 300.0}, fs=FS)
    assert fit.converged and fit.steps <= 1 and fit.loss < 1e-28
    assert fit.params == pytest.approx({"k": 300.0}, rel=1e-13)


@pytest.mark.parametrize(("k", "rate"), [(800.0, 1e6), (800.0, -1e6), (10.0, 1e6)])
def test_a_search_that_left_its_valley_has_not_converged(k, rate):
    """The first step goes where no number has an effect any more: to a greater loss, or
    to one only less than at the start.
    """
    fit = stimlib.fit(
        static,
        {"y": X},
        rendered(static, k=k),
        {"k": 300.0},
        fs=FS,
        steps=20,
        optimiser=optax.sgd(rate),
    )
    assert fit.loss > 0.1 and fit.loss == fit.history.min() and not fit.converged


def test_too_few_steps_are_not_called_converged():
    """And without bounds a number may go far, 300 times its start, and past 0."""
    start = {"k": (1.0, -math.inf, math.inf), "b": (-0.01, -math.inf, math.inf)}
    target = rendered(static, k=-4e4, b=3e5)
    for steps, converged in ((2, False), (100, True)):
        fit = stimlib.fit(static, {"y": X}, target, start, fs=FS, steps=steps)
        said = "converged" if converged else "not converged"
        assert fit.converged is converged and fit.steps <= steps and str(fit).endswith(f", {said}")
        assert repr(fit).endswith("not converged)") is not converged
    assert fit.params == pytest.approx({"k": -4e4, "b": 3e5}, rel=1e-6)
