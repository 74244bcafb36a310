"""A scene that a reader of these pages can play with: ``.. played:: squeeze``."""

from pathlib import Path

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from stimlib.errors import MissingPackage
from stimlib.live.share import share
from stimlib.motion.text import parse_motion
from stimlib.scenes import ROWS, SHIPPED

FRAME = (
    '<iframe src="{way}" title="{name}, to play with" loading="lazy" allow="autoplay"'
    ' style="width: 100%; height: 720px; border: 0"></iframe>'
)


MADE: set[Path] = set()  # by this build


class Played(SphinxDirective):
    """The shared page of a shipped scene in a frame.

    It is compiled anew by each build, so that it is never older than the code. Where no
    compiler for WebAssembly is installed, a note says how to get the page.
    """

    required_arguments = 1

    def run(self):
        (name,) = self.arguments
        builder = self.env.app.builder
        if builder.format != "html":
            return []
        path = Path(builder.outdir) / "_played" / f"{name}.html"
        path.parent.mkdir(exist_ok=True)
        motion = {i: parse_motion(text) for i, text in ROWS[name].drive.items()}
        try:
            if path not in MADE:
                share(SHIPPED[name](), 8000.0, path, motion, title=name)
            MADE.add(path)
        except MissingPackage:
            said = nodes.paragraph(
                "", "These pages were built without a compiler for WebAssembly. "
            )
            said += nodes.Text("To play with this scene in your browser: ")
            said += nodes.literal("", f"stimlib share {name} --out page.html")
            return [nodes.note("", said)]
        up = "../" * self.env.docname.count("/")
        way = f"{up}_played/{name}.html"
        frame = nodes.raw("", FRAME.format(way=way, name=name), format="html")
        link = nodes.raw("", f'<p><a href="{way}">The page alone</a></p>', format="html")
        return [frame, link]
