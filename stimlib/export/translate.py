"""Translation of steps and tiles to C99, from their checked source.

The walk is that of the compiler (``targets/walk.py``); here its stand-ins are texts of
C.  A helper becomes a function, and a variable keeps its name.  A tuple is a struct
where it is kept, given or returned, and its parts in between.  The kinds of values
follow from those of parameters and state, which ``design`` gives, and of the signals.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from ..core import maths
from ..errors import SceneError
from ..targets.llvm import known
from ..targets.llvm.values import (
    KINDS,
    SHIFTS,
    SIGNS,
    Array,
    Known,
    Pointer,
    Unknown,
    Value,
    binary,
    cast,
    common,
    like,
    number,
    parts,
    plain,
    rebuilt,
    several,
)
from ..targets.walk import TYPES, Anew, Frame, Walk, syntax
from .values import C_TYPES, Fixed, Kind, literal, local, named

OPERATORS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitXor: "^", ast.BitAnd: "&",
    ast.BitOr: "|", ast.LShift: "<<", ast.RShift: ">>", ast.Mod: "%", ast.FloorDiv: "/",
} | SIGNS  # fmt: skip
CALLED: dict[tuple[type, str], str] = {
    (ast.Mod, "f8"): "st_mod", (ast.Mod, "i8"): "st_rest", (ast.LShift, "i8"): "st_left",
    (ast.RShift, "i8"): "st_right", (ast.LShift, "u8"): "st_left_word",
    (ast.RShift, "u8"): "st_right_word", (ast.Mod, "u8"): "st_rest_word",
    (ast.FloorDiv, "i8"): "st_quotient", (ast.FloorDiv, "u8"): "st_quotient_word",
}  # fmt: skip
"""Operators that are a function of ``runtime.h``, of numbers of a kind."""


def text(x: Any) -> str:
    """Return a number as C writes it."""
    x = number(x)
    return literal(x.v.constant, x.kind) if isinstance(x.v, ir.Constant) else x.v


class Printer:
    """What writes operations of numbers, as texts of C."""

    wraps = False  # see values.Builder

    def converted(self, x: Value, kind: str) -> Value:
        """Return a number as one of another kind."""
        if isinstance(x.v, ir.Constant) and kind == "f8":
            return number(float(x.v.constant))
        if isinstance(x.v, ir.Constant) and {x.kind, kind} == {"i8", "u8"}:
            return x._replace(kind=kind)
        made = f"({text(x)} != 0)" if kind == "b1" else f"(({C_TYPES[kind]}){text(x)})"
        return Value(made, kind, x.kind == "b1")

    def beyond(self, x: Value, kind: str) -> str:
        """Return a float as a whole number."""
        return f"st_to_{'word' if kind == 'u8' else 'whole'}({text(x)})"

    def computed(self, op: type, x: Value, y: Value, kind: str) -> str:
        """Return x op y, which are of one kind."""
        a, b = text(x), text(y)
        by = y.v.constant if isinstance(y.v, ir.Constant) else -1
        plainly = 0 <= by < 64 if op in SHIFTS else by > 0 and kind == "u8"
        if (op, kind) in CALLED and not plainly:
            return f"{CALLED[op, kind]}({a}, {b})"
        sign = OPERATORS[op]
        small = any(isinstance(v.v, ir.Constant) and abs(v.v.constant) < 2**31 for v in (x, y))
        sums = self.wraps or not small
        wraps = op in (ast.Mult, ast.LShift) or op in (ast.Add, ast.Sub) and sums
        if kind == "i8" and wraps:
            return f"((int64_t)((uint64_t){a} {sign} (uint64_t){b}))"  # so that it wraps
        return f"({a} {sign} {b})"

    def negative(self, x: Value) -> str:
        """Return -x."""
        return f"((int64_t)(0 - (uint64_t){text(x)}))" if x.kind == "i8" else f"(-{text(x)})"

    def size(self, x: Value) -> str:
        """Return the absolute value."""
        return f"{'fabs' if x.kind == 'f8' else 'st_abs'}({text(x)})"

    def chosen(self, c: Value, x: Value, y: Value) -> str:
        """Return x where c is true, else y; both are of one kind."""
        return f"({text(c)} ? {text(x)} : {text(y)})"

    def element(self, p: Pointer, i: Value) -> Pointer:
        """Return the place of an element."""
        return Pointer(f"{p.v}.p[{text(i)}]" if p.kind == "f8" else f"{p.v}, {text(i)}", p.kind)

    def loaded(self, p: Pointer, fixed: bool = False) -> Value:
        """Return the number at a place."""
        return Value(p.v if p.kind == "f8" else f"st_word({p.v})", p.kind)

    def from_end(self, i: Value, n: Value) -> str:
        """Return the index i, which counts from the end where it is below 0."""
        if isinstance(i.v, ir.Constant):
            return f"{text(n)} - {-i.v.constant}"
        return f"st_at({text(i)}, {text(n)})"


def runtime(name: str, result: str, *kinds: str) -> Known:
    """Return a call of a function of ``runtime.h``: of such numbers, or arrays."""

    def f(w: Any, *given: Any) -> Any:
        of = [cast(w.b, x, k) for x, k in zip(given, kinds, strict=True)] if kinds else given
        return w.result_of(f"{name}({', '.join(map(w.text, of))})", result)

    return Known(f)


def _words(w: Any, a: Any) -> Any:
    if w.unit.single:
        raise Unknown("64-bit words take the room of two float32 (use doubles)")
    return w.result_of(f"st_as_words({w.text(a)})", "u8*")


def _each(w: Any, f: Any, p: Any, arrays: Any, y: Any) -> None:
    with w.turns(number(0), y.n, 1) as i:
        given = [w.b.loaded(w.address(a, i)) for a in arrays]
        w.put(w.address(y, i), w.walk(f, [p, *given]))


def _pairs(w: Any, f: Any, key: Any, first: Any, z: Any) -> None:
    with w.turns(number(0), z.n, 2) as i:
        k = cast(w.b, binary(w.b, ast.RShift, i, 1), "u8")
        one, other = w.walk(f, [key, binary(w.b, ast.Add, first, k)])
        w.put(w.address(z, i), one)
        later = binary(w.b, ast.Add, i, 1)
        with w.block(f"if ({text(later)} < {text(z.n)})"):
            w.put(w.address(z, later), other)


TWINS: dict[Any, Any] = TYPES | {
    getattr(maths, name): Known(lambda w, x, f=f: w.walk(f, [cast(w.b, x, "f8")]))
    for name, f in maths.ELEMENTARY.items()
    if name[0] != "_"
}
TWINS |= {
    maths.where: known.TWINS[maths.where],
    maths.as_float: Known(lambda w, u: Value(f"((double)(uint64_t){text(u)})", "f8")),
    maths.words: Known(_words),
    maths.each: Known(_each),
    maths.pairs: Known(_pairs),
    round: Known(lambda w, x: Value(f"((int64_t)rint({text(cast(w.b, x, 'f8'))}))", "i8")),
    maths.fma: runtime("fma", "f8", "f8", "f8", "f8"),
    maths.sqrt: runtime("sqrt", "f8", "f8"),
    maths.floor: runtime("floor", "f8", "f8"),
    maths.flush: runtime("st_flush", "f8", "f8"),
    maths.settle: runtime("st_flush", "f8", "f8"),
    maths.bits: runtime("st_bits", "u8", "f8"),
    maths.unbits: runtime("st_unbits", "f8", "u8"),
    maths.search: runtime("st_search", "i8"),
    maths.quotient: Known(
        lambda w, n, i, by, _inverse: binary(w.b, ast.Div, binary(w.b, ast.Add, n, i), by)
    ),
    maths.copy: runtime("st_copy", "void"),
    maths.fir: runtime("st_fir", "void"),
    maths.modes: runtime("st_modes", "void"),
    maths.memory: runtime("st_memory", "void"),
    maths.chebyshev: runtime("st_chebyshev", "void"),
}
"""What stands in the place of functions and types that a step may use."""


class Unit:
    """The functions and types of one C file."""

    def __init__(self, single: bool = False, names: set[str] | None = None) -> None:
        self.single = single
        self.names: set[str] = set() if names is None else names
        # functions of maths.py, which stay in double precision
        self.maths: Unit = self if names is not None else Unit(names=self.names)
        self.types: list[str] = []
        self.functions: list[str] = []
        self.made: dict[Any, Any] = {}

    def name(self, wanted: str) -> str:
        """Return a name that is not yet taken in this file."""
        wanted, k = re.sub(r"\W", "_", wanted).strip("_"), 2
        name = wanted
        while name in self.names:
            name, k = f"{wanted}_{k}", k + 1
        self.names.add(name)
        return name

    def fields(self, kind: Kind) -> list[tuple[str, Kind]]:
        """Return the fields of a struct; an empty part has none."""
        return [(n, k) for n, k in named(kind) if self.type(k) != "void"]

    def type(self, kind: Kind) -> str:
        """Return the C type of a kind; that of a tuple is written first."""
        if isinstance(kind, Fixed):
            return "void"
        if isinstance(kind, str):
            return C_TYPES[kind]
        if kind not in self.made:
            fields = [(n, self.type(k)) for n, k in self.fields(kind)]
            if not fields:
                return "void"
            self.made[kind] = name = self.name(f"stim_{kind[0].__name__}")
            self.names.add(f"{name}_of")
            rows = " ".join(f"{of} {n};" for n, of in fields)
            self.types.append(f"typedef struct {{ {rows} }} {name};")
            given = ", ".join(f"{of} {n}" for n, of in fields)
            sets = " ".join(f"st_made.{n} = {n};" for n, _ in fields)
            self.functions.append(
                f"ST_INLINE {name} {name}_of({given})\n{{\n"
                f"    {name} st_made;\n    {sets}\n    return st_made;\n}}\n"
            )
        return self.made[kind]

    def function(self, f: Callable, kinds: Sequence[Kind]) -> tuple[str, Kind]:
        """Return the name of a function's translation, and the kind of its result."""
        key = f, tuple(kinds)
        if f.__module__ == maths.__name__ and self is not self.maths:
            return self.maths.function(f, kinds)
        if key not in self.made:
            name = self.name(f"stim_{f.__qualname__.replace('.', '_')}")
            try:
                body, result = Translator(self, f, kinds).translated()
            except Unknown as e:
                where = f"{e.where}{f.__qualname__}: " * bool(e.where)
                raise SceneError(f"{where}{e}, so it cannot be exported") from e
            pairs = zip(inspect.signature(f).parameters, kinds, strict=True)
            given = [f"{self.type(k)} {local(n)}" for n, k in pairs if self.type(k) != "void"]
            head = f"ST_INLINE {self.type(result)} {name}({', '.join(given) or 'void'})"
            self.functions.append("\n".join([head, "{", *body, "}", ""]))
            self.made[key] = name, result
        return self.made[key]


