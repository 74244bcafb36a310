"""Motion that never comes is reported, whatever the way; each transport: test_rows."""

import json
import math
import shutil
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import count, product

import numpy as np
import pytest
from devices.servers import begun
from experiments.some import TASK, experiment, observer
from live.test_server import greeted

from stimlib import Input, MotionError, Param, Scene
from stimlib.checks import verify_log
from stimlib.devices import Calibration, Live, NullSink, Signal, Signals, Stream
from stimlib.experiments import (
    ConstantStimuli,
    Session,
    Simulated,
    Timing,
    columns,
    present,
    run,
    sessions,
    status,
)
from stimlib.files import read_log
from stimlib.live.server import Server
from stimlib.live.stream import Stream as Site

SPRING = Scene({"force": Param("k", 2.0, "N/m") * Input("x", "m")})
GOOD = 0.0, 0.01

# k-th row: the sender's time, its numbers (the second is x), and an address of another
WAYS = {
    "never started": lambda k: None,
    "another address": lambda k: (k, GOOD, "/other"),
    "too short": lambda k: (k, GOOD),  # its column is 2
    "outside its limits": lambda k: (k, (0.0, 12.7)),
    "text": lambda k: (k, ("hello", "world")),
    "not finite": lambda k: (k, (0.0, math.nan)),
    "the first row only": lambda k: None if k else (k, GOOD),
    "out of order": lambda k: (1.0 - 1e-4 * k, GOOD),
    "after the end": lambda k: (k, GOOD),
}
# why rows of a way are rejected; and the ways in which one row is taken
REASONS = {"text": "no numbers"} | {
    w: w for w in ("another address", "too short", "outside its limits", "not finite")
}
COMES = "the first row only", "out of order"
SILENCES = "stop", "fade", "hold"


def linked(way):
    """Return what receives, and ``feed(over)``, which sends the next row of a way."""
    sent, numbers = [], count()

    def receive(timeout):
        time.sleep(0.002)
        taken, sent[:] = sent[:], []
        good = [row for row in taken if len(row) == 2]
        rejected = [("another address", repr(row[2])) for row in taken if len(row) == 3]
        return [values for _, values in good], [at for at, _ in good], rejected

    def feed(over=False):
        row = WAYS[way](next(numbers)) if over or way != "after the end" else None
        if row is not None:
            sent.append(row)
        time.sleep(0.003)

    return receive, feed


def source(receive, way, **more):
    columns = {"x": 2 if way == "too short" else 1}
    return Stream(receive=receive, columns=columns, limits={"x": (0.0, 0.02)}, **more)


def until(there, feed):
    """Go on until what was sent has come, however busy the machine is."""
    end = time.monotonic() + 10
    while not there() and time.monotonic() < end:
        feed()


def names_it(way, text, rejected):
    """Whether a text says that no motion came, and why as far as it can be known."""
    assert "no motion was received" in text, text
    assert [*rejected] == [why for w, why in REASONS.items() if w == way], rejected
    if way in REASONS:
        assert f"{REASONS[way]} (first: " in text, text
    elif way == "after the end":
        assert "too late" in text or "no row came" in text, text
    else:
        assert "no row came at" in text and "is the sender running" in text, text


# Settings -----------------------------------------------------------------------------
def session(way, folder, silence):
    """A session on a sink: it raises, its report, its log and ``verify`` say why."""
    receive, feed = linked(way)
    motion, said = source(receive, way, silence=silence), ""
    sink = NullSink(SPRING, 50.0, motion=motion, log=folder, realtime=False)
    try:
        with begun(sink, 0.1, fs=1000):
            to_the_end(sink, way, feed)
    except MotionError as e:
        said = str(e)
    sink._worker.join(60)  # a busy machine writes it later than ``close`` waits
    report, log = sink.report(), read_log(folder)
    if way in COMES and report.rows:
        assert said or "motion stale 1 time" in str(report) or "1 row of motion" in str(report)
        return
    names_it(way, said, report.rejected)
    assert report.silent in said and report.silent in str(report)
    assert log.report["silent"] == report.silent
    event = [e.data for e in log.events if e.kind == "rows"][-1]
    assert (event["silent"], event["rejected"]) == (report.silent, report.rejected)
    checks = verify_log(log).checks
    assert checks[0].name == "no motion was received"
    assert [c for c in checks if not c.passed] == checks[:1]


def to_the_end(sink, way, feed):
    """Send rows until the session has ended, and until they have come."""
    while not sink.finished:
        feed()
    feed(True)
    until(lambda: way not in REASONS or sink._feeder.rejected, feed)


def shown_by(made, folder, **how):
    """What is recorded of the first trial of an experiment."""
    design = made.designed("P01")
    return present(made, design.next(design.init(1)), "null", folder, realtime=False, **how)


