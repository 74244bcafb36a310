"""Prompts: a text for the participant, and the keys that answer it.

A prompt is the same in a terminal and on a browser page.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..errors import BadValue, public
from .questions import NONE
from .texts import Texts, texts_of

if TYPE_CHECKING:
    from .questions import Question
    from .trial import Trial

REPLAY = "r"
MOST_KEYS = 9
"""Largest rating that is answered by a single key."""
MOST_BUTTONS = 11
"""Largest rating with a button for each number; the number of larger ones is typed."""


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
    kind : str
        Kind of the question, as `Question` has it; empty if it is none.
    ends : tuple of str
        What the two ends mean, of a rating or line.
    hint : str
        How a line is typed.
    apart : dict of str to str
        Keys that are no answer, such as one for a replay.
    """

    text: str
    keys: Mapping[str, str]
    line: bool = False
    words: tuple[str, ...] = ()
    kind: str = ""
    ends: tuple[str, ...] = ()
    hint: str = ""
    apart: Mapping[str, str] = dc.field(default_factory=dict)


@public
def prompted(
    question: Question,
    replays: int = 0,
    texts: Texts = texts_of(),  # noqa: B008
) -> Prompt:
    """Return the prompt for a question.

    Parameters
    ----------
    question : Question
    replays : int
        Number of replays that are still allowed.
    texts : Texts, optional
        English by default.

    Examples
    --------
    >>> from stimlib.experiments import choice, prompted, ranking
    >>> prompt = prompted(
    ...     choice("softer", "Which one was softer?", "first", "second"), replays=1
    ... )
    >>> prompt.keys, prompt.apart
    ({'1': 'first', '2': 'second'}, {'r': 'Feel it again (1 left)'})
    >>> prompted(ranking("size", "The largest first", "A", "B")).hint
    'in order: A B'
    """
    kind, most, choices = question.kind, question.most, question.choices
    keys, ends = dict(zip(question.keys, choices, strict=False)), choices[:2]
    if kind == "rating" and most <= MOST_BUTTONS:
        keys = {str(n): "" for n in range(1, most + 1)} | {"1": ends[0], str(most): ends[1]}
    elif kind in ("places", "text"):
        keys, ends = {NONE: texts("none_felt" if kind == "places" else "nothing")}, ("", "")
    line = kind != "choice" and not (kind == "rating" and most <= MOST_KEYS)
    values = {"low": ends[0], "high": ends[1], "most": most, "items": " ".join(choices)}
    hint = texts(f"how_{kind}", **values) if line and (kind != "rating" or not keys) else ""
    again = {REPLAY: texts("replay", left=replays)} if replays > 0 and REPLAY not in keys else {}
    return Prompt(question.text, keys, line, choices * (kind == "ranking"), kind, ends, hint, again)


class Keyed:
    """The part of a front end that handles keys; see `stimlib.experiments.FrontEnd`.

    Attributes
    ----------
    texts : Texts
        The texts for the participant; English by default.
    """

    texts = texts_of()

    def read(self, prompt: Prompt) -> str:
        """Return the key pressed or the text typed; "" if only Enter was pressed."""
        raise NotImplementedError

    def tell(self, text: str) -> None:
        """Show a text to the participant."""
        raise NotImplementedError

    def ready(self, text: str) -> None:
        """Wait until the participant presses any key."""
        self.read(Prompt(text, {"": self.texts("go_on")}))

    def pick(self, names: list[str]) -> str | None:
        """Return the name of a stimulus chosen by its number, or None to begin."""
        keys = {str(i): name for i, name in enumerate(names, 1)}
        prompt = Prompt(self.texts("explore"), keys, apart={"0": self.texts("begin")})
        while (key := self.read(prompt)) not in ("0", ""):
            if key in keys:
                return keys[key]
        return None

    def ask(self, trial: Trial, question: Question, replays: int) -> Any:
        """Ask a question until it is answered; return None if a replay is requested."""
        prompt = prompted(question, replays, self.texts)
        while True:
            text = self.read(prompt)
            if text == REPLAY and REPLAY in prompt.apart:
                return None
            try:
                return question.answer(text)
            except BadValue:
                lists = {"keys": ", ".join(prompt.keys), "items": " ".join(question.choices)}
                self.tell(self.texts(f"no_{question.kind}", **lists, most=question.most, none=NONE))
