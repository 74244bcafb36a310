"""The front end of an experiment on a browser page.

It decides what a participant may see, and receives the answers.

Page and server talk over the WebSocket of `stimlib.live.protocol`: the same ``hello``,
limits and codes of closing. After it

=========== ============================ ===============================================
page: do    fields                       meaning
=========== ============================ ===============================================
answer      number, text                 to the state of that number: a key, or a line;
                                         taken once
drawn       number, wide, high, boxes    how large the window is, and the boxes of what
                                         answers the question of that number, in CSS
                                         pixels: list of [key, left, top, width, height]
=========== ============================ ===============================================

=========== ============================ ===============================================
server: is  fields                       meaning
=========== ============================ ===============================================
hello       version, texts               first message; texts: the page's own, as
                                         `..experiments.texts.Texts`
state       number, phase, trial, told,  after hello and after every change. trial:
            since                        "Trial 3 of 40, for training"; told: texts;
                                         since: seconds since it began. phase: ``wait``;
                                         ``ask`` with the fields of
                                         `..experiments.answer_keys.Prompt`, keys and
                                         apart as lists of [key, what it says]; ``rest``
                                         with seconds; ``feel`` with intervals (list of
                                         [begin, end] in s) and cursor (Hz of a
                                         reference to follow, or null), as ``ask`` has
                                         of a self-paced stimulus; ``end``
alive                                    twice a second: the page waits for no answer
                                         of a server that has gone
error       about, text                  the answer is rejected, and why
=========== ============================ ===============================================

Nothing else is sent: no condition, level, parameter, seed or right answer. The server
closes with 4409 when another page was opened, and with 4410 at the end.
"""

from __future__ import annotations

import asyncio
import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

from ..devices.process import signals_wait
from ..devices.sink import Sink
from ..errors import SinkError
from ..experiments.answer_keys import Keyed, Prompt
from ..experiments.experiment import Experiment
from ..experiments.presentation import present, spans
from ..experiments.questions import LONGEST
from ..experiments.texts import Texts
from ..experiments.trial import Trial
from ..system import fields, safe_files
from . import protocol
from .site import Page

LAYOUTS = 300
"""Largest number of lines in the log of layouts for each trial."""
_PIXELS = fields.between(-1e6, 1e6)
FIELDS = {
    "hello": protocol.FIELDS["hello"],
    "answer": {
        "number": fields.whole(2**53),
        "text": fields.Test(
            f"a text of at most {LONGEST} characters",
            lambda v: isinstance(v, str) and len(v) <= LONGEST,
        ),
    },
    "drawn": {
        "number": fields.whole(2**53),
        "wide": _PIXELS,
        "high": _PIXELS,
        "boxes": fields.Test(
            "a list of boxes [key, left, top, width, height]",
            lambda v: (
                isinstance(v, list)
                and all(isinstance(b, list) and len(b) == 5 and fields.text(b[0]) for b in v)
                and all(_PIXELS(x) for b in v for x in b[1:])
            ),
        ),
    },
}
ALIVE = 0.5
"""Seconds between signs of life."""
NOTHING: tuple[float, dict[str, Any]] = 0.0, {"intervals": [], "cursor": None}
GOODBYE = 2.0
"""Seconds within which a page must accept its last texts."""


