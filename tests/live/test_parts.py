"""The parts of the live page that need no server: messages, inputs, description, the
sink and what waits for a page.
"""

import asyncio
import gc
import queue
import threading
import time
import tracemalloc

import numpy as np
import pytest
from refusals import refused
from scipy.signal import welch

from stimlib import Input, Param, Scene, blocks, constant, render
from stimlib.devices.engine import Pump
from stimlib.errors import BadValue, UnknownName
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import replay
from stimlib.live.describe import description, ranges_of
from stimlib.live.inputs import Inputs
from stimlib.live.protocol import FIELDS, message
from stimlib.live.sink import PageSink
from stimlib.live.site import WAITING, Page
from stimlib.live.stream import Stream
from stimlib.motion.generators import sinusoid
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


def test_every_message_of_the_table_is_in_its_text():
    from stimlib.live import protocol

    assert all(
        f"\n{name} " in protocol.__doc__ or f"\n{name}\n" in protocol.__doc__ for name in FIELDS
    )


@pytest.mark.parametrize("chosen, bandwidth", [({}, 11.0), ({"bandwidth": 40.0}, 40.0)])
def test_a_pointer_is_followed_along_its_range(chosen, bandwidth):
    inputs = Inputs(SPRING, FS, {"x": (0.01, 0.03)}, delay=0.0, **chosen)
    assert np.array_equal(inputs.columns(0, 2000)[0, -1:], [0.01])
    inputs.move(0, 0.5, 0.9, 0.3, 0)  # hovers: this scene is not told of contact
    t = np.arange(1, 201) / FS
    w = 2 * np.pi * bandwidth
    assert inputs.columns(2000, 200)[0] == pytest.approx(
        0.02 - 0.01 * (1 + w * t) * np.exp(-w * t), abs=1e-12
    )


def test_where_contact_is_told_a_finger_that_hovers_moves_nothing_and_begins_where_it_lands():
    inputs = Inputs(TOUCH, FS, {"x": (0.0, 0.1), "contact": (0.0, 1.0)}, delay=0.0)
    assert [inputs.sources[n]["from"] for n in ("x", "contact")] == ["u", "contact"]
    inputs.columns(0, 500)
    inputs.move(0, 0.8, 0.0, 0.9, 0)
    assert inputs.fingers[0][2] == 0  # no pressure either
    assert not inputs.columns(500, 100).any()
    inputs.move(0, 0.8, 0.0, 0.0, 1)
    assert inputs.columns(600, 3).tolist() == [[pytest.approx(0.08)] * 3, [1.0] * 3]
    inputs.lift()
    assert inputs.columns(603, 2).tolist() == [[pytest.approx(0.08)] * 2, [0.0] * 2]
    inputs.choose("contact", **{"from": "contact"})
    inputs.move(0, 0.8, 0.0, 0.0, 1)
    # contact jumps, also where its source is chosen anew
    assert inputs.columns(605, 1)[1, 0] == 1.0


def test_an_input_goes_over_to_a_sine_and_then_is_one():
    inputs = Inputs(SPRING, FS, {"x": (0.0, 0.1)}, delay=0.0)
    inputs.move(0, 1.0, 0.0, 0.0, 1)
    inputs.columns(0, 1000)
    inputs.choose("x", **{"from": "sine", "low": 0.02, "high": 0.06, "freq": 2.0})
    t, n = np.arange(1000, 1500) / FS, round(0.1 * FS)
    wanted = 0.04 - 0.02 * np.cos(4 * np.pi * t)
    x = np.concatenate([inputs.columns(at, 100)[0] for at in range(1000, 1500, 100)])
    assert x[n - 1 :] == pytest.approx(wanted[n - 1 :], abs=1e-12)
    w = np.arange(1, n) / n
    # the follower is 1e-8 short of 0.1
    assert x[: n - 1] == pytest.approx(0.1 + w * (wanted[: n - 1] - 0.1), abs=1e-7)
    # a new session
    assert inputs.columns(0, 100)[0] == pytest.approx(
        0.04 - 0.02 * np.cos(4 * np.pi * np.arange(100) / FS)
    )


def in_band(y, low, high, fs):
    """RMS between two frequencies, of what comes after the first half second."""
    f, p = welch(y[int(fs / 2) :], fs, "blackmanharris", 8192)
    return np.sqrt(p[(f >= low) & (f < high)].sum() * f[1])


