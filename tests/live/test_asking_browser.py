"""A session's page in a real browser: all of it by keyboard, with a reload and lost
connections; touch, mouse, looks.
"""

import io
import itertools
import json
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

pytest.importorskip("uvicorn")
from experiments.some import TASK, experiment
from live.asked import TYPED, asked, every
from live.chromium import Browser, where

from stimlib.cli import terminal
from stimlib.errors import SinkError
from stimlib.experiments.answer_keys import Prompt
from stimlib.experiments.designs import ConstantStimuli
from stimlib.experiments.experiment import Cursor, Timing
from stimlib.experiments.questions import analogue, choice, free_text, rating
from stimlib.experiments.reader import read
from stimlib.experiments.runner import run
from stimlib.experiments.session import Session
from stimlib.experiments.tasks import Rate
from stimlib.experiments.trial import Stimulus
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import replay
from stimlib.live.experiment import ExperimentPage
from stimlib.live.server import Server

pytestmark = [
    pytest.mark.xdist_group("browser"),
    pytest.mark.skipif(
        where() is None, reason="Chromium is not installed: tests/devices/install.sh installs it"
    ),
]
LOOKS = Path(__file__).with_name("looks.js").read_text()
FOLDER = "pair/P01-s1"
TEXT = "document.querySelector('#text').textContent"


@pytest.fixture(scope="module")
def browser():
    made = Browser()
    yield made
    made.close()


def awaited(running, page, known=0):
    """The number of the next prompt, once the page shows it and takes keys."""
    end = time.monotonic() + 60
    while (state := running.asking._now())["phase"] != "ask" or state["number"] <= known:
        if state["phase"] == "end":
            running.thread.join(10)  # which keeps the error that has ended it
        assert running.thread.is_alive() and time.monotonic() < end, (state, running.errors)
        time.sleep(0.01)
    page.until(
        f"{TEXT} === {state['text']!r} && document.querySelector('#keys button:enabled,"
        " #typed:enabled') !== null"
    )
    assert page.js("document.querySelector('#trial').textContent") == (
        state["trial"] if state["trial"] != state["text"] else ""
    )
    time.sleep(0.26)
    return state


def lose(running, code=1012):
    """The connection, as a network does: the page finds the server again."""
    (old,) = running.asking.pages
    running.asking._loop.call_soon_threadsafe(old.close, code, "")
    end = time.monotonic() + 10
    while running.asking.pages in ([], [old]):
        assert time.monotonic() < end
        time.sleep(0.01)