class Translator(Walk):
    """One Python function, with known kinds of its arguments, as lines of C."""

    def __init__(self, unit: Unit, f: Any, kinds: Sequence[Kind]) -> None:
        super().__init__(TWINS, {}, {})
        self.unit, self.b = unit, Printer()
        self.frame = Frame(f, syntax(f, f.__code__), ())
        self.given = dict(zip(inspect.signature(f).parameters, kinds, strict=True))
        self.wholes: dict[str, Kind] = {}

    def translated(self) -> tuple[list[str], Kind]:
        """Return the lines of the body, and the kind of the result."""
        self.frame.names, self.kinds, self.versions = {}, dict(self.given), dict[str, str]()
        self.lines: list[str] = []
        self.written: dict[str, ast.expr] = {}  # what a name was given last
        self.depth, self.fresh = 1, 0
        self.result: Kind = "void"
        try:
            for n, kind in self.given.items():
                self.frame.names[n] = x = self.apart(local(n), kind)
                if n in self.frame.within and kind in ("b1", "i8"):  # it may widen
                    self.versions[n] = f"{n}.1"
                    self.set(n, x)
            self.statements(self.frame.node.body)
        except Anew:
            return self.translated()
        heads = [  # without a value, C++ warns
            f"    {self.unit.type(k)} {local(n)}{' = 0' * (k in KINDS)};"
            for n, k in self.kinds.items()
            if n not in self.given and self.unit.type(k) != "void"
        ]
        return heads + self.lines, self.result

    # Values ---------------------------------------------------------------------------
    def firm(self, x: Any) -> Any:
        """Return a value as it is kept: in a tuple, plain numbers are floats."""

        def leaf(v: Any) -> Any:
            if isinstance(v, Pointer):
                return v
            wide = several(x) and (number(v).kind == "b1" or plain(v) and number(v).kind == "i8")
            return cast(self.b, v, "f8") if wide else number(v)

        return like(x, map(leaf, parts(x)))

    def kind(self, x: Any) -> Kind:
        """Return the kind of a value."""
        if isinstance(x, Array):
            return f"{x.p.kind}*"
        if now(x) and not plain(x):
            return Fixed(x, repr(x))
        return (type(x), *map(self.kind, x)) if several(x) else number(x).kind

    def text(self, x: Any) -> str:
        """Return a value as C writes it; of a tuple known now there is nothing."""
        if isinstance(x, Array):
            return x.p.v
        if not several(x):
            return text(x)
        if now(x):
            return ""
        fields, given = self.unit.fields(self.kind(x)), [*filter(None, map(self.text, x))]
        whole = given[0].removesuffix(f".{fields[0][0]}")
        if self.wholes.get(whole) == self.kind(x) and given == [f"{whole}.{n}" for n, _ in fields]:
            return whole
        return f"{self.unit.type(self.kind(x))}_of({', '.join(given)})"

    def apart(self, text: str, kind: Kind) -> Any:
        """Return what a text stands for, a tuple in its parts."""
        if isinstance(kind, Fixed):
            return kind.value
        if isinstance(kind, tuple):
            self.wholes[text] = kind
            return rebuilt(kind[0], [self.apart(f"{text}.{n}", k) for n, k in named(kind)])
        if kind[-1] == "*":
            return Array(Pointer(text, kind[:-1]), Value(f"{text}.n", "i8", True))
        return Value(text, kind)

    def held(self, x: Any) -> Any:
        """Write a constant for each part of a value, unless it has one."""
        if several(x):
            return rebuilt(type(x), map(self.held, x))
        if not isinstance(x, Value | Array) or re.fullmatch(r"st_t\d+(\.\w+)*", self.text(x)):
            return x
        return self.constant(self.text(x), self.kind(x))

    def constant(self, text: str, kind: Kind) -> Any:
        """Write a constant, and return what it stands for."""
        self.fresh += 1
        self.line(f"const {self.unit.type(kind)} st_t{self.fresh} = {text};")
        return self.apart(f"st_t{self.fresh}", kind)

    # Expressions ----------------------------------------------------------------------
    def part(self, of: Array, ends: Iterator[tuple[Value | None, Value]]) -> Array:
        """Return a slice of an array: its ends, each with that of the array."""
        given = ", ".join(text(cast(self.b, self.index(x or end), "i8")) for x, end in ends)
        kind = self.kind(of)
        return self.apart(f"{C_TYPES[kind]}_cut({of.p.v}, {given})", kind)

    def either(self, test: Value, *write: Callable[[], Any]) -> Value:
        """Return what one or the other writes."""
        lines = len(self.lines)
        one, other = found = [number(f()) for f in write]
        if len(self.lines) > lines:  # it would run in any case
            raise Unknown("a tuple of a helper behind `and` or `or`: give it a line above")
        kind = "b1" if one.kind == other.kind == "b1" else common(*found)
        if kind == "b1" and test.v in (one.v, other.v):
            a, sign, b = (test, "||", other) if test.v == one.v else (test, "&&", one)
            return Value(f"({text(a)} {sign} {text(b)})", kind)
        return Value(self.b.chosen(test, *(cast(self.b, v, kind) for v in found)), kind)

    def _Call(self, node: Any) -> Any:
        f = self.value(node.func)
        given = [*node.args, *(k.value for k in node.keywords)] * hasattr(f, "_fields")
        if self.unit.single and any(counts(self.meant(x)) for x in given):
            raise Unknown("in float32 a count ends at 2^24 (export in doubles)")
        return super()._Call(node)

    def walk(self, f: Any, given: Sequence[Any], named: Any = None) -> Any:
        """Return the result of a function, written by its own name."""
        bound = inspect.signature(f).bind(*given, **(named or {}))
        bound.apply_defaults()
        given = [x if now(x) and several(x) else self.firm(x) for x in bound.arguments.values()]
        name, result = self.unit.function(f, [self.kind(x) for x in given])
        return self.result_of(f"{name}({', '.join(filter(None, map(self.text, given)))})", result)

    def result_of(self, call: str, kind: Kind) -> Any:
        """Return the result of a call; a struct has a constant."""
        if self.unit.type(kind) == "void":
            self.line(f"{call};")
            return None if kind == "void" else self.apart("", kind)
        return self.apart(call, kind) if isinstance(kind, str) else self.constant(call, kind)

    # Statements -----------------------------------------------------------------------
    def line(self, line: str) -> None:
        """Add a line at the present depth."""
        self.lines.append("    " * self.depth + line)

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        """Add a block below a head."""
        self.line(f"{head} {{")
        self.depth += 1
        yield
        self.depth -= 1
        self.line("}")

    @contextmanager
    def turns(self, start: Value, stop: Value, by: int) -> Iterator[Value]:
        """Add a loop; the block gets the number of a turn."""
        self.fresh += 1
        i, n = f"st_i{self.fresh}", f"st_n{self.fresh}"
        ends = f"int64_t {i} = {text(start)}, {n} = {text(stop)}"
        after = f"{i} += {by}" if abs(by) == 1 else f"{i} = st_next({i}, {literal(by)}, {n})"
        with self.block(f"for ({ends}; {i} {'<' if by > 0 else '>'} {n}; {after})"):
            yield Value(i, "i8", start.low and by > 0)

    def choose(self, test: Value, node: ast.If) -> None:
        """Add the two sides of a branch."""
        with self.block(f"if ({text(test)})"):
            self.statements(node.body)
        if node.orelse:
            with self.block("else"):
                self.statements(node.orelse)

    def repeat(self, node: ast.While) -> None:
        """Add a loop that ends with its condition."""
        with self.block("for (;;)"):
            self.line(f"if (!{text(self.truth(self.value(node.test)))}) break;")
            self.statements(node.body)

    def _Break(self, node: Any) -> None:
        self.line(f"{type(node).__name__.lower()};")

    _Continue = _Break

    def _Expr(self, node: Any) -> None:
        x = self.value(node.value)
        if isinstance(x, Value):
            self.line(f"{text(x)};")

    def _Return(self, node: Any) -> None:
        x = self.firm(self.value(node.value) if node.value else ())
        self.result = self.kind(x)
        self.line(f"return {self.text(x)}".rstrip() + ";")

    def _Assign(self, node: Any) -> None:
        x = self.value(node.value)
        if len(node.targets) > 1 or isinstance(node.targets[0], ast.Tuple):
            x = self.held(x)
        for target in node.targets:
            self.assign(target, x)
            self.written[getattr(target, "id", "")] = self.meant(node.value)

    def _AugAssign(self, node: Any) -> None:
        super()._AugAssign(node)
        name = getattr(node.target, "id", "")
        self.written[name] = self.meant(ast.BinOp(ast.Name(name), node.op, node.value))

    def meant(self, node: Any) -> Any:
        """Return a value, or a sum of two, with what was given to its names."""
        if isinstance(node, ast.BinOp):
            return ast.BinOp(self.meant(node.left), node.op, self.meant(node.right))
        return self.written.get(node.id, node) if isinstance(node, ast.Name) else node

    def set(self, name: str, x: Any) -> None:
        """Set a variable: where its kind changes and no branch does it, a new one."""
        within = name in self.frame.within
        if not within and now(x):
            self.frame.names[name] = x
            return
        x, key = self.firm(x), self.versions.get(name, name)
        kind = self.kind(x)
        old: Any = self.kinds.setdefault(key, self.wider.get((key, name), kind))
        if old != kind and within:
            self._widen(old, kind, (key, name))
            x, kind = cast(self.b, x, old), old
        elif old != kind:
            count = int(self.versions.get(name, ".0").split(".")[1]) + 1
            self.versions[name] = key = f"{name}.{count}"
            self.kinds[key] = kind
        if given := self.text(x):
            self.line(f"{local(key)} = {given};")
        made = self.apart(local(key), kind)
        low = isinstance(made, Value) and not within and x.low
        self.frame.names[name] = made._replace(low=True) if low else made

    def put(self, p: Pointer, x: Any) -> None:
        """Write a number to its place."""
        given = text(cast(self.b, x, p.kind))
        self.line(f"{p.v} = {given};" if p.kind == "f8" else f"st_put_word({p.v}, {given});")

    def fill(self, to: Array, x: Any) -> None:
        """Write a number, or an array's elements, into an array."""
        array = isinstance(x, Array)
        if array and x.p.kind != to.p.kind:
            raise Unknown("elements of another kind")
        given = x.p.v if array else text(cast(self.b, x, to.p.kind))
        self.line(f"{C_TYPES[self.kind(to)]}_fill{'_from' * array}({to.p.v}, {given});")


def now(x: Any) -> bool:
    """Return whether something is known now."""
    return not any(hasattr(v, "v") for v in parts(x))


def counts(node: Any) -> bool:
    """Return whether a new value is one of the state and a constant, as of a clock."""
    sides = (type(node.left), type(node.right)) if isinstance(node, ast.BinOp) else ()
    plus = sides == (ast.Attribute, ast.Constant) and isinstance(node.op, ast.Add | ast.Sub)
    return plus or (sides == (ast.Constant, ast.Attribute) and isinstance(node.op, ast.Add))
