"""Virtual devices: against exact solutions, and the limits that theory gives."""

import dataclasses as dc
import json
from types import SimpleNamespace

import numpy as np
import pytest
from commands import ran, refuses
from laws import mostly
from looped import BOUND, FAULTS, MOST, judged
from refusals import refused
from scipy.integrate import solve_ivp

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnknownName, constant
from stimlib.analysis import needed_damping
from stimlib.blocks import (
    active,
    fir,
    friction,
    oscillator,
    spring,
    sqrt,
    velocity,
    wall,
    white_noise,
)
from stimlib.run.safety import Passivity, Safety
from stimlib.virtual import (
    Device,
    Faults,
    Hand,
    margin,
    read_device,
    smooth,
    swept_damping,
    try_on,
)

X = Input("x", "m")
NOTHING = Scene({"force": 0.0 * spring(X, 1.0)})
FULL = Device(0.1, 0.3, lag=0.002, delay=0.0017, compliance=1e-4, handle=0.03)
HAND = Hand(0.05, 0.4, 200.0)


def springy(k, b=0.0, fs=1000.0):
    """A spring, and a difference as damper."""
    difference = constant(b * fs, "N/m") * fir(X, [1.0, -1.0])
    return Scene({"force": spring(X, k) + difference})


def kick(t):
    return (t < 0.01) * 1.0


def test_a_mass_on_a_spring_moves_as_its_exact_solution():
    trial = try_on(NOTHING, Device(0.1, 0.1), Hand(0.05, 0.2, 400.0), push=3.0, seconds=1.0)
    t, m, b, k = trial.t + 1e-3, 0.15, 0.3, 400.0
    w = np.sqrt(k / m - (b / 2 / m) ** 2)
    swing = np.exp(-b / 2 / m * t) * (np.cos(w * t) + b / 2 / m / w * np.sin(w * t))
    assert np.abs(trial.position - 3.0 / k * (1.0 - swing)).max() < 1e-12 * 3.0 / k
    slope = np.gradient(trial.position, t)
    np.testing.assert_allclose(trial.velocity[1:-1], slope[1:-1], atol=2e-3)


def test_all_that_is_linear_moves_as_a_differential_equation():
    """Amplifier, transmission, delay between samples, an aim that moves straight."""
    fs, d, h = 1000.0, FULL, HAND
    aim = 0.01 * np.sin(2 * np.pi * 3.0 * np.arange(101) / fs)
    trial = try_on(springy(500.0), d, h, aim=aim, push=0.2, seconds=0.1)

    def change(t, s):
        x, v, y, u, f = s
        k = int(np.floor((t - d.delay) * fs + 1e-9))
        command = trial.force[k] if k >= 0 else 0.0
        cell = min(int(t * fs), 99)
        r = aim[cell] + (aim[cell + 1] - aim[cell]) * (t * fs - cell)
        rate = (aim[cell + 1] - aim[cell]) * fs
        bend = (x - y) / d.compliance
        at_hand = 0.2 + h.stiffness * (r - y) + h.damping * (rate - u)
        return [
            v,
            (-f - d.damping * v - bend) / d.mass,
            u,
            (bend + at_hand) / (d.handle + h.mass),
            (command - f) / d.lag,
        ]

    made = solve_ivp(change, (0, 0.1), np.zeros(5), rtol=1e-10, atol=1e-13, max_step=1e-4)
    want = np.interp(trial.t + 1 / fs, made.t, made.y[0])
    assert np.abs(trial.position - want).max() < 1e-5 * np.abs(want).max()
    # a plain Riemann sum over the same solution
    t = np.linspace(0, 0.1, 100_001)
    x, f = (np.interp(t, made.t, made.y[row]) for row in (0, 4))
    assert trial.work[-1] == pytest.approx(np.trapezoid(f, x), rel=0.02)


def test_friction_stops_a_mass_where_it_should():
    """From v at C/m: after v^2 m/2C, and it sticks below C."""
    trial = try_on(NOTHING, Device(0.1, 0.0, coulomb=0.5), push=lambda t: (t < 0.1) * 1.5)
    assert trial.position[-1] == pytest.approx(0.05 + 1.0**2 * 0.1 / 2 / 0.5, rel=2e-3)
    assert trial.settles and trial.velocity[-1] == 0.0
    held = try_on(NOTHING, Device(0.1, 0.0, coulomb=0.5), push=0.499)
    assert np.abs(held.position).max() < 1e-15


