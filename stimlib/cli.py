"""The command line: render, play, verify, show and list scenes."""

from __future__ import annotations

import ast
import errno
import importlib.util
import inspect
import json
import shlex
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from enum import StrEnum
from functools import partial, wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from .core import regular
from .core.scene import Scene, load
from .errors import BadValue, FaultError, SceneError, SinkError, StimlibError, UnknownName, shown
from .version import __version__

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_show_locals=False,
)
errors = Console(stderr=True)


IMPORT = typer.Option(
    "--import",
    metavar="FILE.py",
    help="Your own file, with blocks that the scene has; it is run before anything is read. Repeatable.",
)


def shipped() -> dict[str, Callable[..., Scene]]:
    """Scenes by name."""
    from .scenes import SHIPPED

    return SHIPPED  # type: ignore[return-value]


def _version(wanted: bool) -> None:
    if wanted:
        print(f"stimlib {__version__}")
        raise typer.Exit()


@app.callback()
def main(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")] = False,
):
    """Haptic stimuli composed from small pure blocks: render, play, look at and list them."""


def _begun(text: str) -> list[str]:
    """The shipped scenes whose names begin so, for the shell's completion."""
    return [name for name in shipped() if name.startswith(text)]


SCENE = typer.Argument(
    autocompletion=_begun,
    metavar="SCENE",
    help="A shipped scene ([bold]stimlib list[/]), with numbers if you like: [bold]'squeeze(fingers=1)'[/]; "
    "[bold]path.py:function[/] (your own code; it is run), or a saved "
    "[bold]path.json[/] (data; nothing in it is run).",
    show_default=False,
)


def scene_of(text: str) -> Scene:
    """The scene that SCENE on the command line means.

    Raises
    ------
    UnknownName, SceneError
        Nothing of that name; a function that does not give a scene.

    Examples
    --------
    >>> from stimlib.cli import scene_of
    >>> list(scene_of("squeeze").outputs)
    ['force1', 'force2']
    """
    name, _, words = text.partition("(")
    if name in shipped():
        return _shipped(name, f"({words}" if words else "()")
    path, _, function = text.rpartition(":")
    if path.endswith(".py"):
        return _own(path, function)
    if text.endswith(".json"):
        return load(text)
    raise UnknownName(f"no scene {text!r}: use one of {', '.join(shipped())}, path.py:function or path.json")


_ours: set[str] = set()  # names of the modules that _own has made


def _own(path: str, function: str | None = None) -> Any:
    """Run a file of the user's as the module by whose name scene files know its blocks; what a function in it gives.

    Where the file or the function raises, the error names their line.
    """
    regular.read(path, "scene_bytes", SceneError)  # a regular file
    spec = importlib.util.spec_from_file_location(name := Path(path).stem, path)
    if spec is None or spec.loader is None:
        raise SceneError(f"{path} is no file of Python: name one such as click_block.py")
    if name in (sys.modules.keys() | sys.stdlib_module_names) - _ours:
        raise SceneError(f"{path}: there is another module {name}, which stimlib may need: give the file another name")
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    _ours.add(name)
    try:
        spec.loader.exec_module(module)
        if function is None:
            return None
        if not callable(make := getattr(module, function, None)):
            raise SceneError(f"{path} has no function {function!r}")
        scene = make()
    except Exception as e:
        at = [frame.lineno for frame in traceback.extract_tb(e.__traceback__) if frame.filename == spec.origin]
        line = at[-1] if at else e.lineno if isinstance(e, SyntaxError) else None
        if line is None and isinstance(e, StimlibError):
            raise
        what = str(e) if isinstance(e, StimlibError) else f"{type(e).__name__}: {e}"
        raise SceneError(f"{path}:{line or function or 1}: {what}") from e
    if not isinstance(scene, Scene):
        raise SceneError(f"{path}:{function} returns {type(scene).__name__}, not a Scene")
    return scene


def _import(files: list[str]) -> None:
    """Run the files of --import, so that their blocks are known."""
    for path in files:
        _own(path)


