"""Optional packages that stimlib can use but does not require."""

from __future__ import annotations

import importlib
from typing import Any

from ..errors import MissingPackage

EXTRAS = {
    "fit": ("jax", "optax"),
    "plot": ("matplotlib",),
    "sweep": ("pyarrow", "cloudpickle", "distributed"),
    "live": ("starlette", "uvicorn", "websockets"),
    "experiments": ("statsmodels", "pandas"),
    "lab": ("pylsl", "serial", "pyxdf", "c3d"),
}
"""Modules that ``pip install 'stimlib[NAME]'`` brings, of what `package` imports."""

PROJECTS = {"serial": "pyserial"}
"""What pip calls a module's package, where it is not the module's name."""


def package(module: str, what: str) -> Any:
    """Import a module of an optional package, or raise MissingPackage.

    Parameters
    ----------
    module : str
        As ``import`` has it.
    what : str
        What needs it, as the error begins.

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
        extra = next((e for e, names in EXTRAS.items() if name in names), None)
        name = PROJECTS.get(name, name)
        remedy = f"pip install 'stimlib[{extra}]'" if extra else f"pip install {name}"
        raise MissingPackage(
            f"{what} needs the package {name}, which cannot be imported ({e}): {remedy}"
        ) from None


def plain_style(**more: Any) -> Any:
    """Return a context in which matplotlib draws in its own style, not in the user's.

    Parameters
    ----------
    **more
        Settings, with ``_`` for the dots in their names.

    Examples
    --------
    >>> import matplotlib
    >>> from stimlib.system.packages import plain_style
    >>> with plain_style(font_size=9):
    ...     matplotlib.rcParams["font.size"]
    9.0
    """
    mpl = package("matplotlib", "a picture")
    # a program that has chosen a backend keeps it; dict.items: no warning of old names
    plain = {k: v for k, v in dict.items(mpl.rcParamsDefault) if not k.startswith("backend")}
    return mpl.rc_context(plain | {k.replace("_", "."): v for k, v in more.items()})
