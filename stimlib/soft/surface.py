"""The surface of a soft object under its indenters: heights, pictures, a film."""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..blocks.soft import deformation
from ..core.graph import Input, design_value
from ..core.scene import Scene
from ..errors import BadValue, public
from ..run.processor import Processor, compile
from ..run.rendering import Rendering
from ..system import safe_files
from ..system.limits import limits
from ..system.packages import package
from ..system.progress import progress
from .maps import BLOCK, nodes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RADIUS = 0.005
"""Of an indenter, in m; ours."""
AVATARS = "#2060c0", "#d03030", "#e8c020"  # "blue, red, and yellow dots"
FASTEST = 50
"""Pictures per second of a GIF: it counts in 1/100 s, and browsers slow down what shows
a picture for less than two.
"""
SKIN = np.array([0.95, 0.84, 0.76])
LIGHT = np.array([-0.5, -0.5, 0.7071])  # from the left and from before, 45 degrees high

Join = Literal["mean", "deepest"]


@cache
def _dents(count: int, radius: float, join: Join) -> Processor:
    """Return a processor that computes the depth of the surface at given distances."""
    rho, depth = ([Input(f"{name}{i}", "m") for i in range(count)] for name in ("rho", "depth"))
    return compile(Scene({"down": deformation(rho, depth, radius, join)}), fs=1)


@public
def surface(
    indenters: Sequence[tuple[float, float, float]],
    width: float = BLOCK,
    height: float = BLOCK,
    radius: float = RADIUS,
    spacing: float | None = None,
    join: Join = "mean",
) -> NDArray[np.float64]:
    """Return the heights of a soft surface under indenters, at the nodes of a grid.

    Parameters
    ----------
    indenters : sequence of (x, y, depth)
        In m; each moves the node nearest to it by its whole depth.
    width, height : float
        Of the surface in m.
    radius, join
        See ``stimlib.blocks.deformation``.
    spacing : float, optional
        Of the nodes in m; by default radius/2.

    Returns
    -------
    ndarray, shape (rows, columns)
        In m, 0 or below; the first row is at y = 0.

    Raises
    ------
    BadValue
        Indenters that are not three finite numbers each; a size or spacing not above 0;
        more nodes than ``limits.map_points``.

    References
    ----------
    Li et al. (2016), "Multi-point pseudo-haptic interaction".

    Examples
    --------
    >>> from stimlib.soft import surface
    >>> h = surface([(0.03, 0.03, 0.0075)], width=0.06, height=0.06)
    >>> (1000 * h[12, 12:17]).round(2) + 0.0
    array([-7.5 , -6.83, -2.5 , -1.25,  0.  ])
    """
    design_value("surface: radius", "Above0", radius)
    spacing = radius / 2 if spacing is None else spacing
    rows, columns = nodes("surface", width, height, spacing)
    try:
        at = np.array([*indenters] or np.empty((0, 3)), float)
    except (TypeError, ValueError, OverflowError):
        at = np.array(np.nan)
    if at.shape[1:] != (3,) or not np.isfinite(at).all():
        raise BadValue("surface: an indenter is x, y and depth, three finite numbers in m")
    if not at.size:
        return np.zeros((rows, columns))
    x, y = np.meshgrid(np.linspace(0, width, columns), np.linspace(0, height, rows))
    rho = np.hypot(x.ravel() - at[:, :1], y.ravel() - at[:, 1:2])
    for row in rho:
        # nobody is nearer; beyond the edge there is no node
        row[row.argmin()] *= row.min() > spacing
    given = {f"rho{i}": row for i, row in enumerate(rho)} | {
        f"depth{i}": 0 * rho[0] + d for i, d in enumerate(at[:, 2])
    }
    proc = _dents(len(at), float(radius), join)
    return -proc.process(np.array([given[name] for name in proc.inputs]))[0].reshape(rows, columns)


def _indenters(result: Rendering, k: int) -> list[tuple[float, float, float]]:
    """Return x, y and depth of a rendering's avatars at one sample."""
    names = [i for i in "123" if f"x{i}" in result.outputs and f"y{i}" in result.outputs]
    if not names:
        raise BadValue(
            "a picture needs the outputs x1 and y1 of soft_surface; there are"
            f" {', '.join(result.outputs)}"
        )
    depth = [result[f"depth{i}"][k] if f"depth{i}" in result.outputs else 0.0 for i in names]
    return [
        (float(result[f"x{i}"][k]), float(result[f"y{i}"][k]), float(d))
        for i, d in zip(names, depth, strict=True)
    ]


