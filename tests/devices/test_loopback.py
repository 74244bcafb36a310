"""The loopback: recording a session beside it, and judging a cable."""

import numpy as np
import pytest
from devices.servers import Jackd, needs_jack, unjudged

from stimlib import SinkError
from stimlib.devices.jack_loopback import Loopback, loopback, through
from stimlib.files.log_reader import read_log
from stimlib.motion.generators import minimum_jerk
from stimlib.scenes import squeeze

HAND = {"x1": minimum_jerk(0.02), "x2": minimum_jerk(0.01)}


def cable(seed=1, slow=False):
    played = np.random.default_rng(seed).normal(size=(4000, 2)).astype(np.float32)
    if slow:  # as forces are: a delay wrong by some samples explains nearly as much
        played = np.stack(
            [np.sin(np.pi * np.arange(4000) / 4000), np.sin(np.pi * np.arange(4000) / 2000)]
        ).T.astype(np.float32)
    heard = np.zeros((6000, 2), np.float32)
    heard[1137 : 1137 + 4000] = -0.25 * played
    return played, heard, np.arange(-200, 5800), np.ones(4000, bool)


@pytest.mark.parametrize("slow", [False, True])
def test_frames_that_either_side_lost_say_nothing_of_the_cable(slow):
    """What a device gives for frames that the sink lost is anything; what the recording
    client missed is not there.
    """
    played, heard, index, given = cable(slow=slow)
    if not slow:
        lag, gain, residual, compared = through(heard, index, played, given, 1800)
        assert (lag, compared, gain) == (937, 4000, pytest.approx(-0.25, rel=1e-6))
        assert residual < 1e-6
    given[1000:1128] = False
    heard[1137 + 1000 : 1137 + 1128] = 0.7
    here = np.ones(6000, bool)
    here[2500:2756] = False
    lag, gain, residual, compared = through(heard[here], index[here], played, given, 1800)
    assert (lag, compared) == (937, 4000 - 128 - 256)
    assert gain == pytest.approx(-0.25, rel=1e-6) and residual < 1e-6


def test_a_cable_that_is_not_there():
    played, heard, index, given = cable()
    assert through(0 * heard, index, played, given, 1800)[2:] == (1.0, 0)
    assert through(heard, index, 0 * played, given, 1800)[2:] == (1.0, 0)
    assert through(heard, index, played, ~given, 1800)[2:] == (1.0, 0)
    noise = np.random.default_rng(3).normal(size=heard.shape).astype(np.float32)
    assert through(noise, index, played, given, 1800)[2] > 0.9
    lag, _, residual, _ = through(heard + 0.025 * noise, index, played, given, 1800)
    # noise of a tenth, also where nothing played
    assert lag == 937 and residual == pytest.approx(np.sqrt(1.45 * 0.01), rel=0.1)


def test_the_verdict():
    told = dict(
        produced=10,
        delivered=10,
        lost=0,
        compared=10,
        wrong=None,
        cable=False,
        latency=0.0,
        gain=1.0,
        residual=0.0,
    )
    assert Loopback(**told, tolerance=0.05).passed
    for more, text in (
        ({"wrong": 7}, "sample 7 differs"),
        ({"compared": 0}, "nothing could be compared"),
        ({"cable": True, "residual": 0.06}, "residual 6.00%"),
    ):
        result = Loopback(**(told | more), tolerance=0.05)
        assert not result.passed and text in str(result) and "FAILED" in str(result)


@needs_jack
def test_loopback_on_a_server(tmp_path):
    with Jackd(8000, 64) as server:
        told = dict(motion=HAND, server=server.name, realtime=False)
        result = loopback(squeeze(), 50.0, 8000, 1.0, log=tmp_path / "a.stimlog", **told)
        assert (
            result.passed
            and result.wrong is None
            and result.produced == 8000 == result.delivered + result.lost
        ), result
        assert 0 < result.compared <= result.delivered and result.latency > 0
        assert read_log(tmp_path / "a.stimlog").frames == 8000
        ports = ["stimlib:force1", "stimlib:force2"]
        for _ in range(12):
            result = loopback(squeeze(), 50.0, 8000, 1.0, capture=ports, **told)
            assert result.passed, result
            if not result.lost:
                break
        else:
            unjudged("samples were lost in each of 12 takes")
        assert (result.latency, result.gain) == (0.0, pytest.approx(1.0, abs=1e-6)), result
        with pytest.raises(SinkError, match="cannot record nobody:a, nobody:b"):
            loopback(squeeze(), 50.0, 8000, 1.0, capture=["nobody:a", "nobody:b"], **told)
