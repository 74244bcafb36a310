"""Calibration of a motor whose force depends on its position, with a load cell.

F = n B Gamma(x) I: the force per current over the position, as `motor_current` takes
it, from a table of currents, positions and forces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..core.units import ONE, Unit, in_base_units, pretty, unit as unit_of
from ..errors import BadValue, UnitError, counted, public
from ..motion.cells import columns_of
from ..motion.reports import column_of
from ..motion.table import read_table

Array = NDArray[np.float64]
CONFIDENCE = 0.95
FINE = 8  # rows of the table between two knots
FAR = 1.0  # m, which no such motor travels
SI = {"current": "A", "position": "m", "force": "N"}


@public
@dataclass(frozen=True, eq=False)
class MotorCalibration:
    """The force per current of a motor over its position, as measured.

    Attributes
    ----------
    position : ndarray, shape (m,)
        In m, rising over the measured range.
    table : ndarray, shape (m,)
        n B Gamma at these positions, in ``unit``.
    error : ndarray, shape (m,)
        Standard errors of the table, in ``unit``.
    low, high : ndarray, shape (m,)
        Ends of the 95 % confidence interval of each value, in ``unit``.
    zero, zero_error : float
        Force in N that the load cell showed without current, and its standard error.
    residual : float
        Standard deviation in N of what the fit leaves.
    pattern : float
        Correlation of residuals that are neighbours in position, in standard deviations
        of what noise alone would make of it.  Above 4, the fit leaves more than noise
        (few knots, friction, a force that is not proportional), and the intervals are
        too narrow.
    unit : str
        N per unit of the current or command, such as ``"N/A"``.
    """

    position: Array
    table: Array
    error: Array
    low: Array
    high: Array
    zero: float
    zero_error: float
    residual: float
    pattern: float
    unit: str

    @property
    def motor_constant(self) -> float:
        """The largest n B Gamma, which is called n B, in ``unit``."""
        return float(self.table.max())

    @property
    def geometry(self) -> tuple[Array, Array]:
        """Gamma over positions, at most 1, for ``motor_current`` and ``squeeze``."""
        return self.position, self.table / self.table.max()

    def __repr__(self):
        low, high = self.position[[0, -1]]
        wide = 100 * np.max((self.high - self.low) / 2 / self.table)
        return (
            f"MotorCalibration({self.motor_constant:.4g} {pretty(self.unit)} +-{wide:.1g} % from"
            f" {low:.3g} to {high:.3g} m, residual {self.residual:.2g} N)"
        )


@public
def calibrate_motor(
    source: Any,
    current: str = "current",
    position: str = "position",
    force: str = "force",
    *,
    units: Mapping[str, str] = SI,
    knots: int = 6,
) -> MotorCalibration:
    """Estimate the force per current of a motor over its position.

    n B Gamma(x) is a cubic spline through ``knots`` positions, and the zero of the load
    cell a constant; both are fitted to F = n B Gamma(x) I + zero by least squares.

    Parameters
    ----------
    source : path or table
        CSV or npz file, DataFrame or dict, with a row for each reading: in any order,
        of at least 5 readings for each knot.
    current, position, force : str
        Its columns; each may be scaled, ``"(x_raw - 1472)*2e-5"``.
    units : dict of str to str
        Unit of each, with prefixes: ``{"current": "mA", "position": "mm", "force":
        "N"}``.  By default A, m and N.  A current may also be a command, in V or
        without unit.
    knots : int
        Of the spline, 4 or more; more follow a more curved Gamma.

    Returns
    -------
    MotorCalibration

    Raises
    ------
    RecordingError
        A file that cannot be read, a column that is not there, a cell that is no finite
        number; too few readings, positions that leave a gap or span more than 1 m, one
        current alone; a force against the current.
    UnitError
        A unit that is unknown or is of another quantity.
    BadValue
        Fewer than 4 knots; units of other things.

    Notes
    -----
    The intervals take the errors of the readings as independent, of one size, and in
    the force alone.  What is certain about the load cell itself is to be added.

    References
    ----------
    The UGrip paper, section 2.1: F(x) = n B I Gamma(x), with load cells at the end
    effectors.

    Examples
    --------
    A motor of 10 N/A, in readings with 20 mN of noise:

    >>> import numpy as np
    >>> from stimlib.devices import calibrate_motor
    >>> rng = np.random.default_rng(1)
    >>> x, i = np.linspace(0, 40, 400), rng.uniform(-3, 3, 400)
    >>> f = 10 * (1 - 4e-4 * (x - 20) ** 2) * i + rng.normal(size=400) * 0.02
    >>> calibrate_motor(
    ...     {"current": 1000 * i, "position": x, "force": f},
    ...     units={"current": "mA", "position": "mm", "force": "N"},
    ... )
    MotorCalibration(10 N/A +-0.08 % from 0 to 0.04 m, residual 0.021 N)
    """
    if knots < 4 or set(units) != set(SI):
        raise BadValue(
            f"calibrate_motor: knots = {knots} and units of {', '.join(units)}; give 4 knots or"
            f" more, and units of {', '.join(SI)}"
        )
    table = read_table(source)
    named = dict(zip(SI, (current, position, force), strict=True))
    linear = [column_of(table, f"calibrate_motor: {what}", text) for what, text in named.items()]
    names = [str(c.column) for c in linear]
    rows, dims = columns_of(table, names), []
    for k, (what, c) in enumerate(zip(SI, linear, strict=True)):
        factor, powers = in_base_units(units[what] or "1")
        dims.append(Unit(powers))
        if what != "current" and dims[k] != unit_of(SI[what]):
            raise UnitError(
                f"calibrate_motor: {what} in {units[what]!r}; give a unit of {SI[what]}"
            )
        rows[k] = (rows[k] * c.scale + c.offset) * factor
    return _fitted(table, rows, knots, "N" if dims[0] == ONE else f"N/{dims[0]!s}")


def _fitted(table: Any, rows: Array, knots: int, unit: str) -> MotorCalibration:
    """Return the fit of a spline to currents, positions and forces."""
    i, x, f = rows[:, np.argsort(rows[1], kind="stable")]
    free = x.size - knots - 1
    if x.size < 5 * knots:
        raise table.error(
            f"{counted(x.size, 'reading')} for {counted(knots, 'knot')}: too few",
            "take 5 or more for each knot",
        )
    if x[-1] - x[0] > FAR:
        raise table.error(
            f"the positions span {x[-1] - x[0]:g} m",
            'give their unit, such as units={"current": "mA", "position": "mm", "force": "N"}',
        )
    at = np.linspace(x[0], x[-1], knots)
    gap = int(np.diff(x).argmax())
    if not x[-1] > x[0] or x[gap + 1] - x[gap] > at[1] - at[0]:
        raise table.error(
            f"no reading lies between {x[gap]:g} and {x[gap + 1]:g} m",
            "take some at positions in between, or give fewer knots",
        )
    spline = scipy.interpolate.CubicSpline(at, np.eye(knots))
    design = np.column_stack([spline(x) * i[:, None], np.ones(x.size)])
    scale = np.linalg.norm(design, axis=0)
    if not scale.min() > 0 or np.linalg.cond(design / scale) > 1e8:
        raise table.error(
            "the currents do not tell the force per current from the zero of the load cell",
            "take readings at several currents, also of the other sign, at each position",
        )
    inverse = np.linalg.pinv(design / scale) / scale[:, None]
    found = inverse @ f
    left = f - design @ found
    residual = float(np.sqrt(left @ left / free))
    fine = np.linspace(x[0], x[-1], FINE * (knots - 1) + 1)
    weights = np.column_stack([spline(fine), np.zeros(fine.size)]) @ inverse
    values, error = weights @ f, residual * np.linalg.norm(weights, axis=1)
    if not values.min() > 0:
        raise table.error(
            f"the force per current at {fine[values.argmin()]:g} m is {values.min():.4g}"
            f" {pretty(unit)}",
            "count the force in the direction in which a current above 0 acts",
        )
    wide = error * scipy.stats.t.ppf((1 + CONFIDENCE) / 2, free)
    signs = (left, left * np.sign(i))  # an error of the zero, and one of n B Gamma
    pattern = max(float(r[1:] @ r[:-1]) for r in signs) * x.size**0.5 / max(left @ left, 1e-300)
    zero_error = residual * float(np.linalg.norm(inverse[-1]))
    low, high, zero = values - wide, values + wide, float(found[-1])
    return MotorCalibration(
        fine, values, error, low, high, zero, zero_error, residual, pattern, unit
    )
