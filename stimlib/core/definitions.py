"""The source texts of a user's own blocks and laws, and their hashes in a record.

The record is for the reader; nothing runs it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..errors import public
from ..system import fields
from .graph import Block, reach, type_name
from .parts import OWN, known

if TYPE_CHECKING:
    from .scene import Scene

TEST = fields.table_of(fields.record({"sha256": fields.text, "text": fields.text}))


@public
def definitions(scene: Scene) -> dict[str, dict[str, str]]:
    """Return the source files that define a scene's own blocks and laws.

    They are the texts that Python read when it imported them.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    dict of str to dict
        By module of a class, or of one that it derives from: ``text``, its whole file
        or notebook cell with the helpers and constants there, and its ``sha256``.
        Nothing for blocks of stimlib, whose text follows from the version. The text is
        "" where Python has kept none.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.core.definitions import definitions
    >>> definitions(stimlib.scenes.squeeze())
    {}
    """
    return {module: {"sha256": _sha256(text), "text": text} for module, text in _own(scene).items()}


def hashes(recorded: Mapping[str, Any], scene: Any) -> tuple[dict[str, str], dict[str, str]]:
    """Return the hashes that a record states, and those that it must have.

    They are the hashes of the source texts of the modules that define the scene's own
    blocks.

    The text of a law is included if the law was known to the program that wrote the
    record; its reader need not know it.
    """
    laws = {
        module
        for module in recorded
        if any(part.law.startswith(f"{module}.") for part in scene.parts)
    }
    needed = {
        module: _sha256(recorded[module]["text"] if module in recorded else "")
        for module in {*_blocks(scene), *laws}
    }
    return {module: d["sha256"] for module, d in recorded.items()}, needed


def changed(recorded: Mapping[str, Any], scene: Any) -> list[str]:
    """Return one line for each module whose text differs from the recorded one."""
    lines = []
    for module, own in definitions(scene).items():
        now, before = own["sha256"], recorded.get(module, own)["sha256"]
        if now != before:
            lines.append(
                f"own blocks of {module}: the file is not the one that was recorded (sha256"
                f" {now[:12]}, and not {before[:12]}); its text is kept under definitions"
            )
    return lines


def _own(scene: Any) -> dict[str, str]:
    """Return the sources of modules outside stimlib that define blocks or laws."""
    laws = sorted(part.law for part in scene.parts if known(part.law))
    return {OWN[name][0].__module__: OWN[name][1] for name in laws} | _blocks(scene)


def _blocks(scene: Any) -> dict[str, str]:
    """Return the sources of modules outside stimlib that define the scene's blocks.

    Base classes of the blocks are included.
    """
    kinds = {
        type_name(k): k
        for b in reach(scene.outputs.values())
        for k in type(b).__mro__
        if issubclass(k, Block)
    }
    return {kinds[name].__module__: kinds[name].source for name in sorted(kinds) if "." in name}


def _sha256(text: str) -> str:
    # a file of others may have half a character
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
