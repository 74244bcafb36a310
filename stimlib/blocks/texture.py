"""Measured textures: vibration that depends on the speed and force of a tool.

Sources: Romano and Kuchenbecker, IEEE Trans. Haptics 5 (2012); Culbertson, Unwin and
Kuchenbecker, IEEE Trans. Haptics 7 (2014); the models themselves are in
``stimlib.design.texture``.
"""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from ..core.graph import Block, Const, in_unit
from ..core.maths import TINY, each, floor, flush, fma, sqrt, where
from ..core.units import unit
from ..design.texture import (
    TAPS,
    TextureModel,
    load_texture as load_texture,
    save_texture as save_texture,
    scattered,
    upsampler,
)
from ..errors import BadValue, public
from .impedance import with_unit
from .movement import sinpi
from .noise import white_noise

INT = np.int64


# Parameters of `Texture` at a sample rate.
#   every      samples of this clock to one of the model
#   rows       of the interpolator, one for each of these
#   per_speed  1/largest
#   ax         weight of the first corner of each triangle: ax x + ay z + a, x and z
#              from 0 to 1
#   bx         of the second
#   corners    numbers of models, three for each triangle
#   lsf        in half turns, of each model those of the AR part, then of the MA part;
#              scattered
#   poles      how many those are
TextureParams = namedtuple(
    "TextureParams",
    "every rows per_speed per_force ax ay a bx by b corners lsf poles zeros variance gain",
)

# State of `Texture` between samples.
#   v    what drove the model, the newest first
#   y    what it gave
#   out  the same for the interpolator
#   n    samples since the model's last
TextureState = namedtuple("TextureState", "v y out n")

# A point among the measured models: scaled speed and force.
Place = namedtuple("Place", "x z")

# Weights of three models at a speed and force.
Weights = namedtuple("Weights", "a b c")


def part(v, per_largest):
    """Return v/largest limited to 0 .. 1; NaN becomes 0."""
    x = v * per_largest
    return where(x > 0.0, where(x < 1.0, x, 1.0), 0.0)


def weight(q, ax, ay, a):
    """Return the weight of one corner of a triangle."""
    return fma(ax, q.x, fma(ay, q.z, a))


def least(q, ax, ay, a, bx, by, b):
    """Return the smallest of a triangle's three weights; below 0 outside of it."""
    one, two = weight(q, ax, ay, a), weight(q, bx, by, b)
    third = 1.0 - one - two
    lower = where(one < two, one, two)
    return where(lower < third, lower, third)


def inside(one, two):
    """Return three weights with negative ones set to 0, scaled to a sum of 1."""
    a, b, c = (
        where(one > 0.0, one, 0.0),
        where(two > 0.0, two, 0.0),
        where(1.0 - one - two > 0.0, 1.0 - one - two, 0.0),
    )
    whole = a + b + c
    return Weights(a / whole, b / whole, c / whole)


def mean(w, a, b, c):
    """Return a quantity interpolated between three models."""
    return fma(w.a, a, fma(w.b, b, w.c * c))


def cosine(w, a, b, c):
    """Return the cosine of a frequency interpolated between three models.

    Frequencies are in half turns.
    """
    return sinpi(0.5 - mean(w, a, b, c))


def product(c, first, n, f):
    """Compute half of the coefficients of a product of quadratics 1 - 2 c[k] z + z^2.

    f[1 + j] is the coefficient of z^j for j = 0 .. n; f[0] is 0. The product is over k
    = first, first + 2, .., n of them.

    It has the degree 2 n and is symmetric, so half of the coefficients suffice.
    """
    f[0], f[1] = 0.0, 1.0
    for k in range(1, n + 1):
        q = -2.0 * c[first + 2 * k - 2]
        f[k + 1] = q * f[k] + 2.0 * f[k - 1]
        for j in range(k - 1, 0, -1):
            f[j + 1] = f[j + 1] + q * f[j] + f[j - 1]