def test_what_is_measured_and_commanded():
    d = Device(0.1, 5.0, encoder=1e-4, dac=0.03, limit=0.2)
    trial = try_on(springy(100.0), d, push=1.0, seconds=0.5, start=1.26e-4)
    assert trial.force[0] == pytest.approx(100.0 * 1e-4)  # of the encoder, from the start on
    np.testing.assert_array_equal(trial.measured, np.floor(trial.position / 1e-4 + 0.5) * 1e-4)
    # 0.8 N and drag: as with this limit of the force alone
    assert np.diff(trial.position)[-1] * 1000.0 == pytest.approx(0.8 / 5.0, rel=1e-3)
    fine = try_on(springy(100.0), Device(0.1, 5.0, dac=0.03), Hand(0.0, 1.0, 50.0), aim=0.01)
    rest = 50.0 * (0.01 - fine.position[-1])
    assert rest / 0.03 == pytest.approx(round(rest / 0.03), abs=1e-6)


def test_work_is_that_of_the_held_force():
    trial = try_on(springy(300.0), Device(0.1, 1.0), push=kick, seconds=0.4)
    moved = np.diff(trial.position, prepend=0.0)
    np.testing.assert_allclose(trial.work, np.cumsum(trial.force * moved), atol=1e-15)
    assert trial.given == -trial.dips.min() >= -trial.work.min() > 0
    thirds = trial.velocity[133:266], trial.velocity[-133:]
    assert trial.swing == pytest.approx([np.sqrt(np.mean(v**2)) for v in thirds], rel=1e-12)
    # between samples it is less where the motion turns, and where the force changes
    late = try_on(springy(300.0), Device(0.1, 1.0, delay=4.5e-4), push=kick, seconds=0.4)
    assert (late.dips <= late.work).all() and (late.dips < late.work - 1e-9).any()


@pytest.mark.parametrize(
    ("make", "low", "high", "limit"),
    [
        # Colgate and Schenkel: b = K T/2
        (lambda k: try_on(springy(k), Device(0.03, 0.5), push=kick, seconds=3), 400, 3000, 1000.0),
        (
            lambda fs: try_on(springy(500.0), Device(0.06, 0.5), fs=fs, push=kick, seconds=5),
            200,
            2000,
            500.0,
        ),
        # Gil and others: b = K (T/2 + delay)
        (
            lambda d: try_on(springy(200.0), Device(0.2, 0.5, delay=d), push=kick, seconds=8),
            5e-4,
            5e-3,
            0.002,
        ),
        # Diolaiti and others: C = K step/2, where the hand presses between two steps
        (
            lambda k: try_on(
                springy(k), Device(0.1, 5.0, coulomb=0.1, encoder=2e-4), push=7e-4 * k, seconds=4
            ),
            300,
            3000,
            1000.0,
        ),
    ],
    ids=["stiffness", "rate", "delay", "encoder"],
)
def test_margins_are_those_of_theory(make, low, high, limit):
    found = margin(make, low, high)
    assert found == pytest.approx(limit, rel=0.02) and make(found).settles


@pytest.mark.parametrize(("k", "b"), [(1000.0, 0.0), (1000.0, 0.3), (0.0, 1.0)])
@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.003])
def test_a_sweep_finds_the_damping_of_colgate_and_schenkel(k, b, delay):
    proc = stimlib.compile(springy(k, b), 1000.0, "python")
    needed = needed_damping(lambda f: proc.response("force", "x", f), 1000.0, delay)
    f, damping = swept_damping(springy(k, b), delay=delay)
    assert damping.max() == pytest.approx(needed, rel=1e-3)
    assert (f[0], f[-1], f.size) == (2.5, 497.5, 199)
    if not delay:
        assert needed == pytest.approx(k / 2000 + b, rel=1e-3)


