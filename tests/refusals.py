"""What is refused or warned of: one call, its error or warning and what that says."""

from contextlib import contextmanager

import pytest


def refused(error, says, call, /, *given, **words):
    """Return the error that the call raises: it must be of this kind, with ``says`` in
    its text (None: whatever it says). What is given to the call is made before, so that
    only the call itself may raise.
    """
    with pytest.raises(error, match=says) as info:
        call(*given, **words)
    return info.value


def warned(warning, says, call, /, *given, **words):
    """Return what the call returns, which must warn so (see ``refused``)."""
    with pytest.warns(warning, match=says):
        return call(*given, **words)


@contextmanager
def largest_file(size):
    """Files of this process cannot grow beyond size: the same short writes as on a full
    disk.
    """
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))  # Python ignores SIGXFSZ
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
