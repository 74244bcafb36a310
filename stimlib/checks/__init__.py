"""Looking at a scene, and checking that what it makes is right."""

from ..analysis.draw import draw

__all__ = ["draw"]
