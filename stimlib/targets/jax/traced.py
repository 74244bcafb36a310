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
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core

from ...core import maths
from ...core.steps import meaning, ours
from ...errors import SceneError

# The twins ----------------------------------------------------------------------------
SILENT, F = maths.SILENT, maths.F


def fma(a, b, c):
    """Return a b + c."""
    return a * b + c


# at 0 the slope of JAX's own is infinite, and infinity times a tangent of 0 is NaN: one
# such sample would spoil a gradient over all
@jax.custom_jvp
def sqrt(x):
    """Return the square root, with a finite derivative at 0."""
    return jnp.sqrt(x)


@sqrt.defjvp
def _sqrt(primals, tangents):
    root = sqrt(primals[0])
    return root, tangents[0] * jnp.where(root > 0, 0.5 / jnp.where(root > 0, root, 1.0), 0.0)


@jax.custom_jvp
def log(x):
    """Return the logarithm, with a finite derivative at 0."""
    return jnp.log(x)


@log.defjvp
def _log(primals, tangents):
    value = primals[0]
    return log(value), tangents[0] * jnp.where(value > 0, 1 / jnp.where(value > 0, value, 1.0), 0.0)


@jax.custom_jvp
def divide(numerator, denominator):
    """Return a / b, with a derivative of 0 where b is 0."""
    return numerator / denominator


@divide.defjvp
def _divide(primals, tangents):
    (numerator, denominator), (change_above, change_below) = primals, tangents
    # a choice after the division would still have the derivative of both sides
    safe = jnp.where(denominator == 0, jnp.ones_like(denominator), denominator)
    return divide(numerator, denominator), jnp.where(
        denominator == 0,
        jnp.zeros_like(denominator),
        (change_above - numerator / safe * change_below) / safe,
    )


floor, exp, tanh, where = jnp.floor, jnp.exp, jnp.tanh, jnp.where
sin, cos = (
    lambda x, f=f: where(abs(x) <= maths.MOST_SIN, f(x), jnp.nan) for f in (jnp.sin, jnp.cos)
)


def flush(x):
    """Return x, or 0 where it is too small to matter, with the derivative of x."""
    # subtracted as a constant: the derivative stays that of the number
    return x - lax.stop_gradient(jnp.where(abs(x) <= SILENT, x, 0.0))


def settle(x):
    """Return x itself, as a flush would make loops nonlinear."""
    return x


def as_float(u):
    """Convert whole numbers to float64."""
    return lax.convert_element_type(u, jnp.float64)


def bits(x):
    """Return the bits of float64 numbers."""
    return lax.bitcast_convert_type(jnp.asarray(x, jnp.float64), jnp.uint64)


def unbits(u):
    """Return the float64 numbers with these bits."""
    return lax.bitcast_convert_type(u, jnp.float64)


def search(knots, x, per):
    """Return the index of the piece that contains each position."""
    # all knots at once: a bisection would be a loop
    return jnp.sum(jnp.asarray(x)[..., None] >= knots[1:-1], axis=-1)


TWINS: dict[str, Any] = {
    f.__name__: f for f in (fma, sqrt, log, flush, settle, as_float, bits, unbits, search)
} | dict(
    floor=floor, exp=exp, moderate_exp=exp, sin=sin, cos=cos, tanh=tanh, where=where,
    quotient=maths.quotient, tree=maths.tree,
)  # fmt: skip

NAMESPACE = types.SimpleNamespace(**maths.CONSTANTS, **TWINS, F=F)


def _converted(kind, x):
    """Return a number as one of a type: of a float beyond, what numpy makes on x86."""
    if not isinstance(x, jax.Array):
        return kind(x)  # what is known stays known, such as the end of a range
    if kind is np.float64 or not jnp.issubdtype(x.dtype, jnp.floating):
        return x.astype(kind)
    most = jnp.where((x >= 2.0**63) & (kind is np.uint64), 2.0**63, 0.0)
    near = jnp.where(abs(x - most) < 2.0**63, x - most, -(2.0**63)).astype(np.int64)
    return near.view(kind) + most.astype(kind)


TYPES = {kind: partial(_converted, kind) for kind in (np.uint64, np.int64, np.float64)}


