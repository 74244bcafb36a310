"""Bumps on a touch screen down to the plate's displacement under the finger.

The touch-screen thesis, chapters 2 to 4, with a model in the place of its plate; see
docs/reference/scenes/touch_screen.rst.
"""

from __future__ import annotations

import warnings

import numpy as np

from ..blocks import amplifier, bump, carrier, equalize, pole_swap
from ..core.graph import Input, constant
from ..core.parameter import Param
from ..core.pointwise import nonzero
from ..core.scene import Scene
from ..errors import BadValue, outside
from ..plate.model import Plate
from ..plate.profile import SHIFT, mode_fit
from ..plate.vibrate import Finger, plate
from .bumps import pad
from .shipped import above_zero, shipped

KNOTS = np.linspace(0.0, 1.0, 5)
"""Where the thesis measures displacement, in parts of the explored length."""


@shipped(
    felt=("Bumps on a touch screen feel alike wherever the finger is."),
    do="stroke the field, slowly and fast",
    words=(
        "V = amplifier(pole swap(A e(x/wavelength) c(t) d_max/d(x))); e is the wave of bumps over"
        " the place, c the carrier of freq, d(x) how far the plate moves where the finger is, and"
        " d_max the most of it; the displacement is the sum over the plate's modes of shape(x, y)"
        " times the mode's answer to V (the touch-screen thesis, chapters 2 to 4)"
    ),
    full={"V": 200.0, "m": 5e-05},
    drive={"x": "sinusoid(0.05, 1.0, 0.05)"},
    ranges={"duty": (0.05, 1.0)},
    view=pad,
)
def touch_screen(
    waveform: str | np.ndarray = "half_sine",
    bumps: float = 6,
    duty: float = 0.5,
    amplitude: float = 0.5,
    length: float = 0.1,
    swap: float = 4.0,
    gain: float = 50.0,
    modes: int = 3,
    finger: bool = False,
    rectify: str | None = None,
    model: Plate | None = None,
    as_printed: bool = False,
) -> Scene:
    """Compose the displacement under a finger that explores bumps.

    The stages are bumps, uniform displacement, faster resonance, amplifier, plate.

    The carrier's frequency, the profile that is equalised, the mode that is made faster
    and the voltage limits of the patches all come from the plate's model.

    Parameters
    ----------
    waveform : str
        Shape of a bump over the place, such as ``half_sine``, see ``bump``.
    bumps : int
        Number of bumps over the length.
    length : float
        Length of the explored region in m; it lies in the middle of the plate.
    duty : float
        Part of each bump that is ridge, live as ``duty``.
    amplitude : float
        Peak in V before the amplifier, live as ``A``.  Where the patches cannot take
        the voltage that this asks for, a warning says what is lost: by default above
        1.09 V, so that of the thesis' 0.5 (the default here), 4 and 7.5 V the latter
        two are not shown whole.
    swap : float
        How many times as fast the plate's first resonance answers (``pole_swap``); 1
        leaves it as it is.
    gain : float
        Gain of the amplifier.
    modes : int
        Number of modes of the plate.
    finger : bool
        Whether the finger loads the plate, with 0.1 g, 1 N s/m and 500 N/m (assumed).
    rectify : {None, "half", "full"}
        Rectification of the carrier.  The thesis takes "half"; what it holds besides
        the carrier, at 0 Hz and at twice the frequency, the swap would raise ``swap``
        times.
    model : Plate, optional
        The plate and its patches, by default the paper's plate as it was measured.  The
        patches say which voltages they take.  Frequency of the carrier in Hz, by
        default the first resonance of this model, live as ``freq``.
    as_printed : bool
        The thesis' own drive: a half-wave carrier and no pole swap, whatever
        ``rectify`` and ``swap`` say.  Displacements are equalised by the shape of the
        mode as always, where the thesis takes a polynomial through five points.

    Returns
    -------
    Scene
        Input ``x`` in m, 0 .. length; outputs ``voltage`` in V and ``displacement`` in
        m.

    Raises
    ------
    BadValue
        Numbers that make no sense; an explored length that reaches to the plate's
        edges; a plate without patches, or whose patches move another mode more than the
        lowest.

    Warns
    -----
    RuntimeWarning
        The amplifier would hold the voltage at the patches' limits.  It is computed
        from the drive's formula, at the top of a bump where the plate moves least, in
        steady state: carrier, equalisation, pole swap, gain.  At the edges of "square"
        bumps the swap asks for up to ``swap`` times as much, for a few periods.  What
        is set later, by ``A``, is counted by ``verify``.

    References
    ----------
    The touch-screen thesis, sections 2.1, 3 and 4.2.

    Examples
    --------
    >>> from stimlib.scenes import touch_screen
    >>> touch_screen(swap=4)
    Scene(x [m], A [V], duty [1], freq [1/s] -> voltage [V], displacement [m])
    """
    rectify, swap = ("half", 1.0) if as_printed else (rectify, swap)
    above_zero("touch_screen", bumps=bumps, length=length, gain=gain)
    glass = Plate.paper(measured=True) if model is None else model
    resonance, origin, y = glass.carrier(), (glass.length - length) / 2, glass.width / 2
    _check_model(glass, length, resonance)
    profile = length * KNOTS, np.abs(glass.shape(0, origin + length * KNOTS, y))
    x, A = Input("x", "m"), Param("A", amplitude, "V")
    V = A * bump(
        x * constant(bumps / length, "1/m"), waveform, Param("duty", duty), contact=nonzero(A)
    )
    V = V * carrier(Param("freq", resonance, "Hz"), rectify)
    V = equalize(x, profile, signal=V, kind=mode_fit(glass, origin, y, clamp="known"))
    with np.errstate(over="ignore", invalid="ignore"):  # numbers beyond any plate
        _warn_if_held(amplitude, gain * profile[1].max() / profile[1].min(), rectify, swap, glass)
    V = amplifier(pole_swap(V, resonance, 1 / glass.damping, swap), gain, *glass.voltages)
    load = Finger(1e-4, 1.0, 500.0) if finger else None
    under = plate(x + constant(origin, "m"), constant(y, "m"), V, glass, modes, finger=load)
    outputs = {"voltage": V, "displacement": under}
    return Scene(
        outputs, law="touch_screen", given={"model": glass, "rectify": rectify, "swap": swap}
    )


