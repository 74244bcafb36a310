"""A session's page in a real browser: all of it by keyboard, with a reload and lost
connections; touch, mouse, looks.
"""

import time
from contextlib import contextmanager

import pytest
from experiments.some import TASK, experiment
from live.asked import ANSWERS, FOLDER, TYPED, asked, every, silent
from waiting import until

from stimlib.experiments import (
    ConstantStimuli,
    Cursor,
    Rate,
    Stimulus,
    Timing,
    analogue,
    choice,
    rating,
    read,
)

pytestmark = pytest.mark.xdist_group("browser")
STATE = "document.querySelector('#state').textContent"
TEXT = "document.querySelector('#text').textContent"
TOLD = "document.querySelector('#told').textContent"


@contextmanager
def opened(browser, data, made, sink="offline", wide=390, high=800):
    """A session, and its page, of which nothing complains."""
    with asked(data, made, sink) as running:
        page = browser.page(running.server.url, wide, high)
        yield running, page
        assert page.complaints() == []
        page.close()


def awaited(running, page, known=0):
    """The number of the next prompt, once the page shows it and takes keys."""

    def asks():
        now = running.asking._now()
        assert running.thread.is_alive() and now["phase"] != "end", (now, running.errors)
        return now["phase"] == "ask" and now["number"] > known

    until(asks)
    state = running.asking._now()
    enabled = "document.querySelector('#keys button:enabled, #typed:enabled') !== null"
    page.until(f"{TEXT} === {state['text']!r} && {enabled}")
    trial = state["trial"] if state["trial"] != state["text"] else ""
    assert page.js("document.querySelector('#trial').textContent") == trial
    time.sleep(0.26)  # a page takes no key of the question before
    return state


def lose(running, code=1012):
    """The connection, as a network does: the page finds the server again."""
    (old,) = running.asking.pages
    running.asking._loop.call_soon_threadsafe(old.close, code, "")
    until(lambda: running.asking.pages not in ([], [old]))


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


def over(page):
    page.until(f"{STATE}.startsWith('The session is over')")


def test_a_whole_session_by_keyboard_with_a_reload_and_lost_connections(browser, tmp_path):
    made = every(timing=Timing(interval=0.5, gap=0.05, before=0.0, ramp=0.0))
    answers, number, lost = [text for text in TYPED if text != "9"], 0, False
    with opened(browser, tmp_path, made, "null", 900, 700) as (running, page):
        while answers:
            state = awaited(running, page, number)
            if len(answers) in (10, 4):  # in the middle of questions: a line, a key
                page.reload() if len(answers) == 10 else lose(running)
                page.until(f"{STATE} === 'Connected'")
                assert awaited(running, page, number)["number"] == state["number"]
            if again := state["text"] == "Once more":
                assert not lost and "connection was lost" in page.js(TOLD)
            lost, number = lost or again, state["number"]
            press(page, state, "" if again else answers.pop(0))
            if len(answers) == 1 and not lost:  # in the middle of a stimulus
                until(lambda: running.asking._state["phase"] == "feel")
                lose(running, 4429)  # as too many messages, such as of a held key
        over(page)
    assert running.errors == [] and lost
    records = read(tmp_path / FOLDER).records
    assert [r.answer.values for r in records] == ANSWERS
    assert [r.answer.replays for r in records] == [1, 0, 0, 0]
    missed = [[d.get("missed", False) for d in r.displayed] for r in records]
    assert missed == [[False] * 2, [False], [False], [True, False]]


def test_touch_double_clicks_held_keys_and_a_second_page(browser, tmp_path):
    made = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0), (TASK, 2.0))))
    with opened(browser, tmp_path, made) as (running, page):
        state = awaited(running, page)
        page.js(
            """new MutationObserver(() => document.querySelector('#keys button')?.click())
            .observe(document.querySelector('#keys'), {childList: true})"""
        )  # a double click: each new question gets one
        page.click("#keys button")
        state = awaited(running, page, state["number"])
        assert state["text"] == "Which one was softer?" and not running.session.records
        page.touch("Start", (*page.at("#keys button:nth-child(2)"), 0.5))
        page.touch("End")
        state, key = awaited(running, page, state["number"]), {"key": "2", "code": "Digit2"}
        page.call("Input.dispatchKeyEvent", type="keyDown", text="2", **key)
        state = awaited(running, page, state["number"])
        for _ in range(5):
            page.call("Input.dispatchKeyEvent", type="keyDown", text="2", autoRepeat=True, **key)
        page.call("Input.dispatchKeyEvent", type="keyUp", **key)
        assert len(running.session.records) == 1
        other = browser.page(running.server.url, 390, 800)
        page.until(f"{STATE}.includes('open on another page')")
        assert page.js("document.querySelector('#keys button').disabled")
        assert awaited(running, other)["number"] == state["number"]
        for key in ("1", " ", "2"):
            other.key(key)
            state = awaited(running, other, state["number"]) if key != "2" else state
        over(other)
        assert other.complaints() == []
        other.close()
    answers = [r.answer.values["softer"] for r in running.session.records]
    assert answers == ["second", "first", "second"]


