"""Psychometric fits: the 32 of the UGrip paper, with and without their intervals,
beside statsmodels; their maxima of the likelihood alone beside scipy's minimize; and
200 people, with a known rate of lapses, a free one, and a chance level.

Set OPENBLAS_NUM_THREADS=1: L-BFGS-B keeps all threads of BLAS busy for two numbers.

    python benchmarks/psychometric.py             print
    python benchmarks/psychometric.py --record    and keep the figures

They are kept in results/psychometric.csv.
"""

from __future__ import annotations

import numpy as np
from bench import Row, main, row
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr, ndtri
from timing import interleaved, medians

from stimlib.experiments.fits import psychometric, psychometrics
from stimlib.experiments.likelihood import Sets, maximum

FITS, LEVELS, ASKED = 32, np.geomspace(0.9, 5.0, 22), 5


MIDDLE = LEVELS.mean()
PEERS = {
    "BFGS": {},
    "L-BFGS-B": {},
    "L-BFGS-B to 1e-10": {"ftol": 1e-15, "gtol": 1e-10},  # as far as ours
}


def scipy_maximum(yes: np.ndarray, name: str) -> tuple[float, float]:
    """PSE and sigma by minimize, with the gradient, from a line through the answers."""
    x = LEVELS - MIDDLE

    def cost(at: np.ndarray) -> tuple[float, np.ndarray]:
        eta = at[0] + at[1] * x
        yes_at, no_at = log_ndtr(eta), log_ndtr(-eta)
        density = -0.5 * eta * eta - 0.5 * np.log(2 * np.pi)
        slope = yes * np.exp(density - yes_at) - (ASKED - yes) * np.exp(density - no_at)
        return -(yes @ yes_at + (ASKED - yes) @ no_at), np.array([-slope.sum(), -(slope @ x)])

    b, a = np.polyfit(x, ndtri(np.clip(yes / ASKED, 0.1, 0.9)), 1)
    method = name.removesuffix(" to 1e-10")
    a, b = minimize(cost, [a, b], jac=True, method=method, options=PEERS[name]).x
    return MIDDLE - a / b, 1 / b


def measure() -> list[Row]:
    """All rows."""
    from statsmodels.genmod.families import Binomial, links
    from statsmodels.genmod.generalized_linear_model import GLM

    p = ndtr((LEVELS - 2.34) / 0.4)
    answers = np.random.default_rng(1).binomial(ASKED, p, (FITS, LEVELS.size))
    asked, design = np.full(LEVELS.size, ASKED), np.column_stack([np.ones_like(LEVELS), LEVELS])
    probit = Binomial(links.Probit())
    together = Sets(LEVELS, answers, asked)
    found = maximum(together, np.full(FITS, MIDDLE))
    for name in PEERS:
        pse, sigma = np.transpose([scipy_maximum(yes, name) for yes in answers])
        np.testing.assert_allclose(pse, MIDDLE - found.a / found.b, rtol=1e-5)
        np.testing.assert_allclose(sigma, 1 / found.b, rtol=1e-3)
    data = {n: (LEVELS, yes, asked) for n, yes in enumerate(answers)}
    at, rng = np.linspace(-2, 2, 9), np.random.default_rng(1)
    many = {
        chance: {
            n: (at, yes, [20] * 9)
            for n, yes in enumerate(rng.binomial(20, chance + (1 - chance) * ndtr(at), (200, 9)))
        }
        for chance in (0.0, 0.5)
    }
    jobs = {
        "32 fits, profile intervals": lambda: psychometrics(data),
        "32 fits, profile intervals, one by one": lambda: [
            psychometric(*each) for each in data.values()
        ],
        "32 fits, no intervals": lambda: psychometrics(data, interval="none"),
        "32 fits, statsmodels": lambda: [
            GLM(np.column_stack([y, asked - y]), design, family=probit).fit() for y in answers
        ],
        "32 maxima": lambda: maximum(together, np.full(FITS, MIDDLE)),
        "32 maxima, one by one": lambda: [maximum(Sets(LEVELS, y, asked), MIDDLE) for y in answers],
        "200 people": lambda: psychometrics(many[0.0]),
        "200 people, free lapse rate": lambda: psychometrics(many[0.0], lapse="free"),
        "200 people, chance level 1/2": lambda: psychometrics(many[0.5], guess=0.5),
    } | {
        f"32 maxima, scipy {name}": lambda name=name: [scipy_maximum(y, name) for y in answers]
        for name in PEERS
    }
    return [row(name, seconds, "s") for name, seconds in medians(interleaved(jobs, 5)).items()]


if __name__ == "__main__":
    main("psychometric", __doc__, measure)
