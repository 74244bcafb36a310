"""Scene files that are run again when they are saved."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import StimlibError
from .app import failed, say
from .scene import run_files, scene_of

LOOK = 0.05
"""Seconds between two looks at the files."""


class Watched:
    """The files of SCENE and --import, which may be saved while the scene plays.

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
        self._seen, self._content = self._stamps(), self._contents()

    def _stamps(self) -> list[tuple[float, int]]:
        return [(s.st_mtime, s.st_ino) if (s := _stat(p)) else (0.0, 0) for p in self.paths]

    def _contents(self) -> list[bytes]:
        return [Path(p).read_bytes() if _stat(p) else b"" for p in self.paths]

    @contextmanager
    def reloaded(
        self, played: Callable[[Any], None], told: Callable[[str], None] = lambda why: None
    ) -> Iterator[None]:
        """Let a new scene play each time one of the files is saved.

        Parameters
        ----------
        played : callable
            ``played(scene)`` lets it take the place of the one before.
        told : callable
            ``told(why)`` is called where a file, or the scene in it, cannot be used.
            The terminal says it as well.
        """
        over = threading.Event()
        thread = threading.Thread(
            target=self._run, args=(over, played, told), name="stimlib watch", daemon=True
        )
        if self.paths:
            thread.start()
        try:
            yield
        finally:
            over.set()
            if self.paths:
                thread.join(2.0)

    def _run(
        self, over: threading.Event, played: Callable[[Any], None], told: Callable[[str], None]
    ) -> None:
        while not over.wait(LOOK):
            if (saved := self._saved(over)) is None:
                continue
            try:
                run_files(self.files)
                played(scene_of(self.scene))
                say(f"{self.scene}: plays, {time.time() - saved:.2f} s after it was saved")
            except (Exception, SystemExit) as e:
                why = str(e) if isinstance(e, StimlibError) else f"{type(e).__name__}: {e}"
                failed(f"{why}; the version before plays on")
                told(why)

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
        before, self._seen, self._content = self._content, now, self._contents()
        return None if self._content == before else max(at for at, _ in now)


def _stat(path: str) -> Any:
    """Return what the system knows of a file; None for none, which may be replaced."""
    try:
        return Path(path).stat()
    except OSError:
        return None
