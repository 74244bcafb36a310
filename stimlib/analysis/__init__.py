"""Views of signals and scenes: spectra, cues, graphs, pictures, listening copies."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
