"""Transports for markers and motion: Lab Streaming Layer, OSC, UDP and serial ports.

A transport is a function with a method ``close``.  A transport of markers is called
with each ``Marker``; a transport of motion waits for rows of numbers, as ``Stream``
describes.  It can serve several sessions in turn, and the code that created it must
close it.
"""

from __future__ import annotations

import json
import math
import os
import re
import socket
import struct
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict
from importlib import import_module
from typing import Any, Literal

from ..core.program import number
from ..errors import BadValue, SinkError, public, said_as
from ..system.packages import package
from .markers import Marker, behind, checked_name
from .rows import CUT, MOST, Rows, osc_messages, osc_text, rows_of, shown_of

Comma = Literal["separator", "decimal"]
LONGEST = 65536  # bytes of a line
CLAIM, RELEASE, DIRECTION, DATA = 0x708B, 0x708C, 0x40047090, 0x40017086  # of ppdev
AHEAD = 0.25  # s: a device that is later is none, but a rehearsal without a clock
BYTES = ":(.+?):([^=,:]+=[0-9]+(?:,[^=,:]+=[0-9]+)*)(?::width=([0-9]*[.]?[0-9]+))?"
PAUSE = 1.0  # s between calls, after which what waits at a serial port may have a gap


class Transport(AbstractContextManager["Transport"]):
    """A function that sends markers or receives motion, with a method ``close``.

    ``place`` says where rows of motion should come, for errors.
    """

    def __init__(self, function: Callable[[Any], Any], close: Callable[[], Any], place: str = ""):
        self._function, self.close, self.place = function, close, place

    def __call__(self, given: Any) -> Any:
        """Send a marker, or wait for rows for at most the given number of seconds."""
        return self._function(given)

    def __exit__(self, *error: object) -> None:
        self.close()


def sending(what: str, host: str, port: int) -> tuple[Callable[[bytes], None], Callable[[], None]]:
    """Return a function that sends datagrams, and a function that closes its socket."""
    there = _socket(what, host, port, socket.socket.connect, "sent to")

    def send(data: bytes) -> None:
        with suppress(ConnectionRefusedError):  # of the datagram before: nobody listens yet
            there.send(data)

    return send, there.close


def _socket(
    what: str, host: str, port: int, use: Callable[[socket.socket, Any], None], done: str
) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        use(made, (host, port))
    except (OSError, OverflowError, TypeError, ValueError) as e:
        made.close()
        why = getattr(e, "strerror", "a host is a name, and a port is a number from 0 to 65535")
        raise SinkError(f"{what}: {repr(host)[1:-1]}:{port} cannot be {done}: {why}") from e
    return made


def datagrams(here: socket.socket, timeout: float) -> list[bytes]:
    """Return the received datagrams, after waiting a limited time for the first."""
    found: list[bytes] = []
    here.settimeout(timeout)
    with suppress(TimeoutError, BlockingIOError):
        while len(found) < MOST:
            found.append(here.recv(65536))
            here.settimeout(0.0)
    return found


def opened(what: str, port: str, baudrate: int) -> Any:
    """Open a serial port and return it."""
    serial = package("serial", what)
    with said_as(SinkError, f"{what}: {port} cannot be opened", OSError, ValueError):
        return serial.Serial(port, baudrate, timeout=0.0, write_timeout=1.0)


# markers ------------------------------------------------------------------------------
@public
def lsl_markers(name: str = "stimlib", numeric: bool = False) -> Transport:
    """Return a Lab Streaming Layer outlet for markers, for ``Sink(send=..)``.

    Parameters
    ----------
    name : str
        Name of the stream; its type is ``Markers``.
    numeric : bool
        Send the value as a number instead of the name as a text.

    Returns
    -------
    callable
        Each marker is stamped with its sample's time on LSL's clock.

    Raises
    ------
    MissingPackage
        pylsl is not installed.
    """
    pylsl = package("pylsl", "lsl_markers")
    kind = "double64" if numeric else "string"
    info = pylsl.StreamInfo(name, "Markers", 1, 0.0, kind, f"stimlib {name}")
    outlet, late = [pylsl.StreamOutlet(info)], behind(pylsl.local_clock)

    def send(m: Marker) -> None:
        outlet[0].push_sample([m.value if numeric else m.name], m.time - late)

    return Transport(send, outlet.clear)


