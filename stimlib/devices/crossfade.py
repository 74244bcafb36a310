"""A session that follows another on its device, as an edited scene does.

The callback of the device runs both sessions for the length of a fade and adds their
frames; before and after, each is a session like any other, with its own log.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ..core.scene import Scene
from ..errors import BadValue, SinkError
from ..run.safety import Safety
from . import words
from .sink import Sink
from .sources import Live, Receiver, Recorded, Scripted, Signals, Source

AHEAD = 0.05
"""Seconds from the request for a crossfade to its first sample, so that the request and
the first motion are there in time. A session that begins later skips what it missed of
its motion, up to the half second that is computed ahead.
"""


class Following(Sink):
    """The session that follows ``before`` on the device that ``root`` has opened.

    Its gain rises along its first samples, so that its motion goes on at once.

    Parameters
    ----------
    before : Sink
    scene, safety, **options
        See ``Sink``.
    """

    leads = False
    _begun_log: Any = None

    def __init__(self, before: Sink, scene: Scene, safety: Safety, **options: Any):
        self.before: Any = before
        self.root: Sink = getattr(before, "root", before)
        if "motion" not in options and [*scene.inputs] == [*before.scene.inputs]:
            options["motion"] = before.given
        for name in ("device", "clock", "silent_for", "gone"):
            setattr(self, name, getattr(before, name))
        super().__init__(scene, safety, realtime=False, **options)
        self._counted = before._counted
        ours, theirs = _outputs(scene), _outputs(before.scene)
        if ours != theirs:
            raise SinkError(
                f"{before.device}: a scene with the outputs {ours} cannot follow one with {theirs}:"
                " end, and play it anew"
            )
        heard = [*before.scene.inputs] if isinstance(before.given, Signals) else []
        if isinstance(self.given, Signals) and [*scene.inputs] != heard:
            raise BadValue(
                f"{before.device}: Signals of {', '.join(scene.inputs)} follow a session with those"
                f" of {', '.join(heard) or 'nothing'}: the device has opened no others"
            )
        names = tuple(scene.outputs)
        for what, of in (
            ("fade", lambda s: s.fade),
            ("full_scale", lambda s: s.scales(names).tolist()),
        ):
            mine, its = of(self.safety), of(before.safety)
            if mine != its:
                raise BadValue(
                    f"Safety: {what} = {mine} must be {its}, as in the session before: the two are"
                    " added on one device"
                )

    def _aim(self) -> None:
        """Choose the sample at which the session begins, where the motion goes on."""
        self._begun_log = super()._make_log()  # first: it takes the time of a disk
        # a motion in real time must not wait, or it would lag behind from then on
        timed = isinstance(self.motion, Recorded | Scripted)
        self.at = min(
            self.before.pump.index + timed * round(AHEAD * self.rate),
            self.before.pump.read("END"),  # where the other begins, if that comes first
        )
        self._since = self.before.since + self.at
        self.motion = later(self.motion, self._since, self.rate)

    def _open(self) -> None:
        self.block = self.before.block
        self._frames = np.zeros((self.channels, words.CHUNK), np.float32)
        rows = self._frames.ctypes.data + self._frames.strides[0] * np.arange(self.channels)
        self.pump.buffers("OUTS")[:] = rows

    def _take_over(self) -> None:
        """Stop what receives the motion of the session before, which holds its last."""
        if isinstance(self.before._feeder, Receiver):
            self.before._feeder.over.set()
            self.before._feeder.join(1.0)

    def link(self, at: int) -> None:
        """Let the session begin where the one before begins to fade out."""
        if (
            isinstance(self.motion, Live)
            and self.before.pump.live
            and not self.before.pump.read("STALE")
        ):  # the gain rises with it
            # the last position of each input, as the callback holds it
            rows = dict(zip(self.before.proc.inputs, self.before.pump.buffers("HOLD"), strict=True))
            self.pump.put_motion(np.array([[rows.get(n, 0.0)] for n in self.proc.inputs]))
        self.pump.write("SKIP", -at)
        self.before.pump.write("NEXT", self.pump.context)
        self.before.pump.stop("next", at)

    def stop(self, reason: str = "stop") -> None:
        """Fade out, as ``Sink.stop``; before it has begun, it is not to begin."""
        if self._started and not self.pump.read("CALLS"):
            self.pump.write("STATE", words.DONE)
        super().stop(reason)

    def _make_log(self) -> Any:
        return self._begun_log

    def _close(self) -> None:
        from ..files.log_writer import LogWriter

        self.pump.write("STATE", words.CLOSED)
        if not self._started and isinstance(self._begun_log, LogWriter):
            self._begun_log.close()

    def _latency(self) -> float:
        return self.root._latency()


def follow(before: Sink, scene: Scene, safety: Safety | None, **options: Any) -> Following:
    """Return an open session for ``Sink.crossfade``, not yet started.

    The session before is the newest of its device, and the sessions before that are let
    go.
    """
    if not isinstance(scene, Scene):
        raise BadValue(f"crossfade takes a Scene, got {type(scene).__name__}")
    root: Any = getattr(before, "root", before)
    end = time.monotonic() + before.safety.fade + 1.0
    old: Any = getattr(before, "before", None)
    while old is not None and not old.finished:
        if time.monotonic() > end:
            raise SinkError(f"{before.device}: the session before has not faded out")
        time.sleep(0.002)
    options = {"calibration": before.calibration} | options
    options["params"] = {
        n: v for n, v in (before.params | before.changed).items() if n in scene.params
    } | options.get("params", {})
    made = Following(before, scene, before.safety if safety is None else safety, **options)
    names = [before.proc.outputs[k] if k >= 0 else None for k in before.map]
    made.open(before.rate, names, before.block)
    if old is not None and old is not root:
        root.pump.write("NEXT", before.pump.context)
        root._next, old._next, made.before.before = before, None, root
        old.close()
    # the callback may be in a session that was let go just now: it stays for one more
    root.kept = [*root.kept[-2:], made]
    return made


def later(source: Source | None, samples: int, fs: float) -> Source | None:
    """Return a motion from a sample on; what is not given by its time is as it was."""
    if isinstance(source, Recorded):
        return Recorded(source.x[:, min(samples, source.x.shape[1] - 1) :])
    if isinstance(source, Scripted):
        return Scripted({n: _later(v, samples, fs) for n, v in source.motion.items()})
    return source


def _later(motion: Any, samples: int, fs: float) -> Any:
    if callable(motion):
        return lambda t: motion(t + samples / fs)
    return motion[min(samples, len(motion) - 1) :]


def _outputs(scene: Scene) -> str:
    return ", ".join(f"{n} [{b.dim}]" for n, b in scene.outputs.items())
