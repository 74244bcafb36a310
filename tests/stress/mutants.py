"""Would ``verify`` notice a wrong step or design?  Mutants of each class, in
compositions that no shipped scene is.

``python tests/stress/mutants.py [WORD] > docs/explanation/mutants.csv``: of the classes
that have WORD in their name, twelve of each of ``KINDS`` that change a sample, and
those met before that change none.  What is missed is named on stderr.
"""

from __future__ import annotations

import ast
import copy
import inspect
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from contract import TABLE, Entry, ours

from stimlib import Scene, StimlibError, blocks as b
from stimlib.checks import linear, local, verification
from stimlib.core.graph import kind as kind_of, reach, signals
from stimlib.run.processor import Change
from stimlib.targets.python import Engine

EACH, N, ROUNDING, EXAMPLES = 12, 500, 1e-13, 3
KINDS = "late", "coefficient", "sign", "edge"
OUTCOMES = "caught", "equal", "rounding", "missed"
OTHER: dict[Any, Any] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
}
SIGNALS: dict[str, Callable] = {
    "late": lambda v, last: last,
    "coefficient": lambda v, last: v * 1.001,
    "sign": lambda v, last: -v,
}
FIELDS: dict[str, Callable] = {
    "edge": lambda v: np.roll(v, 1) if np.ndim(v) else v + 1,
    "coefficient": lambda v: v * 1.001 if np.any(v) else v + 1e-3,
    "sign": lambda v: -v,
}


class Mutant(NamedTuple):
    """What stands in the place of a function of a class, of its module, or of the
    interpreter that runs its step.
    """

    kind: str
    text: str
    owner: Any
    name: str
    new: Any


def other(node: ast.AST) -> tuple[str, Any]:
    """What kind of change a part of a text may have, and what it becomes."""
    match node:
        case ast.Constant(value) if type(value) is float:
            return "coefficient", ast.Constant(value * 1.001 if value else 1e-3)
        case ast.Constant(value) if type(value) is int:
            return "edge", ast.Constant(value + 1)
        case ast.Attribute(ast.Name("p"), ctx=ast.Load()):
            return "coefficient", ast.BinOp(node, ast.Mult(), ast.Constant(1.001))
        case ast.BinOp(left, op, right) if type(op) in OTHER:
            return "sign", ast.BinOp(left, OTHER[type(op)](), right)
        case ast.AugAssign(target, op, value) if type(op) in OTHER:
            return "sign", ast.AugAssign(target, OTHER[type(op)](), value)
        case ast.UnaryOp(ast.USub(), operand):
            return "sign", operand
        case ast.Compare(left, [op, *more], right) if type(op) in OTHER:
            return "edge", ast.Compare(left, [OTHER[type(op)](), *more], right)
        case ast.Call(ast.Name("where"), [condition, yes, no]):
            return "edge", ast.Call(node.func, [condition, no, yes], [])
        case ast.Call(f, [x]) if ast.unparse(f) in ("round", "math.floor", "math.ceil"):
            return "edge", ast.Call(f, [ast.BinOp(x, ast.Add(), ast.Constant(1.0))], [])
    return "", None


def functions(cls: type) -> Iterator[tuple[Any, str, Any]]:
    """Where the functions that make a class's samples are: step or tile, design, and
    what these call in their modules.
    """
    todo: list[tuple[Any, str]] = [
        (cls, name) for name in ("step" if cls.step is not None else "tile", "design", "start")
    ]
    seen = set()
    while todo:
        owner, name = todo.pop(0)
        if isinstance(owner, type):
            owner = next((c for c in owner.__mro__ if name in c.__dict__), None)
        f = inspect.getattr_static(owner, name, None)
        f = getattr(f, "__func__", f)
        if (
            not inspect.isfunction(f)
            or f in seen
            or f.__module__ == "stimlib.core.maths"
            or f.__name__ == "lead"
        ):
            continue
        if f.__qualname__.startswith("Block."):
            continue
        seen.add(f)
        yield owner, name, f
        names = [v for v in f.__code__.co_names if inspect.isfunction(f.__globals__.get(v))]
        todo += [
            (sys.modules[f.__module__], v)
            for v in names
            if f.__globals__[v].__module__ == f.__module__
        ]


