"""The server of the live page, driven by a WebSocket client of its own: a session, a
recording, strangers and floods.
"""

import json
import logging
import re
import signal
import socket
import time
import urllib.error
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import numpy as np
import pytest
from devices.servers import unjudged
from live.client import HELLO, MOVE, greeted, page, samples_of
from refusals import refused
from waiting import until
from websockets.exceptions import ConnectionClosed, InvalidStatus

from stimlib import Input, Param, Scene, SinkError, constant
from stimlib.blocks import burst
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import delivered, replay
from stimlib.live.server import Server, _closed_terminal_ends
from stimlib.live.stream import Stream

FS, BLOCK, K, FULL = 1000.0, 20, 2000.0, 50.0
SPRING = Scene({"force": Param("k", K, "N/m") * Input("x", "m")})
GONE = "the page that had control was closed, so the stimulus was faded out"


def serving(scene, full_scale, folder, **options):
    stream = Stream(scene, FS, full_scale, block=BLOCK, folder=folder, **options)
    stream.warm_up()
    return Server(stream, token="T")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    with serving(SPRING, FULL, folder, title="spring", ranges={"x": (0, 0.01)}) as running:
        yield running


@pytest.fixture
def client(server):
    """A page that controls."""
    with greeted(server) as client:
        yield client


def frames_of(log):
    return np.concatenate([frames for _, frames, _ in delivered(log)])[:, 0]


def until_idle(server):
    until(lambda: not server.stream.pages and server.stream.phase == "idle")


def test_a_page_marks_where_somebody_listens(tmp_path):
    told = []
    pulses = Scene({"force": SPRING.outputs["force"], "on": burst(0.05, 0.02)})
    how = {"markers": ["on"], "send": [told.append]}
    with (
        serving(pulses, {"force": FULL, "on": 1.0}, tmp_path, **how) as running,
        greeted(running) as client,
    ):
        assert client.hello["marks"] and not client.hello["stream"]
        client.say("mark")
        assert "no session runs" in client.until(**{"is": "error"})["text"]
        client.start()
        client.hear(30)
        client.say("mark")
        client.hear(30)
        client.stop()
    assert [m.name for m in told] == ["on", "page"]
    # the gain of a live session rises along its first samples: 1 is 0.5 a little later
    assert 50 <= told[0].sample < 50 + 64 and told[1].sample > told[0].sample


def test_a_session_is_driven_heard_and_recorded(client):
    x = {"name": "x", "unit": "m", "low": 0.0, "high": 0.01, "given": False}
    k = {"name": "k", "unit": "N/m", "value": K, "low": 0.0, "high": 2.5 * K, "meaning": ""}
    assert client.hello["inputs"] == [x] and client.hello["params"] == [k]
    force = {"name": "force", "unit": "N", "full": FULL, "vibrates": False}
    assert client.hello["outputs"] == [force]
    assert client.until(**{"is": "state"})["role"] == "control"
    for _ in range(5):
        client.data.clear()
        client.say("set", name="k", value=K)
        state = client.start("record")
        client.ws.send(MOVE)
        client.hear(15)
        client.say("set", name="k", value=1000.0)
        client.hear(10)
        client.stop()
        log = read_log(state["log"])
        if not any(e.kind == "lost" for e in log.events):
            break
    else:
        unjudged("samples were lost in each of 5 sessions")
    heads, (x, y) = samples_of(client)
    # the hand is followed, and the fade-in over
    k = np.searchsorted(np.cumsum(heads[:, 5]), 0.2 * FS) + 3
    assert heads[0, 0] == 0 and set(heads[:, 4]) == {state["session"]}
    assert np.array_equal(np.diff(heads[:, 0]), heads[:-1, 5])  # no sample is missing
    assert heads[k, 1] == 5 and 0 <= heads[k, 2]
    at = int(heads[k, 0])
    assert x[at] == pytest.approx(0.01, abs=5e-5)
    assert y[at] == pytest.approx(K * x[at] / FULL, rel=1e-6)
    assert y[-BLOCK * 8] == pytest.approx(1000.0 * 0.01 / FULL, rel=1e-3) and abs(y[-1]) < 0.005

    assert replay(log).matches and log.header["device"] == "page"
    assert [e.data["ramp"] for e in log.events if e.data.get("name") == "k"] == [0.02 * FS]
    assert [e.data["reason"] for e in log.events if e.kind == "stop"] == ["close"]
    assert np.array_equal(frames_of(log), y)


