from .many import Copies as Copies
from .processor import Processor as Processor
from .processor import compile as compile
from .rendering import Rendering as Rendering
from .rendering import render as render
from .rendering import stream as stream
from .safety import Safety as Safety
from .safety import protect as protect
