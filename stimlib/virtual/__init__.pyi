from .closed_loop import (
    ClosedLoop as ClosedLoop,
    margin as margin,
    swept_damping as swept_damping,
    try_on as try_on,
)
from .device import (
    Device as Device,
    Faults as Faults,
    Hand as Hand,
    read_device as read_device,
)
from .smooth import smooth as smooth
