"""Rendering of stimulus sets: many scenes into many files, with their order."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..blocks.noise import noise_key
from ..core.definitions import definitions
from ..core.scene import Scene
from ..errors import BadValue, SinkError
from ..run.processor import compile
from ..system import safe_files
from ..system.pool import spread
from ..system.progress import progress as bar
from . import audio as file
from .formats import FORMATS


def order(n: int, repetitions: int, seed: int) -> list[list[int]]:
    """Return a random order of n stimuli for each repetition.

    The order is the same on every machine and in every version.

    Parameters
    ----------
    n, repetitions : int
    seed : int

    Returns
    -------
    list of list of int

    Examples
    --------
    >>> from stimlib.files.batch import order
    >>> [sorted(o) for o in order(4, 2, seed=1)]
    [[0, 1, 2, 3], [0, 1, 2, 3]]
    """
    return [
        sorted(range(n), key=lambda i: int(noise_key(seed, i, r, 2))) for r in range(repetitions)
    ]


def render_set(
    folder: str | os.PathLike,
    scenes: Mapping[str, Scene],
    motion: Mapping[str, Any],
    seconds: float,
    fs: float = 8000.0,
    *,
    seed: int = 0,
    repetitions: int = 4,
    suffix: str = ".wav",
    full_scale: float | None = None,
    workers: int | None = None,
    progress: bool = True,
) -> Path:
    """Render each scene into FOLDER/NAME.wav, with an index of the presentation order.

    The index is FOLDER/index.json.

    Complete files from the same scene, motion, length and seed are kept, so an
    interrupted set is resumed.  Each file is written atomically; the bytes do not
    depend on the number of workers.

    Parameters
    ----------
    folder : path
        Made if missing.
    scenes : dict of str to Scene
        By file name without suffix.
    motion : dict of str to motion
        Motions of all scenes' inputs: generators of ``stimlib.motion.generators``, or
        float64 arrays.
    seconds, fs : float
        Length in s, sample rate in Hz.
    seed : int
        Seed of all noise, and of the order.
    repetitions : int
        How often each stimulus is presented.
    suffix : str
        Format of the files.
    full_scale : float, optional
        See ``stimlib.files.audio.write``.
    workers : int, optional
        Number of processes; by default one per core.
    progress : bool
        A progress bar on stderr, if that is a terminal.

    Returns
    -------
    Path
        Path of the index.

    Raises
    ------
    BadValue
        No scenes, a name that is not a plain file name, repetitions below 1; and as
        ``file.write``.
    SinkError
        As ``file.write``.
    KeyboardInterrupt
        As ``stimlib.system.pool.spread``.

    Examples
    --------
    >>> import tempfile, stimlib
    >>> from stimlib.files.batch import render_set
    >>> from stimlib.motion import constant_speed
    >>> x = stimlib.Input("x", "m")
    >>> scenes = {
    ...     f"k{k}": stimlib.Scene({"force": stimlib.constant(k, "N/m") * x})
    ...     for k in (100, 200)
    ... }
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     index = render_set(
    ...         folder, scenes, {"x": constant_speed(0.02, 0.1)}, seconds=0.1, workers=1
    ...     )
    ...     sorted(p.name for p in index.parent.iterdir())
    ['index.json', 'k100.wav', 'k100.wav.json', 'k200.wav', 'k200.wav.json']
    """
    if not scenes:
        raise BadValue("render_set: no scenes")
    for name in scenes:
        if not name or Path(name).name != name or name.startswith("."):
            raise BadValue(f"render_set: {name!r} is not a plain file name")
    if repetitions < 1:
        raise BadValue(f"render_set: repetitions = {repetitions} must be at least 1")
    folder = safe_files.make_folder(folder)
    jobs = {
        name: (folder / (name + suffix), scene, dict(motion), seconds, fs, seed, full_scale)
        for name, scene in scenes.items()
    }
    with bar("rendering", len(jobs), progress) as advance:
        todo = {n: job for n, job in jobs.items() if not _is_there(*job)}
        advance(len(jobs) - len(todo))
        with spread(_write, list(todo.values()), workers) as written:
            for _ in written:
                advance(1)
    names = list(scenes)
    index = {
        "fs": fs,
        "seconds": seconds,
        "seed": seed,
        "files": {n: job[0].name for n, job in jobs.items()},
        "scene_hashes": {n: scene.hash for n, scene in scenes.items()},
        "presentation": [[names[i] for i in one] for one in order(len(names), repetitions, seed)],
    }
    path = folder / "index.json"
    safe_files.publish(path, json.dumps(index, indent=1) + "\n")
    return path


def _write(
    path: Path,
    scene: Scene,
    motion: dict,
    seconds: float,
    fs: float,
    seed: int,
    full_scale: float | None,
) -> None:
    proc = compile(scene, fs, seed=seed)
    file.write(path, proc, motion, seconds, full_scale=full_scale, progress=False)


def _is_there(
    path: Path,
    scene: Scene,
    motion: dict,
    seconds: float,
    fs: float,
    seed: int,
    full_scale: float | None,
) -> bool:
    """Return whether a complete file of exactly this job exists already."""
    try:
        _, sidecar = file.read(path)
    except SinkError:
        return False
    if not all(callable(m) for m in motion.values()):
        return False  # in a sidecar all arrays are alike
    wanted = {
        "scene": scene.to_dict(),
        "fs": fs,
        "frames": round(seconds * fs),
        "seed": seed,
        "index": 0,
        "log": [],
        "subtype": FORMATS[sidecar["format"]][0],
        "dither": None,
        "motion": {name: repr(m) for name, m in motion.items()},
        "stimlib": file.__version__,
        "definitions": definitions(scene),
    }
    scales = {c["full_scale"] for c in sidecar["channels"]}
    return scales <= {full_scale or 1.0} and all(sidecar[k] == v for k, v in wanted.items())