def test_a_sweep_of_what_is_not_linear():
    """Friction takes energy; a wall needs what a spring needs while it is touched."""
    dry = Scene({"force": friction(X, Input("press", "N"), mu=0.6)})
    assert swept_damping(dry, axis=("force", "x"))[1].max() <= 1e-12
    half = Scene({"force": wall(X, 1000.0)})
    inside = swept_damping(half, center=0.005)[1].max()
    assert inside == pytest.approx(1.0, rel=1e-3)  # its force is a mean, half a sample late
    assert 0 < swept_damping(half)[1].max() < inside
    # each frequency begins anew, with the same noise and the given parameters
    k = Param("k", 500.0, "N/m")
    noisy = Scene({"force": k * X + constant(0.1, "N") * white_noise(1)})
    f, damping = swept_damping(noisy, size=20, seed=3, params={"k": 100.0})
    x = 1e-3 * np.sin(2 * np.pi * f[6] * np.arange(41) / 1000.0)
    proc = stimlib.compile(noisy, 1000.0, seed=3)
    proc.set("k", 100.0, ramp=0.0)
    force = proc.process(x[None, :40])[0]
    step = np.diff(x)
    want = -np.sum((force * step)[20:]) / np.sum(step[20:] ** 2) / 1000.0
    assert damping[6] == pytest.approx(want, rel=1e-9)


def test_axis_motion_and_parameters():
    other, k = Input("y", "m"), Param("k", 100.0, "N/m")
    scene = Scene({"force": k * (X + other), "side": k * other})
    refused(BadValue, "give axis=", try_on, scene, FULL)
    refused(UnknownName, "axis", try_on, scene, FULL, axis=("force", "z"))
    refused(UnknownName, "motion", try_on, scene, FULL, axis=("force", "x"), motion={"z": 1.0})
    how = {"axis": ("force", "x"), "motion": {"y": lambda t: 0.01 + t}, "params": {"k": 7.0}}
    trial = try_on(scene, FULL, seconds=0.1, start=0.002, **how)
    assert trial.force[0] == pytest.approx(7.0 * 0.012)
    assert trial.force[50] == pytest.approx(7.0 * (0.06 + trial.measured[49]))
    refused(BadValue, "one number for each sample", try_on, scene, FULL, push=np.ones(3), **how)
    for word, value in (("push", np.nan), ("aim", [0.0, np.inf]), ("push", "much"), ("aim", "far")):
        refused(BadValue, f"{word} .*(finite|numbers)", try_on, scene, FULL, **how | {word: value})


def test_contacts_are_counted_from_the_first_sample_on():
    trial = try_on(NOTHING, FULL, seconds=0.005)
    for force in ([0, 1, 1, 0, 2], [3, 0, 0, 0, -1], [2, 2, 0, 1, 1]):
        assert dc.replace(trial, force=np.array(force)).contacts == 2


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("law", "device", "of"),
    [
        (constant(1.0, "N") * sqrt(0.005 + X / constant(1.0, "m")), Device(0.1, 9.0), "force"),
        (spring(X, 1.0), Device(1e-300, 0.0, compliance=1e-300, handle=1e-300), "device"),
    ],
)
def test_what_was_ended_does_not_come_to_rest(law, device, of):
    """A guard ends what is not finite, and then the hand does."""
    trial = try_on(Scene({"force": law}), device, HAND, seconds=2.0, start=1e-3, aim=-0.02)
    assert [*trial.told["faults"]] == [of] and not trial.settles
    assert f"{of} was not finite at sample {trial.told['faults'][of]} (" in str(trial)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_device_ends_where_its_first_number_is_not_finite():
    """Its work against 1 N/m overflows long before the least of the work does."""
    x = 1e200 / 0.2 * (np.arange(9) / 1000) ** 2
    first = np.flatnonzero(np.isinf(x[:-1] * np.diff(x)))[0]
    trial = try_on(springy(1.0), Device(0.1, 0.0), push=1e200)
    assert trial.told["faults"] == {"device": first}


def test_margins_and_devices_that_are_none(tmp_path):
    alive = try_on(springy(10.0), Device(0.1, 1.0), push=kick)
    refused(BadValue, "choose ends that differ", margin, lambda _: alive, 1.0, 2.0)
    for given in (0.5, [], [1.0]):  # no trials
        refused(BadValue, "return what try_on does", margin, lambda _, v=given: v, 1.0, 2.0)
    # it ends where no number is in between
    assert margin(lambda v: [SimpleNamespace(settles=v <= 0.3)], 0.0, 1.0, rel=1e-17) == 0.3
    refused(BadValue, "give both, or neither", Device, 0.1, 0.1, compliance=1e-3)
    refused(BadValue, "mass", Device, 0.0, 0.1)
    path = tmp_path / "d.json"
    for text in ("", "[1]", "[" * 100_000, '{"mass": 1}', '{"mass": 1, "damping": 0, "colour": 2}'):
        path.write_text(text)
        assert str(path) in str(refused(BadValue, "as JSON", read_device, path))
    path.write_text(json.dumps(dc.asdict(FULL)))
    assert read_device(path) == FULL


