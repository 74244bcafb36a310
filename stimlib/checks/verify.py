"""Is what was rendered what the model says?  Every check states what it compares, how far apart it was, and the limit."""

from __future__ import annotations

import dataclasses as dc
import os
from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import BadValue, SceneError, StimlibError
from ..graph import Block, Const, Enabled, Input, Mul, Param, pack, reach, signals
from ..processor import Processor, compile
from ..rendering import Rendering, positions, sources_of
from ..scene import Scene
from . import laws, spectra
from .report import Report

ALARM = 1e-6  # joint false alarm probability of all statistical checks of one report
ROUNDING = 1e-10  # of two computations of one transfer function


@dataclass(frozen=True)
class Check:
    """One comparison: passed where measured <= limit."""

    group: str
    name: str
    measured: float
    limit: float
    text: str

    @property
    def passed(self) -> bool:
        """Whether it held; a measurement that is not a number does not."""
        return bool(self.measured <= self.limit)


@dataclass(frozen=True)
class Tap:
    """One gated noise of the scene, seen before gate and rate on its own clock."""

    name: str
    output: str
    stream: np.ndarray  # the enabled samples, one after the other
    gated: np.ndarray  # with 0 while held
    gate: np.ndarray
    model: Callable[[np.ndarray], np.ndarray]  # one-sided PSD
    f_low: float
    f_high: float
    noise: str
    spectrum: spectra.Spectrum | None = None


@dataclass
class Evidence:
    """What the checks look at; the report draws from it."""

    scene: Scene
    proc: Processor
    fs: float
    seed: int
    params: dict[str, float]
    x: np.ndarray
    y: np.ndarray  # the re-render in float64
    shown: np.ndarray  # what was delivered
    source: str
    sidecar: dict[str, Any] | None
    motion: dict[str, Any]
    taps: list[Tap] = field(default_factory=list)
    fingers: dict[str, laws.Finger] = field(default_factory=dict)
    curves: dict[str, np.ndarray] = field(default_factory=dict)  # what else a law computed
    skipped: list[str] = field(default_factory=list)
    changes: list[tuple[int, str, float, float]] = field(default_factory=list)  # Processor.set at a sample: name, value, ramp
    session: bool = False  # delivered through a safety stage, which checks/session.py compares


def verify(scene: Scene, motion: Mapping[str, Any], rendering: Rendering | str | os.PathLike) -> Report:
    """Prove a rendering, or a file written by the file sink, against its scene and motion.

    Parameters
    ----------
    scene : Scene
    motion : dict of str to callable or ndarray
        As it was rendered.
    rendering : Rendering or path
        What was displayed.

    Returns
    -------
    Report
        ``passed``, ``checks``, ``to_html(path)``; ``print`` it for a table.

    Raises
    ------
    BadValue
        A file of another scene, sample rate or set of live numbers; motion that does not fit.
    SinkError
        A damaged file or sidecar.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.devices.motion import minimum_jerk
    >>> scene, motion = stimlib.scenes.squeeze(fingers=1), {"x1": minimum_jerk()}
    >>> stimlib.verify(scene, motion, stimlib.render(scene, motion, fs=8000, seconds=1.0)).passed
    True
    """
    e = _evidence(scene, motion, rendering)
    return Report([*_lti(e), *_same_samples(e), *_generator(e), *_noise(e), *_scene_law(e), *_limits(e)], e)


def _evidence(scene: Scene, motion: Mapping[str, Any], rendering: Rendering | str | os.PathLike) -> Evidence:
    sidecar = None
    if isinstance(rendering, Rendering):
        fs, seed, params, shown = rendering.fs, rendering.seed, dict(rendering.params), rendering.y
        source = "rendering in memory"
        if rendering.scene.hash != scene.hash:
            raise BadValue("the rendering is of another scene")
    else:
        from ..devices import file

        shown, sidecar = file.read(rendering)
        fs, seed, params = sidecar["fs"], sidecar["seed"], dict(sidecar["params"])
        source = Path(rendering).name
        if sidecar["scene_hash"] != scene.hash:
            raise BadValue(
                f"{rendering} was rendered from another scene (hash {sidecar['scene_hash'][:12]}, this one {scene.hash[:12]}); "
                "give the same scene with the same numbers, or render again"
            )
    if sidecar is not None and (sidecar["index"] or any(change["at"] for change in sidecar["log"])):
        raise BadValue(f"{rendering} goes on from an earlier sample of its processor; verify files that begin at sample 0")
    proc = compile(scene, fs, seed=seed)
    _settle(proc, params, sidecar)
    frames = shown.shape[1]
    sources = sources_of(motion, proc.inputs, frames)
    x = positions(sources, 0, frames, fs)
    augmented, found = _with_taps(scene, fs)
    watch = compile(augmented, fs, seed=seed)
    _settle(watch, params, sidecar)
    seen = watch.process(x)
    e = Evidence(scene, proc, fs, seed, params, x, seen[: len(scene.outputs)].copy(), shown, source, sidecar, dict(motion))
    _tap(e, seen, found)
    return e


