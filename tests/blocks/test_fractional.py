"""The springpot against the full sum over its history, the continuous derivative, and
its own certificate.

The grid over an hour is long: STIMLIB_LONG=1 runs all of it.
"""

import math
import os
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from laws import assert_same, lawful, mostly, played, raw, rows
from scipy.special import rgamma

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib.blocks import equal_force, springpot, springpot_stiffness
from stimlib.blocks.fractional import Springpot
from stimlib.checks.laws import springpot_sum
from stimlib.errors import BadValue, SceneError, UnitError

LONG = bool(os.environ.get("STIMLIB_LONG"))
LD = np.longdouble
extended = pytest.mark.skipif(
    np.finfo(LD).nmant < 63, reason="needs a long double of more than 53 bits"
)
Y, A, C, G = Input("y", "m"), Input("a"), Input("c"), Input("g")
TOLS = [1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14]
ALPHAS = [0.0, 1e-6, 0.05, 0.25, 0.5, 0.75, 0.95, 1 - 1e-6, 1.0]


# References ---------------------------------------------------------------------------
def full(x, alpha, fs, at=None, scheme="gl", onset="steady", path=False):
    """h^-alpha sum_j v_j d[n-j] at these samples, the whole history, by the law of
    ``checks``; with |d| where ``path``.
    """
    return _full(
        np.asarray(x, float).tobytes(),
        alpha,
        fs,
        tuple(range(len(x)) if at is None else at),
        scheme,
        onset,
    )[path]


@cache  # the same for every tolerance
def _full(x, alpha, fs, at, scheme, onset):
    before = int(onset == "step")
    x = np.r_[np.zeros(before), np.frombuffer(x)]
    return springpot_sum(x, fs, scheme, np.full(x.size, float(alpha)), np.array(at) + before)


def moved(kind, n, fs, seed=7):
    """The inputs of the issue, in m."""
    t, rng = np.arange(n) / fs, np.random.default_rng(seed)
    return {
        "sinusoid": lambda: 0.01 * np.sin(2 * np.pi * t),
        "ramp": lambda: 0.02 * np.minimum(t, 0.5),
        "smooth": lambda: sum(
            0.003 * rng.normal() * np.sin(2 * np.pi * rng.uniform(0.2, 5) * t + rng.uniform(0, 6))
            for _ in range(8)
        ),
        "quantised": lambda: np.round(0.01 * np.sin(2 * np.pi * t) / 1e-6) * 1e-6,
        "counts": lambda: 2.0**-20 * np.arange(n),  # every difference has the same bits
        "step": lambda: np.where(t > 3 / fs, 0.01, 0.0),
    }[kind]()


KINDS = ["sinusoid", "ramp", "smooth", "quantised"]


def proc_of(alpha, fs, target="numba", **kw):
    """Force and bound; a live order where ``alpha`` is None."""
    force, bound = springpot(Y, 1.0, A if alpha is None else alpha, certificate=True, **kw)
    return stimlib.compile(Scene({"f": force, "bound": bound}), fs, target)


def forces(proc, x, alpha=None, **more):
    """(force, bound) of a movement and, perhaps, a live order."""
    given = {"y": x, **more}
    if alpha is not None:
        given["a"] = np.broadcast_to(np.asarray(alpha, float), x.shape)
    proc.reset()
    return proc.process(np.ascontiguousarray([given[n] for n in proc.inputs]))


def spots(n, many):
    return sorted({int(k) for k in np.geomspace(1, n - 1, many)} | {0, 1, 2, 7, 8, 9, 63, 64, 65})


def check_full(proc, x, alpha, fs, tol, at=None, scheme="gl", onset="steady", largest=None):
    """Error within the bound, the bound within tol; what part of the bound was used."""
    at = range(x.size) if at is None else at
    f, bound = forces(proc, x, alpha if "a" in proc.inputs else None)
    error = np.abs(f[at] - full(x, alpha, fs, at, scheme, onset)).astype(float)
    most = full(x, alpha, fs, at, scheme, onset, path=True).astype(float)
    assert np.all(error <= bound[at]), f"error {error.max()} beyond the certificate"
    assert np.all(bound[at] <= tol * most)
    if largest is not None:
        assert error.max() <= largest * np.abs(f).max()
    moving = most > 0
    return np.max(error[moving] / bound[at][moving], initial=0.0)


