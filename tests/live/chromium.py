"""A headless Chromium by the DevTools protocol, with nothing but `websockets`: pages,
pointers of three kinds, keys, pictures.
"""

from __future__ import annotations

import atexit
import base64
import contextlib
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from waiting import ENDS_TOO, until
from websockets.sync.client import connect

NAMES = "chromium", "chromium-browser", "google-chrome"
FLAGS = (
    "--headless=new",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-sync",
    "--disable-extensions",
    "--disable-component-update",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--mute-audio",
    "--hide-scrollbars",
    "--autoplay-policy=no-user-gesture-required",
    "--remote-debugging-port=0",
)
KEYS = {
    " ": ("Space", 32),
    "Enter": ("Enter", 13),
    "ArrowLeft": ("ArrowLeft", 37),
    "ArrowRight": ("ArrowRight", 39),
    "End": ("End", 35),
    "Home": ("Home", 36),
    "PageUp": ("PageUp", 33),
    "Tab": ("Tab", 9),
}


def where() -> str | None:
    """The program, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """One browser with a profile of its own; both are gone after ``close``, or when the
    program ends.
    """

    def __init__(self, *flags: str):
        self._exit = contextlib.ExitStack()
        atexit.register(self.close)
        folder = self._exit.enter_context(
            tempfile.TemporaryDirectory(prefix="stimlib-chromium-", ignore_cleanup_errors=True)
        )
        sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []  # it refuses root otherwise
        self.process = subprocess.Popen(
            [
                *ENDS_TOO,
                where() or NAMES[0],
                *FLAGS,
                *sandbox,
                *flags,
                f"--user-data-dir={folder}",
                "about:blank",
            ],
            # or reports of crashes stay in HOME
            env=os.environ | {"XDG_CONFIG_HOME": folder, "XDG_CACHE_HOME": folder},
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._exit.callback(self._end)
        told = Path(folder, "DevToolsActivePort")

        def port():
            assert self.process.poll() is None, "Chromium did not open its DevTools port"
            words = told.read_text().split() if told.exists() else []
            return len(words) == 2 and words

        number, path = until(port)
        self.socket = self._exit.enter_context(
            connect(f"ws://127.0.0.1:{number}{path}", max_size=None, ping_interval=None)
        )
        self.last, self.events = 0, []

    def call(self, method: str, session: str | None = None, **params: Any) -> dict:
        self.last += 1
        mine, to = self.last, {"sessionId": session} if session else {}
        self.socket.send(json.dumps({"id": mine, "method": method, "params": params} | to))
        begun = time.monotonic()
        while True:
            # of all answers together: events alone would let it wait for ever
            left = max(0.0, begun + 120 - time.monotonic())
            m = json.loads(self.socket.recv(timeout=left))
            if m.get("id") == mine:
                if "error" in m:
                    raise RuntimeError(f"{method}: {m['error']}")
                return m["result"]
            self.events = [*self.events[-500:], m]

    def page(self, url: str, wide: int = 1240, high: int = 900) -> Page:
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        page = Page(
            self,
            target,
            self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"],
        )
        for domain in ("Page", "Runtime", "Log"):
            page.call(f"{domain}.enable")
        page.size(wide, high)
        page.go(url)
        return page

    def close(self) -> None:
        atexit.unregister(self.close)
        with contextlib.suppress(Exception):
            self.call("Browser.close")
        self._exit.close()

    def _end(self) -> None:
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)  # a group of its own
            self.process.wait()


class Page:
    def __init__(self, browser: Browser, target: str, session: str):
        self.browser, self.target, self.session = browser, target, session

    def call(self, method: str, **params: Any) -> dict:
        return self.browser.call(method, self.session, **params)

    def go(self, url: str) -> None:
        self.call("Page.navigate", url=url)
        self.until("document.readyState === 'complete' && location.href !== 'about:blank'")

    def reload(self) -> None:
        self.js("window.old = true")
        self.call("Page.reload")
        self.until("!window.old && document.readyState === 'complete'")

    def close(self) -> None:
        self.browser.call("Target.closeTarget", targetId=self.target)

    def complaints(self) -> list[str]:
        """What the console was told of errors: exceptions, what the content policy
        refused.
        """
        told = [e for e in self.browser.events if e.get("sessionId") == self.session]
        logged = [e["params"]["entry"] for e in told if e["method"] == "Log.entryAdded"]
        thrown = [e["params"] for e in told if e["method"] == "Runtime.exceptionThrown"]
        return [e["text"] for e in logged if e["level"] == "error"] + [
            str(e["exceptionDetails"]) for e in thrown
        ]

    def size(self, wide: int, high: int, ratio: float = 1.0) -> None:
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=wide,
            height=high,
            deviceScaleFactor=ratio,
            mobile=False,
        )

    def media(self, **features: str) -> None:
        """media(prefers_color_scheme="dark")"""
        self.call(
            "Emulation.setEmulatedMedia",
            features=[{"name": k.replace("_", "-"), "value": v} for k, v in features.items()],
        )

    def js(self, text: str) -> Any:
        """The value of an expression; a promise is awaited."""
        r = self.call(
            "Runtime.evaluate",
            expression=text,
            returnByValue=True,
            awaitPromise=True,
            userGesture=True,
        )
        if "exceptionDetails" in r:
            raise RuntimeError(
                r["exceptionDetails"]
                .get("exception", {})
                .get("description", r["exceptionDetails"]["text"])
            )
        return r["result"].get("value")

    def until(self, text: str, seconds: float = 300.0) -> Any:
        """Waits until an expression is true; gives its value."""
        return until(lambda: self.js(text), f"not within {seconds} s: {text}", seconds, 0.03)

    def box(self, css: str) -> list[float]:
        return self.js(
            "(r => [r.left, r.top, r.width,"
            f" r.height])(document.querySelector({css!r}).getBoundingClientRect())"
        )

    def at(self, css: str, u: float = 0.5, v: float = 0.5) -> tuple[float, float]:
        """A place in an element, from its lower left corner; it is scrolled to."""
        self.js(f"document.querySelector({css!r}).scrollIntoView({{block: 'nearest'}})")
        x, y, w, h = self.box(css)
        return x + u * w, y + (1 - v) * h

    def mouse(
        self, kind: str, x: float, y: float, pointer: str = "mouse", force: float = 0.0
    ) -> None:
        """Pressed, Moved, Released; with pointer "pen" force is the pressure."""
        held = kind != "Released"
        self.call(
            "Input.dispatchMouseEvent",
            type=f"mouse{kind}",
            x=x,
            y=y,
            button="left",
            buttons=int(held),
            clickCount=1,
            pointerType=pointer,
            force=force,
        )

    def click(self, css: str) -> None:
        x, y = self.at(css)
        self.mouse("Pressed", x, y)
        self.mouse("Released", x, y)

    def touch(self, kind: str, *points: tuple[float, float, float]) -> None:
        """Start, Move, End (without points): x, y, force of each finger."""
        fingers = [
            {"x": x, "y": y, "force": f, "id": i, "radiusX": 4, "radiusY": 4}
            for i, (x, y, f) in enumerate(points)
        ]
        self.call("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=fingers)

    def key(self, key: str, seconds: float = 0.0) -> None:
        """Down, held for a while, up."""
        code, number = KEYS.get(key) or (f"Key{key.upper()}", ord(key.upper()))
        more, text = (
            {"key": key, "code": code, "windowsVirtualKeyCode": number},
            "\r" if key == "Enter" else key * (len(key) == 1),
        )
        self.call(
            "Input.dispatchKeyEvent", type="keyDown", **more, **({"text": text} if text else {})
        )
        time.sleep(seconds)
        self.call("Input.dispatchKeyEvent", type="keyUp", **more)

    def picture(self, path: str | Path, **more: Any) -> None:
        Path(path).write_bytes(
            base64.b64decode(
                self.call("Page.captureScreenshot", **{"format": "png"} | more)["data"]
            )
        )
