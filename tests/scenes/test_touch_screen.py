"""The touch screen down to the finger: its law, what the law catches, and what the swap is for."""

import dataclasses as dc

import numpy as np
import pytest

import stimlib
from stimlib import Scene
from stimlib.errors import BadValue
from stimlib.motion.generators import constant_speed, minimum_jerk
from stimlib.plate import Patch, Plate
from stimlib.scenes import touch_screen

GLASS = dc.replace(Plate.paper(measured=True), terms=10)


def report(scene, motion, **words):
    return stimlib.verify(scene, {"x": motion}, stimlib.render(scene, {"x": motion}, 8000, 0.5, **words))


@pytest.mark.parametrize(
    "more",
    [{}, {"swap": 1.0, "rectify": "half", "waveform": "sawtooth"}, {"waveform": "square", "amplitude": 3.0}, {"finger": True}],
)
def test_every_stage_is_proved(more):
    r = report(touch_screen(model=GLASS, **more), minimum_jerk(depth=0.1, rise=0.3), params={"duty": 0.4})
    assert r.passed, str(r)
    assert "voltage: every stage" in str(r) and ("displacement: the plate" in str(r)) == ("finger" not in more)


def test_the_law_sees_another_voltage_and_another_plate():
    outputs = touch_screen(model=GLASS).outputs
    for name in outputs:
        changed = Scene(outputs | {name: 1.00001 * outputs[name]}, law="touch_screen")
        assert not report(changed, constant_speed(0.1, 0.1)).passed


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


def test_a_scene_that_makes_no_sense_is_told():
    for more, match in (
        ({"length": 0.3}, "plate's"),
        ({"bumps": 0}, "above 0"),
        ({"swap": 30.0}, "below 2 q"),
        ({"length": 0.2}, "at most 0.166 m"),
        ({"model": dc.replace(GLASS, patches=())}, "no patches"),
        ({"model": dc.replace(GLASS, patches=[Patch.duraact(0.05, 0.0735)])}, "lowest mode"),
    ):
        with pytest.raises(BadValue, match=match):
            touch_screen(**{"model": GLASS} | more)