def _tap(e: Evidence, seen: np.ndarray, found: list[tuple]) -> None:
    """Keep the gated noises among what an augmented scene gave."""
    n = len(e.scene.outputs)
    for k, (output, block, model, f_low, f_high, noise) in enumerate(found):
        gated, gate = seen[n + 2 * k].copy(), seen[n + 2 * k + 1] > 0  # a copy, or all that was seen would be kept
        e.taps.append(Tap(f"{block!r}", output, gated[gate], gated, gate, model, f_low, f_high, noise))


def _settle(proc: Processor, params: dict[str, float], sidecar: dict[str, Any] | None) -> None:
    """The live numbers as they were when the rendering began: set at once, or along the ramps that were logged."""
    if sidecar is None:
        for name, value in params.items():
            proc.set(name, value, ramp=0.0)
    else:
        for change in sidecar["log"]:
            proc.set(change["name"], change["value"], change["ramp"])


def _with_taps(scene: Scene, fs: float):
    """The scene with every gated noise and its gate as further outputs (no bit of the others changes)."""
    outputs, seen = dict(scene.outputs), set()
    found: list[tuple] = []
    for name, root in scene.outputs.items():
        for b in reach([root]):
            if isinstance(b, Enabled) and id(b) not in seen:
                seen.add(id(b))
                model = _noise_model(b.block, fs)
                if model is not None:
                    outputs[f"tap{len(found)}"], outputs[f"gate{len(found)}"] = b, b.by
                    found.append((name, b, *model))
    return Scene(outputs), found


def _noise_model(root: Block, fs: float):
    """(PSD, f_low, f_high, source) of a chain of known linear blocks on white noise, by their physical laws; else None."""
    chain: list[laws.Response] = []
    b = root
    while not hasattr(b, "noise_key"):
        law = laws.RESPONSES.get(type(b))
        if law is None:
            return None
        chain.append(law(b, fs))
        b = b.children[0]

    def psd(f):
        with np.errstate(divide="ignore", invalid="ignore"):
            return 2 / fs * np.prod([np.abs(r.law(f)) ** 2 for r in chain], axis=0)

    low, high = max((r.f_low for r in chain if r.f_low > 1), default=1.0), min((r.f_high for r in chain), default=fs / 2)
    return psd, low, high, "white({}, {})".format(*b.noise_key)


# a: linear blocks --------------------------------------------------------------------------------------------------------
def _lti(e: Evidence) -> list[Check]:
    """a1: compiled impulse response against the block's own discrete response; a2: that response against the law."""
    checks, seen = [], set()
    for i, q in enumerate(e.proc.program.instances):
        b, p = q.block, e.proc.design[i][0]
        if q.kind != "block" or type(b).transfer is None:
            continue
        key = (type(b), pack(p).tobytes())
        if key in seen:
            continue
        seen.add(key)
        name = type(b).__name__
        f, H, h, settled = _impulse(b, p, e.fs)
        scale = np.abs(H).max()
        if settled:
            apart = float(np.abs(h - H).max() / scale)
            checks.append(Check("a1", f"{name}: impulse response", apart, ROUNDING, "compiled taps = discrete response"))
        else:
            e.skipped.append(f"{name}: its impulse response never settles, so it is not transformed")
        law = laws.RESPONSES.get(type(b))
        if law is None:
            e.skipped.append(f"{b!r}: no physical law is known for it")
            continue
        r = law(b, e.fs)
        g = np.geomspace(r.f_low, r.f_high, 4001)
        transfer: Any = type(b).transfer
        got, want = transfer(p, np.exp(2j * np.pi * g / e.fs)), r.law(g)
        error = np.abs(np.abs(got) / np.abs(want) - 1) if r.magnitude else np.abs(got / want - 1)
        checks.append(Check("a2", f"{name}: physical law", float(error.max()), r.tol * (1 + 1e-6), r.text))
    return checks


