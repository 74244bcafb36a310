"""The packages that reach a device, each imported when it is asked for.

They are asked for by sinks, and by ``stimlib devices``, which needs no sink for it.
"""

from __future__ import annotations

import atexit
from collections import deque
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any

from ..errors import SinkError
from .process import close_all, keep_loaded

JACK = (
    "pip install 'stimlib[jack]' and, on Debian or Ubuntu, apt-get install jackd2 libjack-jackd2-0"
)
PORTAUDIO = (
    "pip install 'stimlib[portaudio]' and, on Debian or Ubuntu, apt-get install libportaudio2"
)
NIDAQ = "install NI-DAQmx, the vendor's driver, and pip install nidaqmx"

SAID: deque[str] = deque(maxlen=20)
"""What libjack would print."""


@cache
def _keep_from_printing(jack: ModuleType) -> None:
    """Take what libjack says, once.

    JACK-Client frees the function before when it takes another, and a thread of libjack
    that was about to call it ends the process.
    """
    keep_loaded(jack._libname)
    jack.set_error_function(SAID.append)


def jack_client() -> ModuleType:
    """Return the package JACK-Client; raise SinkError where it is missing."""
    try:
        import jack
    except ImportError as e:
        raise SinkError(f"the package JACK-Client is missing ({e}): {JACK}") from None
    except OSError as e:
        raise SinkError(f"the JACK library is missing ({e}): {JACK}") from None
    _keep_from_printing(jack)
    return jack


def address(jack: ModuleType, v: Any) -> int:
    """Return the address of an object of libjack."""
    return int(jack._ffi.cast("uintptr_t", v))


def sounddevice() -> ModuleType:
    """Return the package sounddevice; raise SinkError where it is missing."""
    try:
        import sounddevice as found
    except ImportError as e:
        raise SinkError(f"the package sounddevice is missing ({e}): {PORTAUDIO}") from None
    except OSError as e:
        raise SinkError(f"the PortAudio library is missing ({e}): {PORTAUDIO}") from None
    except Exception as e:  # it is started with the import; its own error cannot be named then
        raise SinkError(
            f"PortAudio does not start ({e}): see whether other programs play"
        ) from None
    keep_loaded(found._libname)
    fade_first()
    return found


def fade_first() -> None:
    """Close all sinks at exit before sounddevice shuts PortAudio down."""
    atexit.unregister(close_all)
    atexit.register(close_all)


def nidaqmx() -> ModuleType:
    """Return the package nidaqmx; raise SinkError where it is missing."""
    try:
        return import_module("nidaqmx")
    except ImportError as e:
        raise SinkError(f"the package nidaqmx is missing ({e}): {NIDAQ}") from None
