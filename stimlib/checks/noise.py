"""Checks of the delivered noise: generator and spectrum.

It must be the published generator's, sample for sample, with the spectrum of the model.
"""

from __future__ import annotations

import dataclasses as dc
from functools import cache
from typing import Any

import numpy as np

from ..analysis import spectra
from ..blocks.noise import RestingWhite, White
from ..core.graph import Block, Input, reach, signals
from ..core.parameter import Param
from ..core.program import first_states, lead
from ..core.scene import Scene
from ..core.subsystems import Enabled, Subsystem
from ..errors import SceneError, counted
from ..run.processor import Processor, compile
from . import laws
from .evidence import DEVIATES, FEWEST, Check, Evidence, Tap, at_once
from .power import pairs, tells

FILTERED = 1e-11  # of a filter fed with one and the other, relative to its largest sample


def generator(e: Evidence) -> list[Check]:
    """Check every noise sample by sample against the published generator.

    A gated noise is compared with its filter, driven by that generator.
    """
    white, sources = _Published(lead(e.fs)), _sources(e)
    known = {(seed, b.noise_key) for b, seed, _ in sources.values()}
    fed = [_fed(t, e, known) for t in e.taps]
    apart, size = dict.fromkeys(sources, 0.0), dict.fromkeys(sources, 0)
    off, top, samples = np.zeros(len(fed)), np.zeros(len(fed)), np.zeros(len(fed), int)
    more: list[list[np.ndarray]] = [[t.stream] for t in e.taps]
    most = at_once(e.scene)
    for s in e.stretches():
        for name, (b, seed, own) in sources.items():
            seen = s.whites[name] if own is None else own.process(np.empty((0, s.end - s.at)))[0]
            want = white(seed, b.noise_key, size[name], size[name] + seen.size)
            apart[name] = max(apart[name], float(np.abs(seen - want).max(initial=0.0)))
            size[name] += seen.size
        for k, (t, proc) in enumerate(zip(s.taps, fed, strict=True)):
            if s.at and samples[k] < most:
                more[k].append(t.stream[: most - samples[k]])
            if proc is not None and t.stream.size:
                want = _filtered(proc, white, t, int(samples[k]))
                off[k] = max(off[k], np.abs(t.stream - want).max())
                top[k] = max(top[k], np.abs(want).max())
            samples[k] += t.stream.size
    checks = []
    for name in sources:
        text = f"Philox and Box-Muller, written again, {counted(size[name], 'sample')}"
        checks.append(Check("c", f"{name}: generator", apart[name], DEVIATES, text))
    for k, t in enumerate(e.taps):
        # its spectrum is that of its first samples, wherever the gate was open
        if len(more[k]) > 1:
            e.taps[k] = dc.replace(t, stream=np.concatenate(more[k]))
        if fed[k] is None:
            why = (
                "a parameter, a gate, another generator or what begins at sample 0 is in it, or it"
                " runs before sample 0"
            )
            e.skipped.append(f"samples of {t.block!r} in {t.title}: {why}")
            continue
        text = f"its filter fed with that generator, {counted(samples[k], 'sample')}"
        checks.append(
            Check(
                "c",
                f"{t.title}: noise as displayed",
                float(off[k] / (top[k] or 1.0)),
                FILTERED,
                text,
            )
        )
    return checks


class _Published:
    """The published generator, with a store of the last samples of each source."""

    def __init__(self, early: int):
        self.early = early
        self.made: dict[Any, tuple[int, np.ndarray]] = {}

    def __call__(self, seed: int, key: Any, first: int, stop: int) -> np.ndarray:
        """Return samples first .. stop - 1 of the source's own clock."""
        at, row = self.made.get((seed, key), (0, np.empty(0)))
        if not at <= first <= stop <= at + row.size:
            at = first - self.early if not first else first  # a filter before a gate begins early
            even = at - at % 2
            row = laws.white(seed, key[0], key[1], even, stop - even)[at - even :]
            self.made[seed, key] = at, row
        return row[first - at : stop - at]


def _sources(e: Evidence) -> dict[str, tuple[Any, int, Any]]:
    """Return the sources of published noise by name.

    Each comes with its block, the seed of its run, and a processor that makes its
    samples if they were not observed.
    """
    found: dict[str, tuple[Any, int, Any]] = {}
    for name, i in e.proc.program.noises.items():
        b, seed = (
            e.proc.program.instances[i].block,
            e.proc.program.seeds[e.proc.program.instances[i].clock],
        )
        if isinstance(b, RestingWhite):
            b = White(b.seed, b.stream, b.shared)
        if not isinstance(b, White):
            e.skipped.append(f"{name}: {b!r} has a generator of its own")
            continue
        seed = e.seed if seed is None else seed
        found[name] = (
            b,
            seed,
            None if name in e.whites else compile(Scene({"y": b}), e.fs, seed=seed),
        )
    return found


