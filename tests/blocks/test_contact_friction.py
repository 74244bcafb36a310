"""Friction against its differential equations by another route, its energy, its drift,
and what is refused.
"""

from functools import cache

import numpy as np
import pytest
from hands import hand
from laws import STRESS, played
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnitError, constant
from stimlib.blocks import delay, elapsed, friction, loop, minimum, oscillator, stick_slip

K, F, ELASTIC = 1000.0, 0.6, 0.7  # N/m, N
C = F / K
STATIC, SPEED = 0.9, 0.02  # of Stribeck's curve, in N and m/s
X, NORMAL = Input("x", "m"), Input("normal", "N")
LAWS = ("coulomb", "elastoplastic", "dahl", "lugre")
SLOPES = {  # dz/ds along a way in direction s at speed v, as the papers write it
    "elastoplastic": lambda z, s, v: 1 - max(0.0, (s * z / C - ELASTIC) / (1 - ELASTIC)),
    "dahl": lambda z, s, v: 1 - s * z / C,
    "lugre": lambda z, s, v: 1 - s * z * K / (F + (STATIC - F) * np.exp(-((v / SPEED) ** 2))),
}


def block(law, x=X, normal=1.0, k=K):
    lugre = {"static": STATIC, "speed": SPEED} if law == "lugre" else {}
    return friction(x, normal, F, k, law, **lugre)


@cache
def processor(law, fs=8000):
    """Friction whose normal force, and stiffness in proportion, are inputs."""
    y = (
        stick_slip(X, NORMAL, F, F / 2, K)
        if law == "stick_slip"
        else block(law, X, NORMAL, constant(K, "1/m") * NORMAL)
    )
    return stimlib.compile(Scene({"F": y}), fs)


def force(law, x, normal=1.0, fs=8000):
    proc = processor(law, fs)
    proc.reset()
    rows = {"x": x, "normal": np.broadcast_to(normal, x.shape)}
    return proc.process(np.array([rows[name] for name in proc.inputs]))[0]


def work(law, x, normal=1.0):
    """Taken from the hand up to each sample."""
    return np.cumsum(force(law, x, normal) * np.diff(x, prepend=x[0]))


# Against the differential equation ----------------------------------------------------
@cache
def way(name):
    """A smooth way: a stroke of 80 mm with tremor, or a recorded hand through its
    places every 10 ms.
    """
    t = np.linspace(0, 0.5, 51 if name != "stroke" else 2001)
    if name == "stroke":
        return CubicSpline(t, 0.04 * np.sin(2 * np.pi * t) + 1e-4 * np.sin(18 * np.pi * t + 1))
    return CubicSpline(t, hand(name).motion["x"](4.0 + t))


@cache
def deflections(law, name):
    """z over time by DOP853, from one turn of the hand to the next."""
    x = way(name)
    v = x.derivative()
    cuts = [0.0, *(r for r in v.roots(extrapolate=False) if 0 < r < 0.5), 0.5]
    pieces, z = [], 0.0
    for a, b in zip(cuts, cuts[1:], strict=False):
        s = np.sign(v((a + b) / 2))
        r = solve_ivp(
            lambda t, z, s=s: [v(t) * SLOPES[law](z[0], s, v(t))],
            (a, b),
            [z],
            "DOP853",
            rtol=1e-12,
            atol=1e-16,
            dense_output=True,
        )
        pieces.append(r.sol)
        z = r.y[0, -1]
    return cuts, pieces


def mean_forces(law, name, fs):
    """Of k z over the way of each sample in which the hand does not turn, by Gauss'
    rule; nan elsewhere.
    """
    cuts, pieces = deflections(law, name)
    v = way(name).derivative()
    node, weight = np.polynomial.legendre.leggauss(8)
    t = np.arange(1, int(0.5 * fs)) / fs
    piece = np.searchsorted(cuts, t) - 1
    want = np.full(t.size + 1, np.nan)
    for i in np.flatnonzero(piece == np.searchsorted(cuts, t - 1 / fs) - 1):
        q = t[i] + (node - 1) / (2 * fs)
        want[i + 1] = K * np.sum(weight * v(q) * pieces[piece[i]](q)[0]) / np.sum(weight * v(q))
    return want


