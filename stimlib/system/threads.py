"""Threads for work that releases the interpreter: hashes, numpy loops, files."""

from __future__ import annotations

from _thread import start_new_thread
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")
END: Any = object()


@contextmanager
def beside(*stages: Callable[[T], Any], room: int = 2) -> Iterator[Callable[[T], None]]:
    """Call functions with one item after another, each in a thread of its own.

    The caller makes the next item meanwhile.

    When the ``with`` block ends, all items are done and the threads have ended. If it
    ends by an error, items given before are done first; if by an interrupt, waiting
    items are dropped.

    Parameters
    ----------
    stages : callables of one argument
        Each gets every item, in order.
    room : int
        Items given that are not done by all stages yet; with so many, the caller waits.

    Yields
    ------
    callable
        Gives an item, which nobody may change then.

    Raises
    ------
    BaseException
        What a function raises; of several errors that of the earliest item, also where
        the ``with`` block raises one.

    Examples
    --------
    >>> from stimlib.system.threads import beside
    >>> squares, sums = [], []
    >>> with beside(
    ...     lambda x: squares.append(x * x), lambda x: sums.append(x + x)
    ... ) as give:
    ...     for x in range(3):
    ...         give(x)
    >>> squares, sums
    ([0, 1, 4], [0, 2, 4])
    """
    # An interrupt may come at any moment, and must leave nothing locked that a thread
    # waits for: so no locks, futures or pools.
    queues: list[tuple[SimpleQueue[Any], SimpleQueue[Any]]] = [
        (SimpleQueue(), SimpleQueue()) for _ in stages
    ]
    threads: list[tuple[SimpleQueue[Any], SimpleQueue[Any]]] = []
    given = taken = 0
    left = False

    def work(stage: Callable[[T], Any], todo: SimpleQueue[Any], done: SimpleQueue[Any]) -> None:
        while (item := todo.get()) is not END:
            error = None
            try:
                if not left:
                    stage(item)
            except BaseException as e:
                error = e
            done.put(error)
        done.put(END)

    def take(waiting: int) -> None:
        nonlocal taken
        while given - taken > waiting:
            taken += 1
            for _, done in queues:
                if (error := done.get()) is not None:
                    raise error

    def give(item: T) -> None:
        nonlocal given
        take(room - 1)
        given += 1
        for todo, _ in queues:
            todo.put(item)

    try:
        for stage, (todo, done) in zip(stages, queues, strict=True):
            start_new_thread(work, (stage, todo, done))  # threading.Thread has a lock, too
            threads.append((todo, done))
        try:
            yield give
        except Exception:
            take(0)
            raise
        take(0)
    finally:
        left = True
        for todo, _ in queues:
            todo.put(END)
        for _, done in threads:
            while done.get() is not END:
                pass
