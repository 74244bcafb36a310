"""The exceptions that stimlib raises, and the check of public arguments.

Each exception is also the built-in one that a caller would expect.  A message is one
line: the name that the caller used, what was given, what is wrong with it, and what to
do, such as ``bumps: duty = 1.5 must be above 0 and at most 1``.  Text from a file or a
caller goes through `shown` or `shortened`, and a missing name through `need`, which
lists what there is.
"""

import functools
import importlib
import inspect
import math
import numbers
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

F = TypeVar("F", bound=Callable)
LONGEST = 4000  # letters of an error: it may quote what others wrote
_CONTROL = re.compile(
    r"[^\n\x20-\x7e\xa0-\U0010ffff]|[\u061c\u200b-\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)


def shown(text: object) -> str:
    r"""Return a text that is safe to show in a terminal or on a page.

    Control characters, and characters that reorder a line, become escape codes.

    Examples
    --------
    >>> from stimlib.errors import shown
    >>> shown("a\x1b[31mb")
    'a\\x1b[31mb'
    """
    return _CONTROL.sub(lambda m: ascii(m.group())[1:-1], str(text))


def counted(n: int, noun: str) -> str:
    """Write a number with its noun, which gets an s unless there is one.

    >>> counted(1, "block"), counted(0, "time"), counted(2, "sample")
    ('1 block', '0 times', '2 samples')
    """
    return f"{n} {noun}{'' if n == 1 else 's'}"


def shortened(value: object, most: int = 80) -> str:
    """Return the repr of a value, cut to 80 characters or to ``most``.

    Examples
    --------
    >>> from stimlib.errors import shortened
    >>> len(shortened("x" * 200)), shortened("short")
    (80, "'short'")
    """
    text = repr(value)
    return text if len(text) <= most else text[: most - 3] + "..."


def said(text: str) -> str:
    """Return an error's message as printable text, shortened if it is long.

    A long message keeps its beginning, and its end, which has the remedy.
    """
    text = shown(text)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 500]} [..] {text[-490:]}"


class StimlibError(Exception):
    """Base class of every error that stimlib raises on purpose.

    The message may quote external files, so it is made safe to print.
    """

    def __str__(self) -> str:
        return said(super().__str__())


class BadValue(StimlibError, ValueError):
    """Error for an argument with an invalid value."""


class UnitError(BadValue):
    """Error for quantities whose units do not match."""


class RecordingError(BadValue):
    """Error for a recording that cannot be used as a motion.

    The message names file, row, column and remedy.
    """


class SceneError(StimlibError, ValueError):
    """Error for an invalid scene graph."""


class SceneFileError(SceneError):
    """Error for a file that cannot be read as a scene."""


class SinkError(StimlibError, OSError):
    """Error in opening, writing or reading a device or a file."""


class MotionError(SinkError):
    """Error of a session in real time whose motion never came, or stayed away."""


class FaultError(StimlibError, RuntimeError):
    """Error of a processor whose output is NaN or infinite."""


class MissingPackage(StimlibError, ImportError):
    """Error for a feature whose package is not installed.

    The message contains the command that installs it.
    """


class UnknownName(StimlibError, KeyError):
    """Error for a missing name, or for a name that does not exist."""

    def __str__(self) -> str:
        # KeyError shows the repr of its argument, which would put quotes around a whole
        # sentence
        return said(Exception.__str__(self))


def need(where: str, names: Iterable[Any], given: Iterable[Any], what: str = "column") -> None:
    """Raise UnknownName, with the available names, unless all names are available."""
    there = list(given)
    for name in names:
        if name not in there:
            raise UnknownName(
                f"{where}: there is no {what} {name!r};"
                f" there are {', '.join(map(str, there)) or 'none'}"
            )


def one_of(what: str, given: Any, known: Collection[Any]) -> None:
    """Raise BadValue, with the valid choices, unless a value is one of them."""
    if given not in known:
        raise BadValue(f"{what} = {given!r}; choose one of {', '.join(map(str, known))}")


