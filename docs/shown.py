"""What the gallery shows of a program: its ``figure`` and the sounds that it wrote.

Everything is in the page itself.  The thumbnail is one panel of the figure alone, drawn
anew at its size, so that it can be read.
"""

import base64
from pathlib import Path

from sphinx_gallery.scrapers import figure_rst

# the output whose course over position is the thumbnail, rather than the first panel
OVER_POSITION = {"click": "force", "ultrasonic_friction": "force", "soft_surface": "depth1"}
SOUND = """
.. raw:: html

    <audio controls src="data:audio/wav;base64,{data}"></audio>
    <p>{name}, above 20 Hz</p>
"""


def shown(block, block_vars, gallery_conf):
    """Save the pictures of a program, and return its page to sphinx-gallery."""
    figure = block_vars["example_globals"]["figure"]
    thumbnail, path = (next(block_vars["image_path_iterator"]) for _ in range(2))
    figure.savefig(path, dpi=80)
    title = Path(block_vars["src_file"]).read_text().partition('"""\n')[2].partition("\n")[0]
    rst = figure_rst([path], gallery_conf["src_dir"], f"{title}: {axes_of(figure)}")
    scene = Path(block_vars["src_file"]).stem.removeprefix("plot_")
    panel(figure, thumbnail, OVER_POSITION.get(scene))  # nothing else is left of the figure
    for sound in sorted(Path(block_vars["src_file"]).parent.glob("*.wav")):
        rst += SOUND.format(
            data=base64.b64encode(sound.read_bytes()).decode(), name=sound.stem.replace("_", " ")
        )
        sound.unlink()
        sound.with_name(sound.name + ".json").unlink()
    return rst


def axes_of(figure):
    """Return what each panel shows, for readers who do not see it."""
    shown = {}
    for axes in figure.axes:
        below = [a.get_xlabel() for a in axes.get_shared_x_axes().get_siblings(axes)]
        beside = [a.get_ylabel() for a in axes.get_shared_y_axes().get_siblings(axes)]
        over = next(filter(None, [axes.get_xlabel(), *below]), "")
        what = next(filter(None, [axes.get_ylabel(), *beside, axes.get_title()]), "")
        said = f"{what} over {over}" if over and what else over or what
        shown[" ".join(said.split())] = None
    return "; ".join(filter(None, shown))


def panel(figure, path, over=None):
    """Save the panel of a figure that fills a thumbnail of 400 x 280 pixels best.

    With ``over``, save the course of that output over position.
    """
    figure.draw_without_rendering()
    wanted = [
        axes
        for axes in figure.axes
        if over is None or (axes.get_ylabel() == over and axes.get_title().startswith("over"))
    ]
    sizes = [axes.get_window_extent() for axes in wanted]
    fill = [round(min(size.width, size.height * 400 / 280), -1) for size in sizes]
    best = wanted[fill.index(max(fill))]
    siblings = best.get_shared_x_axes().get_siblings(best)
    best.set_xlabel(next(filter(None, (axes.get_xlabel() for axes in siblings)), ""))
    for axes in figure.axes:
        if axes is not best:
            axes.remove()
    figure.set_layout_engine("none")
    around = best.figure.bbox
    size = figure.get_size_inches() * figure.dpi / (around.width, around.height)
    figure.set_size_inches(size * (3.0, 2.1))  # 9 points are read in a thumbnail
    best.set_position((0.2, 0.2, 0.75, 0.65))
    best.tick_params(labelbottom=True, labelleft=True)
    for axis in (best.xaxis, best.yaxis):
        if axis.get_scale() == "linear" and hasattr(axis.get_major_locator(), "set_params"):
            best.locator_params(axis.axis_name, nbins=4)
    figure.draw_without_rendering()
    box = best.get_tightbbox().padded(6)
    figure.savefig(path, dpi=133, bbox_inches=box.transformed(figure.dpi_scale_trans.inverted()))