def followed(rate, monkeypatch, seconds=2.5, **chosen):
    """Strokes of 20 mm at 1.5 Hz of a pointer on a field of 760 pixels: reports at a
    rate, within 0.5 ms, that come up to some ms late; blocks that are late as well.
    """
    rng, clock = np.random.default_rng(rate), Clock()
    monkeypatch.setattr("stimlib.live.inputs.time", clock)
    inputs = Inputs(SPRING, 8000.0, {"x": (0.0, 0.02)}, **chosen)
    at = np.arange(0, seconds, 1 / rate)
    at += rng.uniform(-5e-4, 5e-4, len(at))
    comes = np.maximum.accumulate(at + 5e-4 + rng.exponential(1e-3, len(at)))
    places = np.round(760 * (0.5 - 0.5 * np.cos(2 * np.pi * 1.5 * at))) / 760
    x, k = [], 0
    for first in range(0, int(8000 * seconds), 32):
        now = first / 8000 + rng.exponential(2e-4)
        while k < len(at) and comes[k] <= now:
            clock.now = comes[k]
            inputs.move(0, places[k], 0.0, 0.0, 1, t=5e6 + round(1e3 * at[k], 1))
            k += 1
        clock.now = now
        x.append(inputs.columns(first, 32)[0])
    return np.concatenate(x)


def test_the_steps_of_a_pointer_are_20_db_below_the_stimulus_of_a_squeeze(monkeypatch):
    """In the band of its noise, and at the rates of pointers: both are loud if a block
    has the newest report.
    """
    stroke = {"x1": sinusoid(0.01, 1.5, 0.01, -np.pi / 2)}
    with_noise, without = (
        render(squeeze(A=a, fingers=1), stroke, fs=8000.0, seconds=2.5)["force1"] for a in (3.4, 0)
    )
    stimulus = in_band(with_noise - without, 300, 1000, 8000)
    assert stimulus == pytest.approx(0.013, rel=0.2)  # N
    for rate in (60, 125, 500):
        steps = 2000.0 * followed(rate, monkeypatch)
        assert in_band(steps, 20, 100, 8000) < 0.1 * stimulus
        assert in_band(steps, 300, 1000, 8000) < 0.01 * stimulus
    held = 2000.0 * followed(60, monkeypatch, bandwidth=40.0, delay=0.0)
    assert in_band(held, 20, 100, 8000) > 5 * stimulus


def test_a_pointer_is_where_it_was_reported_a_delay_later(monkeypatch):
    """Delay and smoothing are 54 ms; a pointer that rested moves by no ramp through the
    rest.
    """
    x = followed(125, monkeypatch)
    t = np.arange(len(x)) / 8000 - 0.025 - 1 / (np.pi * 11)
    assert np.abs(x - 0.01 * (1 - np.cos(2 * np.pi * 1.5 * t)))[4000:].max() < 2.5e-4
    clock = Clock()
    monkeypatch.setattr("stimlib.live.inputs.time", clock)
    inputs = Inputs(TOUCH, FS, {"x": (0.0, 0.1), "contact": (0.0, 1.0)})
    for clock.now, u, on in ((1.0, 0.2, 1), (2.0, 0.8, 1), (2.3, 0.5, 0), (2.6, 0.5, 1)):
        inputs.move(0, u, 0.0, 0.0, on, 1e3 * clock.now)
    blocks = []
    for at in range(0, 3000, 10):
        clock.now = at / FS
        blocks.append(inputs.columns(at, 10))
    x, contact = np.concatenate(blocks, axis=1)
    assert np.flatnonzero(np.diff(contact)).tolist() == pytest.approx([1024, 2324, 2624], abs=1)
    assert x[[1990, 2300, 2622, 2627]] == pytest.approx([0.02, 0.08, 0.08, 0.05])
    clock.now = 3.1
    assert inputs.columns(0, 10)[1].all()  # another session, which counts from 0
    inputs.move(0, 0.6, 0.0, 0.0, 1)
    inputs.move(0, 0.7, 0.0, 0.0, 1, 3050.0)  # a time before that of the last
    times = [at for at, *_ in inputs._reports[0]]
    assert times == sorted(times)


def test_what_was_chosen_before_a_session_is_gone_over_to_once():
    inputs = Inputs(SPRING, FS, {"x": (0.0, 0.1)}, delay=0.0)
    inputs.choose("x", **{"from": "sine", "low": 0.02, "high": 0.06})
    wanted = 0.04 - 0.02 * np.cos(2 * np.pi * np.arange(40) / FS)
    first = np.concatenate([inputs.columns(at, 20)[0] for at in (0, 20)])
    # within 0.1 s, from where it was
    assert first == pytest.approx(np.arange(1, 41) / 100 * wanted, abs=1e-12)
    assert inputs.columns(0, 40)[0] == pytest.approx(wanted, abs=1e-12)  # the next session


