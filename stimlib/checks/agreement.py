"""Agreement of two targets: JAX and the compiled processor.

They are compared decision by decision and sample by sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.scene import Scene
from ..errors import BadValue, public
from ..motion.source import positions, sources_of
from ..run.arguments import length
from ..run.processor import Processor, compile


@dataclass(frozen=True)
class Agreement:
    """The difference between JAX and the processor over one run, printed as one line.

    Attributes
    ----------
    error : dict of str to float
        Per output, the largest difference over the largest absolute value, given the
        processor's decisions.
    alone : dict of str to float
        The same with JAX's own decisions.
    decisions : int
        Decisions taken, all gates and comparisons of all samples together.
    differences : int
        How many of them are not the processor's.
    """

    error: dict[str, float]
    alone: dict[str, float]
    decisions: int
    differences: int

    @property
    def worst(self) -> float:
        """The largest error of all outputs, given the same decisions, or NaN."""
        return float(np.max([*self.error.values()]))

    def __str__(self):
        errors = ", ".join(f"{name} {v:.1e}" for name, v in self.error.items())
        return (
            f"{errors} of max given the same gates; {self.differences} of {self.decisions}"
            " decisions differ"
        )


@public
def agreement(
    scene: Scene,
    motion: Mapping[str, Any],
    fs: float,
    *,
    n: int | None = None,
    params: Mapping[str, float] | None = None,
    seed: int = 0,
    dtype: str = "float64",
) -> Agreement:
    """Compare the JAX target with the compiled processor over one run.

    Gates are discontinuous: where two roundings fall on different sides of a threshold,
    signals differ by whole steps. So decisions that differ are counted separately, and
    the signals are compared with JAX using the processor's decisions.

    Parameters
    ----------
    scene : Scene
    motion : dict of str to callable or ndarray
        Every input, as for ``stimlib.render``.
    fs : float
        In Hz.
    n : int, optional
        Samples; by default those of the shortest array.
    params : dict of str to float, optional
        Parameters from the first sample on.
    seed : int
        Of the run.
    dtype : {"float64", "float32"}

    Returns
    -------
    Agreement

    Raises
    ------
    BadValue, UnknownName
        Inputs missing, too short or not finite; parameters that the scene does not
        have; a run without samples.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib import Input, Scene, constant
    >>> x = Input("x", "m")
    >>> wall = constant(2000.0, "N/m") * x * (x > constant(0.005, "m"))
    >>> a = agreement(
    ...     Scene({"force": wall}), {"x": 0.01 * np.cos(np.arange(4000) / 400)}, fs=8000
    ... )
    >>> a.worst < 1e-12, a.differences
    (True, 0)
    """
    f = compile(scene, fs, "jax", seed, dtype=dtype)
    instances = f.program.instances
    deciding = [instances[int(g.split()[1])] for g in f.gates]
    conditions = [instances[q.args[0]].block if q.kind == "open" else q.block for q in deciding]
    probes = {f"gate_{i}_": condition > 0 for i, condition in enumerate(conditions)}
    proc = Processor(Scene({**scene.outputs, **probes}), fs, seed=seed)
    for name, value in (params or {}).items():
        proc.set(name, value, ramp=0.0)
    size = (
        n
        if n is not None
        else min((length(v) or 0 for v in motion.values() if not callable(v)), default=0)
    )
    if size < 1:
        raise BadValue("agreement: the run has no known length, or no samples; give n, at least 1")
    x = positions(
        sources_of({i: motion[i] for i in proc.inputs if i in motion}, proc.inputs, size),
        0,
        size,
        proc.fs,
    )
    y = dict(zip(proc.outputs, proc.process(x), strict=True))
    gates = {g: y[p] > 0 for g, p in zip(f.gates, probes, strict=True)}
    rows = dict(zip(proc.inputs, x, strict=True))
    inputs = {name: rows[name] for name in f.inputs}
    own = f.decisions(params, inputs, n=size)
    differences = sum(int(np.sum(np.asarray(own[g]) != gates[g])) for g in f.gates)

    def error(signals: Any) -> dict[str, float]:
        return {name: _relative(np.asarray(signals[name], float), y[name]) for name in f.outputs}

    alone = error(own)
    given = error(f(params, inputs, n=size, gates=gates)) if differences else alone
    return Agreement(given, alone, len(f.gates) * size, differences)


def _relative(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.max(np.abs(a - b)) / (np.max(np.abs(b)) or 1.0))