def _impulse(b: Block, p: Any, fs: float):
    """Some frequencies, the response that the block states there, and the transform of its compiled impulse response."""
    x = Input("x")
    kind = type(b)
    lone = dc.replace(b, **{s: x if k == 0 else Const(1.0) for k, s in enumerate(signals(kind))})  # type: ignore[type-var]
    proc = compile(Scene({"y": lone}), fs)
    hit = np.zeros((len(proc.inputs), 4096))
    hit[0, 0] = 1.0
    # a first sample sets what a block holds as its rest, so the impulse comes second
    proc.process(np.zeros((len(proc.inputs), 1)))
    parts = [proc.process(hit)[0].copy()]
    hit[0, 0] = 0.0
    while np.abs(parts[-1]).max() > 1e-18 * np.abs(parts[0]).max() and len(parts) < 512:
        parts.append(proc.process(hit)[0].copy())
    h = np.concatenate(parts)
    spectrum = np.fft.rfft(h)
    bins = np.unique(np.geomspace(1, spectrum.size - 1, 600).astype(int))
    f = bins * fs / h.size
    settled = np.abs(parts[-1]).max() <= 1e-15 * np.abs(parts[0]).max()
    return f, kind.transfer(p, np.exp(2j * np.pi * f / fs)), spectrum[bins], settled  # type: ignore[misc]


# b: the same samples again -----------------------------------------------------------------------------------------------
def _same_samples(e: Evidence) -> list[Check]:
    """The delivered samples against a re-render in random cuts, and a stretch against the interpreter."""
    n = e.x.shape[1]
    rng = np.random.default_rng(e.seed)
    cut = np.empty_like(e.y)
    at, states = 0, {}
    middle = int(np.flatnonzero(e.taps[0].gate)[0]) if e.taps and e.taps[0].gate.any() else 0
    marks = sorted({0, max(0, middle - 64), n})
    edges = sorted({c[0] for c in e.changes} | set(marks) | {n})
    while at < n:
        if at in marks:
            states[at] = e.proc.state
        _change(e.proc, e.changes, at)
        stop = min(at + int(rng.choice([1, 7, 64, 1000, 4096, 8192])), edges[bisect_right(edges, at)])
        cut[:, at:stop] = e.proc.process(np.ascontiguousarray(e.x[:, at:stop]))
        at = stop
    wrong = int(np.sum(cut.view(np.uint64) != e.y.view(np.uint64)))
    checks = [Check("b", "random cuts, other outputs added", wrong, 0, "samples whose bits differ")]
    start = marks[1] if marks[1] < n else 0
    stretch = min(n - start, 512)
    reference = compile(e.scene, e.fs, target="python", seed=e.seed)
    reference.state = states[start]
    y = _drive(reference, e.x[:, start : start + stretch], e.changes, start)
    wrong = int(np.sum(y.view(np.uint64) != cut[:, start : start + stretch].view(np.uint64)))
    checks.append(Check("b", f"interpreter, {stretch} samples from {start}", wrong, 0, "samples whose bits differ"))
    if e.session:
        wrong = int(np.sum(e.shown.view(np.uint64) != cut.view(np.uint64)))
        checks.append(Check("b", "samples before the safety stage", wrong, 0, "samples whose bits differ"))
    elif e.sidecar is None:
        wrong = int(np.sum(e.shown.view(np.uint64) != cut.view(np.uint64)))
        checks.append(Check("b", "delivered = re-render", wrong, 0, "samples whose bits differ"))
    else:
        from ..devices import file

        stored = file.stored(cut, e.sidecar)
        wrong = int(np.sum(e.shown != stored))
        checks.append(Check("b", f"file = re-render as {e.sidecar['subtype']}", wrong, 0, "samples that differ"))
    return checks


def _change(proc: Processor, changes: list[tuple[int, str, float, float]], at: int) -> None:
    """What is set right before sample at."""
    for change in changes:
        if change[0] == at:
            proc.set(*change[1:])


def _drive(proc: Processor, x: np.ndarray, changes: list[tuple[int, str, float, float]], start: int = 0) -> np.ndarray:
    """The outputs for the motion of samples from start on, live numbers set where they were."""
    end = start + x.shape[1]
    edges = sorted({start, end} | {c[0] for c in changes if start < c[0] < end})
    y = np.empty((len(proc.outputs), end - start))
    for at, stop in pairwise(edges):
        _change(proc, changes, at)
        y[:, at - start : stop - start] = proc.process(np.ascontiguousarray(x[:, at - start : stop - start]))
    return y


