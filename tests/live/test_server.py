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
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
from devices.servers import unjudged
from refusals import refused
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from stimlib import Input, Param, Scene, constant
from stimlib.blocks import burst
from stimlib.errors import SinkError
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import delivered, replay
from stimlib.live.protocol import HEAD
from stimlib.live.server import Server, _closed_terminal_ends
from stimlib.live.stream import Stream

FS, BLOCK, K, FULL = 1000.0, 20, 2000.0, 50.0
MOVE = '{"do": "move", "finger": 0, "u": 1, "v": 0, "p": 0, "on": 1, "t": 5}'


class Client:
    """A page without a browser: what it has been told, and the samples, (n_inputs +
    n_outputs, n) each.
    """

    def __init__(self, ws):
        self.ws, self.texts, self.heads, self.blocks = ws, [], [], []
        self.answers = True

    def say(self, what, **more):
        self.ws.send(json.dumps({"do": what} | more))

    def next(self):
        m = self.ws.recv(timeout=30)
        if isinstance(m, bytes):
            self.heads.append(np.frombuffer(m, "<f8", HEAD))
            self.blocks.append(
                np.frombuffer(m, "<f4", offset=8 * HEAD).reshape(-1, int(self.heads[-1][5]))
            )
            return {"is": "samples"}
        self.texts.append(json.loads(m))
        if self.texts[-1]["is"] == "report" and self.answers:
            self.say("seen", at=self.texts[-1]["at"])
        return self.texts[-1]

    def until(self, **wanted):
        """The first text from now on that has these fields."""
        end = time.monotonic() + 30
        while time.monotonic() < end:
            m = self.next()
            if wanted.items() <= m.items():
                return m
        raise TimeoutError(f"not within 30 s: {wanted}")

    def hear(self, n):
        wanted = len(self.blocks) + n
        while len(self.blocks) < wanted:
            self.next()


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    scene = Scene({"force": Param("k", K, "N/m") * Input("x", "m")})
    folder = tmp_path_factory.mktemp("logs")
    stream = Stream(
        scene, FS, FULL, title="spring", ranges={"x": (0, 0.01)}, block=BLOCK, folder=folder
    )
    stream.warm_up()
    with Server(stream, token="T") as running:
        yield running


def test_a_page_marks_where_somebody_listens(tmp_path):
    told = []
    pulses = Scene({"force": Param("k", K, "N/m") * Input("x", "m"), "on": burst(0.05, 0.02)})
    options = {"block": BLOCK, "folder": tmp_path, "markers": ["on"], "send": [told.append]}
    stream = Stream(pulses, FS, {"force": FULL, "on": 1.0}, **options)
    stream.warm_up()
    with Server(stream, token="T") as running, greeted(running) as client:
        assert client.hello["marks"] and not client.hello["stream"]
        client.say("mark")
        assert "no session runs" in client.until(**{"is": "error"})["text"]
        client.say("start")
        client.until(phase="running")
        client.hear(30)
        client.say("mark")
        client.hear(30)
        client.say("stop")
        client.until(phase="idle")
    assert [m.name for m in told] == ["on", "page"]
    # the gain of a live session rises along its first samples: 1 is 0.5 a little later
    assert 50 <= told[0].sample < 50 + 64 and told[1].sample > told[0].sample


@contextmanager
def page(server, host="127.0.0.1", **options):
    at = f"{host}:{server.port}"
    sock = socket.create_connection(("127.0.0.1", server.port))
    with connect(
        f"ws://{at}/ws", sock=sock, **{"origin": f"http://{at}", "compression": None} | options
    ) as ws:
        yield Client(ws)


@contextmanager
def greeted(server):
    end = time.monotonic() + 30
    while (server.stream.pages or server.stream._kept) and time.monotonic() < end:  # of the last
        time.sleep(0.01)
    with page(server) as client:
        client.say("hello", token="T", version=1)
        client.hello = client.until(**{"is": "hello"})
        yield client