def test_the_command_says_whether_it_comes_to_rest(tmp_path):
    path = tmp_path / "d.json"
    path.write_text(json.dumps({"mass": 0.08, "damping": 0.4, "delay": 0.003}))
    how = ["try", "wall", "--device", path, "--start", "-0.01", "--aim", "0.02"]
    assert "does not come to rest" in ran(how).stdout
    facts = json.loads(ran([*how, "--hand", "0.1,6,500", "--json"]).stdout)
    assert facts["settles"] and facts["given"] > 0
    refuses([*how, "--hand", "1,2"], "such as 0.02,1,100")
    faults = "jump=0.5:0.005,lost=0.1,saturated=1:0.5"
    guard = ["--full-scale", "9", "--passivity", "bound=0.01,delay=0.003,lost=5"]
    seen = json.loads(ran([*how, *guard, "--faults", faults, "--tremor", "1e-3", "--json"]).stdout)
    scene, words = stimlib.scenes.wall(), {"start": -0.01, "aim": 0.02, "seconds": 3.0}
    words["safety"] = Safety(9.0, passivity=Passivity(0.01, delay=0.003, lost=5))
    words["faults"] = Faults(jump=(0.5, 5e-3), lost=0.1, saturated=(1.0, 0.5))
    trial = try_on(scene, read_device(path), Hand(0.02, 1.0, 100.0, 1e-3), **words)
    assert seen["given"] == trial.given and seen["hardware"] == trial.told["hardware"]
    assert seen["energy"] == trial.told["energy"] and seen["clips"] == trial.told["clips"]
    # of the device the controller was told no delay
    assert seen["misstated"] == {} and "may not hold" not in str(trial)
    for word, wrong in (("bound=0.01", {"delay": [0, 0.003]}), ("bound=1,delay=0.003", {})):
        words = [*how, "--full-scale", "9", "--passivity", word]
        assert json.loads(ran([*words, "--json"]).stdout)["misstated"] == wrong
        said = "may not hold: the controller was told delay = 0, and the device has 0.003"
        assert (said in ran(words).stdout.replace("\n", " ")) == bool(wrong)
    two = tmp_path / "two.py"
    two.write_text(
        "import stimlib\nfrom stimlib.blocks import spring\n"
        "x, y = stimlib.Input('x', 'm'), stimlib.Input('y', 'm')\n"
        "both = stimlib.Scene({'F': spring(x, 1.0) + spring(y, 1.0)})\n"
    )
    both = ["try", f"{two}:both", *how[2:], "--axis", "F=x", "--full-scale", "9", "--passivity"]
    assert "F gave at most" in ran([*both, "bound=0.1,axes=F:x"]).stdout
    refuses([*both, "bound=0.1"], "on the command line axes=F:x")
    for axes in ("F", "F:", "F:x:F"):
        refuses([*both, f"bound=0.1,axes={axes}"], "write output:input")
    refuses([*how, "--faults", "jumps=1"], "no fault 'jumps'")
    refuses([*how, "--faults", "jump"], "write dropped=0.1")
    refuses([*how, "--faults", "lost=x"], "'x' is not a number")
    refuses([*how, "--faults", "stuck=1"], "stuck")


