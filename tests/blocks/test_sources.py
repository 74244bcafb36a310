"""Oscillators, sweeps, pulse trains and recordings against integrals, fractions and
many digits.
"""

from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
from laws import played

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnitError, blocks as b
from stimlib.blocks.oscillators import increment
from stimlib.blocks.sources import Chirp
from stimlib.design.filters import resampled

X = Input("x")


WAVES = {  # of the phase in turns
    "triangle": lambda u: 1 - 4 * np.abs((u + 0.25) % 1 - 0.5),
    "sawtooth": lambda u: 2 * (u % 1) - 1,
    "square": lambda u: np.where(u % 1 < 0.3, 1.0, -1.0),
    "pulse": lambda u: np.where(u % 1 < 0.3, 1.0, 0.0),
}


@pytest.mark.parametrize("waveform", WAVES)
@pytest.mark.parametrize("freq", [3.7, 158.3, 449.0])
def test_a_sample_is_the_mean_over_the_period_around_it(waveform, freq):
    y = played(b.oscillator(freq, waveform, 0.3, phase=1.0), 60)
    fine = (np.arange(4000) + 0.5) / 4000 - 0.5
    u = 1 / (2 * np.pi) + freq / 1000 * (np.arange(60)[:, None] + fine)
    np.testing.assert_allclose(y, WAVES[waveform](u).mean(axis=1), rtol=0, atol=1e-3)
    assert np.abs(y).max() <= 1.0


def test_what_does_not_move_stays():
    assert played(b.oscillator(0.0, "square", phase=4.0), 5).tolist() == [-1.0] * 5
    assert played(b.oscillator(0.0, "sawtooth", phase=np.pi), 5).tolist() == [0.0] * 5
    assert played(b.oscillator(0.0, "square", phase=1.0), 2).tolist() == [1.0] * 2
    np.testing.assert_allclose(
        played(b.oscillator(0.0, "triangle", phase=np.pi / 4), 2), 0.5, rtol=1e-15
    )


