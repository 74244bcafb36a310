"""Arrays padded to multiples of eight, as the sums of ``stimlib.core.maths`` need."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def eights(n: int) -> int:
    """Return the next multiple of eight.

    Examples
    --------
    >>> from stimlib.design.padding import eights
    >>> eights(8), eights(9)
    (8, 16)
    """
    return -(-n // 8) * 8


def padded(a: npt.ArrayLike, value: float = 0.0, n: int | None = None) -> np.ndarray:
    """Pad an array with a value to n elements, by default to a multiple of eight.

    Examples
    --------
    >>> from stimlib.design.padding import padded
    >>> padded([1.0, 2.0, 3.0])
    array([1., 2., 3., 0., 0., 0., 0., 0.])
    """
    a = np.asarray(a, np.float64)
    return np.pad(a, (0, (eights(a.size) if n is None else n) - a.size), constant_values=value)