@public
def osc_markers(host: str, port: int, address: str = "/stimlib/marker") -> Transport:
    """Return a sender of markers as Open Sound Control messages, for ``Sink(send=..)``.

    Parameters
    ----------
    host : str
    port : int
    address : str
        Address of the message, whose arguments are name, value, sample (text), time and
        uncertainty in s, and whether it was lost.

    Returns
    -------
    callable

    Raises
    ------
    SinkError
        There is no such host or port.
    BadValue
        An address with control characters, or with more than 256 characters.
    """
    start = osc_text(checked_name("osc_markers: address", address))
    send_data, close = sending("osc_markers", host, port)

    def send(m: Marker) -> None:
        numbers = struct.pack(">dqdd", m.value, m.sample, m.time, m.uncertainty)
        send_data(start + osc_text(",sdhdd" + "FT"[m.lost]) + osc_text(m.name) + numbers)

    return Transport(send, close)


@public
def udp_markers(host: str, port: int) -> Transport:
    """Return a sender of markers as JSON objects over UDP, for ``Sink(send=..)``.

    Parameters
    ----------
    host : str
    port : int

    Returns
    -------
    callable
        One datagram for each marker, with the attributes of ``Marker``.

    Raises
    ------
    SinkError
        There is no such host or port.

    Examples
    --------
    >>> import socket, stimlib
    >>> from stimlib.devices import NullSink, udp_markers
    >>> from stimlib.scenes import pulse
    >>> there = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    >>> there.bind(("127.0.0.1", 0))
    >>> send = udp_markers(*there.getsockname())
    >>> with NullSink(
    ...     pulse(1.0, repeats=1), 1.0, clocked=False, markers=["signal"], send=[send]
    ... ) as sink:
    ...     sink.open(rate=8000)
    ...     sink.start(seconds=0.1)
    ...     sink.wait()
    >>> there.recv(1000)[:42]
    b'{"name": "signal", "value": 1.0, "sample":'
    >>> send.close(), there.close()
    (None, None)
    """
    send, close = sending("udp_markers", host, port)
    return Transport(lambda m: send(json.dumps(asdict(m)).encode()), close)


@public
def byte_markers(
    write: Callable[[int], Any],
    codes: Mapping[str, int],
    width: float | None = None,
    close: Callable[[], Any] = lambda: None,
) -> Transport:
    """Return a sender of one byte for each marker by a function of yours.

    Parameters
    ----------
    write : callable
        ``write(byte)`` puts a number from 0 to 255 on the lines, such as ``setData`` of
        a parallel port of PsychoPy.
    codes : dict of str to int
        The byte, 0 to 255, of each name; markers of other names are not sent.
    width : float, optional
        Seconds from the byte to a 0, at most 1.  The byte then waits for the time at
        which its sample leaves the device, and for the 0 before to have lasted as long,
        so that at most one marker in twice the width can be sent.  By default the
        byte stays until the next.
    close : callable, optional
        Called with ``close`` of the sender.

    Returns
    -------
    callable
        For ``Sink(send=..)``.

    Raises
    ------
    BadValue
        A code that is no byte, or 0 with a width; a width not above 0 or above 1.

    Examples
    --------
    >>> from stimlib.devices import NullSink, byte_markers
    >>> from stimlib.scenes import pulse
    >>> lines = []  # stands for a port
    >>> with NullSink(
    ...     pulse(1.0, repeats=1),
    ...     1.0,
    ...     clocked=False,
    ...     markers=["signal"],
    ...     send=byte_markers(lines.append, {"signal": 4}, width=0.005),
    ... ) as sink:
    ...     sink.open(rate=8000)
    ...     sink.start(seconds=0.1)
    ...     sink.wait()
    >>> lines
    [4, 0]
    """
    lowest = 0 if width is None else 1
    for name, code in codes.items():
        if code not in range(lowest, 256):
            raise BadValue(f"markers: codes[{name!r}] = {code!r} must be from {lowest} to 255")
    if width is not None and not 0 < number(width, "markers: width") <= 1:
        raise BadValue(f"markers: width = {width} s must be above 0, at most 1")
    free = [0.0]  # when the 0 has lasted

    def send(m: Marker) -> None:
        if m.name not in codes:
            return
        if width is None:
            write(int(codes[m.name]))
            return
        due = m.time if m.time - time.monotonic() < AHEAD else 0.0
        time.sleep(max(0.0, max(due, free[0]) - time.monotonic()))
        write(int(codes[m.name]))
        time.sleep(width)
        write(0)
        free[0] = time.monotonic() + width

    return Transport(send, close)


