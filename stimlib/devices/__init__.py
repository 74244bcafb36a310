"""Sinks that play scenes on devices, and sources of motion in real time."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
