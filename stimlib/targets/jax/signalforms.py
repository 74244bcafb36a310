"""Filters and rings over whole signals for JAX, as linear recursions."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import lax

from ...blocks.soft import ratio
from ...blocks.sources import turn, turned
from ...blocks.tables import spline, spline_slope
from . import traced
from .recurrence import affine, run_step, scan_arrays


def cascade(b, p, s, x, run):
    """Run the sections of a filter in series, each with an affine update of two states.

    It is in float64, which a low cutoff needs.
    """
    v = jnp.broadcast_to(x[0], (run.n,))
    M = np.stack([np.stack([1 - p.c, -p.a], -1), np.stack([p.b, 1 - p.d], -1)], -2)

    def section(v, row):
        M, drive, h0, e1, e0 = row
        states = affine(M, v[:, None] * drive, jnp.zeros(2, v.dtype))
        s1, s2 = states[:, 0], states[:, 1]
        return h0 * (v - s2) + e1 * s1 + e0 * s2, None

    rows = [*map(jnp.asarray, (M, np.stack([p.a, p.d], -1), p.h0, p.e1, p.e0))]
    return lax.scan(section, v.astype(jnp.float64), rows)[0].astype(v.dtype)


def turning(p, s, event, freq, decay):
    """Run one sample of a ring that never rests, so that its state is linear."""
    return turned(p, turn(p, freq, decay), s, event)


def ring(b, p, s, x, run):
    """Run the block ``Ring``."""
    return run_step(turning, p, s, x, run.n)


def avatar(b, p, s, x, run):
    """Run ``DelayAvatar`` sample by sample, as it reads its history at any point."""
    return scan_arrays(traced.bind(b.step), traced.on_arrays(p), s, x, run.n)


def cursor(b, p, s, x, run):
    """Run ``Cursor`` sample by sample.

    The ratio's derivative is that of Newton's last step, which is that of the implicit
    function.
    """
    table, one = jnp.asarray(p.c).reshape(-1, int(p.width)), np.eye(4)

    def cell(v, per, n):
        held = jnp.clip(v * per, 0.0, n)
        i = jnp.minimum(lax.stop_gradient(jnp.floor(held)), n - 1.0)
        w, d = (
            jnp.stack([f(row[0], row[1], row[2], row[3], held - i) for row in one])
            for f in (spline, spline_slope)
        )
        return i.astype(jnp.int64), w, d, jnp.where(held == v * per, per, 0.0)

    def level(x, y):
        (i, wx, dx, free_x), (j, wy, dy, free_y) = cell(x, p.px, p.nx), cell(y, p.py, p.ny)
        near = lax.dynamic_slice(table, (i, j), (4, 4))
        S, sx, sy = wx @ near @ wy, dx @ near @ wy, wx @ near @ dy
        inside = jnp.where((S > 0.0) & (S < 1.0), 1.0, 0.0)
        return jnp.clip(S, 0.0, 1.0), free_x * inside * sx, free_y * inside * sy

    def better(c, x, y, dx, dy):
        S, sx, sy = level(x + 0.5 * c * dx, y + 0.5 * c * dy)
        slope = -2.1 / (1.1 * (1.0 + S) ** 2) * 0.5 * (sx * dx + sy * dy)
        return jnp.clip(c - (ratio(S) - c) / (slope - 1.0), 1.0 / 22.0, 1.0)

    def step(s, row):
        px, py, contact = row
        place = s.x, s.y, px - s.px, py - s.py
        still = lax.stop_gradient(place)
        c = lax.fori_loop(0, 5, lambda _, c: better(c, *still), ratio(level(*still[:2])[0]))
        c = better(lax.stop_gradient(c), *place)
        on, fresh = contact > 0.0, s.cold > 0.0
        x, y = (
            jnp.where(on, jnp.where(fresh, p, at + c * d), at)
            for p, at, d in ((px, s.x, place[2]), (py, s.y, place[3]))
        )
        return s._replace(x=x, y=y, px=px, py=py, cold=jnp.where(on, 0.0, 1.0)), (x, y)

    first = type(s)(*(jnp.asarray(v, jnp.float64) for v in s))
    return lax.scan(step, first, [jnp.broadcast_to(v, (run.n,)).astype(jnp.float64) for v in x])[1]
