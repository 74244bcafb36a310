"""Calls of an experimenter's own code, with errors reported as such."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from ..errors import BadValue, StimlibError


def called(what: str, function: Callable[..., Any], *words: Any) -> Any:
    """Call a user's function and return its result; an error names the function.

    Parameters
    ----------
    what : str
        The role of the function in the experiment, such as ``"the observer"``.
    function : callable
    *words
        The arguments of the function.

    Raises
    ------
    BadValue
        The function raises an error; the line in its file is named.

    Examples
    --------
    >>> from stimlib.experiments.user_code import called
    >>> called("the observer", lambda trial: 1 / 0, None)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    stimlib.errors.BadValue: the observer (<doctest ..., line 1): ZeroDivisionError: ...
    """
    try:
        return function(*words)
    except StimlibError:
        raise
    except Exception as e:
        frames = traceback.extract_tb(e.__traceback__)[1:]
        lines = [f.lineno for f in frames if f.filename == frames[0].filename]
        at = f" ({frames[0].filename}, line {lines[-1]})" if lines else ""
        raise BadValue(f"{what}{at}: {type(e).__name__}: {e}") from e
