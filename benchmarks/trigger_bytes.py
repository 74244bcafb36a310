"""Width and onset of bytes that return to 0, on a pseudo terminal and a stand-in port.

``python benchmarks/trigger_bytes.py [SECONDS]``: a session in real time marks every 50
ms.  The other end of the pseudo terminal takes the time of each byte that it reads; the
port takes the time of each byte that is put on its lines.
"""

from __future__ import annotations

import os
import pty
import sys
import threading
import time
import tty
from typing import Any

import numpy as np

from stimlib import Scene
from stimlib.blocks import burst, every
from stimlib.devices import NullSink, parallel_markers, serial_markers, transports

SCENE = Scene({"onset": burst(every(0.05), 0.005)})


def main(seconds: float) -> None:
    got: list[tuple[float, int]] = []

    def control(port: int, request: int, data: bytes = b"") -> None:
        """Stand for the driver ppdev."""
        if request == transports.DATA:
            got.append((time.monotonic(), data[0]))

    transports.control = control
    for name, make in (("serial", serial_markers), ("parallel", parallel_markers)):
        for width in (0.002, 0.005, 0.01):
            here, port = pty.openpty()
            tty.setraw(port)
            got.clear()

            def read(here: int = here) -> None:
                while (byte := os.read(here, 1)) != b"\xff":
                    got.append((time.monotonic(), byte[0]))

            reader = threading.Thread(target=read)
            reader.start()
            told: list[Any] = []
            with make(os.ttyname(port), {"onset": 1}, width=width) as send:
                with NullSink(SCENE, 1.0, markers=["onset"], send=[send, told.append]) as sink:
                    sink.open(48000, block=256)
                    sink.start(seconds)
                    sink.wait()
            os.write(port, b"\xff")
            reader.join()
            times, bytes_ = np.array(got).T
            up = np.flatnonzero(bytes_ == 1)
            ups, downs = times[up], times[up + 1]
            widths = 1e3 * (downs - ups - width)
            late = 1e3 * (ups - [m.time for m in told])
            print(
                f"{name}, {1e3 * width:g} ms: {len(ups)} of {len(told)} bytes; wider by"
                f" {np.median(widths):.2f} ms (median), {np.quantile(widths, 0.99):.2f} (99 %),"
                f" {widths.min():.2f} to {widths.max():.2f}; after its sample by"
                f" {np.median(late):.1f} ms (median), {np.quantile(late, 0.99):.1f} (99 %),"
                f" {late.min():.2f} to {late.max():.1f}"
            )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
