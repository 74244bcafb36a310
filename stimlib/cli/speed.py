"""The command ``bench``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options as opt
from .app import command, errors, print_json, print_wide


@command("bench")
def bench(
    picture: Annotated[
        Path | None,
        typer.Option(help="Also draw a picture: .svg, .png or .pdf.", show_default=False),
    ] = None,
    json_: opt.Json = False,
):
    """Measure how fast stimlib is on this machine, in less than a minute.

    The table compares it with numpy + scipy and with the limit of the core.

    Close other programs first: they make all times longer. The first time blocks are
    also compiled.

    [bold]stimlib bench --picture speed.svg[/]
    """
    from ..analysis.overview import check_place
    from ..speed import bench
    from ..speed.timing import machine

    if picture is not None:
        check_place(picture)
    with errors.status("measuring, less than a minute; the first time also compiling"):
        speeds = bench.measure()
    if picture is not None:
        bench.picture(speeds, picture)
    if json_:
        print_json({"machine": machine(), "speeds": [s._asdict() for s in speeds]})
    else:
        print_wide(bench.table(speeds))
