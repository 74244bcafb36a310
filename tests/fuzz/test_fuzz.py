"""Whatever was found by fuzzing, and a few changes of good files for each reader on
every run; a minute of them: make stress.
"""

import warnings

import pytest
from fuzz.mutations import mutated
from fuzz.readers import CASES, READERS, attempt
from hypothesis import given, settings, strategies as st

from stimlib.errors import StimlibError

# readers that hold the promise for every input tried so far
OURS = ("csv", "npz", "table", "texture", "ahap", "haptic", "hjif")


@pytest.mark.parametrize(
    "case",
    sorted(p for p in CASES.glob("*/*") if p.is_file()),
    ids=lambda p: f"{p.parent.name}/{p.name}",
)
def test_what_was_found_stays_mended(case):
    attempt(case.parent.name, case.read_bytes())


@pytest.mark.parametrize("name", READERS)
def test_the_good_files_are_good(name):
    for data in READERS[name].seeds():
        assert not isinstance(attempt(name, data), StimlibError)


@pytest.mark.parametrize("name", OURS)
def test_changed_files_give_a_result_or_an_error_of_stimlib(name):
    seeds = READERS[name].seeds()

    @settings(max_examples=40)
    @given(data=st.data())
    def changed(data):
        below = lambda n: data.draw(st.integers(0, n - 1))  # noqa: E731
        attempt(name, mutated(data.draw(st.sampled_from(seeds)), name, below))

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        changed()
