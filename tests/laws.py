"""What the laws are made of: runs in cuts, comparisons of bits, and the guard written a
second time; what is left to stress.
"""

from __future__ import annotations

import dataclasses as dc
import os

import numpy as np
import pytest
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Scene
from stimlib.checks import local
from stimlib.core.graph import Block, kind, reach

STRESS = bool(os.environ.get("STIMLIB_STRESS"))


def mostly(chosen, whole):
    """Parameters of a test: what is chosen; in `make stress` the rest of the whole."""
    more = pytest.mark.stress
    return [
        v if v in chosen else pytest.param(v, marks=more) for v in whole if STRESS or v in chosen
    ]


def kept(table):
    """What is chosen of a table; in `make stress` all of it."""
    return [p for p in table if STRESS or not p.marks]


def bits(a):
    """The bits of float64 numbers, so that -0.0 is not 0.0 and nan is itself."""
    a = np.ascontiguousarray(a)
    return a.view(np.uint64) if a.dtype == np.float64 else a


def assert_same(a, b, what=""):
    """Bit for bit."""
    assert a.shape == b.shape, f"{what}: shapes {a.shape} and {b.shape}"
    if not np.array_equal(bits(a), bits(b)):
        at = tuple(int(k) for k in np.argwhere(bits(a) != bits(b))[0])
        raise AssertionError(
            f"{what}: {np.sum(bits(a) != bits(b))} of {a.size} differ, first at {at}: {a[at]!r} and"
            f" {b[at]!r}"
        )


@dc.dataclass
class Set:
    """A call of ``Processor.set`` before sample ``at``."""

    at: int
    name: str
    value: float
    ramp: float


def some_sets(proc, n, rng, count=4):
    """Calls of ``set`` at random samples, on parameters of a processor."""
    names = list(proc.params)
    if not names or n == 0:
        return []
    return [
        Set(
            int(rng.integers(0, n)),
            str(rng.choice(names)),
            float(rng.choice([0.0, 0.5, -1.3, 2.0])),
            float(rng.choice([0.0, 0.004, 0.05])),
        )
        for _ in range(count)
    ]


def cut_at(n, size):
    return list(range(0, n, size))


def random_cuts(n, rng, count=12):
    return sorted(int(k) for k in rng.integers(0, n + 1, count))  # some empty, some doubled


def run(proc, x, cuts=(), sets=(), each=None):
    """Process x, cut at these places and wherever something is set; ``each(proc)``
    after every part.
    """
    n = x.shape[1]
    places = sorted({0, n, *cuts, *(s.at for s in sets)})
    parts = []
    for start, stop in zip(places, places[1:], strict=False):
        for s in sets:
            if s.at == start:
                proc.set(s.name, s.value, s.ramp)
        parts.append(proc.process(np.ascontiguousarray(x[:, start:stop])))
        if each:
            each(proc)
    return np.concatenate(parts, axis=1) if parts else np.empty((len(proc.outputs), 0))


def pair(scene, fs, seed=0):
    """The compiled and the interpreted processor."""
    return stimlib.compile(scene, fs, "llvm", seed), stimlib.compile(scene, fs, "python", seed)


def twins(scene, fs, x, *sizes):
    """The compiled processor, and its samples: those of the interpreter, with the
    state before and after, in one part and in parts of these sizes. Rows x are drawn
    where it is their length.
    """
    fast, slow = pair(scene, fs)
    if isinstance(x, int):
        x = np.random.default_rng(1).standard_normal((len(fast.inputs), x))
    assert_same(fast.state, slow.state, "state before sample 0")
    y = slow.process(x)
    for size in (x.shape[1], *sizes):
        fast.reset()
        assert_same(run(fast, x, cut_at(x.shape[1], size)), y, f"parts of {size}")
        assert_same(fast.state, slow.state, "state")
    return fast, x, y


def played(block, *x, fs=1000.0, target="llvm"):
    """Samples of a block, or of several by name, over rows for its inputs or a
    dictionary of them; of a source, so many.
    """
    proc = stimlib.compile(Scene(block if isinstance(block, dict) else {"y": block}), fs, target)
    if isinstance(x[0], dict):
        x = [x[0][name] for name in proc.inputs]
    y = proc.process(np.array(x, float) if proc.inputs else x[0])
    return y if isinstance(block, dict) else y[0]


def rows(proc, x, names):
    """Rows of x, given in the order of names, in the order of a processor's inputs; new
    ones are zero.
    """
    out = np.zeros((len(proc.inputs), x.shape[1]))
    for i, name in enumerate(proc.inputs):
        if name in names:
            out[i] = x[names.index(name)]
    return out