def test_a_server_is_started_once(server, monkeypatch):
    """In a notebook ``with scene.live() as page`` starts one that runs: two loops over
    one stream ended the process.
    """
    assert server.start() is server
    refused(SinkError, "runs already", server.run)
    # accepted connections do not wait until the block before is acknowledged
    assert server._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    # of somebody else in this process; absl's closes stderr with itself
    foreign = logging.Handler()
    monkeypatch.setattr(foreign, "close", lambda: pytest.fail("a handler that is not its own"))
    never = Server(server.stream, token="")
    assert len(never.token) > 30  # of an empty token, anything would be right
    never.close()
    assert never._socket.fileno() == -1
    refused(SinkError, "make another", never.start)


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no terminals that hang up")
def test_a_closed_terminal_ends_a_server_as_a_kill_does(monkeypatch):
    got = []
    usual = {which: signal.getsignal(which) for which in (signal.SIGTERM, signal.SIGHUP)}
    signal.signal(signal.SIGTERM, lambda number, frame: got.append(number))
    try:
        for before in (signal.SIG_DFL, signal.SIG_IGN):  # the other is nohup's
            signal.signal(signal.SIGHUP, before)
            with _closed_terminal_ends():
                signal.raise_signal(signal.SIGHUP)
            assert got == [signal.SIGTERM] and signal.getsignal(signal.SIGHUP) is before
    finally:
        for which, handler in usual.items():
            signal.signal(which, handler)


def test_at_port_80_browsers_leave_the_port_out(server, monkeypatch):
    assert server._known(f"localhost:{server.port}")
    assert not server._known("localhost:1") and not server._known("localhost")
    monkeypatch.setattr(server, "port", 80)
    assert all(server._known(host) for host in ("127.0.0.1", "localhost:80", "[::1]"))
    assert not any(server._known(host) for host in ("evil.example", "127.0.0.1:81", ""))


@pytest.mark.parametrize("source, k", [("contact", 10.0), ("u", K)])
def test_a_page_that_disappears_lets_the_stimulus_fade(server, source, k):
    """The finger that was down stays down until then: lifted at once, it would end the
    stimulus with a step.
    """
    with greeted(server) as client:
        client.say("set", name="k", value=k)
        client.say("source", input="x", **{"from": source})
        folder = client.start("record")["log"]
        client.ws.send(MOVE)
        client.hear(12)
        client.ws.socket.close()  # no goodbye
    until_idle(server)
    assert server.stream.why == GONE
    assert server.stream.inputs.fingers[0][3] == 0  # nobody's finger is on it in the next session
    log = read_log(folder)
    y = frames_of(log)
    assert log.report is not None and y.max() > 0.15 and abs(y[-1]) < 0.005
    assert np.abs(np.diff(y))[-130:].max() < 0.01  # a fade, not a step
    server.stream.set("k", K)  # as the others expect
    server.stream.inputs.choose("x", **{"from": "u"})


def test_a_page_that_does_not_answer_is_gone(server, monkeypatch):
    """Its session awaits a motion of its own."""
    with greeted(server) as client:
        client.start()
        client.ws.send(MOVE)
        client.hear(5)
        assert not client.stop()["why"]
    monkeypatch.setattr("stimlib.live.site.SILENT", 0.3)
    with ExitStack() as stack:
        client, _ = named(stack, server, "a")
        client.answers = False
        client.say("start")
        assert client.ended() == 4408
    assert 0 < samples_of(client)[0][-1, 0] < 10 * 0.3 * FS
    until_idle(server)
    assert not server.stream._kept  # nobody waits for it: the session ends at once
    first, second = server.stream.why.split("; ", 1)
    assert first == GONE.replace("was closed", "answered nothing")
    assert "no motion was received" in second


def test_a_page_that_moves_is_there_and_stays(server, monkeypatch):
    """Its answers to reports may be late, and the time for its request is over.  Moves
    that a late server finds together are no flood: two fingers, 500 times a second
    each, and a pause of 1 s.
    """
    monkeypatch.setattr("stimlib.live.site.SILENT", 0.5)
    monkeypatch.setattr("stimlib.live.server.REQUEST", 0.05)
    with greeted(server) as client:
        client.answers = False
        client.start()
        for at_once in [1000] + 12 * [1]:
            for _ in range(at_once):
                client.ws.send(MOVE)
            client.hear(5)  # 0.1 s
        client.stop()


def test_a_page_whose_hello_is_late_may_try_again(server, monkeypatch):
    monkeypatch.setattr("stimlib.live.server.HELLO", 0.1)
    with page(server) as client:
        assert client.ended() == 4408  # 4401 ended it for good


