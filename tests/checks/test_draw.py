"""Pictures of a graph: nothing missing, nothing on top of anything else, the same bytes
every time.
"""

import re
import subprocess
import sys

import matplotlib.image
import numpy as np
import pytest
from refusals import refused

from stimlib import BadValue, Input, Param, Scene, SinkError, compile, constant, draw, enabled
from stimlib.analysis.layout import SMALL, SPACE, Layout, width_of
from stimlib.blocks import (
    delay,
    loading,
    loop,
    lut,
    pink_noise,
    segment,
    velocity,
    where,
    white_noise,
)
from stimlib.core.program import lower
from stimlib.scenes import squeeze, tone


def nested() -> Scene:
    """Everything a picture has to cope with: nested gates, a parameter inside, an
    output that is a number.
    """
    x, a, b = Input("x", "m"), Param("A", 1.0), Param("B", 2.0)
    inner = enabled(white_noise(2) * b, by=white_noise(3) > 0.5)
    noise = enabled(pink_noise(1.0, seed=1) * a + inner, by=loading(velocity(x)))
    only = enabled(a, by=x > constant(0.1, "m"))
    force = constant(5.0, "N/m") * x - constant(2.0, "N") * noise / (1 + b)
    choice = where(only > noise, lut(x, [0, 1, 2], [1, 2, 3]), delay(noise, seconds=0.01))
    return Scene({"force": force, "only": only, "number": constant(3.0), "choice": choice})


def chain(n: int) -> Scene:
    y = Input("x")
    for _ in range(n - 1):
        y = abs(y)
    return Scene({"y": y})


SCENES = {
    "squeeze": squeeze,
    "nested": nested,
    "noise": lambda: Scene({"n": white_noise(1)}),
    "long": lambda: chain(200),
}


def test_a_picture_is_filled_by_its_graph(tmp_path):
    draw(squeeze(), tmp_path / "a.png")
    image = matplotlib.image.imread(tmp_path / "a.png")
    rows, columns = np.nonzero((image[..., :3] < 0.9).any(axis=-1))
    assert np.ptp(columns) > 0.8 * image.shape[1] and np.ptp(rows) > 0.8 * image.shape[0]


@pytest.mark.parametrize("name", SCENES)
def test_every_block_has_its_place(name):
    program = lower(SCENES[name]().outputs)
    p = Layout(program)
    assert set(p.box) == {
        i for i, q in enumerate(program.instances) if q.kind not in ("const", "open")
    }
    assert min(box.first for box in p.top.boxes) == 0
    for i, box in p.box.items():  # signals go to the right
        for a in p.sources(i):
            assert p.box[a].last <= box.last if box.inner else p.box[a].last < box.first
    for a, wire in p.wires.items():  # as far as the block before the last that it reaches
        assert wire.last == max(c for b in p.box.values() for n, c in p.needs(b) if n == a) - 1


@pytest.mark.parametrize("name", SCENES)
def test_no_two_boxes_overlap(name):
    p = Layout(lower(SCENES[name]().outputs))

    def look(level):
        boxes = [*level.boxes, *level.wires.values()]
        for k, a in enumerate(boxes):
            for b in boxes[:k]:
                if a.first <= b.last and b.first <= a.last:
                    assert (
                        p.y[a] + a.height + SPACE <= p.y[b] + 1e-9
                        or p.y[b] + b.height + SPACE <= p.y[a] + 1e-9
                    )
            if a.inner:
                inner = [*a.inner.boxes, *a.inner.wires.values()]
                assert all(a.first <= b.first and b.last <= a.last for b in inner)
                assert all(p.y[a] < p.y[b] and p.y[b] + b.height < p.y[a] + a.height for b in inner)
                look(a.inner)

    look(p.top)


