"""Do fits recover the truth of simulated people?  PSE and JND, their intervals and
problems, for each design and kind of observer.

    python benchmarks/recovery.py                           print, 200 people a cell
    python benchmarks/recovery.py --record --people 1000    and keep the figures

They are kept in results/recovery.csv and, of sets of answers to fixed levels,
results/coverage.csv; docs/explanation/recovery.csv and coverage.csv are their short
forms.  It takes ten minutes of one core.  See docs/explanation/recovery.rst.

The designs are those of ``stimlib.experiments``; nothing is rendered.  A person is a
curve over log10 of the level whose middle and spread may change from trial to trial.
The truth is the curve averaged over these changes, without lapses and guesses.
"""

from __future__ import annotations

import csv
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from bench import Row, options, save
from scipy.optimize import brentq
from timing import machine

from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    Quest,
    Staircase,
    Trial,
    psychometrics,
)
from stimlib.experiments.fits import Fit
from stimlib.experiments.goodness import allowed, dispersion
from stimlib.experiments.likelihood import PROBIT, Model, Sets, curve, maximum
from stimlib.experiments.trial import Design

DOCS = Path(__file__).parents[1] / "docs" / "explanation"
TRIALS, BLOCK, SEED = 140, 20, 1
SCORES = {"yes": 1.0, "no": 0.0}
ANSWERS = {name: Answer({"more": name}) for name in SCORES}
NO_CURVE = {"few", "separated", "falling", "flat"}
Array = np.ndarray


@dataclass(frozen=True)
class Bare:
    """A task without stimuli, which are not needed here."""

    chance: float | None = None
    condition: str = "bare"

    def trial(self, level: float, seed: int, n: int) -> Trial:
        """A trial at a level."""
        return Trial("bare", (), ("more",), level, scores=SCORES, chance=self.chance)


class Curve(NamedTuple):
    """What is measured: a link, its spread in log10 units, and the chance level."""

    link: str
    sigma: float
    guess: float | None

    def level(self, z: float) -> float:
        """The level that is z spreads from the middle, which is at 1."""
        return float(10 ** (self.sigma * z))


COMPARISON = Curve("probit", 0.08, None)  # a JND of 13 %
DETECTION = Curve("weibull", 1 / (2 * math.log(10)), 0.5)  # an exponent of 2, in 2AFC


# People -------------------------------------------------------------------------------
class Kind(NamedTuple):
    """A kind of observer; shifts and scales are in spreads of the curve."""

    lapse: float = 0.0
    wander: float = 0.0
    """Standard deviation of the middle between blocks of 20 trials."""
    bias: float = 0.0
    """Shift of the middle with the order of the intervals.

    In a detection the chance level shifts instead, by two fifths of it.
    """
    tires: float = 0.0
    """How far the spread grows, from 1 less half of it on to 1 and half of it."""
    nu: float = math.inf
    """Of a beta distribution of the probability, drawn anew at each level."""

    def states(self, guess: float | None) -> tuple[Array, Array]:
        """Shifts and scales in the long run, all as likely."""
        from scipy.special import ndtri

        parts = (np.arange(400) + 0.5) / 400
        shifts = self.wander * ndtri(parts)
        if self.bias and guess is None:
            shifts = np.where(parts < 0.5, -self.bias, self.bias)
        return shifts, 1 + self.tires * (parts - 0.5)


KINDS = {
    "stationary": Kind(),
    "drifting between blocks": Kind(wander=0.5),
    "scattering, nu = 15": Kind(nu=15.0),
    "lapsing 2 %": Kind(lapse=0.02),
    "lapsing 5 %": Kind(lapse=0.05),
    "biased to an interval": Kind(bias=0.5),
    "fatigued": Kind(tires=0.5),
}


def truth(of: Curve, kind: Kind) -> tuple[float, float]:
    """Middle and spread of the average curve, in spreads of the momentary one."""
    shifts, scales = kind.states(of.guess)
    F, inverse = curve(of.link).F, curve(of.link).inverse

    def found(p: float) -> float:
        return brentq(lambda z: np.mean(F((z - shifts) / scales)) - p, -20, 20)

    return found(0.5), (found(0.75) - found(0.5)) / float(inverse(0.75))


