"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import devices
from ..errors import BadValue
from .scene import number

Rate = Annotated[float, typer.Option(help="Sample rate in Hz.")]
DeviceRate = Annotated[float, typer.Option(help="Sample rate in Hz; it must be the device's.")]
Length = Annotated[
    float | None, typer.Option(help="Length in s; by default that of the recording, or 5.")
]
Seed = Annotated[int, typer.Option(help="Seed of all noise.")]
Params = Annotated[
    list[str],
    typer.Option("--set", help="Value of a parameter, such as [bold]k=2000[/]. Repeatable."),
]
Peak = Annotated[float | None, typer.Option(help="Largest force in N (limits outputs in N).")]
Static = Annotated[
    float | None, typer.Option(help="Largest lasting (RMS) force in N (limits outputs in N).")
]
Slew = Annotated[
    str | None,
    typer.Option(
        help=(
            "Fastest change, in the outputs' units per second; one value, or one for each "
            "output as in --full-scale."
        )
    ),
]
Passive = Annotated[
    str | None,
    typer.Option(
        "--passivity",
        help=(
            "Largest energy in J that a force over a position may give, and how:"
            " [bold]bound=0.01,damping=2,delay=0.003[/], with speed, encoder, still, lost,"
            " sure and [bold]axes=force1:x1[/] if needed."
        ),
    ),
]
Channels = Annotated[
    str | None,
    typer.Option(
        help=(
            "Number of channels of the device, the first of which carry the outputs; or the "
            "output of each channel, such as [bold]none,force0[/]. By default there is one for "
            "each output."
        )
    ),
]
Connect = Annotated[
    list[str],
    typer.Option(
        help=(
            "JACK: port for a channel instead of the physical outputs, or [bold]none[/]. "
            "Repeatable."
        )
    ),
]
Calibrated = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        help=(
            "File of the device's calibration, so that what the outputs ask for in its unit "
            "comes out as such."
        ),
    ),
]
Log = Annotated[
    Path | None,
    typer.Option(
        help=(
            "Folder for the session's log, such as [bold]monday.stimlog[/], for replay and verify."
        )
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress bar and no report.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of text.")]
Separator = Annotated[
    str, typer.Option(help="Separator of the columns of a table: , ; | or [bold]tab[/].")
]
Decimal = Annotated[
    str, typer.Option(help="Decimal sign of the numbers in a table: a point or a comma.")
]
Bom = Annotated[
    bool,
    typer.Option(
        "--bom", help="Begin a table with a byte order mark, by which Excel knows its UTF-8."
    ),
]
Import = Annotated[
    list[str],
    typer.Option(
        "--import",
        metavar="FILE.py",
        help=(
            "A Python file of yours that defines blocks of the scene. It is run first. Repeatable."
        ),
    ),
]


Send = Annotated[
    list[str],
    typer.Option(
        help=(
            "Where markers go: [bold]lsl:NAME[/], [bold]osc:HOST:PORT[/], "
            "[bold]udp:HOST:PORT[/], [bold]serial:PORT:onset=1,stimulus=2[/] or "
            "[bold]parallel:PORT:onset=1[/], with [bold]:width=0.005[/] for a byte that returns to "
            "0 after 5 ms. Repeatable."
        )
    ),
]
Marker = Annotated[
    list[str],
    typer.Option(help="Output that marks where it rises to 0.5 or more. Repeatable."),
]


Stream = Annotated[
    str | None,
    typer.Option(
        help=(
            "Rows that another program or a device sends, as motion: [bold]lsl:NAME[/], "
            "[bold]osc:PORT/ADDRESS[/], [bold]udp:PORT[/] or [bold]serial:PORT[/]; of a row such "
            "as 1,2 say what a comma is with [bold]udp:PORT:comma=separator[/] or "
            "[bold]:comma=decimal[/]."
        )
    ),
]


@contextmanager
def senders(texts: list[str]) -> Iterator[list[Any]]:
    """Open the ``--send`` targets, and close them at the end."""
    with ExitStack() as stack:
        yield [stack.enter_context(devices.sender(text)) for text in texts]


def check_page(path: Path | None) -> None:
    """Raise an error, before all else, if a --report cannot be written to a path."""
    if path is not None:
        from ..analysis.overview import check_place
        from ..checks.report import PAGES

        check_place(path, "page", PAGES)


def rows_of(text: str | None) -> Any:
    """Open the ``--stream`` receiver, as a context that closes it, or one of None."""
    return nullcontext() if text is None else devices.receiver(text)


def calibration(path: Path | None) -> dict[str, Any]:
    """Return the sink's calibration for ``--calibration``."""
    return {} if path is None else {"calibration": devices.load_calibration(path)}


def channel_map(text: str | None) -> int | list[str | None] | None:
    """Return the channels for ``--channels``, a number or a list of outputs."""
    if text is None:
        return None
    if text.strip().isdecimal():
        return int(text)
    return [None if name == "none" else name for name in text.replace(" ", "").split(",")]


def of_each(text: str | None, option: str) -> Any:
    """Return one value for all outputs, or a value for each from ``a=50,b=0.1``."""
    from ..motion.text import pairs

    if text and "=" in text:
        return pairs(text.split(","), option, "OUTPUT=NUMBER,OUTPUT=NUMBER")
    return text


def ports(connect: list[str]) -> list[str] | str | None:
    """Return the ports to connect to: those named, none, or the system's."""
    return None if connect == ["none"] else connect or "system"


def ranges(items: list[str], option: str) -> dict[str, tuple[float, float]]:
    """Return the ranges that options such as ``--range x=0:0.1`` give."""
    found = {}
    for item in items:
        name, is_, text = item.partition("=")
        low, to, high = text.partition(":")
        if not (is_ and to):
            raise BadValue(f"{option} {item}: write NAME=LOW:HIGH, such as x=0:0.1")
        found[name.strip()] = number(low, f"{option} {item}"), number(high, f"{option} {item}")
    return found


def length(seconds: float | None, recorded: float | None) -> float:
    """Return the length for ``--seconds``: by default that of the recording, or 5 s."""
    return seconds if seconds is not None else recorded or 5.0


def safety_of(
    scene: Any,
    *,
    full_scale: Annotated[
        str | None,
        typer.Option(
            help=(
                "Physical value at which the device reaches 1.0, such as 50 (N); outputs are "
                "limited to it. If units differ: a=50,b=0.1. By default outputs without a unit "
                "play 20 dB below full scale."
            ),
            show_default=False,
        ),
    ] = None,
    peak: Peak = None,
    static: Static = None,
    slew: Slew = None,
    passivity: Passive = None,
) -> Any:
    """Return the safety stage for the given options."""
    from ..motion.text import pairs
    from ..run.safety import Safety, quiet_scale

    given = pairs(passivity.split(",") if passivity else (), "--passivity", "bound=0.01,damping=2")
    along = given.pop("axes", None)
    guard: dict[str, Any] = {k: number(v, f"--passivity {k}") for k, v in given.items()}
    if along is not None:
        names = along.split(":")
        if len(names) % 2 or not all(names):
            raise BadValue(f"--passivity axes={along}: write output:input, such as axes=force1:x1")
        guard["axes"] = dict(zip(names[::2], names[1::2], strict=True))
    return Safety(
        of_each(full_scale, "--full-scale") or quiet_scale(scene),
        slew=of_each(slew, "--slew"),
        peak=peak,
        static=static,
        passivity=guard or None,
    )
