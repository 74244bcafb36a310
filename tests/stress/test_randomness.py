"""Statistics of the noise see what is wrong with it, each its own; and nothing where it is right."""

import numpy as np
import pytest
from stress import randomness

LINE = 0.05 * np.sin(np.arange(randomness.BLOCK) * (2 * np.pi / 64))
FAULTS = {
    "distribution": lambda y: np.round(y, 2),
    "4 sigma": lambda y: np.clip(y, -4, 4),
    "moment 1": lambda y: y + 0.02,
    "moment 2": lambda y: 1.02 * y,
    "moment 3": lambda y: y + 0.02 * y * y,
    "moment 4": lambda y: y + 0.01 * y**3,
    "Kolmogorov": lambda y: y + 0.2 * np.roll(y, 1),
    "the largest line": lambda y: y + LINE,
    "coherence": lambda y: y + 0.1 * y[::-1],
}


@pytest.mark.parametrize("what", [None, *FAULTS])
def test_a_fault_is_seen_by_its_test(what, monkeypatch):
    y = np.random.default_rng(0).standard_normal((2, randomness.BLOCK))
    monkeypatch.setattr(randomness, "samples_of", lambda *sources: iter([FAULTS[what](y) if what else y]))
    failed = [row.test for row in randomness.of_samples(1) if row.p < randomness.FAILED]
    assert any(what in test for test in failed) if what else not failed, failed


@pytest.mark.parametrize("given", ["--samples nan", "--samples 5", "--only nothing", "--only samples --record"])
def test_wrong_arguments_say_so_and_write_nothing(given, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["randomness.py", *given.split()])
    with pytest.raises(SystemExit) as e:
        randomness.main()
    assert e.value.code == 2 and given.split()[0] in capsys.readouterr().err.splitlines()[-1]


def test_bits_are_those_of_the_samples():
    """The words that dieharder gets, put into Box and Muller's formula, are what white_noise gives."""
    m = 50
    words = np.frombuffer(next(randomness.bits_of((3, 1), (4, 1))), np.uint64)[: 4 * m].reshape(m, 2, 2)
    y = next(randomness.samples_of((3, 1), (4, 1)))[:, : 2 * m]
    radius = np.sqrt(-2 * np.log((words[..., 0] + 0.5) / 2.0**64)).T
    np.testing.assert_allclose(np.hypot(y[:, ::2], y[:, 1::2]), radius, rtol=1e-13)
    back = np.frombuffer(next(randomness.uniform((3, 1), (4, 1))), np.uint32)[: 4 * m].reshape(2 * m, 2)
    assert np.array_equal(back.T > 2**31, y > 0)
