"""Options of the commands that take a motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ..core.scene import Scene
from ..errors import BadValue


def motions_of(
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
    ] = [],
    map_: Annotated[
        list[str],
        typer.Option(
            "--map",
            help="Where an input comes from: [bold]x=force_N*5e-4[/] (column, factor to SI); x serves x1, x2, .. Repeatable.",
        ),
    ] = [],
    where: Annotated[
        str | None, typer.Option(help="Which rows of the recording: [bold]grasp=pinch,level=easy,trial=1[/].")
    ] = None,
    time: Annotated[
        str, typer.Option(help="Column of the recording's time stamps, in s: [bold]t_s[/], or such as [bold]t_ms*1e-3[/].")
    ] = "t_s",
    reports: Annotated[
        Literal["always", "on_change"],
        typer.Option(help="What silence of the recording device means: [bold]always[/] (a gap) or [bold]on_change[/] (still)."),
    ] = "always",
    repeats: Annotated[
        Literal["spread", "last", "mean"] | None,
        typer.Option(
            help="What several reports with one time stamp mean: [bold]spread[/] (the clock is coarse: evenly up to the next "
            "stamp), [bold]last[/] or [bold]mean[/]; by default they must be equal.",
            show_default=False,
        ),
    ] = None,
    max_speed: Annotated[float, typer.Option(help="Faster than this (m/s) is a fault of the device, not movement.")] = 1.0,
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
    from ..motion.recorded import Recording, parse_source, recording
    from ..motion.text import parse_map, parse_where

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
                raise BadValue(f"{text}: name the column of each input, such as --map 'x=force_N*5e-4'")
            found = recording(
                text,
                parse_map(map_),
                where=parse_where(where) if where else None,
                time=time,
                reports=reports,
                repeats=repeats,
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
