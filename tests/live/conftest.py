"""One browser for all tests of a worker that open a page."""

from contextlib import closing

import pytest
from live.chromium import Browser, where


@pytest.fixture(scope="session")
def browser():
    if where() is None:
        pytest.skip("Chromium is not installed: tests/devices/install.sh installs it")
    with closing(Browser()) as made:
        yield made
