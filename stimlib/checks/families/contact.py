"""Laws of forces over position: wall, click, detents, friction, impact.

A mean over a sample's way is a difference of integrals in extended precision here, a
slip is found one by one, and a vibration is a complex recursion; nothing of a block's
design or step is used.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import scipy

from ...analysis.recursion import all_pole
from .. import laws
from ..evidence import Asked, Check, law_of
from ..laws import ways
from ..rows import FADED, Row, before, law, near
from .surfaces import gratings

MANY = 10_000  # slips within one sample: their mean is taken at once
TOL, LEAST = 1e-6, 1e-12  # of the largest value, or of LEAST if there is nothing larger


def mean_over(
    last: np.ndarray,
    x: np.ndarray,
    integral: Callable[[Any], Any],
    value: Callable[[Any], Any],
    straight: np.ndarray,
) -> np.ndarray:
    """Return the mean from last to x of a function with a known integral.

    Where the function is linear, the mean is the value in the middle.
    """
    a, b = last.astype(np.longdouble), x.astype(np.longdouble)
    return np.where(
        straight, value((a + b) / 2), (integral(b) - integral(a)) / np.where(straight, 1, b - a)
    ).astype(float)


def wall(x: np.ndarray, contact: np.ndarray, fs: float, k: Any, b: Any, at: Any) -> np.ndarray:
    """Return the mean force of a wall, max(0, k p + b v) for p = x - at > 0.

    v is the mean speed during the sample.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.checks.families.contact import wall
    >>> wall(np.array([-1e-3, 1e-3, 2e-3]), np.ones(3), 1000.0, 1000.0, 2.0, 0.0).round(
    ...     6
    ... )
    array([0.  , 2.25, 3.5 ])
    """
    last, touching = ways(x, contact)
    w = b * (x - last) * fs
    with np.errstate(divide="ignore", invalid="ignore"):
        free = np.where(w < 0, -w / k, 0)  # less than this deep the damper takes away the spring
    never = np.isinf(free)  # there is none
    deep = np.where(never, 0, free)

    def integral(p: Any) -> Any:
        q = np.maximum(p - at, deep)
        return np.where(never, 0, (q - deep) * (k * (q + deep) / 2 + w))

    def value(p: Any) -> Any:
        return np.where(p - at > free, k * (p - at) + w, 0)

    straight = (last == x) | ((last - at > free) == (x - at > free))
    return np.where(touching, mean_over(last, x, integral, value, straight), 0)


def button(
    x: np.ndarray,
    contact: np.ndarray,
    peak: Any,
    drop: float,
    at: float,
    back: float,
    begins: float | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean force of a button, and where it is pressed.

    It becomes pressed at ``at`` and released below ``back``.

    If it started before the first sample, ``begins`` says whether it is pressed at
    first.
    """
    (last, touching), n = ways(x, contact), np.arange(x.size)
    on, off = touching & (x >= at), ~touching | (x < back)
    if begins is not None:
        on[0], off[0] = begins > 0, begins == 0
    pressed = np.maximum.accumulate(np.where(on, n, -1)) > np.maximum.accumulate(
        np.where(off, n, -1)
    )
    was = np.where(touching & np.r_[False, touching[:-1]], np.r_[False, pressed[:-1]], pressed)
    way = np.where(x == last, 1, np.abs(x - last))
    share = np.where(
        pressed == was, pressed, (np.maximum(x, last) - np.where(pressed, at, back)) / way
    )
    force = wall(x, contact, 1.0, np.asarray(peak) / at, 0.0, 0.0) - np.where(
        touching, peak * drop * share, 0
    )
    return force, pressed


def ringing(events: np.ndarray, fs: float, freq: float, decay: float) -> np.ndarray:
    """Return a decaying sinusoid started by each event.

    The decay time is at least one sample, as in ``ring``.
    """
    return scipy.signal.lfilter(
        [1], [1, -np.exp(-1 / max(decay * fs, 1.0) + 2j * np.pi * freq / fs)], events
    ).imag


