"""What a problem is made of: methods with a knob, run on one signal and held against
one reference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from stimlib.core.graph import Block, Input
from stimlib.core.scene import Scene
from stimlib.run.processor import compile

Job = Callable[[], object]


Signal = Callable[[np.ndarray], np.ndarray]


class Method(NamedTuple):
    """One point of a ladder."""

    family: str
    knob: str
    job: Job
    """What is timed."""
    error: Callable[[], float]
    """Against the reference; not timed."""


class Problem(NamedTuple):
    """What all methods are given, and how far from the truth they come."""

    name: str
    title: str
    error: str
    """What the error is, with its unit, as on the axis."""
    samples: int
    """Of one job."""
    methods: Callable[[], list[Method]]
    """Those that are installed."""
    per: str = "a sample"
    """What a time is for, as on the axis."""
    asked: bool = False
    """Whether the knob is part of what is asked, such as a cutoff, and no tuning: only
    points with one value can be compared.
    """


Ladder = tuple[Iterable[Any], Callable[[Any], Signal]]
"""Values of a knob, and what makes a method of one."""


def own(
    block: Callable[..., Block], fs: float, units: str | tuple[str, ...] = "", dtype: str = ""
) -> Callable[[Any], Signal]:
    """Make methods of a block of inputs and a knob: functions of whole signals, from
    sample 0 each time.

    units is that of the one input, or those of several, whose signals are then rows,
    shape (inputs, n); with none of them, a signal says only how long to run.  With
    dtype "float64" or "float32" they run on JAX.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.problem import own
    >>> own(lambda x, k: k * x, 8000.0)(3.0)(np.ones(2))
    array([3., 3.])
    >>> own(lambda x, y, k: x + k * y, 8000.0, ("m", "m"))(3.0)(np.ones((2, 2)))
    array([4., 4.])
    """
    inputs = [
        Input(f"x{k}", u) for k, u in enumerate((units,) if isinstance(units, str) else units)
    ]

    def make(knob: Any) -> Signal:
        scene = Scene({"y": block(*inputs, knob)})
        if dtype:
            return _jax(scene, fs, dtype)
        proc = compile(scene, fs)
        assert list(proc.inputs) == [x.name for x in inputs]

        def run(x: np.ndarray) -> np.ndarray:
            proc.reset()
            return proc.process(np.atleast_2d(x)[: len(inputs)])[0]

        return run

    return make


def always(f: Signal) -> Callable[[Any], Signal]:
    """Make methods of one that no knob changes.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.problem import always
    >>> always(np.negative)("any knob")(np.ones(2))
    array([-1., -1.])
    """
    return lambda _: f


def searched(
    error: Callable[[Signal], float], grid: Iterable[tuple], make: Callable[..., Signal]
) -> Signal:
    """Return the method with the smallest error over a grid of its free parameters.

    Those are what takes no time, such as the weight of a stop band or the shape of a
    window; a knob, such as a number of taps, takes time and is a ladder.  What cannot
    be made at a place of the grid is left out.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.problem import searched
    >>> f = searched(
    ...     lambda f: abs(f(2.0) - 5.0), [(1,), (2,), (4,)], lambda k: lambda x: k * x
    ... )
    >>> f(2.0)
    4.0
    """
    found: list[tuple[float, Signal]] = []
    for place in grid:
        try:
            f = make(*place)
            with np.errstate(all="ignore"):
                found.append((error(f), f))
        except (ValueError, RuntimeError):  # a design that does not converge, or is none
            continue
    return min((p for p in found if p[0] == p[0]), key=lambda p: p[0])[1]


def _jax(scene: Scene, fs: float, dtype: str) -> Signal:
    import jax

    f: Any = compile(scene, fs, "jax", dtype=dtype)
    inner = jax.jit(lambda x: f(None, x)["y"])

    def run(x: np.ndarray) -> np.ndarray:
        with jax.enable_x64(True):
            return np.asarray(inner(np.atleast_2d(x)), float)

    return run


def on(
    x: np.ndarray, error: Callable[[Signal], float], ladders: Mapping[str, Ladder]
) -> list[Method]:
    """Methods of families by name, all run on one signal and held against one
    reference.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.problem import on
    >>> ladders = {"scale": ([1, 2], lambda k: lambda x: k * x)}
    >>> [m.error() for m in on(np.ones(3), lambda f: float(f(np.ones(1))[0]), ladders)]
    [1.0, 2.0]
    """
    rungs = [(name, knob, make) for name, (knobs, make) in ladders.items() for knob in knobs]
    return [_rung(name, knob, make, x, error) for name, knob, make in rungs]


def _rung(
    name: str,
    knob: Any,
    make: Callable[[Any], Signal],
    x: np.ndarray,
    error: Callable[[Signal], float],
) -> Method:
    text = f"{knob:g}" if isinstance(knob, float) else str(knob)
    try:
        f = make(knob)
    except Exception as e:  # a design that cannot be made is a row that says so
        return Method(name, text, lambda: None, partial(_again, e))
    return Method(name, text, partial(f, x), partial(error, f))


def _again(e: Exception) -> float:
    raise e


def apart(y: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference, over the largest value.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.problem import apart
    >>> apart(np.array([1.0, 2.5]), np.array([1.0, 2.0]))
    0.25
    """
    return float(np.abs(y - wanted).max() / np.abs(wanted).max())


def response(f: Signal, n: int, at: int = 0) -> np.ndarray:
    """Of a linear method: the transform of its answer to one sample, n of them after
    sample ``at``.

    Examples
    --------
    >>> import numpy as np
    >>> from problems.problem import response
    >>> abs(response(lambda x: 0.5 * x, 8))
    array([0.5, 0.5, 0.5, 0.5, 0.5])
    """
    x = np.zeros(at + n)
    x[at] = 1.0
    return np.fft.rfft(f(x)[at:])
