"""System identification: fits a scene's parameters to a target by gradients.

Numbers are searched in relative units, p = start exp(u) or a similar mapping between
bounds, so that one step of u means the same for 1e-9 as for 1e9, and no step can leave
the bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..core.graph import unmasked
from ..core.scene import Scene
from ..errors import Above0, BadValue, Count, computed, counted, need, public
from ..motion.source import frames_of, positions, sources_of
from ..run.processor import compile
from ..system.packages import package
from ..system.progress import progress as bar
from .relaxation import _intervals

SEGMENTS = 16  # the fewest of a Welch estimate
BINS = 4  # between 0 Hz and the low end of its band
LARGEST = 1e150  # of a target, and 1 over the least: their squares must be numbers
FAR = 300.0  # where the coordinate of a number with a bound ends: exp(FAR) is a number


# Coordinates --------------------------------------------------------------------------
class Range(NamedTuple):
    """The range of a parameter, with the start of its search."""

    start: float
    low: float
    high: float

    def value(self, u: Any, xp: Any = np) -> Any:
        """Return the parameter's value at the search coordinate u.

        The value is ``start`` at u = 0, rises with u, and stays within low .. high.
        """
        start, low, high = self
        if math.isinf(low) and math.isinf(high):
            return start + (abs(start) or 1.0) * u
        u = xp.clip(u, -FAR, FAR)
        if math.isinf(high):
            return low + (start - low) * xp.exp(u)
        if math.isinf(low):
            return high - (high - start) * xp.exp(-u)
        odds = (start - low) / (high - start) * xp.exp(u)
        return xp.clip(low + (high - low) * (odds / (1 + odds)), low, high)

    def end(self, u: float) -> float:
        """Return the end of an interval at u: a bound where it is undetermined."""
        inside = abs(u) < FAR or (math.isinf(self.low) and math.isinf(self.high))
        return float(self.value(u)) if inside else self.high if u > 0 else self.low


def _ranges(params: Any, known: Mapping[str, float]) -> dict[str, Range]:
    if not isinstance(params, Mapping) or not params:
        raise BadValue(
            'fit: params must map names to starts, such as {"k": 100.0, "alpha": (0.5, 0, 1)};'
            f" got {params!r}"
        )
    need("fit", params, known, "parameter")
    out = {}
    for name, given in params.items():
        try:
            start, low, high = (
                float(v)
                for v in (
                    given if isinstance(given, (tuple, list)) else (given, math.nan, math.nan)
                )
            )
        except (TypeError, ValueError):
            raise BadValue(
                f"fit: {name} = {given!r} must be a start or (start, low, high)"
            ) from None
        if not math.isfinite(start):
            raise BadValue(f"fit: {name}: the start {start} must be finite")
        if not isinstance(given, (tuple, list)):
            if start == 0:
                raise BadValue(
                    f"fit: {name}: a start of 0 has neither sign nor size; give (start, low, high)"
                )
            low, high = (0.0, math.inf) if start > 0 else (-math.inf, 0.0)
        if not low < start < high:
            raise BadValue(
                f"fit: {name}: the start {start:g} must lie between {low:g} and {high:g}, not at"
                " an end"
            )
        out[name] = Range(start, low, high)
    return out


# What is compared ---------------------------------------------------------------------
@computed
def welch(x: Any, fs: float, segment: int) -> Any:
    """Return a one-sided PSD by Welch's method, in JAX.

    Parameters
    ----------
    x : array, shape (n,)
        At least ``segment`` samples.
    fs : float
        Hz.
    segment : int
        Samples, even.

    Returns
    -------
    array, shape (segment/2 + 1,)
        Units^2/Hz, at ``numpy.fft.rfftfreq(segment, 1/fs)``.

    Examples
    --------
    >>> import jax, numpy as np
    >>> from scipy import signal
    >>> from stimlib.fitting import welch
    >>> x = np.random.default_rng(0).standard_normal(5000)
    >>> with jax.enable_x64(True):
    ...     ours = welch(x, 1000.0, 256)
    >>> bool(np.allclose(ours, signal.welch(x, 1000.0, nperseg=256)[1], rtol=1e-12))
    True
    """
    if np.ndim(x) != 1 or not 1 <= segment <= np.size(x) or not fs > 0:
        raise BadValue(
            f"welch: fs = {fs} must be above 0, and segment = {segment} from 1 to the number of"
            f" samples of the row x, of shape {np.shape(x)}"
        )
    x = package("jax.numpy", "welch").asarray(x)
    return package("jax.scipy.signal", "welch").welch(x, fs, nperseg=segment)[1]


class View(NamedTuple):
    """The transformation of a signal that a loss compares with its target.

    The loss is the mean square of view(signal) - wanted.
    """

    wanted: dict[str, Any]
    see: Callable[[str, Any], Any]
    measure: str  # what the root of the loss is


def _signal(name: str, target: Any, n: int | None) -> np.ndarray:
    a = np.asarray(target)
    if a.dtype.kind not in "iuf" or a.ndim != 1:
        raise BadValue(
            f"fit: the target of {name} must be one row of real numbers, got {a.dtype} {a.shape}"
        )
    if n is not None and a.size != n:
        raise BadValue(f"fit: the target of {name} must be {counted(n, 'sample')}, got {a.size}")
    a = unmasked(target)
    if not (fits := np.abs(a) <= LARGEST).all():
        raise BadValue(
            f"fit: the target of {name} is not finite at sample {int(np.argmin(fits))}, or above"
            f" {LARGEST:g}"
        )
    if not np.abs(a).max(initial=0) > 1 / LARGEST:
        raise BadValue(f"fit: the target of {name} is 0 throughout: nothing can be relative to it")
    return a


def _force(targets: Mapping[str, Any], n: int, weight: Any) -> View:
    w = np.ones(n) if weight is None else np.asarray(weight)
    if (
        w.dtype.kind not in "biuf"
        or w.shape != (n,)
        or not np.isfinite(w).all()
        or not (w >= 0).all()
        or not w.any()
    ):
        raise BadValue(
            f"fit: weight must be {n} finite numbers from 0 on, not all 0; got {w.dtype} {w.shape}"
        )
    signals = {name: _signal(name, target, n) for name, target in targets.items()}
    root = {}
    for name, y in signals.items():
        power = float(np.mean(w * y**2))
        if not power > 0:
            raise BadValue(f"fit: the target of {name} is 0 wherever weight is not")
        root[name] = np.sqrt(w / power)
    return View(
        {name: root[name] * y for name, y in signals.items()},
        lambda name, y: root[name] * y,
        "relative rms error",
    )


def _log_psd(targets: Mapping[str, Any], n: int, fs: float, band: Any) -> View:
    import jax.numpy as jnp

    try:
        low, high = (float(v) for v in band)
    except (TypeError, ValueError):
        raise BadValue(f"fit: loss='log_psd' needs band=(low, high) in Hz, got {band!r}") from None
    if not 0 < low < high <= fs / 2:
        raise BadValue(
            f"fit: band = ({low:g}, {high:g}) Hz must rise within 0 .. fs/2 = {fs / 2:g}"
        )
    segment = 2 ** math.ceil(math.log2(BINS * fs / low))
    least = (SEGMENTS + 1) * segment // 2
    f = np.fft.rfftfreq(segment, 1 / fs)
    inside = np.flatnonzero((f >= low) & (f <= high))
    if not inside.size:
        raise BadValue(
            f"fit: band = ({low:g}, {high:g}) Hz holds no bin, they are {fs / segment:g} Hz apart;"
            " give a wider one"
        )

    def long(what: str, size: int) -> None:
        if size < least:
            raise BadValue(
                f"fit: {what}, {counted(size, 'sample')}, is too short for {SEGMENTS} segments"
                f" down to {low:g} Hz: give {least}"
            )

    long("the run", n)
    wanted = {}
    for name, target in targets.items():
        if callable(target):
            P = np.asarray(target(f[inside]), float)
        elif isinstance(target, tuple):
            P = _given_psd(name, target, f[inside])
        else:
            x = _signal(name, target, None)
            long(f"the target of {name}", x.size)
            P = np.asarray(welch(jnp.asarray(x), fs, segment))[inside]
        if P.shape != inside.shape or not np.isfinite(P).all() or not (P > 0).all():
            raise BadValue(
                f"fit: the PSD of {name} must be finite and above 0 at each of the {inside.size}"
                " bins of the band"
            )
        wanted[name] = np.log(P)
    return View(
        wanted, lambda name, y: jnp.log(welch(y, fs, segment)[inside]), "rms difference of ln PSD"
    )


def _given_psd(name: str, target: tuple[Any, ...], f: np.ndarray) -> np.ndarray:
    """Interpolate a PSD, given as (f, P), at other frequencies."""
    two = len(target) == 2
    g, density = (np.asarray(v, float) for v in target) if two else (np.zeros(0), np.zeros(0))
    if g.ndim != 1 or g.shape != density.shape or g.size < 2 or not (np.diff(g) > 0).all():
        raise BadValue(
            f"fit: the target of {name} must be a PSD as (f, P), two rows of one length, f rising"
        )
    if g[0] > f[0] or g[-1] < f[-1]:
        raise BadValue(
            f"fit: the PSD of {name}, {g[0]:g} .. {g[-1]:g} Hz, must reach over the band's bins,"
            f" {f[0]:g} .. {f[-1]:g} Hz"
        )
    if not (density > 0).all():
        raise BadValue(f"fit: the PSD of {name} must be above 0")
    return np.exp(np.interp(f, g, np.log(density)))


def _rms(targets: Mapping[str, Any]) -> View:
    import jax.numpy as jnp

    wanted = {}
    for name, target in targets.items():
        if np.ndim(target) == 0:
            try:
                value = float(target)
            except (TypeError, ValueError):
                value = math.nan
            if not (math.isfinite(value) and value > 0):
                raise BadValue(f"fit: the rms wanted of {name} must be above 0, got {target!r}")
        else:
            value = float(np.sqrt(np.mean(_signal(name, target, None) ** 2)))
        wanted[name] = np.array([math.log(value)])
    return View(
        wanted, lambda name, y: 0.5 * jnp.log(jnp.mean(y**2))[None], "ln of the ratio of rms"
    )


LOSSES = ("force", "log_psd", "rms")


# The result ---------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Fit:
    """The result of ``stimlib.fit``, which ``print`` shows as a table."""

    params: dict[str, float]
    """The fitted parameters, in their units."""
    intervals: dict[str, tuple[float, float]]
    """95 % confidence interval of each parameter, for the loss "force"; otherwise
    empty.  One that reaches a bound, or infinity, says that the target does not
    determine the parameter on that side.
    """
    loss: float
    """The smallest loss, reached with ``params``."""
    history: np.ndarray
    """Loss at the start and after each step, shape (steps + 1,)."""
    steps: int
    converged: bool
    """Whether the last step changed no parameter by more than the relative amount
    ``tol``, and the loss is flat at its minimum.
    """
    signals: dict[str, np.ndarray]
    """Every output of the fitted scene, each of shape (n,)."""
    scene: Scene
    """The scene that was fitted, with ``params`` as its initial values."""
    start: dict[str, float]
    units: dict[str, str]
    measure: str
    """Meaning of the square root of the loss."""

    def __repr__(self):
        values = ", ".join(f"{name}={value:.6g}" for name, value in self.params.items())
        return (
            f"Fit({values}; loss {self.loss:.3g}, {self.steps}"
            f" steps{'' if self.converged else ', not converged'})"
        )

    def __str__(self):
        rows = [("", "found", "95 %" if self.intervals else "", "start", "")]
        for name, value in self.params.items():
            unit = "" if self.units[name] == "1" else self.units[name]
            low, high = self.intervals.get(name, (0.0, 0.0))
            rows.append(
                (
                    name,
                    f"{value:.6g}",
                    f"{low:.6g} .. {high:.6g}" if self.intervals else "",
                    f"{self.start[name]:.6g}",
                    unit,
                )
            )
        wide = [max(len(row[i]) for row in rows) for i in range(4)]
        lines = [
            "  ".join(
                [
                    row[0].ljust(wide[0]),
                    *(row[i].rjust(wide[i]) for i in (1, 2, 3) if wide[i]),
                    row[4],
                ]
            )
            for row in rows
        ]
        what = (
            f"{self.measure} {math.sqrt(self.loss):.3g}"
            if self.measure
            else f"loss {self.loss:.3g}"
        )
        end = "converged" if self.converged else "not converged"
        return "\n".join(
            [*(line.rstrip() for line in lines), f"{what}; {counted(self.steps, 'step')}, {end}"]
        )


# The search ---------------------------------------------------------------------------
@public
def fit(
    scene: Scene,
    motion: Mapping[str, Any],
    target: Any,
    params: Mapping[str, Any],
    loss: str | Callable[[dict[str, Any], Any], Any] = "force",
    *,
    fs: float,
    seconds: float | None = None,
    weight: Any = None,
    band: tuple[float, float] | None = None,
    seed: int = 0,
    surrogate: float | None = None,
    steps: Count = 200,
    tol: Above0 = 1e-8,
    optimiser: Any = None,
    progress: bool = False,
) -> Fit:
    """Fit the parameters of a scene so that its signals come closest to a target.

    The inputs of the scene follow a given motion.

    Parameters
    ----------
    scene : Scene
        Parameters that are not fitted keep their values.
    motion : dict of str to callable or ndarray
        Every input, as for ``stimlib.render``.
    target : array_like or dict of str to array_like
        Target of the output, or of several outputs by name; see ``loss``.
    params : dict of str to float or (start, low, high)
        Parameters to fit.  A bound may be infinite and is never reached; without
        bounds, a parameter keeps the sign of its start.
    loss : {"force", "log_psd", "rms"} or callable
        "force": mean square of the difference, over the mean square of the target, a
        signal (n,). "log_psd": mean square of the difference of the natural logarithms
        of the Welch PSDs in ``band``.  The target is a signal of any length, a pair of
        arrays (f, P), or a function of f; P is one-sided, in units^2/Hz. "rms": square
        of the natural logarithm of the ratio of the RMS values.  The target is a
        signal, or a number. Or a function (signals, target) -> scalar in ``jax.numpy``,
        called with all outputs by name and with the target as given.
    fs : float
        Sample rate in Hz, also of motion arrays and of the target.
    seconds : float, optional
        Length of the run; by default that of the target of "force", otherwise of the
        shortest motion array.
    weight : array_like, shape (n,), optional
        With "force", weight of each squared difference and of each squared target: 0
        leaves a sample out, 1/target**2 makes errors relative.
    band : (low, high), optional
        With "log_psd", in Hz.
    seed : int
        Seed of all noise, the same at every step.
    surrogate : float, optional
        Relative width of the smooth edge whose derivative replaces that of a gate; see
        ``stimlib.compile``.
    steps : int
        Maximum number of steps.
    tol : float
        The search ends when a step changes every number by less than this relative
        amount, and the loss is flat: its slope is below sqrt(tol) times that at the
        start, or times the loss, and for no number exactly 0.
    optimiser : optax.GradientTransformation, optional
        By default ``optax.lbfgs()``, with its line search.
    progress : bool
        A progress bar on stderr, if that is a terminal.

    Raises
    ------
    UnknownName
        Parameters, inputs or outputs that the scene does not have.
    BadValue
        A target, weight or band of a wrong shape, not finite, or 0 throughout; a start
        that is not between its bounds; a parameter without effect at its start (its
        derivative is exactly 0); a loss that is not finite there.

    Notes
    -----
    A gradient search finds the minimum of the valley in which it starts, and ends
    unconverged if a line search finds nothing lower.  Intervals come from the
    Gauss-Newton matrix and assume independent and equal errors (with ``weight``,
    weighted errors).  A loss on noise compares one realisation, so its results scatter
    like those of one recording.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib import Input, Param
    >>> from stimlib.blocks import velocity
    >>> y = Input("y", "m")
    >>> tissue = stimlib.Scene(
    ...     {
    ...         "force": Param("k", 50.0, "N/m") * y
    ...         + Param("b", 1.0, "N s/m") * velocity(y)
    ...     }
    ... )
    >>> t = np.arange(300) / 1000
    >>> motion = {"y": 0.01 * np.sin(20 * t) ** 2}
    >>> force = stimlib.render(tissue, motion, fs=1000, params={"k": 80.0, "b": 3.0})[
    ...     "force"
    ... ]
    >>> stimlib.fit(tissue, motion, force, {"k": 50.0, "b": (1.0, 0, 10)}, fs=1000)
    Fit(k=80, b=3; loss ..., ... steps)
    """
    jax, jnp, optax = (package(name, "fit") for name in ("jax", "jax.numpy", "optax"))

    _check_search(loss, weight, band)
    opt = optax.lbfgs() if optimiser is None else optimiser
    if not isinstance(opt, optax.GradientTransformation):
        raise BadValue(
            "fit: optimiser must be an optax.GradientTransformation, such as optax.adam(0.05), got"
            f" {optimiser!r}"
        )
    opt = optax.with_extra_args_support(opt)
    f = compile(scene, fs, target="jax", seed=seed, surrogate=surrogate)
    ranges = _ranges(params, f.params)
    targets = {} if callable(loss) else _targets(target, f.outputs)
    n = _length(motion, f.inputs, targets if loss == "force" else {}, seconds, f.fs)
    x = dict(zip(f.inputs, positions(sources_of(motion, f.inputs, n), 0, n, f.fs), strict=True))

    with jax.enable_x64(True):
        view = (
            None
            if callable(loss)
            else _force(targets, n, weight)
            if loss == "force"
            else _log_psd(targets, n, f.fs, band)
            if loss == "log_psd"
            else _rms(targets)
        )

        def run(u: Any, x: Any) -> dict[str, Any]:
            return f(
                {name: r.value(u[i], jnp) for i, (name, r) in enumerate(ranges.items())},
                x,
                seed,
                n=n,
            )

        def miss(signals: Mapping[str, Any]) -> dict[str, Any]:
            return (
                {
                    name: view.see(name, signals[name]) - wanted
                    for name, wanted in view.wanted.items()
                }
                if view
                else {}
            )

        def total(u: Any, x: Any) -> Any:
            signals = run(u, x)
            if callable(loss):
                value = jnp.asarray(loss(signals, target), float)
                if value.shape:
                    raise BadValue(f"fit: the loss must be one number, got an array {value.shape}")
                return value
            return jnp.mean(jnp.stack([jnp.mean(r**2) for r in miss(signals).values()]))

        slope = jax.jit(jax.value_and_grad(total))

        @jax.jit
        def step(u, value, grad, state, x):
            change, state = opt.update(
                grad, state, u, value=value, grad=grad, value_fn=lambda u: total(u, x)
            )
            return optax.apply_updates(u, change), state

        @jax.jit
        def ending(u, x):
            def both(u):
                signals = run(u, x)
                return miss(signals), (miss(signals), signals)

            if loss == "force":
                return jax.jacfwd(both, has_aux=True)(u)
            return {}, ({}, run(u, x))

        u = jnp.zeros(len(ranges))
        value, grad = slope(u, x)
        _check_start(np.asarray(value), np.asarray(grad), ranges)
        state = jax.tree.map(
            lambda a: jnp.asarray(a, a.dtype), opt.init(u)
        )  # of the types that a step gives, or it compiles twice
        with bar("fit", steps, progress) as advance:
            best, history, converged = _searched(
                lambda *now: step(*now, x),
                lambda u: slope(u, x),
                (u, value, grad, state),
                steps,
                tol,
                advance,
            )
        at = np.asarray(best[1])
        J, (misses, signals) = jax.tree.map(np.asarray, ending(best[1], x))
    found = {name: float(r.value(at[i])) for i, (name, r) in enumerate(ranges.items())}
    intervals = _confidence(at, J, misses, ranges) if J else {}
    return Fit(
        found,
        intervals,
        best[0],
        np.array(history),
        len(history) - 1,
        converged,
        signals,
        _with(scene, found),
        start={name: r.start for name, r in ranges.items()},
        units={name: f.units[name] for name in ranges},
        measure=view.measure if view else "",
    )


def _searched(
    step: Any, slope: Any, first: tuple[Any, ...], steps: int, tol: float, advance: Any
) -> tuple[tuple[float, Any], list[float], bool]:
    """Return the best loss with its numbers, all losses, and whether it converged."""
    u, value, grad, state = first
    history, best = [float(value)], (float(value), u)
    steep = float(np.abs(grad).max())
    converged = best[0] == 0
    while len(history) <= steps and not converged:
        new, state = step(u, value, grad, state)
        value, grad = slope(new)
        history.append(float(value))
        advance(1, f"fit, loss {history[-1]:.3g}")
        if not (math.isfinite(history[-1]) and np.isfinite(grad).all()):
            break
        if history[-1] <= best[0]:
            best = (history[-1], new)
        change, u = float(np.abs(np.asarray(new) - np.asarray(u)).max()), new
        # of each number; exactly 0 where it is out of reach, which is no minimum
        effect = np.abs(grad)
        flat = effect.all() and effect.max() <= math.sqrt(tol) * max(steep, abs(history[-1]))
        least = history[-1] - best[0] <= tol * abs(best[0])
        converged = change <= tol and least and bool(flat or abs(history[-1]) <= tol**2)
        if change == 0:
            break
    return best, history, converged


def _check_search(loss: Any, weight: Any, band: Any) -> None:
    """Check the options of a search; raise BadValue if they do not fit together."""
    if not (callable(loss) or loss in LOSSES):
        raise BadValue(
            f"fit: loss = {loss!r}: choose one of {', '.join(LOSSES)}, or a function of (signals,"
            " target)"
        )
    for name, given, only in (("weight", weight, "force"), ("band", band, "log_psd")):
        if given is not None and loss != only:
            raise BadValue(f"fit: {name} belongs to loss={only!r}")


def _targets(target: Any, outputs: tuple[str, ...]) -> dict[str, Any]:
    if isinstance(target, Mapping):
        need("fit: target", target, outputs, "output")
        if not target:
            raise BadValue("fit: the target has no output")
        return dict(target)
    if len(outputs) > 1:
        raise BadValue(
            f"fit: this scene has the outputs {', '.join(outputs)}: give the target as a dict by"
            " output"
        )
    return {outputs[0]: target}


def _length(
    motion: Any,
    inputs: tuple[str, ...],
    signals: Mapping[str, Any],
    seconds: float | None,
    fs: float,
) -> int:
    """Return the number of samples of the run."""
    lengths = {name: np.size(target) for name, target in signals.items()}
    if len(set(lengths.values())) > 1:
        raise BadValue(
            "fit: targets must have one length, got"
            f" {', '.join(f'{name}: {n}' for name, n in lengths.items())}"
        )
    if seconds is not None:
        n = frames_of(seconds, fs)
        for name, size in lengths.items():
            if size != n:
                raise BadValue(
                    f"fit: seconds = {seconds:g} are {counted(n, 'sample')} at {fs:g} Hz, the"
                    f" target of {name} has {size}"
                )
        return n
    rows = [len(s) for s in sources_of(motion, inputs, 0).values() if not callable(s)]
    if not lengths and not rows:
        raise BadValue("fit: the length of the run is not known: give seconds")
    n = min([*lengths.values(), *(() if lengths else rows)])
    if not n:
        raise BadValue("fit: the run has no sample")
    return n


def _check_start(value: Any, grad: Any, ranges: Mapping[str, Range]) -> None:
    """Raise BadValue if a search cannot begin at its start."""
    starts = ", ".join(f"{name} = {r.start:g}" for name, r in ranges.items())
    if not math.isfinite(value):
        raise BadValue(
            f"fit: the loss must be a finite number, it is {value} at the start, {starts}; try"
            " another one"
        )
    wrong = [name for name, g in zip(ranges, grad, strict=True) if not math.isfinite(g)]
    if wrong:
        raise BadValue(
            f"fit: the derivative by {', '.join(wrong)} is not finite at the start, {starts}; try"
            " another one"
        )
    if value == 0:
        return
    still = [name for name, g in zip(ranges, grad, strict=True) if g == 0]
    if still:
        raise BadValue(
            f"fit: {', '.join(still)}: no effect on the loss at the start, {starts} (the derivative"
            " is exactly 0). Does the motion reach it? What acts through gates or comparisons"
            " alone needs surrogate=0.1, say"
        )


def _confidence(
    u: np.ndarray, slopes: Mapping[str, Any], misses: Mapping[str, Any], ranges: Mapping[str, Range]
) -> dict:
    """Return the 95 % confidence intervals by name.

    There are none unless there are more samples than numbers. Samples of weight 0 do
    not count.
    """
    J = np.concatenate([np.asarray(slopes[name]) for name in misses])
    r = np.concatenate([np.asarray(v) for v in misses.values()])
    counts = (r != 0) | J.any(axis=1)
    if counts.sum() <= u.size:
        return {}
    return {
        name: (q.end(a), q.end(b))
        for (name, q), a, b in zip(
            ranges.items(), *_intervals(u, J[counts], r[counts]), strict=True
        )
    }


def _with(scene: Scene, params: Mapping[str, float]) -> Scene:
    """Return the scene with other initial parameter values."""
    data = scene.to_dict()
    for b in data["blocks"]:
        if b["class"] == "Param" and b["fields"]["name"] in params:
            b["fields"]["value"] = params[b["fields"]["name"]]
    return Scene.from_dict(data)
