"""The scene of a measured texture, held against its law; and the law against the block
at its edges.
"""

import dataclasses as dc

import numpy as np
import pytest
from refusals import refused

import stimlib
from stimlib import BadValue, Input, Scene, verify
from stimlib.blocks import save_texture, texture
from stimlib.checks import laws, scenes
from stimlib.checks.evidence import asked
from stimlib.design.texture import TextureModel, made_up
from stimlib.motion import constant_speed, sinusoid

MODEL = made_up(2, (0.0, 0.05, 0.15), (0.0, 1.0, 2.5))  # as in contract.py
HAND = {"x": sinusoid(0.03, 1.0), "force": sinusoid(0.8, 3.0, mean=1.0)}


@pytest.mark.parametrize(("factor", "fails"), [(1.0, False), (1.2, True)])
def test_a_steady_stroke_has_the_spectrum_of_its_place(factor, fails):
    steady = {"x": constant_speed(0.1, 9.0), "force": sinusoid(0.0, 1.0, mean=1.2)}
    scene = stimlib.scenes.texture(MODEL)
    r = verify(scene, steady, stimlib.render(scene, steady, 1000, 8.0, seed=3))
    assert r.passed, str(r)
    a = asked(r.evidence, r.evidence.scene.parts[0])
    other = dc.replace(a, y={"acceleration": factor * a.y["acceleration"]})
    (check,) = [c for c in scenes.SCENES["texture"](other) if "acceleration: spectrum" in c.name]
    assert check.passed is not fails


def odd():
    """Orders 3 and 1, triangles both ways, and a sliver that holds hardly anything."""
    rng = np.random.default_rng(5)
    lsf, ma = np.sort(rng.uniform(0.2, 3.0, (5, 3)), axis=1), rng.uniform(0.5, 2.5, (5, 1))
    triangles = [[0, 1, 4], [1, 4, 3], [3, 4, 2], [0, 4, 2], [0, 1, 4]]
    place = [0.0, 0.2, 0.0, 0.2, 1e-7], [0.0, 0.0, 3.0, 3.0, 1.0]
    return TextureModel(
        *place, triangles, lsf, ma, [0.0, 0.5, 0.3, 1.0, 0.2], rng.uniform(0.5, 2, 5), 500.0
    )


def test_the_law_and_the_block_agree_at_the_edges():
    model, n = odd(), 6000
    rng = np.random.default_rng(6)
    v, f = rng.uniform(-0.3, 0.3, n), rng.uniform(-0.5, 4, n)
    v[1000:1100], f[2000:2100], v[3000:3100], f[3500:3600] = np.nan, np.nan, np.inf, -np.inf
    proc = stimlib.compile(
        Scene({"a": texture(Input("v", "m/s"), Input("f", "N"), model, seed=7)}), 1500, seed=11
    )
    want = laws.texture(model, v, f, laws.white(11, 7, 0, 0, n), 3)
    np.testing.assert_allclose(
        proc.process(np.array([v, f]))[0], want, atol=1e-7 * np.abs(want).max()
    )


def test_a_lift_is_silent_and_a_file_is_a_model(tmp_path):
    save_texture(MODEL, tmp_path / "a.xml")
    scene = stimlib.scenes.texture(tmp_path / "a.xml", contact=True)
    lifted = HAND | {"contact": lambda t: 1.0 * (t < 0.2)}
    r = stimlib.render(scene, lifted, fs=1000, seconds=0.6)
    rough = np.abs(r["acceleration"])
    assert rough[50:200].max() > 0.1 and rough[450:].max() < 1e-4
    assert verify(scene, lifted, r).passed and list(scene.inputs) == ["x", "contact", "force"]
    for says, words in (("cannot read", {"model": "none.xml"}), ("level", {"level": "loud"})):
        refused(BadValue, says, stimlib.scenes.texture, **words)
