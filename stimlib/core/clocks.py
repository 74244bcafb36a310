"""The instances of a scene's blocks on its clocks, in running order.

A sample of a clock that does not tick is skipped: nothing behind ``enabled``, or
outside its ``segment``, is computed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..system.limits import limits
from .graph import Block, Const, Input, Pick
from .parameter import Param
from .subsystems import Segment, Subsystem

# clocks: parameters, always; the sample clock.  Each enabled and each segment adds one.
PARAMS, ROOT = 0, 1


class Instance(NamedTuple):
    """One block on one clock."""

    kind: str  # block | input | const | open | close | pick
    block: Block
    clock: int
    args: tuple[int, ...]  # instance numbers
    autonomous: bool
    child: int  # the clock that an open or close owns, else -1


class Node(NamedTuple):
    """A block of a scene, and the numbers of its signals."""

    block: Block
    kids: tuple[int, ...]


def count(nodes: list[Node], roots: list[int]) -> float:
    """Return how many instances a layout would have, or more than a limit.

    It only counts them: nested gates double their number.
    """
    reached, todo = set(), list(roots)
    while todo:
        if (n := todo.pop()) not in reached:
            reached.add(n)
            todo += nodes[n].kids
    # children come first
    gated = sorted({nodes[n].kids[0] for n in reached if isinstance(nodes[n].block, Subsystem)})
    # instances on a clock that runs a block, and on all clocks below it
    copy: dict[int, float] = {}
    walked = 0
    for tops in [*([n] for n in gated), roots]:
        seen: set[int] = set()
        size, todo = 0.0, list(tops)
        while todo:
            n = todo.pop()
            b, kids = nodes[n]
            if n in seen or isinstance(b, (Param, Const)):
                continue
            seen.add(n)
            size += 2 + copy[kids[0]] if isinstance(b, Subsystem) else 1
            todo += kids[1:] if isinstance(b, Subsystem) else kids
        copy[tops[0]] = size
        walked += len(seen)
        if walked > limits.scene_blocks:  # every clock is there at least once
            return walked
    return size


class _Clocks(NamedTuple):
    """The clocks of a program: lists with one entry for each clock."""

    parents: list[int]
    names: list[str]
    runs: list[str]
    seeds: list[int | None]
    opened: dict[Any, tuple[int, int]]  # clocks, and the node that opens each

    def below(self, parent: int, b: Block, n: int) -> tuple[int, int]:
        """Return the clock of an enabled or a segment, and the node that opens it."""
        run, seed = (b.run, b.seed) if isinstance(b, Segment) else ("", None)
        which = (run or n, parent)  # segments of one time and seed run together
        if which not in self.opened:
            number = len(self.parents)
            self.names.append(f"{'segment' if run else 'enabled'} {number - ROOT}")
            self.runs.append(self.runs[parent] + run)
            self.seeds.append(self.seeds[parent] if seed is None else seed)
            self.parents.append(parent)
            self.opened[which] = number, n
        return self.opened[which]


_KINDS: dict[type, str] = {Input: "input", Const: "const", Pick: "pick"}


def layout(nodes: list[Node], roots: list[int]):
    """Return instances keyed by (kind, structure, clock), children first."""
    made: dict[tuple[str, int, int], int] = {}
    instances: list[Instance] = []
    clocks = _Clocks([-1, -1], ["params", "root"], ["", ""], [None, None], {})
    todo = [("block", n, ROOT) for n in reversed(roots)]
    while todo:
        key = todo[-1]
        if key in made:
            todo.pop()
            continue
        kind, n, clock = key
        b, kids = nodes[n]
        child = -1
        if isinstance(b, Subsystem):
            child, opener = clocks.below(clock, b, n)
            need = [("open", opener, clock), ("block", kids[0], child)]
            if kind == "open":
                need = [("block", kids[1], clock)]
        else:
            need = [("block", k, clock) for k in kids]
        need = [(k, m, _home(nodes[m].block, c)) for k, m, c in need]
        missing = [q for q in need if q not in made]
        closes = kind == "block" and isinstance(b, Subsystem)
        if missing:
            todo += reversed(missing[:1] if closes else missing)
            continue
        args = tuple(made[q] for q in need)
        kind = "close" if closes else _KINDS.get(type(b), kind)
        autonomous = b.begins_early and all(instances[a].autonomous for a in args)
        made[key] = len(instances)
        instances.append(Instance(kind, b, clock, args, autonomous, child))
        todo.pop()
    for q in instances:  # a gate with a loop behind it begins with that, at sample 0
        if q.kind == "close" and not q.autonomous:
            instances[q.args[0]] = instances[q.args[0]]._replace(autonomous=False)
    return made, instances, clocks


def _home(b: Block, clock: int) -> int:
    """Return the clock of a node; parameters, constants and inputs have their own."""
    if isinstance(b, (Param, Const)):
        return PARAMS
    return ROOT if isinstance(b, Input) else clock
