"""Looking at signals and scenes: spectra, cues, the AM model, graphs, pictures, copies
for ears.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
