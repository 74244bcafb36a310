"""What scenes say of themselves to a reader: laws, sources, and meanings of parameters.

The laws and what is felt are in the rows of shipped scenes; the rest is in the
docstrings of the functions that make them.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

from ..core.parts import OWN
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
        parameters, by name. What nothing says is empty.

    Examples
    --------
    >>> from stimlib.scenes import wall
    >>> from stimlib.scenes.about import about
    >>> about(wall())["meanings"]
    {'k': 'Stiffness in N/m.', 'b': 'Damping in N s/m.'}
    """
    found: dict[str, Any] = {"do": "", "felt": {}, "laws": {}, "sources": {}, "meanings": {}}
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
    sentences = [
        sentence
        for entry in re.split(r"^(?=\S)", sections(SHIPPED[name])["Parameters"], flags=re.M)
        for sentence in re.split(r"(?<=\.) ", _line(entry.partition("\n")[2]))
    ]
    live = [(LIVE.search(s), s) for s in sentences]
    return {m[1]: s.replace(m[0], "") for m, s in live if m}


def sections(function: Callable[..., Any]) -> dict[str, str]:
    """Return the sections of a numpydoc docstring by their titles."""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", inspect.getdoc(function) or "", flags=re.M)
    return {"Parameters": "", "References": ""} | dict(zip(parts[1::2], parts[2::2], strict=True))


def _line(text: str) -> str:
    """Return a text in one line, without marks of code."""
    return " ".join(text.replace("``", "").split())