@pytest.mark.parametrize("device", [Device(0.1, 2.0), FULL])
def test_a_force_that_reads_no_position_moves_the_device(device):
    """As the same force beside a position, and as the response of mass and damper."""
    hum = constant(0.5, "N") * oscillator(40.0)
    alone, beside = (Scene({"F": y}) for y in (hum, hum + 0.0 * spring(X, 1.0)))
    trial, same = (try_on(scene, device, HAND, push=0.1) for scene in (alone, beside))
    np.testing.assert_array_equal(trial.position, same.position)
    np.testing.assert_array_equal(trial.work, same.work)
    if device is not FULL:
        assert not trial.settles and trial.cycle[1] == pytest.approx(40.0, rel=1e-3)
        s = 2j * np.pi * 40.0
        swing = 0.5 / abs(0.15 * s**2 + 2.4 * s + 200.0)
        assert trial.cycle[0] == pytest.approx(swing, rel=0.02)
    refused(BadValue, "reads no position", swept_damping, alone)
    told = "no output is a force or a torque \\(signal \\[1\\]\\).*with an output in N"
    refused(BadValue, told, try_on, stimlib.scenes.tone(), device)
    pair = Scene({"F": hum, "G": 2.0 * hum})
    refused(BadValue, "may be F= or G=: give axis=.* --axis F=", try_on, pair, device)
    assert try_on(pair, device, axis=("F", "")).force[3] == trial.force[3]


# Behind the safety stage --------------------------------------------------------------
@pytest.mark.parametrize("hundred", mostly([0], range(10)))
def test_no_scene_gives_more_than_the_bound_to_a_hand(hundred):
    """A tenth of what ``benchmarks/closed_loop.py`` runs; all in make stress."""
    rows = [judged(seed) for seed in range(100 * hundred, 100 * hundred + 100)]
    for row in rows:
        assert max(row["on"], row["observed"]) <= BOUND * (1 + 1e-9)
        assert row["most"] <= MOST and row["leaps"] == 0 and not row["told"]
        assert (row["error"] > 0) == (row["changed"] > 0)
    assert sum(row["off"] > BOUND for row in rows) > 20, "many are active"


@pytest.mark.parametrize("fault", [*FAULTS][1:])
def test_a_fault_of_the_hardware_stays_within_force_and_energy(fault):
    """Of these some gave up to 7.6 times the bound when nothing was told."""
    rows = [judged(seed, fault) for seed in (*range(6), 57, 62, 82, 84, 86, 99, 184)]
    for row in rows:
        assert max(row["on"], row["observed"]) <= BOUND * (1 + 1e-9) and row["most"] <= MOST
        assert row["told"] or "saturated" in fault
        assert ("jumps" in fault) <= (row["leaps"] > 0)
    assert any(row["told"] for row in rows)


def test_what_faults_do():
    d, how = Device(0.1, 5.0), {"push": 1.0, "seconds": 0.5}

    def run(**words):
        return try_on(springy(100.0), d, faults=Faults(**words), **how)

    sound, jump, stuck = run(), run(jump=(0.2, 1e-3)), run(stuck=(0.2, 0.3))
    np.testing.assert_array_equal(jump.force[:200], sound.force[:200])
    assert jump.force[200] - sound.force[200] == pytest.approx(0.1)
    assert np.ptp(stuck.force[200:300]) == 0 < np.ptp(stuck.force[301:])
    drops = np.mean(np.diff(run(dropped=0.3).force[1:]) == 0.0)
    assert 0.25 < drops < 0.35
    for push in (-1.0, 1.0):
        how["push"] = push
        weak = run(saturated=(0.0, 0.3))
        strong = try_on(springy(100.0), dc.replace(d, limit=0.3), **how)
        np.testing.assert_array_equal(weak.position, strong.position)
    assert run(lost=1.0).work[-1] == 0.0
    # all of it is told
    assert sound.told["hardware"] == {} and "hardware" not in str(sound)
    for trial, what, n in (
        (jump, "positions off", 300),
        (stuck, "readings that stayed", 100),
        (run(lost=1.0), "forces lost", 500),
        (weak, "forces beyond the amplifier's", np.count_nonzero(weak.force > 0.3)),
        (run(saturated=(0.2, 0.0)), "forces beyond the amplifier's", 300),
        (strong, "forces beyond the amplifier's", np.count_nonzero(strong.force > 0.3)),
    ):
        assert trial.told["hardware"] == {what: n} and f"hardware: {n} {what}" in str(trial)
    just = try_on(Scene({"F": constant(0.3, "N")}), dc.replace(d, limit=0.3))
    assert just.told["hardware"] == {}, "it makes so much"
    refused(BadValue, "parts 0 to 1", Faults, dropped=1.5)
    refused(BadValue, "finite", Faults, jump=(np.nan, 1.0))
    refused(BadValue, "until a later one", Faults, stuck=(2.0, 1.0))


