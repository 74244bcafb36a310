"""``experiment``: run, resume, watch, simulate and analyse an experiment that a file of the user's defines."""

from __future__ import annotations

import csv
import importlib
import shlex
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core import regular
from ..core.progress import progress
from ..errors import BadValue, shown
from . import options as opt
from .app import command, group, print_json
from .scene import own_of
from .terminal import Terminal

if TYPE_CHECKING:
    from ..experiments.experiment import Experiment

PAPERS = ("ugrip", "bounciness", "roughness", "nodules")
"""Experiments of papers: a function of this name in stimlib.experiments.NAME."""

experiment = group("experiment", "Run an experiment, go on with it, simulate it, and get its answers.")

Defined = Annotated[
    str,
    typer.Argument(
        metavar="FILE.py:NAME",
        help="The experiment, or a function that makes it, in your own file, which is run; or a paper's, such as [bold]ugrip[/].",
        show_default=False,
    ),
]
Data = Annotated[Path, typer.Option(help="Folder of all data.")]
Participant = Annotated[str, typer.Option(help="A code such as [bold]P07[/]; names do not belong into data.", show_default=False)]
SessionNumber = Annotated[int, typer.Option("--session", help="Number of the participant's session.")]
Pilot = Annotated[bool, typer.Option("--pilot", help="None of the data: kept apart, and never analysed with them.")]
Sink = Annotated[
    str,
    typer.Option(
        help="[bold]null[/], [bold]jack[/], [bold]portaudio[/]; [bold]offline[/] as fast as it goes; [bold]file[/] keeps sound."
    ),
]
Device = Annotated[str | None, typer.Option(help="JACK: name of the server. PortAudio: name of the device.")]


def experiment_of(text: str) -> Experiment:
    """The experiment that FILE.py:NAME means, or the name of a paper's.

    Raises
    ------
    BadValue, SceneError
        No such file or name; something else of that name.
    """
    from ..experiments.experiment import Experiment

    if text in PAPERS:
        return getattr(importlib.import_module(f"stimlib.experiments.{text}"), text)()
    path, _, name = text.rpartition(":")
    if not path.endswith(".py"):
        raise BadValue(f"{text!r} is no experiment: write FILE.py:NAME, or one of {', '.join(PAPERS)}")
    found = own_of(path, name, kind=Experiment)
    made = found() if callable(found) and not isinstance(found, Experiment) else found
    if not isinstance(made, Experiment):
        raise BadValue(f"{text} is a {type(made).__name__}, no Experiment")
    return made


def _play(defined: str, data: Path, resume: bool, session: dict[str, Any], sink: str, device: str | None) -> None:
    from ..experiments.present import SINKS
    from ..experiments.run import run
    from ..experiments.session import Session

    made = experiment_of(defined)
    if sink not in SINKS:
        raise BadValue(f"--sink {sink}: choose one of {', '.join(SINKS)}")
    if device is not None and sink not in ("jack", "portaudio"):
        raise BadValue(f"--device: {sink} has no device")
    options = {} if device is None else {"server" if sink == "jack" else "name": device}
    with Session(made, data, **session, resume=resume) as running:
        if running.pilot:
            print("PILOT: what is answered now is none of the data")
        try:
            run(running, Terminal(), sink, **options)
        except KeyboardInterrupt:
            words = {"participant": running.participant, "session": running.session, "data": data, "sink": sink, "device": device}
            given = [word for name, value in words.items() if value is not None for word in (f"--{name}", str(value))]
            again = shlex.join(["stimlib", "experiment", "resume", defined, *given, *["--pilot"] * running.pilot])
            raise KeyboardInterrupt(f"{len(running.records)} answers are kept; go on with {again}") from None


