"""Resonances from sweeps that are known, with noise that is known; and sweeps that are
none.
"""

from dataclasses import replace

import numpy as np
import pytest
from laws import STRESS
from refusals import refused
from scipy.signal import chirp, cont2discrete, lfilter

from stimlib.errors import BadValue, RecordingError
from stimlib.plate import Plate, Resonance, drift, fit_frame, identify, read_sweep

FS, F0, Q = 2000, 158.0, 10.0
SWEEPS = 1000 if STRESS else 30


def sweep(f0=F0, q=Q, seconds=2.0, rest=0.4, low=60.0, high=320.0, velocity=False):
    """A drive, and what a mode answers to straight lines between its samples."""
    t = np.arange(int(FS * seconds)) / FS
    u = np.r_[chirp(t, low, seconds, high), np.zeros(int(FS * rest))]
    w = 2 * np.pi * f0
    b, a, _ = cont2discrete(([w * w, 0] if velocity else [w * w], [1, w / q, w * w]), 1 / FS, "foh")
    return u, lfilter(b[0], a, u)


def test_what_is_measured_is_found_within_what_is_said():
    """40 dB of signal over noise: 0.05 % and 3 %; of all intervals 95 in 100 hold the
    truth.
    """
    u, y = sweep()
    rng, hits, seen, noise = np.random.default_rng(5), [], [], np.std(y) / 100
    for _ in range(SWEEPS):
        r = identify(u, y + noise * rng.standard_normal(y.size), FS)
        assert abs(r.freq / F0 - 1) < 5e-4 and abs(r.q / Q - 1) < 0.03
        seen.append((r.freq, r.q, r.freq_sd, r.q_sd))
        hits += [
            r.freq_interval[0] < F0 < r.freq_interval[1],
            r.q_interval[0] < Q < r.q_interval[1],
        ]
    slack = 0.01 if SWEEPS > 100 else 0.05
    assert 0.95 - slack <= np.mean(hits) <= 0.95 + slack
    scatter, told = np.std(seen, axis=0)[:2], np.mean(seen, axis=0)[2:]
    np.testing.assert_allclose(scatter / told, 1.0, atol=0.4)
    assert np.ptp(r.freq_interval) == pytest.approx(2 * 1.97 * r.freq_sd, rel=0.01)
    # four half widths on each side, two numbers each; two of pole, ten of one point
    assert r.dof == pytest.approx(2 * (2 * 4 * F0 / (2 * Q) * u.size / FS) - 12, abs=2)


def test_many_points_give_a_shape_and_a_better_frequency():
    u, y = sweep(velocity=True)
    shape = np.array([0.2, -1.0, 0.6])
    rng, noise = np.random.default_rng(2), np.std(y) / 30
    rows = 3e-6 * shape[:, None] * y + 3e-6 * noise * rng.standard_normal((3, y.size))
    r = identify(u, rows, FS, band=(100, 220), quantity="velocity")
    np.testing.assert_allclose(r.shape / r.shape[1], shape / shape[1], atol=5 * r.shape_sd.max())
    np.testing.assert_allclose(np.abs(r.gain), 3e-6 * np.abs(shape), rtol=0.05, atol=1e-7)
    assert r.freq_sd < identify(u, rows[0], FS, quantity="velocity").freq_sd
    assert 5e-4 < r.shape_sd[0] < 0.02


def test_the_points_of_a_shape_scatter_as_stated():
    """Also those that are nearly as large as the one that they are compared with."""
    u, y = sweep()
    shape = np.array([[1.0], [-0.95], [0.9], [0.3]])
    rng, noise, found = np.random.default_rng(3), np.std(y) / 30, []
    for _ in range(min(SWEEPS, 200)):
        r = identify(u, shape * y + noise * rng.standard_normal((4, y.size)), FS)
        found.append((r.shape, r.shape_sd))
    of_shape, told = np.swapaxes(found, 0, 1)
    assert not told[:, 0].any() and of_shape[:, 0] == pytest.approx(1.0, rel=1e-15)
    off = (of_shape - shape[:, 0])[:, 1:] / told[:, 1:]
    assert np.sqrt(np.mean(off**2)) == pytest.approx(1.0, abs=0.1 if SWEEPS > 100 else 0.2)


