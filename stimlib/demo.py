"""The demo: stimuli of three papers as sound files, pictures and reports."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Generator
from pathlib import Path
from typing import NamedTuple

from .analysis.listening import listen
from .analysis.overview import picture
from .checks.verification import verify
from .core.scene import Scene
from .errors import public
from .files.audio import write
from .motion.generators import Motion, jittered, minimum_jerk, quantised
from .run.processor import compile
from .run.rendering import render
from .scenes import bumps, squeeze, viscoelastic
from .system import safe_files
from .system.packages import package
from .system.pool import spread

FS, SECONDS = 8000.0, 4.8


def _encoder(motion: Motion, resolution: float, seed: int = 0) -> Motion:
    """Return a motion as an encoder reports it, with a toggling last digit."""
    return quantised(jittered(motion, resolution, rate=500.0, seed=seed), resolution)


class Stimulus(NamedTuple):
    """A shipped scene with its motion and notes on what to look at and listen to."""

    make: Callable[..., Scene]
    motion: dict[str, Motion]
    full_scale: float  # in the outputs' unit
    output: str  # to listen to
    what: str
    look: str
    hear: str


STIMULI = (
    Stimulus(
        squeeze,
        {
            "x1": _encoder(minimum_jerk(0.02), 1e-6, seed=1),
            "x2": _encoder(minimum_jerk(0.018), 1e-6, seed=2),
        },
        50.0,
        "force1",
        "two fingers squeeze a spring that vibrates",
        "the vibration beside the force; the spectrum within its band",
        "four bursts: it vibrates while it is loaded; held or let go, only steps of the encoder are"
        " left",
    ),
    Stimulus(
        bumps,
        {"x": _encoder(minimum_jerk(0.1, rise=1.0, fall=1.0), 1e-5)},
        250.0,
        "voltage",
        "a finger strokes six bumps on a touch screen",
        "six bumps over position, at the same places on the way back",
        "158 Hz, on and off: fast in the middle of a stroke, slow at its ends",
    ),
    Stimulus(
        viscoelastic,
        {"y": _encoder(minimum_jerk(0.01), 1e-6)},
        5.0,
        "force",
        "a finger presses a material between spring and dashpot",
        "the force runs down while the finger holds; the loop is the work lost",
        "the steps of the encoder, much amplified: a springpot passes them on",
    ),
)


class Shown(NamedTuple):
    """The files that ``demo`` wrote for one stimulus."""

    name: str
    passed: bool
    """Whether every check of the report passed."""
    files: list[tuple[Path, str, str]]
    """For each file: path, kind, and what to look at."""


@public
def demo(folder: str | os.PathLike, workers: int | None = None) -> Generator[Shown, None, None]:
    """Render every stimulus in ``STIMULI`` and write its files.

    The stimuli are shipped scenes. Positions move in steps of 1 um (10 um on the touch
    screen).

    Parameters
    ----------
    folder : path
        Made if missing; see ``show``.
    workers : int, optional
        Processes; by default one for each core.

    Yields
    ------
    Shown
        As soon as its files are there.

    Raises
    ------
    MissingPackage
        matplotlib is not there.
    SinkError
        The folder, or a file in it, cannot be written.
    KeyboardInterrupt
        As ``stimlib.system.pool.spread``.

    Examples
    --------
    >>> import tempfile
    >>> from stimlib.demo import demo
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     first = next(demo(folder, workers=1))
    >>> first.name, first.passed, [path.name for path, _, _ in first.files]
    ('squeeze', True,
     ['squeeze.wav', 'squeeze-listen.wav', 'squeeze.png', 'squeeze.html'])
    """
    package("matplotlib", "the demo")
    folder = safe_files.make_folder(folder)
    with spread(show, [(folder, s) for s in STIMULI], workers) as made:
        yield from made


def show(folder: Path, s: Stimulus) -> Shown:
    """Write the sound files, listening copies, pictures and report of one stimulus.

    The files are NAME.wav and NAME-listen.wav with their sidecars, NAME.png and
    NAME.html; files of these names are replaced.
    """
    scene, name = s.make(), s.make.__name__
    wav, ears, png, page = (
        folder / f"{name}{end}" for end in (".wav", "-listen.wav", ".png", ".html")
    )
    rendering = render(scene, s.motion, FS, SECONDS)
    report = write(
        wav, compile(scene, FS), s.motion, SECONDS, full_scale=s.full_scale, progress=False
    )
    copy = listen(rendering, s.output, ears)
    proof = verify(scene, s.motion, wav)
    proof.to_html(
        page, shlex.join(["stimlib", "verify", name, "--wav", str(wav), "--report", str(page)])
    )
    picture(rendering, png, proof.spectra())
    unit, ((label, heard),) = scene.outputs[s.output].dim, copy.peak.items()
    checks = f"{sum(c.passed for c in proof.checks)} of {len(proof.checks)} checks passed"
    files = [
        (
            wav,
            s.what,
            (
                f"1.0 in the file is {s.full_scale:g} {unit}; {wav.name}.json has what it takes to"
                " make it again"
            ),
        ),
        (
            ears,
            f"{label}, {heard:.2g} {unit} of {report.peak[s.output]:.3g} {unit}, to listen to",
            s.hear,
        ),
        (png, "its picture", s.look),
        (page, "its report", f"{checks}; each line names what it compared"),
    ]
    return Shown(name, proof.passed, files)
