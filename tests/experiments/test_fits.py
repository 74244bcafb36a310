"""Psychometric fits: against other programs, against the truth of simulated people, and
of data that determine nothing.
"""

import dataclasses as dc
from fractions import Fraction

import numpy as np
import pandas
import pytest
from experiments.some import experiment
from laws import STRESS
from refusals import refused
from scipy.optimize import minimize
from scipy.special import ndtr, ndtri, xlogy
from scipy.stats import chi2, f
from statsmodels.genmod.families import Binomial, links
from statsmodels.genmod.generalized_linear_model import GLM

from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    ConstantStimuli,
    PsychometricObserver as Observer,
    Stimulus,
    TwoInterval,
    bootstrap,
    fitted,
    likelihood,
    likelihood_ratio,
    profile,
    psychometric,
    psychometrics,
    simulate,
)
from stimlib.experiments.goodness import allowed, dispersion, goodness
from stimlib.experiments.likelihood import (
    LINKS,
    PROBIT,
    Model,
    Sets,
    curve,
    ends,
    maximum,
    probability,
)

LEVELS, YES, ASKED = (
    np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0]),
    np.array([1, 4, 9, 17, 19, 20]),
    np.full(6, 20),
)
WAYS = ("profile", "bootstrap")


# The same as elsewhere ----------------------------------------------------------------
@pytest.mark.parametrize("link", ["probit", "logit"])
@pytest.mark.parametrize("log", [False, True])
def test_fits_are_those_of_statsmodels(link, log):
    family = Binomial({"probit": links.Probit, "logit": links.Logit}[link]())
    x = np.column_stack([np.ones(6), np.log10(LEVELS) if log else LEVELS])
    other = GLM(np.column_stack([YES, ASKED - YES]), x, family=family).fit(tol=1e-15, maxiter=200)
    fit = psychometric(LEVELS, YES, ASKED, link=link, log=log, interval="none")
    assert [fit.intercept, fit.slope] == pytest.approx(list(other.params), rel=1e-8)
    assert fit.deviance == pytest.approx(other.deviance, rel=1e-8)
    trials = np.repeat([1, 0], [YES.sum(), (ASKED - YES).sum()])
    at = np.concatenate([np.repeat(LEVELS, YES), np.repeat(LEVELS, ASKED - YES)])
    # an answer at a time
    assert repr(psychometric(at, trials, link=link, log=log, interval="none")) == repr(fit)


@pytest.mark.parametrize("dispersion", [1.0, 1.5, None])
def test_a_profile_interval_is_where_a_held_parameter_costs_so_much(dispersion):
    """By trying, of the likelihood as it is written down, which has several peaks:
    guesses of one half, lapses of 2 %.
    """
    yes, asked = np.array([33, 30, 39, 54, 57, 60]), 60
    how = dict(guess=0.5, lapse=0.02, confidence=0.9, dispersion=dispersion)
    fit = psychometric(LEVELS, yes, 3 * ASKED, **how)

    def deviance(pse, sigma):
        p = 0.5 + 0.48 * ndtr((LEVELS - pse) / sigma)
        return -2 * np.sum(yes * np.log(p) + (asked - yes) * np.log(1 - p))

    fall = dispersion * chi2.ppf(0.9, 1) if dispersion else fit.dispersion * f.ppf(0.9, 1, 4)
    assert fall > chi2.ppf(0.9, 1) or dispersion == 1
    pses, sigmas = np.linspace(1.5, 3.5, 401), np.geomspace(0.005, 3, 401)
    least = [min(deviance(end, s) for s in sigmas) for end in fit.pse_interval]
    least += [min(deviance(m, end) for m in pses) for end in fit.sigma_interval]
    assert least == pytest.approx([deviance(fit.pse, fit.sigma) + fall] * 4, abs=2e-3)
    assert deviance(fit.pse, fit.sigma) == pytest.approx(-2 * fit.loglik)
    assert fit.pse_interval[0] < fit.pse < fit.pse_interval[1]
    assert fit.sigma_interval[0] < fit.sigma < fit.sigma_interval[1]
    assert fit(np.array([fit.pse, 1e9])) == pytest.approx([0.74, 0.98])
    few = [chi2.ppf(0.95, 1), 2 * f.ppf(0.95, 1, 1), 2 * f.ppf(0.95, 1, 2)]
    assert allowed([2.0, 2.0, 2.0], [0, 1, 2]) == pytest.approx(few)


@pytest.mark.parametrize(
    ("link", "levels", "yes", "asked"),
    [
        ("logit", [1.0, 2.0, 3.0, 4.0, 5.0], [0, 0, 0, 1, 2], [16, 18, 7, 18, 3]),
        ("weibull", [0.623, 1.2, 1.27, 3.19, 3.67], [0, 2, 4, 9, 32], [3, 8, 16, 9, 32]),
    ],
)
def test_an_interval_of_sigma_goes_on_where_a_climb_began_too_far_away(link, levels, yes, asked):
    """Without guesses and lapses, of close levels: by trying every middle."""
    fit = psychometric(levels, yes, asked, link=link, dispersion=1.0)
    x, middles = np.array(levels), np.linspace(-3, 9, 240001)[:, None]
    x, middles = (np.log10(x), middles / 3) if fit.log else (x, middles)
    for sigma in fit.sigma_interval:
        more, less = probability((x - middles) / sigma, link)
        best = np.max(np.log(more) @ yes + np.log(less) @ np.subtract(asked, yes))
        assert 2 * (fit.loglik - best) == pytest.approx(chi2.ppf(0.95, 1), abs=1e-3)


@pytest.mark.parametrize("p", [0.6, 0.75, 0.95])
def test_the_interval_of_a_level_is_where_the_profile_has_fallen(p):
    """By trying, as above; at the middle it is that of the PSE."""
    yes, asked = np.array([33, 30, 39, 54, 57, 60]), 60
    how = dict(guess=0.5, lapse=0.02, confidence=0.9)
    fit = psychometric(LEVELS, yes, 3 * ASKED, dispersion=1.0, **how)
    z = ndtri((p - 0.5) / 0.48)

    def deviance(level, sigma):
        at = 0.5 + 0.48 * ndtr((LEVELS - level) / sigma + z)
        return -2 * np.sum(yes * np.log(at) + (asked - yes) * np.log(1 - at))

    fall, sigmas = chi2.ppf(0.9, 1), np.geomspace(0.005, 30, 4001)
    low, high = fit.level_interval(p)
    least = [min(deviance(end, s) for s in sigmas) for end in (low, high)]
    assert least == pytest.approx([-2 * fit.loglik + fall] * 2, abs=2e-3)
    assert low < fit.level(p) < high
    assert fit.level_interval(0.74) == pytest.approx(fit.pse_interval, rel=1e-6)
    wide = psychometric(LEVELS, yes, 3 * ASKED, dispersion=2.0, **how).level_interval(p)
    assert wide[0] < low and high < wide[1]
    assert np.isnan([*fit.level_interval(0.99), *fit.level_interval(0.5)]).all()
    none = psychometric(LEVELS, yes, 3 * ASKED, interval="none", **how)
    assert np.isnan(none.level_interval(p)).all()
    # not determined
    assert np.isnan(psychometric([1, 2], [0, 5], [5, 5]).level_interval(p)).all()


