"""Sweeps through a sink: what was played and what answered it, at one point and at
many, and takes that must be done again.
"""

from dataclasses import replace

import numpy as np
import pytest
from devices.servers import Jackd, needs_jack, until_judged
from refusals import refused
from scipy.signal import cont2discrete, lfilter

import stimlib
from stimlib import BadValue, Input, RecordingError, Scene, SinkError
from stimlib.devices import NullSink, Signal, record_sweep
from stimlib.plate import Plate, identify, plate, read_sweep

FS = 2000
TOLD = {"rate": FS, "band": (60.0, 320.0), "seconds": 1.5, "rest": 0.5, "clocked": False}


def answer(u, scale=2e-6):
    w = 2 * np.pi * 158.0
    b, a, _ = cont2discrete(([w * w], [1, w / 10.0, w * w]), 1 / FS, "foh")
    return scale * lfilter(b[0], a, u)


@pytest.fixture(scope="module")
def drive():
    """What the device is given, with its fade: known from a take whose response is
    anything.
    """
    return record_sweep(NullSink, 10.0, np.arange(4000.0), **TOLD).drive[0]


def test_what_the_device_was_given_is_the_drive_and_its_answer_the_response(drive):
    assert np.abs(drive).max() == pytest.approx(10.0, rel=1e-3) and not drive[3000:].any()
    first, last = (np.count_nonzero(np.diff(drive[at : at + 400] > 0)) for at in (0, 2600))
    assert first < 40 < 90 < last  # it rises from 60 to 320 Hz
    sweep = record_sweep(NullSink, 10.0, answer(drive), **TOLD)
    assert sweep.fs == FS and sweep.drive.shape == sweep.response.shape == (1, 4000)
    np.testing.assert_array_equal(sweep.response[0], answer(drive))
    found = identify(*sweep)
    assert found.freq == pytest.approx(158.0, rel=1e-5) and found.q == pytest.approx(10.0, rel=1e-4)
    half = record_sweep(
        NullSink, 10.0, answer(drive), amplitude=5.0, channels=[None, "drive"], **TOLD
    )
    np.testing.assert_allclose(half.drive[0], drive / 2, atol=1e-5)


def test_points_are_asked_for_and_a_take_that_failed_is_done_again(drive):
    places, asked, tries = np.array([[0.05, 0.07], [0.1, 0.07], [0.15, 0.07]]), [], []
    sizes = [0.5, -1.0, 0.25]

    def sensor(scene, safety, *, motion, **options):
        y = sizes[asked[-1][0]] * answer(drive)
        tries.append(len(tries))
        if len(tries) == 2:
            y = np.clip(y, -1e-6, 1e-6)
        return NullSink(scene, safety, motion={"response": y}, **options)

    def ready(k, place, error):
        asked.append((k, tuple(place), None if error is None else "clipped" in str(error)))

    found = identify(*record_sweep(sensor, 10.0, Signal(1.0), points=places, ready=ready, **TOLD))
    assert [a[0] for a in asked] == [0, 1, 1, 2] and [a[2] for a in asked] == [
        None,
        None,
        True,
        None,
    ]
    assert asked[1][1] == (0.1, 0.07)
    np.testing.assert_allclose(found.shape / found.shape[1], [-0.5, 1.0, -0.25], atol=1e-4)


def test_points_that_were_taken_are_kept_when_a_later_one_fails(drive, tmp_path):
    asked, file = [], tmp_path / "plate.npz"

    def ready(k, place, error):
        asked.append(k)
        if asked == [0, 1]:
            raise KeyboardInterrupt

    told = TOLD | {"points": [(0.05, 0.07), (0.1, 0.07)], "ready": ready, "keep": file}
    refused(KeyboardInterrupt, None, record_sweep, NullSink, 10.0, answer(drive), **told)
    sweep = record_sweep(NullSink, 10.0, 2 * answer(drive), **told)
    assert asked == [0, 1, 1]
    np.testing.assert_array_equal(sweep.response, [answer(drive), 2 * answer(drive)])
    again, read = (
        record_sweep(NullSink, 10.0, [], **told),
        read_sweep(file, ["drive0", "drive1"], ["response0", "response1"]),
    )
    for name in ("drive", "response", "fs"):
        np.testing.assert_array_equal(getattr(again, name), getattr(sweep, name))
        np.testing.assert_allclose(getattr(read, name), getattr(sweep, name), rtol=1e-12)
    for more, match in (
        ({"rate": 2500.0}, "at 2000 Hz, not 2500 Hz"),
        ({"points": [0.1]}, "has 2 points, and 1 are"),
        ({"seconds": 1.0, "points": [1, 2, 3]}, "have 4000 samples, and this one 3000"),
    ):
        refused(RecordingError, match, record_sweep, NullSink, 10.0, answer(drive), **told | more)
    refused(
        SinkError,
        "cannot write",
        record_sweep,
        NullSink,
        10.0,
        answer(drive),
        **told | {"keep": tmp_path / "missing" / "plate.npz"},
    )


