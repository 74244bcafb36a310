"""Layout of the picture of a graph: columns, rows, wires and texts, in inches.

The columns come from the longest path.  Inside, everything is a rectangle over a span
of columns: a block takes one, an ``enabled`` box as many as it is deep, and a
connection that skips columns is a wire as long as the columns it crosses. So no line
runs across a block, and the curves need only the gaps between columns.
"""

from __future__ import annotations

import dataclasses as dc
from functools import cache
from typing import Any

import numpy as np

from ..core.clocks import PARAMS, ROOT
from ..core.graph import Add, Block, Const, Input, Mul, Pick, signals
from ..core.guard import Guard
from ..core.loop_code import Cycle
from ..core.parameter import Param
from ..core.program import Program
from ..core.units import ONE
from ..system.packages import package

# inches and points
ROUNDS = 20  # in which boxes move; more change little
TITLE, SMALL = 8.0, 6.5
LINE, MARGIN, GAP, SPACE, WIRE, PAD, STRIP = 0.13, 0.25, 0.42, 0.13, 0.16, 0.13, 0.2


@dc.dataclass(eq=False)
class Box:
    """A rectangle over columns: a block, a wire, or a whole ``enabled``."""

    number: int  # of the instance; of the close for an enabled; of the source for a wire
    height: float
    width: float = 0.0
    first: int = 0
    last: int = 0
    y: float = 0.0  # of the top, in the box around it
    inner: Level | None = None

    @property
    def columns(self) -> int:
        """Return the number of columns."""
        return self.last - self.first + 1


@dc.dataclass(eq=False)
class Level:
    """The boxes of one clock; the top level also holds the parameters."""

    clock: int
    boxes: list[Box] = dc.field(default_factory=list)
    wires: dict[int, Box] = dc.field(default_factory=dict)
    columns: int = 1
    height: float = 0.0


