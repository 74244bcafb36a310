"""Designs on the disk: read back bit for bit, made again when a file is not sound."""

import hashlib
import io
import math
import os
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest

from stimlib.design import kept as module
from stimlib.design.filters import differentiator_taps
from stimlib.design.kept import kept

CALLS = []


class Fit(NamedTuple):
    taps: np.ndarray
    error: float


def same(a, b):
    return a.taps.tobytes() == b.taps.tobytes() and a.error == b.error


def design(module, value):
    def named() -> Fit:
        return Fit(np.full(3, value), value)

    named.__module__ = module
    return kept(named)()


@kept
def fit(n: float, scale: float = 3.0) -> Fit:
    CALLS.append(n)
    return Fit(np.arange(n) / scale, -math.inf)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("STIMLIB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(module, "SLOW", -1.0)
    CALLS.clear()
    return tmp_path / "cache"


def test_a_slow_design_is_made_once_for_all_processes(folder, monkeypatch):
    first, again = fit(5.0), fit(5.0)
    assert CALLS == [5.0] and same(first, again) and not again.taps.flags.writeable
    assert type(again.error) is float
    assert not same(fit(5.0, 2.0), first) and len(CALLS) == 2
    assert not same(fit(5.0, scale=4.0), first) and len(CALLS) == 3
    monkeypatch.setattr(module, "_salt", lambda: "another text of the design")
    assert same(fit(5.0), first) and len(CALLS) == 4
    assert {p.suffix for p in folder.iterdir()} == {".npz"} and len([*folder.iterdir()]) == 4
    assert [design(m, v).error for m, v in (("a", 1.0), ("b", 2.0), ("a", 3.0))] == [1, 2, 1]


def test_another_text_or_machine_makes_its_own_designs(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "__file__", str(tmp_path / "kept.py"))
    text, salt, found = tmp_path / "filters.py", module._salt.__wrapped__, []
    for made, machine, node in [("1", "m", "n"), ("2", "m", "n"), ("2", "o", "n"), ("2", "o", "p")]:
        text.write_text(made)
        monkeypatch.setattr("platform.machine", lambda machine=machine: machine)
        monkeypatch.setattr("platform.node", lambda node=node: node)
        assert salt() == salt()
        found.append(salt())
    assert len(set(found)) == 4


def test_a_fast_design_is_not_kept_and_neither_is_one_without_a_folder(folder, monkeypatch):
    monkeypatch.setattr(module, "SLOW", 1.0)
    assert same(fit(5.0), fit(5.0)) and CALLS == [5.0, 5.0] and not folder.exists()
    monkeypatch.setattr(module, "SLOW", -1.0)
    folder.write_text("no folder")
    assert same(fit(5.0), fit(5.0)) and len(CALLS) == 4


class Bomb:
    def __reduce__(self):
        return CALLS.append, ("ran",)


def archive(taps):
    data = io.BytesIO()
    np.savez(data, taps=taps, error=0.0)
    return data.getvalue()


def pickled():
    data = archive(np.array([Bomb()], object))
    return hashlib.sha256(data).digest() + data


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[:-1],
        lambda data: data[:100] + bytes([data[100] ^ 1]) + data[101:],
        lambda data: pickled(),
        lambda data: data[:32] + archive(np.zeros(5)),
        lambda data: hashlib.sha256(b"no archive").digest() + b"no archive",
    ],
    ids=["empty", "truncated", "a bit", "a pickle", "others", "no archive"],
)
def test_a_damaged_file_runs_nothing_and_is_made_again(folder, damage):
    first = fit(5.0)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    assert same(fit(5.0), first) and CALLS == [5.0, 5.0] and path.read_bytes() == whole


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no modes of files on this system")
def test_a_file_or_folder_that_others_may_change_is_not_read(folder):
    fit(5.0)
    (path,) = folder.iterdir()
    assert path.stat().st_mode & 0o777 == 0o600
    path.chmod(0o666)
    fit(5.0)
    folder.chmod(0o777)
    fit(5.0)
    assert CALLS == [5.0] * 3
    path.unlink()
    fit(5.0)
    assert not [*folder.iterdir()], "nothing is written where others may write"


def test_a_differentiator_is_kept(folder):
    numbers = 8000.0, 1000.0, 1500.0, 128
    fresh = differentiator_taps.__wrapped__.__wrapped__(*numbers)
    for _ in range(2):
        assert same(differentiator_taps.__wrapped__(*numbers), fresh)
    assert [p.name[:19] for p in folder.iterdir()] == ["differentiator_taps"]


DESIGNED = """
import hashlib
import stimlib
from stimlib.blocks import differentiator
from stimlib.plate import Plate
filter = differentiator(stimlib.Input("x"), 1000.0)
made = [filter.design(44100.0)[0].taps, *Plate.paper(measured=True).solved(3)]
print(hashlib.sha256(b"".join(a.tobytes() for a in made)).hexdigest())
"""


def test_threads_of_blas_change_no_bits(tmp_path):
    made = set()
    for threads in "12":
        of = {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}
        of["STIMLIB_CACHE"] = str(tmp_path / threads)
        run = [sys.executable, "-W", "ignore", "-c", DESIGNED]
        made.add(subprocess.run(run, env=os.environ | of, capture_output=True, check=True).stdout)
    assert len(made) == 1 and made.pop()
