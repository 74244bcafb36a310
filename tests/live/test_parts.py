"""The parts of the live page that need no server: messages, inputs, description, the
sink and what waits for a page.
"""

import asyncio
import gc
import queue
import threading
from contextlib import closing
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refused
from scipy.signal import butter, sosfilt
from waiting import until

from stimlib import BadValue, Input, Param, Scene, UnknownName, blocks, constant, render
from stimlib.files import read_log, replay
from stimlib.live.describe import description, ranges_of
from stimlib.live.experiment import FIELDS
from stimlib.live.inputs import Inputs
from stimlib.live.protocol import message
from stimlib.live.sink import PageSink
from stimlib.live.site import WAITING, Page
from stimlib.live.stream import Stream
from stimlib.motion import sinusoid
from stimlib.scenes import soft_surface, squeeze

FS = 1000.0
TOUCH = Scene({"y": Input("x", "m") * Input("contact")})
SPRING = Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")})


@pytest.mark.parametrize(
    "text, why",
    [
        ("[1]", "not a JSON object"),
        ('{"do": "jump"}', "do must be one of hello, move"),
        ('{"do": "set", "name": "k"}', "value is missing"),
        ('{"do": "set", "name": "k", "value": true}', "value must be a finite number"),
        (
            '{"do": "move", "finger": 10, "u": 0, "v": 0, "p": 0, "on": 1, "t": 0}',
            "finger must be a whole number from 0 to 9",
        ),
        (
            '{"do": "move", "finger": 0, "u": 1.01, "v": 0, "p": 0, "on": 1, "t": 0}',
            "u must be a number from 0 to 1",
        ),
        (
            '{"do": "move", "finger": 0, "u": 0, "v": 0, "p": 0, "on": 0.5, "t": 0}',
            "on must be a whole number from 0 to 1",
        ),
        (
            '{"do": "source", "input": "x", "from": "sine", "freq": 0}',
            "freq must be a number from 0.01 to 1000",
        ),
        (
            '{"do": "source", "input": "x", "from": "u", "low": -1.1e9}',
            "low must be a number from -1e\\+09 to 1e\\+09",
        ),
        ('{"do": "source", "input": "x", "from": "u", "speed": 1}', "source has no speed"),
        ("[" * 1000, "nested too deeply|not a JSON|Expecting"),
    ],
)
def test_a_message_that_the_table_has_not_is_refused(text, why):
    refused(BadValue, why, message, text)


@pytest.mark.parametrize("box", ['["k", "0", 1, 1, 1]', '["k", 0, 1, 1]', "[5, 0, 1, 1, 1]"])
def test_a_layout_of_other_than_boxes_is_refused(box):
    told = '{"do": "drawn", "number": 1, "wide": 1, "high": 1, "boxes": [["1", 0, 0, 1, 1], BOX]}'
    refused(BadValue, "a list of boxes", message, told.replace("BOX", box), FIELDS)


@pytest.mark.parametrize("chosen, sizes", [({}, [32, 27, 21]), ({"bandwidth": 40.0}, [6, 5, 4])])
def test_a_pointer_is_followed_along_its_range(chosen, sizes):
    inputs = Inputs(SPRING, FS, {"x": (0.01, 0.03)}, delay=0.0, **chosen)
    assert np.array_equal(inputs.columns(0, 2000)[0, -1:], [0.01])
    inputs.move(0, 0.5, 0.9, 0.3, 0)  # hovers: this scene is not told of contact
    way = np.ones(200)
    for n in sizes:
        way = np.convolve(way, np.full(n, 1 / n))[:200]
    assert inputs.columns(2000, 200)[0] == pytest.approx(0.01 + 0.01 * way, abs=1e-12)


def test_where_contact_is_told_a_finger_that_hovers_moves_nothing_and_begins_where_it_lands():
    inputs = Inputs(TOUCH, FS, {"x": (0.0, 0.1), "contact": (0.0, 1.0)}, delay=0.0)
    assert [inputs.sources[n]["from"] for n in ("x", "contact")] == ["u", "contact"]
    inputs.columns(0, 500)
    inputs.move(0, 0.8, 0.0, 0.9, 0)
    assert inputs.fingers[0][2] == 0  # no pressure either
    assert not inputs.columns(500, 100).any()
    for at, on in ((600, 1.0), (603, 0.0), (606, 1.0)):  # contact jumps
        inputs.move(0, 0.8, 0.0, 0.0, 1) if on else inputs.lift()
        assert inputs.columns(at, 3).tolist() == [[pytest.approx(0.08)] * 3, [on] * 3]


