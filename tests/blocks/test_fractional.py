"""The springpot against the full sum over its history, the continuous derivative, and
its own certificate.
"""

import math
import re
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from laws import assert_same, compiled, lawful, mostly, played, raw, refuses, rows
from scipy.special import rgamma

import stimlib
from stimlib import BadValue, Input, Param, Scene, SceneError, UnitError, constant
from stimlib.blocks import equal_force, springpot, springpot_stiffness
from stimlib.blocks.springpots import SpringpotLive, reweigh
from stimlib.checks.laws import springpot_convolution, springpot_sum
from stimlib.design import fractional as soe

ROOT = Path(__file__).parents[2]
extended = pytest.mark.skipif(
    np.finfo(np.longdouble).nmant < 63, reason="needs a long double of more than 53 bits"
)
Y, A, C, G = Input("y", "m"), Input("a"), Input("c"), Input("g")
TOLS = [1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14]
ALPHAS = [0.0, 1e-6, 0.05, 0.25, 0.5, 0.75, 0.95, 1 - 1e-6, 1.0]


# References ---------------------------------------------------------------------------
def full(x, alpha, fs, at=None, scheme="gl", onset="steady", path=False):
    """h^-alpha sum_j v_j d[n-j] at these samples, the whole history, by the law of
    ``checks``; with |d| where ``path``.
    """
    at = tuple(range(len(x)) if at is None else at)
    return _full(np.asarray(x, float).tobytes(), alpha, fs, at, scheme, onset)[path]


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


def proc_of(alpha, fs, target="llvm", **kw):
    """Force and bound, of "gl" like ``full``; a live order where ``alpha`` is None."""
    kw = {"scheme": "gl"} | kw
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
    at, given = range(x.size) if at is None else at, (alpha, fs, at, scheme, onset)
    f, bound = forces(proc, x, alpha if "a" in proc.inputs else None)
    error = np.abs(f[at] - full(x, *given)).astype(float)
    most = full(x, *given, path=True).astype(float)
    assert np.all(error <= bound[at]), f"error {error.max()} beyond the certificate"
    assert np.all(bound[at] <= tol * most)
    assert largest is None or error.max() <= largest * np.abs(f).max()
    moving = most > 0
    return np.max(error[moving] / bound[at][moving], initial=0.0)


# 1: the full sum, tol and the certificate ---------------------------------------------
@extended
@pytest.mark.parametrize("scheme", ["gl", "l1"])
@pytest.mark.parametrize("alpha", mostly({0.0, 0.05, 0.5, 1 - 1e-6, 1.0}, ALPHAS))
def test_every_sample_is_within_the_certificate_for_every_tol(alpha, scheme):
    fs, n = 1000.0, 300
    other = 5.0 + np.random.default_rng(1).standard_normal(n)
    for tol, live in [*product(TOLS, [False]), (TOLS[0], True), (TOLS[-1], True)]:
        proc = proc_of(None if live else alpha, fs, tol=tol, scheme=scheme)
        for x in (other, *(moved(kind, n, fs) for kind in (*KINDS, "counts", "step"))):
            check_full(proc, x, alpha, fs, tol, scheme=scheme)


SOME = [  # seconds, sample rate, order, movement
    *((60, 1000.0, a, kind) for a, kind in zip(ALPHAS[::2], [*KINDS, "ramp"], strict=True)),
    (60, 8000.0, 0.95, "quantised"),
]
GRID = [*product([60], [1000.0, 8000.0], ALPHAS, KINDS), (3600, 1000.0, 0.05, "ramp")]


@extended
@pytest.mark.parametrize("given", mostly(SOME, GRID), ids=str)
def test_a_minute_and_an_hour_to_the_last_digits(given):
    seconds, fs, alpha, kind = given
    n = int(seconds * fs)
    x, largest = moved(kind, n, fs), 1e-13 if seconds == 60 else 1e-12
    for order in (alpha, None) if seconds == 60 else (alpha,):
        proc = proc_of(order, fs, tol=1e-14)
        check_full(proc, x, alpha, fs, 1e-14, spots(n, 12), largest=largest)
    _full.cache_clear()


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
    x, at = moved("ramp", n, fs), [1000, 2000, 4000, 16_000, 63_999]
    f = forces(proc_of(alpha, fs, tol=1e-8, horizon=1.0), x)[0][at]
    error = np.abs(f / full(x, alpha, fs, at).astype(float) - 1)
    assert np.all(error <= [1e-8, 1e-8, 1e-6, 1e-3, 0.5]) and error[-1] > 1e-8, error


