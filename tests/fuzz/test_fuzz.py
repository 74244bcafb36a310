"""Whatever was found by fuzzing, and a few changes of good files for each reader on
every run; many more of them: make stress.

Each input that breaks the promise is kept in cases/READER, and tried from then on.
"""

import hashlib
import random
import warnings
from contextlib import contextmanager

import pytest
from fuzz.mutations import mutated
from fuzz.readers import CASES, READERS, attempt
from laws import STRESS

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


@pytest.mark.parametrize(
    "case",
    sorted(p for p in CASES.glob("*/*") if p.is_file()),
    ids=lambda p: f"{p.parent.name}/{p.name}",
)
def test_what_was_found_stays_mended(case):
    attempt(case.parent.name, case.read_bytes())


@pytest.mark.parametrize("name", READERS)
@pytest.mark.longer
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
