from . import (
    analysis as analysis,
    blocks as blocks,
    checks as checks,
    core as core,
    design as design,
    devices as devices,
    experiments as experiments,
    files as files,
    fitting as fitting,
    motion as motion,
    plate as plate,
    run as run,
    scenes as scenes,
    soft as soft,
    sweep as sweep,
)
from .analysis.draw import draw as draw
from .checks.verification import verify as verify
from .core.graph import Block as Block, Input as Input, constant as constant
from .core.parameter import Param as Param
from .core.scene import Scene as Scene, load as load
from .core.subsystems import enabled as enabled
from .errors import (
    BadValue as BadValue,
    FaultError as FaultError,
    MissingPackage as MissingPackage,
    MotionError as MotionError,
    RecordingError as RecordingError,
    SceneError as SceneError,
    SceneFileError as SceneFileError,
    SinkError as SinkError,
    StimlibError as StimlibError,
    UnitError as UnitError,
    UnknownName as UnknownName,
)
from .fitting.relaxation import (
    fit_generalized_maxwell as fit_generalized_maxwell,
    fit_springpot as fit_springpot,
)
from .fitting.scene import fit as fit
from .run.processor import Processor as Processor, compile as compile
from .run.rendering import Rendering as Rendering, render as render, stream as stream
from .system.limits import limits as limits

__version__: str