def recorded(client):
    """A session with a move and a change: its state, and the heads, motion and samples
    that came.
    """
    client.heads.clear()
    client.blocks.clear()
    client.say("set", name="k", value=K)
    client.say("record")
    state = client.until(phase="running")
    client.ws.send(MOVE)
    client.hear(15)
    client.say("set", name="k", value=1000.0)
    client.hear(10)
    client.say("stop")
    client.until(phase="idle")
    return state, np.array(client.heads), *np.concatenate(client.blocks, axis=1)


def test_a_session_is_driven_heard_and_recorded(server):
    with greeted(server) as client:
        assert client.hello["inputs"] == [
            {"name": "x", "unit": "m", "low": 0.0, "high": 0.01, "given": False}
        ]
        assert client.hello["outputs"] == [{"name": "force", "unit": "N", "full": FULL}]
        assert client.hello["params"] == [
            {"name": "k", "unit": "N/m", "value": K, "low": 0.0, "high": 2.5 * K}
        ]
        assert client.until(**{"is": "state"})["role"] == "control"
        for _ in range(5):
            state, heads, x, y = recorded(client)
            if not any(e.kind == "lost" for e in read_log(state["log"]).events):
                break
        else:
            unjudged("samples were lost in each of 5 sessions")
    # the hand is followed, and the fade-in over
    k = np.searchsorted(np.cumsum(heads[:, 5]), 0.2 * FS) + 3
    assert heads[0, 0] == 0 and set(heads[:, 4]) == {state["session"]}
    assert np.array_equal(np.diff(heads[:, 0]), heads[:-1, 5])  # no sample is missing
    assert heads[k, 1] == 5 and 0 <= heads[k, 2]
    at = int(heads[k, 0])
    assert x[at] == pytest.approx(0.01, abs=5e-5) and y[at] == pytest.approx(
        K * x[at] / FULL, rel=1e-6
    )
    assert y[-BLOCK * 8] == pytest.approx(1000.0 * 0.01 / FULL, rel=1e-3) and abs(y[-1]) < 0.005

    log = read_log(state["log"])
    assert replay(log).matches and log.header["device"] == "page"
    assert [e.data["ramp"] for e in log.events if e.data.get("name") == "k"] == [0.02 * FS]
    assert [e.data["reason"] for e in log.events if e.kind == "stop"] == ["close"]
    assert np.array_equal(np.concatenate([frames for _, frames, _ in delivered(log)])[:, 0], y)


def test_each_session_awaits_its_own_motion(server):
    with greeted(server) as client:
        for moves, says in ((1, ""), (0, "page: no motion was received: no pointer moved")):
            client.say("start")
            client.until(phase="running")
            for _ in range(moves):
                client.ws.send(MOVE)
            client.hear(5)
            client.say("stop")
            why = client.until(phase="idle")["why"]
            assert why[: len(says) or None] == says
            last = [m for m in client.texts if m["is"] == "report"][-1]
            assert last["silent"] in why and bool(last["silent"]) == bool(says)


def test_a_block_does_not_wait_until_the_one_before_is_acknowledged(server):
    # accepted connections have it from there
    assert server._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_a_server_is_started_once(server, monkeypatch):
    """In a notebook ``with scene.live() as page`` starts one that runs: two loops over
    one stream ended the process.
    """
    assert server.start() is server
    refused(SinkError, "runs already, or has ended: make another", server.run)
    # of somebody else in this process; absl's closes stderr with itself
    handler = logging.Handler()
    monkeypatch.setattr(
        handler, "close", lambda: pytest.fail("a server has closed a handler that is not its own")
    )
    never = Server(server.stream, token="")
    assert len(never.token) > 30  # of an empty token, anything would be right
    never.close()
    assert never._socket.fileno() == -1
    refused(SinkError, "make another", never.start)


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no terminals that hang up")
def test_a_closed_terminal_ends_a_server_as_a_kill_does():
    got, term, hup = (
        [],
        signal.getsignal(signal.SIGTERM),
        signal.signal(signal.SIGHUP, signal.SIG_DFL),
    )
    signal.signal(signal.SIGTERM, lambda number, frame: got.append(number))
    try:
        with _closed_terminal_ends():
            signal.raise_signal(signal.SIGHUP)
        assert got == [signal.SIGTERM] and signal.getsignal(signal.SIGHUP) is signal.SIG_DFL
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with _closed_terminal_ends():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN  # nohup
    finally:
        signal.signal(signal.SIGTERM, term), signal.signal(signal.SIGHUP, hup)


