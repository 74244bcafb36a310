"""Latency and frequency response of a whole program, from the forms that its blocks have."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import SceneError, UnknownName
from .graph import Const, Enabled, Map, Param, Pick, pack, unpack
from .program import Program


def backward(z: np.ndarray) -> np.ndarray:
    """1 - 1/z: at a low frequency 1/z is too near 1 to be subtracted.

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
    >>> bool(abs(backward(z) / 1e-12j - 1) < 1e-11), bool(abs((1 - 1 / z).real / backward(z).real - 1) < 0.1)
    (True, False)
    """
    z = np.asarray(z)
    s = np.where(np.abs(np.abs(z) - 1) < 1e-14, 1j * np.angle(z), np.log(z))  # rounding leaves the circle by 1e-16
    return -np.expm1(-s)


def _sources(program: Program) -> dict[str, int]:
    return program.inputs | program.noises


def latency(program: Program, design: list[tuple[Any, Any]]) -> dict[tuple[str, str], tuple[float, float]]:
    """(min, max) delay in samples over all paths from each source to each output.

    Along a path the delays of the blocks add up; inside ``enabled`` they count samples of its own clock.
    """
    found: dict[tuple[str, str], tuple[float, float]] = {}
    for source, start in _sources(program).items():
        span: dict[int, tuple[float, float]] = {start: (0.0, 0.0)}
        for i, q in enumerate(program.instances):
            ways = [span[a] for a in q.args if a in span]
            if ways and i != start:
                d = q.block.delay(design[i][0]) if q.kind == "block" else 0.0
                span[i] = min(w[0] for w in ways) + d, max(w[1] for w in ways) + d
        found |= {(name, source): span[i] for name, i in program.outputs.items() if i in span}
    return found


def response(
    program: Program, design: list[tuple[Any, Any]], fs: float, params: dict[str, float], output: str, source: str, f: np.ndarray
) -> np.ndarray:
    """Complex gain from a source to an output at f (Hz), with parameters as they stand: see ``Processor.response``."""
    for name, known in ((output, program.outputs), (source, _sources(program))):
        if name not in known:
            raise UnknownName(f"no {name!r}; there is {', '.join(known) or 'none'}")
    z = np.exp(2j * np.pi * f / fs)
    start = _sources(program)[source]
    H: dict[int, Any] = {start: np.ones_like(z)}  # of what the source reaches
    value: dict[int, float] = {}  # of what is constant
    on_the_way, goal = set(), [program.outputs[output]]
    while goal:
        i = goal.pop()
        if i not in on_the_way:
            on_the_way.add(i)
            goal += program.instances[i].args
    for i, q in enumerate(program.instances):
        if i == start or i not in on_the_way:
            continue
        b = q.block
        if isinstance(b, Const):
            value[i] = b.value
        elif isinstance(b, Param):
            value[i] = params[b.name]
        elif isinstance(b, Map) and not b.outputs and type(b).step is not None and q.args and all(a in value for a in q.args):
            p, s = (unpack(t, pack(t)) for t in design[i])  # numpy's numbers: a division by 0 is inf
            with np.errstate(all="ignore"):
                value[i] = float(type(b).step(p, s, *(np.float64(value[a]) for a in q.args))[0])  # type: ignore[misc]
        elif any(a in H for a in q.args):
            if isinstance(b, Enabled):
                raise SceneError(f"{b!r} on the way from {source!r} to {output!r} runs on its own clock: it has no response")
            if isinstance(b, Pick):
                H[i] = H[q.args[0]][b.place]
                continue
            parts = [H.get(a) for a in q.args]
            after = b.through(design[i][0], fs, z, parts, [value.get(a) for a in q.args])
            if after is None:
                raise SceneError(f"{b!r} on the way from {source!r} to {output!r} is not linear and time-invariant")
            H[i] = after
    return np.asarray(H.get(program.outputs[output], np.zeros_like(z)))
