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
from .llvm.entry_points import fit


class Engine:
    """An interpreter of a program; ``packed`` is its whole state.

    See ``stimlib.run.processor`` for the public interface.
    """

    address = None
    start = staticmethod(start)

    def __init__(self, program: Program, design: list[tuple[Any, Any]], fs: float):
        self.program = program
        self.count = 0
        self.design = design
        # by way of words, as compiled code gets them: copies, in which a number that
        # design gives as an int is a float
        self.numbers = [unpack(numbers, pack(numbers)) for numbers, _ in design]
        self.states = [unpack(state, pack(state)) for _, state in design]
        works = [instance.block.definition.work for instance in program.instances]
        self.work = [
            np.zeros(work(numbers) if work else 0)
            for work, numbers in zip(works, self.numbers, strict=True)
        ]
        self.nbytes = sum(array.nbytes for array in (self.packed, *self.work))

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

        def run(turn: np.ndarray, motions: np.ndarray, out: np.ndarray) -> None:
            for copy, engine in enumerate(engines):
                # of classes derived from numpy's, such as a mapped file
                engine.process(np.asarray(motions[copy % len(motions)]), np.asarray(out[copy]))

        return run

    def sample(
        self, signals: dict[int, float], clocks: Sequence[int] = (ROOT,), warm: bool = False
    ) -> dict[int, Any]:
        """Return values of all instances at one sample of some clocks.

        Clocks that they enable run too.
        """
        on = [False] * len(self.program.parents)  # clocks; an open row turns those of gates on
        for clock in (PARAMS, *clocks):
            on[clock] = True
        values: dict[int, Any] = dict(signals)
        for index, instance in enumerate(self.program.instances):
            # the order of the program has each gate before what it opens, so one pass
            # is enough
            if not on[instance.clock] or (warm and not instance.autonomous):
                continue
            if instance.kind == "open":
                on[instance.child] = bool(values[instance.args[0]] > 0.0)
            elif instance.kind == "close":
                values[index] = values[instance.args[1]] if on[instance.child] else np.float64(0.0)
            elif instance.kind == "const":
                values[index] = np.float64(instance.block.value)  # type: ignore[attr-defined]
            elif instance.kind == "pick":
                values[index] = values[instance.args[0]][
                    instance.block.output_index  # type: ignore[attr-defined]
                ]
            elif instance.kind == "block":
                values[index] = self.step(index, [values[source] for source in instance.args])
        return values

    def step(self, index: int, signals: list[float]) -> Any:
        """Return one sample of a block, or a tuple of one sample for each output."""
        block = self.program.instances[index].block
        # the contact is the last signal, and no step sees it; written so that NaN is no
        # contact
        if block.resettable and not signals.pop() > 0.0:
            if self.states[index].cold == 0.0:
                self.states[index] = at_rest(self.design[index][1])
            return (np.float64(0.0),) * len(block.outputs) or np.float64(0.0)
        scratch = (self.work[index],) if block.definition.work else ()
        outputs, after = sample(block, self.numbers[index], self.states[index], signals, scratch)
        self.states[index] = after._replace(cold=np.float64(0.0)) if block.resettable else after
        return outputs

    def process(self, motion: np.ndarray, out: np.ndarray) -> int:
        """Compute ``out`` from x, shape (n_inputs, n); return 1 if they do not fit."""
        inputs, outputs = list(self.program.inputs.values()), list(self.program.outputs.values())
        if not fit((motion, out), (len(inputs), len(outputs))):
            return 1
        # compiled code divides by 0 without a word, and a warning may be an error in a
        # caller
        with np.errstate(all="ignore"):
            for moment in range(motion.shape[1]):
                values = self.sample(dict(zip(inputs, motion[:, moment], strict=True)))
                out[:, moment] = [values[output] for output in outputs]
                self.count += 1  # each by itself: an error may end the loop
        return 0

    def warm(self, clocks: Sequence[int], count: int) -> None:
        """Run only blocks that no input reaches, for n samples of some clocks.

        None of these clocks may run another.
        """
        with np.errstate(all="ignore"):
            for _ in range(count):
                self.sample({}, clocks, warm=True)

    def set(self, index: int, target: float, left: float) -> None:
        """Ramp parameter instance i to a target over ``left`` samples, starting now."""
        assert isinstance(self.program.instances[index].block, Param)
        end = np.float64(target)
        # a jump is there at once: a ramp set at the same sample begins where it ends
        value, left = (end, 0.0) if left <= 1.0 else (self.states[index].y, left)
        self.states[index] = ParamState(value, end, np.float64(left))

    @property
    def packed(self) -> np.ndarray:
        """All states in canonical order (a copy)."""
        parts = [
            pack(state)
            for state, instance in zip(self.states, self.program.instances, strict=True)
            if instance.kind == "block"
        ]
        return np.concatenate(parts) if parts else np.zeros(0, np.uint64)

    @packed.setter
    def packed(self, words: np.ndarray) -> None:
        start = 0
        for index, instance in enumerate(self.program.instances):
            if instance.kind == "block":
                end = start + pack(self.states[index]).size
                self.states[index] = unpack(self.states[index], words[start:end])
                start = end

    def peek(self) -> np.ndarray:
        """Return the states."""
        return self.packed
