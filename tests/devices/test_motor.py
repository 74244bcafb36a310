"""Force per current of a motor: a simulated rig with load cells is recovered."""

import numpy as np
import pytest
from laws import STRESS
from refusals import refused
from written import written

import stimlib
from stimlib import BadValue, RecordingError, UnitError, constant
from stimlib.blocks import motor_current
from stimlib.devices import calibrate_motor
from stimlib.motion import minimum_jerk
from stimlib.scenes import squeeze

NB, ZERO, NOISE = 9.5, 0.3, 0.05  # N/A, and N


def gamma(x):
    """Of a motor that is not symmetric, at most 1."""
    u = (np.asarray(x) - 0.018) / 0.02
    return 1 - 0.12 * u**2 - 0.02 * u**3


def rig(rng, n=300, noise=NOISE, shape=gamma, even=False):
    """Readings of current (A), position (m) and force (N)."""
    x, i = rng.uniform(0.0, 0.04, n), rng.uniform(-4.0, 4.0, n)
    x[:2] = 0.0, 0.04
    x = np.linspace(0.0, 0.04, n) if even else x
    f = NB * shape(x) * i + ZERO + noise * rng.normal(size=n)
    return {"current": i, "position": x, "force": f}


NAMES = {"current": "i_mA", "position": "x_mm", "force": "F_N"}
MILLI = {"current": "mA", "position": "mm", "force": "N"}


def test_the_interval_holds_in_95_of_100_rigs():
    """Each rig has its own readings; the share is over 5 positions, and the zero of the
    cell, intervals whose errors are hardly correlated."""
    rng, inside, errors, zeros = np.random.default_rng(3), [], [], []
    for _ in range(400 if STRESS else 60):
        found = calibrate_motor(rig(rng))
        at = np.arange(0, found.position.size, 10)
        true = NB * gamma(found.position[at])
        inside.append((found.low[at] <= true) & (true <= found.high[at]))
        errors.append((found.table[at] - true) / found.error[at])
        zeros.append((found.zero - ZERO) / found.zero_error)
    share, slack = np.mean(inside), 1.0 if STRESS else 2.6
    assert abs(share - 0.95) < 0.012 * slack, share
    assert (np.abs(np.std(errors, axis=0) - 1) < 0.12 * slack).all()
    assert abs(np.std(zeros) - 1) < 0.12 * slack and abs(np.mean(zeros)) < 0.2 * slack
    # the mean square of what 60 readings leave, 47 of them free, has no bias
    few = [calibrate_motor(rig(rng, n=60, even=True), knots=12).residual for _ in range(100)]
    assert np.mean(np.square(few)) == pytest.approx(NOISE**2, rel=0.08)


def test_a_file_in_other_units_gives_the_same(tmp_path):
    rows = rig(np.random.default_rng(1))
    columns = 1e3 * rows["current"], 1e3 * rows["position"], rows["force"]
    told = {"delimiter": ",", "header": ",".join(NAMES.values()), "comments": "", "fmt": "%.9g"}
    np.savetxt(path := tmp_path / "cell.csv", np.column_stack(columns), **told)
    found = calibrate_motor(path, **NAMES, units=MILLI)
    same = calibrate_motor(rows)
    np.testing.assert_allclose(found.table, same.table, rtol=1e-7)
    assert found.unit == "N/A" and found.position[-1] == pytest.approx(0.04)
    assert found.zero == pytest.approx(ZERO, abs=4 * found.zero_error)
    assert found.residual == pytest.approx(NOISE, rel=0.15) and abs(found.pattern) < 4
    assert found.motor_constant == pytest.approx(NB, rel=0.01)
    assert "N/A" in repr(found) and "from 0 to 0.04 m" in repr(found)
    raw = rows | {"position": rows["position"] / 2e-5 + 1472}
    found = calibrate_motor(raw, position="(position - 1472)*2e-5")
    np.testing.assert_allclose(found.table, same.table, rtol=1e-9)
    for unit, told, factor in (("V", "N/V", 1.0), ("", "N", 1.0), ("mV", "N/V", 1e3)):
        found = calibrate_motor(rows, units=MILLI | {"current": unit, "position": "m"})
        assert found.unit == told
        assert found.motor_constant == pytest.approx(NB * factor, rel=0.01)