@pytest.mark.parametrize("log", [False, True])
def test_the_interval_of_a_level_by_bootstrap_is_near_that_by_profile(log):
    how = dict(dispersion=1.0, log=log)
    fits = [psychometric(LEVELS, 9 * YES, 9 * ASKED, interval=v, **how) for v in WAYS]
    for p in (0.5, 0.75, 0.9):
        ends_ = [fit.level_interval(p) for fit in fits]
        assert ends_[1] == pytest.approx(ends_[0], rel=0.02)
    assert fits[1].level_interval(0.5) == pytest.approx(fits[1].pse_interval, rel=1e-9)


@pytest.mark.parametrize(("p", "guess"), [(0.9, None), (0.75, 0.5), (0.9, 0.5)])
def test_intervals_of_levels_hold_the_truth(p, guess):
    """Of 95 %; seven levels, 40 answers each."""
    people, z = (200 if STRESS else 20), np.linspace(-2, 2, 7)
    rng, low = np.random.default_rng([3, int(100 * p)]), guess or 0.0
    yes = rng.binomial(40, low + (1 - low) * ndtr(z), (people, 7))
    fits = psychometrics(
        {k: (z, row, np.full(7, 40)) for k, row in enumerate(yes)}, guess=guess, dispersion=1.0
    )
    true = ndtri((p - low) / (1 - low))
    ends_ = np.array([fit.level_interval(p) for fit in fits.values() if not fit.problems])
    held = np.mean((ends_[:, 0] <= true) & (true <= ends_[:, 1]))
    assert len(ends_) >= 0.9 * people
    assert (0.91 if STRESS else 0.8) <= held <= (0.99 if STRESS else 1.0)


@pytest.mark.parametrize("link", ["probit", "logit"])
def test_a_curve_through_a_known_middle_is_that_of_statsmodels_without_an_intercept(link):
    """With one parameter, and an interval of sigma that is that of each level."""
    family = Binomial({"probit": links.Probit, "logit": links.Logit}[link]())
    x = (LEVELS - 2.0)[:, None]
    other = GLM(np.column_stack([YES, ASKED - YES]), x, family=family).fit(tol=1e-15, maxiter=200)
    fit = psychometric(LEVELS, YES, ASKED, link=link, pse=2.0)
    assert (fit.pse, fit.pse_interval, fit.parameters) == (2.0, (2.0, 2.0), 1)
    assert fit.slope == pytest.approx(other.params[0], rel=1e-8)
    assert fit.deviance == pytest.approx(other.deviance, rel=1e-8)
    at = [2.0 + sigma * float(curve(link).inverse(0.25)) for sigma in fit.sigma_interval]
    assert fit.level_interval(0.25) == pytest.approx(at[::-1])
    # whether the middle is where it should be
    assert 0 <= likelihood_ratio([fit], [psychometric(LEVELS, YES, ASKED, link=link)]).p <= 1
    drawn = psychometric(LEVELS, YES, ASKED, link=link, pse=2.0, interval="bootstrap")
    assert drawn.sigma_interval == pytest.approx(fit.sigma_interval, rel=0.1)
    assert drawn.level_interval(0.75) == pytest.approx(fit.level_interval(0.75), rel=0.05)


def test_a_known_middle_starts_a_curve_of_differences_at_chance():
    """The table's chance level is 1/2, as the curve at 0; one level is enough."""
    answers = {"level": [8.0] * 30, "outcome": [1] * 21 + [0] * 9, "chance": [0.5] * 30}
    fit = psychometric(answers, pse=0.0)
    assert fit.problems == () and fit(0.0) == 0.5
    assert fit.sigma == pytest.approx(8.0 / ndtri(0.7), rel=1e-6)
    for pse, problem, *given in (
        (0.0, "separated", [8.0] * 9, [1] * 9),
        (0.0, "separated", [8.0, -8.0], [9, 0], [9, 9]),
        (-20.0, "separated", [-17.0] * 9, [1] * 9),  # whose mirror image is no image about 0
        (0.0, "falling", [8.0] * 9, [0] * 9),
        (0.0, "few", [0.0] * 9, [0] * 5 + [1] * 4),
        (0.0, "flat", [8.0] * 30, [1, 0] * 15),
        # a level that differs from the middle by rounding is the middle
        (0.3, "separated", [0.2, 0.1 + 0.2, 0.4], [0, 5, 9], [9] * 3),
        (0.3, "separated", np.float32([0.2, 0.3, 0.4]), [0, 5, 9], [9] * 3),
        (0.0, "separated", [-0.1, 0.1 * 3 - 0.3, 0.1], [0, 5, 9], [9] * 3),
        (11.0, "separated", [8.8, 11.0, 13.2], [0, 5, 9], [9] * 3),
    ):
        assert psychometric(*given, pse=pse, log=pse > 1).problems == (problem,)


def test_ends_are_infinite_where_there_are_none_and_only_what_is_looked_for_is_computed():
    asked = []

    def some(x, rows):  # straight, bent, two that are nowhere above 0, and a jump
        asked.extend(rows)
        return np.choose(rows, [x - 0.5, x**8 - 0.5, -1.0, -1.0, np.where(x < 0.3, -1e-3, 5)])

    found = ends(some, np.zeros(5), [1.0, 1.0, 1.0, -1.0, 1.0])
    assert found == pytest.approx([0.5, 0.5 ** (1 / 8), np.inf, -np.inf, 0.3], abs=1e-6)
    assert asked.count(1) == 10
    never = 2 + likelihood.DOUBLINGS
    assert [asked.count(k) for k in (0, 2, 3)] == [3, never, never]


