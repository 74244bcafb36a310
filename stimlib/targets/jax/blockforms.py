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

from ...blocks import noise, springpots as pot
from ...blocks.actuator import Passive, ResponseLimit
from ...blocks.avatars import DelayAvatar
from ...blocks.creep import KelvinChain
from ...blocks.cursors import Cursor
from ...blocks.filters import Cascade, Delay
from ...blocks.fir_filters import Fir
from ...blocks.impedance import Gate
from ...blocks.movement import sinpi
from ...blocks.noise import FilteredNoise, Modes
from ...blocks.onset import First
from ...blocks.oscillators import QUARTER, WORD, Carrier, fold, rectified
from ...blocks.series import Series
from ...blocks.sources import Grain, Ring
from ...blocks.surfaces import SpatialNoise
from ...blocks.texture import Texture
from ...blocks.viscoelastic import MaxwellArms
from ...core.graph import AtLeast, Block, Greater
from ...core.guard import Guard
from ...core.silence import Sounding
from . import placeforms, signalforms, textureforms, traced
from .recurrence import SHORT, run_step, scan_arrays

TILE = 64  # samples per row of a matrix product


class Run(NamedTuple):
    """Data of a run that an implementation may need besides its block."""

    n: int  # samples on this clock
    fs: float
    key: Any  # of the run, uint64
    dtype: Any  # of noise and of long sums
    surrogate: float | None  # relative width of a gate's smoothed edge; None: its derivative is 0


# Linear time-invariant parts ----------------------------------------------------------
def rows(signal: Any, size: int) -> Any:
    """Reshape a signal (n,) to (tiles, size), padded with zeros at the end."""
    return jnp.pad(signal, (0, -signal.shape[0] % size)).reshape(-1, size)


def spread(value: Any, count: int) -> Any:
    """Return a number as an array of so many samples."""
    return jnp.broadcast_to(value, (count,))


def later(signal: Any, samples: int, before: Any = 0.0) -> Any:
    """Delay a signal by some samples; the first samples are ``before``."""
    count = signal.shape[0]
    return jnp.concatenate(
        [jnp.broadcast_to(jnp.asarray(before, signal.dtype), (samples,)), signal]
    )[:count]


