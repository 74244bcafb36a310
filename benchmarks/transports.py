"""Markers and motion over every transport at once, on loopback.

``python benchmarks/transports.py [SECONDS] > docs/explanation/transports.csv``: a
sink at 8 kHz marks every 50 ms to LSL, OSC, UDP and a pseudo terminal, and four sinks
at 1 kHz take 500 rows a second from each.
"""

from __future__ import annotations

import csv
import json
import os
import pty
import socket
import sys
import threading
import time
import tty

import numpy as np
import pylsl
from pythonosc import osc_message_builder, osc_packet

from stimlib import Input, Scene, constant
from stimlib.blocks import burst, every
from stimlib.devices import (
    NullSink,
    Stream,
    lsl_markers,
    lsl_motion,
    osc_markers,
    osc_motion,
    serial_markers,
    serial_motion,
    udp_markers,
    udp_motion,
)

PERIOD = 0.05


def listening() -> socket.socket:
    """Return a socket with a port of its own."""
    here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    here.bind(("127.0.0.1", 0))
    here.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    here.settimeout(1.0)
    return here


def terminal() -> tuple[int, str]:
    """Return a descriptor and the name of the port at its other end."""
    here, port = pty.openpty()
    tty.setraw(port)
    return here, os.ttyname(port)


def markers(seconds: float) -> list[list[object]]:
    """Return a row for each transport of markers."""
    name = f"stimlib {os.getpid()}"
    udp, osc, (fd, port) = listening(), listening(), terminal()
    sends = {
        "LSL": lsl_markers(name),
        "OSC": osc_markers(*osc.getsockname()),
        "UDP": udp_markers(*udp.getsockname()),
        "serial": serial_markers(port, {"onset": 1}),
    }
    (found,) = pylsl.resolve_byprop("name", name, timeout=20.0)
    inlet = pylsl.StreamInlet(found)
    inlet.open_stream(timeout=20.0)
    ahead = pylsl.local_clock() - time.monotonic()
    got: dict[str, list[tuple[float, float]]] = {what: [] for what in sends}
    over = threading.Event()

    def hear(what, receive):
        while not over.is_set():
            if (stamp := receive()) is not None:
                got[what].append((time.monotonic(), stamp))

    def from_lsl():
        row, at = inlet.pull_sample(timeout=0.5)
        return None if row is None else at - ahead

    def from_socket(here, stamp):
        try:
            return stamp(here.recv(65536))
        except TimeoutError:
            return None

    hears = {
        "LSL": from_lsl,
        "OSC": lambda: from_socket(
            osc, lambda data: osc_packet.OscPacket(data).messages[0].message.params[3]
        ),
        "UDP": lambda: from_socket(udp, lambda data: json.loads(data)["time"]),
        "serial": lambda: float("nan") if os.read(fd, 1) == b"\x01" else None,
    }
    threads = [threading.Thread(target=hear, args=row, daemon=True) for row in hears.items()]
    for thread in threads:
        thread.start()
    told = []
    scene = Scene({"force": constant(1.0, "N"), "onset": burst(every(PERIOD), 0.005)})
    sink = NullSink(
        scene,
        {"force": 2.0, "onset": 1.0},
        realtime=False,
        markers=["onset"],
        send=[told.append, *sends.values()],
    )
    with sink:
        sink.open(8000, ["force"])
        sink.start(seconds)
        sink.wait()
    time.sleep(1.0)
    over.set()
    report = sink.report()
    stamps = np.array([m.time for m in told])
    off = stamps - np.arange(len(stamps)) * PERIOD
    off -= np.median(off)
    stated = max(m.uncertainty for m in told[10:])
    print(
        f"markers {report.markers}, lost {report.lost_markers}; samples {report.produced}, lost"
        f" {report.lost}; stamps within {1e6 * np.abs(off[10:]).max():.0f} us of a line, stated"
        f" {1e6 * stated:.0f} us",
        file=sys.stderr,
    )
    rows = []
    for what, heard in got.items():
        late = [1e3 * (at - m.time) for (at, _), m in zip(heard, told, strict=False)]
        apart = [abs(stamp - m.time) for (_, stamp), m in zip(heard, told, strict=False)]
        worst = "" if what == "serial" else f"{1e6 * max(apart):.1f}"
        p50, p99 = np.percentile(late, [50, 99])
        rows.append(
            ["markers", what, len(told), len(heard), report.lost_markers]
            + [f"{p50:.1f}", f"{p99:.1f}", worst]
        )
    return rows


def motion(seconds: float) -> list[list[object]]:
    """Return a row for each transport of motion."""
    name, here, (fd, port) = f"stimlib hand {os.getpid()}", listening(), terminal()
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo(name, "MoCap", 1, 500.0, "double64", name))
    udp = udp_motion(0, timed=True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        osc_port = free.getsockname()[1]
    receives = {
        "LSL": lsl_motion(name),
        "OSC": osc_motion(osc_port, "/hand"),
        "UDP": udp,
        "serial": serial_motion(port, timed=True),
    }

    def send(k: int) -> None:
        x, at = 0.01 + 1e-6 * (k % 1000), time.monotonic()
        outlet.push_sample([x])
        message = osc_message_builder.OscMessageBuilder(address="/hand")
        message.add_arg(x)
        here.sendto(message.build().dgram, ("127.0.0.1", osc_port))
        text = f"{at} {x}\n".encode()
        here.sendto(text, ("127.0.0.1", udp.port))
        os.write(fd, text)

    scene = Scene({"force": constant(100.0, "N/m") * Input("x", "m")})
    sinks = {
        what: NullSink(
            scene, 50.0, realtime=False, motion=Stream(receive=receive, columns={"x": 0})
        )
        for what, receive in receives.items()
    }
    for sink in sinks.values():
        sink.open(1000)
    for sink in sinks.values():
        sink.start()
    began = time.monotonic()
    sent = round(500 * seconds)
    for k in range(sent):
        time.sleep(max(0.0, began + k / 500 - time.monotonic()))
        send(k)
    time.sleep(0.5)
    rows = []
    for what, sink in sinks.items():
        report = sink.report()
        jitter = f"{1e3 * report.jitter:.1f}" if report.jitter else ""
        rows.append(["motion", what, sent, report.rows, sent - report.rows, "", jitter, ""])
        sink.close()
    return rows


if __name__ == "__main__":
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(
        ["what", "transport", "sent", "received", "lost"]
        + ["50 % within (ms)", "99 % within (ms)", "stamps apart (us)"]
    )
    out.writerows(markers(seconds) + motion(seconds))