def test_many_at_once_have_the_bits_that_each_has_alone(monkeypatch):
    """Of unequal lengths, some with nothing to fit, in two calls."""
    monkeypatch.setattr("stimlib.experiments.fits.TOGETHER", 3)
    data = {
        "six": (LEVELS, YES, ASKED),
        ("nine", 2): (np.geomspace(0.5, 6, 9), [0, 1, 1, 5, 9, 11, 15, 20, 20], [20] * 9),
        "separated": (LEVELS, [0, 0, 0, 20, 20, 20], ASKED),
        "lapses": ([1, 1.5, 2, 2.5, 3, 10], [0, 3, 10, 17, 20, 18], ASKED),
        "one": ([1, 1], [0, 1]),
    }
    fits = psychometrics(data)
    assert {k: repr(v) for k, v in fits.items()} == {
        k: repr(psychometric(*each)) for k, each in data.items()
    }
    told = [("".join(fit.problems), fit.trials, fit.levels) for fit in fits.values()]
    assert told[:2] == [("", 120, 6), ("", 180, 9)]
    assert told[2:] == [("separated", 120, 6), ("lapses", 120, 6), ("few", 2, 1)]
    assert psychometrics({}) == {}
    wrong = {"good": data["six"], ("P01", "a"): ([1, 2], [0, 2])}
    refused(BadValue, r"of \('P01', 'a'\): yes\[1\] = 2", psychometrics, wrong)
    refused(BadValue, "levels, yes, trials.*not 1", psychometrics, {"P01": ([1, 2],)})


def test_differences_and_scales():
    fit, logs = (psychometric(LEVELS, YES, ASKED, log=log) for log in (False, True))
    assert fit([fit.pse, fit.pse + fit.jnd]) == pytest.approx([0.5, 0.75], abs=1e-12)
    assert fit.jnd_interval == pytest.approx([fit.jnd * s / fit.sigma for s in fit.sigma_interval])
    assert logs(logs.pse * (1 + logs.jnd)) == pytest.approx(0.75, abs=1e-12)
    # 10 to the power of 405
    assert dc.replace(logs, sigma_interval=(0.1, 600.0)).jnd_interval[1] == np.inf
    more = psychometric(1000 * LEVELS, YES, ASKED, log=True)  # other units
    assert (more.pse, more.jnd) == pytest.approx((1000 * logs.pse, logs.jnd))
    assert more.pse_interval == pytest.approx([1000 * v for v in logs.pse_interval], rel=1e-7)
    flat = psychometric([1, 2, 3, 4], [10, 9, 11, 10], [20] * 4, log=True)
    assert flat.problems == ("flat",) and np.isnan([flat.jnd, *flat.jnd_interval]).all()
    refused(BadValue, "level = -1 must be 0 or above", logs, [1.0, -1.0])
    assert fit(-1.0) > 0


# Against the truth --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("guess", "yes", "starts"),
    [(0.0, (3, 8), [(2, 0), (6, 3), (-6, 1)]), (0.5, (6, 9), [(-6, 0), (-3, 3), (2, 0)])],
)
def test_a_step_that_goes_too_far_is_halved(guess, yes, starts):
    """Two levels determine a logistic curve: it passes through both proportions.

    From these starts a whole step lowers the likelihood, or it is not concave there.
    """
    p = (np.array(yes) / 10 - guess) / (1 - guess)
    low, high = np.log(p / (1 - p))
    said = np.repeat(np.array(yes, float)[:, None], len(starts), axis=1)
    rows = likelihood._Rows(np.array([[-1.0], [1.0]]) + 0 * said, said, 10 - said)
    start = np.array([*np.transpose(starts).astype(float), [0.0] * 3, [guess] * 3])
    free = (True, True, False, False)
    (a, b, *_), _ = likelihood._climb(rows, Model("logit", guess), start, free, 60)
    np.testing.assert_allclose(a, (high + low) / 2, rtol=0, atol=1e-9)
    np.testing.assert_allclose(b, (high - low) / 2, rtol=0, atol=1e-9)


def drifting(nu, people, levels=7, asked=20, seed=4):
    """Answers of people whose probabilities are drawn anew at each level: PSE 2, sigma
    0.8.
    """
    rng, at = np.random.default_rng(seed), np.linspace(0.3, 3.9, levels)
    p = np.broadcast_to(ndtr((at - 2) / 0.8), (people, levels))
    p = p if np.isinf(nu) else rng.beta(p * nu, (1 - p) * nu)
    n = np.full(p.shape, float(asked))
    return Sets(np.broadcast_to(at, p.shape), rng.binomial(asked, p).astype(float), n)


# of 95 % intervals in 4000 people: at least, at most; and of binomial ones at most
@pytest.mark.parametrize(
    ("nu", "low", "high", "binomial"),
    [
        (8, 0.905, 0.93, 0.73),
        (15, 0.925, 0.95, 0.82),
        (50, 0.95, 0.975, 0.92),
        (np.inf, 0.96, 0.98, 0.96),
    ],
)
def test_intervals_hold_the_truth_of_people_who_drift(nu, low, high, binomial):
    """The PSE is inside where the profile there has fallen by less than it may."""
    sets, c = drifting(nu, 4000), np.full(4000, 2.0)
    found = maximum(sets, c)
    fallen = 2 * (found.loglik - maximum(sets, c, a=np.zeros(4000), start=found).loglik)
    assert low < np.mean(fallen < allowed(dispersion(sets, c, PROBIT, found), 5)) < high
    assert np.mean(fallen < allowed(np.nan, 0)) < binomial


def test_dispersion_is_that_of_the_answers():
    rng, at = np.random.default_rng(5), np.linspace(0, 4, 40)  # one answer a level
    single = Sets(at, (rng.random(40) < ndtr(at - 2)).astype(float), np.ones(40))
    found = maximum(single, 2.0)
    p = ndtr(found.a + found.b * (at - 2))
    left, spread = single.yes - p, p * (1 - p)
    wanted = np.sum(left**2 / spread) / 38 / (1 + np.mean((1 - 2 * p) * left / spread))
    assert dispersion(single, 2.0, PROBIT, found) == pytest.approx(wanted)
    two = Sets(np.array([1.0, 3.0]), np.array([3.0, 15.0]), np.array([20.0, 20.0]))
    assert np.isnan(dispersion(two, 2.0, PROBIT, maximum(two, 2.0)))
    assert psychometric([1.0, 3.0], [3, 15], [20, 20]).pse_interval[1] < 3  # as binomial


def test_goodness_of_fit_is_that_of_refitted_draws():
    """It is p with every draw fitted anew."""
    one = Sets(*(v[0] for v in drifting(15, 1)))
    found = maximum(one, 2.0)
    p = probability(found.a + found.b * (one.x - 2), "probit")[0]
    drawn = np.random.default_rng(9).binomial(20, p, (4000, 7)).astype(float)

    def deviance(yes, loglik):
        return 2 * (xlogy(yes, yes / 20) + xlogy(20 - yes, 1 - yes / 20)).sum(-1) - 2 * loglik

    refitted = deviance(drawn, maximum(one._replace(yes=drawn), 2.0).loglik)
    larger = np.mean(refitted >= deviance(one.yes, found.loglik))
    assert goodness(one, 2.0, PROBIT, found) == pytest.approx(larger, abs=0.02)


