"""Export of sessions as datasets for other tools: BIDS and Psych-DS.

BIDS is the Brain Imaging Data Structure: Gorgolewski et al., Scientific Data 3 (2016);
the specification is version 1.10. Psych-DS: https://psych-ds.github.io, version 0.4.
"""

from __future__ import annotations

import csv
import gzip
import io
import json
import os
import re
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import BadValue, SinkError, counted, public
from ..files.log_reader import read_log
from ..files.log_replay import delivered, replay, without_inverse
from ..system import safe_files
from ..version import __version__
from .experiment import Experiment
from .reader import Saved, check_apart, columns, csv_of
from .trial import Record, in_real_time

COLUMNS = {
    "number": {"Description": "Number of the trial in its session, from 1"},
    "condition": {"Description": "Condition of the trial"},
    "track": {"Description": "Staircase or other sequence that the trial belongs to"},
    "level": {"Description": "Level of the stimulus that was varied"},
    "chance": {"Description": "Probability of a correct answer by guessing"},
    "outcome": {"Description": "Whether the answer was correct, or what it was"},
    "correct": {"Description": "Whether all right answers were given"},
    "seconds": {"Description": "Time from the first question to the last answer", "Units": "s"},
    "replays": {"Description": "How often the stimuli were presented again"},
    "simulated": {"Description": "Whether a simulated observer answered, and no participant"},
    "training": {"Description": "Whether the trial was for training and does not count"},
    "missed": {"Description": "Presentations without a page or motion, which were repeated"},
    "rows": {"Description": "Rows of motion that were taken while the stimuli were presented"},
    "rejected": {"Description": "Rows of motion that were rejected meanwhile"},
    "quiet": {"Description": "Time without new motion at the end of a stimulus", "Units": "s"},
    # the columns of any interval, and of any question
    "interval": {"Description": "Stimulus of this interval: its name, or its scene"},
    "_started": {
        "Description": "Begin of this interval, since the session began; n/a where the sink had no"
        " clock, so that the trial was not in real time",
        "Units": "s",
    },
    "_stopped": {"Description": "End of this interval, as its begin", "Units": "s"},
    "_rt": {"Description": "Time from when the question was asked to its answer", "Units": "s"},
}
TRACKED = {"m": "POS", "m/s": "VEL", "m/s**2": "ACCEL"}  # types of motion channels, by unit
AXIS = re.compile("(.*_|.)?[xyz]")  # an input of one: x, vx or hand_x, and not velocity


