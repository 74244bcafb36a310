"""Markers against what JACK recorded: the pulse's sample, and the time of LSL and OSC.

``python benchmarks/pulses.py [SECONDS]``, with a JACK server that runs: a signal and
a pulse on a spare channel begin at the same samples; another client records both.
The pulse is compared with the signal, sample by sample; the stamps of markers with
JACK's own time of the frame in which the pulse was recorded.
"""

from __future__ import annotations

import ctypes
import sys
import time

import numpy as np
import pylsl
from pythonosc import osc_packet
from transports import listening

from stimlib import Scene
from stimlib.blocks import burst, every
from stimlib.devices import JackSink, lsl_markers, osc_markers
from stimlib.devices.jack import _jack
from stimlib.devices.jack_loopback import Capture

PERIOD = 0.2


def main(seconds: float) -> None:
    start = every(PERIOD)
    scene = Scene({"signal": 0.8 * burst(start, 0.05), "onset": burst(start, 0.005)})
    lsl_name = f"stimlib pulses {time.monotonic_ns()}"
    here = listening()
    send = [lsl_markers(lsl_name), osc_markers("127.0.0.1", here.getsockname()[1])]
    told = []
    inlet = pylsl.StreamInlet(pylsl.resolve_byprop("name", lsl_name, timeout=10)[0])
    inlet.open_stream(timeout=10)
    capture = Capture(None, 2, int(48000 * (seconds + 5)))
    sink = JackSink(scene, 1.0, markers=["onset"], send=[*send, told.append], connect=capture.names)
    with sink:
        sink.open(capture.client.samplerate)
        rate = sink.rate
        jack = ctypes.CDLL(_jack()._libname)
        jack.jack_get_time.restype = jack.jack_frames_to_time.restype = ctypes.c_uint64
        client = ctypes.c_void_p(int(_jack()._ffi.cast("uintptr_t", capture.client._ptr)))
        sink.start(seconds)
        clock = []  # frames, and their times while they are near: later JACK extrapolates
        while not sink.finished:
            frame = capture.client.last_frame_time
            clock.append((frame, 1e-6 * jack.jack_frames_to_time(client, ctypes.c_uint32(frame))))
            sink.wait(0.02)
        latency = sink.report().latency
        data, frames = capture.frames.copy(), capture.times.copy()
    rises = [np.flatnonzero(np.diff((data[:, c] > 0.4).astype(int)) > 0) + 1 for c in (0, 1)]
    n = min(len(told), *map(len, rises))
    # the first lies in the fade-in, which leads to sample 0
    signal, pulse = (rise[1:n] for rise in rises)
    apart = np.abs(signal - pulse)
    print(f"{n} onsets at {rate:g} Hz; pulse against signal: {apart.max()} samples at most")
    # JACK's clock is not the host's: it is not adjusted to the time of day
    jack_ahead = 1e-6 * jack.jack_get_time() - time.monotonic()
    at = np.interp(frames[pulse], *np.array(clock).T)
    stamps, times = inlet.pull_chunk(timeout=1.0, max_samples=10_000)
    osc = [osc_packet.OscPacket(here.recv(1000)).messages[0].message.params[3] for _ in told]
    stated = np.array([m.uncertainty for m in told[10:n]])
    ahead = pylsl.local_clock() - time.monotonic()
    for name, stamp in (("LSL", np.array(times) - ahead), ("OSC", np.array(osc))):
        error = stamp[10:n] - latency - (at[9:] - jack_ahead)
        error = 1e3 * np.abs(error)
        within = np.mean(error <= 1e3 * stated + 0.05)
        print(
            f"{name}: {len(stamp)} of {len(told)}; error {np.median(error):.3f} ms (median),"
            f" {np.quantile(error, 0.95):.3f} (95 %), {error.max():.3f} (largest); stated"
            f" {1e3 * np.median(stated):.3f} (median), {1e3 * stated.max():.3f} (largest);"
            f" {100 * within:.0f} % within what was stated"
        )
    capture.client.close()


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