# 1: the full sum, tol and the certificate ---------------------------------------------
@extended
@pytest.mark.parametrize("scheme", ["gl", "l1"])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_every_sample_is_within_the_certificate_for_every_tol(alpha, scheme):
    fs, n = 1000.0, 500
    for tol in TOLS:
        for live in (False, True) if tol in (TOLS[0], TOLS[-1]) else (False,):
            proc = proc_of(None if live else alpha, fs, tol=tol, scheme=scheme)
            for kind in (*KINDS, "counts", "step"):
                check_full(proc, moved(kind, n, fs), alpha, fs, tol, scheme=scheme)
            check_full(
                proc,
                5.0 + np.random.default_rng(1).standard_normal(n),
                alpha,
                fs,
                tol,
                scheme=scheme,
            )


@extended
@pytest.mark.parametrize(
    "fs_alpha",
    mostly(
        {(1000.0, a) for a in ALPHAS} | {(8000.0, 0.5), (8000.0, 0.95)},
        [*product([1000.0, 8000.0], ALPHAS)],
    ),
    ids="{0[0]}-{0[1]}".format,
)
def test_a_minute_to_the_last_digits(fs_alpha):
    fs, alpha = fs_alpha
    n = int(60 * fs)
    proc, live = proc_of(alpha, fs, tol=1e-14), proc_of(None, fs, tol=1e-14)
    for kind in KINDS if LONG or fs == 1000 else ["ramp", "quantised"]:
        check_full(proc, moved(kind, n, fs), alpha, fs, 1e-14, spots(n, 25), largest=1e-13)
    check_full(live, moved("sinusoid", n, fs), alpha, fs, 1e-14, spots(n, 12), largest=1e-13)


HOURS = (
    [(fs, a, k) for fs in (1000.0, 8000.0) for a in ALPHAS for k in KINDS]
    if LONG
    else [(1000.0, 0.05, "ramp"), pytest.param(1000.0, 0.5, "sinusoid", marks=pytest.mark.stress)]
)


@extended
@pytest.mark.parametrize(("fs", "alpha", "kind"), HOURS)
def test_an_hour_to_the_last_digits(fs, alpha, kind):
    n = int(3600 * fs)
    check_full(
        proc_of(alpha, fs, tol=1e-14),
        moved(kind, n, fs),
        alpha,
        fs,
        1e-14,
        spots(n, 12),
        largest=1e-12,
    )
    _full.cache_clear()


@extended
@pytest.mark.parametrize("tol", [t for t in TOLS if t >= 1e-12])
@pytest.mark.parametrize("alpha", [0.05, 0.25, 0.5, 0.75, 0.95])
def test_the_certificate_is_tight_for_what_moves_one_way(alpha, tol):
    fs, n = 1000.0, 20_000
    proc = proc_of(alpha, fs, tol=tol)
    at = sorted({*range(0, 300), *spots(n, 150)})
    assert check_full(proc, moved("step", n, fs), alpha, fs, tol, at) >= 0.1


@extended
@settings(max_examples=25)
@given(
    st.floats(0, 1),
    st.sampled_from(TOLS),
    st.sampled_from(["gl", "l1"]),
    st.sampled_from(["steady", "step"]),
    st.integers(0, 99),
    st.sampled_from([1.0, 1e-9, 1e6]),
)
def test_any_movement_is_within_the_certificate(alpha, tol, scheme, onset, seed, size):
    rng = np.random.default_rng(seed)
    x = size * np.cumsum(
        rng.standard_normal(150) * (rng.random(150) < rng.choice([0.05, 0.5, 1.0]))
    ) + rng.choice([0.0, size])
    check_full(
        proc_of(None, 500.0, tol=tol, scheme=scheme, onset=onset),
        x,
        alpha,
        500.0,
        tol,
        scheme=scheme,
        onset=onset,
    )
    _full.cache_clear()


