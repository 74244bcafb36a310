"""The blocks that stimuli are composed of: one lower-case function per block."""

from ..core.graph import constant
from ..core.loops import loop
from ..core.pointwise import clip, cos, exp, log, maximum, minimum, nonzero, sin, sqrt, tanh, where
from ..core.subsystems import enabled, segment
from ..design.texture import load_texture, save_texture
from .actuator import force_limit, motor_current, skin_drive, slew_limit, static_limit
from .avatars import delay_avatar, vibration
from .bumps import bump
from .clock import at, elapsed, every, timeline
from .contact import button, detents, squeeze_film, wall
from .creep import (
    compliance,
    compliance_generalized_kelvin_voigt,
    compliance_kelvin_voigt,
    compliance_maxwell,
)
from .cursors import cursor
from .envelopes import burst, envelope
from .equalization import equalize
from .events import count, crossing, deadband, falling, once_within, rising, sample_and_hold
from .filters import bandpass, bandstop, delay, envelope_follower, highpass, lowpass, sos
from .fir_filters import differentiator, fir, moving_average
from .fractional import equal_force, springpot, springpot_stiffness
from .friction import friction, stick_slip
from .impedance import first_order, hysteresis, kelvin_voigt, loading, spring, velocity
from .integrals import active, energy, integrate
from .noise import coloured_noise, pink_noise, pinking, white_noise
from .oscillators import carrier, oscillator, pulse_train
from .resonance import amplifier, mode, mode_shape, notch, pole_swap, resonator, svf
from .series import springpot_series
from .soft import deformation, indentation, press, stiffness_map, triangle
from .sources import band_noise, chirp, grain, playback, ring
from .surfaces import grating, spatial_noise
from .tables import lut, lut2, panning
from .texture import texture
from .tracking import track, track_velocity
from .viscoelastic import generalized_maxwell, maxwell, standard_linear_solid

__all__ = [
    "active",
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
    "coloured_noise",
    "compliance",
    "compliance_generalized_kelvin_voigt",
    "compliance_kelvin_voigt",
    "compliance_maxwell",
    "constant",
    "cos",
    "count",
    "crossing",
    "cursor",
    "deadband",
    "deformation",
    "delay",
    "delay_avatar",
    "detents",
    "differentiator",
    "elapsed",
    "enabled",
    "energy",
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
    "panning",
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
    "squeeze_film",
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
