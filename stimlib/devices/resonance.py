"""Sweeps through a device: play a drive signal and record a sensor's response.

A sweep can be recorded at one point or at many.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..blocks.sources import chirp
from ..core.graph import Input, constant
from ..core.scene import Scene
from ..errors import BadValue, RecordingError, counted, public
from ..motion.table import read_table
from ..plate.identify import Sweep, check_taken, read_sweep
from ..run.safety import Safety
from ..system import safe_files
from ..system.limits import limits
from .sources import Signal, Signals

TAKES = 3  # of a point, where somebody can be asked
ANY = 1e30  # full scale of what no device plays

Ready = Callable[[int, Any, RecordingError | None], None]


@public
def record_sweep(
    sink: Callable[..., Any],
    full_scale: float,
    response: Any,
    rate: float,
    band: tuple[float, float] = (1.0, 625.0),
    seconds: float = 5.0,
    rest: float = 1.0,
    amplitude: float | None = None,
    drive: Signal | None = None,
    points: Any = None,
    ready: Ready | None = None,
    channels: Any = ("drive",),
    keep: str | os.PathLike[str] | None = None,
    **options: Any,
) -> Sweep:
    """Play a chirp through a sink and record the response of a sensor.

    ``identify(*sweep)`` finds the resonance in it.

    Each point is a session of its own.  The drive is the signal that the device was
    given, after the limits, or the signal recorded at the input ``drive``; in the
    latter case there is no delay between drive and response, and gains are exact.

    Parameters
    ----------
    sink : class or function
        ``JackSink``, ``PortAudioSink``, ``NullSink``, or a function that makes a sink
        from ``(scene, safety, motion=, log=, **options)``.
    full_scale : float
        Voltage that 1.0 makes at the device.
    response : Signal, or a motion of one input
        The device input that the sensor is connected to: ``Signal(scale,
        connect=port)``, with the scale in m, m/s or m/s^2 for 1.0.  Use an array or a
        function of time for a rehearsal.
    rate : float
        Sample rate of the device in Hz.
    band : (float, float)
        Frequencies in Hz between which it sweeps; the default is the thesis'.
    seconds, rest : float
        Length of the sweep, and of the silence after it, in which the plate must come
        to rest.
    amplitude : float, optional
        In V; by default full scale.
    drive : Signal, optional
        An input of the device at which the voltage itself is recorded, its scale in V.
    points : array_like, shape (points, ..), optional
        A row for each point to measure, such as its x and y; by default one point.
    ready : function, optional
        ``ready(k, points[k], error)`` is called before each session and returns when
        the sensor is there.  ``error`` is None, or the reason why this point must be
        taken again (three times at most). An exception from ``ready`` ends the
        measurement.
    channels : int or sequence
        As for ``Sink.open``: ``[None, "drive"]`` plays on the second channel.
    keep : path, optional
        An npz file to which every point is written as soon as it is taken: ``t``,
        ``drive0``, ``response0``, ``drive1`` and so on, for ``read_sweep``.  Points
        already in the file are not taken again, so an interrupted measurement resumes
        where it stopped.
    **options
        Options of the sink, such as ``connect=["system:playback_1"]``.

    Returns
    -------
    Sweep
        drive and response, each of shape (points, n), and the sample rate.

    Raises
    ------
    BadValue
        An amplitude above full scale, several points without ``ready``, numbers that do
        not define a chirp, or recordings that take more memory than
        ``stimlib.limits.recording_bytes``; its 4e9 bytes are 43 minutes at 48 kHz.
    RecordingError
        A take that is clipped, silent or has lost frames; a ``keep`` file of another
        sweep.
    SinkError
        As ``Sink.open``; a ``keep`` file that cannot be written.

    References
    ----------
    The touch-screen thesis, section 2.2: sweeps of 1 .. 625 Hz, at 25 points.

    Examples
    --------
    A rehearsal without a device, of a response that is known:

    >>> import stimlib
    >>> from stimlib.blocks import chirp, mode
    >>> from stimlib.devices import NullSink, record_sweep
    >>> from stimlib.plate import identify
    >>> answer = stimlib.Scene(
    ...     {"y": 2e-6 * mode(10 * chirp(60, 320, 2.0), 158.0, q=10)}
    ... )
    >>> y = stimlib.render(answer, {}, fs=2000, seconds=2.5)["y"]
    >>> sweep = record_sweep(
    ...     NullSink, 10.0, y, 2000, (60, 320), seconds=2.0, rest=0.5, clocked=False
    ... )
    >>> found = identify(*sweep)
    >>> print(f"{found.freq:.1f} Hz, q = {found.q:.1f}")
    158.0 Hz, q = 10.0
    """
    amplitude = full_scale if amplitude is None else amplitude
    if isinstance(amplitude, str) or not 0 < amplitude <= full_scale:
        raise BadValue(
            f"record_sweep: amplitude = {amplitude!r} must be above 0 and at most full_scale ="
            f" {full_scale!r}"
        )
    if not rest > 0:
        raise BadValue(
            f"record_sweep: rest = {rest!r} s must be above 0: the plate rings behind the sweep"
        )
    if np.shape(band) != (2,) or (not isinstance(channels, int) and "drive" not in channels):
        raise BadValue(
            f"record_sweep: band = {band!r} must be two frequencies in Hz, and channels ="
            f" {channels!r} have the drive"
        )
    if points is not None and np.ndim(points) == 0:
        raise BadValue(
            f"record_sweep: points = {points!r:.60} must be a row for each point, such as [(0.05,"
            " 0.07), (0.1, 0.07)]"
        )
    places = [None] if points is None else list(np.atleast_1d(points))
    if not places or (len(places) > 1 and ready is None):
        raise BadValue(
            f"record_sweep: {len(places)} points; give at least one, and ready=, which asks for"
            " each of several"
        )
    inputs = {"response": response} | ({} if drive is None else {"voltage": drive})
    kept_bytes = 16.0 * len(places) * (1 + len(inputs)) * (seconds + rest) * rate
    limits.check("recording_bytes", kept_bytes, "record_sweep: bytes of the recordings in memory")
    played = constant(float(amplitude), "V") * chirp(float(band[0]), float(band[1]), float(seconds))
    scene = Scene({"drive": played} | {f"{name}_seen": Input(name) for name in inputs})
    safety = Safety({"drive": full_scale} | {f"{name}_seen": ANY for name in inputs})
    motion = Signals(inputs) if isinstance(response, Signal) else inputs

    def take() -> tuple[np.ndarray, np.ndarray]:
        moved: list[np.ndarray] = []
        frames: list[np.ndarray] = []
        # a log in memory; losses are in the report
        kept = SimpleNamespace(
            motion=moved.append,
            delivered=frames.append,
            event=lambda at, kind, **more: None,
            close=lambda report: None,
        )
        with sink(scene, safety, motion=motion, log=kept, **options) as s:
            s.open(rate, channels)
            s.start(seconds + rest)
            s.wait()
        report, column = s.report(), list(s.proc.inputs).index
        if report.lost or report.unlogged:
            raise RecordingError(
                f"record_sweep: the device lost {counted(report.lost, 'frame')}, and"
                f" {report.unlogged} were"
                " not kept: record again, with longer blocks or less other work"
            )
        x = np.concatenate(moved, axis=1)
        at = next(k for k, i in enumerate(s.map) if i == s.proc.outputs.index("drive"))
        given = full_scale * np.concatenate(frames)[:, at].astype(float)
        u = given if drive is None else x[column("voltage")]
        check_taken(u[None], x[column("response")][None])
        return u, x[column("response")]

    taken = [] if keep is None else _kept(keep, rate)
    if len(taken) > len(places):
        raise RecordingError(
            f"record_sweep: {keep} has {counted(len(taken), 'point')}, and {len(places)}"
            " are wanted; keep="
            " another file"
        )
    for k in range(len(taken), len(places)):
        taken.append(_asked(take, k, places[k], ready))
        if keep is not None:
            _keep(keep, taken, rate)
    u, y = (np.array(rows) for rows in zip(*taken, strict=True))
    return Sweep(u, y, float(rate))


def _asked(take: Callable[[], Any], k: int, place: Any, ready: Ready | None) -> Any:
    """Take a point, and repeat a failed take if ``ready`` can ask for it."""
    error = None
    for _ in range(TAKES if ready else 1):
        if ready:
            ready(k, place, error)
        try:
            return take()
        except RecordingError as e:
            error = e
    assert error is not None
    raise error


def _kept(file: str | os.PathLike[str], rate: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the points that a file already has, or create the file.

    The file is created before the first take, so no take is lost to an unwritable path.
    """
    if not Path(file).exists():
        _keep(file, [], rate)
    count = len(read_table(file).names) // 2
    if not count:
        return []
    sweep = read_sweep(
        file, [f"drive{k}" for k in range(count)], [f"response{k}" for k in range(count)]
    )
    if abs(sweep.fs / rate - 1) > 1e-6:
        raise RecordingError(
            f"record_sweep: {file} was recorded at {sweep.fs:g} Hz, not {rate:g} Hz; keep= another"
            " file"
        )
    return list(zip(sweep.drive, sweep.response, strict=True))


def _keep(
    file: str | os.PathLike[str], taken: list[tuple[np.ndarray, np.ndarray]], rate: float
) -> None:
    lengths = {len(u) for u, _ in taken}
    if len(lengths) > 1:
        raise RecordingError(
            f"record_sweep: the points in {file} have {counted(len(taken[0][0]), 'sample')}, and"
            f" this one {len(taken[-1][0])}: sweep as long as before, or keep= another file"
        )
    columns: dict[str, Any] = {"t": np.arange(max(lengths, default=0)) / rate}
    for k, (u, y) in enumerate(taken):
        columns |= {f"drive{k}": u, f"response{k}": y}
    data = io.BytesIO()
    np.savez(data, **columns)
    safe_files.publish(file, data.getvalue())
