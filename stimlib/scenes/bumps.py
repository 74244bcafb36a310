"""Haptic bumps on a touch screen that vibrates at its resonance.

Source: the touch-screen thesis, chapters 3 and 4.

"Haptic Perception of Virtual Bumps Displayed Through a Piezo-Actuated Touch Screen";
see docs/reference/papers.rst.
"""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..blocks import bump, carrier, equalize
from ..blocks.equalization import points, within
from ..core.graph import Input, constant
from ..core.parameter import Param
from ..core.pointwise import nonzero
from ..core.scene import Scene
from ..errors import public
from .shipped import above_zero, shipped


def pad(now: dict[str, Any]) -> dict[str, Any]:
    """Return what a page draws of bumps: the explored region, and where the ridges are.

    Examples
    --------
    >>> from stimlib.scenes.bumps import pad
    >>> pad({"bumps": 2, "duty": 0.25, "length": 0.1})["hidden"]
    [[0.0, 0.0125], [0.05, 0.0625]]
    """
    length, period = now["length"], now["length"] / now["bumps"]
    ridges = [
        [k * period, min((k + now["duty"]) * period, length)]
        for k in np.arange(float(now["bumps"])).tolist()
    ]
    return {"kind": "pad", "length": length, "values": ["x"], "hidden": ridges}


@shipped(
    felt=("A flat touch screen feels as if it had ridges: it vibrates under a finger on one."),
    do="stroke the field from left to right and back, slowly and fast",
    words=(
        "V = gain A e(x/wavelength) c(t); e is the mean of a wave of bumps over each movement, of"
        " which the part duty is ridge, c the positive half waves of a carrier of freq (the"
        " touch-screen thesis, eqs. (16) and (17), section 4.2)"
    ),
    full={"V": 500.0},
    drive={"x": "sinusoid(0.05, 1.0)"},
    ranges={"duty": (0.05, 1.0)},
    # 120 um for A = 4 V; the half waves of 200 V have a sine of 100 V, at the resonance
    device={"V": {"unit": "m", "gain": 1.2e-6, "area": 1e-4}},
    view=pad,
)
def bumps(
    waveform: str | np.ndarray = "square",
    bumps: float = 6,
    duty: float = 0.5,
    amplitude: float = 4.0,
    length: float = 0.1,
    freq: float = 158.0,
    phase: float = 0.0,
    gain: float = 50.0,
    displacement=None,
    limit: float | None = None,
    headroom: str = "clip",
    contact: bool = False,
    sampling: str = "area",
    rectify: str | None = "half",
) -> Scene:
    """Compose the voltage of piezo patches under a finger that explores bumps.

    V = gain A e(x/wavelength) c(t).

    e is the unipolar envelope of ``bump``, wavelength = length/bumps; c is the positive
    half-wave of the carrier at the plate's first resonance.

    Parameters
    ----------
    waveform : {"square", "sine", "sawtooth", "half_sine"} or array_like
        Shape of a bump, see ``bump``.
    bumps : float
        Number of bumps over ``length``.
    duty : float
        Part of each bump that is ridge, live as ``duty``.
    amplitude : float
        Peak in V before the amplifier, live as ``A``; at 0 the envelope and the
        carrier are skipped.
    length : float
        Length of the explored region, in m.
    freq : float
        Frequency of the carrier in Hz, live as ``freq``.
    phase : float
        Phase of the carrier at the first sample, in rad.
    gain : float
        Gain of the amplifier.
    displacement : (knots, displacement) or path, optional
        Profile to equalise, positions in m; see ``equalize``.
    limit : float, optional
        Largest voltage of the amplifier, in V at its output.
    headroom : {"clip", "scale"}
        What happens where the limit is passed; see ``equalize``.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not): a lift is silent, and
        re-contact starts anew.
    sampling : {"area", "point"}
        Sampling of the envelope.
    rectify : {"half", "full", None}
        Rectification of the carrier.

    Returns
    -------
    Scene
        Input ``x`` in m, output ``voltage`` in V.

    Notes
    -----
    On the thesis' plate, which moves by 30 um per V of A, and under a finger tip of 1
    cm^2, the default is felt: 49 dB above the threshold of detection (dB SL).

    Raises
    ------
    BadValue
        Numbers that make no sense: bumps or length not above 0, a duty outside (0, 1],
        a carrier above fs/2, and so on.

    References
    ----------
    The touch-screen thesis, eqs. (16) and (17), sections 4.2 and 4.3, figure 4.1.

    Examples
    --------
    >>> from stimlib.scenes import bumps
    >>> bumps("sine", bumps=18, duty=0.2, amplitude=7.5, contact=True)
    Scene(x [m], contact [1], A [V], duty [1], freq [1/s] -> voltage [V])
    """
    above_zero("bumps", bumps=bumps, length=length, gain=gain)
    x, A = Input("x", "m"), Param("A", amplitude, "V")
    on = Input("contact") * nonzero(A) if contact else nonzero(A)
    e = bump(x * constant(bumps / length, "1/m"), waveform, Param("duty", duty), sampling, on)
    c = carrier(Param("freq", freq, "Hz"), rectify, phase, on)
    V = (gain * A) * e * c
    given = {}
    if displacement is not None:
        given["displacement"] = points(displacement)  # as the file is now
        V = equalize(x, displacement, limit, headroom, signal=V, peak=gain * abs(A), contact=on)
    else:
        V = within(V, limit, headroom, peak=gain * abs(A))
    return Scene({"voltage": V}, law="bumps", given=given)


class Stimulus(NamedTuple):
    """One of the experiment's stimuli; ``bumps(*stimulus)`` is its scene."""

    waveform: str
    bumps: int
    duty: float
    amplitude: float  # V, before the amplifier

    @property
    def ridge(self) -> float:
        """Ridge width in m, for the experiment's length of 0.1 m (table 4.1)."""
        return self.duty * 0.1 / self.bumps

    @property
    def groove(self) -> float:
        """Groove width in m (table 4.1)."""
        return 0.1 / self.bumps - self.ridge

    @property
    def displacement(self) -> float:
        """Displacement amplitude of the plate's centre in m, 30 um per V.

        Source: section 4.2.
        """
        return 30e-6 * self.amplitude


@public
def bumps_set() -> list[Stimulus]:
    """Return the 81 stimuli of the experiment, in the order of the paper's parameters.

    Returns
    -------
    list of Stimulus
        Waveform, number of bumps, duty, amplitude; and ridge and groove width (m),
        displacement (m) as attributes.

    References
    ----------
    The touch-screen thesis, section 4.2, tables 4.1 and 6.1.

    Examples
    --------
    >>> from stimlib.scenes import bumps, bumps_set
    >>> stimuli = bumps_set()
    >>> len(stimuli), stimuli[40]
    (81, Stimulus(waveform='square', bumps=6, duty=0.5, amplitude=4.0))
    >>> bumps(*stimuli[40])
    Scene(x [m], A [V], duty [1], freq [1/s] -> voltage [V])
    >>> round(1e3 * stimuli[40].ridge, 2), round(1e3 * stimuli[40].groove, 2)
    (8.33, 8.33)
    """
    return [
        Stimulus(*s)
        for s in product(
            ("sine", "square", "sawtooth"), (2, 6, 18), (0.2, 0.5, 0.8), (0.5, 4.0, 7.5)
        )
    ]
