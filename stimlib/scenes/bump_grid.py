"""Haptic bumps on a touch screen along x, along y, or in both directions.

Source: the touch-screen thesis, chapters 3 and 4, and its future work in chapter 7.
"""

from __future__ import annotations

import numpy as np

from ..blocks import bump, carrier
from ..core.graph import Input, constant
from ..core.parameter import Param
from ..core.pointwise import nonzero
from ..core.scene import Scene
from ..errors import BadValue
from .shipped import above_zero, shipped


@shipped(
    felt=("A flat touch screen feels as if it had a field of bumps: it vibrates under a finger."),
    do="stroke the field, along and across",
    words=(
        "V = gain A e(along x/length) e(across y/width) c(t); each e is the mean of a wave of bumps"
        " over the movement in its direction, of which the part duty (along y duty_y) is ridge, c"
        " the positive half waves of a carrier of freq (the touch-screen thesis, eqs. (16) and"
        " (17), along both axes)"
    ),
    full={"V": 500.0},
    drive={"x": "sinusoid(0.05, 1.0)", "y": "sinusoid(0.02, 1.3)"},
    ranges={"y": (0.0, 0.04), "duty": (0.05, 1.0), "duty_y": (0.05, 1.0)},
)
def bump_grid(
    waveform: str | np.ndarray = "square",
    along: float = 6,
    across: float = 3,
    duty: float = 0.5,
    duty_y: float = 0.5,
    amplitude: float = 4.0,
    length: float = 0.1,
    width: float = 0.04,
    freq: float = 158.0,
    gain: float = 50.0,
    rectify: str | None = "half",
) -> Scene:
    """Compose the voltage of piezo patches under a finger on a field of bumps.

    V = gain A e(along x/length) e(across y/width) c(t). A bump is where a ridge along x
    meets a ridge along y.

    Parameters
    ----------
    waveform : {"square", "sine", "sawtooth", "half_sine"} or array_like
        Shape of a bump, of both directions, see ``bump``.
    along, across : float
        Number of bumps over ``length`` (along x) and over ``width`` (along y). 0: none
        in this direction, which leaves ridges across the other one; the scene then has
        neither its input nor its duty.
    duty : float
        Part of each bump that is ridge along x, live as ``duty``.
    duty_y : float
        Part of each bump that is ridge along y, live as ``duty_y``.
    amplitude : float
        Peak in V before the amplifier, live as ``A``; at 0 the envelopes and the
        carrier are skipped.
    length, width : float
        Size of the explored region in m; the thesis' is 10 by 4 cm.
    freq : float
        Frequency of the carrier in Hz, live as ``freq``.
    gain : float
        Gain of the amplifier.
    rectify : {"half", "full", None}
        Rectification of the carrier.

    Returns
    -------
    Scene
        Inputs ``x`` and ``y`` in m, output ``voltage`` in V.

    Raises
    ------
    BadValue
        Numbers of bumps below 0, or 0 in both directions; sizes or gain not above 0; a
        duty outside (0, 1], a carrier above fs/2, and so on.

    Notes
    -----
    Each envelope is a mean over the movement of a sample. Their product is the mean of
    the product where a finger meets at most one edge in a sample, which is so below
    fs/2 edges a second.

    References
    ----------
    The touch-screen thesis, eqs. (16) and (17), section 4.2; chapter 7 has bumps
    along y and along both axes as future work.

    Examples
    --------
    >>> from stimlib.scenes import bump_grid
    >>> bump_grid("sine", along=6, across=3)
    Scene(x [m], y [m], A [V], duty [1], duty_y [1], freq [1/s] -> voltage [V])
    >>> bump_grid(along=0)  # bumps along y alone
    Scene(y [m], A [V], duty_y [1], freq [1/s] -> voltage [V])
    """
    above_zero("bump_grid", length=length, width=width, gain=gain)
    if not (along >= 0 and across >= 0 and along + across > 0):
        raise BadValue(
            f"bump_grid: along = {along:g} and across = {across:g} must be 0 or above, and not both"
            " 0; for a vibration that is the same everywhere take tone"
        )
    A = Param("A", amplitude, "V")
    V, on = gain * A, nonzero(A)
    for place, number, size, part in (
        ("x", along, length, Param("duty", duty)),
        ("y", across, width, Param("duty_y", duty_y)),
    ):
        if number:
            V = V * bump(
                Input(place, "m") * constant(number / size, "1/m"), waveform, part, "area", on
            )
    c = carrier(Param("freq", freq, "Hz"), rectify, 0.0, on)
    return Scene({"voltage": V * c})