@public
def to_bids(
    experiment: Experiment,
    found: Sequence[Saved],
    folder: str | os.PathLike[str],
    authors: Sequence[str] = (),
    signals: bool = True,
) -> list[Path]:
    """Write sessions as a BIDS dataset of behavioural data, motion and stimuli.

    Parameters
    ----------
    experiment : Experiment
    found : sequence of Saved
        Result of ``sessions``.
    folder : path
        A new or empty folder.
    authors : sequence of str
        For the dataset's description.
    signals : bool
        Whether to include the displayed signals and the motion of trials that have a
        log.

    Returns
    -------
    list of Path
        The files: ``dataset_description.json``, ``README.md``, ``participants.tsv``,
        and for each session ``sub-P01/ses-1/beh/sub-P01_ses-1_task-NAME_beh.tsv`` with
        its JSON sidecar, one row for each trial.  Trial 3, if it has a log, is run 3:
        ``.._run-3_events.tsv`` has the onsets of its stimuli, ``.._run-3_stim.tsv.gz``
        the outputs in their units, 0 where samples were lost, and
        ``motion/.._tracksys-input_run-3_motion.tsv`` the motion; time 0 is its first
        sample.

    Raises
    ------
    BadValue
        No trials; a folder that has files; two sessions of the same participant and
        number; simulated sessions together with those of participants.  Nothing is
        written.
    SinkError
        The folder cannot be written; a log is missing or damaged.

    Examples
    --------
    See docs/howto/experiments.rst.
    """
    tables, note = _tables("to_bids", experiment, found, folder)
    task = label(experiment.name)
    codes = {who: s.header["participant"] for (who, _), (s, _) in tables.items()}
    files: dict[str, str | bytes] = {  # the first is written last
        "dataset_description.json": _json(
            {
                "Name": experiment.name,
                "BIDSVersion": "1.10.0",
                "DatasetType": "raw",
                "Authors": list(authors),
                "GeneratedBy": [{"Name": "stimlib", "Version": __version__}],
            }
        ),
        "README.md": f"# {experiment.name}\n\nVersion {experiment.version} of the experiment, run"
        f" with stimlib {__version__}. Each row of a `_beh.tsv` is a trial.{note}\n",
        "participants.tsv": _tsv(
            {"participant_id": [f"sub-{who}" for who in codes], "code": list(codes.values())}
        ),
        "participants.json": _json({"code": {"Description": "The code in the experiment"}}),
    }
    for (who, session), (s, table) in tables.items():
        name = f"sub-{who}_ses-{session}_task-{task}"
        place = f"sub-{who}/ses-{session}"
        rows = {k: v for k, v in table.items() if k not in ("participant", "session")}
        files[f"{place}/beh/{name}_beh.tsv"] = _tsv(rows)
        facts = _described(experiment, rows)
        told_them = {"Instructions": experiment.instructions} if experiment.instructions else {}
        files[f"{place}/beh/{name}_beh.json"] = _json(
            {"TaskName": experiment.name, **told_them, **facts}
        )
        for r in s.records if signals else ():
            # self-paced intervals have a run each, others one for the trial
            last = {
                f"{name}_acq-interval{d['interval']}" if "interval" in d else name: d
                for d in r.displayed
            }
            for run, shown in last.items():
                if "log" in shown:
                    files |= _run(experiment, s, r, shown, place, run)
    return _written(Path(folder), files, tables.values())


def _run(
    experiment: Experiment, s: Saved, r: Record, shown: Mapping[str, Any], place: str, name: str
) -> dict[str, str | bytes]:
    """Return the files of a trial with a log: events, stimulus and motion."""
    found = read_log(s.folder / shown["log"])
    if not (again := replay(found)).matches:
        raise SinkError(
            f"{found.folder}: {again}; put back a whole copy of it, or export without signals"
        )
    log = without_inverse(found)
    at = f"{place}/beh/{name}_run-{r.number}"
    spans = np.array(shown["intervals"])
    first = shown.get("interval", 1) - 1
    kinds = [stimulus.scene for stimulus in r.trial.stimuli[first : first + len(spans)]]
    events = {
        "onset": (spans[:, 0] / log.fs).tolist(),
        "duration": (np.diff(spans)[:, 0] / log.fs).tolist(),
        "trial_type": [r.trial.condition] * len(spans),
        "scene": kinds,
    }
    task = {"TaskName": experiment.name}
    since = "of the log" if in_real_time(shown) else "of the log, not in real time"
    told = {
        "onset": {"Description": f"Begin of the stimulus, since sample 0 {since}", "Units": "s"},
        "trial_type": COLUMNS["condition"],
        "scene": {"Description": "Scene of the experiment that was displayed"},
    }
    frames = [f.astype(np.float64) * there for _, f, there in delivered(log)]
    outputs = np.concatenate(frames) * log.safety.scales(log.outputs)[list(log.channels)]
    units, start = log.header["units"], {"StartTime": 0.0, "SamplingFrequency": log.fs}
    facts = {n: {"Units": units[n]} for n in log.outputs[: outputs.shape[1]]}
    files: dict[str, str | bytes] = {
        f"{at}_events.tsv": _tsv(events),
        f"{at}_events.json": _json({**task, **told}),
        f"{at}_stim.tsv.gz": gzip.compress(_rows(outputs).encode(), mtime=0),
        f"{at}_stim.json": _json({**task, **start, "Columns": list(facts), **facts}),
    }
    if log.inputs:
        moved = f"{place}/motion/{name}_tracksys-input_run-{r.number}"
        channels = {
            "name": list(log.inputs),
            "component": [n[-1] if AXIS.fullmatch(n) else "n/a" for n in log.inputs],
            "type": [TRACKED.get(units[n], "MISC") for n in log.inputs],
            "tracked_point": ["hand"] * len(log.inputs),
            "units": [units[n] for n in log.inputs],
        }
        about = {
            **task,
            "SamplingFrequency": log.fs,
            "TrackedPointsCount": 1,
            "MotionChannelCount": len(log.inputs),
        }
        files |= {
            f"{moved}_motion.tsv": _rows(np.asarray(log.motion)),
            f"{moved}_motion.json": _json(about),
            f"{moved}_channels.tsv": _tsv(channels),
            f"{moved}_events.tsv": _tsv(events),
            f"{moved}_events.json": files[f"{at}_events.json"],
        }
    return files


