"""Soft objects: the laws of Li et al. (2016) against sequences worked out by hand,
places against scipy.
"""

from itertools import pairwise

import numpy as np
import pytest
from laws import mostly, played
from scipy.interpolate import RectBivariateSpline

import stimlib
from stimlib import BadValue, Input, Scene, UnitError, blocks as b, constant
from stimlib.blocks.soft import next_speed, ratio

X, Y, ZERO = Input("x", "m"), Input("y", "m"), constant(0.0, "m")
RAMP = [[0, 1], [0, 1]], 0.01, 0.01  # S = x / 10 mm


def run(outputs, x, fs=1000.0):
    """Rows of outputs over rows of inputs, sorted by name."""
    return stimlib.compile(Scene(outputs), fs).process(np.atleast_2d(np.asarray(x, float)))


def near(a, want, tol=5e-7):
    np.testing.assert_allclose(a, want, rtol=0, atol=tol)


# The map ------------------------------------------------------------------------------
def test_levels_between_are_those_of_scipy_and_held_at_the_edges():
    rng = np.random.default_rng(1)
    table = rng.uniform(0.4, 0.6, (7, 9))
    spline = RectBivariateSpline(np.linspace(0, 0.06, 7), np.linspace(0, 0.12, 9), table, s=0)
    x, y = rng.uniform(-0.03, 0.15, 400), rng.uniform(-0.02, 0.08, 400)
    x[:3], y[:3] = (0.0, 0.12, 0.06), (0.0, 0.06, 0.03)
    want = spline.ev(np.clip(y, 0, 0.06), np.clip(x, 0, 0.12))
    near(run({"S": b.stiffness_map(X, Y, (table, 0.12, 0.06))}, [x, y])[0], want, 1e-12)
    step = RectBivariateSpline(
        np.arange(4.0), np.arange(6.0), jump := np.repeat([[0, 0, 0, 1, 1, 1]], 4, 0), s=0
    )
    x = np.linspace(0, 5, 200)
    got = run({"S": b.stiffness_map(X, Y, (jump, 5.0, 3.0))}, [x, 0 * x + 1])[0]
    near(got, np.clip(step.ev(1.0, x), 0, 1), 1e-12)  # which swings beyond 0 and 1
    assert got.min() == 0 and got.max() == 1 and step.ev(1.0, x).max() > 1.05


# Eq. (1) ------------------------------------------------------------------------------
def speeds(S):
    out = [1.0]
    for a, s in pairwise(S):
        out.append(next_speed(out[-1], a, s))
    return np.array(out)


def test_eq_1_to_the_letter():
    S = [0, 0, 0.2, 0.2, 0.6, 0.6, 0.2, 0, 1, 0.5, 0, 0]
    v = [
        1,
        1,
        3 / 4,
        3 / 4,
        15 / 56,
        15 / 56,
        75 / 196,
        125 / 294,
        25 / 1176,
        125 / 3528,
        625 / 10584,
        625 / 10584,
    ]
    near(speeds(S), v)
    near(speeds([0.2, 0.6, 0.2])[-1], 25 / 49)  # not reversible
    near(speeds([0.5, 0.5 + 1e-15, 0.5]), 1, 0)  # what a spline rounds is no step
    way = [np.r_[np.linspace(0, 0.6, n + 1), np.linspace(0.6, 0, n + 1)[1:]] for n in (1, 2, 3, 6)]
    # and of the frame rate
    near([speeds(w)[-1] for w in way], [0.625, 0.36982249, 0.25005716, 0.08534846])


def test_the_cursor_of_frames_takes_its_steps_in_frames():
    """Frames of 4 samples; ways of the device by which the cursor comes to S = .2, .6,
    .2 of the ramp, and 1 mm on.
    """
    way = np.cumsum([0, 2, 4 / (3 / 4), -4 / (15 / 56), 1 / (75 / 196)])
    x = run(
        {"x": b.cursor(X, ZERO, RAMP, "frames", frame=0.004, bounds=(0.01, 2.0)).x},
        np.repeat(way * 1e-3, 4),
    )[0]
    near(1000 * x, np.repeat([0, 2, 6, 2, 3], 4), 1e-9)
    x = run(
        {"x": b.cursor(X, ZERO, RAMP, "frames", frame=0.001, bounds=(0.3, 2.0)).x}, 1e-3 * way[:4]
    )[0]
    near(1000 * x[3], 6 - 0.3 * 4 / (15 / 56))


