"""The 3 dB/oct filter, the differentiator, and both on white noise: errors are of
responses, against the formula.
"""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np
from noise_chain import puller
from scipy import signal

from stimlib.blocks import differentiator, pinking, white_noise
from stimlib.core.scene import Scene
from stimlib.design.filters import differentiator_order, differentiator_taps
from stimlib.design.noise import NoiseDesign, noise_modes

from . import filter_loops, products
from .problem import Method, Problem, Signal, on, own, response, searched

FS, SAMPLES = 8000.0, 1 << 16
LONG = 1 << 18  # of an impulse response: 33 s, for poles below 0.1 Hz
F_LOW, PASSBAND, STOPBAND = 1.0, 1000.0, 1500.0
X = np.random.default_rng(0).standard_normal(SAMPLES)

# Paul Kellet's filters (musicdsp.org, 1999), poles, weights, and those of a sample and
# the one before; made for 44.1 kHz.
KELLET = {
    "refined": (
        (0.99886, 0.99332, 0.96900, 0.86650, 0.55000, -0.7616),
        (0.0555179, 0.0750759, 0.1538520, 0.3104856, 0.5329522, -0.0168980),
        0.5362,
        0.115926,
    ),
    "economy": ((0.99765, 0.96300, 0.57000), (0.0990460, 0.2965164, 1.0526913), 0.1848, 0.0),
}


# 3 dB/oct -----------------------------------------------------------------------------
def slope_error(
    f: Signal, low: float = F_LOW, high: float = 0.45 * FS, slope: float = -0.5
) -> float:
    """Largest deviation in dB of a gain from (frequency)^slope, when the level is
    chosen best.
    """
    at = np.fft.rfftfreq(LONG, 1 / FS)
    band = (at >= low) & (at <= high)
    gain = 20 * np.log10(np.abs(response(f, LONG)[band])) - 20 * slope * np.log10(at[band])
    return float(np.ptp(gain) / 2)


def sections(poles, residues, direct: float, late: float = 0.0) -> np.ndarray:
    """Parallel first-order filters as second-order sections, for scipy; late is the
    weight of the sample before.
    """
    poles, residues = np.asarray(poles), np.asarray(residues)
    numerator = np.polymul([direct, late], np.poly(poles))
    for k in range(poles.size):
        numerator = np.polyadd(
            numerator, residues[k] * np.r_[np.poly(np.delete(poles, k)), 0.0, 0.0]
        )
    zeros = np.roots(numerator)
    return signal.zpk2sos(zeros, np.r_[poles, np.zeros(zeros.size - poles.size)], numerator[0])


def sos(coefficients: np.ndarray) -> Signal:
    return lambda x: signal.sosfilt(coefficients, x)


def of(m: NoiseDesign) -> np.ndarray:
    """A design's modes as second-order sections; zeros as eigenvalues, or scipy would
    lose digits that are not its own.
    """
    p, whole = 1 - m.e, m.d + m.r.sum()
    zeros = np.linalg.eigvals(np.diag(p) - m.r * p / whole).real
    return signal.zpk2sos(zeros, p, whole)


def looped(m: NoiseDesign) -> Signal:
    return filter_loops.modes(m.e, m.r, np.array([m.d]))


def kellet(name: str) -> Signal:
    return sos(sections(*KELLET[name]))


def oustaloup(order: int, low: float, high: float, slope: float = -0.5) -> Signal:
    """2 order + 1 poles and zeros spread evenly between low and high fs/2, bilinear."""
    wb, wh = 2 * np.pi * low, np.pi * FS * high
    k = np.arange(-order, order + 1)
    zeros, poles = (
        -wb * (wh / wb) ** ((k + order + (1 + sign * slope) / 2) / (2 * order + 1))
        for sign in (-1, 1)
    )
    return sos(signal.zpk2sos(*signal.bilinear_zpk(zeros, poles, wh**slope, FS)))


def shaped(x: np.ndarray) -> np.ndarray:
    """What the package colorednoise does: the whole file in the frequency domain."""
    f = np.fft.rfftfreq(x.size)
    f[0] = f[1]
    return np.fft.irfft(np.fft.rfft(x) / np.sqrt(f), x.size)


def sampled_response(taps: int) -> Signal:
    """A linear-phase FIR by frequency sampling, as scipy's firwin2."""
    f = np.r_[0.0, np.geomspace(F_LOW, FS / 2, 400)]
    h = signal.firwin2(taps, f, 1 / np.sqrt(np.r_[F_LOW, f[1:]]), fs=FS)
    return lambda x: signal.oaconvolve(x, h)[: x.size]


