"""What a verification says: a table in the terminal, or one self-contained page."""

from __future__ import annotations

import html
import io
import math
import os
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.picture import Against, Row, Signals, close_by, curve, heights, over_time, rows_of
from ..core import regular
from ..errors import shown

if TYPE_CHECKING:
    from .evidence import Check, Evidence, Tap

GROUPS = {
    "a1": "compiled impulse responses",
    "a2": "physical laws of the blocks",
    "b": "the same samples again",
    "c": "noise",
    "d": "force law",
    "e": "limits and gates",
}


@dataclass(frozen=True, repr=False)
class Report:
    """Every check of one verification, and what it was about.

    ``passed`` is True when all checks held.  ``print`` gives a table, ``to_html`` a page.
    """

    checks: list[Check]
    evidence: Evidence

    @property
    def passed(self) -> bool:
        """Whether every check held."""
        return all(c.passed for c in self.checks)

    def spectra(self) -> dict[str, Against]:
        """Spectra of the outputs whose law is known, with it and the band around it: for ``stimlib.analysis.picture``.

        Returns
        -------
        dict of str to Against
            By output.  Of a squeeze the noise before gate and rate, in third octaves; else of the output and of its law, and how
            far apart the limits of the check let them be.

        Examples
        --------
        >>> import stimlib
        >>> from stimlib.motion.generators import constant_speed
        >>> scene, motion = stimlib.scenes.bumps(), {"x": constant_speed(0.02, 0.1)}
        >>> spectra = stimlib.verify(scene, motion, stimlib.render(scene, motion, fs=8000, seconds=1.0)).spectra()
        >>> a = spectra["voltage"]
        >>> bool((a.low <= a.measured).all() and (a.measured <= a.high).all())
        True
        """
        return _spectra(self.evidence)

    def __repr__(self):
        bad = [c.name for c in self.checks if not c.passed]
        return f"Report({self._what()}: {'passed' if self.passed else 'FAILED: ' + ', '.join(bad)})"

    def __str__(self):
        from rich.console import Console

        out = io.StringIO()
        Console(file=out, width=130).print(self.__rich__())
        return out.getvalue()

    def __rich__(self):
        from rich.table import Table
        from rich.text import Text

        table = Table(title=Text(f"{self._what()}: {'passed' if self.passed else 'FAILED'}"), title_justify="left")
        for column in ("", "check", "measured", "limit", "what it compares"):
            table.add_column(column, justify="right" if column in ("measured", "limit") else "left")
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
        title = f"<h4>{html.escape(self._what())}: {'passed' if self.passed else 'FAILED'}</h4>"
        return f"{title}{_table(self)}<p>Not checked</p>{_skipped(self)}"

    def _what(self) -> str:
        e = self.evidence
        return f"{shown(e.source)}, {e.x.shape[1] / e.fs:g} s at {e.fs:g} Hz, seed {e.seed}"

    def to_dict(self) -> dict[str, Any]:
        """As plain JSON data; a number that is not finite is None.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> scene, motion = stimlib.Scene({"y": 2 * stimlib.Input("x")}), {"x": np.ones(100)}
        >>> stimlib.verify(scene, motion, stimlib.render(scene, motion, fs=1000)).to_dict()["checks"][0]
        {'group': 'b', 'name': 'random cuts, other outputs added', 'passed': True, 'measured': 0.0, 'limit': 0.0, 'text': ...}
        """
        e = self.evidence

        def row(c: Check) -> dict[str, Any]:
            measured, limit = (v if math.isfinite(v) else None for v in (float(c.measured), float(c.limit)))
            told = {"group": c.group, "name": c.name, "passed": bool(c.passed), "measured": measured, "limit": limit}
            return told | {"text": c.text}

        about = {"source": e.source, "fs": e.fs, "seconds": e.x.shape[1] / e.fs, "seed": e.seed, "scene_hash": e.scene.hash}
        checks = [row(c) for c in self.checks]
        return {"passed": self.passed, **about, "checks": checks, "numbers": list(e.numbers), "skipped": list(e.skipped)}

    def to_html(self, path: str | os.PathLike, command: str | None = None) -> None:
        """Write one self-contained page: no scripts, no other files, the same bytes for the same evidence.

        Parameters
        ----------
        path : str or Path
        command : str, optional
            The command line that repeats the verification; shown on the page.

        Raises
        ------
        SinkError
            The file cannot be written.
        """
        regular.publish(path, _page(self, command))


