"""The report of a verification as an HTML page, for readers who were not there.

It is one file without code, and nothing else is needed for it.
"""

from __future__ import annotations

import hashlib
import html
import json
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ..core.definitions import definitions
from ..core.graph import reach
from ..core.units import pretty
from ..errors import BadValue, counted, shown
from ..files.sidecar import describe, sidecar_of
from ..motion.text import parse_motion
from ..scenes import ROWS
from ..scenes.about import about
from ..version import __version__
from .evidence import ALARM, Check, Evidence
from .figures import figures
from .power import OF_IT, Shows

GROUPS = {
    "a1": "compiled impulse responses",
    "a2": "physical laws of the blocks",
    "b": "the same samples again",
    "c": "noise",
    "d": "force law",
    "e": "limits and gates",
    "f": "each block, on the signals that it got",
}
STYLE = """body{font:15px/1.45 system-ui,sans-serif;max-width:62rem;margin:2rem auto;
padding:0 1rem;color:#222;overflow-wrap:anywhere}
h1{font-size:1.6rem;line-height:1.25;overflow-wrap:break-word}
table{border-collapse:collapse;width:100%;font-size:13px}
td,th{padding:.25rem .5rem;border-bottom:1px solid #ddd;text-align:left;vertical-align:top}
th{overflow-wrap:normal}tr tr:last-child td{border:0}td.ok,td.bad{white-space:nowrap}
.checks td.n{white-space:nowrap}.n{text-align:right;overflow-wrap:normal}
td.n{font-variant-numeric:tabular-nums}.ok{color:#176b2c}
.bad{color:#fff;background:#b3261e;print-color-adjust:exact;-webkit-print-color-adjust:exact}
h1 span{padding:0 .5rem;border-radius:.3rem;box-decoration-break:clone}h1 span.ok{padding:0}
figure{margin:1rem 0;overflow-x:auto}.rows{overflow-x:auto}.rows td.n{white-space:nowrap}
svg{width:100%;height:auto}
code,pre{background:#f3f3f3;padding:.1rem .3rem}
pre{white-space:pre-wrap;font-size:12px}.small{color:#666;font-size:13px}
.scene{max-height:20rem;overflow-y:auto;background:#f3f3f3}summary{cursor:pointer}
@media screen and (max-width:40rem){h1{font-size:1.3rem}table{font-size:12px}
td,th{padding:.2rem .25rem}.checks,.checks>*{display:block}
.checks>*>tr{display:grid;grid-template-columns:3.6rem 1fr 4rem 4rem;gap:0 .3rem}
.checks>*>tr>:nth-child(5){grid-column:2/-1}.checks>*>tr>[colspan]{grid-column:1/-1}
.checks>*>tr>:not(:last-child){border:0}}
@page{margin:12mm}
@media print{body{max-width:none;margin:0;padding:0;font-size:9pt;line-height:1.3}
h1{font-size:14pt}h2{font-size:11pt;margin:8pt 0 3pt}h2,h3,summary{break-after:avoid}
p,ul,pre{margin:3pt 0}table,.small{font-size:7.5pt}td,th{padding:.8pt 3pt}
tr,figure{break-inside:avoid}tr:has(>[colspan]){break-after:avoid}.all{display:none}
figure{margin:4pt 0}svg{min-width:0!important;max-height:23cm}
pre{font-size:7pt}.scene{max-height:none;overflow:visible}
.scene pre{font-size:6.2pt;line-height:1.2}}"""
MANY = 3  # equal rows, above which one row stands for them


def document(title: str, body: str) -> str:
    """Return a self-contained HTML page, for screens of any width and for paper."""
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport"'
        f' content="width=device-width,initial-scale=1"><title>{esc(title)}</title>'
        f"<style>{STYLE}</style>{body}</html>\n"
    )


def page(
    what: str, checks: list[Check], e: Evidence, certain: list[Shows], command: str | None
) -> str:
    """Return the HTML of the report; texts from files are escaped."""
    good = sum(c.passed for c in checks)
    kind = "bad" if e.unknown or good < len(checks) else "ok"
    said = headline(good == len(checks), e)
    word = f'<span class="{kind}">{esc(said)}</span>'
    drawn = "".join(picture(title, svg) for title, svg in figures(e))
    return document(
        f"{said}; {what}",
        f"<h1>{word}</h1><p>{esc(what)}. {good} of {len(checks)} checks passed.</p>"
        f"{_laws(e)}{drawn}"
        f"<h2>What was verified</h2>{facts(_displayed(e))}"
        f"<h2>What was compared</h2>{table_of(checks)}"
        f"<h2>Numbers in the scene</h2>{items(e.numbers)}"
        f"<h2>How small an error would be detected</h2>{_certainty(certain)}"
        f"<h2>Each block and its law</h2>{_blocks(e)}"
        f"<h2>Not checked</h2>{_reasons(e.skipped)}"
        f"<h2>How to reproduce it</h2>{_reproduced(e, command)}",
    )


