"""The physical laws of whole scenes, each held against what was rendered: ``SCENES`` by the name that a scene carries."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from ..analysis import spectra
from ..core.graph import Block, Const, Div, Mul, Param, as_block, reach
from ..errors import SceneError
from ..run.processor import compile
from ..run.walk import samples
from . import laws, soft, surfaces, touch
from .evidence import Check, Evidence, Tap, live, signal
from .plates import touch_screen

TEXTURE = 1e-7  # relative: at speed 0 and force 0 the variance is a rounding, of which the square root is taken


def scene_law(e: Evidence) -> list[Check]:
    if e.scene.law is None:
        e.skipped.append("no physical law of the whole scene is known")
        return []
    law = SCENES.get(e.scene.law)
    if law is None:
        e.skipped.append(f"the law {e.scene.law!r} is not known to this version")
        return []
    try:
        return law(e)
    except (KeyError, StopIteration, SceneError) as error:
        return [
            Check("d", "shape of the scene", 1, 0, f"not what the law {e.scene.law!r} is for ({error or type(error).__name__})")
        ]


def _squeeze(e: Evidence) -> list[Check]:
    """F = k x + A (k tau v)(tau dp/dt) g per finger, everything but the noise computed from scratch."""
    from ..blocks.gate import Loading

    checks = []
    rows = {n: e.x[k] for k, n in enumerate(e.proc.inputs)}
    contact = rows.get("contact", np.ones(e.x.shape[1]))
    k, A = live(e, "k"), live(e, "A") * live(e, "level")
    quiet = compile(e.scene, e.fs, seed=e.seed)
    for name, value in (e.params | {"A": 0.0}).items():
        quiet.set(name, value, ramp=0.0)
    mean = samples(quiet, e.x, e.x.shape[1], [c for c in e.changes if c.name != "A"])
    for i, (name, root) in enumerate(e.scene.outputs.items()):
        if not name.startswith("force"):
            e.skipped.append(f"{name}: no law of it is known")
            continue
        tap = next((t for t in e.taps if t.output == name), None)
        if tap is None or tap.model is None:
            raise SceneError(f"{name}: a squeeze scene without gated noise")
        x = rows[name.replace("force", "x")]
        gate = next(b for b in reach([root]) if isinstance(b, Loading))
        cutoff = gate.v.cutoff  # type: ignore[attr-defined]
        on, off = gate.on, gate.off
        if on is None or off is None:
            on, off = laws.gate_thresholds(gate.resolution, cutoff, e.fs)
        finger = laws.squeeze_finger(x, tap.gated, contact, e.fs, k, A, cutoff, on, off)
        e.fingers[name] = finger
        want, quiet_want = held(root, finger.force, e.y[i], e), held(root, finger.mean, mean[i], e)
        acted = bool((want != finger.force).any())
        slack = 2.0**-50 * getattr(root, "tau", 0.0) * e.fs * acted  # a mean over tau, by two recursions
        limits = f", held to {' and '.join(_limits(root))}" if _limits(root) else ""
        e.numbers.append(f"{name}: velocity through {cutoff:g} Hz, gate opens at {on:.4g} and closes at {off:.4g} m/s{limits}")
        scale = max(np.abs(finger.force).max(), 1e-300)
        steps = max((c.ramp * e.fs for c in e.changes if c.name == "k"), default=0.0)  # of a ramp: each is rounded
        apart = float(np.abs(mean[i] - quiet_want).max() / scale)
        checks.append(Check("d", f"{name}: mean part is k x", apart, 1e-14 + 2.0**-52 * steps + slack, "A = 0, relative"))
        noise = np.abs(finger.force - finger.mean).max()
        error = np.abs(e.y[i] - want).max()
        limit = 1e-9 + (4e-16 + slack) * scale / noise if noise > 0 else 1e-14 + slack
        checks.append(
            Check("d", f"{name}: vibration law", float(error / (noise or scale)), float(limit), "A k tau v tau dp/dt, relative")
        )
        wrong = int(np.sum((finger.gate != tap.gate) & (A != 0)))
        checks.append(Check("e", f"{name}: gate timing", wrong, 0, "samples where the gate differs"))
        if acted:
            e.skipped.append(f"{name}: it was limited, so the force over position has no one slope")
        elif np.ptp(k) > 0:
            e.skipped.append(f"{name}: k was changed, so the force over position has no one slope")
        else:
            checks += _slope(name, x, e, i, float(k[0]), A * float(k[0]) * finger.v / 8000**2, tap)
    return checks


def held(root: Block, want: np.ndarray, y: np.ndarray, e: Evidence) -> np.ndarray:
    """What the limits on an output make of a law; the gain of the static one follows from the output's own past."""
    from scipy.signal import lfilter

    from ..blocks.actuator import ForceLimit, StaticLimit

    if isinstance(root, StaticLimit):
        a, most = -np.expm1(-1 / (root.tau * e.fs)), root.limit**2
        mean = np.r_[0.0, lfilter([a], [1, a - 1], y**2)[:-1]]
        return np.minimum(1.0, (most - mean) / (0.19 * most)) * held(root.x, want, y, e)
    if isinstance(root, ForceLimit) and isinstance(root.peak, Const):
        return np.clip(held(root.x, want, y, e), -root.peak.value, root.peak.value)
    return want


