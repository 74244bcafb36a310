"""Options of the commands that accept a motion."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ..errors import BadValue, UnknownName, need
from .scene import number

if TYPE_CHECKING:  # --help needs no numpy
    from ..motion.recorded import Recording


def motions_of(
    scene: Any,
    default: tuple[str, ...] = (),
    contact: str = "",
    all_: bool = True,
    *,
    motion: Annotated[
        list[str],
        typer.Option(
            help=(
                "A motion for all inputs: a generator such as [bold]'minimum_jerk(depth=0.02)'[/]"
                " ([bold]stimlib list[/]), or a recording (such as .csv, .tsv, .txt, .trc, "
                ".xdf, .c3d, also .gz, .npz or .mat; needs --map). With a name, a motion for one "
                "input: [bold]'press=sinusoid(0.5, 1)'[/], [bold]x=my.csv[/]. Repeatable. A "
                "motion copied from a sidecar works too."
            )
        ),
    ] = [],
    map_: Annotated[
        list[str],
        typer.Option(
            "--map",
            help=(
                "Column of an input, with its factor to SI units: [bold]x=force_N*5e-4[/]. x "
                "serves x1, x2, .. Repeatable."
            ),
        ),
    ] = [],
    where: Annotated[
        str | None,
        typer.Option(
            help=(
                "Rows of the recording to use, by column: [bold]grasp=pinch,level=easy,trial=1[/]."
            )
        ),
    ] = None,
    time: Annotated[
        str,
        typer.Option(
            help=(
                "Column of the recording's time stamps, converted to s: [bold]t_s[/] or "
                "[bold]t_ms*1e-3[/]."
            )
        ),
    ] = "t_s",
    reports: Annotated[
        Literal["always", "on_change"],
        typer.Option(
            help=(
                "How the device reports: [bold]always[/] (a longer silence is a gap) or "
                "[bold]on_change[/] (only changes, so silence means no movement)."
            )
        ),
    ] = "always",
    repeats: Annotated[
        Literal["spread", "last", "mean"] | None,
        typer.Option(
            help=(
                "What to do with several reports at one time stamp: [bold]spread[/] them evenly "
                "up to the next stamp (for a coarse clock), or use the [bold]last[/] or their "
                "[bold]mean[/]. By default they must be equal."
            ),
            show_default=False,
        ),
    ] = None,
    max_speed: Annotated[
        str,
        typer.Option(
            help=(
                "Movement faster than this, in m/s, counts as a fault of the device; only inputs "
                "in metres are checked. For other units, or one limit for each input (per "
                "second): [bold]x=2,press=100[/]."
            )
        ),
    ] = "1",
    max_gap: Annotated[
        float | None,
        typer.Option(
            help=(
                "Longest silence in the recording, in s, that is interpolated. Needed if reports "
                "are more than 0.5 s apart."
            ),
            show_default=False,
        ),
    ] = None,
    missing: Annotated[
        Literal["refuse", "gap", "hold", "interpolate"],
        typer.Option(
            help=(
                "What a missing number (NaN, n/a, an empty cell) is: an error "
                "([bold]refuse[/]), no contact ([bold]gap[/]), or bridged up to --max-gap "
                "([bold]hold[/], [bold]interpolate[/])."
            )
        ),
    ] = "refuse",
    sentinel: Annotated[
        list[str],
        typer.Option(help="A cell that stands for a missing number: [bold]-9999[/]. Repeatable."),
    ] = [],
    wrap: Annotated[
        float | None,
        typer.Option(
            help="Count at which the recording's clock begins again at 0: [bold]4294967296[/].",
            show_default=False,
        ),
    ] = None,
    clock: Annotated[
        str | None,
        typer.Option(
            help=(
                "Column of a second clock without jitter, in s, to which the times are fitted: "
                "[bold]t_us*1e-6[/]."
            ),
            show_default=False,
        ),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            help=(
                "Nominal rate of the recording's rows in Hz, if they come evenly and their times "
                "do not."
            ),
            show_default=False,
        ),
    ] = None,
) -> tuple[dict[str, Any], float | None]:
    """Return the motion of every input, and the duration if it was recorded.

    With ``all_=False``, some inputs may be left without a motion.
    """
    from ..motion.text import parse_map, parse_where, served_by

    inputs, columns = list(scene.inputs), parse_map(map_)
    if motion and not inputs:
        raise BadValue(f"--motion {motion[0]}: the scene has no input: leave it out")
    own, of_all = _assigned(motion or default, inputs)
    texts = {name: text for name in inputs if (text := own.get(name, of_all))}
    served = {name: served_by(name, columns, inputs) for name in inputs}
    _check_map(columns, texts, served, bool(map_ or where))
    in_metres = [c for name, c in served.items() if c and str(scene.inputs[name].dim) == "m"]

    def read(file: str, names: list[str]) -> Recording:
        used = {column: columns[column] for name in names if (column := served[name])}
        if not used:
            from ..motion.table import read_table

            there = ", ".join(read_table(file).names[:12])  # an error, if the file is no table
            raise BadValue(
                f"{file}: name the column of {', '.join(names)}, such as --map 'x=force_N*5e-4';"
                f" the columns are: {there}"
            )
        from ..motion.recorded import recording

        return recording(
            file,
            used,
            where=parse_where(where) if where else None,
            time=time,
            reports=reports,
            repeats=repeats,
            max_speed=_max_speed(max_speed, list(used), in_metres, columns),
            max_gap=max_gap,
            missing=missing,
            sentinels=tuple(sentinel),
            wrap=wrap,
            clock=clock,
            rate=rate,
        )

    motions, recordings = _read(texts, scene.inputs, contact, read)
    if "contact" in inputs and "contact" not in own and recordings:
        if recordings[1:]:
            raise BadValue(
                "contact: each recording has one; say which serves, such as --motion contact=my.csv"
            )
        motions["contact"] = recordings[0].contact
    absent = set(inputs) - set(motions)
    if all_ and absent:
        raise BadValue(
            f"no motion for {', '.join(sorted(absent))}: add --motion 'minimum_jerk()' or another"
            " of stimlib list"
        )
    return motions, max((found.duration for found in recordings), default=None)


def _read(
    texts: Mapping[str, str],
    inputs: Mapping[str, Any],
    contact: str,
    read: Callable[[str, list[str]], Recording],
) -> tuple[dict[str, Any], list[Recording]]:
    """Return the motions of all inputs that have a text, and the recordings among them.

    Each recording is read once, by ``read``, for all inputs that it serves.
    """
    from ..motion.text import parse_motion

    motions: dict[str, Any] = {}
    recordings: list[Recording] = []
    touched = [name for name in inputs if name == "contact"]
    for text in dict.fromkeys(texts.values()):
        names = [name for name in inputs if texts.get(name) == text]
        if not _is_file(text) and "recording" not in text:
            motions |= dict.fromkeys(names, parse_motion(text))
            continue
        from ..motion.recorded import Recording, parse_source

        found: Any = read(text, names) if _is_file(text) else parse_source(text)
        if not isinstance(found, Recording):
            motions |= dict.fromkeys(names, found)
            continue
        recordings.append(found)
        columns = found.motion_for({n: inputs[n] for n in [*names, *touched]}, contact)
        motions |= {name: columns[name] for name in names}
    return motions, recordings


def streamed(rows: Any, scene: Any, motions: Any, limits: Mapping[str, Any], silence: Any) -> Any:
    """Return the motion that the rows of ``--stream`` make of a scene's inputs.

    ``--map`` says of each input which number of a row it is, and its factor.
    """
    from ..devices.sources import Stream
    from ..motion.text import parse_map, served_by

    inputs, given_ = list(scene.inputs), parse_map(motions.keywords["map_"])
    if not inputs:
        raise BadValue("--stream: the scene has no input: leave it out")
    served = {name: served_by(name, given_, inputs) for name in inputs}
    _check_map(given_, {}, served, False)
    columns: dict[str, int | str] = {}
    scale: dict[str, float] = {}
    for name, by in served.items():
        text = given_.get(by or "", "")
        found = re.fullmatch(r"(?:(\d+)|(\w+)|'([^']+)')\s*(?:\*\s*(.+))?", text.strip())
        if found is None:
            raise BadValue(
                f"--stream: which number of a row is {name}{f': {text!r}?' if text else '?'} Say"
                f" --map {name}=0, counted from 0, or its label; with a factor to SI units"
                f" --map '{name}=0*1e-3'"
            )
        index, label, quoted, factor = found.groups()
        columns[name] = int(index) if index else label or quoted
        if factor:
            scale[name] = number(factor, f"--map {by}={text}")
    # as a column, a range may be that of several inputs
    ranges = {n: limits[by] for n, by in served.items() if by and by in limits}
    ranges |= {name: limit for name, limit in limits.items() if name not in served.values()}
    return Stream(receive=rows, columns=columns, scale=scale, silence=silence, limits=ranges)


def given(motions: Any) -> bool:
    """Return whether a command got a motion, or an option for one."""
    return any(motions.keywords[option] for option in ("motion", "map_", "where"))


def _is_file(text: str) -> bool:
    # "data (1).csv" is one; any other text with a bracket is a call
    known = r"\.(csv|tsv|txt|trc|dat|npz|mat|c3d|xdf|xdfz)(\.gz)?\Z"
    return bool(re.search(known + r"|\A[^(]*\.[a-z]\w*\Z", text.lower()))


def _assigned(motion: Sequence[str], inputs: Sequence[str]) -> tuple[dict[str, str], str]:
    """Return the --motion of each named input, and the --motion of all others."""
    from ..motion.text import served_by

    given: dict[str, str] = {}
    of_all = ""
    for text in motion:
        name, _, spec = (part.strip() for part in text.partition("="))
        if name in given:
            raise BadValue(f"--motion {text}: {name} is given twice; give it once")
        if any(served_by(n, [name], inputs) for n in inputs):
            given[name] = spec
        elif not of_all:
            of_all = text
        else:
            for other in (of_all, text):
                if re.match(r"\w+\s*=", other):
                    raise BadValue(
                        f"--motion {other}: the scene has no input of that name; its inputs are"
                        f" {', '.join(inputs)}"
                    )
            raise BadValue(
                f"--motion {of_all} and {text}: both are of all inputs; say of which each is, such"
                f" as {inputs[0]}={text}"
            )
    return {n: given[by] for n in inputs if (by := served_by(n, given, inputs))}, of_all


def _check_map(
    columns: Mapping[str, str],
    texts: Mapping[str, str],
    served: Mapping[str, str | None],
    recorded: bool,
) -> None:
    """Check that each --map belongs to an input that is driven by a recording."""
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
    if recorded and not any(map(_is_file, texts.values())):
        raise BadValue(
            "--map and --where are for a recording, and there is none: add --motion recording.csv"
        )


def _max_speed(
    text: str, used: Sequence[str], in_metres: Sequence[str], columns: Mapping[str, str]
) -> Any:
    """Return the speed limit of a recording.

    A number applies to columns in metres; NAME=NUMBER applies to the named column.
    """
    from ..motion.text import pairs

    limits = (
        pairs(text.split(","), "--max-speed", "NAME=NUMBER,NAME=NUMBER")
        if "=" in text
        else dict.fromkeys(in_metres, text)
    )
    need("--max-speed", limits, columns, "--map")
    speeds = {name: number(limits[name], f"--max-speed {text}") for name in used if name in limits}
    return speeds[used[0]] if "=" not in text and len(speeds) == len(used) else speeds
