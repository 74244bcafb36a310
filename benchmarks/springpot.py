"""The springpot: its errors over a minute and an hour, and what it claims of its time.

    python benchmarks/springpot.py              errors over a minute, then times
    python benchmarks/springpot.py --long       of an hour at 1 and 8 kHz, too
    python benchmarks/springpot.py --peers DIR  a site-packages folder with fracmem
    python benchmarks/springpot.py --record     and keep in results/springpot*.csv

Errors are against the full sum over the history in long double (64 bits).  Times: jobs
take turns in one process, medians of the rounds.  Other methods beside it: ``python
benchmarks/work_precision.py FOLDER --only springpot_gl --only springpot_l1``.
"""

from __future__ import annotations

import sys
from functools import cache, partial

import mpmath
import numpy as np
from bench import NS, TIMES, options, row, save
from scipy import signal
from timing import interleaved, machine, medians, ratio

import stimlib
from stimlib import Input, Scene
from stimlib.blocks import springpot

LD = np.longdouble
Y = Input("y", "m")
ALPHAS = [0.0, 1e-6, 0.05, 0.25, 0.5, 0.75, 0.95, 1 - 1e-6, 1.0]
TOLS = [1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14]
KINDS = ["sinusoid", "ramp", "smooth", "quantised"]


# References ---------------------------------------------------------------------------
@cache
def gl_weights(alpha: float, n: int) -> np.ndarray:
    """Gamma(j + 1 - alpha)/(Gamma(1 - alpha) j!) in long double: products, then the
    series of a ratio of gammas.
    """
    a, few = LD(alpha), min(n, 4096)
    j = np.arange(1, few, dtype=LD)
    v = np.zeros(n, LD)
    v[:few] = np.cumprod(np.r_[LD(1), (j - a) / j])
    if n > few and alpha < 1:
        with mpmath.workdps(30):
            g = LD(mpmath.nstr(1 / mpmath.gamma(1 - mpmath.mpf(alpha)), 25))
        rho = (1 - a) / 2
        w = np.arange(few, n, dtype=LD) + rho
        u = 1 / w**2
        second = a * (a + 1) / 24 * (a + 2) * (a + 3) * rho * (5 * rho + 1) / 60
        v[few:] = g * w**-a * (1 + u * (-a * (a + 1) / 12 * rho + u * second))
    return v


def full_sum(d: np.ndarray, alpha: float, fs: float, at: list[int]) -> np.ndarray:
    v = gl_weights(alpha, d.size)
    return LD(fs) ** LD(alpha) * np.array([np.dot(v[: n + 1], d[n::-1]) for n in at])


def differences(x: np.ndarray) -> np.ndarray:
    x = x.astype(LD)
    return np.diff(x, prepend=x[0])


def movement(kind: str, n: int, fs: float) -> np.ndarray:
    """In m; all start at 0 but ``smooth``."""
    t, rng = np.arange(n) / fs, np.random.default_rng(7)
    if kind == "sinusoid":
        return 0.01 * np.sin(2 * np.pi * t)
    if kind == "ramp":
        return 0.02 * np.minimum(t, 0.5)
    if kind == "quantised":
        return np.round(0.01 * np.sin(2 * np.pi * t) / 1e-6) * 1e-6
    parts = rng.normal(size=8), rng.uniform(0.2, 5, 8), rng.uniform(0, 6, 8)
    return sum(0.003 * a * np.sin(2 * np.pi * f * t + p) for a, f, p in zip(*parts, strict=True))


def spots(n: int, many: int) -> list[int]:
    return sorted({int(k) for k in np.geomspace(1, n - 1, many)})


# Errors -------------------------------------------------------------------------------
def errors(fs: float, seconds: float, tols: list[float], many: int) -> list[dict[str, object]]:
    """Error over the maximum, and over the certificate, of ``gl``."""
    n = int(fs * seconds) + 1
    at = spots(n, many)
    procs = {}
    for tol in tols:
        for alpha in ALPHAS:
            force, bound = springpot(Y, 1.0, alpha, "gl", tol=tol, certificate=True)
            procs[tol, alpha] = stimlib.compile(Scene({"f": force, "bound": bound}), fs)
    out: list[dict[str, object]] = []
    for alpha in ALPHAS:
        for kind in KINDS:
            x = movement(kind, n, fs)
            d = differences(x)
            wanted = full_sum(d, alpha, fs, at)
            most = full_sum(np.abs(d, out=d), alpha, fs, at).astype(float)
            for tol in tols:
                proc = procs[tol, alpha]
                proc.reset()
                f, bound = proc.process(x[None])
                error = np.abs(f[at] - wanted).astype(float)
                out.append(
                    {
                        "fs": fs,
                        "seconds": seconds,
                        "input": kind,
                        "alpha": alpha,
                        "tol": tol,
                        "error_over_max": float(error.max() / np.abs(f).max()),
                        "error_over_certificate": float(
                            np.max(error[most > 0] / bound[at][most > 0], initial=0.0)
                        ),
                        "certificate_over_tol": float(
                            np.max(bound[at][most > 0] / most[most > 0], initial=0.0) / tol
                        ),
                        "kept": bool(
                            np.all(error <= bound[at]) and np.all(bound[at] <= tol * most)
                        ),
                    }
                )
        gl_weights.cache_clear()
    worst = max(r["error_over_max"] for r in out if r["tol"] == min(tols))  # type: ignore[type-var]
    kept = sum(bool(r["kept"]) for r in out)
    print(
        f"{fs:g} Hz, {seconds:g} s: kept in {kept} of {len(out)} cases; tol {min(tols):g}:"
        f" {worst:.2g} of max"
    )
    return out


