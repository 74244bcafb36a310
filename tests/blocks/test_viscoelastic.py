"""Maxwell arms and Kelvin-Voigt chains against calculus in many digits, their closed
forms, and what is refused.
"""

import mpmath as mp
import numpy as np
import pytest
from laws import played

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib.blocks import integrate, spring
from stimlib.blocks.fractional import creep_compliance, maxwell_stiffness, relaxation_modulus
from stimlib.blocks.impedance import sampled
from stimlib.blocks.viscoelastic import (
    compliance_generalized_kelvin_voigt,
    compliance_kelvin_voigt,
    compliance_maxwell,
    generalized_maxwell,
    maxwell,
    standard_linear_solid,
)
from stimlib.checks import linear
from stimlib.core.graph import reach
from stimlib.errors import BadValue, UnitError

y, f = Input("y", "m"), Input("f", "N")
TAUS = [10.0**n for n in range(-12, 13, 2)]
RATES = [1000.0, 8000.0, 48000.0]


def some_motion(n=120, seed=0):
    """Ramps, holds and jumps, from 0."""
    rng = np.random.default_rng(seed)
    steps = rng.standard_normal(n) * rng.choice([0.0, 1e-4, 1.0], n)
    return np.r_[0.0, np.cumsum(steps)[: n - 1]]


# The same from the law of ``checks.linear``, in extended precision --------------------
def exact(block, signal, fs):
    b = next(b for b in reach([block]) if type(b).__name__ in linear.RESPONSES)
    h = linear.RESPONSES[type(b).__name__](b, fs).response(len(signal))
    return np.convolve(np.asarray(signal, np.longdouble), h)[: len(signal)].astype(float)


def exact_arm(signal, fs, k, tau):
    return exact(maxwell(y, k, tau=tau), np.asarray(signal) - signal[0], fs)


def exact_kelvin_voigt(signal, fs, k, tau):
    return exact(compliance_kelvin_voigt(f, k, tau=tau), signal, fs) / k


def exact_integral(signal, fs):
    return exact(integrate(f), signal, fs)


def close(got, wanted, tol=4e-16):
    np.testing.assert_allclose(got, wanted, rtol=0, atol=tol * np.abs(wanted).max())


# One time constant --------------------------------------------------------------------
def test_what_a_time_constant_becomes_is_right_to_rounding():
    for a in [0.0, *np.geomspace(1e-300, 1e300, 301), *np.geomspace(0.1, 10, 101)]:
        got = sampled(float(a))
        with mp.workdps(640):
            x = mp.mpf(float(a))
            e = 1 - mp.exp(-x)
            g = e / x if x else mp.mpf(1)
            for v, wanted in zip(got, (e, g, 1 - g), strict=True):
                assert abs(mp.mpf(v) - wanted) <= 6e-16 * wanted, (a, v)


@pytest.mark.parametrize("fs", RATES)
@pytest.mark.parametrize("tau", TAUS)
def test_an_arm_is_exact_for_straight_lines(fs, tau):
    signal = some_motion()
    k = 3.7
    wanted = np.array(exact_arm(signal, fs, k, tau))
    close(played(maxwell(y, k, tau=tau), signal, fs=fs), wanted, 2e-15)
    if tau <= 1e-6:  # (2.3): a damper
        np.testing.assert_allclose(
            wanted,
            k * tau * np.diff(signal, prepend=0.0) * fs,
            rtol=0,
            atol=4 * tau * fs * max(abs(wanted)),
        )
    if tau >= 1e6:  # (2.4): a spring
        close(wanted, k * signal, 1e-5)


@pytest.mark.parametrize("fs", RATES)
@pytest.mark.parametrize("tau", TAUS)
def test_creep_is_exact_for_straight_lines(fs, tau):
    signal, k = some_motion(seed=1), 3.7
    wanted = np.array(exact_kelvin_voigt(signal, fs, k, tau))
    close(played(compliance_kelvin_voigt(f, k, tau=tau), signal, fs=fs), wanted, 2e-15)
    close(played(compliance_kelvin_voigt(f, k, b=k * tau), signal, fs=fs), wanted, 2e-15)
    flow = signal / k + np.array(exact_integral(signal, fs)) / (k * tau)
    close(played(compliance_maxwell(f, k, tau=tau), signal, fs=fs), flow, 2e-15)


