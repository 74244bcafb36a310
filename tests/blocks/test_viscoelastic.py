"""Maxwell arms, Kelvin-Voigt chains and springpots under force or in series, against
calculus in many digits, their closed forms and their duals.
"""

import re
from math import gamma

import mpmath as mp
import numpy as np
import pytest
from laws import lawful, played, refuses
from refusals import refused, warned

import stimlib
from stimlib import Input, Param, Scene, UnitError, constant
from stimlib.blocks import (
    compliance,
    compliance_generalized_kelvin_voigt,
    compliance_kelvin_voigt,
    compliance_maxwell,
    elapsed,
    generalized_maxwell,
    integrate,
    kelvin_voigt,
    maxwell,
    spring,
    springpot,
    springpot_series,
    standard_linear_solid,
    track,
    track_velocity,
    velocity,
)
from stimlib.blocks.fractional import (
    creep_compliance,
    maxwell_arm,
    maxwell_stiffness,
    relaxation_modulus,
)
from stimlib.blocks.impedance import sampled
from stimlib.checks import linear
from stimlib.core.graph import reach
from stimlib.files import audio

Y, F = Input("y", "m"), Input("f", "N")
TAUS = [10.0**n for n in (-12, -6, -4, -2, 0, 3, 6, 12)]
RATES = [1000.0, 48000.0]
ARMS = [
    (50.0, 1e-5),
    (20.0, 1e-3),
    (30.0, 0.01),
    (10.0, 0.1),
    (5.0, 0.7),
    (4.0, 3.0),
    (2.0, 20.0),
    (9.0, 1e3),
    (1.0, 1e9),
]
FEW = [(50.0, 0.3), (20.0, 0.05)]
ALPHAS = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0]
CHI, K, SPEED = 100.0, 1000.0, 0.1


def some_motion(seed=0):
    """Ramps, holds and jumps, from 0."""
    rng = np.random.default_rng(seed)
    return np.r_[0.0, np.cumsum(rng.standard_normal(119) * rng.choice([0.0, 1e-4, 1.0], 119))]


def exact(block, signal, fs):
    """The same from the law of ``checks.linear``, in extended precision."""
    b = next(b for b in reach([block]) if type(b).__name__ in linear.RESPONSES)
    h = linear.RESPONSES[type(b).__name__](b, fs).response(len(signal))
    return np.convolve(np.asarray(signal, np.longdouble), h)[: len(signal)].astype(float)


def exact_arm(signal, fs, k, tau):
    return exact(maxwell(Y, k, tau=tau), signal - signal[0], fs)


def exact_kelvin_voigt(signal, fs, k, tau):
    return exact(compliance_kelvin_voigt(F, k, tau=tau), signal, fs) / k


def close(got, wanted, tol=2e-15):
    np.testing.assert_allclose(got, wanted, rtol=0, atol=tol * np.abs(wanted).max())


# One time constant --------------------------------------------------------------------
@pytest.mark.parametrize("a", [0.0, *np.geomspace(1e-300, 1e300, 61), *np.geomspace(0.1, 10, 41)])
def test_what_a_time_constant_becomes_is_right_to_rounding(a):
    got = sampled(float(a))
    with mp.workdps(640):
        x = mp.mpf(float(a))
        e = 1 - mp.exp(-x)
        g = e / x if x else mp.mpf(1)
        for v, wanted in zip(got, (e, g, 1 - g), strict=True):
            assert abs(mp.mpf(v) - wanted) <= 6e-16 * wanted