def test_all_inputs_of_a_finger_know_the_same_reports(monkeypatch):
    """Also where reports come while their motion is computed."""
    clock = SimpleNamespace(perf_counter=count(step=1e-4).__next__)
    monkeypatch.setattr("stimlib.live.inputs.time", clock)

    class Meanwhile(Inputs):
        def _way(self, k, *of):
            self.move(0, 0.1 * (k + 1), 0.0, 0.0, 1)
            self.take([[0.02 * (k + 1)]])
            return super()._way(k, *of)

    scene = Scene({"y": Input("x1", "m") + Input("x2", "m")})
    ranges = {"x1": (0.0, 0.1), "x2": (0.0, 0.1)}
    inputs = Meanwhile(scene, FS, ranges, delay=1e-4, stream=lambda timeout: ([], []))
    for kind in ("u", "stream"):
        for name in ranges:
            inputs.choose(name, **{"from": kind})
        rows = np.concatenate([inputs.columns(4 * k, 4) for k in range(100)], axis=1)
        assert np.array_equal(*rows) and np.ptp(rows) > 0.1


def test_an_input_goes_over_to_a_sine_within_a_tenth_of_a_second_and_then_is_one():
    inputs = Inputs(SPRING, FS, {"x": (0.0, 0.1)}, delay=0.0)
    inputs.move(0, 1.0, 0.0, 0.0, 1)
    inputs.columns(0, 1000)
    inputs.choose("x", **{"from": "sine", "low": 0.02, "high": 0.06, "freq": 2.0})
    wanted = 0.04 - 0.02 * np.cos(4 * np.pi * np.arange(1500) / FS)
    x = np.concatenate([inputs.columns(at, 100)[0] for at in range(1000, 1500, 100)])
    part = np.minimum(np.arange(1, 501) / 100, 1.0)
    # the follower is 1e-8 short of 0.1
    assert x == pytest.approx(0.1 + part * (wanted[1000:] - 0.1), abs=1e-7)
    assert x[99:] == pytest.approx(wanted[1099:], abs=1e-12)
    assert inputs.columns(0, 100)[0] == pytest.approx(wanted[:100])  # a new session
    fresh = Inputs(SPRING, FS, {"x": (0.0, 0.1)}, delay=0.0)
    fresh.choose("x", **{"from": "sine", "low": 0.02, "high": 0.06, "freq": 2.0})
    first = np.concatenate([fresh.columns(at, 20)[0] for at in (0, 20)])
    assert first == pytest.approx(part[:40] * wanted[:40], abs=1e-12)  # before a session, once
    assert fresh.columns(0, 40)[0] == pytest.approx(wanted[:40], abs=1e-12)


STROKE = sinusoid(0.01, 1.5, 0.01, -np.pi / 2)


