"""A small experiment for tests: a spring, a staircase of two tracks, and an
observer.
"""

import dataclasses

import stimlib
from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    Experiment,
    Interleaved,
    Session,
    Simulated,
    Staircase,
    Stimulus,
    Timing,
    TwoInterval,
    choice,
    observed,
    run,
    stream,
)

SPRING = stimlib.Scene({"force": stimlib.Param("k", 2.0, "N/m") * stimlib.Input("x", "m")})
TASK = TwoInterval("silent", "softer", Stimulus("spring"), Stimulus("spring"), "k", asks_less=True)
QUESTION = choice("softer", "Which one was softer?", "first", "second")


def still(t):
    """A hand that holds still at 1 m."""
    return 1.0 + 0.0 * t


def experiment(**other):
    tracks = {
        "high": Staircase(TASK, (4.0, 5.0), (0.5, 8.0), reversals=8),
        "low": Staircase(TASK, (0.8, 1.0), (0.5, 8.0), reversals=8),
    }
    design = Interleaved(tracks)
    told = {
        "name": "pair",
        "version": "1",
        "scenes": {"spring": SPRING},
        "design": design if "spring" in other.get("scenes", ["spring"]) else Own(design),
        "questions": (QUESTION,),
        "fs": 1000.0,
        "safety": 10.0,
        "bounds": {"k": (0.5, 8.0)},
        "motion": {"x": still},
        "timing": Timing(interval=0.1, gap=0.05, before=0.0, ramp=0.0),
    }
    return Experiment(**(told | other))


class Own:
    """A design that does not say which levels it may reach."""

    def __init__(self, design):
        self.init, self.next, self.update = design.init, design.next, design.update
        if isinstance(design, ConstantStimuli):
            self.trials = design.trials


def observer(trial, rng):
    """Somebody who feels k with an error of 0.5."""
    felt = [s.params.get("k", 2.0) + 0.5 * rng.normal() for s in trial.stimuli]
    return Answer({"softer": "first" if felt[0] < felt[1] else "second"})


def nothing(trial, folder):
    return {"lost": 0, "clips": {"clip": {"force": 2}}}


def simulate(data, made=None, by=observer, show=nothing, code="P01", session=1, **options):
    """A whole session, of an observer or of a scripted front end."""
    resume = options.pop("resume", False)
    with Session(made or experiment(), data, code, session, resume=resume) as held:
        run(held, Simulated(held, by) if callable(by) else by, show, **options)
    return held


def trials_of(made, person, code, session=1, seed=1):
    """The trials of a session in which an observer answers; nothing is displayed."""
    design = made.designed(code, session)
    return [t for t, _ in observed(design, seed, person, stream(seed, "observer"))]


def some(data, trials, made=None, by=observer, **options):
    """A session that was left after some trials, of an observer or a person (None)."""
    with Session(made or experiment(), data, "P01", **options) as session:
        for _ in range(trials):
            answer = Simulated(session, by or observer).answer(session.due())
            answer = answer if by else dataclasses.replace(answer, simulated=False)
            session.put(answer, [nothing(None, None)])
    return session


class Scripted:
    """A front end that notes what it is asked, and answers from a list; it leaves where
    its answer is to leave.
    """

    def __init__(self, *answers, picks=()):
        self.answers, self.picks, self.noted = list(answers), list(picks), []

    def tell(self, text):
        self.noted.append(text)

    def rest(self, seconds):
        self.noted.append(("rest", round(seconds)))

    def ready(self, text):
        self.noted.append(text)

    def pick(self, names):
        return self.picks.pop(0) if self.picks else None

    def ask(self, trial, question, replays):
        self.noted.append((question.name, replays))
        if (answer := self.answers.pop(0)) == "leave":
            raise KeyboardInterrupt
        return answer