@pytest.mark.parametrize("interval", ["profile", "bootstrap"])
def test_answers_that_scatter_are_named_and_their_intervals_are_wider(interval):
    yes, how = [0, 9, 7, 19, 13, 20], {"interval": interval}
    fit, plain = (psychometric(LEVELS, yes, ASKED, dispersion=v, **how) for v in (None, 1.0))
    assert fit.problems == plain.problems == ("overdispersed",) and 0 < fit.p < 0.01
    assert fit.dispersion > 2 and fit.pse == plain.pse
    near = psychometric(LEVELS, [0, 7, 7, 18, 16, 20], ASKED, interval="none")
    assert 0.01 < near.p < 0.03 and not near.problems
    wider = np.sqrt(fit.dispersion * f.ppf(0.95, 1, 4) / chi2.ppf(0.95, 1))
    (advice,) = fit.advice()
    assert f"wider by a factor of {wider:.2g}" in advice and f"p = {fit.p:.2g}" in advice
    if interval == "profile":
        same = psychometric(LEVELS, yes, ASKED, dispersion=wider**2)
        assert same.pse_interval == pytest.approx(fit.pse_interval, rel=1e-6)
        assert np.diff(fit.pse_interval) > 2 * np.diff(plain.pse_interval)
    else:
        pse, before = (np.subtract(v.pse_interval, v.pse) for v in (fit, plain))
        sigma, sharp = (np.log(np.divide(v.sigma_interval, v.sigma)) for v in (fit, plain))
        assert [*pse / before, *sigma / sharp] == pytest.approx([wider] * 4)


# Links and rates ----------------------------------------------------------------------
# threshold, and width from 5 to 95 % of the curve, of psignifit 4.3 with flat priors
PSIGNIFIT = {
    "probit": (2.401870752563032, 1.1853488130537215),
    "logit": (2.4000127486235296, 1.1722228079428587),
    "gumbel": (2.466192080284694, 1.428942297930309),
    "weibull": (0.3849059145980645, 0.25275560350382376),  # of log10 of the levels
}


@pytest.mark.parametrize("link", LINKS)
def test_a_link_is_a_distribution(link):
    """Its density, complement, inverse and bend belong to F, from end to end; and its
    curves are those of psignifit, whose maximum of the posterior ends within some 1e-5
    of that of the likelihood.
    """
    of, eta, h = curve(link), np.linspace(-30, 6, 73), 1e-5
    assert of.F(0.0) == pytest.approx(0.5)
    assert of.density(eta) == pytest.approx((of.F(eta + h) - of.F(eta - h)) / (2 * h), abs=1e-9)
    some = eta[of.density(eta) > 1e-9]
    change = (np.log(of.density(some + h)) - np.log(of.density(some - h))) / (2 * h)
    assert of.bend(some) == pytest.approx(change, rel=1e-5, abs=1e-5)
    assert of.F(eta) + of.upper(eta) == pytest.approx(np.ones(eta.size), rel=1e-14)
    assert of.inverse(of.F(eta[20:63])) == pytest.approx(eta[20:63], abs=1e-6)
    assert np.isfinite([f(np.array([-1e3, 1e3])) for f in (of.F, of.density, of.upper)]).all()
    yes, asked = [11, 13, 16, 25, 29, 30], [30] * 6
    fit = psychometric(LEVELS, yes, asked, link=link, guess=0.5, interval="none")
    jnd = fit.pse * (1 + fit.jnd) if fit.log else fit.pse + fit.jnd
    assert fit.log == (link == "weibull") and fit(jnd) == pytest.approx(0.875)
    at = fit.level(0.5 + 0.5 * np.array([0.05, 0.5, 0.95]))
    low, middle, high = np.log10(at) if link == "weibull" else at
    assert (middle, high - low) == pytest.approx(PSIGNIFIT[link], rel=1e-4)
    assert np.isnan(fit.level([0.0, 0.5, 1.0])).all()


@pytest.mark.parametrize(
    ("link", "chances", "rates"),
    [
        ("probit", [None], {"lapse": "free"}),
        ("gumbel", [0.0], {"guess": "free", "lapse": "free"}),
        ("probit", [0.0, 0.0], {"lapse": "shared"}),
        ("weibull", [0.0, 0.5], {"lapse": "shared"}),  # tasks of different chance levels
        ("logit", [0.0, 0.0], {"lapse": "shared", "guess": "shared"}),
    ],
)
def test_free_rates_are_the_best_there_are(link, chances, rates):
    """Of the likelihood as it is written down, as scipy's search finds it."""
    said = np.array([[0, 4, 9, 17, 19, 17], [10, 12, 15, 18, 20, 20] if 0.5 in chances else YES])
    sets = list(zip(chances, said[: len(chances)], strict=True))
    rows = {
        k: {
            "level": np.repeat(LEVELS, 20).tolist(),
            "outcome": [int(i < n) for n in yes for i in range(20)],
            "chance": [chance] * 120,
        }
        for k, (chance, yes) in enumerate(sets)
    }
    fits = psychometrics(rows, link=link, interval="none", **rates)
    x = np.log10(LEVELS) if link == "weibull" else LEVELS

    def cost(v):
        lapse, guess, *curves = v
        total = 0.0
        for (chance, yes), a, b in zip(sets, curves[::2], curves[1::2], strict=True):
            low = guess if "guess" in rates else lapse if chance is None else chance
            p = low + (1 - low - lapse) * curve(link).F(a + b * x)
            total -= np.sum(yes * np.log(p) + (20 - yes) * np.log(1 - p))
        return total

    (lapse,), best = {fit.lapse for fit in fits.values()}, sum(f.loglik for f in fits.values())
    lines = [v for fit in fits.values() for v in (fit.intercept, fit.slope)]
    found, bounds = [lapse, fits[0].guess, *lines], [(1e-9, 0.1), (1e-9, 0.8)]
    bounds += [(v - 9, v + 9) for v in lines]
    assert cost(found) == pytest.approx(-best) and 0 <= lapse <= 0.1
    for step in (-0.02, 0.02):
        start = np.clip(np.add(found, step), *np.transpose(bounds))
        assert minimize(cost, start, bounds=bounds, method="L-BFGS-B").fun >= -best - 1e-7
    assert fits[0].shared == list(rates.values()).count("shared")
    assert fits[0].aic == pytest.approx(2 * (2 + len(rates) - fits[0].loglik))


