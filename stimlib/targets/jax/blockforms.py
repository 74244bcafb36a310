"""Whole-signal implementations of the primitive blocks for JAX.

Banks of modes and taps are products with small matrices.

``LOWERINGS`` maps a block class to a function (block, p, s, x, run) -> y, where p, s
come from ``design``, x are arrays (n,) or scalars (the same at all samples), contact
last for a resettable block, and y is one or the other.  A class without one runs its
step, see ``recurrence``.  Blocks of others join with ``LOWERINGS[MyBlock] =
my_function``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ...blocks import fractional, fractional as pot, noise
from ...blocks.contact import ResponseLimit
from ...blocks.filters import Cascade, Delay, Fir, First
from ...blocks.impedance import Gate
from ...blocks.movement import sinpi
from ...blocks.noise import FilteredNoise, Modes
from ...blocks.oscillators import QUARTER, WORD, Carrier, fold, rectified
from ...blocks.soft import Cursor, DelayAvatar
from ...blocks.sources import Grain, Ring
from ...blocks.surfaces import SpatialNoise
from ...blocks.texture import Texture
from ...blocks.viscoelastic import KelvinChain, MaxwellArms, Series
from ...core.graph import AtLeast, Block, Greater
from ...core.guard import Guard
from ...core.program import lead
from . import placeforms, signalforms, textureforms, traced
from .recurrence import SHORT

TILE = 64  # samples per row of a matrix product


class Run(NamedTuple):
    """Data of a run that an implementation may need besides its block."""

    n: int  # samples on this clock
    fs: float
    key: Any  # of the run, uint64
    dtype: Any  # of noise and of long sums
    surrogate: float | None  # relative width of a gate's smoothed edge; None: its derivative is 0


# Linear time-invariant parts ----------------------------------------------------------
def rows(x: Any, size: int) -> Any:
    """Reshape a signal (n,) to (tiles, size), padded with zeros at the end."""
    return jnp.pad(x, (0, -x.shape[0] % size)).reshape(-1, size)


def spread(x: Any, n: int) -> Any:
    """Return a number as an array of n samples."""
    return jnp.broadcast_to(x, (n,))


def later(x: Any, by: int, before: Any = 0.0) -> Any:
    """Delay a signal by some samples; the first samples are ``before``."""
    n = x.shape[0]
    return jnp.concatenate([jnp.broadcast_to(jnp.asarray(before, x.dtype), (by,)), x])[:n]


def decay(a: np.ndarray, v: Any, first: Any) -> Any:
    """Return the states before each update of the recursion s' = a s + v.

    a (k,) holds numbers of at most 1, v is (n, k), first (k,).
    """
    n, k = v.shape
    factor = jnp.asarray(a, v.dtype)
    if n <= SHORT:
        return lax.scan(lambda s, v: (factor * s + v, s), first, v)[1]
    m = math.isqrt(n)
    length = -(-n // m)
    v = jnp.pad(v, ((0, length * m - n), (0, 0))).reshape(m, length, k).swapaxes(0, 1)
    q, qs = lax.scan(lambda s, v: (factor * s + v, s), jnp.zeros((m, k), v.dtype), v)
    starts = decay(a**length, q, first)
    power = jnp.asarray(a ** np.arange(length)[:, None], v.dtype)
    return (power[:, None] * starts + qs).swapaxes(0, 1).reshape(m * length, k)[:n]


def toeplitz(h: Any, xp: Any) -> Any:
    """Return the lower triangular Toeplitz matrix T[i, j] = h[i - j]."""
    d = np.arange(h.shape[0])[:, None] - np.arange(h.shape[0])
    return xp.where(d >= 0, h[np.maximum(d, 0)], 0.0)


def bank(e: np.ndarray, r: Any, x: Any, dtype: Any, direct: float = 0.0, first: Any = None) -> Any:
    """Run a bank of modes, q_k += x - e_k q_k; y = direct x + sum_k r_k q_k, in tiles.

    y = T x + R a^i q(start), q(end) = a^64 q(start) + E x.
    """
    xp: Any = jnp
    if isinstance(r, np.ndarray):
        xp, e, r = np, e[r != 0], r[r != 0]
        if not e.size:
            return direct * x
    j = np.arange(1, TILE + 1)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        # of the poles
        powers = np.concatenate(
            [np.ones((1, e.size)), np.where(e < 1, np.exp(j * np.log1p(-e)), (1 - e) ** j)]
        )
    h = xp.asarray(powers[:TILE]) @ r
    T = toeplitz(h, xp) + direct * np.eye(TILE)
    u = rows(x.astype(dtype), TILE)
    q0 = jnp.zeros(e.size, dtype) if first is None else jnp.asarray(first).astype(dtype)
    q = decay(powers[TILE], u @ jnp.asarray(powers[TILE - 1 :: -1], dtype), q0)
    y = u @ jnp.asarray(T.T, dtype) + q @ jnp.asarray((powers[1:] * r).T, dtype)
    return y.reshape(-1)[: x.shape[0]]


def taps_tiles(taps: np.ndarray, x: Any) -> Any:
    """Run an FIR filter as a banded Toeplitz matrix over tiles.

    y[n] = sum_k taps[k] x[n-k]; each tile needs those before it.

    The result has the type of x: taps may take small differences, which are meaningful
    for noise in float32 but not for a position.
    """
    n, m = x.shape[0], taps.size
    before = -(-(m - 1) // TILE)
    k = before * TILE + np.arange(TILE) - np.arange((before + 1) * TILE)[:, None]
    B = jnp.asarray(np.where((k >= 0) & (k < m), taps[np.clip(k, 0, m - 1)], 0.0), x.dtype)
    tiles = jnp.pad(rows(x, TILE), ((before, 0), (0, 0)))
    count = tiles.shape[0] - before
    parts = [tiles[j : j + count] @ B[j * TILE : (j + 1) * TILE] for j in range(before + 1)]
    return sum(parts[1:], parts[0]).reshape(-1)[:n]


def running(x: Any) -> Any:
    """Return the sum of all earlier samples at each sample.

    Whole numbers stay exact; those of a gate are summed as a product with a matrix of
    ones.
    """
    u = rows(x, TILE)
    if x.dtype == jnp.bool_:
        u, x = u.astype(jnp.int32), x.astype(jnp.int32)
        inside = (
            u.astype(jnp.float32) @ jnp.asarray(np.triu(np.ones((TILE, TILE))), jnp.float32)
        ).astype(jnp.int32)
    else:
        inside = jnp.cumsum(u, axis=1)
    if u.shape[0] == 1:
        tops = jnp.zeros((1,), x.dtype)
    else:
        tops = (
            running(inside[:, -1])
            if u.shape[0] > TILE
            else jnp.cumsum(inside[:, -1]) - inside[:, -1]
        )
    return (inside - u + tops[:, None]).reshape(-1)[: x.shape[0]]


def latest(mark: Any) -> Any:
    """Return the index of the last marked sample at each sample, or -1."""
    at = jnp.where(mark, jnp.arange(mark.shape[0], dtype=jnp.int32), -1)
    u = jnp.pad(at, (0, -at.shape[0] % TILE), constant_values=-1).reshape(-1, TILE)
    inside = lax.cummax(u, axis=1)
    before = later(lax.cummax(inside[:, -1]), 1, -1)
    return jnp.maximum(inside, before[:, None]).reshape(-1)[: mark.shape[0]]


def fir(b, p, s, x, run):
    """Run the block ``Fir``."""
    taps = p.taps[::-1][: int(p.order) + 1]
    return taps_tiles(taps, spread(x[0], run.n))


def grain(b, p, s, x, run):
    """Run the block ``Grain``."""
    return taps_tiles(p.shape, spread(x[0], run.n))


def modes(b, p, s, x, run):
    """Run the block ``Modes``."""
    return bank(1 - p.p, p.r, spread(x[0], run.n), run.dtype, p.d)


def pink(b, p, s, x, run):
    """Run pink noise as a bank of modes, starting from its stationary state."""
    if not isinstance(b.white, noise.White):
        return modes(b, p, s, x, run)
    from ...design.noise import cholesky, stationary_covariance

    live = p.r != 0
    e = 1 - p.p[live]
    g = deviates(stream_key(run.key, *b.white.noise_key, 1), 0, e.size, jnp.float64)
    q = jnp.asarray(cholesky(stationary_covariance(e))) @ g
    return bank(1 - p.p, p.r, spread(x[0], run.n), run.dtype, p.d, q)


# Noise --------------------------------------------------------------------------------
U = np.uint64
# integers are made in so long rows: a loop over rows, or XLA would make them anew for
# every use, five times
PAIRS = 4096


def stream_key(run_key: Any, seed: int, stream: int, use: int) -> Any:
    """Return ``noise.noise_key`` for a traced key of the run."""
    own = seed & 0xFFFFFFFF, seed >> 32, stream, use
    words = *map(U, own), run_key & noise.LOW, run_key >> noise.HALF_WORD
    c = noise.philox(*(jnp.asarray(w, jnp.uint64) for w in words))
    return c[0] | (c[1] << noise.HALF_WORD)


def integers(key: Any, m: Any) -> tuple[Any, Any]:
    """Return the two random words of each pair m of a stream, as on any target."""
    return traced.bind(noise.pair_of_words)(key, m)


def deviates(key: Any, start: int, n: int, dtype: Any) -> Any:
    """Return the normal deviates start .. start + n - 1 of a stream.

    start may be below 0.
    """
    odd = start % 2
    pairs = (n + odd + 1) // 2
    m = jnp.asarray(U((start % 2**64) >> 1)) + jnp.arange(pairs, dtype=jnp.uint64)
    m = rows(m & U(2**63 - 1), min(pairs, PAIRS))  # after pair -1 comes pair 0
    radius, turn = (f if dtype == jnp.float32 else traced.bind(g) for f, g in SHORT_FORMS)
    words = lax.map(lambda m: integers(key, m), m)
    r, (c, d) = lax.map(lambda w: (radius(w[0]), turn(w[1])), words)
    r, c, d = (v.reshape(-1)[:pairs] for v in (r, c, d))
    return jnp.stack([r * c, r * d], axis=-1).reshape(-1)[odd : odd + n]


def short_radius(a: Any) -> Any:
    """Compute ``noise.radius`` in float32.

    It is log(1 - v) where u is near 1, so that small radii keep their digits.
    """
    u, v = a.astype(jnp.float32), (~a).astype(jnp.float32)
    near = jnp.log1p(-(v + 0.5) * np.float32(2.0**-64))
    return jnp.sqrt(
        -2 * jnp.where(a >> U(63) > 0, near, jnp.log((u + np.float32(0.5)) * np.float32(2.0**-64)))
    )


def short_turn(b: Any) -> tuple[Any, Any]:
    """Compute ``noise.turn`` in float32, from the same integers."""
    v = ((b >> noise.SHIFT_11) & noise.BITS_51).astype(jnp.int64) - (1 << 50)
    angle = v.astype(jnp.float32) * np.float32(2.0**-53 * 2 * math.pi)
    quarter = b >> noise.SHIFT_62
    c, s = jnp.cos(angle), jnp.sin(angle)
    odd = (quarter & U(1)) != 0
    x0, x1 = jnp.where(odd, s, c), jnp.where(odd, c, s)
    return jnp.where(((quarter + U(1)) & U(2)) != 0, -x0, x0), jnp.where(quarter > U(1), -x1, x1)


SHORT_FORMS = (short_radius, noise.radius), (short_turn, noise.turn)


def white(b, p, s, x, run):
    """Run the block ``White``."""
    return deviates(stream_key(run.key, b.seed, b.stream, 0), -lead(run.fs), run.n, run.dtype)


# Gates --------------------------------------------------------------------------------
def smoothed(exact: Any, distance: Any, width: Any) -> Any:
    """Return a gate's exact value, with the derivative of a smooth edge.

    The derivative is that of 1/(1 + exp(-distance/width)).
    """
    soft = jax.nn.sigmoid(distance / lax.stop_gradient(width))
    return lax.stop_gradient(exact) + (soft - lax.stop_gradient(soft))


def gate(b, p, s, x, run):
    """Run a gate: open after a rise above ``on``, until a fall to ``off``."""
    v = spread(x[0], run.n)
    event = (v > p.on) | ~(v > p.off)
    at = latest(event)
    g = jnp.where((at >= 0) & (v[at] > p.on), 1.0, 0.0)
    if run.surrogate is None:
        return g
    return smoothed(g, v - jnp.where(later(g, 1) > 0, p.off, p.on), run.surrogate * p.on)


def comparison(b, p, s, x, run):
    """Run a comparison, which may have a smoothed derivative."""
    y = traced.bind(type(b).step)(p, (), *x)[0]
    if run.surrogate is None or not (jnp.ndim(x[0]) or jnp.ndim(x[1])):
        return y
    distance = spread(x[0] - x[1], run.n)
    return smoothed(y, distance, run.surrogate * jnp.sqrt(jnp.mean(distance**2) + 1e-300))


def guard(b, p, s, x, run):
    """Run the guard, which fades out the last finite value from a fault on."""
    v = spread(x[0], run.n)
    i = jnp.arange(run.n)
    bad = v - v != 0
    at = jnp.where(bad.any(), jnp.argmax(bad), run.n)
    last = jnp.where(at > 0, v[jnp.maximum(at - 1, 0)], 0.0)
    left = jnp.maximum(p.m - (i - at), 0.0)
    return jnp.where(i < at, v, last * (left / p.m)).astype(run.dtype)


def delay(b, p, s, x, run):
    """Run the block ``Delay``."""
    return later(spread(x[0], run.n), min(int(p.n), run.n)) if p.n < run.n else jnp.zeros(run.n)


# Contact: where a history begins ------------------------------------------------------
def steady(contact: Any) -> bool:
    """Return whether contact is a plain number above 0, so that it lasts for ever."""
    return isinstance(contact, (float, np.floating)) and bool(contact > 0)


class History(NamedTuple):
    """The position since contact, as arrays."""

    on: Any  # in contact
    start: Any  # where this contact began
    d: Any  # movement in this sample, 0 off contact
    way: Any  # movement since contact, 0 off contact


def history(x: Any, contact: Any, cold: float, n: int) -> History:
    """Return the movements since contact.

    If ``cold`` was above 1 before the first contact, the history starts with a step
    from 0.
    """
    x = spread(x, n)
    if steady(contact):
        first = jnp.where(cold > 1, 0.0, x[0])
        return History(jnp.ones(n, bool), jnp.zeros(n, int), x - later(x, 1, first), x - first)
    on = spread(jnp.asarray(contact) > 0, n)
    fresh = on & ~later(on, 1, False)
    start = latest(fresh)
    first = jnp.where((start == jnp.argmax(fresh)) & (cold > 1), 0.0, x[start])
    d = jnp.where(on, x - jnp.where(fresh, first, later(x, 1)), 0.0)
    return History(on, start, d, jnp.where(on, x - first, 0.0))


def maxwell_arms(b, p, s, x, run):
    """Run the block ``MaxwellArms``."""
    h = history(x[0], x[1], s.cold, run.n)
    if steady(x[1]):
        return bank(p.e, p.r, h.d, run.dtype)
    a, r = jnp.asarray(1 - p.e, run.dtype), jnp.asarray(p.r, run.dtype)

    def body(q, d):
        q = a * q + d
        return q, jnp.sum(r * q)

    return in_contact(body, jnp.zeros(a.size, run.dtype), h.on, h.d.astype(run.dtype))


def in_contact(body: Callable, start: Any, on: Any, *rows: Any) -> Any:
    """Run a loop over samples in contact, ``state, y = body(state, *row)``.

    Off contact the state is ``start`` and y is 0.
    """

    def sample(s, row):
        on, *x = row
        after, y = body(s, *x)
        return jax.tree.map(lambda a, b: jnp.where(on, a, b), after, start), jnp.where(on, y, 0.0)

    return lax.scan(sample, start, (on, *rows))[1]


def kelvin_chain(b, p, s, x, run):
    """Run the block ``KelvinChain``."""
    f = spread(x[0], run.n)
    return bank(p.e, p.r, later(f, 1), run.dtype) + p.d * f


# Springpots ---------------------------------------------------------------------------
class HistoryWeights(NamedTuple):
    """The history weights of a springpot of fixed order."""

    r: Any  # of the modes
    taps: Any  # v_7 .. v_0
    constant: Any  # of the mode that never decays
    scale: Any  # fs^alpha


def springpot(b, p, s, x, run):
    """Run the block ``Springpot``."""
    h = history(x[0], x[1], s.cold, run.n)
    if p.alpha in (0.0, 1.0):
        return h.d * p.fs if p.alpha else h.way
    w = HistoryWeights(p.r, p.taps, p.constant, p.scale)
    if steady(x[1]):
        return whole_history(p.e, w, h, run)
    return _scan_history(p.e, lambda a: w, 0.5, h, run)


def whole_history(e: np.ndarray, w: HistoryWeights, h: History, run: Run) -> Any:
    """Return a springpot's sum over all movements: eight taps, then modes.

    The modes start eight samples later.
    """
    near = sum(w.taps[7 - j] * later(h.d, j) for j in range(8))
    return w.scale * (near + w.constant * later(h.way, 8) + bank(e, w.r, later(h.d, 8), run.dtype))


def springpot_live(b, p, s, x, run):
    """Run ``SpringpotLive``: its weights depend on the order, its modes do not."""
    alpha = jnp.asarray(x[1])
    alpha = jnp.where(alpha >= 0, jnp.where(alpha <= 1, alpha, 1.0), 0.0)
    h = history(x[0], x[2], s.cold, run.n)
    if steady(x[2]) and not jnp.ndim(alpha):
        y = whole_history(p.e, weights(p, alpha), h, run)
    else:
        y = _scan_history(p.e, lambda a: weights(p, a), alpha, h, run)
    ends = jnp.where(alpha > 0.5, h.d * p.fs, h.way)
    exact = jnp.where((alpha == 0) | (alpha == 1), ends, y)
    # the order's derivative is that of the sum, also at 0 and 1
    y = y + lax.stop_gradient(exact - y)
    return jnp.where(h.on, jnp.where(alpha == x[1], y, jnp.nan), 0.0)


def weights(p: pot.LiveParams, alpha: Any) -> HistoryWeights:
    """Compute the weights of ``fractional.reweigh`` for all modes at once."""
    m, power, poly = int(p.nodes), traced.bind(pot.power), p.poly.reshape(pot.COEFFICIENTS, -1)
    t, left, a, b = 2.0 * alpha - 1.0, 1.0 - alpha, 0.0, 0.0
    for row in poly[:0:-1]:
        a, b = 2.0 * t * a + (row - b), a
    series = t * a + (poly[0] - b)
    gain = jnp.sin(math.pi * jnp.where(alpha > 0.5, left, alpha)) / math.pi
    g = jnp.concatenate([left * series[8 : 8 + m], jnp.broadcast_to(gain, (p.a.size - m,))])
    r = g * p.a * power(alpha, p.high, p.rest)
    taps = series[:8] * jnp.concatenate([jnp.broadcast_to(left, (7,)), jnp.ones(1)])
    return HistoryWeights(r[1:], taps, r[0], power(alpha, p.fs_high, p.fs_rest))


def _scan_history(e: np.ndarray, weigh: Callable, alpha: Any, h: History, run: Run) -> Any:
    """Run ``whole_history`` from rest at each contact, as a loop over samples.

    The order may be a signal.
    """
    a = jnp.asarray(1 - e)
    moving = jnp.ndim(alpha) > 0

    def body(state, d, order):
        line, q, total = state
        line, q, total = jnp.concatenate([line[1:], d[None]]), a * q + line[0], total + line[0]
        w = weigh(order if moving else alpha)
        return (line, q, total), w.scale * (
            jnp.sum(w.taps * line) + w.constant * total + jnp.sum(w.r * q)
        )

    return in_contact(
        body, (jnp.zeros(8), jnp.zeros(e.size), jnp.zeros(())), h.on, h.d, spread(alpha, run.n)
    )


def series(b, p, s, x, run):
    """Run ``Series`` as a loop that solves for the inner displacement per sample."""
    h = history(x[0], x[1], s.cold, run.n)
    a = jnp.asarray(1 - p.e)

    def body(state, d, way):
        # movements of the springpot, its modes, its way until 8 samples ago and now
        line, q, total, z = state
        q, total = a * q + line[0], total + line[0]
        rest = jnp.sum(p.taps[:7] * line[1:]) + p.constant * total + jnp.sum(p.r * q)
        u = d if p.dashpot else way - z
        step = (p.other * u - p.pot * rest) / (p.other + p.pot * p.newest)
        return (jnp.concatenate([line[1:], step[None]]), q, total, z + step), p.pot * (
            p.newest * step + rest
        )

    start = jnp.zeros(8), jnp.zeros(p.e.size), jnp.zeros(()), jnp.zeros(())
    return in_contact(body, start, h.on, h.d, h.way)


def short_memory(b, p, s, x, run):
    """Run the block ``ShortMemory``."""
    h = history(x[0], x[1], s.cold, run.n)
    if steady(x[1]):
        return taps_tiles(p.taps[::-1], h.way)
    taps = jnp.asarray(p.taps)

    def body(line, z):
        line = jnp.concatenate([line, z[None]])
        return line[1:], jnp.sum(taps * line)

    return in_contact(body, jnp.zeros(p.taps.size - 1), h.on, h.way)


def downsampled(b, p, s, x, run):
    """Run the block ``Downsampled``, one weight at a time."""
    h = history(x[0], x[1], s.cold, run.n)
    i = jnp.arange(run.n)
    k = i - h.start
    m = jnp.maximum((k + fractional.POINTS - 1) // fractional.POINTS, 1)

    def body(total, jw):
        j, w = jw
        inside = j * m <= k
        return total + jnp.where(inside, w * h.way[jnp.where(inside, i - j * m, 0)], 0.0), None

    total = lax.scan(body, jnp.zeros(run.n), (jnp.arange(p.weights.size), jnp.asarray(p.weights)))[
        0
    ]
    y = p.scale * jnp.exp(-p.alpha * jnp.log(m.astype(jnp.float64))) * total
    return jnp.where(h.on, jnp.where(k < s.past.size, y, jnp.nan), 0.0)


# Carrier ------------------------------------------------------------------------------
TOP_BITS = U(0xFFFFFFFFF8000000)


def lost(a: Any, b: Any) -> Any:
    """Return the exact rounding error of the product a b.

    The factors are split into halves of 26 bits, whose products are exact.
    """
    split = traced.bits
    high = [traced.unbits(split(jnp.asarray(v, jnp.float64)) & TOP_BITS) for v in (a, b)]
    low = [v - h for v, h in zip((a, b), high, strict=True)]
    return ((high[0] * high[1] - a * b) + (high[0] * low[1] + low[0] * high[1])) + low[0] * low[1]


def increment(p: Any, g: Any) -> Any:
    """Compute ``carrier.increment`` for a frequency within 0 .. fs/2."""
    main = g * p.high
    whole = jnp.floor(main)
    rest = jnp.floor((main - whole) + (g * p.low + lost(g, p.high)) + 0.5)
    return whole.astype(jnp.uint64) + rest.astype(jnp.int64).astype(jnp.uint64)


def carrier(b, p, s, x, run):
    """Run the block ``Carrier``, with integer phases as on any target.

    The derivative is that of the sum of the frequencies.
    """
    f, contact = x
    count = jnp.maximum(jnp.arange(run.n) - int(s.wait), 0)  # samples that have moved the phase
    held = jnp.where(f > 0, jnp.where(f < p.top, f, p.top), 0.0)
    turns = held / run.fs  # per sample
    inc = lax.stop_gradient(increment(p, held))
    if jnp.ndim(f):
        counts = jnp.arange(run.n) >= int(s.wait)
        phase = running(jnp.where(counts, inc, U(0)))
        way = running(jnp.where(counts, turns, 0.0))
    else:
        phase = count.astype(jnp.uint64) * inc
        way = count * turns
    x0 = phase + jnp.asarray(s.phase, jnp.uint64)

    def sound(f, way, turns, contact):
        rising = (x0 + QUARTER) >> U(63) == 0
        t = traced.bind(fold)(x0) + jnp.where(rising, 2.0, -2.0) * (way - lax.stop_gradient(way))
        q = traced.as_float(inc) * WORD + (turns - lax.stop_gradient(turns))
        # at 0 Hz no sample lies over a zero crossing
        half = traced.bind(sinpi)(jnp.where(q > 0, q, 0.5))
        y = traced.bind(rectified)(p.mode, t, q, 1.0 / half)
        return jnp.where(contact > 0, jnp.where(f - f == 0, y, f - f), 0.0)

    return traced.run(sound, jnp.asarray(f), way, turns, jnp.asarray(contact))


def response_limit(b, p, s, x, run):
    """Run the block ``ResponseLimit``."""
    k, per = (jnp.asarray(v).reshape(-1, p.keep.size) for v in (p.k, p.per))

    def sample(carry, x):
        ahead, at = carry
        ends = jnp.sort(jnp.array([(1 - ahead) * per[at], (-1 - ahead) * per[at]]), axis=0)
        y = jnp.clip(x, jnp.minimum(ends[0].max(), 0.0), jnp.maximum(ends[1].min(), 0.0))
        rest, after = ahead + k[at] * jnp.where(jnp.isfinite(x), y, 0.0), (at + 1) % b.every
        rest = jnp.where(after == 0, p.keep * jnp.append(rest[1:], 0.0), rest)
        return (rest, after), jnp.where(jnp.isfinite(x), y, x)

    return lax.scan(sample, (jnp.zeros(p.keep.size), 0), spread(x[0], run.n))[1]


LOWERINGS: dict[type[Block], Callable] = {
    noise.White: white,
    FilteredNoise: pink,
    Modes: modes,
    Fir: fir,
    Delay: delay,
    Carrier: carrier,
    Cascade: signalforms.cascade,
    Grain: grain,
    Ring: signalforms.ring,
}
LOWERINGS |= {
    First: lambda b, p, s, x, run: spread(x[0], run.n)[0],
    Gate: gate,
    Greater: comparison,
    AtLeast: comparison,
    Guard: guard,
    ResponseLimit: response_limit,
    SpatialNoise: placeforms.spatial_noise,
    Cursor: signalforms.cursor,
    DelayAvatar: signalforms.avatar,
}
LOWERINGS |= {
    MaxwellArms: maxwell_arms,
    KelvinChain: kelvin_chain,
    Series: series,
    pot.Springpot: springpot,
    pot.SpringpotLive: springpot_live,
    fractional.Downsampled: downsampled,
    fractional.ShortMemory: short_memory,
    Texture: textureforms.texture,
}
