"""The exceptions stimlib raises; each is also the built-in exception that a caller would expect."""

import re

LONGEST = 4000  # letters of an error: it may quote what others wrote
_CONTROL = re.compile(r"[^\n\x20-\x7e\xa0-\U0010ffff]|[\u061c\u200b-\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def shown(text: object) -> str:
    """A text as it can be shown in a terminal or a page: control characters, and those that reorder a line, as their codes.

    Examples
    --------
    >>> from stimlib.errors import shown
    >>> shown("a\x1b[31mb")
    'a\\\\x1b[31mb'
    """
    return _CONTROL.sub(lambda m: ascii(m.group())[1:-1], str(text))


def shortened(value: object) -> str:
    """The repr of a value, at most 80 characters of it."""
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def said(text: str) -> str:
    """Return the text of an error as it can be shown: of a long one the beginning, and the end with the remedy."""
    text = shown(text)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 500]} [..] {text[-490:]}"


class StimlibError(Exception):
    """Base of every error that stimlib raises on purpose; its text may quote files of others, so it is fit to be shown."""

    def __str__(self) -> str:
        return said(super().__str__())


class BadValue(StimlibError, ValueError):
    """An argument has a value that cannot be used."""


class UnitError(BadValue):
    """Two quantities with different units meet."""


class RecordingError(BadValue):
    """A recording cannot be used as a motion; the message names file, row, column and remedy."""


class SceneError(StimlibError, ValueError):
    """The graph of a scene is wrong."""


class SceneFileError(SceneError):
    """A scene file cannot be read as a scene."""


class SinkError(StimlibError, OSError):
    """A device or a file cannot take, or give back, a stimulus."""


class FaultError(StimlibError, RuntimeError):
    """A processor stopped giving finite samples."""


class MissingPackage(StimlibError, ImportError):
    """Something needs a package that stimlib does not depend on; the message has the command that installs it."""


class UnknownName(StimlibError, KeyError):
    """A name is missing, or is not one of those that exist."""

    def __str__(self) -> str:
        # KeyError shows the repr of its argument, which would put quotes around a whole sentence
        return said(Exception.__str__(self))


def place(f: object) -> str:
    """File and line of a function, as an error begins."""
    code = getattr(f, "__code__", None)
    return f"{code.co_filename}:{code.co_firstlineno}: " if code else ""
