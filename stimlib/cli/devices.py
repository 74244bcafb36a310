"""The commands ``devices`` and ``loopback``."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

import typer
from rich.console import Console

from ..devices import available
from ..errors import counted
from . import options as opt
from .app import command, end, print_json, say
from .motions import motions_of
from .scene import SceneText, params_of, scene_of, touching


@command("devices")
def devices(
    server: Annotated[
        str | None, typer.Option(help="Name of the JACK server; by default JACK's own.")
    ] = None,
    streams: Annotated[
        bool, typer.Option("--streams", help="List the streams of LSL instead, for motion.")
    ] = False,
    json_: opt.Json = False,
):
    """List the devices that can play here, and what to install for the others.

    [bold]stimlib devices[/]

    [bold]stimlib devices --streams[/]
    """
    out = Console(emoji=False)
    if streams:
        from ..devices.transports import lsl_streams

        seen = lsl_streams()
        if json_:
            return print_json(seen)
        for s in seen:
            what = f"{counted(s['channels'], 'channel')}, {s['fs']:g} Hz"
            say(f"{s['name']} ({s['type']}) of {s['host']}: {what}", out)
        return None
    found = available.devices(server)
    if json_:
        return print_json([asdict(d) for d in found])
    for d in found:
        ready = "[green]ready[/]  " if d.ready else "[yellow]missing[/]"
        out.print(f"{ready}  [bold]{d.sink:9}[/]  ", end="")
        say(f"{d.what}: {d.how}", out)


@command("loopback", safety=opt.safety_of, motions=motions_of)
def loopback(
    scene: SceneText,
    safety: Any,
    motions: Any,
    sink: Annotated[
        Literal["jack"], typer.Option(help="Kind of device that plays and records: [bold]jack[/].")
    ] = "jack",
    device: Annotated[str | None, typer.Option(help="Name of the JACK server.")] = None,
    connect: opt.Connect = [],
    capture: Annotated[
        list[str],
        typer.Option(
            help=(
                "Port to record for a channel, such as [bold]system:capture_1[/] at the end of a "
                "cable; by default the sink's own output. Repeatable."
            )
        ),
    ] = [],
    tolerance: Annotated[
        float,
        typer.Option(
            help=(
                "With a cable: largest difference that passes, relative to the signal, after "
                "correcting gain and delay."
            )
        ),
    ] = 0.05,
    channels: opt.Channels = None,
    seconds: opt.Length = None,
    fs: opt.DeviceRate = 8000.0,
    set_: opt.Params = [],
    seed: opt.Seed = 0,
    log: opt.Log = None,
    import_: opt.Import = [],
):
    """Play and record a scene, compare the two, and measure the delay.

    Exit status 1 when the recording differs.

    [bold]stimlib loopback squeeze --motion "minimum_jerk()" --full-scale 50[/]
    """
    from ..devices.jack_loopback import loopback as compare

    made = scene_of(scene, import_)
    motion, recorded = motions(made, contact=touching(scene))
    result = compare(
        made,
        safety(made),
        fs,
        opt.length(seconds, recorded),
        motion=motion,
        channels=opt.channel_map(channels),
        server=device,
        connect=opt.ports(connect),
        capture=capture or None,
        log=log,
        tolerance=tolerance,
        seed=seed,
        params=params_of(set_, made),
    )
    print(result)
    end(result.passed)
