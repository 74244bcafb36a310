"""Blocks and the arithmetic that joins them: a stimulus is a graph of blocks.

A block is a frozen dataclass.  Fields annotated ``Block`` are its input signals
(numbers are accepted and become constants); all others are design numbers, which shape
it once per sample rate in ``design(fs)``.
"""

from __future__ import annotations

import dataclasses as dc
import inspect
import math
import operator
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache, partial
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..errors import RANGES, BadValue, Range, SceneError, StimlibError, UnitError, line_of, public
from . import units as un
from .maths import where
from .operators import FUNCTIONS, NUMBERS, Refusals, no_numpy, power
from .source import source_of
from .units import Unit, unit

F = TypeVar("F", bound=Callable)
NONE, ONE = np.uint64(0), np.uint64(1)  # of counters in a state


def memo(f: F) -> F:
    """Return ``functools.cache`` that keeps the signature for type checkers.

    It takes classes as arguments as well.
    """
    return cache(f)  # type: ignore[return-value]


registry: dict[str, type[Block]] = {}
"""Every final block class by the name scene files use."""
files: set[str] = set()
"""Files of a user that the command line runs: errors of a design name their lines."""


class Block(Refusals):
    """Base class of all blocks; a class is final unless it has ``abstract=True``.

    A final class, or an abstract one above it (a *primitive*), defines the output by
    either

    * ``step(p, s, *x) -> (y, s)``: one sample, in straight-line Python (see
      ``stimlib.core.steps``), or
    * ``tile(p, s, *x, y, w) -> s``: fills the array y from the arrays x, up to 64
      samples, with the same bits however a signal is cut into tiles; ``w`` is a scratch
      array of ``work(p)`` words.

    p and s are NamedTuples of floats, uint64 and 1-D arrays of them, made by
    ``design(fs) -> (p, s)``.

    A class with several outputs names them in ``outputs``: its step returns a tuple of
    samples, its tile fills an array for each, and its units are a tuple.
    ``block.name`` is the signal; the block runs only once, however many blocks use its
    signals.

    A ``resettable`` class runs while its last signal, ``contact``, is above 0;
    otherwise its output is 0 and its state that of ``design``.  Step and tile do not
    get this signal.  Its state ends with ``cold``: above 0 before the first sample, 1
    after contact, and 0 after each step or tile, whatever these return for it.
    """

    abstract: ClassVar[bool] = True
    source: ClassVar[str] = ""  # of a class that is not stimlib's: the text of its file
    resettable: ClassVar[bool] = False
    outputs: ClassVar[tuple[str, ...]] = ()  # names, where there are several
    begins_early: ClassVar[Any] = True  # before sample 0, where its signals do
    rests: ClassVar[bool] = False  # it is exactly 0 for stretches at a time
    # a signal that is a frequency below fs/2: the function and the name, "ring: freq"
    rated: ClassVar[Any] = ""
    # instead of a design number
    live: ClassVar[str] = "live values are multiplied, added, or connected to a block's input"
    step: ClassVar[Callable[..., Any] | None] = None
    tile: ClassVar[Callable[..., Any] | None] = None
    work: ClassVar[Callable[..., int] | None] = None
    # abreast(p), of a tile of ``series`` and ``each``: so many blocks, at least, are
    # faster with one in each lane of a vector
    abreast: ClassVar[Callable[..., int] | None] = None
    # law(fs, rows, seen) -> row, or row and tolerance: for ``verify``
    law: ClassVar[Callable[..., Any] | None] = None
    # transfer(p, z) -> H of an LTI block of one signal and output, |z| = 1
    transfer: ClassVar[Callable[..., Any] | None] = None

    def __init_subclass__(cls, abstract: bool = False, in_files: bool = True, **kw):
        super().__init_subclass__(**kw)
        for base in cls.__mro__[1:]:
            if issubclass(base, Block) and not base.abstract:
                raise TypeError(
                    f"{cls.__name__}: {base.__name__} is final; derive from"
                    f" {base.__mro__[1].__name__} instead"
                )
        for name in cls.__dict__.get("outputs", ()):
            if hasattr(cls, name) or name in inspect.get_annotations(cls):
                raise TypeError(
                    f"{cls.__name__}: the output name {name!r} is already an attribute of blocks;"
                    " choose another"
                )
            setattr(cls, name, property(partial(Pick, output=name)))
        cls.abstract = abstract
        # or dataclass writes one that recurses
        cls.__repr__ = Block.__repr__  # type: ignore[method-assign]
        if "." in type_name(cls):
            cls.source = source_of(cls)  # now: the file may change while its classes live on
        if in_files and not abstract:
            registry[type_name(cls)] = cls

    def __init__(self, *given: Any, **named: Any):
        raise undecorated(type(self))  # @dataclass writes another

    def __post_init__(self):
        cls = type(self)
        if cls.abstract:
            raise TypeError(
                f"{cls.__name__} is abstract and cannot be used directly; use a class derived from"
                " it"
            )
        params = cls.__dict__.get("__dataclass_params__")
        if params is None or not params.frozen or params.eq:
            raise undecorated(cls)
        for f in dc.fields(self):  # type: ignore[arg-type]
            value = getattr(self, f.name)
            if f.name not in signals(cls):
                value = design_value(f"{head(cls)}{f.name}", f.type, value, cls.live)
            elif cls is not Pick:
                value = as_block(value)
            object.__setattr__(self, f.name, value)
        self.check()
        kids = self.children
        object.__setattr__(
            self, "autonomous", self.begins_early and all(c.autonomous for c in kids)
        )
        dim = self.units(*(c.dim for c in kids))
        dims = dim if isinstance(dim, tuple) and self.outputs else (dim,)
        if not all(isinstance(d, Unit) for d in dims) or len(dims) != max(1, len(self.outputs)):
            several = (
                f", one for each of {', '.join(self.outputs)} in a tuple" if self.outputs else ""
            )
            raise SceneError(
                f"{line_of(cls.units)}{cls.__name__}.units: it returned {dim!r}; return that of a"
                " signal (u[0]), or one made by stimlib.core.units.unit, such as"
                f" unit('N'){several}"
            )
        object.__setattr__(self, "dim", dim)
        if files:
            frame: Any = sys._getframe()
            while frame and frame.f_code.co_filename not in files:
                frame = frame.f_back
            if frame:
                line = f"{frame.f_code.co_filename}:{frame.f_lineno}: "
                object.__setattr__(self, "made_at", line)

    @property
    def definition(self) -> Any:
        """The class that defines the step or the tile; a program may compose one."""
        return type(self)

    sign: ClassVar[str] = ""  # how pictures write it, where its name is longer

    autonomous: ClassVar[bool]  # no Input reaches it, and no loop: it runs before sample 0
    dim: ClassVar[Unit]  # unit of the output
    made_at: ClassVar[str] = ""  # the line of a file in ``files`` that made it

    # What a class may define ----------------------------------------------------------
    def check(self) -> None:
        """Raise BadValue if a design number makes no sense."""

    def units(self, *u: Unit) -> Unit:
        """Return the unit of the output, by default that of the first signal."""
        return u[0] if u else un.ONE

    def design(self, fs: float) -> tuple[Any, Any]:
        """Return the parameters p and first state s at sample rate fs (Hz)."""
        return (), ()

    def start(self, p: Any, s: Any, seed: int) -> Any:
        """Return the first state for a run with this seed, such as noise keys."""
        return s

    def delay(self, p: Any) -> float:
        """Return the latency of the block in samples."""
        return 0.0

    def fixed(self, *values: float) -> Block | None:
        """Return an equal block with a ``transfer``, for given constant signals.

        The signals after the first have these values. Return None if there is no such
        block.
        """
        return None

    def laws(self, fs: float) -> tuple[Any, ...]:
        """Return the reference laws of the block's frequency response.

        ``verify`` compares the response with them; see ``stimlib.design.responses``.
        """
        return ()

    def through(
        self, p: Any, fs: float, z: np.ndarray, H: Sequence[Any], value: Sequence[float | None]
    ) -> np.ndarray | None:
        """Return the frequency response after this block, or None if it has none.

        Its input signals have the responses H or are constant with a value (None where
        neither is known).

        For several outputs the result is a tuple.
        """
        given = [v for v in value[1:] if v is not None]
        if H[0] is None or len(given) < len(value) - 1:
            return None  # only the first signal may vary
        fixed = self.fixed(*given)
        b = self if fixed is None else fixed
        transfer = type(b).transfer
        return None if transfer is None else transfer(p if b is self else b.design(fs)[0], z) * H[0]

    def steepest(
        self, fs: float, z: np.ndarray, H: Sequence[Any], value: Sequence[float | None]
    ) -> np.ndarray | None:
        """Return the response of the stiffest linear block that bounds this one.

        It has the form of ``through``; None if it is not known.
        """
        return None

    def memory(self, p: Any) -> int:
        """Return the number of samples after which a block has forgotten its start.

        It is 0 for blocks without finite memory.
        """
        return 0

    def resting(self, contact: Block) -> Block | None:
        """Return this block with 0 in its place where a last signal is not above 0.

        Its state must go on as if it ran.  Return None if it cannot rest.
        """
        return None

    @property
    def noise_key(self) -> tuple[int, int] | None:
        """The (seed, stream) of a noise source; no two in a scene may be equal."""
        return None

    # ----------------------------------------------------------------------------------
    @property
    def frequency(self) -> Block | None:
        """The signal that must be in 0 .. fs/2; None if there is none."""
        return getattr(self, self.rated.rpartition(" ")[2]) if self.rated else None

    def check_rate(self, f: float, fs: float, where_: str = "") -> None:
        """Raise BadValue unless a frequency is 0 or above, and below fs/2."""
        maker, _, name = self.rated.partition(": ")
        below_half(f"{where_}{maker}", fs, **{name: f})

    @property
    def children(self) -> tuple[Block, ...]:
        """The input signals."""
        return tuple(getattr(self, name) for name in signals(type(self)))

    def __repr__(self):
        parts = []
        for f in dc.fields(self):  # type: ignore[arg-type]
            v = getattr(self, f.name)
            if isinstance(v, Block):
                name = repr(v.name) if isinstance(v, Named) else ".."
                parts.append(repr(v) if isinstance(v, Const) else f"{type(v).__name__}({name})")
            elif isinstance(v, np.ndarray):
                short = v.size <= 4
                parts.append(f"{f.name}={v.tolist() if short else f'<{v.size} numbers>'}")
            elif v is not None and v != "":
                parts.append(f"{f.name}={v!r}" if self.children else repr(v))
        return f"{type(self).__name__}({', '.join(parts)})"

    # Arithmetic makes more blocks; what none of them can do is in Refusals ------------
    # fmt: off
    def __add__(self, o): return Add(self, o)
    def __radd__(self, o): return Add(o, self)
    def __sub__(self, o): return Sub(self, o)
    def __rsub__(self, o): return Sub(o, self)
    def __mul__(self, o): return Mul(self, o)
    def __rmul__(self, o): return Mul(o, self)
    def __truediv__(self, o): return Div(self, o)
    def __rtruediv__(self, o): return Div(o, self)
    def __neg__(self): return Neg(self)
    def __pos__(self): return self
    def __abs__(self): return Abs(self)
    def __gt__(self, o): return Greater(self, o)
    def __lt__(self, o): return Greater(o, self)
    def __ge__(self, o): return AtLeast(self, o)
    def __le__(self, o): return AtLeast(o, self)
    def __eq__(self, o: Any) -> Any: return Equal(self, o)
    def __ne__(self, o: Any) -> Any: return NotEqual(self, o)
    # fmt: on

    __hash__ = object.__hash__  # keys of tables are the blocks themselves, whatever == means

    def __pow__(self, n: Any) -> Block:
        return Const(1.0) if isinstance(n, NUMBERS) and n == 0 else power(self, n)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        f = FUNCTIONS.get(ufunc.__name__)  # numpy asks here before it computes anything
        if method != "__call__" or options or f is None:
            return no_numpy(ufunc.__name__)
        blocks: list[Any] = [as_block(v) for v in inputs]
        if f is operator.pow and isinstance(blocks[1], Const):
            blocks[1] = blocks[1].value
        return f(*blocks)


