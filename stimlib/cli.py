"""The command line: render, show and list scenes."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from .errors import BadValue, SceneError, StimlibError, UnknownName
from .scene import Scene, load

app = typer.Typer(
    help="Haptic stimuli composed from small pure blocks: render, look at and list them.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_show_locals=False,
)
errors = Console(stderr=True)

SCENE = typer.Argument(
    metavar="SCENE",
    help="A shipped scene ([bold]stimlib list[/]), [bold]path.py:function[/] (your own code; it is run), or a saved "
    "[bold]path.json[/] (data; nothing in it is run).",
    show_default=False,
)


def shipped() -> dict[str, object]:
    """Scenes by name."""
    from . import scenes

    return {name: getattr(scenes, name) for name in scenes.__all__}


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
    if text in shipped():
        return shipped()[text]()  # type: ignore[operator]
    path, _, function = text.rpartition(":")
    if path.endswith(".py"):
        if not Path(path).is_file():
            raise SceneError(f"no file {path}")
        spec = importlib.util.spec_from_file_location(Path(path).stem, path)
        assert spec and spec.loader
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module
        spec.loader.exec_module(module)
        if not callable(make := getattr(module, function, None)):
            raise SceneError(f"{path} has no function {function!r}")
        if not isinstance(scene := make(), Scene):
            raise SceneError(f"{text} returns {type(scene).__name__}, not a Scene")
        return scene
    if text.endswith(".json"):
        return load(text)
    raise UnknownName(f"no scene {text!r}: use one of {', '.join(shipped())}, path.py:function or path.json")


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


@contextmanager
def _friendly() -> Iterator[None]:
    """Errors of ours in one line, exit status 2; Ctrl-C quietly, exit status 130."""
    try:
        yield
    except StimlibError as e:
        errors.print("[bold red]error:[/] ", end="")
        errors.print(str(e), markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        errors.print("stopped; nothing was left behind")
        raise typer.Exit(130) from None


@app.command("render")
def render_(
    scene: Annotated[str, SCENE],
    out: Annotated[Path, typer.Option(help="File to write: .wav, .rf64, .w64, .caf or .flac.", show_default=False)],
    motion: Annotated[
        list[str],
        typer.Option(
            help="Motion of all inputs, such as [bold]'minimum_jerk(depth=0.02)'[/], or of one: [bold]'x1=sinusoid(0.01, 1)'[/]. "
            "Repeat for more inputs; see [bold]stimlib list[/].",
        ),
    ] = [],  # noqa: B006
    seconds: Annotated[float, typer.Option(help="Length.")] = 5.0,
    fs: Annotated[float, typer.Option(help="Sample rate in Hz.")] = 8000.0,
    set_: Annotated[
        list[str], typer.Option("--set", help="A live number for the whole file, such as [bold]k=2000[/]; may be repeated.")
    ] = [],  # noqa: B006
    seed: Annotated[int, typer.Option(help="Key of all noise.")] = 0,
    full_scale: Annotated[
        float | None, typer.Option(help="Physical value that is stored as 1.0 (needed for FLAC; float formats store any).")
    ] = None,
    subtype: Annotated[str | None, typer.Option(help="FLOAT, DOUBLE or PCM_24; by default what suits the format.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Also draw motion, outputs and spectrum of the first 10 s.")] = None,
    quiet: Annotated[bool, typer.Option(help="No progress bar, no report.")] = False,
):
    """Render a scene into a sound file, with everything needed to repeat it in FILE.json.

    [bold]stimlib render squeeze --motion "minimum_jerk(depth=0.02)" --seconds 5 --out squeeze.wav[/]
    """
    with _friendly():
        from .devices import file
        from .devices.motion import parse_motion
        from .processor import compile
        from .rendering import render

        made = scene_of(scene)
        values = {n: _number(n, v) for n, v in _pairs(set_, "--set").items()}
        motions = {}
        for text in motion:
            name, equals, spec = text.partition("=")
            if equals and name.strip() in made.inputs:
                motions[name.strip()] = parse_motion(spec)
            else:
                motions |= dict.fromkeys(made.inputs, parse_motion(text))
        if missing := set(made.inputs) - set(motions):
            raise BadValue(
                f"no motion for {', '.join(sorted(missing))}: add --motion 'minimum_jerk()' or another of stimlib list"
            )
        proc = compile(made, fs, seed=seed)
        for name, value in values.items():
            proc.set(name, value, ramp=0.0)
        report = file.write(out, proc, motions, seconds, subtype=subtype, full_scale=full_scale, progress=not quiet)
        if not quiet:
            print(report)
        if picture is not None:
            from .checks.picture import picture as draw

            draw(render(made, motions, fs, min(seconds, 10.0), values, seed), picture)


@app.command()
def show(
    scene: Annotated[str, SCENE],
    fs: Annotated[float, typer.Option(help="Sample rate in Hz.")] = 8000.0,
    draw: Annotated[Path | None, typer.Option(help="Also draw the graph: .svg, .png or .pdf.")] = None,
    save: Annotated[Path | None, typer.Option(help="Also save the scene as JSON.")] = None,
):
    """What a scene runs: its inputs, live numbers and plan, and its graph as a picture.

    [bold]stimlib show squeeze --draw squeeze.svg[/]
    """
    with _friendly():
        from .processor import compile

        made = scene_of(scene)
        print(made)
        print(compile(made, fs, target="python").plan)
        if draw is not None:
            from .checks.draw import draw as draw_graph

            draw_graph(made, draw)
        if save is not None:
            made.save(save)


@app.command("list")
def list_():
    """The shipped scenes, with their live numbers, and the motions that render understands."""
    with _friendly():
        from .devices.motion import GENERATORS

        out = Console()
        for name, make in shipped().items():
            made = make()  # type: ignore[operator]
            out.print(f"[bold]{name}[/]  {(inspect.getdoc(make) or '').splitlines()[0]}", soft_wrap=True)
            out.print(f"    {made!r}", markup=False, highlight=False, soft_wrap=True)
        out.print("[bold]motions[/]")
        for name, make in GENERATORS.items():
            words = [
                p.name if p.default is p.empty else f"{p.name}={p.default}" for p in inspect.signature(make).parameters.values()
            ]
            out.print(f"    [bold]{name}[/]({', '.join(words)})  {(inspect.getdoc(make) or '').splitlines()[0]}", soft_wrap=True)


if __name__ == "__main__":
    app()
