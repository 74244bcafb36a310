"""Banks of first-order modes: recursive LTI filters in parallel form, and pink noise
made with one.

The parallel form is exact to 1e-13 where multiplied-out sections lose 3-4 digits, and
every mode is independent of the others. A pole near 1 keeps its leak 1 - p to 2^-53/(1
- p): far better than a spectrum needs.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.graph import Block, positive
from ..core.maths import modes
from ..core.response import backward
from ..design import responses
from ..design.eights import padded
from ..design.minimax import asked_by
from ..design.pink import pink_modes, stationary_factor
from ..errors import public
from .noise import White, noise_key, normals


class ModesParams(NamedTuple):
    p: np.ndarray  # poles; padded with zeros to a multiple of 8
    r: np.ndarray  # residues; padded with zeros
    d: float  # direct


class ModesState(NamedTuple):
    q: np.ndarray


class Modes(Block, abstract=True):
    """q_k = p_k q_k + x;  y = d x + sum_k r_k q_k."""

    @staticmethod
    def work(p):
        return 512

    @staticmethod
    def tile(p, s, x, y, w):
        modes(p.p, p.r, s.q, p.d, x, y, w)
        return s

    @staticmethod
    def transfer(p, z):
        z = z[..., None]
        return p.d + np.sum(p.r / (backward(z) + (1 - p.p) / z), axis=-1)


def bank(e: np.ndarray, r: np.ndarray, d: float) -> tuple[ModesParams, ModesState]:
    """Parameters and rest state of a bank, padded to whole groups of eight."""
    p = padded(1.0 - e)
    return ModesParams(p, padded(r), float(d)), ModesState(np.zeros(p.size))


@dataclass(frozen=True, eq=False)
class Pinking(Modes):
    """|H(f)|^2 = fs / (2 pi f) from f_low to 0.45 fs, within tol_db."""

    x: Block
    f_low: float
    tol_db: float

    def check(self):
        positive(self, "f_low", "tol_db")

    def design(self, fs):
        with asked_by("pinking"):
            m = pink_modes(fs, self.f_low, self.tol_db)
        return bank(m.e, m.r, m.d)

    def laws(self, fs):
        return (responses.pinking(self.f_low, self.tol_db),)


@public
def pinking(x: Block, f_low: float = 1.0, tol_db: float = 0.01) -> Block:
    """Run the 3 dB/oct low-pass H, |H|^2 = 1/w with w = 2 pi f / fs; before the first
    sample x was 0.

    Parameters
    ----------
    x : Block
    f_low : float
        Lower edge of the band in Hz; the upper edge is 0.45 fs.
    tol_db : float
        Largest deviation inside the band, in dB; it sets the number of sections.

    Returns
    -------
    Block
        In the unit of x.

    Raises
    ------
    BadValue
        f_low or tol_db not above 0; at compile time, a band or a tolerance that cannot
        be met.

    References
    ----------
    The UGrip paper, section 1.1: "a 3 dB/octave lowpass filter H(s)".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import pinking
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"p": pinking(stimlib.Input("n"))}), fs=8000
    ... )
    >>> h = abs(proc.response("p", "n", np.array([10.0, 20.0])))
    >>> (20 * np.log10(h[0] / h[1])).round(1)
    np.float64(3.0)
    """
    return Pinking(x, f_low, tol_db)


@dataclass(frozen=True, eq=False)
class PinkNoise(Modes):
    """White noise through the 3 dB/oct filter, started in its stationary state: S(f) =
    psd_1hz / f.
    """

    white: Block
    psd_1hz: float
    f_low: float
    tol_db: float

    def check(self):
        positive(self, "psd_1hz", "f_low", "tol_db")

    def design(self, fs):
        with asked_by("pink_noise"):
            m = pink_modes(fs, self.f_low, self.tol_db)
        gain = math.sqrt(math.pi * self.psd_1hz)  # white of sigma = sqrt(pi S1), at any fs
        return bank(m.e, gain * m.r, gain * m.d)

    def start(self, p, s, seed, normals=normals):
        """q ~ N(0, P), P_ij = 1/(e_i + e_j - e_i e_j), drawn under a key of its own."""
        if not isinstance(self.white, White):
            return s
        L = stationary_factor((1.0 - p.p[p.r != 0]).tobytes())
        g = normals(noise_key(seed, *self.white.noise_key, 1), len(L)).tolist()
        q = np.zeros(s.q.size)
        q[: len(L)] = [math.fsum(map(operator.mul, row, g)) for row in L]
        return ModesState(q)

    def laws(self, fs):
        return (responses.pink_noise(self.psd_1hz, self.f_low, self.tol_db),)


@public
def pink_noise(
    psd_1hz: float,
    seed: int,
    stream: int = 0,
    f_low: float = 1.0,
    tol_db: float = 0.01,
    shared: bool = False,
) -> Block:
    """Pink noise with one-sided PSD S(f) = psd_1hz / f units^2/Hz, stationary from the
    first sample on.

    Parameters
    ----------
    psd_1hz : float
        S at 1 Hz, in units^2/Hz.
    seed, stream : int
        Key of its white noise.
    f_low : float
        Lower edge in Hz; the spectrum is flat below.  The upper edge is 0.45 fs.
    tol_db : float
        Largest deviation inside the band in dB.
    shared : bool
        See ``white_noise``.

    Returns
    -------
    Block
        Without unit.

    Raises
    ------
    BadValue
        psd_1hz, f_low or tol_db not above 0; at compile time, a band or a tolerance
        that cannot be met.

    References
    ----------
    The UGrip paper, section 1.1: p(s) = H(s) n(s), S(f) ~ 1/f.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import pink_noise
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"p": pink_noise(psd_1hz=1.0, seed=3)}), fs=8000
    ... )
    >>> proc.process(np.empty((0, 4))).shape
    (1, 4)
    """
    return PinkNoise(White(seed, stream, shared), psd_1hz, f_low, tol_db)
