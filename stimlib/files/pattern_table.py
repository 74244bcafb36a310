"""The table that haptic patterns of other programs are read to and written from."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from ..blocks import at, oscillator, ring, timeline
from ..core.graph import Block, constant
from ..errors import Above0, BadValue, public

Point = tuple[float, float]
Tap = tuple[float, float, float]  # a transient: s, amplitude, Hz

TAP_SECONDS = 0.022  # a transient of MPEG's reference software: two periods of a sine
SOON = 5e-4  # s before a tap, when its height and frequency are set


class Voice(NamedTuple):
    """A vibration: amplitude and frequency over time, straight between points.

    It is silent before the first and after the last point of its amplitude.
    """

    amplitude: list[Point]  # s, -1 .. 1
    frequency: list[Point]  # s, Hz; none for a signal that is its amplitude
    shape: str = "sine"
    phase: float = 0.0  # rad, at the first point


class Pattern(NamedTuple):
    """What one actuator does."""

    voices: list[Voice]
    taps: list[Tap]
    notes: tuple[str, ...] = ()  # what of the file has no effect

    @property
    def seconds(self) -> float:
        """The time at which the pattern ends."""
        ends = [v.amplitude[-1][0] for v in self.voices]
        return max([*ends, *(t + TAP_SECONDS for t, _, _ in self.taps)], default=0.0)

    @property
    def peak(self) -> float:
        """The largest amplitude."""
        heights = [abs(a) for v in self.voices for _, a in v.amplitude]
        return max([*heights, *(abs(a) for _, a, _ in self.taps)], default=0.0)

    def scaled(self, factor: float) -> Pattern:
        """Return the pattern with other amplitudes."""
        return Pattern(
            [v._replace(amplitude=[(t, a * factor) for t, a in v.amplitude]) for v in self.voices],
            [(t, a * factor, f) for t, a, f in self.taps],
            self.notes,
        )


@public
@dataclass(frozen=True)
class PatternDevice:
    """How the numbers of a pattern, 0 to 1, stand for vibration of a device.

    Parameters
    ----------
    full_scale : float, optional
        Amplitude that is 1 in the file, in the unit. By default 1 where a pattern is
        read, and the largest amplitude where one is written.
    unit : str
        Of the output of a pattern that is read, such as ``"m/s^2"``.
    f_lo, f_hi : float
        Frequencies of sharpness (or of normalised frequency) 0 and 1, in Hz; straight
        between. The defaults are those of MPEG's encoder of AHAP files.
    decay : float
        Time constant of a transient's ring in s. By default 5 % are left after 22 ms,
        which is the length of a transient of MPEG's reference software.
    power : float
        Of AHAP: amplitude = intensity^power. MPEG's encoder has 1, NiceVibrations 2.

    Raises
    ------
    BadValue
        A number that is not finite and above 0, or ``f_lo`` not below ``f_hi``.

    Examples
    --------
    >>> from stimlib.files import PatternDevice
    >>> PatternDevice(f_lo=80, f_hi=230).hertz(0.5)
    155.0
    """

    full_scale: Above0 | None = None
    unit: str = ""
    f_lo: Above0 = 65.0
    f_hi: Above0 = 300.0
    decay: Above0 = 0.0073
    power: Above0 = 1.0

    def __post_init__(self) -> None:
        if self.f_lo >= self.f_hi:
            raise BadValue(
                f"f_lo = {self.f_lo:g} Hz is not below f_hi = {self.f_hi:g} Hz; swap them"
            )

    def hertz(self, part: float) -> float:
        """Return the frequency of a sharpness, 0 to 1, in Hz."""
        return self.f_lo + part * (self.f_hi - self.f_lo)

    def part(self, hertz: float) -> float:
        """Return the sharpness of a frequency, limited to 0 .. 1."""
        return min(1.0, max(0.0, (hertz - self.f_lo) / (self.f_hi - self.f_lo)))


def block_of(pattern: Pattern, full_scale: float, device: PatternDevice) -> Block:
    """Return a pattern as a block: timelines, oscillators, and a ring for all taps."""
    total, loud = constant(0.0, device.unit), pattern.scaled(full_scale)
    for line, frequency, shape, phase in loud.voices:
        edges = [(line[0][0], 0.0), *line, (line[-1][0], 0.0)]
        wave = timeline(edges, unit=device.unit)
        if frequency:  # it does not turn before, so that its phase is that of its beginning
            turning = timeline([(line[0][0], 0.0), *frequency], unit="Hz")
            wave = wave * oscillator(turning, shape, phase=phase)
        total = total + wave
    if not loud.taps:
        return total
    joint: dict[float, Point] = {}  # those at one time add up
    for t, a, f in sorted(loud.taps):
        joint[t] = joint.get(t, (0.0, 0.0))[0] + a, f
    times = list(joint)
    set_at = [times[0], *(b - min(SOON, (b - a) / 2) for a, b in pairwise(times))]
    height, turning = (
        timeline(zip(set_at, values, strict=True), "step", unit)
        for values, unit in zip(zip(*joint.values(), strict=True), (device.unit, "Hz"), strict=True)
    )
    return total + ring(at(times) * height, turning, device.decay)
