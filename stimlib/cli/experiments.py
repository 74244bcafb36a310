"""The command ``experiment``: run, simulate, plan and analyse a user's experiment."""

from __future__ import annotations

import importlib
import math
import shlex
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import experiments
from ..devices.available import SINKS, option
from ..errors import BadValue, FaultError, SinkError, StimlibError, counted, one_of, shown
from ..experiments.user_code import called
from ..system import safe_files
from ..system.pool import terminable
from ..system.progress import progress
from . import options as opt
from .app import command, group, note, print_json, print_wide
from .scene import own_of
from .terminal import terminal

if TYPE_CHECKING:
    from ..experiments.texts import Texts
    from ..live.experiment import ExperimentPage

PAPERS = (
    "ugrip",
    "bounciness",
    "firmness",
    "roughness",
    "nodules",
    "nodule_sizes",
    "nodule_places",
)
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
            " [bold]file[/] keeps sound; [bold]page[/] for what is only seen: the pointer of"
            " the page moves, and the page draws it."
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


def experiment_of(text: str) -> experiments.Experiment:
    """Return the experiment for FILE.py:NAME, or the experiment of a paper.

    Raises
    ------
    BadValue, SceneError
        There is no such file or name, or the name is not an experiment.
    """
    if text in PAPERS:
        return getattr(importlib.import_module(f"stimlib.experiments.papers.{text}"), text)()
    path, _, name = text.rpartition(":")
    if not path.endswith(".py"):
        raise BadValue(
            f"{text!r} is no experiment: write FILE.py:NAME, or one of {', '.join(PAPERS)}"
        )
    found = own_of(path, name, kind=experiments.Experiment)
    own = callable(found) and not isinstance(found, experiments.Experiment)
    made = called(f"the function {name}", found) if own else found
    if not isinstance(made, experiments.Experiment):
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

    given = {
        name: value
        for name, value in locals().items()
        if name in ("participant", "session", "data", "sink", "device", "calibration")
    }
    made = experiment_of(defined)
    one_of("--sink", sink, (*presentation.SINKS, "page"))
    page = page or sink == "page"
    options = {} if device is None else option(sink, "device", device)
    options |= opt.calibration(calibration)
    sent = opt.senders(send)
    opening = experiments.Session(made, data, participant, session, pilot, resume)
    if not resume:
        opening.check_ahead()
    with sent as senders, opening as running:
        options |= {"send": senders}
        if running.pilot:
            print("PILOT: these answers are kept apart from the data")
        elif sink == "null":
            note("--sink null: no device plays the stimuli; name one, such as --sink portaudio")
        print("preparing what will be displayed", flush=True)
        try:
            with terminable():
                if page:
                    with on_page(host, port, made.texts, running.folder / "page.jsonl") as asking:
                        presentation.prepare(running, sink, **options)
                        experiments.run(running, asking, asking.display(made, sink, **options))
                else:
                    with terminal(made.texts) as front_end:
                        experiments.run(running, front_end, sink, **options)
            if wrong := [
                d
                for record in running.records
                for d in record.displayed
                if d.get("missed") or d.get("rejected")
            ]:
                note(
                    "repeated, or with rejected rows of motion:"
                    f" {counted(len(wrong), 'presentation')}; see"
                    f" {_words('status', defined, data, *['--pilot'] * pilot)}"
                )
        except (KeyboardInterrupt, SystemExit, SinkError, FaultError) as e:
            if page:
                given |= {"host": host, "port": port or None}
            words = ["stimlib", "experiment", "resume", defined]
            for name, value in [*given.items(), *(("send", text) for text in send)]:
                if value is not None:
                    words += [f"--{name}", str(value)]
            again = shlex.join(words + ["--pilot"] * pilot + ["--page"] * page)
            kept = f"{counted(len(running.records), 'answer')} kept; go on with {again}"
            if isinstance(e, SystemExit):
                note(kept)
                raise
            raise type(e)(f"{e}; {kept}" if str(e) else kept) from None


