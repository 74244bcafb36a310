"""Simulated observers, to test a design before participants come.

An observer is called with a trial and a random generator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ..core.scene import Scene
from ..errors import BadValue, Count, UnknownName, need, public
from ..motion.source import frames_of, positions, sources_of
from ..run.processor import Processor
from ..run.rendering import Rendering
from ..sweep import measured
from ..system.packages import package
from ..system.pool import spread
from ..system.progress import progress as bar
from .experiment import Experiment
from .likelihood import probability
from .random_streams import stream
from .trial import Answer, Observer, Stimulus, Trial, correct, observed, outcome

By = float | Mapping[str, float]
"""A number, or one for each condition."""


@public
@dataclass(frozen=True)
class PsychometricObserver:
    """An observer with a psychometric function, which uses only a trial's level.

    It answers "more" with the probability g + (1 - g - l) F((level - PSE)/sigma), where
    l is the lapse rate and g is the trial's chance level; for a comparison, g = l.

    Parameters
    ----------
    pse, sigma : float or dict of str to float
        In the unit of the level (with ``log``, sigma is in units of log10), or one
        value for each condition.
    lapse : float
        Half the proportion of trials answered by a coin toss; for a detection, the rate
        of misses.
    log : bool
        Use log10 of the level.
    link : {"probit", "logit", "gumbel", "weibull"}
        As of `stimlib.experiments.fits.psychometric`; "weibull" uses log10 also without
        ``log``.  A Weibull curve with the scale alpha (63 %) and the exponent beta has
        ``pse=alpha * log(2) ** (1 / beta)`` and ``sigma=1 / (beta * log(10))``, with
        natural logarithms.

    Raises
    ------
    BadValue
        When called: a trial without a level or scores; sigma not above 0; lapse not
        from 0 to 0.5; with ``log``, a level that is not above 0.
    UnknownName
        When called: no number for the trial's condition.

    Examples
    --------
    >>> from stimlib.experiments import (
    ...     PsychometricObserver,
    ...     Stimulus,
    ...     TwoInterval,
    ...     stream,
    ... )
    >>> task = TwoInterval(
    ...     "noise",
    ...     "softer",
    ...     Stimulus("squeeze", {"k": 2000.0}),
    ...     Stimulus("squeeze"),
    ...     "k",
    ...     asks_less=True,
    ... )
    >>> trial = task.trial(9000.0, seed=1, n=0)
    >>> answer = PsychometricObserver(2340.0, 300.0)(trial, stream(1, "observer"))
    >>> trial.scores[
    ...     answer.values["softer"]
    ... ]  # the comparison, of 9 N/mm, feels stiffer
    1.0
    """

    pse: By
    sigma: By
    lapse: float = 0.0
    log: bool = False
    link: str = "probit"

    def chance(self, trial: Trial) -> float:
        """Return the probability of the answer "more"."""
        if trial.level is None:
            raise BadValue(
                f"condition {trial.condition!r}: the trial has no level, so an observer of"
                " parameters has no answer"
            )
        pse, sigma = (
            _of(v, trial.condition, name) for v, name in ((self.pse, "pse"), (self.sigma, "sigma"))
        )
        if not (sigma > 0 and 0 <= self.lapse <= 0.5):
            raise BadValue(
                f"PsychometricObserver: sigma = {sigma:g} must be above 0, and lapse ="
                f" {self.lapse:g} from 0 to 0.5"
            )
        logs = self.log or self.link == "weibull"
        if logs and not trial.level / pse > 0:
            raise BadValue(
                f"PsychometricObserver: condition {trial.condition!r} has the level"
                f" {trial.level:g}, and pse = {pse:g}: log10 needs both above 0; give log=False"
            )
        away = math.log10(trial.level / pse) if logs else trial.level - pse
        guess = self.lapse if trial.chance is None else trial.chance
        return float(probability(away / sigma, self.link, guess, self.lapse)[0])

    def __call__(self, trial: Trial, rng: np.random.Generator) -> Answer:
        """Answer the first question of a trial, with one random draw."""
        chance = self.chance(trial)
        return _answer(trial, bool(rng.random() < chance))


@public
@dataclass(frozen=True)
class Listener:
    """An observer that perceives one figure of the rendered signal, with noise.

    With two intervals, it answers "more" if the comparison's figure is larger.  With
    one interval, it answers "more" if the figure is above the criterion.  A rating is
    the whole number nearest to offset + gain times the figure, from 1 to ``most``.

    Parameters
    ----------
    scenes : dict of str to Scene
    motion : dict
        As for ``render``; each scene uses the motion of its own inputs.
    fs, seconds : float
        Hz; length of an interval.
    measure : str or Measure
        As for a sweep: ``"rms(force1)"``, ``"band(20, 1000, force1)"``, ``"cues(x1,
        force1)"``.
    sigma : float
        Standard deviation of the error of each interval, in the figure's unit (of log10
        of it with ``log``).
    figure : str, optional
        Which of the measure's figures to use, such as ``"W_force1"`` (work) or
        ``"k_fit_force1"`` (stiffness by regression); required if the measure has
        several.
    log : bool
        Perceive log10 of the figure.
    criterion : float, optional
        For one interval; on the axis of the errors.
    offset, gain, most
        For ratings; on the axis of the errors.
    lapse : float
        Half the proportion of trials answered by a coin toss.

    Raises
    ------
    BadValue, UnknownName
        When called: something that the trial needs is missing, or ``render`` or the
        measure raises it.

    Notes
    -----
    The observer perceives the rendering of the scene, without the limits of a sink.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.experiments import Listener, Stimulus, TwoInterval, stream
    >>> from stimlib.motion import sinusoid
    >>> spring = stimlib.Scene(
    ...     {"force": stimlib.Param("k", 100.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> hears = Listener(
    ...     {"spring": spring},
    ...     {"x": sinusoid(0.01, 5.0)},
    ...     1000,
    ...     1.0,
    ...     "rms",
    ...     sigma=0.02,
    ...     log=True,
    ... )
    >>> round(hears.figure_of(Stimulus("spring", {"k": 200.0})), 6)
    1.414214
    >>> trial = TwoInterval(
    ...     "k", "stiffer", Stimulus("spring"), Stimulus("spring"), "k"
    ... ).trial(200.0, seed=1, n=0)
    >>> trial.scores[hears(trial, stream(1, "observer")).values["stiffer"]]
    1.0
    """

    scenes: Mapping[str, Scene]
    motion: Any
    fs: float
    seconds: float
    measure: Any
    sigma: float
    figure: str = ""
    log: bool = False
    criterion: float | None = None
    offset: float = 0.0
    gain: float = 1.0
    most: int = 7
    lapse: float = 0.0

    def figure_of(self, stimulus: Stimulus) -> float:
        """Return the perceived figure of a stimulus, from its rendering."""
        need("Listener", [stimulus.scene], self.scenes, "scene")
        scene = self.scenes[stimulus.scene]
        motion = {name: self.motion[name] for name in scene.inputs if name in self.motion}
        figures = measured(_again(scene, motion, self.fs, self.seconds, stimulus), self.measure)
        if not self.figure and len(figures) > 1:
            raise BadValue(
                f"Listener: the measure has several figures, {', '.join(figures)}: name one as"
                " figure"
            )
        need("Listener", [self.figure] * bool(self.figure), figures, "figure")
        name = self.figure or next(iter(figures))
        if not math.isfinite(figures[name]):
            raise BadValue(
                f"Listener: {name} of {stimulus.scene!r} is {figures[name]}, which nobody can"
                " compare or rate; give another figure or motion"
            )
        return figures[name]

    def __call__(self, trial: Trial, rng: np.random.Generator) -> Answer:
        """Answer the first question of a trial.

        It draws one normal random number for each interval and two numbers for lapses.
        """
        felt = {}
        for s in trial.stimuli:
            value = self.figure_of(s)
            if self.log and not value > 0:
                raise BadValue(
                    f"Listener: the figure is {value:g}, which has no logarithm: give log=False"
                )
            felt[s.name] = (math.log10(value) if self.log else value) + self.sigma * rng.normal()
        lapsed, coin = rng.random(2)
        attends = lapsed >= 2 * self.lapse
        if trial.scores:
            return _answer(trial, self._more(trial, felt) if attends else bool(coin < 0.5))
        rating = (
            self.offset + self.gain * next(iter(felt.values()))
            if attends
            else 0.5 + coin * self.most
        )
        return Answer(
            {trial.questions[0]: int(min(max(round(rating), 1), self.most))}, simulated=True
        )

    def _more(self, trial: Trial, felt: Mapping[str, float]) -> bool:
        if len(felt) == 1:
            if self.criterion is None:
                raise BadValue(
                    f"condition {trial.condition!r} has one interval: give the criterion above"
                    " which it is the signal"
                )
            return next(iter(felt.values())) > self.criterion
        if set(felt) != {"standard", "comparison"}:
            raise BadValue(
                f"condition {trial.condition!r}: the stimuli must be named standard and comparison,"
                f" not {list(felt)}"
            )
        return felt["comparison"] > felt["standard"]


@lru_cache(maxsize=64)
def _compiled(scene: Scene, fs: float) -> Processor:
    return Processor(scene, fs)


def _again(scene: Scene, motion: Any, fs: float, seconds: float, stimulus: Stimulus) -> Rendering:
    """Render a stimulus; its scene is compiled only the first time."""
    proc = _compiled(scene, fs)
    proc.reset(stimulus.seed)
    for name, value in stimulus.params.items():
        proc.set(name, value, ramp=0.0)
    frames = frames_of(seconds, fs)
    x = positions(sources_of(motion, proc.inputs, frames), 0, frames, fs)
    y = proc.process(x)
    return Rendering(
        scene,
        fs,
        stimulus.seed,
        dict(proc.params),
        y,
        proc.outputs,
        proc.fault,
        dict(zip(proc.inputs, x, strict=True)),
    )


def _answer(trial: Trial, more: bool) -> Answer:
    """Return the answer whose choice scores as "more", or as "less"."""
    for choice, score in trial.scores.items():
        if (score > 0.5) == more:
            return Answer({trial.questions[0]: choice}, simulated=True)
    raise BadValue(
        f"condition {trial.condition!r}: the trial has no scores that say which choice counts for"
        " more, and for less"
    )


def _of(v: By, condition: str, name: str) -> float:
    if not isinstance(v, Mapping):
        return v
    need("observer", [condition], v, f"{name} of condition")
    return v[condition]


# Many of them -------------------------------------------------------------------------
COLUMNS = (
    *("participant", "session", "number", "condition", "track", "level", "chance"),
    *("outcome", "correct", "seconds", "simulated"),
)


@public
def simulate(
    experiment: Experiment,
    observer: Observer | Mapping[str, Observer],
    participants: int | Sequence[str],
    *,
    session: int | None = None,
    seed: int = 0,
    workers: int | None = 1,
    progress: bool = True,
) -> dict[str, list[Any]]:
    """Simulate a whole experiment, and return all answers as columns.

    Parameters
    ----------
    experiment : Experiment
    observer : callable or dict of str to callable
        ``observer(trial, rng) -> Answer``: one for all participants, or one for each.
    participants : int or sequence of str
        How many (P01, P02, ..), or their codes.
    session : int, optional
        A single session to simulate; by default all ``experiment.sessions``.
    seed : int
        Seed of the observers; each participant has a random stream.
    workers : int or None
        Number of processes; None is one per core, which is worthwhile if stimuli are
        rendered.
    progress : bool
        A progress bar on stderr, if that is a terminal.

    Returns
    -------
    dict of str to list
        Columns ``participant``, ``session``, ``number`` (of the trial, from 1),
        ``condition``, ``track``, ``level``, ``chance`` (of the task), ``outcome``,
        ``correct``, ``seconds`` (of the observer's answer), ``simulated`` (True), and
        each question by its name; training is left out.  The same on every run and with
        any number of workers.

    Raises
    ------
    BadValue, UnknownName
        A trial or an observer raises it; a participant has no observer; a design has no
        trial; or ``participants`` is a single text.
    MissingPackage
        Several workers and no cloudpickle: ``pip install 'stimlib[sweep]'``.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.experiments import Experiment, Staircase, psychometric
    >>> from stimlib.experiments import (
    ...     PsychometricObserver,
    ...     TwoInterval,
    ...     choice,
    ...     simulate,
    ... )
    >>> from stimlib.experiments import Stimulus
    >>> spring = stimlib.Scene(
    ...     {"force": stimlib.Param("k", 100.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> task = TwoInterval(
    ...     "silent", "stiffer", Stimulus("spring"), Stimulus("spring"), "k"
    ... )
    >>> stairs = Staircase(task, start=(200.0, 250.0), bounds=(10.0, 1000.0))
    >>> ask = choice("stiffer", "Which was stiffer?", "first", "second")
    >>> springs = Experiment(
    ...     "springs", "1", {"spring": spring}, stairs, (ask,), fs=1000.0, safety=10.0
    ... )
    >>> found = simulate(springs, PsychometricObserver(117.0, 15.0), participants=4)
    >>> fit = psychometric(found)
    >>> fit.problems, 105 < fit.pse < 130
    ((), True)
    """
    codes = (
        [f"P{k + 1:02d}" for k in range(participants)]
        if isinstance(participants, int)
        else list(participants)
    )
    if not codes:
        raise BadValue("simulate: there must be at least one participant")
    if isinstance(observer, Mapping) and (alone := [c for c in codes if c not in observer]):
        raise UnknownName(f"simulate: no observer for {alone[0]}; there are {', '.join(observer)}")
    mine = [observer[c] if isinstance(observer, Mapping) else observer for c in codes]
    numbers = range(1, experiment.sessions + 1) if session is None else [session]
    each = [
        (experiment, who, c, number, seed)
        for c, who in zip(codes, mine, strict=True)
        for number in numbers
    ]
    if workers == 1:
        jobs: list[tuple] = each
        run: Callable[..., list[tuple]] = _participant
    else:
        dumps = package("cloudpickle", "simulate in several processes").dumps
        jobs, run = [(dumps(job),) for job in each], _unpacked
    rows = []
    with bar("simulating", len(each), progress) as advance, spread(run, jobs, workers) as results:
        for found in results:
            rows += found
            advance(1)
    names = *COLUMNS, *(q.name for q in experiment.questions)
    return {name: [row[k] for row in rows] for k, name in enumerate(names)}


def _unpacked(data: bytes) -> list[tuple]:
    import pickle

    return _participant(*pickle.loads(data))


def _participant(
    experiment: Experiment, observer: Observer, code: str, session: int, seed: int
) -> list[tuple]:
    """Return the simulated trials of one session of a participant."""
    design, rng = experiment.designed(code, session), stream(seed, "observer", code, session)
    rows, number = [], 0
    for number, (trial, answer) in enumerate(
        observed(design, experiment.seeded(code, session), observer, rng), 1
    ):
        experiment.check(trial)
        if not trial.training:
            asked = (answer.values.get(q.name) for q in experiment.questions)
            rows.append(
                (
                    code,
                    session,
                    number,
                    trial.condition,
                    trial.track,
                    trial.level,
                    trial.chance,
                    outcome(trial, answer),
                    correct(trial, answer),
                    answer.seconds,
                    answer.simulated,
                    *asked,
                )
            )
    if not number:
        raise BadValue(f"the design of {code}, session {session}, has no trial")
    return rows


@dataclass(frozen=True)
class Power:
    """The power of an experiment with a given number of participants.

    Attributes
    ----------
    found : float
        Proportion of experiments with p below alpha: the power or, without a true
        difference, the rate of false positives.
    interval : (float, float)
        Wilson's 95 % interval of ``found``, from the number of simulated experiments.
    estimate, bias, spread : float
        Mean of the estimates, its difference from the truth, and the standard deviation
        of the estimates, over experiments with an estimate.
    failed : int
        Experiments without an estimate.
    trials : (float, int)
        Trials per participant: mean and maximum.
    """

    found: float
    interval: tuple[float, float]
    estimate: float
    bias: float
    spread: float
    failed: int
    trials: tuple[float, int]


@public
def power(
    experiment: Experiment,
    observer: Callable[[np.random.Generator], Observer],
    analyse: Callable[[dict[str, list[Any]]], tuple[float, float]],
    participants: int,
    *,
    truth: float = math.nan,
    experiments: Count = 100,
    alpha: float = 0.05,
    seed: int = 0,
    workers: int | None = 1,
    progress: bool = True,
) -> Power:
    """Simulate an experiment many times, and return its statistical power.

    The result contains the rate of detection, the error of the estimates, and the
    length of the experiment.

    Parameters
    ----------
    experiment : Experiment
    observer : callable
        ``observer(rng) -> Observer``: draws a participant from the population.
    analyse : callable
        ``analyse(columns) -> (estimate, p)``, called with the result of `simulate`; an
        estimate that is nan counts as a failure.
    participants : int
        Number of participants in one experiment.
    truth : float
        The true value of the estimate.
    experiments : int
        Number of simulated experiments.
    alpha : float
    seed, workers, progress
        As `simulate`.

    Returns
    -------
    Power

    Raises
    ------
    BadValue
        No experiments; and as `simulate`.

    Examples
    --------
    See :doc:`/reference/experiments_analysis`.
    """
    from .signal_detection import wilson

    codes = [f"E{e}-P{p + 1:02d}" for e in range(experiments) for p in range(participants)]
    people = {code: observer(stream(seed, "person", code)) for code in codes}
    columns = simulate(experiment, people, codes, seed=seed, workers=workers, progress=progress)
    whose = np.array([code.partition("-")[0] for code in columns["participant"]])
    found = []
    for e in range(experiments):
        at = np.flatnonzero(whose == f"E{e}")
        result = analyse({name: [column[k] for k in at] for name, column in columns.items()})
        if np.shape(result) != (2,):
            raise BadValue(f"power: analyse gives {result!r:.80} where it must give (estimate, p)")
        found.append(result)
    estimates, p = np.array(found, float).T
    good = np.isfinite(estimates)
    share = wilson(int(np.sum(p[good] < alpha)), experiments)
    lengths = np.unique(columns["participant"], return_counts=True)[1]
    mean = float(np.mean(estimates[good])) if good.any() else math.nan
    spread_ = float(np.std(estimates[good], ddof=1)) if good.sum() > 1 else math.nan
    return Power(
        share.value,
        (share.low, share.high),
        mean,
        mean - truth,
        spread_,
        int(np.sum(~good)),
        (float(lengths.mean()), int(lengths.max())),
    )
