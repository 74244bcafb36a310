"""Options of the commands that take a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ..errors import BadValue, UnknownName
from .scene import number


def motions_of(
    scene: Any,
    default: tuple[str, ...] = (),
    contact: str = "",
    all_: bool = True,
    *,
    motion: Annotated[
        list[str],
        typer.Option(
            help="A recording ([bold].csv[/], [bold].npz[/]; needs --map) or a motion such as "
            "[bold]'minimum_jerk(depth=0.02)'[/] for all inputs; or for one input:"
            " [bold]'press=sinusoid(0.5, 1)'[/], "
            "[bold]x=my.csv[/]. Repeatable: an input with a motion of its own does not take the one"
            " of all. "
            "See [bold]stimlib list[/]; what a sidecar has under motion is understood too."
        ),
    ] = [],
    map_: Annotated[
        list[str],
        typer.Option(
            "--map",
            help=(
                "Where an input comes from: [bold]x=force_N*5e-4[/] (column, factor to SI); x"
                " serves x1, x2, .. Repeatable."
            ),
        ),
    ] = [],
    where: Annotated[
        str | None,
        typer.Option(help="Rows of the recording to use: [bold]grasp=pinch,level=easy,trial=1[/]."),
    ] = None,
    time: Annotated[
        str,
        typer.Option(
            help=(
                "Column of the recording's time stamps, in s: [bold]t_s[/], or such as"
                " [bold]t_ms*1e-3[/]."
            )
        ),
    ] = "t_s",
    reports: Annotated[
        Literal["always", "on_change"],
        typer.Option(
            help=(
                "Meaning of silence in the recording: [bold]always[/] (a gap: the device reports"
                " all the time) or [bold]on_change[/] (it reports changes only: no movement)."
            )
        ),
    ] = "always",
    repeats: Annotated[
        Literal["spread", "last", "mean"] | None,
        typer.Option(
            help=(
                "Meaning of several reports with one time stamp: [bold]spread[/] (the clock is"
                " coarse: evenly up to the next "
                "stamp), [bold]last[/] or [bold]mean[/]; by default they must be equal."
            ),
            show_default=False,
        ),
    ] = None,
    max_speed: Annotated[
        str,
        typer.Option(
            help=(
                "Movement faster than this (m/s) counts as a fault of the device; only inputs in"
                " metres are checked. For other "
                "limits, or units: [bold]x=2,press=100[/] (of each per second; the others have"
                " none)."
            )
        ),
    ] = "1",
    max_gap: Annotated[
        float | None,
        typer.Option(
            help=(
                "Longest silence in the recording, in s, over which it is interpolated; needed"
                " where it has more than 0.5 s from report to report."
            ),
            show_default=False,
        ),
    ] = None,
) -> tuple[dict[str, Any], float | None]:
    """Return the motion of every input, and its length if it is recorded.

    With ``all_=False`` some inputs are enough.
    """
    from ..motion.recorded import Recording, parse_source, recording, served_by
    from ..motion.text import parse_map, parse_where

    inputs, columns = list(scene.inputs), parse_map(map_)
    own, of_all = _assigned(motion or default, inputs)
    texts = {name: text for name in inputs if (text := own.get(name, of_all))}
    served = {name: served_by(name, columns, inputs) for name in inputs}
    _check_map(columns, texts, served)
    if (map_ or where) and not any(map(_is_file, texts.values())):
        raise BadValue(
            "--map and --where are for a recording, and there is none: add --motion recording.csv"
        )
    motions: dict[str, Any] = {}
    recordings: list[Recording] = []
    for text in dict.fromkeys(texts.values()):
        names = [name for name in inputs if texts.get(name) == text]
        found: Any
        if _is_file(text):
            used = {column: columns[column] for name in names if (column := served[name])}
            if not used:
                raise _unmapped(text, names)
            in_metres = [
                column
                for name, column in served.items()
                if column and str(scene.inputs[name].dim) == "m"
            ]
            found = recording(
                text,
                used,
                where=parse_where(where) if where else None,
                time=time,
                reports=reports,
                repeats=repeats,
                max_speed=_max_speed(max_speed, list(used), in_metres, columns),
                max_gap=max_gap,
            )
        else:
            found = parse_source(text)
        if isinstance(found, Recording):
            recordings.append(found)
            found = found.motion_for(
                dict.fromkeys([*names, *(name for name in inputs if name == "contact")]), contact
            )
            motions |= {name: found[name] for name in names}
        else:
            motions |= dict.fromkeys(names, found)
    if "contact" in inputs and "contact" not in own and recordings:
        if len(recordings) > 1:
            raise BadValue(
                "contact: each recording has one; say which serves, such as --motion contact=my.csv"
            )
        motions["contact"] = recordings[0].contact
    if all_ and (missing := set(inputs) - set(motions)):
        raise BadValue(
            f"no motion for {', '.join(sorted(missing))}: add --motion 'minimum_jerk()' or another"
            " of stimlib list"
        )
    return motions, max((found.duration for found in recordings), default=None)


def _is_file(text: str) -> bool:
    return Path(text).suffix.lower() in (".csv", ".npz")


def _assigned(motion: Sequence[str], inputs: Sequence[str]) -> tuple[dict[str, str], str]:
    """Return what --motion says of single inputs, and of all others."""
    from ..motion.recorded import served_by

    own: dict[str, str] = {}
    of_all = ""
    for text in motion:
        name, _, spec = (part.strip() for part in text.partition("="))
        if names := [n for n in inputs if served_by(n, [name], inputs)]:
            own |= dict.fromkeys(names, spec)
        elif of_all:
            raise BadValue(
                f"--motion {of_all} and {text}: both are of all inputs; say of which each is, such"
                f" as {inputs[0]}={text}"
            )
        else:
            of_all = text
    return own, of_all


def _check_map(
    columns: Mapping[str, str], texts: Mapping[str, str], served: Mapping[str, str | None]
) -> None:
    """Check that each --map serves an input that takes a recording."""
    for column in columns:
        names = [name for name, by in served.items() if by == column]
        if not names:
            raise UnknownName(
                f"--map {column}: the scene has no input {column}; the inputs are:"
                f" {', '.join(served) or 'none'}"
            )
        given = [texts[name] for name in names if name in texts]
        if given and not any(map(_is_file, given)) and any(map(_is_file, texts.values())):
            raise BadValue(
                f"--map {column}: {names[0]} has a motion of its own, {given[0]}: leave out one of"
                " the two"
            )


def _unmapped(file: str, names: Sequence[str]) -> BadValue:
    """Return the error of a recording without --map.

    Of a file that is none, the reader of tables reports first.
    """
    from ..motion.table import read_table

    there = ", ".join(read_table(file).names[:12])
    return BadValue(
        f"{file}: name the column of {', '.join(names)}, such as --map 'x=force_N*5e-4'; the"
        f" columns are: {there}"
    )


def _max_speed(
    text: str, used: Sequence[str], in_metres: Sequence[str], columns: Mapping[str, str]
) -> Any:
    """Return the speed limit of a recording.

    A number is for what is in metres, NAME=NUMBER for what it names.
    """
    from ..motion.text import pairs

    limits = (
        pairs(text.split(","), "--max-speed", "NAME=NUMBER,NAME=NUMBER")
        if "=" in text
        else dict.fromkeys(in_metres, text)
    )
    if wrong := [name for name in limits if name not in columns]:
        raise UnknownName(
            f"--max-speed {wrong[0]}: there is no --map {wrong[0]}; there is {', '.join(columns)}"
        )
    speeds = {name: number(limits[name], f"--max-speed {text}") for name in used if name in limits}
    return speeds[used[0]] if "=" not in text and len(speeds) == len(used) else speeds
