"""Soft objects on a screen: stiffness maps, and pictures of a surface that gives way."""

from ..blocks.stiffness import Levels
from .maps import BLOCK, SIDES, THIRTEEN, array, block, image, nodules, sides
from .surface import film, picture, surface

__all__ = ["BLOCK", "SIDES", "THIRTEEN", "Levels", "array", "block", "film", "image", "nodules", "picture", "sides", "surface"]