def _shipped(name: str, words: str) -> Scene:
    """A shipped scene called with literal keyword arguments."""
    make = shipped()[name]
    chosen: dict[Any, Any]
    try:
        call = ast.parse(name + words, mode="eval").body
        assert isinstance(call, ast.Call) and not call.args
        chosen = {k.arg: ast.literal_eval(k.value) for k in call.keywords}
        assert None not in chosen
    except (SyntaxError, ValueError, TypeError, AssertionError, RecursionError, MemoryError):  # as deep as the parser goes
        raise BadValue(f"scene {name}{words}: write {name}(name=number, ..)") from None
    known = inspect.signature(make).parameters
    if wrong := set(chosen) - set(known):
        raise UnknownName(f"scene {name} has no {', '.join(sorted(wrong))}; it has {', '.join(known)}")
    return make(**chosen)


def _touching(text: str) -> str:
    """How the scene that is SCENE on the command line gets an input contact."""
    name = text.partition("(")[0]
    return f"use {name}(contact=True)" if name in shipped() else ""


def _pairs(items: list[str], what: str) -> dict[str, str]:
    found = {}
    for item in items:
        name, equals, value = item.partition("=")
        if not equals or not name.strip():
            raise BadValue(f"{what} {item!r}: write NAME=VALUE")
        found[name.strip()] = value.strip()
    return found


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise BadValue(f"--set {name}={text}: {text!r} is not a number") from None


def _live(items: list[str]) -> dict[str, float]:
    """Parameters of --set."""
    return {name: _number(name, text) for name, text in _pairs(items, "--set").items()}


def _print_json(data: Any) -> None:
    """Data for programs, on stdout."""
    print(json.dumps(data, indent=1, allow_nan=False))


def _facts(scene: Scene) -> dict[str, Any]:
    """What a scene takes and gives, as plain data."""
    return {
        "inputs": {n: {"unit": str(b.dim)} for n, b in scene.inputs.items()},
        "params": {n: {"value": b.value, "unit": str(b.dim)} for n, b in scene.params.items()},
        "outputs": {n: {"unit": str(b.dim)} for n, b in scene.outputs.items()},
        "hash": scene.hash,
    }


def _call(function: Callable[..., Any]) -> dict[str, Any]:
    """What a function is for, and its arguments with their defaults; None where one must be given."""
    known = inspect.signature(function).parameters.values()
    defaults = {p.name: None if p.default is p.empty else p.default for p in known}
    return {"what": (inspect.getdoc(function) or "").splitlines()[0], "arguments": defaults}


def _say(what: str, text: Any) -> None:
    """One line on stderr, the text as it is."""
    errors.print(f"{what} ", end="")
    errors.print(shown(text), markup=False, highlight=False, soft_wrap=True)


@contextmanager
def _friendly() -> Iterator[None]:
    """Errors of use in one line, exit status 2; Ctrl-C quietly, 130; what is a defect of stimlib with its traceback, 3."""
    try:
        yield
    except (typer.Exit, typer.Abort, BrokenPipeError):  # what typer makes an end of
        raise
    except StimlibError as e:
        _say("[bold red]error:[/]", e)
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        errors.print("stopped; nothing was left behind")
        raise typer.Exit(130) from None
    except Exception as e:
        if isinstance(e, OSError) and e.errno in (errno.ENOSPC, errno.EIO) and e.filename is None:
            _say("[bold red]error:[/]", f"cannot write what is printed: {e.strerror}")
            raise typer.Exit(2) from None
        errors.print(traceback.format_exc().rstrip(), markup=False, highlight=False, soft_wrap=True)
        _say("[bold red]unexpected error:[/]", f"{type(e).__name__}: {e}; this is a defect of stimlib, please report it")
        raise typer.Exit(3) from None


JSON = typer.Option("--json", help="Print JSON instead, for programs.")


class Reports(StrEnum):
    """What silence of a recording device means."""

    always = "always"
    on_change = "on_change"


class Repeats(StrEnum):
    """What several reports of a recording with one time stamp mean."""

    spread = "spread"
    last = "last"
    mean = "mean"


Command = Callable[..., None]


