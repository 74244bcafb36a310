"""The command that exports a scene as C."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ..errors import counted
from . import options as opt
from .app import command, print_json
from .motions import motions_of
from .scene import SceneText, params_of, scene_of, touching


@command("export", safety=opt.safety_of, motions=motions_of)
def export_(
    scene: SceneText,
    folder: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="Folder to write into; made if missing.", show_default=False
        ),
    ],
    safety: Any,
    motions: Any,
    lang: Annotated[Literal["c"], typer.Option(help="Language: [bold]c[/], which is C99.")] = "c",
    name: Annotated[
        str, typer.Option(help="Prefix of all names in C, and name of the files.")
    ] = "stimulus",
    seconds: Annotated[float, typer.Option(help="Length of the self test.")] = 0.1,
    fs: opt.Rate = 8000.0,
    set_: opt.Params = [],
    seed: opt.Seed = 0,
    tile: Annotated[
        int,
        typer.Option(help="Samples that a block computes at a time, 1 to 64: less memory or time."),
    ] = 64,
    float32: Annotated[
        bool,
        typer.Option(
            "--float32",
            help="Single precision; its error is measured with a C compiler that is installed.",
        ),
    ] = False,
    quiet: opt.Quiet = False,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Export a scene as C99 with the same samples, and a self test.

    The motion is that of the self test. With --full-scale, --slew, --peak, --static or
    --passivity the safety stage of a device is part of the program; else no output is
    limited.

    [bold]stimlib export squeeze --motion "minimum_jerk(depth=0.02)" --out squeeze_c[/]
    """
    from ..export.c99 import export_c

    made = scene_of(scene, import_)
    motion, _ = motions(made, contact=touching(scene))
    written = export_c(
        made,
        fs,
        folder,
        motion,
        name=name,
        seconds=seconds,
        params=params_of(set_, made),
        seed=seed,
        tile=tile,
        safety=safety(made) if any(safety.keywords.values()) else None,
        precision="float32" if float32 else "float64",
    )
    if json_:
        print_json(
            {
                "files": [str(path) for path in written.files],
                "state_bytes": written.state_bytes,
                "samples": written.samples,
                "errors": written.errors,
            }
        )
    elif not quiet:
        print(*written.files, sep="\n")
        print(
            f"state: about {counted(written.state_bytes, 'byte')}; self test:"
            f" {counted(written.samples, 'sample')}"
        )
        for output, (rms, most, peak) in written.errors.items():
            print(f"error of float32 in {output}: rms {rms:.2g}, at most {most:.2g} of {peak:.3g}")
        print(f"cc -std=c99 -O2 {name}.c {name}_test.c -o {name}_test -lm && ./{name}_test")
