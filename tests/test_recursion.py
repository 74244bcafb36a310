"""The recursion of laws against scipy.signal, in pieces as a long file gives them."""

import numpy as np
import pytest
import scipy

from stimlib.analysis.recursion import all_pole


@pytest.mark.parametrize("a", [[-0.9], [-1.8, 0.81], [-1.2, 0.3, 0.1]])
def test_pieces_make_what_lfilter_makes(a):
    x, last, got = np.random.default_rng(1).normal(size=200), None, []
    for piece in np.split(x, [0, 1, 1, 3, 6, 100]):
        y, last = all_pole(0.3, a, piece, last)
        got.append(y)
    want = scipy.signal.lfilter([0.3], [1, *a], x)
    assert np.abs(np.concatenate(got) - want).max() < 1e-13 * np.abs(want).max()
    assert np.array_equal(last, np.concatenate(got)[-len(a) :])
