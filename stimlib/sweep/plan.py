"""What all rows of a sweep share: scenes, motions, lengths and their order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.scene import Scene
from ..errors import BadValue
from ..motion.recorded import Recording
from ..motion.source import frames_of
from ..system.limits import limits
from .measures import Measure
from .rows import Roles, Table, name_of


@dataclass(frozen=True)
class Plan:
    """A sweep without its rows and motions, sent to every worker once."""

    make: Scene | Callable[..., Scene]
    measures: tuple[str | Measure, ...]
    units: dict[str, str]
    """Units of the figures, in order."""
    fs: float
    seconds: float | None
    roles: Roles
    versions: dict[str, str]
    key: str
    """SHA-256 of everything that the figures of all rows depend on."""
    measure_keys: list[str]
    """Key of each measure; empty if nothing is stored."""
    limits: dict[str, float]
    """Limits in force when the sweep began."""
    code_keys: dict[str, str]
    """Hashes of the code that makes scenes and motions, as a new process imports it."""

    def scene(self, row: Mapping[str, Any]) -> Scene:
        """Return the scene of a row."""
        if isinstance(self.make, Scene):
            return self.make
        made = self.make(**{name: row[name] for name in self.roles.arguments})
        if not isinstance(made, Scene):
            raise BadValue(f"{name_of(self.make)} returns {type(made).__name__}, not a Scene")
        return made


# Motions ------------------------------------------------------------------------------
def motion_of(given: Any, scene: Scene) -> dict[str, Any]:
    """Return the motion of every input of a scene.

    It is a mapping by name, as for ``render``; a single function, array or recording
    applies to all inputs.
    """
    if isinstance(given, Recording):
        return given.motion_for(scene.inputs)
    return dict(given) if isinstance(given, Mapping) else dict.fromkeys(scene.inputs, given)


def frames(motion: Mapping[str, Any], fs: float, seconds: float | None) -> int:
    """Return the number of samples of a run.

    It comes from ``seconds``, otherwise from the recording or the shortest array.
    """
    if seconds is None:
        lengths = [len(s) / fs for s in motion.values() if not callable(s)]
        lengths += [s.info["duration"] for s in motion.values() if hasattr(s, "info")]
        if not lengths:
            raise BadValue(
                "motion given as functions of time goes on for ever: say how many seconds each"
                " row has"
            )
        seconds = min(lengths)
    n = frames_of(seconds, fs)
    limits.check(
        "render_bytes", 16 * n * max(1, len(motion)), f"sweep: bytes of a row of {seconds:g} s"
    )
    return n


def in_order(table: Table, roles: Roles) -> np.ndarray:
    """Return row indices sorted by arguments, then motion, then seed.

    In this order, little is computed twice.
    """
    names = [n for n in (*roles.arguments, "motion", "seed") if n in table.column_names]
    codes = []
    for name in names:
        column = table[name].combine_chunks()
        if name != "seed":
            column = column.dictionary_encode().indices
        codes.append(column.to_numpy())
    return np.lexsort(codes[::-1]) if codes else np.arange(table.num_rows)
