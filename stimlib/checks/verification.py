"""Verification of renderings and files against their model.

Every check states what it compares, how large the difference was, and the limit.
"""

from __future__ import annotations

import dataclasses as dc
import math
import os
from collections import Counter
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, overload

import numpy as np

from ..analysis.passivity import damping_of
from ..analysis.thresholds import CHANNELS, MASKER, Felt, device_of, sensation_level
from ..blocks.integrals import power_of
from ..core.graph import Block, Const, Input, named, pack, reach, signals, type_name
from ..core.scene import Scene
from ..core.units import unit
from ..errors import BadValue, counted, public, shown
from ..files.audio import Stored
from ..files.formats import stored
from ..files.sidecar import told
from ..run.driver import samples, walk
from ..run.processor import Processor, compile
from ..run.rendering import Rendering
from ..virtual.device import Device
from .evidence import Check, Evidence, gather, stated
from .linear import laws_of
from .local import blocks_held
from .noise import generator, noise
from .report import Report
from .scenes import motor_limits, scene_law
from .sidecar import says, storage, sums_of

SMALL = 2.0**-40  # an impulse that no tracker takes for a jump
ROUNDING = 1e-10  # of two computations of one transfer function
# samples that the interpreter makes again, from some before a gate opens: as many as
# WORK allows, 1 for each word of state and BLOCK for each block; more than a tile
STRETCH, LEAST, AHEAD, WORK, BLOCK = 512, 96, 16, 200_000, 20
LANES = 8  # outputs of one kind, all of which run in the lanes of one vector


@overload
def verify(
    scene: str | os.PathLike[str],
    /,
    *,
    params: Mapping[str, float] | None = None,
    seed: int | None = None,
    device: Device | None = None,
) -> Report: ...
@overload
def verify(
    scene: Scene | None,
    motion: Mapping[str, Any] | None,
    rendering: Rendering | str | os.PathLike[str],
    *,
    params: Mapping[str, float] | None = None,
    seed: int | None = None,
    device: Device | None = None,
) -> Report: ...
@public
def verify(
    scene: Any,
    motion: Mapping[str, Any] | None = None,
    rendering: Any = None,
    *,
    params: Mapping[str, float] | None = None,
    seed: int | None = None,
    device: Device | None = None,
) -> Report:
    """Verify a rendering, or a file, against its scene and motion.

    If no scene is given, a file is verified by what its sidecar says.

    Parameters
    ----------
    scene : Scene or path
        What is expected; None for that of the file's sidecar, which the report then
        says.  A path alone is that of the file.
    motion : dict of str to callable or ndarray, optional
        As it was rendered.  By default, of a file, what the texts in its sidecar make
        again; where they do not, as of an array or a function of yours, it must be
        given.  Of a recording the sidecar has the call and the SHA-256 of its file,
        which must still be at its path.
    rendering : Rendering or path
        What was displayed.
    params : dict of str to float, optional
        Parameters that are expected at every sample; all others must be those of the
        scene.  Another value in the rendering is a failed check that names it.  By
        default none are expected: those that differ from the scene's are listed in the
        first line of the report.
    seed : int, optional
        The seed that is expected.
    device : Device, optional
        Of ``stimlib.virtual``: the report then says of each force over a position what
        energy it gives there, the damping that it needs, and the smallest margin.

    Returns
    -------
    Report
        ``passed``, ``checks``, ``to_html(path)``; ``print`` it for a table.

    Raises
    ------
    BadValue
        A file of another scene, sample rate or set of parameters, or made of a
        session's log; motion that does not fit, or that cannot be made again; a scene
        alone.
    RecordingError
        The file of a recording is not there, or is another.
    SceneFileError
        The sidecar has no scene, or one with a block that is not imported.
    SinkError
        A damaged file or sidecar.

    Examples
    --------
    >>> import stimlib, tempfile
    >>> from stimlib.motion import minimum_jerk
    >>> scene, motion = stimlib.scenes.squeeze(fingers=1), {"x1": minimum_jerk()}
    >>> rendering = stimlib.render(scene, motion, fs=8000, seconds=1.0)
    >>> stimlib.verify(scene, motion, rendering).passed
    True

    A file tells its scene and motion:

    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = rendering.save(folder + "/a.wav", full_scale=50.0)
    ...     stimlib.verify(folder + "/a.wav").passed
    True
    """
    if rendering is None:
        scene, rendering = None, scene
    path = isinstance(rendering, str | os.PathLike)
    if (
        isinstance(rendering, Rendering)
        and isinstance(scene, Scene)
        and motion is None
        and not scene.inputs
    ):
        motion = {}
    whole = isinstance(rendering, Rendering) and scene is not None and motion is not None
    if not (path or whole) or not isinstance(scene, Scene | None):
        raise BadValue(
            "verify: give the path of a file alone, or a scene, its motion and a rendering or the"
            " path of a file"
        )
    told = _motion_told(rendering, Stored(rendering).sidecar) if motion is None else motion
    e = gather(scene_told(rendering) if scene is None else scene, told, rendering)
    if scene is None:
        e.skipped.append(
            "the samples were compared with the scene in the sidecar only; to compare them with"
            " yours, give it: stimlib verify mine.py:scene --wav FILE"
        )
    groups = linear_blocks, same_samples, generator, noise, scene_law, limits_kept, blocks_held
    checks = [*stated(e, params, seed), *(check for group in groups for check in group(e))]
    say_felt(e)
    say_energy(e, device)
    return Report(checks, e)


