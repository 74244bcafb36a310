"""Carriers, oscillators, sweeps, pulse trains and recordings against their laws,
fractions and many digits.
"""

import itertools
from fractions import Fraction
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
import soundfile
from laws import lawful, mostly, played, refuses

import stimlib
from stimlib import Input, Param, Scene, UnitError, blocks as b, constant
from stimlib.blocks.oscillators import carrier
from stimlib.blocks.sources import Chirp
from stimlib.devices.null import NullSink

X, T, FREQ = Input("x"), Input("t", "s"), Input("f", "Hz")
FS, RECORDED = 8000.0, np.array([1.0, -2.0, 3.0])


def heard(source):
    """A source beside an input, which says how many samples it is to be."""
    return source + 0.0 * X


PHASES = itertools.product([None, "half", "full"], [0.0, -2.5, 100.0])
LAWFUL = [
    *(
        heard(b.oscillator(freq, wave, 0.3, phase=1.0))
        for wave in ("triangle", "sawtooth", "square", "pulse")
        for freq in (0.0, 3.7, 158.3, 449.0)
    ),
    heard(b.oscillator(0.0, "square", phase=4.0)),
    heard(b.oscillator(0.0, "sawtooth", phase=np.pi)),
    b.oscillator(100, "pulse", 10.0 * X),  # a duty beyond 0 and 1
    heard(b.chirp(50, 50, 1.0, "exponential")),
    heard(b.pulse_train(30.0)),
    heard(b.pulse_train(125.0, -0.5)),  # periods of 8 samples, at whose first instant it is
    heard(b.pulse_train(125.0, -1.0)),
    b.pulse_train(Param("rate", 40.0, "Hz"), 0.45 * b.tanh(X)),
    heard(b.playback(RECORDED, rate=300)),
    *(
        carrier(f, *how, contact=X + 1.5)
        for how in PHASES
        for f in (1.0, 158.0, 370.0, constant(1100.0, "Hz") * X)  # live beyond 0 and fs/2
    ),
]


def test_a_sample_is_that_of_its_law():
    """At any frequency, phase, duty and jitter; silent off contact."""
    for block in LAWFUL:
        lawful(block, 1000, x=np.random.default_rng(1).standard_normal(400))


HAND = {
    "once": (b.playback(RECORDED, rate=1000), 6, [1, -2, 3, 0, 0, 0]),
    "again and again": (b.playback(RECORDED, rate=1000, loop=True), 25, np.resize(RECORDED, 25)),
    "a low square": (b.oscillator(0.0, "square", phase=4.0), 2, [-1, -1]),
    "a triangle that stays": (b.oscillator(0.0, "triangle", phase=np.pi / 4), 2, [0.5, 0.5]),
    "regular pulses": (
        b.pulse_train(30.0),
        1000,
        np.isin(np.arange(1000), np.floor((np.arange(30) + 0.5) * 1000 / 30)),
    ),
    "late pulses, the first too": (b.pulse_train(125.0, 0.25), 100, np.arange(100) % 8 == 6),
    "early pulses, the first too": (b.pulse_train(125.0, -0.5), 100, np.arange(100) % 8 == 0),
}


@pytest.mark.parametrize("name", HAND)
def test_samples_are_those_worked_out_by_hand(name):
    block, n, wanted = HAND[name]
    np.testing.assert_allclose(played(block, n), wanted, rtol=1e-15)


