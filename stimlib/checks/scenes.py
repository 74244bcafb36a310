"""The physical laws of whole scenes.

Each is computed from the motion, the live parameters and what the scene was asked for.

``SCENES`` has them by the name that a scene carries.  None of them looks into the graph
under test: a number that a scene's function got wrong is then seen.  Where a law needs
a noise, or a wait that a rounding decides, it makes the block of its own.
"""

from __future__ import annotations

import copy
import dataclasses as dc
import math
from itertools import pairwise
from numbers import Real
from typing import Any

import numpy as np

from ..analysis import spectra
from ..core.graph import Const, Input
from ..core.parts import OWN, Part, known
from ..errors import BadValue, SceneError
from . import families as families  # it enters laws of scenes into ``SCENES``
from . import laws
from .evidence import SCENES, Asked, Check, Evidence, SceneLaw, asked, law_of, noise_model

# relative: at speed 0 and force 0 the variance is a rounding, of which the square root
# is taken
TEXTURE = 1e-7
OWN_TOL = 1e-9  # of the largest value, where a law of a user's own states none
ONWARD = {"squeeze": 0, "bumps": 1, "grating": 1, "wall": 1}
"""Laws that go on from one stretch of a long recording to the next, and how many
samples before it they must see.
"""
STARTS = {"bumps": {"A": "amplitude"}, "touch_screen": {"A": "amplitude"}}
"""Arguments that set a parameter of another name."""


def scene_law(e: Evidence) -> list[Check]:
    """Return the checks of all laws that the scene's parts have."""
    if not e.scene.parts:
        e.skipped.append("no law of the whole scene is known")
    laws_of = {
        part.law: SCENES.get(part.law, own_law if known(part.law) else None)
        for part in e.scene.parts
    }
    e.unknown[:] = [name for name, law in laws_of.items() if law is None]
    known_laws: list[tuple[Part, SceneLaw, dict[str, Any], list[Check]]] = []
    for part in e.scene.parts:
        law, called = laws_of[part.law], f"{part.name}: the law" if part.name else "the law"
        if law is None:
            where = (
                "import its module first (--import FILE.py)"
                if "." in part.law
                else "no shipped scene has it; update stimlib"
            )
            e.skipped.append(f"{called} {part.law!r} is not known here: {where}")
        elif part.given is None:
            e.skipped.append(
                f"{called} {part.law!r} needs what the scene was asked for, which was not kept"
                " before stimlib 0.2"
            )
        else:
            known_laws.append((part, law, {}, []))
            if e.end < e.frames and part.span is None and part.law not in ONWARD:
                e.skipped.append(
                    f"{called}: held against the first {e.end / e.fs:.6g} s only, as it needs all"
                    " samples at once"
                )
    last = e
    for s in e.stretches() if known_laws else ():
        for part, law, kept, found in known_laws:
            if _begins(part, s) or (s.at and part.span is None and part.law in ONWARD):
                lines = len(s.numbers), len(s.skipped)
                _worst(found, _checks_of(_led(s, last, part), part, law, kept))
                if part.span and s.end < min(
                    e.frames, round((part.span.start + part.span.duration) * e.fs)
                ):
                    s.skipped.append(
                        f"{part.name or part.law}: of its interval only what is before"
                        f" {s.end / e.fs:.6g} s is held"
                    )
                if s.at and part.span:
                    e.numbers += s.numbers[lines[0] :]
                    e.skipped += s.skipped[lines[1] :]
        last = s
    return [c for *_, found in known_laws for c in found]


def _begins(part: Part, e: Evidence) -> bool:
    """Return whether a part begins in this stretch."""
    first = min(round(part.span.start * e.fs), e.frames) if part.span else 0
    return e.at <= first < e.end or first == e.frames == e.end


def _led(e: Evidence, last: Evidence, part: Part) -> Evidence:
    """Return a stretch with the sample before it, where a law needs that."""
    if not e.at or part.span or not ONWARD[part.law]:
        return e
    rows: dict[str, Any] = {
        n: np.hstack([getattr(last, n)[:, -1:], getattr(e, n)]) for n in ("x", "y", "shown")
    }
    return dc.replace(e, at=e.at - 1, led=1, **rows)


