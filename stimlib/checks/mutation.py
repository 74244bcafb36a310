"""Mutation of scenes: which wrong numbers the laws of a scene detect.

Each number is changed, one at a time.
"""

from __future__ import annotations

import copy
import html
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..core.graph import registry, signals
from ..core.parts import Part
from ..core.scene import Scene
from ..core.units import pretty
from ..errors import BadValue, StimlibError, counted, shown
from ..run.rendering import Rendering, render
from ..system import safe_files
from ..system.progress import progress
from .evidence import Check, gather
from .page import document, table as table_of_rows
from .scenes import scene_law

CHANGES: dict[str, Callable[[float], float]] = {
    "1.01 times": lambda v: 1.01 * v,
    "1.25 times": lambda v: 1.25 * v,
    "other sign": lambda v: -v,
    "0": lambda v: 0.0,
    "1": lambda v: 1.0,
}
"""What is done to a number; a whole number that this leaves as it is becomes the next
one.
"""
REFUSED, EQUAL, WITHIN, NO_LAW, NOT_MADE = (
    "refused",
    "equal samples",
    "within tolerance",
    "no law",
    "cannot be made",
)


COLUMNS = "number", "value", "change", "outcome", "check"
REMEDIES = {
    EQUAL: "this motion does not use the number: try another one",
    WITHIN: "the law misses the change: a longer or faster motion may show it, or a stricter law",
    NO_LAW: "nothing says what these samples must be: give the scene a law (see Scene, law=)",
}


class Mutant(NamedTuple):
    """A scene with one changed number, and the verdict of its laws."""

    where: str  # a block with its field, a parameter, or an argument that was given
    value: str
    change: str  # a key of ``CHANGES``
    outcome: str
    """"refused"; "equal samples", so nobody could notice; "within tolerance"; "no law",
    the output that changes has none; "cannot be made", with the error that stimlib
    raises."""
    text: str = ""  # the check that refused it, or how near to its limit the nearest came


