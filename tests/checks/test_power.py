"""Is what a report says it would have seen, what it would have seen?  Drawn, from
formulae, and with faults put in.
"""

import csv
import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from commands import ran
from laws import mostly
from refusals import refused
from scipy import stats

import stimlib
from stimlib import Input, Scene, SinkError, blocks as b, constant
from stimlib.analysis import spectra, vibration
from stimlib.checks import power
from stimlib.checks.evidence import Check, gather
from stimlib.checks.noise import noise
from stimlib.checks.power import pairs, tells
from stimlib.motion import minimum_jerk, sinusoid

ROOT = Path(__file__).parents[2]
F, ALARM = np.linspace(10.0, 1000.0, 150), 2e-7
SIZES = {kind: size for kind, size, _ in power.of_spectrum(F, ALARM)}


@pytest.mark.parametrize("kind", power.KINDS)
def test_errors_of_a_spectrum_are_seen_as_surely_as_is_said(kind):
    """Of drawn periodograms with such an error 95 % are refused; of one a third smaller
    clearly fewer.
    """

    def part(size):
        rng, ratio = np.random.default_rng(3), power.KINDS[kind][1](F, size)
        return np.mean(
            [spectra.judged(F, ratio * rng.exponential(size=F.size)).p <= ALARM for _ in range(100)]
        )

    assert part(SIZES[kind]) >= 0.9 and part(0.7 * SIZES[kind]) < 0.8


def test_a_trend_is_looked_for_along_polynomials_of_log_f():
    """Orthogonal, and of the degrees 0 to 3."""
    _, weights = spectra.looks(F)
    np.testing.assert_allclose(weights @ weights.T, np.eye(4), atol=1e-12)
    for degree, row in enumerate(weights):
        fitted = np.polynomial.Polynomial.fit(np.log(F), row, degree)
        np.testing.assert_allclose(row, fitted(np.log(F)), atol=1e-12)


def test_noise_in_common_is_seen_as_surely_as_is_said():
    rng, rho = np.random.default_rng(4), power.smallest_share(100, 1e-6)
    z = rng.normal(size=(1000, 3, 100)) + 1j * rng.normal(size=(1000, 3, 100))
    a, b = z[:, 0] / np.sqrt(2), (rho * z[:, 0] + np.sqrt(1 - rho**2) * z[:, 1]) / np.sqrt(2)
    seen = np.mean([spectra.correlated_p(*pair)[1] < 1e-6 for pair in zip(a, b, strict=True)])
    assert 0.93 < seen < 0.97
    # the same noise, later: this test does not see it
    late = a * np.exp(2j * np.pi * np.arange(100) / 10)
    assert not any(
        spectra.correlated_p(*pair)[1] < 1e-6 for pair in zip(a[:99], late, strict=False)
    )


@pytest.mark.parametrize(
    ("lowest", "band"), [(5.0, (5.0, 200.0)), (0.5, (2.0, 200.0)), (300.0, None)]
)
def test_two_noises_are_compared_in_the_band_that_both_have(lowest, band):
    """And where that has too few frequencies, it is said, and no check is there that
    cannot fail.
    """
    gate = b.velocity(Input("x", "m"), 20) > 0
    pink = b.enabled(b.pink_noise(1e-3, seed=1, f_low=lowest), by=gate)
    later = b.velocity(Input("x", "m"), 20) > constant(1e-3, "m/s")
    slow = b.enabled(b.velocity(b.white_noise(seed=1, stream=1), 200), by=later)
    scene, motion = Scene({"a": pink, "b": slow}), {"x": minimum_jerk()}
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, 4.0))
    ((one, other, low, high, bins),) = pairs(report.evidence)
    assert one.stream.size > other.stream.size  # they are compared as far as both go
    assert report.passed and (low, high) == (band or (lowest, 200.0))
    assert (
        tells(bins, report.evidence.share)
        == any("independence" in c.name for c in report.checks)
        == (band is not None)
    )
    assert (
        "a and b: independence: they begin with one seed, or have too few frequencies in common to"
        " tell even equal noises" in report.evidence.skipped
    ) == (band is None)
    assert sum("independence" in s.check for s in report.certainty()) == (band is not None)
    if band is not None:  # of the same noise twice, once for a shorter time
        first, e = report.evidence.taps[0], report.evidence
        e.taps[1] = dc.replace(e.taps[1], stream=first.stream[:-100], model=first.model)
        assert [c.passed for c in noise(e) if "independence" in c.name] == [False]


