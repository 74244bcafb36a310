"""Some rows of a table, of whatever format, and how an error in one begins."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


class Batch(Protocol):
    """Some rows of a table."""

    @property
    def rows(self) -> Rows:
        """The numbers of these rows, for messages."""
        ...

    def numbers(self, columns: Sequence[str]) -> Array:
        """Return all cells of columns; ValueError where one is no number.

        The shape is (columns, rows).
        """
        ...

    def texts(self, column: str) -> Sequence[str]:
        """Return all cells of a column."""
        ...


def table_error(
    file: str, problem: str, remedy: str, row: Any = None, column: str | None = None
) -> RecordingError:
    """Return an error of a table with file, row, column and remedy."""
    place = (
        file
        + ("" if row is None else f", row {row}")
        + ("" if column is None else f", column {column}")
    )
    return RecordingError(f"{place}: {problem}; {remedy}")