@memo
def signals(cls: type[Block]) -> tuple[str, ...]:
    """Return the names of the fields that are input signals."""
    named = {Block, "Block", "stimlib.Block", "graph.Block", "stimlib.core.graph.Block"}
    return tuple(f.name for f in dc.fields(cls) if f.type in named)  # type: ignore[arg-type]


@memo
def type_name(cls: type[Block]) -> str:
    """Return a class's name in scene files; with its module if outside stimlib."""
    if cls.__module__.split(".")[0] == "stimlib":
        return cls.__name__
    return f"{cls.__module__}.{cls.__qualname__}"


def head(cls: type[Block]) -> str:
    """Return the prefix of a class's error messages: its name, or an empty text.

    Other blocks are named by the public functions that make them.
    """
    return f"{cls.__name__}." if issubclass(cls, Named) or "." in type_name(cls) else ""


def undecorated(cls: type) -> SceneError:
    """Return the error for a block class without the required decorator."""
    return SceneError(
        f"{cls.__name__}: decorate it with @dataclass(frozen=True, eq=False), and write no __init__"
    )


def as_block(v: Any) -> Block:
    """Return a block unchanged, and a number as a constant without unit."""
    if isinstance(v, Block):
        if not hasattr(v, "dim"):
            raise undecorated(type(v))
        if v.outputs:
            raise SceneError(
                f"{v!r} has the outputs {', '.join(v.outputs)}: choose one, such as .{v.outputs[0]}"
            )
        return v
    if isinstance(v, np.ndarray) and v.ndim == 0:
        v = v[()]
    if isinstance(v, NUMBERS):
        return Const(_float(v, "a number"))
    hint = " (write a quantity as constant(250.0, 'Hz'))" if isinstance(v, str) else ""
    raise BadValue(f"expected a block or a number, got {type(v).__name__} {v!r:.200}{hint}")


