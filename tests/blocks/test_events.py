"""Events and what they make, against what they are said to be."""

import math
import tracemalloc

import numpy as np
import pytest
from laws import lawful, played

import stimlib
from stimlib import BadValue, Input, Param, Scene, UnitError, blocks as b
from stimlib.blocks.events import Every, is_event
from stimlib.design.filters import resampled

X, E = Input("x"), Input("e")


def impulse(n, *at):
    return np.isin(np.arange(n), at or (0,)).astype(float)


# Lines --------------------------------------------------------------------------------
def test_every_line_is_passed_once_each_way_at_any_speed():
    x = [0.5, 0.5, 1.0, 1.0, 0.999, 0.94, 7.2, -3.3, -3.3, -3.3, 0.0, 5.0, 1e9]
    y = played(b.crossing(X, 1.0, hysteresis=0.1), x)
    assert y.tolist() == [0, 0, 0, 0, 0, 0, 7, -11, 0, 0, 3, 5, 1e9 - 5]
    assert played(b.crossing(X, 1.0), x[:5]).tolist() == [0, 0, 1, 0, -1]


def test_what_is_no_number_passes_no_line_and_makes_no_edge():
    nan = np.nan
    assert played(b.crossing(X, 1.0), [nan, 0.5, nan, 2.5]).tolist() == [0, 0, 0, 2]
    assert played(b.crossing(X, 1.0, split=True), [0.5, nan, 1.5, 1.5]).tolist() == [0, 0, 0.5, 0.5]
    assert played(b.rising(X, 0.5), [nan, 1.0, nan, 2.0, 0.5, 1.0]).tolist() == [0, 0, 0, 0, 0, 1]


def test_a_position_that_toggles_between_codes_passes_a_line_once():
    code = 1e-6 * (5000 + np.r_[-3:1, np.tile([0, -1], 50), 1:4])
    assert np.abs(played(b.crossing(X, 0.005, hysteresis=2e-6), code)).sum() == 1
    assert np.abs(played(b.crossing(X, 0.005), code)).sum() > 50


def test_a_split_event_lies_where_the_line_was_passed():
    """Its sum is the number of lines, its mean the time of the passage, one sample
    later; both ways, several at once.
    """
    u = np.array([0.0, 0.25, 1.25, 1.0, 0.75, 3.75, 3.75, 3.5, 2.75, 2.75])
    y = played(b.crossing(X, 1.0, split=True), u)
    assert y.sum() == 2.0
    np.testing.assert_allclose(
        y, [0, 0, 0.25, 0.75, -1.0, 3 * (1 - 1.25 / 3), 1.25, 0, -1 + 2 / 3, -2 / 3], atol=1e-15
    )


def test_an_edge_is_no_first_sample():
    assert played(b.rising(X), [1.0, 0.0, 1.0]).tolist() == [0, 0, 1]
    assert played(b.falling(X), [-1.0, 1.0, -1.0]).tolist() == [0, 0, 1]


def test_a_split_event_knows_the_hysteresis():
    assert played(
        b.crossing(X, 1.0, 0.25, split=True), [0.0, 1.0, 1.25, 1.25, 0.5, 0.5]
    ).tolist() == [0, 0, 0.5, 0.5, -0.5, -0.5]
    assert (
        stimlib.compile(Scene({"y": b.crossing(X, 1.0, split=True)}), 1000).latency["y", "x"][0]
        == 1.0
    )


