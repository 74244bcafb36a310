"""``bench``: how fast it is here."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import BadValue
from . import options as opt
from .app import command, errors, print_json, print_wide


@command("bench")
def bench(
    picture: Annotated[Path | None, typer.Option(help="Also draw it: .svg, .png or .pdf.", show_default=False)] = None,
    work_precision: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Instead: error against time of every operator, as tables and pictures there.",
            show_default=False,
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Only this operator, such as lowpass; again for another. A name that is none lists all."),
    ] = None,
    json_: opt.Json = False,
):
    """Measure how fast stimlib is on this machine, beside numpy + scipy and the limit of its core, in less than a minute.

    Close other programs first: they make all times longer. The first time blocks are also compiled.

    [bold]stimlib bench --picture speed.svg[/]

    How much error each method leaves and what it costs, of every operator, takes some minutes; of one, seconds:

    [bold]stimlib bench --work-precision figures[/]
    [bold]stimlib bench --work-precision figures --only lowpass[/]
    """
    if work_precision is not None:
        from ..speed import precision

        if picture is not None:
            raise BadValue(f"--work-precision draws its own pictures, into {work_precision}: leave --picture out")
        points = precision.regenerate(work_precision, only or ())
        if json_:
            print_json([p._asdict() for p in points])
        else:
            print_wide(precision.table(points))
            print(f"of each operator: {work_precision / 'NAME.csv'}, all its points, and {work_precision / 'work_NAME.svg'}")
        return
    if only:
        raise BadValue("--only names problems of --work-precision FOLDER")
    from ..analysis.picture import check_place
    from ..speed import short
    from ..speed.timing import machine

    if picture is not None:
        check_place(picture)
    with errors.status("measuring, less than a minute; the first time also compiling"):
        speeds = short.measure()
    if picture is not None:
        short.picture(speeds, picture)
    if json_:
        print_json({"machine": machine(), "speeds": [s._asdict() for s in speeds]})
    else:
        print_wide(short.table(speeds))
