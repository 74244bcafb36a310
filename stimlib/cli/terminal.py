"""The terminal front end of an experiment: texts, and answers by keyboard."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any

from ..errors import SinkError, shown
from ..experiments.answer_keys import Keyed, Prompt
from ..experiments.texts import Texts
from ..system.progress import progress

termios: Any = None  # which Windows has not
with suppress(ImportError):
    termios = import_module("termios")
_ENDED = "the input has ended before the session"


class Terminal(Keyed):
    """A front end that reads lines from a file, or keys from a terminal.

    Parameters
    ----------
    fd : int
        The terminal whose keys are read; if below 0, lines are read from stdin.
    keys, lines : list
        Terminal attributes (termios): ``keys`` while no question or a single key is
        awaited, ``lines`` while a line is typed.
    texts : Texts, optional
        The texts for the participant; English by default.
    """

    def __init__(
        self,
        fd: int = -1,
        keys: list[Any] | None = None,
        lines: list[Any] | None = None,
        texts: Texts = Keyed.texts,
    ):
        self._fd, self._keys, self._lines, self.texts = fd, keys, lines, texts

    def tell(self, text: str) -> None:
        """Print a text on a line of its own."""
        print(shown(text), flush=True)

    def rest(self, seconds: float) -> None:
        """Count down a rest; only ending the command can shorten it."""
        self.tell(self.texts("rest_for", seconds=round(seconds)))
        end = time.monotonic() + seconds
        with progress(self.texts("rest"), seconds) as advance:
            while (left := end - time.monotonic()) > 0:
                time.sleep(min(left, 1.0))
                advance(min(left, 1.0))

    def read(self, prompt: Prompt) -> str:
        """Return the key or the line with which the participant answers."""
        keys = ", ".join(
            f"{key or self.texts('any_key')} = {says}"
            for key, says in (*prompt.keys.items(), *prompt.apart.items())
            if says
        )
        asked = prompt.text + (f" ({prompt.hint})" if prompt.hint else ":" * ("" in prompt.keys))
        text = f"{asked} {keys}".rstrip()
        return self._line(text) if prompt.line else self._key(text)

    def _key(self, text: str) -> str:
        if self._fd < 0:
            return self._line(text)
        if termios is None:
            return _windows_key(text)
        termios.tcflush(self._fd, termios.TCIFLUSH)
        print(shown(text), flush=True)
        key = b""
        with suppress(OSError):  # the terminal has gone
            key = os.read(self._fd, 32)
        if key in (b"", b"\x04"):  # Ctrl-D
            raise SinkError(_ENDED)
        return key.decode(errors="replace").strip()

    def _line(self, text: str) -> str:
        _become(self._fd, self._lines)
        print(shown(text), flush=True)
        try:
            line = sys.stdin.readline()
        except UnicodeDecodeError:
            line = "\N{REPLACEMENT CHARACTER}"  # which is no answer
        finally:
            _become(self._fd, self._keys)
        if not line:
            raise SinkError(_ENDED)
        return line.strip()


def _windows_key(text: str) -> str:
    """Return the next key of the console; keys pressed earlier are ignored."""
    msvcrt = import_module("msvcrt")
    while msvcrt.kbhit():
        msvcrt.getwch()
    print(shown(text), flush=True)
    key = msvcrt.getwch()
    if key == "\x03":
        raise KeyboardInterrupt
    if key == "\x1a":  # Ctrl-Z
        raise SinkError(_ENDED)
    return key.strip()


@contextmanager
def terminal(texts: Texts = Keyed.texts) -> Iterator[Terminal]:
    """Yield the front end that reads from stdin.

    In a terminal, keys pressed while no question is open are neither shown nor used.
    The terminal's settings are restored at the end, after any error, and while Ctrl-Z
    suspends the command.
    """
    if not sys.stdin.isatty():
        yield Terminal(texts=texts)
        return
    fd = sys.stdin.fileno()
    if termios is None:
        yield Terminal(fd, texts=texts)
        return
    before, keys = termios.tcgetattr(fd), termios.tcgetattr(fd)
    keys[3] &= ~(termios.ECHO | termios.ICANON)
    # Ctrl-\\ would leave it so
    for which, code in ((termios.VMIN, 1), (termios.VTIME, 0), (termios.VQUIT, b"\0")):
        keys[6][which] = code

    stop: Any = getattr(signal, "SIGTSTP", None)

    def suspended(*_: Any) -> None:
        now = termios.tcgetattr(fd)
        _become(fd, before)
        signal.signal(stop, signal.SIG_DFL)
        signal.raise_signal(stop)  # here it stops, until it goes on
        signal.signal(stop, suspended)
        _become(fd, now)

    usual = signal.signal(stop, suspended)
    try:
        _become(fd, keys)
        yield Terminal(fd, keys, before, texts)
    finally:
        signal.signal(stop, usual)
        with suppress(termios.error):  # it has gone
            _become(fd, before)


def _become(fd: int, attributes: list[Any] | None) -> None:
    """Set the attributes of a terminal, if there is one.

    Earlier input is discarded; otherwise the shell would receive it.
    """
    if attributes is not None:  # as on Windows
        termios.tcflush(fd, termios.TCIFLUSH)
        termios.tcsetattr(fd, termios.TCSANOW, attributes)