def reason(e: BaseException) -> str:
    """Return what an exception says, without the number and file of an OSError.

    A ValueError of a path is caused by a NUL or an unpaired surrogate in the name.
    """
    return getattr(e, "strerror", None) or str(e)


@contextmanager
def said_as(error: type[Exception], what: str, *kinds: type[Exception]) -> Iterator[None]:
    """Raise an error of stimlib for one of other kinds inside the block.

    It says what failed, and the reason.

    Examples
    --------
    >>> from stimlib.errors import BadValue, said_as
    >>> with said_as(BadValue, "jnd", ValueError):
    ...     float("a")
    Traceback (most recent call last):
    ...
    stimlib.errors.BadValue: jnd: could not convert string to float: 'a'
    """
    try:
        yield
    except kinds as e:
        raise error(f"{what}: {reason(e)}") from e


def outside() -> int:
    """Return the ``stacklevel`` at which a warning points to the caller's own code."""
    frame, level = sys._getframe(1), 1
    while frame.f_back and frame.f_code.co_filename.startswith(os.path.dirname(__file__)):
        frame, level = frame.f_back, level + 1
    return level


def line_of(f: object) -> str:
    """Return the file and line of a function, as the prefix of an error message."""
    code = getattr(f, "__code__", None)
    return f"{code.co_filename}:{code.co_firstlineno}: " if code else ""


# Arguments of public functions --------------------------------------------------------
class Numbers:
    """Annotation of values that numpy can convert to an array of real numbers."""


class Range(NamedTuple):
    """Range of a number, stated by the annotation of an argument or a block's field."""

    words: str
    holds: Callable[[Any], bool]


Above0 = Annotated[float, Range("a number above 0", lambda v: 0 < v < math.inf)]
From0 = Annotated[float, Range("a number, 0 or above", lambda v: 0 <= v < math.inf)]
Upto1 = Annotated[float, Range("a number above 0 and at most 1", lambda v: 0 < v <= 1)]
Below1 = Annotated[float, Range("a number above 0 and below 1", lambda v: 0 < v < 1)]
Count = Annotated[int, Range("a whole number above 0", lambda v: v > 0)]
Several = Annotated[int, Range("a whole number from 2 to 1000", lambda v: 2 <= v <= 1000)]
RANGES: dict[Any, Any] = {"Above0": Above0, "From0": From0, "Count": Count}
"""Ranges by the names that annotations give them."""


class Unseen:
    """Stand-in, known by name only, for a class that is not imported."""


def _numbers(v: Any, kinds: str = "biuf") -> bool:
    try:
        return importlib.import_module("numpy").asarray(v).dtype.kind in kinds
    # rows of several lengths, or whatever an object does that is asked for an array
    except Exception:
        return False


KINDS: dict[Any, str] = {
    float: "a number",
    int: "a whole number",
    bool: "True or False",
    str: "a text",
    NoneType: "None",
    os.PathLike: "a path",
    Callable: "a function",
    Numbers: "a list of numbers",
}
CLASSES = {
    "Any": "any value",
    "Block": "a block",
    "Design": "a design, such as Staircase or ConstantStimuli, which takes the task",
    "Finger": "a Finger, such as Finger(1e-4, 1.0, 500.0)",
    "Levels": "a map (levels, width, height), as stimlib.soft.array makes it",
    "Patch": "a Patch, such as Patch.duraact(0.0, 0.0)",
    "Plate": "a Plate, such as Plate.paper()",
    "Question": "a Question, such as choice(..)",
    "Scene": 'a Scene, such as Scene({"force": force})',
    "Stimulus": "a Stimulus, such as Stimulus('spring')",
    "Task": "a task, such as TwoInterval",
    "TextureModel": "a TextureModel, as load_texture(path) reads it",
    "Timing": "a Timing, such as Timing(interval=1.0)",
    "ndarray": "an array of numbers",
}
LISTS = {
    tuple: "a tuple (..)",
    list: "a list [..]",
    Sequence: "a list [..]",
    Collection: "a list [..]",
    Iterable: "a list [..]",
}


