"""A session's page without a browser: who answers, what is refused, what is shown, and
what happens where the page is lost.
"""

import asyncio
import dataclasses
import io
import json
import shlex
import signal
import socket
import threading
import time
from contextlib import contextmanager

import pytest
from typer.testing import CliRunner

pytest.importorskip("uvicorn")
from experiments.some import TASK, experiment
from live.asked import TYPED, asked, every
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import stimlib
from stimlib.cli import app, terminal
from stimlib.errors import SinkError
from stimlib.experiments.answer_keys import Prompt
from stimlib.experiments.designs import ConstantStimuli
from stimlib.experiments.experiment import Timing
from stimlib.experiments.questions import choice
from stimlib.experiments.reader import read
from stimlib.experiments.runner import run
from stimlib.experiments.session import Session
from stimlib.experiments.tasks import Rate
from stimlib.experiments.trial import Stimulus
from stimlib.files.log_reader import read_log
from stimlib.live import experiment as asking_module
from stimlib.live.experiment import FIELDS, LONGEST, ExperimentPage
from stimlib.live.site import Page

SHORT = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0))))
LONG = experiment(
    design=ConstantStimuli(((TASK, 4.0),)),
    timing=Timing(interval=0.8, gap=0.05, before=0.0, ramp=0.0),
)
TRIAL = TASK.trial(4.0, 1, 0)
FOLDER = "pair/P01-s1"


class Phone:
    """A page without a browser: what it has been told."""

    def __init__(self, ws):
        self.ws, self.told = ws, []

    def next(self):
        while isinstance(m := self.ws.recv(timeout=60), bytes) or '"is": "alive"' in m:
            pass  # samples to draw, and signs of life
        self.told.append(json.loads(m))
        return self.told[-1]

    def until(self, **wanted):
        """The first text from now on that has these fields."""
        while not wanted.items() <= (m := self.next()).items():
            pass
        return m

    def answer(self, text, number):
        self.ws.send(json.dumps({"do": "answer", "number": number, "text": text}))

    def whole(self, typed):
        """Answers one after another, as they are asked for."""
        for text in typed:
            self.answer(text, self.until(phase="ask")["number"])


@contextmanager
def page(running, greet=True, **options):
    at = f"127.0.0.1:{running.server.port}"
    with connect(
        f"ws://{at}/ws", **{"origin": f"http://{at}", "compression": None} | options
    ) as ws:
        phone = Phone(ws)
        if greet:
            ws.send('{"do": "hello", "token": "T", "version": 1}')
            phone.until(**{"is": "hello"})
        yield phone


def facts(records):
    """All but times, which no two sessions share."""
    shown = [[{**d, "started": ""} for d in r.displayed] for r in records]
    return [
        (r.number, r.trial, r.answer.values, r.answer.replays, d)
        for r, d in zip(records, shown, strict=True)
    ]


