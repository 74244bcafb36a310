"""The command ``sweep``."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import BadValue, SceneError, SinkError, counted, said_as, shown
from ..system import safe_files
from ..system.packages import package
from . import options as opt
from .app import command, note, print_json, print_wide
from .motions import motions_of
from .scene import SceneText, maker_of, number, own_of, run_files, scene_of, touching

OF_EACH = {"least": "min", "median": "median", "largest": "max"}
"""What is reported of each figure, and numpy's function that gives it."""

PATIENCE = 20.0  # s, for a scheduler to answer
FEWEST = 8  # workers of a cluster that has none yet


@command("sweep", motions=motions_of)
def sweep_(
    scene: SceneText,
    motions: Any,
    axis: Annotated[
        list[str],
        typer.Option(
            help=(
                "A column and its values: [bold]k=500:3000:11[/] (from, to, how many), "
                "[bold]A=0,1,3.4[/], [bold]seed=0..99[/]. Its name is a parameter of the scene, "
                "an argument of its function, or [bold]seed[/]. Repeatable; every combination "
                "becomes a row."
            )
        ),
    ] = [],
    rows: Annotated[
        Path | None,
        typer.Option(
            help="A table of rows instead of axes (.csv or .parquet), with a column for each name."
        ),
    ] = None,
    measure: Annotated[
        list[str],
        typer.Option(
            help=(
                "Figure to keep of each rendering: [bold]rms[/], [bold]peak[/], [bold]'band(20, "
                "1000)'[/], [bold]psd[/], [bold]'cues(x1, force1)'[/] or [bold]verify[/]; of one "
                "output, [bold]'rms(force1)'[/]; or [bold]FILE.py:name[/], a function of yours "
                "with @measure. Repeatable."
            )
        ),
    ] = ["rms"],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for the figures, as Parquet files; an interrupted sweep continues there.",
        ),
    ] = None,
    live: Annotated[
        list[str],
        typer.Option(
            help=(
                "If a column could be a parameter or an argument: set it as a parameter. "
                "Repeatable."
            )
        ),
    ] = [],
    seconds: opt.Length = None,
    fs: opt.Rate = 8000.0,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help=(
                "Address of a Dask scheduler, such as [bold]tcp://head:8786[/], to run on a "
                "cluster."
            )
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            help=(
                "Number of processes on this machine, or of jobs at once on the cluster; by "
                "default one for each core, or each thread of the cluster."
            )
        ),
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Run failed rows once more.")] = False,
    dry: Annotated[
        bool, typer.Option("--dry", help="Run a few rows only, and estimate the time of all.")
    ] = False,
    report: Annotated[
        Path | None,
        typer.Option(help="Also write a self-contained .html page: each figure over each axis."),
    ] = None,
    quiet: opt.Quiet = False,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Render a scene for every row of a table or grid, and keep a few figures of each.

    A row that fails keeps its error, and the others continue. Ctrl-C loses at most two
    seconds of work. Needs the packages of the extra "sweep".

    [bold]stimlib sweep wall --axis k=500:3000:6 --motion "sinusoid(0.002, 5)"[/]

    [bold]stimlib sweep tone --axis freq=50:250:5 --axis seed=0..9 --out bursts[/]
    """
    opt.check_page(report)
    run_files(import_)
    from ..sweep.measures import Measure
    from ..sweep.rows import grid, table_of
    from ..sweep.study import Forecast, some_scene, sweep

    if bool(axis) == (rows is not None):
        raise BadValue("name the rows: --axis k=500:3000:11, or --rows design.csv")
    table = table_of(rows if rows is not None else grid(**dict(map(_axis, axis))))
    make = maker_of(scene)
    first, known = some_scene(make, table), live or None
    if not live and {*table.column_names} <= {"seed", *first.params}:
        try:
            make = scene_of(scene)  # of a scene of one row, numbers would be in all the others
        except SceneError:  # it needs arguments
            known = []
    measures = [own_of(*m.rsplit(":", 1), kind=Measure) if ".py:" in m else m for m in measure]
    motion, recorded = motions(first, contact=touching(scene))
    files = [*import_, *(text.rpartition(":")[0] for text in (scene, *measure))]
    made = sweep(
        make,
        table,
        motion=motion,
        measures=measures,
        fs=fs,
        seconds=opt.length(seconds, recorded),
        live=known,
        out=out,
        **_where(scheduler, workers, files),
        retry=retry,
        dry=dry,
        progress=not quiet,
    )
    if isinstance(made, Forecast):
        return print_json(made._asdict()) if json_ else print(made)
    axes = {name: len(made[name].unique()) for name in table.column_names}
    facts = _facts(made) | {"axes": axes, "folder": out and str(out)}
    if report is not None:
        units = {name: f"{param.dim}" for name, param in first.params.items()}
        _page(report, f"{scene}: {_title(facts)}", made, facts, units)
    _report(facts, json_, quiet)


def _page(path: Path, title: str, made: Any, facts: dict[str, Any], units: dict[str, str]) -> None:
    """Write the page of a sweep: the range of each figure, and its panels."""
    from ..checks.figures import svg
    from ..checks.page import document, picture, table
    from ..core.units import pretty

    figures = facts["figures"]

    def draw(figure: Any) -> None:
        all_axes = figure.subplots(len(figures), len(facts["axes"]), squeeze=False)
        for (name, f), row in zip(figures.items(), all_axes, strict=True):
            for axis, ax in zip(facts["axes"], row, strict=True):
                ax.plot(made[axis].to_pylist(), made[name].to_numpy(), ".")
                labels = (axis, units.get(axis, "1")), (name, f["unit"])
                x, y = (f"{what} / {pretty(unit)}".removesuffix(" / 1") for what, unit in labels)
                ax.set(xlabel=x, ylabel=y)

    drawn = svg(draw, (1 + 3 * len(facts["axes"]), 2.5 * len(figures)))
    rows = [{"figure": n} | f | {"unit": pretty(f["unit"])} for n, f in figures.items()]
    body = f"<h1>{html.escape(shown(title))}</h1>{table(rows)}{picture('Figures over axes', drawn)}"
    safe_files.publish(path, document(title, body))


def _report(facts: dict[str, Any], json_: bool, quiet: bool) -> None:
    """Print the results of a sweep, and the failures."""
    if json_:
        print_json(facts)
    if quiet:
        return
    if not json_:
        print_wide(_shown(facts))
        print(
            f"rows and figures: {facts['folder']}"
            if facts["folder"]
            else "nothing is kept: --out FOLDER keeps the figure of each row"
        )
    if facts["failed"]:
        note(
            f"{facts['failed']} of {counted(facts['rows'], 'row')} failed; the first:"
            f" {facts['first_error']}"
        )
    if facts["faulted"]:
        note(
            f"{counted(facts['faulted'], 'rendering')} not finite from some sample on: see the"
            " column fault"
        )


def _axis(text: str) -> tuple[str, list[Any]]:
    """Return the name and values of an --axis option."""
    name, equals, values = text.partition("=")
    what = f"--axis {text}"
    if not equals or not name.isidentifier() or not values:
        raise BadValue(f"{what}: write NAME=FROM:TO:HOW_MANY, NAME=VALUE,VALUE or NAME=FIRST..LAST")
    if ends := re.fullmatch(r"(\d{1,20})\.\.(\d{1,20})", values):
        return name, list(range(int(ends[1]), int(ends[2]) + 1))
    if ":" in values:
        import numpy as np

        if values.count(":") != 2:
            raise BadValue(f"{what}: write FROM:TO:HOW_MANY, such as {name}=10:100:5")
        low, high, n = (number(part, what) for part in values.split(":"))
        if not (n >= 1 and n % 1 == 0):
            raise BadValue(f"{what}: the last number, {n:g}, is how many values: 1 or more")
        return name, np.linspace(low, high, int(n)).tolist()
    words = [w.strip() for w in values.split(",")]
    if all(re.fullmatch(r"-?\d{1,20}", w) for w in words):
        return name, [*map(int, words)]
    try:
        return name, [float(w) for w in words]
    except ValueError:
        return name, words


def _where(address: str | None, workers: int | None, files: list[str]) -> dict[str, Any]:
    """Return where a sweep runs; workers of a cluster get the user's files."""
    if address is None:
        return {"workers": workers}
    with said_as(SinkError, f"there is no Dask scheduler at {address}", OSError, ValueError):
        client = package("distributed", "a sweep on a cluster").Client(address, timeout=PATIENCE)
    for path in dict.fromkeys(f for f in files if f.endswith(".py")):
        client.upload_file(path)
    most = max(FEWEST, sum(client.nthreads().values()))
    return {"executor": client.get_executor(), "workers": workers or most}


