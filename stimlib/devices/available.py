"""The available sinks, and what is missing for the others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

from ..errors import BadValue, SinkError, counted, public
from .drivers import jack_client, nidaqmx, sounddevice


@dataclass(frozen=True)
class Device:
    """A sink and the devices that it finds on this machine.

    Attributes
    ----------
    sink : str
        Name in ``SINKS``.
    ready : bool
    what : str
        The device, or why there is none.
    how : str
        How to play on it, or how to get it.
    fs : float, optional
        Sample rate of the device in Hz, if it is fixed.
    """

    sink: str
    ready: bool
    what: str
    how: str
    fs: float | None = None


@public
def devices(server: str | None = None) -> list[Device]:
    """Return all devices, ready or not.

    Parameters
    ----------
    server : str, optional
        Name of the JACK server, "default" by default.

    Examples
    --------
    >>> from stimlib.devices import devices
    >>> devices("none_of_this_name")[0]
    Device(sink='null', ready=True, what='no device: nothing is heard or felt',
           how='--sink null', fs=None)
    """
    found = []
    for name, kind in SINKS.items():
        try:
            found += [Device(name, *row) for row in kind.found(server)]
        except SinkError as e:
            what, _, how = str(e).rpartition(": ")
            found.append(Device(name, False, what, how))
    return found


@public
def first_ready(server: str | None = None) -> Device:
    """Return the device on which ``stimlib play`` plays by default.

    JACK is tried before PortAudio.  If neither is ready, the null device is returned:
    stimlib plays on another device, such as NI-DAQ, only when it is named.

    Parameters
    ----------
    server : str, optional
        Name of the JACK server, "default" by default.

    Examples
    --------
    >>> from stimlib.devices import first_ready
    >>> first_ready("none_of_this_name").ready
    True
    """
    none, *others = devices(server)
    return next((d for d in others if d.ready and SINKS[d.sink].default), none)


def option(sink: str, name: str, value: Any) -> dict[str, Any]:
    """Return the keyword argument of a sink for a command-line option.

    The result is a dict with the argument's name and value.

    Raises
    ------
    BadValue
        The sink has no such option.

    Examples
    --------
    >>> from stimlib.devices import option
    >>> option("jack", "device", "studio")
    {'server': 'studio'}
    """
    takes = {kind: row.takes for kind, row in SINKS.items()}
    if name not in takes.get(sink, {}):
        others = " or ".join(kind for kind in SINKS if name in takes[kind])
        raise BadValue(f"--{name}: is for --sink {others}, not for {sink}")
    return {takes[sink][name]: value}


def make(sink: str, scene: Any, safety: Any, **options: Any) -> Any:
    """Make a sink, chosen by its name in ``SINKS``, for a scene and its safety stage.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.devices import make
    >>> make("null", stimlib.Scene({"y": stimlib.constant(1.0)}), 1.0)
    NullSink(Scene(no input -> y [1]))
    """
    module, _, name = SINKS[sink].place.partition(":")
    return getattr(import_module(module), name)(scene, safety, **options)


# whether it is ready, what there is, how to play on it, and its sample rate
Found = list[tuple[bool, str, str, float | None]]


def _on_jack(server: str | None) -> Found:
    jack = jack_client()
    try:
        client = jack.Client("stimlib_devices", no_start_server=True, servername=server)
    except jack.JackError:
        name = f"server {server!r}" if server else "server"
        command = f"jackd -R{f' -n {server}' if server else ''} -d alsa -r 48000 -p 64"
        return [(False, f"no {name} is running", f"start one, such as {command}", None)]
    try:
        outs, ins = (
            len(
                client.get_ports(
                    is_audio=True, is_physical=True, is_input=to_device, is_output=not to_device
                )
            )
            for to_device in (True, False)
        )
        what = (
            f"a server at {client.samplerate} Hz, blocks of {client.blocksize},"
            f" {counted(outs, 'output')},"
            f" {counted(ins, 'input')}"
        )
        named = f" --device {server}" if server else ""
        return [(True, what, f"--sink jack --fs {client.samplerate}{named}", client.samplerate)]
    finally:
        client.close()


def _on_portaudio(server: str | None) -> Found:
    sd = sounddevice()
    apis, found, first = sd.query_hostapis(), [], None
    with suppress(sd.PortAudioError):  # there is no default
        first = sd.query_devices(kind="output")["index"]
    for d in sorted(sd.query_devices(), key=lambda d: d["index"] != first):
        if d["max_output_channels"]:
            api, rate = apis[d["hostapi"]]["name"], d["default_samplerate"]
            what = (
                f"{d['name']!r} ({api}), {counted(d['max_output_channels'], 'output')},"
                f" {counted(d['max_input_channels'], 'input')}"
            )
            how = f"--sink portaudio --device {d['index']} --fs {rate:g}"
            found.append((True, what, how, rate))
    return found or [
        (
            False,
            "PortAudio finds no output",
            "connect a sound card, or start a JACK or PulseAudio server",
            None,
        )
    ]


def _on_nidaq(server: str | None) -> Found:
    system = import_module(f"{nidaqmx().__name__}.system")
    try:
        found: Found = [
            (True, f"{d.name} ({d.product_type})", f"--sink nidaq --device {d.name}/ao0", None)
            for d in system.System.local().devices
        ]
    except Exception as e:
        return [(False, f"NI-DAQmx does not answer ({e})", "install the vendor's driver", None)]
    return found or [(False, "NI-DAQmx finds no device", "connect one", None)]


class Kind(NamedTuple):
    """All facts about one kind of sink."""

    place: str  # module and class
    found: Callable[[str | None], Found]
    takes: Mapping[str, str]  # arguments of the class, by options of the command line
    device: str = ""  # help of --device
    default: bool = False  # whether it plays where no sink was named


SINKS: dict[str, Kind] = {
    "null": Kind(
        "stimlib.devices.null:NullSink",
        lambda server: [(True, "no device: nothing is heard or felt", "--sink null", None)],
        {"fast": "clocked"},
    ),
    "jack": Kind(
        "stimlib.devices.jack:JackSink",
        _on_jack,
        {"device": "server", "client": "name", "connect": "connect"},
        "JACK: name of the server.",
        default=True,
    ),
    "portaudio": Kind(
        "stimlib.devices.portaudio:PortAudioSink",
        _on_portaudio,
        {"device": "name", "fast": "clocked"},
        "PortAudio: name of the device, part of it, or its number.",
        default=True,
    ),
    "nidaq": Kind(
        "stimlib.devices.nidaq:NidaqSink",
        _on_nidaq,
        {"device": "name"},
        "NI-DAQ: its outputs, such as Dev1/ao0:1.",
    ),
}
