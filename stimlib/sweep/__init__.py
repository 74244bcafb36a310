"""Sweeps: one scene, many rows of numbers, a few figures of each rendering.

They run on this machine or on a Dask cluster.
"""

from .measures import measure, measured
from .rows import grid
from .study import Forecast, rendering, sweep

__all__ = ["Forecast", "grid", "measure", "measured", "rendering", "sweep"]
