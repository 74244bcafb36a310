"""A sink for a JACK server, whose process callback runs the compiled program.

JACK-Client offers callbacks in Python only.  To call the compiled callback without the
interpreter, this file uses private parts of JACK-Client (``jack._lib``, ``jack._ffi``,
``_ptr``), so its version is pinned; if they are missing, a Python callback takes over,
with a warning.
"""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Sequence
from contextlib import closing
from types import ModuleType
from typing import Any

from ..errors import BadValue, SinkError, counted
from .drivers import JACK, SAID, address, jack_client
from .sink import Sink
from .sources import Signals


class JackSink(Sink):
    """A sink that plays on a running JACK server.

    Parameters
    ----------
    scene, safety, **options
        See ``Sink``.
    name : str
        Name of the client; its ports are named like the outputs.  No other client may
        have this name.
    server : str, optional
        Name of the server, "default" by default.
    connect : "system", sequence of str or None
        Where each channel goes: to the physical outputs in their order, to these ports,
        or nowhere.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.devices import JackSink
    >>> sink = JackSink(
    ...     stimlib.scenes.squeeze(),
    ...     50.0,
    ...     motion={"x1": abs, "x2": abs},
    ...     server="none_of_this_name",
    ... )
    >>> sink.open(rate=8000)
    Traceback (most recent call last):
    ...
    stimlib.errors.SinkError: ...
    """

    device = "jack"
    silent_for = 2.0  # in synchronous mode a killed client can block the server for a while

    def __init__(
        self,
        scene,
        safety=None,
        *,
        name: str = "stimlib",
        server: str | None = None,
        connect: str | Sequence[str] | None = "system",
        **options: Any,
    ):
        super().__init__(scene, safety, **options)
        if isinstance(connect, str) and connect != "system":
            connect = [connect]
        self.name, self.server, self.connect = name, server, connect
        self._client: Any = None
        self._asking = threading.Lock()  # of a client that another thread may close
        self._wheels = False

    def _open(self) -> None:
        jack = jack_client()
        SAID.clear()
        try:
            try:
                self._client = client = jack.Client(
                    self.name, use_exact_name=True, no_start_server=True, servername=self.server
                )
            except jack.JackOpenError as e:
                raise self._no_client(e, [*SAID]) from None
            self._fits(client)
            outs = [client.outports.register(n) for n in self._port_names()]
            signals = self.motion.inputs if isinstance(self.motion, Signals) else {}
            ins = {n: client.inports.register(f"in_{n}") for n in self.proc.inputs if n in signals}
            self._take_callback(jack, client, outs, [*ins.values()])
            client.set_shutdown_callback(self._server_ended)
            client.activate()
            for port, to in zip(outs, self._targets(client), strict=False):
                client.connect(port, to)
            for n, port in ins.items():
                if (source := signals[n].connect) is not None:
                    client.connect(source, port)
        except jack.JackError as e:
            printed = [*SAID]
            raise SinkError(f"jack: {e}" + (f" ({printed[-1]})" if printed else "")) from None

    def _no_client(self, e: Any, printed: list[str]) -> SinkError:
        where = f"server {self.server!r}" if self.server else "server"
        if e.status.name_not_unique or self._is_there():
            return SinkError(
                f"jack: the {where} has a client {self.name!r} already: end it, or give this one"
                " another name (play --client)"
            )
        if e.status.server_failed:
            how = f"jackd -R{f' -n {self.server}' if self.server else ''} -d alsa -r {self.rate:g}"
            return SinkError(f"jack: no {where} is running: start one, such as {how}")
        why = f"{e} ({printed[0]})" if printed else str(e)
        return SinkError(
            f"jack: the {where} takes no client: {why}: try again; where several servers run on"
            " this machine, with a name that no client of the others has (play --client)"
        )

    def _is_there(self) -> bool:
        """Return whether the server already has a client of this name.

        jackd itself reports only that something went wrong.
        """
        jack = jack_client()
        name = f"{self.name[:40]}_{os.getpid()}"
        try:
            with closing(jack.Client(name, no_start_server=True, servername=self.server)) as client:
                client.get_uuid_for_client_name(self.name)
        except jack.JackError:
            return False
        return True

    def _fits(self, client: Any) -> None:
        if client.samplerate != self.rate:
            raise SinkError(
                f"jack: the server runs at {client.samplerate} Hz, not at {self.rate:g}:"
                f" open(rate={client.samplerate}), or start it with -r {self.rate:g}"
            )
        if self.block is not None and client.blocksize != self.block:
            raise SinkError(
                f"jack: the server's blocks have {counted(client.blocksize, 'frame')}, not"
                f" {self.block}: leave"
                f" block out (the samples do not depend on it), or start it with -p {self.block}"
            )
        self.block = client.blocksize
        if self.realtime and not client.realtime:
            self._refused.append("real-time priority (jackd runs without -R)")
        self._targets(client)

    def _targets(self, client: Any) -> list[Any]:
        """Return the ports to connect the channels to."""
        if self.connect is None:
            return []
        if self.connect == "system":
            found = client.get_ports(is_audio=True, is_input=True, is_physical=True)
            if len(found) < self.channels:
                raise SinkError(
                    f"jack: the server has {counted(len(found), 'physical output')}, fewer than the"
                    f" {counted(self.channels, 'channel')}"
                )
            return found[: self.channels]
        if len(self.connect) != self.channels:
            raise BadValue(
                f"connect names {counted(len(self.connect), 'port')} for"
                f" {counted(self.channels, 'channel')}"
            )
        for name in self.connect:
            if not [p for p in client.get_ports(is_audio=True, is_input=True) if p.name == name]:
                raise SinkError(f"jack: there is no input port {name!r}")
        return list(self.connect)

    def _port_names(self) -> list[str]:
        names: list[str] = []
        for channel, i in enumerate(self.map):
            name = self.proc.outputs[i] if i >= 0 else f"silent_{channel + 1}"
            names.append(name if name not in names else f"{name}_{channel + 1}")
        return names

    def _take_callback(
        self, jack: ModuleType, client: Any, outs: list[Any], ins: list[Any]
    ) -> None:
        pump = self.pump
        lib, ffi = jack._lib, jack._ffi
        pump.buffers("PORTS")[:] = [address(jack, p._ptr) for p in outs]
        if ins:
            pump.buffers("IN_PORTS")[:] = [address(jack, p._ptr) for p in ins]
        pump.write("CLIENT", address(jack, client._ptr))
        for word, f in (
            ("GET_BUFFER", "port_get_buffer"),
            ("FRAME_TIME", "last_frame_time"),
            ("PORT_CONNECTED", "port_connected"),
        ):
            pump.write(word, address(jack, getattr(lib, f"jack_{f}")))
        user = ffi.cast("void*", pump.context)
        try:
            process = ffi.cast("JackProcessCallback", pump.callback("jack"))
            wheel = ffi.cast("JackFreewheelCallback", pump.callback("jack_freewheel"))
            done = lib.jack_set_process_callback(client._ptr, process, user)
            if done or lib.jack_set_freewheel_callback(client._ptr, wheel, user):
                raise TypeError("it is refused")
        except (AttributeError, TypeError, ffi.error) as e:
            raise SinkError(
                f"jack: this version of JACK-Client takes no compiled callback ({e}): {JACK}"
            ) from None

    def freewheel(self, on: bool) -> None:
        """Run the server as fast as possible, or in real time again.

        While it runs as fast as possible, no sample is lost and nothing is audible. The
        sink returns to real time before it closes, because libjack may otherwise end
        the process when a client leaves the graph.
        """
        self.check()
        if self._client is None:
            raise SinkError("freewheel: this sink is not open")
        self._client.set_freewheel(on)
        self._wheels = on

    def _server_ended(self, status: Any, reason: str) -> None:
        if not self._closed:
            self.device_lost(
                f"the server has ended ({reason or 'no reason given'}): no fade-out was possible"
            )

    def _close(self) -> None:
        with self._asking:
            client, self._client = self._client, None
        if client is None:
            return
        if not self._device_gone:
            if self._wheels:
                client.set_freewheel(False)
            client.deactivate()
        client.close()

    def _latency(self) -> float:
        try:
            # JACK-Client has no name for it
            ask = ctypes.CDLL(jack_client()._libname).jack_port_get_latency_range
        except (AttributeError, OSError):
            return 0.0
        most = 0
        with self._asking:
            if self._client is None or self._device_gone:
                return 0.0
            for port in self.pump.buffers("PORTS").tolist():
                range_ = (ctypes.c_uint32 * 2)()
                ask(ctypes.c_void_p(port), 1, range_)  # JackPlaybackLatency
                most = max(most, range_[1])
        return most / self.rate