def _worst(found: list[Check], new: list[Check]) -> None:
    """Keep of each check the stretch in which it was nearest to its limit.

    Or it was farthest beyond.
    """
    if not found:
        found += new
        return
    for c in new:
        at = next((k for k, f in enumerate(found) if (f.group, f.name) == (c.group, c.name)), None)
        if at is None:
            found.append(c)
        elif _over(c) > _over(found[at]):
            found[at] = c


def _over(c: Check) -> float:
    """Return what was measured, over its limit."""
    return (
        c.measured / c.limit
        if c.limit and np.isfinite(c.measured)
        else 0.0
        if c.passed
        else math.inf
    )


def _checks_of(e: Evidence, part: Any, law: SceneLaw, kept: dict[str, Any]) -> list[Check]:
    try:
        a = asked(e, part, kept)
        if not a.n:
            e.skipped.append(f"{part.name or part.law}: none of its interval was displayed")
            return []
        known = dict.fromkeys(part.inputs or e.scene.params)
        named = {n: STARTS.get(part.law, {}).get(n, n) for n in known}
        begins = {
            n: a.given[key]
            for n, key in named.items()
            if key in a.given and part.inputs.get(n, n) in e.scene.params
        }
        return [*([a.begins(begins)] if begins else []), *law(a)]
    # whatever a user's law raises, and what a file may say that nobody was asked for
    except Exception as error:
        if part.law in OWN:
            raises = "" if isinstance(error, BadValue) else f" raises {type(error).__name__}"
            raise BadValue(f"the law {part.law}{raises}: {error}") from error
        why = f"not what the law {part.law!r} is for ({error or type(error).__name__})"
        return [
            Check(
                "d",
                f"{part.name}: shape of the scene" if part.name else "shape of the scene",
                1,
                0,
                why,
            )
        ]


def own_law(a: Asked) -> list[Check]:
    """Check a user's own law.

    A function of inputs, parameters and sample rate says what the outputs are.
    """
    p = {
        own: a.live(own)
        for own in a.part.inputs or a.e.params
        if a.part.inputs.get(own, own) in a.e.params
    }
    x = {own: row.view() for own, row in a.x.items()}
    for row in x.values():
        row.flags.writeable = False  # the law of another output, and the figures, have the same row
    wanted = OWN[a.part.law][0](
        x, p, a.fs, **copy.deepcopy({n: v for n, v in a.given.items() if n not in p})
    )
    if (
        not isinstance(wanted, dict)
        or not wanted
        or (unknown := [name for name in wanted if name not in a.y])
    ):
        got = (
            f"the outputs {', '.join(unknown)}"
            if isinstance(wanted, dict) and wanted
            else repr(wanted)[:80]
        )
        raise BadValue(
            f"it returned {got}; return a row for each output that it is about, of {', '.join(a.y)}"
        )
    checks = []
    for name, made in wanted.items():
        if isinstance(made, tuple) and len(made) != 2:
            raise BadValue(
                f"{name} is a tuple of {len(made)}; return a row, or a row and its tolerance"
            )
        values, stated = made if isinstance(made, tuple) else (made, None)
        if np.iscomplexobj(values):
            raise BadValue(f"{name} has complex values; return real ones")
        row = np.asarray(values, float)
        if row.shape != a.y[name].shape:
            raise BadValue(f"{name} has the shape {row.shape}; return {a.n} samples")
        if not np.isfinite(row).all():
            raise BadValue(
                f"{name} has values that are not finite, which hold nothing; return finite ones"
            )
        top = float(np.abs(row).max(initial=0.0)) or 1e-300
        limit: Any = OWN_TOL * top if stated is None else stated
        if not (isinstance(limit, Real) and 0 <= float(limit) < math.inf):
            raise BadValue(
                f"{name} has the tolerance {limit!r:.40}; return one finite number from 0 on for"
                " all samples"
            )
        tol = float(limit)
        a.expect(name, row, tol)
        text = "the law that came with the scene"
        checks.append(
            Check(
                "d", f"{a.title(name)}: {a.part.law}", a.apart(name, row), tol + a.slack * top, text
            )
        )
    return checks


# The papers' --------------------------------------------------------------------------
PEAK, STATIC, TAU = 100.0, 37.0, 10.0
"""What the motors of the UGrip paper bear, in N (section 2.1), and the time over which
a static force counts, in s.
"""


