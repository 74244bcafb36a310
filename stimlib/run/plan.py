"""The plan of a processor: what it runs, as a table for people."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import NamedTuple

from ..core.program import Program
from ..errors import counted, shown


class PlanRow(NamedTuple):
    """One line of a plan."""

    number: int
    kind: str
    block: str
    clock: str
    args: tuple[int, ...]
    autonomous: bool
    segment: str


class Plan(NamedTuple):
    """The blocks that a processor runs, in order, and those that rewriting removed."""

    rows: list[PlanRow]
    removed: list[str]
    fs: float

    def __str__(self):
        clock = max(len(r.clock) for r in self.rows)
        lines = [
            f"{counted(len(self.rows), 'row')} at {self.fs:g} Hz (* = runs without input,"
            " also before"
            " sample 0)"
        ]
        for r in self.rows:
            text = r.block if r.kind in ("block", "input", "const") else f"{r.kind} {r.block}"
            args = ", ".join(map(str, r.args))
            mark = "*" if r.autonomous else " "
            lines.append(
                f"{r.number:4d} {mark} {r.clock:{clock}s}  {text}{'  <- ' if args else ''}{args}"
            )
        return "\n".join(lines + [f"removed: {t}" for t in self.removed])

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(shown(self))}</pre>"


def plan_of(program: Program, fs: float, segments: Sequence[str] = ()) -> Plan:
    """Return the plan of a program; segments are the names of its compiled code."""
    names, segments = program.clocks, segments or [""] * len(program.instances)
    rows = [
        PlanRow(i, q.kind, repr(q.block), names[q.clock], q.args, q.autonomous, segments[i])
        for i, q in enumerate(program.instances)
    ]
    return Plan(rows, program.removed, fs)
