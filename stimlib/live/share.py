"""A scene as one HTML file that runs in a browser without Python or a server."""

from __future__ import annotations

import base64
import hashlib
import html
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..core.scene import Scene
from ..errors import MissingPackage, public
from ..export.c99 import export_c
from ..files.sidecar import describe
from ..motion.recorded import LIFTED
from ..motion.source import frames_of, positions, sources_of
from ..run.rendering import stream
from ..system.limits import limits
from ..system.pool import terminable
from ..system.progress import progress as bar
from ..system.safe_files import publish
from .describe import Range, description, full_scales, page_rate, ranges_of
from .inputs import first_sources, following

WEB, PAGE = Path(__file__).with_name("web"), Path(__file__).with_name("page")
FLAGS = (
    "-std=c99 -O2 -ffreestanding -nostdlib -mbulk-memory -fno-math-errno -Wl,--no-entry"
    " -Wl,--strip-all"
).split()
IMPORT = re.compile(r'^import \{ (.+) \} from "\./(\w+)\.js";\n', re.M)
EXPORT = re.compile(r"^export (?=(?:const|let|class|async function|function) (\w+))", re.M)
PATIENCE = 300.0
"""Seconds after which a compiler that hangs is stopped: the first use of zig builds its
own library.
"""
LONGEST = 5.0  # s, of a recorded motion without an end
FOLDER = re.compile(r"(?<=^recording\()(['\"])(?:\\.|(?!\1).)*[/\\]")
"""Of a recording's file: it may tell who the author is."""
SLOW = 1e-6  # of its range, that a motion at rest may move in a sample: a turn is a rest
ORDERS = 5
"""Differences of recorded motion that are tried, to store it in few bytes."""


@dataclass(frozen=True)
class Shared:
    """A shared page; a notebook shows it in a frame.

    Attributes
    ----------
    page : str
        The whole HTML file.
    wasm_bytes : int
        Size of the scene as WebAssembly.
    samples : int
        How many samples of each output the page checks; 0 without recorded motion.
    sha256 : str
        SHA-256 of these samples, as little-endian float64, one output after the other.
    """

    page: str = field(repr=False)
    wasm_bytes: int
    samples: int
    sha256: str

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{html.escape(self.page)}" title="stimlib" allow="autoplay"'
            ' sandbox="allow-scripts" style="width: 100%; height: 720px; border: 0"></iframe>'
        )


