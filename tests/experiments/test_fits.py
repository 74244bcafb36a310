"""Psychometric fits: against other programs, against the truth of simulated people, and
of data that determine nothing.
"""

import dataclasses as dc

import numpy as np
import pytest
from laws import STRESS
from refusals import refused

import stimlib
from stimlib.blocks import oscillator
from stimlib.errors import BadValue, UnknownName
from stimlib.experiments import (
    ConstantStimuli,
    Experiment,
    Psychometric as Observer,
    Stimulus,
    TwoInterval,
    bootstrap,
    choice,
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
    Found,
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


def ndtr(x):
    from scipy.special import ndtr

    return ndtr(x)


# The same as elsewhere ----------------------------------------------------------------
@pytest.mark.parametrize("link", ["probit", "logit"])
@pytest.mark.parametrize("log", [False, True])
def test_fits_are_those_of_statsmodels(link, log):
    from statsmodels.genmod.families import Binomial, links
    from statsmodels.genmod.generalized_linear_model import GLM

    family = Binomial({"probit": links.Probit, "logit": links.Logit}[link]())
    x = np.log10(LEVELS) if log else LEVELS
    other = GLM(
        np.column_stack([YES, ASKED - YES]), np.column_stack([np.ones(6), x]), family=family
    ).fit(tol=1e-15, maxiter=200)
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
    from scipy.stats import chi2, f

    yes, asked = np.array([33, 30, 39, 54, 57, 60]), 60
    how = dict(guess=0.5, lapse=0.02, confidence=0.9, dispersion=dispersion)
    fit = psychometric(LEVELS, yes, 3 * ASKED, **how)

    def deviance(pse, sigma):
        p = 0.5 + 0.48 * ndtr((LEVELS - pse) / sigma)
        return -2 * np.sum(yes * np.log(p) + (asked - yes) * np.log(1 - p))

    fall = dispersion * chi2.ppf(0.9, 1) if dispersion else fit.dispersion * f.ppf(0.9, 1, 4)
    assert fall > chi2.ppf(0.9, 1) or dispersion == 1
    wanted = -2 * fit.loglik + fall
    assert deviance(fit.pse, fit.sigma) == pytest.approx(-2 * fit.loglik)
    pses, sigmas = np.linspace(1.5, 3.5, 401), np.geomspace(0.005, 3, 401)
    for end in fit.pse_interval:
        assert min(deviance(end, s) for s in sigmas) == pytest.approx(wanted, abs=2e-3)
    for end in fit.sigma_interval:
        assert min(deviance(m, end) for m in pses) == pytest.approx(wanted, abs=2e-3)
    assert (
        fit.pse_interval[0] < fit.pse < fit.pse_interval[1]
        and fit.sigma_interval[0] < fit.sigma < fit.sigma_interval[1]
    )
    assert fit(np.array([fit.pse, 1e9])) == pytest.approx([0.74, 0.98])


def test_ends_are_found_where_a_function_is_bent_and_infinite_where_there_is_none():
    assert ends(lambda x, rows: x**8 - 0.5, np.zeros(1), 1.0) == pytest.approx(
        0.5 ** (1 / 8), abs=1e-6
    )
    assert list(ends(lambda x, rows: 0 * x - 1, np.zeros(2), np.array([1.0, -1.0]))) == [
        np.inf,
        -np.inf,
    ]
    asked = []

    def line(x, rows):  # the second is nowhere above 0
        asked.extend(rows.tolist())
        return np.where(rows == 0, x - 0.5, -1.0)

    assert ends(line, np.zeros(2), 1.0).tolist() == [0.5, np.inf]
    assert (asked.count(0), asked.count(1)) == (
        3,
        2 + 14,
    ), "only what is still looked for is computed"


def test_a_rate_of_lapses_is_the_best_there_is():
    from scipy.optimize import minimize

    yes = np.array([0, 4, 9, 17, 19, 17])
    fit = psychometric(LEVELS, yes, ASKED, lapse="free")

    def cost(v):
        p = v[2] + (1 - 2 * v[2]) * ndtr((LEVELS - v[0]) / v[1])
        return -np.sum(yes * np.log(p) + (ASKED - yes) * np.log(1 - p))

    other = minimize(
        cost,
        [2, 0.5, 0.05],
        bounds=[(1.5, 2.5), (0.2, 2), (0.001, 0.1)],
        method="L-BFGS-B",
        options={"ftol": 1e-15},
    )
    assert [fit.pse, fit.sigma, fit.lapse] == pytest.approx(list(other.x), rel=1e-5)
    assert fit.loglik >= -other.fun - 1e-10 and fit.guess == fit.lapse
    ends = [
        psychometric(LEVELS, yes, ASKED, lapse="free", interval="none").lapse
        for yes in (YES, [5, 6, 9, 14, 15, 15])
    ]
    assert ends == [0.0, pytest.approx(0.1)]  # neither below 0 nor beyond a tenth


@pytest.mark.parametrize("guess", [None, 0.5])
def test_the_likelihood_neither_rises_nor_falls_with_the_rate_of_lapses_that_is_found(guess):
    """Of 48 people; the search alone ended on a grid of rates, up to 0.003 below the
    maximum.
    """
    rng = np.random.default_rng(3)
    low = 0.04 if guess is None else guess
    p = low + (0.96 - low) * ndtr((LEVELS - 2.0) / 0.5)
    yes = {k: rng.binomial(40, p) for k in range(48)}
    fits = psychometrics(
        {k: (LEVELS, v, np.full(LEVELS.size, 40)) for k, v in yes.items()},
        lapse="free",
        guess=guess,
        interval="none",
    )
    inside = [k for k, fit in fits.items() if 0 < fit.lapse < 0.1 and not fit.problems]
    for k in inside:
        F, q = ndtr((LEVELS - fits[k].pse) / fits[k].sigma), fits[k](LEVELS)
        gain = np.sum((yes[k] / q - (40 - yes[k]) / (1 - q)) * (1 - 2 * F if guess is None else -F))
        # the slope of the log-likelihood over the rate; hundreds within a step of the
        # grid
        assert abs(gain) < 1e-5
    assert len(inside) >= 20


def test_many_at_once_have_the_bits_that_each_has_alone(monkeypatch):
    """Of unequal lengths, some with nothing to fit, in two calls."""
    monkeypatch.setattr("stimlib.experiments.fits.TOGETHER", 3)
    wide = np.geomspace(0.5, 6, 9)
    data = {
        "six": (LEVELS, YES, ASKED),
        ("nine", 2): (wide, [0, 1, 1, 5, 9, 11, 15, 20, 20], [20] * 9),
        "separated": (LEVELS, [0, 0, 0, 20, 20, 20], ASKED),
        "lapses": ([1, 1.5, 2, 2.5, 3, 10], [0, 3, 10, 17, 20, 18], ASKED),
        "one": ([1, 1], [0, 1]),
    }
    fits = psychometrics(data)
    assert {key: repr(fit) for key, fit in fits.items()} == {
        key: repr(psychometric(*each)) for key, each in data.items()
    }
    assert [fit.problems for fit in fits.values()] == [
        (),
        (),
        ("separated",),
        ("lapses",),
        ("few",),
    ]
    assert [(fit.trials, fit.levels) for fit in fits.values()] == [
        (120, 6),
        (180, 9),
        (120, 6),
        (120, 6),
        (2, 1),
    ]
    assert psychometrics({}) == {}
    refused(
        BadValue,
        r"of \('P01', 'a'\): yes\[1\] = 2",
        psychometrics,
        {"good": data["six"], ("P01", "a"): ([1, 2], [0, 2])},
    )
    refused(BadValue, "levels, yes, trials.*not 1", psychometrics, {"P01": ([1, 2],)})


def test_differences_and_scales():
    fit = psychometric(LEVELS, YES, ASKED)
    assert fit(fit.pse + fit.jnd) == pytest.approx(0.75, abs=1e-12) and fit(
        fit.pse
    ) == pytest.approx(0.5, abs=1e-12)
    assert fit.jnd_interval == pytest.approx([fit.jnd * s / fit.sigma for s in fit.sigma_interval])
    logs = psychometric(LEVELS, YES, ASKED, log=True)
    assert logs(logs.pse * (1 + logs.jnd)) == pytest.approx(0.75, abs=1e-12)
    # 10 to the power of 405
    assert dc.replace(logs, sigma_interval=(0.1, 600.0)).jnd_interval[1] == np.inf
    more = psychometric(1000 * LEVELS, YES, ASKED, log=True)  # other units
    assert more.pse == pytest.approx(1000 * logs.pse) and more.jnd == pytest.approx(logs.jnd)
    assert more.pse_interval == pytest.approx([1000 * v for v in logs.pse_interval], rel=1e-7)


# Against the truth --------------------------------------------------------------------
def staircases(rng, people, pse, sigma, k0=2.0):
    """Four staircases of paper 000 for each of many people: stiffness (N/mm) and
    answers, 0 trials where one has ended.
    """
    columns = []
    for low, high in [(2.0, 2.5), (1 / 2.5, 1 / 2.0)] * 2:
        k = k0 * rng.uniform(low, high, people)
        reversals, last = np.zeros(people), np.zeros(people)
        while (live := reversals < 20).any():
            stiffer = rng.random(people) < ndtr((k - pse) / sigma)
            columns.append((k, stiffer & live, live))
            way = np.where(stiffer, -1, 1)
            reversals = reversals + (live & (last == -way))
            last, k = way, k * 10 ** (way * np.where(reversals < 5, 12, 3) / 20)
    return Sets(*(np.array(c).T.astype(float) for c in zip(*columns, strict=True)))


@pytest.mark.parametrize("link", LINKS)
def test_where_there_is_one_peak_steps_are_newtons(link, monkeypatch):
    """The error of each is the square of the one before, and few are needed."""
    asked, score = [], likelihood._score

    def counted(at, *given):
        asked.append(len(at))
        return score(at, *given)

    monkeypatch.setattr(likelihood, "_score", counted)
    people = np.random.default_rng(1).binomial(ASKED, ndtr(LEVELS - 2.2), (50, 6))
    found = maximum(Sets(LEVELS, people, ASKED), 2.2, Model(link))
    assert len(asked) <= 10 and np.isfinite(found.loglik).all()


def test_steps_climb_where_probabilities_are_cut_off():
    """A slope is held that makes the answer at 1785 impossible: below 1e-15."""
    x, n = np.array([0.01, 1.5, 378.0, 1785.0]), np.array([40, 2, 1, 2])
    found = maximum(Sets(x, 0 * n, n), 88.0, b=0.03)
    assert found.loglik == pytest.approx(2 * np.log(1e-15))  # the others are certain


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
    sets = Sets(np.array([-1.0, 1.0]), np.array(yes, float), np.array([10.0, 10.0]))
    a, b = np.transpose(starts).astype(float)
    start = Found(a, b, 0 * a, guess + 0 * a, 0 * a)
    free = (True, True, False, False)
    found = likelihood._climb(sets, Model("logit", guess), start, free, 60)
    np.testing.assert_allclose(found.a, (high + low) / 2, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.b, (high - low) / 2, rtol=0, atol=1e-9)


def test_a_rate_stays_below_the_largest_that_is_looked_for():
    """Of the answers at high levels, 30 % are lapses."""
    z = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    sets = Sets(z, np.array([2.0, 8.0, 35.0, 68.0, 70.0]), np.full(5, 100.0))
    start = Found(*map(np.array, (0.0, 1.0, 0.05, 0.0, 0.0)))
    free = (True, True, True, False)
    found = likelihood._climb(sets, Model("logit", 0.0, "free"), start, free, 60)
    assert found.lapse == likelihood.LAPSES


def test_2000_observers_of_the_staircases():
    sets = staircases(np.random.default_rng(1), 2000, 2.34, 0.3)
    found = maximum(sets, 2.34)
    pse = 2.34 - found.a / found.b
    assert abs(pse.mean() - 2.34) < 0.005
    assert abs(pse.std() - 0.060) < 0.004


def covered(people, model, at, chance):
    """How often the ends of the intervals hold PSE 2 and sigma 0.4."""
    n = np.full(at.size, 40.0)
    sets = Sets(
        at,
        np.random.default_rng(3)
        .binomial(40, chance((at - 2) / 0.4), (people, at.size))
        .astype(float),
        n,
    )
    (low, high), (flat_low, flat_high) = profile(sets, model)
    return np.mean((low < 2) & (2 < high)), np.mean((flat_low < 0.4) & (0.4 < flat_high))


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
    scatter = dispersion(sets, c, PROBIT, found)
    assert low < np.mean(fallen < allowed(scatter, 5)) < high
    assert np.mean(fallen < allowed(np.nan, 0)) < binomial


def test_dispersion_is_that_of_the_answers():
    """Variance n p q (1 + (n - 1)/(nu + 1)) of a beta-binomial count.

    It comes out up to a tenth lower where levels with few of one answer scatter most.
    """
    for nu, off in ((15, 0.12), (50, 0.08), (np.inf, 0.02)):
        sets, c = drifting(nu, 4000, levels=9, asked=40), np.full(4000, 2.0)
        mean = np.mean(dispersion(sets, c, PROBIT, maximum(sets, c)))
        assert mean == pytest.approx(1 + 39 / (nu + 1), rel=off)
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
    """It is p with every draw fitted anew, and uniform if the curve is true."""
    from scipy.special import xlogy

    sets, n = drifting(15, 1), 4000
    one = Sets(*(v[0] for v in sets))
    found = maximum(one, 2.0)
    p = probability(found.a + found.b * (one.x - 2), "probit")[0]
    drawn = np.random.default_rng(9).binomial(20, p, (n, 7)).astype(float)

    def deviance(yes, loglik):
        return 2 * (xlogy(yes, yes / 20) + xlogy(20 - yes, 1 - yes / 20)).sum(-1) - 2 * loglik

    larger = deviance(drawn, maximum(one._replace(yes=drawn), 2.0).loglik) >= deviance(
        one.yes, found.loglik
    )
    assert goodness(one, 2.0, PROBIT, found) == pytest.approx(larger.mean(), abs=0.02)
    steady = drifting(np.inf, 400)
    best = maximum(steady, np.full(400, 2.0))
    found = [
        goodness(Sets(*(v[i] for v in steady)), 2.0, PROBIT, Found(*(v[i] for v in best)))
        for i in range(400)
    ]
    assert np.quantile(found, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.08)


def test_answers_that_scatter_are_named_and_their_intervals_are_wider():
    yes = [0, 9, 7, 19, 13, 20]
    fit, plain = (psychometric(LEVELS, yes, ASKED, dispersion=v) for v in (None, 1.0))
    assert fit.problems == plain.problems == ("overdispersed",) and fit.p < 0.01
    assert fit.dispersion > 2 and fit.pse == plain.pse
    near = psychometric(LEVELS, [0, 7, 7, 18, 16, 20], ASKED, interval="none")
    assert 0.01 < near.p < 0.03 and not near.problems
    wider = np.sqrt(fit.dispersion * 7.708647422176786 / 3.841458820694124)  # F(1, 4), chi2(1)
    (advice,) = fit.advice()
    assert f"wider by a factor of {wider:.2g}" in advice and f"p = {fit.p:.2g}" in advice
    same = psychometric(LEVELS, yes, ASKED, dispersion=wider**2)
    assert same.pse_interval == pytest.approx(fit.pse_interval, rel=1e-6)
    assert np.diff(fit.pse_interval) > 2 * np.diff(plain.pse_interval)
    boot, narrow = (
        psychometric(LEVELS, yes, ASKED, interval="bootstrap", dispersion=v) for v in (None, 1.0)
    )
    for name in ("pse_interval", "sigma_interval"):
        ends, before = np.array(getattr(boot, name)), np.array(getattr(narrow, name))
        middle = boot.pse if name == "pse_interval" else boot.sigma
        if name == "sigma_interval":
            ends, before, middle = np.log(ends), np.log(before), np.log(middle)
        assert (ends - middle) / (before - middle) == pytest.approx([wider, wider])


# Links and rates ----------------------------------------------------------------------
def test_weibull_and_gumbel_are_what_they_are_called():
    """Against the likelihood written down, and scipy's distributions."""
    from scipy.optimize import minimize
    from scipy.stats import gumbel_l, weibull_min

    yes, asked = np.array([12, 11, 15, 18, 20, 20]), np.full(6, 20)
    fit = psychometric(LEVELS, yes, asked, link="weibull", guess=0.5, lapse=0.01)
    assert (fit.link, fit.log) == ("weibull", True)

    def cost(v):
        p = 0.5 + 0.49 * weibull_min.cdf(LEVELS, v[1], scale=v[0])
        return -np.sum(yes * np.log(p) + (asked - yes) * np.log(1 - p))

    found = minimize(cost, [2, 2], method="Nelder-Mead", options=dict(xatol=1e-9, fatol=1e-12))
    scale, shape = found.x
    assert fit.loglik == pytest.approx(-found.fun, abs=1e-9)
    assert [float(fit.level(0.5 + 0.49 * (1 - np.exp(-1)))), 1 / (fit.sigma * np.log(10))] == (
        pytest.approx([scale, shape], rel=1e-4)
    )
    assert fit(fit.pse) == pytest.approx(0.745)  # half-way
    other = psychometric(LEVELS, yes, asked, link="gumbel", log=True, guess=0.5, lapse=0.01)
    assert (other.pse, other.pse_interval) == (fit.pse, fit.pse_interval)
    plain = psychometric(LEVELS, YES, ASKED, link="gumbel")
    at = gumbel_l(plain.pse - plain.sigma * np.log(np.log(2)), plain.sigma)
    assert plain(LEVELS) == pytest.approx(at.cdf(LEVELS), rel=1e-12)
    assert plain.jnd == pytest.approx(at.ppf(0.75) - at.ppf(0.5))


# threshold, and width from 5 to 95 % of the curve, of psignifit 4.3 with flat priors
PSIGNIFIT = {
    "probit": (2.401870752563032, 1.1853488130537215),
    "logit": (2.4000127486235296, 1.1722228079428587),
    "gumbel": (2.466192080284694, 1.428942297930309),
    "weibull": (0.3849059145980645, 0.25275560350382376),  # of log10 of the levels
}


@pytest.mark.parametrize("link", LINKS)
def test_curves_are_those_of_psignifit(link):
    """Its maximum of the posterior ends within some 1e-5 of that of the likelihood."""
    yes, asked = [11, 13, 16, 25, 29, 30], [30] * 6
    fit = psychometric(LEVELS, yes, asked, link=link, guess=0.5, interval="none")
    low, middle, high = fit.level(0.5 + 0.5 * np.array([0.05, 0.5, 0.95]))
    if link == "weibull":
        low, middle, high = np.log10([low, middle, high])
    assert (middle, high - low) == pytest.approx(PSIGNIFIT[link], rel=1e-4)


@pytest.mark.parametrize("link", LINKS)
def test_a_link_is_a_distribution(link):
    """Its density, complement, inverse and bend belong to F, from end to end."""
    of, eta = curve(link), np.linspace(-30, 6, 73)
    h = 1e-5
    assert of.F(0.0) == pytest.approx(0.5)
    assert of.density(eta) == pytest.approx((of.F(eta + h) - of.F(eta - h)) / (2 * h), abs=1e-9)
    some = eta[of.density(eta) > 1e-9]
    change = (np.log(of.density(some + h)) - np.log(of.density(some - h))) / (2 * h)
    assert of.bend(some) == pytest.approx(change, rel=1e-5, abs=1e-5)
    assert of.F(eta) + of.upper(eta) == pytest.approx(np.ones(eta.size), rel=1e-14)
    assert of.inverse(of.F(eta[20:63])) == pytest.approx(eta[20:63], abs=1e-6)
    assert np.isfinite([f(np.array([-1e3, 1e3])) for f in (of.F, of.density, of.upper)]).all()


@pytest.mark.parametrize("link", ["probit", "gumbel"])
def test_free_rates_are_the_best_there_are(link):
    from scipy.optimize import minimize

    levels = np.linspace(0.5, 5, 10)
    yes, asked = np.array([10, 9, 13, 16, 25, 30, 37, 38, 36, 38]), np.full(10, 40)
    fit = psychometric(levels, yes, asked, link=link, guess="free", lapse="free")

    def cost(v):
        p = v[2] + (1 - v[2] - v[3]) * curve(link).F((levels - v[0]) / v[1])
        return -np.sum(yes * np.log(p) + (asked - yes) * np.log(1 - p))

    other = minimize(
        cost,
        [2.5, 0.5, 0.2, 0.05],
        bounds=[(1, 5), (0.2, 2), (0.001, 0.8), (0.001, 0.1)],
        method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-9},
    )
    found = [fit.pse, fit.sigma, fit.guess, fit.lapse]
    assert found == pytest.approx(list(other.x), rel=1e-4)
    assert fit.loglik >= -other.fun - 1e-9 and fit.parameters == 4
    assert 0 < fit.guess < 0.8 and 0 < fit.lapse < 0.1
    assert fit.aic == pytest.approx(2 * 4 + 2 * other.fun)


