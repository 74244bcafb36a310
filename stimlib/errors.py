"""The exceptions stimlib raises; each is also the built-in exception that a caller would expect."""


class StimlibError(Exception):
    """Base of every error that stimlib raises on purpose."""


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


class UnknownName(StimlibError, KeyError):
    """A name is missing, or is not one of those that exist."""

    def __str__(self) -> str:
        # KeyError shows the repr of its argument, which would put quotes around a whole sentence
        return Exception.__str__(self)