def _draw(
    axes: Any, indenters: list, width: float, height: float, radius: float, join: Join
) -> None:
    """Draw the shaded surface and a ball for each avatar, with lengths in mm.

    It is seen from 45 degrees above.
    """
    axes.clear()
    h = 1000 * surface(indenters, width, height, radius, None, join)
    x, y = np.meshgrid(
        np.linspace(0, 1000 * width, h.shape[1]), np.linspace(0, 1000 * height, h.shape[0])
    )
    down_y, down_x = np.gradient(h, y[:, 0], x[0])
    lit = (-down_x * LIGHT[0] - down_y * LIGHT[1] + LIGHT[2]) / np.sqrt(down_x**2 + down_y**2 + 1)
    shade = (0.25 + 0.75 * np.clip(lit, 0, 1) / LIGHT[2]).clip(0, 1)[..., None]
    axes.computed_zorder = False  # or a ball in a dent hides behind the rim
    axes.plot_surface(
        x,
        y,
        h,
        rstride=1,
        cstride=1,
        facecolors=shade * SKIN,
        shade=False,
        linewidth=0,
        antialiased=False,
    )
    turn, rise = np.meshgrid(np.linspace(0, 2 * np.pi, 17), np.linspace(0, np.pi, 9))
    ball = (
        1000
        * radius
        * np.array([np.cos(turn) * np.sin(rise), np.sin(turn) * np.sin(rise), np.cos(rise)])
    )
    for (px, py, d), colour in zip(indenters, AVATARS, strict=False):
        middle = 1000 * np.array([px, py, radius - d])[:, None, None]
        axes.plot_surface(*(ball + middle), color=colour, linewidth=0, zorder=3)
    axes.set(
        xlim=(0, 1000 * width),
        ylim=(0, 1000 * height),
        zlim=(-16, 10),
        xlabel="x / mm",
        ylabel="y / mm",
        zticks=[],
    )
    axes.set_box_aspect((width, height, 0.026), zoom=1.15)
    axes.grid(False)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set_visible(False)


def _axes(figure: Figure) -> Any:
    axes = figure.add_subplot(projection="3d", proj_type="persp")
    axes.view_init(elev=45, azim=-90)
    return axes


@public
def picture(
    result: Rendering,
    at: float | None = None,
    width: float = BLOCK,
    height: float = BLOCK,
    radius: float = RADIUS,
    join: Join = "mean",
) -> Figure:
    """Draw the surface and its avatars at one time of a rendering.

    It is a shaded perspective view, at 45 degrees towards the viewer.

    Parameters
    ----------
    result : Rendering
        Of ``soft_surface``, or of any scene with outputs x1, y1 and, if wanted, depth1,
        and so on to 3.
    at : float, optional
        In s; by default where the indenters are deepest.
    width, height : float
        Of the surface in m.
    radius, join
        See ``surface``.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    BadValue
        Outputs that are missing, a time outside the rendering.

    References
    ----------
    Li et al. (2016), "Single-point pseudo-haptic interaction": "a perspective view with
    an angle of 45 degrees towards the user and deformations are emphasized using shadow
    effects"; the avatar is a blue sphere, of three blue, red and yellow.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.scenes import soft_surface
    >>> from stimlib.soft import picture
    >>> hand = {"x": np.full(9, 0.06), "y": np.full(9, 0.09), "press": np.ones(9)}
    >>> picture(stimlib.render(soft_surface("deformation"), hand, fs=1000)).axes[0].name
    '3d'
    """
    Figure = package("matplotlib.figure", "a picture").Figure
    n = result.y.shape[1]
    if at is None:
        deep = [result[name] for name in result.outputs if name.startswith("depth")]
        k = int(np.argmax(np.max(deep, axis=0))) if deep else n - 1
    else:
        k = _sample(result, "at", at)
    figure = Figure(figsize=(6, 4.5), layout="constrained")
    _draw(_axes(figure), _indenters(result, k), width, height, radius, join)
    figure.axes[0].set_title(f"{k / result.fs:.2f} s", fontsize="small")
    return figure


def _sample(result: Rendering, name: str, seconds: float) -> int:
    """Return the index of a rendering's sample at a time."""
    last = (result.y.shape[1] - 1) / result.fs
    if not 0 <= design_value(name, "float", seconds) <= last + 0.5 / result.fs:
        raise BadValue(f"{name} = {seconds!r} s is outside the rendering, which is 0 to {last:g} s")
    return min(round(seconds * result.fs), result.y.shape[1] - 1)