# Claims -------------------------------------------------------------------------------
def claims(fs: float = 1000.0) -> list[dict[str, object]]:
    """One figure each."""
    out: list[dict[str, object]] = []

    def tell(what, value, unit):
        out.append(row(what, float(value), unit))

    n, alpha = 1 << 16, 0.4
    x = movement("sinusoid", n, fs)
    proc = stimlib.compile(Scene({"f": springpot(Y, 1.0, alpha, "gl")}), fs)
    moving, held, y = x[None].copy(), np.full((1, n), x[-1]), np.empty((1, n))
    late = stimlib.compile(Scene({"f": springpot(Y, 1.0, alpha, "gl")}), fs)
    hour = movement("sinusoid", int(3600 * fs), fs)
    late.process(hour[None])
    after = late.state
    still = stimlib.compile(Scene({"f": springpot(Y, 1.0, alpha, "gl")}), fs)
    still.process(moving)
    for _ in range(40):
        still.process(held)
    quiet = still.state

    def start(which, state, x):
        which.state = state
        which.process(x, y)

    proc.reset()
    first = proc.state
    times = interleaved(
        {
            "first minute": partial(start, proc, first, moving),
            "after an hour": partial(start, late, after, moving),
            "hold": partial(start, still, quiet, held),
        },
        25,
    )
    tell("tol 1e-10, 1 kHz, in the first minute", medians(times)["first minute"] / n * 1e9, NS)
    tell(
        "ratio: after an hour / first minute", ratio(times, "after an hour", "first minute"), TIMES
    )
    tell("ratio: hold (40 min long) / moving", ratio(times, "hold", "first minute"), TIMES)

    v = gl_weights(alpha, hour.size).astype(float)
    out1 = np.empty((1, hour.size))
    d = np.diff(hour, prepend=hour[0])

    def whole():
        proc.reset()
        proc.process(hour[None], out1)

    times = interleaved(
        {"springpot": whole, "oaconvolve": lambda: signal.oaconvolve(d, v)[: hour.size]}, 5, 1
    )
    tell("hour at 1 kHz", medians(times)["springpot"] / hour.size * 1e9, NS)
    tell("hour at 1 kHz: oaconvolve", medians(times)["oaconvolve"] / hour.size * 1e9, NS)
    tell("ratio: oaconvolve / springpot", ratio(times, "oaconvolve", "springpot"), TIMES)

    live = stimlib.compile(Scene({"f": springpot(Y, 1.0, Input("a"), "gl")}), fs)
    orders = {"standing": np.full(n, 0.4), "ramping": np.linspace(0, 1, n)}
    rows = {k: np.array([{"y": x, "a": a}[i] for i in live.inputs]) for k, a in orders.items()}
    took = medians(interleaved({k: partial(live.process, r, y) for k, r in rows.items()}, 9))
    for k in rows:
        tell(f"live alpha {k}", took[k] / n * 1e9, NS)
    one, y1 = moving[:, :1].copy(), np.empty((1, 1))

    def calls(p, x):
        for _ in range(2000):
            p.process(x, y1)

    took = medians(
        interleaved(
            {
                "fixed": partial(calls, proc, one),
                "live": partial(calls, live, np.array(rows["standing"][:, :1])),
            },
            9,
        )
    )
    for k, seconds in took.items():
        tell(f"1-sample call, {k} alpha", seconds / 2000 * 1e6, "us")
    for rate in (1000.0, 8000.0):
        for tol in (1e-10, 1e-14):
            p = stimlib.compile(Scene({"f": springpot(Y, 1.0, alpha, "gl", tol=tol)}), rate)
            tell(f"state with header and guard, tol {tol:g}, {rate:g} Hz", p.state.nbytes, "bytes")
            q = stimlib.compile(Scene({"f": springpot(Y, 1.0, Input("a"), "gl", tol=tol)}), rate)
            tell(f"state with a live alpha, tol {tol:g}, {rate:g} Hz", q.state.nbytes, "bytes")
            r = movement("sinusoid", n, rate)[None].copy()
            seconds = medians(interleaved({"": partial(p.process, r, y)}, 9))[""]
            tell(f"moving, tol {tol:g}, {rate:g} Hz", seconds / n * 1e9, NS)
    try:
        from fracmem import CompressedFractionalFilter
    except ImportError:
        return out
    block = moving[:, :64].copy()
    y64 = np.empty((1, 64))
    made = CompressedFractionalFilter.from_analytic(
        alpha, 1 / fs, L=32, p=16, definition="caputo", j_max=60_000
    ).reset_stream()
    values = block[0].tolist()

    def many():
        for _ in range(100):
            proc.process(block, y64)

    times = interleaved({"springpot": many, "fracmem": lambda: [made.step(v) for v in values]}, 25)
    tell("block of 64", medians(times)["springpot"] / 100 * 1e6, "us")
    tell("block of 64, fracmem", medians(times)["fracmem"] * 1e6, "us")
    tell(
        "ratio: fracmem / springpot, blocks of 64",
        ratio(times, "fracmem", "springpot") * 100,
        TIMES,
    )
    return out


def main() -> None:
    known = options(__doc__)
    known.add_argument("--long", action="store_true")
    known.add_argument("--peers", default="")
    given = known.parse_args()
    if given.peers:
        sys.path.append(given.peers)
    rows = errors(1000.0, 60.0, TOLS, 100) + errors(8000.0, 60.0, TOLS, 40)
    if given.long:
        rows += errors(1000.0, 3600.0, [1e-14], 20) + errors(8000.0, 3600.0, [1e-14], 12)
    save("springpot_errors", rows, given.record)
    save("springpot", [row(machine()), *claims()], given.record)


if __name__ == "__main__":
    main()
