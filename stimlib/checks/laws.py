"""Laws of whole signals, written from the papers, independently of the blocks.

Nothing of a block's design or step is used.

The generator of noise, the squeezed finger, the springpot's sum, bumps and their
carrier; ``scenes`` puts them together. Frequency responses are in
``stimlib.design.responses``.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import scipy

from ..analysis.recursion import all_pole
from ..errors import BadValue

# Noise: the published generator once more, over any whole numbers ---------------------
LOW = (1 << 32) - 1


def philox(counter: tuple[Any, Any, Any, Any], key: tuple[Any, Any]) -> tuple[Any, Any, Any, Any]:
    """Return Philox4x32-10 of 32-bit words.

    Source: Salmon et al. 2011. The words are whole numbers or arrays of uint64.

    Examples
    --------
    >>> from stimlib.checks.laws import philox
    >>> ["%08x" % w for w in philox((0, 0, 0, 0), (0, 0))]
    ['6627e8d5', 'e169c58d', 'bc57ac4c', '9b00dbd8']
    """
    a, b, c, d = counter
    k, m = key
    for _ in range(10):
        first, second = 0xD2511F53 * a, 0xCD9E8D57 * c
        a, b, c, d = (second >> 32) ^ b ^ k, second & LOW, (first >> 32) ^ d ^ m, first & LOW
        k, m = (k + 0x9E3779B9) & LOW, (m + 0xBB67AE85) & LOW
    return a, b, c, d


def white(run_seed: int, seed: int, stream: int, first: int, n: int, use: int = 0) -> np.ndarray:
    """Return samples of white_noise(seed, stream) in a run.

    They are the samples first .. first + n - 1, computed by the mathematical library;
    first must be even.

    Those of the use 1 are the deviates of stationary starts.

    Examples
    --------
    >>> from stimlib.checks.laws import white
    >>> white(0, 1, 0, 0, 3).round(4), white(0, 1, 0, 2, 1).round(4)
    (array([-0.1447,  0.7181, -1.1658]), array([-1.1658]))
    """
    w = philox((seed & LOW, seed >> 32, stream, use), (run_seed & LOW, run_seed >> 32))
    pairs, y = (n + 1) // 2, np.empty(n + 1)
    for at in range(0, pairs, 1 << 14):  # a stretch fits into the cache
        size = min(1 << 14, pairs - at)
        m = (np.arange(size, dtype=np.uint64) + (first // 2 + at) % (1 << 63)) & ((1 << 63) - 1)
        a, b, c, d = philox((m & LOW, m >> 32, 0, 0), (w[0], w[1]))
        u, v = ((a | b << 32) + 0.5) * 2.0**-64, c | d << 32
        turn = (v >> 62) / 4 + (((v >> 11) & ((1 << 51) - 1)) - 2.0**50) * 2.0**-53
        radius = np.sqrt(-2 * np.log(u))
        y[2 * at : 2 * (at + size) : 2] = radius * np.cos(2 * np.pi * turn)
        y[2 * at + 1 : 2 * (at + size) : 2] = radius * np.sin(2 * np.pi * turn)
    return y[:n]


# Textures -----------------------------------------------------------------------------
def texture_weights(
    at: np.ndarray, places: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners and weights, both (n, 3), of places (n, 2).

    The weights are the areas of the triangles that a place makes with two corners.

    For a place in no triangle it is the triangle in which its smallest weight is
    largest, with negative weights set to 0.
    """

    def area(a, b, c):
        return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (c[..., 0] - a[..., 0]) * (
            b[..., 1] - a[..., 1]
        )

    a, b, c = (places[triangles[:, k]] for k in range(3))
    whole = area(a, b, c)
    some = np.abs(whole) > 1e-9
    a, b, c, whole, triangles = a[some], b[some], c[some], whole[some], triangles[some]
    w = np.empty((len(at), 3))
    corners = np.empty((len(at), 3), int)
    for k in range(0, len(at), 4096):
        x = at[k : k + 4096, None]
        parts = np.stack([area(x, b, c), area(a, x, c), area(a, b, x)], axis=-1) / whole[:, None]
        t = parts.min(axis=-1).argmax(axis=1)
        w[k : k + 4096] = np.maximum(parts[np.arange(t.size), t], 0)
        corners[k : k + 4096] = triangles[t]
    return corners, w / w.sum(axis=1, keepdims=True)


