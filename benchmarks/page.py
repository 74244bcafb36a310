"""How late the live page is: from the pointer to the drawn data and to the audio
buffer, in a headless Chromium, null sound card.

    PYTHONPATH=tests python benchmarks/page.py                20 s each
    PYTHONPATH=tests python benchmarks/page.py --seconds 300
    PYTHONPATH=tests python benchmarks/page.py --record       and keep the figures
    PYTHONPATH=tests python benchmarks/page.py --soak 1200    beside a busy loop, the
                                                              server 2000 ppm slow
    PYTHONPATH=tests python benchmarks/page.py --drawing      of an experiment's page

They are kept in results/page.csv, those of a soak in results/page_soak.csv.  The
server's clock is right, 2000 ppm slow, and 2000 ppm fast.

A finger is dragged over six bumps, 125 moves a second, while the voltage is heard.
Times are from the event's own stamp, without the filter behind the reports.

A soak has one server and a program that computes without end (unless --idle).  Every
minute (at least ten times) it prints the load of the machine, underruns of the server,
gaps in the sound and why, its queue, latencies, and memory: of the server, of
all of the browser, and of the page's objects.  Latencies are those of the last thousand
moves.

Of drawing, it measures how long a picture of a soft surface takes on the page of an
experiment, under three avatars that press it deeply and move: by the script, and with
the painting of its pixels; and the time from picture to picture.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from bench import Row, machine, options, row, save
from live.chromium import Browser, where

MOVES = 125  # a second
PACES = {"right": 1.0, "2000 ppm slow": 0.998, "2000 ppm fast": 1.002}


def serve(pace: float) -> None:
    """A server whose clock is another; its address is printed."""
    from stimlib.live import inputs, sink
    from stimlib.live.server import Server
    from stimlib.live.stream import Stream
    from stimlib.scenes import bumps

    if pace != 1:
        sink.time = inputs.time = SimpleNamespace(
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


def begun_on(server, browser):
    """A page of a server that runs, heard, once the sound's step is steered."""
    page = browser.page(server.stdout.readline().strip())
    page.until("document.querySelector('#run')?.disabled === false")
    page.click("#sound")
    page.click("#run")
    drag(page, 5.0)
    return page


def session(browser, pace: float, seconds: float) -> dict:
    """What the page and its audio thread say of one server."""
    server = subprocess.Popen(
        [sys.executable, __file__, "--serve", str(pace)], stdout=subprocess.PIPE, text=True
    )
    try:
        page = begun_on(server, browser)
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


def resident(pid: int, group: bool = False) -> float:
    """MiB of a process, or of all that it began as a group."""
    pages = 0
    for name in map(int, filter(str.isdigit, os.listdir("/proc"))) if group else [pid]:
        try:
            if not group or os.getpgid(name) == pid:
                pages += int(Path(f"/proc/{name}/statm").read_text().split()[1])
        except OSError:  # it has ended
            pass
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


ASKED = """import('./live.js').then(({live}) => {
    const {drawn, sound, report} = live, {played, gaps, causes, figures} = sound;
    const found = {drawn: [...drawn], heard: [...played], gaps, causes, figures, report};
    drawn.length = played.length = 0;
    return found; })"""


def soak(seconds: float, idle: bool) -> list[Row]:
    """A session of so many seconds, beside a busy loop: what it comes to, over time."""
    if where() is None:
        return [row("Chromium is not installed")]
    rows: list[Row] = []
    busy = subprocess.Popen([sys.executable, "-c", "pass" if idle else "while True: pass"])
    pace = str(PACES["2000 ppm slow"])
    server = subprocess.Popen(
        [sys.executable, __file__, "--serve", pace], stdout=subprocess.PIPE, text=True
    )
    browser = Browser()
    try:
        page = begun_on(server, browser)
        page.js(ASKED)
        begun, part = time.monotonic(), min(60.0, seconds / 10)
        while time.monotonic() - begun < seconds - part / 2:
            drag(page, part)
            found, at = page.js(ASKED), f"{(time.monotonic() - begun) / 60:.1f} min"
            memory = [
                resident(server.pid),
                resident(browser.process.pid, group=True),
                page.call("Runtime.getHeapUsage")["usedSize"] / 2**20,
            ]
            why = ", ".join(f"{cause} {n}" for cause, n in found["causes"].items())
            report = found["report"]
            audio = found["figures"]
            rows += [
                row(f"{at}: load of the machine", f"{os.getloadavg()[0]:.1f}", "processes"),
                row(f"{at}: underruns of the server, in all", report["underruns"], "times"),
                row(f"{at}: lost by the server, in all", report["lost"], "samples"),
                row(f"{at}: gaps in the sound, in all", found["gaps"], "times"),
                row(f"{at}: why", why or "none", "times"),
                row(f"{at}: queue of the sound", round(1e3 * audio["depth"]), "ms"),
                row(f"{at}: step of the sound", round(audio["ratio"], 5), "times"),
            ]
            for what in ("drawn", "heard"):
                p50, p99 = np.percentile(found[what] or [math.nan], [50, 99])
                rows += [row(f"{at}: pointer to {what}, 50 and 99 %", f"{p50:.0f} {p99:.0f}", "ms")]
            server_browser_heap = " ".join(f"{m:.0f}" for m in memory)
            rows += [row(f"{at}: server, browser, page's objects", server_browser_heap, "MiB")]
            for r in rows[-10:]:
                print(r["what"], r["value"], r["unit"], flush=True)
        page.close()
    finally:
        browser.close()
        for process in (server, busy):
            process.terminate()
            process.wait()
    return rows


