"""stimlib: haptic stimuli composed from small pure blocks, compiled into a streaming
processor.

>>> import stimlib
>>> x = stimlib.Input("x", "m")
>>> stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * x})
Scene(x [m] -> force [N])
"""

import importlib
import logging
from typing import TYPE_CHECKING, Any

from .above import PLACES
from .version import __version__ as __version__

# silent, unless a program wants to hear it
logging.getLogger(__name__).addHandler(logging.NullHandler())

_HOME = {
    "Block": "core.graph",
    "Input": "core.graph",
    "Param": "core.graph",
    "constant": "core.graph",
    "enabled": "core.graph",
    "Scene": "core.scene",
    "load": "core.scene",
    "compile": "run.processor",
    "Processor": "run.processor",
    "verify": "checks.verify",
    "fit_springpot": "fitting.relaxation",
    "fit_generalized_maxwell": "fitting.relaxation",
    "fit": "fitting.scene",
    "render": "run.rendering",
    "Rendering": "run.rendering",
    "stream": "run.rendering",
    "limits": "system.limits",
    "draw": "analysis.draw",
    "StimlibError": "errors",
    "BadValue": "errors",
    "UnitError": "errors",
    "SceneError": "errors",
    "SceneFileError": "errors",
    "SinkError": "errors",
    "FaultError": "errors",
    "UnknownName": "errors",
    "RecordingError": "errors",
    "MissingPackage": "errors",
}
_ROOMS = (
    "core",
    "design",
    "blocks",
    "soft",
    "scenes",
    "motion",
    "run",
    "plate",
    "files",
    "devices",
    "fitting",
    "analysis",
    "checks",
    "sweep",
    "experiments",
)

__all__ = [*_HOME, *_ROOMS]

if TYPE_CHECKING:
    from . import (
        analysis,
        blocks,
        checks,
        core,
        design,
        devices,
        experiments,
        files,
        fitting,
        motion,
        plate,
        run,
        scenes,
        soft,
        sweep,
    )
    from .analysis.draw import draw
    from .checks.verify import verify
    from .core.graph import Block, Input, Param, constant, enabled
    from .core.scene import Scene, load
    from .errors import (
        BadValue,
        FaultError,
        MissingPackage,
        RecordingError,
        SceneError,
        SceneFileError,
        SinkError,
        StimlibError,
        UnitError,
        UnknownName,
    )
    from .fitting.relaxation import fit_generalized_maxwell, fit_springpot
    from .fitting.scene import fit
    from .run.processor import Processor, compile
    from .run.rendering import Rendering, render, stream
    from .system.limits import limits


PLACES.update(
    {
        "blocks": "stimlib:blocks",
        "SHIPPED": "stimlib.scenes:SHIPPED",
        "Scene.live": "stimlib.live.notebook:show",
        "Scene._repr_html_": "stimlib.analysis.draw:html_of",
        "Rendering._repr_html_": "stimlib.analysis.picture:html_of",
        "Rendering.plot": "stimlib.analysis.picture:figure",
        "Rendering.save": "stimlib.files.audio:save",
    }
)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    elif name in _ROOMS:
        value = importlib.import_module(f".{name}", __name__)
    else:
        raise AttributeError(f"module 'stimlib' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
