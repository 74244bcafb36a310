"""What feeds a sink from elsewhere, as the examples do it: bytes on a terminal, and
frames of a screen.
"""

import os
import runpy
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from stimlib.files import read_log, replay

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("package", ["pyserial", None])
def test_a_thread_reads_positions_from_a_port(package, tmp_path, monkeypatch):
    """Real bytes on a pseudo terminal: in pieces, with a line that is no number, and
    with none for a while.
    """
    if package:
        pytest.importorskip("serial")
    else:
        monkeypatch.setitem(sys.modules, "serial", None)
    play = runpy.run_path(str(EXAMPLES / "serial_tracker.py"))["play"]
    device, port = os.openpty()
    over = threading.Event()

    def write():
        while not over.is_set():
            for piece, pause in [(b"2500\n", 0.004), (b"25x0\n", 0.001)] * 10 + [
                (b"25", 0.15),
                (b"00\n", 0.001),
            ]:
                os.write(device, piece)
                time.sleep(pause)  # longer than the port waits for the rest of a line

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    reader = play(os.ttyname(port), 0.6, str(tmp_path / "a.stimlog"))
    over.set()
    writer.join()  # before its number of a file is somebody else's
    os.close(device)
    os.close(port)
    log = read_log(tmp_path / "a.stimlog")
    assert reader.reports > 10 and reader.unreadable > 5 and not reader.is_alive()
    x = np.asarray(log.motion)[:, 0]
    assert set(x) <= {0.0, 0.0025}, "a piece of a line is not a position"
    assert x[-1] == 0.0025 and replay(log).matches


def test_half_of_a_trial_needs_no_psychopy(tmp_path):
    example = runpy.run_path(str(EXAMPLES / "psychopy_trial.py"))
    chosen = example["trial"](
        [300.0, 360.0], lambda: example["made_up_hand"](12), lambda: "1", tmp_path
    )
    logs = [read_log(tmp_path / f"interval{i}.stimlog") for i in (1, 2)]
    assert chosen == "1" and [log.params["k"] for log in logs] == [300.0, 360.0]
    assert [np.asarray(log.motion).max() for log in logs] == pytest.approx(
        [0.011] * 2
    ) and "psychopy" not in sys.modules
