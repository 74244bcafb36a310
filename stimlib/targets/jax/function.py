"""A scene as one pure function of whole signals, for batches and gradients.

The program is the one that all targets run.  Each instance becomes an array over the
samples of its clock (or a scalar where it is the same at all of them): what is
autonomous begins ``lead(fs)`` samples early, and a gated clock has as many samples as
could be enabled, of which the gate picks those that were. A segment has its own samples
alone, or none where a run ends before.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Collection, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...blocks.impedance import Gate
from ...core.clocks import PARAMS, ROOT, Instance
from ...core.graph import Block, Compare, Const, bare
from ...core.loop_code import Cycle
from ...core.parameter import Param
from ...core.program import lead, prepare, rate, warn_beyond
from ...core.subsystems import Segment
from ...errors import BadValue, SceneError, UnknownName, need, one_of
from ...system.limits import limits
from .blockforms import LOWERINGS, Run, latest, running, spread, steady
from .recurrence import run_step

DTYPES = ("float64", "float32")
OPTIONS = ("dtype", "surrogate")
"""Of ``stimlib.compile(scene, fs, target="jax")``."""


class Function:
    """A pure, jitted function signals = f(params, motion, key) of a scene.

    ``stimlib.compile(scene, fs, target="jax")`` makes it.

    Every transformation of JAX applies: ``jax.vmap`` over parameters, motions and keys,
    ``jax.grad`` with respect to parameters and motions. Inside them JAX must be in
    64-bit mode, as in ``with jax.enable_x64(True):``; called with plain numbers and
    arrays, f does this itself.

    Numbers below 2.3e-308 count as 0, as always in JAX, also in comparisons: a
    ``contact`` of 5e-324 is no contact here.

    Attributes
    ----------
    inputs, outputs : tuple of str
    params : dict of str to float
        Parameters and their initial values.
    gates : tuple of str
        Names of what is 0 or 1: gates, comparisons and whether ``enabled`` is, on the
        sample clock and in running order; see ``decisions``.
    units : dict of str to str
    """

    def __init__(
        self,
        scene: Any,
        fs: float,
        seed: int = 0,
        dtype: str = "float64",
        surrogate: float | None = None,
    ):
        one_of("dtype", dtype, DTYPES)
        if surrogate is not None and not (
            isinstance(surrogate, (int, float)) and 0 < surrogate < math.inf
        ):
            raise BadValue(
                f"surrogate = {surrogate!r} must be a number above 0, or None for gates whose"
                " derivative is 0"
            )
        self.scene, self.fs, self.dtype, self.surrogate = scene, rate(fs), dtype, surrogate
        self.seed = int(_key("seed", seed))
        self.program, self.design, _ = prepare(scene, self.fs)
        instances = self.program.instances
        for instance in instances:
            if instance.kind == "block" and not isinstance(instance.block, Param):
                _lowering(instance.block)
        self.inputs, self.outputs = tuple(self.program.inputs), tuple(self.program.outputs)
        self.params = {
            name: instances[index].block.value  # type: ignore[attr-defined]
            for name, index in self.program.params.items()
        }
        self._decisions = {
            f"gate {index}": index
            for index, instance in enumerate(instances)
            if instance.clock == ROOT
            and (
                isinstance(instance.block, (Gate, Compare))
                or (instance.kind == "open" and not isinstance(instance.block, Segment))
            )
        }
        self.gates = tuple(self._decisions)
        given = self.program.inputs | self.program.params
        blocks = {name: instances[i].block for name, i in given.items()} | scene.outputs
        self.units = {name: str(block.dim) for name, block in blocks.items()}
        self._jitted = jax.jit(self._signals, static_argnames=("n", "wanted"))

    def __repr__(self):
        return (
            f"Function({', '.join(self.inputs) or 'no input'} -> {', '.join(self.outputs)},"
            f" fs={self.fs:g}, {self.dtype})"
        )

    def __call__(
        self, params=None, motion=None, key=None, *, n: int | None = None, gates=None
    ) -> dict[str, Any]:
        """Return the signals of a whole run.

        Parameters
        ----------
        params : dict of str to scalar or array (n,)
            Parameters by name, in their units; those not given have their initial
            values.  An array is one value per sample; before sample 0 its first value
            holds.
        motion : dict of str to array (n,) or scalar, or array (n_inputs, n)
            Every input, in its unit.  A scalar holds throughout.
        key : int
            Of all noise of this run, as ``seed`` of ``stimlib.compile``.
        n : int
            Samples, where the length of no array is it.
        gates : dict of str to array (n,)
            Decisions to take instead of the function's own, by the names of ``gates``:
            those of another run.

        Returns
        -------
        dict of str to array (n,)
            Each output; numpy's where JAX is in 32-bit mode and its own arrays would
            lose digits.  From the first sample on that is not finite, an output fades
            as that of the processor does.

        Warns
        -----
        RuntimeWarning
            The run is longer than the horizon of a springpot.

        Raises
        ------
        UnknownName
            A name that the scene does not have, or an input that is missing.
        BadValue
            What is not real numbers; arrays of different lengths or of more than one
            dimension; a parameter that is not finite; a key outside 0 .. 2**64 - 1; JAX
            in 32-bit mode inside a transformation.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> x, k = stimlib.Input("x", "m"), stimlib.Param("k", 2000.0, "N/m")
        >>> f = stimlib.compile(stimlib.Scene({"force": k * x}), fs=8000, target="jax")
        >>> f({"k": 100.0}, {"x": np.array([0.0, 0.01])})["force"]
        array([0., 1.])
        """
        return self._call(params, motion, key, n, gates, self.outputs)

    def decisions(
        self, params=None, motion=None, key=None, *, n: int | None = None
    ) -> dict[str, Any]:
        """Return the signals of a call, and the results of gates and comparisons.

        The results are rows of 0 and 1 by the names of ``gates``.
        """
        return self._call(params, motion, key, n, None, self.outputs + self.gates)

    def _call(self, params, motion, key, n, gates, wanted):
        wide = jax.config.read("jax_enable_x64")
        if not wide and _traced((params, motion, key, gates)):
            raise BadValue(NARROW)
        # or an accelerator multiplies float32 with ten bits, or seven
        with (
            jax.enable_x64(True),
            jax.default_matmul_precision("highest"),
            np.errstate(all="ignore"),  # of numbers that are known
        ):
            if motion is not None and not isinstance(motion, Mapping):
                motion, n = self._rows(motion, n)
            params = _named("params", "parameter", params, self.params)
            motion = _named("motion", "input", motion, self.inputs)
            gates = _named("gates", "gate", gates, self.gates)
            for name in self.inputs:
                if name not in motion:
                    raise UnknownName(f"the motion lacks the input {name!r}")
            motion = {name: _real(f"input {name!r}", v) for name, v in motion.items()}
            gates = {name: _real(name, v) for name, v in gates.items()}
            params = {
                name: _finite(f"parameter {name!r}", v)
                for name, v in (self.params | params).items()
            }
            key = _key("key", self.seed if key is None else key)
            size = _length({**motion, **params, **gates}, n)
            limits.check("render_bytes", 8 * size * len(wanted), f"bytes of {size} samples")
            warn_beyond(self.program, self.fs, size)
            if size:
                signals = self._jitted(params, motion, key, gates, n=size, wanted=wanted)
            else:
                signals = {name: jnp.zeros(0, self.dtype) for name in wanted}
        if wide:
            return signals
        if _traced(signals):  # by a transformation of what does not reach f
            raise BadValue(NARROW)
        # JAX's own would lose half their digits outside
        return {name: np.asarray(v) for name, v in signals.items()}

    def _rows(self, motion: Any, n: Any) -> tuple[dict[str, Any], Any]:
        if not isinstance(motion, jax.Array):
            motion = _array("motion", motion)
        if motion.ndim != 2 or motion.shape[0] != len(self.inputs):
            raise BadValue(
                f"motion must be a dict by input name or an array ({len(self.inputs)}, n), got"
                f" shape {motion.shape}"
            )
        return dict(zip(self.inputs, motion, strict=True)), motion.shape[1] if n is None else n

    def _signals(self, params, motion, key, gates, n, wanted):
        run = _Signals(self, params, motion, key, gates, n)
        for i in range(len(self.program.instances)):
            run.add(i)
        named = self.program.outputs | self._decisions
        return {name: _tail(run.value[named[name]], n) for name in wanted}


# The program --------------------------------------------------------------------------
class _Signals:
    """The signals of all instances of a program in one run, in running order."""

    def __init__(self, f: Function, params: Any, motion: Any, key: Any, gates: Any, n: int):
        self.f, self.params, self.motion, self.key, self.gates = f, params, motion, key, gates
        self.n, self.early = n, lead(f.fs)
        self.instances, self.parents = f.program.instances, f.program.parents
        self.value: dict[int, Any] = {}
        # samples of each clock, with those before its sample 0
        self.total = {ROOT: self.early + n}
        # gate of each enabled clock, over its parent's samples, and where it is 1
        self.opened: dict[int, Any] = {}
        self.ticks: dict[int, Any] = {}
        # of each segment's clock, in its parent's samples from sample 0 on
        self.span: dict[int, tuple[int, int]] = {}
        self.silent: set[int] = set()  # clocks that have no sample in this run

    def row(self, param: Any, clock: int) -> Any:
        """Return a parameter given per sample, as samples of a clock."""
        if clock == ROOT:
            here = param
        elif clock in self.span:
            above = self.row(param, self.parents[clock])
            here = above[self.early :][slice(*self.span[clock])]
        else:
            above, by = self.row(param, self.parents[clock]), self.opened[clock]
            size = by.shape[0]
            if clock not in self.ticks:
                self.ticks[clock] = jnp.nonzero(by, size=size, fill_value=size - 1)[0]
            here = above[above.shape[0] - size :][self.ticks[clock]]
        return jnp.concatenate([jnp.broadcast_to(param[0], (self.early,)), here])

    def signal(self, source: int, clock: int) -> Any:
        """Return an instance's signal on a clock."""
        signal = self.value[source]
        if jnp.ndim(signal) and self.instances[source].clock == PARAMS:
            return self.row(signal, clock)
        if self.instances[source].kind == "input" and clock != ROOT:  # only segments have inputs
            return self.signal(source, self.parents[clock])[slice(*self.span[clock])]
        return signal

    def add(self, index: int) -> None:
        """Compute an instance's signal, or the samples of a clock that it opens."""
        instance = self.instances[index]
        clock = max(instance.clock, ROOT)
        if clock in self.silent:
            self.silent.add(instance.child)
            return
        size = self.total.get(clock, 0) - (0 if instance.autonomous else self.early)
        block: Any = instance.block
        if instance.kind == "input":
            self.value[index] = spread(self.motion[block.name], self.n)
        elif isinstance(block, Const):
            self.value[index] = np.float64(block.value)
        elif isinstance(block, Param):
            self.value[index] = self.params[block.name]
        elif instance.kind == "pick":
            self.value[index] = self.value[instance.args[0]][block.output_index]
        elif isinstance(block, Segment) and instance.kind == "open":
            numbers = self.f.design[instance.args[0]][0]
            first, end = self.span[instance.child] = (
                int(min(numbers.first, size)),
                int(min(numbers.end, size)),
            )
            self.total[instance.child] = self.early + end - first
            if first == end:
                self.silent.add(instance.child)
        elif instance.kind == "close":
            self.value[index] = self.closed(instance, size)
        else:
            self.value[index] = self.computed(index, clock, size)

    def closed(self, instance: Instance, size: int) -> Any:
        """Return the signal inside a child clock, and 0 elsewhere."""
        if instance.child in self.silent:
            return jnp.zeros(size)
        if isinstance(instance.block, Segment):
            first, end = self.span[instance.child]
            return jnp.pad(
                _tail(self.signal(instance.args[1], instance.child), end - first),
                (first, size - end),
            )
        by, inside = self.opened[instance.child], self.signal(instance.args[1], instance.child)
        if jnp.ndim(inside):
            inside = inside[self.early * self.instances[instance.args[1]].autonomous + running(by)]
        return jnp.where(by, inside, 0.0)

    def computed(self, index: int, clock: int, size: int) -> Any:
        """Return the output of a block, or the gate of a child clock.

        A given decision replaces the computed one.
        """
        instance, n, signals = self.instances[index], self.n, []
        for source in instance.args:
            signal = self.signal(source, clock)
            signals.append(signal[signal.shape[0] - size :] if jnp.ndim(signal) else signal)
        given = self.gates.get(f"gate {index}")
        if instance.kind == "open":
            by = spread(jnp.asarray(signals[0]) > 0, size)
            if given is not None:
                by = jnp.concatenate([by[: size - n], spread(given > 0, n)])
            self.opened[instance.child], self.total[instance.child] = by, self.early + size
            return by.astype(jnp.float64)
        if given is not None:
            return jnp.concatenate([jnp.zeros(size - n), spread(given, n)])
        owner, seed = self.f, self.f.program.seeds[clock]
        key = self.key if seed is None else np.uint64(seed)
        run = Run(size, owner.fs, key, jnp.dtype(owner.dtype), owner.surrogate)
        return _run_block(instance.block, *owner.design[index], signals, run)


