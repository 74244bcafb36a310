"""The limit of every check: a fault just inside passes, one just outside does not, and
`Report.passed` says so.
"""

import dataclasses as dc
from functools import partial

import numpy as np
import pytest

import stimlib
from stimlib.analysis import spectra
from stimlib.blocks.noise import PinkNoise
from stimlib.checks import (
    Check,
    Report,
    evidence,
    laws,
    linear,
    noise,
    scenes,
    sidecar,
    verification,
)
from stimlib.checks.page import GROUPS
from stimlib.files import audio as file
from stimlib.motion import minimum_jerk, recording
from stimlib.run.driver import samples
from stimlib.run.processor import Change
from stimlib.scenes import squeeze

INSIDE, OUTSIDE = 0.97, 1.03  # of the limit


def gathered(scene, motion, seconds=1.0):
    return evidence.gather(scene, motion, stimlib.render(scene, motion, 8000, seconds, seed=3))


@pytest.fixture(scope="module")
def squeezed():
    return gathered(squeeze(), {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.01)})


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    path = tmp_path_factory.mktemp("stored") / "a.flac"
    proc = stimlib.compile(squeeze(fingers=1), 8000)
    file.write(path, proc, {"x1": minimum_jerk()}, 1.0, full_scale=64.0, progress=False)
    return evidence.gather(squeeze(fingers=1), {"x1": minimum_jerk()}, path)


def fresh(e, **what):
    return dc.replace(e, skipped=[], fingers={}, curves={}, taps=list(e.taps), **what)


def passed(checks, e, name):
    """Whether a report of the checks of this name passes, and none is missing."""
    some = [c for c in checks if name in c.name]
    assert some, [c.name for c in checks]
    return Report(some, e).passed


@pytest.mark.parametrize("group", GROUPS)
def test_every_group_counts(squeezed, group):
    good = [Check(g, g, 1.0, 1.0, "") for g in GROUPS]
    bad = Check(group, "bad", float(np.nextafter(1.0, 2.0)), 1.0, "")
    assert Report(good, squeezed).passed and not Report([*good, bad], squeezed).passed
    assert "FAILED" in str(Report([*good, bad], squeezed)) and "bad" in repr(
        Report([*good, bad], squeezed)
    )


@pytest.mark.parametrize(("size", "good"), [(INSIDE, True), (OUTSIDE, False)])
class TestLinearBlocks:
    def test_impulse_response(self, monkeypatch, squeezed, size, good):
        honest = PinkNoise.transfer
        monkeypatch.setattr(
            PinkNoise, "transfer", staticmethod(lambda p, z: honest(p, z) * (1 + size * 1e-10))
        )
        assert (
            passed(
                verification.linear_blocks(fresh(squeezed)), squeezed, "PinkNoise: impulse response"
            )
            == good
        )

    def test_physical_law(self, monkeypatch, squeezed, size, good):
        tol = 10 ** (0.01 / 20) - 1  # a hundredth of a decibel

        def transfer(p, z):
            return np.sqrt(1 / np.pi / (np.angle(z) * 8000 / 2 / np.pi) * 4000) * (1 + size * tol)

        monkeypatch.setattr(PinkNoise, "transfer", staticmethod(transfer))
        assert (
            passed(verification.linear_blocks(fresh(squeezed)), squeezed, "PinkNoise: physical law")
            == good
        )


def test_tolerances_are_those_that_blocks_promise():
    fs = 8000.0
    for b, tols in (
        (PinkNoise(stimlib.blocks.white_noise(1), 1.0, 10.0, 0.01), [10 ** (0.01 / 20) - 1]),
        (stimlib.blocks.pinking(stimlib.Input("x"), 10.0, 0.5), [10 ** (0.5 / 20) - 1]),
        (stimlib.blocks.differentiator(stimlib.Input("x"), 1000.0), [1e-6]),
        (
            stimlib.blocks.velocity(stimlib.Input("x")),
            [(2 * np.pi * 100 / fs) ** 2 / 4 + 1e-12, 1e-12],
        ),
        (stimlib.blocks.first_order(stimlib.Input("x"), 0.01), [3e-5, 1e-10]),
        (stimlib.blocks.track(stimlib.Input("x")), [1e-6]),
        (stimlib.blocks.fir(stimlib.Input("x"), [1.0]), [1e-12]),
        (stimlib.blocks.fir(stimlib.Input("x"), np.ones(500)), [1e-12]),
        (stimlib.blocks.fir(stimlib.Input("x"), np.ones(5000)), [1e-11]),
    ):
        assert [law.tol for law in linear.laws_of(b, fs)] == pytest.approx(tols, rel=1e-9)