TILES = [  # of 64 samples
    (b.rising(X, 0.5), np.repeat([0.0, 0.7, 0.2, 0.2, 0.7], 64)),
    (b.falling(X, 0.5), np.repeat([0.0, 0.7, 0.2, 0.2, 0.7], 64)),
    (b.crossing(X, 1.0), np.repeat([0.5, 1.5, 1.5, 0.5], 64)),
    # the first sample is in its cell, whatever the hysteresis
    (b.crossing(X, 1.0, 0.1), np.repeat([1.03125, 0.9], 64)),
    (
        b.crossing(X, 1.0, split=True),
        np.r_[np.linspace(0.5, 0.75, 128), np.full(63, 0.5), np.full(128, 1.25)],
    ),
    # from the last sample of a tile
    (b.crossing(X, 1.0, split=True), np.r_[np.linspace(0.5, 0.75, 128), 1.25]),
    (b.once_within(X, 0.2), impulse(400, 0, 130, 200, 390)),
    (b.envelope(X, attack=0.0, sustain=0.5, decay=0.001, release=0.001), np.arange(300) >= 150),
]


@pytest.mark.parametrize(("block", "x"), TILES)
def test_events_in_and_after_tiles_in_which_nothing_happens(block, x):
    """Tiles are skipped; what happens at their ends is not."""
    lawful(block, 1000, x=x)


def test_events_of_both_signs_are_counted_and_hold():
    assert played(b.count(E), [1, -1, 2]).tolist() == [1, 0, 2]
    assert played(b.sample_and_hold(X, E), [5, 6, 7], [0, -1, 0]).tolist() == [0, 6, 6]


# Times --------------------------------------------------------------------------------
def test_events_at_times_are_at_the_nearest_sample():
    assert np.flatnonzero(played(b.at([0.0, 0.0104, 0.0106, 0.0107]), 20)).tolist() == [0, 10, 11]
    assert played(b.at([0.0106, 0.0107]), 20)[11] == 2.0
    assert np.flatnonzero(played(b.every(0.0104), 40)).tolist() == [0, 10, 21, 31]
    assert played(b.count(b.every(0.01)), 2).tolist() == [1, 1], "none before sample 0"


def test_a_period_does_not_drift():
    """A day at 48 kHz: each event is where it should be, none is lost and none comes
    twice.
    """
    p, _ = b.every(1 / 158.3).design(48000)
    k = np.arange(158.3 * 86400 - 300, 158.3 * 86400).astype(int)
    wanted = np.floor(k * (48000 / 158.3) + 0.5)
    n = np.arange(wanted[0], wanted[-1] + 1)
    y = np.array([Every.step(p, (), v / 48000)[0] for v in n])
    assert np.array_equal(n[y > 0], wanted)


def test_a_timeline_meets_its_points():
    points = [(0.0, 1.0), (0.1, 0.3), (0.1, -1.0), (0.3, 0.7)]
    t = np.array([0, 50, 99, 100, 200, 299, 300, 399])
    for kind, wanted in {
        "linear": [1, 0.65, 0.307, -1, -0.15, 0.6915, 0.7, 0.7],
        "step": [1, 1, 1, -1, -1, -1, 0.7, 0.7],
        "cosine": [
            1,
            0.65,
            0.3 + 0.7 * np.sin(np.pi / 200) ** 2,
            -1,
            -0.15,
            0.7 - 1.7 * np.sin(np.pi / 400) ** 2,
            0.7,
            0.7,
        ],
    }.items():
        y = played(b.timeline(points, kind), 400)
        np.testing.assert_allclose(y[t], wanted, rtol=1e-14)
        assert y[0] == 1.0 and y[100] == -1.0 and y[300] == 0.7, "exact at the points"
    assert (played(b.timeline([(0.0, 0.1), (0.001, 0.3)]), 3000)[1:] == 0.3).all(), "held exactly"
    with pytest.raises(UnitError):
        b.timeline(points, unit="N") + 1.0


# What they make -----------------------------------------------------------------------
def test_rings_overlap_and_are_exact():
    n = np.arange(4000)
    heights = np.where(np.random.default_rng(0).random(4000) < 0.01, 1.3, 0.0)
    for onset, wave in (("sine", np.sin), ("cosine", np.cos)):
        h = np.exp(-n / 160) * wave(2 * np.pi * (250 * n / 8000 % 1))
        y = played(b.ring(E, 250, 0.02, onset), heights, fs=8000)
        assert np.abs(y - np.convolve(heights, h)[:4000]).max() < 4e-14


