"""Intervals that the participant ends, conditions that begin them, response times, and
questions after a session.
"""

import dataclasses
import json
import threading
import time
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pandas
import pytest
from experiments.some import QUESTION, TASK, Scripted, experiment, simulate
from experiments.test_experiment_cli import Pty
from refusals import refused

import stimlib
from stimlib.checks import verify_log
from stimlib.cli import terminal
from stimlib.devices.sources import Live
from stimlib.errors import BadValue, SinkError, UnknownName
from stimlib.experiments import (
    ConstantStimuli,
    Masking,
    OneInterval,
    Rate,
    Session,
    Timing,
    choice,
    columns,
    elapsed_times,
    free_text,
    places,
    present,
    read,
    run,
    sessions,
    spans,
    status,
    times_text,
)
from stimlib.experiments.bids import to_bids, to_psych_ds
from stimlib.experiments.trial import Answer, Record, Stimulus, Trial, correct
from stimlib.files import read_log, replay

AFTER = (
    choice("preferred", "Which did you prefer?", "soft", "stiff"),
    free_text("remarks", "Is there anything else?"),
)
DONE = Timing(interval=30.0, gap=0.05, before=0.0, ramp=0.01, until="done")
ONE = ConstantStimuli(((TASK, 4.0),))
X = stimlib.Input("x", "m")
BEFORE: set[threading.Thread] = set()
ONE_STIMULUS = (Stimulus("spring"),)


class Front(Scripted):
    """A front end that ends a stimulus, and answers, after some time; it notes whether
    one is displayed then, and leaves in the last of its squeezes.
    """

    seconds = 0.15

    def __init__(self, *answers, squeezes=9):
        super().__init__(*answers)
        self.squeezes = squeezes

    def ready(self, text):
        self.noted.append((text, playing()))
        if text.startswith("When"):
            time.sleep(self.seconds)
            self.squeezes -= 1
        if not self.squeezes:
            raise KeyboardInterrupt

    def ask(self, trial, question, replays):
        time.sleep(self.seconds)
        return super().ask(trial, question, playing())


def playing():
    """Whether a stimulus of this test is there."""
    return any(t.name == "stimlib sink" and t not in BEFORE for t in threading.enumerate())


@pytest.fixture(autouse=True)
def before():
    """Note which threads other tests have left."""
    BEFORE.clear()
    BEFORE.update(threading.enumerate())


def logs(session):
    """The logs of what was displayed, which prove it."""
    for record in read(session.folder).records:
        for d in record.displayed:
            log = read_log(session.folder / d["log"])
            assert replay(log).matches and verify_log(log).passed, d["log"]
            yield d, log


def test_a_session_of_self_paced_squeezes_by_keys(tmp_path, monkeypatch):
    """Each squeeze ends with a key, and its log proves what was there until then."""
    pty, made = Pty(), experiment(design=ONE, timing=DONE, after=AFTER)
    keys = {"Trial": b" ", "When you are done": b" ", "Which one": b"2", "prefer": b"1"}
    keys |= {"anything": b"the second was sticky\n"}
    shown = []

    def print_(text, **options):
        shown.append(text)
        for key in (key for words, key in keys.items() if words in text):
            threading.Timer(0.25, pty.hit, [key]).start()

    monkeypatch.setattr(terminal, "print", print_, raising=False)
    with open(pty.fd) as stdin, Session(made, tmp_path, "P01") as session:
        monkeypatch.setattr(terminal.sys, "stdin", stdin)
        with terminal.terminal() as face:
            run(session, face, "null")
    assert [t for t in shown if "done" in t] == ["When you are done: any key = Continue"] * 2
    record, after = read(session.folder).records
    for d, log in logs(session):
        ((a, b),) = d["intervals"]
        assert 50 < b - a < 30_000 and log.frames > b, "and the fade"
        k = record.trial.stimuli[d["interval"] - 1].params.get("k", 2.0)
        assert d["peak"]["force"] == pytest.approx([k], rel=1e-6)
    assert [d["interval"] for d in record.displayed] == [1, 2]
    assert after.answer.values == {"preferred": "soft", "remarks": "the second was sticky"}
    assert 0.2 < record.answer.times["softer"] <= record.answer.seconds


