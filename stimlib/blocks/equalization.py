"""Equal displacement on a plate that vibrates more in its middle than at its edges."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.graph import Block, Const, as_block
from ..core.maths import where
from ..core.pointwise import Where, clip, maximum
from ..errors import BadValue, counted, one_of, public, said_as
from ..system import safe_files
from ..system.limits import limits
from .events import in_unit_of
from .impedance import with_unit
from .movement import Over, PlaceState
from .tables import KINDS, OUTSIDE, lut


@dataclass(frozen=True, eq=False)
class Midpoint(Over):
    """The mean of this and the last sample; at the first sample, x itself."""

    x: Block
    contact: Block

    def design(self, fs):
        return (), PlaceState(0.0, 1.0)

    @staticmethod
    def step(p, s, x):
        return where(s.cold > 0.0, x, 0.5 * (s.last + x)), PlaceState(x, 0.0)


def read_profile(path: str | os.PathLike) -> tuple[list[float], list[float]]:
    """Read positions and displacements from two columns of a CSV file.

    A heading and lines that start with # are skipped.

    Raises
    ------
    BadValue
        No file that can be read, or a larger one than ``stimlib.limits`` allow; a line
        that is not two numbers; fewer than two lines of numbers.
    """
    file = os.fspath(path)
    rows: list[tuple[float, float]] = []
    with said_as(BadValue, f"equalize: cannot read {file}", UnicodeDecodeError):
        lines = safe_files.read(file, "sidecar_bytes", BadValue).decode("utf-8-sig").splitlines()
    heading = False
    for number, line in enumerate(lines, 1):
        row = line.split(",")
        if not line.strip() or row[0].lstrip().startswith("#"):
            continue
        try:
            position, displacement = (float(word.strip().strip('"')) for word in row)
        except ValueError:
            if rows or heading:
                raise BadValue(
                    f"{file}, line {number}: expected position,displacement, got {line[:80]!r}"
                ) from None
            heading = True
            continue
        rows.append((position, displacement))
        limits.check("table_knots", len(rows), f"{file}: rows")
    if len(rows) < 2:
        raise BadValue(
            f"{file}: {counted(len(rows), 'row')} of position,displacement; give at least 2"
        )
    return [r[0] for r in rows], [r[1] for r in rows]


def points(displacement) -> tuple[np.ndarray, np.ndarray]:
    """Return the knots and displacements of a profile, after checking them."""
    if isinstance(displacement, (str, os.PathLike)):
        displacement = read_profile(displacement)
    if not isinstance(displacement, (Sequence, np.ndarray)) or len(displacement) != 2:
        raise BadValue(
            "equalize: displacement must be (knots, displacement), or the path of a CSV file with"
            " these columns"
        )
    try:
        knots, d = (np.array(v, np.float64) for v in displacement)
    except (TypeError, ValueError):
        raise BadValue(
            "equalize: displacement must be two rows of numbers, (knots, displacement)"
        ) from None
    limits.check("table_knots", knots.size, "equalize: knots")
    if knots.ndim != 1 or knots.shape != d.shape or knots.size < 2:
        raise BadValue(
            f"equalize: need as many displacements as knots, at least 2; got {knots.shape} and"
            f" {d.shape}"
        )
    for name, v in (("knot", knots), ("displacement", d)):
        if not np.isfinite(v).all():
            raise BadValue(f"equalize: {name} {int(np.argmin(np.isfinite(v)))} is not finite")
    if not (np.diff(knots) > 0).all():
        raise BadValue(
            f"equalize: knots must rise; knot {int(np.argmin(np.diff(knots) > 0)) + 1} does not"
        )
    if not (d > 0).all():
        at = int(np.argmin(d > 0))
        raise BadValue(
            f"equalize: displacement {at} = {d[at]:g} must be above 0: no voltage moves a node of"
            " the mode"
        )
    return knots, d


def smallest(table, knots: np.ndarray) -> float:
    """Return the smallest value of a table between its knots.

    It is computed with the table's own step at 65 positions of each piece.
    """
    p, _ = table.design(1.0)
    places = np.concatenate(
        [np.linspace(a, b, 65) for a, b in zip(knots[:-1], knots[1:], strict=True)]
    )
    return float(min(table.step(p, (), x)[0] for x in places))


@public
def equalize(
    x: Block | float,
    displacement,
    limit: Block | float | None = None,
    headroom: str = "clip",
    *,
    signal: Block | float = 1.0,
    peak: Block | float | None = None,
    contact: Block | float = 1.0,
    kind: str | Callable | None = None,
    outside: str = "hold",
) -> Block:
    """Scale a voltage so that all positions of a plate have the same displacement.

    y = signal d_max/d(x): the measured displacements are interpolated and the result is
    inverted (interpolating the gains instead is an order of magnitude worse), in the
    middle between x[n-1] and x[n], where an area-sampled envelope lies. With five
    points of a clamped beam's mode, 1.84 times higher in the middle, the amplitude is
    constant to 0.04 % with a polynomial, 0.4 % with a cubic spline, 1.8 % with pchip,
    and 3.3 % with straight lines.

    Parameters
    ----------
    x : Block
        Position, usually in m.
    displacement : (knots, displacement) or path
        Two rows of one length, positions in the unit of x, rising, and displacement
        amplitudes at equal voltage, above 0, in any unit; or the path of a CSV file
        with these two columns, which is read now.
    limit : float or Block, optional
        Largest absolute value of the result, in the unit of ``signal``: what the
        amplifier can give.  A signal below 0 counts as 0.
    headroom : {"clip", "scale"}
        What happens where the limit is passed.  "clip": the samples beyond it are held
        there; count them in a recording, ``np.sum(np.abs(y) >= limit)``, a block cannot
        know.  "scale": the whole stimulus is reduced by min(1, limit/(peak largest
        gain)), everywhere and all the time, so that it is never passed.
    signal : float or Block
        What is equalised.  Default 1: the result is the gain.
    peak : float or Block, optional
        Largest absolute value of ``signal``, live or not; needed for "scale" unless the
        signal is a number.
    contact : Block
        Where it is not above 0, x is not looked at, and is no fault; at re-contact
        x[n-1] = x[n].
    kind : {"linear", "pchip", "cubic", "polynomial"} or callable, optional
        Interpolation; default: one polynomial for up to 6 knots, a cubic spline beyond.
        A function makes a finer table out of knots and displacements, which a cubic
        spline interpolates: ``stimlib.plate.mode_fit`` fits the shape of a plate's
        mode.
    outside : {"hold", "zero", "error"}
        Beyond the first and last knot: their gain; silence; or a fault.

    Returns
    -------
    Block
        In the unit of ``signal``.

    Raises
    ------
    BadValue
        A profile that is not finite, not rising, not above 0 at a knot or between them;
        a file that cannot be read; a limit not above 0; an unknown policy; "scale"
        without a limit or a peak.
    UnitError
        A limit or peak in another unit than the signal.

    References
    ----------
    The touch-screen thesis, section 4.2 and figure 4.2: "we increase all the
    displacements along the horizontal axis to the max value".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> from stimlib.blocks import equalize
    >>> profile = [0.0, 0.05, 0.1], [100e-6, 120e-6, 100e-6]
    >>> gain = equalize(stimlib.Input("x", "m"), profile, limit=1.1)
    >>> proc = stimlib.compile(stimlib.Scene({"gain": gain}), fs=8000)
    >>> proc.process(np.array([[0.05, 0.05, 0.0, 0.0]])).round(3)
    array([[1.   , 1.   , 1.043, 1.1  ]])
    """
    knots, d = points(displacement)
    one_of("equalize: outside", outside, OUTSIDE)
    if callable(kind):
        knots, d = points(kind(knots, d))
        kind = "cubic"
    elif kind not in (None, *KINDS):
        raise BadValue(
            f"equalize: kind = {kind!r}; choose one of {', '.join(KINDS)}, or a function, such as"
            " stimlib.plate.mode_fit(model)"
        )
    kind = kind or ("polynomial" if knots.size <= 6 else "cubic")
    x, y, contact = as_block(x), as_block(signal), as_block(contact)
    middle: Block = Midpoint(x, contact)
    low, high = (in_unit_of(x, float(v)) for v in knots[[0, -1]])
    if outside == "error":  # off contact x is not looked at, and no fault
        middle = Where(contact, middle, low)
    table = lut(middle, knots, d, kind, "error" if outside == "error" else "hold")
    lowest = smallest(table, knots)
    if not lowest > 0:
        raise BadValue(
            f"equalize: between its knots the {kind} displacement falls to {lowest:g}; measure more"
            " points"
        )
    if isinstance(y, Const) and peak is None:
        peak = Const(abs(y.value), y.unit)
    y = y * (float(d.max()) / table)
    if outside == "zero":
        y = y * (middle >= low) * (middle <= high)
    most = None if peak is None else with_unit(peak, str(y.dim)) * (float(d.max()) / lowest)
    return within(y, limit, headroom, most)


def within(y: Block, limit, headroom: str = "clip", peak=None, name: str = "limit") -> Block:
    """Return y limited to -limit .. limit, or y itself where there is no limit.

    It is clipped, or first scaled by limit/peak where the peak is larger. A live limit
    below 0 counts as 0.
    """
    one_of("headroom", headroom, ("clip", "scale"))
    if limit is None:
        if headroom != "clip":
            raise BadValue(f"headroom = {headroom!r} needs a limit")
        return y
    top = with_unit(limit, str(y.dim))
    if not getattr(top, "value", 1.0) > 0:
        raise BadValue(f"{name} = {limit!r} must be above 0")
    if not isinstance(top, Const):
        top = maximum(top, with_unit(0.0, str(y.dim)))
    if headroom == "scale":
        if peak is None:
            raise BadValue("headroom='scale' needs the largest absolute value of the signal, peak=")
        y = y * Where(as_block(peak) > top, top / peak, as_block(1.0))
    return clip(y, -top, top)