def _live(e: Evidence, name: str) -> np.ndarray:
    """A live number at every sample, its ramps written again as straight lines."""
    n = e.x.shape[1]
    y, changes = np.full(n, e.params[name]), [c for c in e.changes if c[1] == name and c[0] < n]
    for k, (at, _, target, ramp) in enumerate(changes):
        end = changes[k + 1][0] if k + 1 < len(changes) else n
        share = np.minimum(np.arange(1, end - at + 1) / max(1, round(ramp * e.fs)), 1.0)
        before = y[at - 1] if at else e.params[name]
        y[at:end] = np.where(share < 1, before + (target - before) * share, target)
    return y


# c: noise ----------------------------------------------------------------------------------------------------------------
def _generator(e: Evidence) -> list[Check]:
    """The first samples of every noise source against the published generator in plain integers."""
    checks = []
    for name, i in e.proc.program.noises.items():
        b = e.proc.program.instances[i].block
        one = compile(Scene({"n": dc.replace(b)}), e.fs, seed=e.seed)  # type: ignore[type-var]
        got = one.process(np.empty((0, 200)))[0]
        seed, stream = b.noise_key  # type: ignore[attr-defined]
        want = laws.white(e.seed, seed, stream, 0, 200)
        checks.append(
            Check("c", f"{name}: generator", float(np.abs(got - want).max()), 1e-13, "Philox and Box-Muller, written again")
        )
    return checks


def _noise(e: Evidence) -> list[Check]:
    """Spectrum of every tap, and independence of every pair."""
    checks = []
    enough = [t for t in e.taps if t.stream.size > 64]
    pairs = [(a, b) for k, a in enumerate(enough) for b in enough[k + 1 :]]
    share = ALARM / max(1, len(enough) + len(pairs))
    for k, t in enumerate(e.taps):
        s = spectra.test_spectrum(t.stream, e.fs, t.model, t.f_low, t.f_high, share) if t in enough else None
        if s is None:
            e.skipped.append(f"spectrum of {t.name} in {t.output}: only {t.stream.size / e.fs:.3g} s enabled, too short to test")
            continue
        e.taps[k] = dc.replace(t, spectrum=s)
        text = f"{s.level_db:+.3f} dB over {s.seconds:.3g} s; would show {s.smallest_db:.2g} dB"
        checks.append(Check("c", f"{t.output}: spectrum, {len(s.bands)} bands", _surprise(s.p), _surprise(share), text))
    for a, b in pairs:
        c, p = spectra.correlation(a.stream, b.stream, e.fs, a.model, max(a.f_low, b.f_low), min(a.f_high, b.f_high))
        name = f"{a.output} and {b.output}: independence"
        checks.append(Check("c", name, _surprise(p), _surprise(share), f"correlation {c:+.3g}"))
    return checks


def _surprise(p: float) -> float:
    """-log10 p, at least 0."""
    return float(max(0.0, -np.log10(max(p, 1e-300))))


# d, e: the whole scene, limits -------------------------------------------------------------------------------------------
def _scene_law(e: Evidence) -> list[Check]:
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
    k, A = _live(e, "k"), _live(e, "A") * _live(e, "level")
    quiet = compile(e.scene, e.fs, seed=e.seed)
    for name, value in (e.params | {"A": 0.0}).items():
        quiet.set(name, value, ramp=0.0)
    mean = _drive(quiet, e.x, [c for c in e.changes if c[1] != "A"])
    for i, (name, root) in enumerate(e.scene.outputs.items()):
        if not name.startswith("force"):
            e.skipped.append(f"{name}: no law of it is known")
            continue
        tap = next((t for t in e.taps if t.output == name), None)
        if tap is None:
            raise SceneError(f"{name}: a squeeze scene without gated noise")
        x = rows[name.replace("force", "x")]
        gate = next(b for b in reach([root]) if isinstance(b, Loading))
        cutoff = gate.v.cutoff  # type: ignore[attr-defined]
        on, off = gate.on, gate.off
        if on is None or off is None:
            on, off = laws.gate_thresholds(gate.resolution, cutoff, e.fs)
        finger = laws.squeeze_finger(x, tap.gated, contact, e.fs, k, A, cutoff, on, off)
        e.fingers[name] = finger
        scale = max(np.abs(finger.force).max(), 1e-300)
        steps = max((c[3] * e.fs for c in e.changes if c[1] == "k"), default=0.0)  # of a ramp: each is rounded
        apart = float(np.abs(mean[i] - finger.mean).max() / scale)
        checks.append(Check("d", f"{name}: mean part is k x", apart, 1e-14 + 2.0**-52 * steps, "A = 0, relative"))
        noise = np.abs(finger.force - finger.mean).max()
        error = np.abs((e.y[i] - finger.mean) - (finger.force - finger.mean)).max()
        limit = 1e-9 + 4e-16 * scale / noise if noise > 0 else 1e-14
        checks.append(
            Check("d", f"{name}: vibration law", float(error / (noise or scale)), float(limit), "A k tau v tau dp/dt, relative")
        )
        wrong = int(np.sum((finger.gate != tap.gate) & (A != 0)))
        checks.append(Check("e", f"{name}: gate timing", wrong, 0, "samples where the gate differs"))
        if np.ptp(k) > 0:
            e.skipped.append(f"{name}: k was changed, so the force over position has no one slope")
        else:
            checks += _slope(name, x, e, i, float(k[0]))
    return checks


