"""Latency and frequency response of a program, from those of its blocks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import SceneError, need
from .clocks import Instance
from .graph import Block, Const, Map, Pick, pack, unpack
from .loop_code import Cycle
from .parameter import Param
from .program import Program
from .subsystems import Subsystem


def backward(z: np.ndarray) -> np.ndarray:
    """Return the response of a backward difference, 1 - 1/z, accurately near z = 1.

    At low frequencies 1/z is too near 1 to be subtracted.

    Parameters
    ----------
    z : ndarray of complex
        On the unit circle, as exp(i w), or well beside it.

    Returns
    -------
    ndarray of complex

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.core.response import backward
    >>> z = np.exp(1e-12j)
    >>> (
    ...     bool(abs(backward(z) / 1e-12j - 1) < 1e-11),
    ...     bool(abs((1 - 1 / z).real / backward(z).real - 1) < 0.1),
    ... )
    (True, False)
    """
    z = np.asarray(z)
    # rounding leaves the circle by 1e-16
    s = np.where(np.abs(np.abs(z) - 1) < 1e-14, 1j * np.angle(z), np.log(z))
    return -np.expm1(-s)


def _sources(program: Program) -> dict[str, int]:
    return program.inputs | program.noises


def latency(
    program: Program, design: list[tuple[Any, Any]]
) -> dict[tuple[str, str], tuple[float, float]]:
    """Return the (min, max) delay in samples from each source to each output.

    Minimum and maximum are over all paths.

    Along a path the delays of the blocks add up; inside ``enabled`` they count samples
    of its own clock. Around a loop there is no longest path, so only the paths with the
    fewest passes through its last value count; each pass is one sample.
    """
    found: dict[tuple[str, str], tuple[float, float]] = {}
    instances = program.instances
    for source, start in _sources(program).items():
        span: dict[int, Any] = {start: (0.0, 0.0)}
        for i, q in enumerate(instances):
            ways = [span[a] for a in q.args if a in span]
            if ways and i != start:
                y = (
                    span[q.args[0]][q.block.output_index]
                    if isinstance(q.block, Pick)
                    else _span(q, design[i], [span.get(a) for a in q.args])
                )
                span |= {} if y is None else {i: y}
        found |= {(name, source): span[i] for name, i in program.outputs.items() if i in span}
    return found


Span = tuple[float, float] | None


def _span(q: Instance, design: tuple[Any, Any], ways: list[Span]) -> Any:
    """Return the (min, max) delay behind a block, or a tuple for several outputs."""
    b = q.block
    if isinstance(b, Cycle):
        known = {f"x{j}": way for j, way in enumerate(ways) if way}
        parts = b.parts(*design)

        def behind(m: Block, k: int, args: tuple[str, ...]) -> Any:
            return _behind(m, m.delay(parts[k][0]), [known.get(a) for a in args])

        for _ in range(len(b.ends) + 1):
            b.walk(known, behind)
            for j, end in enumerate(b.ends):
                if end in known:
                    known.setdefault(f"last{j}", _behind(b, 1.0, [known[end]]))
        found = tuple(known.get(r) for r in b.results)
        return found if b.outputs else found[0]
    return _behind(b, b.delay(design[0]) if q.kind == "block" else 0.0, ways)


def _behind(b: Block, delay: float, ways: list[Span]) -> Any:
    # a first value that is held never answers what comes later
    there = [w for w in ways if w and w[0] < np.inf]
    span = (min(w[0] for w in there) + delay, max(w[1] for w in there) + delay) if there else None
    return (span,) * len(b.outputs) if b.outputs and there and not isinstance(b, Cycle) else span


def response(
    program: Program,
    design: list[tuple[Any, Any]],
    fs: float,
    params: Mapping[str, float],
    output: str,
    source: str,
    f: np.ndarray,
    steepest: bool = False,
) -> np.ndarray:
    """Return the complex gain from a source to an output at f (Hz).

    Parameters have the values of ``params``; see ``Processor.response``.

    With ``steepest``, nonlinear blocks are replaced by the stiffest linear block that
    bounds them, where this is known.
    """
    need("response", [output], program.outputs, "output")
    need("response", [source], _sources(program), "input or source")
    z = np.exp(2j * np.pi * f.ravel() / fs)
    start = _sources(program)[source]
    H: dict[int, Any] = {start: np.ones_like(z)}  # of what the source reaches
    value: dict[int, float] = {}  # of what is constant
    on_the_way, goal = set(), [program.outputs[output]]
    while goal:
        i = goal.pop()
        if i not in on_the_way:
            on_the_way.add(i)
            goal += program.instances[i].args
    for i in sorted(on_the_way - {start}):
        b, args = program.instances[i].block, program.instances[i].args
        parts, numbers = [H.get(a) for a in args], [value.get(a) for a in args]
        number = _value(b, design[i], params, numbers)
        if number is not None:
            value[i] = number
        elif isinstance(b, Pick) and args[0] in H:
            H[i] = H[args[0]][b.output_index]
        elif any(a in H for a in args):
            where = f"{b!r} on the way from {source!r} to {output!r}"
            if isinstance(b, Subsystem):
                raise SceneError(f"{where} runs on its own clock, so it has no response")
            after = (
                _around(b, b.parts(*design[i]), fs, z, parts, numbers)
                if isinstance(b, Cycle)
                else b.through(design[i][0], fs, z, parts, numbers)
            )
            if after is None and steepest:
                after = b.steepest(fs, z, parts, numbers)
            if after is None:
                raise SceneError(f"{where} is not linear and time-invariant")
            H[i] = after
    return np.reshape(H.get(program.outputs[output], np.zeros_like(z)), f.shape)


def _value(
    b: Block, design: tuple[Any, Any], params: Mapping[str, float], signals: list[float | None]
) -> float | None:
    """Return the output of a block whose signals are all constant, or None."""
    if isinstance(b, Const):
        return b.value
    if isinstance(b, Param):
        return params[b.name]
    step = type(b).step if isinstance(b, Map) and not b.outputs else None
    if step is None or not signals or None in signals:
        return None
    # numpy's numbers: a division by 0 is inf
    p, s = (unpack(t, pack(t)) for t in design)
    with np.errstate(all="ignore"):
        return float(step(p, s, *map(np.float64, signals))[0])


def _around(
    b: Cycle, parts: list[Any], fs: float, z: np.ndarray, H: list[Any], value: list[float | None]
) -> Any:
    """Return the response of a loop, or None if the loop is not linear.

    The signals that it feeds back are F + G last, and last is that signal over z: (z -
    G) last = F.
    """
    numbers = {f"c{j}": c for j, c in enumerate(b.constants)} | {
        f"x{j}": c for j, c in enumerate(value)
    }
    curved = []

    def run(signal: dict[str, Any]) -> list[Any]:
        def through(m: Block, k: int, args: tuple[str, ...]) -> Any:
            hs = [signal.get(a) for a in args]
            y = (
                None
                if all(h is None for h in hs)
                else m.through(parts[k][0], fs, z, hs, [numbers.get(a) for a in args])
            )
            curved.extend([m] if y is None and any(h is not None for h in hs) else [])
            return y

        b.walk(signal, through)
        return [np.broadcast_to(signal.get(name, 0.0), z.shape) for name in (*b.ends, *b.results)]

    count = len(b.ends)
    outer = np.array(run({f"x{j}": h for j, h in enumerate(H) if h is not None}))
    # [last, end or result, frequency]
    own = np.array([run({f"last{j}": np.ones_like(z)}) for j in range(count)])
    if curved:
        return None
    A = z[:, None, None] * np.eye(count) - own[:, :count].transpose(2, 1, 0)
    try:
        last = np.linalg.solve(A, outer[:count].T[..., None])[..., 0].T
    except np.linalg.LinAlgError:
        raise SceneError(
            f"{b!r} has no response at one of these frequencies: it grows without limit there"
        ) from None
    y = outer[count:] + np.einsum("lrf,lf->rf", own[:, count:], last)
    return tuple(y) if b.outputs else y[0]
