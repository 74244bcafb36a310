"""The base class of all sinks, around the engine and the compiled callback.

A subclass implements ``_open`` and ``_latency`` for its device, and often ``_start``
and ``_close``.

A sink owns one session: open, start, stop, close.  The samples are computed by
``stimlib/devices/callback.py`` inside the device's own callback; everything in this
module runs in ordinary threads and communicates with it through ring buffers.
"""

from __future__ import annotations

import logging
import math
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from ..above import above
from ..core.program import number
from ..core.scene import Scene
from ..errors import BadValue, FaultError, MotionError, SinkError, StimlibError, counted, need
from ..run.processor import compile
from ..run.safety import GAIN, Safety, Watch, protect
from . import words
from .engine import Pump
from .markers import RECENT, WINDOW, Markers, Send, behind, checked_name
from .process import abandoned, account, begin, begin_playing, end_playing, open_sinks, signals_wait
from .session import Recorder, SessionReport
from .sources import (
    NEVER,
    Feeder,
    Live,
    Receiver,
    Recorded,
    Scripted,
    Signals,
    Stream,
    columns_of,
    length,
    source_of,
)

if TYPE_CHECKING:
    from .calibration import Calibration

logger = logging.getLogger(__name__)
CLOSE_WITHIN = 2.0
"""Seconds within which ``close`` returns, whatever the device does."""

LONGEST_BLOCK = 0.25
"""Longest block of a device in s, with the blocks that wait in it: a stop is as late,
and must end before ``close`` returns.
"""

WAITS = 2.0
"""Seconds after which a function of the motion that has not returned ends the
session.
"""


NEAR, FAR = 0.1, 86400.0
"""Seconds to a start at a given time: at least NEAR, the fade and the device's buffers,
so that the device's clock is known by then; more than FAR is another clock's.
"""