@extended
def test_beyond_the_horizon_the_error_grows_slowly():
    fs, alpha, n = 1000.0, 0.3, 64_000
    proc = proc_of(alpha, fs, tol=1e-8, horizon=1.0)
    x, at = moved("ramp", n, fs), [1000, 2000, 4000, 16_000, 63_999]
    error = np.abs(forces(proc, x)[0][at] / full(x, alpha, fs, at).astype(float) - 1)
    assert np.all(error <= [1e-8, 1e-8, 1e-6, 1e-3, 0.5]), error
    assert error[-1] > 1e-8, "the example does not tell"


def test_all_rates_and_horizons_compile():
    for fs in (1.0, 44_100.0, 1e6):
        for horizon in (1e-9, 1.0, 1e9):
            f = stimlib.compile(Scene({"f": springpot(Y, 1.0, 0.5, horizon=horizon)}), fs).process(
                np.array([[0.0, 1.0, 1.0]])
            )
            np.testing.assert_allclose(f[0], np.array([0, 1, 0.5]) * fs**0.5, rtol=1e-15)


def test_the_longest_horizon_is_the_longest_run():
    with pytest.raises(BadValue, match="longer than any run"):
        stimlib.compile(
            Scene({"f": springpot(Y, 1.0, 0.5, horizon=np.nextafter(2.0**62, np.inf))}),
            1.0,
            "python",
        )
    stimlib.compile(Scene({"f": springpot(Y, 1.0, 0.5, horizon=2.0**62)}), 1.0, "python")


# The continuous derivative ------------------------------------------------------------
def of_ramp(t, alpha, speed, until):
    """D^alpha of a ramp that stops."""
    return speed * rgamma(2 - alpha) * (t ** (1 - alpha) - np.maximum(t - until, 0) ** (1 - alpha))


def of_sine(t, alpha, w):
    """D^alpha sin(w t) for t > 0, at rest before: the steady state less the integral
    along the branch cut.
    """
    h = 0.15
    u = np.arange(-40, 14, h)
    cut = h * np.exp((1 + alpha) * u) / (1 + np.exp(2 * u)) * w**alpha
    past = np.exp(-np.outer(t, w * np.exp(u))) @ cut
    return w**alpha * np.sin(w * t + alpha * np.pi / 2) - np.sin(np.pi * alpha) / np.pi * past


@pytest.mark.parametrize("alpha", [0.05, 0.25, 0.5, 0.75, 0.95])
@pytest.mark.parametrize("fs", [1000.0, 8000.0])
def test_l1_is_exact_for_straight_lines(alpha, fs):
    t = np.arange(int(10 * fs)) / fs
    f = forces(proc_of(alpha, fs, scheme="l1", tol=1e-14), np.minimum(t, 0.5) * 2.0)[0]
    wanted = of_ramp(t, alpha, 2.0, 0.5)
    assert np.abs(f - wanted).max() <= 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize(("scheme", "order"), [("gl", 1.0), ("l1", 1.5)])
def test_a_sinusoid_converges_to_its_derivative_with_the_order_of_its_scheme(scheme, order):
    """Halving the step divides the error by 2^order; of l1, 1.5e-4 of the maximum is
    left at 1 kHz.
    """
    errors = []
    for fs in (1000.0, 2000.0, 4000.0):
        t = np.arange(int(2 * fs)) / fs
        f = forces(proc_of(0.5, fs, scheme=scheme), np.sin(2 * np.pi * t))[0]
        late = t > (0.5 if scheme == "gl" else 0.0)
        wanted = of_sine(t[late], 0.5, 2 * np.pi)
        errors.append(np.abs(f[late] - wanted).max() / np.abs(wanted).max())
    assert scheme == "gl" or errors[0] <= 1.5e-4
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2**order, rtol=0.05)