# What is given ------------------------------------------------------------------------
NARROW = (
    "JAX is in 32-bit mode, which would lose the motion's digits: put the transformation inside "
    "'with jax.enable_x64(True):', or call jax.config.update('jax_enable_x64', True) first"
)


def _traced(values: Any) -> bool:
    return any(isinstance(v, jax.core.Tracer) for v in jax.tree.leaves(values))


def _named(what: str, one: str, given: Any, known: Collection[str]) -> dict[str, Any]:
    """Return a dict after checking that all its names are known."""
    if given is not None and not isinstance(given, Mapping):
        raise BadValue(f"{what} must be a dict by name, got {type(given).__name__}")
    need(what, given or (), known, one)
    return dict(given or {})


def _array(what: str, v: Any) -> np.ndarray:
    try:
        a = np.asarray(bare(v))
    except ValueError:
        a = np.array(None)
    if a.dtype.kind not in "biuf":
        remedy = "; sample it, at np.arange(n)/fs" if callable(v) else ""
        raise BadValue(
            f"{what} must be real numbers, got"
            f" {type(v).__name__ if a.dtype.kind in 'OUS' else a.dtype}{remedy}"
        )
    return a


def _real(what: str, v: Any) -> Any:
    """Return a number, or a row of numbers, as float64.

    Other types would cause f to be compiled again.
    """
    if not isinstance(v, jax.Array):
        v = _array(what, v)
    elif not (
        jnp.issubdtype(v.dtype, jnp.floating)
        or jnp.issubdtype(v.dtype, jnp.integer)
        or v.dtype == jnp.bool_
    ):
        raise BadValue(f"{what} must be real numbers, got {v.dtype}")
    if v.ndim > 1:
        raise BadValue(
            f"{what} must be one number or a row (n,), got shape {v.shape}; for many runs use"
            " jax.vmap"
        )
    return v.astype(np.float64)