def from_line_spectrum(lsf: np.ndarray) -> np.ndarray:
    """Return polynomial coefficients from line spectral frequencies (n, p).

    They are (n, p), without the leading 1; they follow from the values of P + Q at p +
    2 points of the unit circle, in each of which the factors are multiplied.
    """
    n, p = lsf.shape
    u, whole = np.exp(-2j * np.pi * np.arange(p + 2) / (p + 2)), np.zeros((n, p + 2), complex)
    for first, sign in ((0, 1.0), (1, -1.0)):
        half = np.ones((n, 1)) * (1 + sign * u if p % 2 == 0 else 1 - u**2 if sign < 0 else u**0)
        for w in lsf[:, first::2].T:
            half *= (1 - np.exp(1j * w)[:, None] * u) * (1 - np.exp(-1j * w)[:, None] * u)
        whole += half
    return np.fft.ifft(whole).real[:, 1 : p + 1] / 2


def texture(
    model: Any,
    speed: np.ndarray,
    force: np.ndarray,
    noise: np.ndarray,
    every: int,
    seen: Any = None,
) -> np.ndarray:
    """Return the acceleration of a measured texture.

    y = v + sum b v[-k] - sum a y[-k] at each ``every``-th sample, and a sinc between
    them.

    Parameters
    ----------
    model : TextureModel
        Its numbers count, not what it computes.
    speed, force, noise : ndarray, shape (n,)
        In m/s and N, and of the deviation 1.
    every : int
    seen : ndarray, optional
        What a texture gave that began earlier; its first values, which are those of the
        model 6 of its samples later, are kept.
    """
    top = np.array([model.speed.max(), model.force.max()])
    at = (
        np.nan_to_num(np.clip(np.stack([np.abs(speed[::every]), force[::every]], axis=1), 0, top))
        / top
    )
    corners, w = texture_weights(
        at, np.stack([model.speed, model.force], axis=1) / top, model.triangles.astype(int)
    )

    def mean(v):
        return np.einsum("nk,nk...->n...", w, v[corners])

    v = mean(model.gain) * np.sqrt(mean(model.variance)) * noise[::every]
    ar, ma = from_line_spectrum(mean(model.lsf)), from_line_spectrum(mean(model.ma))
    p, q = ar.shape[1], ma.shape[1]
    driven, y = np.r_[np.zeros(q), v], np.zeros(p + v.size)
    known = 0 if seen is None else p + q
    if known:  # the sinc leaves them as they are
        y[p : p + known] = seen[::every][6 * (every > 1) :][:known]
    for n in range(known, v.size):
        y[p + n] = v[n] + ma[n] @ driven[n : n + q][::-1] - ar[n] @ y[n : n + p][::-1]
    if every == 1:
        return y[p:]
    t = np.arange(12 * every) / every - 6
    taps = (np.sinc(t) * scipy.signal.windows.kaiser(12 * every + 1, 6.0)[:-1]).reshape(12, every)
    return scipy.signal.upfirdn((taps / taps.sum(axis=0)).ravel(), y[p:], every)[: speed.size]


# Scenes -------------------------------------------------------------------------------
class Finger(NamedTuple):
    """The squeeze law of one finger; all arrays have one value per sample."""

    mean: np.ndarray  # k x, or what another impedance makes of x; 0 off contact
    v: np.ndarray
    gate: np.ndarray  # bool
    force: np.ndarray  # mean + A level (k tau v)(tau noise)


