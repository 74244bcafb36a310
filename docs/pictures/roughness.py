"""Figure 5.1 of the touch-screen thesis, for ten simulated people: python
docs/pictures/roughness.py writes roughness_boxes.svg beside it.
"""

from pathlib import Path

from matplotlib.figure import Figure

from stimlib.experiments import simulate, stream
from stimlib.experiments.papers.roughness import FACTORS, person, ratings, roughness

PARTS = "whislo", "q1", "med", "q3", "whishi"


def boxes() -> Figure:
    """Ratings of both scales by factor and level."""
    people = {f"P{n:02}": person(stream(n, "person")) for n in range(1, 11)}
    answers = simulate(roughness(), people, list(people), seed=1, progress=False)
    figure = Figure((8.5, 4.5), layout="constrained")
    for row, (scale, question) in enumerate((("roughness", "outcome"), ("bumpiness", "bumpiness"))):
        found = ratings(answers, question).boxes
        for column, (factor, levels) in enumerate(FACTORS.items()):
            axes = figure.add_subplot(2, 4, 4 * row + column + 1)
            axes.bxp(
                [dict(zip(PARTS, found[factor, str(level)], strict=True)) for level in levels],
                showfliers=False,
            )
            axes.set_xticks([1, 2, 3], [str(level) for level in levels])
            axes.tick_params(labelsize=8)
            axes.set(ylim=(0.8, 7.2), xlabel=factor + (", V" if factor == "amplitude" else ""))
            if column == 0:
                axes.set_ylabel(scale)
    return figure


if __name__ == "__main__":
    path = Path(__file__).with_name("roughness_boxes.svg")
    boxes().savefig(path, metadata={"Date": None})
