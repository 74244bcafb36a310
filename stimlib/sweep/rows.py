"""The rows of a sweep: a grid or table as Arrow columns, with the role of each."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Collection, Iterable, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core.scene import Scene
from ..core.units import unit
from ..errors import BadValue, UnitError, UnknownName, need, public, shortened
from ..motion.layout import decimal_sign, layout_of, text_of
from ..system.limits import limits
from ..system.packages import package

Table = Any
"""A table of pyarrow, which is imported when a sweep begins, and has no types."""
OWN = ("seed", "motion")  # columns with a meaning of their own
MADE = ("content", "error", "fault", "key")  # columns that a sweep adds


def arrow(module: str = "pyarrow") -> Any:
    """Import Apache Arrow, which stores the tables of sweeps."""
    return package(module, "a sweep")


@public
def grid(**axes: Iterable[Any]) -> dict[str, np.ndarray]:
    """Return every combination of the values of some columns.

    The last column changes fastest.

    Parameters
    ----------
    **axes : iterable
        The values of each column: numbers, texts or truth values, all of one kind.  For
        a mapping, its keys, so that named motions can be an axis.

    Returns
    -------
    dict of str to ndarray
        Columns of equal length.

    Raises
    ------
    BadValue
        There is no axis, or an axis has no values or values that are not a list.

    Examples
    --------
    >>> from stimlib.sweep import grid
    >>> {
    ...     name: column.tolist()
    ...     for name, column in grid(k=[500.0, 1000.0], seed=range(2)).items()
    ... }
    {'k': [500.0, 500.0, 1000.0, 1000.0], 'seed': [0, 1, 0, 1]}
    """
    values = {name: _axis(name, axis) for name, axis in axes.items()}
    if not values:
        raise BadValue("grid: name an axis, such as grid(k=[500.0, 1000.0], seed=range(10))")
    limits.check(
        "render_bytes",
        8 * len(values) * math.prod(v.size for v in values.values()),
        "grid: bytes of its columns",
    )
    inner = 1
    for name, column in reversed(values.items()):
        values[name] = np.repeat(column, inner)
        inner *= column.size
    return {name: np.tile(column, inner // column.size) for name, column in values.items()}


def _axis(name: str, axis: Any) -> np.ndarray:
    """Return the values of an axis of a grid as an array of one kind."""
    if isinstance(axis, str | bytes) or not isinstance(axis, Iterable):
        raise BadValue(
            f"grid: {name} = {shortened(axis)} must be a list of values, such as [{axis!r}]"
        )
    listed = axis if isinstance(axis, np.ndarray) else list(axis)
    kinds = set(map(_kind, listed))
    listed = whole_numbers(name, listed)
    try:
        values = np.asarray(listed)
    except ValueError as e:
        raise BadValue(f"grid: {name} = {shortened(axis)} must be one row of values") from e
    if values.ndim != 1 or not values.size or values.dtype.kind not in "biufU" or len(kinds) > 1:
        raise BadValue(
            f"grid: {name} = {shortened(axis)} must have values, all numbers, all texts or all"
            " truth values"
        )
    return values


def _kind(v: Any) -> type:
    """Return the type of a value, which is float for all numbers."""
    number = isinstance(v, int | float | np.number) and not isinstance(v, bool)
    return float if number else type(v)


def whole_numbers(name: str, column: Any) -> Any:
    """Return a column, as uint64 if its integers need the 64th bit.

    Seeds may need it. BadValue is raised if 64 bits are not enough.
    """
    whole = [int(v) for v in column if isinstance(v, int | np.integer) and not isinstance(v, bool)]
    least, most = min(whole, default=0), max(whole, default=0)
    if -(2**63) <= least and most < 2**63:
        return column
    if len(whole) < len(column) or least < 0 or most >= 2**64:
        beyond = least if least < -(2**63) else most
        at = [*column].index(beyond)
        raise BadValue(
            f"rows: {name} = {shortened(beyond)} in row {at} has no place in 64 bits beside the"
            " others; give floats"
        )
    return np.asarray(column, np.uint64)


def table_of(rows: Any) -> Table:
    """Return rows as an Arrow table without missing values.

    The column types are int64, uint64, float64, bool and string.

    Parameters
    ----------
    rows : mapping of str to sequence, table, or path
        Columns by name; a table of pandas, polars, Arrow or others that support Arrow's
        C stream; or a Parquet or CSV file, whose encoding, separator and decimal sign
        are found.

    Raises
    ------
    BadValue
        No rows; columns of unequal length; a missing value; or values other than
        numbers, texts or truth values.
    MissingPackage
        pyarrow is not installed.

    Examples
    --------
    >>> from stimlib.sweep.rows import table_of
    >>> table_of({"k": [500, 1000]}).schema.field("k").type
    DataType(int64)
    """
    pa = arrow()
    try:
        table = _read(pa, rows)
    except (pa.ArrowException, OSError, TypeError, ValueError) as e:
        if isinstance(e, BadValue):
            raise
        raise BadValue(f"rows cannot be read as a table: {e}") from None
    if not table.num_rows or not table.num_columns:
        raise BadValue("a sweep needs rows, and there is none")
    if twice := {n for n in table.column_names if table.column_names.count(n) > 1}:
        raise BadValue(f"rows: the column {min(twice)} is there twice")
    columns = [_plain(pa, *pair) for pair in zip(table.schema, table.columns, strict=True)]
    fields = []
    for field, column in zip(table.schema, columns, strict=True):
        unit_ = (field.metadata or {}).get(b"unit")
        kept = None if unit_ is None else {"unit": unit_}
        fields.append(pa.field(field.name, column.type, field.nullable, kept))
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def _read(pa: Any, rows: Any) -> Table:
    if isinstance(rows, pa.Table):
        return rows
    if isinstance(rows, str | os.PathLike):
        path = Path(rows)
        if path.suffix.lower() == ".parquet":
            return arrow("pyarrow.parquet").read_table(path)
        if path.suffix.lower() == ".csv":
            return _read_csv(path)
        raise BadValue(f"rows: {rows} is neither a .csv nor a .parquet file")
    if isinstance(rows, Mapping):
        return pa.table(_columns(rows))
    if hasattr(rows, "iloc"):
        return pa.Table.from_pandas(rows, preserve_index=False)
    if hasattr(rows, "__arrow_c_stream__"):
        return pa.table(rows)
    raise BadValue(
        f"rows must be columns by name, a table, or the path of one; got {type(rows).__name__}"
    )


def _read_csv(path: Path) -> Table:
    """Read a CSV file, whose encoding, separator and decimal sign are found."""
    data, _ = text_of(str(path), path.read_bytes())
    found = layout_of(str(path), data, lambda names: sum(map(str.isidentifier, names)))
    mark = found.separator.replace(" ", ",")
    csv = arrow("pyarrow.csv")
    return csv.read_csv(
        BytesIO(data),
        parse_options=csv.ParseOptions(delimiter=mark),
        # where nothing shows it, 1.234 is a text, and is refused
        convert_options=csv.ConvertOptions(decimal_point=decimal_sign(data, 0, mark) or ","),
    )


def _columns(rows: Mapping[str, Any]) -> dict[str, Any]:
    """Return columns that were given by name, after checking their lengths."""
    for name, column in rows.items():
        if isinstance(column, str) or not hasattr(column, "__len__"):
            raise BadValue(
                f"rows: {name} = {shortened(column)} must be a list of values, one for each row"
            )
    if len(set(map(len, rows.values()))) > 1:
        lengths = ", ".join(f"{name} {len(column)}" for name, column in rows.items())
        raise BadValue(f"rows: the columns have unequal lengths: {lengths}")
    return {
        name: column if hasattr(column, "dtype") else whole_numbers(name, list(column))
        for name, column in rows.items()
    }


PLAIN = {
    "boolean": "bool_",
    "uint64": "uint64",
    "integer": "int64",
    "floating": "float64",
    "decimal": "float64",
    "string": "string",
    "large_string": "string",
    "string_view": "string",
}
"""The type of a column, by the kind of type that Arrow's ``is_..`` recognises first."""


