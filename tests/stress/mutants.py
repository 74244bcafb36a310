"""Would ``verify`` notice a wrong step or design?  Five changes of the text of each
class, in compositions that no scene is.

``python tests/stress/mutants.py [WORD]``: a constant or number 1e-3 larger, a sum for a
difference, a sign, a comparison that takes the edge along, two sides exchanged, one
more sample; of the classes that have WORD in their name.
"""

from __future__ import annotations

import ast
import copy
import inspect
import sys
import textwrap
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from contract import TABLE, ours

from stimlib import Scene, StimlibError
from stimlib import blocks as b
from stimlib.checks import local, verify
from stimlib.core.graph import reach

EACH, N, ROUNDING = 5, 500, 1e-13
OTHER = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
}


class Mutant(NamedTuple):
    """One change of a function, of a class or of the module that has it."""

    owner: Any
    name: str
    tree: ast.Module
    text: str


def changes(tree: ast.Module) -> Iterator[tuple[str, ast.Module]]:
    """The same text with one thing changed, and what that is."""
    for k, node in enumerate(ast.walk(tree)):
        new = copy.deepcopy(tree)
        at: Any = list(ast.walk(new))[k]
        if isinstance(node, ast.Constant) and type(node.value) is float:
            at.value = node.value * 1.001 if node.value else 1e-3
        elif isinstance(node, ast.Constant) and type(node.value) is int:
            at.value = node.value + 1
        # of a step
        elif (
            isinstance(node, ast.Return)
            and isinstance(node.value, ast.Tuple)
            and len(node.value.elts) == 2
        ):
            at.value.elts[0] = ast.BinOp(at.value.elts[0], ast.Mult(), ast.Constant(1.001))
        elif isinstance(node, ast.BinOp) and type(node.op) in OTHER:
            at.op = OTHER[type(node.op)]()
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER:
            at.ops[0] = OTHER[type(node.ops[0])]()
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            at.op = ast.UAdd()
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "where":
            at.args[1:] = at.args[:0:-1]
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in (
            "round",
            "math.floor",
            "math.ceil",
        ):
            at.args[0] = ast.BinOp(at.args[0], ast.Add(), ast.Constant(1.0))
        elif (
            isinstance(node, ast.Attribute)
            and ast.unparse(node.value) == "p"
            and isinstance(node.ctx, ast.Load)
        ):
            for parent in ast.walk(new):
                for field, v in ast.iter_fields(parent):
                    if v is at and isinstance(
                        parent, ast.BinOp | ast.keyword | ast.Return | ast.Assign
                    ):
                        setattr(parent, field, ast.BinOp(at, ast.Mult(), ast.Constant(1.001)))
        else:
            continue
        ast.fix_missing_locations(new)
        if ast.unparse(new) != ast.unparse(tree):
            yield (
                (
                    f"line {getattr(node, 'lineno', 0)}: {ast.unparse(node)[:60]} ->"
                    f" {ast.unparse(at)[:60]}"
                ),
                new,
            )


def functions(cls: type) -> Iterator[tuple[Any, str, Any]]:
    """Where the functions that make a class's samples are: step or tile, design, and
    what these call in their modules.
    """
    todo = [(cls, name) for name in ("step" if cls.step is not None else "tile", "design", "start")]
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
            or f.__qualname__.startswith("Block.")
            or f.__name__ == "lead"
        ):
            continue
        seen.add(f)
        yield owner, name, f
        names = [v for v in f.__code__.co_names if inspect.isfunction(f.__globals__.get(v))]
        todo += [
            (sys.modules[f.__globals__[v].__module__], v)
            for v in names
            if f.__globals__[v].__module__ == f.__module__
        ]


def mutants(cls: type) -> list[Mutant]:
    """All changes of a class."""
    found = []
    for owner, name, f in functions(cls):
        tree = ast.parse(textwrap.dedent(inspect.getsource(f)))
        tree.body[0].decorator_list = [
            d for d in tree.body[0].decorator_list if ast.unparse(d) != "staticmethod"
        ]  # type: ignore[attr-defined]
        if not tree.body[0].decorator_list:  # type: ignore[attr-defined]
            found += [
                Mutant(owner, name, new, f"{cls.__name__}, {name}, {text}")
                for text, new in changes(tree)
            ]
    return found


