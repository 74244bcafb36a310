"""What researchers compose: one lower-case function per block."""

from ..core.graph import constant, enabled
from .actuator import force_limit, motor_current, skin_drive, slew_limit, static_limit
from .bump import bump
from .carrier import carrier
from .continuous import equal_force, springpot_stiffness
from .creep import compliance, compliance_generalized_kelvin_voigt, compliance_kelvin_voigt, compliance_maxwell
from .delay import delay
from .equalise import equalize
from .filters import bandpass, bandstop, highpass, lowpass, sos
from .fir import differentiator, fir
from .gate import loading
from .impedance import first_order, kelvin_voigt, spring, velocity
from .maps import clip, cos, exp, log, maximum, minimum, nonzero, sin, sqrt, tanh, where
from .modes import pink_noise, pinking
from .noise import white_noise
from .relaxation import generalized_maxwell, maxwell, standard_linear_solid
from .running import envelope_follower, integrate, moving_average
from .series import springpot_series
from .springpot import springpot
from .svf import notch, resonator, svf
from .table import lut
from .tracking import track, track_velocity

__all__ = [
    "bandpass", "bandstop", "bump", "carrier", "clip", "compliance", "compliance_generalized_kelvin_voigt",
    "compliance_kelvin_voigt", "compliance_maxwell", "constant", "cos", "delay", "differentiator", "enabled",
    "envelope_follower", "equal_force", "equalize", "exp", "fir", "first_order", "force_limit", "generalized_maxwell",
    "highpass", "integrate", "kelvin_voigt", "loading", "log", "lowpass", "lut", "maximum", "maxwell", "minimum",
    "motor_current", "moving_average", "nonzero", "notch", "pink_noise", "pinking", "resonator", "sin", "skin_drive",
    "slew_limit", "sos", "spring", "springpot", "springpot_series", "springpot_stiffness", "sqrt", "standard_linear_solid",
    "static_limit", "svf", "tanh", "track", "track_velocity", "velocity", "where", "white_noise",
]  # fmt: skip
