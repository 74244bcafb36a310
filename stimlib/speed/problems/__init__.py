"""The problems that run time is held against error on."""

from . import hand, materials, noise, surface

ALL = (*noise.PROBLEMS, *materials.PROBLEMS, *surface.PROBLEMS, *hand.PROBLEMS)