def _limits(root: Block) -> list[str]:
    from ..blocks.actuator import ForceLimit, StaticLimit

    if isinstance(root, StaticLimit):
        return [*_limits(root.x), f"{root.limit:g} N static"]
    return [f"{root.peak.value:g} N peak"] if isinstance(root, ForceLimit) and isinstance(root.peak, Const) else []


def _slope(name: str, x: np.ndarray, e: Evidence, i: int, k: float, gain: np.ndarray, tap: Tap) -> list[Check]:
    """Stiffness recovered from delivered force over position, where it cannot have been clipped.

    What the noise adds to the slope is a weighted sum of a process whose spectrum is known, so its deviation is too.
    """
    from scipy import stats

    y, whole, step = e.shown[i], np.ones(x.size, bool), 2.0**-52 * np.abs(e.y[i])
    if e.sidecar is not None:
        top = e.sidecar["channels"][i]["full_scale"]
        if e.sidecar["subtype"] == "FLOAT":
            step = 2.0**-23 * np.abs(e.y[i])
        elif e.sidecar["subtype"] == "PCM_24":
            whole = np.abs(k * x) + np.abs(gain * tap.gated).max(initial=0.0) < (1 - 2.0**-22) * top
            step = np.full(x.size, 2.0**-23 * top)
    u = (x - x[whole].mean() if whole.any() else x) * whole
    u = (u - u[whole].mean() if whole.any() else u) * whole  # of a held hand the first mean is a rounding away
    power = float(u @ u)
    lost = float(np.abs(u) @ step) / power if power > 0 else np.inf
    if lost > 1e-3 * abs(k):
        e.skipped.append(f"{name}: the position hardly changes, so no slope can be fitted")
        return []
    slope = float(u @ (y - y[whole].mean())) / power
    weights = (u * gain)[tap.gate]
    n = 1 << max(12, weights.size.bit_length())
    f = np.fft.rfftfreq(n, 1 / e.fs)
    assert tap.model is not None
    density = tap.model(np.maximum(f, f[1] / 2)) * np.abs(np.fft.rfft(weights, n)) ** 2
    deviation = float(np.sqrt(e.fs / n * density.sum())) / power
    sigmas = float(stats.norm.isf(e.share / 2))
    text = f"{slope:.7g} N/m, {sigmas:.2g} standard deviations of what the noise adds"
    limit = sigmas * deviation + lost + 1e-12 * abs(k)
    return [Check("d", f"{name}: slope of force over position", abs(slope - k), limit, text, deviation)]