@pytest.mark.parametrize(
    ("link", "rates"),
    list(zip(LINKS, [(None, "free"), (0.5, 0.02), (None, 0.02), ("free", "free")], strict=True)),
)
def test_no_curve_is_more_likely_than_the_maximum_and_ends_are_where_it_has_fallen(link, rates):
    """Of a lattice of curves and rates, also with the middle or the slope held; answers
    that rise, fall, are all of one kind, separated or random, a few at each level.
    """
    rng, people = np.random.default_rng(LINKS.index(link)), 40 if STRESS else 2
    at = np.sort(rng.normal(size=(people, 6)), axis=1)
    p = [
        ndtr(3 * at),
        0.5 + 0.5 * ndtr(at),
        ndtr(-2 * at),
        0 * at,
        0 * at + 1,
        at > 0,
        0 * at + 0.5,
    ]
    x, n = np.tile(at, (7, 1)), rng.integers(1, 20, (7 * people, 6)).astype(float)
    sets = Sets(x, rng.binomial(n.astype(int), np.concatenate(p)).astype(float), n)
    model, c = Model(link, *rates), x.mean(axis=1)
    middles, slopes = np.linspace(-3, 3, 31), np.geomspace(0.01, 1e4, 25)
    slopes = np.append(-slopes, slopes)
    eta = slopes[:, None, None, None] * (x - middles[:, None, None])
    heights = np.full(eta.shape[:-1], -np.inf)
    for guess in np.linspace(0, 0.8, 5) if rates[0] == "free" else rates[:1]:
        for lapse in np.linspace(0, 0.1, 5) if rates[1] == "free" else rates[1:]:
            yes, no = probability(eta, link, lapse if guess is None else guess, lapse)
            logs = sets.yes * np.log(yes) + (n - sets.yes) * np.log(no)
            heights = np.maximum(heights, logs.sum(axis=-1))
    best, slack = maximum(sets, c, model), 1e-9 * n.sum(axis=1)
    assert (best.loglik >= heights.max(axis=(0, 1)) - slack).all()
    for m, most in list(zip(middles, heights.max(axis=0), strict=True))[::5]:
        for start in (None, best):
            held = maximum(sets, np.full(c.shape, m), model, a=np.zeros(c.shape), start=start)
            assert (held.loglik >= most - slack).all()
    for b, most in list(zip(slopes, heights.max(axis=1), strict=True))[::7]:
        held = maximum(sets, c, model, b=np.full(c.shape, b), start=best)
        assert (held.loglik >= most - slack).all()
    # ends: where the profile passes the fall, by a jump where a middle passes a level
    rising = best.b > 0
    some, c, peak = Sets(*(v[rising] for v in sets)), c[rising], best.loglik[rising]
    z, zero = np.sqrt(chi2.ppf(0.95, 1)), np.zeros(c.shape)
    for way, (low, high) in zip(("a", "b"), profile(some, model), strict=True):
        for end, out in ((low, -1), (high, 1)):
            ok = np.isfinite(end) & ((way == "a") | (end > 0))
            end = np.where(ok, end, 1.0)
            for off in (-1e-5 * out, 1e-5 * out):
                v = end + off * (1 if way == "a" else end)
                held = {"a": zero} if way == "a" else {"b": 1 / v}
                less = maximum(some, v if way == "a" else c, model, **held).loglik
                left = np.sqrt(2 * np.maximum(peak - less, 0)) - z
                assert (np.where(ok, left * off * out, 0) >= -1e-11).all(), (way, out)


@pytest.mark.parametrize(
    ("x", "yes", "n", "model", "held", "highest"),
    [  # highest of a finer search
        # a rate at 0, where a step would lead below, along a ridge
        (
            [1, 1.78, 3.16, 5.62, 10],
            [3, 1, 4, 4, 4],
            [5, 1, 6, 6, 5],
            ("logit", "free", "free"),
            {},
            -13.959267,
        ),
        # a steep curve that is held, from the middle of levels that are far apart
        ([0.1, 0.5, 36], [0, 0, 0], [1, 1, 1], (), {"b": 5.0}, 0.0),
    ],
)
def test_a_climb_ends_at_the_top(x, yes, n, model, held, highest):
    sets = Sets(*(np.array(v, float) for v in (x, yes, n)))
    found = maximum(sets, np.average(x, weights=n), Model(*model), **held)
    assert found.loglik == pytest.approx(highest, abs=1e-6)


def test_a_step_is_cut_where_a_rate_rises_or_falls_to_the_end_of_its_range():
    rng, highest = np.random.default_rng(1), np.array([[0.1], [0.5]])
    at = rng.uniform(0.0, 1.0, (4, 200)) * np.append([[1.0], [1.0]], highest, axis=0)
    step = rng.uniform(-0.3, 0.3, at.shape)
    cut = likelihood._within(step, at, highest)
    share, rates = (cut / step)[0], (at + cut)[2:]
    np.testing.assert_allclose(cut, share * step, rtol=1e-12)
    assert (rates > -1e-15).all() and (rates < highest + 1e-15).all()
    end = np.minimum(abs(rates), abs(highest - rates)).min(axis=0) < 1e-15
    assert (end == (share < 1.0)).all() and share.max() == 1.0 > share.min()


ONE, OTHER, ROUGH = [1, 4, 9, 17, 19, 20], [0, 2, 8, 12, 19, 20], [0, 9, 7, 19, 13, 20]
HALF = {"guess": 0.5, "interval": "none"}


def test_a_shared_lapse_rate_is_at_the_highest_of_several_peaks():
    """A search from 0.02 alone stopped at 0.035, a log-likelihood of 0.92 lower."""
    levels, asked = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0], [20] * 7
    sets = {
        "a": (levels, [9, 12, 10, 17, 19, 19, 20], asked),
        "b": (levels, [13, 9, 11, 17, 19, 15, 16], asked),
    }

    def loglik(lapse):
        return sum(fit.loglik for fit in psychometrics(sets, lapse=lapse, **HALF).values())

    shared, none = (psychometrics(sets, lapse=v, **HALF).values() for v in ("shared", 0.0))
    assert loglik("shared") >= max(map(loglik, np.linspace(0.0, 0.1, 11))) - 1e-6
    found = likelihood_ratio(none, shared)
    assert found.df == 1
    each = [psychometrics({k: v}, lapse="shared", **HALF)[k] for k, v in sets.items()]
    assert likelihood_ratio(none, each).df == likelihood_ratio(shared, each).df + 1 == 2
    alike = [  # two people with the same answers
        [psychometric(*sets["a"], lapse=lapse, **HALF) for _ in range(2)]
        for lapse in (0.0, "shared")
    ]
    assert likelihood_ratio(*alike).df == 2
    assert found.statistic == pytest.approx(2 * (loglik("shared") - loglik(0.0)))


