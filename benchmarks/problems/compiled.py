"""Loops that no package provides, compiled by numba: what somebody who knows a problem
writes by hand, with every shortcut that it allows.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit

compiled = njit(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
reordered = njit(error_model="numpy", fastmath=True)
EXP = tuple((-1) ** k / math.factorial(k) for k in range(11))  # of exp(-x), powers of x
# of sin(pi x)/(pi x) and cos(pi x), powers of x^2: 12 terms reach 1e-16 up to |x| = 0.6
SINC = tuple((-1) ** k * math.pi ** (2 * k) / math.factorial(2 * k + 1) for k in range(12))
COS = tuple((-1) ** k * math.pi ** (2 * k) / math.factorial(2 * k) for k in range(12))


@compiled
def series(x: float, c: tuple) -> float:
    """Return a polynomial of x^2."""
    z, y = x * x, 0.0
    for k in range(len(c)):
        y = y * z + c[len(c) - 1 - k]
    return y


@compiled
def bumps(u: np.ndarray, duty: float, sinc: tuple, cosine: tuple) -> np.ndarray:
    """Return the mean of sine bumps over each movement.

    Movements are shorter than the gap, so they meet one ridge.
    """
    y, top = np.zeros(u.size), math.cos(math.pi * duty)
    gain = 1.0 / (1.0 - top)
    for n in range(1, u.size):
        low, high = min(u[n - 1], u[n]), max(u[n - 1], u[n])
        first, last = np.floor(low), np.ceil(high) - 1.0
        a = 0.0 if last > first else min(low - first, duty)
        b, way = min(high - last, duty), high - low
        part = (b - a) / way if way > 0.0 else (1.0 if a < duty else 0.0)
        y[n] = part * (series(b - a, sinc) * series(a + b - duty, cosine) - top) * gain
    return y


@compiled
def ribs(x: np.ndarray, parts: np.ndarray, sinc: tuple, sine: tuple) -> np.ndarray:
    """Return the mean of ribs over each movement of less than 0.4 of the finest, from
    rows of wavelength, depth and phase.
    """
    y = np.zeros(x.size)
    for k in range(len(parts)):
        per, depth, phase = 1.0 / parts[k, 0], parts[k, 1], parts[k, 2] / (2.0 * math.pi)
        for n in range(1, x.size):
            turns = 0.5 * per * (x[n] + x[n - 1]) + phase
            half = np.rint(2.0 * turns)
            r = 2.0 * turns - half
            up = 1.0 - 2.0 * (half - 2.0 * np.floor(0.5 * half))
            wave = math.pi * r * series(r, sine) * up
            y[n] += depth * series((x[n] - x[n - 1]) * per, sinc) * wave
    return y


@compiled
def pieces(x: np.ndarray, c: np.ndarray, per: float) -> np.ndarray:
    """Return polynomials, rows of coefficients, over equal cells from 0 on."""
    y = np.empty(x.size)
    for n in range(x.size):
        t = x[n] * per
        k = min(int(t), len(c) - 1)
        t -= k
        total = c[k, 0]
        for j in range(1, c.shape[1]):
            total = total * t + c[k, j]
        y[n] = total
    return y


@compiled
def patches(x: np.ndarray, c: np.ndarray, per: float) -> np.ndarray:
    """Return polynomials of two places, (order + 1, order + 1) coefficients for each of
    square cells from 0 on.
    """
    y = np.empty(x.shape[1])
    for n in range(x.shape[1]):
        s, t = x[0, n] * per, x[1, n] * per
        i, k = min(int(s), c.shape[0] - 1), min(int(t), c.shape[1] - 1)
        s, t = s - i, t - k
        total = 0.0
        for a in range(c.shape[2]):
            row = c[i, k, a, 0]
            for b in range(1, c.shape[3]):
                row = row * t + c[i, k, a, b]
            total = total * s + row
        y[n] = total
    return y


@compiled
def planes(x: np.ndarray, z: np.ndarray, per: float) -> np.ndarray:
    """Return what a grid of heights gives between its points, bilinear."""
    y = np.empty(x.shape[1])
    for n in range(x.shape[1]):
        s, t = x[0, n] * per, x[1, n] * per
        i, k = min(int(s), z.shape[0] - 2), min(int(t), z.shape[1] - 2)
        s, t = s - i, t - k
        low = z[i, k] + t * (z[i, k + 1] - z[i, k])
        high = z[i + 1, k] + t * (z[i + 1, k + 1] - z[i + 1, k])
        y[n] = low + s * (high - low)
    return y


@compiled
def walked(x: np.ndarray, ends: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return polynomials, rows of coefficients, between increasing ends at increasing
    places.
    """
    y, k = np.empty(x.size), 0
    for n in range(x.size):
        while k < len(c) - 1 and x[n] >= ends[k + 1]:
            k += 1
        t, total = x[n] - ends[k], c[k, 0]
        for j in range(1, c.shape[1]):
            total = total * t + c[k, j]
        y[n] = total
    return y


