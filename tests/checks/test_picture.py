"""Pictures of a rendering: nothing hides anything, units do not share an axis, and a
wrong rendering leaves the band; and copies of it to listen to.
"""

import dataclasses as dc
import io
from base64 import b64decode

import matplotlib
import numpy as np
import pytest
from laws import mostly
from matplotlib.figure import Figure
from matplotlib.image import imread
from refusals import refused

import stimlib
from stimlib.analysis.listening import CUTOFF, listen, vibration
from stimlib.analysis.overview import (
    Against,
    Signals,
    against,
    close_by,
    cut_from,
    figure,
    heights,
    over_time,
    picture,
    rows_of,
)
from stimlib.blocks import enabled, white_noise
from stimlib.checks.figures import svg
from stimlib.errors import BadValue, UnknownName, counted
from stimlib.files import audio
from stimlib.motion.generators import constant_speed, minimum_jerk

FS = 2000
X, Z, CONTACT = stimlib.Input("x", "m"), stimlib.Input("z", "m"), stimlib.Input("contact")
K = stimlib.constant(1000.0, "N/m")
SCENE = stimlib.Scene(
    {"thumb": K * X * CONTACT, "index": K * Z, "noise": stimlib.blocks.white_noise(1)}
)
T = np.arange(FS) / FS
SAME = {"x": 0.01 * T, "z": 0.01 * T, "contact": 1.0 * (T > 0.1)}


def signals(motion):
    r = stimlib.render(SCENE, motion, FS, target="python")
    return Signals(SCENE, FS, r.motion, {n: r[n] for n in r.outputs})


def labels(fig):
    return [" ".join(ax.get_ylabel().split()) for ax in fig.axes if ax.axison]


@pytest.mark.parametrize(
    ("motion", "inputs"),
    [(SAME, ["x = z", "contact"]), (SAME | {"z": 0.02 * T}, ["x", "z", "contact"])],
)
def test_signals_share_a_panel_only_where_they_are_the_same_or_alike(motion, inputs):
    fig = Figure()
    over_time(fig, rows_of(signals(motion)), FS)
    assert all(len(ax.lines) <= 2 for ax in fig.axes)
    assert labels(fig) == [*inputs, "thumb", "index", "noise"]


def test_every_finger_is_drawn_over_its_own_position():
    fig = Figure()
    close_by(fig, signals(SAME | {"z": 0.02 * T}), {})
    over = [ax for ax in fig.axes if "over position" in ax.get_title()]
    assert [(ax.get_title(), ax.get_ylabel()) for ax in over] == [
        ("over position, x", "thumb"),
        ("over position, z", "index"),
    ]
    assert [np.nanmax([line.get_xdata() for line in ax.lines]) for ax in over] == pytest.approx(
        [0.01, 0.02], rel=1e-2
    )


def test_the_close_up_is_where_it_vibrates_most_and_each_way_has_its_curve():
    there = 0.005 * (1 - np.cos(2 * np.pi * T))  # there for half a second, and back
    burst = 1e-4 * np.sin(2 * np.pi * 100 * T) * np.exp(-(((T - 0.7) / 0.05) ** 2))
    fig = Figure()
    close_by(
        fig,
        Signals(
            stimlib.Scene({"force": K * X}), FS, {"x": there}, {"force": 1000 * (there + burst)}
        ),
        {},
    )
    t, y = fig.axes[0].lines[0].get_data()
    assert t[np.abs(y).argmax()] == pytest.approx(0.7, abs=0.01) and np.ptp(t) == pytest.approx(
        0.06, rel=0.05
    )
    seen = {line.get_label(): np.isfinite(line.get_ydata()) for line in fig.axes[1].lines}
    for way, part in (("forwards", slice(10, 990)), ("back, or held", slice(1030, None))):
        assert seen[way][part].all() and seen[way].sum() <= part.indices(FS)[1] - part.start + 40