@pytest.mark.parametrize(
    ("law", "name"),
    [
        ("dahl", "stroke"),
        ("elastoplastic", "stroke"),
        ("elastoplastic", "touchpad scrub"),
        ("lugre", "touchpad scrub"),
    ],
)
def test_a_law_is_its_differential_equation(law, name):
    """What is left is a turn inside a sample: with the acceleration a it hides a way of
    a/(8 fs^2) there, and back.
    """
    cuts, _ = deflections(law, name)
    hidden = np.abs(way(name).derivative(2)(cuts[1:-1])).max() / 4
    for fs in (1000, 8000):
        error = (
            np.abs(
                force(law, way(name)(np.arange(int(0.5 * fs)) / fs), fs=fs)
                - mean_forces(law, name, fs)
            )
            / K
        )
        assert np.nanmax(error) < hidden / fs**2, f"{np.nanmax(error) / C:.1e} of c at {fs} Hz"
    straight = np.arange(error.size) / fs < cuts[1]
    assert np.nanmedian(error[straight]) < 1e-10 * C
    # the others' have kinks, over which Gauss' rule is not exact
    assert law != "dahl" or np.nanmax(error[straight]) < 1e-9 * C


def test_stick_slip_falls_at_its_places():
    """Each tooth of (static - kinetic) normal/k, whatever the size of a sample; the
    mean of whole teeth is known.
    """
    tooth = (F - F / 2) / K
    x = np.r_[
        0.0, C, C + 0.5 * tooth, C + 0.5 * tooth + 40 * tooth, C + 0.5 * tooth + 40.25 * tooth
    ]
    y = force("stick_slip", x)
    np.testing.assert_allclose(
        y,
        K * np.array([0.0, C / 2, C - 0.75 * tooth, C - 0.5 * tooth, C - 0.375 * tooth]),
        atol=1e-13,
    )
    small, at = (
        force("stick_slip", np.linspace(0.0, x[-1], 40_001)),
        np.linspace(0.0, x[-1], 40_001),
    )
    assert abs(np.sum(small[1:] * np.diff(at)) - np.sum(y[1:] * np.diff(x))) < 1e-15
    np.testing.assert_allclose(force("stick_slip", -x), -y, atol=1e-15)


@pytest.mark.parametrize("normal", [1e-6, 1e-12, 1e-100])
def test_any_number_of_slips_in_a_sample_is_their_mean(normal):
    """From a thousand to 1e97 of them: no digit is lost that the way has."""
    dx = np.random.default_rng(0).choice([-1e-3, 1e-3, 0.3e-3, -0.7e-3], 200)
    y = force("stick_slip", np.cumsum(np.r_[0.0, dx]), normal)[1:]
    few = C * normal / np.abs(dx)  # the first tooth and the last are not whole
    assert np.all(np.abs(y / (0.75 * F * normal * np.sign(dx)) - 1) <= 3 * few + 1e-12)


# Energy -------------------------------------------------------------------------------
@pytest.mark.parametrize("law", [*LAWS, "stick_slip"])
def test_no_motion_and_no_normal_force_takes_energy_out(law):
    rng = np.random.default_rng(2)
    x = np.cumsum(rng.standard_normal(100_000)) * rng.choice([1e-6, 3e-5, 1e-3], 100).repeat(1000)
    for normal in (1.0, np.repeat(rng.uniform(-0.5, 2.0, 10_000), 10)):
        w = work(law, x, normal)
        assert w.min() > -1e-15 * w[-1], "J, of what is taken in all"
        assert w[-1] > 0.1


@pytest.mark.parametrize("law", ["coulomb", "elastoplastic"])
@pytest.mark.longer
def test_a_stiffness_that_follows_the_normal_force_is_passive(law):
    """The trap: k in proportion to N, as of fingers; with z kept on a rise, 10 s of
    this give 0.25 mJ.
    """
    t = np.arange(80_000) / 8000
    x, normal = 1e-4 * np.sin(4 * np.pi * t), 1 - 0.8 * np.sin(8 * np.pi * t)
    w = work(law, x, 10 * normal)
    assert w.min() > -1e-18 and 2e-4 < w[-1]


