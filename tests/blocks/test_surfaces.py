"""Bumps, an equalised mode of the plate, noise over place and gratings: means over a
way are those of their laws, and the same place is the same bits.
"""

import numpy as np
import pytest
from laws import alias, assert_same, bits, lawful, played, refuses

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnitError, constant
from stimlib.blocks import equalize, grating, spatial_noise
from stimlib.blocks.bumps import WAVEFORMS, bump
from stimlib.blocks.surfaces import lattice
from stimlib.design.noise import octaves

FS = 8000.0
U, X, VOLTS = Input("u"), Input("x", "m"), Input("v", "V")
TABLE = [0.2, 1.0, 0.0, 0.7]


def touched(u, waveform="square", duty=0.5, target="llvm", **words):
    return played(bump(U, waveform, duty, **words), u, fs=FS, target=target)


RNG = np.random.default_rng(1)
FAST = np.cumsum(RNG.choice([-1, 1], 800) * 10 ** RNG.uniform(-2, 1.3, 800))  # to 20 bumps a sample
AT_REST = [-1e-17, 3.0, 0.8, -2.3, -1.9, -0.7, 0.123, 0.39, 0.41, 0.99, 3.3, 1e6 + 0.25]
LINES = np.linspace(-0.02, 0.02, 200)
RIBS = [(2e-3, 0.2, 0.4), (0.3e-3, -0.05, 2.0), (0.11e-3, 0.01, 0.0)]
LAWFUL = [
    *(
        (bump(U, waveform, duty, sampling=sampling), np.r_[FAST, np.repeat(AT_REST, 3)])
        for waveform in (*WAVEFORMS, TABLE)
        for duty in (0.05, 0.4, 0.8, 1.0)
        for sampling in ("area", "point")
    ),
    *(  # the last way: 1.1 cells of the coarsest octave, so up to 3
        (
            spatial_noise(X, 2.0, 6, shortest=1e-4, longest=0.03),
            np.stack([LINES, LINES + way * np.cos(np.arange(200))], axis=1).ravel(),
        )
        for way in (1e-9, 3e-6, 4e-5, 1e-3, 2.23e-2)
    ),
    *(
        (grating(X, RIBS), 0.3 + speed * np.sin(np.arange(300)) / FS)
        for speed in (0.0, 1e-4, 0.03, 0.8, 5.0)
    ),
]


def test_each_sample_is_the_mean_over_its_movement():
    """Or the place itself, at rest and where a bump is sampled at points."""
    for block, x in LAWFUL:
        lawful(block, FS, u=x, x=x)


@pytest.mark.parametrize("waveform", [*WAVEFORMS, TABLE], ids=str)
def test_slow_movements_lose_no_digits_and_zeros_have_no_sign(waveform):
    """Where a difference of integrals would have none left: 1e-12 of a bump per
    sample.
    """
    u = 3 + 0.3 + 1e-12 * np.arange(50)
    area, point = (touched(u, waveform, 0.7, sampling=s) for s in ("area", "point"))
    np.testing.assert_allclose(area, point, rtol=1e-10)
    back = touched(np.r_[np.linspace(0.9, 0.6, 100), np.linspace(0.6, 2.0, 100)], waveform)
    assert area.all() and not (bits(back) == bits(np.array(-0.0))).any()


@pytest.mark.parametrize(
    ("waveform", "duty"),
    [("square", 1.0), ("square", 0.7), ([1.0, 1.0], 1.0), ("sine", 0.1), ([0.0, 0.0], 0.3)],
)
def test_no_rounding_leaves_0_to_1(waveform, duty):
    y = touched(np.cumsum(np.random.default_rng(0).standard_normal(20_000) * 3), waveform, duty)
    assert y.min() >= 0.0 and y.max() <= 1.0


