"""How small an error does each check of the verifier see, against the length of the
recording?

    PYTHONPATH=tests python benchmarks/power.py --record

writes results/power.csv, the pictures docs/pictures/power_*.svg and, of 10 s,
docs/explanation/power.csv; it takes ten minutes.

searched: a fault is put into a block, or into the wiring of a scene, which is rendered
and verified with the fault inside, until the smallest size that fails is known to 10 %.
computed: by ``stimlib.checks.power``, for noise; periodograms are drawn, and faulty
scenes rendered and verified, to see whether it is so.  asked: the law of a scene, told
other numbers.  See docs/explanation/power.rst.
"""

from __future__ import annotations

import csv
import dataclasses as dc
import importlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import matplotlib as mpl
import numpy as np
from bench import Row, options, save
from faults import scaled
from matplotlib.figure import Figure
from timing import machine

import stimlib
from stimlib import Input, Scene, blocks as b
from stimlib.analysis import spectra
from stimlib.blocks.fir_filters import Differentiator
from stimlib.blocks.impedance import FirstOrder, Velocity
from stimlib.blocks.noise import Pinking, PinkNoise
from stimlib.blocks.springpots import Springpot
from stimlib.blocks.tracking import Track
from stimlib.blocks.viscoelastic import MaxwellArms
from stimlib.checks.power import KINDS, Shows
from stimlib.motion.generators import constant_speed, minimum_jerk, sinusoid
from stimlib.motion.text import parse_motion
from stimlib.scenes import ROWS, SHIPPED, bumps, soft_surface, squeeze, viscoelastic

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"
SUMMARY = Path(__file__).parents[1] / "docs" / "explanation" / "power.csv"
SURELY = {"searched": "always", "computed": "95 of 100"}
FS, SEED = 8000, 1
COMPUTED, SEARCHED, ASKED = (0.5, 2.0, 10.0, 60.0), (0.5, 2.0, 10.0), 2.0  # s
DRAWN, RENDERED, RENDERED_AT = 200, 20, 2.0  # periodograms, renderings, and their length in s
X = Input("x", "m")


# Faults -------------------------------------------------------------------------------
class Fault(NamedTuple):
    """Something that is wrong by a size, in a scene, and the check that shall see
    it.
    """

    check: str
    kind: str
    unit: str
    owner: Any
    attribute: str
    wrong: Callable[[float], Any]
    """What stands in the attribute's place, for a size."""
    scene: Callable[[], Scene]
    motion: Mapping[str, Any]
    lengths: tuple[float, ...] = SEARCHED


def part(v: Any, e: float) -> Any:
    return v * (1 + e)


def more(v: Any, e: float) -> Any:
    return v + e


def decibel(v: Any, e: float) -> Any:
    return v * 10 ** (e / 20)


def number(owner: type, name: str, change: Callable[[Any, float], Any] = part) -> tuple:
    """A number of a block's design is wrong."""
    return (
        owner,
        "design",
        lambda e: scaled(owner.design, lambda p: p._replace(**{name: change(getattr(p, name), e)})),
    )


def meant(owner: type, name: str, change: Callable[[Any, float], Any] = part) -> tuple:
    """A block is designed for another number than the one that it stands for."""
    honest = owner.design

    def wrong(e: float) -> Callable:
        return lambda self, fs: honest(
            dc.replace(self, **{name: change(getattr(self, name), e)}), fs
        )

    return owner, "design", wrong


def wired(scene: str, name: str, change: Callable[..., Any]) -> tuple:
    """A scene is put together wrongly: change(honest, size, what it is called with
    ..).
    """
    module = importlib.import_module(f"stimlib.scenes.{scene}")
    honest = getattr(module, name)
    return module, name, lambda e: lambda *a, **k: change(honest, e, *a, **k)


def late(x: Any, e: float) -> Any:
    """A signal behind a delay of a part e of a sample, as good as a straight line
    between samples is.
    """
    return x + e * (b.delay(x, 1) - x)


def alone(block: Callable[[Any], Any]) -> tuple:
    """A block on its own: its law is that of its response, whatever the recording."""
    return lambda: Scene({"y": block(X)}), {"x": sinusoid(0.01, 3.0)}, (0.05,)


