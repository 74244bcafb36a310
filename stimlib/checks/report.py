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

from ..core import regular
from ..errors import shown

if TYPE_CHECKING:
    from .evidence import Check, Evidence

GROUPS = {
    "a1": "compiled impulse responses",
    "a2": "physical laws of the blocks",
    "b": "the same samples again",
    "c": "noise",
    "d": "force law",
    "e": "limits and gates",
}
POINTS = 1500  # per curve: more cannot be seen


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
    t = np.arange(e.x.shape[1]) / e.fs
    inputs = {f"{n} / {b.dim}": e.x[e.proc.inputs.index(n)] for n, b in e.scene.inputs.items()}
    outputs = {f"{n} / {b.dim}": e.shown[k] for k, (n, b) in enumerate(e.scene.outputs.items())}
    yield "Signals over time", _svg(lambda fig: _times(fig, t, inputs, outputs, e))
    if e.fingers:
        yield "Force over position (paper 000, figure 4)", _svg(lambda fig: _loops(fig, e), (9, 3.6))
        yield "Vibration, rate and gate", _svg(lambda fig: _vibration(fig, t, e))
    if e.curves:
        yield "What the law is made of", _svg(lambda fig: _times(fig, t, e.curves, {}, e))
        yield "Spectrum of the outputs", _svg(lambda fig: _densities(fig, e), (9, 3.6))
    if any(tap.spectrum for tap in e.taps):
        yield "Noise before gate and rate, against the model", _svg(lambda fig: _spectra(fig, e), (9, 3.8))


def _svg(draw, size=(9, 4.6)) -> str:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "stimlib", "svg.fonttype": "none", "font.size": 9}):
        fig = Figure(figsize=size, layout="constrained")
        draw(fig)
        out = io.StringIO()
        fig.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def _curve(ax, t, y, **style):
    """A curve as its smallest and largest value in each of POINTS stretches: nothing that sticks out is lost."""
    if y.size > 2 * POINTS:
        step = -(-y.size // POINTS)
        starts = np.arange(0, y.size, step)
        low, high = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
        y, t = np.ravel(np.column_stack([low, high])), np.repeat(t[starts], 2)
    ax.plot(t, y, **({"lw": 0.7} | style))


def _times(fig, t, inputs, outputs, e):
    both = [curves for curves in (inputs, outputs) if curves]
    axes = fig.subplots(len(both), 1, sharex=True, squeeze=False)[:, 0]
    for ax, curves in zip(axes, both, strict=True):
        for name, y in curves.items():
            _curve(ax, t, y, label=name)
        ax.legend(loc="upper right")
        ax.grid(alpha=0.3)
    axes[-1].set(xlabel="time / s", xlim=(0, max(t[-1], 1 / e.fs)))


def _densities(fig, e):
    from scipy.signal import welch

    ax = fig.subplots()
    for name, y in zip(e.scene.outputs, e.y, strict=True):
        f, S = welch(y, e.fs, nperseg=min(8192, y.size))
        ax.semilogy(f[1:], np.maximum(S[1:], 1e-30), lw=0.7, label=name)
    ax.set(xlabel="frequency / Hz", ylabel="PSD / unit²/Hz", xlim=(0, min(1000, e.fs / 2)))
    ax.grid(alpha=0.3)
    ax.legend()


def _loops(fig, e):
    axes = fig.subplots(1, len(e.fingers), squeeze=False)[0]
    for ax, (name, finger) in zip(axes, e.fingers.items(), strict=True):
        i = list(e.scene.outputs).index(name)
        x = e.x[e.proc.inputs.index(name.replace("force", "x"))]
        some = min(x.size, round(4 * e.fs))  # a few squeezes: more would only lie on top of each other
        pick = slice(0, some, max(1, some // 6000))
        loading = finger.gate[pick]
        y = e.shown[i][pick]
        ax.plot(1e3 * x[pick][~loading], y[~loading], ".", ms=1, color="0.6", label="held or unloading")
        ax.plot(1e3 * x[pick][loading], y[loading], ".", ms=1, color="C3", label="loading")
        ax.set(xlabel="position / mm", ylabel=f"{name} / N")
        ax.grid(alpha=0.3)
        ax.legend(loc="upper left", markerscale=6)


def _vibration(fig, t, e):
    top, middle, bottom = fig.subplots(3, 1, sharex=True)
    for k, (name, finger) in enumerate(e.fingers.items()):
        _curve(top, t, e.y[list(e.scene.outputs).index(name)] - finger.mean, label=f"{name} - k x / N")
        _curve(middle, t, finger.v, label=f"rate of {name} / (m/s)")
        _curve(bottom, t, finger.gate + 1.2 * k, label=f"gate of {name}")
    for ax in (top, middle, bottom):
        ax.grid(alpha=0.3)
        ax.legend(loc="upper right")
    bottom.set(xlabel="time / s", yticks=[])


def _spectra(fig, e):
    from scipy import stats

    shown = [tap for tap in e.taps if tap.spectrum]
    for ax, tap in zip(fig.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
        s = tap.spectrum
        f = np.geomspace(tap.f_low, tap.f_high, 300)
        ax.loglog(f, tap.model(f), "k", lw=0.8, label="model")
        centre = np.array([np.sqrt(b.f_low * b.f_high) for b in s.bands])
        bins = np.array([b.bins for b in s.bands])
        level = tap.model(centre)
        p = 1e-6 / (len(s.bands) + 1) / 2
        low, high = stats.gamma.ppf(p, bins) / bins, stats.gamma.isf(p, bins) / bins
        ax.fill_between(centre, level * low, level * high, alpha=0.2, label="where a correct rendering lies")
        ax.loglog(centre, level * np.array([b.ratio for b in s.bands]), "C3o", ms=3, label="third octaves")
        ax.set(xlabel="frequency / Hz", ylabel="PSD / (1/s)²/Hz", title=f"{tap.output}: {s.seconds:.3g} s enabled")
        ax.grid(alpha=0.3, which="both")
        ax.legend(loc="lower right")
