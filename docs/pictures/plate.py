"""The pictures of the page on plates: python docs/pictures/plate.py writes plate_*
beside it.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stimlib.plate import CONFIGURATIONS, Plate, envelope_behind

PRINTED = {"all": (378, 776, 1171), "long": (307, 410, 651), "short": (158, 244, 541)}
MEASURED = (158, 246, 548)
# told apart by people who do not see red and green as others do (Okabe and Ito)
COLOURS = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7"


def modes() -> Figure:
    """Shapes of the lowest six modes, clamped along the short edges."""
    plate, figure = Plate.paper(measured=True), Figure((8.5, 4.6), layout="constrained")
    figure.supxlabel("along the length / mm", fontsize=10)
    figure.supylabel("along the width / mm", fontsize=10)
    x, y = np.linspace(0, plate.length, 81), np.linspace(0, plate.width, 61)
    for k, axes in enumerate(figure.subplots(2, 3).ravel()):
        z = plate.shape(k, x, y[:, None])
        axes.contourf(1e3 * x, 1e3 * y, z / abs(z).max(), np.linspace(-1, 1, 17), cmap="RdBu_r")
        axes.contour(1e3 * x, 1e3 * y, z, [0.0], colors="k", linewidths=0.6)
        for p in plate.patches:
            x0, x1, y0, y1 = (1e3 * v for v in p.rectangle())
            axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], "k", lw=0.8)
        axes.set(title=f"{plate.modes(6)[k]:.1f} Hz", aspect="equal")
    return figure


def envelopes() -> Figure:
    """20 bumps a second: wanted, and what the plate gives before and after the swap;
    the voltages.
    """
    figure = Figure((8.5, 3), layout="constrained")
    left, right = figure.subplots(1, 2)
    u = np.arange(2048) / 2048 * 50
    for color, (gain, text) in zip(
        COLOURS, ((1, "without pole swap"), (4, "with pole swap, gain 4")), strict=False
    ):
        answer = envelope_behind(158.0, 10.0, 20.0, gain)
        left.plot(u, answer.got, color=color, label=text)
        right.plot(u, answer.voltage, color=color, label=text)
    left.plot(u, answer.wanted, "k:", label="wanted")
    left.set(xlabel="time / ms", ylabel="largest wanted = 1", title="envelope of the displacement")
    right.set(
        xlabel="time / ms", ylabel="largest without pole swap = 1", title="envelope of the voltage"
    )
    left.legend()
    return figure


def residuals() -> Figure:
    """The model from table 2.1, over what is printed in table 2.2 and measured in
    figure 2.6.
    """
    figure = Figure((8.5, 3), layout="constrained")
    axes = figure.subplots()
    rows = {
        f"{name} edges clamped, printed": (Plate.paper(name), want)
        for name, want in PRINTED.items()
    }
    rows |= {
        "measured": (Plate.paper(), MEASURED),
        "measured, frame and stiffness fitted": (Plate.paper(measured=True), MEASURED),
    }
    for row, (text, (plate, want)) in enumerate(rows.items()):
        ours = plate.modes(4)[[0, 1, 3 if plate.edges == "CFCF" else 2]]
        axes.bar(
            np.arange(3) + 0.16 * (row - 2),
            100 * (ours / want - 1),
            0.15,
            color=COLOURS[row],
            label=text,
        )
    axes.axhline(0, color="k", lw=0.6)
    axes.set_xticks(range(3), ["first mode", "second mode", "third mode"])
    axes.set(ylabel="model over thesis / %")
    axes.legend(title="the thesis' frequencies:", fontsize=8, title_fontsize=8)
    return figure


def configurations() -> Figure:
    """Figure 2.3 of the thesis, for the places that we assume: the centre for 50 V peak
    to peak at three resonances.
    """
    figure = Figure((8.5, 3), layout="constrained")
    axes = figure.subplots()
    for k, (mode, text) in enumerate(((0, "first resonance"), (1, "second"), (3, "third"))):
        for n, name in enumerate(CONFIGURATIONS):
            plate = Plate.paper(patches=name)
            centre = plate.length / 2, plate.width / 2
            size = 25e6 * abs(plate.frf("patches", centre, plate.modes(4)[mode]))
            axes.bar(
                n + 0.25 * (k - 1), size, 0.23, color=COLOURS[k], label=text if n == 0 else None
            )
    axes.set_xticks(range(len(CONFIGURATIONS)), CONFIGURATIONS)
    axes.set(ylabel="centre moves / µm", title="50 V peak to peak at the resonances")
    axes.set(xlabel="configuration of the patches")
    axes.legend(fontsize=9)
    return figure


if __name__ == "__main__":
    for make in (envelopes, residuals, configurations):
        make().savefig(
            Path(__file__).with_name(f"plate_{make.__name__}.svg"), metadata={"Date": None}
        )
    modes().savefig(Path(__file__).with_name("plate_modes.png"), dpi=90)