def test_a_whole_session_is_the_one_of_the_terminal_and_nothing_unblinds(
    tmp_path, monkeypatch, capsys
):
    with asked(tmp_path / "page", every()) as running, page(running) as phone:
        phone.whole(text for text in TYPED if text != "9")
        assert phone.until(phase="end")["told"][-1] == "That was the last one. Thank you."
        with pytest.raises(ConnectionClosed) as closed:
            phone.next()
    assert closed.value.rcvd.code == 4410 and running.errors == []

    monkeypatch.setattr(terminal.sys, "stdin", io.StringIO("\n".join(TYPED) + "\n"))
    with Session(every(), tmp_path / "terminal", "P01") as session:
        run(session, terminal.Terminal(), "offline")
    capsys.readouterr()
    mine, terminals = (read(tmp_path / d / FOLDER).records for d in ("page", "terminal"))
    assert facts(mine) == facts(terminals) and [r.answer.replays for r in mine] == [1, 0, 0, 0]
    assert mine[1].answer.values == {
        "rough": 6,
        "fine": 11,
        "much": 55,
        "nice": 62.0,
        "order": ["B", "A"],
        "where": [[1.0, 2.0], [0.5, 3.0]],
    }
    assert 0 <= mine[0].answer.seconds < 60  # in ms: an answer may be there at once

    states = [m for m in phone.told if m["is"] == "state"]
    every_field = {"is", "number", "phase", "trial", "told", "since"}
    fields = {
        "wait": set(),
        "end": set(),
        "ask": {f.name for f in dataclasses.fields(Prompt)} | {"intervals", "cursor", "drawing"},
        "feel": {"intervals", "cursor", "drawing"},
    }
    assert {m["is"] for m in phone.told} == {"hello", "state"}
    assert all(set(m) == every_field | fields[m["phase"]] for m in states)
    assert {m["phase"] for m in states} >= {"ask", "feel", "end"}
    said = json.dumps(
        [{k: v for k, v in m.items() if k not in ("since", "number")} for m in phone.told]
    ) + str(running.notes)
    unseen = "secret hidden spring learnt main 4.321 2.345 1.987 3.456 0.777 P01".split()
    assert not [word for word in [*unseen, str(mine[0].trial.stimuli[0].seed)] if word in said]
    first = next(m for m in states if m["phase"] == "ask")
    asks = [m for m in states if m["phase"] == "ask"]
    which = [m["apart"] for m in asks if m["text"] == "Which one was that?"]
    assert which[:2] == [[["r", "Feel it again (1 left)"]], []]
    assert [m["text"] for m in asks if m["line"]] == [
        "How fine?",
        "How much?",
        "How nice?",
        "The largest first",
        "Where?",
    ]
    assert first["told"] == ["Squeeze."] and first["keys"] == [["1", "soft"]]
    assert first["apart"] == [["0", "Begin"]]
    assert ["n", "none felt"] in next(m["keys"] for m in asks if m["text"] == "Where?"), (
        "or a page could not say so"
    )
    begins = [m["told"] for m in states if m.get("text", "").startswith("Trial")]
    assert begins == [
        [],
        ["Right"],
        ["Right"],
        ["Right" if mine[2].trial.correct["softer"] == "green" else "Wrong"],
    ]
    assert running.notes[-1] == "That was the last one. Thank you."
    feel = next(m for m in states if m["phase"] == "feel")
    assert feel["cursor"] == 7.0 and feel["intervals"] == [[0.128, 0.228]]
    assert "Trial 1 of 4, for training" in {m["trial"] for m in states if m["phase"] == "feel"}
    assert [n for n in running.notes if n.startswith("Trial")] == [
        "Trial 1 of 4, for training",
        "Trial 2 of 4",
        "Trial 3 of 4",
        "Trial 4 of 4",
    ]


def test_an_answer_is_taken_once_and_only_when_it_is_asked_for(tmp_path):
    with asked(tmp_path, LONG, "null") as running, page(running) as phone:
        ready = phone.until(phase="ask")
        phone.answer("7", ready["number"])
        assert phone.until(about="answer")["text"] == "there is no such key"
        for _ in range(2):
            phone.answer("", ready["number"])
        assert "was answered" in phone.until(about="answer")["text"]
        feel = phone.until(phase="feel")
        # before its end, and what would come
        for number in (feel["number"], feel["number"] + 1, feel["number"] + 2):
            phone.answer("1", number)
            assert "nothing is asked now" in phone.until(about="answer")["text"]
        question = phone.until(phase="ask")
        assert question["number"] > feel["number"] and question["text"] == "Which one was softer?"
        phone.answer("1", ready["number"])  # late
        assert "nothing is asked now" in phone.until(about="answer")["text"]
        with page(running) as other:
            assert other.until(phase="ask")["number"] == question["number"]
            with pytest.raises(ConnectionClosed) as closed:
                phone.answer("1", question["number"])
                while True:
                    phone.next()
            other.answer("2", question["number"])
            other.until(phase="end")
    assert closed.value.rcvd.code == 4409
    (record,) = read(tmp_path / FOLDER).records
    assert record.answer.values == {"softer": "second"} and len(record.displayed) == 1


def test_an_earlier_page_answers_nothing():
    """Between the opening of another and its own end."""
    face, (first, second), said = ExperimentPage(lambda text: None), (Page(), Page()), []
    face.join(first), face.join(second)
    thread = threading.Thread(
        target=lambda: said.append(face.read(Prompt("?", {"1": "one", "2": "two"})))
    )
    thread.start()
    while face._state["phase"] != "ask":
        time.sleep(0.001)
    with face._changed:  # before the session goes on
        for page_, text in ((first, "1"), (second, "2"), (second, "1")):
            face.do(page_, {"do": "answer", "number": 1, "text": text})
    thread.join(5)
    assert said == ["2"] and "opened on another page" in first.texts[-1][1] and first.end[0] == 4409
    assert "it was answered" in second.texts[-1][1]


