"""How long an edit takes: from saving a scene's file to the first sample of the new
version, on a device and on the live page in a headless Chromium.

    PYTHONPATH=tests python benchmarks/edits.py             print
    PYTHONPATH=tests python benchmarks/edits.py --record    and keep results/edits.csv

Fifty edits each, in turns: another constant; one more block, of a class that this
process has not compiled; and a mistake, after which the version before must play on.
The device is a thread that takes blocks of 64 frames at 8 kHz, as `play --watch` does
it; the page is that of `stimlib live`.  Each sample is kept: none may be beyond full
scale, and no step between two may be larger than the fade and the filters make it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from bench import Row, machine, options, row, save
from live.chromium import Browser, where

EDITS = 50
SCENE = """from stimlib import Scene, blocks, constant
from stimlib.blocks import carrier
def scene():
    y = {level} * (constant(1.0) + 0.2 * carrier(30.0))
    return Scene({{"y": {block}}})
"""
BLOCKS = (
    "blocks.lowpass(y, 150.0)", "blocks.first_order(y, 0.01)", "blocks.delay(y, samples=9)",
    "blocks.moving_average(y, 0.01)", "blocks.envelope_follower(y, 30.0)", "abs(y)",
    "blocks.lut(y, [-1, 0, 1], [-1, 0, 1])", "blocks.fir(y, [0.5, 0.5])",
    "blocks.maximum(y, 0.0)", "blocks.sqrt(y * y)", "blocks.track(y)", "blocks.exp(blocks.log(y))",
)  # fmt: skip
CLICK = 2 / 160
"""Largest step: two fades of full scale in 20 ms; the carrier itself takes less."""


def texts() -> list[tuple[str, str, float]]:
    """A kind of edit, the file after it, and its level; NaN for a mistake."""
    found = []
    for k in range(EDITS):
        level = 0.6 - 0.4 * (len([f for f in found if f[0] != "mistake"]) % 2) + 0.002 * k
        kind = ("constant", "block", "constant", "block", "mistake")[k % 5]
        block = BLOCKS[(k // 5 * 2 + k % 5 // 2) % len(BLOCKS)] if kind == "block" else "y"
        text = SCENE.format(level=level, block=block)
        if kind == "mistake":
            text = text.replace("carrier(30.0)", "carier(30.0)")
        found.append((kind, text, float("nan") if kind == "mistake" else level))
    return found


class Heard:
    """The blocks that came, each with the time at which it came."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.blocks: list[np.ndarray] = []

    def take(self, at: float, y: np.ndarray) -> None:
        """Keep a block."""
        self.times.append(at)
        self.blocks.append(y)

    def changed(self, since: int, level: float) -> float | None:
        """When the first block came that belongs to no constant level before."""
        for at, y in zip(self.times[since:], self.blocks[since:], strict=False):
            if np.abs(y / level).max() > 1.25 or np.abs(y / level).min() < 0.75:
                return at
        return None


def edited(file: Path, heard: Heard, told: list[str], look: object = None) -> list[Row]:
    """Edit a file that plays, and return how long each kind of edit took."""
    took: dict[str, list[float]] = {"constant": [], "block": [], "mistake": []}
    level = 0.3
    for kind, text, new in texts():
        since, said = len(heard.blocks), len(told)
        other = file.with_suffix(".new")
        other.write_text(text)
        begun = time.time()
        other.replace(file)
        while time.time() < begun + 30:
            time.sleep(0.002)
            if callable(look):
                look()
            there = heard.changed(since, level) if kind != "mistake" else None
            if there is not None or (kind == "mistake" and len(told) > said):
                took[kind].append((there or time.time()) - begun)
                break
        else:
            raise SystemExit(f"{kind}: nothing came in 30 s: {told}")
        end = time.time() + 0.4  # until the crossfade is over, and the filters are at rest
        while time.time() < end:
            time.sleep(0.01)
            if callable(look):
                look()
        level = level if kind == "mistake" else new
    y = np.concatenate(heard.blocks).astype(float)
    rows = []
    for kind, all_ in took.items():
        rows += [row(f"{kind}: median of {len(all_)}", float(np.median(all_)), "s")]
        rows += [row(f"{kind}: longest", max(all_), "s")]
    return [
        *rows,
        row("samples", float(y.size), ""),
        row("samples beyond full scale", float((np.abs(y) > 1).sum()), ""),
        row("steps beyond those of a fade", float((np.abs(np.diff(y)) > CLICK).sum()), ""),
        row("largest step", float(np.abs(np.diff(y)).max()), "of full scale"),
    ]


def on_a_device(folder: Path) -> list[Row]:
    """As ``stimlib play --watch`` does it."""
    from stimlib.cli.scene import scene_of
    from stimlib.cli.watching import Watched
    from stimlib.devices.sink import Sink

    heard, told = Heard(), list[str]()

    class Device(Sink):
        device = "benchmark"

        def _open(self) -> None:
            self.block, frames = 64, None
            frames = self.make_frames()

            def loop() -> None:
                due = time.perf_counter()
                while not self.closing:
                    self.pump.block(64)
                    heard.take(time.time(), frames[0].copy())
                    due += 64 / self.rate
                    time.sleep(max(0.0, due - time.perf_counter()))

            self.start_loop(loop)

    file = folder / "edited_device.py"
    file.write_text(SCENE.format(level=0.3, block="y"))
    watched = Watched(f"{file}:scene", [])
    with Device(scene_of(watched.scene), 1.0, realtime=False) as sink:
        sink.open(8000)
        sink.start()
        with watched.reloaded(lambda scene: sink.crossfade(scene), told.append):
            time.sleep(0.5)
            return edited(file, heard, told)


HOOK = """import('/live.js').then(({live}) => {
  const kind = Object.getPrototypeOf(live.history), push = kind.push;
  window.came = [];
  kind.push = function(first, n, samples) {
    came.push([(performance.timeOrigin + performance.now()) / 1e3, ...samples.subarray(0, n)]);
    return push.call(this, first, n, samples);
  };
  return 1;
})"""


def on_the_page(folder: Path) -> list[Row]:
    """The command ``stimlib live``, with a page that keeps what comes."""
    file = folder / "edited_page.py"
    file.write_text(SCENE.format(level=0.3, block="y"))
    words = ["live", f"{file}:scene", "--no-browser", "--full-scale", "1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "stimlib", *words], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    browser, heard, told = Browser(), Heard(), list[str]()
    try:
        page = browser.page(process.stdout.readline().strip())
        page.until("document.querySelector('#run')?.disabled === false")
        page.js(HOOK)
        page.js("document.querySelector('#run').click()")
        page.until("came.length > 100")
        note = "document.querySelector('#note')"

        def look() -> None:
            for at, *y in page.js("came.splice(0)"):
                heard.take(at, np.array(y))
            said = page.js(f"{note}.hidden ? '' : {note}.textContent")
            if said and (not told or told[-1] != said):
                told.append(said)
            if not said and told and told[-1]:
                told.append("")

        look()
        return edited(file, heard, told, look)
    finally:
        browser.close()
        process.terminate()
        process.wait(10)


def main() -> None:
    given = options(__doc__, None).parse_args()
    rows = [row(machine())]
    with tempfile.TemporaryDirectory() as folder:
        os.environ["STIMLIB_CACHE"] = f"{folder}/cache"
        rows += [r | {"what": f"device: {r['what']}"} for r in on_a_device(Path(folder))]
        if where() is not None:
            rows += [r | {"what": f"page: {r['what']}"} for r in on_the_page(Path(folder))]
    save("edits", rows, given.record)


if __name__ == "__main__":
    main()