def scene_told(path: str | os.PathLike[str]) -> Scene:
    """Return the scene that a file's sidecar states.

    Raises
    ------
    SceneFileError, SinkError
        As `verify`.
    """
    return Scene.from_dict(told(path)["scene"], f"{path}.json")


def _motion_told(path: Any, told: dict[str, Any]) -> dict[str, Any]:
    """Return the motion made from the texts of a sidecar."""
    from .. import motion  # which imports what reads recordings where there is one

    if any(text.startswith("log of") for text in told["motion"].values()):
        raise BadValue(
            f"{path} was made from a session's log; verify the log instead, with stimlib verify"
            " --log"
        )
    known: dict[str, Any] = {}
    for name, text in told["motion"].items():
        try:
            known[text] = known.get(text) or (
                motion.parse_source(text, pinned=True)
                if "recording" in text
                else motion.parse_motion(text)
            )
        except BadValue as e:
            why = (
                f"{e}; or"
                if text.startswith("recording(")
                else f"it cannot be made again from {text!r:.200}:"
            )
            raise type(e)(
                f"{path}: motion of {name}: {why} give the motion (--motion), as it was rendered"
            ) from e
    return {name: known[text] for name, text in told["motion"].items()}


# a: linear blocks ---------------------------------------------------------------------
def linear_blocks(e: Evidence) -> list[Check]:
    """Check the impulse responses of compiled linear blocks, and their physical laws.

    Check a1 compares the impulse response with the block's own discrete response, and
    check a2 compares that response with the law.
    """
    checks, seen = [], set()
    for i, q in enumerate(e.proc.program.instances):
        b, p = q.block, e.proc.design[i][0]
        own = "." in type_name(type(b))
        if q.kind != "block" or (type(b).transfer is None and not own):
            continue
        key = (type(b), pack(p).tobytes())
        if key in seen:
            continue
        seen.add(key)
        if type(b).transfer is None and type(b).law is not None:
            continue  # it is held against that, by ``blocks_held``
        if type(b).transfer is None:
            e.skipped.append(
                f"{b!r}: it states no response, so nothing but its own step, run again, was"
                " compared"
            )
            continue
        name = type(b).__name__
        f, H, h, settled = _impulse(b, p, e.fs)
        scale = np.abs(H).max() or 1.0
        if settled:
            apart = float(np.abs(h - H).max() / scale)
            checks.append(
                Check(
                    "a1",
                    f"{name}: impulse response",
                    apart,
                    ROUNDING,
                    f"compiled taps = discrete response of {b!r}",
                )
            )
        else:
            e.skipped.append(
                f"{name}: its impulse response never settles, so it is not transformed"
            )
        if not (known := laws_of(b, e.fs)):
            e.skipped.append(f"{b!r}: no physical law is known for it")
            continue
        transfer: Any = type(b).transfer
        for law in known:
            error = law.error(partial(_response, transfer, p, e.fs), e.fs)
            checks.append(
                Check(
                    "a2",
                    f"{name}: physical law",
                    error,
                    law.tol * (1 + 1e-6),
                    f"{law.text}, of {b!r}",
                )
            )
    return checks


