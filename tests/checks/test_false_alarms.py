"""Correct renderings that a verifier could doubt: held hands, low frequencies, rare
corners; and the tails of its statistics.
"""

import dataclasses as dc

import numpy as np
import pytest
from laws import STRESS, mostly
from scipy import stats

import stimlib
from stimlib import Input, Param, Scene, blocks as b, constant, scenes as s
from stimlib.analysis import spectra
from stimlib.blocks import springpot, springpot_series, white_noise
from stimlib.blocks.springpots import Springpot
from stimlib.core.graph import reach
from stimlib.files import audio as file
from stimlib.motion.generators import constant_speed, minimum_jerk, ramp_and_hold, sinusoid
from stimlib.plate import Plate
from stimlib.scenes import bumps, grating, soft_surface, squeeze, touch_screen


def report(scene, motion, fs=8000, seconds=None, **words):
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs, seconds, **words))


# Renderings in memory -----------------------------------------------------------------
X, Y, HAND = Input("x", "m"), Input("y", "m"), sinusoid(0.01, 1.0)
RNG, N = np.random.default_rng(1), np.arange(2000)
ANY, JUMPS = RNG.standard_normal(2000), 0.06 + 0.3 * RNG.standard_normal((2, 2000))
SEEN = ([0.0, 0.03, 0.05, 0.07, 0.1], [1.0, 1.6, 1.84, 1.6, 1.0])  # a measured profile


def a_loop_behind_a_gate():
    """It begins at sample 0, the noise that feeds it before that."""
    noise = b.pinking(white_noise(seed=1), 30.0, 1.0)
    gated = b.enabled(b.loop(lambda last: 0.9 * last + noise, start=5.0), by=X)
    return Scene({"gated": gated, "low": b.loop(lambda last: last + 0.1 * (gated - last))})


def gated(by, what):
    return Scene({"y": b.enabled(what, by=by)})


def moved_by_noise():
    return b.oscillator(constant(300.0, "Hz") * abs(white_noise(seed=1)), "sawtooth")


def taps(name):
    noise = b.enabled(white_noise(1), by=X > 0)
    return Scene({name: noise, "other": noise * X})


def sticky(k=100.0, part=0.5):
    return Scene({"force": b.stick_slip(X, Input("n", "N"), 0.8, part, k)})


def slips(start, way):
    """A slip falls into a way so short that its place is a rounding; and the limit
    shrinks under a finger that stands on it.
    """
    place = start - 0.008
    steps = [2e-4, 9e-10, way, 0.0, 0.0, 0.0, -1e-3, -1e-3 - way, -5e-3]
    return np.r_[start, [place + step for step in steps]]