def test_at_port_80_browsers_leave_the_port_out(server, monkeypatch):
    assert (
        server._known(f"localhost:{server.port}")
        and not server._known("localhost:1")
        and not server._known("localhost")
    )
    monkeypatch.setattr(server, "port", 80)
    assert all(server._known(host) for host in ("127.0.0.1", "localhost:80", "[::1]"))
    assert not any(server._known(host) for host in ("evil.example", "127.0.0.1:81", ""))


def test_a_page_that_leaves_before_its_first_word_is_no_error(server, monkeypatch):
    said = []
    monkeypatch.setattr(
        logging.getLogger("uvicorn.error"), "error", lambda *a, **more: said.append(a)
    )
    for _ in range(3):
        with page(server) as client:
            client.ws.socket.close()
    with greeted(server):
        assert not said


@pytest.mark.parametrize("source, k", [("contact", 10.0), ("u", K)])
def test_a_page_that_disappears_lets_the_stimulus_fade(server, source, k):
    """The finger that was down stays down until then: lifted at once, it would end the
    stimulus with a step.
    """
    with greeted(server) as client:
        client.say("set", name="k", value=k)
        client.say("source", input="x", **{"from": source})
        client.say("record")
        folder = client.until(phase="running")["log"]
        client.ws.send(MOVE)
        client.hear(12)
        client.ws.socket.close()  # no goodbye
    end = time.monotonic() + 5
    while server.stream.phase != "idle" and time.monotonic() < end:
        time.sleep(0.01)
    assert server.stream.why == "the page that had control has gone"
    assert server.stream.inputs.fingers[0][3] == 0  # nobody's finger is on it in the next session
    log = read_log(folder)
    y = np.concatenate([frames for _, frames, _ in delivered(log)])[:, 0]
    assert log.report is not None and y.max() > 0.15 and abs(y[-1]) < 0.005
    assert np.abs(np.diff(y))[-130:].max() < 0.01  # a fade, not a step


def test_a_page_that_does_not_answer_is_gone(server, monkeypatch):
    monkeypatch.setattr("stimlib.live.site.SILENT", 0.3)
    with ExitStack() as stack:
        client, _ = named(stack, server, "a")
        client.answers = False
        client.say("start")
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                client.next()
    assert closed.value.rcvd.code == 4408 and 0 < client.heads[-1][0] < 10 * 0.3 * FS
    while server.stream.pages:
        time.sleep(0.01)
    assert not server.stream._kept  # nobody waits for it: the session ends at once


def test_a_page_that_moves_is_there(server, monkeypatch):
    """Its answers to reports may be late."""
    monkeypatch.setattr("stimlib.live.site.SILENT", 0.5)
    with greeted(server) as client:
        client.answers = False
        client.say("start")
        for _ in range(12):
            client.ws.send(MOVE)
            client.hear(5)  # 0.1 s
        client.say("stop")
        client.until(phase="idle")


def test_a_page_whose_hello_is_late_may_try_again(server, monkeypatch):
    monkeypatch.setattr("stimlib.live.server.HELLO", 0.1)
    with page(server) as client, pytest.raises(ConnectionClosed) as closed:
        client.next()
    assert closed.value.rcvd.code == 4408  # 4401 ended it for good


def test_moves_that_a_late_server_finds_together_are_no_flood(server):
    """Of two fingers, 500 times a second each: a pause of 1 s."""
    with greeted(server) as client:
        for _ in range(1000):
            client.ws.send(MOVE)
        client.say("set", name="none", value=0)
        client.until(about="set")


