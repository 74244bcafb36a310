"""Presentation of a trial on a sink, and the record of what was displayed.

The stimulus of an interval is a segment: its scene as rendered on its own, multiplied
by a window. A trial is therefore one scene with one log, on any sink, with any movement
of the hand; it is replayed and verified like any other session.
"""

from __future__ import annotations

import dataclasses as dc
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..blocks import segment, timeline, where, white_noise
from ..core.graph import Block, constant
from ..core.parts import Part, Span
from ..core.scene import Scene
from ..devices.available import SINKS as KINDS, make
from ..devices.sink import Sink
from ..devices.sources import Live, Signals
from ..errors import BadValue, MotionError, UnknownName, computed, public
from ..files.log_reader import read_log
from ..files.log_replay import delivered, without_inverse
from ..files.log_writer import LogWriter, header
from ..run.rendering import render
from ..run.safety import GAIN, Safety
from .experiment import STARTS, Cursor, Experiment
from .trial import FAST, Trial

if TYPE_CHECKING:
    from .session import Session

TOLD = {
    "produced", "delivered", "lost", "underruns", "clips", "outside", "energy", "faults", "stale"
}  # fmt: skip
TOLD |= {"rise", "fall", "rows", "rejected", "quiet", "silent"}
"""Fields of a sink's report that the record of a trial contains."""

MASKING_STREAM = 2**32 - 1  # of its noise, which no scene has


# The program --------------------------------------------------------------------------
@public
def spans(experiment: Experiment, trial: Trial) -> list[tuple[int, int]]:
    """Return the first sample of each interval and the one after its last.

    The first interval comes after ``timing.before`` s and the sink's fade-in, so that
    this fade affects no stimulus. A self-paced interval has its longest time; it comes
    after ``timing.gap`` s, if that is longer.

    Examples
    --------
    See `program`.
    """
    t, fs = experiment.timing, experiment.fs
    first = round(max(t.before, t.gap * t.self_paced) * fs) + _safety(experiment).samples(fs)
    long, apart = round((t.interval + t.wait) * fs), round(t.gap * fs)
    return [
        (at, at + long) for at in (first + i * (long + apart) for i in range(len(trial.stimuli)))
    ]


@public
def program(experiment: Experiment, trial: Trial) -> tuple[Scene, dict[str, float]]:
    """Return a trial as one scene, with its initial parameters.

    Parameters
    ----------
    experiment : Experiment
    trial : Trial

    Returns
    -------
    scene : Scene
        All outputs of the experiment, in the order of its scenes, so that each has the
        same channel in every trial; each is 0 outside its intervals. The masking noise
        is included, if there is any; so is ``timing.starts``, as the last output.
    params : dict of str to float
        Parameters that differ from the scenes'. With several intervals, each interval
        has its own, numbered after the name: ``k_1``, ``k_2``.

    Raises
    ------
    BadValue, UnknownName
        A trial that the experiment does not allow (``Experiment.check``).

    Notes
    -----
    The run uses the seed of the first stimulus. Within its interval each stimulus uses
    its own seed: stimuli with equal seeds have identical noise samples.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.experiments import Experiment, Timing, choice, program, spans
    >>> from stimlib.experiments import Stimulus, Trial
    >>> spring = stimlib.Scene(
    ...     {"force": stimlib.Param("k", 2.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> which = choice("softer", "?", "first", "second")
    >>> pair = Experiment(
    ...     "pair",
    ...     "1",
    ...     {"spring": spring},
    ...     lambda who, session: None,
    ...     (which,),
    ...     fs=1000,
    ...     safety=10.0,
    ...     timing=Timing(interval=0.1, gap=0.05, before=0.0, ramp=0.0),
    ... )
    >>> trial = Trial(
    ...     "a",
    ...     (Stimulus("spring", {"k": 1.0}), Stimulus("spring", {"k": 3.0})),
    ...     ("softer",),
    ... )
    >>> spans(pair, trial)  # the fade of the sink comes first
    [(128, 228), (278, 378)]
    >>> scene, params = program(pair, trial)
    >>> force = stimlib.render(
    ...     scene, {"x": lambda t: 1.0 + 0 * t}, fs=1000, seconds=0.4, params=params
    ... )["force"]
    >>> force[[127, 128, 227, 228, 277, 278, 377, 378]].tolist()
    [0.0, 1.0, 1.0, 0.0, 0.0, 3.0, 3.0, 0.0]
    """
    experiment.check(trial)
    outputs: dict[str, Block] = {}  # of the scenes of this trial
    start: dict[str, float] = {}
    laws: list[Part] = []
    for i, ((a, b), s) in enumerate(zip(spans(experiment, trial), trial.stimuli, strict=True), 1):
        scene, at, long, ramp = (
            experiment.scenes[s.scene],
            a / experiment.fs,
            (b - a) / experiment.fs,
            experiment.timing.ramp,
        )
        own = {name: f"{name}_{i}" if len(trial.stimuli) > 1 else name for name in scene.params}
        start |= {
            own[name]: float(v) for name, v in s.params.items() if v != scene.params[name].value
        }
        window = timeline([(0.0, 0.0), (ramp, 1.0), (long - ramp, 1.0), (long, 0.0)], "cosine")
        seed = None if s.seed == trial.stimuli[0].seed else s.seed
        scene = scene.renamed(own)
        laws += [
            dc.replace(p, name=f"interval_{i}", span=Span(at, long, ramp, seed))
            for p in scene.parts
            if p.span is None
        ]
        for output, block in scene.outputs.items():
            y = segment(window * block, at, long, seed)
            # a sum would make 0 of -0
            outputs[output] = where(y.by, y, outputs[output]) if output in outputs else y
    every = {
        name: outputs.get(name, constant(0.0, str(unit)))
        for name, unit in experiment.outputs.items()
    }
    if m := experiment.masking:
        every[m.output] = m.rms * white_noise(seed=0, stream=MASKING_STREAM)
    if experiment.timing.starts is not None:
        every[STARTS] = experiment.timing.starts
    return Scene(every, laws), start