def _slope(name: str, x: np.ndarray, e: Evidence, i: int, k: float) -> list[Check]:
    """Stiffness recovered from delivered force over position, on samples that were not clipped."""
    y = e.shown[i]
    whole = np.ones(x.size, bool)
    if e.sidecar is not None:
        top = (1 - 2.0**-22) * e.sidecar["channels"][i]["full_scale"]
        whole = np.abs(y) < top if e.sidecar["subtype"] == "PCM_24" else whole
    u = x[whole] - x[whole].mean() if whole.sum() > 2 else np.zeros(0)
    if u.size == 0 or np.abs(u).max() == 0:
        e.skipped.append(f"{name}: the position never changes, so no slope can be fitted")
        return []
    r = y[whole] - y[whole].mean()
    slope = float(u @ r / (u @ u))
    residual = r - slope * u
    error = float(np.sqrt(residual @ residual / max(1, u.size - 2) / (u @ u)))
    rounding = 1e-7 * abs(k)  # of float32 samples
    return [
        Check(
            "d",
            f"{name}: slope of force over position",
            abs(slope - k),
            5 * error + rounding,
            f"{slope:.7g} N/m, 5 standard errors",
        )
    ]


def _viscoelastic(e: Evidence) -> list[Check]:
    """The springpot's force at some samples against the full sum over the history, in extended precision."""
    from ..blocks.fractional import Downsampled, ShortMemory, Springpot

    spring = next(b for b in reach(e.scene.outputs.values()) if isinstance(b, (Springpot, Downsampled, ShortMemory)))
    if not isinstance(spring, Springpot):
        e.skipped.append("force: only the full sum's own schemes, gl and l1, have a law")
        return []
    rows = {n: e.x[k] for k, n in enumerate(e.proc.inputs)}
    y, n = rows["y"], e.x.shape[1]
    touching = rows.get("contact", np.ones(n)) > 0
    gain = _live(e, "firmness") * _gain(e.scene.outputs["force"])
    starts = np.flatnonzero(touching & ~np.r_[False, touching[:-1]])
    stops = np.flatnonzero(touching & ~np.r_[touching[1:], False]) + 1
    worst = 0.0
    for a, b in zip(starts, stops, strict=True):
        at = np.unique(np.linspace(0, b - a - 1, max(2, round(64 * (b - a) / n))).astype(int))
        force, size = laws.springpot_sum(y[a:b], e.fs, spring.scheme, spring.order, at)
        g = gain[a:b][at]
        bound = np.abs(g) * (spring.tol + 64 * 2.0**-53) * np.maximum(size, 1e-300) + 1e-15 * np.abs(g) * np.abs(force)
        worst = max(worst, float(np.max(np.abs(e.y[0, a:b][at] - g * force) / np.maximum(bound, 1e-300))))
    text = f"tol = {spring.tol:g}, alpha = {spring.order:g}, {spring.scheme}: error over its certificate"
    lost = float(np.abs(e.y[0, ~touching]).max(initial=0.0))
    return [
        Check("d", "force: full sum over the history", worst, 1.0, text),
        Check("e", "force: none off contact", lost, 0.0, "N"),
    ]


