"""A scene on a virtual device: its force moves what moves it."""

from __future__ import annotations

import ctypes
import dataclasses as dc
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..blocks.filters import delay
from ..blocks.integrals import power_of
from ..core.graph import Input
from ..core.scene import Scene
from ..core.units import unit
from ..errors import Above0, BadValue, Count, From0, counted, need, public, said_as
from ..run.processor import compile
from ..run.safety import GAIN, Safety, Watch, protect, said_of_energy
from .device import Device, Faults, Hand, Mechanism

NOBODY, SOUND = Hand(), Faults()
FORCES = unit("N"), unit("N*m")
Course = Any  # a number, samples, or a function of the time in s


@public
def try_on(
    scene: Scene,
    device: Device,
    hand: Hand = NOBODY,
    *,
    fs: Above0 = 1000.0,
    seconds: Above0 = 2.0,
    start: float = 0.0,
    aim: Course = None,
    push: Course = 0.0,
    axis: tuple[str, str] | None = None,
    motion: Mapping[str, Course] = {},
    params: Mapping[str, float] = {},
    seed: int = 0,
    safety: Safety | None = None,
    faults: Faults = SOUND,
) -> ClosedLoop:
    """Let a force scene move a virtual device in a virtual hand.

    At each sample the scene reads the encoder, and its force is held for one sample
    period, after the delay of the device.  Between samples the linear part of device
    and hand moves by its exact solution; Coulomb friction takes velocity away in each
    of 8 parts of a sample period.

    Parameters
    ----------
    scene : Scene
    device : Device
    hand : Hand
        By default nobody holds the device.
    fs : float
        Sample rate in Hz.
    seconds : float
    start : float
        Where the device and the hand's aim are at sample 0, in m, at rest.
    aim : float, array_like or callable
        Where the hand wants to be, in m: one number, one for each sample, or a function
        of an array of times in s, such as a motion; by default it stays at ``start``.
    push : float, array_like or callable
        A force of the hand in N, in addition, such as a recorded one.
    axis : (str, str), optional
        The output and the input of the device; by default the only force over a
        position, or torque over an angle, whose device has its numbers in rad and N m;
        or the only force of a scene that reads no position, such as a vibration, whose
        input is "".
    motion : dict of str to float, array_like or callable
        All other inputs, by default 0.
    params : dict of str to float
    seed : int
        Of the scene's noise, the hand's tremor and the faults.
    safety : Safety, optional
        The safety stage between scene and device, with its gain at 1; by default none.
    faults : Faults
        Of the hardware, by default none.

    Returns
    -------
    ClosedLoop

    Raises
    ------
    BadValue
        No axis, or more than one to choose from; samples of another length.
    UnknownName
        An axis, a motion or a parameter that the scene does not have.

    Examples
    --------
    A hand of 50 g is thrown against a stiff wall:

    >>> import stimlib
    >>> from stimlib.blocks import wall
    >>> from stimlib.virtual import Device, Hand, try_on
    >>> scene = stimlib.Scene({"force": wall(stimlib.Input("x", "m"), 2000.0, at=0.01)})
    >>> thrown = Hand(mass=0.05)
    >>> for damping in (0.5, 2.0):
    ...     trial = try_on(scene, Device(0.1, damping), thrown, push=2.0)
    ...     print(trial.settles, trial.contacts)
    False 14
    True 34
    """
    output, name = _axis_of(scene, axis)
    need("try_on: motion", motion, scene.inputs, "input")
    proc = compile(_guarded(scene, output, safety), fs, seed=seed)
    for param, value in {**params, **({} if safety is None else {GAIN: 1.0})}.items():
        proc.set(param, value, ramp=0.0)
    n = max(1, round(seconds * fs))
    late = round(device.delay * fs, 9)
    plant = compile(_plant(device, hand, int(late), (late % 1.0) / fs, start), fs)
    t = np.arange(n + 1) / fs
    others = np.array([_course(motion.get(i, 0.0), t, i)[:n] for i in proc.inputs])
    aims, pushes = _course(start if aim is None else aim, t, "aim"), _course(push, t, "push")
    aims = aims + hand.shaking(t, seed) if hand.tremor else aims
    row = [*proc.outputs].index(output)
    # a row for each sample, in which each program reads and writes its own
    # the last column is the position of a scene that reads none
    columns = [*proc.inputs, ""]
    x, y = np.zeros((n, len(columns))), np.empty((n, len(proc.outputs)))
    given, ends = np.stack([np.zeros(n), aims[1:], pushes[:n]], axis=1), np.empty((n, 5))
    wrong = np.ascontiguousarray(faults.rows(t[:n], seed), float)
    x[:, :-1] = others.reshape(-1, n).T
    _coupled()(
        proc.address[1],
        plant.address[1],
        *(a.ctypes.data for a in (x, y, given, ends, wrong)),
        *(*x.shape[1:], *y.shape[1:], columns.index(name), row, n),
        math.floor(start / device.encoder + 0.5) * device.encoder if device.encoder else start,
    )
    read, position, velocity, done, least = ends.T
    work = np.cumsum(done)
    told: dict[str, Any] = {"power": power_of(scene.outputs[output]), **Watch(proc).told()}
    # those of the last output are of the force, too
    told["faults"] = {k: v for k, v in told["faults"].items() if k in scene.outputs}
    told["hardware"] = faults.told(wrong, y[:, row], device.limit)
    told["misstated"] = _misstated(device, safety, fs) if output in told["energy"] else {}
    if failed := Watch(plant).faults():
        told["faults"]["device"] = min(failed.values())
    return ClosedLoop(
        t[:n], position, read, velocity, y[:, row], work, work - done + least, y[:, -1], fs,
        device, hand, told,
    )  # fmt: skip


