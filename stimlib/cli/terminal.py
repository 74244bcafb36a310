"""The face of an experiment in a terminal: texts, and answers by keyboard."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any

import typer

from ..core.progress import progress
from ..errors import BadValue, SinkError, shown

if TYPE_CHECKING:
    from ..experiments.questions import Question
    from ..experiments.trial import Trial

REPLAY = "r"
_ENDED = "the input has ended before the session: all answers so far are kept, resume it"


class Terminal:
    """One key for an answer where stdin is a terminal, else one line of it, as from a file or a program."""

    def tell(self, text: str) -> None:
        """A text of its own line."""
        print(shown(text), flush=True)

    def rest(self, seconds: float) -> None:
        """Counts down; nothing but the end of the command cuts it short."""
        self.tell(f"Please rest for {round(seconds)} s.")
        end = time.monotonic() + seconds
        with progress("rest", seconds) as advance:
            while (left := end - time.monotonic()) > 0:
                time.sleep(min(left, 1.0))
                advance(min(left, 1.0))

    def ready(self, text: str) -> None:
        """Goes on with any key."""
        self._key(f"{text}: any key begins", "")

    def pick(self, names: list[str]) -> str | None:
        """A number for each stimulus, 0 begins the experiment."""
        text = ", ".join(f"{i} = {name}" for i, name in enumerate(names, 1))
        while True:
            key = self._key(f"Get to know the stimuli: {text}; 0 = begin", "0")
            if key == "0":
                return None
            if key.isdecimal() and 1 <= int(key) <= len(names):
                return names[int(key) - 1]

    def ask(self, trial: Trial, question: Question, replays: int) -> Any:
        """Until it is an answer; None for a replay."""
        more = f"; {REPLAY} = once more ({replays} left)" if replays > 0 and REPLAY not in question.keys else ""
        while True:
            text = self._answer(question, more)
            if more and text == REPLAY:
                return None
            try:
                value = _value(question, text)
                question.check(value)
                return value
            except BadValue as e:
                self.tell(str(e))

    def _answer(self, question: Question, more: str) -> str:
        if question.kind == "choice":
            keys = ", ".join(f"{k} = {c}" for k, c in zip(question.keys, question.choices, strict=True))
            return self._key(f"{question.text} {keys}{more}", "")
        if question.kind == "rating":
            ends = f"1 = {question.choices[0]}, {question.most} = {question.choices[1]}"
            read = self._key if question.most < 10 else self._line
            return read(f"{question.text} {ends}{more}", "")
        how = f"in order, of {' '.join(question.choices)}" if question.kind == "ranking" else "x y; x y"
        return self._line(f"{question.text} ({how}){more}", "")

    def _key(self, text: str, default: str) -> str:
        if not sys.stdin.isatty():
            return self._line(text, default)
        print(shown(text), flush=True)
        try:
            key = typer.getchar()  # drops what was hit before
        except EOFError:
            key = "\x04"
        if key == "\x03":
            raise KeyboardInterrupt
        if key == "\x04":
            raise SinkError(_ENDED)
        return key.strip() or default

    def _line(self, text: str, default: str) -> str:
        print(shown(text), flush=True)
        try:
            line = sys.stdin.readline()
        except UnicodeDecodeError:
            line = "\N{REPLACEMENT CHARACTER}"  # which is no answer
        if not line:
            raise SinkError(_ENDED)
        return line.strip() or default


def _value(question: Question, text: str) -> Any:
    """What was typed, as data; the question checks it."""
    if question.kind == "choice":
        return dict(zip(question.keys, question.choices, strict=True)).get(text, text)
    if question.kind == "rating":
        return int(text) if text.isdecimal() and len(text) < 9 else text
    if question.kind == "ranking":
        return text.split()
    try:
        return [[float(v) for v in place.split()] for place in text.split(";") if place.strip()]
    except ValueError:
        return text
