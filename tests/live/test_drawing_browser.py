"""A purely visual experiment in a real browser: what is drawn, moved and recorded."""

import dataclasses
import json
from contextlib import contextmanager

import numpy as np
import pytest
from live.asked import FOLDER, silent
from live.drawn import outputs_of, seen
from live.test_asking_browser import awaited, opened, over, press
from live.test_drawing import shown
from waiting import until

from stimlib.experiments import Cursor, Drawing, read
from stimlib.files import read_log
from stimlib.scenes import viscoelastic

pytestmark = pytest.mark.xdist_group("browser")
WATCH = """import('./ask.js').then(({field}) => {
    window.field = field;
    window.shown = [];
    const draw = field.draw;
    field.draw = (colours, values) => {
        draw.call(field, colours, values);
        if (values) shown.push({ ...values });
    };
})"""
PICTURE = "document.querySelector('#picture')"
PIXELS = f"""(c => c.getContext('2d').getImageData(0, 0, c.width, c.height))({PICTURE})"""
KEEP = f"(window.images ??= []).push({PIXELS})"
# parts that are painted, colours, pixels that differ, and the pixel at a mark
COMPARED = """(([a, b]) => {
    const colours = new Set();
    let painted = 0, differ = 0;
    for (let k = 0; k < a.data.length; k += 4) {
        if (a.data[k + 3] < 255) continue;
        painted++;
        colours.add(a.data.slice(k, k + 3).join());
        differ += [0, 1, 2].some(i => Math.abs(a.data[k + i] - b.data[k + i]) > 30);
    }
    const [x, y] = field.cam.to(0.03, 0.03, 0).map(Math.round), at = 4 * (y * a.width + x);
    return [4 * painted / a.data.length, colours.size, differ, [...a.data.slice(at, at + 4)]];
})(images)"""
RESTS = "Math.abs(shown.at(-1)?.x1 - shown.at(-5)?.x1) < 1e-5"
LABEL = f"[{PICTURE}.ariaLabel, {PICTURE}.role, {PICTURE}.tabIndex]"


@contextmanager
def begun(browser, data, made, sink="page"):
    """A session whose first stimulus has begun, its page, and the number of the prompt
    before.
    """
    with opened(browser, data, made, sink, 900) as (running, page):
        page.js(WATCH)
        state = awaited(running, page)
        press(page, state, " ")
        page.until(f"document.querySelector('#clock').textContent && !{PICTURE}.hidden")
        yield running, page, state["number"]


def place(page, x, y):
    """Where in the window the surface is at (x, y)."""
    px, py, _ = page.until(f"field.cam?.to({x}, {y}, 0)")
    left, top, *_ = page.box("#picture")
    return left + 1 + px, top + 1 + py  # its border


def pen(page, x, y, force):
    for kind in ("Pressed", "Moved"):
        page.mouse(kind, *place(page, x, y), "pen", force)