def _response(transfer: Any, p: Any, fs: float, f: np.ndarray) -> np.ndarray:
    return transfer(p, np.exp(2j * np.pi * f / fs))


def _impulse(b: Block, p: Any, fs: float):
    """Return frequencies, the stated response and the measured one there.

    The measured response is the transform of the compiled impulse response. Whether
    that has settled is returned too.
    """
    x = Input("x")
    kind = type(b)
    lone = dc.replace(  # type: ignore[type-var]
        b, **{s: x if k == 0 else Const(1.0) for k, s in enumerate(signals(kind))}
    )
    proc = compile(Scene({"y": lone}), fs)
    hit = np.zeros((len(proc.inputs), 4096))
    hit[0, 0] = SMALL
    # a first sample sets what a block holds as its rest, so the impulse comes second
    proc.process(np.zeros((len(proc.inputs), 1)))
    parts = [proc.process(hit)[0].copy()]
    hit[0, 0] = 0.0
    last = peak = np.abs(parts[0]).max()
    least = 1 + math.ceil(b.memory(p) / hit.shape[1])  # what a long delay answers comes late
    while len(parts) < 512 and (len(parts) < least or last > 1e-18 * peak):
        parts.append(proc.process(hit)[0].copy())
        last = np.abs(parts[-1]).max()
        peak = max(peak, last)
    h = np.concatenate(parts) / SMALL
    spectrum = np.fft.rfft(h)
    bins = sorted({*np.geomspace(1, spectrum.size - 1, 600).astype(int).tolist()})
    f = np.array(bins) * fs / h.size
    settled = len(parts) >= least and last <= 1e-15 * peak
    # of a tail that falls as a power of time, what is cut off is about its last sample
    # times the length
    settled = settled and last / SMALL * h.size <= 0.1 * ROUNDING * np.abs(spectrum).max()
    return (
        f,
        kind.transfer(p, np.exp(2j * np.pi * f / fs)),  # type: ignore[misc]
        spectrum[bins],
        settled,
    )


# b: the same samples again ------------------------------------------------------------
def same_samples(e: Evidence) -> list[Check]:
    """Check the delivered samples against a re-render in random cuts.

    Some of the samples are compared with the interpreter as well.
    """
    rng, gated, wrong, apart = np.random.default_rng(e.seed), False, 0, 0
    python: list[Check] = []
    drawn = _drawn(e)

    def block() -> int:
        return int(rng.choice([1, 7, 64, 1000, 4096, 8192]))

    for s in e.stretches():
        gate = next((t.gate for t in s.taps if t.output in drawn), np.zeros(0, bool))
        opens = bool(gate.any()) and not gated
        if opens or not s.at:  # where the first gate opens, if it does
            start = s.at + (max(0, int(np.argmax(gate)) - AHEAD) if opens else 0)
            before = samples(e.proc, s.motion_at, start, e.changes, s.at, block)
            state = e.proc.state
            cut = np.hstack([before, samples(e.proc, s.motion_at, s.end, e.changes, start, block)])
            python = [_interpreted(s, drawn, state, start, cut)]
            gated = gated or opens
        else:
            cut = samples(e.proc, s.motion_at, s.end, e.changes, s.at, block)
        wrong += int(np.sum(cut.view(np.uint64) != s.y.view(np.uint64)))
        want = cut if e.sidecar is None else stored(cut, e.sidecar, s.at)
        apart += int(np.sum(s.shown.view(np.uint64) != want.view(np.uint64)))
    checks = [
        Check("b", "random cuts, other outputs added", wrong, 0, "samples whose bits differ"),
        *python,
    ]
    if e.session:  # checks/session.py compares what was delivered
        return checks
    if e.sidecar is None:
        return [*checks, Check("b", "delivered = re-render", apart, 0, "samples whose bits differ")]
    return [
        *checks,
        Check("b", f"file = re-render as {e.sidecar['subtype']}", apart, 0, "samples that differ"),
    ]


def _drawn(e: Evidence) -> list[str]:
    """Return the outputs that the interpreter makes again: all of a few.

    Of more, they are drawn with the seed until each class of block is in LANES of them.
    """
    drawn, known = set[str](), Counter[type]()
    for name in np.random.default_rng([e.seed, LANES]).permutation([*e.scene.outputs]).tolist():
        kinds = {type(b) for b in reach([e.scene.outputs[name]])}
        if any(known[kind] < LANES for kind in kinds):
            drawn.add(name)
            known.update(kinds)
    return [name for name in e.scene.outputs if name in drawn]


