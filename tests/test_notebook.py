"""What a notebook does with scenes, renderings, plans and reports."""

import dataclasses as dc
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refused

import stimlib
from stimlib import Input, MissingPackage, Param, Scene
from stimlib.checks.evidence import Check
from stimlib.errors import FaultError, UnknownName
from stimlib.files import audio

x = Input("x", "m")
SCENE = Scene({"force": Param("k", 500.0, "N/m") * x, "place": 2 * x})
MOTION = {"x": lambda t: 0.01 * np.sin(2 * np.pi * 5 * t)}


@pytest.fixture(scope="module")
def r():
    return stimlib.render(SCENE, MOTION, 1000, 12.0, {"k": 300.0}, seed=7)


def test_each_shows_itself(r):
    scene, rendering = SCENE._repr_html_(), r._repr_html_()
    assert (
        "Scene(x [m], k [N/m] -&gt; force [N], place [m])" in scene
        and "data:image/svg+xml;base64," in scene
    )
    assert (
        "Rendering(force, place: 12 s at 1000 Hz) (the first 10 s)" in rendering
        and "data:image/png;base64," in rendering
    )
    plan = stimlib.compile(SCENE, 1000, "python").plan
    assert "500" in plan._repr_html_() and "&lt;-" in plan._repr_html_()
    report = stimlib.verify(SCENE, MOTION, r)
    rows = 1 + len(report.checks) + len({c.group for c in report.checks})
    assert ": passed</h4>" in report._repr_html_() and report._repr_html_().count("<tr>") == rows
    odd = dc.replace(report, checks=[Check("e", "odd", np.inf, 0, "no number of JSON")]).to_dict()
    assert (
        not odd["passed"]
        and odd["checks"][0]["measured"] is None
        and odd["checks"][0]["limit"] == 0.0
    )
    assert not any(
        "<script" in page or "<style" in page for page in (scene, rendering, report._repr_html_())
    )
    assert stimlib.draw(SCENE)._repr_svg_() == stimlib.draw(SCENE).svg


def test_a_graph_that_is_too_large_is_told_in_words():
    y = x
    for _ in range(250):
        y = abs(y) + x
    page = Scene({"y": y})._repr_html_()
    assert "more than a picture can show" in page and "<img" not in page


def test_a_fault_is_seen():
    broken = stimlib.render(Scene({"y": 1.0 / x}), {"x": np.zeros(5)}, 1000, on_fault="ignore")
    assert "FAULT: y from sample 0 on" in broken._repr_html_()


def test_plot_has_what_was_rendered(r):
    # of one name the first: over time
    panels = {ax.get_ylabel(): ax for ax in reversed(r.plot().axes)}
    for name, y in {"x": MOTION["x"](r.t), "force": r["force"], "place": r["place"]}.items():
        drawn = panels[name].lines[0].get_ydata()  # least and largest of each stretch
        assert (drawn.min(), drawn.max()) == (y.min(), y.max())
    f, S = panels["PSD / N²/Hz"].lines[0].get_data()
    assert f[np.argmax(S)] == pytest.approx(5, abs=0.3)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_so_few_samples_are_a_picture_too(n):
    assert stimlib.render(Scene({"y": x}), {"x": np.ones(n)}, 1000).plot().axes


@pytest.mark.parametrize("name", ["a.wav", "a.flac"])
def test_save_writes_the_bytes_that_the_file_sink_writes(tmp_path, r, name):
    full_scale = {"force": 4.0, "place": 0.5}
    r.save(tmp_path / f"saved.{name}", full_scale=full_scale)
    proc = stimlib.compile(SCENE, 1000, seed=7)
    proc.set("k", 300.0, ramp=0.0)
    audio.write(tmp_path / f"written.{name}", proc, MOTION, 12.0, full_scale=full_scale)
    for suffix in ("", ".json"):
        assert (tmp_path / f"saved.{name}{suffix}").read_bytes() == (
            tmp_path / f"written.{name}{suffix}"
        ).read_bytes()


def test_a_rendering_with_a_fault_is_not_saved(tmp_path):
    broken = stimlib.render(
        Scene({"y": 1.0 / (x - stimlib.constant(1.0, "m"))}),
        {"x": np.arange(5.0)},
        1000,
        on_fault="ignore",
    )
    refused(
        FaultError,
        r"output y was not finite at sample 1 .*a.wav was not written",
        broken.save,
        tmp_path / "a.wav",
    )
    assert not list(tmp_path.iterdir())