def _finite(what: str, v: Any) -> Any:
    """Return finite numbers as ``_real`` does; raise BadValue for others.

    Only values that are known, not traced, are checked.
    """
    v = _real(what, v)
    if not _traced(v) and not np.isfinite(v).all():
        at = f" at sample {int(np.argmin(np.isfinite(v)))}" if v.ndim else ""
        raise BadValue(f"{what} is not finite{at}")
    return v


def _key(what: str, key: Any) -> Any:
    """Return the key of a run as uint64."""
    if isinstance(key, jax.core.Tracer):
        if key.ndim or not jnp.issubdtype(key.dtype, jnp.integer):
            raise BadValue(
                f"{what} must be a whole number, got {key.dtype} of shape {key.shape}; for many"
                " runs use jax.vmap"
            )
        return key.astype(np.uint64)
    try:
        number = operator.index(key)
    except TypeError:
        raise BadValue(
            f"{what} = {key!r} must be a whole number; for many runs use jax.vmap"
        ) from None
    if not 0 <= number < 2**64:
        raise BadValue(f"{what} = {number} must be a whole number from 0 to 2**64 - 1")
    return np.uint64(number)


def _length(rows: Mapping[str, Any], n: Any) -> int:
    """Return the number of samples of a run."""
    if n is not None and (isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 0):
        raise BadValue(f"n = {n!r} must be a whole number of samples, at least 0")
    lengths = {name: v.shape[0] for name, v in rows.items() if v.ndim} | (
        {} if n is None else {"n": int(n)}
    )
    if not lengths:
        raise BadValue("the length of the run is not known: give n, the number of samples")
    if len(set(lengths.values())) > 1:
        given = ", ".join(f"{name}: {size}" for name, size in lengths.items())
        raise BadValue(f"motion, parameters and gates must have one length, got {given}")
    return next(iter(lengths.values()))