def test_a_stimulus_lasts_until_all_questions_are_answered(tmp_path):
    both = Rate("c", ("softer", "soft"), Stimulus("spring"))
    made = experiment(
        design=ConstantStimuli(((both, None),)),
        questions=(QUESTION, choice("soft", "?", "yes", "no")),
        timing=Timing(30.0, gap=0.0, before=0.0, ramp=0.01, until="answer"),
        replays=1,
    )
    front = Front("second", None, "first", "no")
    session = simulate(tmp_path, made, front, "null")
    asked = [n for n in front.noted if n[0] in both.questions]
    assert asked == [(name, True) for name in both.questions * 2]
    (record,) = session.records
    answer = record.answer
    assert answer.values == {"softer": "first", "soft": "no"} and answer.replays == 1
    (a, b), _ = (d["intervals"][0] for d, _ in logs(session))
    assert 100 < b - a < 30_000
    assert answer.seconds == pytest.approx(sum(answer.times.values()))
    assert min(answer.times.values()) > 0.14


def test_times_of_intervals_have_the_resolution_of_the_clock():
    day = "2026-01-01T00:00:00"
    shown = {"started": f"{day}.1+00:00", "fs": 10.0, "intervals": [[2, 6]]}
    record = Record(1, Trial("c", (Stimulus("spring"),), ("softer",)), Answer({}), [shown])
    assert record.intervals(f"{day}+00:00") == [("spring", 0.3, 0.7)]  # 0.1 + 2/10 is not 0.3


def test_answers_to_a_stimulus_that_was_missed_do_not_count(tmp_path):
    timing = Timing(1.0, gap=0.0, before=0.0, ramp=0.01, until="answer")
    made, missed = experiment(design=ONE, timing=timing), [False, True, False]

    def show(trial, folder, *, meanwhile, **how):
        assert len(trial.stimuli) == 1 and how["lasts"] is None
        meanwhile()
        return {"missed": True} if missed.pop(0) else {}

    (record,) = simulate(tmp_path, made, front := Front("first", "second"), show).records
    assert [what for what, _ in front.noted[1:3]] == ["When you are done", "softer"]
    assert record.answer.values == {"softer": "second"} and len(record.displayed) == 3


def test_each_self_paced_interval_needs_room_for_a_log_of_its_own(tmp_path, monkeypatch):
    """Of 1 MiB and its samples; a trial of another timing has one log."""
    free = SimpleNamespace(free=1_900_000)
    monkeypatch.setattr("stimlib.experiments.session.shutil.disk_usage", lambda path: free)
    timing = Timing(0.1, gap=0.0, before=0.0, ramp=0.01)
    with Session(experiment(design=ONE, timing=timing), tmp_path, "P01") as session:
        assert len(session.due().stimuli) == 2
    timing = dataclasses.replace(timing, until="done")
    with Session(experiment(design=ONE, timing=timing), tmp_path, "P02") as session:
        refused(SinkError, "the log of a trial may need 21", session.due)


def test_right_and_wrong_are_a_column(tmp_path):
    """None where a trial has no right answer, and for places, which are near or far."""
    named = {n: Stimulus("spring", {"k": k}) for n, k in (("first", 1.0), ("second", 3.0))}
    task = OneInterval("c", "softer", named)
    marks = Rate("m", ("where",), Stimulus("spring"), {"where": [[0.0, 1.0]]})
    design = ConstantStimuli(((task, "first"), (task, "second"), (marks, None)), shuffle="none")
    made = experiment(design=design, questions=(QUESTION, places("where", "?", 2)))
    with Session(made, tmp_path, "P01") as session:
        for answer in ({"softer": "first"}, {"softer": "first"}, {"where": [[0.0, 1.0]]}):
            session.put(Answer(answer))
    assert columns(sessions("pair", tmp_path))["correct"] == [True, False, None]
    two = Trial("c", (named["first"],), ("a", "b"), correct={"a": ("x", "z"), "b": "y"})
    # a ranking is a tuple before it is in a log, and a list after
    for said, right in (
        ({"a": ["x", "z"], "b": "y"}, True),
        ({"a": ("z", "x")}, False),
        ({}, False),
    ):
        assert correct(two, Answer(said)) is right


