"""What researchers compose: one lower-case function per block."""

from ..graph import constant, enabled
from .actuator import force_limit, motor_current, skin_drive, static_limit
from .delay import delay
from .fir import differentiator, fir
from .gate import loading
from .impedance import first_order, kelvin_voigt, spring, velocity
from .maps import clip, cos, exp, log, maximum, minimum, nonzero, sin, sqrt, tanh, where
from .modes import pink_noise, pinking
from .noise import white_noise
from .table import lut
from .tracking import track, track_velocity

__all__ = [
    "clip", "constant", "cos", "delay", "differentiator", "enabled", "exp", "fir", "first_order", "force_limit",
    "kelvin_voigt", "loading", "log", "lut", "maximum", "minimum", "motor_current", "nonzero", "pink_noise",
    "pinking", "sin", "skin_drive", "spring", "sqrt", "static_limit", "tanh", "track", "track_velocity", "velocity",
    "where", "white_noise",
]  # fmt: skip
