"""Laws of the blocks of the family ``noise``."""

import numpy as np

from ..linear import COMPLEX, Modes, response


@response("Pinking", "PinkNoise", "ColouredNoise", exact=False)
def _pink(b, fs):  # poles and weights are a best fit, which (a2) holds
    p = b.design(fs)[0]
    some = p.r != 0
    return Modes(
        p.d + p.r.sum(),
        p.r[some] * p.p[some],
        np.log(np.where(p.p[some] == 0, 1e-300, p.p[some]).astype(COMPLEX)),
    )
