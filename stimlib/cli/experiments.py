"""The command ``experiment``: run, resume, simulate and analyse a user's experiment."""

from __future__ import annotations

import importlib
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..devices.available import SINKS, option
from ..errors import BadValue, FaultError, SinkError, shown
from ..system import safe_files
from ..system.pool import terminable
from ..system.progress import progress
from . import options as opt
from .app import command, group, note, print_json
from .scene import own_of
from .terminal import terminal

if TYPE_CHECKING:
    from ..experiments.experiment import Experiment
    from ..live.experiment import ExperimentPage

PAPERS = ("ugrip", "bounciness", "roughness", "nodules", "nodule_sizes", "nodule_places")
"""Experiments of papers: a function of this name in stimlib.experiments.papers.NAME."""

experiment = group("experiment", "Run, resume, simulate and analyse an experiment.")

Defined = Annotated[
    str,
    typer.Argument(
        metavar="FILE.py:NAME",
        help=(
            "An experiment, or a function that returns one, in a file of yours (the file is "
            "run); or the experiment of a paper, such as [bold]ugrip[/]."
        ),
        show_default=False,
    ),
]
Data = Annotated[Path, typer.Option(help="Folder with the data of all participants.")]
Participant = Annotated[
    str,
    typer.Option(
        help="Code of the participant, such as [bold]P07[/]. Do not use names.", show_default=False
    ),
]
SessionNumber = Annotated[
    int, typer.Option("--session", help="Number of the participant's session.")
]
Pilot = Annotated[
    bool,
    typer.Option(
        "--pilot",
        help="A pilot session: it is kept apart from the data and never analysed with them.",
    ),
]
Sink = Annotated[
    str,
    typer.Option(
        help=(
            f"[bold]{'[/], [bold]'.join(SINKS)}[/]; [bold]offline[/] as fast as it goes;"
            " [bold]file[/] keeps sound."
        )
    ),
]
Device = Annotated[
    str | None, typer.Option(help=" ".join(k.device for k in SINKS.values() if k.device))
]
OnPage = Annotated[
    bool,
    typer.Option(
        "--page",
        help=(
            "Ask the questions on a page in the browser (keys, touch or mouse); the address "
            "is printed. Needs [bold]pip install 'stimlib\\[live]'[/]."
        ),
    ),
]
Host = Annotated[
    str,
    typer.Option(
        help=(
            "Address at which the page is served. With another address than 127.0.0.1 a "
            "tablet can connect, and so can anybody who has the token."
        )
    ),
]
Port = Annotated[int, typer.Option(help="Port of the page; 0 takes a free one.", min=0, max=65535)]


def experiment_of(text: str) -> Experiment:
    """Return the experiment for FILE.py:NAME, or the experiment of a paper.

    Raises
    ------
    BadValue, SceneError
        There is no such file or name, or the name is not an experiment.
    """
    from ..experiments.experiment import Experiment

    if text in PAPERS:
        return getattr(importlib.import_module(f"stimlib.experiments.papers.{text}"), text)()
    path, _, name = text.rpartition(":")
    if not path.endswith(".py"):
        raise BadValue(
            f"{text!r} is no experiment: write FILE.py:NAME, or one of {', '.join(PAPERS)}"
        )
    found = own_of(path, name, kind=Experiment)
    made = found() if callable(found) and not isinstance(found, Experiment) else found
    if not isinstance(made, Experiment):
        raise BadValue(f"{text} is a {type(made).__name__}, no Experiment")
    return made


