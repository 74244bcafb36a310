"""A live scene in a notebook cell, or in a browser next to a running program."""

from __future__ import annotations

import sys
from typing import Any

from ..core.scene import Scene
from ..errors import SinkError
from ..run.safety import Safety
from .server import Server
from .share import Shared, share
from .stream import Stream

NEAR = "http://127.0.0.1:* http://localhost:*"
"""Sites that may show the page in a frame: notebooks on this machine."""
_shown: dict[str, tuple[Server, Stream, Any]] = {}  # by cell, and with which options


def show(
    scene: Scene,
    fs: float = 8000.0,
    safety: Safety | float | None = None,
    *,
    port: int = 0,
    **options: Any,
) -> Server | Shared:
    """Serve a live scene in a thread, as ``Scene.live`` does.

    Parameters
    ----------
    scene, fs, safety, **options
        As for ``stimlib.live.stream.Stream``.
    port : int
        0 chooses a free port.

    Returns
    -------
    Server or Shared
        A notebook shows its page; ``url`` is its address, and ``close()`` fades out and
        ends it.  Where no port can be opened, the page of ``stimlib.live.share.share``,
        which needs none.

        If the cell is run again, the scene takes the place of the one before on the
        same page, as in ``Stream.reload``; with other options, the earlier page is
        closed.  Outside of a notebook, ``title`` does what the cell does.

    Raises
    ------
    MissingPackage
        The extra ``live`` is not installed.
    UnknownName, BadValue, SinkError
        As ``Stream`` and ``Server``.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.live.notebook import show
    >>> page = show(
    ...     stimlib.Scene({"y": 2 * stimlib.Input("x")}), safety=4.0, title="doubled"
    ... )
    >>> page.url.startswith("http://127.0.0.1:"), page._repr_html_()[:27]
    (True, '<iframe src="http://127.0.0')
    >>> page.close()
    """
    cell, how = _cell() or options.get("title") or scene.hash, (fs, safety, port, options)
    if cell in _shown:
        server, stream, before = _shown[cell]
        if server.runs and before == how:
            stream.reload(scene)
            stream.expect()
            return server
        server.close()
    stream = Stream(scene, fs, safety, **options)
    stream.warm_up()
    try:
        server = Server(stream, port=port, framed_by=NEAR)
        _shown[cell] = server, stream, how
    except SinkError:
        if port:
            raise
        own = {n: options[n] for n in ("params", "seed", "title", "ranges") if n in options}
        return share(scene, fs, **own)
    return server.start()


def _cell() -> str:
    """Return the name of the notebook's cell that runs now, or an empty text."""
    ipython: Any = sys.modules.get("IPython")
    shell = ipython and ipython.get_ipython()
    asked = shell.get_parent() if hasattr(shell, "get_parent") else {}
    return str(asked.get("metadata", {}).get("cellId", ""))