HTML = "<img src=x onerror='complain()'>\"&amp;" + 300 * "W"
# which one was softer? with joiners that it is spelled with
PERSIAN = "کدام\u200cیک نرم\u200cتر بود؟"


def test_any_text_is_shown_as_it_was_written_from_the_side_where_it_begins(browser, tmp_path):
    made = experiment(
        design=ConstantStimuli(((TASK, 4.0),)),
        questions=(choice("softer", PERSIAN, "first", "second"),),
        instructions=HTML,
        language="de",
    )
    with opened(browser, tmp_path, made, wide=320) as (running, page):
        state = awaited(running, page)
        assert page.js(TOLD) == HTML and page.js("document.images.length") == 0
        assert page.js("document.documentElement.scrollWidth") <= 320
        assert page.js("document.documentElement.lang") == "de"
        press(page, state, "")
        awaited(running, page, state["number"])
        assert page.js(TEXT) == PERSIAN
        begins = """(() => { const r = document.createRange();
            const t = document.querySelector('#text').firstChild;
            r.setStart(t, 0), r.setEnd(t, 1); return r.getBoundingClientRect().right; })()"""
        assert page.js(begins) > 280


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
    with opened(browser, tmp_path, made, "null", 600, 700) as (running, page):
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
    felt = {clock: [] for _, clock, _ in seen}
    for text, clock, y in seen:
        felt[clock] += [y] * (text == "Feel")
    assert not any(felt[""])
    for which in ("1 of 2", "2 of 2"):  # up, by sin(0.6 pi) at most
        assert max(felt[which]) <= 0 and -130 < min(felt[which]) < -60
    rest = [clock for text, clock, _ in seen if text == "Please rest"]
    # 0:00: the server was late; a busy page skips some
    assert {"0:02"} <= set(rest) <= {"0:03", "0:02", "0:01", "0:00"}
    assert rest == sorted(rest, reverse=True)  # loaded again, it is no longer


def focused(page):
    return page.js(
        "(e => [e.dataset.key ?? e.id, e.ariaLabel || e.textContent])(document.activeElement)"
    )


def test_the_focus_is_at_the_question_and_goes_through_its_answers(browser, tmp_path):
    """What a screen reader and the Tab key meet."""
    questions = (
        rating("r5", "How rough?", "smooth", "rough", 5),
        analogue("line", "How nice?", "not", "very"),
    )
    design = ConstantStimuli(((Rate("c", ("r5", "line"), Stimulus("spring")), None),))
    made = experiment(design=design, questions=questions, replays=1)
    with opened(browser, tmp_path, made) as (running, page):
        state = awaited(running, page)
        assert focused(page) == ["text", "Trial 1 of 1"]
        page.key("Tab")
        assert focused(page) == ["any", "Continueany key"]
        page.key("Enter")
        state = awaited(running, page, state["number"])
        assert focused(page) == ["text", "How rough?"]
        for met in ("1: smooth", "2", "3", "4", "5: rough", "rFeel it again (1 left)"):
            page.key("Tab")
            assert focused(page)[1] == met
        page.key("3")
        awaited(running, page, state["number"])
        assert focused(page)[0] == "line"
        slider = "(e => [e.role, e.ariaValueText, e.ariaValueMax])(document.querySelector('#vas'))"
        assert page.js(slider) == ["slider", "not marked yet", "100"]
        page.key("Enter")  # no answer yet
        for key, value in (("ArrowLeft", 50), ("ArrowLeft", 49), ("End", 100), ("Home", 0)):
            page.key(key)
            assert page.js(slider)[1] == str(value)
        page.key("Enter")
        over(page)
    assert running.session.records[0].answer.values == {"r5": 3, "line": 0.0}


ENABLED = "document.querySelector('#keys button:enabled') !== null"
LOST = f"{STATE} === 'The connection is lost. Please wait.'"
LATER = """(() => {
    const now = performance.now.bind(performance);
    window.Was ??= WebSocket;
    window.tries = 0;
    performance.now = () => now() + 31000;
    window.WebSocket = class extends Was { constructor(at) { super(at); tries++; } };
})()"""


