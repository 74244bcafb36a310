"""Physical laws, written here from the papers and on their own: nothing of a block's design or step is used.

``RESPONSES`` says what a linear block stands for; what whole scenes must be is put together from these in ``scenes``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..blocks.delay import Delay
from ..blocks.fir import Differentiator
from ..blocks.fractional import Springpot
from ..blocks.impedance import FirstOrder, Velocity
from ..blocks.modes import Pinking, PinkNoise
from ..graph import Block


class Response(NamedTuple):
    """What a block should do to a sinusoid: |H - law| <= tol |law| between f_low and f_high (Hz)."""

    law: Callable[[np.ndarray], np.ndarray]
    tol: float
    f_low: float
    f_high: float
    magnitude: bool  # compare |H| only
    text: str


def _db(tol_db: float) -> float:
    return 10 ** (tol_db / 20) - 1


def _pink(b: Any, fs: float) -> Response:
    def law(f):
        return np.sqrt(b.psd_1hz / f * fs / 2)  # white of unit variance has one-sided PSD 2/fs

    return Response(law, _db(b.tol_db), b.f_low, 0.45 * fs, True, f"S(f) = {b.psd_1hz:.4g}/f within {b.tol_db:g} dB")


def _pinking(b: Any, fs: float) -> Response:
    return Response(lambda f: np.sqrt(fs / (2 * np.pi * f)), _db(b.tol_db), b.f_low, 0.45 * fs, True, "|H|^2 = 1/w, 3 dB/oct")


def _differentiator(b: Any, fs: float) -> Response:
    order = b.order or 2 * round(64 * fs / 8000)
    top = b.passband or 0.45 * fs

    def law(f):
        return 2j * np.pi * f * np.exp(-1j * np.pi * f * order / fs)

    return Response(law, b.tol, top / 1000, top, False, f"i 2 pi f, delay {order // 2} samples, within {b.tol:g}")


def _velocity(b: Any, fs: float) -> Response:
    def law(f):  # each sampled pole leads its analogue by half a sample, the difference lags by one half
        return 2j * np.pi * f / (1 + 1j * f / b.cutoff) ** 2 * np.exp(1j * np.pi * f / fs)

    tol = (2 * math.pi * b.cutoff / fs) ** 2 / 4
    return Response(law, tol, b.cutoff / 100, b.cutoff, False, f"i 2 pi f through two poles of {b.cutoff:g} Hz")


def _first_order(b: Any, fs: float) -> Response:
    top = 0.02 * fs
    tol = 2 * (math.pi * top / fs) ** 2  # of straight lines between samples
    return Response(lambda f: 1 / (1 + 2j * np.pi * f * b.tau), tol, top / 1000, top, False, f"1/(1 + s {b.tau:g})")


def _delay(b: Any, fs: float) -> Response:
    n = b.samples if b.samples is not None else round(b.seconds * fs)
    return Response(lambda f: np.exp(-2j * np.pi * f * n / fs), 1e-12, fs / 1000, fs / 2, False, f"delay of {n} samples")


def _springpot(b: Any, fs: float) -> Response:
    top = fs / 1000
    if b.scheme == "gl":  # what the sum over all history is, in closed form

        def law(f):
            return (fs * (1 - np.exp(-2j * np.pi * f / fs))) ** b.order

        return Response(law, 10 * b.tol + 1e-12, 100 / b.horizon, top, False, f"(fs (1 - 1/z))^{b.order:g}")
    tol = (2 * math.pi * top / fs) ** max(1.0, 2 - b.order) + 10 * b.tol

    def continuous(f):
        return (2j * np.pi * f) ** b.order

    return Response(continuous, tol, 100 / b.horizon, top, False, f"(i w)^{b.order:g}")


RESPONSES: dict[type[Block], Callable[[Any, float], Response]] = {
    PinkNoise: _pink,
    Pinking: _pinking,
    Differentiator: _differentiator,
    Velocity: _velocity,
    FirstOrder: _first_order,
    Delay: _delay,
    Springpot: _springpot,
}


# Noise: the published generator once more, in plain integers -----------------------------------------------------------
def philox(counter: tuple[int, int, int, int], key: tuple[int, int]) -> tuple[int, int, int, int]:
    """Philox4x32-10 (Salmon et al. 2011).

    Examples
    --------
    >>> from stimlib.checks.laws import philox
    >>> ["%08x" % w for w in philox((0, 0, 0, 0), (0, 0))]
    ['6627e8d5', 'e169c58d', 'bc57ac4c', '9b00dbd8']
    """
    a, b, c, d = counter
    k, m = key
    for _ in range(10):
        low, high = divmod(0xD2511F53 * a, 1 << 32)[::-1], divmod(0xCD9E8D57 * c, 1 << 32)[::-1]
        a, b, c, d = high[1] ^ b ^ k, high[0], low[1] ^ d ^ m, low[0]
        k, m = (k + 0x9E3779B9) % (1 << 32), (m + 0xBB67AE85) % (1 << 32)
    return a, b, c, d


def white(run_seed: int, seed: int, stream: int, first: int, n: int) -> np.ndarray:
    """Samples first .. first + n - 1 of white_noise(seed, stream) in a run, by the library's logarithm and cosine."""
    low = (1 << 32) - 1
    w = philox((seed & low, seed >> 32, stream, 0), (run_seed & low, run_seed >> 32))
    y = []
    for i in range(first, first + n):
        m = (i % (1 << 64)) >> 1
        a, b, c, d = philox((m & low, m >> 32, 0, 0), (w[0], w[1]))
        u, v = ((a | b << 32) + 0.5) * 2.0**-64, c | d << 32
        turn = (v >> 62) / 4 + (((v >> 11) & ((1 << 51) - 1)) - 2.0**50) * 2.0**-53
        y.append(math.sqrt(-2 * math.log(u)) * (math.sin if i & 1 else math.cos)(2 * math.pi * turn))
    return np.array(y)


