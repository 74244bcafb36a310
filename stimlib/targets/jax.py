"""Whole signals at once, for batches and gradients: a scene as one pure function of JAX.

The program is the one that all targets run.  Each instance becomes an array over the samples of its clock (or a scalar where
it is the same at all of them): what is autonomous begins ``lead(fs)`` samples early, and a gated clock has as many samples as
could be enabled, of which the gate picks those that were.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..blocks.gate import Gate
from ..errors import BadValue, SceneError, UnknownName
from ..graph import AtLeast, Block, Const, Greater, Param
from ..lower import PARAMS, ROOT, Program, check_memory, lead, lower
from ..processor import rate
from .blockforms import LOWERINGS, Run, running, spread
from .recurrence import run_step

DTYPES = ("float64", "float32")


class Function:
    """signals = f(params, motion, key): pure, jitted; made by ``stimlib.compile(scene, fs, target="jax")``.

    Every transformation of JAX applies: ``jax.vmap`` over parameters, motions and keys, ``jax.grad`` with respect to parameters
    and motions.  Inside them JAX must be in 64-bit mode, as ``with jax.enable_x64(True):`` has it; called with plain numbers
    and arrays, f sees to that itself.

    Attributes
    ----------
    inputs, outputs : tuple of str
    params : dict of str to float
        Live numbers and their initial values.
    gates : tuple of str
        Names of what is 0 or 1: gates, comparisons and whether ``enabled`` is, on the sample clock and in running order; see
        ``decisions``.
    units : dict of str to str
    """

    def __init__(self, scene: Any, fs: float, seed: int = 0, dtype: str = "float64", surrogate: float | None = None):
        if dtype not in DTYPES:
            raise BadValue(f"dtype = {dtype!r}: choose one of {', '.join(DTYPES)}")
        if surrogate is not None and not surrogate > 0:
            raise BadValue(f"surrogate = {surrogate!r} must be above 0, or None for gates whose derivative is 0")
        self.scene, self.fs, self.seed, self.dtype, self.surrogate = scene, rate(fs), seed, dtype, surrogate
        self.program: Program = lower(scene.outputs)
        self.design = [q.block.design(self.fs) if q.kind == "block" else ((), ()) for q in self.program.instances]
        check_memory(self.program, self.design, self.fs)
        instances = self.program.instances
        for q in instances:
            if q.kind == "block" and not isinstance(q.block, Param):
                _lowering(q.block)
        self.inputs, self.outputs = tuple(self.program.inputs), tuple(self.program.outputs)
        self.params = {n: instances[i].block.value for n, i in self.program.params.items()}  # type: ignore[attr-defined]
        self._decisions = {
            f"gate {i}": i
            for i, q in enumerate(instances)
            if q.clock == ROOT and (q.kind == "open" or isinstance(q.block, (Gate, Greater, AtLeast)))
        }
        self.gates = tuple(self._decisions)
        self.units = {n: str(instances[i].block.dim) for g in (self.program.inputs, self.program.params) for n, i in g.items()}
        self.units |= {n: str(b.dim) for n, b in scene.outputs.items()}
        self._jitted = jax.jit(self._signals, static_argnames=("n", "wanted"))

    def __repr__(self):
        return f"Function({', '.join(self.inputs) or 'no input'} -> {', '.join(self.outputs)}, fs={self.fs:g}, {self.dtype})"

    def __call__(self, params=None, motion=None, key=None, *, n: int | None = None, gates=None) -> dict[str, Any]:
        """The signals of a whole run.

        Parameters
        ----------
        params : dict of str to scalar or array (n,)
            Live numbers by name, in their units; those not given have their initial values.  An array is one value per
            sample; before sample 0 its first value holds.
        motion : dict of str to array (n,), or array (n_inputs, n)
            Every input, in its unit.
        key : int
            Of all noise of this run, as ``seed`` of ``stimlib.compile``.
        n : int
            Samples, for a scene without inputs.
        gates : dict of str to array (n,)
            Decisions to take instead of the function's own, by the names of ``gates``: those of another run.

        Returns
        -------
        dict of str to array (n,)
            Each output; numpy's where JAX is in 32-bit mode and its own arrays would lose digits.

        Raises
        ------
        UnknownName
            A name that the scene does not have.
        BadValue
            Arrays of different lengths, or JAX in 32-bit mode inside a transformation.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> x, k = stimlib.Input("x", "m"), stimlib.Param("k", 2000.0, "N/m")
        >>> f = stimlib.compile(stimlib.Scene({"force": k * x}), fs=8000, target="jax")
        >>> f({"k": 100.0}, {"x": np.array([0.0, 0.01])})["force"]
        array([0., 1.])
        """
        return self._call(params, motion, key, n, gates, self.outputs)

    def decisions(self, params=None, motion=None, key=None, *, n: int | None = None) -> dict[str, Any]:
        """As a call, with what the gates and comparisons say besides: rows of 0 and 1 by the names of ``gates``."""
        return self._call(params, motion, key, n, None, self.outputs + self.gates)

    def _call(self, params, motion, key, n, gates, wanted):
        params, motion, gates = dict(params or {}), self._rows(motion), dict(gates or {})
        for what, given, known in (
            ("live number", params, self.params), ("input", motion, self.inputs), ("gate", gates, self.gates),
        ):  # fmt: skip
            for name in given:
                if name not in known:
                    raise UnknownName(f"no {what} {name!r}; this scene has {', '.join(known) or 'none'}")
        for name in self.inputs:
            if name not in motion:
                raise UnknownName(f"the motion lacks the input {name!r}")
        key = self.seed if key is None else key
        if isinstance(key, (int, np.integer)):
            if not 0 <= key < 2**64:
                raise BadValue(f"key = {key} must be a whole number from 0 to 2**64 - 1")
            key = np.uint64(key)
        elif np.ndim(key) or not jnp.issubdtype(jnp.result_type(key), jnp.integer):
            raise BadValue(f"key = {key!r} must be a whole number; for many runs, map over keys with jax.vmap")
        lengths = {np.shape(v)[-1] for v in [*motion.values(), *gates.values(), *params.values()] if np.ndim(v)}
        if n is not None:
            lengths.add(n)
        if len(lengths) != 1:
            raise BadValue(
                f"motion, live numbers and gates must have one length, got {sorted(lengths) or 'none'}"
                + ("" if lengths else ": say n, the number of samples")
            )
        (size,) = lengths
        if not size:
            return {name: jnp.zeros(0, self.dtype) for name in wanted}
        with_defaults = self.params | params
        if any(isinstance(v, jax.core.Tracer) for v in jax.tree.leaves((with_defaults, motion, key, gates))):
            if not jax.config.read("jax_enable_x64"):
                raise BadValue(
                    "JAX is in 32-bit mode, which would lose the motion's digits: put the transformation inside "
                    "'with jax.enable_x64(True):', or say jax.config.update('jax_enable_x64', True) first"
                )
            return self._jitted(with_defaults, motion, key, gates, n=size, wanted=wanted)
        if jax.config.read("jax_enable_x64"):
            return self._jitted(with_defaults, motion, key, gates, n=size, wanted=wanted)
        with jax.enable_x64(True):
            signals = self._jitted(with_defaults, motion, key, gates, n=size, wanted=wanted)
            return {name: np.asarray(v) for name, v in signals.items()}  # JAX's own would lose half their digits outside

    def _rows(self, motion: Any) -> dict[str, Any]:
        if motion is None:
            return {}
        if isinstance(motion, Mapping):
            return dict(motion)
        if np.ndim(motion) != 2 or np.shape(motion)[0] != len(self.inputs):
            raise BadValue(
                f"motion must be a dict by input name or an array ({len(self.inputs)}, n), got shape {np.shape(motion)}"
            )
        return {name: motion[i] for i, name in enumerate(self.inputs)}

    # The program -------------------------------------------------------------------------------------------------
    def _signals(self, params, motion, key, gates, n, wanted):
        instances, early = self.program.instances, lead(self.fs)
        key = jnp.asarray(key).astype(jnp.uint64)
        value: dict[int, Any] = {}
        total = {ROOT: early + n}  # samples of each clock, with those before its sample 0
        opened: dict[int, Any] = {}  # gate of each enabled clock, over its parent's samples
        place: dict[int, Any] = {}
        parents = self.program.parents

        def row(param: Any, clock: int) -> Any:
            """A live number given per sample, on a clock."""
            if clock == ROOT:
                return jnp.concatenate([jnp.broadcast_to(param[0], (early,)), param])
            above = row(param, parents[clock])
            by = opened[clock]
            if clock not in place:
                place[clock] = jnp.nonzero(by, size=by.shape[0], fill_value=by.shape[0] - 1)[0]
            return jnp.concatenate([jnp.broadcast_to(param[0], (early,)), above[above.shape[0] - by.shape[0] :][place[clock]]])

        for i, q in enumerate(instances):
            clock = max(q.clock, ROOT)
            size = total.get(clock, 0) if q.autonomous else n
            if q.kind == "input":
                value[i] = jnp.asarray(motion[q.block.name], jnp.float64)  # type: ignore[attr-defined]
                continue
            if isinstance(q.block, Const):
                value[i] = np.float64(q.block.value)
                continue
            if isinstance(q.block, Param):
                value[i] = jnp.asarray(params[q.block.name], jnp.float64)
                continue
            if q.kind == "close":
                by, inside = opened[q.child], value[q.args[1]]
                if jnp.ndim(inside):
                    inside = inside[early + running(by)]
                value[i] = jnp.where(by, inside, 0.0)
                continue
            x = []
            for a in q.args:
                v = value[a]
                if jnp.ndim(v) and instances[a].clock == PARAMS:
                    v = row(v, clock)
                x.append(v[v.shape[0] - size :] if jnp.ndim(v) else v)
            given = gates.get(f"gate {i}")
            if q.kind == "open":
                by = spread(jnp.asarray(x[0]) > 0, size)
                opened[q.child] = by if given is None else jnp.concatenate([by[: size - n], jnp.asarray(given) > 0])
                total[q.child] = early + size
                value[i] = opened[q.child].astype(jnp.float64)
                continue
            if given is not None:
                value[i] = jnp.concatenate([jnp.zeros(size - n), jnp.asarray(given, jnp.float64)])
                continue
            run = Run(size, self.fs, key, jnp.dtype(self.dtype), self.surrogate)
            p, s = self.design[i]
            value[i] = _run_block(q.block, p, s, x, run)
        named = self.program.outputs | self._decisions
        return {name: _tail(value[named[name]], n) for name in wanted}


def _tail(v: Any, n: int) -> Any:
    return v[v.shape[0] - n :] if jnp.ndim(v) else spread(jnp.asarray(v), n)


def _lowering(b: Block) -> Any:
    """A class's own function, or None where its step serves."""
    for c in type(b).__mro__:
        if c in LOWERINGS:
            return LOWERINGS[c]
        if c.__dict__.get("start") and c is not Block:
            raise SceneError(f"{b!r}: {c.__name__} has a start of its own and needs a lowering for JAX; see blockforms.LOWERINGS")
    if type(b).step is None:
        raise SceneError(f"{b!r}: {type(b).__name__} has only a tile and needs a lowering for JAX; see blockforms.LOWERINGS")
    return None


def _run_block(b: Block, p: Any, s: Any, x: list[Any], run: Run) -> Any:
    f = _lowering(b)
    if f is not None:
        return f(b, p, s, x, run)
    y = run_step(type(b).step, p, s, x, run.n)  # type: ignore[arg-type]
    return y if jnp.ndim(y) or not len(s) else spread(y, run.n)