@pytest.mark.parametrize("fs", RATES)
def test_limits_hold_at_the_ends_of_the_range(fs):
    """Çaldıran's thesis, eqs. (2.3), (2.4), and their duals."""
    signal = some_motion(seed=2)
    speed = np.diff(signal, prepend=0.0) * fs
    way = np.array(exact_integral(signal, fs))
    close(played(maxwell(y, 5.0 / 1e-30, b=5.0), signal, fs=fs), 5.0 * speed, 1e-15)
    close(played(maxwell(y, 5.0, tau=1e30), signal, fs=fs), 5.0 * signal, 1e-15)
    close(played(maxwell(y, 5.0, tau=1e308), signal, fs=fs), 5.0 * signal, 1e-15)
    close(played(compliance_kelvin_voigt(f, 5.0, tau=1e-30), signal, fs=fs), signal / 5, 1e-15)
    close(played(compliance_kelvin_voigt(f, 5e-30, b=5.0), signal, fs=fs), way / 5, 1e-15)


@pytest.mark.parametrize("tau", [1.0, 1e3, 1e6, 1e9, 1e12])
def test_a_long_hold_relaxes_by_the_clock(tau):
    """A leak of 1e-17 of the state a sample is not lost: 20 s at 48 kHz."""
    fs, n = 48000.0, 960_000
    signal = np.zeros(n)
    signal[1:] = 0.02
    one = played(maxwell(y, 100.0, tau=tau), signal, fs=fs)
    t = np.arange(n - 1) / fs
    wanted = one[1] * np.exp(-t / tau)
    assert np.abs(one[1:] / wanted - 1).max() < 3e-16 + 2e-16 * t[-1] / tau + (
        1e-15 if tau <= 1 else 0
    )
    lost = (one[1] - one[-1]) / one[1]
    assert lost == pytest.approx(-np.expm1(-t[-1] / tau), rel=1e-10, abs=2e-16)
    crept = played(compliance_kelvin_voigt(f, 100.0, tau=tau), signal, fs=fs)
    first = (crept[1] - 0.02 / 100) / (-0.02 / 100)
    np.testing.assert_allclose(
        crept[1:], 0.02 / 100 * (1 - first * np.exp(-t / tau)), rtol=0, atol=1e-15 * 0.02 / 100
    )
    if tau >= 1e3:
        np.testing.assert_allclose(crept[-1], 0.02 / 100 * (t[-1] + 0.5 / fs) / tau, rtol=0.01)


# Many ---------------------------------------------------------------------------------
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


@pytest.mark.parametrize("fs", RATES)
def test_a_generalized_maxwell_model_is_the_sum_of_its_parts(fs):
    signal = some_motion(seed=3) + 0.5
    wanted = 70.0 * signal + sum(np.array(exact_arm(signal, fs, k, tau)) for k, tau in ARMS)
    close(played(generalized_maxwell(y, 70.0, ARMS), signal, fs=fs), wanted, 1e-15)
    parts = spring(y, 70.0)
    for k, tau in ARMS:
        parts = parts + maxwell(y, k, tau=tau)
    close(played(parts, signal, fs=fs), wanted, 1e-15)
    close(
        played(standard_linear_solid(y, 70.0, *ARMS[3]), signal, fs=fs),
        70 * signal + exact_arm(signal, fs, *ARMS[3]),
        1e-15,
    )


@pytest.mark.parametrize("fs", RATES)
def test_a_chain_is_the_sum_of_its_elements(fs):
    signal = some_motion(seed=4)
    wanted = signal / 70 + np.array(exact_integral(signal, fs)) / 2e-3
    wanted = wanted + sum(np.array(exact_kelvin_voigt(signal, fs, k, tau)) for k, tau in ARMS)
    chain = compliance_generalized_kelvin_voigt(f, ARMS, k0=70.0, b=2e-3)
    close(played(chain, signal, fs=fs), wanted, 1e-15)


