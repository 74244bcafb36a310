"""The safety stage between a scene and a device: limits, counts and a fade.

It consists of blocks that are compiled with the scene.

Because they are blocks, a sink, an offline rendering and the replay of a log do the
same to every sample, bit for bit. Where nothing is limited and the gain is 1, the
samples are the scene's own.
"""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np

from ..blocks.actuator import ForceLimit, Passive, ResponseLimit, Tally, slew_limit, static_limit
from ..blocks.filters import delay
from ..blocks.fir_filters import fir
from ..blocks.integrals import power_of
from ..core.graph import Block, Const, Input, Mul, named
from ..core.guard import Guard
from ..core.parameter import Param
from ..core.scene import Scene
from ..core.units import ONE, unit as unit_of
from ..errors import (
    Above0,
    BadValue,
    From0,
    Range,
    SceneError,
    UnitError,
    UnknownName,
    counted,
    need,
    public,
)

GAIN = "sink_gain"
"""The parameter of the fade: 1 while a session plays, on its way to 0 when it is
stopped or the hand is away.
"""

STEPS = 128
"""A fade has at least so many samples, so that full scale ends in steps of less than 1
% at every sample rate.
"""


QUIET = 10.0
"""Full scale of outputs without a unit where nobody gives one: 1.0 comes out as a tenth
of what the device has, 20 dB below it.
"""


@public
@dc.dataclass(frozen=True)
class Inverse:
    """The filter that undoes the response of a calibrated device, and that response.

    ``Calibration.safety`` makes it for a sample rate.

    Parameters
    ----------
    taps : sequence of float
        Taps of the inverse filter, an odd number.
    response : sequence of float
        Output of the device, in the calibration's unit, after one sample of 1.0.
    every : int
        Every so many samples, the predicted output is compared with its limits.
    error : float
        Relative error (95 %) of the output, within the band.

    Raises
    ------
    BadValue
        An even number of taps; numbers that are not finite; an error or ``every`` not
        above 0.

    Examples
    --------
    >>> Inverse([0.0, 0.5, 0.0], [2.0])
    Inverse(taps=(0.0, 0.5, 0.0), response=(2.0,), every=1, error=0.01)
    """

    taps: Sequence[float]
    response: Sequence[float]
    every: int = 1
    error: float = 0.01

    def __post_init__(self):
        for name in ("taps", "response"):
            row = np.array(getattr(self, name), float)
            if not (row.ndim == 1 and np.isfinite(row).all() and row.any()):
                raise BadValue(f"Inverse: {name} must be a row of finite numbers, not all 0")
            object.__setattr__(self, name, tuple(row.tolist()))
        if len(self.taps) % 2 == 0 or self.every < 1 or not self.error > 0:
            raise BadValue(
                f"Inverse: {counted(len(self.taps), 'tap')} must be an odd number, every ="
                f" {self.every} at least 1, and error = {self.error} above 0"
            )


Losses = Annotated[float, Range("a whole number from 0 to 1000", lambda v: v in range(1001))]


