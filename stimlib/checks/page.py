"""The report of a verification as an HTML page, for readers who were not there.

It is one file without code, and nothing else is needed for it.
"""

from __future__ import annotations

import hashlib
import html
import json
import platform
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib.metadata import version
from typing import Any

import numpy as np

from ..core.definitions import definitions
from ..errors import BadValue, shown
from ..files.sidecar import describe, sidecar_of
from ..motion.text import parse_motion
from ..scenes import ROWS
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
    "f": "each block, from the rows that it got",
}
STYLE = """body{font:15px/1.45 system-ui,sans-serif;max-width:62rem;margin:2rem auto;
padding:0 1rem;color:#222}
table{border-collapse:collapse;width:100%;font-size:13px}
td,th{padding:.25rem .5rem;border-bottom:1px solid #ddd;text-align:left}
td.n{text-align:right;font-variant-numeric:tabular-nums}.ok{color:#176b2c}.bad{color:#fff;background:#b3261e}
h1 span{padding:0 .5rem;border-radius:.3rem}svg{width:100%;height:auto}
code,pre{background:#f3f3f3;padding:.1rem .3rem}
pre{white-space:pre-wrap;overflow-wrap:anywhere;font-size:12px}.small{color:#666;font-size:13px}"""


def page(
    what: str, checks: list[Check], e: Evidence, certain: list[Shows], command: str | None
) -> str:
    """Return the HTML of the report; texts from files are escaped."""
    good = sum(c.passed for c in checks)
    kind = "bad" if e.unknown or good < len(checks) else "ok"
    word = f'<span class="{kind}">{_q(verdict(good == len(checks), e.unknown))}</span>'
    drawn = "".join(f"<h2>{_q(title)}</h2>{svg}" for title, svg in figures(e))
    return (
        '<!doctype html><html lang="en"><meta'
        f' charset="utf-8"><title>{_q(what)}</title><style>{STYLE}</style><h1>{_q(e.source)}'
        f" {word}</h1><p>{_q(what)}. {good} of {len(checks)} checks passed.</p><h2>What was"
        f" displayed</h2>{facts(_displayed(e))}<h2>Against which"
        f" model</h2>{_model(checks, e)}<h2>With which certainty</h2>{_certainty(certain)}<h2>What"
        f" was compared</h2>{table_of(checks)}<h2>Which block is held</h2>{_blocks(e)}<h2>Not"
        f" checked</h2>{items(e.skipped)}{drawn}<h2>How to reproduce"
        f" it</h2>{_reproduced(e, command)}</html>\n"
    )


def verdict(passed: bool, unknown: list[str]) -> str:
    """Return whether all checks passed, and which laws of the scene are unknown."""
    word = "passed" if passed else "FAILED"
    return (
        f"{word}, but its law {', '.join(map(repr, unknown))} is not known here and was not checked"
        if unknown
        else word
    )


def _q(text: object) -> str:
    return html.escape(shown(text))


def facts(rows: Mapping[str, str]) -> str:
    """Return an HTML table of names and texts."""
    cells = "".join(f"<tr><th>{_q(k)}</th><td>{_q(v)}</td></tr>" for k, v in rows.items())
    return f"<table>{cells}</table>"


def items(texts: Iterable[str]) -> str:
    """Return an HTML list of texts, or a sentence that says that it is empty."""
    return "<ul>" + ("".join(f"<li>{_q(t)}</li>" for t in texts) or "<li>nothing</li>") + "</ul>"


