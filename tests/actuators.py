"""Simulated actuators, and what a calibrated sink makes of a signal on them.

The simulation is independent of the package: resonances as digital filters of scipy, a
delay, and a drive that saturates. ``python tests/actuators.py``
prints the figures of docs/howto/calibrate.rst.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import bilinear, butter, freqz, lfilter, sosfilt

import stimlib
from stimlib import Input, Scene
from stimlib.devices import calibrate
from stimlib.plate import Sweep
from stimlib.run.safety import GAIN, Safety, Watch, protect

FS = 4000.0
BAND = (80.0, 400.0)


@dataclass(frozen=True)
class Actuator:
    """Resonances (Hz, Q, m/s^2 at the peak) side by side, with a delay in samples.

    ``drive`` is the level at which tanh saturates it, as a part of full scale.
    """

    modes: tuple[tuple[float, float, float], ...]
    delay: int = 0
    drive: float = np.inf

    def filter(self):
        """Return the coefficients b, a: accelerations of masses on springs."""
        b, a = np.zeros(1), np.ones(1)
        for f, q, gain in self.modes:
            w = 2 * FS * np.tan(np.pi * f / FS)
            bb, aa = bilinear([gain * w / q, 0], [1, w / q, w * w], FS)
            b, a = np.polyadd(np.polymul(b, aa), np.polymul(bb, a)), np.polymul(a, aa)
        return np.r_[np.zeros(self.delay), b], a

    def gain(self, f):
        return freqz(*self.filter(), f, fs=FS)[1]

    def felt(self, drive):
        if np.isfinite(self.drive):
            drive = self.drive * np.tanh(drive / self.drive)
        return lfilter(*self.filter(), drive)

    def calibrated(self, rng, noise=0.002, resolution=None):
        """Return its calibration from five takes of a sweep, with noise in the sensor.

        The resolution is below a third of the sharpest resonance's width by default.
        """
        if resolution is None:
            resolution = 2.0 if min(f / q for f, q, _ in self.modes) > 6 else 1.0
        seconds, (low, high) = 12.0 / resolution, (0.4 * BAND[0], 2.5 * BAND[1])
        t = np.arange(int((seconds + 1) * FS)) / FS
        u = 0.1 * np.sin(2 * np.pi * (low * t + (high - low) / 2 / seconds * t * t)) * (t < seconds)
        y = self.felt(u) + noise * rng.normal(size=(5, t.size))
        return calibrate(Sweep(u, y, FS), "m/s^2", BAND, resolution=resolution)


ACTUATORS = {
    "180 Hz, Q 12": Actuator(((180.0, 12.0, 4.0),)),
    "180 Hz, Q 2": Actuator(((180.0, 2.0, 4.0),)),
    "150 Hz, Q 40": Actuator(((150.0, 40.0, 8.0),)),
    "250 Hz, Q 20": Actuator(((250.0, 20.0, 4.0),)),
    "100 Hz, Q 8": Actuator(((100.0, 8.0, 2.0),)),
    "380 Hz, Q 10": Actuator(((380.0, 10.0, 4.0),)),
    "420 Hz, Q 10": Actuator(((420.0, 10.0, 4.0),)),
    "60 Hz, Q 6": Actuator(((60.0, 6.0, 4.0),)),
    "150 and 320 Hz": Actuator(((150.0, 8.0, 3.0), (320.0, 20.0, -2.0)), 3),
    "120 and 300 Hz": Actuator(((120.0, 30.0, 3.0), (300.0, 30.0, -2.0))),
    "180 Hz, 10 ms late": Actuator(((180.0, 12.0, 4.0),), 40),
    "180 Hz, saturates": Actuator(((180.0, 12.0, 4.0),), 0, 1.5),
}


def stimulus(rng, n, most):
    """Return noise, pulses, a square wave, a step, a tone or bursts.

    Its peak is between 0.1 and 3 of ``most``.
    """
    t, size, f = np.arange(n) / FS, most * 10 ** rng.uniform(-1.0, 0.5), rng.uniform(20.0, 800.0)
    tone = np.sin(2 * np.pi * f * t)
    noise = sosfilt(butter(3, BAND, "band", fs=FS, output="sos"), rng.normal(size=n))
    kinds = (
        noise / np.abs(noise).max(),
        0.4 * rng.normal(size=n),
        t % rng.uniform(0.03, 0.2) < rng.uniform(0.001, 0.02),
        np.sign(tone),
        t > 0.1,
        tone,
        tone * (t % 0.1 < 0.05),
    )
    return size * kinds[rng.integers(len(kinds))]


class Played:
    """A calibrated actuator with limits of value and slew, ready for many signals."""

    def __init__(self, device, made, most, slew=None):
        scene = Scene({"y": stimlib.constant(1.0, "m/s^2") * Input("x")})
        safety = made.safety(scene, Safety(most, slew=slew), FS)
        self.device, self.most, self.inverse = device, most, safety.inverse
        self.late = len(self.inverse.taps) // 2
        self.proc = stimlib.compile(protect(scene, safety), FS)

    def __call__(self, y):
        """Return what is felt of a signal, in m/s^2, and the safety stage's counts."""
        self.proc.reset()
        self.proc.set(GAIN, 1.0, ramp=0.0)
        drive = self.proc.process(np.append(y, np.zeros(self.late + 800))[None])[0]
        return self.device.felt(drive / self.most), Watch(self.proc)


def figures(name, stimuli, seed=3):
    """Return the figures of an actuator, as parts of what is stated.

    Largest error in the band as a part of the stated error; largest gain outside of it;
    largest value and slew at the skin as parts of their limits, for random stimuli; and
    taps of the inverse filter.
    """
    device, rng = ACTUATORS[name], np.random.default_rng(seed)
    made = device.calibrated(rng)
    f = np.linspace(1.0, FS / 2, 20000)
    gain = np.abs(freqz(made.inverse(FS), 1, f, fs=FS)[1] * device.gain(f))
    inside = (f >= BAND[0]) & (f <= BAND[1])
    most = 0.4 * float(np.abs(made.gain[made._inside]).max())
    slew = most * 2 * np.pi * 150.0
    runs = [Played(device, made, most), Played(device, made, most, slew)]
    stated, worst = runs[0].inverse.error, np.zeros(2)
    for _ in range(stimuli):
        y = stimulus(rng, int(0.4 * FS), most)
        worst[0] = max(worst[0], np.abs(runs[0](y)[0]).max() / most)
        worst[1] = max(worst[1], np.abs(np.diff(runs[1](y)[0])).max() * FS / slew)
    part = np.abs(gain[inside] - 1).max() / stated
    return part, gain[~inside].max(), stated, *worst, runs[0].late


if __name__ == "__main__":
    print("actuator              error  of stated  outside  value  slew  delay (ms)")
    for name in ACTUATORS:
        part, outside, stated, value, slew, late = figures(name, 200)
        print(
            f"{name:20} {100 * part * stated:5.1f} % {100 * stated:6.1f} %  {outside:6.3f}"
            f" {value:7.3f} {slew:6.3f} {1000 * late / FS:6.0f}",
            flush=True,
        )
