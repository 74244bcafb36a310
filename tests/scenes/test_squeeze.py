"""The two-finger squeeze against a second one, written by hand from the UGrip paper
without blocks; and what it promises.
"""

import dataclasses

import numpy as np
import pytest
from laws import assert_same, mostly
from refusals import refused, warned
from scipy.interpolate import PchipInterpolator
from scipy.signal import lfilter
from scipy.special import lambertw
from trials import pair

import stimlib
from stimlib import BadValue, Scene, blocks as b
from stimlib.blocks.actuator import PLACEHOLDER_GAMMA
from stimlib.blocks.fir_filters import Differentiator
from stimlib.blocks.impedance import Loading
from stimlib.blocks.noise import PinkNoise
from stimlib.checks import laws
from stimlib.motion import minimum_jerk, ramp_and_hold, recording
from stimlib.scenes import squeeze

TAU = 1 / 8000  # the paper's sample period
LEVEL = 9.0  # the default of the noise


# The witness: numpy, scipy and the published generator --------------------------------
def witness(
    x, fs, stream, k, A, poles, r, d, q, taps, on, off, cutoff=100.0, seed=0, run=0, lead=256
):
    """F = k x + A level (k tau v)(tau dp/dt) while v, from two poles, is loading; noise
    runs on the loading samples only.
    """
    n = laws.white(run, seed, stream, -lead, lead + x.size)
    p = d * n + sum(
        rk * lfilter([1], [1, -pk], n, zi=[pk * qk])[0]
        for pk, rk, qk in zip(poles, r, q, strict=True)
    )
    dp = np.convolve(p, taps)[lead : lead + x.size]
    pole = np.exp(-2 * np.pi * cutoff / fs)
    v = np.diff(x, prepend=x[0]) * fs
    for _ in range(2):
        v = lfilter([1 - pole], [1, -pole], v)
    gate, loading = np.zeros(x.size, bool), False
    for i, now in enumerate(v):
        loading = now > (off if loading else on)
        gate[i] = loading
    noise = np.zeros(x.size)
    noise[gate] = dp[: gate.sum()]
    return k * x + A * LEVEL * (k * TAU * v) * (TAU * noise)


# --------------------------------------------------------------------------------------
def data_of(proc, finger):
    """The designed numbers of one finger, as plain arrays."""
    of = {}
    for q, (p, s) in zip(proc.program.instances, proc.design, strict=True):
        if isinstance(q.block, PinkNoise) and q.kind == "block" and q.block.white.stream == finger:
            used = p.r != 0
            of |= {
                "poles": p.p[used],
                "r": p.r[used],
                "d": p.d,
                "q": q.block.start(p, s, proc.seed).q[used],
            }
        if isinstance(q.block, Differentiator):
            of["taps"] = p.taps[::-1][: int(p.order) + 1]
        if isinstance(q.block, Loading):
            of |= {"on": p.on, "off": p.off}
    return of


def fingers(fs, seconds):
    t = np.arange(int(seconds * fs)) / fs
    one = 0.015 * (1 - np.cos(2 * np.pi * 1.7 * t))
    other = np.interp(t, [0, 0.1, 0.3, 0.5, 0.8, seconds], [0, 0, 0.02, 0.02, 0.005, 0.04])
    return np.round(np.stack([one, other]) * 1e6) / 1e6


@pytest.mark.parametrize(("fs", "seed", "run"), [(8000.0, 2**63 + 7, 2**40 + 3), (48000.0, 5, 1)])
def test_an_independent_squeeze_gives_the_same_force(fs, seed, run):
    x, given = fingers(fs, 1.2), {"seed": seed, "run": run, "lead": max(256, round(0.032 * fs))}
    proc = stimlib.compile(squeeze(k=1700.0, A=2.9, seed=seed), fs, seed=run)
    f = np.geomspace(20, 900, 50)
    for i, force in enumerate(proc.process(x)):
        chain = data_of(proc, i + 1)
        modes = chain["r"] / (1 - chain["poles"] * np.exp(-2j * np.pi * f[:, None] / fs))
        density = 2 / fs * np.abs(chain["d"] + np.sum(modes, axis=1)) ** 2
        np.testing.assert_allclose(density, 1 / (np.pi * f), rtol=2.4e-3)  # 0.01 dB
        mine = witness(x[i], fs, i + 1, 1700.0, 2.9, **chain, **given)
        vibration = np.abs(mine - 1700.0 * x[i]).max()
        assert vibration > 0.05
        assert np.abs(force - mine).max() <= 1e-12 * np.abs(mine).max()
        assert np.abs(force - mine).max() <= 1e-10 * vibration + 1e-14