@pytest.mark.parametrize(
    ("y", "panels"),
    [
        (np.maximum(T - 0.3, 0.0), False),  # a corner, as of the contact with a wall
        (1.0 * (T > 0.3), True),
        (40 * T + 4e-3 * np.sin(2 * np.pi * 50 * T), True),
        (40 * T + 4e-3 * np.sin(2 * np.pi * 300 * T), True),
        (40 * T + 1e-9 * np.random.default_rng(0).normal(size=FS), False),
        (0.0 * T, False),
    ],
    ids=["corner", "step", "50 Hz", "300 Hz", "rounding", "silence"],
)
def test_vibration_has_a_panel_where_something_vibrates(y, panels):
    fig = Figure()
    close_by(fig, Signals(stimlib.Scene({"force": K * X}), FS, {"x": T}, {"force": y}), {})
    titles = ["vibration, where it is largest", "over position, x", "spectrum of force"]
    assert [ax.get_title() for ax in fig.axes] == titles[not panels :]


def test_an_output_is_drawn_over_the_input_that_its_name_begins_with():
    scene = stimlib.Scene({"x10_force": stimlib.Input("x1", "m") + stimlib.Input("x10", "m")})
    assert Signals(scene, FS, {}, {}).over("x10_force") == "x10"


def test_an_input_that_comes_out_again_is_drawn_once_and_an_angle_is_a_position():
    angle, press = stimlib.Input("angle", "rad"), stimlib.Input("press")
    scene = stimlib.Scene({"same": X + 0, "torque": angle * 2, "force": press * 3})
    r = stimlib.render(scene, {"x": T, "angle": 2 * T, "press": 3 * T}, FS, target="python")
    fig = figure(r)
    rows = ["x = same", "angle", "press", "torque", "force"]
    assert [ax.get_ylabel() for ax in fig.axes[:5]] == rows
    titles = ["over position, angle", "spectrum of torque", "over press", "spectrum of force"]
    assert [ax.get_title() for ax in fig.axes[5:]] == titles
    assert fig.get_suptitle() == "2000 Hz"
    w = stimlib.Param("w", 158.04, "rad/s") * stimlib.Param("A", 1.0)
    w *= stimlib.Param("B", 1.0, "1")
    fig = figure(stimlib.render(stimlib.Scene({"_y1": w, "_y2": 2 * w}), {}, FS, 0.1))
    assert fig.get_suptitle() == "w = 158.04 rad/s, A = 1, B = 1, 2000 Hz"
    assert [t.get_text().strip() for t in fig.axes[0].get_legend().get_texts()] == ["_y1", "_y2"]


def test_no_text_of_a_panel_meets_another_panel():
    scene = stimlib.Scene({"force_of_the_thumb": -K * X})  # down to -500 mN
    fig = figure(
        stimlib.render(scene, {"x": 5e-4 * T + 1e-5 * np.sin(600 * T)}, FS, target="python")
    )
    fig.draw_without_rendering()
    names = [name.removeprefix("force_of_the_thumb") for name in labels(fig)]
    assert names == ["x", "", *3 * [", above 40 Hz"], "PSD / N²/Hz"]
    for ax in fig.axes:
        texts = [
            ax.xaxis.label,
            ax.yaxis.label,
            ax.title,
            *ax.get_xticklabels(),
            *ax.get_yticklabels(),
        ]
        for other in fig.axes:
            frame = other.get_window_extent().padded(3)  # pixels
            assert other is ax or not any(
                text.get_window_extent().overlaps(frame) for text in texts if text.get_text()
            )


def test_a_squeeze_shows_its_vibration_and_no_two_panels_of_one_kind():
    """Two fingers are two lines of a panel; 1 N in 40 N is seen where it is alone."""
    motion = {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.015)}
    fig = figure(stimlib.render(stimlib.scenes.squeeze(), motion, 4 * FS, seconds=1.0))
    names = labels(fig)
    fast = ["force1, above 40 Hz", "force2, above 40 Hz"]
    assert names[:4] == ["x1, x2", "force1, force2", *fast]
    assert [n for n in names[4:] if "PSD" not in n] == [fast[0]] * 2 + [fast[1]] * 2
    assert len({line.get_linestyle() for line in fig.axes[0].lines}) == 2
    assert [t.get_text() for t in fig.axes[1].get_legend().get_texts()] == ["force1", "force2"]


