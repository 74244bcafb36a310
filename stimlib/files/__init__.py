"""What is kept: audio files with their sidecars, logs of sessions, sets of files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
