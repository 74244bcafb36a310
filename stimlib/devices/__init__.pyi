from .available import (
    Device as Device,
    Kind as Kind,
    devices as devices,
    first_ready as first_ready,
    make as make,
    option as option,
)
from .calibration import (
    Calibration as Calibration,
    calibrate as calibrate,
    check_level as check_level,
    load_calibration as load_calibration,
)
from .control import ControlLoop as ControlLoop
from .jack import JackSink as JackSink
from .jack_loopback import Loopback as Loopback, loopback as loopback
from .markers import Marker as Marker
from .motor import MotorCalibration as MotorCalibration, calibrate_motor as calibrate_motor
from .nidaq import NidaqSink as NidaqSink
from .null import NullSink as NullSink
from .playing import play as play
from .portaudio import PortAudioSink as PortAudioSink
from .resonance import record_sweep as record_sweep
from .session import SessionReport as SessionReport
from .sink import Sink as Sink
from .sources import (
    Live as Live,
    Recorded as Recorded,
    Scripted as Scripted,
    Signal as Signal,
    Signals as Signals,
    Stream as Stream,
)
from .transports import (
    byte_markers as byte_markers,
    lsl_markers as lsl_markers,
    lsl_motion as lsl_motion,
    lsl_streams as lsl_streams,
    osc_markers as osc_markers,
    osc_motion as osc_motion,
    parallel_markers as parallel_markers,
    receiver as receiver,
    sender as sender,
    serial_markers as serial_markers,
    serial_motion as serial_motion,
    udp_markers as udp_markers,
    udp_motion as udp_motion,
)
