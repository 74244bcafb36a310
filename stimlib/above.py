"""Functions of upper rooms that lower ones call, by name.

``stimlib/__init__.py`` states where each of them is.
A scene that shows itself needs drawings, and a rendering that saves itself needs
sound files; both are plain data below those rooms.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

PLACES: dict[str, str] = {}


def above(name: str) -> Any:
    """Return what the package registered under a name; its module is imported now.

    Examples
    --------
    >>> from stimlib.above import above
    >>> above("Scene.live").__name__
    'show'
    """
    module, _, attribute = PLACES[name].partition(":")
    return getattr(import_module(module), attribute)
