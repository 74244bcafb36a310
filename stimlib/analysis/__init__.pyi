from .draw import Drawing as Drawing
from .listening import listen as listen, vibration as vibration
from .overview import Against as Against, picture as picture
from .passivity import damping_of as damping_of, needed_damping as needed_damping
from .physical_cues import Cues as Cues, cues as cues, cues_of as cues_of
from .spectra import judged as judged, tail as tail
from .thresholds import (
    Apart as Apart,
    Felt as Felt,
    detection_threshold as detection_threshold,
    difference_steps as difference_steps,
    felt as felt,
    sensation_level as sensation_level,
)
from .vibration_exposure import weighted_rms as weighted_rms, weighting as weighting