@pytest.mark.parametrize(
    ("many", "name", "panels", "said"),
    [
        (7, "tactor{}", [4, 3], []),
        (12, "tactor{}", [4] * 3, []),
        (13, "tactor{}", [4, 4, 4, 1], ["13 of 13 outputs over time, 12 in detail"]),
        (64, "tactor{}", [4] * 11, ["44 of 64 outputs over time, 12 in detail"]),
        (13, "t{}_left", [1] * 11, ["11 of 13 outputs over time, 12 in detail"]),
    ],
)
def test_an_array_has_panels_that_can_be_read_and_says_what_is_left_out(many, name, panels, said):
    """A legend higher than its panel makes matplotlib give up: nothing is seen."""
    outputs = {name.format(k): (k + 1) * T for k in range(many)}
    scene = stimlib.Scene({output: K * X for output in outputs})
    s = Signals(scene, FS, {"x": T}, outputs)
    fig = Figure(figsize=(12, heights(s)[0]), layout="constrained")
    rows = rows_of(s)
    over_time(fig, rows, FS)
    fig.draw_without_rendering()
    assert [len(ax.lines) for ax in fig.axes] == [1, *panels]
    for ax in fig.axes:
        assert len({line.get_linestyle() for line in ax.lines}) == len(ax.lines)
        assert ax.get_window_extent().height > 0.8 * fig.dpi
    assert cut_from(s, rows) == said


@pytest.mark.parametrize(
    ("drawn", "titles"),
    [
        (lambda x: np.sin(5e4 * x), ["over position, x, a tenth of it"]),  # ridges
        (lambda x: np.random.default_rng(1).normal(size=x.size), []),
        (lambda x: 40 * x, ["over position, x"]),
    ],
    ids=["ridges", "noise", "spring"],
)
def test_over_position_a_filled_area_is_enlarged_or_left_out(drawn, titles):
    x, fig = 0.03 * np.sin(2 * np.pi * np.arange(8 * FS) / FS) - 1e-3, Figure()
    close_by(fig, Signals(stimlib.Scene({"force": K * X}), FS, {"x": x}, {"force": drawn(x)}), {})
    assert [ax.get_title() for ax in fig.axes if "over" in ax.get_title()] == titles


def test_over_position_a_long_rendering_keeps_its_peaks():
    x = 0.01 * np.sin(np.pi * np.arange(40 * FS) / FS)
    y, fig = 1000 * x + 0.3 * np.sin(50 * np.pi * np.arange(40 * FS) / FS), Figure()
    y[4321] = 99.0
    close_by(fig, Signals(stimlib.Scene({"force": K * X}), FS, {"x": x}, {"force": y}), {})
    drawn = np.concatenate([line.get_ydata() for line in fig.axes[-2].lines])
    assert np.nanmax(drawn) == 99.0 and np.nanmin(drawn) == y.min() and drawn.size < 15000


@pytest.mark.parametrize(
    ("y", "x", "unit"),
    [
        (K * X, 2e-3 * T, "N"),
        (K * X, 2e-6 * T, "mN"),
        (X * X, 0.05 * T, "m²"),  # 1 mm² is not 0.001 m²
        (1 / (X + stimlib.constant(1e-4, "m")), T, "m⁻¹"),
        (K * X, 1e-3 + 1e-9 * T, "N"),  # with as many digits as tell them apart
    ],
)
def test_the_labels_of_an_axis_are_its_values_and_have_one_prefix(y, x, unit):
    fig = figure(stimlib.render(stimlib.Scene({"y": y}), {"x": x}, FS, target="python"))
    fig.draw_without_rendering()
    axis = fig.axes[1].yaxis
    ticks = [t.get_text().replace("\N{MINUS SIGN}", "-") for t in axis.get_ticklabels()]
    assert {tick.partition(" ")[2] for tick in ticks if tick != "0"} == {unit}
    values = [float(tick.partition(" ")[0]) * (1e-3 if unit == "mN" else 1) for tick in ticks]
    np.testing.assert_allclose(values, axis.get_ticklocs(), rtol=1e-11, atol=1e-300)


