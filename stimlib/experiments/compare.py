"""Statistical tests between groups and within participants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import BadValue, UnknownName, need, public, said_as
from ..system.packages import package
from .answer_sets import missing
from .likelihood import numbers
from .tables import Columns, grouped

Array = np.ndarray
Adjustment = Literal["bonferroni", "none"]
Sides = Literal["two-sided", "one-sided"]
LARGEST = 1e100  # size of a value; a spread below 1 of it has no sum of squares


@dataclass(frozen=True)
class Statistic:
    """A statistical test and its result.

    Attributes
    ----------
    name : str
    value : float
    df : tuple of float
        Degrees of freedom, if the test has any.
    p : float
    effect : float
        Effect size: of `paired` d_z, the mean difference divided by the standard
        deviation of differences; of `anova` eta squared, SS between groups/total SS; of
        `kruskal` epsilon squared, H/(N - 1); nan of others.
    """

    name: str
    value: float
    df: tuple[float, ...]
    p: float
    effect: float = float("nan")


# Between groups -----------------------------------------------------------------------
@public
def shapiro(values: ArrayLike) -> Statistic:
    """Run the Shapiro-Wilk test, in which a small p means that values are NOT normal.

    Parameters
    ----------
    values : array_like, shape (n,)
        At least three values.

    Returns
    -------
    Statistic
        W and its p.

    Raises
    ------
    BadValue
        Fewer than three values, NaN or infinite values, or all values equal.

    References
    ----------
    Shapiro and Wilk (1965), Biometrika 52:591.

    Examples
    --------
    >>> from stimlib.experiments import shapiro
    >>> round(
    ...     shapiro([148, 154, 158, 160, 161, 162, 166, 170, 182, 195, 236]).value, 4
    ... )  # their example
    0.7888
    """
    row = _row("shapiro", values, 3)
    if _same(row):
        raise BadValue(
            f"shapiro: all {row.size} values are {row[0]:g}: there is no spread to judge"
        )
    # scaled by a power of 2, because scipy takes a range below 1e-19 for none
    found = scipy.stats.shapiro(np.ldexp(row, -int(np.frexp(np.ptp(row))[1])))
    return Statistic("Shapiro-Wilk", float(found.statistic), (), float(found.pvalue))


@public
def kruskal(groups: Mapping[str, ArrayLike]) -> Statistic:
    """Run the Kruskal-Wallis test of whether groups differ in their ranks.

    Parameters
    ----------
    groups : dict of str to array_like, shape (n,)
        Independent groups; for answers of the same people in several conditions use
        `repeated` or `mixed`.

    Returns
    -------
    Statistic
        H, corrected for ties.

    Raises
    ------
    BadValue
        Fewer than two groups, an empty one, values that are not finite or all the same.

    References
    ----------
    Kruskal and Wallis (1952), Journal of the American Statistical Association 47:583.

    Examples
    --------
    >>> from stimlib.experiments import kruskal
    >>> test = kruskal({"a": [1, 3, 5, 7, 9], "b": [2, 4, 6, 8, 10]})
    >>> round(test.value, 6), round(test.p, 6)
    (0.272727, 0.601508)
    """
    found = scipy.stats.kruskal(*_groups("kruskal", groups).values())
    return Statistic(
        "Kruskal-Wallis",
        float(found.statistic),
        (len(groups) - 1.0,),
        float(found.pvalue),
        float(found.statistic) / (sum(map(np.size, groups.values())) - 1),
    )


@dataclass(frozen=True)
class Pair:
    """The comparison of two groups.

    Attributes
    ----------
    a, b : str
    statistic : float
        Above 0 where a is larger.
    p : float
        Adjusted, at most 1.
    sides, adjustment : str
        As given to `dunn`.
    """

    a: str
    b: str
    statistic: float
    p: float
    sides: str
    adjustment: str


@public
def dunn(
    groups: Mapping[str, ArrayLike],
    sides: Sides = "two-sided",
    adjustment: Adjustment = "bonferroni",
) -> tuple[Pair, ...]:
    """Run Dunn's test on every pair of groups, by their mean ranks among all values.

    z = (Ra - Rb)/sqrt((N(N + 1)/12 - sum(t^3 - t)/(12(N - 1))) (1/na + 1/nb)), t the
    sizes of ties.

    Parameters
    ----------
    groups : dict of str to array_like, shape (n,)
    sides : {"two-sided", "one-sided"}
        One-sided is P(Z > abs(z)), half of the two-sided p; some programs print it
        without saying so.
    adjustment : {"bonferroni", "none"}
        "bonferroni" multiplies p by the number of pairs, up to 1.

    Returns
    -------
    tuple of Pair
        In the groups' order.

    Raises
    ------
    BadValue
        As `kruskal`; an unknown name of sides or adjustment.

    References
    ----------
    Dunn (1964), Technometrics 6:241.

    Examples
    --------
    >>> from stimlib.experiments import dunn
    >>> pairs = dunn({"a": [1, 3, 5], "b": [2, 4, 6], "c": [7, 8, 9]})
    >>> [(p.a, p.b, round(p.statistic, 3), round(p.p, 4)) for p in pairs]
    [('a', 'b', -0.447, 1.0), ('a', 'c', -2.236, 0.076), ('b', 'c', -1.789, 0.2209)]
    """
    rows = _groups("dunn", groups)
    ranks = scipy.stats.rankdata(np.concatenate(list(rows.values())))
    N = ranks.size
    ties = np.unique(ranks, return_counts=True)[1]
    variance = N * (N + 1) / 12 - np.sum(ties**3.0 - ties) / (12 * (N - 1))
    parts = dict(
        zip(rows, np.split(ranks, np.cumsum([r.size for r in rows.values()])[:-1]), strict=True)
    )
    pairs = list(combinations(rows, 2))
    z = [
        (parts[a].mean() - parts[b].mean())
        / np.sqrt(variance * (1 / parts[a].size + 1 / parts[b].size))
        for a, b in pairs
    ]
    times = (2 if sides == "two-sided" else 1) * (len(pairs) if adjustment == "bonferroni" else 1)
    return tuple(
        Pair(
            a, b, float(v), min(1.0, times * float(scipy.stats.norm.sf(abs(v)))), sides, adjustment
        )
        for (a, b), v in zip(pairs, z, strict=True)
    )


@public
def anova(groups: Mapping[str, ArrayLike]) -> Statistic:
    """Run a one-way analysis of variance between independent groups.

    Parameters
    ----------
    groups : dict of str to array_like, shape (n,)
        Groups of different people. For the same people in several conditions, this test
        has the wrong error term and too many degrees of freedom: use `repeated`.

    Returns
    -------
    Statistic
        F, with its two degrees of freedom.

    Raises
    ------
    BadValue
        As `kruskal`; no group with two values.

    Examples
    --------
    >>> from stimlib.experiments import anova
    >>> test = anova({"a": [1.0, 2.0, 3.0], "b": [2.0, 3.0, 4.0]})
    >>> round(test.value, 6), test.df, round(test.p, 6)
    (1.5, (1.0, 4.0), 0.287864)
    """
    rows = _groups("anova", groups)
    df = len(rows) - 1.0, float(sum(r.size for r in rows.values()) - len(rows))
    if df[1] == 0:
        raise BadValue("anova: every group has one value, so there is no error to compare with")
    found = scipy.stats.f_oneway(*rows.values())
    return Statistic(
        "ANOVA, independent groups",
        float(found.statistic),
        df,
        float(found.pvalue),
        1 - df[1] / (df[1] + df[0] * float(found.statistic)),
    )


@public
def elapsed_times(
    answers: Columns, by: str = "condition", seconds: str = "seconds"
) -> dict[str, Array]:
    """Return the times that participants took in each condition, for tests of groups.

    Parameters
    ----------
    answers : dict of str to sequence
        With the columns ``by`` and ``seconds``; rows without a time are left out.
    by, seconds : str
        The column of the condition, and that of the times in s, such as ``softer_rt``.

    Returns
    -------
    dict of str to ndarray
        Times in s by condition, for `kruskal`, `dunn`, `shapiro` and `times_text`.

    Raises
    ------
    UnknownName
        A column is missing.
    BadValue
        A time is no number.

    Notes
    -----
    Times are skewed: compare medians, or ranks. Tests of groups take the times as those
    of different people. If each participant was in all conditions, use `repeated` with
    the mean log time of each participant and condition.

    Examples
    --------
    >>> from stimlib.experiments import elapsed_times, kruskal, times_text
    >>> times = elapsed_times(
    ...     {
    ...         "condition": ["slow"] * 6 + ["fast"] * 6,
    ...         "seconds": [9, 12, 13, 15, 18, 31, 3, 4, 4, 5, 6, 14],
    ...     }
    ... )
    >>> round(kruskal(times).p, 3)
    0.016
    >>> print(times_text(times))
    slow          14.0 s [9.0, 31.0], mean 16.33 s, SD 7.79, n = 6
    fast          4.5 s [3.0, 14.0], mean 6.00 s, SD 4.05, n = 6
    times: H(1) = 5.789, p = 0.016
      slow and fast: z = 2.406, p = 0.016; t = 2.88, p = 0.016 (two-sided, times 1)
    """
    need("elapsed_times", (by, seconds), answers)
    return {
        name: numbers("elapsed_times", times)
        for (name,), rows in grouped({**answers, by: list(map(str, answers[by]))}, [by]).items()
        if (times := [v for v in rows[seconds] if not missing(v)])
    }


@public
def times_text(
    times: Mapping[str, ArrayLike],
    printed: Mapping[str, str] | None = None,
    sides: Sides = "two-sided",
) -> str:
    """Return a summary and tests of elapsed times as lines of text.

    For each condition, its median with an interval, mean and standard deviation; the
    Kruskal-Wallis test; and for each pair Dunn's test and Student's t test of
    independent groups, whose p are multiplied by the number of pairs.  There are no
    tests of one condition, or of times that are all the same.

    Parameters
    ----------
    times : dict of str to array_like
        As `elapsed_times` returns them.
    printed : dict of str to str, optional
        What a paper prints, by condition, or by "A and B" for the tests of a pair.
    sides : {"two-sided", "one-sided"}
        Of the tests of pairs.

    Raises
    ------
    BadValue
        A time is no number, or not finite.

    Notes
    -----
    The interval of a median ends at two of the times, between which it lies with a
    probability of at least 95 %, whatever their distribution; nan with fewer than six
    times.

    References
    ----------
    Li et al. (2016), "Data processing methods". Interval of the median: Conover,
    Practical Nonparametric Statistics (1999), section 3.2.

    Examples
    --------
    See `elapsed_times`.
    """
    rows = {name: _row(f"times_text: {name}", row, 1) for name, row in times.items()}
    told, lines, moments = {k: f"  paper: {v}" for k, v in (printed or {}).items()}, [], {}
    for name, row in rows.items():
        n, k = row.size, int(scipy.stats.binom.ppf(0.025, row.size, 0.5))
        low, high = np.array([np.nan, *np.sort(row), np.nan])[[k, n + 1 - k]]
        moments[name] = row.mean(), row.std() * (n / (n - 1 or np.nan)) ** 0.5, n
        lines.append(
            f"{name:<12}  {np.median(row):.1f} s [{low:.1f}, {high:.1f}], mean {row.mean():.2f} s,"
            f" SD {moments[name][1]:.2f}, n = {n}{told.get(name, '')}"
        )
    if len(rows) < 2 or _same(np.concatenate(list(rows.values()))):
        return "\n".join(lines)
    test, pairs = kruskal(rows), dunn(rows, sides)
    lines += [f"times: H({test.df[0]:g}) = {test.value:.3f}, p = {test.p:.2g}"]
    for pair in pairs:
        with np.errstate(all="ignore"):  # of one time each there is no t
            t = scipy.stats.ttest_ind_from_stats(*moments[pair.a], *moments[pair.b])
        p = min(len(pairs) * t.pvalue / (1 if sides == "two-sided" else 2), 1.0)
        lines.append(
            f"  {pair.a} and {pair.b}: z = {pair.statistic:.3f}, p = {pair.p:.2g}; t ="
            f" {t.statistic:.2f}, p = {p:.2g} ({sides}, times {len(pairs)})"
            f"{told.get(f'{pair.a} and {pair.b}', '')}"
        )
    return "\n".join(lines)


# Within participants ------------------------------------------------------------------
@public
def paired(a: ArrayLike, b: ArrayLike) -> Statistic:
    """Run a paired t test: the same people in two conditions.

    Parameters
    ----------
    a, b : array_like, shape (participants,)
        In the same order.

    Returns
    -------
    Statistic
        t with n - 1 degrees of freedom, above 0 where a is larger; two-sided.  Its
        square is the F of `repeated`.

    Raises
    ------
    BadValue
        Different lengths, fewer than two values, NaN or infinity, or differences that
        are all equal.

    Examples
    --------
    >>> from stimlib.experiments import paired
    >>> test = paired([2.4, 2.3, 2.6, 2.1], [2.0, 2.1, 2.1, 2.0])
    >>> round(test.value, 4), test.df, round(test.p, 4)
    (3.2863, (3.0,), 0.0462)
    """
    a, b = _row("paired", a, 2), _row("paired", b, 2)
    if a.size != b.size:
        raise BadValue(
            f"paired: {a.size} values and {b.size}: give both of every participant, in the same"
            " order"
        )
    _spread("paired", a - b)
    if _same(a - b, np.abs([a, b]).max()):
        raise BadValue("paired: all differences are the same: there is no spread to compare with")
    found = scipy.stats.ttest_rel(a, b)
    return Statistic(
        "paired t",
        float(found.statistic),
        (a.size - 1.0,),
        float(found.pvalue),
        float(found.statistic) / a.size**0.5,
    )


@dataclass(frozen=True)
class Effect:
    """One effect of a repeated-measures analysis of variance.

    Each number has the shape of the batch of experiments, () for one experiment.

    Attributes
    ----------
    name : str
        Factors joined by ``:``.
    F : float or ndarray
    df : (float, float)
    p : float or ndarray
        Uncorrected, valid under sphericity.
    epsilon : float or ndarray
        Greenhouse and Geisser's epsilon: 1 under sphericity, at least 1/df.
    p_corrected : float or ndarray
        With both degrees of freedom multiplied by epsilon.
    eta2 : float or ndarray
        Partial eta squared, SS/(SS + SS of its error).
    generalized_eta2 : float or ndarray
        SS/(SS + SS of all differences between people within conditions).  Unlike the
        partial one it counts how much people differ on average, so that it can be
        compared with studies of different people in each condition.
    """

    name: str
    F: Any
    df: tuple[float, float]
    p: Any
    epsilon: Any
    p_corrected: Any
    eta2: Any
    generalized_eta2: Any


@public
def repeated(values: ArrayLike, factors: Sequence[str] = ("condition",)) -> tuple[Effect, ...]:
    """Run a repeated-measures analysis of variance.

    All participants take part in all conditions; there may be any number of factors.

    Each effect is a set of orthonormal contrasts of the conditions.  With d their
    values for one person, and n people: F = n |mean d|^2 (n - 1)/sum |d - mean d|^2.
    The error term is the variation of the effect between people, so each person needs
    one value in each condition: the mean of the trials.

    Parameters
    ----------
    values : array_like, shape (.., participants, levels of the first factor, levels of
    the second, ..)
        Leading axes are separate experiments (for simulations).
    factors : sequence of str
        Their names.

    Returns
    -------
    tuple of Effect
        Main effects, then interactions.  Of separate experiments, those whose
        differences are the same for all participants have F infinite or nan.

    Raises
    ------
    BadValue
        Fewer axes than factors and participants, fewer than two of either, values that
        are not finite; of one experiment, differences that are the same for all
        participants.

    References
    ----------
    Maxwell and Delaney (2004), Designing Experiments and Analyzing Data, chapters 11 to
    13; Greenhouse and Geisser (1959), Psychometrika 24:95; of generalized eta squared
    Olejnik and Algina (2003), Psychological Methods 8:434, and Bakeman (2005), Behavior
    Research Methods 37:379.

    Examples
    --------
    >>> from stimlib.experiments import repeated
    >>> (effect,) = repeated([[2.0, 2.4], [2.1, 2.3], [2.1, 2.6], [2.0, 2.1]])
    >>> round(float(effect.F), 4), effect.df, round(float(effect.p), 4)
    (10.8, (1.0, 3.0), 0.0462)
    >>> round(float(effect.eta2), 4), round(float(effect.generalized_eta2), 4)
    (0.7826, 0.5625)
    """
    y = numbers("repeated: values", values)
    names = tuple(factors)
    if len(set(names)) < len(names):
        raise BadValue(f"repeated: factors {', '.join(names)}: each needs a name of its own")
    if y.ndim < len(names) + 1 or not names:
        raise BadValue(
            f"repeated: shape {y.shape} has no axis for the participants and one for each of"
            f" {', '.join(names)}"
        )
    shape = y.shape[y.ndim - len(names) - 1 :]
    if min(shape) < 2:
        raise BadValue(
            f"repeated: {shape[0]} participants and levels {shape[1:]}: there must be at least two"
            " of each"
        )
    if not np.isfinite(y).all():
        raise BadValue(
            "repeated: a value is not finite: every participant needs one in every condition; for"
            " gaps take mixed"
        )
    _size("repeated", y)
    _spread("repeated", y)
    n = shape[0]
    rows = y.reshape(*y.shape[: y.ndim - len(shape)], n, -1)
    within = np.sum((rows - rows.mean(axis=-2, keepdims=True)) ** 2, axis=(-2, -1))
    found, least = [], 1e-28 * np.sum(rows * rows, axis=(-2, -1))  # what may be rounding
    for size in range(1, len(names) + 1):
        for some in combinations(range(len(names)), size):
            d = rows @ _contrasts(shape[1:], some)
            middle = d.mean(axis=-2)
            rest = d - middle[..., None, :]
            effect, error = n * np.sum(middle**2, axis=-1), np.sum(rest**2, axis=(-2, -1))
            df = float(d.shape[-1]), float(d.shape[-1] * (n - 1))
            name = ":".join(names[k] for k in some)
            none = error <= least
            if y.ndim == len(shape) and none:
                raise BadValue(
                    f"repeated: {name}: the differences are the same for all participants, so there"
                    " is no error to compare with"
                )
            effect, error = np.where(effect <= least, 0.0, effect), np.where(none, 0.0, error)
            with np.errstate(divide="ignore", invalid="ignore"):
                F = (effect / df[0]) / (error / df[1])
                S = np.where(none[..., None, None], 0.0, np.swapaxes(rest, -1, -2) @ rest)
                epsilon = np.trace(S, axis1=-2, axis2=-1) ** 2 / (
                    df[0] * np.sum(S * S, axis=(-2, -1))
                )
                parts = effect / (effect + error), effect / (effect + within)
            found.append(
                Effect(
                    name,
                    F,
                    df,
                    scipy.stats.f.sf(F, *df),
                    epsilon,
                    scipy.stats.f.sf(F, df[0] * epsilon, df[1] * epsilon),
                    *parts,
                )
            )
    return tuple(found)


def _contrasts(levels: Sequence[int], some: Sequence[int]) -> Array:
    """Return orthonormal contrasts for the named factors.

    The contrasts are differences within these factors and means over the others.
    """
    matrix = np.ones((1, 1))
    for k, m in enumerate(levels):
        if k in some:
            # each level against those before
            helmert = np.triu(np.ones((m, m - 1))) - np.eye(m, m - 1, -1) * np.arange(1, m)
            part = helmert / np.linalg.norm(helmert, axis=0)
        else:
            part = np.full((m, 1), m**-0.5)
        matrix = np.kron(matrix, part)
    return matrix


@dataclass(frozen=True)
class Coefficient:
    """A coefficient of a mixed model: estimate, standard error, z, p and interval."""

    name: str
    value: float
    error: float
    z: float
    p: float
    low: float
    high: float


@dataclass(frozen=True)
class Mixed:
    """A fitted linear mixed model.

    Attributes
    ----------
    coefficients : tuple of Coefficient
        Coefficients of the fixed effects.
    group_variance, residual_variance : float
        Between participants (of the intercept), and within.
    converged : bool
        If False, do not use the numbers.
    loglik : float
    """

    coefficients: tuple[Coefficient, ...]
    group_variance: float
    residual_variance: float
    converged: bool
    loglik: float


@public
def mixed(
    columns: Mapping[str, Sequence[Any]], formula: str, participant: str = "participant"
) -> Mixed:
    """Fit a linear mixed model with a random intercept for each participant.

    Use it for incomplete data, covariates such as the trial number, and drift.

    Parameters
    ----------
    columns : dict of str to sequence, or DataFrame
        A row for each answer; those with a gap in what the formula names are left out.
    formula : str
        A patsy formula, such as ``"rating ~ C(amplitude) + trial"``.  Its terms are
        executed as Python code: never use one from an untrusted source.
    participant : str
        The column with the participant of each answer.

    Returns
    -------
    Mixed
        By restricted maximum likelihood.

    Raises
    ------
    UnknownName
        A column that the formula or ``participant`` names is not there.
    BadValue
        A formula or data that statsmodels cannot fit; its message is quoted.
    MissingPackage
        statsmodels is not installed: ``pip install 'stimlib[experiments]'``.

    References
    ----------
    Laird and Ware (1982), Biometrics 38:963; statsmodels' ``MixedLM``.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.experiments import mixed
    >>> person, level = np.repeat(np.arange(6), 8), np.tile(np.arange(8.0), 6)
    >>> noise = np.random.default_rng(1).normal(size=48)
    >>> model = mixed(
    ...     {
    ...         "participant": person,
    ...         "level": level,
    ...         "rating": person + 2 * level + noise,
    ...     },
    ...     "rating ~ level",
    ... )
    >>> [(c.name, round(c.value, 1)) for c in model.coefficients], model.converged
    ([('Intercept', 2.2), ('level', 2.1)], True)
    """
    import warnings

    models = package("statsmodels.regression.mixed_linear_model", "mixed")
    with said_as(BadValue, "mixed", ValueError):
        table = package("pandas", "mixed").DataFrame(columns)
    need("mixed", [participant], table)
    if table[participant].nunique() < 2:
        raise BadValue(
            f"mixed: {participant} has one value: a variance between people needs at least two of"
            " them"
        )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            fit = models.MixedLM.from_formula(
                formula, table, groups=table[participant], missing="drop"
            ).fit()
        except Exception as e:
            if "is not defined" in str(e):
                raise UnknownName(
                    f"mixed: {formula}: {e}; the columns are {', '.join(map(str, table))}"
                ) from None
            raise BadValue(f"mixed: {formula}: {type(e).__name__}: {e}") from e
        # NumPy warns of a variance of 0, which has no standard error
        ends = fit.conf_int()
        fixed = tuple(
            Coefficient(
                n,
                float(v),
                float(fit.bse[n]),
                float(fit.tvalues[n]),
                float(fit.pvalues[n]),
                *map(float, ends.loc[n]),
            )
            for n, v in fit.fe_params.items()
        )
    for one in fixed:
        if not np.isfinite([one.value, one.error]).all():
            raise BadValue(
                f"mixed: {formula}: {one.name} = {one.value:g} with a standard error of"
                f" {one.error:g}; look for values that are too large, too small or all the same"
            )
    bad = not fit.converged or any("ConvergenceWarning" in w.category.__name__ for w in said)
    return Mixed(fixed, float(fit.cov_re.iloc[0, 0]), float(fit.scale), not bad, float(fit.llf))


# What is given ------------------------------------------------------------------------
def _row(what: str, values: ArrayLike, least: int) -> Array:
    row = numbers(what, values)
    if row.ndim != 1 or row.size < least:
        raise BadValue(f"{what}: give a row of at least {least} values, got shape {row.shape}")
    if not np.isfinite(row).all():
        raise BadValue(f"{what}: value {int(np.argmin(np.isfinite(row)))} is not finite")
    _size(what, row)
    return row


def _size(what: str, values: Array) -> None:
    """Raise BadValue if values are too large for sums of their squares."""
    if np.abs(values).max(initial=0.0) > LARGEST:
        raise BadValue(
            f"{what}: a value is larger than {LARGEST:g}, so that sums of squares do not exist;"
            " give the values in another unit"
        )


def _groups(what: str, groups: Mapping[str, ArrayLike]) -> dict[str, Array]:
    if len(groups) < 2:
        raise BadValue(f"{what}: give at least two groups, by name; got {len(groups)}")
    rows = {str(name): _row(f"{what}: {name}", row, 1) for name, row in groups.items()}
    if len(rows) < len(groups):
        raise BadValue(
            f"{what}: groups {', '.join(map(repr, groups))}: two have the same name as text"
        )
    if _same(np.concatenate(list(rows.values()))):
        raise BadValue(f"{what}: all values are the same")
    _spread(what, np.concatenate(list(rows.values())))
    return rows


def _same(values: Array, size: float | None = None) -> bool:
    """Return whether values, computed from numbers up to a size, differ by rounding."""
    return bool(np.ptp(values) <= 1e-14 * (np.abs(values).max() if size is None else size))


def _spread(what: str, values: Array) -> None:
    """Raise BadValue if values differ by less than a float can square."""
    if 0 < np.ptp(values) < 1 / LARGEST:
        raise BadValue(
            f"{what}: values or differences from {values.min():g} to {values.max():g} have no sum"
            " of squares that a float can hold; give them in another unit"
        )