def test_one_page_controls_another_watches_and_may_take_over(server):
    with greeted(server) as first, page(server) as second:
        first.until(role="control")
        second.ws.send(HELLO)
        second.until(role="watch")
        second.say("start")
        second.until(**{"is": "error", "about": "start"})
        with page(server) as third:
            third.ws.send(HELLO)
            assert third.ended() == 4409
        first.ws.send(MOVE)
        first.settled()
        assert server.stream.inputs.fingers[0][3] == 1
        second.say("control")
        second.until(role="control")
        assert server.stream.inputs.fingers[0][3] == 0  # the finger of the one is not the other's
        first.until(role="watch")
        second.say("start")
        first.hear(2)
        first.say("set", name="k", value=0.0)
        assert "control" in first.until(about="set")["text"]
        second.stop()


def named(stack, server, name):
    client = stack.enter_context(page(server))
    client.say("hello", token="T", version=1, page=name)
    return client, client.until(**{"is": "state"})


def test_control_is_kept_for_a_page_that_is_loaded_again(server, monkeypatch):
    """It comes before its old connection has ended, or within 2 s; of a page that stays
    away the session ends.
    """
    monkeypatch.setattr("stimlib.live.stream.GRACE", 0.7)
    until_idle(server)
    with ExitStack() as stack:
        first, state = named(stack, server, "a")
        first.until(**{"is": "alive"})  # so that a page knows that it has a server
        other, seen = named(stack, server, "b")
        assert (state["role"], seen["role"], seen["controlled"]) == ("control", "watch", True)
        goes_on = {"role": "control", "phase": "running", "session": first.start()["session"]}
        again, state = named(stack, server, "a")  # though two pages are here already
        assert goes_on.items() <= state.items() and first.ended() == 4410
        again.ws.send(MOVE)
        again.ws.close()
        other.until(controlled=False, phase="running")
        assert server.stream.inputs.fingers[0][3] == 1  # held
        again, state = named(stack, server, "a")
        assert goes_on.items() <= state.items() and server.stream.inputs.fingers[0][3] == 0
        assert server.stream._until.cancelled()  # the session goes on
        again.ws.close()
        other.until(controlled=False)
        late, state = named(stack, server, "d")
        assert state["role"] == "watch"  # control is kept for another
        assert other.until(phase="idle")["why"] == GONE
        late.until(role="control")  # nobody has come back
        late.ws.close()
        other.until(controlled=False)
        late, state = named(stack, server, "d")
        assert state["why"] == GONE  # of "a", not of the page that was away now
        late.start()
        why = late.stop()["why"]
        late.ws.close()  # nothing runs that could fade out
        other.until(controlled=False)
        last, _ = named(stack, server, "e")
        assert last.until(role="control")["why"] == why


def test_a_server_that_stood_still_sends_no_page_away(server, client):
    client.start()
    server.stream._loop.call_soon_threadsafe(time.sleep, 2.5)
    client.hear(150)
    client.stop()


def test_a_server_that_ends_fades_and_its_recording_is_whole(tmp_path):
    """Of a scene without inputs, which nobody has to drive."""
    told = []
    with (
        serving(Scene({"y": Param("level", 0.5) * constant(1.0)}), 1.0, tmp_path) as server,
        greeted(server) as client,
    ):
        server.stream.say = told.append
        folder = client.start("record")["log"]
        client.hear(12)
        server.close()
    log = read_log(folder)
    y = frames_of(log)
    assert log.report is not None and replay(log).matches
    assert told[0] == f"recording to {folder}"
    assert re.fullmatch(rf"Recorded 0\.\d s in {re.escape(folder)}(, .*)?", told[1])
    assert y.max() == 0.5 and y[-1] == 0 and np.abs(np.diff(y)).max() < 0.005


SINE = {"do": "source", "input": "x", "from": "sine", "low": 1}
REFUSED = [
    (json.loads(HELLO), "said once"),
    ({"do": "set", "name": "__class__", "value": 1}, "no parameter '__class__'"),
    ({"do": "set", "name": "k", "value": -1}, "k = -1 is outside its range, 0 to 5000"),
    ({"do": "source", "input": "y", "from": "u"}, "no input 'y'; there are x"),
    ({"do": "source", "input": "x", "from": "given"}, "nothing was given for x"),
    ({"do": "source", "input": "x", "from": "stream"}, "no stream: start with --stream"),
    (SINE | {"high": 0}, "low = 1 must be below high = 0"),
    (SINE | {"high": 1}, "low = 1 must be below high = 1"),
]


def test_what_makes_no_sense_is_refused_with_a_reason(client):
    for message, why in REFUSED:
        client.ws.send(json.dumps(message))
        assert why in client.until(about=message["do"])["text"]


