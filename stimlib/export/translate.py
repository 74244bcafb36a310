"""Translation of steps and tiles to C99, from their checked source.

A step means the same to every target (``stimlib.core.steps``), so a translation needs
the kinds of values and nothing else. These follow from the kinds of parameters and
state, which ``design`` gives, and from those of the signals.
"""

from __future__ import annotations

import ast
import math
import types
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..core import maths, steps
from ..errors import SceneError

DOUBLE, WORD, WHOLE, TRUTH = "double", "uint64_t", "int64_t", "int"
NUMBERS = (DOUBLE, WORD, WHOLE, TRUTH)
FLOATS, WORDS = "st_floats", "st_words"  # arrays: a pointer and a number of elements
ELEMENTS = {FLOATS: DOUBLE, WORDS: WORD}
KINDS = {"f": DOUBLE, "u": WORD, "F": FLOATS, "U": WORDS}
NOTHING = "void"

OPERATORS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitXor: "^", ast.BitAnd: "&",
    ast.BitOr: "|", ast.LShift: "<<", ast.RShift: ">>", ast.Gt: ">", ast.Lt: "<", ast.GtE: ">=",
    ast.LtE: "<=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
RUNTIME = {
    maths.fma: ("fma", DOUBLE),
    maths.sqrt: ("sqrt", DOUBLE),
    maths.floor: ("floor", DOUBLE),
    maths.flush: ("st_flush", DOUBLE),
    maths.settle: ("st_flush", DOUBLE),
    maths.bits: ("st_bits", WORD),
    maths.unbits: ("st_unbits", DOUBLE),
    maths.words: ("st_as_words", WORDS),
    maths.search: ("st_search", WHOLE),
    maths.copy: ("st_copy", NOTHING),
    maths.fir: ("st_fir", NOTHING),
    maths.modes: ("st_modes", NOTHING),
    maths.memory: ("st_memory", NOTHING),
    abs: ("fabs", DOUBLE),
}
"""Functions of ``runtime.h``, and the kinds that they return."""
ELEMENTARY = {getattr(maths, name): f for name, f in maths.ELEMENTARY.items() if name[0] != "_"}
RESERVED = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if"
    " inline int long register restrict return short signed sizeof static struct switch typedef"
    " union unsigned void volatile while and or not xor new delete this class template operator"
    " y0 y1 yn j0 j1 jn gamma index fma sqrt floor fabs memcpy memset".split()
)


class Record(NamedTuple):
    """A C struct that stands for a tuple: its name, its fields and their kinds."""

    name: str
    fields: tuple[tuple[str, Any], ...]


Kind = Any
"""The kind of a value: a C type by name, a `Record`, or None for an empty tuple."""


class Value(NamedTuple):
    """A C expression and its kind; ``number`` if it is a plain number of Python."""

    text: str
    kind: Kind
    number: Any = None


def kind_name(kind: Kind) -> str:
    """Return the C type of a kind."""
    return kind.name if isinstance(kind, Record) else kind


def literal(v: Any) -> Value:
    """Return a number as C writes it, with all its digits."""
    if isinstance(v, np.uint64):
        return Value(f"UINT64_C({int(v)})", WORD)
    if isinstance(v, bool):
        return Value(str(int(v)), TRUTH)
    if isinstance(v, (int, np.integer)):
        return Value(f"INT64_C({int(v)})" if abs(int(v)) >= 2**31 else f"{int(v)}", WHOLE, int(v))
    v = float(v)
    if math.isnan(v):
        return Value("NAN", DOUBLE)
    if math.isinf(v):
        return Value("INFINITY" if v > 0 else "(-INFINITY)", DOUBLE)
    return Value(repr(v) if v >= 0 and math.copysign(1, v) > 0 else f"({v!r})", DOUBLE)