@contextmanager
def on_page(host: str, port: int, texts: Texts, log: Path) -> Iterator[ExperimentPage]:
    """Serve a page as the front end; show its address and progress in the terminal."""
    from ..live.experiment import ExperimentPage
    from ..live.server import Server

    asking = ExperimentPage(lambda text: print(shown(text), flush=True), texts, log)
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

    Each finished trial is on the disk before the next stimulus.

    Ctrl-C, a power cut or a full disk lose no finished trial: [bold]stimlib experiment
    resume[/] continues, and asks an unfinished one anew.

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
def status_(
    defined: Defined,
    data: Data = Path("data"),
    pilot: Annotated[bool, typer.Option("--pilot", help="List the pilot sessions alone.")] = False,
    json_: opt.Json = False,
):
    """List the progress of each participant; conditions are blinded.

    Pilots are listed apart.

    [bold]stimlib experiment status pair.py:pair[/]
    """
    name = experiment_of(defined).name
    found = [
        experiments.status(s)
        for pilots in ((True,) if pilot else (False, True))
        for s in experiments.sessions(name, data, pilots)
    ]
    if json_:
        return print_json(found)
    for s in found:
        kind, simulated = "PILOT " * s["pilot"], "SIMULATED " * s["simulated"]
        conditions = ", ".join(f"{k} {n}" for k, n in s["conditions"].items())
        old, last = "", f"{s['last'][:19].replace('T', ' at ')} UTC" if s["last"] else "none"
        if s["shared"]:
            old = f" ({s['shared']} with one time for all intervals, by an older stimlib)"
        print(
            f"{kind}{simulated}{s['participant']} session {s['session']}:"
            f" {counted(s['trials'], 'trial')}{old}, {s['training'] or 'none'} of them training\n"
            f"  last answer {last}\n"
            f"  trials of each condition, whose names are blinded: {conditions or 'none'}"
        )
        also = (
            f"{counted(s['replays'], 'replay')}",
            f"{counted(s['unanswered'], 'presentation')} without an answer",
            f"{s['missed']} presented again",
            f"{counted(sum(s['rejected'].values()), 'row')} of motion rejected",
            f"{counted(s['lost'], 'sample')} lost",
            f"{counted(s['limited'], 'sample')} limited",
        )
        # what did not happen needs no line
        print(*(f"  {text}\n" for text in also if text[:2] != "0 "), sep="", end="")
    if found:
        pilots = ["--pilot"] * all(s["pilot"] for s in found)
        print(f"next: {_words('analyse', defined, data, *pilots)}")
    else:
        begin = _words("run", defined, data, "--participant", "P1", *["--pilot"] * pilot)
        print(
            f"no {'pilot' if pilot else 'session'} of {name} in the folder {data}; begin one with\n"
            f"{begin}\nor name another folder with --data"
        )


def _words(command: str, defined: str, data: Path, *more: str) -> str:
    """Return a command on an experiment as it is typed in a shell."""
    where = ["--data", str(data)] * (data != Path("data"))
    return shlex.join(["stimlib", "experiment", command, defined, *where, *more])


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
    made = experiment_of(defined)
    if made.observer is None:
        raise BadValue(
            f"{defined}: give the experiment an observer=, a function (trial, rng) -> Answer"
        )
    display: Any = "offline" if rendered else lambda trial, folder, **paced: {}
    every = list(product(range(1, participants + 1), range(1, made.sessions + 1)))
    with progress("simulating", len(every), not quiet) as advance:
        for n, number in every:
            with experiments.Session(made, data, f"P{n}", number, pilot=True) as session:
                front_end = experiments.Simulated(session, made.observer)
                experiments.run(session, front_end, display)
            advance(1)
    if not quiet:
        print(f"{counted(len(every), 'session')} in {data / made.name}, kept as pilots")
        print(_words("analyse", defined, data, "--pilot"))


