"""A session's page without a browser: who answers, what is refused, what is shown, and
what happens where the page is lost.
"""

import asyncio
import dataclasses
import io
import json
import signal
import socket
import threading
import time
from functools import partial

import pytest
from commands import ran
from experiments.some import TASK, experiment
from live.asked import ANSWERS, FOLDER, TYPED, asked, every
from live.client import HELLO, page, welcome
from live.drawn import seen
from waiting import until

import stimlib
from stimlib.cli import terminal
from stimlib.experiments import (
    ConstantStimuli,
    Prompt,
    Rate,
    Session,
    Stimulus,
    Timing,
    choice,
    read,
    run,
)
from stimlib.files import read_log
from stimlib.live import experiment as asking_module
from stimlib.live.experiment import LONGEST, ExperimentPage
from stimlib.live.site import Page

LONG = experiment(
    design=ConstantStimuli(((TASK, 4.0),)),
    timing=Timing(interval=0.8, gap=0.05, before=0.0, ramp=0.0),
)


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
    with asked(tmp_path / "page", every()) as running, welcome(running.server) as client:
        client.whole(text for text in TYPED if text != "9")
        assert client.until(phase="end")["told"][-1] == "That was the last one. Thank you."
        assert client.ended() == 4410 and running.errors == []

    monkeypatch.setattr(terminal.sys, "stdin", io.StringIO("\n".join(TYPED) + "\n"))
    with Session(every(), tmp_path / "terminal", "P01") as session:
        run(session, terminal.Terminal(), "offline")
    capsys.readouterr()
    mine, terminals = (read(tmp_path / d / FOLDER).records for d in ("page", "terminal"))
    assert facts(mine) == facts(terminals) and [r.answer.replays for r in mine] == [1, 0, 0, 0]
    assert [r.answer.values for r in mine] == ANSWERS
    assert 0 <= mine[0].answer.seconds < 60  # in ms: an answer may be there at once

    texts = [m for m in client.texts if m["is"] != "alive"]
    states = [m for m in texts if m["is"] == "state"]
    asks, feels = ([m for m in states if m["phase"] == p] for p in ("ask", "feel"))
    assert {m["is"] for m in texts} == {"hello", "state"}
    every_field = {"is", "number", "phase", "trial", "told", "since"}
    shown, fields = {"intervals", "cursor", "drawing"}, {"wait": set(), "end": set()}
    fields |= {"ask": {f.name for f in dataclasses.fields(Prompt)} | shown, "feel": shown}
    assert all(set(m) == every_field | fields[m["phase"]] for m in states)
    told = [{k: v for k, v in m.items() if k not in ("since", "number")} for m in texts]
    said = json.dumps(told) + str(running.notes)
    unseen = "secret hidden spring learnt main 4.321 2.345 1.987 3.456 0.777 P01".split()
    assert not [word for word in [*unseen, str(mine[0].trial.stimuli[0].seed)] if word in said]
    assert asks[0]["told"] == ["Squeeze."] and asks[0]["keys"] == [["1", "soft"]]
    assert asks[0]["apart"] == [["0", "Begin"]]
    which = [m["apart"] for m in asks if m["text"] == "Which one was that?"]
    assert which[:2] == [[["r", "Feel it again (1 left)"]], []]
    lines = ["How fine?", "How much?", "How nice?", "The largest first", "Where?"]
    assert [m["text"] for m in asks if m["line"]] == lines
    none = next(m["keys"] for m in asks if m["text"] == "Where?")
    assert ["n", "none felt"] in none, "or a page could not say so"
    right = "Right" if mine[2].trial.correct["softer"] == "green" else "Wrong"
    begins = [m["told"] for m in states if m.get("text", "").startswith("Trial")]
    assert begins == [[], ["Right"], ["Right"], [right]]
    assert feels[0]["cursor"] == 7.0 and feels[0]["intervals"] == [[0.128, 0.228]]
    training = "Trial 1 of 4, for training"
    trials = [n for n in running.notes if n.startswith("Trial")]
    assert trials == [training, *(f"Trial {n} of 4" for n in (2, 3, 4))]
    assert training in {m["trial"] for m in feels}
    assert running.notes[-1] == "That was the last one. Thank you."


def test_an_answer_is_taken_once_and_only_when_it_is_asked_for(tmp_path):
    with asked(tmp_path, LONG, "null") as running, welcome(running.server) as client:

        def refused(text, number, why):
            client.answer(text, number)
            assert why in client.until(about="answer")["text"]

        ready = client.until(phase="ask")
        refused("7", ready["number"], "there is no such key")
        client.answer("", ready["number"])
        refused("", ready["number"], "was answered")
        feel = client.until(phase="feel")
        for more in range(3):  # before its end, and what would come
            refused("1", feel["number"] + more, "nothing is asked now")
        question = client.until(phase="ask")
        assert question["number"] > feel["number"] and question["text"] == "Which one was softer?"
        refused("1", ready["number"], "nothing is asked now")  # late
        client.ws.send(HELLO)
        assert "said once" in client.until(about="hello")["text"]
        with welcome(running.server) as other:
            assert other.until(phase="ask")["number"] == question["number"]
            assert client.ended() == 4409
            other.answer("2", question["number"])
            other.until(phase="end")
    (record,) = read(tmp_path / FOLDER).records
    assert record.answer.values == {"softer": "second"} and len(record.displayed) == 1


