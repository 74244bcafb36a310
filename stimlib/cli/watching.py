"""Scene files that are run again when they are saved."""

from __future__ import annotations

import stat
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..errors import StimlibError
from .app import failed, say
from .scene import beside, forget, scene_of

LOOK = 0.05
"""Seconds between two looks at the files."""
NO_FILE = (0.0, 0, 0)
SLOW = 5.0
"""Seconds after which it is said that a scene is still being made."""


class Watched:
    """The files of SCENE and --import, which may be saved while the scene plays.

    The modules that they import from their own folders are watched as well.

    Make it before they are run, so that no change is missed.

    Parameters
    ----------
    scene, files
        SCENE and the --import files of the command line.

    Examples
    --------
    >>> Watched("click_block.py:scene", ["own.py"]).paths
    ['click_block.py', 'own.py']
    >>> Watched("squeeze(fingers=1)", []).paths
    []
    """

    def __init__(self, scene: str, files: Sequence[str]):
        self.scene, self.files = scene, list(files)
        path = scene if scene.endswith((".py", ".json")) else scene.rpartition(":")[0]
        self.paths = [path] * path.endswith((".py", ".json")) + self.files
        self._seen: dict[str, tuple[float, int, int]] = {}
        self._content: dict[str, bytes] = {}
        self._look()

    def _look(self) -> None:
        """Remember the files that have come, as they are now."""
        now = self._stamps()
        new = {path: stamp for path, stamp in now.items() if path not in self._seen}
        self._seen |= new
        self._content |= _contents(new)

    def _stamps(self) -> dict[str, tuple[float, int, int]]:
        # those that could not be imported have been seen before
        found = {p: _stat(p) for p in {*self.paths, *beside(self.paths).values(), *self._seen}}
        return {p: (s.st_mtime, s.st_ino, s.st_size) if s else NO_FILE for p, s in found.items()}

    @contextmanager
    def reloaded(
        self, played: Callable[[Any], Any], told: Callable[[str], None] = lambda why: None
    ) -> Iterator[None]:
        """Let a new scene play each time one of the files is saved.

        Parameters
        ----------
        played : callable
            ``played(scene)`` lets it take the place of the one before, and may return
            what to say in the place of "plays".
        told : callable
            ``told(why)`` is called where a file, or the scene in it, cannot be used.
            The terminal says it as well.
        """
        over = threading.Event()
        self._look()
        thread = threading.Thread(
            target=self._run, args=(over, played, told), name="stimlib watch", daemon=True
        )
        if self.paths:
            thread.start()
        try:
            yield
        finally:
            over.set()  # it may be in a file of the user, so nobody waits for it

    def _run(
        self, over: threading.Event, played: Callable[[Any], Any], told: Callable[[str], None]
    ) -> None:
        while not over.wait(LOOK):
            if (saved := self._saved(over)) is None or over.is_set():
                continue
            slow = threading.Timer(SLOW, say, [f"{self.scene} has not returned for {SLOW:g} s"])
            slow.start()
            try:
                forget(self.paths)  # all of them: one may have what another defines
                made = scene_of(self.scene, self.files)
                self._look()  # at what has been imported
                how = played(made) or "plays"
                say(f"{self.scene}: {how}, {time.time() - saved:.2f} s after it was saved")
            except BaseException as e:  # whatever a file raises
                why = str(e) if isinstance(e, StimlibError) else f"{type(e).__name__}: {e}"
                failed(f"{why}; the version before plays on")
                told(why)
            finally:
                slow.cancel()

    def _saved(self, over: threading.Event) -> float | None:
        """Return when files were saved with another content, or None.

        Editors replace a file, or cut it off and write it anew, so it must be the same
        at two looks.
        """
        now = self._stamps()
        if now == self._seen:
            return None
        while not over.wait(LOOK / 2) and (again := self._stamps()) != now:
            now = again
        self._seen, before, self._content = now, self._content, _contents(now)
        changed = [p for p, text in self._content.items() if before.get(p, text) != text]
        return max(now[p][0] for p in changed) if changed else None


def _contents(stamps: Mapping[str, Any]) -> dict[str, bytes]:
    found = {}
    for path, stamp in stamps.items():
        with suppress(OSError):
            found[path] = b"" if stamp == NO_FILE else Path(path).read_bytes()
    return found


def _stat(path: str) -> Any:
    """Return what the system knows of a regular file; None where there is none."""
    with suppress(OSError, ValueError):
        found = Path(path).stat()
        return found if stat.S_ISREG(found.st_mode) else None
    return None
