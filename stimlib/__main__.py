"""Entry point of the command ``stimlib`` and of ``python -m stimlib``.

The process ends with the right exit status, whenever an interrupt or error comes.
"""

from __future__ import annotations

import gc
import io
import os
import signal
import sys

CTRL_C, PIPE = 128 + signal.SIGINT, 128 + getattr(signal, "SIGPIPE", 13)


def main() -> None:
    """Run the command line and end the process with its exit status.

    Nothing is printed on Ctrl-C (status 130) or when the reader of a pipe has gone
    (141).
    """
    try:
        _open_streams()
        # its threads wait at full speed between the small matrices of a command
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # a notebook's, which no picture here needs and its environment alone may have
        os.environ.pop("MPLBACKEND", None)
        if os.environ.get("COLUMNS") == "0":  # in which Rich prints nothing, not even errors
            del os.environ["COLUMNS"]
        gc.set_threshold(100_000)  # what a start makes stays; searching it takes 6 %
        try:
            from .cli import app_of  # most of the time of a start

            app_of(sys.argv[1:])()
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
    """Replace streams that were closed (``>&-``) by ones that discard what is written.

    A character that the terminal cannot encode is printed as its escape code.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _leave(status: int) -> None:
    """End the process and discard output that could not be printed.

    Python would try again and end with 120.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    sys.exit(status)


if __name__ == "__main__":
    main()