@public
def serial_markers(
    port: str, codes: Mapping[str, int], baudrate: int = 115200, width: float | None = None
) -> Transport:
    """Return a sender of one byte for each marker, for ``Sink(send=..)``.

    Parameters
    ----------
    port : str
        Such as ``"/dev/ttyUSB0"`` or ``"COM3"``: a trigger box, or a microcontroller.
    codes, width
        As for ``byte_markers``.
    baudrate : int
        Bits per second.

    Returns
    -------
    callable

    Raises
    ------
    MissingPackage
        pyserial is not installed.
    SinkError
        The port cannot be opened.
    BadValue
        As ``byte_markers``.
    """
    line: list[Any] = []  # opened when the rest is right
    sent = byte_markers(
        lambda byte: line[0].write(bytes([byte])), codes, width, lambda: line[0].close()
    )
    line.append(opened("serial_markers", port, baudrate))
    return sent


def control(port: int, request: int, data: bytes = b"") -> None:
    """Give a request to the driver of a parallel port."""
    import_module("fcntl").ioctl(port, request, data)  # Windows has neither it nor the port


@public
def parallel_markers(port: str, codes: Mapping[str, int], width: float = 0.005) -> Transport:
    """Return a sender of pulses on a parallel port of Linux, for ``Sink(send=..)``.

    Parameters
    ----------
    port : str
        Such as ``"/dev/parport0"``, of the driver ppdev.
    codes, width
        As for ``byte_markers``: the byte is on the lines D0 to D7, pins 2 to 9.

    Returns
    -------
    callable

    Raises
    ------
    SinkError
        The port cannot be opened, or is not one of the driver ppdev.
    BadValue
        As ``byte_markers``.

    Notes
    -----
    Not tried on hardware.
    """
    here: list[int] = []

    def write(byte: int) -> None:
        control(here[0], DATA, bytes([byte]))

    def close() -> None:
        write(0)
        control(here[0], RELEASE)
        os.close(here.pop())

    sent = byte_markers(write, codes, width, close)
    try:
        here.append(os.open(port, os.O_RDWR))
        control(here[0], CLAIM)
        control(here[0], DIRECTION, struct.pack("i", 0))
        write(0)
    except (OSError, ImportError, ValueError) as e:
        for left in here:
            os.close(left)
        raise SinkError(
            f"parallel_markers: {port} cannot be opened: {e}: on Linux load the driver (modprobe"
            " ppdev), give yourself its group (lp), and end what else uses the port; elsewhere use"
            " byte_markers"
        ) from e
    return sent


@public
def sender(text: str) -> Transport:
    """Return the sender of markers that a text describes, in the form of ``--send``.

    Parameters
    ----------
    text : str
        ``lsl:NAME``, ``osc:HOST:PORT``, ``udp:HOST:PORT``, or
        ``serial:PORT:onset=1,stimulus=2`` and ``parallel:PORT:onset=1,stimulus=2`` with
        the byte for each marker name; ``:width=0.005`` at their end is the time in s
        after which the byte returns to 0.

    Raises
    ------
    BadValue
        A text of another form.
    MissingPackage, SinkError
        As the functions for each.

    Examples
    --------
    >>> from stimlib.devices.transports import sender
    >>> with sender("udp:127.0.0.1:9000") as send:
    ...     callable(send)
    True
    """
    forms: dict[str, Callable[..., Transport]] = {
        "lsl:(.+)": lsl_markers,
        "osc:(.+):([0-9]+)": lambda host, port: osc_markers(host, int(port)),
        "udp:(.+):([0-9]+)": lambda host, port: udp_markers(host, int(port)),
        f"serial{BYTES}": lambda *found: _bytes_of(serial_markers, *found),
        f"parallel{BYTES}": lambda *found: _bytes_of(parallel_markers, *found),
    }
    return _described(
        "send",
        text,
        forms,
        "lsl:NAME, osc:HOST:PORT, udp:HOST:PORT, serial:PORT:onset=1,stimulus=2 or"
        " parallel:PORT:onset=1,stimulus=2, the last two with :width=0.005 for a byte that returns"
        " to 0",
    )


