"""A session's page in a real browser: all of it by keyboard, with a reload and lost
connections; touch, mouse, looks.
"""

import io
import time
from pathlib import Path

import pytest

pytest.importorskip("uvicorn")
from experiments.some import TASK, experiment
from live.asked import TYPED, asked, every
from live.chromium import Browser, where

from stimlib.cli import terminal
from stimlib.experiments.designs import ConstantStimuli
from stimlib.experiments.experiment import Cursor, Timing
from stimlib.experiments.questions import choice
from stimlib.experiments.reader import read
from stimlib.experiments.runner import run
from stimlib.experiments.session import Session

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


def lose(running):
    """The connection, as a network does: the page finds the server again."""
    running.asking._loop.call_soon_threadsafe(running.asking.pages[-1].close, 1012, "")


def press(page, state, text):
    if state["kind"] == "rating" and state["keys"]:
        for key in text[: len(text) * state["line"]]:
            page.key(key)  # no field has the focus before
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
            if len(answers) in (9, 4):  # in the middle of questions: a line, a key
                page.reload() if len(answers) == 9 else lose(running)
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
                lose(running)
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
        page.until(
            "document.querySelector('#state').textContent.includes('opened on another page')"
        )
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
        for text in ("", "r", "1", "", "6", "55", "B A"):
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
                assert w >= 44 and h >= 44  # CSS pixels, which a finger hits
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
