"""Every block of the table beside the quickest peer that does the same.

    PYTHONPATH=tests python benchmarks/peers.py                 print
    PYTHONPATH=tests python benchmarks/peers.py --record        and keep the figures
    PYTHONPATH=tests python benchmarks/peers.py lowpass delay   only names with these

They are kept in results/peers.csv, from which docs/explanation/peers.rst has its table;
rows of other names stay as they were.

A peer is numpy or scipy where one function does the same, Faust (if installed) in the
fastest of three settings, and for every block its own algorithm as a plain loop in C:
exported, compiled by gcc -std=c99 -O3 -march=native.  numpy and scipy get the
whole signal in one call, and write into an array that is there where they can; ours
goes in calls of 4096 samples through a scene with its guard.  What a peer computes is
compared with ours first.
"""

from __future__ import annotations

import csv
import io
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import faust
import numpy as np
from bench import RESULTS, Row, options, row, save
from contract import KNOTS, ROWS, TABLE, VALUES
from export import COMPILERS, job
from scipy import ndimage, signal
from timing import interleaved, machine, medians, ratio

import stimlib
from stimlib import Input, Scene, blocks as b
from stimlib.export import export_c

N, BLOCK, FS = 1 << 14, 4096, 8000.0
CC = {n: COMPILERS[n] for n in ("gcc -O3 native",) if shutil.which("gcc")}
LARGE = ("mode_shape",)  # its table takes 16 MB of text: no C
SOS = {  # of the table and of EXTRA: the same filter by scipy
    "lowpass": signal.butter(2, 100, fs=FS, output="sos"),
    "lowpass_bessel": signal.bessel(7, 60, fs=FS, output="sos", norm="mag"),
    "highpass": signal.cheby1(5, 0.5, 40, "high", fs=FS, output="sos"),
    "bandpass": signal.butter(3, [80, 300], "band", fs=FS, output="sos"),
    "bandstop": signal.ellip(4, 1, 50, [40, 70], "stop", fs=FS, output="sos"),
    "sos": np.array([np.divide(r, r[3]) for r in ROWS]),
} | {f"lowpass of order {k}": signal.butter(k, 300, fs=FS, output="sos") for k in (2, 4, 8, 12)}
NUMPY: dict[str, Callable] = {  # a job of the same, of rows and the place of its samples
    "input": lambda x, out: np.copyto(out, x),
    "add": lambda x, y, out: np.add(x, y, out),
    "sub": lambda x, y, out: np.subtract(x, y, out),
    "mul": lambda x, y, out: np.multiply(x, y, out),
    "div": lambda x, y, out: np.divide(x, y, out),
    "neg": lambda x, out: np.negative(x, out),
    "abs": lambda x, out: np.abs(x, out),
    "greater": lambda x, y, out: np.greater(x, y, out),
    "at_least": lambda x, y, out: np.greater_equal(x, y, out),
    "equal": lambda x, y, out: np.equal(x, y, out),
    "not_equal": lambda x, y, out: np.not_equal(x, y, out),
    "maximum": lambda x, y, out: np.maximum(x, y, out=out),
    "minimum": lambda x, y, out: np.minimum(x, y, out=out),
    "clip": lambda x, out: np.clip(x, -0.5, 0.7, out),
    "sqrt": lambda x, out: np.sqrt(x, out),
    "exp": lambda x, out: np.exp(x, out),
    "log": lambda x, out: np.log(x, out),
    "sin": lambda x, out: np.sin(x, out),
    "cos": lambda x, out: np.cos(x, out),
    "tanh": lambda x, out: np.tanh(x, out),
    "integrate": lambda x, out: signal.lfilter([0.5 / FS, 0.5 / FS], [1.0, -1.0], x),
    "lut": lambda x, out: np.interp(x, KNOTS, VALUES),
    "white": lambda out: RNG.standard_normal(out=out),
    "elapsed": lambda out: np.divide(np.arange(out.size), FS, out),
    "moving_average": lambda x, out: mean(x, out, 80),
    "moving average of 800": lambda x, out: mean(x, out, 800),
    "delay_1": lambda x, out: later(x, out, 1),
    "delay_70": lambda x, out: later(x, out, 70),
    "delay_seconds": lambda x, out: later(x, out, 80),
    "delay of 800": lambda x, out: later(x, out, 800),
} | {name: lambda x, out, rows=rows: signal.sosfilt(rows, x) for name, rows in SOS.items()}
NOISE = {"white"}  # of which samples differ
FAUST = {
    "delay_70": "@(70)",
    "delay of 800": "@(800)",
    "envelope follower": "an.amp_follower_ar(0.001, 0.05)",
} | {f"lowpass of order {k}": f"fi.lowpass({k}, 300)" for k in (2, 4, 8, 12)}
RNG = np.random.default_rng(1)
X, WAVE = Input("x"), np.sin(np.arange(N) / 30)
EXTRA = {
    "delay of 800": b.delay(X, 800),
    "moving average of 800": b.moving_average(X, 0.1),
    "envelope follower": b.envelope_follower(X),
} | {f"lowpass of order {k}": b.lowpass(X, 300, k) for k in (2, 4, 8, 12)}


