"""The server of the page: its files and one WebSocket, protected by a token.

Importing this needs the packages of ``pip install 'stimlib[live]'``.
"""

from __future__ import annotations

import asyncio
import hmac
import html
import ipaddress
import secrets
import signal
import socket
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

from ..devices.process import begin
from ..errors import BadValue, SinkError
from ..system.packages import package
from .protocol import BURST, RATE, VERSION, WRONG
from .site import Page, Site

_, uvicorn, _ = (package(name, "the live page") for name in ("starlette", "uvicorn", "websockets"))
from uvicorn.protocols.http.h11_impl import H11Protocol  # noqa: E402

TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
    "Connection": "close",  # kept open, it would take the place of another
}
POLICY = (
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; connect-src"
    " 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors "
)
"""Content security policy: the page loads only from this server and runs no inline
code.
"""
HELLO = 2.0
"""Seconds in which a page must show its token."""
REQUEST = 3.0
"""Seconds in which a connection must have sent the head of its request."""
WITHOUT = 16
"""Largest number of open connections without a request."""


class Connection(H11Protocol):
    """An HTTP connection that is closed if its request does not arrive in time.

    If more than ``WITHOUT`` connections wait for their request, the oldest is closed.
    """

    def connection_made(self, transport: Any) -> None:
        """Start a new connection's time limit; close the oldest if too many wait."""
        super().connection_made(transport)
        self.limit = self.loop.call_later(REQUEST, self.leave)
        waiting = [c for c in self.connections if isinstance(c, Connection) and c.waits()]
        if len(waiting) > WITHOUT:
            min(waiting, key=lambda c: c.limit.when()).leave()

    def waits(self) -> bool:
        """Return whether the connection is open and still waits for its request."""
        return self.cycle is None and self in self.connections and not self.transport.is_closing()

    def leave(self) -> None:
        """Close the connection if it still waits for its request."""
        if self.waits():
            self.transport.close()


def page_files(index: str) -> dict[str, tuple[str, bytes]]:
    """Return path, media type and content of every file in ``stimlib/live/page``.

    The files are read once; ``index`` is the file of the page.
    """
    found = {}
    for f in Path(__file__).with_name("page").iterdir():
        if kind := TYPES.get(f.suffix[1:]):
            found["/" if f.name == index else f"/{f.name}"] = kind, f.read_bytes()
    return found


