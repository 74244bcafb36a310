"""The problems that run time is held against error on."""

from . import filters, hand, materials, noise, surface

ALL = (*noise.PROBLEMS, *filters.PROBLEMS, *materials.PROBLEMS, *surface.PROBLEMS, *hand.PROBLEMS)