@pytest.mark.parametrize(("sink", "seconds", "long"), [("null", 0.0234, 23), ("offline", 9.0, 150)])
def test_a_simulated_observer_ends_a_stimulus_at_its_own_time(tmp_path, sink, seconds, long):
    """Or with it, if that takes longer."""
    timing = Timing(0.15, gap=0.0, before=0.0, ramp=0.01, until="answer")
    made = experiment(design=ONE, timing=timing, after=AFTER)
    session = simulate(tmp_path, made, lambda t, rng: Answer({"softer": "first"}, seconds), sink)
    record, after = session.records
    assert [np.diff(d["intervals"][0])[0] for d in record.displayed] == [long, long]
    assert all(log.report for _, log in logs(session))
    assert after.answer.values["remarks"] == ""


@pytest.mark.parametrize(
    ("sink", "starts", "interval"),
    [
        ("offline", X > stimlib.constant(0.3, "m"), (301, 501)),
        # where a marker would be told when the stimulus has been computed to its end
        ("file", X > stimlib.constant(0.3, "m"), (301, 501)),
        ("null", X > stimlib.constant(-1.0, "m"), (128, 328)),  # after the fade of the sink
        ("offline", X > stimlib.constant(9.0, "m"), (128, 128 + 1200)),  # it never holds
    ],
)
def test_an_interval_lasts_from_its_condition_on_any_sink(tmp_path, sink, starts, interval):
    made = starting(starts)
    shown = present(made, trial_of(made), sink, tmp_path / "a.stimlog")
    assert shown["intervals"] == [interval] and shown["held"] is (interval[1] < 1000)
    assert replay(read_log(tmp_path / "a.stimlog")).matches


@pytest.mark.parametrize(("until", "first"), [("time", 128), ("done", 428)])
def test_a_stimulus_comes_after_the_gap_only_if_its_intervals_are_self_paced(until, first):
    made = starting(None, timing=Timing(0.2, gap=0.3, before=0.0, until=until))
    assert spans(made, trial_of(made)) == [(first, first + 200)]


@pytest.mark.parametrize(
    ("call", "why"),
    [
        *(
            (
                lambda name=name: experiment(questions=(QUESTION, choice(name, "?", "yes", "no"))),
                f"is called {name}, as a column",
            )
            for name in ("level", "softer_rt", "interval_1", "interval_2_started")
        ),
        (lambda: experiment(after=(free_text("seconds", "?"),)), "called seconds"),
        (lambda: experiment().check(Trial("a", (), ("softer",))), "one stimulus at least"),
        (
            lambda: experiment(after=AFTER).check(Trial("c", ONE_STIMULUS, ("preferred",))),
            "preferred is asked after the session",
        ),
        (lambda: experiment(after=(QUESTION,)), "a name of its own"),
        (lambda: experiment(after=["remarks"]), "after = .* must be a tuple"),
        (lambda: starting(stimlib.Input("z", "m") > stimlib.constant(0.0, "m")), "starts takes z"),
        (lambda: Timing(until="key"), "until = 'key' must be one of time, done, answer"),
        (lambda: AFTER[1].answer(""), "at most 4000 characters, or n for nothing"),
    ],
)
def test_what_cannot_be_asked_or_waited_for_is_refused(call, why):
    refused((BadValue, UnknownName), why, call)
    assert AFTER[1].answer("n") == "" and len(AFTER[1].answer("x" * 4000)) == 4000


def test_a_condition_is_part_of_an_experiment():
    one, other = (starting(X > stimlib.constant(v, "m")) for v in (9.0, 8.0))
    assert one.facts()["key"] != other.facts()["key"]


def starting(starts, **other):
    timing = Timing(0.2, gap=0.0, before=0.0, ramp=0.01, starts=starts, wait=1.0)
    design = ConstantStimuli(((Rate("c", ("softer",), Stimulus("spring", {"k": 2.0})), None),))
    told = {"design": design, "motion": {"x": lambda t: t}, "timing": timing}
    return experiment(**(told | other))