def test_the_log_of_layouts_has_room_for_so_many_in_a_trial(tmp_path, monkeypatch):
    """A page that sends them without end does not fill the disk."""
    monkeypatch.setattr(asking_module, "LAYOUTS", 3)
    face, page_ = ExperimentPage(lambda text: None, log=tmp_path / "page.jsonl"), Page()
    face.join(page_)
    for trial in ("Trial 1", "Trial 2"):
        thread = threading.Thread(target=face.ready, args=(trial,))
        thread.start()
        while face._state["phase"] != "ask":
            time.sleep(0.001)
        asked_now = {"number": face._number, "high": 1.0, "boxes": []}
        for wide in range(50):
            face.do(page_, {"do": "drawn", "wide": wide} | asked_now)
        face.do(page_, {"do": "answer", "number": face._number, "text": ""})
        thread.join(5)
    lines = map(json.loads, (tmp_path / "page.jsonl").read_text().splitlines())
    assert [(d["trial"], d["wide"]) for d in lines] == [
        (trial, wide) for trial in ("Trial 1", "Trial 2") for wide in range(3)
    ]


def test_layouts_follow_no_link(tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "page.jsonl").symlink_to(tmp_path / "mine")
    face, page_ = ExperimentPage(lambda text: None, log=tmp_path / "page.jsonl"), Page()
    face.join(page_)
    face._become("ask", text="?", keys=[], apart=[], line=True)
    face.do(page_, {"do": "drawn", "number": 1, "wide": 1, "high": 1, "boxes": []})
    assert (tmp_path / "mine").read_text() == "mine" and face._layouts == asking_module.LAYOUTS - 1


def test_an_earlier_page_that_goes_is_not_missed():
    notes = []
    face, (first, second) = ExperimentPage(notes.append), (Page(), Page())
    face.join(first), face.join(second)
    face.leave(first)
    assert notes == ["the page is open"] * 2 and not face._missed
    face.leave(second)
    assert notes[-1] == "the page is gone: the session waits for it"


def test_a_page_that_is_lost_in_a_stimulus_lets_it_fade_and_it_comes_once_more(tmp_path):
    with asked(tmp_path, LONG, "null") as running:
        with page(running) as phone:
            phone.answer("", phone.until(phase="ask")["number"])
            phone.until(phase="feel")
            time.sleep(0.1)
            phone.ws.socket.shutdown(socket.SHUT_RDWR)  # no goodbye
        time.sleep(0.4)
        with page(running) as phone:
            again = phone.until(phase="ask")
            assert (
                again["text"] == "Once more"
                and "connection was lost" in again["told"][0]
                and again["trial"] == "Trial 1 of 1"
            )
            phone.answer("", again["number"])
            feel = phone.until(phase="feel")
            assert phone.until(phase="ask")["number"] == feel["number"] + 1
            phone.answer("1", feel["number"] + 1)
            phone.until(phase="end")
    (record,) = read(tmp_path / FOLDER).records
    first, second = record.displayed
    assert record.answer.replays == 0 and first["missed"] and "missed" not in second
    assert first["produced"] < 1500 < 1900 < second["produced"]
    stops = [
        e.data["reason"]
        for e in read_log(tmp_path / FOLDER / first["log"]).events
        if e.kind == "stop"
    ]
    assert stops == ["stop"] and "the page is gone: the session waits for it" in running.notes


def test_a_stimulus_that_no_page_sees_begin_fades_at_once(tmp_path, monkeypatch):
    with asked(tmp_path, LONG, "null") as running:
        with page(running) as phone:
            gone, become = [], running.asking._become

            def slow(what, **more):  # the page leaves between its key and the first sample
                if what == "wait" and not gone:
                    gone.append(phone.ws.socket.shutdown(socket.SHUT_RDWR))
                    while running.asking.pages:
                        time.sleep(0.01)
                become(what, **more)

            monkeypatch.setattr(running.asking, "_become", slow)
            phone.answer("", phone.until(phase="ask")["number"])
            while running.asking._state.get("text") != "Once more":
                time.sleep(0.01)
        with page(running) as phone:
            assert phone.until(phase="ask", text="Once more")
            phone.answer("", phone.told[-1]["number"])
            phone.whole(["1"])
            phone.until(phase="end")
    assert [d.get("missed") for d in read(tmp_path / FOLDER).records[0].displayed] == [True, None]


