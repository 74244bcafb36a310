"""Sphinx configuration.  The pages use no external host: no formulas by script, no
fonts, no badges.
"""

import logging
import re
import sys
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from jinja2 import FileSystemLoader
from numpydoc import docscrape_sphinx
from sphinx.ext.autosummary import Autosummary
from sphinx.util.docutils import SphinxDirective
from sphinx_gallery import backreferences
from sphinx_gallery.sorting import ExplicitOrder

import stimlib

sys.path.insert(0, str(Path(__file__).parent))  # shown.py, played.py
from played import Played

# a11y_pygments gives the root logger a handler for INFO, which has what is compiled
logging.getLogger("stimlib").setLevel(logging.WARNING)

project = "stimlib"
author = "the stimlib authors"
copyright = author
version = release = stimlib.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "sphinx_copybutton",
]
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
exclude_patterns = ["_build"]
nitpicky = True

autosummary_generate = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say it, with units
autodoc_use_type_comments = False  # there are none, and the search parses every source
numpydoc_show_class_members = False
numpydoc_validation_checks: set[str] = set()
# one for all docstrings, or its template is compiled for each of them
docstrings = docscrape_sphinx.SandboxedEnvironment(
    loader=FileSystemLoader(Path(docscrape_sphinx.__file__).parent / "templates")
)
docscrape_sphinx.SandboxedEnvironment = lambda loader: docstrings

sphinx_gallery_conf = {  # written beside the pages; -D plot_gallery=0 runs none of the programs
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "subsection_order": ExplicitOrder(["../examples/gallery/scenes", "../examples/gallery/blocks"]),
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("shown.shown",),
    "capture_repr": (),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "write_computation_times": False,
    "show_signature": False,
    "min_reported_time": 3600,
}

backreferences.THUMBNAIL_TEMPLATE = backreferences.THUMBNAIL_TEMPLATE.replace(
    ":alt:", ":alt: A panel of: {title}"
)

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_title = f"stimlib {version}"
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False


class Functions(Autosummary):
    """A line for each function that these pages beside it document, by default all:
    what a page documents is then listed nowhere else.
    """

    def run(self):
        folder = Path(self.env.doc2path(self.env.docname)).parent
        pages = [folder / f"{name}.rst" for name in self.content] or sorted(folder.glob("*.rst"))
        found = []
        for page in pages:
            self.env.note_dependency(str(page))
            documented = rf"autofunction:: stimlib\.{folder.name}\.(\w+)$"
            found += re.findall(documented, page.read_text(), re.M)
        self.content = StringList(found, source=self.env.docname)
        return super().run()


class Shown(SphinxDirective):
    """Pictures and sounds of pages of the gallery, each with a link to its page.

    Without the programs' output (-D plot_gallery=0) the links stand alone.
    """

    has_content = True

    def run(self):
        lines = [".. container:: shown", ""]
        for name in self.content:
            path = Path(self.env.srcdir) / "gallery" / f"{name}.rst"
            self.env.note_dependency(str(path))
            text = path.read_text()
            drawn = re.search(r"^\.\. image-sg:: (\S+)\n   :alt: (.+)", text, re.M)
            sounds = re.findall(r"^ +<audio.*\n +<p>.*</p>$", text, re.M)
            link = f":doc:`/gallery/{name}`"
            if drawn:
                made = [f".. figure:: {drawn[1]}", f"   :alt: {drawn[2]}", "", f"   {link}"]
            else:
                made = [f"In the gallery: {link}"]
            for sound in sounds:
                said = [f"      {line.strip()}" for line in sound.splitlines()]
                made += ["", *("   " * bool(drawn) + line for line in (".. raw:: html", ""))]
                made += said
            lines += [f"   {line}" for line in [*made, ""]]
        around = nodes.Element()
        self.state.nested_parse(StringList(lines, source=self.env.docname), 0, around)
        return around.children


def plain_marks(app, what, name, obj, options, lines):
    """Docstrings are written to be read as text: `name` is code, and a bar is a bar."""
    for i, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            parts = re.split(r"(``.*?``)", line)
            parts[::2] = [
                re.sub(r"(?<!:)`([^`]+)`", r"``\1``\\ ", t).replace("|", r"\|") for t in parts[::2]
            ]
            lines[i] = "".join(parts)


# what has text of its own: on a phone it keeps a width at which that can be read
DRAWING = re.compile(
    r'(?<!tabindex="0">)'
    r'<img [^>]*src="[^"]*_images/(?:[^"]+\.svg|[^"]+_00\d\.png|tutorial_[^"]+)"[^>]*>'
)


def accessible(app, exception):
    """State what the theme leaves out: levels of captions, and which parts scroll.

    A heading needs a level, and what is scrolled sideways must be reached by keyboard.
    """
    for page in Path(app.outdir).glob("**/*.html") if not exception else ():
        text = page.read_text("utf-8")
        whole = text.replace(
            '"caption" role="heading">', '"caption" role="heading" aria-level="2">'
        )
        wrapper = '<div class="table-wrapper'
        whole = whole.replace(wrapper, wrapper.replace("<div", '<div tabindex="0"'))
        whole = DRAWING.sub(r'<div class="drawing" tabindex="0">\g<0></div>', whole)
        if whole != text:
            page.write_text(whole, "utf-8")


def setup(app):
    app.connect("build-finished", accessible)
    app.add_directive("functions", Functions)
    app.add_directive("shown", Shown)
    app.add_directive("played", Played)
    app.connect("autodoc-process-docstring", plain_marks, priority=400)