# Drift --------------------------------------------------------------------------------
@cache
def creep(law):
    """Way of 50 g held by friction under 0.4 of its limit, shaken by 0.1 of it at 50
    Hz, and the seconds that it took.
    """
    fs, seconds = 8000, 600 if STRESS else 20
    push = (
        minimum(elapsed() / constant(0.5, "s"), 1.0)
        * constant(F, "N")
        * (0.4 + 0.1 * oscillator(50.0))
    )

    def body(x):
        before = delay(x, samples=1)
        damped = constant(fs * 1.0, "N/m") * (x - before)
        return (
            2.0 * x - before + constant(1 / (fs**2 * 0.05), "m/N") * (push - block(law, x) - damped)
        )

    proc = stimlib.compile(Scene({"x": loop(body, unit="m")}), fs)
    x = proc.process(np.empty((0, seconds * fs)))[0]
    return x[-1] - x[2 * fs], seconds - 2


@pytest.mark.parametrize(
    ("law", "mm_in_10_min"), [("coulomb", 0), ("elastoplastic", 0), ("dahl", 731), ("lugre", 493)]
)
def test_drift(law, mm_in_10_min):
    """Only the laws that are elastic below break-away stay."""
    moved, seconds = creep(law)
    assert abs(moved * 1e3 * 598 / seconds - mm_in_10_min) < (
        0.02 * mm_in_10_min or 1e-3 * 598 / seconds
    )


# Ends of numbers ----------------------------------------------------------------------
def test_a_normal_force_or_a_stiffness_that_fades_away_closes_no_guard():
    """What smooths them goes through 1e-190: then c/q or limit/k are beyond the largest
    number.
    """
    k = Input("k", "N/m")
    made = {
        law: block(law, k=k) if law != "stick_slip" else stick_slip(X, NORMAL, F, F / 2, k)
        for law in (*LAWS, "stick_slip")
    }
    made |= {
        "soft": stick_slip(X, 1.0, F, F / 2, k),
        "at_once": friction(X, NORMAL, F, k, static=STATIC, speed=1e-310),
    }
    proc = stimlib.compile(Scene(made), 8000, "python")
    small = np.array([1e-100, 1e-160, 1e-190, 1e-300, 1e-310, 5e-324])
    one, n = np.ones(4), np.concatenate
    rows = {
        "normal": n([one, small, one, np.ones(6), one]),
        "k": K * n([one, np.ones(6), one, small, one]),
    }
    x = 1e-3 * np.arange(24.0)
    x[11] = x[10]  # held
    y = proc.process(np.array([rows.get(name, x) for name in proc.inputs]))
    assert proc.fault is None
    assert (y[:, [3, 13, 23]] > 0.4 * F).all(), "and the surface is there again"
    assert (np.abs(y[4, 4:10]) < 1e-30).all() and (np.abs(y[:, 14:20]) < 1e-30).all()


def test_the_least_movement_keeps_the_force():
    """A product of a way of 5e-324 m and a deflection is 0, and not the force times the
    way.
    """
    assert force("elastoplastic", np.array([-C / 2, 0.0, 5e-324]))[2] == pytest.approx(F / 2)


# What is refused, and what is held ----------------------------------------------------
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 3.0])
def test_friction_falls_with_speed_by_the_exponent(exponent):
    """F + (STATIC - F) exp(-(v/SPEED)^exponent), while it slides."""
    for v in (0.005, SPEED, 0.05):
        curve = friction(X, 1.0, F, K, "coulomb", static=STATIC, speed=SPEED, exponent=exponent)
        x = v * np.arange(400) / 1000  # it slides at the end
        proc = stimlib.compile(Scene({"f": curve}), 1000, "python")
        want = F + (STATIC - F) * np.exp(-((v / SPEED) ** exponent))
        assert proc.process(x[None])[0, -1] == pytest.approx(want, rel=1e-9)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_at_rest_and_at_the_first_sample_of_a_contact_friction_is_static(exponent):
    from stimlib.blocks.contact import Stribeck, StribeckPower

    one = (X, constant(0.8, "N"), Input("contact"), 0.5, SPEED)
    made = Stribeck(*one) if exponent == 2 else StribeckPower(*one, exponent)
    x, contact = [0.3, 0.3, 0.3, 0.9, 0.9], [1.0, 1.0, 0.0, 1.0, 1.0]
    proc = stimlib.compile(Scene({"f": made}), 1000, "python")
    signals = {"x": x, "contact": contact}
    got = proc.process(np.array([signals[n] for n in proc.inputs]))[0]
    np.testing.assert_allclose(got, [1.2, 1.2, 0.0, 1.2, 1.2], rtol=1e-15)