def _viscoelastic(e: Evidence) -> list[Check]:
    """The springpot's force at some samples against the full sum over the history, in extended precision."""
    from ..blocks.fractional import Springpot, SpringpotLive
    from ..blocks.thesis import Downsampled, ShortMemory

    kinds = (Springpot, SpringpotLive, Downsampled, ShortMemory)
    spring = next(b for b in reach(e.scene.outputs.values()) if isinstance(b, kinds))
    if not isinstance(spring, (Springpot, SpringpotLive)):
        e.skipped.append("force: only the full sum's own schemes, gl and l1, have a law")
        return []
    rows = {n: e.x[k] for k, n in enumerate(e.proc.inputs)}
    y, n = rows["y"], e.x.shape[1]
    touching = rows.get("contact", np.ones(n)) > 0
    alpha = signal(e, as_block(spring.order) if isinstance(spring, Springpot) else spring.alpha)
    chi = _gain(e.scene.outputs["force"], spring)
    gain = live(e, "firmness") * chi
    at_1_hz = chi * (2 * np.pi) ** alpha[0]
    e.numbers.append(f"chi = {chi:.6g}, alpha = {alpha[0]:.6g}: as strong at 1 Hz as {at_1_hz:.4g} N/m, for firmness 1")
    starts = np.flatnonzero(touching & ~np.r_[False, touching[:-1]])
    stops = np.flatnonzero(touching & ~np.r_[touching[1:], False]) + 1
    worst = 0.0
    for a, b in zip(starts, stops, strict=True):
        at = np.unique(np.linspace(0, b - a - 1, max(2, round(64 * (b - a) / n))).astype(int))
        force, size = laws.springpot_sum(y[a:b], e.fs, spring.scheme, alpha[a:b], at)
        g = gain[a:b][at]
        bound = np.abs(g) * (spring.tol + 64 * 2.0**-53) * np.maximum(size, 1e-300) + 1e-15 * np.abs(g) * np.abs(force)
        worst = max(worst, float(np.max(np.abs(e.y[0, a:b][at] - g * force) / np.maximum(bound, 1e-300))))
    if np.ptp(alpha) == 0:

        def everywhere() -> tuple[np.ndarray, float]:
            want, bounds = np.zeros(n), [0.0]
            for a, b in zip(starts, stops, strict=True):
                want[a:b], size = laws.springpot_convolution(y[a:b], e.fs, spring.scheme, float(alpha[0]))
                bounds.append(float(np.max(np.abs(gain[a:b]) * (spring.tol + 1e-13) * size.max())))
            return gain * want, max(bounds)

        e.wanted["force"] = everywhere
    text = f"tol = {spring.tol:g}, alpha = {alpha.min():g} .. {alpha.max():g}, {spring.scheme}: error over its certificate"
    lost = float(np.abs(e.y[0, ~touching]).max(initial=0.0))
    return [
        Check("d", "force: full sum over the history", worst, 1.0, text),
        Check("e", "force: none off contact", lost, 0.0, "N"),
    ]


def _gain(root: Block, spring: Block) -> float:
    """Product of the plain numbers on the way to the springpot."""
    inner = {id(b) for b in reach([spring])}
    return float(np.prod([b.value for b in reach([root]) if isinstance(b, Const) and id(b) not in inner]))


def _factor_of(name: str, blocks: list[Block]) -> float:
    """The plain number that a parameter is multiplied with."""
    for b in blocks:
        if isinstance(b, Mul) and isinstance(b.a, Const) and isinstance(b.b, Param) and b.b.name == name:
            return b.a.value
    raise SceneError(f"no plain number is multiplied with the parameter {name!r}")