@public
def to_psych_ds(
    experiment: Experiment,
    found: Sequence[Saved],
    folder: str | os.PathLike[str],
    authors: Sequence[str] = (),
) -> list[Path]:
    """Write sessions as a Psych-DS dataset: one CSV file for each session.

    Parameters
    ----------
    experiment : Experiment
    found : sequence of Saved
        Result of ``sessions``.
    folder : path
        A new or empty folder.
    authors : sequence of str
        For the dataset's description.

    Returns
    -------
    list of Path
        ``dataset_description.json`` and, for each session,
        ``data/study-NAME_subject-P01_session-1_data.csv``, one row for each trial.

    Raises
    ------
    BadValue
        As `to_bids`.
    SinkError
        The folder cannot be written.

    Examples
    --------
    See docs/howto/experiments.rst.
    """
    tables, note = _tables("to_psych_ds", experiment, found, folder)
    variables = dict[str, None]()
    files: dict[str, str | bytes] = {}
    for (who, session), (_, table) in tables.items():
        name = f"study-{label(experiment.name)}_subject-{who}_session-{session}_data.csv"
        files[f"data/{name}"] = csv_of(table)
        variables |= dict.fromkeys(table)
    measured = [
        {
            "@type": "PropertyValue",
            "name": k,
            "description": about["Description"],
        }
        for k, about in _described(experiment, variables).items()
    ]
    about = {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": experiment.name,
        "description": f"Version {experiment.version} of the experiment, run with stimlib"
        f" {__version__}; a row is a trial.{note}",
        "author": [{"@type": "Person", "name": a} for a in authors],
        "variableMeasured": measured,
    }
    files = {"dataset_description.json": _json(about), **files}
    return _written(Path(folder), files, tables.values())


def _tables(
    what: str, experiment: Experiment, found: Sequence[Saved], folder: str | os.PathLike[str]
) -> tuple[dict[tuple[str, int], tuple[Saved, dict[str, list[Any]]]], str]:
    """Return the answered sessions and their trials by label and number, and a note.

    The note says whether the answers are simulated.
    """
    _check_new(Path(folder))
    told = [s for s in found if s.records]
    if not told:
        raise BadValue(f"{what}: the sessions of {experiment.name} have no answers yet")
    names = {s.header["experiment"].get("name", experiment.name) for s in told}
    if others := names - {experiment.name}:
        raise BadValue(f"{what}: sessions of {others.pop()}, and not of {experiment.name}")
    check_apart(told)
    codes = {s.header["participant"].casefold(): s.header["participant"] for s in told}
    for code in (s.header["participant"] for s in told):
        if code != (other := codes[code.casefold()]):
            raise BadValue(
                f"{what}: {code} and {other} differ by capitals alone, and some file systems take"
                " their folders for one; export each by itself"
            )
    return {
        (subject(s.header["participant"]), s.header["session"]): (s, columns([s], training=True))
        for s in told
    }, " All answers are simulated." if told[0].simulated else ""


