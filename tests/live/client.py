"""A page without a browser: a WebSocket client, and what it has been told."""

import json
import socket
import time
from contextlib import contextmanager

import numpy as np
import pytest
from waiting import until
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from stimlib.live.protocol import HEAD

HELLO = '{"do": "hello", "token": "T", "version": 1}'
MOVE = '{"do": "move", "finger": 0, "u": 1, "v": 0, "p": 0, "on": 1, "t": 5}'


class Client:
    """The texts that came, and messages of samples."""

    def __init__(self, ws):
        self.ws, self.texts, self.data, self.answers = ws, [], [], True

    def say(self, what, **more):
        self.ws.send(json.dumps({"do": what} | more))

    def answer(self, text, number):
        self.say("answer", number=number, text=text)

    def whole(self, typed):
        """Answers one after another, as they are asked for."""
        for text in typed:
            self.answer(text, self.until(phase="ask")["number"])

    def next(self):
        m = self.ws.recv()
        if isinstance(m, bytes):
            self.data.append(m)
            return {"is": "samples"}
        self.texts.append(json.loads(m))
        if self.texts[-1]["is"] == "report" and self.answers:
            self.say("seen", at=self.texts[-1]["at"])
        return self.texts[-1]

    def until(self, **wanted):
        """The first text from now on that has these fields."""
        end = time.monotonic() + 120
        while time.monotonic() < end:
            if wanted.items() <= (m := self.next()).items():
                return m
        raise TimeoutError(f"not within 120 s: {wanted}")

    def start(self, what="start"):
        """A session, or a recording: its state, once it runs."""
        self.say(what)
        return self.until(phase="running")

    def stop(self):
        """The state of a session that has ended."""
        self.say("stop")
        return self.until(phase="idle")

    def settled(self):
        """All that was said has been taken: a mistake is told in its turn."""
        self.say("set", name="none", value=0)
        self.until(about="set")

    def ended(self, *messages):
        """The code with which the server closes the connection, after these at most."""
        with pytest.raises(ConnectionClosed) as closed:
            for message in messages:
                self.ws.send(message)
            while True:
                self.next()
        return closed.value.rcvd.code

    def hear(self, n):
        wanted = len(self.data) + n
        while len(self.data) < wanted:
            self.next()


@contextmanager
def page(server, host="127.0.0.1", **options):
    at = f"{host}:{server.port}"
    sock = socket.create_connection(("127.0.0.1", server.port))
    known = {"origin": f"http://{at}", "compression": None} | options
    with connect(f"ws://{at}/ws", sock=sock, **known) as ws:
        yield Client(ws)


@contextmanager
def welcome(server):
    with page(server) as client:
        client.ws.send(HELLO)
        client.hello = client.until(**{"is": "hello"})
        yield client


def greeted(server):
    """A page of a stream that is welcome, once those of others have gone."""
    until(lambda: not server.stream.pages and not server.stream._kept)
    return welcome(server)


def samples_of(client):
    """The head of each block, and the rows of all: inputs and outputs."""
    heads = [np.frombuffer(m, "<f8", HEAD) for m in client.data]
    rows = [
        np.frombuffer(m, "<f4", offset=8 * HEAD).reshape(-1, int(head[5]))
        for m, head in zip(client.data, heads, strict=True)
    ]
    return np.array(heads), np.concatenate(rows, axis=1)
