"""Loopback test: play a scene on a JACK server, record it, and compare.

It tests whether the recording equals the offline rendering, and measures the delay.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Scene
from ..errors import BadValue, SinkError, counted, public, said_as
from ..files.log_reader import read_log
from ..files.log_replay import delivered
from ..run.safety import Safety
from .drivers import JACK, address, jack_client
from .engine import native
from .jack import JackSink

ROUND_TRIP = 1.0
"""Longest delay of a cable, in s, that the search covers."""


@dataclass(frozen=True)
class Loopback:
    """The result of a loopback: the recording compared with the rendered log.

    Attributes
    ----------
    produced, delivered, lost : int
        As in the sink's report.
    compared : int
        Delivered frames that were recorded; the recording client may be late too.
    wrong : int or None
        Index of the first differing sample; None if all are equal, or if a cable was
        measured.
    cable : bool
        Recorded from other ports than the sink's own.
    latency : float, s
        Through the cable; without one, what JACK reports for the way to the outputs.
    gain, residual : float
        With a cable: amplitude, and the remainder after correcting gain and delay,
        relative to the signal.  Without a cable: 1 and 0.
    tolerance : float
        Largest residual that passes.
    """

    produced: int
    delivered: int
    lost: int
    compared: int
    wrong: int | None
    cable: bool
    latency: float
    gain: float
    residual: float
    tolerance: float

    @property
    def passed(self) -> bool:
        """Whether the recording equals the rendering of the session's log."""
        if self.compared == 0:
            return False
        return self.residual <= self.tolerance if self.cable else self.wrong is None

    def __str__(self) -> str:
        line = (
            f"{counted(self.produced, 'sample')}, {self.lost} lost, {self.compared} of"
            f" {self.delivered}"
            " delivered frames recorded"
        )
        if self.compared == 0:
            return f"{line}: FAILED, nothing could be compared"
        word = "passed" if self.passed else "FAILED"
        if self.cable:
            return (
                f"{line}; delay {self.latency * 1e3:.2f} ms, gain {self.gain:.3g}, residual"
                f" {self.residual:.2%} of the signal (at most {self.tolerance:.2%}): {word}"
            )
        what = (
            "all equal the offline render"
            if self.wrong is None
            else f"sample {self.wrong} differs from the offline render"
        )
        return f"{line}, {what}; latency to the outputs {self.latency * 1e3:.2f} ms: {word}"


class Capture(AbstractContextManager["Capture"]):
    """A JACK client that records from its creation on, in a compiled callback.

    Parameters
    ----------
    server : str or None
    ports : sequence of str or int
        Ports to record, one for each channel; or the number of channels, for others to
        connect to ``names``.
    size : int
        Most frames.
    name : str
        Name of the client.
    """

    def __init__(
        self,
        server: str | None,
        ports: Sequence[str] | int,
        size: int,
        name: str = "stimlib_capture",
    ):
        jack = jack_client()
        with said_as(SinkError, "jack: no client that records", jack.JackError):
            self.client = client = jack.Client(
                name, use_exact_name=isinstance(ports, int), no_start_server=True, servername=server
            )
        try:
            channels = ports if isinstance(ports, int) else len(ports)
            ins = [client.inports.register(f"in_{k + 1}") for k in range(channels)]
            self.names = [p.name for p in ins]
            self._data = np.ones((channels, size), np.float32)  # ones, so that the memory is there
            self._times = np.ones(size, np.int64)
            lib, ffi = jack._lib, jack._ffi

            self._ports = np.array([address(jack, p._ptr) for p in ins], np.int64)
            self._words = np.array(
                [
                    address(jack, lib.jack_port_get_buffer),
                    self._ports.ctypes.data,
                    channels,
                    self._data.ctypes.data,
                    size,
                    0,
                    self._times.ctypes.data,
                    address(jack, lib.jack_last_frame_time),
                    address(jack, client._ptr),
                ],
                np.int64,
            )
            callback = ffi.cast("JackProcessCallback", native().addresses["jack_capture"])
            lib.jack_set_process_callback(
                client._ptr, callback, ffi.cast("void*", self._words.ctypes.data)
            )
            # of the server, so of any client: what that one gave may not have been
            # taken
            self.xruns = 0
            client.set_xrun_callback(self._late)
            client.activate()
            if not isinstance(ports, int):
                for port, to in zip(ports, ins, strict=True):
                    client.connect(port, to)
        except jack.JackError as e:
            client.close()
            what = counted(channels, "channel") if isinstance(ports, int) else ", ".join(ports)
            raise SinkError(f"jack: cannot record {what}: {e}") from None
        except AttributeError as e:
            client.close()
            raise SinkError(
                f"this version of JACK-Client takes no compiled callback ({e}): {JACK}"
            ) from None

    def _late(self, microseconds: float) -> None:
        self.xruns += 1

    @property
    def frames(self) -> NDArray[np.float32]:
        """The frames recorded so far, shape (n, channels)."""
        return self._data[:, : self._words[5]].T

    @property
    def times(self) -> NDArray[np.int64]:
        """JACK's time, in frames, of each recorded frame."""
        return self._times[: self._words[5]]

    def __exit__(self, *_: object) -> None:
        self.client.deactivate()
        self.client.close()


