"""Reference frequency responses of linear blocks, written from the papers.

Nothing of a block's design or step is used.

Each law is a function of plain numbers.  A block's ``laws`` gives those of its own
fields; the tests' table of blocks gives them by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from . import filters

Numbers = Sequence[float] | np.ndarray
ALIASES = np.arange(-300, 301)
POINTS = 2001


class Law(NamedTuple):
    """A reference law for a frequency response, with its tolerance.

    of(H) - law| <= tol size(law) must hold at the frequencies f(fs).
    """

    f: Callable[[float], np.ndarray]  # Hz
    law: Callable[[np.ndarray, float], np.ndarray]  # of (frequencies, sample rate) in Hz
    tol: float
    text: str
    of: Callable[[np.ndarray, np.ndarray, float], np.ndarray] = lambda H, f, fs: H
    size: Callable[[np.ndarray], np.ndarray] = np.abs
    shapes: bool = False  # whether it is what the block makes of the spectrum of a noise

    def error(self, H: Callable[[np.ndarray], np.ndarray], fs: float) -> float:
        """Return the error of a response relative to its reference law.

        The response is a function of frequencies in Hz.
        """
        f = self.f(fs)
        want = self.law(f, fs)
        return float(np.max(np.abs(self.of(H(f), f, fs) - want) / self.size(want)))


def band(low: float, high: Callable[[float], float]) -> Callable[[float], np.ndarray]:
    """Return a function of fs that gives frequencies from low to high(fs)."""
    return lambda fs: np.geomspace(min(low, high(fs) / 2), high(fs), POINTS)


def whole_band(points: int) -> Callable[[float], np.ndarray]:
    """Return a function of fs that gives frequencies from near 0 to 0.45 fs."""
    return lambda fs: np.linspace(0, 0.45 * fs, points + 1)[1:]


def below_nyquist(fs: float) -> np.ndarray:
    """Return frequencies from 0 to fs/2."""
    return np.linspace(0, fs / 2, 201)


def difference(f: np.ndarray, fs: float) -> np.ndarray:
    """Return the response of the first difference, 1 - 1/z = 2i sin(w/2) exp(-iw/2).

    In this form it keeps its digits at low frequencies.
    """
    half = np.pi * f / fs
    return 2j * np.sin(half) * np.exp(-1j * half)


def _db(tol_db: float) -> float:
    return 10 ** (tol_db / 20) - 1


def _size(H: np.ndarray, f: np.ndarray, fs: float) -> np.ndarray:
    return np.abs(H)


def largest(h: np.ndarray) -> np.ndarray:
    """Return the largest magnitude, as the scale for all values."""
    return np.full(h.shape, np.abs(h).max())


# Noise --------------------------------------------------------------------------------
def pink_noise(psd_1hz: float, f_low: float, tol_db: float) -> Law:
    """Return the law of a filter from white noise of unit variance to PSD psd_1hz/f."""
    text = f"S(f) = {psd_1hz:.4g}/f within {tol_db:g} dB"
    top = band(f_low, lambda fs: 0.45 * fs)
    return Law(
        top, lambda f, fs: np.sqrt(psd_1hz / f * fs / 2), _db(tol_db), text, _size, shapes=True
    )


def coloured_noise(slope: float, rms: float, f_low: float, tol_db: float) -> tuple[Law, Law]:
    """Return the laws of coloured noise from white noise of unit variance.

    The first is its slope relative to the middle of the band, whose own deviation
    counts too; the second is its rms, by Parseval's theorem.
    """

    def shape(H, f, fs):
        return np.abs(H) / np.abs(H[len(H) // 2])

    def whole(H, f, fs):
        return np.sqrt([np.trapezoid(np.abs(H) ** 2, f) / (f[-1] - f[0])])

    return (
        Law(
            band(f_low, lambda fs: 0.45 * fs),
            lambda f, fs: (f / f[len(f) // 2]) ** (-slope / 2),
            _db(2 * tol_db),
            f"S(f) ~ f^{-slope:g} within {tol_db:g} dB",
            shape,
            shapes=True,
        ),
        Law(
            band(f_low / 1000, lambda fs: fs / 2),
            lambda f, fs: np.array([rms]),
            1e-3,
            f"rms {rms:g}",
            whole,
            shapes=True,
        ),
    )


def pinking(f_low: float, tol_db: float) -> Law:
    """Return the law of a 3 dB/oct low-pass, |H|^2 = 1/w with w = 2 pi f/fs."""
    top = band(f_low, lambda fs: 0.45 * fs)
    return Law(
        top,
        lambda f, fs: np.sqrt(fs / (2 * np.pi * f)),
        _db(tol_db),
        "|H|^2 = 1/w, 3 dB/oct",
        _size,
        shapes=True,
    )


# Filters ------------------------------------------------------------------------------
def differentiator(passband: float | None, order: int | None, tol: float) -> Law:
    """Return the law of a differentiator, up to its pass edge.

    It is i 2 pi f, delayed by order/2 samples. By default the edge is 0.45 fs and the
    order 2 round(64 fs/8000).
    """

    def top(fs):
        return passband or 0.45 * fs

    def straight(H, f, fs):
        return H * np.exp(1j * np.pi * f * (order or 2 * round(64 * fs / 8000)) / fs)

    text = f"i 2 pi f behind half its order, within {tol:g}"

    def below_the_edge(fs):
        return np.geomspace(top(fs) / 1000, top(fs), POINTS)

    return Law(below_the_edge, lambda f, fs: 2j * np.pi * f, tol, text, straight, shapes=True)


def delay(samples: int) -> Law:
    """Return the law of a delay, exp(-s T).

    The tolerance grows with the delay, as the phase is rounded once per sample.
    """

    def law(f, fs):
        return np.exp(-2j * np.pi * (f * samples / fs % 1))

    return Law(
        below_nyquist, law, 1e-12 + 1e-15 * samples, f"delay of {samples} samples", shapes=True
    )


def sum_of(taps: Numbers) -> Law:
    """Return the law of an FIR filter; errors scale with its largest response.

    Two computations differ in the phase of a sample's delay by the rounding of a turn,
    at most 2e-15, and a sum of n taps changes with that phase by at most n times its
    largest value (Bernstein's inequality).
    """

    def law(f, fs):
        return sum(h * np.exp(-2j * np.pi * f * k / fs) for k, h in enumerate(taps))

    tol = max(1e-12, 2e-15 * len(taps))
    return Law(below_nyquist, law, tol, f"sum of {len(taps)} taps", size=largest)


def mean_of(n: int) -> Law:
    """Return the law of a mean of n samples: Dirichlet's kernel with its delay."""

    def law(f, fs):
        half = np.pi * f / fs
        return np.sin(n * half) / (n * np.sin(half)) * np.exp(-1j * (n - 1) * half)

    return Law(whole_band(200), law, 1e-12, f"mean of {n} samples", size=largest)


def biquads(rows: np.ndarray) -> Law:
    """Return the law of second-order sections; errors scale with the largest response.

    They are polynomials in 1/z.
    """

    def law(f, fs):
        z = np.exp(2j * np.pi * f / fs)
        return np.prod([np.polyval(r[:3], z) / np.polyval(r[3:], z) for r in rows], axis=0)

    text = f"{len(rows)} second-order sections"
    return Law(below_nyquist, law, 1e-9, text, size=largest)


def resonance(freq: float, q: float, notched: bool = False) -> Law:
    """Return the law of a resonator, or of a notch (1 minus the resonator).

    1/(1 + i (cos w0 - cos w)/(sin w tan(W/2))), w0 = 2 pi freq/fs, W = w0/q.

    The power is half where cos w0 = cos(w -+ W/2)/cos(W/2): at two frequencies that are
    freq/q apart.
    """

    def law(f, fs):
        w, w0 = 2 * np.pi * f / fs, 2 * math.pi * freq / fs
        apart = 2 * np.sin((w + w0) / 2) * np.sin((w - w0) / 2) / (np.sin(w) * math.tan(w0 / q / 2))
        return 1j * apart / (1 + 1j * apart) if notched else 1 / (1 + 1j * apart)

    return Law(whole_band(200), law, 1e-10, f"resonance at {freq:g} Hz, q = {q:g}", size=largest)


def oscillator(freq: float, q: float) -> Law:
    """Return the law of a mass on a spring, for inputs linear between samples.

    It is 1/(1 - g^2 + i g/q), g = f/freq, summed over all aliases with the spectrum of
    a triangle.
    """

    def law(f, fs):
        g = (f[:, None] + ALIASES * fs) / freq
        return np.sum(np.sinc(f[:, None] / fs + ALIASES) ** 2 / (1 - g * g + 1j * g / q), axis=1)

    return Law(
        whole_band(200),
        law,
        1e-8,
        f"mode at {freq:g} Hz, q = {q:g}, of straight lines",
        size=largest,
    )


def pole_swap(freq: float, q: float, gain: float) -> Law:
    """Return the law of a pole swap, (z - p)(z - p*)/((z - r)(z - r*)), 1 at freq.

    p and r are the discrete poles for the qualities q and q/gain.
    """

    def poles(z, fs, q):
        turn = 2j * math.pi * freq / fs * np.array([1, -1]) * math.sqrt(
            1 - 0.25 / q**2
        ) - math.pi * freq / (fs * q)
        return np.prod(z[:, None] - np.exp(turn), axis=1)

    def law(f, fs):
        z = np.exp(2j * np.pi * np.r_[f, freq] / fs)
        h = poles(z, fs, q) / poles(z, fs, q / gain)
        return h[:-1] / abs(h[-1])

    return Law(
        whole_band(200),
        law,
        1e-10,
        f"poles at {freq:g} Hz from q = {q:g} to {q / gain:g}",
        size=largest,
    )


def family(
    band: str, edges: Numbers, order: int, kind: str, ripple: float, attenuation: float
) -> Law:
    """Return the law for the gain of a filter of one of four families.

    It is the gain of the prototype, whose edge is 1, at the transformed frequency x.

    x = tan(pi f/fs)/tan(pi cutoff/fs) for a low-pass, its inverse for a high-pass, (t^2
    - t1 t2)/(t (t2 - t1)) for a band-pass, and the inverse of that for a band-stop.
    """

    def law(f, fs):
        t, edge = np.tan(np.pi * f / fs), [math.tan(math.pi * e / fs) for e in edges]
        with np.errstate(divide="ignore"):
            x = t / edge[0] if len(edge) == 1 else (t - edge[0] * edge[1] / t) / (edge[1] - edge[0])
            x = np.clip(1 / x if band in ("highpass", "bandstop") else x, -1e12, 1e12)
        return filters.GAINS[kind](x, order, ripple, attenuation)

    def below(fs):
        return np.geomspace(edges[0] / 30, 0.45 * fs, POINTS)

    def gain(H, f, fs):
        return np.abs(H)

    return Law(below, law, 1e-9, f"{kind} {band} of order {order}", gain, largest, shapes=True)


def ring(freq: float, decay: float, onset: str) -> Law:
    """Return the law of a sampled decaying sine or cosine.

    The response is summed over exp(-t/decay) sin(2 pi freq t), or cos, at the samples
    until nothing is left.
    """

    def law(f, fs):
        n = np.arange(int(40 * decay * fs) + 2)
        turn = 2 * np.pi * (freq * n / fs % 1)
        h = np.exp(-n / (decay * fs)) * (np.sin(turn) if onset == "sine" else np.cos(turn))
        return np.array([np.sum(h * np.exp(-2j * np.pi * (v * n / fs % 1))) for v in f])

    return Law(
        whole_band(40), law, 1e-9, f"a ring of {freq:g} Hz that decays in {decay:g} s", size=largest
    )


def band_noise(low: float, high: float, psd: float, order: int) -> Law:
    """Return the law of a filter that gives white noise a PSD between two edges.

    The white noise has unit variance and the one-sided PSD 2/fs.
    """
    band = family("bandpass", (low, high), order, "butterworth", 1.0, 60.0)

    def law(f, fs):
        return math.sqrt(psd * fs / 2) * band.law(f, fs)

    return band._replace(law=law, text=f"S = {psd:.4g} from {low:g} to {high:g} Hz")


def velocity(cutoff: float) -> Law:
    """Return the documented formula of the two-pole velocity, as a law.

    d = (x[n] - x[n-1]) fs passes two poles y += g (x - y), g = 1 - exp(-2 pi
    cutoff/fs).
    """

    def law(f, fs):
        d, g = difference(f, fs), -math.expm1(-2 * math.pi * cutoff / fs)
        return fs * d * (g / (d + g * (1 - d))) ** 2

    return Law(whole_band(300), law, 1e-12, f"difference through two poles of {cutoff:g} Hz")


def slow_velocity(cutoff: float, fs: float) -> Law:
    """Return the law of a velocity far below the sample rate: the analogue filter.

    Relative to it, each sampled pole leads by half a sample, and the difference lags by
    half a sample.
    """

    def law(f, fs):
        return 2j * np.pi * f / (1 + 1j * f / cutoff) ** 2 * np.exp(1j * np.pi * f / fs)

    tol = (2 * math.pi * cutoff / fs) ** 2 / 4 + 1e-12
    return Law(
        band(cutoff / 100, lambda fs: cutoff),
        law,
        tol,
        f"i 2 pi f through two poles of {cutoff:g} Hz",
        shapes=True,
    )


def ramp_invariant(tau: float) -> Law:
    """Return the law of a lag 1/(1 + i w tau), for inputs linear between samples.

    It is summed over all aliases with the spectrum of a triangle.
    """

    def law(f, fs):
        part, a, end = f / fs, 2 * np.pi * fs * tau, ALIASES[-1] + 0.5
        g = part[:, None] + ALIASES
        near = np.sum(np.sinc(g) ** 2 / (1 + 1j * a * g), axis=1)
        # all further aliases: the integrals of 1/(x^2 (1 + i a x)) from both ends on
        far = sum(
            1 / x - 1j * s * np.log1p(-1j / (s * x)) for x, s in ((end + part, a), (end - part, -a))
        )
        return near + (np.sin(np.pi * part) / np.pi) ** 2 * far

    return Law(whole_band(40), law, 1e-7, f"1/(1 + s {tau:g}) of straight lines")


def lag(tau: float) -> Law:
    """Return the law of a lag 1/(1 + i w tau), far below the sample rate."""
    low = band(0.1, lambda fs: fs / 400)
    return Law(
        low, lambda f, fs: 1 / (1 + 2j * np.pi * f * tau), 3e-5, f"1/(1 + s {tau:g})", shapes=True
    )


def tracker(bandwidth: float, rate: bool = False) -> Law:
    """Return the law of the tracker w^2/(s + w)^2 at the end of each held sample.

    It is summed over all aliases with the spectrum of a hold.
    """

    def law(f, fs):
        g = f[:, None] + ALIASES * fs
        hold = np.sinc(g / fs) * np.exp(-1j * np.pi * g / fs)
        y = np.exp(2j * np.pi * f / fs) * np.sum(hold / (1 + 1j * g / bandwidth) ** 2, axis=1)
        return y * fs * difference(f, fs) if rate else y

    floor = 1e-6 * (2 * np.pi * bandwidth if rate else 1.0)
    text = f"two poles of {bandwidth:g} Hz of a held input"
    return Law(whole_band(40), law, 1e-6, text, size=lambda h: np.abs(h) + floor)


# Materials ----------------------------------------------------------------------------
def arms(k: Numbers, tau: Numbers, k0: float = 0.0) -> Law:
    """Return the law of Maxwell arms, for inputs linear between samples.

    It is k0 + sum k i w tau/(1 + i w tau), where each arm is computed as a spring less
    a lag.
    """
    total = k0 + sum(k)

    def law(f, fs):
        return total - sum(c * ramp_invariant(t).law(f, fs) for c, t in zip(k, tau, strict=True))

    return Law(
        whole_band(40), law, 1e-7, f"{len(k)} Maxwell arms", size=lambda h: np.full(h.shape, total)
    )


def chain(j0: float, j: Numbers, tau: Numbers, fluidity: float) -> Law:
    """Return the law of a Kelvin-Voigt chain, for inputs linear between samples.

    j0 + sum j/(1 + i w tau) + fluidity/(i w); an integral is the trapezoidal rule.
    """

    def law(f, fs):
        d = difference(f, fs)
        lags = sum(c * ramp_invariant(t).law(f, fs) for c, t in zip(j, tau, strict=True))
        return j0 + lags + fluidity / fs * (1 / d - 0.5)

    return Law(whole_band(40), law, 1e-7, f"{len(j)} Kelvin-Voigt elements in series")


def integral(leak: float) -> Law:
    """Return the law of an integral 1/(i w + leak), for inputs linear between samples.

    Without a leak it is the trapezoidal rule.
    """

    def law(f, fs):
        return (
            ramp_invariant(1 / leak).law(f, fs) / leak
            if leak
            else (1 / difference(f, fs) - 0.5) / fs
        )

    return Law(whole_band(40), law, 1e-7, f"integral with a leak of {leak:g} 1/s")


def running_sum() -> Law:
    """Return the law of an integral 1/(i w) computed as a sum of samples."""
    return Law(
        whole_band(200), lambda f, fs: 1 / (fs * difference(f, fs)), 1e-12, "sum over samples / fs"
    )


def _order(f: np.ndarray, fs: float, alpha: float, scheme: str) -> np.ndarray:
    """Return the fractional derivative's response (i w)^alpha in a given scheme.

    For Gruenwald and Letnikov's sum over the whole history it is the closed form, and
    for creep that of the sum's differences.
    """
    if scheme == "straight":
        return fs * difference(f, fs) * (2j * np.pi * f) ** (alpha - 1)
    return (fs * difference(f, fs)) ** alpha if scheme == "gl" else (2j * np.pi * f) ** alpha


def _order_tol(fs: float, alpha: float, scheme: str, tol: float) -> float:
    exponent = 2.0 if scheme == "straight" else max(1.0, 2 - alpha)
    return 10 * tol + (1e-12 if scheme == "gl" else (2 * math.pi / 1000) ** exponent)


SHORTEST = 2000
"""Samples of a springpot's horizon, below which no frequency up to fs/1000 has two
periods in it: no law is known then.
"""


def springpot(alpha: float, scheme: str, tol: float, horizon: float, fs: float) -> Law:
    """Return the law of a springpot, from its horizon up to fs/1000.

    The order is from 0 to 1.
    """
    text = {
        "gl": f"(fs (1 - 1/z))^{alpha:g}",
        "straight": f"(i w)^{alpha - 1:.6g} of a sum's differences",
    }
    low = band(100 / horizon, lambda fs: fs / 1000)
    return Law(
        low,
        lambda f, fs: _order(f, fs, alpha, scheme),
        _order_tol(fs, alpha, scheme, tol),
        text.get(scheme, f"(i w)^{alpha:g}"),
    )


def series(
    chi: float,
    alpha: float,
    other: float,
    dashpot: bool,
    scheme: str,
    tol: float,
    horizon: float,
    fs: float,
) -> Law:
    """Return the law of a springpot in series with a spring or a dashpot.

    They share one force: 1/(1/(chi (i w)^alpha) + 1/k).
    """

    def law(f, fs):
        pot = chi * _order(f, fs, alpha, scheme)
        second = other * fs * difference(f, fs) if dashpot else other
        return pot * second / (pot + second)

    limit = 2 * _order_tol(fs, alpha, scheme, tol)
    return Law(
        band(100 / horizon, lambda fs: fs / 1000),
        law,
        limit,
        "springpot in series with another element",
    )


def short_memory(alpha: float, memory: float, fs: float) -> Law:
    """Return the law of Gruenwald and Letnikov's sum over the last seconds."""
    from scipy.special import binom

    j = np.arange(max(1, round(memory * fs)))
    return sum_of(fs**alpha * (-1.0) ** j * binom(alpha, j))._replace(
        text=f"sum over the last {memory:g} s"
    )