def test_a_cursor_of_frames_has_a_highest_speed_and_begins_anew_after_a_lift():
    def path(touch, way, **words):
        place = b.cursor(X, ZERO, RAMP, "frames", contact=Input("touch"), frame=0.004, **words).x
        return 1000 * played(place, {"touch": touch, "x": way}, target="python")

    way = np.repeat([6, 2, 3], 4) * 1e-3
    # eq. (1) alone: 10/7
    near(path(np.ones(12), way, bounds=(0.3, 1.2)), np.repeat([6, 2, 3.2], 4), 1e-9)
    touch, way = np.ones(16), np.repeat([0, 6, 4, 5], [4, 6, 1, 5]) * 1e-3
    # after a frame at the speed 0.3125; then the next frame is 4 samples after the new
    # start
    touch[9] = 0.0
    near(path(touch, way), np.repeat([0, 6, 4, 5], [4, 6, 4, 2]), 1e-9)


def test_frames_do_not_make_up_for_those_that_a_state_from_elsewhere_missed():
    for block in (
        b.cursor(X, ZERO, RAMP, "frames", frame=0.004),
        b.delay_avatar(X, ZERO, constant(1.0, "N"), "frames", frame=0.004),
    ):
        p, s = block.design(1000.0)
        force = [0.0] * (block.outputs[2:] != ())
        assert block.step(p, s._replace(left=-1e9, cold=0.0), 0.0, 0.0, *force, 1.0)[1].left == 2.5


def test_the_ratio_and_the_mid_point():
    near(ratio(np.array([0, 0.1, 0.2, 0.4, 0.5, 0.6, 0.75, 0.9, 1])),
        [1, 100/121, 15/22, 5/11, 4/11, 25/88, 2/11, 20/209, 1/22])  # fmt: skip
    p = np.cumsum([0, 1, 1, 2, 4, -4, -2, -1, -1]) * 1e-3
    path = 1000 * run({"x": b.cursor(X, ZERO, RAMP).x}, p)[0]
    near(path, [0, 0.916361, 1.695821, 2.973171, 4.829973, 2.973171, 1.695821, 0.916361, 0])
    across = b.cursor(ZERO, Y, (np.transpose(RAMP[0]), 0.01, 0.01)).y
    near(
        1000 * stimlib.compile(Scene({"y": across}), 1000, "python").process(p[None])[0],
        path,
        1e-12,
    )


BUMP_X = np.linspace(-0.03, 0.03, 97)
BUMP = np.repeat(np.exp(-((BUMP_X / 0.005) ** 2) / 2)[None], 2, 0), 0.06, 0.01


@pytest.mark.parametrize("fs", mostly({60.0}, [30.0, 60.0, 1000.0, 8000.0]))
def test_the_reversible_cursor_is_within_its_bound_and_leads_back(fs):
    from scipy.integrate import quad

    def S(x):
        return np.exp(-(((x - 0.03) / 0.005) ** 2) / 2)

    def slopes(x, d=1e-6):
        lo, at, hi = (ratio(S(x + k * d)) for k in (-1, 0, 1))
        return at, (hi - lo) / (2 * d), (hi - 2 * at + lo) / d**2

    def error(x):
        g, g1, g2 = slopes(x)
        return (g1**2 / 12 - g * g2 / 24) / g

    way = quad(lambda x: 1 / ratio(S(x)), 0, 0.06, points=[0.03], epsabs=1e-13)[0]
    n = round(way / (0.1 / fs))
    h = way / n
    p = h * np.r_[np.arange(n + 1), np.arange(n)[::-1]]
    x = run({"x": b.cursor(X, ZERO, BUMP).x}, p, fs)[0]
    table = 2e-6  # of the spline through 97 levels, and of its slopes
    per = h * h * ratio(S(0.06))
    assert x[n] - 0.06 == pytest.approx(
        per * quad(error, 0, 0.06, limit=200)[0], rel=0.1, abs=table
    )
    assert abs(x[n] - 0.06) <= per * quad(lambda x: abs(error(x)), 0, 0.06, limit=200)[0] + table
    near(x[::-1], x, 1e-13)


