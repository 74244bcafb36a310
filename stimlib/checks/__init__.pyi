from .evidence import Asked as Asked, Check as Check, law_of as law_of
from .mutation import mutate as mutate
from .power import (
    Shows as Shows,
    certainty as certainty,
    of_parameters as of_parameters,
    of_spectrum as of_spectrum,
    smallest_share as smallest_share,
)
from .report import Report as Report
from .session import verify_log as verify_log
from .verification import verify as verify
