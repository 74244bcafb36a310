"""The commands ``verify``, ``replay`` and ``mutate``.

The command ``mutate`` lists which wrong numbers verification would detect.
"""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import checks, files
from ..errors import BadValue
from . import options as opt
from .app import command, end, print_json, print_result
from .motions import given, motions_of
from .scene import SceneText, params_of, run_files, scene_of, touching


@command("verify", motions=motions_of)
def verify_(
    motions: Any,
    scene: Annotated[
        str | None,
        typer.Argument(
            metavar="FILE|SCENE",
            help=(
                "The sound file that [bold]stimlib render[/] wrote; or, with --wav or --log, the "
                "scene that you expect."
            ),
            show_default=False,
        ),
    ] = None,
    wav: Annotated[
        Path | None,
        typer.Option(help="The sound file, if SCENE is given.", show_default=False),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            help="The log of a session, instead of a sound file. It contains scene and motion.",
            show_default=False,
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            help="Also write the report as one self-contained .html page, to attach to a paper."
        ),
    ] = None,
    params: opt.Params = [],
    seed: Annotated[
        int | None,
        typer.Option(help="Seed that you expect; by default that of the file.", show_default=False),
    ] = None,
    device: Annotated[
        Path | None,
        typer.Option(
            help="A device as JSON, as for [bold]stimlib try[/]: report whether its damping is"
            " enough for each force.",
            show_default=False,
        ),
    ] = None,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Check a sound file or a session's log against its scene and motion.

    Exit status 1 when a check fails.

    It is 1, too, if the scene names an unknown law: load its module with
    [bold]--import[/].

    Scene, parameters, seed and motion are read from the file's sidecar, a recording
    from the path that it names, if that file still has its SHA-256. If the sidecar
    cannot describe the motion (an array), pass it again with --motion. A log has all of
    it. If you give SCENE, the file's scene must equal it. Parameters that differ from
    the scene's are listed first; if you give --set, the file must have these values,
    and all other parameters those of the scene.

    [bold]stimlib verify squeeze.wav --report squeeze.html[/]

    [bold]stimlib verify "squeeze(fingers=1)" --wav squeeze.wav[/]

    [bold]stimlib verify --log monday.stimlog[/]
    """
    opt.check_page(report)
    run_files(import_)
    scene, wav = _what(scene, wav, log)
    from ..virtual import read_device

    made = None if device is None else read_device(device)
    result = (_of_log if log else _of_file)(log, scene, wav, motions, params, seed, made)
    try:
        print_result(result, json_)
    # a disk that is full costs the page alone, and a reader that goes away the table
    # alone
    finally:
        if report is not None:
            result.to_html(report, shlex.join(["stimlib", *sys.argv[1:]]))
    if report is not None and not json_:
        print(f"report: {report}")
    end(result.passed and not result.unknown)


def _what(scene: str | None, wav: Path | None, log: Path | None) -> tuple[str | None, Path | None]:
    """Return the scene and the file that the arguments mean."""
    from ..files.formats import FORMATS

    if scene is not None and Path(scene).suffix[1:].upper() in FORMATS:
        if wav is not None:
            raise BadValue(f"{scene} and {wav} are two files: verify one at a time")
        wav, scene = Path(scene), None
    for path in (scene, wav):
        if path is not None and Path(path).suffix == ".stimlog":
            raise BadValue(f"{path} is a log: stimlib verify --log {path}")
    if scene is not None and wav is None and log is None and not _names_a_scene(scene):
        raise BadValue(
            f"{scene} is not a sound file, which ends in one of"
            f" {', '.join('.' + f.lower() for f in FORMATS)}"
        )
    return scene, wav


def _of_log(
    log: Any,
    scene: str | None,
    wav: Path | None,
    motions: Any,
    params: list[str],
    seed: int | None,
    device: Any,
) -> Any:
    """Return the verification report of a log, against the expected scene if given."""
    if wav is not None or given(motions):
        raise BadValue(
            "a log has its motion and its samples: give --log without --wav and --motion"
        )
    # first: it may define blocks that the log names
    expected = None if scene is None else scene_of(scene)
    read = files.read_log(log)
    stated = params_of(params, read.scene) if params else None
    return checks.verify_log(read, expected, params=stated, seed=seed, device=device)


def _of_file(
    log: Any,
    scene: str | None,
    wav: Path | None,
    motions: Any,
    params: list[str],
    seed: int | None,
    device: Any,
) -> Any:
    """Return the report of a file, checked against the scene and motion if given."""
    from ..checks.verification import scene_told

    if wav is None:
        raise BadValue("name what to verify: FILE.wav, SCENE --wav FILE, or --log LOG")
    expected = None if scene is None else scene_of(scene)
    motion = (
        motions(expected or scene_told(wav), contact=touching(scene or ""))[0]
        if given(motions)
        else None
    )
    stated = params_of(params, expected or scene_told(wav)) if params else None
    return checks.verify(expected, motion, wav, params=stated, seed=seed, device=device)


def _names_a_scene(text: str) -> bool:
    return "(" in text or ":" in text or Path(text).suffix in ("", ".json", ".py")


@command("replay")
def replay(
    log: Annotated[
        Path, typer.Argument(help="The log of a session, NAME.stimlog.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Also write the delivered samples: .wav, .rf64, .w64 or .caf.",
            show_default=False,
        ),
    ] = None,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Compute the samples of a session again, and compare them with its log.

    Exit status 1 where they differ.

    [bold]stimlib replay monday.stimlog --out monday.wav[/]
    """
    run_files(import_)
    result = files.replay(files.read_log(log), out)
    if json_:
        print_json({"matches": result.matches} | asdict(result))
    else:
        print(result)
    end(result.matches)


@command("mutate", motions=motions_of)
def mutate_(
    motions: Any,
    scene: SceneText,
    fs: opt.Rate = 8000.0,
    seconds: Annotated[
        float,
        typer.Option(
            help="Length of each rendering in s; a short one is enough if it uses every number."
        ),
    ] = 1.0,
    seed: opt.Seed = 0,
    params: opt.Params = [],
    report: Annotated[
        Path | None, typer.Option(help="Also write the table as one self-contained .html page.")
    ] = None,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Change each number of a scene, and list which changes its law detects.

    Exit status 1 if one is missed.

    Each number is replaced by 1.01 and 1.25 times its value, its negative, 0 and 1.
    "Refused" is a change that the law detects. "Equal samples" means that this motion
    does not use the number: choose another motion. "Within tolerance" and "no law" are
    changes that the law misses.

    [bold]stimlib mutate wall --motion 'sinusoid(0.002, 5)'[/]

    [bold]stimlib mutate my.py:scene --motion 'minimum_jerk(depth=0.02)'[/]
    """
    made = scene_of(scene, import_)
    motion, length = motions(made, ("minimum_jerk()",), touching(scene))
    length = min(seconds, length or seconds)
    found = checks.mutate(made, motion, fs, length, params_of(params, made), seed)
    print_result(found, json_)
    if report is not None:
        found.to_html(report, f"changed numbers of {scene}")
    end(found.passed)