@public
def loopback(
    scene: Scene,
    safety: Safety | float,
    rate: float,
    seconds: float,
    *,
    motion: Any = None,
    channels: int | Sequence[str | None] | None = None,
    server: str | None = None,
    connect: str | Sequence[str] | None = "system",
    capture: Sequence[str] | None = None,
    log: str | Path | None = None,
    tolerance: float = 0.05,
    **options: Any,
) -> Loopback:
    """Play a scene through ``JackSink``, record it, and compare it with its log.

    A second JACK client records, and the log of the session is rendered offline.

    Parameters
    ----------
    scene, safety, motion, connect, **options
        As for ``JackSink``.
    rate : float, Hz
    seconds : float
    channels : int or sequence, optional
        As for ``Sink.open``.
    server : str, optional
    capture : sequence of str, optional
        Ports to record, one for each channel, such as ``"system:capture_1"`` for a
        cable from the first output to the first input; its delay is measured.  By
        default the sink's own ports, which must be equal bit for bit.
    log : path, optional
        Folder to keep the session's log in.
    tolerance : float
        With a cable: largest residual, relative to the signal.

    Raises
    ------
    SinkError, BadValue
        As ``Sink.open``; a port that is not there.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.devices import loopback
    >>> loopback(
    ...     stimlib.Scene({"y": stimlib.constant(0.5)}),
    ...     1.0,
    ...     8000,
    ...     1.0,
    ...     server="none_of_this_name",
    ... )
    Traceback (most recent call last):
    ...
    stimlib.errors.SinkError: ...
    """
    if capture is not None and isinstance(capture, str):
        capture = [capture]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(log) if log is not None else Path(scratch) / "session.stimlog"
        with JackSink(
            scene, safety, motion=motion, server=server, connect=connect, log=folder, **options
        ) as sink:
            sink.open(rate, channels)
            if capture is not None and len(capture) != sink.channels:
                raise BadValue(
                    f"capture names {counted(len(capture), 'port')} for"
                    f" {counted(sink.channels, 'channel')}"
                )
            ports = list(capture) if capture else [f"{sink.name}:{n}" for n in sink._port_names()]
            with Capture(server, ports, round((seconds + ROUND_TRIP + 10.0) * sink.rate)) as record:
                sink.start(seconds)
                sink.wait()
                time.sleep(ROUND_TRIP if capture else 0.05)
                latency = sink._latency()
                frames, times = record.frames.copy(), record.times.copy()
                origin = sink.pump.read("ORIGIN")
        report = sink.report()
        parts = list(delivered(read_log(folder)))
    expected = np.concatenate([p for _, p, _ in parts])
    given = np.concatenate([np.full(len(p), told) for _, p, told in parts])
    index = times[: len(frames)] - origin
    if capture:
        # frames that the log does not have: like lost ones they are left out
        outside = report.rise, report.fall
        expected, given = np.pad(expected, (outside, (0, 0))), np.pad(given, outside)
        lag, gain, residual, compared = through(
            frames, index + report.rise, expected, given, round(ROUND_TRIP * rate)
        )
        return Loopback(
            report.produced,
            report.delivered,
            report.lost,
            compared,
            None,
            True,
            lag / rate,
            gain,
            residual,
            tolerance,
        )
    inside = (index >= 0) & (index < len(expected))
    inside[inside] = given[index[inside]]
    bad = (frames[inside] != expected[index[inside]]).any(axis=1)
    wrong = int(index[inside][bad][0]) if bad.any() else None
    return Loopback(
        report.produced,
        report.delivered,
        report.lost,
        int(inside.sum()),
        wrong,
        False,
        latency,
        1.0,
        0.0,
        tolerance,
    )