def _bumps(e: Evidence) -> list[Check]:
    """V = gain A e(x/wavelength) c(t), envelope and carrier written again; at constant speed also the spectral model.

    Equalised, it is that times d_max/d between the last two places; limited, it is scaled, or clipped, or both.
    """
    from ..analysis import am
    from ..blocks.bump import Bump
    from ..blocks.carrier import Carrier
    from ..blocks.maps import Maximum, Minimum
    from ..blocks.table import Lut, Polynomial

    blocks = reach(e.scene.outputs.values())
    envelope: Any = next(b for b in blocks if isinstance(b, Bump))
    if not hasattr(envelope, "waveform"):
        e.skipped.append("voltage: the law knows the named waveforms, not tables")
        return []
    carrier = next(b for b in blocks if isinstance(b, Carrier))
    constants = [b.value for b in reach([envelope.children[0]]) if isinstance(b, Const)]
    per_metre = constants[0]
    gain = _factor_of("A", blocks)
    if carrier.rectify != "half" or carrier.phase or envelope.sampling != "area":
        e.skipped.append("voltage: the law covers area-sampled waves on a half-wave carrier that starts at phase 0")
        return []
    rows = {n: e.x[k] for k, n in enumerate(e.proc.inputs)}
    n = e.x.shape[1]
    A, duty, freq = (live(e, name) for name in ("A", "duty", "freq"))
    contact = rows.get("contact", np.ones(n)) * (A != 0)
    u = rows["x"] * per_metre
    shape = laws.bump_envelope(u, contact, envelope.waveform, duty)
    wave = laws.carrier_half(freq, e.fs)
    e.curves |= {"envelope": shape, "carrier": wave}
    edges = np.flatnonzero(np.diff(np.floor(u))) + 1
    whole_bumps = ((a, b) for a, b in pairwise(edges) if np.ptp(u[a:b]) > 0.9)
    e.closeup = slice(*next(whole_bumps, (0, n)))
    want, highest = gain * A * shape * wave, gain * np.abs(A)
    e.numbers.append(f"amplifier {gain:g}, wavelength {1000 / per_metre:.4g} mm, {envelope.waveform}")
    table: Any = next((b for b in blocks if isinstance(b, (Lut, Polynomial))), None)
    if table is not None:
        kind = getattr(table, "kind", "polynomial")
        factor, most = laws.profile_gain(rows["x"], contact, table.knots, table.values, kind)
        want, highest = want * factor, highest * most
        e.numbers.append(f"equalised by {len(table.knots)} measured places ({kind}), at most {most:.4g} times")
    root = e.scene.outputs["voltage"]
    if isinstance(root, Minimum) and isinstance(root.b, Const):
        limit = root.b.value
        if any(isinstance(b, Div) and isinstance(b.b, Maximum) for b in blocks):
            want = want * (limit / np.maximum(limit, highest))
        e.numbers.append(f"limited to {limit:g} V, {int(np.sum(np.abs(want) >= limit))} samples held there")
        want = np.clip(want, -limit, limit)
    top = float(highest.max()) or 1.0
    e.wanted["voltage"] = lambda: (want, 1e-6 * top)
    error = float(np.abs(e.y[0] - want).max() / top)
    checks = [Check("d", "voltage: envelope times carrier", error, 1e-6, "of the peak voltage, written again")]
    checks.append(Check("e", "voltage: none off contact", float(np.abs(e.y[0, contact <= 0]).max(initial=0.0)), 0.0, "V"))
    speed, steady = np.diff(u) * e.fs, np.ptp(A) == np.ptp(duty) == np.ptp(freq) == 0 and isinstance(root, Mul) and table is None
    if steady and n > 2 and speed[0] and np.ptp(speed) < 1e-6 * abs(speed[0]) and contact.all() and abs(u[-1] - u[0]) >= 1:
        whole = int(abs(u[-1] - u[0]))
        y = e.y[0, 1 : 1 + round(whole / abs(speed[0]) * e.fs)] / top
        model = am.sampled_rms(envelope.waveform, duty[0], 1.0, abs(speed[0]), freq[0], e.fs)
        limit = 0.005 + am.meeting(envelope.waveform, duty[0], abs(speed[0]), freq[0], e.fs, whole / abs(speed[0]))
        if limit > 0.2:
            e.skipped.append("voltage: rms of the line spectrum: bumps and carrier meet, so it depends on their phases")
        else:
            text = f"{whole} bumps at {abs(speed[0]):.3g}/s; lines that meet may add the rest"
            rms = float(np.sqrt(np.mean(y**2)))
            checks.append(Check("d", "voltage: rms of the line spectrum", abs(rms / model - 1), limit, text))
    return checks


