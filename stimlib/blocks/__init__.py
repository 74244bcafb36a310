"""What researchers compose: one lower-case function per block."""

from ..core.graph import constant, enabled, segment
from ..core.loops import loop
from ..core.pointwise import clip, cos, exp, log, maximum, minimum, nonzero, sin, sqrt, tanh, where
from ..design.texture_file import load_texture, save_texture
from .actuator import force_limit, motor_current, skin_drive, slew_limit, static_limit
from .avatar import delay_avatar, vibration
from .bump import bump
from .carrier import carrier
from .clock import at, elapsed, every, timeline
from .continuous import equal_force, springpot_stiffness
from .creep import (
    compliance,
    compliance_generalized_kelvin_voigt,
    compliance_kelvin_voigt,
    compliance_maxwell,
)
from .cursor import cursor
from .delay import delay
from .envelopes import burst, envelope
from .equalise import equalize
from .events import count, crossing, falling, once_within, rising, sample_and_hold
from .filters import bandpass, bandstop, highpass, lowpass, sos
from .fir import differentiator, fir
from .gate import hysteresis, loading
from .grid import lut2
from .impedance import first_order, kelvin_voigt, spring, velocity
from .indenter import deformation, indentation, press, triangle
from .modes import pink_noise, pinking
from .noise import white_noise
from .oscillators import oscillator, pulse_train
from .places import grating, spatial_noise
from .plates import amplifier, mode, mode_shape, pole_swap
from .relaxation import generalized_maxwell, maxwell, standard_linear_solid
from .running import envelope_follower, integrate, moving_average
from .series import springpot_series
from .sliding import friction, stick_slip
from .sources import band_noise, chirp, playback
from .springpot import springpot
from .stiffness import stiffness_map
from .svf import notch, resonator, svf
from .table import lut
from .texture import texture
from .touching import button, detents, wall
from .tracking import track, track_velocity
from .transients import grain, ring

__all__ = [
    "amplifier",
    "at",
    "band_noise",
    "bandpass",
    "bandstop",
    "bump",
    "burst",
    "button",
    "carrier",
    "chirp",
    "clip",
    "compliance",
    "compliance_generalized_kelvin_voigt",
    "compliance_kelvin_voigt",
    "compliance_maxwell",
    "constant",
    "cos",
    "count",
    "crossing",
    "cursor",
    "deformation",
    "delay",
    "delay_avatar",
    "detents",
    "differentiator",
    "elapsed",
    "enabled",
    "envelope",
    "envelope_follower",
    "equal_force",
    "equalize",
    "every",
    "exp",
    "falling",
    "fir",
    "first_order",
    "force_limit",
    "friction",
    "generalized_maxwell",
    "grain",
    "grating",
    "highpass",
    "hysteresis",
    "indentation",
    "integrate",
    "kelvin_voigt",
    "load_texture",
    "loading",
    "log",
    "loop",
    "lowpass",
    "lut",
    "lut2",
    "maximum",
    "maxwell",
    "minimum",
    "mode",
    "mode_shape",
    "motor_current",
    "moving_average",
    "nonzero",
    "notch",
    "once_within",
    "oscillator",
    "pink_noise",
    "pinking",
    "playback",
    "pole_swap",
    "press",
    "pulse_train",
    "resonator",
    "ring",
    "rising",
    "sample_and_hold",
    "save_texture",
    "segment",
    "sin",
    "skin_drive",
    "slew_limit",
    "sos",
    "spatial_noise",
    "spring",
    "springpot",
    "springpot_series",
    "springpot_stiffness",
    "sqrt",
    "standard_linear_solid",
    "static_limit",
    "stick_slip",
    "stiffness_map",
    "svf",
    "tanh",
    "texture",
    "timeline",
    "track",
    "track_velocity",
    "triangle",
    "velocity",
    "vibration",
    "wall",
    "where",
    "white_noise",
]
