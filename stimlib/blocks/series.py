"""A springpot in series with a spring or a dashpot.

They have one force, and two displacements that add up.
"""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from ..core import units as un
from ..core.graph import Block, as_block, scratch
from ..core.maths import fir, fma, memory, where
from ..core.response import backward
from ..design import responses
from ..errors import Above0, BadValue, public
from .springpots import (
    DIFFERENCES,
    WORK,
    Springpot,
    begin,
    check_fields,
    force_unit,
    transfer,
)

# Parameters of `Series` at a sample rate.
#   e        of the springpot, see fractional.SpringpotParams
#   pot      chi fs^alpha
#   newest   v_0
#   other    k, or b fs
#   dashpot  1: the other element is a dashpot
SeriesParams = namedtuple("SeriesParams", "e r taps constant pot newest other dashpot alpha fs")


# State of `Series` between samples.
#   line  the springpot's last nine displacements
#   last  y
SeriesState = namedtuple("SeriesState", "line q low first last cold")


@dataclass(frozen=True, eq=False)
class Series(Block):
    """A springpot in series with a spring or a dashpot.

    f = chi D^alpha z = k (y - z), or b d(y - z)/dt. The springpot's displacement z is
    solved for at every sample.

    With u = y[n] - z[n-1] (spring) or y[n] - y[n-1] (dashpot), g = k or b fs, S = chi
    fs^alpha, and R the springpot's sum without its newest step d = z[n] - z[n-1]:
    g (u - d) = S (v_0 d + R), so d = (g u - S R)/(g + S v_0).
    """

    y: Block
    contact: Block
    other: Above0
    dashpot: bool
    chi: Above0
    order: float
    scheme: str
    tol: float
    horizon: Above0
    begins_early = False
    resettable = True

    def check(self):
        check_fields(self)
        if self.order in (0.0, 1.0):
            raise BadValue(
                f"series: alpha = {self.order:g} is a spring or a dashpot; use maxwell(y, k, b),"
                " spring or kelvin_voigt"
            )

    def units(self, *u: un.Unit) -> un.Unit:
        return force_unit("series", u[0])

    def design(self, fs):
        p, s = Springpot(
            self.y, self.contact, self.order, self.scheme, self.tol, self.horizon, "steady"
        ).design(fs)
        other = self.other * (fs if self.dashpot else 1.0)
        numbers = (
            self.chi * math.pow(fs, self.order),
            p.taps[7],
            other,
            float(self.dashpot),
            self.order,
            fs,
        )
        return SeriesParams(p.e, p.r, p.taps, p.constant, *numbers), SeriesState(
            s.line, s.q, s.low, 0.0, 0.0, 1.0
        )

    def laws(self, fs):
        if self.horizon * fs < responses.SHORTEST:
            return ()
        return (
            responses.series(
                self.chi,
                self.order,
                self.other,
                self.dashpot,
                self.scheme,
                self.tol,
                self.horizon,
                fs,
            ),
        )

    work = scratch(WORK + 512)

    @staticmethod
    def tile(p, s, x, y, w):
        first, last = begin(s, x[0]), where(s.cold > 0.0, x[0], s.last)
        d, near, far = w[DIFFERENCES : DIFFERENCES + 9], w[0:1], w[1:2]
        for i in range(x.size):
            for j in range(8):
                d[j] = s.line[j + 1] - s.line[j]
            d[8] = 0.0
            memory(p.e, p.r, s.q, s.low, d[0:1], far, w[WORK:])
            fir(p.taps, d[1:9], near)
            rest = fma(p.constant, s.line[1] - first, near[0] + far[0])
            u = where(p.dashpot > 0.0, x[i] - last, x[i] - s.line[8])
            step = (p.other * u - p.pot * rest) / (p.other + p.pot * p.newest)
            z = s.line[8] + step
            for j in range(8):
                s.line[j] = s.line[j + 1]
            s.line[8] = z
            y[i] = p.pot * fma(p.newest, step, rest)
            last = x[i]
        return SeriesState(s.line, s.q, s.low, first, last, 0.0)

    @staticmethod
    def transfer(p, z):
        pot = transfer(p, p.alpha, p.pot, p.taps, p.constant, p.r, z)
        other = p.other * backward(z) if p.dashpot > 0 else p.other * np.ones_like(z)
        return pot * other / (pot + other)


@public
def springpot_series(
    y: Block,
    chi: float,
    alpha: float,
    k: float | None = None,
    b: float | None = None,
    scheme: str = "l1",
    tol: float = 1e-10,
    horizon: float = 86400.0,
    contact: Block | float = 1.0,
) -> Block:
    """Compute a springpot in series with a spring or a dashpot.

    With a spring it is the fractional Maxwell arm.

    Parameters
    ----------
    y : Block
        Displacement over both elements, in m; it always begins steady: relaxed at the
        first sample, wherever that is.
    chi : float
        Springpot, N s^alpha/m, above 0.
    alpha : float
        Its order, above 0 and below 1.
    k, b : float
        Either the spring's stiffness in N/m, or the dashpot's damping in N s/m.
    scheme, tol, horizon
        See ``springpot``.
    contact : Block
        Where it is not above 0 the force is 0; at re-contact the arm is relaxed.

    Returns
    -------
    Block
        Force in N.

    Raises
    ------
    BadValue
        Both or none of k and b; a number out of range.

    Notes
    -----
    The inner displacement is found implicitly at every sample, so every k, b and chi is
    stable.  Under a prescribed force no such block is needed: displacements in series
    add, ``f / k + compliance(f, chi, alpha)``.

    References
    ----------
    Çaldıran's thesis, section 2.2; the relaxation of spring and springpot is k
    E_alpha(-(k/chi) t^alpha).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import springpot_series
    >>> arm = springpot_series(stimlib.Input("y", "m"), chi=100.0, alpha=0.5, k=1000.0)
    >>> f = stimlib.compile(stimlib.Scene({"f": arm}), fs=8000).process(
    ...     np.r_[0.0, np.full(7999, 0.01)][None]
    ... )[0]
    >>> bool(9.0 < f[1] < 10.0) and bool(
    ...     f[-1] < 1.0
    ... )  # the spring gives way to the springpot
    True
    """
    if (k is None) == (b is None):
        raise BadValue("springpot_series: give either k (a spring) or b (a dashpot)")
    other = k if k is not None else b
    assert other is not None
    return Series(
        as_block(y), as_block(contact), other, b is not None, chi, alpha, scheme, tol, horizon
    )