@law_of("squeeze")
def _squeeze(a: Asked) -> list[Check]:
    """Check F = k x + A (k tau v)(tau dp/dt) g for each finger.

    It is computed from motion, numbers and seed.
    """
    from scipy.interpolate import PchipInterpolator

    from ..blocks import differentiator, pink_noise
    from ..blocks.contact import PLACEHOLDER_GAMMA

    n = range(1, a.given["fingers"] + 1)
    outputs = [f"force{i}" for i in n] + [
        f"current{i}" for i in n if a.given["motor_constant"] is not None
    ]
    if set(outputs) != set(a.y):
        raise SceneError(
            f"it has the outputs {', '.join(a.y)}, and {', '.join(outputs)} were asked for"
        )
    checks, g, k, A = [], a.given, a.live("k"), a.live("A") * a.live("level")
    on, off = laws.gate_thresholds(g["resolution"], g["cutoff"], a.fs)
    for i in n:
        name, x = f"force{i}", a.x[f"x{i}"]
        its = a.kept.setdefault(name, {})
        still = laws.squeeze_finger(
            x, np.zeros(a.n), a.contact, a.fs, k, A, g["cutoff"], on, off, its
        )
        runs, noise = still.gate & (A != 0), np.zeros(a.n)
        pink = pink_noise(1 / math.pi, g["seed"], stream=i, f_low=g["f_low"], tol_db=g["tol_db"])
        source = differentiator(pink, passband=g["passband"], stopband=g["passband"] + 500.0)
        noise[runs] = a.render(source, int(runs.sum()), f"noise of {name}")  # on a clock of its own
        finger = laws.vibrating(still, noise, k, A)
        if a.part.span is None:
            a.e.fingers[a.output(name)] = finger
        want = _held(finger.force, a.y[name], a.fs, its) if g["limits"] else finger.force
        acted = bool((want != finger.force).any())
        slack = 2.0**-50 * TAU * a.fs * acted + a.slack  # a mean over tau, by two recursions
        a.say(
            f"{a.title(name)}: velocity through {g['cutoff']:g} Hz, gate opens at {on:.4g} and"
            f" closes at {off:.4g}"
            f" m/s{f', held to {PEAK:g} N peak and {STATIC:g} N static' if g['limits'] else ''}"
        )
        scale = max(np.abs(finger.force).max(), 1e-300)
        quiet = a.far(np.where(runs, 0, a.y[name] - want)) / scale
        limit = 1e-14 + slack
        checks.append(
            Check(
                "d",
                f"{a.title(name)}: mean part is k x",
                quiet,
                limit,
                "where the gate is closed, relative",
            )
        )
        vibration = np.abs(finger.force - finger.mean).max()
        limit = 1e-9 + (4e-16 + slack) * scale / vibration if vibration > 0 else 1e-14 + slack
        error = a.apart(name, want) / (vibration or scale)
        checks.append(
            Check(
                "d",
                f"{a.title(name)}: vibration law",
                error,
                float(limit),
                "A k tau v tau dp/dt, relative",
            )
        )
        if g["motor_constant"] is not None:
            gamma = PchipInterpolator(*PLACEHOLDER_GAMMA)(
                np.clip(x, PLACEHOLDER_GAMMA.x[0], PLACEHOLDER_GAMMA.x[-1])
            )
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
        elif np.ptp(k) > 0:
            a.e.skipped.append(
                f"{a.title(name)}: k was changed, so the force over position has no one slope"
            )
        elif a.part.span is None and not a.e.at:
            model = noise_model(source, a.fs)
            checks += _slope(
                a,
                name,
                x,
                float(k[0]),
                A * float(k[0]) * finger.v / 8000**2,
                noise,
                runs,
                model and model[0],
            )
    return checks


