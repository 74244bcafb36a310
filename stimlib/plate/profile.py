"""A whole displacement profile from a few points, by the known shape of the mode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..errors import BadValue, public
from .model import Plate, check_plate

KAPPAS = np.geomspace(2.0, 200.0, 9)
FINE = 65  # places of the table
SHIFT = 0.02  # m; how far a ruler may be laid wrong
LEAST = 1e-3  # of the middle's displacement
FAR = 0.2  # of a knot: this is another shape

Fit = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@public
def mode_fit(model: Plate, origin: float = 0.0, y: float | None = None, clamp: str = "fit") -> Fit:
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
        beside the plate, and for measurements that are more than 20 % off the mode.

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
    check_plate("mode_fit, to be called as in kind=mode_fit(model)", model)
    y = model.width / 2 if y is None else y
    _check_line(model, y, clamp)
    fitted = clamp == "fit" and "C" in (model.edges[0], model.edges[2])
    along = np.linspace(0, model.length, 121)
    bare = replace(model, patches=(), terms=None)
    kinds = (
        [replace(bare, clamp_stiffness=float(k) * bare.stiffness / bare.length) for k in KAPPAS]
        if fitted
        else [bare]
    )
    rows = np.array([np.abs(m.shape(0, along, y)) for m in kinds])

    def shape(places: np.ndarray, kappa: float) -> np.ndarray:
        from scipy.interpolate import CubicSpline

        row = CubicSpline(np.log(KAPPAS), rows)(np.log(kappa)) if fitted else rows[0]
        return CubicSpline(along, row)(places)

    def fit(knots: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        from scipy.optimize import least_squares

        least = 4 if fitted else 3
        if knots.size < least:
            raise BadValue(
                f"mode_fit: {knots.size} knots cannot tell amplitude,"
                f" middle{' and clamp' if fitted else ''} from noise; measure at least {least}"
                " places" + (", or 3 with clamp='known'" if fitted else "")
            )
        if not (np.isfinite(d).all() and (d > 0).all() and (np.diff(knots) > 0).all()):
            raise BadValue(
                "mode_fit: knots must rise, and displacements be numbers above 0; measure those"
                " that are not again"
            )
        at = knots + origin
        if not (at[0] >= SHIFT and at[-1] <= model.length - SHIFT):
            raise BadValue(
                f"mode_fit: knots from {at[0]:g} to {at[-1]:g} m of a plate of {model.length:g} m;"
                f" measure at least {SHIFT:g} m from the edges, and give origin=, where on the"
                " plate position 0 is"
            )

        def relative(p: np.ndarray) -> np.ndarray:
            s = shape(at - p[0], np.exp(p[1]) if fitted else 1.0) / d
            return s * (s.sum() / (s @ s)) - 1  # with the best amplitude

        start, low, high = (
            [0.0, np.log(15.0)],
            [-SHIFT, np.log(KAPPAS[0])],
            [SHIFT, np.log(KAPPAS[-1])],
        )
        count = 2 if fitted else 1
        found = least_squares(
            relative, start[:count], bounds=(low[:count], high[:count]), x_scale=[0.01, 1.0][:count]
        )
        worst = int(np.abs(found.fun).argmax())
        if abs(found.fun[worst]) > FAR:
            raise BadValue(
                f"mode_fit: knot {worst}, at {knots[worst]:g}, is {100 * abs(found.fun[worst]):.0f}"
                " % off the shape of the lowest mode; measure it again, at the frequency of that"
                " mode, or take another kind"
            )
        kappa = float(np.exp(found.x[1])) if fitted else 1.0
        s = shape(at - found.x[0], kappa) / d
        places = np.linspace(knots[0], knots[-1], FINE)
        return places, s.sum() / (s @ s) * shape(places + origin - found.x[0], kappa)

    return fit


def _check_line(model: Plate, y: float, clamp: str) -> None:
    """Raise BadValue for a line beside the plate, or one on which nothing moves."""
    if clamp not in ("fit", "known"):
        raise BadValue(f"mode_fit: clamp = {clamp!r}; choose fit or known")
    if not 0 <= y <= model.width:
        raise BadValue(
            f"mode_fit: y = {y!r} m is outside the plate, which is {model.width:g} m wide"
        )
    if abs(model.shape(0, model.length / 2, y)) < LEAST * abs(
        model.shape(0, model.length / 2, model.width / 2)
    ):
        raise BadValue(
            f"mode_fit: at y = {y!r} m, on an edge that is held, nothing moves; measure along"
            " another line"
        )
