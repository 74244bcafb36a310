"""The command ``stimlib``, and ``python -m stimlib``.

The process ends with the right status, whatever comes when.
"""

from __future__ import annotations

import io
import os
import signal
import sys

CTRL_C, PIPE = 128 + signal.SIGINT, 128 + getattr(signal, "SIGPIPE", 13)


def main() -> None:
    """Run the command line and end the process.

    It is quiet on Ctrl-C (130), and where the reader of a pipe went away (141).
    """
    try:
        _open_streams()
        try:
            from .cli import app  # most of the time of a start

            app()
        finally:
            sys.stdout.flush()  # or it is done where nobody can say that it failed
    except KeyboardInterrupt:
        _leave(CTRL_C)
    except BrokenPipeError:
        _leave(PIPE)
    except OSError as e:  # of stdout at its end, or of stderr
        try:
            print(f"error: cannot write what is printed: {e.strerror}", file=sys.stderr)
        finally:
            _leave(2)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is over


def _open_streams() -> None:
    """Make streams that are closed (``>&-``) take all and keep nothing.

    What a terminal's encoding lacks is shown as its code.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _leave(status: int) -> None:
    """End without what could not be printed.

    Python would try again and end with 120.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    sys.exit(status)


if __name__ == "__main__":
    main()
