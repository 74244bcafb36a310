"""Translation of steps and tiles to C99, from their checked source.

A step means the same to every target (``stimlib.core.steps``), so a translation needs
the kinds of values and nothing else. These follow from the kinds of parameters and
state, which ``design`` gives, and from those of the signals.
"""

from __future__ import annotations

import ast
import operator
import re
import types
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..core import maths, steps
from ..errors import SceneError
from .values import (
    DOUBLE,
    ELEMENTS,
    FLOATS,
    NOTHING,
    NUMBERS,
    TRUTH,
    WHOLE,
    WORD,
    WORDS,
    Kind,
    Record,
    Value,
    as_double,
    element,
    kind_name,
    literal,
    local,
    part,
    rest,
    widened,
)

OPERATORS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitXor: "^", ast.BitAnd: "&",
    ast.BitOr: "|", ast.LShift: "<<", ast.RShift: ">>", ast.Gt: ">", ast.Lt: "<", ast.GtE: ">=",
    ast.LtE: "<=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
FOLDED = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Mod: operator.mod,
    ast.BitXor: operator.xor, ast.BitAnd: operator.and_, ast.BitOr: operator.or_,
    ast.LShift: operator.lshift, ast.RShift: operator.rshift,
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
    maths.chebyshev: ("st_chebyshev", NOTHING),
    abs: ("fabs", DOUBLE),
}
"""Functions of ``runtime.h``, and the kinds that they return."""
ELEMENTARY = {getattr(maths, name): f for name, f in maths.ELEMENTARY.items() if name[0] != "_"}


class Unit:
    """The functions and types of one C file."""

    def __init__(self, single: bool = False, names: set[str] | None = None) -> None:
        self.single = single
        self.names: set[str] = set() if names is None else names
        # functions of maths.py, which stay in double precision
        self.maths: Unit = self if names is not None else Unit(names=self.names)
        self.types: list[str] = []
        self.functions: list[str] = []
        self.records: dict[Any, Record] = {}
        self.made: dict[Any, tuple[str, Kind]] = {}

    def name(self, wanted: str) -> str:
        """Return a name that is not yet taken in this file."""
        wanted, k = re.sub(r"\W", "_", wanted).strip("_"), 2
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
        if f.__module__ == maths.__name__ and self is not self.maths:
            return self.maths.function(f, kinds)
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