@public
def film(
    result: Rendering,
    path: str | os.PathLike[str],
    fps: float = 20.0,
    start: float = 0.0,
    stop: float | None = None,
    width: float = BLOCK,
    height: float = BLOCK,
    radius: float = RADIUS,
    join: Join = "mean",
    progress_bar: bool = True,
) -> int:
    """Draw pictures in sequence, as a GIF or as PNG files in a folder.

    Each is a picture as ``picture`` draws it.

    Parameters
    ----------
    result : Rendering
        See ``picture``.
    path : path
        ``.gif``, whole or not at all; without a suffix a folder, which gets
        ``frame_0000.png`` and so on.
    fps : float
        Pictures per second, of a GIF 50 at most; the film takes as long as the movement
        did, to 1/100 s.
    start, stop : float
        In s; by default all of it.
    width, height, radius, join
        See ``picture``.
    progress_bar : bool
        Whether a terminal sees how far it is: a picture takes about 0.1 s.

    Returns
    -------
    int
        Number of pictures.

    Raises
    ------
    BadValue
        Another suffix, times outside the rendering or in the wrong order, fps not above
        0 or more than a GIF has, what ``picture`` refuses; pictures that would take
        more than ``limits.render_bytes``; a folder with more pictures than the film.
    SinkError
        Where nothing can be written.

    Examples
    --------
    >>> import tempfile, numpy as np, stimlib
    >>> from stimlib.scenes import soft_surface
    >>> from stimlib.soft import film
    >>> hand = {
    ...     "x": np.linspace(0.03, 0.09, 100),
    ...     "y": np.full(100, 0.06),
    ...     "press": np.full(100, 0.8),
    ... }
    >>> film(
    ...     stimlib.render(soft_surface("deformation"), hand, fs=1000),
    ...     tempfile.mkdtemp() + "/soft.gif",
    ...     fps=20,
    ... )
    2
    """
    FigureCanvasAgg = package("matplotlib.backends.backend_agg", "a film").FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    if path.suffix.lower() not in ("", ".gif"):
        raise BadValue(
            f"film: {path} ends in {path.suffix!r}; write a .gif, or PNG files into a folder, whose"
            " name has no suffix"
        )
    samples = _samples(result, fps, start, stop)
    if path.suffix and fps > FASTEST:
        raise BadValue(
            f"film: a GIF shows {FASTEST} pictures a second at most, not {fps:g}; use fewer, or"
            " write into a folder"
        )
    if not path.suffix and (next_one := path / f"frame_{len(samples):04d}.png").exists():
        raise BadValue(
            f"film: {next_one} is of a longer film, and would follow this one; give another folder"
        )
    figure = Figure(figsize=(4.8, 3.6), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = _axes(figure)

    def pictures():
        with progress("film", len(samples), progress_bar) as done:
            for k in samples:
                _draw(axes, _indenters(result, k), width, height, radius, join)
                canvas.draw()
                yield np.array(canvas.buffer_rgba())[..., :3]
                done(1)

    if path.suffix:
        safe_files.publish(path, _gif(pictures(), fps))
    else:
        safe_files.make_folder(path)
        for i, pixels in enumerate(pictures()):
            safe_files.publish(path / f"frame_{i:04d}.png", _coded([pixels], "PNG"))
    return len(samples)


def _samples(result: Rendering, fps: float, start: float, stop: float | None) -> list[int]:
    """Return the indices of the samples that a film shows."""
    design_value("film: fps", "Above0", fps)
    first = _sample(result, "start", start)
    last = result.y.shape[1] - 1 if stop is None else _sample(result, "stop", stop)
    if last < first:
        raise BadValue(f"film: stop = {stop!r} s is before start = {start!r} s")
    count = float(np.floor((last - first) / result.fs * fps + 1e-9)) + 1
    limits.check(
        "render_bytes", 480 * 360 * 4.0 * count, f"film: bytes of {count:g} pictures in memory"
    )
    return [first + round(i * result.fs / fps) for i in range(int(count))]


def _gif(pictures: Iterable[NDArray[np.uint8]], fps: float) -> bytes:
    """Write RGB pictures as a GIF with correct timing.

    A GIF counts time in 1/100 s, so the remainder of one picture is added to the next.
    """
    shown = [*pictures]
    ticks = np.rint(np.arange(len(shown) + 1) * 100 / fps).astype(int)
    return _coded(
        shown, "GIF", save_all=True, loop=0, duration=[10 * int(n) for n in np.diff(ticks)]
    )


def _coded(pictures: list[NDArray[np.uint8]], kind: str, **words: Any) -> bytes:
    from PIL import Image

    first, *rest = (Image.fromarray(pixels) for pixels in pictures)
    data = io.BytesIO()
    first.save(data, kind, **({"append_images": rest} | words if rest else words))
    return data.getvalue()
