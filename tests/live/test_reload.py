"""A scene that is edited while its page is open: it plays on the page, crossfaded."""

import threading
from contextlib import contextmanager

import numpy as np
import pytest
from live.client import MOVE, greeted, samples_of
from live.test_server import BLOCK, FULL, SPRING, serving
from refusals import refused
from waiting import until

from stimlib import BadValue, Input, Param, Scene, SinkError, blocks, constant
from stimlib.devices.process import open_sinks
from stimlib.files import read_log, replay

STIFFER = Scene({"force": Param("k", 3000.0, "N/m") * Input("x", "m")})
SOFTER = Scene({"force": Param("k", 1000.0, "N/m") * Input("x", "m") * Param("more", 1.0)})
OTHER = Scene({"force": SPRING.outputs["force"], "on": constant(0.5)})
MARKED = []


@pytest.fixture
def running(tmp_path):
    """A page of a spring on which a finger rests at 10 mm, and its stream."""
    with (
        serving(
            SPRING, FULL, tmp_path, ranges={"x": (0, 0.01)}, seed=7, send=[MARKED.append]
        ) as server,
        greeted(server) as client,
    ):
        client.state = client.start("record")
        client.ws.send(MOVE)
        client.hear(40)  # the hand is followed
        yield client, server.stream


@contextmanager
def reloading(stream, scene):
    """A new scene comes meanwhile, and is there afterwards."""
    thread = threading.Thread(target=stream.reload, args=(scene,))
    thread.start()
    yield
    thread.join(60)


def reloaded(client, stream, scene):
    """What the page heard of a new scene, from the sample on at which it was there."""
    client.data.clear()
    with reloading(stream, scene):
        state = client.until(session=client.state["session"] + 1, phase="running")
    client.hear(20)
    client.state = state
    return samples_of(client)


def test_an_edit_is_crossfaded_and_the_hand_stays(running):
    client, stream = running
    for k, (scene, force) in enumerate([(STIFFER, 0.6), (SOFTER, 0.2), (SPRING, 0.4)]):
        before = stream.session
        heads, (x, y) = reloaded(client, stream, scene)
        assert x == pytest.approx(0.01, abs=5e-5) and y[-1] == pytest.approx(force, rel=5e-3)
        # the gains add up to 1: between the two levels, in steps of less than 1 / 128
        low, high = sorted((y[0], force))
        assert y.min() > low - 0.003 and y.max() < high + 0.003
        assert np.abs(np.diff(y)).max() < (high - low) / 128 + 2e-4
        sessions = heads[:, 4]
        assert set(sessions) <= {before, before + 1} and heads[sessions > before][0, 0] == 0
        assert np.array_equal(np.diff(heads[sessions > before, 0])[:5], 5 * [BLOCK])
        assert client.state["log"].endswith(".stimlog") and stream.phase == "running", k
    client.stop()
    logs = sorted(stream.folder.glob("*.stimlog"), key=lambda p: p.stat().st_mtime)
    logs = [read_log(p) for p in logs]
    assert len(logs) == 4 and all(replay(log).matches for log in logs)
    assert {log.seed for log in logs} == {7}
    reasons = [e.data["reason"] for log in logs for e in log.events if e.kind == "stop"]
    assert sorted(reasons) == ["close", "next", "next", "next"]


def test_sliders_stay_and_new_ones_appear(running):
    client, stream = running
    client.say("set", name="k", value=500.0)
    client.settled()
    client.texts.clear()
    reloaded(client, stream, SOFTER)
    hello = next(t for t in client.texts if t["is"] == "hello")
    assert [(p["name"], p["value"]) for p in hello["params"]] == [("k", 500.0), ("more", 1.0)]
    _, (_, y) = samples_of(client)
    assert y[-1] == pytest.approx(500 * 0.01 / FULL, rel=5e-3)
    client.say("set", name="more", value=0.5)
    client.hear(20)
    assert samples_of(client)[1][1, -1] == pytest.approx(250 * 0.01 / FULL, rel=5e-3)
    MARKED.clear()
    client.say("mark")
    until(lambda: MARKED)
    # its own value is beyond the range of the new scene's: the new one counts
    client.say("set", name="k", value=2000.0)
    client.settled()
    reloaded(client, stream, Scene({"force": Param("k", 10.0, "N/m") * Input("x", "m")}))
    assert stream.params == {"k": 10.0}