def test_a_ring_whose_frequency_moves_only_decays():
    from stimlib.blocks.sources import Ring, RingState

    p, _ = b.ring(E, Input("f", "Hz"), Input("d", "s")).design(1.0)
    rng, s = np.random.default_rng(1), RingState(1.0, 0.0)
    for _ in range(2000):
        before = np.hypot(s.re, s.im)
        _, s = Ring.step(p, s, 0.0, rng.uniform(-0.1, 0.7), 10 ** rng.uniform(-1, 8))
        assert np.hypot(s.re, s.im) <= before * (1 + 1e-15)


@pytest.mark.parametrize("freq", [100.0, Input("f", "Hz")])
def test_a_ring_is_held_within_its_limits(freq):
    """At 0 and fs/2, and at a decay of one sample; where its decay moves alone, too."""
    rows = np.tile([-20.0, 100.0, 700.0, 250.0], 40), np.repeat([0.0, -1.0, 0.001, 0.002], 40)
    lawful(
        b.ring(E, freq, Input("d", "s")), 1000, e=impulse(160, 0, 50, 90, 130), f=rows[0], d=rows[1]
    )


@pytest.mark.parametrize("row", [0, 1, 2])
def test_what_is_not_a_number_is_a_fault_of_a_live_ring(row):
    proc = stimlib.compile(
        Scene({"y": b.ring(E, Input("f", "Hz"), Input("d", "s"))}), 1000, "python"
    )
    rows = np.ones((3, 4))
    rows[row, 2] = np.nan
    proc.process(rows)
    assert proc.fault == ("y", 2 + (row == 0)), "a sine is 0 at its event"


def test_a_ring_sounds_until_both_its_parts_are_silent():
    # the sine alone, then the cosine alone
    assert np.all(played(b.ring(E, 250.0, 0.01), impulse(40))[1::2] != 0)


@pytest.mark.parametrize("rate", [0.0, 0.002, 0.3])
def test_grains_overlap_and_silence_is_zero(rate):
    rng = np.random.default_rng(2)
    shape, heights = (
        rng.standard_normal(200),
        np.where(rng.random(1500) < rate, rng.standard_normal(1500), 0.0),
    )
    y = played(b.grain(E, shape, rate=1000), heights)
    np.testing.assert_allclose(y, np.convolve(heights, shape)[:1500], rtol=0, atol=1e-13)
    assert y.any() == bool(rate)


def test_a_grain_has_a_unit_an_end_and_a_law_at_its_own_rate():
    grain = b.grain(E, np.ones(20), rate=1000, unit="N")
    assert (
        str(grain.dim) == "N"
        and grain.memory(grain.design(1000)[0]) == 20
        and grain.memory(grain.design(500)[0]) == 10
    )
    assert len(grain.laws(1000)) == 1 and not grain.laws(500)