def test_area_takes_the_aliases_of_a_sawtooth_down():
    """4 dB of the worst, 18 of the worst below 1 kHz; of 200 Hz at 8 kHz: see the
    docstring.
    """
    n, m = 1 << 14, 411
    y = played(b.oscillator(8000 * m / n, "sawtooth", phase=2.0), n, fs=8000)
    naive = WAVES["sawtooth"](np.arange(n) * m / n + 1 / np.pi)
    bins = np.arange(n // 2 + 1)
    levels = []
    for wave in (y, naive):
        Y = np.abs(np.fft.rfft(wave))
        alias = 20 * np.log10(Y / Y[m])
        alias[(bins % m == 0) | (bins == 0)] = -300
        levels.append((alias.max(), alias[bins * 8000 / n < 1000].max()))
    assert levels[1][0] - levels[0][0] > 3.5 and levels[1][1] - levels[0][1] > 15


def test_a_phase_is_kept_for_a_day():
    """The word added at each sample is the nearest to the exact one: 1e-9 rad after 24
    h at 48 kHz.
    """
    p, _ = b.oscillator(158.3, "square").design(48000)
    drift = (Fraction(int(increment(p, 158.3)), 2**64) - Fraction(158.3) / 48000) * 86400 * 48000
    assert abs(2 * np.pi * float(drift)) < 1e-9


@pytest.mark.parametrize(("kind", "tol"), [("linear", 1e-14), ("exponential", 1e-8)])
def test_the_phase_of_an_hour_of_sweep(kind, tol):
    fs, seconds = 48000, 3600.0
    p, _ = b.chirp(20, 2000, seconds, kind).design(fs)
    for n in (1, 12345, 172_799_999):
        with mp.workdps(40):
            t = mp.mpf(n) / fs
            turns = 20 * t + mp.mpf(1980) / 7200 * t * t
            if kind == "exponential":
                c = mp.log(100) / 3600
                turns = 20 * mp.expm1(c * t) / c
            wanted = float(mp.sin(2 * mp.pi * turns))
        assert abs(Chirp.step(p, (), n / fs)[0] - wanted) < tol
    assert Chirp.step(p, (), 3600.0)[0] == 0.0


@pytest.mark.parametrize(
    "source", [b.chirp(400, 400, 9.0), b.playback([1.0], 1000, loop=True), b.every(0.001)]
)
def test_nothing_sounds_before_sample_0(source):
    """A filter of a source runs before sample 0."""
    assert played(b.moving_average(source, 0.01), 1)[0] == played(source, 1)[0] / 10


def test_a_duty_that_is_a_signal_is_held_and_told_where_it_is_no_number():
    from stimlib.blocks.oscillators import Oscillator

    y = played(b.oscillator(100, "pulse", X), np.repeat([1.0, 7.0, -1.0], 3))
    np.testing.assert_allclose(y, np.repeat([1.0, 1.0, 0.0], 3), atol=1e-13)
    p, s = b.oscillator(100, "pulse", X).design(1000)
    with np.errstate(all="ignore"):
        assert np.isnan(Oscillator.step(p, s, 0.0, np.nan)[0])


def test_a_sweep_may_stand():
    np.testing.assert_allclose(
        played(b.chirp(50, 50, 1.0, "exponential"), 40),
        np.sin(np.pi * np.arange(40) / 10),
        atol=1e-14,
    )


def test_jittered_pulses_keep_their_order_and_none_is_lost():
    """Each in its own period, where its jitter says."""
    jitter = np.random.default_rng(0).uniform(-0.45, 0.45, 10_000)
    y = played(b.pulse_train(Param("rate", 40.0, "Hz"), X), jitter)
    assert y.sum() == 400
    period = np.arange(1, 400) * 25
    at = np.repeat(np.arange(10_000), y.astype(int))
    # read at the sample that ends the period before
    wanted = np.floor(period + 25 * (0.5 + jitter[period - 1]))
    assert np.abs(at[1:] - wanted).max() <= 1
    regular = np.flatnonzero(played(b.pulse_train(30.0), 1000))
    assert regular.tolist() == np.floor((np.arange(30) + 0.5) * 1000 / 30).tolist()


@pytest.mark.parametrize("jitter", [-0.5, -1.0])
def test_an_event_at_the_first_instant_of_each_period_is_there_once(jitter):
    """Periods of 8 samples, whose phases begin with exactly 0."""
    y = played(b.pulse_train(1000.0, jitter), 100, fs=8000)
    np.testing.assert_array_equal(y[8:], np.arange(8, 100) % 8 == 0)


def test_a_recording_is_played_once_or_again_and_again():
    x = np.array([1.0, -2.0, 3.0])
    assert played(b.playback(x, rate=1000), 6).tolist() == [1, -2, 3, 0, 0, 0]
    loop = b.playback(x, rate=1000, loop=True)
    assert played(loop, 25).tolist() == np.resize(x, 25).tolist()
    np.testing.assert_array_equal(
        played(b.playback(x, rate=300), 25), np.append(resampled(x, 300, 1000), np.zeros(15))
    )


@pytest.mark.parametrize(
    ("n", "rate", "fs", "cycles"),
    [
        (500, 44100, 48000, 5),  # 147 turns are 80 000 samples
        (500, 44100, 8000, 5),
        (480, 48000, 44100, 100),  # one turn is 441 samples
        (7, 1000, 48000, 3),
        (100, 1000, 3333.3, 10),
        (44101, 44100, 48000, 441),  # no table holds a whole number of turns
        (500, 44100.1, 48000, 5),
        (3, 8000, 1000, 1),  # beyond fs/2
    ],
)
def test_a_loop_has_no_seam_and_its_frequency_at_every_rate(n, rate, fs, cycles):
    f, t = cycles * rate / n, np.arange(round(2 * fs)) / fs
    y = played(
        b.playback(np.cos(2 * np.pi * cycles * np.arange(n) / n), rate, loop=True), t.size, fs=fs
    )
    exact = (n * Fraction(fs) / Fraction(rate)).numerator <= 2**17
    if f > fs / 2:
        assert np.abs(y).max() < 1e-5
        return
    drift = 0.0 if exact else 2 * np.pi * f * t / 2**17
    assert (np.abs(y - np.cos(2 * np.pi * f * t)) <= 1e-5 + drift).all()
    # whatever its frequency is, it is one line
    near = np.array([np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t)])
    grown = np.concatenate([near, near * t, near * t * t])
    assert np.abs(y - grown.T @ np.linalg.lstsq(grown.T, y)[0]).max() < 2e-5