def press(page, state, text):
    if state["kind"] == "rating" and state["keys"]:
        for key in text[: len(text) * state["line"]]:
            page.key(key)  # no field has the focus before
    elif state["kind"] == "analogue":
        steps = int(text) - 50  # where the first key puts it
        for key in ["PageUp"] * (1 + steps // 10) + ["ArrowRight"] * (steps % 10):
            page.key(key)
    elif state["line"]:
        page.call("Input.insertText", text=text)
    page.key("Enter" if state["line"] else text or " ")


def test_a_whole_session_by_keyboard_with_a_reload_and_lost_connections(
    browser, tmp_path, monkeypatch, capsys
):
    made = every(timing=Timing(interval=0.5, gap=0.05, before=0.0, ramp=0.0))
    answers, number, lost = [text for text in TYPED if text != "9"], 0, False
    with asked(tmp_path / "page", made, "null") as running:
        page = browser.page(running.server.url, 900, 700)
        while answers:
            state = awaited(running, page, number)
            if len(answers) in (10, 4):  # in the middle of questions: a line, a key
                page.reload() if len(answers) == 10 else lose(running)
                page.until("document.querySelector('#state').textContent === 'Connected'")
                assert awaited(running, page, number) == state | {
                    "since": pytest.approx(state["since"], abs=30)
                }
            again = state["text"] == "Once more"
            assert (
                not again
                or not lost
                and "connection was lost" in page.js("document.querySelector('#told').textContent")
            )
            lost, number = lost or again, state["number"]
            press(page, state, "" if again else answers.pop(0))
            if len(answers) == 1 and not lost:  # in the middle of a stimulus
                while running.asking._state["phase"] != "feel":
                    time.sleep(0.005)
                lose(running, 4429)  # as too many messages, such as of a held key
        page.until("document.querySelector('#state').textContent.startsWith('The session is over')")
        assert page.js("document.querySelector('#told').textContent").endswith("Thank you.")
        assert page.complaints() == []
        page.close()
    assert running.errors == [] and lost
    monkeypatch.setattr(terminal.sys, "stdin", io.StringIO("\n".join(TYPED) + "\n"))
    with Session(made, tmp_path / "terminal", "P01") as session:
        run(session, terminal.Terminal(), "offline")
    mine, terminals = (read(tmp_path / d / FOLDER).records for d in ("page", "terminal"))
    assert [(r.trial, r.answer.values, r.answer.replays) for r in mine] == [
        (r.trial, r.answer.values, r.answer.replays) for r in terminals
    ]
    assert [[d.get("missed", False) for d in r.displayed] for r in mine] == [
        [False] * 2,
        [False],
        [False],
        [True, False],
    ]
    seen, wanted = (
        [d for r in all_ for d in r.displayed if not d.get("missed")] for all_ in (mine, terminals)
    )
    for d, w in zip(seen, wanted, strict=True):
        # a busy machine may lose samples
        facts = ("scene", "params", "seed", "intervals") + ("peak", "rms") * (d["lost"] == 0)
        assert [d[k] for k in facts] == [w[k] for k in facts]


def test_touch_double_clicks_held_keys_and_a_second_page(browser, tmp_path):
    made = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0), (TASK, 2.0))))
    with asked(tmp_path, made) as running:
        page = browser.page(running.server.url, 390, 800)
        first = awaited(running, page)
        page.js(
            """new MutationObserver(() => document.querySelector('#keys button')?.click())
            .observe(document.querySelector('#keys'), {childList: true})"""
        )  # a double click: each new question gets one
        page.click("#keys button")
        question = awaited(running, page, first["number"])
        assert question["text"] == "Which one was softer?" and len(running.session.records) == 0
        x, y = page.at("#keys button:nth-child(2)")
        page.touch("Start", (x, y, 0.5))
        page.touch("End")
        held = awaited(running, page, question["number"])
        page.call("Input.dispatchKeyEvent", type="keyDown", key="2", text="2", code="Digit2")
        asked_now = awaited(running, page, held["number"])
        for _ in range(5):
            page.call(
                "Input.dispatchKeyEvent",
                type="keyDown",
                key="2",
                text="2",
                code="Digit2",
                autoRepeat=True,
            )
        page.call("Input.dispatchKeyEvent", type="keyUp", key="2", code="Digit2")
        assert len(running.session.records) == 1 and running.session.records[0].answer.values == {
            "softer": "second"
        }
        other = browser.page(running.server.url, 390, 800)
        page.until("document.querySelector('#state').textContent.includes('open on another page')")
        assert page.js("document.querySelector('#keys button').disabled")
        state = awaited(running, other)
        assert state["number"] == asked_now["number"]
        for key in ("1", " ", "2"):
            other.key(key)
            if key != "2":
                state = awaited(running, other, state["number"])
        other.until(
            "document.querySelector('#state').textContent.startsWith('The session is over')"
        )
        assert page.complaints() == other.complaints() == []
        page.close(), other.close()
    assert [r.answer.values["softer"] for r in running.session.records] == [
        "second",
        "first",
        "second",
    ]


@pytest.mark.parametrize("wide", [160, 320, 1240])
def test_it_can_be_read_at_any_width_in_both_themes(browser, tmp_path, wide):
    with asked(tmp_path, every(familiarisation={})) as running:
        page = browser.page(running.server.url, wide, 700)
        page.js(LOOKS)
        number = 0
        for text in ("", "r", "1", "", "6", "11", "55", "62", "B A"):
            state = awaited(running, page, number)
            number = state["number"]
            for theme in ("light", "dark"):
                page.media(prefers_color_scheme=theme)
                ratio, element = page.js("looks.contrast()")
                assert ratio >= 4.5, (theme, element)
            assert page.js("document.documentElement.scrollWidth") <= wide and page.js(
                f"looks.inside({wide})"
            )
            for _, _, w, h in [
                page.box(f"#keys button:nth-child({k + 1})") for k in range(len(state["keys"]))
            ]:
                # CSS pixels, which a finger hits; eleven at 320 px have less
                assert w >= (44 if len(state["keys"]) < 8 else 24) and h >= 44
            press(page, state, text)
        page.close()


HTML = "<img src=x onerror='complain()'>\"&amp;" + 300 * "W"
# which one was softer? with joiners that it is spelled with
PERSIAN = "کدام\u200cیک نرم\u200cتر بود؟"