class Layout:
    """The layout of a graph's picture, in inches from the top left."""

    def __init__(self, program: Program):
        self.program = program
        # of several outputs of a clock, the first has its box
        closes = [(i, q.args[0]) for i, q in enumerate(program.instances) if q.kind == "close"]
        first = {gate: i for i, gate in reversed(closes)}
        self.shut = {i: first[gate] for i, gate in closes}
        self.box: dict[int, Box] = {}
        self.wires: dict[int, Box] = {}  # by source
        self.top = self.level(ROOT)
        self.columns(self.top, 0)
        self.pack(self.top)
        self.place()

    def sources(self, i: int) -> tuple[int, ...]:
        """Return the instances connected to an instance, except numbers in its box."""
        return (
            self.signals(self.program.instances[i].args)
            if self.shut.get(i, i) == i
            else (self.shut[i],)
        )

    def gate(self, box: Box) -> tuple[int, ...]:
        """Return the signals that decide whether an ``enabled`` runs."""
        instances = self.program.instances
        return self.signals(instances[instances[box.number].args[0]].args)

    def signals(self, args: tuple[int, ...]) -> tuple[int, ...]:
        """Return those arguments that are drawn as connections."""
        return tuple(a for a in args if self.program.instances[a].kind not in ("const", "open"))

    # Columns --------------------------------------------------------------------------
    def level(self, clock: int) -> Level:
        """Return the boxes of a clock with their sizes, nested boxes first."""
        out = Level(clock)
        for i, q in enumerate(self.program.instances):
            if (
                q.clock != clock
                and not (clock == ROOT and q.clock == PARAMS)
                or q.kind in ("const", "open")
            ):
                continue
            if self.shut.get(i) == i:
                inner = self.level(self.program.instances[q.args[0]].child)
                self.columns(inner, 0)
                self.pack(inner)
                box = Box(i, inner.height + STRIP + 2 * PAD, inner=inner)
            else:
                lines = self.text(i)
                width = max(width_of(t, TITLE if j == 0 else SMALL) for j, t in enumerate(lines))
                ports = len(self.sources(i)) if self.ordered(i) else 0
                box = Box(i, max(LINE * len(lines) + 0.11, 0.15 * ports), max(width + 0.16, 0.3))
            self.box[i] = box
            out.boxes.append(box)
        return out

    def columns(self, level: Level, start: int) -> None:
        """Place each instance in a column by its longest path from the left.

        An instance that depends on no input moves right, next to the block that uses
        it.
        """
        at: dict[Box, int] = {}
        after: dict[Box, list[int]] = {}
        owner = {b.number: b for b in level.boxes}
        for box in level.boxes:
            box.last = box.first + (box.inner.columns - 1 if box.inner else 0)
            needs = self.gate(box) if box.inner else self.sources(box.number)
            at[box] = max((at[owner[a]] + owner[a].columns for a in needs if a in owner), default=0)
        for box in reversed(level.boxes):
            if self.program.instances[box.number].autonomous and box in after:
                at[box] = min(after[box]) - box.columns
            for a, column in self.needs(box):
                if a in owner:
                    after.setdefault(owner[a], []).append(at[box] + column - box.first)
        level.columns = max((at[b] + b.columns for b in level.boxes), default=1)
        for box in level.boxes:
            last = isinstance(self.program.instances[box.number].block, Guard)
            self.shift(box, start - box.first + (level.columns - 1 if last else at[box]))

    def shift(self, box: Box, by: int) -> None:
        """Shift a box and its contents by a number of columns."""
        box.first, box.last = box.first + by, box.last + by
        for b in [*box.inner.boxes, *box.inner.wires.values()] if box.inner else []:
            self.shift(b, by)

    def needs(self, box: Box) -> list[tuple[int, int]]:
        """Return (instance, column) for every signal that enters a box.

        Parameters of the blocks inside are included.
        """
        if not box.inner:
            return [(a, box.first) for a in self.sources(box.number)]
        own = {b.number for b in box.inner.boxes}
        return (
            [(a, box.first) for a in self.gate(box)]
            + [(a, c) for b in box.inner.boxes for a, c in self.needs(b) if a not in own]
            + [(a, box.last + 1) for a in self.sources(box.number) if a not in own]
        )

    # Rows -----------------------------------------------------------------------------
    def pack(self, level: Level) -> None:
        """Choose the heights of boxes so that links are short and no boxes overlap.

        Boxes move to the barycentre of their neighbours and themselves, and are kept
        apart by a skyline.
        """
        links = self._links(level)
        boxes = [*level.boxes, *level.wires.values()]
        near = {b: [b] for b in boxes}  # itself, or two that pull each other swing for ever
        for a, b in links:
            near[a].append(b)
            near[b].append(a)
        wish, y = dict.fromkeys(boxes, 0.0), dict.fromkeys(boxes, 0.0)
        for _ in range(ROUNDS):
            order = sorted(boxes, key=lambda b: (wish[b], b.number))
            wanted = {b: wish[b] - b.height / 2 for b in boxes}
            down, up = _skyline(order, wanted, 1.0), _skyline(order[::-1], wanted, -1.0)
            y = {b: (down[b] + up[b]) / 2 for b in boxes}
            wish = {b: sum(y[o] + o.height / 2 for o in near[b]) / len(near[b]) for b in boxes}
        low = min(y.values(), default=0.0)
        for b in boxes:
            b.y = y[b] - low
        level.height = max((b.y + b.height for b in boxes), default=0.15)

    def _links(self, level: Level) -> list[tuple[Box, Box]]:
        """Assign wires to a level, and return the pairs of boxes that are connected."""
        owner = {b.number: b for b in level.boxes}
        ends = [
            (owner[a], box, column)
            for box in level.boxes
            for a, column in self.needs(box)
            if a in owner
        ]
        far: dict[Box, int] = {}
        for a, _, column in ends:
            if column > a.last + 1:
                far[a] = max(far.get(a, 0), column - 1)
        level.wires = {
            a.number: Box(a.number, WIRE, first=a.last + 1, last=last) for a, last in far.items()
        }
        self.wires |= level.wires
        links = [(a, level.wires[a.number]) for a in far]
        links += [(level.wires[a.number] if column > a.last + 1 else a, b) for a, b, column in ends]
        return links

    # Places ---------------------------------------------------------------------------
    def place(self) -> None:
        """Convert the columns and rows of boxes into positions x and y."""
        wide, crossed = [0.3] * self.top.columns, [GAP] * (self.top.columns + 1)
        for b in self.box.values():
            if not b.inner:
                wide[b.first] = max(wide[b.first], b.width)
                crossed[b.first + 1] = max(
                    crossed[b.first + 1], GAP + 0.7 * width_of(self.unit(b.number), SMALL)
                )
            else:
                crossed[b.first] = max(crossed[b.first], GAP + PAD)
                crossed[b.last + 1] = max(
                    crossed[b.last + 1], GAP + PAD + width_of(self.unit(b.number), SMALL)
                )
        self.x = [MARGIN + sum(wide[:c]) + sum(crossed[1 : c + 1]) for c in range(self.top.columns)]
        self.wide = wide
        self.y: dict[Box, float] = {}
        self._rows(self.top, MARGIN)

    def _rows(self, level: Level, start: float) -> None:
        for b in [*level.boxes, *level.wires.values()]:
            self.y[b] = start + b.y
            if b.inner:
                self._rows(b.inner, start + b.y + STRIP + PAD)

    def out(self, box: Box) -> tuple[float, float]:
        """Return the point at which a box's signal leaves it."""
        if box.inner:
            return self.right(box) + PAD, self.port(box)
        middle = self.x[box.first] + self.wide[box.first] / 2
        return middle + box.width / 2, self.y[box] + box.height / 2

    def right(self, box: Box) -> float:
        """Return the right edge of a box."""
        return self.x[box.last] + self.wide[box.last]

    def port(self, box: Box) -> float:
        """Return the height at which the output of an ``enabled`` leaves its box.

        It is the height of the output block inside.
        """
        assert box.inner
        inner = self.box.get(self.sources(box.number)[0]) if self.sources(box.number) else None
        if inner is not None and inner in box.inner.boxes:
            return self.out(inner)[1]
        return self.y[box] + STRIP + (box.height - STRIP) / 2

    # Words ----------------------------------------------------------------------------
    def unit(self, i: int) -> str:
        """Return the unit of an instance as text."""
        b = self.program.instances[i].block
        return "" if b.outputs or b.dim == ONE else f"{b.dim}"

    def text(self, i: int) -> list[str]:
        """Return the lines of text in a box: its name and its numbers."""
        q = self.program.instances[i]
        b = q.block
        if isinstance(b, Input):
            return [b.name]
        if isinstance(b, Pick):
            return [b.output]
        if isinstance(b, Cycle):
            kinds = [m.sign or type(m).__name__ for m in b.members]
            return ["loop", " ".join(kinds[:6]) + " \u2026" * (len(kinds) > 6)]
        if isinstance(b, Param):
            return [b.name, f"{b.value:g} {self.unit(i)}".strip()]
        given = [self.program.instances[arg].block for arg in q.args]
        named = zip(names_of(b), given, strict=True)
        numbers = [_number(name, arg) for name, arg in named if isinstance(arg, Const)]
        if isinstance(b, Guard):  # equal outputs are one block
            equal = [name for name, at in self.program.outputs.items() if at == i]
            more = f" and {len(equal) - 3} more" * (len(equal) > 3)
            return [" = ".join(equal[:3]) + more or "output", *numbers]
        if b.sign:
            # the order does not matter, so the field's name does not
            if numbers and isinstance(b, Mul | Add):
                numbers = [n.split(" = ")[1] for n in numbers]
                return [" ".join([b.sign, *numbers])]
            return [b.sign, *numbers]
        fields = {f.name: getattr(b, f.name) for f in dc.fields(b)}  # type: ignore[arg-type]
        lines = numbers + [
            _field(name, v)
            for name, v in fields.items()
            if name not in signals(type(b)) and not name.endswith("unit")
            if v is not None and v is not False
        ]
        return [type(b).__name__, *lines[:4], *(["\u2026"] * (len(lines) > 4))]

    def ordered(self, i: int) -> bool:
        """Return whether the order of a block's inputs matters."""
        return len(self.sources(i)) > 1 and not isinstance(
            self.program.instances[i].block, Add | Mul
        )