def test_an_interval_begins_at_the_sample_at_which_its_condition_holds(tmp_path):
    """Here 0.3 s after contact, which begins at sample 201; it lasts for 0.2 s from
    then, and the condition is on no channel.
    """
    contact = stimlib.blocks.envelope(
        X > stimlib.constant(0.2, "m"), attack=0.3, release=0.0
    ) >= stimlib.constant(1.0)
    made, said = starting(contact, masking=Masking(rms=0.05)), []
    with Session(made, tmp_path, "P01") as session:
        trial = session.due()
        markers, words = [], {"started": lambda: said.append(1)}
        words["send"] = lambda marker: markers.append((marker.name, marker.sample))
        shown = present(made, trial, "null", tmp_path / "a.stimlog", **words)
    ((a, b),) = shown["intervals"]
    assert markers == [("trial", 0), ("stimulus", 128), ("starts", a)]
    assert a == 201 + 299 and b - a == 200 and shown["held"] and said == [1]
    log = read_log(tmp_path / "a.stimlog")
    assert replay(log).matches and verify_log(log).passed
    assert log.outputs == ("force", "masking", "starts") and log.channels == (0, 1)
    assert shown["peak"].keys() == {"force", "masking"}
    assert list(log.safety.scales(log.outputs))[1:] == [1.0, 1.0]  # as they have no unit
    assert shown["peak"]["force"] == pytest.approx([2 * (b - 1) / 1000], rel=1e-5)


def trial_of(made):
    design = made.designed("P01")
    return design.next(design.init(1))


def test_a_hand_moves_while_a_key_is_awaited():
    rows, enough = [], threading.Event()

    def hand(sink):
        while not sink.finished:
            rows.append(sink.push(np.full((1, 10), 0.5)))
            time.sleep(0.005)
            enough.set() if len(rows) > 5 else None

    part = Trial("c", (Stimulus("spring"),), ("softer",))
    made = experiment(motion=Live(keep=0.2), hand=hand, timing=DONE)
    shown = present(made, part, "null", meanwhile=lambda: enough.wait(60), realtime=False)
    ((a, b),) = shown["intervals"]
    assert 20 < b - a < 30_000
    wrong = experiment(motion=Live(), hand=lambda sink: 1 / 0, timing=DONE)
    how = {"meanwhile": lambda: None, "realtime": False}
    refused(ZeroDivisionError, None, present, wrong, part, "null", **how)


def test_an_interrupted_session_of_self_paced_intervals_is_resumed(tmp_path):
    """A trial that was left in its second interval comes again, and the questions after
    the session are asked when they were not.
    """
    made = experiment(design=ONE, timing=DONE, after=AFTER)
    for front, resume, left in (
        (Front(squeezes=2), False, 0),
        (Front("first", "soft", "leave"), True, 1),
        (Front("soft", "none"), True, 2),
    ):
        with suppress(KeyboardInterrupt), Session(made, tmp_path, "P01", resume=resume) as session:
            run(session, front, "null")
        assert len(session.records) == left
        while playing():  # its thread may still be closing the device
            time.sleep(0.01)
    assert [d["log"] for d, _ in logs(session)] == ["trial-0001-3.stimlog", "trial-0001-4.stimlog"]
    assert (session.folder / "trial-0001-2.stimlog").exists(), "what was left is kept"
    row = {name: column[0] for name, column in columns(sessions("pair", tmp_path)).items()}
    at = [row[f"interval_{k}_{what}"] for k in (1, 2) for what in ("started", "stopped")]
    assert row["preferred"] == "soft" and row["softer_rt"] > 0.14 and sorted(at) == at != at[:1] * 4
    simulate(tmp_path, made, front := Front(), "null", resume=True)
    assert front.noted == ["All trials of this session are done."]