def test_tremor_is_of_8_to_12_hz_and_of_the_stated_amplitude():
    hand = Hand(0.05, 3.0, 300.0, tremor=1e-3)
    t = np.arange(0, 200, 1e-2)
    shaking = hand.shaking(t, 3)
    assert np.sqrt(2) * shaking.std() == pytest.approx(1e-3, rel=0.1)
    power = np.abs(np.fft.rfft(shaking)) ** 2
    f = np.fft.rfftfreq(t.size, 1e-2)
    assert power[(f > 7.9) & (f < 12.1)].sum() > 0.99 * power.sum()
    light = Device(0.03, 0.1)
    one, same, other = (try_on(NOTHING, light, hand, seed=s).position for s in (1, 1, 2))
    assert np.array_equal(one, same) and np.abs(one - other).max() > 1e-4
    refused(BadValue, "tremor reaches the device by", Hand, 0.1, tremor=1e-3)


@pytest.mark.parametrize(
    "device", [Device(0.1, 0.5), Device(0.1, 0.5, delay=0.0027, compliance=1e-4, handle=0.03)]
)
def test_the_smooth_part_moves_as_all_of_it_and_has_derivatives(device):
    jax = pytest.importorskip("jax")
    damper = Param("c", 1.0, "N*s/m") * velocity(X, 50.0)
    scene = Scene({"force": Param("k", 300.0, "N/m") * X + damper})
    how = {"aim": lambda t: 1e-3 + 0.01 * np.sin(19 * t), "push": 1.0, "start": 1e-3}
    words = how | {"seconds": 0.2, "seed": 4}
    hand = dc.replace(HAND, tremor=1e-3)
    with jax.enable_x64(True):
        run, trial = smooth(scene, device, hand, **words), try_on(scene, device, hand, **words)
        for name, row in run().items():
            want = getattr(trial, name)
            assert np.abs(np.asarray(row) - want).max() < 1e-12 * np.abs(want).max(), name
        for value in (lambda r: abs(r["position"]).max(), lambda r: r["work"][-1]):
            slope = jax.grad(lambda k, value=value: value(run({"k": k})))(300.0)
            low, high = (value(run({"k": k})) for k in (299.99, 300.01))
            assert slope == pytest.approx((high - low) / 0.02, rel=1e-5)
    for field in ("coulomb", "encoder", "dac", "limit", "lag"):
        refused(BadValue, "leave out", smooth, scene, dc.replace(device, **{field: 0.01}))


@pytest.mark.parametrize(
    ("scene", "power"), [(stimlib.scenes.tone, 0.5), (stimlib.scenes.pulse, 1.0)]
)
def test_a_shipped_vibration_states_what_it_gives(scene, power):
    """A hand of 1 N s/m at its resonance gets nearly all of it, no other any more."""
    words = {"freq": 40.0, "duration": 0.9, "ramp": 0.05} if power < 1 else {"duration": 0.5}
    force, free = (scene(amplitude=1.0, unit=unit, **words) for unit in ("N", ""))
    played = [stimlib.render(made, fs=1000, seconds=2.0)["signal"] for made in (force, free)]
    np.testing.assert_array_equal(*played)
    device, stiffness = Device(0.1, 0.25), 0.15 * (2 * np.pi * 40.0) ** 2 if power < 1 else 0.0
    for damping in (0.75, 3.0):
        trial = try_on(force, device, Hand(0.05, damping, stiffness), seconds=0.9, fs=8000.0)
        assert trial.told["power"] == power and trial.beyond < 1e-3 < trial.given
        assert (trial.given > 0.3 * power * 0.9) == (damping < 1)
    quiet = try_on(scene(amplitude=0.0, unit="N", **words), device)
    assert quiet.told["power"] == quiet.given == 0.0


def test_a_trial_says_what_was_beyond_what_is_on_purpose():
    pushes = constant(-0.5, "N") + 0.0 * spring(X, 1.0)
    for force, power in ((pushes, 0.0), (active(pushes, 0.02), 0.02), (active(pushes, 0.5), 0.5)):
        trial = try_on(Scene({"F": force}), Device(0.1, 5.0), seconds=1.0)
        at = trial.t + 1e-3
        assert trial.beyond == max(0.0, -(trial.dips + power * at).min())
        assert (f"{1e3 * trial.beyond:.3g} mJ were beyond this" in str(trial)) == (power > 0)
    assert trial.beyond == 0.0 < trial.given
