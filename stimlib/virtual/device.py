"""Devices and hands as mechanical models, and their exact motion between samples."""

from __future__ import annotations

import dataclasses as dc
import json
import math
from collections import namedtuple
from pathlib import Path
from typing import Any

import numpy as np

from ..core.graph import Block, scratch
from ..core.maths import floor, where
from ..errors import Above0, BadValue, From0, public

SUBSTEPS = 8
"""Parts of a sample period in each of which Coulomb friction is one number."""


def _given(self: Any) -> str:
    """Write a class with what was given of it."""
    given = [f for f in dc.fields(self) if getattr(self, f.name) != f.default]
    fields = ", ".join(f"{f.name}={getattr(self, f.name)!r}" for f in given)
    return f"{type(self).__name__}({fields})"


@public
@dc.dataclass(frozen=True)
class Device:
    """A force-feedback device of one axis.

    Its motor moves mass, damper and Coulomb friction; an encoder measures the position,
    and the force is rounded, limited and late.

    Parameters
    ----------
    mass : float, kg
    damping : float, N s/m
    coulomb : float, N
        Largest force of dry friction.
    encoder, dac : float, m and N
        Steps of the measured position and of the force; 0: none.
    limit : float, N
        Largest force; 0: none.
    delay : float, s
        From the time of a sample until its force begins.
    lag : float, s
        Time constant of the amplifier; 0: none.
    compliance : float, m/N
        Of the transmission between motor and handle; 0: it is rigid.
    handle : float, kg
        Mass behind the transmission, with the hand.

    Raises
    ------
    BadValue
        A mass not above 0, other numbers below 0; a transmission without handle.

    Examples
    --------
    >>> from stimlib.virtual import Device
    >>> Device(mass=0.1, damping=0.5, encoder=10e-6, delay=0.001)
    Device(mass=0.1, damping=0.5, encoder=1e-05, delay=0.001)
    """

    mass: Above0
    damping: From0
    coulomb: From0 = 0.0
    encoder: From0 = 0.0
    dac: From0 = 0.0
    limit: From0 = 0.0
    delay: From0 = 0.0
    lag: From0 = 0.0
    compliance: From0 = 0.0
    handle: From0 = 0.0

    def __post_init__(self):
        if (self.compliance > 0) != (self.handle > 0):
            raise BadValue("Device: compliance and handle belong together: give both, or neither")

    __repr__ = _given


@public
@dc.dataclass(frozen=True)
class Hand:
    """A hand as a mass on a spring and a damper, whose other end it moves on purpose.

    Parameters
    ----------
    mass : float, kg
    damping : float, N s/m
    stiffness : float, N/m
    tremor : float, m
        Amplitude of the tremor of the other end, 8 to 12 Hz: sqrt(2) times its rms.

    Raises
    ------
    BadValue
        A number below 0; a tremor without a spring or a damper that passes it on.

    Examples
    --------
    >>> from stimlib.virtual import Hand
    >>> Hand(mass=0.05, damping=2.0, stiffness=300.0)
    Hand(mass=0.05, damping=2.0, stiffness=300.0)
    """

    mass: From0 = 0.0
    damping: From0 = 0.0
    stiffness: From0 = 0.0
    tremor: From0 = 0.0

    def __post_init__(self):
        if self.tremor and not (self.damping or self.stiffness):
            raise BadValue("Hand: tremor reaches the device by stiffness or damping; give one")

    __repr__ = _given

    def shaking(self, t: np.ndarray, seed: int) -> np.ndarray:
        """Return the tremor at times in s: 32 sinusoids of 8 to 12 Hz, in m."""
        rng = np.random.default_rng([seed, 1])
        f, phase = rng.uniform(8.0, 12.0, (32, 1)), rng.uniform(0.0, 2 * np.pi, (32, 1))
        return self.tremor * np.sin(2 * np.pi * f * t + phase).sum(axis=0) / math.sqrt(32)