@command("run", experiment)
def run_(
    defined: Defined,
    participant: Participant,
    session: SessionNumber = 1,
    data: Data = Path("data"),
    sink: Sink = "null",
    device: Device = None,
    pilot: Pilot = False,
):
    """Run a participant's session, answered by keyboard.  Each answer is on the disk before the next stimulus.

    Ctrl-C, a power cut or a full disk lose no answer: [bold]stimlib experiment resume[/] goes on.

    [bold]stimlib experiment run pair.py:pair --participant P07 --sink jack[/]
    """
    _play(defined, data, False, {"participant": participant, "session": session, "pilot": pilot}, sink, device)


@command("resume", experiment)
def resume(
    defined: Defined,
    participant: Participant,
    session: SessionNumber = 1,
    data: Data = Path("data"),
    sink: Sink = "null",
    device: Device = None,
    pilot: Pilot = False,
):
    """Go on with a session that was left, exactly where it was; a pause that is due is still due.

    [bold]stimlib experiment resume pair.py:pair --participant P07 --sink jack[/]
    """
    _play(defined, data, True, {"participant": participant, "session": session, "pilot": pilot}, sink, device)


@command("status", experiment)
def status_(defined: Defined, data: Data = Path("data"), json_: opt.Json = False):
    """How far each participant is, pilots apart; conditions are blinded.

    [bold]stimlib experiment status pair.py:pair[/]
    """
    from ..experiments.saved import sessions, status

    name = experiment_of(defined).name
    found = [status(s) for pilot in (False, True) for s in sessions(name, data, pilot)]
    if json_:
        return print_json(found)
    for s in found:
        who = f"{'PILOT ' if s['pilot'] else ''}{s['participant']} session {s['session']}"
        conditions = ", ".join(f"{k} {n}" for k, n in s["conditions"].items())
        print(f"{who}: {s['trials']} trials, {s['training']} of them training ({conditions}); {s['replays']} replays, "
              f"{s['lost']} samples lost, {s['limited']} limited; last answer {s['last'][:19] or 'none'}")  # fmt: skip
    if not found:
        print(f"no session of {name} in {data}")


@command("simulate", experiment)
def simulate(
    defined: Defined,
    participants: Annotated[int, typer.Option(help="Simulated participants, P1, P2, ..")] = 8,
    data: Data = Path("simulated"),
    rendered: Annotated[bool, typer.Option("--rendered", help="Render every stimulus too, with its log.")] = False,
    quiet: opt.Quiet = False,
):
    """Whole sessions of the experiment's simulated observer, kept as pilots: to try a design before people come.

    [bold]stimlib experiment simulate pair.py:pair --participants 8[/]
    """
    from ..experiments.run import Simulated, run
    from ..experiments.session import Session

    made = experiment_of(defined)
    if made.observer is None:
        raise BadValue(f"{defined}: give the experiment an observer=, a function (trial, rng) -> Answer")
    every = [(n, number) for n in range(1, participants + 1) for number in range(1, made.sessions + 1)]
    with progress("simulating", len(every), not quiet) as advance:
        for n, number in every:
            with Session(made, data, f"P{n}", number, pilot=True) as session:
                run(session, Simulated(session, made.observer), "offline" if rendered else lambda trial, folder: {})
            advance(1)
    if not quiet:
        print(f"{len(every)} sessions in {data / made.name}, kept as pilots")
        print(f"stimlib experiment analyse {defined} --data {data} --pilot")


@command("analyse", experiment)
def analyse(
    defined: Defined,
    data: Data = Path("data"),
    pilot: Pilot = False,
    out: Annotated[Path | None, typer.Option(help="Also write all trials as a table, .csv.")] = None,
):
    """What the experiment's own analysis says of all sessions; without one, all trials as a table on stdout.

    [bold]stimlib experiment analyse pair.py:pair --out trials.csv[/]
    """
    from ..experiments.saved import columns, sessions

    made = experiment_of(defined)
    found = sessions(made.name, data, pilot)
    if not found:
        raise BadValue(f"there is no {'pilot' if pilot else 'session'} of {made.name} in {data}")
    table = columns(found, training=True)
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    if out is not None:
        regular.publish(out, text.getvalue())
    if made.analysis is not None:
        print(shown(made.analysis(found)))
    elif out is None:
        print(text.getvalue(), end="")