@dataclass(frozen=True, repr=False)
class Mutations:
    """All mutants of a scene; ``print`` it for a table."""

    mutants: list[Mutant]

    @property
    def passed(self) -> bool:
        """Whether every mutant that changes a sample was detected."""
        return not any(m.outcome in (WITHIN, NO_LAW) for m in self.mutants)

    def count(self) -> dict[str, int]:
        """Return how many mutants have each outcome."""
        return {
            what: sum(m.outcome == what for m in self.mutants)
            for what in (REFUSED, EQUAL, WITHIN, NO_LAW, NOT_MADE)
        }

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON data."""
        return {
            "passed": self.passed,
            "count": self.count(),
            "mutants": [m._asdict() for m in self.mutants],
        }

    def __repr__(self) -> str:
        return f"Mutations({', '.join(f'{n} {what}' for what, n in self.count().items())})"

    def to_html(self, path: str | os.PathLike[str], what: str) -> None:
        """Write a self-contained page: the verdict in words, and the table."""
        head = f"{'Passed' if self.passed else 'FAILED'}: {what}"
        body = f"<h1>{html.escape(shown(head))}</h1><p>{repr(self)[10:-1]}; missed ones first.</p>"
        rows = [dict(zip(COLUMNS, row, strict=True)) for row in self._grouped()]
        safe_files.publish(path, document(head, body + table_of_rows(rows)))

    def _grouped(self) -> Iterator[tuple[str, str, str, str, str]]:
        """Yield number, value, changes, outcome and check; what was missed is first."""
        alike: dict[tuple[str, ...], list[str]] = {}
        for m in sorted(self.mutants, key=lambda m: m.outcome not in (WITHIN, NO_LAW)):
            alike.setdefault((m.where, m.value, m.outcome, m.text), []).append(m.change)
        for (where, value, outcome, text), changes in alike.items():
            yield where, value, ", ".join(changes), outcome, text

    def __rich__(self) -> Any:
        from rich.table import Table
        from rich.text import Text

        count = self.count()
        table = Table(
            *COLUMNS,
            title=f"{len(self.mutants)} changes: {repr(self)[10:-1]}",
            title_justify="left",
            caption="\n".join(f"{n}: {text}" for n, text in REMEDIES.items() if count[n]) or None,
            caption_justify="left",
        )
        colours = {REFUSED: "green", WITHIN: "bold red", NO_LAW: "bold red"}
        for where, value, changes, what, text in self._grouped():
            outcome = Text(what, colours.get(what, ""))
            table.add_row(Text(shown(where)), value, changes, outcome, Text(shown(text)))
        return table


def mutate(
    scene: Scene,
    motion: Mapping[str, Any],
    fs: float = 8000.0,
    seconds: float = 1.0,
    params: Mapping[str, float] | None = None,
    seed: int = 0,
    bar: bool = True,
) -> Mutations:
    """Change every number of a scene in turn, and report which changes its laws detect.

    Each changed scene is rendered and the rendering verified.

    The numbers are the fields of all blocks, the values of the parameters, and the
    arguments of the scene. Each is multiplied by 1.01 and by 1.25, negated, and set to
    0 and to 1; an array is changed as a whole. The laws know the requested numbers but
    not the changed one. (The law of each block, the checks (f) of `verify`, uses the
    numbers of the block that it checks, so it cannot detect these mistakes: that is
    what the law of the scene is for.)

    Parameters
    ----------
    scene : Scene
        With a law: a shipped scene, one with ``law=``, or what they were combined into.
    motion : dict of str to callable or ndarray
        As `render` takes it. A number that this motion does not use is not tested by
        it.
    fs : float
        Hz.
    seconds : float
        Length of each rendering.
    params : dict of str to float, optional
        As of `render`.
    seed : int
    bar : bool
        Whether a progress bar is shown, where stderr is a terminal.

    Returns
    -------
    Mutations
        ``mutants``, ``passed``, ``count()``; ``print`` it for a table, what was missed
        first.

    Raises
    ------
    BadValue, UnknownName
        As of `render`; the law refuses the scene as it is, or raises.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.checks import mutate
    >>> from stimlib.motion import sinusoid
    >>> mutate(stimlib.scenes.wall(), {"x": sinusoid(2e-3, 5.0)}, seconds=0.2)
    Mutations(23 refused, 2 equal samples, 0 within tolerance, 0 no law,
    2 cannot be made)
    """
    right = render(scene, motion, fs, seconds, params, seed, on_fault="ignore")
    if right.fault is not None:
        raise BadValue(
            f"the scene has a fault in this motion, {right.fault}; choose another motion"
        )
    if bad := [c for c in _held(scene, motion, right) if not c.passed]:
        raise BadValue(
            f"the law refuses the scene as it is: ({bad[0].group}) {bad[0].name}; correct the law"
            " or the scene first"
        )
    changed = list(_changed(scene))
    found = []
    with progress("changing numbers", len(changed), bar) as advance:
        for where, value, change, make in changed:
            found.append(Mutant(where, value, change, *_outcome(make, motion, right, params, seed)))
            advance(1)
    return Mutations(found)


def _changed(scene: Scene) -> Iterator[tuple[str, str, str, Callable[[], Scene]]]:
    """Yield the name, value and change of each number, with a function for the scene.

    The function makes the scene with the changed number.
    """
    from ..scenes import SHIPPED

    if (
        len(scene.parts) == 1
        and (make := SHIPPED.get(scene.parts[0].law))
        and not scene.parts[0].inputs
    ):
        given = dict(scene.parts[0].given or {})
        for name, v in given.items():
            for change, new in _changes(v) if not isinstance(v, list) else ():
                more = {n: g for n, g in given.items() if not isinstance(g, (dict, list))} | {
                    name: new
                }
                yield (
                    f"argument {name}",
                    _short(v),
                    change,
                    partial(_asked, make, more, scene.parts),
                )
    data = scene.to_dict()
    for i, block in enumerate(data["blocks"]):
        for field, v in block["fields"].items():
            if field in signals(registry[block["class"]]):
                continue
            name = block["fields"].get("name")
            where = (
                f"parameter {name}"
                if block["class"] == "Param"
                else f"{block['class']} {i}: {field}"
            )
            for change, new in _changes(v):
                other = copy.deepcopy(data)
                other["blocks"][i]["fields"][field] = new
                unit = scene.params[name].unit if block["class"] == "Param" else ""
                value = f"{_short(v)} {pretty(unit)}".removesuffix(" 1").strip()
                yield where, value, change, partial(Scene.from_dict, other)


def _asked(make: Any, words: dict[str, Any], parts: Sequence[Part]) -> Scene:
    """Return a shipped scene with other arguments, under the law of the given ones."""
    return Scene(make(**words).outputs, parts)


def _numbers(v: Any) -> bool:
    if isinstance(v, list):
        return bool(v) and all(map(_numbers, v))
    return isinstance(v, (int, float)) and not isinstance(v, bool)


def _changes(v: Any) -> Iterator[tuple[str, Any]]:
    """Yield the changes of a number or a list, each value once.

    There are none for anything else.
    """
    done = [v]
    for change, f in CHANGES.items() if _numbers(v) else ():
        if (new := _applied(v, f)) not in done:
            done.append(new)
            yield change, new


def _applied(v: Any, f: Callable[[float], float]) -> Any:
    """Apply a change to a number, or to all numbers of a list."""
    if isinstance(v, list):
        return [_applied(part, f) for part in v]
    if isinstance(v, int):
        return int(f(v)) if int(f(v)) != v else v + 1
    return f(v)


def _short(v: Any) -> str:
    return f"{v:.6g}" if not isinstance(v, list) else counted(np.size(v), "number")


def _held(scene: Scene, motion: Mapping[str, Any], made: Rendering) -> list[Check]:
    """Return the checks of a scene's laws for a rendering."""
    return [c for c in scene_law(gather(scene, motion, made)) if c.group in "cde"]