@pytest.mark.parametrize(("width", "band"), [(1e-6, []), (0.5, ["correct"])])
def test_the_legend_has_the_band_only_where_it_can_be_seen(width, band):
    f, ax = np.arange(1.0, 300.0), Figure().subplots()
    law = 1e-6 / f
    against(ax, Against("", "N", f, 2 * law, law, law * (1 - width), law * (1 + width)))
    shown = [text.get_text() for text in ax.get_legend().get_texts()]
    drawn = {line.get_label(): line.get_ydata() for line in ax.lines}
    assert shown == [*band, "rendered", "law"]
    assert np.array_equal(drawn["law"], law) and np.array_equal(drawn["rendered"], 2 * law)


def test_one_sample_and_a_scene_without_inputs_have_a_picture(tmp_path):
    noise = stimlib.Scene({"noise": stimlib.blocks.white_noise(1)})
    picture(stimlib.render(noise, {}, FS, 1 / FS, target="python"), tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("scene", "motion", "output"),
    [
        (stimlib.scenes.bumps(), {"x": constant_speed(0.1, 0.1)}, "voltage"),
        (stimlib.scenes.viscoelastic(), {"y": minimum_jerk(depth=0.01)}, "force"),
    ],
    ids=["bumps", "viscoelastic"],
)
def test_a_correct_rendering_lies_within_the_band_and_a_wrong_one_does_not(scene, motion, output):
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, FS, seconds=1.0))
    a = report.spectra()[output]
    assert ((a.low <= a.measured) & (a.measured <= a.high)).all()
    wrong = dc.replace(report, evidence=dc.replace(report.evidence, y=report.evidence.y * 1.001))
    b = wrong.spectra()[output]
    assert (b.measured > b.high).any()


ONE = stimlib.constant(1.0, "m")
ODD = {  # an output of x, and x
    "silence": (0.0 * X, np.linspace(0, 1, 400)),
    "a fault": (1.0 / (X / ONE - 0.5), np.linspace(0, 1, 401)),
    "one sample": (K * X, np.ones(1)),
    "a gated noise": (enabled(white_noise(1), by=X), np.ones(400)),
    "squares that are too large": (1e305 * X, np.linspace(0, 1, 400)),
}


@pytest.mark.parametrize("name", mostly(["a fault", "one sample", "a gated noise"], ODD))
def test_odd_signals_have_a_page_and_a_picture(name, tmp_path):
    y, x = ODD[name]
    scene = stimlib.Scene({"y": y})
    r = stimlib.render(scene, {"x": x}, FS, on_fault="ignore", target="python")
    report = stimlib.verify(scene, {"x": x}, r)
    assert report.passed == (name != "a fault") and set(report.spectra()) <= {"y"}
    assert all(a.unit == f"{scene.outputs['y'].dim}" for a in report.spectra().values())
    report.to_html(tmp_path / "a.html")
    picture(r, tmp_path / "a.png", report.spectra())
    data = (tmp_path / "a.png").read_bytes()
    assert data.startswith(b"\x89PNG") and len(data) > 10_000
    page = (tmp_path / "a.html").read_text("utf-8")
    assert (
        "</html>" in page
        and f"{counted(x.size, 'sample')} at" in page
        and "How to reproduce it" in page
    )


# Copies to listen to: the vibration alone, and loud enough ----------------------------
LOUD = stimlib.Scene({"force": K * X, "still": 0 * X})
TIME = np.arange(2 * FS) / FS
TONE = 1e-5 * np.sin(2 * np.pi * 150 * TIME)


