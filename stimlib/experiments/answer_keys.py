"""Prompts: a text for the participant, and the keys that answer it.

A prompt is the same in a terminal and on a browser page.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..errors import BadValue, public
from .questions import NONE

if TYPE_CHECKING:
    from .questions import Question
    from .trial import Trial

REPLAY = "r"
MOST_KEYS = 9
"""Largest rating that is answered by a single key."""


@dc.dataclass(frozen=True)
class Prompt:
    """A text to show, and the keys or lines that answer it.

    Parameters
    ----------
    text : str
    keys : dict of str to str
        The meaning of each key; the key "" stands for any key.
    line : bool
        Whether a line is typed; a key is then typed as a line of its own.
    words : tuple of str
        The words that a line may consist of, if it consists of words.
    """

    text: str
    keys: Mapping[str, str]
    line: bool = False
    words: tuple[str, ...] = ()


@public
def prompted(question: Question, replays: int = 0) -> Prompt:
    """Return the prompt for a question.

    Parameters
    ----------
    question : Question
    replays : int
        Number of replays that are still allowed.

    Examples
    --------
    >>> from stimlib.experiments import choice, prompted, ranking
    >>> prompted(
    ...     choice("softer", "Which one was softer?", "first", "second"), replays=1
    ... ).keys
    {'1': 'first', '2': 'second', 'r': 'once more (1 left)'}
    >>> prompted(ranking("size", "The largest first", "A", "B")).text
    'The largest first (in order, of A B)'
    """
    keys, how, low_high = (
        dict(zip(question.keys, question.choices, strict=False)),
        "",
        question.choices,
    )
    if question.kind == "rating" and question.most <= MOST_KEYS:
        keys = {str(n): "" for n in range(1, question.most + 1)} | {
            "1": low_high[0],
            str(question.most): low_high[1],
        }
    elif question.kind == "rating":
        how = f" (1 = {low_high[0]}, {question.most} = {low_high[1]})"
    elif question.kind == "ranking":
        how = f" (in order, of {' '.join(question.choices)})"
    elif question.kind == "places":
        keys, how = {NONE: "none"}, " (x y; x y)"
    more = {REPLAY: f"once more ({replays} left)"} if replays > 0 and REPLAY not in keys else {}
    return Prompt(
        question.text + how,
        keys | more,
        bool(how),
        question.choices if question.kind == "ranking" else (),
    )


class Keyed:
    """The part of a front end that handles keys; see `stimlib.experiments.FrontEnd`."""

    def read(self, prompt: Prompt) -> str:
        """Return the key pressed or the text typed; "" if only Enter was pressed."""
        raise NotImplementedError

    def tell(self, text: str) -> None:
        """Show a text to the participant."""
        raise NotImplementedError

    def ready(self, text: str) -> None:
        """Wait until the participant presses any key."""
        self.read(Prompt(text, {"": "any key begins"}))

    def pick(self, names: list[str]) -> str | None:
        """Return the name of a stimulus chosen by its number, or None to begin."""
        keys = {str(i): name for i, name in enumerate(names, 1)}
        while (key := self.read(Prompt("Get to know the stimuli:", keys | {"0": "begin"}))) not in (
            "0",
            "",
        ):
            if key in keys:
                return keys[key]
        return None

    def ask(self, trial: Trial, question: Question, replays: int) -> Any:
        """Ask a question until it is answered; return None if a replay is requested."""
        prompt = prompted(question, replays)
        while True:
            text = self.read(prompt)
            if text == REPLAY and REPLAY in prompt.keys and REPLAY not in question.keys:
                return None
            try:
                return question.answer(text)
            except BadValue as e:
                self.tell(str(e))