def table_of(checks: list[Check]) -> str:
    """Return an HTML table of every check, by group."""
    rows = []
    for group, title in GROUPS.items():
        here = [c for c in checks if c.group == group]
        if here:
            rows.append(f'<tr><th colspan="5">({group}) {_q(title)}</th></tr>')
        for c in here:
            mark = '<td class="ok">ok</td>' if c.passed else '<td class="bad">FAILED</td>'
            numbers = f'<td class="n">{c.measured:.3g}</td><td class="n">{c.limit:.3g}</td>'
            rows.append(f"<tr>{mark}<td>{_q(c.name)}</td>{numbers}<td>{_q(c.text)}</td></tr>")
    head = (
        "<tr><th></th><th>check</th><th>measured</th><th>limit</th><th>what it compares</th></tr>"
    )
    return (
        f'<table>{head}{"".join(rows)}</table><p class="small">Checks of chance are given as -log10'
        " p.</p>"
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
        f"<tr><td>{_q(kind)}</td><td"
        f' class="n">{len(same)}</td>{_held(same[0], min(h.least for h in same))}</tr>'
        for kind, same in kinds.items()
    )
    each = "".join(
        f"<tr><td>{_q(f'{h.block!r}{h.where}')}</td>{_held(h, h.least)}</tr>" for h in rest
    )
    unheld = "".join(
        f"<tr><td>{_q(f'{h.block!r}{h.where}')}</td><td>{_q(h.why)}</td></tr>" for h in free
    )
    if free:
        unheld = f"<table><tr><th>block</th><th>why not</th></tr>{unheld}</table>"
    numbers = "<th>samples</th><th>error over tolerance</th><th>smallest error that is refused</th>"
    return (
        f"<p>{len(rest)} blocks are held by a law of their own, on the rows that they got;"
        f" {len(free)} are not{':' if free else '.'}</p>{unheld}"
        f"<table><tr><th>class</th><th>blocks</th>{numbers}</tr>{classes}</table>"
        f'<p class="small">The worst block of each class; an error is a part of the row, such as of'
        f" a gain.</p>"
        "<details><summary>Each"
        f" block</summary><table><tr><th>block</th>{numbers}</tr>{each}</table></details>"
    )


def _held(h: Any, least: float) -> str:
    """Return three cells: samples, error over tolerance, and smallest visible error."""
    seen = f"{least:.2g}" if np.isfinite(least) else "none, it is 0 throughout"
    return (
        f'<td class="n">{h.samples}</td><td class="n">{h.error:.3g}</td><td class="n">{seen}</td>'
    )


def _displayed(e: Evidence) -> dict[str, str]:
    """Return the facts about inputs and outputs."""
    rows = {
        "outputs": ", ".join(f"{n} [{b.dim}]" for n, b in e.scene.outputs.items()),
        "length": f"{e.frames} samples at {e.fs:g} Hz, {e.frames / e.fs:g} s",
        "parameters": ", ".join(f"{n} = {v:g}" for n, v in e.params.items()) or "none",
        "motion": "; ".join(f"{n}: {_spec(m)}" for n, m in e.motion.items()) or "none",
        "seed": str(e.seed),
    }
    if later := [c for c in e.changes if c.at or c.ramp * e.fs > 1]:
        told = [
            f"{c.name} to {c.value:g} at {c.at / e.fs:g} s within {c.ramp:g} s" for c in later[:20]
        ]
        rows["changes of parameters"] = "; ".join(told) + (
            f"; and {len(later) - 20} more" if len(later) > 20 else ""
        )
    if e.sidecar:
        scales = ", ".join(
            f"{c['name']} {c['full_scale']:g} {c['unit']}" for c in e.sidecar["channels"]
        )
        rows["stored as"] = f"{e.sidecar['format']} {e.sidecar['subtype']}, full scale: {scales}"
    return rows


def _spec(m: object) -> str:
    return describe(m) if callable(m) else f"array of {len(m)} samples"  # type: ignore[arg-type]


