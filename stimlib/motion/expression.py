"""Conversions of columns to an input's unit, as text.

Examples are ``force_N*5e-4``, ``(x_raw - 1472)*2e-5`` and ``hypot(vx, vy)*1e-3``. No
text is executed.
"""

import ast
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from math import isfinite, pow

import numpy as np

from ..errors import BadValue
from .rows import Array

MAX_EXPRESSION = 1000  # characters
FUNCTIONS: dict[str, np.ufunc] = {
    "hypot": np.hypot,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sin": np.sin,
    "cos": np.cos,
    "atan2": np.arctan2,
    "radians": np.radians,
    "min": np.minimum,
    "max": np.maximum,
}
SEVERAL = {"hypot", "min", "max"}  # take two columns or more
OPERATORS: dict[type, np.ufunc] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}


@dataclass(frozen=True)
class Linear:
    """The conversion scale * column + offset, or a constant if ``column`` is None."""

    column: str | None
    scale: float
    offset: float

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return () if self.column is None else (self.column,)

    def of(self, cells: Mapping[str, Array]) -> Array:
        """Return the values for the cells of the columns."""
        if self.column is None:
            return np.array(self.offset)
        return cells[self.column] * self.scale + self.offset

    def renamed(self, name: Callable[[str], str]) -> "Linear":
        """Return the conversion with other names of columns."""
        return self if self.column is None else replace(self, column=name(self.column))


@dataclass(frozen=True)
class Combined:
    """A function of several columns, or one that is not linear."""

    function: np.ufunc
    parts: tuple["Linear | Combined", ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, each once."""
        return tuple(dict.fromkeys(name for part in self.parts for name in part.columns))

    def of(self, cells: Mapping[str, Array]) -> Array:
        """Return the values for the cells of the columns."""
        values: Array = self.function(*(part.of(cells) for part in self.parts))
        return values

    def renamed(self, name: Callable[[str], str]) -> "Combined":
        """Return the function with other names of columns."""
        return replace(self, parts=tuple(part.renamed(name) for part in self.parts))


Expression = Linear | Combined


def expression(what: str, text: str, names: Iterable[str]) -> Expression:
    """Parse a conversion of columns.

    A text that equals a column name means that column.

    Raises
    ------
    BadValue
        The text is no expression of columns, finite numbers and the known functions.

    Examples
    --------
    >>> expression("x", "(x_raw - 1472)*2e-5", ["t_s", "x_raw"])
    Linear(column='x_raw', scale=2e-05, offset=-0.02944)
    >>> expression("x", "hypot(x2 - x1, y)*1e-3", []).columns
    ('x2', 'x1', 'y')
    """
    text = text.strip()
    if text in names:
        return Linear(text, 1.0, 0.0)
    try:
        if len(text) > MAX_EXPRESSION or "\\" in text:  # an escape would be a warning of Python's
            raise ValueError
        found = _parsed(ast.parse(text, mode="eval").body)
        if not found.columns:
            raise ValueError
        if isinstance(found, Linear) and not (
            found.scale and isfinite(found.scale) and isfinite(found.offset)
        ):
            raise ValueError
    except (SyntaxError, ValueError, ArithmeticError, RecursionError, MemoryError):
        shown = repr(text) if len(text) <= 80 else f"a text of {len(text)} characters"
        raise BadValue(
            f"{what}: cannot read {shown}: write columns and finite numbers with + - * / ** and"
            f" {', '.join(FUNCTIONS)}, such as force_N*5e-4, (x_raw - 1472)*2e-5 or hypot(vx, vy),"
            " with quotes around a name that is not a word, such as 'Force (N)'*5e-4"
        ) from None
    return found


def names_in(text: str) -> frozenset[str]:
    """Return the columns of an expression; none if it cannot be read."""
    try:
        return frozenset(expression("", text, ()).columns)
    except BadValue:
        return frozenset()


def _parsed(node: ast.expr) -> Expression:
    """Return what a node of the syntax tree stands for, or raise ValueError."""
    match node:
        case ast.Name(id=name) | ast.Constant(value=str(name)):
            return Linear(name, 1.0, 0.0)
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return Linear(None, 0.0, float(number))
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=operand):
            factor = -1.0 if isinstance(sign, ast.USub) else 1.0
            return _binary(ast.Mult(), Linear(None, 0.0, factor), _parsed(operand))
        case ast.BinOp():
            return _binary(node.op, _parsed(node.left), _parsed(node.right))
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in FUNCTIONS:
            function, parts = FUNCTIONS[name], tuple(map(_parsed, args))
            while name in SEVERAL and len(parts) > 2:
                parts = (Combined(function, parts[:2]), *parts[2:])
            if len(parts) == function.nin:
                return Combined(function, parts)
    raise ValueError


def _binary(op: ast.operator, a: Expression, b: Expression) -> Expression:
    if isinstance(a, Linear) and isinstance(b, Linear) and (found := _linear(op, a, b)):
        return found
    constant = not (a.columns or b.columns)
    if type(op) not in OPERATORS or constant or (isinstance(op, ast.Pow) and b.columns):
        raise ValueError
    return Combined(OPERATORS[type(op)], (a, b))


def _linear(op: ast.operator, a: Linear, b: Linear) -> Linear | None:
    """Return the result of an operator if it is linear in one column."""
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
    if isinstance(op, ast.Pow) and a.column is b.column is None:
        return Linear(None, 0.0, pow(a.offset, b.offset))
    return None


def _times(a: Linear, factor: float) -> Linear:
    return Linear(a.column, a.scale * factor, a.offset * factor)