def test_a_page_is_told_when_the_condition_of_an_interval_holds(tmp_path):
    """The reference moves from then on; the end is asked for before, too."""
    starts = stimlib.Input("x", "m") > stimlib.constant(0.4, "m")
    timing = Timing(1.0, gap=0.0, before=0.0, ramp=0.01, until="done", starts=starts, wait=1.0)
    design = ConstantStimuli(((Rate("c", ("softer",), Stimulus("spring")), None),))
    made = experiment(design=design, timing=timing, motion={"x": lambda t: t})
    with asked(tmp_path, made, "null") as running, page(running) as phone:
        phone.answer("", phone.until(phase="ask")["number"])
        assert phone.until(phase="feel")["intervals"] == []
        assert phone.until(phase="ask", text="When you are done")["intervals"] == []
        now = phone.until(intervals=[[0.0, 1.0]])
        assert (now["phase"], now["text"]) == ("ask", "When you are done")
        phone.answer("", now["number"])
        asks = phone.until(text="Which one was softer?")
        assert asks["intervals"] == [] and asks["cursor"] is None
        phone.answer("1", asks["number"])
        phone.until(phase="end")
    (shown,) = read(tmp_path / FOLDER).records[0].displayed
    ((a, b),) = shown["intervals"]
    assert shown["held"] and a == 401 and b < 1400


def test_a_question_after_the_last_trial_has_no_trial_above_it(tmp_path):
    design = ConstantStimuli(((Rate("c", ("softer",), Stimulus("spring")), None),))
    made = experiment(design=design, after=(choice("liked", "Did you like it?", "no", "yes"),))
    with asked(tmp_path, made) as running, page(running) as phone:
        phone.answer("", phone.until(phase="ask")["number"])
        asks = phone.until(text="Which one was softer?")
        assert asks["trial"] == "Trial 1 of 1"
        phone.answer("1", asks["number"])
        asks = phone.until(text="Did you like it?")
        assert asks["trial"] == ""
        phone.answer("2", asks["number"])
        phone.until(phase="end")
    assert read(tmp_path / FOLDER).after == {"liked": "yes"}


def test_a_rest_is_the_servers(tmp_path):
    made = experiment(
        design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0))),
        timing=Timing(0.1, 0.05, 0.0, 0.0, pause=0.5),
    )
    with asked(tmp_path, made) as running, page(running) as phone:
        phone.whole(["", "1"])
        rest = phone.until(phase="rest")
        began = time.monotonic()
        assert 0.3 < rest["seconds"] <= 0.5 and 0 <= rest["since"] < 0.2
        phone.answer("", rest["number"])
        assert "nothing is asked now" in phone.until(about="answer")["text"]
        with page(running) as other:  # loaded again: what is left, no more
            assert other.until(phase="rest")["since"] > rest["since"]
            other.whole(["", "1"])
            assert time.monotonic() - began > rest["seconds"] - 0.2
            other.until(phase="end")
    assert "rest of 0 s" in running.notes


STRANGERS = {
    "a foreign origin": ({"origin": "http://evil.example"}, [], 403),
    "no token": ({}, ["{}"], 4401),
    "a wrong token": ({}, ['{"do": "hello", "token": "t", "version": 1}'], 4401),
    "rubbish": (
        {},
        ['{"do": "hello", "token": "T", "version": 1}', *['{"do": "start"}'] * 25],
        4400,
    ),
    "long answers": (
        {},
        [
            '{"do": "hello", "token": "T", "version": 1}',
            *[json.dumps({"do": "answer", "number": 1, "text": (LONGEST + 1) * "1"})] * 25,
        ],
        4400,
    ),
    "a flood": (
        {},
        [
            '{"do": "hello", "token": "T", "version": 1}',
            *['{"do": "answer", "number": 1, "text": "7"}'] * 3000,
        ],
        4408,  # it does not read why it is refused; or 4429
    ),
}