def above_40(y):
    """The largest rms of half a second above 40 Hz, as the meter of a page has it."""
    high = sosfilt(butter(4, 40, "high", fs=8000, output="sos"), y)[4000:]
    return np.sqrt(np.mean(high[: len(high) // 4000 * 4000].reshape(-1, 4000) ** 2, axis=1).max())


def followed(rate, monkeypatch, seconds=2.5, stalls=0.0, rows=False, **chosen):
    """Strokes of 20 mm at 1.5 Hz of a pointer on a field of 760 pixels: reports at a
    rate, within 0.5 ms, that come up to some ms late; blocks that are late as well.

    Nothing comes in ``stalls`` seconds of each 0.7 s. With ``rows`` the reports are the
    rows of a stream.
    """
    rng, clock = np.random.default_rng(rate), Clock()
    monkeypatch.setattr("stimlib.live.inputs.time", clock)
    inputs = Inputs(SPRING, 8000.0, {"x": (0.0, 0.02)}, **chosen)
    at = np.arange(0, seconds, 1 / rate)
    at += rng.uniform(-5e-4, 5e-4, len(at))
    comes = np.maximum.accumulate(at + 5e-4 + rng.exponential(1e-3, len(at)))
    comes = np.maximum(comes, np.where(comes % 0.7 < stalls, comes // 0.7 * 0.7 + stalls, 0.0))
    places = np.round(760 / 0.02 * STROKE(at)) / 760
    if rows:
        inputs.stream = lambda timeout: ([], [])
        inputs.choose("x", **{"from": "stream", "scale": 0.02})
    x, k = [], 0
    for first in range(0, int(8000 * seconds), 32):
        now = first / 8000 + rng.exponential(2e-4)
        while k < len(at) and comes[k] <= now:
            clock.now = comes[k]
            if rows:
                inputs.take([[places[k]]])
            else:
                inputs.move(0, places[k], 0.0, 0.0, 1, t=5e6 + round(1e3 * at[k], 1))
            k += 1
        clock.now = now
        x.append(inputs.columns(first, 32)[0])
    return np.concatenate(x)


@pytest.fixture(scope="module")
def felt():
    """What vibrates in a squeeze by these strokes, in N."""
    made = render(squeeze(fingers=1), {"x1": STROKE}, fs=8000.0, seconds=2.5)["force1"]
    assert above_40(made) == pytest.approx(0.16, rel=0.1)
    still = render(squeeze(A=0.0, fingers=1), {"x1": STROKE}, fs=8000.0, seconds=2.5)["force1"]
    assert above_40(still) < 5e-4 * above_40(made)
    return above_40(made)


@pytest.mark.parametrize("rate", [60, 125, 500])
@pytest.mark.parametrize(
    ("how", "part"),
    [({}, 1e-3), ({"stalls": 0.1}, 0.015), ({"rows": True}, 0.015)],
    ids=["pointer", "late", "stream"],
)
def test_no_step_of_motion_vibrates(rate, how, part, felt, monkeypatch):
    """Whatever its rate is, in whole pixels, late, and held from row to row."""
    assert above_40(2000.0 * followed(rate, monkeypatch, **how)) < part * felt


def test_a_motion_without_smoothing_would_vibrate(felt, monkeypatch):
    held = followed(60, monkeypatch, bandwidth=40.0, delay=0.0)
    assert above_40(2000.0 * held) > felt


def test_a_pointer_is_where_it_was_reported_a_delay_later(monkeypatch):
    """Delay and smoothing are 65 ms; a pointer that rested moves by no ramp through the
    rest.
    """
    x = followed(125, monkeypatch, 1.5)
    t = np.arange(len(x)) / 8000 - 0.025 - 1 / (np.pi * 8)
    assert np.abs(x - 0.01 * (1 - np.cos(2 * np.pi * 1.5 * t)))[4000:].max() < 2.5e-4
    clock = Clock()
    monkeypatch.setattr("stimlib.live.inputs.time", clock)
    inputs = Inputs(TOUCH, FS, {"x": (0.0, 0.1), "contact": (0.0, 1.0)})
    moves = {1000: (0.2, 1), 2000: (0.8, 1), 2300: (0.5, 0), 2600: (0.5, 1)}
    blocks, newest = [], []
    for at in range(0, 3000, 10):
        clock.now = at / FS
        if at in moves:
            u, on = moves[at]
            inputs.move(0, u, 0.0, 0.0, on, 1e3 * clock.now)
        blocks.append(inputs.columns(at, 10))
        newest.append(inputs.newest)
    x, contact = np.concatenate(blocks, axis=1)
    assert {10 * k: n for k, n in enumerate(newest) if k and n != newest[k - 1]} == {
        1020: [1000.0, 1.0],
        2020: [2000.0, 2.0],
        2320: [2300.0, 2.3],
        2620: [2600.0, 2.6],
    }
    assert np.flatnonzero(np.diff(contact)).tolist() == pytest.approx([1024, 2324, 2624], abs=1)
    assert x[[1990, 2300, 2622, 2627]] == pytest.approx([0.02, 0.08, 0.08, 0.05])
    clock.now = 3.1
    assert inputs.columns(0, 10)[1].all()  # another session, which counts from 0


def test_pressure_a_held_value_and_a_motion_of_the_callers():
    inputs = Inputs(SPRING, FS, {"x": (1.0, 3.0)}, {"x": lambda t: 2.0 + t}, delay=0.0)
    assert inputs.columns(0, 200)[0, -1] == pytest.approx(2.199)
    inputs.choose("x", **{"from": "pressure", "finger": 3})
    for at, on, x in ((200, 1, 1.5), (700, 0, 1.0)):  # a finger that has left presses no more
        inputs.move(3, 0, 0, 0.25, on)
        assert inputs.columns(at, 500)[0, -1] == pytest.approx(x)
    inputs.choose("x", **{"from": "value", "value": 2.5})
    assert inputs.columns(1200, 500)[0, -1] == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("inputs", "kinds", "values"),
    [
        ("x1 x2 y1", "u u v", (0.0, 0.0, 0.0)),
        ("angle contact press", "u contact pressure", (0.0, 0.0, 0.0)),
        ("x y z", "u v value", (0.0, 0.0, 2.0)),  # two axes
        ("load", "value", (2.0,)),
        ("", "", ()),
    ],
)
def test_inputs_begin_with_a_pointer_or_in_the_middle(inputs, kinds, values):
    units = {"load": "N", "angle": "rad", "contact": "1", "press": "1"}
    outputs = {n: 1.0 * Input(n, units.get(n, "m")) for n in inputs.split()}
    scene = Scene(outputs | {"still": constant(1.0)})
    made = Inputs(scene, FS, dict.fromkeys(scene.inputs, (-2.0, 6.0)), delay=0.0)
    assert [s["from"] for s in made.sources.values()] == kinds.split()
    assert tuple(s["value"] for s in made.sources.values()) == values
    assert made.columns(0, 5).shape == (len(values), 5)


def test_a_session_without_motion_says_which_finger_or_that_the_stream_is_silent():
    inputs = Inputs(SPRING, FS, {"x": (0.0, 1.0)}, stream=lambda timeout: ([], []))
    inputs.choose("x", finger=2)
    assert inputs.missing().endswith("no pointer moved on the page (finger 3)")
    inputs.move(2, 0.5, 0.5, 0.0, 1)
    assert inputs.missing() == ""
    inputs.choose("x", **{"from": "stream"})
    assert "pointer" not in inputs.missing() != ""
    inputs.take([[0.5]])
    assert inputs.missing() == ""
    inputs.choose("x", **{"from": "sine"})
    inputs.count()
    assert inputs.missing() == ""


def test_a_motion_of_time_goes_on_in_each_session_that_follows():
    given, ranges = {"x": lambda t: t}, {"x": (0.0, 1.0)}
    inputs = Inputs(SPRING, FS, ranges, given)
    for k in range(3):
        assert inputs.columns(0, 200)[0, -1] == pytest.approx(0.2 * k + 0.199)
        inputs.change(SPRING, ranges, given, None, since=200)


@pytest.mark.parametrize(
    ("kind", "unit", "lifted"),
    [
        ("value", "N", 0.0),
        ("u", "N/m^2", 0.0),
        ("pressure", "N", 0.0),
        ("pressure", "m", 0.5),
        ("u", "m", 1.25),
        ("given", "N", 1.25),
    ],
)
def test_a_lifted_finger_exerts_no_force_on_the_page(kind, unit, lifted):
    scene = Scene({"y": 1.0 * Input("a", unit), "on": 1.0 * Input("contact")})
    ranges, given = {"a": (0.5, 1.5), "contact": (0.0, 1.0)}, {"a": lambda t: 1.25 + 0.0 * t}
    inputs = Inputs(scene, FS, ranges, given, delay=0.0)
    inputs.choose("a", **{"from": kind, "value": 1.25})
    for at, on in ((0, 1), (4000, 0), (8000, 1)):
        inputs.move(0, 0.75, 0.0, 0.75, 1) if on else inputs.lift()
        wanted = 1.25 if on else lifted
        assert inputs.columns(at, 4000)[0, -1] == pytest.approx(wanted, abs=1e-9)


def test_nobody_listens_to_a_stream_whose_inputs_are_gone():
    called = threading.Event()

    def stream(timeout):
        called.set()
        return [], []

    inputs = Inputs(SPRING, FS, {"x": (0.0, 0.03)}, stream=stream)
    listening = [t for t in threading.enumerate() if t.name == "stimlib stream"]
    assert called.wait(30) and listening
    del inputs
    gc.collect()
    for thread in listening:
        thread.join(30)
        assert not thread.is_alive()


def test_a_stream_drives_an_input_within_its_range():
    """The newest good row counts, times scale, limited; one that fails is named."""
    rows, choice = queue.SimpleQueue(), {"from": "stream", "channel": 1, "scale": 1e-3}

    def stream(timeout):
        try:
            row = rows.get(timeout=timeout)
        except queue.Empty:
            return [], []
        if row is None:
            raise OSError("unplugged")
        return [row], [0.0]

    below = Inputs(SPRING, FS, {"x": (-1.0, 1.0)}, stream=lambda timeout: ([], []))
    below.choose("x", **choice)  # nothing has come: it rests at 0
    assert below.columns(0, 500)[0, -1] == pytest.approx(0.0, abs=1e-9)
    inputs, at = Inputs(SPRING, FS, {"x": (0.0, 0.03)}, stream=stream), 0
    inputs.choose("x", **choice)
    nan = float("nan")
    for row, x in [
        ([5.0, 20.0], 0.02),
        ([5.0, 90.0], 0.03),
        ([5.0, -3.0], 0.0),
        ([5.0, 10.0], 0.01),
        ([5.0, nan], 0.01),
        ([5.0], 0.01),  # too short: it changes nothing
        ({"label": 5.0, "x": 20.0}, 0.02),  # numbers with labels: in their order
    ]:
        before = inputs.rows + sum(inputs.rejected.values())
        rows.put(row)
        until(lambda before=before: inputs.rows + sum(inputs.rejected.values()) > before)
        assert inputs.columns(at, 2000)[0, -1] == pytest.approx(x, abs=1e-6)
        at += 2000
    assert inputs.rejected == {"not finite": 1, "too short": 1, "outside its limits": 2}
    inputs.count()
    assert (inputs.rows, inputs.rejected) == (0, {})
    rows.put(None)
    until(lambda: inputs.stream_error)
    refused(BadValue, "the stream has ended: unplugged", inputs.choose, "x", **choice)
    for rows in ([1.0], None):  # of none an error is told like one of the stream itself
        inputs = Inputs(SPRING, FS, {"x": (0.0, 0.03)}, stream=lambda timeout, of=rows: (of, []))
        until(lambda inputs=inputs: inputs.stream_error)
        refused(BadValue, "the stream has ended: ", inputs.choose, "x", **choice)


def test_a_page_is_told_of_the_surface_and_its_avatars():
    def view(scene):
        return description(scene, ranges_of(scene), dict.fromkeys(scene.outputs, 1.0), {})["view"]

    soft, mouse = view(soft_surface("multipoint")), view(soft_surface("cursor", device="mouse"))
    assert (soft["columns"], soft["rows"], soft["width"]) == (61, 61, 0.12)
    assert len(soft["levels"]) == 61 * 61 and soft["inputs"]["press"] == "press"
    assert soft["avatars"][2] == {"x": "x3", "y": "y3", "depth": "depth3"}
    assert mouse["avatars"] == [{"x": "x1", "y": "y1", "depth": None}]
    assert mouse["inputs"]["press"] is None and view(SPRING) is None


@pytest.mark.parametrize(  # 0 to 2.5 times the value, rounded up
    ("value", "low", "high"),
    [(2000.0, 0, 5000), (0.3, 0, 1), (2.0, 0, 5), (0.0, 0, 1), (-4.0, -10, 0), (1.0, 0, 1)],
)
def test_a_slider_goes_around_its_value(value, low, high):
    assert ranges_of(Scene({"y": Param("p", value) * constant(1.0)})) == {"p": (low, high)}


UNIT = {"x": (0.0, 1.0)}


@pytest.mark.parametrize(
    ("error", "says", "call", "given"),
    [
        (UnknownName, "there are x, k", ranges_of, (SPRING, {"z": (0, 1)})),
        (BadValue, "must be finite and rise", ranges_of, (SPRING, {"x": (1, 0)})),
        (BadValue, "does not hold", ranges_of, (SPRING, {"k": (0, 1)})),
        (UnknownName, "motion: there is no input 'z'", Inputs, (SPRING, FS, UNIT, {"z": np.sin})),
        (BadValue, "300 Hz does not fit fs = 1000 Hz", Inputs, (SPRING, FS, UNIT, {}, 300.0)),
        (BadValue, "a live scene has no end", Inputs, (SPRING, FS, UNIT, {"x": np.zeros(5)})),
    ],
)
def test_what_is_refused(error, says, call, given):
    refused(error, says, call, *given)


class Clock:
    """Time that passes only where somebody sleeps, or stalls; it may be held."""

    def __init__(self):
        self.now, self.sleeps, self.goes = 0.0, False, threading.Event()

    def perf_counter(self):
        return self.now

    def sleep(self, seconds):
        self.now, self.sleeps = self.now + seconds, True
        self.goes.wait()


@pytest.mark.parametrize("stall, lost", [(0.26, 0), (0.28, 260), (0.8, 500)])
def test_what_is_late_is_caught_up_and_what_is_too_late_is_lost_and_told(
    tmp_path, monkeypatch, stall, lost
):
    clock, heard = Clock(), []
    monkeypatch.setattr("stimlib.live.sink.time", clock)

    def ramp(at, n):
        return 1e-5 * np.arange(at, at + n)[None]

    def take(at, x, y):
        heard.append(at)
        assert np.array_equal(x, ramp(at, y.shape[1]))
        clock.now += stall if len(heard) == 5 else 0.0

    with closing(PageSink(SPRING, 50.0, feed=ramp, take=take, log=tmp_path / "log")) as sink:
        sink.open(FS, block=20)
        until(lambda: clock.sleeps)  # a block that a start finds begun has no motion yet
        sink.start(1.0)
        clock.goes.set()
        until(lambda: sink.finished)
    assert sink.error is None and replay(read_log(tmp_path / "log")).matches
    report = sink.report()
    assert (report.lost, report.underruns, report.produced) == (lost, lost > 0, 1000)
    assert heard[:6] == [0, 20, 40, 60, 80, 100 + lost]


@pytest.mark.parametrize(
    "silences, most", [([], 2.0), ([1.5], 3.0), ([1.5, 0.1], 3.0), ([1.5, 2.9], 5.0)]
)
def test_a_page_that_was_late_is_waited_for_longer(silences, most):
    """For twice its longest silence, in s, and 5 s at most."""
    page = Page()
    for seconds in silences:
        page.wait(seconds)
        page.hear()
    page.wait(most)
    assert not page.ended.is_set()
    page.wait(0.1)
    assert page.ended.is_set() and page.end == (4408, "no answer from this page")


def test_nothing_heaps_up_for_a_page_that_reads_nothing():
    async def long_session(page):
        stream = Stream(SPRING, FS, 50.0, block=20, ranges={"x": (0, 0.01)})
        stream._loop = asyncio.get_running_loop()
        stream.join(page)
        page.texts.clear()
        for at in range(0, 12000, 20):
            stream._take(at, stream._feed(at, 20), np.zeros((1, 20), np.float32))
            stream.do(page, message('{"do": "set", "name": "k", "value": 1000}'))
            await asyncio.sleep(0)
        assert len(stream._sets) == 1  # the newest alone

    page = Page()
    asyncio.run(long_session(page))
    assert page.skipped == 600 - WAITING and len(page.blocks) == WAITING
    assert len(page.texts) <= WAITING
    for _ in range(WAITING + 1):
        page.tell({"is": "error"})
    page.close(4409, "the reason that came first counts")
    assert page.end[0] == 4408 and page.ended.is_set()


def test_a_scene_that_is_shown_again_is_on_the_same_page():
    """As the cell that is run again in a notebook; other options make another page."""
    title = 'a "spring"'
    first = SPRING.live(FS, 50.0, title=title)
    policy = first._headers["Content-Security-Policy"]
    assert "frame-ancestors http://127.0.0.1:* http://localhost:*" in policy
    shown = first._repr_html_()
    assert first.url in shown and 'title="a &quot;spring&quot;"' in shown
    stiffer = Scene({"force": Param("k", 3.0, "N/m") * Input("x", "m")})
    assert stiffer.live(FS, 50.0, title=title) is first and first.runs
    assert first.stream.scene is stiffer and first.stream.params == {"k": 3.0}
    assert first.stream._expects  # its new frame has control
    with stiffer.live(FS, 60.0, title=title) as second, SPRING.live(FS, 50.0) as third:
        assert not first.runs and second.runs and third.runs and second is not third
    assert not second.runs
    again = stiffer.live(FS, 60.0, title=title)  # the one before has ended
    assert again is not second
    again.close()


def test_a_frequency_of_half_the_rate_is_refused_on_the_page(tmp_path):
    scene = Scene({"y": blocks.oscillator(Param("f", 100.0, "Hz"))})
    stream = Stream(scene, FS, 50.0, ranges={"f": (0.0, 1e5)}, folder=tmp_path)
    stream.set("f", 0.49 * FS)
    refused(BadValue, r"f: .*freq = .* does not fit below fs/2", stream.set, "f", 0.5 * FS)
    assert stream.params["f"] == 0.49 * FS