def squeeze_finger(
    x: np.ndarray,
    noise: np.ndarray,
    contact: np.ndarray,
    fs: float,
    k: Any,
    A: Any,
    cutoff: float,
    on: float,
    off: float,
    kept: dict[str, Any] | None = None,
) -> Finger:
    """Return the squeeze law for one finger's position and (gated) noise.

    Source: the UGrip paper, eq. (2) and section 2.1.

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
    kept : dict, optional
        What the samples before these left, and then what these leave; by default there
        were none.
    """
    touching, kept = contact > 0, {} if kept is None else kept
    v = np.zeros_like(x)
    pole = math.exp(-2 * math.pi * cutoff / fs)
    starts = np.flatnonzero(touching & ~np.r_[False, touching[:-1]])
    stops = np.flatnonzero(touching & ~np.r_[touching[1:], False]) + 1
    for a, b in zip(starts, stops, strict=True):  # at rest at the first sample of every contact
        last, state = kept.get("contact", (x[a], None)) if a == 0 else (x[a], None)
        rate = np.diff(x[a:b], prepend=last) * fs
        v[a:b], state = all_pole((1 - pole) ** 2, [-2 * pole, pole * pole], rate, state)
        kept["contact"] = x[b - 1], state
    n = np.arange(x.size, dtype=np.int32)
    before = -1 if kept.get("gate") else -2
    # open since it was last above on, unless it was not above off since
    opened = np.maximum.accumulate(np.where(v > on, n, np.int32(before)))
    closed = np.maximum.accumulate(np.where(v > off, np.int32(-2), n))
    gate = opened > closed
    if x.size and not touching[-1]:
        kept.pop("contact", None)
    kept["gate"] = bool(gate[-1]) if x.size else False
    return vibrating(Finger(k * x * touching, v, gate, x), noise, k / 8000 * v, A)


def vibrating(finger: Finger, noise: np.ndarray, rate: np.ndarray, A: Any) -> Finger:
    """Return the law of a finger with the given noise, r tau and gain."""
    return finger._replace(force=finger.mean + A * rate * (noise / 8000))


def gate_thresholds(resolution: float, cutoff: float, fs: float) -> tuple[float, float]:
    """Return the thresholds (on, off) of the loading gate.

    off = 2 q max|h|, where h is the velocity after a step of one encoder code q; on = 2
    off.
    """
    pole = math.exp(-2 * math.pi * cutoff / fs)
    n = math.ceil(8 / (1 - pole)) + 8
    h, _ = all_pole((1 - pole) ** 2, [-2 * pole, pole * pole], np.r_[fs, np.zeros(n)])
    off = 2 * resolution * float(np.max(np.abs(h)))
    return 2 * off, off


FEW = 4096  # weights that are a product of as many factors


# Springpot ----------------------------------------------------------------------------
def springpot_weights(scheme: str, alpha: float, n: int) -> np.ndarray:
    """Return the weights v_0 .. v_{n-1} of a springpot's first differences.

    They are those of Gruenwald and Letnikov or of L1, in extended precision.

    "straight" takes differences of the sum of a force that is linear between samples:
    second differences of j^(2 - alpha).
    """
    j, a = np.arange(1, max(n, FEW), dtype=np.longdouble), np.longdouble(alpha)
    v = np.cumprod(np.r_[np.longdouble(1), (j[: FEW - 1] - a) / j[: FEW - 1]])
    rho = (1 - a) / 2  # Gamma(j + 1 - alpha)/Gamma(j + 1) by its series
    w = j[FEW - 2 :] + rho
    far = w**-a * (
        1 - a * (a + 1) * rho / 12 * (1 - (a + 2) * (a + 3) * (5 * rho + 1) / 120 / w**2) / w**2
    )
    g = v[-1] / far[0]  # 1/Gamma(1 - alpha)
    if scheme == "gl" or alpha == 1:
        return np.r_[v, g * far[1:]][:n]
    if scheme == "l1":
        return (
            g
            / (1 - a)
            * np.r_[np.longdouble(1), j ** (1 - a) * np.expm1((1 - a) * np.log1p(1 / j))][:n]
        )
    with np.errstate(divide="ignore"):
        second = np.expm1((2 - a) * np.log1p(1 / j)) + np.expm1((2 - a) * np.log1p(-1 / j))
    return g / (1 - a) / (2 - a) * np.r_[np.longdouble(1), j ** (2 - a) * second][:n]