def _warn_if_held(
    amplitude: float, highest: float, rectify: str | None, swap: float, glass: Plate
) -> None:
    """Warn if a carrier's voltage, its gain the highest, exceeds the limits."""
    sine, k = np.sin(2 * np.pi * np.arange(720) / 720), np.arange(361)
    lines = np.fft.rfft({None: sine, "half": np.maximum(sine, 0), "full": np.abs(sine)}[rectify])
    # in the frequency of the mode
    top, bottom = (1 - k * k + 1j * k * glass.damping * faster for faster in (1.0, swap))
    asked = np.clip(
        np.nan_to_num(amplitude * highest * np.fft.irfft(lines * swap * top / bottom)), -1e30, 1e30
    )
    shown = np.clip(asked, *glass.voltages)
    if (shown != asked).any():
        one, other = (abs(np.fft.rfft(v)[2 if rectify == "full" else 1]) for v in (asked, shown))
        low, high = glass.voltages
        least, most = asked.min(), asked.max()
        ends = [end / v for end, v in ((low, least), (high, most)) if end * v > 0]
        fits = amplitude * min(ends, default=0.0)
        held, lost = 100 * np.mean(shown != asked), 100 * (1 - other / one)
        warnings.warn(
            "touch_screen: at the top of a bump, where the plate moves least, the drive asks for"
            f" {least:.4g} .. {most:.4g} V and the patches take {low:g} .. {high:g} V:"
            f" {held:.0f} % of the samples there are held, and {lost:.0f} % of the vibration is"
            f" lost; give an amplitude of up to {fits:.3g} V, or a smaller gain or swap",
            RuntimeWarning,
            stacklevel=outside(),
        )


def _check_model(glass: Plate, length: float, resonance: float) -> None:
    if not glass.patches:
        raise BadValue(
            "touch_screen: model has no patches to drive; give it some, Plate(..,"
            " patches=[Patch(..)])"
        )
    most = glass.length - 2 * SHIFT
    if length > most:
        raise BadValue(
            f"touch_screen: length = {length:g} m reaches to the edges of the plate's"
            f" {glass.length:g} m; explore at most {most:g} m"
        )
    lowest = glass.modes(1)[0]
    if resonance != lowest:
        raise BadValue(
            f"touch_screen: these patches move the middle most at {resonance:.1f} Hz, but this"
            f" scene uses the lowest mode, {lowest:.1f} Hz; place them by best_patches"
        )