# Eq. (2) ------------------------------------------------------------------------------
def test_eq_2_and_nothing_without_contact():
    level = [0, 0.1, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.75, 0.8, 0.9, 1]
    want = [
        0.153538,
        0.233868,
        0.288635,
        0.356227,
        0.542603,
        0.826490,
        1.258906,
        1.917559,
        2.366609,
        2.920816,
        4.448972,
        6.776651,
    ]
    near(run({"f": b.press(Input("level"))}, level)[0], [0, *want])
    touched = run({"f": b.press(Input("level"), contact=Input("c"))}, [[1, 1, 0], [0, 0.5, 0.5]])
    near(touched[0], [0.1008, 0.826490, 0])  # the inputs are sorted: contact, level


# Eq. (3) ------------------------------------------------------------------------------
FORCES = [0.2, 0.2, 0.25, 0.35, 0.55, 0.5, 0.3, 0.9, 0.95, 1.05, 0.2, 0.2]
TIMES = [0, 30, 60, 90, 170, 300, 330, 360, 690, 720, 800, 830]  # ms


def test_eq_3_to_the_letter():
    f = np.zeros(860)
    for start, stop, v in zip(TIMES, [*TIMES[1:], 860], FORCES, strict=True):
        f[start:stop] = v
    x = np.arange(860) * 1e-4
    force = Input("f", "N")
    a = b.delay_avatar(X, ZERO, force, "frames")
    outputs = {"x": a.x, "wait": a.wait, "lag": a.lag, "drive": b.vibration(a.wait)}
    y = dict(zip(outputs, played(outputs, {"f": f, "x": x}), strict=True))
    near(1000 * y["wait"][TIMES], [0, 0, 0, 50, 100, 0, 0, 300, 0, 50, 0, 0])
    assert np.count_nonzero(y["wait"]) == 4
    # the avatar stands where the pen was as the frame began
    held = np.repeat(TIMES, np.diff([*TIMES, 860]))
    near(y["x"], 1e-4 * held, 0)
    near(y["lag"], 1e-3 * (np.arange(860) - held), 1e-12)
    on = np.zeros(860)
    for start, ms in ((90, 50), (170, 100), (360, 300), (720, 50)):
        on[start : start + ms] = 1
    near(y["drive"], on, 0)


def test_eq_3_streaming():
    force = Input("f", "N")
    a = b.delay_avatar(ZERO, ZERO, force, catch_up=1e9)
    slow = np.repeat(FORCES, 1000)  # each level long enough for the avatar to be there
    near([1000 * w for w in run({"wait": a.wait}, slow)[0] if w], [75, 100, 300, 75])
    capped = b.delay_avatar(ZERO, ZERO, force, most=0.2)
    waits = run({"wait": capped.wait}, slow)[0]
    near(1000 * waits[waits > 0], [75, 100, 200, 75])


def test_an_avatar_is_where_the_device_was_up_to_the_longest_lag():
    """Of 10.5 samples, by one rise; a device at 1 m/s."""
    force = constant(10.0, "N") * (X > constant(0.0195, "m"))
    a = b.delay_avatar(X, ZERO, force, most=0.0105, catch_up=1e-9)
    proc, n = stimlib.compile(Scene({"x": a.x, "lag": a.lag}), 1000, "python"), np.arange(45)
    x, lag = 1000 * proc.process(1e-3 * n[None])
    near(lag, np.clip(n - 20, 0, 10.5), 1e-6)
    near(x, n - lag, 1e-9)


def test_the_avatar_never_jumps():
    """A step of 0.2 N at 20 mm, 100 mm/s, 100 Hz."""
    a = b.delay_avatar(X, ZERO, constant(0.2, "N") * (X > constant(0.0195, "m")))
    x, lag, wait = run({"x": a.x, "lag": a.lag, "wait": a.wait}, 1e-3 * np.arange(120), 100.0)
    at = [19, 20, 21, 25, 29, 30, 31, 32, 35, 39, 40, 41, 45]
    near(1000 * x[at], [19, 20, 20, 20, 20, 20, 22, 24, 30, 38, 40, 41, 45], 1e-9)
    near(1000 * lag[at], [0, 0, 10, 50, 90, 100, 90, 80, 50, 10, 0, 0, 0], 1e-9)
    assert np.flatnonzero(wait).tolist() == [20]


