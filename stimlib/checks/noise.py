"""Is the noise that was displayed the published generator's, sample for sample, and has
it the spectrum of the model?
"""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np

from ..analysis import spectra
from ..blocks.noise import White
from ..core.graph import Block, Enabled, Input, Param, Subsystem, reach, signals
from ..core.loops import Loop
from ..core.program import first_states, lead
from ..core.scene import Scene
from ..errors import SceneError
from ..run.processor import compile
from . import laws
from .evidence import FEWEST, Check, Evidence, Tap
from .power import pairs

GENERATOR = 1e-13  # of two computations of a normal deviate
FILTERED = 1e-11  # of a filter fed with one and the other, relative to its largest sample


def generator(e: Evidence) -> list[Check]:
    """Every sample of every source against the published generator, and every sample of
    every gated noise against its filter fed with that."""
    checks, n, early = [], e.x.shape[1], lead(e.fs)
    known: dict[Any, np.ndarray] = {}
    for name, i in e.proc.program.noises.items():
        b, seed = (
            e.proc.program.instances[i].block,
            e.proc.program.seeds[e.proc.program.instances[i].clock],
        )
        if not isinstance(b, White):
            e.skipped.append(f"{name}: {b!r} has a generator of its own")
            continue
        seed = e.seed if seed is None else seed
        white = laws.white(seed, *b.noise_key, -early - early % 2, n + early + early % 2)[
            early % 2 :
        ]
        known[seed, b.noise_key] = white
        seen = (
            e.whites[name]
            if name in e.whites
            else compile(Scene({"y": b}), e.fs, seed=seed).process(np.empty((0, n)))[0]
        )
        apart = float(np.abs(seen - white[early : early + seen.size]).max(initial=0.0))
        text = f"Philox and Box-Muller, written again, {seen.size} samples"
        checks.append(Check("c", f"{name}: generator", apart, GENERATOR, text))
    for t in e.taps:
        want = _fed(t, e, known)
        if want is None:
            why = "a parameter, a gate or another generator is in it, or it runs before sample 0"
            e.skipped.append(f"samples of {t.name} in {t.output}: {why}")
            continue
        apart = float(
            np.abs(t.stream - want).max(initial=0.0) / (np.abs(want).max(initial=0.0) or 1.0)
        )
        text = f"its filter fed with that generator, {t.stream.size} samples"
        checks.append(Check("c", f"{t.output}: noise as displayed", apart, FILTERED, text))
    return checks


def _fed(t: Tap, e: Evidence, known: dict[Any, np.ndarray]) -> np.ndarray | None:
    """The enabled samples of a gated noise once more: its blocks without the gate,
    inputs in place of the sources.
    """
    # it ran before sample 0, for as long as its gate was open
    if isinstance(t.block, Enabled) and t.block.by.autonomous:
        return None
    below = reach([t.block.block])
    whites = [b for b in below if b.noise_key]
    if any(isinstance(b, (Param, Subsystem, Loop)) for b in below) or any(
        (t.seed, b.noise_key) not in known for b in whites
    ):
        return None
    new: dict[int, Block] = {}
    old: dict[int, Block] = {}
    for b in below:
        if b.noise_key:
            new[id(b)] = Input("white_{}_{}".format(*b.noise_key))
        elif signals(type(b)):
            new[id(b)] = dc.replace(b, **{s: new[id(getattr(b, s))] for s in signals(type(b))})  # type: ignore[type-var]
        else:
            new[id(b)] = b
        old[id(new[id(b)])] = b
    try:
        proc = compile(Scene({"n": new[id(t.block.block)]}), e.fs, seed=t.seed)
    except SceneError:
        return None
    like = [q._replace(block=old.get(id(q.block), q.block)) for q in proc.program.instances]
    # states of the blocks that run early, which the inputs keep these from
    design = [
        (p, old[id(q.block)].design(e.fs)[1] if q.kind == "block" and id(q.block) in old else s)
        for q, (p, s) in zip(proc.program.instances, proc.design, strict=True)
    ]
    proc.state = np.r_[
        proc.state[:2], first_states(proc.program._replace(instances=like), design)(t.seed)
    ]
    rows = {
        "white_{}_{}".format(*key): white for (seed, key), white in known.items() if seed == t.seed
    }
    early = lead(e.fs)
    x = np.array([rows[name][: early + t.stream.size] for name in proc.inputs])
    return proc.process(x)[0, early:]


def noise(e: Evidence) -> list[Check]:
    """Spectrum of every tap, and independence of every pair."""
    checks, share = [], e.share
    for k, t in enumerate(e.taps):
        if t.model is None:
            e.skipped.append(
                f"spectrum of {t.name} in {t.output}: no law of all its blocks is known"
            )
            continue
        s = (
            spectra.test_spectrum(t.stream, e.fs, t.model, t.f_low, t.f_high)
            if t.stream.size > FEWEST
            else None
        )
        if s is None:
            e.skipped.append(
                f"spectrum of {t.name} in {t.output}: only {t.stream.size / e.fs:.3g} s enabled,"
                " too short to test"
            )
            continue
        e.taps[k] = dc.replace(t, spectrum=s)
        text = f"{s.level_db:+.3f} dB over {t.stream.size / e.fs:.3g} s"
        checks.append(
            Check(
                "c",
                f"{t.output}: spectrum, {len(s.bands)} bands",
                _surprise(s.p),
                _surprise(share),
                text,
            )
        )
    for a, b, low, high, size in pairs(e):
        name = f"{a.output} and {b.output}: independence"
        if not np.isfinite(size):
            e.skipped.append(
                f"{name}: they begin with one seed, or have too few frequencies in common to tell"
                " even equal noises"
            )
            continue
        assert a.model is not None
        c, p = spectra.correlation(a.stream, b.stream, e.fs, a.model, low, high)
        checks.append(Check("c", name, _surprise(p), _surprise(share), f"correlation {c:+.3g}"))
    return checks


def _surprise(p: float) -> float:
    """-log10 p, at least 0."""
    return float(max(0.0, -np.log10(max(p, 1e-300))))