def _gain(root: Block) -> float:
    """Product of the plain numbers on the way to the springpot."""
    return float(np.prod([b.value for b in reach([root]) if isinstance(b, Const)]))


def _factor_of(name: str, blocks: list[Block]) -> float:
    """The plain number that a live number is multiplied with."""
    for b in blocks:
        if isinstance(b, Mul) and isinstance(b.a, Const) and isinstance(b.b, Param) and b.b.name == name:
            return b.a.value
    raise SceneError(f"no plain number is multiplied with the live number {name!r}")


def _bumps(e: Evidence) -> list[Check]:
    """V = gain A e(x/wavelength) c(t), envelope and carrier written again; at constant speed also the spectral model."""
    from ..blocks.carrier import Bump, Carrier
    from . import am

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
    A, duty, freq = (_live(e, name) for name in ("A", "duty", "freq"))
    contact = rows.get("contact", np.ones(n)) * (A != 0)
    u = rows["x"] * per_metre
    shape = laws.bump_envelope(u, contact, envelope.waveform, duty)
    wave = laws.carrier_half(freq, e.fs)
    e.curves |= {"envelope": shape, "carrier": wave}
    top = gain * float(np.abs(A).max()) or 1.0
    error = float(np.abs(e.y[0] - gain * A * shape * wave).max() / top)
    checks = [Check("d", "voltage: envelope times carrier", error, 1e-6, "of the peak voltage, written again")]
    checks.append(Check("e", "voltage: none off contact", float(np.abs(e.y[0, contact <= 0]).max(initial=0.0)), 0.0, "V"))
    speed, steady = np.diff(u) * e.fs, np.ptp(A) == np.ptp(duty) == np.ptp(freq) == 0
    if steady and n > 2 and speed[0] and np.ptp(speed) < 1e-6 * abs(speed[0]) and contact.all() and abs(u[-1] - u[0]) >= 1:
        whole = int(abs(u[-1] - u[0]))
        y = e.y[0, 1 : 1 + round(whole / abs(speed[0]) * e.fs)] / top
        model = am.sampled_rms(envelope.waveform, duty[0], 1.0, abs(speed[0]), freq[0], e.fs)
        text = f"{whole} bumps at {abs(speed[0]):.3g}/s; one carrier phase differs by up to 3 %"
        checks.append(Check("d", "voltage: rms of the line spectrum", abs(float(np.sqrt(np.mean(y**2))) / model - 1), 0.05, text))
    return checks


SCENES: dict[str, Callable[[Evidence], list[Check]]] = {"squeeze": _squeeze, "viscoelastic": _viscoelastic, "bumps": _bumps}


def _motor_limits(e: Evidence) -> list[Check]:
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


def _limits(e: Evidence) -> list[Check]:
    bad = int(np.sum(~np.isfinite(e.shown)))
    checks = _motor_limits(e) + [Check("e", "finite", bad, 0, "samples that are not finite")]
    fault = e.proc.fault
    said = "guards that closed" if fault is None else f"{fault[0]} at sample {fault[1]}"
    checks.append(Check("e", "no fault", int(fault is not None), 0, said))
    if e.sidecar is not None:
        clips = sum(c["clips"] or 0 for c in e.sidecar["channels"])
        scale = np.array([c["full_scale"] for c in e.sidecar["channels"]])[:, None]
        over = int(np.sum(np.rint(e.y / scale * 2**23) > 2**23 - 1) + np.sum(np.rint(e.y / scale * 2**23) < -(2**23)))
        expected = over if e.sidecar["subtype"] == "PCM_24" else 0
        if any(c["clips"] is None for c in e.sidecar["channels"]):
            e.skipped.append("clip count of the sidecar: the file was recovered, nobody counted")
        else:
            checks.append(Check("e", "clip count of the sidecar", abs(clips - expected), 0, f"{clips} samples clipped"))
    for info in {id(m.info): m.info for m in e.motion.values() if hasattr(m, "info")}.values():
        found = ", ".join(f"{len(info[what])} {what}" for what in ("gaps", "lifts", "jumps") if info[what])
        text = f"{info['reports']} reports at {info['rate']:.3g} Hz, {info['repeats']} repeats left out"
        text += f", {info['silences']} silences held" if info["silences"] else ""
        e.skipped.append(f"between the reports of {Path(info['file']).name}: {text}; {found or 'no gaps, lifts or jumps'}")
    return checks


__all__ = ["Check", "Evidence", "Tap", "verify", "StimlibError"]
