"""A whole displacement profile from a few points, by the known shape of the mode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..errors import BadValue, counted, public
from .model import Plate

KAPPAS = np.geomspace(2.0, 200.0, 9)
FINE = 65  # places of the table
SHIFT = 0.02  # m; how far a ruler may be laid wrong
LEAST = 1e-3  # of the middle's displacement
FAR = 0.2  # of a knot: this is another shape

Fit = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@public
def mode_fit(
    model: Plate,
    origin: float = 0.0,
    y: float | None = None,
    clamp: Literal["fit", "known"] = "fit",
) -> Fit:
    """Fit the shape of the lowest mode to measured displacements.

    It is made for ``equalize(x, measured, kind=mode_fit(plate))``.

    It fits the amplitude, the position of the middle (within 20 mm), and how far the
    clamped edges give way (kappa from 2 to 200); measurement errors count relative to
    the displacements.

    Parameters
    ----------
    model : Plate
        Its patches do not count.
    origin : float
        Where on the plate position 0 is, in m along x.
    y : float, optional
        Line of the measurement, in m; default the middle.
    clamp : {"fit", "known"}
        "known" keeps the model's clamp_stiffness: less to find, so less noise comes
        through.

    Returns
    -------
    function
        Of knots (m) and displacements, to a table of 65 places and displacements
        between the first and last knot.  It raises BadValue for too few knots, knots
        beside the plate, and for measurements that are more than 20 % off the mode, or
        whose middle is 20 mm away.

    Raises
    ------
    BadValue
        A line beside the plate; clamp neither of the two.

    Notes
    -----
    Five knots every 25 mm of a plate with kappa = 15, each 1 % off (standard
    deviation): the worst place is 95 times of 100 within 2.1 %, and 1.8 % with the
    clamp known.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.blocks import equalize
    >>> from stimlib.plate import Plate, mode_fit
    >>> plate, knots = Plate.paper(), [0.0, 0.025, 0.05, 0.075, 0.1]
    >>> measured = plate.shape(0, [0.053 + k for k in knots], plate.width / 2)
    >>> x, v = stimlib.Input("x", "m"), stimlib.Input("v", "V")
    >>> equalize(x, (knots, measured), signal=v, kind=mode_fit(plate, origin=0.053)).dim
    unit('V')
    """
    y = model.width / 2 if y is None else y
    _check_line(model, y)
    fitted = clamp == "fit" and "C" in (model.edges[0], model.edges[2])
    bare = replace(model, patches=(), terms=None)
    kinds = [bare]
    if fitted:
        soft = KAPPAS * bare.stiffness / bare.length
        kinds = [replace(bare, clamp_stiffness=float(k)) for k in soft]
    along = np.linspace(0, model.length, 121)
    rows = np.array([np.abs(m.shape(0, along, y)) for m in kinds])
    return _ModeFit(along, rows, origin, fitted)


@dataclass(frozen=True, eq=False)
class _ModeFit:
    """A fit of the shape of a mode, whose rows are those of clamps that give way."""

    along: np.ndarray  # m
    rows: np.ndarray
    origin: float
    fitted: bool  # whether the clamp is

    def shape(self, places: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the mode's shape; p[1] is log kappa where it is fitted."""
        from scipy.interpolate import CubicSpline

        row = self.rows[0]
        if self.fitted:
            row = CubicSpline(np.log(KAPPAS), self.rows)(np.log(np.exp(p[1])))
        return CubicSpline(self.along, row)(places)

    def __call__(self, knots: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the fitted table of places and displacements."""
        from scipy.optimize import least_squares

        self._check(knots, d)
        at = knots + self.origin

        def relative(p: np.ndarray) -> np.ndarray:
            s = self.shape(at - p[0], p) / d
            return s * (s.sum() / (s @ s)) - 1  # with the best amplitude

        low, high = [-SHIFT, np.log(KAPPAS[0])], [SHIFT, np.log(KAPPAS[-1])]
        n = 1 + self.fitted
        found = least_squares(
            relative,
            [0.0, np.log(15.0)][:n],
            bounds=(low[:n], high[:n]),
            x_scale=[0.01, 1.0][:n],
        )
        worst = int(np.abs(found.fun).argmax())
        if abs(found.fun[worst]) > FAR or found.active_mask[0]:
            raise BadValue(
                f"mode_fit: knot {worst}, at {knots[worst]:g}, is {100 * abs(found.fun[worst]):.0f}"
                " % off the shape of the lowest mode; measure it again, at the frequency of that"
                f" mode, give origin= within {1e3 * SHIFT:g} mm, or take another kind"
            )
        s = self.shape(at - found.x[0], found.x) / d
        places = np.linspace(knots[0], knots[-1], FINE)
        whole = self.shape(places + self.origin - found.x[0], found.x)
        return places, s.sum() / (s @ s) * whole

    def _check(self, knots: np.ndarray, d: np.ndarray) -> None:
        least = 4 if self.fitted else 3
        if knots.size < least:
            what = "amplitude, middle and clamp" if self.fitted else "amplitude, middle"
            more = ", or 3 with clamp='known'" if self.fitted else ""
            raise BadValue(
                f"mode_fit: {counted(knots.size, 'knot')} cannot tell {what} from noise; measure"
                f" at least {least} places{more}"
            )
        if not (np.isfinite(d).all() and (d > 0).all() and (np.diff(knots) > 0).all()):
            raise BadValue(
                "mode_fit: knots must rise, and displacements be numbers above 0; measure those"
                " that are not again"
            )
        first, last = knots[0] + self.origin, knots[-1] + self.origin
        if not (first >= SHIFT and last <= self.along[-1] - SHIFT):
            raise BadValue(
                f"mode_fit: knots from {first:g} to {last:g} m of a plate of {self.along[-1]:g} m;"
                f" measure at least {SHIFT:g} m from the edges, and give origin=, where on the"
                " plate position 0 is"
            )


def _check_line(model: Plate, y: float) -> None:
    """Raise BadValue for a line beside the plate, or one on which nothing moves."""
    if not 0 <= y <= model.width:
        raise BadValue(
            f"mode_fit: y = {y!r} m is outside the plate, which is {model.width:g} m wide"
        )
    here, middle = model.shape(0, model.length / 2, [y, model.width / 2])
    if abs(here) < LEAST * abs(middle):
        raise BadValue(
            f"mode_fit: at y = {y!r} m, on an edge that is held, nothing moves; measure along"
            " another line"
        )
