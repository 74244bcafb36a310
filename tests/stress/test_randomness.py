"""Statistics of the noise see what is wrong with it, each its own; and nothing where it
is right.
"""

import os
from collections import defaultdict
from contextlib import nullcontext
from itertools import chain, count, islice, repeat

import numpy as np
import pytest
from scipy import stats
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


@pytest.mark.parametrize(
    "given", ["--samples nan", "--samples 5", "--only nothing", "--only samples --record"]
)
def test_wrong_arguments_say_so_and_write_nothing(given, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["randomness.py", *given.split()])
    with pytest.raises(SystemExit) as e:
        randomness.main()
    assert e.value.code == 2 and given.split()[0] in capsys.readouterr().err.splitlines()[-1]


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


def test_p_values_of_right_noise_are_even(monkeypatch):
    """Of short recordings, where a degree of freedom or a variance that is wrong bends
    them.
    """
    rng, found = np.random.default_rng(2), defaultdict(list)
    monkeypatch.setattr(randomness, "told", lambda row: row)
    for _ in range(30):
        y = rng.standard_normal((2, 2 * randomness.SEGMENT))
        monkeypatch.setattr(randomness, "samples_of", lambda *sources, y=y: iter([y]))
        for row in randomness.of_samples(1):
            if "tail" not in row.test:  # of a few counts: a step is no even distribution
                found[row.test].append(row.p)
    assert len(found) == 9
    for test, p in found.items():
        squares = np.sum(stats.norm.isf(np.array(p) / 2) ** 2)
        assert (
            stats.kstest(p, "uniform").pvalue > 1e-3 < stats.chi2.sf(squares, len(p)) < 1 - 1e-3
        ), test


def test_tails_are_those_of_the_binomial_distribution(monkeypatch):
    """Too many beyond 3 sigma and too few are as unlikely."""
    n, part = randomness.BLOCK, 2 * stats.norm.sf(3)
    calm = np.clip(np.random.default_rng(3).standard_normal((2, n)), -2.9, 2.9)
    for many in (round(n * part + z * np.sqrt(n * part)) for z in (-3, 3)):
        y = calm.copy()
        y[:, :many] = 3.5
        monkeypatch.setattr(randomness, "samples_of", lambda *sources, y=y: iter([y]))
        (p,) = {row.p for row in randomness.of_samples(1) if f"{many} beyond 3" in row.test}
        assert p == pytest.approx(2 * stats.norm.sf(3), rel=0.2)


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


def test_of_a_test_that_drew_more_the_last_word_counts(monkeypatch, tmp_path):
    program = tmp_path / "dieharder"
    said = "name,0,0.001,WEAK\\nname,1,0.3,PASSED\\nname,0,1e-9,FAILED"
    program.write_text(
        f'#!/bin/sh\necho "$@" > {tmp_path}/asked\nhead -c 3000000 > {tmp_path}/got\nprintf'
        f" '{said}\\n'\n"
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    blocks = [bytes([k]) * 1_000_000 for k in range(3)]
    rows = randomness.dieharder("bits", chain(blocks, repeat(bytes(1_000_000))), 200, 8)
    assert [(row.test[-6:], row.p, row.said) for row in rows] == [
        ("name 0", 1e-9, "FAILED"),
        ("name 1", 0.3, "PASSED"),
    ]
    assert rows[0].amount in ("0.003 GB", "0.004 GB") and (
        tmp_path / "got"
    ).read_bytes() == b"".join(blocks)
    assert (tmp_path / "asked").read_text().startswith("-g200 -Y1 -d200 -n8 ")


def test_every_test_of_dieharder_goes_on_in_the_stream_where_another_ended(monkeypatch):
    ended = []
    monkeypatch.setattr(
        randomness,
        "dieharder",
        lambda *asked: ended.append((*asked[2:], next(asked[1]))) or [asked[0]],
    )
    monkeypatch.setitem(randomness.STREAMS, "numbers", lambda: count())
    rows = randomness.of_bits("numbers")
    wanted = {(number, size) for number, sizes in randomness.DIEHARDER.items() for size in sizes}
    assert (
        wanted
        == {(number, size) for number, size, _ in ended}
        > {(200, 1), (200, 8), (203, 3), (0, 0)}
    )
    assert [n for *_, n in ended] == list(range(len(wanted))) and rows == ["numbers"] * len(wanted)


@pytest.mark.parametrize("installed", [False, True])
def test_without_dieharder_its_tests_are_told_to_be_left_out(installed, monkeypatch, capsys):
    monkeypatch.setattr(randomness.shutil, "which", lambda name: "/there" if installed else None)
    assert [*randomness.jobs(1)] == [
        "samples of each finger",
        *(randomness.STREAMS if installed else []),
    ]
    assert ("its tests are left out" in capsys.readouterr().err) == (not installed)


def test_as_many_samples_are_taken_as_are_asked_for(monkeypatch):
    y = np.random.default_rng(0).standard_normal((2, 2 * randomness.SEGMENT))
    monkeypatch.setattr(randomness, "samples_of", lambda *sources: repeat(y))
    assert {row.amount for row in randomness.of_samples(20_000)} == {"2.5e+04 samples"}


def test_bits_go_on_and_each_stream_has_those_of_its_name(monkeypatch):
    monkeypatch.setattr(randomness, "BLOCK", 512)

    def first(blocks, count):
        return np.frombuffer(b"".join(islice(blocks, count)), np.uint64)

    one = first(randomness.bits_of((1, 0)), 2).reshape(-1, 2)
    assert len(one) == 2 * 512 == len(np.unique(one[:, 0]))
    assert np.array_equal(first(randomness.STREAMS["bits of one noise"](), 2), one.ravel())
    for name, other in (("seeds", (77, 0)), ("streams", (1, 77))):
        mixed = first(randomness.STREAMS[f"bits of {name} 0 to 255 in turn"](), 2).reshape(
            -1, 256, 2
        )
        assert np.array_equal(
            mixed[:, 77], first(randomness.bits_of(other), 1).reshape(-1, 2)[: len(mixed)]
        )
    fingers = np.frombuffer(
        next(randomness.STREAMS["samples of two fingers in turn"]()), np.uint32
    ).reshape(-1, 2)
    for k in (0, 1):
        alone = np.frombuffer(next(randomness.uniform((0, k + 1))), np.uint32)
        assert np.array_equal(fingers[:, k], alone)
