"""Batches of rows of a table in any format, and the errors about them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError, StimlibError

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
# counts, among some names, the columns that will be used
Known = Callable[[Sequence[str]], int]
# periods and s without a row: a silence, which is no part of a motion unless max_gap
# says so, and after which rows at a rate are counted anew
LOST = 10, 0.1


class Batch(Protocol):
    """A batch of rows of a table."""

    @property
    def rows(self) -> Rows:
        """Numbers of these rows, for error messages."""

    def numbers(self, columns: Sequence[str]) -> Array:
        """Return the cells of some columns as numbers, or raise ValueError.

        The shape is (columns, rows).
        """

    def texts(self, column: str) -> Sequence[str]:
        """Return the cells of a column as texts."""


def table_error(
    file: str, problem: str, remedy: str, row: Any = None, column: str | None = None
) -> RecordingError:
    """Return an error about a table, with file, row, column and remedy."""
    if row is not None:
        file += f", row {row}"
    if column is not None:
        file += f", column {column}"
    return RecordingError(f"{file}: {problem}; {remedy}")


@contextmanager
def reading(file: str, form: str, remedy: str, column: str | None = None) -> Iterator[None]:
    """Turn whatever a library raises about a file into an error about it."""
    try:
        yield
    except StimlibError:
        raise
    except Exception as error:
        problem = f"cannot be read as {form} ({str(error)[:200] or type(error).__name__})"
        raise table_error(file, problem, remedy, None, column) from None
