"""The built documentation, and a report, as a browser lays them out.

    PYTHONPATH=tests python tests/docs_pages.py docs/_build

It prints figures of code blocks at three widths, of weight and time to the first
drawing, and what is wrong with which page; the exit status is 1 if anything is.
"""

from __future__ import annotations

import re
import sys
import tempfile
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
)
BEGIN = ("install.html", "page.html", "first_experiment.html")
ENDS = """Object.fromEntries([...document.querySelectorAll('article a')].map(
  a => [a.getAttribute('href').split('/').pop(), a.getBoundingClientRect().bottom]).reverse())"""
LOOK = """(() => {
  const all = document.documentElement, code = [...document.querySelectorAll('pre')];
  const seen = code.filter(p => p.getClientRects().length);
  return {
    blocks: seen.length,
    cut: seen.map(p => p.scrollWidth - p.clientWidth).filter(d => d > 0),
    over: all.scrollWidth - all.clientWidth,
    images: [...document.images].map(i => [i.getAttribute('src'), i.alt.trim()]),
    gone: [...document.images].filter(i => !i.loading || i.loading == 'eager')
      .filter(i => !i.naturalWidth).map(i => i.getAttribute('src')),
    silent: [...document.querySelectorAll('.highlight')]
      .filter(h => !h.querySelector('.copybtn')).length,
    sounds: document.querySelectorAll('audio').length,
    shown: [...document.querySelectorAll('article .shown a.internal')]
      .map(a => a.href.split('/').pop()).filter(name => name.startsWith('plot_')),
  }
})()"""
COST = """(() => {
  const paint = performance.getEntriesByName('first-contentful-paint')[0];
  const parts = ['navigation', 'resource'].flatMap(t => performance.getEntriesByType(t));
  const size = parts.reduce((sum, e) => sum + e.encodedBodySize, 0);
  return [size, parts.length, paint ? paint.startTime : null]
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


def looks(root: Path, browser: Browser, base: str) -> list[str]:
    """What is wrong on any page, at each width; code blocks are counted on the way."""
    faults, counted = [], {wide: [0, 0] for wide in WIDTHS}
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
            counted[wide][1] += len(found["cut"])
            if found["cut"]:
                faults.append(f"{name} at {wide} px: {len(found['cut'])} code blocks are cut")
            if found["over"] > 0:
                faults.append(f"{name} at {wide} px: {found['over']} px wider than the window")
        faults += [f"{name}: {src} has no alt text" for src, alt in found["images"] if not alt]
        faults += [f"{name}: {src} does not load" for src in found["gone"]]
        if found["silent"]:
            faults.append(f"{name}: {found['silent']} code blocks have no copy button")
        if name.parent.name in ("blocks", "scenes") and name.parts[0] == "reference":
            faults += [f"{name}: {why}" for why in _shown(root, name, found)]
    page.close()
    for wide, (blocks, cut) in counted.items():
        print(f"{wide} px: {cut} of {blocks} code blocks are cut")
    return faults


def _shown(root: Path, name: Path, found: dict) -> list[str]:
    """What a reference page lacks of the pages of the gallery that it shows."""
    if name.stem == "index":
        return []
    linked = [root / "gallery" / name.parent.name / page for page in set(found["shown"])]
    sounds = sum(page.read_text().count("<audio") for page in linked)
    why = [] if linked else ["no link to the gallery"]
    if sum("plot_" in src for src, _ in found["images"]) < len(linked):
        why.append("no picture of a linked page of the gallery")
    if found["sounds"] < sounds:
        why.append(f"{found['sounds']} of {sounds} sounds")
    return why


def front(browser: Browser, base: str) -> list[str]:
    """What of the front page is not seen without scrolling."""
    faults = []
    for wide, high in ((390, 844), (1440, 900)):
        page = browser.page(f"{base}/index.html", wide, high)
        ends = page.js(ENDS)
        low = {name: ends.get(name, 1e9) for name in BEGIN}
        print(f"front page at {wide} x {high}: the three links end at {max(low.values()):.0f} px")
        faults += [f"index.html at {wide} px: {n} is below" for n, y in low.items() if y > high]
        sentence = page.js("document.querySelector('article p').textContent")
        if found := re.findall(r"\b(?:graph|pure|processor)s?\b", sentence):
            faults.append(f"index.html: its first sentence says {found}")
        page.close()
    return faults


def searches(browser: Browser, base: str) -> list[str]:
    """The words that the search of the pages does not find."""
    faults = []
    page = browser.page(f"{base}/index.html")
    for word in SEARCHED:
        page.go(f"{base}/search.html?q={word.replace(' ', '+')}")
        try:
            page.until("document.querySelectorAll('#search-results li').length", 10)
        except TimeoutError:
            faults.append(f"search: nothing is found for {word}")
    page.close()
    print(f"search: {len(SEARCHED) - len(faults)} of {len(SEARCHED)} words lead to a page")
    return faults


def copies(browser: Browser, base: str) -> list[str]:
    """Whether a command is copied whole, without its prompt."""
    page = browser.page(f"{base}/tutorial/install.html")
    browser.call("Browser.grantPermissions", permissions=["clipboardReadWrite"])
    page.until("!!document.querySelector('.highlight-console .copybtn')")
    page.js("document.querySelector('.highlight-console .copybtn').click()")
    page.until("!!document.querySelector('.copybtn.success')", 5)
    copied = page.js("navigator.clipboard.readText()")
    page.close()
    print(f"copied: {copied.strip()!r}")
    return [] if copied.strip() == "stimlib --version" else [f"the copied text is {copied!r}"]


def costs(browser: Browser, base: str, name: str) -> None:
    page = browser.page(f"{base}/{name}", 390, 844)
    page.js("new Promise(done => setTimeout(done, 300))")
    size, parts, first = page.js(COST)
    page.close()
    print(f"{name}: {size / 1000:.0f} kB in {parts} files, first drawing after {first or 0:.0f} ms")


def report(path: Path) -> None:
    """Write the report of a shipped scene."""
    import stimlib
    from stimlib.motion import minimum_jerk

    scene, motion = stimlib.scenes.squeeze(fingers=1), {"x1": minimum_jerk()}
    rendered = stimlib.render(scene, motion, fs=8000, seconds=2.0)
    stimlib.verify(scene, motion, rendered).to_html(path)


def faults_of(root: Path) -> list[str]:
    """All that is wrong with the pages in a folder."""
    with closing(Browser()) as browser, served(root) as base:
        faults = looks(root, browser, base) + front(browser, base) + searches(browser, base)
        faults += copies(browser, base)
        for name in ("index.html", "gallery/scenes/plot_squeeze.html"):
            costs(browser, base, name)
    with closing(Browser()) as browser, tempfile.TemporaryDirectory() as folder:
        report(Path(folder) / "report.html")
        with served(Path(folder)) as base:
            costs(browser, base, "report.html")
    return faults


if __name__ == "__main__":
    if where() is None:
        sys.exit("Chromium is not installed: tests/devices/install.sh installs it")
    found = faults_of(Path(sys.argv[1]).resolve())
    print("\n".join(found) or "nothing is wrong")
    sys.exit(bool(found))
