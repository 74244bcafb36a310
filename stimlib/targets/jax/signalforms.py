"""How filters and rings run over whole signals under JAX: as recursions that are linear in their states."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import lax

from ...blocks.transients import turn, turned
from .recurrence import affine, run_step


def cascade(b, p, s, x, run):
    """One section after the other, each two states with an affine update; in float64, which a low cutoff needs."""
    v = jnp.broadcast_to(x[0], (run.n,))
    M = np.stack([np.stack([1 - p.c, -p.a], -1), np.stack([p.b, 1 - p.d], -1)], -2)

    def section(v, row):
        M, drive, h0, e1, e0 = row
        states = affine(M, v[:, None] * drive, jnp.zeros(2, v.dtype))
        s1, s2 = states[:, 0], states[:, 1]
        return h0 * (v - s2) + e1 * s1 + e0 * s2, None

    rows = [jnp.asarray(r) for r in (M, np.stack([p.a, p.d], -1), p.h0, p.e1, p.e0)]
    return lax.scan(section, v.astype(jnp.float64), rows)[0].astype(v.dtype)


def turning(p, s, event, freq, decay):
    """A ring that never rests, so that its state is linear."""
    return turned(p, turn(p, freq, decay), s, event)


def ring(b, p, s, x, run):
    return run_step(turning, p, s, x, run.n)
