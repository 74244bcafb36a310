"""Look-up, by name, of functions in higher-level modules that lower ones call.

``stimlib/__init__.py`` lists the module of each function. A scene that shows itself
needs drawings, and a rendering that saves itself needs sound files; both are plain data
that do not import those modules.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

PLACES: dict[str, str] = {}


def above(name: str) -> Any:
    """Import and return the public object that is registered under a name.

    Examples
    --------
    >>> from stimlib.above import above
    >>> above("Scene.live").__name__
    'show'
    """
    module, _, attribute = PLACES[name].partition(":")
    return getattr(import_module(module), attribute)
