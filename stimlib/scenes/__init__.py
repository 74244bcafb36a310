"""The papers' stimuli and the field's everyday ones, each on one page."""

from .bumps import bumps, bumps_set
from .click import click
from .detents import detents
from .friction import friction
from .grating import grating
from .impact import impact
from .soft_surface import soft_surface
from .squeeze import squeeze
from .texture import texture
from .touch_screen import touch_screen
from .viscoelastic import viscoelastic
from .wall import wall

__all__ = [
    "bumps",
    "bumps_set",
    "click",
    "detents",
    "friction",
    "grating",
    "impact",
    "soft_surface",
    "squeeze",
    "texture",
    "touch_screen",
    "viscoelastic",
    "wall",
]

SHIPPED = {
    "squeeze": squeeze,
    "viscoelastic": viscoelastic,
    "bumps": bumps,
    "grating": grating,
    "texture": texture,
    "click": click,
    "detents": detents,
    "friction": friction,
    "wall": wall,
    "impact": impact,
    "soft_surface": soft_surface,
    "touch_screen": touch_screen,
}
"""What the command line calls a scene, by name; the default of every argument is the
paper's, where there is one.
"""