def test_one_page_controls_another_watches_and_may_take_over(server):
    with greeted(server) as first, page(server) as second:
        first.until(role="control")
        second.say("hello", token="T", version=1)
        assert second.until(**{"is": "state"})["role"] == "watch"
        second.say("start")
        assert second.until(**{"is": "error"})["about"] == "start"
        with page(server) as third, pytest.raises(ConnectionClosed) as closed:
            third.say("hello", token="T", version=1)
            third.next()
        assert closed.value.rcvd.code == 4409
        first.ws.send(MOVE)
        first.say("set", name="none", value=0)
        first.until(about="set")
        assert server.stream.inputs.fingers[0][3] == 1
        second.say("control")
        second.until(role="control")
        assert server.stream.inputs.fingers[0][3] == 0  # the finger of the one is not the other's
        first.until(role="watch")
        second.say("start")
        first.hear(2)
        first.say("set", name="k", value=0.0)
        assert "control" in first.until(about="set")["text"]
        second.say("stop")
        first.until(phase="idle")


def named(stack, server, name):
    client = stack.enter_context(page(server))
    client.say("hello", token="T", version=1, page=name)
    return client, client.until(**{"is": "state"})


def test_control_is_kept_for_a_page_that_is_loaded_again(server, monkeypatch):
    """It comes before its old connection has ended, or within 2 s; of a page that stays
    away the session ends.
    """
    monkeypatch.setattr("stimlib.live.stream.GRACE", 0.7)
    with ExitStack() as stack:
        with greeted(server):
            pass
        while server.stream.pages:
            time.sleep(0.01)
        first, state = named(stack, server, "a")
        first.until(**{"is": "alive"})  # so that a page knows that it has a server
        other, seen = named(stack, server, "b")
        assert (state["role"], seen["role"], seen["controlled"]) == ("control", "watch", True)
        first.say("start")
        session = first.until(phase="running")["session"]
        again, state = named(stack, server, "a")  # though two pages are here already
        assert (state["role"], state["phase"], state["session"]) == ("control", "running", session)
        with pytest.raises(ConnectionClosed) as closed:
            first.until(phase="idle")
        assert closed.value.rcvd.code == 4410
        again.ws.send(MOVE)
        again.ws.close()
        other.until(controlled=False, phase="running")
        assert server.stream.inputs.fingers[0][3] == 1  # held
        again, state = named(stack, server, "a")
        assert (state["role"], state["phase"], state["session"]) == ("control", "running", session)
        assert server.stream.inputs.fingers[0][3] == 0
        assert server.stream._until.cancelled()  # the session goes on
        again.ws.close()
        other.until(controlled=False)
        late, state = named(stack, server, "d")
        assert state["role"] == "watch"  # control is kept for another
        late.ws.close()
        assert other.until(phase="idle")["why"] == "the page that had control has gone"
        third, state = named(stack, server, "c")
        assert state["role"] == "control"


def test_a_server_that_stood_still_sends_no_page_away(server, monkeypatch):
    with greeted(server) as client:
        client.say("start")
        client.until(phase="running")
        server.stream._loop.call_soon_threadsafe(time.sleep, 2.5)
        client.hear(150)
        client.say("stop")
        client.until(phase="idle")


def test_a_server_that_ends_fades_and_its_recording_is_whole(tmp_path):
    """Of a scene without inputs, which nobody has to drive."""
    stream = Stream(
        Scene({"y": Param("level", 0.5) * constant(1.0)}), FS, 1.0, block=BLOCK, folder=tmp_path
    )
    told = []
    stream.say = told.append
    with Server(stream, token="T") as server, greeted(server) as client:
        client.say("record")
        folder = client.until(phase="running")["log"]
        client.hear(12)
        server.close()
    log = read_log(folder)
    y = np.concatenate([frames for _, frames, _ in delivered(log)])[:, 0]
    assert log.report is not None and replay(log).matches
    assert told[0] == f"recording to {folder}"
    assert re.fullmatch(rf"Recorded 0\.\d s in {re.escape(folder)}(, .*)?", told[1])
    assert y.max() == 0.5 and y[-1] == 0 and np.abs(np.diff(y)).max() < 0.005