def _held(
    force: np.ndarray, y: np.ndarray, fs: float, kept: dict[str, Any] | None = None
) -> np.ndarray:
    """Return what the motors' limits make of a force.

    The gain of the static one follows from the output's own past.
    """
    from scipy.signal import lfilter

    force, kept = np.clip(force, -PEAK, PEAK), {} if kept is None else kept
    r, most = -np.expm1(-1 / (TAU * fs)), STATIC**2
    square = np.where(np.isnan(y), force, y) ** 2
    mean, kept["squares"] = lfilter([r], [1, r - 1], square, zi=kept.get("squares", np.zeros(1)))
    before, kept["mean"] = kept.get("mean", 0.0), mean[-1] if mean.size else 0.0
    return np.minimum(1.0, (most - np.r_[before, mean[:-1]]) / (0.19 * most)) * force


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
    """Return the stiffness recovered from delivered force over position.

    Only where the force cannot have been clipped.

    What the noise adds to the slope is a weighted sum of a process whose spectrum is
    known, so its deviation is too.
    """
    from scipy import stats

    e, i = a.e, list(a.e.scene.outputs).index(a.output(name))
    y, whole, step = e.shown[i], np.ones(x.size, bool), 2.0**-52 * np.abs(e.y[i])
    if e.sidecar is not None:
        top = e.sidecar["channels"][i]["full_scale"]
        if e.sidecar["subtype"] == "FLOAT":
            step = 2.0**-23 * np.abs(e.y[i])
        elif e.sidecar["subtype"] == "PCM_24":
            whole = np.abs(k * x) + np.abs(gain * noise).max(initial=0.0) < (1 - 2.0**-22) * top
            step = np.full(x.size, 2.0**-23 * top)
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
    sigmas = float(stats.norm.isf(e.share / 2))
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


@law_of("viscoelastic")
def _viscoelastic(a: Asked) -> list[Check]:
    """Check the springpot's force against the full sum over the history.

    Some samples are compared, in extended precision.
    """
    from ..blocks import springpot

    g, y, n, touching = a.given, a.x["y"], a.n, a.contact > 0
    chi = g["chi_0"] / g["w"] ** g["alpha"]
    gain = a.live("firmness") * chi
    at_1_hz = chi * (2 * np.pi) ** g["alpha"]
    a.say(
        f"chi = {chi:.6g}, alpha = {g['alpha']:.6g}: as strong at 1 Hz as {at_1_hz:.4g} N/m, for"
        " firmness 1"
    )
    contact = Input("contact") if "contact" in a.x else None
    horizon = 60.0 if g["scheme"] == "gl-downsampled" else 86400.0
    block = springpot(
        Input("y", "m"), chi, g["alpha"], g["scheme"], g["tol"], horizon, contact=contact
    )
    same = a.near(
        "force", a.live("firmness") * a.render(block), 1e-14, "springpot of these numbers"
    )
    name, silent = a.title("force"), a.silent("force", ~touching)
    if g["scheme"] not in ("gl", "l1"):
        a.e.skipped.append(f"{name}: only the full sum's own schemes, gl and l1, have a law")
        return [same, silent]
    starts = np.flatnonzero(touching & ~np.r_[False, touching[:-1]])
    stops = np.flatnonzero(touching & ~np.r_[touching[1:], False]) + 1
    order, over, tol = np.full(n, g["alpha"]), np.zeros(n), g["tol"]
    for i, j in zip(starts, stops, strict=True):
        at = np.unique(np.linspace(0, j - i - 1, max(2, round(64 * (j - i) / n))).astype(int))
        force, size = laws.springpot_sum(y[i:j], a.fs, g["scheme"], order[i:j], at)
        k = gain[i:j][at]
        bound = np.abs(k) * (
            (tol + 64 * 2.0**-53) * np.maximum(size, 1e-300) + (1e-15 + a.slack) * np.abs(force)
        )
        over[i:j][at] = (a.y["force"][i:j][at] - k * force) / np.maximum(bound, 1e-300)

    def everywhere() -> np.ndarray:
        want = np.zeros(n)
        for i, j in zip(starts, stops, strict=True):
            want[i:j] = laws.springpot_convolution(y[i:j], a.fs, g["scheme"], g["alpha"])[0]
        return gain * want

    # the sum of the absolute values of its terms is at most that over all steps of the
    # position
    most = float(2 * a.fs ** g["alpha"] * np.abs(np.diff(y, prepend=0.0)).sum())
    a.expect("force", everywhere, float(np.abs(gain).max(initial=0.0) * (tol + 1e-13) * most))
    text = f"tol = {tol:g}, alpha = {g['alpha']:g}, {g['scheme']}: error over its certificate"
    return [same, Check("d", f"{name}: full sum over the history", a.far(over), 1.0, text), silent]