def test_the_words_of_a_block():
    p = Layout(lower(squeeze(fingers=1).outputs))
    text = {tuple(p.text(i)) for i in p.box if not p.box[i].inner}
    for words in (
        ("k", "2000 N/m"),
        ("x1",),
        ("White", "seed = 0", "stream = 1"),
        ("force1",),
        ("\u00d7 0.000125 s",),
    ):
        assert words in text
    assert any(t[0] == "Velocity" and "cutoff = 100" in t for t in text)
    assert Layout(lower({"y": Input("x") - 0.0})).text(2)[1:] == ["b = 0"]
    p = Layout(lower({"y": loop(lambda y: lut(2.0 * y, [0, 1], [0, 1]))}))
    assert ["loop", "\u00d7 Lut"] in map(p.text, p.box)


@pytest.mark.parametrize(
    ("suffix", "magic", "name"),
    [(".svg", b"<?xml", "nested"), (".pdf", b"%PDF", "noise"), (".PNG", b"\x89PNG", "noise")],
)
def test_same_bytes_every_time(tmp_path, suffix, magic, name):
    draw(SCENES[name](), tmp_path / f"a{suffix}")
    draw(SCENES[name](), tmp_path / f"b{suffix}")
    data = (tmp_path / f"a{suffix}").read_bytes()
    assert data.startswith(magic) and data == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize(
    ("y", "words", "last"),
    [
        (abs(Input("x")), ["x", "| |", "y"], "every sample"),
        (tone(channels=2), ["freq", "Carrier"], "signal0 = signal1"),
        (tone(channels=5), ["freq", "Carrier"], "signal0 = signal1 = signal2 and 2 more"),
        (
            sum(enabled(white_noise(k), by=Input("x") > k) for k in range(7)),
            ["x", "White", "y"],
            "enabled 7: only while its gate is open",
        ),
        (segment(abs(Input("x")), 0.1), ["x", "| |", "y"], "segment 1: only in segment(0.1, None)"),
    ],
)
def test_words_stand_in_the_picture_from_the_left(y, words, last):
    svg = draw(y if isinstance(y, Scene) else Scene({"y": y})).svg
    _, _, width, height = map(float, re.search('viewBox="([^"]+)"', svg)[1].split())
    found = re.findall(r"<!-- (.+) -->\s*<g [^>]*translate\(([\d.-]+) ([\d.-]+)\)", svg)
    across = {word: float(x) for word, x, _ in found}
    assert sorted(words, key=across.get) == words and last in across
    assert all(
        0 < float(x) < width - 72 * width_of(word, SMALL) and 0 < float(y) < height
        for word, x, y in found
    )


def test_processor_and_scene_give_the_same_picture(tmp_path):
    """Whatever the user's matplotlib is set to, which is left alone."""
    draw(squeeze(), tmp_path / "a.svg")
    with matplotlib.rc_context({"font.size": 33}):
        before = dict(matplotlib.rcParams)
        draw(compile(squeeze(), 8000, target="python"), str(tmp_path / "b.svg"))
        assert dict(matplotlib.rcParams) == before
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_import_does_not_load_matplotlib(tmp_path):
    """Nor does a picture load its user interface."""
    code = (
        "import sys, stimlib.checks; assert 'matplotlib' not in sys.modules\n"
        "from stimlib.analysis.draw import draw; from stimlib.scenes import squeeze\n"
        f"draw(squeeze(), {str(tmp_path / 'a.svg')!r})\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("error", "says", "scene", "name"),
    [
        (BadValue, "suffix .*one of .svg", squeeze(), "a.jpg"),
        (BadValue, "300 blocks are more .*plan", chain(300), "a.svg"),
        (BadValue, "scene = 3 must be a Scene", 3, "a.svg"),
        (SinkError, "cannot write .*No such", squeeze(), "missing/a.svg"),
    ],
)
def test_refusals(tmp_path, error, says, scene, name):
    refused(error, says, draw, scene, tmp_path / name)
    assert list(tmp_path.iterdir()) == []
