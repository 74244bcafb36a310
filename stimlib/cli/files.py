"""The commands that write sound files: demo, render and render-set."""

from __future__ import annotations

from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import files
from ..errors import counted, shown
from ..system.progress import progress
from . import options as opt
from .app import command, end, errors, note, print_json, print_wide
from .motions import motions_of
from .scene import SceneText, params_of, scene_of, touching


@command("demo")
def demo_(
    folder: Annotated[Path, typer.Argument(help="Folder to write into; made if missing.")] = Path(
        "stimlib-demo"
    ),
):
    """Render three stimuli with pictures, reports and listening copies. Start here.

    A table says what to look at.

    Exit status 1 when a check fails.

    [bold]stimlib demo[/]
    """
    from rich.table import Column, Table
    from rich.text import Text

    from ..demo import STIMULI, demo

    heads = "file", "what it is", "what to look at, or listen for"
    table = Table(*(Column(head, overflow="fold") for head in heads))
    passed = True
    errors.print(
        "rendering, verifying and drawing three stimuli; the first time also compiling, which takes"
        " a minute",
        soft_wrap=True,
    )
    with progress("demo", len(STIMULI)) as advance, closing(demo(folder)) as stimuli:
        for made in stimuli:
            advance(1)
            errors.print(f"{made.name}: {'passed' if made.passed else 'FAILED'}", highlight=False)
            for path, what, look in made.files:
                table.add_row(Text(shown(path)), what, look)
            table.add_section()
            passed &= made.passed
    print_wide(table)
    print(
        f"Open {folder / 'squeeze.png'}, then {folder / 'squeeze.html'}; then: stimlib render"
        " --help"
    )
    end(passed)


@command("render", motions=motions_of)
def render_(
    scene: SceneText,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="File to write: .wav, .rf64, .w64, .caf or .flac.",
            show_default=False,
        ),
    ],
    motions: Any,
    seconds: opt.Length = None,
    fs: opt.Rate = 8000.0,
    calibration: opt.Calibrated = None,
    set_: opt.Params = [],
    seed: opt.Seed = 0,
    full_scale: Annotated[
        str | None,
        typer.Option(
            help=(
                "Physical value that is stored as 1.0. PCM and FLAC need one; floats store any "
                "value. If units differ: a=50,b=0.1."
            )
        ),
    ] = None,
    subtype: Annotated[
        str | None,
        typer.Option(
            help="FLOAT, DOUBLE, PCM_16, PCM_24 or PCM_32; by default FLOAT, in FLAC PCM_24."
        ),
    ] = None,
    dither: Annotated[
        int | None, typer.Option(help="Seed of the dither of PCM; by default there is none.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Also draw the first 10 s: signals, vibration, force over position, spectra."
        ),
    ] = None,
    quiet: opt.Quiet = False,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Render a scene into a sound file, and write FILE.json to repeat and verify it.

    [bold]stimlib render wall --motion "sinusoid(2e-3, 5)" --full-scale 5 --out w.wav[/]
    """
    from ..run.processor import compile

    if picture is not None:
        from ..analysis.overview import check_place, picture as draw
        from ..run.rendering import render

        check_place(picture)
    made = scene_of(scene, import_)
    values = params_of(set_, made)
    for actuator in opt.calibration(calibration).values():
        made = actuator.drive(made, fs)
    motion, recorded = motions(made, contact=touching(scene))
    length = opt.length(seconds, recorded)
    proc = compile(made, fs, seed=seed)
    for name, value in values.items():
        proc.set(name, value, ramp=0.0)
    scale = opt.of_each(full_scale, "--full-scale")
    report = files.write(
        out,
        proc,
        motion,
        length,
        subtype=subtype,
        full_scale=scale,
        dither=dither,
        progress=not quiet,
    )
    if json_:
        print_json(asdict(report) | {"path": str(report.path), "sidecar": str(report.sidecar)})
    if not quiet:
        if not json_:
            print(report)
        _note_peaks(
            report.peak, scale, subtype or ("PCM_24" if out.suffix.lower() == ".flac" else "FLOAT")
        )
    if picture is not None:
        draw(render(made, motion, fs, min(length, 10.0), values, seed), picture)


def _note_peaks(peaks: dict[str, float], scale: Any, subtype: str) -> None:
    """Report outputs that are silent, or small in a file of whole numbers."""
    silent = [name for name, peak in peaks.items() if peak == 0.0]
    if silent:
        note(f"every sample of {', '.join(silent)} is 0")
    top = max(peaks.values())
    one = float(scale) if isinstance(scale, str) else 0.0
    kind, _, bits = subtype.upper().partition("_")
    if kind == "PCM" and 0.0 < top < 0.01 * one:
        note(
            f"the peak uses {100 * top / one:.2g} % of full scale, and the file has steps of"
            f" {2 * one / 2 ** int(bits):.2g}: write it with a full scale of about {1.01 * top:.3g}"
        )


@command("render-set", motions=motions_of)
def render_set_(
    folder: Annotated[
        Path,
        typer.Argument(
            help=(
                "Folder to write the files and index.json into; an interrupted set continues there."
            )
        ),
    ],
    motions: Any,
    contact: Annotated[
        bool,
        typer.Option(
            "--contact",
            help="Use for recordings with lifts: the bumps rest while the finger is lifted.",
        ),
    ] = False,
    seconds: opt.Length = None,
    fs: opt.Rate = 8000.0,
    repetitions: Annotated[
        int,
        typer.Option(help="How often each stimulus is presented, in a new random order each time."),
    ] = 4,
    seed: Annotated[int, typer.Option(help="Seed of the random order.")] = 0,
    workers: Annotated[
        int | None, typer.Option(help="Number of processes; by default one for each core.")
    ] = None,
    quiet: opt.Quiet = False,
):
    """Render the 81 bumps of the touch-screen experiment.

    An index has the order of presentation.

    The finger strokes 0.1 m at 20 mm/s, unless --motion is given.

    [bold]stimlib render-set bumps/[/]
    """
    from ..files.batch import render_set
    from ..scenes import bumps, bumps_set

    scenes = {
        f"{s.waveform}_{s.bumps:02d}_{s.duty:g}_{s.amplitude:g}V": bumps(*s, contact=contact)
        for s in bumps_set()
    }
    motion, recorded = motions(
        next(iter(scenes.values())), ("constant_speed(0.02, 0.1)",), "add --contact"
    )
    index = render_set(
        folder,
        scenes,
        motion,
        opt.length(seconds, recorded),
        fs,
        seed=seed,
        repetitions=repetitions,
        full_scale=400.0,
        workers=workers,
        progress=not quiet,
    )
    if not quiet:
        print(f"{counted(len(scenes), 'file')} and {index}")
