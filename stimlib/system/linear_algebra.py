"""Linear algebra whose results are the same on every run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

from .cache_folder import lock


@contextmanager
def one_thread() -> Iterator[None]:
    """Let BLAS and LAPACK use one thread; other threads that ask for it wait.

    How many threads share a sum decides the order of its terms, and so its last bits:
    a differentiator at 44.1 kHz, or the modes of a plate, would differ between a
    computer with two cores and one with four. On a busy computer one is faster, too:
    threads that wait for each other spin.

    Examples
    --------
    >>> import numpy as np
    >>> with one_thread():
    ...     np.linalg.solve([[2.0]], [1.0])
    array([0.5])
    """
    # the limit is one number of the process: who left first would end it for both, and
    # who left last would leave it behind
    with lock, threadpool_limits(1, "blas"):
        yield