def _plain(pa: Any, field: Any, column: Any) -> Any:
    """Return a column as a single array of one of the allowed types."""
    kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
    fitting = [plain for like, plain in PLAIN.items() if getattr(pa.types, f"is_{like}")(kind)]
    if column.null_count:
        at = column.is_null().index(True).as_py()
        raise BadValue(
            f"rows: {field.name} has no value in row {at} (the first is 0); leave such rows out, or"
            " fill them"
        )
    if not fitting:
        raise BadValue(
            f"rows: {field.name} has values of type {field.type}; give numbers, texts or truth"
            " values"
        )
    column = column.cast(getattr(pa, fitting[0])()).combine_chunks()
    return column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column


class Roles(NamedTuple):
    """The roles of all columns other than ``seed`` and ``motion``."""

    live: tuple[str, ...]
    """Parameters, set before the first sample as ``render(params=..)`` does: the
    program stays the same.
    """
    arguments: tuple[str, ...]
    """Arguments of the factory: each combination gives a separate scene."""


def roles_of(
    make: Scene | Callable[..., Scene],
    scene: Scene,
    names: Collection[str],
    live: Collection[str] | None,
) -> Roles:
    """Return the role of each column.

    A parameter that affects what runs before sample 0, such as the level of a filtered
    noise, gives different samples as a live parameter than as an argument, because the
    lead-in ran with the other value.  If a name is both, the role is therefore not
    guessed.

    Parameters
    ----------
    make : Scene or callable
        The scene or factory, as given.
    scene : Scene
        The same scene, or the factory's result for some row.
    names : collection of str
        Names of the columns.
    live : collection of str, optional
        Columns that are parameters; required if a name is both a parameter and an
        argument of the factory.

    Raises
    ------
    UnknownName
        A column, or a name in ``live``, has no meaning.
    BadValue
        A name is both a parameter and an argument, and ``live`` does not say which is
        meant.
    """
    columns, params, known = [n for n in names if n not in OWN], scene.params, arguments_of(make)
    for n in columns:
        if n in MADE:
            raise BadValue(f"rows: a sweep adds a column {n} of its own: give yours another name")
    if live is None:
        both = [n for n in columns if n in params and n in known]
        if both:
            raise BadValue(
                f"rows: {', '.join(both)}: both a live parameter and an argument of"
                f" {name_of(make)}: say live=[{', '.join(map(repr, both))}] to set parameters of"
                " one compiled scene (quick), or live=[] to make a scene of each value"
            )
        live = params
    else:
        need("live", live, params, "parameter of the scene")
        need("live", live, columns, "column of the rows")
    rest = [n for n in columns if n not in live]
    unknown = [n for n in rest if n not in known]
    if unknown:
        there = f"parameters: {', '.join(params) or 'none'}"
        if not isinstance(make, Scene):
            there += f"; arguments: {', '.join(known) or 'none'}"
        raise UnknownName(
            f"there is no column {', '.join(unknown)} in the scene; {there}; also: seed, motion"
        )
    return Roles(tuple(n for n in columns if n in live), tuple(rest))


