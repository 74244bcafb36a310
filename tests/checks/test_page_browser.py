"""The report page in a browser: on a phone, on a screen and on paper."""

import base64
import re

import numpy as np
import pytest
from live.chromium import Browser, where

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib.blocks import enabled, loading, lowpass, spring, velocity, white_noise
from stimlib.core.graph import reach
from stimlib.motion import minimum_jerk

pytestmark = [
    pytest.mark.xdist_group("chromium"),
    pytest.mark.skipif(
        where() is None, reason="Chromium is not installed: tests/devices/install.sh installs it"
    ),
]


@pytest.fixture(scope="module")
def browser():
    b = Browser("--allow-file-access-from-files")
    yield b
    b.close()


def many(noises: int) -> Scene:
    """Gated noises of different filters in one force, seven blocks for each."""
    x = Input("x", "m")
    v, force = velocity(x, 100.0), spring(x, Param("k", 1000.0, "N/m"))
    on = loading(v, resolution=1e-6)
    for i in range(noises):
        noise = enabled(lowpass(white_noise(1, i), 200.0 + 10 * i), by=on)
        force = force + constant(0.01 + 0.001 * i, "N*s/m") * v * noise
    return Scene({"force": force})


def written(folder, scene, motion, seconds=1.0):
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, fs=8000, seconds=seconds))
    report.to_html(folder / "a.html", "stimlib verify a.wav --report a.html")
    return report, f"file://{folder / 'a.html'}"


def sheets(page) -> int:
    """A4 sheets of a page as it is printed."""
    pdf = base64.b64decode(page.call("Page.printToPDF", paperWidth=8.27, paperHeight=11.69)["data"])
    return len(re.findall(rb"/Type\s*/Page\b(?!s)", pdf))


@pytest.mark.parametrize(
    ("noises", "most"), [(8, 4), pytest.param(42, 6, marks=pytest.mark.stress)]
)
def test_many_blocks_fit_a_phone_and_few_sheets(browser, tmp_path, noises, most):
    scene = many(noises)
    report, url = written(tmp_path, scene, {"x": minimum_jerk()}, 2.0)
    assert report.passed
    if noises == 42:
        assert len(reach(scene.outputs.values())) == 300 and len(report.checks) > 1000
    page = browser.page(url, 390, 844)
    for wide in (390, 768, 1440):
        page.size(wide, 844)
        assert page.js("document.documentElement.scrollWidth") == wide
    page.js("document.querySelectorAll('details').forEach(d => d.open = true)")
    page.size(390, 844)
    name = "document.querySelector('.checks tbody tr:nth-child(2) td:nth-child(2)')"
    assert page.js(f"{name}.getBoundingClientRect().width") > 120, "a name is no column of letters"
    assert page.js("document.documentElement.scrollWidth") == 390, "unfolded, too"
    assert sheets(page) <= most
    page.close()


def test_a_picture_on_a_phone_is_large_enough_to_be_read(browser, tmp_path):
    """Its letters, of 9 points in a figure of 12 inches, have more than 6 px."""
    scene, motion = stimlib.scenes.bumps(), {"x": np.linspace(0, 0.05, 8000)}
    _, url = written(tmp_path, scene, motion)
    page = browser.page(url, 390, 844)
    wide = page.js("document.querySelector('svg').getBoundingClientRect().width")
    assert 9 * wide / 864 > 6 and page.js("document.documentElement.scrollWidth") == 390
    page.close()
