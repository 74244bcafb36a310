"""The table of the shipped scenes, which the decorator ``shipped`` fills."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from importlib import import_module
from typing import Any, NamedTuple, TypeVar, cast

from ..core.parts import parts_of
from ..core.scene import Scene
from ..errors import BadValue, public

F = TypeVar("F", bound=Callable[..., Scene])
T = TypeVar("T")


class Table(MutableMapping[str, T]):
    """A table of the shipped scenes, by their names in order.

    The module of a scene is imported when its row is looked up, all when rows are
    listed.
    """

    def __init__(self) -> None:
        self._rows: dict[str, T] = {}

    def __getitem__(self, name: str) -> T:
        getattr(import_module(__package__), name, None)
        return self._rows[name]

    def __setitem__(self, name: str, row: T) -> None:
        self._rows[name] = row

    def __delitem__(self, name: str) -> None:
        del self._rows[name]

    def __iter__(self) -> Iterator[str]:
        for name in import_module(__package__).__all__:
            self.get(name)
        return iter(sorted(self._rows))

    def __len__(self) -> int:
        return sum(1 for _ in self)


# the default of every argument is the paper's, where there is one
SHIPPED: Table[Callable[..., Scene]] = Table()
ROWS: Table[shipped] = Table()


class shipped(NamedTuple):
    """The facts about a shipped scene other than its graph.

    A row decorates the function that makes the scene: it adds the function to
    ``SHIPPED`` and itself to ``ROWS``, under the function's name. The arguments are
    checked as by ``public``, and the scene keeps them for its law, which has the
    function's name.  A function that replaces an argument, such as the name of a file
    by its content, gives ``Scene`` that one as ``given``.

    Parameters
    ----------
    words : str
        The law as one formula with its source; a report prints it.  The law itself has
        the name of the scene in ``stimlib.checks.evidence.SCENES``.
    felt : str
        What a person feels, in one sentence.
    do : str, optional
        What a person does on a page to feel it, after "Press Start and".
    drive : dict of str to str
        A motion of each input, as on the command line, under which the law says
        something of every output.
    ranges : dict of str to (float, float), optional
        Ranges of inputs and parameters on a page, in their units, where unit and value
        do not suggest good ones.
    device : dict of str to dict, optional
        For outputs in a unit, such as ``"N"``, the device on which the default is felt
        as its page says: ``mass``, ``area``, ``gain`` and ``unit`` of
        ``stimlib.analysis.sensation_level``.
    full : dict of str to float, optional
        A full scale for outputs in a unit, for a first try.
    view : callable, optional
        What a page draws of the scene: ``view(arguments)`` returns its kind,
        lengths and the inputs that it needs, see ``view`` of `stimlib.live.protocol`.
        Live arguments have their present value.

    Examples
    --------
    >>> from stimlib.scenes import ROWS, SHIPPED
    >>> SHIPPED["wall"](k=500.0)
    Scene(x [m], k [N/m], b [N·s/m] -> force [N])
    >>> ROWS["wall"].drive, ROWS["wall"].ranges
    ({'x': 'sinusoid(2e-3, 5.0)'}, {'x': (-0.01, 0.01)})
    """

    words: str
    drive: Mapping[str, str]
    felt: str = ""
    do: str = ""
    ranges: Mapping[str, tuple[float, float]] = {}
    device: Mapping[str, Mapping[str, Any]] = {}
    full: Mapping[str, float] = {}
    view: Callable[[dict[str, Any]], dict[str, Any]] | None = None

    def __call__(self, make: F) -> F:
        """Add a scene's function to the table."""
        ROWS[make.__name__] = self
        SHIPPED[make.__name__] = checked = public(lawful(make))
        return checked


def lawful(make: F) -> F:
    """Let the scenes of a function keep its arguments, and its name for their law."""
    name, signature = make.__name__, inspect.signature(make)

    @functools.wraps(make)
    def made(*args: Any, **named: Any) -> Scene:
        scene = make(*args, **named)
        bound = signature.bind(*args, **named)
        bound.apply_defaults()
        replaced = scene.parts[0].given if scene.parts else {}
        scene.parts = parts_of(name, {**bound.arguments, **(replaced or {})})
        return scene

    return cast(F, made)


def above_zero(scene: str, **numbers: float) -> None:
    """Raise BadValue unless the named numbers of a scene are above 0.

    Raises
    ------
    BadValue
        One is not.

    Examples
    --------
    >>> from stimlib.scenes.shipped import above_zero
    >>> above_zero("knob", count=0)
    Traceback (most recent call last):
    stimlib.errors.BadValue: knob: count = 0 must be above 0
    """
    for name, value in numbers.items():
        if not value > 0:
            raise BadValue(f"{scene}: {name} = {value!r} must be above 0")
