"""A grooved and rough surface under a stroking finger, tied to position."""

from __future__ import annotations

from ..blocks.surfaces import grating as ribs, spatial_noise
from ..core.graph import Input
from ..core.parameter import Param
from ..core.scene import Scene
from .shipped import shipped


@shipped(
    felt=("A stroked surface has coarse and fine ridges, and is rough."),
    do="stroke the field, slowly and fast",
    words=(
        "F = depth sin(2 pi x/coarse) + fine_depth sin(2 pi x/fine) + roughness n(x), each a mean"
        " over the movement of a sample; n is noise over place with a spectrum of 1/f^slope (after"
        " Wiertlewski, Lozada and Hayward 2011)"
    ),
    full={"N": 1.0},
    drive={"x": "sinusoid(0.05, 1.0)"},
)
def grating(
    depth: float = 0.2,
    coarse: float = 2e-3,
    fine_depth: float = 0.05,
    fine: float = 0.4e-3,
    roughness: float = 0.03,
    slope: float = 1.0,
    seed: int = 0,
    shortest: float = 5e-5,
    longest: float = 0.05,
    contact: bool = False,
) -> Scene:
    """Compose the force along the skin of a surface with gratings and roughness.

    There are two gratings; the roughness has the spectrum 1/f^slope and is always the
    same at the same position.

    F(x) = depth sin(2 pi x/coarse) + fine_depth sin(2 pi x/fine) + roughness n(x). Each
    sample is the mean over the movement of one sample period.

    Parameters
    ----------
    depth : float
        Force of the coarse grating in N, from the middle to the top, live as ``depth``.
    fine_depth : float
        Force of the fine grating in N, live as ``fine_depth``.
    coarse, fine : float
        Wavelengths of the two gratings in m.
    roughness : float
        Force of the roughness in N rms, live as ``roughness``.
    slope : float
        Slope of the roughness' spectrum over place, 0.5 to 4.
    seed : int
        Seed of the roughness: the name of the surface.
    shortest, longest : float
        Wavelengths in m between which its spectrum follows the law.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not): a lift is silent, and
        re-contact starts anew.

    Returns
    -------
    Scene
        Input ``x`` in m, output ``force`` in N.

    Raises
    ------
    BadValue
        Wavelengths not above 0, a slope or seed out of range.

    References
    ----------
    Gratings as a model of texture, and 1/f spectra of rough ones: Wiertlewski, Lozada
    and Hayward, IEEE Trans. Robotics 27, 2011.

    Examples
    --------
    >>> from stimlib.scenes import grating
    >>> grating(coarse=1e-3, contact=True)
    Scene(x [m], contact [1], depth [N], fine_depth [N], roughness [N] -> force [N])
    """
    x = Input("x", "m")
    on = Input("contact") if contact else 1.0
    force = Param("depth", depth, "N") * ribs(x, [(coarse, 1.0, 0.0)], contact=on)
    force += Param("fine_depth", fine_depth, "N") * ribs(x, [(fine, 1.0, 0.0)], contact=on)
    force += Param("roughness", roughness, "N") * spatial_noise(
        x, slope, seed, shortest, longest, on
    )
    return Scene({"force": force})