def test_arms_with_plain_numbers_are_one_bank():
    plan = stimlib.compile(Scene({"f": generalized_maxwell(y, 70.0, ARMS)}), 1000).program.instances
    assert sorted(type(q.block).__name__ for q in plan if q.kind == "block") == [
        "Add",
        "Guard",
        "MaxwellArms",
        "Mul",
    ]
    one = stimlib.compile(Scene({"f": maxwell(y, 70.0, 1.0)}), 1000).program.instances
    assert sorted(type(q.block).__name__ for q in one if q.kind == "block") == [
        "Guard",
        "MaxwellArms",
    ]


def test_a_live_stiffness_is_that_of_a_number():
    signal, k = some_motion(seed=5), Param("k", 12.0, "N/m")
    for live, fixed in (
        (maxwell(y, k, tau=0.02), maxwell(y, 12.0, tau=0.02)),
        (
            generalized_maxwell(y, k, [(k, 0.02), (7.0, 0.1)]),
            generalized_maxwell(y, 12.0, [(12.0, 0.02), (7.0, 0.1)]),
        ),
        (compliance_kelvin_voigt(f, k, tau=0.02), compliance_kelvin_voigt(f, 12.0, tau=0.02)),
        (compliance_maxwell(f, k, tau=0.02), compliance_maxwell(f, 12.0, tau=0.02)),
    ):
        close(played(live, signal), played(fixed, signal), 2e-15)


@pytest.mark.parametrize("onset", ["steady", "step"])
def test_onset_and_contact_are_those_that_were_given(onset):
    """At rest at 0.3 m before a contact, but at 0 before the first one where the onset
    is a step.
    """
    block = maxwell(y, 5.0, tau=1e12, onset=onset, contact=Input("c"))
    out = stimlib.compile(Scene({"f": block}), 1000.0).process(
        np.array([np.full(4, 0.3), [0.0, 1.0, 0.0, 1.0]])
    )[0]
    np.testing.assert_allclose(out, [0.0, 1.5 * (onset == "step"), 0.0, 0.0], atol=1e-12)


# Silence ------------------------------------------------------------------------------
def test_a_held_position_is_silent_and_so_is_the_end_of_a_relaxation():
    proc = stimlib.compile(Scene({"f": maxwell(y, 5.0, tau=1e-3)}), 8000.0)
    proc.process(np.random.default_rng(0).standard_normal((1, 100)))
    assert not proc.process(np.full((1, 20000), 0.2))[0, -1000:].any()


def test_transfer_is_the_arm_at_low_frequencies():
    """Eqs. (2.5), (2.6): storage and loss to 1e-6 at a thousandth of the sample rate,
    with the delay that the block tells.
    """
    for tau in (1e-6, 1e-3, 0.1, 10.0, 1e12):
        proc = stimlib.compile(Scene({"f": maxwell(y, 200.0, tau=tau)}), 8000.0)
        freq = np.array([0.01, 0.1, 1.0])
        law = maxwell_stiffness(200.0, tau, 2 * np.pi * freq).complex
        late = proc.latency["f", "y"][0]
        assert 0 <= late <= 0.5
        got = proc.response("f", "y", freq) * np.exp(2j * np.pi * freq * late / 8000)
        np.testing.assert_allclose(got, law, rtol=1e-6 if tau < 1e-2 else 2e-4)
    fast, slow = (
        stimlib.compile(Scene({"f": maxwell(y, 1.0, tau=v)}), 8000.0).latency["f", "y"][0]
        for v in (1e-12, 1e12)
    )
    assert fast == pytest.approx(0.5, abs=1e-6) and slow == pytest.approx(0, abs=1e-6)
    assert (
        stimlib.compile(Scene({"f": generalized_maxwell(y, 1.0, ARMS)}), 8000.0).latency["f", "y"][
            0
        ]
        == 0.0
    )