# 2: ends ------------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", ["gl", "l1"])
@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("chi", [1.0, 317.3])
def test_spring_and_dashpot_are_exact(scheme, live, chi):
    fs, n = 1000.0, 3000
    x = 0.3 + moved("smooth", n, fs)
    for onset, before in (("steady", x[0]), ("step", 0.0)):
        for alpha, wanted in (
            (0.0, chi * (x - before)),
            (1.0, chi * (np.diff(x, prepend=before) * fs)),
        ):
            block = springpot(Y, chi, A if live else alpha, scheme=scheme, onset=onset)
            f = forces(stimlib.compile(Scene({"f": block}), fs), x, alpha if live else None)[0]
            assert_same(f, wanted, f"{scheme} {onset} {alpha}")


# Parameters ---------------------------------------------------------------------------
@extended
@pytest.mark.parametrize("scheme", ["gl", "l1"])
@pytest.mark.parametrize("tol", [1e-8, 1e-14])
def test_a_live_order_is_the_full_sum_with_the_new_order(scheme, tol):
    fs, n = 1000.0, 1500
    x = moved("smooth", n, fs)
    alpha = np.r_[
        np.full(400, 0.2),
        np.linspace(0.2, 1.0, 300),
        np.full(100, 1.0),
        np.full(200, 0.7),
        np.linspace(0.7, 0.0, 500),
    ]
    f, bound = forces(proc_of(None, fs, tol=tol, scheme=scheme), x, alpha)
    at = [*range(0, n, 37), 399, 400, 401, 699, 700, 799, 800, 801, 999, 1000, 1499]
    wanted = np.array([full(x, alpha[k], fs, [k], scheme)[0] for k in at])
    most = np.array([full(x, alpha[k], fs, [k], scheme, path=True)[0] for k in at]).astype(float)
    error = np.abs(f[at] - wanted).astype(float)
    assert np.all(error <= bound[at]) and np.all(bound[at] <= tol * most)
    _full.cache_clear()


@pytest.mark.parametrize("scheme", ["gl", "l1"])
def test_live_weights_are_right_to_a_few_roundings(scheme):
    from stimlib.blocks.fractional import SpringpotLive, reweigh
    from stimlib.design import fractional as soe

    p, s = SpringpotLive(Y, A, constant(1.0), scheme, 1e-14, 86400.0, "steady").design(8000.0)
    rates, w = soe.rates(1e-14, 86400.0 * 8000), np.zeros(100)
    for alpha in ALPHAS[1:-1]:
        wanted = soe.weights(rates, scheme, alpha)
        reweigh(p, np.array([alpha]), s.r, s.taps, w)
        low = len(rates.x) - 1
        np.testing.assert_allclose(s.r[low : wanted.modes.size], wanted.modes[low:], rtol=1.2e-15)
        np.testing.assert_allclose(s.taps[::-1], wanted.taps, rtol=2e-15)
        assert not s.r[wanted.modes.size :].any()
        assert w[16] == pytest.approx(8000.0**alpha, rel=4e-16)


