"""Reading sessions: answers, checked line by line, and blinded conditions."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from ..errors import BadValue, SinkError, StimlibError, public, shown
from ..system import fields, safe_files
from .random_streams import seed_of
from .trial import Answer, Record, Trial

VERSION = 1
HEADER = {
    "stimlib_experiment": fields.whole(10**6),
    "experiment": fields.table,
    "participant": fields.text,
    "session": fields.whole(10**6),
    "pilot": fields.truth,
    "seed": fields.whole(2**53),
    "started": fields.text,
}
LINE = {
    "number": fields.whole(10**9),
    "pilot": fields.truth,
    "trial": fields.table,
    "answer": fields.table,
    "displayed": fields.list_of(fields.table),
    "ended": fields.text,
    "chain": fields.text,
}


@public
def blinded(seed: int, name: str) -> str:
    """Return what an experimenter sees instead of a condition.

    It is a letter and digits that differ from session to session.

    Examples
    --------
    >>> from stimlib.experiments.session import blinded
    >>> blinded(1, "vibration"), blinded(2, "vibration")
    ('c6513', 'c6261')
    """
    return f"c{seed_of(seed, 'blind', name) % 10000:04}"


def check_code(participant: str) -> None:
    """Raise BadValue unless a participant is a code of letters and digits."""
    if not re.fullmatch(r"[A-Za-z]{1,4}[0-9]{1,6}", participant):
        raise BadValue(
            f"participant {participant!r} must be a code, up to four letters and a number such as"
            " P07, and no name"
        )


@public
def folder_of(
    experiment: str,
    data: str | os.PathLike[str],
    participant: str,
    session: int = 1,
    pilot: bool = False,
) -> Path:
    """Return the folder of a session.

    Raises
    ------
    BadValue
        A participant that is no code of letters and digits, such as P07: names of
        people do not belong into data; a session below 1; an experiment's name that is
        no name of a folder.
    """
    check_code(participant)
    if isinstance(session, bool) or not isinstance(session, int) or not 1 <= session < 10**6:
        raise BadValue(f"session = {session!r} must be a whole number from 1 on")
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}", experiment):
        raise BadValue(
            f"experiment {experiment!r}: its name must be letters, digits, - and _: it is the name"
            " of a folder"
        )
    return Path(data) / experiment / f"{'PILOT-' if pilot else ''}{participant}-s{session}"


def sealed(before: str, body: Mapping[str, Any]) -> tuple[str, str]:
    """Return a line, and the SHA-256 of it and all before."""
    text = json.dumps(body, allow_nan=False, sort_keys=True)
    chain = hashlib.sha256((before + text).encode()).hexdigest()
    return f'{text[:-1]}, "chain": "{chain}"}}', chain


@dataclass(frozen=True)
class Saved:
    """A session as stored on disk.

    Attributes
    ----------
    folder : Path
    header : dict
        session.json.
    records : list of Record
    size : int
        Bytes of whole lines.
    chain : str
        The last line's.
    """

    folder: Path
    header: dict[str, Any]
    records: list[Record]
    size: int
    chain: str

    @property
    def data(self) -> list[Record]:
        """The trials that count: those that are not for training."""
        return [r for r in self.records if not r.trial.training]


@public
def read(folder: str | os.PathLike[str], pilot: bool = False) -> Saved:
    """Read a session from its folder, even while it runs or after it was killed.

    Parameters
    ----------
    folder : path
    pilot : bool
        Whether a pilot is wanted.

    Returns
    -------
    Saved

    Raises
    ------
    SinkError
        No session; a line that was edited, is missing or is damaged: file and line are
        named; lines that are missing at the end: their trials are named.
    BadValue
        A pilot where data are wanted, or data where a pilot is.
    """
    folder = Path(folder)
    if not os.path.lexists(folder / "session.json"):
        raise SinkError(f"{folder} is no session of an experiment: there is no session.json")
    raw = safe_files.read(folder / "session.json", "sidecar_bytes")
    try:
        header = fields.parse(raw)
        fields.require(header, HEADER)
        if header["stimlib_experiment"] != VERSION:
            raise ValueError(
                f"version {header['stimlib_experiment']}, this stimlib reads {VERSION}: update"
                " stimlib"
            )
    except ValueError as e:
        raise SinkError(f"{folder / 'session.json'}: {e}") from e
    if header["pilot"] != pilot:
        raise BadValue(
            f"{folder} is {'a pilot, and no data' if header['pilot'] else 'no pilot, but data'}"
        )
    # first: a session that runs has lines before them
    said, path = _answered(folder), folder / "trials.jsonl"
    records, size, chain = _lines(path, hashlib.sha256(raw).hexdigest(), pilot)
    if len(records) < said:
        raise SinkError(
            f"{path} has {len(records)} trials, but {said} were answered, as other files of the"
            f" session say: trials {len(records) + 1} to {said} are missing at its end. Put back a"
            " whole copy of it, or give another session"
        )
    return Saved(folder, header, records, size, chain)


def _answered(folder: Path) -> int:
    """Return how many trials were answered at least.

    The file ``answered`` and the logs of what was displayed say so.
    """
    logs = [re.match(r"trial-(\d{4,9})-", p.name) for p in folder.glob("trial-*.stimlog")]
    # the last may have no answer
    begun = max((int(found[1]) for found in logs if found), default=1)
    path = folder / "answered"
    try:
        told = int(safe_files.read(path, "sidecar_bytes")) if os.path.lexists(path) else 0
    except ValueError:
        raise SinkError(
            f"{path} is damaged: it must have the number of answers; put back a copy of it"
        ) from None
    return max(begun - 1, told)


def _lines(path: Path, chain: str, pilot: bool) -> tuple[list[Record], int, str]:
    """Return records, bytes of whole lines, and the last seal."""
    records: list[Record] = []
    size = 0
    data = safe_files.read(path, "events_bytes") if os.path.lexists(path) else b""
    # after the last end of a line is what a killed process had begun
    for number, line in enumerate(data.split(b"\n")[:-1], 1):
        try:
            body = fields.parse(line)
            fields.require(body, LINE)
            told = body.pop("chain")
            if sealed(chain, body)[1] != told or body["number"] != number or body["pilot"] != pilot:
                raise ValueError(
                    "it is not as it was written: this line or one before was edited or removed"
                )
            trial, answer = Trial.from_dict(body["trial"]), Answer(**body["answer"])
            datetime.fromisoformat(body["ended"])
            records.append(Record(number, trial, answer, body["displayed"], body["ended"]))
        except StimlibError:
            raise
        except (ValueError, TypeError, KeyError) as e:
            raise SinkError(f"{path}, line {number}: {shown(e)}") from e
        chain, size = told, size + len(line) + 1
    return records, size, chain


@public
def sessions(experiment: str, data: str | os.PathLike[str], pilot: bool = False) -> list[Saved]:
    """Read all sessions of an experiment, data or pilots.

    They are in the order of their folders' names.

    Parameters
    ----------
    experiment : str
        Its name.
    data : path
    pilot : bool

    Raises
    ------
    SinkError, BadValue
        As `read`; sessions of different definitions; a folder that has another
        session's name, such as a copy.
    """
    folders = sorted(p.parent for p in (Path(data) / experiment).glob("*/session.json"))
    found = [read(p, pilot) for p in folders if p.name.startswith("PILOT-") == pilot]
    for s in found:
        own = folder_of(experiment, data, s.header["participant"], s.header["session"], pilot)
        if s.folder != own:
            raise BadValue(
                f"{s.folder} has the session {own.name}: a copy would count twice; move it out of"
                f" {own.parent}"
            )
    if len({s.header["experiment"].get("key") for s in found}) > 1:
        raise BadValue(
            f"{Path(data) / experiment} has sessions of different versions of the experiment:"
            " analyse each by itself"
        )
    return found


@public
def status(saved: Saved) -> dict[str, Any]:
    """Return a session's progress with conditions blinded.

    It is how far it is, with its conditions blinded.

    Returns
    -------
    dict
        ``participant``, ``session``, ``pilot``, ``trials``, ``training``,
        ``conditions`` (trials by blinded name), ``replays``, ``unanswered`` (logs of
        presentations to which no answer came, as the device failed or the session was
        left), ``shared`` (trials whose intervals have a shared time, as older sessions
        have it: see `stimlib.experiments.trial.Record.time`), ``lost`` samples,
        ``limited`` samples, ``last`` (date and time).
    """
    counts: dict[str, int] = {}
    for r in saved.records:
        name = blinded(saved.header["seed"], r.trial.condition)
        counts[name] = counts.get(name, 0) + 1
    shown_once = [d for r in saved.records for d in r.displayed]
    logs = {p.name for p in saved.folder.glob("trial-*.stimlog")}
    return {
        **{k: saved.header[k] for k in ("participant", "session", "pilot")},
        "trials": len(saved.records),
        "training": len(saved.records) - len(saved.data),
        "conditions": dict(sorted(counts.items())),
        "replays": sum(r.answer.replays for r in saved.records),
        "unanswered": len(logs - {d.get("log") for d in shown_once}),
        "shared": sum(r.time == "shared" for r in saved.records),
        "lost": sum(d.get("lost", 0) for d in shown_once),
        "limited": sum(
            n for d in shown_once for stage in d.get("clips", {}).values() for n in stage.values()
        ),
        "last": saved.records[-1].ended if saved.records else "",
    }


@public
def columns(found: Sequence[Saved], training: bool = False) -> dict[str, list[Any]]:
    """Return the trials that count as columns, for an analysis or pandas.

    Those of `simulate` are like them.

    Parameters
    ----------
    found : sequence of Saved
    training : bool
        Also the trials for training: the column ``training`` tells them apart.

    Returns
    -------
    dict of str to list
        ``participant``, ``session``, ``number``, ``condition``, ``track``, ``level``,
        ``chance`` (of the task), ``outcome``, ``seconds``, ``replays``, ``training``,
        and each question that was asked by its name; None where a trial has not asked
        it.
    """
    rows = [(s, r) for s in found for r in (s.records if training else s.data)]
    questions = list(dict.fromkeys(q for _, r in rows for q in r.trial.questions))
    return {
        "participant": [s.header["participant"] for s, _ in rows],
        "session": [s.header["session"] for s, _ in rows],
        "number": [r.number for _, r in rows],
        **{
            k: [getattr(r.trial, k) for _, r in rows]
            for k in ("condition", "track", "level", "chance")
        },
        "outcome": [r.outcome for _, r in rows],
        **{k: [getattr(r.answer, k) for _, r in rows] for k in ("seconds", "replays")},
        "training": [r.trial.training for _, r in rows],
        **{q: [r.answer.values.get(q) for _, r in rows] for q in questions},
    }


def csv_of(table: Mapping[str, Sequence[Any]]) -> str:
    """Return columns as CSV text, their names first.

    Examples
    --------
    >>> from stimlib.experiments.reader import csv_of
    >>> print(csv_of({"level": [1.0, 2.0], "outcome": ["yes", "no"]}), end="")
    level,outcome
    1.0,yes
    2.0,no
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return text.getvalue()