@pytest.mark.parametrize("ratio", [0.25, 44.1 / 48, 6.0])
def test_a_recording_at_another_rate_keeps_its_waves(ratio):
    n = np.arange(3000)
    f = 0.42 * min(1, ratio)
    k = np.arange(int(np.ceil(3000 * ratio)))
    middle = slice(k.size // 4, 3 * k.size // 4)
    error = resampled(np.cos(2 * np.pi * f * n), 1, ratio) - np.cos(2 * np.pi * f * k / ratio)
    assert np.abs(error)[middle].max() < 1e-5
    above = 0.58 * ratio
    assert (
        above > 0.5
        or np.abs(resampled(np.cos(2 * np.pi * above * n), 1, ratio))[middle].max() < 1e-5
    )


def test_a_fast_recording_needs_little_memory():
    x = np.ones(20_000)  # at 1 MHz, for 1 kHz: each sample is a sum of 64000
    tracemalloc.start()
    try:
        y = resampled(x, 1, 1e-3)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert abs(y[10] - 1.0) < 0.05
    assert most < 64e6
    assert resampled(np.ones(2), 1, 1e-300).size == 1


def test_a_burst_is_symmetric_and_has_the_area_of_a_rectangle():
    y = played(b.burst(E, 0.16, 0.04), 2.0 * impulse(400, 3))
    assert np.array_equal(y[3:163], y[3:163][::-1]) and not y[:3].any() and not y[163:].any()
    assert abs(y.sum() - 2.0 * (160 - 40)) < 1e-12
    again = played(b.burst(E, 0.16, 0.04), impulse(400, 3, 50))
    assert np.array_equal(again[50:210], y[3:163] / 2) and not again[210:].any()
    assert played(b.burst(0.01, 0.005), 20).tolist() == [0.0] * 10 + [1.0] * 5 + [0.0] * 5


def test_an_envelope_reaches_1_in_time_and_starts_again_from_where_it_is():
    gate = np.r_[np.ones(50), np.zeros(10), np.ones(50), np.zeros(300)]
    y = played(b.envelope(X, attack=0.01, decay=0.005, sustain=0.4, release=0.02), gate)
    assert np.argmax(y == 1.0) == 9 and (np.diff(y[:10]) > 0).all()
    np.testing.assert_allclose(y[9:50], 0.4 + 0.6 * np.exp(-np.arange(41) / 5), rtol=1e-12)
    np.testing.assert_allclose(y[50:60], y[49] * np.exp(-np.arange(1, 11) / 20), rtol=1e-12)
    assert np.argmax(played(b.envelope(X, attack=0.2), np.ones(300)) == 1.0) == 199
    assert y[60] > y[59] and y[60:110].max() == 1.0 and y[-1] < 1e-6


def test_a_gate_that_closes_within_a_tile_ends_what_was_sustained():
    gate = np.repeat([0.0, 1.0, 0.0, 1.0], [10, 190, 30, 70])
    y = played(b.envelope(E, 0, 0, 1.0, 0), gate)
    np.testing.assert_array_equal(y, gate)


def test_what_comes_soon_after_an_event_is_lost():
    y = played(b.once_within(E, 0.01), np.ones(100))
    assert np.flatnonzero(y).tolist() == list(range(0, 100, 10))
    assert played(b.once_within(E, 1e-9), np.ones(5)).tolist() == [1] * 5


# Words that do not fit ----------------------------------------------------------------
@pytest.mark.parametrize(
    "made", [lambda v: b.ring(v, 100, 0.1), lambda v: b.grain(v, [1.0], 8000), b.count]
)
@pytest.mark.parametrize(
    "lasts",
    [X > 0.5, b.hysteresis(X, 1, 0), 1.0, Param("p", 1.0), b.count(E), b.sample_and_hold(X, E)],
    ids=str,
)
def test_what_lasts_is_no_event(made, lasts):
    with pytest.raises(
        BadValue, match=r"(ring|grain|count): .* is a lasting signal, not an event; use rising"
    ):
        made(lasts)


@pytest.mark.parametrize(
    ("made", "remedy"),
    [(b.envelope, "hold it open with burst"), (b.integrate, "count"), (b.rising, "use it as it is"),
     (lambda e: b.crossing(e, 1.0), "give a position")],
)  # fmt: skip
def test_an_event_does_not_last(made, remedy):
    for event in (
        b.rising(X),
        -b.falling(X),
        -2.0 * b.every(0.1) * X,
        abs(b.once_within(E, 0.1)) / 3.0,
    ):
        assert is_event(event)
        with pytest.raises(BadValue, match=f"is an event, which lasts one sample; .*{remedy}"):
            made(event)
    assert not is_event(2.0 / (1.0 + X)) and not is_event(X / b.rising(X))


def test_a_deep_product_is_looked_through_once():
    y = X
    for _ in range(60):
        y = y * y
    assert not is_event(y)


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda: b.crossing(X, 0.0), BadValue, "crossing: spacing = 0.0 must be above 0"),
        (lambda: b.crossing(X, 1.0, -1.0), BadValue, "hysteresis = -1 must be 0 or above"),
        (lambda: b.hysteresis(X, 0.0, 1.0), BadValue, "off = 1 must not be above on = 0"),
        (lambda: b.rising(Input("v", "m/s"), Input("w", "m")), UnitError, "cannot compare"),
        (lambda: b.at([-1.0]), BadValue, "each 0 or above"),
        (lambda: b.at([]), BadValue, "times must be one row"),
        (lambda: b.timeline([(1, 0), (0, 1)]), BadValue, "0 s comes after 1 s"),
        (lambda: b.timeline([1, 2]), BadValue, "points must be pairs"),
        (lambda: b.timeline([(0, 1)], "cubic"), BadValue, "kind = 'cubic'; choose one of step"),
        (
            lambda: b.crossing(X, stimlib.constant(0.01)),
            BadValue,
            r"Const\(0.01\); write the number 0.01",
        ),
        (lambda: b.ring(E, -1, 1), BadValue, "freq = -1 must be above 0"),
        (lambda: b.ring(E, 100, Input("d")), UnitError, "decay .* must be in s"),
        (lambda: b.ring(E, 100, 1, "square"), BadValue, "onset = 'square'; choose sine or cosine"),
        (lambda: b.grain(E, [[1.0]], 8000), BadValue, "one row of numbers"),
        (
            lambda: b.burst(E, 0.1, 0.06),
            BadValue,
            "ramp = 0.06 s must be from 0 to half of duration",
        ),
        (lambda: b.envelope(X, attack=-1), BadValue, "attack = -1 must be 0 or above"),
        (lambda: b.once_within(E, 0), BadValue, "refractory = 0.0 must be above 0"),
    ],
)
def test_what_makes_no_sense_is_told_at_once(make, error, text):
    with pytest.raises(error, match=text):
        make()


