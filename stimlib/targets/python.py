"""The reference interpreter: the program sample by sample, without a compiler.

What it computes is what a scene means.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..core.clocks import PARAMS, ROOT
from ..core.graph import at_rest, pack, unpack
from ..core.parameter import Param, ParamState
from ..core.program import Program, start
from ..core.steps import sample


class Engine:
    """An interpreter of a program; ``words`` is its whole state.

    See ``stimlib.run.processor`` for the public interface.
    """

    address = None
    start = staticmethod(start)

    def __init__(self, program: Program, design: list[tuple[Any, Any]], fs: float):
        self.program = program
        self.count = 0
        self.design = design
        self.p = [unpack(p, pack(p)) for p, _ in design]
        self.s = [unpack(s, pack(s)) for _, s in design]
        blocks = [q.block for q in program.instances]
        works = [b.definition.work for b in blocks]
        self.work = [
            np.zeros(work(p) if work else 0) for work, p in zip(works, self.p, strict=True)
        ]
        self.nbytes = sum(a.nbytes for a in (self.words, *self.work))

    def copy(self) -> Engine:
        """Return another run of the same program."""
        return Engine(self.program, self.design, 0.0)

    @staticmethod
    def together(
        engines: Sequence[Engine],
    ) -> Callable[[np.ndarray, np.ndarray, np.ndarray], object]:
        """Return a function run(turn, x, out) that runs copies in one thread.

        It runs one copy after another. See ``stimlib.targets.llvm.engine``.
        """

        def run(turn: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
            for k, e in enumerate(engines):
                e.process(x[k % len(x)], out[k])

        return run

    def sample(
        self, x: dict[int, float], clocks: Sequence[int] = (ROOT,), warm: bool = False
    ) -> dict[int, Any]:
        """Return values of all instances at one sample of some clocks.

        Clocks that they enable run too.
        """
        on = [False] * len(self.program.parents)
        for clock in (PARAMS, *clocks):
            on[clock] = True
        v: dict[int, Any] = dict(x)
        for i, q in enumerate(self.program.instances):
            if not on[q.clock] or (warm and not q.autonomous):
                continue
            if q.kind == "open":
                on[q.child] = bool(v[q.args[0]] > 0.0)
            elif q.kind == "close":
                v[i] = v[q.args[1]] if on[q.child] else np.float64(0.0)
            elif q.kind == "const":
                v[i] = np.float64(q.block.value)  # type: ignore[attr-defined]
            elif q.kind == "pick":
                v[i] = v[q.args[0]][q.block.place]  # type: ignore[attr-defined]
            elif q.kind == "block":
                v[i] = self.step(i, [v[a] for a in q.args])
        return v

    def step(self, i: int, x: list[float]) -> Any:
        """Return one sample of a block, or a tuple of one sample for each output."""
        block = self.program.instances[i].block
        if block.resettable and not x.pop() > 0.0:
            if self.s[i].cold == 0.0:
                self.s[i] = at_rest(self.design[i][1])
            return (np.float64(0.0),) * len(block.outputs) or np.float64(0.0)
        scratch = (self.work[i],) if block.definition.work else ()
        y, after = sample(block, self.p[i], self.s[i], x, scratch)
        self.s[i] = after._replace(cold=np.float64(0.0)) if block.resettable else after
        return y

    def process(self, x: np.ndarray, out: np.ndarray) -> int:
        """Compute ``out`` from x, shape (n_inputs, n); return 1 if they do not fit."""
        inputs, outputs = list(self.program.inputs.values()), list(self.program.outputs.values())
        if x.shape != (len(inputs), x.shape[1]) or out.shape != (len(outputs), x.shape[1]):
            return 1
        if (
            any(a.dtype != np.float64 or not a.flags.c_contiguous for a in (x, out))
            or not out.flags.writeable
        ):
            return 1
        apart = out.ctypes.data - x.ctypes.data
        if x.size and -out.nbytes < apart < x.nbytes and apart % (8 * x.shape[1]):
            return 1  # as in runtime.process
        with np.errstate(all="ignore"):
            for n in range(x.shape[1]):
                v = self.sample(dict(zip(inputs, x[:, n], strict=True)))
                out[:, n] = [v[o] for o in outputs]
        self.count += x.shape[1]
        return 0

    def warm(self, clocks: Sequence[int], n: int) -> None:
        """Run only blocks that no input reaches, for n samples of some clocks.

        None of these clocks may run another.
        """
        with np.errstate(all="ignore"):
            for _ in range(n):
                self.sample({}, clocks, warm=True)

    def set(self, i: int, target: float, left: float) -> None:
        """Ramp parameter instance i to a target over ``left`` samples, starting now."""
        assert isinstance(self.program.instances[i].block, Param)
        end = np.float64(target)
        # a jump is there at once: a ramp set at the same sample begins where it ends
        y, left = (end, 0.0) if left <= 1.0 else (self.s[i].y, left)
        self.s[i] = ParamState(y, end, np.float64(left))

    @property
    def words(self) -> np.ndarray:
        """All states in canonical order (a copy)."""
        parts = [
            pack(s)
            for s, q in zip(self.s, self.program.instances, strict=True)
            if q.kind == "block"
        ]
        return np.concatenate(parts) if parts else np.zeros(0, np.uint64)

    @words.setter
    def words(self, w: np.ndarray) -> None:
        at = 0
        for i, q in enumerate(self.program.instances):
            if q.kind == "block":
                n = pack(self.s[i]).size
                self.s[i] = unpack(self.s[i], w[at : at + n])
                at += n

    def peek(self) -> np.ndarray:
        """Return the states."""
        return self.words
