"""The page in a real browser: what a hand does reaches the processor, what comes back
is drawn and heard, and all can use it.
"""

import signal
import subprocess
import sys
import time
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest
import waiting
from live.chromium import Page
from live.drawn import level
from scipy.signal import welch

from stimlib import Input, Param, Scene, constant
from stimlib.blocks import oscillator
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import delivered
from stimlib.live.server import Server
from stimlib.live.stream import Stream
from stimlib.run.safety import Passivity, Safety
from stimlib.soft import surface

pytestmark = pytest.mark.xdist_group("browser")
FS, TOKEN, WIDE = 8000, "T" * 32, 0.1  # Hz; m that the field is wide
LOOKS = Path(__file__).with_name("looks.js").read_text()
READY = "document.querySelector('#run')?.disabled === false"
RUNS = f"{READY} && document.querySelector('#run').textContent === 'Stop'"


def springs(stiffness=2000.0):
    """A spring under each of two fingers, and a tone."""
    x1, x2 = Input("x1", "m"), Input("x2", "m")
    k = Param("k", stiffness, "N/m")
    tone = constant(1.0, "V") * oscillator(constant(158.0, "Hz"))
    return Scene({"force1": k * x1, "force2": k * x2, "tone": tone})


class Site:
    """One server at one address, and a browser."""

    def __init__(self, folder, browser):
        self.folder, self.port, self.browser, self.marked = folder, 0, browser, []
        full = Safety({"force1": 500.0, "force2": 500.0, "tone": 2.0})
        self.serve(
            Stream(springs(), FS, full, title="Springs", folder=folder, send=[self.marked.append])
        )

    def serve(self, stream):
        stream.warm_up()
        self.server = Server(stream, port=self.port, token=TOKEN).start()
        self.port = self.server.port

    def open(self):
        page = self.browser.page(self.server.url)
        page.until("!document.querySelector('#state').textContent.startsWith('Connecting')")
        page.js(LOOKS)
        return page


@pytest.fixture(scope="module")
def site(tmp_path_factory, browser):
    made = Site(tmp_path_factory.mktemp("recordings"), browser)
    yield made
    made.server.close()


@pytest.fixture(scope="module")
def first(site):
    """The page that the tests share."""
    return site.open()


@pytest.fixture
def page(first):
    """It runs, and is in front: a page behind another draws nothing."""
    first.call("Page.bringToFront")
    first.until(READY)
    if not first.js(RUNS):
        first.js("document.querySelector('#run').click()")
    first.until(RUNS)
    return first


def live(page: Page, expression: str):
    """A value of what the page knows."""
    return page.js(f"import('./live.js').then(({{live}}) => {expression})")


def until(page: Page, expression: str):
    return page.until(f"import('./live.js').then(({{live}}) => {expression})")


def place(page: Page, u: float, v: float) -> tuple[float, float]:
    """Where in the window a place of the field is, of 0 to 1 from its lower left
    corner.
    """
    page.js("document.querySelector('#field').scrollIntoView({block: 'center'})")
    (x, y, *_), box = page.box("#field"), live(page, "live.field.box")
    # within its border
    return x + 1 + box["x"] + u * box["w"], y + 1 + box["y"] + (1 - v) * box["h"]


def press(page: Page, u: float, v: float, pointer: str = "mouse", force: float = 0.0) -> None:
    page.mouse("Pressed", *place(page, u, v), pointer, force)
    page.mouse("Moved", *place(page, u, v), pointer, force)


def move(page: Page, u: float, v: float) -> None:
    """Until the finger is there: while a page still takes its shape, a place of the
    field moves in the window.
    """

    def there() -> bool:
        page.mouse("Moved", *place(page, u, v))
        return abs(live(page, "live.field.fingers.get(0)?.u ?? 0") - u) < 0.01

    waiting.until(there)


def release(page: Page, u: float = 0.0, pointer: str = "mouse") -> None:
    page.mouse("Released", *place(page, u, 0.5), pointer)


def choose(page: Page, css: str, value: str) -> None:
    """A value is chosen, or typed."""
    page.js(
        f"(s => {{ s.value = {value!r}; s.dispatchEvent(new Event('change'));"
        f" }})(document.querySelector({css!r}))"
    )


SECOND = "#sources fieldset:nth-child(2)"  # what drives x2


