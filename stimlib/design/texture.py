"""Measured textures: ARMA models over speed and force, and their files."""

from __future__ import annotations

import dataclasses as dc
import math
import os
from html import escape
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue, computed, counted, public, said_as, shown
from ..system import safe_files
from ..system.limits import limits
from .filters import PIECE

# Models -----------------------------------------------------------------------------
# Measured textures: ARMA models of the vibration at some speeds and normal forces, and
# what lies between them.
#
# Sources: Romano and Kuchenbecker, "Creating realistic virtual textures from contact
# acceleration data", IEEE Trans. Haptics 5 (2012); Culbertson, Unwin and Kuchenbecker,
# "Modeling and rendering realistic textures from unconstrained tool-surface
# interactions", IEEE Trans. Haptics 7 (2014). Line spectral frequencies: Soong and
# Juang, ICASSP 1984.
# of the interpolator, in samples of the model; of Kaiser's window: flat to 1 % up to
# 0.35
TAPS, BETA = 12, 6.0
ORDER = 64  # the largest, of either polynomial
SIZES = {  # what a model may have, in the units that files have
    "speed": (0.0, 1e5, 1e3, "mm/s"),
    "force": (0.0, 1e4, 1.0, "N"),
    "variance": (0.0, 1e6, 1.0, "(m/s^2)^2"),
    "gain": (0.0, 1e6, 1.0, ""),
}