FINGER, HAND = partial(squeeze, fingers=1, level=1.0), {"x1": minimum_jerk()}
FINGERS, WAVE = partial(squeeze, level=1.0), {"y": sinusoid(0.01, 1.0)}
STROKE, STEADY = {"x": sinusoid(0.05, 1.0)}, {"x": constant_speed(0.05, 1.0)}
HANDS = HAND | {"x2": minimum_jerk(depth=0.015, rise=0.25)}
PINK = lambda: Scene({"y": b.pink_noise(1.0, seed=1, f_low=10.0)}), {}, (0.05,)
LAW, LINE = "voltage: envelope times carrier", "voltage: rms of the line"
BUMP = "bumps", "bump"
BLOCKS = [
    Fault("PinkNoise: physical law", "level", "dB", *number(PinkNoise, "r", decibel), *PINK),
    Fault(
        "Pinking: physical law",
        "level",
        "dB",
        *number(Pinking, "r", decibel),
        *alone(lambda x: b.pinking(x, 10.0)),
    ),
    Fault(
        "Differentiator: physical law",
        "level",
        "of it",
        *number(Differentiator, "taps"),
        *alone(b.differentiator),
    ),
    Fault(
        "Differentiator: physical law",
        "delay",
        "samples",
        *number(Differentiator, "taps", lambda h, e: (1 - e) * h + e * np.roll(h, 1)),
        *alone(b.differentiator),
    ),
    Fault(
        "Velocity: physical law", "pole", "of it", *meant(Velocity, "cutoff"), *alone(b.velocity)
    ),
    Fault(
        "FirstOrder: physical law",
        "pole",
        "of it",
        *meant(FirstOrder, "tau"),
        *alone(lambda x: b.first_order(x, 0.01)),
    ),
    Fault("Track: physical law", "pole", "of it", *number(Track, "q"), *alone(b.track)),
    Fault(
        "MaxwellArms: physical law",
        "level",
        "of it",
        *number(MaxwellArms, "r"),
        *alone(lambda x: b.maxwell(x, 200.0, 4.0)),
    ),
    Fault(
        "Springpot: physical law",
        "level",
        "of it",
        *number(Springpot, "scale"),
        viscoelastic,
        WAVE,
        (0.05,),
    ),
    Fault(
        "Springpot: physical law",
        "order",
        "of 1",
        *meant(Springpot, "order", more),
        viscoelastic,
        WAVE,
        (0.05,),
    ),
]
SCENES = [
    Fault(
        "force1: mean part is k x",
        "slope",
        "of k",
        *wired("squeeze", "spring", lambda f, e, *a: part(f(*a), e)),
        FINGER,
        HAND,
    ),
    Fault(
        "force1: vibration law",
        "level",
        "of it",
        *wired("squeeze", "constant", lambda f, e, v, unit: f(v * np.sqrt(1 + e), unit)),
        FINGER,
        HAND,
    ),
    Fault("force1: vibration law", "pole", "of it", *meant(Velocity, "cutoff"), FINGER, HAND),
    Fault(
        "force1: vibration law",
        "delay",
        "samples",
        *wired("squeeze", "velocity", lambda f, e, x, *a: f(late(x, e), *a)),
        FINGER,
        HAND,
    ),
    Fault("force: full sum", "level", "of it", *number(Springpot, "scale"), viscoelastic, WAVE),
    Fault("force: full sum", "order", "of 1", *meant(Springpot, "order", more), viscoelastic, WAVE),
    Fault(
        "force: full sum",
        "delay",
        "samples",
        *wired("viscoelastic", "springpot", lambda f, e, y, *a, **k: f(late(y, e), *a, **k)),
        viscoelastic,
        WAVE,
    ),
    Fault(LAW, "level", "of it", *wired(*BUMP, lambda f, e, *a: part(f(*a), e)), bumps, STROKE),
    Fault(
        LAW,
        "duty",
        "of it",
        *wired(*BUMP, lambda f, e, x, w, duty, *a: f(x, w, (1 - e) * duty, *a)),
        bumps,
        STROKE,
    ),
    Fault(
        LAW, "delay", "samples", *wired(*BUMP, lambda f, e, x, *a: f(late(x, e), *a)), bumps, STROKE
    ),
    Fault(
        LAW,
        "frequency",
        "of it",
        *wired("bumps", "carrier", lambda f, e, freq, *a: f(part(freq, e), *a)),
        bumps,
        STROKE,
    ),
    Fault(
        LINE,
        "level",
        "of it",
        *wired(*BUMP, lambda f, e, *a: part(f(*a), e)),
        bumps,
        STEADY,
        SEARCHED[1:],
    ),
    Fault(
        LINE,
        "duty",
        "of it",
        *wired(*BUMP, lambda f, e, x, w, duty, *a: f(x, w, (1 - e) * duty, *a)),
        bumps,
        STEADY,
        SEARCHED[1:],
    ),
]
LOUDER = Fault("force1: spectrum", "level", "dB", *number(PinkNoise, "r", decibel), FINGERS, HANDS)
# with a pen nothing of it is a parameter
LIVE = {**SHIPPED, "soft_surface": partial(soft_surface, device="mouse")}


