"""White noise: the same at every rate and for all time.  Its arithmetic and its moments
are in test_maths.py.
"""

import mpmath
import numpy as np
from laws import assert_same

import stimlib
from stimlib import Scene
from stimlib.blocks import white_noise
from stimlib.blocks.noise import pair_of_words
from stimlib.checks import laws

NOTHING = np.empty((0, 500))


def test_the_same_sample_at_every_rate():
    """A noise is a function of (keys, sample): the rate does not matter."""
    assert_same(
        *(
            stimlib.compile(Scene({"n": white_noise(3, 4)}), fs).process(NOTHING)
            for fs in (1000.0, 48000.0)
        )
    )


def test_what_it_is_for_all_time():
    """A change of these numbers changes every stimulus ever recorded."""
    y = stimlib.compile(Scene({"n": white_noise(0)}), 8000).process(np.empty((0, 4)))[0]
    late = stimlib.compile(Scene({"n": white_noise(7, 1)}), 8000, seed=42)
    late.process(np.empty((0, 100_000)))
    assert_same(y, np.array(FIRST))
    assert_same(late.process(np.empty((0, 2)))[0], np.array(LATER))


FIRST = [-0.2586643421641892, 0.47280889618782834, 0.6266124952097749, -0.2058550569242391]
LATER = [0.4276765344287945, -0.05785564487978792]


def test_words_of_every_pair_and_key_are_those_of_the_reference():
    """Up to pair 2^63, beyond every run that a test can make."""
    low = 2**32 - 1
    for key, m in ((0, 0), (2**64 - 1, 2**63), (3 << 40 | 5, 2**33 + 7), (9, 2**32)):
        a, b, c, d = laws.philox((m & low, m >> 32, 0, 0), (key & low, key >> 32))
        assert pair_of_words(np.uint64(key), np.uint64(m)) == (a | b << 32, c | d << 32)


def test_samples_give_back_their_bits():
    """Backwards: exp(-(x^2 + y^2)/2) is the first word of a pair, the angle of (x, y)
    the second.
    """
    n, low = 200, 2**32 - 1
    w = laws.philox((7, 0, 1, 0), (42, 0))
    y = stimlib.compile(Scene({"n": white_noise(7, 1)}), 8000, seed=42).process(np.empty((0, n)))[0]
    with mpmath.workdps(40):
        for m, (x0, x1) in enumerate(
            zip(map(mpmath.mpf, y[::2].tolist()), map(mpmath.mpf, y[1::2].tolist()), strict=True)
        ):
            a, b, c, d = laws.philox((m & low, m >> 32, 0, 0), (w[0], w[1]))
            half = (x0 * x0 + x1 * x1) / 2
            assert abs(
                mpmath.exp(-half) - (mpmath.mpf(a | b << 32) + 0.5) / 2**64
            ) <= 1e-15 * mpmath.exp(-half) * (1 + half)
            turn = (
                mpmath.mpf((d >> 30) - 0.5) / 4 + mpmath.mpf(((c | d << 32) >> 11) % 2**51) / 2**53
            )
            apart = mpmath.atan2(x1, x0) / (2 * mpmath.pi) - turn
            assert abs(apart - mpmath.nint(apart)) <= 1e-16
