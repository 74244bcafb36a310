"""``verify``, ``replay`` and ``mutate``: checks of what was displayed.

``mutate`` says which wrong numbers verification would notice.
"""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import BadValue
from . import options as opt
from .app import command, end, print_json, print_wide
from .motions import motions_of
from .scene import SceneText, params_of, run_files, scene_of, touching


@command("verify", motions=motions_of)
def verify_(
    motions: Any,
    scene: Annotated[
        str | None,
        typer.Argument(
            metavar="FILE|SCENE",
            help=(
                "The sound file that [bold]stimlib render[/] wrote; or the scene that --wav or"
                " --log must be of."
            ),
            show_default=False,
        ),
    ] = None,
    wav: Annotated[
        Path | None,
        typer.Option(
            help="The sound file, where SCENE is the scene that is expected.", show_default=False
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            help="Instead, the log of a session; it has scene and motion.", show_default=False
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="Also write one self-contained page, .html, to attach to a paper."),
    ] = None,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Verify that a file or a session's log is what scene and motion ask for.

    Exit status 1 when a check fails.

    It is 1, too, where the scene names a law that is not known here: import its module
    with [bold]--import[/].

    Scene, parameters, seed and motion are read from the file's sidecar, a recording
    from the path that it names, if that file still has its SHA-256. A motion whose text
    does not define it is given again, as it was rendered. A log has all of it. If SCENE
    is given, it must be that one.

    [bold]stimlib verify squeeze.wav --report squeeze.html[/]

    [bold]stimlib verify "squeeze(fingers=1)" --wav squeeze.wav[/]

    [bold]stimlib verify --log monday.stimlog[/]
    """
    if report is not None:
        from ..analysis.overview import check_place
        from ..checks.report import PAGES

        check_place(report, "page", PAGES)
    run_files(import_)
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
    given = any(motions.keywords[option] for option in ("motion", "map_", "where"))
    if log is not None:
        if wav is not None or given:
            raise BadValue(
                "a log has its motion and its samples: give --log without --wav and --motion"
            )
        from ..checks.session import verify_log
        from ..files.log_reader import read_log

        # first: it may define blocks that the log names
        expected = None if scene is None else scene_of(scene)
        result = verify_log(read_log(log), expected)
    else:
        from ..checks.verification import scene_told, verify

        if wav is None:
            raise BadValue("name what to verify: FILE.wav, SCENE --wav FILE, or --log LOG")
        expected = None if scene is None else scene_of(scene)
        motion = (
            motions(expected or scene_told(wav), contact=touching(scene or ""))[0]
            if given
            else None
        )
        result = verify(expected, motion, wav)
    try:
        if json_:
            print_json(result.to_dict())
        else:
            print_wide(result)
    # a disk that is full costs the page alone, and a reader that goes away the table
    # alone
    finally:
        if report is not None:
            result.to_html(report, shlex.join(["stimlib", *sys.argv[1:]]))
    if report is not None and not json_:
        print(f"report: {report}")
    end(result.passed and not result.unknown)


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
            help="Also write what the device was given: .wav, .rf64, .w64 or .caf.",
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
    from ..files.log_reader import read_log
    from ..files.log_replay import replay as replay_log

    result = replay_log(read_log(log), out)
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
        typer.Option(help="Length of each rendering; a short one that uses every number will do."),
    ] = 1.0,
    seed: opt.Seed = 0,
    params: opt.FileParams = [],
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Change every number of a scene in turn, and report which its law refuses.

    Exit status 1 where one is missed.

    Each number is taken 1.01 and 1.25 times, with the other sign, as 0 and as 1. "Equal
    samples" cannot be noticed in this motion: choose one that uses the number. "Within
    tolerance" and "no law" are what the law of the scene misses.

    [bold]stimlib mutate wall --motion 'sinusoid(0.002, 5)'[/]

    [bold]stimlib mutate my.py:scene --motion 'minimum_jerk(depth=0.02)' --seconds
    0.5[/]
    """
    run_files(import_)
    from ..checks.mutation import mutate

    made = scene_of(scene)
    motion, length = motions(made, ("minimum_jerk()",), touching(scene))
    found = mutate(made, motion, fs, min(seconds, length or seconds), params_of(params), seed)
    if json_:
        print_json(found.to_dict())
    else:
        print_wide(found)
    end(found.passed)