_STYLE = """body{font:15px/1.45 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:#222}
table{border-collapse:collapse;width:100%;font-size:13px}td,th{padding:.25rem .5rem;border-bottom:1px solid #ddd;text-align:left}
td.n{text-align:right;font-variant-numeric:tabular-nums}.ok{color:#176b2c}.bad{color:#fff;background:#b3261e}
h1 span{padding:0 .5rem;border-radius:.3rem}svg{width:100%;height:auto}code{background:#f3f3f3;padding:.1rem .3rem}
.small{color:#666;font-size:13px}"""


def _q(text: object) -> str:
    return html.escape(shown(text))


def _table(r: Report) -> str:
    rows = []
    for group, title in GROUPS.items():
        here = [c for c in r.checks if c.group == group]
        if here:
            rows.append(f'<tr><th colspan="5">({group}) {_q(title)}</th></tr>')
        for c in here:
            mark = '<td class="ok">ok</td>' if c.passed else '<td class="bad">FAILED</td>'
            numbers = f'<td class="n">{c.measured:.3g}</td><td class="n">{c.limit:.3g}</td>'
            rows.append(f"<tr>{mark}<td>{_q(c.name)}</td>{numbers}<td>{_q(c.text)}</td></tr>")
    head = "<tr><th></th><th>check</th><th>measured</th><th>limit</th><th>what it compares</th></tr>"
    return f"<table>{head}{''.join(rows)}</table>"


def _skipped(r: Report) -> str:
    return "<ul>" + ("".join(f"<li>{_q(t)}</li>" for t in r.evidence.skipped) or "<li>nothing</li>") + "</ul>"


def _page(r: Report, command: str | None) -> str:
    e = r.evidence
    verdict = '<span class="ok">passed</span>' if r.passed else '<span class="bad">FAILED</span>'
    facts = {
        "outputs": ", ".join(f"{n} [{b.dim}]" for n, b in e.scene.outputs.items()),
        "parameters": ", ".join(f"{n} = {v:g}" for n, v in e.params.items()) or "none",
        "numbers of the scene": "; ".join(e.numbers) or "none that a law reads",
        "motion": "; ".join(f"{n}: {_spec(m)}" for n, m in e.motion.items()),
        "seed": str(e.seed),
        "scene hash": e.scene.hash,
        **({"file hash": e.sidecar["file_sha256"]} if e.sidecar else {}),
        "versions": ", ".join(f"{p} {version(p)}" for p in ("stimlib", "numpy", "scipy", "numba", "matplotlib")),
    }
    table = "".join(f"<tr><th>{_q(k)}</th><td>{_q(v)}</td></tr>" for k, v in facts.items())
    again = f"<p>Repeat it with <code>{_q(command)}</code></p>" if command else ""
    figures = "".join(f"<h2>{_q(title)}</h2>{svg}" for title, svg in _figures(e))
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{_q(r._what())}</title><style>{_STYLE}</style>'
        f"<h1>{_q(e.source)} {verdict}</h1><p>{_q(r._what())}</p>{again}"
        f"{_table(r)}"
        f'<p class="small">Statistical checks are given as -log10 p against a joint false alarm of 1e-6: one correct '
        f"rendering in a million fails by chance.</p><h2>Not checked</h2>{_skipped(r)}{figures}"
        f"<h2>What this is about</h2><table>{table}</table></html>\n"
    )


def _spec(m: Any) -> str:
    return repr(m) if callable(m) else f"array of {len(m)} samples"


