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
        if (node := todo.pop()) not in reached:
            reached.add(node)
            todo += nodes[node].kids
    # children come first
    gated = sorted(
        {nodes[node].kids[0] for node in reached if isinstance(nodes[node].block, Subsystem)}
    )
    # instances on a clock that runs a block, and on all clocks below it
    copy: dict[int, float] = {}
    walked = 0
    for tops in [*([node] for node in gated), roots]:
        seen: set[int] = set()
        size, todo = 0.0, list(tops)
        while todo:
            node = todo.pop()
            block, kids = nodes[node]
            if node in seen or isinstance(block, (Param, Const)):
                continue
            seen.add(node)
            size += 2 + copy[kids[0]] if isinstance(block, Subsystem) else 1
            todo += kids[1:] if isinstance(block, Subsystem) else kids
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

    def below(self, parent: int, block: Block, node: int) -> tuple[int, int]:
        """Return the clock of an enabled or a segment, and the node that opens it."""
        run, seed = (block.run, block.seed) if isinstance(block, Segment) else ("", None)
        which = (run or node, parent)  # segments of one time and seed run together
        if which not in self.opened:
            number = len(self.parents)
            self.names.append(f"{'segment' if run else 'enabled'} {number - ROOT}")
            self.runs.append(self.runs[parent] + run)
            self.seeds.append(self.seeds[parent] if seed is None else seed)
            self.parents.append(parent)
            self.opened[which] = number, node
        return self.opened[which]


_KINDS: dict[type, str] = {Input: "input", Const: "const", Pick: "pick"}


def layout(nodes: list[Node], roots: list[int]):
    """Return instances keyed by (kind, structure, clock), children first."""
    made: dict[tuple[str, int, int], int] = {}
    instances: list[Instance] = []
    clocks = _Clocks([-1, -1], ["params", "root"], ["", ""], [None, None], {})
    todo = [("block", node, ROOT) for node in reversed(roots)]
    while todo:
        key = todo[-1]
        if key in made:
            todo.pop()
            continue
        kind, node, clock = key
        block, kids = nodes[node]
        child = -1
        if isinstance(block, Subsystem):
            child, opener = clocks.below(clock, block, node)
            need = [("open", opener, clock), ("block", kids[0], child)]
            if kind == "open":
                need = [("block", kids[1], clock)]
        else:
            need = [("block", kid, clock) for kid in kids]
        need = [
            (kid, kid_node, _home(nodes[kid_node].block, its_clock))
            for kid, kid_node, its_clock in need
        ]
        # a stack of our own, not recursion: a chain of blocks may be longer than
        # Python's stack
        missing = [needed for needed in need if needed not in made]
        closes = kind == "block" and isinstance(block, Subsystem)
        if missing:
            # the opening comes alone first: what it runs is laid out behind it
            todo += reversed(missing[:1] if closes else missing)
            continue
        args = tuple(made[needed] for needed in need)
        kind = "close" if closes else _KINDS.get(type(block), kind)
        # as its design has it: a gate with a loop behind it begins at sample 0
        autonomous = block.autonomous and all(instances[argument].autonomous for argument in args)
        made[key] = len(instances)
        instances.append(Instance(kind, block, clock, args, autonomous, child))
        todo.pop()
    return made, instances, clocks


def _home(block: Block, clock: int) -> int:
    """Return the clock of a node; parameters, constants and inputs have their own."""
    if isinstance(block, (Param, Const)):
        return PARAMS
    return ROOT if isinstance(block, Input) else clock
