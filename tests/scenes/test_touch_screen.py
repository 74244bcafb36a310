"""The touch screen down to the finger: its law, what the law catches, and what the swap
is for.
"""

import dataclasses as dc
import re

import numpy as np
import pytest
from refusals import refused, warned

import stimlib
from stimlib import BadValue, Scene
from stimlib.checks.evidence import gather
from stimlib.checks.scenes import scene_law
from stimlib.motion import constant_speed
from stimlib.plate import Patch, Plate
from stimlib.scenes import touch_screen

GLASS = dc.replace(Plate.paper(measured=True), terms=10)


@pytest.mark.parametrize("name", touch_screen(model=GLASS).outputs)
def test_the_law_sees_another_voltage_and_another_plate(name):
    scene = touch_screen(model=GLASS)
    changed = Scene(scene.outputs | {name: 1.00001 * scene.outputs[name]}, scene.parts)
    motion = {"x": constant_speed(0.1, 0.1)}
    checks = scene_law(gather(changed, motion, stimlib.render(changed, motion, 8000, 0.5)))
    assert any(name in c.name for c in checks if not c.passed)


def test_the_displacement_is_the_same_everywhere_and_the_swap_keeps_the_bumps():
    depth = {}
    for swap in (1.0, 4.0):
        scene = touch_screen(bumps=20, swap=swap, model=GLASS, modes=1)
        d = stimlib.render(scene, {"x": constant_speed(0.1, 0.1)}, 8000, 0.9)["displacement"]
        lines = np.fft.fft(d)
        lines[lines.size // 2 :] = 0
        envelope = 2 * np.abs(np.fft.ifft(lines))
        tops = [envelope[k * 400 : (k + 1) * 400].max() for k in range(4, 16)]
        assert np.ptp(tops) < 0.06 * np.mean(tops)
        depth[swap] = np.ptp(envelope[2400:5600])
    assert depth[4.0] > 2 * depth[1.0]


@pytest.mark.parametrize(
    "more",
    [{"amplitude": 4.0}, {"amplitude": 7.5, "swap": 1.0}, {"amplitude": 9.0, "rectify": "full"}],
)
def test_a_drive_that_the_patches_cannot_take_warns_and_says_what_is_lost(more):
    """Against the scene itself: a bump that is on all the time, a finger held where the
    plate moves least.
    """
    words = {"waveform": "square", "duty": 1.0, "model": GLASS, "modes": 1} | more
    with pytest.warns(RuntimeWarning, match="% of the vibration is lost") as told:
        scene = touch_screen(**words)
    held, lost = map(int, re.findall(r"(\d+) %", str(told[0].message)))
    asked, at = touch_screen(**words | {"amplitude": 1e-3}), {"x": np.zeros(16000)}
    v, linear = (stimlib.render(s, at, 8000)["voltage"][8000:] for s in (scene, asked))
    turns = GLASS.carrier() * (2 if "full" in more.values() else 1) * np.arange(8000) / 8000
    line, line_asked = np.abs(np.array([v, linear]) @ np.exp(-2j * np.pi * turns))
    assert 100 * np.mean((v == -100) | (v == 400)) == pytest.approx(held, abs=2)
    assert 100 * (1 - (line / line_asked / (1e3 * more["amplitude"]))) == pytest.approx(lost, abs=2)


def test_as_printed_is_a_half_wave_without_a_swap():
    motion = {"x": constant_speed(0.1, 0.1)}
    one, other = (
        touch_screen(model=GLASS, as_printed=True),
        touch_screen(model=GLASS, rectify="half", swap=1.0),
    )
    y, z = (stimlib.render(s, motion, 8000, 0.5) for s in (one, other))
    assert (y["voltage"] == z["voltage"]).all() and y["voltage"].min() == 0.0
    assert all(c.passed for c in scene_law(gather(one, motion, y)))


@pytest.mark.parametrize("more", [{}, {"rectify": "half"}, {"as_printed": True}])
def test_the_warning_says_which_amplitude_fits(more):
    with pytest.warns(RuntimeWarning, match="give an amplitude of up to") as told:
        touch_screen(model=GLASS, amplitude=9.0, **more)
    (fits,) = re.findall(r"up to ([\d.]+) V", str(told[0].message))
    touch_screen(model=GLASS, amplitude=0.99 * float(fits), **more)  # every warning is an error
    warned(RuntimeWarning, None, touch_screen, model=GLASS, amplitude=1.01 * float(fits), **more)


@pytest.mark.parametrize(
    ("more", "match"),
    [
        ({"length": 0.3}, "plate's"),
        ({"bumps": 0}, "above 0"),
        ({"swap": 30.0}, "below 2 q"),
        ({"length": 0.2}, "at most 0.166 m"),
        ({"model": dc.replace(GLASS, patches=())}, "no patches"),
        ({"model": dc.replace(GLASS, patches=[Patch.duraact(0.05, 0.0735)])}, "lowest mode"),
    ],
)
def test_a_scene_that_makes_no_sense_is_told(more, match):
    refused(BadValue, match, touch_screen, **{"model": GLASS} | more)