def picture(title: str, svg: str) -> str:
    """Return the HTML of a figure below its heading."""
    wide = float(svg.partition('width="')[2].partition("pt")[0] or 0)
    return (
        f'<figure tabindex="0"><h2>{esc(title)}</h2><svg role="img" aria-label="{esc(title)}"'
        f' style="min-width:{0.8 * wide:.0f}px"{svg.removeprefix("<svg")}</figure>'
    )


def headline(passed: bool, e: Evidence) -> str:
    """Return the verdict, and what the recording was compared with."""
    parts = [p for p in e.scene.parts if p.given is not None and p.law not in e.unknown]
    known = {p.law: None for p in parts}
    lawless = [
        n
        for n in e.scene.outputs
        if all(p.outputs and n not in p.outputs.values() for p in parts)  # others say no names
    ]
    free = sum(bool(h.why) for h in e.held)
    against = (
        f"the law{'s' if len(known) > 1 else ''} of {some(list(known))}"
        + (f"; no law of {some(lawless)} as a whole is known" if lawless else "")
        if known
        else f"the laws of {counted(len(e.held) - free, 'block')}, each by itself"
        + (f" (none is known for {free} more)" if free else "")
        + "; no law of the whole scene is known"
    )
    word = verdict(passed, e.unknown).replace("passed", "Passed", 1)
    return f"{word}{', held' if e.unknown else ''} against: {against}"


def some(names: list[str], most: int = MANY) -> str:
    """Return the first names, and how many there are besides."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _laws(e: Evidence) -> str:
    """Return the law of each part in words, or what it means that there is none."""
    if not e.scene.parts:
        return (
            "<p>Each block was compared with its own law, on the signals that it got. Whether these"
            " blocks together are the intended stimulus was not checked: the scene states no law"
            " for it.</p>"
        )
    said = [
        (p.name or "The scene", f"the law {p.law}, with {dict(p.given or {})}")
        if "." in p.law
        else (p.name, ROWS[p.law].words if p.law in ROWS else "not known here")
        for p in e.scene.parts
    ]
    return "".join(
        f"<p>{esc(': '.join(filter(None, same[0])))}"
        + (f" ({len(same)} times)" if same[1:] else "")
        + "</p>"
        for same in alike(said, lambda named: named[1])
    )


def verdict(passed: bool, unknown: list[str]) -> str:
    """Return whether all checks passed, and which laws of the scene are unknown."""
    word = "passed" if passed else "FAILED"
    return (
        f"{word}, but its law {', '.join(map(repr, unknown))} is not known here and was not checked"
        if unknown
        else word
    )


def esc(text: object) -> str:
    """Return a text as HTML that shows it."""
    return html.escape(shown(text))


def facts(rows: Mapping[str, str]) -> str:
    """Return an HTML table of names and texts."""
    cells = "".join(f"<tr><th>{esc(k)}</th><td>{esc(v)}</td></tr>" for k, v in rows.items())
    return f"<table>{cells}</table>"


def items(texts: Iterable[str]) -> str:
    """Return an HTML list of texts, or a sentence that says that it is empty."""
    return "<ul>" + ("".join(f"<li>{esc(t)}</li>" for t in texts) or "<li>nothing</li>") + "</ul>"


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return an HTML table of rows with equal keys; it scrolls if it is too wide."""
    head = "".join(f"<th>{esc(name.replace('_', ' '))}</th>" for name in (rows or [{}])[0])
    body = "".join(f"<tr>{''.join(map(_cell, row.values()))}</tr>" for row in rows)
    made = f'<div class="rows" tabindex="0"><table><tr>{head}</tr>{body}</table></div>'
    return made if rows else "<p>nothing</p>"


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return f"<td>{esc(value)}</td>"
    if isinstance(value, (tuple, list)):
        return f'<td class="n">{esc(", ".join(map(_number, value)))}</td>'
    return f'<td class="n">{esc(_number(value))}</td>'


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, (float, np.floating, np.ndarray)) else str(value)