def _safety(experiment: Experiment) -> Safety:
    s = experiment.safety
    return s if isinstance(s, Safety) else Safety(s)


def _protection(experiment: Experiment, scene: Scene) -> Safety:
    """Return the experiment's safety stage, with full scale 1 for what has no unit.

    This is the masking noise, and the condition that begins an interval.
    """
    s, m = _safety(experiment), experiment.masking
    ours = {STARTS, m.output if m else STARTS} & scene.outputs.keys()
    if not ours:
        return s
    rest = [name for name in scene.outputs if name not in ours]
    scale: Any = (
        s.full_scale if isinstance(s.full_scale, Mapping) else dict.fromkeys(rest, s.full_scale)
    )
    slew = dict.fromkeys(rest, s.slew) if isinstance(s.slew, float) else s.slew
    return dc.replace(s, full_scale={**scale, **dict.fromkeys(ours, 1.0)}, slew=slew)


def _moves(experiment: Experiment, scene: Scene) -> Any:
    """Return the motions of the inputs that this trial's scene has.

    A real-time motion is returned whole, with its rows in the order of the inputs.
    """
    m = experiment.motion
    if isinstance(m, (Live, Signals)) and tuple(scene.inputs) != experiment.inputs:
        raise BadValue(
            f"motion={type(m).__name__}: a trial takes the inputs"
            f" {', '.join(scene.inputs) or 'none'}, the experiment {', '.join(experiment.inputs)}:"
            " a row of positions would mean another input there. Let all scenes use all inputs, in"
            " the same order"
        )
    return {name: m[name] for name in scene.inputs if name in m} if isinstance(m, Mapping) else m


# Sinks by name ------------------------------------------------------------------------
SINKS = (*KINDS, *FAST)
"""Names of all sinks."""


