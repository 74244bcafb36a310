"""What a notebook does with scenes, renderings, plans and reports."""

import dataclasses as dc
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refused

import stimlib
from stimlib import FaultError, Input, MissingPackage, Param, Scene, UnknownName
from stimlib.checks import Check
from stimlib.files import audio

x = Input("x", "m")
SCENE = Scene({"force": Param("k", 500.0, "N/m") * x, "place": 2 * x})
MOTION = {"x": lambda t: 0.01 * np.sin(2 * np.pi * 5 * t)}


@pytest.fixture(scope="module")
def r():
    return stimlib.render(SCENE, MOTION, 1000, 12.0, {"k": 300.0}, seed=7)


def test_each_shows_itself(r):
    plan, report = stimlib.compile(SCENE, 1000, "python").plan, stimlib.verify(SCENE, MOTION, r)
    pages = [one._repr_html_() for one in (SCENE, r, plan, report)]
    for page, *words in zip(
        pages,
        (
            "Scene(x [m], k [N/m] -&gt; force [N], place [m])",
            "Rendering(force, place:",
            "500",
            ": passed",
        ),
        ("data:image/svg+xml;base64,", "(the first 10 s)", "&lt;-", "</h4>"),
        strict=True,
    ):
        assert all(word in page for word in words) and "<script" not in page
    assert "data:image/png;base64," in pages[1]
    rows = 1 + len(report.checks) + len({c.group for c in report.checks})
    assert pages[3].count("<tr>") == rows
    odd = dc.replace(report, checks=[Check("e", "odd", np.inf, 0, "no number of JSON")]).to_dict()
    check = odd["checks"][0]
    assert (odd["passed"], check["measured"], check["limit"]) == (False, None, 0.0)
    assert stimlib.draw(SCENE)._repr_svg_() == stimlib.draw(SCENE).svg


def test_what_cannot_be_drawn_is_told_in_words(r, monkeypatch):
    y = x
    for _ in range(250):
        y = abs(y) + x
    large, empty = Scene({"y": y}), dc.replace(r, y=r.y[:, :0])
    told = [(large, "more than a picture can show"), (empty, "no sample to draw")]
    pages = [(one._repr_html_(), why) for one, why in told]
    for module in ("matplotlib", "matplotlib.font_manager"):
        monkeypatch.setitem(sys.modules, module, None)  # not installed
    pages += [(one._repr_html_(), "needs the package matplotlib") for one in (SCENE, r)]
    for page, why in pages:
        assert page.startswith("<pre>") and why in page and "<img" not in page


def test_a_fault_is_seen_and_not_saved(tmp_path):
    y = 1.0 / (x - stimlib.constant(1.0, "m"))
    broken = stimlib.render(Scene({"y": y}), {"x": np.arange(5.0)}, 1000, on_fault="ignore")
    assert "FAULT: y from sample 1 on" in broken._repr_html_()
    says = r"output y was not finite at sample 1 .*a.wav was not written"
    refused(FaultError, says, broken.save, tmp_path / "a.wav")
    assert not list(tmp_path.iterdir())


def test_plot_has_what_was_rendered(r):
    # of one name the first: over time
    panels = {ax.get_ylabel(): ax for ax in reversed(r.plot().axes)}
    for name, y in {"x": MOTION["x"](r.t), "force": r["force"], "place": r["place"]}.items():
        drawn = panels[name].lines[0].get_ydata()  # least and largest of each stretch
        assert (drawn.min(), drawn.max()) == (y.min(), y.max())
    f, S = panels["PSD / N²/Hz"].lines[0].get_data()
    assert f[np.argmax(S)] == pytest.approx(5, abs=0.3)
    for n in (1, 2):  # so few samples are a picture too
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


def test_xarray_has_units_and_what_made_it_and_is_a_copy(r):
    xarray = pytest.importorskip("xarray")
    data = r.to_xarray()
    assert isinstance(data, xarray.Dataset) and data["time"].attrs == {"units": "s"}
    assert [data[name].attrs for name in ("force", "place")] == [{"units": "N"}, {"units": "m"}]
    made_by = {"fs": 1000.0, "seed": "7", "params": '{"k": 300.0}', "scene_hash": SCENE.hash}
    assert data.attrs == made_by
    np.testing.assert_array_equal(data["place"].sel(time=slice(1.0, 1.1)), r["place"][1000:1101])
    data["force"][:] = 0.0
    assert r["force"].any()


def test_pandas_has_units_and_is_a_copy(r):
    pytest.importorskip("pandas")
    data = r.to_pandas()
    assert list(data) == ["force", "place"] and data.index.name == "time"
    assert data.attrs == {"units": {"force": "N", "place": "m"}}
    np.testing.assert_array_equal(data.index, r.t)
    np.testing.assert_array_equal(data["force"], r["force"])
    data["force"] = 0.0
    assert r["force"].any()


def test_audio_is_one_output_scaled(monkeypatch, r):
    display = SimpleNamespace(Audio=lambda data, **options: (data, options))
    for name in ("IPython", "IPython.display"):
        monkeypatch.setitem(
            sys.modules, name, SimpleNamespace(display=display, Audio=display.Audio)
        )
    data, options = r.audio("place")
    assert np.abs(data).max() == 1.0 and options == {"rate": 1000, "normalize": False}
    np.testing.assert_allclose(data * np.abs(r["place"]).max(), r["place"], rtol=1e-15)
    silent, _ = stimlib.render(Scene({"y": 0 * x}), MOTION, 1000, 0.1).audio()
    assert not silent.any()
    refused(UnknownName, "no output 'strength'; there are force", r.audio, "strength")