def _options(f: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    return {n: p for n, p in inspect.signature(f, eval_str=True).parameters.items() if p.kind is p.KEYWORD_ONLY}


def sharing(**shared: Callable[..., Any]) -> Callable[[Command], Command]:
    """A command with the options (keyword-only parameters) of these functions; it gets each function with them filled in."""

    def widened(command: Command) -> Command:
        def run(**given: Any) -> None:
            for name, f in shared.items():
                given[name] = partial(f, **{option: given.pop(option) for option in _options(f)})
            command(**given)

        takes: list[inspect.Parameter] = []
        for name, p in inspect.signature(command, eval_str=True).parameters.items():
            takes += _options(shared[name]).values() if name in shared else [p.replace(kind=p.KEYWORD_ONLY)]
        wraps(command)(run).__signature__ = inspect.Signature(takes)  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in takes}
        return run

    return widened


def _motions(
    scene: Scene,
    default: tuple[str, ...] = (),
    contact: str = "",
    *,
    motion: Annotated[
        list[str],
        typer.Option(
            help="A recording ([bold].csv[/], [bold].npz[/]; needs --map), or a motion of all inputs, such as "
            "[bold]'minimum_jerk(depth=0.02)'[/], or of one: [bold]'x1=sinusoid(0.01, 1)'[/]; repeatable. "
            "See [bold]stimlib list[/]; what a sidecar has under motion is understood too."
        ),
    ] = [],  # noqa: B006
    map_: Annotated[
        list[str],
        typer.Option(
            "--map",
            help="Where an input comes from: [bold]x=force_N*5e-4[/] (column, factor to SI); x serves x1, x2, .. Repeatable.",
        ),
    ] = [],  # noqa: B006
    where: Annotated[
        str | None, typer.Option(help="Which rows of the recording: [bold]grasp=pinch,level=easy,trial=1[/].")
    ] = None,
    time: Annotated[
        str, typer.Option(help="Column of the recording's time stamps, in s: [bold]t_s[/], or such as [bold]t_ms*1e-3[/].")
    ] = "t_s",
    reports: Annotated[
        Reports,
        typer.Option(help="What silence of the recording device means: [bold]always[/] (a gap) or [bold]on_change[/] (still)."),
    ] = Reports.always,
    repeats: Annotated[
        Repeats | None,
        typer.Option(
            help="What several reports with one time stamp mean: [bold]spread[/] (the clock is coarse: evenly up to the next "
            "stamp), [bold]last[/] or [bold]mean[/]; by default they must be equal.",
            show_default=False,
        ),
    ] = None,
    max_speed: Annotated[float, typer.Option(help="Faster than this (m/s) is a fault of the device, not a hand.")] = 1.0,
    max_gap: Annotated[
        float | None,
        typer.Option(
            help="Longest silence of the recording that is joined, in s; needed where it has more than 0.5 s from report to "
            "report.",
            show_default=False,
        ),
    ] = None,
) -> tuple[dict[str, Any], float | None]:
    """Motion of every input, and its length where it is a recording."""
    from .motion.recorded import Recording, parse_map, parse_source, parse_where, recording

    motions: dict[str, Any] = {}
    seconds = None
    files = [text for text in motion if Path(text).suffix.lower() in (".csv", ".npz")]
    if (map_ or where) and not files:
        raise BadValue("--map and --where are for a recording, and there is none: add --motion recording.csv")
    for text in motion or default:
        name, equals, spec = text.partition("=")
        found: Any
        if text in files:
            if not map_:
                raise BadValue(f"{text}: say which column is which input, such as --map 'x=force_N*5e-4'")
            found = recording(
                text,
                parse_map(map_),
                where=parse_where(where) if where else None,
                time=time,
                reports=reports.value,
                repeats=None if repeats is None else repeats.value,
                max_speed=max_speed,
                max_gap=max_gap,
            )
            names = tuple(scene.inputs)
        elif equals and name.strip() in scene.inputs:
            found, names = parse_source(spec), (name.strip(),)
        else:
            found, names = parse_source(text), tuple(scene.inputs)
        if isinstance(found, Recording):
            motions |= found.for_inputs(names, contact)
            seconds = found.duration
        else:
            motions |= dict.fromkeys(names, found)
    if missing := set(scene.inputs) - set(motions):
        raise BadValue(f"no motion for {', '.join(sorted(missing))}: add --motion 'minimum_jerk()' or another of stimlib list")
    return motions, seconds


