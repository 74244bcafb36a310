"""Plates that a finger touches: their modes, drive patches and measurements."""

from .electrical import AmplifierLoad, amplifier_load
from .envelope import Answer, best_gain, envelope_behind, half_sine
from .fit import FrameFit, fit_frame
from .identify import Drift, Resonance, Sweep, drift, identify, read_sweep
from .model import CONFIGURATIONS, Plate
from .patch import Patch
from .placement import Placement, best_patches
from .profile import mode_fit
from .vibrate import Finger, plate

__all__ = [
    "CONFIGURATIONS",
    "AmplifierLoad",
    "Answer",
    "Drift",
    "Finger",
    "FrameFit",
    "Patch",
    "Placement",
    "Plate",
    "Resonance",
    "Sweep",
    "amplifier_load",
    "best_gain",
    "best_patches",
    "drift",
    "envelope_behind",
    "fit_frame",
    "half_sine",
    "identify",
    "mode_fit",
    "plate",
    "read_sweep",
]