@public
def prepare(session: Session, sink: str, **options: Any) -> int:
    """Compile all programs of a session, and open its sink once, before it begins.

    Compiling them later would delay the first stimulus of each kind, which reveals the
    kind.  What fails here would fail after the participant has begun.

    Parameters
    ----------
    session : Session
        Opened by ``with``; it is not changed.
    sink : str
        Name in ``SINKS``; another name is that of a display of its own, which is not
        opened.
    **options
        More for the sink, as `present` takes them.

    Returns
    -------
    int
        Number of compiled programs; trials with the same scenes share one.

    Raises
    ------
    SinkError
        The device cannot be opened; as `Session.due`.
    BadValue, UnknownName
        A trial that the session may come to is not allowed, or its scene cannot be
        compiled at this rate; a calibration does not fit the outputs.
    """
    e, done = session.experiment, set[tuple[str, ...]]()
    for trial in filter(None, chain([session.due()], session.ahead())):
        if not trial.stimuli or (kind := tuple(s.scene for s in trial.stimuli)) in done:
            continue
        scene, params = program(e, trial)
        name, how = sink, options | {"motion": _moves(e, scene)}
        if done or sink not in KINDS:  # compiled alone
            name = "null"
            how = {"calibration": options.get("calibration"), "clocked": False, "motion": Live()}
        with make(name, scene, _protection(e, scene), params=params, **how) as one:
            channels = [name for name in scene.outputs if name != STARTS]
            one.open(e.fs, channels if len(channels) < len(scene.outputs) else None)
        done.add(kind)
    return len(done)


