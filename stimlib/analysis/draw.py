"""A picture of what a processor runs: blocks left to right, one colour per clock, a shaded box for each ``enabled``.

The columns come from the longest path.  Inside, everything is a rectangle over a span of columns: a block takes one, an
``enabled`` box as many as it is deep, and a connection that skips columns is a wire as long as the columns it crosses.
So no line runs across a block, and the curves need only the gaps between columns.
"""

from __future__ import annotations

import dataclasses as dc
import html
import io
import os
from base64 import b64encode
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ..core import regular
from ..core.graph import Add, Const, Guard, Input, Mul, Param, signals
from ..core.program import PARAMS, ROOT, Instance, Program, lower
from ..errors import BadValue, shown

if TYPE_CHECKING:
    from ..core.scene import Scene
    from ..run.processor import Processor

MOST = 200
"""Blocks that fit into a picture; above it nobody can read one."""

FORMATS = {".svg": {"Date": None}, ".png": {}, ".pdf": {"CreationDate": None}}

# inches, points and colours
TITLE, SMALL = 8.0, 6.5
LINE, MARGIN, GAP, SPACE, WIRE, PAD, STRIP = 0.13, 0.25, 0.42, 0.13, 0.16, 0.13, 0.2
INK, PALE = "#26323a", "#6b7a85"
LIVE, SAMPLE = "#fff1c9", "#e3edf7"
ENABLED = ("#d9ecd6", "#f3dcd7", "#e4dcf0", "#d3ebea", "#f1e3c6", "#e6e6d8")


@dc.dataclass(frozen=True)
class Drawing:
    """The picture of a graph; a notebook shows it."""

    svg: str

    def __repr__(self):
        return f"Drawing({len(self.svg)} characters of SVG)"

    def _repr_svg_(self) -> str:
        return self.svg


@overload
def draw(scene: Scene | Processor) -> Drawing: ...
@overload
def draw(scene: Scene | Processor, path: str | os.PathLike[str]) -> None: ...
def draw(scene: Scene | Processor, path: str | os.PathLike[str] | None = None) -> Drawing | None:
    """Draw a scene, or what a processor runs, into an SVG, PNG or PDF file or for a notebook.

    The picture shows the program after rewriting: equal parts once, numbers folded, one shaded box per ``enabled``.  A
    number stands inside the block that uses it.  The unit of a signal stands where it leaves its block.  The bytes of the
    file depend on the scene and on the version of matplotlib only.

    Parameters
    ----------
    scene : Scene or Processor
    path : path, optional
        The suffix says the format: .svg, .png or .pdf.

    Returns
    -------
    Drawing or None
        Without a path, the picture: a notebook shows it, and ``svg`` is its text.

    Raises
    ------
    BadValue
        Not a scene, another suffix, or more than 200 blocks: read ``print(proc.plan)`` instead.
    SinkError
        The file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from stimlib.analysis.draw import draw
    >>> from stimlib.scenes import squeeze
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "squeeze.svg"
    ...     draw(squeeze(), path)
    ...     path.read_text()[:5]
    '<?xml'
    >>> draw(squeeze()).svg[:5]
    '<?xml'
    """
    suffix = ".svg" if path is None else Path(path).suffix.lower()
    if path is not None and suffix not in FORMATS:
        raise BadValue(f"draw: the suffix of {Path(path).name!r} must be one of {', '.join(FORMATS)}")
    if hasattr(scene, "program"):
        program = scene.program
    elif hasattr(scene, "outputs"):
        program = lower(scene.outputs)
    else:
        raise BadValue(f"draw: expected a scene or a processor, got {type(scene).__name__} {scene!r}")
    blocks = sum(q.kind == "block" for q in program.instances)
    if blocks > MOST:
        raise BadValue(
            f"draw: {blocks} blocks are more than a picture can show ({MOST}); "
            "read the plan instead: print(stimlib.compile(scene, fs).plan)"
        )
    data = _render(_Picture(program), suffix)
    if path is None:
        return Drawing(data.decode())
    regular.publish(path, data)
    return None