class Sink:
    """A session on a device; base class of ``NullSink``, ``JackSink`` and others.

    Subclasses implement the four methods at the end; ``start_loop``, ``make_frames``,
    ``closing`` and ``device_lost`` are for them.

    Attributes
    ----------
    silent_for : float
        Time in s without a block after which a device with a clock of its own counts
        as lost, by default 2.

    Parameters
    ----------
    scene : Scene
        It is compiled with the safety stage around it.
    safety : Safety or float
        A number is ``Safety(full_scale=number)``: the largest value of all outputs.
        With a calibration it is the limit at the skin and may be left out: it is then
        the largest amplitude that the device reaches in the band.
    motion : mapping, Recorded, Scripted, Live or Signals
        See ``stimlib.devices.sources``; a mapping from input names is used as in
        ``stimlib.render``.
    seed : int
        Key of all noise.
    params : dict of str to float, optional
        Parameters that differ from the scene's, from the first sample on.
    log : path or object, optional
        Folder for the session's log (``stimlib.files.log_writer``), or an object with
        the methods of its ``LogWriter``.
    markers : sequence of str, optional
        Marker outputs: a marker is reported where one rises to 0.5 or more, whether or
        not it is on a channel.  On a spare channel it is a trigger pulse as well.
    send : callable or sequence of callable, optional
        Each is called with every ``Marker``, in a thread of its own: ``lsl_markers``,
        ``osc_markers``, ``udp_markers``, ``serial_markers`` or your own function.
    calibration : Calibration, optional
        Calibration of the device: outputs and limits are then in the calibration's
        unit, and the device reproduces them.  All outputs are delayed by half the taps
        of the inverse filter, ``Safety.inverse``.  The report has what lies outside of
        the calibrated band, and which limits at the skin were reached.
    realtime : bool, optional
        Lock memory and keep the garbage collector away during playback, with one
        warning if that is not permitted. The default is True for devices with their own
        clock only.

    Notes
    -----
    Leaving the ``with`` block, ``stop``, ``close``, an exception, Ctrl-C, SIGTERM and
    SIGHUP all fade out before the device is released; so does the end of the program.
    ``start`` handles SIGTERM and SIGHUP if no other handler is set, and only in the
    main thread, as Python requires; a program that starts sinks in another thread must
    handle them itself.

    Your own function that the sink calls from its threads (a motion, ``feed``,
    ``take``, the methods of a log) cannot harm the session: when it raises, exits,
    returns anything but finite numbers of the right shape or, as a motion, does not
    return for 2 s, the session fades out, and ``wait``, ``check`` and the end of the
    ``with`` block raise a ``SinkError`` that names it. Inside such a function ``stop``
    returns at once, and ``wait`` and ``close`` raise an error.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.devices import NullSink
    >>> from stimlib.motion import minimum_jerk
    >>> scene = stimlib.Scene(
    ...     {"force": stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> with NullSink(scene, 50.0, motion={"x": minimum_jerk()}, clocked=False) as sink:
    ...     sink.open(rate=8000)
    ...     sink.start(seconds=2.0)
    ...     sink.wait()
    >>> sink.report().produced, sink.report().lost
    (16000, 0)
    """

    device = "none"
    clock = True  # whether it has a clock of its own
    queue = 1  # blocks from a stop until its fade leaves the device, at most
    leads = True  # whether frames before sample 0 lead to it; else the gain rises along the samples
    silent_for = 2.0
    gone = "the device has taken no samples for {:g} s: is it still there?"
    _device_gone = _hangs = False
    _worker: threading.Thread | None = None
    _thread: threading.Thread | None = None  # that of start_loop
    _feeder: Feeder | Receiver | None = None
    _counted: Any = None  # what counts the motion: rows, rejected, jitter and missing()
    _last_latency = 0.0
    _at: float | None = None  # when sample 0 is to leave the device, and how late it was
    _start_error: float | None = None
    _recorder: Any = SimpleNamespace(stales=0)  # until it is started
    _telling: Any = SimpleNamespace(count=0, lost=0, unsent=0)
    _next: Sink | None = None  # the session that follows on this device
    _since = 0

    def __init__(
        self,
        scene: Scene,
        safety: Safety | float | None = None,
        *,
        motion: Any = None,
        seed: int = 0,
        params: Mapping[str, float] | None = None,
        log: Any = None,
        markers: Sequence[str] = (),
        send: Send | Sequence[Send] | None = None,
        calibration: Calibration | None = None,
        realtime: bool | None = None,
    ):
        if not isinstance(scene, Scene):
            raise BadValue(f"a sink plays a Scene, got {type(scene).__name__}")
        if safety is None and calibration is not None:
            safety = calibration.limits(scene)
        if safety is None:
            raise BadValue(
                "safety is missing: give, as second argument, the value that 1.0 at the device"
                " makes, such as 50.0 (N), or a stimlib.run.safety.Safety with it; nothing goes"
                " beyond"
            )
        self.scene = scene
        self.safety = safety if isinstance(safety, Safety) else Safety(safety)
        self.protected, self.calibration = protect(scene, self.safety), calibration
        self.motion = self.given = source_of(motion, tuple(scene.inputs))
        self.seed, self.params = seed, dict(params or {})
        self.changed: dict[str, float] = {}  # parameters, while it plays
        self.kept: list[Sink] = []  # sessions that follow: the callback may be in one of them
        self.realtime = self.clock if realtime is None else realtime
        self._log_to = log
        if isinstance(markers, str) or not isinstance(markers, Sequence):
            raise BadValue(
                f"markers = {markers!r:.60} must be a list of outputs, such as markers=['onset']"
            )
        need("markers", markers, scene.outputs, "output")
        self.markers = tuple(markers)
        several: Any = send if isinstance(send, Sequence) and not isinstance(send, str) else [send]
        self._send: tuple[Send, ...] = () if send is None else tuple(several)
        if not all(map(callable, self._send)):
            raise BadValue(
                f"send = {send!r:.60} must be a function of a Marker, such as lsl_markers(), or a"
                " list of functions"
            )
        self.error: StimlibError | None = None
        self._earliest = 0  # sample before which no fade-out begins: a guard's own comes first
        self._opened = self._started = self._stopped = self._closed = False
        self._lock, self.turn = threading.RLock(), threading.Lock()

    def __repr__(self):
        at = ""
        if self._opened:
            at = f", {self.rate:g} Hz, {counted(self.channels, 'channel')}, blocks of {self.block}"
        return f"{type(self).__name__}({self.scene!r}{at})"

    # Life -----------------------------------------------------------------------------
    def open(
        self,
        rate: float,
        channels: int | Sequence[str | None] | None = None,
        block: int | None = None,
    ) -> None:
        """Compile for the device's rate and open the device, silent until ``start``.

        Parameters
        ----------
        rate : float
            Hz.
        channels : int or sequence of str or None, optional
            Number of channels, the first of which carry the outputs in their order; or
            the output of each channel, None for silence.  By default one for each
            output.
        block : int, optional
            Frames per callback, where the device lets one choose.  The samples do not
            depend on it.

        Raises
        ------
        SinkError
            The device is not there, is busy, or has another rate, block or number of
            channels; a package is missing.
        BadValue, UnknownName
            Fewer channels than outputs; a channel for an output that does not exist.
        """
        if self._opened or self._closed:
            raise SinkError(
                "this sink has been opened before, or closed: make a new one for another session"
            )
        if block is not None and (
            isinstance(block, bool) or not isinstance(block, (int, np.integer)) or block < 1
        ):
            raise BadValue(f"block = {block!r} must be a whole number of frames above 0")
        outputs = tuple(self.scene.outputs)
        self.map = _channel_map(channels, outputs)
        self.channels = len(self.map)
        if self.calibration is not None:
            self.safety = self.calibration.safety(self.scene, self.safety, rate)
            self.protected = protect(self.scene, self.safety)
        self.proc = compile(self.protected, rate, seed=self.seed)
        self.rate, self.block = self.proc.fs, block
        self._warm_up()
        need("params", self.params, self.scene.params, "parameter")
        for name, value in self.params.items():
            self.proc.set(name, value, ramp=0.0)
        # they are there from the first sample on
        self.proc.process(np.zeros((len(self.proc.inputs), 0)))
        self._aim()
        self.pump = Pump(
            self.proc,
            self.safety,
            self.map,
            self.motion,
            log=self._log_to is not None,
            markers=self.markers,
        )
        self.pump.room = 0  # until ``make_frames``
        self._watch = Watch(self.proc)
        self._refused: list[str] = []  # of what real time needs
        self._let_go = threading.Event()
        # now: a program that ends starts no thread
        self._closer = begin(
            threading.Thread(target=self._close_when_told, name="stimlib close", daemon=True)
        )
        try:
            self._open()
            late = self.queue * (self.block or 0) / self.rate
            if self.clock and late > LONGEST_BLOCK:
                raise SinkError(
                    f"{self.device}: with blocks of {counted(self.block or 0, 'frame')} a stop"
                    f" would come {late:.2g} s late: at most"
                    f" {int(LONGEST_BLOCK * self.rate / self.queue)}"
                )
        except BaseException:
            self._closed = True
            self._let_it_go(1.0)
            # else it may be opened again: a server may come later
            self._closed = self._closer.is_alive()
            raise
        self._opened = True
        open_sinks.add(self)
        logger.info("%s: opened %r", self.device, self)

    def _warm_up(self) -> None:
        """Run every code path once and return to sample 0.

        Nothing needs to be compiled or loaded during playback.
        """
        x = columns_of("", np.zeros((len(self.proc.inputs), 256)), self.proc.inputs)
        self.proc.process(x)
        pump = Pump(
            self.proc, self.safety, self.map, Recorded(x) if self.proc.inputs else None, log=True
        )
        silence = np.zeros((self.channels, 64), np.float32)
        pump.buffers("OUTS")[:] = silence.ctypes.data + 4 * 64 * np.arange(self.channels)
        pump.start(None)
        pump.block(64, lost=1)
        pump.stop("stop")
        pump.block(64, lost=1)
        pump.events(), pump.frames(), pump.motion()
        self.proc.reset()

    def start(
        self,
        seconds: float | None = None,
        *,
        at: float | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start playing the scene from sample 0, now or at a given time.

        The fades lie outside the scene: the device fades in from silence to the outputs
        of sample 0, plays the samples unchanged, and fades out after the last one.
        ``stop`` and faults fade out at once. With real-time motion the gain rises
        during the samples, from the first motion on, because a force held until then
        would jump.

        Parameters
        ----------
        seconds : float, optional
            Length of the scene, without the fades; by default that of a recorded
            motion, which is held at its end, or until ``stop``.  Arrays of a scripted
            motion end it with their last sample.
        at : float, optional
            When sample 0 is to leave the device, in s of ``clock``; the fade-in comes
            before.  ``start`` returns at once, ``time_of(0)`` is the time as far as it
            is known, and ``report().start_error`` is the error.
        clock : callable
            Returns seconds: ``time.monotonic``, ``pylsl.local_clock`` or PsychoPy's
            ``core.getTime``.

        Raises
        ------
        SinkError
            The sink is not open or was started before; a device without a clock has no
            time for ``at``; or the device or a thread cannot be started, and the sink
            is then closed.
        BadValue
            A length of no samples; ``at`` has passed, is too near for the fade-in and
            the device's buffers, or is more than a day ahead.
        """
        self._need_open("start")
        if self._started:
            raise SinkError(
                "start: a sink plays once; make a new one, so that each session has its own log"
            )
        frames = length(self.motion)
        if seconds is not None:
            ends = frames if isinstance(self.motion, Scripted) else None
            frames = min(_samples("start: seconds", seconds, self.rate), ends or 2**53)
        if frames == 0:
            raise BadValue(f"start: seconds = {seconds} must be at least one sample")
        if at is not None:
            self._at = self._due(at, clock)
        if isinstance(self.motion, Scripted):
            self._feeder = Feeder(self.pump, self.motion, self._fail)
            self._feeder.fill()
        elif isinstance(self.motion, Stream):
            self._feeder = self._counted = Receiver(self.pump, self.motion, self._fail)
        self._telling = Markers(self.rate, self._send, self._fail)
        self._recorder = Recorder(
            self.pump,
            self._watch,
            self._make_log(),
            self._fail,
            self._telling,
            self._latency,
            self._received,
        )
        self._calls, self._silence, self._turns, self._waited = 0, 0.0, 0, 0.0
        self._over = threading.Event()
        self._started = True
        try:
            self._refused += begin_playing(self)
            self._take_over()
            if self._feeder:
                begin(self._feeder)
            begin(self._telling.thread)
            self._worker = begin(
                threading.Thread(target=self._work, name="stimlib sink", daemon=True)
            )
            self._start()
            with self._lock:
                if self._closed:
                    raise SinkError("start: this sink was closed meanwhile")
                if self._stopped:
                    return self.pump.write("STATE", words.DONE)
                first = self._first()
                if self._at is not None:  # as far as it is known; see _keep_time
                    left = self._due(self._at, time.monotonic) - time.monotonic()
                    self.pump.write("BEGIN", round((left - self._delay()) * self.rate))
                if isinstance(self.motion, Live):  # what came before is old, but for the newest
                    self.pump.write("M_READ", max(0, self.pump.read("M_WRITE") - 1))
                self.pump.start(frames, first)
            if self._refused:
                warnings.warn(
                    f"not permitted here: {' and '.join(self._refused)}; the stream may stutter"
                    " when the machine is busy",
                    RuntimeWarning,
                    stacklevel=2,
                )
        except BaseException:
            self.close()
            if not self._over.is_set():  # it was closed before it had begun
                self._finish(time.monotonic() + CLOSE_WITHIN)
            raise

    def _due(self, at: Any, clock: Callable[[], float]) -> float:
        """Return the time of a start on ``time.monotonic``, if it can be kept."""
        if not self.clock or self.pump.hurried:
            raise SinkError(f"start: at = {at}: {self.device} has no clock here: leave it out")
        when, now = _number("start: at", at), _number("start: clock()", clock())
        soonest = NEAR + self.safety.fade + self._delay() + 3 * (self.block or 0) / self.rate
        if not soonest <= when - now <= FAR:
            where = "ago" if when < now else "ahead"
            raise BadValue(
                f"start: at = {when:.6f} is {abs(when - now):.3g} s {where} on its clock: give a"
                f" time at least {soonest:.3g} s, and at most a day, after its {now:.6f}"
            )
        return when + behind(clock)

    def _keep_time(self) -> None:
        """Correct the frame of a start at a given time, and then its error."""
        clock = self._telling.clock
        if self._at is None or not clock.begun:
            return
        near = self.pump.index < RECENT * self.rate
        clock.window = RECENT if near else WINDOW
        begin, waits = self.pump.read("BEGIN"), self.pump.index == 0
        zero = begin + self.pump.read("LEAD") if waits else clock.zero
        late = clock.time(zero - clock.zero)[0] + self._delay() - self._at
        if waits:
            self.pump.write("BEGIN", begin - round(late * self.rate))
        elif near:
            self._start_error = late

    def _first(self) -> np.ndarray | None:
        """Return the outputs at sample 0, which the fade-in leads up to.

        Return None if the motion at sample 0 is not known.
        """
        if self.pump.live or not self.leads:
            return None
        x = np.zeros((0, 1))
        if isinstance(self.motion, Recorded):
            x = self.motion.x[:, :1].copy()
        elif isinstance(self._feeder, Feeder):
            x = self._feeder.columns(0, 1)
        state = self.proc.state
        for name, value, ramp in [*self.pump.waiting(), (GAIN, 1.0, 0)]:
            self.proc.set(name, value, ramp / self.rate)
        y = self.proc.process(x)[:, 0]
        self.proc.state = state
        return y

    def wait(self, seconds: float | None = None) -> None:
        """Wait, with an optional time limit, until the device has ended its session.

        Raises
        ------
        SinkError
            Not started; the device has failed.
        MotionError
            The session has ended, and its motion in real time never came.
        FaultError
            An output has become non-finite.
        """
        if not self._started:
            raise SinkError("wait: start the sink first")
        if self._next is not None:
            return self._next.wait(seconds)
        if self._inside() or threading.current_thread() is self._worker:
            raise SinkError(
                "wait: a function that the sink calls cannot wait for its end: wait where it was"
                " started"
            )
        end = math.inf if seconds is None else time.monotonic() + seconds
        while not self.newest.finished and time.monotonic() < end:
            self.check()
            time.sleep(min(0.01, max(end - time.monotonic(), 0.0)))
        self.check()

    def check(self) -> None:
        """Raise the error of the device or its threads, if there is one.

        A session that has ended without any motion is an error, too; and so is an error
        of the session that follows.
        """
        if self._next is not None:
            self._next.check()
        if self.error is None and self.finished and (why := self._received().get("silent")):
            self.error = MotionError(f"{self.device}: {why}")
        if self.error is not None:
            raise self.error

    @property
    def finished(self) -> bool:
        """Whether the session has ended and faded out."""
        return self._started and self.pump.state >= words.DONE

    def stop(self, reason: str = "stop") -> None:
        """Fade out and wait until the last sample has left the device.

        The device stays open, and silent. A session that follows is stopped as well.

        Inside a function that the sink calls, such as a motion, it returns at once.
        """
        if self._inside():
            return self.pump.stop(reason, self._earliest)
        if self._next is not None:
            self._next.stop(reason)
        with signals_wait(), self._lock:
            if not self._started or self._stopped:
                return
            self._stopped = True
            if self.pump.state == words.IDLE:
                return  # it has not begun: nothing is to be faded
            if self.error and reason == "close":  # before the fade was asked for
                reason = "fault" if isinstance(self.error, FaultError) else "error"
            self.pump.stop(reason, self._earliest)
            end = time.monotonic() + self.pump.fade / self.rate + 0.8
            seen, since = -1, time.monotonic()
            while not self.finished and time.monotonic() < end:
                if (calls := self.pump.read("CALLS")) != seen:  # fades have no samples
                    seen, since = calls, time.monotonic()
                if self._device_gone or time.monotonic() - since > 2 * LONGEST_BLOCK:
                    break  # no callback comes any more: nothing can be faded
                time.sleep(0.002)
            if self.finished and self.clock and not self.pump.hurried and not self._device_gone:
                time.sleep(min(self._latency() + (self.block or 64) / self.rate, 0.25))

    def close(self) -> None:
        """Fade out, release the device and finish the log, within 2 s.

        Raises
        ------
        SinkError
            It was called inside a function that the sink calls, such as a motion.
        """
        if self._inside():
            raise SinkError(
                "close: a function that the sink calls cannot close it: call stop there, close"
                " where it was opened"
            )
        began = time.monotonic()
        try:
            with signals_wait(), self._lock:
                if self._opened and not self._closed:
                    self._close_by(began + CLOSE_WITHIN)
                self._closed = True
        finally:
            end_playing(self)

    def _close_by(self, end: float) -> None:
        try:
            if self._next is not None:
                self._next.close()
            self.stop("close")
        finally:
            self._last_latency = self._latency()
            self._closed = True
            if self._next is not None:  # it has come meanwhile
                self._next.close()
            self.pump.write("STATE", words.CLOSED)
            self.pump.write("WAIT", 0)
            if self._started and self._feeder:
                self._feeder.over.set()
            gone = self._let_it_go(max(0.2, end - 0.3 - time.monotonic()))
            if self._started:
                self._finish(end)
            open_sinks.discard(self)
            logger.info(
                "%s: closed %r%s", self.device, self, f", {self.report()}" if self._started else ""
            )
            if not gone:  # last of all: the user may have made warnings errors
                why = f"{self.device}: the device did not let go; it was left behind, silent"
                warnings.warn(why, RuntimeWarning, stacklevel=3)

    def _finish(self, end: float) -> None:
        """End the threads of a started session, and with them the log."""
        if self._feeder:
            self._feeder.over.set()
        self._over.set()
        if self._worker is None:  # no thread could be started
            self._work()
        elif threading.current_thread() is not self._worker:  # as where a log calls close
            self._worker.join(max(0.1, end - 0.1 - time.monotonic()))
            if self._worker.is_alive():
                warnings.warn(
                    "the log is not written yet: the disk is slow", RuntimeWarning, stacklevel=4
                )

    def _inside(self) -> bool:
        """Return whether the current thread computes the sink's next samples.

        That thread also runs the user's functions.
        """
        return threading.current_thread() in (self._feeder, self._thread)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind, value, trace) -> None:
        self.close()
        if kind is None:
            self.check()

    def _let_it_go(self, seconds: float) -> bool:
        """Close the device; return False if closing does not finish in time.

        In that case the memory that the device uses is kept.
        """
        self._let_go.set()
        self._closer.join(seconds)
        if self._closer.is_alive():
            abandoned.append((self.pump, self))
        return not self._closer.is_alive()

    def _close_when_told(self) -> None:
        self._let_go.wait()
        try:
            self._close()
        except Exception as e:
            abandoned.append((self.pump, self))
            if self.error is None and self._opened:
                self.error = SinkError(f"{self.device}: closing failed: {e}")

    # While it plays -------------------------------------------------------------------
    def set(self, name: str, value: float, ramp: float = 0.02) -> None:
        """Change a parameter from the next block on; the log records the sample.

        After the session has faded out, the parameter no longer changes. If another
        session follows, the change is its, as with ``push`` and ``mark``.

        Parameters
        ----------
        name : str
            One of the scene's parameters.
        value : float
        ramp : float
            Seconds; 0 jumps.

        Raises
        ------
        UnknownName, BadValue
            As ``Processor.set``.
        SinkError
            The device has failed, or takes no changes.
        """
        if self._next is not None:
            return self._next.set(name, value, ramp)
        self.check()
        self._need_open("set")
        need("set", [name], self.scene.params, "parameter")  # the fade is not theirs to set
        value = _number(f"set: {name}", value)
        samples = max(1, _samples(f"set: {name}: ramp", ramp, self.rate))
        self.proc.setting(name, value, ramp)
        self.changed[name] = value
        end = time.monotonic() + 1.0
        while not self.finished and not self.pump.set(name, value, samples):
            if time.monotonic() > end or not self._started:
                raise SinkError(
                    f"set({name!r}): 256 changes wait already and the device takes none"
                )
            time.sleep(0.001)

    def _need_open(self, what: str) -> None:
        if not self._opened:
            raise SinkError(f"{what}: open the sink first")
        if self._closed:
            raise SinkError(f"{what}: this sink is closed")

    def crossfade(
        self, scene: Scene, safety: Safety | None = None, *, seconds: float | None = None, **options
    ) -> Sink:
        """Let another scene follow on the device, and return its session.

        This session fades out while the other fades in, and their sum keeps the limits
        that both keep. The parameters go on by name, and so does the motion: one that
        is given by its time from where it was, one in real time from its next column.
        Each session has its own log and report. The first sink stays the device's:
        its ``set``, ``push``, ``mark``, ``wait``, ``stop``, ``close`` and ``crossfade``
        act on what plays.

        Parameters
        ----------
        scene : Scene
            With the same outputs, in the same units; its parameters and inputs may be
            others.
        safety : Safety, optional
            With the same full scale and fade; by default that of this session.
        seconds : float, optional
            As for ``start``.
        **options
            ``motion``, ``params``, ``log``, ``seed``, ``markers``, ``send`` of the new
            session; see ``Sink``. The motion is needed where the inputs are others.

        Returns
        -------
        Sink
            The new session, which ``newest`` of the first sink gives as well.

        Raises
        ------
        SinkError
            Not started, or failed; other outputs; the session before has not ended.
        BadValue
            Another full scale or fade; no scene.

        Examples
        --------
        >>> import stimlib
        >>> from stimlib.devices import NullSink
        >>> from stimlib.scenes import tone
        >>> with NullSink(tone(freq=80.0), 10.0) as sink:
        ...     sink.open(8000)
        ...     sink.start()
        ...     higher = sink.crossfade(tone(freq=120.0), seconds=0.1)
        ...     higher.wait()
        >>> higher.report().produced
        800
        """
        root: Sink = getattr(self, "root", self)
        if any(s._inside() for s in root.onward()):
            raise SinkError("crossfade: a function that the sink calls cannot wait for another")
        if not self._started or (self._at is not None and not self.pump.index):
            raise SinkError("crossfade: start the sink first, and let it begin")
        with root.turn:  # one after another, whoever asks
            before = root.newest
            if not isinstance(before.error, FaultError):  # which another scene may not have
                before.check()
            if root._closed or before._closed or before._stopped:
                raise SinkError("crossfade: the session was stopped: make a new sink")
            made: Any = above("Sink.follow")(before, scene, safety, **options)
            try:
                made.start(seconds)
                made._recorder.see = before._recorder.see if made._log_to is not None else None
                before._next = made
                root._link(made)
                if root._closed:
                    raise SinkError("crossfade: this sink was closed meanwhile")
            except BaseException:
                before._next = None
                made.close()
                raise
        return made

    @property
    def since(self) -> int:
        """The sample of a motion of time at which the session begins."""
        return self._since + max(0, self.pump.read("SKIP"))

    @property
    def newest(self) -> Sink:
        """The session that plays on the device now: this one, or one that follows."""
        return self if self._next is None else self._next.newest

    def onward(self) -> Iterator[Sink]:
        """Yield this session and those that follow."""
        yield self
        if self._next is not None:
            yield from self._next.onward()

    def _link(self, made: Any) -> None:
        """Let a session that has started follow this one."""
        made.link(made.at)

    def push(self, x: Mapping[str, Any] | np.ndarray) -> int:
        """Add columns of live motion, one per sample; return how many fitted.

        A session begins with the newest of those that were pushed before ``start``.

        Parameters
        ----------
        x : dict of str to float or ndarray, or ndarray of shape (1, n)
            For each input a number, or a row of n samples, in its unit: ``{"x": 0.01,
            "y": 0.02}``. For one input an array does, too.

        Returns
        -------
        int
            Columns that had room; the rest was not taken.

        Raises
        ------
        SinkError
            The sink's motion is not ``Live()``; the device has failed.
        BadValue
            A wrong shape; an array for several inputs; a number that is not finite.
        UnknownName
            Other names than those of the inputs.
        """
        if self._next is not None:
            return self._next.push(x)
        self.check()
        if type(self.motion) is not Live or not self._opened:
            raise SinkError("push: make the sink with motion=Live() and open it")
        return self.pump.put_motion(columns_of("push: ", x, self.proc.inputs))

    def mark(self, name: str, value: float = 1.0, sample: int | None = None) -> None:
        """Set a marker, to be sent when its sample has left the device.

        If the session ends before that sample, it is not sent.

        Parameters
        ----------
        name : str
        value : float
        sample : int, optional
            Sample index in the session; by default the next sample to be made.

        Raises
        ------
        SinkError
            Not started; the device has failed.
        BadValue
            A name with control characters or more than 256 characters; a value that is
            not finite; a sample that is no whole number from 0.
        """
        if self._next is not None:
            return self._next.mark(name, value, sample)
        self.check()
        if not self._started or self._closed:
            raise SinkError("mark: start the sink first")
        at = self.pump.index if sample is None else sample
        if isinstance(at, bool) or not isinstance(at, int | np.integer) or at < 0:
            raise BadValue(f"mark: sample = {sample!r} must be a whole number, at least 0")
        name = checked_name("mark: name", name)
        self._telling.add(int(at), name, _number(f"mark: {name}", value))

    def time_of(self, sample: int) -> tuple[float, float]:
        """Return the time at which a sample leaves the device, and its uncertainty.

        The sample may be past or future. A picture drawn at that time appears together
        with the haptic stimulus.

        Parameters
        ----------
        sample : int
            Sample index in the session.

        Returns
        -------
        (time, uncertainty) : float, s
            As ``Marker.time`` and ``Marker.uncertainty``; nan before the first block.

        Raises
        ------
        SinkError
            Not started; the device has failed.
        """
        self.check()
        if not self._started:
            raise SinkError("time_of: start the sink first")
        at, uncertainty = self._telling.clock.time(sample)
        return at + self._delay(), uncertainty

    def watch(self, see: Callable[[int, np.ndarray, np.ndarray], None]) -> None:
        """Let a function see the newest sample of a started session, to draw it.

        Parameters
        ----------
        see : callable
            ``see(sample, x, y)`` is called for the newest block, at most 100 times a
            second, from the thread that writes the log: the sample's index, the motion,
            shape (n_inputs, 1), in the inputs' units, and the frame, shape (channels,
            1), from -1 to 1. Motion and index may be a block apart. It must not block
            or raise.

        Raises
        ------
        SinkError
            Not started, or a session without a log, which has no samples to see.
        """
        if not self._started or self._log_to is None:
            raise SinkError("watch: give the sink a log, and start it first")
        self._recorder.see = see

    def report(self) -> SessionReport:
        """Return the report of the session so far."""
        if not self._opened:
            raise SinkError("report: the sink was never open")
        p = self.pump
        names = "p50", "p99", "p99.9", "max"
        taken, late = (
            dict(zip(names, p.percentiles(50, 99, 99.9, 100, of=times), strict=True))
            for times in (p.histogram, p.lateness)
        )
        return SessionReport(
            produced=p.read("DELIVERED") + p.read("LOST"),
            delivered=p.read("DELIVERED"),
            lost=p.read("LOST"),
            underruns=p.read("UNDERRUNS"),
            clips=self._watch.counts(),
            outside=self._watch.outside(),
            energy=self._watch.energy(),
            faults=self._watch.faults(),
            block_time=taken,
            lateness=late,
            latency=self._delay(),
            stale=self._recorder.stales,
            unlogged=p.read("UNLOGGED"),
            skipped=p.read("SKIPPED"),
            rise=p.read("ROSE"),
            fall=p.read("FELL"),
            markers=self._telling.count,
            lost_markers=self._telling.lost,
            unsent_markers=self._telling.unsent,
            quiet=p.read("RUN") / self.rate,
            jitter=self._counted.jitter if self._counted else 0.0,
            start_error=self._start_error,
            **self._received(),
        )

    def _received(self) -> dict[str, Any]:
        """Return what came of a motion in real time, and what to say if none did."""
        p, counted = self.pump, self._counted
        if not (p.live and p.index):
            return {}
        moved = bool(p.read("MOVED"))
        if counted is None:
            return {"silent": "" if moved else NEVER[isinstance(self.motion, Signals)]}
        return {
            "silent": counted.missing(moved),
            "rows": counted.rows,
            "rejected": dict(counted.rejected),
        }

    def _delay(self) -> float:
        """Return the latency of the device, or its last one after it has closed."""
        return self._last_latency if self._closed else self._latency()

    # For the author of a device -------------------------------------------------------
    def device_lost(self, why: str) -> None:
        """End the session with an error, because the device requests no more blocks.

        It may be called from any thread; ``wait`` and ``check`` raise the error.

        Parameters
        ----------
        why : str
            What has happened; the error adds the name of the device.
        """
        self._device_gone = True
        self._fail(SinkError(f"{self.device}: {why}"))
        if self._next is not None:
            self._next.device_lost(why)

    def make_frames(self) -> NDArray[np.float32]:
        """Make the array into which the pump writes the samples of each block.

        For ``_open``, after it has set ``self.block``.

        Returns
        -------
        ndarray of float32, shape (channels, block)
            From -1 to 1.
        """
        if not self.block:
            raise SinkError(f"{self.device}: _open must set self.block before make_frames()")
        frames = np.zeros((self.channels, self.block), np.float32)
        rows = frames.ctypes.data + frames.strides[0] * np.arange(self.channels)
        self.pump.buffers("OUTS")[:], self.pump.room = rows, self.block
        return frames

    def start_loop(self, loop: Callable[[], None]) -> None:
        """Start a thread that requests blocks, for ``_open`` of a device without one.

        Parameters
        ----------
        loop : callable
            Requests blocks by ``self.pump.block`` until ``self.closing``.  An error
            that it raises ends the session, as ``device_lost`` does.
        """

        def run() -> None:
            try:
                loop()
            except BaseException as e:
                for session in self.onward():
                    session._device_gone = True
                    session._fail(e, what=f"{getattr(loop, '__name__', 'its loop')} failed")

        name = f"stimlib {self.device} device"
        self._thread = begin(threading.Thread(target=run, name=name, daemon=True))

    @property
    def closing(self) -> bool:
        """Whether the sink is being closed, so that no more blocks are wanted."""
        return self.pump.state == words.CLOSED

    # Errors ---------------------------------------------------------------------------
    def _fail(self, e: BaseException, earliest: int = 0, what: str = "unexpected error") -> None:
        """Fade the session out from sample ``earliest`` on, and keep the error.

        It may be called from any thread; ``check`` raises the error.

        An error raised by a user's function becomes a ``SinkError``; ``what`` names the
        function that failed.
        """
        self._earliest = max(self._earliest, earliest)
        if self.error is None and isinstance(e, (SinkError, FaultError)):
            self.error = e
        elif self.error is None:
            error = SinkError(
                f"{self.device}: {what}: {account(e)}; correct it, and play again with a new sink"
            )
            error.__cause__ = e
            self.error = error
        if self._started:
            self.pump.stop("fault" if isinstance(e, FaultError) else "error", self._earliest)

    def _watch_device(self, seconds: float) -> None:
        """Detect a device that hangs and no longer calls.

        ``seconds`` is the time since the last check.
        """
        calls = self.pump.read("CALLS")
        even = calls != self._calls or self.pump.state == words.IDLE
        self._calls, self._silence = calls, 0.0 if even else self._silence + seconds
        silent = self.clock and self._silence >= self.silent_for
        if silent and not (self._device_gone or self._closed):
            device = getattr(self, "root", self)  # which may be of a session before
            device._hangs = True
            device.device_lost(f"{self.gone.format(self.silent_for)} No fade-out was possible")
        if self._feeder and self._feeder.is_alive() and not (self.error or self.finished):
            turns, before = self._feeder.turns, self._turns
            self._turns, self._waited = turns, self._waited + seconds if turns == before else 0.0
            if self._waited >= WAITS:
                why = f"a function of the motion has not returned for {WAITS:g} s: it must not wait"
                self._fail(SinkError(f"{self.device}: {why}"))
                self.pump.write("WAIT", 0)

    # The ordinary thread --------------------------------------------------------------
    def _make_log(self) -> Any:
        if self._log_to is None:
            return None
        if isinstance(self._log_to, (str, os.PathLike)):
            from ..files.log_writer import LogWriter

            return LogWriter(self._log_to, self.header())
        return self._log_to

    def header(self) -> dict[str, Any]:
        """Return the header of the session's log.

        It contains everything that the samples depend on, except motion and events.
        """
        from ..files.log_writer import header

        return header(
            self.scene,
            self.safety,
            self.rate,
            seed=self.seed,
            params=self.params,
            channels=[self.proc.outputs[i] if i >= 0 else None for i in self.map],
            device=self.device,
            block=self.block,
            started=datetime.now(UTC).isoformat(),
        )

    def _work(self) -> None:
        self._looked, ended = time.monotonic(), None
        while not self._over.wait(0.001 if self.pump.hurried else 0.01):
            if self._next is not None and self.finished:
                # the block of its last frames is committed before the next call
                ended = ended or (time.monotonic(), self.pump.read("CALLS"))
                if self.pump.read("CALLS") > ended[1] + 1 or time.monotonic() > ended[0] + 1:
                    break  # its log is whole; the device goes on
            self._logged(self._turn)
        if not self._logged(self._recorder.end, self.report):
            self._recorder.end(self.report)  # without a log, but markers are sent

    def _turn(self) -> None:
        self._recorder.drain()
        self._keep_time()
        seen, self._looked = self._looked, time.monotonic()
        # at most: a process that was stopped has heard no call either
        self._watch_device(min(self._looked - seen, 0.05))

    def _logged(self, work: Callable[..., None], *given: Any) -> bool:
        """Call work, and return whether it succeeded; a failure ends the session."""
        try:
            work(*given)
        except BaseException as e:  # a full disk, a log that fails
            self._fail(e, what="the log cannot be written")
            self.pump.write("WAIT", 0)  # for room in it
            writer, self._recorder.writer = self._recorder.writer, None
            from ..files.log_writer import LogWriter

            self._recorder.see = None  # which may be what raised
            if isinstance(writer, LogWriter):
                with suppress(SinkError):  # as told: its files end with what they have
                    writer.close()
            return False
        return True

    # What a device fills in -----------------------------------------------------------
    def _aim(self) -> None:
        """Look at the motion once more, when everything else is compiled."""

    def _take_over(self) -> None:
        """Prepare for the motion, when nothing else can fail."""

    def _open(self) -> None:
        """Open the device and connect it to ``self.pump``, or raise SinkError.

        The settings are ``self.rate``, ``self.channels`` and ``self.block``.
        """
        raise NotImplementedError

    def _start(self) -> None:
        """Let the device begin its callbacks, unless they have begun.

        The pump is IDLE and outputs silence.
        """

    def _close(self) -> None:
        """Stop the callbacks and release the device.

        It may be called after a failed ``_open``.  By default it ends the thread of
        ``start_loop``.
        """
        self.pump.write("STATE", words.CLOSED)
        if self._thread:
            self._thread.join()

    def _latency(self) -> float:
        """Return the latency in s from the callback to the device's output."""
        return 0.0