def _model(checks: list[Check], e: Evidence) -> str:
    """Return the law of the scene in words, its numbers, and each block's law."""
    known = {
        f"{p.name}: {ROWS[p.law].words}" if p.name else ROWS[p.law].words: None
        for p in e.scene.parts
        if p.law in ROWS
    }
    own = [
        f"{p.name or 'The scene'}: the law {p.law}, with {dict(p.given or {})}"
        for p in e.scene.parts
        if "." in p.law
    ]
    said = (
        "; ".join([*known, *own]) or "No law of the whole scene is known; these of its blocks are."
    )
    blocks = dict.fromkeys(f"{c.name.split(':')[0]}: {c.text}" for c in checks if c.group == "a2")
    return f"<p>{_q(said)}</p>{items([*e.numbers, *blocks])}"


def _certainty(found: list[Shows]) -> str:
    rows = []
    for s in found:
        none = "none, up to all of it" if s.unit == OF_IT else "none, however large"
        size = f"{s.size:.3g} {s.unit}" if s.size == s.size else none
        rows.append(
            f"<tr><td>{_q(s.check)}</td><td>{_q(s.kind)}</td><td"
            f' class="n">{_q(size)}</td><td>{s.chance:.0%}</td></tr>'
        )
    asked = (
        " The law of the scene was asked again with each of its parameters smaller: by the part"
        " that stands here, and it refuses these samples."
    )
    asked = asked if any(s.unit == OF_IT for s in found) else ""
    head = (
        "<tr><th>check</th><th>what is wrong</th><th>smallest that is seen</th><th>how"
        " surely</th></tr>"
    )
    return (
        "<p>All checks but those of chance are exact: what passes their limit is seen, always."
        " Spectra, independence and slopes are of chance. Together they refuse one correct"
        f" rendering in {1 / ALARM:.0f}, and an error of the size below they see in this recording"
        f" with 95 % or more.{asked}</p><table>{head}{''.join(rows)}</table>"
    )


# Reproduction -------------------------------------------------------------------------
def _reproduced(e: Evidence, command: str | None) -> str:
    """Return instructions to reproduce the rendering.

    They name what to install and where files belong, commands, hashes, versions, and
    the scene as a file.
    """
    used = {
        p: version(p)
        for p in ("stimlib", "numpy", "scipy", "numba", "llvmlite", "soundfile", "matplotlib")
    }
    again = f"<p>Repeat the verification with <code>{_q(command)}</code>.</p>" if command else ""
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
        f" SHA-256.</p>{facts(rows)}<details><summary>scene.json, for"
        f" <code>stimlib.load</code></summary><pre>{_q(text)}</pre></details>"
    )


def _installed(used: Mapping[str, str]) -> str:
    """Return commands for an environment with these versions."""
    python = ".".join(platform.python_version_tuple()[:2])
    pins = " ".join(f"{p}=={v}" for p, v in used.items())
    lines = f"python -m venv proof\n. proof/bin/activate\npip install {pins}"
    windows = "on Windows the second line is <code>proof\\Scripts\\activate</code>"
    return (
        f"<p>Install what this page was made with, under Python {python};"
        f" {windows}:</p><pre>{_q(lines)}</pre>"
    )


def _beside(e: Evidence) -> str:
    """Return which files a reader needs in addition to this page."""
    if e.session:
        return (
            f"<p>Keep the folder of the log, <code>{_q(e.source)}</code>, whole: each of its files"
            " is needed.</p>"
        )
    if e.path is None:
        return ""
    name, beside = _q(e.path.name), _q(sidecar_of(e.path).name)
    own = ", ".join(f"<code>{_q(m)}</code>" for m in definitions(e.scene))
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
    if (
        "__main__" in own
        or any(c.at or c.ramp * e.fs > 1 for c in e.changes)
        or not all(map(_has_text, e.motion.values()))
    ):
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
    return f"<p>Make the samples again:</p><pre>{chr(10).join(map(_q, lines))}</pre>"


def _sha256(parts: Iterable[np.ndarray]) -> str:
    digest = hashlib.sha256()
    for rows in parts:
        digest.update(np.ascontiguousarray(rows, "<f8").data)
    return digest.hexdigest()