def played(
    defined: str,
    resume: bool,
    *,
    participant: Participant,
    session: SessionNumber = 1,
    data: Data = Path("data"),
    sink: Sink = "null",
    device: Device = None,
    calibration: opt.Calibrated = None,
    send: opt.Send = [],
    pilot: Pilot = False,
    page: OnPage = False,
    host: Host = "127.0.0.1",
    port: Port = 0,
) -> None:
    """Run a session, with answers given in the terminal or on a page.

    If the session ends early, a message shows the command that resumes it.
    """
    from ..experiments import presentation
    from ..experiments.runner import run
    from ..experiments.session import Session

    given = {
        name: value
        for name, value in locals().items()
        if name in ("participant", "session", "data", "sink", "device", "calibration")
    }
    made = experiment_of(defined)
    if sink not in presentation.SINKS:
        raise BadValue(f"--sink {sink}: choose one of {', '.join(presentation.SINKS)}")
    options = {} if device is None else option(sink, "device", device)
    options |= opt.calibration(calibration)
    sent = opt.senders(send)
    with sent as senders, Session(made, data, participant, session, pilot, resume) as running:
        options |= {"send": senders}
        if running.pilot:
            print("PILOT: what is answered now is none of the data")
        if sink not in presentation.FAST:
            print("preparing what will be displayed", flush=True)
        try:
            with terminable():
                if page:
                    with on_page(host, port) as asking:
                        presentation.prepare(running, sink, options.get("calibration"))
                        run(running, asking, asking.display(made, sink, **options))
                else:
                    with terminal() as front_end:
                        run(running, front_end, sink, **options)
        except (KeyboardInterrupt, SystemExit, SinkError, FaultError) as e:
            given |= {"host": host, "port": port or None} if page else {}
            words = [
                word
                for name, value in given.items()
                if value is not None
                for word in (f"--{name}", str(value))
            ]
            words += [word for text in send for word in ("--send", text)]
            flags = ["--pilot"] * pilot + ["--page"] * page
            again = shlex.join(["stimlib", "experiment", "resume", defined, *words, *flags])
            kept = f"{len(running.records)} answers are kept; go on with {again}"
            if isinstance(e, SystemExit):
                note(kept)
                raise
            raise type(e)(f"{e}; {kept}" if str(e) else kept) from None


@contextmanager
def on_page(host: str, port: int) -> Iterator[ExperimentPage]:
    """Serve a page as the front end; show its address and progress in the terminal."""
    from ..live.experiment import ExperimentPage
    from ..live.server import Server

    asking = ExperimentPage(lambda text: print(shown(text), flush=True))
    with Server(asking, host, port) as server, asking:
        if not server.private:
            note(
                f"{host}: anybody who has the address below can answer: use it in a network of your"
                " own, and end it when you are done"
            )
        print(f"the participant answers at {server.url}", flush=True)
        yield asking


@command("run", experiment, play=played)
def run_(defined: Defined, play: Any):
    """Run a participant's session, answered by keyboard or on a page.

    Each answer is on the disk before the next stimulus.

    Ctrl-C, a power cut or a full disk lose no answer: [bold]stimlib experiment
    resume[/] continues.

    [bold]stimlib experiment run pair.py:pair --participant P07 --sink jack[/]
    """
    play(defined, False)


@command("resume", experiment, play=played)
def resume(defined: Defined, play: Any):
    """Resume a session exactly where it was left.

    A rest that was due still takes place.

    [bold]stimlib experiment resume pair.py:pair --participant P07 --sink jack[/]
    """
    play(defined, True)


@command("status", experiment)
def status_(defined: Defined, data: Data = Path("data"), json_: opt.Json = False):
    """List the progress of each participant; conditions are blinded.

    Pilots are listed apart.

    [bold]stimlib experiment status pair.py:pair[/]
    """
    from ..experiments.reader import sessions, status

    name = experiment_of(defined).name
    found = [status(s) for pilot in (False, True) for s in sessions(name, data, pilot)]
    if json_:
        return print_json(found)
    for s in found:
        who = f"{'PILOT ' if s['pilot'] else ''}{s['participant']} session {s['session']}"
        conditions = ", ".join(f"{k} {n}" for k, n in s["conditions"].items())
        old = (
            f" ({s['shared']} with one time for all intervals, by an older stimlib)"
            if s["shared"]
            else ""
        )
        print(
            f"{who}: {s['trials']} trials{old}, {s['training']} of them training ({conditions});"
            f" {s['replays']} replays, {s['unanswered']} presentations without an answer,"
            f" {s['lost']} samples lost, {s['limited']} limited; last answer"
            f" {s['last'][:19] or 'none'}"
        )
    if not found:
        print(f"no session of {name} in {data}")