@pytest.mark.parametrize(("rate", "loop"), [(1000, False), (300, True), (4000, True)])
def test_a_recording_is_heard_at_any_time_of_it(rate, loop):
    """Forwards at up to its own speed, backwards, around; a wave at 0.44 of the lower
    rate.
    """
    f = 0.44 * min(rate, 1000)
    x = np.cos(2 * np.pi * f * np.arange(rate) / rate + 1)
    t = np.cumsum(np.random.default_rng(0).uniform(-0.3, 1.0, 2000)) / 1000 + (
        -2.9 if loop else 0.1
    )
    block = b.playback(x, rate, loop, at=Input("t", "s"))
    y = played(block, t)
    assert (t[-1] < 0.9 or loop) and np.abs(y - np.cos(2 * np.pi * f * t + 1)).max() < 1e-5
    ends = played(block, [-1e-9, 0.0, 1 - 1e-9, 1.0])
    np.testing.assert_allclose(ends, np.cos(1) if loop else [0, ends[1], ends[2], 0], atol=1e-4)


def test_what_lies_beyond_the_sample_rate_is_not_heard_at_a_speed_of_1():
    x = np.cos(2 * np.pi * 580 * np.arange(4000) / 4000)
    assert (
        np.abs(played(b.playback(x, 4000, True, at=Input("t", "s")), np.arange(500) / 1000)).max()
        < 1e-5
    )


@pytest.mark.parametrize("at", [None, Input("t", "s")])
def test_a_recording_has_a_unit(at):
    assert str(b.playback([1.0], 1000, unit="N", at=at).dim) == "N"


def test_noise_of_a_band_has_its_level_at_every_rate():
    for fs in (1000, 4000):
        y = played(b.band_noise(100, 300, psd=0.01, seed=1, order=6), 20 * fs, fs=fs)[fs:]
        # 200 Hz for 19 s: 1.6 % of chance, and 1 % of flanks
        assert abs(np.mean(y**2) / 2.0 - 1) < 0.08


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (
            lambda: b.oscillator(100, "saw"),
            BadValue,
            "waveform = 'saw'; choose one of sine, triangle, sawtooth",
        ),
        (
            lambda: b.oscillator(-1.0, "square"),
            BadValue,
            "oscillator: freq = -1 Hz must be 0 or above",
        ),
        (
            lambda: b.oscillator(Param("f", -1.0, "Hz"), "square"),
            BadValue,
            "oscillator: freq = -1 Hz must be 0 or above",
        ),
        (
            lambda: b.oscillator(100, "square", duty=1.0),
            BadValue,
            "duty = 1 must be above 0 and below 1",
        ),
        (
            lambda: b.oscillator(X, "square"),
            UnitError,
            r"freq Input\('x'\) \[1\] must be in Hz; multiply it by .*'Hz'",
        ),
        (
            lambda: b.chirp(Param("f", 10.0, "Hz"), 20, 1),
            BadValue,
            r"Param\('f', 10.0, 'Hz'\); oscillator\(freq\) has a freq",
        ),
        (
            lambda: b.oscillator(100, "square", Input("d", "m")),
            UnitError,
            "duty .* must have no unit",
        ),
        (lambda: b.pulse_train(10, Input("j", "s")), UnitError, "jitter .* part of a period"),
        (
            lambda: b.chirp(10, 20, 1, "cubic"),
            BadValue,
            "kind = 'cubic'; choose one of linear, exponential",
        ),
        (lambda: b.chirp(0, 20, 1), BadValue, "chirp: f0 = 0.0 must be above 0"),
        (lambda: b.at("noon"), BadValue, "at: times must be numbers"),
        (lambda: b.playback([], 8000), BadValue, "playback: samples must be one row"),
        (lambda: b.playback([1.0], 0), BadValue, "playback: rate = 0.0 must be above 0"),
        (
            lambda: b.playback([1.0], 8000, at=Input("x", "m")),
            UnitError,
            r"at Input\('x', 'm'\) \[m\] must be in s; multiply it by a constant\(.., 's/\(m\)'\)",
        ),
        (
            lambda: b.playback([1.0], 8000, at=b.every(1.0)),
            BadValue,
            r"is an event, which lasts one sample; give a time",
        ),
        (lambda: b.band_noise(300, 100, 1, seed=1), BadValue, "low = 300 Hz must be below high"),
        (lambda: b.band_noise(100, 300, 0, seed=1), BadValue, "psd = 0.0 must be above 0"),
    ],
)
def test_what_makes_no_sense_is_told_at_once(make, error, text):
    with pytest.raises(error, match=text):
        make()


@pytest.mark.parametrize(
    "make",
    [lambda: b.oscillator(500, "pulse"), lambda: b.chirp(10, 600, 1), lambda: b.pulse_train(600)],
)
def test_what_does_not_fit_the_sample_rate_is_told_when_it_is_compiled(make):
    with pytest.raises(BadValue, match="does not fit below fs/2 = 500 Hz"):
        stimlib.compile(Scene({"y": make()}), 1000)
