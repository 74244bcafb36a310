"""Verification of a session against its log and the model."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping

import numpy as np

from ..core.graph import Input
from ..core.scene import Scene
from ..errors import BadValue, SinkError, counted, public
from ..files.log_reader import MotionFile, SessionLog
from ..files.log_replay import Hashes, changed_motion, changes_of, delivered, motion_of, processor
from ..run.driver import walk
from ..run.safety import GAIN, Watch, guarded, protect, to_device
from ..virtual.device import Device
from .evidence import Check, Evidence, at_first, last_of, seen_by, stated, with_taps
from .local import blocks_held
from .noise import generator, noise
from .report import Report
from .scenes import scene_law
from .verification import limits_kept, linear_blocks, same_samples, say_energy, say_felt


@public
def verify_log(
    log: SessionLog,
    scene: Scene | None = None,
    *,
    params: Mapping[str, float] | None = None,
    seed: int | None = None,
    device: Device | None = None,
) -> Report:
    """Verify the delivered samples of a session from its log.

    The scene is run again on the logged motion, with the same changes of parameters.
    Its samples are verified like those of a rendering: blocks, noise, limits, and the
    law of the scene, which follows the parameters by itself. After a safety stage of
    their own, the samples must equal those that were delivered, in every bit, and these
    must have the logged hashes.

    Parameters
    ----------
    log : SessionLog
        Of ``stimlib.files.log_reader.read_log``.
    scene : Scene, optional
        What is expected to have been played.
    params : dict of str to float, optional
        Parameters that are expected at every sample, as for ``verify``.
    seed : int, optional
        The seed that is expected.
    device : Device, optional
        As of ``verify``.

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
    law, cut = _lawful(e)
    checks = [
        *stated(e, params, seed),
        *_delivered(e, log),
        *linear_blocks(e),
        *same_samples(e),
        *generator(e),
        *noise(e),
        *(scene_law(law) if cut else ()),
        *limits_kept(e),
        *blocks_held(e),
    ]
    say_felt(e)
    say_energy(e, device)
    e.skipped += log.notes
    rows = (*(event.data for event in log.events if event.kind == "rows"), log.report or {})
    last = {"silent": "", "rejected": {}} | {k: v for data in rows for k, v in data.items()}
    rose = any(c.name == GAIN and c.value > 0 for c in log.changes) or not log.inputs
    # the log of a killed session may end before its counts say that motion came
    why = "" if rose else last["silent"] or "the gain rises with the first motion, and has not"
    checks[:0] = [Check("b", "no motion was received", 1, 0, str(why)[:500])] if why else []
    e.numbers += [f"rows of motion rejected: {last['rejected']}"[:500]] if last["rejected"] else []
    for event in (event for event in log.events if event.kind in ("rise", "fall")):
        where = (
            "before sample 0, from silence to it"
            if event.kind == "rise"
            else f"from sample {event.at} on, to silence"
        )
        e.skipped.append(
            f"fade outside of the stimulus: {counted(event.data['frames'], 'frame')} {where}; they"
            " have no hash"
        )
    if along := [c for c in log.changes if c.name == GAIN and c.ramp * log.fs > 1]:
        where = f"{along[0].at} to {along[0].at + round(along[0].ramp * log.fs)}"
        e.numbers.append(
            f"{counted(len(along), 'fade')} on the stimulus, the first along samples {where}"
        )
    if log.lost:
        lost = sum(n for _, n in log.lost)
        e.skipped.append(
            f"what the device did not take: {counted(lost, 'sample')} lost,"
            f" {counted(len(log.lost), 'time')}, first"
            f" at {log.lost[0][0]}"
        )
    return Report(checks, e)


def _evidence(log: SessionLog) -> Evidence:
    augmented, found = with_taps(log.scene, log.fs)
    proc, watched = processor(log, log.scene), processor(log, augmented)
    changes = last_of((c for c in changes_of(log, proc) if c.at < log.frames), log.fs)
    params, none = at_first(proc, changes), np.empty((0, 0))
    e = Evidence(
        log.scene, proc, log.fs, log.seed, params, none, none, none, log.folder.name, None, {}
    )
    e.changes, e.session = changes, True
    first = seen_by(e, watched, motion_of(log, watched), found, log.frames)
    first.motion = dict(zip(proc.inputs, first.x, strict=True))
    return first


