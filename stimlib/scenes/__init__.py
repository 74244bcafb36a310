"""Shipped scenes: stimuli from papers and everyday ones, one page each.

A module of a scene is named here once; what else is said of a scene stands in its row
(`stimlib.scenes.shipped`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