def pink() -> list[Method]:
    tols = [1.0, 0.3, 0.1, 0.01, 1e-3, 1e-4]

    def ours(dtype: str = ""):
        return own(lambda x, tol: pinking(x, F_LOW, tol), FS, dtype=dtype)

    return on(X, slope_error, {
        "stimlib pinking, tol_db": (tols, ours()),
        "stimlib on JAX, float64": ([0.01, 1e-4], ours("float64")),
        "stimlib on JAX, float32": ([0.01, 1e-4], ours("float32")),
        "our design in scipy sosfilt": (tols, lambda tol: sos(of(noise_modes(FS, F_LOW, tol)))),
        "our design in a compiled loop, tol_db": (
            tols, lambda tol: looped(noise_modes(FS, F_LOW, tol))),
        "Oustaloup in scipy sosfilt, order": ([2, 4, 8, 12], lambda order: searched(
            slope_error, product([order], [0.03, 0.1, 0.3], [1.0, 2.0, 4.0]), oustaloup)),
        "Kellet in scipy sosfilt": (["refined", "economy"], kellet),
        "firwin2 + oaconvolve, taps": ([257, 1025, 4097, 16385], sampled_response),
        "FFT of the whole file (colorednoise)": ([""], lambda _: shaped),
    })  # fmt: skip


# d/dt ---------------------------------------------------------------------------------
def derivative_error(f: Signal, stops: bool = True) -> float:
    """Largest error of the gain up to the pass edge, relative to the gain, behind a
    delay of whole half samples; and what is left from the stop edge on, relative to
    the gain at the pass edge.
    """
    n = 1 << 15
    at = np.fft.rfftfreq(n, 1 / FS)
    H = response(f, n, at=4096)
    low = slice(1, 40)  # up to 10 Hz
    late = -np.polyfit(2 * np.pi * at[low] / FS, np.unwrap(np.angle(H[low] / 1j)), 1)[0]
    H = H * np.exp(2j * np.pi * at * (round(2 * late) / 2) / FS)
    band, high = (at > 0) & (at <= PASSBAND), at >= STOPBAND
    wanted = 2j * np.pi * at[band]
    error = float(np.abs(H[band] / wanted - 1).max())
    return max(error, float(np.abs(H[high]).max()) / (2 * np.pi * PASSBAND)) if stops else error


def taps(h: np.ndarray) -> Signal:
    return lambda x: (
        np.convolve(x, h)[: x.size] if h.size < 64 else signal.oaconvolve(x, h)[: x.size]
    )


def matrix(h: np.ndarray) -> Signal:
    """The same in the fastest way of numpy for one long file."""
    return products.taps(h, 32 if h.size < 66 else 64, np.float32)


def windowed(n: int, beta: float, edge: float) -> np.ndarray:
    """The ideal differentiator up to an edge in Hz, cut by a Kaiser window."""
    k, w = np.arange(n) - (n - 1) / 2, 2 * np.pi * edge / FS
    safe = np.where(k == 0, 1.0, k)
    ideal = (w * np.cos(w * k) / safe - np.sin(w * k) / safe**2) / np.pi * (k != 0)
    return ideal * signal.get_window(("kaiser", beta), n, fftbins=False) * FS


def order_of(tol: float, stopband: float | None = STOPBAND) -> int:
    return differentiator_order(FS, PASSBAND, stopband, tol)


def designed(tol: float, stopband: float | None = STOPBAND) -> np.ndarray:
    return differentiator_taps(FS, PASSBAND, stopband, order_of(tol, stopband)).taps


def remez(n: int, weight: float) -> np.ndarray:
    """Equal ripples of the relative error; the weight is that of the stop band."""
    return FS * signal.remez(
        n,
        [0, PASSBAND, STOPBAND, FS / 2],
        [2 * np.pi, 0],
        weight=[1, weight],
        type="differentiator",
        fs=FS,
        maxiter=100,
    )


def free(n: int, end: float) -> np.ndarray:
    """The same without a stop band, up to an end in Hz."""
    return FS * signal.remez(n, [0, end], [2 * np.pi], type="differentiator", fs=FS, maxiter=100)