@pytest.mark.parametrize("link", ["probit", "weibull"])
def test_no_fixed_rates_are_more_likely_than_free_ones(link):
    """Of 60 people, against every pair of 9 rates of guesses and 6 of lapses."""
    at = np.linspace(0.5, 4, 8)
    p = 0.3 + 0.65 * ndtr((at - 2) / 0.5)
    yes = np.random.default_rng(6).binomial(20, p, (60, 8)).astype(float)
    sets, c = Sets(np.broadcast_to(at, yes.shape), yes, np.full(yes.shape, 20.0)), np.full(60, 2.0)
    best = maximum(sets, c, Model(link, "free", "free"))
    for guess in np.linspace(0, 0.8, 9):
        for lapse in np.linspace(0, 0.1, 6):
            fixed = maximum(sets, c, Model(link, float(guess), float(lapse))).loglik
            assert (best.loglik >= fixed - 1e-6).all(), (guess, lapse, (fixed - best.loglik).max())


def test_a_shared_rate_makes_all_sets_together_most_likely():
    sets = {
        "a": (LEVELS, [0, 4, 10, 17, 20, 17], ASKED),
        "b": (LEVELS, [1, 2, 6, 13, 18, 19], ASKED),
    }
    fits = psychometrics(sets, lapse="shared", interval="none")
    rate = fits["a"].lapse
    assert rate == fits["b"].lapse and 0 < rate < 0.1 and fits["a"].shared == 1
    assert fits["a"].aic == pytest.approx(2 * (2 + 1 - fits["a"].loglik))

    def loglik(lapse):
        return sum(f.loglik for f in psychometrics(sets, lapse=lapse, interval="none").values())

    best = loglik(rate)
    assert best > max(loglik(rate - 1e-3), loglik(rate + 1e-3))
    without = psychometrics(sets, lapse=0.0, interval="none").values()
    found = likelihood_ratio(without, fits.values())
    assert found.df == 1 and found.statistic == pytest.approx(2 * (best - loglik(0.0)))
    first, second = ({k: sets[k] for k in names} for names in (("a",), ("b",)))
    alone = [psychometrics(v, lapse="shared", interval="none") for v in (first, second)]
    assert alone[0]["a"].lapse > rate > alone[1]["b"].lapse
    both = psychometrics(sets, lapse="shared", guess="shared", interval="none")
    assert both["a"].shared == 2 and sum(f.loglik for f in both.values()) >= best - 1e-9