@command("simulate", experiment)
def simulate(
    defined: Defined,
    participants: Annotated[
        int, typer.Option(help="Number of simulated participants (P1, P2, ..).")
    ] = 8,
    data: Data = Path("simulated"),
    rendered: Annotated[
        bool, typer.Option("--rendered", help="Render every stimulus too, with its log.")
    ] = False,
    quiet: opt.Quiet = False,
):
    """Simulate whole sessions with the experiment's observer, kept as pilots.

    Use it to try a design before participants come.

    [bold]stimlib experiment simulate pair.py:pair --participants 8[/]
    """
    from ..experiments.runner import Simulated, run
    from ..experiments.session import Session

    made = experiment_of(defined)
    if made.observer is None:
        raise BadValue(
            f"{defined}: give the experiment an observer=, a function (trial, rng) -> Answer"
        )
    every = [
        (n, number) for n in range(1, participants + 1) for number in range(1, made.sessions + 1)
    ]
    with progress("simulating", len(every), not quiet) as advance:
        for n, number in every:
            with Session(made, data, f"P{n}", number, pilot=True) as session:
                run(
                    session,
                    Simulated(session, made.observer),
                    "offline" if rendered else lambda trial, folder: {},
                )
            advance(1)
    if not quiet:
        print(f"{len(every)} sessions in {data / made.name}, kept as pilots")
        print(f"stimlib experiment analyse {defined} --data {data} --pilot")


def _none_of(made: Experiment, data: Path, pilot: bool) -> str:
    """Return the error message for an experiment without sessions or pilots."""
    from ..experiments.reader import sessions

    others = len(sessions(made.name, data, not pilot))
    kinds = ("sessions", "pilots") if pilot else ("pilots", "sessions")
    there = f"; it has {others} {kinds[0]}, which are never analysed with them" if others else ""
    remedy = "" if pilot or not others else ": analyse them with --pilot"
    return f"{data} has no {kinds[1]} of {made.name}{there}{remedy}"


@command("analyse", experiment)
def analyse(
    defined: Defined,
    data: Data = Path("data"),
    pilot: Annotated[
        bool, typer.Option("--pilot", help="Analyse the pilot sessions instead of the data.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="Also write all trials as a table, .csv.")
    ] = None,
):
    """Run the experiment's own analysis on all sessions.

    Without one, print all trials as a table on stdout.

    [bold]stimlib experiment analyse pair.py:pair --out trials.csv[/]
    """
    from ..experiments.reader import columns, csv_of, sessions
    from ..experiments.user_code import called

    made = experiment_of(defined)
    found = sessions(made.name, data, pilot)
    if not found:
        raise BadValue(_none_of(made, data, pilot))
    table = columns(found, training=True)
    if not table["number"]:
        raise BadValue(f"the sessions of {made.name} in {data} have no answers yet")
    text = csv_of(table)
    if out is not None:
        safe_files.publish(out, text)
    if made.analysis is not None:
        print(shown(called("the analysis", made.analysis, found)))
    elif out is None:
        print(text, end="")


@command("export", experiment)
def export(
    defined: Defined,
    bids: Annotated[
        Path | None,
        typer.Option(help="New folder for a dataset of the Brain Imaging Data Structure."),
    ] = None,
    psych_ds: Annotated[
        Path | None, typer.Option("--psych-ds", help="New folder for a dataset of Psych-DS.")
    ] = None,
    data: Data = Path("data"),
    authors: Annotated[
        list[str], typer.Option("--author", help="Author of the dataset. Repeatable.")
    ] = [],
    signals: Annotated[
        bool,
        typer.Option(
            help="Whether trials with a log come with events, motion and stimulus, in BIDS."
        ),
    ] = True,
):
    """Write all sessions for other tools, as a BIDS or Psych-DS dataset.

    [bold]stimlib experiment export pair.py:pair --bids pair_bids[/]
    """
    from ..experiments.bids import to_bids, to_psych_ds
    from ..experiments.reader import sessions

    if bids is None and psych_ds is None:
        raise BadValue("say what to write: --bids FOLDER, --psych-ds FOLDER, or both")
    made = experiment_of(defined)
    if not (found := sessions(made.name, data)):
        raise BadValue(_none_of(made, data, False))
    if bids is not None:
        print(f"{len(to_bids(made, found, bids, authors, signals))} files in {bids}")
    if psych_ds is not None:
        print(f"{len(to_psych_ds(made, found, psych_ds, authors))} files in {psych_ds}")
