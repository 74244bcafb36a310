"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

Rate = Annotated[float, typer.Option(help="Sample rate in Hz.")]
DeviceRate = Annotated[float, typer.Option(help="Sample rate in Hz; it must be the device's.")]
Length = Annotated[
    float | None, typer.Option(help="Length in s; by default that of the recording, else 5.")
]
Seed = Annotated[int, typer.Option(help="Seed of all noise.")]
FileParams = Annotated[
    list[str],
    typer.Option(
        "--set", help="A parameter for the whole file, such as [bold]k=2000[/]; may be repeated."
    ),
]
SessionParams = Annotated[
    list[str],
    typer.Option(
        "--set", help="A parameter for the whole session, such as [bold]k=2000[/]; may be repeated."
    ),
]
Channels = Annotated[
    int | None,
    typer.Option(
        help=(
            "Number of channels of the device; the first ones carry the outputs. By default one for"
            " each output."
        )
    ),
]
Connect = Annotated[
    list[str],
    typer.Option(
        help=(
            "JACK: port for a channel instead of the physical outputs, or [bold]none[/];"
            " repeatable."
        )
    ),
]
Log = Annotated[
    Path | None,
    typer.Option(
        help="Folder for the session's log, such as [bold]monday.stimlog[/]: for replay and verify."
    ),
]
Quiet = Annotated[bool, typer.Option(help="Show no progress bar and no report.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of text.")]
Import = Annotated[
    list[str],
    typer.Option(
        "--import",
        metavar="FILE.py",
        help=(
            "A Python file of yours with blocks of the scene; it is run before anything is read."
            " Repeatable."
        ),
    ),
]


def of_each(text: str | None, option: str) -> Any:
    """Return the value for all outputs, or one for each: ``a=50,b=0.1``."""
    from ..motion.text import pairs

    return (
        pairs(text.split(","), option, "OUTPUT=NUMBER,OUTPUT=NUMBER")
        if text and "=" in text
        else text
    )