def test_a_shared_lapse_rate_is_at_the_highest_of_several_peaks():
    """A search from 0.02 alone stopped at 0.035, a log-likelihood of 0.92 lower."""
    levels, asked = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0], [20] * 7
    sets = {
        "a": (levels, [9, 12, 10, 17, 19, 19, 20], asked),
        "b": (levels, [13, 9, 11, 17, 19, 15, 16], asked),
    }

    def loglik(lapse):
        fits = psychometrics(sets, lapse=lapse, guess=0.5, interval="none")
        return sum(fit.loglik for fit in fits.values())

    assert loglik("shared") >= max(map(loglik, np.linspace(0.0, 0.1, 11))) - 1e-6


def test_a_rate_is_shared_by_tasks_of_different_chance_levels():
    def table(yes, chance):
        outcomes = [int(k < v) for v in yes for k in range(20)]
        return {
            "level": np.repeat(LEVELS, 20).tolist(),
            "outcome": outcomes,
            "chance": [chance] * len(outcomes),
        }

    sets = {
        "a": table([0, 4, 10, 17, 20, 17], 0.0),
        "b": table([10, 12, 15, 18, 20, 20], 0.5),
    }
    fits = psychometrics(sets, lapse="shared", interval="none")
    rate = fits["a"].lapse
    assert rate == fits["b"].lapse and 0 < rate < 0.1
    assert [fit.guess for fit in fits.values()] == [0.0, 0.5]

    def loglik(lapse):
        return sum(f.loglik for f in psychometrics(sets, lapse=lapse, interval="none").values())

    assert loglik(rate) > max(loglik(rate - 1e-3), loglik(rate + 1e-3))