@pytest.mark.parametrize("fs", [1.0, 44_100.0, 1e6])
@pytest.mark.parametrize("horizon", [1e-9, 1.0, 1e9])
def test_all_rates_and_horizons_compile(fs, horizon):
    f = played(springpot(Y, 1.0, 0.5, "gl", horizon=horizon), [0.0, 1.0, 1.0], fs=fs)
    np.testing.assert_allclose(f, np.array([0, 1, 0.5]) * fs**0.5, rtol=1e-15)
    assert compiled(springpot(Y, 1.0, 0.5, horizon=2.0**62), 1.0), "the longest run"


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


@pytest.mark.parametrize("alpha", [0.05, 0.5, 0.95])
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
        late = t > (0.5 if scheme == "gl" else 0.0)
        f = forces(proc_of(0.5, fs, scheme=scheme), np.sin(2 * np.pi * t))[0][late]
        wanted = of_sine(t[late], 0.5, 2 * np.pi)
        errors.append(np.abs(f - wanted).max() / np.abs(wanted).max())
    assert scheme == "gl" or errors[0] <= 1.5e-4
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2**order, rtol=0.05)


def test_the_errors_that_every_page_prints():
    """Of both schemes, to two digits, against "l1" on a grid 64 times as fine."""
    text = (ROOT / "docs" / "reference" / "blocks" / "springpot_schemes.inc").read_text("utf-8")
    printed = [float(v) for v in re.findall(r"([\d.]+) %", text)]
    y, found = 1 - np.cos(10 * np.pi * (np.arange(64 * 1600) / 64_000)), []
    for alpha in (0.25, 0.5, 0.75):
        wanted = springpot_convolution(y, 64_000.0, "l1", alpha)[0][::64]
        for scheme in ("l1", "gl"):
            f = forces(proc_of(alpha, 1000.0, scheme=scheme), y[::64])[0]
            found.append(100 * np.abs(f - wanted).max() / np.abs(wanted).max())
    np.testing.assert_allclose(found, printed, rtol=0.06)


# 2: ends ------------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", ["gl", "l1"])
@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("chi", [1.0, 317.3])
def test_spring_and_dashpot_are_exact(scheme, live, chi):
    x = 0.3 + moved("smooth", 3000, 1000.0)
    for onset, before in (("steady", x[0]), ("step", 0.0)):
        for alpha, wanted in {0.0: x - before, 1.0: np.diff(x, prepend=before) * 1000.0}.items():
            block = springpot(Y, chi, A if live else alpha, scheme=scheme, onset=onset)
            proc = stimlib.compile(Scene({"f": block}), 1000)
            assert_same(forces(proc, x, alpha if live else None)[0], chi * wanted, onset)


# Parameters ---------------------------------------------------------------------------
@extended
@pytest.mark.parametrize("scheme", ["gl", "l1"])
@pytest.mark.parametrize("tol", [1e-8, 1e-14])
def test_a_live_order_is_the_full_sum_with_the_new_order(scheme, tol):
    fs, way = 1000.0, [(0.2, 0.2), (0.2, 1.0), (1.0, 1.0), (0.7, 0.7), (0.7, 0.0)]
    lengths = [400, 300, 100, 200, 500]
    alpha = np.concatenate([np.linspace(*w, n) for w, n in zip(way, lengths, strict=True)])
    x = moved("smooth", alpha.size, fs)
    f, bound = forces(proc_of(None, fs, tol=tol, scheme=scheme), x, alpha)
    for k in [*range(0, x.size, 37), 399, 400, 401, 699, 700, 799, 800, 801, 999, 1000, 1499]:
        wanted, most = (full(x, alpha[k], fs, [k], scheme, path=p)[0] for p in (False, True))
        assert abs(f[k] - wanted) <= bound[k] <= tol * float(most)
    _full.cache_clear()


