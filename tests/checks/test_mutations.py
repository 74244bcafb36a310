"""Would the verifier notice?  Every fault of ``faults.py``, one at a time, and correct
renderings beside them: the table of docs/explanation/verification.rst.
"""

import numpy as np
import pytest
from correct import rendering
from faults import FAULTS, OLD, caught, failed
from laws import mostly

import stimlib


@pytest.mark.parametrize("name", FAULTS)
def test_the_verifier_catches(name):
    """Of a shipped scene, by its law too; a formula that a block once had, by the laws
    of blocks alone, as its own response has it too.
    """
    groups = caught(FAULTS[name])
    assert groups and groups >= FAULTS[name].groups
    assert name not in OLD or groups <= {"a2", "f"}


def test_what_is_faulty_is_not_the_scene():
    """Without its fault, each scene passes; made anew: laws are kept with blocks."""
    for fault in {fault.scene and fault.scene.hash: fault for fault in FAULTS.values()}.values():
        scene = fault.scene and stimlib.Scene.from_dict(fault.scene.to_dict())
        assert not failed(scene, fault.motion, 0.3)


@pytest.mark.parametrize("seed", mostly(range(12), range(200)))
def test_correct_renderings_of_every_kind_pass(seed):
    """Own blocks, parameters, limits, 1 to 192 kHz, held hands."""
    kind, scene, motion, render = rendering(np.random.default_rng(10**6 + seed))
    report = stimlib.verify(scene, motion, render(scene, motion))
    assert report.passed, f"{kind}: {report}"