def _float(v: Any, what: str) -> float:
    try:
        return float(v)
    except OverflowError:
        raise BadValue(
            f"{what} is beyond what a float can hold, {sys.float_info.max:.3g}"
        ) from None


_KINDS = {
    "float": ((int, float), "a number"),
    "int": ((int,), "a whole number"),
    "bool": ((bool,), "True or False"),
    "str": ((str,), "a text"),
    "None": ((type(None),), "None"),
    "np.ndarray": ((np.ndarray,), "a list of numbers"),
}


def design_value(where_: str, annotation: Any, v: Any, live: str = Block.live) -> Any:
    """Convert a design number to the type of its annotation.

    The types are finite floats, whole numbers, text, and read-only float64 arrays.
    """
    if isinstance(v, Block):
        remedy = f"write the number {v.value:g}" if isinstance(v, Const) else live
        raise BadValue(
            f"{where_} is a design number (it shapes the block once per sample rate) and cannot be"
            f" the signal {v!r}; {remedy}"
        )
    if isinstance(v, (list, tuple, np.ndarray)):
        v = _design_array(where_, v)
    elif isinstance(v, np.generic):
        v = v.item()
    if isinstance(v, str) and len(v) > 200:
        raise BadValue(f"{where_} = {v[:40]!r}.. has {len(v)} letters; at most 200 are possible")
    if isinstance(v, float) and not math.isfinite(v):
        raise BadValue(f"{where_} = {v} is not finite")
    words, kinds, ranges = _kinds(annotation)
    # True is an int of Python
    if not isinstance(v, kinds) or (isinstance(v, bool) and not {bool, object} & {*kinds}):
        raise BadValue(f"{where_} = {v!r:.200} must be {' or '.join(_KINDS[w][1] for w in words)}")
    if isinstance(v, int) and not isinstance(v, bool):
        if float in kinds:
            v = _float(v, where_)
        elif abs(v) >= 2**64:
            raise BadValue(f"{where_} must be below 2**64")
    for range_ in ranges if v is not None else ():
        if not range_.holds(v):
            raise BadValue(f"{where_} = {v!r} must be {range_.words}")
    return v