def test_what_is_written_does_not_depend_on_the_style_of_the_user(tmp_path):
    r = stimlib.render(SCENE, SAME, FS, target="python", seconds=0.1)
    pictures, pages, path = [], [], tmp_path / "a.png"
    own = {"font.size": 33, "axes.facecolor": "black", "savefig.bbox": "tight", "text.color": "red"}
    for style in {}, own:
        with matplotlib.rc_context(style):
            picture(r, path)
            shown = b64decode(r._repr_html_().partition("base64,")[2].partition('"')[0])
            pictures += [imread(path), imread(io.BytesIO(shown))]
            pages.append(svg(lambda fig: fig.subplots().plot([0, 1]), (4, 3)))
    assert pages[0] == pages[1]
    for before, after in (pictures[::2], pictures[1::2]):
        assert np.abs(before - after).max() <= 1.5 / 255  # as drawn twice in one style


@pytest.fixture
def heard():
    return stimlib.render(LOUD, {"x": 0.02 * TIME + TONE}, FS, target="python")


def test_a_tone_on_a_ramp_becomes_the_tone_alone_at_half_scale(heard, tmp_path):
    y, sidecar = audio.read(listen(heard, "force", tmp_path / "force-listen.wav").path)
    middle = slice(200, -200)
    assert np.abs(y[0] - 1000 * TONE)[middle].max() < 1e-4  # of 0.01 N on 40 N
    # -6 dBFS
    assert np.abs(y).max() / sidecar["channels"][0]["full_scale"] == pytest.approx(0.5, rel=1e-6)
    ramp = np.minimum(np.arange(1, TIME.size + 1) / (0.01 * FS), 1.0)  # or it would click
    whole = vibration(heard["force"], FS)
    np.testing.assert_allclose(y[0], ramp * ramp[::-1] * whole, rtol=0, atol=1e-6 * np.abs(y).max())


def test_a_copy_is_not_verified_as_the_stimulus(heard, tmp_path):
    listen(heard, "force", tmp_path / "a.wav")
    refused(
        BadValue,
        "another scene",
        stimlib.verify,
        LOUD,
        {"x": 0.02 * TIME + TONE},
        tmp_path / "a.wav",
    )


@pytest.mark.parametrize(
    ("error", "says", "name", "cutoff"),
    [
        (BadValue, "still has nothing above", "still", CUTOFF),
        (UnknownName, "there are force, still", "x", CUTOFF),
        (BadValue, "cutoff = .*below fs/2", "force", 0),
        (BadValue, "cutoff = .*below fs/2", "force", FS / 2),
        (BadValue, "cutoff = .*not finite", "force", float("nan")),
    ],
)
def test_what_cannot_be_heard_is_refused_and_nothing_is_written(
    heard, tmp_path, error, says, name, cutoff
):
    refused(error, says, listen, heard, name, tmp_path / "a.wav", cutoff)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("y", "left"), [([1.0, 2.0, 3.0], [0, 0, 0]), ([0.0, 1.0, 0.0], [-1 / 3, 2 / 3, -1 / 3])]
)
def test_a_signal_of_a_few_samples_loses_its_straight_line(y, left):
    np.testing.assert_allclose(vibration(y, 8000), left, atol=1e-12)


def test_a_signal_that_starts_with_vibration_has_no_transient():
    pulses = np.maximum(np.sin(2 * np.pi * 158 * np.arange(8000) / 8000), 0)  # as of bumps
    v = np.abs(vibration(pulses, 8000))
    assert v[:400].max() < 1.1 * v[2000:6000].max()


def test_the_amplitude_is_halved_at_the_cutoff():
    t = np.arange(8000) / 8000
    for f, gain in ((20, 0.004), (40, 0.5), (80, 0.996)):
        assert np.abs(vibration(np.sin(2 * np.pi * f * t), 8000))[2000:6000].max() == pytest.approx(
            gain, abs=0.005
        )
