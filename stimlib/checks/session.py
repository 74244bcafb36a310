"""Is what a session delivered what its log says, and is that what the model says?"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterator

import numpy as np

from ..core.graph import Input
from ..core.scene import Scene
from ..errors import BadValue, SinkError, public
from ..files.replay import Hashes, changed_motion, changes_of, delivered, motion_of, processor
from ..files.session import MotionFile, SessionLog
from ..run.safety import GAIN, Watch, protect, to_device
from ..run.walk import samples, walk
from ..system.limits import limits
from .evidence import Check, Evidence, at_first, keep_taps, last_of, with_taps
from .local import blocks_held
from .noise import generator, noise
from .report import Report
from .scenes import scene_law
from .verify import limits_kept, linear_blocks, same_samples


@public
def verify_log(log: SessionLog, scene: Scene | None = None) -> Report:
    """Prove the delivered samples of a session from its log.

    The scene is run again on the logged motion, with the parameters set where they
    were. Its samples are verified like those of a rendering: blocks, noise, limits, and
    the law of the scene, which follows the parameters by itself. Passed through a
    safety stage of their own, the samples must be those that were delivered, in every
    bit, and these must have the logged hashes.

    Parameters
    ----------
    log : SessionLog
        Of ``stimlib.files.session.read_log``.
    scene : Scene, optional
        What is expected to have been played.

    Returns
    -------
    Report

    Raises
    ------
    BadValue
        Another scene was played.
    SinkError
        The log has no delivered sample, or its scene cannot be compiled.
    """
    if scene is not None and scene.hash != log.scene.hash:
        raise BadValue(
            f"{log.folder} is a session of another scene (hash {log.scene.hash[:12]}, this one"
            f" {scene.hash[:12]})"
        )
    if not log.frames or not log.spans:
        why = "nothing was delivered under a hash that can be made again (is motion.f64 empty?)"
        raise SinkError(f"{log.folder}: {why}, so there is nothing to verify")
    e = _evidence(log)
    law, cut = _lawful(e, log)
    checks = [*_delivered(e, log), *linear_blocks(e), *same_samples(e), *generator(e), *noise(e)]
    if cut:
        checks += scene_law(law)
    checks += [*limits_kept(e), *blocks_held(e)]
    e.skipped += log.notes
    for event in (event for event in log.events if event.kind in ("rise", "fall")):
        where = (
            "before sample 0, from silence to it"
            if event.kind == "rise"
            else f"from sample {event.at} on, to silence"
        )
        e.skipped.append(
            f"fade outside of the stimulus: {event.data['frames']} frames {where}; they have no"
            " hash"
        )
    if along := [c for c in log.changes if c.name == GAIN and c.ramp * log.fs > 1]:
        where = f"{along[0].at} to {along[0].at + round(along[0].ramp * log.fs)}"
        e.numbers.append(f"{len(along)} fades on the stimulus, the first along samples {where}")
    if log.lost:
        lost = sum(n for _, n in log.lost)
        e.skipped.append(
            f"what the device did not take: {lost} samples were lost, {len(log.lost)} times, first"
            f" at {log.lost[0][0]}"
        )
    return Report(checks, e)


def _evidence(log: SessionLog) -> Evidence:
    augmented, found = with_taps(log.scene, log.fs)
    # what is kept below and while it is compared
    rows = (
        len(augmented.outputs) + 4 * len(log.outputs) + 2 * len(log.inputs) + len(log.channels) / 2
    )
    limits.check(
        "render_bytes",
        8.0 * rows * log.frames,
        f"{log.folder}: bytes of the samples to verify",
        SinkError,
    )
    proc, watched = processor(log, log.scene), processor(log, augmented)
    seen = samples(watched, motion_of(log, watched), log.frames, changes_of(log, watched))
    changes = last_of(c for c in changes_of(log, proc) if c.at < log.frames)
    params = at_first(proc, changes)
    rows_at = motion_of(log, proc)
    x = rows_at(0, log.frames) if callable(rows_at) else rows_at
    y, motion = seen[: len(log.outputs)].copy(), dict(zip(proc.inputs, x, strict=True))
    e = Evidence(log.scene, proc, log.fs, log.seed, params, x, y, y, log.folder.name, None, motion)
    e.changes, e.session = changes, True
    keep_taps(e, seen, found)
    return e


def _lawful(e: Evidence, log: SessionLog) -> tuple[Evidence, int]:
    """The samples that the law can be held against: up to what is not finite."""
    n = log.frames
    cut = int(np.append(np.flatnonzero(~np.isfinite(e.x).all(axis=0)), n)[0])
    if cut == n:
        return e, n
    why = f"({cut / e.fs:.6g} s), where the motion was not finite"
    e.skipped.append(f"law of the scene: held against the samples before {cut} only {why}")
    taps = [dc.replace(t, gated=t.gated[:cut], gate=t.gate[:cut]) for t in e.taps]
    x, y, shown = (np.ascontiguousarray(a[:, :cut]) for a in (e.x, e.y, e.shown))
    return dc.replace(e, x=x, y=y, shown=shown, taps=taps, fingers={}, curves={}, wanted={}), cut


def _made_safe(
    y: np.ndarray, log: SessionLog, faults: dict[str, int]
) -> Iterator[tuple[int, np.ndarray]]:
    """The verified samples through a safety stage of their own: (at, frames (n,
    channels)), as a device gets them.

    From a fault on, the stage of the session had what came before its own guard: not a
    number.
    """
    names = {f"y{i}": b for i, b in enumerate(log.scene.outputs.values())}
    inputs = [Input(n, "" if str(b.dim) == "1" else str(b.dim)) for n, b in names.items()]
    proc = processor(log, protect(Scene(dict(zip(log.outputs, inputs, strict=True))), log.safety))
    y, scales = y[[int(name[1:]) for name in proc.inputs]], log.safety.scales(log.outputs)
    for name, at in faults.items():
        if (row := f"y{log.outputs.index(name)}") in proc.inputs:
            y[proc.inputs.index(row), at:] = np.nan
    for at, part in walk(proc, y, log.frames, changes_of(log, proc)):
        yield at, to_device(part, scales, log.channels)


def _delivered(e: Evidence, log: SessionLog) -> list[Check]:
    """What the device got, in three steps: accounted for, equal to the replay, equal to
    the verified samples made safe.
    """
    proc, hashes, end = processor(log), Hashes(log.spans), 0
    replayed = np.empty((log.frames, len(log.channels)), np.float32)
    for at, frames, given in delivered(log, proc=proc):
        end = at + len(frames)
        replayed[at:end] = frames
        if given:
            hashes.add(at, frames)
    safe = _made_safe(e.y, log, Watch(proc).faults())
    differ = sum(
        int(np.sum(y.view(np.uint32) != replayed[at : at + len(y)].view(np.uint32)))
        for at, y in safe
    )
    missing = log.logged - end
    wrong = len(hashes.wrong) + len(log.spans) - hashes.done
    first = (
        f", the first of frames {hashes.wrong[0][0]} to {hashes.wrong[0][1]}"
        if hashes.wrong
        else ""
    )
    changed, rows = len(changed_motion(log)), sum(s.to <= len(log.motion) for s in log.motion_spans)
    # a session that ended has all of it under a hash
    if log.report is not None and isinstance(log.motion, MotionFile):
        changed += log.motion.beyond(log.motion_spans[-1].to if log.motion_spans else 0) != 0
    units = int(log.header["units"] != proc.units)
    checks = [
        Check(
            "b",
            "log: delivered = replay",
            wrong,
            0,
            f"hashes that differ, of {len(log.spans)}{first}",
        ),
        Check(
            "b",
            "log: replay = these samples made safe",
            differ,
            0,
            "delivered samples whose bits differ",
        ),
        Check("b", "log: motion as it was written", changed, 0, f"hashes that differ, of {rows}"),
        Check(
            "b", "log: all samples are there", missing, 0, "samples produced, and not in the log"
        ),
        Check("e", "log: units as the scene's", units, 0, "inputs, outputs, parameters"),
    ]
    lost = sum(n for _, n in log.lost)
    counts = {"produced": end, "delivered": end - lost, "lost": lost}
    if said := {what: (log.report or {})[what] for what in counts if what in (log.report or {})}:
        apart = sum(abs(v - counts[what]) if isinstance(v, int) else 1 for what, v in said.items())
        text = ", ".join(f"{n} {what}" for what, n in counts.items())
        checks.append(Check("b", "log: samples as reported", min(apart, 2**63), 0, text))
    return checks