# A step and its helpers ---------------------------------------------------------------
_bound: dict[Any, Callable] = {}


def bind(function: Callable) -> Callable:
    """Return a function that uses JAX's mathematics in place of stimlib's."""
    assert isinstance(function, types.FunctionType)
    # with its code and numbers: a cell of a notebook may change them
    key = function, function.__code__, () if ours(function) else meaning(function)
    if key in _bound:
        return _bound[key]
    # the same code with other names around it: what a step means is written once
    scope: dict[str, Any] = {"__builtins__": builtins}
    twin = types.FunctionType(
        function.__code__, scope, function.__name__, function.__defaults__, function.__closure__
    )
    # one twin for each, so that JAX sees the same one at each trace
    _bound[key] = twin  # before its helpers, should they refer to it
    # also names of functions inside, such as comprehensions
    for name in _names(function.__code__):
        if name in function.__globals__:
            scope[name] = _twin(function, name, function.__globals__[name])
    return twin


def _names(code: types.CodeType) -> set[str]:
    return set(code.co_names).union(
        *(_names(inner) for inner in code.co_consts if isinstance(inner, types.CodeType))
    )


def _twin(function: Callable, name: str, value: Any) -> Any:
    # conversions of a step: numpy's own cannot take a number that is traced
    if value is np:
        return types.SimpleNamespace(
            **{own: v for own, v in vars(np).items() if isinstance(v, float)},
            **{kind.__name__: convert for kind, convert in TYPES.items()},
        )
    if value is maths:
        return NAMESPACE
    if isinstance(value, type) and value in TYPES:
        return TYPES[value]
    # by identity, not by name alone: an author may call a helper exp
    own = getattr(value, "__name__", "")
    if callable(value) and value is getattr(maths, own, None):
        if own not in TWINS:
            raise SceneError(
                f"{function.__qualname__} uses {name}, which works on arrays: it needs a lowering"
                " of its own for JAX"
            )
        return TWINS[own]
    return bind(value) if isinstance(value, types.FunctionType) else value


def on_arrays(numbers: Any) -> Any:
    """Return design numbers whose arrays can be indexed by signals."""
    return jax.tree.map(
        lambda field: jnp.asarray(field) if isinstance(field, np.ndarray) else field, numbers
    )


# Evaluating with finite derivatives ---------------------------------------------------
def run(function: Callable, *args: Any) -> Any:
    """Return f(*args), computing every quotient by ``divide``."""
    # on the jaxpr, not by other operators: a quotient may stand in any helper
    flat, tree_in = jax.tree.flatten(args)
    closed, shape = jax.make_jaxpr(
        lambda *given: function(*jax.tree.unflatten(tree_in, given)), return_shape=True
    )(*flat)
    return jax.tree.unflatten(
        jax.tree.structure(shape), _evaluate(closed.jaxpr, closed.consts, flat)
    )


def _evaluate(jaxpr: Any, consts: Any, args: Any) -> list[Any]:
    values: dict[Any, Any] = {}

    def read(variable):
        return variable.val if isinstance(variable, core.Literal) else values[variable]

    for variable, given in zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *args], strict=True):
        values[variable] = given
    for equation in jaxpr.eqns:
        operands = [*map(read, equation.invars)]
        # jitted functions of jax.numpy have bodies with quotients, too
        inner = body_of(equation)
        if equation.primitive.name == "div" and jnp.issubdtype(
            equation.outvars[0].aval.dtype, jnp.floating
        ):
            results = [divide(*operands)]
        elif inner is not None:
            results = _evaluate(inner.jaxpr, inner.consts, operands)
        else:
            # all other operations as they were
            results = equation.primitive.bind(
                *operands, **equation.primitive.get_bind_params(equation.params)
            )
            results = results if equation.primitive.multiple_results else [results]
        values.update(zip(equation.outvars, results, strict=True))
    return [*map(read, jaxpr.outvars)]


def body_of(equation: Any) -> Any:
    """Return the body that a call of a plain jitted function runs, or None."""
    return equation.params["jaxpr"] if equation.primitive.name in ("pjit", "jit") else None
