"""Work in threads beside the caller, for what lets go of the interpreter: hashes, numpy's loops, files."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any, TypeVar

T = TypeVar("T")


@contextmanager
def beside(*stages: Callable[[T], Any], room: int = 2) -> Iterator[Callable[[T], None]]:
    """Call functions with one item after another, each function in a thread of its own, while the caller makes the next item.

    When the ``with`` block ends, all items are done and the threads have ended.  Where it ends by an error, those that were given
    before are done first; by an interrupt, those that wait are left.

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
        What a function raises; of several errors that of the earliest item, also where the ``with`` block raises one.

    Examples
    --------
    >>> from stimlib.core.beside import beside
    >>> squares, sums = [], []
    >>> with beside(lambda x: squares.append(x * x), lambda x: sums.append(x + x)) as give:
    ...     for x in range(3):
    ...         give(x)
    >>> squares, sums
    ([0, 1, 4], [0, 2, 4])
    """
    due: deque[list[Future[Any]]] = deque()

    def finish(left: int) -> None:
        while len(due) > left:
            for done in due[0]:
                done.result()
            due.popleft()

    with ExitStack() as stack:
        threads = [ThreadPoolExecutor(1, "stimlib-beside") for _ in stages]
        for thread in threads:
            stack.callback(thread.shutdown, cancel_futures=True)

        def give(item: T) -> None:
            finish(room - 1)
            due.append([thread.submit(stage, item) for thread, stage in zip(threads, stages, strict=True)])

        try:
            yield give
        except Exception:
            finish(0)
            raise
        finish(0)
