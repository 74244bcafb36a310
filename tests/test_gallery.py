"""Each program of the gallery runs as it stands, and the gallery shows what it drew and
wrote.
"""

import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from stimlib import MissingPackage

ROOT = Path(__file__).parents[1]
GALLERY = ROOT / "examples" / "gallery"
PROGRAMS = sorted(GALLERY.glob("*/plot_*.py"))


@pytest.mark.filterwarnings("error::RuntimeWarning")  # it would be printed on the page
@pytest.mark.parametrize("program", PROGRAMS, ids=lambda p: p.stem)
def test_a_program_draws_and_sounds(program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = runpy.run_path(str(program))
    y = made["result"].y
    assert np.isfinite(y).all() and (np.ptp(y, axis=1) > 0).all(), "an output that says nothing"
    assert any(axes.lines for axes in made["figure"].axes) and made["result"].fault is None
    text, written = program.read_text(), {p.name for p in tmp_path.iterdir()}
    assert "pyplot" not in text, "a program that opens windows, or keeps figures open"
    sounds = {name for name in written if name.endswith(".wav")}
    assert written == sounds | {f"{s}.json" for s in sounds}
    assert len(sounds) == text.count("\nlisten("), "a sound for each listen"
    lines = [line for line in text.split('"""')[2].splitlines() if line.strip()]
    assert len(lines) <= 21, "longer than a look takes"


def test_a_sound_stands_in_the_page_itself(tmp_path, monkeypatch):
    """So that whoever reads it offline hears it; and nothing is left beside the
    program.
    """
    pytest.importorskip("sphinx_gallery")
    monkeypatch.syspath_prepend(ROOT / "docs")
    from matplotlib.figure import Figure
    from matplotlib.image import imread
    from shown import shown

    figure = Figure()
    flat, square = figure.subplots(2, 1, height_ratios=(1, 8))
    flat.plot([0, 1]), square.plot([0, 1])
    square.set(xlabel="time", ylabel="force")
    (tmp_path / "plot_it.py").write_text('"""\nA hiss\n======\n"""\n')
    for name in ("hiss.wav", "hiss.wav.json"):
        (tmp_path / name).write_bytes(b"RIFF")
    given = {
        "image_path_iterator": iter([str(tmp_path / "thumb.png"), str(tmp_path / "it.png")]),
        "example_globals": {"figure": figure},
        "src_file": tmp_path / "plot_it.py",
    }
    rst = shown(None, given, {"src_dir": str(tmp_path)})
    assert '<audio controls src="data:audio/wav;base64,UklGRg==">' in rst and "it.png" in rst
    (tmp_path / "plot_it.py").unlink()
    assert {p.name for p in tmp_path.iterdir()} == {"it.png", "thumb.png"}
    wide, high = imread(tmp_path / "thumb.png").shape[1::-1]
    assert "thumb" not in rst and wide < 2 * high, "the thumbnail is the panel that fills it"
    assert wide < 500, "its letters are large"
    assert ":alt: A hiss: force over time\n" in rst, "what it shows, for those who do not see it"


def test_a_scene_can_be_played_with_or_a_note_says_how(tmp_path, monkeypatch):
    """Documentation is built with and without a compiler for WebAssembly."""
    pytest.importorskip("sphinx_gallery")
    monkeypatch.syspath_prepend(ROOT / "docs")
    import played

    def run(share, docname="gallery/scenes/plot_squeeze", form="html"):
        monkeypatch.setattr(played, "share", share)
        app = SimpleNamespace(builder=SimpleNamespace(format=form, outdir=tmp_path))
        env = SimpleNamespace(app=app, docname=docname)
        return played.Played.run(SimpleNamespace(arguments=["squeeze"], env=env))

    def missing(*given, **words):
        raise MissingPackage("no compiler")

    (note,) = run(missing)
    assert "stimlib share squeeze --out page.html" in note.astext()
    frame, link = run(lambda scene, fs, path, motion, title: path.write_text(title))
    assert (tmp_path / "_played" / "squeeze.html").read_text() == "squeeze"
    for node in (frame, link):
        assert "../../_played/squeeze.html" in node.astext()
    assert 'title="squeeze' in frame.astext() and run(missing, form="text") == []