def expected_rms(fs, v, k=2000.0, A=3.4):
    """From the response of the noise chain: the pass band, and what the transition band
    lets through.
    """
    chain = Scene({"dp": b.differentiator(b.pink_noise(1 / np.pi, 0, f_low=10.0), passband=1000.0)})
    proc = stimlib.compile(chain, fs, "python")
    f = np.linspace(0, fs / 2, 40001)[1:-1]
    density = np.abs(proc.response("dp", "white(0, 0)", f)) ** 2 * 2 / fs
    inside = f <= 1000
    step = f[1] - f[0]
    return [
        A * LEVEL * k * TAU * v * TAU * np.sqrt(np.sum(density[band]) * step)
        for band in (inside, slice(None))
    ]


@pytest.mark.parametrize("fs", mostly([8000.0], [8000.0, 48000.0]))
def test_the_vibration_has_the_level_of_the_paper_at_any_rate(fs):
    band, total = expected_rms(fs, 0.1)
    assert band == pytest.approx(
        3.4 * LEVEL * 2000 * TAU * 0.1 * TAU * np.pi * 1000 * np.sqrt(2 / np.pi), rel=2e-3
    )
    assert band == pytest.approx(0.24, rel=0.02)
    proc = stimlib.compile(squeeze(fingers=1), fs)
    x = 0.1 * np.arange(int(30 * fs)) / fs
    vibration = (proc.process(x[None])[0] - 2000 * x)[int(0.1 * fs) :]
    assert np.sqrt(np.mean(vibration**2)) == pytest.approx(total, rel=0.01)
    spectrum = np.fft.rfft(vibration)
    spectrum[int(1000 * vibration.size / fs) :] = 0
    assert np.sqrt(np.mean(np.fft.irfft(spectrum, vibration.size) ** 2)) == pytest.approx(
        0.24, rel=0.02
    )


@pytest.mark.parametrize(
    ("fs", "rate"), [(8000.0, 1), (8000.0, 37), (48000.0, 250), (8000.0, 3999)]
)
def test_a_held_position_is_silent_whatever_the_last_bit_does(fs, rate):
    t = np.arange(int(fs)) / fs
    toggle = 0.01 + 1e-6 * (np.floor(2 * rate * t) % 2)
    x = np.stack([toggle, 0.01 + 1e-6 * np.random.default_rng(rate).integers(0, 2, t.size)])
    assert_same(stimlib.compile(squeeze(), fs).process(x), 2000 * x)


def test_a_slow_squeeze_sounds_and_a_release_does_not():
    x = np.round(0.005 * (np.arange(8000) / 8000) * 1e6) / 1e6
    proc = stimlib.compile(squeeze(), 8000)
    y = proc.process(np.stack([x, 0.02 - x])) - 2000 * np.stack([x, 0.02 - x])
    assert np.mean(y[0, 400:] != 0) > 0.99
    assert not y[1].any()


def test_noise_is_skipped_at_A_0_and_A_k_and_level_are_live():
    x = np.tile(0.1 * np.arange(4000) / 8000, (2, 1))
    on = stimlib.compile(squeeze(), 8000).process(x)
    proc = stimlib.compile(squeeze(A=0.0), 8000)
    fresh = proc.state
    assert_same(proc.process(x), 2000 * x)
    # a stream's index at sample 0 is among these
    white_at = [k for k in range(2, fresh.size) if fresh[k] == 0]
    assert (proc.state[white_at] == 4000).sum() == 2, "only the two guards have counted"
    first, last = np.ascontiguousarray(x[:, :2000]), np.ascontiguousarray(x[:, 2000:])
    for name, value, factor in (
        ("A", 0.0, 0.0),
        ("level", 0.5 * LEVEL, 0.5),
        ("A", 6.8, 2.0),
        ("k", 1000.0, 0.5),
    ):
        proc = stimlib.compile(squeeze(), 8000)
        assert_same(proc.process(first), on[:, :2000])
        proc.set(name, value, ramp=0.0)
        y = proc.process(last) - (value if name == "k" else 2000.0) * last
        np.testing.assert_allclose(y, factor * (on - 2000 * x)[:, 2000:], rtol=1e-9, atol=1e-13)