@pytest.mark.parametrize("scheme", ["gl", "l1"])
def test_live_weights_are_right_to_a_few_roundings(scheme):
    p, s = SpringpotLive(Y, A, constant(1.0), scheme, 1e-14, 86400.0, "steady").design(8000.0)
    rates, w = soe.rates(1e-14, 86400.0 * 8000), np.zeros(100)
    low = len(rates.x) - 1
    for alpha in ALPHAS[1:-1]:
        wanted = soe.weights(rates, scheme, alpha)
        reweigh(p, np.array([alpha]), s.r, s.taps, w)
        np.testing.assert_allclose(s.r[low : wanted.modes.size], wanted.modes[low:], rtol=1.2e-15)
        np.testing.assert_allclose(s.taps[::-1], wanted.taps, rtol=2e-15)
        assert not s.r[wanted.modes.size :].any()
        assert w[16] == pytest.approx(8000.0**alpha, rel=4e-16)


@pytest.mark.parametrize("target", ["llvm", "python"])
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
    n, at, scene = 60, 20, Scene({"f": springpot(Y, G, A)})
    x = np.stack([np.linspace(0, 1, n), np.full(n, 1.0), np.full(n, 0.5)])
    x[1:, at] = chi, alpha
    proc = stimlib.compile(scene, 1000, target)
    f = proc.process(rows(proc, x, ["y", "g", "a"]))[0]
    assert proc.fault == ("f", at) and np.isfinite(f).all() and not f[45:].any()
    before = raw(scene, 1000, x, ["y", "g", "a"])[0]
    assert np.flatnonzero(~np.isfinite(before)).tolist() == [at], "the history is not hurt"


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("scheme", ["gl", "l1", "gl-downsampled", "gl-short-memory"])
def test_a_position_that_is_not_finite_is_forgotten_when_contact_is_made_anew(scheme, bad):
    x, c = np.linspace(0, 0.1, 120), np.ones(120)
    x[30], c[50:60] = bad, 0.0
    scene = Scene({"f": springpot(Y, 1.0, 0.5, scheme=scheme, contact=C, horizon=1.0)})
    good = np.isfinite(raw(scene, 1000, np.stack([x, c]), ["y", "c"])[0])
    assert good[:30].all() and not good[30] and good[50:].all()


@pytest.mark.parametrize("scheme", ["gl", "l1", "gl-downsampled", "gl-short-memory"])
def test_a_step_onset_is_for_the_first_contact(scheme):
    pot = springpot(Y, 1.0, 0.5, scheme=scheme, onset="step", contact=C, horizon=1.0)
    f = played(pot, {"y": np.full(40, 0.01), "c": np.repeat([1.0, 0.0, 1.0], [20, 5, 15])})
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


@pytest.mark.parametrize(
    ("words", "first"),
    [
        ({"scheme": "gl-downsampled", "horizon": 3.0}, 100),
        ({"scheme": "gl-short-memory"}, 100),
        ({"scheme": "gl-short-memory", "memory": 0.03}, 30),
    ],
)
def test_the_thesis_methods_are_the_full_sum_at_first_and_then_are_not(words, first):
    """And the history of the first one ends in a fault."""
    x = moved("sinusoid", 3000, 1000.0)
    wanted = 2.0 * forces(proc_of(0.5, 1000.0, tol=1e-14), x)[0]
    error = np.abs(played(springpot(Y, 2.0, 0.5, **words), x) - wanted) / np.abs(wanted).max()
    assert error[:first].max() < 1e-13 < 1e-6 < error[first + 2] and error.max() > 0.02
    proc = stimlib.compile(Scene({"f": springpot(Y, 1.0, 0.5, **words)}), 1000)
    proc.process(np.linspace(0, 1, 3050)[None])
    assert proc.fault == (("f", 3000) if "horizon" in words else None)


# 4: responses -------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", ["gl", "l1"])
@pytest.mark.parametrize("alpha", [0.0, 0.05, 0.3, 0.5, 0.8, 1.0])
def test_the_response_is_the_physics(scheme, alpha):
    """chi (i w)^alpha at low frequencies, of a live order too; at all frequencies the
    generating function of the scheme.
    """
    fs, chi = 8000.0, 40.0
    made = {"f": springpot(Y, Param("chi", chi), alpha, scheme=scheme)}
    made["live"] = springpot(Y, chi, Param("alpha", alpha), scheme=scheme)
    proc, f = stimlib.compile(Scene(made), fs, "python"), np.geomspace(0.01, 4.0, 60)
    k, H = springpot_stiffness(chi, alpha, 2 * np.pi * f), proc.response("f", "y", f)
    np.testing.assert_allclose(H, k.complex, rtol=np.pi * 4.0 / fs + 1e-4)
    np.testing.assert_allclose(np.angle(H), k.phase, atol=2e-3)
    np.testing.assert_array_equal(proc.response("live", "y", f), H)
    f = np.geomspace(0.01, fs / 2, 100)
    wanted = chi * (fs * (1 - np.exp(-2j * np.pi * f / fs))) ** alpha
    assert scheme == "l1" or np.abs(proc.response("f", "y", f) / wanted - 1).max() < 1e-8


