"""The control loop: what is read and written, deadlines, and every way out."""

import threading
import time

import numpy as np
import pytest
from devices.servers import Seen, begun

import stimlib
from stimlib import BadValue, Input, Scene, SinkError, constant
from stimlib.devices import ControlLoop
from stimlib.files import read_log, replay

SPRING = Scene({"force": constant(100.0, "N/m") * Input("x", "m")})
TONE = Scene({"force": constant(3.0, "N")})


def still():
    return [0.02]


def loop(read=still, write=None, scene=SPRING, safety=10.0, **options):
    written = []
    made = ControlLoop(scene, safety, read, write or written.append, realtime=False, **options)
    made.written = written
    return made


def test_it_writes_what_the_scene_is_of_what_it_reads(tmp_path):
    hand = iter(np.linspace(0.0, 0.04, 10_000))
    made = loop(lambda: [next(hand)], log=tmp_path / "a.stimlog")
    with begun(made, 1.0, fs=1000):
        made.wait()
    log = read_log(tmp_path / "a.stimlog")
    assert replay(log).matches and log.frames == 1000
    x = np.asarray(log.motion)[:, 0]
    rise = 128  # the gain rises along the first samples
    y = stimlib.render(SPRING, {"x": x}, fs=1000)["force"]
    lost = sum(frames for _, frames in made.misses)
    written = np.array(made.written)[:, 0]
    assert made.report().lost == lost
    if not lost:
        at = int(np.flatnonzero(written == np.float32(y[500] / 10) * np.float64(10))[0])
        assert np.allclose(written[at - 500 + rise : at + 300], y[rise:800], rtol=1e-6)
    assert written[0] == 0.0 and written[-1] == 0.0
    passed = 1 + max((frames for _, frames in made.misses), default=0)
    assert np.abs(np.diff(written)).max() < 0.2 * passed


@pytest.mark.parametrize("block", [1, 8])
def test_a_period_is_a_block(block):
    shapes = set()
    made = loop(None, lambda y: shapes.add(y.shape), TONE)
    with begun(made, 0.2, fs=2000, block=block, channels=["force", None]):
        made.wait()
    assert shapes == {(2,) if block == 1 else (2, block)}
    assert made.report().produced == 400


def test_deadlines_are_absolute_and_what_is_missed_is_told():
    log, slow = Seen(), iter([0.0] * 300 + [0.035] + [0.0] * 10_000)

    def read():
        time.sleep(next(slow))
        return [0.01]

    began = time.monotonic()
    made = loop(read, log=log)
    with begun(made, 1.0, fs=1000):
        made.wait()
    assert time.monotonic() - began > 1.0
    missed = sum(frames for _, frames in made.misses)
    assert missed >= 30 and made.report().lost == missed
    assert sum(e["frames"] for _, kind, e in log.events if kind == "lost") == missed
    p50, most = made.lateness(50, 100)
    assert 0 < p50 < most and most >= 0.02  # of at most 20 ms it knows how late
    assert loop().lateness(50) == [0.0]


def test_the_force_fades_when_reads_bring_nothing():
    hand = iter([[0.02]] * 300 + [None] * 100_000)
    made = loop(lambda: next(hand))
    with begun(made, 60.0, fs=1000):
        until = time.monotonic() + 30
        while not made.report().stale and time.monotonic() < until:
            time.sleep(0.01)  # how many periods pass, a busy machine decides
        time.sleep(0.5)
    y = np.array(made.written)[:, 0]
    last = int(np.flatnonzero(y > 1.9)[-1])
    assert made.report().stale == 1 and np.abs(y[last + 200 :]).max() == 0.0
    # a fade over 128 samples, no step; what was lost of it was not written
    passed = 1 + max((lost for _, lost in made.misses), default=0)
    assert np.abs(np.diff(y)).max() <= passed * 2.0 / 128 * 1.01


def test_a_read_that_hangs_is_written_zeros_by_the_watchdog():
    gate, count = threading.Event(), iter(range(10**6))

    def read():
        if next(count) == 300:
            gate.wait(10)
        return [0.02]

    written = []
    made = loop(read, lambda y: written.append((time.monotonic(), y[0])), watchdog=0.1)
    with begun(made, 5.0, fs=1000):
        with pytest.raises(SinkError, match="a period has not ended for 0.1 s: zeros were written"):
            made.wait(4.0)
        held = [at for at, y in written if y > 1.9][-1]
        assert written[-1][1] == 0.0 and written[-1][0] - held < 1.0
        gate.set()
        made.error = None
    assert written[-1][1] == 0.0


@pytest.mark.parametrize(
    ("read", "says"),
    [
        (lambda: 1 / 0, "read failed: ZeroDivisionError"),
        (lambda: [float("nan")], "read failed: .*read: x is nan"),
        (lambda: [1.0, 2.0], r"read: x must be of shape \(1, n\), rows x; got \(2, 1\)"),
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
    with pytest.raises(SinkError, match=says), begun(made, 5.0, fs=1000):
        made.wait()
    assert made.written[-1][0] == 0.0


def test_a_write_that_fails_ends_the_session():
    def write(y):
        if y[0] > 1.0:
            raise OSError("unplugged")

    made = loop(write=write)
    with begun(made, 5.0, fs=1000):
        with pytest.raises(SinkError, match="write failed: OSError: unplugged"):
            made.wait()
        made.error = None


@pytest.mark.parametrize(
    "change",
    [
        {"read": None},
        {"write": 3},
        {"watchdog": 0.0},
        {"watchdog": 11.0},
        {"spin": -1.0},
        {"spin": 0.02},
    ],
)
def test_bad_arguments(change):
    with pytest.raises(BadValue, match="ControlLoop: "):
        ControlLoop(SPRING, 1.0, **{"read": still, "write": print} | change)


def test_nothing_beyond_full_scale_is_written():
    made = loop(lambda: [5.0])
    with begun(made, 0.5, fs=1000):
        made.wait()
    assert np.array(made.written).max() == 10.0 and made.report().clips["clip"]["force"] > 100


def test_blocks_of_several_outputs():
    """Each output is a row, in its unit, and a block is late by its own length."""
    two = Scene({"force": constant(3.0, "N"), "moment": constant(-0.5, "N*m")})
    made = loop(None, scene=two, safety={"force": 6.0, "moment": 2.0})
    with begun(made, 0.4, fs=1000, block=4):
        made.wait()
        assert made.report().latency == 0.004
    rows = np.concatenate(made.written, axis=1)
    assert rows.shape[0] == 2 and {y.shape for y in made.written} == {(2, 4)}
    assert np.abs(rows[0]).max() == 3.0 and rows[1].min() == -0.5
    steady = rows[0] == 3.0
    assert steady.sum() > 50 and (rows[1][steady] == -0.5).all()
