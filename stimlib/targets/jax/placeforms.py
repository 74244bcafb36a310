"""Noise over position for JAX: octave by octave, over whole signals."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import lax

from ...blocks import surfaces
from . import traced


def cells_of(key, lo):
    """Return seven lattice values, starting at the cell of lo.

    They are made in a loop, as XLA would otherwise compute them again for every use.
    """
    lattice, half = traced.bind(surfaces.lattice), jnp.floor(0.5 * jnp.floor(lo))
    first = half.astype(jnp.int64).astype(jnp.uint64)
    z = lax.map(
        lambda k: jnp.stack(lattice(key, first + k)), jnp.arange(4, dtype=jnp.uint64)
    ).reshape(8, -1)
    return jnp.where(jnp.floor(lo) > 2.0 * half, z[1:], z[:7])


def mean(z, lo, hi):
    """Return the mean of an octave from lo to hi, both in cells.

    It is not valid where they are four or more cells apart.
    """
    spline, f, g = traced.bind(surfaces.spline_mean), jnp.floor(lo), jnp.floor(hi)
    cells = f + jnp.arange(5.0)[:, None]  # a movement of less than four touches no more
    a, b = (jnp.clip(v - cells, 0.0, 1.0) for v in (lo, hi))
    area = jnp.sum(jnp.where(cells <= g, (b - a) * spline(z[:5], z[1:6], z[2:], a, b), 0.0), axis=0)
    return jnp.where(
        f == g, spline(z[0], z[1], z[2], lo - f, hi - f), area / jnp.where(f == g, 1.0, hi - lo)
    )


def spatial_noise(b, p, s, x, run):
    """Run the block ``SpatialNoise``."""
    on = jnp.broadcast_to(jnp.asarray(x[1]) > 0, (run.n,))
    u = jnp.where(on, jnp.broadcast_to(x[0], (run.n,)), 0.0)
    v = traced.bind(surfaces.held_place)(u * p.scale)
    fresh = on & ~jnp.concatenate([jnp.zeros(1, bool), on])[: run.n]
    before = jnp.where(fresh, v, jnp.concatenate([v[:1], v])[: run.n])
    low, high, gain = jnp.minimum(before, v), jnp.maximum(before, v), traced.bind(surfaces.gain)
    keys, at, own, finer = map(jnp.asarray, (p.keys, p.at, p.own, p.finer))
    scale = jnp.asarray(0.5 ** np.arange(p.own.size))
    fixed = lax.stop_gradient(low)
    lattices = lax.map(lambda row: cells_of(row[0], fixed * row[2] + row[1]), (keys, at, scale))

    def octave(y, row):
        z, at, own, finer, scale = row
        lo, hi = low * scale + at, high * scale + at
        r = hi - lo
        return y + jnp.where(r < 4.0, gain(r, own, finer) * mean(z, lo, hi), 0.0), None

    return jnp.where(on, lax.scan(octave, u - u, (lattices, at, own, finer, scale))[0], 0.0)
