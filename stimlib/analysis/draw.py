"""Pictures of the block graph that a processor runs.

Blocks go from left to right, with one colour per clock and a shaded box for each
``enabled``.
"""

from __future__ import annotations

import dataclasses as dc
import html
import io
import os
from base64 import b64encode
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from ..core.clocks import PARAMS, ROOT, Instance
from ..core.graph import Input
from ..core.guard import Guard
from ..core.program import Program
from ..errors import BadValue, MissingPackage, public, shown
from ..system import safe_files
from ..system.packages import plain_style
from .layout import (
    LINE,
    MARGIN,
    PAD,
    SMALL,
    STRIP,
    TITLE,
    WIRE,
    Box,
    Layout,
    Level,
    names_of,
    width_of,
)

if TYPE_CHECKING:
    from ..core.scene import Scene
    from ..run.processor import Processor

MOST = 200
"""Largest number of blocks in a readable picture."""

FORMATS = {".svg": {"Date": None}, ".png": {}, ".pdf": {"CreationDate": None}}

ROW = 0.2  # of the legend, inches
INK, PALE = "#26323a", "#6b7a85"
LIVE, SAMPLE = "#fff1c9", "#e3edf7"
ENABLED = ("#d9ecd6", "#f3dcd7", "#e4dcf0", "#d3ebea", "#f1e3c6", "#e6e6d8")


@dc.dataclass(frozen=True)
class Drawing:
    """The picture of a graph, which a notebook displays."""

    svg: str

    def __repr__(self):
        return f"Drawing({len(self.svg)} characters of SVG)"

    def _repr_svg_(self) -> str:
        return self.svg


@overload
def draw(scene: Scene | Processor) -> Drawing: ...
@overload
def draw(scene: Scene | Processor, path: str | os.PathLike[str]) -> None: ...
@public
def draw(scene: Scene | Processor, path: str | os.PathLike[str] | None = None) -> Drawing | None:
    """Draw the graph of a scene or a processor as an SVG, PNG or PDF file.

    The picture shows the program after rewriting: equal parts once, numbers folded, one
    shaded box per ``enabled`` or ``segment``.  A number stands inside the block that
    uses it.  The unit of a signal stands where it leaves its block.  The bytes of the
    file depend on the scene and on the version of matplotlib only.

    Parameters
    ----------
    scene : Scene or Processor
    path : path, optional
        The suffix is the format: .svg, .png or .pdf.

    Returns
    -------
    Drawing or None
        Without a path, the picture: a notebook shows it, and ``svg`` is its text.

    Raises
    ------
    BadValue
        Not a scene, another suffix, or more than 200 blocks: read ``print(proc.plan)``
        instead.
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
        raise BadValue(
            f"draw: the suffix of {Path(path).name!r} must be one of {', '.join(FORMATS)}"
        )
    program = getattr(scene, "program", None)
    if not isinstance(program, Program):
        raise BadValue(
            f"draw: expected a scene or a processor, got {type(scene).__name__} {scene!r}"
        )
    blocks = sum(q.kind == "block" for q in program.instances)
    if blocks > MOST:
        raise BadValue(
            f"draw: {blocks} blocks are more than a picture can show ({MOST}); draw a scene of"
            " fewer outputs, or read the plan instead: print(stimlib.compile(scene, fs).plan), or"
            " stimlib show --plan"
        )
    data = _render(Layout(program), suffix)
    if path is None:
        return Drawing(data.decode())
    safe_files.publish(path, data)
    return None


def html_of(scene: Scene) -> str:
    """Return the HTML of a scene for a notebook: its text and, if possible, its graph.

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
    except (BadValue, MissingPackage) as e:  # too large, no matplotlib
        return f"{text}<p>{html.escape(str(e))}</p>"
    return (
        f'{text}<img alt="the graph"'
        f' src="data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}">'
    )


def _render(layout: Layout, suffix: str) -> bytes:
    """Return a drawn graph as the bytes of an image file."""
    from matplotlib.figure import Figure

    with plain_style(svg_hashsalt="stimlib", font_family=["DejaVu Sans"]):
        width = max(layout.x[-1] + layout.wide[-1] + MARGIN, 3.0)
        figure = Figure(dpi=150)
        axes = figure.add_axes((0, 0, 1, 1))
        axes.axis("off")
        ink = Ink(layout, axes)
        ink.level(layout.top)
        height = ink.legend(layout.top.height + MARGIN + 0.3, width) + MARGIN
        axes.set(xlim=(0, width), ylim=(height, 0))
        figure.set_size_inches(width, height)
        memory = io.BytesIO()
        figure.savefig(memory, format=suffix[1:], metadata=FORMATS[suffix])
    return memory.getvalue()


