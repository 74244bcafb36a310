"""A button that clicks: the force drops at the snap, with a vibration."""

from __future__ import annotations

from ..blocks import button, delay, ring, rising, wall as bottom
from ..core.graph import Input
from ..core.parameter import Param
from ..core.scene import Scene
from .shipped import shipped


@shipped(
    felt=(
        "A button resists, gives way with a short vibration, and snaps back when it is released."
    ),
    do="press the button: to the right is down",
    words=(
        "F = peak (x/at - drop q) + stiffness max(0, x - travel) + A exp(-t/decay) sin(2 pi freq"
        " t), each a mean over the movement of a sample; q is 1 from x >= at until x < back, t the"
        " time since q rose (our own)"
    ),
    full={"N": 100.0},
    drive={"x": "sinusoid(1.3e-3, 3.0, 1e-3)"},
    ranges={"x": (0.0, 0.005)},
)
def click(
    peak: float = 2.0,
    drop: float = 0.4,
    at: float = 1e-3,
    back: float = 0.8e-3,
    travel: float = 2e-3,
    stiffness: float = 10e3,
    A: float = 0.3,
    freq: float = 200.0,
    decay: float = 0.004,
    contact: bool = False,
) -> Scene:
    """Compose the force of a button, and a decaying vibration at each snap.

    The force depends on the button's travel.

    F = peak (x/at - drop q) + stiffness max(0, x - travel) + A exp(-t/decay) sin(2 pi
    freq t), where q is 1 from x >= at until x < back, and t is the time since q rose
    in contact: a finger that comes down at x >= at makes no vibration.

    Parameters
    ----------
    peak : float
        Force at the snap in N, live as ``peak``.
    drop : float
        Part of the peak by which the force falls.
    at, back, travel : float
        Places in m of the snap, the way back and the bottom.
    stiffness : float
        Stiffness of the bottom, in N/m.
    A : float
        Amplitude of the vibration in N, live as ``A``.
    freq, decay : float
        Frequency in Hz and decay in s of the vibration.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not).

    Returns
    -------
    Scene
        Input ``x`` in m, output ``force`` in N.

    Raises
    ------
    BadValue
        As of ``button``, ``wall`` and ``ring``.

    References
    ----------
    Our own, of the blocks ``button``, ``wall`` and ``ring``; the numbers are no
    measurement.

    Examples
    --------
    >>> from stimlib.scenes import click
    >>> click(peak=1.0)
    Scene(x [m], peak [N], A [N] -> force [N])
    """
    x, touching = Input("x", "m"), Input("contact") if contact else 1.0
    key = button(x, Param("peak", peak, "N"), drop, at, back, touching)
    snap = rising(key.pressed)
    if contact:  # a finger that comes down behind the snap has not passed it
        snap = snap * delay(touching > 0, 1)
    vibration = Param("A", A, "N") * ring(snap, freq, decay)
    return Scene(
        {"force": key.force + bottom(x, stiffness, at=travel, contact=touching) + vibration},
    )
