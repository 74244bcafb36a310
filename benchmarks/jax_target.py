"""The JAX target: one channel, many channels and gradients, against the compiled processor and numpy + scipy in chunks.

One process on one core, jobs take turns, medians.  A batch is one call of ``jax.vmap`` over gains and keys; the compiled
processor runs its channels one after another.  (Called jax.py, this file would hide the package.)
"""

from __future__ import annotations

import os
import time

if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # before XLA counts the cores

import jax
import numpy as np
from bench import interleaved, machine, medians, ratio, save
from chain import CHUNK, CHUNKS, FS, always_open, noise_chain, puller, scipy_chains

import stimlib
from stimlib.scenes import bumps, squeeze, viscoelastic

BATCHES = {64: 8192, 1024: 1024}  # channels: samples of each


def row(what, value):
    return {"what": what, "ns_per_sample": value}


def ready(f, *args):
    return lambda: jax.block_until_ready(f(*args))


def one_channel():
    """Noise chain and one-finger squeeze, as many samples as the chunks of the peer have."""
    n = CHUNK * CHUNKS
    x = always_open(n)[:1]
    jobs = {"numba, noise chain": puller(noise_chain()), "numba, squeeze": puller(squeeze(fingers=1), x)} | scipy_chains()
    for dtype in ("float64", "float32"):
        chain = stimlib.compile(noise_chain(), FS, "jax", dtype=dtype)
        whole = stimlib.compile(squeeze(fingers=1), FS, "jax", dtype=dtype)
        jobs[f"JAX {dtype}, noise chain"] = lambda f=chain: jax.block_until_ready(f(n=n))
        jobs[f"JAX {dtype}, squeeze"] = ready(whole, None, {"x1": x[0]})
    times = interleaved(jobs, rounds=9)
    middle = medians(times)
    best = min((k for k in middle if k.startswith("numpy")), key=middle.__getitem__)
    rows = [row(f"1 channel: {k}", v / n * 1e9) for k, v in middle.items()]
    for dtype in ("float64", "float32"):
        r = ratio(times, best, f"JAX {dtype}, noise chain")
        rows.append(row(f"ratio: {best} / JAX {dtype}, noise chain", r))
    for what in ("noise chain", "squeeze"):
        r = ratio(times, f"JAX float64, {what}", f"numba, {what}")
        rows.append(row(f"ratio: JAX float64 / numba, {what}", r))
    return rows


def batches():
    """Squeeze with its own A, k and noise in every channel."""
    rows = []
    for channels, n in BATCHES.items():
        x = always_open(n)[0]
        params = {"A": np.linspace(0.5, 4.0, channels), "k": np.linspace(500.0, 3000.0, channels)}
        keys = np.arange(channels, dtype=np.uint64)
        proc = stimlib.compile(squeeze(fingers=1), FS)
        out = np.empty((1, n))

        def numba(proc=proc, params=params, x=x, out=out, keys=keys):
            for i, key in enumerate(keys.tolist()):
                proc.reset(key)
                for name, v in params.items():
                    proc.set(name, v[i], 0.0)
                proc.process(x[None], out)

        jobs = {"numba": numba}
        for dtype in ("float64", "float32"):
            f = stimlib.compile(squeeze(fingers=1), FS, "jax", dtype=dtype)
            with jax.enable_x64(True):
                many = jax.jit(jax.vmap(lambda p, key, f=f, x=x: f(p, {"x1": x}, key)["force1"]))
            jobs[f"JAX {dtype}"] = in_64_bits(many, params, keys)
        times = interleaved(jobs, rounds=5, warm_up=1)
        rows += [row(f"{channels} channels: {k}", v / n / channels * 1e9) for k, v in medians(times).items()]
        rows.append(row(f"{channels} channels: ratio numba / JAX float64", ratio(times, "numba", "JAX float64")))
    return rows


def in_64_bits(f, *args):
    def run():
        with jax.enable_x64(True):
            return jax.block_until_ready(f(*args))

    return run


def gradients():
    """All parameters of a scene at once: reverse mode against the run itself, and against differences with the processor."""
    rows = []
    n = 1 << 16
    t = np.arange(n) / FS
    motion = 0.01 * (1 - np.cos(2 * np.pi * 0.7 * t))
    live = stimlib.Scene(
        {"f": stimlib.blocks.springpot(stimlib.Input("y", "m"), stimlib.Param("chi", 100.0), stimlib.Param("alpha", 0.5))}
    )
    for name, scene in (
        ("squeeze", squeeze()),
        ("viscoelastic", viscoelastic()),
        ("springpot, live", live),
        ("bumps", bumps("sine")),
    ):
        f = stimlib.compile(scene, FS, "jax")
        x = {i: motion for i in f.inputs}

        def loss(params, f=f, x=x):
            return sum((v**2).sum() for v in f(params, x).values())

        with jax.enable_x64(True):
            forward, both = jax.jit(loss), jax.jit(jax.value_and_grad(loss))
        proc = stimlib.compile(scene, FS)
        rows_in, out = np.array([motion for _ in proc.inputs]), np.empty((len(proc.outputs), n))

        def differences(proc=proc, rows_in=rows_in, out=out):
            for p, v in list(proc.params.items()):
                for s in (0.999, 1.001):
                    proc.reset()
                    proc.set(p, v * s, 0.0)
                    proc.process(rows_in, out)
                    (out**2).sum()

        jobs = {
            "forward": in_64_bits(forward, f.params),
            "gradient": in_64_bits(both, f.params),
            "numba differences": differences,
        }
        times = interleaved(jobs, rounds=7)
        rows += [row(f"{name}: {k}", v / n * 1e9) for k, v in medians(times).items()]
        rows.append(row(f"{name}: ratio gradient / forward", ratio(times, "gradient", "forward")))
        rows.append(row(f"{name}: ratio differences / gradient", ratio(times, "numba differences", "gradient")))
    return rows


def compiling():
    """Seconds until the first samples of each shipped scene are there, this process warm."""
    rows = []
    for name, scene in (("squeeze", squeeze()), ("viscoelastic", viscoelastic()), ("bumps", bumps())):
        start = time.perf_counter()
        f = stimlib.compile(scene, FS, "jax")
        jax.block_until_ready(f(None, {i: np.zeros(8000) for i in f.inputs}))
        rows.append(row(f"{name}: seconds to compile", time.perf_counter() - start))
    return rows


def main():
    rows = [*compiling(), *one_channel(), *batches(), *gradients()]
    save("jax", [row(f"{machine()}, jax {jax.__version__}", ""), *rows])


if __name__ == "__main__":
    main()