def test_any_text_is_shown_as_it_was_written_from_the_side_where_it_begins(browser, tmp_path):
    question = choice("softer", PERSIAN, "first", "second")
    made = experiment(
        design=ConstantStimuli(((TASK, 4.0),)), questions=(question,), instructions=HTML
    )
    with asked(tmp_path, made) as running:
        page = browser.page(running.server.url, 320, 700)
        state = awaited(running, page)
        assert (
            page.js("document.querySelector('#told').textContent") == HTML
            and page.js("document.images.length") == 0
        )
        assert page.js("document.documentElement.scrollWidth") <= 320
        press(page, state, "")
        awaited(running, page, state["number"])
        assert page.js(TEXT) == PERSIAN
        begins = """(() => { const r = document.createRange();
            const t = document.querySelector('#text').firstChild;
            r.setStart(t, 0), r.setEnd(t, 1); return r.getBoundingClientRect().right; })()"""
        assert page.js(begins) > 280 and page.complaints() == []
        page.close()


WATCH = """window.seen = [];
(function watch() {
    const y = +(document.querySelector('#point').style.transform.match(/-?[\\d.]+/) ?? [0])[0];
    const text = id => document.querySelector(id).textContent;
    seen.push([text('#text'), text('#clock'), y]);
    requestAnimationFrame(watch);
})();"""


def test_a_reference_moves_in_its_intervals_and_a_rest_counts_down(browser, tmp_path):
    timing = Timing(interval=0.6, gap=0.3, before=0.0, ramp=0.0, pause=2.2)
    made = experiment(
        design=ConstantStimuli(((TASK, 4.0),), 2), timing=timing, cursor=Cursor("x", 1.0, 0.5)
    )
    with asked(tmp_path, made, "null") as running:
        page = browser.page(running.server.url, 600, 700)
        page.js(WATCH)
        state = awaited(running, page)
        press(page, state, " ")
        state = awaited(running, page, state["number"])
        press(page, state, "1")
        page.until("document.querySelector('#clock').textContent === '0:02'")
        seen = page.js("seen")
        page.reload()
        page.js(WATCH)
        awaited(running, page, state["number"])
        seen += page.js("seen")
        page.close()
    felt = [(clock, y) for text, clock, y in seen if text == "Feel"]
    assert list(dict.fromkeys(clock for clock, _ in felt)) == ["", "1 of 2", "2 of 2"]
    for which in ("1 of 2", "2 of 2"):  # up, by sin(0.6 pi) at most
        way = [y for clock, y in felt if clock == which]
        assert all(y <= 0 for y in way) and -130 < min(way) < -60
    assert all(y == 0 for clock, y in felt if not clock)
    rest = [clock for text, clock, _ in seen if text == "Please rest"]
    # 0:00: the server was late; a busy page skips some
    assert {"0:02"} <= set(rest) <= {"0:03", "0:02", "0:01", "0:00"}
    assert rest == sorted(rest, reverse=True)  # loaded again, it is no longer


RATED = [
    rating(f"r{n}", f"How rough, of {n}?", "smooth", "extremely rough", n) for n in (5, 7, 9, 11)
]
OTHERS = [
    choice("two", "Which?", "Fingerspitzengefühl", "second"),
    choice(
        "four",
        "Like what?",
        "wood",
        "glass",
        "soft rubber",
        "sandpaper of a very fine grain, as for varnish",
    ),
    analogue("line", "How nice?", "not at all nice", "very"),
]

# where the text of the low end begins, and where that of the high end ends
ENDS = """["#low", "#high"].map((id, k) => { const r = document.createRange();
    r.selectNodeContents(document.querySelector(id));
    return r.getBoundingClientRect()[["left", "right"][k]]; })"""

# no word is cut
UNCUT = """[...document.querySelectorAll("#keys span")].every(({ firstChild: text }) =>
    [...text.data.matchAll(/\\S+/g)].every(({ 0: word, index }) => {
        const r = document.createRange();
        r.setStart(text, index), r.setEnd(text, index + word.length);
        return r.getClientRects().length === 1;
    }))"""
TOUCH = "getComputedStyle(document.querySelector('#vas')).touchAction"


