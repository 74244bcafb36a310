"""Which felt harder?  Two intervals of a virtual spring under the mouse, asked and
drawn by PsychoPy, felt through stimlib.

python examples/psychopy_trial.py [--made-up-hand] [--plot FILE]

Only `psychopy_hand` and `psychopy_answer` need PsychoPy.  With --made-up-hand the
session runs without it, and without a screen.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import stimlib
from stimlib.blocks import spring, track
from stimlib.devices import Live, NullSink
from stimlib.files import read_log

DEPTH = 0.02  # m, from the lower to the upper edge of the window


def scene() -> stimlib.Scene:
    x = track(stimlib.Input("x", "m"), bandwidth=20.0)  # 60 frames a second are stairs
    return stimlib.Scene({"force": spring(x, stimlib.Param("k", 300.0, "N/m"))})


def interval(sink, hand) -> None:
    """Plays while the hand gives positions in m, one for each frame of the screen."""
    with sink:
        sink.open(rate=8000)
        sink.start()
        for x in hand:
            sink.push({"x": x})
        sink.stop()


# [trial]
def trial(stiffnesses, hand, answer, folder: Path) -> str:
    """Two intervals, and the answer; what was felt stays in two logs."""
    for number, k in enumerate(stiffnesses, 1):
        log = folder / f"interval{number}.stimlog"
        interval(NullSink(scene(), 20.0, motion=Live(), params={"k": k}, log=log), hand())
    return answer()


# [psychopy]
def psychopy_window():
    from psychopy import visual

    return visual.Window(units="norm", color="black")


def psychopy_hand(window, seconds=3.0):
    from psychopy import event, visual

    mouse, dot = event.Mouse(win=window), visual.Circle(window, radius=0.05, fillColor="white")
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        height = float(np.clip(mouse.getPos()[1], -1, 1))
        dot.pos = (0, height)
        dot.draw()
        window.flip()  # waits for the next frame
        yield DEPTH * (1 - height) / 2


def psychopy_answer(window):
    from psychopy import event, visual

    visual.TextStim(window, "Which was harder?  1 or 2").draw()
    window.flip()
    return event.waitKeys(keyList=["1", "2"])[0]


# [end]
def made_up_hand(frames=40):
    for i in range(frames):
        time.sleep(1 / 60)
        yield DEPTH * min(1.0, i / 20)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--made-up-hand", action="store_true", help="without PsychoPy: a hand that presses to 20 mm"
    )
    parser.add_argument(
        "--plot", metavar="FILE", help="also draw what was felt in the second interval"
    )
    given = parser.parse_args()
    order = np.random.default_rng(seed=3).permutation([300.0, 360.0])
    with tempfile.TemporaryDirectory() as folder:
        if given.made_up_hand:
            chosen = trial(order, made_up_hand, lambda: "2", Path(folder))
        else:
            try:
                window = psychopy_window()
            except ImportError:
                sys.exit("PsychoPy is not installed: pip install psychopy, or say --made-up-hand")
            chosen = trial(
                order, lambda: psychopy_hand(window), lambda: psychopy_answer(window), Path(folder)
            )
            window.close()
        for number in (1, 2):
            log = read_log(Path(folder) / f"interval{number}.stimlog")
            x = np.asarray(log.motion)[:, 0]
            deepest = stimlib.render(log.scene, {"x": x}, fs=log.fs, params=log.params)
            print(
                f"interval {number}: {log.params['k']:.0f} N/m, {1000 * x.max():.1f} mm,"
                f" {deepest['force'].max():.2f} N"
            )
        print(f"answer: {chosen}")
        if given.plot is not None:
            deepest.plot().savefig(given.plot)


if __name__ == "__main__":
    main()
