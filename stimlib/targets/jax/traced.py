"""Steps under JAX: the same source, with JAX's mathematics under the names it uses.

A step is straight-line, so called with whole signals instead of samples it computes all
of them at once.  ``bind`` gives a step its twins: each name of ``stimlib.core.maths``
has one here, which differs in rounding alone (XLA is free to contract a*b + c).
``run`` evaluates it so that its derivative is finite: where a denominator is 0, that of
a quotient is 0.
"""

from __future__ import annotations

import builtins
import types
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core

from ...core import maths
from ...errors import SceneError

# The twins ----------------------------------------------------------------------------
SILENT, TINY, F = maths.SILENT, maths.TINY, maths.F


def fma(a, b, c):
    """Return a b + c."""
    return a * b + c


@jax.custom_jvp
def sqrt(x):
    """Return the square root, with a finite derivative at 0."""
    return jnp.sqrt(x)


@sqrt.defjvp
def _sqrt(primals, tangents):
    y = sqrt(primals[0])
    return y, tangents[0] * jnp.where(y > 0, 0.5 / jnp.where(y > 0, y, 1.0), 0.0)


@jax.custom_jvp
def log(x):
    """Return the logarithm, with a finite derivative at 0."""
    return jnp.log(x)


@log.defjvp
def _log(primals, tangents):
    x = primals[0]
    return log(x), tangents[0] * jnp.where(x > 0, 1 / jnp.where(x > 0, x, 1.0), 0.0)


@jax.custom_jvp
def divide(a, b):
    """Return a / b, with a derivative of 0 where b is 0."""
    return a / b


@divide.defjvp
def _divide(primals, tangents):
    (a, b), (da, db) = primals, tangents
    safe = jnp.where(b == 0, jnp.ones_like(b), b)
    return divide(a, b), jnp.where(b == 0, jnp.zeros_like(b), (da - a / safe * db) / safe)


floor, exp, sin, cos, tanh, where = jnp.floor, jnp.exp, jnp.sin, jnp.cos, jnp.tanh, jnp.where


def flush(x):
    """Return x, or 0 where it is too small to matter, with the derivative of x."""
    return x - lax.stop_gradient(jnp.where(abs(x) <= SILENT, x, 0.0 * x))


def settle(x):
    """Return x itself, as a flush would make loops nonlinear."""
    return x


def as_float(u):
    """Convert whole numbers to float64."""
    return lax.convert_element_type(u, jnp.float64)


def bits(x):
    """Return the bits of float64 numbers."""
    return lax.bitcast_convert_type(x, jnp.uint64)


def unbits(u):
    """Return the float64 numbers with these bits."""
    return lax.bitcast_convert_type(u, jnp.float64)


def search(knots, x, per):
    """Return the index of the piece that contains each position."""
    return jnp.sum(jnp.asarray(x)[..., None] >= knots[1:-1], axis=-1)


def tree(s):
    """Return the sum of eight numbers, in the order of the definition."""
    return ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))


TWINS: dict[str, Any] = {
    f.__name__: f for f in (fma, sqrt, log, flush, settle, as_float, bits, unbits, search, tree)
} | dict(
    floor=floor, exp=exp, moderate_exp=exp, sin=sin, cos=cos, tanh=tanh, where=where
)  # fmt: skip

NAMESPACE = types.SimpleNamespace(**TWINS, SILENT=SILENT, TINY=TINY, F=F)
TYPES = {
    np.uint64: lambda x: jnp.asarray(x).astype(jnp.uint64),
    np.int64: lambda x: jnp.asarray(x).astype(jnp.int64),
    np.float64: lambda x: jnp.asarray(x).astype(jnp.float64),
}


# A step and its helpers ---------------------------------------------------------------
_bound: dict[types.FunctionType, Callable] = {}


def bind(f: Callable) -> Callable:
    """Return a function that uses JAX's mathematics in place of stimlib's."""
    assert isinstance(f, types.FunctionType)
    if f in _bound:
        return _bound[f]
    scope: dict[str, Any] = {"__builtins__": builtins}
    twin = types.FunctionType(f.__code__, scope, f.__name__, f.__defaults__, f.__closure__)
    _bound[f] = twin  # before its helpers, should they refer to it
    for name in _names(f.__code__):
        if name in f.__globals__:
            scope[name] = _twin(f, name, f.__globals__[name])
    return twin


def _names(code: types.CodeType) -> set[str]:
    return set(code.co_names).union(
        *(_names(c) for c in code.co_consts if isinstance(c, types.CodeType))
    )


def _twin(f: Callable, name: str, v: Any) -> Any:
    if v is np:
        return types.SimpleNamespace(**{t.__name__: TYPES[t] for t in TYPES})
    if v is maths:
        return NAMESPACE
    if isinstance(v, type) and v in TYPES:
        return TYPES[v]
    ours = getattr(v, "__name__", "")
    if callable(v) and v is getattr(maths, ours, None):
        if ours not in TWINS:
            raise SceneError(
                f"{f.__qualname__} uses {name}, which works on arrays: it needs a lowering of its"
                " own for JAX"
            )
        return TWINS[ours]
    return bind(v) if isinstance(v, types.FunctionType) else v


def on_arrays(p: Any) -> Any:
    """Return design numbers whose arrays can be indexed by signals."""
    return jax.tree.map(lambda v: jnp.asarray(v) if isinstance(v, np.ndarray) else v, p)


# Evaluating with finite derivatives ---------------------------------------------------
def run(f: Callable, *args: Any) -> Any:
    """Return f(*args), computing every quotient by ``divide``."""
    flat, tree_in = jax.tree.flatten(args)
    closed, shape = jax.make_jaxpr(
        lambda *a: f(*jax.tree.unflatten(tree_in, a)), return_shape=True
    )(*flat)
    return jax.tree.unflatten(
        jax.tree.structure(shape), _evaluate(closed.jaxpr, closed.consts, flat)
    )


def _evaluate(jaxpr: Any, consts: Any, args: Any) -> list[Any]:
    env: dict[Any, Any] = {}

    def read(v):
        return v.val if isinstance(v, core.Literal) else env[v]

    for v, a in zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *args], strict=True):
        env[v] = a
    for e in jaxpr.eqns:
        x = [*map(read, e.invars)]
        inner = body_of(e)
        if e.primitive.name == "div" and jnp.issubdtype(e.outvars[0].aval.dtype, jnp.floating):
            out = [divide(*x)]
        elif inner is not None:
            out = _evaluate(inner.jaxpr, inner.consts, x)
        else:
            out = e.primitive.bind(*x, **e.primitive.get_bind_params(e.params))
            out = out if e.primitive.multiple_results else [out]
        env.update(zip(e.outvars, out, strict=True))
    return [*map(read, jaxpr.outvars)]


def body_of(e: Any) -> Any:
    """Return the body that a call of a plain jitted function runs, or None."""
    return e.params["jaxpr"] if e.primitive.name in ("pjit", "jit") else None
