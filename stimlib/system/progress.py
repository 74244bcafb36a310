"""The progress bar."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

announce: list[Callable[[str], None]] = []
"""Who is told, before it begins, of work that takes long and is done once: the command
line prints it.
"""


@contextmanager
def progress(
    what: str,
    total: float | None,
    wanted: bool | str = True,
    *,
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
    counted : bool
        Also show how many steps of how many are done.

    Yields
    ------
    callable
        Called with the steps just done, and with another text if that has changed.

    Examples
    --------
    >>> from stimlib.system.progress import progress
    >>> with progress("counting", 3) as advance:
    ...     for _ in range(3):
    ...         advance(1)
    """
    if not wanted or (wanted is True and not (sys.stderr and sys.stderr.isatty())):
        yield lambda done, text="": None
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn

    with Progress(
        *Progress.get_default_columns(),
        *[MofNCompleteColumn()] * counted,
        TimeElapsedColumn(),
        console=Console(stderr=True, emoji=False),
    ) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done, text=what: bar.update(task, advance=done, description=text)
