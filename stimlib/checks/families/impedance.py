"""Laws of the blocks of the family ``impedance``, and of the scene ``squeeze``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy

from ...analysis.recursion import all_pole
from ...core.scene import Scene
from ...errors import SceneError
from ...files.formats import BITS
from ...run.driver import samples
from ...run.processor import compile
from .. import laws
from ..evidence import Asked, Check, law_of, noise_model
from ..linear import LONG, Modes, response, straight
from ..rows import FADED, law, near


@law("Hysteresis", "Loading", since=1)
def _gate(b, fs, x, y):
    on, off = b.on, b.off
    if on is None or off is None:
        on, off = laws.gate_thresholds(b.resolution, b.v.cutoff, fs)
    n, begins = np.arange(y.size), 0 if x.rest else y[0]
    opened = np.maximum.accumulate(np.where((x[0] > on) | (begins > 0) & (n == 0), n, -1))
    return opened > np.maximum.accumulate(np.where(x[0] > off, -1, n)), 0.0


@law("Velocity", since=lambda b, fs, x: 1.3 * FADED * fs / (2 * math.pi * b.cutoff) + 1)
def _velocity(b, fs, x, y):
    # of digits, by two poles so near to 1
    lost = 2.0**-50 / math.expm1(-2 * math.pi * b.cutoff / fs) ** 2
    return near(
        laws.squeeze_finger(x[0], 0 * x[0], x[1], fs, 0.0, 0.0, b.cutoff, 1.0, 0.0).v, 1e-11 + lost
    )


@response("FirstOrder")
def _first_order(b, fs):
    a = 1 / (LONG(b.tau) * LONG(fs))
    return Modes(*straight([-a], a))


PEAK, STATIC, TAU = 100.0, 37.0, 10.0
"""What the motors of the UGrip paper bear, in N (section 2.1), and the time over which
a static force counts, in s.
"""


@law_of("squeeze")
def _squeeze(a: Asked) -> list[Check]:
    """Check the squeeze law F = k x + A (k tau v)(tau dp/dt) g for each finger.

    The law is computed from motion, numbers and seed.  Other impedances are rendered
    alone; their blocks have laws of their own.
    """
    from ...blocks import differentiator, pink_noise
    from ...blocks.actuator import PLACEHOLDER_GAMMA

    n = range(1, a.given["fingers"] + 1)
    outputs = [f"force{i}" for i in n] + [
        f"current{i}" for i in n if a.given["motor_constant"] is not None
    ]
    if set(outputs) != set(a.y):
        raise SceneError(
            f"it has the outputs {', '.join(a.y)}, and {', '.join(outputs)} were asked for"
        )
    checks, g, A = [], a.given, a.live("A") * a.live("level")
    # not in scenes that were kept before 0.2, or nowhere needed
    Z_c, Z_n, travel = (g.get(name) for name in ("Z_c", "Z_n", "travel"))
    k = np.zeros(a.n) if Z_c and Z_n else a.live("k")
    contact = a.contact if g["contact"] else np.broadcast_to(1.0, a.n)
    on, off = laws.gate_thresholds(g["resolution"], g["cutoff"], a.fs)
    for i in n:
        name, x = f"force{i}", a.x[f"x{i}"]
        its = a.kept.setdefault(name, {})
        still = laws.squeeze_finger(
            x, np.zeros(a.n), contact, a.fs, k, A, g["cutoff"], on, off, its
        )
        if Z_c:
            still = still._replace(mean=_alone(a, Z_c, f"Z_c of {name}", x=x) * (contact > 0))
        runs, noise = still.gate & (A != 0), np.zeros(a.n)
        pink = pink_noise(1 / math.pi, g["seed"], stream=i, f_low=g["f_low"], tol_db=g["tol_db"])
        source = differentiator(pink, passband=g["passband"], stopband=g["passband"] + 500.0)
        noise[runs] = a.render(source, int(runs.sum()), f"noise of {name}")  # on a clock of its own
        printed = k * x if g.get("as_printed") else k / 8000 * still.v
        rate_is = "Z_n(v)" if Z_n else "k x" if g.get("as_printed") else "k tau v"
        rate = _alone(a, Z_n, f"Z_n of {name}", v=still.v) if Z_n else printed
        finger = laws.vibrating(still, noise, rate, A)
        del still  # whose force takes memory
        if a.part.span is None and not a.part.terms:
            a.e.fingers[a.output(name)] = finger
        want = _held(finger.force, a.y[name], a.fs, its) if g["limits"] else finger.force
        acted = bool((want != finger.force).any())
        slack = 2.0**-50 * TAU * a.fs * acted + a.slack  # a mean over tau, by two recursions
        a.say(
            f"{a.title(name)}: velocity through {g['cutoff']:g} Hz, gate opens at {on:.4g} and"
            f" closes at {off:.4g}"
            f" m/s{f', held to {PEAK:g} N peak and {STATIC:g} N static' if g['limits'] else ''}"
        )
        if travel and x.size and (reach := np.ptp(x)) > travel:
            a.say(f"x{i} moves by {reach:.4g} m, beyond the travel of {travel:g} m")
        scale = max(np.abs(finger.force).max(), 1e-300)
        quiet = a.far(np.where(runs, 0, a.y[name] - want)) / scale
        limit = 1e-14 + slack
        checks.append(
            Check(
                "d",
                f"{a.title(name)}: mean part is {'the force of Z_c' if Z_c else 'k x'}",
                quiet,
                limit,
                "where the gate is closed, relative",
            )
        )
        vibration = np.abs(finger.force - finger.mean).max()
        limit = 1e-9 + (4e-16 + slack) * scale / vibration if vibration > 0 else 1e-14 + slack
        error = a.far(a.y[name] - want) / (vibration or scale)
        if a.part.terms:
            a.expect(name, want, float(limit) * (vibration or scale))
        checks.append(
            Check(
                "d",
                f"{a.title(name)}: vibration law",
                error,
                float(limit),
                f"A {rate_is} tau dp/dt, relative",
            )
        )
        if g["motor_constant"] is not None:
            at, table = map(np.asarray, g.get("geometry") or PLACEHOLDER_GAMMA)
            if x.size and (x.min() < at[0] or x.max() > at[-1]):
                a.say(
                    f"x{i} is from {x.min():.4g} to {x.max():.4g} m, and Gamma is known from"
                    f" {at[0]:g} to {at[-1]:g} m: it is held beyond"
                )
            gamma = scipy.interpolate.PchipInterpolator(at, table)(np.clip(x, at[0], at[-1]))
            checks.append(
                a.near(
                    f"current{i}",
                    want / (g["motor_constant"] * gamma),
                    1e-8,
                    "I = F/(n B Gamma)",
                    1e-12,
                )
            )
        if acted:
            a.e.skipped.append(
                f"{a.title(name)}: it was limited, so the force over position has no one slope"
            )
        elif Z_c or np.ptp(k) > 0 or not (contact > 0).all():
            why = "the fingers were lifted" if np.ptp(k) == 0 else "k was changed"
            a.e.skipped.append(
                f"{a.title(name)}: {'Z_c is no spring' if Z_c else why}, so the force over"
                " position has no one slope"
            )
        elif a.part.span is None and not a.part.terms and not a.e.at:
            model = noise_model(source, a.fs)
            rate *= A
            rate /= 8000
            checks += _slope(
                a,
                name,
                x,
                float(k[0]),
                rate,
                noise,
                runs,
                model and model[0],
            )
    return checks


def _alone(a: Asked, data: Any, name: str, **signals: np.ndarray) -> np.ndarray:
    """Return the force of an impedance that is rendered alone, on the given signals."""
    scene, first = Scene.from_dict(data), a.e.at + a.at.start
    names = {a.part.inputs.get(n, n): n for n in scene.params}
    if (proc := a.kept.get(name)) is None:
        proc = a.kept[name] = compile(scene, a.fs, seed=a.seed)
        for own in scene.params:
            proc.set(own, float(a.live(own)[0]), ramp=0.0)
    changes = [c._replace(name=names[c.name]) for c in a.e.changes if c.name in names]
    x = np.array([(a.x | signals)[n] for n in proc.inputs]).reshape(len(proc.inputs), a.n)
    return samples(
        proc,
        lambda at, stop: np.ascontiguousarray(x[:, at - first : stop - first]),
        first + a.n,
        changes,
        first,
    )[0]


def _held(
    force: np.ndarray, y: np.ndarray, fs: float, kept: dict[str, Any] | None = None
) -> np.ndarray:
    """Return a force after the motors' peak and static limits.

    The gain of the static limit follows from the output's own past.
    """
    force, kept = np.clip(force, -PEAK, PEAK), {} if kept is None else kept
    r, most = -np.expm1(-1 / (TAU * fs)), STATIC**2
    square = np.where(np.isnan(y), force, y) ** 2
    before = kept.get("mean", np.zeros(1))
    mean, kept["mean"] = all_pole(r, [r - 1], square, before)
    return np.minimum(1.0, (most - np.r_[before, mean][:-1]) / (0.19 * most)) * force


def _slope(
    a: Asked,
    name: str,
    x: np.ndarray,
    k: float,
    gain: np.ndarray,
    noise: np.ndarray,
    gate: np.ndarray,
    model: Any,
) -> list[Check]:
    """Return the check of the stiffness recovered from delivered force over position.

    It uses only samples at which the force cannot have been clipped.

    The noise adds to the slope a weighted sum of a process whose spectrum is known, so
    the standard deviation of the slope is known too.
    """
    e, i = a.e, list(a.e.scene.outputs).index(a.output(name))
    y, whole, step = e.shown[i], np.ones(x.size, bool), np.abs(e.y[i])
    step *= 2.0**-52
    if e.sidecar is not None:
        top = e.sidecar["channels"][i]["full_scale"]
        if e.sidecar["subtype"] == "FLOAT":
            step *= 2.0**29
        elif bits := BITS.get(e.sidecar["subtype"]):
            last = 2.0 ** (1 - bits)
            whole = np.abs(k * x) + np.abs(gain * noise).max(initial=0.0) < (1 - 2 * last) * top
            step = np.full(x.size, last * top)
    u = (x - x[whole].mean() if whole.any() else x) * whole
    # of a held hand the first mean is a rounding away
    u = (u - u[whole].mean() if whole.any() else u) * whole
    power = float(u @ u)
    lost = float(np.abs(u) @ step) / power if power > 0 else np.inf
    if lost > 1e-3 * abs(k):
        e.skipped.append(f"{a.title(name)}: the position hardly changes, so no slope can be fitted")
        return []
    slope = float(u @ (y - y[whole].mean())) / power
    weights = (u * gain)[gate]
    n = 1 << max(12, weights.size.bit_length())
    f = np.fft.rfftfreq(n, 1 / e.fs)
    density = model(np.maximum(f, f[1] / 2)) * np.abs(np.fft.rfft(weights, n)) ** 2
    deviation = float(np.sqrt(e.fs / n * density.sum())) / power
    sigmas = -float(scipy.special.ndtri(e.share / 2))
    text = f"{slope:.7g} N/m, {sigmas:.2g} standard deviations of what the noise adds"
    limit = sigmas * deviation + lost + 1e-12 * abs(k)
    return [
        Check(
            "d",
            f"{a.title(name)}: slope of force over position",
            abs(slope - k),
            limit,
            text,
            deviation,
        )
    ]