def raw(scene, fs, x, names, seed=0):
    """What stands before the guards, by the interpreter."""
    proc = stimlib.compile(scene, fs, "python", seed)
    x = rows(proc, x, list(names))
    before = [proc.program.instances[o].args[0] for o in proc.program.outputs.values()]
    inputs = list(proc.program.inputs.values())
    out = np.empty((len(before), x.shape[1]))
    with np.errstate(all="ignore"):
        for n in range(x.shape[1]):
            v = proc._engine.sample(dict(zip(inputs, x[:, n], strict=True)))
            out[:, n] = [v[i] for i in before]
    return out


def guarded(row, fs):
    """(samples, index of the fault or None): the guard as the documents describe it."""
    bad = np.flatnonzero(~np.isfinite(row))
    if not bad.size:
        return row.copy(), None
    at, m = int(bad[0]), max(1, round(0.02 * fs))
    last = row[at - 1] if at else 0.0
    fade = np.array([last * ((m - k) / m) for k in range(m + 1)])
    y = np.zeros(row.size)
    y[:at] = row[:at]
    y[at : at + m + 1] = fade[: row.size - at]
    y[at + m + 1 :] = last * 0.0
    return y, at


def float_words(proc):
    """Which words of ``proc.state`` are floats."""
    mask = [False, False]
    for q, (_, s) in zip(proc.program.instances, proc.design, strict=True):
        if q.kind == "block":
            for v in s:
                mask += [kind(v) in "fF"] * (v.size if isinstance(v, np.ndarray) else 1)
    return np.array(mask)


WRONG = (
    np.array([2**64 - 1, 2**63, 5, 70, 10**8], np.uint64),
    np.array([np.nan, np.inf, -np.inf, -1e6, -1.0, 0.5, 1e300]),
)


def garbage(proc, rng, singles):
    """States that no run has: random bits, not finite, huge, negative; and one wrong
    word in a good one.
    """
    good = proc.state
    n = good.size - 2
    wrong = np.concatenate([w.view(np.uint64) for w in WRONG])
    bodies = [
        rng.integers(0, 2**64, n, np.uint64),
        rng.choice(wrong, n),
        np.full(n, 2**64 - 1, np.uint64),
    ]
    bodies += [np.full(n, v).view(np.uint64) for v in (np.nan, np.inf, -1e300, -3.0, 1e9)]
    for _ in range(singles if n else 0):
        bodies.append(good[2:].copy())
        # numbers follow arrays
        bodies[-1][rng.choice([rng.integers(n), n - 1 - rng.integers(min(n, 4))])] = rng.choice(
            wrong
        )
    return [np.concatenate([good[:2], body]) for body in bodies]


def lawful(block, fs, **x):
    """Hold a block, and what is below it, against their laws, on those of these rows
    that it has as inputs.
    """
    scene = Scene({"y": block})
    params = {name: p.value for name, p in scene.params.items()}
    inputs = {q.name for q in reach([block]) if isinstance(q, Input)}
    rows_of = {name: np.asarray(row, float) for name, row in x.items() if name in inputs}
    n = len(next(iter(rows_of.values())))
    found = local.held(local.Run(scene.outputs, fs, 0, rows_of, n, params, [], [(0, n)]))
    assert not [h for h in found if h.why or not h.error <= 1]


def impulse_response(proc, output, input, n, at=8):
    """Answer to 1 at sample ``at``, from there on; inputs and processor at rest
    before.
    """
    x = np.zeros((len(proc.inputs), n + at))
    x[proc.inputs.index(input), at] = 1.0
    return proc.process(x)[proc.outputs.index(output), at:]


def alias(y, k, top):
    """Power below top (a part of fs) that is not on multiples of line k, in dB of the
    power on them.
    """
    P = np.abs(np.fft.rfft(y)) ** 2
    n = np.arange(P.size)
    low = (n > 0) & (n < top * y.size)
    return 10 * np.log10(P[low & (n % k != 0)].sum() / P[low & (n % k == 0)].sum())


def compiled(make, fs=1000.0):
    """A block for this sample rate, or what ``make`` makes."""
    made = make if isinstance(make, Block) else make()
    return stimlib.compile(Scene({"y": made}), fs, "python") if isinstance(made, Block) else made


def refuses(make, says, error=BadValue, fs=1000.0):
    """What ``make`` makes, or its processor, is refused: where and with what remedy."""
    refused(error, says, compiled, make, fs)