@pytest.mark.parametrize("alpha", [0.0, 0.2, 0.5, 0.93, 1.0])
def test_stiffness(alpha):
    w = np.array([0.0, 0.5, 2 * np.pi, 1000.0])
    k = springpot_stiffness(300.0, alpha, w)
    np.testing.assert_allclose(k.complex[1:], 300.0 * (1j * w[1:]) ** alpha, rtol=1e-13)
    np.testing.assert_array_equal(k.complex, k.storage + 1j * k.loss)
    np.testing.assert_allclose(k.magnitude, np.abs(k.complex), rtol=1e-13)
    np.testing.assert_array_equal(k.phase, alpha * np.pi / 2)
    assert (alpha != 0.0 or not k.loss.any()) and (alpha != 1.0 or not k.storage.any())


@pytest.mark.parametrize(("a1", "a2"), [(0.0, 0.5), (0.25, 0.35), (1.0, 0.0), (0.0, 0.75)])
def test_equal_force(a1, a2):
    """Eqs. (3.2), (4.1): the same magnitude at w = 2 pi."""
    chi2 = equal_force(300.0, a1, a2)
    one, other = (
        springpot_stiffness(chi, a, 2 * np.pi).magnitude for chi, a in ((300.0, a1), (chi2, a2))
    )
    assert one == pytest.approx(other, rel=1e-14)
    assert chi2 == pytest.approx(300 * (2 * np.pi) ** (a1 - a2), rel=1e-14)
    assert equal_force(300.0, a1, a2, w=1.0) == 300.0


# Files, units, errors -----------------------------------------------------------------


REFUSED = [
    (lambda: springpot(Y, 1.0, -0.1), "alpha = -0.1"),
    (lambda: springpot(Y, 1.0, 1.1), "from 0"),
    (lambda: springpot(Y, 1.0, math.nan), "finite"),
    (lambda: springpot(Y, -1.0, 0.5), "chi = -1"),
    (lambda: springpot(Y, 1.0, 0.5, tol=1e-15), "tol=1e-14"),
    (lambda: springpot(Y, 1.0, A, tol=0.3), "tol=0.1"),
    (lambda: springpot(Y, 1.0, 0.5, horizon=0.0), "horizon"),
    (lambda: springpot(Y, 1.0, 0.5, scheme="bdf2"), "gl, l1, gl-downsampled, gl-short-memory"),
    (lambda: springpot(Y, 1.0, 0.5, onset="soft"), "steady, step"),
    (lambda: springpot(Y, 1.0, A, scheme="gl-downsampled"), "plain number"),
    (lambda: springpot(Y, 1.0, 0.5, scheme="gl-short-memory", certificate=True), "no bound"),
    (lambda: springpot(Y, 1.0, 0.5, tol=Param("tol", 1e-9)), "design number"),
    (lambda: springpot(Input("f", "N"), 1.0, 0.5), "not in m", UnitError),
    (lambda: springpot(Y, Param("chi", 1.0, "N/m"), 0.5), "plain number", UnitError),
    (lambda: springpot(Y, 1.0, Input("s", "m")), "must have no unit", UnitError),
    (springpot(Y, 1.0, 0.5, scheme="gl-downsampled"), "horizon"),
    (lambda: springpot_stiffness(1.0, 1.5, 1.0), "alpha"),
    (lambda: springpot_stiffness(-1.0, 0.5, 1.0), "chi"),
    (lambda: springpot_stiffness(1.0, 0.5, [-1.0]), "w must"),
    (lambda: equal_force(1.0, 0.5, 0.2, w=0.0), "w = 0"),
    (lambda: equal_force(1.0, 0.5, -0.2), "alpha2"),
    (
        springpot(Y, 1.0, 0.5, horizon=np.nextafter(2.0**62, np.inf)),
        "longer than any run",
        BadValue,
        1.0,
    ),
    (lambda: compiled(springpot(Y, 1.0, A)).response("y", "y", 1.0), "not linear", SceneError),
]


@pytest.mark.parametrize("given", REFUSED, ids=lambda given: given[1])
def test_what_makes_no_sense_is_refused(given):
    refuses(*given)
