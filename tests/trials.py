"""A trial of two intervals, for what verifies it."""

from stimlib.experiments import Experiment, Stimulus, Timing, Trial, choice, program
from stimlib.run import Safety


def pair(scene, first, ramp=0.02):
    """Scene and parameters of a trial at 4 kHz: a scene with these parameters from
    0.032 s on, and as it is from 0.282 s on, each for 0.2 s.
    """
    asked = choice("more", "Which was more?", "first", "second")
    timing, two = Timing(0.2, 0.05, 0.0, ramp), (Stimulus("s", first, 3), Stimulus("s", {}, 5))
    words = {"fs": 4000, "safety": Safety(1000.0), "timing": timing}
    shown = Experiment("pair", "1", {"s": scene}, print, (asked,), **words)
    return program(shown, Trial("a", two, ("more",)))