def test_other_outputs_begin_a_new_session(running):
    client, stream = running
    stream._made_by = (None, *stream._made_by[1:])  # full scales of its own
    client.texts.clear()
    with reloading(stream, OTHER):
        client.state = client.until(session=client.state["session"] + 1, phase="running")
    client.data.clear()
    client.hear(40)
    assert client.state["log"] == str(stream.log) and stream.log.exists()
    hello = [t for t in client.texts if t["is"] == "hello"][-1]
    assert [o["name"] for o in hello["outputs"]] == ["force", "on"]
    assert hello["outputs"][0]["full"] == FULL  # not less than it was
    _, (x, force, on) = samples_of(client)
    assert force[-1] == pytest.approx(0.4, rel=5e-3) and on[-1] > 0.25 and x[-1] > 0.0099


def test_a_scene_that_cannot_be_is_told_and_the_old_one_plays_on(running):
    client, stream = running
    fast = Scene({"force": SPRING.outputs["force"] * blocks.oscillator(Param("f", 600.0, "Hz"))})
    refused(BadValue, "f: .* does not fit below fs/2", stream.reload, fast)
    stream.tell_error("spring.py:3: it is no scene")
    assert client.until(why="spring.py:3: it is no scene")["phase"] == "running"
    client.data.clear()
    client.hear(10)
    assert samples_of(client)[1][1] == pytest.approx(0.4, rel=5e-3)
    reloaded(client, stream, STIFFER)
    assert stream.why == ""


def test_an_edit_before_and_after_a_session_counts_for_the_next(tmp_path):
    with serving(SPRING, FULL, tmp_path, ranges={"x": (0, 0.01)}) as server:
        stream = server.stream
        stream.reload(SOFTER)
        with greeted(server) as client:
            assert [p["name"] for p in client.hello["params"]] == ["k", "more"]
            client.ws.send(MOVE)
            client.start()
            client.hear(40)
            assert samples_of(client)[1][1, -1] == pytest.approx(0.2, rel=5e-3)
            client.stop()
            stream.reload(STIFFER)
            assert client.until(**{"is": "hello"})["params"][0]["value"] == 3000.0
            client.data.clear()
            client.start()
            client.hear(40)
            assert samples_of(client)[1][1, -1] == pytest.approx(0.6, rel=5e-3)
            until(lambda: stream.phase == "running")


def test_inputs_of_the_same_name_and_unit_keep_their_source(tmp_path):
    with serving(SPRING, FULL, tmp_path, ranges={"x": (0, 0.01)}) as server:
        inputs = server.stream.inputs
        inputs.choose("x", **{"from": "value", "value": 0.004})
        server.stream.reload(Scene({"force": SPRING.outputs["force"] * Input("contact")}))
        assert [*inputs.sources] == ["x", "contact"] == inputs.names
        assert inputs.sources["x"]["value"] == 0.004
        assert inputs.columns(0, 200)[0, -1] == pytest.approx(0.004)
        server.stream.reload(Scene({"force": Input("x", "N")}))
        assert inputs.sources["x"]["value"] != 0.004 and inputs.columns(0, 20).shape == (1, 20)
        server.stream.reload(Scene({"force": Input("y", "N")}))
        assert inputs.names == ["y"]


@pytest.mark.parametrize("scene", [STIFFER, OTHER])
def test_a_stop_during_a_reload_is_a_stop(running, scene):
    """Crossfaded or not: nothing plays on, and what is pressed then is one session."""
    client, stream = running
    stream._made_by = (None, *stream._made_by[1:])  # full scales of its own
    for what, phase in (("stop", "idle"), ("start", "running")):
        with reloading(stream, scene):
            client.say(what)
            client.until(phase=phase)
        until(lambda phase=phase: stream.phase == phase)
        until(lambda what=what: len(playing()) == (what == "start"))
        assert [stream._sink] == (playing() or [None])


def playing():
    """The page's sessions that have not faded out."""
    return [s for s in open_sinks if s.device == "page" and not s.finished]


def test_a_slider_that_is_moved_during_a_reload_counts(running):
    client, stream = running
    for k in range(8):
        with reloading(stream, (SOFTER, SPRING)[k % 2]):
            client.say("set", name="k", value=100.0 + k)
            client.settled()
        client.hear(15)
        assert stream.params["k"] == 100.0 + k
        heard = samples_of(client)[1][1, -1]
        assert heard == pytest.approx((100.0 + k) * 0.01 / FULL, rel=2e-3)


def test_a_motion_that_fails_after_a_reload_ends_the_session(tmp_path):
    given = {"x": lambda t: np.where(t < 0.5, 0.01 * t, np.nan)}
    with serving(SPRING, FULL, tmp_path, given=given) as server, greeted(server) as client:
        client.start()
        client.hear(5)
        server.stream.reload(STIFFER)
        assert "feed failed: motion of x is not finite" in client.until(phase="idle")["why"]
        assert np.diff(samples_of(client)[1][0]).min() >= 0  # it has gone on
    refused(SinkError, "the page has ended", server.stream.reload, SPRING)