def test_each_finger_and_each_run_has_its_own_noise():
    x = np.tile(0.1 * np.arange(80_000) / 8000, (2, 1))
    proc = stimlib.compile(squeeze(), 8000)
    runs = []
    for seed in (0, 1):
        proc.reset(seed)
        runs += list(proc.process(x) - 2000 * x)
    runs.append((stimlib.compile(squeeze(seed=1), 8000).process(x) - 2000 * x)[0])
    assert np.abs(np.corrcoef(np.array(runs)[:, 800:]) - np.eye(5)).max() < 0.05


def test_a_rate_that_is_too_high_for_the_differentiator_says_so():
    assert stimlib.compile(squeeze(fingers=1), 500_000).latency
    says = "differentiator: .* up to 1000 Hz takes an order above 8192 at fs = 1e.06 Hz; lower fs"
    refused(stimlib.BadValue, says, stimlib.compile, squeeze(fingers=1), 1e6)


def test_units_and_latencies():
    proc = stimlib.compile(squeeze(), 8000)
    assert set(proc.units.values()) == {"m", "N", "N/m", "1"}
    for i in (1, 2):
        assert proc.latency[f"force{i}", f"white(0, {i})"] == (64, 64)
        assert proc.latency[f"force{i}", f"x{i}"] == (0, pytest.approx(25, abs=0.1))
        assert (f"force{i}", f"x{3 - i}") not in proc.latency


# Other impedances, contact, travel, and the time in which the gate closes -------------
MEMORY = 0.05
OTHERS = {
    "springpot": lambda x: b.springpot(x, 300.0, 0.5),
    "maxwell": lambda x: b.maxwell(x, 2000.0, 20.0),
    "kelvin_voigt": lambda x: b.kelvin_voigt(x, 1500.0, 5.0),
    "spring": lambda x: b.spring(x, 2000.0),
}


def remembered(v):
    return b.constant(0.25, "N*s/m") * b.first_order(v, MEMORY)


def press(depth=0.02):
    return {"x1": minimum_jerk(depth=depth), "x2": minimum_jerk(depth=0.01)}


@pytest.mark.parametrize("name", OTHERS)
def test_another_impedance_takes_the_place_of_the_spring(name):
    Z = OTHERS[name]
    y = stimlib.render(squeeze(Z_c=Z), press(), 8000, 0.5)
    alone = stimlib.render(
        Scene({"F": Z(stimlib.Input("x1", "m"))}), {"x1": press()["x1"]}, 8000, 0.5
    )
    spring = stimlib.render(squeeze(), press(), 8000, 0.5)
    vibration = spring["force1"] - 2000 * press()["x1"](y.t)
    np.testing.assert_allclose(y["force1"] - alone["F"], vibration, atol=2e-12)
    assert np.abs(vibration).max() > 0.05
    assert stimlib.verify(y.scene, press(), y).passed
    if name == "spring":
        assert np.array_equal(y.y, spring.y)


def test_another_impedance_of_the_noise_gives_it_a_memory():
    """And none needs k where both are others."""
    assert list(squeeze(fingers=1, Z_c=OTHERS["maxwell"], Z_n=remembered).params) == ["A", "level"]
    scene, motion = squeeze(fingers=1, Z_n=remembered), {"x1": lambda t: 0.1 * np.minimum(t, 0.2)}
    y = stimlib.render(scene, motion, 8000, 0.4)
    spring = stimlib.render(squeeze(fingers=1), motion, 8000, 0.4)
    F, f = (r["force1"] - 2000 * motion["x1"](y.t) for r in (y, spring))
    moving = (y.t > 0.03) & (y.t < 0.19) & (np.abs(f) > 1e-3)
    want = 1 - np.exp(-(y.t - 1 / (np.pi * 100)) / MEMORY)  # the velocity is late by 3.2 ms
    assert moving.sum() > 1000
    np.testing.assert_allclose(F[moving] / f[moving], want[moving], rtol=0.02)
    report = stimlib.verify(scene, motion, y)
    (law,) = [c for c in report.checks if c.name == "force1: vibration law"]
    assert report.passed and law.text == "A Z_n(v) tau dp/dt, relative"


