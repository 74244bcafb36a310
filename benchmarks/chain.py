"""The noise chain and the squeeze scene: against numpy + scipy, against themselves, sample by sample.

Run with ``make bench``.  All figures come from one process; jobs take turns; medians of the rounds are printed, and ratios
are medians of ratios within a round.
"""

from __future__ import annotations

import time
from functools import partial
from math import pi

import numpy as np
from bench import interleaved, machine, medians, ratio, save
from scipy import linalg, signal

import stimlib
from stimlib.blocks import differentiator, pink_noise
from stimlib.design.differentiator import differentiator_taps
from stimlib.design.pink import pink_modes
from stimlib.scenes import squeeze

FS, CHUNK, CHUNKS = 8000, 32768, 16
BLOCK = 8192


def noise_chain(fs=FS, f_low=10.0, tol_db=0.01):
    """White -> 3 dB/oct -> differentiator, as the squeeze scene uses it."""
    return stimlib.Scene({"noise": differentiator(pink_noise(1 / pi, seed=1, f_low=f_low, tol_db=tol_db), passband=1000)})


def scipy_chains(fs=FS, f_low=10.0, tol_db=0.01):
    """The same chain from PCG64, sosfilt (zi carried on) and three ways to run 129 taps, in chunks."""
    m = pink_modes(fs, f_low, tol_db)
    zeros, poles, gain = parallel_to_zpk(m.e, m.r, m.d)
    sos = signal.zpk2sos(zeros, poles, gain)
    taps = differentiator_taps(fs, 1000.0, 1500.0, 128).taps
    h = taps.size - 1
    rows = 512
    toeplitz = linalg.toeplitz(np.r_[taps[0], np.zeros(rows - 1)], np.r_[taps, np.zeros(rows - 1)])[:, ::-1][::-1]
    toeplitz = np.ascontiguousarray(toeplitz.T)

    def gemm(x):
        parts = np.lib.stride_tricks.sliding_window_view(x, rows + h)[::rows]
        return (parts @ toeplitz).ravel()

    firs = {
        "np.convolve": lambda x: np.convolve(x, taps, "valid"),
        "oaconvolve": lambda x: signal.oaconvolve(x, taps, "valid"),
        "Toeplitz GEMM": gemm,
    }
    x = np.random.default_rng(0).standard_normal(CHUNK + h)
    for f in firs.values():
        assert np.allclose(f(x), firs["np.convolve"](x), rtol=0, atol=1e-9 * np.abs(taps).max())

    def run(fir):
        rng, zi, tail = np.random.Generator(np.random.PCG64(1)), np.zeros((len(sos), 2)), np.zeros(h)
        for _ in range(CHUNKS):
            pink, zi = signal.sosfilt(sos, rng.standard_normal(CHUNK), zi=zi)
            line = np.concatenate([tail, pink])
            fir(line)
            tail = line[-h:]

    return {f"numpy + scipy, {name}": partial(run, f) for name, f in firs.items()}


def parallel_to_zpk(e, r, d):
    """Zeros, poles and gain of d + sum r/(1 - (1-e)/z)."""
    poles = 1 - e
    numerator = d * np.poly(poles)
    for k in range(e.size):
        numerator = numerator + r[k] * np.r_[np.poly(np.delete(poles, k)), 0.0]
    return np.roots(numerator), poles, numerator[0]


def puller(scene, x=None, n=CHUNK * CHUNKS):
    """A job that streams n samples of a scene in blocks."""
    proc = stimlib.compile(scene, FS)
    rows = len(proc.inputs)
    x = np.zeros((rows, n)) if x is None else x
    blocks = [np.ascontiguousarray(x[:, a : a + BLOCK]) for a in range(0, n, BLOCK)]
    out = np.empty((len(proc.outputs), BLOCK))

    def run():
        proc.reset()
        for b in blocks:
            proc.process(b, out)

    return run


def bursts(n, period=1.0):
    """Position of two fingers rising during half of each period (0.1 m/s) and falling during the other."""
    t = np.arange(n) / FS % period
    x = 0.1 * np.minimum(t, period - t)
    return np.stack([x, x])


def always_open(n):
    """Position rising for ever: the gate never closes."""
    return np.tile(0.1 * np.arange(n) / FS, (2, 1))


def one_sample_calls(speed, calls=20000):
    """Median microseconds of process(x, out=y) with one sample, at constant speed (m/s)."""
    proc = stimlib.compile(squeeze(), FS)
    path = np.tile(speed * np.arange(calls + 1000) / FS, (2, 1))
    proc.process(np.ascontiguousarray(path[:, :1000]))
    samples = [np.ascontiguousarray(path[:, k : k + 1]) for k in range(1000, calls + 1000)]
    y = np.empty((2, 1))
    rounds = []
    for part in range(0, calls, 1000):
        start = time.perf_counter()
        for x in samples[part : part + 1000]:
            proc.process(x, out=y)
        rounds.append((time.perf_counter() - start) * 1e3)
    return float(np.median(rounds))


def main():
    n = CHUNK * CHUNKS
    print(f"block {BLOCK}, scipy chunk {CHUNK}, {n} samples a run, 2 warm-up and 15 counted rounds, one thread")
    chain = {"stimlib noise chain": puller(noise_chain())} | scipy_chains()
    times = interleaved(chain)
    middle = medians(times)
    best = min((k for k in middle if k.startswith("numpy")), key=middle.__getitem__)
    rows: list[dict[str, object]] = [{"what": k, "ns_per_sample": v / n * 1e9} for k, v in middle.items()]
    rows.append({"what": f"ratio: {best} / stimlib", "ns_per_sample": ratio(times, best, "stimlib noise chain")})
    gate = {
        "squeeze, always open": puller(squeeze(), always_open(n)),
        "squeeze, 0.5 s bursts, half duty": puller(squeeze(), bursts(n)),
        "squeeze, gate closed": puller(squeeze(), np.zeros((2, n))),
    }
    times = interleaved(gate)
    rows += [{"what": k, "ns_per_sample": v / n * 1e9} for k, v in medians(times).items()]
    open_, half, closed = gate
    rows.append({"what": "ratio: always open / half duty", "ns_per_sample": ratio(times, open_, half)})
    rows.append({"what": "ratio: always open / closed", "ns_per_sample": ratio(times, open_, closed)})
    rows.append({"what": "1-sample call, gate closed, us", "ns_per_sample": one_sample_calls(0.0)})
    rows.append({"what": "1-sample call, gate open, us", "ns_per_sample": one_sample_calls(0.1)})
    save("chain", [{"what": machine(), "ns_per_sample": ""}, *rows])


if __name__ == "__main__":
    main()