def _texture(e: Evidence) -> list[Check]:
    """The acceleration of a measured texture, written again; where speed and force stand still, also its spectrum."""
    from ..blocks.noise import White
    from ..blocks.texture import Texture

    block: Any = next(b for b in reach(e.scene.outputs.values()) if isinstance(b, Texture))
    model, white, n = block.model, block.white, e.x.shape[1]
    if not isinstance(white, White) or block.autonomous:
        e.skipped.append("acceleration: the law covers a moving tool, and the library's noise")
        return []
    every = round(e.fs / model.rate)
    speed, force = signal(e, block.speed), signal(e, block.force)
    want = live(e, "level") * laws.texture(model, speed, force, laws.white(e.seed, *white.noise_key, 0, n), every)
    top = float(np.abs(want).max()) or 1.0
    e.wanted["acceleration"] = lambda: (want, TEXTURE * top)
    e.numbers.append(f"{len(model.speed)} models of order {model.lsf.shape[1]}, {model.ma.shape[1]}, at {model.rate:g} Hz")
    error = float(np.abs(e.y[0] - want).max() / top)
    checks = [Check("d", "acceleration: the models' recursion", error, TEXTURE, "triangles, polynomials, sinc, written again")]
    steady = slice(n // 4 // every * every, None, every)
    v, N = abs(speed[steady]), force[steady]
    if np.ptp(v) > 1e-3 * v.mean() or np.ptp(N) > 1e-3 * N.mean() or np.ptp(live(e, "level")) or not want[steady].any():
        e.skipped.append("acceleration: speed and force move, so it has no one spectrum")
        return checks
    gain = live(e, "level")[0]

    def psd(f):
        return gain**2 * model.psd(f, v.mean(), N.mean())

    s = spectra.test_spectrum(e.y[0, steady], model.rate, psd, 5.0, 0.49 * model.rate)
    if s is not None:
        text = f"{s.level_db:+.3f} dB over {N.size / model.rate:.3g} s"
        checks.append(
            Check("c", f"acceleration: spectrum, {len(s.bands)} bands", -np.log10(max(s.p, 1e-300)), -np.log10(e.share), text)
        )
    return checks


WORDS = {
    "squeeze": "F = k x + A level (k tau v)(tau dp/dt) while the object is being loaded, else F = k x; x is the position, v its "
    "velocity, p pink noise, tau = 1/8000 s (the UGrip paper, eq. (2) and section 2.1)",
    "viscoelastic": "F = firmness chi D^alpha y, D^alpha being the fractional derivative of the position y as the full sum over "
    "its history (Çaldıran's thesis, eqs. (3.1), (3.2) and (4.1))",
    "bumps": "V = gain A e(x/wavelength) c(t); e is the mean of a wave of bumps over each movement, of which the part duty is "
    "ridge, c the positive half waves of a carrier of freq (the touch-screen thesis, eqs. (16) and (17), section 4.2)",
    "texture": "a(t) = level times what the models' recursion (AR and MA, of the three models around speed and force) makes of "
    "white noise, brought to the rate by a windowed sinc (Culbertson, Unwin and Kuchenbecker 2014)",
    "grating": "F = depth sin(2 pi x/coarse) + fine_depth sin(2 pi x/fine) + roughness n(x), each a mean over the movement of a "
    "sample; n is noise over place with a spectrum of 1/f^slope (after Wiertlewski, Lozada and Hayward 2011)",
    "click": "F = peak (x/at - drop q) + stiffness max(0, x - travel) + A exp(-t/decay) sin(2 pi freq t), each a mean over the "
    "movement of a sample; q is 1 from x >= at until x < back, t the time since q rose (our own)",
    "detents": "T = depth sin(count angle) + Coulomb's friction of a spring, each a mean over the movement of a sample (our own)",
    "friction": "F is that of a spring that a finger drags: it slips at static normal and sticks again at kinetic normal, a mean "
    "over the movement of a sample (our own)",
    "wall": "F = max(0, k p + b v), a mean over the movement of a sample, p = x - at > 0 the depth, v its velocity (Colgate and "
    "Schenkel 1997)",
    "impact": "F = max(0, k x + b v) + A u exp(-t/decay) sin(2 pi freq t) from each impact on, u its velocity (after "
    "Okamura, Dennerlein and Howe 1998)",
    "soft_surface": "an avatar follows the pointer at the speed (1.1 - S)/(1.1 (1 + S)), or waits 0.5 s for each newton the "
    "tangential force rises; it goes f/(0.4 + 0.8 S) mm deep, f = 0.1008 exp(4.2081 pressure) N; S is the level of the map there "
    "(the pseudo-haptics paper, eqs. (1) to (3), and readings of our own)",
    "touch_screen": "V = amplifier(pole swap(A e(x/wavelength) c(t) d_max/d(x))), d being the displacement fitted over places; "
    "the displacement is the sum over the plate's modes of shape(x, y) times the mode's answer to V (the touch-screen thesis, "
    "chapters 2 to 4)",
}
"""Each law for a reader who has the paper beside it."""
SCENES: dict[str, Callable[[Evidence], list[Check]]] = {
    "squeeze": _squeeze,
    "viscoelastic": _viscoelastic,
    "bumps": _bumps,
    "grating": surfaces.grating,
    "texture": _texture,
    "click": touch.click_law,
    "detents": touch.detents_law,
    "friction": touch.friction_law,
    "wall": touch.wall_law,
    "impact": touch.impact_law,
    "soft_surface": soft.soft_surface,
    "touch_screen": touch_screen,
}


def motor_limits(e: Evidence) -> list[Check]:
    """Peak and running mean square of outputs that a force limit stands on, computed again from the samples."""
    from scipy.signal import lfilter

    from ..blocks.actuator import ForceLimit, StaticLimit

    checks = []
    for y, (name, b) in zip(e.y, e.scene.outputs.items(), strict=True):
        if isinstance(b, StaticLimit):
            a = -np.expm1(-1 / (b.tau * e.fs))
            mean = float(lfilter([a], [1, a - 1], y**2).max(initial=0.0))
            checks.append(Check("e", f"{name}: static limit", mean, b.limit**2 * (1 + 1e-12), "largest running mean square, N^2"))
            b = b.x
        if isinstance(b, ForceLimit) and isinstance(b.peak, Const):
            checks.append(Check("e", f"{name}: peak limit", float(np.abs(y).max(initial=0.0)), b.peak.value, "N"))
    return checks
