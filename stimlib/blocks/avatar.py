"""An avatar that lags behind a pen where a soft object becomes harder, and the
vibration in its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..core.graph import NONE, ONE, Block, as_block, positive
from ..core.maths import as_float, floor, where
from ..core.units import unit
from ..errors import BadValue, UnitError, public
from ..system.limits import limits
from .cursor import FRAME
from .stiffness import check_places

SECOND, NEWTON = unit("s"), unit("N")
WIDER = 1e-9  # a rise that is the smallest but for its rounding counts


def avatar_units(u: tuple[Any, ...]) -> tuple[Any, ...]:
    """Units of x, y, lag and wait, from those of places and force."""
    check_places("delay_avatar", *u[:2])
    if u[2] != NEWTON:
        raise UnitError(f"delay_avatar takes a tangential force in N, not [{u[2]}]")
    return u[0], u[1], SECOND, SECOND


def check_avatar(b: Any) -> None:
    """Raise BadValue where the numbers of an avatar make no sense."""
    positive(b, "per_newton")
    if not b.notice >= 0:
        raise BadValue(f"delay_avatar: notice = {b.notice!r} must not be below 0")


class StreamParams(NamedTuple):
    fs: float
    per_newton: float  # samples
    notice: float
    catch_up: float
    most: float  # samples
    size: float  # of the history


class StreamState(NamedTuple):
    xs: np.ndarray
    ys: np.ndarray
    forces: np.ndarray
    at: np.uint64  # place of the newest sample
    lag: float  # samples
    owed: float  # samples still to stand
    low: float
    x: float
    y: float
    cold: float


def earlier(line, a, b, w):
    """Between the samples at a and b, the share w towards b."""
    return line[np.int64(a)] + w * (line[np.int64(b)] - line[np.int64(a)])


def before(i, n, size):
    """The place n samples before i in a ring."""
    return where(i < n, i - n + size, i - n)


@dataclass(frozen=True, eq=False)
class DelayAvatar(Block):
    """The device's place at a time u: a rise of the force at u stops u; then u runs
    faster until it has caught up.
    """

    px: Block
    py: Block
    force: Block
    contact: Block
    per_newton: float
    notice: float
    catch_up: float
    most: float
    outputs = ("x", "y", "lag", "wait")

    def check(self):
        check_avatar(self)
        positive(self, "catch_up", "most")

    def units(self, *u):
        return avatar_units(u)

    def design(self, fs):
        limits.check(
            "state_bytes",
            24 * self.most * fs,
            f"delay_avatar: bytes of its history at fs = {fs:g} Hz",
        )
        n = int(self.most * fs) + 2
        p = StreamParams(
            fs,
            self.per_newton * fs,
            self.notice * (1 - WIDER),
            self.catch_up,
            self.most * fs,
            float(n),
        )
        lines = np.zeros(n), np.zeros(n), np.zeros(n)
        return p, StreamState(*lines, np.uint64(0), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

    @staticmethod
    def step(p, s, px, py, force, contact):
        size = np.uint64(s.xs.size)
        at = where(s.at + ONE < size, s.at + ONE, NONE)
        i = np.int64(at)
        s.xs[i], s.ys[i], s.forces[i] = px, py, force
        # as it did at the last sample
        runs = where(contact > 0.0, where(s.cold > 0.0, 0.0, 1.0), 0.0) > 0.0
        owed, lag = where(runs, s.owed, 0.0), where(runs, s.lag, 0.0)
        stop = where(owed < 1.0, owed, 1.0)
        behind = lag + stop
        made_up = p.catch_up * (1.0 - stop)
        lag = where(made_up < behind, behind - made_up, 0.0)
        # a state may come from anywhere
        lag = where(lag > 0.0, where(lag < p.most, lag, p.most), 0.0)
        whole = floor(lag)
        a, w = before(as_float(at), whole, p.size), lag - whole
        b = before(a, 1.0, p.size)
        x, y, f = earlier(s.xs, a, b, w), earlier(s.ys, a, b, w), earlier(s.forces, a, b, w)
        low = where(runs, s.low, f)
        rise = where(f - low >= p.notice, f - low, 0.0)
        room = p.most - lag - (owed - stop)
        wait = where(
            rise > 0.0,
            where(p.per_newton * rise < room, p.per_newton * rise, where(room > 0.0, room, 0.0)),
            0.0,
        )
        on = contact > 0.0
        x, y, lag, wait = (
            where(on, x, s.x),
            where(on, y, s.y),
            where(on, lag, 0.0),
            where(on, wait, 0.0),
        )
        low = where(rise > 0.0, f, where(f < low, f, low))
        after = StreamState(
            s.xs, s.ys, s.forces, at, lag, owed - stop + wait, low, x, y, where(on, 0.0, 1.0)
        )
        return (x, y, lag / p.fs, wait / p.fs), after


class FrameParams(NamedTuple):
    fs: float
    per_newton: float  # s/N
    notice: float
    frame: float  # s


class FrameState(NamedTuple):
    x: float
    y: float
    force: float
    left: float  # samples until the next frame
    since: float  # samples since this one began
    cold: float


@dataclass(frozen=True, eq=False)
class FrameAvatar(Block):
    """Eq. (3) to the letter: the avatar stands where the device was as the frame began;
    a rise lengthens the frame.
    """

    px: Block
    py: Block
    force: Block
    contact: Block
    per_newton: float
    notice: float
    frame: float
    outputs = ("x", "y", "lag", "wait")

    def check(self):
        check_avatar(self)
        positive(self, "frame")

    def units(self, *u):
        return avatar_units(u)

    def design(self, fs):
        p = FrameParams(fs, self.per_newton, self.notice * (1 - WIDER), self.frame)
        return p, FrameState(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

    @staticmethod
    def step(p, s, px, py, force, contact):
        on = contact > 0.0
        begins = where(on, where(s.left < 0.5, 1.0, 0.0), 0.0) > 0.0
        rise = force - where(s.cold > 0.0, force, s.force)
        wait = where(begins, where(rise >= p.notice, p.per_newton * rise, 0.0), 0.0)
        x, y, f = where(begins, px, s.x), where(begins, py, s.y), where(begins, force, s.force)
        since = where(begins, 0.0, where(on, s.since + 1.0, 0.0))
        left = (
            where(s.left > -0.5, s.left, -0.5) + where(begins, (p.frame + wait) * p.fs, 0.0) - 1.0
        )
        after = FrameState(x, y, f, where(on, left, 0.0), since, where(on, 0.0, 1.0))
        return (x, y, since / p.fs, wait), after


@public
def delay_avatar(
    x: Block | float,
    y: Block | float,
    force: Block | float,
    law: str = "streaming",
    contact: Block | float = 1.0,
    per_newton: float = 0.5,
    notice: float = 0.1,
    catch_up: float = 1.0,
    most: float = 0.3,
    frame: float = FRAME,
) -> Any:
    """An avatar that stands still for t_d = m (rise of the tangential force), eq. (3),
    as a pen comes to a harder place.

    ``streaming``, ours, means the same at every sample rate: rises add up since the
    last stop, or since the lowest force after it; once they reach ``notice`` the avatar
    stands for m times their sum, then follows ``1 + catch_up`` times as fast as the
    device moved until it has caught up.  So it never jumps.  ``frames``: eq. (3) once
    per frame; the delay lengthens the frame, then the avatar jumps to the contact
    point.

    Parameters
    ----------
    x, y : Block
        Place of the device in m.
    force : Block
        Tangential force at that place in N, such as 0.4 N times the stiffness level;
        the streaming law takes it at the time that the avatar shows, so it is that
        where the avatar is.
    law : {"streaming", "frames"}
    contact : Block
        Where it is not above 0 the avatar stands (at 0 before the first contact); at
        re-contact it starts at the device's place.
    per_newton : float
        m in s/N: 50 ms per 0.1 N.
    notice : float
        Smallest rise in N that makes a stop; 0 stops continuously (streaming).
    catch_up, most : float
        Of the streaming law: how much faster it follows, and the longest lag in s.
    frame : float
        Of the law of frames, in s.

    Returns
    -------
    Block
        With the outputs ``x`` and ``y`` in m, ``lag`` in s, and ``wait``: events, the
        length in s of each stop where it is found.

    Raises
    ------
    BadValue
        An unknown law; numbers not above 0, a notice below.
    UnitError
        Places not in m, a force not in N.

    See Also
    --------
    vibration : the same events for the skin.

    References
    ----------
    Li et al. (2016), eq. (3): m = 50/0.1 = 500 in ms/N; 0.1 N is read as the threshold
    below which there is no delay.  When a lag ends is open there.

    Examples
    --------
    A force that steps by 0.2 N at 20 mm stops the avatar for 0.1 s:

    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import delay_avatar, where
    >>> x = stimlib.Input("x", "m")
    >>> f = stimlib.constant(0.2, "N") * (x > stimlib.constant(0.0195, "m"))
    >>> a = delay_avatar(x, stimlib.constant(0.0, "m"), f)
    >>> proc = stimlib.compile(stimlib.Scene({"x": a.x, "wait": a.wait}), fs=100)
    >>> place, wait = proc.process(np.arange(0.0, 0.06, 0.001)[None])
    >>> wait[20].round(9), 1000 * place[[19, 20, 25, 30, 31, 32, 40, 41]].round(9)
    (np.float64(0.1), array([19., 20., 20., 20., 22., 24., 40., 41.]))
    """
    signals = as_block(x), as_block(y), as_block(force), as_block(contact)
    if law == "streaming":
        return DelayAvatar(*signals, per_newton, notice, catch_up, most)
    if law == "frames":
        return FrameAvatar(*signals, per_newton, notice, frame)
    raise BadValue(f"delay_avatar: law = {law!r}; choose one of streaming, frames")


class VibrationParams(NamedTuple):
    factor: float
    per_ms: float


class VibrationState(NamedTuple):
    left: float  # samples


@dataclass(frozen=True, eq=False)
class Vibration(Block):
    """1 for as many whole ms as each event says, else 0."""

    wait: Block
    factor: float

    def check(self):
        positive(self, "factor")

    def units(self, *u):
        if u[0] != SECOND:
            raise UnitError(f"vibration takes events in s, the wait of delay_avatar, not [{u[0]}]")
        return u[0] / SECOND

    def design(self, fs):
        return VibrationParams(self.factor, fs / 1000), VibrationState(0.0)

    @staticmethod
    def step(p, s, wait):
        left = s.left + floor(1000.0 * (p.factor * wait) + 0.5) * p.per_ms
        return where(left >= 0.5, 1.0, 0.0), VibrationState(where(left >= 1.0, left - 1.0, 0.0))


@public
def vibration(wait: Block | float, factor: float = 1.0) -> Block:
    """Drive of a vibration motor: 1 for ``factor`` times the length of each stop of an
    avatar, in whole ms, else 0.

    Parameters
    ----------
    wait : Block
        Events in s: the ``wait`` of ``delay_avatar``.
    factor : float
        Ours: "proportionally" is all that is said.

    Raises
    ------
    BadValue
        A factor not above 0.
    UnitError
        Events that are not in s.

    Notes
    -----
    What is asked for while the motor runs is added to what is left, as the stops of the
    avatar add up.

    References
    ----------
    Li et al. (2016), "Vibration feedback for haptic interaction".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import vibration
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"drive": vibration(stimlib.Input("wait", "s"))}), fs=1000
    ... )
    >>> proc.process(np.array([[0.0, 0.0029, 0.0, 0.0, 0.0]]))
    array([[0., 1., 1., 1., 0.]])
    """
    return Vibration(as_block(wait), factor)
