"""Piezo patches glued on a plate: a voltage is a moment along their edges."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from ..errors import Above0, BadValue, From0, public

STRONGEST = 1e-8  # m/V; ceramics have 3e-10, single crystals 2e-9
SOFTEST = 1e5  # Pa; a softer material was measured in GPa
DENSEST = 1e5  # kg/m^3, of ceramic and covers; 4800 in the patch of the thesis
VACUUM = 8.8541878128e-12  # permittivity in F/m (CODATA 2018)


class Host(Protocol):
    """Interface of a plate on which a patch is glued."""

    @property
    def thickness(self) -> float:
        """Thickness in m."""

    @property
    def E(self) -> float:
        """Young's modulus in Pa."""

    @property
    def nu(self) -> float:
        """Poisson's ratio."""

    @property
    def stiffness(self) -> float:
        """Bending stiffness in N m."""


@public
@dataclass(frozen=True)
class Patch:
    """A piezoelectric sheet between two covers, glued on a plate.

    The ceramic contracts along the plate by d31 V/thickness. Its stress acts at a
    distance from the neutral plane of plate and patch, so a voltage is a moment M per
    length along the edges of the electrode, and a mode phi gets the force M V times the
    closed integral of d(phi)/dn along them.

    Parameters
    ----------
    x, y : float
        Centre, in m from the plate's corner.
    length, width : float
        Along x and y, in m, with its covers.
    d31 : float
        Strain across the field per field, in m/V; below 0 for all common ceramics.
    thickness : float
        Of the ceramic, in m.
    side : {1, -1}
        Glued on the upper side or on the lower.
    cover : float
        Thickness in m of what lies under the ceramic, and over it.
    margin : float
        How far the electrode ends before the edge, in m.
    E, nu : float
        Young's modulus in Pa and Poisson's ratio of the ceramic.
    cover_E, cover_nu : float
        Those of the covers.
    mass : float
        In kg.
    lowest, highest : float
        Voltages that it takes.

    Raises
    ------
    BadValue
        Numbers that make no patch.

    References
    ----------
    Crawley and de Luis, AIAA Journal 25 (1987) 1373: a bonded sheet as moments along
    its edges.

    Examples
    --------
    >>> from stimlib.plate import Patch, Plate
    >>> patch = Patch.duraact(0.02, 0.04)
    >>> round(1e3 * patch.moment(Plate.paper()), 1)  # mN m/m for each volt
    13.8
    """

    x: float
    y: float
    length: Above0
    width: Above0
    d31: float
    thickness: Above0
    side: int = 1
    cover: From0 = 0.0
    margin: float = 0.0
    E: Above0 = 62e9
    nu: float = 0.34
    cover_E: Above0 = 4e9
    cover_nu: float = 0.35
    mass: From0 = 0.0
    lowest: float = -math.inf
    highest: float = math.inf

    def __post_init__(self):
        if abs(self.d31) > STRONGEST or self.thickness > min(self.length, self.width):
            raise BadValue(
                f"Patch: d31 = {self.d31:g} m/V and {self.thickness:g} m through of {self.length:g}"
                f" x {self.width:g} m make no sheet of ceramic: -180 pm/V is -180e-12, and sizes"
                " are in m"
            )
        volume = self.length * self.width * (self.thickness + 2 * self.cover)
        if (
            min(self.E, self.cover_E) < SOFTEST
            or self.cover > min(self.length, self.width)
            or self.mass > DENSEST * volume
        ):
            raise BadValue(
                f"Patch: E = {self.E:g} Pa, cover_E = {self.cover_E:g} Pa, a cover of"
                f" {self.cover:g} m and {self.mass:g} kg make no patch: 62 GPa is 62e9, 0.15 mm is"
                " 0.15e-3, and 0.5 g is 0.5e-3"
            )
        if self.side not in (1, -1):
            raise BadValue(f"Patch: side = {self.side!r}; 1 is the upper side, -1 the lower")
        if not 0 <= self.margin < min(self.length, self.width) / 2:
            raise BadValue("Patch: margin must be 0 or above, and leave an electrode")
        if not self.lowest < self.highest or not (-1 < self.nu < 0.5 and -1 < self.cover_nu < 0.5):
            raise BadValue(
                "Patch: lowest must be below highest, and Poisson's ratios between -1 and 0.5"
            )

    @classmethod
    def duraact(cls, x: float, y: float, turned: bool = False, side: int = 1) -> Patch:
        """Return the patch of the touch-screen thesis, P-876.SP1.

        It may be ``turned`` by 90 degrees. The manufacturer gives 16 x 13 x 0.5 mm
        outside and -100 .. 400 V (user manual P876T0001), d31 = -180 pm/V, a compliance
        S11 of 16.1e-12 m^2/N, which is 62 GPa, and a permittivity of 1750 eps0 of the
        soft ceramic PIC255 (PI Ceramic, "Piezo Material Data"), and layers of 0.2 to
        0.5 mm. No public source gives the rest, so it is assumed: a layer of 0.2 mm, an
        electrode 1 mm inside, covers of 4 GPa, 0.5 g, Poisson's ratios.
        """
        length, width = (13e-3, 16e-3) if turned else (16e-3, 13e-3)
        return cls(
            x,
            y,
            length,
            width,
            -180e-12,
            0.2e-3,
            side,
            cover=0.15e-3,
            margin=1e-3,
            mass=0.5e-3,
            lowest=-100.0,
            highest=400.0,
        )

    def rectangle(self, margin: float = 0.0) -> tuple[float, float, float, float]:
        """Return the edges x0, x1, y0, y1 of the patch in m."""
        dx, dy = self.length / 2 - margin, self.width / 2 - margin
        return self.x - dx, self.x + dx, self.y - dy, self.y + dy

    def capacitance(self, permittivity: float = 1750.0) -> float:
        """Return the capacitance between the electrodes, in F.

        It is that of a plate capacitor, permittivity eps0 area/thickness, of a ceramic
        that is free to deform. Glue and plate hold the ceramic, which lowers it; a
        measured capacitance is better than this one.

        Parameters
        ----------
        permittivity : float
            Of the ceramic along the field, relative to the vacuum; 1750 is the
            manufacturer's number for PIC255.
        """
        x0, x1, y0, y1 = self.rectangle(self.margin)
        return permittivity * VACUUM * (x1 - x0) * (y1 - y0) / self.thickness

    def laminate(self, plate: Host) -> tuple[float, float]:
        """Return the ceramic's distance from the neutral plane, and its stiffness.

        The distance is in m; the stiffness is what it adds to the plate's bending
        stiffness, in N m.
        """
        biaxial = self.cover_E / (1 - self.cover_nu)
        q = plate.E / (1 - plate.nu), biaxial, self.E / (1 - self.nu), biaxial
        d = plate.thickness, self.cover, self.thickness, self.cover
        z = [sum(d[:k]) + d[k] / 2 for k in range(4)]
        layers = list(zip(q, d, z, strict=True))
        neutral = sum(a * b * c for a, b, c in layers) / sum(a * b for a, b, _ in layers)
        stiff = sum(a * (b**3 / 12 + b * (c - neutral) ** 2) for a, b, c in layers)
        return z[2] - neutral, (stiff / (q[0] * d[0] ** 3 / 12) - 1) * plate.stiffness

    def moment(self, plate: Host) -> float:
        """Return the moment per length of edge and volt, in N m/(m V).

        A positive moment makes the plate's upper side concave.
        """
        # N/(m V): times thickness, and the field is V/thickness
        stress = -self.d31 * self.E / (1 - self.nu)
        return self.side * stress * self.laminate(plate)[0]
