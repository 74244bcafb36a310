"""Experiments: designs, trials that are scenes, sessions that lose nothing, and what
people answered.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