@pytest.mark.parametrize("fs", RATES)
@pytest.mark.parametrize("tau", TAUS)
def test_an_arm_is_exact_for_straight_lines(fs, tau):
    """And creep; the viscosity may be given instead of the time constant."""
    signal, k = some_motion(), 3.7
    close(played(maxwell(Y, k, tau=tau), signal, fs=fs), exact_arm(signal, fs, k, tau))
    crept = exact_kelvin_voigt(signal, fs, k, tau)
    close(played(compliance_kelvin_voigt(F, k, tau=tau), signal, fs=fs), crept)
    close(played(compliance_kelvin_voigt(F, k, b=k * tau), signal, fs=fs), crept)
    flow = signal / k + exact(integrate(F), signal, fs) / (k * tau)
    close(played(compliance_maxwell(F, k, tau=tau), signal, fs=fs), flow)


def limits(fs, signal):
    """Çaldıran's thesis, eqs. (2.3), (2.4), and their duals."""
    speed, way = np.diff(signal, prepend=0.0) * fs, exact(integrate(F), signal, fs)
    return [
        (maxwell(Y, 5.0 / 1e-30, b=5.0), 5.0 * speed),
        (maxwell(Y, 5.0, tau=1e30), 5.0 * signal),
        (maxwell(Y, 5.0, tau=1e308), 5.0 * signal),
        (compliance_kelvin_voigt(F, 5.0, tau=1e-30), signal / 5),
        (compliance_kelvin_voigt(F, 5e-30, b=5.0), way / 5),
    ]


@pytest.mark.parametrize("fs", RATES)
def test_limits_hold_at_the_ends_of_the_range(fs):
    signal = some_motion(seed=2)
    for block, wanted in limits(fs, signal):
        close(played(block, signal, fs=fs), wanted, 1e-15)


@pytest.mark.parametrize("tau", [1.0, 1e3, 1e12])
def test_a_long_hold_relaxes_by_the_clock(tau):
    """A leak of 1e-17 of the state a sample is not lost: 20 s at 48 kHz."""
    fs, n = 48000.0, 960_000
    signal, t = np.r_[0.0, np.full(n - 1, 0.02)], np.arange(n - 1) / fs
    force = played(maxwell(Y, 100.0, tau=tau), signal, fs=fs)[1:]
    most = 3e-16 + 2e-16 * t[-1] / tau + (1e-15 if tau <= 1 else 0)
    assert np.abs(force / (force[0] * np.exp(-t / tau)) - 1).max() < most
    lost = (force[0] - force[-1]) / force[0]
    assert lost == pytest.approx(-np.expm1(-t[-1] / tau), rel=1e-10, abs=2e-16)
    crept = played(compliance_kelvin_voigt(F, 100.0, tau=tau), signal, fs=fs)[1:] / 2e-4
    np.testing.assert_allclose(crept, 1 - (1 - crept[0]) * np.exp(-t / tau), rtol=0, atol=1e-15)
    assert tau < 1e3 or crept[-1] == pytest.approx((t[-1] + 0.5 / fs) / tau, rel=0.01)


# Many ---------------------------------------------------------------------------------
@pytest.mark.parametrize("fs", RATES)
def test_a_generalized_maxwell_model_is_the_sum_of_its_parts(fs):
    signal = some_motion(seed=3) + 0.5
    wanted = 70.0 * signal + sum(exact_arm(signal, fs, *arm) for arm in ARMS)
    parts = sum((maxwell(Y, k, tau=tau) for k, tau in ARMS), spring(Y, 70.0))
    close(played(generalized_maxwell(Y, 70.0, ARMS), signal, fs=fs), wanted, 1e-15)
    close(played(parts, signal, fs=fs), wanted, 1e-15)
    solid = 70 * signal + exact_arm(signal, fs, *ARMS[3])
    close(played(standard_linear_solid(Y, 70.0, *ARMS[3]), signal, fs=fs), solid, 1e-15)


@pytest.mark.parametrize("fs", RATES)
def test_a_chain_is_the_sum_of_its_elements(fs):
    signal = some_motion(seed=4)
    wanted = signal / 70 + exact(integrate(F), signal, fs) / 2e-3
    wanted += sum(exact_kelvin_voigt(signal, fs, *arm) for arm in ARMS)
    chain = compliance_generalized_kelvin_voigt(F, ARMS, k0=70.0, b=2e-3)
    close(played(chain, signal, fs=fs), wanted, 1e-15)