@public
@dc.dataclass(frozen=True)
class Passivity:
    r"""The energy that forces may give to a hand, and the damping that prevents more.

    An observer sums the work of each force over its position (see
    ``stimlib.blocks.energy``), as late as the device makes it, and counts each force
    under way as if it gave the most that it can. When less than half of ``bound`` is
    left, damping is added in proportion to what is missing. Should that not be enough,
    the force becomes smaller, so that no motion can take more than the bound.

    Parameters
    ----------
    bound : float, J
        The most that a force gives beyond what it has got, and beyond the power that it
        states to give (``stimlib.blocks.active``).
    damping : float, N s/m
        The largest damping that is added; 0: the force only becomes smaller.
    speed : float, m/s
        The fastest motion for which the bound holds.  A position farther away counts
        as an error of the sensor: no energy is credited for it.
    delay : float, s
        From the time of a sample until its force begins.  Of a part of a sample, the
        motion within a sample counts as straight.
    encoder : float, m
        Step of the measured position, by which the true one may differ.
    still : float, s
        For how long a reading may stay although the hand moves, because readings are
        dropped or the sensor is stuck.  A force that is held while a reading stays can
        give \|F\| speed ``still``, so the bound holds it to bound/(speed ``still``).
    lost : int
        How many forces in a row the device may not take: it holds the one before.
    sure : float, N, optional
        The force that the amplifier makes at least where it is asked for more.  No
        energy is credited for what is beyond.  By default it makes every force.
    axes : dict of str to str, optional
        The position of each force, {output: input}; by default the only one that it
        depends on.  A force over no position, such as a vibration, is not observed.

    Notes
    -----
    With r = speed/fs + encoder, every force is charged \|F\| r when it is sent, and
    F dx + \|F\| r >= 0 is credited when its motion dx is known; no force is charged
    more than is left.  So the energy given stays within the bound (to rounding) for any
    scene and hand, as long as the device makes the forces that it is sent, on time.

    For a change dF of the force, and for its way back to 0, \|dF\| encoder/2 is taken
    away, because the work of the true position differs by so much at most (summation by
    parts).  In the same way counts \|dF\| speed t for a reading that has stayed for t,
    up to ``still``, and \|F\| speed t until it changes.  Where several forces may act,
    the one that gives most counts.  So the bound holds also with dropped readings, with
    lost forces, or with a weak amplifier, as far as they are stated; one of these at a
    time is proved.  Without them: readings and commands of a hand that moves behind a
    stuck sensor are those of a hand at rest, so that a controller which lets a hand
    rest on a wall cannot know.

    References
    ----------
    Hannaford and Ryu, "Time-domain passivity control of haptic interfaces", IEEE Trans.
    Robotics and Automation 18 (2002); Ryu, Kwon and Hannaford, "Stability guaranteed
    control: time domain passivity approach", IEEE Trans. Control Systems Technology 12
    (2004): the observer of held forces. The charge in advance, and damping that grows
    in proportion, are our own: theirs act when energy has been given.

    Examples
    --------
    >>> limits = Passivity(0.01, damping=2.0, delay=0.003)
    >>> limits.bound, limits.speed
    (0.01, 1.0)
    """

    bound: Above0
    damping: From0 = 0.0
    speed: Above0 = 1.0
    delay: From0 = 0.0
    encoder: From0 = 0.0
    still: From0 = 0.0
    lost: Losses = 0
    sure: From0 | None = None
    axes: Mapping[str, str] | None = None


