"""The evidence that the checks of one verification use.

It is the delivered samples, a re-render, and the noise seen inside it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis import spectra
from ..blocks.noise import White
from ..core.graph import Block, constant, reach
from ..core.parts import Part, Term, signal
from ..core.scene import Scene
from ..core.subsystems import Enabled, Segment
from ..design.responses import Law
from ..errors import BadValue
from ..files.audio import Stored
from ..motion.source import sources_of
from ..run.driver import Rows, rows_of, samples
from ..run.processor import Change, Processor, compile
from ..run.rendering import Rendering
from . import laws
from .linear import laws_of

ALARM = 1e-6  # joint false alarm probability of all statistical checks of one report
DEVIATES = 1e-13  # of two computations of a normal deviate
FEWEST = 64  # enabled samples without which a noise is not tested
AT_ONCE = 1 << 20  # samples of the first stretch, which is held in memory
FEW = 8  # inputs and outputs; of more, the first stretch is shorter
LATER = 1 << 17  # samples of each stretch after it, which a pass makes anew


@dataclass(frozen=True)
class Check:
    """One comparison, passed if measured <= limit."""

    group: str
    name: str
    measured: float
    limit: float
    text: str
    deviation: float = 0.0  # of what is measured, by chance

    @property
    def passed(self) -> bool:
        """Whether the check passed; NaN does not pass."""
        return bool(self.measured <= self.limit)


@dataclass(frozen=True, eq=False)
class Tap:
    """A gated noise source, observed on its own clock before the gate."""

    block: Enabled
    output: str
    stream: np.ndarray  # the enabled samples, one after the other
    gate: np.ndarray
    model: Callable[[np.ndarray], np.ndarray] | None  # one-sided PSD
    f_low: float
    f_high: float
    run: str  # what tells its segment, if it is in one
    seed: int
    title: str  # the output, and the noise where the output has several
    spectrum: spectra.Spectrum | None = None


@dataclass
class Evidence:
    """The data of one verification, for its checks and its report.

    It holds the rows of one stretch: all of a recording of up to ``at_once`` samples,
    or its first stretch. ``stretches`` yields this one and the later ones, of which the
    checks keep only sums.
    """

    scene: Scene
    proc: Processor
    fs: float
    seed: int
    params: dict[str, float]
    x: np.ndarray
    y: np.ndarray  # the re-render in float64
    shown: np.ndarray  # what was delivered
    source: str
    sidecar: dict[str, Any] | None
    motion: dict[str, Any]
    taps: list[Tap] = field(default_factory=list)
    # sources outside any gate, each on its clock
    whites: dict[str, np.ndarray] = field(default_factory=dict)
    fingers: dict[str, laws.Finger] = field(default_factory=dict)
    curves: dict[str, np.ndarray] = field(default_factory=dict)  # what else a law computed
    # the samples in which these are best seen
    closeup: slice = field(default_factory=lambda: slice(None))
    wanted: dict[Any, Callable[[], tuple[np.ndarray, Any]]] = field(default_factory=dict)
    """By output, what a law gives for every sample, and how far from it a correct
    rendering may be; of a term of a sum, by output and term.
    """
    # of sums that are outputs, by output and path
    terms: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)
    # that stand in the graph alone, as the law reads them
    numbers: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    # laws that the scene names, and that are not known here
    unknown: list[str] = field(default_factory=list)
    held: list[Any] = field(default_factory=list)  # ``local.Held`` of each block
    # of parameters, also those made before sample 0
    changes: list[Change] = field(default_factory=list)
    path: Path | None = None  # of the file
    told: Any = None  # the fault that a rendering in memory tells
    session: bool = False  # delivered through a safety stage, which checks/session.py compares
    at: int = 0  # the first sample of the rows
    led: int = 0  # of the rows, samples of the stretch before
    later: Callable[[], Iterator[Evidence]] | None = None  # makes the stretches after this one
    all: int = 0  # samples of the recording, where there are later ones
    drive: Rows | None = None  # the motion of all samples, where there are later ones

    @property
    def frames(self) -> int:
        """Number of samples of the whole recording."""
        return self.all or self.x.shape[1]

    @property
    def differences(self) -> list[str]:
        """The parameters that are not those of the scene, first and then over time."""
        own = self.scene.params
        found = [
            f"{n} = {v:.10g} (in the scene {own[n].value:.10g})"
            for n, v in self.params.items()
            if v != own[n].value
        ]
        return found + [
            f"{c.name} to {c.value:.10g} at {c.at / self.fs:g} s within {c.ramp:g} s"
            for c in self.moves
        ]

    @property
    def moves(self) -> list[Change]:
        """The changes of parameters after those with which the recording begins."""
        return [c for c in self.changes if c.at or c.ramp * self.fs > 1]

    @property
    def end(self) -> int:
        """The index of the sample after the last of the rows."""
        return self.at + self.x.shape[1]

    def stretches(self) -> Iterator[Evidence]:
        """Yield this stretch and all later ones, rendering each of those anew.

        Together they contain every sample once.
        """
        yield self
        if self.later is not None:
            yield from self.later()

    def motion_at(self, at: int, stop: int) -> np.ndarray:
        """Return the motion of samples at .. stop - 1, in the processor's order."""
        if self.drive is None or (self.at <= at and stop <= self.end):
            return np.ascontiguousarray(self.x[:, at - self.at : stop - self.at])
        return (
            self.drive(at, stop)
            if callable(self.drive)
            else np.ascontiguousarray(self.drive[:, at:stop])
        )

    @property
    def share(self) -> float:
        """The false alarm probability of each statistical check.

        The statistical checks are spectra, pairs of spectra, and slopes.
        """
        streams = sum(t.model is not None and t.stream.size > FEWEST for t in self.taps)
        return ALARM / max(1, streams * (streams + 1) // 2 + len(self.taps))


def gather(
    scene: Scene, motion: Mapping[str, Any], rendering: Rendering | str | os.PathLike
) -> Evidence:
    """Gather the evidence of a rendering, a file or a log for its checks."""
    sidecar: dict[str, Any] | None = None
    shown: Any = rendering.y if isinstance(rendering, Rendering) else Stored(rendering)
    if isinstance(rendering, Rendering):
        fs, seed, params = rendering.fs, rendering.seed, dict(rendering.params)
        source = "rendering in memory"
        if rendering.scene.hash != scene.hash:
            raise BadValue("the rendering is of another scene")
        if (
            rendering.outputs != tuple(scene.outputs)
            or shown.shape[:1] != (len(scene.outputs),)
            or shown.dtype != np.float64
        ):
            raise BadValue(
                f"the rendering must have the scene's outputs, {', '.join(scene.outputs)}, one"
                " float64 row for each"
            )
    else:
        sidecar = shown.sidecar
        fs, seed, params = sidecar["fs"], sidecar["seed"], dict(sidecar["params"])
        source = Path(rendering).name
        if sidecar["scene_hash"] != scene.hash:
            raise BadValue(
                f"{rendering} was rendered from another scene (hash {sidecar['scene_hash'][:12]},"
                f" this one {scene.hash[:12]}); give the same scene with the same numbers, or"
                " render again"
            )
    if sidecar is not None and sidecar["index"]:
        raise BadValue(
            f"{rendering} continues an earlier run of its processor; only files that begin at"
            " sample 0 can be verified"
        )
    if sidecar is not None and (
        late := [change["at"] for change in sidecar["log"] if change["at"]]
    ):
        raise BadValue(
            f"{rendering} begins at sample 0, but its sidecar reports a change at sample"
            f" {late[0]}: it was edited"
        )
    proc = compile(scene, fs, seed=seed)
    if sidecar is None:
        changes = [Change(0, name, value, 0.0) for name, value in params.items()]
    else:
        changes = last_of((Change(**c) for c in sidecar["log"]), fs)
    if not shown.shape[1]:
        raise BadValue("there is no sample to verify")
    augmented, found = with_taps(scene, fs)
    watch = compile(augmented, fs, seed=seed)
    none = np.empty((0, 0))
    e = Evidence(
        scene,
        proc,
        fs,
        seed,
        at_first(proc, changes),
        none,
        none,
        none,
        source,
        sidecar,
        dict(motion),
    )
    e.changes = changes
    e.path = None if sidecar is None else Path(rendering)  # type: ignore[arg-type]
    e.told = rendering.fault if isinstance(rendering, Rendering) else None
    return seen_by(
        e,
        watch,
        rows_of(sources_of(motion, proc.inputs, shown.shape[1]), fs),
        found,
        shown.shape[1],
        shown,
    )


def seen_by(
    e: Evidence, watch: Processor, drive: Rows, found: list[tuple], frames: int, shown: Any = None
) -> Evidence:
    """Return the evidence of an augmented scene for a motion.

    It is that of the first stretch, which renders the later ones when they are needed.

    ``shown`` holds what was delivered, read by shown[:, at:stop]; None if what is
    rendered here is to be used instead.
    """
    edges = cuts(e.scene, e.fs, frames)
    whole = frames if len(edges) > 1 else 0

    def part(proc: Processor, at: int, stop: int) -> Evidence:
        x = drive(at, stop) if callable(drive) else drive[:, at:stop]
        seen = samples(
            proc, lambda a, b: np.ascontiguousarray(x[:, a - at : b - at]), stop, e.changes, at
        )
        y = seen[: len(e.scene.outputs)].copy()
        empty: dict[str, Any] = {field: {} for field in ("whites", "fingers", "curves", "wanted")}
        empty |= {field: [] for field in ("taps", "numbers", "skipped", "held")}
        empty["drive"] = drive if whole else None
        new = replace(
            e, at=at, x=x, y=y, shown=y if shown is None else shown[:, at:stop], all=whole, **empty
        )
        new.terms = dict(zip(reversed(terms_in(e.scene)), reversed(seen), strict=False))
        keep_taps(new, seen[: len(seen) - len(new.terms)], found)
        return new

    first = part(watch, 0, edges[0])
    if len(edges) > 1:
        state = watch.state

        def later() -> Iterator[Evidence]:
            proc = Processor(watch.scene, e.fs, seed=e.seed, begun=watch)
            proc.state = state
            for at, stop in pairwise(edges):
                yield part(proc, at, stop)

        first.later = later
        seconds = f"{edges[0] / e.fs:.6g} s of {frames / e.fs:.6g} s"
        first.skipped.append(
            "pictures, the reach of a motion, the slope of force over position, and how small an"
            f" error is seen: of the first {seconds}"
        )
    return first


def at_once(scene: Scene) -> int:
    """Return the number of samples in the first stretch, which is held in memory.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.checks.evidence import at_once
    >>> at_once(stimlib.scenes.squeeze()), at_once(stimlib.scenes.squeeze(fingers=64))
    (1048576, 65536)
    """
    return AT_ONCE * FEW // max(FEW, len(scene.inputs) + len(scene.outputs))


def cuts(scene: Scene, fs: float, frames: int) -> list[int]:
    """Return where stretches end.

    The first has up to ``at_once`` samples, the others up to ``LATER``. If possible, no
    interval of a trial is cut; all stretches of trials have up to ``at_once``.
    """
    spans = [
        (round(p.span.start * fs), round(p.span.start * fs) + round(p.span.duration * fs))
        for p in scene.parts
        if p.span
    ]
    ends = sorted({z for _, z in spans} | {a for a, _ in spans})
    free = [n for n in ends if not any(a < n < z for a, z in spans)]
    edges, at, most = [], 0, at_once(scene)
    while frames - at > most:
        at = max((n for n in free if at < n <= at + most), default=at + most)
        edges.append(at)
        most = most if spans else min(most, LATER)
    return [*edges, frames]


def keep_taps(e: Evidence, seen: np.ndarray, found: list[tuple]) -> None:
    """Store the noises found among the outputs of an augmented scene."""
    n = len(e.scene.outputs)
    for k, (output, block, model, low, high, run, seed) in enumerate(found):
        gate = seen[n + 2 * k + 1] > 0
        its = e.seed if seed is None else seed
        keys = [c.noise_key for c in reach([block.block]) if c.noise_key]
        which = "".join(", white({}, {})".format(*key) for key in keys) + run
        title = output + which * (sum(other[0] == output for other in found) > 1)
        e.taps.append(
            Tap(block, output, seen[n + 2 * k][gate], gate, model, low, high, run, its, title)
        )
    free = seen[n + 2 * len(found) :]
    for name, y, on in zip(free_noises(e.scene), free[::2], free[1::2], strict=True):
        e.whites[name] = y[on > 0]


def stated(e: Evidence, params: Mapping[str, float] | None, seed: int | None) -> list[Check]:
    """Check the parameters at every sample, and the seed, against those stated.

    Parameters without a stated value must be those of the scene; None states nothing.
    """
    wrong = [] if seed in (None, e.seed) else [f"seed = {e.seed} for {seed}"]
    if params is not None:
        asked = Processor(e.scene, e.fs, seed=e.seed, begun=e.proc)
        for name, value in params.items():
            asked.set(name, value, ramp=0.0)
        later = [(c.name, c.value, f" from sample {c.at} on") for c in e.moves]
        wrong += [
            f"{name} = {value:.10g} for {asked.params[name]:.10g}{where}"
            for name, value, where in [*((n, v, "") for n, v in e.params.items()), *later]
            if value != asked.params[name]
        ]
    nothing = params is None and seed is None
    title, text = "parameters and seed: as they were stated", "; ".join(wrong) or "that differ"
    return [] if nothing else [Check("e", title, len(wrong), 0, text)]


def last_of(changes: Iterable[Change], fs: float) -> list[Change]:
    """Return the changes of parameters, only the last of several at one sample.

    A ramp also needs the last jump before it at its sample, where it begins.
    """
    found: dict[Any, Change] = {}
    for c in changes:
        ramps = round(c.ramp * fs) > 1
        found[c.at, c.name, ramps] = c
        if not ramps:
            found.pop((c.at, c.name, True), None)
    return list(found.values())


def at_first(proc: Processor, changes: list[Change]) -> dict[str, float]:
    """Return the parameters of a new processor at its first sample.

    They include changes that take effect at once; a ramp starts from the old value.
    """
    return dict(proc.params) | {
        c.name: c.value for c in changes if c.at == 0 and c.ramp * proc.fs <= 1
    }


def with_taps(scene: Scene, fs: float):
    """Return the scene with noises, gates and sources as additional outputs.

    These are every gated noise, its gate, and every source outside gates. No bit of the
    other outputs changes.
    """
    more, seen = [], set()
    found: list[tuple] = []
    for name, b, around in placed(scene):
        if (
            isinstance(b, Enabled)
            and (id(b), run_of(around)) not in seen
            and any(c.noise_key for c in reach([b.block]))
        ):
            seen.add((id(b), run_of(around)))
            more += [within(b, around), within(b.by, around)]
            seed = next((s.seed for s in around if s.seed is not None), None)
            found.append(
                (name, b, *(noise_model(b.block, fs) or (None, 0.0, 0.0)), run_of(around), seed)
            )
    for both in free_noises(scene).values():
        more += both
    more += terms_in(scene).values()
    names = (f"tap{k}" for k in range(1 << 62) if f"tap{k}" not in scene.outputs)
    return Scene(scene.outputs | dict(zip(names, more, strict=False))), found


def terms_in(scene: Scene) -> dict[tuple[str, str], Block]:
    """Return the terms of sums that laws are about, by output and path."""
    return {
        (part.outputs[name], term.path): signal(scene.outputs[part.outputs[name]], term)
        for part in scene.parts
        for name, term in part.terms.items()
        if part.outputs.get(name) in scene.outputs
    }


def placed(scene: Scene) -> Iterator[tuple[str, Block, tuple[Segment, ...]]]:
    """Yield blocks outside of any ``enabled``, with their outputs and segments.

    The segments are listed from the innermost outwards.
    """
    for name, root in scene.outputs.items():
        todo: list[tuple[Block, tuple[Segment, ...]]] = [(root, ())]
        while todo:
            top, around = todo.pop()
            blocks = reach([top], Segment)
            hidden = {id(c) for b in blocks if isinstance(b, Enabled) for c in reach([b.block])}
            blocks = [b for b in blocks if id(b) not in hidden]
            yield from ((name, b, around) for b in blocks)
            todo += [(b.block, (b, *around)) for b in blocks if isinstance(b, Segment)]


def within(b: Block, around: Iterable[Segment]) -> Block:
    """Return a block placed in these segments."""
    return reduce(lambda inner, s: Segment(inner, s.by, s.seed), around, b)


def free_noises(scene: Scene) -> dict[str, tuple[Block, Block]]:
    """Return white noises outside of gates, by their names in the program.

    Each comes with a signal that is 1 where the noise runs.
    """
    return {
        "white({}, {})".format(*b.noise_key) + run_of(around): (
            within(b, around),
            within(constant(1.0), around),
        )
        for _, b, around in placed(scene)
        if isinstance(b, White)
    }


def run_of(around: Sequence[Segment]) -> str:
    """Return the text that identifies nested segments, as in ``Program.runs``."""
    return "".join(s.run for s in reversed(around))


def noise_model(root: Block, fs: float):
    """Return (PSD, f_low, f_high) of known linear blocks that filter white noise.

    It follows from their physical laws; None for any other chain of blocks.
    """
    chain: list[Law] = []
    b = root
    while not isinstance(b, White):
        law = laws_of(b, fs)
        if not (law and law[0].shapes):
            return None
        chain.append(law[0])
        b = b.children[0]

    def psd(f):
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = np.full(np.shape(f), 2 / fs)
            return flat * np.prod([np.abs(r.law(f, fs)) ** 2 for r in chain], axis=0)

    bands = [passing(r, fs) for r in chain]
    low = max((f[0] for f in bands if f[0] > 1), default=1.0)
    return psd, low, min((f[-1] for f in bands), default=fs / 2)


def passing(law: Law, fs: float) -> np.ndarray:
    """Return the frequencies of a law; of a filter, those of its first pass band.

    What is below a tenth of its largest response is not seen by a periodogram, in which
    it lies below the leakage of what passes.
    """
    f = law.f(fs)
    H = law.law(f, fs)
    inside = np.abs(H) > 0.99 * law.size(H)
    first = int(np.argmax(inside))
    return f[first : first + int(np.argmin(np.r_[inside[first:], False]))]


def ramped(
    first: float, changes: Sequence[Change], fs: float, n: int, start: int = 0
) -> np.ndarray:
    """Return samples start .. n - 1 of a parameter with these changes."""
    y, changes, before = np.full(n - start, first), [c for c in changes if c.at < n], first
    for k, (at, _, target, ramp) in enumerate(changes):
        end = changes[k + 1].at if k + 1 < len(changes) else n
        low = min(max(at, start), end - 1)  # the last is the next one's beginning
        frames = max(1, round(ramp * fs))
        before = target if frames == 1 else before  # a jump is there at once
        share = np.minimum(np.arange(low - at + 1, end - at + 1) / frames, 1.0)
        row = np.where(share < 1, before + (target - before) * share, target)
        before = float(row[-1])
        if end > max(at, start):
            y[low - start : end - start] = row
    return y


def lost_by_ramps(changes: Iterable[Change], fs: float) -> float:
    """Return the largest rounding error that these ramps can accumulate.

    It is relative to the largest value.
    """
    return 2.0**-52 * max((c.ramp * fs for c in changes), default=0.0)


# What a law sees ----------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Asked:
    """The arguments of a scene's law: motion, parameters, outputs and options.

    It holds what was requested, what went in, and what came out.

    For an interval of a trial these are its own samples, as they were before its
    window. Where the window is 0 they are NaN, and nothing is compared.
    """

    e: Evidence
    part: Part
    given: Mapping[str, Any]
    x: dict[str, np.ndarray]
    y: dict[str, np.ndarray]
    at: slice  # of the samples of the evidence
    window: np.ndarray
    seed: int
    # by the law itself: what the stretch after this one goes on from; it is empty where
    # the part begins
    kept: dict[Any, Any]

    @property
    def fs(self) -> float:
        """Sample rate in Hz."""
        return self.e.fs

    @property
    def n(self) -> int:
        """Number of samples."""
        return self.window.size

    @property
    def contact(self) -> np.ndarray:
        """The input ``contact``; 1 where there is none."""
        return self.x.get("contact", np.broadcast_to(1.0, self.n))

    @property
    def slack(self) -> float:
        """The relative error that accumulated rounding may cause.

        Rounding accumulates with the steps of a parameter's ramp, and with a window's
        time.
        """
        span, names = (
            self.part.span,
            {self.part.inputs.get(n, n) for n in self.part.inputs or self.e.params},
        )
        window = (
            0.0
            if span is None or not span.ramp
            else 4.0 * 2.0**-53 * (span.start + span.duration) / span.ramp
        )
        return window + lost_by_ramps((c for c in self.e.changes if c.name in names), self.fs)

    def live(self, name: str) -> np.ndarray:
        """Return a parameter's value at every sample, ramps included."""
        name = self.part.inputs.get(name, name)
        changes = [c for c in self.e.changes if c.name == name]
        return ramped(
            self.e.params[name],
            changes,
            self.fs,
            self.e.at + self.at.stop,
            self.e.at + self.at.start,
        )

    def held(self, name: str, low: float, high: float) -> np.ndarray:
        """Return a parameter's values, clamped to the range of the scene's block."""
        return np.clip(self.live(name), low, high)

    def output(self, name: str) -> str:
        """Return the scene's name of an output."""
        return self.part.outputs.get(name, name)

    def title(self, name: str) -> str:
        """Return the name of an output, for the name of a check."""
        of = f" of {self.part.name or self.part.law}" * (name in self.part.terms)
        return (
            f"{self.output(name)}{of}"
            f"{f' from {self.part.span.start:g} s' if self.part.span else ''}"
        )

    def far(self, difference: np.ndarray) -> float:
        """Return the largest absolute difference; NaN if it contains NaN.

        Differences are weighted by the window of the trial's interval.
        """
        return worst(difference, 0.0, self.window)[0]

    def expect(self, name: str, want: np.ndarray | Callable[[], np.ndarray], tol: Any) -> None:
        """Store the expected row of an output, or a function that returns it."""
        term = self.part.terms.get(name)
        if self.part.span is None:
            key = (self.output(name), term) if term else self.output(name)
            self.e.wanted[key] = lambda: (want() if callable(want) else want, tol)

    def near(
        self,
        name: str,
        want: np.ndarray,
        tol: float,
        text: str,
        least: float = 1e-300,
        group: str = "d",
    ) -> Check:
        """Check that an output equals its expected samples within a tolerance.

        The error is relative to the largest expected value, or to ``least`` if that is
        larger.
        """
        top = max(
            float(np.abs(np.where(self.window > 0, want, 0.0)).max(initial=0.0)),
            self.kept.get((name, text), 0.0),
        )
        self.kept[name, text] = top  # for the stretches after this one
        top = max(top, least)
        self.expect(name, want, (tol + self.slack) * top)
        return Check(
            group,
            f"{self.title(name)}: {text}",
            self.far(self.y[name] - want) / top,
            tol + self.slack,
            "of its largest value",
        )

    def begins(self, values: Mapping[str, float]) -> Check:
        """Check that parameters start with the requested values.

        They are compared in the scene, before any change.
        """
        found = {n: self.e.scene.params[self.part.inputs.get(n, n)].value for n in values}
        wrong = [f"{n} = {found[n]:g} for {v:g}" for n, v in values.items() if found[n] != v]
        title = "parameters" + (f" of {self.part.name}" if self.part.name else "")
        return Check(
            "d",
            f"{title}: as they were asked for",
            len(wrong),
            0,
            ", ".join(wrong) or "numbers that differ",
        )

    def silent(self, name: str, off: np.ndarray) -> Check:
        """Check that an output is exactly 0 at these samples."""
        unit = self.e.scene.outputs[self.output(name)].dim
        return Check(
            "e",
            f"{self.title(name)}: none off contact",
            self.far(self.y[name] * off),
            0.0,
            str(unit),
        )

    def say(self, text: str, name: str = "") -> None:
        """Add a line about the requested numbers to the report.

        With a name, it replaces the line of that name of the stretch before.
        """
        lines, at = self.kept.get(("said", name), (self.e.numbers, len(self.e.numbers)))
        lines[at : at + 1] = [f"{self.part.name}: {text}" if self.part.name else text]
        if name:
            self.kept["said", name] = lines, at

    def render(self, block: Block, n: int | None = None, name: str = "") -> np.ndarray:
        """Render a block that the law makes from the requested numbers.

        Its inputs have the law's names.

        If ``name`` is given, the block continues from the stretch before.
        """
        n = self.n if n is None else n
        proc = self.kept.get(name) or compile(Scene({"y": block}), self.fs, seed=self.seed)
        if name:
            self.kept[name] = proc
        x = np.array([self.x[name][:n] for name in proc.inputs]).reshape(len(proc.inputs), n)
        return samples(proc, x, n, [])[0]


def worst(difference: np.ndarray, tol: Any, window: Any = 1.0) -> tuple[float, float]:
    """Return the difference that exceeds its tolerance most, and that tolerance.

    NaN exceeds every tolerance; where the window is 0 nothing is compared.
    """
    apart = np.where(window > np.float64(0), np.abs(difference) * window, 0.0)
    at = int(np.argmax(apart - tol))
    return float(apart[at]), float(np.broadcast_to(tol, apart.shape)[at])


SceneLaw = Callable[[Asked], list[Check]]
SCENES: dict[str, SceneLaw] = {}  # the law of each shipped scene, by the scene's name


def law_of(scene: str) -> Callable[[SceneLaw], SceneLaw]:
    """Register a function of `Asked` as the law of the shipped scene with this name.

    Examples
    --------
    >>> from stimlib.checks.scenes import SCENES
    >>> SCENES["wall"].__name__
    'wall_law'
    """
    return lambda law: SCENES.setdefault(scene, law)


def asked(e: Evidence, part: Part, kept: dict[Any, Any] | None = None) -> Asked:
    """Return the arguments of a part's law, in one stretch.

    Raises
    ------
    KeyError
        The scene has lost an input or an output that the part had.
    """
    at, n = slice(0, e.x.shape[1]), e.x.shape[1]
    window = np.r_[np.zeros(e.led), np.ones(n - e.led)] if e.led else np.broadcast_to(1.0, n)
    if part.span:
        start, long, ramp, _ = part.span
        first = round(start * e.fs) - e.at
        at = slice(min(first, n), min(first + round(long * e.fs), n))
        t = np.arange(at.stop - at.start) / np.longdouble(e.fs)
        inside = np.clip(np.minimum(t, long - t) / ramp if ramp else t * 0 + 1, 0, 1)
        window = (np.sin(np.pi * inside / 2) ** 2).astype(float)
    inputs = dict(zip(e.proc.inputs, e.x, strict=True))
    rows = e.terms | {(n, ""): row for n, row in zip(e.scene.outputs, e.y, strict=True)}
    own = part.inputs or {n: n for n in inputs}
    x = {n: inputs[name][at] for n, name in own.items() if name not in e.params}
    own, none = part.outputs or {n: n for n in e.scene.outputs}, Term("", 1.0, 1)
    y = {n: rows[name, part.terms.get(n, none).path][at] for n, name in own.items()}
    seed = e.seed
    if part.span:
        with np.errstate(divide="ignore", invalid="ignore"):
            y = {n: np.where(window > 0, row / window, np.nan) for n, row in y.items()}
        if part.span.seed is not None:
            seed = part.span.seed
    return Asked(e, part, part.given or {}, x, y, at, window, seed, {} if kept is None else kept)