@pytest.mark.parametrize("duty", [0.2, 0.5, 0.8])
def test_area_sampling_has_20_dB_less_alias_below_1_kHz(duty):
    n = 1 << 16
    k = round(90 / FS * n) | 1  # 90 bumps/s, no common period with fs
    u = np.arange(-1, n) * k / n + 1.234567e-4
    area, point = (touched(u, duty=duty, sampling=s)[1:] for s in ("area", "point"))
    assert alias(area, k, 1000 / FS) <= alias(point, k, 1000 / FS) - 20


# Equalising a mode of the plate -------------------------------------------------------
KNOTS = np.linspace(0.0, 0.1, 5)


def mode(x, span=0.2):
    """First bending mode of a beam clamped 0.2 m apart, 1 in its middle at x = 0.05 m;
    0.543 at 0 and 0.1 m.
    """

    def shape(z):
        b = 4.730040744862704
        c = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
        return np.cosh(b * z) - np.cos(b * z) - c * (np.sinh(b * z) - np.sin(b * z))

    return shape(0.5 + (np.asarray(x) - 0.05) / span) / shape(0.5)


PROFILE = KNOTS, 120e-6 * mode(KNOTS)
SWEEP = np.linspace(0.0, 0.1, 2001)
WAVE = np.sin(2 * np.pi * 158 * np.arange(SWEEP.size) / FS)
MIDDLE = np.r_[SWEEP[0], (SWEEP[1:] + SWEEP[:-1]) / 2]


def run(block, x=SWEEP, **rows):
    return played(block, {"x": x, **rows}, fs=FS)


@pytest.mark.parametrize(
    ("kind", "error"),
    [
        (None, 0.0005),
        ("polynomial", 0.0005),
        ("cubic", 0.0045),
        ("pchip", 0.019),
        ("linear", 0.034),
    ],
)
def test_displacement_is_constant_between_the_knots(kind, error):
    assert np.abs((run(equalize(X, PROFILE, kind=kind)) * mode(MIDDLE)) - 1).max() <= error
    knots = run(equalize(X, PROFILE, kind=kind), np.repeat(KNOTS, 2))[1::2]
    np.testing.assert_allclose(knots * mode(KNOTS), 1, atol=1e-12)


@pytest.mark.parametrize(("n", "meant"), [(6, "polynomial"), (7, "cubic")])
def test_up_to_six_knots_get_a_polynomial_and_more_a_spline(n, meant):
    knots = np.linspace(0.0, 0.1, n)
    assert_same(
        run(equalize(X, (knots, mode(knots)))), run(equalize(X, (knots, mode(knots)), kind=meant))
    )


def test_outside_the_table():
    x, edge = np.repeat([-0.02, 0.0, 0.05, 0.1, 0.13], 2), 1 / mode(0.0)
    for outside, beyond in (("hold", edge), ("zero", 0.0)):
        y = run(equalize(X, PROFILE, outside=outside), x)[1::2]
        np.testing.assert_allclose(y, [beyond, edge, 1, edge, beyond])
    proc = stimlib.compile(Scene({"y": equalize(X, PROFILE, outside="error")}), FS)
    proc.process(np.array([[0.0, 0.1, 0.1, 0.11, 0.05]]))
    assert proc.fault == ("y", 3)


def test_a_place_off_contact_is_no_fault():
    """Not the 0 that nobody touches, nor what the device says there."""
    gain = equalize(X, (KNOTS + 0.01, mode(KNOTS)), outside="error", contact=Input("c"))
    y = run(gain, [0.0, 0.2, 0.06, 0.06, 0.2], c=[0, 0, 1, 1, 0])
    np.testing.assert_allclose(y[2:4], 1.0)


def test_clip_holds_each_sample_at_the_limit():
    v, block = 375 * WAVE, equalize(X, PROFILE, 400.0, signal=VOLTS)
    free, y = run(equalize(X, PROFILE, signal=VOLTS), v=v), run(block, v=v)
    np.testing.assert_array_equal(y, np.clip(free, -400, 400))
    assert str(block.dim) == "V" and 0 < np.sum(np.abs(y) >= 400) < y.size  # how to count them