def test_tables_are_limited(monkeypatch):
    monkeypatch.setattr(stimlib.limits, "table_knots", 3)
    for make, text in (
        (lambda: b.at(np.arange(4)), "at: times"),
        (lambda: b.timeline([(k, k) for k in range(4)]), "points"),
    ):
        with pytest.raises(BadValue, match=f"{text}.* limits.table_knots"):
            make()
    monkeypatch.setattr(stimlib.limits, "state_bytes", 100)
    x, t = np.ones(20), Input("t", "s")
    blocks = {
        "grain": b.grain(E, x, 1000),
        "playback": b.playback(x, 1000),
        "moving_average": b.moving_average(X, 0.02),
    }
    for name, block in {
        **blocks,
        "playback: bytes of its table": b.playback(x, 1000, at=t),
    }.items():
        with pytest.raises(BadValue, match=f"{name}.* limits.state_bytes"):
            block.design(1000)


@pytest.mark.parametrize(
    ("block", "text"),
    [(b.ring(E, 600, 1), "ring: freq = 600 Hz does not fit"), (b.every(9e-4), "less than a sample"),
     (b.burst(E, 1e-4), "less than half a sample")],
)  # fmt: skip
def test_what_does_not_fit_the_sample_rate_is_told_when_it_is_compiled(block, text):
    with pytest.raises(BadValue, match=text):
        stimlib.compile(Scene({"y": block}), 1000)


