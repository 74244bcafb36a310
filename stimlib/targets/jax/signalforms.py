"""Filters and rings over whole signals for JAX, as linear recursions."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import lax

from ...blocks.cursors import ratio
from ...blocks.sources import turn, turned
from ...blocks.tables import spline, spline_slope
from .recurrence import affine


def cascade(block, numbers, state, signals, run):
    """Run the sections of a filter in series, each with an affine update of two states.

    It is in float64, which a low cutoff needs.
    """
    signal = jnp.broadcast_to(signals[0], (run.n,))
    # in numpy, from design's numbers: constants, so the update is affine
    matrices = np.stack(
        [np.stack([1 - numbers.c, -numbers.a], -1), np.stack([numbers.b, 1 - numbers.d], -1)], -2
    )

    def section(signal, row):
        matrix, drive, direct, first, second = row
        states = affine(matrix, signal[:, None] * drive, jnp.zeros(2, signal.dtype))
        one, two = states[:, 0], states[:, 1]
        return direct * (signal - two) + first * one + second * two, None

    # sections of one filter have one form: a loop over them compiles once
    rows = [
        *map(
            jnp.asarray,
            (matrices, np.stack([numbers.a, numbers.d], -1), numbers.h0, numbers.e1, numbers.e0),
        )
    ]
    return lax.scan(section, signal.astype(jnp.float64), rows)[0].astype(signal.dtype)


def turning(numbers, state, event, frequency, decay):
    """Run one sample of a ring that never rests, so that its state is linear.

    The step of compiled code rests where a ring has died away, a branch on its state.
    """
    return turned(numbers, turn(numbers, frequency, decay), state, event)


def cursor(block, numbers, state, signals, run):
    """Run ``Cursor`` sample by sample.

    The ratio's derivative is that of Newton's last step, which is that of the implicit
    function.
    """
    table, one = jnp.asarray(numbers.c).reshape(-1, int(numbers.width)), np.eye(4)

    def cell(position, density, count):
        held = jnp.clip(position * density, 0.0, count)
        index = jnp.minimum(lax.stop_gradient(jnp.floor(held)), count - 1.0)
        weights, slopes = (
            jnp.stack([function(row[0], row[1], row[2], row[3], held - index) for row in one])
            for function in (spline, spline_slope)
        )
        return (
            index.astype(jnp.int64),
            weights,
            slopes,
            jnp.where(held == position * density, density, 0.0),
        )

    def level(x, y):
        (column, weights_x, slopes_x, free_x), (line, weights_y, slopes_y, free_y) = (
            cell(x, numbers.px, numbers.nx),
            cell(y, numbers.py, numbers.ny),
        )
        near = lax.dynamic_slice(table, (column, line), (4, 4))
        stiffness, slope_x, slope_y = (
            weights_x @ near @ weights_y,
            slopes_x @ near @ weights_y,
            weights_x @ near @ slopes_y,
        )
        # a level is held between 0 and 1, and has no slope where it is
        inside = jnp.where((stiffness > 0.0) & (stiffness < 1.0), 1.0, 0.0)
        return jnp.clip(stiffness, 0.0, 1.0), free_x * inside * slope_x, free_y * inside * slope_y

    def better(guess, x, y, move_x, move_y):
        # one step of Newton's method: the ratio decides where the cursor goes, and the
        # level there decides the ratio
        stiffness, slope_x, slope_y = level(x + 0.5 * guess * move_x, y + 0.5 * guess * move_y)
        slope = -2.1 / (1.1 * (1.0 + stiffness) ** 2) * 0.5 * (slope_x * move_x + slope_y * move_y)
        return jnp.clip(guess - (ratio(stiffness) - guess) / (slope - 1.0), 1.0 / 22.0, 1.0)

    def step(before, row):
        hand_x, hand_y, contact = row
        moved = before.x, before.y, hand_x - before.px, hand_y - before.py
        still = lax.stop_gradient(moved)
        # five steps without a derivative, and one with: its derivative is that of the
        # implicit function
        solved = lax.fori_loop(
            0, 5, lambda _, guess: better(guess, *still), ratio(level(*still[:2])[0])
        )
        solved = better(lax.stop_gradient(solved), *moved)
        touched, fresh = contact > 0.0, before.cold > 0.0
        x, y = (
            jnp.where(touched, jnp.where(fresh, hand, start + solved * change), start)
            for hand, start, change in ((hand_x, before.x, moved[2]), (hand_y, before.y, moved[3]))
        )
        return before._replace(x=x, y=y, px=hand_x, py=hand_y, cold=jnp.where(touched, 0.0, 1.0)), (
            x,
            y,
        )

    first = type(state)(*(jnp.asarray(value, jnp.float64) for value in state))
    return lax.scan(
        step, first, [jnp.broadcast_to(value, (run.n,)).astype(jnp.float64) for value in signals]
    )[1]
