"""Looking at a scene, and checking that what it makes is right."""

from .draw import draw

__all__ = ["draw"]
