"""The engine of a sink: a processor, the compiled callback and their shared memory."""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..errors import SinkError, counted
from ..run.processor import Processor
from ..run.safety import GAIN, Safety
from ..targets.llvm.rows import PENDING
from . import words
from .process import libc
from .sources import SILENT, Live, Recorded, Scripted, Signals, Source, Stream, length

LOG_SECONDS = 4.0
"""Seconds by which the log may lag before it misses samples."""

FOREVER = 2**62
REASONS = ("stop", "fault", "error", "close", "next")

# the name and the data of each event of callback.py, from its three numbers; the last
# argument is the second number as a float
EVENTS: tuple[tuple[str, Callable[..., dict[str, Any]]], ...] = (
    ("set", lambda p, a, b, c, v: {"name": [*p.params][a], "value": v, "ramp": c}),
    ("lost", lambda p, a, *_: {"frames": a}),
    ("stale", lambda p, a, *_: {"samples": a}),
    ("fresh", lambda *_: {}),
    ("stop", lambda p, a, *_: {"reason": REASONS[a]}),
    ("gap", lambda p, a, b, *_: {"frames": a, "delivered": bool(b)}),
    ("rise", lambda p, a, *_: {"frames": a}),
    ("fall", lambda p, a, *_: {"frames": a}),
    ("mark", lambda p, a, b, c, v: {"name": p.markers[a], "value": v}),
)


PUMP = (
    "".join(
        Path(__file__).with_name(f"{n}.py").read_text(encoding="utf-8")
        for n in ("words", "callback")
    ),
    "pump",
)
_P, _I, _D = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
# Python's other threads run meanwhile
BLOCKS = {
    "block": (_I, _I),
    "null": (_I, _D, _I),
}
# and here they wait, so that no two are in one ring
RINGS = {
    "put_command": (_I, _I, _I, _I),
    "put_motion": (_P, _I),
    "next_motion": (),
    "get_events": (_P, _I),
    "get_motion": (_P, _I),
    "get_frames": (_P, _I),
    "write": (_I, _I),
}


@cache
def native() -> SimpleNamespace:
    """Return the functions of ``callback.py`` that Python calls, and all addresses."""
    from ..targets.llvm.cache import load

    addresses = load(*PUMP).addresses
    called = {
        name: form(_I, _P, *arguments)(addresses[name])
        for form, functions in ((ctypes.CFUNCTYPE, BLOCKS), (ctypes.PYFUNCTYPE, RINGS))
        for name, arguments in functions.items()
    }
    return SimpleNamespace(addresses=addresses, **called)