def test_strangers_and_floods_change_nothing_and_the_end_of_the_server_is_told(tmp_path):
    with asked(tmp_path, SHORT) as running:
        for name, (options, messages, code) in STRANGERS.items():
            try:
                with page(running, False, **options) as phone:
                    for m in messages:
                        phone.ws.send(m)
                    while True:
                        phone.next()
            except InvalidStatus as e:
                assert e.response.status_code == code, name
            except ConnectionClosed as e:
                said = e.rcvd and e.rcvd.code  # a flood that is cut off may come before the reason
                assert said == code or (name == "a flood" and said in (4429, None)), name
        with page(running) as phone:
            assert phone.until(phase="ask")["text"] == "Trial 1 of 2"
            phone.ws.send('{"do": "hello", "token": "T", "version": 1}')
            assert "said once" in phone.until(about="hello")["text"]
    assert "the server of the page has ended before the session" in str(running.errors[0])
    assert read(tmp_path / FOLDER).records == []


def test_a_session_that_stops_tells_the_page(tmp_path, monkeypatch):
    def full(*_):
        raise SinkError("no space")

    monkeypatch.setattr(Session, "put", full)
    with asked(tmp_path, SHORT) as running, page(running) as phone:
        phone.whole(["", "1"])
        assert phone.until(phase="end")["told"] == [
            "The session has stopped. All answers are kept. Please tell the experimenter."
        ]
        with pytest.raises(ConnectionClosed) as closed:
            phone.next()
    assert closed.value.rcvd.code == 4410 and str(running.errors[0]) == "no space"


def test_a_state_is_told_once():
    """Also where a page is opened while it is on its way: the answer would be given
    again, to the next.
    """
    face, page_ = ExperimentPage(lambda text: None), Page()
    face._become("rest", seconds=1.0)
    face.join(page_)
    page_.texts.clear()
    face._spread()
    assert not page_.texts
    face._become("wait")
    face._spread()
    assert len(page_.texts) == 1


def test_a_page_is_closed_when_it_has_taken_the_last_words():
    async def end():
        face, page_ = ExperimentPage(lambda text: None), Page()
        face.join(page_)
        goodbye = asyncio.create_task(face._goodbye())
        await asyncio.sleep(0.05)
        assert page_.texts and not page_.ended.is_set()
        page_.texts.clear()
        await goodbye
        assert page_.end[0] == 4410

    asyncio.run(end())


def test_the_table_of_messages_has_them_all():
    assert all(f"\n{name} " in asking_module.__doc__ for name in FIELDS if name != "hello")


class Interrupted(threading.Condition):
    """Ctrl-C comes when the lock is taken, before the ``with`` knows of it."""

    def __enter__(self):
        got = super().__enter__()
        signal.raise_signal(signal.SIGINT)
        return got


def test_ctrl_c_leaves_no_lock_with_which_the_page_would_wait_for_ever(monkeypatch, tmp_path):
    def presented(experiment, trial, sink, folder, began):
        began(None)

    monkeypatch.setattr(asking_module, "present", presented)
    for what in ("_become", "_waited", "show"):
        face, free = ExperimentPage(lambda text: None), []
        face.pages.append(Page())
        face._changed = Interrupted()
        show = face.display(LONG, "null")
        with pytest.raises(KeyboardInterrupt):
            if what == "show":
                monkeypatch.setattr(face, "_become", lambda *_, **__: None)
                show(TRIAL, tmp_path)
            else:
                getattr(face, what)(*["wait"] * (what == "_become"))
        thread = threading.Thread(
            target=lambda lock, free: free.append(lock.acquire(blocking=False)),
            args=(face._changed, free),
        )
        thread.start()
        thread.join()
        assert free == [True]


@pytest.mark.parametrize("sink, more", [("offline", ["--page"]), ("page", [])])
def test_the_command_prints_the_address_and_what_goes_on(tmp_path, monkeypatch, sink, more):
    def interrupted(self, text):
        raise KeyboardInterrupt

    monkeypatch.setattr(ExperimentPage, "ready", interrupted)
    monkeypatch.chdir(tmp_path)
    who = [
        "ugrip",
        "--participant",
        "P07",
        "--session",
        "1",
        "--data",
        "data",
        "--sink",
        sink,
        "--host",
        "127.0.0.1",
    ]
    done = CliRunner().invoke(app, ["experiment", "run", *who, *more])
    assert done.exit_code == 130 and "the participant answers at http://127.0.0.1:" in done.output
    assert (
        "0 answers are kept; go on with"
        f" {shlex.join(['stimlib', 'experiment', 'resume', *who, '--page'])}\n" in done.output
    )
