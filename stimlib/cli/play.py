"""The command ``play``."""

from __future__ import annotations

import time
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Annotated, Any, Literal

import typer

from .. import files
from ..devices import available
from ..errors import BadValue, FaultError, SinkError, counted
from ..system.progress import progress
from ..system.safe_files import unused
from . import options as opt
from .app import command, errors, failed, note, say
from .motions import given, motions_of, streamed
from .scene import SceneText, params_of, run_files, scene_of, touching
from .watching import Watched

SinkName: Any = Literal[tuple(available.SINKS)]


def _play(
    sink: Any,
    fs: float,
    channels: int | list[str | None] | None,
    block: int | None,
    seconds: float | None,
    wanted: bool,
    reloaded: Any,
    course: SimpleNamespace,
) -> None:
    """Play to the end with a progress bar; the sink fades out even after an error.

    Where files are watched, an output that fails ends its version alone, which joins
    ``course.failed``.
    """
    said: set[tuple[Any, str]] = set()
    with sink:
        sink.open(fs, channels, block)
        sink.start(seconds)
        course.begun = time.monotonic()
        frames = None if seconds is None else round(seconds * fs)
        with reloaded, progress("playing; Ctrl-C ends", frames, wanted) as advance:
            done, waits = 0, not isinstance(reloaded, nullcontext)
            # what failed may have faded out before it is asked for here
            while not (now := sink.newest).finished or (
                waits
                and isinstance(now.error, FaultError)
                and (seconds is None or _passed(now, course) < seconds)
            ):
                for stage, names in now.report().clips.items() if wanted else ():
                    if (now, stage) not in said:
                        said.add((now, stage))
                        note(f"{' and '.join(names)} is limited ({stage}) from here on")
                try:
                    now.wait(0.1)
                except FaultError as e:
                    if not waits:
                        raise
                    for one in now.onward():  # it may have followed since
                        if one.error is e and one not in course.failed:
                            course.failed.append(one)
                            failed(f"{e}; save the file again to go on")
                    time.sleep(0.1)
                before, done = done, round(_passed(now, course) * fs)
                advance(done - before)


def _passed(now: Any, course: SimpleNamespace) -> float:
    """Return the seconds since the start, of which a version that failed plays few."""
    played: float = (now.since + now.pump.index) / now.rate
    return max(played, time.monotonic() - course.begun) if course.failed else played