@pytest.mark.parametrize("wave", ["sine", "triangle", "square", "sawtooth", "pulse"])
def test_a_wave_begins_at_its_onset_with_its_phase(wave):
    """At the nearest sample, as a burst does; its frequency counts from there, too."""
    sweep = b.timeline([(0.0, 50.0), (0.2, 90.0)], unit="Hz")
    for freq in (157.3, Param("f", 80.0, "Hz"), sweep):
        plain = played(heard(b.oscillator(freq, wave, 0.3, 1.0)), np.zeros(400))
        for onset, first in ((3 * 0.1, 300), (0.0294, 29), (1e-9, 0)):
            late = heard(b.oscillator(freq, wave, 0.3, 1.0, onset))
            assert (played(late, np.zeros(400)) == np.r_[np.zeros(first), plain][:400]).all()
            lawful(late, 1000, x=np.zeros(400))
    at_once = [Scene({"y": made(157.3)}) for made in (b.oscillator, b.carrier)]
    assert at_once[0] == at_once[1]  # without an onset there is no segment
    y, t = played(b.oscillator(157.3, onset=0.05), 400), np.arange(400) / 1000 - 0.05
    np.testing.assert_allclose(y, (t >= 0) * np.sin(2 * np.pi * 157.3 * t), atol=1e-12)


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
    rate; what lies beyond the sample rate is not heard.
    """
    f, n = 0.44 * min(rate, 1000), np.arange(rate)
    t = np.cumsum(np.random.default_rng(0).uniform(-0.3, 1.0, 2000)) / 1000
    t += -2.9 if loop else 0.1
    block = b.playback(np.cos(2 * np.pi * f * n / rate + 1), rate, loop, "N", T)
    y, ends = played(block, t), played(block, [-1e-9, 0.0, 1 - 1e-9, 1.0])
    assert (t[-1] < 0.9 or loop) and np.abs(y - np.cos(2 * np.pi * f * t + 1)).max() < 1e-5
    np.testing.assert_allclose(ends, np.cos(1) if loop else [0, ends[1], ends[2], 0], atol=1e-4)
    high = played(b.playback(np.cos(2 * np.pi * 0.145 * n), rate, True, at=T), np.arange(500) / 1e3)
    assert str(block.dim) == "N" and (rate < 4000 or np.abs(high).max() < 1e-5)


@pytest.mark.parametrize("f", [158.0, 157.9, 1 / 3, 3999.999])
@pytest.mark.parametrize("fs", mostly({44100.0}, [8000.0, 44100.0, 8000 / 1.001]))
def test_the_phase_is_exact_after_a_day(f, fs):
    """The state is moved on by 24 h, by the increment that the block itself makes."""
    f, n, word = min(f, fs / 2 - 0.001), int(24 * 3600 * fs), 2  # header, index, phase, ..
    proc = stimlib.compile(Scene({"c": carrier(f)}), fs)
    before = proc.state
    proc.process(1)
    moved = int(before[word]) + n * (int(proc.state[word]) - int(before[word]))
    before[word] = np.uint64(moved % 2**64)
    proc.state = before
    turns = [float(Fraction(f) * (n + k) / Fraction(fs) % 1) for k in range(400)]
    assert np.abs(proc.process(400)[0] - np.sin(2 * np.pi * np.array(turns))).max() <= 1e-9
    error = (int(before[word]) / 2**64 - turns[0] + 0.5) % 1 - 0.5
    assert abs(2 * np.pi * error) <= 2 * np.pi * n * 2.0**-65 + 1e-15 <= 1e-9


FREQUENCIES = {  # each block that takes a frequency while it runs
    "oscillator or carrier: freq": lambda f: b.carrier(f),
    "carrier: freq": lambda f: b.carrier(f, "full"),
    "oscillator: freq": lambda f: b.oscillator(f, "square"),
    "pulse_train: rate": lambda f: b.pulse_train(f),
    "ring: freq": lambda f: b.ring(b.pulse_train(5.0), f, 0.1),
    "svf: cutoff": lambda f: b.svf(b.white_noise(1), f),
    "oscillator or carrier: freq, in a loop": lambda f: b.loop(lambda y: 0.5 * y + b.carrier(f)),
}


@pytest.mark.parametrize("what", FREQUENCIES)
def test_a_frequency_of_half_the_rate_is_refused_as_a_parameter_and_counted_as_a_signal(what):
    make, name = FREQUENCIES[what], what.partition(",")[0]
    scene, says = Scene({"y": make(Param("f", 100.0, "Hz"))}), f"{name} = .* fit below fs/2"
    proc = stimlib.compile(scene, FS)
    proc.set("f", 3999.0)
    copies = proc.many([0, 1])
    before = [dict(one.params) for one in copies]
    with NullSink(scene, 50.0, clocked=False) as sink:
        sink.open(FS)
        for call in (
            lambda: proc.set("f", 4000.0),
            lambda: copies.set("f", [200.0, 4000.0]),
            lambda: sink.set("f", 5000.0),
            lambda: stimlib.render(scene, fs=FS, seconds=0.01, params={"f": 1e6}),
            make(Param("f", 4000.0, "Hz")),
            make(constant(4000.0, "Hz")),
        ):
            refuses(call, says, fs=FS)
        refuses(lambda: sink.set("f", -1.0), f"{name} = -1 Hz must be 0 or above")
    assert proc.params == {"f": 3999.0} and [one.params for one in copies] == before
    scene, f = Scene({"y": make(FREQ)}), np.full(800, 3999.0)
    for count in (0, 100):
        f[300 : 300 + count] = 4000.0
        report = stimlib.verify(scene, {"f": f}, stimlib.render(scene, {"f": f}, FS))
        told = [text for text in report.evidence.numbers if f"or above in {count} of 800" in text]
        assert report.passed and len(told) == bool(count)


REFUSED = [
    (lambda: b.oscillator(100, "saw"), "waveform = 'saw'; choose .*triangle, sawtooth"),
    (lambda: b.oscillator(100, onset=-0.1), "oscillator: onset = -0.1 must be a number, 0 or"),
    (lambda: b.oscillator(-1.0, onset=0.1), "freq = -1.0 .*or above"),
    (b.oscillator(500, onset=0.1), "fit below fs/2 = 500|freq .*500 Hz"),
    (lambda: b.oscillator(-1.0, "square"), "oscillator: freq = -1.0 .*or above"),
    (lambda: b.oscillator(Param("f", -1.0, "Hz"), "square"), "oscillator: freq = -1.0 .*or above"),
    (lambda: b.oscillator(100, "square", duty=1.0), "duty = 1 must .*below 1"),
    (lambda: b.oscillator(X, "square"), r"freq Input\('x'\) \[1\] must .*by .*'Hz'", UnitError),
    (
        lambda: b.chirp(Param("f", 10.0, "Hz"), 20, 1),
        r"Param\('f', 10.0, 'Hz'\); oscillator\(freq\) has a freq",
    ),
    (lambda: b.oscillator(100, "square", Input("d", "m")), "duty .* must have no unit", UnitError),
    (lambda: b.pulse_train(10, Input("j", "s")), "jitter .* must have no unit", UnitError),
    (lambda: b.chirp(10, 20, 1, "cubic"), "kind = 'cubic'; choose .*linear, exponential"),
    (lambda: b.chirp(0, 20, 1), "chirp: f0 = 0.0 .*above 0"),
    (lambda: b.at("noon"), "at: times must be numbers"),
    (lambda: b.playback([], 8000), "playback: samples must be one row"),
    (lambda: b.playback([1.0], 0), "playback: rate = 0.0 .*above 0"),
    (lambda: b.playback([1.0]), "playback: rate is missing; give the sample rate"),
    (lambda: b.playback("a.wav"), "playback: samples = 'a.wav' is the name of a file; read it"),
    (lambda: b.grain(b.every(1.0), Path("a.wav"), 8000), "grain: samples = 'a.wav' is the name"),
    (
        lambda: b.playback([1.0], 8000, at=Input("x", "m")),
        r"at Input\('x', 'm'\) \[m\] .*constant\(.., 's/\(m\)'\)",
        UnitError,
    ),
    (lambda: b.playback([1.0], 8000, at=b.every(1.0)), "is an event, which .*a time"),
    (lambda: b.band_noise(300, 100, 1, seed=1), "low = 300 Hz .*below high"),
    (lambda: b.band_noise(100, 300, 0, seed=1), "psd = 0.0 must be a number above 0"),
    (lambda: carrier(158.0, "positive"), "half"),
    (lambda: carrier(-1.0), "^carrier: freq = -1.0 .*or above"),
    (lambda: carrier(-5.0, "half"), "^carrier: freq = -5.0 .*or above"),
    (lambda: carrier(Param("f", -2.0, "Hz")), "0 or above"),
    (lambda: carrier(float("inf")), "not finite"),
    (
        lambda: stimlib.compile(Scene({"y": carrier(4000.0)}), FS),
        "^oscillator or carrier: freq .*4000 Hz",
    ),
    (lambda: carrier(900.0, "half"), "^carrier: freq = 900 .*500 Hz"),
    (
        lambda: stimlib.compile(Scene({"y": carrier(Param("f", 4000.0, "Hz"))}), FS),
        "below fs/2 = 4000 Hz",
    ),
    (lambda: carrier(Param("f", 158.0)), "in Hz", UnitError),
    (lambda: carrier(Input("f", "m"), "half"), "^carrier: freq .* must be in Hz", UnitError),
    (b.oscillator(500, "pulse"), "fit below fs/2 = 500"),
    (b.chirp(10, 600, 1), "fit below fs/2 = 500"),
    (b.pulse_train(600), "fit below fs/2 = 500"),
]


def test_the_remedy_for_the_name_of_a_file_plays_it(tmp_path):
    path, y = tmp_path / "a.wav", np.array([0.25, -0.5, 0.125])
    soundfile.write(path, y, 8000, "DOUBLE")
    _, channels, fs = stimlib.files.as_scene(path)
    assert (played(b.playback(channels["channel1"], fs), 3, fs=8000.0) == y).all()


@pytest.mark.parametrize("given", REFUSED, ids=lambda given: given[1])
def test_what_makes_no_sense_is_refused(given):
    refuses(*given)
