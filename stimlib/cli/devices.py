"""``play``, ``devices`` and ``loopback``: what needs a device."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

import typer

from ..devices import available
from ..errors import BadValue, FaultError, SinkError
from ..system.progress import progress
from . import options as opt
from .app import Output, command, end, errors, failed, print_json
from .motions import motions_of
from .scene import SceneText, params_of, run_files, scene_of, touching

SinkName: Any = Literal[tuple(available.SINKS)]


def safety_of(
    *,
    full_scale: Annotated[
        str,
        typer.Option(
            help=(
                "Physical value that 1.0 at the device makes, such as 50 (N); nothing goes beyond."
                " For different units: "
                "a=50,b=0.1."
            ),
            show_default=False,
        ),
    ],
    peak: Annotated[float | None, typer.Option(help="Largest force in N, of outputs in N.")] = None,
    static: Annotated[
        float | None, typer.Option(help="Largest lasting force in N, of outputs in N.")
    ] = None,
    slew: Annotated[
        str | None,
        typer.Option(
            help=(
                "Fastest change, in units of the outputs per second; of each output as in"
                " --full-scale."
            )
        ),
    ] = None,
) -> Any:
    """Return the safety stage that the options ask for."""
    from ..run.safety import Safety

    return Safety(
        opt.of_each(full_scale, "--full-scale"),
        slew=opt.of_each(slew, "--slew"),
        peak=peak,
        static=static,
    )


def _ports(connect: list[str]) -> list[str] | str | None:
    return None if connect == ["none"] else connect or "system"


def _play(
    sink: Any,
    fs: float,
    channels: int | None,
    block: int | None,
    seconds: float | None,
    wanted: bool,
) -> None:
    """Play to the end with a progress bar on a terminal; the sink always fades out."""
    with sink:
        sink.open(fs, channels, block)
        sink.start(seconds)
        with progress(
            "playing; Ctrl-C ends", None if seconds is None else round(seconds * fs), wanted
        ) as advance:
            done = 0
            while not sink.finished:
                sink.wait(0.1)
                advance(-done + (done := sink.report().produced))
        sink.check()


@command("play", safety=safety_of, motions=motions_of)
def play(
    scene: SceneText,
    safety: Any,
    motions: Any,
    sink: Annotated[
        SinkName,
        typer.Option(help="What plays: [bold]stimlib devices[/]."),
    ] = "null",
    device: Annotated[
        str | None,
        typer.Option(help=" ".join(k.device for k in available.SINKS.values() if k.device)),
    ] = None,
    client: Annotated[
        str | None, typer.Option(help="JACK: name of the client, [bold]stimlib[/] by default.")
    ] = None,
    connect: opt.Connect = [],
    channels: opt.Channels = None,
    block: Annotated[
        int | None, typer.Option(help="Frames per block, where the device lets one choose.")
    ] = None,
    fast: Annotated[
        bool,
        typer.Option(
            "--fast", help="For null, and devices of PortAudio without a clock: as fast as it goes."
        ),
    ] = False,
    seconds: Annotated[
        float | None, typer.Option(help="Length; by default the recording's, else until Ctrl-C.")
    ] = None,
    fs: Annotated[
        float | None,
        typer.Option(
            help=(
                "Sample rate in Hz, which must be the device's; 8000 by default, of a sound file"
                " its own."
            )
        ),
    ] = None,
    set_: opt.SessionParams = [],
    seed: opt.Seed = 0,
    log: opt.Log = None,
    quiet: opt.Quiet = False,
    import_: opt.Import = [],
):
    """Play a scene or a sound file on a device, with the safety stage around it.

    Ctrl-C fades out.

    Exit status 1 when an output failed or the device went away while it played.

    [bold]stimlib play squeeze --sink jack --motion "minimum_jerk(depth=0.02)"
    --full-scale 50 --log monday.stimlog[/] [bold]stimlib play vib.wav --full-scale 1[/]
    """
    run_files(import_)
    recorded: float | None = None
    if scene.lower().endswith((".wav", ".rf64", ".w64", ".caf", ".flac")):
        from ..files.audio import as_scene

        if any(
            given for name, given in motions.keywords.items() if name in ("motion", "map_", "where")
        ):
            raise BadValue(
                f"{scene} is a sound file and has no inputs: leave out --motion, --map and --where"
            )
        made, motion, rate = as_scene(scene)
        if fs not in (None, rate):
            raise BadValue(
                f"--fs {fs:g}: {scene} was recorded at {rate:g} Hz and is played at that: leave out"
                " --fs"
            )
    else:
        made, rate = scene_of(scene), 8000.0
        motion, recorded = motions(made, contact=touching(scene))
    options: dict[str, Any] = {
        "motion": motion,
        "seed": seed,
        "params": params_of(set_),
        "log": log,
    }
    for name, given, value in (
        ("device", device is not None, device),
        ("client", client, client),
        ("connect", connect, _ports(connect)),
        ("fast", fast, False),
    ):
        if given:
            options |= available.option(sink, name, value)
    playing = available.make(sink, made, safety(), **options)
    try:
        _play(
            playing,
            rate if fs is None else fs,
            channels,
            block,
            seconds if seconds is not None else recorded,
            not quiet,
        )
    except (SinkError, FaultError) as e:
        if not playing._started:
            raise
        failed(e)
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        if not playing._started:
            raise
        errors.print("faded out")
        raise typer.Exit(130) from None
    finally:
        if playing._started and not quiet:
            print(playing.report())
            if log is not None:
                print(f"log: {log}")


@command("devices")
def devices(
    server: Annotated[
        str | None, typer.Option(help="Name of the JACK server; JACK's own default otherwise.")
    ] = None,
    json_: opt.Json = False,
):
    """List the devices that can play here, what the others lack, and how to get it.

    [bold]stimlib devices[/]
    """
    found, out = available.devices(server), Output(emoji=False)
    if json_:
        return print_json([asdict(d) for d in found])
    for d in found:
        out.print(
            f"{'[green]ready[/]  ' if d.ready else '[yellow]missing[/]'}  [bold]{d.sink:9}[/]  ",
            end="",
        )
        out.print(f"{d.what}: {d.how}", markup=False, highlight=False, soft_wrap=True)


@command("loopback", safety=safety_of, motions=motions_of)
def loopback(
    scene: SceneText,
    safety: Any,
    motions: Any,
    sink: Annotated[Literal["jack"], typer.Option(help="What plays and records.")] = "jack",
    device: Annotated[str | None, typer.Option(help="Name of the JACK server.")] = None,
    connect: opt.Connect = [],
    capture: Annotated[
        list[str],
        typer.Option(
            help=(
                "Port to record for a channel, such as [bold]system:capture_1[/] at the end of a"
                " cable; by default what "
                "leaves the sink. Repeatable."
            )
        ),
    ] = [],
    tolerance: Annotated[
        float,
        typer.Option(
            help="Of a cable: largest difference after gain and delay, relative to the signal."
        ),
    ] = 0.05,
    channels: opt.Channels = None,
    seconds: opt.Length = None,
    fs: opt.DeviceRate = 8000.0,
    set_: opt.SessionParams = [],
    seed: opt.Seed = 0,
    log: opt.Log = None,
    import_: opt.Import = [],
):
    """Play, record what arrives, compare it with the rendering, measure the delay.

    Exit status 1 when it differs.

    [bold]stimlib loopback squeeze --sink jack --motion "minimum_jerk(depth=0.02)"
    --full-scale 50[/]
    """
    run_files(import_)
    from ..devices.loopback_test import loopback as compare

    made = scene_of(scene)
    motion, recorded = motions(made, contact=touching(scene))
    result = compare(
        made,
        safety(),
        fs,
        seconds if seconds is not None else recorded or 5.0,
        motion=motion,
        channels=channels,
        server=device,
        connect=_ports(connect),
        capture=capture or None,
        log=log,
        tolerance=tolerance,
        seed=seed,
        params=params_of(set_),
    )
    print(result)
    end(result.passed)
