"""The pages in Chromium and Firefox, driven by Playwright: a session by keyboard and by
touch, sizes of answers, a stimulus that is only seen, a shared page, and what axe-core
finds.
"""

import json
import shutil
import subprocess
import sys
import time
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="make .venv/browsers installs it")
pytest.importorskip("uvicorn")
from experiments.some import TASK, experiment
from live.asked import TYPED, asked, every
from live.chromium import where
from live.drawn import outputs_of, seen
from live.shared import need_compiler
from playwright.sync_api import Error, sync_playwright

from stimlib.experiments import ConstantStimuli, Rate, Stimulus, Timing, rating, read
from stimlib.live.share import share
from stimlib.motion import parse_motion
from stimlib.scenes import ROWS, SHIPPED

pytestmark = [pytest.mark.stress, pytest.mark.xdist_group("browsers")]
ROOT = Path(__file__).parents[2]
AXE = files("axe_playwright_python").joinpath("axe.min.js").read_text()
SCENES = "squeeze", "bumps", "soft_surface", "texture"
# Firefox by WebDriver BiDi, which takes no emulated media
PLAIN = dict.fromkeys(("color_scheme", "reduced_motion", "forced_colors", "contrast"), "null")


@pytest.fixture(scope="module", params=["chromium", "firefox"])
def browser(request):
    firefox = request.param == "firefox"
    path = shutil.which("firefox") or shutil.which("firefox-esr") if firefox else where()
    if path is None:
        pytest.skip(f"{request.param} is not installed: tests/devices/install.sh installs it")
    more = {"channel": "moz-firefox"} if firefox else {"args": ["--no-sandbox"]}
    with sync_playwright() as playwright:
        try:
            made = getattr(playwright, request.param).launch(executable_path=path, **more)
        except Error as e:
            if "unknown command" not in str(e):
                raise
            own = subprocess.check_output([path, "--version"], text=True).strip()
            what = f"Playwright {version('playwright')} asks what {own} does not know"
            pytest.skip(f"{what} ({str(e).splitlines()[0]}): put a later firefox on the PATH")
        yield made
        made.close()


@pytest.fixture
def opened(browser):
    """Opens a page of a width; what its console was told of errors is checked."""
    contexts, complaints = [], []

    def open_(url, wide=1240, high=900, **more):
        context = browser.new_context(viewport={"width": wide, "height": high}, **PLAIN, **more)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda e: complaints.append(str(e)))
        page.goto(url)
        return page

    yield open_
    for context in contexts:
        context.close()
    assert complaints == []


def serious(page):
    """What axe-core calls serious or critical: rule and elements."""
    page.evaluate(AXE)
    found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
    return [
        (v["id"], [n["html"][:120] for n in v["nodes"]])
        for v in found
        if v["impact"] in ("serious", "critical")
    ]


def prompted(running, page, known=0):
    """The next prompt, once the page takes its answer."""
    end = time.monotonic() + 60
    while (state := running.asking._now())["phase"] != "ask" or state["number"] <= known:
        assert running.thread.is_alive() and time.monotonic() < end, (state, running.errors)
        page.wait_for_timeout(10)
    page.wait_for_function(
        "([text]) => document.querySelector('#text').textContent === text"
        " && document.querySelector('#keys button:enabled, #typed:enabled')",
        arg=[state["text"]],
    )
    page.wait_for_timeout(300)  # a key that is pressed sooner was meant for what was before
    return state