def predictor(c, p, f, g, a):
    """Compute the coefficients a[0] .. a[p - 1] of z^-1 to z^-p of (P + Q)/2.

    c holds the cosines of p line spectral frequencies.

    P is the product over the 1st, 3rd, .. frequency and Q that over the others. If p is
    even they have the additional factors 1 + z and 1 - z; if it is odd, only Q has one,
    1 - z^2.
    """
    n, m = (p + 1) >> 1, p >> 1
    product(c, 0, n, f)
    product(c, 1, m, g)
    g[m + 2] = g[m]  # beyond the middle
    even = where(n == m, 1.0, 0.0)
    for i in range(1, n + 1):
        u = f[i + 1] + even * f[i]
        v = g[i + 1] - where(even > 0.0, g[i], g[i - 1])
        a[p - i] = 0.5 * (u - v)
        a[i - 1] = 0.5 * (u + v)


@dataclass(frozen=True, eq=False)
class Texture(Block):
    """A measured texture: ARMA models at their own rate, interpolated to the clock.

    y = v + sum b v[-k] - sum a y[-k] at the model's rate, where v = gain sqrt(variance)
    white; an interpolator of 12 taps raises it to the rate of the clock.
    """

    white: Block
    speed: Block
    force: Block
    speeds: np.ndarray
    forces: np.ndarray
    triangles: np.ndarray
    lsf: np.ndarray
    ma: np.ndarray
    variance: np.ndarray
    gain: np.ndarray
    rate: float

    @property
    def model(self) -> TextureModel:
        """The measured model that this block renders."""
        numbers = (
            self.speeds,
            self.forces,
            self.triangles,
            self.lsf,
            self.ma,
            self.variance,
            self.gain,
        )
        return TextureModel(*numbers, self.rate)

    def check(self):
        self.model.planes()
        if isinstance(self.force, Const) and self.force.value < 0:
            raise BadValue(
                f"texture: force = {self.force.value:g} N presses away from the surface; give a"
                " normal force of 0 or above"
            )

    def units(self, *u):
        for name, given, wanted in zip(
            ("white", "speed", "force"), u, ("", "m/s", "N"), strict=True
        ):
            in_unit(f"texture: {name}", getattr(self, name), given, wanted)
        return unit("m/s^2")

    def design(self, fs):
        every = round(fs / self.rate)
        if every < 1 or every * self.rate != fs:
            near = max(every, 1) * self.rate
            raise BadValue(
                f"texture: fs = {fs:g} Hz must be a whole multiple of the model's {self.rate:g} Hz;"
                f" use {near:g} Hz"
            )
        planes, corners = self.model.planes()
        (ax, ay, a), (bx, by, b) = np.ascontiguousarray(planes.transpose(1, 2, 0)[:2])
        poles, zeros = self.lsf.shape[1], self.ma.shape[1]
        per_speed, per_force = 1 / float(self.speeds.max()), 1 / float(self.forces.max())
        lsf = np.concatenate([*map(scattered, (self.lsf, self.ma))], axis=1).ravel() / math.pi
        p = TextureParams(
            float(every),
            upsampler(every).ravel(),
            per_speed,
            per_force,
            ax,
            ay,
            a,
            bx,
            by,
            b,
            corners.ravel().astype(float),
            lsf,
            float(poles),
            float(zeros),
            self.variance,
            self.gain,
        )
        return p, TextureState(np.zeros(max(zeros, 1)), np.zeros(poles), np.zeros(TAPS), 0.0)

    def delay(self, p):
        return 0.5 * TAPS * p.every if p.every > 1 else 0.0

    @staticmethod
    def work(p):
        return p.a.size + 4 * INT(p.poles + p.zeros + 4.0)

    @staticmethod
    def tile(p, s, white, speed, force, y, w):
        poles, zeros = INT(p.poles), INT(p.zeros)
        both = poles + zeros
        size, rest = both + 4, w[p.a.size :]
        fit, c, ab, f, g = (
            w[: p.a.size],
            rest[:both],
            rest[size : size + both],
            rest[2 * size :],
            rest[3 * size :],
        )
        a, b = ab[:poles], ab[poles:]
        n = where(s.n >= 0.0, where(s.n < p.every, floor(s.n), 0.0), 0.0)
        for i in range(y.size):
            if n == 0.0:
                at = Place(part(abs(speed[i]), p.per_speed), part(force[i], p.per_force))
                each(least, at, (p.ax, p.ay, p.a, p.bx, p.by, p.b), fit)
                t = 0
                for k in range(1, fit.size):
                    if fit[k] > fit[t]:
                        t = k
                q = inside(
                    weight(at, p.ax[t], p.ay[t], p.a[t]), weight(at, p.bx[t], p.by[t], p.b[t])
                )
                k0, k1, k2 = (
                    INT(p.corners[3 * t]),
                    INT(p.corners[3 * t + 1]),
                    INT(p.corners[3 * t + 2]),
                )
                each(
                    cosine,
                    q,
                    (
                        p.lsf[k0 * both :][:both],
                        p.lsf[k1 * both :][:both],
                        p.lsf[k2 * both :][:both],
                    ),
                    c,
                )
                predictor(c[:poles], poles, f, g, a)
                predictor(c[poles:], zeros, f, g, b)
                variance = mean(q, p.variance[k0], p.variance[k1], p.variance[k2])
                v = mean(q, p.gain[k0], p.gain[k1], p.gain[k2]) * sqrt(variance) * white[i] + TINY
                z = v
                for k in range(zeros):
                    z = fma(b[k], s.v[k], z)
                for k in range(poles):
                    z = fma(-a[k], s.y[k], z)
                for k in range(s.v.size - 1, 0, -1):
                    s.v[k] = s.v[k - 1]
                for k in range(poles - 1, 0, -1):
                    s.y[k] = s.y[k - 1]
                for k in range(s.out.size - 1, 0, -1):
                    s.out[k] = s.out[k - 1]
                s.v[0], s.y[0], s.out[0] = v, z, flush(z)
            row = s.out.size * INT(n)
            total = 0.0
            for k in range(s.out.size):
                total = fma(p.rows[row + k], s.out[k], total)
            y[i] = total
            n = where(n + 1.0 < p.every, n + 1.0, 0.0)
        return TextureState(s.v, s.y, s.out, n)