@contextmanager
def mutated(m: Mutant | None) -> Iterator[None]:
    """A world in which it is so, run by the interpreter."""
    compiled, local.compile = local.compile, partial(local.compile, target="python")  # type: ignore[assignment]
    old = inspect.getattr_static(m.owner, m.name) if m else None
    try:
        if m:
            f = getattr(old, "__func__", old)
            made: dict[str, Any] = {}
            exec(compile(m.tree, f"<{m.text}>", "exec"), f.__globals__, made)
            setattr(
                m.owner,
                m.name,
                staticmethod(made[m.name]) if isinstance(old, staticmethod) else made[m.name],
            )
        yield
    finally:
        local.compile = compiled
        if m:
            setattr(m.owner, m.name, old)


def composed(cls: str) -> tuple[Scene, dict[str, np.ndarray], float]:
    """A composition that no shipped scene is: an example of a class, heard directly,
    through a lag, and inside a loop.
    """
    plain = [e for e in TABLE if e.cls == cls and e.name not in ("squeeze", "bumps")]
    e = min(
        plain or [e for e in TABLE if cls in {type(v).__name__ for v in reach([e.block()])}],
        key=lambda e: min(e.rates),
    )
    fs = min(e.rates)
    block = e.block()
    fed = b.loop(
        lambda last: 0.5 * last + block, unit="" if str(block.dim) == "1" else str(block.dim)
    )
    return (
        Scene({"y": block, "fed": fed, "z": b.first_order(block, 0.003)}),
        dict(zip(e.inputs, e.x(N, fs, 1), strict=True)),
        fs,
    )


def held(cls: str) -> tuple[list[local.Held], np.ndarray]:
    """The blocks of its composition, and what it gives."""
    scene, x, fs = composed(cls)
    params = {name: p.value for name, p in scene.params.items()}
    seen = local._held(local.Run(scene, fs, 3, x, N, params, [], [(0, N)]))
    # check (e)
    faults = [local.Held(scene.outputs["y"], "", N, np.inf if seen[1][0].n < N else 0.0)]
    return [*seen[0], *responses(scene, fs), *faults], seen[1][0].rows[id(scene.outputs["y"])]


def responses(scene: Scene, fs: float) -> Iterator[local.Held]:
    """Check (a2) of ``verify``: the response that a design gives, against what it
    stands for.
    """
    for block in local.outside(scene.outputs.values()):
        for law in block.laws(fs) if type(block).transfer is not None else ():
            error = law.error(
                partial(verify._response, type(block).transfer, block.design(fs)[0], fs), fs
            )
            yield local.Held(block, "", 0, error / law.tol / (1 + 1e-6))


def judged(cls: str, m: Mutant, right: np.ndarray) -> str:
    """Whether it is caught, changes no sample or only the last digits, or is missed."""
    try:
        with mutated(m), np.errstate(all="ignore"):
            found, y = held(cls)
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
        np.abs(y - right).max() / (np.abs(right).max() or 1.0) if y.shape == right.shape else 1.0
    )
    return "rounding" if apart < ROUNDING else f"missed, {apart:.1g} of the largest"


def sampled(cls: str, each: int = EACH, seed: int = 0) -> Iterator[tuple[str, str]]:
    """So many mutants of a class that run, and what came of them."""
    with mutated(None):
        _, right = held(cls)
    some = mutants(ours()[cls])
    np.random.default_rng([seed, len(some)]).shuffle(some)  # type: ignore[arg-type]
    for m in some:
        if each and (said := judged(cls, m, right)) not in ("stopped",):
            yield m.text, said
            each -= said not in ("equal", "rounding")


CLASSES = [name for name, c in ours().items() if c.step is not None or c.tile is not None]


def main(word: str = "") -> None:
    said: Counter[str] = Counter()
    for cls in CLASSES:
        if word in cls:
            for text, what in sampled(cls):
                said[what.split(",")[0]] += 1
                if what.startswith("missed"):
                    print(f"{text}: {what}", flush=True)
            print(cls, dict(said), file=sys.stderr, flush=True)
    print(dict(said))


if __name__ == "__main__":
    main(*sys.argv[1:])