def test_a_delay_between_the_recordings_changes_no_frequency():
    u, y = sweep(rest=0.5)
    assert identify(u, y, FS).delay == 0.0
    for samples in (2, 40):  # the first of them goes into the rest; the second would make q 12
        late = identify(u, np.roll(y, samples), FS)
        assert late.freq == pytest.approx(F0, rel=1e-6) and late.q == pytest.approx(Q, rel=1e-5)
    assert late.delay == pytest.approx(40 / FS, abs=2e-3) and late.gain[0] == pytest.approx(
        0.98, abs=0.12
    )
    # the drive's way is the longer one
    assert identify(np.roll(u, 40), y, FS).delay == pytest.approx(-40 / FS, abs=2e-3)
    noise = np.std(y) / 30 * np.random.default_rng(0).standard_normal(y.size)
    # the delay is seen through 3 % of noise: not seen, q is 11.6
    noisy = identify(u, np.roll(y, 40) + noise, FS)
    assert noisy.delay > 0.01 and noisy.q == pytest.approx(Q, abs=4 * noisy.q_sd)
    two = np.array([y, 0.9 * np.roll(y, 2)])
    refused(RecordingError, "point 1 answers out of phase", identify, u, two, FS)


def test_a_bias_of_the_drive_and_an_offset_and_drift_of_the_sensor_change_nothing():
    u, y = sweep()
    alone, biased = identify(u, y, FS), identify(u + 10, y + 10 * np.ptp(y), FS)
    assert (biased.freq, biased.q) == pytest.approx((alone.freq, alone.q), rel=1e-9)
    drifting = identify(u, y + np.ptp(y) * np.linspace(0, 1, y.size), FS)
    assert drifting.freq == pytest.approx(F0, abs=4 * drifting.freq_sd)


def test_a_file_is_read(tmp_path):
    u, y = sweep()
    t = np.arange(u.size) / FS
    np.savez(tmp_path / "sweep.npz", t=t, volt=u, centre=y)
    got = read_sweep(tmp_path / "sweep.npz", "volt", ["centre"])
    assert identify(*got).freq == pytest.approx(F0, rel=1e-5)
    assert read_sweep(tmp_path / "sweep.npz", "volt", "centre").response.shape == (1, u.size)
    ms = {"t": 1000 * t, "mV": 1000 * u, "y": y}
    drive, response, fs = read_sweep(ms, "mV*1e-3", "y*2 + 1", time="t*1e-3")
    np.testing.assert_allclose([drive, response[0]], [u, 2 * y + 1], rtol=1e-12)
    assert fs == pytest.approx(FS) and read_sweep(uneven(1.008), "volt", ["y"]).fs < 1000
    for says, source, columns in (
        ("time needs column seconds", ms, {"time": "seconds"}),
        ("t, mV, y", ms, {"response": "edge"}),
        (r'time="t\*1e-3"', ms, {}),
        ("equal steps", uneven(1.012), {"drive": "volt"}),
        ("row 0, column mV: there is no number", ms | {"mV": ["", *u[1:]]}, {}),
        ("row 2, column mV: nan is not finite", ms | {"mV": np.where(t == t[2], np.nan, u)}, {}),
    ):
        given = {"drive": "mV", "response": "y"} | columns
        refused(RecordingError, says, read_sweep, source, **given)


def uneven(last):
    """A recording whose last step is a little longer than the others, of 1 ms."""
    u, y = sweep()
    return {"t": 1e-3 * np.cumsum(np.r_[np.ones(50), last]), "volt": u[:51], "y": y[:51]}


@pytest.mark.parametrize(
    ("made", "match"),
    [
        (lambda: np.clip(sweep(), -2.0, 2.0), "clipped"),
        (lambda: sweep(rest=0.0, high=170.0), "misses|too short"),
        (lambda: sweep(q=100.0, seconds=1.0, rest=1.5), "too short"),
        (lambda: sweep(low=60.0, high=120.0), "misses"),
        (lambda: sweep(low=220.0, high=500.0), "misses"),
        (lambda: (sweep()[0], np.zeros(4800)), "never changes"),
    ],
)
def test_sweeps_that_tell_nothing_are_told(made, match):
    refused(RecordingError, match, identify, *made(), FS)