@compiled
def means(x: np.ndarray, ends: np.ndarray, c: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return the mean of parabolas between increasing ends over each movement; first is
    the parabola in which each cell of length 1 begins.
    """
    y = np.zeros(x.size)
    for n in range(1, x.size):
        low, high = min(x[n - 1], x[n]), max(x[n - 1], x[n])
        k, way, a, b = first[int(low)], high - low, low, low
        while low >= ends[k + 1]:
            k += 1
        while True:
            b = min(high, ends[k + 1])
            part = (b - a) / way if way > 0.0 else 1.0
            m = 0.5 * (a + b) - ends[k]
            y[n] += part * (c[k, 0] * (m * m + (b - a) ** 2 / 12.0) + c[k, 1] * m + c[k, 2])
            if b >= high:
                break
            a, k = b, k + 1
    return y


@compiled
def lagged(x: np.ndarray, pole: float, fs: float) -> np.ndarray:
    """Return the difference of two samples after one pole."""
    y, held = np.zeros(x.size), 0.0
    for n in range(1, x.size):
        held = pole * held + (1.0 - pole) * fs * (x[n] - x[n - 1])
        y[n] = held
    return y


def steps(z: np.ndarray, parabolas: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what arms keep of their forces in a step of z time constants, and what
    they get of the first and the second difference of their positions.

    Without parabolas through the last three samples, they follow straight lines.
    """
    z = np.asarray(z, np.longdouble)
    first = -np.expm1(-z) / z
    exact = (1 - first) / z - first / 2
    second = np.where(z > 1e-3, exact, z / 12 - z**2 / 24 + z**3 / 80) * parabolas
    return np.exp(-z).astype(float), first.astype(float), second.astype(float)


@reordered
def bank(
    x: np.ndarray,
    spring: float,
    damper: float,
    bend: float,
    keep: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
) -> np.ndarray:
    """Return the answer of a spring, of arms, and of a damper under a force, whose step
    is a trapezoid less a part of the second difference.
    """
    y, q = np.empty(x.size), np.zeros(keep.size)
    y[0], total, last = spring * x[0], 0.0, x[1] - x[0]
    for n in range(1, x.size):
        d = x[n] - x[n - 1]
        dd = d - last
        total += damper * (x[n] - 0.5 * d - bend * dd)
        here = spring * x[n] + total  # a name of its own keeps it in a register
        for k in range(keep.size):
            q[k] = keep[k] * q[k] + first[k] * d + second[k] * dd
            here += q[k]
        y[n], last = here, d
    return y


def arms(
    parts: np.ndarray, fs: float, parabolas: bool = True, spring: float = 0.0, damper: float = 0.0
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a bank of arms, rows of stiffness and time constant, beside a spring."""
    k, tau = np.asarray(parts).T
    keep, first, second = steps(1 / (fs * tau), parabolas)
    rest = keep, k * first, k * second
    return lambda x: bank(x, spring, damper / fs, parabolas / 12, *rest)


@compiled
def falls(x: float) -> float:
    """Return exp(-x) of 0 to 40, to 1e-8."""
    y = 0.0
    for k in range(len(EXP)):
        y = y * (x / 64.0) + EXP[len(EXP) - 1 - k]
    for _ in range(6):
        y *= y
    return y


@compiled
def lugre(x: np.ndarray, fs: float, law: tuple) -> np.ndarray:
    """Return the mean force of LuGre friction on straight paths.

    The law is stiffness, damping, viscosity, sliding and static limit, and the speed of
    Stribeck's curve.  First come the exponentials, several at once, then the recursion.
    """
    stiffness, damping, viscosity, sliding, static, speed = law
    y, far, keep, mean = np.zeros(x.size), np.empty(x.size), np.empty(x.size), np.empty(x.size)
    for n in range(1, x.size):
        v = (x[n] - x[n - 1]) * fs
        limit = sliding + (static - sliding) * falls(v * v / (speed * speed))
        r = abs(v) * stiffness / (limit * fs)
        keep[n] = falls(r)
        mean[n] = (1.0 - keep[n]) / r if r > 1e-7 else 1.0
        far[n] = math.copysign(limit, v) / stiffness
    z = 0.0
    for n in range(1, x.size):
        z, before = far[n] + (z - far[n]) * keep[n], z
        bent = stiffness * (far[n] + (before - far[n]) * mean[n])
        y[n] = bent + (damping * (z - before) + viscosity * (x[n] - x[n - 1])) * fs
    return y


@compiled
def models(x: np.ndarray, corners: np.ndarray, origin: np.ndarray, per: np.ndarray) -> np.ndarray:
    """Return each column of corners (triangles, 3, columns) at places x (2, n) in them.

    The weights of the first two rise per unit from an origin, the third corner.  A
    triangle is looked for from the last on.
    """
    found, k, a, b = np.empty((corners.shape[2], x.shape[1])), 0, 0.0, 0.0
    for n in range(x.shape[1]):
        for _ in range(len(corners)):
            s, t = x[0, n] - origin[k, 0], x[1, n] - origin[k, 1]
            a, b = per[k, 0, 0] * s + per[k, 0, 1] * t, per[k, 1, 0] * s + per[k, 1, 1] * t
            if min(a, b, 1.0 - a - b) > -1e-9:
                break
            k = (k + 1) % len(corners)
        for j in range(corners.shape[2]):
            row = corners[k, :, j]
            found[j, n] = row[2] + a * (row[0] - row[2]) + b * (row[1] - row[2])
    return found


@compiled
def textured(m: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return a texture of models of 6 and 4 line spectral frequencies, a variance and a
    gain, (12, n): a filter of order 6 by one of order 4, in direct form.
    """
    for j in range(10):
        for n in range(noise.size):
            x = 0.5 * math.pi - m[j, n]
            m[j, n] = -2.0 * x * series(x / math.pi, SINC)
    h = np.empty((11, noise.size))
    for n in range(noise.size):
        a, b, c, d, e, f = m[0, n], m[2, n], m[4, n], m[1, n], m[3, n], m[5, n]
        p1, p2 = a + b + c, 3.0 + a * b + a * c + b * c
        q1, q2 = d + e + f, 3.0 + d * e + d * f + e * f
        p3, q3 = 2.0 * p1 + a * b * c, 2.0 * q1 + d * e * f
        h[0, n], h[1, n], h[2, n] = p1 + q1, p2 + p1 + q2 - q1, p3 + p2 + q3 - q2
        h[3, n], h[4, n], h[5, n] = p2 + p3 + q2 - q3, p1 + p2 + q1 - q2, 2.0 + p1 - q1
        a, b, d, e = m[6, n], m[8, n], m[7, n], m[9, n]
        p1, p2, q1, q2 = a + b, 2.0 + a * b, d + e, 2.0 + d * e
        h[6, n], h[7, n] = p1 + q1, p2 + p1 + q2 - q1
        h[8, n], h[9, n] = p1 + p2 + q1 - q2, 2.0 + p1 - q1
        h[10, n] = m[11, n] * math.sqrt(m[10, n]) * noise[n]
    y, v = np.zeros(6 + noise.size), np.zeros(6 + noise.size)  # 6 before the first
    for n in range(noise.size):
        k = 6 + n
        v[k] = h[10, n]
        driven = h[6, n] * v[k - 1] + h[7, n] * v[k - 2] + h[8, n] * v[k - 3] + h[9, n] * v[k - 4]
        driven -= h[5, n] * y[n] + h[4, n] * y[k - 5] + h[3, n] * y[k - 4] + h[2, n] * y[k - 3]
        driven -= h[1, n] * y[k - 2]
        y[k] = v[k] + 0.5 * (driven - h[0, n] * y[k - 1])
    return y[6:]
