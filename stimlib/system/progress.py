"""The progress bar."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache

announce: list[Callable[[str], None]] = []
"""Who is told, before it begins, of work that takes long and is done once: the command
line prints it.
"""

counted: list[Callable[[int, int], None]] = []
"""Who counts what is compiled: called with lines of source that will be compiled, and
with lines that just have been.
"""


@contextmanager
def progress(
    what: str,
    total: float | None,
    wanted: bool | str = True,
    *,
    left: bool = True,
    counted: bool = False,
) -> Iterator[Callable[..., None]]:
    """Show a progress bar on stderr.

    Parameters
    ----------
    what : str
        What is going on.
    total : float or None
        Steps, or None where they are not known.
    wanted : bool or "always"
        True where stderr is a terminal, "always" anywhere.
    left : bool
        Estimate the time left, from steps that take about as long as each other.
    counted : bool
        Also show how many steps of how many are done.

    Yields
    ------
    callable
        Called with the steps just done, with another text if that has changed, and
        with ``more``, the steps to add to the total.

    Examples
    --------
    >>> from stimlib.system.progress import progress
    >>> with progress("counting", 3) as advance:
    ...     for _ in range(3):
    ...         advance(1)
    """
    if not wanted or (wanted is True and not (sys.stderr and sys.stderr.isatty())):
        yield lambda done, text="", more=0: None
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn

    with Progress(
        *Progress.get_default_columns()[: None if left else -1],
        *[MofNCompleteColumn()] * counted,
        TimeElapsedColumn(),
        console=Console(stderr=True, emoji=False),
    ) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done, text=what, more=0: bar.update(
            task,
            advance=done,
            description=text,
            total=(bar.tasks[task].total or 0) + more if more else None,
        )


@contextmanager
def compiling(wanted: bool = True) -> Iterator[None]:
    """Show a progress bar while this context compiles something for the first time.

    The bar counts lines of source: those that the cache does not have yet, and those
    that have been compiled. There is no bar if the cache has everything, or if stderr
    is no terminal.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.scenes import tone
    >>> from stimlib.system.progress import compiling
    >>> with compiling():
    ...     stimlib.compile(tone(), fs=8000).outputs
    ('signal',)
    """
    with ExitStack() as stack:
        bar = cache(lambda: stack.enter_context(progress("compiling", 0, left=False)))
        if wanted and sys.stderr and sys.stderr.isatty():
            counted[:] = [lambda more, done: bar()(done, more=more) if more or done else None]
            stack.callback(counted.clear)
        yield
