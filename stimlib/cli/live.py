"""The commands ``live`` and ``share``: a scene on a page in the browser."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import BadValue, counted
from . import options as opt
from .app import command, errors, note, print_json, say
from .motions import motions_of
from .scene import SceneText, params_of, scene_of, touching
from .watching import Watched


def page_safety_of(
    scales: Callable[[], dict[str, float]],
    *,
    full_scale: Annotated[
        str | None,
        typer.Option(
            help=(
                "Physical value that is 1.0 in sound and recording, such as 50 (N); outputs are "
                "limited to it. If units differ: a=50,b=0.1. By default twice the peak of a trial"
                " run."
            ),
            show_default=False,
        ),
    ] = None,
    peak: opt.Peak = None,
    static: opt.Static = None,
    slew: opt.Slew = None,
    passivity: opt.Passive = None,
) -> Any:
    """Return the safety stage of a page; full scales default to those of the page."""
    full_scale = full_scale or ",".join(f"{name}={v!r}" for name, v in scales().items())
    return opt.safety_of(
        None, full_scale=full_scale, peak=peak, static=static, slew=slew, passivity=passivity
    )


Ranges = Annotated[
    list[str],
    typer.Option(
        "--range",
        help="Range of an input or of a slider, in its unit: [bold]x=0:0.05[/]. Repeatable.",
    ),
]


@command("live", safety=page_safety_of, motions=motions_of)
def live(
    scene: SceneText,
    safety: Any,
    motions: Any,
    host: Annotated[
        str,
        typer.Option(
            help=(
                "Address to listen at. With another address than 127.0.0.1, anybody on the "
                "network who has the token can connect."
            )
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(help="Port to listen at; 0 takes a free one.", min=0, max=65535)
    ] = 0,
    no_browser: Annotated[
        bool,
        typer.Option(
            "--no-browser", help="Print the address only; by default a browser opens the page."
        ),
    ] = False,
    range_: Ranges = [],
    smooth: Annotated[
        float,
        typer.Option(
            help=(
                "Bandwidth in Hz of the filter that follows the pointer, at most a quarter of the "
                "sample rate. A lower one is smoother but later: the delay is 25 ms + 320 ms / "
                "bandwidth, 65 ms by default."
            )
        ),
    ] = 8.0,
    folder: Annotated[
        Path, typer.Option(help="Folder for recordings; each is the log of a session.")
    ] = Path("."),
    block: Annotated[
        int | None, typer.Option(help="Samples per block; by default 4 ms.", show_default=False)
    ] = None,
    stream: opt.Stream = None,
    marker: opt.Marker = [],
    send: opt.Send = [],
    fs: opt.Rate = 8000.0,
    set_: opt.Params = [],
    seed: opt.Seed = 0,
    import_: opt.Import = [],
):
    r"""Explore a scene in the browser with a pointer.

    Sliders set its parameters; plots and sound show its outputs. When your own file is
    saved, its scene takes the place of the one before, within a session too: positions
    and sliders stay.

    Needs [bold]pip install 'stimlib\[live]'[/].  Mouse, pen and touch
    drive the first position inputs of a scene; every input may have another source, on
    the page or by --motion. A recording is the log of a session: [bold]stimlib
    replay[/] repeats it, [bold]stimlib verify --log[/] checks it.  Ctrl-C fades out.

    [bold]stimlib live "bumps(contact=True)"[/]

    [bold]stimlib live click_block.py:scene --range x=0:0.01[/]

    [bold]stimlib live soft_surface --motion "press=sinusoid(0.5, 1, mean=0.5)"[/]
    """
    watched = Watched(scene, import_)
    from ..live.describe import full_scales, ranges_of
    from ..live.server import Server  # which says what is not installed
    from ..live.stream import Stream

    made = scene_of(scene, import_)
    params, ranges = params_of(set_, made), opt.ranges(range_, "--range")
    ranges_of(made, ranges)
    given, _ = motions(made, contact=touching(scene), all_=False)
    if not folder.is_dir():
        raise BadValue(f"--folder {folder}: there is no such folder: make it first")
    say(f"compiling {scene} ..")
    with opt.senders(send) as senders, opt.rows_of(stream) as rows:
        page = Stream(
            made,
            fs,
            lambda scene, ranges: safety(lambda: full_scales(scene, fs, ranges)),
            title=scene,
            ranges=ranges,
            given=given,
            block=block,
            params=params,
            seed=seed,
            folder=folder,
            bandwidth=smooth,
            stream=rows,
            markers=marker,
            send=senders,
        )
        page.say = partial(errors.print, markup=False, highlight=False, soft_wrap=True)
        with closing(Server(page, host, port)) as server:
            page.warm_up()
            with watched.reloaded(page.reload, page.tell_error):
                _serve(server, not no_browser)


def _serve(server: Any, browser: bool) -> None:
    """Serve the page until Ctrl-C, and print its address."""
    if not server.private:
        note(
            f"{server.host}: anybody who has the address below can drive the scene, and anybody who"
            " can read the network can read what is sent: use it in a network of your own, and end"
            " it when you are done"
        )
    try:
        print(server.url, flush=True)
        errors.print("Ctrl-C ends")
        if browser:
            threading.Thread(target=webbrowser.open, args=[server.url], daemon=True).start()
        server.run()
    except KeyboardInterrupt:
        errors.print("faded out")
        raise typer.Exit(130) from None


@command("share", motions=motions_of)
def share_(
    scene: SceneText,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="HTML file to write.", show_default=False)
    ],
    motions: Any,
    title: Annotated[
        str, typer.Option(help="Heading of the page; by default SCENE.", show_default=False)
    ] = "",
    cite: Annotated[
        str,
        typer.Option(help="The paper that the page belongs to, as it is to be cited."),
    ] = "",
    range_: Ranges = [],
    seconds: opt.Length = None,
    fs: opt.Rate = 8000.0,
    set_: opt.Params = [],
    seed: opt.Seed = 0,
    quiet: opt.Quiet = False,
    import_: opt.Import = [],
    json_: opt.Json = False,
):
    """Write a scene as one HTML page that needs no Python and no server.

    A pointer drives it, sliders set its parameters, plots and sound show its outputs. A
    reader can also play the motion, and the page checks its samples.

    Needs clang with lld, or [bold]pip install ziglang[/].

    [bold]stimlib share squeeze --motion "minimum_jerk(depth=0.02)" --out page.html[/]
    """
    from ..live.share import share

    made = scene_of(scene, import_)
    given, length = motions(made, contact=touching(scene), all_=False)
    page = share(
        made,
        fs,
        out,
        given if given or not made.inputs else None,
        length if seconds is None else seconds,
        params_of(set_, made),
        seed,
        title=title or Path(scene).name,  # the folders of a machine are nobody else's matter
        cite=cite,
        ranges=opt.ranges(range_, "--range"),
        progress=not quiet,
    )
    size = len(page.page.encode())
    if json_:
        facts = {"file": str(out), "bytes": size, "wasm_bytes": page.wasm_bytes}
        print_json(facts | {"samples": page.samples, "sha256": page.sha256})
    elif not quiet:
        print(f"{out}: {size / 1000:.0f} kB, of which {page.wasm_bytes / 1000:.0f} kB WebAssembly")
        if page.samples:
            print(
                f"the page checks {counted(page.samples, 'sample')} of each output: SHA-256"
                f" {page.sha256}"
            )
        else:
            print("without --motion the page has no samples to check")