@pytest.mark.parametrize("fs", [1000.0, 8000.0])
@pytest.mark.parametrize("notice", [0.0, 0.1])
def test_an_avatar_stands_for_the_same_time_at_any_rate(fs, notice):
    """m times what the force rises by: 0.5 s/N times 0.4 N over a nodule; a threshold
    keeps less than 50 ms of it.
    """
    S = np.sin(np.pi * np.linspace(0, 1, 25)) ** 2
    force = constant(0.4, "N") * b.stiffness_map(X, ZERO, (np.array([S, S]), 0.1, 0.01))
    a = b.delay_avatar(X, ZERO, force, notice=notice)
    x, wait = run({"x": a.x, "wait": a.wait}, np.arange(0, 0.1, 0.1 / fs), fs)
    total = wait.sum()
    assert abs(total - 0.2) < 1e-3 if notice == 0 else 0.15 <= total <= 0.2
    steps = np.diff(x) * fs / 0.1
    assert -1e-9 <= steps.min() and steps.max() <= 2 + 1e-9


# Depth and deformation ----------------------------------------------------------------
def test_depths():
    force, S = Input("a", "N"), Input("b")
    d = run(
        {"d": b.indentation(force, S)},
        [[1, 1, 1, 2, 2, 2, 6.776651, 6.776651 / 3, 9], [0, 0.5, 1, 0, 0.5, 1, 0, 0, 0]],
    )
    near(1000 * d[0], [2.5, 1.25, 5 / 6, 5, 2.5, 5 / 3, 15, 5.647209, 15])


RHO = np.array([0, 2.5, 12.5**0.5, 5, 7.5, 10, 12.5, 15])
HEIGHTS = {
    0.0: [0] * 8,
    0.5: [0.5, 0, 0, 0, 0, 0, 0, 0],
    0.7: [0.7, 0.030127, 0, 0, 0, 0, 0, 0],
    1: [1, 0.330127, 0, 0, 0, 0, 0, 0],
    2.5: [2.5, 1.830127, 1.035534, 0, 0, 0, 0, 0],
    5: [5, 4.330127, 3.535534, 0, 0, 0, 0, 0],
    7.5: [7.5, 6.830127, 6.035534, 2.5, 1.25, 0, 0, 0],
    10: [10, 9.330127, 8.535534, 5, 2.5, 0, 0, 0],
    15: [15, 14.330127, 13.535534, 10, 7.5, 5, 2.5, 0],
}


def test_the_four_ranges():
    d = np.repeat(list(HEIGHTS), 8)
    got = run(
        {"down": b.deformation(Input("a", "m"), Input("b", "m"))},
        1e-3 * np.array([np.tile(RHO, len(HEIGHTS)), d]),
    )[0]
    near(1000 * got.reshape(-1, 8), list(HEIGHTS.values()))
    for border in ((2 - 3**0.5) * 2.5, 5, 10):  # continuous there
        two = 1e-3 * np.array([np.tile(RHO, 2), np.repeat([border, border * (1 + 1e-9)], 8)])
        got = run({"down": b.deformation(Input("a", "m"), Input("b", "m"))}, two)[0]
        near(got[8:], got[:8], 1e-9)


def test_a_dent_is_the_same_on_both_sides_and_none_where_there_is_no_number():
    dent = b.deformation(Input("a", "m"), Input("b", "m"))
    p, _ = dent.design(1000.0)
    assert (
        dent.step(p, (), -0.0075, 0.0075)[0]
        == dent.step(p, (), 0.0075, 0.0075)[0]
        == pytest.approx(0.00125)
    )
    assert np.isnan(
        [dent.step(p, (), np.nan, 0.0075)[0], dent.step(p, (), 0.0075, np.nan)[0]]
    ).all()


def test_half_a_sample_of_vibration_is_one():
    motor = b.vibration(Input("w", "s"))
    p, s = motor.design(500.0)
    assert motor.step(p, s, 0.001)[0] == 1.0 and motor.step(p, s, 0.0)[0] == 0.0


