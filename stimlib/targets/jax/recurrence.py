"""Recursions over whole signals: delays, linear states and scanned states.

``run_step`` looks at a step once.  State that the old state does not enter is the
input, one sample later.  State whose update is affine, s' = M s + v with M and v known
beforehand, is solved in blocks (``affine``): the time axis becomes two, each about the
square root as long.  Only what is left is a loop over samples.  So a step needs nothing
but its definition.  A feedback loop comes as one such step: ``core/loop_code`` has made
its blocks one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core

from ...errors import SceneError
from . import traced

FREE, LINEAR, CURVED = 0, 1, 2  # how a value depends on a state
SHORT = 64  # recursions up to this length are plain loops
_PASSIVE = {
    "neg",
    "convert_element_type",
    "copy",
    "broadcast_in_dim",
    "reshape",
    "squeeze",
    "add_any",
    "add",
    "sub",
    "stop_gradient",
}


# Looking at a step --------------------------------------------------------------------
def degrees(jaxpr: Any, given: list[int]) -> list[int]:
    """Return FREE, LINEAR or CURVED for each output, given the same for each input."""
    env = dict(zip(jaxpr.invars, given, strict=True))

    def read(v):
        return FREE if isinstance(v, core.Literal) else env.get(v, FREE)

    for e in jaxpr.eqns:
        x = [*map(read, e.invars)]
        name, inner = e.primitive.name, traced.body_of(e)
        if inner is not None:
            out = degrees(inner.jaxpr, x)
        elif not any(x):
            out = [FREE] * len(e.outvars)
        elif name in _PASSIVE and jnp.issubdtype(e.outvars[0].aval.dtype, jnp.floating):
            out = [max(x)]
        elif name == "mul":
            out = [min(sum(x), CURVED)]
        elif (name == "div" and not x[1]) or (name == "select_n" and not x[0]):
            out = [max(x)]
        else:
            out = [CURVED] * len(e.outvars)
        env.update(zip(e.outvars, out, strict=True))
    return [*map(read, jaxpr.outvars)]


def groups(depends: np.ndarray) -> list[list[int]]:
    """Return the groups of states that depend on each other, in running order.

    depends[i, j]: i needs j.
    """
    n = len(depends)
    reach = depends.copy()
    for k in range(n):
        reach |= reach[:, k : k + 1] & reach[k : k + 1, :]
    left, out = list(range(n)), []
    while left:
        i = next(i for i in left if not any(reach[i, j] and not reach[j, i] for j in left))
        out.append([j for j in left if j == i or (reach[i, j] and reach[j, i])])
        left = [j for j in left if j not in out[-1]]
    return out


def _resettable(f: Callable, first: Any) -> Callable:
    """Return a step that is at rest wherever its contact is not True.

    The contact is the last but one of its signals, and the last is the value of
    ``cold`` at rest.
    """

    def step(p, s, *x):
        on, rest = x[-2], first._replace(cold=x[-1])
        # or a NaN would enter derivatives
        s = type(first)(*(jnp.where(on, a, b) for a, b in zip(s, rest, strict=True)))
        y, after = f(p, s, *(jnp.where(on, v, 0.0) for v in x[:-2]))
        after = after._replace(cold=0.0)
        return jax.tree.map(lambda v: jnp.where(on, v, 0.0), y), type(first)(
            *(jnp.where(on, a, b) for a, b in zip(after, rest, strict=True))
        )

    return step


def run_step(step: Callable, p: Any, first: Any, x: list[Any], n: int, contact: tuple = ()) -> Any:
    """Return the outputs of a step over n samples.

    Each is an array (n,), or a scalar if it is the same at all of them; there is a
    tuple for several outputs.

    first is a NamedTuple of scalars; x are arrays (n,) or scalars. contact, for a
    resettable block, is where it runs, and ``cold`` where it does not.
    """
    f, p = traced.bind(step), traced.on_arrays(p)
    if contact:
        f, x = _resettable(f, first), [*x, *contact]
    if not len(first):
        return traced.run(lambda *x: f(p, (), *x)[0], *x)
    if any(np.ndim(v) for v in first):
        if step.__module__ is not None:
            raise SceneError(
                f"{step.__qualname__} keeps an array as state: it needs a lowering of its own"
                " for JAX"
            )
        return scan_arrays(f, p, first, x, n)
    return _by_groups(f, p, first, x, n)


def _by_groups(f: Callable, p: Any, first: Any, x: list[Any], n: int) -> Any:
    """Return the outputs of a step, computing one group of states after another."""
    make, k = type(first), len(first)
    s0 = [*map(jnp.asarray, first)]

    def update(s, x):
        new = f(p, make(*s), *x)[1]
        return [jnp.asarray(v).astype(o.dtype) for v, o in zip(new, s0, strict=True)]

    scalars = [jnp.zeros((), v.dtype) for v in map(jnp.asarray, x)]
    jaxpr = jax.make_jaxpr(update)(s0, scalars).jaxpr

    def degree(of: list[int]) -> np.ndarray:
        given = [LINEAR if j in of else FREE for j in range(k)] + [FREE] * len(x)
        return np.array(degrees(jaxpr, given))

    # of each state alone, what its old value does to all new ones
    depends = np.array([degree([j]) for j in range(k)]).T > FREE
    s: list[Any] = list(s0)
    for group in groups(depends):
        known = [j for j in range(k) if j not in group]

        def part(own, others, x, group=group, known=known):
            full = dict(zip([*group, *known], [*own, *others], strict=True))
            new = traced.run(update, [full[j] for j in range(k)], x)
            return [new[j] for j in group]

        start, others = [s0[j] for j in group], [s[j] for j in known]
        # from the cheapest way to the one that always works
        floats = all(jnp.issubdtype(v.dtype, jnp.floating) for v in start)
        if not depends[np.ix_(group, group)].any():
            solve = _free_part
        elif floats and degree(group)[group].max() == LINEAR:
            solve = _affine_part
        else:
            solve = _scan_part
        for j, v in zip(group, solve(part, start, others, x, n), strict=True):
            s[j] = v
    return traced.run(lambda s, x: f(p, make(*s), *x)[0], s, x)


class Line:
    """An array in a state, which a step may modify."""

    def __init__(self, a: Any):
        self.a, self.size = a, a.size

    def __getitem__(self, i: Any) -> Any:
        return lax.dynamic_index_in_dim(self.a, i, keepdims=False)

    def __setitem__(self, i: Any, v: Any) -> None:
        # at[i].set would take 1 us
        self.a = lax.dynamic_update_index_in_dim(self.a, jnp.asarray(v, self.a.dtype), i, 0)


def scan_arrays(f: Callable, p: Any, first: Any, x: list[Any], n: int) -> Any:
    """Run a step that has arrays in its state, in a loop over samples."""
    s0 = [*map(jnp.asarray, first)]

    def one(s: list[Any], x: list[Any]) -> Any:
        lines = (Line(v) if jnp.ndim(v) else v for v in s)
        y, new = f(p, type(first)(*lines), *x)
        arrays = (getattr(v, "a", v) for v in new)
        return [jnp.asarray(v, o.dtype) for v, o in zip(arrays, s0, strict=True)], y

    return _scanned(lambda s, x: tuple(traced.run(one, s, x)), s0, x, n)


def _scanned(body: Callable, start: list, given: Any, n: int) -> Any:
    """Run a loop over samples, ``state, y = body(state, given)``.

    The arrays in ``given`` have one number for each sample.
    """
    flat, tree = jax.tree.flatten(given)
    moving = [i for i, v in enumerate(flat) if jnp.ndim(v)]

    def sample(s, row):
        here = list(flat)
        for i, v in zip(moving, row, strict=True):
            here[i] = v
        return body(s, jax.tree.unflatten(tree, here))

    return lax.scan(sample, start, [flat[i] for i in moving], length=n)[1]


def _free_part(part: Callable, start: list, others: list, x: list, n: int) -> list:
    """Return the states before each sample, which do not depend on earlier ones."""
    new = [jnp.broadcast_to(v, (n,))[: n - 1] for v in part(start, others, x)]
    return [jnp.concatenate([first[None], v]) for first, v in zip(start, new, strict=True)]


def _scan_part(part: Callable, start: list, others: list, x: list, n: int) -> list:
    """Return the states before each sample, computed sample by sample."""
    return _scanned(lambda s, given: (part(s, *given), s), start, (others, x), n)


def _affine_part(part: Callable, start: list, others: list, x: list, n: int) -> list:
    """Return the states before each sample, for an affine update s' = M s + v.

    M is found column by column as derivatives, which are exact, and v at s = 0.
    """
    k = len(start)
    zero = [*map(jnp.zeros_like, start)]

    def column(j, others, x):
        unit = [jnp.ones_like(v) if i == j else jnp.zeros_like(v) for i, v in enumerate(start)]
        return jax.jvp(lambda s: part(s, others, x), (zero,), (unit,))[1]

    def matrix(others, x):
        return [column(j, others, x) for j in range(k)]

    flat, tree = jax.tree.flatten((others, x))
    scalar = [jnp.zeros((), jnp.asarray(v).dtype) for v in flat]
    jaxpr = jax.make_jaxpr(lambda *a: matrix(*jax.tree.unflatten(tree, a)))(*scalar).jaxpr
    steady = not any(degrees(jaxpr, [LINEAR if jnp.ndim(v) else FREE for v in flat]))
    v = _beside(part(zero, others, x), (n,))
    here = [z if steady and jnp.ndim(a) else a for a, z in zip(flat, scalar, strict=True)]
    shape = () if steady else (n,)
    columns = matrix(*jax.tree.unflatten(tree, here))
    M = jnp.stack([_beside(c, shape) for c in columns], axis=-1)
    anew = None
    if not steady:  # where not even a NaN gets through, the state begins anew
        nothing = [jnp.full_like(z, jnp.nan) for z in zero]
        anew = ~jnp.isnan(_beside(part(nothing, others, x), (n,))).any(axis=-1)
    s = affine(M, v, jnp.stack(start), anew)
    return [s[:, j] for j in range(k)]


def _beside(values: list, shape: tuple[int, ...]) -> Any:
    return jnp.stack([jnp.broadcast_to(v, shape) for v in values], axis=-1)


# Solving ------------------------------------------------------------------------------
def affine(M: Any, v: Any, first: Any, anew: Any = None) -> Any:
    """Return states s[0..n-1] before each update of s' = M s + v.

    v is (n, k), first (k,); M is (n, k, k), or (k, k) if it is constant. Where anew
    (n,) is True, s' = v whatever s is, even NaN.
    """
    n, k = v.shape
    if anew is None:
        anew = jnp.zeros(n, bool)
    if n <= SHORT:
        steps = (jnp.broadcast_to(M, (n, k, k)), v, anew)
        return lax.scan(
            lambda s, row: (_apply(row[0], jnp.where(row[2], 0.0, s)) + row[1], s), first, steps
        )[1]
    # Two axes of about sqrt(n): all blocks run side by side from a state of 0, each
    # carrying the product of its matrices; then the states at their starts follow from
    # one another, and are added. So velocities, trackers and lags take 10 ns a sample
    # instead of 50.
    blocks = math.isqrt(n)
    length = -(-n // blocks)
    v = jnp.pad(v, ((0, length * blocks - n), (0, 0))).reshape(blocks, length, k).swapaxes(0, 1)
    if M.ndim == 2:

        def along(carry, v):
            powers, offsets = carry
            return (_times(M, powers), _apply(M, offsets) + v), carry

        (powers, offsets), (all_powers, all_offsets) = lax.scan(
            along, (jnp.eye(k, dtype=v.dtype), jnp.zeros((blocks, k), v.dtype)), v
        )
        all_powers = all_powers[:, None]  # those of any block: M is the same in all
        starts = affine(powers, offsets, first)  # of the blocks
    else:
        M = (
            jnp.pad(M, ((0, length * blocks - n), (0, 0), (0, 0)))
            .reshape(blocks, length, k, k)
            .swapaxes(0, 1)
        )
        anew = jnp.pad(anew, (0, length * blocks - n)).reshape(blocks, length).T

        def along_each(carry, row):
            (powers, offsets, cut), (M, v, anew) = carry, row
            powers, offsets = (
                jnp.where(anew[:, None, None], 0.0, powers),
                jnp.where(anew[:, None], 0.0, offsets),
            )
            return (_times(M, powers), _apply(M, offsets) + v, cut | anew), carry

        one = jnp.broadcast_to(jnp.eye(k, dtype=v.dtype), (blocks, k, k))
        (powers, offsets, cut), (all_powers, all_offsets, cuts) = lax.scan(
            along_each,
            (one, jnp.zeros((blocks, k), v.dtype), jnp.zeros(blocks, bool)),
            (M, v, anew),
        )
        starts = jnp.where(cuts[..., None], 0.0, affine(powers, offsets, first, cut))
    return (_apply(all_powers, starts) + all_offsets).swapaxes(0, 1).reshape(blocks * length, k)[:n]


def _apply(M: Any, s: Any) -> Any:
    """Return M s over the last axes, as sums of products.

    For one or two states a matrix product costs more.
    """
    return sum(M[..., :, j] * s[..., j : j + 1] for j in range(s.shape[-1]))


def _times(A: Any, B: Any) -> Any:
    return jnp.stack([_apply(A, B[..., :, j]) for j in range(B.shape[-1])], axis=-1)
