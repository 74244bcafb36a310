"""Soft objects: the laws of Li et al. (2016) against sequences worked out by hand,
places against scipy.
"""

import itertools
from itertools import pairwise

import numpy as np
import pytest
from laws import lawful, mostly, played, refuses
from scipy.integrate import quad
from scipy.interpolate import RectBivariateSpline

import stimlib
from stimlib import BadValue, Input, Scene, UnitError, blocks as b, constant
from stimlib.blocks.cursors import next_speed, ratio

X, Y, ZERO = Input("x", "m"), Input("y", "m"), constant(0.0, "m")
NEWTONS = Input("f", "N")
RAMP = [[0, 1], [0, 1]], 0.01, 0.01  # S = x / 10 mm


SPEEDS = [
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
LEVELS = [0, 0.1, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.75, 0.8, 0.9, 1]
PRESSED = [
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


def near(a, want, tol=5e-7):
    np.testing.assert_allclose(a, want, rtol=0, atol=tol)


# The map ------------------------------------------------------------------------------
FORCE = constant(10.0, "N") * (X > constant(0.0195, "m"))


STROKE = 0.005 * (1 - np.cos(np.arange(200) / 9))


LAWFUL = [
    b.cursor(X, ZERO, RAMP, "frames", contact=Input("touch"), frame=0.004, bounds=(0.3, 1.2)).x,
    b.cursor(X, ZERO, RAMP, "frames", contact=Input("touch"), frame=0.004).x,
    b.delay_avatar(X, ZERO, FORCE, most=0.0105, catch_up=1e-9).x,
    b.delay_avatar(5.0 * X, ZERO, FORCE, most=0.0105, contact=Input("touch")).lag,
]


def test_cursors_and_avatars_are_their_laws():
    """With their least and highest speeds and longest lags; a lift begins anew."""
    touch = np.repeat([1.0, 0.0, 1.0, 1.0], 50)
    for block in LAWFUL:
        lawful(block, 1000, x=STROKE, touch=touch)


def test_levels_between_are_those_of_scipy_and_held_at_the_edges():
    table = np.random.default_rng(1).uniform(0.4, 0.6, (7, 9))
    spline = RectBivariateSpline(np.linspace(0, 0.06, 7), np.linspace(0, 0.12, 9), table, s=0)
    x, y = np.random.default_rng(2).uniform([[-0.03], [-0.02]], [[0.15], [0.08]], (2, 400))
    want = spline.ev(np.clip(y, 0, 0.06), np.clip(x, 0, 0.12))
    near(played(b.stiffness_map(X, Y, (table, 0.12, 0.06)), x, y), want, 1e-12)
    jump, x = np.repeat([[0, 0, 0, 1, 1, 1]], 4, 0), np.linspace(0, 5, 200)
    swings = RectBivariateSpline(np.arange(4.0), np.arange(6.0), jump, s=0).ev(1.0, x)
    near(
        played(b.stiffness_map(X, Y, (jump, 5.0, 3.0)), x, 0 * x + 1), np.clip(swings, 0, 1), 1e-12
    )
    assert swings.max() > 1.05, "it is held at 0 and 1"


# Eq. (1) ------------------------------------------------------------------------------
def speeds(S):
    return np.array(
        [*itertools.accumulate(pairwise(S), lambda v, s: next_speed(v, *s), initial=1.0)]
    )


def test_eq_1_to_the_letter():
    near(speeds([0, 0, 0.2, 0.2, 0.6, 0.6, 0.2, 0, 1, 0.5, 0, 0]), SPEEDS)
    near(speeds([0.2, 0.6, 0.2])[-1], 25 / 49)  # not reversible
    near(speeds([0.5, 0.5 + 1e-15, 0.5]), 1, 0)  # what a spline rounds is no step
    way = [np.r_[np.linspace(0, 0.6, n + 1), np.linspace(0.6, 0, n + 1)[1:]] for n in (1, 2, 3, 6)]
    # and of the frame rate
    near([speeds(w)[-1] for w in way], [0.625, 0.36982249, 0.25005716, 0.08534846])


def test_the_cursor_of_frames_takes_its_steps_in_frames():
    """Frames of 4 samples; ways of the device by which the cursor comes to S = .2, .6,
    .2 of the ramp, and 1 mm on.
    """
    way = 1e-3 * np.cumsum([0, 2, 4 / (3 / 4), -4 / (15 / 56), 1 / (75 / 196)])
    slow = b.cursor(X, ZERO, RAMP, "frames", frame=0.004, bounds=(0.01, 2.0)).x
    near(
        1000 * played(slow, np.repeat(way, 4), target="python"), np.repeat([0, 2, 6, 2, 3], 4), 1e-9
    )
    held = b.cursor(X, ZERO, RAMP, "frames", frame=0.001, bounds=(0.3, 2.0)).x
    near(1000 * played(held, way[:4], target="python")[3], 6 - 0.3 * 4 / (15 / 56))


def test_the_ratio_and_the_mid_point():
    near(ratio(np.array([0, 0.1, 0.2, 0.4, 0.5, 0.6, 0.75, 0.9, 1])),
        [1, 100/121, 15/22, 5/11, 4/11, 25/88, 2/11, 20/209, 1/22])  # fmt: skip
    p = np.cumsum([0, 1, 1, 2, 4, -4, -2, -1, -1]) * 1e-3
    path = 1000 * played(b.cursor(X, ZERO, RAMP).x, p, target="python")
    near(path, [0, 0.916361, 1.695821, 2.973171, 4.829973, 2.973171, 1.695821, 0.916361, 0])
    across = b.cursor(ZERO, Y, (np.transpose(RAMP[0]), 0.01, 0.01)).y
    near(1000 * played(across, p, target="python"), path, 1e-12)


BUMP_X = np.linspace(-0.03, 0.03, 97)
BUMP = np.repeat(np.exp(-((BUMP_X / 0.005) ** 2) / 2)[None], 2, 0), 0.06, 0.01


@pytest.mark.parametrize("fs", mostly({60.0}, [30.0, 60.0, 1000.0, 8000.0]))
def test_the_reversible_cursor_is_within_its_bound_and_leads_back(fs):
    def g(x):
        return ratio(np.exp(-(((x - 0.03) / 0.005) ** 2) / 2))

    def error(x, d=1e-6):
        g1, g2 = (g(x + d) - g(x - d)) / (2 * d), (g(x + d) - 2 * g(x) + g(x - d)) / d**2
        return (g1**2 / 12 - g(x) * g2 / 24) / g(x)

    way = quad(lambda x: 1 / g(x), 0, 0.06, points=[0.03], epsabs=1e-13)[0]
    n = round(way / (0.1 / fs))
    p = way / n * np.r_[np.arange(n + 1), np.arange(n)[::-1]]
    x = played(b.cursor(X, ZERO, BUMP).x, p, fs=fs)
    # of the spline through 97 levels, and of its slopes
    table, per = 2e-6, (way / n) ** 2 * g(0.06)
    signed, size = (quad(f, 0, 0.06, limit=200)[0] for f in (error, lambda x: abs(error(x))))
    assert x[n] - 0.06 == pytest.approx(per * signed, rel=0.1, abs=table)
    assert abs(x[n] - 0.06) <= per * size + table
    near(x[::-1], x, 1e-13)


# Eq. (2) ------------------------------------------------------------------------------
def test_eq_2_and_nothing_without_contact():
    near(played(b.press(Input("level")), LEVELS), [0, *PRESSED])
    touched = b.press(Input("level"), contact=Input("c"))
    near(played(touched, {"c": [1, 1, 0], "level": [0, 0.5, 0.5]}), [0.1008, 0.826490, 0])


# Eq. (3) ------------------------------------------------------------------------------
FORCES = [0.2, 0.2, 0.25, 0.35, 0.55, 0.5, 0.3, 0.9, 0.95, 1.05, 0.2, 0.2]
TIMES = [0, 30, 60, 90, 170, 300, 330, 360, 690, 720, 800, 830]  # ms


def test_eq_3_to_the_letter():
    lengths = np.diff([*TIMES, 860])
    f, held = np.repeat(FORCES, lengths), np.repeat(TIMES, lengths)
    a = b.delay_avatar(X, ZERO, NEWTONS, "frames")
    outputs = {"x": a.x, "wait": a.wait, "lag": a.lag, "drive": b.vibration(a.wait)}
    y = dict(zip(outputs, played(outputs, {"f": f, "x": np.arange(860) * 1e-4}), strict=True))
    near(1000 * y["wait"][TIMES], [0, 0, 0, 50, 100, 0, 0, 300, 0, 50, 0, 0])
    assert np.count_nonzero(y["wait"]) == 4
    # the avatar stands where the pen was as the frame began
    near(y["x"], 1e-4 * held, 0)
    near(y["lag"], 1e-3 * (np.arange(860) - held), 1e-12)
    for start, ms in ((90, 50), (170, 100), (360, 300), (720, 50)):
        y["drive"][start : start + ms] -= 1
    near(y["drive"], 0, 0)


def test_eq_3_streaming():
    slow = np.repeat(FORCES, 1000)  # each level long enough for the avatar to be there
    for words, third in (({"catch_up": 1e9}, 300), ({"most": 0.2}, 200)):
        wait = 1000 * played(b.delay_avatar(ZERO, ZERO, NEWTONS, **words).wait, slow)
        near(wait[wait > 0], [75, 100, third, 75])


def test_the_avatar_never_jumps():
    """A step of 0.2 N at 20 mm, 100 mm/s, 100 Hz."""
    a = b.delay_avatar(X, ZERO, constant(0.2, "N") * (X > constant(0.0195, "m")))
    outputs = {"x1": a.x, "y": a.lag, "z": a.wait}
    x, lag, wait = played(outputs, 1e-3 * np.arange(120), fs=100.0, target="python")
    at = [19, 20, 21, 25, 29, 30, 31, 32, 35, 39, 40, 41, 45]
    near(1000 * x[at], [19, 20, 20, 20, 20, 20, 22, 24, 30, 38, 40, 41, 45], 1e-9)
    near(1000 * lag[at], [0, 0, 10, 50, 90, 100, 90, 80, 50, 10, 0, 0, 0], 1e-9)
    assert np.flatnonzero(wait).tolist() == [20]


@pytest.mark.parametrize("fs", [1000.0, 8000.0])
@pytest.mark.parametrize(("notice", "least"), [(0.0, 0.199), (0.1, 0.15)])
def test_an_avatar_stands_for_the_same_time_at_any_rate(fs, notice, least):
    """m times what the force rises by: 0.5 s/N times 0.4 N over a nodule; a threshold
    keeps less than 50 ms of it.
    """
    S = np.sin(np.pi * np.linspace(0, 1, 25)) ** 2
    force = constant(0.4, "N") * b.stiffness_map(X, ZERO, (np.array([S, S]), 0.1, 0.01))
    a = b.delay_avatar(X, ZERO, force, notice=notice)
    x, wait = played({"x1": a.x, "z": a.wait}, np.arange(0, 0.1, 0.1 / fs), fs=fs)
    assert least <= wait.sum() <= 0.2 + 1e-3
    steps = np.diff(x) * fs / 0.1
    assert -1e-9 <= steps.min() and steps.max() <= 2 + 1e-9


DENT = b.deformation(Input("a", "m"), Input("b", "m"))


def dents(rho, depth):
    """mm of places and depths in mm"""
    return 1000 * played(DENT, 1e-3 * np.array(rho), 1e-3 * np.array(depth))


# Depth and deformation ----------------------------------------------------------------
def test_depths():
    force, levels = [1, 1, 1, 2, 2, 2, 6.776651, 6.776651 / 3, 9], [0, 0.5, 1, 0, 0.5, 1, 0, 0, 0]
    d = played(b.indentation(Input("a", "N"), Input("b")), force, levels)
    near(1000 * d, [2.5, 1.25, 5 / 6, 5, 2.5, 5 / 3, 15, 5.647209, 15])
    near(1000 * played(b.indentation(2.0, Input("b")), levels[:3]), [5, 2.5, 5 / 3])


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
    for depth, heights in HEIGHTS.items():
        near(dents(RHO, np.full(8, depth)), heights)
        near(dents(-RHO, np.full(8, depth)), heights)
    for border in ((2 - 3**0.5) * 2.5, 5, 10):  # continuous there
        near(dents(RHO, np.full(8, border * (1 + 1e-9))), dents(RHO, np.full(8, border)), 1e-6)


@pytest.mark.parametrize(
    ("join", "heights"), [("mean", [15, 10, 5, 5, 5, 15]), ("deepest", [15, 10, 7.5, 5, 7.5, 15])]
)
def test_overlaps(join, heights):
    """Between indenters of 15 mm at 20 and 40 mm; at 27.5: 7.5 and 2.5."""
    rho = [abs(X - constant(c, "m")) for c in (0.02, 0.04)]
    down = b.deformation(rho, [constant(0.015, "m")] * 2, join=join)
    near(1000 * played(down, 1e-3 * np.array([20, 25, 27.5, 30, 32.5, 40])), heights)


def test_three_on_a_triangle():
    ways = [v for place in zip(*b.triangle(X, Y), strict=True) for v in place]
    got = 1000 * played({f"p{i}": v for i, v in enumerate(ways)}, [0.03], [0.03])[:, 0]
    near(got, [30, 20, 40, 41.547005, 24.226497, 24.226497])


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
        (lambda: b.stiffness_map(X, Y, (RAMP[0], 0.0, 1.0)), "width = 0.0 must be a number"),
        (lambda: b.stiffness_map(X, Y, [[0, 1], [0, 1]]), "S = .* must be a map"),
        (
            lambda: b.cursor(X, Y, RAMP, "frames", bounds=0.1),
            r"cursor: bounds = 0.1 must be a tuple \(a number, a number\)",
        ),
        (lambda: b.cursor(X, Y, RAMP, "newton"), "must be one of reversible, frames"),
        (lambda: b.cursor(X, Y, RAMP, "frames", bounds=(1.5, 2.0)), "not within bounds"),
        (lambda: b.cursor(X, Y, RAMP, "frames", bounds=(0.1, 0.9)), "not within bounds"),
        (lambda: b.cursor(X, Y, RAMP, "frames", frame=0.0), "frame"),
        (
            lambda: b.delay_avatar(X, Y, constant(1.0, "N"), "frame"),
            "must be one of streaming, frames",
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
    refuses(make, says, UnitError if says == UNIT else BadValue)