def _lawful(e: Evidence) -> tuple[Evidence, int]:
    """Return the samples before the first non-finite motion, and their number.

    The law of the scene is checked against these.
    """
    cut = next((c for c in map(_finite, e.stretches()) if c is not None), e.frames)
    if cut == e.frames:
        return e, cut
    why = f"({cut / e.fs:.6g} s), where the motion was not finite"
    e.skipped.append(f"law of the scene: held against the samples before {cut} only {why}")

    def before(s: Evidence) -> Evidence:
        n = min(cut, s.end) - s.at
        taps = [dc.replace(t, gate=t.gate[:n]) for t in s.taps]
        x, y, shown = (np.ascontiguousarray(a[:, :n]) for a in (s.x, s.y, s.shown))
        return dc.replace(
            s,
            x=x,
            y=y,
            shown=shown,
            taps=taps,
            fingers={},
            curves={},
            wanted={},
            terms={key: row[:n] for key, row in s.terms.items()},
            all=cut,
            later=None,
        )

    first = before(e)
    if e.later is not None and cut > e.end:
        first.later = lambda: (before(s) for s in e.later() if s.at < cut)
    return first, cut


def _finite(s: Evidence) -> int | None:
    """Return the first sample of a stretch with non-finite motion, or None."""
    wrong = np.flatnonzero(~np.isfinite(s.x).all(axis=0))
    return s.at + int(wrong[0]) if wrong.size else None


class _MadeSafe:
    """The verified samples, passed through a safety stage of their own.

    From a fault on, the session's safety stage received the output as it was before its
    own guard, which is NaN.
    """

    def __init__(self, log: SessionLog):
        names = {f"y{i}": b for i, b in enumerate(log.scene.outputs.values())}
        inputs = [Input(n, "" if str(b.dim) == "1" else str(b.dim)) for n, b in names.items()]
        self.log, self.scales = log, log.safety.scales(log.outputs)
        over = guarded(log.scene, log.safety)
        self.places = {f"x{k}": x.name for k, x in enumerate({x for x, _ in over.values()})}
        made = {x: n for n, x in self.places.items()}
        to = {n: (Input(made[x.name], str(x.dim)), power) for n, (x, power) in over.items()}
        self.proc = processor(
            log, protect(Scene(dict(zip(log.outputs, inputs, strict=True))), log.safety, to)
        )
        self.changes = changes_of(log, self.proc)

    def frames(self, e: Evidence, faults: dict[str, int]) -> np.ndarray:
        """Return the frames of the next stretch, shape (n, channels)."""
        places = [*e.proc.inputs]
        y = np.array(
            [
                e.x[places.index(self.places[n])] if n in self.places else e.y[int(n[1:])]
                for n in self.proc.inputs
            ]
        )
        for name, at in faults.items():
            if (row := f"y{self.log.outputs.index(name)}") in self.proc.inputs:
                y[self.proc.inputs.index(row), max(at - e.at, 0) :] = np.nan

        def motion(at: int, stop: int) -> np.ndarray:
            return np.ascontiguousarray(y[:, at - e.at : stop - e.at])

        safe = np.empty((e.end - e.at, len(self.log.channels)), np.float32)
        for at, part in walk(self.proc, motion, e.end, self.changes, e.at):
            safe[at - e.at : at - e.at + part.shape[1]] = to_device(
                part, self.scales, self.log.channels
            )
        return safe


def _delivered(e: Evidence, log: SessionLog) -> list[Check]:
    """Check the samples that the device received, in three steps.

    They must be accounted for, equal to the replay, and equal to the verified samples
    after a safety stage.
    """
    proc, hashes, differ, end = processor(log), Hashes(log.spans), 0, 0
    replayed, made = delivered(log, proc=proc), _MadeSafe(log)
    ahead = np.empty((0, len(log.channels)), np.float32)
    for s in e.stretches():
        parts = [ahead]
        while end < s.end and (part := next(replayed, None)) is not None:
            at, frames, given = part
            end = at + len(frames)
            parts.append(frames)
            if given:
                hashes.add(at, frames)
        got = np.concatenate(parts)
        got, ahead = got[: s.end - s.at], got[s.end - s.at :]
        safe = made.frames(s, Watch(proc).faults())
        differ += int(np.sum(safe.view(np.uint32)[: len(got)] != got.view(np.uint32)))
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
    watch, report = Watch(proc), log.report or {}
    limits = {"clips": watch.counts(), "outside": watch.outside(), "energy": watch.energy()}
    apart = sum(report.get(what, v) != v for what, v in limits.items())
    text = ", ".join(
        f"{sum(of.values())} limited ({stage})" for stage, of in limits["clips"].items()
    )
    checks.append(Check("b", "log: limits as reported", apart, 0, text or "no sample limited"))
    return checks
