"""Shared pages of the shipped scenes in browsers without a network: their samples while
parameters move.

STIMLIB_STRESS=1 pytest -m stress tests/stress/test_share.py -s, which prints a row for
each scene. Needs clang with lld, or zig (ZIG names the program).
"""

import numpy as np
import pytest
from exported import COUNT, groups
from laws import Set, run
from live.chromium import Browser, where
from live.shared import OFFLINE, need_compiler, numbers

import stimlib
from stimlib.live.share import share
from stimlib.motion.source import positions, sources_of
from stimlib.motion.text import parse_motion
from stimlib.scenes import ROWS, SHIPPED

pytestmark = [
    pytest.mark.stress,
    pytest.mark.xdist_group("browsers"),
    pytest.mark.skipif(where() is None, reason="Chromium is not installed"),
]
FS = 8000
LARGE = ("touch_screen",)  # its table of a mode shape takes 77 MB of text


@pytest.fixture(scope="module")
def browser():
    need_compiler()
    made = Browser(OFFLINE)
    yield made
    made.close()


@pytest.mark.parametrize("name", [n for n in SHIPPED if n not in LARGE])
def test_a_scene(name, browser, tmp_path):
    """At least 1e5 samples of squeeze, a second of the others; all parameters move."""
    scene, path, seconds = SHIPPED[name](), tmp_path / "a.html", 7.0 if name == "squeeze" else 1.0
    motion = {i: parse_motion(m) for i, m in ROWS[name].drive.items()}
    share(scene, FS, path, motion, seconds, title=name)
    n = round(seconds * FS)
    x = positions(sources_of(motion, tuple(scene.inputs), n), 0, n, FS)
    page = browser.page(path.as_uri())
    found = page.js("window.scene.checked")
    assert found["same"] and found["spent"] < found["block"]
    cuts = [n // 3 + 17 * k for k in range(len(scene.params))]
    values = [1.1 * p.value for p in scene.params.values()]
    assert page.js("scene.hello.params.map(p => p.name)") == list(scene.params)
    words = [[cut, k, value, 160] for k, (cut, value) in enumerate(zip(cuts, values, strict=True))]
    got = numbers(page, f"scene.check({words}).then(c => c.all)", len(scene.outputs))
    changes = map(Set, cuts, scene.params, values, [0.02] * len(values))
    want = run(stimlib.compile(scene, FS), x, (), [*changes])
    differ = int(np.sum(got.view(np.uint64) != want.view(np.uint64)))
    rms = np.sqrt(np.mean(want**2))
    print(
        f"\n{name}: {differ} of {want.size} samples differ, rms {rms:.3g}; 128 samples take"
        f" {found['spent']:.3f} of {found['block']:.0f} ms; {path.stat().st_size / 1e3:.0f} kB"
    )
    assert got.shape == want.shape and differ == 0 and rms > 0
    assert got.size >= 1e5 or name != "squeeze"
    assert page.complaints() == []
    page.close()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of a block's horizon
@pytest.mark.parametrize("k", range(COUNT - 1))  # the last has a table of 16 MB of text
def test_the_table_of_blocks(k, browser, tmp_path):
    """Without a C library: ``fma`` and ``fmod`` of the page are its own."""
    fs, scene, motion = groups()[k]
    made = share(scene, fs, tmp_path / "blocks.html", motion)
    page = browser.page((tmp_path / "blocks.html").as_uri())
    found = page.js("scene.checked")
    print(f"\n{len(scene.outputs)} blocks, {made.samples} samples of each: {found['same']}")
    assert found["sha256"] == made.sha256 and made.samples == 1200 and page.complaints() == []
    page.close()