# Sums and levels ----------------------------------------------------------------------
def test_an_integral_is_exact_for_straight_lines_and_after_hours():
    assert stimlib.compile(Scene({"y": b.integrate(1.0)}), 4).process(np.empty((0, 2)))[
        0
    ].tolist() == [0.125, 0.375]
    proc = stimlib.compile(Scene({"y": b.integrate(X)}), 1000)
    y = proc.process(np.full((1, 1_000_000), 0.1))[0]
    proc.state = proc.state  # goes on where it was
    y = np.append(y, proc.process(np.full((1, 1_000_000), 0.1))[0])
    assert abs(y[-1] - (2e6 - 0.5) * 1e-4) < 1e-13 * y[-1]
    t, leak = np.arange(3000) / 1000, 5.0
    leaky = stimlib.compile(Scene({"y": b.integrate(X, leak)}), 1000).process(t[None])[0]
    wanted = t / leak - -np.expm1(-leak * t) / leak**2  # of y' = t - leak y
    np.testing.assert_allclose(leaky, wanted, rtol=1e-12, atol=1e-15)
    for fs in (2, 6):  # leak/fs above 1, and nearly 1
        t = np.arange(8) / fs
        coarse = stimlib.compile(Scene({"y": b.integrate(X, leak)}), fs).process(t[None])[0]
        np.testing.assert_allclose(coarse, t / leak - -np.expm1(-leak * t) / leak**2, rtol=1e-12)


def test_a_mean_is_of_the_nearest_number_of_samples():
    for seconds, n in ((0.0026, 3), (0.0024, 2)):
        y = stimlib.compile(Scene({"y": b.moving_average(X, seconds)}), 1000, "python").process(
            np.eye(1, 4)
        )[0]
        np.testing.assert_allclose(y, np.where(np.arange(4) < n, 1 / n, 0.0), rtol=1e-15)


@pytest.mark.parametrize("n", [63, 64, 71, 800])
def test_a_mean_is_as_near_as_its_taps_at_every_block_size(n):
    x = np.random.default_rng(0).standard_normal(20_000)
    wanted = np.convolve(x.astype(np.longdouble), np.ones(n, np.longdouble))[: x.size] / n
    mean = stimlib.compile(Scene({"y": b.moving_average(X, n / 1000)}), 1000)
    taps = stimlib.compile(Scene({"y": b.fir(X, np.full(n, 1 / n))}), 1000)
    y = mean.process(x[None])[0]
    error, before = (np.std((v - wanted).astype(float)) for v in (y, taps.process(x[None])[0]))
    assert error <= before
    x = x[: 3 * n + 5]
    block, row = b.moving_average(X, n / 1000), np.zeros(x.size)
    p, s = block.design(1000)
    for k in (-57, *range(7, x.size, 64)):  # numpy tells what goes beyond a state or scratch
        part = slice(max(0, k), k + 64)
        s = block.tile(p, s, x[part], row[part], np.zeros(block.work(p)))
    np.testing.assert_array_equal(row, y[: x.size])
    for size in (1, 7, 64, 100, n):
        mean.reset()
        parts = [mean.process(x[None, k : k + size]) for k in range(0, x.size, size)]
        np.testing.assert_array_equal(np.concatenate(parts, axis=1)[0], y[: x.size])


def test_a_mean_keeps_nothing_of_what_has_left_it():
    x = np.concatenate([1e12 * np.random.default_rng(1).standard_normal(999), np.zeros(900)])
    y = stimlib.compile(Scene({"y": b.moving_average(X, 0.1)}), 1000).process(x[None])[0]
    assert np.all(y[999:1098] != 0.0) and not np.any(y[1098:])


@pytest.mark.parametrize("n", [1, 5, 8, 40, 63, 64, 100])
@pytest.mark.parametrize("target", ["python", "numba"])
def test_a_sample_that_is_not_finite_leaves_an_average_after_its_length(n, target):
    """Rounded up to eight samples where taps are filled up with zeros: 0 times inf."""
    x, taps = np.ones(300), np.full(n, 1 / n)
    x[10] = np.nan
    for made, first in ((b.moving_average(X, n / 1000), 64), (b.fir(X, taps), math.inf)):
        length = n if n >= first else 8 * math.ceil(n / 8)
        proc = stimlib.compile(Scene({"y": made > -1.0}), 1000, target)  # NaN is not above
        y = np.concatenate([proc.process(part[None])[0] for part in (x[:37], x[37:])])
        assert np.flatnonzero(y == 0.0).tolist() == list(range(10, 10 + length))