@cache
def _coupled() -> Callable[..., None]:
    """Return the compiled loop, see ``coupled.py``."""
    from ..targets.llvm.cache import load
    from ..targets.llvm.engine import runtime

    runtime()  # whose kernels it may name
    text = Path(__file__).with_name("coupled.py").read_text("utf-8")
    p, i = ctypes.c_void_p, ctypes.c_int64
    of = ctypes.CFUNCTYPE(None, *[p] * 7, *[i] * 5, ctypes.c_double)
    return of(load(text, "coupled").addresses["couple"])


def _guarded(scene: Scene, output: str, safety: Safety | None) -> Scene:
    """Return a scene after its safety stage; the last output is the force before it."""
    made = scene if safety is None else protect(scene, safety)
    free = max(scene.outputs, key=len) + "_"  # a name that no output has
    return Scene({**made.outputs, free: scene.outputs[output]})


def _misstated(device: Device, safety: Any, fs: float) -> dict[str, tuple[float, float]]:
    """Return what a passivity controller was told of a device that is not so."""
    p = safety.passivity
    found = {}
    if round(device.delay * fs, 9) != round(p.delay * fs, 9):
        found["delay"] = p.delay, device.delay
    if device.encoder > p.encoder:
        found["encoder"] = p.encoder, device.encoder
    return found


def _axis_of(scene: Scene, axis: tuple[str, str] | None) -> tuple[str, str]:
    """Return an axis, or the only force over a position, or torque over an angle."""
    if axis is not None:
        need("axis", axis[:1], scene.outputs, "output")
        need("axis", axis[1:], [*scene.inputs, ""], "input")
        return axis
    found = [
        (force, over)
        for force, y in scene.outputs.items()
        for over, x in scene.inputs.items()
        if y.dim * x.dim == unit("J")
    ]
    if not found:  # what reads no position, moves the device all the same
        found = [(y, "") for y, force in scene.outputs.items() if force.dim in FORCES]
    if not found:
        units = ", ".join(f"{n} [{y.dim}]" for n, y in scene.outputs.items())
        raise BadValue(
            f"no output is a force or a torque ({units}), so none moves a device: give a scene"
            " with an output in N or N m, such as 'tone(unit=\"N\")'"
        )
    if len(found) > 1:
        each = ["=".join(pair) for pair in found]
        raise BadValue(
            f"the device has one axis, which may be {' or '.join(each)}: give axis={found[0]!r},"
            f" on the command line --axis {each[0]}"
        )
    return found[0]


def _course(given: Course, t: np.ndarray, what: str) -> np.ndarray:
    """Return a number, samples or a function of time as one value for each time."""
    with said_as(BadValue, f"try_on: {what} must be numbers", TypeError, ValueError):
        row = np.asarray(given(t) if callable(given) else given, float)
    if not np.isfinite(row).all():
        raise BadValue(f"try_on: {what} is not finite; give finite numbers")
    if row.ndim and row.shape not in (t.shape, (t.size - 1,)):
        raise BadValue(f"try_on: {what} has shape {row.shape}; give one number for each sample")
    return np.append(row, row[-1]) if row.shape == (t.size - 1,) else np.broadcast_to(row, t.shape)


def _plant(d: Device, hand: Hand, late: int, rest: float, start: float) -> Scene:
    """Return the scene of a device in a hand, whose force comes so late."""
    force = Input("force")
    body = Mechanism(
        delay(force, samples=late) if late else force, Input("aim"), Input("push"), d.mass,
        d.damping, d.coulomb, d.encoder, d.dac, d.limit or 1e300, rest, d.lag, d.compliance,
        d.handle, hand.mass, hand.damping, hand.stiffness, start,
    )  # fmt: skip
    return Scene({name: getattr(body, name) for name in Mechanism.outputs})


