from .closed_form import (
    maxwell_force as maxwell_force,
    mittag_leffler as mittag_leffler,
    springpot_force as springpot_force,
    springpot_series_force as springpot_series_force,
    thin as thin,
)
from .relaxation import (
    MaterialFit as MaterialFit,
    MaxwellFit as MaxwellFit,
    SpringpotFit as SpringpotFit,
    fit_generalized_maxwell as fit_generalized_maxwell,
    fit_springpot as fit_springpot,
)
from .scene import fit as fit, welch as welch
from .texture import TextureFit as TextureFit, fit_texture as fit_texture
