"""The control loop: what is read and written and deadlines."""

import threading
import time

import numpy as np
import pytest
from devices.servers import Seen, begun, played, until
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Scene, SinkError, constant
from stimlib.devices import ControlLoop
from stimlib.files import read_log, replay

SPRING = Scene({"force": constant(100.0, "N/m") * Input("x", "m")})
TWO = Scene({"force": constant(3.0, "N"), "moment": constant(-0.5, "N*m")})


def still():
    return [0.02]


def loop(read=still, write=None, scene=SPRING, safety=10.0, **options):
    written = []
    made = ControlLoop(scene, safety, read, write or written.append, realtime=False, **options)
    made.written = written
    return made


def passed(made):
    """Periods between two that were written, at most."""
    return 1 + max((frames for _, frames in made.misses), default=0)


def test_it_writes_what_the_scene_is_of_what_it_reads(tmp_path):
    """In the output's unit, at most its full scale, with a rise along the samples."""
    hand = iter(np.linspace(0.0, 0.12, 400).tolist() + [0.12] * 10_000)
    made = played(loop(lambda: [next(hand)], log=tmp_path / "a.stimlog"), 1.0, fs=1000)
    log = read_log(tmp_path / "a.stimlog")
    assert replay(log).matches and log.frames == 1000
    y = stimlib.render(SPRING, {"x": np.asarray(log.motion)[:, 0]}, fs=1000)["force"]
    lost, written = sum(frames for _, frames in made.misses), np.array(made.written)[:, 0]
    assert made.report().lost == lost
    if not lost:
        at = int(np.flatnonzero(written == np.float32(y[200] / 10) * np.float64(10))[0])
        np.testing.assert_allclose(written[at - 72 : at + 100], y[128:300], rtol=1e-6)
    assert written[0] == written[-1] == 0.0 and written.max() <= 10.0
    assert np.abs(np.diff(written)).max() < 0.2 * passed(made)
    # each period that came read the hand, which is at the limit after the first 400
    assert made.report().clips.get("clip", {"force": 0})["force"] > 50 - lost
    assert lost > 50 or written.max() == 10.0


def test_what_is_missed_is_told_of_a_session_that_follows():
    slow = threading.Event()
    made = loop(lambda: time.sleep(0.03 * slow.is_set()) or [0.01], watchdog=10.0)
    with begun(made, fs=1000):
        until(lambda: made.pump.index > 200)
        new = made.crossfade(SPRING)
        until(lambda: made.finished and new.pump.index > 200)
        before, told = new.report().lost, len(made.misses)
        slow.set()
        until(lambda: new.report().lost > before + 60)
        new.stop()
    assert sum(n for _, n in [*made.misses][told:]) >= new.report().lost - before > 60


@pytest.mark.parametrize("block", [1, 4])
def test_a_block_is_a_period_with_a_row_for_each_output(block):
    made = loop(None, scene=TWO, safety={"force": 6.0, "moment": 2.0})
    with begun(made, 0.4, fs=1000, block=block):
        made.wait()
        assert made.report().latency == block / 1000
    assert {y.shape for y in made.written} == {(2,) if block == 1 else (2, 4)}
    rows = np.hstack([y.reshape(2, -1) for y in made.written])
    assert np.abs(rows[0]).max() == 3.0 and rows[1].min() == -0.5
    steady = rows[0] == 3.0
    lost = sum(frames for _, frames in made.misses)
    assert steady.sum() > 50 - lost and (rows[1][steady] == -0.5).all()


def test_deadlines_are_absolute_and_what_is_missed_is_told():
    log, slow = Seen(), iter([0.0] * 300 + [0.035] + [0.0] * 10_000)

    def read():
        time.sleep(next(slow))
        return [0.01]

    began = time.monotonic()
    made = played(loop(read, log=log), 1.0, fs=1000)
    assert time.monotonic() - began > 1.0
    missed = sum(frames for _, frames in made.misses)
    assert missed >= 30 and made.report().lost == missed
    assert sum(e["frames"] for _, kind, e in log.events if kind == "lost") == missed
    p50, most = made.lateness(50, 100)
    assert 0 < p50 < most and most >= 0.02  # of at most 20 ms it knows how late
    assert loop().lateness(50) == [0.0]


