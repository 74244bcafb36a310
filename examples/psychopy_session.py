"""An experiment of stimlib on a PsychoPy window: PsychoPy draws and takes keys, stimlib
decides, displays and keeps the answers.

    python examples/psychopy_session.py --participant P07 --sink jack
    python examples/psychopy_session.py --simulated [--plot FILE]

Only the class `Window` needs PsychoPy.  With --simulated the session runs without it,
and without a screen.
"""

import argparse
import tempfile

import numpy as np

import stimlib
from stimlib.experiments import (
    Answer,
    ConstantStimuli,
    Experiment,
    Question,
    Session,
    Simulated,
    Stimulus,
    Timing,
    Trial,
    TwoInterval,
    choice,
    columns,
    run,
    sessions,
)
from stimlib.motion import minimum_jerk

SPRING = stimlib.Scene({"force": stimlib.Param("k", 300.0, "N/m") * stimlib.Input("x", "m")})
TASK = TwoInterval("springs", "harder", Stimulus("spring", {"k": 300.0}), Stimulus("spring"), "k")

harder = Experiment(
    name="harder",
    version="1",
    scenes={"spring": SPRING},
    design=ConstantStimuli(tuple((TASK, k) for k in (240.0, 300.0, 360.0)), repeats=4),
    questions=(choice("harder", "Which one felt harder?", "first", "second"),),
    fs=1000.0,
    safety=20.0,
    bounds={"k": (100.0, 500.0)},
    # a squeeze in each interval; of a hand of yours: Live(), or Signals of the device
    motion={"x": minimum_jerk(depth=0.02, rest=0.7)},
    timing=Timing(interval=1.2, gap=0.3),
    instructions="Squeeze both springs.",
)


# [window]
class Window:
    """The front end of an experiment on a PsychoPy window; see
    `stimlib.experiments.runner.FrontEnd`.
    """

    def __init__(self):
        from psychopy import visual

        self.window = visual.Window(units="norm", color="black")

    def key(self, text: str, keys: list[str]) -> str:
        """Shows a text and waits for one of the keys; escape ends the program, and no
        answer is lost.
        """
        from psychopy import event, visual

        visual.TextStim(self.window, text).draw()
        self.window.flip()
        (pressed,) = event.waitKeys(keyList=[*keys, "escape"])[:1]
        self.window.flip()  # dark while something is felt
        if pressed == "escape":
            raise KeyboardInterrupt
        return pressed

    def tell(self, text: str) -> None:
        self.key(f"{text}\n\nspace", ["space"])

    def rest(self, seconds: float) -> None:
        from psychopy import core, visual

        visual.TextStim(self.window, f"a rest of {seconds:.0f} s").draw()
        self.window.flip()
        core.wait(seconds)

    def ready(self, text: str) -> None:
        self.key(f"{text}\n\nspace", ["space"])

    def pick(self, names: list[str]) -> str | None:
        keys = [str(n) for n in range(1, len(names) + 1)]
        told = ", ".join(f"{k}: {name}" for k, name in zip(keys, names, strict=True))
        pressed = self.key(f"{told}, space: begin", [*keys, "space"])
        return None if pressed == "space" else names[int(pressed) - 1]

    def ask(self, trial: Trial, question: Question, replays: int) -> object:
        """A choice by its key, or a rating up to 9; r has the stimuli once more, where
        that is allowed.
        """
        rated = question.kind == "rating"
        keys = [str(n) for n in range(1, question.most + 1)] if rated else list(question.keys)
        values = range(1, question.most + 1) if rated else question.choices
        told = ", ".join(f"{k}: {v}" for k, v in zip(keys, values, strict=True))
        pressed = self.key(f"{question.text}\n\n{told}", keys + ["r"] * (replays > 0))
        return dict(zip(keys, values, strict=True)).get(pressed)  # None: once more


# [end]
def felt(trial: Trial, rng: np.random.Generator) -> Answer:
    """A simulated participant, who feels 10 %."""
    k = [s.params["k"] * (1 + 0.1 * rng.normal()) for s in trial.stimuli]
    return Answer({"harder": "first" if k[0] > k[1] else "second"})


def plot(said: dict[float, list[float]], path: str) -> None:
    """How often each spring felt harder."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 4), layout="constrained")
    ax = figure.add_subplot(
        xlabel="stiffness / (N/m)", ylabel="proportion of harder", ylim=(-0.05, 1.05)
    )
    ax.plot(list(said), [np.mean(each) for each in said.values()], "o-")
    figure.savefig(path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--participant", default="P01")
    parser.add_argument("--sink", default="null")
    parser.add_argument("--data", default="data")
    parser.add_argument("--simulated", action="store_true")
    parser.add_argument("--plot", metavar="FILE")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        data = folder if given.simulated else given.data
        with Session(harder, data, given.participant) as session:
            front_end = Simulated(session, felt) if given.simulated else Window()
            run(session, front_end, "offline" if given.simulated else given.sink)
        answers = columns(sessions("harder", data))
    said = {k: [] for k in sorted(set(answers["level"]))}
    for k, more in zip(answers["level"], answers["outcome"], strict=True):
        said[k].append(more)
    for k, each in said.items():
        print(f"{k:g} N/m felt harder than 300 N/m in {sum(each):g} of {len(each)} trials")
    if given.plot:
        plot(said, given.plot)
