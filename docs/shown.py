"""What the gallery shows of a program: its ``figure``, and the sound files that it
wrote.  Everything is in the page itself.
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
    """An image scraper, as sphinx-gallery calls them."""
    path = next(block_vars["image_path_iterator"])
    block_vars["example_globals"]["figure"].savefig(path, dpi=80)
    rst = figure_rst([path], gallery_conf["src_dir"])
    for sound in sorted(Path(block_vars["src_file"]).parent.glob("*.wav")):
        rst += SOUND.format(
            data=base64.b64encode(sound.read_bytes()).decode(), name=sound.stem.replace("_", " ")
        )
        sound.unlink()
        sound.with_name(sound.name + ".json").unlink()
    return rst