# Blocks -------------------------------------------------------------------------------
def _tail(v: Any, n: int) -> Any:
    return v[v.shape[0] - n :] if jnp.ndim(v) else spread(jnp.asarray(v), n)


def _lowering(b: Block) -> Any:
    """Return the whole-signal implementation of a block, or None if its step serves."""
    if isinstance(b, Cycle):
        for m in b.members:
            if m.definition.step is None or type(m).start is not Block.start:
                raise SceneError(
                    f"{m!r} is inside a loop, where JAX runs steps, and has only a tile, or a start"
                    " of its own; move it out of the loop"
                )
        return None
    for c in type(b).__mro__:
        if c in LOWERINGS:
            return LOWERINGS[c]
        if c.__dict__.get("start") and c is not Block:
            raise SceneError(
                f"{b!r}: {c.__name__} has a start of its own and needs a lowering for JAX; see"
                " blockforms.LOWERINGS"
            )
    if type(b).step is None:
        raise SceneError(
            f"{b!r}: {type(b).__name__} has only a tile and needs a lowering for JAX; see"
            " blockforms.LOWERINGS"
        )
    return None


def _run_block(b: Block, p: Any, s: Any, x: list[Any], run: Run) -> Any:
    f = _lowering(b)
    if f is not None:
        return f(b, p, s, x, run)
    contact: tuple = ()
    if b.resettable and steady(x[-1]):
        contact = True, s.cold
    elif b.resettable:
        on = spread(jnp.asarray(x[-1]) > 0, run.n)
        contact = on, s.cold if s.cold == 1.0 else jnp.where(latest(on) < 0, s.cold, 1.0)
    y = run_step(b.definition.step, p, s, x[:-1] if b.resettable else x, run.n, contact)
    full = [
        v if jnp.ndim(v) or not len(s) else spread(v, run.n)
        # of a comparison or a whole number, the float that it is to the interpreter
        for v in (
            v if jnp.issubdtype(jnp.result_type(v), jnp.floating) else jnp.float64(v)
            for v in (y if b.outputs else (y,))
        )
    ]
    return tuple(full) if b.outputs else full[0]