SHRINKS = np.r_[np.ones(5), 0.99, 0.7, 0.65, 0.6, 0.6]
# a way, and steps of 9e-15 m in which it slips: their place is what 0.3 m round to
WANDERS = np.array(
    [0.27377372990729826, 0.2873265817338449, 0.2625926549394141, 0.2562981574408921]
    + [0.2787095153081361, 0.27704753551313677, 0.30180485153158987, 0.31775987859592225]
    + [0.3426793162026282, 0.3203234967455626, 0.2947372710654005, 0.2689568462795536]
    + [0.2657737299073267, 0.26577372990731796, 0.26577372990730924, 0.2657737299073005]
    + [0.2657737299072918, 0.2657737299072831, 0.2657737299072744, 0.26577372990726567]
    + [0.26577372990725695, 0.26677372990729825]
)
STIFFNESS = {  # in N/m, and samples without contact
    "grows and falls": (300 + 250 * np.sin(N / 90), ()),
    "jumps": (np.where(N // 130 % 2, 900.0, 40.0), range(500, 700)),
    "is gone for a while": (200 * np.sin(N / 70), ()),
    "follows a noise": (500 * np.exp(ANY), range(500, 700)),
}


def sliding_on(name):
    """A finger that moves to and fro over a surface whose stiffness moves."""
    k, off = STIFFNESS[name]
    force = b.stick_slip(X, Input("n", "N"), 0.8, 0.3, Input("k", "N/m"), Input("contact"))
    motion = {"x": 0.03 * np.sin(N / 200), "n": 1 + 0.5 * np.sin(N / 333), "k": k}
    return Scene({"force": force}), motion | {"contact": 1.0 * ~np.isin(N, off)}


GLASS = dc.replace(Plate.paper(measured=True), terms=10)
CLICKS = {"click": "x", "detents": "angle", "friction": "x", "wall": "x", "impact": "x"}
MORE: list[str] = []


def alike(rows):
    """Correct renderings of one kind; one in four of them here, all in make stress."""
    MORE.extend(name for k, name in enumerate(rows) if k % 4)
    return rows


# scene, motion, words of render, and what the report then says somewhere
CORRECT = {
    "a held hand": (
        lambda: squeeze(fingers=1),
        {"x1": np.full(2000, 0.0123)},
        {},
        "no slope can be fitted",
    ),
    **alike(
        {
            f"a held hand that wobbles by {by}": (
                lambda: squeeze(fingers=1),
                {"x1": 1 / 3 + by * np.sin(N / 50)},
                {},
                "",
            )
            for by in (1e-18, 1e-9)
        }
    ),
    "the start of a narrow band": (
        lambda: Scene({"y": b.bandpass(X, 100.0, 101.0, 12)}),
        {"x": ANY[:800]},
        {},
        "",
    ),
    "a loop behind a gate": (
        a_loop_behind_a_gate,
        {"x": np.repeat([0.0, 1.0, 0.0], 3000)},
        {},
        "generator",
    ),
    **alike(
        {
            f"a springpot of {horizon} s, {scheme}": (
                lambda scheme=scheme, horizon=horizon: Scene(
                    {"f": springpot(Y, 3.0, 0.4, scheme, 1e-10, horizon)}
                ),
                {"y": minimum_jerk()},
                {"fs": 1000, "seconds": min(horizon, 0.5)},
                "Springpot: physical law" if horizon == 3.0 else "",
            )
            for scheme, horizon in (("gl", 0.008), ("l1", 0.1), ("gl", 3.0), ("l1", 3.0))
        }
    ),
    **alike(
        {
            f"a springpot of {alpha} and a dashpot whose tail is cut off": (
                lambda alpha=alpha: Scene({"f": springpot_series(Y, 25.0, alpha, b=2.0)}),
                {"y": minimum_jerk()},
                {"fs": 1000, "seconds": 0.1},
                "",
            )
            for alpha in (0.6, 0.9)
        }
    ),
    **alike(
        {
            f"a springpot of {alpha} at {fs} Hz to {tol}": (
                lambda alpha=alpha, tol=tol: s.viscoelastic(alpha, tol=tol),
                {"y": minimum_jerk()},
                {"fs": fs, "seconds": 0.05},
                "full sum",
            )
            for alpha, fs, tol in ((0.5, 192000, 1e-10), (0.9, 96000, 1e-10), (0.5, 8000, 1e-13))
        }
    ),
    **alike(
        {
            f"noise that ran before sample 0 behind {name}": (
                lambda gate=gate: gated(gate, white_noise(seed=1)),
                {},
                {"seconds": 0.3},
                "",
            )
            for name, gate in {
                "a parameter": Param("g", 1.0),
                "a comparison": b.nonzero(Param("g", 1.0)),
                "a noise": white_noise(seed=2) > 0.0,
                "a number": constant(2.0),
            }.items()
        }
    ),
    **alike(
        {
            f"an oscillator that noise moves behind a gate, {n} samples": (
                lambda: gated(Input("x"), moved_by_noise()),
                {"x": np.where(np.arange(n) % 7 > 0, 1.0, 0.0)},
                {},
                "y: noise as displayed",
            )
            for n in (16, 2400)
        }
    ),
    **alike(
        {
            f"bumps on a carrier of {freq} Hz at {speed} m/s": (
                lambda freq=freq: bumps(freq=freq),
                {"x": constant_speed(speed, 0.1)},
                {"seconds": 0.5},
                "",
            )
            for freq, speed in ((0.0, 0.02), (0.0, 5.0), (1e-9, 0.02), (157.9, 5.0), (3999.0, 0.02))
        }
    ),
    **alike(
        {  # a groove was taken for the next ridge
            f"a finger at {x!r} that rests on or beside an edge, {wave}": (
                lambda wave=wave: bumps(wave, 1, length=1.0),
                {"x": np.full(300, x)},
                {},
                "",
            )
            for wave in ("square", "sawtooth", "sine")
            for x in (np.nextafter(2.0, 0), 1.5, np.nextafter(1.0, 3))
        }
    ),
    **alike(
        {  # -0.1 x 6/0.1 is -6, and (-0.1 x 6)/0.1 is not: the law has the scene's rounding
            f"a finger on the edge at -0.1 m, {name}": (make, {"x": np.full(400, -0.1)}, {}, "")
            for name, make in {
                "bumps": bumps,
                "plate": lambda: touch_screen("square", rectify="half"),
            }.items()
        }
    ),
    **alike(
        {
            f"a finger that trembles by a rounding over an edge, {wave}": (
                lambda make=make, wave=wave: make(wave, bumps=0.06, length=0.1, duty=0.06),
                {"x": 1e-12 * np.cumsum(ANY)},
                {},
                "",
            )
            for make, wave in ((bumps, "sine"), (touch_screen, "square"))
        }
    ),
    **alike(
        {  # beyond its bounds: the nearest one
            f"a duty of {duty}, {wave}": (
                lambda make=make, wave=wave: make(wave, amplitude=0.4),
                {"x": constant_speed(0.03, 0.1)},
                {"fs": 48000, "seconds": 0.1, "params": {"duty": duty}},
                "voltage",
            )
            for make, wave, duty in (
                (bumps, "square", 0.0),
                (bumps, "sawtooth", 1e-9),
                (bumps, "half_sine", 2.0),
                (touch_screen, "sine", 1e-9),
                (touch_screen, "half_sine", -1.0),
            )
        }
    ),
    **alike(
        {
            f"a plate whose carrier is rectified: {rectify}": (
                lambda rectify=rectify: touch_screen(rectify=rectify, amplitude=0.1),
                {"x": constant_speed(0.03, 0.1)},
                {"fs": 48000, "seconds": 0.1},
                "every stage",
            )
            for rectify in (None, "half", "full")
        }
    ),
    **{  # each of a law of its own
        f"a plate of {words}": (
            lambda words=words: touch_screen(model=GLASS, **words),
            {"x": minimum_jerk(depth=0.1, rise=0.3)},
            {"seconds": 0.5, "params": {"duty": 0.4}},
            "voltage: every stage" if "finger" in words else "displacement: sum over",
        )
        for words in (
            {},
            {"swap": 1.0, "rectify": "half", "waveform": "sawtooth"},
            {"waveform": "square", "amplitude": 3.0},
            {"finger": True},
        )
    },
    **{  # the sign of the amplitude does not count, up to e^2 = 0.98
        f"ultrasound of {A} V under {normal} N": (
            lambda: s.ultrasonic_friction(contact=True, duty=0.3, q=300.0),
            {"x": sinusoid(0.05, 1.5), "contact": lambda t: 1.0 * (np.sin(9 * t) > -0.5)},
            {"seconds": 0.5, "params": {"A": A, "normal": normal, "duty": 0.6}},
            "written again",
        )
        for A, normal in ((12.0, 0.7), (-150.0, 200.0))
    },
    **{
        f"{name} over lifts": (
            lambda make=make: make(contact=True),
            {CLICKS[name]: motion, "contact": lambda t: 1.0 * (np.sin(37 * t) > -0.6)},
            {"fs": 4000, "seconds": 0.3, "params": params},
            "written again",
        )
        for name, make, motion, params in (
            ("click", s.click, sinusoid(1.3e-3, 3.0, 1e-3), {"peak": 1.5}),
            ("detents", s.detents, sinusoid(1.0, 2.0), {"depth": 0.03}),
            ("friction", s.friction, sinusoid(0.02, 2.0), {"normal": 0.7}),
            ("wall", s.wall, sinusoid(2e-3, 5.0), {"b": 3.0}),
            ("impact", s.impact, sinusoid(5e-3, 3.0), {"A": 7.0}),
        )
    },
    "a plate beyond its edge": (
        touch_screen,
        {"x": sinusoid(0.01, 3.0, 0.8)},
        {"seconds": 0.3},
        "",
    ),
    **alike(
        {
            f"a texture at rest at {x} m": (
                s.texture,
                {"x": np.full(2000, x), "force": np.full(2000, 10 * x)},
                {"fs": 4000, "seed": 1},
                "",
            )
            for x in (0.0, 0.1)
        }
    ),
    "a vibration that decays within a sample": (
        lambda: s.impact(decay=5e-4, freq=190.0, cutoff=50.0),
        {"x": sinusoid(5e-3, 10.0)},
        {"fs": 500, "seconds": 0.5},
        "",
    ),
    "a mode far below the rate, with no frequency of the law at its resonance": (
        lambda: Scene({"y": b.mode(Input("x"), 5.0, 7.0)}),
        {"x": ANY},
        {"fs": 44100},
        "Mode: physical law",
    ),
    "a thousand events, of which two coincide": (
        lambda: Scene({"y": b.at(np.r_[np.arange(1000) / 1000, 0.05])}),
        {},
        {"fs": 1000, "seconds": 0.1},
        "At",
    ),
    **alike(
        {
            f"a gated noise in {name}, which begins at sample 0": (
                lambda make=make: gated(X, make(white_noise(seed=1))),
                {"x": np.where(N % 500 > 30, 1.0, -1.0)},
                {},
                "what begins at sample 0 is in it",
            )
            for name, make in {
                "an integral": lambda x: b.integrate(x, leak=5.0),
                "a steady low-pass": lambda x: b.lowpass(x, 100.0, onset="steady"),
                "a limit of its slope": lambda x: b.slew_limit(x, 10.0),
                "a velocity": b.velocity,
                "a springpot": lambda x: b.springpot(x, 1.0, 0.3),
            }.items()
        }
    ),
    **alike(
        {  # what leaks from the pass band was taken for the noise in the stop band
            f"a gated noise in {name}, open for {n} samples at a time": (
                lambda make=make: gated(X, make(white_noise(seed=1))),
                {"x": np.where(np.arange(8 * n) % (2 * n) > n, 1.0, -1.0)},
                {},
                "",
            )
            for n in (1000, 60)
            for name, make in {
                "a high-pass": lambda x: b.highpass(x, 1000.0, 12),
                "a band-stop": lambda x: b.bandstop(x, 100.0, 300.0, 4),
                "a low-pass": lambda x: b.lowpass(x, 200.0, 4),
                "a low low-pass": lambda x: b.lowpass(x, 5.0, 12),
            }.items()
        }
    ),
    "a gated noise of a slope, whose density depends on its design": (
        lambda: gated(X, b.coloured_noise(2.0, seed=3, f_low=20.0)),
        {"x": np.where(N % 500 > 30, 1.0, -1.0)},
        {},
        "no law of all its blocks is known",
    ),
    "an impact while the velocity still falls": (
        s.impact,
        {"x": np.r_[np.full(50, 5e-3), -1e-6, np.full(100, 1e-6)]},
        {"fs": 2000},
        "impacts: 1, of up to 0 m/s",
    ),
    "a mouse that jumps over pieces of the map": (
        lambda: soft_surface(device="mouse"),
        {"x": JUMPS[0], "y": JUMPS[1]},
        {"fs": 4000},
        "too long",
    ),
    "a course and a level far slower than the run": (
        lambda: Scene(
            {
                "course": b.timeline([(0.0, 0.0), (100.0, 1.0)], "cosine"),
                "level": b.envelope_follower(X, 10.0),
            }
        ),
        {"x": np.ones(400)},
        {},
        "",
    ),
    "the first two samples of a slow pulse": (
        lambda: s.pulse(duration=0.4, ramp=0.1, period=0.6),
        {},
        {"fs": 192000, "seconds": 1e-5},
        "",
    ),
    "outputs named as taps": (lambda: taps("tap0"), {"x": np.ones(500)}, {}, ""),
    "outputs named as gates": (lambda: taps("gate0"), {"x": np.ones(500)}, {}, ""),
    **alike(
        {
            f"an answer {n} samples late": (
                lambda n=n: Scene({"y": b.delay(Input("x"), n)}),
                {"x": np.linspace(0.0, 1.0, 500)},
                {},
                "Delay: impulse response",
            )
            for n in (4095, 4096, 9000)
        }
    ),
    "pulses of a quarter of the rate, each on a sample": (
        lambda: Scene({"y": b.pulse_train(2000.0)}),
        {},
        {"seconds": 0.01},
        "PulseTrain",
    ),
    "an answer later than is waited for": (
        lambda: Scene({"y": b.delay(Input("x"), 2_200_000)}),
        {"x": np.linspace(0.0, 1.0, 500)},
        {},
        "never settles",
    ),
    "a hand in steps of 0.1 mm over teeth of 0.3 mm": (
        s.friction,
        {"x": lambda t: 1e-4 * np.round(100 * np.sin(5 * t))},
        {"fs": 1000, "seconds": 2.0},
        "written again",
    ),
    **alike(
        {
            f"a slip within {way} m at {start} m": (
                sticky,
                {"x": slips(start, way), "n": n},
                {"fs": 1000},
                "StickSlip",
            )
            for start in (-0.012, -0.0119, 0.3)
            for way, n in (
                (0.0, np.ones(10)),
                (3e-16, SHRINKS),
                (6.76e-15, np.ones(10)),
                (1e-13, SHRINKS),
                (1e-9, np.ones(10)),
            )
        }
    ),
    "a turn at the limit, where the law slips by rounding and the block does not": (
        sticky,
        {"x": np.array([-0.0125, -0.0051, -0.0045, -0.0045, -0.0055]), "n": np.ones(5)},
        {"fs": 1000},
        "StickSlip",
    ),
    "slips whose place is a rounding, after a way": (
        sticky,
        {"x": WANDERS, "n": np.ones(WANDERS.size)},
        {"fs": 1000},
        "StickSlip",
    ),
    **alike(
        {
            f"slips over a stiffness that {name}": (
                lambda name=name: sliding_on(name)[0],
                sliding_on(name)[1],
                {"fs": 1000},
                "StickSlip",
            )
            for name in STIFFNESS
        }
    ),
    **alike(
        {  # slips without number, and a wall of 0
            f"{make.__name__} of {params}": (
                make,
                {"x": HAND},
                {"seconds": 0.05, "params": params},
                "written again",
            )
            for make, params in (
                (s.wall, {"k": -1.0}),
                (s.wall, {"b": -1.0}),
                (s.wall, {"k": 0.0, "b": 2.0}),
                (s.friction, {"normal": 1e-320}),
                (s.friction, {"normal": 1e-200}),
                (s.friction, {"normal": 1e-9}),
            )
        }
    ),
    **alike(
        {  # two integrals that nearly cancel lost 1.05 tolerances
            f"detents over {way} rad a sample": (
                lambda: s.detents(count=5, friction=1e-3),
                {"angle": 3.0 + way * np.arange(3000.0)},
                {"fs": 4000},
                "Detents",
            )
            for way in (1e-13, 1e-12, 9e-12, 1.01e-11, 1e-10)
        }
    ),
    **alike(
        {
            f"a hand held on an edge of {name} that wobbles by {wobble}": (
                s.SHIPPED[name],
                {x: place + wobble * np.sin(N[:400] / 5)},
                {"fs": 2000},
                "",
            )
            for name, x in CLICKS.items()
            for place, wobble in ((0.0, 1e-18), (1e-3, 0.0), (0.8e-3, 1e-12))
        }
    ),
    **alike(
        {  # numbers that happen to be equal
            f"bumps of {words}": (
                lambda words=words: bumps(**words),
                {"x": sinusoid(0.05, 1.0)},
                {"seconds": 0.3},
                "envelope times carrier",
            )
            for words in ({"bumps": 5}, {"gain": 1.0}, {"bumps": 0.1})
        }
    ),
    "bumps of no amplitude": (
        lambda: bumps(amplitude=0.0),
        {"x": constant_speed(0.02, 0.1)},
        {"seconds": 0.5},
        "envelope times carrier",
    ),
    "a springpot of the thesis' own methods": (
        lambda: s.viscoelastic(0.5, scheme="gl-short-memory"),
        {"y": HAND},
        {"fs": 1000, "seconds": 1.0},
        "schemes",
    ),
    "a springpot of another order": (
        lambda: s.viscoelastic(0.25),
        {"y": HAND},
        {"fs": 1000, "seconds": 0.3},
        "as strong at 1 Hz as 300 N/m",
    ),
    **alike(
        {
            f"a grating under {motion}": (
                grating,
                {"x": motion},
                {"seconds": 0.5, "params": {"roughness": 0.1}},
                "force: octaves of the roughness",
            )
            for motion in (constant_speed(0.03, 0.1), minimum_jerk(depth=0.1, rise=0.5))
        }
    ),
    "a limited squeeze within its limits": (
        lambda: squeeze(fingers=1, limits=True),
        {"x1": minimum_jerk()},
        {"seconds": 0.5},
        "held to 100 N peak and 37 N static",
    ),
    "a limited squeeze beyond its limits": (
        lambda: squeeze(fingers=1, limits=True),
        {"x1": ramp_and_hold(0.06, 0.3)},
        {"seconds": 2.0},
        "it was limited",
    ),
    "bumps in a limited voltage": (
        lambda: bumps("sine", 18, 0.5, limit=150.0, displacement=SEEN, headroom="scale"),
        {"x": constant_speed(0.05, 0.12)},
        {"seconds": 0.5},
        "equalised by 5 measured places (polynomial)",
    ),
}


@pytest.mark.filterwarnings("ignore:touch_screen.* are held")
@pytest.mark.parametrize("name", mostly(CORRECT.keys() - MORE, CORRECT))
def test_a_correct_rendering_passes(name):
    make, motion, words, says = CORRECT[name]
    r = report(make(), motion, **words)
    assert r.passed, str(r)
    assert says in "; ".join([c.name for c in r.checks] + r.evidence.numbers + r.evidence.skipped)


# Noise, ramps, sources ----------------------------------------------------------------
def test_a_long_rest_and_one_squeeze_pass_and_the_slope_is_recovered():
    """The noise is then in few samples, so the deviation of the slope is not that of
    noise spread evenly.
    """
    x = np.r_[np.zeros(40000), minimum_jerk()(np.arange(2400) / 8000)]
    apart = []
    for seed in range(20) if STRESS else (0, 1, 2, 8):  # 8: a gate opens within a late span
        r = report(squeeze(fingers=1), {"x1": x}, seed=seed)
        assert r.passed, str(r)
        apart += [c.measured / c.limit for c in r.checks if "slope" in c.name]
    # 5 deviations are the limit; frequencies below the pink band count too much
    assert 0.02 < np.std(apart) < 0.25


def test_springpots_are_proved_at_every_order_rate_and_tolerance():
    """900 designs, the law against the discrete response; 139 were refused when both
    subtracted numbers that nearly cancel.
    """
    worst, some = 0.0, 1 if STRESS else 3
    rates = np.array([1000.0, 8000.0, 48000.0, 96000.0, 192000.0])
    for alpha in np.r_[0.0, 0.01, 0.05, 0.1:1:0.1, 0.95, 0.99, 1.0][::some]:
        for tol in (1e-6, 1e-8, 1e-10, 1e-12, 1e-13, 1e-14)[::some]:
            for horizon in (60.0, 86400.0)[-3 + some :]:
                root = springpot(Input("y"), 1.0, float(alpha), "gl", tol, horizon)
                pot = next(v for v in reach([root]) if isinstance(v, Springpot))
                for fs in rates[::some]:
                    p, _ = pot.design(fs)
                    for law in pot.laws(fs):
                        off = law.error(
                            lambda f, p=p, fs=fs: Springpot.transfer(
                                p, np.exp(2j * np.pi * f / fs)
                            ),
                            fs,
                        )
                        worst = max(worst, off / law.tol)
    assert 0 < worst < 0.1


@pytest.mark.filterwarnings("ignore:.*sample 0:RuntimeWarning")
def test_a_scene_that_is_not_finite_from_the_first_sample_on_is_told():
    x = Input("x")
    r = report(Scene({"y": b.lowpass(x, 50.0, onset="steady") / (x - x)}), {"x": np.ones(5)})
    assert [c.name for c in r.checks if not c.passed] == ["no fault"], str(r)
    assert any("is not finite at sample 0" in text for text in r.evidence.skipped)


def written(path, scene, motion, seconds, changes, fs=8000):
    """The report of a file whose parameters move from the first sample on."""
    proc = stimlib.compile(scene, fs)
    for change in changes:
        proc.set(*change)
    file.write(path, proc, motion, seconds, progress=False)
    return stimlib.verify(scene, motion, path)


@pytest.mark.parametrize(
    "changes", [[("A", 7.0, 0.3), ("k", 500.0, 0.1), ("A", 2.0, 0.2)], [("k", 900.0, 0.0)]]
)
def test_files_whose_numbers_ramp_from_the_first_sample_pass(tmp_path, changes):
    """The law follows the ramps that the sidecar tells, from where the scene begins."""
    r = written(tmp_path / "a.wav", squeeze(fingers=1), {"x1": minimum_jerk()}, 0.5, changes)
    assert r.passed, str(r)
    assert any(c.name.endswith("vibration law") for c in r.checks)


@pytest.mark.parametrize(
    ("make", "name", "fs"),
    [
        (grating, "depth", 2000),
        pytest.param(grating, "depth", 8000, marks=pytest.mark.stress),
        pytest.param(lambda: soft_surface(device="mouse"), "push", 8000, marks=pytest.mark.stress),
    ],
)
def test_a_ramp_of_a_minute_whose_roundings_add_up_passes(tmp_path, make, name, fs):
    """Its 480 000 steps lost up to 8e-12 of the largest value, and both laws and that
    of a parameter allowed 1e-12.
    """
    motion = dict.fromkeys(make().inputs, sinusoid(0.02, 1.0))
    assert written(tmp_path / "a.wav", make(), motion, 60.0, [(name, 0.123, 60.0)], fs).passed


# Statistics ---------------------------------------------------------------------------
@pytest.mark.parametrize("n", mostly({10}, [10, 40, 300]))
def test_p_values_are_those_of_the_hypothesis(n):
    """Of streams of the model; normal tails were wrong by a factor of 14 at 1e-4."""
    rng, count = np.random.default_rng(n), 20000 if STRESS else 3000
    weights, _ = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1, 1, n), 3))
    trend, pair = [], []
    for _ in range(count):
        one, other = (rng.standard_normal((2, n)) + 1j * rng.standard_normal((2, n))) / np.sqrt(2)
        trend.append(spectra.weighted_p(weights[:, 1], np.abs(one) ** 2))
        pair.append(spectra.correlated_p(one, other)[1])
    for p in (trend, pair):
        assert stats.binomtest(int(np.sum(np.array(p) < 1e-3)), count, 1e-3).pvalue > 1e-3
