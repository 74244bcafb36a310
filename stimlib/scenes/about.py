"""What scenes say of themselves to a reader: laws, sources, and meanings of parameters.

The laws and what is felt are in the rows of shipped scenes; the rest is in the
docstrings of the functions that make them.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

from ..core.parts import OWN, Part
from ..core.scene import Scene
from .shipped import ROWS, SHIPPED

PAPERS = {
    "UGrip paper": (
        "A Device and Method for Multimodal Haptic Rendering of Volumetric Stiffness. Our copy"
        " gives no author, year or DOI"
    ),
    "Çaldıran's thesis": (
        "Ozan Çaldıran: Haptic Perception of Viscoelastic Materials. PhD thesis, Koç University,"
        " Graduate School of Sciences and Engineering"
    ),
    "Li et al. (2016)": (
        "M. Li, S. Sareh, G. Xu, M. B. Ridzuan, S. Luo, J. Xie, H. Wurdemann and K. Althoefer:"
        " Evaluation of Pseudo-Haptic Interactions with Soft Objects in Virtual Environments. PLoS"
        " ONE 11(6), e0157681, 2016. doi:10.1371/journal.pone.0157681"
    ),
    "touch-screen thesis": (
        "Haptic Perception of Virtual Bumps Displayed Through a Piezo-Actuated Touch Screen. A"
        " thesis. Our copy gives no author, year or DOI"
    ),
}
"""Papers by the names that docstrings have for them, as docs/reference/papers.rst has
them.
"""
LIVE = re.compile(r", live as (\w+)")
UNIT = re.compile(r"\bin (N s/m|N/m|N/A|m/V|rad/s|m\^2|Hz|dB|rad|[mNsV])(?![\w/^])")
"""The unit of an argument, as its docstring states it."""


def about(scene: Scene) -> dict[str, Any]:
    """Return what a page says of a scene to a reader who has nothing else.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    dict
        ``do``: what to do on a page, after "Press Start and"; ``felt``, ``laws`` and
        ``sources``: lists of what is felt, of laws as the report of ``verify`` has them
        or as the docstring of a law of your own begins, and of papers; ``meanings``: of
        parameters, by name; ``fixed``: name, value with unit and meaning, as texts, of
        each argument that is set when the scene is made. What nothing says is empty.

    Examples
    --------
    >>> from stimlib.scenes import wall
    >>> from stimlib.scenes.about import about
    >>> about(wall())["meanings"]
    {'k': 'Stiffness in N/m.', 'b': 'Damping in N s/m.'}
    >>> about(wall())["fixed"]
    [{'name': 'at', 'value': '0 m', 'meaning': 'Place of the surface in m.'}]
    """
    found: dict[str, Any] = {"do": "", "felt": {}, "laws": {}, "sources": {}, "meanings": {}}
    found["fixed"] = [row for p in scene.parts if p.law in ROWS for row in fixed(p)]
    for part in scene.parts:
        if part.law in ROWS:
            row, sources = ROWS[part.law], _line(sections(SHIPPED[part.law])["References"])
            papers = [f"{n}: {text}." for n, text in PAPERS.items() if n in sources]
            found["do"] = found["do"] or row.do
            found["felt"][row.felt] = found["laws"][row.words] = True
            found["sources"] |= dict.fromkeys(filter(None, [sources, *papers]))
            for name, text in meanings(part.law).items():
                found["meanings"][part.inputs.get(name, name)] = text
        elif part.law in OWN:
            text = inspect.getdoc(OWN[part.law][0]) or ""
            found["laws"] |= dict.fromkeys(
                filter(None, [_line(text.partition("\n\n")[0]).rstrip(".")])
            )
    return {k: list(v) if k in ("felt", "laws", "sources") else v for k, v in found.items()}


def meanings(name: str) -> dict[str, str]:
    """Return what each live parameter of a shipped scene is, from its docstring.

    Examples
    --------
    >>> from stimlib.scenes.about import meanings
    >>> meanings("squeeze")["A"]
    'Vibration gain; 0 skips the noise altogether.'
    """
    live = [(LIVE.search(s), s) for _, sentences in _entries(name) for s in sentences]
    return {m[1]: s.replace(m[0], "") for m, s in live if m}


def fixed(part: Part) -> list[dict[str, str]]:
    """Return the values of a shipped scene that cannot be changed live, with meanings.

    What is None or False is left out: it is not there.  A map or a model has no value.

    Examples
    --------
    >>> from stimlib.scenes import detents
    >>> from stimlib.scenes.about import fixed
    >>> [(row["name"], row["value"]) for row in fixed(detents().parts[0])]
    [('count', '24'), ('presliding', '0.01 rad')]
    """
    given, before = part.given or {}, f"{part.name}." * bool(part.name)
    rows = []
    for names, (first, *_) in _entries(part.law):
        found = UNIT.findall(first)
        units = found if len(found) >= len(names) else (found or [""]) * len(names)
        there = {
            n: _value(given.get(n), unit.replace(" ", "·").replace("^2", "²"))
            for n, unit in zip(names, units, strict=False)
            if not LIVE.search(first)
        }
        values = ", ".join(filter(None, there.values()))
        if values or any(isinstance(given.get(n), dict | list) for n in there):
            meaning = re.sub(r"[;,] see [\w.]+( and [\w.]+)?(?=[;.])", "", first)
            meaning = meaning.replace("m^2", "m²")
            rows.append({"name": before + ", ".join(there), "value": values, "meaning": meaning})
    return rows


def _value(v: Any, unit: str) -> str:
    if v is None or isinstance(v, bool | str):
        return "yes" if v is True else v or ""
    return f"{v:g} {unit}".rstrip() if isinstance(v, int | float) else ""


def _entries(name: str) -> Iterator[tuple[list[str], list[str]]]:
    """Yield the names and the sentences of each entry of a docstring's parameters."""
    for entry in re.split(r"^(?=\w)", sections(SHIPPED[name])["Parameters"], flags=re.M)[1:]:
        head, _, text = entry.partition("\n")
        names = head.partition(" : ")[0].split(", ")
        yield names, re.split(r"(?<=[^.]\.) ", _line(text))


def sections(function: Callable[..., Any]) -> dict[str, str]:
    """Return the sections of a numpydoc docstring by their titles."""
    # python -OO has taken it away, but not from the source
    text = inspect.getdoc(function) or ast.get_docstring(
        ast.parse(inspect.getsource(function)).body[0]  # type: ignore[arg-type]
    )
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", text or "", flags=re.M)
    return {"Parameters": "", "References": ""} | dict(zip(parts[1::2], parts[2::2], strict=True))


def _line(text: str) -> str:
    """Return a text in one line, without marks of code."""
    return " ".join(text.replace("``", "").split())
