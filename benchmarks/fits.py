"""Do fits find what made the data?  Each draw plays a block, adds noise to what it
gives, fits that, and plays what was found.

    python benchmarks/fits.py                        print, 200 draws
    python benchmarks/fits.py --only identify
    python benchmarks/fits.py --record               and keep the figures

They are kept in results/fits.csv; docs/explanation/fits.csv is their short form, for
docs/explanation/fits.rst.  It takes an hour of one core.
"""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from bench import Row, options, save

import stimlib
from stimlib import Input, Param, Scene
from stimlib.blocks import (
    chirp,
    constant,
    equalize,
    friction,
    generalized_maxwell,
    mode,
    springpot,
    texture,
    velocity,
)
from stimlib.design.texture import made_up
from stimlib.fitting import (
    fit,
    fit_generalized_maxwell,
    fit_springpot,
    fit_texture,
    springpot_force,
)
from stimlib.fitting.relaxation import MaterialFit, Scheme
from stimlib.plate import Plate, Resonance, drift, fit_frame, identify, mode_fit

DOCS = Path(__file__).parents[1] / "docs" / "explanation"
DRAWS, SEED = 200, 1
Array = np.ndarray
Intervals = Mapping[str, tuple[float, float]]


class Found(NamedTuple):
    """What one fit found, and how far what it plays is from what it fitted, of the
    peak; nan where a fit has no block.
    """

    values: Mapping[str, float]
    intervals: Intervals
    played: float = math.nan


class Case(NamedTuple):
    what: str
    noise: str
    truth: Mapping[str, float]
    draw: Callable[[np.random.Generator], Callable[[], Found]]


Y = Input("y", "m")
FS = 1000
T = np.arange(1500) / FS
WAVE = 0.005 * (1 - np.cos(10 * np.pi * T))
HOLD = np.minimum(0.05 * T, 0.01)
BOTH = 0.0287  # N, 0.5 % of the largest force


def played(block: Any, y: Array) -> Array:
    return stimlib.compile(Scene({"f": block}), FS).process(y[None])[0]


def noisy(clean: Array, rng: np.random.Generator, same: float = 0.0, part: float = 0.0) -> Array:
    size = np.hypot(same * np.abs(clean).max(), part * clean)
    return clean + size * rng.standard_normal(clean.size)


# Materials ----------------------------------------------------------------------------
def material(found: MaterialFit, y: Array) -> Found:
    again = played(found.block(Y), y)
    apart = float(np.abs(again - found.fitted).max() / np.abs(again).max())
    return Found(found.values, found.intervals, apart)


def of_springpot(scheme: Scheme, y: Array, same: float, part: float, **words: Any) -> Any:
    block = springpot(Y, 300.0, 0.25, "gl" if scheme == "gl" else "l1")
    clean = cache(lambda: played(block, y))

    def draw(rng):
        f = noisy(clean(), rng, same, part)
        return lambda: material(fit_springpot(T, y, f, scheme=scheme, **words), y)

    return draw


def of_uneven_springpot(rng):
    t = np.r_[0.0, np.geomspace(1e-3, 100, 80)]
    y = np.minimum(0.05 * t, 0.01)
    f = noisy(springpot_force(t, y, 300.0, 0.2), rng, part=0.02)

    def job():
        found = fit_springpot(t, y, f)
        return Found(found.values, found.intervals)

    return job


ARMS = {"k0": 100.0, "k1": 200.0, "tau1": 0.02, "k2": 100.0, "tau2": 0.3}


def of_maxwell(y: Array, same: float, part: float) -> Any:
    arms = [(ARMS["k1"], ARMS["tau1"]), (ARMS["k2"], ARMS["tau2"])]
    clean = cache(lambda: played(generalized_maxwell(Y, ARMS["k0"], arms), y))

    def draw(rng):
        f = noisy(clean(), rng, same, part)
        return lambda: material(fit_generalized_maxwell(T, y, f, arms=2), y)

    return draw


# Scenes -------------------------------------------------------------------------------
SHORT = T[:300]
MOVED = 0.01 * np.sin(20 * SHORT) ** 2


def of_scene(scene: Scene, truth: Mapping[str, float], name: str) -> Any:
    """Starts a third off."""
    motion = {name: MOVED}
    clean = cache(lambda: stimlib.render(scene, motion, fs=FS, params=truth).y[0])

    def draw(rng):
        f = noisy(clean(), rng, same=0.01)
        start = {key: value / 1.5 for key, value in truth.items()}

        def job():
            found = fit(scene, motion, f, start, fs=FS)
            again = stimlib.render(found.scene, motion, fs=FS).y[0]
            (signal,) = found.signals.values()
            apart = float(np.abs(again - signal).max() / np.abs(again).max())
            return Found(found.params, found.intervals, apart)

        return job

    return draw


def kelvin_voigt() -> Scene:
    return Scene({"f": Param("k", 1.0, "N/m") * Y + Param("b", 1.0, "N s/m") * velocity(Y)})