def texts(cls: type) -> Iterator[Mutant]:
    """One part of the text of a function changed."""
    for owner, name, f in functions(cls):
        tree: Any = ast.parse(textwrap.dedent(inspect.getsource(f)))
        tree.body[0].decorator_list = []
        for k, node in enumerate(ast.walk(tree)):
            kind, part = other(node)
            if kind:
                new = copy.deepcopy(tree)
                at: Any = list(ast.walk(new))[k]
                at.__class__, at.__dict__ = type(part), copy.deepcopy(vars(part))
                made: dict[str, Any] = {}
                exec(
                    compile(ast.fix_missing_locations(new), f"<{name}>", "exec"),
                    f.__globals__,
                    made,
                )
                text = (
                    f"{name}, line {getattr(node, 'lineno', 0)}: {ast.unparse(node)[:60]} ->"
                    f" {ast.unparse(part)[:60]}"
                )
                static = isinstance(inspect.getattr_static(owner, name), staticmethod)
                wrong = made[f.__name__]  # a step may be a function of another name
                yield Mutant(kind, text, owner, name, staticmethod(wrong) if static else wrong)


def wires(cls: type) -> Iterator[Mutant]:
    """The output of a step, or one of its inputs, a sample late, larger, or of the
    other sign.
    """

    def wired(change: Callable, place: int, right: Any = Engine.step) -> Callable:
        def step(self: Any, i: int, x: list) -> Any:
            if type(self.program.instances[i].block) is not cls:
                return right(self, i, x)
            v = np.asarray(x[place] if place >= 0 else right(self, i, x))
            past = vars(self).setdefault("past", {})
            last, past[i] = past.get(i, np.zeros_like(v)), v
            made = change(v, last)[()]
            return right(self, i, [*x[:place], made, *x[place + 1 :]]) if place >= 0 else made

        return step

    for kind, change in SIGNALS.items():
        for place, name in enumerate(("output", *signals(cls)), -1):
            yield Mutant(kind, f"{name}: {kind}", Engine, "step", wired(change, place))


def rows(cls: type) -> Iterator[Mutant]:
    """The same of the row of a class that has no step: what wires the steps."""

    def shown(change: Callable, right: Any = local._seen) -> Callable:
        def seen(run: local.Run, blocks: list, *more: Any) -> tuple:
            parts, whole = right(run, blocks, *more)
            for block in [v for v in blocks if type(v) is cls]:
                row = parts[0].rows[id(block)]
                parts[0].rows[id(block)] = change(
                    row, np.concatenate([0 * row[..., :1], row[..., :-1]], axis=-1)
                )
            return parts, whole

        return seen

    for kind, change in SIGNALS.items():
        yield Mutant(kind, f"row: {kind}", local, "_seen", shown(change))


def fields(cls: type, made: tuple[Any, Any]) -> Iterator[Mutant]:
    """One field of what its design gives, parameters or first state: larger, of the
    other sign, one more, or moved by one.
    """

    def designed(change: Callable, which: int, name: str, right: Any = cls.design) -> Callable:
        def design(self: Any, fs: float) -> tuple:
            both = list(right(self, fs))
            both[which] = both[which]._replace(**{name: change(getattr(both[which], name))})
            return tuple(both)

        return design

    for which, part in enumerate(made):
        for name in getattr(part, "_fields", ()):
            for kind in list(FIELDS)[: 1 if kind_of(getattr(part, name)) in "uU" else None]:
                yield Mutant(
                    kind,
                    f"{'ps'[which]}.{name}: {kind}",
                    cls,
                    "design",
                    designed(FIELDS[kind], which, name),
                )


