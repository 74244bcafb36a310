"""The command line: render, play, verify, show and list scenes; run experiments.

Each group of commands has a module. Module ``app`` has their common code; ``scene`` and
``motions`` interpret SCENE and --motion.
"""

from . import (  # noqa: I001  each adds its commands, in the order of --help
    files,
    play,
    devices,
    export,
    convert,
    sweeps,
    live,
    experiments,
    verify,
    scenes,
    trying,
    schemas,
)
from .app import app

__all__ = [
    "app",
    "convert",
    "devices",
    "experiments",
    "export",
    "files",
    "live",
    "play",
    "verify",
    "schemas",
    "scenes",
    "sweeps",
    "trying",
]