def trial(way, folder, silence):
    """A trial of an experiment: it is no answer, and says why."""
    receive, feed = linked(way)
    hand = lambda sink: to_the_end(sink, way, feed)  # noqa: E731
    shown = shown_by(experiment(motion=source(receive, way, silence=silence), hand=hand), folder)
    if way in COMES and silence == "hold" and shown.get("rows"):
        assert shown["rows"] == 1
        return
    assert shown["missed"] and shown["silent"]
    if way not in COMES:
        names_it(way, shown["silent"], shown.get("rejected", {}))
        assert shown["peak"] == {"force": [0.0, 0.0]}


def page(way, folder, silence):
    """A session of the live page, whose x is a number of the stream."""
    receive, feed = linked(way)
    site = Site(
        SPRING, 1000.0, 50.0, ranges={"x": (0, 0.02)}, block=20, stream=receive, folder=folder
    )
    with Server(site, token="T") as server, greeted(server) as client:
        channel = 2 if way == "too short" else 1
        client.say("source", input="x", **{"from": "stream"}, channel=channel)
        client.say("start")
        client.until(phase="running")
        client.hear(3)
        until(
            lambda: way not in REASONS or site.inputs.rejected,
            lambda: (feed(), client.hear(1)),  # who hears answers, and is not sent away
        )
        [feed() for _ in range(3)]
        client.say("stop")
        why = client.until(phase="idle")["why"]
        assert not [m for m in client.texts if m["is"] == "error"]
        report = [m for m in client.texts if m["is"] == "report"][-1]
    if way in COMES and not why:
        assert report["rows"]
        return
    names_it(way, why, report["rejected"])
    assert "no motion was received" in report["silent"]


@pytest.mark.filterwarnings("ignore:the log is not written yet")
@pytest.mark.parametrize(
    ("setting", "silences"),
    [(session, SILENCES), (trial, SILENCES), (page, [""])],
)
def test_motion_that_never_comes_is_no_success(setting, silences, tmp_path):
    """Every way, with all that silence may do, all at once."""
    with ThreadPoolExecutor(8) as pool:
        running = {}
        for way, silent in product(WAYS, silences):
            (folder := tmp_path / f"{way} {silent}").mkdir()
            running[way, silent] = pool.submit(setting, way, folder, silent)
    failed = {case: done.exception() for case, done in running.items() if done.exception()}
    assert not failed, failed


@pytest.mark.parametrize("clocked", [False, True])
@pytest.mark.parametrize(
    "motion, says", [(Live(), "nothing was pushed"), (Signals({"x": Signal(1.0)}), "not connected")]
)
def test_nothing_pushed_and_nothing_connected_are_no_success(motion, says, clocked, tmp_path):
    how = {"clocked": clocked, "realtime": False, "log": tmp_path / "a"}
    sink = NullSink(SPRING, 50.0, motion=motion, **how)
    with (
        pytest.raises(MotionError, match=f"null: no motion was received: .*{says}"),
        begun(sink, 0.1, fs=1000),
    ):
        sink.wait()
    assert says in sink.report().silent and says in str(sink.report())
    assert verify_log(read_log(tmp_path / "a")).checks[0].name == "no motion was received"


def streamed(receive, seconds, **more):
    motion = Stream(receive=receive, columns={"x": 1}, **more)
    return begun(NullSink(SPRING, 50.0, motion=motion, realtime=False), seconds, fs=1000)


def test_rows_that_come_by_the_hundred_are_motion():
    """As of a converter that is read in blocks: none of them has waited."""

    def receive(timeout):
        time.sleep(0.02)
        return [GOOD] * 300, [math.nan] * 300

    with streamed(receive, 0.2) as sink:
        sink.wait()


def test_a_stream_that_stops_awaits_its_first_row_for_longer_than_the_next():
    calls, over = count(), threading.Event()

    def receive(timeout):
        time.sleep(0.004)
        comes = next(calls) > 20 and not over.is_set()  # at least 80 ms late
        return ([GOOD], [math.nan]) if comes else ([], [])

    with streamed(receive, 0.3, silence="stop") as sink:
        sink.wait()
        over.set()
        time.sleep(0.15)  # a session that has ended awaits none
    assert sink.report().rows > 1 and not sink.report().silent
    with (
        pytest.raises(MotionError, match="no row came at the receiver: is the sender running"),
        streamed(lambda timeout: time.sleep(timeout) or ([], []), None, silence="stop") as sink,
    ):
        sink.wait(30)
    assert sink.report().produced < 30_000


def test_motion_in_the_last_fade_is_none():
    sink = NullSink(SPRING, 50.0, motion=Live(), clocked=False)
    with pytest.raises(MotionError, match="nothing was pushed in time"), begun(sink, block=1):
        sink.pump.stop("stop")
        while not sink.finished:
            sink.pump.put_motion(np.full((1, 1), 0.01))


