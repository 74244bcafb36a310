"""A power law over place as a sum of octaves, each with the spectrum of a random
spline.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .minimax import FloatArray

FINEST = 0.2
"""Cell of the finest octave, in shortest wavelengths."""

COARSEST = 0.5
"""Least cell of the coarsest octave, in longest wavelengths."""

POINTS = 600


class Octaves(NamedTuple):
    """Random splines whose spectra add up to a power law.

    Attributes
    ----------
    cells : ndarray, shape (n,)
        Length of a cell of each, doubled from one to the next.
    power : ndarray, shape (n,)
        a^2 of each: variance of its lattice values.
    error_db : float
        Largest deviation from the law between its ends, dB.
    """

    cells: FloatArray
    power: FloatArray
    error_db: float


def band_power(slope: float, low: float, high: float) -> float:
    """Integral of f^-slope from low to high.

    Examples
    --------
    >>> from stimlib.design.octaves import band_power
    >>> band_power(2.0, 1.0, 4.0)
    0.75
    """
    ratio, rest = math.log(high / low), 1 - slope
    return low**rest * (math.expm1(rest * ratio) / rest if rest else ratio)


@lru_cache(maxsize=64)
def octaves(slope: float, low: float, high: float) -> Octaves:
    """Octaves whose one-sided spectra 2 a^2 D sinc^6(f D) add up to C f^-slope from low
    to high, of power 1 there.

    D is the cell, sinc(x) = sin(pi x)/(pi x): the spectrum of independent lattice
    values of variance a^2 under quadratic B-splines.  The a^2 are the least squares of
    the relative error that are not below 0.

    Parameters
    ----------
    slope : float
    low, high : float
        Ends of the law in cycles per unit of length.

    Returns
    -------
    Octaves

    References
    ----------
    Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal
    Processing Magazine 1999 (B-splines and their transforms); Lawson and Hanson,
    "Solving Least Squares Problems", 1974, chapter 23 (non-negative least squares).

    Examples
    --------
    >>> from stimlib.design.octaves import octaves
    >>> found = octaves(1.0, 5.0, 5e4)
    >>> found.cells.size, round(found.error_db, 2)
    (16, 0.03)
    """
    from scipy.optimize import nnls

    n = math.ceil(math.log2(COARSEST / low * high / FINEST)) + 1
    cells = np.ldexp(FINEST / high, np.arange(n))
    f = np.geomspace(low, high, POINTS)
    # of a^2 D = 1, relative to the law of C = 1
    spectra = 2 * np.sinc(f[:, None] * cells) ** 6 * f[:, None] ** slope
    # no last bits of a solver
    found = np.array([float(f"{v:.9g}") for v in nnls(spectra, np.ones(POINTS))[0]])
    power = found / cells / band_power(slope, low, high)
    cells.flags.writeable = power.flags.writeable = False
    return Octaves(cells, power, float(np.abs(10 * np.log10(spectra @ found)).max()))