def _described(experiment: Experiment, names: Iterable[str]) -> dict[str, dict[str, str]]:
    """Return what each of these columns means."""
    known = COLUMNS | {
        q.name: {"Description": q.text} for q in (*experiment.questions, *experiment.after)
    }
    return {
        k: known.get(k)
        or known.get(re.sub(r"_\d+$|^.*(?=_(started|stopped|rt)$)", "", k))
        or {"Description": k}
        for k in names
    }


def _written(
    at: Path,
    files: Mapping[str, str | bytes],
    told: Iterable[tuple[Saved, dict[str, list[Any]]]],
) -> list[Path]:
    """Write all files if no trial is lost; after an error, remove the folder.

    The description is written last: without it, what a killed export leaves is no
    dataset.
    """
    wanted = sum(bool(r.trial.stimuli) for s, _ in told for r in s.records)
    lines = [
        list(csv.reader(io.StringIO(str(text), newline="")))
        if name.endswith("_data.csv")
        else str(text).splitlines()  # a cell of a .tsv has no end of line
        for name, text in files.items()
        if name.endswith(("_beh.tsv", "_data.csv"))
    ]
    if (rows := sum(map(len, lines)) - len(lines)) != wanted:
        raise BadValue(
            f"{at}: {counted(wanted, 'trial')} would be {counted(rows, 'row')}, so nothing is"
            " written; export each session by itself"
        )
    held = safe_files.lock(safe_files.make_folder(at), f"{at}: another run exports into it")
    try:
        _check_new(at)
        try:
            for name, data in reversed(list(files.items())):
                safe_files.make_folder((at / name).parent)
                safe_files.publish(at / name, data)
        except BaseException:
            shutil.rmtree(os.path.realpath(at), ignore_errors=True)  # it was new or empty
            raise
    finally:
        os.close(held)
    return [at / name for name in files]


def _check_new(at: Path) -> None:
    """Raise BadValue if a folder is there and has files."""
    if at.is_dir() and any(at.iterdir()):
        raise BadValue(f"{at} has files: give a new folder")


def _rows(values: np.ndarray) -> str:
    """Return samples as tab-separated lines without a header, as BIDS requires."""
    text = io.StringIO()
    np.savetxt(text, values, "%.9g", "\t")
    return text.getvalue()


def label(text: str) -> str:
    """Return a text as a BIDS label, which has letters and digits only.

    Examples
    --------
    >>> from stimlib.experiments.bids import label
    >>> label("P-01 (left)")
    'P01left'
    """
    if not (found := re.sub(r"[^0-9A-Za-z]", "", text)):
        raise BadValue(f"to_bids: {text!r} has no letter or digit for a label")
    return found


def subject(code: str) -> str:
    """Return the BIDS label of a participant's code, which no other code has.

    A label has letters and digits only: - becomes qd, and _ becomes qu. A q that could
    be taken for the begin of these is doubled.

    Examples
    --------
    >>> from stimlib.experiments.bids import subject
    >>> subject("P07"), subject("sub-01"), subject("P_01"), subject("Q1-qd")
    ('P07', 'subqd01', 'Pqu01', 'Q1qdqqd')
    """
    return re.sub("q(?=[qdu_-])", "qq", code, flags=re.I).replace("-", "qd").replace("_", "qu")


def _json(data: dict[str, Any]) -> str:
    return json.dumps(data, indent=2) + "\n"


def _tsv(table: dict[str, list[Any]]) -> str:
    lines = [list(table), *zip(*table.values(), strict=True)]
    return "".join("\t".join(map(_cell, line)) + "\n" for line in lines)


def _cell(value: Any) -> str:
    if value is None:
        return "n/a"
    text = json.dumps(value) if isinstance(value, bool | list | dict) else str(value)
    return " ".join(text.split()) or "n/a"
