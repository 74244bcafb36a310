"""Each block of a scene against a law of its own, on the signals that it really got, whatever it is composed with."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from ..blocks.maps import Nonzero
from ..blocks.noise import White
from ..core.graph import Block, Const, Enabled, Input, Map, Param, Pick, Segment, Subsystem, as_block, reach, signals, type_name
from ..core.loops import Last, Loop, Tap
from ..core.scene import Scene
from ..errors import BadValue
from ..run.processor import Change, compile
from ..run.walk import samples
from . import laws, rows
from .evidence import Check, Evidence, ramped

MOST = 1 << 15  # samples that are looked at, from the first on
FADED = 1e-180  # what a loop counts as 0
NOISE = 1e-13  # of two computations of a normal deviate
WIRES = Pick | Tap | Loop | Const


class Held(NamedTuple):
    """One block against its law."""

    block: Block
    where: str  # the subsystems that it is in
    samples: int  # that were looked at
    error: float  # largest, over its tolerance
    why: str = ""  # it is not held; with an error: what is wrong with its law


def blocks_held(e: Evidence) -> list[Check]:
    """A check for each class of block; what has no law, or could not be seen, goes to ``skipped``."""
    found = held(e.scene, e.fs, e.seed, dict(zip(e.proc.inputs, e.x, strict=True)), e.x.shape[1], e.params, e.changes)
    for kind in dict.fromkeys((type_name(type(h.block)), h.why) for h in found if h.why and not h.error):
        same = [h for h in found if (type_name(type(h.block)), h.why) == kind]
        e.skipped.append(f"{same[0].block!r}{same[0].where}{f' and {len(same) - 1} more' if same[1:] else ''}: {kind[1]}")
    checks = []
    for name in dict.fromkeys(_group(h.block) for h in found if h.error or not h.why):
        same = [h for h in found if (h.error or not h.why) and _group(h.block) == name]
        worst = max(same, key=lambda h: h.error)
        text = f"error over tolerance, {len(same)} blocks, {max(h.samples for h in same)} samples"
        text += f"; the largest is that of {worst.block!r}{worst.where}" if worst.error > 1 else ""
        text += f": {worst.why}" if worst.why else ""
        checks.append(Check("f", name, worst.error, 1.0, text))
    return checks


def _group(b: Block) -> str:
    """What a block is listed under."""
    if isinstance(b, Input | Param):
        return "inputs and parameters"
    return "arithmetic" if isinstance(b, Map) and type_name(type(b)) in rows.LAWS else type_name(type(b))


def held(
    scene: Scene,
    fs: float,
    seed: int,
    x: Mapping[str, np.ndarray],
    n: int,
    params: dict[str, float],
    changes: Sequence[Change],
    where: str = "",
) -> list[Held]:
    """Every block of a scene, also those in its subsystems, each on its own clock.

    Parameters
    ----------
    scene : Scene
    fs : float
        Hz.
    seed : int
    x : dict of str to ndarray, shape (n,)
        The samples of each input.
    n : int
    params : dict of str to float
        At the first sample.
    changes : list of Change
        Of parameters, by sample.
    where : str
        What the scene is the inside of.
    """
    blocks = outside(scene.outputs.values())
    moves = [*(Change(0, name, float(v), 0.0) for name, v in params.items()), *changes]
    seen, n = _seen(scene, blocks, fs, seed, x, n, moves)
    found = []
    for b in blocks:
        if isinstance(b, Loop):
            want = np.r_[b.last.first, seen[id(b.body)][:-1]]  # type: ignore[attr-defined]
            found.append(Held(b.last, where, n, _error(seen[id(b.last)], want, FADED)))
        elif isinstance(b, Subsystem):
            found += _inside(b, seen, fs, seed, {k: v[:n] for k, v in x.items()}, params, changes, where)
        elif not isinstance(b, WIRES | Last):
            found.append(_one(b, seen, fs, seed, x, params, changes, where, n))
    return found


def outside(roots: Iterable[Block]) -> list[Block]:
    """All blocks that are in no subsystem, children first."""
    found: dict[int, Block] = {}
    todo = list(roots)
    while todo:
        new = [b for b in reach(todo, Subsystem) if id(b) not in found]
        found |= {id(b): b for b in new}
        todo = [b.by for b in new if isinstance(b, Subsystem)]  # type: ignore[attr-defined]
    return [b for b in reach(list(roots)) if id(b) in found]


def _seen(
    scene: Scene, blocks: list[Block], fs: float, seed: int, x: Mapping[str, np.ndarray], n: int, changes: Sequence[Change]
):
    """The row of each block, and how many samples are known of all: to where one is not finite, or too many would be kept."""
    around = _loops(blocks)
    shown: dict[str, Block] = {}
    names: dict[int, list[str]] = {}
    for b in blocks:
        if isinstance(b, Const):
            continue
        parts = [Pick(b, name) for name in b.outputs] if b.outputs else [b]
        names[id(b)] = [f"row{len(shown) + k}" for k in range(len(parts))]
        shown |= dict(zip(names[id(b)], (reduce(lambda v, loop: Tap(loop, v), around[id(b)], p) for p in parts), strict=True))
    # a row that is not finite closes the guard of its output, after which nothing of it is known
    wrong = reduce(lambda a, b: a + b, (Nonzero(v - v) for v in shown.values()), as_block(0.0))
    n = min(n, MOST)
    y = _run(Scene({**shown, "wrong": wrong}), fs, seed, x, n, changes)
    n = int(np.argmax(np.r_[y[-1] != 0, True]))
    at = {name: y[k, :n] for k, name in enumerate(shown)}
    rows_of = {key: at[name[0]] if len(name) == 1 else np.array([at[v] for v in name]) for key, name in names.items()}
    return rows_of | {id(b): np.full(n, b.value) for b in blocks if isinstance(b, Const)}, n


def _run(scene: Scene, fs: float, seed: int, x: Mapping[str, np.ndarray], n: int, changes: Sequence[Change]) -> np.ndarray:
    proc = compile(scene, fs, seed=seed)
    motion = np.array([x[name][:n] for name in proc.inputs]).reshape(len(proc.inputs), n)
    return samples(proc, motion, n, [c for c in changes if c.name in proc.params])


def _loops(blocks: list[Block]) -> dict[int, list[Block]]:
    """The loops that each block is in, the outermost last: it depends on their last values."""
    found: dict[int, list[Block]] = {}
    of = {id(b.last): b for b in blocks if isinstance(b, Loop)}
    for b in blocks:
        below = [loop for c in b.children for loop in found[id(c)]] if not isinstance(b, Subsystem) else []
        mine = [of[id(b)]] if isinstance(b, Last) else [b] if isinstance(b, Loop) else [b.loop] if isinstance(b, Tap) else []
        inner = (
            {id(loop): loop for loop in [*mine, *below]}
            if isinstance(b, Last)
            else {id(v): v for v in below if all(v is not m for m in mine)}
        )
        found[id(b)] = list(inner.values())
    return found


def _one(b: Block, seen: Any, fs: float, seed: int, x: Any, params: Any, changes: Any, where: str, n: int) -> Held:
    kind, y = type_name(type(b)), seen[id(b)]
    if isinstance(b, Input):
        return Held(b, where, n, _error(y, x[b.name][:n], 0.0))
    if isinstance(b, Param):
        want = ramped(params[b.name], [c for c in changes if c.name == b.name], fs, n)
        return Held(b, where, n, _error(y, want, 1e-12 * float(np.abs(want).max(initial=1e-300))))
    if isinstance(b, White):
        return Held(b, where, n, _error(y, laws.white(seed, *b.noise_key, 0, n), NOISE))
    law = type(b).law or rows.LAWS.get(kind)
    none = "held by its response alone, (a2)" if b.laws(fs) else "no law of its output from its inputs is known"
    if law is None:
        return Held(b, where, 0, 0.0, none)
    if (
        b.autonomous
        and not isinstance(b, Map)
        and (kind in rows.SETTLED or any(c.noise_key for c in reach([b])))
        and signals(type(b))
    ):
        return Held(b, where, 0, 0.0, "it begins before sample 0, where its inputs are not seen")
    got = [seen[id(getattr(b, s))] for s in signals(type(b))]
    try:
        with np.errstate(all="ignore"):
            made = law(b, fs, got, y)
    except Exception as error:
        if type(b).law is None:
            raise
        return Held(b, where, n, np.inf, f"its law raises {type(error).__name__}: {error}")
    if made is None:
        return Held(b, where, 0, 0.0, none)
    want, tol = made if isinstance(made, tuple) else (made, 0.0)
    if np.shape(want) != y.shape:
        raise BadValue(
            f"{kind}.law returned the shape {np.shape(want)}, where the block has {y.shape}; return a row for each output"
        )
    return Held(b, where, n, _error(y, want, tol))


def _error(y: np.ndarray, want: Any, tol: Any) -> float:
    """Largest distance over its tolerance; nan is itself."""
    want, tol = np.asarray(want, float), np.broadcast_to(tol, y.shape)
    with np.errstate(all="ignore"):
        ratio = np.abs(y - want) / tol
    same = (y == want) | (np.isnan(y) & np.isnan(want)) | np.isinf(tol)
    return float(np.max(np.where(same, 0.0, np.where(np.isnan(ratio), np.inf, ratio)), initial=0.0))


def _inside(b: Any, seen: Any, fs: float, seed: int, x: Any, params: Any, changes: Any, where: str) -> list[Held]:
    """What a subsystem runs, rendered alone on its own clock: its samples where it runs are the same bits, elsewhere 0."""
    on, y = seen[id(b.by)] > 0, seen[id(b)]
    if b.by.autonomous and isinstance(b, Enabled):
        return [Held(b, where, 0, 0.0, "it runs before sample 0, where its gate is not seen")]
    at = np.flatnonzero(on)
    place = f"{where} in {'a segment' if isinstance(b, Segment) else 'enabled'}"
    if not at.size:
        return [Held(b, where, y.size, float(np.abs(y).max(initial=0.0) > 0) * np.inf if y.any() else 0.0)]
    used = {c.name for c in reach([b.block]) if isinstance(c, Param)}
    moved = [c for c in changes if c.name in used]
    if any(0 < c.at or c.ramp * fs > 1 for c in moved) and isinstance(b, Enabled):
        return [Held(b, where, 0, 0.0, "a parameter inside it changed, on a clock of its own")]
    if any(c.at < at[0] < c.at + max(1, round(c.ramp * fs)) for c in moved):
        return [Held(b, where, 0, 0.0, "a parameter moved as it began")]
    values = {name: ramped(params[name], [c for c in moved if c.name == name], fs, at[0] + 1)[-1] for name in used}
    late = [c._replace(at=c.at - int(at[0])) for c in moved if c.at > at[0]]
    its = getattr(b, "seed", None)
    its = seed if its is None else its
    inner = Scene({"y": b.block})
    rows_in = {name: x[name][on] for name in inner.inputs}
    first = [Change(0, name, float(v), 0.0) for name, v in values.items()]
    alone = _run(inner, fs, its, rows_in, at.size, [*first, *late])[0]
    want = np.zeros(y.size)
    want[on] = alone
    return [Held(b, where, y.size, _error(y, want, 0.0)), *held(inner, fs, its, rows_in, at.size, values, late, place)]
