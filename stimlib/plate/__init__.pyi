from .electrical import AmplifierLoad as AmplifierLoad, amplifier_load as amplifier_load
from .envelope import (
    Answer as Answer,
    best_gain as best_gain,
    envelope_behind as envelope_behind,
    half_sine as half_sine,
)
from .fit import FrameFit as FrameFit, fit_frame as fit_frame
from .identify import (
    Drift as Drift,
    Resonance as Resonance,
    Sweep as Sweep,
    drift as drift,
    identify as identify,
    read_sweep as read_sweep,
)
from .model import CONFIGURATIONS as CONFIGURATIONS, Plate as Plate
from .patch import Patch as Patch
from .placement import Placement as Placement, best_patches as best_patches
from .profile import mode_fit as mode_fit
from .vibrate import Finger as Finger, plate as plate