@public
def present(
    experiment: Experiment,
    trial: Trial,
    sink: str | Callable[..., Sink] = "offline",
    log: str | os.PathLike[str] | None = None,
    began: Callable[[Sink], None] | None = None,
    *,
    interval: int = 1,
    meanwhile: Callable[[], Any] | None = None,
    lasts: float | None = None,
    started: Callable[[], Any] = lambda: None,
    **options: Any,
) -> dict[str, Any]:
    """Present a trial once, with the safety stage.

    Parameters
    ----------
    experiment : Experiment
    trial : Trial
    sink : str or callable
        Name in ``SINKS``, or ``sink(scene, safety, **options)`` returns a sink that has
        a motion of its own.
    log : path, optional
        Folder for the log of this presentation; required to record what was displayed.
    began : callable, optional
        ``began(sink)`` is called when the sink has started; sample 0 follows.
    interval : int
        Number of the trial's only stimulus, if its intervals are self-paced.
    meanwhile : callable, optional
        Called when the stimulus has begun, which fades out when it returns; the
        ``hand`` of the experiment then has a thread of its own.
    lasts : float, optional
        Time in s after which a simulated observer ends the stimulus, instead.
    started : callable, optional
        Called when ``timing.starts`` holds.
    **options
        More for the sink, such as ``server`` of JACK, ``calibration``, or ``send``: the
        sink sends a marker for the trial at sample 0, and one at the onset of each
        stimulus, with its number as the value.

    Returns
    -------
    dict
        JSON data: ``sink``, ``fs``, ``scene`` (hash of the program), ``seed``,
        ``params`` at its start, ``intervals`` (first sample and the one after the
        last), ``time`` ("own", see `stimlib.experiments.trial.Record.time`), the sink's
        report (``produced``, ``delivered``, ``lost``, ``underruns``, ``clips``,
        ``faults``, ``stale``); with a log also its name, and ``peak`` and ``rms`` of
        each output in each interval as delivered, after all limits; with a cursor also
        ``following``, see `followed`. A presentation whose motion in real time never
        came, or stayed away in an interval (by its log), is ``missed``; ``silent`` says
        why. ``rows``, ``rejected`` and ``quiet`` are those of the sink's report.
        ``started`` is the date and time of sample 0, ISO 8601, UTC; ``clock`` is
        whether the sink ran in real time from then on. Of a self-paced interval
        ``interval`` is its number, and ``intervals`` ends where the stimulus began to
        fade out; with ``timing.starts`` it begins at the sample at which that held, and
        ``held`` says whether it did.

    Raises
    ------
    UnknownName
        No sink of this name.
    SinkError, FaultError
        The device is missing or has failed, the log cannot be written, or an output was
        not finite; the sink has faded out.
    """
    if not callable(sink) and sink not in SINKS:
        raise UnknownName(f"no sink {sink!r}; there are {', '.join(SINKS)}")
    scene, params = program(experiment, trial)
    safety, seed, t = _protection(experiment, scene), trial.stimuli[0].seed, experiment.timing
    at, to, late, held = spans(experiment, trial), None, 0, list[int]()
    channels = [name for name in scene.outputs if name != STARTS]

    def noticed(marker: Any) -> None:
        if marker.name == STARTS and not held:
            held.append(max(marker.sample - late, at[0][0]))
            if known is None:
                playing.pump.stop("stop", held[0] + late + round(t.interval * experiment.fs))
            started()

    if (calibration := options.pop("calibration", None)) is not None:
        safety = calibration.safety(scene, safety, experiment.fs)
        late = len(safety.to_dict()["inverse"]["taps"]) // 2
    send = options.get("send") or ()
    options |= {
        "motion": _moves(experiment, scene),
        "seed": seed,
        "params": params,
        "markers": () if t.starts is None else (STARTS,),
        "send": [noticed, *(send if isinstance(send, Sequence) else [send])],
    }
    kind, clock = ("null", {"clocked": False}) if sink in FAST else (sink, {})
    # without a clock, a marker is told too late to end an interval
    known = _first_held(experiment, options["motion"], *at[0]) if clock else None
    made = kind if callable(kind) else partial(make, kind)
    hand = None if callable(sink) else experiment.hand
    ends = (
        at[-1][1] + safety.samples(experiment.fs)
        if lasts is None
        else min(at[0][0] + max(round(lasts * experiment.fs), 1), at[0][1])
    )
    if known is not None:
        ends = min(ends, known + round(t.interval * experiment.fs))
    if log is not None:
        Path(log).parent.mkdir(parents=True, exist_ok=True)
        to = (
            log
            if sink != "file"
            else LogWriter(
                log,
                header(
                    scene, safety, experiment.fs, seed=seed, params=params, channels=[*channels]
                ),
                True,
            )
        )
    try:
        if not isinstance(playing := made(scene, safety, log=to, **options, **clock), Sink):
            given = type(playing).__name__
            raise BadValue(f"present: sink gives a {given}, where it must give a Sink")
        playing.open(experiment.fs, channels if len(channels) < len(scene.outputs) else None)
    except BaseException:
        if isinstance(to, LogWriter):
            to.close()
        raise
    with suppress(MotionError), playing:  # it is in the report
        playing.start((ends + late) / experiment.fs)
        zero = datetime.now(UTC).isoformat()
        playing.mark("trial", sample=0)
        for i, (first, _) in enumerate(at, interval):
            playing.mark("stimulus", i, sample=first + late)
        if began is not None:
            began(playing)
        if meanwhile is not None and lasts is None:
            moved = ThreadPoolExecutor(1).submit(hand or Sink.wait, playing)
            playing.wait((at[0][0] + safety.samples(experiment.fs)) / experiment.fs)
            meanwhile()
            playing.stop()
            moved.result()
        elif hand is not None:
            hand(playing)
        playing.wait()
    told = {k: v for k, v in playing.report().to_dict().items() if k in TOLD}
    if t.self_paced:
        gone = min(told["produced"], playing.pump.read("FADE_AT")) - late
        at = [(min(held[0] if held else a, gone), min(b, gone)) for a, b in at]
        told |= {"interval": interval, "held": None if t.starts is None else bool(held)}
    shown = {
        "sink": playing.device if callable(sink) else sink,
        "fs": experiment.fs,
        "scene": scene.hash,
        "seed": seed,
        "params": params,
        "intervals": at,
    }
    shown |= {"time": "own", "started": zero, "clock": getattr(playing, "clock", True), **told}
    shown["silent"] = str(playing.error or "")
    found = {} if log is None else {"log": Path(log).name} | measured(experiment, log, at)
    if not shown["silent"] and any(found.get("away", ())):
        shown["silent"] = f"no motion came for {max(found['away']):.3g} s of an interval"
    return shown | found | ({"missed": True} if shown["silent"] else {})


def _first_held(experiment: Experiment, motion: Any, first: int, end: int) -> int | None:
    """Return the first sample of an interval at which ``timing.starts`` holds."""
    starts = experiment.timing.starts
    if starts is None:
        return None
    scene = Scene({STARTS: starts})
    if not isinstance(motion, Mapping) or set(scene.inputs) - set(motion):
        return None
    way = {name: motion[name] for name in scene.inputs}
    y = render(scene, way, experiment.fs, end / experiment.fs)[STARTS]
    held = np.flatnonzero(y >= 0.5)
    return max(int(held[0]), first) if held.size else None


