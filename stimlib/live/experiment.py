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
move        as of `stimlib.live.protocol`
pictures    number, wide, high, box,     samples that were drawn in the drawing of that
            samples                      number, one for each picture, and the box of
                                         the canvas: [left, top, width, height]
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
                                         [begin, end] in s), cursor (Hz of a reference
                                         to follow, or null) and drawing (below, or
                                         null), as ``ask`` has of a self-paced
                                         stimulus; ``end``
alive                                    twice a second: the page waits for no answer
                                         of a server that has gone
error       about, text                  the answer is rejected, and why
=========== ============================ ===============================================

drawing has a number of its own, views (what is drawn in each interval: ``view`` of
`stimlib.live.protocol` without what is hidden, or null), surface, cursor, beside and
marks as `stimlib.experiments.Drawing` has them, and sources (of a page that drives the
stimulus: as in the state of `stimlib.live.protocol`; else null). Meanwhile binary
messages come, little-endian float64: number of the drawing, index of the newest sample,
the interval that it is in, from 0 (-1: none), and the values that its view names.

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

import numpy as np

from ..devices.process import signals_wait
from ..devices.sink import Sink
from ..errors import SinkError
from ..experiments.answer_keys import Keyed, Prompt
from ..experiments.experiment import Drawing, Experiment
from ..experiments.presentation import present, spans
from ..experiments.questions import LONGEST, Question
from ..experiments.texts import Texts
from ..experiments.trial import Trial
from ..system import fields, safe_files
from . import protocol
from .describe import ranges_of, view_of
from .inputs import Inputs
from .sink import PageSink
from .site import Page