@pytest.mark.parametrize("A", [7.5, 3.0])
def test_scale_reduces_everything_alike(A):
    peak, v = constant(50.0) * Param("A", A, "V"), 50 * A * WAVE
    y = run(equalize(X, PROFILE, 400.0, "scale", signal=VOLTS, peak=peak), v=v)
    factor = min(1.0, 400 / (50 * A / mode(0.0)))
    free = run(equalize(X, PROFILE, signal=VOLTS), v=v)
    np.testing.assert_allclose(y, factor * free, rtol=1e-9, atol=1e-9)
    assert np.abs(y).max() <= 400


def test_scale_follows_a_live_amplitude_and_may_be_silent():
    A = Param("A", 0.0, "V")
    block = equalize(X, PROFILE, 400.0, "scale", signal=50 * A, peak=50 * A)
    proc, edge = stimlib.compile(Scene({"y": block}), FS), np.zeros((1, 3))
    for A, wanted in ((0.0, 0.0), (1.0, 50 / mode(0.0)), (100.0, 400.0)):
        proc.set("A", A, ramp=0)
        np.testing.assert_allclose(proc.process(edge), wanted, rtol=1e-9)
    A, limit = Param("A", 0.0), Param("limit", 1.0)
    block = equalize(X, PROFILE, limit, "scale", signal=A, peak=abs(A))
    proc = stimlib.compile(Scene({"y": block}), FS)
    for most, A, wanted in ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (9.0, 1.0, 1 / mode(0.0))):
        proc.set("limit", most, ramp=0)
        proc.set("A", A, ramp=0)
        np.testing.assert_allclose(proc.process(edge), wanted, rtol=1e-9)
    y = run(equalize(X, PROFILE, 400.0, "scale", signal=constant(-375.0, "V")))
    assert y.min() == pytest.approx(-400.0) and np.abs(y).max() <= 400, "a number is its own peak"


ROWS = "".join(f"{float(k)!r},{float(d)!r}\n" for k, d in zip(*PROFILE, strict=True))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x,y\na,b\n1,2\n", "line 2"),
        ("0,1\n0.1\n", "line 2"),
        ("", "at least 2"),
        ("0,1,2\n1,1,1\n", "line 2"),
        (None, "cannot read"),
    ],
)
def test_profiles_from_a_file(text, says, tmp_path):
    path = tmp_path / "profile.csv"
    for good in (ROWS, "# measured by LDV\nposition_m,displacement_m\n\n" + ROWS):
        path.write_text(good)
        assert_same(run(equalize(X, path)), run(equalize(X, PROFILE)))
        assert_same(run(equalize(X, str(path))), run(equalize(X, PROFILE)))
    path.unlink() if text is None else path.write_text(text)
    refuses(lambda: equalize(X, path), says)


# Noise over place ---------------------------------------------------------------------
LOW, HIGH = 5.0, 5e4  # four decades, of the wavelengths by default


def noise(x, slope=1.0, seed=4, **how):
    return played(spatial_noise(X, slope, seed, **how), x, fs=FS)


def test_a_place_has_its_bits_whatever_the_way_there():
    """Standing and moving, after any places before, in any processor, in any run."""
    rng = np.random.default_rng(1)
    places, order = rng.uniform(-0.5, 0.5, 300), rng.permutation(300)
    ends = np.stack([places, places + rng.choice([0.0, 1e-7, 3e-5, -4e-4, 0.02], 300)], axis=1)
    want = noise(ends.ravel())[1::2]
    np.testing.assert_array_equal(noise(ends[order].ravel())[1::2], want[order])
    back = noise(ends[:, ::-1].ravel())[1::2]
    np.testing.assert_array_equal(back, want)  # the mean over a way is that of the way back
    proc = stimlib.compile(Scene({"y": spatial_noise(X, 1.0, 4)}), 44100.0, seed=99)
    np.testing.assert_array_equal(proc.process(ends.reshape(1, -1))[0, 1::2], want)
    assert not np.any(noise(ends.ravel(), seed=5)[1::2] == want)