def test_a_likelihood_ratio_takes_levels_that_differ_by_rounding():
    near = 0.1 + 0.2  # 0.30000000000000004
    one, other = ([0.1, 0.2, near], [0, 1, 1]), ([0.1, 0.2, 0.3] * 2, [1, 0, 1, 0, 0, 1])
    both = psychometric(one[0] + other[0], one[1] + other[1], interval="none")
    each = [psychometric(*v, interval="none") for v in (one, other)]
    for models in ((both,), each), (each[::-1], (both, both)):
        if len(models[0]) == 1:
            assert likelihood_ratio(*models).df == 2
        else:
            refused(BadValue, "the same answers", likelihood_ratio, *models)
    logs = [psychometric(*v, log=True, interval="none") for v in (one, other)]
    assert likelihood_ratio([both], logs).df == 2
    moved = psychometric([*one[0], *[v + 1e-9 for v in other[0]]], one[1] + other[1])
    refused(BadValue, "the same answers", likelihood_ratio, [moved], each)
    refused(BadValue, "'a' is no Fit", likelihood_ratio, iter("a"), each)


def test_a_likelihood_ratio_is_chi_squared_or_f():
    from scipy.stats import chi2, f

    one, other = [1, 4, 9, 17, 19, 20], [0, 2, 8, 12, 19, 20]
    each = [psychometric(LEVELS, yes, ASKED, interval="none") for yes in (one, other)]
    both = psychometric(np.tile(LEVELS, 2), [*one, *other], np.tile(ASKED, 2), interval="none")
    found = likelihood_ratio([both], each)
    gain = 2 * (sum(v.loglik for v in each) - both.loglik)
    assert (found.statistic, found.df) == (pytest.approx(gain), 2)
    assert found.p == pytest.approx(chi2.sf(gain, 2))
    rough = [
        psychometric(LEVELS, yes, ASKED) for yes in ([0, 9, 7, 19, 13, 20], [0, 2, 8, 12, 19, 20])
    ]
    joined = psychometric(
        np.tile(LEVELS, 2), [0, 9, 7, 19, 13, 20, 0, 2, 8, 12, 19, 20], np.tile(ASKED, 2)
    )
    found = likelihood_ratio([joined], rough)
    scatter = (rough[0].dispersion + rough[1].dispersion) / 2
    assert scatter > 1 and found.p == pytest.approx(f.sf(found.statistic / 2 / scatter, 2, 8))
    refused(BadValue, "the same answers", likelihood_ratio, [both], rough)
    refused(BadValue, "4 parameters .* must be more", likelihood_ratio, each, each)
    worse = psychometric(LEVELS, one, ASKED, guess=0.25, lapse="free", interval="none")
    uneven = [rough[0], dc.replace(rough[1], levels=12, dispersion=5.0)]  # 4 and 10 of freedom
    scatter = (4 * rough[0].dispersion + 10 * 5.0) / 14
    found = likelihood_ratio([joined], uneven)
    assert found.p == pytest.approx(f.sf(found.statistic / 2 / scatter, 2, 14))
    assert worse.loglik < each[0].loglik
    refused(BadValue, "does not contain it", likelihood_ratio, each[:1], [worse])


