"""Random correct compositions of all classes, none of which may be refused:
tests/checks/test_local.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from contract import TABLE, Entry

from stimlib import Block, Input, Param, Scene, StimlibError, blocks as b, constant
from stimlib.checks import local
from stimlib.core import units
from stimlib.core.graph import reach
from stimlib.run.processor import Change

RATES = 1000.0, 4000.0, 8000.0, 44100.0
EVENTS = {"sparse"}  # of these an input of an entry is made of nothing else
# two have inputs of their own, one is of outputs
ENTRIES = [e for e in TABLE if e.name not in ("squeeze", "bumps", "guard")]


def plain(block: Block) -> Block:
    """A signal without unit."""
    return block if block.dim == units.ONE else block / constant(1.0, str(block.dim))


def drawn(rng: Any) -> tuple[Scene, dict[str, Callable], float]:
    """A scene of some entries, each driven by inputs, noises or the entries before, in
    gates, segments and loops.
    """
    fs = float(rng.choice(RATES))
    made: list[Block] = [b.white_noise(1), Param("a", 0.7) * b.oscillator(31.0, "triangle")]
    drives: dict[str, Callable] = {}
    outputs: dict[str, Block] = {}
    for k in range(int(rng.integers(2, 6))):
        e: Entry = ENTRIES[rng.integers(len(ENTRIES))]
        if fs not in e.rates and e.rates != (8000.0, 1000.0):
            continue
        signals = []
        for name, drive in zip(e.inputs, e.drive, strict=True):
            if rng.random() < 0.4 and drive.__name__ not in EVENTS | {"positive"}:
                signals.append(
                    b.tanh(plain(made[rng.integers(len(made))]))
                    * constant(0.02 if e.unit == "m" else 1.0, e.unit)
                )
            else:
                drives[f"x{k}_{name}"] = drive
                signals.append(Input(f"x{k}_{name}", e.unit))
        block = e.make(*signals)
        kind = int(rng.integers(6))
        below = {type(v) for v in reach([block])}
        if kind == 0 and not any(isinstance(v, Input) for v in reach([block])):
            block = b.enabled(block, by=b.white_noise(100 + k) > 0.3)
        elif kind == 1:
            block = b.segment(
                block,
                float(rng.uniform(0, 0.05)),
                float(rng.uniform(0.02, 0.3)),
                seed=int(rng.integers(9)),
            )
        elif kind == 2 and below:
            block = b.loop(
                lambda last, block=block: 0.7 * last + block,
                unit="" if block.dim == units.ONE else str(block.dim),
            )
        outputs[f"y{k}"] = block
        made.append(block)
    return Scene(outputs or {"y": made[1]}), drives, fs


def refused(seed: int) -> tuple[list[local.Held], Scene] | None:
    """What a correct composition is refused for; None where there is no such scene."""
    rng = np.random.default_rng([seed, 41])
    try:
        scene, drives, fs = drawn(rng)
        n = int(rng.choice([300, 3000, 40000], p=[0.3, 0.6, 0.1]))
        x = {name: drives[name](rng, n, fs) for name in scene.inputs}
        some = list(scene.params) and np.sort(rng.integers(0, n, 3))
        moves = [
            Change(int(at), str(rng.choice(list(scene.params))), float(rng.uniform(0.1, 0.9)), 0.01)
            for at in some
        ]
        params = {name: p.value for name, p in scene.params.items()}
        run = local.Run(scene.outputs, fs, seed, x, n, params, moves, local.spans(n, seed))
        return [h for h in local.held(run) if not h.error <= 1], scene
    except StimlibError:  # names, keys of noises or memories that do not fit together
        return None
