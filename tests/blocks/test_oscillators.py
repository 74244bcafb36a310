"""The carrier against exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from laws import alias, lawful, mostly

import stimlib
from stimlib import Input, Param, Scene, blocks as b
from stimlib.blocks.oscillators import carrier
from stimlib.devices.null import NullSink
from stimlib.errors import BadValue, UnitError

FS = 8000.0
TOUCH = Input("touch")
pi = np.pi


def carried(f=158.0, rectify=None, phase=0.0, fs=FS, target="numba", **kw):
    return stimlib.compile(Scene({"c": carrier(f, rectify, phase, **kw)}), fs, target)


def turns(f, fs, n):
    """Exact turns after n samples."""
    return float(Fraction(f) * n / Fraction(fs) % 1)


@pytest.mark.parametrize("f", [158.0, 157.9, 1 / 3, 3999.999])
@pytest.mark.parametrize("fs", mostly({44100.0}, [8000.0, 44100.0, 8000 / 1.001]))
def test_the_phase_is_exact_after_a_day(f, fs):
    """The state is moved on by 24 h, by the increment that the block itself makes."""
    f = min(f, fs / 2 - 0.001)
    proc = carried(f, fs=fs)
    before = proc.state
    proc.process(np.empty((0, 1)))
    word = 2  # header, index, phase, ..
    inc = int(proc.state[word]) - int(before[word])
    n = int(24 * 3600 * fs)
    before[word] = np.uint64((int(before[word]) + n * inc) % 2**64)
    proc.state = before
    y = proc.process(np.empty((0, 400)))[0]
    wanted = np.sin(2 * pi * np.array([turns(f, fs, n + k) for k in range(400)]))
    assert np.abs(y - wanted).max() <= 1e-9
    error = (int(before[word]) / 2**64 - turns(f, fs, n) + 0.5) % 1 - 0.5
    assert abs(2 * pi * error) <= 2 * pi * n * 2.0**-65 + 1e-15 <= 1e-9


def test_the_half_wave_keeps_its_line_and_has_fewer_aliases():
    n = 1 << 16
    k = round(158 / FS * n) | 1
    y = carried(k * FS / n, "half").process(np.empty((0, n)))[0]
    assert 2 * np.abs(np.fft.rfft(y)[k]) / n == pytest.approx(0.5, rel=1e-6)
    assert y.mean() == pytest.approx(1 / pi * (1 + (pi * 158 / FS) ** 2 / 6), rel=1e-5)
    point = np.maximum(0, np.sin(2 * pi * k * np.arange(n) / n))
    for top, better in ((0.5, 6), (1000 / FS, 20)):
        assert alias(y, k, top) < alias(point, k, top) - better


@pytest.mark.parametrize(
    ("rectify", "wave"),
    [(None, lambda s: s), ("half", lambda s: np.maximum(s, 0.0)), ("full", np.abs)],
)
@pytest.mark.parametrize("phase", [0.0, -2.5, 100.0])
def test_in_contact_it_is_the_sine_from_its_phase(rectify, wave, phase):
    """Away from the zero crossings, over which a rectified one is a mean."""
    touch, sine = (
        np.repeat([1.0, 0.0, np.nan, -1.0, 1.0], 40),
        np.sin(2 * pi * 158 * np.arange(200) / FS + phase),
    )
    away = np.abs(sine) > np.sin(pi * 158 / FS)
    y = carried(158.0, rectify, phase, contact=TOUCH).process(touch[None])[0]
    np.testing.assert_allclose(
        y[away], np.where(touch > 0, wave(sine), 0.0)[away], rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("rectify", [None, "half", "full"])
@pytest.mark.parametrize("phase", [0.0, -2.5, 100.0])
def test_it_is_its_law_at_any_frequency_and_phase(rectify, phase):
    """Fixed ones; live ones below 0 and above fs/2 are held there."""
    for f in (1.0, 158.0, 1000.3, 3700.0):
        lawful(carrier(f, rectify, phase, contact=TOUCH), FS, touch=np.ones(3000))
    live = carrier(Input("f", "Hz"), rectify, phase, contact=TOUCH)
    lawful(live, FS, f=np.repeat([9000.0, -5.0, 0.0, 158.0], 70), touch=np.ones(280))


@pytest.mark.parametrize(
    ("make", "error", "match"),
    [
        (lambda: carrier(158.0, "positive"), BadValue, "half"),
        (lambda: carrier(-1.0), BadValue, "^carrier: freq = -1.0 Hz must be 0 or above"),
        (lambda: carrier(-5.0, "half"), BadValue, "^carrier: freq = -5.0 Hz must be 0 or above"),
        (lambda: carrier(Param("f", -2.0, "Hz")), BadValue, "0 or above"),
        (lambda: carrier(float("inf")), BadValue, "not finite"),
        (
            lambda: carried(4000.0),
            BadValue,
            "^oscillator or carrier: freq = 4000 Hz does not fit below fs/2 = 4000 Hz",
        ),
        (
            lambda: carried(900.0, "half", fs=1000.0),
            BadValue,
            "^carrier: freq = 900 Hz does not fit below fs/2 = 500 Hz",
        ),
        (lambda: carried(Param("f", 4000.0, "Hz")), BadValue, "below fs/2 = 4000 Hz"),
        (lambda: carrier(Param("f", 158.0)), UnitError, "in Hz"),
        (lambda: carrier(Input("f", "m"), "half"), UnitError, "^carrier: freq .* must be in Hz"),
    ],
)
def test_what_makes_no_sense_is_refused(make, error, match):
    with pytest.raises(error, match=match):
        make()


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
    scene, says = (
        Scene({"y": make(Param("f", 100.0, "Hz"))}),
        f"{name} = .* does not fit below fs/2",
    )
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
            lambda: stimlib.compile(Scene({"y": make(Param("f", 4000.0, "Hz"))}), FS),
            lambda: stimlib.compile(Scene({"y": make(stimlib.constant(4000.0, "Hz"))}), FS),
        ):
            with pytest.raises(BadValue, match=says):
                call()
        with pytest.raises(BadValue, match=f"{name} = -1 Hz must be 0 or above"):
            sink.set("f", -1.0)
    assert proc.params == {"f": 3999.0} and [one.params for one in copies] == before
    scene, f = Scene({"y": make(Input("f", "Hz"))}), np.full(800, 3999.0)
    for stretch, count in ((slice(0, 0), 0), (slice(300, 400), 100)):
        f[stretch] = 4000.0
        report = stimlib.verify(scene, {"f": f}, stimlib.render(scene, {"f": f}, FS))
        told = [text for text in report.evidence.numbers if f"or above in {count} of 800" in text]
        assert report.passed and len(told) == bool(count)