def through(
    frames: NDArray[np.float32],
    index: NDArray[np.int64],
    expected: NDArray[Any],
    given: NDArray[np.bool_],
    longest: int,
) -> tuple[int, float, float, int]:
    """Estimate the delay and gain of a cable between two ports.

    They are the least-squares fit of the played signal to the recording.

    Frames that either side lost say nothing about the cable, so they are left out.

    Parameters
    ----------
    frames, index : arrays (m, channels) and (m,)
        The recorded frames, and the session's sample index of each.
    expected, given : arrays (n, channels) and (n,)
        The played frames (with silence before and after), and which of them were
        delivered.
    longest : int
        Delay that is searched for, in samples.

    Returns
    -------
    tuple
        Delay in samples, gain, residual relative to the signal (rms), and how many
        recorded frames are of the session.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.devices.jack_loopback import through
    >>> played = np.random.default_rng(1).normal(size=(100, 1))
    >>> heard = 0.5 * np.concatenate([np.zeros((7, 1)), played])
    >>> through(heard, np.arange(107), played, np.ones(100, bool), 50)
    (7, 0.5, 0.0, 100)
    """
    n = int(max(len(expected) + longest, index.max(initial=0) + 1))
    heard, played = np.zeros((n, expected.shape[1])), np.zeros((n, expected.shape[1]))
    known, sent = np.zeros(n), np.ones(n)
    ok = index >= 0
    heard[index[ok]], known[index[ok]] = frames[ok], 1.0
    played[: len(expected)], sent[: len(expected)] = expected, given
    played *= sent[:, None]

    def at_every_lag(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
        """Return, for each lag, the sum over n of a[n] b[n - lag]."""
        size = 2 * n
        return np.fft.irfft(np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size)), size)[
            : longest + 1
        ]

    match = sum(at_every_lag(heard[:, k], played[:, k]) for k in range(expected.shape[1]))
    of_played = at_every_lag(known, (played**2).sum(axis=1))
    of_heard = at_every_lag((heard**2).sum(axis=1), sent)
    enough = of_played > 0.5 * of_played.max(initial=0.0)
    explained = np.zeros(longest + 1)
    np.divide(match**2, of_played * of_heard, out=explained, where=enough & (of_heard > 0.0))
    lag = int(np.argmax(explained))
    both = known[lag:] * sent[: n - lag] > 0
    x, y = played[: n - lag][both], heard[lag:][both]
    compared = int(both[: len(expected)].sum())
    if not x.any() or not y.any():
        return lag, 0.0, 1.0, 0
    gain = float((x * y).sum() / (x**2).sum())
    return lag, gain, float(np.sqrt(((y - gain * x) ** 2).sum() / (y**2).sum())), compared