def test_a_visual_experiment_is_drawn_moved_answered_and_recorded(browser, tmp_path):
    made = seen(3.0, orders=(0.0, 1.0), drawing=Drawing(marks={"1": (0.03, 0.03)}))
    with begun(browser, tmp_path, made) as (running, page, number):
        assert page.js(LABEL)[1:] == ["application", 0] and "explore" in page.js(LABEL)[0]
        for k in (1, 2):
            page.until(f"document.querySelector('#clock').textContent === '{k} of 2'")
            pen(page, 0.05, 0.07, 0.9)
            old = page.js("shown.length")  # of the stimulus before
            page.until(f"shown.length > {old} + 5 && {RESTS} && shown.at(-1).depth1 > 1e-3")
            page.js(KEEP)
            shown = page.js("shown.at(-1)")
            assert (shown["x1"], shown["y1"]) == pytest.approx((0.05, 0.07), abs=5e-4)
        page.mouse("Released", *place(page, 0.05, 0.07), "pen")
        painted, colours, differ, mark = page.js(COMPARED)
        assert painted > 0.3 and colours > 200 and differ > 500  # shades, and of the dents
        assert mark == [0x20, 0x60, 0xC0, 255]
        state = awaited(running, page, number)
        shown = page.js("shown.splice(0)")
        press(page, state, "1")
        # the second: keys move, and less motion is wanted
        state = awaited(running, page, state["number"])
        page.media(prefers_reduced_motion="reduce")
        press(page, state, " ")
        page.until("document.querySelector('#clock').textContent === '2 of 2'")
        before = page.js("field.fingers.get(0).u")
        page.key("ArrowRight", 0.1)
        page.until(f"field.fingers.get(0).u > {before}")
        press(page, awaited(running, page, state["number"]), "2")
        over(page)
    records = read(tmp_path / FOLDER).records
    assert [r.answer.values["softer"] for r in records] == ["first", "second"]
    told = [json.loads(line) for line in running.layouts.read_text().splitlines()]
    told, of = [line for line in told if "samples" in line], {1: [], 2: []}
    for line in told:
        of[int(line["log"][6:10])] += line["samples"]
    # every picture again from the log
    outputs, _ = outputs_of(tmp_path / FOLDER / "trial-0001-1.stimlog")
    assert len(of[1]) == len(shown) and told[0]["wide"] == 900
    for n, values in zip(of[1], shown, strict=True):
        assert values == {name: outputs[name][n] for name in ("x1", "y1", "depth1")}
    assert len(of[2]) <= 1 + 6.1 / 0.1
    fs = read_log(tmp_path / FOLDER / "trial-0001-1.stimlog").fs
    assert min(np.diff(of[1])) < 0.1 * fs  # how many there are depends on the machine


def test_an_avatar_is_beside_the_pen_and_takes_all_levels_of_its_pressure(browser, tmp_path):
    made = seen(5.0, drawing=Drawing(beside=(-0.015, 0.0)))
    with begun(browser, tmp_path, made) as (running, page, number):
        pen(page, 0.08, 0.06, 400 / 1023)
        page.until(f"{RESTS} && shown.at(-1).depth1 > 1e-4")
        pen(page, 0.08, 0.06, 401 / 1023)
        x1, y1 = page.js("[shown.at(-1).x1, shown.at(-1).y1]")
        px = page.js(f"field.cam.to({x1}, {y1}, 0)[0] - field.cam.to(0.08, 0.06, 0)[0]")
        assert px == pytest.approx(-15 * 96 / 25.4, abs=1.0)
        # what is done while the server is silent is known afterwards
        with silent(running):
            page.until("document.body.classList.contains('away')")
            page.mouse("Released", *place(page, 0.08, 0.06), "pen")
        until(lambda: running.asking._inputs.fingers[0][3] == 0.0)
        press(page, awaited(running, page, number), "1")
        over(page)
    _, motion = outputs_of(tmp_path / FOLDER / "trial-0001-1.stimlog")
    rest = [np.abs(motion["press"] - k / 1023).min() for k in (400, 401)]
    assert max(rest) < 1e-5 and motion["press"].max() < 401.01 / 1023


# the pixels of a colour, and the last row that has one
COLOURED = f"""(colour => (({{ data, width }}) => {{
    let n = 0, last = 0;
    for (let k = 0; k < data.length; k += 4)
        if (colour.every((v, i) => Math.abs(v - data[k + i]) < 3)) n++, last = k / 4 / width | 0;
    return [n, last]; }})({PIXELS}))"""


def test_plate_and_helix_go_down_with_the_hand(browser, tmp_path):
    made = shown(viscoelastic(), 1.5, y=lambda t: 0.01 + 0.0 * t)
    made = dataclasses.replace(made, cursor=Cursor("y", 0.005))
    with begun(browser, tmp_path, made, "null") as (_, page, _):
        assert page.js(LABEL)[1:] == ["img", -1]
        page.until("shown.length > 0")
        _, bottom = page.js(f"{COLOURED}([0xe8, 0xc0, 0x20])")
        assert page.js(f"{COLOURED}([0x15, 0x97, 0xb0])")[0] > 2000  # the helix
        fit = page.js("field.cam")
        # 30 mm are left of 40
        assert bottom + 1 == pytest.approx(fit["base"] - 0.03 * fit["scale"], abs=1.5)
        # the reference is beside it, and both are in the window
        (left, top, wide, _), picture = page.box("#track"), page.box("#picture")
        assert top == picture[1] and left + wide <= picture[0] and top + picture[3] <= 800
