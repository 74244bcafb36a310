"""What a scene can be played on here, and what is missing for the rest."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import SinkError, public


@dataclass(frozen=True)
class Device:
    """A sink and what it finds here.

    Attributes
    ----------
    sink : str
        "null", "jack" or "portaudio".
    ready : bool
    what : str
        The device, or why there is none.
    how : str
        How to play on it, or how to get it.
    """

    sink: str
    ready: bool
    what: str
    how: str


@public
def devices(server: str | None = None) -> list[Device]:
    """All devices, ready or not.

    Parameters
    ----------
    server : str, optional
        Name of the JACK server, "default" by default.

    Examples
    --------
    >>> from stimlib.devices.available import devices
    >>> devices("none_of_this_name")[0]
    Device(sink='null', ready=True, what='no device, at the pace of the clock',
           how='--sink null')
    """
    return [
        Device("null", True, "no device, at the pace of the clock", "--sink null"),
        *_on_jack(server),
        *_on_portaudio(),
    ]


def _on_jack(server: str | None) -> list[Device]:
    from . import jack as sink

    try:
        jack = sink._jack()
    except SinkError as e:
        return [Device("jack", False, *_split(e))]
    jack.set_error_function(sink._quiet)
    try:
        client = jack.Client("stimlib_devices", no_start_server=True, servername=server)
    except jack.JackError:
        name = f"server {server!r}" if server else "server"
        command = f"jackd -R{f' -n {server}' if server else ''} -d alsa -r 48000 -p 64"
        return [Device("jack", False, f"no {name} is running", f"start one, such as {command}")]
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
            f"a server at {client.samplerate} Hz, blocks of {client.blocksize}, {outs} outputs,"
            f" {ins} inputs"
        )
        return [
            Device(
                "jack",
                True,
                what,
                f"--sink jack --fs {client.samplerate}{f' --device {server}' if server else ''}",
            )
        ]
    finally:
        client.close()


def _on_portaudio() -> list[Device]:
    from . import portaudio as sink

    try:
        sd = sink._sounddevice()
    except SinkError as e:
        return [Device("portaudio", False, *_split(e))]
    apis, found = sd.query_hostapis(), []
    for d in sd.query_devices():
        if d["max_output_channels"]:
            api, rate = apis[d["hostapi"]]["name"], d["default_samplerate"]
            what = (
                f"{d['name']!r} ({api}), {d['max_output_channels']} outputs,"
                f" {d['max_input_channels']} inputs"
            )
            found.append(
                Device(
                    "portaudio", True, what, f"--sink portaudio --device {d['index']} --fs {rate:g}"
                )
            )
    return found or [
        Device(
            "portaudio",
            False,
            "PortAudio finds no output",
            "connect a sound card, or start a JACK or PulseAudio server",
        )
    ]


def _split(e: SinkError) -> tuple[str, str]:
    what, _, how = str(e).rpartition(": ")
    return what, how