def test_questions_after_a_session_are_asked_once_at_its_end(tmp_path):
    made = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0))), after=AFTER)
    good, long = (Answer({"preferred": "stiff", "remarks": text}) for text in ("good", "x" * 4001))
    with Session(made, tmp_path, "P01") as session:
        refused(BadValue, "'softer' is not answered", session.put, good)
        for _ in range(2):
            assert session.due().stimuli
            session.put(Answer({"softer": "first"}))
        assert session.due().questions == ("preferred", "remarks")
        refused(BadValue, "at most 4000 characters", session.put, long)
        session.put(good)
        assert session.due() is None
        refused(BadValue, "the session is over", session.put, good)
    (saved,) = sessions("pair", tmp_path)
    assert saved.after == {"preferred": "stiff", "remarks": "good"}
    for training in (False, True):
        table = columns([saved], training)
        assert table["remarks"] == ["good"] * 2 and table["number"] == [1, 2]
        assert "remarks_rt" not in table
    told = status(saved)
    assert (told["trials"], told["training"]) == (2, 0)


def test_a_dataset_has_a_run_of_each_self_paced_interval(tmp_path):
    made = experiment(design=ONE, timing=DONE, after=AFTER)
    first = lambda t, rng: Answer({"softer": "first"}, 0.1)  # noqa: E731
    simulate(tmp_path / "data", made, first, "offline")
    found = sessions("pair", tmp_path / "data")
    to_bids(made, found, tmp_path / "bids")
    beh, name = tmp_path / "bids/sub-P01/ses-1/beh", "sub-P01_ses-1_task-pair"
    shown = [s.scene for s in found[0].records[0].trial.stimuli]
    for k in (1, 2):
        text = (beh / f"{name}_acq-interval{k}_run-1_events.tsv").read_text()
        head, row = (line.split("\t") for line in text.splitlines())
        row = dict(zip(head, row, strict=True))
        assert (row["duration"], row["scene"]) == ("0.1", shown[k - 1])
    about = json.loads((beh / f"{name}_beh.json").read_text())
    assert about["interval_2_stopped"]["Description"].startswith("End of this interval")
    assert about["softer_rt"]["Units"] == "s" == about["interval_1_started"]["Units"]
    assert about["remarks"]["Description"] == "Is there anything else?"
    to_psych_ds(made, found, tmp_path / "psych")
    told = json.loads((tmp_path / "psych/dataset_description.json").read_text())
    (kind,) = (v for v in told["variableMeasured"] if v["name"] == "interval_1")
    assert kind["description"].startswith("Stimulus of this interval")


SLEEP = (
    [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0],
    [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4],
)
"""Student's (1908) sleep, hours, as R has it: t.test(.., var.equal = TRUE) prints t =
-1.8608, df = 18, p-value = 0.07919.
"""


def test_times_have_the_t_of_student_and_intervals_of_medians():
    """Ranks of intervals: Conover (1999), the binomial table: 2 and 9 of 10."""
    table = {
        "drug": ["1"] * 9 + [1] + ["2"] * 10 + ["1"] * 3,
        "extra": [*SLEEP[0], *SLEEP[1], None, np.nan, pandas.NA],
    }
    times = elapsed_times(table, "drug", "extra")
    assert {k: v.tolist() for k, v in times.items()} == dict(zip("12", SLEEP, strict=True))
    one, two, _, pair = times_text(times, {"1": "as printed"}).splitlines()
    assert "0.3 s [-1.2, 3.4], mean 0.75 s, SD 1.79, n = 10  paper: as printed" in one
    assert "[0.1, 4.6], mean 2.33 s, SD 2.00" in two and "t = -1.86, p = 0.079" in pair
    assert "t = -1.86, p = 0.04 (one-sided" in times_text(times, sides="one-sided")
    few = times_text({"a": [1.0, 2.0, 3.0, 4.0, 5.0], "b": [2.0] * 6, "c": [7.0]})
    assert "[nan, nan]" in few.splitlines()[0] and "[2.0, 2.0]" in few.splitlines()[1]
    assert times_text({"a": [3.0]}) == "a             3.0 s [nan, nan], mean 3.00 s, SD nan, n = 1"
    assert "t = nan, p = nan" in times_text({"a": [3.0], "b": [4.0]})
    refused(UnknownName, "seconds", elapsed_times, {"condition": ["a"]})