REFUSED = [
    ({"do": "hello", "token": "T", "version": 1}, "said once"),
    ({"do": "set", "name": "__class__", "value": 1}, "no parameter '__class__'; this scene has k"),
    ({"do": "set", "name": "k", "value": -1}, "k = -1 is outside its range, 0 to 5000"),
    ({"do": "source", "input": "y", "from": "u"}, "no input 'y'; the inputs are x"),
    ({"do": "source", "input": "x", "from": "given"}, "nothing was given for x"),
    (
        {"do": "source", "input": "x", "from": "sine", "low": 1, "high": 0},
        "low = 1 must be below high = 0",
    ),
    (
        {"do": "source", "input": "x", "from": "sine", "low": 1, "high": 1},
        "low = 1 must be below high = 1",
    ),
]


def test_what_makes_no_sense_is_refused_with_a_reason(server):
    with greeted(server) as client:
        for message, why in REFUSED:
            client.ws.send(json.dumps(message))
            assert why in client.until(about=message["do"])["text"]


def own(server):
    return f"http://127.0.0.1:{server.port}"


HELLO = '{"do": "hello", "token": "T", "version": 1}'
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


def test_strangers_and_floods_are_refused_and_the_stream_goes_on(server):
    with greeted(server) as client, ThreadPoolExecutor(1) as stranger:
        client.say("start")
        client.until(phase="running")
        for name, (headers, messages, code) in FAULTS.items():
            knocking = stranger.submit(knock, server, headers, messages)
            while not knocking.done():  # a page that answers nothing for 2 s is closed
                client.next()
            said = knocking.result()
            # cut off, it may come before the reason
            assert said == code or (name == "a flood" and said is None), name
        client.hear(10)
        client.say("stop")
        client.until(phase="idle")
    report = [m for m in client.texts if m["is"] == "report"][-1]
    # not of a session of the test before
    heard = sum(head[5] for head in client.heads if head[4] == client.heads[-1][4])
    assert (
        heard > 200
        and client.heads[-1][:6:5].sum() == heard + report["lost"] + report["skipped"] * BLOCK
    )


def knock(server, headers, messages):
    """How the server ends a connection that behaves so: status of HTTP or code of
    closing.
    """
    try:
        with page(server, **headers) as client:
            for message in messages:
                client.ws.send(message)
            while True:
                client.ws.recv(timeout=30)
    except InvalidStatus as e:
        return e.response.status_code
    except ConnectionClosed as e:
        return e.rcvd and e.rcvd.code


def closed(sock):
    """Whether the other side closes a connection within 5 s."""
    sock.settimeout(5)
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
        with urllib.request.urlopen(own(server), timeout=30) as answer:
            assert answer.status == 200
        with greeted(server) as client:
            assert client.hello["is"] == "hello"
        assert all(closed(sock) for sock in many)


def test_a_page_stays_beyond_the_time_for_its_request(server, monkeypatch):
    monkeypatch.setattr("stimlib.live.server.REQUEST", 0.05)
    with greeted(server) as client:
        client.say("start")
        client.hear(10)  # 0.2 s
        client.say("stop")
        client.until(phase="idle")


def test_an_answer_ends_its_connection(server):
    with socket.create_connection(("127.0.0.1", server.port)) as sock:
        sock.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
        sock.settimeout(5)
        said = b"".join(iter(lambda: sock.recv(1 << 16), b""))
    assert said.startswith(b"HTTP/1.1 200") and b"\r\nconnection: close\r\n" in said


def test_only_the_page_is_served_and_only_to_this_machine(server):
    def get(path, host=None):
        try:
            with urllib.request.urlopen(
                urllib.request.Request(own(server) + path, headers={"Host": host} if host else {})
            ) as r:
                return r.status, r.headers
        except urllib.error.HTTPError as e:
            return e.code, e.headers

    for path, host, status in (
        ("/", None, 200),
        ("/link.js", None, 200),
        ("/", "evil.example", 421),
        ("/server.py", None, 404),
        ("/%2e%2e/server.py", None, 404),
    ):
        found, headers = get(path, host)
        assert found == status
        assert headers["Content-Security-Policy"].startswith(
            "default-src 'none'; script-src 'self';"
        )
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert server.url.endswith("/#T") and server.host == "127.0.0.1"