# The compiled pump and its memory -----------------------------------------------------
class Pump:
    """A processor with the memory that the compiled callback works on.

    A sink sets its device's words with ``write`` and ``address_of``, and passes
    ``pump.context`` to the callback as user data: ``pump.callback("jack")`` and
    ``pump.callback("portaudio")`` are the addresses of the callbacks.  The sink must
    keep this object alive as long as the device may call.

    Parameters
    ----------
    proc : Processor
        Processor of a protected scene, target llvm, at sample 0.
    safety : Safety
    channels : sequence of int
        For each channel the number of its output, or -1 for silence.
    source : Source or None
        See ``stimlib.devices.sources``.
    log : bool
        Keep motion and frames for the log; events are always kept.
    markers : sequence of str
        Marker outputs: an event is written where one rises to 0.5 or more.
    """

    def __init__(
        self,
        proc: Processor,
        safety: Safety,
        channels: Sequence[int],
        source: Source | None,
        log: bool = False,
        markers: Sequence[str] = (),
    ):
        self.native = native()
        self.proc, self.safety, self.channels = proc, safety, tuple(channels)
        self.markers = tuple(markers)
        self.fade = safety.samples(proc.fs)
        self.params = {name: j for j, name in enumerate(proc.program.params)}
        inputs, outputs = len(proc.inputs), len(proc.outputs)
        self.room = FOREVER  # frames of the buffers that OUTS points to, where it is known
        self.words = np.zeros(words.WORDS, np.int64)
        self.arrays: list[np.ndarray] = []
        self._libc: Any = libc() or import_module("ctypes").WinDLL("kernel32")

        place = self.address_of
        ring = 1 << math.ceil(math.log2(max(proc.fs * LOG_SECONDS, 4 * words.CHUNK)))
        rows = max(inputs, 1)
        self._fill(
            ENTRY=proc.address[0],
            CONTEXT=proc.address[1],
            PENDING=int(proc._engine.ctx[PENDING]),
            N_IN=inputs,
            N_OUT=outputs,
            CHANNELS=len(self.channels),
            MAP=place(np.array(self.channels, np.int64)),
            SCALES=place(safety.scales(proc.outputs)),
            X=place(np.zeros(rows * words.CHUNK)),
            Y=place(np.zeros(outputs * words.CHUNK)),
            GAIN_PARAM=self.params[GAIN],
            FADE=self.fade,
            FADE_AT=FOREVER,
            END=FOREVER,
            STALE_AFTER=FOREVER
            if isinstance(source, Stream) and source.silence == "hold"
            else round(SILENT * proc.fs),
            HOLD=place(np.zeros(rows)),
            C_RING=place(np.zeros(words.RECORD * (words.COMMANDS + words.SPARE), np.int64)),
            E_RING=place(np.zeros(words.RECORD * words.EVENTS, np.int64)),
            LOG=int(log),
            L_SIZE=ring,
            OUTS=place(np.zeros(len(self.channels), np.int64)),
            STRIDE=1,
            INS=place(np.zeros(rows, np.int64)),
            IN_STRIDE=1,
            CLOCK=self._function("clock_gettime", "QueryPerformanceCounter"),
            CLOCK_ID=getattr(time, "CLOCK_MONOTONIC", 0),
            TICKS=self._ticks(),
            TIME=place(np.zeros(2, np.int64)),
            SLEEP=self._function("usleep", "Sleep"),
            HISTOGRAM=place(np.zeros(words.BINS, np.int64)),
            LATENESS=place(np.zeros(words.BINS, np.int64)),
            FRAME_NS=int(np.float64(1e9 / proc.fs).view(np.int64)),
            PORTS=place(np.zeros(len(self.channels), np.int64)),
            IN_PORTS=place(np.zeros(rows, np.int64)),
            TAIL=self.fade,
            LEVELS=place(np.zeros(outputs)),
            MARKS=len(self.markers),
            MARKED=place(np.array([proc.outputs.index(name) for name in self.markers], np.int64)),
            MARK_LAST=place(np.zeros(len(self.markers))),
        )
        self.histogram, self.lateness = self.buffers("HISTOGRAM"), self.buffers("LATENESS")
        if log:
            self._fill(
                X_RING=place(np.zeros(ring * max(inputs, 1))),
                F_RING=place(np.zeros(ring * len(self.channels), np.float32)),
            )
        if isinstance(source, Recorded):
            self._fill(MOTION=words.FROM_TABLE, TABLE=place(source.x), TABLE_N=source.x.shape[1])
        elif isinstance(source, (Scripted, Live)):
            size = 1 << math.ceil(math.log2(max(proc.fs, 4 * words.CHUNK)))
            keep = max(1, round(source.keep * proc.fs)) if isinstance(source, Live) else 0
            self._fill(
                MOTION=words.LIVE if keep else words.TIMED,
                TABLE_N=length(source) or 0,
                M_RING=place(np.zeros(size * inputs)),
                M_SIZE=size,
                M_KEEP=keep,
            )
        elif isinstance(source, Signals):
            scales = [[source.inputs[n].scale, source.inputs[n].offset] for n in proc.inputs]
            self._fill(MOTION=words.SIGNALS, IN_SCALE=place(np.array(scales, float)))
        self.live = isinstance(source, (Live, Signals))
        self._fill(STALE=int(self.live))
        self._records = np.zeros((512, words.RECORD), np.int64)
        self._columns = np.zeros((4096, max(inputs, 1)))
        self._frames = np.zeros((4096, len(self.channels)), np.float32)

    def _fill(self, **values: int) -> None:
        for name, v in values.items():
            self.words[getattr(words, name)] = v

    def address_of(self, a: np.ndarray) -> int:
        """Return the address of an array, and keep the array alive."""
        self.arrays.append(a)
        return a.ctypes.data

    def buffers(self, word: str) -> np.ndarray:
        """Return the array of addresses that a word of the context points to.

        The word is OUTS, INS, PORTS or IN_PORTS; there is one address per channel or
        input.
        """
        return next(a for a in self.arrays if a.ctypes.data == self.read(word))

    def _function(self, *names: str) -> int:
        """Return the address of the first of these functions that the system has."""
        found = next(getattr(self._libc, name) for name in names if hasattr(self._libc, name))
        return int(ctypes.cast(found, ctypes.c_void_p).value or 0)

    def _ticks(self) -> int:
        """Return the clock ticks per second on Windows, and 0 on other systems."""
        ticks = ctypes.c_int64(0)
        if not hasattr(self._libc, "clock_gettime"):
            self._libc.QueryPerformanceFrequency(ctypes.byref(ticks))
        return ticks.value

    def read(self, word: str) -> int:
        """Return a word of the context, by its name in ``devices/callback.py``."""
        return int(self.words[getattr(words, word)])

    def write(self, word: str, value: int) -> None:
        """Set a word of the context, by its name in ``devices/callback.py``."""
        self.native.write(self.context, getattr(words, word), value)

    @property
    def context(self) -> int:
        """Address of the context, which the callback gets as user data."""
        return self.words.ctypes.data

    def callback(self, device: str) -> int:
        """Return the address of the compiled callback for a device.

        The device is "jack" or "portaudio".
        """
        return self.native.addresses[device]

    def block(self, n: int, lost: int = 0) -> None:
        """Make one block from Python, in the buffers that OUTS points to."""
        if n > self.room:
            raise SinkError(
                f"a block of {counted(n, 'frame')} is more than the {self.room} of make_frames():"
                " call it in _open, after self.block is set, and ask for at most self.block frames"
            )
        self.native.block(self.context, n, lost)

    # Course ---------------------------------------------------------------------------
    @property
    def index(self) -> int:
        """Number of samples produced so far."""
        return self.proc.index

    @property
    def state(self) -> int:
        """State of the session: IDLE, RUNNING, DONE or CLOSED."""
        return self.read("STATE")

    @property
    def hurried(self) -> bool:
        """Whether the device runs without a clock, as fast as it can."""
        return self.read("WAIT") > 0

    def start(self, frames: int | None, first: np.ndarray | None = None) -> None:
        """Start playing a number of samples with the next block.

        Given the outputs of sample 0 as ``first``, the device fades in to them
        beforehand; otherwise the gain rises during the first samples.
        """
        if frames is not None:
            self.write("END", frames)
        if first is not None:
            self.buffers("LEVELS")[:] = first
            self.write("LEAD", self.fade)
        if not self.live:  # the gain rises with the first motion
            self.set(GAIN, 1.0, self.fade if first is None else 1)
        self.write("STATE", words.RUNNING)

    def set(self, name: str, value: float, ramp: int) -> bool:
        """Request the change of a parameter over ``ramp`` samples.

        Return False when the ring buffer is full.
        """
        bits = int(np.float64(value).view(np.int64))
        return bool(self.native.put_command(self.context, words.SET, self.params[name], bits, ramp))

    def waiting(self) -> Iterator[tuple[str, float, int]]:
        """Yield the changes that no block has taken yet: name, value, ramp."""
        names, ring = [*self.params], self.buffers("C_RING").reshape(-1, words.RECORD)
        for at in range(self.read("C_READ"), self.read("C_WRITE")):
            kind, param, bits, ramp, _ = ring[at % len(ring)].tolist()
            if kind == words.SET:
                yield names[param], float(np.int64(bits).view(np.float64)), ramp

    def stop(self, reason: str, earliest: int = 0) -> None:
        """Request a fade-out, at sample ``earliest`` or later.

        The state is DONE when the fade-out has ended.
        """
        self.native.put_command(self.context, words.STOP, REASONS.index(reason), earliest, 0)

    # Rings ----------------------------------------------------------------------------
    def _taken(self, what: str, out: np.ndarray) -> int:
        """Fill an array with rows of a ring buffer, and return their number."""
        return getattr(self.native, what)(self.context, out.ctypes.data, out.shape[0])

    def put_motion(self, x: np.ndarray) -> int:
        """Put columns, shape (n_inputs, n), into the ring; return how many fitted."""
        x = np.ascontiguousarray(x, float)
        return self.native.put_motion(self.context, x.ctypes.data, x.shape[1])

    def next_motion(self) -> int:
        """Return the index of the next column of motion to write."""
        return self.native.next_motion(self.context)

    def motion_room(self) -> int:
        """Return how many columns of motion can be written now."""
        most = min(self.read("M_SIZE"), max(int(0.5 * self.proc.fs), 2 * words.CHUNK))
        return most - self.read("M_WRITE") + self.read("M_READ")

    def frames(self) -> np.ndarray:
        """Return up to 4096 frames delivered since the last call.

        The array is valid until the next call.
        """
        return self._frames[: self._taken("get_frames", self._frames)]

    def motion(self) -> np.ndarray:
        """Return the motion processed since the last call, shape (n, n_inputs).

        The array has up to 4096 rows and is valid until the next call.
        """
        return self._columns[: self._taken("get_motion", self._columns)]

    def events(self) -> list[tuple[int, str, dict[str, Any]]]:
        """Return (sample index, kind, data) for each event since the last call."""
        found = []
        while count := self._taken("get_events", self._records):
            for at, kind, a, b, c in self._records[:count].tolist():
                value = float(np.int64(b).view(np.float64))
                name, data = EVENTS[kind]
                found.append((at, name, data(self, a, b, c, value)))
        return found

    def timed(self) -> tuple[int, int] | None:
        """Return a frame, and the monotonic time in ns when its block began."""
        for _ in range(10):
            before = self.read("TIMES")
            pair = self.read("TIMED_AT"), self.read("TIMED_NS")
            if before and before % 2 == 0 and self.read("TIMES") == before:
                return pair
        return None

    def percentiles(self, *q: float, of: np.ndarray | None = None) -> list[float]:
        """Return percentiles of the block time in s, at most 12.5 % too high.

        ``of`` is another histogram, that of the lateness.
        """
        counts = np.cumsum(self.histogram if of is None else of)
        if not counts[-1]:
            return [0.0 for _ in q]
        places = [int(np.searchsorted(counts, max(1, math.ceil(p / 100 * counts[-1])))) for p in q]
        return [1e-9 * (k + 1 if k < 8 else (9 + k % 8) << (k // 8 - 1)) for k in places]