PUBLIC: dict[str, str] = {}
"""Functions and classes whose arguments are checked, with their modules."""


def public(f: F) -> F:
    """Check the arguments of a public function or class against their annotations.

    An argument of another kind is refused before the function runs, by the names of the
    function and of the argument.  An error from within begins with the name of the
    function, too, unless it begins with a line of an author's own code.

    Raises
    ------
    BadValue
        When called: an argument is not what its annotation says.

    Examples
    --------
    >>> from stimlib.errors import public
    >>> @public
    ... def doubled(x: float) -> float:
    ...     return 2 * x
    >>> doubled("3")
    Traceback (most recent call last):
    stimlib.errors.BadValue: doubled: x = '3' must be a number
    >>> @public
    ... def root(x: float) -> float:
    ...     if x < 0:
    ...         raise BadValue(f"root: x = {x:g} must be 0 or above")
    ...     return math.sqrt(x)
    >>> @public
    ... def fall(x: float) -> float:
    ...     return 0.45 * root(x)
    >>> fall(-3)
    Traceback (most recent call last):
    stimlib.errors.BadValue: fall: x = -3 must be 0 or above
    >>> @public
    ... def climb(height: float) -> float:
    ...     return -0.45 * root(-height)
    >>> climb(3)
    Traceback (most recent call last):
    stimlib.errors.BadValue: climb: root: x = -3 must be 0 or above
    """
    if isinstance(f, type):
        f.__init__ = _checked(f.__init__, f.__name__)  # type: ignore[misc]
        return f
    return _checked(f, f.__name__)


def computed(f: F) -> F:
    """Refuse arrays that are not finite, and numbers that a computation cannot hold.

    The numbers that numpy would only warn of, as overflow and 0/0, are refused by the
    name of the argument that is furthest from 1.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.errors import computed
    >>> @computed
    ... def power(x, gain):
    ...     return np.mean((gain * np.asarray(x)) ** 2)
    >>> power([1.0, 2.0], 1e300)
    Traceback (most recent call last):
    stimlib.errors.BadValue: power: gain = 1e+300 is too large, too small or ...
    >>> power([1.0, float("nan")], 1.0)
    Traceback (most recent call last):
    stimlib.errors.BadValue: power: x = nan, number 1, must be finite
    """
    signature = inspect.signature(f)

    @functools.wraps(f)
    def call(*given: Any, **named: Any) -> Any:
        np = importlib.import_module("numpy")
        try:
            bound = signature.bind(*given, **named).arguments
        except TypeError:
            return f(*given, **named)  # which says what is wrong with the call
        rows, many = {}, {}
        for where, v in bound.items():
            parts = [*v.values()] if isinstance(v, dict) else [v]
            if parts and all(map(_numbers, parts)):
                # of a masked array too all numbers, which is what functions take
                each = [np.asarray(part).ravel().astype(float, copy=False) for part in parts]
                rows[where] = row = np.concatenate(each) if each[1:] else each[0]
                many[where] = isinstance(v, dict) or np.ndim(v) > 0
                if not np.isfinite(row).all() and (many[where] or np.isnan(row[0])):
                    k = int(np.argmin(np.isfinite(row)))
                    raise BadValue(
                        f"{f.__name__}: {where} = {row[k]:g}, number {k}, must be finite"
                    )
        try:
            with np.errstate(over="raise", divide="raise", invalid="raise"):
                return f(*given, **named)
        except (ArithmeticError, np.linalg.LinAlgError) as e:
            far = {
                where: np.abs(np.log10(np.abs(row[row != 0]))).max(initial=20 * (not row.any()))
                for where, row in rows.items()
            }
            what = "what is given"
            if far:
                what = max(far, key=lambda name: far[name])
                row = rows[what]
                what += (
                    f", with {counted(row.size, 'number')} up to {np.abs(row).max(initial=0):g},"
                    if many[what]
                    else f" = {row[0]:g}"
                )
            raise BadValue(
                f"{f.__name__}: {what} is too large, too small or too few for what is computed"
                f" ({e}); check its unit"
            ) from e

    return call  # type: ignore[return-value]