@pytest.mark.parametrize(("onset", "first"), [("steady", 0.0), ("step", 1.5)])
def test_onset_and_contact_are_those_that_were_given(onset, first):
    """At rest at 0.3 m before a contact, but at 0 before the first one where the onset
    is a step.
    """
    block = maxwell(Y, 5.0, tau=1e12, onset=onset, contact=Input("c"))
    y = played(block, {"y": np.full(4, 0.3), "c": [0.0, 1.0, 0.0, 1.0]})
    np.testing.assert_allclose(y, [0.0, first, 0.0, 0.0], atol=1e-12)


STEPS = {
    "maxwell": lambda y: maxwell(y, 5.0, tau=0.01, onset="step"),
    "live": lambda y: springpot(y, 1.0, Param("alpha", 0.3), onset="step"),
    **{
        scheme: lambda y, scheme=scheme: springpot(y, 1.0, 0.3, scheme, onset="step", horizon=1.0)
        for scheme in ("l1", "gl", "gl-downsampled", "gl-short-memory")
    },
    "certificate": lambda y: springpot(y, 1.0, 0.3, onset="step", certificate=True)[1],
    "flow": lambda y: compliance_maxwell(y * constant(1.0, "N/m"), 5.0, 2.0),
    "chain": lambda y: compliance_kelvin_voigt(y * constant(1.0, "N/m"), 5.0, 2.0),
    "dashpot": lambda y: compliance(y * constant(1.0, "N/m"), 5.0, 1.0),
}


@pytest.mark.parametrize("name", STEPS)
def test_a_step_is_at_sample_0_whatever_moves_it(name):
    """A number, or what no input reaches, began 256 samples before."""
    make, held = STEPS[name], np.full(90, 0.3)
    np.testing.assert_array_equal(played(make(constant(0.3, "m")), 90), played(make(Y), held))


STEADY = {
    "maxwell": lambda y: maxwell(y, 5.0, tau=0.01),
    "live": lambda y: springpot(y, 1.0, Param("alpha", 0.3)),
    **{
        scheme: lambda y, scheme=scheme: springpot(y, 1.0, 0.3, scheme, horizon=1.0)
        for scheme in ("l1", "gl", "gl-downsampled", "gl-short-memory")
    },
    "certificate": lambda y: springpot(y, 1.0, 0.3, certificate=True)[1],
    "series": lambda y: springpot_series(y, 1.0, 0.3, k=5.0),
    "element": lambda y: kelvin_voigt(y, 5.0, 2.0),
    "velocity": velocity,
    "track": track,
    "track_velocity": track_velocity,
}


@pytest.mark.parametrize("name", STEADY)
def test_a_movement_over_time_begins_steady_at_sample_0(name):
    """As that of a hand, and not with a way of 256 samples behind it."""
    make, way = STEADY[name], constant(0.1, "m/s") * elapsed()
    np.testing.assert_array_equal(played(make(way), 90), played(make(Y), played(way, 90)))


@pytest.mark.parametrize("tau", [1e-12, 1e-6, 1e-3, 0.1, 10.0, 1e12])
def test_transfer_is_the_arm_at_low_frequencies(tau):
    """Eqs. (2.5), (2.6): storage and loss to 1e-6 at a thousandth of the sample rate,
    with the delay that the block tells.
    """
    proc = stimlib.compile(Scene({"f": maxwell(Y, 200.0, tau=tau)}), 8000.0, "python")
    freq, late = np.array([0.01, 0.1, 1.0]), proc.latency["f", "y"][0]
    law = maxwell_stiffness(200.0, tau, 2 * np.pi * freq).complex
    got = proc.response("f", "y", freq) * np.exp(2j * np.pi * freq * late / 8000)
    np.testing.assert_allclose(got, law, rtol=1e-6 if tau < 1e-2 else 2e-4)
    assert 0 <= late <= 0.5 and (
        1e-6 <= tau <= 10 or late == pytest.approx(0.5 * (tau < 1), abs=1e-6)
    )


