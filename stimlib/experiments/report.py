"""The report page of an experiment: a self-contained file without scripts."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from ..checks.figures import svg
from ..checks.page import document, esc, facts, items, picture, table
from ..core.units import pretty
from ..errors import UnknownName, need, public, shown
from ..system import safe_files
from ..version import __version__
from .fits import Fit, logarithmic
from .likelihood import FLOOR, numbers
from .tables import Columns, grouped, plain

SHOWN = (
    "pse",
    "pse_interval",
    "jnd",
    "jnd_interval",
    "slope",
    "intercept",
    "lapse",
    "trials",
    "levels",
    "p",
    "dispersion",
    "problems",
)
HEADS = {
    "pse": "{what}",
    "pse_interval": "{what}, interval",
    "jnd": "JND",
    "jnd_interval": "JND, interval",
    "p": "goodness of fit, p",
}
NEEDED = ("participant", "condition", "level", "outcome", "track", "number")
ACROSS = 4  # pictures in a row
STRETCHES = 10  # of the trials of a fit, whose residuals are summed


@public
def write_report(
    path: str | os.PathLike[str],
    title: str,
    method: str,
    columns: Columns,
    *,
    fits: Mapping[tuple[Any, ...], Fit] | None = None,
    by: Sequence[str] = ("participant", "condition"),
    tables: Mapping[str, Iterable[Any]] | None = None,
    notes: Sequence[str] = (),
    unit: str = "",
) -> None:
    """Write a self-contained page with result, method, curves, tracks and tables.

    The result, in sentences, comes first: the mean threshold of each condition with its
    interval, and what is left out of it. The tracks show the levels of staircases. The
    same answers give the same bytes.

    Parameters
    ----------
    path : path
    title : str
    method : str
        How the data were collected and analysed, as in a paper; an empty line separates
        paragraphs.
    columns : dict of str to sequence
        All answers: ``participant``, ``condition``, ``level``, ``outcome``, ``track``,
        ``number``.
    fits : dict, optional
        Result of `stimlib.experiments.tables.fitted` for the same ``by``.
    by : sequence of str
        Columns that the keys of the fits refer to.
    tables : dict of str to results, optional
        By title: sequences of dataclasses, such as those of
        `stimlib.experiments.compare`.
    notes : sequence of str
        Remarks for the reader, such as discrepancies and omissions.
    unit : str
        Unit of the level.

    Raises
    ------
    SinkError
        The file cannot be written.
    UnknownName
        A column is missing, or a fit has no answers.
    BadValue
        Numbers of trials, of which there are fits, that are no numbers.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from stimlib.experiments import fitted, write_report
    >>> answers = {
    ...     "participant": ["P01"] * 60,
    ...     "condition": ["a"] * 60,
    ...     "track": [""] * 60,
    ...     "number": list(range(1, 61)),
    ... }
    >>> answers |= {
    ...     "level": [1.0, 2.0, 3.0] * 20,
    ...     "outcome": [0, 1, 1] * 10 + [0, 0, 1] * 9 + [1, 0, 1],
    ... }
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "report.html"
    ...     write_report(
    ...         path,
    ...         "Springs",
    ...         "Constant stimuli, probit.",
    ...         answers,
    ...         fits=fitted(answers),
    ...         unit="N/mm",
    ...     )
    ...     "PSE" in path.read_text()
    True
    """
    fits = fits or {}
    need("report", NEEDED, columns)
    paragraphs = "".join(f"<p>{esc(text)}</p>" for text in method.split("\n\n"))
    result = _simulated(columns)
    parts = [f"<h2>Method</h2>{paragraphs}", f"<h2>Answers</h2>{facts(_counts(columns))}"]
    if notes:
        parts.append(f"<h2>Notes</h2>{items(notes)}")
    if fits:
        answers = grouped(columns, by)
        if alien := [key for key in fits if key not in answers]:
            raise UnknownName(
                f"report: a fit of {alien[0]!r}, of which there are no answers; by ="
                f" {', '.join(by)}"
            )
        result += _result(fits, by, unit)
        label = f"level / {pretty(unit)}" if unit else "level"
        size = 3.0 * min(ACROSS, len(fits)), 2.5 * -(-len(fits) // ACROSS)
        curves = svg(lambda figure: _curves(figure, fits, label), size)
        residuals = svg(lambda figure: _residuals(figure, fits, answers), size)
        parts += [
            picture("Psychometric functions", curves),
            "<p>A dot is the proportion of answers at one level, the larger the more answers; the"
            " line is the fitted curve, and the bar the interval of its middle.</p>",
            picture("Residuals over time", residuals),
            "<p>Answers minus the curve, summed over stretches of trials in their order, in"
            " standard deviations: a steady participant is within the dotted lines in 19 of"
            " 20.</p>",
        ]
        parts.append(f"<h2>All fits</h2>{table(_fits(fits, by, unit))}")
    if any(columns["track"]) and None not in columns["level"]:
        tracks = grouped(columns, ("participant", "condition"))
        size = 3.0 * min(ACROSS, len(tracks)), 2.0 * -(-len(tracks) // ACROSS)
        parts.append(picture("Staircases", svg(lambda f: _tracks(f, tracks, unit), size)))
        parts.append("<p>Each line is one staircase; a dot is a trial.</p>")
    parts += [f"<h2>{esc(name)}</h2>{table(plain(rows))}" for name, rows in (tables or {}).items()]
    if result:
        parts.insert(0, f"<h2>Result</h2>{items(result)}")
    made = f"stimlib {__version__}, numpy {np.__version__}, scipy {version('scipy')}"
    body = f'<h1>{esc(title)}</h1>{"".join(parts)}<p class="small">Made with {esc(made)}.</p>'
    safe_files.publish(path, document(title, body))


def _label(text: str) -> str:
    """Return a text as a plot label, with $ escaped."""
    return shown(text).replace("$", r"\$")


def _simulated(columns: Columns) -> list[str]:
    """Return a sentence if answers are simulated."""
    given = [bool(v) for v in columns.get("simulated", ())]
    said = "answers are simulated: an observer model gave them, and no participant."
    return [f"{'All' if all(given) else 'Some'} {said}"] if any(given) else []


def _result(fits: Mapping[tuple[Any, ...], Fit], by: Sequence[str], unit: str) -> Iterator[str]:
    """Yield the result in sentences: each condition, its meaning, what is left out."""
    from scipy.stats import t

    groups: dict[str, list[Fit]] = {}
    for key, fit in fits.items():
        where = [str(part) for part, name in zip(key, by, strict=True) if name != "participant"]
        groups.setdefault(" ".join(where) or "All", []).append(fit)
    for name, each in groups.items():
        good = [fit for fit in each if np.isfinite(fit.pse)]
        what, of = each[0].name, f"{len(good)} of {len(each)} fits"
        if not good:
            yield f"{name}: no {what} could be fitted."
            continue
        log = all(fit.log for fit in good)
        x = np.array([math.log(fit.pse) if log else fit.pse for fit in good])
        half = t.ppf(0.975, x.size - 1) * x.std(ddof=1) / math.sqrt(x.size) if x.size > 1 else 0.0
        found = np.array([x.mean(), x.mean() - half, x.mean() + half])
        value, low, high = np.exp(found) if log else found
        if x.size == 1:
            low, high = good[0].pse_interval
        mean = f"{'geometric ' * log}mean " * (x.size > 1)
        yield (
            f"{name}: {mean}{what} {value:.3g}{f' {pretty(unit)}' * bool(unit)},"
            f" {95 if mean else 100 * good[0].confidence:g} % interval {low:.3g} to {high:.3g}"
            f" ({of})."
        )
    for fit in {f.name: f for f in fits.values() if np.isfinite(f.pse)}.values():
        said = "are correct" if fit.guess and not fit.comparison else "say yes, or more"
        yield (
            f"The {fit.name} is the level at which the fitted curve is half-way up, where"
            f" {100 * fit(fit.pse):.0f} % of the answers {said}."
        )
    for key, fit in fits.items():
        left = "Left out" if not np.isfinite(fit.pse) else "To be used with care"
        for text in fit.advice():
            yield f"{left}: {' '.join(map(str, key))}: {text}"


def _counts(columns: Columns) -> dict[str, str]:
    people = list(dict.fromkeys(columns["participant"]))
    trials = [len(rows["level"]) for rows in grouped(columns, ("participant",)).values()]
    return {
        "participants": f"{len(people)}: {', '.join(map(str, people))}",
        "conditions": ", ".join(map(str, dict.fromkeys(columns["condition"]))),
        "trials": (
            f"{sum(trials)}; of a participant {min(trials, default=0)} to {max(trials, default=0)}"
        ),
    }


def _fits(
    fits: Mapping[tuple[Any, ...], Fit], by: Sequence[str], unit: str
) -> list[dict[str, Any]]:
    """Return a row for each fit.

    On a logarithmic axis, the JND is a fraction of the PSE and has no unit.
    """
    what = " or ".join(dict.fromkeys(fit.name for fit in fits.values()))
    in_unit = f" / {pretty(unit)}" if unit else ""
    logs = any(fit.log for fit in fits.values())
    heads = {name: HEADS.get(name, name.replace("_", " ")).format(what=what) for name in SHOWN}
    heads["slope"] += f" of the {next(iter(fits.values())).link}, per " + (
        "decade" if logs else pretty(unit) or "unit"
    )
    for name in set(HEADS) - {"p"}:
        heads[name] += f", part of the {what}" if logs and name.startswith("jnd") else in_unit
    return [
        dict(zip(by, key, strict=True)) | {heads[name]: getattr(fit, name) for name in SHOWN}
        for key, fit in fits.items()
    ]


# Pictures -----------------------------------------------------------------------------
def _axes(figure: Any, n: int) -> Any:
    across = min(ACROSS, n)
    axes = figure.subplots(-(-n // across), across, squeeze=False, sharex=True, sharey=True).flat
    for ax in axes[n:]:
        ax.set_axis_off()
    return axes[:n]


def _curves(figure: Any, fits: Mapping[tuple, Fit], label: str) -> None:
    """Draw each fit with its answers and the confidence interval of its midpoint."""
    for ax, (key, fit) in zip(_axes(figure, len(fits)), fits.items(), strict=True):
        fit.draw(ax)
        ax.set_title(
            _label(
                " ".join(map(str, key)) + (f" ({', '.join(fit.problems)})" if fit.problems else "")
            )
        )
    figure.supxlabel(_label(label))
    # a comparison has a guess rate, too, that of its lapses
    detections = all(fit.guess and not fit.comparison for fit in fits.values())
    figure.supylabel("proportion correct" if detections else "proportion of more")


def _residuals(figure: Any, fits: Mapping[tuple, Fit], answers: Mapping[tuple, Columns]) -> None:
    """Draw how far the answers are from each curve, over the trials."""
    for ax, (key, fit) in zip(_axes(figure, len(fits)), fits.items(), strict=True):
        rows = answers[key]
        by = [numbers(f"report: {k}", rows[k]) for k in ("number", "session") if k in rows]
        order = np.lexsort(by)  # numbers begin anew in each session
        # where the curve has reached 0 or 1, the deviation of nothing is 0
        p = np.clip(fit(np.asarray(rows["level"], float)[order]), FLOOR, 1 - FLOOR)
        left = np.asarray(rows["outcome"], float)[order] - p
        stretches = np.array_split(np.arange(order.size), min(STRETCHES, order.size))
        sums = [np.sum(left[at]) / np.sqrt(np.sum((p * (1 - p))[at])) for at in stretches]
        ax.plot([1 + at.mean() for at in stretches], sums, "o-", ms=3)
        for edge in (-1.96, 1.96):
            ax.axhline(edge, lw=0.7, ls=":", color="0.5")
        ax.set_title(_label(" ".join(map(str, key))))
        ax.grid(alpha=0.3)
    figure.supxlabel("trial")
    figure.supylabel("residual / standard deviation")


def _tracks(figure: Any, tracks: Mapping[tuple, Columns], unit: str) -> None:
    """Draw the levels over trials, with a line for each staircase."""
    for ax, (key, rows) in zip(_axes(figure, len(tracks)), tracks.items(), strict=True):
        for one in grouped(rows, [k for k in ("session", "track") if k in rows]).values():
            ax.plot(one["number"], one["level"], ".-", ms=3, lw=0.7)
        if min(map(float, rows["level"])) > 0:
            logarithmic(ax.yaxis, ax.set_yscale)
        ax.set_title(_label(" ".join(map(str, key))))
        ax.grid(alpha=0.3)
    figure.supxlabel("trial")
    figure.supylabel(_label(f"level / {pretty(unit)}" if unit else "level"))