@public
def share(
    scene: Scene,
    fs: float = 8000.0,
    path: str | Path | None = None,
    motion: Mapping[str, Any] | None = None,
    seconds: float | None = None,
    params: Mapping[str, float] | None = None,
    seed: int = 0,
    *,
    title: str = "",
    cite: str = "",
    ranges: Mapping[str, Range] | None = None,
    progress: bool = True,
) -> Shared:
    """Write a scene as one HTML page, which anybody can open without Python.

    The page runs the scene as WebAssembly in the browser's audio thread, with the bits
    of ``Processor.process``. A pointer drives it as on the live page; sliders set its
    parameters; plots and sound present its outputs.

    Parameters
    ----------
    scene : Scene
    fs : float
        Sample rate in Hz, at most 768000: that of the fastest AudioContext.
    path : path, optional
        The file to write; one that is there is replaced.
    motion : mapping of str to array or callable, optional
        Recorded motion of every input, as of ``render``, that a reader can play. The
        page computes its samples anew and compares their SHA-256 with that of stimlib.
    seconds : float, optional
        Length of the recorded motion; by default that of its shortest array. Motions
        without an end last until all of them rest where they began, for the last time
        in 5 s; if they never do, 5 s.
    params : mapping of str to float, optional
        Values of parameters at the start.
    seed : int
        Of the run, and so of its noise.
    title : str
        Heading of the page.
    cite : str
        The paper that the page belongs to, as it is to be cited.
    ranges : mapping of str to (low, high), optional
        Of inputs (for the pointer) and of parameters (for the sliders); see
        `stimlib.live.describe.ranges_of`.
    progress : bool
        A progress bar on stderr while recorded motion is computed and packed, if that
        is a terminal.

    Returns
    -------
    Shared

    Raises
    ------
    MissingPackage
        There is no compiler for WebAssembly: neither clang with wasm-ld, nor zig.
    UnknownName, BadValue
        Names or numbers that do not fit the scene; see ``export_c``.
    SinkError
        The file cannot be written.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.live.share import share
    >>> from stimlib.motion import minimum_jerk
    >>> motion = {"x": minimum_jerk(depth=0.02)}
    >>> page = share(stimlib.scenes.wall(), 8000, motion=motion)  # doctest: +SKIP
    >>> page.samples  # doctest: +SKIP
    40000
    """
    fs, given = page_rate(fs), ranges_of(scene, ranges)
    data: dict[str, Any] = {
        "motion": None,
        "samples": 0,
        "sha256": "",
        "cite": cite,
        "held": [],
        "lifted": [n for n, b in scene.inputs.items() if LIFTED.get(str(b.dim)) == "zero"],
        "sources": first_sources(scene, given, {}),
    }
    facts = {"hash of the scene": scene.hash, "sample rate": f"{fs:g} Hz", "seed": f"{seed}"}
    if motion is not None:
        n = frames_of(_seconds(scene, motion, fs) if seconds is None else seconds, fs)
        limits.check("render_bytes", 8 * n * len(scene.outputs), "share: bytes of the recording")
        x = positions(sources_of(motion, tuple(scene.inputs), n), 0, n, fs)
        rows = dict(zip(scene.inputs, x, strict=True))
        with bar("sharing", n * (1 + ORDERS), progress) as advance:
            y, at = np.empty((len(scene.outputs), n), "<f8"), 0
            for part in stream(scene, rows, fs, n / fs, params, seed):
                y[:, at : (at := at + part.shape[1])] = part
                advance(part.shape[1], "computing the motion's samples")
            data |= {"motion": packed(x, advance), "samples": n}
        texts = {name: FOLDER.sub(r"\1", describe(m)) for name, m in motion.items()}
        alike = {t: ", ".join(n for n in texts if texts[n] == t) for t in texts.values()}
        driven = "; ".join(f"{names}: {text}" for text, names in alike.items())
        facts["length"] = f"{n / fs:g} s"
        words = {"(": " (", "=": " "}  # of a call, for readers
        facts["recorded motion"] = re.sub(
            r"(\w+)([(=])", lambda m: m[1].replace("_", " ") + words[m[2]], driven
        )
        data["sha256"] = facts["SHA-256 of the samples"] = hashlib.sha256(y.data).hexdigest()
    with terminable(), tempfile.TemporaryDirectory(prefix="stimlib-") as folder:
        still = {name: np.zeros(3) for name in scene.inputs}
        export_c(scene, fs, folder, still, "scene", 3 / fs, params, seed)
        if scene.inputs:
            hand = following(len(scene.inputs))
            data["held"] = list(hand.inputs)
            still = {name: np.zeros(3) for name in hand.inputs}
            export_c(hand, fs, folder, still, "hand", 3 / fs)
        wasm = compiled(Path(folder))
    from ..version import __version__

    shown = description(scene, given, full_scales(scene, fs, given), motion or {}, fs)
    for p in shown["params"]:
        v = p["value"] = float((params or {}).get(p["name"], p["value"]))
        p["low"], p["high"] = min(p["low"], v), max(p["high"], v)
    title = title or repr(scene)
    data["wasm"] = base64.b64encode(wasm).decode()
    data["facts"] = list((facts | {"made by": f"stimlib {__version__}"}).items())
    data["hello"] = {"title": title, "fs": fs, "stream": False, "marks": False} | shown
    data["hello"]["alone"] = "with motion" if motion else "without motion"
    page = page_of(title, data)
    if path is not None:
        publish(path, page)
    return Shared(page, len(wasm), data["samples"], data["sha256"])


def _seconds(scene: Scene, motion: Mapping[str, Any], fs: float) -> float:
    """Return the length of the shortest recorded input.

    Without one, it is the time of the last rest in ``LONGEST`` at which all inputs are
    where they began, or ``LONGEST``: a motion that is cut in a movement would end with
    a sudden stop.
    """
    if arrays := [m for m in motion.values() if not callable(m)]:
        return min(len(m) if np.ndim(m) else 1 for m in arrays) / fs
    n = frames_of(LONGEST, fs)
    x = positions(sources_of(motion, tuple(scene.inputs), n), 0, n, fs)
    home = (x == x[:, :1]).all(axis=0)
    slow = np.abs(np.diff(x, prepend=x[:, :1])) <= SLOW * np.ptp(x, axis=1, keepdims=True)
    rests = np.flatnonzero(home & slow.all(axis=0) & ~home.all())
    return max(rests[rests > home.argmin()], default=n) / fs