def _interpreted(
    e: Evidence, drawn: list[str], state: np.ndarray, start: int, cut: np.ndarray
) -> Check:
    """Check some samples of some outputs against the interpreter.

    It goes on from a compiled state: that of all outputs, or of the drawn ones alone.
    """
    proc, changes, every = e.proc, e.changes, [*e.scene.outputs]
    if len(drawn) < len(every):
        proc = compile(e.scene, e.fs, seed=e.seed, outputs=drawn)
        changes = [c for c in changes if c.name in proc.params]
    inputs = [e.proc.inputs.index(name) for name in proc.inputs]

    def motion(at: int, stop: int) -> np.ndarray:
        return np.ascontiguousarray(e.motion_at(at, stop)[inputs])

    if proc is not e.proc:
        for _ in walk(proc, motion, start, changes):
            pass
        state = proc.state
    many = max(LEAST, WORK // (state.size + BLOCK * len(proc.program.instances)))
    stretch = min(e.end - start, STRETCH, many)
    # what runs before sample 0 costs it 10 us each
    reference = Processor(proc.scene, e.fs, "python", e.seed, proc)
    reference.state = state
    y = samples(reference, motion, start + stretch, changes, start)
    rows = [every.index(name) for name in proc.outputs]
    made = cut[rows, start - e.at : start - e.at + stretch]
    wrong = int(np.sum(y.view(np.uint64) != made.view(np.uint64)))
    of = "" if proc is e.proc else f" of {len(rows)} of {len(every)} outputs"
    return Check(
        "b",
        f"interpreter, {stretch} samples from {start}{of}",
        wrong,
        0,
        "samples whose bits differ",
    )


# e: limits ----------------------------------------------------------------------------
def limits_kept(e: Evidence) -> list[Check]:
    """Check that samples are finite and limits are kept."""
    bad = sum(int(np.sum(~np.isfinite(s.shown))) for s in e.stretches())
    checks = motor_limits(e) + [Check("e", "finite", bad, 0, "samples that are not finite")]
    fault = e.proc.fault
    said = "guards that closed" if fault is None else f"{fault[0]} at sample {fault[1]}"
    if apart := e.sidecar is None and not e.session and e.told != fault:
        said += f"; the rendering tells {'of none' if e.told is None else shown(e.told)}"
    checks.append(Check("e", "no fault", int(fault is not None or apart), 0, said))
    if e.sidecar is not None:
        sums = sums_of(e)
        counts = [c["clips"] for c in e.sidecar["channels"]]
        apart = sum(abs(a - b) for a, b in zip(counts, sums.clips.tolist(), strict=True))
        checks.append(
            Check(
                "e",
                "clip count of the sidecar",
                apart,
                0,
                f"{counted(sum(counts), 'sample')} clipped",
            )
        )
        checks += [*says(e, sums), *storage(e, sums)]
    for info in {id(m.info): m.info for m in e.motion.values() if hasattr(m, "info")}.values():
        found = ", ".join(
            f"{len(info[what])} {what}" for what in ("gaps", "lifts", "jumps") if info[what]
        )
        text = (
            f"{info['reports']} reports at {info['rate']:.3g} Hz,"
            f" {counted(info['repeats'], 'repeat')} left out"
        )
        text += f", {info['silences']} silences held" if info["silences"] else ""
        e.skipped.append(
            f"between the reports of {Path(info['file']).name}: {text};"
            f" {found or 'no gaps, lifts or jumps'}"
        )
    return checks


# What is felt -------------------------------------------------------------------------
def say_felt(e: Evidence) -> None:
    """Add a line to the report for each output that has a device: what is felt of it.

    Of a file it also says by how much the stored samples differ, in the same unit.
    """
    devices = {name: device_of(e.scene, name) for name in e.scene.outputs}
    fast = e.fs > 2 * CHANNELS["NP"].low
    levels = {n: np.full(3, np.nan) for n, device in devices.items() if len(device) > 1 and fast}
    ends = np.empty((2, len(devices), 0))  # of the stretch before
    for s in e.stretches() if levels else ():
        rows = np.concatenate([ends, [s.y, s.shown]], axis=2)
        ends = rows[:, :, -math.ceil(e.fs) :]
        for name, y, shown_ in zip(devices, *rows, strict=True):
            if name in levels and not np.isfinite(y).all():
                del levels[name]
            elif name in levels:
                felt = sensation_level(y, e.fs, **devices[name])
                levels[name][:2] = np.fmax(levels[name][:2], felt[:2])
                if (shown_ != y).any() and e.sidecar is not None:
                    lost = sensation_level(shown_ - y, e.fs, **devices[name]).level
                    levels[name][2] = np.fmax(levels[name][2], lost)
    for name, (p, n, lost) in levels.items():
        top = np.fmax(p, n)
        p, n = (v if v == top or top <= MASKER else np.nan for v in (p, n))
        told = ", ".join(f"{k} {v:g}" for k, v in devices[name].items() if k != "unit")
        text = f"{name}: {Felt(p, n, np.nan)} ({told})"
        if e.sidecar is not None and not np.isnan(lost):
            text += f"; {e.sidecar['subtype']} changes it by {lost:.1f} dB SL"
        e.numbers.append(text)


def say_energy(e: Evidence, device: Device | None = None) -> None:
    """Add a line to the report for each force over a position: the energy it gave.

    With a device it is the energy of the force that comes late, and the damping that
    this needs is compared with the device's.
    """
    pairs = [
        (output, name, force.dim * unit("s") / over.dim)
        for output, force in e.scene.outputs.items()
        for name, over in named([force], Input).items()
        if force.dim * over.dim == unit("J") and name in e.proc.inputs
    ]
    if not pairs:
        return
    rows = [([*e.scene.outputs].index(y), [*e.proc.inputs].index(x)) for y, x, _ in pairs]
    power = np.array([power_of(e.scene.outputs[output]) for output, *_ in pairs])
    work, least, beyond = np.zeros((3, len(rows)))
    delay = 0.0 if device is None else device.delay
    late, ends = round(delay * e.fs, 9), None  # of the stretch before
    whole, part = int(late) + 2, late % 1.0
    for s in e.stretches():
        if ends is None:
            ends = np.zeros((len(s.y), whole)), np.repeat(s.x[:, :1], whole, axis=1)
        y, x = map(np.hstack, zip(ends, (s.y, s.x), strict=True))
        ends, n = (y[:, -whole:], x[:, -whole:]), s.y.shape[1]
        t = (s.at + np.arange(n)) / e.fs
        for k, (row, column) in enumerate(rows):
            # each sample is held, from between two on, over a straight motion
            moved = np.diff(x[column])[-n:] if n else np.zeros(0)
            first = part * y[row, :n] * moved
            steps = first + (1.0 - part) * y[row, 1 : n + 1] * moved
            done = work[k] + np.cumsum(steps)
            low = np.minimum(done, done - steps + first)
            least[k] = min(least[k], low.min(initial=0.0))
            beyond[k] = min(beyond[k], (low + power[k] * t).min(initial=0.0))
            work[k] = done[-1] if n else work[k]
    needed, margins = damping_of(e.proc, delay), {}
    for k, (output, name, per) in enumerate(pairs):
        text = f"{output} over {name}: gave at most {-1e3 * least[k] + 0.0:.3g} mJ more than it"
        text += " had got" if device is None else f" had got, {1e3 * delay:.3g} ms late"
        if power[k]:
            text += (
                f"; it states to give {1e3 * power[k]:.3g} mW on purpose, and gave"
                f" {-1e3 * beyond[k] + 0.0:.3g} mJ beyond this"
            )
        need = needed.get((output, name))
        if device is None and need:
            text += f"; passive in a device with {need:.3g} {per}, undelayed"
        elif device is not None and need:
            margins[f"{output} over {name}"] = margin = device.damping / need
            text += (
                f"; it needs {need:.3g} {per} and the device has {device.damping:.3g}:"
                f" {'' if margin >= 1 else 'not '}passive in every hand, which {margin:.3g} times"
                " its stiffness would just be"
            )
        elif device is not None:
            text += "; its law gives no damping that it needs: try it in a closed loop"
        e.numbers.append(text)
    if margins:
        worst = min(margins, key=margins.__getitem__)
        e.numbers.append(f"smallest margin of passivity: {margins[worst]:.3g}, {worst}")