@public
@dc.dataclass(frozen=True)
class Faults:
    """Faults of a device's hardware.

    Parameters
    ----------
    jump : (float, float), s and m
        When the encoder jumps, and how far; it counts on from there.
    stuck : (float, float), s
        From when and until when the encoder says the same.
    dropped : float
        Part of the readings that do not come: the scene gets the one before.
    lost : float
        Part of the forces that the device does not take: it holds the one before.
    saturated : (float, float), s and N
        From when on the amplifier makes no larger force than this.

    Raises
    ------
    BadValue
        Numbers that are not finite; parts outside 0 to 1; an end before its beginning.

    Examples
    --------
    >>> from stimlib.virtual import Faults
    >>> Faults(jump=(0.5, 0.005), dropped=0.01)
    Faults(jump=(0.5, 0.005), dropped=0.01)
    """

    jump: tuple[float, float] = (0.0, 0.0)
    stuck: tuple[float, float] = (0.0, 0.0)
    dropped: From0 = 0.0
    lost: From0 = 0.0
    saturated: tuple[float, float] = (0.0, math.inf)

    def __post_init__(self):
        numbers = (*self.jump, *self.stuck, self.saturated[0], self.dropped, self.lost)
        ordered = self.stuck[0] <= self.stuck[1] and self.saturated[1] >= 0
        if not (np.isfinite(numbers).all() and max(numbers[-2:]) <= 1 and ordered):
            raise BadValue(
                f"{self!r}: times and jumps are finite, parts 0 to 1, a force not below 0, and a"
                " sensor is stuck from a time until a later one"
            )

    __repr__ = _given

    def rows(self, t: np.ndarray, seed: int) -> np.ndarray:
        """Return the faults at times in s, shape (n, 4).

        Columns: what the encoder adds, whether its reading stays, whether the force
        stays, the largest force.
        """
        rng = np.random.default_rng([seed, 2])
        dropped, lost = rng.random((2, t.size)) < [[self.dropped], [self.lost]]
        stuck = (t >= self.stuck[0]) & (t < self.stuck[1])
        most = np.where(t >= self.saturated[0], self.saturated[1], math.inf)
        added = self.jump[1] * (t >= self.jump[0])
        return np.stack([added, stuck | dropped, lost, most], axis=1)

    def told(self, rows: np.ndarray, force: np.ndarray, limit: float) -> dict[str, int]:
        """Return the samples of each fault that happened, by what it was."""
        added, stayed, lost, most = rows.T
        most = np.minimum(most, limit or math.inf)
        happened = {
            "positions off": added != 0,
            "readings that stayed": stayed > 0,
            "forces lost": lost > 0,
            "forces beyond the amplifier's": np.abs(force) > most,
        }
        return {what: int(row.sum()) for what, row in happened.items() if row.any()}


