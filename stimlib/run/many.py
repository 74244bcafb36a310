"""Many runs of one scene at once."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import partial
from typing import Any

import numpy as np

from ..errors import BadValue, counted
from ..system.limits import limits
from .arguments import columns, explain, key, length

WORTHWHILE = 2048
"""Samples, of all copies together, for which it is worth while to wake another
thread.
"""


class Copies(Sequence[Any]):
    """Copies of one processor that run together, in threads independent of Python.

    They are made by ``Processor.many``. ``runs[k]`` is copy k, a ``Processor`` of its
    own: you can set, reset or process it alone, and ask for its state or its response.

    Notes
    -----
    Threads take one copy after the other, so copies with more to do (an open gate) hold
    nobody up.  With target="python" they run one after another.  As with a processor,
    while ``process`` runs in one thread no other may touch the copies.
    """

    def __init__(self, proc: Any, seeds: Sequence[int], threads: int | None = None):
        copies = length(seeds)
        if not copies:
            raise BadValue(f"many: seeds = {seeds!r}: give one for each copy, such as range(64)")
        self.threads = (os.cpu_count() or 1) if threads is None else threads
        if not isinstance(self.threads, (int, np.integer)) or self.threads < 1:
            raise BadValue(f"many: threads = {threads!r} must be a whole number, at least 1")
        each = proc._engine.nbytes + 8 * proc._size  # and the state at sample 0
        what = f"bytes of the states and buffers of {counted(copies, 'processor')}"
        limits.check("state_bytes", copies * each, what)
        self._all = [proc._copy(k, 8 + copies) for k in list(map(key, seeds))]
        self._run = proc._engine.together([p._engine for p in self._all])
        # beside the one that calls
        self._pool = ThreadPoolExecutor(max(1, self.threads - 1), "stimlib-copies")

    def __len__(self) -> int:
        return len(self._all)

    def __getitem__(self, k):
        return self._all[k]

    def __repr__(self):
        return f"Copies({len(self)} of {self[0]!r}, {self.threads} threads)"

    def process(self, x: np.ndarray | int, out: np.ndarray | None = None) -> np.ndarray:
        """Compute the next n samples of every copy.

        Parameters
        ----------
        x : ndarray, shape (n_inputs, n) or (copies, n_inputs, n), float64, C-contiguous
            One motion for all, or one for each; or a number of samples, as in
            ``Processor.process``.
        out : ndarray, shape (copies, n_outputs, n), float64, C-contiguous, optional
            Written and returned when given.

        Returns
        -------
        ndarray, shape (copies, n_outputs, n)

        Raises
        ------
        BadValue
            A wrong shape, type or layout; an ``out`` that shares memory with x (``out``
            may be x).  Nothing has run then.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> proc = stimlib.compile(
        ...     stimlib.Scene({"y": 2 * stimlib.Input("x")}), fs=1000, target="python"
        ... )
        >>> proc.many(seeds=[0, 0]).process(np.array([[[1.0, 2.0]], [[3.0, 4.0]]]))
        array([[[2., 4.]],
        <BLANKLINE>
               [[6., 8.]]])
        """
        copies, inputs, outputs = len(self), self[0].inputs, self[0].outputs
        x = x if isinstance(x, np.ndarray) else columns(x, inputs)
        explain("x", x, inputs, (len(inputs), None), (copies, len(inputs), None))
        n = x.shape[-1]
        if out is None:
            out = np.empty((copies, len(outputs), n))
        explain("out", out, outputs, (copies, len(outputs), n))
        if np.may_share_memory(x, out) and not (
            x.shape == out.shape and x.ctypes.data == out.ctypes.data
        ):
            raise BadValue("process: out and x share memory: use another array, or x itself")
        work = partial(self._run, np.zeros(1, np.int64), x if x.ndim == 3 else x[None], out)
        helpers: list[Future] = []
        try:
            for _ in range(1, min(self.threads, copies, 1 + copies * n // WORTHWHILE)):
                helpers.append(self._pool.submit(work))
            work()
        finally:
            helpers = [h for h in helpers if not h.cancel()]  # whoever has not begun need not
            wait(helpers)
        for h in helpers:
            h.result()
        return out

    def set(
        self, name: str, value: float | Sequence[float] | np.ndarray, ramp: float = 0.02
    ) -> None:
        """Change a parameter of all copies from their next sample on.

        Parameters
        ----------
        name : str
        value : float or sequence of float, shape (copies,)
            One for all, or one for each; ``runs[k].set`` changes copy k alone.
        ramp : float
            Seconds; see ``Processor.set``.

        Raises
        ------
        UnknownName, BadValue
            As ``Processor.set``; not as many values as copies.  Nothing is changed
            then.

        Examples
        --------
        >>> import stimlib
        >>> scene = stimlib.Scene({"y": stimlib.Param("a", 1.0) * 1})
        >>> proc = stimlib.compile(scene, fs=1000, target="python")
        >>> runs = proc.many(seeds=range(3))
        >>> runs.set("a", [1.0, 2.0, 3.0])
        >>> runs[2].params["a"]
        3.0
        """
        one = isinstance(value, str) or length(value) is None
        values = [value] * len(self) if one else self._each(value, f"set({name!r}): values")
        settings = [p.setting(name, v, ramp) for p, v in zip(self, values, strict=True)]
        for p, (v, seconds) in zip(self, settings, strict=True):
            p.set(name, v, seconds)

    def reset(self, seeds: Sequence[int] | None = None) -> None:
        """Set every copy back to sample 0, and parameters to their initial values.

        With seeds, one for each copy, every noise gets new keys.

        Raises
        ------
        BadValue
            Not as many seeds as copies, or what is no seed.  Nothing is reset then.
        """
        if seeds is None:
            seeds = [p.seed for p in self]
        keys = list(map(key, self._each(seeds, "reset: seeds")))
        for p, k in zip(self, keys, strict=True):
            p.reset(k)

    @property
    def state(self) -> np.ndarray:
        """The state of each copy, shape (copies, words), uint64.

        Assign it to continue from there; see ``Processor.state``.
        """
        return np.stack([p.state for p in self])

    @state.setter
    def state(self, words: np.ndarray) -> None:
        states = [p._sound(w) for p, w in zip(self, self._each(words, "state: rows"), strict=True)]
        for p, w in zip(self, states, strict=True):
            p._go_on(w)

    @property
    def fault(self) -> list[tuple[str, int] | None]:
        """The (output, index) of each copy's first non-finite sample, or None."""
        return [p.fault for p in self]

    def _each(self, values: Any, what: str) -> list[Any]:
        """Return the values as a list; raise BadValue unless there is one per copy."""
        given = length(values)
        if given != len(self):
            raise BadValue(
                f"{what}: give one for each of {len(self)} copies,"
                f" {f'not {values!r}' if given is None else f'got {given}'}"
            )
        return list(values)
