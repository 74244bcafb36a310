from .actuator import (
    force_limit as force_limit,
    motor_current as motor_current,
    skin_drive as skin_drive,
    slew_limit as slew_limit,
    static_limit as static_limit,
)
from .avatars import delay_avatar as delay_avatar, vibration as vibration
from .bumps import bump as bump
from .clock import at as at, elapsed as elapsed, every as every, timeline as timeline
from .contact import (
    button as button,
    detents as detents,
    squeeze_film as squeeze_film,
    wall as wall,
)
from .creep import (
    compliance as compliance,
    compliance_generalized_kelvin_voigt as compliance_generalized_kelvin_voigt,
    compliance_kelvin_voigt as compliance_kelvin_voigt,
    compliance_maxwell as compliance_maxwell,
)
from .cursors import cursor as cursor
from .envelopes import burst as burst, envelope as envelope
from .equalization import equalize as equalize
from .events import (
    count as count,
    crossing as crossing,
    deadband as deadband,
    falling as falling,
    once_within as once_within,
    rising as rising,
    sample_and_hold as sample_and_hold,
)
from .filters import (
    bandpass as bandpass,
    bandstop as bandstop,
    delay as delay,
    envelope_follower as envelope_follower,
    highpass as highpass,
    lowpass as lowpass,
    sos as sos,
)
from .fir_filters import (
    differentiator as differentiator,
    fir as fir,
    moving_average as moving_average,
)
from .fractional import (
    equal_force as equal_force,
    springpot as springpot,
    springpot_stiffness as springpot_stiffness,
)
from .friction import friction as friction, stick_slip as stick_slip
from .impedance import (
    first_order as first_order,
    hysteresis as hysteresis,
    kelvin_voigt as kelvin_voigt,
    loading as loading,
    spring as spring,
    velocity as velocity,
)
from .integrals import active as active, energy as energy, integrate as integrate
from .noise import (
    coloured_noise as coloured_noise,
    pink_noise as pink_noise,
    pinking as pinking,
    white_noise as white_noise,
)
from .oscillators import carrier as carrier, oscillator as oscillator, pulse_train as pulse_train
from .resonance import (
    amplifier as amplifier,
    mode as mode,
    mode_shape as mode_shape,
    notch as notch,
    pole_swap as pole_swap,
    resonator as resonator,
    svf as svf,
)
from .series import springpot_series as springpot_series
from .soft import (
    deformation as deformation,
    indentation as indentation,
    press as press,
    stiffness_map as stiffness_map,
    triangle as triangle,
)
from .sources import (
    band_noise as band_noise,
    chirp as chirp,
    grain as grain,
    playback as playback,
    ring as ring,
)
from .surfaces import grating as grating, spatial_noise as spatial_noise
from .tables import lut as lut, lut2 as lut2, panning as panning
from .texture import load_texture as load_texture, save_texture as save_texture, texture as texture
from .tracking import track as track, track_velocity as track_velocity
from .viscoelastic import (
    generalized_maxwell as generalized_maxwell,
    maxwell as maxwell,
    standard_linear_solid as standard_linear_solid,
)
from .vocabulary import (
    clip as clip,
    constant as constant,
    cos as cos,
    enabled as enabled,
    exp as exp,
    log as log,
    loop as loop,
    maximum as maximum,
    minimum as minimum,
    nonzero as nonzero,
    segment as segment,
    sin as sin,
    sqrt as sqrt,
    tanh as tanh,
    where as where,
)