def mean(x: np.ndarray, out: np.ndarray, n: int) -> None:
    """The mean of the last n samples, by scipy."""
    ndimage.uniform_filter1d(x, n, output=out, mode="constant", origin=(n - 1) // 2)


def later(x: np.ndarray, out: np.ndarray, n: int) -> None:
    """A copy, n samples later."""
    out[:n] = 0.0
    out[n:] = x[:-n]


def drawn(name: str) -> tuple[str, ...]:
    """The inputs for which a case has samples; an entry may make others itself."""
    return next((e.inputs for e in TABLE if e.name == name), ("x",))


def puller(proc: stimlib.Processor, x: np.ndarray, y: np.ndarray) -> Callable[[], None]:
    """A job of ours in calls of 4096 samples."""
    cuts = range(0, N, BLOCK)
    parts = [np.ascontiguousarray(x[:, k : k + BLOCK]) for k in cuts]
    outs = [np.empty((1, BLOCK)) for _ in cuts]

    def run() -> None:
        for part, out in zip(parts, outs, strict=True):
            proc.process(part, out)
        if np.isnan(y[0, 0]):  # the first time
            y[:] = np.concatenate(outs, axis=1)

    return run


def beside(folder: Path, name: str, block: Any, x: np.ndarray, fs: float) -> Row:
    """The row of a block: its time, its quickest peer, and their ratio."""
    scene = Scene({"y": block})
    proc = stimlib.compile(scene, fs)
    y = np.full((1, N), np.nan)
    jobs, made = {"ours": puller(proc, x, y)}, {}
    jobs["ours"]()
    if name not in LARGE:
        rows = dict(zip(proc.inputs, x, strict=True))
        size = export_c(scene, fs, folder, rows or None, "one", 16 / fs).state_bytes
        for how, words in CC.items():
            made[how] = np.empty((1, N))
            jobs[how] = job(folder, "one", words, size, x, made[how])
    if name in NUMPY:
        how, out = "scipy" if name in SOS else "numpy or scipy", np.empty(N)
        made[how] = out[None]
        jobs[how] = lambda given=(*x, out): kept(out, NUMPY[name](*given))
    if name in FAUST and not faust.missing():
        given = np.ascontiguousarray(x[0])
        for how, call in faust.filters(folder, FAUST[name], given, fs).items():
            made[how], jobs[how] = call()[None], call
    for how, out in made.items():
        jobs[how]()
        late = slice(N // 2, None)  # by then filters of other kinds have settled
        error = np.abs(out[:, late] - y[:, late]).max() / max(1e-300, np.abs(y).max())
        exact = how in CC
        if (exact and error > 0.0) or (error > 2e-2 and name not in NOISE):
            print(f"{name}: {how} differs by {error:.1e}", file=sys.stderr)
            del jobs[how]
    times = interleaved(jobs, 9, 2, time.process_time)
    found = {how: seconds / N * 1e9 for how, seconds in medians(times).items()}
    quickest = min((h for h in jobs if h != "ours"), key=found.__getitem__, default="")
    if not quickest:
        return row(name) | {"ours, ns": figure(found["ours"])}
    value = figure(ratio(times, "ours", quickest))
    figures = {"ours, ns": figure(found["ours"]), "peer, ns": figure(found[quickest])}
    return row(name, value, "of the peer") | figures | {"peer": quickest}


def kept(out: np.ndarray, made: np.ndarray | None) -> None:
    """Put what a function returned where the others write."""
    if made is not None and made is not out:
        out[:] = made


def figure(v: float) -> float:
    """Three digits."""
    return float(f"{v:.3g}")


def recorded() -> dict[str, Row]:
    """The rows that are kept, by name."""
    path = RESULTS / "peers.csv"
    with path.open(newline="") if path.exists() else io.StringIO() as f:
        return {r["what"]: r for r in csv.DictReader(f)}


def measure(only: tuple[str, ...] = ()) -> list[Row]:
    """All rows, of which those without one of these in their names as recorded."""
    before = recorded() if only else {}
    found: list[Row] = []
    noise = np.random.default_rng(0).standard_normal((1, N))
    cases: list[tuple] = [(n, block, noise, FS) for n, block in EXTRA.items()]
    cases += [(e.name, e.block(), e.x(N, e.rates[0]), e.rates[0]) for e in TABLE]
    for name, block, x, fs in cases:
        if only and not any(part in name for part in only):
            found += [before[name]] if name in before else []
            continue
        names = stimlib.compile(Scene({"y": block}), fs).inputs
        given = dict(zip(drawn(name), x, strict=True))
        rows = [given.get(n, WAVE) for n in names]
        with tempfile.TemporaryDirectory() as folder:
            try:
                found.append(beside(Path(folder), name, block, np.array(rows).reshape(-1, N), fs))
            except (stimlib.StimlibError, subprocess.CalledProcessError) as e:
                print(f"{name}: {e}"[:300], file=sys.stderr)
    return found


if __name__ == "__main__":
    parser = options(__doc__)
    parser.add_argument("names", nargs="*", help="parts of the names of blocks; all without")
    given = parser.parse_args()
    save("peers", [row(machine()), *measure(tuple(given.names))], given.record)