@pytest.mark.parametrize("target", ["python", "numba"])
def test_a_way_back_has_the_friction_of_the_way_there(target):
    """The speed is that since the sample before, in any tile."""
    from stimlib.blocks.contact import StribeckPower

    x = 0.3 + np.cumsum(np.random.default_rng(1).uniform(-SPEED, SPEED, 200)) / 1000
    v = np.abs(np.diff(x, prepend=x[0])) * 1000
    one = X, constant(0.8, "N"), constant(1.0), 0.5, SPEED, 1.3
    proc = stimlib.compile(Scene({"f": StribeckPower(*one)}), 1000, target)
    want = 0.8 * (1 + 0.5 * np.exp(-((v / SPEED) ** 1.3)))
    np.testing.assert_allclose(proc.process(x[None])[0], want, rtol=1e-9)


def test_the_damping_that_a_falling_friction_needs():
    """The steepest fall of the curve, found on a grid."""
    from stimlib.blocks.contact import Stribeck, StribeckPower

    one, H = (X, X, X), [np.ones(1), None, None]
    v = np.linspace(1e-6, 0.1, 100_001)
    for exponent in (1.0, 1.3, 2.0, 3.0):
        made = (
            Stribeck(*one, 0.5, SPEED)
            if exponent == 2
            else StribeckPower(*one, 0.5, SPEED, exponent)
        )
        found = made.steepest(1e9, np.exp(2e-6j * np.ones(1)), H, [None, 0.8, None])
        slope = np.gradient(0.8 * 0.5 * np.exp(-((v / SPEED) ** exponent)), v).min()
        damping = float(np.abs(found[0]) / abs(1 - np.exp(-2e-6j)) / 1e9)
        assert damping == pytest.approx(-slope, rel=2e-3)


REFUSED = {
    "normal = -1": dict(normal=-1.0),
    "normal = -2": dict(normal=Param("N", -2.0, "N")),
    "mu = -0.1": dict(mu=-0.1),
    "stiffness = 0": dict(stiffness=0.0),
    "choose one of": dict(law="karnopp"),
    "elastic = 1": dict(elastic=1.0),
    "elastic = -0.1": dict(elastic=-0.1),
    "at least mu": dict(static=0.5),
    "multiply normal": dict(mu=Input("mu"), static=0.9),
    "speed": dict(static=0.9, speed=0.0),
    "exponent = 0.99": dict(static=0.9, exponent=0.99),
    "exponent = inf": dict(static=0.9, exponent=np.inf),
    "exponent = nan": dict(static=0.9, exponent=np.nan),
    "belong to law='lugre'": dict(damping=1.0),
    "viscosity belong to": dict(viscosity=1.0),
    "and mu above 0": dict(mu=0.0, static=0.9),
    "viscosity = -1": dict(law="lugre", viscosity=-1.0),
    "friction: static = 'a' must be": dict(static="a"),
    "friction: damping = None must be": dict(law="lugre", static=0.9, damping=None),
    "damping = -1": dict(law="lugre", damping=-1.0),
    "must be at least damping": dict(law="lugre", static=0.9, damping=1.0, viscosity=0.49),
}


@pytest.mark.parametrize("says", REFUSED)
def test_what_makes_no_sense_is_refused(says):
    with pytest.raises(BadValue, match=says):
        friction(X, **{"normal": 1.0} | REFUSED[says])


def test_a_lugre_that_may_give_energy_is_made_on_demand():
    for words in ({"viscosity": 0.5}, {"viscosity": 0.0, "passive": False}):
        assert (
            friction(X, 1.0, 0.6, K, "lugre", static=0.9, damping=1.0, **words).viscosity
            == words["viscosity"]
        )


