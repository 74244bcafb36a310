"""Packages that stimlib can use and does not depend on."""

from __future__ import annotations

import importlib
from typing import Any

from ..errors import MissingPackage


def package(module: str, what: str, install: str = "") -> Any:
    """Import a module of an optional package, or raise MissingPackage.

    Parameters
    ----------
    module : str
        As ``import`` has it.
    what : str
        What needs it, as the error begins.
    install : str
        What ``pip install`` is to be given; by default the package's own name.

    Raises
    ------
    MissingPackage
        It cannot be imported; the message has the command that installs it.

    Examples
    --------
    >>> from stimlib.system.packages import package
    >>> package("json", "an example").dumps([1])
    '[1]'
    """
    try:
        return importlib.import_module(module)
    except ImportError as e:
        name = module.partition(".")[0].lower()
        remedy = f"pip install {install or name}"
        raise MissingPackage(
            f"{what} needs the package {name}, which cannot be imported ({e}): {remedy}"
        ) from None
