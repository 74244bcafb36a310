"""What `stimlib experiment run --page` shows, and with `--sink page`: python
docs/pictures/asking.py writes it beside itself. It needs Chromium.
"""

import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parents[1] / "tests" / "live"), str(HERE.parents[1] / "examples")]
from chromium import Browser, Page  # noqa: E402
from which_is_softer import softer  # noqa: E402

from stimlib.errors import SinkError  # noqa: E402
from stimlib.experiments.experiment import Experiment  # noqa: E402
from stimlib.experiments.papers.nodule_sizes import nodule_sizes  # noqa: E402
from stimlib.experiments.runner import run  # noqa: E402
from stimlib.experiments.session import Session  # noqa: E402
from stimlib.live.experiment import ExperimentPage  # noqa: E402
from stimlib.live.server import Server  # noqa: E402

ASKED = "document.querySelector('#text').textContent.startsWith({!r})"
GUARD = "new Promise(done => setTimeout(done, 300))"


def session(asking: ExperimentPage, made: Experiment, sink: str, data: str) -> None:
    try:
        with Session(made, data, "P07", pilot=True) as running, asking:
            run(running, asking, asking.display(made, sink))
    except SinkError:
        pass  # the server has ended, and with it the session


@contextmanager
def begun(made: Experiment, sink: str, wide: int, high: int) -> Iterator[Page]:
    """The page of a session whose first trial has begun."""
    with tempfile.TemporaryDirectory() as data:
        asking = ExperimentPage(print)
        thread = threading.Thread(target=session, args=[asking, made, sink, data])
        with Server(asking) as server:
            thread.start()
            browser = Browser()
            page = browser.page(server.url, wide, high)
            page.until(ASKED.format("Trial 1"))
            page.js(GUARD)
            page.key(" ")
            yield page
            browser.close()
        thread.join()


if __name__ == "__main__":
    with begun(softer, "offline", 760, 460) as page:
        page.until(ASKED.format("Which"))
        page.js(GUARD)
        page.picture(HERE / "asking.webp", format="webp", quality=80)
    with begun(nodule_sizes(), "page", 760, 720) as page:
        page.until(ASKED.format("Feel"))
        page.until("document.querySelector('#picture').width > 300")
        page.js(GUARD)
        x, y = page.at("#picture", 0.62, 0.4)
        for kind in ("Pressed", "Moved"):
            page.mouse(kind, x, y, "pen", 0.85)
        page.js("new Promise(done => setTimeout(done, 1500))")
        page.picture(HERE / "asking_surface.webp", format="webp", quality=80)
