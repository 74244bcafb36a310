"""The command that converts haptic patterns of other programs, both ways."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import files
from ..errors import BadValue
from . import options as opt
from .app import command, note, print_json
from .motions import motions_of
from .scene import params_of, run_files, scene_of, touching


@command("convert", motions=motions_of)
def convert_(
    source: Annotated[
        str,
        typer.Argument(
            metavar="A",
            help=(
                "A pattern (.ahap, .haptic or .hjif), a sound file, or a scene as for [bold]"
                "stimlib render[/]."
            ),
            show_default=False,
        ),
    ],
    target: Annotated[
        Path,
        typer.Argument(
            metavar="B",
            help=(
                "File to write: a pattern, a sound file (.wav, .flac, ..), or .json for a scene."
            ),
            show_default=False,
        ),
    ],
    motions: Any,
    seconds: opt.Length = None,
    fs: opt.Rate = 8000.0,
    set_: opt.Params = [],
    seed: opt.Seed = 0,
    full_scale: Annotated[
        float | None,
        typer.Option(
            help=(
                "Amplitude that is 1 in a pattern; by default 1 if it is read, the largest "
                "amplitude if it is written."
            ),
            show_default=False,
        ),
    ] = None,
    unit: Annotated[str, typer.Option(help="Unit of a pattern that is read: [bold]m/s^2[/].")] = "",
    f_lo: Annotated[float, typer.Option(help="Frequency of sharpness 0 in Hz.")] = 65.0,
    f_hi: Annotated[float, typer.Option(help="Frequency of sharpness 1 in Hz.")] = 300.0,
    decay: Annotated[
        float, typer.Option(help="Time constant of a transient's ring in s.")
    ] = 0.0073,
    power: Annotated[
        float, typer.Option(help="Of AHAP: amplitude = intensity^power; 2 as in NiceVibrations.")
    ] = 1.0,
    skip_sound: Annotated[
        bool, typer.Option("--skip-sound", help="Leave out AHAP's events of sound.")
    ] = False,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Convert haptic patterns: Apple's AHAP, .haptic (Lofelt, Meta) and MPEG's .hjif.

    A pattern becomes a scene (.json), a sound file, or another pattern. A scene or a
    sound file becomes a pattern by analysis. What is lost on the way back is printed.

    How numbers from 0 to 1 stand for Hz, m/s^2 or N depends on the device: say it with
    --f-lo, --f-hi, --full-scale and --unit.

    [bold]stimlib convert heartbeat.ahap heartbeat.wav[/]

    [bold]stimlib convert heartbeat.ahap heartbeat.json --full-scale 5 --unit m/s^2[/]

    [bold]stimlib convert "tone(freq=170)" tone.haptic --seconds 2[/]
    """
    run_files(import_)
    from ..files.formats import FORMATS as SOUNDS
    from ..files.pattern_text import FORMATS
    from ..run.rendering import render

    device = files.PatternDevice(full_scale, unit, f_lo, f_hi, decay, power)
    kind, wanted = (Path(path).suffix.lower() for path in (source, target))
    sounds, values, given = {f".{name.lower()}" for name in SOUNDS}, {}, None
    if wanted not in {*FORMATS, *sounds, ".json"}:
        raise BadValue(
            f"{target}: the suffix is not known; use one of {', '.join(FORMATS)} for a pattern,"
            f" {', '.join(sorted(sounds))} for a sound file, or .json for a scene"
        )
    # options that differ from their defaults, where nothing reads them
    idle: dict[str, Any] = {"fs": fs != 8000.0 and (wanted == ".json" or kind in sounds)}
    if wanted == ".json" or kind in {*FORMATS, *sounds}:
        usual = motions.func.__kwdefaults__.items()
        idle |= {n: motions.keywords[n] != v for n, v in usual} | {"set": set_, "seed": seed}
    if wanted == ".json" or kind in FORMATS and wanted in FORMATS:
        idle["seconds"] = seconds is not None
    if unused := [f"--{n.strip('_').replace('_', '-')}" for n, v in idle.items() if v]:
        raise BadValue(
            f"{', '.join(unused)}: no scene is rendered from {source} to {target}; leave"
            f" {'them' if unused[1:] else 'it'} out, or change the arguments of the scene"
        )
    motion: dict[str, Any] = {}
    recorded: float | None = None
    if kind in {*FORMATS, ".hmpg"}:
        given = files.read_pattern(source, device, skip_sound)
        made, recorded = given.scene, given.seconds
        for text in given.notes:
            note(f"{source}: {text}")
    elif kind in sounds:
        made, motion, fs = files.as_scene(source)
        recorded = len(next(iter(motion.values()))) / fs
    else:
        made = scene_of(source)
        values = params_of(set_, made)
        if wanted != ".json":
            motion, recorded = motions(made, contact=touching(source))
    if wanted == ".json":
        if kind in sounds:
            raise BadValue(f"{source} has samples, no scene; write a pattern or a sound file")
        made.save(target)
        print(target)
        return
    rendering: Any = given
    if given is None or wanted in sounds:
        rendering = render(made, motion, fs, opt.length(seconds, recorded), values, seed)
    if wanted in sounds:
        report: Any = files.save(target, rendering, full_scale=full_scale or 1.0)
    else:
        report = files.write_pattern(target, rendering, device, fs)
    if json_:
        print_json(json.loads(json.dumps(asdict(report), default=str)))
    else:
        print(report)