def packed(
    x: np.ndarray, advance: Callable[..., None] = lambda done, text="": None
) -> dict[str, Any]:
    """Return rows of float64 in few bytes, without loss.

    Words of a smooth motion have small differences of third or fourth order. Their
    bytes, all first ones, then all second ones .., compress well. ``advance`` is told
    of samples of a row, once for each order.
    """
    words, found = np.ascontiguousarray(x, "<f8").view("<i8"), []
    for _ in range(ORDERS):
        planes, deflate = (
            np.ascontiguousarray(words).view(np.uint8).reshape(-1, 8).T,
            zlib.compressobj(9),
        )
        made = b""
        for plane in planes:
            made += deflate.compress(plane.tobytes())
            advance(x.shape[1] / 8, "packing the motion")
        found.append(made + deflate.flush())
        words = np.diff(words, axis=1, prepend=np.int64(0))
    order = min(range(ORDERS), key=lambda k: len(found[k]))
    data = base64.b64encode(found[order]).decode()
    return {"data": data, "order": order, "rows": len(x), "samples": x.shape[1]}


def compiled(folder: Path) -> bytes:
    """Return exported C as WebAssembly, from the first compiler that can make it."""
    commands = [[clang, "--target=wasm32"]] if (clang := shutil.which("clang")) else []
    if importlib.util.find_spec("ziglang"):
        commands.append([sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-freestanding"])
    elif zig := shutil.which("zig"):
        commands.append([zig, "cc", "-target", "wasm32-freestanding"])
    hand = ["-DHAND", "hand.c"] if (folder / "hand.c").exists() else []
    why = "neither clang nor zig is installed"
    for command in commands:
        words = [*command, *FLAGS, f"-I{WEB}", "-I.", *hand, "scene.c", str(WEB / "page.c")]
        words += ["-o", "page.wasm"]
        try:
            done = subprocess.run(
                words,
                cwd=folder,
                capture_output=True,
                timeout=PATIENCE,
                text=True,
                errors="replace",
            )
            if done.returncode == 0:
                return (folder / "page.wasm").read_bytes()
        except subprocess.TimeoutExpired:
            why = f"{command[0]} was stopped after {PATIENCE:g} s"
        except OSError as e:  # it does not start, or has written nothing
            why = f"{command[0]}: {e}"
        else:
            why = f"{command[0]} says: {done.stderr.strip()[-400:]}"
    raise MissingPackage(
        f"share: no compiler for WebAssembly works here ({why}); pip install ziglang, or install"
        " clang and lld of one version"
    )


def bundled(name: str, done: dict[str, str]) -> None:
    """Add a module of the page to ``done``, after those that it imports.

    Each becomes a function, so that one script has them all: a page that is opened from
    disk may not load another file.
    """
    own = WEB / f"{name}.js"
    text = (own if own.exists() else PAGE / own.name).read_text("utf-8")
    for _, other in IMPORT.findall(text):
        if other not in done:
            bundled(other, done)
    names = EXPORT.findall(text)
    text = IMPORT.sub(lambda m: f"const {{ {m[1].replace(' as ', ': ')} }} = of_{m[2]};\n", text)
    inner = EXPORT.sub("", text)
    done[name] = f"const of_{name} = (() => {{\n{inner}return {{ {', '.join(names)} }};\n}})();\n"


def page_of(title: str, data: Mapping[str, Any]) -> str:
    """Return the whole page: the live page with its files inside it, and the data.

    Its content security policy lets it run its own script and style, and load nothing.
    """
    done: dict[str, str] = {}
    bundled("live", done)
    script = "\n" + "".join(done.values())
    style = "\n" + "".join(f.read_text("utf-8") for f in (PAGE / "live.css", WEB / "share.css"))
    script_is, style_is = (
        base64.b64encode(hashlib.sha256(t.encode()).digest()).decode() for t in (script, style)
    )
    policy = (
        f"default-src 'none'; script-src 'sha256-{script_is}' 'wasm-unsafe-eval' data:;"
        f" style-src 'sha256-{style_is}'; img-src data:; base-uri 'none'; form-action 'none'"
    )
    # in JSON, < stands only in texts
    inside = json.dumps(data, allow_nan=False).replace("<", "\\u003c")
    thread = (WEB / "worklet.js").read_text("utf-8")
    parts = {
        '<meta charset="utf-8">\n': f'<meta charset="utf-8">\n<meta http-equiv='
        f'"Content-Security-Policy" content="{policy}">\n',
        "<title>stimlib live</title>": f"<title>{html.escape(title)}</title>",
        '<link rel="stylesheet" href="live.css">': f"<style>{style}</style>",
        '<script type="module" src="live.js"></script>': (
            f'<script type="application/json" id="shared">{inside}</script>\n'
            f'<script type="text/plain" id="worklet">\n{thread}</script>\n'
            f'<script type="module">{script}</script>'
        ),
    }
    page = (PAGE / "index.html").read_text("utf-8")
    for old, new in parts.items():
        before, _, after = page.partition(old)
        page = f"{before}{new}{after}"
    return page