LAYOUTS = 300
"""Largest number of lines in the log of layouts for each trial."""
# of the smoothing in Hz of a pointer that drives a stimulus: 8 ms later. What is only
# seen needs no other delay, as the steps of a pointer are not felt
BANDWIDTH = 40.0
_PIXELS = fields.between(-1e6, 1e6)
FIELDS = {
    "hello": protocol.FIELDS["hello"],
    "move": protocol.FIELDS["move"],
    "pictures": {
        "number": fields.whole(2**53),
        "wide": _PIXELS,
        "high": _PIXELS,
        "box": fields.list_of(_PIXELS),
        "samples": fields.list_of(fields.whole(2**53)),
    },
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
NOTHING: tuple[float, dict[str, Any]] = 0.0, {"intervals": [], "cursor": None, "drawing": None}
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
        self._inputs: Inputs | None = None  # of a stimulus that the page drives
        self._felt, self._folder = 0, ""  # number of the newest stimulus, and its log
        self._views: list[tuple[int, int, Any]] = []  # what is drawn from a sample to another

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
        if text not in (self.texts("done"), self.texts("again")):  # which are of the same trial
            self._trial, self._layouts = text, LAYOUTS
        self._note(text)
        super().ready(text)

    def ask(self, trial: Trial, question: Question, replays: int) -> Any:
        """Ask a question; one after the last trial has no trial above it."""
        if not trial.stimuli:
            self._trial, self._layouts = "", LAYOUTS
        return super().ask(trial, question, replays)

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

        The page shows when there is something to feel, and draws it, see
        `stimlib.experiments.Drawing`; if the page goes away, the stimulus fades out.

        Parameters
        ----------
        experiment : Experiment
        sink, **options
            As for `stimlib.experiments.presentation.present`; or "page": a stimulus
            that is only seen. The pointer of the page is then its motion.
        """

        def show(trial: Trial, folder: Path, **paced: Any) -> dict[str, Any]:
            at = spans(experiment, trial)
            times = [[a / experiment.fs, b / experiment.fs] for a, b in at]
            cursor, t = experiment.cursor and experiment.cursor.frequency, experiment.timing
            self._missed, self._folder = False, folder.name

            def shows(phase: str, intervals: list[list[float]], **state: Any) -> None:
                drawing = self._drawing(experiment, trial)
                there = {"intervals": intervals, "cursor": cursor, "drawing": drawing}
                self._during = time.monotonic(), there
                self._become(phase, **state | self._during[1])

            def began(playing: Sink) -> None:
                self._felt, ramp = self._felt + 1, round(t.ramp * experiment.fs)
                shows("feel", times if t.starts is None else [])
                drawing = self._during[1]["drawing"]
                self._views = [
                    (a + ramp, b - ramp, v["values"] if v else ())
                    for (a, b), v in zip(at, drawing["views"] if drawing else (), strict=False)
                ]
                if self._views and sink != "page":
                    playing.watch(self._see)
                with self._held():
                    self._sink = playing
                    self._missed = not self.pages
                if self._missed:
                    playing.stop()

            def started() -> None:
                if self._said is None:  # or it has ended
                    shows(**self._state | {"intervals": [[0.0, t.interval]]})

            to = self._maker(experiment, trial) if sink == "page" else sink
            try:
                paced = options | paced | {"started": started}
                found = present(experiment, trial, to, folder, began, **paced)
            finally:
                self._during = NOTHING
                with self._held():
                    self._sink = self._inputs = None
            if self._missed:  # its motion may have gone with it
                return found | {"missed": True, "silent": ""}
            if why := found.get("silent"):
                self._note(why)
            return found

        return show

    def _maker(self, experiment: Experiment, trial: Trial) -> Callable[..., Sink]:
        """Return what makes the sink of a stimulus that the page drives."""
        scenes = [experiment.scenes[s.scene] for s in trial.stimuli]
        ranges = {name: r for scene in scenes for name, r in ranges_of(scene).items()}

        def made(scene: Any, safety: Any, motion: Any, **options: Any) -> Sink:
            inputs = self._inputs = Inputs(scene, experiment.fs, ranges, None, BANDWIDTH, 0.0)
            return PageSink(
                scene, safety, feed=inputs.columns, take=self._see, counted=inputs, **options
            )

        return made

    def _drawing(self, experiment: Experiment, trial: Trial) -> dict[str, Any] | None:
        """Return what the page is told of the drawing, or None if nothing is drawn."""
        drawn = experiment.drawing or Drawing(surface=False, cursor=False)
        views: list[Any] = [view_of(experiment.scenes[s.scene], s.params) for s in trial.stimuli]
        sources = self._inputs and self._inputs.sources  # a pointer needs a place to move in
        if sources is None and (experiment.drawing is None or not any(views)):
            return None
        views = [
            v and {k: v[k] for k in v if drawn.hidden or k not in ("levels", "hidden")}
            for v in views
        ]
        return {"number": self._felt, "views": views, "sources": sources} | vars(drawn)

    def _see(self, at: int, x: Any, y: Any) -> None:
        """Send the page what it draws of the newest sample, from a thread of the sink.

        While the stimulus fades in or out within its interval, that is nothing: the
        fade would move what is drawn.
        """
        sink, loop, n = self._sink, self._loop, at + y.shape[1] - 1
        if sink is None or loop is None or not self._views:
            return
        k = next((k for k, (a, b, _) in enumerate(self._views) if a <= n < b), -1)
        outputs = tuple(sink.scene.outputs)  # the first of them are on a channel
        row = [*x[:, -1], *(y[:, -1] * sink.safety.scales(outputs)[: len(y)])]
        now = dict(zip((*sink.proc.inputs, *outputs[: len(y)]), row, strict=True))
        values = [now[name] for name in self._views[k][2]] if k >= 0 else []
        with suppress(RuntimeError):  # the loop has just been closed
            data = np.array([self._felt, n, k, *values], "<f8").tobytes()
            for page in self.pages[-1:]:
                loop.call_soon_threadsafe(page.put, data)

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
        if message["do"] == "move":
            if (inputs := self._inputs) is not None and page is self.pages[-1]:
                inputs.move(**{k: v for k, v in message.items() if k != "do"})
            return  # or a stimulus has just ended
        with self._changed:
            why = self._refusal(page, message)
            if not why and message["do"] in ("drawn", "pictures"):
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
        if message["do"] == "pictures":
            return "" if message["number"] == self._felt else "no stimulus has this number"
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
        """Add to the log how a page is drawn, if that is new and it has room."""
        text = self._state["text"] if message["do"] == "drawn" else ""
        about = {"text": text} if text else {"log": self._folder}
        drawn = {k: v for k, v in message.items() if k not in ("do", "number")}
        if self._log is None or not self._layouts or self._drawn.get(text) == drawn:
            return
        self._drawn[text], self._layouts = drawn, self._layouts - 1
        line = json.dumps({"time": time.time(), "trial": self._trial} | about | drawn) + "\n"
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
