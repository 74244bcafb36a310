"""What the gallery shows of a program: its ``figure`` and the sounds that it wrote.

Everything is in the page itself.  The thumbnail is one panel of the figure alone, so
that it can be read.
"""

import base64
from pathlib import Path

from sphinx_gallery.scrapers import figure_rst

SOUND = """
.. raw:: html

    <audio controls src="data:audio/wav;base64,{data}"></audio>
    <p>{name}, above 20 Hz</p>
"""


def shown(block, block_vars, gallery_conf):
    """Save the pictures of a program, and return its page to sphinx-gallery."""
    figure = block_vars["example_globals"]["figure"]
    panel(figure, next(block_vars["image_path_iterator"]))  # the first one is the thumbnail
    path = next(block_vars["image_path_iterator"])
    figure.savefig(path, dpi=80)
    rst = figure_rst([path], gallery_conf["src_dir"])
    for sound in sorted(Path(block_vars["src_file"]).parent.glob("*.wav")):
        rst += SOUND.format(
            data=base64.b64encode(sound.read_bytes()).decode(), name=sound.stem.replace("_", " ")
        )
        sound.unlink()
        sound.with_name(sound.name + ".json").unlink()
    return rst


def panel(figure, path):
    """Save the panel of a figure that fills a thumbnail of 400 x 280 pixels best."""
    figure.draw_without_rendering()
    sizes = [axes.get_window_extent() for axes in figure.axes]
    fill = [round(min(size.width, size.height * 400 / 280), -1) for size in sizes]
    best = figure.axes[fill.index(max(fill))]
    box = best.get_tightbbox().padded(6)
    figure.savefig(path, dpi=120, bbox_inches=box.transformed(figure.dpi_scale_trans.inverted()))