def test_a_shift_passes_its_limit_as_surely_as_is_said():
    size = power.smallest_shift(Check("d", "slope", 0.0, 5.0, "", deviation=2.0))
    assert stats.norm.sf(5.0, size, 2.0) == pytest.approx(0.95)


# The committed table ------------------------------------------------------------------
BENCH = "power"  # see tests/conftest.py


ROWS = list(
    csv.DictReader((ROOT / "benchmarks" / "results" / "power.csv").read_text().splitlines())
)[1:]
SEARCHED = {
    f"{r['check']}, {r['kind']}, {r['seconds']} s": r for r in ROWS if r["how"] == "searched"
}
QUICK = [
    "Differentiator: physical law, delay, 0.05 s",
    "force: full sum, order, 0.5 s",
    "voltage: envelope times carrier, duty, 0.5 s",
]


@pytest.mark.parametrize("name", mostly(QUICK, SEARCHED))
def test_the_table_holds_for_the_verifier_of_today(bench, name):
    """Just above the smallest fault it is caught, just below it passes."""
    r = SEARCHED[name]
    fault = next(
        f for f in bench.BLOCKS + bench.SCENES if (f.check, f.kind) == (r["check"], r["kind"])
    )
    size, seconds = float(r["size"]), float(r["seconds"])
    assert (
        bench.excess(fault, 1.01 * size, seconds) > 1 >= bench.excess(fault, size / 1.12, seconds)
    )


def test_the_table_of_the_documentation_is_that_of_ten_seconds(bench):
    with (ROOT / "docs" / "explanation" / "power.csv").open(newline="") as f:
        shown = [tuple(row) for row in csv.reader(f)]
    assert shown == bench.summary(ROWS)
    assert ("force1: spectrum", "level", "1.1 dB", "95 of 100") in shown and len(shown) == 19


# What a report says of its own recording ----------------------------------------------
def test_what_a_report_excludes_is_what_the_table_says():
    scene, motion = stimlib.scenes.bumps(), {"x": sinusoid(0.05, 1.0)}
    found = {
        s.kind: s.size
        for s in stimlib.verify(
            scene, motion, stimlib.render(scene, motion, 8000, 0.5, seed=1)
        ).certainty()
    }
    for name, kind in (("A", "level"), ("duty", "duty"), ("freq", "frequency")):
        assert found[name] == pytest.approx(
            float(SEARCHED[f"voltage: envelope times carrier, {kind}, 0.5 s"]["size"]), rel=0.1
        )


@pytest.mark.parametrize("power_of_it", [1, 1.3, 2], ids=["proportional", "steeper", "quadratic"])
def test_a_law_is_asked_for_exact_checks_alone_and_says_what_it_refused(monkeypatch, power_of_it):
    """At 1e-4 it begins to refuse; a slope that chance puts far off says nothing."""
    scene, motion = stimlib.scenes.bumps(), {"x": sinusoid(0.05, 1.0)}
    e = gather(scene, motion, stimlib.render(scene, motion, 8000, 0.05))

    def law(told):
        off = 1 - told.params["A"] / e.params["A"]
        # the change right before sample 0 too
        assert [c.value for c in told.changes if c.name == "A"] == [told.params["A"]]
        law = Check("d", "law", (abs(off) / 1e-4) ** power_of_it, 1.0, "")
        return [
            law,
            Check("d", "looser", law.measured / 4, 1.0, ""),
            Check("d", "slope", 9.0, 1.0, "", deviation=1.0),
        ]

    monkeypatch.setattr(power, "scene_law", law)
    found = next(s for s in power.of_parameters(e) if s.kind == "A")
    assert 1e-4 < found.size <= (1.05e-4 if power_of_it < 2 else 1e-3) and found.chance == 1.0