def live_springpot() -> Scene:
    return Scene({"f": springpot(Y, Param("chi", 1.0), Param("alpha", 0.5), "l1")})


def sliding() -> Scene:
    return Scene(
        {
            "f": friction(
                Input("x", "m"),
                constant(1.0, "N"),
                Param("mu", 0.3),
                Param("stiffness", 1e3, "N/m"),
            )
        }
    )


# Plates -------------------------------------------------------------------------------
@cache
def swept(freq: float = 158.0, q: float = 10.0) -> tuple[Array, Array]:
    u = chirp(20.0, 400.0, 2.0)
    out = stimlib.render(Scene({"u": u, "y": 2e-6 * mode(u, freq, q=q)}), {}, fs=4000, seconds=2.5)
    return out["u"], out["y"]


def resonance(rng: np.random.Generator, freq: float = 158.0) -> Callable[[], Resonance]:
    u, y = swept(freq)
    recorded = noisy(y, rng, same=0.01)
    return lambda: identify(u, recorded, fs=4000)


def of_resonance(rng):
    job = resonance(rng)

    def found():
        r = job()
        return Found({"freq": r.freq, "q": r.q}, {"freq": r.freq_interval, "q": r.q_interval})

    return found


def of_drift(rng):
    """Five sweeps of a resonance that falls by 2 Hz a degree."""
    warm = [20.0, 20.5, 21.0, 21.5, 22.0]
    found = [resonance(rng, 160.0 - 2 * (w - 20.0))() for w in warm]

    def job():
        line = drift(found, warm)
        at, far = line(21.0), 1.959964
        return Found(
            {"freq": at, "slope": line.slope},
            {
                "freq": (at - far * line.freq_sd, at + far * line.freq_sd),
                "slope": (line.slope - far * line.slope_sd, line.slope + far * line.slope_sd),
            },
        )

    return job


PAPER = replace(Plate.paper(), terms=8)
PLATE = replace(PAPER, clamp_stiffness=15 * PAPER.stiffness / PAPER.length)


def of_frame(rng):
    clean = cache(lambda: PLATE.frequencies(4)({}))()
    measured = {k: float(clean[k]) * (1 + 0.01 * rng.standard_normal()) for k in (0, 1, 3)}

    def job():
        found = fit_frame(replace(PLATE, E=0.9 * PLATE.E), measured, vary=("E",))
        return Found({"E": found.plate.E}, {})

    return job


def of_profile(rng):
    """Five knots; what is looked at lies between two of them."""
    knots, at = np.array([0.0, 0.025, 0.05, 0.075, 0.1]), 0.053
    shape = PLATE.shape(0, at + knots, PLATE.width / 2)
    measured = shape * (1 + 0.01 * rng.standard_normal(5))

    def job():
        table = mode_fit(PLATE, origin=at)(knots, measured)
        between = float(np.interp(0.0625, *table))
        x, v = Input("x", "m"), Input("v", "V")
        block = equalize(x, (knots, measured), signal=v, kind=mode_fit(PLATE, origin=at))
        places, scene = (0.05, 0.0625), Scene({"v": block})
        gains = [
            stimlib.render(scene, {"x": np.full(50, place), "v": np.ones(50)}, fs=FS)["v"][-1]
            for place in places
        ]
        ratio = gains[1] / gains[0] * between / np.interp(places[0], *table)
        return Found({"displacement": between}, {}, abs(float(ratio) - 1))

    return job


@cache
def stroked(seconds: float = 20.0) -> Array:
    n = int(seconds * FS)
    surface = made_up(2, (0.1, 0.2), (1.0, 2.0))
    scene = Scene({"a": texture(Input("v", "m/s"), Input("f", "N"), surface, seed=1)})
    return stimlib.compile(scene, FS).process(np.array([np.full(n, 0.1), np.full(n, 1.0)]))[0]


def of_texture(rng):
    """Another seed for each draw; the level of the noise that is played again."""
    n, seed = 20 * FS, int(rng.integers(1 << 30))
    surface = made_up(2, (0.1, 0.2), (1.0, 2.0))
    stroke = np.array([np.full(n, 0.1), np.full(n, 1.0)])

    def played(model, seed):
        scene = Scene({"a": texture(Input("v", "m/s"), Input("f", "N"), model, seed=seed)})
        return stimlib.compile(scene, FS).process(stroke)[0]

    recorded = played(surface, seed)

    def job():
        found = fit_texture(recorded, *stroke, FS, speeds=1, forces=1)
        again = played(found.model, seed + 1)
        return Found({"rms": float(again.std())}, {})

    return job


