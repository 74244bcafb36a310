"""The plate in a scene: displacement under a finger for a voltage on the patches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from ..blocks.impedance import with_unit
from ..blocks.resonance import mode, mode_shape, svf
from ..core.graph import Block, Const, constant, in_unit
from ..core.pointwise import sqrt
from ..errors import BadValue, From0, public
from .model import Plate

LOOKED_AT = 16  # modes among which the driven ones are found
UNMOVED = 1e-6  # of the largest static answer


@public
@dataclass(frozen=True)
class Finger:
    """The mass, damping and stiffness that a finger adds where it touches.

    A finger pad has about 0.1 g, 1 N s/m and 500 N/m, with large differences between
    people.

    Parameters
    ----------
    mass : float
        In kg.
    damping : float
        In N s/m.
    stiffness : float
        In N/m.

    Raises
    ------
    BadValue
        A number below 0.
    """

    mass: From0 = 0.0
    damping: From0 = 0.0
    stiffness: From0 = 0.0


def series_of(model: Plate, k: int) -> tuple[np.ndarray, float]:
    """Return a mode shape's Legendre series, scaled to 1, and its largest value.

    The largest value is in 1/sqrt(kg).
    """
    X, Y = model.axes
    c = X.series[0] @ model.solved(k + 1)[1][k] @ Y.series[0].T
    s = np.linspace(-1, 1, 201)
    top = float(np.abs(legendre.leggrid2d(s, s, c)).max())
    return c / top, top


def driven(
    model: Plate, modes: int, weights: Sequence[float] | None
) -> tuple[list[int], np.ndarray]:
    """Return the lowest modes that the patches drive, and the modal forces of all."""
    force = model.forces(LOOKED_AT, weights)
    size = np.abs(force) / model.solved(LOOKED_AT)[0]
    found = [int(k) for k in np.flatnonzero(size > UNMOVED * size.max())]
    if not 0 < modes <= len(found):
        raise BadValue(
            f"plate: modes = {modes}; the patches drive {len(found)} of the lowest {LOOKED_AT}"
        )
    return found[:modes], force


def loaded(voltage: Block, freq: float, q: float, phi2: Block, finger: Finger) -> Block:
    """Return a mode loaded by a finger.

    phi2 is the squared mode shape at the finger, in 1/kg.

    (1 + m phi2) q'' + (w0/Q + c phi2) q' + (w0^2 + k phi2) q = w0^2 V, with the
    coefficients of each sample, by the trapezoidal rule.
    """
    w = 2 * math.pi * freq
    heavy = 1.0 + constant(finger.mass, "kg") * phi2
    stiff = 1.0 + constant(finger.stiffness / w**2, "kg") * phi2
    lossy = 1.0 / q + constant(finger.damping / w, "kg") * phi2
    y = svf(
        voltage, constant(freq, "Hz") * sqrt(stiff / heavy), sqrt(heavy * stiff) / lossy, "lowpass"
    )
    return y / stiff


@public
def plate(
    x,
    y,
    voltage,
    model: Plate,
    modes: int = 3,
    weights: Sequence[float] | None = None,
    finger: Finger | None = None,
) -> Block:
    """Compute the displacement of a plate under a finger from the patches' voltage.

    It is a sum over modes of shape(x, y) times ``mode``.

    Each mode is exact for a voltage that is linear between samples. With a finger it is
    ``svf``, whose numbers follow the finger. The load couples the modes, which is
    neglected, and the trapezoidal rule shifts frequencies far above the mode.

    Parameters
    ----------
    x, y : float or Block
        Place of the finger in m, from the plate's corner; beyond its edges the value
        there is held.
    voltage : Block
        In V.
    model : Plate
        With patches.
    modes : int
        How many: the lowest that this drive moves.
    weights : sequence of float, optional
        A factor of the voltage for each patch.
    finger : Finger, optional
        What it adds to the plate; by default nothing.

    Returns
    -------
    Block
        In m, positive towards the upper side; starts at rest.

    Raises
    ------
    BadValue
        A plate without patches, or more modes than they move.
    UnitError
        A place that is not in m, a voltage that is not in V.

    References
    ----------
    The touch-screen thesis, eqs. (3) to (15): its finite elements, in modes.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.plate import Plate, plate
    >>> glass = Plate.paper(measured=True)
    >>> under = plate(glass.length / 2, glass.width / 2, stimlib.Input("v", "V"), glass)
    >>> proc = stimlib.compile(stimlib.Scene({"under": under}), fs=8000)
    >>> f = np.array([glass.carrier()])
    >>> (1e6 * abs(proc.response("under", "v", f))).round(2)  # um for each volt
    array([0.78])
    """
    V = with_unit(voltage, "V")
    in_unit("plate: voltage", V, V.dim, "V")
    x, y = with_unit(x, "m"), with_unit(y, "m")
    chosen, force = driven(model, modes, weights)
    w2 = model.solved(LOOKED_AT)[0]
    freq, q = np.sqrt(w2) / (2 * math.pi), 1 / model.damping
    parts = []
    for k in chosen:
        series, top = series_of(model, k)
        shape: Block = mode_shape(x, y, series, model.length, model.width)
        if isinstance(x, Const) and isinstance(y, Const):
            shape = constant(float(model.shape(k, x.value, y.value)) / top)
        if finger is None:
            moved = mode(V, float(freq[k]), q)
        else:
            moved = loaded(V, float(freq[k]), q, constant(top**2, "1/kg") * shape * shape, finger)
        parts.append(constant(float(force[k] * top / w2[k]), "m/V") * moved * shape)
    return sum(parts[1:], parts[0])
