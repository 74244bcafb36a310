"""The JAX target: one channel, many channels and gradients, against the compiled
processor and numpy + scipy in chunks.

    python benchmarks/jax_target.py             print
    python benchmarks/jax_target.py --record    and keep the figures

They are kept in results/jax.csv, those of a GPU in results/jax_gpu.csv.

One process on one core, and whatever accelerator JAX finds.  A batch is one call of
``jax.vmap`` over gains and keys; the compiled processor runs its channels one after
another on its core.  (Called jax.py, this file would hide the package.)
"""

from __future__ import annotations

import time

import jax
import numpy as np
from bench import NS, TIMES, compared, options, row, save, under
from noise_chain import FS, SAMPLES, fastest_peer, movements, puller, stages
from timing import interleaved, machine, medians, ratio

import stimlib
from stimlib.scenes import bumps, squeeze, viscoelastic

PRECISIONS = ("float64", "float32")
BATCHES = {"cpu": {64: 8192, 1024: 1024}}  # channels: samples of each
ACCELERATED = {64: 8192, 1024: 8192, 65536: 256}


def ready(f, *args):
    return lambda: jax.block_until_ready(f(*args))


def one_channel():
    """Noise chain and one-finger squeeze."""
    chain, scene = stages()["noise chain"], squeeze(fingers=1)
    x = movements()["gate open"]
    jobs = {"processor": puller(chain.scene)} | fastest_peer(chain)
    squeezes = {"processor": puller(scene, x)}
    for dtype in PRECISIONS:
        noise, whole = (stimlib.compile(s, FS, "jax", dtype=dtype) for s in (chain.scene, scene))
        jobs[f"JAX {dtype}"] = lambda f=noise: jax.block_until_ready(f(n=SAMPLES))
        squeezes[f"JAX {dtype}"] = ready(whole, None, {"x1": x})
    rows = under("1 channel, noise chain", compared(jobs, SAMPLES, "processor", rounds=9))
    return rows + under("1 channel, squeeze", compared(squeezes, SAMPLES, "processor", rounds=9))


def batches():
    """Squeeze with its own A, k and noise in every channel."""
    rows = []
    for channels, n in BATCHES.get(jax.default_backend(), ACCELERATED).items():
        x = movements(n)["gate open"]
        params = {"A": np.linspace(0.5, 4.0, channels), "k": np.linspace(500.0, 3000.0, channels)}
        keys = np.arange(channels, dtype=np.uint64)
        proc = stimlib.compile(squeeze(fingers=1), FS)
        out = np.empty((1, n))

        def one_by_one(proc=proc, params=params, x=x, out=out, keys=keys):
            for i, key in enumerate(keys.tolist()):
                proc.reset(key)
                for name, v in params.items():
                    proc.set(name, v[i], 0.0)
                proc.process(x[None], out)

        jobs = {"processor": one_by_one}
        for dtype in PRECISIONS:
            f = stimlib.compile(squeeze(fingers=1), FS, "jax", dtype=dtype)
            with jax.enable_x64(True):
                many = jax.jit(jax.vmap(lambda p, key, f=f, x=x: f(p, {"x1": x}, key)["force1"]))
            jobs[f"JAX {dtype}"] = in_64_bits(many, params, keys)
        rows += under(
            f"{channels} channels", compared(jobs, n * channels, "processor", rounds=5, warm_up=1)
        )
    return rows


def in_64_bits(f, *args):
    def run():
        with jax.enable_x64(True):
            return jax.block_until_ready(f(*args))

    return run


def gradients():
    """All parameters of a scene at once: reverse mode against the run itself, and
    against differences with the processor.
    """
    rows = []
    n = 1 << 16
    motion = 0.01 * (1 - np.cos(2 * np.pi * 0.7 * np.arange(n) / FS))
    live = stimlib.Scene(
        {
            "f": stimlib.blocks.springpot(
                stimlib.Input("y", "m"),
                stimlib.Param("chi", 100.0),
                stimlib.Param("alpha", 0.5),
                "gl",
            )
        }
    )
    for name, scene in (
        ("squeeze", squeeze()),
        ("viscoelastic", viscoelastic()),
        ("springpot, live", live),
        ("bumps", bumps("sine")),
    ):
        proc = stimlib.compile(scene, FS)
        rows_in, out = np.array([motion for _ in proc.inputs]), np.empty((len(proc.outputs), n))

        def differences(proc=proc, rows_in=rows_in, out=out):
            for p, v in list(proc.params.items()):
                for s in (0.999, 1.001):
                    proc.reset()
                    proc.set(p, v * s, 0.0)
                    proc.process(rows_in, out)
                    (out**2).sum()

        jobs = {"processor differences": differences}
        for dtype in PRECISIONS:
            f = stimlib.compile(scene, FS, "jax", dtype=dtype)
            x = {i: motion for i in f.inputs}

            def loss(params, f=f, x=x):
                return sum((v**2).sum() for v in f(params, x).values())

            with jax.enable_x64(True):
                forward, both = jax.jit(loss), jax.jit(jax.value_and_grad(loss))
            jobs[f"forward {dtype}"] = in_64_bits(forward, f.params)
            jobs[f"gradient {dtype}"] = in_64_bits(both, f.params)
        times = interleaved(jobs, rounds=7)
        found = [row(k, v / n * 1e9, NS) for k, v in medians(times).items()]
        for dtype in PRECISIONS:
            found.append(
                row(
                    f"ratio: gradient / forward, {dtype}",
                    ratio(times, f"gradient {dtype}", f"forward {dtype}"),
                    TIMES,
                )
            )
            r = ratio(times, "processor differences", f"gradient {dtype}")
            found.append(row(f"ratio: processor differences / gradient, {dtype}", r, TIMES))
        rows += under(name, found)
    return rows


def compiling():
    """Seconds until the first samples of each shipped scene are there, this process
    warm.
    """
    rows = []
    for name, scene in (
        ("squeeze", squeeze()),
        ("viscoelastic", viscoelastic()),
        ("bumps", bumps()),
    ):
        start = time.perf_counter()
        f = stimlib.compile(scene, FS, "jax")
        jax.block_until_ready(f(None, {i: np.zeros(8000) for i in f.inputs}))
        rows.append(row(f"{name}: to compile", time.perf_counter() - start, "s"))
    return rows


def main():
    given = options(__doc__).parse_args()
    backend = jax.default_backend()
    where = f"{machine()}, jax {jax.__version__} on {jax.devices()[0].device_kind}"
    name = "jax" if backend == "cpu" else f"jax_{backend}"
    save(name, [row(where), *compiling(), *one_channel(), *batches(), *gradients()], given.record)


if __name__ == "__main__":
    main()
