"""The springpot as researchers call it: one function for every scheme and kind of
order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..core import units as un
from ..core.graph import Block, Const, Map, as_block
from ..core.maths import where
from ..design import exponentials as soe
from ..errors import BadValue, UnitError, public
from .fractional import METHODS, Accuracy, PathLength, Springpot, SpringpotLive
from .thesis import Downsampled, ShortMemory

NAN = math.nan


@dataclass(frozen=True, eq=False)
class NotBelowZero(Map):
    """x, or nan where x < 0: the guard of the output then ends the stimulus."""

    x: Block

    @staticmethod
    def step(p, s, x):
        return where(x >= 0.0, x, NAN), s


@public
def springpot(
    y: Block | float,
    chi: Block | float,
    alpha: Block | float,
    scheme: str = "gl",
    tol: float = 1e-10,
    horizon: float = 86400.0,
    onset: str = "steady",
    contact: Block | float | None = None,
    certificate: bool = False,
    memory: float = 0.1,
):
    """Force of a springpot, f = chi D^alpha y, over the whole history of y.

    Parameters
    ----------
    y : Block
        Displacement in m (a number without unit gives a force without unit).
    chi : float or Block
        Coefficient in N s^alpha/m, as a plain number; live when it is a signal.  Not
        below 0: a live value below 0 is a fault.
    alpha : float or Block
        Order from 0 (spring, bit for bit chi (y - y[0])) to 1 (dashpot, bit for bit chi
        (y[n] - y[n-1]) fs); live when it is a signal.  A live value outside is a fault.
        A change acts as if it had been so from the start; a jump of alpha is a jump of
        force, so ramp it.
    scheme : {"gl", "l1", "gl-downsampled", "gl-short-memory"}
        ``gl``: Gruenwald-Letnikov, first order in 1/fs.  ``l1``: exact for straight
        lines between samples, order 2 - alpha; recommended.  The other two are the
        thesis' methods, for comparison; there alpha is a plain number.
    tol : float
        |error[n]| <= tol chi fs^alpha sum_j v_j |d[n-j]| against the full sum of the
        scheme; from 1e-14 to 0.1.
    horizon : float
        Seconds of contact up to which tol is kept.  Beyond, the error grows slowly.
        With ``gl-downsampled``, the longest contact: beyond it there is a fault.
    onset : {"steady", "step"}
        Whether the first sample is where y has always been, or a step from 0.
    contact : Block, optional
        Where it is not above 0 the force is 0; at re-contact the history starts anew,
        at rest.
    certificate : bool
        Also return the bound on the error, as a second signal.
    memory : float
        Seconds that ``gl-short-memory`` sums; the thesis' 100 samples at 1 kHz are 0.1
        s.

    Returns
    -------
    Block, or (Block, Block) with ``certificate=True``
        Force in N, and the bound on its error in N.

    Raises
    ------
    BadValue
        alpha outside 0 .. 1, chi below 0, tol outside 1e-14 .. 0.1 (the message names
        the nearest possible one), horizon or memory not above 0, an unknown scheme or
        onset; a live alpha or a certificate with the thesis' methods; at compile time,
        a horizon too long for ``gl-downsampled``.
    UnitError
        y in another unit than m, chi or alpha with a unit.

    Notes
    -----
    tol speaks of the sum over the history, against the scheme's own full sum.  How near
    that is to the continuous derivative is a matter of the sample rate.

    References
    ----------
    Çaldıran's thesis, section 2.2, and eq. (3.1).

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import springpot
    >>> y = stimlib.Input("y", "m")
    >>> proc = stimlib.compile(
    ...     stimlib.Scene({"f": springpot(y, chi=100.0, alpha=0.5, scheme="l1")}),
    ...     fs=1000,
    ... )
    >>> t = np.arange(1000) / 1000
    >>> f = proc.process(0.1 * t[None])[0]  # 0.1 m/s
    >>> bool(np.allclose(f, 100 * 0.1 * 2 * np.sqrt(t / np.pi), rtol=1e-9))
    True
    >>> proc.units["f"]
    'N'
    """
    y, alpha = as_block(y), as_block(alpha)
    touch = as_block(1.0 if contact is None else contact)
    fixed = alpha.value if isinstance(alpha, Const) and alpha.dim == un.ONE else None
    if scheme not in METHODS:
        raise BadValue(f"springpot: scheme = {scheme!r}; choose one of {', '.join(METHODS)}")
    gain = coefficient(chi)
    if scheme in soe.SCHEMES:

        def part(signal):
            if fixed is not None:
                return Springpot(signal, touch, fixed, scheme, tol, horizon, onset)
            return SpringpotLive(signal, alpha, touch, scheme, tol, horizon, onset)

        force = gain * part(y)
        if not certificate:
            return force
        return force, gain * (Accuracy(alpha, tol, horizon) * part(PathLength(y, touch, onset)))
    if certificate:
        raise BadValue(
            f"springpot: there is no bound on the error of {scheme}; certificate=True needs gl"
            " or l1"
        )
    if fixed is None:
        raise BadValue(
            f"springpot: {scheme} needs a plain number as alpha, got {alpha!r}; gl and l1 take a"
            " live one"
        )
    if scheme == "gl-downsampled":
        return gain * Downsampled(y, touch, fixed, horizon, onset)
    return gain * ShortMemory(y, touch, fixed, memory, onset)


def coefficient(chi, name: str = "springpot") -> Block:
    """Return chi as a signal without unit that is nan below 0; name is the function
    that an error names.
    """
    b = as_block(chi)
    if b.dim != un.ONE:
        raise UnitError(
            f"{name}: chi {b!r} is in {b.dim}; give a plain number in N s^alpha/m, as alpha may"
            " change"
        )
    if isinstance(b, Const):
        if b.value < 0:
            raise BadValue(f"{name}: chi = {b.value:g} must not be below 0")
        return b
    return NotBelowZero(b)