def differentiators(stops: bool) -> list[Method]:
    """With a stop band from 1.5 kHz on, or with nothing asked above 1 kHz."""
    stopband = STOPBAND if stops else None
    error = partial(derivative_error, stops=stops)

    def ours(x, tol: float):
        return differentiator(x, PASSBAND, stopband or FS, order_of(tol, stopband), tol)

    def best(grid, make, run=taps) -> Signal:
        return searched(error, grid, lambda *place: run(make(*place)))

    edges = np.arange(1000.0, 1525.0, 50.0) if stops else np.arange(1000.0, 4250.0, 250.0)
    tols = [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8]
    counts = [17, 33, 65, 129] if stops else [4, 5, 6, 8, 9, 10, 12, 16, 17, 32, 33]
    ends = np.arange(1000.0, 1100.0, 10.0)
    weights = 10.0 ** np.arange(-2, 2.01, 0.25)
    own_rungs = {
        "stimlib differentiator, tol": (tols, own(ours, FS)),
        "the same taps in numpy or scipy, tol": (tols, lambda tol: taps(designed(tol, stopband))),
        "Kaiser window, taps": (
            counts,
            lambda n: best(product([n], np.arange(0.0, 15.0), edges), windowed),
        ),
    }
    if stops:
        peers = {
            "scipy remez, taps": (counts, lambda n: best(product([n], weights), remez)),
            "scipy remez, float32, pairs in a compiled loop, taps": (
                [17, 21, 33, 45, 65, 97, 129],
                lambda n: best(product([n], weights), remez, filter_loops.antisymmetric),
            ),
            "the same taps, float32, pairs in a compiled loop, tol": (
                tols,
                lambda tol: filter_loops.antisymmetric(designed(tol)),
            ),
            "the same taps, float32, a product of matrices, tol": (
                tols,
                lambda tol: matrix(designed(tol)),
            ),
        }
    else:
        peers = {
            "scipy remez, taps": (
                counts,
                lambda n: best(product([n], ends), free),
            ),
            "scipy remez in a compiled loop, taps": (
                [8, 10, 12, 16],
                lambda n: best(product([n], ends), free, filter_loops.taps),
            ),
            "Savitzky-Golay, window": (
                [5, 9, 21],
                lambda n: best(
                    product([n], range(1, min(n, 12))),
                    lambda n, order: signal.savgol_coeffs(n, order, deriv=1, delta=1 / FS),
                ),
            ),
            "difference to the last sample": ([2], lambda _: taps(FS * np.array([1.0, -1.0]))),
            "central difference": ([3], lambda _: taps(FS / 2 * np.array([1.0, 0.0, -1.0]))),
        }
    return on(X, error, own_rungs | peers)


# White, pink, d/dt --------------------------------------------------------------------
LOW, DB = 10.0, 8.7


def chain_error(f: Signal) -> float:
    """Largest deviation from +3 dB/oct up to the pass edge in dB; and what is left from
    the stop edge on, relative to the gain at the pass edge, at the same scale.
    """
    at, gain = np.fft.rfftfreq(LONG, 1 / FS), np.abs(response(f, LONG))
    left = gain[at >= STOPBAND].max() / gain[np.searchsorted(at, PASSBAND)]
    return max(slope_error(f, LOW, PASSBAND, 0.5), DB * float(left))


def chain() -> list[Method]:
    """Noise whose density rises 3 dB/oct from 10 Hz to 1 kHz; a rung is both
    tolerances, in dB.
    """

    def both(x, tol):
        return differentiator(
            pinking(x, LOW, tol), PASSBAND, STOPBAND, order_of(tol / DB), tol / DB
        )

    def peer(name: str, knob: str, source: type, *stages: Signal) -> Method:
        rng, white = np.random.Generator(source(1)), np.empty(SAMPLES)

        def f(x: np.ndarray) -> np.ndarray:
            for stage in stages:
                x = stage(x)
            return x

        return Method(name, knob, lambda: f(rng.standard_normal(out=white)), lambda: chain_error(f))

    pcg, sfc, found = np.random.PCG64, np.random.SFC64, []
    for tol in (1.0, 0.1, 0.01, 1e-3, 1e-4):
        job = puller(Scene({"y": both(white_noise(seed=1), tol)}), samples=SAMPLES, fs=FS)
        found.append(
            Method("stimlib, dB", f"{tol:g}", job, partial(chain_error, own(both, FS)(tol)))
        )
        pink, h = noise_modes(FS, LOW, tol), designed(tol / DB)
        same = "the same design: PCG64, sosfilt, oaconvolve, dB"
        found.append(peer(same, f"{tol:g}", pcg, sos(of(pink)), taps(h)))
        same = "the same design: SFC64, compiled loops, dB"
        paired = filter_loops.antisymmetric(h, np.float32 if tol > 1e-4 else float)
        found.append(peer(same, f"{tol:g}", sfc, looped(pink), paired))
    refined = sos(sections(*KELLET["refined"]))
    for knob, h in (
        ("central difference", FS / 2 * np.array([1.0, 0.0, -1.0])),
        ("remez, 129 taps", remez(129, 10.0)),
    ):
        found.append(peer("PCG64, Kellet refined", knob, pcg, refined, taps(h)))
    return found


PROBLEMS = (
    Problem(
        "pink",
        "3 dB/oct filter, 1 Hz to 3.6 kHz at 8 kHz",
        "largest deviation from 3 dB/oct, dB",
        SAMPLES,
        pink,
    ),
    Problem(
        "differentiator",
        "d/dt up to 1 kHz at 8 kHz",
        "largest error relative to the gain up to 1 kHz, or gain from 1.5 kHz on of that at 1 kHz",
        SAMPLES,
        partial(differentiators, True),
    ),
    Problem(
        "derivative",
        "d/dt up to 1 kHz at 8 kHz, anything above",
        "largest error relative to the gain, up to 1 kHz",
        SAMPLES,
        partial(differentiators, False),
    ),
    Problem(
        "chain",
        "white noise, 3 dB/oct, d/dt: 10 Hz to 1 kHz at 8 kHz",
        "largest deviation from +3 dB/oct, dB, or gain from 1.5 kHz on of that at 1 kHz, in 8.7 dB",
        SAMPLES,
        chain,
    ),  # fmt: skip
)
