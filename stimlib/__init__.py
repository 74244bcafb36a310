"""Compose, play and verify haptic stimuli.

>>> import stimlib
>>> x = stimlib.Input("x", "m")
>>> stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * x})
Scene(x [m] -> force [N])
"""

import logging

import lazy_loader

from .above import PLACES
from .version import __version__ as __version__

# silent, unless a program wants to hear it
logging.getLogger(__name__).addHandler(logging.NullHandler())

# __init__.pyi says which name is in which module; each is imported on first use
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

PLACES.update(
    {
        "blocks": "stimlib:blocks",
        "SHIPPED": "stimlib.scenes:SHIPPED",
        "Scene.live": "stimlib.live.notebook:show",
        "Sink.follow": "stimlib.devices.crossfade:follow",
        "Scene._repr_html_": "stimlib.analysis.draw:html_of",
        "Rendering._repr_html_": "stimlib.analysis.overview:html_of",
        "Rendering.felt": "stimlib.analysis.thresholds:felt",
        "Rendering.play": "stimlib.devices.playing:play",
        "Rendering.plot": "stimlib.analysis.overview:figure",
        "Rendering.save": "stimlib.files.audio:save",
    }
)
