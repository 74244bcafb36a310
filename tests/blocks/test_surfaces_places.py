"""Surfaces: the same place is the same bits, and spectra and means are those of the
law, by another route.
"""

import numpy as np
import pytest
from laws import cut_at, lawful, played, run

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import grating, spatial_noise
from stimlib.blocks.surfaces import lattice
from stimlib.design.noise import octaves
from stimlib.errors import BadValue

FS = 8000.0
LOW, HIGH = 5.0, 5e4  # four decades, of the wavelengths by default


def noise(x, slope=1.0, seed=4, **how):
    return played(spatial_noise(Input("x", "m"), slope, seed, **how), x, fs=FS)


# Noise over place ---------------------------------------------------------------------
def test_a_place_has_its_bits_whatever_the_way_there():
    """Standing and moving, after any places before, in any processor, in any run."""
    rng = np.random.default_rng(1)
    ends = np.stack(
        [c := rng.uniform(-0.5, 0.5, 300), c + rng.choice([0.0, 1e-7, 3e-5, -4e-4, 0.02], 300)],
        axis=1,
    )
    want = noise(ends.ravel())[1::2]
    order = rng.permutation(300)
    np.testing.assert_array_equal(noise(ends[order].ravel())[1::2], want[order])
    back = noise(ends[:, ::-1].ravel())[1::2]
    np.testing.assert_array_equal(back, want)  # the mean over a way is that of the way back
    proc = stimlib.compile(Scene({"y": spatial_noise(Input("x", "m"), 1.0, 4)}), 44100.0, seed=99)
    np.testing.assert_array_equal(run(proc, ends.reshape(1, -1), cut_at(600, 2))[0, 1::2], want)
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
    n = 1 << 17
    window = np.hanning(n)
    y = [noise(step * np.arange(n) - 3.0, slope, seed) for seed in (1, 2)]
    psd = np.mean(
        [2 * step / np.sum(window**2) * np.abs(np.fft.rfft(v * window)) ** 2 for v in y], axis=0
    )
    f = np.fft.rfftfreq(n, step)
    law = np.where(f > 0, f, 1.0) ** -slope * np.sinc(f * step) ** 2
    law /= (
        np.log(HIGH / LOW)
        if slope == 1
        else (HIGH ** (1 - slope) - LOW ** (1 - slope)) / (1 - slope)
    )
    top = min(0.35 / step, HIGH)
    octave = top / 2.0 ** np.arange(1, np.log2(top / max(1000 * f[1], LOW)))
    for a in octave:
        band = (f >= a) & (f < 2 * a)
        assert abs(10 * np.log10(np.mean(psd[band] / law[band]))) < 0.5, a


def test_its_octaves_are_as_near_to_the_law_as_is_said():
    for slope, most in ((0.5, 0.2), (1.0, 0.05), (2.0, 0.1), (3.0, 0.25), (4.0, 0.35)):
        assert octaves(slope, LOW, HIGH).error_db < most


# the last one: 1.1 cells of the coarsest, so up to 3
@pytest.mark.parametrize("way", [1e-9, 3e-6, 4e-5, 1e-3, 2.23e-2])
def test_it_is_the_mean_of_its_splines(way):
    """Gauss's rule in each cell, from the published generator; up to a few cells of
    each octave in a sample.
    """
    x = np.linspace(-0.02, 0.02, 200)
    x = np.stack([x, x + way * np.cos(np.arange(200))], axis=1).ravel()
    block = spatial_noise(Input("x", "m"), 2.0, 6, shortest=1e-4, longest=0.03)
    lawful(block, FS, x=x)


def test_its_lattice_has_no_period_and_is_normal():
    with np.errstate(over="ignore"):
        z = np.ravel(lattice(np.uint64(3), np.arange(100_000, dtype=np.uint64) - np.uint64(50_000)))
        far = np.ravel(lattice(np.uint64(3), np.arange(100, dtype=np.uint64) + np.uint64(2**32)))
    assert not np.isin(far, z[100_000:100_200]).all()
    assert abs(z.mean()) < 0.01 and abs(z.var() - 1) < 0.02 and abs((z**4).mean() - 2.7) < 0.08
    assert abs(np.corrcoef(z[:-1], z[1:])[0, 1]) < 0.01


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (dict(slope=0.4), "slope = 0.4 must be from 0.5 to 4"),
        (dict(slope=4.1), "slope = 4.1"),
        (dict(seed=-1), "seed = -1 must be a whole number"),
        (dict(seed=1.5), "seed"),
        (dict(seed=True), "seed = True"),
        (dict(shortest=0.0), "shortest = 0.0 must be above 0"),
        (dict(shortest=0.2), "longest = 0.2 must be above shortest = 0.2"),
        (dict(shortest=1e-11), "at most 1e"),
        (dict(longest=np.nan), "longest"),
    ],
)
def test_bad_noise_is_refused(given, said):
    with pytest.raises(BadValue, match=said):
        spatial_noise(Input("x", "m"), **given)


# Gratings -----------------------------------------------------------------------------
RIBS = [(2e-3, 0.2, 0.4), (0.3e-3, -0.05, 2.0), (0.11e-3, 0.01, 0.0)]


@pytest.mark.parametrize("speed", [0.0, 1e-4, 0.03, 0.8, 5.0])
def test_a_grating_is_the_mean_of_its_sinusoids(speed):
    x = 0.3 + speed * np.sin(np.arange(300)) / FS
    lawful(grating(Input("x", "m"), RIBS), FS, x=x)


def test_over_a_closed_way_it_does_no_work():
    x = np.cumsum(np.random.default_rng(2).standard_normal(20_000)) * 1e-4
    x -= np.linspace(x[0], x[-1], x.size)
    force = played(grating(Input("x", "m"), RIBS, "N"), x, fs=FS)
    assert abs(force[1:] @ np.diff(x)) < 1e-13 < 1e-6 < np.abs(force[1:]) @ np.abs(np.diff(x))


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ([], "rows of three"),
        ((1e-3, 1.0, 0.0), "rows of three"),
        ([(1e-3, 1.0)], "rows of three"),
        ([(1e-3, 1.0, 0.0), (0.0, 1.0, 0.0)], "wavelength = 0 of part 1 must be above 0"),
        ([(1e-3, np.nan, 0.0)], "is not finite"),
        ([(1e-3, 1.0, 0.0), (1e-3, 1.0)], "must be numbers"),
        (np.ones((10_001, 3)), "limits.table_knots"),
    ],
)
def test_bad_gratings_are_refused(parts, said):
    with pytest.raises(BadValue, match=said):
        grating(Input("x", "m"), parts)
    with pytest.raises(BadValue, match="too short"):
        stimlib.compile(Scene({"y": grating(Input("x"), [(1e-320, 1.0, 0.0)])}), FS)


# Both ---------------------------------------------------------------------------------
@pytest.mark.parametrize("block", [spatial_noise(Input("x", "m")), grating(Input("x", "m"), RIBS)])
def test_what_is_not_a_number_is_a_fault_and_each_is_half_a_sample_late(block):
    proc = stimlib.compile(Scene({"y": block}), FS, "python")
    proc.process(np.array([[0.0, np.nan, 0.0]]))
    assert proc.fault == ("y", 1) and proc.latency["y", "x"] == (0.5, 0.5)