@public
@dc.dataclass(frozen=True)
class Safety:
    """The limits that are applied to every output on its way to a device.

    They can be changed but not removed.

    Parameters
    ----------
    full_scale : float or dict of str to float
        The largest value of each output, in its unit, which nothing exceeds; one number
        serves all outputs, which then have one unit.  Without a calibration it is also
        what 1.0 at the device makes; with one, it is the limit at the skin.
    slew : float or dict of str to float, optional
        Fastest change, in the output's unit per second; one number as for
        ``full_scale``.
    peak : float, optional
        Peak force in N that the motor bears, of every output in N.
    static : float, optional
        Static force in N that it bears, of every output in N: see
        ``stimlib.blocks.static_limit``.
    fade : float
        Seconds of the fades before the first sample, after the last and at a stop, 0.02
        to 0.5; where these are fewer than 128 samples, 128 samples.
    inverse : Inverse, optional
        Inverse filter of a calibrated device, which ``Calibration.safety`` sets.  It
        comes after the limits, filters each output that has a unit, and delays all by
        (taps - 1)/2 samples.  A drive beyond the device's range is then limited, which
        is counted as ``"drive"``; and so is a drive after which the predicted output
        of the device would pass a limit of value or slew, counted as ``"skin"``.
    passivity : Passivity, optional
        Bounds the energy that forces give to the hand.  It comes last, and acts at
        once, whatever ``slew`` is.  By default nothing is done.

    Raises
    ------
    BadValue
        A number not above 0; a fade below 0.02 s; ``passivity`` for a calibrated
        device.

    Examples
    --------
    >>> safety = Safety(full_scale=50.0, peak=40.0)
    >>> safety.peak, safety.fade
    (40.0, 0.02)
    >>> Safety(**Safety(full_scale=50.0).to_dict()) == Safety(full_scale=50.0)
    True
    """

    full_scale: float | str | Mapping[str, float]
    slew: float | str | Mapping[str, float] | None = None
    peak: float | None = None
    static: float | None = None
    fade: float = 0.02
    inverse: Inverse | Mapping[str, Any] | None = None
    passivity: Passivity | Mapping[str, Any] | None = None

    def __post_init__(self):
        for f in dc.fields(self):
            v = getattr(self, f.name)
            if v is None and f.name not in ("full_scale", "fade"):
                continue
            if made := {"inverse": Inverse, "passivity": Passivity}.get(f.name):
                try:
                    v = v if isinstance(v, made) else made(**_fitting(made, v))
                except BadValue as e:
                    raise BadValue(
                        f"Safety: {f.name} = {str(v)[:40]} is no {made.__name__}: {e}"
                    ) from None
            elif isinstance(v, Mapping) and f.name in ("full_scale", "slew"):
                v = {str(k): _above_0(f"{f.name}[{k!r}]", w) for k, w in v.items()}
            else:
                v = _above_0(f.name, v)
            object.__setattr__(self, f.name, v)
        if not 0.02 <= self.fade <= 0.5:
            raise BadValue(
                f"Safety: fade = {self.fade} s must be 0.02 to 0.5: faster is felt as a thump,"
                " slower delays the stop"
            )
        if self.inverse and self.passivity:
            raise BadValue(
                "Safety: passivity needs the forces that the device makes, and the inverse filter"
                " of a calibrated device hides them; give only one"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the limits as plain JSON data; ``Safety(**data)`` makes them again."""
        return dc.asdict(self)

    def samples(self, fs: float) -> int:
        """Return the length of a fade in samples at a sample rate."""
        return max(math.ceil(self.fade * fs - 1e-9), min(STEPS, math.ceil(0.5 * fs)))

    def scales(self, outputs: Sequence[str]) -> np.ndarray:
        """Return the full scale of each output, shape (n_outputs,), in its unit.

        Raises
        ------
        UnknownName
            An output without a full scale, or a full scale for none.
        """
        return np.array([self._of("full_scale", n, outputs) for n in outputs])

    def _of(self, field: str, output: str, outputs: Sequence[str]) -> Any:
        v = getattr(self, field)
        if not isinstance(v, Mapping):
            return v
        need(f"Safety: {field}", v, outputs, "output")
        missing = [n for n in outputs if n not in v]
        if missing and field == "full_scale":
            raise UnknownName(
                f"Safety: {field} has no value for {', '.join(missing)}; give one for each output,"
                " or one number for all if they have one unit"
            )
        return v.get(output)


def _fitting(made: Any, given: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what was given for a class, which must fit its fields."""
    fields = dc.fields(made)
    lacks = [f.name for f in fields if f.default is dc.MISSING and f.name not in given]
    wrong = [*map(str, given.keys() - {f.name for f in fields})]
    if lacks or wrong:
        said = [f"no {k!r} is known" for k in sorted(wrong)] + [f"{k} is missing" for k in lacks]
        raise BadValue(f"{' and '.join(said)}; it has {', '.join(f.name for f in fields)}")
    return given


def _above_0(name: str, v: Any) -> float:
    try:
        number = float(v)
    except (TypeError, ValueError):
        raise BadValue(f"Safety: {name} must be a number, got {v!r}") from None
    if isinstance(v, bool) or not (math.isfinite(number) and number > 0):
        raise BadValue(f"Safety: {name} = {v} must be a finite number above 0")
    return number


def quiet_scale(scene: Scene) -> float:
    """Return the default full scale of outputs without a unit, ``QUIET``.

    Raises
    ------
    BadValue
        An output has a unit: only the user knows what the device makes of it.

    Examples
    --------
    >>> from stimlib.run.safety import quiet_scale
    >>> from stimlib.scenes import tone
    >>> quiet_scale(tone())
    10.0
    >>> quiet_scale(tone(unit="N"))
    Traceback (most recent call last):
    stimlib.errors.BadValue: full_scale is missing: signal is in N, so give the
     value that 1.0 at the device makes, such as 50
    """
    for name, block in scene.outputs.items():
        if block.dim != ONE:
            raise BadValue(
                f"full_scale is missing: {name} is in {block.dim}, so give the value that 1.0 at"
                " the device makes, such as 50"
            )
    return QUIET


@public
def protect(
    scene: Scene, safety: Safety, over: Mapping[str, tuple[Block, float]] | None = None
) -> Scene:
    """Return a scene whose outputs are safe for a device.

    Every output is limited to the peak force (outputs in N) and to full scale. Then
    follow its guard against NaN and infinity, the static force limit (outputs in N),
    the slew limit, the inverse filter of a calibrated device with the limits of its
    drive and of its predicted output, and the fade, which multiplies by the parameter
    ``sink_gain``; that is 0 until it is set. The passivity controller comes last, if
    there is one. Limits come
    first, so that the guard fades from the last value that the device received, not
    from the value that the scene ran away to.

    Parameters
    ----------
    scene : Scene
    safety : Safety
    over : dict of str to (Block, float), optional
        For ``passivity``: of each force its position, and the power that it gives on
        purpose; by default those of the scene.

    Returns
    -------
    Scene
        With the inputs and outputs of the scene, in their order.

    Raises
    ------
    SceneError
        The scene has a parameter or input ``sink_gain`` of its own.
    UnitError
        One number as full scale or slew for outputs of different units.
    UnknownName
        Full scale or slew for an output that does not exist.
    BadValue
        A limit of force for a scene that has no output in N; ``passivity`` for one that
        has no force over a position, or for a force over several.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> force = stimlib.constant(2000.0, "N/m") * stimlib.Input("x", "m")
    >>> proc = stimlib.compile(
    ...     protect(stimlib.Scene({"force": force}), Safety(full_scale=50.0)), fs=8000
    ... )
    >>> proc.set("sink_gain", 1.0, ramp=0.0)
    >>> proc.process(np.array([[0.01, 0.02, 0.03]]))
    array([[20., 40., 50.]])
    """
    if GAIN in scene.params or GAIN in scene.inputs:
        raise SceneError(
            f"the name {GAIN!r} is reserved for the fade of a device; rename it in the scene"
        )
    _check_limits(scene, safety)
    names = tuple(scene.outputs)
    scales = dict(zip(names, safety.scales(names).tolist(), strict=True))
    gain = Param(GAIN, 0.0)
    made: dict[str, Block] = {n: Mul(_limited(n, scene, safety, scales[n]), gain) for n in names}
    p: Any = safety.passivity
    for n, (x, power) in (guarded(scene, safety) if over is None else over).items():
        numbers = scales[n], p.bound, power, p.damping, p.speed, p.delay, p.encoder
        faulty = p.still, int(p.lost), p.sure
        made[n] = _counted(Passive(made[n], x, gain, *numbers, *faulty), made[n], "passivity", n)
    return Scene(made)


def guarded(scene: Scene, safety: Safety) -> dict[str, tuple[Input, float]]:
    """Return the forces that a passivity controller guards.

    Each has its position, and the power in W that it states to give on purpose.
    """
    p: Any = safety.passivity
    if p is None:
        return {}
    axes, found = p.axes, {}
    need("Passivity: axes", axes or {}, scene.outputs, "output")
    need("Passivity: axes", (axes or {}).values(), scene.inputs, "input")
    for name, force in scene.outputs.items():
        inputs = named([force], Input)
        over = [n for n, x in inputs.items() if force.dim * x.dim == unit_of("J")]
        if axes and name in axes:
            found[name] = scene.inputs[axes[name]], power_of(force)
        elif len(over) > 1:
            raise BadValue(
                f"Passivity: {name} depends on {', '.join(over)}: say along which it acts, such as"
                f" axes={{{name!r}: {over[0]!r}}}, on the command line axes={name}:{over[0]}"
            )
        elif over:
            found[name] = inputs[over[0]], power_of(force)
    if not found:
        raise BadValue("Passivity: no output is a force over a position (N over m): leave it out")
    return found


def _check_limits(scene: Scene, safety: Safety) -> None:
    """Raise an error unless the limits fit the units of the outputs."""
    units = ", ".join(f"{n} [{b.dim}]" for n, b in scene.outputs.items())
    dims = {str(b.dim) for b in scene.outputs.values()}
    if (safety.peak or safety.static) and "N" not in dims:
        raise BadValue(
            f"Safety: peak and static limit outputs in N, but this scene has none: {units}; use"
            " full_scale or slew"
        )
    for field in ("full_scale", "slew"):
        told = getattr(safety, field)
        if isinstance(told, float) and len(dims) > 1:
            each = ", ".join(f"{n!r}: .." for n in scene.outputs)
            option = f"--{field.replace('_', '-')} " + ",".join(f"{n}=.." for n in scene.outputs)
            raise UnitError(
                f"Safety: {field} = {told:g} cannot apply to outputs in different units ({units});"
                f" give {{{each}}}, on the command line {option}"
            )


def _limited(name: str, scene: Scene, safety: Safety, scale: float) -> Block:
    """Return an output after its limits, each with a count of limited samples."""
    raw = scene.outputs[name]
    unit = str(raw.dim)
    peak, static = (safety.peak, safety.static) if unit == "N" else (None, None)
    y: Block = Guard(raw, STEPS)
    for stage, most in (("peak", peak), ("clip", scale)):
        if most is not None:
            raw = ForceLimit(raw, _limit(most, unit))
            y = _counted(Guard(raw, STEPS), y, stage, name)
    if static is not None:
        y = _counted(static_limit(y, static), y, "static", name)
    slew = safety._of("slew", name, tuple(scene.outputs))
    if slew is not None:
        y = _counted(slew_limit(y, slew), y, "slew", name)
    inverse: Any = safety.inverse
    if inverse is None:
        return y
    late, driven = len(inverse.taps) // 2, inverted(y, np.multiply(inverse.taps, scale))
    if y.dim == ONE:
        return driven
    felt = fir(y, np.convolve(inverse.taps, inverse.response)[: len(inverse.taps)])
    driven = Tally(driven, delay(y, late) if late else y, felt, "outside", name, inverse.error)
    y = _counted(ForceLimit(driven, _limit(scale, unit)), driven, "drive", name)
    response = np.divide(inverse.response, scale)
    held = ResponseLimit(y, response, min(scale, peak or scale), slew, inverse.every)
    return _counted(Guard(held, STEPS), y, "skin", name)


def _counted(y: Block, before: Block, stage: str, name: str) -> Block:
    return Tally(y, before, y, stage, name)


def _limit(most: float, unit: str) -> Const:
    return Const(most, "" if unit == "1" else unit)


def inverted(y: Block, taps: np.ndarray, unit: str = "") -> Block:
    """Return an output after the inverse filter of a calibrated device.

    One without a unit, such as a pulse that marks another output, is only delayed.
    """
    if y.dim != ONE:
        return fir(y, taps, unit)
    delay = np.zeros(len(taps))
    delay[len(taps) // 2] = 1.0
    return fir(y, delay)


def to_device(y: np.ndarray, scales: np.ndarray, channels: Sequence[int]) -> np.ndarray:
    """Convert frames to device samples, exactly as ``devices/callback.py`` does.

    Parameters
    ----------
    y : ndarray, shape (n_outputs, n)
        Outputs of a protected scene, in their units.
    scales : ndarray, shape (n_outputs,)
        ``Safety.scales``.
    channels : sequence of int
        For each channel the number of its output, or -1 for silence.

    Returns
    -------
    ndarray of float32, shape (n, channels)
        float32(y / full scale) held to -1 .. 1; 0 where y is not finite.

    Examples
    --------
    >>> to_device(np.array([[25.0, 60.0]]), np.array([50.0]), [0, -1]).tolist()
    [[0.5, 0.0], [1.0, 0.0]]
    """
    v = np.asarray(y) / np.asarray(scales)[:, None]
    v = np.clip(np.where(np.isfinite(v), v, 0.0), -1.0, 1.0).astype(np.float32)
    frames = np.zeros((v.shape[1], len(channels)), np.float32)
    for c, output in enumerate(channels):
        if output >= 0:
            frames[:, c] = v[output]
    return frames


def said_of_energy(energy: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return a sentence for each output of ``Watch.energy``."""
    return [
        f"{name} gave at most {1e3 * v['given']:.3g} mJ to motions of up to {v['speed']:g}"
        f" {v['unit']}; its passivity controller changed it by up to {v['most']:.3g}"
        + f", and did not trust {v['leaps']} position{'s'[: v['leaps'] > 1]}"
        * (v["leaps"] > 0)
        for name, v in energy.items()
    ]


class Watch:
    """A reader of a running processor's counts: limited samples and failed outputs.

    Parameters
    ----------
    proc : Processor
        Of a protected scene.

    Attributes
    ----------
    fade : int
        Samples in which a guard ends an output.
    """

    def __init__(self, proc):
        self._proc = proc
        self.fade = Guard(Const(0.0), STEPS).samples(proc.fs)
        instances, place = proc.program.instances, proc._place
        tallies = [(i, q.block) for i, q in enumerate(instances) if isinstance(q.block, Tally)]
        self._tallies = [(b.stage, b.output, place[i]) for i, b in tallies]
        # of a passivity controller, which is what such a tally counts
        self._observed = [(b.output, i) for i, b in tallies if b.stage == "passivity"]
        self._guards = [
            (name, place[i])
            for name, at in proc.program.outputs.items()
            for i in self._above(instances, at)
            if isinstance(instances[i].block, Guard)
        ]

    @staticmethod
    def _above(instances, at: int) -> list[int]:
        """Return the instances from an output's guard up to the scene's own guard.

        The guard behind an inverse filter is passed: what the scene's own guard has
        ended arrives there as a fade.
        """
        found, i, drive = [], at, False
        while True:
            found.append(i)
            q = instances[i]
            if not q.args or (isinstance(q.block, Guard) and i != at and not drive):
                return found
            drive = isinstance(q.block, Tally) and q.block.stage == "skin"
            i = next(
                (a for a in q.args if not isinstance(instances[a].block, (Param, Const))), q.args[0]
            )

    def counts(self) -> dict[str, dict[str, int]]:
        """Return the samples that each stage has changed, {stage: {output: count}}.

        Counts of 0 are left out.
        """
        words = self._proc._engine.peek()
        out: dict[str, dict[str, int]] = {}
        for stage, name, at in self._tallies:
            if words[at] and stage != "outside":
                out.setdefault(stage, {})[name] = int(words[at])
        return out

    def outside(self) -> dict[str, dict[str, Any]]:
        """Return the content outside of the calibrated band, by output.

        ``samples`` is the number of samples in which it was larger than the stated
        error, as a part of the largest sample requested; ``level`` its largest value,
        in the output's unit.  Outputs without such samples are left out.
        """
        words = self._proc._engine.peek()
        return {
            name: {"samples": int(words[at]), "level": float(words.view(np.float64)[at + 1])}
            for stage, name, at in self._tallies
            if words[at] and stage == "outside"
        }

    def energy(self) -> dict[str, dict[str, Any]]:
        """Return what passivity controllers observed and did, by output.

        ``given`` is the most energy in J that the force gave beyond what it had got,
        ``work`` what it has got so far, ``most`` the largest change of the force in N;
        ``leaps`` counts positions that no motion within the stated ``speed`` reaches.
        ``counts`` has the samples that were changed.
        """
        words, out = self._proc._engine.peek(), {}
        numbers = words.view(np.float64)
        for name, tally in self._observed:
            (i, *_), at = self._proc.program.instances[tally].args, self._proc._place[tally]
            # see actuator.PassiveState
            room = self._proc._place[i] + 5 * self._proc.design[i][1].sent.size + 4
            block: Any = self._proc.program.instances[i].block
            out[name] = {
                "given": float(numbers[room + 2]),
                "work": float(numbers[room + 1]),
                "most": float(numbers[at + 1]),
                "leaps": int(words[room + 3]),
                "speed": block.speed,
                "unit": "rad/s" if block.over.dim == ONE else f"{block.over.dim}/s",
            }
        return out

    def told(self) -> dict[str, dict[str, Any]]:
        """Return all of it, by the names that reports of sessions have."""
        return {"clips": self.counts(), "energy": self.energy(), "faults": self.faults()}

    def faults(self) -> dict[str, int]:
        """Return the outputs stopped by their guard, with the samples of the faults."""
        words = self._proc._engine.peek()
        left = words.view(np.float64)
        # see guard.GuardState
        return {
            name: int(words[at + 2]) for name, at in reversed(self._guards) if left[at + 1] >= 0
        }