def test_answers_have_one_size_and_nothing_that_is_none_is_among_them(browser, tmp_path):
    questions = (*RATED, *OTHERS)
    task = Rate("c", tuple(q.name for q in questions), Stimulus("spring"))
    design = ConstantStimuli(((task, None),))
    with asked(tmp_path, experiment(design=design, questions=questions, replays=1)) as running:
        page = browser.page(running.server.url, 390, 800)
        state = awaited(running, page)
        for question, text in zip(questions, ["", "5", "7", "9", "11", "2", "4"], strict=True):
            press(page, state, text)
            state = awaited(running, page, state["number"])
            assert state["text"] == question.text
            for wide in (320, 390, 768, 1440):
                page.size(wide, 800)
                boxes = [
                    page.box(f"#keys button:nth-child({k + 1})") for k in range(len(state["keys"]))
                ]
                low, high, again = page.box("#low"), page.box("#high"), page.box("#apart button")
                assert page.js("document.documentElement.scrollWidth") <= wide
                assert all(0 <= x and x + w <= wide for x, _, w, _ in boxes) and page.js(UNCUT)
                if question.kind == "analogue":
                    x, y, w, h = page.box("#vas")
                    assert not page.js("document.querySelector('#mark').checkVisibility()")
                    assert page.js(TOUCH) == "none"  # a drag scrolls nothing
                    assert x == low[0] and x + w == pytest.approx(high[0] + high[2])
                else:
                    sizes = [(w, h) for _, _, w, h in boxes]
                    assert sizes == [pytest.approx(sizes[0], abs=0.1)] * len(sizes), wide
                    assert min(min(sizes)) >= (44 if len(boxes) < 8 else 24)
                if question.kind == "rating":
                    assert len({y for _, y, _, _ in boxes}) == 1 and len(boxes) == question.most
                    steps = {round(b[0] - a[0], 1) for a, b in itertools.pairwise(boxes)}
                    assert max(steps) - min(steps) <= 0.11
                    assert low[0] == boxes[0][0] and low[1] >= boxes[0][1] + boxes[0][3]
                    assert high[0] + high[2] == pytest.approx(sum(boxes[-1][::2]), abs=0.1)
                    assert page.js(ENDS) == pytest.approx([low[0], high[0] + high[2]], abs=1)
                    assert page.js("document.querySelector('#keys').textContent") == "".join(
                        str(n + 1) for n in range(question.most)
                    )
                # a row or a column, none of them half full
                assert question.kind == "analogue" or 1 in (
                    len({b[0] for b in boxes}),
                    len({b[1] for b in boxes}),
                )
                last = page.box("#does") if state["line"] else max(boxes, key=lambda b: b[1])
                assert again[1] >= last[1] + last[3] + 10
                page.js("new Promise(done => setTimeout(done, 20))")  # a resize is told
        assert page.complaints() == []
        page.close()
    drawn = [json.loads(line) for line in running.layouts.read_text().splitlines()]
    seven = {d["wide"]: d["boxes"] for d in drawn if d["text"] == RATED[1].text}
    assert {320, 390, 768, 1440} <= set(seven) and drawn[-1]["trial"] == "Trial 1 of 1"
    assert all([b[0] for b in boxes] == [*"1234567r"] for boxes in seven.values())
    assert {b[3] for b in seven[320][:7]} == {44.0}


def test_a_whole_session_by_touch_in_german(browser, tmp_path):
    made = every(language="de")

    def tap(css, u=0.5):
        x, y = page.at(css, u)
        page.touch("Start", (x, y, 0.5))
        page.touch("End")

    with asked(tmp_path, made) as running:
        page, number = browser.page(running.server.url, 390, 800), 0
        page.call("Emulation.setTouchEmulationEnabled", enabled=True)
        for text in [text for text in TYPED if text != "9"]:
            state = awaited(running, page, number)
            number = state["number"]
            if state["kind"] == "analogue":
                tap("#vas", (24 + 0.62 * 330) / 378)
            elif state["kind"] == "ranking":
                for word in text.split():
                    tap(f"#words [data-key={word}]")
                assert page.js("document.querySelectorAll('#words button:enabled').length") == 0
            elif state["line"] and not (state["kind"] == "rating" and state["keys"]):
                tap("#typed")
                page.call("Input.insertText", text=text)
            else:
                tap(f"[data-key='{text or 'any'}']")
                continue
            tap("#enter")
        page.until("document.querySelector('#state').textContent.startsWith('Die Sitzung ist')")
        assert page.js("document.documentElement.lang") == "de" and page.complaints() == []
        assert page.js("document.querySelector('#told').textContent").endswith("Vielen Dank.")
        page.close()
    first, rated, *_ = read(tmp_path / FOLDER).records
    assert first.answer.values == {"softer": "red"} and first.answer.replays == 1
    assert rated.answer.values == {
        "rough": 6,
        "fine": 11,
        "much": 55,
        "nice": pytest.approx(62, abs=0.2),
        "order": ["B", "A"],
        "where": [[1.0, 2.0], [0.5, 3.0]],
    }
    assert len(running.session.records) == 4 and not running.errors
    drawn = [json.loads(line) for line in running.layouts.read_text().splitlines()]
    asked_for = [json.dumps(d["boxes"]) for d in drawn if d["text"] == "Which one was that?"]
    assert asked_for and all(a != b for a, b in itertools.pairwise(asked_for)), "what has changed"