def test_a_period_may_last_longer_than_the_watchdog_allows_it_to_be_late():
    with begun(loop(watchdog=0.24), 1.0, fs=1000, block=250) as made:
        made.wait()


@pytest.mark.parametrize("follows", [False, True])
def test_a_read_that_hangs_is_written_zeros_by_the_watchdog(follows):
    gate, hangs = threading.Event(), threading.Event()

    def read():
        if hangs.is_set():
            gate.wait(60)
        return [0.02]

    made = loop(read, watchdog=0.5)
    with begun(made, 60.0, fs=1000):
        if follows:
            made.crossfade(SPRING)
        until(lambda: made.newest.pump.index > 300)
        hangs.set()
        refused(SinkError, "period has not ended for 0.501 s: zeros", made.wait, 50.0)
        until(lambda: made.written[-1][0] == 0.0)
        assert max(made.written)[0] > 1.9 and not gate.is_set()
        gate.set()
        made.error = made.newest.error = None
    assert made.written[-1][0] == 0.0


class FullLog(Seen):
    def delivered(self, frames):
        if len(self.frames) > 20:
            raise OSError("full")
        super().delivered(frames)


@pytest.mark.parametrize(("watchdog", "log"), [(10.0, None), (0.5, FullLog())])
@pytest.mark.filterwarnings("ignore:control loop. the device did not let go")
def test_a_read_that_hangs_is_written_zeros_at_a_close_and_behind_a_log_that_failed(watchdog, log):
    """Where the watchdog would come after the close; where the log has ended."""
    gate, hangs = threading.Event(), threading.Event()

    def read():
        if hangs.is_set() or made.error:
            gate.wait(60)
        return [0.02]

    made = loop(read, watchdog=watchdog, log=log)
    made.open(1000)
    made.start(60.0)
    until(lambda: made.error or (made.written and made.written[-1][0] > 1.9 and not log))
    hangs.set()
    if log is None:
        time.sleep(0.1)
        made.close()
    until(lambda: made.written[-1][0] == 0.0, seconds=50.0)  # before the read returns
    gate.set()
    made.close()
    assert made.written[-1][0] == 0.0


@pytest.mark.parametrize(
    ("read", "says"),
    [
        (lambda: 1 / 0, "read failed: ZeroDivisionError"),
        (lambda: [float("nan")], "read failed: .*x is nan"),
        (lambda: [1.0, 2.0], r"shape \(1, n\).*got \(2, 1\)"),
        (lambda: [], r"got \(0, 1\)"),
        (lambda: [[1.0], [2.0]], r"got \(2, 1\)"),
        (lambda: 0.001, r"got \(\)"),
        (lambda: ["0.001"], "x must be numbers"),
        (lambda: "far", "x must be numbers"),
        (lambda: {"y": 0.1}, "x is missing, there is no input y"),
    ],
)
def test_a_read_that_fails_fades_and_is_named(read, says):
    made = loop(read)
    refused(SinkError, says, played, made, 60.0, fs=1000)
    assert made.written[-1][0] == 0.0


def test_a_write_that_fails_ends_the_session():
    def write(y):
        if y[0] > 1.0:
            raise OSError("unplugged")

    made = loop(write=write)
    with begun(made, 60.0, fs=1000):
        refused(SinkError, "write failed: OSError: unplugged", made.wait)
        made.error = None


def test_functions_and_times_that_make_no_sense():
    for change in (
        {"read": None},
        {"write": 3},
        {"watchdog": 0.0},
        {"watchdog": 11.0},
        {"spin": -1.0},
        {"spin": 0.02},
    ):
        words = {"read": still, "write": print} | change
        refused(BadValue, "ControlLoop: ", ControlLoop, SPRING, 1.0, **words)