@cache
def _kinds(annotation: Any) -> tuple[list[str], tuple[type, ...], list[Range]]:
    """Return an annotation's type words, the types that they allow, and its ranges."""
    parts = map(str.strip, annotation.split("|")) if isinstance(annotation, str) else [annotation]
    hints = [RANGES.get(part, part) for part in parts]
    bare = [hint.__origin__ if hasattr(hint, "__metadata__") else hint for hint in hints]
    words = [w.strip() for hint in bare for w in getattr(hint, "__name__", str(hint)).split("|")]
    known = [_KINDS.get(w, ((object,), "")) for w in words]
    ranges = [r for hint in hints for r in getattr(hint, "__metadata__", ())]
    return words, sum((types for types, _ in known), ()), ranges


def unmasked(values: ArrayLike) -> np.ndarray:
    """Return numbers as float64; what a mask hides is nan, not what lies below."""
    if "numpy.ma" not in sys.modules:  # before it is loaded, nothing is masked
        return np.asarray(values, np.float64)
    return np.ma.filled(np.ma.asarray(values, np.float64), np.nan)


def bare(v: Any) -> Any:
    """Return a masked array ``unmasked``, and anything else as it is."""
    return unmasked(v) if "numpy.ma" in sys.modules and np.ma.isMaskedArray(v) else v