# Scenes ----------------------------------------------------------------------------------------------------------------
class Finger(NamedTuple):
    """The squeeze law of one finger, computed from scratch: all arrays have one value per sample."""

    mean: np.ndarray  # k x
    v: np.ndarray
    gate: np.ndarray  # bool
    force: np.ndarray  # mean + A level (k tau v)(tau noise)


def squeeze_finger(
    x: np.ndarray, noise: np.ndarray, contact: np.ndarray, fs: float, k: Any, A: Any, cutoff: float, on: float, off: float
) -> Finger:
    """Paper 000, eq. (2) and section 2.1, for one finger's position and (gated) noise.

    Parameters
    ----------
    x, noise, contact : ndarray, shape (n,)
        Position in m; dp/dt in 1/s, 0 while the gate is closed; contact above 0 or not.
    fs, cutoff : float
        Hz.
    k, A : float or ndarray, shape (n,)
        Stiffness in N/m; gain times noise level.
    on, off : float
        Gate thresholds in m/s.
    """
    from scipy.signal import lfilter

    touching = contact > 0
    v = np.zeros_like(x)
    pole = math.exp(-2 * math.pi * cutoff / fs)
    starts = np.flatnonzero(touching & ~np.r_[False, touching[:-1]])
    stops = np.flatnonzero(touching & ~np.r_[touching[1:], False]) + 1
    for a, b in zip(starts, stops, strict=True):  # at rest at the first sample of every contact
        rate = np.diff(x[a:b], prepend=x[a]) * fs
        v[a:b] = lfilter([(1 - pole) ** 2], [1, -2 * pole, pole * pole], rate)
    n = np.arange(x.size)
    opened = np.maximum.accumulate(np.where(v > on, n, -1))  # open since it was last above on, unless it was not above off since
    closed = np.maximum.accumulate(np.where(v > off, -1, n))
    gate = opened > closed
    tau = 1 / 8000
    mean = k * x
    return Finger(mean, v, gate, mean + A * (k * tau * v) * (tau * noise))


def gate_thresholds(resolution: float, cutoff: float, fs: float) -> tuple[float, float]:
    """(on, off): off = 2 q max|h|, h the velocity after a step of one encoder code q; on = 2 off."""
    from scipy.signal import lfilter

    pole = math.exp(-2 * math.pi * cutoff / fs)
    n = math.ceil(8 / (1 - pole)) + 8
    h = lfilter([(1 - pole) ** 2], [1, -2 * pole, pole * pole], np.r_[fs, np.zeros(n)])
    off = 2 * resolution * float(np.max(np.abs(h)))
    return 2 * off, off


