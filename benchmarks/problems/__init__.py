"""The problems that run time is held against error on."""

from . import events, filters, friction, hand, materials, noise, places, series, sources, surface

ROOMS = noise, filters, sources, events, materials, series, surface, places, friction, hand
ALL = tuple(problem for module in ROOMS for problem in module.PROBLEMS)
