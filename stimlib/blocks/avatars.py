"""An avatar that lags behind a pen where an object becomes harder, and a vibration."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..core.graph import NONE, ONE, Block, as_block, in_unit
from ..core.maths import as_float, floor, where
from ..core.units import unit
from ..errors import Above0, From0, UnitError, public
from ..system.limits import limits
from .cursors import FRAME
from .soft import check_places

SECOND, NEWTON = unit("s"), unit("N")
WIDER = 1e-9  # a rise that is the smallest but for its rounding counts


@dataclass(frozen=True, eq=False)
class Avatar(Block, abstract=True):
    """An avatar that stops where the force on the device rises."""

    px: Block
    py: Block
    force: Block
    contact: Block
    per_newton: Above0
    notice: From0
    outputs = ("x", "y", "lag", "wait")

    def units(self, *u):
        check_places("delay_avatar", *u[:2])
        if u[2] != NEWTON:
            raise UnitError(f"delay_avatar takes a tangential force in N, not [{u[2]}]")
        return u[0], u[1], SECOND, SECOND


# Parameters of `DelayAvatar` at a sample rate.
#   per_newton  samples
#   most        samples
#   size        of the history
StreamParams = namedtuple("StreamParams", "fs per_newton notice catch_up most size")

# State of `DelayAvatar` between samples.
#   at    place of the newest sample
#   lag   samples
#   owed  samples still to stand
StreamState = namedtuple("StreamState", "xs ys forces at lag owed low x y cold")


def earlier(line, a, b, w):
    """Return a position interpolated between samples a and b, with weight w for b."""
    return line[np.uint64(a)] + w * (line[np.uint64(b)] - line[np.uint64(a)])


def before(i, n, size):
    """Return the index n samples before i in a ring buffer."""
    return where(i < n, i - n + size, i - n)


@dataclass(frozen=True, eq=False)
class DelayAvatar(Avatar):
    """An avatar at the position that the device had at an earlier time u, a signal.

    A rise of the force stops u; then u advances faster than time until it has caught
    up.
    """

    catch_up: Above0
    most: Above0

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
        s.xs[at], s.ys[at], s.forces[at] = px, py, force
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


# Parameters of `FrameAvatar` at a sample rate.
#   per_newton  s/N
#   frame       s
FrameParams = namedtuple("FrameParams", "fs per_newton notice frame")

# State of `FrameAvatar` between samples.
#   left   samples until the next frame
#   since  samples since this one began
FrameState = namedtuple("FrameState", "x y force left since cold")


@dataclass(frozen=True, eq=False)
class FrameAvatar(Avatar):
    """An avatar at the device's position at the start of each frame, by eq. (3).

    A rise of the force lengthens the frame. Eq. (3) of the paper is taken literally.
    """

    frame: Above0

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
    law: Literal["streaming", "frames"] = "streaming",
    contact: Block | float = 1.0,
    per_newton: float = 0.5,
    notice: float = 0.1,
    catch_up: float = 1.0,
    most: float = 0.3,
    frame: float = FRAME,
) -> Any:
    """Move an avatar that pauses when a pen moves on to a harder position.

    It pauses for t_d = m (rise of the tangential force), eq. (3).

    ``streaming`` is our law and gives the same result at every sample rate: rises add
    up since the last pause, or since the lowest force after it; once they reach
    ``notice`` the avatar pauses for m times their sum, then follows the path ``1 +
    catch_up`` times as fast as the device moved until it has caught up. So it never
    jumps. ``frames`` is eq. (3) once per frame; the delay lengthens the frame, then the
    avatar jumps to the contact point.

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
    return FrameAvatar(*signals, per_newton, notice, frame)


# Parameters of `Vibration` at a sample rate.
VibrationParams = namedtuple("VibrationParams", "factor per_ms")

# State of `Vibration` between samples.
#   left  samples
VibrationState = namedtuple("VibrationState", "left")


@dataclass(frozen=True, eq=False)
class Vibration(Block):
    """The drive of a vibration motor: 1 for a whole number of ms after each event."""

    wait: Block
    factor: Above0

    def units(self, *u):
        in_unit("vibration: wait", self.wait, u[0], "s")  # of delay_avatar
        return u[0] / SECOND

    def design(self, fs):
        return VibrationParams(self.factor, fs / 1000), VibrationState(0.0)

    @staticmethod
    def step(p, s, wait):
        left = s.left + floor(1000.0 * (p.factor * wait) + 0.5) * p.per_ms
        return where(left >= 0.5, 1.0, 0.0), VibrationState(where(left >= 1.0, left - 1.0, 0.0))


@public
def vibration(wait: Block | float, factor: float = 1.0) -> Block:
    """Drive a vibration motor for ``factor`` times the length of each avatar pause.

    The drive is 1 for that time, rounded to whole ms, else 0.

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
