"""Bumps on a touch screen down to the finger: voltage on the patches, and the plate's displacement under the finger.

The touch-screen thesis, chapters 2 to 4, with a model in the place of its plate; see docs/reference/scenes/touch_screen.rst.
"""

from __future__ import annotations

import numpy as np

from ..blocks.bump import bump
from ..blocks.carrier import carrier
from ..blocks.equalise import equalize
from ..blocks.maps import nonzero
from ..blocks.plates import amplifier, pole_swap
from ..core.graph import Input, Param, check_arguments, constant
from ..core.scene import Scene
from ..errors import BadValue
from ..plate.model import Plate, check_plate
from ..plate.profile import SHIFT, mode_fit
from ..plate.vibrate import Finger, plate

KNOTS = np.linspace(0.0, 1.0, 5)
"""Where the thesis measures displacement, in parts of the explored length."""


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
) -> Scene:
    """Displacement under a finger that explores bumps: bumps, equal displacement, faster resonance, amplifier, plate.

    The carrier's frequency, the profile that is equalised, the mode that is made faster and the voltages that the patches take
    all come from the plate's model.

    Parameters
    ----------
    waveform, bumps, duty, length
        As of ``bumps``; the explored length lies in the middle of the plate.
    amplitude : float
        Peak A in V before the amplifier, live as ``A``.
    swap : float
        How many times as fast the first resonance shall answer, see ``pole_swap``; 1 leaves it as it is.
    gain : float
        Of the amplifier.
    modes : int
        Of the plate.
    finger : bool
        Whether the finger loads the plate, with 0.1 g, 1 N s/m and 500 N/m (assumed).
    rectify : {None, "half", "full"}
        Of the carrier.  The thesis takes "half"; what it holds besides the carrier, at 0 Hz and at twice the frequency, the swap
        would raise ``swap`` times.
    model : Plate, optional
        With patches, which say the voltages that they take; default ``Plate.paper(measured=True)``.

    Returns
    -------
    Scene
        Input ``x`` in m, 0 .. length; outputs ``voltage`` in V and ``displacement`` in m.

    Raises
    ------
    BadValue
        Numbers that make no sense; an explored length that reaches to the plate's edges; a plate without patches, or
        whose patches move another mode more than the lowest.

    References
    ----------
    The touch-screen thesis, sections 2.1, 3 and 4.2.

    Examples
    --------
    >>> from stimlib.scenes import touch_screen
    >>> touch_screen(swap=4)
    Scene(x [m], A [V], duty [1], freq [1/s] -> voltage [V], displacement [m])
    """
    check_arguments(touch_screen, {k: v for k, v in locals().items() if k != "model"} | {"model": None})
    for name, value in (("bumps", bumps), ("length", length), ("gain", gain)):
        if not value > 0:
            raise BadValue(f"touch_screen: {name} = {value!r} must be above 0")
    glass = Plate.paper(measured=True) if model is None else model
    check_plate("touch_screen", glass)
    resonance, origin, y = glass.carrier(), (glass.length - length) / 2, glass.width / 2
    _check_model(glass, length, resonance)
    profile = length * KNOTS, np.abs(glass.shape(0, origin + length * KNOTS, y))
    x, A = Input("x", "m"), Param("A", amplitude, "V")
    V = A * bump(x * constant(bumps / length, "1/m"), waveform, Param("duty", duty), contact=nonzero(A))
    V = V * carrier(Param("freq", resonance, "Hz"), rectify)
    V = equalize(x, profile, signal=V, kind=mode_fit(glass, origin, y, clamp="known"))
    V = amplifier(pole_swap(V, resonance, 1 / glass.damping, swap), gain, *glass.voltages)
    load = Finger(1e-4, 1.0, 500.0) if finger else None
    under = plate(x + constant(origin, "m"), constant(y, "m"), V, glass, modes, finger=load)
    return Scene({"voltage": V, "displacement": under}, law="touch_screen")


def _check_model(glass: Plate, length: float, resonance: float) -> None:
    if not glass.patches:
        raise BadValue("touch_screen: model has no patches to drive; give it some, Plate(.., patches=[Patch(..)])")
    most = glass.length - 2 * SHIFT
    if length > most:
        raise BadValue(
            f"touch_screen: length = {length:g} m reaches to the edges of the plate's {glass.length:g} m; explore at most "
            f"{most:g} m"
        )
    lowest = glass.modes(1)[0]
    if resonance != lowest:
        raise BadValue(
            f"touch_screen: these patches move the middle most at {resonance:.1f} Hz, and this scene is of the lowest mode, "
            f"{lowest:.1f} Hz; place them by best_patches"
        )