def test_response_at_0_hz():
    zero = np.zeros(1)
    for block, source, wanted in (
        (maxwell(y, 2.0, tau=1.0), "y", 0.0),
        (maxwell(y, 2.0, tau=1e308), "y", 2.0),
        (compliance_kelvin_voigt(f, 2.0, tau=1.0), "f", 0.5),
    ):
        assert stimlib.compile(Scene({"out": block}), 1000.0).response("out", source, zero)[
            0
        ] == pytest.approx(wanted)
    flow = compliance_maxwell(f, 2.0, tau=1.0)
    assert abs(stimlib.compile(Scene({"out": flow}), 1000.0).response("out", "f", zero)[0]) > 1e250


# Closed forms -------------------------------------------------------------------------
def test_a_fast_ramp_relaxes_along_the_modulus_and_a_slow_one_does_not():
    """Fig. 1.1a."""
    fs, arms = 8000.0, [(50.0, 0.3), (20.0, 0.05)]
    t = np.arange(16000) / fs
    fast = played(generalized_maxwell(y, 30.0, arms), 0.01 * np.minimum(t / (1 / fs), 1), fs=fs)
    held = t[1:]
    np.testing.assert_allclose(
        fast[1:], 0.01 * relaxation_modulus(held - 0.5 / fs, 30.0, arms), rtol=1e-6
    )
    slow = played(generalized_maxwell(y, 30.0, arms), 0.01 * np.minimum(t / 1.5, 1), fs=fs)
    assert fast.max() > 0.99 and slow.max() < 0.43  # of 1 N, 0.3 N in the end
    assert fast[-1] == pytest.approx(0.3, rel=3e-3)
    np.testing.assert_allclose(slow[-1], 0.3, rtol=0.25)


def test_a_load_creeps_along_the_compliance_and_recovers():
    """Fig. 1.1b: by superposition, what is loaded at 0 and released at 1 s."""
    fs, elements = 8000.0, [(50.0, 0.3), (20.0, 0.05)]
    t = np.arange(24000) / fs
    load = ((t > 0) & (t <= 1.0)).astype(float)
    got = played(compliance_generalized_kelvin_voigt(f, elements, k0=100.0), load, fs=fs)
    up, down = t - 0.5 / fs, t - 1.0 - 0.5 / fs
    wanted = np.where(up > 0, creep_compliance(np.maximum(up, 0), 100.0, elements), 0.0)
    wanted -= np.where(down > 0, creep_compliance(np.maximum(down, 0), 100.0, elements), 0.0)
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-6 * wanted.max())
    assert got[-1] < 2e-3 * got.max()


def talbot(F, t):
    with mp.workdps(30):
        return float(mp.invertlaplace(F, t, method="talbot"))


@pytest.mark.parametrize("alpha", [0.1, 0.5, 0.9, 1.0])
def test_closed_forms_are_laplace_transforms_of_the_laws(alpha):
    """Relaxation is k_C(s)/s, creep 1/(s k_C(s)), by numbers; with a springpot beside
    or in the chain.
    """
    t, chi, arms = np.array([0.03, 0.4, 2.0]), 40.0, [(50.0, 0.3), (20.0, 0.05)]

    def stiffness(s):
        return 30 + sum(k * s * tau / (1 + s * tau) for k, tau in arms) + chi * s**alpha

    def compliance(s):
        return (
            mp.mpf(1) / 30
            + 1 / (7 * s)
            + sum(1 / (k * (1 + s * tau)) for k, tau in arms)
            + 1 / (chi * s**alpha)
        )

    got = relaxation_modulus(t, 30.0, arms, (chi, alpha))
    np.testing.assert_allclose(got, [talbot(lambda s: stiffness(s) / s, v) for v in t], rtol=1e-9)
    got = creep_compliance(t, 30.0, arms, 7.0, (chi, alpha))
    np.testing.assert_allclose(got, [talbot(lambda s: compliance(s) / s, v) for v in t], rtol=1e-9)


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
            assert s.complex[i] == complex(s.storage[i], s.loss[i])
    np.testing.assert_allclose(s.phase[1:], np.arctan(1 / (0.5 * w[1:])), rtol=1e-14)
    assert s.phase[0] == np.pi / 2