def press(page, state, text):
    """The keys of an answer, where no field has the focus before."""
    keys = page.keyboard
    if state["kind"] == "rating" and state["keys"]:
        for key in text[: len(text) * state["line"]]:
            keys.press(key)
    elif state["kind"] == "analogue":
        steps = int(text) - 50  # where the first key puts it
        for key in ["PageUp"] * (1 + steps // 10) + ["ArrowRight"] * (steps % 10):
            keys.press(key)
    elif state["line"]:
        keys.insert_text(text)
    keys.press("Enter" if state["line"] else text or " ")


def over(page):
    page.wait_for_function(
        "() => document.querySelector('#state').textContent.startsWith('The session is over')"
    )


def test_a_whole_session_by_keyboard_alone(opened, tmp_path):
    made = every(timing=Timing(interval=0.2, gap=0.05, before=0.0, ramp=0.0))
    answers, number = [text for text in TYPED if text != "9"], 0
    with asked(tmp_path, made) as running:
        page = opened(running.server.url, 900, 700)
        for text in answers:
            state = prompted(running, page, number)
            number = state["number"]
            assert serious(page) == [], state["text"]
            press(page, state, text)
        over(page)
    assert running.errors == []
    recorded = [r.answer.values for r in read(tmp_path / "pair/P01-s1").records]
    places = [[1.0, 2.0], [0.5, 3.0]]
    rated = {"rough": 6, "fine": 11, "much": 55, "nice": 62, "order": ["B", "A"], "where": places}
    assert recorded[1] == rated
    assert [r["softer"] for r in (recorded[0], *recorded[2:])] == ["red", "green", "red"]


def test_a_whole_session_by_touch_at_390_pixels(opened, browser, tmp_path):
    if browser.browser_type.name == "firefox":
        pytest.skip("Firefox takes no touch by WebDriver BiDi from Playwright")
    made, number = experiment(design=ConstantStimuli(((TASK, 4.0), (TASK, 1.0), (TASK, 2.0)))), 0
    taps = ["1", "2", "1", "1", "1", "2"]  # begin, an answer; each after the other
    with asked(tmp_path, made) as running:
        page = opened(running.server.url, 390, 844, has_touch=True)
        for text in taps:
            state = prompted(running, page, number)
            number = state["number"]
            assert serious(page) == []
            key = page.locator("#keys button").nth(int(text) - 1)
            key.tap()
        over(page)
    assert [r.answer.values["softer"] for r in running.session.records] == [
        "second",
        "first",
        "second",
    ]


@pytest.mark.parametrize("wide", [320, 390, 768, 1440])
@pytest.mark.parametrize("points", [5, 7, 9, 11])
def test_a_rating_is_one_row_of_equal_buttons(opened, tmp_path, points, wide):
    scale = rating("rough", "How rough?", "smooth", "coarse", points)
    made = every(
        design=ConstantStimuli(
            ((Rate("rated", ("rough",), Stimulus("spring", {"k": 1.0})), None),)
        ),
        questions=(scale,),
        familiarisation={},
        feedback=False,
    )
    with asked(tmp_path, made) as running:
        page = opened(running.server.url, wide, 800)
        state = prompted(running, page)
        page.keyboard.press(" ")
        state = prompted(running, page, state["number"])
        boxes = [key.bounding_box() for key in page.locator("#keys button").all()]
        boxes = boxes[:points]
        assert len(boxes) == len(state["keys"][:points]) == points
        for side in ("y", "width", "height"):
            assert max(b[side] for b in boxes) - min(b[side] for b in boxes) < 1, side
        steps = [b["x"] - a["x"] for a, b in zip(boxes, boxes[1:], strict=False)]
        assert max(steps) - min(steps) < 1 and min(steps) >= boxes[0]["width"] - 0.5
        assert boxes[0]["x"] >= 0 and boxes[-1]["x"] + boxes[-1]["width"] <= wide


BLUE = """() => {
    const c = document.querySelector('#picture');
    const { data } = c.getContext('2d').getImageData(0, 0, c.width, c.height);
    let n = 0;
    for (let k = 0; k < data.length; k += 4) n += data[k + 2] - data[k] > 100;
    return n > 100;
}"""


@pytest.mark.parametrize("wide", [390, 1440])
def test_a_stimulus_that_is_only_seen_follows_the_pointer(opened, tmp_path, wide):
    with asked(tmp_path, seen(4.0), "page") as running:
        page = opened(running.server.url, wide, 844)
        state = prompted(running, page)
        page.keyboard.press(" ")
        page.wait_for_function("() => document.querySelector('#clock').textContent === '1 of 2'")
        assert serious(page) == []
        assert page.evaluate("document.documentElement.scrollWidth") <= wide
        box = page.locator("#picture").bounding_box()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.6 * box["height"])
        page.mouse.down()
        page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"], steps=5)
        page.wait_for_function(BLUE)  # the avatar
        page.mouse.up()
        state = prompted(running, page, state["number"])
        press(page, state, "1")
        over(page)
    assert running.session.records[0].answer.values == {"softer": "first"}
    told = [json.loads(line) for line in running.layouts.read_text().splitlines()]
    assert sum(len(line.get("samples", ())) for line in told) > 50
    _, motion = outputs_of(tmp_path / "pair/P01-s1/trial-0001-1.stimlog")
    assert motion["press"].max() == pytest.approx(0.5, abs=0.01)  # a mouse's


def assert_all_can_use_it(page):
    """Nothing that axe-core calls serious, and nothing beside the screen."""
    for width in (390, 1440):
        page.set_viewport_size({"width": width, "height": 900})
        assert serious(page) == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("scene", SCENES)
def test_axe_finds_nothing_serious_on_the_live_page(opened, tmp_path, scene):
    words = [sys.executable, "-m", "stimlib", "live", scene, "--no-browser"]
    quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(words, cwd=tmp_path, text=True, **quiet) as server:
        try:
            page = opened(server.stdout.readline().strip())
            run = "() => document.querySelector('#run')"
            page.wait_for_function(f"{run}.disabled === false", timeout=60_000)
            page.click("#run")
            page.wait_for_function(f"{run}.textContent === 'Stop'")
            assert_all_can_use_it(page)
        finally:
            server.kill()


def test_a_shared_page_computes_the_same_in_both_browsers_and_all_can_use_it(opened, tmp_path):
    need_compiler()
    path = tmp_path / "squeeze.html"
    motion = {i: parse_motion(m) for i, m in ROWS["squeeze"].drive.items()}
    made = share(SHIPPED["squeeze"](), 8000, path, motion, 7.0)
    assert made.samples * 2 >= 1e5
    page = opened(path.as_uri())
    page.wait_for_selector("#checked.good, #checked.bad", timeout=60_000)
    found = page.evaluate("scene.checked")
    assert found["same"] and found["sha256"] == made.sha256
    assert_all_can_use_it(page)


def test_axe_finds_nothing_serious_in_a_report(opened, tmp_path):
    motion = ["--motion", "minimum_jerk()"]
    for words in (
        ["render", "squeeze", *motion, "--out", "s.wav"],
        ["verify", "squeeze", *motion, "--wav", "s.wav", "--report", "s.html"],
    ):
        subprocess.check_output([sys.executable, "-m", "stimlib", *words], cwd=tmp_path)
    assert_all_can_use_it(opened((tmp_path / "s.html").as_uri()))


def test_axe_finds_nothing_serious_in_the_documentation(opened, browser):
    if not (pages := sorted((ROOT / "docs" / "_build").glob("**/*.html"))):
        pytest.skip("the pages are not built: make docs")
    if browser.browser_type.name == "firefox":
        pytest.skip("once is enough: the pages have no script of their own")
    page, found = opened("about:blank"), {}
    for path in pages:
        page.goto(path.as_uri())
        found[str(path.relative_to(ROOT))] = serious(page)
    assert not {path: wrong for path, wrong in found.items() if wrong}