def springpot_sum(
    y: np.ndarray, fs: float, scheme: str, alpha: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return D^alpha y by the full sum at some samples, and its absolute sum.

    Source: Çaldıran's thesis, eq. (3.1), from rest. The second is the same sum of
    absolute values.

    The order is that of the sample, as if it had been so from the start.
    """
    d = np.diff(y.astype(np.longdouble), prepend=np.longdouble(y[0]))
    sums = np.empty((at.size, 2))
    for order in np.unique(alpha[at]):
        same = np.flatnonzero(alpha[at] == order)
        v = springpot_weights(scheme, float(order), int(at[same].max()) + 1)
        scale = np.longdouble(fs) ** np.longdouble(order)
        for i in same:
            past = d[at[i] :: -1]
            sums[i] = v[: past.size] @ past * scale, v[: past.size] @ np.abs(past) * scale
    return sums[:, 0], sums[:, 1]


def springpot_convolution(
    y: np.ndarray, fs: float, scheme: str, alpha: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return both sums of `springpot_sum` at every sample, by Fourier transforms.

    In double precision they are exact to some 1e-14 of the largest.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.checks.laws import springpot_convolution, springpot_sum
    >>> y = np.sin(np.arange(100) / 10)
    >>> force, _ = springpot_sum(y, 1000.0, "gl", np.full(100, 0.5), np.arange(100))
    >>> bool(
    ...     abs(springpot_convolution(y, 1000.0, "gl", 0.5)[0] - force).max()
    ...     < 1e-13 * abs(force).max()
    ... )
    True
    """
    v = springpot_weights(scheme, alpha, y.size).astype(float) * fs**alpha
    d = np.diff(y, prepend=y[0])
    return scipy.signal.fftconvolve(v, d)[: y.size], scipy.signal.fftconvolve(np.abs(v), np.abs(d))[
        : y.size
    ]


# Bumps --------------------------------------------------------------------------------
def ways(x: np.ndarray, contact: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the position before each sample, and where there is contact.

    At the first sample of a contact it is the position of that sample.
    """
    touching = contact > 0
    return np.where(touching & ~np.r_[False, touching[:-1]], x, np.r_[x[:1], x[:-1]]), touching


def _cell(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of the bump, and the position within it.

    A position that rounds to the next bump counts as part of it.
    """
    k = np.floor(u)
    k += u - k >= 1
    return k, np.maximum(u - k, 0)


def _ridge_mean(waveform: str, d: np.ndarray, a: Any, b: np.ndarray) -> np.ndarray:
    """Return the mean of the envelope from a to b on a ridge of width d.

    0 <= a <= b <= d. It uses products, so that nothing cancels.
    """
    z, way = (a + b) / 2 / d, b - a
    if waveform not in ("square", "sawtooth", "half_sine", "sine"):
        raise BadValue(
            f"the waveform {waveform!r:.40} is not known; choose one of square, sawtooth,"
            " half_sine, sine"
        )
    if waveform in ("square", "sawtooth"):
        return np.ones(d.size) if waveform == "square" else z
    if waveform == "half_sine":
        return np.sin(np.pi * z) * np.sinc(way / 2 / d)
    q = (np.pi * way) ** 2
    # of a cosine, by its mean
    lost = np.where(
        way < 0.03, q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72))), 1 - np.sinc(way)
    )
    top = 2 * np.sin(np.pi * d * z) * np.sin(np.pi * d * (1 - z))
    return (top - lost * np.cos(2 * np.pi * d * (z - 0.5))) / (2 * np.sin(np.pi * d / 2) ** 2)


