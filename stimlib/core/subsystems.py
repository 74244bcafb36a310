"""Blocks that run another block on a clock of its own: enabled, or in a segment."""

from __future__ import annotations

import dataclasses as dc
import math
from collections import namedtuple
from typing import Any

from ..errors import BadValue, SceneError, public
from .graph import Block, Input, as_block, reach
from .maths import where


class Subsystem(Block, abstract=True):
    """A block on a clock of its own: its second signal says when its first runs."""

    rests = True


@dc.dataclass(frozen=True, eq=False)
class Enabled(Subsystem):
    """A block on its own clock; see ``enabled``."""

    block: Block
    by: Block

    def check(self):
        below = [] if self.block.autonomous else reach([self.block])
        culprit = next((b for b in below if isinstance(b, Input)), None)
        if culprit is not None:
            raise SceneError(
                f"enabled({self.block!r}) would need the input {culprit.name!r} while it is held;"
                " enable only what no Input reaches, and multiply after the gate: x *"
                " enabled(noise, by=gate)"
            )


@public
def enabled(block: Block, by: Block) -> Block:
    """Run a block only at the samples where a condition holds (an *enabled subsystem*).

    The block has its own clock, which consists of the samples with ``by > 0``. At other
    samples its state is held, nothing of it is computed and the output is 0. Each
    ``enabled`` has its own copy of the blocks that it runs.

    Parameters
    ----------
    block : Block
        No Input may reach it.
    by : Block
        The condition.

    Raises
    ------
    SceneError
        If an Input reaches the block: multiply after the gate.

    Examples
    --------
    >>> from stimlib import Input, constant
    >>> from stimlib.blocks import enabled, white_noise
    >>> enabled(white_noise(seed=1), by=Input("v", "m/s") > constant(1e-3, "m/s"))
    Enabled(White(..), Greater(..))
    """
    return Enabled(as_block(block), as_block(by))


# Parameters of `Interval`: the first sample and the one after the last.
IntervalParams = namedtuple("IntervalParams", "first end")


# State of `Interval`: the number of the sample.
IntervalState = namedtuple("IntervalState", "n")


@dc.dataclass(frozen=True, eq=False)
class Interval(Block):
    """A signal that is 1 in one interval of time and 0 otherwise.

    It is also 0 before sample 0.
    """

    begin: float
    duration: float | None
    begins_early = False

    def check(self):
        if self.begin < 0 or (self.duration is not None and self.duration <= 0):
            raise BadValue(
                f"segment: start = {self.begin} s must be 0 or above, and duration ="
                f" {self.duration} s above 0"
            )

    def design(self, fs):
        first = math.floor(self.begin * fs + 0.5)
        long = math.inf if self.duration is None else math.floor(self.duration * fs + 0.5)
        return IntervalParams(float(first), float(first + long)), IntervalState(0.0)

    @staticmethod
    def step(p, s):
        return where(s.n >= p.first, where(s.n < p.end, 1.0, 0.0), 0.0), IntervalState(s.n + 1.0)


@dc.dataclass(frozen=True, eq=False)
class Segment(Subsystem):
    """A block in an interval of time, on a clock of its own; see ``segment``."""

    block: Block
    by: Block
    seed: int | None

    def check(self):
        if not isinstance(self.by, Interval):
            raise BadValue(
                f"a segment lasts for an Interval, not {self.by!r}; make it with segment(block,"
                " start, duration)"
            )
        if self.seed is not None and self.seed < 0:
            raise BadValue(
                f"segment: seed = {self.seed} must be a whole number from 0 to 2**64 - 1"
            )

    @property
    def run(self) -> str:
        """Text that identifies the run of a segment."""
        by: Any = self.by
        return (
            f" in segment({by.begin},"
            f" {by.duration}{'' if self.seed is None else f', seed={self.seed}'})"
        )


@public
def segment(
    block: Block, start: float, duration: float | None = None, seed: int | None = None
) -> Segment:
    """Run a block only in one interval of time, with a clock of its own.

    It then behaves as if it were rendered alone.

    The block has its own clock, which consists of the samples of that interval. There
    its time starts at 0, its states are at rest, its noises start from the seed, and
    the motion at the first of these samples is the first that it receives. Outside the
    interval nothing of it is computed and the output is 0. So its samples are those of
    ``stimlib.render``, bit for bit.

    Parameters
    ----------
    block : Block
    start : float
        In s, at the nearest sample.  Inside another segment, or inside ``enabled``, it
        counts from the start of that.
    duration : float, optional
        In s, to the nearest number of samples; by default to the end.
    seed : int, optional
        Key of all noise in it, as ``seed`` of ``stimlib.compile``; by default that of
        the run.

    Returns
    -------
    Block

    Raises
    ------
    BadValue
        A start below 0, a duration not above 0, no seed.
    SceneError
        In ``Scene``: inside a loop, or with the last value of one that is outside.

    Notes
    -----
    Segments of one start, duration and seed run together: what their blocks share runs
    once, as for several outputs of a scene.  All others have their own copies of what
    they run, also of noises: with one seed they are the same samples again, and with
    different seeds they are independent.  Parameters are those of the whole run;
    ``Scene.renamed`` gives a stimulus its own.

    Examples
    --------
    A burst that is felt twice:

    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import elapsed, segment
    >>> twice = [
    ...     segment(elapsed() + stimlib.constant(1.0, "s"), start, 0.003)
    ...     for start in (0.001, 0.005)
    ... ]
    >>> stimlib.compile(stimlib.Scene({"y": twice[0] + twice[1]}), fs=1000).process(
    ...     np.empty((0, 9))
    ... )
    array([[0.   , 1.   , 1.001, 1.002, 0.   , 1.   , 1.001, 1.002, 0.   ]])
    """
    return Segment(as_block(block), Interval(start, duration), seed)