def names_of(b: Block) -> tuple[str, ...]:
    """Return the names of a block's input signals."""
    return tuple(f"x{j}" for j in range(b.inputs)) if isinstance(b, Cycle) else signals(type(b))


def _skyline(order: list[Box], wanted: dict[Box, float], way: float) -> dict[Box, float]:
    """Return the top edges of boxes that are stacked one after the other.

    Boxes are stacked downwards (way 1) or upwards (way -1), each as near as possible to
    its desired height.
    """
    edge: dict[int, float] = {}
    y = {}
    for b in order:
        columns = range(b.first, b.last + 1)
        start = wanted[b] if way > 0 else -(wanted[b] + b.height)
        top = max([start, *(edge[c] for c in columns if c in edge)])
        for c in columns:
            edge[c] = top + b.height + SPACE
        y[b] = top if way > 0 else -top - b.height
    return y


def _number(name: str, b: Any) -> str:
    unit = "" if b.dim == ONE else f" {b.dim}"
    return f"{name} = {b.value:g}{unit}"


def _field(name: str, v: Any) -> str:
    if isinstance(v, np.ndarray):
        return f"{name}: {v.size} numbers"
    text = f"{v:g}" if isinstance(v, float) else str(v)
    return f"{name} = {text if len(text) <= 24 else text[:23] + chr(0x2026)}"


@cache
def width_of(text: str, size: float) -> float:
    """Return the width of a text in inches, in matplotlib's default font."""
    FontProperties = package("matplotlib.font_manager", "a picture of a graph").FontProperties
    from matplotlib.textpath import TextPath

    return (
        TextPath((0, 0), text, size=size, prop=FontProperties("DejaVu Sans")).get_extents().width
        / 72
        if text
        else 0.0
    )
