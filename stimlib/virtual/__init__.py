"""A device and a hand that exist in the computer alone: scenes in a closed loop."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