def asking(face, call):
    """A thread of a session, once it has asked."""
    thread = threading.Thread(target=call)
    thread.start()
    until(lambda: face._state["phase"] == "ask")
    return thread


def test_an_earlier_page_answers_nothing_and_is_not_missed():
    """Between the opening of another and its own end."""
    notes, said, (first, second) = [], [], (Page(), Page())
    face = ExperimentPage(notes.append)
    face.join(first), face.join(second)
    prompt = Prompt("?", {"1": "one", "2": "two"})
    thread = asking(face, lambda: said.append(face.read(prompt)))
    with face._changed:  # before the session goes on
        for page_, text in ((first, "1"), (second, "2"), (second, "1")):
            face.do(page_, {"do": "answer", "number": 1, "text": text})
    thread.join()
    assert said == ["2"] and "opened on another page" in first.texts[-1][1]
    assert first.end[0] == 4409 and "it was answered" in second.texts[-1][1]
    face.leave(first)
    assert notes == ["the page is open"] * 2 and not face._missed
    face.leave(second)
    assert notes[-1] == "the page is gone: the session waits for it"


def test_the_log_of_layouts_has_room_for_so_many_in_a_trial(tmp_path, monkeypatch):
    """A page that sends them without end does not fill the disk."""
    monkeypatch.setattr(asking_module, "LAYOUTS", 3)
    log, page_ = tmp_path / "page.jsonl", Page()
    face = ExperimentPage(lambda text: None, log=log)
    face.join(page_)
    for trial in ("Trial 1", "Trial 2"):
        thread = asking(face, partial(face.ready, trial))
        drawn = {"do": "drawn", "number": face._number, "high": 1.0, "boxes": []}
        for wide in range(50):
            face.do(page_, drawn | {"wide": wide})
        face.do(page_, {"do": "answer", "number": face._number, "text": ""})
        thread.join()
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert [d["trial"] for d in lines] == ["Trial 1"] * 3 + ["Trial 2"] * 3


def test_layouts_follow_no_link(tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "page.jsonl").symlink_to(tmp_path / "mine")
    face, page_ = ExperimentPage(lambda text: None, log=tmp_path / "page.jsonl"), Page()
    face.join(page_)
    face._become("ask", text="?", keys=[], apart=[], line=True)
    face.do(page_, {"do": "drawn", "number": 1, "wide": 1, "high": 1, "boxes": []})
    assert (tmp_path / "mine").read_text() == "mine" and face._layouts == asking_module.LAYOUTS - 1


def test_a_page_that_is_lost_in_a_stimulus_lets_it_fade_and_it_comes_once_more(tmp_path):
    with asked(tmp_path, LONG, "null") as running:
        with welcome(running.server) as client:
            client.whole([""])
            client.until(phase="feel")
            client.ws.socket.shutdown(socket.SHUT_RDWR)  # no goodbye
            until(lambda: not running.asking.pages)
        with welcome(running.server) as client:
            again = client.until(phase="ask", text="Once more")
            assert "connection was lost" in again["told"][0] and again["trial"] == "Trial 1 of 1"
            client.answer("", again["number"])
            feel = client.until(phase="feel")
            assert client.until(phase="ask")["number"] == feel["number"] + 1
            client.answer("1", feel["number"] + 1)
            client.until(phase="end")
    (record,) = read(tmp_path / FOLDER).records
    first, second = record.displayed
    assert record.answer.replays == 0 and first["missed"] and "missed" not in second
    assert first["produced"] < 1500 < 1900 < second["produced"]
    events = read_log(tmp_path / FOLDER / first["log"]).events
    assert [e.data["reason"] for e in events if e.kind == "stop"] == ["stop"]
    assert "the page is gone: the session waits for it" in running.notes


@pytest.mark.parametrize(("made", "sink"), [(LONG, "null"), (seen(0.3), "page")])
def test_a_stimulus_that_no_page_sees_begin_fades_at_once(tmp_path, monkeypatch, made, sink):
    """Also where its motion went with the page: that is no movement that never came."""
    with asked(tmp_path, made, sink) as running:
        with welcome(running.server) as client:
            gone, become = [], running.asking._become

            def slow(what, **more):  # the page leaves between its key and the first sample
                if what == "wait" and not gone:
                    gone.append(client.ws.socket.shutdown(socket.SHUT_RDWR))
                    until(lambda: not running.asking.pages)
                become(what, **more)

            monkeypatch.setattr(running.asking, "_become", slow)
            client.whole([""])
            until(lambda: running.asking._state.get("text") == "Once more")
        with welcome(running.server) as client:
            again = client.until(phase="ask", text="Once more")
            assert "connection was lost" in again["told"][0]