def bump_envelope(last: np.ndarray, u: np.ndarray, waveform: str, d: np.ndarray) -> np.ndarray:
    """Return the mean of the unipolar envelope from last to u, and its tolerance.

    Source: touch-screen thesis, figure 4.1. The tolerance is the rounding of a mean
    across an edge.

    Over a path across an edge the mean is a difference of rounded areas, divided by the
    path.
    """
    (k, v), (m, w) = _cell(np.minimum(last, u)), _cell(np.maximum(last, u))
    a, b, way = np.minimum(v, d), np.minimum(w, d), np.abs(u - last)
    mean, whole = (
        _ridge_mean(waveform, d, a, np.where(k == m, b, d)),
        _ridge_mean(waveform, d, 0.0, d),
    )
    several = (d - a) * mean + (m - k - 1) * d * whole + b * _ridge_mean(waveform, d, 0.0, b)
    inside = (k == m) & ((v < d) == (w < d))
    way = np.where(inside, np.inf, way)
    over = np.clip(np.where(k == m, (b - a) * mean, several) / way, 0, 1)
    return np.array([np.where(inside, np.where(v < d, mean, 0), over), np.minimum(4e-16 / way, 1)])


def profile_gain(
    x: np.ndarray, contact: np.ndarray, knots: np.ndarray, d: np.ndarray, kind: str
) -> tuple[np.ndarray, float]:
    """Return d_max/d between the last two positions, and the largest gain.

    Source: touch-screen thesis, section 4.2. The largest gain is that between the
    knots.
    """
    make = {
        "cubic": scipy.interpolate.CubicSpline,
        "polynomial": scipy.interpolate.BarycentricInterpolator,
    }
    curve = make[kind](knots, d)
    places = np.concatenate(
        [np.linspace(a, b, 65) for a, b in zip(knots[:-1], knots[1:], strict=True)]
    )
    return d.max() / curve(np.clip((ways(x, contact)[0] + x) / 2, knots[0], knots[-1])), float(
        d.max() / curve(places).min()
    )


def turning(freq: np.ndarray, fs: float, phase: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return a carrier's phase in turns at each sample, and its increments.

    It starts at a phase in rad.
    """
    step = freq.astype(np.longdouble) / np.longdouble(fs)
    return np.cumsum(step) - step + phase / (2 * np.longdouble(np.pi)), step


def carried(t: np.ndarray, step: np.ndarray, rectify: str | None) -> np.ndarray:
    """Return a sinusoid at a phase in turns, rectified or not.

    If rectified, it is the mean over the sample period around each sample, for which
    the turns per sample are needed.
    """
    pi = np.longdouble(math.pi) + np.longdouble(1.2246467991473532e-16)
    t = t - np.floor(t + 0.25)  # the nearest half wave is 0 .. 1/2
    if rectify not in (None, "half", "full"):
        raise BadValue(f"rectify = {rectify!r:.40} is not known; choose None, 'half' or 'full'")
    if rectify is None:
        return np.sin(2 * pi * t).astype(float)

    def half(t):
        low, high = np.maximum(t - step / 2, 0), np.minimum(t + step / 2, np.longdouble(0.5))
        inside = (t >= step / 2) & (
            t <= 0.5 - step / 2
        )  # the mean, set right at its frequency, is the sinusoid's own value there
        # over an edge: the integral of sin(2 pi t) from low to high is sin(pi (low +
        # high)) sin(pi (high - low))/pi
        size = np.where(step > 0, np.sin(pi * step), 1)
        part = np.sin(pi * (low + high)) * np.sin(pi * np.maximum(high - low, 0)) / size
        return np.where(inside, np.sin(2 * pi * t), part)

    return (half(t) if rectify == "half" else half(t) + half(t + 0.5 - np.floor(t + 0.75))).astype(
        float
    )