def test_pressure_a_held_value_and_a_motion_of_the_callers():
    inputs = Inputs(SPRING, FS, {"x": (1.0, 3.0)}, {"x": lambda t: 2.0 + t}, delay=0.0)
    assert inputs.columns(0, 200)[0, -1] == pytest.approx(2.199)
    inputs.choose("x", **{"from": "pressure", "finger": 3})
    inputs.move(3, 0, 0, 0.25, 1)
    assert inputs.columns(200, 500)[0, -1] == pytest.approx(1.5)
    inputs.move(3, 0, 0, 0.25, 0)  # a finger that has left presses no more
    assert inputs.columns(700, 500)[0, -1] == pytest.approx(1.0)
    inputs.choose("x", **{"from": "value", "value": 2.5})
    assert inputs.columns(1200, 500)[0, -1] == pytest.approx(2.5)
    refused(UnknownName, "motion of z", Inputs, SPRING, FS, {"x": (0.0, 1.0)}, {"z": np.sin})
    refused(
        BadValue,
        "a live scene has no end",
        Inputs,
        SPRING,
        FS,
        {"x": (0.0, 1.0)},
        {"x": np.zeros(5)},
    )


@pytest.mark.parametrize("kind", ["value", "u", "pressure"])
@pytest.mark.parametrize(("unit", "zero"), [("N", True), ("N/m^2", True), ("m", False)])
def test_a_lifted_finger_exerts_no_force_on_the_page(kind, unit, zero):
    scene = Scene({"y": 1.0 * Input("a", unit), "on": 1.0 * Input("contact")})
    inputs = Inputs(scene, FS, {"a": (0.5, 1.5), "contact": (0.0, 1.0)}, delay=0.0)
    inputs.choose("a", **{"from": kind, "value": 1.25})
    inputs.move(0, 0.75, 0.0, 0.75, 1)
    assert inputs.columns(0, 4000)[0, -1] == pytest.approx(1.25)
    inputs.lift()
    last = inputs.columns(4000, 4000)[0, -1]
    assert last == pytest.approx(0.0 if zero else 0.5 if kind == "pressure" else 1.25, abs=1e-9)
    inputs.move(0, 0.75, 0.0, 0.75, 1)
    assert inputs.columns(8000, 4000)[0, -1] == pytest.approx(1.25)


def test_nobody_listens_to_a_stream_whose_inputs_are_gone():
    calls = []

    def stream(timeout):
        calls.append(timeout)
        time.sleep(0.01)
        return [], []

    inputs = Inputs(SPRING, FS, {"x": (0.0, 0.03)}, stream=stream)
    before = {t for t in threading.enumerate() if t.name == "stimlib stream"}
    while not calls:
        time.sleep(0.01)
    del inputs
    gc.collect()
    end = time.monotonic() + 30
    while any(t.is_alive() for t in before):
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_stream_drives_an_input_within_its_range():
    """The newest good row counts, times scale, limited; one that fails is named."""
    rows = queue.SimpleQueue()

    def stream(timeout):
        try:
            row = rows.get(timeout=timeout)
        except queue.Empty:
            return [], []
        if row is None:
            raise OSError("unplugged")
        return [row], [0.0]

    choice = {"from": "stream"}
    inputs = Inputs(SPRING, FS, {"x": (0.0, 0.03)}, stream=stream)
    inputs.choose("x", **{"from": "stream", "channel": 1, "scale": 1e-3})
    at = 0

    def comes(row, x):
        nonlocal at
        rows.put(row)
        end = time.monotonic() + 20
        while abs(inputs.columns(at, 100)[0, -1] - x) > 1e-6 and time.monotonic() < end:
            at += 100
            time.sleep(0.001)
        assert inputs.columns(at, 100)[0, -1] == pytest.approx(x, abs=1e-6)

    below = Inputs(SPRING, FS, {"x": (-1.0, 1.0)}, stream=lambda timeout: ([], []))
    below.choose("x", **choice)  # nothing has come: it rests at 0
    assert below.columns(0, 500)[0, -1] == pytest.approx(0.0, abs=1e-9)
    comes([5.0, 20.0], 0.02)
    comes([5.0, 90.0], 0.03)
    comes([5.0, -3.0], 0.0)
    comes([5.0, 10.0], 0.01)
    for _ in range(2):
        rows.put([5.0, float("nan")])
    while not rows.empty():  # the first of them has been looked at
        time.sleep(0.001)
    comes([5.0, float("nan")], 0.01)
    comes([5.0], 0.01)  # too short: it changes nothing
    comes({"label": 5.0, "x": 20.0}, 0.02)  # numbers with labels: in their order
    assert inputs.rejected == {"not finite": 3, "too short": 1, "outside its limits": 2}
    inputs.count()
    assert (inputs.rows, inputs.rejected) == (0, {})
    rows.put(None)
    while not inputs.stream_error:
        time.sleep(0.01)
    refused(BadValue, "the stream has ended: unplugged", inputs.choose, "x", **choice)
    refused(
        BadValue,
        "there is no stream: start with --stream",
        Inputs(SPRING, FS, {"x": (0.0, 1.0)}).choose,
        "x",
        **choice,
    )