@dc.dataclass(frozen=True, eq=False)
class TextureModel:
    """ARMA models at points of speed and force, interpolated over a triangulation.

    At model i the acceleration is y = v + sum_k b_k v[-k] - sum_k a_k y[-k] at
    ``rate``, where v is normal with the standard deviation gain sqrt(variance). Between
    models, line spectral frequencies, gain and variance are weighted by the position in
    the triangle.

    Parameters
    ----------
    speed, force : array_like, shape (n,)
        Where each model was measured, in m/s and N.
    triangles : array_like, shape (t, 3)
        Of model numbers from 0, turning either way; they should cover the rectangle
        from 0 to the largest speed and force.
    lsf : array_like, shape (n, p)
        Line spectral frequencies of 1 + sum a_k z^-k, in rad per sample, rising between
        0 and pi: it is stable then.
    ma : array_like, shape (n, q)
        Those of 1 + sum b_k z^-k; q may be 0.
    variance : array_like, shape (n,)
        In (m/s^2)^2.
    gain : array_like, shape (n,)
        Without unit; 1 where a fit has put all into the variance.
    rate : float
        At which the models run, in Hz; 10 or above.
    name : str
    mu : float
        Coefficient of friction, as measured; the vibration does not use it.

    Raises
    ------
    BadValue
        Numbers of another shape, not finite or out of range; frequencies that do not
        rise, which would be unstable; a triangle with a model that is not there, or
        none that has an area.

    Examples
    --------
    >>> from stimlib.design.texture import made_up
    >>> made_up()
    TextureModel(made up: 16 models of order (6, 4), 18 triangles, to 0.15 m/s and
    2.5 N, at 1000 Hz)
    """

    speed: np.ndarray
    force: np.ndarray
    triangles: np.ndarray
    lsf: np.ndarray
    ma: np.ndarray
    variance: np.ndarray
    gain: np.ndarray
    rate: float = 1000.0
    name: str = ""
    mu: float = 0.0

    def __post_init__(self):
        n = np.size(self.speed)
        for name, v in dc.asdict(self).items():
            if name in ("rate", "mu"):
                v = _numbers(name, v, 0)[()]
            elif name != "name":
                v = _numbers(name, v, 2 if name in ("triangles", "lsf", "ma") else 1)
            object.__setattr__(self, name, v)
        if n < 3:
            raise BadValue(f"a texture needs at least 3 models, which make a triangle, and has {n}")
        if not 10 <= self.rate <= 1e6:
            raise BadValue(
                f"the rate of a texture is {self.rate:g} Hz; it must be from 10 to 1e6, and is 1000"
                " as a rule"
            )
        limits.check(
            "table_knots", self.triangles.size + self.lsf.size + self.ma.size, "a texture: numbers"
        )
        for name in ("force", "lsf", "ma", "variance", "gain"):
            if len(getattr(self, name)) != n:
                raise BadValue(
                    f"a texture of {counted(n, 'speed')} has"
                    f" {counted(len(getattr(self, name)), 'row')} of {name}; give"
                    " one for each model"
                )
        for name, (low, high, unit, text) in SIZES.items():
            v = getattr(self, name) * unit
            if ((v < low) | (v > high)).any():
                i = int(np.argmax((v < low) | (v > high)))
                found = f"{v[i]:g} {text}".rstrip()
                raise BadValue(f"model {i + 1}: {name} = {found} must be from {low:g} to {high:g}")
        for name, what in (("lsf", "AR"), ("ma", "MA")):
            self._stable(getattr(self, name), what)
        self._triangles()

    def _stable(self, lsf: np.ndarray, what: str) -> None:
        """Raise BadValue if a polynomial has a root outside the unit circle.

        The check uses its line spectral frequencies.
        """
        least, n = int(what == "AR"), lsf.shape[1]
        if not least <= n <= ORDER:
            raise BadValue(
                f"the {what} part of a texture has {n} line spectral frequencies; it may have"
                f" {least} to {ORDER}"
            )
        rises = np.diff(np.pad(lsf, ((0, 0), (1, 1)), constant_values=((0, 0), (0, np.pi)))) > 0
        if not rises.all():
            i, k = np.argwhere(~rises)[0]
            raise BadValue(
                f"model {i + 1}: {what} line spectral frequency {min(k + 1, n)} ="
                f" {lsf[i, min(k, n - 1)]:g} rad does not rise between 0 and pi, so the model would"
                " be unstable; fit it again, or remove it"
            )

    def _triangles(self) -> None:
        t, n = self.triangles, len(self.speed)
        if t.shape[1:] != (3,) or not len(t):
            raise BadValue(
                f"triangles of a texture must be rows of three model numbers, got shape {t.shape}"
            )
        bad = ((t < 0) | (t >= n) | (t != np.floor(t))).any(axis=1)
        if bad.any():
            i = int(np.argmax(bad))
            of = " ".join(f"{v + 1:g}" for v in t[i])
            raise BadValue(
                f"triangle {i + 1}, of the models {of}: the models are numbered 1 to {n}"
            )
        if not (self.speed.max() > 0 and self.force.max() > 0):
            raise BadValue(
                "all models of a texture are at speed 0 or at force 0; some must be above 0"
            )
        self.planes()

    def planes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the weights of models as planes over speed and force, by triangle.

        Triangles without an area contain no point and are left out.

        Returns
        -------
        planes : ndarray, shape (t, 3, 3)
            The weight of corner i of triangle k at (speed, force) is planes[k, i] @
            (speed/largest, force/largest, 1).
        corners : ndarray of int, shape (t, 3)
        """
        place = np.stack(
            [
                self.speed / self.speed.max(),
                self.force / self.force.max(),
                np.ones(len(self.speed)),
            ],
            axis=-1,
        )
        corners = self.triangles.astype(int)
        one, two = (place[corners[:, k], :2] - place[corners[:, 0], :2] for k in (1, 2))
        area = one[:, 0] * two[:, 1] - two[:, 0] * one[:, 1]  # twice
        some = np.abs(area) > 1e-9
        if not some.any():
            raise BadValue(
                "no triangle of the texture has an area; join models that do not lie on one line"
            )
        return np.linalg.inv(place[corners[some]]).transpose(0, 2, 1), corners[some]

    def weights(self, speed: float, force: float) -> np.ndarray:
        """Return the weight of each model at a speed in m/s and a force in N.

        Outside the measured rectangle they are those at its border.

        Examples
        --------
        >>> from stimlib.design.texture import made_up
        >>> w = made_up().weights(0.04, 0.5)
        >>> {int(i): round(float(w[i]), 3) for i in w.nonzero()[0]}
        {5: 0.5, 9: 0.214, 10: 0.286}
        """
        planes, corners = self.planes()
        x, y = (
            float(np.clip(v, 0, top.max()) / top.max())
            for v, top in ((speed, self.speed), (force, self.force))
        )
        of = planes @ (x, y, 1.0)
        k = int(np.argmax(of.min(axis=1)))  # the triangle that holds it, or is nearest
        inside = np.maximum(of[k], 0.0)
        w = np.zeros(len(self.speed))
        np.add.at(w, corners[k], inside / inside.sum())
        return w

    def at(self, speed: float, force: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the interpolated model at a speed in m/s and a force in N.

        Returns
        -------
        b, a : ndarray
            Numerator and denominator in powers of 1/z, each beginning with 1.
        deviation : float
            Of what drives them, in m/s^2.

        Examples
        --------
        >>> from stimlib.design.texture import made_up
        >>> b, a, deviation = made_up().at(0.1, 1.0)
        >>> b.size, a.size, round(deviation, 3)
        (5, 7, 1.033)
        """
        w = self.weights(speed, force)
        return (
            polynomial(w @ self.ma),
            polynomial(w @ self.lsf),
            float(w @ self.gain * np.sqrt(w @ self.variance)),
        )

    def psd(self, f: np.ndarray, speed: float, force: float) -> np.ndarray:
        """Return the one-sided PSD at frequencies in Hz, in (m/s^2)^2/Hz.

        The frequencies must be below half the model's rate.

        Examples
        --------
        >>> import numpy as np
        >>> from stimlib.design.texture import made_up
        >>> made_up().psd(np.array([100.0, 400.0]), 0.1, 1.0).round(4)
        array([0.0125, 0.0038])
        """
        b, a, deviation = self.at(speed, force)
        z = np.exp(-2j * np.pi * np.asarray(f) / self.rate)
        H = np.polynomial.polynomial.polyval(z, b) / np.polynomial.polynomial.polyval(z, a)
        return 2 / self.rate * deviation**2 * np.abs(H) ** 2

    def __repr__(self):
        order = f"({self.lsf.shape[1]}, {self.ma.shape[1]})"
        models = (
            f"{counted(len(self.speed), 'model')} of order {order},"
            f" {counted(len(self.triangles), 'triangle')}"
        )
        most = f"{self.speed.max():g} m/s and {self.force.max():g} N"
        return f"TextureModel({self.name or 'no name'}: {models}, to {most}, at {self.rate:g} Hz)"


