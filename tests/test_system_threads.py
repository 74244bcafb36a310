"""Threads beside the caller: every item in order, the earliest error, and no thread
left.
"""

import threading
import time

import pytest
from threadpoolctl import threadpool_info

from stimlib.system.linear_algebra import one_thread
from stimlib.system.threads import beside


def test_each_stage_gets_every_item_in_order_in_a_thread_of_its_own():
    seen, threads = ([], []), (set(), set())

    def stage(k):
        return lambda item: (seen[k].append(item), threads[k].add(threading.get_ident()))

    with beside(stage(0), stage(1)) as give:
        for i in range(50):
            give(i)
    assert seen == (list(range(50)),) * 2
    assert len(set.union(*threads, {threading.get_ident()})) == 3


@pytest.mark.parametrize("room", [1, 5])
def test_the_caller_waits_where_room_items_wait(room):
    begun, go, given = [], threading.Event(), []

    def slow(item):
        begun.append(item)
        go.wait(60)

    def let_go():
        given.append("waited")
        go.set()

    with beside(slow, room=room) as give:
        for i in range(room):
            give(i)
            given.append(i)
        threading.Timer(0.05, let_go).start()
        give(room)
        given.append(room)
    assert given == [*range(room), "waited", room] and begun == list(range(room + 1))


@pytest.mark.parametrize(
    ("first", "own", "expected"),
    [
        (1, None, ValueError),
        (1, KeyError("mine"), ValueError),
        (1, KeyboardInterrupt(), KeyboardInterrupt),
        (3, KeyError("mine"), KeyError),  # where the items are fine
    ],
)
def test_the_earliest_error_is_raised_and_nothing_goes_on(first, own, expected):
    busy = []

    def fails(item):
        busy.append(item)
        time.sleep(0.01)
        busy.pop()
        if item >= first:
            raise ValueError(item)

    with pytest.raises(expected) as info, beside(fails, room=3) as give:
        for i in range(3):
            give(i)
        if own is not None:
            raise own
    assert (info.value is own or info.value.args == (1,)) and not busy


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
