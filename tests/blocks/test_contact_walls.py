"""Walls, detents and buttons: their laws, their energy, and what is refused."""

import numpy as np
import pytest
from laws import lawful, played

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnitError, constant
from stimlib.blocks import button, detents, wall

FS = 8000
X, LIVE = Input("x", "m"), Input("live", "m")
MADE = {
    "wall": wall(X, 1000.0, 5.0, 0.2e-3),
    "hunt_crossley": wall(X, 1000.0, 0.0, 0.2e-3, hunt_crossley=3.0),
    "detents": detents(X, 1e-3, 0.8),
    "button": button(X, 2.0, 0.4, 1e-3, 0.6e-3).force,
}
PROC = stimlib.compile(Scene(MADE), FS)


def forces(x):
    PROC.reset()
    return dict(zip(MADE, PROC.process(x[None]), strict=True))


def walk(n, seed=0):
    """A hand that wanders around 0.5 mm, by little and by much."""
    rng = np.random.default_rng(seed)
    steps = rng.standard_normal(n) * rng.choice([1e-6, 1e-4, 1e-3], n // 50).repeat(50)
    return 0.5e-3 + 2e-3 * np.sin(np.cumsum(steps) * 1e3)


@pytest.mark.parametrize("name", MADE)
def test_a_sample_is_the_mean_over_its_way(name):
    lawful(MADE[name], FS, x=walk(400))
    np.testing.assert_allclose(
        forces(np.full(2, 1.3e-3))[name][1],
        {
            "wall": 1.1,
            "hunt_crossley": 1.1,
            "detents": 0.8 * np.sin(2.6 * np.pi),
            "button": 2.0 * (1.3 - 0.4),
        }[name],
        rtol=1e-12,
    )


@pytest.mark.parametrize("name", MADE)
def test_no_motion_takes_energy_out(name):
    """From rest at 0: a wall has at most what was put in, a closed way over detents
    costs nothing, a button's some.
    """
    for seed in (1, 2):
        x = np.r_[0.0, walk(50_000, seed), 0.0]
        w = np.cumsum(forces(x)[name] * np.diff(x, prepend=0.0))
        taken = np.abs(np.diff(w)).sum()
        assert w.min() > -1e-15 * taken
        if name == "detents":
            assert abs(w[-1]) < 1e-15 * taken
        else:
            assert w[-1] > 1e-6 * taken


def test_a_press_of_a_button_loses_the_drop_over_the_way_back():
    x = 1e-3 * np.r_[np.linspace(0, 1.4, 31), np.linspace(1.4, 0, 13)]
    lost = np.sum(forces(x)["button"] * np.diff(x, prepend=0.0))
    assert lost == pytest.approx(2.0 * 0.4 * 0.4e-3, rel=1e-12)
    assert forces(1e-3 * np.linspace(-1, 3, 200))["button"].min() >= 0.0


def test_a_wall_leaves_without_sticking():
    """The damper may take the spring away, but nothing pulls."""
    x = 1e-3 * np.r_[0.0, 1.2, 1.2, np.linspace(1.2, -0.5, 8)]
    y = forces(x)["wall"]
    assert y[2] == pytest.approx(1.0) and y.min() == 0.0 and (y[4:] < 1e-12).all()


@pytest.mark.parametrize("value", [-1.0, -0.0])
def test_a_live_stiffness_below_zero_is_no_wall(value):
    k = LIVE * constant(1.0, "N/m^2")
    outputs = {"F": wall(X, k, 5.0), "G": detents(X, 1e-3, LIVE * constant(1.0, "N/m"))}
    y = played(
        outputs,
        {"x": 1e-3 * np.r_[0.0, 1.0, 1.0, 0.5], "live": np.full(4, value)},
        fs=FS,
        target="python",
    )
    assert y[0, 1] == pytest.approx(5.0 * 8.0) and not y[0, 2:].any()


REFUSED = {
    "wall: k = -1": lambda: wall(X, -1.0),
    "wall: b = -2": lambda: wall(X, 1.0, Param("b", -2.0, "N*s/m")),
    "hunt_crossley = -1": lambda: wall(X, hunt_crossley=-1.0),
    "spacing = 0": lambda: detents(X, 0.0),
    "spacing = 1e-310 is too small": lambda: detents(X, 1e-310),
    "at = 1e-310 is too small": lambda: button(X, at=1e-310),
    "button: at = None must be": lambda: button(X, at=None),
    "depth = -1": lambda: detents(X, 1e-3, -1.0),
    "peak = -1": lambda: button(X, -1.0),
    "drop = 1": lambda: button(X, drop=1.0),
    "drop = -0.5": lambda: button(X, drop=-0.5),
    "button: at": lambda: button(X, at=0.0),
    "above that range the button would supply energy": lambda: button(X, at=1e-3, back=1.1e-3),
    "below it pull the finger": lambda: button(X, drop=0.5, at=1e-3, back=0.4e-3),
}


@pytest.mark.parametrize("says", REFUSED)
def test_what_makes_no_sense_is_refused(says):
    with pytest.raises(BadValue, match=says):
        REFUSED[says]()


def test_units_must_fit():
    for words, said in (
        ({"b": constant(1.0, "N")}, r"b must be \[N·s/m\], not \[N\]"),
        ({"at": constant(1.0, "s")}, r"at \[m\], not \[s\]"),
        ({"hunt_crossley": constant(1.0, "s")}, r"hunt_crossley \[s/m\], not \[s\]"),
    ):
        with pytest.raises(UnitError, match=said):
            wall(X, 1.0, **words)
    assert str(button(X, constant(1.0, "V")).force.dim) == "V"


# One sample after another, in Python --------------------------------------------------
def test_the_way_back_of_a_button_may_be_at_either_end():
    """At ``at`` it has no hysteresis; at ``drop at`` the force before the snap back is
    0, and never below.
    """
    x = 1e-3 * np.array([0.0, 1.5, 0.5, 0.25])
    blocks = {
        "none": button(X, 2.0, 0.5, 1e-3, 1e-3).pressed,
        "most": button(X, 2.0, 0.5, 1e-3, 0.5e-3).pressed,
    }
    assert played(blocks, x).tolist() == [[0, 1, 0, 0], [0, 1, 1, 0]]


def test_live_dampers_below_zero_count_as_none():
    b, c = LIVE * constant(1.0, "N*s/m^2"), LIVE * constant(1.0, "s/m^2")
    blocks = {
        "spring": wall(X, 1000.0),
        "b": wall(X, 1000.0, b),
        "c": wall(X, 1000.0, hunt_crossley=c),
    }
    y = played(blocks, 1e-3 * np.array([0.0, 1.0, 2.0, 0.5]), np.full(4, -0.3))
    np.testing.assert_array_equal(y[1:], y[[0, 0]])


def test_no_contact_begins_with_a_way():
    """Neither the first one, far from 0, nor the next, far from where the last one
    ended; a button may be pressed at once.
    """
    on = Input("contact")
    snap = button(X, 2.0, 0.4, 1e-3, contact=on)
    blocks = {
        "wall": wall(X, 1e3, 5.0, contact=on),
        "detents": detents(X, 1e-3, contact=on),
        "F": snap.force,
        "q": snap.pressed,
    }
    y = dict(
        zip(
            blocks,
            played(blocks, 1e-3 * np.array([1.2, 9.0, 1.2, 1.3]), [1, 0, 1, 1], fs=1000),
            strict=True,
        )
    )
    for name, first in {
        "wall": 1.2,
        "detents": np.sin(2.4 * np.pi),
        "F": 2.0 * (1.2 - 0.4),
        "q": 1.0,
    }.items():
        assert y[name][[0, 1, 2]] == pytest.approx([first, 0.0, first], rel=1e-12), name
    assert y["wall"][3] == pytest.approx(1.25 + 5.0 * 0.1)


@pytest.mark.parametrize("name", MADE)
def test_what_is_not_a_number_is_a_fault_and_each_is_half_a_sample_late(name):
    proc = stimlib.compile(Scene({"F": MADE[name]}), 1000, "python")
    proc.process(np.array([[0.0, np.nan, 0.0]]))
    assert proc.fault == ("F", 1) and proc.latency["F", "x"] == (0.5, 0.5)