def test_a_likelihood_ratio_takes_levels_that_differ_by_rounding_as_one():
    """Two staircases in dB reach one level by different steps."""
    by_steps = np.nextafter(LEVELS, np.inf)
    one, other = [1, 4, 9, 17, 19, 20], [0, 2, 8, 12, 19, 20]
    how = {"log": True, "interval": "none"}
    each = [
        psychometric(LEVELS, one, ASKED, **how),
        psychometric(by_steps, other, ASKED, **how),
    ]
    both = psychometric([*LEVELS, *by_steps], [*one, *other], np.tile(ASKED, 2), **how)
    assert likelihood_ratio([both], each).df == 2
    fewer = psychometric(by_steps, [0, 2, 8, 12, 19, 19], ASKED, **how)
    refused(BadValue, "the same answers", likelihood_ratio, [both], [each[0], fewer])


def test_a_likelihood_ratio_of_models_that_are_not_nested_is_an_error():
    """The shared rate of the fuller model was fitted to two further sets."""
    levels, asked, how = [0.01, 0.02, 0.04, 0.08, 0.16, 0.32], [30] * 6, {"guess": 0.5}
    one, other = [15, 17, 22, 27, 29, 28], [15, 18, 23, 28, 29, 29]
    more = {"c": [15, 17, 22, 27, 30, 30], "d": [15, 18, 23, 29, 30, 30]}
    sets = {key: (levels, yes, asked) for key, yes in ({"a": one, "b": other} | more).items()}
    how |= {"link": "weibull", "interval": "none"}
    both = psychometric(levels * 2, one + other, asked * 2, lapse="free", **how)
    wide = psychometrics(sets, lapse="shared", **how)
    refused(BadValue, "does not contain it", likelihood_ratio, [both], [wide["a"], wide["b"]])
    fits = psychometrics({key: sets[key] for key in "ab"}, lapse="shared", **how)
    found = likelihood_ratio([both], fits.values())
    assert found.df == 2 and found.statistic > 0


