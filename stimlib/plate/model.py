"""A plate under a finger: its modes, and how far a voltage or a force moves it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import SimpleNamespace
from typing import Annotated, Any

import numpy as np

from ..errors import Above0, BadValue, From0, Range, one_of, public
from ..system.linear_algebra import one_thread
from ..system.packages import package
from .patch import SOFTEST, Host, Patch
from .ritz import HELD, Axis, bending

TERMS = 12  # functions of each axis
AT_ONCE = 16  # modes that are found together
TERMS_PATCHED = 22  # the steps of stiffness at patches want more
LONGEST = 10.0  # m; a larger plate was measured in mm
LIGHTEST = 10.0  # kg/m^3; a lighter one was weighed in g/cm^3
Loss = Annotated[float, Range("1/Q of a resonance, above 0 and below 2", lambda v: 0 < v < 2)]
PAPER_EDGES = {"all": "CCCC", "long": "FCFC", "short": "CFCF"}
CONFIGURATIONS = {
    "C1": (0.071, 0.0095, False),  # near the free edges
    "C2": (0.071, 0.011, True),
    "C3": (0.011, 0.042, False),  # near the clamped edges
    "C4": (0.0095, 0.042, True),
    "C5": (0.011, 0.020, False),
    "C6": (0.0515, 0.03675, False),  # at a quarter of both lengths
    "C7": (0.090, 0.030, False),  # near the line through the centre
    "C8": (0.0515, 0.0095, False),
}
"""The eight configurations of four patches, by their names in the touch-screen thesis.