# How small ----------------------------------------------------------------------------
def verified(
    scene: Scene, motion: Mapping[str, Any], seconds: float, seed: int = SEED
) -> stimlib.Report:
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, FS, seconds, seed=seed))


def excess(fault: Fault, size: float, seconds: float, seed: int = SEED) -> float:
    """How many times its limit the check measures in a rendering with the fault inside:
    above 1 it fails.
    """
    with patch.object(fault.owner, fault.attribute, fault.wrong(size)):
        report = verified(fault.scene(), fault.motion, seconds, seed)
    return max(c.measured / c.limit for c in report.checks if fault.check in c.name)


def threshold(fault: Fault, seconds: float, size: float = 1e-3) -> float:
    """A size that is caught, while one 10 % smaller passes.

    What a check measures grows nearly in proportion to the size, from what it measures
    of a correct rendering: that says where to look next; else the exponent is halved.
    """
    low, high, honest = 0.0, 1.0, excess(fault, 0.0, seconds)
    while high > 1.1 * low:
        over = excess(fault, size, seconds)
        low, high = (low, size) if over > 1 else (size, high)
        size *= (1 - honest) / max(over - honest, 1e-18) * (1.04 if over <= 1 else 1 / 1.04)
        if not low < size < high:
            size = np.sqrt(max(low, 1e-18) * high)
    return high


def drawn(f: np.ndarray, kind: str, size: float, alarm: float) -> float:
    """How many of so many drawn periodograms, all with this error, the test of a
    spectrum refuses.
    """
    rng, ratio = np.random.default_rng(SEED), KINDS[kind][1](f, size)
    return float(
        np.mean(
            [
                spectra.judged(f, ratio * rng.exponential(size=f.size)).p <= alarm
                for _ in range(DRAWN)
            ]
        )
    )


# Rows ---------------------------------------------------------------------------------
def told(s: Shows, seconds: float, how: str, seen: Mapping[str, float]) -> Row:
    found = {
        "check": s.check,
        "kind": s.kind,
        "seconds": seconds,
        "size": float(f"{s.size:.4g}"),
        "unit": s.unit,
        "how": how,
    }
    return found | {"seed": SEED, "drawn": "", "rendered": ""} | seen


def searched() -> Iterator[Row]:
    for f in BLOCKS + SCENES:
        size = 1e-3
        for seconds in f.lengths:
            size = threshold(f, seconds, size)
            yield told(Shows(f.check, f.kind, size, f.unit, 1.0), seconds, "searched", {})


def computed() -> Iterator[Row]:
    """The checks of the noise and the slope of a correct rendering."""
    for seconds in COMPUTED:
        report = verified(FINGERS(), HANDS, seconds)
        tap, alarm = report.evidence.taps[0], report.evidence.share
        f = spectra.bins(tap.stream.size, FS, tap.f_low, tap.f_high) * FS / tap.stream.size
        for s in report.certainty():
            if s.chance < 1 and s.check.startswith("force1"):
                seen = (
                    {"drawn": drawn(f, s.kind, s.size, alarm)}
                    if s.kind in KINDS and s.size == s.size
                    else {}
                )
                if seconds == RENDERED_AT and s.kind == LOUDER.kind:
                    seen["rendered"] = float(
                        np.mean(
                            [excess(LOUDER, s.size, seconds, seed) > 1 for seed in range(RENDERED)]
                        )
                    )
                yield told(s, seconds, "computed", seen)