def _number(what: str, v: Any) -> float:
    value = number(v, what)
    if not math.isfinite(value):
        raise BadValue(f"{what} = {value} must be finite")
    return value


def _samples(what: str, seconds: Any, rate: float) -> int:
    """Convert a time in s to a number of samples."""
    value = _number(what, seconds)
    if not 0 <= value * rate < 2**53:
        raise BadValue(
            f"{what} = {value:g} must be a time in seconds, at least 0, of less than 2**53 samples"
        )
    return round(value * rate)


def _channel_map(channels: Any, outputs: tuple[str, ...]) -> tuple[int, ...]:
    if channels is None:
        return tuple(range(len(outputs)))
    if isinstance(channels, (int, np.integer)) and not isinstance(channels, bool):
        if channels < len(outputs):
            raise BadValue(
                f"channels = {channels} are fewer than {counted(len(outputs), 'output')}; to leave"
                " some out, list one for each channel"
            )
        return tuple(range(len(outputs))) + (-1,) * (int(channels) - len(outputs))
    if isinstance(channels, str) or not isinstance(channels, Sequence) or not channels:
        raise BadValue(
            f"channels = {channels!r} must be a number or a list with the output of each channel,"
            " None for silence"
        )
    need("channels", [name for name in channels if name is not None], outputs, "output")
    return tuple(-1 if name is None else outputs.index(name) for name in channels)