def _filtered(proc: Processor, white: _Published, t: Tap, first: int) -> np.ndarray:
    """Return a gated noise from the published generator, as long as its stream.

    It starts with the stream's sample ``first``.
    """
    early = 0 if first else white.early
    keys = [tuple(map(int, name.split("_")[1:])) for name in proc.inputs]
    return proc.process(
        np.array([white(t.seed, key, first - early, first + t.stream.size) for key in keys])
    )[0, early:]


def _fed(t: Tap, e: Evidence, known: set[Any]) -> Processor | None:
    """Return a processor for a gated noise's filter, at its first sample.

    Its blocks are those without the gate, with inputs in place of the sources.
    """
    # it ran before sample 0, for as long as its gate was open
    if isinstance(t.block, Enabled) and t.block.by.autonomous:
        return None
    below = reach([t.block.block])
    whites = [b for b in below if b.noise_key]
    unknown = any((t.seed, b.noise_key) not in known for b in whites)
    # what begins at sample 0, as a loop does, has not heard what sources made before
    if unknown or any(isinstance(b, Param | Subsystem) or not b.autonomous for b in below):
        return None
    new: dict[int, Block] = {}
    old: dict[int, Block] = {}
    for b in below:
        if b.noise_key:
            new[id(b)] = Input("white_{}_{}".format(*b.noise_key))
        elif signals(type(b)):
            new[id(b)] = dc.replace(  # type: ignore[type-var]
                b, **{s: new[id(getattr(b, s))] for s in signals(type(b))}
            )
        else:
            new[id(b)] = b
        old[id(new[id(b)])] = b
    try:
        proc = compile(Scene({"n": new[id(t.block.block)]}), e.fs, seed=t.seed)
    except SceneError:
        return None
    like = [q._replace(block=old.get(id(q.block), q.block)) for q in proc.program.instances]
    # states of the blocks that run early, which the inputs keep these from
    design = []
    for q, (p, s) in zip(proc.program.instances, proc.design, strict=True):
        if q.kind == "block" and id(q.block) in old:
            s = old[id(q.block)].design(e.fs)[1]
        design.append((p, s))
    states = first_states(proc.program._replace(instances=like), design)
    proc.state = np.r_[proc.state[:2], states(t.seed)]
    return proc


def noise(e: Evidence) -> list[Check]:
    """Check the spectrum of every tap, and the independence of every pair."""
    checks, share = [], e.share
    for k, t in enumerate(e.taps):
        if t.model is None:
            e.skipped.append(
                f"spectrum of {t.block!r} in {t.title}: no law of all its blocks is known"
            )
            continue
        s = (
            spectra.test_spectrum(t.stream, e.fs, t.model, t.f_low, t.f_high)
            if t.stream.size > FEWEST
            else None
        )
        if s is None:
            e.skipped.append(
                f"spectrum of {t.block!r} in {t.title}: only {t.stream.size / e.fs:.3g} s enabled,"
                " too short to test"
            )
            continue
        e.taps[k] = dc.replace(t, spectrum=s)
        text = (
            f"{counted(len(s.bands), 'band')}, {s.level_db:+.3f} dB over"
            f" {t.stream.size / e.fs:.3g} s"
        )
        checks.append(Check("c", f"{t.title}: spectrum", _surprise(s.p), _surprise(share), text))
    streams = {id(t.stream): (t.stream, t.model) for t in e.taps}

    @cache  # each noise once for each length and band, not for each partner
    def white(stream: int, *cut: Any) -> np.ndarray:
        (x, model), (n, low, high) = streams[stream], cut
        assert model is not None
        return spectra.whitened(x[:n], e.fs, model, low, high)[2]

    for a, b, low, high, bins in pairs(e):
        name = f"{a.title} and {b.title}: independence"
        if not tells(bins, share):
            e.skipped.append(
                f"{name}: they begin with one seed, or have too few frequencies in common to tell"
                " even equal noises"
            )
            continue
        cut = min(a.stream.size, b.stream.size), low, high
        c, p = spectra.correlated_p(*(white(id(t.stream), *cut) for t in (a, b)))
        checks.append(Check("c", name, _surprise(p), _surprise(share), f"correlation {c:+.3g}"))
    return checks


def _surprise(p: float) -> float:
    """Return -log10 p, at least 0."""
    return float(max(0.0, -np.log10(max(p, 1e-300))))