@public
def swept_damping(
    scene: Scene,
    *,
    fs: Above0 = 1000.0,
    amplitude: Above0 = 1e-3,
    center: float = 0.0,
    delay: From0 = 0.0,
    size: Count = 400,
    axis: tuple[str, str] | None = None,
    params: Mapping[str, float] = {},
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Measure the damping that a device needs in the hand that is worst for it.

    That hand moves the device whatever the force, along a sinusoid, and straight from
    one change of the force to the next, which is the slowest way.  The energy that the
    force then gives, divided by the integral of the velocity squared, is the damping
    which takes it away.  No law is assumed, so walls, friction and loops can be
    measured at the amplitude of interest; of a linear scene the largest value is that
    of `stimlib.analysis.needed_damping`.

    Parameters
    ----------
    scene : Scene
    fs : float
        Sample rate in Hz.
    amplitude, center : float
        Of the motion in m.
    delay : float
        Of the device in s.
    size : int
        Samples over which energy is counted, after as many others.
    axis, params, seed
        As of `try_on`.

    Returns
    -------
    f : ndarray, shape (size // 2 - 1,), Hz
        Multiples of fs/size below fs/2.
    damping : ndarray, shape (size // 2 - 1,), N s/m
        Below 0 where the scene takes energy.

    Raises
    ------
    BadValue
        No axis, or several to choose from; a force that reads no position.
    UnknownName
        An axis or a parameter that the scene does not have.

    References
    ----------
    Colgate and Schenkel (1997): a spring and a difference as damper need K T/2 + B.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.blocks import spring
    >>> from stimlib.virtual import swept_damping
    >>> scene = stimlib.Scene({"force": spring(stimlib.Input("x", "m"), 1000.0)})
    >>> f, damping = swept_damping(scene, delay=0.003)
    >>> print(f"{damping.max():.2f} N s/m, at {f[damping.argmax()]:.1f} Hz")
    3.50 N s/m, at 2.5 Hz
    """
    output, name = _axis_of(scene, axis)
    if not name:
        raise BadValue(f"swept_damping: {output} reads no position, so it needs no damping: try_on")
    proc = compile(scene, fs, seed=seed)
    column, row = [*proc.inputs].index(name), [*proc.outputs].index(output)
    f = np.arange(1, size // 2) * fs / size
    t = np.arange(2 * size) / fs
    x, damping = np.zeros((len(proc.inputs), t.size)), np.empty(f.size)
    for k, w in enumerate(2 * np.pi * f):
        proc.reset(seed)
        for param, value in params.items():
            proc.set(param, value, ramp=0.0)
        x[column] = center + amplitude * np.sin(w * t)
        late = amplitude * np.sin(w * (np.append(t, t.size / fs) + delay))
        step = np.diff(late)
        given = -np.sum((proc.process(x)[row] * step)[size:])
        damping[k] = given / (np.sum(step[size:] ** 2) * fs)
    return f, damping


@dc.dataclass(frozen=True, eq=False)
class ClosedLoop:
    """What a device and a hand made of a scene; `try_on` makes it.

    Attributes
    ----------
    t : ndarray, shape (n,), s
        Times of the samples.
    position, measured, velocity : ndarray, shape (n,), m and m/s
        Of the motor one sample period after each sample, and what its encoder says.
    force : ndarray, shape (n,), N
        Of the scene at each sample.
    work : ndarray, shape (n,), J
        What the hand has done against the force since sample 0; the energy that the
        scene has given is its negative.
    dips : ndarray, shape (n,), J
        The least that this work was in each sample period, at 17 times from its start.
    asked : ndarray, shape (n,), N
        Force of the scene before its safety stage.
    fs : float, Hz
    device : Device
    hand : Hand
    told : dict
        What the safety stage did, as in the report of a session: "clips", "faults"
        (also of the "device", whose motion was not finite) and "energy"; the "power" in
        W that the scene states to give on purpose, see ``stimlib.blocks.active``; and
        what failed of the "hardware", which the stage cannot know: the samples of each
        fault, and those of a force beyond what the amplifier makes; and what was
        "misstated" to a passivity controller, with what the device has.
    """

    t: np.ndarray
    position: np.ndarray
    measured: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    work: np.ndarray
    dips: np.ndarray
    asked: np.ndarray
    fs: float
    device: Device
    hand: Hand
    told: dict[str, Any]

    @property
    def given(self) -> float:
        """The most energy in J that the scene had given beyond what it had got.

        A passive scene that starts without stored energy gives none.
        """
        return max(0.0, -float(self.dips.min()))

    @property
    def beyond(self) -> float:
        """The energy in J that it gave beyond what it states to give on purpose."""
        return max(0.0, -float(np.min(self.dips + self.told["power"] * (self.t + 1 / self.fs))))

    @property
    def swing(self) -> tuple[float, float]:
        """Root mean squares of the velocity in m/s, in the second and last third."""
        third = max(1, self.t.size // 3)
        middle, last = self.velocity[third : 2 * third], self.velocity[-third:]
        return float(np.sqrt(np.mean(middle**2))), float(np.sqrt(np.mean(last**2)))

    @property
    def settles(self) -> bool:
        """Whether the motion dies: it is smaller by 2 % in the last third, or 0.

        A force or a motion that was not finite has been ended, so that it never does.
        """
        middle, last = self.swing
        return bool(last < max(0.98 * middle, 1e-12)) and not self.told["faults"]

    @property
    def cycle(self) -> tuple[float, float]:
        """Amplitude in m and frequency in Hz of the swing in the last third."""
        third = max(2, self.t.size // 3)
        x = self.position[-third:] - self.position[-third:].mean()
        ups = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
        rate = (ups.size - 1) / (ups[-1] - ups[0]) * self.fs if ups.size > 1 else 0.0
        return float(np.ptp(x) / 2), float(rate)

    @property
    def contacts(self) -> int:
        """How often the force began, from exactly 0."""
        touches = self.force != 0.0
        return int(np.count_nonzero(touches[1:] & ~touches[:-1]) + touches[0])

    def __str__(self):
        """Say in sentences what happened."""
        amplitude, rate = self.cycle
        lines = [
            f"{self.device!r} in {self.hand!r}, {self.t.size / self.fs:g} s at {self.fs:g} Hz",
            f"the device comes to rest at {1e3 * self.position[-1]:.3g} mm"
            if self.settles
            else f"the device does not come to rest: {1e3 * amplitude:.3g} mm at {rate:.3g} Hz",
            f"contact began {counted(self.contacts, 'time')}",
            f"the scene gave {1e3 * self.given:.3g} mJ more than it had got; the hand did"
            f" {1e3 * self.work[-1]:.3g} mJ in all",
        ]
        if power := self.told["power"]:
            lines.append(
                f"it is active on purpose, {1e3 * power:.3g} mW: {1e3 * self.beyond:.3g} mJ"
                " were beyond this"
            )
        lines += said_of_energy(self.told["energy"])
        lines += [
            f"its bound may not hold: the controller was told {name} = {stated:g}, and the device"
            f" has {real:g}"
            for name, (stated, real) in self.told["misstated"].items()
        ]
        if hardware := self.told["hardware"]:
            lines.append(
                "the hardware: " + ", ".join(f"{n} {what}" for what, n in hardware.items())
            )
        lines += [
            f"{name} was not finite at sample {at} ({at / self.fs:g} s), and ended"
            for name, at in self.told["faults"].items()
        ]
        return "\n".join(lines)


@public
def margin(
    trials: Callable[[float], ClosedLoop | Sequence[ClosedLoop]],
    low: float,
    high: float,
    rel: Above0 = 0.005,
) -> float:
    """Find by bisection where trials stop to settle, such as the stiffest wall.

    Parameters
    ----------
    trials : callable
        Of a number, such as a stiffness, a delay or a sample rate: a trial, or one for
        each of several hands, all of which have to settle.
    low, high : float
        One of these settles, the other does not.
    rel : float
        Largest relative width of the last interval.

    Returns
    -------
    float
        The last number that settles.

    Raises
    ------
    BadValue
        Both ends settle, or neither.

    Examples
    --------
    The stiffest spring for a device of 100 g, 0.5 N s/m and 1 kHz, k = 2 b fs:

    >>> import stimlib
    >>> from stimlib.blocks import spring
    >>> from stimlib.virtual import Device, margin, try_on
    >>> def stiff(k):
    ...     scene = stimlib.Scene({"force": spring(stimlib.Input("x", "m"), k)})
    ...     return try_on(
    ...         scene, Device(0.03, 0.5), push=lambda t: t < 0.01, seconds=3.0
    ...     )
    >>> print(f"{margin(stiff, 100.0, 5000.0):.0f} N/m")
    1000 N/m
    """

    def settles(value: float) -> bool:
        made = trials(value)
        several = list(made) if isinstance(made, Iterable) else [made]
        if not several or not all(hasattr(one, "settles") for one in several):
            raise BadValue(
                f"margin: trials({value:g}) gave {made!r:.80}: return what try_on does, or a list"
                " of them"
            )
        return all(trial.settles for trial in several)

    good, bad = (low, high) if settles(low) else (high, low)
    if settles(bad) or not settles(good):
        raise BadValue(
            f"margin: at {low:g} and at {high:g} the trials"
            f" {'all' if settles(good) else 'do not all'} settle: choose ends that differ in this"
        )
    while abs(good - bad) > rel * abs(good) and (middle := (good + bad) / 2) not in (good, bad):
        good, bad = (middle, bad) if settles(middle) else (good, middle)
    return good
