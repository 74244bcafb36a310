"""What `stimlib experiment run --page` shows: python docs/pictures/asking.py writes it
beside itself. It needs Chromium.
"""

import sys
import tempfile
import threading
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parents[1] / "tests" / "live"), str(HERE.parents[1] / "examples")]
from chromium import Browser  # noqa: E402
from which_is_softer import softer  # noqa: E402

from stimlib.errors import SinkError  # noqa: E402
from stimlib.experiments.runner import run  # noqa: E402
from stimlib.experiments.session import Session  # noqa: E402
from stimlib.live.experiment import ExperimentPage  # noqa: E402
from stimlib.live.server import Server  # noqa: E402

ASKED = "document.querySelector('#text').textContent.startsWith({!r})"
GUARD = "new Promise(done => setTimeout(done, 300))"


def session(asking: ExperimentPage, data: str) -> None:
    try:
        with Session(softer, data, "P07", pilot=True) as running, asking:
            run(running, asking, asking.display(softer, "offline"))
    except SinkError:
        pass  # the server has ended, and with it the session


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as data:
        asking = ExperimentPage(print)
        thread = threading.Thread(target=session, args=[asking, data])
        with Server(asking) as server:
            thread.start()
            browser = Browser()
            page = browser.page(server.url, 760, 460)
            page.until(ASKED.format("Trial 1"))
            page.js(GUARD)
            page.key(" ")
            page.until(ASKED.format("Which"))
            page.js(GUARD)
            page.picture(HERE / "asking.webp", format="webp", quality=80)
            browser.close()
        thread.join()
