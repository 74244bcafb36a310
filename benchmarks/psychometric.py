"""Psychometric fits: the 32 of the UGrip paper, with and without their intervals,
beside statsmodels.

    python benchmarks/psychometric.py             print
    python benchmarks/psychometric.py --record    and keep the figures

They are kept in results/psychometric.csv.
"""

from __future__ import annotations

import numpy as np
from bench import Row, main, row
from scipy.special import ndtr

from stimlib.experiments.fits import psychometric, psychometrics
from stimlib.speed.timing import interleaved, medians

FITS, LEVELS, ASKED = 32, np.geomspace(0.9, 5.0, 22), 5


def measure() -> list[Row]:
    """All rows."""
    from statsmodels.genmod.families import Binomial, links
    from statsmodels.genmod.generalized_linear_model import GLM

    p = ndtr((LEVELS - 2.34) / 0.4)
    answers = np.random.default_rng(1).binomial(ASKED, p, (FITS, LEVELS.size))
    asked, design = np.full(LEVELS.size, ASKED), np.column_stack([np.ones_like(LEVELS), LEVELS])
    probit = Binomial(links.Probit())
    data = {n: (LEVELS, yes, asked) for n, yes in enumerate(answers)}
    jobs = {
        "32 fits, profile intervals": lambda: psychometrics(data),
        "32 fits, profile intervals, one by one": lambda: [
            psychometric(*each) for each in data.values()
        ],
        "32 fits, no intervals": lambda: psychometrics(data, interval="none"),
        "32 fits, statsmodels": lambda: [
            GLM(np.column_stack([y, asked - y]), design, family=probit).fit() for y in answers
        ],
    }
    return [row(name, seconds, "s") for name, seconds in medians(interleaved(jobs, 5)).items()]


if __name__ == "__main__":
    main("psychometric", __doc__, measure)