def cases() -> dict[str, Case]:
    pot = {"chi": 300.0, "alpha": 0.25}
    far = {"chi": 300.0, "alpha": 0.2}
    knot = float(PLATE.shape(0, 0.053 + 0.0625, PLATE.width / 2))
    return {
        "springpot gl": Case(
            "``fit_springpot(scheme='gl')``, 5 Hz",
            "1 % of the peak",
            pot,
            of_springpot("gl", WAVE, 0.01, 0.0),
        ),
        "springpot l1": Case(
            "``fit_springpot(scheme='l1')``, 5 Hz",
            "1 % of the peak",
            pot,
            of_springpot("l1", WAVE, 0.01, 0.0),
        ),
        "springpot hold": Case(
            "``fit_springpot``, a hold",
            "2 % of each",
            pot,
            of_springpot("exact", HOLD, 0.0, 0.02),
        ),
        "springpot both": Case(
            "``fit_springpot(sigma=(..))``, 5 Hz",
            "0.5 % of the peak and 5 % of each",
            pot,
            of_springpot("exact", WAVE, 0.005, 0.05, sigma=(BOTH, 0.05)),
        ),
        "springpot uneven": Case(
            "``fit_springpot``, uneven times", "2 % of each", far, of_uneven_springpot
        ),
        "maxwell": Case(
            "``fit_generalized_maxwell``, 5 Hz", "1 % of the peak", ARMS, of_maxwell(WAVE, 0.01, 0)
        ),
        "maxwell hold": Case(
            "``fit_generalized_maxwell``, a hold", "1 % of each", ARMS, of_maxwell(HOLD, 0.0, 0.01)
        ),
        "scene": Case(
            "``stimlib.fit``, spring and damper",
            "1 % of the peak",
            {"k": 300.0, "b": 3.0},
            of_scene(kelvin_voigt(), {"k": 300.0, "b": 3.0}, "y"),
        ),
        "scene springpot": Case(
            "``stimlib.fit``, springpot",
            "1 % of the peak",
            pot,
            of_scene(live_springpot(), pot, "y"),
        ),
        "scene friction": Case(
            "``stimlib.fit``, friction",
            "1 % of the peak",
            {"mu": 0.5, "stiffness": 800.0},
            of_scene(sliding(), {"mu": 0.5, "stiffness": 800.0}, "x"),
        ),
        "identify": Case(
            "``identify``", "1 % of the peak", {"freq": 158.0, "q": 10.0}, of_resonance
        ),
        "drift": Case(
            "``drift`` of five sweeps", "1 % of the peak", {"freq": 158.0, "slope": -2.0}, of_drift
        ),
        "frame": Case(
            "``fit_frame``, three modes", "1 % of each frequency", {"E": PLATE.E}, of_frame
        ),
        "profile": Case(
            "``mode_fit``, five knots", "1 % of each", {"displacement": knot}, of_profile
        ),
        "texture": Case(
            "``fit_texture``, 20 s",
            "another seed",
            {"rms": float(stroked(2000.0).std())},
            of_texture,
        ),
    }


def measured(case: Case, draws: int, seed: int = SEED) -> list[Row]:
    """Bias and spread in percent, coverage of the 95 % intervals, seconds of a fit."""
    rng, found, seconds = np.random.default_rng(seed), [], []
    for _ in range(draws):
        job = case.draw(rng)
        begin = time.perf_counter()
        found.append(job())
        seconds.append(time.perf_counter() - begin)
    rows = []
    for name, truth in case.truth.items():
        off = 100 * np.array([one.values[name] / truth - 1 for one in found])
        inside = (
            [low <= truth <= high for one in found for low, high in [one.intervals[name]]]
            if found[0].intervals
            else []
        )
        rows.append(
            {
                "what": case.what,
                "noise": case.noise,
                "number": name,
                "bias %": float(off.mean()),
                "its error %": float(off.std(ddof=1) / math.sqrt(draws)),
                "spread %": float(off.std(ddof=1)),
                "in interval %": 100 * float(np.mean(inside)) if inside else "",
                "played": max(one.played for one in found),
                "seconds": float(np.median(seconds)),
                "draws": draws,
            }
        )
    return rows


def short(r: Row) -> list[str]:
    inside = r["in interval %"]
    return [
        r["what"],
        r["noise"],
        r["number"],
        f"{r['bias %']:+.2g} ± {r['its error %']:.1g} %",
        f"{r['spread %']:.2g} %",
        "" if inside == "" else f"{inside:.3g} %",
        "" if math.isnan(r["played"]) else f"{r['played']:.0e}",
        f"{r['seconds']:.2g}",
        r["draws"],
    ]


if __name__ == "__main__":
    parser = options(__doc__)
    parser.add_argument("--only", default="", help="cases whose name has this in it")
    parser.add_argument("--draws", type=int, default=DRAWS)
    given = parser.parse_args()
    rows = [
        row
        for name, case in cases().items()
        if given.only in name
        for row in measured(case, given.draws)
    ]
    save("fits", rows, given.record)
    if given.record:
        with (DOCS / "fits.csv").open("w", newline="") as f:
            csv.writer(f, lineterminator="\n").writerows(map(short, rows))