def _numbers(name: str, v: object, dimensions: int) -> np.ndarray:
    """Return finite numbers as a read-only array."""
    try:
        a = np.array(v, np.float64)
    except (TypeError, ValueError):
        a = np.array(np.nan)
    if a.ndim != dimensions or not np.isfinite(a).all():
        at = (
            f"; model {int(np.argwhere(~np.isfinite(a))[0][0]) + 1} is not"
            if a.ndim == dimensions > 0
            else ""
        )
        raise BadValue(
            f"{name} of a texture must be {('a number', 'a row', 'rows')[dimensions]} of finite"
            f" numbers{at}"
        )
    a.flags.writeable = False
    return a


# Line spectral frequencies ------------------------------------------------------------
def polynomial(lsf: np.ndarray) -> np.ndarray:
    """Return a polynomial 1 + sum a_k z^-k from its line spectral frequencies.

    It multiplies out the roots, which are all on the unit circle.

    P(z) = A(z) + z^-(p+1) A(1/z) has the frequencies 1, 3, .. and Q(z), their
    difference, has 2, 4, ..; A = (P + Q)/2.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.design.texture import frequencies, polynomial
    >>> polynomial(frequencies(np.array([1.0, -0.9, 0.5]))).round(12)
    array([ 1. , -0.9,  0.5])
    """
    p, lsf = len(lsf), scattered(lsf)
    halves = []
    for own, sign in ((lsf[::2], 1.0), (lsf[1::2], -1.0)):
        whole = np.array([1.0])
        for f in own:
            whole = np.convolve(whole, [1.0, -2 * np.cos(f), 1.0])
        fixed = [1.0, sign] if p % 2 == 0 else [1.0, 0.0, -1.0] if sign < 0 else [1.0]
        halves.append(np.convolve(whole, fixed))
    return (halves[0] + halves[1])[: p + 1] / 2


def scattered(lsf: np.ndarray) -> np.ndarray:
    """Return line spectral frequencies in the order in which to multiply out roots.

    Each of P and Q keeps its own. Products of roots on one side of the circle have
    coefficients up to 2^p, of which the whole product keeps few digits; so from 11
    frequencies of one polynomial on, each is far from the last ones.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.design.texture import scattered
    >>> scattered(np.arange(22.0))[::2]
    array([ 0., 14.,  6., 20., 12.,  4., 18., 10.,  2., 16.,  8.])
    """
    found = lsf.copy()
    for half in (found[..., ::2], found[..., 1::2]):
        if (n := half.shape[-1]) > 10:
            step = next(s for s in range(round(0.618 * n), n) if math.gcd(s, n) == 1)
            half[...] = half[..., np.arange(n) * step % n]
    return found