def detents(x: np.ndarray, contact: np.ndarray, spacing: float, depth: Any) -> np.ndarray:
    """Return the mean force of detents, depth sin(2 pi x/spacing)."""
    last, touching = ways(x, contact)
    return np.where(touching, depth * gratings(last, x, np.array([[spacing, 1.0, 0.0]])), 0)


def springs(x: np.ndarray, k: Any, limit: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the stiffness and the largest deflection at each sample.

    The fraction of the last deflection that is kept when the stiffness changes is
    returned too.

    If the stiffness rises, the force is kept; if it falls, the deflection is kept; and
    without a positive stiffness nothing is kept.
    """
    k, limit = (np.maximum(np.broadcast_to(v, x.shape), 0) for v in (k, limit))
    some = np.where(k > 0, k, 1)
    most = np.where(k > 0, np.minimum(limit / some, 1e150), 0)
    return k, most, np.r_[1.0, np.where(k[1:] > 0, np.minimum(1, k[:-1] / some[1:]), 1)]


def dragged(
    x: np.ndarray,
    k: Any,
    contact: np.ndarray,
    limit: Any,
    slide: Callable[[int, float, float, float], tuple[float, float]],
    start: float = 0.0,
) -> np.ndarray:
    """Return the mean force of a spring that slips at a force limit.

    slide returns the deflection at the end of a path, and its mean.

    The deflection is 0 at the first sample of a contact, and ``start`` at sample 0.
    """
    z, y, (last, touching), (k, top, kept) = (
        start,
        np.zeros(x.size),
        ways(x, contact),
        springs(x, k, limit),
    )
    rows = (x - last).tolist(), top.tolist(), kept.tolist()
    for n, way, c, keep in zip(range(x.size), *rows, strict=True):
        if not touching[n]:
            z = 0.0
            continue
        z = min(max(z * keep, -c), c)
        if way < 0:
            after, mean = slide(n, -z, -way, c)
            z, y[n] = -after, -mean
        else:
            z, y[n] = slide(n, z, way, c)
    return k * y


def coulomb(_: int, z: float, a: float, c: float) -> tuple[float, float]:
    """Return the end and the mean deflection of Coulomb's law along a path.

    The path has the length a, and the spring slips at the deflection c.
    """
    if z + a <= c:
        return z + a, z + a / 2
    stuck = c - z
    return c, (z + stuck / 2) * (stuck / a) + c * ((a - stuck) / a) if a else z


def stick_slip(
    x: np.ndarray,
    contact: np.ndarray,
    k: Any,
    limit: Any,
    left: float,
    shown: np.ndarray,
    rest: bool = True,
) -> tuple[np.ndarray, int]:
    """Return the mean force of a spring that drops when it reaches its limit.

    It falls to a part of the limit, slip by slip. The sample from which the result
    holds is returned too.

    If the law does not start at rest, its result holds from the first contact on, or
    from two short paths in a row without a slip.

    Where a path ends at the limit within rounding, it may have slipped or not; the
    samples shown next decide. Where a very short path slips is also a matter of
    rounding, so what was shown counts in that range.
    """
    (last, touching), (k, c, kept) = ways(x, contact), springs(x, k, limit)
    d, y, z = x - last, np.zeros(x.size), 0.0
    tie = 0.0  # what a slip too few or too many would change
    fresh, ends = (
        touching & ~np.r_[touching[:1], touching[:-1]],
        shown / np.where(k > 0, k, 1) + d / 2,
    )
    short = np.abs(d) < c * (1 - left) / 4
    apart = np.abs(np.r_[0.0, ends[:-1]] * kept - (ends - d))
    stuck = (
        short
        & np.r_[False, (short & touching)[:-1]]
        & touching
        & (apart < 1e-10 * c)
        & (np.abs(ends) <= c)
    )
    begin = 0 if rest else int(np.argmax(np.r_[fresh | stuck, True]))
    for n in np.flatnonzero(touching[begin:]) + begin:
        if not (n and touching[n - 1]) or c[n] == 0:
            z, tie = 0.0, 0.0
        if c[n] == 0:
            continue
        tooth, z, tie = c[n] * (1 - left), z * kept[n], tie * kept[n]
        if n == begin and not fresh[n] and not rest:
            z = ends[n] - d[n]
        if tie:
            z = min(
                (z, z + tie),
                key=lambda v: abs(k[n] * _sawtooth(v, d[n], c[n], tooth)[0] - shown[n]),
            )
        mean, z = _sawtooth(z, d[n], c[n], tooth)
        y[n], tie = k[n] * mean, 0.0
        if d[n] and abs(shown[n] - y[n]) <= k[n] * tooth * 2.0**-49 * abs(x[n]) / abs(d[n]):
            y[n] = shown[n]
        if abs(abs(z) - c[n]) < 1e-9 * c[n]:
            tie = -np.sign(z) * tooth
        elif abs(abs(z) - (c[n] - tooth)) < 1e-9 * c[n] and d[n]:
            tie = math.copysign(tooth, d[n])
    return y, begin


def _sawtooth(z: float, d: float, c: float, tooth: float) -> tuple[float, float]:
    """Return the mean and the end of a sawtooth deflection along a path d from z.

    The deflection drops by one tooth whenever it reaches c.
    """
    s, a, area = (1.0 if d >= 0 else -1.0), abs(d), 0.0
    start = z = min(max(z, -c), c)
    rest = a
    while rest > (room := c - s * z):
        area, rest, z = area + room / a * (z + s * c) / 2, rest - room, s * (c - tooth)
        if rest > MANY * tooth:  # teeth that are smaller than what the way can tell would never end
            whole = rest - (math.fmod(rest, tooth) if tooth and math.isfinite(rest) else 0.0)
            area, rest = area + whole / a * s * (c - tooth / 2), rest - whole
    return (area + rest / a * (z + s * rest / 2) if a else start), z + s * rest


# The checks ---------------------------------------------------------------------------
def _held(a: Asked, name: str, what: str, parts: Iterable[np.ndarray], numbers: str) -> list[Check]:
    """Check an output against the sum of its parts."""
    a.say(numbers)
    return [a.near(name, sum(parts, np.zeros(a.n)), TOL, f"{what}, written again", LEAST)]


def _wall_of(a: Asked, x: np.ndarray, k: Any, b: Any, at: float) -> tuple[np.ndarray, str]:
    k, b = (np.maximum(np.broadcast_to(v, x.shape), 0) for v in (k, b))  # as the block counts them
    return (
        wall(x, a.contact, a.fs, k, b, at),
        f"a wall of {k[0]:.6g} N/m and {b[0]:.6g} N s/m at {at:.6g} m",
    )


def _vibration(a: Asked, events: np.ndarray) -> np.ndarray:
    return a.live("A") * ringing(events, a.fs, a.given["freq"], a.given["decay"])


@law_of("wall")
def wall_law(a: Asked) -> list[Check]:
    """Check the scene ``wall``."""
    force, numbers = _wall_of(a, a.x["x"], a.live("k"), a.live("b"), a.given["at"])
    pulls = float(np.max(np.where(a.window > 0, -a.y["force"], 0.0))) + 0.0  # no -0
    return [
        *_held(a, "force", "wall over place", [force], numbers),
        Check("e", f"{a.title('force')}: it never pulls", pulls, 0.0, "N"),
    ]


@law_of("click")
def click_law(a: Asked) -> list[Check]:
    """Check the scene ``click``."""
    x, g = a.x["x"], a.given
    force, pressed = button(x, a.contact, a.live("peak"), g["drop"], g["at"], g["back"])
    bottom, numbers = _wall_of(a, x, g["stiffness"], 0.0, g["travel"])
    events = pressed & ~np.r_[True, pressed[:-1]] & np.r_[False, a.contact[:-1] > 0]
    words = (
        f"a snap at {1e3 * g['at']:g} mm, back at {1e3 * g['back']:g} mm, {int(events.sum())} of"
        f" them; {numbers}"
    )
    return _held(
        a,
        "force",
        "button, bottom and vibration",
        [force, bottom, _vibration(a, events.astype(float))],
        words,
    )


@law_of("detents")
def detents_law(a: Asked) -> list[Check]:
    """Check the scene ``detents``."""
    x, g = a.x["angle"], a.given
    k = g["friction"] / g["presliding"]
    drawn = detents(x, a.contact, 2 * np.pi / g["count"], a.live("depth"))
    rubbed = dragged(x, k, a.contact, a.live("friction"), coulomb)
    words = f"{g['count']} detents a turn, friction over {k:g} N m"
    return _held(a, "torque", "detents and friction", [drawn, rubbed], words)


@law_of("friction")
def friction_law(a: Asked) -> list[Check]:
    """Check the scene ``friction``."""
    x, g = a.x["x"], a.given
    k, limit, left = (
        g["stiffness"],
        g["static"] * np.maximum(a.live("normal"), 0),
        g["kinetic"] / g["static"],
    )
    words = (
        f"it slips at {limit[0]:g} N, to {left * limit[0]:g} N, every"
        f" {1e3 * (1 - left) * limit[0] / k:.4g} mm"
    )
    return _held(
        a,
        "force",
        "sawtooth over place",
        [stick_slip(x, a.contact, k, limit, left, a.y["force"])[0]],
        words,
    )


@law_of("ultrasonic_friction")
def ultrasonic_friction_law(a: Asked) -> list[Check]:
    """Check the scene ``ultrasonic_friction``."""
    x, g, A = a.x["x"], a.given, a.live("A")
    u = x * (g["bumps"] / g["length"])  # so rounded as in the scene
    last, touching = ways(u, a.contact * (A != 0))
    slippery = laws.bump_envelope(last, u, "square", a.held("duty", 1e-6, 1.0))[0] * touching
    tau = g["q"] / (math.pi * g["freq"])
    top, bottom, _ = scipy.signal.cont2discrete(([1], [tau, 1]), 1 / a.fs, "foh")
    moved = g["per_volt"] * scipy.signal.lfilter(top[0], bottom, A * slippery)
    e = np.minimum(np.abs(moved) / g["gap"], math.sqrt(0.98))
    # Salbu: mean of 1/h times the root of the mean of h^3, h = 1 + e cos
    film = g["area"] * 101325.0 * (np.sqrt(1 + 1.5 * e**2) / np.sqrt(1 - e**2) - 1)
    load = np.maximum(a.live("normal") - film, 0)
    k = g["stiffness"]
    words = (
        f"vibration of up to {1e6 * np.abs(moved).max(initial=0.0):.3g} um, the finger presses with"
        f" {load.min(initial=np.inf):.3g} .. {load.max(initial=0.0):.3g} N"
    )
    rubbed = dragged(x, k, a.contact, g["mu"] * load, coulomb)
    return _held(a, "force", "friction on a film of air", [rubbed], words)


@law_of("impact")
def impact_law(a: Asked) -> list[Check]:
    """Check the scene ``impact``."""
    x, g = a.x["x"], a.given
    force, numbers = _wall_of(a, x, a.live("k"), g["b"], 0.0)
    speed = np.maximum(
        laws.squeeze_finger(x, np.zeros(a.n), a.contact, a.fs, 0.0, 0.0, g["cutoff"], 1.0, 0.0).v, 0
    )
    events = np.r_[False, (x[1:] > 0) & ~(x[:-1] > 0)]
    words = (
        f"impacts: {int(events.sum())}, of up to {speed[events].max(initial=0.0):.3g} m/s;"
        f" {numbers}"
    )
    return _held(a, "force", "wall and vibration", [force, _vibration(a, events * speed)], words)


@law("StaticLimit", since=lambda b, fs, x: FADED * b.tau * fs)
def _static_limit(b, fs, x, y):
    a, most = -np.expm1(-1 / (b.tau * fs)), b.limit**2
    mean = np.r_[0.0, all_pole(a, [a - 1], y**2)[0][:-1]]
    cap = math.sqrt(most * (0.81 + 0.19 / a))
    want = np.minimum(1.0, (most - mean) / (0.19 * most)) * np.clip(x[0], -cap, cap)
    return want, (1e-12 + 2.0**-50 * b.tau * fs) * max(float(np.abs(x[0]).max()), 1e-300)


@law("SlewLimit", since=1)
def _slew_limit(b, fs, x, y):
    last = np.r_[0.0, y[:-1]]
    return near(np.clip(x[0], last - b.rate / fs, last + b.rate / fs), 1e-15)


@law("ResponseLimit", since=lambda b, fs, x: b.response.size + 2 * b.every)
def _response_limit(b, fs, x, y):
    k = np.r_[np.zeros(b.every), b.response, np.zeros(b.every + -b.response.size % b.every)]
    want, after, step = np.empty(y.size), np.zeros(k.size), (b.slew or np.inf) * b.every / fs
    for n in range(y.size):
        seen = np.arange((-1 - x.at - n) % b.every, k.size, b.every)  # the bounded ones
        rows = np.array([[np.diff(v[seen]) / step, v[seen][1:] / b.most] for v in (after, k)])
        now, each = rows[:, np.abs(rows[1]) > 0]
        ends = np.sort([(1 - now) / each, (-1 - now) / each], axis=0)
        least, most = ends[0].max(initial=-np.inf), ends[1].min(initial=np.inf)
        want[n] = np.clip(x[0][n], min(least, 0.0), max(most, 0.0))
        after = np.append(after[1:] + k[1:] * y[n], 0.0)
    return near(want, 1e-9)


@law("Passive")
def _passive(b, fs, x, y):
    """Count what may be given: bound, work of what acted, charge of what did not."""
    creep, (part, whole) = b.speed / fs, math.modf(round(b.late * fs, 9))
    reach, sure, n = creep + b.encoder, np.inf if b.sure is None else b.sure, np.arange(y.size)

    def late(row, k):
        return np.r_[np.zeros(k), row][: y.size]

    # what may act in the place of each force, and how far the position may be from a
    # reading that stays
    near_by = [late(y, k) for k in range(b.lost + 1)]
    low, high = np.minimum(np.min(near_by, 0), sure), np.maximum(np.max(near_by, 0), -sure)
    size, last = np.maximum(-low, high), late(y, 1)
    moved = np.diff(x[1], prepend=x[1][:1])
    since = n - np.maximum.accumulate(np.where(moved == 0, 0, n))
    off, later = (creep * np.minimum(since + k, b.still * fs) for k in (0, math.ceil(part + whole)))
    then, known = late(off, 1), np.abs(moved) <= reach
    middle, changed = then + part * (off - then), np.abs(y - last) + np.abs(y) - np.abs(last)

    def acting(row):
        return part * late(row, int(whole) + 2) + (1 - part) * late(row, int(whole) + 1)

    now, before = late(y, int(whole) + 1), late(y, int(whole) + 2)
    work = np.where(
        known, np.where(moved > 0, acting(low), acting(high)) * moved, -acting(size) * reach
    )
    back = then * np.abs(before) - off * np.abs(now) - middle * np.abs(now - before)
    due = later * changed
    left = (
        b.bound
        + b.power / fs * (n + 1)
        + np.cumsum(work + reach * acting(size) + late(due, int(whole) + 1) + back * known)
        - np.cumsum(late(reach * size + b.encoder / 2 * changed + due, 1))
    )
    left = np.maximum(left, 0.0)
    short = np.clip(1 - 2 * left / b.bound, 0.0, 1.0) * known
    tops = [np.max([late(np.abs(y), k) for k in range(1, j + 2)], 0) for j in range(b.lost)]
    free, each = np.maximum(left - reach * np.sum(tops, 0), 0.0), reach * (b.lost + 1)
    rise, put = b.encoder + 2 * later, np.abs(last)
    other = free / (each + rise)
    own = np.where(each * put < free, (free + rise * put) / (each + rise), free / each)
    up, down = (np.minimum(np.where(s * last > 0, own, other), b.most * x[2]) for s in (1, -1))
    return near(np.clip(x[0] + x[2] * b.damping * fs * moved * short, -down, up), 1e-9)


@law("Detents", since=1)
def _detents(b, fs, x, y):
    size = np.abs(x[1]) * (1e-9 + 2.0**-44 * np.abs(x[0]) / b.spacing)
    return detents(x[0], x[2], b.spacing, x[1]), size


@law("Wall", since=1)
def _wall(b, fs, x, y):
    depth, k, damping, c, contact = x[0] - x[3], x[1], x[2], x[4], x[5]
    speed = (depth - before(depth, contact)) * fs
    grown = np.maximum(k, 0) * np.maximum(1 + np.maximum(c, 0) * speed, 0)
    return near(wall(depth, contact, fs, grown, np.maximum(damping, 0), 0.0), 1e-9)


@law("Button", since=1)
def _button(b, fs, x, y):
    force, pressed = button(x[0], x[2], x[1], b.drop, b.at, b.back, None if x.rest else y[1, 0])
    return np.array([force, pressed]), np.array([[near(force, 1e-9)[1]], [0.0]])


def forgotten(force: Callable[[float], Row], rest: bool) -> tuple[Row, Any]:
    """Return a force from rest, or from where it no longer depends on earlier samples.

    If the block started earlier, the force is known where both extremes of the initial
    state lead to the same value.
    """
    if rest:
        return near(force(0.0), 1e-13)  # of which (1 - exp(-a))/a loses 4e-14 where a is 0.01
    want, tol = near(force(1e200))
    return want, np.where(np.abs(want - force(-1e200)) < 0.1 * tol, tol, np.inf)


@law("Coulomb", since=1)
def _coulomb(b, fs, x, y):
    return forgotten(lambda z: dragged(x[0], x[2], x[3], x[1], coulomb, z), x.rest)


def _exponential(z: float, c: float, over: float, a: float) -> tuple[float, float]:
    """Return the end and the mean of dz = (c - z)/over da along a path of length a."""
    if over <= 0 or a == 0:
        return (z, z) if a == 0 else (c, c)
    r = a / over
    series = r / 2 - r**2 / 6 + r**3 / 24 - r**4 / 120 + r**5 / 720
    missing = series if r < 0.01 else 1 + math.expm1(-r) / r
    return z - (c - z) * math.expm1(-r), z + (c - z) * missing


@law("Dahl", since=1)
def _dahl(b, fs, x, y):
    return forgotten(
        lambda z: dragged(x[0], x[2], x[3], x[1], lambda n, z, a, c: _exponential(z, c, c, a), z),
        x.rest,
    )


@law("ElastoPlastic", since=1)
def _elasto_plastic(b, fs, x, y):
    def slide(n: int, z: float, a: float, c: float) -> tuple[float, float]:
        free = min(a, max(b.elastic * c - z, 0.0))
        rest = a - free
        end, mean = _exponential(z + free, c, c - b.elastic * c, rest)
        return end, free / a * (z + free / 2) + rest / a * mean if a else z

    return forgotten(lambda z: dragged(x[0], x[2], x[3], x[1], slide, z), x.rest)


@law("LuGre", since=1)
def _lugre(b, fs, x, y):
    place, limit, static, k, contact = x
    moved = np.zeros(y.size)

    def slide(n: int, z: float, a: float, c: float) -> tuple[float, float]:
        g = min(max(limit[n], 0.0) / k[n], 1e150) if k[n] > 0 else 0.0
        end, mean = _exponential(z, g, g, a) if g > 0 else (0.0, 0.0)
        moved[n] = end - z
        return end, mean

    way = np.where(contact > 0, place - before(place, contact), 0)

    def force(z: float) -> Row:
        return dragged(place, k, contact, static, slide, z) + fs * (
            b.damping * np.where(way < 0, -1, 1) * moved + b.viscosity * way
        )

    return forgotten(force, x.rest)


@law("Stribeck", "StribeckPower", since=1)
def _stribeck(b, fs, x, y):
    v = np.abs(x[0] - before(x[0], x[2])) * fs / b.speed
    # at the cap the exponential is 0
    fall = np.exp(-(np.minimum(v, 1e150 ** (1 / b.exponent)) ** b.exponent))
    return near(np.where(x[2] > 0, x[1] * (1 + b.rise * fall), 0))


@law("StickSlip", since=1)
def _stick_slip(b, fs, x, y):
    want, begin = stick_slip(x[0], x[3], x[2], x[1], b.left, y, x.rest)
    return want, np.where(np.arange(y.size) < begin, np.inf, near(want, TOL)[1])