@law_of("bumps")
def _bumps(a: Asked) -> list[Check]:
    """Check V = gain A e(x/wavelength) c(t), written again.

    At constant speed the spectral model is checked as well.

    Equalised, it is that times d_max/d between the last two places; limited, it is
    scaled, or clipped, or both.
    """
    from ..analysis import am

    g, n, name = a.given, a.n, a.title("voltage")
    if not isinstance(g["waveform"], str):
        a.e.skipped.append(f"{name}: the law knows the named waveforms, not tables")
        return []
    if g["sampling"] != "area":
        a.e.skipped.append(f"{name}: the law covers bumps that are sampled by their area")
        return []
    A, duty, freq, gain = (
        a.live("A"),
        a.held("duty", 1e-6, 1.0),
        a.held("freq", 0.0, a.fs / 2),
        g["gain"],
    )
    # so rounded as in the scene: at an edge that counts
    contact, u = a.contact * (A != 0), a.x["x"] * (g["bumps"] / g["length"])
    last, touching = laws.ways(u, contact)
    shape, lost = laws.bump_envelope(last, u, g["waveform"], duty) * touching
    turns, step = laws.turning(freq, a.fs)
    turns += a.kept.get("turns", g["phase"] / (2 * np.longdouble(np.pi)))
    a.kept["turns"] = turns[-1]  # at a sample that the next stretch has, too
    wave = laws.carried(turns, step, g["rectify"])
    if a.part.span is None:
        a.e.curves |= {"envelope": shape, "carrier": wave}
        edges = np.flatnonzero(np.diff(np.floor(u))) + 1
        whole_bumps = ((i, j) for i, j in pairwise(edges) if np.ptp(u[i:j]) > 0.9)
        a.e.closeup = slice(*next(whole_bumps, (0, n)))
    want, highest = gain * A * shape * wave, gain * np.abs(A)
    a.say(
        f"amplifier {gain:g}, wavelength {1000 * g['length'] / g['bumps']:.4g} mm, {g['waveform']}"
    )
    if g["displacement"] is not None:
        knots, d = np.array(g["displacement"])
        kind = "polynomial" if knots.size <= 6 else "cubic"
        factor, most = laws.profile_gain(a.x["x"], contact, knots, d, kind)
        want, highest = want * factor, highest * most
        a.say(f"equalised by {len(knots)} measured places ({kind}), at most {most:.4g} times")
    if g["limit"] is not None:
        limit = g["limit"]
        if g["headroom"] == "scale":
            want = want * (limit / np.maximum(limit, highest))
        a.say(f"limited to {limit:g} V, {int(np.sum(np.abs(want) >= limit))} samples held there")
        want = np.clip(want, -limit, limit)
    top = float(highest.max()) or 1.0
    a.expect("voltage", want, 1e-6 * top)
    error = a.far((a.y["voltage"] - want) / (1 + lost * highest / top / 1e-6)) / top
    checks = [
        Check(
            "d",
            f"{name}: envelope times carrier",
            error,
            1e-6,
            "of the peak voltage, written again",
        )
    ]
    checks.append(a.silent("voltage", contact <= 0))
    speed, still = (
        np.diff(u) * a.fs,
        np.ptp(A) == np.ptp(duty) == np.ptp(freq) == 0 and (a.window == 1).all(),
    )
    steady = (
        still
        and g["rectify"] == "half"
        and g["limit"] is None
        and g["displacement"] is None
        and contact.all()
    )
    if (
        steady
        and n > 2
        and speed[0]
        and np.ptp(speed) < 1e-6 * abs(speed[0])
        and abs(u[-1] - u[0]) >= 1
    ):
        whole = int(abs(u[-1] - u[0]))
        y = a.y["voltage"][1 : 1 + round(whole / abs(speed[0]) * a.fs)] / top
        model = am.sampled_rms(g["waveform"], duty[0], 1.0, abs(speed[0]), freq[0], a.fs)
        limit = 0.005 + am.meeting(
            g["waveform"], duty[0], abs(speed[0]), freq[0], a.fs, whole / abs(speed[0])
        )
        if limit > 0.2:
            a.e.skipped.append(
                f"{name}: rms of the line spectrum: bumps and carrier meet, so it depends on their"
                " phases"
            )
        else:
            text = f"{whole} bumps at {abs(speed[0]):.3g}/s; lines that meet may add the rest"
            rms = float(np.sqrt(np.mean(y**2)))
            checks.append(
                Check("d", f"{name}: rms of the line spectrum", abs(rms / model - 1), limit, text)
            )
    return checks