# Closed forms -------------------------------------------------------------------------
def test_a_fast_ramp_relaxes_along_the_modulus_and_a_slow_one_does_not():
    """Fig. 1.1a."""
    fs, model = 8000.0, generalized_maxwell(Y, 30.0, FEW)
    t = np.arange(16000) / fs
    fast, slow = (played(model, 0.01 * np.minimum(t / way, 1), fs=fs) for way in (1 / fs, 1.5))
    modulus = relaxation_modulus(t[1:] - 0.5 / fs, 30.0, FEW)
    np.testing.assert_allclose(fast[1:], 0.01 * modulus, rtol=1e-6)
    assert fast.max() > 0.99 and slow.max() < 0.43  # of 1 N, 0.3 N in the end
    assert fast[-1] == pytest.approx(0.3, rel=3e-3) and slow[-1] == pytest.approx(0.3, rel=0.25)


def test_a_load_creeps_along_the_compliance_and_recovers():
    """Fig. 1.1b: by superposition, what is loaded at 0 and released at 1 s."""
    fs, t = 8000.0, np.arange(24000) / 8000.0
    chain = compliance_generalized_kelvin_voigt(F, FEW, k0=100.0)
    got, wanted = played(chain, (t > 0) & (t <= 1.0), fs=fs), np.zeros(t.size)
    for sign, since in ((1, t - 0.5 / fs), (-1, t - 1.0 - 0.5 / fs)):
        crept = creep_compliance(np.maximum(since, 0), 100.0, FEW)
        wanted += sign * np.where(since > 0, crept, 0.0)
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-6 * wanted.max())
    assert got[-1] < 2e-3 * got.max()


@pytest.mark.parametrize("alpha", [0.1, 0.5, 1.0])
def test_closed_forms_are_laplace_transforms_of_the_laws(alpha):
    """Relaxation is k_C(s)/s, creep 1/(s k_C(s)), by numbers; with a springpot beside
    or in the chain.
    """
    t = np.array([0.03, 0.4, 2.0])

    def stiffness(s):
        return 30 + sum(k * s * tau / (1 + s * tau) for k, tau in FEW) + 40 * s**alpha

    def compliance(s):
        elements = sum(1 / (k * (1 + s * tau)) for k, tau in FEW)
        return mp.mpf(1) / 30 + 1 / (7 * s) + elements + 1 / (40 * s**alpha)

    for law, got in (
        (stiffness, relaxation_modulus(t, 30.0, FEW, (40.0, alpha))),
        (compliance, creep_compliance(t, 30.0, FEW, 7.0, (40.0, alpha))),
    ):
        with mp.workdps(30):
            want = [mp.invertlaplace(lambda s, law=law: law(s) / s, v, method="talbot") for v in t]
        np.testing.assert_allclose(got, np.array(want, float), rtol=1e-9)


def test_stiffness_of_an_arm():
    w = np.r_[0.0, np.geomspace(1e-200, 1e200, 41)]
    s = maxwell_stiffness(3.0, 0.5, w)
    with mp.workdps(500):
        for i, v in enumerate(w):
            x = 1j * mp.mpf(v) * mp.mpf(0.5)
            law = 3 * x / (1 + x)
            assert abs(s.magnitude[i] - abs(law)) <= 1e-15 * abs(law)
            assert abs(s.storage[i] - law.real) <= 1e-15 * law.real + mp.mpf(1e-300)
            assert abs(s.loss[i] - law.imag) <= 1e-15 * law.imag
    np.testing.assert_array_equal(s.complex, s.storage + 1j * s.loss)
    np.testing.assert_allclose(s.phase, np.r_[np.pi / 2, np.arctan(1 / (0.5 * w[1:]))], rtol=1e-14)


