"""The report of a verification: a table in the terminal, or one HTML page."""

from __future__ import annotations

import html
import io
import math
import os
from dataclasses import dataclass
from typing import Any

from ..analysis.overview import Against, check_place
from ..errors import shown
from ..system import safe_files
from .evidence import Check, Evidence
from .figures import spectra_of
from .page import items, page, some, table_of, verdict
from .power import Shows, certainty

TITLE = 8  # so many parameters that differ from the scene's are in a title
PAGES = (".html", ".htm")  # a page must not take the place of the sound file or its sidecar


@dataclass(frozen=True, repr=False)
class Report:
    """The checks of one verification, and the recording that they are about.

    ``passed`` is True if all checks passed; ``unknown`` names laws that the scene has
    and that are not known here. ``print`` gives a table, ``to_html`` a page.
    """

    checks: list[Check]
    evidence: Evidence

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(c.passed for c in self.checks)

    @property
    def unknown(self) -> list[str]:
        """The laws that the scene names but that are not known here."""
        return self.evidence.unknown

    @property
    def verdict(self) -> str:
        """The result in words."""
        return verdict(self.passed, self.unknown)

    def spectra(self) -> dict[str, Against]:
        """Return the spectra of outputs, of their laws, and the bands of tolerance.

        Outputs without a known law are left out. The result is for
        ``stimlib.analysis.overview``.

        Returns
        -------
        dict of str to Against
            By output.  Of a squeeze the noise before gate and rate, in third octaves;
            else of the output and of its law, and how far apart the limits of the check
            let them be.

        Examples
        --------
        >>> import stimlib
        >>> from stimlib.motion import constant_speed
        >>> scene, motion = stimlib.scenes.bumps(), {"x": constant_speed(0.02, 0.1)}
        >>> spectra = stimlib.verify(
        ...     scene, motion, stimlib.render(scene, motion, fs=8000, seconds=1.0)
        ... ).spectra()
        >>> a = spectra["voltage"]
        >>> bool((a.low <= a.measured).all() and (a.measured <= a.high).all())
        True
        """
        return spectra_of(self.evidence)

    def certainty(self) -> list[Shows]:
        """Return the smallest error that each check would have detected.

        Returns
        -------
        list of Shows
            Of every check of chance with 95 %, and of the parameters in the law of the
            scene.  The law is asked anew some times for each parameter, so it takes
            about as long as the verification.

        Examples
        --------
        >>> import stimlib
        >>> from stimlib.motion import sinusoid
        >>> scene, motion = stimlib.scenes.bumps(), {"x": sinusoid(0.05, 1.0)}
        >>> report = stimlib.verify(
        ...     scene, motion, stimlib.render(scene, motion, fs=8000, seconds=1.0)
        ... )
        >>> for s in report.certainty():
        ...     print(f"{s.kind}: {s.size:.1g} {s.unit}")
        A: 1e-06 of it
        duty: 3e-09 of it
        freq: 1e-09 of it
        """
        return certainty(self.checks, self.evidence)

    def __repr__(self):
        bad = [c.name for c in self.checks if not c.passed]
        return f"Report({self.what()}: {self.verdict}{': ' * bool(bad) + ', '.join(bad)})"

    def __str__(self):
        from rich.console import Console

        out = io.StringIO()
        Console(file=out, width=130, emoji=False).print(self.__rich__())
        return out.getvalue()

    def __rich__(self):
        from rich.table import Column, Table
        from rich.text import Text

        table = Table(
            "",
            "check",
            Column("measured", justify="right"),
            Column("limit", justify="right"),
            "what it compares",
            title=Text(f"{self.what()}: {self.verdict}"),
            title_justify="left",
            caption=f"{sum(c.passed for c in self.checks)} of {len(self.checks)} checks passed",
            caption_justify="left",
        )
        for c in self.checks:
            mark = Text("ok", "green") if c.passed else Text("FAILED", "bold red")
            numbers = f"{c.measured:.3g}", f"{c.limit:.3g}"
            table.add_row(mark, Text(shown(f"({c.group}) {c.name}")), *numbers, Text(shown(c.text)))
        for text in self.evidence.numbers:
            table.add_row("", Text("numbers of the scene"), "", "", Text(shown(text)))
        for text in self.evidence.skipped:
            table.add_row(Text("-", "yellow"), Text("not checked"), "", "", Text(shown(text)))
        return table

    def _repr_html_(self) -> str:
        title = f"<h4>{html.escape(self.what())}: {html.escape(self.verdict)}</h4>"
        return f"{title}{table_of(self.checks)}<p>Not checked</p>{items(self.evidence.skipped)}"

    def what(self) -> str:
        """Return a one-line description of the recording."""
        e = self.evidence
        more = some([f"seed {e.seed}", *e.differences], TITLE)
        return f"{shown(e.source)}, {e.frames / e.fs:g} s at {e.fs:g} Hz, {shown(more)}"

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON data; a number that is not finite is None.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> scene = stimlib.Scene({"y": 2 * stimlib.Input("x")})
        >>> motion = {"x": np.ones(100)}
        >>> rendered = stimlib.render(scene, motion, fs=1000)
        >>> stimlib.verify(scene, motion, rendered).to_dict()["checks"][0]
        {'group': 'b', 'name': 'random cuts, other outputs added', 'passed': True,
         'measured': 0.0, 'limit': 0.0, 'text': ...}
        """
        e = self.evidence

        def row(c: Check) -> dict[str, Any]:
            measured, limit = (
                v if math.isfinite(v) else None for v in (float(c.measured), float(c.limit))
            )
            return {
                "group": c.group,
                "name": c.name,
                "passed": bool(c.passed),
                "measured": measured,
                "limit": limit,
                "text": c.text,
            }

        blocks = [
            {"block": f"{h.block!r}{h.where}", "class": h.kind, "samples": h.samples, "why": h.why}
            | {
                name: v if math.isfinite(v) else None
                for name, v in (("error", h.error), ("smallest", h.least))
            }
            for h in sorted(e.held, key=lambda h: not h.why)
        ]
        return {
            "passed": self.passed,
            "differences": e.differences,
            "unknown": list(self.unknown),
            "source": e.source,
            "fs": e.fs,
            "seconds": e.frames / e.fs,
            "seed": e.seed,
            "scene_hash": e.scene.hash,
            "checks": [row(c) for c in self.checks],
            "numbers": list(e.numbers),
            "skipped": list(e.skipped),
            "blocks": blocks,
        }

    def to_html(self, path: str | os.PathLike, command: str | None = None) -> None:
        """Write one self-contained page with the same bytes for the same evidence.

        It has no scripts and needs no other files.

        Parameters
        ----------
        path : str or Path
        command : str, optional
            The command line that repeats the verification; shown on the page.

        Raises
        ------
        SinkError
            The file cannot be written, or has another suffix than .html or .htm.
        """
        check_place(path, "page", PAGES)
        safe_files.publish(
            path, page(self.what(), self.checks, self.evidence, self.certainty(), command)
        )
