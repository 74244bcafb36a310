"""The commands ``show`` and ``list``."""

from __future__ import annotations

import inspect
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from ..errors import shown
from . import options as opt
from .app import command, print_json
from .scene import SceneText, scene_of, shipped

if TYPE_CHECKING:
    from ..core.scene import Scene


@command("show")
def show(
    scene: SceneText,
    fs: opt.Rate = 8000.0,
    draw: Annotated[
        Path | None, typer.Option(help="Also draw the graph: .svg, .png or .pdf.")
    ] = None,
    save: Annotated[Path | None, typer.Option(help="Also save the scene as JSON.")] = None,
    plan_: Annotated[
        bool, typer.Option("--plan", help="Also print the plan: the inner blocks, in their order.")
    ] = False,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Show a scene: what is felt, its law, and a command to try it; draw its graph.

    [bold]stimlib show squeeze --draw squeeze.svg[/]

    [bold]stimlib show squeeze --plan[/]
    """
    from ..analysis.passivity import damping_in
    from ..core.program import prepare, rate
    from ..core.units import unit as core_unit
    from ..run.plan import plan_of

    made = scene_of(scene, import_)
    if draw is not None:
        from ..analysis.draw import draw as draw_graph

        draw_graph(made, draw)
    if save is not None:
        made.save(save)
    program, design, _ = prepare(made, rate(fs))  # nothing runs, so no processor is needed
    values = {name: param.value for name, param in made.params.items()}
    plan, needed = plan_of(program, fs), damping_in(made, program, design, fs, values)
    if json_:
        found = [{"output": y, "input": x, "needed_damping": b} for (y, x), b in needed.items()]
        facts = {
            "fs": plan.fs,
            "plan": [row._asdict() for row in plan.rows],
            "removed": plan.removed,
            "passivity": found,
        }
        print_json(_facts(made) | facts)
    else:
        print(shown(made))
        for what, text in _told(scene, made):
            print(shown(f"{what:6} {text}"))
        if plan_:
            print(shown(plan))
        for (y, x), b in needed.items():
            unit = made.outputs[y].dim * core_unit("s") / made.inputs[x].dim
            print(
                shown(
                    f"warning: {y} over {x} is passive only in a device with damping of {b:.3g}"
                    f" {unit}, and more where it is late"
                )
            )


@command("list")
def list_(json_: opt.Json = False):
    """List the shipped scenes with their parameters, and the motions.

    [bold]stimlib list[/]
    """
    from ..motion.generators import GENERATORS
    from ..scenes import ROWS

    if json_:
        scenes = {name: _call(make) | _facts(make()) for name, make in shipped().items()}
        return print_json(
            {"scenes": scenes, "motions": {name: _call(g) for name, g in GENERATORS.items()}}
        )
    out = Console(emoji=False)
    for name, make in shipped().items():
        out.print(f"[bold]{name}[/]{_words(make)}", soft_wrap=True)
        out.print(f"    {ROWS[name].felt}", soft_wrap=True)
    out.print("stimlib show NAME prints the law of a scene, and a command to play it")
    out.print("[bold]motions[/]")
    for name, generator in GENERATORS.items():
        out.print(f"    [bold]{name}[/]{_words(generator)}  {_summary(generator)}", soft_wrap=True)


def _told(text: str, scene: Scene) -> Iterator[tuple[str, str]]:
    """Yield what is felt, the laws, and a command for each way to try a scene."""
    from ..core.units import pretty
    from ..scenes import ROWS
    from ..scenes.about import about

    rows = [ROWS[part.law] for part in scene.parts if part.law in ROWS]
    for row in rows:
        yield "felt:", row.felt
        yield "law:", row.words
    said = about(scene)
    yield from (
        (
            "live:",
            f"{n} = {p.value:g} {pretty(p.unit)}".rstrip() + f"  {said['meanings'].get(n, '')}",
        )
        for n, p in scene.params.items()
    )
    for row in said["fixed"]:
        yield (
            "fixed:",
            " = ".join(filter(None, (row["name"], row["value"]))) + f"  {row['meaning']}",
        )
    name = shlex.quote(text)
    yield "try:", f"stimlib live {name}"
    drive = {n: m for row in rows[:1] for n, m in row.drive.items() if n in scene.inputs}
    dims = {n: f"{out.dim}" for n, out in scene.outputs.items()}
    known = len(rows) == 1 and {"1", *rows[0].full} >= {*dims.values()}
    if known and drive.keys() == scene.inputs.keys():
        units = [f"{n}={rows[0].full[dim]:g}" for n, dim in dims.items() if dim != "1"]
        words = [f"--motion {shlex.quote(f'{n}={m}')}" for n, m in drive.items()]
        words += [f"--full-scale {','.join(units)}"] * bool(units)
        yield "", " ".join(["stimlib play", name, *words, "--seconds 3"])


def _words(function: Callable[..., Any]) -> str:
    """Return the arguments of a function with their defaults."""
    from rich.markup import escape

    known = inspect.signature(function).parameters.values()
    return escape(f"({', '.join(str(p.replace(annotation=p.empty)) for p in known)})")


def _facts(scene: Scene) -> dict[str, Any]:
    """Return the inputs, parameters, outputs and hash of a scene as plain data."""
    return {
        "inputs": {n: {"unit": str(b.dim)} for n, b in scene.inputs.items()},
        "params": {n: {"value": b.value, "unit": str(b.dim)} for n, b in scene.params.items()},
        "outputs": {n: {"unit": str(b.dim)} for n, b in scene.outputs.items()},
        "hash": scene.hash,
    }


def _call(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the summary of a function, and its arguments with their defaults.

    A required argument has the default None.
    """
    known = inspect.signature(function).parameters.values()
    defaults = {p.name: None if p.default is p.empty else p.default for p in known}
    return {"what": _summary(function), "arguments": defaults}


def _summary(function: Callable[..., Any]) -> str:
    return (inspect.getdoc(function) or "").splitlines()[0].replace("``", "")