class Ink:
    """A matplotlib drawing of a graph whose layout is known."""

    def __init__(self, layout: Layout, axes: Any):
        self.layout, self.axes = layout, axes
        self.instances: list[Instance] = layout.program.instances

    def legend(self, y: float, width: float) -> float:
        """Write the clocks in rows of at most a width; return where the last is."""
        x, program = MARGIN, self.layout.program
        for clock, name in [*enumerate(program.clocks)][not program.params :]:
            when = program.runs[clock] if name.startswith("segment") else " while its gate is open"
            word = ("parameters", "every sample", f"{name}: only{when}")[min(clock, 2)]
            wide = 0.27 + width_of(word, SMALL)
            if MARGIN < x > width - wide:
                x, y = MARGIN, y + ROW
            self.rectangle(x, y - 0.07, 0.2, 0.13, _colour(clock), INK, 3)
            self.word(x + 0.27, y, word, SMALL, PALE, "left")
            x += wide + 0.28
        return y

    def level(self, level: Level, ground: str = "white", given: tuple[int, ...] = ()) -> None:
        """Draw all blocks that run on one clock, on a background colour.

        The unit of a signal that leaves the box is written outside the box.
        """
        p = self.layout
        for b in level.boxes:
            if b.inner:
                self.enabled(b)
        for b in level.boxes:
            self.connect(level, b, ground)
        for b in level.boxes:
            if not b.inner:
                self.block(b)
            if b.number not in (*p.program.outputs.values(), *given):
                x, y = p.out(b)
                self.word(x + 0.04, y - 0.055, p.unit(b.number), SMALL, PALE, "left", halo=ground)
        for b in level.boxes:
            if b.inner:
                self.level(b.inner, _colour(b.inner.clock), p.sources(b.number))
                inner = p.sources(b.number)
                if inner and p.box[inner[0]] in b.inner.boxes:
                    self.curve([p.out(p.box[inner[0]]), p.out(b)], head=False)

    def enabled(self, b: Box) -> None:
        """Draw the box of an ``enabled`` subgraph and its contents."""
        assert b.inner
        p, clock = self.layout, b.inner.clock
        left, right = p.x[b.first] - PAD, p.right(b) + PAD
        self.rectangle(left, p.y[b], right - left, b.height, _colour(clock), PALE, 1, ls="--")
        self.word(
            left + 0.1, p.y[b] + STRIP / 2 + 0.01, p.program.clocks[clock], SMALL, INK, "left"
        )

    def block(self, b: Box) -> None:
        """Draw the box of a block."""
        p, q = self.layout, self.instances[b.number]
        lines = p.text(b.number)
        x = p.x[b.first] + (p.wide[b.first] - b.width) / 2
        end = isinstance(q.block, Input | Guard)
        fill = "white" if end or q.clock > ROOT else _colour(q.clock)
        self.rectangle(x, p.y[b], b.width, b.height, fill, INK, 3, lw=1.4 if end else 0.8)
        for j, line in enumerate(lines):
            y = p.y[b] + b.height / 2 + LINE * (j - (len(lines) - 1) / 2)
            self.word(
                x + b.width / 2,
                y,
                line,
                TITLE if j == 0 else SMALL,
                INK if j == 0 else PALE,
                "center",
            )

    def connect(self, level: Level, b: Box, ground: str) -> None:
        """Draw the connections into a box."""
        p = self.layout
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
        names = [n for n, a in zip(names_of(q.block), q.args, strict=True) if a in sources]
        for j, a in enumerate(sources):
            y = p.y[b] + b.height * (j + 1) / (len(sources) + 1)
            self.link(a, (x, y), b.first)
            if ordered:
                self.word(x - 0.09, y - 0.045, names[j], SMALL - 1, PALE, "right", halo=ground)

    def start(self, a: int, column: int) -> tuple[float, float]:
        """Return the point where the last curve to a column begins.

        The point is at the source, or on the wire that extends it.
        """
        p = self.layout
        wire = self.wire(a, column)
        return (
            p.out(p.box[a])
            if wire is None
            else (p.x[column - 1] + p.wide[column - 1], p.y[wire] + WIRE / 2)
        )

    def wire(self, a: int, column: int) -> Box | None:
        """Return the wire that carries a signal on to a column, or None."""
        return self.layout.wires[a] if column > self.layout.box[a].last + 1 else None

    def link(self, a: int, to: tuple[float, float], column: int) -> None:
        """Draw a connection to the left side of a column, or to its right edge.

        A connection to the right edge is the output of an ``enabled``.
        """
        p = self.layout
        box, wire = p.box[a], self.wire(a, column)
        start = p.out(box)
        points = [start, (max(start[0], p.right(box)), start[1])]
        if wire is not None:
            y = p.y[wire] + WIRE / 2
            points += [(p.x[wire.first], y), (p.x[column - 1] + p.wide[column - 1], y)]
        points += [(min(to[0], p.x[column]) if column < len(p.x) else to[0], to[1]), to]
        self.curve(points)

    # Shapes ---------------------------------------------------------------------------
    def curve(self, points: list[tuple[float, float]], head: bool = True) -> None:
        """Draw a connection that bends in the gaps and runs straight across columns."""
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
        self.axes.add_patch(
            PathPatch(Line(at, codes), fill=False, ec=INK, lw=0.8, zorder=2, capstyle="round")
        )
        if head:
            self.axes.add_patch(
                Polygon(
                    [(x, y), (x - 0.07, y - 0.032), (x - 0.07, y + 0.032)],
                    fc=INK,
                    ec="none",
                    zorder=4,
                )
            )

    def rectangle(
        self, x: float, y: float, w: float, h: float, fill: str, edge: str, z: int, **line: Any
    ) -> None:
        """Draw a rounded rectangle."""
        from matplotlib.patches import FancyBboxPatch

        style = f"round,pad=0,rounding_size={min(0.07, h / 2)}"
        line = {"lw": 0.8, **line}
        self.axes.add_patch(
            FancyBboxPatch((x, y), w, h, boxstyle=style, fc=fill, ec=edge, zorder=z, **line)
        )

    def word(
        self, x: float, y: float, text: str, size: float, colour: str, side: str, halo: str = ""
    ) -> None:
        """Write a text, with a halo where it crosses lines."""
        from matplotlib.patheffects import withStroke

        if text:
            effects = [withStroke(linewidth=2, foreground=halo)] if halo else []
            look = {
                "size": size,
                "color": colour,
                "ha": side,
                "va": "center_baseline",
                "path_effects": effects,
            }
            self.axes.text(x, y, text, zorder=5, parse_math=False, **look)


def _colour(clock: int) -> str:
    return (
        LIVE
        if clock == PARAMS
        else SAMPLE
        if clock == ROOT
        else ENABLED[(clock - ROOT - 1) % len(ENABLED)]
    )
