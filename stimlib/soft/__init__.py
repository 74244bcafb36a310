"""Soft objects on a screen: stiffness maps, and pictures of the deformed surface."""

from ..blocks.soft import Levels
from .maps import BLOCK, SIDES, THIRTEEN, array, block, buried, image, nodules, sides
from .surface import film, picture, surface

__all__ = [
    "BLOCK",
    "SIDES",
    "THIRTEEN",
    "Levels",
    "array",
    "block",
    "buried",
    "film",
    "image",
    "nodules",
    "picture",
    "sides",
    "surface",
]
