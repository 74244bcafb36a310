"""The processor: a compiled scene, as devices, files and verification use it."""

from __future__ import annotations

import hashlib
import logging
import math
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, overload

import numpy as np

from ..core.clocks import PARAMS
from ..core.graph import kind, pack, reach
from ..core.parameter import Param
from ..core.program import (
    Program,
    lead,
    number,
    prepare,
    program_of,
    rate,
)
from ..core.steps import ours
from ..errors import BadValue, SceneError, StimlibError, need, one_of, public
from ..system.cache_folder import lock
from ..system.packages import package
from .arguments import columns, explain, key
from .many import Copies
from .plan import Plan, plan_of

if TYPE_CHECKING:
    from ..core.scene import Scene
    from ..targets.jax.function import Function

logger = logging.getLogger(__name__)
TARGETS = ("llvm", "python", "jax")
EARLY = 2**16  # samples before sample 0 that are run at once: an interrupt acts between
LONGEST = 2**62
"""Samples of the longest run."""


class Change(NamedTuple):
    """A call of ``Processor.set``, which takes effect from sample ``at`` on."""

    at: int
    name: str
    value: float
    ramp: float


@overload
def compile(
    scene: Scene,
    fs: float,
    target: Literal["llvm", "python"] = "llvm",
    seed: int = 0,
    *,
    outputs: Iterable[str] | None = None,
) -> Processor: ...
@overload
def compile(
    scene: Scene,
    fs: float,
    target: Literal["jax"],
    seed: int = 0,
    *,
    outputs: Iterable[str] | None = None,
    dtype: str = "float64",
    surrogate: float | None = None,
) -> Function: ...
@public
def compile(
    scene: Scene,
    fs: float,
    target: str = "llvm",
    seed: int = 0,
    *,
    outputs: Iterable[str] | None = None,
    **options,
) -> Processor | Function:
    """Compile a scene into a streaming processor, or a function for batches.

    Parameters
    ----------
    scene : Scene
    fs : float
        Sample rate in Hz.
    target : {"llvm", "python", "jax"}
        The compiler, or the reference interpreter, of a streaming processor; both give
        the same bits.  Or JAX, for whole signals: equal to rounding, see
        ``stimlib.targets.jax.function.Function``.
    seed : int
        Key of all noise of this run, besides each source's own seed.
    outputs : iterable of str, optional
        Those that are computed, in the order of the scene; by default all.  What only
        others need is not run.  The samples are those of a run with all.
    dtype : {"float64", "float32"}
        With JAX: of noise, long sums and outputs; motion, velocities and gates are
        float64 always.
    surrogate : float, optional
        With JAX: relative width of the smooth edge whose derivative a gate borrows;
        None: its derivative is 0.

    Returns
    -------
    Processor, or stimlib.targets.jax.function.Function

    Raises
    ------
    BadValue
        fs not above 0 or too low for a pass band; unknown target; no outputs; a
        tolerance that cannot be met.
    SceneError
        A step that cannot be compiled; noise keys that collide; filters on noise longer
        than the lead.
    UnknownName
        An output that the scene does not have.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> x = stimlib.Input("x", "m")
    >>> scene = stimlib.Scene({"force": stimlib.constant(2000.0, "N/m") * x})
    >>> stimlib.compile(scene, fs=8000, target="python").process(
    ...     np.array([[0.0, 0.01]])
    ... )
    array([[ 0., 20.]])
    """
    if outputs is not None:
        program_of(scene)  # refuses anything else
        wanted = [*outputs]
        need("compile: outputs", wanted, scene.outputs, "output")
        if not wanted:
            raise BadValue(
                f"compile: outputs = [] leaves none; name some of {', '.join(scene.outputs)}"
            )
        scene = type(scene)({n: b for n, b in scene.outputs.items() if n in wanted})
    if target == "jax":
        package("jax", "target='jax'")
        from ..targets.jax.function import OPTIONS, Function

        unknown = ", ".join(name for name in options if name not in OPTIONS)
        if unknown:
            raise BadValue(f"{unknown}: target='jax' has the options {', '.join(OPTIONS)}")
        return Function(scene, fs, seed, **options)
    if options:
        raise BadValue(f"{', '.join(options)}: only target='jax' has this option")
    return Processor(scene, fs, target, seed)