@pytest.fixture
def still():
    """Bumps under a finger at rest, of which no law is asked."""
    scene, motion = stimlib.scenes.bumps(), {"x": np.zeros(9)}
    return gather(scene, motion, stimlib.render(scene, motion, 8000, target="python"))


def test_a_number_in_whose_place_0_would_do_is_never_seen_to_be_wrong(still, monkeypatch):
    def law(told):
        return [
            Check("d", "law", (1 - told.params[name] / still.params[name]) / 1.5, 1.0, "")
            for name in still.params
        ]

    monkeypatch.setattr(power, "scene_law", law)
    assert [np.isnan(s.size) for s in power.of_parameters(still)] == [True] * 3


def test_a_parameter_of_zero_excludes_nothing():
    scene, motion = stimlib.scenes.bumps(amplitude=0.0), {"x": sinusoid(0.05, 1.0)}
    e = gather(scene, motion, stimlib.render(scene, motion, 8000, 0.1))
    # of duty and freq, as nothing is shown
    assert [np.isnan(s.size) for s in power.certainty([], e)] == [True, True]


def test_the_law_is_asked_unless_it_failed_or_the_motion_is_no_number(still, monkeypatch):
    monkeypatch.setattr(power, "of_parameters", lambda e: ["asked"])
    bits, law = Check("b", "bits", 1.0, 0.0, ""), Check("d", "law", 0.0, 0.0, "")
    slope = Check("d", "slope", 6.0, 5.0, "", deviation=2.0)
    shift = power.Shows("slope", "stiffness", power.smallest_shift(slope), "N/m", 0.95)
    for checks, said in (
        ([bits, law], ["asked"]),
        ([dc.replace(law, measured=2.0)], []),
        ([slope], [shift]),
    ):
        assert power.certainty(checks, still) == said
    still.x[0, 3] = np.nan
    assert power.certainty([], still) == []


def test_a_law_that_is_asked_again_leaves_the_evidence_of_the_page_as_it_was(still, monkeypatch):
    def law(told):
        for f in (told.fingers, told.curves, told.wanted):
            f["told another number"] = 1.0
        for f in (told.numbers, told.skipped):
            f.append("of another scene")
        return []

    monkeypatch.setattr(power, "scene_law", law)
    assert power.of_parameters(still)
    assert not any((still.fingers, still.curves, still.wanted, still.numbers, still.skipped))


def test_an_error_that_no_size_makes_visible_has_none():
    assert power.smallest(lambda e: e / (1 + e)) == pytest.approx(19.0, rel=1e-3)
    assert np.isnan(power.smallest(lambda e: 0.94 * e / (1 + e)))


def test_all_checks_of_chance_together_raise_the_alarm_once_in_a_million():
    """Each spectrum, each pair, and the slope of each output; what they measure, and
    their limits, are powers of ten.
    """
    scene, motion = stimlib.scenes.squeeze(fingers=1), {"x1": minimum_jerk()}
    e = gather(scene, motion, stimlib.render(scene, motion, 8000, 0.3))
    for count in (1, 2, 4):
        e.taps = e.taps[:1] * count
        assert e.share * (2 * count + len(pairs(e))) == pytest.approx(1e-6)
    e.taps, failed = e.taps[:1], [Check("d", "law", 2.0, 1.0, "")]
    assert power.certainty(failed, e) == []  # a spectrum that was not tested excludes nothing
    (check,) = noise(e)
    assert [s.kind for s in power.certainty(failed, e)] == list(power.KINDS)
    assert 10**-check.limit == pytest.approx(e.share) and 10**-check.measured == pytest.approx(
        e.taps[0].spectrum.p
    )