# A springpot under force --------------------------------------------------------------
@pytest.mark.parametrize("fs", RATES)
@pytest.mark.parametrize("alpha", ALPHAS)
def test_creep_is_exact_for_forces_that_are_straight_between_samples(alpha, fs):
    force = np.r_[0.7, np.random.default_rng(0).standard_normal(150), np.ones(100)]
    lawful(compliance(F, 100.0, alpha, "l1", tol=1e-13), fs, f=force)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_creep_under_a_held_force(alpha):
    """From 0 to 1 N within the first sample."""
    fs = 1000
    chis, t = {"y": 100.0, "live": Param("chi", 100.0)}, np.arange(1, 10 * fs + 1) / fs
    made = {name: compliance(F, chi, alpha, "l1") for name, chi in chis.items()}
    wanted = np.diff(t ** (1 + alpha), prepend=0.0) * fs / (100 * gamma(2 + alpha))
    np.testing.assert_allclose(played(made, np.ones(t.size)), [wanted] * 2, rtol=1e-10)
    assert str(made["y"].dim) == "m"


def test_the_integral_keeps_what_rounding_loses():
    y = played(compliance(F, 1.0, 1.0, "gl"), np.full(1_000_000, 0.1))
    assert y[-1] == pytest.approx(100.0, rel=2e-16)


# In series with a spring or a dashpot -------------------------------------------------
def mittag_leffler(a, b, x):
    """E_{a,b}(x) by its series, in as many digits as the alternating terms eat."""
    with mp.workdps(80):
        terms = (mp.mpf(x) ** k / mp.gamma(mp.mpf(a) * k + b) for k in range(300))
        return float(mp.fsum(terms))


