"""The questions that follow a trial, and their possible answers."""

from __future__ import annotations

import dataclasses as dc
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from ..errors import BadValue, Count, Several, counted, public
from ..system.fields import number

if TYPE_CHECKING:
    import numpy as np

KINDS = ("choice", "rating", "analogue", "ranking", "places", "text")
# characters in an answer, such as a ranking of many words; ask.html has the same limit
LONGEST = 4000
NONE = "n"
"""Answer for "no places" or "no remark", because Enter alone may be a slip."""


def typed(text: str) -> float:
    """Return a typed number; ValueError for Python's own way to group digits."""
    if "_" in text:
        raise ValueError(text)
    return float(text) + 0.0  # -0 is 0


@public
@dc.dataclass(frozen=True)
class Question:
    """A question; made by `choice`, `rating`, `ranking` and so on.

    Attributes
    ----------
    name : str
    text : str
        As the participant reads it.
    kind : str
        One of choice, rating, analogue, ranking, places, text.
    choices : tuple of str
        The choices, the two ends of a rating or line, or the names to put in order;
        empty for places and texts.
    keys : tuple of str
        A key for each choice.
    most : int
        The largest rating, which begins at 1; the end of a line, which begins at 0; the
        largest number of places, or of characters.
    """

    name: str
    text: str
    kind: str
    choices: tuple[str, ...] = ()
    keys: tuple[str, ...] = ()
    most: int = 0

    def check(self, value: Any) -> None:
        """Raise BadValue, with the possible answers, unless a value is one of them."""
        if self.kind == "choice":
            good, wanted = value in self.choices, f"one of {', '.join(self.choices)}"
        elif self.kind == "rating":
            good = (
                isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= self.most
            )
            wanted = f"a whole number from 1 ({self.choices[0]}) to {self.most} ({self.choices[1]})"
        elif self.kind == "analogue":
            good = number(value) and 0 <= value <= self.most
            wanted = f"a number from 0 ({self.choices[0]}) to {self.most} ({self.choices[1]})"
        elif self.kind == "ranking":
            good = isinstance(value, (list, tuple)) and sorted(map(str, value)) == sorted(
                self.choices
            )
            wanted = f"all of {', '.join(self.choices)}, each once, in order"
        elif self.kind == "text":
            good, wanted = (
                isinstance(value, str) and len(value) <= self.most,
                f"at most {counted(self.most, 'character')}, or {NONE} for nothing",
            )
        else:
            good = (
                isinstance(value, (list, tuple))
                and len(value) <= self.most
                and all(map(_place, value))
            )
            wanted = (
                f"at most {counted(self.most, 'place')} [x, y], typed as x y; x y, or {NONE} for"
                " none"
            )
        if not good:
            raise BadValue(f"{self.name}: {value!r:.80} is no answer; answer {wanted}")

    def answer(self, text: str) -> Any:
        """Return the answer that a key or a typed text stands for.

        The text is the key of a choice, a number, words in order, or places as ``x y; x
        y``, with ``n`` for none; a free text may be anything else.

        Raises
        ------
        BadValue
            The text is not an answer; the message lists valid ones.

        Examples
        --------
        >>> from stimlib.experiments import choice, places
        >>> choice("softer", "Which one was softer?", "first", "second").answer("2")
        'second'
        >>> places("nodules", "Where are they?", most=3).answer("0.01 0.02; 0.03 0")
        [[0.01, 0.02], [0.03, 0.0]]
        """
        value: Any = text
        if self.kind == "choice":
            value = dict(zip(self.keys, self.choices, strict=True)).get(text, text)
        elif self.kind == "rating" and text.isdecimal() and len(text) < 9:
            value = int(text)
        elif self.kind == "ranking":
            value = text.split()
        elif self.kind == "analogue":
            with suppress(ValueError):
                value = typed(text)
        elif self.kind == "places":
            with suppress(ValueError):
                value = [
                    [typed(v) for v in place.split()] for place in text.split(";") if place.strip()
                ] or text
            value = [] if text == NONE else value
        elif self.kind == "text":
            value = "" if text == NONE else text or None
        self.check(value)
        return value

    def guess(self, rng: np.random.Generator) -> Any:
        """Return a random answer that ignores the stimulus.

        Examples
        --------
        >>> import numpy as np
        >>> from stimlib.experiments import rating
        >>> 1 <= rating("roughness", "How rough?", "smooth", "rough").guess(
        ...     np.random.default_rng(1)
        ... ) <= 7
        True
        """
        if self.kind == "choice":
            return str(rng.choice(self.choices))
        if self.kind in ("rating", "analogue"):
            return int(rng.integers(1, self.most + 1))
        # no places at all
        return "" if self.kind == "text" else rng.permutation(self.choices).tolist()


