"""Linear algebra whose results are the same on every run."""

from __future__ import annotations

from threadpoolctl import threadpool_limits


def one_thread() -> threadpool_limits:
    """Return a context in which BLAS and LAPACK use one thread.

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
    return threadpool_limits(1, "blas")