def test_a_killed_session_and_an_older_log_say_it_too(tmp_path):
    """The killed one by its events, the older one because its gain never rose."""
    folder, killed, older = (tmp_path / name for name in ("a", "killed", "older"))
    motion = Stream(receive=lambda s: time.sleep(s) or ([(9.9,)], [0.0]), columns={"x": 1})
    sink, events = NullSink(SPRING, 50.0, motion=motion, realtime=False, log=folder), "events.jsonl"
    with pytest.raises(MotionError), begun(sink, fs=1000):
        until(lambda: '"rows"' in (folder / events).read_text(), lambda: time.sleep(0.01))
        shutil.copytree(folder, killed)
    shutil.copytree(folder, older)
    lines = (folder / events).read_text().splitlines(True)
    (older / events).write_text("".join(x for x in lines if '"kind": "rows"' not in x))
    facts = json.loads((folder / "report.json").read_text())
    assert facts["rejected"].keys() == {"too short"}
    new = "silent", "rows", "rejected", "quiet"
    (older / "report.json").write_text(json.dumps({k: v for k, v in facts.items() if k not in new}))
    for place, says in ((killed, "too short"), (older, "the gain rises"), (folder, "too short")):
        first = verify_log(read_log(place)).checks[0]
        assert first.name == "no motion was received" and not first.passed and says in first.text


# Trials -------------------------------------------------------------------------------


def told_to(session, monkeypatch):
    """A simulated participant, and what is said to them."""
    someone, said = Simulated(session, observer), []
    for name in ("tell", "ready"):
        monkeypatch.setattr(someone, name, said.append)
    return someone, said


def test_a_trial_without_motion_is_presented_again_and_the_session_can_be_resumed(
    tmp_path, monkeypatch
):
    shown, there = [], 99  # from which presentation on there is motion

    def receive(timeout):
        time.sleep(0.004)
        return ([GOOD], [math.nan]) if len(shown) >= there else ([], [])

    made = experiment(
        design=ConstantStimuli(((TASK, 4.0),)),
        motion=Stream(receive=receive, columns={"x": 1}, silence="hold"),
        hand=shown.append,
        timing=Timing(interval=0.1, gap=0.05, before=0.2, ramp=0.0),
    )
    with (
        pytest.raises(MotionError, match="3 presentations in a row: null: no motion"),
        Session(made, tmp_path, "P01") as session,
    ):
        run(session, told_to(session, monkeypatch)[0], "null", realtime=False)
    assert session.records == [] and len(shown) == 3
    there = 5  # the second of the next session
    with Session(made, tmp_path, "P01", resume=True) as again:
        someone, said = told_to(again, monkeypatch)
        run(again, someone, "null", realtime=False)
    first, second = again.records[0].displayed
    assert first["missed"] and "no row came" in first["silent"]
    assert first["log"].endswith("-4.stimlog")
    assert "missed" not in second and second["rows"] > 1 and second["peak"]["force"][0] > 0
    told = [x for x in said if "movement" in x or x == "Once more"]
    assert "was not received" in told[0] and told[1:] == ["Once more"]
    (saved,) = sessions(made.name, tmp_path)
    table = columns([saved])
    assert table["missed"] == [1] and table["rows"] == [second["rows"]]
    assert (status(saved)["missed"], status(saved)["rejected"]) == (1, {})
    # a page that is gone says nothing of the motion: it is waited for
    missed = iter([{"missed": True}] * 5 + [{}])
    with Session(made, tmp_path, "P02") as session:
        someone, said = told_to(session, monkeypatch)
        run(session, someone, lambda trial, folder: next(missed))
    assert len(session.records[0].displayed) == 6 and "connection was lost" in str(said)


F = np.arange(20.0, 300.0)
LATE = Calibration(F, F / (F - 60j), 0 * F, "N", band=(30.0, 210.0))  # by 128 ms


@pytest.mark.parametrize(
    ("timing", "pushed", "calibration", "away"),
    [
        # the first interval is whole; the motion ends before the second
        (Timing(interval=0.1, gap=0.5, before=0.5, ramp=0.0), 735, None, (0.1, 0.1)),
        # it ends with the last interval, the end of which is still to pass the filter
        (Timing(interval=0.1, gap=0.05, before=0.2, ramp=0.0), 560, LATE, (0.001, 0.127)),
    ],
)
def test_motion_that_stays_away_within_an_interval_makes_the_trial_be_presented_again(
    tmp_path, timing, pushed, calibration, away
):
    hand = lambda sink: sink.push(np.full((1, pushed), 0.5))  # noqa: E731
    made = experiment(timing=timing, motion=Live(keep=1.0), hand=hand, safety=0.5)
    shown = shown_by(made, tmp_path / "a", calibration=calibration)
    assert shown["missed"] and shown["away"][0] == 0.0
    assert away[0] <= shown["away"][1] <= away[1]
    if not calibration:
        assert shown["silent"] == "no motion came for 0.1 s of an interval"
        assert shown["quiet"] > 0.05 and shown["peak"]["force"][0] > 0 == shown["peak"]["force"][1]