def _design_array(where_: str, v: Any) -> np.ndarray:
    """Return finite numbers as a read-only float64 array."""
    try:
        a = np.array(bare(v))
    except (TypeError, ValueError):  # rows of several lengths, or a block among them
        a = np.array("")
    if a.dtype.kind not in "iuf":
        raise BadValue(f"{where_} must be numbers, got {v!r:.200}")
    a = a.astype(np.float64)
    a.flags.writeable = False
    if not np.isfinite(a).all():
        raise BadValue(f"{where_}[{int(np.argmin(np.isfinite(a)))}] is not finite")
    return a


def scratch(words: int) -> Any:
    """Return ``work`` of a tile that needs a fixed number of scratch words."""
    return staticmethod(lambda p: words)


def unitless(owner: Block, *u: Unit) -> Unit:
    """Return no unit, as ``units`` of a block whose output has none."""
    return un.ONE


def stated(owner: Any, *u: Unit) -> Unit:
    """Return the unit that a block has in its field ``unit``."""
    return unit(owner.unit)


def same_unit(verb: str, a: Block, b: Block, *u: Unit) -> Unit:
    """Return the common unit of two signals; a literal 0 fits any unit."""
    for one, other in ((0, 1), (1, 0)):
        if u[one] == u[other] or (
            isinstance((a, b)[one], Const) and (a, b)[one].value == 0  # type: ignore[attr-defined]
        ):
            return u[other]
    hint = ""
    for n, m in ((a, u[1]), (b, u[0])):
        if isinstance(n, Const) and n.dim == un.ONE:
            hint = f"; write constant({n.value:g}, {str(m)!r}) if that is meant"
    raise UnitError(f"cannot {verb} [{u[0]}] {a!r} and [{u[1]}] {b!r}{hint}")


def in_unit(what: str, b: Block, u: Unit, wanted: str) -> None:
    """Raise UnitError, with the missing factor, unless a signal has a unit."""
    if u != unit(wanted):
        factor = wanted if u == un.ONE else f"{wanted or 1}/({u})"
        has = f"be in {wanted}" if wanted else "have no unit"
        raise UnitError(f"{what} {b!r} [{u}] must {has}; multiply it by a constant(.., {factor!r})")


def below_half(name: str, fs: float, **edges: float) -> list[float]:
    """Return edges in cycles per sample; raise BadValue below 0, and from fs/2 on."""
    for what, f in edges.items():
        if f < 0:
            raise BadValue(f"{name}: {what} = {f:g} Hz must be 0 or above; raise it")
        if not f < fs / 2:
            raise BadValue(
                f"{name}: {what} = {f:g} Hz does not fit below fs/2 = {fs / 2:g} Hz; lower it, or"
                " raise fs"
            )
    return [f / fs for f in edges.values()]


# Leaves -------------------------------------------------------------------------------
@dc.dataclass(frozen=True, eq=False)
class Named(Block, abstract=True):
    """A signal that comes from outside under a name: an input or a parameter."""

    name: str

    def check(self):
        check_name(type(self).__name__, self.name)