# What came out ------------------------------------------------------------------------
@public
def measured(
    experiment: Experiment, folder: str | os.PathLike[str], at: list[tuple[int, int]]
) -> dict[str, Any]:
    """Return peak and RMS of each output in each interval, in the outputs' units.

    They are computed from the samples delivered according to the log; for a calibrated
    device, from the outputs before the inverse filter. If there is a reference to
    follow, the result includes how well the hand followed it. An interval that was
    stopped gives None. ``away`` is for how many seconds of each interval a motion in
    real time stayed away, so that the outputs were faded out; on a calibrated device an
    interval lasts from its first sample until the last has passed the inverse filter.

    Parameters
    ----------
    experiment : Experiment
    folder : path
        Folder of a log.
    at : list of (int, int)
        As `spans` has them.
    """
    log = without_inverse(played := read_log(folder))
    inverse: Any = played.safety.inverse
    scales = log.safety.scales(log.outputs)[list(log.channels)]
    peak, power = np.zeros((2, len(at), len(scales)))
    for first, frames, there in delivered(log):
        for i, (a, b) in enumerate(at):
            part = frames[max(a - first, 0) : max(b - first, 0)].astype(np.float64) * scales * there
            if len(part):
                peak[i] = np.maximum(peak[i], np.abs(part).max(axis=0))
                power[i] += (part**2).sum(axis=0) / max(b - a, 1)
    found: dict[str, Any] = {
        what: {name: values[:, k].tolist() for k, name in enumerate(log.outputs[: len(scales)])}
        for what, values in (("peak", peak), ("rms", np.sqrt(power)))
    }
    end = min([log.frames, *(e.at for e in log.events if e.kind == "stop")])
    gains = [(c.at, c.value) for c in log.changes if c.name == GAIN and c.at < end]
    off = [(p, q) for (p, gain), (q, _) in pairwise([(0, 0.0), *gains, (end, 0.0)]) if not gain]
    late = len(inverse.taps) // 2 if inverse else 0  # the gain comes behind the inverse filter
    found["away"] = [
        sum(max(0, min(b + late, q) - max(a, p)) for p, q in off) / log.fs for a, b in at
    ]
    if experiment.cursor is not None and experiment.cursor.input in log.inputs:
        k = log.inputs.index(experiment.cursor.input)
        hands = [log.motion[a:b][:, k] for a, b in at]
        # not so where it was stopped
        whole = [len(x) == b - a > 0 for x, (a, b) in zip(hands, at, strict=True)]
        found["following"] = [
            followed(x, experiment.cursor, log.fs) if w else None
            for x, w in zip(hands, whole, strict=True)
        ]
    return found


@public
@computed
def followed(x: NDArray[np.float64], cursor: Cursor, fs: float) -> dict[str, float]:
    """Return how well a motion followed the reference.

    A sine and a cosine at its frequency, and a constant, are fitted by least squares.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Position, beginning when the reference began.
    cursor : Cursor
    fs : float
        Hz.

    Returns
    -------
    dict of str to float
        ``gain``: amplitude relative to the reference; ``lag`` in s, positive behind it;
        ``error``: RMS of the distance to it, in the unit of x.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments import Cursor, followed
    >>> t = np.arange(3000) / 1000
    >>> {
    ...     k: round(v, 6)
    ...     for k, v in followed(
    ...         0.009 * np.sin(2 * np.pi * (t - 0.05)), Cursor("x", 0.01), 1000
    ...     ).items()
    ... }
    {'gain': 0.9, 'lag': 0.05, 'error': 0.002215}
    """
    if np.ndim(x) != 1 or np.asarray(x).dtype.kind not in "iuf" or not len(x):
        raise BadValue(f"followed: x = {x!r:.80} must be a row of positions")
    t = np.arange(len(x)) / fs
    w = 2 * np.pi * cursor.frequency
    waves = np.stack([np.sin(w * t), np.cos(w * t), np.ones_like(t)], axis=1)
    (s, c, _), *_ = np.linalg.lstsq(waves, x)
    error = float(np.sqrt(np.mean((x - cursor.amplitude * waves[:, 0]) ** 2)))
    return {
        "gain": float(np.hypot(s, c) / cursor.amplitude),
        "lag": float(np.arctan2(-c, s) / w),
        "error": error,
    }