@app.command("demo")
def demo_(
    folder: Annotated[Path, typer.Argument(help="Where to write it; made if missing.")] = Path("stimlib-demo"),
):
    """Render three stimuli as files, pictures, proofs and copies for ears, and tell what to look at.  Start here.

    Exit status 1 when a check fails.

    [bold]stimlib demo[/]
    """
    with _friendly():
        from rich.table import Table
        from rich.text import Text

        from .demo import demo

        table = Table()
        for column in ("file", "what it is", "what to look at, or listen for"):
            table.add_column(column, overflow="fold")
        passed = True
        with errors.status("rendering, proving and drawing; the first time also compiling"):
            for made in demo(folder):
                for path, what, look in made.files:
                    table.add_row(Text(shown(path)), what, look, end_section=path == made.files[-1][0])
                passed &= made.passed
        Console(width=None if sys.stdout.isatty() else 130).print(table)
        print(f"Open {folder / 'squeeze.png'}, then {folder / 'squeeze.html'}; then: stimlib render --help")
        if not passed:
            raise typer.Exit(1)


@app.command("render")
@sharing(motions=_motions)
def render_(
    scene: Annotated[str, SCENE],
    out: Annotated[Path, typer.Option(help="File to write: .wav, .rf64, .w64, .caf or .flac.", show_default=False)],
    motions: Any,
    seconds: Annotated[float | None, typer.Option(help="Length; by default the recording's, else 5 s.")] = None,
    fs: Annotated[float, typer.Option(help="Sample rate in Hz.")] = 8000.0,
    set_: Annotated[
        list[str], typer.Option("--set", help="A parameter for the whole file, such as [bold]k=2000[/]; may be repeated.")
    ] = [],  # noqa: B006
    seed: Annotated[int, typer.Option(help="Key of all noise.")] = 0,
    full_scale: Annotated[
        float | None, typer.Option(help="Physical value that is stored as 1.0 (needed for FLAC; float formats store any).")
    ] = None,
    subtype: Annotated[str | None, typer.Option(help="FLOAT, DOUBLE or PCM_24; by default what suits the format.")] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Also draw the first 10 s: signals, vibration, force over position, spectra.")
    ] = None,
    quiet: Annotated[bool, typer.Option(help="No progress bar, no report.")] = False,
    import_: Annotated[list[str], IMPORT] = [],  # noqa: B006
):
    """Render a scene into a sound file, with everything needed to repeat it in FILE.json.

    [bold]stimlib render squeeze --motion "minimum_jerk(depth=0.02)" --seconds 5 --full-scale 50 --out squeeze.wav[/]
    """
    with _friendly(), _notes():
        _import(import_)
        from .files import audio as file
        from .run.processor import compile
        from .run.rendering import render

        made = scene_of(scene)
        values = _live(set_)
        motion, recorded = motions(made, contact=_touching(scene))
        length = seconds if seconds is not None else recorded or 5.0
        proc = compile(made, fs, seed=seed)
        for name, value in values.items():
            proc.set(name, value, ramp=0.0)
        report = file.write(out, proc, motion, length, subtype=subtype, full_scale=full_scale, progress=not quiet)
        if not quiet:
            print(report)
            top = max(report.peak.values())
            if full_scale is not None and out.suffix.lower() == ".flac" and 0.0 < top < 0.01 * full_scale:
                share, steps = 100 * top / full_scale, full_scale / 2**23
                text = f"the peak uses {share:.2g} % of full scale, and the file has steps of {steps:.2g}"
                _say("[bold yellow]note:[/]", f"{text}: write it with a full scale of about {1.01 * top:.3g}")
        if picture is not None:
            from .analysis.picture import picture as draw

            draw(render(made, motion, fs, min(length, 10.0), values, seed), picture)


class Sinks(StrEnum):
    """What plays."""

    null = "null"
    jack = "jack"
    portaudio = "portaudio"


