"""How several cues are combined into one estimate, by maximum likelihood."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue, public
from .likelihood import numbers


class Integrated(NamedTuple):
    """An estimate from several cues: its value and standard deviation, and weights."""

    value: float
    sd: float
    weights: tuple[float, ...]


@public
def integrated(values: ArrayLike, sds: ArrayLike) -> Integrated:
    """Return the maximum-likelihood estimate from independent normal cues.

    Each cue has the weight of its reliability 1/sd^2, over the sum of all; the
    estimate's reliability is that sum, so it is never worse than the best cue.

    Parameters
    ----------
    values, sds : array_like, shape (cues,)
        What each cue says, and its standard deviation, in one unit.

    Returns
    -------
    Integrated

    Raises
    ------
    BadValue
        Different lengths, no cue, a value that is not finite, or a standard deviation
        not above 0.

    References
    ----------
    The value is the maximum over m of the likelihood, the product over all cues of
    exp(-(value - m)^2/(2 sd^2)).  M. O. Ernst and M. S. Banks, "Humans integrate visual
    and haptic information in a statistically optimal fashion", Nature 415 (2002),
    429-433, compared people with it.

    Examples
    --------
    >>> from stimlib.experiments import integrated
    >>> found = integrated([10.0, 13.0], [1.0, 2.0])
    >>> round(found.value, 6), round(found.sd, 4), found.weights
    (10.6, 0.8944, (0.8, 0.2))
    """
    x, s = numbers("integrated: values", values), numbers("integrated: sds", sds)
    if x.ndim != 1 or x.shape != s.shape or not x.size or not (np.isfinite(s) & (s > 0)).all():
        raise BadValue(
            f"integrated: {x.size} values and {s.size} standard deviations; give one above 0 for"
            " each cue"
        )
    if not np.isfinite(x).all():
        at = int(np.argmin(np.isfinite(x)))
        raise BadValue(f"integrated: values[{at}] = {x[at]} must be finite; leave that cue out")
    weights = (s.min() / s) ** 2  # of the best cue 1, so that no square overflows
    sd = float(s.min() / np.sqrt(weights.sum()))
    weights /= weights.sum()
    return Integrated(float(weights @ x), sd, tuple(weights.tolist()))
