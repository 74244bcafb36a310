"""Sweeps: render a scene for many rows of numbers, and keep a few figures of each.

A sweep runs on this machine, or on any executor.
"""

from .measures import measure, measured
from .rows import grid
from .study import Forecast, rendering, sweep

__all__ = ["Forecast", "grid", "measure", "measured", "rendering", "sweep"]