@pytest.mark.parametrize(
    ("taps", "fs"),
    [
        (np.random.default_rng(5).normal(size=5000), 7919.3),
        (np.r_[np.zeros(4999), 1.0], 44100.0),
    ],
    ids=["random", "last"],
)
def test_the_rounding_of_many_taps_is_within_their_limit(taps, fs):
    def law_of(taps):
        (law,) = linear.laws_of(stimlib.blocks.fir(stimlib.Input("x"), taps), fs)
        return law

    law = law_of(taps)
    b = stimlib.blocks.fir(stimlib.Input("x"), taps)
    transfer = partial(verification._response, type(b).transfer, b.design(fs)[0], fs)
    assert law.tol / 100 < law.error(transfer, fs) < law.tol / 2
    assert law_of(taps + 1e-8 * (np.arange(5000) == 7)).error(transfer, fs) > law.tol


@pytest.mark.parametrize(("size", "good"), [(INSIDE, True), (OUTSIDE, False)])
class TestNoise:
    def test_generator(self, monkeypatch, squeezed, size, good):
        honest = laws.white
        monkeypatch.setattr(
            laws, "white", lambda *a: honest(*a) + np.sign(honest(*a)) * size * 1e-13
        )
        assert passed(noise.generator(fresh(squeezed)), squeezed, "generator") == good

    def test_noise_as_displayed(self, squeezed, size, good):
        t = squeezed.taps[0]
        stream = t.stream + size * 1e-11 * np.abs(t.stream).max()
        e = fresh(squeezed)
        e.taps[0] = dc.replace(t, stream=stream)
        assert passed(noise.generator(e), e, "noise as displayed") == good

    def test_spectrum_and_independence(self, monkeypatch, squeezed, size, good):
        share = 1e-6 / 5  # two spectra, one pair, two slopes
        honest = spectra.test_spectrum
        monkeypatch.setattr(
            spectra, "test_spectrum", lambda *a: honest(*a)._replace(p=share / size)
        )
        monkeypatch.setattr(spectra, "correlated_p", lambda *a: (0.0, 1.0))
        assert passed(noise.noise(fresh(squeezed)), squeezed, "spectrum") == good
        monkeypatch.setattr(spectra, "test_spectrum", honest)
        monkeypatch.setattr(spectra, "correlated_p", lambda *a: (0.0, share / size))
        assert passed(noise.noise(fresh(squeezed)), squeezed, "independence") == good