def name_of(make: Any) -> str:
    """Return the name of a factory."""
    return getattr(make, "__name__", "the function")


def arguments_of(make: Scene | Callable[..., Scene]) -> list[str]:
    """Return the arguments that a factory takes by name; a scene has none."""
    if isinstance(make, Scene):
        return []
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [n for n, p in inspect.signature(make).parameters.items() if p.kind in kinds]


def checked(table: Table, scene: Scene, roles: Roles, motions: Collection[str]) -> Table:
    """Return the table with checked columns.

    Live columns become finite float64 and seeds uint64; the column ``motion`` must have
    known names.

    Raises
    ------
    BadValue
        Invalid values, with column and row; or an unknown motion.
    UnitError
        The unit of a column differs from that of its parameter.
    """
    pa = arrow()
    for at, field in enumerate(table.schema):
        name, column = field.name, table[field.name]
        if name in roles.live:
            dim = scene.params[name].dim
            kept = pa.field(name, pa.float64(), metadata={"unit": str(dim)})
            table = table.set_column(at, kept, [_live(field, column, dim)])
        elif name == "seed":
            kept = pa.field(name, pa.uint64(), metadata={"unit": "1"})
            table = table.set_column(at, kept, [_seeds(column)])
        elif name == "motion":
            if unknown := sorted(set(column.unique().to_pylist()) - set(motions), key=str):
                raise UnknownName(
                    f"rows: there is no motion {unknown[0]!r}; give motion= as a dict of them by"
                    f" name; it has {_some(motions)}"
                )
    return table


def _live(field: Any, column: Any, dim: Any) -> np.ndarray:
    """Return the values of a live column, after checking them."""
    pa, name = arrow(), field.name
    said = (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
    if said and unit(said) != dim:
        raise UnitError(f"rows: {name} is in {said}, and the parameter in {dim}")
    if pa.types.is_string(field.type) or pa.types.is_boolean(field.type):
        raise BadValue(
            f"rows: {name} is a parameter, so it needs numbers; got {field.type}:"
            f" {column[0].as_py()!r}"
        )
    values = column.to_numpy().astype(np.float64)
    finite = np.isfinite(values)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise BadValue(f"rows: {name} = {values[bad]} in row {bad} (the first is 0) must be finite")
    return values


def _seeds(column: Any) -> np.ndarray:
    values = column.to_numpy()
    if values.dtype.kind not in "iu" or (values < 0).any():
        bad = int(np.argmin(values >= 0)) if values.dtype.kind in "iuf" else 0
        raise BadValue(
            f"rows: seed = {values[bad]} in row {bad} (the first is 0) must be a whole number from"
            " 0 to 2**64 - 1"
        )
    return values.astype(np.uint64)


def _some(names: Collection[str]) -> str:
    shown = list(filter(None, names))[:12]
    if len(names) > 12 and shown:
        shown.append("..")
    return ", ".join(shown) or "none by name"
