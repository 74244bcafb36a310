"""How late the live page is: from the pointer to the drawn data and to the audio
buffer, in a headless Chromium, null sound card.

    PYTHONPATH=tests python benchmarks/page.py                20 s each
    PYTHONPATH=tests python benchmarks/page.py --seconds 300
    PYTHONPATH=tests python benchmarks/page.py --record       and keep the figures

They are kept in results/page.csv.  The server's clock is right, 2000 ppm slow, and
2000 ppm fast.

A finger is dragged over six bumps, 125 moves a second, while the voltage is heard.
Times are from the event's own stamp.
"""

from __future__ import annotations

import math
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
from bench import Row, machine, options, row, save
from live.chromium import Browser, where

MOVES = 125  # a second
PACES = {"right": 1.0, "2000 ppm slow": 0.998, "2000 ppm fast": 1.002}


def serve(pace: float) -> None:
    """A server whose clock is another; its address is printed."""
    from stimlib.live import sink
    from stimlib.live.server import Server
    from stimlib.live.stream import Stream
    from stimlib.scenes import bumps

    if pace != 1:
        sink.time = SimpleNamespace(
            perf_counter=lambda: pace * time.perf_counter(), sleep=lambda s: time.sleep(s / pace)
        )
    stream = Stream(bumps(contact=True), 8000.0, 400.0, title="bumps")
    server = Server(stream)
    stream.warm_up()
    print(server.url, flush=True)
    server.run()


def drag(page, seconds: float) -> None:
    """There and back, a stroke in 2 s."""
    left, top, wide, high = page.box("#field")
    begun, k = time.monotonic(), 0
    while (t := time.monotonic() - begun) < seconds:
        page.mouse(
            "Moved" if k else "Pressed",
            left + wide * (0.5 - 0.4 * math.cos(math.pi * t)),
            top + 0.5 * high,
        )
        k += 1
        time.sleep(max(0.0, k / MOVES - (time.monotonic() - begun)))
    page.mouse("Released", left + 0.5 * wide, top + 0.5 * high)


def session(browser, pace: float, seconds: float) -> dict:
    """What the page and its audio thread say of one server."""
    server = subprocess.Popen(
        [sys.executable, __file__, "--serve", str(pace)], stdout=subprocess.PIPE, text=True
    )
    try:
        page = browser.page(server.stdout.readline().strip())
        page.until("document.querySelector('#run')?.disabled === false")
        page.click("#sound")
        page.click("#run")
        drag(page, 5.0)  # until the step is steered
        page.js(
            "import('./live.js').then(({live}) => { live.drawn.length = live.sound.played.length ="
            " 0; })"
        )
        before = page.js("import('./live.js').then(({live}) => live.sound.figures)")
        drag(page, seconds)
        found = page.js(
            "import('./live.js').then(({live}) => ({drawn: live.drawn, heard: live.sound.played,"
            " audio: live.sound.figures, report: live.report}))"
        )
        found["under"] = found["audio"]["under"] - before["under"]
        page.close()
        return found
    finally:
        server.terminate()
        server.wait()


def measure(seconds: float) -> list[Row]:
    if where() is None:
        return [row("Chromium is not installed")]
    rows, browser = [], Browser()
    try:
        for name, pace in PACES.items():
            found = session(browser, pace, seconds)
            for what in ("drawn", "heard"):
                p50, p95, p99 = np.percentile(found[what], [50, 95, 99])
                rows += [row(f"{name}: pointer to {what}, median", p50, "ms")]
                rows += [
                    row(f"{name}: pointer to {what}, 95 and 99 %", f"{p95:.0f} {p99:.0f}", "ms")
                ]
            rows += [
                row(f"{name}: underruns of the sound in {seconds:g} s", found["under"], "times")
            ]
            rows += [row(f"{name}: samples lost by the server", found["report"]["lost"], "samples")]
            rows += [row(f"{name}: step of the sound", found["audio"]["ratio"], "times")]
    finally:
        browser.close()
    return rows


if __name__ == "__main__":
    if sys.argv[1:2] == ["--serve"]:
        serve(float(sys.argv[2]))
    else:
        parser = options(__doc__, None)
        parser.add_argument("--seconds", type=float, default=20.0)
        given = parser.parse_args()
        save("page", [row(machine()), *measure(given.seconds)], given.record)