class Translator:
    """One Python function, with known kinds of its arguments, as lines of C."""

    def __init__(self, unit: Unit, f: Any, kinds: Sequence[Kind]) -> None:
        self.unit, self.f, self.known = unit, f, steps.names(f)
        text, self.offset = steps.source(f), f.__code__.co_firstlineno - 1
        self.body: list[Any] = ast.parse(text).body[0].body  # type: ignore[attr-defined]
        names = f.__code__.co_varnames[: f.__code__.co_argcount]
        self.given = dict(zip(names, kinds, strict=True))
        self.counted = counted(self.body) - self.given.keys()
        self.widening = within(self.body)
        self.result: Kind = NOTHING

    def fail(self, node: ast.AST, why: str) -> SceneError:
        """Return the error for a part that C has no form for.

        It shows the place in an author's file, not in the library.
        """
        why = f"{why}, so it cannot be exported"
        if steps.ours(self.f):
            return SceneError(why)
        line = getattr(node, "lineno", 1) + self.offset
        return SceneError(
            f"{self.f.__code__.co_filename}:{line}: {self.f.__qualname__}: {why}:"
            f" {ast.unparse(node)[:80]}"
        )

    def translated(self) -> tuple[list[str], Kind]:
        """Return the lines of the body, and the kind of the result.

        The kind of a variable that is set in a loop or a branch may widen from a whole
        number to a float; then the body is translated once more. Others get a new
        variable of C for each kind.
        """
        kept, before = self.given, dict[str, Kind]()
        while kept != before:
            self.kinds, self.versions = dict(kept), dict[str, str]()
            self.lines: list[str] = []
            self.depth, self.fresh = 1, 0
            for n in self.given:
                if n in self.widening and self.given[n] == WHOLE:
                    name = self.version(n, WHOLE)
                    self.put(f"{local(name)} = {local(n)};")
            for node in self.body:
                self.statement(node)
            loose = {n: k for n, k in self.kinds.items() if n.split(".")[0] in self.widening}
            before, kept = kept, self.given | loose
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
        name = self.versions.get(node.id, node.id)
        if name in self.kinds:
            kind = self.kinds[name]
            return Value("" if kind is None else local(name), kind)
        v = self.known.get(node.id)
        if isinstance(v, (int, float, np.generic)):
            return literal(v)
        raise self.fail(node, f"{node.id} is not a number")

    def _Attribute(self, node: Any) -> Value:
        target = steps._target(node, self.known)
        if isinstance(target, (int, float, np.generic)):
            return literal(target)
        of = self.value(node.value)
        if of.kind in ELEMENTS and node.attr == "size":
            return Value(f"{of.text}.n", WHOLE)
        if not isinstance(of.kind, Record):
            raise self.fail(node, f"{node.attr} has no form in C")
        return Value(f"{of.text}.{local(node.attr)}", dict(of.kind.fields)[local(node.attr)])

    def _Subscript(self, node: Any) -> Value:
        of = self.value(node.value)
        if isinstance(of.kind, Record):
            k = None if isinstance(node.slice, ast.Slice) else self.value(node.slice).number
            if k is None:
                raise self.fail(node, "an index of a tuple must be a number")
            return part(of, k)
        if of.kind not in ELEMENTS:
            raise self.fail(node, "an index of a number has no form in C")
        if isinstance(node.slice, ast.Slice):
            if node.slice.step is not None:
                raise self.fail(node, "a slice with a step has no form in C")
            low = self.value(node.slice.lower).text if node.slice.lower else "0"
            high = self.value(node.slice.upper).text if node.slice.upper else f"{of.text}.n"
            return Value(f"{of.kind}_cut({of.text}, {low}, {high})", of.kind)
        return Value(element(of, self.index(node, of)), ELEMENTS[of.kind])

    def index(self, node: Any, of: Value) -> str:
        """Return the index of an element; those below 0 count from the end."""
        i = self.number(node.slice)
        if i.kind == DOUBLE:
            raise self.fail(node, "an index that is, or becomes, a float has no form in C")
        if i.number is not None and i.number < 0:
            return f"{of.text}.n - {-i.number}"
        plain = i.kind == WORD or self.from_zero(node.slice)
        return i.text if plain else f"st_at({i.text}, {of.text}.n)"

    def from_zero(self, node: Any) -> bool:
        """Return whether a whole number is surely not negative."""
        if isinstance(node, ast.Constant):
            return True
        if isinstance(node, ast.Name):
            return node.id in self.counted
        if isinstance(node, ast.Attribute):
            return node.attr == "size"
        kept = ast.Add | ast.Mult | ast.RShift | ast.Mod
        both = isinstance(node, ast.BinOp) and isinstance(node.op, kept)
        return both and self.from_zero(node.left) and self.from_zero(node.right)

    def below_64(self, node: Any) -> bool:
        """Return whether a whole number is surely 0 to 63: a constant or a mask."""
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd):
            return self.below_64(node.left) or self.below_64(node.right)
        text = re.sub(r"U?INT64_C|u?int64_t|[()]", "", self.value(node).text)
        return text.isdigit() and int(text) < 64

    def number(self, node: Any) -> Value:
        """Return an expression that must be a number."""
        of = self.value(node)
        if of.kind not in NUMBERS:
            raise self.fail(node, "arithmetic with an array or a tuple has no form in C")
        return of

    def _UnaryOp(self, node: Any) -> Value:
        of = self.number(node.operand)
        if of.number is not None:
            return literal(-of.number)
        return Value(f"(-{of.text})", WHOLE if of.kind == TRUTH else of.kind)

    def _BinOp(self, node: Any) -> Value:
        if isinstance(node.op, ast.Pow):  # of plain numbers, in the library's own functions
            return literal(eval(ast.unparse(node), {}))
        a, b, op = self.number(node.left), self.number(node.right), type(node.op)
        sign = OPERATORS.get(op)
        if op is ast.Div:
            return Value(f"({as_double(a)} / {as_double(b)})", DOUBLE)
        if DOUBLE in (a.kind, b.kind):
            if op is ast.Mod:
                return Value(f"st_mod({as_double(a)}, {as_double(b)})", DOUBLE)
            if op not in (ast.Add, ast.Sub, ast.Mult):
                raise self.fail(node, f"{sign} of a float has no form in C")
            return Value(f"({as_double(a)} {sign} {as_double(b)})", DOUBLE)
        if a.number is not None and b.number is not None:
            try:
                return literal(FOLDED[op](a.number, b.number))
            except (ArithmeticError, ValueError) as e:
                raise self.fail(node, str(e)) from e
        kind = WORD if WORD in (a.kind, b.kind) else TRUTH if a.kind == b.kind == TRUTH else WHOLE
        if kind == TRUTH and sign not in ("&", "|", "^"):
            kind = WHOLE
        if op in (ast.LShift, ast.RShift) and not self.below_64(node.right):
            raise self.fail(node, "by 64 or more, << and >> differ between targets; mask with & 63")
        if kind == WORD and any(v.kind == WHOLE and v.number is None for v in (a, b)):
            raise self.fail(node, "a uint64 and a whole number differ between targets")
        if op is ast.Mod:
            if kind == WORD and a.kind != b.kind:
                raise self.fail(
                    node, "% differs between targets; beside a uint64 write np.uint64(7), not 7"
                )
            return Value(
                f"({a.text} % {b.text})" if kind == WORD else f"st_rest({a.text}, {b.text})", kind
            )
        if kind == WORD:  # 1 << u in C is an int
            return Value(f"((uint64_t){a.text} {sign} {b.text})", kind)
        small = any(v.number is not None and abs(v.number) < 2**31 for v in (a, b))
        if op in (ast.Mult, ast.LShift) or (op in (ast.Add, ast.Sub) and not small):
            # so that it wraps
            return Value(f"((int64_t)((uint64_t){a.text} {sign} (uint64_t){b.text}))", kind)
        return Value(f"({a.text} {sign} {b.text})", kind)

    def _Compare(self, node: Any) -> Value:
        if any(type(op) not in OPERATORS for op in node.ops):
            raise self.fail(node, "is and in have no form in C")
        values = [self.number(v) for v in (node.left, *node.comparators)]
        whole = any(v.kind == WHOLE and (v.number is None or v.number < 0) for v in values)
        if whole and any(v.kind == WORD for v in values):
            raise self.fail(node, "a uint64 beside a whole number that may be negative has no form")
        parts = [
            f"({a.text} {OPERATORS[type(op)]} {b.text})"
            for a, op, b in zip(values[:-1], node.ops, values[1:], strict=True)
        ]
        return Value(f"({' && '.join(parts)})" if len(parts) > 1 else parts[0], TRUTH)

    def _BoolOp(self, node: Any) -> Value:
        values = [self.number(v) for v in node.values]
        kinds = {v.kind for v in values}
        if kinds == {TRUTH}:
            sign = " && " if isinstance(node.op, ast.And) else " || "
            return Value(f"({sign.join(v.text for v in values)})", TRUTH)
        if WORD in kinds and len(kinds) > 1:
            raise self.fail(node, "a uint64 or another number has no form in C")
        # of numbers: the last one that was looked at
        kind = DOUBLE if DOUBLE in kinds else WORD if WORD in kinds else WHOLE
        texts = [as_double(v) if kind == DOUBLE else v.text for v in values]
        text = texts.pop()
        for one in reversed(texts):
            ends = (text, one) if isinstance(node.op, ast.And) else (one, text)
            text = f"({one} ? {ends[0]} : {ends[1]})"
        return Value(text, kind)

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
            of = self.value(node.args[0])
            word = "(uint64_t)" * (target is maths.as_float and of.kind == WHOLE)
            return Value(f"((double){word}({of.text}))", DOUBLE)
        if target is maths.each or target is maths.pairs:
            return self.loop(target, node)
        if isinstance(target, type) and hasattr(target, "_fields"):
            if self.unit.single and any(map(counts, node.args)):
                raise self.fail(node, "in float32 a count ends at 2^24 (export in doubles)")
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
            if target is maths.words and self.unit.single:
                raise self.fail(node, "64-bit words take the room of two float32 (use doubles)")
            one = self.number if kind in (DOUBLE, WORD) else self.value
            given = [one(v) for v in node.args]
            if target is abs and given[0].kind != DOUBLE:
                whole = given[0]
                return whole if whole.kind == WORD else Value(f"st_abs({whole.text})", WHOLE)
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
            self.assigned(node.targets, node.value)
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
        name = self.versions.get(node.target.id, node.target.id)
        self.kinds.setdefault(name, WHOLE)
        sign = "<" if by.number > 0 else ">"
        self.put(f"{{ int64_t {i}; const int64_t {end} = {high.text};")
        head = f"for ({i} = {low.text}; {i} {sign} {end}; {i} += {by.text})"
        self.inside(head, node.body, f"{local(name)} = {i};")
        self.put("}")
        for v in node.orelse:  # nothing can break the loop
            self.statement(v)

    def held(self, of: Value) -> Value:
        """Add a constant of a value's own, in a block that is open."""
        if of.kind is None:
            return of
        self.fresh += 1
        self.put(f"const {kind_name(of.kind)} st_t{self.fresh} = {of.text};")
        return Value(f"st_t{self.fresh}", of.kind)

    def assigned(self, targets: Sequence[Any], node: Any) -> None:
        """Add an assignment to one or more targets, of a value that is read once."""
        first = targets[0]
        if len(targets) == 1 and not isinstance(first, ast.Tuple):
            self.assign(first, self.value(node))
            return
        self.put("{")
        pairs = isinstance(node, ast.Tuple) and isinstance(first, ast.Tuple) and len(targets) == 1
        if pairs and len(first.elts) == len(node.elts):
            held = [self.held(self.value(v)) for v in node.elts]
            for target, of in zip(first.elts, held, strict=True):
                self.assign(target, of)
        else:
            of = self.held(self.value(node))
            for target in targets:
                self.assign(target, of)
        self.put("}")

    def version(self, name: str, kind: Kind) -> str:
        """Let a name stand for a new variable from here on; return its key."""
        k = int(self.versions.get(name, ".0").split(".")[1]) + 1
        self.versions[name] = key = f"{name}.{k}"
        self.kinds.setdefault(key, kind)
        return key

    def assign(self, target: Any, of: Value) -> None:
        """Add an assignment to a name, an element, or several of them."""
        if isinstance(target, ast.Tuple):
            if not isinstance(of.kind, Record | None):
                raise self.fail(target, "parts of an array have no form in C")
            for k, v in enumerate(target.elts):
                self.assign(v, part(of, k))
        elif isinstance(target, ast.Name):
            name = self.versions.get(target.id, target.id)
            old = self.kinds.setdefault(name, of.kind)
            if old != of.kind and target.id not in self.widening:
                name = self.version(target.id, of.kind)
            elif old != of.kind:
                if old not in NUMBERS or of.kind not in NUMBERS or WORD in (old, of.kind):
                    raise self.fail(target, f"{target.id} changes its kind")
                self.kinds[name] = DOUBLE if DOUBLE in (old, of.kind) else WHOLE
            if of.text:
                self.put(f"{local(name)} = {of.text};")
        elif isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            to = self.value(target)
            if of.kind not in NUMBERS and of.kind != to.kind:
                raise self.fail(target, "a slice of another kind has no form in C")
            text = as_double(of) if of.kind in NUMBERS and to.kind == FLOATS else of.text
            self.put(f"{to.kind}_fill{'' if of.kind in NUMBERS else '_from'}({to.text}, {text});")
        else:
            array = self.value(target.value)
            self.element(array, self.index(target, array), of.text)

    def element(self, array: Value, index: str, text: str) -> None:
        """Add an assignment to an element of an array."""
        if array.kind == WORDS:
            self.put(f"st_put_word({array.text}, {index}, {text});")
        else:
            self.put(f"{array.text}.p[{index}] = {text};")


def counted(body: Sequence[Any]) -> set[str]:
    """Return the variables that only count upwards, from 0 or a number above."""
    nodes = [n for part in body for n in ast.walk(part)]
    loops: list[Any] = [n for n in nodes if isinstance(n, ast.For)]
    stored = [n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
    found = set()
    for name in {n.target.id for n in loops if isinstance(n.target, ast.Name)}:
        own = [n.iter.args for n in loops if getattr(n.target, "id", "") == name]
        up = all(
            (len(v) < 2 or isinstance(v[0], ast.Constant))
            and (len(v) < 3 or isinstance(v[2], ast.Constant))
            for v in own
        )
        if up and len(own) == stored.count(name):
            found.add(name)
    return found


def counts(node: Any) -> bool:
    """Return whether a new value is one of the state and a constant, as of a clock."""
    plus = isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add)
    return plus and isinstance(node.left, ast.Attribute) and isinstance(node.right, ast.Constant)


def within(body: Sequence[Any]) -> set[str]:
    """Return the variables that are set inside a loop or a branch."""
    nodes = [n for part in body if isinstance(part, ast.For | ast.If) for n in ast.walk(part)]
    return {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