@pytest.mark.parametrize(
    "words",
    [
        {"static": 0.5, "kinetic": 0.5},
        {"kinetic": "a"},
        {"kinetic": -0.1},
        {"static": 0.0, "kinetic": 0.0},
        {"static": NORMAL / constant(1.0, "N")},
    ],
)
def test_a_slip_makes_the_force_smaller(words):
    with pytest.raises(BadValue, match="stick_slip"):
        stick_slip(X, 1.0, **words)


def test_units_must_fit():
    with pytest.raises(UnitError, match=r"one unit; .* constant\(1000.0, 'N'\)"):
        friction(Input("angle"), 1.0)
    assert (
        str(friction(Input("angle"), constant(0.02, "N*m"), stiffness=constant(1.0, "N*m")).dim)
        == "N*m"
    )


@pytest.mark.parametrize("law", [*LAWS, "stick_slip"])
def test_a_live_normal_force_below_zero_is_no_contact(law):
    x = 1e-3 * np.arange(40.0)
    y = force(law, x, np.repeat([1.0, -3.0], 20))
    assert (y[5:20] > 0.1).all() and not y[20:].any()


# One sample after another, in Python --------------------------------------------------
ALL = {law: block(law) for law in LAWS} | {"stick_slip": stick_slip(X, 1.0)}


def test_no_contact_begins_strained():
    """Neither the first one, far from 0, nor the next, far from where the last one
    ended.
    """
    on = Input("contact")
    blocks = {law: friction(X, 1.0, law=law, contact=on) for law in LAWS} | {
        "stick_slip": stick_slip(X, 1.0, contact=on)
    }
    rows = played(blocks, [0.5, 0.5001, 9.0, 0.3, 0.3001], [1, 1, 0, 1, 1])
    for name, y in zip(blocks, rows, strict=True):
        assert y[[0, 2, 3]].tolist() == [0, 0, 0] and y[1] > 0.02 and y[4] == pytest.approx(y[1]), (
            name
        )


def test_lugre_has_its_damper_and_its_viscosity():
    """From rest over a way a c: z = c (1 - exp(-a)), in the mean c (1 - (1 -
    exp(-a))/a).
    """
    a, damping, viscosity, fs = 0.25, 2.0, 3.0, 1000
    y = played(
        friction(X, 1.0, F, K, "lugre", damping=damping, viscosity=viscosity), [0.0, a * C], fs=fs
    )
    z = C * -np.expm1(-a)
    assert y[1] == pytest.approx(
        K * (C - z / a) + fs * (damping * z + viscosity * a * C), rel=1e-12
    )


def test_a_force_stays_where_the_stiffness_rises_and_falls_with_it():
    k = Input("k", "N/m")
    y = played(
        friction(X, 1.0, F, k, "coulomb"),
        [0.0, 2e-4, 2e-4, 2e-4, 2e-4],
        [1000, 1000, 1000, 2000, 500],
    )
    np.testing.assert_allclose(y, [0.0, 0.1, 0.2, 0.2, 0.05], rtol=1e-12)


def test_a_limit_that_falls_takes_the_force_with_it():
    """Of a finger that stands still; LuGre's is the static one there."""
    for law in LAWS:
        y = played(block(law, normal=NORMAL), [0.0, 2e-3, 2e-3], [1.0, 1.0, 0.5])
        assert y[2] == pytest.approx(0.5 * (STATIC if law == "lugre" else F), rel=1e-12), law


@pytest.mark.parametrize("at", [1, 2])
@pytest.mark.parametrize("law", [*LAWS, "stick_slip"])
def test_what_is_not_a_number_is_a_fault(law, at):
    """Moving and standing: never silently no friction, nor one without a limit."""
    k = Input("k", "N/m")
    y = stick_slip(X, NORMAL, stiffness=k) if law == "stick_slip" else block(law, X, NORMAL, k)
    proc = stimlib.compile(Scene({"F": y}), 1000, "python")
    for row in range(3):
        rows = np.array([[0.0, 1e-4, 1e-4], np.ones(3), np.full(3, K)])
        rows[row, at] = np.nan
        proc.reset()
        proc.process(rows)
        assert proc.fault == ("F", at), row


def test_each_is_half_a_sample_late():
    proc = stimlib.compile(Scene(ALL), 1000, "python")
    assert {proc.latency[name, "x"] for name in ALL} == {(0.5, 0.5)}
