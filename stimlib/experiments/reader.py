"""Reading of session logs, with every line checked and conditions blinded."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from numbers import Real
from pathlib import Path
from typing import Any

from ..errors import BadValue, SinkError, StimlibError, counted, public, said_as, shown
from ..system import fields, safe_files
from .random_streams import seed_of
from .trial import Answer, Record, Trial, correct

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
    """Return the blinded name that an experimenter sees instead of a condition.

    The name is a letter with digits and differs from session to session.

    Examples
    --------
    >>> from stimlib.experiments.session import blinded
    >>> blinded(1, "vibration"), blinded(2, "vibration")
    ('c11546513', 'c57226261')
    """
    return f"c{seed_of(seed, 'blind', name) % 10**8:08}"


WORDS = (
    "participant|subject|person|people|proband|patient|visitor|user|player|volunteer|student"
    "|group|pilot|control|healthy|stroke|case|test|demo|code|team|pair|dyad|class|cohort|site"
    "|study|session|adult|child|children|young|older|elderly|senior|female|male|left|right"
    "|sighted|blind|deaf|novice|expert|naive|trained|sham|placebo|treatment|condition|part|subj"
)
"""Words that a code may have in small letters; others may be names."""
_DAY, _MONTH = r"(0[1-9]|[12]\d|3[01])", r"(0[1-9]|1[0-2])"
_DATES = [
    order.format(year=year, month=_MONTH, day=_DAY, mark=mark)
    for year, mark in ((r"(19|20)\d\d", "[-_]?"), (r"\d\d", "[-_]"))
    for order in (
        "{year}{mark}{month}{mark}{day}",
        "{day}{mark}{month}{mark}{year}",
        "{month}{mark}{day}{mark}{year}",
    )
]
RULES = {
    r"(?![A-Z0-9]([A-Z0-9_-]{0,62}[A-Z0-9])?\Z)": "it must have 1 to 64 letters of A to Z and"
    " digits, with - and _ only between them; write such as P07, 12 or sub-01",
    r"PILOT-": "PILOT- in front marks the folders of pilots; leave it out, and say --pilot"
    " (pilot=True) for a pilot",
    r"\D*\Z": "it has no digit, as names have none; add a number, such as P07",
    rf"([A-Z]+[-_]?)?({'|'.join(_DATES)})\Z": "it looks like a date, perhaps of birth; give a"
    " number that has nothing to do with the person, such as P07",
    # a single number, and a word in small letters
    r"(?=\D*\d{1,4}\D*\Z).*?"
    rf"(?!({WORDS})s?(?-i:(?![a-z])))(?-i:[A-Z][a-z]{{3,}}|(?<![A-Za-z])[a-z]{{4,}})": "a word with"
    " a number may be a name; give a code such as P07, or write letters that are no name in"
    " capitals",
}
"""What a code must not look like, and the words of the error."""


def check_code(participant: str, others: Iterable[str] = ()) -> None:
    """Raise BadValue unless a participant is a code that names a folder, and no person.

    Of the other codes, none may differ by capitals alone: not every file system tells
    p1 from P1.
    """
    for pattern, problem in RULES.items():
        if re.match(pattern, participant, re.ASCII | re.I):
            raise BadValue(f"participant {participant!r} must be a code: {problem}")
    for other in others:
        if other != participant and other.casefold() == participant.casefold():
            raise BadValue(
                f"participant {participant!r}: there is {other!r}, and some file systems take the"
                " two for one: write the code as before, or give another"
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
        A participant that is no code with a number, such as P07, 12 or sub-01 (names of
        people do not belong in data; the error names the rule), or differs by capitals
        alone from one who has a session; a session below 1, or an experiment name that
        cannot name a folder.
    """
    if isinstance(session, bool) or not isinstance(session, int) or not 1 <= session < 10**6:
        raise BadValue(f"session = {session!r} must be a whole number from 1 on")
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}", experiment):
        raise BadValue(
            f"experiment {experiment!r}: its name must be letters, digits, - and _: it is the name"
            " of a folder"
        )
    place = Path(data) / experiment
    names = [p.name for p in place.iterdir()] if place.is_dir() else []
    known = [re.fullmatch(r"(?:PILOT-)?(.+)-s\d+", name) for name in names]
    codes = [found[1] for found in known if found]
    if participant not in codes:  # who has a session keeps the code, whatever the rules were
        check_code(participant, codes)
    return place / f"{'PILOT-' if pilot else ''}{participant}-s{session}"