class Late(NullSink):
    def report(self):
        return replace(super().report(), lost=64)


@pytest.mark.parametrize(
    ("more", "match"),
    [
        ({"sink": "jack"}, "sink = 'jack' must be a function"),
        ({"amplitude": 11.0}, "at most full_scale"),
        ({"seconds": 1e9}, "limits.recording_bytes"),
        ({"rest": 1e9}, "limits.recording_bytes"),
        ({"seconds": 4e4, "points": np.zeros((2, 2)), "ready": print}, "5.12.*e.09 is more"),
        ({"amplitude": float("nan")}, "amplitude = nan"),
        ({"points": np.zeros((2, 2))}, "2 points"),
        ({"points": []}, "0 points"),
        ({"points": 3}, "a row for each point"),
        ({"rest": 0.0}, "rest"),
        ({"channels": [None]}, "have the drive"),
        ({"band": (60.0,)}, "band = .* must be a tuple"),
        ({"band": (60.0, 1500.0)}, "below"),
        ({"sink": Late}, "lost 64 frames"),
        ({"response": np.zeros(4000)}, "response never changes"),
        ({"response": np.minimum(np.arange(4000.0) % 7, 1e-6)}, "clipped"),
    ],
)
def test_takes_that_tell_nothing_and_questions_without_sense_are_told(more, match, drive):
    told = {"sink": NullSink, "full_scale": 10.0, "response": answer(drive)} | TOLD | more
    refused((BadValue, RecordingError), match, record_sweep, **told)


@needs_jack
def test_a_plate_on_a_server_is_found():
    """A plate as another client: what it is given through its port, it answers by the
    next block, 16 ms later.
    """
    from stimlib.devices.jack import JackSink
    from stimlib.devices.sources import Signals

    fs, glass = 8000, replace(Plate.paper(measured=True), terms=10)
    under = plate(glass.length / 2, glass.width / 2, Input("v", "V"), glass, modes=1)
    told = {"server": None, "realtime": False}

    def take():
        with Jackd(fs, 128) as server:
            told["server"] = server.name
            glassy = JackSink(
                Scene({"d": under}),
                1e-4,
                motion=Signals({"v": Signal(50.0)}),
                name="glass",
                connect=None,
                **told,
            )
            with glassy:
                glassy.open(fs)
                glassy.start()
                sensor = {
                    "full_scale": 50.0,
                    "response": Signal(1e-4, connect="glass:d"),
                    "connect": ["glass:in_v"],
                }
                try:
                    sweep = record_sweep(
                        JackSink,
                        rate=fs,
                        band=(100.0, 220.0),
                        seconds=1.5,
                        rest=0.5,
                        **sensor,
                        **told,
                    )
                except RecordingError as e:
                    assert "lost" in str(e)
                    return False
            if glassy.report().lost:
                return False
        found = identify(*sweep)
        assert found.freq == pytest.approx(glass.carrier(), rel=5e-4) and found.q == pytest.approx(
            10.0, rel=0.03
        )
        assert found.delay == pytest.approx(128 / fs, abs=4e-3)
        want = stimlib.plate.Plate.frf(
            glass, "patches", (glass.length / 2, glass.width / 2), glass.carrier(), modes=1
        )
        # its sign is open behind a delay
        assert abs(found.gain[0]) * found.q == pytest.approx(abs(want), rel=0.2)
        return True

    until_judged(take, takes=3)