def frequencies(a: np.ndarray) -> np.ndarray:
    """Return the line spectral frequencies of a polynomial 1 + sum a_k z^-k.

    They are in rad per sample.

    Raises
    ------
    BadValue
        A root outside of the unit circle, or on it.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.design.texture import frequencies
    >>> frequencies(np.array([1.0, 0.0, 0.0])).round(4)  # of 1 they are spread evenly
    array([1.0472, 2.0944])
    """
    a = np.atleast_1d(a) / np.atleast_1d(a)[0]
    radius = float(np.abs(np.roots(a)).max(initial=0.0))
    if not radius < 1:
        raise BadValue(
            f"a root of the polynomial has the radius {radius:.6g}; it must be below 1 to be stable"
        )
    p = a.size - 1
    found = []
    for sign in (1.0, -1.0):
        half = np.r_[a, 0.0] + sign * np.r_[0.0, a[::-1]]
        fixed = [1.0, sign] if p % 2 == 0 else [1.0, 0.0, -1.0] if sign < 0 else [1.0]
        angles = np.angle(np.roots(np.polydiv(half, fixed)[0]))
        found.append(angles[angles > 0])
    return np.sort(np.concatenate(found))


def upsampler(times: int) -> np.ndarray:
    """Return interpolator taps that raise a rate by an integer and keep the samples.

    They are a sinc in a Kaiser window over 12 samples.

    Returns
    -------
    ndarray, shape (times, 12)
        Output m of an input sample is the sum of row m times the last 12 inputs, the
        newest first; 6 inputs late.  Each row adds up to 1.  Where the rate stays,
        nothing is late.

    Notes
    -----
    Its power is flat within 1 % up to 0.356 of the lower rate, a quarter at the half of
    it, and below -50 dB from 0.65 on.

    Examples
    --------
    >>> from stimlib.design.texture import upsampler
    >>> h = upsampler(8)
    >>> h.shape, h[0, 6], h[4].round(3)[:6]
    ((8, 12), np.float64(1.0), array([-0.003,  0.012, -0.033,  0.078, -0.178,  0.625]))
    """
    if times == 1:
        return np.eye(1, TAPS)
    limits.check(
        "state_bytes",
        32.0 * TAPS * times,
        f"texture: bytes to raise its rate {times} times (choose a lower fs)",
    )
    h = np.empty((times, TAPS))
    for i in range(0, times, PIECE):
        # from the output to each input
        t = np.arange(i, min(i + PIECE, times))[:, None] / times + np.arange(TAPS) - TAPS / 2
        part = (
            np.sinc(t) * np.i0(BETA * np.sqrt(np.maximum(1 - (2 * t / TAPS) ** 2, 0))) / np.i0(BETA)
        )
        h[i : i + PIECE] = part / part.sum(axis=1, keepdims=True)
    return h


@public
@computed
def made_up(
    pairs: int = 3,
    speeds: ArrayLike = (0.0, 0.02, 0.06, 0.15),
    forces: ArrayLike = (0.0, 0.3, 1.0, 2.5),
    rate: float = 1000.0,
) -> TextureModel:
    """Make an invented texture model for tests, examples and the scene.

    It is not measured from any surface.

    Its resonances rise with speed and widen with force; its variance is their product.

    Parameters
    ----------
    pairs : int
        Of poles, 1 to 16: a radius of more would be below 0. There is a pair of zeros
        less.
    speeds, forces : sequence of float
        A grid of models, rising from 0, in m/s and N.
    rate : float
        Hz.

    Examples
    --------
    See ``TextureModel``.
    """
    if not 1 <= pairs <= 16 or any(np.ndim(v) != 1 or np.size(v) < 2 for v in (speeds, forces)):
        raise BadValue(
            f"made_up: pairs = {pairs} must be from 1 to 16, and speeds and forces lists of two"
            " numbers or more"
        )
    speed, force = (v.ravel() for v in np.meshgrid(speeds, forces, indexing="ij"))
    x, y = speed / speed.max(), force / force.max()
    k = np.arange(pairs)

    def rows(at: np.ndarray, radius: np.ndarray) -> np.ndarray:
        roots = radius * np.exp(2j * np.pi * at / rate)
        return np.array([frequencies(np.poly(np.r_[r, r.conj()]).real) for r in roots]).reshape(
            len(roots), -1
        )

    low = rate / 2 * (k + 0.5 + 0.4 * x[:, None]) / (pairs + 0.5)
    poles = rows(low, 0.95 - 0.15 * y[:, None] - 0.05 * k)
    zeros = rows(low[:, 1:] - rate / 4 / (pairs + 0.5), np.full((speed.size, pairs - 1), 0.7))
    n = np.size(forces)
    cells = [i * n + j for i in range(np.size(speeds) - 1) for j in range(n - 1)]
    # turning both ways
    triangles = [t for c in cells for t in ((c, c + n, c + n + 1), (c, c + 1, c + n + 1))]
    return TextureModel(
        speed,
        force,
        np.array(triangles),
        poles,
        zeros,
        4.0 * x * y,
        np.ones(x.size),
        rate,
        "made up",
        0.3,
    )