@pytest.mark.parametrize(
    ("name", "says"),
    [
        *((name, "must end in one of .html") for name in ("a.wav", "a.wav.json", "hand.csv")),
        ("missing/a.html", "is not there"),
    ],
)
def test_a_page_has_a_place_of_its_own_or_nothing_is_verified(tmp_path, name, says):
    for other in ("a.wav", "a.wav.json", "hand.csv"):
        (tmp_path / other).write_bytes(b"sound")
    ran(["verify", tmp_path / "a.wav", "--report", tmp_path / name], 2, says)
    scene, motion = Scene({"y": 2 * Input("x")}), {"x": np.ones(10)}
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000))
    refused(SinkError, "must end in one of|cannot write", report.to_html, tmp_path / name)
    assert {path.read_bytes() for path in tmp_path.iterdir()} == {b"sound"}


def test_errors_of_a_spectrum_are_in_their_units():
    """Half the power at a pole of 2 ms, and of 80 Hz; 3 dB; an octave above the middle
    of the band 3 dB/oct.
    """
    f = np.array([20.0, 1 / (2 * np.pi * 2e-3), 80.0])
    ratio = {
        kind: power.KINDS[kind][1](f, size)
        for kind, size in zip(power.KINDS, (3.0, 3.0, 2e-3, 80.0), strict=True)
    }
    for got in (
        ratio["level"][0],
        ratio["slope"][2],
        ratio["low-pass pole"][1],
        1 / ratio["high-pass pole"][2],
    ):
        assert got == pytest.approx(0.5 if got < 1 else 2.0, rel=3e-3)
    assert ratio["low-pass pole"][1] < 1 < ratio["slope"][2]


def test_the_expected_spectrum_is_the_model_seen_through_the_taper():
    """The taper's kernel by zero padding, where ``whitened`` has it in closed form."""
    n, fine = 4096, 64
    x = np.random.default_rng(0).standard_normal(n)

    def model(f):
        return 1 / np.maximum(np.abs(f), 1 / 8) ** 2

    f, W, _ = spectra.whitened(x, n, model, 4, 400)  # a bin is 1 Hz
    taper = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
    d = np.arange(-40 * fine, 40 * fine + 1)
    kernel = np.abs(np.fft.fft(taper, fine * n)[d]) ** 2
    expected = [
        n / 2 * np.sum(taper**2) * np.average(model(k + d / fine), weights=kernel) for k in f
    ]
    periodogram = np.abs(np.fft.rfft(x * taper))[np.round(f).astype(int)] ** 2
    np.testing.assert_allclose(periodogram / W, expected, rtol=1e-3)


@pytest.mark.parametrize("n", [65, 66, 67, 68, 69, 70])
def test_no_bin_depends_on_its_mirror_image(n):
    """Half the rate is a real number, whose square has a heavier tail than Exp(1)."""
    j, k = np.arange(n), spectra.bins(n, 1000.0, 1.0, 500.0)
    taper = np.sin(np.pi * (j + 0.5) / n) ** 2
    mirrored = np.exp(-4j * np.pi * np.outer(k, j) / n) @ taper**2
    assert k[-1] > n / 2 - 5 and np.abs(mirrored).max() < 1e-9


def test_a_last_group_of_too_few_bins_joins_its_neighbour():
    parts = [np.arange(5), np.arange(5, 8), np.arange(8, 12), np.arange(12, 14)]
    assert [p.tolist() for p in spectra._at_least(parts, 4)] == [[*range(5)], [*range(5, 14)]]


def test_numbers_whose_squares_are_beyond_a_float():
    """What is right is not refused for a step on the way to it."""
    like = spectra.tail(np.array([1.0, -1.0]), 1.0)
    assert spectra.tail(1e200 * np.array([1.0, -1.0]), 1e200) == pytest.approx(like)
    assert spectra.tail(np.array([-1.0, 1e-300]), 1.0) == 0.0
    y = np.array([1.0, 0.5, -1.0, 0.25, 0.5])  # shorter than the spline
    np.testing.assert_allclose(vibration(1e300 * y, 8000), 1e300 * vibration(y, 8000), rtol=1e-12)
