"""Would the verifier notice?  Every fault of ``faults.py``, one at a time, and correct
renderings beside them: the table of docs/explanation/verification.rst.
"""

from unittest.mock import patch

import numpy as np
import pytest
from correct import rendering
from faults import DESIGNS, FAULTS, MUTATIONS, OLD, WAVE, caught, failed, scene_of
from laws import STRESS

import stimlib


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_verifier_catches(name, tmp_path):
    groups = {text[1 : text.index(")")] for text in caught(name, tmp_path)}
    assert MUTATIONS[name][3] <= groups, groups


@pytest.mark.parametrize(
    "name",
    [name for name in FAULTS if name not in MUTATIONS and not name.startswith("old formula")],
)
def test_every_fault_is_caught(name, tmp_path):
    """Of a design, by the law of its scene too."""
    found = caught(name, tmp_path)
    lawful = name in DESIGNS and any(part.given for part in DESIGNS[name][2].parts)
    assert [text for text in found if text.startswith("(d)" if lawful else "")], found


@pytest.mark.parametrize("name", OLD)
def test_a_formula_that_was_wrong_is_refused_by_its_law(name, tmp_path):
    """Whose block states a response that its samples have: the law alone sees it."""
    assert {text.partition(" ")[0] for text in caught(f"old formula: {name}", tmp_path)} <= {
        "(a2)",
        "(f)",
    }


def test_what_is_faulty_is_not_the_scene():
    """Without its fault, each scene passes."""
    assert len(FAULTS) >= 60
    for _, _, scene, motion in DESIGNS.values():
        assert not failed(scene, motion, seconds=0.3)
    for *_, block in OLD.values():
        assert not failed(scene_of(block), WAVE, seconds=0.3)
    with patch.object(*MUTATIONS["k 1 % off"][:3]):
        assert failed(seconds=0.1)


@pytest.mark.longer
def test_correct_renderings_pass():
    wrong = {
        seed: bad for seed in range(50 if STRESS else 12) if (bad := failed(seed=seed, seconds=1.0))
    }
    assert not wrong


@pytest.mark.parametrize("seed", range(12))
def test_correct_renderings_of_every_kind_pass(seed):
    """Own blocks, parameters, limits, 1 to 192 kHz, held hands."""
    kind, scene, motion, render = rendering(np.random.default_rng(10**6 + seed))
    report = stimlib.verify(scene, motion, render(scene, motion))
    assert report.passed, f"{kind}: {report}"
