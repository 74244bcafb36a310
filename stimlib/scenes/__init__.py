"""The papers' stimuli, each on one page that reads like the paper."""

from .bumps import bumps, bumps_set
from .grating import grating
from .squeeze import squeeze
from .texture import texture
from .viscoelastic import viscoelastic

__all__ = ["bumps", "bumps_set", "grating", "squeeze", "texture", "viscoelastic"]

SHIPPED = {"squeeze": squeeze, "viscoelastic": viscoelastic, "bumps": bumps, "grating": grating, "texture": texture}
"""What the command line calls a scene, by name; the default of every argument is the paper's."""
