"""Statistics of the noise see what is wrong with it, each its own; and nothing where it
is right.
"""

from contextlib import nullcontext
from itertools import islice

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
    monkeypatch.setattr(
        randomness, "samples_of", lambda *sources: iter([FAULTS[what](y) if what else y])
    )
    failed = [row.test for row in randomness.of_samples(1) if row.p < randomness.FAILED]
    assert any(what in test for test in failed) if what else not failed, failed


def test_bits_are_those_of_the_samples():
    """The words that dieharder gets, put into Box and Muller's formula, are what
    white_noise gives.
    """
    m = 50
    words = np.frombuffer(next(randomness.bits_of((3, 1), (4, 1))), np.uint64)[: 4 * m].reshape(
        m, 2, 2
    )
    y = next(randomness.samples_of((3, 1), (4, 1)))[:, : 2 * m]
    radius = np.sqrt(-2 * np.log((words[..., 0] + 0.5) / 2.0**64)).T
    np.testing.assert_allclose(np.hypot(y[:, ::2], y[:, 1::2]), radius, rtol=1e-13)
    back = np.frombuffer(next(randomness.uniform((3, 1), (4, 1))), np.uint32)[: 4 * m].reshape(
        2 * m, 2
    )
    assert np.array_equal(back.T > 2**31, y > 0)


@pytest.mark.parametrize(
    ("p", "said", "fails"),
    [(2e-6, "WEAK", False), (0.5e-6, "", True), (0.4, "FAILED", True)],
    ids=["weak", "p", "said"],
)
def test_a_failure_is_an_error_and_stands_in_the_table(p, said, fails, monkeypatch, tmp_path):
    rows = [
        randomness.Row("bits", "first", "1 GB", 0.5, "PASSED"),
        randomness.Row("bits", "second", "1 GB", p, said),
    ]
    monkeypatch.setattr(randomness, "jobs", lambda samples: {"bits": lambda: rows})
    monkeypatch.setattr("sys.argv", ["randomness.py", "--record", str(tmp_path / "a.csv")])
    with pytest.raises(SystemExit, match="1 of 2 fail: bits, second") if fails else nullcontext():
        randomness.main()
    table = [line.split(",") for line in (tmp_path / "a.csv").read_text().splitlines()[:2]]
    assert table == [
        ["bits", "first", "1 GB", "0.5", "PASSED"],
        ["bits", "second", "1 GB", f"{p:.2g}", said],
    ]


def test_bits_go_on_and_each_stream_has_those_of_its_name(monkeypatch):
    monkeypatch.setattr(randomness, "BLOCK", 512)

    def first(blocks, count=2):
        return np.frombuffer(b"".join(islice(blocks, count)), np.uint64)

    one = first(randomness.bits_of((1, 0)))
    assert len(one) == 2 * 2 * 512 == 2 * len(np.unique(one[::2]))
    assert np.array_equal(first(randomness.STREAMS["bits of one noise"]()), one)
    for name, other in (("seeds", (77, 0)), ("streams", (1, 77))):
        mixed = first(randomness.STREAMS[f"bits of {name} 0 to 255 in turn"]()).reshape(-1, 256, 2)
        alone = first(randomness.bits_of(other), 1).reshape(-1, 2)
        assert np.array_equal(mixed[:, 77], alone[: len(mixed)])
    fingers = next(randomness.STREAMS["samples of two fingers in turn"]())
    alone = next(randomness.uniform((0, 2)))
    assert np.array_equal(np.frombuffer(fingers, "u4")[1::2], np.frombuffer(alone, "u4"))
