"""The film of air under a vibrating plate: against its means and against Reynolds'
equation, both without the formula.
"""

import numpy as np
import pytest

import stimlib
from stimlib import BadValue, Input, Scene, UnitError
from stimlib.blocks import squeeze_film

PRESSURE = 101325.0


def load_of(amplitudes, normal=0.5, **words):
    scene = Scene({"load": squeeze_film(normal, Input("a", "m"), **words)})
    return stimlib.compile(scene, 1000, "python").process(np.array([amplitudes]))[0]


def film(e):
    """Mean pressure of air that cannot flow out, over that around it.

    p h is then the same all the time, and at the edge its square is the mean of h^3
    over the mean of h; the means are taken over a period.
    """
    h = 1 + e * np.cos(2 * np.pi * np.arange(4096) / 4096)
    return np.sqrt(np.mean(h**3) / np.mean(h)) * np.mean(1 / h) - 1


def test_the_load_is_what_the_air_does_not_carry():
    a = np.array([0.0, 0.3e-6, 1e-6, 2.2e-6, 5e-6])
    for gap, area, pressure in ((10e-6, 1e-4, PRESSURE), (8e-6, 0.4e-4, 9e4)):
        carried = area * pressure * np.array([film(v / gap) for v in a])
        got = load_of(a, 9.0, gap=gap, area=area, pressure=pressure)
        np.testing.assert_allclose(got, 9.0 - carried, rtol=1e-12)
        np.testing.assert_array_equal(load_of(-a, 9.0, gap=gap, area=area, pressure=pressure), got)


def test_the_pressure_is_that_of_reynolds_equation():
    """Isothermal air between parallel plates, d(p h)/dt = d/dx (p h^3 dp/dx)/sigma: its
    middle, which the edge does not reach, by finite volumes until it is periodic.
    """
    sigma, e, cells, steps = 150.0, 0.6, 50, 1000
    # one cell less than half of the last: p = 1 at the edge
    dx, dt = 1 / cells, 2 * np.pi / steps
    q, mean = np.full(cells, 1 + e), 0.0
    for n in range(40 * steps):
        h = 1 + e * np.cos(n * dt)
        p = np.r_[q / h, 1.0]
        p[-1] = 2 - p[-2]  # a cell beyond the edge, where p = 1 between the two
        flow = (p[1:] + p[:-1]) / 2 * h**3 * np.diff(p) / dx
        q = q + dt / (sigma * dx) * np.diff(flow, prepend=0.0)
        mean += p[0] / steps if n >= 39 * steps else 0.0
    carried = 9.0 - load_of([e * 10e-6], 9.0)[0]
    assert carried == pytest.approx(1e-4 * PRESSURE * (mean - 1), rel=0.02)


def test_a_small_vibration_carries_five_quarters_of_its_square():
    got = load_of([0.1e-6], 1.0)[0]
    assert 1.0 - got == pytest.approx(1e-4 * PRESSURE * 1.25 * 0.01**2, rel=2e-4)


def test_the_finger_floats_and_is_never_pulled():
    assert load_of([0.0])[0] == 0.5
    assert (load_of([2e-6, 9e-6, 10e-6, 1.0]) == 0.0).all()
    assert load_of([0.0], normal=0.0)[0] == 0.0
    held = 1e3 - load_of([9.9e-6, 10e-6, 1.0], 1e3)  # the pressure ends at e^2 = 0.98
    assert np.ptp(held) == 0.0
    assert held[0] == pytest.approx(1e-4 * PRESSURE * film(0.98**0.5), rel=1e-9)


def test_what_makes_no_sense_is_refused():
    for words in ({"gap": 0.0}, {"area": -1.0}, {"pressure": 0.0}):
        with pytest.raises(BadValue, match="squeeze_film: .* must be above 0"):
            squeeze_film(1.0, 1e-6, **words)
    with pytest.raises(BadValue, match="squeeze_film: normal = -1"):
        squeeze_film(-1.0, 1e-6)
    with pytest.raises(UnitError, match="squeeze_film: amplitude .* not in"):
        squeeze_film(1.0, Input("a", "V"))
    with pytest.raises(UnitError, match="squeeze_film: normal .* not in"):
        squeeze_film(Input("f", "m"), 1e-6)
