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
    counts too; the second is its rms, by Parseval's theorem. Neither says what its
    density is at a frequency, so no spectrum of a noise is tested against them.
    """
    return (
        Law(
            band(f_low, lambda fs: 0.45 * fs),
            lambda f, fs: (f / f[len(f) // 2]) ** (-slope / 2),
            _db(2 * tol_db),
            f"S(f) ~ f^{-slope:g} within {tol_db:g} dB",
            lambda H, f, fs: np.abs(H) / np.abs(H[len(H) // 2]),
        ),
        Law(
            band(f_low / 1000, lambda fs: fs / 2),
            lambda f, fs: np.array([rms]),
            1e-3,
            f"rms {rms:g}",
            lambda H, f, fs: np.sqrt([np.trapezoid(np.abs(H) ** 2, f) / (f[-1] - f[0])]),
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
    order 2 round(64 fs/8000), from 2 to 8192.
    """

    def top(fs):
        return passband or 0.45 * fs

    def straight(H, f, fs):
        usual = min(max(2 * round(64 * fs / 8000), 2), 8192)
        return H * np.exp(1j * np.pi * f * (order or usual) / fs)

    text = f"i 2 pi f behind half its order, within {tol:g}"
    return Law(
        lambda fs: np.geomspace(top(fs) / 1000, top(fs), POINTS),
        lambda f, fs: 2j * np.pi * f,
        tol,
        text,
        straight,
        shapes=True,
    )


def delay(samples: int) -> Law:
    """Return the law of a delay, exp(-s T).

    The tolerance grows with the delay, as the phase is rounded once per sample.
    """
    return Law(
        below_nyquist,
        lambda f, fs: np.exp(-2j * np.pi * (f * samples / fs % 1)),
        1e-12 + 1e-15 * samples,
        f"delay of {samples} samples",
        shapes=True,
    )


def biquads(rows: np.ndarray) -> Law:
    """Return the law of second-order sections; errors scale with the largest response.

    They are polynomials in 1/z.
    """

    def law(f, fs):
        z = np.exp(2j * np.pi * f / fs)
        return np.prod([np.polyval(r[:3], z) / np.polyval(r[3:], z) for r in rows], axis=0)

    text = f"{len(rows)} second-order sections"
    return Law(below_nyquist, law, 1e-9, text, size=largest)


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
    tol = (2 * math.pi * cutoff / fs) ** 2 / 4 + 1e-12
    return Law(
        band(cutoff / 100, lambda fs: cutoff),
        lambda f, fs: 2j * np.pi * f / (1 + 1j * f / cutoff) ** 2 * np.exp(1j * np.pi * f / fs),
        tol,
        f"i 2 pi f through two poles of {cutoff:g} Hz",
        shapes=True,
    )


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
