"""A steady start of every linear block: as if its signal had always been as it is at
the first sample.
"""

import numpy as np
import pytest
from laws import played

import stimlib
from stimlib import BadValue, Input, Scene, blocks as b, constant

X = Input("x", "m")
ROWS = [[0.2, 0.3, 0.2, 1.0, -0.5, 0.3], [1.0, -0.2, 0.0, 2.0, -1.8, 0.0]]
FILTERS = {
    "fir": lambda x, **o: b.fir(x, [0.3, -1.2, 2.5, 0.1], "1/s", **o),
    "fir of a gain below 0": lambda x, **o: b.fir(x, [-1.0, 0.2], "1", **o),
    "differentiator": lambda x, **o: b.differentiator(x, 100.0, order=64, tol=0.01, **o),
    "delay": lambda x, **o: b.delay(x, samples=9, **o),
    "moving_average": lambda x, **o: b.moving_average(x, 0.02, **o),
    "first_order": lambda x, **o: b.first_order(x, 0.02, **o),
    "integrate": lambda x, **o: b.integrate(x, 30.0, **o),
    "lowpass": lambda x, **o: b.lowpass(x, 20.0, 4, **o),
    "lowpass ripple": lambda x, **o: b.lowpass(x, 20.0, 4, "elliptic", **o),
    "lowpass odd": lambda x, **o: b.lowpass(x, 20.0, 3, "chebyshev1", **o),
    "highpass": lambda x, **o: b.highpass(x, 20.0, **o),
    "bandpass": lambda x, **o: b.bandpass(x, 20.0, 50.0, **o),
    "bandstop": lambda x, **o: b.bandstop(x, 20.0, 50.0, 2, "chebyshev1", **o),
    "sos": lambda x, **o: b.sos(x, ROWS, **o),
    "resonator": lambda x, **o: b.resonator(x, 50.0, 2.0, **o),
    "notch": lambda x, **o: b.notch(x, 50.0, 2.0, **o),
    "mode": lambda x, **o: b.mode(x, 50.0, 2.0, **o),
} | {
    f"svf {m}": lambda x, m=m, **o: b.svf(x, 50.0, 2.0, m, **o)
    for m in ("lowpass", "bandpass", "highpass", "notch")
}
CREEP = {
    "element": lambda f, **o: b.compliance_kelvin_voigt(f, 200.0, tau=0.02, **o),
    "chain": lambda f, **o: b.compliance_generalized_kelvin_voigt(
        f, [(50.0, 0.01), (20.0, 0.03)], k0=70.0, **o
    ),
}


@pytest.mark.parametrize("name", FILTERS | CREEP)
def test_a_steady_start_is_the_end_of_a_long_hold(name):
    """The samples that come after 4 s at the first value, without the 4 s."""
    make = (FILTERS | CREEP)[name]
    x = X if name in FILTERS else Input("f", "N")
    moved = 0.02 + 1e-3 * np.random.default_rng(1).standard_normal(300).cumsum()
    long = played(make(x), np.r_[np.full(4000, moved[0]), moved])[4000:]
    steady = played(make(x, onset="steady"), moved, target="python")
    np.testing.assert_allclose(steady, long, rtol=0, atol=3e-13 * np.abs(long).max())
    same = played(make(x, onset="steady"), moved)
    np.testing.assert_array_equal(steady, same)
    held = played(make(x, onset="steady"), np.full(200, 0.02), target="python")
    np.testing.assert_array_equal(held, held[0])


def test_what_a_hand_at_20_mm_does_in_its_first_sample():
    """The default is a step from 0: 48.5 m/s of a differentiator at 8 kHz, and none
    with a steady start.
    """
    for onset, least, most in (("step", 40.0, 60.0), ("steady", 0.0, 1e-12)):
        scene = Scene(
            {
                "v": b.differentiator(X, passband=1000, onset=onset),
                "y": b.highpass(X, 1.0, onset=onset),
            }
        )
        v, y = stimlib.compile(scene, 8000, "python").process(np.full((1, 200), 0.02))
        assert least <= np.abs(v).max() <= most and np.abs(y).max() == (
            pytest.approx(0.02, rel=1e-3) if least else 0.0
        )
    steady = {
        "v": b.velocity(X),
        "t": b.track(X),
        "s": b.springpot(X, 3.0, 0.5),
        "m": b.maxwell(X, 3.0, tau=1.0),
    }
    y = stimlib.compile(Scene(steady), 8000, "python").process(np.full((1, 64), 0.02))
    np.testing.assert_allclose(
        y, np.array([0.0, 0.02, 0.0, 0.0])[:, None] + np.zeros((1, 64)), rtol=0, atol=1e-17
    )


def test_a_steady_start_of_a_noise_is_at_sample_0():
    """And not where the noise began, some samples before."""
    noise = b.white_noise(1)
    late, now = stimlib.compile(
        Scene({"y": b.delay(noise, samples=2, onset="steady"), "n": noise}), 1000
    ).process(4)
    assert late.tolist() == [now[0], now[0], now[0], now[1]]


def test_a_moving_cutoff_stays_steady():
    rows = {"x": np.full(300, 0.02), "f": np.random.default_rng(2).uniform(1, 490, 300)}
    np.testing.assert_array_equal(
        played(b.svf(X, Input("f", "Hz"), 3.0, onset="steady"), rows), 0.02
    )


def test_response_and_latency_are_those_of_the_block():
    f = np.array([0.0, 3.0, 30.0])
    one, other = (
        stimlib.compile(Scene({"y": b.lowpass(X, 20.0, onset=o)}), 1000, "python")
        for o in ("step", "steady")
    )
    np.testing.assert_array_equal(one.response("y", "x", f), other.response("y", "x", f))
    assert one.latency == other.latency


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: b.lowpass(X, 20.0, onset="rest"),
            "lowpass: onset = 'rest'; choose one of steady, step",
        ),
        (lambda: b.delay(X, 3, onset=""), "delay: onset = ''; choose one of"),
        (
            lambda: b.maxwell(X, 3.0, tau=1.0, onset="rest"),
            "maxwell: onset = 'rest'; choose one of",
        ),
        (
            lambda: b.integrate(X, onset="steady"),
            "integrate: the response to a constant grows without end, so there is no steady start",
        ),
        (
            lambda: b.compliance_generalized_kelvin_voigt(
                constant(1.0, "N/m") * X, [], k0=1.0, b=2.0, onset="steady"
            ),
            "the response to a constant grows without end",
        ),
    ],
)
def test_what_has_no_steady_start_is_refused(make, text):
    with pytest.raises(BadValue, match=text):
        make()
