from .many import Copies as Copies
from .processor import Processor as Processor, compile as compile
from .rendering import Rendering as Rendering, render as render, stream as stream
from .safety import (
    Inverse as Inverse,
    Passivity as Passivity,
    Safety as Safety,
    protect as protect,
)