def test_a_likelihood_ratio_is_chi_squared_or_f():
    for yes in (ONE, ROUGH):
        each = [psychometric(LEVELS, v, ASKED, interval="none") for v in (yes, OTHER)]
        both = psychometric([*LEVELS] * 2, yes + OTHER, [20] * 12, interval="none")
        found = likelihood_ratio([both], each)
        gain = 2 * (sum(v.loglik for v in each) - both.loglik)
        assert (found.statistic, found.df) == (pytest.approx(gain), 2)
        scatter = max(1, (each[0].dispersion + each[1].dispersion) / 2)
        p = chi2.sf(gain, 2) if yes is ONE else f.sf(gain / 2 / scatter, 2, 8)
        assert found.p == pytest.approx(p) and (scatter > 1) == (yes is ROUGH)


@pytest.mark.parametrize("log", [False, True])
def test_a_likelihood_ratio_takes_levels_that_differ_by_rounding_as_one(log):
    """Two staircases in dB reach one level by different steps."""
    by_steps, asked, how = np.nextafter(LEVELS, np.inf), [20] * 12, {"log": log, "interval": "none"}
    each = [psychometric(at, v, ASKED, **how) for at, v in ((LEVELS, ONE), (by_steps, OTHER))]
    both = psychometric([*LEVELS, *by_steps], ONE + OTHER, asked, **how)
    assert likelihood_ratio([both], each).df == 2
    fewer = psychometric(by_steps, [*OTHER[:5], 19], ASKED, **how)
    moved = psychometric([*LEVELS, *(LEVELS + 1e-9)], ONE + OTHER, asked, **how)
    worse = psychometric(LEVELS, ONE, ASKED, guess=0.25, lapse="free", **how)
    for less, more, why in (
        ([both], [each[0], fewer], "the same answers"),
        ([moved], each, "the same answers"),
        (each, each, "4 parameters .* more"),
        (each[:1], [worse], "does not contain"),
        (iter("a"), each, "'a' is no Fit"),
    ):
        refused(BadValue, why, likelihood_ratio, less, more)


def test_bootstrap_draws_lapses_too():
    """As by hand: answers drawn from the curve with its lapses, each fitted with the
    same rate.
    """
    yes, asked, n = 10 * YES, 10 * ASKED, 20
    p = psychometric(LEVELS, yes, asked, lapse=0.1)(LEVELS)
    drawn = np.random.default_rng(3).binomial(asked, p, (n, 6))
    sets = {k: (LEVELS, drawn[k], asked) for k in range(n)}
    pses = [fit.pse for fit in psychometrics(sets, lapse=0.1, interval="none").values()]
    wanted = np.quantile(pses, [0.025, 0.975], method="median_unbiased")
    found = bootstrap(Sets(LEVELS, yes, asked), Model(lapse=0.1), seed=3, n=n)[0]
    np.testing.assert_allclose(found, wanted, rtol=1e-9)
    once = Sets(*np.c_[[LEVELS, yes, asked], [5.0, 1, 1]])  # one level was asked once
    other = bootstrap(once, Model(lapse=0.1), seed=4)
    how = {"lapse": 0.1, "interval": "bootstrap", "dispersion": 1.0}
    fit = psychometric(*once, **how, seed=4)
    assert fit.pse_interval == tuple(other[0])
    for wrong in ({"seed": -1}, {"n": 0}, {"confidence": 1.0}):
        refused(BadValue, "bootstrap: .*must be", bootstrap, Sets(LEVELS, YES, ASKED), **wrong)


@pytest.mark.filterwarnings("error")
def test_a_bootstrap_with_flat_resamples_has_ends():
    """Half said yes at both of two levels: resamples are flat, or steep either way."""
    sets = Sets(np.array([1.0, 2.0]), np.array([4.0, 4.0]), np.array([8.0, 8.0]))
    (low, high), (flat_low, flat_high) = bootstrap(sets)
    assert low == -np.inf and high == np.inf and 0 < flat_low < 2 and flat_high == np.inf


# Nothing to fit -----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("yes", "how", "problem"),
    [
        ([0, 0, 0, 20, 20, 20], {}, "separated"),
        ([0, 0, 7, 20, 20, 20], {}, "separated"),  # one level between has both answers
        ([0, 0, 1, 20, 20, 19], {"lapse": 0.02}, "separated"),  # but for a lapse
        ([10, 10, 10, 20, 20, 20], {"guess": 0.5}, "separated"),
        ([0, 0, 0, 0, 0, 0], {}, "few"),
        ([20, 19, 15, 9, 2, 0], {}, "falling"),
        ([20, 20, 20, 0, 0, 0], {}, "falling"),
        ([10, 11, 9, 12, 10, 11], {}, "flat"),
        ([10, 10, 10, 10, 10, 10], {}, "flat"),
        ([11, 10, 12, 9, 11, 10], {}, "flat"),  # falls no more than by chance
    ],
)
def test_data_that_determine_no_curve_give_no_number(yes, how, problem):
    fit = psychometric(LEVELS, yes, ASKED, **how)
    assert fit.problems == (problem,) and len(fit.advice()) == 1
    assert np.isnan([fit.pse, fit.sigma, fit.jnd, *fit.pse_interval, *fit.sigma_interval]).all()


def test_a_gap_is_where_the_answers_pass_half_way():
    fit = psychometric([1, 2, 3, 4], [10, 10, 20, 20], [20] * 4, guess=0.5, log=True)
    assert fit.gap == (2, 3) and "between 2 and 3" in fit.advice()[0]
    assert psychometric([1, 10], [10, 11], [20] * 2, **HALF, log=True).gap == (10, np.inf)


def test_lapses_are_told_and_can_be_fitted():
    def found(last, yes, **how):
        return psychometric([1, 1.5, 2, 2.5, 3, last], [0, 3, 10, 17, 20, yes], ASKED, **how)

    plain = found(10, 18)
    assert plain.problems == ("lapses",) and plain.sigma > 1
    for other in (found(10, 18, lapse=v) for v in ("free", 0.04)):
        assert other.problems == () and other.sigma < 0.6
        assert 1.6 < other.pse_interval[0] < 2 < other.pse_interval[1] < 2.4
    # twice the gain is 4.6 and 6.1; one in a hundred passes 5.4
    assert [found(last, 19).problems for last in (3.6, 3.75)] == [(), ("lapses",)]