class Unit:
    """The functions and types of one C file."""

    def __init__(self) -> None:
        self.types: list[str] = []
        self.functions: list[str] = []
        self.records: dict[Any, Record] = {}
        self.made: dict[Any, tuple[str, Kind]] = {}
        self.names: set[str] = set()

    def name(self, wanted: str) -> str:
        """Return a name that is not yet taken in this file."""
        wanted, k = wanted.strip("_"), 2
        name = wanted
        while name in self.names:
            name, k = f"{wanted}_{k}", k + 1
        self.names.add(name)
        return name

    def record(self, name: str, fields: Sequence[tuple[str, Kind]]) -> Record | None:
        """Return the struct with these fields; None where there are none."""
        fields = tuple((local(f), kind) for f, kind in fields if kind is not None)
        key = name, fields
        if not fields:
            return None
        if key not in self.records:
            made = Record(self.name(name), fields)
            rows = " ".join(f"{kind_name(kind)} {f};" for f, kind in fields)
            self.types.append(f"typedef struct {{ {rows} }} {made.name};")
            self.records[key] = made
        return self.records[key]

    def struct(self, name: str, fields: Sequence[tuple[str, Kind]]) -> Record | None:
        """Return the struct with these fields, and write the function that makes it."""
        record = self.record(name, fields)
        if record is not None and f"{record.name}_of" not in self.names:
            self.names.add(f"{record.name}_of")
            given = ", ".join(f"{kind_name(kind)} {f}" for f, kind in record.fields)
            sets = " ".join(f"st_made.{f} = {f};" for f, _ in record.fields)
            self.functions.append(
                f"ST_INLINE {record.name} {record.name}_of({given})\n{{\n"
                f"    {record.name} st_made;\n    {sets}\n    return st_made;\n}}\n"
            )
        return record

    def function(self, f: Callable, kinds: Sequence[Kind]) -> tuple[str, Kind]:
        """Return the name of a function's translation, and the kind of its result."""
        key = f, tuple(kinds)
        if key not in self.made:
            name = self.name(f"stim_{f.__qualname__.replace('.', '_')}")
            body, result = Translator(self, f, kinds).translated()
            names = list(f.__code__.co_varnames[: f.__code__.co_argcount])
            given = [
                f"{kind_name(kind)} {local(n)}"
                for n, kind in zip(names, kinds, strict=True)
                if kind is not None
            ]
            head = f"ST_INLINE {kind_name(result)} {name}({', '.join(given) or 'void'})"
            self.functions.append("\n".join([head, "{", *body, "}", ""]))
            self.made[key] = name, result
        return self.made[key]

    def polynomial(self, coefficients: tuple[float, ...]) -> str:
        """Return the name of a polynomial of ``maths`` with its numbers written out."""
        if coefficients not in self.made:
            name = self.name("stim_polynomial")
            c = [literal(v).text for v in coefficients]
            a, d, u, b = c[:4]
            rows = [f"    double z = x * x, w = z * z, a = {a}, d = {d}, c = {u}, b = {b};"]
            for k, v in enumerate(c[4:]):
                rows.append(f"    {'adcb'[k % 4]} = fma({'adcb'[k % 4]}, w, {v});")
            order = len(c) % 4
            assert order == 1, "of degree 4 n"
            rows.append("    return fma(fma(d, x, c), z, fma(b, x, a));")
            text = [f"ST_INLINE double {name}(double x)", "{", *rows, "}", ""]
            self.functions.append("\n".join(text))
            self.made[coefficients] = name, DOUBLE
        return self.made[coefficients][0]


def local(name: str) -> str:
    """Return a Python name as C takes it."""
    return f"{name}_" if name in RESERVED or name.startswith(("st_", "ST_")) else name