@pytest.mark.longer
def test_intervals_hold_the_truth_as_often_as_they_say():
    """94 to 96 % at length; of 1000 people, 93 to 97 %: three times the spread of such
    a count.  With guesses it is 93 %.
    """
    people, off = (20000, 0.01) if STRESS else (1000, 0.02)
    at = np.linspace(1.2, 2.8, 7)
    assert covered(people, Model(), at, ndtr) == pytest.approx((0.95, 0.95), abs=off)
    if STRESS:
        guessed = covered(1000, Model(guess=0.5, lapse=0.02), at, lambda z: 0.5 + 0.48 * ndtr(z))
        # as docs say; five of the same 1000 people may differ
        assert guessed == pytest.approx((0.936, 0.926), abs=0.004)


@pytest.mark.stress
def test_bootstrap_intervals_hold_the_truth():
    at, n, inside = np.linspace(1.2, 2.8, 7), np.full(7, 40.0), 0
    drawn = np.random.default_rng(3).binomial(40, ndtr((at - 2) / 0.4), (2000, 7)).astype(float)
    for k, yes in enumerate(drawn):
        low, high = bootstrap(Sets(at, yes, n), seed=k, n=500)[0]
        inside += low < 2 < high
    assert 0.94 < inside / 2000 < 0.96


def test_bootstrap_draws_lapses_too():
    """As by hand: answers drawn from the curve with its lapses, each fitted with the
    same rate.
    """
    yes, asked, n = 10 * np.array(YES), 10 * np.array(ASKED), 20
    drawn = np.random.default_rng(3).binomial(
        asked, psychometric(LEVELS, yes, asked, lapse=0.1)(LEVELS), (n, len(LEVELS))
    )
    fits = psychometrics(
        {k: (LEVELS, drawn[k], asked) for k in range(n)}, lapse=0.1, interval="none"
    )
    wanted = np.quantile([f.pse for f in fits.values()], [0.025, 0.975], method="median_unbiased")
    np.testing.assert_allclose(
        bootstrap(Sets(np.array(LEVELS), yes, asked), Model(lapse=0.1), seed=3, n=n)[0],
        wanted,
        rtol=1e-9,
    )


@pytest.mark.filterwarnings("error")
def test_a_bootstrap_with_flat_resamples_has_ends():
    """Half said yes at both of two levels: resamples are flat, or steep either way."""
    sets = Sets(np.array([1.0, 2.0]), np.array([4.0, 4.0]), np.array([8.0, 8.0]))
    (low, high), (flat_low, flat_high) = bootstrap(sets)
    assert low == -np.inf and high == np.inf and 0 < flat_low < 2 and flat_high == np.inf


