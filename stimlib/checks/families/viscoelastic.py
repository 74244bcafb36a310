"""Laws of the blocks of the family ``viscoelastic``."""

from __future__ import annotations

import numpy as np
import scipy

from .. import laws
from ..linear import LONG, Modes, response, straight
from ..rows import Row


@response("MaxwellArms")
def _arms(b, fs):
    a = 1 / (np.asarray(b.tau, LONG) * LONG(fs))
    g = b.k * -np.expm1(-a) / a
    return Modes(np.sum(g), g * np.expm1(-a), -a)


@response("KelvinChain")
def _chain(b, fs):
    a = np.r_[1 / (np.asarray(b.tau, LONG) * LONG(fs)), [0.0] * (b.fluidity > 0)]
    direct, r, L = straight(
        -a, np.r_[b.j * a[: b.j.size], [b.fluidity / LONG(fs)] * (b.fluidity > 0)]
    )
    return Modes(b.j0 + direct, r, L)


@response("Series", exact=False)
def _series(b, fs):
    """Return the response of two elements in series, g S/(g + S), as a power series.

    f = g (y - z) and f = S z, in powers of 1/z. The reciprocal is computed by Newton's
    method.
    """

    def first(n: int) -> Row:
        S = np.diff(
            laws.springpot_weights(b.scheme, b.order, n) * b.chi * LONG(fs) ** LONG(b.order),
            prepend=LONG(0),
        )
        g = np.zeros(n, LONG)
        g[:2] = (b.other * fs, -b.other * fs)[:n] if b.dashpot else (b.other, 0.0)[:n]
        size = g[0] + S[0]
        whole, v = (g + S) / size, np.ones(1, LONG)
        while v.size < n:
            m = min(2 * v.size, n)
            v = np.pad(v, (0, m - v.size))
            v = (
                v
                + scipy.signal.fftconvolve(
                    v, np.eye(1, m)[0] - scipy.signal.fftconvolve(v, whole[:m])[:m]
                )[:m]
            )
        return scipy.signal.fftconvolve(scipy.signal.fftconvolve(S, g / size)[:n], v)[:n].astype(
            float
        )

    return first
