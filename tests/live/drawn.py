"""Experiments whose page draws: two soft surfaces that are only seen, and scenes that a
device presents.
"""

from dataclasses import dataclass

import numpy as np
from experiments.some import experiment

from stimlib.experiments import ConstantStimuli, Stimulus, Timing, Trial
from stimlib.files import read_log
from stimlib.files.log_replay import delivered
from stimlib.run.safety import Safety
from stimlib.scenes import soft_surface
from stimlib.soft import array

WIDE = 0.12  # of the surfaces, in m


def level(s):
    """A pen's surface that is equally hard everywhere."""
    return soft_surface("deformation", S=array(np.full((3, 3), s), WIDE, WIDE))


@dataclass(frozen=True)
class Softer:
    """Which of two surfaces is softer: level 0 has the soft one first."""

    condition = "pair"

    def trial(self, level, seed, n):
        order = ("soft", "hard") if level == 0 else ("hard", "soft")
        scores = {"first": float(level), "second": 1.0 - level}
        return Trial("pair", tuple(map(Stimulus, order)), ("softer",), level, scores=scores)


def seen(interval=1.5, orders=(0.0,), **other):
    """Which surface is softer, judged by sight."""
    told = {
        "scenes": {"soft": level(0.0), "hard": level(1.0)},
        "design": ConstantStimuli(tuple((Softer(), order) for order in orders)),
        "safety": Safety({"x1": 0.14, "y1": 0.14, "depth1": 0.02, "force": 10.0}),
        "bounds": {},
        "motion": dict.fromkeys(("x", "y", "press"), lambda t: 0.0 * t),
        "timing": Timing(interval=interval, gap=0.1, before=0.0),
    }
    return experiment(**(told | other))


def outputs_of(folder):
    """Delivered outputs of a log, in their units, and its motion: {name: samples}."""
    log = read_log(folder)
    frames = np.concatenate([y for _, y, _ in delivered(log)])
    frames = frames * log.safety.scales(log.outputs)
    return dict(zip(log.outputs, frames.T, strict=True)), dict(
        zip(log.inputs, log.motion.T, strict=True)
    )