@pytest.mark.parametrize("rows", [[1.0], None])
def test_a_stream_of_rows_that_are_none_has_ended(rows):
    """An error of its rows is told like one of its own."""
    inputs = Inputs(SPRING, FS, {"x": (0.0, 0.03)}, stream=lambda timeout: (rows, []))
    end = time.monotonic() + 20
    while not inputs.stream_error and time.monotonic() < end:
        time.sleep(0.001)
    refused(BadValue, "the stream has ended: ", inputs.choose, "x", **{"from": "stream"})


def test_a_page_is_told_of_the_surface_and_its_avatars():
    scene = soft_surface("multipoint")
    view = description(scene, ranges_of(scene), dict.fromkeys(scene.outputs, 1.0), {})["view"]
    assert (view["columns"], view["rows"], view["width"]) == (61, 61, 0.12) and len(
        view["levels"]
    ) == 61 * 61
    assert (
        view["avatars"][2] == {"x": "x3", "y": "y3", "depth": "depth3"}
        and view["inputs"]["press"] == "press"
    )
    mouse = soft_surface("cursor", device="mouse")
    view = description(mouse, ranges_of(mouse), dict.fromkeys(mouse.outputs, 1.0), {})["view"]
    assert (
        view["avatars"] == [{"x": "x1", "y": "y1", "depth": None}]
        and view["inputs"]["press"] is None
    )
    assert description(SPRING, ranges_of(SPRING), {"force": 1.0}, {})["view"] is None


def test_a_slider_goes_around_its_value():
    values = {"k": 2000.0, "part": 0.3, "two": 2.0, "none": 0.0, "down": -4.0, "all": 1.0}
    scene = Scene({name: Param(name, v) * constant(1.0) for name, v in values.items()})
    assert ranges_of(scene) == {
        "k": (0, 5000),
        "part": (0, 1),
        "two": (0, 5),
        "none": (0, 1),
        "down": (-10, 0),
        "all": (0, 1),
    }


def test_ranges_that_are_none_are_refused():
    for given, why in (
        ({"z": (0, 1)}, "has x, k"),
        ({"x": (1, 0)}, "must be finite and rise"),
        ({"k": (0, 1)}, "does not hold"),
    ):
        refused(BadValue if "z" not in given else UnknownName, why, ranges_of, SPRING, given)


