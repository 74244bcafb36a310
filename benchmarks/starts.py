"""The error of a start at a given time, by JACK's clock and by the sink's own.

``python benchmarks/starts.py [STARTS]``, with a JACK server that runs: a constant is
started at a given time on null, on JACK and on PortAudio's device of that server; for
the last two another client records the frame of sample 0, whose time JACK tells.
"""

from __future__ import annotations

import ctypes
import sys
import time
from typing import Any

import numpy as np

import stimlib
from stimlib.devices import JackSink, NullSink, PortAudioSink
from stimlib.devices.jack import _jack
from stimlib.devices.jack_loopback import Capture

STEADY = stimlib.Scene({"y": stimlib.constant(1.0)})


def by_jack(sink: Any, capture: Capture, rate: float, wait: float) -> tuple[float, float, bool]:
    """Errors of a start in samples, recorded and as told, and whether JACK was late."""
    jack = ctypes.CDLL(_jack()._libname)
    jack.jack_get_time.restype = jack.jack_frames_to_time.restype = ctypes.c_uint64
    client = ctypes.c_void_p(int(_jack()._ffi.cast("uintptr_t", capture.client._ptr)))
    clock = []  # frames, and their times while they are near: later JACK extrapolates
    with sink:
        sink.open(rate)
        if isinstance(sink, PortAudioSink):
            (port,) = (p.name for p in capture.client.get_ports("PortAudio:out_.*"))
            capture.client.connect(port, capture.names[0])
        at = time.monotonic() + wait
        sink.start(0.3, at=at)
        while not sink.finished:
            frame = capture.client.last_frame_time
            clock.append((frame, 1e-6 * jack.jack_frames_to_time(client, ctypes.c_uint32(frame))))
            sink.wait(0.02)
        time.sleep(0.1)
    # JACK's clock is not the host's: it is not adjusted to the time of day
    ahead = 1e-6 * jack.jack_get_time() - time.monotonic()
    first = capture.times[np.argmax(capture.frames[:, 0] == 1.0)]  # steps lead up to sample 0
    known = np.array(clock)
    # JACK estimates each by itself: a line through them is steadier
    line = np.polyfit(known[:, 0] - first, known[:, 1], 1)
    report = sink.report()
    error = (line[1] - ahead - (at - report.latency)) * rate
    return error, report.start_error * rate, capture.xruns > 0


def main(starts: int) -> None:
    probe = Capture(None, 1, 1)
    rate, block = probe.client.samplerate, probe.client.blocksize
    probe.client.close()
    waits = np.random.default_rng(1).uniform(0.8, 1.6, starts)
    told = []
    for wait in waits:
        with NullSink(STEADY, 1.0, realtime=False) as sink:
            sink.open(rate, block=block)
            sink.start(0.3, at=time.monotonic() + wait)
            sink.wait()
        told.append(sink.report().start_error * rate)
    say("null, as told", told)
    for name in ("jack", "portaudio"):
        errors = []
        for wait in waits:
            with Capture(None, 1, 8 * rate) as capture:
                if name == "jack":
                    sink: Any = JackSink(STEADY, 1.0, connect=capture.names, realtime=False)
                else:
                    sink = PortAudioSink(STEADY, 1.0, name="system", realtime=False)
                errors.append(by_jack(sink, capture, rate, wait + 1.0 * (name != "jack")))
        for late in (False, True):
            recorded, told = np.array([e[:2] for e in errors if e[2] == late]).reshape(-1, 2).T
            when = f"{name}, {'with' if late else 'without'} xruns"
            say(f"{when}, recorded", recorded)
            say(f"{when}, as told", told)


def say(what: str, errors: Any) -> None:
    e = np.array(errors)
    if not e.size:
        return
    print(
        f"{what}: error of {len(e)} starts in samples: median {np.median(e):.2f}, 90 % within"
        f" {np.quantile(abs(e), 0.9):.2f}, largest {abs(e).max():.2f}"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 30)