@command("power", experiment)
def power(
    defined: Defined,
    jnd: Annotated[
        float,
        typer.Option(
            help="Mean JND of the simulated people, in the unit of the levels.", show_default=False
        ),
    ],
    pse: Annotated[
        float,
        typer.Option(
            help="Their PSE, or their threshold in a detection, in the same unit.",
            show_default=False,
        ),
    ],
    between: Annotated[
        float, typer.Option(help="Standard deviation of the JND between people, in the same unit.")
    ] = 0.0,
    participants: Annotated[
        str, typer.Option(help="Numbers of participants to compare, separated by commas.")
    ] = "4,8,16",
    experiments: Annotated[int, typer.Option(help="Number of simulated experiments.", min=2)] = 100,
    log: Annotated[
        bool,
        typer.Option("--log", help="Fit over log10 of the levels, which suits staircases in dB."),
    ] = False,
    link: Annotated[
        str,
        typer.Option(
            help="Curve of people and fit: probit, logit, gumbel, or weibull (always over log10)."
        ),
    ] = "probit",
    seed: Annotated[int, typer.Option(help="Seed of the simulated people.", min=0)] = 0,
    workers: Annotated[int, typer.Option(help="Number of processes.", min=1)] = 1,
    quiet: Annotated[bool, typer.Option("--quiet", help="Show no progress bar.")] = False,
):
    """Estimate how many trials and participants a JND needs, before people come.

    Simulated people with this JND and PSE take part, and their answers are fitted.
    Nothing is rendered or kept. They neither lapse nor drift, so plan for more.

    [bold]stimlib experiment power harder.py:harder --pse 300 --jnd 20 --between 6[/]
    """
    from rich.table import Column, Table

    counts = [int(v) if v.strip().isdecimal() else 0 for v in participants.split(",")]
    if min(counts) < 1:
        raise BadValue(
            f"--participants {participants}: give whole numbers from 1 on, such as 4,8,16"
        )
    log = log or link == "weibull"
    if not 0 < jnd < math.inf:
        raise BadValue(f"--jnd {jnd:g}: give a JND above 0, in the unit of the levels")
    if not math.isfinite(pse) or (log and pse <= 0):
        raise BadValue(f"--pse {pse:g}: give a finite PSE, above 0 for a fit over log10 of levels")
    if not 0 <= between < math.inf:
        raise BadValue(f"--between {between:g}: give a standard deviation of 0 or above")
    found = _jnds(
        experiment_of(defined),
        (pse, jnd, between),
        (experiments, max(counts)),
        (link, log),
        seed=seed,
        workers=workers,
        progress=not quiet,
    )
    figures = (
        "participants",
        "trials each",
        "bias of the mean JND",
        "its spread",
        "within 10 %",
        "people without a fit",
    )
    table = Table("condition", *(Column(name, justify="right") for name in figures))
    needed = []
    for condition, (trials, errors) in found.items():
        for n in counts:
            means = errors[:, :n].mean(1).compressed()
            table.add_row(
                shown(condition),
                str(n),
                f"{trials:.0f}",
                f"{means.mean():+.1%}",
                f"{means.std(ddof=1):.1%}",
                f"{(abs(means) <= 0.1).mean():.0%}",
                f"{errors[:, :n].mask.mean():.1%}",
            )
        people = math.ceil((1.96 * errors.std(ddof=1) / 0.1) ** 2)
        needed.append(
            f"{shown(condition)}: {counted(people, 'participant')} of"
            f" {counted(round(trials), 'trial')} for a mean JND"
            " within 10 % of its expectation in 95 of 100 experiments; its bias of"
            f" {errors.mean():+.1%} stays with any number"
        )
    print_wide(table)
    print("\n".join(needed))


def _jnds(
    made: experiments.Experiment,
    people: tuple[float, float, float],
    size: tuple[int, int],
    fit: tuple[str, bool],
    seed: int,
    **how: Any,
) -> dict[str, tuple[float, Any]]:
    """Return the trials of each simulated person and the errors of JNDs, by condition.

    Errors are parts of the mean JND, of shape (experiments, participants), masked where
    there is no fit.
    """
    import numpy as np

    from ..experiments.likelihood import curve

    (pse, jnd, between), (link, log) = people, fit
    wide, spread = float(curve(link).inverse(0.75)), math.sqrt(math.log1p((between / jnd) ** 2))
    observers = {}
    for code in (f"E{e}-P{n:02d}" for e in range(size[0]) for n in range(1, size[1] + 1)):
        # log-normal, so that no JND is 0 or below
        own = jnd * math.exp(
            spread * experiments.stream(seed, "person", code).normal() - spread**2 / 2
        )
        sigma = (math.log10(1 + own / pse) if log else own) / wide
        observers[code] = experiments.PsychometricObserver(pse, sigma, log=log, link=link)
    answers = experiments.simulate(made, observers, [*observers], seed=seed, **how)
    fits = experiments.fitted(
        answers, ["condition", "participant"], link=link, log=log, interval="none"
    )
    found = {}
    for condition in dict.fromkeys(answers["condition"]):
        each = [fits[condition, code] for code in observers]
        errors = np.array([one.jnd * (one.pse if log else 1.0) / jnd - 1 for one in each])
        if np.isfinite(errors).sum() < 2:
            raise BadValue(
                f"condition {condition!r}: no JND can be fitted to"
                f" {counted(each[0].trials, 'trial')};"
                f" {each[0].advice()[0]}"
            )
        trials = float(np.mean([one.trials for one in each]))
        found[condition] = trials, np.ma.masked_invalid(errors.reshape(size))
    return found


def _none_of(made: experiments.Experiment, data: Path, pilot: bool) -> str:
    """Return the error message for an experiment without sessions or pilots."""
    others = len(experiments.sessions(made.name, data, not pilot))
    kinds = ("sessions", "pilots") if pilot else ("pilots", "sessions")
    there = f"; it has {others} {kinds[0]}, which are kept apart from them" if others else ""
    remedy = "" if pilot or not others else ": stimlib experiment analyse --pilot reads them"
    remedy = remedy or ": begin one with stimlib experiment run, or name another folder with --data"
    return f"the folder {data} has no {kinds[1]} of {made.name}{there}{remedy}"