def decay(poles: np.ndarray, drive: Any, first: Any) -> Any:
    """Return the states before each update of the recursion s' = a s + v.

    a is ``poles`` (k,), numbers of at most 1; v is ``drive`` (n, k); first is (k,).
    """
    count, modes = drive.shape
    factor = jnp.asarray(poles, drive.dtype)
    # a short recursion is a plain loop: two axes would cost more than they save
    if count <= SHORT:
        return lax.scan(lambda state, drive: (factor * state + drive, state), first, drive)[1]
    # the time axis becomes two of about its root: all blocks run side by side from a
    # state of 0, their starts follow from one another by the same recursion, with poles
    # to the power of a block's length, and are added, decayed. A loop over all samples
    # would wait for itself at each of them.
    blocks = math.isqrt(count)
    length = -(-count // blocks)
    drive = (
        jnp.pad(drive, ((0, length * blocks - count), (0, 0)))
        .reshape(blocks, length, modes)
        .swapaxes(0, 1)
    )
    sums, all_sums = lax.scan(
        lambda state, drive: (factor * state + drive, state),
        jnp.zeros((blocks, modes), drive.dtype),
        drive,
    )
    starts = decay(poles**length, sums, first)
    power = jnp.asarray(poles ** np.arange(length)[:, None], drive.dtype)
    return (
        (power[:, None] * starts + all_sums).swapaxes(0, 1).reshape(blocks * length, modes)[:count]
    )


def toeplitz(response: Any, module: Any) -> Any:
    """Return the lower triangular Toeplitz matrix T[i, j] = response[i - j]."""
    # in numpy where the response is known now: then XLA gets a constant
    lag = np.arange(response.shape[0])[:, None] - np.arange(response.shape[0])
    return module.where(lag >= 0, response[np.maximum(lag, 0)], 0.0)


def bank(
    leaks: np.ndarray, weights: Any, signal: Any, dtype: Any, direct: float = 0.0, first: Any = None
) -> Any:
    """Run a bank of modes, q_k += x - e_k q_k; y = direct x + sum_k r_k q_k, in tiles.

    e are the leaks, r the weights, and a = 1 - e the poles:
    y = T x + R a^i q(start), q(end) = a^64 q(start) + E x.
    """
    module: Any = jnp
    if isinstance(weights, np.ndarray):
        # a mode of weight 0 fills up a group of eight for compiled code; here it would
        # be a column of zeros
        module, leaks, weights = np, leaks[weights != 0], weights[weights != 0]
        if not leaks.size:
            return direct * signal
    exponent = np.arange(1, TILE + 1)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        # of the poles
        # 1 - e has lost the digits of a small leak, log1p has not; a leak of 1 or more
        # has no logarithm
        powers = np.concatenate(
            [
                np.ones((1, leaks.size)),
                np.where(leaks < 1, np.exp(exponent * np.log1p(-leaks)), (1 - leaks) ** exponent),
            ]
        )
    # three products for each tile: its own samples, what the state at its start still
    # gives, and what the tile leaves in the state. So only the states at starts of
    # tiles are a recursion, one step in 64 samples.
    response = module.asarray(powers[:TILE]) @ weights
    matrix = toeplitz(response, module) + direct * np.eye(TILE)
    tiles = rows(signal.astype(dtype), TILE)
    start = jnp.zeros(leaks.size, dtype) if first is None else jnp.asarray(first).astype(dtype)
    # the newest sample has decayed least: the powers run backwards
    states = decay(powers[TILE], tiles @ jnp.asarray(powers[TILE - 1 :: -1], dtype), start)
    output = tiles @ jnp.asarray(matrix.T, dtype) + states @ jnp.asarray(
        (powers[1:] * weights).T, dtype
    )
    return output.reshape(-1)[: signal.shape[0]]


def taps_tiles(taps: np.ndarray, signal: Any) -> Any:
    """Run an FIR filter as a banded Toeplitz matrix over tiles.

    y[n] = sum_k taps[k] x[n-k]; each tile needs those before it.

    The result has the type of x: taps may take small differences, which are meaningful
    for noise in float32 but not for a position.
    """
    length, order = signal.shape[0], taps.size
    # how many whole tiles the taps reach back
    before = -(-(order - 1) // TILE)
    lag = before * TILE + np.arange(TILE) - np.arange((before + 1) * TILE)[:, None]
    band = jnp.asarray(
        np.where((lag >= 0) & (lag < order), taps[np.clip(lag, 0, order - 1)], 0.0), signal.dtype
    )
    # each product takes the tiles from another start on: nothing is copied into
    # overlapping rows
    tiles = jnp.pad(rows(signal, TILE), ((before, 0), (0, 0)))
    count = tiles.shape[0] - before
    parts = [
        tiles[tile : tile + count] @ band[tile * TILE : (tile + 1) * TILE]
        for tile in range(before + 1)
    ]
    return sum(parts[1:], parts[0]).reshape(-1)[:length]


def running(signal: Any) -> Any:
    """Return the sum of all earlier samples at each sample.

    Whole numbers stay exact; those of a gate are summed as a product with a matrix of
    ones.
    """
    tiles = rows(signal, TILE)
    if signal.dtype == jnp.bool_:
        # at most 64 ones, whose sum float32 holds exactly
        tiles, signal = tiles.astype(jnp.int32), signal.astype(jnp.int32)
        inside = (
            tiles.astype(jnp.float32) @ jnp.asarray(np.triu(np.ones((TILE, TILE))), jnp.float32)
        ).astype(jnp.int32)
    else:
        inside = jnp.cumsum(tiles, axis=1)
    last = inside[:, -1]
    # what all tiles before add: again a sum, over one number for each tile
    tops = running(last) if last.size > TILE else jnp.cumsum(last) - last
    return (inside - tiles + tops[:, None]).reshape(-1)[: signal.shape[0]]


def latest(marks: Any) -> Any:
    """Return the index of the last marked sample at each sample, or -1."""
    marked = jnp.where(marks, jnp.arange(marks.shape[0], dtype=jnp.int32), -1)
    tiles = jnp.pad(marked, (0, -marked.shape[0] % TILE), constant_values=-1).reshape(-1, TILE)
    inside = lax.cummax(tiles, axis=1)
    # an index grows with time, so the latest is the largest so far; in two levels, as
    # in running
    before = later(lax.cummax(inside[:, -1]), 1, -1)
    return jnp.maximum(inside, before[:, None]).reshape(-1)[: marks.shape[0]]


def modes(block, numbers, state, signals, run):
    """Run the block ``Modes``."""
    return bank(1 - numbers.p, numbers.r, spread(signals[0], run.n), run.dtype, numbers.d)


def pink(block, numbers, state, signals, run):
    """Run pink noise as a bank of modes, starting from its stationary state."""
    if not isinstance(block.white, noise.White):
        return modes(block, numbers, state, signals, run)
    from ...design.noise import cholesky, stationary_covariance

    # drawn as FilteredNoise.start draws them: from the stream of its noise under
    # another use of the key, and in float64 whatever the run computes in
    live = numbers.r != 0
    leaks = 1 - numbers.p[live]
    draws = deviates(stream_key(run.key, *block.white.noise_key, 1), 0, leaks.size, jnp.float64)
    first = jnp.asarray(cholesky(stationary_covariance(leaks))) @ draws
    return bank(1 - numbers.p, numbers.r, spread(signals[0], run.n), run.dtype, numbers.d, first)


# Noise --------------------------------------------------------------------------------
U = np.uint64
# words become deviates in so long rows: a loop over rows, or XLA would make the words
# anew for every use, five times
PAIRS = 4096


def stream_key(run_key: Any, seed: int, stream: int, counter_use: int) -> Any:
    """Return ``noise.noise_key`` for a traced key of the run."""
    counter = seed & 0xFFFFFFFF, seed >> 32, stream, counter_use
    words = *map(U, counter), run_key & noise.LOW, run_key >> noise.HALF_WORD
    drawn = noise.philox(*(jnp.asarray(word, jnp.uint64) for word in words))
    return drawn[0] | (drawn[1] << noise.HALF_WORD)


def deviates(key: Any, start: int, count: int, dtype: Any) -> Any:
    """Return the normal deviates start .. start + count - 1 of a stream.

    start may be below 0.
    """
    skipped = start % 2
    pairs = (count + skipped + 1) // 2
    indices = jnp.asarray(U((start % 2**64) >> 1)) + jnp.arange(pairs, dtype=jnp.uint64)
    # a pair has two deviates: the first may be in the middle of one
    indices = rows(indices & U(2**63 - 1), min(pairs, PAIRS))  # after pair -1 comes pair 0
    radius, turn = (
        short if dtype == jnp.float32 else traced.bind(exact) for short, exact in SHORT_FORMS
    )
    first, second = traced.bind(noise.pair_of_words)(key, indices)  # as on any target
    # a loop each: one of both, or one that makes the words too, takes a sixth longer
    radii, (cosine, sine) = lax.map(radius, first), lax.map(turn, second)
    radii, cosine, sine = (column.reshape(-1)[:pairs] for column in (radii, cosine, sine))
    return jnp.stack([radii * cosine, radii * sine], axis=-1).reshape(-1)[skipped : skipped + count]


def short_radius(first: Any) -> Any:
    """Compute ``noise.radius`` in float32.

    It is log(1 - v), of the complement v, where u is near 1, so that small radii keep
    their digits.
    """
    upper, lower = first.astype(jnp.float32), (~first).astype(jnp.float32)
    # the complement of the integer counts down from the top, where a float32 has no
    # digits left for it
    near = jnp.log1p(-(lower + 0.5) * np.float32(2.0**-64))
    return jnp.sqrt(
        -2
        * jnp.where(
            first >> U(63) > 0, near, jnp.log((upper + np.float32(0.5)) * np.float32(2.0**-64))
        )
    )


def short_turn(second: Any) -> tuple[Any, Any]:
    """Compute ``noise.turn`` in float32, from the same integers."""
    centred = ((second >> noise.SHIFT_11) & noise.BITS_51).astype(jnp.int64) - (1 << 50)
    # at most an eighth of a turn; the two upper bits say to which quarter it is added
    angle = centred.astype(jnp.float32) * np.float32(2.0**-53 * 2 * math.pi)
    quarter = second >> noise.SHIFT_62
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    swapped = (quarter & U(1)) != 0
    one, other = jnp.where(swapped, sine, cosine), jnp.where(swapped, cosine, sine)
    return jnp.where(((quarter + U(1)) & U(2)) != 0, -one, one), jnp.where(
        quarter > U(1), -other, other
    )


SHORT_FORMS = (short_radius, noise.radius), (short_turn, noise.turn)


def heard(block, contact):
    """Return the contact of a source; it is 1 where a product alone makes the silence.

    Where A is 0, the derivative of A x with respect to A is x.
    """
    return 1.0 if isinstance(block.contact, Sounding) else contact


def white(block, numbers, state, signals, run):
    """Run the block ``White``."""
    first = int(np.int64(state.n))  # below 0 before sample 0
    return deviates(stream_key(run.key, block.seed, block.stream, 0), first, run.n, run.dtype)


# Gates --------------------------------------------------------------------------------
def smoothed(exact: Any, distance: Any, relative: float, level: float = 0.0) -> Any:
    """Return a gate's exact value, with the derivative of a smooth edge.

    The derivative is that of 1/(1 + exp(-distance/width)). The width is a fraction of
    |level|, or of the rms distance where that is 0. Where a distance is not finite, or
    all are 0, the derivative is 0.
    """
    near = jnp.where(jnp.isfinite(distance), distance, 0.0)
    squares = lax.stop_gradient(near) ** 2
    width = relative * (abs(level) or jnp.sqrt(jnp.mean(squares)))
    # its own value is added and taken away again: what is left of it is the derivative
    soft = jax.nn.sigmoid(near / jnp.where(width > 0, width, jnp.inf))
    return lax.stop_gradient(exact) + (soft - lax.stop_gradient(soft))


def gate(block, numbers, state, signals, run):
    """Run a gate: open after a rise above ``on``, until a fall to ``off``."""
    signal = spread(signals[0], run.n)
    # not above off, rather than below: a NaN shuts the gate, as in its step
    event = (signal > numbers.on) | ~(signal > numbers.off)
    last = latest(event)
    # a gate is where its last event left it, so no loop is needed
    opened = jnp.where((last >= 0) & (signal[last] > numbers.on), 1.0, 0.0)
    if run.surrogate is None:
        return opened
    edge = jnp.where(later(opened, 1) > 0, numbers.off, numbers.on)
    return smoothed(opened, signal - edge, run.surrogate, numbers.on)


def comparison(block, numbers, state, signals, run):
    """Run a comparison, which may have a smoothed derivative."""
    exact = traced.bind(type(block).step)(numbers, (), *signals)[0]
    if run.surrogate is None or not (jnp.ndim(signals[0]) or jnp.ndim(signals[1])):
        return exact
    # a comparison has no level of its own to take the width from
    return smoothed(exact, spread(signals[0] - signals[1], run.n), run.surrogate)


def guard(block, numbers, state, signals, run):
    """Run the guard, which fades out the last finite value from a fault on."""
    signal = spread(signals[0], run.n)
    index = jnp.arange(run.n)
    # NaN, and infinity, whose difference from itself is NaN
    broken = signal - signal != 0
    fault = jnp.where(broken.any(), jnp.argmax(broken), run.n)
    last = jnp.where(fault > 0, signal[jnp.maximum(fault - 1, 0)], 0.0)
    left = jnp.maximum(numbers.m - (index - fault), 0.0)
    return jnp.where(index < fault, signal, last * (left / numbers.m)).astype(run.dtype)


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


def history(position: Any, contact: Any, cold: float, count: int) -> History:
    """Return the movements since contact.

    If ``cold`` was above 1 before the first contact, the history starts with a step
    from 0.
    """
    position = spread(position, count)
    # nothing to look for: the history begins with the run
    if steady(contact):
        first = jnp.where(cold > 1, 0.0, position[0])
        return History(
            jnp.ones(count, bool),
            jnp.zeros(count, int),
            position - later(position, 1, first),
            position - first,
        )
    touched = spread(jnp.asarray(contact) > 0, count)
    # a sample in contact after one that is not
    fresh = touched & ~later(touched, 1, False)
    start = latest(fresh)
    first = jnp.where((start == jnp.argmax(fresh)) & (cold > 1), 0.0, position[start])
    movement = jnp.where(touched, position - jnp.where(fresh, first, later(position, 1)), 0.0)
    return History(touched, start, movement, jnp.where(touched, position - first, 0.0))


def maxwell_arms(block, numbers, state, signals, run):
    """Run the block ``MaxwellArms``."""
    moved = history(signals[0], signals[1], state.cold, run.n)
    # a bank needs one history; where contact begins again, each begins from rest, and a
    # loop over samples is left
    if steady(signals[1]):
        return bank(numbers.e, numbers.r, moved.d, run.dtype)
    poles, weights = jnp.asarray(1 - numbers.e, run.dtype), jnp.asarray(numbers.r, run.dtype)

    def body(sums, movement):
        sums = poles * sums + movement
        return sums, jnp.sum(weights * sums)

    return in_contact(body, jnp.zeros(poles.size, run.dtype), moved.on, moved.d.astype(run.dtype))


def in_contact(body: Callable, start: Any, touched: Any, *rows: Any) -> Any:
    """Run a loop over samples in contact, ``state, y = body(state, *row)``.

    Off contact the state is ``start`` and y is 0.
    """

    def sample(state, row):
        # both are computed and one is taken, as a branch under vmap is too
        touched, *given = row
        after, output = body(state, *given)
        return jax.tree.map(lambda new, old: jnp.where(touched, new, old), after, start), jnp.where(
            touched, output, 0.0
        )

    return lax.scan(sample, start, (touched, *rows))[1]


def kelvin_chain(block, numbers, state, signals, run):
    """Run the block ``KelvinChain``."""
    force = spread(signals[0], run.n)
    # a chain moves one sample after the force; what it yields at once is the direct
    # part
    return bank(numbers.e, numbers.r, later(force, 1), run.dtype) + numbers.d * force


# Springpots ---------------------------------------------------------------------------
class HistoryWeights(NamedTuple):
    """The history weights of a springpot of fixed order."""

    r: Any  # of the modes
    taps: Any  # v_7 .. v_0
    constant: Any  # of the mode that never decays
    scale: Any  # fs^alpha


def springpot(block, numbers, state, signals, run):
    """Run the block ``Springpot``."""
    moved = history(signals[0], signals[1], state.cold, run.n)
    # a spring or a dashpot: the sum would only come near it
    if numbers.alpha in (0.0, 1.0):
        return moved.d * numbers.fs if numbers.alpha else moved.way
    fixed = HistoryWeights(numbers.r, numbers.taps, numbers.constant, numbers.scale)
    if steady(signals[1]):
        return whole_history(numbers.e, fixed, moved, run)
    return _scan_history(numbers.e, lambda order: fixed, 0.5, moved, run)


def whole_history(leaks: np.ndarray, weighted: HistoryWeights, moved: History, run: Run) -> Any:
    """Return a springpot's sum over all movements: eight taps, then modes.

    The modes start eight samples later.
    """
    near = sum(weighted.taps[7 - delay] * later(moved.d, delay) for delay in range(8))
    return weighted.scale * (
        near
        + weighted.constant * later(moved.way, 8)
        + bank(leaks, weighted.r, later(moved.d, 8), run.dtype)
    )


def springpot_live(block, numbers, state, signals, run):
    """Run ``SpringpotLive``: its weights depend on the order, its modes do not."""
    alpha = jnp.asarray(signals[1])
    # computed with an order in 0 .. 1, and NaN below for any other
    alpha = jnp.where(alpha >= 0, jnp.where(alpha <= 1, alpha, 1.0), 0.0)
    moved = history(signals[0], signals[2], state.cold, run.n)
    if steady(signals[2]) and not jnp.ndim(alpha):
        output = whole_history(numbers.e, weights(numbers, alpha), moved, run)
    else:
        output = _scan_history(numbers.e, lambda order: weights(numbers, order), alpha, moved, run)
    # exact at the ends, as in springpot
    ends = jnp.where(alpha > 0.5, moved.d * numbers.fs, moved.way)
    exact = jnp.where((alpha == 0) | (alpha == 1), ends, output)
    # the order's derivative is that of the sum, also at 0 and 1
    output = output + lax.stop_gradient(exact - output)
    return jnp.where(moved.on, jnp.where(alpha == signals[1], output, jnp.nan), 0.0)


def weights(numbers: pot.LiveParams, alpha: Any) -> HistoryWeights:
    """Compute the weights of ``springpots.reweigh`` for all modes at once."""
    nodes, power, polynomials = (
        int(numbers.nodes),
        traced.bind(pot.power),
        numbers.poly.reshape(pot.COEFFICIENTS, -1),
    )
    argument, remaining, last, before = 2.0 * alpha - 1.0, 1.0 - alpha, 0.0, 0.0
    # Clenshaw's recurrence, with all nodes as one array
    for row in polynomials[:0:-1]:
        last, before = 2.0 * argument * last + (row - before), last
    series = argument * last + (polynomials[0] - before)
    # sin(pi a) of the smaller of a and 1 - a: near 1 it would lose its digits
    gain = jnp.sin(math.pi * jnp.where(alpha > 0.5, remaining, alpha)) / math.pi
    scaled = jnp.concatenate(
        [remaining * series[8 : 8 + nodes], jnp.broadcast_to(gain, (numbers.a.size - nodes,))]
    )
    modal = scaled * numbers.a * power(alpha, numbers.high, numbers.rest)
    taps = series[:8] * jnp.concatenate([jnp.broadcast_to(remaining, (7,)), jnp.ones(1)])
    return HistoryWeights(modal[1:], taps, modal[0], power(alpha, numbers.fs_high, numbers.fs_rest))


def _scan_history(leaks: np.ndarray, weigh: Callable, alpha: Any, moved: History, run: Run) -> Any:
    """Run ``whole_history`` from rest at each contact, as a loop over samples.

    The order may be a signal.
    """
    poles = jnp.asarray(1 - leaks)
    moving = jnp.ndim(alpha) > 0

    def body(state, movement, order):
        recent, sums, total = state
        recent, sums, total = (
            jnp.concatenate([recent[1:], movement[None]]),
            poles * sums + recent[0],
            total + recent[0],
        )
        # the weights of an order that stands depend on nothing in the loop
        weighted = weigh(order if moving else alpha)
        return (recent, sums, total), weighted.scale * (
            jnp.sum(weighted.taps * recent) + weighted.constant * total + jnp.sum(weighted.r * sums)
        )

    return in_contact(
        body,
        (jnp.zeros(8), jnp.zeros(leaks.size), jnp.zeros(())),
        moved.on,
        moved.d,
        spread(alpha, run.n),
    )


def series(block, numbers, state, signals, run):
    """Run ``Series`` as a loop that solves for the inner displacement per sample."""
    moved = history(signals[0], signals[1], state.cold, run.n)
    poles = jnp.asarray(1 - numbers.e)

    def body(before, movement, position):
        # movements of the springpot, its modes, its way until 8 samples ago and now
        recent, sums, total, inner = before
        sums, total = poles * sums + recent[0], total + recent[0]
        rest = (
            jnp.sum(numbers.taps[:7] * recent[1:])
            + numbers.constant * total
            + jnp.sum(numbers.r * sums)
        )
        # both elements carry one force, which is linear in the step of the inner point:
        # one division solves for it
        outer = movement if numbers.dashpot else position - inner
        step = (numbers.other * outer - numbers.pot * rest) / (
            numbers.other + numbers.pot * numbers.newest
        )
        return (
            jnp.concatenate([recent[1:], step[None]]),
            sums,
            total,
            inner + step,
        ), numbers.pot * (numbers.newest * step + rest)

    start = jnp.zeros(8), jnp.zeros(numbers.e.size), jnp.zeros(()), jnp.zeros(())
    return in_contact(body, start, moved.on, moved.d, moved.way)


def short_memory(block, numbers, state, signals, run):
    """Run the block ``ShortMemory``."""
    moved = history(signals[0], signals[1], state.cold, run.n)
    # as of Maxwell arms
    if steady(signals[1]):
        return taps_tiles(numbers.taps[::-1], moved.way)
    taps = jnp.asarray(numbers.taps)

    def body(recent, newest):
        recent = jnp.concatenate([recent, newest[None]])
        return recent[1:], jnp.sum(taps * recent)

    return in_contact(body, jnp.zeros(numbers.taps.size - 1), moved.on, moved.way)


def downsampled(block, numbers, state, signals, run):
    """Run the block ``Downsampled``, one weight at a time."""
    moved = history(signals[0], signals[1], state.cold, run.n)
    index = jnp.arange(run.n)
    since = index - moved.start
    # a history that grows is thinned: so many samples lie between its points
    stride = jnp.maximum((since + pot.POINTS - 1) // pot.POINTS, 1)

    def body(total, item):
        number, weight = item
        inside = number * stride <= since
        return total + jnp.where(
            inside, weight * moved.way[jnp.where(inside, index - number * stride, 0)], 0.0
        ), None

    total = lax.scan(
        body, jnp.zeros(run.n), (jnp.arange(numbers.weights.size), jnp.asarray(numbers.weights))
    )[0]
    output = numbers.scale * jnp.exp(-numbers.alpha * jnp.log(stride.astype(jnp.float64))) * total
    return jnp.where(moved.on, jnp.where(since < state.past.size, output, jnp.nan), 0.0)


# Carrier ------------------------------------------------------------------------------
TOP_BITS = U(0xFFFFFFFFF8000000)


# compiled code has fma for the same; XLA is free to contract or not
def lost(one: Any, other: Any) -> Any:
    """Return the exact rounding error of the product a b.

    The factors are split into halves of 26 bits, whose products are exact.
    """
    split = traced.bits
    high = [
        traced.unbits(split(jnp.asarray(factor, jnp.float64)) & TOP_BITS) for factor in (one, other)
    ]
    low = [factor - part for factor, part in zip((one, other), high, strict=True)]
    return ((high[0] * high[1] - one * other) + (high[0] * low[1] + low[0] * high[1])) + low[
        0
    ] * low[1]


def increment(numbers: Any, frequency: Any) -> Any:
    """Compute ``carrier.increment`` for a frequency within 0 .. fs/2."""
    main = frequency * numbers.high
    # the whole part and the rest become integers apart: together they have more digits
    # than a float64
    whole = jnp.floor(main)
    rest = jnp.floor(
        (main - whole) + (frequency * numbers.low + lost(frequency, numbers.high)) + 0.5
    )
    return whole.astype(jnp.uint64) + rest.astype(jnp.int64).astype(jnp.uint64)


def carrier(block, numbers, state, signals, run):
    """Run the block ``Carrier``, with integer phases as on any target.

    The derivative is that of the sum of the frequencies.
    """
    frequency, contact = signals[0], heard(block, signals[1])
    count = jnp.maximum(jnp.arange(run.n) - int(state.wait), 0)  # samples that have moved the phase
    # held between 0 and fs/2, and 0 for NaN
    held = jnp.where(frequency > 0, jnp.where(frequency < numbers.top, frequency, numbers.top), 0.0)
    turns = held / run.fs  # per sample
    # an integer has no derivative: it comes back below by the turned angle, which is
    # the same sum in floats
    step = lax.stop_gradient(increment(numbers, held))
    if jnp.ndim(frequency):
        counts = jnp.arange(run.n) >= int(state.wait)
        phase = running(jnp.where(counts, step, U(0)))
        turned = running(jnp.where(counts, turns, 0.0))
    else:
        # a product wraps as the sum of as many steps does
        phase = count.astype(jnp.uint64) * step
        turned = count * turns
    start = phase + jnp.asarray(state.phase, jnp.uint64)

    def sound(frequency, turned, turns, contact):
        # the folded phase runs up in one half of the turn and down in the other
        rising = (start + QUARTER) >> U(63) == 0
        position = traced.bind(fold)(start) + jnp.where(rising, 2.0, -2.0) * (
            turned - lax.stop_gradient(turned)
        )
        size = traced.as_float(step) * WORD + (turns - lax.stop_gradient(turns))
        # at 0 Hz no sample lies over a zero crossing
        half = traced.bind(sinpi)(jnp.where(size > 0, size, 0.5))
        output = traced.bind(rectified)(numbers.mode, position, size, 1.0 / half)
        return jnp.where(
            contact > 0, jnp.where(frequency - frequency == 0, output, frequency - frequency), 0.0
        )

    return traced.run(sound, jnp.asarray(frequency), turned, turns, jnp.asarray(contact))


def response_limit(block, numbers, state, signals, run):
    """Run the block ``ResponseLimit``."""
    gains, inverse = (
        jnp.asarray(field).reshape(-1, numbers.keep.size) for field in (numbers.k, numbers.per)
    )

    def sample(carry, signals):
        ahead, phase = carry
        # what is allowed now depends on what has gone out before: a loop over samples
        ends = jnp.sort(
            jnp.array([(1 - ahead) * inverse[phase], (-1 - ahead) * inverse[phase]]), axis=0
        )
        output = jnp.clip(signals, jnp.minimum(ends[0].max(), 0.0), jnp.maximum(ends[1].min(), 0.0))
        carried, after = (
            ahead + gains[phase] * jnp.where(jnp.isfinite(signals), output, 0.0),
            (phase + 1) % block.every,
        )
        carried = jnp.where(after == 0, numbers.keep * jnp.append(carried[1:], 0.0), carried)
        return (carried, after), jnp.where(jnp.isfinite(signals), output, signals)

    return lax.scan(sample, (jnp.zeros(numbers.keep.size), 0), spread(signals[0], run.n))[1]


LOWERINGS: dict[type[Block], Callable] = {
    noise.White: white,
    noise.RestingWhite: lambda block, numbers, state, signals, run: jnp.where(
        heard(block, signals[0]) > 0, white(block, numbers, state, signals, run), 0.0
    ),
    FilteredNoise: pink,
    Modes: modes,
    # stored from the oldest on, and filled up with zeros to whole groups
    Fir: lambda b, p, s, x, run: taps_tiles(p.taps[::-1][: int(p.order) + 1], spread(x[0], run.n)),
    Delay: lambda b, p, s, x, run: later(spread(x[0], run.n), int(min(p.n, run.n))),
    Carrier: carrier,
    Cascade: signalforms.cascade,
    Grain: lambda b, p, s, x, run: taps_tiles(p.shape, spread(x[0], run.n)),
    Ring: lambda b, p, s, x, run: run_step(signalforms.turning, p, s, x, run.n),
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
    # sample by sample: they read their history at any point
    **dict.fromkeys(
        (DelayAvatar, Passive),
        lambda b, p, s, x, run: scan_arrays(traced.bind(b.step), traced.on_arrays(p), s, x, run.n),
    ),
}
LOWERINGS |= {
    MaxwellArms: maxwell_arms,
    KelvinChain: kelvin_chain,
    Series: series,
    pot.Springpot: springpot,
    pot.SpringpotLive: springpot_live,
    pot.Downsampled: downsampled,
    pot.ShortMemory: short_memory,
    Texture: textureforms.texture,
}