CHANNELS = typer.Option(help="Number of the device's channels; the first carry the outputs. By default one for each output.")
CONNECT = typer.Option(help="JACK: port for a channel instead of the physical outputs, or [bold]none[/]; repeatable.")
LOG = typer.Option("--log", help="Folder for the session's log, such as [bold]monday.stimlog[/]: for replay and verify.")
LIVE = typer.Option("--set", help="A parameter for the whole session, such as [bold]k=2000[/]; may be repeated.")
SEED = typer.Option(help="Key of all noise.")
RATE = typer.Option(help="Sample rate in Hz; it must be the device's.")


def _safety(
    *,
    full_scale: Annotated[
        str,
        typer.Option(
            help="Physical value that 1.0 at the device makes, such as 50 (N); nothing goes beyond. For different units: "
            "a=50,b=0.1.",
            show_default=False,
        ),
    ],
    peak: Annotated[float | None, typer.Option(help="Largest force in N, of outputs in N.")] = None,
    static: Annotated[float | None, typer.Option(help="Largest lasting force in N, of outputs in N.")] = None,
    slew: Annotated[
        str | None,
        typer.Option(help="Fastest change, in units of the outputs per second; of each output as in --full-scale."),
    ] = None,
) -> Any:
    from .run.safety import Safety

    def of_each(text: Any) -> Any:
        return {p.partition("=")[0]: p.partition("=")[2] for p in text.split(",")} if text and "=" in text else text

    return Safety(of_each(full_scale), slew=of_each(slew), peak=peak, static=static)


def _ports(connect: list[str]) -> list[str] | str | None:
    if connect == ["none"]:
        return None
    return connect or "system"


@contextmanager
def _notes() -> Iterator[None]:
    """Warnings in one line each."""

    def note(message: Any, *_: Any, **__: Any) -> None:
        _say("[bold yellow]note:[/]", message)

    with warnings.catch_warnings():
        warnings.simplefilter("default", RuntimeWarning)
        warnings.showwarning = note
        yield