def person(of: Curve, kind: Kind, rng: np.random.Generator) -> Callable[[float, int], bool]:
    """Somebody who says yes or no to a level in a trial of a number."""
    middles = kind.wander * rng.normal(size=TRIALS // BLOCK + 1)
    drawn: dict[float, float] = {}
    F = curve(of.link).F

    def says(level: float, n: int) -> bool:
        z, low = math.log10(level) / of.sigma, kind.lapse if of.guess is None else of.guess
        way = math.copysign(kind.bias, rng.random() - 0.5)
        shift = middles[n // BLOCK] + (way if of.guess is None else 0.0)
        low += 0.0 if of.guess is None else 0.4 * way
        scale = 1 + kind.tires * (n / TRIALS - 0.5)
        p = low + (1 - low - kind.lapse) * float(F((z - shift) / scale))
        if math.isfinite(kind.nu):
            a = min(max(p, 1e-9), 1 - 1e-9) * kind.nu
            p = drawn.setdefault(round(z, 6), rng.beta(a, kind.nu - a))
        return bool(rng.random() < p)

    return says


# Designs ------------------------------------------------------------------------------
def constant(of: Curve, low: float, high: float) -> list[Design]:
    """Seven levels, 20 times each."""
    task, z = Bare(of.guess), np.linspace(low, high, 7)
    return [ConstantStimuli(tuple((task, of.level(v)) for v in z), repeats=TRIALS // 7)]


def stairs(of: Curve, *tracks: Mapping[str, float]) -> list[Design]:
    """Staircases with steps of 2, 1 and then half a spread; dB."""
    made = []
    for track in tracks:
        rule = dict(track)
        start, times = rule.pop("start"), rule.pop("times", 1.0)
        made.append(
            Staircase(
                Bare(of.guess),
                of.level(start),
                (of.level(-8.0), of.level(8.0)),
                steps=tuple(times * 20 * of.sigma * k for k in (2.0, 1.0, 0.5)),
                reversals=None,
                max_trials=TRIALS // len(tracks),
                **rule,
            )
        )
    return made


def quest(of: Curve) -> list[Design]:
    """QUEST+ with a lapse rate of 2 %, over the levels as they are."""
    levels, means = (tuple(of.level(z) for z in np.linspace(-v, v, 17)) for v in (3.0, 2.0))
    wide = np.geomspace(0.25, 4, 7)
    row = (
        {"deviations": tuple(of.sigma * math.log(10) * wide)}
        if of.link == "probit"
        else {"slopes": tuple(wide / of.sigma / math.log(10))}
    )
    return [Quest(Bare(of.guess), levels, means, trials=TRIALS, **row)]


DESIGNS: dict[Curve, dict[str, Callable[[], list[Design]]]] = {
    COMPARISON: {
        "constant stimuli, 7 x 20": partial(constant, COMPARISON, -2.1, 2.1),
        "1 up 1 down": partial(stairs, COMPARISON, {"start": 3.0}, {"start": -3.0}),
        "1 up 2 down, 2 up 1 down": partial(
            stairs, COMPARISON, {"start": 3.0, "down": 2}, {"start": -3.0, "up": 2}
        ),
        "weighted, 75 and 25 %": partial(
            stairs,
            COMPARISON,
            {"start": 3.0, "target": 0.75},
            {"start": -3.0, "target": 0.25, "times": 3.0},
        ),
        "QUEST+": partial(quest, COMPARISON),
    },
    DETECTION: {
        "constant stimuli, 7 x 20": partial(constant, DETECTION, -2.5, 1.8),
        "1 up 2 down": partial(
            stairs, DETECTION, {"start": 2.5, "down": 2}, {"start": 1.5, "down": 2}
        ),
        "weighted, 75 %": partial(
            stairs, DETECTION, {"start": 2.5, "target": 0.75}, {"start": 1.5, "target": 0.75}
        ),
        "QUEST+": partial(quest, DETECTION),
    },
}


def session(
    designs: Sequence[Design], says: Callable[[float, int], bool], seed: int
) -> tuple[list[float], list[float]]:
    """Levels and outcomes of one person, the designs in random turns."""
    rng = np.random.default_rng([SEED, seed])
    states = [d.init(seed) for d in designs]
    levels: list[float] = []
    outcomes: list[float] = []
    while True:
        due = [d.next(s) for d, s in zip(designs, states, strict=True)]
        live = [k for k, trial in enumerate(due) if trial is not None]
        if not live:
            return levels, outcomes
        k = live[int(rng.integers(len(live)))]
        trial = due[k]
        assert trial is not None and trial.level is not None
        answer = "yes" if says(trial.level, len(levels)) else "no"
        levels.append(trial.level)
        outcomes.append(SCORES[answer])
        states[k] = designs[k].update(states[k], ANSWERS[answer])


# Recovery -----------------------------------------------------------------------------
def middle_and_spread(v: Array) -> tuple[float, float]:
    """Median, and half of the distance from the 16th to the 84th percentile."""
    low, middle, high = np.quantile(v, [0.1587, 0.5, 0.8413])
    return float(middle), float(high - low) / 2


def inside(fits: Sequence[Fit], model: Model, at: float, sigma: float) -> tuple[Array, Array]:
    """Whether the profile intervals of fits hold a PSE, and a spread, on their axis.

    They do where the profile there has fallen by less than it may, which is quicker to
    see than to find the ends.
    """
    longest = max(fit.levels for fit in fits)
    rows = [np.pad(np.array(f.data).T, ((0, 0), (0, longest - f.levels))) for f in fits]
    level, yes, n = np.moveaxis(np.array(rows), 1, 0)
    given = Sets(np.log10(np.where(n > 0, level, 1.0)), yes, n)
    c = np.full(len(fits), at)
    best = maximum(given, c, model)
    held = (
        maximum(given, c, model, a=0 * c, start=best),
        maximum(given, c, model, b=0 * c + 1 / sigma, start=best),
    )
    may = allowed([f.dispersion for f in fits], [f.levels - f.parameters for f in fits])
    pse, jnd = (2 * (best.loglik - v.loglik) < may for v in held)
    return pse, jnd


def cell(of: Curve, kind: Kind, fits: Sequence[Fit], model: Model) -> Row:
    """The figures of one cell: errors of the PSE are in JNDs, of the JND in parts."""
    at, wide = truth(of, kind)
    jnd = wide * of.sigma * float(curve(of.link).inverse(0.75))
    good = [fit for fit in fits if math.isfinite(fit.pse)]
    pse = np.log10([fit.pse for fit in good]) - at * of.sigma
    sigma = np.array([fit.sigma for fit in good]) / (wide * of.sigma) - 1
    pse_bias, pse_spread = middle_and_spread(pse / jnd)
    jnd_bias, jnd_spread = middle_and_spread(sigma)
    holds = inside(good, model, at * of.sigma, wide * of.sigma)
    named = [name for fit in fits for name in fit.problems]
    return {
        "people": len(fits),
        "trials": float(np.mean([fit.trials for fit in fits])),
        "pse_bias": pse_bias,
        "pse_spread": pse_spread,
        "pse_coverage": float(np.mean(holds[0])),
        "jnd_bias": jnd_bias,
        "jnd_spread": jnd_spread,
        "jnd_coverage": float(np.mean(holds[1])),
        "people_for_10_percent": math.ceil((1.96 * jnd_spread / 0.1) ** 2),
        "no_curve": sum(name in NO_CURVE for name in named) / len(fits),
        **{n: named.count(n) / len(fits) for n in ("lapses", "guess", "overdispersed")},
    }


def of_design(people: int, of: Curve, design: str) -> list[Row]:
    """The rows of a design; lapses are fitted too, of constant stimuli, where people
    lapse.
    """
    rows = []
    tracks, number = DESIGNS[of][design](), list(DESIGNS[of]).index(design)
    for name, kind in KINDS.items():
        data = {}
        for k in range(people):
            key = [SEED, k, len(rows), number, int(of.guess is None)]
            says = person(of, kind, np.random.default_rng(key))
            data[k] = session(tracks, says, k)
        free = kind.lapse > 0 and design.startswith("constant")
        for lapse in (0.0, "free") if free else (0.0,):
            model = Model(of.link, of.guess, lapse)
            fits = psychometrics(data, log=True, interval="none", **model._asdict())
            what = {
                "task": "comparison" if of.guess is None else "detection",
                "design": design,
                "observer": name,
                "lapse": str(lapse),
            }
            rows.append(what | cell(of, kind, list(fits.values()), model))
    return rows


def unchecked() -> None:
    """Leave the arguments of trials unchecked, which takes two thirds of the time."""
    Trial.__init__ = inspect.unwrap(Trial.__init__)  # type: ignore[method-assign]


def recovery(people: int, workers: int) -> list[Row]:
    """All rows; the same with any number of processes."""
    each = [(of, design) for of, designs in DESIGNS.items() for design in designs]
    with ProcessPoolExecutor(workers, initializer=unchecked) as pool:
        jobs = [pool.submit(of_design, people, *which) for which in each]
        return [row for job in jobs for row in job.result()]


# Coverage -----------------------------------------------------------------------------
def coverage(sets: int = 2000) -> list[Row]:
    """How often 95 % intervals hold the PSE and the JND of fixed levels."""
    rows = []
    for nu in (8.0, 15.0, 50.0, math.inf):
        for levels, asked in ((5, 20), (7, 20), (9, 40)):
            for lapse in (0.0, 0.02):
                rng = np.random.default_rng([SEED, levels, int(min(nu, 999.0)), int(100 * lapse)])
                at = np.linspace(-2.125, 2.125, levels)
                p = lapse + (1 - 2 * lapse) * curve("probit").F(at)
                p = np.broadcast_to(p, (sets, levels))
                p = p if math.isinf(nu) else rng.beta(p * nu, (1 - p) * nu)
                yes = rng.binomial(asked, p).astype(float)
                given = Sets(np.broadcast_to(at, p.shape), yes, np.full(p.shape, float(asked)))
                c = np.zeros(sets)
                found = maximum(given, c)
                good = found.b > 0
                falls = {
                    "pse": maximum(given, c, a=c, start=found),
                    "jnd": maximum(given, c, b=c + 1, start=found),
                }
                fallen = {k: 2 * (found.loglik - v.loglik)[good] for k, v in falls.items()}
                may = allowed(dispersion(given, c, PROBIT, found), levels - 2)[good]
                rows.append(
                    {"nu": nu, "levels": levels, "asked": asked, "lapse": lapse, "sets": sets}
                    | {f"{k}_coverage": float(np.mean(v < may)) for k, v in fallen.items()}
                    | {
                        f"{k}_binomial": float(np.mean(v < allowed(math.nan, 0)))
                        for k, v in fallen.items()
                    }
                )
    return rows


# Short forms, for the docs ------------------------------------------------------------
def brief(rows: Sequence[Row]) -> list[list[str]]:
    """The table of recovery as it is shown."""
    return [
        [
            f"{r['task']}: {r['design']}",
            r["observer"] + (", lapses fitted" if r["lapse"] == "free" else ""),
            f"{r['pse_bias']:+.2f} ± {r['pse_spread']:.2f}",
            f"{r['pse_coverage']:.0%}",
            f"{r['jnd_bias']:+.0%} ± {r['jnd_spread']:.0%}",
            f"{r['jnd_coverage']:.0%}",
            f"{r['people_for_10_percent']:.0f}",
            ", ".join(
                f"{name} {r[key]:.0%}"
                for name, key in (
                    ("no curve", "no_curve"),
                    ("lapses", "lapses"),
                    ("guess", "guess"),
                    ("overdispersed", "overdispersed"),
                )
                if r[key] >= 0.005
            ),
        ]
        for r in rows
    ]


def brief_coverage(rows: Sequence[Row]) -> list[list[str]]:
    """The table of coverage as it is shown; in parentheses of binomial intervals."""
    return [
        [
            "none" if math.isinf(r["nu"]) else f"nu = {r['nu']:g}",
            f"{r['levels']:g} x {r['asked']:g}",
            f"{r['lapse']:.0%}",
            *(f"{r[f'{k}_coverage']:.1%} ({r[f'{k}_binomial']:.1%})" for k in ("pse", "jnd")),
        ]
        for r in rows
    ]


if __name__ == "__main__":
    parser = options(__doc__, cores=None)
    parser.add_argument("--people", type=int, default=200, help="in each cell of the table")
    parser.add_argument("--only", choices=["coverage", "recovery"], help="one of both tables")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    given = parser.parse_args()
    tables = {
        "coverage": (coverage, brief_coverage),
        "recovery": (partial(recovery, given.people, given.workers), brief),
    }
    print(machine())
    for table, (measure, short) in tables.items():
        if given.only in (None, table):
            found = measure()
            save(table, found, given.record)
            if given.record:
                with (DOCS / f"{table}.csv").open("w", newline="") as f:
                    csv.writer(f, lineterminator="\n").writerows(short(found))