@command("analyse", experiment)
def analyse(
    defined: Defined,
    data: Data = Path("data"),
    pilot: Annotated[
        bool, typer.Option("--pilot", help="Analyse the pilot sessions instead of the data.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Also write all trials as a table, .csv.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            help=(
                "Also write a self-contained .html page: the result in words, curves, staircases"
                " and tables."
            )
        ),
    ] = None,
    separator: opt.Separator = ",",
    decimal: opt.Decimal = ".",
    bom: opt.Bom = False,
):
    """Run the experiment's own analysis on all sessions.

    Without one, print all trials as a table on stdout. For Excel with a decimal comma
    say --separator ";" --decimal "," --bom.

    [bold]stimlib experiment analyse pair.py:pair --out trials.csv[/]
    """
    from ..experiments.designs import trials_of
    from ..experiments.reader import csv_of

    made = experiment_of(defined)
    found = experiments.sessions(made.name, data, pilot)
    if not found:
        raise BadValue(_none_of(made, data, pilot))
    table = experiments.columns(found, training=True)
    if not table["number"]:
        raise BadValue(f"the sessions of {made.name} in {data} have no answers yet")
    for saved in found:
        who, number = saved.header["participant"], saved.header["session"]
        total = None
        with suppress(StimlibError):  # a definition that has no such session any more
            total = trials_of(made.designed(who, number))
        if total and len(saved.records) < total:
            note(
                f"{who}, session {number}: {len(saved.records)} of {counted(total, 'trial')};"
                " finish it (stimlib experiment resume), or move its folder away"
            )
    if any(table["simulated"]):
        note("a simulated observer gave these answers, and no participant")
    text = csv_of(table, separator, decimal, bom)
    if out is not None:
        safe_files.publish(out, text)
    said = "" if made.analysis is None else f"{called('the analysis', made.analysis, found)}"
    if made.analysis is not None:
        print(shown(said))
    elif out is None and report is None:
        print(text, end="")
    if report is not None:
        _page(report, made, found, said)
        print(f"report: {report}")


def _page(
    path: Path, made: experiments.Experiment, found: list[experiments.Saved], analysis: str
) -> None:
    """Write the page of an experiment, with curves where its trials have levels."""
    table = experiments.columns(found)
    keep = [
        k
        for k, (x, y) in enumerate(zip(table["level"], table["outcome"], strict=True))
        if None not in (x, y)
    ]
    answers = {name: [column[k] for k in keep] for name, column in table.items()}
    levels = answers["level"]
    log = bool(levels) and min(levels) > 0 and max(levels) >= 10 * min(levels)
    method = (
        f"{counted(len(found), 'session')} of the experiment {made.name}, version {made.version}."
        + " PILOT sessions: kept apart from the data." * found[0].header["pilot"]
    )
    if levels:
        method += (
            "\n\nA cumulative normal was fitted to the answers of each participant in each"
            f" condition, by maximum likelihood, over {'log10 of ' * log}the level."
        )
    fits = experiments.fitted(answers, log=log) if levels else None
    notes = [f"The experiment's own analysis: {line}" for line in analysis.splitlines()]
    experiments.write_report(
        path,
        f"{made.name}: result",
        method,
        answers if levels else table,
        fits=fits,
        notes=notes,
        unit=_unit(made, found),
    )


def _unit(made: experiments.Experiment, found: list[experiments.Saved]) -> str:
    """Return the unit of the parameter that has the level most often, or none."""
    trials = (record.trial for saved in found for record in saved.records)
    units = Counter(
        made.scenes[stimulus.scene].params[name].unit
        for trial in trials
        for stimulus in trial.stimuli
        for name, value in stimulus.params.items()
        if value == trial.level
    )
    unit = max(units, key=units.__getitem__, default="")
    return "" if unit == "1" else unit


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

    if bids is None and psych_ds is None:
        raise BadValue("say what to write: --bids FOLDER, --psych-ds FOLDER, or both")
    made = experiment_of(defined)
    found = experiments.sessions(made.name, data)
    if not found:
        raise BadValue(_none_of(made, data, False))
    if bids is not None:
        print(f"{counted(len(to_bids(made, found, bids, authors, signals)), 'file')} in {bids}")
    if psych_ds is not None:
        print(f"{counted(len(to_psych_ds(made, found, psych_ds, authors)), 'file')} in {psych_ds}")