@pytest.mark.parametrize("attack, release", [(0.01, 0.1), (0.0, 0.01), (1.0, 300.0)])
def test_a_level_is_as_near_as_by_the_formula_of_its_docstring(attack, release):
    gains = [1.0 if t == 0 else -np.expm1(-1 / (t * 8000)) for t in (attack, release)]
    exact, plain, errors = np.longdouble(0.0), 0.0, []
    x = np.random.default_rng(2).standard_normal(20_000)
    y = stimlib.compile(Scene({"y": b.envelope_follower(X, attack, release)}), 8000).process(
        x[None]
    )
    for a, computed in zip(np.abs(x), y[0], strict=True):
        exact = exact + np.longdouble(gains[0] if a > exact else gains[1]) * (a - exact)
        plain = plain + (gains[0] if a > plain else gains[1]) * (a - plain)
        errors.append((float(computed - exact), float(plain - exact)))
    assert np.divide(*np.std(errors, axis=0)) < 1.1


def test_a_level_rises_and_falls_with_its_time_constants():
    proc = stimlib.compile(Scene({"y": b.envelope_follower(X, 0.01, 0.1)}), 1000)
    y = proc.process(np.repeat([-2.0, 0.0], [50, 100])[None])[0]
    np.testing.assert_allclose(
        y[[9, 49, 149]], [-2 * np.expm1(-1), -2 * np.expm1(-5), y[49] * np.exp(-1)], rtol=1e-12
    )
    short = stimlib.compile(Scene({"y": b.envelope_follower(X, 0.0005)}), 1000)  # of half a sample
    assert short.process(np.array([[2.0]]))[0, 0] == pytest.approx(-2 * np.expm1(-2), rel=1e-12)


@pytest.mark.parametrize("spacing", [0.01, 1 / 3, 7.0])
@pytest.mark.parametrize("hysteresis", [0.0, 0.002])
def test_crossing_beside_a_line_is_that_of_one_sample(spacing, hysteresis):
    """A whole tile that stays between two lines is seen without a division; what lies
    on a line or beside it, by a few ulps or parts of 1e-12, must not be.
    """
    rng = np.random.default_rng(3)
    lines = spacing * rng.integers(-60, 60, 96)
    at = np.repeat(lines + hysteresis / 2 * rng.choice([-1, 0, 1], 96), 64)  # a tile each
    beside = at + spacing * rng.choice([0.0, 1e-16, -1e-16, 1e-13, -1e-13, 1e-9], at.size)
    beside[:: 640 + 1] = np.nan
    made = {
        target: stimlib.compile(Scene({"y": b.crossing(X, spacing, hysteresis)}), 1000, target)
        for target in ("numba", "python")
    }
    y = made["numba"].process(beside[None])
    one = np.concatenate([made["python"].process(v[None, None]) for v in beside], axis=1)
    assert np.array_equal(y, one) and np.count_nonzero(y) > 50


def test_a_position_that_rests_on_a_line_crosses_once():
    """Tiles in which all samples are the same, at a line, beyond it, or no numbers."""
    levels = [0.0, 0.01, 0.01, np.nan, 0.01, -0.0, 0.03, 0.03]
    x = np.repeat(levels, 64)[None]
    scene = Scene({"y": b.crossing(X, 0.01)})
    for target in ("numba", "python"):
        y = stimlib.compile(scene, 1000, target).process(x)[0]
        at = np.flatnonzero(y)
        assert at.tolist() == [64, 320, 384] and y[at].tolist() == [1, -1, 3]
