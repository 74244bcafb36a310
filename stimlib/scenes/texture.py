"""A measured surface under a tool.

Source: Culbertson, Unwin and Kuchenbecker, IEEE Trans. Haptics 7 (2014).
"""

from __future__ import annotations

from ..blocks.impedance import velocity
from ..blocks.texture import texture as texture_block
from ..core.graph import Input
from ..core.parameter import Param
from ..core.scene import Scene
from ..design.texture import TextureModel, load_texture, made_up
from .shipped import shipped


@shipped(
    felt=("A tool that strokes a rough surface vibrates, by its speed and pressing force."),
    do="stroke the field, slowly and fast",
    words=(
        "a(t) = level times what the models' recursion (AR and MA, of the three models around speed"
        " and force) makes of white noise, brought to the rate by a windowed sinc (Culbertson,"
        " Unwin and Kuchenbecker 2014)"
    ),
    full={"m/s²": 20.0},
    drive={"x": "sinusoid(0.05, 1.0)", "force": "sinusoid(0.2, 1.0, 1.0)"},
    device={"m/s**2": {"area": 1e-4}},
)
def texture(
    model=None,
    level: float = 1.0,
    seed: int = 0,
    cutoff: float = 20.0,
    contact: bool = False,
) -> Scene:
    """Compose the acceleration of a tool that strokes a measured surface.

    White noise drives a model that follows speed and normal force.

    Parameters
    ----------
    model : TextureModel or path, optional
        Model of a surface, see ``load_texture`` and
        ``stimlib.fitting.texture.fit_texture``.  By default an invented one of
        stimlib's, because those of the toolkit may not be passed on.
    level : float
        Factor on the acceleration, live as ``level``.
    seed : int
        Seed of the noise.
    cutoff : float
        Cut-off frequency of the velocity estimate, in Hz.
    contact : bool
        Also take an input ``contact`` (1 touching, 0 not): a lift is as no force, and
        re-contact starts anew.

    Returns
    -------
    Scene
        Inputs ``x`` in m and ``force`` in N, output ``acceleration`` in m/s^2.

    Raises
    ------
    BadValue
        A file that is no texture; numbers out of range; at compile time, a sample rate
        that is no whole multiple of the model's.

    References
    ----------
    Culbertson, Unwin and Kuchenbecker, "Modeling and Rendering Realistic Textures from
    Unconstrained Tool-Surface Interactions", IEEE Transactions on Haptics 7 (2014). The
    model that is taken by default, "made up", is no measurement.

    Examples
    --------
    >>> from stimlib.scenes import texture
    >>> texture()
    Scene(x [m], force [N], level [1] -> acceleration [m/s²])
    """
    if not isinstance(model, TextureModel):
        model = made_up() if model is None else load_texture(model)
    x, N = Input("x", "m"), Input("force", "N")
    touching = Input("contact") if contact else 1.0
    v = velocity(x, cutoff, touching)
    a = texture_block(v, N * touching, model, seed)
    outputs = {"acceleration": Param("level", level) * a}
    return Scene(outputs, law="texture", given={"model": model})
