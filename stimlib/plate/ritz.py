"""The Rayleigh-Ritz method for a thin rectangular plate.

Products of Jacobi polynomials keep the conditions of the edges by themselves.

A function of one axis is (1 - s)^p (1 + s)^q P_k^(2p, 2q)(s), s from -1 to 1, with p
and q = 0, 1, 2 for an edge that is free, simply supported or clamped.  They are
orthonormal, so the mass matrix of a bare plate is rho h times 1; all are polynomials,
so Gauss's sums are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.polynomial import legendre

HELD = {"F": 0, "S": 1, "C": 2}
"""Order of the zero of each function at an edge that is free, simply supported,
clamped.
"""


@cache
def basis(terms: int, low: int, high: int) -> tuple[np.ndarray, ...]:
    """Return the functions of one axis on -1 .. 1 as Legendre series.

    They are orthonormal there; the first two derivatives are returned as well.

    Each has the shape (degree + 1, terms).
    """
    from scipy.special import eval_jacobi

    s, w = legendre.leggauss(terms + low + high + 2)
    f = np.stack(
        [
            (1 - s) ** high * (1 + s) ** low * eval_jacobi(k, 2 * high, 2 * low, s)
            for k in range(terms)
        ]
    )
    f /= np.sqrt(f**2 @ w)[:, None]
    degree = terms - 1 + low + high
    c = (legendre.legvander(s, degree) * (np.arange(degree + 1) + 0.5) * w[:, None]).T @ f.T
    slopes = [legendre.legder(c, k) for k in (1, 2)]
    return c, *(np.vstack([g, np.zeros((degree + 1 - len(g), terms))]) for g in slopes)


nodes = cache(legendre.leggauss)
"""Places and weights of Gauss's sums."""


@dataclass(frozen=True)
class Axis:
    """The functions f_i of one axis, 0 .. length in m, and their integrals."""

    length: float
    terms: int
    low: str  # how the edge at 0 is held: F, S or C
    high: str

    @cached_property
    def series(self) -> list[np.ndarray]:
        """Legendre series in s = 2 x/length - 1 of f, f' and f''."""
        scale = 2 / self.length
        found = [
            c * scale ** (0.5 + k)
            for k, c in enumerate(basis(self.terms, HELD[self.low], HELD[self.high]))
        ]
        for c in found:
            c.flags.writeable = False  # all who ask share them
        return found

    def _powers(self, x) -> np.ndarray:
        """Return the Legendre polynomials at positions.

        The shape is (positions, degree + 1).
        """
        return legendre.legvander(
            2 * np.asarray(x, float) / self.length - 1, len(self.series[0]) - 1
        )

    def at(self, x, derivative: int = 0) -> np.ndarray:
        """Return the functions' values at positions, shape (positions, terms)."""
        return self._powers(x) @ self.series[derivative]

    def _gauss(self, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        s, w = nodes(self.terms + 6)
        return low + (high - low) * (s + 1) / 2, w * (high - low) / 2

    def products(self, low: float = 0.0, high: float | None = None) -> tuple[np.ndarray, ...]:
        """Return integrals of f_i f_j, f_i' f_j', f_i'' f_j'' and f_i'' f_j."""
        x, w = self._gauss(low, self.length if high is None else high)
        powers = self._powers(x)
        f, g, h = (powers @ c for c in self.series)
        return (f.T * w) @ f, (g.T * w) @ g, (h.T * w) @ h, (h.T * w) @ f

    def integral(self, low: float, high: float, derivative: int = 0) -> np.ndarray:
        """Return the integral of f_i, or of a derivative, from low to high."""
        x, w = self._gauss(low, high)
        return w @ self.at(x, derivative)

    def turning(self, x: float) -> np.ndarray:
        """Return f_i' f_j' at a position, for a rotational spring there."""
        g = self.at([x], 1)[0]
        return np.outer(g, g)


def bending(x: tuple[np.ndarray, ...], y: tuple[np.ndarray, ...], nu: float) -> np.ndarray:
    """Return twice the bending energy of products of functions, for D = 1 N m.

    The integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2.
    """
    coupled = np.kron(x[3], y[3].T)
    return (
        np.kron(x[2], y[0])
        + np.kron(x[0], y[2])
        + nu * (coupled + coupled.T)
        + 2 * (1 - nu) * np.kron(x[1], y[1])
    )