def test_bootstrap_and_profile_agree_where_there_are_many_answers():
    many = [10 * v for v in YES], [10 * v for v in ASKED]
    a, b = (psychometric(LEVELS, *many, interval=i, seed=5) for i in ("profile", "bootstrap"))
    assert b.pse_interval == pytest.approx(a.pse_interval, abs=0.01)
    assert b.sigma_interval == pytest.approx(a.sigma_interval, rel=0.04)
    assert psychometric(LEVELS, *many, interval="bootstrap", seed=5) == b
    assert (
        bootstrap(Sets(LEVELS, YES, ASKED), seed=1, n=20)
        != bootstrap(Sets(LEVELS, YES, ASKED), seed=2, n=20)
    ).all()


# Nothing to fit -----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("yes", "problem"),
    [
        ([0, 0, 0, 20, 20, 20], "separated"),
        ([0, 0, 7, 20, 20, 20], "separated"),  # one level between has both answers
        ([0, 0, 0, 0, 0, 0], "few"),
        ([20, 19, 15, 9, 2, 0], "falling"),
        ([20, 20, 20, 0, 0, 0], "falling"),
        ([10, 11, 9, 12, 10, 11], "flat"),
        ([10, 10, 10, 10, 10, 10], "flat"),
        ([11, 10, 12, 9, 11, 10], "flat"),  # falls no more than by chance
    ],
)
def test_data_that_determine_no_curve_give_no_number(yes, problem):
    fit = psychometric(LEVELS, yes, ASKED)
    assert fit.problems == (problem,) and len(fit.advice()) == 1
    assert np.isnan([fit.pse, fit.sigma, fit.jnd, *fit.pse_interval, *fit.sigma_interval]).all()


def test_a_gap_is_told():
    assert (
        "between 2 and 2.5"
        in psychometric(LEVELS, [0, 0, 0, 20, 20, 20], ASKED, log=True).advice()[0]
    )
    # but for a lapse, separated
    fit = psychometric(LEVELS, [0, 0, 1, 20, 20, 19], ASKED, lapse=0.02)
    assert fit.problems == ("separated",)


def test_a_gap_beside_guesses_is_where_the_answers_pass_half_way():
    fit = psychometric([1, 2, 3, 4], [10, 10, 20, 20], [20] * 4, guess=0.5)
    assert fit.problems == ("separated",) and fit.gap == (2, 3)
    assert psychometric([1, 10], [10, 11], [20] * 2, guess=0.5, log=True, interval="none").gap == (
        10,
        np.inf,
    )


def test_lapses_are_told_and_can_be_fitted():
    levels = [1, 1.5, 2, 2.5, 3, 10]
    plain = psychometric(levels, [0, 3, 10, 17, 20, 18], ASKED)
    assert plain.problems == ("lapses",) and plain.sigma > 1
    for other in (
        psychometric(levels, [0, 3, 10, 17, 20, 18], ASKED, lapse=v) for v in ("free", 0.04)
    ):
        assert (
            other.problems == ()
            and other.sigma < 0.6
            and 1.6 < other.pse_interval[0] < 2 < other.pse_interval[1] < 2.4
        )
    near, far = (
        psychometric([*levels[:5], v], [0, 3, 10, 17, 20, 19], ASKED, interval="none")
        for v in (3.6, 3.75)
    )
    # twice the gain is 4.6 and 6.1; one in a hundred passes 5.4
    assert (near.problems, far.problems) == ((), ("lapses",))


# The task -----------------------------------------------------------------------------
def test_the_threshold_of_a_detection_has_the_chance_level_of_its_task():
    """A standard of no amplitude: answers, observer and fit know that half of all
    answers are right by chance.
    """
    task = TwoInterval("felt", "buzz", Stimulus("tone", {"A": 0.0}), Stimulus("tone"), "A")
    levels = np.geomspace(0.02, 0.5, 7).tolist()
    tone = stimlib.Scene({"v": stimlib.Param("A", 0.1) * oscillator(250)})
    trials = ConstantStimuli(tuple((task, v) for v in levels), repeats=40)
    buzz = choice("buzz", "Which one was it?", "first", "second")
    made = Experiment("buzz", "1", {"tone": tone}, trials, (buzz,), fs=8000.0, safety=1.0)
    answers = simulate(made, Observer(0.1, 0.2, log=True), 1)
    assert set(answers["chance"]) == {0.5}
    for fit in (
        psychometric(answers, log=True, unit="V"),
        fitted(answers, log=True, unit="V")["P01", "felt"],
    ):
        assert (fit.guess, fit.name, fit.problems) == (0.5, "threshold", ()) and fit.pse_interval[
            0
        ] < 0.1 < fit.pse_interval[1]
        assert str(fit).startswith(f"threshold {fit.pse:.4g} V [") and str(fit).endswith(
            f"JND {fit.jnd:.0%} of it, fit p = {fit.p:.2g}"
        )
        assert fit(0.0) == 0.5 and fit(np.array([[1e9]])) == pytest.approx(1.0)
    alone = psychometric(answers["level"], answers["outcome"], log=True)
    assert (
        alone.problems == ("guess",)
        and "PSE" in str(alone)
        and "0.5 about as well" in alone.advice()[0]
    )
    assert alone.pse < 0.06  # what comes out without the task: half of the truth
    assert psychometric(answers, log=True, guess=0.0).guess == 0.0  # who says a rate means it


def test_a_table_of_answers_is_taken_whole():
    rows = {"level": [1, 1, 2, 2, 3, 3], "outcome": [0, 0, 1, 0, 1, 1]}
    assert repr(psychometric(rows)) == repr(psychometric(rows["level"], rows["outcome"]))
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(rows | {"chance": [None] * 6})
    assert repr(psychometric(table)) == repr(psychometric(rows))
    assert repr(psychometric(table.assign(chance=0.5))) == repr(psychometric(rows, guess=0.5))
    both = psychometrics(
        {"a": rows, "b": rows | {"chance": [0.5] * 6}, "c": (rows["level"], rows["outcome"])}
    )
    assert [fit.guess for fit in both.values()] == [0, 0.5, 0] and list(both) == ["a", "b", "c"]
    refused(
        BadValue,
        "chance levels .*fit each task by itself",
        psychometric,
        rows | {"chance": [0.5] * 3 + [None] * 3},
    )
    refused(UnknownName, "no column 'outcome'; there are level", psychometric, {"level": [1, 2]})


