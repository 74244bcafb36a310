"""The electrical load of a touch screen: what its amplifier must deliver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.graph import unmasked
from ..core.units import unit
from ..errors import Above0, BadValue, UnitError, computed, public
from ..run.rendering import Rendering


class AmplifierLoad(NamedTuple):
    """What an amplifier must deliver to a capacitor with a voltage.

    Attributes
    ----------
    current : float
        Largest current in A, either way.
    rms_current : float
        Its root mean square in A.
    slew : float
        Steepest change of the voltage in V/s.
    power : float
        Largest product of voltage and current in W.  A capacitor returns all of it:
        the amplifier, not the patch, turns it into heat.
    """

    current: float
    rms_current: float
    slew: float
    power: float


@public
@computed
def amplifier_load(
    voltage: Rendering | ArrayLike,
    capacitance: float,
    fs: Above0 | None = None,
    output: str = "voltage",
) -> AmplifierLoad:
    """Compute the current that piezo patches draw from their amplifier, i = C dV/dt.

    The voltage is taken as straight between its samples, as the plate's modes take it,
    so each current is the exact mean of a sample period.

    Parameters
    ----------
    voltage : Rendering or array_like, shape (n,)
        A rendering with an output in V, such as one of ``bumps`` or ``touch_screen``;
        or samples in V at the amplifier's output.
    capacitance : float
        Of all patches in parallel, in F: measured, or ``sum(p.capacitance() for p in
        plate.patches)``.
    fs : float, optional
        Sample rate in Hz; of a rendering it is known.
    output : str
        Name of the voltage in a rendering.

    Returns
    -------
    AmplifierLoad
        Largest and RMS current, slew rate and power.

    Raises
    ------
    BadValue
        Fewer than two samples, samples that are not finite, a capacitance not above 0;
        fs missing, or given for a rendering.
    UnitError
        An output that is not in V.
    UnknownName
        A rendering without this output.

    Notes
    -----
    Where the voltage jumps from one sample to the next, as at the edges of square
    bumps, current and slew grow with the sample rate, and the amplifier's own limit
    decides. ``slew_limit`` keeps a voltage within such a limit.

    The motion of the plate is left out. It adds a current in phase with the voltage at
    the resonance, F^2 Q/w0 for each volt, F being the modal force of 1 V
    (``Plate.forces``), which is a small part of w0 C here.

    References
    ----------
    The touch-screen thesis, eqs. (2) and (4): charge by capacitance and motion. It
    names the amplifier, but neither a capacitance nor a current.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.plate import Plate, amplifier_load
    >>> C = sum(p.capacitance() for p in Plate.paper(patches=True).patches)
    >>> wave = 375 * np.sin(2 * np.pi * 158 * np.arange(8000) / 8000)
    >>> load = amplifier_load(wave, C, fs=8000)
    >>> round(1e9 * C, 1), round(1e3 * load.current, 1)  # nF, mA: w C V
    (47.7, 17.8)
    """
    if isinstance(voltage, Rendering):
        if fs is not None:
            raise BadValue("amplifier_load: a rendering has its own fs; leave out fs =")
        row, fs = voltage[output], voltage.fs
        if (dim := voltage.scene.outputs[output].dim) != unit("V"):
            raise UnitError(f"amplifier_load: output {output} [{dim}] must be in V; give output=")
    elif fs is None:
        raise BadValue("amplifier_load: samples need their sample rate; give fs=")
    else:
        row = unmasked(voltage)
    if row.ndim != 1 or row.size < 2 or not np.isfinite(row).all():
        raise BadValue(
            "amplifier_load: voltage must be one row of at least two finite samples; give"
            " one output"
        )
    if not capacitance > 0:
        raise BadValue(
            f"amplifier_load: capacitance = {capacitance!r} F must be above 0; a plate without"
            " patches has none, see Plate.paper(patches=True)"
        )
    slew = np.diff(row) * fs
    current = capacitance * slew
    return AmplifierLoad(
        float(np.abs(current).max()),
        float(np.sqrt(np.mean(current**2))),
        float(np.abs(slew).max()),
        float(np.abs((row[1:] + row[:-1]) / 2 * current).max()),
    )
