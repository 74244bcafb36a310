"""The command line: render, play, verify, show and list scenes; run experiments.

Each group of commands has a module, which is imported when one of them is called.
Module ``app`` has their common code; ``scene`` and ``motions`` interpret SCENE and
--motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import lazy_loader

MODULES = {
    "files": ("demo", "render", "render-set"),
    "play": ("play",),
    "devices": ("devices", "loopback"),
    "export": ("export",),
    "convert": ("convert",),
    "sweeps": ("sweep",),
    "live": ("live", "share"),
    "experiments": ("experiment",),
    "verify": ("verify", "replay", "mutate"),
    "scenes": ("show", "list"),
    "trying": ("try",),
    "schemas": ("schema",),
}
"""The commands of each module, in the order of --help."""


def app_of(words: Sequence[str]) -> Any:
    """Return the app with the module of a command, or with all modules.

    A command line without a command, such as --help, needs all.
    """
    own = [module for module, names in MODULES.items() if words and words[0] in names]
    for module in own or MODULES:
        import_module(f".{module}", __name__)
    return import_module(".app", __name__).app


_get, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"app": ["app"]})


def __getattr__(name: str) -> Any:
    if name == "app":
        app_of(())
    return _get(name)