@public
class Processor:
    """A compiled scene: a pure function of (state, input block) that keeps the state.

    It is made by ``stimlib.compile``. ``inputs`` and ``outputs`` name the rows of x and
    y; ``units`` gives the unit of each of them and of each parameter; ``log`` lists
    every change of a parameter by sample index. Of an output and an input or parameter
    of one name, the output's unit is given; ``scene.inputs[..].dim`` is the other.

    Notes
    -----
    Processors are independent of each other: compile and run as many as you like in as
    many threads.  One processor is for one thread at a time.  ``set``, ``reset`` and
    ``state`` wait for each other, and ``index``, ``params``, ``fault`` may be read at
    any time; but while ``process`` runs in one thread, no other may call ``process``,
    ``reset`` or ``state``: that breaks nothing but the samples.  Sinks change
    parameters of a running processor by ``sink.set``.

    A copy, by ``copy`` or ``pickle``, goes on from the same state with an empty log.

    A processor that gets another of the same scene and fs as ``begun`` takes its start
    over, instead of running what comes before sample 0 again.
    """

    def __init__(
        self,
        scene: Scene,
        fs: float,
        target: str = "llvm",
        seed: int = 0,
        begun: Processor | None = None,
    ):
        began = time.perf_counter()
        fs = rate(fs)
        if target == "jax":
            raise BadValue(
                "a Processor streams; target='jax' is for stimlib.compile, which then gives a"
                " function of whole signals"
            )
        one_of("target", target, TARGETS)
        self.scene, self.fs, self.target = scene, fs, target
        with lock:  # a fork waits: its child would wait for an import that no thread ends
            if target == "llvm":
                from ..targets.llvm.engine import Engine
            else:
                from ..targets.python import Engine  # type: ignore[assignment]
            cost = 5000.0 if target == "python" and begun is None else 20.0
            self.program, self.design, self._first = prepare(scene, fs, cost, Engine.start)
            self._engine = Engine(self.program, self.design, fs)
        self._run = self._engine.process
        self.inputs: tuple[str, ...] = tuple(self.program.inputs)
        self.outputs: tuple[str, ...] = tuple(self.program.outputs)
        blocks = self.program.instances
        # equal outputs share an instance, not a unit
        named = {n: blocks[i].block for n, i in (self.program.inputs | self.program.params).items()}
        self.units = {n: str(b.dim) for n, b in (named | scene.outputs).items()}
        every = reach(scene.outputs.values())
        # a step of an author may change: a notebook runs its cells again
        self._changes = not all(ours(type(b)) for b in every)
        self._rated = {b.frequency.name: b for b in every if isinstance(b.frequency, Param)}
        self.seed = 0
        self._params: dict[str, float] = {}
        self.log: list[Change] = []
        sizes = [pack(s).size for _, s in self.design]
        # of each instance's state among the words
        self._place = np.cumsum([0, *sizes[:-1]]).tolist()
        self._guards = [(name, self._place[i]) for name, i in self.program.outputs.items()]
        # states at sample 0, by seed: the same on all targets
        self._fresh: dict[int, np.ndarray] = {} if begun is None else begun._fresh.copy()
        self._remembered = 8
        self._size = 2 + sum(sizes)
        shapes = [[(kind(v), np.size(v)) for v in s] for _, s in self.design]
        text = repr((self.program.hash, fs.hex(), shapes))
        self._early = _early(self.program)
        self._identity = np.frombuffer(hashlib.sha256(text.encode()).digest()[:8], np.uint64)
        self._lock = threading.RLock()
        self.reset(seed)
        logger.debug("%r: %d rows, ready in %.3f s", self, len(blocks), time.perf_counter() - began)

    def __repr__(self):
        return (
            f"Processor({', '.join(self.inputs) or 'no input'} -> {', '.join(self.outputs)},"
            f" fs={self.fs:g}, {self.target})"
        )

    def __reduce__(self):
        return Processor, (self.scene, self.fs, self.target, self.seed), self.state

    def __setstate__(self, words: np.ndarray) -> None:
        self.state = words

    # Running --------------------------------------------------------------------------
    def process(self, x: np.ndarray | int, out: np.ndarray | None = None) -> np.ndarray:
        """Compute the next n samples.

        Parameters
        ----------
        x : ndarray, shape (n_inputs, n), float64, C-contiguous; or int
            Rows in the order of ``inputs``, in their units.  The number n serves a
            scene without inputs.
        out : ndarray, shape (n_outputs, n), float64, C-contiguous, optional
            Written and returned when given; no memory is allocated then.

        Returns
        -------
        ndarray, shape (n_outputs, n)

        Raises
        ------
        BadValue
            A wrong shape, type or layout; an ``out`` that shares memory with x other
            than in whole rows (``out`` may be x). Nothing has run then.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> proc = stimlib.compile(
        ...     stimlib.Scene({"y": 2 * stimlib.Input("x")}), fs=1000, target="python"
        ... )
        >>> proc.process(np.ones((1, 3)))
        array([[2., 2., 2.]])
        """
        try:
            if out is None:
                out = np.empty(
                    (len(self.outputs), x.shape[1])  # type: ignore[union-attr, arg-type]
                )
            if not self._run(x, out):
                return out
        except StimlibError:  # of a step
            raise
        except (TypeError, AttributeError, IndexError, ValueError):
            pass
        if not isinstance(x, np.ndarray):
            return self.process(columns(x, self.inputs), out)
        explain("x", x, self.inputs, (len(self.inputs), None))
        explain("out", out, self.outputs, (len(self.outputs), x.shape[1]))
        if np.may_share_memory(x, out):
            raise BadValue(
                "process: out and x share memory, shifted by a part of a row: use another array, or"
                " x itself"
            )
        assert out is not None
        # of classes derived from numpy's array
        if not self._run(*(np.ndarray(a.shape, float, a) for a in (x, out))):
            return out
        raise AssertionError("process refused arrays that look right")

    @property
    def params(self) -> Mapping[str, float]:
        """The parameters, read-only: ``set`` changes them. In a ramp, where it ends.

        A dict, for JSON or a pickle, is ``dict(proc.params)``.
        """
        return MappingProxyType(self._params)

    @property
    def index(self) -> int:
        """The number of samples processed since the last reset."""
        return self._engine.count

    # State ----------------------------------------------------------------------------
    @property
    def state(self) -> np.ndarray:
        """All values that the next sample depends on: one flat uint64 array (a copy).

        Word 0 identifies the scene with all its design numbers and fs, word 1 is the
        sample index; then follow all states in canonical order, the same on every
        target, but for the sign of a NaN. Assign it to continue from there: ``params``
        are then those of the state, and the log is empty. BadValue for a state of
        another scene or sample rate.
        """
        with self._lock:
            words = self._engine.packed
            return np.concatenate([self._identity, np.array([self.index], np.uint64), words])

    @state.setter
    def state(self, words: np.ndarray) -> None:
        self._go_on(self._sound(words))

    def _sound(self, words: Any) -> np.ndarray:
        """Return a state after checking that it is one of this scene."""
        try:
            words = np.ascontiguousarray(words)
        except ValueError:  # rows of several lengths
            words = np.zeros(0)
        if words.dtype != np.uint64 or words.shape != (self._size,):
            raise BadValue(
                f"state must be uint64 of shape ({self._size},), as proc.state gives it; got"
                f" {words.dtype} {words.shape}"
            )
        if words[0] != self._identity[0]:
            raise BadValue("this state belongs to another scene or sample rate")
        if words[1] > LONGEST:
            raise BadValue(
                f"this state is at sample {words[1]}, which no run reaches: it is damaged"
            )
        return words

    def _go_on(self, words: np.ndarray) -> None:
        with self._lock:
            self._engine.packed = words[2:]
            self._engine.count = int(words[1])
            self.log.clear()
            target = words[2:].view(np.float64)
            # parameter.ParamState
            self._params = {
                name: float(target[self._place[i] + 1]) for name, i in self.program.params.items()
            }

    def reset(self, seed: int | None = None) -> None:
        """Set the processor back to sample 0, and parameters to their initial values.

        With a seed, every noise gets new keys.

        Parameters
        ----------
        seed : int, optional
            0 .. 2**64 - 1; None keeps the last one.
        """
        with self._lock:
            seed = self.seed if seed is None else key(seed)
            if seed not in self._fresh:
                before = self._engine.packed
                try:
                    self._engine.packed = self._first(seed)
                    for clocks in self._early:
                        for at in range(0, lead(self.fs), EARLY):
                            self._engine.warm(clocks, min(EARLY, lead(self.fs) - at))
                except BaseException:  # an interrupt: nothing is reset
                    self._engine.packed = before
                    raise
                if len(self._fresh) >= self._remembered:
                    self._fresh.pop(next(iter(self._fresh)))
                self._fresh[seed] = self._engine.packed
            self.seed, self._engine.packed = seed, self._fresh[seed]
            self._engine.count = 0
            blocks = {n: self.program.instances[i].block for n, i in self.program.params.items()}
            self._params = {n: b.value for n, b in blocks.items()}  # type: ignore[attr-defined]
            self.log.clear()

    def set(self, name: str, value: float, ramp: float = 0.02) -> None:
        """Change a parameter from the next sample on.

        Parameters
        ----------
        name : str
            One of ``params``.
        value : float
            In the Param's unit.
        ramp : float
            Seconds to get there along a straight line; 0 jumps.

        Raises
        ------
        UnknownName
            No such parameter.
        BadValue
            A value that is not finite, a ramp below 0; a frequency of fs/2 or above.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> proc = stimlib.compile(
        ...     stimlib.Scene({"y": stimlib.Param("a", 1.0) * 1}), fs=4, target="python"
        ... )
        >>> proc.set("a", 2.0, ramp=1.0)
        >>> proc.process(np.empty((0, 5)))
        array([[1.25, 1.5 , 1.75, 2.  , 2.  ]])
        """
        value, ramp = self.setting(name, value, ramp)
        with self._lock:
            self._engine.set(self.program.params[name], value, float(max(1, round(ramp * self.fs))))
            self._params[name] = value
            self.log.append(Change(self.index, name, value, ramp))

    def setting(self, name: Any, value: Any, ramp: Any) -> tuple[float, float]:
        """Return the value and the ramp of a setting as checked numbers.

        Raises
        ------
        UnknownName, BadValue
            As `set`.
        """
        need("set", [name], self.program.params, "parameter")
        value, ramp = number(value, f"set({name!r}): value"), number(ramp, f"set({name!r}): ramp")
        if not math.isfinite(value):
            raise BadValue(f"set({name!r}, {value}): the value must be finite")
        if not (math.isfinite(ramp * self.fs) and ramp >= 0):
            raise BadValue(
                f"set({name!r}, {value:g}, ramp={ramp}): the ramp is a time in seconds, at least 0"
            )
        if name in self._rated:
            self._rated[name].check_rate(value, self.fs, f"set({name!r}): ")
        return value, ramp

    # Many at once ---------------------------------------------------------------------
    def many(self, seeds: Sequence[int], threads: int | None = None) -> Copies:
        """Make copies that run together, each with its own seed, parameters and motion.

        They share tables and code, and start at sample 0 with the scene's parameters.
        Copy k gives the bits of ``stimlib.compile(scene, fs, target, seeds[k])``,
        whatever the others do and however many threads there are.

        Parameters
        ----------
        seeds : sequence of int
            One for each copy, 0 .. 2**64 - 1; equal ones give equal noise.
        threads : int, optional
            That run at once; by default one for each core.

        Returns
        -------
        Copies

        Raises
        ------
        BadValue
            No seeds, or what is none; threads below 1; more memory than
            ``stimlib.limits.state_bytes``.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> from stimlib.blocks import white_noise
        >>> level = stimlib.Param("level", 1.0)
        >>> scene = stimlib.Scene({"y": level * white_noise(seed=1)})
        >>> runs = stimlib.compile(scene, fs=1000).many(seeds=range(64))
        >>> runs.set("level", np.linspace(0.1, 2.0, 64), ramp=0.0)
        >>> runs.process(np.empty((0, 500))).shape
        (64, 1, 500)
        """
        return Copies(self, seeds, threads)

    def _copy(self, seed: int, remembered: int) -> Processor:
        other = object.__new__(type(self))
        vars(other).update(vars(self))
        other._engine = self._engine.copy()
        other._run = other._engine.process
        other._remembered = remembered
        other.log = []
        other.reset(seed)
        return other

    # Telling --------------------------------------------------------------------------
    @property
    def fault(self) -> tuple[str, int] | None:
        """The (output, sample index) of the first non-finite sample, or None."""
        words = self._engine.peek()
        left = words.view(np.float64)
        # see guard.GuardState
        found = [(int(words[at + 2]), name) for name, at in self._guards if left[at + 1] >= 0]
        return min(found)[::-1] if found else None

    @property
    def address(self) -> tuple[int, int]:
        """The addresses (entry, context) for C: call entry(context, x, y, n).

        Its signature is void (*)(int64*, double*, double*, int64).

        x and y are row-major (n_inputs, n) and (n_outputs, n). It is for code that runs
        without the Python interpreter; keep the processor alive as long as the
        addresses are in use.
        """
        if self._engine.address is None:
            raise SceneError("only the llvm target has an address")
        return self._engine.address

    @property
    def plan(self) -> Plan:
        """The blocks in running order, their clocks, and the blocks removed."""
        return plan_of(self.program, self.fs, getattr(self._engine, "segments", ()))

    @property
    def latency(self) -> dict[tuple[str, str], tuple[float, float]]:
        """The (min, max) latency in samples over all paths, by (output, input).

        Noise sources count as inputs.
        """
        from ..core.response import latency

        return latency(self.program, self.design)

    def response(self, output: str, input: str, f: np.ndarray) -> np.ndarray:
        """Return the discrete frequency response from an input or noise to an output.

        Parameters have the values of ``params``.

        Parameters
        ----------
        output, input : str
            Names; a noise source is ``"white(seed, stream)"``.
        f : ndarray
            Frequencies in Hz.

        Returns
        -------
        ndarray of complex, the shape of f

        Raises
        ------
        UnknownName
            No such output or input.
        SceneError
            A block on the path is not linear and time-invariant.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> proc = stimlib.compile(
        ...     stimlib.Scene({"y": 2 * stimlib.Input("x")}), fs=1000, target="python"
        ... )
        >>> proc.response("y", "x", np.array([10.0]))
        array([2.+0.j])
        """
        from ..core.response import response

        return response(
            self.program, self.design, self.fs, self._params, output, input, np.asarray(f, float)
        )


def _early(program: Program) -> list[list[int]]:
    """Return the clocks with a lead, in groups that run before sample 0 in turn.

    A clock that runs another while no input is there comes after it.
    """
    level = [0] * len(program.parents)
    runs = {(q.clock, q.child) for q in program.instances if q.autonomous and q.child > 0}
    for clock, child in sorted(runs, reverse=True):  # a clock's number is below its children's
        level[clock] = max(level[clock], level[child] + 1)
    groups: list[list[int]] = [[] for _ in range(max(level) + 1)]
    for clock in sorted({q.clock for q in program.instances if q.autonomous} - {PARAMS}):
        groups[level[clock]].append(clock)
    return [group for group in groups if group]