def _bytes_of(
    make: Callable[..., Transport], port: str, codes: str, width: str | None
) -> Transport:
    told = {k.strip(): int(v) for k, v in (code.split("=") for code in codes.split(","))}
    return make(port, told, **({"width": float(width)} if width else {}))


def _described(
    what: str, text: str, forms: Mapping[str, Callable[..., Transport]], says: str
) -> Transport:
    """Return the transport that a text describes in one of several forms."""
    for form, make in forms.items():
        if found := re.fullmatch(form, text):
            return make(*found.groups())
    raise BadValue(f"{what} = {text!r}: write {says}")


# motion -------------------------------------------------------------------------------
@public
def receiver(text: str) -> Transport:
    """Return the receiver of rows that a text describes, in the form of ``--stream``.

    Parameters
    ----------
    text : str
        ``lsl:NAME``, ``osc:PORT/ADDRESS``, ``udp:PORT`` or ``serial:PORT``; the last
        two may end with ``:comma=separator`` or ``:comma=decimal``.

    Raises
    ------
    BadValue
        A text of another form.
    MissingPackage, SinkError
        As the functions for each.

    Examples
    --------
    >>> from stimlib.devices.transports import receiver
    >>> with receiver("udp:0") as receive:
    ...     receive(0.0)
    ([], [], [])
    """
    forms: dict[str, Callable[..., Transport]] = {
        "lsl:(.+)": lsl_motion,
        "osc:([0-9]+)(/.+)": lambda port, address: osc_motion(int(port), address),
        "udp:([0-9]+)(?::comma=(.*))?": lambda port, comma: udp_motion(int(port), comma=comma),
        "serial:(.+?)(?::comma=(.*))?": lambda port, comma: serial_motion(port, comma=comma),
    }
    return _described("stream", text, forms, "lsl:NAME, osc:PORT/ADDRESS, udp:PORT or serial:PORT")


@public
def lsl_motion(name: str, wait: float = 10.0) -> Transport:
    """Return a receiver of a Lab Streaming Layer stream, for ``Stream``.

    Parameters
    ----------
    name : str
        Name of the stream; the first stream with this name is used.
    wait : float
        Seconds in which it must appear.

    Returns
    -------
    callable
        Returns rows with the sender's times on LSL's clock.  If each channel has its
        own label, ``columns`` may name it.  A stream that disappears is reconnected
        when it comes back with as many channels.

    Raises
    ------
    MissingPackage
        pylsl is not installed.
    SinkError
        There is no such stream.
    """
    pylsl = package("pylsl", "lsl_motion")
    found = pylsl.resolve_byprop("name", name, timeout=wait)
    if not found:
        raise SinkError(f"lsl_motion: no stream {name!r} appeared within {wait:g} s")
    inlet = [pylsl.StreamInlet(found[0], max_buflen=1)]
    inlet[0].open_stream(timeout=wait)
    labels = inlet[0].info(timeout=wait).get_channel_labels() or [None, None]
    keys = [*range(len(labels)), *labels] if len({*labels}) == len(labels) else None

    def receive(timeout: float) -> Rows:
        row, at = inlet[0].pull_sample(timeout=timeout)
        if row is None:
            return [], [], []
        rows, times = inlet[0].pull_chunk(timeout=0.0, max_samples=MOST)
        named = [dict(zip(keys, [*r, *r], strict=True)) if keys else r for r in (row, *rows)]
        return named, [at, *times], []

    return Transport(receive, inlet.clear, f"the LSL stream {name!r}")


@public
def lsl_streams(wait: float = 1.0) -> list[dict[str, Any]]:
    """Return the Lab Streaming Layer streams that this machine can see.

    Parameters
    ----------
    wait : float
        Seconds in which they may answer.

    Returns
    -------
    list of dict
        ``name``, ``type``, ``channels``, ``fs`` (Hz, 0 where irregular) and ``host`` of
        each.

    Raises
    ------
    MissingPackage
        pylsl is not installed.
    """
    return [
        {
            "name": found.name(),
            "type": found.type(),
            "channels": found.channel_count(),
            "fs": found.nominal_srate(),
            "host": found.hostname(),
        }
        for found in package("pylsl", "lsl_streams").resolve_streams(wait)
    ]


