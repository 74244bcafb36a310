"""The command line: render, play, verify, show and list scenes; run experiments.

A module for each group of commands; ``app`` has what they share, ``scene`` and
``motions`` what SCENE and --motion mean.
"""

from . import (  # noqa: I001  each adds its commands, in the order of --help
    files,
    sweeps,
    devices,
    live,
    experiments,
    verify,
    scenes,
    speed,
    schemas,
)
from .app import app

__all__ = [
    "app",
    "devices",
    "experiments",
    "files",
    "live",
    "verify",
    "schemas",
    "scenes",
    "speed",
    "sweeps",
]