def test_a_fit_says_that_it_is_beyond_its_levels():
    levels, asked = np.linspace(1.0, 3.0, 6), np.full(6, 20)
    far = psychometric(levels, [0, 0, 0, 2, 4, 7], asked)
    assert far.pse > 3 and "outside of the levels" in far.advice()[0]
    assert far.problems == ("beyond",) and str(far).endswith("problems: beyond")
    low = psychometric(levels, [8, 12, 18, 20, 20, 20], asked)  # between the first two
    assert 1 < low.pse < 1.4 and not {"beyond", "edge"} & {*low.problems}


@pytest.mark.parametrize(
    ("yes", "rates", "at_edge"),
    [
        ([0, 0, 3, 19, 19, 20], {"guess": 0.0, "lapse": "free"}, False),
        ([0, 0, 1, 15, 15, 15], {"guess": 0.0, "lapse": "free"}, True),
        ([0, 0, 1, 15, 15, 15], {"guess": 0.0, "lapse": "shared"}, True),
        ([0, 0, 2.87, 15.23, 18.08, 18.1], {"guess": 0.0, "lapse": "free"}, False),
        ([17, 17.02, 17.48, 19.52, 19.98, 20], {"guess": "free", "lapse": 0.0}, True),
        ([15, 15.04, 15.8, 19.2, 19.96, 20], {"guess": "free", "lapse": 0.0}, False),
    ],
)
def test_a_fit_says_that_a_rate_is_at_its_largest(yes, rates, at_edge):
    yes, asked = np.rint(100 * np.array(yes)), np.full(6, 2000)
    fit = psychometrics({1: (np.arange(6.0), yes, asked)}, **rates, interval="none")[1]
    assert ("edge" in fit.problems) == at_edge
    if at_edge and rates["lapse"]:
        assert fit.lapse == pytest.approx(0.1, abs=1e-4)


# The task -----------------------------------------------------------------------------
def test_the_threshold_of_a_detection_has_the_chance_level_of_its_task():
    """A standard of no amplitude: answers, observer and fit know that half of all
    answers are right by chance.
    """
    task = TwoInterval("felt", "softer", Stimulus("spring", {"k": 0.0}), Stimulus("spring"), "k")
    trials = ConstantStimuli(tuple((task, v) for v in np.geomspace(0.02, 0.5, 7)), repeats=40)
    answers = simulate(experiment(design=trials, bounds={}), Observer(0.1, 0.2, log=True), 1)
    assert set(answers["chance"]) == {0.5}
    fit = psychometric(answers, log=True, unit="V")
    assert repr(fitted(answers, log=True, unit="V")["P01", "felt"]) == repr(fit)
    assert (fit.guess, fit.name, fit.problems) == (0.5, "threshold", ())
    assert fit.pse_interval[0] < 0.1 < fit.pse_interval[1]
    assert str(fit).startswith(f"threshold {fit.pse:.4g} V [")
    assert str(fit).endswith(f"JND {fit.jnd:.0%} of it, fit p = {fit.p:.2g}")
    assert fit(np.array([[0.0, 1e9]])) == pytest.approx(np.array([[0.5, 1.0]]))
    alone = psychometric(answers["level"], answers["outcome"], log=True)
    assert alone.problems == ("guess",) and "PSE" in str(alone)
    assert "0.5 about as well" in alone.advice()[0]
    assert alone.pse < 0.06  # what comes out without the task: half of the truth
    assert psychometric(answers, log=True, guess=0.0).guess == 0.0  # who says a rate means it


def test_a_table_of_answers_is_taken_whole():
    rows = {"level": [1, 1, 2, 2, 3, 3], "outcome": [0, 0, 1, 0, 1, 1]}
    plain, table = psychometric(rows), pandas.DataFrame(rows)
    assert repr(plain) == repr(psychometric(rows["level"], rows["outcome"]))
    both = psychometrics({"a": table.assign(chance=0.5), "c": (rows["level"], rows["outcome"])})
    assert [fit.guess for fit in both.values()] == [0.5, 0] and list(both) == ["a", "c"]
    for given, chance in ((np.float32(0.5), 0.5), (np.int64(0), 0.0)):
        fit = psychometric(table.assign(chance=given))
        assert fit.guess == chance and not fit.comparison
    for given in (None, np.nan, pandas.NA):
        assert repr(psychometric(rows | {"chance": [given] * 6})) == repr(plain)
    for given in ("0.5", "free", "shared", [0.5], np.array([0.5, 0.5]), True, 1.0, -0.1, np.inf):
        wrong = rows | {"chance": [given] * 6}
        refused(BadValue, "chance = .* must be a number", psychometric, wrong)
    mixed = rows | {"chance": [0.5] * 3 + [None] * 3}
    refused(BadValue, "chance levels .*by itself", psychometric, mixed)
    refused(UnknownName, "no column 'outcome'", psychometric, {"level": [1, 2]})


@pytest.mark.parametrize("number", [np.float32, Fraction])
def test_numbers_of_every_kind_are_taken(number):
    plain, how = ({"guess": v(0.25), "lapse": v(0), "confidence": v(0.5)} for v in (float, number))
    found = psychometric(LEVELS, YES, ASKED, **how)
    assert repr(found) == repr(psychometric(LEVELS, YES, ASKED, **plain))


def test_ends_beyond_a_float_are_infinite():
    """Answers that rise just enough: the interval is hundreds of decades long."""
    said, how = [[500 - d, 500, 500 + d] for d in range(22, 26)], {"log": True, "dispersion": 1.0}
    found = [psychometric([1e-200, 1.0, 1e200], v, [1000] * 3, **how) for v in said]
    assert (0, np.inf) in [tuple(fit.pse_interval) for fit in found if not fit.problems]
    assert float(found[-1].level(1 - 1e-12)) == np.inf


@pytest.mark.parametrize(
    ("chance", "how", "least", "most"),
    [
        (0.0, {}, 0.0, 0.01),  # a comparison
        (0.5, {"guess": 0.5}, 0.0, 0.01),  # a detection
        (0.5, {}, 0.9, 1.0),  # a detection that is taken for a comparison
        (0.0, {"guess": 0.5}, 0.85, 1.0),  # and the other way; the rest: "separated"
    ],
)
def test_a_wrong_chance_level_is_flagged_and_a_right_one_is_not(chance, how, least, most):
    """As docs/reference/experiments_analysis says; of 50 people, where none should be
    flagged one may be.
    """
    people, off = (2000, 0.0) if STRESS else (50, 0.01)
    z = np.linspace(-2, 2, 7)  # levels, in sigmas from the middle
    p = chance + (1 - chance) * ndtr(z)
    drawn = dict(enumerate(np.random.default_rng(7).binomial(20, p, (people, 7))))
    sets = {k: (z, yes, np.full(7, 20)) for k, yes in drawn.items()}
    fits = psychometrics(sets, interval="none", **how).values()
    assert least <= np.mean(["guess" in fit.problems for fit in fits]) <= most + off