# 0.04 to 16 m/s: with slope 1, four decades
@pytest.mark.parametrize(
    ("step", "slope"),
    [(5e-6, 1.0), (5e-5, 1.0), (5e-4, 1.0), (2e-3, 1.0), (5e-5, 0.5), (2e-4, 3.0)],
)
def test_its_spectrum_is_the_law(step, slope):
    """S(f) sinc(f step)^2, whose power between the wavelengths is 1, within 0.5 dB in
    each octave.
    """
    n = 1 << 16
    window = np.hanning(n)
    y = np.array([noise(step * np.arange(n) - 3.0, slope, seed) for seed in (1, 2)])
    power = np.mean(np.abs(np.fft.rfft(y * window)) ** 2, axis=0)
    f = np.fft.rfftfreq(n, step)
    edges = np.geomspace(LOW, HIGH, 10_001)
    law = np.where(f > 0, f, 1.0) ** -slope * np.sinc(f * step) ** 2
    law /= np.trapezoid(edges**-slope, edges)
    psd, top = 2 * step / np.sum(window**2) * power, min(0.35 / step, HIGH)
    for a in top / 2.0 ** np.arange(1, np.log2(top / max(1000 * f[1], LOW))):
        band = (f >= a) & (f < 2 * a)
        assert abs(10 * np.log10(np.mean(psd[band] / law[band]))) < 0.5, a


@pytest.mark.parametrize(
    ("slope", "most"), [(0.5, 0.2), (1.0, 0.05), (2.0, 0.1), (3.0, 0.25), (4.0, 0.35)]
)
def test_its_octaves_are_as_near_to_the_law_as_is_said(slope, most):
    assert octaves(slope, LOW, HIGH).error_db < most


def test_its_lattice_has_no_period_and_is_normal():
    cells, U64 = np.arange(100_000, dtype=np.uint64), np.uint64
    with np.errstate(over="ignore"):
        z = np.ravel(lattice(U64(3), cells - U64(50_000)))
        far = np.ravel(lattice(U64(3), cells[:100] + U64(2**32)))
    assert not np.isin(far, z).all()
    assert abs(z.mean()) < 0.01 and abs(z.var() - 1) < 0.02 and abs((z**4).mean() - 2.7) < 0.08
    assert abs(np.corrcoef(z[:-1], z[1:])[0, 1]) < 0.01


def test_over_a_closed_way_it_does_no_work():
    x = np.cumsum(np.random.default_rng(2).standard_normal(20_000)) * 1e-4
    x -= np.linspace(x[0], x[-1], x.size)
    force = played(grating(X, RIBS, "N"), x, fs=FS)
    assert abs(force[1:] @ np.diff(x)) < 1e-13 < 1e-6 < np.abs(force[1:]) @ np.abs(np.diff(x))


