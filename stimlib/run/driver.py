"""The loop that drives a processor along a motion.

Rendering, files, replay and verification share it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..motion.source import positions
from .processor import Change

Array = NDArray[np.float64]
Rows = Callable[[int, int], Array] | Array
"""The motion of samples at .. stop - 1, shape (n_inputs, stop - at), rows in the
processor's order; or that of all samples.
"""


def rows_of(sources: dict[str, Any], fs: float) -> Rows:
    """Return checked motion sources in the form that ``walk`` takes."""
    return partial(positions, sources, fs=fs)


def walk(
    proc: Any,
    motion: Rows,
    stop: int,
    changes: Iterable[Change] = (),
    start: int = 0,
    block: int | Callable[[], int] = 8192,
) -> Iterator[tuple[int, Array]]:
    """Run a processor over samples start .. stop - 1.

    Each change of a parameter is made just before its sample.

    Parameters
    ----------
    proc : Processor
        Its next sample is ``start``.
    motion : callable or ndarray of float64, shape (n_inputs, stop)
    changes : iterable of Change
        In the order of their samples.  Those before ``start`` have been made already,
        those from ``stop`` on are left out.
    block : int or callable
        Most samples at once; a callable is asked each time.  The samples do not depend
        on it.

    Yields
    ------
    (int, ndarray of shape (n_outputs, n))
        Index of the first sample, and the samples, valid until the next.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.run.processor import Change
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": stimlib.Param("k", 1.0) * stimlib.Input("x")}),
    ...     fs=1000,
    ...     target="python",
    ... )
    >>> [
    ...     (at, y.tolist())
    ...     for at, y in walk(proc, np.ones((1, 3)), 3, [Change(2, "k", 5.0, 0.0)])
    ... ]
    [(0, [[1.0, 1.0]]), (2, [[5.0]])]
    """
    due = [c for c in changes if start <= c.at < stop][::-1]
    y = np.empty((len(proc.outputs), 0))
    at = start
    while at < stop:
        while due and due[-1].at == at:
            change = due.pop()
            proc.set(change.name, change.value, change.ramp)
        size = block() if callable(block) else block
        end = min([at + size, stop, *(c.at for c in due[-1:])])
        x = motion(at, end) if callable(motion) else np.ascontiguousarray(motion[:, at:end])
        if end - at != y.shape[1]:
            y = np.empty((len(proc.outputs), end - at))
        yield at, proc.process(x, y)
        at = end


def samples(
    proc: Any,
    motion: Rows,
    stop: int,
    changes: Iterable[Change] = (),
    start: int = 0,
    block: int | Callable[[], int] = 8192,
    out: Array | None = None,
) -> Array:
    """Return all samples that ``walk`` yields, shape (n_outputs, stop - start)."""
    y = np.empty((len(proc.outputs), stop - start)) if out is None else out
    for at, part in walk(proc, motion, stop, changes, start, block):
        y[:, at - start : at - start + part.shape[1]] = part
    return y
