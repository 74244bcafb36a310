"""The laws of soft surfaces: the map by FITPACK's spline, the avatars step by step."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core.graph import Input, constant
from ..evidence import Asked, Check, law_of
from ..rows import ULP, begun, law, near

Row = NDArray[np.float64]


SOFTEST, HARDEST, DEEPEST = 400.0, 1200.0, 0.015
"""What ``soft_surface`` gives way, in N/m at the levels 0 and 1, and in m at most."""
FRAME, SPEEDS = 0.03, (0.05, 2.0)
"""Of eq. (1) to the letter: a frame in s, and between which speeds the cursor is
held.
"""
TIE = 1e-6  # samples: so near to a frame's beginning, what was seen says whether it has begun


def levels(table: Row, width: float, height: float) -> Callable[[Any, Any], Row]:
    """Return S(x, y) of a table, clamped at the edges and between 0 and 1."""
    rows, columns = table.shape
    y, x = np.linspace(0, height, rows), np.linspace(0, width, columns)
    spline = scipy.interpolate.RectBivariateSpline(
        y, x, table, kx=min(3, rows - 1), ky=min(3, columns - 1), s=0
    )
    return lambda px, py: np.clip(spline.ev(np.clip(py, 0, height), np.clip(px, 0, width)), 0, 1)


def speed_ratio(S: Any) -> Any:
    """Return the step of eq. (1) from level 0 to S, relative to that from 0 to 0."""
    return (1.1 - S) / (1 + S) / 1.1


def starts(on: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the first samples of contacts."""
    return on & ~np.r_[False, on[:-1]]