def alike(rows: Iterable[Any], key: Callable[[Any], Any]) -> list[list[Any]]:
    """Return rows with equal keys in one list if there are more than ``MANY``.

    The others are alone in theirs.
    """
    groups: dict[Any, list[Any]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return [
        part
        for same in groups.values()
        for part in ([same] if len(same) > MANY else [[row] for row in same])
    ]


def _folded(summary: str, content: str) -> str:
    """Return content to unfold on a screen; on paper it is left out."""
    return f'<details class="all"><summary>{esc(summary)}</summary>{content}</details>' * bool(
        content
    )


def table_of(checks: list[Check]) -> str:
    """Return an HTML table of the checks by group, equal ones in one row.

    That row has the largest measured value of them, relative to its limit, and all of
    them to unfold. Checks that failed have a row each.
    """
    rows = []
    for group, title in GROUPS.items():
        here = [c for c in checks if c.group == group]
        if here:
            rows.append(f'<tr><th colspan="5">({group}) {esc(title)}</th></tr>')
        for same in alike(here, lambda c: (c.passed or c.name, c.name.rpartition(": ")[2])):
            worst = max(same, key=lambda c: c.measured / c.limit if c.limit else c.measured)
            name, text, each = worst.name, worst.text, ""
            if same[1:]:
                of, _, kind = name.rpartition(": ")
                name, text = f"{kind}, {len(same)} checks", f"worst of {of}: {text}"
                each = f"<table>{''.join(_row(c.name, c.text, c) for c in same)}</table>"
            rows.append(_row(name, text, worst, _folded(f"all {len(same)}", each)))
    head = (
        '<tr><th></th><th>check</th><th class="n">measured</th><th class="n">limit</th>'
        "<th>what it compares</th></tr>"
    )
    return (
        f'<table class="checks"><thead>{head}</thead><tbody>{"".join(rows)}</tbody></table><p'
        ' class="small">Statistical checks are given as -log10 p. A number after the name of a'
        " block is its place in the list of blocks in scene.json, from 0. <code>stimlib verify"
        " --json</code> prints every check.</p>"
    )


def _row(name: str, text: str, c: Check, more: str = "") -> str:
    mark = '<td class="ok">ok</td>' if c.passed else '<td class="bad">FAILED</td>'
    return (
        f'<tr>{mark}<td>{esc(name)}</td><td class="n">{c.measured:.3g}</td><td'
        f' class="n">{c.limit:.3g}</td><td>{esc(text)}{more}</td></tr>'
    )


def _reasons(texts: list[str]) -> str:
    """Return an HTML list of what was not checked, equal reasons in one item."""
    return items(
        f"{same[0].rpartition(': ')[0]} and {len(same) - 1} more: {same[0].rpartition(': ')[2]}"
        if same[1:]
        else same[0]
        for same in alike(texts, lambda text: text.rpartition(": ")[2])
    )


def _blocks(e: Evidence) -> str:
    """Return HTML tables of the blocks.

    First come blocks that only a re-render checks, then a line for each class, and then
    all blocks, folded away.
    """
    free = [h for h in e.held if h.why]
    rest = sorted((h for h in e.held if not h.why), key=lambda h: -h.error)
    kinds = {
        kind: [h for h in rest if h.kind == kind] for kind in dict.fromkeys(h.kind for h in rest)
    }
    classes = "".join(
        f"<tr><td>{esc(kind)}</td><td"
        f' class="n">{len(same)}</td>{_held(same[0], min(h.least for h in same))}</tr>'
        for kind, same in kinds.items()
    )
    place = {id(b): f"{k} " for k, b in enumerate(reach(e.scene.outputs.values()))}
    each = "".join(
        f"<tr><td>{place.get(id(h.block), '')}{esc(f'{h.block!r}{h.where}')}</td>"
        f"{_held(h, h.least)}</tr>"
        for h in rest
    )
    unheld = "".join(
        f"<tr><td>{esc(f'{h.block!r}{h.where}')}</td><td>{esc(h.why)}</td></tr>" for h in free
    )
    unheld = f"<table><tr><th>block</th><th>why not</th></tr>{unheld}</table>" * bool(free)
    names = "samples", "error over tolerance", "smallest error that is detected"
    numbers = "".join(f'<th class="n">{name}</th>' for name in names)
    return (
        f"<p>{counted(len(rest), 'block')} compared with"
        f" {'its own law' if len(rest) == 1 else 'their own laws'}, on the signals that came in;"
        f" {len(free)} {'was' if len(free) == 1 else 'were'} not{':' if free else '.'}</p>{unheld}"
        f'<table><thead><tr><th>class</th><th class="n">blocks</th>{numbers}</tr></thead>{classes}'
        "</table>"
        f'<p class="small">The worst block of each class; an error is a part of the row, such as of'
        " a gain.</p>"
        + _folded(
            f"all {counted(len(rest), 'block')}",
            f"<table><tr><th>block</th>{numbers}</tr>{each}</table>",
        )
    )


def _held(h: Any, least: float) -> str:
    """Return three cells: samples, error over tolerance, and smallest visible error."""
    seen = f"{least:.2g}" if np.isfinite(least) else "none, it is 0 throughout"
    return (
        f'<td class="n">{h.samples}</td><td class="n">{h.error:.3g}</td><td class="n">{seen}</td>'
    )


def _displayed(e: Evidence) -> dict[str, str]:
    """Return the facts about inputs and outputs."""
    said = about(e.scene)
    rows = {
        "outputs": ", ".join(f"{n} [{b.dim}]" for n, b in e.scene.outputs.items()),
        "length": f"{counted(e.frames, 'sample')} at {e.fs:g} Hz, {e.frames / e.fs:g} s",
        "parameters": "; ".join(
            f"{n} = {v:.10g}: {said['meanings'].get(n, '')}".rstrip(": ")
            for n, v in e.params.items()
        )
        or "none",
        "fixed values": "; ".join("{name} = {value}: {meaning}".format(**r) for r in said["fixed"])
        or "none",
        "motion": "; ".join(f"{n}: {_spec(m)}" for n, m in e.motion.items()) or "none",
        "seed": str(e.seed),
    }
    if e.differences:
        rows["differences from the scene's parameters"] = some(e.differences, 20)
    if e.sidecar:
        scales = ", ".join(
            f"{c['name']} {c['full_scale']:g} {pretty(c['unit'])}" for c in e.sidecar["channels"]
        )
        rows["stored as"] = f"{e.sidecar['format']} {e.sidecar['subtype']}, full scale: {scales}"
    return rows


def _spec(m: object) -> str:
    return describe(m) if callable(m) else f"array of {counted(len(m), 'sample')}"  # type: ignore[arg-type]


def _certainty(found: list[Shows]) -> str:
    rows = []
    for same in alike(found, lambda s: (s.check.rpartition(": ")[2], s.kind, s.unit)):
        s = max(same, key=lambda s: (s.size != s.size, s.size))
        none = "none, up to all of it" if s.unit == OF_IT else "none, however large"
        size = f"{s.size:.3g} {pretty(s.unit)}" if s.size == s.size else none
        of, _, kind = s.check.rpartition(": ")
        check = f"{kind}, {counted(len(same), 'time')}; worst of {of}" if same[1:] else s.check
        rows.append(
            f"<tr><td>{esc(check)}</td><td>{esc(s.kind)}</td><td"
            f' class="n">{esc(size)}</td><td>{s.chance:.0%}</td></tr>'
        )
    asked = (
        " The law of the scene was also computed with each of its parameters smaller, by the part"
        " in the table: it then rejects these samples."
        if any(s.unit == OF_IT for s in found)
        else ""
    )
    head = (
        '<tr><th>check</th><th>error</th><th class="n">smallest that is detected</th>'
        "<th>probability</th></tr>"
    )
    return (
        "<p>Spectra, independence and slopes are statistical checks. Together they reject one"
        f" correct rendering in {1 / ALARM:.0f}; they detect an error of the size below in this"
        " recording with a probability of at least 95 %. All other checks are exact: they detect"
        f" every error beyond their limit.{asked}</p><table><thead>{head}</thead>"
        f"{''.join(rows)}</table>"
    )


# Reproduction -------------------------------------------------------------------------
def _reproduced(e: Evidence, command: str | None) -> str:
    """Return instructions to reproduce the rendering.

    They name what to install and where files belong, commands, hashes, versions, and
    the scene as a file.
    """
    from importlib.metadata import version

    others = "numpy", "scipy", "llvmlite", "soundfile", "matplotlib"
    # not the version that was installed, which a checkout has left behind
    used = {"stimlib": __version__} | {p: version(p) for p in others}
    again = f"<p>Repeat the verification with <code>{esc(command)}</code>.</p>" if command else ""
    signal = _sha256(s.y.T for s in e.stretches())
    rows = {
        "scene hash": e.scene.hash,
        "motion, as sampled": (
            f"{_sha256(s.x.T for s in e.stretches())} (float64, a row for each sample)"
        ),
        "signal": f"{signal} (float64, a row for each sample, before it is stored)",
        **({"file hash": e.sidecar["file_sha256"]} if e.sidecar else {}),
        **{f"own blocks of {m}": d["sha256"] for m, d in definitions(e.scene).items()},
        "versions": ", ".join(f"{p} {v}" for p, v in used.items()),
        "computer": (
            f"Python {platform.python_version()}, {platform.system()}, {platform.machine()}"
        ),
    }
    text = json.dumps(e.scene.to_dict(), separators=(",", ":"))
    return (
        f"{_installed(used)}{_beside(e)}{again}{_program(e, signal)}<p>Hashes are"
        f" SHA-256.</p>{facts(rows)}<h3>scene.json, for"
        f' <code>stimlib.load</code></h3><div class="scene" tabindex="0"><pre>{esc(text)}</pre>'
        "</div>"
    )


def _installed(used: Mapping[str, str]) -> str:
    """Return commands for an environment with these versions."""
    python = ".".join(platform.python_version_tuple()[:2])
    pins = " ".join(f"{p}=={v}" for p, v in used.items())
    lines = f"python -m venv proof\n. proof/bin/activate\npip install {pins}"
    windows = "on Windows the second line is <code>proof\\Scripts\\activate</code>"
    return (
        f"<p>Install what this page was made with, under Python {python};"
        f" {windows}:</p><pre>{esc(lines)}</pre>"
    )


def _beside(e: Evidence) -> str:
    """Return which files a reader needs in addition to this page."""
    if e.session:
        return (
            f"<p>Keep the folder of the log, <code>{esc(e.source)}</code>, whole: each of its files"
            " is needed.</p>"
        )
    if e.path is None:
        return ""
    name, beside = esc(e.path.name), esc(sidecar_of(e.path).name)
    own = ", ".join(f"<code>{esc(m)}</code>" for m in definitions(e.scene))
    import_ = (
        " Import what defines the scene's own blocks, with the hash below, by"
        f" <code>--import</code>: {own}."
        if own
        else ""
    )
    return (
        f"<p>Lay two files side by side in one folder: <code>{name}</code>, and its sidecar"
        f" <code>{beside}</code>, which has scene, parameters, seed and motion. Without its sidecar"
        " the file proves nothing. A motion that is a recording is a file of its own, which is"
        f" looked for at the path above, or given by <code>--motion</code>.{import_}</p>"
    )


def _has_text(m: object) -> bool:
    """Return whether a motion can be made again from its text.

    This is not possible for a user's function or an array.
    """
    text = describe(m) if callable(m) else ""
    with suppress(BadValue):
        return text.startswith("recording(") or callable(parse_motion(text))
    return False


def _importing(module: str) -> str:
    """Return the import statement of a file.

    A file that is imported by its path may have a name that is not valid in Python.
    """
    named = all(part.isidentifier() for part in module.split("."))
    return f"import {module}" if named else f"__import__({module!r})"


def _program(e: Evidence, signal: str) -> str:
    """Return Python code that makes the same samples.

    This is possible if neither arrays nor later changes are needed.
    """
    own = definitions(e.scene)
    if "__main__" in own or e.moves or not all(map(_has_text, e.motion.values())):
        return (
            "<p>No text here makes the samples again: they need motion, changes of parameters and"
            " blocks as they were.</p>"
        )
    motion = ", ".join(f"{n!r}: parse_source({describe(m)!r})" for n, m in e.motion.items())
    lines = (
        "import hashlib, stimlib",
        *(f"{_importing(m)}  # own blocks of the scene" for m in own),
        "from stimlib.motion.recorded import parse_source",
        'scene = stimlib.load("scene.json")  # the text at the end of this page',
        (
            f"made = stimlib.render(scene, {{{motion}}}, {e.fs!r}, {e.frames / e.fs!r},"
            f" {e.params!r}, {e.seed})"
        ),
        'print(hashlib.sha256(made.y.T.astype("<f8").tobytes()).hexdigest())',
        f"# {signal}",
    )
    return f"<p>Make the samples again:</p><pre>{chr(10).join(map(esc, lines))}</pre>"


def _sha256(parts: Iterable[np.ndarray]) -> str:
    digest = hashlib.sha256()
    for rows in parts:
        digest.update(np.ascontiguousarray(rows, "<f8").data)
    return digest.hexdigest()