class Server:
    """The server of a stream's or an experiment's pages, on one port.

    Parameters
    ----------
    stream : Stream or other Site
    host : str
        Address to listen on.
    port : int
        0 takes a free one.
    token : str, optional
        By default, or if empty, a new random token of 192 bits.
    framed_by : str
        Sources for ``frame-ancestors`` in the content security policy: the sites that
        may show the page in a frame.

    Raises
    ------
    SinkError
        The port is in use, the address does not belong to this machine, or the server
        was started before.
    """

    def __init__(
        self,
        stream: Site,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        token: str | None = None,
        framed_by: str = "'none'",
    ):
        self.stream, self.token = stream, token or secrets.token_urlsafe(24)
        self._headers = HEADERS | {"Content-Security-Policy": POLICY + framed_by}
        self._files = page_files(stream.index)
        self._socket = _listen(host, port)
        self.host, self.port = self._socket.getsockname()[:2]
        self.private = ipaddress.ip_address(self.host).is_loopback
        # log_config=None: its own would close all handlers of the process, and with one
        # of them (absl's) stderr
        config = uvicorn.Config(
            self._app(),
            http=Connection,
            log_config=None,
            log_level="warning",
            ws="websockets-sansio",
            ws_max_size=stream.longest,
            ws_max_queue=32,
            ws_per_message_deflate=False,
            ws_ping_interval=5,
            ws_ping_timeout=5,
            limit_concurrency=32,
            timeout_graceful_shutdown=1,
            server_header=False,
            date_header=False,
            proxy_headers=False,
        )
        self._uvicorn = uvicorn.Server(config)
        self._thread: threading.Thread | None = None
        self._begun = False

    @property
    def url(self) -> str:
        """Address of the page.

        The token follows ``#``, which a browser does not send.
        """
        # under which others reach this machine
        host = socket.gethostname() if self.host in ("0.0.0.0", "::") else self.host
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/#{self.token}"

    def __repr__(self):
        return f"Server({self.stream.title}, {self.host}:{self.port})"

    def _repr_html_(self) -> str:
        what = html.escape(self.stream.title)
        return (
            f'<iframe src="{html.escape(self.url)}" title="{what}" allow="autoplay" '
            'style="width: 100%; height: 720px; border: 0"></iframe>'
        )

    def run(self) -> None:
        """Serve until Ctrl-C or ``close``."""
        self._begin()
        self._serve()

    def _begin(self) -> None:
        """Mark the server as started; raise SinkError if it was started before."""
        if self._begun:
            raise SinkError(
                f"the live page at {self.host}:{self.port} runs already, or has ended: make another"
            )
        self._begun = True

    def _serve(self) -> None:
        """Run the web server until it ends."""
        with self._socket, _closed_terminal_ends():
            self._uvicorn.run(sockets=[self._socket])

    @property
    def runs(self) -> bool:
        """Whether a thread serves the page."""
        return self._thread is not None and self._thread.is_alive()

    def start(self) -> Server:
        """Serve in a thread until ``close``; a running server is left running."""
        if self.runs:
            return self
        self._begin()
        self._thread = begin(
            threading.Thread(target=self._serve, name="stimlib live server", daemon=True)
        )
        while not self._uvicorn.started:
            if not self._thread.is_alive():
                raise SinkError(f"the live page could not be served at {self.host}:{self.port}")
            time.sleep(0.005)
        return self

    def close(self) -> None:
        """Stop the server; a session that is playing fades out first."""
        self._uvicorn.should_exit = True
        if not self._begun:
            self._begun = True
            self._socket.close()
        elif self._thread is not None:
            self._thread.join(10.0)

    def __enter__(self) -> Server:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    # What is answered -----------------------------------------------------------------
    def _app(self) -> Any:
        from starlette.applications import Starlette
        from starlette.responses import Response
        from starlette.routing import Route, WebSocketRoute

        async def get(request: Any) -> Any:
            kind, content = self._files[request.url.path]
            return Response(content, media_type=kind)

        @asynccontextmanager
        async def lifespan(app: Any) -> AsyncIterator[None]:
            run = asyncio.create_task(self.stream.run())
            try:
                with suppress(asyncio.CancelledError):  # a second Ctrl-C
                    yield
            finally:
                run.cancel()
                with suppress(asyncio.CancelledError):
                    await run

        routes = [Route(path, get) for path in self._files] + [WebSocketRoute("/ws", self._talk)]
        app = Starlette(routes=routes, lifespan=lifespan)
        headers = [(name.lower().encode(), value.encode()) for name, value in self._headers.items()]

        async def guarded(scope: Any, receive: Any, send: Any) -> None:
            """Answer with security headers, if the Host header names this machine."""

            async def answer(part: Any) -> None:
                await send(
                    part | {"headers": [*part["headers"], *headers]}
                    if part["type"] == "http.response.start"
                    else part
                )

            if scope["type"] != "http":
                await app(scope, receive, send)
            elif self._known(dict(scope["headers"]).get(b"host", b"").decode("latin-1")):
                await app(scope, receive, answer)
            else:
                await Response("wrong host", 421)(scope, receive, answer)

        return guarded

    def _known(self, host: str) -> bool:
        """Return whether a Host header names this machine.

        If any name were accepted, an attacker's page could share this server's origin.
        """
        if self.port == 80 and not host.endswith(":80"):  # which browsers leave out
            host += ":80"
        name, _, port = host.rpartition(":")
        if port != str(self.port):
            return False
        if self.private:
            return name in ("127.0.0.1", "localhost", "[::1]")
        with suppress(ValueError):
            ipaddress.ip_address(name.strip("[]"))
            return True
        return name in ("localhost", socket.gethostname())

    async def _talk(self, ws: Any) -> None:
        """Serve the WebSocket of one page, from its first message to its last."""
        host = ws.headers.get("host", "")
        if not self._known(host) or ws.headers.get("origin") != f"http://{host}":
            return await _bye(ws, 1000, "")  # before it is accepted: HTTP 403
        await ws.accept()
        page = Page()
        if refused := await self._greet(ws, page):
            return await _bye(ws, *refused)
        self.stream.join(page)
        tasks = [
            asyncio.create_task(work)
            for work in (self._listen(ws, page), self._speak(ws, page), page.ended.wait())
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self.stream.leave(page)
            await _bye(ws, *page.end)

    async def _greet(self, ws: Any, page: Page) -> tuple[int, str] | None:
        """Return why a page is rejected, or None."""
        try:
            first = await asyncio.wait_for(ws.receive(), HELLO)
            hello = self.stream.message(first.get("text") or first.get("bytes") or b"")
            token = str(hello.get("token", "")).encode(errors="replace")
        except TimeoutError:
            return 4408, f"no token within {HELLO:g} s"
        except BadValue:
            token = b""
        if not hmac.compare_digest(token, self.token.encode()):
            return 4401, "the token is missing or wrong: open the address that the terminal shows"
        if hello["version"] != VERSION:
            return 4400, "this page is of another release: load it again"
        page.name = hello.get("page", "")
        # one of the same name is about to leave
        if sum(p.name != page.name or not p.name for p in self.stream.pages) >= self.stream.most:
            return 4409, f"{self.stream.most} pages are open already: close one"
        return None

    async def _listen(self, ws: Any, page: Page) -> None:
        """Handle the messages of a page, unless they are too many or malformed."""
        budget, then, wrong = BURST, time.monotonic(), 0
        while (got := await ws.receive())["type"] == "websocket.receive":
            now = time.monotonic()
            budget, then = min(BURST, budget + (now - then) * RATE) - 1, now
            if budget < 0:
                return page.close(4429, "too many messages")
            try:
                said = self.stream.message(got.get("text") or got.get("bytes") or b"")
            except BadValue as e:
                wrong += 1
                if wrong > WRONG:
                    return page.close(4400, "messages are not understood")
                page.tell({"is": "error", "about": "", "text": str(e)})
                continue
            self.stream.do(page, said)

    async def _speak(self, ws: Any, page: Page) -> None:
        """Send queued messages: texts before the samples that they describe."""
        while True:
            await page.wake.wait()
            page.wake.clear()
            while page.texts:
                await ws.send_text(page.texts.popleft()[1])
            while page.blocks:
                await ws.send_bytes(page.blocks.popleft())
                await asyncio.sleep(0)  # or a lost connection is not seen in between


def _listen(host: str, port: int) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        made = socket.create_server((host, port), family=family)
    except (OSError, OverflowError, TypeError) as e:
        why = getattr(e, "strerror", None) or e
        raise SinkError(
            f"cannot listen at {repr(host)[1:-1]}, port {port}: {why}; --port 0 takes a free one"
        ) from None
    # or a block waits until the one before is acknowledged
    made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return made


@contextmanager
def _closed_terminal_ends() -> Iterator[None]:
    """Let SIGHUP end the server like SIGTERM, with a fade and a complete log.

    Under ``nohup``, SIGHUP is still ignored.
    """
    hup: Any = getattr(signal, "SIGHUP", None)
    ours = (
        hup
        and threading.current_thread() is threading.main_thread()
        and signal.getsignal(hup) is signal.SIG_DFL
    )
    if ours:
        signal.signal(hup, lambda *_: signal.raise_signal(signal.SIGTERM))
    try:
        yield
    finally:
        if ours:
            signal.signal(hup, signal.SIG_DFL)


async def _bye(ws: Any, code: int, why: str) -> None:
    """Close a connection, even if it is already closed or unresponsive."""
    from starlette.websockets import WebSocketDisconnect

    with suppress(RuntimeError, WebSocketDisconnect, TimeoutError):
        await asyncio.wait_for(ws.close(code, why), 1.0)