# What is refused ----------------------------------------------------------------------
@pytest.mark.parametrize(
    "make",
    [
        lambda: maxwell(y, 5.0),
        lambda: maxwell(y, 5.0, 1.0, tau=1.0),
        lambda: maxwell(y, 0.0, 1.0),
        lambda: maxwell(y, 5.0, 0.0),
        lambda: maxwell(y, 5.0, np.nan),
        lambda: maxwell(y, 5.0, tau=np.inf),
        lambda: maxwell(y, 5.0, tau=-1.0),
        lambda: maxwell(y, 5.0, tau=Param("tau", 1.0, "s")),
        lambda: maxwell(y, 5.0, Param("b", 1.0, "N*s/m")),
        lambda: maxwell(y, Param("k", 1.0, "N/m"), 5.0),
        lambda: maxwell(y, 1e-300, 1e300),
        lambda: maxwell(y, 5.0, 1.0, onset="now"),
        lambda: generalized_maxwell(y, 1.0, []),
        lambda: generalized_maxwell(y, 1.0, [(1.0, 2.0, 3.0)]),
        lambda: generalized_maxwell(y, -1.0, [(1.0, 2.0)]),
        lambda: generalized_maxwell(y, 1.0, [(1.0, 0.0)]),
        lambda: generalized_maxwell(y, 1.0, [(-1.0, 1.0)]),
        lambda: generalized_maxwell(y, 1.0, [(1.0, np.inf)]),
        lambda: compliance_maxwell(f, 1.0),
        lambda: compliance_maxwell(f, -1.0, 1.0),
        lambda: compliance_kelvin_voigt(f, 0.0, 1.0),
        lambda: compliance_kelvin_voigt(f, 1.0, 1.0, tau=1.0),
        lambda: compliance_generalized_kelvin_voigt(f, []),
        lambda: compliance_generalized_kelvin_voigt(f, [(1.0,)]),
        lambda: compliance_generalized_kelvin_voigt(f, [(1.0, -1.0)]),
        lambda: compliance_generalized_kelvin_voigt(f, [(Param("k", 1.0, "N/m"), 1.0)]),
        lambda: compliance_generalized_kelvin_voigt(f, [(1.0, 1.0)], k0=0.0),
        lambda: compliance_generalized_kelvin_voigt(f, [(1.0, 1.0)], b=-1.0),
        lambda: maxwell_stiffness(1.0, 1.0, [-1.0]),
        lambda: maxwell_stiffness(0.0, 1.0, 1.0),
        lambda: relaxation_modulus([-1.0]),
        lambda: relaxation_modulus([1.0], arms=[(1.0, 0.0)]),
        lambda: relaxation_modulus([1.0], springpot=(1.0, 1.5)),
        lambda: creep_compliance([1.0], k0=0.0),
        lambda: creep_compliance([1.0], b=np.nan),
        lambda: creep_compliance([1.0], springpot=(0.0, 0.5)),
    ],
)
def test_numbers_that_make_no_sense(make):
    with pytest.raises(BadValue):
        make()


def test_units_that_do_not_fit():
    for make in (
        lambda: maxwell(Input("v", "m/s"), 1.0, 1.0),
        lambda: maxwell(Input("x"), 1.0, 1.0),
        lambda: maxwell(y, Param("k", 1.0), tau=1.0),
        lambda: generalized_maxwell(y, constant(1.0, "N*s/m"), [(1.0, 1.0)]),
        lambda: compliance_maxwell(y, 1.0, 1.0),
        lambda: compliance_kelvin_voigt(f, Param("k", 1.0, "N*s/m"), tau=1.0),
    ):
        with pytest.raises(UnitError):
            make()


@pytest.mark.parametrize("arms", [50.0, None, np.ones(3), [50.0, 0.1], [(1.0, 2.0, 3.0)]])
def test_arms_that_are_no_pairs_are_refused_by_name(arms):
    with pytest.raises(BadValue, match="^generalized_maxwell: arms = .* must be a list"):
        generalized_maxwell(Input("y", "m"), 10.0, arms)
    with pytest.raises(
        BadValue, match="^compliance_generalized_kelvin_voigt: elements = .* must be a list"
    ):
        compliance_generalized_kelvin_voigt(Input("f", "N"), arms)
