from .generators import (
    constant_speed as constant_speed,
    jittered as jittered,
    minimum_jerk as minimum_jerk,
    quantised as quantised,
    ramp_and_hold as ramp_and_hold,
    sinusoid as sinusoid,
    staircase_hold as staircase_hold,
)
from .recorded import Recording as Recording, parse_source as parse_source, recording as recording
from .text import parse_map as parse_map, parse_motion as parse_motion, parse_where as parse_where
