"""Laws of blocks and of scenes, one module per family, as in ``stimlib.blocks``.

Each law is entered where it is defined; importing the package enters all of them.
"""

from . import (
    contact as contact,
    events as events,
    filters as filters,
    fractional as fractional,
    graph as graph,
    impedance as impedance,
    noise as noise,
    oscillators as oscillators,
    pointwise as pointwise,
    resonance as resonance,
    soft as soft,
    sources as sources,
    surfaces as surfaces,
    tables as tables,
    texture as texture,
    viscoelastic as viscoelastic,
)