def test_an_edit_is_felt_at_once_and_a_mistake_is_shown(site, page):
    """The finger stays where it is, and so do sound and session."""
    stream = site.server.stream
    press(page, 0.2, 0.5)
    move(page, 0.5, 0.5)
    until(page, "Math.abs(live.outputs.force1 - 100) < 1")
    stream.tell_error("springs.py:3: what is k?")
    page.until("document.querySelector('#note').textContent === 'springs.py:3: what is k?'")
    level = Param("level", 0.5) * springs(4000.0).outputs["tone"]
    stream.reload(Scene(springs(4000.0).outputs | {"tone": level}))
    until(page, "Math.abs(live.outputs.force1 - 200) < 1")
    page.until("document.querySelector('#note').hidden")  # the samples may come first
    assert page.js(RUNS)
    sliders = page.js("[...document.querySelectorAll('#params input[type=range]')].length")
    assert sliders == 2 and live(page, "live.state.params.level") == 0.5
    # of the scene before no picture stays
    assert page.js("document.querySelectorAll('.plot').length") == live(page, "live.panels.length")
    stream.reload(springs())
    until(page, "Math.abs(live.outputs.force1 - 100) < 1")
    release(page, 0.5)


def test_a_pointer_reaches_the_processor_and_the_curves(page):
    press(page, 0.2, 0.5)
    move(page, 0.6, 0.5)
    until(page, "Math.abs(live.outputs.force1 - 120) < 1")
    assert live(page, "live.history.newest(0)") == pytest.approx(0.6 * WIDE, abs=5e-4)
    # the curve ends level
    until(page, "live.history.last(2, 2048)?.every(v => Math.abs(v - 120) < 1)")
    curve = page.until("looks.curve('force1', 120).then(c => c.blue.length && c)")
    assert max(abs(row - curve["at"]) for row in curve["blue"]) <= 2
    page.until("document.querySelector('#outputs output').textContent.startsWith('120')")
    release(page)
    assert page.complaints() == []


def test_a_slider_changes_the_force_and_a_reset_brings_it_back(page):
    press(page, 0.5, 0.5)
    release(page, 0.5)

    def slid():
        """Again where the page moved meanwhile."""
        page.click("#params input[type=range]")
        value = page.js("+document.querySelector('#params input[type=range]').value")
        return value != 2000 and value

    slid = waiting.until(slid)
    until(page, f"Math.abs(live.outputs.force1 - {slid} * {WIDE / 2}) < 1")
    page.click("#params button")
    until(page, f"Math.abs(live.outputs.force1 - 2000 * {WIDE / 2}) < 1")
    for text, k in (("1e9", 5000), ("2500,5", 2500.5)):  # beyond the range: its end
        choose(page, "#params input", text)
        until(page, f"Math.abs(live.outputs.force1 - {k} * {WIDE / 2}) < 1")
    for text in ("1,250", "2600 N", ""):  # the first is 1.25 or 1250
        choose(page, "#params input", text)
        assert page.js("document.querySelector('#params input').matches(':invalid')")
    assert page.js("document.querySelector('#params [type=range]').ariaValueText") == "2500.5 N/m"
    page.click("#params button")


def test_two_fingers_a_pen_and_a_sine_drive_what_they_are_given(page):
    choose(page, f"{SECOND} .numbers select", "1")
    until(page, "live.state.sources.x2.finger === 1")
    page.touch("Start", (*place(page, 0.25, 0.5), 0.5), (*place(page, 0.75, 0.5), 0.5))
    until(page, "Math.abs(live.outputs.force1 - 50) < 1 && Math.abs(live.outputs.force2 - 150) < 1")
    page.touch("End")
    choose(page, f"{SECOND} select", "pressure")
    choose(page, f"{SECOND} .numbers select", "0")
    until(page, "live.state.sources.x2.from === 'pressure' && live.state.sources.x2.finger === 0")
    press(page, 0.5, 0.5, "pen", 0.4)
    until(page, "Math.abs(live.outputs.force2 - 0.4 * 200) < 1")
    release(page, pointer="pen")
    until(page, "Math.abs(live.outputs.force2) < 1")
    choose(page, f"{SECOND} select", "sine")
    choose(page, f"{SECOND} input[aria-label*=frequency]", "4")
    until(page, "live.state.sources.x2.freq === 4 && live.outputs.force2 > 198")
    choose(page, f"{SECOND} select", "u")


