"""Delay by whole samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.graph import NONE, ONE, Block
from ..core.maths import where
from ..design import responses
from ..errors import BadValue, public
from ..system.limits import limits
from .onset import begun


class DelayParams(NamedTuple):
    n: float


class DelayState(NamedTuple):
    line: np.ndarray
    at: np.uint64  # place of the oldest sample: samples seen, modulo the line's size


@dataclass(frozen=True, eq=False)
class Delay(Block):
    """y[n] = x[n - samples]; 0 before."""

    x: Block
    samples: int | None
    seconds: float | None

    def check(self):
        if (self.samples is None) == (self.seconds is None):
            raise BadValue("delay: give either samples or seconds")
        if self.samples is not None and (not isinstance(self.samples, int) or self.samples < 1):
            raise BadValue(f"delay: samples = {self.samples!r} must be a whole number, at least 1")
        if self.seconds is not None and not self.seconds > 0:
            raise BadValue(f"delay: seconds = {self.seconds!r} must be above 0")

    def design(self, fs):
        length = self.seconds * fs if self.samples is None else float(self.samples)
        limits.check("state_bytes", 8 * length, f"delay: bytes of its samples at fs = {fs:g} Hz")
        n = round(length)
        if n < 1:
            raise BadValue(
                f"delay: {self.seconds:g} s is less than half a sample at fs = {fs:g} Hz"
            )
        return DelayParams(float(n)), DelayState(np.zeros(n), np.uint64(0))

    def laws(self, fs):
        return (
            responses.delay(round(self.seconds * fs) if self.samples is None else self.samples),
        )

    @staticmethod
    def step(p, s, x):
        size = np.uint64(s.line.size)
        at = where(s.at < size, s.at, NONE)  # a state may come from anywhere
        i = np.int64(at)
        y = s.line[i]
        s.line[i] = x
        return y, DelayState(s.line, where(at + ONE == size, NONE, at + ONE))

    @staticmethod
    def transfer(p, z):
        return z**-p.n

    def delay(self, p):
        return p.n

    def memory(self, p):
        return int(p.n)


@public
def delay(
    x: Block | float,
    samples: float | None = None,
    seconds: float | None = None,
    onset: str = "step",
) -> Block:
    """Delay a signal by a whole number of samples.

    Parameters
    ----------
    x : Block
    samples : int, optional
        At least 1.
    seconds : float, optional
        Rounded to whole samples at compile time.
    onset : {"step", "steady"}
        Whether x was 0 before the first sample, or has always been as it is there.

    Raises
    ------
    BadValue
        Neither or both given; less than one sample; an unknown onset.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import delay
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"y": delay(stimlib.Input("x"), samples=2)}), fs=1000
    ... )
    >>> proc.process(np.array([[1.0, 2.0, 3.0]]))
    array([[0., 0., 1.]])
    """
    if isinstance(samples, float):
        raise BadValue(
            f"delay: samples = {samples!r} must be a whole number; a time is delay(x,"
            f" seconds={samples!r})"
        )
    return begun("delay", x, onset, lambda u: Delay(u, samples, seconds), lambda y: 1.0)