@law_of("texture")
def _texture(a: Asked) -> list[Check]:
    """Check the acceleration of a measured texture, written again.

    Where speed and force stand still, its spectrum is checked as well.
    """
    from ..design.texture import TextureModel

    g, n, name = a.given, a.n, a.title("acceleration")
    model = TextureModel(**g["model"])
    every = round(a.fs / model.rate)
    speed = laws.squeeze_finger(
        a.x["x"], np.zeros(n), a.contact, a.fs, 0.0, 0.0, g["cutoff"], 1.0, 0.0
    ).v
    force = a.x["force"] * a.contact
    want = a.live("level") * laws.texture(
        model, speed, force, laws.white(a.seed, g["seed"], 0, 0, n), every
    )
    a.say(
        f"{len(model.speed)} models of order {model.lsf.shape[1]}, {model.ma.shape[1]}, at"
        f" {model.rate:g} Hz"
    )
    # of which the roundings are
    most = float(np.abs(a.live("level")).max() * np.max(model.gain * np.sqrt(model.variance)))
    checks = [
        a.near(
            "acceleration", want, TEXTURE, "the models' recursion, written again", max(most, 1e-300)
        )
    ]
    steady = slice(n // 4 // every * every, None, every)
    v, N = abs(speed[steady]), force[steady]
    flat = (a.window == 1).all() and not np.ptp(a.live("level"))
    if (
        np.ptp(v) > 1e-3 * v.mean()
        or np.ptp(N) > 1e-3 * N.mean()
        or not flat
        or not want[steady].any()
    ):
        a.e.skipped.append(f"{name}: speed and force move, so it has no one spectrum")
        return checks
    gain = a.live("level")[0]

    def psd(f):
        return gain**2 * model.psd(f, v.mean(), N.mean())

    s = spectra.test_spectrum(a.y["acceleration"][steady], model.rate, psd, 5.0, 0.49 * model.rate)
    if s is not None:
        text = f"{s.level_db:+.3f} dB over {N.size / model.rate:.3g} s"
        p, share = -np.log10(max(s.p, 1e-300)), -np.log10(a.e.share)
        checks.append(Check("c", f"{name}: spectrum, {len(s.bands)} bands", p, share, text))
    return checks


def motor_limits(e: Evidence) -> list[Check]:
    """Check peak and running mean square of force-limited outputs.

    They are computed again from the samples.
    """
    from scipy.signal import lfilter

    from ..blocks.contact import ForceLimit, StaticLimit

    tops = dict.fromkeys(e.scene.outputs, 0.0)
    means, states = tops.copy(), {name: np.zeros(1) for name in tops}
    for s in (
        e.stretches()
        if any(isinstance(b, StaticLimit | ForceLimit) for b in e.scene.outputs.values())
        else ()
    ):
        for y, (name, b) in zip(s.y, e.scene.outputs.items(), strict=True):
            tops[name] = np.fmax(tops[name], np.abs(y).max(initial=0.0))
            if isinstance(b, StaticLimit):
                a = -np.expm1(-1 / (b.tau * e.fs))
                mean, states[name] = lfilter([a], [1, a - 1], y**2, zi=states[name])
                means[name] = max(means[name], float(mean.max(initial=0.0)))
    checks = []
    for name, b in e.scene.outputs.items():
        if isinstance(b, StaticLimit):
            text = "largest running mean square, N^2"
            checks.append(
                Check("e", f"{name}: static limit", means[name], b.limit**2 * (1 + 1e-12), text)
            )
            b = b.x
        if isinstance(b, ForceLimit) and isinstance(b.peak, Const):
            checks.append(Check("e", f"{name}: peak limit", float(tops[name]), b.peak.value, "N"))
    return checks
