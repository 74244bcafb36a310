"""What the page of an experiment is told to draw: without a browser."""

import json

import numpy as np
import pytest
from refusals import refused

pytest.importorskip("uvicorn")
from experiments.some import experiment, still
from live.asked import asked
from live.drawn import WIDE, outputs_of, seen
from live.test_asking import page
from websockets.exceptions import ConnectionClosed

from stimlib.devices import NullSink
from stimlib.errors import BadValue, MotionError, SinkError
from stimlib.experiments.designs import ConstantStimuli
from stimlib.experiments.experiment import Drawing, Timing
from stimlib.experiments.papers.nodules import nodules
from stimlib.experiments.tasks import Rate
from stimlib.experiments.trial import Stimulus
from stimlib.live.describe import view_of
from stimlib.run import Safety
from stimlib.scenes import bumps, squeeze, touch_screen, viscoelastic

FOLDER = "pair/P01-s1"
SECRET = {"levels", "hidden"}


class Eye:
    """A page that only looks: the state of the stimulus, and what came to be drawn."""

    def __init__(self, phone):
        self.phone, self.feel, self.drawn, self.ask = phone, None, [], None
        phone.answer("", phone.until(phase="ask")["number"])

    def move(self, **more):
        told = {"do": "move", "finger": 0, "u": 0.25, "v": 0.5, "p": 0.75, "on": 1, "t": 1.0}
        self.phone.ws.send(json.dumps(told | more))

    def look(self):
        """Until the next question."""
        while self.ask is None:
            m = self.phone.ws.recv(timeout=30)
            if isinstance(m, bytes):
                self.drawn.append(np.frombuffer(m, "<f8"))
                continue
            m = json.loads(m)
            if m.get("phase") == "feel":
                self.feel = m
                self.move()
            self.ask = m if m.get("phase") == "ask" and self.feel else None
        return self.feel["drawing"]


def looked(data, made, sink):
    """A session of one trial: its page, its record, outputs and motion."""
    with asked(data, made, sink) as running, page(running) as phone:
        eye = Eye(phone)
        eye.look()
        phone.answer("1", eye.ask["number"])
        with pytest.raises(ConnectionClosed):
            while True:
                phone.ws.recv(timeout=30)
    assert running.errors == []
    (record,) = running.session.records
    return eye, record, *outputs_of(data / FOLDER / "trial-0001-1.stimlog")


def test_a_stimulus_that_is_only_seen_is_moved_by_the_page_and_drawn_as_the_log_has_it(tmp_path):
    eye, record, outputs, motion = looked(tmp_path, seen(0.4), "page")
    drawing = eye.feel["drawing"]
    views = drawing["views"]
    assert [v["kind"] for v in views] == ["surface"] * 2 and not SECRET & {*views[0], *views[1]}
    assert views[0] == views[1]  # nothing tells them apart
    assert drawing["sources"]["x"]["from"] == "u" and drawing["sources"]["x"]["high"] == WIDE
    assert (drawing["surface"], drawing["cursor"], drawing["hidden"]) == (True, True, False)
    assert record.displayed[0]["sink"] == "page" and record.answer.values == {"softer": "first"}
    # the finger pressed with 3/4 at a quarter of the width
    assert motion["press"][-1] == pytest.approx(0.75) and motion["x"][-1] == pytest.approx(0.03)
    intervals = record.displayed[0]["intervals"]
    for number, sample, k, *values in eye.drawn:
        n = int(sample)
        inside = [a + 20 <= n < b - 20 for a, b in intervals]  # without the ramps
        assert number == drawing["number"] and k == (inside.index(True) if any(inside) else -1)
        shown = ("x1", "y1", "depth1") if any(inside) else ()
        assert values == [outputs[name][n] for name in shown]
    depths = [
        [row[5] for row in eye.drawn if row[2] == k][-1] for k in range(2)
    ]  # the last of each
    force = 0.1008 * np.exp(4.2081 * 0.75)
    assert depths == pytest.approx([1e-3 * force / 0.4, 1e-3 * force / 1.2], rel=1e-4)


def test_nothing_is_drawn_for_who_wants_nothing_and_what_is_hidden_only_if_it_is_wanted(tmp_path):
    none = seen(0.1, drawing=None)
    eye, *_ = looked(tmp_path / "none", none, "null")
    assert eye.feel["drawing"] is None and eye.drawn == []
    eye, *_ = looked(tmp_path / "blank", none, "page")  # in which a pointer moves
    assert eye.feel["drawing"]["sources"] and not eye.feel["drawing"]["surface"]
    wanted = Drawing(hidden=True, cursor=False, beside=(-0.015, 0.0))
    eye, *_ = looked(tmp_path / "all", seen(0.1, drawing=wanted), "page")
    drawing = eye.feel["drawing"]
    assert [set(v["levels"]) for v in drawing["views"]] == [{0.0}, {1.0}]
    assert drawing["hidden"] and not drawing["cursor"] and drawing["beside"] == [-0.015, 0.0]
    refused(BadValue, r"beside = \(0.0, 15.0\) must be", Drawing, beside=(0.0, 15.0))
    refused(BadValue, "mark 'a' at", Drawing, marks={"a": (float("nan"), 0.0)})


