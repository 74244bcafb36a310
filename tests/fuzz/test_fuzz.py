"""One contract for everything that reads a file: what is no such file, is another's,
is cut or changed gives a result or an error of stimlib's, and nothing is waited for.

A few changes of good files for each reader on every run; many more of them: make
stress.  Each input that breaks the promise is kept in cases/READER, and tried from then
on.
"""

import hashlib
import os
import random
import signal
import warnings
from contextlib import contextmanager
from itertools import product
from pathlib import Path

import pytest
from fuzz.mutations import mutated
from fuzz.readers import CASES, READERS, attempt, place, promised
from laws import STRESS
from refusals import refused

from stimlib.errors import StimlibError

GIGABYTES = 3  # of addresses, beyond what the process has: what asks for more fails


@contextmanager
def little_memory():
    resource = pytest.importorskip("resource")
    with open("/proc/self/statm") as f:
        pages = int(f.read().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    most = pages * resource.getpagesize() + GIGABYTES * 10**9
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@contextmanager
def no_wait(seconds=60):
    """End a reader that waits for a pipe or reads a device, which would never end."""

    def waited(*_):
        raise AssertionError("it never ends: read with stimlib.system.safe_files")

    before = signal.signal(signal.SIGALRM, waited)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize(
    "case",
    sorted(p for p in CASES.glob("*/*") if p.is_file()),
    ids=lambda p: f"{p.parent.name}/{p.name}",
)
def test_what_was_found_stays_mended(case):
    attempt(case.parent.name, case.read_bytes())


@pytest.mark.parametrize("name", READERS)
def test_changed_files_give_a_result_or_an_error_of_stimlib(name):
    seeds, chance = READERS[name].seeds(), random.Random(name)
    with warnings.catch_warnings(), little_memory():
        warnings.simplefilter("error")
        for _ in range(500 if STRESS else 40):
            data = mutated(chance.choice(seeds), name, chance)
            try:
                attempt(name, data)
            except BaseException:
                path = CASES / name / hashlib.sha256(data).hexdigest()[:12]
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
                raise


# -- what is no such file


JUNK = [b"", b"[" * 100_000, b'"' * 3, b"\xff\xfe", b"nan", b"[]", b"x" * (1 << 21)]
NONE = {
    "missing": lambda path: None,
    "a folder": Path.mkdir,
    "a pipe": os.mkfifo,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    **{repr(data[:6]): lambda path, data=data: path.write_bytes(data + b"\n") for data in JUNK},
}
NO_FILE = [*NONE][: -len(JUNK)]


@pytest.mark.parametrize(
    ("name", "what"),
    [pair for pair in product(READERS, NONE) if pair[0] != "motion" or pair[1] in NO_FILE],
)  # motion is any bytes
def test_what_is_no_such_file_is_refused_by_name(tmp_path, name, what):
    path = place(name, tmp_path)
    NONE[what](path)
    if name == "report" and what in NO_FILE:  # a session that was killed has none
        assert READERS[name].read(path).report is None
        return
    with little_memory(), no_wait(), promised():
        error = str(refused(StimlibError, path.name, READERS[name].read, path))
    assert str(path.parent) in error and "\n" not in error and len(error) < 5000


@pytest.mark.parametrize("name", READERS)
def test_the_good_files_are_read_and_the_cut_ones_are_or_are_refused(name):
    for data in READERS[name].seeds():
        assert not isinstance(attempt(name, data), StimlibError)
        for part in (0.01, 0.3, 0.9):
            attempt(name, data[: int(part * len(data))])