def test_as_printed_the_vibration_grows_with_the_position():
    """r = Z_n v with Z_n = k/s, where the default has k tau v: the same noise, times x
    over tau v.
    """
    motion = {"x1": lambda t: 0.1 * np.minimum(t, 0.2)}
    made = squeeze(fingers=1, as_printed=True)
    y, spring = (stimlib.render(s, motion, 8000, 0.3) for s in (made, squeeze(fingers=1)))
    x = motion["x1"](y.t)
    pole = np.exp(-2 * np.pi * 100 / 8000)
    v = np.diff(x, prepend=0.0) * 8000
    for _ in range(2):
        v = lfilter([1 - pole], [1, -pole], v)
    F, f = y["force1"] - 2000 * x, spring["force1"] - 2000 * x
    np.testing.assert_allclose(F * TAU * v, f * x, atol=1e-12)
    assert np.abs(F).max() > 500 * np.abs(f).max()
    assert stimlib.verify(made, motion, y).passed
    bad = Scene(squeeze(fingers=1).outputs, made.parts)
    assert not stimlib.verify(bad, motion, stimlib.render(bad, motion, 8000, 0.3)).passed
    refused(BadValue, "leave Z_n out", squeeze, as_printed=True, Z_n=remembered)


@pytest.mark.parametrize("wrong", [1.001, -1.0])
@pytest.mark.parametrize("which", ["Z_c", "Z_n"])
def test_another_impedance_than_was_asked_for_is_refused(which, wrong):
    asked = {"Z_c": OTHERS["maxwell"], "Z_n": remembered}
    made = asked | {which: lambda s: wrong * asked[which](s)}
    bad = Scene(squeeze(fingers=1, **made).outputs, squeeze(fingers=1, **asked).parts)
    motion = {"x1": press()["x1"]}
    report = stimlib.verify(bad, motion, stimlib.render(bad, motion, 8000, 0.5))
    names = {c.name for c in report.checks if not c.passed}
    assert "force1: vibration law" in names
    assert ("force1: mean part is the force of Z_c" in names) == (which == "Z_c")


def test_a_parameter_of_an_impedance_is_held_in_each_interval_of_a_trial():
    """It was set before the interval begins, which has a clock of its own."""
    soft = squeeze(fingers=1, Z_c=lambda x: b.spring(x, stimlib.Param("stiff", 900.0, "N/m")))
    scene, params = pair(soft, {"stiff": 1200.0})
    y = stimlib.render(scene, {"x1": press()["x1"]}, 4000, 0.5, params=params)
    report = stimlib.verify(scene, y.motion, y)
    assert report.passed, str(report)
    assert sum("the force of Z_c" in c.name for c in report.checks) == 2


@pytest.mark.parametrize(
    ("error", "says", "words"),
    [
        (stimlib.UnitError, "Z_c gave a block in .m.; return one in N", {"Z_c": lambda x: x}),
        (stimlib.UnitError, r"Z_n gave a block in \[m/s\]", {"Z_n": lambda v: v}),
        (stimlib.BadValue, "Z_c gave 3.0, which is no block", {"Z_c": lambda x: 3.0}),
        (stimlib.BadValue, "Z_c = 3.0 must be a function", {"Z_c": 3.0}),
        (stimlib.BadValue, "travel = 0.0 must be above 0", {"travel": 0.0}),
    ],
)
def test_an_impedance_must_make_a_force(error, says, words):
    refused(error, says, squeeze, **words)


@pytest.mark.parametrize("words", [{}, {"limits": True}, {"Z_c": OTHERS["springpot"]}])
def test_off_contact_the_force_is_0(words):
    scene = squeeze(fingers=1, contact=True, **words)
    motion = {"x1": press()["x1"], "contact": lambda t: 1.0 * (np.sin(40 * t) > -0.3)}
    y = stimlib.render(scene, motion, 8000, 0.5)
    touching = motion["contact"](y.t) > 0
    assert not y["force1"][~touching].any() and (y["force1"][touching][2000:] != 0).all()
    assert stimlib.verify(scene, motion, y).passed
    wrong = np.where(np.arange(y.t.size) == np.flatnonzero(~touching)[-1], 40.0, y.y)
    assert not stimlib.verify(scene, motion, dataclasses.replace(y, y=wrong)).passed