def test_self_paced_squeezes_end_with_a_key_and_the_answer_and_then_remarks_are_asked(
    browser, tmp_path
):
    """The reference moves while the end is awaited; stimuli are there until then."""
    made = experiment(
        design=ConstantStimuli(((TASK, 4.0),)),
        timing=Timing(interval=20.0, gap=0.05, before=0.0, ramp=0.01, until="answer"),
        cursor=Cursor("x", 1.0, 1.0),
        after=(free_text("remarks", "Is there anything else?"),),
    )
    clock, point = (f"document.querySelector('#{name}')" for name in ("clock", "point"))
    with asked(tmp_path, made, "null") as running:
        page, number = browser.page(running.server.url, 900, 700), 0
        for words, text in (
            ("Trial", ""),
            ("When you", ""),
            ("Which one", "1"),
            ("Is there", "no"),
        ):
            state = awaited(running, page, number)
            number = state["number"]
            title = "" if words == "Is there" else "Trial 1 of 1"  # after the session
            assert state["text"].startswith(words) and state["trial"] == title
            if words in ("When you", "Which one"):
                page.until(f"{clock}.textContent === 'now'")
                before = page.js(f"{point}.style.transform")
                page.until(f"{point}.style.transform !== {before!r}")
            else:
                assert page.js(f"{clock}.hidden"), "nothing to feel"
            press(page, state, text)
        page.until("document.querySelector('#state').textContent.startsWith('The session is over')")
        assert page.complaints() == []
        page.close()
    assert running.errors == []
    record, after = read(tmp_path / FOLDER).records
    assert after.answer.values == {"remarks": "no"}
    for d in record.displayed:
        ((a, b),) = d["intervals"]
        assert 100 < b - a < 10_000
        assert replay(read_log(tmp_path / FOLDER / d["log"])).matches
    assert record.answer.values == {"softer": "first"} and record.answer.seconds > 0.26


def test_a_page_that_goes_to_another_session_shows_its_question(browser):
    """Its number is that of a question that the page shows from the session before."""
    said = []

    def ask(session):
        with suppress(SinkError):  # the server has ended before the answer
            said.append(face.read(Prompt(f"{session}?", {"1": f"{session} one"})))

    port = 0
    for session, token in (("Old", "A"), ("New", "B")):
        face = ExperimentPage(lambda text: None)
        with Server(face, port=port, token=token) as server:
            thread = threading.Thread(target=ask, args=(session,))
            thread.start()
            if not port:
                port, page = server.port, browser.page(server.url, 900, 700)
            page.js(f"location.hash = '{token}'")
            page.until(f"open && {TEXT} === '{session}?'")
            assert f"{session} one" in page.js("document.querySelector('#keys').textContent")
            if session == "New":
                time.sleep(0.26)
                page.key("1")
                thread.join(10)
        thread.join(10)
    assert said == ["1"]
    page.close()


def focused(page):
    return page.js(
        "(e => [e.dataset.key ?? e.id, e.ariaLabel || e.textContent])(document.activeElement)"
    )


def test_the_focus_is_at_the_question_and_goes_through_its_answers(browser, tmp_path):
    """What a screen reader and the Tab key meet."""
    task = Rate("c", ("r5", "line"), Stimulus("spring"))
    questions = (RATED[0], OTHERS[2])
    made = experiment(
        design=ConstantStimuli(((task, None),)), questions=questions, replays=1, language="en"
    )
    with asked(tmp_path, made) as running:
        page = browser.page(running.server.url, 390, 800)
        state = awaited(running, page)
        assert focused(page) == ["text", "Trial 1 of 1"]
        page.key("Tab")
        assert focused(page) == ["any", "Continueany key"]
        page.key("Enter")
        state = awaited(running, page, state["number"])
        assert focused(page) == ["text", "How rough, of 5?"]
        met = []
        for _ in range(6):
            page.key("Tab")
            met.append(focused(page)[1])
        assert met == ["1: smooth", "2", "3", "4", "5: extremely rough", "rFeel it again (1 left)"]
        page.key("3")
        state = awaited(running, page, state["number"])
        assert focused(page)[0] == "line"
        slider = "(e => [e.role, e.ariaValueText, e.ariaValueMax])(document.querySelector('#vas'))"
        assert page.js(slider) == ["slider", "not marked yet", "100"]
        page.key("Enter")  # no answer yet
        for key, value in (("ArrowLeft", 50), ("ArrowLeft", 49), ("End", 100), ("Home", 0)):
            page.key(key)
            assert page.js(slider)[1] == str(value)
        page.key("Enter")
        page.until("document.querySelector('#state').textContent.startsWith('The session is over')")
        page.close()
    assert running.session.records[0].answer.values == {"r5": 3, "line": 0.0}