def _outcome(
    make: Callable[[], Scene], motion: Mapping[str, Any], right: Rendering, params: Any, seed: int
) -> tuple[str, str]:
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            wrong = make()
            if not wrong.inputs.keys() <= motion.keys():
                return REFUSED, "its inputs are others"
            its = {n: motion[n] for n in wrong.inputs}
            made = render(wrong, its, right.fs, right.y.shape[1] / right.fs, params, seed)
        except StimlibError as e:
            return NOT_MADE, str(e)
        if made.outputs != right.outputs:
            return REFUSED, "its outputs are others"
        if np.array_equal(made.y, right.y, equal_nan=True) and made.fault is None:
            return EQUAL, ""
        if made.fault is not None:
            return REFUSED, "(e) no fault"
        try:
            checks = _held(wrong, its, made)
        except BadValue as e:  # of the unchanged scene it raises none
            return REFUSED, str(e)
    for c in checks:
        if not c.passed:
            return REFUSED, f"({c.group}) {c.name}"
    rows = zip(right.outputs, made.y, right.y, strict=True)
    return _missed(checks, [n for n, a, b in rows if not np.array_equal(a, b)])


def _missed(checks: list[Check], moved: list[str]) -> tuple[str, str]:
    """Return why checks that passed have missed a change of some outputs."""
    if not checks:
        return NO_LAW, ""
    held = {word.strip(",") for c in checks for word in c.name.split(":")[0].split()}
    if held.isdisjoint(moved):
        return NO_LAW, f"of {', '.join(moved)}"
    near = max((c for c in checks if c.limit), key=lambda c: c.measured / c.limit, default=None)
    if near is None:
        return WITHIN, ""
    share = near.measured / near.limit
    return WITHIN, f"({near.group}) {near.name}: {share:.2g} of its limit"