def reversible(
    S: Callable, x: Row, y: Row, px: Row, py: Row, on: NDArray[np.bool_], piece: float = math.inf
) -> tuple[float, int]:
    """Return the largest error of a reversible cursor's steps, starts and holds.

    Its steps are dx = g(S(middle)) dp. The error is relative to the largest dp. The
    number of steps that are too long to judge is returned too.

    For steps longer than a piece of the map (in m), five steps of Newton's method may
    be too few.
    """
    ds, dp = np.diff([x, y]), np.diff([px, py])
    g = speed_ratio(S((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2))
    moves = on[1:] & on[:-1]
    far = np.hypot(*dp)
    long = moves & ((far > piece) | (far * steepest(S, np.array([x, y])[:, :-1], dp) > 0.5))
    scale = max(float(np.abs(dp[:, moves]).max(initial=0.0)), 1e-6)
    wrong = np.abs(ds - g * dp)[:, moves & ~long].max(initial=0.0) / scale
    begin = starts(on)
    jump = max(np.abs(x - px)[begin].max(initial=0.0), np.abs(y - py)[begin].max(initial=0.0))
    still = np.abs(ds[:, ~on[1:]]).max(initial=0.0)
    return float(max(wrong, jump / scale, still / scale)), int(long.sum())


def steepest(S: Callable, place: Row, way: Row) -> Row:
    """Return the steepest slope of the displacement ratio along each path.

    For steps longer than its inverse, the midpoint may not be unique.
    """
    h = 1e-6  # in m
    along = way / np.maximum(np.hypot(*way), 1e-300)
    ends = [
        speed_ratio(S(*(place + k * way + s * h * along))) for k in (0, 0.5, 1) for s in (-1, 1)
    ]
    return np.max(
        [np.abs(b - a) / (2 * h) for a, b in zip(ends[::2], ends[1::2], strict=True)],
        axis=0,
        initial=0.0,
    )


def by_frames(
    S: Callable,
    seen: Row,
    hand: Row,
    on: NDArray[np.bool_],
    frame: float,
    bounds: tuple[float, float],
) -> Row:
    """Return the cursor's position by eq. (1) taken literally, shape (2, n).

    Each step starts from the position that was seen; frame is in samples.
    """
    out, here, last_hand = seen[:, [0, *range(on.size - 1)]], np.zeros(2), np.zeros(2)
    due, speed, last = 0.0, 1.0, 0.0
    for n in np.flatnonzero(on):
        here = seen[:, n - 1]
        if n == 0 or not on[n - 1]:
            out[:, n] = last_hand = hand[:, n]
            last, speed, due = float(S(*last_hand)), 1.0, n + frame
        elif n > due - 0.5 + TIE or (n > due - 0.5 - TIE and (seen[:, n] != here).any()):
            level = float(S(*here))
            change = abs(level - last)
            if change > 1e-9:  # the levels' rounding is no step
                speed = (
                    speed * (1.1 - level) / (1 + change) if level > last else speed / (1.1 - change)
                )
            speed = min(max(speed, bounds[0]), bounds[1])
            out[:, n] = here + speed * (hand[:, n] - last_hand)
            last_hand, last, due = hand[:, n], level, max(due, n - 0.5) + frame
    if not on[0]:
        out[:, 0] = 0.0
    return out


def delayed(
    rows: Iterable[Row], waits: Row, on: NDArray[np.bool_], fs: float, b: Any
) -> tuple[Row, Row, Row]:
    """Return the avatar by eq. (3), for the streaming law.

    rows are x, y and force, and waits are the waits that were seen. The result is its
    positions (2, n), the waits due, and the lag.

    The next pause depends on the time of the last one, so rounding errors grow from
    pause to pause; each is therefore compared given those that were seen.
    """
    x, y, f = (r.tolist() for r in rows)
    n, most = len(x), b.most * fs
    out, due, late = np.zeros((2, n)), np.zeros(n), np.zeros(n)
    lag = owed = low = 0.0
    here = (0.0, 0.0)
    for k in range(n):
        if on[k]:
            first = k == 0 or not on[k - 1]
            stop = min(owed, 1.0)
            owed = 0.0 if first else owed - stop
            lag = 0.0 if first else min(max(lag + stop - (1 - stop) * b.catch_up, 0.0), most)
            i = k - math.ceil(lag)
            j, w = min(i + 1, k), math.ceil(lag) - lag
            here = (x[i] + w * (x[j] - x[i]), y[i] + w * (y[j] - y[i]))
            force = f[i] + w * (f[j] - f[i])
            low = force if first else low
            rise = force - low
            asked = (
                max(0.0, min(b.per_newton * rise * fs, most - lag - owed)) / fs if rise > 0 else 0.0
            )
            near = abs(rise - b.notice) <= 1e-8 * (b.notice + abs(force))  # either will do
            stops = waits[k] > 0 if near else rise > b.notice
            due[k] = asked if stops else 0.0
            owed += waits[k] * fs
            low = force if stops else min(low, force)
            late[k] = lag / fs
        out[:, k] = here
    return out, due, late


def delayed_by_frames(
    rows: Iterable[Row],
    waits: Row,
    on: NDArray[np.bool_],
    fs: float,
    b: Any,
    seen: Row | None = None,
) -> tuple[Row, Row, Row]:
    """Return the avatar by eq. (3) taken literally; see ``delayed``.

    Where rounding decides whether a frame has started, the lag that was seen tells.
    """
    x, y, f = rows
    out, due, late = np.zeros((2, x.size)), np.zeros(x.size), np.zeros(x.size)
    ends, last, here, began = 0.0, 0.0, (0.0, 0.0), 0
    for k in range(x.size):
        first = on[k] and (k == 0 or not on[k - 1])
        begins = seen is None or seen[k] == 0
        if first or (on[k] and (k > ends - 0.5 + TIE or (k > ends - 0.5 - TIE and begins))):
            rise = 0.0 if first else f[k] - last
            near = abs(rise - b.notice) <= 1e-8 * (b.notice + abs(f[k]))  # either will do
            due[k] = b.per_newton * rise if (waits[k] > 0 if near else rise > b.notice) else 0.0
            ends = (k if first else max(ends, k - 0.5)) + (b.frame + waits[k]) * fs
            last, here, began = f[k], (x[k], y[k]), k
        out[:, k], late[k] = here, (k - began) / fs if on[k] else 0.0
    return out, due, late


def motor(waits: Row, fs: float, factor: float) -> Row:
    """Return the drive of a motor: 1 for a whole number of ms per delay, else 0.

    The delays follow one another.
    """
    out, left = np.zeros(waits.size), 0.0
    for k, wait in enumerate(waits):
        left += math.floor(1000 * factor * wait + 0.5) * fs / 1000
        out[k] = left >= 0.5
        left = max(left - 1.0, 0.0)
    return out


@law_of("soft_surface")
def soft_surface(a: Asked) -> list[Check]:
    """Check avatars, depths, force and drive of ``soft_surface``.

    They follow from the inputs and the requested numbers.
    """
    g, hand, pen = a.given, np.array([a.x["x"], a.x["y"]]), a.given["device"] == "pen"
    touch = a.x.get("contact", a.x["press"] if pen else np.ones(a.n))
    on = touch > 0
    table, (width, height) = np.array(g["S"][0]), g["S"][1:]
    a.say(f"{table.shape[1]} x {table.shape[0]} levels over {1e3 * width:g} x {1e3 * height:g} mm")
    S = levels(table, width, height)
    push = 0.1008 * np.exp(4.2081 * np.minimum(a.x["press"], 1.0)) if pen else a.live("push")
    force = np.where(on, push, 0.0)
    several = g["mode"] == "multipoint"
    checks = [a.near("force", force, 1e-12, "eq. (2)" if pen else "the mouse pushes as it is told")]
    checks += _triangle(a, hand) if several else _avatar(a, S, hand, on)
    for i in range(1, 4):
        if f"depth{i}" in a.y:
            k = SOFTEST + (HARDEST - SOFTEST) * S(a.y[f"x{i}"], a.y[f"y{i}"])
            want = np.minimum(force / (3 if several else 1) / k, DEEPEST)
            checks.append(a.near(f"depth{i}", want, 1e-10, f"f/k, {SOFTEST:g} to {HARDEST:g} N/m"))
    return checks


def _triangle(a: Asked, hand: Row) -> list[Check]:
    """Check the three positions around the hand."""
    arm = a.given["side"] / math.sqrt(3)
    a.say(f"triangle of {1e3 * a.given['side']:.4g} mm")
    checks = []
    for i in range(3):
        turn = math.pi / 2 + 2 * math.pi * i / 3
        for name, row, way in (
            (f"x{i + 1}", hand[0], math.cos(turn)),
            (f"y{i + 1}", hand[1], math.sin(turn)),
        ):
            checks.append(a.near(name, row + arm * way, 1e-12, "of a triangle about the hand"))
    return checks


def _avatar(a: Asked, S: Callable, hand: Row, on: NDArray[np.bool_]) -> list[Check]:
    """Check the single avatar: at the hand, behind it, or slower."""
    g, checks = a.given, list[Check]()
    places, text = hand, "the hand itself"
    if g["device"] == "pen" and g["mode"] != "deformation":
        lagging, checks = _waits(a, S, hand, on)
        if g["mode"] != "vibration":
            places, text = lagging, "the hand of some time ago"
    elif g["mode"] != "deformation":
        # a window hides the first sample alone
        seen = np.where(a.window > 0, [a.y["x1"], a.y["y1"]], hand * on)
        if not g["frames"]:
            rows, columns = np.shape(g["S"][0])
            piece = min(g["S"][1] / max(columns - 1, 1), g["S"][2] / max(rows - 1, 1))
            error, long = reversible(S, seen[0], seen[1], hand[0], hand[1], on, piece)
            if long:
                a.e.skipped.append(
                    f"{a.title('x1')}: {long} steps of the hand are too long for one middle"
                )
            return [
                Check(
                    "d",
                    f"{a.title('x1')}, y1: steps of the reversible cursor",
                    error,
                    1e-9 + a.slack,
                    "of the largest step",
                )
            ]
        places, text = by_frames(S, seen, hand, on, FRAME * a.fs, SPEEDS), "eq. (1), frame by frame"
    return [
        *checks,
        *(a.near(name, row, 1e-9, text) for name, row in zip(("x1", "y1"), places, strict=True)),
    ]


def _waits(a: Asked, S: Callable, hand: Row, on: NDArray[np.bool_]) -> tuple[Row, list[Check]]:
    """Check the positions of an avatar that pauses, and how long it pauses.

    It pauses, or the motor vibrates, for as long as eq. (3) says.

    Rounding errors of a pause grow from one to the next, so the pauses are those of a
    block that the law makes from the requested numbers.
    """
    from ...blocks import delay_avatar, stiffness_map
    from ...blocks.soft import Levels

    g, tangent = a.given, a.given["tangent"]
    a.say(f"{tangent:g} N tangential at S = 1")
    x, y = Input("x", "m"), Input("y", "m")
    f_t = constant(tangent, "N") * stiffness_map(x, y, Levels(np.array(g["S"][0]), *g["S"][1:]))
    touching = Input("contact") if "contact" in a.x else Input("press") > 0.0
    avatar: Any = delay_avatar(x, y, f_t, "frames" if g["frames"] else "streaming", touching)
    waits, block = a.render(avatar.wait), getattr(avatar, "block", avatar)
    law = delayed_by_frames if g["frames"] else delayed
    places, due, _ = law((*hand, tangent * S(*hand)), waits, on, a.fs, block)
    checks = [
        Check("d", "waits of the avatar", float(np.abs(waits - due).max()), 1e-9, "s, eq. (3)")
    ]
    if g["mode"] == "vibration":
        wrong = a.far(motor(waits, a.fs, 1.0) - a.y["vibration"])
        checks.append(
            Check(
                "e",
                f"{a.title('vibration')}: as long as the delays",
                wrong,
                a.slack,
                "1 where a sample is wrong",
            )
        )
    return places, checks


@law("Dent", since=0)
def _dent(b, fs, x, y):
    rho, d, r = np.abs(x[0]), x[1], b.radius
    foot = np.maximum(2 * r, d)  # where the skirt of a ball that is deeper than its radius ends
    with np.errstate(invalid="ignore", divide="ignore"):
        ball = np.maximum(d - r + np.sqrt(np.maximum(r * r - rho * rho, 0)), 0)
        skirt = np.where(d > r, np.maximum((d - r) * (foot - rho) / (foot - r), 0), 0)
    want = np.where(rho <= r, ball, skirt)
    want = np.where(d <= (1 - math.sqrt(0.75)) * r, 0, want)  # nobody else's place is so near
    return near(np.where(d > 0, np.where(rho == 0, d, want), 0))


@law("Vibration", since=0)
def _vibration(b, fs, x, y):
    want = motor(x[0], fs, b.factor)
    # where it is off, nothing is left
    return want, np.where(x.rest | (want > 0) | (np.cumsum(y == 0) > 0), 0.0, np.inf)


@law("Cursor", since=1)
def _cursor(b, fs, x, y):
    S, on, hand = levels(b.levels, b.width, b.height), x[2] > 0, np.array(x[:2])
    last = np.c_[np.zeros((2, 1)), y[:, :-1]]
    way = np.diff(hand, prepend=0.0)
    first = starts(on)
    ratio = speed_ratio(S(*((last + y) / 2)))
    want = np.where(first, hand, np.where(on, last + ratio * way, last))
    scale = max(float(np.abs(way[:, on & ~first]).max(initial=0.0)), 1e-6)
    piece = min(v / (n - 1) for v, n in zip((b.height, b.width), b.levels.shape, strict=True))
    far = np.hypot(*way)  # beyond a piece of the map five steps of Newton's method may be too few
    tol = 1e-12 * scale + 8 * ULP * float(np.abs(y).max())  # otherwise they reach the last digits
    return want, np.where(on & ((far > piece) | (far * steepest(S, last, way) > 0.5)), np.inf, tol)


@law("CursorFrames", since=1)
def _cursor_frames(b, fs, x, y):
    S = levels(b.levels, b.width, b.height)
    want = by_frames(S, y, np.array(x[:2]), x[2] > 0, b.frame * fs, (b.slowest, b.fastest))
    return want, begun(x, near(want, 1e-9)[1])


@law("DelayAvatar", "FrameAvatar", since=1)
def _avatars(b, fs, x, y):
    if type(b).__name__ == "DelayAvatar":
        places, due, lag = delayed(x[:3], y[3], x[3] > 0, fs, b)
    else:
        places, due, lag = delayed_by_frames(x[:3], y[3], x[3] > 0, fs, b, y[2])
    size = max(float(np.abs(places).max(initial=0.0)), 1e-300)
    return np.array([*places, lag, due]), begun(x, 1e-9 * np.array([[size], [size], [1.0], [1.0]]))