TIMED = """import('./ask.js').then(({field}) => {
    window.times = [], window.whole = [], window.painting = false;
    const draw = field.draw, g = field.canvas.getContext('2d');
    field.draw = (colours, values) => {
        if (!values) return;
        const begun = performance.now();
        draw.call(field, colours, values);
        if (!painting) { times.push([begun, performance.now() - begun]); return; }
        g.getImageData(0, 0, 1, 1); // waits until the pixels are there
        whole.push(performance.now() - begun);
    };
})"""


def drawing(seconds: float) -> list[Row]:
    """How long pictures take on the page of an experiment, in two windows."""
    if where() is None:
        return [row("Chromium is not installed")]
    sys.path.remove(str(Path(__file__).parent))  # whose experiments.py is not that of the tests
    from live.asked import asked
    from live.drawn import seen

    from stimlib.experiments.experiment import Timing
    from stimlib.run.safety import Safety
    from stimlib.scenes import soft_surface

    scale = {f"{name}{k}": 0.14 for name in ("x", "y", "depth") for k in "123"}
    made = seen(
        scenes=dict.fromkeys(("soft", "hard"), soft_surface("multipoint")),
        safety=Safety(scale | {"force": 10.0}),
        timing=Timing(interval=seconds, gap=0.1, before=0.0),
    )
    rows, browser = [], Browser()
    try:
        for wide, high in ((1440, 900), (390, 844)):
            with tempfile.TemporaryDirectory() as data, asked(data, made, "page") as running:
                page = browser.page(running.server.url, wide, high)
                page.js(TIMED)
                page.until("document.querySelector('#keys button:enabled') !== null")
                time.sleep(0.3)
                page.key(" ")
                for k in (1, 2):
                    page.until(f"document.querySelector('#clock').textContent === '{k} of 2'")
                    page.js(f"painting = {str(k == 2).lower()}")
                    press(page, 0.9 * seconds)
                times, whole = page.js("[times, whole]")
                page.close()
            begun, script = np.array(times).T
            for name, of in (
                ("script of a picture", script),
                ("picture with its pixels", whole),
                ("from picture to picture", np.diff(begun)),
            ):
                p50, p99 = np.percentile(of, [50, 99])
                what = f"{wide} x {high}: {name}, 50 and 99 %, of {len(of)}"
                rows.append(row(what, f"{p50:.1f} {p99:.1f}", "ms"))
    finally:
        browser.close()
    return rows


def press(page, seconds: float) -> None:
    """A pen goes round and presses as deeply as it can."""
    left, top, wide, high = page.box("#picture")
    begun, kind = time.monotonic(), "Pressed"
    while (t := time.monotonic() - begun) < seconds:
        at = (
            left + wide * (0.5 + 0.15 * math.cos(3 * t)),
            top + high * (0.5 + 0.15 * math.sin(3 * t)),
        )
        page.mouse(kind, *at, "pen", 1.0)
        kind = "Moved"
        time.sleep(1 / MOVES)
    page.mouse("Released", left + 0.5 * wide, top + 0.5 * high, "pen")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--serve"]:
        serve(float(sys.argv[2]))
    else:
        parser = options(__doc__, None)
        parser.add_argument("--seconds", type=float, default=20.0)
        parser.add_argument("--soak", type=float, default=0.0, metavar="SECONDS")
        parser.add_argument("--idle", action="store_true")
        parser.add_argument("--drawing", action="store_true")
        given = parser.parse_args()
        name = "page_soak" if given.soak else "page_drawing" if given.drawing else "page"
        short = drawing if given.drawing else measure
        rows = soak(given.soak, given.idle) if given.soak else short(given.seconds)
        save(name, [row(machine()), *rows], given.record)
