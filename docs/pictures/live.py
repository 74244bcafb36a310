"""What `stimlib live` shows: python docs/pictures/live.py [SCENE ..] writes pictures
beside itself. It needs Chromium.
"""

import math
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "tests" / "live"))
from chromium import Browser  # noqa: E402

from stimlib.live.server import Server  # noqa: E402
from stimlib.live.stream import Stream  # noqa: E402
from stimlib.scenes import SHIPPED  # noqa: E402

WIDE = 1240
HANDS = {  # u, v, pressure at time t, and for how long: a curve shows two seconds
    "squeeze": ("0.47 - 0.45 * Math.cos(4 * t)", "0.5", "0.5", 2.55),
    "bumps": ("0.08 + 0.3 * t", "0.5", "0.5", 2.5),
    "viscoelastic": ("0.1 + 0.6 * Math.min(1, Math.max(0, (t - 1) / 0.4))", "0.5", "0.5", 2.7),
    "soft_surface": (
        "0.53 + 0.23 * Math.cos(1.7 * t)",
        "0.58 + 0.2 * Math.sin(1.7 * t)",
        "0.82 + 0.12 * Math.cos(4 * t - 10.4)",
        2.6,
    ),
}
MOVE = """import('./live.js').then(({live}) => new Promise(done => {
    // to the longest time in ms in which nothing was moved
    const begun = performance.now();
    let last = begun, longest = 0;
    const timer = setInterval(() => {
        const now = performance.now(), t = (now - begun) / 1000;
        live.field.put(0, %s, %s, %s, 1);
        longest = Math.max(longest, now - last);
        last = now;
        if (t > %s) { // done when the numbers are those of the curves
            clearInterval(timer);
            setTimeout(() => done(longest), 350);
        }
    }, 5); }))"""
SMOOTH, TIMES = 25.0, 20  # ms: on a busy machine the hand jumps; the smoothest of so many is taken


def pictured(browser, name, path, theme="light", **more):
    """The page of a scene that was started and moved over."""
    stream = Stream(SHIPPED[name](), title=name.replace("_", " "))
    stream.warm_up()
    with Server(stream) as server:
        page = browser.page(server.url, WIDE)
        page.media(prefers_color_scheme=theme)
        page.until("!document.querySelector('#run').disabled")
        page.js("document.querySelector('#run').click()")
        page.until("document.querySelector('#run').textContent === 'Stop'")
        page.size(
            WIDE,
            math.ceil(page.js("document.querySelector('main').getBoundingClientRect().bottom")),
        )
        best = math.inf
        for _ in range(TIMES):
            if (gap := page.js(MOVE % HANDS[name])) < best:
                best = gap
                page.picture(path, **more)
            if best < SMOOTH:
                break
        page.close()
    return best


if __name__ == "__main__":
    browser = Browser()
    for name in sys.argv[1:] or HANDS:
        gap = pictured(browser, name, HERE / f"live_{name}.webp", format="webp", quality=80)
        print(f"{name}: {gap:.0f} ms")
    browser.close()