@public
def read_device(path: str | Path) -> Device:
    """Read a device from a JSON file with the names of `Device`.

    Raises
    ------
    BadValue
        No such file, no JSON, other names, or numbers that make no device.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from stimlib.virtual import read_device
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "device.json")
    ...     _ = path.write_text('{"mass": 0.1, "damping": 0.5}')
    ...     read_device(path)
    Device(mass=0.1, damping=0.5)
    """
    try:
        given = json.loads(Path(path).read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as e:
        raise BadValue(
            f"{path}: cannot be read ({getattr(e, 'strerror', e)}); write a device as JSON"
        ) from None
    known = [f.name for f in dc.fields(Device)]
    if not isinstance(given, dict) or given.keys() - known or not {"mass", "damping"} <= {*given}:
        raise BadValue(
            f"{path}: no device: write mass and damping, and what else it has of"
            f" {', '.join(known[2:])}, as JSON"
        )
    return Device(**given)


# How they move ------------------------------------------------------------------------
# Parameters of `Mechanism`.  The state q is: position and velocity of the motor, then
# of the handle, if any, then the force of the amplifier, if it has a lag. Of each of
# the two parts of a sample period, before and after the force changes:
#   a              matrix of a substep, row by row
#   f, c, h, g     what a force command, friction, a force at the hand and its rise add
#   grow           s, length of a substep
# and of the whole
#   stiffness, damping   of the hand
MechanismParams = namedtuple(
    "MechanismParams", "a f c h g grow stiffness damping coulomb encoder dac limit lagged fs"
)

# State of `Mechanism` between samples.
#   q     see above
#   last  the force command of the sample before
#   aim   where the hand wanted to be
MechanismState = namedtuple("MechanismState", "q last aim")


@dc.dataclass(frozen=True, eq=False)
class Mechanism(Block, in_files=False):
    """A device in a hand along a sample period, in which the force command is held.

    Its outputs are for the end of the period.  ``done`` is the work of the hand
    against the force, and ``least`` the smallest that it was in the period.
    """

    force: Block  # that the hand has to overcome, as scenes give it
    aim: Block  # of the hand, at the end of the period
    push: Block  # one more force of the hand
    mass: float
    drag: float
    coulomb: float
    encoder: float
    dac: float
    limit: float
    rest: float  # s, of the delay: of whole samples the scene has a block
    lag: float
    compliance: float
    handle: float
    held: float
    damping: float
    stiffness: float
    begin: float  # m, of the device and of the hand's aim
    outputs = ("measured", "position", "velocity", "done", "least")
    begins_early = False

    def units(self, *u):
        return u[1], u[1], u[1], u[1], u[1]

    def design(self, fs):
        parts = [
            self._substep(part / fs / SUBSTEPS) for part in (self.rest * fs, 1 - self.rest * fs)
        ]
        a, f, c, h, g, grow = (np.concatenate(rows) for rows in zip(*parts, strict=True))
        p = MechanismParams(
            a, f, c, h, g, grow, self.stiffness, self.damping, self.coulomb, self.encoder, self.dac,
            self.limit, float(self.lag > 0), fs,
        )  # fmt: skip
        q = np.zeros(f.size // 2)
        q[: 2 + 2 * (self.compliance > 0) : 2] = self.begin
        return p, MechanismState(q, 0.0, self.begin)

    def _substep(self, t):
        """Return the exact solution of the linear part over a time t."""
        from scipy.linalg import expm

        two, lagged = self.compliance > 0, self.lag > 0
        end = 2 * two  # position of what the hand holds
        n = 2 + end + lagged
        m = np.zeros((n + 4, n + 4))
        masses = [self.mass, self.handle] if two else [self.mass]
        masses[-1] += self.held
        for k in range(len(masses)):
            m[2 * k, 2 * k + 1] = 1.0
        m[1, 1] -= self.drag / masses[0]
        m[end + 1, end] -= self.stiffness / masses[-1]
        m[end + 1, end + 1] -= self.damping / masses[-1]
        for k in range(2) if two else ():
            m[2 * k + 1, 2 * k] -= 1 / self.compliance / masses[k]
            m[2 * k + 1, 2 - 2 * k] += 1 / self.compliance / masses[k]
        if lagged:
            m[n - 1, n - 1], m[n - 1, n], m[1, n - 1] = -1 / self.lag, 1 / self.lag, -1 / masses[0]
        else:
            m[1, n] = -1 / masses[0]
        m[1, n + 1], m[end + 1, n + 2], m[n + 2, n + 3] = 1 / masses[0], 1 / masses[-1], 1.0
        e = expm(m * t)[:n]
        return e[:, :n].ravel(), *e[:, n:].T, np.array([t])

    work = scratch(8)

    @staticmethod
    def tile(p, s, force, aim, push, measured, position, velocity, done, least, w):
        q, n, last, old = s.q, s.q.size, s.last, s.aim
        for i in range(force.size):
            slope = (aim[i] - old) * p.fs
            steady = push[i] + p.damping * slope
            command = force[i]
            if p.dac > 0.0:
                command = floor(command / p.dac + 0.5) * p.dac
            command = where(
                command < p.limit, where(command > -p.limit, command, -p.limit), p.limit
            )
            at, total, low = old, 0.0, 0.0
            for part in range(2):
                f = where(part == 0, last, command)
                for _ in range(SUBSTEPS):
                    held = steady + p.stiffness * at
                    for j in range(n):
                        k = n * part + j
                        moved = p.f[k] * f + p.h[k] * held + p.g[k] * p.stiffness * slope
                        for m in range(n):
                            moved = moved + p.a[n * k + m] * q[m]
                        w[j] = moved
                    # friction takes from the velocity what it can, and no more than all
                    gain = p.c[n * part + 1]
                    stop = where(gain > 0.0, -w[1] / where(gain > 0.0, gain, 1.0), 0.0)
                    stop = where(
                        stop < p.coulomb, where(stop > -p.coulomb, stop, -p.coulomb), p.coulomb
                    )
                    acting = where(p.lagged > 0.0, q[n - 1], f)
                    before = q[0]
                    for j in range(n):
                        q[j] = w[j] + p.c[n * part + j] * stop
                    acting = 0.5 * (acting + where(p.lagged > 0.0, q[n - 1], f))
                    total = total + acting * (q[0] - before)
                    low = where(total < low, total, low)
                    at = at + slope * p.grow[part]
            last, old = command, aim[i]
            position[i], velocity[i], done[i], least[i] = q[0], q[1], total, low
            measured[i] = q[0]
            if p.encoder > 0.0:
                measured[i] = floor(q[0] / p.encoder + 0.5) * p.encoder
        return MechanismState(q, last, old)