# Files in the XML form of the Penn Haptic Texture Toolkit ---------------------------
# Files of measured textures, in the XML form of the Penn Haptic Texture Toolkit: read
# as data, and written.
#
# Source: Culbertson, Lopez Delgado, Kuchenbecker, "One hundred data-driven haptic
# texture models and open-source methods for rendering on 3D objects", IEEE Haptics
# Symposium 2014. Python's own parser (expat) is enough, for nothing is asked of a file
# but elements and their text: a document type, which alone could define entities, ends
# it.
LONGEST = 200  # letters of a name
# elements of a model that have values, and what they are here
LISTS = {"ARlsf": "lsf", "MAlsf": "ma"}
NUMBERS = {"speedMod": "speed", "forceMod": "force", "var": "variance", "gain": "gain"}
OPTIONAL: dict[str, list[float]] = {"MAlsf": [], "gain": [1.0]}


class _Reader:
    """The values of a file by element name: once for the whole, and for each model."""

    def __init__(self, file: str):
        self.file = file
        self.whole: dict[str, Any] = {}
        self.models: list[dict[str, Any]] = []
        self.triangles: list[list[float]] = []
        self.way: list[str] = []
        self.text: list[str] = []
        self.count = 0
        # whatever it declares: no other codec is looked up
        self.parser = expat.ParserCreate("utf-8")
        self.parser.StartElementHandler, self.parser.EndElementHandler = self.start, self.end
        self.parser.CharacterDataHandler = self.text.append
        self.parser.StartDoctypeDeclHandler = self.document_type

    def refuse(self, why: str) -> None:
        raise BadValue(f"{self.file}, line {self.parser.CurrentLineNumber}: {why}")

    def document_type(self, *_):
        self.refuse(
            "it has a document type (<!DOCTYPE ..>), which could define entities: take that"
            " line out"
        )

    def start(self, name: str, _):
        if not self.way and name != "modelSet":
            self.refuse(f"it begins with <{name[:40]}>, and a texture with <modelSet>")
        self.way.append(name)
        self.text.clear()
        if self.way == ["modelSet", "model"]:
            self.models.append({})
        elif self.way == ["modelSet", "tri"]:
            self.triangles.append([])

    def end(self, name: str):
        text = "".join(self.text).strip()
        self.text.clear()
        match self.way:
            case ["modelSet", "tri", "value"]:
                self.triangles[-1].append(self.number(text))
            case ["modelSet", "model", of, "value"] if of in LISTS:
                self.models[-1].setdefault(of, []).append(self.number(text))
            case ["modelSet", "model", of] if of in LISTS:
                self.models[-1].setdefault(of, [])
            case ["modelSet", "model", of] if of in NUMBERS:
                self.models[-1][of] = [self.number(text)]
            case ["modelSet", "SampleRate" | "mu" as of]:
                self.whole[of] = self.number(text)
            case ["modelSet", "material"]:
                self.whole["material"] = text[:LONGEST]
        self.way.pop()

    def number(self, text: str) -> float:
        self.count += 1
        limits.check("table_knots", self.count, f"{self.file}: numbers")
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            self.refuse(f"{text[:40]!r} in <{self.way[-1]}> is not a finite number")
        return value