def _place(v: Any) -> bool:
    return isinstance(v, (list, tuple)) and len(v) == 2 and all(map(number, v))


@public
def choice(name: str, text: str, *choices: str, keys: str = "") -> Question:
    """Make a question with several answers to choose from.

    Parameters
    ----------
    name, text : str
    *choices : str
        At least two.
    keys : str
        A letter or digit for each choice; by default 1, 2, ..

    Raises
    ------
    BadValue
        Fewer than two choices, a repeated choice, or keys that do not match the choices
        one to one; a blank cannot be a key.

    Examples
    --------
    >>> from stimlib.experiments import choice
    >>> choice("softer", "Which one was softer?", "first", "second").keys
    ('1', '2')
    """
    keys = keys or "123456789"[: len(choices)]
    good = all(k.isprintable() and not k.isspace() for k in keys) and len(keys) == len(choices)
    if (
        not good
        or len(choices) < 2
        or len(set(choices)) != len(choices)
        or len(set(keys)) != len(keys)
    ):
        raise BadValue(
            f"choice {name!r}: give at least two choices, each once, and one key for each, no"
            f" blank; got {choices}, {keys!r}"
        )
    return Question(name, text, "choice", choices, tuple(keys))


@public
def rating(name: str, text: str, low: str, high: str, most: Several = 7) -> Question:
    """Make a question that asks for a number from 1 (low) to ``most`` (high).

    An example is an adjective pair of the touch-screen thesis, section 4.3.

    Parameters
    ----------
    name, text : str
        Its name in the answers, and what is asked.
    low, high : str
        What the ends of the scale are called.
    most : int
        The largest number.

    Raises
    ------
    BadValue
        ``most`` outside 2 to 1000.

    Examples
    --------
    >>> from stimlib.experiments import rating
    >>> rating("roughness", "How rough?", "smooth", "rough").check(8)
    Traceback (most recent call last):
    stimlib.errors.BadValue: roughness: 8 is no answer; answer a whole number from 1 ...
    """
    return Question(name, text, "rating", (low, high), (), most)


@public
def analogue(name: str, text: str, low: str, high: str) -> Question:
    """Make a visual analogue scale, a line between two ends.

    The answer is a number from 0 (low) to 100 (high). On a page the participant marks a
    place on a line, which has no mark before; in a terminal the number is typed.

    Examples
    --------
    >>> from stimlib.experiments import analogue
    >>> analogue("rough", "How rough was it?", "smooth", "rough").answer("62.5")
    62.5
    """
    return Question(name, text, "analogue", (low, high), (), 100)


@public
def ranking(name: str, text: str, *items: str) -> Question:
    """Make a question that asks to put names in order, beginning with the most.

    Examples
    --------
    >>> from stimlib.experiments import ranking
    >>> ranking("size", "The largest first", "A", "B", "C").check(["B", "A", "C"])
    """
    if len(items) < 2 or len(set(items)) != len(items) or any(i.split() != [i] for i in items):
        raise BadValue(
            f"ranking {name!r}: give at least two names of one word, each once; got {items}"
        )
    return Question(name, text, "ranking", items)


@public
def places(name: str, text: str, most: Count) -> Question:
    """Make a question that asks for the positions where something was felt.

    At most ``most`` positions are allowed, in the units of the scene's inputs.

    Examples
    --------
    >>> from stimlib.experiments import places
    >>> places("nodules", "Where are they?", most=3).check([[0.01, 0.02]])
    """
    return Question(name, text, "places", (), (), most)


@public
def free_text(name: str, text: str) -> Question:
    """Make a question that is answered in the participant's own words, on one line.

    At most 4000 characters; ``n`` alone stands for an empty text. It suits
    ``Experiment.after``.

    Examples
    --------
    >>> from stimlib.experiments import free_text
    >>> remarks = free_text("remarks", "Is there anything else you noticed?")
    >>> remarks.answer("the second was sticky"), remarks.answer("n")
    ('the second was sticky', '')
    """
    return Question(name, text, "text", (), (), LONGEST)