MAIN = "from stimlib.__main__ import main; main()"
OWN = """
import sys
sys.path.insert(0, {tests!r})
from live.asked import every
made = every()
"""
STATE = "document.querySelector('#state').textContent"
ENABLED = "document.querySelector('#keys button:enabled') !== null"
LOST = f"{STATE} === 'The connection is lost. Please wait.'"
LATER = """(() => {
    const now = performance.now.bind(performance);
    window.Was ??= WebSocket;
    window.tries = 0;
    performance.now = () => now() + 31000;
    window.WebSocket = class extends Was { constructor(at) { super(at); tries++; } };
})()"""


def test_a_server_that_freezes_or_goes_is_told_within_two_seconds(browser, tmp_path):
    made = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0))))
    with asked(tmp_path, made) as running:
        page = browser.page(running.server.url, 390, 800)
        state = {"number": 0}
        for key in (" ", "1"):
            state = awaited(running, page, state["number"])
            press(page, state, key)
        state = awaited(running, page, state["number"])
        page.js("window.same = true")
        running.asking._loop.call_soon_threadsafe(time.sleep, 3.0)
        page.until(LOST, 2.0)
        assert not page.js(ENABLED)
        page.js(LATER.replace("31000", "6000"))
        page.until("tries > 0", 1.0)  # the network may have forgotten the connection
        page.until(f"{STATE} === 'Connected' && {ENABLED}", 3.0)
        assert page.js(TEXT) == state["text"] == "Trial 2 of 2"
    for again in (True, False):
        page.until(LOST, 2.0)
        page.js(LATER)
        page.until(f"{STATE}.startsWith('The session cannot be reached.')", 2.0)
        if again:
            page.click("#retry")
    tries = page.js("tries")
    time.sleep(1.0)
    assert page.js("tries") == tries <= 1 and page.js("!document.querySelector('#retry').hidden")
    port = running.server.port
    with asked(tmp_path, made, resume=True, port=port, token="another") as running:
        page.go(running.server.url)  # in the same tab: only what follows # is new
        state = awaited(running, page)
        assert page.js("same") and page.js(STATE) == "Connected"
        assert state["told"] == ["The session goes on where it stopped."]
        press(page, state, " ")
        press(page, awaited(running, page, state["number"]), "2")
        page.until(f"{STATE}.startsWith('The session is over')")
        page.close()
    records = read(tmp_path / FOLDER).records
    assert [r.answer.values["softer"] for r in records] == ["first", "second"]


@contextmanager
def begun(data):
    """The command as a process of its own, and the address that it prints."""
    (data / "own.py").write_text(OWN.format(tests=str(Path(__file__).parents[1])))
    words = ["experiment", "run", f"{data}/own.py:made", "--participant", "P01"]
    words += ["--data", str(data), "--sink", "offline", "--page"]
    whole = [sys.executable, "-c", MAIN, *words]
    with subprocess.Popen(whole, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process, next(line for line in process.stdout if "answers at" in line).split()[-1]
        finally:
            process.kill()


@pytest.mark.stress
def test_a_process_that_freezes_or_is_killed_is_told_within_two_seconds(browser, tmp_path):
    with begun(tmp_path) as (server, url):
        page = browser.page(url, 390, 800)
        page.until(f"{TEXT}.startsWith('Get to know') && {ENABLED}")
        for _ in range(3):
            server.send_signal(signal.SIGSTOP)
            page.until(LOST, 2.0)
            assert not page.js(ENABLED)
            server.send_signal(signal.SIGCONT)
            page.until(f"{STATE} === 'Connected' && {ENABLED}", 2.0)
        server.kill()
        page.until(LOST, 2.0)
        page.close()