def test_keys_move_the_finger_mark_start_stop_and_record(page, site):
    assert page.js("document.querySelector('#keys').innerText").endswith("R records, M marks.")
    page.js("document.activeElement.blur()")
    press(page, 0.5, 0.5)
    release(page, 0.5)
    until(page, "live.field.fingers.get(0).on === 0")
    before = live(page, "live.field.fingers.get(0).u")
    page.key("ArrowRight", 0.1)
    right = live(page, "live.field.fingers.get(0)")
    assert right["on"] == 1 and right["u"] > before + 0.005
    page.key("ArrowLeft", 0.1)
    until(page, f"live.field.fingers.get(0).u < {right['u']}")
    tapped = """(f => {
      f.key({ key: "ArrowLeft" }, true);
      const { u } = f.fingers.get(0);
      f.tick(performance.now() - 1e3); // a frame that began before the key came
      f.key({ key: "ArrowLeft" }, false);
      return f.fingers.get(0).u - u;
    })(live.field)"""
    assert live(page, tapped) == 0
    page.key("Enter")
    assert live(page, "live.field.fingers.get(0).on") == 0
    page.key("m")
    assert [m.name for m in waiting.until(lambda: site.marked)] == ["page"]
    for key, phase in ((" ", "idle"), ("r", "running"), (" ", "idle")):
        page.key(key)
        until(page, f"live.state.phase === '{phase}'")
    said = page.js("document.querySelector('#log').textContent")
    assert said.startswith("Recorded 0.")
    assert page.js("document.querySelector('#clock').textContent") == f"{said.split()[1]} s"
    page.js("document.querySelector('#window').focus()")
    page.key("r")  # typed into a choice: no recording
    page.key("Tab")
    # the focus is seen
    assert page.js("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    assert live(page, "live.state.phase") == "idle"
    page.js("document.querySelector('#driven summary').focus()")
    page.key("Enter")  # shuts it, and puts no finger down
    assert live(page, "[live.field.fingers.get(0).on, document.querySelector('#driven').open]") == [
        0,
        False,
    ]
    page.key("Enter")
    page.js("document.activeElement.blur()")


def test_what_is_heard_is_what_was_made(page):
    choose(page, "#heard", "2")
    page.click("#record")
    until(page, "live.state.phase === 'running' && live.state.log !== null")
    log = live(page, "live.state.log")
    page.click("#sound")
    until(page, "live.sound.node && live.sound.context.state === 'running'")
    page.js("looks.listen()")
    want = 0.5 / np.sqrt(2)  # 1 V of 2 V, far above 40 Hz
    # once whole, whatever else the machine does
    page.until(f"Math.abs(looks.rms() / {want} - 1) < 0.02")
    page.click("#sound")
    page.click("#record")
    until(page, "live.state.phase === 'idle'")
    again = np.concatenate([y for _, y, given in delivered(read_log(log), 8192) if given])
    heard = again[1000:-1000, 2]  # without the fades
    assert np.sqrt(np.mean(heard**2)) == pytest.approx(want, rel=0.03)


def test_level_and_clip_light(page):
    choose(page, "#heard", "2")
    page.until("document.querySelector('#level').textContent === '0.707 V rms'")  # also unheard
    page.until("document.querySelector('#left-out').textContent.includes('sound is 6.00 V')")
    assert page.js("document.querySelector('#clip').textContent") == "no clip"
    press(page, 1.0, 0.5)
    choose(page, "#sources input[aria-label*=' to']", "0.5")  # 1000 N of 500
    page.until("document.querySelector('#clip').textContent === 'clip'")
    choose(page, "#sources input[aria-label*=' to']", "0.1")
    release(page)


def said(page, text):
    return page.until(f"document.querySelector('#state').textContent.includes({text!r})")


def test_a_reloaded_page_goes_on(page):
    session = until(page, "live.state.phase === 'running' && live.state.session")
    page.reload()
    until(page, f"live.state?.role === 'control' && live.state.session === {session}")
    until(page, "live.state.phase === 'running' && live.blocks > 5")
    said(page, "this page controls")
    page.js(LOOKS)


ABLE = "document.querySelectorAll(':is(#run, #params *, #sources *):is(input, select):enabled')"


def test_a_closed_tab_controls_nothing_and_another_takes_over(page, site, monkeypatch):
    """The other watches first. The session goes on meanwhile, as it does while a page
    is loaded again; of a page that stays away it ends.
    """
    session = until(page, "live.state.phase === 'running' && live.state.session")
    for grace in (1e3, 0.5):
        monkeypatch.setattr("stimlib.live.stream.GRACE", grace)
        other = site.open()
        until(other, "live.state?.role === 'watch' && live.blocks > 5")
        other.until(f"{ABLE}.length === 0")
        assert page.js(f"{ABLE}.length") > 0
        third = site.open()
        said(third, "Refused: 2 pages")
        third.close()
        other.click("#control")
        said(page, "another page controls")
        press(other, 0.4, 0.5)
        # the other's finger is seen here
        until(page, "Math.abs(live.outputs.force1 - 80) < 1")
        other.close()
        said(page, "no page controls" if grace > 1 else "stopped; no page controls")
        assert page.js("document.querySelector('#run').disabled")
        page.click("#control")
        said(page, "this page controls")
        running = live(page, "live.state.phase === 'running'")
        assert running == (grace > 1) and live(page, "live.state.session") == session


def test_text_has_contrast_in_both_themes(page):
    for theme in ("dark", "light"):
        page.media(prefers_color_scheme=theme)
        ratio, element = page.js("looks.contrast()")
        assert ratio >= 4.5, (theme, element)
        painted = page.js("looks.painted()")  # on canvases
        assert painted["text"] >= 4.5 and painted["curves"] >= 3


def test_the_legend_is_right_while_its_curve_is_out_of_sight(page):
    page.size(1240, 500)
    press(page, 0.3, 0.5)
    release(page, 0.3)
    until(page, "Math.abs(live.outputs.force1 - 60) < 1")
    assert page.js("document.querySelector('#outputs').getBoundingClientRect().top") > 500
    page.until("document.querySelector('#outputs output').textContent.startsWith('60')")
    page.size(1240, 900)


def test_a_page_that_was_silent_connects_again(page, site):
    """As after a sleep: the server has ended its session and its connection."""
    stream = site.server.stream
    press(page, 0.5, 0.5)  # else the note says that no pointer moved
    release(page, 0.5)
    stream._loop.call_soon_threadsafe(stream.control.close, 4408, "no answer from this page")
    said(page, "Connected, stopped; this page controls")
    note = "document.querySelector('#note').textContent"  # in the words of the page itself
    page.until(f"{note} === 'this page answered nothing, so the stimulus was faded out'")


SERVED = """
import sys
from stimlib import Input, Param, Scene
from stimlib.live.server import Server
from stimlib.live.stream import Stream
scene = Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")})
server = Server(Stream(scene, 8000.0, 500.0), port=int(sys.argv[1]), token=sys.argv[2])
print(server.url, flush=True)
server.run()
"""


@pytest.fixture
def begun():
    """Gives a server in a process of its own, which ends with the test, and its URL."""
    with ExitStack() as stack:

        def start(port, token):
            words = [sys.executable, "-c", SERVED, str(port), token]
            process = stack.enter_context(subprocess.Popen(words, stdout=-1, text=True))
            stack.callback(process.kill)
            return process, process.stdout.readline().strip()

        yield start


def test_a_page_sees_that_its_server_is_silent_killed_or_another(site, begun):
    """Stopped, continued, killed, and started again at its port with another token."""
    server, url = begun(0, "A" * 32)
    page = site.browser.page(url)
    page.until(READY)
    page.click("#run")
    page.until(RUNS)
    said(page, "running, no motion was received: no pointer moved on the page (finger 1)")
    page.click("#sound")
    until(page, "live.sound.figures?.fill > 0.02 && live.sound.context.state === 'running'")
    server.send_signal(signal.SIGSTOP)
    said(page, "No answer from the server since 2 s; trying again")
    shown = "['#run', '#clock'].map(q => document.querySelector(q).textContent)"
    assert page.js(shown) == ["Start", "–"]
    idle = "['#run', '#record', '#params input'].every(q => document.querySelector(q).disabled)"
    assert page.js(idle)
    time.sleep(1.5)  # the longer it stands still, the more is missing
    server.send_signal(signal.SIGCONT)
    page.until(RUNS)
    gaps = "document.querySelector('#gaps').textContent"
    lacks = page.until(
        f"{gaps}.match(/[1-9]\\d* without an answer .*\\(([\\d.]+) s were not/)?.[1]"
    )
    assert 2.0 < float(lacks) < 60.0
    page.until("document.querySelector('#note').textContent.endsWith(' s were not computed.')")
    # at least one: counts begin anew where the silence has ended the session
    until(page, "live.sound.causes['server late'] > 0")
    server.kill()
    server.wait()
    said(page, "Connection lost: the server or the network is gone; trying again")
    server, url = begun(url.split(":")[2].split("/")[0], "B" * 32)
    said(page, "Refused: the token is missing or wrong")
    page.js(f"location.href = {url!r}")  # in the same tab
    said(page, "Connected, stopped; this page controls")
    server.send_signal(signal.SIGINT)
    said(page, "The server has ended; trying again")
    page.close()


def test_captions_and_words_say_the_sample_that_is_drawn(page):
    """While the finger moves, and after it: of one frame."""
    look = """new Promise(done => requestAnimationFrame(() => setTimeout(() => done(
      ["[aria-label=x1]", "[aria-label=x2]", "#where", "[aria-label=force1]"].map(
      css => document.querySelector(css).textContent)))))"""
    press(page, 0.2, 0.5)
    found = []
    for u in np.linspace(0.2, 0.9, 40):
        page.mouse("Moved", *place(page, u, 0.5))
        found.append(page.js(look))
    for x1, x2, where, force in found:
        assert where.endswith(f"; the stimulus is at x1 = {x1}, x2 = {x2}.")
        wanted = 2 * float(x1.removesuffix(" mm"))  # N
        assert float(force.removesuffix(" N")) == pytest.approx(wanted, abs=0.6)  # of three digits
    assert len({x1 for x1, *_ in found}) > 10
    release(page, 0.9)


def test_the_energy_that_a_force_gave_is_said_in_its_units_and_is_no_clip(browser):
    """The controller changes the force while the finger moves to the right, where a
    force of this sign gives energy, and only keys for what the page has are named.
    """
    force = Param("k", 400.0, "N/m") * Input("x", "m")
    stream = Stream(Scene({"force": force}), FS, Safety(50.0, passivity=Passivity(2e-3, 5.0)))
    stream.warm_up()
    with Server(stream) as server, ExitStack() as exits:
        page = exits.enter_context(closing(browser.page(server.url)))
        page.until(READY)
        keys = "document.querySelector('#keys').innerText"
        assert page.js(f"{keys}.endsWith('Space starts and stops, R records.')")
        assert page.js("document.querySelector('#mark').hidden")
        energy = "document.querySelector('#observed:not([hidden]) #energy')?.textContent"
        page.js("document.querySelector('#run').click()")
        page.until(f"{energy} === 'force gave at most 0 µJ'")
        page.until(RUNS)
        press(page, 0.1, 0.5)

        def damped():
            """Again where a busy machine saw too little of it."""
            move(page, 0.9, 0.5)
            move(page, 0.1, 0.5)
            return live(page, "live.report.clips.passivity?.force > 100 && live.report.at > 8000")

        waiting.until(damped)
        said = r"/^force gave at most [\d.]+ [mµ]?J \(\d+ samples changed, by up to [\d.]+ m?N\)$/"
        page.until(f"{said}.test({energy})")
        page.js("document.querySelector('#run').click()")
        until(page, "live.state.phase === 'idle'")

        def told():
            """The words are drawn some time after the last report came."""
            last, words = live(page, "live.report.energy.force"), page.js(energy).split()
            units = {"J": 1.0, "mJ": 1e-3, "µJ": 1e-6, "N": 1.0, "mN": 1e-3}
            pairs = (last["given"], words[4:6]), (last["most"], words[-2:])
            return all(
                abs(float(part[0]) * units[part[1].strip(")")] / value - 1) < 6e-3
                for value, part in pairs
            )

        waiting.until(told)
        assert page.js("document.querySelector('#clip').textContent") == "no clip"


def test_who_wants_less_motion_sees_few_pictures(page):
    page.media(prefers_reduced_motion="reduce")
    before, begun = live(page, "live.pictures"), time.monotonic()
    time.sleep(0.6)
    assert live(page, "live.pictures") - before <= 1 + (time.monotonic() - begun) / 0.25
    page.media(prefers_reduced_motion="no-preference")


# What is computed on the page, against Python -----------------------------------------
AVATARS = [
    (0.0312, 0.0498, 0.0123),
    (0.043, 0.052, 0.0071),
    (0.1195, 0.0302, 0.004),
    (0.02, 0.09, 0.0006),
]
DRAWN = [{"x": x, "y": y, "depth": d} for x, y, d in AVATARS]
NOISE = np.random.default_rng(1).normal(size=512) + 3
SURFACE, WELCH = (
    surface(AVATARS, 0.12, 0.12),
    welch(NOISE, FS, "hann", detrend="constant", nperseg=512)[1],
)
COMPUTED = {
    "surface": (
        f"[...m.heights({DRAWN}, 0.12, 0.12, 0.005).h]",
        pytest.approx(SURFACE.ravel(), abs=1e-12),
    ),
    "spectrum": (
        f"[...m.density({NOISE.tolist()}, {FS})]",
        pytest.approx(WELCH, rel=1e-9, abs=1e-15),
    ),
    # curves have gaps where samples are missing, and a new session is empty
    "plots": (
        """(() => { const h = new m.History(8, [1, 10]);
        h.push(0, 3, [1, 2, 3, 4, 5, 6]);
        h.push(5, 2, [7, 8, 9, 10]);
        const rings = h.rings.map(r => [...r].map(v => Number.isNaN(v) ? null : v));
        const before = [h.newest(1), [...h.last(0, 2)], h.last(0, 3)];
        h.push(0, 1, [5, 6]);
        return [...rings, ...before, h.last(0, 1)[0], h.end, h.rms(1, 0.5)]; })()""",
        [
            [1, 2, 3, None, None, 7, 8, None],
            [40, 50, 60, None, None, 90, 100, None],
            100,
            [7, 8],
            None,
            5,
            1,
            60,
        ],
    ),
    # numbers and units as people write them
    "scales": (
        """[m.ticks(0, 0.1, 5).at.length, m.text(-0.05, 0.01),
        m.pretty('N*s/m**2'), m.pretty('1/s'), m.scaled('m', 0.02), m.scaled('N', 3),
        m.scaled('A', 1.5e-4), m.short(1234.5), m.short(0.0123), m.roundUp(0.13),
        m.ticks(-15, 15, 2.5).at, m.ticks(0, 15, 2.5).at]""",
        [
            *(
                6,
                "−0.05",
                "N·s/m²",
                "Hz",
                {"factor": 1e3, "unit": "mm"},
                {"factor": 1, "unit": "N"},
                {"factor": 1e6, "unit": "×10⁻⁶ A"},
            ),
            *("1235", "0.0123", pytest.approx(0.15), [-10, 0, 10], [0, 10]),
        ],
    ),
    # laws: formula, words, source; letters are slanted, but for units and words
    "about": (
        """(async () => { const html = t => m.write(document.createElement("p"), t).innerHTML;
        const { live } = await import("./live.js"), laws = ["F = k x; the force (A)", "it moves"];
        const fixed = [{ name: "n", value: "2", meaning: "How many." }];
        m.introduce({ about: { felt: [], do: "", laws, sources: [], fixed }, inputs: [] });
        const shown = [...document.querySelectorAll("#laws p, #fixed li")].map(p => p.textContent);
        m.introduce(live.hello);
        return [
          ...["F = k (x, y), else 0; x is deep (Hooke (1678))", "V = d(x), d being far",
            "It moves; so it is (here)", "F = 1", "F = k (x)"].map(t => Object.values(m.parted(t))),
          html("alpha^k x_max - sqrt(k) a rod's, 5 m chi"), html("b' c'"), html("tau_r"),
          html("exp(-t/a) + 3/2 e^2 per_volt c"), shown,
        ]; })()""",
        [
            *(
                ["F = k (x, y), else 0", "x is deep", "Hooke (1678)"],
                ["V = d(x)", "d being far", ""],
            ),
            *(["", "It moves; so it is", "here"], ["F = 1", "", ""], ["F = k", "", "x"]),
            "<i>α</i><sup><i>k</i></sup> <i>x</i><sub>max</sub> − √(<i>k</i>)"
            " a rod's, 5 m <i>χ</i>",
            *("b' c'", "<i>τ</i><sub><i>r</i></sub>"),
            "exp(−<i>t</i>/<i>a</i>) + 3/2 <i>e</i><sup>2</sup> per_volt <i>c</i>",
            ["F = k x", "the force.", "Source: A.", "It moves.", "n = 2: How many."],
        ],
    ),
    # a press is not lifted by a way to it that was held back, nor by a key that is held
    # down; a pointer that is taken away has no place, and is lifted where it was
    "field": (
        """(() => { const said = [], canvas = document.createElement("canvas");
        canvas.style = "position: fixed; left: 0; top: 0; border: 4px solid"; // no part of it
        document.body.append(canvas);
        const field = new m.Field(canvas, f => said.push([f.u, f.p, f.on]));
        Object.assign(field.box, { w: 100, h: 100 });
        const send = (kind, value, x = 0, pressure = 0, pointerType = "") => {
          const at = { clientX: x && x + 4, pressure, pointerType };
          const e = new PointerEvent(`pointer${kind}`, at);
          canvas.dispatchEvent(Object.defineProperty(e, "timeStamp", { value }));
        };
        for (const t of [10, 11]) send("rawupdate", t, t);
        send("down", 12, 20, 0.7);
        field.tick(0);
        send("cancel", 13);
        for (const t of [20, 21]) send("rawupdate", t, t);
        for (const repeat of [false, true, true]) field.key({ key: "Enter", repeat }, true);
        field.tick(0);
        for (const type of ["pen", "touch"]) { // of a finger 0 is not known
          send("down", 24, 30, 0, type);
          send("up", 25, 30, 0, type);
        }
        canvas.remove();
        return said; })()""",
        [
            *([0.1, 0, 0], [0.2, pytest.approx(0.7), 1], [0.2, 0, 0], [0.2, 0, 0], [0.2, 0.5, 1]),
            *([0.3, p, on] for p, on in ((0, 1), (0, 0), (0.5, 1), (0, 0))),
        ],
    ),
    # the full scale follows noise and no single step: it settles within a second, and
    # then rises only; gaps are counted once, with their causes
    "sound": (
        """(() => { const level = new m.Level({ name: "F", unit: "N", full: 100 });
        const sine = new Float32Array(32), found = [];
        const noise = (seconds, rms) => {
          for (let k = 0; k < 250 * seconds; k++)
            level.take(sine.map((_, i) => rms * Math.SQRT2 * Math.sin(i + 32 * k)), 8000);
          found.push(level.full);
        };
        level.take(new Float32Array(400).fill(10), 8000); // something lands
        noise(0.5, 1e-4); // less than anything can vibrate
        for (const rms of [0.009, 0.09, 0.009]) noise(3, rms);
        const sound = new m.Sound({ postMessage() {} });
        for (const [under, late, skips] of [[1, 1, 0], [1, 1, 0], [3, 2, 1]])
          sound.told({ audio: { under, late, skips } });
        return [...found, level.words().includes("full scale of the sound is 0.800 N"),
          sound.gaps, sound.causes]; })()""",
        [*map(pytest.approx, (80, 0.08, 0.8, 0.8)), True, 4, {"server late": 2, "browser late": 2}],
    ),
}


@pytest.mark.parametrize("module", COMPUTED)
def test_what_a_module_of_the_page_computes(first, module):
    script, wanted = COMPUTED[module]
    assert first.js(f"import('./{module}.js').then(m => {script})") == wanted


def test_a_curve_that_grew_is_the_curve_drawn_at_once(first):
    """Two with dashes and a gap, one that has gone through the window twice, and one
    with fewer samples than pixels.
    """
    first.js(LOOKS)
    two, long, few = (
        first.js(f"looks.grown({how})")
        for how in ("2, 900, 1000, 20", "1, 2500, 1000, 20", "1, 420, 100, 10")
    )
    # of 255: smoothing of edges differs by a quarter of that
    assert max(two["worst"], long["worst"], few["worst"]) <= 100
    assert long["columns"] >= long["wide"] - 1
    assert few["columns"] >= few["wide"] - 5  # half a sample at each end


def test_a_lost_server_is_found_again_and_its_surface_is_touched_where_the_pointer_is(
    tmp_path, browser
):
    site = Site(tmp_path, browser)
    page = site.open()
    site.server.close()
    said(page, "trying again")
    assert page.js("document.querySelector('#run').disabled")
    site.serve(Stream(level(0.0), FS, title="Soft", folder=site.folder))
    page.until(f"document.title === 'Soft' && {READY}")
    page.click("#run")
    page.js("document.querySelector('#field').scrollIntoView({block: 'center'})")
    left, top, wide, high = page.box("#field")
    px, py = round(0.4 * wide), round(0.6 * high)
    x, y = until(page, f"live.field.cam?.from({px}, {py})")
    touched = f"Math.hypot(live.outputs.x1 - {x}, live.outputs.y1 - {y}) < 1e-3"

    def deep():
        for kind in ("Pressed", "Moved"):  # a session that only just begins may miss a press
            page.mouse(kind, left + px, top + py, "pen", 0.9)
        return live(page, f"{touched} && live.outputs.depth1 > 0.005")

    waiting.until(deep)
    until(page, f"Math.abs(looks.ball() - {px}) < 6")  # the ball is blue, and above its place
    page.mouse("Released", left + px, top + py, "pen")
    page.close()
    site.server.close()


@pytest.mark.stress
def test_ten_minutes_without_growth(site):
    """The page and this process, which has the server, once everything has been used
    for a minute.
    """
    page, sizes = site.open(), []
    page.until(READY)
    page.js("document.querySelector('#run').click(); document.querySelector('#sound').click()")
    for minute in range(11):
        begun = time.monotonic()
        while (t := time.monotonic() - begun) < 60:
            press(page, 0.5 - 0.4 * np.cos(t), 0.5, "pen", 0.6)
        page.call("HeapProfiler.collectGarbage")
        heap = page.call("Runtime.getHeapUsage")["usedSize"] / 2**20
        own = int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20
        sizes.append((heap, own))
        assert minute == 0 or heap < sizes[0][0] + 2 and own < sizes[0][1] + 10, sizes  # MiB
    page.close()


def test_a_scene_without_inputs_has_no_field_and_what_vibrates_is_drawn_once(browser):
    tone = constant(1.0, "V") * oscillator(constant(158.0, "Hz"))
    stream = Stream(Scene({"tone": tone, "hum": tone + constant(0.3, "V")}), FS, title="Tone")
    stream.warm_up()
    with Server(stream) as server:
        page = browser.page(server.url)
        page.until(READY)
        shown = "[...document.querySelectorAll('h2, h3')].filter(e => e.checkVisibility())"
        assert page.js(f"{shown}.map(e => e.textContent.split(' ')[0])") == [
            *("What", "Signals", "Outputs,", "Spectrum", "Parameters", "Sound")
        ]
        assert page.complaints() == []
        does = page.js("document.querySelector('#do').textContent")
        assert does == "Press Start and turn the sound on."
        said = "[...document.querySelectorAll('.plot output')].map(e => e.textContent)"
        page.until(f"{said}.join() === '– V rms,– V,– V,– V rms'")  # no 0 that nobody measured
        page.js("document.querySelector('#run').click()")
        curves = "[...document.querySelectorAll('.plot')].filter(e => e.checkVisibility())"
        names = f"{curves}.map(e => e.textContent.split(/ =|:/)[0]).join()"
        page.until(f"{names} === 'tone above 40 Hz,hum,hum above 40 Hz'")
        page.js(LOOKS)
        drawn = page.until("looks.vibrates('hum').then(d => d.columns > 100 && d)")
        assert drawn["high"] > 0.5  # of the canvas
        legend = "document.querySelector('#outputs .vibration figcaption').textContent"
        page.until(f"{legend} === 'hum above 40 Hz: 0.707 V rms'")
        page.js("document.querySelector('#run').click()")  # what is told is the last sample drawn
        page.until("document.querySelector('#level').textContent === '–'")
        page.until(f"{READY} && document.querySelector('#run').textContent === 'Start'")
        caption = "document.querySelector('#outputs .plot:not([hidden]) output').textContent"
        newest = f"parseFloat({caption}.replace('−', '-')) - live.history.newest(1)"
        until(page, f"Math.abs({newest}) < 1e-3")
        page.close()
