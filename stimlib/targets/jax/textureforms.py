"""Measured textures over whole signals for JAX.

All models are computed at once, then one loop goes over the samples of their clock.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import lax

from ...blocks.texture import Place, inside, least, part, weight
from . import traced


def texture(b, p, s, x, run):
    """Run the block ``Texture``."""
    every, poles = int(p.every), int(p.poles)
    white, speed, force = (jnp.broadcast_to(v, (run.n,))[::every] for v in x)
    held, lowest, one, all_three = (traced.bind(f) for f in (part, least, weight, inside))
    at: Any = Place(held(abs(speed), p.per_speed), held(force, p.per_force))
    planes = [*map(jnp.asarray, (p.ax, p.ay, p.a, p.bx, p.by, p.b))]
    t = jnp.argmax(lowest(Place(at.x[:, None], at.z[:, None]), *planes), axis=1)
    own = [v[t] for v in planes]
    q = jnp.stack(all_three(one(at, *own[:3]), one(at, *own[3:])), axis=1)
    corners = jnp.asarray(p.corners.reshape(-1, 3).astype(int))[t]

    def mean(v):
        return jnp.einsum("nk,nk...->n...", q, jnp.asarray(v)[corners])

    c = jnp.cos(jnp.pi * mean(p.lsf.reshape(p.gain.size, -1)))
    variance = mean(p.variance)
    some = variance > 0  # a root has no slope at 0
    deviation = mean(p.gain) * jnp.where(some, jnp.sqrt(jnp.where(some, variance, 1.0)), 0.0)
    v, ar, ma = deviation * white, predictor(c[:, :poles]), predictor(c[:, poles:])

    def sample(state, row):
        before, past = state
        v, ar, ma = row
        y = v + ma @ before - ar @ past
        return (later(before, v), later(past, y)), y

    start = jnp.zeros(ma.shape[1]), jnp.zeros(poles)
    out = lax.scan(sample, start, (v, ar, ma))[1]
    rows = jnp.asarray(p.rows.reshape(every, -1))
    last = jnp.stack([jnp.pad(out, (k, 0))[: out.size] for k in range(rows.shape[1])], axis=1)
    return (last @ rows.T).reshape(-1)[: run.n].astype(run.dtype)


def later(row, new):
    """Shift a row by one sample."""
    return jnp.concatenate([new[None], row])[: row.size]


def predictor(c):
    """Return a_1 .. a_p from rows of cosines of p line spectral frequencies.

    The rows are (n, p); (P + Q)/2 is multiplied out.
    """
    n, p = c.shape
    halves = []
    for first, sign in ((0, 1.0), (1, -1.0)):
        half = jnp.ones((n, 1))
        for k in range(first, p, 2):
            middle = 2 * c[:, k : k + 1] * jnp.pad(half, ((0, 0), (1, 1)))
            half = jnp.pad(half, ((0, 0), (0, 2))) - middle + later_by(half, 2)
        if p % 2 == 0:
            half = jnp.pad(half, ((0, 0), (0, 1))) + sign * later_by(half, 1)
        elif sign < 0:
            half = jnp.pad(half, ((0, 0), (0, 2))) - later_by(half, 2)
        halves.append(half)
    return (halves[0] + halves[1])[:, 1 : p + 1] / 2


def later_by(rows, by):
    """Shift rows by some samples."""
    return jnp.pad(rows, ((0, 0), (by, 0)))
