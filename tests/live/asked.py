"""A session whose answers come from a page: in a thread, behind a server."""

import threading
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

from experiments.some import SPRING, experiment, still

from stimlib.errors import StimlibError
from stimlib.experiments import (
    ConstantStimuli,
    Cursor,
    OneInterval,
    Rate,
    Sequential,
    Session,
    Stimulus,
    analogue,
    choice,
    places,
    ranking,
    rating,
    run,
)
from stimlib.live.experiment import ExperimentPage
from stimlib.live.server import Server

FOLDER = "pair/P01-s1"  # of the session
QUESTIONS = (
    choice("softer", "Which one was that?", "red", "green"),
    rating("rough", "How rough?", "smooth", "coarse"),
    rating("fine", "How fine?", "coarse", "fine", 11),
    rating("much", "How much?", "none", "most", 100),
    analogue("nice", "How nice?", "not at all", "very"),
    ranking("order", "The largest first", "A", "B"),
    places("where", "Where?", 2),
)
WHICH = OneInterval(
    "secret",
    "softer",
    {"red": Stimulus("spring", {"k": 4.321}), "green": Stimulus("spring", {"k": 2.345})},
)
RATED = Rate(
    "hidden", tuple(q.name for q in QUESTIONS[1:]), Stimulus("spring", {"k": 1.987}), {"rough": 6}
)


@contextmanager
def silent(running):
    """Let a server say nothing until the block ends, however long that takes."""
    over = threading.Event()
    running.asking._loop.call_soon_threadsafe(over.wait)
    try:
        yield
    finally:
        over.set()


def every(**other):
    """Training, a rest, feedback, a replay, familiarisation, a reference, and every
    kind of question: four trials.
    """
    learn = ConstantStimuli(((WHICH, "red"),), training=True)
    design = Sequential(
        {
            "learnt": learn,
            "rated": ConstantStimuli(((RATED, None),)),
            "main": ConstantStimuli(((WHICH, "green"), (WHICH, "red"))),
        }
    )
    told = {
        "design": design,
        "scenes": {"spring": SPRING},
        "questions": QUESTIONS,
        "replays": 1,
        "feedback": True,
        "cursor": Cursor("x", 0.777, 7.0),
        "familiarisation": {"soft": Stimulus("spring", {"k": 3.456})},
        "instructions": "Squeeze.",
        "motion": {"x": still},
    }
    return experiment(**(told | other))


# the answers to all of it: one to get familiar, a replay, one that is none and given
# again (the page has no such key). A place with many digits: an answer may be longer
# than a message of a live page
TYPED = [
    "1",
    "0",
    "",
    "r",
    "1",
    "",
    "9",
    "6",
    "11",
    " 55 ",
    "62",
    "B A",
    f"1.{'0' * 1500} 2; 0.5 3",
    "",
    "2",
    "",
    "1",
]


# what they come to, trial by trial
ANSWERS = [
    {"softer": "red"},
    {
        "rough": 6,
        "fine": 11,
        "much": 55,
        "nice": 62.0,
        "order": ["B", "A"],
        "where": [[1.0, 2.0], [0.5, 3.0]],
    },
    {"softer": "green"},
    {"softer": "red"},
]


@contextmanager
def asked(data, made, sink="offline", resume=False, **server):
    """It ends with the session, or ends it."""
    running = SimpleNamespace(notes=[], errors=[], layouts=Path(data) / "layouts.jsonl")
    running.asking = ExperimentPage(running.notes.append, made.texts, running.layouts)
    running.server = Server(running.asking, **({"token": "T"} | server))

    def play():
        try:
            with Session(made, data, "P01", resume=resume) as running.session, running.asking:
                run(running.session, running.asking, running.asking.display(made, sink))
        except StimlibError as e:
            running.errors.append(e)

    running.thread = threading.Thread(target=play)
    with running.server:
        running.thread.start()
        yield running
    running.thread.join(10)
    assert not running.thread.is_alive()