@pytest.mark.parametrize("n", [2000, 8000])
def test_every_band_and_every_trend_counts_as_a_test(squeezed, n):
    """The least p is multiplied by how often the stream was looked at."""
    t = squeezed.taps[0]
    s = spectra.test_spectrum(1.3 * t.stream[:n], 8000, t.model, t.f_low, t.f_high)
    bins = sum(b.bins for b in s.bands)
    assert (
        s.p
        == min(1.0, (len(s.bands) + min(4, bins // 16)) * min([s.trend_p, *(b.p for b in s.bands)]))
        < 1.0
    )


def crossing(e, name, run, fault, about):
    """The measure of a check is proportional to the size of a fault: just inside its
    limit and just outside; the size at the limit.
    """
    c = next(c for c in run(fault(about)) if name in c.name)
    unit = about * c.limit / c.measured
    assert 0.5 < c.measured / c.limit < 1e6
    for size, good in ((INSIDE, True), (OUTSIDE, False)):
        assert passed(run(fault(size * unit)), e, name) == good
    return unit


def shifted(e, field, how, row=0):
    y = getattr(e, field).copy()
    y[row] += how(e)
    return fresh(e, **{field: y})


class TestSqueeze:
    @pytest.mark.parametrize("steps", [0, 4000])
    @pytest.mark.parametrize(("size", "good"), [(0.9, True), (1.2, False)])
    def test_mean_part(self, monkeypatch, squeezed, steps, size, good):
        """Each step of a ramp of k may round, by half a unit of its last place."""
        e = fresh(squeezed)
        if steps:
            e.changes = [Change(100, "k", 2345.0, steps / 8000)]
            e.y = samples(stimlib.compile(e.scene, e.fs, seed=e.seed), e.x, e.x.shape[1], e.changes)
        assert passed(scenes.scene_law(fresh(e)), e, "force1: mean part")
        honest, tol = laws.squeeze_finger, 1e-14 + steps * 2.0**-52

        def finger(*a):
            f = honest(*a)
            top = np.abs(f.force).max() * size * tol
            return f._replace(mean=f.mean + top, force=f.force + top)

        monkeypatch.setattr(laws, "squeeze_finger", finger)
        assert passed(scenes.scene_law(fresh(e)), e, "force1: mean part") == good

    def test_slope(self, squeezed):
        first = next(c for c in scenes.scene_law(fresh(squeezed)) if "force1: slope" in c.name)
        here = float(np.polyfit(squeezed.x[0], squeezed.shown[0], 1)[0]) - 2000.0
        assert first.limit == pytest.approx(0.066, rel=0.2)  # 5.2 deviations: 33 millionths of k
        for size, good in ((INSIDE, True), (OUTSIDE, False)):
            e = shifted(
                squeezed,
                "shown",
                lambda e, size=size: (size * first.limit * np.sign(here) - here) * e.x[0],
            )
            assert passed(scenes.scene_law(e), e, "force1: slope") == good

    @pytest.mark.parametrize(("size", "told"), [(INSIDE, False), (OUTSIDE, True)])
    def test_a_slope_is_fitted_where_storage_shifts_it_by_a_thousandth_at_most(
        self, squeezed, size, told
    ):
        u = squeezed.x[0] - squeezed.x[0].mean()
        top = size * 1e-3 * 2000.0 * (u @ u) / np.abs(u).sum() * 2**23
        e = fresh(
            squeezed,
            sidecar={"subtype": "PCM_24", "channels": [{"full_scale": top}, {"full_scale": 64.0}]},
        )
        assert any("force1: slope" in c.name for c in scenes.scene_law(e)) != told
        assert any("force1: the position hardly changes" in text for text in e.skipped) == told


@pytest.mark.parametrize(("size", "settled"), [(INSIDE, True), (OUTSIDE, False)])
def test_an_impulse_response_has_settled_at_1e_15_of_its_peak(size, settled):
    """Of two million samples the last 4096 are looked at."""
    b = stimlib.blocks.first_order(stimlib.Input("x"), size * 511 * 4096 / np.log(1e15) / 8000)
    e = gathered(stimlib.Scene({"y": b}), {"x": np.ones(100)}, None)
    names = [c.name for c in verification.linear_blocks(e)]
    assert any("impulse response" in name for name in names) == settled
    assert any("never settles" in text for text in e.skipped) != settled


WOBBLE = np.where(np.arange(8000) % 2, 1.0, -1.0)


@pytest.mark.parametrize(
    ("name", "y", "off", "about", "limit"),
    [
        ("stored finely", lambda y: y, WOBBLE, 1e-2, None),
        ("stored finely", lambda y: np.full((1, 8000), 10.0), WOBBLE, 1e-4, 1e-4),  # never moves
        ("clipped", lambda y: np.where(np.arange(8000) == 100, 65.0, y), 1.0, 10.0, None),
    ],
    ids=["rounding", "rounding of what never moves", "clipping"],
)
def test_storage(stored, name, y, off, about, limit):
    right = y(stored.y)
    unit = crossing(
        stored,
        name,
        sidecar.storage,
        lambda size: fresh(stored, y=right, shown=right + size * off),
        about,
    )
    assert limit is None or unit == pytest.approx(limit)


@pytest.mark.parametrize(("periods", "silences"), [(2.4, 0), (2.6, 1), (3.4, 1)])
def test_a_silence_is_two_and_a_half_periods(tmp_path, periods, silences):
    t = 0.01 * np.r_[np.arange(40.0), 39 + periods + np.arange(40)]
    rows = "\n".join(f"{a:.6f},{b:.6f}" for a, b in zip(t, 0.001 * np.arange(80), strict=True))
    (tmp_path / "a.csv").write_text(f"t_s,x_m\n{rows}\n")
    info = recording(tmp_path / "a.csv", {"x": "x_m"}, time="t_s", reports="on_change").info
    assert info["silences"] == silences
