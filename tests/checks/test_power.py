"""Is what a report says it would have seen, what it would have seen?  Drawn, from formulae, and with faults put in."""

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

import stimlib
from stimlib.analysis import spectra
from stimlib.blocks.carrier import Carrier
from stimlib.checks import power
from stimlib.checks.evidence import Check, gather
from stimlib.checks.scenes import SCENES, WORDS
from stimlib.cli import app
from stimlib.motion.generators import sinusoid

F, ALARM = np.linspace(10.0, 1000.0, 150), 2e-7
SIZES = {kind: size for kind, size, _ in power.of_spectrum(F, ALARM)}


@pytest.mark.parametrize("kind", power.KINDS)
def test_errors_of_a_spectrum_are_seen_as_surely_as_is_said(kind):
    """Of drawn periodograms with such an error 95 % are refused; of one a third smaller clearly fewer."""

    def refused(size):
        rng, ratio = np.random.default_rng(3), power.KINDS[kind][1](F, size)
        return np.mean([spectra.judged(F, ratio * rng.exponential(size=F.size)).p <= ALARM for _ in range(100)])

    assert refused(SIZES[kind]) >= 0.9 and refused(0.7 * SIZES[kind]) < 0.8


def test_the_level_is_that_of_the_gamma_distribution():
    """A sum of 150 deviates alone: where its tail is passed, over what 95 % of all sums are above."""
    bands, weights = spectra.looks(F)
    tail = ALARM / 2 / (len(bands) + len(weights))
    ratio = stats.gamma.isf(tail, F.size) / stats.gamma.isf(0.95, F.size)
    assert SIZES["level"] == pytest.approx(10 * np.log10(ratio), rel=5e-3)


def test_noise_in_common_is_seen_as_surely_as_is_said():
    rng, rho = np.random.default_rng(4), power.smallest_share(100, 1e-6)
    z = rng.normal(size=(1000, 3, 100)) + 1j * rng.normal(size=(1000, 3, 100))
    a, b = z[:, 0] / np.sqrt(2), (rho * z[:, 0] + np.sqrt(1 - rho**2) * z[:, 1]) / np.sqrt(2)
    seen = np.mean([spectra.correlated_p(*pair)[1] < 1e-6 for pair in zip(a, b, strict=True)])
    assert 0.93 < seen < 0.97
    late = a * np.exp(2j * np.pi * np.arange(100) / 10)  # the same noise, later: this test does not see it
    assert not any(spectra.correlated_p(*pair)[1] < 1e-6 for pair in zip(a[:99], late, strict=False))


def test_a_shift_passes_its_limit_as_surely_as_is_said():
    size = power.smallest_shift(Check("d", "slope", 0.0, 5.0, "", deviation=2.0))
    assert stats.norm.sf(5.0, size, 2.0) == pytest.approx(0.95)


# What a report says of its own recording ---------------------------------------------------------------------------------
def test_a_carrier_that_is_wrong_by_what_a_report_excludes_is_refused(monkeypatch):
    """Just above that size the fault inside is caught, just below it passes."""
    scene, motion = stimlib.scenes.bumps(), {"x": sinusoid(0.05, 1.0)}

    def report():
        return stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, 0.5, seed=1))

    size, honest = next(s.size for s in report().certainty() if s.kind == "freq"), Carrier.design
    for factor, good in ((0.8, True), (1.2, False)):

        def design(self, fs, factor=factor):
            p, s = honest(self, fs)
            return p._replace(high=p.high * (1 + factor * size)), s

        monkeypatch.setattr(Carrier, "design", design)
        assert report().passed == good


def test_a_parameter_of_zero_and_a_law_that_failed_exclude_nothing():
    scene, motion = stimlib.scenes.bumps(amplitude=0.0), {"x": sinusoid(0.05, 1.0)}
    e = gather(scene, motion, stimlib.render(scene, motion, 8000, 0.1))
    assert [np.isnan(s.size) for s in power.certainty([], e)] == [True, True]  # of duty and freq, as nothing is shown
    assert power.certainty([Check("d", "law", 2.0, 1.0, "")], e) == []


def test_every_law_has_its_words():
    assert WORDS.keys() == SCENES.keys()


def test_a_page_that_has_no_place_is_refused_before_anything_is_verified(tmp_path):
    done = CliRunner().invoke(app, ["verify", "none.wav", "--report", str(tmp_path / "missing" / "a.html")])
    assert done.exit_code == 2 and "is not there; make it first" in " ".join(done.stderr.split())
