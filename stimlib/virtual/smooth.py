"""The smooth part of a virtual device as one differentiable function of parameters."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..core.graph import Block, Input, constant, reach, signals
from ..core.loops import loop
from ..core.scene import Scene
from ..errors import Above0, BadValue, need, public
from ..run.processor import compile
from .closed_loop import NOBODY, Course, _axis_of, _course
from .device import Device, Hand, Mechanism


@public
def smooth(
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
    seed: int = 0,
) -> Callable[..., dict[str, Any]]:
    """Return a closed loop as a function of the scene's parameters, which JAX derives.

    Scene and device become one program for JAX: ``jax.grad`` gives how a peak of the
    motion, the force or the energy depends on each parameter, such as a stiffness or a
    damping.  Coulomb friction, steps and limits have no derivative and are not allowed,
    nor is an amplifier's lag; delay and transmission are exact, as in ``try_on``.

    Parameters
    ----------
    scene, device, hand, fs, seconds, start, aim, push, axis, motion, seed
        As of ``try_on``.

    Returns
    -------
    callable
        Of a dict of parameters, by default the scene's own values: a dict of arrays of
        JAX, shape (n,): position, velocity, force and work, as ``ClosedLoop`` has them.

    Raises
    ------
    BadValue
        A device with friction, steps, a limit or a lag; no axis, or several.
    UnknownName
        An axis or a motion that the scene does not have.

    Examples
    --------
    How much less far a push of 1 N comes for each N/m of a spring (needs JAX):

    >>> import stimlib
    >>> from stimlib.virtual import Device, Hand, smooth
    >>> k = stimlib.Param("k", 500.0, "N/m")
    >>> scene = stimlib.Scene({"force": k * stimlib.Input("x", "m")})
    >>> run = smooth(scene, Device(0.1, 2.0), Hand(0.05, 2.0), push=1.0, seconds=0.2)
    >>> def peak(k):
    ...     return run({"k": k})["position"].max()
    >>> import jax  # doctest: +SKIP
    >>> jax.grad(peak)(500.0)  # doctest: +SKIP
    Array(-6.16e-06, dtype=float64, weak_type=True)
    """
    if device.coulomb or device.encoder or device.dac or device.limit or device.lag:
        raise BadValue(
            f"smooth: {device!r}: friction, steps and limits have no derivative, and work counts"
            " the force as it is sent: leave out coulomb, encoder, dac, limit and lag"
        )
    output, name = _axis_of(scene, axis)
    need("smooth: motion", motion, scene.inputs, "input")
    t = np.arange(max(1, round(seconds * fs)) + 1) / fs
    aims = _course(start if aim is None else aim, t, "aim")
    aims = aims + hand.shaking(t, seed) if hand.tremor else aims
    given = {n: _course(motion.get(n, 0.0), t, n)[:-1] for n in scene.inputs if n != name}
    free = max([*scene.inputs, *scene.params], key=len) + "_"  # names that the scene lacks
    begun = np.append(start, aims[1:-1])
    slope = (aims[1:] - begun) * fs
    held = hand.stiffness * begun + hand.damping * slope + _course(push, t, "push")[:-1]
    held = held - hand.stiffness * start  # the states count from the start
    given |= {f"{free}h": held, f"{free}g": hand.stiffness * slope}
    rest, whole = np.modf(round(device.delay * fs, 9))
    parts = [_part(device, hand, share / fs) for share in (rest, 1.0 - rest)]
    joined = _joined(scene.outputs[output], name, parts, int(whole), free, start)
    made = compile(Scene(joined), fs, "jax", seed)

    def run(params: Mapping[str, Any] = {}) -> dict[str, Any]:
        import jax.numpy as jnp

        signals_ = made(dict(params), given)
        x, first, late, now = (signals_[n] for n in ("x", "middle", "late", "now"))
        work = late * (first - jnp.concatenate([jnp.zeros(1), x[:-1]])) + now * (x - first)
        return {
            "position": x + start,
            "velocity": signals_["velocity"],
            "force": signals_["force"],
            "work": jnp.cumsum(work),
        }

    return run


def _part(d: Device, h: Hand, t: float) -> tuple[np.ndarray, ...]:
    """Return what a time t makes of state, force, force of the hand and its rise."""
    zero = constant(0.0)
    body = Mechanism(
        zero, zero, zero, d.mass, d.damping, 0.0, 0.0, 0.0, 1e300, 0.0, d.lag, d.compliance,
        d.handle, h.mass, h.damping, h.stiffness, 0.0,
    )  # fmt: skip
    a, f, _, of_hand, rise, _ = body._substep(t)
    return a.reshape(f.size, f.size), f, of_hand, rise, np.array(t)


def _joined(
    force: Block, name: str, parts: Sequence[Any], whole: int, free: str, start: float
) -> dict[str, Block]:
    """Return the outputs of scene and device in one loop of numbers."""
    (a1, f1, h1, g1, t1), (a2, f2, h2, g2, _) = parts
    size = f1.size
    held, rise = Input(f"{free}h"), Input(f"{free}g")
    # of the whole period: the second part begins with the hand's force risen by t1
    a, of_late, of_now = a2 @ a1, a2 @ f1, f2
    of_hand, of_rise = a2 @ h1 + h2, a2 @ g1 + g2 + h2 * t1

    def linear(row: np.ndarray, last: Sequence[Block], *more: tuple[float, Block]) -> Block:
        terms = [float(c) * y for c, y in [*zip(row, last, strict=True), *more] if c != 0.0]
        return sum(terms[1:], terms[0]) if terms else constant(0.0) * last[0]

    def news(last: list[Block]) -> list[Block]:
        """Return the next states, then the forces under way, then other signals."""
        q, under_way = last[:size], last[size:]
        place = constant(1.0, "m") * (q[0] + start)
        asked = _swapped(force, name, place) / constant(1.0, str(force.dim))
        commands = [asked, *under_way]
        now, late = commands[whole], commands[whole + 1]
        hand = (held, rise)
        after = [
            linear(
                a[i],
                q,
                (of_late[i], late),
                (of_now[i], now),
                *zip((of_hand[i], of_rise[i]), hand, strict=True),
            )
            for i in range(size)
        ]
        middle = linear(a1[0], q, (f1[0], late), *zip((h1[0], g1[0]), hand, strict=True))
        return [*after, *commands[: whole + 1], asked, middle, late, now]

    def nested(last: list[Block]) -> list[Block]:
        if len(last) == size + whole + 1:
            return news(last)
        k = len(last)

        def one(value: Block) -> tuple[Block, ...]:
            every = nested([*last, value])
            return every[k], *every[:k], *every[k + 1 :]

        own, *others = loop(one)
        return [*others[:k], own, *others[k:]]

    every = nested([])
    names = "x", "velocity", "force", "middle", "late", "now"
    return dict(zip(names, [*every[:2], *every[-4:]], strict=True))


def _swapped(force: Block, name: str, place: Block) -> Block:
    """Return a force whose input of this name is another signal."""
    new: dict[int, Block] = {}
    for b in reach([force]):
        if isinstance(b, Input) and b.name == name:
            new[id(b)] = place
        else:
            kids: Any = {s: new[id(getattr(b, s))] for s in signals(type(b))}
            new[id(b)] = dc.replace(b, **kids)  # type: ignore[type-var]
    return new[id(force)]
