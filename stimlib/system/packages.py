"""Optional packages that stimlib can use but does not require."""

from __future__ import annotations

import importlib
import sys
from importlib.util import find_spec, module_from_spec
from types import ModuleType
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


class _Part(ModuleType):
    """A package whose own code runs when more of it is asked for than there is."""

    def __getattr__(self, name: str) -> Any:
        spec: Any = self.__spec__
        self.__class__, self.__path__ = ModuleType, spec.submodule_search_locations  # type: ignore
        spec.loader.exec_module(self)
        return getattr(self, name)


def in_part(package: str, part: str) -> None:
    """Import one compiled module of a package, and all of it once more is needed.

    ``scipy.special`` and ``scipy.linalg`` take a fifth of the time of ``stimlib
    verify``, mostly for arrays of other libraries; one module of each has what it
    needs. Only for a process with one thread: others could find the package half made.

    Examples
    --------
    >>> import scipy.special
    >>> from stimlib.system.packages import in_part
    >>> in_part("scipy.special", "_ufuncs")  # it is there: nothing is done
    >>> scipy.special.ndtr(0.0)
    np.float64(0.5)
    """
    if package not in sys.modules:
        spec: Any = find_spec(package)
        made: Any = sys.modules.setdefault(package, module_from_spec(spec))
        there = importlib.import_module(f"{package}.{part}")
        vars(made).update({n: getattr(there, n) for n in getattr(there, "__all__", ())})
        made.__class__ = _Part
        del made.__path__  # so whoever imports another module of it comes to its code first