Each is the centre of the patch next to the corner, in m, and whether it is turned by 90
degrees; the others mirror it about both centre lines.  The thesis shows them in figure
2.2 alone, which our copy lacks.  Its text says that C3, C4 and C5 move the plate most,
and that patches belong near the clamped edges: the places are assumed so that this
holds.
"""


@public
@dataclass(frozen=True)
class Plate:
    """A thin rectangular plate (Kirchhoff).

    Its modes are found by the Rayleigh-Ritz method with Jacobi polynomials.

    D (w_xxxx + 2 w_xxyy + w_yyyy) - N w_xx + rho h w_tt = pressure, with
    D = E h^3/(12 (1 - nu^2)).

    Results are kept, so asking again costs nothing; several threads may use one plate
    at once.

    Parameters
    ----------
    length, width, thickness : float
        Along x, along y and through, in m.
    E, nu, rho : float
        Young's modulus in Pa, Poisson's ratio, density in kg/m^3.
    edges : str
        How the edges x = 0, y = 0, x = length, y = width are held: C clamped, S simply
        supported, F free.
    clamp_stiffness : float, optional
        Of the clamped edges against turning, in N m/rad for each m.  None: they cannot
        turn.  kappa = clamp_stiffness length/D says whether that is much.
    in_plane_load : float
        Tension along x in N/m; a frame that presses is below 0.
    damping : float
        Loss factor 1/Q of all modes, below 2.
    patches : sequence of Patch
        Glued on; they add stiffness and mass, and are driven by one voltage.
    terms : int, optional
        Functions of each axis; default 12, and 22 with patches.

    Raises
    ------
    BadValue
        Numbers that make no plate; patches that overlap or hang over; edges that let it
        move as a whole; a load that buckles it.

    References
    ----------
    Leissa, "The free vibration of rectangular plates", Journal of Sound and Vibration
    31 (1973) 257.  The touch-screen thesis, section 2.1.

    Examples
    --------
    >>> from stimlib.plate import Plate
    >>> glass = Plate(0.206, 0.147, 1.4e-3, E=70e9, nu=0.24, rho=2500.0, edges="CCCC")
    >>> glass.modes(3).round(1)
    array([ 453. ,  733.6, 1085.3])
    """

    length: Above0
    width: Above0
    thickness: Above0
    E: Above0
    nu: float
    rho: Above0
    edges: str = "CFCF"
    clamp_stiffness: From0 | None = None
    in_plane_load: float = 0.0
    damping: Loss = 0.01
    patches: tuple[Patch, ...] = ()
    terms: int | None = None

    def __post_init__(self):
        object.__setattr__(self, "patches", tuple(self.patches))
        if not -1 < self.nu < 0.5:
            raise BadValue(f"Plate: nu = {self.nu!r} must be between -1 and 0.5")
        if max(self.length, self.width) > LONGEST or self.E < SOFTEST or self.rho < LIGHTEST:
            raise BadValue(
                f"Plate: {self.length:g} x {self.width:g} m of E = {self.E:g} Pa and rho ="
                f" {self.rho:g} kg/m^3 is not a plate for a finger: sizes are in m, 0.15 for 150"
                " mm; E is in Pa, 70e9 for glass, and rho in kg/m^3, 2500"
            )
        if self.thickness > 0.1 * min(self.length, self.width):
            raise BadValue(
                f"Plate: {self.thickness:g} m is not a thin plate of {self.length:g} x"
                f" {self.width:g}"
                " m: Kirchhoff's theory holds up to a tenth of its sides; give sizes in m"
            )
        if self.terms is not None and not 4 <= self.terms <= 40:
            raise BadValue(f"Plate: terms = {self.terms!r} must be from 4 to 40")
        if len(self.edges) != 4 or set(self.edges) - set(HELD):
            raise BadValue(
                f"Plate: edges = {self.edges!r} must be four letters, for x = 0, y = 0, x = length,"
                " y = width: C clamped, S simply supported, F free"
            )
        weak = self.edges.replace("C", "S") if self.clamp_stiffness == 0 else self.edges
        if "C" not in weak and weak.count("S") < 2:
            raise BadValue(
                f"Plate: edges = {self.edges!r} let it move as a whole; clamp one edge, or"
                " support two"
            )
        check_places(self)

    @staticmethod
    def paper(edges: str = "short", measured: bool = False, patches: bool | str = False) -> Plate:
        """Return the glass plate of the touch-screen thesis.

        Parameters
        ----------
        edges : {"short", "long", "all"}
            Which are clamped: cases c, b and a of table 2.2.  The experiment clamps the
            short ones.
        measured : bool
            With patches, 9.3 % more stiffness, and a frame that presses with 6 kN/m:
            what ``fit_frame`` finds for the measured 158, 246 and 548 Hz, which it
            meets within 2.2 %.  Both are assumed.
        patches : bool or {"C1", .., "C8"}
            With four patches in one of the configurations of figure 2.2; True is C3,
            near the clamped edges.  The thesis shows their places as a picture only:
            ``CONFIGURATIONS`` are assumed.

        References
        ----------
        The touch-screen thesis, tables 2.1 and 2.2.  Its structural damping of 0.01 %
        contradicts its 15 um at 25 V by a factor of 1000; 0.1 fits these, and is taken.

        Examples
        --------
        >>> from stimlib.plate import Plate
        >>> Plate.paper("short").modes(2).round(1)  # printed: 158 and 244 Hz
        array([183.5, 251.3])
        """
        one_of("Plate.paper: edges", edges, tuple(PAPER_EDGES))
        if isinstance(patches, str):
            one_of("Plate.paper: patches", patches, CONFIGURATIONS)
        elif patches or measured:
            patches = "C3"
        return _paper(PAPER_EDGES[edges], bool(measured), patches or "")

    # Matrices -------------------------------------------------------------------------
    @property
    def stiffness(self) -> float:
        """Bending stiffness D = E h^3/(12 (1 - nu^2)) in N m."""
        return self.E * self.thickness**3 / 12 / (1 - self.nu**2)

    @cached_property
    def axes(self) -> tuple[Axis, Axis]:
        """The mode-shape functions along x and y.

        A clamp that gives way is modelled as a simple support with a spring.
        """
        held = self.edges if self.clamp_stiffness is None else self.edges.replace("C", "S")
        n = self.terms or (TERMS_PATCHED if self.patches else TERMS)
        return Axis(self.length, n, held[0], held[2]), Axis(self.width, n, held[1], held[3])

    @cached_property
    def matrices(self) -> dict[str, np.ndarray]:
        """The integrals that make up the stiffness and mass matrices.

        They are those for D = 1, for a load of 1, for springs of 1 on the clamped
        edges, for D = 1 of each patch, and for the patches' mass.
        """
        X, Y = self.axes
        px, py, one = X.products(), Y.products(), np.eye(X.terms)
        springs = np.zeros((X.terms**2,) * 2)
        turning = (
            lambda: np.kron(X.turning(0), one),
            lambda: np.kron(one, Y.turning(0)),
            lambda: np.kron(X.turning(self.length), one),
            lambda: np.kron(one, Y.turning(self.width)),
        )
        for edge, spring in zip(self.edges, turning, strict=True):
            if edge == "C" and self.clamp_stiffness is not None:
                springs += spring()
        stiff, mass = np.zeros((len(self.patches), *springs.shape)), np.zeros_like(springs)
        for k, p in enumerate(self.patches):
            x0, x1, y0, y1 = p.rectangle()
            mx, my = X.products(x0, x1), Y.products(y0, y1)
            stiff[k] = bending(mx, my, self.nu)
            mass += p.mass / (p.length * p.width) * np.kron(mx[0], my[0])
        found = {
            "bending": bending(px, py, self.nu),
            "load": np.kron(px[1], py[0]),
            "springs": springs,
            "patches": stiff,
            "mass": mass,
        }
        for m in found.values():
            m.flags.writeable = False  # all who ask share them
        return found

    def _system(self, v: Mapping[str, Any], host: Host) -> tuple[Any, Any]:
        """Return stiffness and mass with the numbers v, patches glued onto a host."""
        m = self.matrices
        K = host.stiffness * m["bending"] + v["in_plane_load"] * m["load"]
        for p, one in zip(self.patches, m["patches"], strict=True):
            K = K + p.laminate(host)[1] * one
        K = K + (0.0 if v["clamp_stiffness"] is None else v["clamp_stiffness"]) * m["springs"]
        return K, v["rho"] * self.thickness * np.eye(len(K)) + m["mass"]

    @cached_property
    def _solved(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        return {}

    def solved(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Return squared angular frequencies and coefficients of the lowest modes.

        The shapes are (n,) and (n, terms of x, terms of y); the modal mass is 1.
        """
        from scipy.linalg import eigh

        most = self.axes[0].terms ** 2 // 4
        if not isinstance(n, (int, np.integer)) or not 0 < n <= most:
            raise BadValue(
                f"Plate: {n!r} modes of {self.axes[0].terms} terms; ask for 1 to {most}, the lowest"
                " is number 0, or raise terms"
            )
        size = max(n, min(AT_ONCE, most))
        found = self._solved.get(size)
        if found is None:
            with one_thread():
                K, M = self._system(vars(self), self)
                half = 1 / math.sqrt(M[0, 0])  # a bare plate's M is this number, twice, times 1
                if self.patches:
                    w2, v = eigh(K, M, subset_by_index=[0, size - 1])
                else:
                    w2, v = eigh(K * half**2, subset_by_index=[0, size - 1])
                    v *= half
            if w2[0] < 1e-9 * self.stiffness / (self.rho * self.thickness * self.length**4):
                raise BadValue(
                    f"Plate: it buckles under in_plane_load = {self.in_plane_load:g} N/m; use a"
                    " smaller pressure, or stiffer edges"
                )
            v *= np.sign(v[np.abs(v).argmax(axis=0), np.arange(size)])
            v.flags.writeable = w2.flags.writeable = False  # all who ask later share them
            shapes = v.T.reshape(size, self.axes[0].terms, self.axes[1].terms)
            found = self._solved[size] = w2, shapes
        return found[0][:n], found[1][:n]

    @property
    def voltages(self) -> tuple[float, float]:
        """The lowest and the highest voltage that all patches accept."""
        lowest = max((p.lowest for p in self.patches), default=-math.inf)
        return lowest, min((p.highest for p in self.patches), default=math.inf)

    # What it does ---------------------------------------------------------------------
    def modes(self, n: int = 6) -> np.ndarray:
        """Return the natural frequencies of the lowest modes in Hz, ascending.

        The shape is (n,).

        Raises
        ------
        BadValue
            More modes than the terms carry; a plate that buckles.
        """
        return np.sqrt(self.solved(n)[0]) / (2 * math.pi)

    def shape(self, mode: int, x, y) -> np.ndarray:
        """Return the shape of a mode at positions in m, in 1/sqrt(kg).

        The integral of rho h phi^2 is 1.

        Parameters
        ----------
        mode : int
            0 is the lowest.
        x, y : array_like
            Broadcast against each other.

        Raises
        ------
        BadValue
            A place beside the plate.

        Examples
        --------
        >>> from stimlib.plate import Plate
        >>> plate = Plate.paper()
        >>> middle = plate.shape(0, 0.103, 0.0735)
        >>> (plate.shape(0, [0.0, 0.053, 0.103], 0.0735) / middle).round(3)
        array([0.   , 0.565, 1.   ])
        """
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        if x.size and not (
            x.min() >= 0 and x.max() <= self.length and y.min() >= 0 and y.max() <= self.width
        ):
            raise BadValue(
                f"Plate: a place outside the plate; x is 0 .. {self.length:g} m, y is 0 .."
                f" {self.width:g} m"
            )
        X, Y = self.axes
        c = self.solved(mode + 1)[1][mode]
        return np.einsum("pi,ij,pj->p", X.at(x.ravel()), c, Y.at(y.ravel())).reshape(x.shape)

    def forces(self, n: int, weights: Sequence[float] | None = None) -> np.ndarray:
        """Return the modal forces of 1 V on all patches, in N/(V sqrt(kg)).

        The shape is (n,). ``weights`` give each patch a factor of its own.
        """
        if not self.patches:
            raise BadValue(
                "Plate: no patches to drive; give patches=[Patch(..)], or to frf a point,"
                " drive=(x, y)"
            )
        w = np.ones(len(self.patches)) if weights is None else np.asarray(weights, float)
        if w.shape != (len(self.patches),):
            raise BadValue(
                f"Plate: weights of shape {w.shape}; give {len(self.patches)}, one for each patch"
            )
        X, Y = self.axes
        total = np.zeros((X.terms, Y.terms))
        for factor, p in zip(w, self.patches, strict=True):
            x0, x1, y0, y1 = p.rectangle(p.margin)
            along = np.outer(X.integral(x0, x1, 2), Y.integral(y0, y1)) + np.outer(
                X.integral(x0, x1), Y.integral(y0, y1, 2)
            )
            total += factor * p.moment(self) * along
        return np.einsum("kij,ij->k", self.solved(n)[1], total)

    def frf(
        self, drive, at, f, modes: int = 12, weights: Sequence[float] | None = None
    ) -> np.ndarray:
        """Return the frequency response function: displacement for a drive.

        It is the sum of phi(at) F/(w_k^2 - w^2 + i w w_k damping).

        Parameters
        ----------
        drive : (x, y), or "patches"
            A point that a force of 1 N pushes at, or 1 V on the patches.
        at : (x, y)
            Where it is measured, in m.
        f : array_like
            Frequencies in Hz.
        modes : int
            How many are summed.
        weights : sequence of float, optional
            A factor of the voltage for each patch.

        Returns
        -------
        ndarray of complex, shape of f
            In m/N, or in m/V.

        Raises
        ------
        BadValue
            A place beside the plate; patches where there are none.

        Examples
        --------
        >>> from stimlib.plate import Plate
        >>> plate = Plate.paper(measured=True)
        >>> centre = plate.length / 2, plate.width / 2
        >>> round(
        ...     float(1e6 * abs(plate.frf("patches", centre, plate.carrier()))), 2
        ... )  # um for each volt; the thesis says 0.6
        0.78
        """
        n = min(modes, self.axes[0].terms ** 2 // 4)
        if isinstance(drive, str) and drive == "patches":
            force = self.forces(n, weights)
        elif weights is None:
            force = np.array(
                [self.shape(k, *_place(drive, "drive", ", or 'patches'")) for k in range(n)]
            )
        else:
            raise BadValue(
                f"Plate.frf: weights apply to patches, but drive = {drive!r:.60}; say"
                " drive='patches'"
            )
        gain = force * np.array([self.shape(k, *_place(at, "at")) for k in range(n)])
        w, wk = 2 * math.pi * np.asarray(f, float)[..., None], np.sqrt(self.solved(n)[0])
        return np.sum(gain / (wk**2 - w**2 + 1j * w * wk * self.damping), axis=-1)

    def carrier(self, at: tuple[float, float] | None = None) -> float:
        """Return the resonance frequency in Hz with the largest response at a position.

        It is that of the mode with the largest resonance there.

        The plate is driven by its patches if it has any, else at that position.
        """
        at = (self.length / 2, self.width / 2) if at is None else _place(at, "at")
        f = self.modes(6)
        drive = "patches" if self.patches else at
        return float(f[np.argmax([abs(self.frf(drive, at, v)) for v in f])])

    def frequencies(self, n: int = 6) -> Callable[[dict[str, Any]], Any]:
        """Return the mode frequencies as a function of plate numbers, for JAX.

        It can be differentiated and mapped.

        Parameters
        ----------
        n : int
            How many.

        Returns
        -------
        function
            Of a dict with any of E, rho, clamp_stiffness, in_plane_load, to frequencies
            in Hz, shape (n,).  What the dict does not name is this plate's.

        Raises
        ------
        BadValue
            A name that is none of these; a clamp_stiffness of a plate whose edges
            cannot turn.

        Examples
        --------
        >>> import jax, numpy as np
        >>> from stimlib.plate import Plate
        >>> with jax.enable_x64(True):
        ...     jacobian = jax.jacobian(Plate.paper().frequencies(2))
        ...     by = np.array(jacobian({"E": 70e9})["E"])
        >>> (by * 70e9).round(2)  # half of each frequency: it goes with the root of E
        array([ 91.75, 125.65])
        """
        known = {
            "E": self.E,
            "rho": self.rho,
            "clamp_stiffness": self.clamp_stiffness,
            "in_plane_load": self.in_plane_load,
        }

        def f(numbers: dict[str, Any]) -> Any:
            jnp = package("jax.numpy", "Plate.frequencies")

            if set(numbers) - set(known) or (
                self.clamp_stiffness is None and "clamp_stiffness" in numbers
            ):
                raise BadValue(
                    f"Plate.frequencies: cannot move {', '.join(numbers)}; known are"
                    f" {', '.join(known)}, of which the clamps' stiffness needs a plate that"
                    " has one"
                )
            v = known | numbers
            D = v["E"] * (self.stiffness / self.E)
            host: Any = SimpleNamespace(E=v["E"], nu=self.nu, thickness=self.thickness, stiffness=D)
            K, M = self._system(v, host)
            half = jnp.linalg.inv(jnp.linalg.cholesky(M))
            return jnp.sqrt(jnp.linalg.eigvalsh(half @ K @ half.T)[:n]) / (2 * math.pi)

        return f


def _place(at, name: str, more: str = "") -> tuple[float, float]:
    try:
        x, y = (float(v) for v in at)
    except (TypeError, ValueError):
        raise BadValue(
            f"Plate: {name} = {at!r:.60} must be a place (x, y) in m from the plate's corner{more}"
        ) from None
    return x, y


def check_places(plate: Plate) -> None:
    """Raise BadValue where patches extend over an edge or overlap."""
    rectangles = [p.rectangle() for p in plate.patches]
    for i, (x0, x1, y0, y1) in enumerate(rectangles):
        if x0 < 0 or y0 < 0 or x1 > plate.length or y1 > plate.width:
            raise BadValue(
                f"Plate: patch {i}, {1e3 * x0:g} .. {1e3 * x1:g} mm by {1e3 * y0:g} .. {1e3 * y1:g}"
                f" mm, hangs over the edge of {1e3 * plate.length:g} x {1e3 * plate.width:g} mm:"
                " measure its centre from the corner again"
            )
        for j, (u0, u1, v0, v1) in enumerate(rectangles[:i]):
            if (
                plate.patches[i].side == plate.patches[j].side
                and x0 < u1
                and u0 < x1
                and y0 < v1
                and v0 < y1
            ):
                raise BadValue(
                    f"Plate: patches {j} and {i} overlap; measure their centres again, or change"
                    " the side of one"
                )


@cache
def _paper(edges: str, measured: bool, patches: str) -> Plate:
    """Return the plate of the thesis, shared by all callers.

    So its modes, half a second of linear algebra, are found only once.
    """
    plate = Plate(0.206, 0.147, 1.4e-3, 70e9, 0.24, 2500.0, edges, damping=0.1)
    if measured:
        plate = replace(plate, E=1.093 * plate.E, in_plane_load=-6.01e3)
    if patches:
        x, y, turned = CONFIGURATIONS[patches]
        places = [
            (x, y),
            (plate.length - x, y),
            (x, plate.width - y),
            (plate.length - x, plate.width - y),
        ]
        plate = replace(plate, patches=tuple(Patch.duraact(*p, turned) for p in places))
    return plate