def test_levels_that_differ_by_rounding_are_one():
    fit = psychometric([0.1, 0.10000000000000002, 0.2, 0.2, 0.3], [0, 1, 0, 1, 1])
    assert fit.levels == 3 and fit.data == ((0.1, 1, 2), (0.2, 1, 2), (0.3, 1, 1))
    steps = [1.0, *(10 ** (3 / 20) ** 1 * 10 ** (-3 / 20) * np.ones(3))]  # up and down again
    assert psychometric([*steps, 2.0], [0, 1, 0, 1, 1], log=True).levels == 2
    assert psychometric([-1.0, -1.0 - 1e-9, 1e-9, 0.0], [0, 1, 0, 1]).levels == 4


def test_a_fit_is_drawn_with_its_data_and_interval():
    fit = psychometric(LEVELS, YES, ASKED, log=True, unit="N/mm")
    ax = fit.plot().axes[0]
    (points,), (curve, interval) = ax.collections, ax.lines
    assert np.ma.getdata(points.get_offsets()) == pytest.approx(
        np.column_stack([LEVELS, YES / ASKED])
    )
    x, y = curve.get_data()
    assert y == pytest.approx(fit(x)) and (x[0], x[-1]) == pytest.approx((1, 4))
    assert list(interval.get_xdata()) == pytest.approx(fit.pse_interval)
    assert (ax.get_xlabel(), ax.get_xscale()) == ("level / N/mm", "log")
    few = psychometric([1.0, 2.0], [0, 0])
    assert not few.plot().axes[0].lines and str(few) == "PSE nan [nan, nan], JND nan; problems: few"


def test_levels_of_their_own_for_each_answer_give_the_fit_of_their_groups(monkeypatch):
    """600 levels, in 40 groups; and its draws in one part or in several."""
    rng, at = np.random.default_rng(3), np.linspace(-2, 2, 40)
    levels = (at[:, None] + 1e-9 * np.arange(-7, 8)).ravel()
    yes = rng.random(levels.size) < 0.4 + 0.55 * ndtr(3 * levels)
    given = dict(guess="free", lapse="free", interval="none")
    one = psychometric(levels, yes, **given)
    groups = psychometric(at, yes.reshape(40, 15).sum(axis=1), [15] * 40, **given)
    numbers = [(f.pse, f.sigma, f.guess, f.lapse, f.loglik) for f in (one, groups)]
    assert numbers[0] == pytest.approx(numbers[1], rel=1e-6)
    monkeypatch.setattr("stimlib.experiments.goodness.AT_ONCE", 250_000)
    assert psychometric(levels, yes, **given).p == one.p


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (dict(levels=[1, 2], yes=[1]), "one length"),
        (dict(levels=[1, np.nan], yes=[0, 1]), r"levels\[1\]"),
        (dict(levels=[0, 1], yes=[0, 1], log=True), r"levels\[0\] = 0.*above 0"),
        (dict(levels=[1, 2], yes=[0, 2]), r"^psychometric: yes\[1\] = 2 .* trials\[1\] = 1"),
        (dict(levels=[1, 2], yes=[0.5, 1]), r"yes\[0\]"),
        (dict(levels=[1, 2], yes=[0, -1]), r"yes\[1\] = -1"),
        (dict(levels=[1, 2], yes=[0, 1], trials=[0, 1.5]), r"trials\[1\]"),
        (dict(levels=[1, 2], yes=[0, 0], trials=[0, 0]), "no trials"),
        (dict(levels=["a", 2], yes=[0, 1]), "levels = .*'a'.* must be a list of numbers"),
        (dict(levels=[[1], [2, 3]], yes=[0, 1]), "levels = .* must be a list of numbers"),
        (dict(levels=[1, 2], yes=[0, 1], trials=[1, 2e9]), r"^psychometric: trials\[1\] .* 1e\+09"),
        (dict(levels=[1, 2e200], yes=[0, 1]), "another unit"),
        (dict(levels=[1e-200, 2e-200], yes=[0, 1]), "another unit"),
        (dict(levels=[1, 2], yes=[0, 1], seed=-1), "seed = -1"),
        (dict(levels=[1, 2], yes=[0, 1], link="cloglog"), "probit, logit"),
        (dict(levels=[1, 2], yes=[0, 1], lapse=0.5), "lapse"),
        (dict(levels=dict(level=[1], outcome=[1]), trials=[5]), "levels must be rows of numbers"),
        (dict(levels=[1, 2], yes=[0, 1], lapse=-0.1), "lapse"),
        (dict(levels=[1, 2], yes=[0, 1], guess=-0.1), "guess"),
        (dict(levels=[1, 2], yes=[0, 1], guess=0.95, lapse="free"), "guess"),
        (dict(levels=[1, 2], yes=[0, 1], interval="wald"), "bootstrap"),
        (dict(levels=[1, 2], yes=[0, 1], trials=[np.nan, 1]), r"trials\[0\] = nan"),
        (dict(levels=[1, 2], yes=[0, 1], trials=[-1, 1]), r"trials\[0\] = -1"),
        (dict(levels=[1, 2], yes=[0, 1], guess="free", lapse=0.2), "lapse = 0.2 must be below 0.2"),
        (dict(levels=[1, 2], yes=[0, 1], guess="shared", lapse=0.3), "lapse = 0.3 .* 'shared'"),
        (dict(levels=[1, 2], yes=[0, 1], confidence=95), "confidence"),
        (dict(levels=[1, 2], yes=[0, 1], confidence=0.0), "confidence"),
        (dict(levels=[1, 2], yes=[0, 1], pse=np.inf), "pse = inf is not finite"),
        (dict(levels=[1, 2], yes=[0, 1], pse=-1e101), r"pse = -1e\+101 must be .* up to 1e\+100"),
        (dict(levels=[1, 2], yes=[0, 1], pse=0.0, log=True), "pse = 0.0 must be .* above 0"),
        (dict(levels=[1, 2], yes=[0, 1], pse=0.0, guess=0.5), "without guess"),
        (
            dict(levels=dict(level=[1], outcome=[1], chance=[0.25]), pse=0.0),
            "pse is of a curve that is 1/2 there, not of chance 0.25",
        ),
    ],
)
def test_what_cannot_be_used_is_said(given, said):
    refused(BadValue, said, psychometric, **given)