class Translator:
    """One Python function, with known kinds of its arguments, as lines of C."""

    def __init__(self, unit: Unit, f: Any, kinds: Sequence[Kind]) -> None:
        self.unit, self.f, self.known = unit, f, steps.names(f)
        text, self.offset = steps.source(f), f.__code__.co_firstlineno - 1
        self.body: list[Any] = ast.parse(text).body[0].body  # type: ignore[attr-defined]
        names = f.__code__.co_varnames[: f.__code__.co_argcount]
        self.given = dict(zip(names, kinds, strict=True))
        self.kinds: dict[str, Kind] = dict(self.given)
        self.result: Kind = NOTHING

    def fail(self, node: ast.AST, why: str) -> SceneError:
        """Return the error for a part that C has no form for."""
        line = getattr(node, "lineno", 1) + self.offset
        return SceneError(
            f"{self.f.__code__.co_filename}:{line}: {self.f.__qualname__}: {why}, so it cannot be"
            f" exported: {ast.unparse(node)[:80]}"
        )

    def translated(self) -> tuple[list[str], Kind]:
        """Return the lines of the body, and the kind of the result.

        A variable's kind may widen from a whole number to a float; then the body is
        translated once more.
        """
        while True:
            before = dict(self.kinds)
            self.lines: list[str] = []
            self.depth, self.fresh = 1, 0
            for node in self.body:
                self.statement(node)
            if self.kinds == before:
                break
        own = [(n, kind) for n, kind in self.kinds.items() if n not in self.given]
        heads = [f"    {kind_name(kind)} {local(n)}{rest(kind)};" for n, kind in own if kind]
        return heads + self.lines, self.result

    # Expressions ----------------------------------------------------------------------
    def value(self, node: Any) -> Value:
        """Return an expression in C."""
        translate = getattr(self, f"_{type(node).__name__}", None)
        if translate is None:
            raise self.fail(node, f"{type(node).__name__} has no form in C")
        return translate(node)

    def double(self, node: Any) -> str:
        """Return an expression as a double."""
        return as_double(self.value(node))

    def _Constant(self, node: Any) -> Value:
        return literal(node.value)

    def _Name(self, node: Any) -> Value:
        if node.id in self.kinds:
            kind = self.kinds[node.id]
            return Value("" if kind is None else local(node.id), kind)
        v = self.known.get(node.id)
        if isinstance(v, (int, float, np.generic)):
            return literal(v)
        raise self.fail(node, f"{node.id} is not a number")

    def _Attribute(self, node: Any) -> Value:
        target = steps._target(node, self.known)
        if isinstance(target, (int, float, np.generic)):
            return literal(target)
        of = self.value(node.value)
        if of.kind in ELEMENTS:
            return Value(f"{of.text}.n", WHOLE)
        name = local(node.attr)
        return Value(f"{of.text}.{name}", dict(of.kind.fields)[name])

    def _Subscript(self, node: Any) -> Value:
        of = self.value(node.value)
        if isinstance(of.kind, Record):
            name, kind = of.kind.fields[node.slice.value]
            return Value(f"{of.text}.{name}", kind)
        if isinstance(node.slice, ast.Slice):
            low = self.value(node.slice.lower).text if node.slice.lower else "0"
            high = self.value(node.slice.upper).text if node.slice.upper else f"{of.text}.n"
            return Value(f"{of.kind}_cut({of.text}, {low}, {high})", of.kind)
        return Value(element(of, self.value(node.slice).text), ELEMENTS[of.kind])

    def _UnaryOp(self, node: Any) -> Value:
        of = self.value(node.operand)
        return Value(
            f"(-{of.text})", WHOLE if of.kind == TRUTH else of.kind, of.number and -of.number
        )

    def _BinOp(self, node: Any) -> Value:
        if isinstance(node.op, ast.Pow):  # of plain numbers, in the library's own functions
            return literal(eval(ast.unparse(node), {}))
        a, b, sign = self.value(node.left), self.value(node.right), OPERATORS.get(type(node.op))
        if not (a.kind in NUMBERS and b.kind in NUMBERS):
            raise self.fail(node, "an array is no number, and needs a loop")
        if isinstance(node.op, ast.Div):
            return Value(f"({as_double(a)} / {as_double(b)})", DOUBLE)
        if DOUBLE in (a.kind, b.kind):
            if isinstance(node.op, ast.Mod):
                return Value(f"st_mod({as_double(a)}, {as_double(b)})", DOUBLE)
            return Value(f"({as_double(a)} {sign} {as_double(b)})", DOUBLE)
        kind = WORD if WORD in (a.kind, b.kind) else TRUTH if a.kind == b.kind == TRUTH else WHOLE
        if kind == TRUTH and sign not in ("&", "|", "^"):
            kind = WHOLE
        if kind == WORD and any(v.kind == WHOLE and v.number is None for v in (a, b)):
            raise self.fail(node, "a uint64 and a whole number differ between targets")
        if isinstance(node.op, ast.Mod):
            return Value(
                f"({a.text} % {b.text})" if kind == WORD else f"st_rest({a.text}, {b.text})", kind
            )
        return Value(f"({a.text} {sign} {b.text})", kind)

    def _Compare(self, node: Any) -> Value:
        if unknown := [type(op).__name__ for op in node.ops if type(op) not in OPERATORS]:
            raise self.fail(node, f"{unknown[0]} has no form in C")
        values = [self.value(v) for v in (node.left, *node.comparators)]
        parts = [
            f"({a.text} {OPERATORS[type(op)]} {b.text})"
            for a, op, b in zip(values[:-1], node.ops, values[1:], strict=True)
        ]
        return Value(f"({' && '.join(parts)})" if len(parts) > 1 else parts[0], TRUTH)

    def _BoolOp(self, node: Any) -> Value:
        sign = " && " if isinstance(node.op, ast.And) else " || "
        return Value(f"({sign.join(self.value(v).text for v in node.values)})", TRUTH)

    def _Tuple(self, node: Any) -> Value:
        return self.made("stim_tuple", [(f"a{k}", self.value(v)) for k, v in enumerate(node.elts)])

    def made(self, name: str, values: Sequence[tuple[str, Value]]) -> Value:
        """Return a struct of these values, made by a function of its own."""
        values = [(f, widened(v)) for f, v in values]
        kept = [(f, v) for f, v in values if v.kind is not None]
        record = self.unit.struct(name, [(f, v.kind) for f, v in kept])
        if record is None:
            return Value("", None)
        return Value(f"{record.name}_of({', '.join(v.text for _, v in kept)})", record)

    def _Call(self, node: Any) -> Value:
        target = steps._target(node.func, self.known)
        if target in (np.int64, np.uint64):
            of = self.value(node.args[0])
            kind = WHOLE if target is np.int64 else WORD
            return Value(f"(({kind})({of.text}))", kind)
        if target is maths.where:
            c, a, b = (self.value(v) for v in node.args)
            kind = WORD if a.kind == b.kind == WORD else DOUBLE
            chosen = (v.text if kind == WORD else as_double(v) for v in (a, b))
            return Value(f"({c.text} ? {' : '.join(chosen)})", kind)
        if target in (maths.as_float, np.float64):
            return Value(f"((double)({self.value(node.args[0]).text}))", DOUBLE)
        if target is maths.each or target is maths.pairs:
            return self.loop(target, node)
        if isinstance(target, type) and hasattr(target, "_fields"):
            values = [self.value(v) for v in node.args]
            named = {k.arg: self.value(k.value) for k in node.keywords}
            names = target._fields[: len(values)] + tuple(named)
            both = dict(zip(names, [*values, *named.values()], strict=True))
            return self.made(f"stim_{target.__name__}", [(f, both[f]) for f in target._fields])
        name = getattr(target, "__name__", "")
        if target is maths.ELEMENTARY.get("_polynomial"):
            coefficients = self.known[node.args[0].id]
            return Value(
                f"{self.unit.polynomial(coefficients)}({self.double(node.args[1])})", DOUBLE
            )
        if target in RUNTIME:
            function, kind = RUNTIME[target]
            given = [self.value(v) for v in node.args]
            return Value(f"{function}({', '.join(v.text for v in given)})", kind)
        if not isinstance(target, types.FunctionType):
            raise self.fail(node, f"a call of {name or ast.unparse(node.func)} has no form in C")
        given = [self.value(v) for v in node.args]
        if target in ELEMENTARY:  # of a number
            target, given = ELEMENTARY[target], [Value(as_double(given[0]), DOUBLE)]
        missing = target.__code__.co_argcount - len(given)
        given += [literal(v) for v in (target.__defaults__ or ())[-missing:] if missing]
        given = [Value(as_double(v), DOUBLE) if v.kind == TRUTH else v for v in given]
        function, kind = self.unit.function(target, [v.kind for v in given])
        return Value(f"{function}({', '.join(v.text for v in given if v.kind is not None)})", kind)

    def loop(self, target: Any, node: Any) -> Value:
        """Write the loop of ``each`` or ``pairs``."""
        f, out = self.known[node.args[0].id], self.value(node.args[3])
        self.fresh += 1
        i, t = f"st_i{self.fresh}", f"st_t{self.fresh}"
        self.put(f"{{ int64_t {i}; for ({i} = 0; {i} < {out.text}.n; {i}++) {{")
        self.depth += 1
        if target is maths.each:
            p, arrays = self.value(node.args[1]), [self.value(v) for v in node.args[2].elts]
            function, _ = self.unit.function(f, [p.kind, *(ELEMENTS[v.kind] for v in arrays)])
            given = [p.text] * (p.kind is not None) + [element(v, i) for v in arrays]
            self.element(out, i, f"{function}({', '.join(given)})")
        else:
            key, first = self.value(node.args[1]), self.value(node.args[2])
            function, kind = self.unit.function(f, [key.kind, WORD])
            number = f"{first.text} + (uint64_t)({i} >> 1)"
            self.put(f"const {kind.name} {t} = {function}({key.text}, {number});")
            self.element(out, i, f"{t}.{kind.fields[0][0]}")
            self.put(f"if (++{i} < {out.text}.n) {out.text}.p[{i}] = {t}.{kind.fields[1][0]};")
        self.depth -= 1
        self.put("} }")
        return Value("", None)

    # Statements -----------------------------------------------------------------------
    def put(self, line: str) -> None:
        """Add a line at the present depth."""
        self.lines.append("    " * self.depth + line)

    def inside(self, head: str, nodes: Sequence[Any], first: str = "") -> None:
        """Add a block of statements below a head."""
        self.put(f"{head} {{")
        self.depth += 1
        if first:
            self.put(first)
        for node in nodes:
            self.statement(node)
        self.depth -= 1
        self.put("}")

    def statement(self, node: Any) -> None:
        """Add a statement."""
        if isinstance(node, ast.Expr):
            if not isinstance(node.value, ast.Constant):
                value = self.value(node.value)
                if value.text:
                    self.put(f"{value.text};")
        elif isinstance(node, ast.Assign):
            self.assign(node.targets[0], self.value(node.value))
        elif isinstance(node, ast.AugAssign):
            both = ast.BinOp(
                ast.parse(ast.unparse(node.target), mode="eval").body, node.op, node.value
            )
            self.assign(node.target, self.value(ast.copy_location(both, node)))
        elif isinstance(node, ast.If):
            self.inside(f"if ({self.value(node.test).text})", node.body)
            if node.orelse:
                self.inside("else", node.orelse)
        elif isinstance(node, ast.For):
            self.repeat(node)
        elif isinstance(node, ast.Return):
            of = Value("", NOTHING) if node.value is None else self.value(node.value)
            self.result = of.kind if of.kind is not None else NOTHING
            self.put(f"return {of.text};" if of.text else "return;")
        else:
            raise self.fail(node, f"{type(node).__name__} has no form in C")

    def repeat(self, node: Any) -> None:
        """Add a loop over a range, whose ends are read once."""
        ends = [self.value(v) for v in node.iter.args]
        low, high, by = (
            (literal(0), ends[0], literal(1))
            if len(ends) == 1
            else (*ends, literal(1))
            if len(ends) == 2
            else ends
        )
        if by.number is None:
            raise self.fail(node, "the step of a range must be a number")
        self.fresh += 1
        i, end = f"st_i{self.fresh}", f"st_n{self.fresh}"
        self.kinds.setdefault(node.target.id, WHOLE)
        sign = "<" if by.number > 0 else ">"
        self.put(f"{{ int64_t {i}; const int64_t {end} = {high.text};")
        head = f"for ({i} = {low.text}; {i} {sign} {end}; {i} += {by.text})"
        self.inside(head, node.body, f"{local(node.target.id)} = {i};")
        self.put("}")

    def assign(self, target: Any, of: Value) -> None:
        """Add an assignment to a name, an element, or several of them."""
        if isinstance(target, ast.Tuple):
            if of.kind is None:
                return
            self.fresh += 1
            t = f"st_t{self.fresh}"
            self.put(f"{{ {of.kind.name} {t} = {of.text};")
            names = iter(of.kind.fields)
            for part in target.elts:
                name, kind = next(names)
                self.assign(part, Value(f"{t}.{name}", kind))
            self.put("}")
        elif isinstance(target, ast.Name):
            old = self.kinds.get(target.id, of.kind)
            if old != of.kind:
                if old not in NUMBERS or of.kind not in NUMBERS or WORD in (old, of.kind):
                    raise self.fail(target, f"{target.id} changes its kind")
                if target.id in self.given:
                    raise self.fail(target, f"the argument {target.id} changes its kind")
                self.kinds[target.id] = DOUBLE if DOUBLE in (old, of.kind) else WHOLE
            else:
                self.kinds[target.id] = old
            if of.text:
                self.put(f"{local(target.id)} = {of.text};")
        elif isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            to, one = self.value(target), of.kind in NUMBERS
            text = as_double(of) if one and to.kind == FLOATS else of.text
            self.put(f"{to.kind}_{'fill' if one else 'from'}({to.text}, {text});")
        else:
            self.element(self.value(target.value), self.value(target.slice).text, of.text)

    def element(self, array: Value, index: str, text: str) -> None:
        """Add an assignment to an element of an array."""
        if array.kind == WORDS:
            self.put(f"st_put_word({array.text}, {index}, {text});")
        else:
            self.put(f"{array.text}.p[{index}] = {text};")


def element(array: Value, index: str) -> str:
    """Return an element of an array."""
    return f"st_word({array.text}, {index})" if array.kind == WORDS else f"{array.text}.p[{index}]"


def rest(kind: Kind) -> str:
    """Return the first value of a local variable; C++ warns of none."""
    return " = 0" if kind in NUMBERS else ""


def as_double(v: Value) -> str:
    """Return a value as a double."""
    return (
        v.text
        if v.kind == DOUBLE
        else f"{v.text}.0"
        if v.number is not None
        else f"((double){v.text})"
    )


def widened(v: Value) -> Value:
    """Return a plain number or truth value as a float, as tuples hold them."""
    return Value(as_double(v), DOUBLE) if v.kind == TRUTH or v.number is not None else v