def test_save_keeps_what_is_in_memory(tmp_path, r):
    """Were it rendered again, a motion that has changed since would change the file."""
    ramp = np.arange(100.0)
    rendering = stimlib.render(Scene({"y": x}), {"x": ramp}, 1000)
    ramp[:] = 0.0
    rendering.save(tmp_path / "a.wav", subtype="DOUBLE")
    np.testing.assert_array_equal(audio.read(tmp_path / "a.wav")[0], [np.arange(100.0)])


# Packages that stimlib does not depend on ---------------------------------------------
@pytest.mark.parametrize(
    ("package", "take"),
    [("xarray", "to_xarray"), ("pandas", "to_pandas"), ("ipython", "audio")],
    ids=lambda v: v,
)
def test_what_is_not_installed_says_how_to_get_it(monkeypatch, r, package, take):
    monkeypatch.setitem(sys.modules, {"ipython": "IPython.display"}.get(package, package), None)
    refused(
        MissingPackage,
        f"{take} needs the package {package}, .*: pip install "
        + ("'stimlib.experiments.'$" if package == "pandas" else f"{package}$"),
        getattr(r, take),
    )


def test_what_they_are_given(monkeypatch, r):
    """Where they are not installed the two tests below are skipped."""
    frame = SimpleNamespace(attrs={})
    pandas = SimpleNamespace(
        Index=lambda t, name: (name, t),
        DataFrame=lambda y, index: frame.__dict__.update(y=y, index=index) or frame,
    )
    monkeypatch.setitem(sys.modules, "pandas", pandas)
    monkeypatch.setitem(sys.modules, "xarray", SimpleNamespace(Dataset=lambda *given: given))
    variables, coordinates, facts = r.to_xarray()
    assert (
        list(variables) == list(r.to_pandas().y) == ["force", "place"]
        and facts["params"] == '{"k": 300.0}'
    )
    assert variables["force"][::2] == ("time", {"units": "N"}) and frame.attrs == {
        "units": {"force": "N", "place": "m"}
    }
    for found, wanted in (
        (variables["force"][1], r["force"]),
        (frame.y["force"], r["force"]),
        (frame.index[1], r.t),
    ):
        np.testing.assert_array_equal(found, wanted)
        assert not np.shares_memory(found, r.y)
    np.testing.assert_array_equal(coordinates["time"][1], r.t)


def test_xarray_has_units_and_what_made_it(r):
    xarray = pytest.importorskip("xarray")
    data = r.to_xarray()
    assert (
        isinstance(data, xarray.Dataset)
        and data["force"].attrs == {"units": "N"}
        and data["time"].attrs == {"units": "s"}
    )
    assert data.attrs == {
        "fs": 1000.0,
        "seed": "7",
        "params": '{"k": 300.0}',
        "scene_hash": SCENE.hash,
    }
    np.testing.assert_array_equal(data["place"].sel(time=slice(1.0, 1.1)), r["place"][1000:1101])


def test_pandas_has_units(r):
    pytest.importorskip("pandas")
    data = r.to_pandas()
    assert (
        list(data) == ["force", "place"]
        and data.index.name == "time"
        and data.attrs == {"units": {"force": "N", "place": "m"}}
    )
    np.testing.assert_array_equal(data["force"], r["force"])
    data["force"] = 0.0
    assert r["force"].any()


def test_audio_is_one_output_scaled(monkeypatch, r):
    given = {}
    display = SimpleNamespace(Audio=lambda data, **options: given.update(options, data=data))
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(display=display))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    r.audio("place")
    assert np.abs(given["data"]).max() == 1.0 and (given["rate"], given["normalize"]) == (
        1000,
        False,
    )
    np.testing.assert_allclose(given["data"] * np.abs(r["place"]).max(), r["place"], rtol=1e-15)
    stimlib.render(Scene({"y": 0 * x}), MOTION, 1000, 0.1).audio()
    assert not given["data"].any()
    refused(UnknownName, "no output 'strength'; there is force, place", r.audio, "strength")