# Springpot ---------------------------------------------------------------------------------------------------------------
def springpot_weights(scheme: str, alpha: float, n: int) -> np.ndarray:
    """v_0 .. v_{n-1} of the sum over first differences, in extended precision: Gruenwald-Letnikov or L1."""
    j = np.arange(n, dtype=np.longdouble)
    a = np.longdouble(alpha)
    if scheme == "gl":
        return np.cumprod(np.r_[np.longdouble(1), (j[1:] - a) / j[1:]])
    v = (j + 1) ** (1 - a) - j ** (1 - a) if alpha < 1 else np.r_[np.longdouble(1), np.zeros(n - 1, np.longdouble)]
    far = j > 100  # the difference of two large powers, without losing digits
    v[far] = j[far] ** (1 - a) * np.expm1((1 - a) * np.log1p(1 / j[far]))
    return v / np.longdouble(math.gamma(2 - alpha))


def springpot_sum(y: np.ndarray, fs: float, scheme: str, alpha: float, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """D^alpha y at some samples by the full sum of paper 001, eq. (3.1), from rest; and the same sum of absolute values."""
    v = springpot_weights(scheme, alpha, int(at.max()) + 1)
    d = np.diff(y.astype(np.longdouble), prepend=np.longdouble(y[0]))
    if alpha == 0:
        d[0] = 0
    scale = np.longdouble(fs) ** np.longdouble(alpha)
    pairs = [(v[: n + 1] @ d[n::-1], v[: n + 1] @ np.abs(d[n::-1])) for n in at]
    return np.array([float(s * scale) for s, _ in pairs]), np.array([float(s * scale) for _, s in pairs])


# Bumps -------------------------------------------------------------------------------------------------------------------
def _ridge_integral(waveform: str, w: Any, d: Any) -> Any:
    """Integral of the envelope from 0 to w, 0 <= w <= 1."""
    s = np.minimum(w, d)
    if waveform == "square":
        return s
    if waveform == "sawtooth":
        return s * s / (2 * d)
    if waveform == "half_sine":
        return d / np.pi * (1 - np.cos(np.pi * s / d))
    pi = np.longdouble(math.pi)
    return ((np.sin(2 * pi * (s - d / 2)) + np.sin(pi * d)) / (2 * pi) - np.cos(pi * d) * s) / (1 - np.cos(pi * d))


def bump_envelope(u: np.ndarray, contact: np.ndarray, waveform: str, duty: np.ndarray) -> np.ndarray:
    """Mean of the unipolar wave over u[n-1] .. u[n], of the duty of sample n, paper 003, figure 4.1; 0 off contact."""
    u, d = u.astype(np.longdouble), duty.astype(np.longdouble)
    touching = contact > 0
    before = np.r_[u[:1], u[:-1]]
    first = touching & ~np.r_[False, touching[:-1]]
    before[first] = u[first]
    du = u - before

    def integral(z):
        return np.floor(z) * _ridge_integral(waveform, np.longdouble(1), d) + _ridge_integral(waveform, z - np.floor(z), d)

    same = (np.floor(u) == np.floor(before)) & ((u - np.floor(u) < d) == (before - np.floor(before) < d))
    same |= waveform in ("sine", "half_sine")  # they have no edges
    still = (np.abs(du) < 1e-8) & same  # the value there: a difference of integrals would have no digits left
    step = np.where(still, np.longdouble(1e-9), du)
    low = np.where(still, u, before)
    low = low - np.floor(low)  # places within a period have all their digits
    e = (integral(low + step) - integral(low)) / step
    return np.where(touching, e, 0).astype(float)


def carrier_half(freq: np.ndarray, fs: float) -> np.ndarray:
    """Positive half wave of a sinusoid with a frequency for each sample: means over the sample period, set right at freq (Hz)."""
    step = freq.astype(np.longdouble) / np.longdouble(fs)
    pi = np.longdouble(math.pi)

    def integral(z):
        s = z - np.floor(z)
        return np.floor(z) / pi + np.where(s < 0.5, (1 - np.cos(2 * pi * s)) / (2 * pi), 1 / pi)

    t = np.cumsum(step) - step
    mean = (integral(t + step / 2) - integral(t - step / 2)) / step
    return (mean / (np.sin(pi * step) / (pi * step))).astype(float)
