"""A handle on a spring, in a control loop of 1 kHz: a device on a serial line, or over
UDP.

python examples/control_loop.py [--device serial] [--seconds 10] [--watchdog 0.1]
[--realtime] [--times] [--plot FILE]

The device sends its position in m as a line of text in each period, and takes the force
in N as one.  The program plays the device too, in a thread: a handle of 0.2 kg with
some friction, pulled by a hand.
"""

import argparse
import itertools
import math
import os
import socket
import tempfile
import threading
import time

import stimlib
from stimlib.blocks import track, velocity, wall
from stimlib.devices import ControlLoop
from stimlib.files import read_log, replay
from stimlib.run import Safety


# [scene]
def scene() -> stimlib.Scene:
    """A wall at 10 mm, which pushes back."""
    x = stimlib.Input("x", "m")
    damping = stimlib.constant(2.0, "N*s/m") * velocity(track(x, bandwidth=50.0), cutoff=50.0)
    return stimlib.Scene({"force": -1.0 * (wall(x, k=800.0, at=0.010) + damping)})


# [devices]
class Udp:
    """The latest position over UDP, and the force back."""

    def __init__(self, port: int):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)

    def read(self):
        data = None
        try:
            while True:
                data = self.socket.recv(100)
        except BlockingIOError:
            return None if data is None else [float(data)]

    def write(self, force):
        self.socket.send(b"%.6f" % force[0])

    def close(self):
        self.socket.close()


class Serial:
    """The same, as lines on a serial port."""

    def __init__(self, path: str):
        self.fd, self.left = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK), b""

    def read(self):
        try:
            *lines, self.left = (self.left + os.read(self.fd, 4096)).split(b"\n")
        except BlockingIOError:
            return None
        return [float(lines[-1])] if lines else None

    def write(self, force):
        os.write(self.fd, b"%.6f\n" % force[0])

    def close(self):
        os.close(self.fd)


# [loop]
def play(device, seconds: float, **options) -> ControlLoop:
    safety = Safety(full_scale=10.0, slew=5000.0)  # N, N/s
    with ControlLoop(scene(), safety, device.read, device.write, **options) as loop:
        loop.open(rate=1000)
        loop.start(seconds)
        loop.wait()
    return loop


# [end]
def handle(get, put, over: threading.Event) -> None:
    """The device: a mass on which a hand pulls with a moving spring."""
    x = v = force = 0.0
    mass, hand, grip, friction = 0.2, 200.0, 8.0, 1.0
    began, step = time.monotonic(), 0.001
    for k in itertools.count():
        if over.is_set():
            return
        time.sleep(max(0.0, began + k * step - time.monotonic()))
        wish = 0.012 * (1 - math.cos(2 * math.pi * k * step))
        got = get()
        force = force if got is None else got
        v += step / mass * (hand * (wish - x) - (grip + friction) * v + force)
        x += step * v
        put(x)


def udp_handle(here, over: threading.Event) -> None:
    here.setblocking(False)
    there = []

    def get():
        force = None
        try:
            while True:
                data, address = here.recvfrom(100)
                there[:], force = [address], float(data)
        except BlockingIOError:
            return force

    handle(get, lambda x: there and here.sendto(b"%.9f" % x, there[0]), over)


def serial_handle(fd: int, over: threading.Event) -> None:
    os.set_blocking(fd, False)
    left = [b""]

    def get():
        try:
            *lines, left[0] = (left[0] + os.read(fd, 4096)).split(b"\n")
        except BlockingIOError:
            return None
        return float(lines[-1]) if lines else None

    def put(x):
        try:
            os.write(fd, b"%.9f\n" % x)
        except BlockingIOError:
            pass  # nobody has read for a while

    handle(get, put, over)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", choices=["udp", "serial"], default="udp")
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--watchdog", type=float, default=0.1, metavar="SECONDS")
    parser.add_argument("--realtime", action="store_true", help="with priority over others")
    parser.add_argument("--times", action="store_true", help="also print how late it was")
    parser.add_argument("--plot", metavar="FILE")
    options = parser.parse_args()
    here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    if options.device == "udp":
        here.bind(("127.0.0.1", 0))
        device = Udp(here.getsockname()[1])
        handle_of, other = udp_handle, here
    else:
        import tty

        fd, port = os.openpty()
        tty.setraw(port)
        device = Serial(os.ttyname(port))
        handle_of, other = serial_handle, fd
    over = threading.Event()
    played = threading.Thread(target=handle_of, args=(other, over))
    played.start()
    with tempfile.TemporaryDirectory() as folder:
        how = {"watchdog": options.watchdog, "realtime": options.realtime}
        loop = play(device, options.seconds, log=f"{folder}/a.stimlog", **how)
        over.set(), played.join()
        device.close(), here.close()
        log = read_log(f"{folder}/a.stimlog")
        x = log.motion[:, 0]
        held = 1e3 * x[len(x) // 4 :].max()
        print(f"a wall at 10 mm, and a hand that went to 24 mm: {'held' if held < 18 else 'lost'}")
        again = replay(log).matches
        print("replay:", "equal, bit for bit" if again else "DIFFERENT")
        if options.times:
            print(
                "late (50, 99, 99.9 %):",
                *(f"{1e6 * s:.0f} us" for s in loop.lateness(50, 99, 99.9)),
            )
            print("stretches missed:", len(loop.misses), "such as", *list(loop.misses)[:3])
    if options.plot:
        import matplotlib.pyplot as plt

        figure, axis = plt.subplots()
        axis.plot(1e3 * x)
        axis.set(xlabel="time (ms)", ylabel="position (mm)")
        figure.savefig(options.plot)


if __name__ == "__main__":
    main()