def _play(sink: Any, fs: float, channels: int | None, block: int | None, seconds: float | None, progress: bool) -> None:
    """Play to the end, with a progress bar where that is a terminal; whatever comes, the sink fades out."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    with sink:
        sink.open(fs, channels, block)
        sink.start(seconds)
        columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=errors, disable=not (progress and sys.stderr.isatty())) as bar:
            task = bar.add_task("playing; Ctrl-C ends", total=None if seconds is None else round(seconds * fs))
            while not sink.finished:
                sink.wait(0.1)
                bar.update(task, completed=sink.report().produced)
        sink.check()


@app.command()
@sharing(safety=_safety, motions=_motions)
def play(
    scene: Annotated[str, SCENE],
    safety: Any,
    motions: Any,
    sink: Annotated[Sinks, typer.Option(help="What plays: see [bold]stimlib devices[/].")] = Sinks.null,
    device: Annotated[
        str | None, typer.Option(help="JACK: name of the server. PortAudio: name of the device, part of it, or its number.")
    ] = None,
    client: Annotated[str | None, typer.Option(help="JACK: name of the client, [bold]stimlib[/] by default.")] = None,
    connect: Annotated[list[str], CONNECT] = [],  # noqa: B006
    channels: Annotated[int | None, CHANNELS] = None,
    block: Annotated[int | None, typer.Option(help="Frames per block, where the device lets one choose.")] = None,
    fast: Annotated[
        bool, typer.Option("--fast", help="For null, and devices of PortAudio without a clock: as fast as it goes.")
    ] = False,
    seconds: Annotated[float | None, typer.Option(help="Length; by default the recording's, else until Ctrl-C.")] = None,
    fs: Annotated[float, RATE] = 8000.0,
    set_: Annotated[list[str], LIVE] = [],  # noqa: B006
    seed: Annotated[int, SEED] = 0,
    log: Annotated[Path | None, LOG] = None,
    quiet: Annotated[bool, typer.Option(help="No progress bar, no report.")] = False,
    import_: Annotated[list[str], IMPORT] = [],  # noqa: B006
):
    """Play a scene on a device, with the safety stage around it.  Ctrl-C fades out.

    Exit status 1 when an output failed or the device went away while it played.

    [bold]stimlib play squeeze --sink jack --motion "minimum_jerk(depth=0.02)" --full-scale 50 --log monday.stimlog[/]
    """
    with _friendly(), _notes():
        _import(import_)
        made = scene_of(scene)
        motion, recorded = motions(made, contact=_touching(scene))
        options: dict[str, Any] = {
            "motion": motion,
            "seed": seed,
            "params": _live(set_),
            "log": log,
        }
        if fast and sink == Sinks.jack:
            raise BadValue("--fast: a JACK server has its own pace")
        for option, given in (("--connect", connect), ("--client", client)):
            if given and sink != Sinks.jack:
                raise BadValue(f"{option}: is for --sink jack, not for {sink}")
        playing: Any
        if sink == Sinks.jack:
            from .devices.jack import JackSink

            playing = JackSink(made, safety(), name=client or "stimlib", server=device, connect=_ports(connect), **options)
        elif sink == Sinks.portaudio:
            from .devices.portaudio import PortAudioSink

            name = int(device) if device is not None and device.isdecimal() else device
            playing = PortAudioSink(made, safety(), name=name, clocked=not fast, **options)
        else:
            if device is not None:
                raise BadValue("--device: null has no device")
            from .devices.null import NullSink

            playing = NullSink(made, safety(), clocked=not fast, **options)
        try:
            _play(playing, fs, channels, block, seconds if seconds is not None else recorded, not quiet)
        except (SinkError, FaultError) as e:
            if not playing._started:
                raise
            _say("[bold red]error:[/]", e)
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


@app.command()
def devices(
    server: Annotated[str | None, typer.Option(help="Name of the JACK server; JACK's own default otherwise.")] = None,
    json_: Annotated[bool, JSON] = False,
):
    """What a scene can be played on here, why not on the rest, and how to get it.

    [bold]stimlib devices[/]
    """
    with _friendly():
        from .devices.available import devices as look

        found, out = look(server), Console()
        if json_:
            return _print_json([asdict(d) for d in found])
        for d in found:
            out.print(f"{'[green]ready[/]  ' if d.ready else '[yellow]missing[/]'}  [bold]{d.sink:9}[/]  ", end="")
            out.print(f"{d.what}: {d.how}", markup=False, highlight=False, soft_wrap=True)


class Loops(StrEnum):
    """What can play and record at once."""

    jack = "jack"


@app.command()
@sharing(safety=_safety, motions=_motions)
def loopback(
    scene: Annotated[str, SCENE],
    safety: Any,
    motions: Any,
    sink: Annotated[Loops, typer.Option(help="What plays and records.")] = Loops.jack,
    device: Annotated[str | None, typer.Option(help="Name of the JACK server.")] = None,
    connect: Annotated[list[str], CONNECT] = [],  # noqa: B006
    capture: Annotated[
        list[str],
        typer.Option(
            help="Port to record for a channel, such as [bold]system:capture_1[/] at the end of a cable; by default what "
            "leaves the sink. Repeatable."
        ),
    ] = [],  # noqa: B006
    tolerance: Annotated[
        float, typer.Option(help="Of a cable: largest difference after gain and delay, relative to the signal.")
    ] = 0.05,
    channels: Annotated[int | None, CHANNELS] = None,
    seconds: Annotated[float | None, typer.Option(help="Length; by default the recording's, else 5 s.")] = None,
    fs: Annotated[float, RATE] = 8000.0,
    set_: Annotated[list[str], LIVE] = [],  # noqa: B006
    seed: Annotated[int, SEED] = 0,
    log: Annotated[Path | None, LOG] = None,
    import_: Annotated[list[str], IMPORT] = [],  # noqa: B006
):
    """Play, record what arrives, compare it with the offline render, measure the delay.  Exit status 1 when it differs.

    [bold]stimlib loopback squeeze --sink jack --motion "minimum_jerk(depth=0.02)" --full-scale 50[/]
    """
    with _friendly(), _notes():
        _import(import_)
        from .devices.loopback import loopback as compare

        made = scene_of(scene)
        motion, recorded = motions(made, contact=_touching(scene))
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
            params=_live(set_),
        )
        print(result)
    if not result.passed:
        raise typer.Exit(1)


@app.command("verify")
@sharing(motions=_motions)
def verify_(
    motions: Any,
    scene: Annotated[
        str | None,
        typer.Argument(
            metavar="FILE|SCENE",
            help="The sound file that [bold]stimlib render[/] wrote; or the scene that --wav or --log must be of.",
            show_default=False,
        ),
    ] = None,
    wav: Annotated[
        Path | None, typer.Option(help="The sound file, where SCENE says which scene is expected.", show_default=False)
    ] = None,
    log: Annotated[
        Path | None, typer.Option(help="Instead, the log of a session; it has scene and motion.", show_default=False)
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Also write one self-contained HTML page.")] = None,
    import_: Annotated[list[str], IMPORT] = [],  # noqa: B006
    json_: Annotated[bool, JSON] = False,
):
    """Prove that a file, or a session's log, is what the scene and the motion say.  Exit status 1 when a check fails.

    Scene, parameters, seed and motion are read from the file's sidecar, a recording from the path that it tells, if that file
    still has its SHA-256. A motion that its text does not tell is given again, as it was rendered. A log has all of it. If
    SCENE is given, it must be that one.

    [bold]stimlib verify squeeze.wav --report squeeze.html[/]

    [bold]stimlib verify "squeeze(fingers=1)" --wav squeeze.wav[/]

    [bold]stimlib verify --log monday.stimlog[/]
    """
    with _friendly():
        _import(import_)
        from .files.audio import FORMATS

        if scene is not None and Path(scene).suffix[1:].upper() in FORMATS:
            if wav is not None:
                raise BadValue(f"{scene} and {wav} are two files: verify one at a time")
            wav, scene = Path(scene), None
        given = any(motions.keywords[option] for option in ("motion", "map_", "where"))
        if log is not None:
            if wav is not None or given:
                raise BadValue("a log has its motion and its samples: give --log without --wav and --motion")
            from .checks.session import verify_log
            from .files.session import read_log

            expected = None if scene is None else scene_of(scene)  # first: it may define blocks that the log names
            result = verify_log(read_log(log), expected)
        else:
            from .checks.verify import scene_told, verify_file

            if wav is None:
                raise BadValue("say what to verify: FILE.wav, SCENE --wav FILE, or --log LOG")
            expected = None if scene is None else scene_of(scene)
            motion = motions(expected or scene_told(wav), contact=_touching(scene or ""))[0] if given else None
            result = verify_file(wav, expected, motion)
        if report is not None:
            result.to_html(report, shlex.join(["stimlib", *sys.argv[1:]]))
        if json_:
            _print_json(result.to_dict())
        else:
            Console(width=None if sys.stdout.isatty() else 130).print(result)
            if report is not None:
                print(f"report: {report}")
    if not result.passed:
        raise typer.Exit(1)


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(help="The log of a session, NAME.stimlog.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option(help="Also write what the device was given: .wav, .rf64, .w64 or .caf.", show_default=False)
    ] = None,
    import_: Annotated[list[str], IMPORT] = [],  # noqa: B006
):
    """Make the samples of a session again, and compare them with the hashes in its log.  Exit status 1 where they differ.

    [bold]stimlib replay monday.stimlog --out monday.wav[/]
    """
    with _friendly():
        _import(import_)
        from .files.replay import replay as replay_log
        from .files.session import read_log

        result = replay_log(read_log(log), out)
        print(result)
    if not result.matches:
        raise typer.Exit(1)


@app.command()
def recover(
    file: Annotated[Path, typer.Argument(help="The file that was to be written, without .part.", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="Where to write it instead, with the same suffix.", show_default=False)] = None,
):
    """Make a file of what a run of [bold]stimlib render[/] left when it was killed.

    [bold]stimlib recover squeeze.wav[/]
    """
    with _friendly():
        from .files.publish import recover as recover_file

        print(recover_file(file, out))


@app.command("render-set")
@sharing(motions=_motions)
def render_set_(
    folder: Annotated[
        Path, typer.Argument(help="Folder to write the files and index.json into; a set that was interrupted goes on.")
    ],
    motions: Any,
    contact: Annotated[
        bool, typer.Option("--contact", help="The bumps rest while the finger is lifted; for recordings with lifts.")
    ] = False,
    seconds: Annotated[float | None, typer.Option(help="Length of each file; by default the recording's, else 5 s.")] = None,
    fs: Annotated[float, typer.Option(help="Sample rate in Hz.")] = 8000.0,
    repetitions: Annotated[int, typer.Option(help="How often each stimulus is presented, in a new random order each time.")] = 4,
    seed: Annotated[int, typer.Option(help="Of the random order.")] = 0,
    workers: Annotated[int | None, typer.Option(help="Processes; by default one for each core.")] = None,
    quiet: Annotated[bool, typer.Option(help="No progress bar, no report.")] = False,
):
    """Render the 81 bumps of the touch-screen experiment, with an index of the order of presentation.

    The finger strokes 0.1 m at 20 mm/s, unless --motion says otherwise.

    [bold]stimlib render-set bumps/[/]
    """
    with _friendly():
        from .files.batch import render_set
        from .scenes import bumps, bumps_set

        scenes = {f"{s.waveform}_{s.bumps:02d}_{s.duty:g}_{s.amplitude:g}V": bumps(*s, contact=contact) for s in bumps_set()}
        motion, recorded = motions(next(iter(scenes.values())), ("constant_speed(0.02, 0.1)",), "add --contact")
        index = render_set(
            folder,
            scenes,
            motion,
            seconds if seconds is not None else recorded or 5.0,
            fs,
            seed=seed,
            repetitions=repetitions,
            full_scale=400.0,
            workers=workers,
            progress=not quiet,
        )
        if not quiet:
            print(f"{len(scenes)} files and {index}")


@app.command()
def show(
    scene: Annotated[str, SCENE],
    fs: Annotated[float, typer.Option(help="Sample rate in Hz.")] = 8000.0,
    draw: Annotated[Path | None, typer.Option(help="Also draw the graph: .svg, .png or .pdf.")] = None,
    save: Annotated[Path | None, typer.Option(help="Also save the scene as JSON.")] = None,
    import_: Annotated[list[str], IMPORT] = [],  # noqa: B006
    json_: Annotated[bool, JSON] = False,
):
    """What a scene runs: its inputs, parameters and plan, and its graph as a picture.

    [bold]stimlib show squeeze --draw squeeze.svg[/]
    """
    with _friendly():
        _import(import_)
        from .run.processor import compile

        made = scene_of(scene)
        plan = compile(made, fs, target="python").plan
        if json_:
            _print_json(_facts(made) | {"fs": plan.fs, "plan": [row._asdict() for row in plan.rows], "removed": plan.removed})
        else:
            print(shown(made))
            print(shown(plan))
        if draw is not None:
            from .analysis.draw import draw as draw_graph

            draw_graph(made, draw)
        if save is not None:
            made.save(save)


@app.command("list")
def list_(json_: Annotated[bool, JSON] = False):
    """The shipped scenes, with their parameters, and the motions that render understands."""
    with _friendly():
        from .motion.generators import GENERATORS

        if json_:
            scenes = {name: _call(make) | _facts(make()) for name, make in shipped().items()}
            return _print_json({"scenes": scenes, "motions": {name: _call(g) for name, g in GENERATORS.items()}})
        out = Console()
        for name, make in shipped().items():
            made = make()
            out.print(f"[bold]{name}[/]  {(inspect.getdoc(make) or '').splitlines()[0]}", soft_wrap=True)
            out.print(f"    {made!r}", markup=False, highlight=False, soft_wrap=True)
        out.print("[bold]motions[/]")
        for name, generator in GENERATORS.items():
            known = inspect.signature(generator).parameters.values()
            words = ", ".join(p.name if p.default is p.empty else f"{p.name}={p.default}" for p in known)
            out.print(f"    [bold]{name}[/]({words})  {(inspect.getdoc(generator) or '').splitlines()[0]}", soft_wrap=True)
