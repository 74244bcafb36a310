"""Motions and selections as text, on a command line or in a sidecar.

No text is executed.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Collection, Iterable
from contextlib import suppress
from typing import Any

from ..errors import BadValue, public, shortened
from .generators import GENERATORS, Motion

MAX_SPEC = 10_000  # characters of a text that is looked at


@public
def parse_motion(text: str) -> Motion:
    """Return the motion that a text, such as one from a command line, describes.

    Parameters
    ----------
    text : str
        A call of one of ``stimlib.motion.generators``. Arguments are number literals,
        None, True, False and, for a parameter that is a motion, another such call.

    Returns
    -------
    Motion
        ``parse_motion(repr(m)) == m`` for every motion m made of these generators.

    Raises
    ------
    BadValue
        The text is anything else (the message lists the generators), or a generator
        rejects an argument.

    Examples
    --------
    >>> from stimlib.motion import parse_motion
    >>> parse_motion("sinusoid(0.01, 1)")
    sinusoid(amplitude=0.01, freq=1.0, mean=0.0, phase=0.0)
    >>> parse_motion("quantised(minimum_jerk(depth=0.01, hold=1), 1e-6)")(
    ...     [0.0, 0.6]
    ... ).tolist()
    [0.0, 0.01]
    """
    if len(text) > MAX_SPEC:
        raise BadValue(
            f"a motion of {len(text)} characters is too long, {MAX_SPEC} at most. {_usage()}"
        )
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        motion = _value(tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        if isinstance(error, BadValue):
            raise
        raise BadValue(f"cannot read {shortened(text)} as a motion. {_usage()}") from None
    if not isinstance(motion, Motion):
        raise BadValue(f"{shortened(text)} is not a motion. {_usage()}")
    return motion


def _value(node: ast.expr) -> Any:
    """Return the value of one node of the syntax tree of a motion."""
    with suppress(ValueError, TypeError):
        literal = ast.literal_eval(node)
        if literal is None or isinstance(literal, bool | int | float):
            return literal
    if (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in GENERATORS
    ):
        generator = GENERATORS[node.func.id]
        args = [_value(a) for a in node.args]
        kwargs = {k.arg or "**": _value(k.value) for k in node.keywords}
        signature = inspect.signature(generator)
        try:
            signature.bind(*args, **kwargs)
        except TypeError as error:
            parameters = ", ".join(
                str(p.replace(annotation=p.empty)) for p in signature.parameters.values()
            )
            why = str(error).replace("got an unexpected keyword argument", "there is no argument")
            raise BadValue(f"{node.func.id}({parameters}): {why}") from None
        return generator(*args, **kwargs)
    raise BadValue(f"{shortened(ast.unparse(node))} is not understood in a motion. {_usage()}")


def _usage() -> str:
    return (
        f"Write a call with plain numbers of one of: {', '.join(GENERATORS)}; for example"
        " minimum_jerk(depth=0.01)"
    )


@public
def parse_map(items: Iterable[str]) -> dict[str, str]:
    """Parse column mappings written as INPUT=EXPRESSION.

    Parameters
    ----------
    items : iterable of str

    Returns
    -------
    dict of str to str
        ``columns`` of `recording`, which checks the expressions.

    Raises
    ------
    BadValue
        An item has another form, or an input occurs twice.

    Examples
    --------
    >>> from stimlib.motion import parse_map
    >>> parse_map(["x=force_N*5e-4", "y = (y_raw - 10)*2e-5"])
    {'x': 'force_N*5e-4', 'y': '(y_raw - 10)*2e-5'}
    """
    return pairs(items, "map", "INPUT=COLUMN or INPUT=COLUMN*NUMBER, such as x=force_N*5e-4")


@public
def parse_where(text: str) -> dict[str, str]:
    """Parse a selection of rows written as COLUMN=VALUE,COLUMN=VALUE.

    Parameters
    ----------
    text : str

    Returns
    -------
    dict of str to str
        ``where`` of `recording`, which compares numbers as numbers.

    Raises
    ------
    BadValue
        The text has another form, or a column occurs twice.

    Examples
    --------
    >>> from stimlib.motion import parse_where
    >>> parse_where("grasp=pinch,level=easy,trial=1")
    {'grasp': 'pinch', 'level': 'easy', 'trial': '1'}
    """
    return pairs(text.split(","), "where", "COLUMN=VALUE,COLUMN=VALUE, such as grasp=pinch,trial=1")


def pairs(items: Iterable[str], what: str, form: str) -> dict[str, str]:
    """Return NAME=VALUE texts as a dict.

    BadValue is raised if a text has another form, or a name occurs twice.
    """
    found: dict[str, str] = {}
    for item in items:
        name, _, value = (part.strip() for part in item.partition("="))
        if not name or not value:
            raise BadValue(f"{what} {item!r}: write {form}")
        if name in found:
            raise BadValue(f"{what}: {name} is given twice, {found[name]!r} and {value!r}")
        found[name] = value
    return found


def served_by(name: str, recorded: Collection[str], inputs: Collection[str]) -> str | None:
    """Return the recorded column that drives an input.

    It is the input's own column, or the column without the input's number if the scene
    has no input of that name.

    Examples
    --------
    >>> from stimlib.motion.text import served_by
    >>> served_by("x1", ["x", "press"], ["x1", "x2"])
    'x'
    """
    stem = re.sub(r"[0-9]+\Z", "", name)
    if name in recorded:
        return name
    return stem if stem in recorded and stem not in inputs else None
