"""The content that a server serves, and the connection of one page."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Mapping
from typing import Any, Protocol

from .protocol import PATIENCE, SILENT

WAITING = 64
"""Largest number of messages queued for a page: a quarter of a second of samples;
beyond that the oldest are skipped.
"""


class Page:
    """The connection of one page, with its queue of messages."""

    def __init__(self) -> None:
        self.name = ""  # what the page calls itself, the same after it was loaded again
        self.texts: deque[tuple[str, str]] = deque(maxlen=WAITING + 1)  # what each is, and itself
        self.blocks: deque[bytes] = deque(maxlen=WAITING)
        self.wake = asyncio.Event()
        self.skipped = 0
        self.greeted: Any = None  # what it knows of the scene
        self.silent = self.longest = 0.0  # s since its last message, and the longest so far
        self.ended = asyncio.Event()
        self.end = 1000, ""  # the code and the reason with which it is closed

    def tell(self, message: Mapping[str, Any]) -> None:
        """Send a text; a new state replaces one that is still queued.

        A page that reads nothing is disconnected, so that the queue cannot grow.
        """
        if self.texts and message["is"] == "state" == self.texts[-1][0]:
            self.texts.pop()
        self.texts.append((message["is"], json.dumps(message, allow_nan=False)))
        self.wake.set()
        if len(self.texts) > WAITING:
            self.close(4408, "this page reads nothing")

    def hear(self) -> None:
        """Record that a message of the page has arrived."""
        self.longest, self.silent = max(self.longest, self.silent), 0.0

    def wait(self, seconds: float) -> None:
        """Add to the time without a message; close the page when it is too long.

        A machine that was late before, and whose page came back, may be so again.
        """
        self.silent += seconds
        if self.silent > min(max(SILENT, 2 * self.longest), PATIENCE):
            self.close(4408, "no answer from this page")

    def close(self, code: int, why: str) -> None:
        """End the connection of the page."""
        if not self.ended.is_set():
            self.end = code, why
            self.ended.set()

    def put(self, data: bytes) -> None:
        """Send samples; drop the oldest block, and count it, if the page is behind."""
        self.skipped += len(self.blocks) == WAITING
        self.blocks.append(data)
        self.wake.set()


class Site(Protocol):
    """The pages connected to a server, handled in the server's event loop.

    Attributes
    ----------
    title : str
    index : str
        File of ``stimlib/live/page`` that is served as the page.
    most : int
        Maximum number of open pages.
    longest : int
        Maximum size of a message from a page, in bytes.
    pages : list of Page
    """

    title: str
    index: str
    most: int
    longest: int
    pages: list[Page]

    def message(self, text: str | bytes) -> dict[str, Any]:
        """Parse and check a message from a page; raise BadValue if it is invalid."""

    def join(self, page: Page) -> None:
        """Accept a page that has sent a valid hello."""

    def leave(self, page: Page) -> None:
        """Remove a page that has disconnected."""

    def do(self, page: Page, message: dict[str, Any]) -> None:
        """Carry out a message of a page."""

    async def run(self) -> None:
        """Run from the server's start until the server cancels this task at its end."""