def test_overlaps():
    x = 1e-3 * np.array([20, 25, 27.5, 30, 32.5, 40])  # between indenters of 15 mm at 20 and 40 mm
    rho = [abs(X - constant(c, "m")) for c in (0.02, 0.04)]
    deep = [constant(0.015, "m")] * 2
    mean, deepest = (
        run({"down": b.deformation(rho, deep, join=j)}, x)[0] for j in ("mean", "deepest")
    )
    near(1000 * mean, [15, 10, 5, 5, 5, 15])  # 25: 10 and 0; 27.5: 7.5 and 2.5
    near(1000 * deepest, [15, 10, 7.5, 5, 7.5, 15])


def test_three_on_a_triangle():
    places = b.triangle(X, Y)
    got = run(
        {f"{n}{i}": v for i, place in enumerate(places) for n, v in zip("xy", place, strict=True)},
        [[0.03], [0.03]],
    )[:, 0]
    near(1000 * got, [30, 41.547005, 20, 24.226497, 40, 24.226497])


UNIT = r"\[.*\]"


# What is refused ----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: b.stiffness_map(X, Y, ([[0, 1.5], [0, 1]], 1.0, 1.0)), "levels must be 0 to 1"),
        (lambda: b.stiffness_map(X, Y, ([[0, -0.1], [0, 1]], 1.0, 1.0)), "levels must be 0 to 1"),
        (lambda: b.stiffness_map(X, Y, ([[0, np.nan], [0, 1]], 1.0, 1.0)), "not finite"),
        (lambda: b.stiffness_map(X, Y, ([0, 1], 1.0, 1.0)), "two rows and columns"),
        (lambda: b.stiffness_map(X, Y, (np.zeros((1001, 1001)), 1.0, 1.0)), "limits.map_points"),
        (lambda: b.stiffness_map(X, Y, (RAMP[0], 0.0, 1.0)), "width = 0.0 m must be above 0"),
        (lambda: b.stiffness_map(X, Y, [[0, 1], [0, 1]]), "S = .* must be a map"),
        (
            lambda: b.cursor(X, Y, RAMP, "frames", bounds=0.1),
            r"cursor: bounds = 0.1 must be a tuple \(a number, a number\)",
        ),
        (lambda: b.cursor(X, Y, RAMP, "newton"), "choose one of reversible, frames"),
        (lambda: b.cursor(X, Y, RAMP, "frames", bounds=(1.5, 2.0)), "not within bounds"),
        (lambda: b.cursor(X, Y, RAMP, "frames", bounds=(0.1, 0.9)), "not within bounds"),
        (lambda: b.cursor(X, Y, RAMP, "frames", frame=0.0), "frame"),
        (
            lambda: b.delay_avatar(X, Y, constant(1.0, "N"), "frame"),
            "choose one of streaming, frames",
        ),
        (lambda: b.delay_avatar(X, Y, constant(1.0, "N"), notice=-0.1), "notice"),
        (lambda: b.delay_avatar(X, Y, constant(1.0, "N"), most=0.0), "most"),
        (lambda: b.vibration(constant(1.0, "s"), 0.0), "factor"),
        (lambda: b.indentation(constant(1.0, "N"), X / X, softest=0.0), "softest"),
        (lambda: b.triangle(X, Y, side=-1.0), "side"),
        (lambda: b.deformation([X], [Y, Y]), "as many depths"),
        (lambda: b.deformation(X, Y, join="max"), "mean, deepest"),
        (lambda: b.deformation(X, Y, radius=0.0), "radius"),
        (
            lambda: stimlib.compile(
                Scene({"x": b.delay_avatar(X, Y, constant(1.0, "N"), most=1e9).x}), 8000
            ),
            "state_bytes",
        ),
        (lambda: b.stiffness_map(Input("x"), Y, RAMP), UNIT),
        (lambda: b.cursor(X, Input("y"), RAMP), UNIT),
        (lambda: b.delay_avatar(X, Y, X), UNIT),
        (lambda: b.vibration(X), UNIT),
        (lambda: b.press(X), UNIT),
        (lambda: b.indentation(X, Input("S")), UNIT),
        (lambda: b.triangle(X, Input("y")), UNIT),
        (lambda: b.deformation(X, Input("d")), UNIT),
    ],
)
def test_what_makes_no_sense_is_refused(make, says):
    with pytest.raises(UnitError if says == UNIT else BadValue, match=says):
        make()