def html_of(scene: Scene) -> str:
    """What a notebook shows of a scene: its text, and its graph where a picture can show that.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    str
        HTML without scripts.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.analysis.draw import html_of
    >>> html_of(stimlib.Scene({"y": 2 * stimlib.Input("x", "m")}))[:46]
    '<pre>Scene(x [m] -&gt; y [m])</pre><img alt="t'
    """
    text = f"<pre>{html.escape(shown(scene))}</pre>"
    try:
        svg = draw(scene).svg
    except BadValue as e:  # too large
        return f"{text}<p>{html.escape(str(e))}</p>"
    return f'{text}<img alt="the graph" src="data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}">'


# What is drawn -------------------------------------------------------------------------------------------------------
@dc.dataclass(eq=False)
class _Box:
    """A rectangle over the columns first .. last: a block, a wire, or an ``enabled`` with what is in it."""

    number: int  # of the instance; of the close for an enabled; of the source for a wire
    height: float
    width: float = 0.0
    first: int = 0
    last: int = 0
    y: float = 0.0  # of the top, in the box around it
    inner: _Level | None = None

    @property
    def columns(self) -> int:
        return self.last - self.first + 1


@dc.dataclass(eq=False)
class _Level:
    """The boxes of one clock (the top level: of the root and the parameters)."""

    clock: int
    boxes: list[_Box] = dc.field(default_factory=list)
    wires: dict[int, _Box] = dc.field(default_factory=dict)
    columns: int = 1
    height: float = 0.0