class World(NamedTuple):
    """A composition that no shipped scene is: an example of a class, heard directly,
    through a lag, and inside a loop.
    """

    scene: Scene
    x: dict[str, np.ndarray]
    fs: float

    def held(self) -> tuple[list[local.Held], np.ndarray]:
        """Its blocks, and what it gives, by the interpreter."""
        params = {name: p.value for name, p in self.scene.params.items()}
        moves = [Change(N // 3, name, 0.9 * v, 0.02) for name, v in params.items()]
        with mock.patch.object(local, "compile", partial(local.compile, target="python")):
            found, (seen,) = local._held(
                local.Run(self.scene.outputs, self.fs, 3, self.x, N, params, moves, [(0, N)])
            )
        # check (e)
        faults = [local.Held(self.scene.outputs["y"], "", N, np.inf if seen.n < N else 0.0)]
        return [*found, *self.responses(), *faults], seen.rows[id(self.scene.outputs["y"])]

    def responses(self) -> Iterator[local.Held]:
        """Check (a2) of ``verify``: the response that a design gives, against what it
        stands for.
        """
        for block in local.outside(self.scene.outputs.values()):
            known = linear.laws_of(block, self.fs) if type(block).transfer is not None else ()
            for law in known:
                error = law.error(
                    partial(
                        verification._response,
                        type(block).transfer,
                        block.design(self.fs)[0],
                        self.fs,
                    ),
                    self.fs,
                )
                yield local.Held(block, "", 0, error / law.tol / (1 + 1e-6))

    def judged(self, m: Mutant, right: np.ndarray) -> str:
        """Whether a mutant is caught, changes no sample or only the last digits, or is
        missed.
        """
        try:
            with mock.patch.object(m.owner, m.name, m.new), np.errstate(all="ignore"):
                found, y = self.held()
        except (
            StimlibError,
            ArithmeticError,
            LookupError,
            TypeError,
            ValueError,
            AssertionError,
            AttributeError,
        ):
            return "stopped"  # a step that does not run displays nothing
        if any(not h.error <= 1 for h in found):
            return "caught"
        if y.shape == right.shape and np.array_equal(y, right):
            return "equal"
        apart = (
            np.abs(y - right).max() / (np.abs(right).max() or 1.0)
            if y.shape == right.shape
            else 1.0
        )
        return f"{'rounding' if apart < ROUNDING else 'missed'}, {apart:.1g} of the largest"


def composed(e: Entry) -> World:
    """The composition of an example."""
    block, fs = e.block(), min(e.rates)
    fed = b.loop(
        lambda last: 0.5 * last + block, unit="" if str(block.dim) == "1" else str(block.dim)
    )
    scene = Scene({"y": block, "fed": fed, "z": b.first_order(block, 0.003)})
    return World(scene, dict(zip(e.inputs, e.x(N, fs, 1), strict=True)), fs)


def sampled(name: str, each: int = EACH, seed: int = 0) -> Iterator[tuple[str, str, str]]:
    """Mutants of a class that run: kind, text, and what came of each in the first
    composition where it changes a sample.
    """
    cls, examples = (
        ours()[name],
        [e for e in TABLE if e.cls == name and e.name not in ("squeeze", "bumps")],
    )
    examples = (
        examples or [e for e in TABLE if name in {type(v).__name__ for v in reach([e.block()])}][:1]
    )
    worlds = [(w, w.held()[1]) for w in map(composed, examples[:EXAMPLES])]
    block = next(v for v in reach(worlds[0][0].scene.outputs.values()) if type(v) is cls)
    has = cls.step is not None or cls.tile is not None
    some = [
        *texts(cls),
        *(wires if has else rows)(cls),
        *fields(cls, block.design(worlds[0][0].fs)),
    ]
    np.random.default_rng([seed, len(some)]).shuffle(some)  # type: ignore[arg-type]
    left = dict.fromkeys(KINDS, each)
    for m in some:
        if left[m.kind]:
            outcomes = (w.judged(m, right) for w, right in worlds)
            said = next((v for v in outcomes if v != "equal"), "equal")
            left[m.kind] -= said.startswith(("caught", "missed"))
            if said != "stopped":
                yield m.kind, m.text, said


def main(word: str = "") -> None:
    print("class", *KINDS, *OUTCOMES, sep=",")
    total: Counter[str] = Counter()
    for name in [c for c in ours() if word in c]:
        count: Counter[str] = Counter()
        for kind, text, said in sampled(name):
            what = said.split(",")[0]
            count.update([what] + [kind] * (what in ("caught", "missed")))
            if what in ("rounding", "missed"):
                print(f"{name}, {text}: {said}", file=sys.stderr, flush=True)
        print(name, *(count[k] for k in (*KINDS, *OUTCOMES)), sep=",", flush=True)
        total += count
    print("all", *(total[k] for k in (*KINDS, *OUTCOMES)), sep=",")


if __name__ == "__main__":
    main(*sys.argv[1:])