def sealed(before: str, body: Mapping[str, Any]) -> tuple[str, str]:
    """Return a log line, and the SHA-256 of this line and all lines before."""
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
        Number of bytes in complete lines.
    chain : str
        The SHA-256 of the last line.
    """

    folder: Path
    header: dict[str, Any]
    records: list[Record]
    size: int
    chain: str

    @property
    def data(self) -> list[Record]:
        """Trials that count for the analysis, without training trials."""
        return [r for r in self.records if not r.trial.training]

    @property
    def simulated(self) -> bool:
        """Whether an observer gave the answers, and no participant."""
        return any(r.answer.simulated for r in self.records)

    @property
    def after(self) -> dict[str, Any]:
        """Answers to the questions after the last trial, by name; empty before."""
        return {
            k: v for r in self.records if not r.trial.stimuli for k, v in r.answer.values.items()
        }


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
        There is no session; a line was edited, is missing or is damaged (file and line
        are named); or lines are missing at the end (their trials are named).
    BadValue
        The session is a pilot but data are wanted, or the reverse.
    """
    folder = Path(folder)
    if not os.path.lexists(folder / "session.json"):
        raise SinkError(f"{folder} is no session of an experiment: there is no session.json")
    raw = safe_files.read(folder / "session.json", "sidecar_bytes")
    with said_as(SinkError, f"{folder / 'session.json'}", ValueError):
        header = fields.parse(raw)
        fields.require(header, HEADER)
        if header["stimlib_experiment"] != VERSION:
            raise ValueError(
                f"version {header['stimlib_experiment']}, this stimlib reads {VERSION}: update"
                " stimlib"
            )
    if header["pilot"] != pilot:
        raise BadValue(
            f"{folder} is {'a pilot, and no data' if header['pilot'] else 'no pilot, but data'}"
        )
    # first: a session that runs has lines before them
    said, path = _answered(folder), folder / "trials.jsonl"
    records, size, chain = _lines(path, hashlib.sha256(raw).hexdigest(), pilot)
    if len(records) < said:
        raise SinkError(
            f"{path} has {counted(len(records), 'trial')}, but {said} were answered, as other"
            " files of the"
            f" session say: trials {len(records) + 1} to {said} are missing at its end. Put back a"
            " whole copy of it, or give another session"
        )
    return Saved(folder, header, records, size, chain)


def _answered(folder: Path) -> int:
    """Return the minimum number of trials that must have been answered.

    It is derived from the file ``answered`` and the logs of presentations.
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
    """Return the records, the size in bytes of complete lines, and the last hash."""
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
    """Read all sessions of an experiment, either data or pilots.

    Sessions are sorted by folder name.

    Parameters
    ----------
    experiment : str
        Its name.
    data : path
    pilot : bool

    Raises
    ------
    SinkError, BadValue
        As `read`; sessions with different definitions; a folder with another session's
        name, such as a copy; or simulated sessions next to those of participants.
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
    check_apart(found)
    return found


def check_apart(found: Sequence[Saved]) -> None:
    """Raise BadValue if sessions have one name, or only some of them are simulated."""
    named: dict[tuple[str, int], Saved] = {}
    for s in found:
        if (name := (s.header["participant"], s.header["session"])) in named:
            raise BadValue(
                f"{named[name].folder} and {s.folder} are both session {name[1]} of {name[0]}, and"
                " their trials could not be told apart; analyse or export each by itself"
            )
        named[name] = s
    kinds = {s.simulated: s.folder for s in found if s.records}
    if len(kinds) > 1:
        raise BadValue(
            f"{kinds[True]} has simulated answers, {kinds[False]} those of a participant; analyse"
            " or export each kind by itself: move one of them to another folder"
        )


@public
def status(saved: Saved) -> dict[str, Any]:
    """Return a session's progress with conditions blinded.

    An experimenter can read it during the experiment without learning the conditions.

    Returns
    -------
    dict
        ``participant``, ``session``, ``pilot``, ``simulated``, ``trials``,
        ``training``, ``conditions`` (trials by blinded name), ``replays``,
        ``unanswered`` (logs of presentations without an answer, because the device
        failed or the session was interrupted), ``missed`` (presented again),
        ``rejected`` (rows of motion), ``shared`` (trials whose intervals share one time
        axis, as in older sessions: see `stimlib.experiments.trial.Record.time`),
        ``lost`` samples, ``limited`` samples, ``last`` (date and time).
    """
    trials = [r for r in saved.records if r.trial.stimuli]
    counts = Counter(blinded(saved.header["seed"], r.trial.condition) for r in trials)
    shown_once = [d for r in saved.records for d in r.displayed]
    logs = {p.name for p in saved.folder.glob("trial-*.stimlog")}
    return {
        **{k: saved.header[k] for k in ("participant", "session", "pilot")},
        "simulated": saved.simulated,
        "trials": len(trials),
        "training": len(trials) - len(saved.data),
        "conditions": dict(sorted(counts.items())),
        "replays": sum(r.answer.replays for r in saved.records),
        "unanswered": len(logs - {d.get("log") for d in shown_once}),
        **{k: _moved(shown_once)[k] for k in ("missed", "rejected")},
        "shared": sum(r.time == "shared" for r in saved.records),
        "lost": sum(d.get("lost", 0) for d in shown_once),
        "limited": sum(
            n for d in shown_once for stage in d.get("clips", {}).values() for n in stage.values()
        ),
        "last": saved.records[-1].ended if saved.records else "",
    }