class Clock:
    """Time that passes only where somebody sleeps, or stalls."""

    def __init__(self):
        self.now = 0.0

    def perf_counter(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds
        time.sleep(1e-4)


def played(feed, tmp_path, monkeypatch, seconds, stall=0.0):
    """A session with its log: what was heard, the sink, and the motion of each block
    that was heard.
    """
    clock, heard, moved = Clock(), [], []
    monkeypatch.setattr("stimlib.live.sink.time", clock)

    def take(at, x, y):
        heard.append((at, y.copy()))
        moved.append(x[0].copy())
        clock.now += stall if len(heard) == 5 else 0.0

    sink = PageSink(SPRING, 50.0, feed=feed, take=take, log=tmp_path / "log")
    sink.open(FS, block=20)
    sink.start(seconds)
    while not sink.finished:
        time.sleep(0.001)
    sink.close()
    assert replay(read_log(tmp_path / "log")).matches
    return heard, sink, moved


def test_a_motion_that_fails_fades_out_and_says_why(tmp_path, monkeypatch):
    def feed(at, n):
        if at > 200:
            raise BadValue("the hand has gone")
        return 0.01 + 1e-9 * np.arange(at, at + n)[None]

    heard, sink, moved = played(feed, tmp_path, monkeypatch, seconds=60.0)
    assert set(np.concatenate(moved[11:]).tolist()) == {0.01 + 1e-9 * 219}, (
        "it stands where it was last"
    )
    y = np.concatenate([y[0] for _, y in heard])
    assert (
        "feed failed: the hand has gone; correct it" in str(sink.error)
        and y.max() == pytest.approx(0.4, rel=1e-4)
        and abs(y[-1]) < 0.005
    )
    assert np.abs(np.diff(y)).max() < 0.01


# one block later there are 20 less
@pytest.mark.parametrize("stall, lost", [(0.26, 0), (0.28, 260), (0.4, 380), (0.8, 500)])
def test_what_is_late_is_caught_up_and_what_is_too_late_is_lost_and_told(
    tmp_path, monkeypatch, stall, lost
):
    heard, sink, moved = played(
        lambda at, n: 1e-5 * np.arange(at, at + n)[None], tmp_path, monkeypatch, 1.0, stall
    )
    assert all(
        np.array_equal(x, 1e-5 * np.arange(at, at + y.shape[1]))
        for (at, y), x in zip(heard, moved, strict=True)
    )
    report = sink.report()
    assert (report.lost, report.underruns, report.produced) == (lost, lost > 0, 1000)
    at = [a for a, _ in heard]
    assert at[:6] == [0, 20, 40, 60, 80, 100 + lost]


def test_the_first_block_is_shown_although_the_start_comes_just_before_it(tmp_path, monkeypatch):
    honest, missed = Pump.state.fget, []

    def state(pump):
        found = honest(pump)
        if found == pump.native.RUNNING and threading.current_thread().name == "stimlib page":
            missed.append(found)
        return pump.native.IDLE if len(missed) <= 2 else found  # a loop reads it twice

    monkeypatch.setattr(Pump, "state", property(state))
    still = lambda at, n: np.zeros((1, n))  # noqa: E731
    heard, sink, _ = played(still, tmp_path, monkeypatch, 0.2)
    assert missed and [at for at, _ in heard][:10] == list(range(0, 200, 20))


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
    async def long_session():
        stream = Stream(SPRING, FS, 50.0, block=20, ranges={"x": (0, 0.01)})
        stream._loop = asyncio.get_running_loop()
        page = Page()
        stream.join(page)
        page.texts.clear()
        sizes = []
        for k in range(4):
            for i in range(150):
                at = 20 * (150 * k + i)
                x = stream._feed(at, 20)
                stream._take(at, x, np.zeros((1, 20), np.float32))
                stream.do(page, message('{"do": "set", "name": "k", "value": 1000}'))
                await asyncio.sleep(0)
            sizes.append(tracemalloc.get_traced_memory()[0])
        assert page.skipped == 600 - WAITING and len(page.blocks) == WAITING
        for _ in range(WAITING + 1):
            page.tell({"is": "error"})
        page.close(4409, "the reason that came first counts")
        assert page.end[0] == 4408 and page.ended.is_set()
        return sizes

    tracemalloc.start()
    try:
        sizes = asyncio.run(long_session())
    finally:
        tracemalloc.stop()
    assert sizes[3] - sizes[1] < 20_000, sizes  # bytes in 6 s of samples


def test_a_scene_that_is_shown_again_ends_its_earlier_page():
    first = SPRING.live(FS, 50.0, title='a "spring"')
    second = SPRING.live(FS, 50.0)
    try:
        assert (
            "frame-ancestors http://127.0.0.1:* http://localhost:*"
            in second._headers["Content-Security-Policy"]
        )
        assert (
            first.url in first._repr_html_()
            and 'title="a &quot;spring&quot;"' in first._repr_html_()
        )
        assert not first._thread.is_alive() and second._thread.is_alive()
    finally:
        second.close()
    assert not second._thread.is_alive()


def test_a_given_force_goes_on_while_the_finger_is_lifted():
    scene = Scene({"y": 1.0 * Input("a", "N"), "on": 1.0 * Input("contact")})
    ranges = {"a": (0.5, 1.5), "contact": (0.0, 1.0)}
    inputs = Inputs(scene, FS, ranges, {"a": lambda t: 1.0 + 0.0 * t}, delay=0.0)
    assert inputs.columns(0, 4000)[0, -1] == pytest.approx(1.0)


def test_a_frequency_of_half_the_rate_is_refused_on_the_page(tmp_path):
    scene = Scene({"y": blocks.oscillator(Param("f", 100.0, "Hz"))})
    stream = Stream(scene, FS, 50.0, ranges={"f": (0.0, 1e5)}, folder=tmp_path)
    stream.set("f", 0.49 * FS)
    refused(BadValue, r"f: .*freq = .* does not fit below fs/2", stream.set, "f", 0.5 * FS)
    assert stream.params["f"] == 0.49 * FS