def asked() -> Iterator[Row]:
    """The law of every scene, told other numbers than those of a correct rendering."""
    for name, row in ROWS.items():
        scene = LIVE[name]()
        motion = {i: parse_motion(row.drive[i]) for i in scene.inputs}
        for s in verified(scene, motion, ASKED).certainty():
            if s.check == "law of the scene":
                yield told(s._replace(check=f"law of {name}"), ASKED, "asked", {})


def measured() -> list[Row]:
    """All rows, printed as they come."""
    rows = []
    for make in (computed, asked, searched):
        for r in make():
            print(*r.values(), sep=", ", flush=True)
            rows.append(r)
    return rows


# Pictures -----------------------------------------------------------------------------
def lines(ax: Any, rows: list[Row], label: str) -> None:
    """Size over length."""
    ax.loglog([r["seconds"] for r in rows], [r["size"] for r in rows], "o-", ms=4, label=label)
    ax.set_xlabel("recording / s")
    ax.grid(alpha=0.3, which="both")


def picture_of_chance(rows: list[Row], fig: Figure) -> None:
    kinds = list(dict.fromkeys(r["kind"] for r in rows))
    for ax, kind in zip(fig.subplots(2, 3, sharex=True).flat, kinds, strict=True):
        some = [r for r in rows if r["kind"] == kind]
        lines(ax, some, kind)
        ax.set(title=f"{some[0]['check'].split(': ')[-1]}:\n{kind}", ylabel=some[0]["unit"])


def picture_of_scenes(rows: list[Row], fig: Figure) -> None:
    checks = list(dict.fromkeys(r["check"] for r in rows))
    for ax, check in zip(fig.subplots(1, len(checks), sharex=True), checks, strict=True):
        for kind, unit in dict.fromkeys(
            (r["kind"], r["unit"]) for r in rows if r["check"] == check
        ):
            lines(
                ax,
                [r for r in rows if (r["check"], r["kind"]) == (check, kind)],
                f"{kind} ({unit})",
            )
        ax.set(
            title=check.replace(": ", ":\n"),
            ylabel="smallest that is seen" if check == checks[0] else "",
        )
        ax.legend(fontsize=7)


def picture_of_dots(rows: list[Row], fig: Figure) -> None:
    ax = fig.subplots()
    ax.semilogx(
        [r["size"] for r in rows],
        [f"{r['check'].split(':')[0]}: {r['kind']} / {r['unit']}" for r in rows],
        "o",
    )
    ax.invert_yaxis()
    ax.grid(alpha=0.3)
    ax.set_xlabel("smallest that is seen")


def draw(rows: list[Row]) -> None:
    of_blocks = {f.check for f in BLOCKS}
    for name, size, make, some in (
        ("chance", (10, 5.5), picture_of_chance, [r for r in rows if r["how"] == "computed"]),
        (
            "scenes",
            (13, 3.6),
            picture_of_scenes,
            [r for r in rows if r["how"] == "searched" and r["check"] not in of_blocks],
        ),
        ("blocks", (8, 3.2), picture_of_dots, [r for r in rows if r["check"] in of_blocks]),
        ("laws", (8, 6.0), picture_of_dots, [r for r in rows if r["how"] == "asked"]),
    ):
        with mpl.rc_context({"svg.hashsalt": "stimlib", "svg.fonttype": "none", "font.size": 9}):
            fig = Figure(figsize=size, layout="constrained")
            make(some, fig)
            fig.savefig(PICTURES / f"power_{name}.svg", metadata={"Date": None})


def summary(rows: Iterable[Row]) -> list[tuple[str, ...]]:
    """Of 10 s, the check, what is wrong, the smallest size that is seen, and how
    surely.
    """
    ten = (r for r in rows if r["how"] in SURELY and float(r["seconds"]) == 10.0)
    return [
        (r["check"], r["kind"], f"{float(r['size']):.2g} {r['unit']}", SURELY[r["how"]])
        for r in ten
    ]


if __name__ == "__main__":
    given = options(__doc__).parse_args()
    rows = measured()
    save("power", [{"check": machine()}, *rows], given.record)
    if given.record:
        draw(rows)
        with SUMMARY.open("w", newline="") as f:
            csv.writer(f, lineterminator="\n").writerows(summary(rows))