# Figures -----------------------------------------------------------------------------------------------------------------
def _figures(e: Evidence):
    s = Signals(
        e.scene,
        e.fs,
        {n: e.x[e.proc.inputs.index(n)] for n in e.scene.inputs},
        dict(zip(e.scene.outputs, e.shown, strict=True)),
    )
    above, below = heights(s)
    yield "Signals over time", _svg(lambda fig: over_time(fig, rows_of(s), e.fs), (12, above))
    yield (
        "Each output close by: vibration, over position, spectrum",
        _svg(lambda fig: close_by(fig, s, _spectra(e)), (12, below)),
    )
    if e.fingers:
        yield "Vibration, rate and gate (the UGrip paper, figure 4)", _svg(lambda fig: _fingers(fig, e), (12, 5))
    if e.curves:
        yield "What the law is made of", _svg(lambda fig: _curves(fig, s, e), (12, 6))


def _svg(draw, size) -> str:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "stimlib", "svg.fonttype": "none", "font.size": 9}):
        fig = Figure(figsize=size, layout="constrained")
        draw(fig)
        out = io.StringIO()
        fig.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def _fingers(fig, e):
    """A column for each finger, on the same scales."""
    axes = fig.subplots(3, len(e.fingers), squeeze=False, sharex=True, sharey="row")
    t = np.arange(e.x.shape[1]) / e.fs
    for (top, middle, bottom), (name, finger) in zip(axes.T, e.fingers.items(), strict=True):
        curve(top, t, e.y[list(e.scene.outputs).index(name)] - finger.mean, color="C1")
        curve(middle, t, finger.v)
        curve(bottom, t, finger.gate.astype(float), color="C2")
        top.set_title(name)
        bottom.set(xlabel="time / s", xlim=(0, max(t[-1], 1 / e.fs)))
    for ax, label in zip(axes[:, 0], ("force - k x / N", "rate / (m/s)", "gate"), strict=True):
        ax.set_ylabel(label)
    for ax in axes.flat:
        ax.grid(alpha=0.3)


def _curves(fig, s, e):
    """The motion, what was delivered, and what the law made of it, where it is best seen."""
    rows = rows_of(s) + [Row(name, "1", y, "C2") for name, y in e.curves.items()]
    start = e.closeup.start or 0
    over_time(fig, [row._replace(y=row.y[e.closeup]) for row in rows], e.fs, start)


def _spectra(e: Evidence) -> dict[str, Against]:
    from scipy.signal import welch

    found = {}
    for tap in e.taps:
        if tap.spectrum and tap.model:
            found[tap.output] = _of_noise(tap)
    for name, law in e.wanted.items():
        want, apart = law()
        y = e.y[list(e.scene.outputs).index(name)]
        size = min(8192, y.size)
        f, (measured, model) = welch(np.array([y, want]), e.fs, nperseg=size, detrend=False)
        # a difference of so much at every sample, all of it at one frequency, under the same Hann window
        most = np.sqrt(2 * apart**2 * size / 1.5 / e.fs)
        low, high = np.maximum(np.sqrt(model) - most, 0) ** 2, (np.sqrt(model) + most) ** 2
        unit = str(e.scene.outputs[name].dim)
        found[name] = Against(f"spectrum of {name}, and of its law", unit, *(a[1:] for a in (f, measured, model, low, high)))
    return found


def _of_noise(tap: Tap) -> Against:
    """Third octaves of a gated noise."""
    from scipy import stats

    s: Any = tap.spectrum
    model: Any = tap.model
    centre = np.array([np.sqrt(b.f_low * b.f_high) for b in s.bands])
    bins, level = np.array([b.bins for b in s.bands]), model(centre)
    p = 1e-6 / (len(s.bands) + 1) / 2
    low, high = stats.gamma.ppf(p, bins) / bins, stats.gamma.isf(p, bins) / bins
    title = f"noise in {tap.output} before gate and rate"
    return Against(title, "1/s", centre, level * np.array([b.ratio for b in s.bands]), level, level * low, level * high)