U, R = sweep()


@pytest.mark.parametrize(
    ("ask", "match"),
    [
        (lambda: identify(U, R[:-1], FS), "same samples"),
        (lambda: identify(U, R, FS, quantity="force"), "displacement, velocity"),
        (lambda: identify(U, R * np.nan, FS), "must be finite"),
        (lambda: identify([], [], FS), "same samples"),
        (lambda: identify(U, 1j * R, FS), "identify: response = "),
        (lambda: identify(U, R, 0.0), "fs = 0.0"),
        (lambda: identify(U, R, FS, band=(200, 100)), "the lower one first"),
        (lambda: identify(U, R, "2000"), "fs = '2000'"),
        (lambda: identify(U, R, FS, band=150), "band = 150 must be a tuple"),
        (lambda: identify(U[:, None], R[:, None], FS), "of 1 sample; .* transpose them"),
        (lambda: drift([], []), "at least three"),
        (lambda: drift([158.0] * 3, [1.0, 2.0, 3.0]), "must be a list .a Resonance"),
        (lambda: drift([], ["warm"]), "must be a list of numbers"),
        *(
            (
                lambda k=k: fit_frame(
                    replace(Plate.paper(), clamp_stiffness=k), {0: 158.0}, ("clamp_stiffness",)
                ),
                "no start for a search",
            )
            for k in (None, 0.0)
        ),
        (lambda: fit_frame(Plate.paper(), {0: 158.0, 1: 246.0}, ("E", "E")), "at most as many"),
        (lambda: fit_frame(Plate.paper(), {0: 158.0}, ("E", "in_plane_load")), "at most as many"),
        (lambda: fit_frame(Plate.paper(), {0: 158.0}, ("colour",)), "colour"),
        (lambda: fit_frame(Plate.paper(), [158.0], ("E",)), "measured = .* must be a dict"),
        (lambda: fit_frame(Plate.paper(), {40: 158.0}, ("E",)), "ask for 1 to 36"),
        (
            lambda: fit_frame(replace(Plate.paper(), terms=4), {0: 1e-3}, ("E",)),
            "count them from 0",
        ),
        (lambda: drift([Resonance(1.0, 1.0, 1.0, 1.0, U, U, U, 9)] * 2, [1.0, 2.0]), "2 sweeps"),
    ],
)
def test_arguments_that_make_no_sense_are_told(ask, match):
    refused(BadValue, match, ask)


@pytest.mark.parametrize(("size", "cov"), [(10.0, "unscaled"), (0.1, True)])
def test_a_drift_is_followed(size, cov):
    """As a straight line through the frequencies, each by its own deviation, and with
    that of the line where they scatter by more.
    """
    f, sd, one = [160.0, 158.1, 157.0, 155.0], size * np.array([0.1, 0.3, 0.1, 0.6]), np.ones(1)
    sweeps = [Resonance(a, 10.0, s, 0.1, one, one, one, 99) for a, s in zip(f, sd, strict=True)]
    T = np.array([20.0, 21.0, 22.0, 24.0])
    line = drift(sweeps, T)
    (slope, level), cov = np.polyfit(T - line.at, f, 1, w=1 / sd, cov=cov)
    wanted = [slope, level, *np.sqrt(np.diag(cov))]
    np.testing.assert_allclose([line.slope, line.freq, line.slope_sd, line.freq_sd], wanted)
    assert line(23.0) == pytest.approx(level + slope * (23.0 - line.at))


def test_a_frame_is_found_by_its_modulus_and_its_load():
    plate = replace(Plate.paper(), terms=6)
    truth = replace(plate, E=1.1 * plate.E, in_plane_load=-1500.0)
    freq = truth.modes(4)
    found = fit_frame(plate, {0: freq[0], 1: freq[1], 3: freq[3]}, ("E", "in_plane_load"))
    assert (found.plate.E, found.plate.in_plane_load) == pytest.approx((truth.E, -1500.0), rel=1e-6)
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-6)