def errors(alpha, scheme, fs):
    """Largest error, of the largest force, of a ramp from rest: k v t
    E_{alpha,2}(-(k/chi) t^alpha).
    """
    arm = springpot_series(Y, CHI, alpha, k=K, scheme=scheme)
    f, at = played(arm, SPEED * np.arange(fs // 4 + 1) / fs, fs=fs), fs // np.array([50, 20, 10, 4])
    law = [K * SPEED * t * mittag_leffler(alpha, 2, -K / CHI * t**alpha) for t in at / fs]
    return float(np.max(np.abs(f[at] - law)) / max(law))


@pytest.mark.parametrize("alpha", [0.5, 0.75, 0.9])
def test_the_fractional_maxwell_arm_converges_to_its_stated_order(alpha):
    for scheme, order in (("l1", 2 - alpha), ("gl", 1.0)):
        coarse, fine = errors(alpha, scheme, 1000), errors(alpha, scheme, 8000)
        assert np.log2(coarse / fine) / 3 == pytest.approx(order, abs=0.15)
        assert scheme == "gl" or coarse < 2e-3


def test_limits():
    move = 0.01 * np.sin(np.arange(2000) / 100)
    stiff = played(springpot_series(Y, CHI, 0.5, k=1e14), move)
    close(stiff, played(springpot(Y, CHI, 0.5, "l1"), move), 1e-9)
    soft = played(springpot_series(Y, 1e14, 0.5, k=K), move)
    np.testing.assert_allclose(soft, K * (move - move[0]), rtol=0, atol=1e-6)


def test_response_is_two_elements_in_series():
    f = np.array([0.5, 5.0, 50.0])
    proc = stimlib.compile(Scene({"f": springpot_series(Y, CHI, 0.5, k=K)}), 8000, "python")
    pot = CHI * (2j * np.pi * f) ** 0.5
    np.testing.assert_allclose(proc.response("f", "y", f), pot * K / (pot + K), rtol=1e-3)
    law, none = (springpot_series(Y, CHI, 0.5, k=K, horizon=h).laws(8000.0) for h in (3600.0, 0.2))
    assert law[0].f(8000.0).min() == pytest.approx(100 / 3600) and not none, "far below its end"


def test_a_run_beyond_the_horizon_is_a_warning(tmp_path):
    scene = Scene({"f": springpot_series(Y, CHI, 0.5, k=K, tol=1e-6, horizon=0.5)})
    motion, proc = {"y": np.zeros(1000)}, stimlib.compile(scene, 1000)
    assert stimlib.render(scene, motion, 1000, 0.5).fault is None
    longer = r"1 s is longer than horizon = 0.5 s"
    warned(RuntimeWarning, longer, stimlib.render, scene, motion, 1000)
    given = tmp_path / "a.wav", proc, motion, 1.0
    warned(RuntimeWarning, "longer horizon", audio.write, *given, progress=False)


# What is refused ----------------------------------------------------------------------
BELOW = -1.0, np.float32(-1), np.int64(-1), constant(-1.0, "N/m"), Param("k", -1.0, "N/m")
NO_PAIRS = [50.0, None, np.ones(3), [50.0, 0.1], [(1.0, 2.0, 3.0)]]
REFUSED = [
    *(
        (make, "^[a-z_]+: ")
        for make in [
            lambda: maxwell(Y, 5.0),
            lambda: maxwell(Y, 5.0, 1.0, tau=1.0),
            lambda: maxwell(Y, 0.0, 1.0),
            lambda: maxwell(Y, 5.0, 0.0),
            lambda: maxwell(Y, 5.0, np.nan),
            lambda: maxwell(Y, 5.0, tau=np.inf),
            lambda: maxwell(Y, 5.0, tau=-1.0),
            lambda: maxwell(Y, 5.0, tau=Param("tau", 1.0, "s")),
            lambda: maxwell(Y, 5.0, Param("b", 1.0, "N*s/m")),
            lambda: maxwell(Y, Param("k", 1.0, "N/m"), 5.0),
            lambda: maxwell(Y, 1e-300, 1e300),
            lambda: maxwell(Y, 5.0, 1.0, onset="now"),
            lambda: generalized_maxwell(Y, 1.0, []),
            lambda: generalized_maxwell(Y, 1.0, [(1.0, 2.0, 3.0)]),
            *(lambda k=k: generalized_maxwell(Y, k, [(1.0, 2.0)]) for k in BELOW),
            lambda: generalized_maxwell(Y, 1.0, [(BELOW[-1], 2.0)]),
            lambda: generalized_maxwell(Y, 1.0, [(1.0, 0.0)]),
            lambda: generalized_maxwell(Y, 1.0, [(-1.0, 1.0)]),
            lambda: generalized_maxwell(Y, 1.0, [(1.0, np.inf)]),
            lambda: compliance_maxwell(F, 1.0),
            lambda: compliance_maxwell(F, -1.0, 1.0),
            lambda: compliance_kelvin_voigt(F, 0.0, 1.0),
            lambda: compliance_kelvin_voigt(F, 1.0, 1.0, tau=1.0),
            lambda: compliance_generalized_kelvin_voigt(F, []),
            lambda: compliance_generalized_kelvin_voigt(F, [(1.0,)]),
            lambda: compliance_generalized_kelvin_voigt(F, [(1.0, -1.0)]),
            lambda: compliance_generalized_kelvin_voigt(F, [(Param("k", 1.0, "N/m"), 1.0)]),
            lambda: compliance_generalized_kelvin_voigt(F, [(1.0, 1.0)], k0=0.0),
            lambda: compliance_generalized_kelvin_voigt(F, [(1.0, 1.0)], b=-1.0),
            lambda: maxwell_stiffness(1.0, 1.0, [-1.0]),
            lambda: maxwell_stiffness(0.0, 1.0, 1.0),
            lambda: relaxation_modulus([-1.0]),
            lambda: relaxation_modulus([1.0], arms=[(1.0, 0.0)]),
            lambda: relaxation_modulus([1.0], springpot=(1.0, 1.5)),
            lambda: creep_compliance([1.0], k0=0.0),
            lambda: creep_compliance([1.0], b=np.nan),
            lambda: creep_compliance([1.0], springpot=(0.0, 0.5)),
            lambda: springpot_series(Y, CHI, 0.5),
            lambda: springpot_series(Y, CHI, 0.5, k=1.0, b=1.0),
            lambda: springpot_series(Y, CHI, 0.5, k=-1.0),
            lambda: springpot_series(Y, CHI, 0.5, b=0.0),
            lambda: springpot_series(Y, CHI, 0.0, k=1.0),
            lambda: springpot_series(Y, CHI, 1.0, k=1.0),
            lambda: springpot_series(Y, CHI, 1.2, k=1.0),
        ]
    ),
    *(
        (lambda words=words: compliance(F, **{"chi": 3.0, "alpha": 0.5} | words), re.escape(says))
        for words, says in [
            ({"alpha": 1.5}, "alpha = 1.5 must be a number from 0 (spring) to 1 (dashpot)"),
            ({"alpha": -0.5}, "alpha = -0.5 must be a number from 0 (spring) to 1 (dashpot)"),
            ({"alpha": "0.5"}, "alpha = '0.5' must be a number"),
            ({"alpha": Param("a", 0.5)}, "alpha is a design number"),
            ({"chi": 0.0}, "chi = 0 must be above 0"),
            ({"chi": -5.0}, "chi = -5 must be above 0"),
            ({"chi": Param("chi", -5.0)}, "chi = -5 must be above 0"),
            ({"chi": constant(3.0, "N/m")}, "chi Const(3.0, 'N/m') is in N/m; give a plain number"),
            ({"tol": 1e-20}, "tol = 1e-20"),
            ({"scheme": "gl-downsampled"}, "scheme = 'gl-downsampled'; choose one of gl, l1"),
        ]
    ),
    *(
        (make, r"\[.*\]|[Nm]", UnitError)
        for make in (
            lambda: maxwell(Input("v", "m/s"), 1.0, 1.0),
            lambda: maxwell(Input("x"), 1.0, 1.0),
            lambda: maxwell(Y, Param("k", 1.0), tau=1.0),
            lambda: generalized_maxwell(Y, constant(1.0, "N*s/m"), [(1.0, 1.0)]),
            lambda: compliance_maxwell(Y, 1.0, 1.0),
            lambda: compliance_kelvin_voigt(F, Param("k", 1.0, "N*s/m"), tau=1.0),
            lambda: compliance(Y, 1.0, 0.5),
        )
    ),
    *(
        (lambda arms=arms: generalized_maxwell(Y, 10.0, arms), "^generalized_maxwell: arms")
        for arms in NO_PAIRS
    ),
    *(
        (lambda arms=arms: compliance_generalized_kelvin_voigt(F, arms), "_voigt: elements")
        for arms in NO_PAIRS
    ),
]


@pytest.mark.parametrize("given", REFUSED, ids=lambda given: given[1])
def test_what_makes_no_sense_is_refused(given):
    refuses(*given)


@pytest.mark.parametrize("phase", [1e-6, 0.6, 1.57])
def test_an_arm_is_found_from_its_magnitude_and_phase(phase):
    k, tau = maxwell_arm(300.0, phase, 7.0)
    found = maxwell_stiffness(k, tau, 7.0)
    assert (found.magnitude, found.phase) == pytest.approx((300.0, phase), rel=1e-9)
    assert k == pytest.approx(300.0 * np.sqrt(1 + (7.0 * tau) ** -2.0), rel=1e-9)
    for wrong in (0.0, np.pi / 2):
        says = "maxwell_arm: phase = .* between 0 and pi/2"
        refused(stimlib.BadValue, says, maxwell_arm, 1.0, wrong, 1.0)
