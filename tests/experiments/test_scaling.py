"""Weber, Fechner and Stevens, and the JND from d': the papers' own numbers, other
programs, simulated people.
"""

import numpy as np
import pytest

from stimlib.errors import BadValue
from stimlib.experiments.scaling import fechner, jnd_from_dprime, line, stevens
from stimlib.experiments.signal_detection import detection

RMS = [
    0.08,
    0.11,
    0.06,
    0.65,
    0.89,
    0.44,
    1.23,
    1.66,
    0.83,
    0.13,
    0.18,
    0.10,
    1,
    1.41,
    0.80,
    1.88,
    2.64,
    1.51,
]
# V, tables 6.1 and 6.2 of the thesis on bumps
RMS += [0.15, 0.22, 0.12, 1.18, 1.79, 0.99, 2.21, 3.35, 1.85]
ROUGH = [
    2.04,
    1.93,
    1.42,
    3.77,
    3.46,
    3.04,
    3.92,
    3.95,
    3.68,
    1.84,
    1.89,
    1.63,
    3.96,
    4.30,
    3.73,
    4.34,
    4.91,
    4.27,
]
ROUGH += [1.82, 1.95, 1.80, 4.40, 4.82, 3.98, 5.03, 5.15, 4.68]


def test_the_line_of_the_bounciness_jnds():
    """Fig. 3.6 of Çaldıran's thesis; it prints t = 20.0065, p = .0318, intercept -.0012
    with t = -.3088, p = .8093.
    """
    found = line([0.25, 0.5, 0.75], [0.03615, 0.0693, 0.10875])
    assert (found.slope, found.intercept, found.df) == pytest.approx((0.1452, -0.0012, 1), abs=1e-9)
    assert (
        found.slope / found.slope_error == pytest.approx(20.0, abs=0.05)
        and round(found.slope_p, 4) == 0.0319
    )
    assert found.intercept_p == pytest.approx(0.811, abs=0.002) and found.r2 == pytest.approx(
        0.998, abs=1e-3
    )


def test_a_line_is_that_of_statsmodels():
    from statsmodels.regression.linear_model import OLS

    x, y = np.array([0.1, 0.4, 0.5, 0.9, 1.3]), np.array([1.0, 1.7, 1.4, 2.9, 3.1])
    other = OLS(y, np.column_stack([np.ones(5), x])).fit()
    found = line(x, y)
    assert (found.intercept, found.slope) == pytest.approx(tuple(other.params), rel=1e-8)
    assert (found.intercept_error, found.slope_error) == pytest.approx(tuple(other.bse), rel=1e-8)
    assert (found.intercept_p, found.slope_p, found.r2) == pytest.approx(
        (*other.pvalues, other.rsquared), rel=1e-8
    )


def test_roughness_over_rms():
    law = fechner(RMS, ROUGH)
    assert (round(law.line.intercept, 4), round(law.line.slope, 4), round(law.r2, 4)) == (
        3.9201,
        2.2464,
        0.9563,
    )
    assert law(1.0) == pytest.approx(law.line.intercept)
    assert np.corrcoef(RMS, ROUGH)[0, 1] == pytest.approx(0.9024, abs=5e-5)
    power = stevens(RMS, ROUGH)
    assert power.line.slope == pytest.approx(0.3319, abs=5e-5) and power(2.0) == pytest.approx(
        10**0.574830 * 2**0.331901, rel=1e-5
    )
    rest = ROUGH - power(RMS)
    assert (
        power.r2 == pytest.approx(1 - np.sum(rest**2) / np.var(ROUGH) / 27, rel=1e-10)
        and power.r2 != power.line.r2
    )
    assert power.aic == pytest.approx(27 * np.log(np.mean(rest**2)) + 4)


def test_jnds_of_simulated_people_follow_their_line():
    """4000 times four people of Çaldıran's thesis, whose JNDs are .1452 alpha - .0012:
    corrections take little from it.
    """
    from scipy.stats import norm

    alphas, step = np.array([0.25, 0.5, 0.75]), 0.05 * np.arange(1, 4)
    true = step / (0.1452 * alphas - 0.0012)[:, None]  # d' of each reference and increment
    rng = np.random.default_rng(7)
    H, F = (rng.binomial(50, norm.cdf(s * true / 2), (4000, 4, 3, 3)) for s in (1, -1))
    d_of = np.array([[detection(h, 50, f, 50).d for f in range(51)] for h in range(51)])
    jnds = [[jnd_from_dprime(d, step) for d in np.moveaxis(study, 1, 0)] for study in d_of[H, F]]
    mean = line(alphas, np.mean(jnds, axis=0))  # of a mean is the mean of the lines
    assert mean.slope == pytest.approx(0.144, abs=0.002)
    assert mean.intercept == pytest.approx(-0.0012, abs=0.001)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: line([1, 2], [1, 2]), "three points"),
        (lambda: line([1, 2, 3], [1, 2]), "of one length"),
        (lambda: line([1, 2, 3], [1, np.nan, 2]), "number 1 of the second"),
        (lambda: line([1, 1, 1], [1, 2, 3]), "two places"),
        (lambda: fechner([1, 0, 2], [1, 2, 3]), r"intensity\[1\] = 0"),
        (lambda: stevens([1, 0, 3], [1, 2, 3]), r"intensity\[1\] = 0"),
        (lambda: stevens([1, 2, 3], [1, 2, 0]), r"rating\[2\] = 0"),
        (lambda: jnd_from_dprime([1, 2], [0.1, 0.2, 0.3]), "increments must be"),
        (lambda: fechner([1, 2, 3], [2, 2, 2]), "all ratings are 2"),
        (lambda: line([1, 2, "x"], [2, 2, 2]), "line: x = .* must be a list of numbers"),
        (lambda: jnd_from_dprime([], []), "no d'"),
        (lambda: jnd_from_dprime([1, 2], [0.0, 0.2]), r"increment\[0\]"),
    ],
)
def test_what_cannot_be_used_is_said(call, said):
    with pytest.raises(BadValue, match=said):
        call()


def test_no_jnd_where_nobody_tells_them_apart():
    assert np.isnan([jnd_from_dprime([-0.1, last], [0.1, 0.1]) for last in (0.0, 0.1)]).all()