class _Picture:
    """Where everything goes, in inches from the top left."""

    def __init__(self, program: Program):
        self.program = program
        self.names = {i: name for name, i in program.outputs.items()}
        self.box: dict[int, _Box] = {}
        self.wires: dict[int, _Box] = {}  # by source
        self.top = self.level(ROOT)
        self.columns(self.top, 0)
        self.pack(self.top)
        self.place()

    def sources(self, i: int) -> tuple[int, ...]:
        """What is connected to an instance (numbers stand inside it)."""
        return self.signals(self.program.instances[i].args)

    def gate(self, box: _Box) -> tuple[int, ...]:
        """What decides whether an enabled runs."""
        return self.signals(self.opened(box).args)

    def opened(self, box: _Box) -> Instance:
        return self.program.instances[self.program.instances[box.number].args[0]]

    def signals(self, args: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(a for a in args if self.program.instances[a].kind not in ("const", "open"))

    # Columns ---------------------------------------------------------------------------------------------------------
    def level(self, clock: int) -> _Level:
        """Boxes of a clock with their sizes, inner ones first."""
        out = _Level(clock)
        for i, q in enumerate(self.program.instances):
            if q.clock != clock and not (clock == ROOT and q.clock == PARAMS) or q.kind in ("const", "open"):
                continue
            if q.kind == "close":
                inner = self.level(self.program.instances[q.args[0]].child)
                self.columns(inner, 0)
                self.pack(inner)
                box = _Box(i, inner.height + STRIP + 2 * PAD, inner=inner)
            else:
                lines = self.text(i)
                width = max(_width(t, TITLE if j == 0 else SMALL) for j, t in enumerate(lines))
                ports = len(self.sources(i)) if self.ordered(i) else 0
                box = _Box(i, max(LINE * len(lines) + 0.11, 0.15 * ports), max(width + 0.16, 0.3))
            self.box[i] = box
            out.boxes.append(box)
        return out

    def columns(self, level: _Level, start: int) -> None:
        """Longest path from the left; what no Input reaches moves right, next to its user."""
        at: dict[_Box, int] = {}
        after: dict[_Box, list[int]] = {}
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

    def shift(self, box: _Box, by: int) -> None:
        box.first, box.last = box.first + by, box.last + by
        for b in [*box.inner.boxes, *box.inner.wires.values()] if box.inner else []:
            self.shift(b, by)

    def needs(self, box: _Box) -> list[tuple[int, int]]:
        """(instance, column) of everything that comes into a box, also of parameters for what is inside."""
        if not box.inner:
            return [(a, box.first) for a in self.sources(box.number)]
        own = {b.number for b in box.inner.boxes}
        return (
            [(a, box.first) for a in self.gate(box)]
            + [(a, c) for b in box.inner.boxes for a, c in self.needs(b) if a not in own]
            + [(a, box.last + 1) for a in self.sources(box.number) if a not in own]
        )

    # Rows ------------------------------------------------------------------------------------------------------------
    def pack(self, level: _Level) -> None:
        """Heights: barycentres, and a skyline that keeps rectangles apart; the best of some rounds."""
        owner = {b.number: b for b in level.boxes}
        ends = [(owner[a], box, column) for box in level.boxes for a, column in self.needs(box) if a in owner]
        far: dict[_Box, int] = {}
        for a, _, column in ends:
            if column > a.last + 1:
                far[a] = max(far.get(a, 0), column - 1)
        level.wires = {a.number: _Box(a.number, WIRE, first=a.last + 1, last=last) for a, last in far.items()}
        self.wires |= level.wires
        links = [(a, level.wires[a.number]) for a in far]
        links += [(level.wires[a.number] if column > a.last + 1 else a, b) for a, b, column in ends]
        boxes = [*level.boxes, *level.wires.values()]
        near: dict[_Box, list[_Box]] = {b: [] for b in boxes}
        for a, b in links:
            near[a].append(b)
            near[b].append(a)
        rank = {b: float(b.number) for b in boxes}
        best, kept = np.inf, {b: 0.0 for b in boxes}
        wish: dict[_Box, float] = {}
        for turn in range(60):
            order = sorted(boxes, key=lambda b: (wish.get(b, 0.0), rank[b]) if wish else (rank[b], 0.0))
            wanted = {b: wish[b] - b.height / 2 for b in boxes} if wish else {b: 0.0 for b in boxes}
            down, up = _skyline(order, wanted, 1.0), _skyline(order[::-1], wanted, -1.0)
            y = {b: (down[b] + up[b]) / 2 for b in boxes}
            cost = sum(abs(y[a] + a.height / 2 - y[b] - b.height / 2) for a, b in links)
            cost += 0.2 * _crossings(links, y)
            cost += 0.3 * (max((y[b] + b.height for b in boxes), default=0.0) - min(y.values(), default=0.0))
            if cost < best - 1e-9:
                best, kept = cost, y
            middle = {b: y[b] + b.height / 2 for b in boxes}
            side = turn % 3  # both, sources, users
            wish = {}
            for b in boxes:
                n = [o for o in near[b] if side == 0 or (o.last < b.first) == (side == 1)] or [b]
                wish[b] = sum(middle[o] for o in n) / len(n)
        low = min(kept.values(), default=0.0)
        for b in boxes:
            b.y = kept[b] - low
        level.height = max((b.y + b.height for b in boxes), default=0.15)

    # Places ----------------------------------------------------------------------------------------------------------
    def place(self) -> None:
        """Columns to x, rows to y."""
        wide, crossed = [0.3] * self.top.columns, [GAP] * (self.top.columns + 1)
        for b in self.box.values():
            if not b.inner:
                wide[b.first] = max(wide[b.first], b.width)
                crossed[b.first + 1] = max(crossed[b.first + 1], GAP + 0.7 * _width(self.unit(b.number), SMALL))
            else:
                crossed[b.first] = max(crossed[b.first], GAP + PAD)
                crossed[b.last + 1] = max(crossed[b.last + 1], GAP + PAD + _width(self.unit(b.number), SMALL))
        self.x = [MARGIN + sum(wide[:c]) + sum(crossed[1 : c + 1]) for c in range(self.top.columns)]
        self.wide = wide
        self.y: dict[_Box, float] = {}
        self._rows(self.top, MARGIN)

    def _rows(self, level: _Level, start: float) -> None:
        for b in [*level.boxes, *level.wires.values()]:
            self.y[b] = start + b.y
            if b.inner:
                self._rows(b.inner, start + b.y + STRIP + PAD)

    def out(self, box: _Box) -> tuple[float, float]:
        """Where a box's signal leaves it."""
        if box.inner:
            return self.right(box) + PAD, self.port(box)
        middle = self.x[box.first] + self.wide[box.first] / 2
        return middle + box.width / 2, self.y[box] + box.height / 2

    def right(self, box: _Box) -> float:
        return self.x[box.last] + self.wide[box.last]

    def port(self, box: _Box) -> float:
        """Height at which an enabled gives its signal out: that of the block inside."""
        assert box.inner
        inner = self.box.get(self.sources(box.number)[0]) if self.sources(box.number) else None
        if inner is not None and inner in box.inner.boxes:
            return self.out(inner)[1]
        return self.y[box] + STRIP + (box.height - STRIP) / 2

    # Words -----------------------------------------------------------------------------------------------------------
    def unit(self, i: int) -> str:
        unit = str(self.program.instances[i].block.dim)
        return "" if unit == "1" else unit

    def text(self, i: int) -> list[str]:
        """Lines in a box: what it is, and its numbers."""
        q = self.program.instances[i]
        b = q.block
        args = [(n, self.program.instances[a].block) for n, a in zip(signals(type(b)), q.args, strict=True)]
        numbers = [_number(n, a) for n, a in args if isinstance(a, Const)]
        if isinstance(b, Guard):
            return [self.names.get(i, "output"), *numbers]
        if isinstance(b, Input):
            return [b.name]
        if isinstance(b, Param):
            return [b.name, f"{b.value:g} {self.unit(i)}".strip()]
        if b.sign:
            if numbers and isinstance(b, Mul | Add):  # the order does not matter, so the field's name does not
                numbers = [n.split(" = ")[1] for n in numbers]
                return [" ".join([b.sign, *numbers])]
            return [b.sign, *numbers]
        fields = [f.name for f in dc.fields(b) if f.name not in signals(type(b)) and not f.name.endswith("unit")]  # type: ignore[arg-type]
        data = [(n, getattr(b, n)) for n in fields]
        lines = numbers + [_field(n, v) for n, v in data if v is not None and v is not False]
        return [type(b).__name__, *lines[:4], *(["\u2026"] if len(lines) > 4 else [])]

    def ordered(self, i: int) -> bool:
        """Whether it matters which signal comes in where."""
        return len(self.sources(i)) > 1 and not isinstance(self.program.instances[i].block, Add | Mul)


def _crossings(links: list[tuple[_Box, _Box]], y: dict[_Box, float]) -> int:
    """Pairs of connections over the same gap that change sides."""
    gaps: dict[int, list[tuple[float, float]]] = {}
    for a, b in links:
        gaps.setdefault(a.last, []).append((y[a] + a.height / 2, y[b] + b.height / 2))
    count = 0
    for ends in gaps.values():
        at = np.array(ends)
        count += int(np.sum((at[:, None, 0] < at[None, :, 0]) & (at[:, None, 1] > at[None, :, 1])))
    return count


def _skyline(order: list[_Box], wanted: dict[_Box, float], way: float) -> dict[_Box, float]:
    """Tops of boxes put down one after the other (way 1) or up (way -1), as near to where they want to be as they can."""
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
    unit = "" if str(b.dim) == "1" else f" {b.dim}"
    return f"{name} = {b.value:g}{unit}"


def _field(name: str, v: Any) -> str:
    if isinstance(v, np.ndarray):
        return f"{name}: {v.size} numbers"
    text = f"{v:g}" if isinstance(v, float) else str(v)
    return f"{name} = {text if len(text) <= 24 else text[:23] + chr(0x2026)}"


@cache
def _width(text: str, size: float) -> float:
    """Inches of a text in the one font that comes with matplotlib."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    return TextPath((0, 0), text, size=size, prop=FontProperties("DejaVu Sans")).get_extents().width / 72 if text else 0.0


# Ink -----------------------------------------------------------------------------------------------------------------
def _render(picture: _Picture, suffix: str) -> bytes:
    """The file's bytes."""
    import matplotlib
    from matplotlib.figure import Figure

    plain = {k: v for k, v in dict.items(matplotlib.rcParamsDefault) if not k.startswith("backend")}
    with matplotlib.rc_context({**plain, "svg.hashsalt": "stimlib", "font.family": ["DejaVu Sans"]}):
        width = max(picture.x[-1] + picture.wide[-1] + MARGIN, 3.0)
        height = picture.top.height + 2 * MARGIN + 0.3
        figure = Figure(figsize=(width, height), dpi=150)
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set(xlim=(0, width), ylim=(height, 0))
        axes.axis("off")
        _Ink(picture, axes).everything(height)
        memory = io.BytesIO()
        figure.savefig(memory, format=suffix[1:], metadata=FORMATS[suffix])
    return memory.getvalue()


class _Ink:
    def __init__(self, picture: _Picture, axes: Any):
        self.picture, self.axes = picture, axes
        self.instances: list[Instance] = picture.program.instances

    def everything(self, height: float) -> None:
        self.level(self.picture.top)
        x = MARGIN
        for clock in range(len(self.picture.program.parents)):
            if clock == PARAMS and not self.picture.program.params:
                continue
            word = ("parameters", "every sample", f"enabled {clock - ROOT}: only while its gate is open")[min(clock, 2)]
            self.rectangle(x, height - MARGIN - 0.07, 0.2, 0.13, _colour(clock), INK, 3)
            self.word(x + 0.27, height - MARGIN, word, SMALL, PALE, "left")
            x += 0.55 + _width(word, SMALL)

    def level(self, level: _Level, ground: str = "white", given: tuple[int, ...] = ()) -> None:
        """Everything on a clock, over a colour; what is given out says its unit outside."""
        p = self.picture
        for b in level.boxes:
            if b.inner:
                self.enabled(b)
        for b in level.boxes:
            self.connect(level, b, ground)
        for b in level.boxes:
            if not b.inner:
                self.block(b)
            if b.number not in p.names and b.number not in given:
                x, y = p.out(b)
                self.word(x + 0.04, y - 0.055, p.unit(b.number), SMALL, PALE, "left", halo=ground)
        for b in level.boxes:
            if b.inner:
                self.level(b.inner, _colour(b.inner.clock), p.sources(b.number))
                inner = p.sources(b.number)
                if inner and p.box[inner[0]] in b.inner.boxes:
                    self.curve([p.out(p.box[inner[0]]), p.out(b)], head=False)

    def enabled(self, b: _Box) -> None:
        assert b.inner
        p, clock = self.picture, b.inner.clock
        left, right = p.x[b.first] - PAD, p.right(b) + PAD
        self.rectangle(left, p.y[b], right - left, b.height, _colour(clock), PALE, 1, ls="--")
        self.word(left + 0.1, p.y[b] + STRIP / 2 + 0.01, f"enabled {clock - ROOT}", SMALL, INK, "left")

    def block(self, b: _Box) -> None:
        p, q = self.picture, self.instances[b.number]
        lines = p.text(b.number)
        x = p.x[b.first] + (p.wide[b.first] - b.width) / 2
        end = isinstance(q.block, Input | Guard)
        fill = "white" if end or q.clock > ROOT else _colour(q.clock)
        self.rectangle(x, p.y[b], b.width, b.height, fill, INK, 3, lw=1.4 if end else 0.8)
        for j, line in enumerate(lines):
            y = p.y[b] + b.height / 2 + LINE * (j - (len(lines) - 1) / 2)
            self.word(x + b.width / 2, y, line, TITLE if j == 0 else SMALL, INK if j == 0 else PALE, "center")

    def connect(self, level: _Level, b: _Box, ground: str) -> None:
        """What comes into a box."""
        p = self.picture
        if b.inner:
            for a in p.gate(b):
                self.link(a, (p.x[b.first] - PAD, p.y[b] + STRIP / 2 + 0.01), b.first)
            for a in p.sources(b.number):
                if p.box[a] not in b.inner.boxes:
                    self.link(a, p.out(b), b.last + 1)
            return
        sources = list(p.sources(b.number))
        ordered = p.ordered(b.number)
        if not ordered:
            sources.sort(key=lambda a: self.start(a, b.first)[1])
        x = p.x[b.first] + (p.wide[b.first] - b.width) / 2
        q = self.instances[b.number]
        names = [n for n, a in zip(signals(type(q.block)), q.args, strict=True) if a in sources]
        for j, a in enumerate(sources):
            y = p.y[b] + b.height * (j + 1) / (len(sources) + 1)
            self.link(a, (x, y), b.first)
            if ordered:
                self.word(x - 0.09, y - 0.045, names[j], SMALL - 1, PALE, "right", halo=ground)

    def start(self, a: int, column: int) -> tuple[float, float]:
        """Where the last curve to a column begins: at the source, or on its wire."""
        p = self.picture
        wire = self.wire(a, column)
        return p.out(p.box[a]) if wire is None else (p.x[column - 1] + p.wide[column - 1], p.y[wire] + WIRE / 2)

    def wire(self, a: int, column: int) -> _Box | None:
        return self.picture.wires[a] if column > self.picture.box[a].last + 1 else None

    def link(self, a: int, to: tuple[float, float], column: int) -> None:
        """A connection to a place at the left of a column, or (an enabled's output) at its right edge."""
        p = self.picture
        box, wire = p.box[a], self.wire(a, column)
        start = p.out(box)
        points = [start, (max(start[0], p.right(box)), start[1])]
        if wire is not None:
            y = p.y[wire] + WIRE / 2
            points += [(p.x[wire.first], y), (p.x[column - 1] + p.wide[column - 1], y)]
        points += [(min(to[0], p.x[column]) if column < len(p.x) else to[0], to[1]), to]
        self.curve(points)

    # Shapes ----------------------------------------------------------------------------------------------------------
    def curve(self, points: list[tuple[float, float]], head: bool = True) -> None:
        """Straight, curved, straight, ..: curves over gaps, straight lines inside columns."""
        from matplotlib.patches import PathPatch, Polygon
        from matplotlib.path import Path as Line

        (x, y), *rest = points
        at, codes = [(x, y)], [Line.MOVETO]
        for j, (u, v) in enumerate(rest):
            if j % 2 == 0:
                at.append((u, v))
                codes.append(Line.LINETO)
            else:
                middle = (x + u) / 2
                at += [(middle, y), (middle, v), (u, v)]
                codes += [Line.CURVE4] * 3
            x, y = u, v
        self.axes.add_patch(PathPatch(Line(at, codes), fill=False, ec=INK, lw=0.8, zorder=2, capstyle="round"))
        if head:
            self.axes.add_patch(Polygon([(x, y), (x - 0.07, y - 0.032), (x - 0.07, y + 0.032)], fc=INK, ec="none", zorder=4))

    def rectangle(self, x: float, y: float, w: float, h: float, fill: str, edge: str, z: int, **line: Any) -> None:
        from matplotlib.patches import FancyBboxPatch

        style = f"round,pad=0,rounding_size={min(0.07, h / 2)}"
        line = {"lw": 0.8, **line}
        self.axes.add_patch(FancyBboxPatch((x, y), w, h, boxstyle=style, fc=fill, ec=edge, zorder=z, **line))

    def word(self, x: float, y: float, text: str, size: float, colour: str, side: str, halo: str = "") -> None:
        from matplotlib.patheffects import withStroke

        if text:
            effects = [withStroke(linewidth=2, foreground=halo)] if halo else []
            look = {"size": size, "color": colour, "ha": side, "va": "center_baseline", "path_effects": effects}
            self.axes.text(x, y, text, zorder=5, parse_math=False, **look)


def _colour(clock: int) -> str:
    return LIVE if clock == PARAMS else SAMPLE if clock == ROOT else ENABLED[(clock - ROOT - 1) % len(ENABLED)]