def _facts(table: Any) -> dict[str, Any]:
    """Return the results of a sweep as plain data.

    Each figure has its unit and its smallest, median and largest value.
    """
    import numpy as np

    errors = table["error"].drop_null()
    figures: dict[str, dict[str, Any]] = {}
    for name, unit in json.loads(table.schema.metadata[b"stimlib_sweep"])["units"].items():
        values = table[name].drop_null().to_numpy()
        values = values[np.isfinite(values)]
        figures[name] = {"unit": unit}
        for which, f in OF_EACH.items():
            figures[name][which] = float(getattr(np, f)(values)) if values.size else None
    return {
        "rows": table.num_rows,
        "failed": len(errors),
        "first_error": errors[0].as_py() if len(errors) else None,
        "faulted": len(table["fault"].drop_null()),
        "figures": figures,
    }


def _title(facts: dict[str, Any]) -> str:
    """Return the rows, the axes with their numbers of values, and the failures."""
    axes = ", ".join(f"{name} ({n})" for name, n in facts["axes"].items())
    return f"{counted(facts['rows'], 'row')} over {axes}, {facts['failed']} failed"


def _shown(facts: dict[str, Any]) -> Any:
    from rich.table import Column, Table
    from rich.text import Text

    from ..core.units import pretty

    columns = (Column(which, justify="right") for which in OF_EACH)
    title = Text(shown(_title(facts)))
    shape = Table("figure", "unit", *columns, title=title, title_justify="left")
    for name, figure in facts["figures"].items():
        numbers = ["" if figure[k] is None else f"{figure[k]:.4g}" for k in OF_EACH]
        shape.add_row(Text(shown(name)), pretty(figure["unit"]), *numbers)
    return shape
