"""The command ``try``."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import BadValue, need, shown
from . import options as opt
from .app import command, print_json
from .scene import SceneText, number, params_of, scene_of


@command("try", safety=opt.safety_of)
def try_(
    scene: SceneText,
    safety: Any,
    device: Annotated[
        Path, typer.Option(help='A device as JSON, such as {"mass": 0.1, "damping": 0.5}.')
    ],
    hand: Annotated[
        str,
        typer.Option(help="Mass, damping and stiffness of the hand, in kg, N s/m and N/m."),
    ] = "0.02,1,100",
    tremor: Annotated[float, typer.Option(help="Amplitude of the hand's tremor in m.")] = 0.0,
    faults: Annotated[
        str | None,
        typer.Option(
            help=(
                "What fails, with times in s: [bold]jump=0.5:0.005,stuck=1:1.5,dropped=0.1,"
                "lost=0.1,saturated=0.5:2[/]."
            )
        ),
    ] = None,
    aim: Annotated[
        float | None, typer.Option(help="Where the hand wants to be, in m; by default at --start.")
    ] = None,
    push: Annotated[float, typer.Option(help="A force of the hand in N.")] = 0.0,
    start: Annotated[float, typer.Option(help="Where it begins, in m, at rest.")] = 0.0,
    axis: Annotated[
        str | None,
        typer.Option(help="Output and input of the device, such as [bold]force1=x1[/]."),
    ] = None,
    seconds: Annotated[float, typer.Option(help="Length in s.")] = 3.0,
    fs: opt.Rate = 1000.0,
    set_: opt.Params = [],
    seed: opt.Seed = 0,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Try a force scene on a virtual device in a virtual hand.

    [bold]stimlib try wall --device device.json --start -0.01 --aim 0.02[/]
    """
    from ..motion.text import pairs
    from ..virtual import Faults, Hand, read_device, try_on

    made = scene_of(scene, import_)
    numbers = [number(text, "--hand") for text in hand.split(",")]
    if len(numbers) != 3:
        raise BadValue(f"--hand {hand}: give mass,damping,stiffness, such as 0.02,1,100")
    mass, damping, stiffness = numbers
    wrong = pairs(faults.split(",") if faults else (), "--faults", "dropped=0.1 or jump=0.5:0.005")
    need("--faults", wrong, [f.name for f in dc.fields(Faults)], "fault")
    given: dict[str, Any] = {
        name: tuple(number(part, f"--faults {name}") for part in text.split(":"))
        for name, text in wrong.items()
    }
    trial = try_on(
        made, read_device(device), Hand(mass, damping, stiffness, tremor), fs=fs,
        seconds=seconds, start=start, aim=aim, push=push, params=params_of(set_, made), seed=seed,
        axis=None if axis is None else axis.partition("=")[::2],
        safety=safety(made) if any(safety.keywords.values()) else None,
        faults=Faults(**{name: v if v[1:] else v[0] for name, v in given.items()}),
    )  # fmt: skip
    if json_:
        amplitude, rate = trial.cycle
        facts = {"settles": trial.settles, "amplitude": amplitude, "frequency": rate}
        print_json(facts | {"contacts": trial.contacts, "given": trial.given} | trial.told)
    else:
        print(shown(trial))
        if not (aim or push or tremor or faults):
            print(
                "the hand rests where it starts; move it with --aim 0.02, --push 2 or --tremor 1e-3"
            )