@dc.dataclass(frozen=True, eq=False)
class Input(Named):
    """A signal from outside, such as a measured position.

    Parameters
    ----------
    name : str
    unit : str
        Coherent SI, such as ``"m"``.

    Examples
    --------
    >>> from stimlib import Input
    >>> Input("x", "m")
    Input('x', 'm')
    """

    unit: str = ""
    begins_early = False

    units = stated


@dc.dataclass(frozen=True, eq=False)
class Const(Block):
    """A plain number with a unit; see ``constant``."""

    value: float
    unit: str = ""

    units = stated


@public
def constant(value: float, unit: str = "") -> Const:
    """Make a number with a unit, such as a sample period ``constant(1 / 8000, "s")``.

    Parameters
    ----------
    value : float
    unit : str
        Coherent SI.

    Returns
    -------
    Block

    Raises
    ------
    BadValue
        If the value is not finite.
    UnitError
        If the unit is unknown or has a prefix.

    Examples
    --------
    >>> from stimlib import Input, constant
    >>> str((constant(2000.0, "N/m") * Input("x", "m")).dim)
    'N'
    """
    return Const(value, unit)


def check_name(what: str, name: Any, error: type[StimlibError] = BadValue) -> None:
    """Raise unless a name is short and has only letters, digits and underscores."""
    if not isinstance(name, str) or not name.replace("_", "a").isalnum():
        raise error(f"{what} name {name!r:.200} must be letters, digits and underscores")
    if len(name) > 100:
        raise error(
            f"{what} name {name[:20]!r}.. has {len(name)} letters; at most 100 are possible"
        )


@dc.dataclass(frozen=True, eq=False)
class Pick(Block):
    """One output of a block with several outputs; ``block.name`` makes it."""

    block: Block
    output: str

    def check(self):
        if not isinstance(self.block, Block) or self.output not in self.block.outputs:
            raise BadValue(f"{self.block!r:.200} has no output {self.output!r}")

    def units(self, *u):
        return u[0][self.output_index]

    @property
    def output_index(self) -> int:
        """Which of the block's outputs it is, from 0."""
        return self.block.outputs.index(self.output)


# Arithmetic ---------------------------------------------------------------------------
class Map(Block, abstract=True):
    """A block without memory: its output is a function of the present inputs."""


@dc.dataclass(frozen=True, eq=False)
class Pair(Map, abstract=True):
    """A function of two signals."""

    a: Block
    b: Block


@dc.dataclass(frozen=True, eq=False)
class Add(Pair):
    """The sum a + b of two signals of the same unit."""

    sign = "+"

    def units(self, *u):
        return same_unit("add", self.a, self.b, *u)

    def through(self, p, fs, z, H, value):
        return sum(h for h in H if h is not None)

    @staticmethod
    def step(p, s, a, b):
        return a + b, s


@dc.dataclass(frozen=True, eq=False)
class Sub(Pair):
    """The difference a - b of two signals of the same unit."""

    sign = "\u2212"

    def units(self, *u):
        return same_unit("subtract", self.a, self.b, *u)

    def through(self, p, fs, z, H, value):
        return H[0] if H[1] is None else -H[1] if H[0] is None else H[0] - H[1]

    @staticmethod
    def step(p, s, a, b):
        return a - b, s


class Product(Pair, abstract=True):
    """A product a b of two signals."""

    sign = "\u00d7"

    def units(self, *u):
        return u[0] * u[1]

    def through(self, p, fs, z, H, value):
        if value[1] is not None:
            return H[0] * value[1]
        return None if value[0] is None else H[1] * value[0]


@dc.dataclass(frozen=True, eq=False)
class Mul(Product):
    """The product a b of two signals."""

    @staticmethod
    def step(p, s, a, b):
        return a * b, s


@dc.dataclass(frozen=True, eq=False)
class Div(Pair):
    """The quotient a / b of two signals."""

    sign = "\u00f7"

    def units(self, *u):
        return u[0] / u[1]

    def through(self, p, fs, z, H, value):
        return H[0] / value[1] if H[0] is not None and value[1] is not None else None

    @staticmethod
    def step(p, s, a, b):
        return a / b, s