def test_an_interval_takes_the_dispersion_that_is_given():
    from scipy.stats import chi2, f

    wide, narrow = (psychometric(LEVELS, YES, ASKED, dispersion=v) for v in (1.0, 0.25))
    for name in ("pse_interval", "sigma_interval"):
        (low, high), (inner_low, inner_high) = getattr(wide, name), getattr(narrow, name)
        assert low < inner_low < inner_high < high
        assert (inner_high - inner_low) / (high - low) == pytest.approx(0.5, abs=0.06)
    least = chi2.ppf(0.95, 1)
    wanted = [least, 2 * f.ppf(0.95, 1, 1), 2 * f.ppf(0.95, 1, 2)]
    assert allowed([2.0, 2.0, 2.0], [0, 1, 2]) == pytest.approx(wanted)


def test_a_level_is_where_the_curve_has_a_probability():
    fit = psychometric([1.0, 2.0, 3.0, 4.0], [11, 14, 19, 20], [20] * 4, guess=0.5, lapse=0.01)
    p = np.array([0.51, 0.75, 0.98])
    assert fit(fit.level(p)) == pytest.approx(p)
    assert np.isnan(fit.level([0.0, 0.5, 0.99, 1.0])).all()


def test_numbers_of_every_kind_are_taken():
    from fractions import Fraction

    plain = psychometric(LEVELS, YES, ASKED, guess=0.25, lapse=0.0, confidence=0.5)
    for number in (np.float32, np.float64, Fraction):
        how = dict(guess=number(0.25), lapse=number(0), confidence=number(0.5))
        assert repr(psychometric(LEVELS, YES, ASKED, **how)) == repr(plain)
    assert psychometric(LEVELS, YES, ASKED, lapse=np.int64(0), interval="none").lapse == 0


def test_a_chance_level_of_a_table_is_a_number_or_missing():
    rows = {"level": [1, 1, 2, 2, 3, 3], "outcome": [0, 0, 1, 0, 1, 1]}
    for given, chance in ((np.float32(0.5), 0.5), (np.int64(0), 0.0), (np.nan, 0.0)):
        fit = psychometric(rows | {"chance": [given] * 6})
        assert fit.guess == chance and fit.comparison == bool(given != given)
    pandas = pytest.importorskip("pandas")
    assert psychometric(rows | {"chance": [pandas.NA] * 6}).comparison
    for given in ("0.5", "free", "shared", [0.5], True, 1.0, -0.1, np.inf):
        why = "chance = .* must be a number from 0 to below 1, or None"
        refused(BadValue, why, psychometric, rows | {"chance": [given] * 6})


def test_a_fit_that_failed_over_logarithms_has_no_difference():
    flat = psychometric([1, 2, 3, 4], [10, 9, 11, 10], [20] * 4, log=True)
    assert flat.problems == ("flat",) and np.isnan([flat.jnd, *flat.jnd_interval]).all()


def test_levels_below_0_are_not_on_a_logarithm():
    fit = psychometric(LEVELS, YES, ASKED, log=True)
    refused(BadValue, "fit: level = -1 must be 0 or above", fit, [1.0, -1.0])
    assert psychometric(LEVELS, YES, ASKED)(-1.0) > 0


def test_ends_beyond_a_float_are_infinite():
    """Answers that rise just enough: the interval is hundreds of decades long."""
    levels, asked = [1e-200, 1.0, 1e200], [1000] * 3
    found = [
        psychometric(levels, [500 - d, 500, 500 + d], asked, log=True, dispersion=1.0)
        for d in range(22, 26)
    ]
    ends = [fit.pse_interval for fit in found if not fit.problems]
    assert any(high == np.inf and low == 0 for low, high in ends)
    assert float(found[-1].level(1 - 1e-12)) == np.inf


def flagged(z, chance, people, n=20, **how):
    """How often of these people "guess" is among the problems."""
    p = chance + (1 - chance) * ndtr(z)
    drawn = np.random.default_rng(7).binomial(n, p, (people, z.size))
    fits = psychometrics(
        {k: (z, yes, np.full(z.size, n)) for k, yes in enumerate(drawn)}, interval="none", **how
    )
    return sum("guess" in fit.problems for fit in fits.values()) / people


@pytest.mark.longer
def test_a_wrong_chance_level_is_flagged_and_a_right_one_is_not():
    """As docs/reference/experiments_analysis says; of 100 people, where none should be
    flagged two at most may be.
    """
    people, off = (2000, 0.0) if STRESS else (100, 0.01)
    z = np.linspace(-2, 2, 7)  # levels, in sigmas from the middle
    assert flagged(z, 0.0, people) <= 0.01 + off  # a comparison
    assert flagged(z, 0.5, people, guess=0.5) <= 0.01 + off  # a detection
    assert flagged(z, 0.5, people) >= 0.9  # a detection that is taken for a comparison
    # a comparison that is taken for a detection; the rest: "separated"
    assert flagged(z, 0.0, people, guess=0.5) >= 0.85


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
    ],
)
def test_what_cannot_be_used_is_said(given, said):
    refused(BadValue, said, psychometric, **given)
