"""A plate whose ultrasonic vibration reduces the friction of a finger in places."""

from __future__ import annotations

from math import pi

from .. import blocks
from ..core.graph import Input, constant
from ..core.parameter import Param
from ..core.pointwise import nonzero
from ..core.scene import Scene
from ..errors import BadValue
from .shipped import above_zero, shipped

VISCOSITY, AIR, LEAST = 18.5e-6, 101325.0, 10.0  # Pa s, Pa; squeeze number


@shipped(
    felt=("A glass plate is slippery in some places and sticky in others, as if it had bumps."),
    do="drag to and fro",
    words=(
        "F is Coulomb's friction of a spring, mu N' at most; N' = max(0, normal - area p_0"
        " (sqrt((1 + 3/2 e^2)/(1 - e^2)) - 1)), p_0 = 101325 Pa the pressure of the air, e = a/gap,"
        " a + q/(pi freq) da/dt = per_volt V, V = A on the part duty of each bump (Salbu 1964;"
        " Wiertlewski, Fenton Friesen and Colgate 2016)"
    ),
    full={"N": 1.0},
    drive={"x": "sinusoid(0.05, 1.0)"},
    ranges={"duty": (0.05, 1.0), "A": (0.0, 20.0)},
)
def ultrasonic_friction(
    amplitude: float = 15.0,
    bumps: float = 6,
    duty: float = 0.5,
    normal: float = 0.5,
    mu: float = 0.8,
    stiffness: float = 1000.0,
    per_volt: float = 1e-7,
    freq: float = 30e3,
    q: float = 100.0,
    gap: float = 10e-6,
    area: float = 1e-4,
    length: float = 0.1,
    contact: bool = False,
) -> Scene:
    """Compose friction on a plate that ultrasound makes slippery in places.

    Where the plate vibrates, air carries a part of the finger, and it slides more
    easily. The vibration itself is far above what fingers feel, so the scene has its
    amplitude alone, which follows the voltage as a resonance does: with a time constant
    of q/(pi freq).

    Parameters
    ----------
    amplitude : float
        Peak of the driving voltage in V on the slippery parts, live as ``A``.
    bumps : float
        Number of slippery parts over the length.
    length : float
        Length of the explored region in m.
    duty : float
        Part of each that is slippery, live as ``duty``.
    normal : float
        Normal force in N, live as ``normal``.
    mu : float
        Coefficient of friction without vibration.
    stiffness : float
        Stiffness of the finger's pad along the plate, in N/m.
    per_volt : float
        Amplitude of the plate's steady vibration at the resonance, in m/V.
    freq : float
        Resonance in Hz; it is not rendered.
    q : float
        Quality of the resonance; it is not rendered.
    gap : float
        Mean distance between plate and skin in m.
    area : float
        Area of the film of air in m^2; see ``squeeze_film``.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not).

    Returns
    -------
    Scene
        Input ``x`` in m, output ``force`` in N.

    Raises
    ------
    BadValue
        Numbers not above 0, a duty outside (0, 1]; a vibration as large as the gap; a
        squeeze number below 10, where the air escapes and the law does not hold.

    References
    ----------
    Salbu, "Compressible squeeze films and squeeze bearings", Journal of Basic
    Engineering 86 (1964) 355, and Wiertlewski, Fenton Friesen and Colgate, "Partial
    squeeze film levitation modulates fingertip friction", PNAS 113 (2016) 9210. The
    touch-screen thesis, chapter 7, has ultrasound as future work. The numbers are no
    measurement.

    Examples
    --------
    >>> from stimlib.scenes import ultrasonic_friction
    >>> ultrasonic_friction(mu=1.0)
    Scene(x [m], normal [N], A [V], duty [1] -> force [N])
    """
    above_zero("ultrasonic_friction", bumps=bumps, length=length, freq=freq, q=q, mu=mu)
    above_zero("ultrasonic_friction", per_volt=per_volt, gap=gap, area=area)
    squeeze = 24 * VISCOSITY * freq * area / AIR  # times gap^2
    if squeeze < LEAST * gap * gap:
        raise BadValue(
            f"ultrasonic_friction: the squeeze number {squeeze / gap / gap:.3g} is below"
            f" {LEAST:g}: the air escapes; give a higher freq, a smaller gap or a larger area"
        )
    if not per_volt * abs(amplitude) < gap:
        raise BadValue(
            f"ultrasonic_friction: amplitude = {amplitude:g} V moves the plate by"
            f" {per_volt * abs(amplitude):g} m, as far as gap = {gap:g} m or more; give less"
        )
    x, A, touching = (
        Input("x", "m"),
        Param("A", amplitude, "V"),
        Input("contact") if contact else 1.0,
    )
    on = nonzero(A) * touching
    place = x * constant(bumps / length, "1/m")
    V = A * blocks.bump(place, "square", Param("duty", duty), contact=on)
    a = constant(per_volt, "m/V") * blocks.first_order(V, q / (pi * freq))
    load = blocks.squeeze_film(Param("normal", normal, "N"), a, gap, area)
    return Scene({"force": blocks.friction(x, load, mu, stiffness, "coulomb", contact=touching)})