@command("play", safety=opt.safety_of, motions=motions_of)
def play(
    scene: SceneText,
    safety: Any,
    motions: Any,
    sink: Annotated[
        SinkName | None,
        typer.Option(
            help=(
                "Kind of device: [bold]null[/] (none), [bold]jack[/], [bold]portaudio[/] or "
                "[bold]nidaq[/]. By default a JACK server or else a PortAudio device that is "
                "ready, and [bold]null[/] if there is none. NI-DAQ must be named."
            )
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(help=" ".join(k.device for k in available.SINKS.values() if k.device)),
    ] = None,
    client: Annotated[
        str | None, typer.Option(help="JACK: name of the client; [bold]stimlib[/] by default.")
    ] = None,
    connect: opt.Connect = [],
    channels: opt.Channels = None,
    block: Annotated[
        int | None, typer.Option(help="Frames per block, if the device lets you choose.")
    ] = None,
    fast: Annotated[
        bool,
        typer.Option(
            "--fast",
            help="Play as fast as possible, on null and on PortAudio devices without a clock.",
        ),
    ] = False,
    seconds: Annotated[
        float | None,
        typer.Option(help="Length in s; by default that of the recording, or until Ctrl-C."),
    ] = None,
    fs: Annotated[
        float | None,
        typer.Option(
            help=(
                "Sample rate in Hz, which must be the device's. By default that of the device "
                "that is found or of the sound file, or 8000."
            )
        ),
    ] = None,
    calibration: opt.Calibrated = None,
    stream: opt.Stream = None,
    limit: Annotated[
        list[str],
        typer.Option(
            help=(
                "Range of an input of --stream, in its unit, such as [bold]x=-0.1:0.1[/]: a row "
                "beyond it is an outlier and moves nothing. Repeatable."
            )
        ),
    ] = [],
    silence: Annotated[
        Literal["fade", "hold", "stop"],
        typer.Option(
            help=(
                "What the outputs do while --stream is silent for 50 ms or longer: "
                "[bold]fade[/] out, [bold]hold[/] the last row, or [bold]stop[/] the session."
            )
        ),
    ] = "fade",
    marker: opt.Marker = [],
    send: opt.Send = [],
    set_: opt.Params = [],
    seed: opt.Seed = 0,
    log: opt.Log = None,
    watch: Annotated[
        bool,
        typer.Option(
            "--watch",
            help=(
                "When your file is saved, let its scene take the place of the one before, in a "
                "crossfade; with --log, each has a log of its own."
            ),
        ),
    ] = False,
    quiet: opt.Quiet = False,
    import_: opt.Import = [],
):
    """Play a scene or a sound file on a device, with output limits and fades.

    Ctrl-C fades out.

    Exit status 1 when an output failed or the device went away during playback.

    [bold]stimlib play squeeze --motion "minimum_jerk()" --full-scale 50 --sink jack[/]

    [bold]stimlib play tone --set freq=80 --seconds 3[/]

    [bold]stimlib play click_block.py:scene --motion "sinusoid(0.01, 1)" --watch[/]

    [bold]stimlib play squeeze --stream udp:9000 --map "x=0*1e-3" --full-scale 50[/]

    [bold]stimlib play vib.wav --full-scale 1[/]
    """
    watched = Watched(scene, import_)
    if watch and (fast or not watched.paths):
        raise BadValue(
            "--watch: a scene of your own can be saved while it plays: write my_scene.py:NAME,"
            " without --fast"
        )
    limits_of = opt.ranges(limit, "--limit")
    if stream and any(motions.keywords[option] for option in ("motion", "where")):
        raise BadValue("--stream moves all inputs: leave out --motion and --where, or --stream")
    if not stream and (limit or silence != "fade"):
        raise BadValue("--limit and --silence are for --stream, and there is none: add it")
    run_files(import_)
    recorded: float | None = None
    chosen = sink or ("null" if fast else None)
    found = available.first_ready() if chosen is None else None
    kind = found.sink if found else str(chosen)
    sound = scene.lower().endswith((".wav", ".rf64", ".w64", ".caf", ".flac"))
    if sound:
        if stream or given(motions):
            out = "--stream" if stream else "--motion, --map and --where"
            raise BadValue(f"{scene} is a sound file and has no inputs: leave out {out}")
        made, motion, rate = files.as_scene(scene)
        if fs not in (None, rate):
            raise BadValue(
                f"--fs {fs:g}: {scene} was recorded at {rate:g} Hz and is played at that: leave out"
                " --fs"
            )
    else:
        made, rate = scene_of(scene), (found and found.fs) or 8000.0
    params = params_of(set_, made)  # before what is missing
    if stream is None and not sound:
        motion, recorded = motions(made, contact=touching(scene))
    options: dict[str, Any] = {
        "seed": seed,
        "params": params,
        "log": log,
        **opt.calibration(calibration),
    }
    for name, chosen_, value in (
        ("device", device is not None, device),
        ("client", client, client),
        ("connect", connect, opt.ports(connect)),
        ("fast", fast, False),
    ):
        if chosen_:
            options |= available.option(kind, name, value)
    own = calibration is not None and safety.keywords["full_scale"] is None
    limits = options["calibration"].limits(made) if own else safety(made)
    if found and not quiet:
        text = f"{kind}: {found.what}"
        if kind == "null":
            text += "; no sound card or JACK server is ready, as stimlib devices tells"
        elif not safety.keywords["full_scale"]:
            text += "; 1.0 plays 20 dB below full scale: --full-scale 1 for the whole range"
        say(text)
    with opt.senders(send) as senders, opt.rows_of(stream) as rows:
        if stream is not None:
            motion = streamed(rows, made, motions, limits_of, silence)
        options |= {"motion": motion, "markers": marker, "send": senders}
        playing = available.make(kind, made, limits, **options)
        length = seconds if seconds is not None else recorded
        place = (rate if fs is None else fs, opt.channel_map(channels), block)

        sessions: list[Any] = [playing]
        course = SimpleNamespace(begun=0.0, failed=[])

        def played(scene_: Any) -> str:
            """Let a scene that was saved follow, for the rest of the time."""
            new, old = None if own else safety(scene_), playing.newest
            left = None if length is None else length - _passed(old, course)
            if left is not None and left < 0.2:
                return "is not played, because the time is over"
            there = [item for item in set_ if item.partition("=")[0].strip() in scene_.params]
            for item in set_:
                if item not in there:
                    note(f"--set {item}: this version has no such parameter")
            how = {"seed": seed, "markers": marker, "send": senders}
            if stream is None:  # else the rows go on
                how["motion"] = motions(scene_, contact=touching(scene))[0]
            elif scene_.inputs.keys() != made.inputs.keys():
                how["motion"] = streamed(rows, scene_, motions, limits_of, silence)
            how |= {"params": params_of(there, scene_), "log": log and unused(log)}
            sessions.append(playing.crossfade(scene_, new, seconds=left, **how))
            return "plays"

        reloaded = watched.reloaded(played) if watch else nullcontext()
        _played(sessions, course, place, length, quiet, reloaded)


def _played(
    sessions: list[Any],
    course: SimpleNamespace,
    place: tuple[float, int | list[str | None] | None, int | None],
    length: float | None,
    quiet: bool,
    reloaded: Any,
) -> None:
    """Play to the end, then print the report of each session, and where its log is."""
    playing = sessions[0]
    try:
        _play(playing, *place, length, not quiet, reloaded, course)
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
            for k, session in enumerate(sessions, 1):
                print(f"version {k}: " * (len(sessions) > 1) + str(session.report()))
                if session._log_to is not None:
                    print(f"log: {session._log_to}")
            print(_ending(sessions))


def _ending(sessions: list[Any]) -> str:
    """Return the last line: how long was played, and whether all of it was."""
    reports = [session.report() for session in sessions]
    delivered = sum(r.delivered for r in reports)
    for before, report, after in zip(sessions, reports, sessions[1:], strict=False):
        begun = min(before.pump.read("FADE_AT"), before.pump.read("END"))  # a request may be late
        delivered -= max(report.produced - max(after.at, begun), 0)  # both play for a fade
    seconds = delivered / sessions[0].rate
    lost = sum(r.lost for r in reports)
    return f"played {seconds:.4g} s, {counted(lost, 'sample') if lost else 'nothing'} lost"
