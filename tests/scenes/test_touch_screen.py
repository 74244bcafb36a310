"""The touch screen down to the finger: its law, what the law catches, and what the swap
is for.
"""

import dataclasses as dc
import re
import warnings

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
    return stimlib.verify(
        scene, {"x": motion}, stimlib.render(scene, {"x": motion}, 8000, 0.5, **words)
    )


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"swap": 1.0, "rectify": "half", "waveform": "sawtooth"},
        {"waveform": "square", "amplitude": 3.0},
        {"finger": True},
    ],
)
@pytest.mark.filterwarnings("ignore:touch_screen.* are held")
def test_every_stage_is_proved(more):
    r = report(
        touch_screen(model=GLASS, **more), minimum_jerk(depth=0.1, rise=0.3), params={"duty": 0.4}
    )
    assert r.passed, str(r)
    assert "voltage: every stage" in str(r) and ("displacement: sum over" in str(r)) == (
        "finger" not in more
    )


def test_the_law_sees_another_voltage_and_another_plate():
    scene = touch_screen(model=GLASS)
    for name, y in scene.outputs.items():
        changed = Scene(scene.outputs | {name: 1.00001 * y}, scene.parts)
        assert not report(changed, constant_speed(0.1, 0.1)).passed


def test_a_carrier_beside_the_resonance_is_refused():
    data = touch_screen(model=GLASS).to_dict()
    (freq,) = (b["fields"] for b in data["blocks"] if b["fields"].get("name") == "freq")
    freq["value"] *= 1.000001
    (bad,) = [
        c.name
        for c in report(Scene.from_dict(data), constant_speed(0.1, 0.1)).checks
        if not c.passed
    ]
    assert bad == "parameters: as they were asked for"


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
    [
        {"amplitude": 4.0},
        {"amplitude": 7.5, "swap": 1.0},
        {"amplitude": 4.0, "rectify": "half"},
        {"amplitude": 9.0, "rectify": "full"},
    ],
)
def test_a_drive_that_the_patches_cannot_take_warns_and_says_what_is_lost(more):
    """Against the scene itself: a bump that is on all the time, a finger held where the
    plate moves least.
    """
    words = {"waveform": "square", "duty": 1.0, "model": GLASS, "modes": 1} | more
    with pytest.warns(RuntimeWarning, match="% of the vibration is lost") as told:
        scene = touch_screen(**words)
    held, lost = map(int, re.findall(r"(\d+) %", str(told[0].message)))
    line, voltage = [], {}
    for name, s in (("shown", scene), ("asked", touch_screen(**words | {"amplitude": 1e-3}))):
        voltage[name] = stimlib.render(s, {"x": np.zeros(16000)}, 8000)["voltage"][8000:]
        turns = GLASS.carrier() * (2 if "full" in more.values() else 1) * np.arange(8000) / 8000
        line.append(abs(np.sum(voltage[name] * np.exp(-2j * np.pi * turns))))
    v = voltage["shown"]
    assert 100 * np.mean((v == -100) | (v == 400)) == pytest.approx(held, abs=2)
    assert 100 * (1 - line[0] / line[1] / (1e3 * more["amplitude"])) == pytest.approx(lost, abs=2)


@pytest.mark.parametrize("more", [{}, {"rectify": "half"}, {"rectify": "half", "swap": 1.0}])
def test_the_warning_says_which_amplitude_fits(more):
    with pytest.warns(RuntimeWarning, match="give an amplitude of up to") as told:
        touch_screen(model=GLASS, amplitude=9.0, **more)
    (fits,) = re.findall(r"up to ([\d.]+) V", str(told[0].message))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        touch_screen(model=GLASS, amplitude=0.99 * float(fits), **more)
        assert told == []
        touch_screen(model=GLASS, amplitude=1.01 * float(fits), **more)
        assert len(told) == 1


def test_a_configuration_of_the_thesis_makes_a_scene():
    glass = dc.replace(Plate.paper(measured=True, patches="C4"), terms=8)
    scene = touch_screen(model=glass, amplitude=0.2)
    r = stimlib.render(scene, {"x": constant_speed(0.1, 0.1)}, 8000, 0.3)
    report = stimlib.verify(scene, r.motion, r)
    assert report.passed, str(report)


def test_a_drive_that_fits_does_not_warn():
    for more in ({}, {"amplitude": 1.0}, {"amplitude": 4.0, "rectify": "half", "swap": 1.0}):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            touch_screen(model=GLASS, **more)
        assert told == []


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