@pytest.mark.parametrize("target", ["numba", "python"])
@pytest.mark.parametrize(
    ("chi", "alpha"),
    [
        (1.0, -1e-9),
        (1.0, 1 + 1e-9),
        (1.0, np.nan),
        (-1e-9, 0.5),
        (np.nan, 0.5),
        (1.0, np.inf),
        (-np.inf, 0.5),
    ],
)
def test_a_live_number_out_of_range_is_a_fault(target, chi, alpha):
    n, at = 60, 20
    scene = Scene({"f": springpot(Y, G, A)})
    proc = stimlib.compile(scene, 1000, target)
    g, a, x = np.full(n, 1.0), np.full(n, 0.5), np.linspace(0, 1, n)
    g[at], a[at] = chi, alpha
    f = proc.process(rows(proc, np.stack([x, g, a]), ["y", "g", "a"]))[0]
    assert proc.fault == ("f", at)
    assert np.isfinite(f).all() and not f[45:].any()
    before = raw(scene, 1000, np.stack([x, g, a]), ["y", "g", "a"])[0]
    assert np.isnan(before[at]) and np.isfinite(np.delete(before, at)).all(), (
        "the history is not hurt"
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("scheme", ["gl", "l1", "gl-downsampled", "gl-short-memory"])
def test_a_position_that_is_not_finite_is_forgotten_when_contact_is_made_anew(scheme, bad):
    x, c = np.linspace(0, 0.1, 120), np.ones(120)
    x[30], c[50:60] = bad, 0.0
    scene = Scene({"f": springpot(Y, 1.0, 0.5, scheme=scheme, contact=C, horizon=1.0)})
    before = raw(scene, 1000, np.stack([x, c]), ["y", "c"])[0]
    assert (
        not np.isfinite(before[30])
        and np.isfinite(before[:30]).all()
        and np.isfinite(before[50:]).all()
    )


@pytest.mark.parametrize("scheme", ["gl", "l1", "gl-downsampled", "gl-short-memory"])
def test_a_step_onset_is_for_the_first_contact(scheme):
    x, c = np.full(40, 0.01), np.r_[np.ones(20), np.zeros(5), np.ones(15)]
    f = played(
        springpot(Y, 1.0, 0.5, scheme=scheme, onset="step", contact=C, horizon=1.0),
        {"y": x, "c": c},
    )
    assert f[0] == pytest.approx(0.01 * 1000**0.5 / (math.gamma(1.5) if scheme == "l1" else 1))
    assert np.all(f[1:20] > 0) and not f[20:].any()


# The thesis' methods ------------------------------------------------------------------
METHODS = [
    (1000.0, {"scheme": "gl-downsampled", "horizon": 2.0}),
    (1000.0, {"scheme": "gl-short-memory"}),
    (1000.0, {"scheme": "gl-short-memory", "memory": 0.03}),
    (8000.0, {"scheme": "gl-short-memory"}),
]


@pytest.mark.parametrize(("fs", "words"), METHODS)
@pytest.mark.parametrize("alpha", [0.0, 0.5, 0.9, 1.0])
def test_the_thesis_methods_are_as_the_thesis_says(alpha, fs, words):
    lawful(springpot(Y, 2.0, alpha, **words), fs, y=0.1 + moved("smooth", 1234, fs))


@pytest.mark.parametrize(("words", "first"), [
    ({"scheme": "gl-downsampled", "horizon": 3.0}, 100), ({"scheme": "gl-short-memory"}, 100),
    ({"scheme": "gl-short-memory", "memory": 0.03}, 30),
])  # fmt: skip
def test_the_thesis_methods_are_the_full_sum_at_first_and_then_are_not(words, first):
    x = moved("sinusoid", 3000, 1000.0)
    wanted = 2.0 * forces(proc_of(0.5, 1000.0, tol=1e-14), x)[0]
    f = forces(stimlib.compile(Scene({"f": springpot(Y, 2.0, 0.5, **words)}), 1000), x)[0]
    error = np.abs(f - wanted) / np.abs(wanted).max()
    assert error[:first].max() < 1e-13 < 1e-6 < error[first + 2] and error.max() > 0.02


def test_the_history_of_downsampled_ends_in_a_fault():
    proc = stimlib.compile(
        Scene({"f": springpot(Y, 1.0, 0.5, scheme="gl-downsampled", horizon=0.1)}), 1000
    )
    proc.process(np.linspace(0, 1, 150)[None])
    assert proc.fault == ("f", 100)


# 4: responses -------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", ["gl", "l1"])
@pytest.mark.parametrize("alpha", [0.0, 0.05, 0.3, 0.5, 0.8, 1.0])
def test_the_response_is_the_physics(scheme, alpha):
    """chi (i w)^alpha at low frequencies; at all frequencies the generating function of
    the scheme.
    """
    fs, chi = 8000.0, 40.0
    proc = stimlib.compile(
        Scene({"f": springpot(Y, Param("chi", chi), alpha, scheme=scheme)}), fs, "python"
    )
    f = np.geomspace(0.01, 4.0, 60)
    k = springpot_stiffness(chi, alpha, 2 * np.pi * f)
    H = proc.response("f", "y", f)
    np.testing.assert_allclose(H, k.complex, rtol=np.pi * 4.0 / fs + 1e-4)
    np.testing.assert_allclose(np.angle(H), k.phase, atol=2e-3)
    if scheme == "gl":
        f = np.geomspace(0.01, fs / 2, 100)
        np.testing.assert_allclose(
            proc.response("f", "y", f),
            chi * (fs * (1 - np.exp(-2j * np.pi * f / fs))) ** alpha,
            rtol=1e-8,
        )


def test_a_live_order_has_no_response():
    with pytest.raises(SceneError, match="not linear and time-invariant"):
        stimlib.compile(Scene({"f": springpot(Y, 1.0, A)}), 1000, "python").response(
            "f", "y", np.array([1.0])
        )


def test_stiffness():
    w = np.array([0.0, 0.5, 2 * np.pi, 1000.0])
    for alpha in (0.0, 0.2, 0.5, 0.93, 1.0):
        k = springpot_stiffness(300.0, alpha, w)
        np.testing.assert_allclose(k.complex[1:], 300.0 * (1j * w[1:]) ** alpha, rtol=1e-13)
        np.testing.assert_allclose(
            [k.storage, k.loss], [k.complex.real, k.complex.imag], rtol=1e-15
        )
        np.testing.assert_allclose(k.magnitude, np.abs(k.complex), rtol=1e-13)
        np.testing.assert_array_equal(k.phase, alpha * np.pi / 2)
    assert (
        springpot_stiffness(3.0, 0.0, 5.0).loss == 0.0
        and springpot_stiffness(3.0, 1.0, 5.0).storage == 0.0
    )


def test_equal_force():
    """Eqs. (3.2), (4.1): the same magnitude at w = 2 pi."""
    for a1, a2 in ((0.0, 0.5), (0.25, 0.35), (1.0, 0.0)):
        chi2 = equal_force(300.0, a1, a2)
        one, other = (
            springpot_stiffness(300.0, a1, 2 * np.pi),
            springpot_stiffness(chi2, a2, 2 * np.pi),
        )
        assert one.magnitude == pytest.approx(other.magnitude, rel=1e-14)
    assert equal_force(300.0, 0.0, 0.75) == pytest.approx(300 / (2 * np.pi) ** 0.75, rel=1e-15)
    assert equal_force(300.0, 0.2, 0.7, w=1.0) == 300.0


# Files, units, errors -----------------------------------------------------------------
def test_units_and_sizes():
    proc = stimlib.compile(
        Scene({"f": springpot(Y, 1.0, 0.5), "n": springpot(Input("n"), 1.0, A)}), 8000
    )
    assert proc.units["f"] == "N" and proc.units["n"] == "1"
    for fs in (1000.0, 8000.0):
        assert stimlib.compile(Scene({"f": springpot(Y, 1.0, 0.5)}), fs).state.size * 8 <= 1024
    assert "0.5" in repr(Springpot(Y, constant(1.0), 0.5, "gl", 1e-10, 60.0, "steady"))


@pytest.mark.parametrize(
    ("make", "error", "match"),
    [
        (lambda: springpot(Y, 1.0, -0.1), BadValue, "alpha = -0.1"),
        (lambda: springpot(Y, 1.0, 1.1), BadValue, "from 0"),
        (lambda: springpot(Y, 1.0, math.nan), BadValue, "finite"),
        (lambda: springpot(Y, -1.0, 0.5), BadValue, "chi = -1"),
        (lambda: springpot(Y, 1.0, 0.5, tol=1e-15), BadValue, "tol=1e-14"),
        (lambda: springpot(Y, 1.0, A, tol=0.3), BadValue, "tol=0.1"),
        (lambda: springpot(Y, 1.0, 0.5, horizon=0.0), BadValue, "horizon"),
        (
            lambda: springpot(Y, 1.0, 0.5, scheme="bdf2"),
            BadValue,
            "gl, l1, gl-downsampled, gl-short-memory",
        ),
        (lambda: springpot(Y, 1.0, 0.5, onset="soft"), BadValue, "steady, step"),
        (lambda: springpot(Y, 1.0, A, scheme="gl-downsampled"), BadValue, "plain number"),
        (
            lambda: springpot(Y, 1.0, 0.5, scheme="gl-short-memory", certificate=True),
            BadValue,
            "no bound",
        ),
        (lambda: springpot(Y, 1.0, 0.5, tol=Param("tol", 1e-9)), BadValue, "design number"),
        (lambda: springpot(Input("f", "N"), 1.0, 0.5), UnitError, "not in m"),
        (lambda: springpot(Y, Param("chi", 1.0, "N/m"), 0.5), UnitError, "plain number"),
        (lambda: springpot(Y, 1.0, Input("s", "m")), UnitError, "without unit"),
        (
            lambda: stimlib.compile(
                Scene({"f": springpot(Y, 1.0, 0.5, scheme="gl-downsampled")}), 1000
            ),
            BadValue,
            "horizon",
        ),
        (lambda: springpot_stiffness(1.0, 1.5, 1.0), BadValue, "alpha"),
        (lambda: springpot_stiffness(-1.0, 0.5, 1.0), BadValue, "chi"),
        (lambda: springpot_stiffness(1.0, 0.5, [-1.0]), BadValue, "w must"),
        (lambda: equal_force(1.0, 0.5, 0.2, w=0.0), BadValue, "w = 0"),
        (lambda: equal_force(1.0, 0.5, -0.2), BadValue, "alpha2"),
    ],
)
def test_bad_values_are_named(make, error, match):
    with pytest.raises(error, match=match):
        make()


@extended
@pytest.mark.parametrize("alpha", [0.5, 0.95])
def test_the_second_words_are_needed(alpha, monkeypatch):
    """A sum that leaks with the rate s and has one word stalls 2^-53/s below its value:
    a long way at equal steps shows it.
    """
    from stimlib.design import fractional as soe

    fs, n = 1000.0, 1_000_000
    x, at = moved("counts", n, fs), [n // 2, n - 1]
    wanted = full(x, alpha, fs, at)
    usual = soe.rates
    errors = []
    for f in (usual, lambda *given: usual(*given)._replace(fine=0)):
        monkeypatch.setattr(soe, "rates", f)
        proc = stimlib.compile(Scene({"f": springpot(Y, 1.0, alpha, tol=1e-14)}), fs)
        errors.append(np.max(np.abs(forces(proc, x)[0][at] / wanted - 1)))
    assert errors[0] < 1e-15 and errors[1] > 2e-14
    _full.cache_clear()


def test_a_ramp_of_the_order_is_the_same_in_any_pieces():
    """Weights are made for 16 samples at once. Orders that stay, that move, 0, 1, a
    jump and a way back within one tile.
    """
    n, fs = 330, 1000.0
    x, rng = moved("smooth", n, fs), np.random.default_rng(3)
    alpha = np.concatenate(
        [
            *(np.linspace(0, 1, 90), np.full(50, 1.0), [0.4, 0.5, 0.6], np.full(27, 0.4)),
            *(rng.random(90), np.full(70, 0.4)),
        ]
    )
    scene = Scene({"f": springpot(Y, 1.0, A, tol=1e-14)})
    made = []
    for target, cut in (("numba", 1), ("numba", 7), ("numba", 37), ("numba", n), ("python", n)):
        proc = stimlib.compile(scene, fs, target)
        both = np.array([{"y": x, "a": alpha}[name] for name in proc.inputs])
        pieces = [both[:, i : i + cut].copy() for i in range(0, n, cut)]
        made.append(np.concatenate([proc.process(p)[0] for p in pieces]))
    for f in made[1:]:
        assert_same(f, made[0])
    fixed = stimlib.compile(Scene({"f": springpot(Y, 1.0, 0.4, tol=1e-14)}), fs).process(x[None])
    np.testing.assert_allclose(made[0][260:], fixed[0][260:], rtol=1e-12)


def test_response_with_a_live_order_is_that_of_the_order_it_has():
    y = stimlib.Input("y", "m")
    f = np.array([0.5, 5.0, 50.0])
    live = stimlib.compile(
        stimlib.Scene({"f": springpot(y, 25.0, stimlib.Param("alpha", 0.3))}), 1000
    )
    for alpha in (0.3, 0.8):
        live.set("alpha", alpha, ramp=0.0)
        fixed = stimlib.compile(stimlib.Scene({"f": springpot(y, 25.0, alpha)}), 1000)
        np.testing.assert_array_equal(live.response("f", "y", f), fixed.response("f", "y", f))