@public
def columns(found: Sequence[Saved], training: bool = False) -> dict[str, list[Any]]:
    """Return the non-training trials as columns, for an analysis or pandas.

    `simulate` returns columns of the same form.

    Parameters
    ----------
    found : sequence of Saved
    training : bool
        Whether to include training trials, which the column ``training`` identifies.

    Returns
    -------
    dict of str to list
        ``participant``, ``session``, ``number``, ``condition``, ``track``, ``level``,
        ``chance`` (of the task), ``outcome``, ``correct`` (True or False, None without
        a right answer), ``seconds``, ``replays``, ``simulated``, ``training``; each
        question under its name, and its response time in s, such as ``softer_rt``;
        ``interval_1`` (name of its stimulus, or scene), ``interval_1_started`` and
        ``interval_1_stopped`` in s since the session began, and so on; and each
        question after the last trial, with one answer in all rows of a session. None is
        unknown (such as times of a sink without a clock), or not asked. If any
        presentation has them, also ``missed`` (how many were presented again), ``rows``
        of motion, ``rejected`` rows by reason, and ``quiet``, the seconds at the end
        without new motion.

    Raises
    ------
    BadValue
        Two sessions of the same participant and number, as from two folders of data;
        simulated sessions together with those of participants.
    """
    check_apart(found)
    rows = [
        *((s, r) for s in found for r in (s.records if training else s.data) if r.trial.stimuli)
    ]
    questions = list(dict.fromkeys(q for _, r in rows for q in r.trial.questions))
    most = max((len(r.trial.stimuli) for _, r in rows), default=0)
    intervals = [r.intervals(s.header["started"]) + [(None,) * 3] * most for s, r in rows]
    return {
        "participant": [s.header["participant"] for s, _ in rows],
        "session": [s.header["session"] for s, _ in rows],
        "number": [r.number for _, r in rows],
        **{
            k: [getattr(r.trial, k) for _, r in rows]
            for k in ("condition", "track", "level", "chance")
        },
        "outcome": [r.outcome for _, r in rows],
        "correct": [correct(r.trial, r.answer) for _, r in rows],
        **{k: [getattr(r.answer, k) for _, r in rows] for k in ("seconds", "replays", "simulated")},
        "training": [r.trial.training for _, r in rows],
        **{q: [r.answer.values.get(q) for _, r in rows] for q in questions},
        **{f"{q}_rt": [r.answer.times.get(q) for _, r in rows] for q in questions},
        **{
            f"interval_{k + 1}{what}": [row[k][j] for row in intervals]
            for k in range(most)
            for j, what in enumerate(("", "_started", "_stopped"))
        },
        **{q: [s.after.get(q) for s, _ in rows] for s in found for q in s.after},
        **{
            k: [_moved(r.displayed)[k] for _, r in rows]
            for k in ("missed", "rows", "rejected", "quiet")
            if any(d.get(k) for _, r in rows for d in r.displayed)
        },
    }


def _moved(displayed: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what is known of the motion of a trial, over all its presentations."""
    found = {k: sum(d.get(k, 0) for d in displayed) for k in ("missed", "rows", "quiet")}
    return found | {
        "rejected": dict(sum((Counter[str](d.get("rejected")) for d in displayed), Counter[str]()))
    }


def csv_of(
    table: Mapping[str, Sequence[Any]], separator: str = ",", decimal: str = ".", bom: bool = False
) -> str:
    """Return columns as CSV text, with a header of their names.

    Parameters
    ----------
    table : mapping of str to sequence
    separator : str
        What separates columns: ``,`` ``;`` ``|`` or ``tab``.
    decimal : str
        Decimal sign of numbers, ``.`` or ``,``; texts stay as they are.
    bom : bool
        Whether the text begins with a byte order mark, by which Excel knows UTF-8.

    Raises
    ------
    BadValue
        Another separator or decimal sign, or one for both.

    Examples
    --------
    >>> from stimlib.experiments.reader import csv_of
    >>> table = {"level": [1.0, 2.0], "outcome": ["yes", "no"]}
    >>> print(csv_of(table, separator=";", decimal=","), end="")
    level;outcome
    1,0;yes
    2,0;no
    """
    mark = {"tab": "\t"}.get(separator, separator)
    if mark == decimal or mark not in tuple(",;|\t") or decimal not in (".", ","):
        raise BadValue(
            f"separator = {separator!r}, decimal = {decimal!r}: separate columns by , ; | or tab,"
            " and mark decimals by . or , but not both by one sign"
        )

    def cell(value: Any) -> Any:
        if isinstance(value, Real):
            return str(value).replace(".", decimal)
        # csv quotes no carriage return alone, and who reads it takes that for a new row
        return re.sub("\r\n?", "\n", value) if isinstance(value, str) else value

    text = io.StringIO()
    writer = csv.writer(text, delimiter=mark, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(map(cell, row) for row in zip(*table.values(), strict=True))
    return "\ufeff" * bom + text.getvalue()