def _checked(f: Any, name: str) -> Any:
    PUBLIC[name] = str(f.__module__)
    signature = inspect.signature(f)
    hints = functools.cache(
        lambda: {
            p.name: _hint(p, inspect.unwrap(f).__globals__) for p in signature.parameters.values()
        }
    )

    @functools.wraps(f)
    def call(*given: Any, **named: Any) -> Any:
        try:
            bound = signature.bind(*given, **named).arguments
        except TypeError as e:
            unknown = [word for word in named if word not in signature.parameters]
            if unknown and "params" in signature.parameters:
                raise TypeError(
                    f"{name}: {e}; a parameter of the scene is given by params={{{unknown[0]!r}:"
                    " ..}"
                ) from None
            return f(*given, **named)  # which says what is wrong with the call
        try:
            wrong = [_wrong(name, where, v, *hints()[where]) for where, v in bound.items()]
            y = f(*given, **named)
            for live in filter(None, wrong):
                raise live
            return y
        except (RecordingError, SceneFileError):  # which name the file; SinkError the device
            raise
        except (BadValue, SceneError, UnknownName) as e:
            _name(e, name, signature.parameters)
            raise

    return call


def _wrong(name: str, where: str, value: Any, hint: Any, endless: bool) -> BadValue | None:
    """Raise BadValue unless an argument has the type that its annotation asks for.

    For a block given in place of a design number, the error is returned instead,
    because the block that receives it gives a better message.
    """
    if isinstance(value, numbers.Real):
        try:
            what = "" if math.isfinite(value) or endless else "is not finite"
        except OverflowError:
            what = "is beyond what a float can hold"
        if what:
            raise BadValue(f"{name}: {where} = {shortened(value)} {what}; give a finite number")
    wrong = None
    if not _fits(value, hint):
        wrong = BadValue(f"{name}: {where} = {shortened(value)} must be {_words(hint)}")
        if not (_is(value, "Block") and _fits(1, hint) and "blocks" in PUBLIC[name]):
            raise wrong
    return wrong


def _name(e: Exception, name: str, parameters: Mapping[str, Any]) -> None:
    """Prefix an error with the name of the function that the caller used."""
    first, _, rest = str(e.args[0]).partition(": ")
    makers = first.split(" or ")  # of a block that several functions make
    passed_on = first in PUBLIC and re.split("[ :[]", rest)[0] in parameters
    if passed_on or (makers[1:] and name in makers):
        e.args = (f"{name}: {rest}", *e.args[1:])
    elif not (
        first.lower().startswith(name.lower())
        or ("scene" in parameters and "blocks" in PUBLIC.get(makers[0], ""))
        or ".py:" in str(e.args[0])  # it begins with the place of an author's code
    ):
        # which call each other
        said = rest if ".run." in PUBLIC.get(first, "") else e.args[0]
        # of a block in a scene the function that made it is named
        e.args = (f"{name}: {said}", *e.args[1:])


def _hint(p: inspect.Parameter, names: dict[str, Any]) -> tuple[Any, bool]:
    """Return the type that an annotation asks for, and if inf and nan are allowed."""
    hint: Any = p.annotation
    # of a motion sources_of says more
    known: dict[str, Any] = {"ArrayLike": Numbers, "Motion": Any}
    while isinstance(hint, str):
        try:
            hint = eval(p.annotation, names, known)
        except NameError as e:  # what only a type checker imports
            known[str(e.name)] = type(str(e.name), (Unseen,), {})
    hint = Any if hint is p.empty else NoneType if hint is None else hint
    if p.kind is p.VAR_POSITIONAL:
        hint = tuple[hint, ...]
    elif p.kind is p.VAR_KEYWORD:
        hint = Mapping[str, hint]
    return hint, hint is Any or (
        isinstance(p.default, float) and not abs(p.default) <= sys.float_info.max
    )


def _is(v: Any, name: str) -> bool:
    return any(c.__name__ == name for c in type(v).__mro__)


