"""The built documentation as a browser lays it out.

    PYTHONPATH=tests python tests/docs_pages.py docs/_build

It prints how many code blocks are cut at three widths, and what is wrong with which
page; the exit status is 1 if anything is.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from live.chromium import Browser, where

WIDTHS = {390: 844, 768: 1024, 1440: 900}
SEARCHED = (
    "electrovibration",
    "MATLAB",
    "ERM",
    "LRA",
    "voice coil",
    "friction",
    "vibrotactile",
    "audio interface",
    "sound card",
    "psychophysics",
    "staircase",
    "JND",
    "threshold",
    "texture",
    "pseudo-haptic",
    "Arduino",
    "Teensy",
    "PsychoPy",
    "Unity",
    "calibration",
    "funneling",
    "multichannel",
    "Likert",
    "ASIO",
    "apparent motion",
    "Windows",
    "hardware",
    "source code",
    "repository",
    "report a fault",
    "multiple actuators",
    "bug",
    "license",
    "proof",
)
BEGIN = ("install.html", "#try-it", "first_experiment.html")
ENDS = """Object.fromEntries([...document.querySelectorAll('article a')].map(
  a => [a.getAttribute('href').split('/').pop(), a.getBoundingClientRect().bottom]).reverse())"""
LOOK = """(() => {
  const all = document.documentElement, code = [...document.querySelectorAll('pre')];
  const seen = code.filter(p => p.getClientRects().length);
  return {
    blocks: seen.length,
    outside: performance.getEntriesByType('resource').map(e => e.name)
      .filter(name => !name.startsWith(location.origin)),
    cut: seen.filter(p => p.scrollWidth > p.clientWidth).length,
    over: all.scrollWidth - all.clientWidth,
    bad: [...document.images].filter(i => !i.alt.trim() ||
      (!i.loading || i.loading == 'eager') && !i.naturalWidth).map(i => i.getAttribute('src')),
    small: [...document.querySelectorAll('article img[src$=".svg"]')]
      .filter(i => i.clientWidth < 600).length,
    silent: [...document.querySelectorAll('.highlight')]
      .filter(h => !h.querySelector('.copybtn')).length,
  }
})()"""


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@contextmanager
def served(root: Path) -> Iterator[str]:
    """The address of a folder, while it is served."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(root))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def looks(root: Path, browser: Browser, base: str) -> Iterator[str]:
    """What is wrong on any page, at each width; code blocks are counted on the way."""
    counted = {wide: [0, 0] for wide in WIDTHS}
    page = browser.page(f"{base}/index.html")
    for path in sorted(root.rglob("*.html")):
        name = path.relative_to(root)
        if "_static" in name.parts:
            continue
        page.go(f"{base}/{name}")
        for wide, high in WIDTHS.items():
            page.size(wide, high)
            found = page.js(LOOK)
            counted[wide][0] += found["blocks"]
            counted[wide][1] += found["cut"]
            if wide == min(WIDTHS) and found["small"]:
                yield f"{name} at {wide} px: {found['small']} drawings are too small to read"
            if found["cut"] or found["over"] > 0:
                yield f"{name} at {wide} px: {found['cut']} blocks are cut, {found['over']} px over"
        yield from (f"{name}: loads {place}" for place in found["outside"])
        yield from (f"{name}: {src} has no alt text or does not load" for src in found["bad"])
        if found["silent"]:
            yield f"{name}: {found['silent']} code blocks have no copy button"
    page.close()
    for wide, (blocks, cut) in counted.items():
        print(f"{wide} px: {cut} of {blocks} code blocks are cut")


def front(root: Path, browser: Browser, base: str) -> Iterator[str]:
    """What of the front page is not seen without scrolling."""
    for wide, high in ((390, 844), (1440, 900)):
        page = browser.page(f"{base}/index.html", wide, high)
        ends = page.js(ENDS)
        yield from (
            f"index.html at {wide} px: {n} is below" for n in BEGIN if ends.get(n, 1e9) > high
        )
        sentence = page.js("document.querySelector('article p').textContent")
        if found := re.findall(r"\b(?:graph|pure|processor)s?\b", sentence):
            yield f"index.html: its first sentence says {found}"
        page.close()


def searches(root: Path, browser: Browser, base: str) -> Iterator[str]:
    """The words that the search of the pages does not find."""
    page = browser.page(f"{base}/index.html")
    for word in SEARCHED:
        page.go(f"{base}/search.html?q={word.replace(' ', '+')}")
        try:
            page.until("document.querySelectorAll('#search-results li').length")
        except TimeoutError:
            yield f"search: nothing is found for {word}"
    page.close()


def copies(root: Path, browser: Browser, base: str) -> Iterator[str]:
    """Whether a command is copied whole, without its prompt."""
    page = browser.page(f"{base}/tutorial/install.html")
    browser.call("Browser.grantPermissions", permissions=["clipboardReadWrite"])
    page.until("!!document.querySelector('.highlight-console .copybtn')")
    page.js("document.querySelector('.highlight-console .copybtn').click()")
    page.until("!!document.querySelector('.copybtn.success')")
    if (copied := page.js("navigator.clipboard.readText()").strip()) != "stimlib --version":
        yield f"the copied text is {copied!r}"
    page.close()


def faults_of(root: Path) -> list[str]:
    """All that is wrong with the pages in a folder."""
    with closing(Browser()) as browser, served(root) as base:
        return [fault for look in LOOKS for fault in look(root, browser, base)]


LOOKS = looks, front, searches, copies


if __name__ == "__main__":
    if where() is None:
        sys.exit("Chromium is not installed: tests/devices/install.sh installs it")
    found = faults_of(Path(sys.argv[1]).resolve())
    print("\n".join(found) or "nothing is wrong")
    sys.exit(bool(found))
