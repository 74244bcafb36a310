"""The loop that rendering, files, replay and proofs share: blocks and changes of
parameters.
"""

import numpy as np
import pytest

import stimlib
from stimlib import Input, Param, Scene
from stimlib.run.driver import samples, walk
from stimlib.run.processor import Change

SCENE = Scene({"y": Param("k", 1.0) * Input("x"), "z": Param("b", 0.0) + Input("x")})
X = np.arange(1.0, 101.0)[None]
CHANGES = [Change(-3, "k", 9.0, 0.0), Change(0, "b", 1.0, 0.0)]
CHANGES += [
    Change(7, "k", 2.0, 0.005),
    Change(7, "b", 3.0, 0.0),
    Change(7, "b", 5.0, 0.0),
    Change(99, "k", 0.0, 0.0),
]
CHANGES += [Change(100, "k", 77.0, 0.0)]


def compiled():
    return stimlib.compile(SCENE, 1000, "python")


def expected():
    k = np.ones(100)
    k[7:] = np.minimum(1 + np.arange(1, 94) / 5, 2.0)
    k[99] = 0.0
    return np.vstack([k * X[0], np.where(np.arange(100) < 7, 1.0, 5.0) + X[0]])


@pytest.mark.parametrize("block", [1, 7, 8, 8192, iter([3, 90, 1, 1, 2, 3, 50, 90, 90]).__next__])
def test_changes_act_from_their_sample_on_at_every_block(block):
    proc = compiled()
    y = samples(proc, X, 100, CHANGES, block=block)
    np.testing.assert_allclose(y, expected(), rtol=1e-15)
    assert np.array_equal(y, samples(compiled(), X, 100, CHANGES))
    # none before or after
    assert [(c.at, c.name) for c in proc.log] == [(0, "b"), (7, "k"), (7, "b"), (7, "b"), (99, "k")]


def test_it_goes_on_from_a_sample():
    """What was changed before has been; what is due at that very sample has not."""
    proc, ends = compiled(), (7, 30, 100)
    y = [samples(proc, X, end, CHANGES, at) for at, end in zip((0, *ends), ends, strict=False)]
    assert np.array_equal(np.hstack(y), samples(compiled(), X, 100, CHANGES))


def test_motion_is_asked_for_once_and_in_order():
    asked = []

    def rows(at, stop):
        asked.append((at, stop))
        return X[:, at:stop].copy()

    starts = [at for at, _ in walk(compiled(), rows, 100, CHANGES, block=60)]
    assert asked == [(0, 7), (7, 67), (67, 99), (99, 100)] and starts == [at for at, _ in asked]
    assert list(walk(compiled(), rows, 0)) == [] and len(asked) == 4