FAULTS = {  # headers and messages, and how the connection ends
    "a foreign origin": ({"origin": "http://evil.example"}, [], 403),
    "no origin": ({"origin": None}, [], 403),
    "the origin null": ({"origin": "null"}, [], 403),
    "another port of this machine": ({"origin": "http://127.0.0.1:1"}, [], 403),
    "a name that was bound anew": ({"host": "evil.example"}, [], 403),
    "no token": ({}, ["{}"], 4401),
    "a wrong token": ({}, [HELLO.replace("T", "t")], 4401),
    "half of a pair": ({}, [HELLO.replace("T", r"\ud800")], 4401),
    "bytes that are no text": ({}, [b"\xff\xfe"], 4401),
    "a page of another release": ({}, [HELLO.replace("1}", "2}")], 4400),
    "1025 bytes": ({}, [HELLO, " " * 1025], 1009),
    "deep JSON": ({}, [HELLO, *["[" * 900] * 25], 4400),
    "numbers that are none": ({}, [HELLO, *[MOVE.replace("5", "NaN")] * 25], 4400),
    "a place outside the pad": ({}, [HELLO, *[MOVE.replace('"u": 1', '"u": 7')] * 25], 4400),
    "an unknown message": ({}, [HELLO, *['{"do": "eval", "text": "1"}'] * 25], 4400),
    "a surplus field": ({}, [HELLO, *['{"do": "start", "log": "/etc"}'] * 25], 4400),
    "a flood": ({}, [HELLO, *[MOVE] * 3000], 4429),
}


def knock(server, headers, messages):
    """How the server ends a connection that behaves so: status of HTTP or code of
    closing.
    """
    try:
        with page(server, **headers) as client:
            for message in messages:
                client.ws.send(message)
            while True:
                client.ws.recv()
    except InvalidStatus as e:
        return e.response.status_code
    except ConnectionClosed as e:
        return e.rcvd and e.rcvd.code


def test_strangers_and_floods_are_refused_and_the_stream_goes_on(server, client):
    with ThreadPoolExecutor(1) as stranger:
        client.start()
        for name, (headers, messages, code) in FAULTS.items():
            knocking = stranger.submit(knock, server, headers, messages)
            while not knocking.done():  # a page that answers nothing for 2 s is closed
                client.next()
            said = knocking.result()
            # cut off, it may come before the reason
            assert said == code or (name == "a flood" and said is None), name
        client.hear(10)
        client.stop()
    report = [m for m in client.texts if m["is"] == "report"][-1]
    heads, _ = samples_of(client)
    heads = heads[heads[:, 4] == heads[-1, 4]]  # not of a session of the test before
    heard, skipped = heads[:, 5].sum(), report["skipped"] * BLOCK
    assert heard > 200 and heads[-1, :6:5].sum() == heard + report["lost"] + skipped


def closed(sock):
    """Whether the other side closes a connection."""
    sock.settimeout(60)
    try:
        return sock.recv(1) == b""
    except ConnectionResetError:
        return True


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nHost: "])
def test_connections_without_a_request_keep_no_page_out(server, sent, monkeypatch):
    """A hundred of them: the oldest make room at once, and all have ended a little
    later.
    """
    monkeypatch.setattr("stimlib.live.server.REQUEST", 1.0)
    with ExitStack() as stack:
        many = []
        for _ in range(100):
            many.append(stack.enter_context(socket.create_connection(("127.0.0.1", server.port))))
            many[-1].sendall(sent)
        with urllib.request.urlopen(f"http://127.0.0.1:{server.port}") as answer:
            assert answer.status == 200
        stack.enter_context(greeted(server))
        assert all(closed(sock) for sock in many)


def test_only_the_page_is_served_and_only_to_this_machine(server, monkeypatch):
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")  # of tests/conftest.py: not asked
    own = f"http://127.0.0.1:{server.port}"
    for path, host, status in (
        ("/", None, 200),
        ("/link.js", None, 200),
        ("/", "evil.example", 421),
        ("/server.py", None, 404),
        ("/%2e%2e/server.py", None, 404),
    ):
        asked = urllib.request.Request(own + path, headers={"Host": host} if host else {})
        try:
            answer = urllib.request.urlopen(asked)
        except urllib.error.HTTPError as e:
            answer = e
        with answer:
            assert answer.status == status and answer.headers["Connection"] == "close"
            policy = answer.headers["Content-Security-Policy"]
            assert policy.startswith("default-src 'none'; script-src 'self';")
            assert "frame-ancestors 'none'" in policy
    assert server.url.endswith("/#T") and server.host == "127.0.0.1"