def test_a_pointer_that_never_comes_is_no_trial(tmp_path):
    """The stimulus comes again, and then the session ends, to be resumed."""
    with asked(tmp_path, seen(0.1), "page") as running, page(running) as phone:
        for text in ("Trial 1 of 1", "Once more", "Once more"):
            asks = phone.until(phase="ask")
            assert (asks["text"], asks["trial"]) == (text, "Trial 1 of 1")
            assert (text == "Once more") == ("movement was not received" in str(asks["told"]))
            phone.answer("", asks["number"])
        assert "has stopped" in str(phone.until(phase="end")["told"])
    (error,) = running.errors
    assert isinstance(error, MotionError) and "3 presentations in a row: page: no mot" in str(error)
    assert "no pointer moved" in running.notes[-1] and running.session.records == []


def test_the_hand_on_a_device_is_drawn_from_its_motion(tmp_path):
    task = Rate("plate", ("softer",), Stimulus("plate"))
    made = experiment(
        scenes={"plate": viscoelastic()},
        design=ConstantStimuli(((task, None),)),
        motion={"y": lambda t: 0.01 + 0.005 * np.sin(20 * t)},
        bounds={},
        timing=Timing(interval=0.6, gap=0.0, before=0.0),
    )
    eye, record, _, motion = looked(tmp_path, made, "null")
    assert eye.feel["drawing"]["sources"] is None
    assert eye.feel["drawing"]["views"] == [{"kind": "plate", "length": 0.04, "values": ["y"]}]
    drawn = [(int(n), y) for _, n, k, *values in eye.drawn if k == 0 for y in values]
    assert len(drawn) > 6 and record.displayed[0]["sink"] == "null"
    for n, y in drawn:  # motion and index may be a block apart
        assert np.abs(motion["y"][max(0, n - 64) : n + 65] - y).min() < 1e-12


@pytest.mark.parametrize("hidden", [False, True])
def test_the_places_of_bumps_are_sent_only_if_they_are_wanted(tmp_path, hidden):
    made = experiment(
        scenes={"bumps": bumps()},
        design=ConstantStimuli(((Rate("bumps", ("softer",), Stimulus("bumps")), None),)),
        motion={"x": lambda t: 0.05 + 0.0 * t},
        bounds={},
        fs=4000,
        safety=Safety(1000.0),
        timing=Timing(interval=0.1, gap=0.0, before=0.0),
        drawing=Drawing(hidden=hidden),
    )
    eye, *_ = looked(tmp_path, made, "null")
    (view,) = eye.feel["drawing"]["views"]
    assert view["kind"] and ("hidden" in view) == hidden


def test_a_page_says_which_samples_it_has_drawn_and_of_no_other_stimulus(tmp_path):
    with asked(tmp_path, seen(0.3), "page") as running, page(running) as phone:
        eye = Eye(phone)
        eye.look()
        told = {"do": "pictures", "wide": 390, "high": 844, "box": [0, 10.5, 390, 400]}
        for number in (99, eye.feel["drawing"]["number"]):
            phone.ws.send(json.dumps(told | {"number": number, "samples": [150, 170]}))
        phone.answer("1", eye.ask["number"])
        phone.until(phase="end")
    (error,) = [m for m in phone.told if m["is"] == "error"]
    assert (error["about"], error["text"]) == ("pictures", "no stimulus has this number")
    lines = [json.loads(line) for line in running.layouts.read_text().splitlines()]
    (line,) = [line for line in lines if "samples" in line]
    del line["time"]
    assert line == {
        "trial": "Trial 1 of 1",
        "log": "trial-0001-1.stimlog",
        "wide": 390,
        "high": 844,
        "box": [0, 10.5, 390, 400],
        "samples": [150, 170],
    }


def test_a_page_draws_what_the_scene_says():
    ridges = [[0.0, 0.0125], [0.05, 0.0625]]
    assert view_of(bumps(bumps=2, duty=0.5), {"duty": 0.25})["hidden"] == ridges
    assert view_of(touch_screen(bumps=2, duty=0.25, amplitude=0.1))["hidden"] == ridges
    renamed = viscoelastic().renamed(inputs={"y": "press"})
    assert view_of(renamed) == {"kind": "plate", "length": 0.04, "values": ["press"]}
    (avatar,) = view_of(nodules().scenes["combined, A1 and none"])["avatars"]
    assert avatar == {"x": "x", "y": "y", "depth": "depth"}
    assert view_of(squeeze()) is None and view_of(experiment().scenes["spring"]) is None


def test_a_sink_shows_its_newest_sample(tmp_path):
    scene, found = experiment().scenes["spring"], []
    with NullSink(scene, 10.0, motion={"x": still}, log=tmp_path / "log") as sink:
        sink.open(1000)
        refused(SinkError, "watch: give the sink a log", sink.watch, print)
        sink.start(0.3)
        sink.watch(lambda at, x, y: found.append((at, x.tolist(), y.tolist())))
        sink.wait()
    assert len(found) > 3 and all(x == [[1.0]] for _, x, _ in found)
    assert [at for at, *_ in found] == sorted(at for at, *_ in found)
    assert {str(y) for at, _, y in found if at < 300} == {"[[0.20000000298023224]]"}
    with NullSink(scene, 10.0, motion={"x": still}) as sink:
        sink.open(1000)
        sink.start(0.01)
        refused(SinkError, "watch: give the sink a log", sink.watch, print)
