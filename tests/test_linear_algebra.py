"""Linear algebra with the same results on every run."""

import threading

import numpy  # noqa: F401 - alone, this file would have no BLAS
from threadpoolctl import threadpool_info

from stimlib.system.linear_algebra import one_thread


def test_blas_has_one_thread_for_each_caller_in_turn():
    """The limit is the process's: of two callers, one would end or keep the other's."""

    def threads():
        return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

    def other():
        with one_thread():
            inside.set()
            seen.append(threads())

    inside, seen, before = threading.Event(), [], threads()
    thread = threading.Thread(target=other)
    with one_thread():
        thread.start()
        assert not inside.wait(0.1)
    thread.join(10.0)
    assert seen == [{1}]
    assert threads() == before