@pytest.mark.filterwarnings("error:.*beyond the travel")
@pytest.mark.parametrize(
    ("depth", "start", "travel", "beyond"),
    [
        (0.05, 0.0, 0.04, True),
        (0.039, 0.0, 0.04, False),
        (0.039, 0.02, 0.04, False),
        (0.05, 0.0, None, False),
    ],
)
def test_a_motion_beyond_the_travel_is_a_warning_and_a_line_of_the_report(
    depth, start, travel, beyond
):
    one = squeeze(fingers=1, travel=travel)
    hand = start + minimum_jerk(depth=depth)(np.arange(3000) / 8000)
    both = Scene.combine(a=one, c=squeeze(fingers=1, travel=0.1, seed=1))
    table = {"t_s": np.arange(3000) / 8000, "x": hand}
    recorded = recording(table, {"x": "x"}, max_speed=None).motion_for(("x",))["x"]
    for scene, name, motion in (
        (one, "x1", hand),
        (both, "a_x1", hand),
        (one, "x1", recorded),
        (one, "x1", lambda t: np.interp(t, *table.values())),
    ):
        given = stimlib.render, scene, dict.fromkeys(scene.inputs, motion), 8000, 0.37
        told = f"{name} moves by .* beyond the travel of 0.04"
        y = warned(RuntimeWarning, told, *given) if beyond else given[0](*given[1:])
        numbers = stimlib.verify(scene, y.motion, y).evidence.numbers
        assert any("beyond the travel of 0.04 m" in n for n in numbers) == beyond


@pytest.mark.parametrize(("depth", "told"), [(0.02, False), (0.025, True)])
def test_a_motion_beyond_the_measured_geometry_is_a_line_of_the_report(depth, told):
    scene = squeeze(fingers=1, motor_constant=10.0, geometry=([0.0, 0.02], [1.0, 0.8]))
    y = stimlib.render(scene, {"x1": minimum_jerk(depth=depth)}, 8000, 0.5)
    numbers = "; ".join(stimlib.verify(scene, y.motion, y).evidence.numbers)
    assert ("x1 is from 0 to 0.025 m, and Gamma is known from 0 to 0.02 m" in numbers) == told


@pytest.mark.parametrize(
    ("fs", "speed", "ms"), [(8000.0, 0.1, 11.9), (48000.0, 0.02, 9.0), (8000.0, 0.005, 6.3)]
)
def test_the_gate_closes_when_the_estimate_has_fallen_to_its_threshold(fs, speed, ms):
    """The estimate of two poles after a stop is v (1 + u) exp(-u), u = 2 pi cutoff t.

    It reaches off at u = -1 - W(-off/(e v)), Lambert's W of the lower branch: the
    figures of docs/reference/scenes/squeeze.rst.
    """
    t = np.arange(int(0.4 * fs)) / fs
    stop = 0.3
    motion = {"x1": speed * np.minimum(t, stop)}
    y = stimlib.render(squeeze(fingers=1), motion, fs)
    sounding = np.flatnonzero(y["force1"] != 2000 * motion["x1"])[-1]
    pole = np.exp(-2 * np.pi * 100 / fs)
    n = np.arange(2000)
    off = 2e-6 * fs * np.max((1 - pole) ** 2 * (n + 1) * pole**n)
    closed = (-1 - lambertw(-off / (np.e * speed), -1).real) / (2 * np.pi * 100)
    assert (sounding + 1) / fs - stop == pytest.approx(closed, abs=2.5 / fs)
    assert closed == pytest.approx(ms / 1000, abs=0.15e-3)


# Forces that the motors can bear, and the current they take -------------------------
FS = 8000


def test_current_is_force_over_motor_constant_and_geometry():
    hand = minimum_jerk(depth=0.03)
    y = stimlib.render(squeeze(fingers=1, motor_constant=9.0), {"x1": hand}, FS, 1.0)
    gamma = PchipInterpolator(*PLACEHOLDER_GAMMA)(hand(y.t))
    np.testing.assert_allclose(y["current1"], y["force1"] / (9.0 * gamma), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("words", "n"), [({"motor_constant": 9.0}, 8000), ({"limits": True}, 4000)]
)
def test_outputs_added_change_no_bit_of_the_force(words, n):
    plain, other = (
        stimlib.render(squeeze(fingers=1, **more), {"x1": minimum_jerk()}, FS, n / FS)["force1"]
        for more in ({}, words)
    )
    np.testing.assert_array_equal(plain, other)


def test_limits_hold_peak_and_static_force():
    hard = ramp_and_hold(0.06, 0.3)  # 120 N held
    free = stimlib.render(squeeze(fingers=1), {"x1": hard}, FS, 30.0)["force1"]
    held = stimlib.render(squeeze(fingers=1, limits=True), {"x1": hard}, FS, 30.0)["force1"]
    assert free.max() == pytest.approx(120.0, abs=1.5)  # with the vibration
    assert np.abs(held).max() <= 100.0
    assert held[-1] < 37.0 and np.abs(np.diff(held[FS:])).max() < 0.05  # falls without a click