REFUSED = [
    (lambda: bump(U, duty=0.0), "duty"),
    (lambda: bump(U, duty=-0.1), "duty"),
    (lambda: bump(U, duty=1.0001), "duty"),
    (lambda: bump(U, duty=Param("d", 0.0)), "duty"),
    (lambda: bump(U, duty=Param("d", 1.5)), "duty"),
    (lambda: bump(U, duty=float("nan")), "not finite"),
    (lambda: bump(U, "triangle"), "square, sine, sawtooth, half_sine"),
    (lambda: bump(U, sampling="blep"), "area, point"),
    (lambda: bump(U, [1.0]), "at least 2 values"),
    (lambda: bump(U, []), "at least 2 values"),
    (lambda: bump(U, [[0, 1], [1, 0]]), "at least 2 values"),
    (lambda: bump(U, [0, 1.1]), "must lie in 0 .. 1"),
    (lambda: bump(U, [-0.1, 1]), "must lie in 0 .. 1"),
    (lambda: bump(U, [0, np.nan]), "is not finite"),
    (lambda: bump(Input("x", "m")), "divide the position by the wavelength", UnitError),
    (lambda: bump(U, duty=Param("d", 0.5, "m")), "duty", UnitError),
    *(
        (lambda profile=profile: equalize(X, profile), says)
        for profile, says in [
            (([0, 1, 2], [1, 0, 1]), "displacement 1 = 0 must be above 0"),
            (([0, 1, 2], [1, 1, -1]), "displacement 2 = -1 must be above 0"),
            (([0, 1, 2], [1, np.nan, 1]), "displacement 1 is not finite"),
            (([0, np.inf, 2], [1, 1, 1]), "knot 1 is not finite"),
            (([0, 2, 1], [1, 1, 1]), "knot 2 does not"),
            (([0, 1, 1], [1, 1, 1]), "knot 2 does not"),
            (([0, 1], [1, 1, 1]), "as many displacements as knots"),
            (([0], [1]), "at least 2"),
            ([1, 2, 3], r"\(knots, displacement\)"),
            (7.0, r"\(knots, displacement\)"),
            ((["a"], ["b"]), "rows of numbers"),
            (
                ([0, 1, 2, 3], [10, 0.1, 0.1, 10]),
                "between its knots the polynomial displacement falls to",
            ),
        ]
    ),
    *(
        (lambda profile=profile, words=words: equalize(X, profile, **words), says, error)
        for profile, words, error, says in [
            (PROFILE, {"limit": 0.0}, BadValue, "limit"),
            (PROFILE, {"limit": -1.0}, BadValue, "limit"),
            (PROFILE, {"limit": Param("limit", -1.0)}, BadValue, "limit"),
            (PROFILE, {"limit": 1.0, "headroom": "compress"}, BadValue, "clip, scale"),
            (PROFILE, {"outside": "extrapolate"}, BadValue, "hold, zero, error"),
            (PROFILE, {"kind": "spline"}, BadValue, "kind"),
            (PROFILE, {"headroom": "scale"}, BadValue, "needs a limit"),
            (PROFILE, {"limit": 1.0, "headroom": "scale", "signal": Input("v")}, BadValue, "peak="),
            (PROFILE, {"limit": constant(400.0, "V"), "signal": Input("i", "A")}, UnitError, "V"),
            (
                (np.arange(9.0), 2 + np.cos(np.arange(9.0))),
                {"kind": "polynomial"},
                BadValue,
                "at most 8",
            ),
        ]
    ),
    *(
        (lambda words=words: spatial_noise(X, **words), says)
        for words, says in [
            (dict(slope=0.4), "slope = 0.4 must be from 0.5 to 4"),
            (dict(slope=4.1), "slope = 4.1"),
            (dict(seed=-1), "seed = -1 must be a whole number"),
            (dict(seed=1.5), "seed"),
            (dict(seed=True), "seed = True"),
            (dict(shortest=0.0), "shortest = 0.0 must be a number above 0"),
            (dict(shortest=0.2), "longest = 0.2 must be above shortest = 0.2"),
            (dict(shortest=1e-11), "at most 1e"),
            (dict(longest=np.nan), "longest"),
        ]
    ),
    *(
        (lambda parts=parts: grating(X, parts), says)
        for parts, says in [
            ([], "rows of three"),
            ((1e-3, 1.0, 0.0), "rows of three"),
            ([(1e-3, 1.0)], "rows of three"),
            ([(1e-3, 1.0, 0.0), (0.0, 1.0, 0.0)], "wavelength = 0 of part 1 must be above 0"),
            ([(1e-3, np.nan, 0.0)], "is not finite"),
            ([(1e-3, 1.0, 0.0), (1e-3, 1.0)], "must be numbers"),
            (np.ones((10_001, 3)), "limits.table_knots"),
        ]
    ),
    (grating(U, [(1e-320, 1.0, 0.0)]), "too short"),
]


@pytest.mark.parametrize("given", REFUSED, ids=lambda given: given[1])
def test_what_makes_no_sense_is_refused(given):
    refuses(*given)
