"""How noise over place runs over whole signals under JAX: octave by octave, all samples at once."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import lax

from ...blocks import places
from . import traced

CELLS = 5  # that a movement of less than four cells touches, at most


def mean(key, lo, hi):
    """Mean of an octave from lo to hi, in its cells; of no use where they are four or more apart."""
    f, g = jnp.floor(lo), jnp.floor(hi)
    pair = jnp.floor(0.5 * f)
    first = pair.astype(jnp.int64).astype(jnp.uint64)
    lattice = traced.bind(places.lattice)
    made = lax.map(lambda k: jnp.stack(lattice(key, first + k)), jnp.arange(4, dtype=jnp.uint64))  # a loop: made once each
    z = made.reshape(8, -1)
    z = jnp.where(f > 2.0 * pair, jnp.roll(z, -1, axis=0), z)
    spline = traced.bind(places.spline_mean)
    area = 0.0
    for c in range(CELLS):
        a, b = (jnp.clip(v - (f + c), 0.0, 1.0) for v in (lo, hi))
        area = area + jnp.where(f + c <= g, (b - a) * spline(z[c], z[c + 1], z[c + 2], a, b), 0.0)
    same = f == g
    return jnp.where(same, spline(z[0], z[1], z[2], lo - f, hi - f), area / jnp.where(same, 1.0, hi - lo))


def spatial_noise(b, p, s, x, run):
    on = jnp.broadcast_to(jnp.asarray(x[1]) > 0, (run.n,))
    u = jnp.where(on, jnp.broadcast_to(x[0], (run.n,)), 0.0)
    v = traced.bind(places.held_place)(u * p.scale)
    fresh = on & ~jnp.concatenate([jnp.zeros(1, bool), on])[: run.n]
    before = jnp.where(fresh, v, jnp.concatenate([v[:1], v])[: run.n])
    gain = traced.bind(places.gain)

    def octave(y, row):
        key, at, own, finer, scale = row
        a, c = before * scale + at, v * scale + at
        lo, hi = jnp.minimum(a, c), jnp.maximum(a, c)
        r = hi - lo
        return y + jnp.where(r < 4.0, gain(r, own, finer) * mean(key, lo, hi), 0.0), None

    rows = [jnp.asarray(q) for q in (p.keys, p.at, p.own, p.finer, 0.5 ** np.arange(p.own.size))]
    return jnp.where(on, lax.scan(octave, u - u, rows)[0], 0.0)
