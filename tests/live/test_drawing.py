"""What the page of an experiment is told to draw: without a browser."""

import json
from dataclasses import replace

import numpy as np
import pytest
from experiments.some import experiment, still
from live.asked import FOLDER, asked
from live.client import MOVE, welcome
from live.drawn import WIDE, outputs_of, seen
from refusals import refused

from stimlib import Input, constant
from stimlib.devices import NullSink
from stimlib.errors import BadValue, MotionError, SinkError
from stimlib.experiments import ConstantStimuli, Drawing, Rate, Stimulus, Timing
from stimlib.experiments.papers.nodules import nodules
from stimlib.live.describe import view_of
from stimlib.scenes import bumps, squeeze, touch_screen, viscoelastic


def looked(data, made, sink, said=()):
    """A session of one trial: what the page was told of the stimulus, what came to be
    drawn, the record, and outputs and motion of the log.
    """
    with asked(data, made, sink) as running, welcome(running.server) as client:
        client.whole([""])
        drawing = client.until(phase="feel")["drawing"]
        client.ws.send(MOVE.replace('"u": 1, "v": 0, "p": 0', '"u": 0.25, "v": 0.5, "p": 0.75'))
        asks = client.until(phase="ask")
        for message in said:
            client.say("pictures", **message)
        client.answer("1", asks["number"])
        client.until(phase="end")
    (record,) = running.session.records
    assert [m["text"] for m in client.texts if m["is"] == "error"] == [
        "no stimulus has this number" for message in said if message["number"] == 99
    ]
    lines = [json.loads(line) for line in running.layouts.read_text().splitlines()] if said else []
    drawn = [np.frombuffer(m, "<f8") for m in client.data]
    return drawing, drawn, record, *outputs_of(data / FOLDER / "trial-0001-1.stimlog"), lines


PICTURES = {"wide": 390, "high": 844, "box": [0, 10.5, 390, 400], "samples": [150, 170]}


def test_a_stimulus_that_is_only_seen_is_moved_by_the_page_and_drawn_as_the_log_has_it(tmp_path):
    """The page says which samples it has drawn, and of no other stimulus."""
    said = [PICTURES | {"number": 99}, PICTURES | {"number": 1}]
    drawing, drawn, record, outputs, motion, lines = looked(tmp_path, seen(0.4), "page", said)
    first, second = drawing["views"]
    assert first["kind"] == "surface" and not {"levels", "hidden"} & {*first}
    assert first == second  # nothing tells them apart
    x = drawing["sources"]["x"]
    assert (x["from"], x["high"], drawing["number"]) == ("u", WIDE, 1)
    assert (drawing["surface"], drawing["cursor"], drawing["hidden"]) == (True, True, False)
    assert record.displayed[0]["sink"] == "page" and record.answer.values == {"softer": "first"}
    # the finger pressed with 3/4 at a quarter of the width
    assert motion["press"][-1] == pytest.approx(0.75) and motion["x"][-1] == pytest.approx(0.03)
    intervals, depths = record.displayed[0]["intervals"], {}
    for number, sample, k, *values in drawn:
        n = int(sample)
        inside = [a + 20 <= n < b - 20 for a, b in intervals]  # without the ramps
        assert number == 1 and k == (inside.index(True) if any(inside) else -1)
        assert values == [outputs[name][n] for name in ("x1", "y1", "depth1") if any(inside)]
        depths[k] = values[2:]  # the last of each
    force = 0.1008 * np.exp(4.2081 * 0.75)
    assert depths[0] + depths[1] == pytest.approx(
        [1e-3 * force / 0.4, 1e-3 * force / 1.2], rel=1e-4
    )
    (line,) = [line for line in lines if "samples" in line]
    assert line.pop("time") and line == PICTURES | {
        "trial": "Trial 1 of 1",
        "log": "trial-0001-1.stimlog",
    }