@public
def osc_motion(port: int, address: str, host: str = "127.0.0.1") -> Transport:
    """Return a receiver of Open Sound Control messages, for ``Stream``.

    Parameters
    ----------
    port : int
        To listen to.
    address : str
        Address of the messages; others are counted as rejected.
    host : str
        Address to listen on; ``""`` is every one of this machine.

    Returns
    -------
    callable

    Raises
    ------
    SinkError
        The port cannot be listened to.
    """
    here = _socket("osc_motion", host, port, socket.socket.bind, "listened to")

    def receive(timeout: float) -> Rows:
        rows: list[Any] = []
        rejected: list[tuple[str, str]] = []
        for data in datagrams(here, timeout):
            try:
                found = osc_messages(data)
            except (ValueError, KeyError, struct.error, RecursionError):
                found = []
                rejected.append(("no OSC", shown_of(data)))
            rows += [values for to, values in found if to == address.encode()]
            rejected += [
                ("another address", shown_of(to)) for to, _ in found if to != address.encode()
            ]
        return rows, [math.nan] * len(rows), rejected

    return Transport(receive, here.close, f"UDP port {here.getsockname()[1]} for OSC {address}")


@public
def udp_motion(
    port: int, host: str = "127.0.0.1", timed: bool = False, comma: Comma | None = None
) -> Transport:
    """Return a receiver of UDP datagrams with numbers, for ``Stream``.

    Parameters
    ----------
    port : int
        To listen to.
    host : str
        Address to listen on; ``""`` is every one of this machine.
    timed : bool
        The first number of each line is the sender's time in s.
    comma : {"separator", "decimal"}, optional
        What a comma between two digits is.  By default it separates numbers if each has
        a decimal point or an exponent, and the row is rejected otherwise.

    Returns
    -------
    callable
        Each line of a datagram is a row: see :doc:`/howto/rows`.

    Raises
    ------
    SinkError
        The port cannot be listened to.

    Examples
    --------
    >>> import socket
    >>> from stimlib.devices import udp_motion
    >>> receive = udp_motion(0)
    >>> receive(0.0)
    ([], [], [])
    >>> receive.close()
    """
    here = _socket("udp_motion", host, port, socket.socket.bind, "listened to")

    def receive(timeout: float) -> Rows:
        found = [data.rstrip(b"\0") for data in datagrams(here, timeout)]  # of C's texts
        return rows_of(b"\n".join(found).splitlines(), timed, comma)

    made = Transport(receive, here.close, f"UDP port {here.getsockname()[1]}")
    made.port = here.getsockname()[1]  # type: ignore[attr-defined]
    return made


@public
def serial_motion(
    port: str, baudrate: int = 115200, timed: bool = False, comma: Comma | None = None
) -> Transport:
    """Return a receiver of numbers from a serial port, for ``Stream``.

    Parameters
    ----------
    port : str
        Such as ``"/dev/ttyACM0"`` or ``"COM3"``.
    baudrate : int
        Bits per second.
    timed : bool
        The first number of each line is the sender's time in s.
    comma : {"separator", "decimal"}, optional
        What a comma between two digits is.  By default it separates numbers if each has
        a decimal point or an exponent, and the row is rejected otherwise.

    Returns
    -------
    callable
        Each line is a row: see :doc:`/howto/rows`.  The line during which the port is
        opened is rejected, because its beginning may be missing.  What came before a
        pause of more than 1 s between two calls is discarded.  A device that was
        unplugged is opened again when it is back.

    Raises
    ------
    MissingPackage
        pyserial is not installed.
    SinkError
        The port cannot be opened.
    """
    line, left, asked = [opened("serial_motion", port, baudrate)], [CUT], [time.monotonic()]
    over = threading.Event()  # a session that ends meanwhile must not open the port again

    def close() -> None:
        over.set()
        line[0].close()

    def receive(timeout: float) -> Rows:
        stale = time.monotonic() - asked[0] > PAUSE
        try:
            line[0].timeout = timeout
            data = line[0].read(1) + line[0].read(line[0].in_waiting)
        except (OSError, TypeError):  # unplugged
            line[0].close()
            time.sleep(timeout)
            stale, data = True, b""
            if not over.is_set():
                with suppress(SinkError):
                    line[0] = opened("serial_motion", port, baudrate)
        asked[0] = time.monotonic()
        *lines, left[0] = re.split(rb"[\r\n]", CUT if stale else left[0] + data)
        if len(left[0]) > LONGEST:
            left[0] = CUT
        return rows_of(lines, timed, comma)

    return Transport(receive, close, f"port {port}")