def test_a_page_is_told_when_the_condition_of_an_interval_holds(tmp_path):
    """The reference moves from then on; the end is asked for before, too. A question
    after the last trial has no trial above it.
    """
    starts = stimlib.Input("x", "m") > stimlib.constant(0.4, "m")
    timing = Timing(1.0, gap=0.0, before=0.0, ramp=0.01, until="done", starts=starts, wait=1.0)
    design = ConstantStimuli(((Rate("c", ("softer",), Stimulus("spring")), None),))
    after = (choice("liked", "Did you like it?", "no", "yes"),)
    made = experiment(design=design, timing=timing, motion={"x": lambda t: t}, after=after)
    with asked(tmp_path, made, "null") as running, welcome(running.server) as client:
        client.whole([""])
        assert client.until(phase="feel")["intervals"] == []
        assert client.until(phase="ask", text="When you are done")["intervals"] == []
        now = client.until(intervals=[[0.0, 1.0]])
        assert (now["phase"], now["text"]) == ("ask", "When you are done")
        client.answer("", now["number"])
        asks = client.until(text="Which one was softer?")
        assert asks["intervals"] == [] and asks["cursor"] is None
        assert asks["trial"] == "Trial 1 of 1"
        client.answer("1", asks["number"])
        asks = client.until(text="Did you like it?")
        assert asks["trial"] == ""
        client.answer("2", asks["number"])
        client.until(phase="end")
    saved = read(tmp_path / FOLDER)
    (shown,) = saved.records[0].displayed
    ((a, b),) = shown["intervals"]
    assert shown["held"] and a == 401 and b < 1400 and saved.after == {"liked": "yes"}


def test_a_rest_is_the_servers(tmp_path):
    design, timing = ConstantStimuli(((TASK, 4.0), (TASK, 1.0))), Timing(0.1, 0.05, 0.0, 0.0, 0.5)
    with (
        asked(tmp_path, experiment(design=design, timing=timing)) as running,
        welcome(running.server) as client,
    ):
        client.whole(["", "1"])
        rest, began = client.until(phase="rest"), time.monotonic()
        assert 0.3 < rest["seconds"] <= 0.5 and 0 <= rest["since"]
        client.answer("", rest["number"])
        assert "nothing is asked now" in client.until(about="answer")["text"]
        with welcome(running.server) as other:  # loaded again: what is left, no more
            assert other.until(phase="rest")["since"] > rest["since"]
            other.whole(["", "1"])
            assert time.monotonic() - began > rest["seconds"] - rest["since"] - 0.1
            other.until(phase="end")
    assert "rest of 0 s" in running.notes


def test_a_server_that_ends_before_the_session_is_told(tmp_path):
    """Whoever sends answers that are too long is shut out."""
    long = json.dumps({"do": "answer", "number": 1, "text": (LONGEST + 1) * "1"})
    with asked(tmp_path, LONG) as running, page(running.server) as client:
        assert client.ended(HELLO, *[long] * 25) == 4400
    assert "the server of the page has ended before the session" in str(running.errors[0])
    assert read(tmp_path / FOLDER).records == []


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


class Interrupted(threading.Condition):
    """Ctrl-C comes when the lock is taken, before the ``with`` knows of it."""

    def __enter__(self):
        got = super().__enter__()
        signal.raise_signal(signal.SIGINT)
        return got


@pytest.mark.parametrize("what", ["_become", "_waited", "show"])
def test_ctrl_c_leaves_no_lock_with_which_the_page_would_wait_for_ever(monkeypatch, tmp_path, what):
    face, free = ExperimentPage(lambda text: None), []
    face.pages.append(Page())
    face._changed = Interrupted()
    show = face.display(LONG, "null")
    if what == "show":
        monkeypatch.setattr(asking_module, "present", lambda *given, **_: given[4](None))
        monkeypatch.setattr(face, "_become", lambda *_, **__: None)
    calls = {
        "show": lambda: show(TASK.trial(4.0, 1, 0), tmp_path),
        "_become": lambda: face._become("wait"),
    }
    with pytest.raises(KeyboardInterrupt):
        calls.get(what, face._waited)()
    thread = threading.Thread(target=lambda: free.append(face._changed.acquire(blocking=False)))
    thread.start()
    thread.join()
    assert free == [True]


@pytest.mark.parametrize("how", ["offline --page", "page"])
def test_the_command_prints_the_address_and_what_goes_on(tmp_path, monkeypatch, how):
    def interrupted(self, text):
        raise KeyboardInterrupt

    monkeypatch.setattr(ExperimentPage, "ready", interrupted)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(
        "from experiments.some import experiment\nmade = experiment()\n"
    )
    who = "own.py:made --participant P07 --session 1 --data data --host 127.0.0.1 --sink"
    done = ran(f"experiment run {who} {how}", 130)
    assert "the participant answers at http://127.0.0.1:" in done.output
    assert "0 answers kept; go on with stimlib experiment resume own.py:made" in done.output
    assert f"--sink {how.split()[0]}" in done.output and "--page\n" in done.output