def _fits(v: Any, hint: Any) -> bool:
    """Return whether a value, and its elements where possible, has a given type."""
    of, parts = get_origin(hint) or hint, get_args(hint)
    if hint is Any:
        return True
    if of in (Union, UnionType):
        return any(_fits(v, part) for part in parts)
    if _is(v, "Block"):
        return getattr(of, "__name__", "") == "Block"
    rule = RULES.get(of) or RULES.get(getattr(of, "__name__", "")) or _is_of
    return rule(v, of, parts)


def _is_table(v: Any, of: Any, parts: tuple) -> bool:
    # of a number that is none others say more
    each = v.values() if isinstance(v, dict) and parts[1] not in KINDS else ()
    return hasattr(v, "keys") and all(_fits(w, parts[1]) for w in each)


def _is_list(v: Any, of: Any, parts: tuple) -> bool:
    """Return whether a value is a list or can be used as one."""
    any_order = of in (Collection, Iterable)
    wanted = "__iter__" if of is Iterable else "__len__"
    keyed = isinstance(v, Mapping) and not any_order
    if keyed or isinstance(v, str | bytes) or not hasattr(v, wanted):
        return False
    if not hasattr(v, "__getitem__"):
        return any_order and (not hasattr(v, "__len__") or all(_fits(w, parts[0]) for w in v))
    if of is tuple and parts and parts[-1] is not ...:
        return len(v) == len(parts) and all(map(_fits, v, parts))
    return getattr(v, "ndim", 1) > 0 and (not parts or all(_fits(w, parts[0]) for w in v))


def _is_of(v: Any, of: Any, parts: tuple) -> bool:
    """Return whether a value is an instance of a class, or a matching NamedTuple."""
    if not isinstance(of, type) or (
        getattr(of, "_is_protocol", False) and not getattr(of, "_is_runtime_protocol", False)
    ):
        return True
    if issubclass(of, tuple) and isinstance(v, tuple):
        return len(v) == len(of._fields)  # type: ignore[attr-defined]
    return isinstance(v, of) or (issubclass(of, Unseen) and _is(v, of.__name__))


def _is_number(v: Any, of: Any, parts: tuple) -> bool:
    kind = numbers.Integral if of is int else numbers.Real
    return isinstance(v, kind) and not isinstance(v, bool)


def _is_signal(v: Any, of: Any, parts: tuple) -> bool:
    """Return whether a value other than a block is a number, numpy scalars included."""
    return _is_number(v, float, ()) or (getattr(v, "ndim", 1) == 0 and _numbers(v))


RULES: dict[Any, Callable[[Any, Any, tuple], bool]] = {
    Numbers: lambda v, of, parts: _numbers(v),
    Literal: lambda v, of, parts: isinstance(v, str) and v in parts,
    Annotated: lambda v, of, parts: _fits(v, parts[0]) and parts[1].holds(v),
    "Block": _is_signal,
    "ndarray": lambda v, of, parts: _numbers(v, "biufc") and hasattr(v, "__len__"),
}
"""For each type or its name, the test of a value; `_is_of` for all others."""
RULES[bool] = lambda v, of, parts: type(v).__name__ in ("bool", "bool_")
RULES |= dict.fromkeys((float, int), _is_number)
RULES |= dict.fromkeys((dict, Mapping), _is_table) | dict.fromkeys(LISTS, _is_list)


def _words(hint: Any) -> str:
    """Return a type in words, for an error message."""
    of, parts = get_origin(hint) or hint, get_args(hint)
    if of in KINDS:
        return KINDS[of]
    if of in (Union, UnionType):
        return " or ".join(dict.fromkeys(map(_words, parts)))
    if of is Annotated:
        return parts[1].words
    if of is Literal:
        return f"one of {', '.join(parts)}"
    if of in (dict, Mapping):
        return f"a dict {{name: {_words(parts[1])}}}"
    if of in LISTS:
        several = ", ".join("..." if p is ... else _words(p) for p in parts)
        return LISTS[of].replace("..", several)
    name = getattr(of, "__name__", str(of))
    return CLASSES.get(name, f"a {name}")
