"""What the device tests share: a log that remembers, the reference, and audio servers on private names."""

from __future__ import annotations

import numpy as np

import stimlib
from stimlib import blocks
from stimlib.devices.safety import protect, to_device


class Seen:
    """A log that keeps what it is told."""

    def __init__(self):
        self.x, self.frames, self.events, self.end = [], [], [], None

    def motion(self, x):
        self.x.append(x.copy())

    def delivered(self, frames):
        self.frames.append(frames.copy())

    def event(self, at, kind, **data):
        self.events.append((at, kind, data))

    def close(self, report):
        self.end = report


def textured(outputs=2, scale=1.0):
    """A scene for every sample rate: springs, and noise with the speed of the motion."""
    forces = {}
    for i in range(1, outputs + 1):
        x = stimlib.Input(f"x{i}", "m")
        noise = blocks.enabled(blocks.pink_noise(1.0, seed=5, stream=i, f_low=10.0), by=x)
        forces[f"force{i}"] = (
            blocks.spring(x, stimlib.Param("k", 2000.0, "N/m"))
            + 5.0 * blocks.velocity(x, 50.0) * stimlib.constant(scale, "N*s/m") * noise
        )
    return stimlib.Scene(forces)


def replayed(scene, safety, x, fs, events=(), channels=None, params=None, seed=0):
    """What a device should have got, from the processor alone: motion as processed (n_inputs, n) and the changes told."""
    proc = stimlib.compile(protect(scene, safety), fs, seed=seed)
    for name, value in (params or {}).items():
        proc.set(name, value, ramp=0.0)
    proc.process(np.zeros((len(proc.inputs), 0)))
    parts, i = [], 0
    for at, kind, e in events:
        if kind == "set":
            parts.append(proc.process(np.ascontiguousarray(x[:, i:at])))
            i = at
            proc.set(e["name"], e["value"], ramp=e["ramp"] / fs)
    parts.append(proc.process(np.ascontiguousarray(x[:, i:])))
    channels = range(len(proc.outputs)) if channels is None else channels
    return to_device(np.concatenate(parts, axis=1), safety.scales(proc.outputs), channels)


def offline(scene, safety, motion, fs, n, events=(), channels=None, **more):
    """``replayed`` for a motion given as functions of time."""
    t = np.arange(n) / fs
    x = np.stack([motion[name](t) for name in scene.inputs]) if scene.inputs else np.empty((0, n))
    return replayed(scene, safety, x, fs, events, channels, **more)


def kept(events, n):
    """Which of n produced samples were delivered."""
    out = np.ones(n, bool)
    for at, kind, e in events:
        if kind == "lost":
            out[at : at + e["frames"]] = False
    return out