class ExperimentPage(Keyed):
    """The front end of a session on a browser page, for `stimlib.experiments.run`.

    It is also the site that a `stimlib.live.server.Server` serves.

    The session runs in a thread that waits here for answers; pages belong to the
    server's event loop. Only the newest page counts: a page opened later, for instance
    after a lost connection, closes the earlier one. Texts are sent unchanged, and a
    page shows them as text, not as HTML.

    Parameters
    ----------
    note : callable
        ``note(text)`` reports the progress to the experimenter; called from both
        threads.
    texts : Texts, optional
        The texts for the participant; English by default.
    log : path, optional
        File to which a line of JSON is added when a question is drawn in a new way: the
        size of the window, and the boxes of the buttons, in order; at most ``LAYOUTS``
        lines in each trial.

    Examples
    --------
    See ``docs/howto/experiments.rst``.
    """

    title, index = "experiment", "ask.html"
    # pages that were lost may still seem open; four bytes a character
    most, longest = 8, 4 * LONGEST + 1024

    def __init__(
        self, note: Callable[[str], None], texts: Texts = Keyed.texts, log: Path | None = None
    ):
        self.pages: list[Page] = []
        self._note, self._log, self.texts = note, log, texts
        self._drawn: dict[str, Any] = {}  # how each question was drawn last
        self._layouts = LAYOUTS  # that the log may still take in this trial
        self._changed = threading.Condition()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._over = False
        self._number, self._since = 0, time.monotonic()
        self._known = 0  # number that the page was told last
        self._state: dict[str, Any] = {"phase": "wait"}
        self._trial = ""
        self._told: list[str] = []
        self._said: str | None = None
        self._sink: Sink | None = None  # while a stimulus is there
        self._missed = False
        self._during: tuple[float, dict[str, Any]] = NOTHING  # since when, and what is there

    @contextmanager
    def _held(self) -> Iterator[None]:
        """Hold the lock, from the session's thread.

        Otherwise Ctrl-C between acquiring the lock and entering ``with`` would never
        release it.
        """
        with signals_wait(), self._changed:
            yield

    # The front end: the session's thread ----------------------------------------------
    def tell(self, text: str) -> None:
        """Show a text until the next answer."""
        self._told = [*self._told, text]

    def rest(self, seconds: float) -> None:
        """Wait for a rest, regardless of what the page does."""
        self._note(f"rest of {round(seconds)} s")
        self._become("rest", seconds=seconds)
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            time.sleep(left)

    def ready(self, text: str) -> None:
        """Wait for any key of the participant; show the experimenter the trial."""
        if text != self.texts("done"):  # which is of the same trial
            self._trial, self._layouts = text, LAYOUTS
        self._note(text)
        super().ready(text)

    def read(self, prompt: Prompt) -> str:
        """Return the first answer to a prompt.

        Raises
        ------
        SinkError
            The server has ended.
        """
        keys, apart = ([[k, says] for k, says in d.items()] for d in (prompt.keys, prompt.apart))
        (began, shown), now = self._during, time.monotonic()
        left = [[began + t - now for t in ab] for ab in shown["intervals"]]
        self._become(
            "ask", **{**vars(prompt), "keys": keys, "apart": apart, **shown, "intervals": left}
        )
        while (said := self._waited()) is None:
            if self._over:
                raise SinkError("the server of the page has ended before the session")
        self._told = []
        self._become("wait")
        return said.strip()

    def _waited(self) -> str | None:
        """Return the answer if it comes within a short wait, so that Ctrl-C works."""
        with self._held():
            if self._said is None and not self._over:
                self._changed.wait(0.2)
            return self._said

    def display(
        self, experiment: Experiment, sink: str, **options: Any
    ) -> Callable[[Trial, Path], dict[str, Any]]:
        """Return the function that displays trials, to pass to ``run`` as its sink.

        The page shows when there is something to feel; if the page goes away, the
        stimulus fades out.

        Parameters
        ----------
        experiment : Experiment
        sink, **options
            As for `stimlib.experiments.presentation.present`.
        """

        def show(trial: Trial, folder: Path, **paced: Any) -> dict[str, Any]:
            times = [[a / experiment.fs, b / experiment.fs] for a, b in spans(experiment, trial)]
            cursor, t = experiment.cursor and experiment.cursor.frequency, experiment.timing
            self._missed = False

            def shows(phase: str, intervals: list[list[float]], **state: Any) -> None:
                self._during = time.monotonic(), {"intervals": intervals, "cursor": cursor}
                self._become(phase, **state | self._during[1])

            def began(playing: Sink) -> None:
                shows("feel", times if t.starts is None else [])
                with self._held():
                    self._sink = playing
                    self._missed = not self.pages
                if self._missed:
                    playing.stop()

            def started() -> None:
                if self._said is None:  # or it has ended
                    shows(**self._state | {"intervals": [[0.0, t.interval]]})

            try:
                found = present(
                    experiment, trial, sink, folder, began, **options | paced | {"started": started}
                )
            finally:
                self._during = NOTHING
                with self._held():
                    self._sink = None
            if not self._missed:
                return found
            self.tell(self.texts("missed"))
            super(ExperimentPage, self).ready(self.texts("again"))
            return found | {"missed": True}

        return show

    # The site: the server's event loop ------------------------------------------------
    def message(self, text: str | bytes) -> dict[str, Any]:
        """Parse and check a message from a page."""
        return protocol.message(text, FIELDS)

    def join(self, page: Page) -> None:
        """Send the state of the session to a page that has connected."""
        for other in self.pages:
            other.close(4409, "this session was opened on another page")
        self.pages.append(page)
        page.tell({"is": "hello", "version": protocol.VERSION, "texts": self.texts})
        self._tell(page)
        self._note("the page is open")

    def leave(self, page: Page) -> None:
        """Handle the loss of a page: a stimulus fades out, and the session waits."""
        self.pages.remove(page)
        with self._changed:
            sink = self._sink
            if self.pages or self._over:
                return
            self._missed = self._missed or sink is not None
        self._note("the page is gone: the session waits for it")
        if sink is not None:
            assert self._loop is not None
            self._loop.run_in_executor(None, sink.stop)

    def do(self, page: Page, message: dict[str, Any]) -> None:
        """Accept the first valid answer to a question; reject any other message."""
        with self._changed:
            why = self._refusal(page, message)
            if not why and message["do"] == "drawn":
                self._keep(message)
            elif not why:
                self._said = message["text"]
                self._changed.notify_all()
        if why:
            page.tell({"is": "error", "about": message["do"], "text": why})

    def _refusal(self, page: Page, message: dict[str, Any]) -> str:
        """Return the reason for rejecting a message, or an empty text."""
        if message["do"] == "hello":
            return "hello is said once, as the first word"
        if page is not self.pages[-1]:
            return "this session was opened on another page"
        if (
            message["number"] != self._number
            or self._state["phase"] != "ask"
            or self._said is not None
        ):
            return "nothing is asked now, or it was answered"
        keys = [key for key, _ in (*self._state["keys"], *self._state["apart"])]
        good = message["do"] == "drawn" or self._state["line"] or message["text"] in keys
        return "" if good else "there is no such key"

    def _keep(self, message: dict[str, Any]) -> None:
        """Add to the log how a question is drawn, if that is new and it has room."""
        text, drawn = self._state["text"], {k: message[k] for k in ("wide", "high", "boxes")}
        if self._log is None or not self._layouts or self._drawn.get(text) == drawn:
            return
        self._drawn[text], self._layouts = drawn, self._layouts - 1
        line = json.dumps({"time": time.time(), "trial": self._trial, "text": text} | drawn) + "\n"
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT
        with suppress(OSError), open(safe_files.opened(self._log, flags), "ab") as f:
            f.write(line.encode())  # unless the disk is full, or it is no file of stimlib's own

    async def run(self) -> None:
        """Send signs of life until the server ends."""
        self._loop = asyncio.get_running_loop()
        try:
            while True:
                for page in self.pages:
                    page.tell({"is": "alive"})
                await asyncio.sleep(ALIVE)
        finally:
            with self._changed:
                self._over = True
                self._changed.notify_all()

    # What a page is told --------------------------------------------------------------
    def _become(self, phase: str, **more: Any) -> None:
        with self._held():
            self._number, self._since, self._said = self._number + 1, time.monotonic(), None
            self._state = {"phase": phase} | more
            if self._loop is not None and not self._over:
                self._loop.call_soon_threadsafe(self._spread)

    def _now(self) -> dict[str, Any]:
        with self._changed:
            state = {
                "is": "state",
                "number": self._number,
                "trial": self._trial,
                "told": self._told,
            }
            return state | {"since": time.monotonic() - self._since} | self._state

    def _tell(self, page: Page) -> None:
        now = self._now()
        self._known = now["number"]
        page.tell(now)

    def _spread(self) -> None:
        # said again it would look as if an answer had not been taken
        if self.pages and self._number > self._known:
            self._tell(self.pages[-1])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: Any, *_: object) -> None:
        """Send the page its last texts and end it."""
        if kind is not None:
            self.tell(self.texts("stopped"))
        elif self._told:
            self._note(self._told[-1])
        self._become("end")
        if self._loop is not None and not self._over:
            asyncio.run_coroutine_threadsafe(self._goodbye(), self._loop).result(2 * GOODBYE)

    async def _goodbye(self) -> None:
        self._over = True
        end = time.monotonic() + GOODBYE
        while any(page.texts for page in self.pages) and time.monotonic() < end:
            await asyncio.sleep(0.01)
        for page in self.pages:
            page.close(4410, "the session has ended")
