"""The log of a session: one line per trial, on disk before the next stimulus.

Reading the log restores the state of the session.

A session is a folder, ``DATA/experiment/P07-s1``, with PILOT in front of the name if it
is a pilot:

``session.json``
    experiment, participant, number of the session, seed, versions, and the texts that
    the participant reads; written once
``trials.jsonl``
    one JSON object a trial: the trial as requested, the answer, what was displayed, and
    a SHA-256 over this line and all lines before; the last line has the answers to the
    questions after the session, if there are any, as a trial without stimuli
``answered``
    the minimum number of lines in ``trials.jsonl``, so that lines lost at its end are
    detected
``page.jsonl``
    with a page: which buttons it had for a question, where, and how large; and which
    samples of a stimulus it drew
``trial-0001-1.stimlog``
    the sink's log of what was displayed, for `stimlib.files.log_replay`
``spare``
    while the session is open: reserved space for one more answer on a full disk; a
    trial begins only if there is room for its log, too

A trial counts when its answer is written. Anything else that a killed process leaves is
dropped, and that trial is presented again.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any, Self

from ..errors import BadValue, SinkError, public, said_as
from ..system import safe_files
from ..version import __version__
from .experiment import Experiment
from .random_streams import stream
from .reader import VERSION, Saved, blinded, folder_of, read, sealed
from .trial import Answer, Record, Trial

AHEAD = 1000  # trials that are looked at before a session begins
SPARE = 65536  # bytes; the line of a trial has about 2000
LOG = 1 << 20  # bytes of a trial's log beside its samples: the scene, with maps, and events


@public
class Session:
    """A participant's running session, with its next trial and the answers so far.

    Parameters
    ----------
    experiment : Experiment
    data : path
        Folder for all data.
    participant : str
        A code such as "P07".
    session : int
        From 1 on.
    pilot : bool
        Whether the session is a pilot: its folder is called PILOT-.., each line is
        marked as a pilot, and `read` rejects it as data.
    resume : bool
        Whether to continue an interrupted session; otherwise none may exist.

    Raises
    ------
    BadValue
        An invalid participant code; a session that already exists, or does not exist;
        or a log of another experiment, version or definition.
    SinkError
        Another process has this session; a log that was edited or is damaged; the
        folder cannot be written.

    Examples
    --------
    See ``docs/howto/experiments.rst``.
    """

    def __init__(
        self,
        experiment: Experiment,
        data: str | os.PathLike[str],
        participant: str,
        session: int = 1,
        pilot: bool = False,
        resume: bool = False,
    ):
        self.experiment, self.participant, self.session, self.pilot = (
            experiment,
            participant,
            session,
            pilot,
        )
        self.folder = folder_of(experiment.name, data, participant, session, pilot)
        self.design = experiment.designed(participant, session)
        self.seed = experiment.seeded(participant, session)
        self._resume, self._file, self._lock, self._process = resume, -1, -1, -1

    def __enter__(self) -> Self:
        if self._resume and not os.path.lexists(self.folder / "session.json"):
            raise BadValue(f"there is no session {self.folder} to resume: run it first")
        safe_files.make_folder(self.folder)
        busy = (
            f"another run has the session {self.folder}: one participant cannot be in two at once"
        )
        self._lock = safe_files.lock(self.folder, busy)
        self._process = os.getpid()
        try:
            self._open()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def _close(self) -> None:
        if self._process == os.getpid():
            with suppress(OSError):
                os.unlink(self.folder / "spare")
        for fd in (self._file, self._lock):
            if fd >= 0:
                os.close(fd)
        self._file = self._lock = -1

    def _open(self) -> None:
        self.state = self.design.init(self.seed)
        if self.design.next(self.state) is None:
            raise BadValue(
                f"the design of {self.participant}, session {self.session}, has no trial"
            )
        if not self._resume:
            if os.path.lexists(self.folder / "session.json"):  # only who has the lock knows
                raise BadValue(
                    f"{self.folder} is there already: resume it, or give another session or folder;"
                    " data are never overwritten"
                )
            text = json.dumps(self._header(), indent=1, allow_nan=False) + "\n"
            safe_files.publish(self.folder / "session.json", text)
        saved = read(self.folder, pilot=self.pilot)
        self._same(saved)
        self.records: list[Record] = []
        for record in saved.records:
            self._replay(record)
        path = self.folder / "trials.jsonl"
        self._file = safe_files.opened(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        os.ftruncate(self._file, saved.size)  # what a killed process had begun to write
        os.fsync(self._file)
        safe_files.settle(self.folder)
        self._size, self._chain = saved.size, saved.chain

    def _header(self) -> dict[str, Any]:
        return {
            "stimlib_experiment": VERSION,
            "stimlib": __version__,
            "experiment": self.experiment.facts(),
            "participant": self.participant,
            "session": self.session,
            "pilot": self.pilot,
            "seed": self.seed,
            "started": _now(),
            "texts": self.experiment.texts,
        }

    def _same(self, saved: Saved) -> None:
        """Raise an error unless the log matches the current definition."""
        told, mine = saved.header, json.loads(json.dumps(self._header()))
        wrong = [k for k in ("participant", "session", "pilot", "seed") if told[k] != mine[k]]
        if told.get("texts", mine["texts"]) != mine["texts"]:  # sessions before 0.2 have none
            wrong.append("the language of the texts")
        a, b = told["experiment"], mine["experiment"]
        wrong += [f"experiment.{k}" for k in b if k != "key" and a.get(k) != b[k]]
        if wrong or a.get("key") != b["key"]:
            raise BadValue(
                f"{self.folder} belongs to another experiment or version:"
                f" {', '.join(wrong) or 'its key'} differs. Go on with the definition that it began"
                " with, or give another session"
                + ("" if saved.records else "; it has no answer, so you may delete its folder")
            )

    def _replay(self, record: Record) -> None:
        trial = self._next()
        if trial is None or json.loads(json.dumps(trial.to_dict())) != record.trial.to_dict():
            raise BadValue(
                f"{self.folder / 'trials.jsonl'}, line {record.number}: the design gives another"
                " trial there: the experiment, stimlib or numpy was changed since. Go on with what"
                " it began with, or give another session"
            )
        if trial.stimuli:
            self.state = self.design.update(self.state, record.answer)
        self.records.append(record)

    def _next(self) -> Trial | None:
        """Return the design's next trial; after the last, the one without stimuli."""
        trial, names = self.design.next(self.state), [q.name for q in self.experiment.after]
        return (
            Trial("after", (), tuple(names), training=True)
            if trial is None and names and all(r.trial.stimuli for r in self.records)
            else trial
        )

    # What a runner does ---------------------------------------------------------------
    @property
    def number(self) -> int:
        """Number of the next trial, starting at 1."""
        return len(self.records) + 1

    def due(self) -> Trial | None:
        """Return the next trial, or None at the end.

        Raises
        ------
        BadValue, UnknownName
            A trial that the experiment does not allow, such as one outside the bounds.
        SinkError
            The disk has no room for its answer, or for the log of what is displayed; or
            as `put`.
        """
        self._check_kept()
        trial = self._next()
        if trial is not None:
            self.experiment.check(trial)
            self._make_room(trial)
        return trial

    def ahead(self) -> Iterator[Trial]:
        """Return possible future trials, and the stimuli for familiarisation.

        The trials are those that a guessing participant would get, 1000 at most, up to
        an answer that the design does not take.
        """
        e, rng = self.experiment, stream(self.seed, "ahead")
        for known in e.familiar(self.participant, self.session).values():
            yield Trial("familiarisation", (known,), (e.questions[0].name,))
        with suppress(Exception):  # of a design, on an answer that nobody may give
            state = self.design.init(self.seed)
            for _ in range(AHEAD):
                if (trial := self.design.next(state)) is None:
                    return
                yield trial
                state = self.design.update(state, e.guess(trial, rng))

    def check_ahead(self) -> None:
        """Check the trials of `ahead`.

        So a mistake in the definition is found before the session has a folder.

        Raises
        ------
        BadValue, UnknownName
            As `due`.
        UnitError
            The experiment's safety is one full scale for outputs in different units.
        """
        self.experiment.check_safety()
        for trial in self.ahead():
            self.experiment.check(trial)

    def rest(self, trial: Trial) -> float:
        """Return the remaining seconds of a rest.

        Time during which the session was interrupted counts as rest.
        """
        wanted = max(trial.pause, self.experiment.timing.pause)
        if not self.records or wanted <= 0:
            return 0.0
        passed = (
            datetime.now(UTC) - datetime.fromisoformat(self.records[-1].ended)
        ).total_seconds()
        return min(max(wanted - passed, 0.0), wanted)

    def put(self, answer: Answer, displayed: Sequence[Mapping[str, Any]] = ()) -> Record:
        """Record the answer to the current trial; it is on disk on return.

        Raises
        ------
        BadValue
            A question has no answer or an invalid one, or an answer or display record
            is not JSON data, or as `check_kind`; nothing is written.
        SinkError
            The answer cannot be written; another program replaced or changed
            ``trials.jsonl``; or this process is a fork (``os.fork``) of the one that
            opened the session.
        """
        self._check_kept()
        self.check_kind(answer.simulated)
        trial = self._next()
        if trial is None:
            raise BadValue(f"{self.folder}: the session is over: it takes no more answers")
        for name in trial.questions:
            if name not in answer.values:
                raise BadValue(
                    f"the question {name!r} is not answered: {dict(answer.values)!r:.80}"
                )
            self.experiment.question(name).check(answer.values[name])
        state = self.design.update(self.state, answer) if trial.stimuli else self.state
        record = Record(self.number, trial, answer, list(displayed), _now())
        self._append(record)
        self.state = state
        self.records.append(record)
        return record

    def check_kind(self, simulated: bool) -> None:
        """Raise BadValue if a session would mix simulated answers with others."""
        if self.records and self.records[0].answer.simulated != simulated:
            raise BadValue(
                f"{self.folder} has {'' if simulated else 'simulated '}answers, and would get"
                f" {'a simulated one' if simulated else 'one of a participant'}; give another"
                " participant or folder"
            )

    def blind(self, trial: Trial) -> str:
        """Return the blinded name of a trial's condition."""
        return blinded(self.seed, trial.condition)

    def _check_kept(self) -> None:
        """Raise SinkError if an answer would be lost.

        This happens in a forked process, or if another program replaced or changed the
        file.
        """
        if self._process not in (os.getpid(), -1):
            raise SinkError(
                f"process {self._process} has the session {self.folder}: only it may go on with it,"
                " no fork of it"
            )
        if self._file < 0:
            return
        path, why = self.folder / "trials.jsonl", "another program replaced or changed it"
        try:
            there, mine = os.stat(path), os.fstat(self._file)
            kept = os.path.samestat(there, mine) and mine.st_size == self._size
        except OSError as e:
            kept, why = False, str(e.strerror)
        if not kept:
            raise SinkError(
                f"{path} is not as this session wrote it: {why}; put it back as it was, and resume"
                " the session"
            )

    # The disk -------------------------------------------------------------------------
    def _make_room(self, trial: Trial) -> None:
        """Reserve disk space for the next answer and for the log of the trial."""
        spare = self.folder / "spare"
        then = "so no stimulus is displayed: free some space, and resume the session"
        if not spare.is_file():
            try:
                safe_files.publish(
                    spare, os.urandom(SPARE)
                )  # of zeros a file system may keep nothing
            except SinkError as e:
                raise SinkError(f"{e}: there is no room for an answer, {then}") from e
        free, needed = shutil.disk_usage(self.folder).free, self._log_bytes(trial)
        if free < needed:
            raise SinkError(
                f"{self.folder}: {free} bytes are free, the log of a trial may need {needed},"
                f" {then}"
            )

    def _log_bytes(self, trial: Trial) -> int:
        """Return the largest possible size of a presentation's log in bytes.

        It covers the motion as float64, the delivered samples as float32, and the rest.
        """
        e, t = self.experiment, self.experiment.timing
        # with the fades
        seconds = t.before + len(trial.stimuli) * (t.interval + t.wait + t.gap + 1.0)
        return max(1, len(trial.stimuli) * t.self_paced) * LOG + int(e.fs * seconds) * (
            8 * len(e.inputs) + 4 * (len(e.outputs) + 1)
        )

    def _append(self, record: Record) -> None:
        body = {
            "number": record.number,
            "pilot": self.pilot,
            "trial": record.trial.to_dict(),
            "answer": record.answer.to_dict(),
        }
        body |= {"displayed": list(record.displayed), "ended": record.ended}
        with said_as(
            BadValue,
            f"trial {record.number}: its answer, or what was displayed, is no JSON data",
            TypeError,
            ValueError,
        ):
            text, chain = sealed(self._chain, body)
        data = text.encode() + b"\n"
        try:
            try:
                self._write(data)
            except OSError:
                with suppress(OSError):
                    os.unlink(self.folder / "spare")
                self._write(data)
        except OSError as e:
            raise SinkError(
                f"cannot write {self.folder / 'trials.jsonl'}: {e.strerror}; the answer is not kept"
            ) from e
        self._size, self._chain = self._size + len(data), chain
        with suppress(SinkError):  # of a disk that is full: the answer is there
            safe_files.publish(self.folder / "answered", f"{record.number}\n")

    def _write(self, data: bytes) -> None:
        """Write data to the disk completely, or leave the file unchanged."""
        try:
            done = 0
            while done < len(data):
                done += os.write(self._file, data[done:])
            os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, self._size)
            raise


def _now() -> str:
    return datetime.now(UTC).isoformat()
