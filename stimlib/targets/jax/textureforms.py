"""Measured textures over whole signals for JAX.

All models are computed at once, then one loop goes over the samples of their clock.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import lax

from ...blocks.texture import Place, inside, least, part, weight
from . import traced


def texture(block, numbers, state, signals, run):
    """Run the block ``Texture``."""
    every, poles = int(numbers.every), int(numbers.poles)
    # the models run at a lower rate: once in so many samples
    white, speed, force = (jnp.broadcast_to(signal, (run.n,))[::every] for signal in signals)
    held, lowest, weigh, all_three = (
        traced.bind(helper) for helper in (part, least, weight, inside)
    )
    motion: Any = Place(held(abs(speed), numbers.per_speed), held(force, numbers.per_force))
    planes = [
        *map(jnp.asarray, (numbers.ax, numbers.ay, numbers.a, numbers.bx, numbers.by, numbers.b))
    ]
    # the point lies where the least of a triangle's three shares is largest: no search
    triangle = jnp.argmax(lowest(Place(motion.x[:, None], motion.z[:, None]), *planes), axis=1)
    planes_there = [plane[triangle] for plane in planes]
    # the shares weigh the three corners of the triangle in all that follows
    shares = jnp.stack(
        all_three(weigh(motion, *planes_there[:3]), weigh(motion, *planes_there[3:])), axis=1
    )
    corners = jnp.asarray(numbers.corners.reshape(-1, 3).astype(int))[triangle]

    def mean(values):
        return jnp.einsum("nk,nk...->n...", shares, jnp.asarray(values)[corners])

    # frequencies are mixed, not coefficients: a mixture of these may be unstable
    cosines = jnp.cos(jnp.pi * mean(numbers.lsf.reshape(numbers.gain.size, -1)))
    variance = mean(numbers.variance)
    varied = variance > 0  # a root has no slope at 0
    deviation = mean(numbers.gain) * jnp.where(
        varied, jnp.sqrt(jnp.where(varied, variance, 1.0)), 0.0
    )
    drives, recursions, averages = (
        deviation * white,
        predictor(cosines[:, :poles]),
        predictor(cosines[:, poles:]),
    )

    # the coefficients move, so nothing but a loop over samples is left
    def sample(memory, row):
        before, past = memory
        drive, recursive, direct = row
        output = drive + direct @ before - recursive @ past
        return (later(before, drive), later(past, output)), output

    start = jnp.zeros(averages.shape[1]), jnp.zeros(poles)
    out = lax.scan(sample, start, (drives, recursions, averages))[1]
    rows = jnp.asarray(numbers.rows.reshape(every, -1))
    # to the run's rate by a polyphase filter, as one product
    last = jnp.stack(
        [jnp.pad(out, (delay, 0))[: out.size] for delay in range(rows.shape[1])], axis=1
    )
    return (last @ rows.T).reshape(-1)[: run.n].astype(run.dtype)


def later(row, new):
    """Shift a row by one sample."""
    return jnp.concatenate([new[None], row])[: row.size]


def predictor(cosines):
    """Return a_1 .. a_p from rows of cosines of p line spectral frequencies.

    The rows are (n, order p); (P + Q)/2 is multiplied out.
    """
    count, order = cosines.shape
    halves = []
    # every second frequency belongs to P, the others to Q
    for first, sign in ((0, 1.0), (1, -1.0)):
        half = jnp.ones((count, 1))
        # each pair of roots is a factor 1 - 2 cos(w) z^-1 + z^-2
        for number in range(first, order, 2):
            middle = 2 * cosines[:, number : number + 1] * jnp.pad(half, ((0, 0), (1, 1)))
            half = jnp.pad(half, ((0, 0), (0, 2))) - middle + later_by(half, 2)
        if order % 2 == 0:
            half = jnp.pad(half, ((0, 0), (0, 1))) + sign * later_by(half, 1)
        elif sign < 0:
            half = jnp.pad(half, ((0, 0), (0, 2))) - later_by(half, 2)
        halves.append(half)
    return (halves[0] + halves[1])[:, 1 : order + 1] / 2


def later_by(rows, by):
    """Shift rows by some samples."""
    return jnp.pad(rows, ((0, 0), (by, 0)))
