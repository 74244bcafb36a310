"""A sink for PortAudio devices: ALSA, JACK, PulseAudio, Core Audio, ASIO, WASAPI.

sounddevice offers callbacks in Python only.  To call the compiled callback without the
interpreter, this file uses private parts of sounddevice (``_StreamBase``, ``_ffi``), so
its version is pinned.
"""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from ..errors import BadValue, SinkError, counted
from .drivers import PORTAUDIO, fade_first, sounddevice
from .process import abandoned
from .sink import Sink
from .sources import Signals

SETTLES_IN = 3.0
"""Seconds that a device may need to reach regular intervals: PulseAudio first takes up
to two seconds of samples at once, then none.
"""
EVEN_FOR = 0.2
"""Seconds of regular callbacks after which the device counts as settled."""


_library = threading.Lock()


@contextmanager
def _alone(seconds: float = -1) -> Iterator[None]:
    """Hold the lock that allows only one thread at a time to call PortAudio."""
    if not _library.acquire(timeout=seconds):
        raise SinkError(
            f"portaudio: another sink's device has kept PortAudio busy for {seconds:g} s: close"
            " that sink"
        )
    try:
        yield
    finally:
        _library.release()


class PortAudioSink(Sink):
    """A sink for a PortAudio device; ``stimlib devices`` lists them.

    Parameters
    ----------
    scene, safety, **options
        See ``Sink``.  The inputs of ``Signals`` are the device's input channels in
        their order.
    name : str or int, optional
        Name of the device, part of it, or its number; by default the system's device.
    latency : "low", "high" or float, s
        Size of the device's buffer; choose high if playback stutters.
    clocked : bool
        False for a device without a clock, such as ALSA's ``null`` and ``file``, which
        take samples as fast as they come.

    Notes
    -----
    PortAudio finds devices and servers when ``sounddevice`` is first imported; a device
    that is connected later needs a new process.  It reports that frames were skipped,
    not how many: the report's ``lost`` follows from its clock, in whole blocks.

    PulseAudio and PipeWire match channels by the names of loudspeakers, which ALSA
    gives in an order of its own, and mix what does not match:
    ``docs/howto/hardware.rst`` explains how to keep the channels unmixed.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.devices import PortAudioSink
    >>> sink = PortAudioSink(
    ...     stimlib.scenes.squeeze(),
    ...     50.0,
    ...     motion={"x1": abs, "x2": abs},
    ...     name="none of this name",
    ... )
    >>> sink.open(rate=8000)
    Traceback (most recent call last):
    ...
    stimlib.errors.SinkError: ...
    """

    device = "portaudio"
    silent_for = 0.8

    def __init__(
        self,
        scene,
        safety=None,
        *,
        name: str | int | None = None,
        latency: str | float = "low",
        clocked: bool = True,
        **options: Any,
    ):
        self.clock = clocked
        super().__init__(scene, safety, **options)
        number = isinstance(name, str) and name.isdecimal()
        self.name = int(name) if number else name  # type: ignore[arg-type]
        self.latency = latency
        self._stream: Any = None
        signals = self.motion.inputs.values() if isinstance(self.motion, Signals) else ()
        for port in (s.connect for s in signals if s.connect is not None):
            raise BadValue(
                f"portaudio: a device has input channels in their order, no port {port!r} to"
                " connect"
            )

    def _open(self) -> None:
        sd = sounddevice()
        with _alone(5.0):
            self._take(sd)

    def _take(self, sd: ModuleType) -> None:
        pump = self.pump
        inputs = len(self.proc.inputs) if isinstance(self.motion, Signals) else 0
        self._fits(sd, inputs)
        pump._fill(STRIDE=self.channels, IN_STRIDE=max(inputs, 1))
        pump.write("RATE", int(np.float64(self.rate).view(np.int64)))
        if not self.clock:
            pump.write("WAIT", 1_000_000)
        both = bool(inputs)
        common: dict[str, Any] = {
            "device": (self.name, self.name) if both else self.name,
            "channels": (inputs, self.channels) if both else self.channels,
            "samplerate": self.rate,
            "blocksize": self.block or 0,
            "dtype": "float32",
            "latency": self.latency,
            "clip_off": True,
            "dither_off": True,
            "finished_callback": self._finished,
        }
        try:
            callback = sd._ffi.cast("PaStreamCallback*", pump.callback("portaudio"))
            user, kind = sd._ffi.cast("void*", pump.context), "duplex" if both else "output"
            self._stream = sd._StreamBase(
                kind=kind, callback=callback, wrap_callback=None, userdata=user, **common
            )
        except (AttributeError, TypeError) as e:
            raise SinkError(
                f"portaudio: this version of sounddevice takes no compiled callback ({e}):"
                f" {PORTAUDIO}"
            ) from None
        except (sd.PortAudioError, ValueError) as e:
            raise SinkError(f"portaudio: {self._called(sd)} cannot be opened: {e}") from None
        self.block = self._stream.blocksize or None

    def _fits(self, sd: ModuleType, inputs: int) -> None:
        """Check the settings, and raise clearer errors than PortAudio's."""
        try:
            info = sd.query_devices(self.name, "output")
            source = sd.query_devices(self.name, "input") if inputs else None
        except (sd.PortAudioError, ValueError) as e:
            known = ", ".join(
                f"{d['index']} {d['name']!r}"
                for d in sd.query_devices()
                if d["max_output_channels"]
            )
            raise SinkError(
                f"portaudio: no device {self.name!r} ({str(e).splitlines()[0]}); there are"
                f" {known or 'none'}; one that has come since the program began needs a new one"
            ) from None
        if info["max_output_channels"] < self.channels:
            raise SinkError(
                f"portaudio: {self._called(sd)} has"
                f" {counted(info['max_output_channels'], 'channel')}, fewer"
                f" than {self.channels}"
            )
        if source is not None and source["max_input_channels"] < inputs:
            raise SinkError(
                f"portaudio: {self._called(sd)} has"
                f" {counted(source['max_input_channels'], 'input')}, fewer"
                f" than {inputs}"
            )
        try:
            sd.check_output_settings(self.name, self.channels, "float32", samplerate=self.rate)
        except (sd.PortAudioError, ValueError) as e:
            if "sample rate" in str(e).lower():  # else the stream will say what is wrong
                raise SinkError(
                    f"portaudio: {self._called(sd)} does not run at {self.rate:g} Hz: "
                    f"open(rate={info['default_samplerate']:g}), or set the device to {self.rate:g}"
                ) from None

    def _called(self, sd: ModuleType) -> str:
        info = sd.query_devices(self.name, "output")
        return f"device {info['name']!r} ({sd.query_hostapis(info['hostapi'])['name']})"

    def _start(self) -> None:
        sd = sounddevice()
        try:
            with _alone(5.0):
                self._stream.start()
        except sd.PortAudioError as e:
            raise SinkError(f"portaudio: {self._called(sd)} cannot be started: {e}") from None
        if self.clock:
            self._settle()

    def _settle(self) -> None:
        """Play silence until callbacks come at regular intervals.

        Samples played earlier would come late, with their fades cut off.
        """
        pace = max(0.1, 3.0 * self._latency())
        began = even = last = time.monotonic()
        calls = self.pump.read("CALLS")
        while (
            (t := time.monotonic()) - even < max(EVEN_FOR, 2.0 * pace)
            and t - began < SETTLES_IN
            and not self._device_gone
        ):
            if (now := self.pump.read("CALLS")) != calls:
                calls, last = now, t
            elif t - last > pace:
                even = t
            time.sleep(0.002)

    def _finished(self) -> None:
        """Record that the device has gone, as a device may end its stream silently.

        PortAudio calls this method when a stream ends.
        """
        if not self._closed:
            self.device_lost(
                "the device has ended the stream: is it still there? No fade-out was possible"
            )

    def _close(self) -> None:
        stream = self._stream
        if stream is None:
            return
        end = getattr(sounddevice(), "_exit_handler", None)
        if end:
            # ending PortAudio waits for a device that never answers, and so would the
            # program
            atexit.unregister(end)
        if self._hangs:
            abandoned.append(stream)
            return
        with _alone():
            stream.stop()
            stream.close()
        self._stream = None
        if end:
            atexit.register(end)
        fade_first()

    def _latency(self) -> float:
        stream = self._stream
        return 0.0 if stream is None else float(np.max(stream.latency))
