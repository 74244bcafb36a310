"""Noise over position for JAX: octave by octave, over whole signals."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import lax

from ...blocks import surfaces
from . import traced


def cells_of(key, low):
    """Return seven lattice values, starting at the cell of low.

    They are made in a loop, as XLA would otherwise compute them again for every use.
    """
    # lattice values are made in pairs of cells: of the eight of four pairs, seven from
    # the asked cell on
    lattice, pair = traced.bind(surfaces.lattice), jnp.floor(0.5 * jnp.floor(low))
    first = pair.astype(jnp.int64).astype(jnp.uint64)
    values = lax.map(
        lambda number: jnp.stack(lattice(key, first + number)), jnp.arange(4, dtype=jnp.uint64)
    ).reshape(8, -1)
    return jnp.where(jnp.floor(low) > 2.0 * pair, values[1:], values[:7])


def mean(values, low, high):
    """Return the mean of an octave from low to high, both in cells.

    It is not valid where they are four or more cells apart.
    """
    spline, first, last = traced.bind(surfaces.spline_mean), jnp.floor(low), jnp.floor(high)
    # all five cells are computed and those beyond the end left out, because shapes must
    # not depend on numbers
    cells = first + jnp.arange(5.0)[:, None]  # a movement of less than four touches no more
    start, end = (jnp.clip(edge - cells, 0.0, 1.0) for edge in (low, high))
    area = jnp.sum(
        jnp.where(
            cells <= last,
            (end - start) * spline(values[:5], values[1:6], values[2:], start, end),
            0.0,
        ),
        axis=0,
    )
    # within one cell the area over the distance would be 0/0 at rest
    return jnp.where(
        first == last,
        spline(values[0], values[1], values[2], low - first, high - first),
        area / jnp.where(first == last, 1.0, high - low),
    )


def spatial_noise(block, numbers, state, signals, run):
    """Run the block ``SpatialNoise``."""
    touched = jnp.broadcast_to(jnp.asarray(signals[1]) > 0, (run.n,))
    # off contact at 0, so that no NaN of a position gets into derivatives
    position = jnp.where(touched, jnp.broadcast_to(signals[0], (run.n,)), 0.0)
    current = traced.bind(surfaces.held_place)(position * numbers.scale)
    fresh = touched & ~jnp.concatenate([jnp.zeros(1, bool), touched])[: run.n]
    before = jnp.where(fresh, current, jnp.concatenate([current[:1], current])[: run.n])
    low, high, gain = (
        jnp.minimum(before, current),
        jnp.maximum(before, current),
        traced.bind(surfaces.gain),
    )
    keys, offsets, own_widths, finer = map(
        jnp.asarray, (numbers.keys, numbers.at, numbers.own, numbers.finer)
    )
    scale = jnp.asarray(0.5 ** np.arange(numbers.own.size))
    # which cells there are is no function with a slope
    fixed = lax.stop_gradient(low)
    lattices = lax.map(
        lambda row: cells_of(row[0], fixed * row[2] + row[1]), (keys, offsets, scale)
    )

    # from four cells on an octave adds nothing
    def octave(total, row):
        lattice, offset, width, finer, scale = row
        lowest, highest = low * scale + offset, high * scale + offset
        distance = highest - lowest
        return total + jnp.where(
            distance < 4.0, gain(distance, width, finer) * mean(lattice, lowest, highest), 0.0
        ), None

    return jnp.where(
        touched,
        lax.scan(octave, position - position, (lattices, offsets, own_widths, finer, scale))[0],
        0.0,
    )
