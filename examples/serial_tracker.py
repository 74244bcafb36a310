"""A hand from a serial port: a thread reads positions, and a soft material answers
them.

python examples/serial_tracker.py [--port /dev/ttyACM0] [--seconds 10] [--plot FILE]

The device writes one line per report, the position in um: "12345\\n".  Without --port
the program plays the device too, on a pseudo terminal (Linux, macOS).
"""

import argparse
import os
import tempfile
import threading
import time

import numpy as np

import stimlib
from stimlib.blocks import kelvin_voigt, track
from stimlib.devices import Live, NullSink
from stimlib.files import read_log, replay
from stimlib.motion import ramp_and_hold


def scene() -> stimlib.Scene:
    x = track(stimlib.Input("x", "m"), bandwidth=20.0)  # reports are stairs: no velocity without it
    return stimlib.Scene({"force": kelvin_voigt(x, k=300.0, b=2.0)})


# [reader]
def open_port(path: str, baud: int = 115200):
    """Something with readline(), which waits 0.1 s at most: of pyserial, or without it
    of the system (Linux, macOS).
    """
    try:
        import serial
    except ImportError:
        import termios
        import tty

        # at the port's own speed: stty -F PORT 115200
        tty.setraw(fd := os.open(path, os.O_RDONLY | os.O_NOCTTY))
        *mode, controls = termios.tcgetattr(fd)
        controls[termios.VMIN], controls[termios.VTIME] = 0, 1
        termios.tcsetattr(fd, termios.TCSANOW, [*mode, controls])
        return os.fdopen(fd, "rb")
    return serial.Serial(path, baud, timeout=0.1)


class Reader(threading.Thread):
    """Gives every report to the sink, one column each, until the session ends."""

    def __init__(self, port, sink):
        super().__init__(daemon=True)
        self.port, self.sink, self.reports, self.unreadable = port, sink, 0, 0

    def run(self):
        line = b""
        with self.port:
            while not self.sink.finished:
                line += self.port.readline()
                if not line.endswith(b"\n"):  # the rest of it comes later
                    continue
                try:
                    self.sink.push({"x": float(line) * 1e-6})  # in m
                    self.reports += 1
                except ValueError:  # the first line may begin anywhere
                    self.unreadable += 1
                line = b""


# [session]
def play(port: str, seconds: float, log: str) -> Reader:
    # JackSink, PortAudioSink: the same
    with NullSink(scene(), 20.0, motion=Live(), log=log) as sink:
        sink.open(rate=8000)  # compiles; nothing is felt yet
        reader = Reader(open_port(port), sink)
        reader.start()
        sink.start(seconds)
        sink.wait()
        reader.join()
    return reader


# [end]
def pretend(device: int, over: threading.Event) -> None:
    """A device of 200 reports a second: 10 mm in a quarter of a second, and held."""
    hand, start = ramp_and_hold(depth=0.01, rise=0.25), time.monotonic()
    while not over.wait(0.005):
        x = float(hand(np.array([time.monotonic() - start]))[0])
        os.write(device, f"{1e6 * x:.0f}\n".encode())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--port", help="of the device; without it the program plays one")
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument(
        "--plot", metavar="FILE", help="also draw the motion that was logged, and the force"
    )
    given = parser.parse_args()
    over = threading.Event()
    with tempfile.TemporaryDirectory() as log:
        if given.port is None:
            device, port = os.openpty()
            name = os.ttyname(port)
            threading.Thread(target=pretend, args=(device, over), daemon=True).start()
        reader = play(given.port or name, given.seconds, log)
        over.set()
        session = read_log(log)
        x = np.asarray(session.motion)[:, 0]
        print(
            f"{'many' if reader.reports > 10 * given.seconds else 'FEW'} reports; the hand ended"
            f" at {1000 * x[-1]:.2f} mm"
        )
        print(f"replay: {'equal, bit for bit' if replay(session).matches else 'DIFFERENT'}")
        if given.plot is not None:
            stimlib.render(session.scene, {"x": x}, fs=session.fs).plot().savefig(given.plot)


if __name__ == "__main__":
    main()