def test_a_server_that_freezes_or_goes_is_told_and_found_again(browser, tmp_path):
    made = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0))))
    with asked(tmp_path, made) as running:
        page, state = browser.page(running.server.url, 390, 800), {"number": 0}
        for key in (" ", "1"):
            state = awaited(running, page, state["number"])
            press(page, state, key)
        state = awaited(running, page, state["number"])
        page.js("window.same = true")
        with silent(running):
            page.until(LOST)
            assert not page.js(ENABLED)
            page.js(LATER.replace("31000", "6000"))
            page.until("tries > 0")  # the network may have forgotten the connection
        page.until(f"{STATE} === 'Connected' && {ENABLED}")
        assert page.js(TEXT) == state["text"] == "Trial 2 of 2"
    for again in (True, False):
        page.until(LOST)
        page.js(LATER)
        page.until(f"{STATE}.startsWith('The session cannot be reached.')")
        if again:
            page.click("#retry")
    tries = page.js("new Promise(done => setTimeout(() => done(tries), 1000))")
    assert tries <= 1 and page.js("!document.querySelector('#retry').hidden")
    with asked(tmp_path, made, resume=True, port=running.server.port, token="another") as running:
        page.go(running.server.url)  # in the same tab: only what follows # is new
        state = awaited(running, page)
        assert page.js("same") and page.js(STATE) == "Connected"
        assert state["told"] == ["The session goes on where it stopped."]
        press(page, state, " ")
        state = awaited(running, page, state["number"])
        with silent(running):
            press(page, state, "2")  # which waits
            page.until(LOST)
            page.js("new Promise(done => setTimeout(done, 600))")
            assert page.js(LOST)
        over(page)
        page.close()
    records = read(tmp_path / FOLDER).records
    assert [r.answer.values["softer"] for r in records] == ["first", "second"]


BORDERS = """[...document.querySelectorAll('#keys button')]
    .map(b => (s => s.borderColor + s.cursor + s.outlineStyle)(getComputedStyle(b)))"""
UNDER = "document.querySelector('#keys button:hover')?.dataset.key"


def test_no_answer_looks_chosen_where_the_pointer_rests(browser, tmp_path):
    rough = rating("rough", "How rough?", "smooth", "rough", 7)
    fine = rating("fine", "How fine?", "coarse", "fine", 7)
    task = Rate("c", ("rough", "fine"), Stimulus("spring"))
    made = experiment(design=ConstantStimuli(((task, None),)), questions=(rough, fine))
    with opened(browser, tmp_path, made, wide=1440, high=900) as (running, page):
        state = awaited(running, page)
        x, y = page.at("#keys button")
        for kind in ("Moved", "Pressed", "Released"):
            page.mouse(kind, x, y)
        for question in ("rough", "fine"):  # at the second, on the answer just given
            state = awaited(running, page, state["number"])
            page.until(f"{UNDER} === '4'")
            assert len(set(page.js(BORDERS))) == 1
            if question == "rough":
                y = page.at("#keys button")[1]
                page.mouse("Moved", x + 1, y)
                page.until(f"new Set({BORDERS}).size === 2")  # it has moved: it may be seen
                page.mouse("Pressed", x + 1, y)
                page.mouse("Released", x + 1, y)
        page.key("5")
        over(page)
        assert page.js(TEXT) == "That was the last one. Thank you." and page.js(TOLD) == ""
    assert running.session.records[0].answer.values == {"rough": 4, "fine": 5}


ABOVE = """(box => box('footer').bottom <= box('#trial').top)
    (e => document.querySelector(e).getBoundingClientRect())"""


def test_a_page_that_was_replaced_takes_the_session_back_and_covers_no_trial(browser, tmp_path):
    made = experiment(design=ConstantStimuli(((TASK, 4.0),)))
    with opened(browser, tmp_path, made) as (running, page):
        state = awaited(running, page)
        press(page, state, " ")
        state = awaited(running, page, state["number"])
        other = browser.page(running.server.url, 390, 800)
        page.until(f"{STATE} === 'The session is open on another page.'")
        assert page.js(ABOVE)
        page.click("#retry")
        other.until(f"{STATE} === 'The session is open on another page.'")
        other.close()
        page.until(f"{STATE} === 'Connected'")
        press(page, awaited(running, page), "2")
        over(page)
    assert running.session.records[0].answer.values == {"softer": "second"}
