"""Linear conversions of a column to an input's unit, as text.

Examples are ``force_N*5e-4`` and ``(x_raw - 1472)*2e-5``.
"""

import ast
from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite

from ..errors import BadValue

MAX_EXPRESSION = 1000  # characters


@dataclass(frozen=True)
class Linear:
    """The conversion scale * column + offset, or a constant if ``column`` is None."""

    column: str | None
    scale: float
    offset: float


def expression(what: str, text: str, names: Iterable[str]) -> Linear:
    """Parse a linear conversion of a column.

    A text that equals a column name means that column.

    Raises
    ------
    BadValue
        The text is not a single column multiplied by and added to finite numbers.

    Examples
    --------
    >>> expression("x", "(x_raw - 1472)*2e-5", ["t_s", "x_raw"])
    Linear(column='x_raw', scale=2e-05, offset=-0.02944)
    """
    text = text.strip()
    if text in names:
        return Linear(text, 1.0, 0.0)
    try:
        if len(text) > MAX_EXPRESSION or "\\" in text:  # an escape would be a warning of Python's
            raise ValueError
        linear = _linear(ast.parse(text, mode="eval").body)
        if (
            linear.column is None
            or linear.scale == 0
            or not isfinite(linear.scale)
            or not isfinite(linear.offset)
        ):
            raise ValueError
    except (SyntaxError, ValueError, ArithmeticError, RecursionError, MemoryError):
        shown = repr(text) if len(text) <= 80 else f"a text of {len(text)} characters"
        raise BadValue(
            f"{what}: cannot read {shown}: write one column, times and plus finite numbers, such as"
            " force_N*5e-4 or (x_raw - 1472)*2e-5, with quotes around a name that is not a word,"
            " such as 'Force (N)'*5e-4"
        ) from None
    return linear


def _linear(node: ast.expr) -> Linear:
    """Return the linear conversion that a node of the syntax tree stands for.

    ValueError is raised if it is not linear in one column.
    """
    if isinstance(node, ast.Name):
        return Linear(node.id, 1.0, 0.0)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return Linear(node.value, 1.0, 0.0)
    if (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    ):
        return Linear(None, 0.0, float(node.value))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        return _times(_linear(node.operand), -1.0 if isinstance(node.op, ast.USub) else 1.0)
    if isinstance(node, ast.BinOp):
        return _binary(node.op, _linear(node.left), _linear(node.right))
    raise ValueError


def _binary(op: ast.operator, a: Linear, b: Linear) -> Linear:
    if isinstance(op, ast.Sub):
        op, b = ast.Add(), _times(b, -1.0)
    if isinstance(op, ast.Add) and (a.column is None or b.column is None):
        return Linear(a.column or b.column, a.scale + b.scale, a.offset + b.offset)
    if isinstance(op, ast.Mult) and a.column is None:
        return _times(b, a.offset)
    if isinstance(op, ast.Mult) and b.column is None:
        return _times(a, b.offset)
    if isinstance(op, ast.Div) and b.column is None:
        return Linear(a.column, a.scale / b.offset, a.offset / b.offset)
    raise ValueError


def _times(a: Linear, factor: float) -> Linear:
    return Linear(a.column, a.scale * factor, a.offset * factor)