@public
def texture(
    speed: Block | float,
    force: Block | float,
    model: TextureModel,
    seed: int,
    stream: int = 0,
    shared: bool = False,
) -> Block:
    """Compute the vibration of a measured surface.

    It is the acceleration that an accelerometer on the tool measured.

    At each sample of the model's own clock (usually every 1 ms) the block finds the
    triangle that contains the speed and the force, interpolates the line spectral
    frequencies, gain and variance between its corners, and advances the resulting ARMA
    model by one step. The model is stable everywhere, because frequencies that are in
    order at the corners are in order between them. The input of the model is scaled
    before it is stored, so a change of speed or force makes no click. Between those
    samples a sinc of 12 taps interpolates, flat within 1 % in power up to 0.356 of the
    model's rate.

    Parameters
    ----------
    speed : Block or float
        Along the surface in m/s; its sign does not count.  From 0 to the lowest speed
        of the model the variance falls to 0.
    force : Block or float
        Normal force in N.  Where it is 0 or below, or nan, as where the speed is, there
        is no vibration.
    model : TextureModel
        From ``load_texture`` or ``stimlib.fitting.texture.fit_texture``.  Beyond its
        largest speed and force it is as there.
    seed, stream : int
        Key of its white noise, of which the samples at the model's clock count.
    shared : bool
        See ``white_noise``.

    Returns
    -------
    Block
        Acceleration in m/s^2, 6 samples of the model late (6 ms); at the model's own
        rate at once.

    Raises
    ------
    BadValue
        A model that is none; a force that is a number below 0; at compile time, a
        sample rate that is no whole multiple of the model's.
    UnitError
        A speed that is not in m/s, a force that is not in N.

    References
    ----------
    Culbertson, Unwin and Kuchenbecker, IEEE Trans. Haptics 7 (2014).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import texture
    >>> from stimlib.design.texture import made_up
    >>> scene = stimlib.Scene(
    ...     {"a": texture(stimlib.Input("v", "m/s"), 1.0, made_up(), seed=1)}
    ... )
    >>> proc = stimlib.compile(scene, fs=8000)
    >>> [
    ...     round(float(proc.process(np.full((1, 16000), v)).std()), 1)
    ...     for v in (0.01, 0.1)
    ... ]  # faster is stronger
    [0.4, 1.1]
    """
    white, v, N = white_noise(seed, stream, shared), with_unit(speed, "m/s"), with_unit(force, "N")
    numbers = (
        model.speed,
        model.force,
        model.triangles,
        model.lsf,
        model.ma,
        model.variance,
        model.gain,
    )
    return Texture(white, v, N, *numbers, model.rate)