@public
def load_texture(path: str | os.PathLike[str]) -> TextureModel:
    """Load a measured texture from a file.

    The file is one of the Penn Haptic Texture Toolkit, or one that ``save_texture``
    wrote.

    The file is data, read within ``stimlib.limits``: at most ``sidecar_bytes``, and
    ``table_knots`` numbers. It uses ``<SampleRate>``, ``<material>``, ``<mu>``, each
    ``<tri>``, and of each ``<model>`` its ``<ARlsf>``, ``<MAlsf>``, ``<var>``,
    ``<gain>``, ``<speedMod>`` and ``<forceMod>``. The coefficients repeat what the
    frequencies say, and are not used.

    Parameters
    ----------
    path : str or Path
        Speeds in mm/s, forces in N, variances in (m/s^2)^2; triangles count models from
        1.

    Returns
    -------
    TextureModel
        In m/s.

    Raises
    ------
    BadValue
        No regular file, or a larger one than the limits allow; no XML, or one with a
        document type; an element that is missing; a number that is none, or out of
        range; frequencies of an unstable model; triangles of models that are not there.
        It names the file, and the line or the model.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from stimlib.blocks import load_texture, save_texture
    >>> from stimlib.design.texture import made_up
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "invented.xml"
    >>> save_texture(made_up(), path)
    >>> load_texture(path)
    TextureModel(made up: 16 models of order (6, 4), 18 triangles, to 0.15 m/s and
    2.5 N, at 1000 Hz)
    """
    file = os.fspath(path)
    reader = _Reader(str(file))
    with said_as(BadValue, f"{file}: not XML", expat.ExpatError):
        reader.parser.Parse(safe_files.read(file, "sidecar_bytes", BadValue), True)
    with said_as(BadValue, file, BadValue):
        return _model(reader)


def _model(r: _Reader) -> TextureModel:
    if "SampleRate" not in r.whole:
        raise BadValue(
            "it has no <SampleRate>; add the rate of its models in Hz, such as"
            " <SampleRate>1000</SampleRate>"
        )
    if not r.models:
        raise BadValue("it has no <model>")
    found = {
        field: [m.get(name, OPTIONAL.get(name)) for m in r.models]
        for name, field in (LISTS | NUMBERS).items()
    }
    for name, field in (LISTS | NUMBERS).items():
        for i, row in enumerate(found[field]):
            if row is None:
                raise BadValue(f"model {i + 1} has no <{name}>")
            if len(row) != (n := len(found[field][0] or [])):
                raise BadValue(
                    f"model {i + 1} has {counted(len(row), 'value')} in <{name}>, and model 1 {n}:"
                    " all need one order"
                )
    for i, t in enumerate(r.triangles):
        if len(t) != 3:
            raise BadValue(f"triangle {i + 1} has {len(t)} model numbers instead of 3")
    number = {
        field: np.array([row[0] for row in found[field] if row]) for field in NUMBERS.values()
    }
    number["speed"] = number["speed"] / 1e3
    whole = r.whole
    return TextureModel(
        triangles=np.reshape(r.triangles, (-1, 3)) - 1,
        lsf=np.array(found["lsf"]),
        ma=np.array(found["ma"]),
        rate=whole["SampleRate"],
        name=whole.get("material", ""),
        mu=whole.get("mu", 0.0),
        **number,
    )


@public
def save_texture(model: TextureModel, path: str | os.PathLike[str]) -> None:
    """Write a measured texture atomically, in the form that ``load_texture`` reads.

    Every number keeps all its digits, except for the conversion to mm/s.

    Parameters
    ----------
    model : TextureModel
    path : str or Path

    Raises
    ------
    BadValue
        The place cannot be written.

    Examples
    --------
    See ``load_texture``.
    """

    def values(name: str, row) -> str:
        return (
            f'<{name} type="array">'
            + "".join(f"<value>{v!r}</value>" for v in np.asarray(row).tolist())
            + f"</{name}>"
        )

    def number(name: str, v) -> str:
        return f"<{name}>{float(v)!r}</{name}>"

    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        "<modelSet>",
        f"<material>{escape(shown(model.name), quote=False)}</material>",
    ]
    lines += [number("SampleRate", model.rate), number("mu", model.mu)]
    lines += [number("maxSpeed", 1e3 * model.speed.max()), number("maxForce", model.force.max())]
    lines += [values("tri", t.astype(int) + 1) for t in model.triangles]
    for i in range(len(model.speed)):
        numbers = {
            "speedMod": 1e3 * model.speed[i],
            "forceMod": model.force[i],
            "var": model.variance[i],
            "gain": model.gain[i],
        }
        lists = values("ARlsf", model.lsf[i]) + values("MAlsf", model.ma[i])
        lines.append(
            "<model>"
            + number("modNum", i + 1)
            + lists
            + "".join(number(n, v) for n, v in numbers.items())
            + "</model>"
        )
    safe_files.publish(path, "\n".join([*lines, "</modelSet>", ""]), BadValue)