def test_without_noise_it_is_the_motor():
    found = calibrate_motor(rig(np.random.default_rng(2), noise=0.0))
    np.testing.assert_allclose(found.table, NB * gamma(found.position), rtol=1e-9)
    positions, values = found.geometry
    assert values.max() == 1.0 and positions is found.position


def test_more_than_noise_is_seen_in_the_residuals():
    bent = {"shape": lambda x: 1 - 0.1 * np.sin(np.asarray(x) * 2 * np.pi / 0.008)}
    rows = rig(np.random.default_rng(4), n=600, **bent)
    assert calibrate_motor(rows).pattern > 8
    assert abs(calibrate_motor(rows, knots=40).pattern) < 4
    rows = rig(np.random.default_rng(4), n=600)
    drift = rows | {"force": rows["force"] + 0.1 * np.sin(rows["position"] / 0.004)}
    assert calibrate_motor(drift).pattern > 8  # of the zero, whatever the current


def test_the_blocks_take_it_as_it_is():
    found = calibrate_motor(rig(np.random.default_rng(6)))
    F, X = stimlib.Input("F", "N"), stimlib.Input("x", "m")
    scene = stimlib.Scene({"I": motor_current(F, X, found.motor_constant, found.geometry)})
    x = np.linspace(0, 0.04, 400)
    current = stimlib.compile(scene, 8000).process(np.stack([np.full(400, 20.0), x]))[0]
    np.testing.assert_allclose(NB * gamma(x) * current, 20.0, rtol=0.01)
    scene = squeeze(fingers=1, motor_constant=found.motor_constant, geometry=found.geometry)
    motion = {"x1": minimum_jerk(depth=0.03)}
    y = stimlib.render(scene, motion, 8000, 0.6)
    assert stimlib.verify(scene, motion, y).passed
    assert np.abs(NB * gamma(motion["x1"](y.t)) * y["current1"] - y["force1"]).max() < 0.01 * 60


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the file is empty"),
        ("i_mA,x_mm\n1,2\n", "needs column F_N"),
        ("i_mA,x_mm,F_N\n", "0 readings for .*: too few"),
        ("i_mA,x_mm,F_N\n1,2,three\n", "row 2, column F_N: 'three' is not a number"),
        ("i_mA,x_mm,F_N\n1,nan,3\n", "row 2, column x_mm: nan is not finite"),
        ("i_mA,x_mm,F_N\n1,2\n", "2 fields for 3 columns"),
        ("i_mA,x_mm,F_N\n" + "1,2,3\n" * 40, "no reading lies between"),
    ],
)
def test_a_bad_file_is_refused_with_its_place(tmp_path, text, says):
    path = written(tmp_path / "cell.csv", text)
    error = refused(RecordingError, says, calibrate_motor, path, **NAMES, units=MILLI)
    assert str(path) in str(error)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda rows: {"current": 0 * rows["current"]}, "do not tell"),
        (lambda rows: {"current": np.full(300, 2.0)}, "do not tell"),  # the zero is a part of it
        (lambda rows: {"force": -rows["force"]}, "count the force"),
        (lambda rows: {n: v[:29] for n, v in rows.items()}, "take 5 or more"),
        (lambda rows: {"position": 1e3 * rows["position"]}, '40 m.*"position": "mm"'),
        (
            lambda rows: {n: v[np.abs(rows["position"] - 0.02) > 0.006] for n, v in rows.items()},
            "no reading lies between",
        ),
    ],
)
def test_readings_that_say_too_little_are_refused(change, says):
    rows = rig(np.random.default_rng(7))
    refused(RecordingError, f"(?s){says}", calibrate_motor, rows | change(rows))


@pytest.mark.parametrize(
    ("error", "says", "how"),
    [
        (UnitError, "force in 'mm'", {"units": MILLI | {"force": "mm"}}),
        (UnitError, "unknown unit", {"units": MILLI | {"force": "newt0n"}}),
        (BadValue, "units of force", {"units": {"force": "N"}}),
        (BadValue, "knots = 3", {"knots": 3}),
        (RecordingError, "cannot be read", {"source": "nowhere.csv"}),
    ],
)
def test_units_of_another_quantity_are_refused(error, says, how):
    rows = rig(np.random.default_rng(8))
    refused(error, says, calibrate_motor, **{"source": rows} | how)
    assert constant(1.0, calibrate_motor(rows).unit).dim is not None
