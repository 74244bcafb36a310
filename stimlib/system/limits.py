"""Limits on the size of files and runs: numbers that a user can raise."""

from __future__ import annotations

import dataclasses as dc
import math
import os
from numbers import Real

from ..errors import BadValue, StimlibError

VARIABLE = "STIMLIB_LIMITS"


@dc.dataclass(slots=True)
class Limits:
    """Largest sizes that are accepted; ``stimlib.limits`` is the active instance.

    A file from someone else must not fill the memory or run for hours. Anything larger
    than one of these numbers is refused, with the name of the limit. Raise it for a
    process, ``stimlib.limits.scene_blocks = 1e6``, or from outside,
    ``STIMLIB_LIMITS="scene_blocks=1e6 scene_bytes=1e9"``.

    Raises
    ------
    BadValue
        A number that is not above 0, or an unknown name.

    Examples
    --------
    >>> import stimlib
    >>> stimlib.limits.scene_blocks
    100000
    """

    scene_bytes: float = 64_000_000
    """Size of a scene file."""
    scene_blocks: float = 100_000
    """Blocks of a scene, in its file and after each `enabled` has got its own
    copies.
    """
    state_bytes: float = 4_000_000_000
    """Memory of a compiled scene: states, parameters and buffers."""
    design_work: float = 30_000_000_000
    """Operations before sample 0, of a block's design or of all that runs early: 1e9
    take about a second.
    """
    render_bytes: float = 16_000_000_000
    """Samples that `render` keeps, and those that `verify` compares."""
    recording_bytes: float = 4_000_000_000
    """Size of a recording, of what is packed in it, and of what `record_sweep` keeps in
    memory.
    """
    recording_rows: float = 50_000_000
    """Rows of a recording."""
    recording_columns: float = 1000
    """Columns of a recording, or arrays of an npz file."""
    table_knots: float = 10_000
    """Points of a measured profile, each of which costs time where a scene is built."""
    map_points: float = 1_000_000
    """Points of a map over two places."""
    sidecar_bytes: float = 256_000_000
    """Size of a sidecar, of a table in a file, and of the header of a log."""
    audio_bytes: float = 16_000_000_000
    """Size of a sound file that is read, and of its samples in memory."""
    events_bytes: float = 256_000_000
    """Size of the events of a log."""
    log_samples: float = 1_000_000_000
    """Samples of a session that are made again from its log."""
    row_seconds: float = 600
    """Time that one row of a sweep takes, with its scene and its figures."""
    row_bytes: float = 8_000_000_000
    """Memory of a process that runs rows of a sweep."""
    lost_samples: float = 30_000_000
    """Samples that a log may declare to be lost, all in all: they cost the log nothing,
    and are made again too.
    """

    def __setattr__(self, name: str, value: float) -> None:
        if name not in {f.name for f in dc.fields(self)}:
            raise BadValue(
                f"limits: there is no {name!r}; there are"
                f" {', '.join(f.name for f in dc.fields(self))}"
            )
        if isinstance(value, bool) or not isinstance(value, Real) or not value > 0:
            raise BadValue(f"limits.{name} = {value!r} must be a number above 0")
        object.__setattr__(self, name, value)

    def check(
        self, name: str, amount: float, what: str, error: type[StimlibError] = BadValue
    ) -> None:
        """Raise an error, with the remedy, if an amount is above a limit."""
        if _wrong:
            raise BadValue(_wrong[0])
        most = getattr(self, name)
        if amount > most:
            enough = f"{name}={_enough(amount)}"
            raise error(
                f"{what}: {amount:.6g} is more than limits.{name} = {most:.6g}; if that is meant,"
                f" set {VARIABLE}={enough} or stimlib.limits.{enough}"
            )


def _enough(amount: float) -> str:
    """Return a round number above an amount."""
    if not math.isfinite(amount):
        return "inf"
    unit = 10 ** max(0, math.floor(math.log10(amount)) - 1)
    return f"{(math.floor(amount / unit) + 1) * unit:.2g}"


# values of the environment that cannot be meant: an error where a limit is first needed
_wrong: list[str] = []


def _from_environment() -> Limits:
    limits = Limits()
    for word in os.environ.get(VARIABLE, "").replace(",", " ").split():
        name, _, value = word.partition("=")
        try:
            setattr(limits, name, float(value))
        except ValueError as e:
            why = (
                e
                if isinstance(e, BadValue)
                else f"{word!r} is not NAME=NUMBER, words apart and no blanks around ="
            )
            _wrong.append(f"{VARIABLE}: {why}")
    return limits


limits = _from_environment()