@dc.dataclass(frozen=True, eq=False)
class Neg(Map):
    """The negative -x of a signal."""

    x: Block
    sign = "\u2212"

    def through(self, p, fs, z, H, value):
        return -H[0]

    @staticmethod
    def step(p, s, x):
        return -x, s


@dc.dataclass(frozen=True, eq=False)
class Abs(Map):
    """The absolute value |x| of a signal."""

    x: Block
    sign = "| |"

    @staticmethod
    def step(p, s, x):
        return abs(x), s


class Compare(Pair, abstract=True):
    """A comparison of two signals of the same unit: 1 where it holds, else 0."""

    rests = True

    def units(self, *u):
        same_unit("compare", self.a, self.b, *u)
        return un.ONE


@dc.dataclass(frozen=True, eq=False)
class Greater(Compare):
    """The comparison a > b: 1 where it holds, else 0."""

    sign = ">"

    @staticmethod
    def step(p, s, a, b):
        return where(a > b, 1.0, 0.0), s


@dc.dataclass(frozen=True, eq=False)
class AtLeast(Compare):
    """The comparison a >= b: 1 where it holds, else 0."""

    sign = "\u2265"

    @staticmethod
    def step(p, s, a, b):
        return where(a >= b, 1.0, 0.0), s


@dc.dataclass(frozen=True, eq=False)
class Equal(Compare):
    """The comparison a == b, exact to the last bit: 1 where it holds, else 0.

    0 and -0 are equal; NaN is equal to nothing.
    """

    sign = "="

    @staticmethod
    def step(p, s, a, b):
        return where(a == b, 1.0, 0.0), s


@dc.dataclass(frozen=True, eq=False)
class NotEqual(Compare):
    """The comparison a != b, which is 1 - (a == b)."""

    sign = "\u2260"

    @staticmethod
    def step(p, s, a, b):
        return where(a == b, 0.0, 1.0), s


def reach(roots: Iterable[Block], closed: type | tuple[()] = ()) -> list[Block]:
    """Return all blocks that the roots depend on, children first, each once.

    It does not recurse, because graphs may be deep, and does not look into blocks of
    the class ``closed``.
    """
    done: dict[int, Block] = {}
    todo = [(b, False) for b in reversed(list(roots))]
    while todo:
        b, ready = todo.pop()
        if id(b) in done:
            continue
        if ready:
            done[id(b)] = b
        else:
            todo.append((b, True))
            todo += [(c, False) for c in reversed(() if isinstance(b, closed) else b.children)]
    return list(done.values())


def named(roots: Iterable[Block], kind: type) -> dict[str, Any]:
    """Return the inputs or parameters that the roots are written with, by name.

    A program has only those left that have an effect.
    """
    return {b.name: b for b in reach(roots) if isinstance(b, kind)}  # type: ignore[attr-defined]


# Flat memory --------------------------------------------------------------------------
def kind(v: Any) -> str:
    """Return the kind of a field as a letter.

    F and U are arrays of float64 and uint64; f and u are single numbers.
    """
    if isinstance(v, np.ndarray):
        return "U" if v.dtype == np.uint64 else "F"
    return "u" if isinstance(v, np.uint64) else "f"


def pack(s: Any) -> np.ndarray:
    """Return a parameter or state tuple as an array of words.

    Fields are in order, arrays are complete, floats are given by their bits.
    """
    fields = [np.asarray(v, np.uint64 if kind(v) in "uU" else np.float64).tobytes() for v in s]
    return np.frombuffer(bytearray().join(fields), np.uint64)


def at_rest(s: Any) -> Any:
    """Return the state of a resettable block off contact, from its designed state."""
    return unpack(s, pack(s))._replace(cold=np.float64(1.0))


def unpack(s: Any, w: np.ndarray) -> Any:
    """Return a tuple of the same type filled from words, scalars as numpy scalars."""
    out: list[Any] = []
    at = 0
    for v in s:
        n = v.size if isinstance(v, np.ndarray) else 1
        part = w[at : at + n].copy() if kind(v) in "uU" else w[at : at + n].copy().view(np.float64)
        out.append(part if isinstance(v, np.ndarray) else part[0])
        at += n
    return type(s)(*out) if len(s) else ()