def test_nothing_is_drawn_for_who_wants_nothing_and_what_is_hidden_only_if_it_is_wanted(tmp_path):
    drawing, drawn, *_ = looked(tmp_path / "none", seen(0.1, drawing=None), "null")
    assert drawing is None and drawn == []
    wanted = Drawing(hidden=True, cursor=False, beside=(-0.015, 0.0))
    drawing, *_ = looked(tmp_path / "all", seen(0.1, drawing=wanted), "page")
    assert [set(v["levels"]) for v in drawing["views"]] == [{0.0}, {1.0}]
    assert drawing["hidden"] and not drawing["cursor"] and drawing["beside"] == [-0.015, 0.0]
    refused(BadValue, r"beside = \(0.0, 15.0\) must be", Drawing, beside=(0.0, 15.0))
    refused(BadValue, "mark 'a' at", Drawing, marks={"a": (float("nan"), 0.0)})


def test_a_pointer_that_never_comes_is_no_trial(tmp_path):
    """The stimulus comes again, and then the session ends, to be resumed.  A pointer
    has a place to move in where nothing is drawn.
    """
    with (
        asked(tmp_path, seen(0.1, drawing=None), "page") as running,
        welcome(running.server) as client,
    ):
        for text in ("Trial 1 of 1", "Once more", "Once more"):
            asks = client.until(phase="ask")
            assert (asks["text"], asks["trial"]) == (text, "Trial 1 of 1")
            assert (text == "Once more") == ("movement was not received" in str(asks["told"]))
            client.answer("", asks["number"])
            drawing = client.until(phase="feel")["drawing"]
            assert drawing["sources"] and not drawing["surface"]
        told = client.until(phase="end")["told"]
        assert "The session has stopped. All answers are kept." in told[0]
    (error,) = running.errors
    assert isinstance(error, MotionError) and "3 presentations in a row: page: no mot" in str(error)
    assert "no pointer moved" in running.notes[-1] and running.session.records == []


def shown(scene, seconds, drawing=Drawing(), **motion):  # noqa: B008
    """An experiment of one interval of a scene that a device plays."""
    task = Rate("scene", ("softer",), Stimulus("scene"))
    return experiment(
        scenes={"scene": scene},
        design=ConstantStimuli(((task, None),)),
        motion=motion,
        safety=1000.0,
        bounds={},
        drawing=drawing,
        timing=Timing(interval=seconds, gap=0.0, before=0.0),
    )


def test_the_hand_on_a_device_is_drawn_from_its_motion(tmp_path):
    made = shown(viscoelastic(), 0.6, y=lambda t: 0.01 + 0.005 * np.sin(20 * t))
    drawing, drawn, record, _, motion, _ = looked(tmp_path, made, "null")
    assert drawing["sources"] is None
    assert drawing["views"] == [{"kind": "plate", "length": 0.04, "values": ["y"]}]
    drawn = [(int(n), y) for _, n, k, *values in drawn if k == 0 for y in values]
    assert len(drawn) > 6 and record.displayed[0]["sink"] == "null"
    for n, y in drawn:  # motion and index may be a block apart
        assert np.abs(motion["y"][max(0, n - 64) : n + 65] - y).min() < 1e-12


def test_a_stimulus_that_begins_by_a_condition_is_drawn(tmp_path):
    """The condition is an output that is on no channel."""
    starts = Input("y", "m") > constant(0.004, "m")
    timing = Timing(1.0, gap=0.0, before=0.0, ramp=0.01, until="done", starts=starts, wait=1.0)
    made = replace(shown(viscoelastic(), 1.0, y=lambda t: 0.01 * t), timing=timing)
    with asked(tmp_path, made, "null") as running, welcome(running.server) as client:
        client.whole([""])
        for text, answer in ("When you are done", ""), ("Which one was softer?", "1"):
            client.answer(answer, client.until(phase="ask", text=text)["number"])
        client.until(phase="end")
    assert not running.errors and running.session.records


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
        refused(SinkError, "watch: give the sink a log", sink.watch, print)  # before it plays
        sink.start(0.3)
        sink.watch(lambda at, x, y: found.append((at, x.tolist(), y.tolist())))
        sink.wait()
    assert len(found) > 3 and all(x == [[1.0]] for _, x, _ in found)
    assert [at for at, *_ in found] == sorted(at for at, *_ in found)
    assert {str(y) for at, _, y in found if at < 300} == {"[[0.20000000298023224]]"}
