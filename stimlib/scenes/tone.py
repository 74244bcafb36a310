"""A first vibration: bursts of a sinusoid, and pulses, at given times."""

from __future__ import annotations

import numpy as np

from ..blocks import active, at, burst, carrier, every
from ..core.graph import Block
from ..core.parameter import Param
from ..core.scene import Scene
from ..core.units import unit as unit_of
from ..errors import BadValue
from ..system.limits import limits
from .shipped import above_zero, shipped


def bursts(scene: str, duration: float, ramp: float, period: float, repeats: int | None) -> Block:
    """Return the envelope of repeated bursts, the first of which starts at sample 0."""
    count = 1 if repeats is None else repeats
    above_zero(scene, duration=duration, period=period, repeats=count)
    limits.check("table_knots", count, f"{scene}: repeats")
    if period < duration and repeats != 1:
        raise BadValue(
            f"{scene}: period = {period:g} s must be at least duration = {duration:g} s: a burst"
            " ends before the next begins"
        )
    starts = every(period) if repeats is None else at(period * np.arange(count))
    return burst(starts, duration, ramp)


def on_channels(scene: str, y: Block, channels: int, power: float) -> dict[str, Block]:
    """Return an output for each channel, all of them the same signal.

    A force states the power in W that it gives to a hand of 1 N s/m.
    """
    above_zero(scene, channels=channels)
    limits.check("recording_columns", channels, f"{scene}: channels")
    y = active(y, power) if y.dim == unit_of("N") and power > 0 else y
    names = ["signal"] if channels == 1 else [f"signal{i}" for i in range(channels)]
    return dict.fromkeys(names, y)


@shipped(
    felt=("A vibration of one frequency, in bursts or without end."),
    do="turn the sound on",
    words=(
        "y = amplitude e(t) sin(2 pi freq t); e rises and falls as a raised cosine over ramp, once"
        " in each period, over duration (our own)"
    ),
    drive={},
    ranges={"amplitude": (0.0, 1.0), "freq": (20.0, 1000.0)},
)
def tone(
    freq: float = 250.0,
    amplitude: float = 0.5,
    duration: float = 0.5,
    ramp: float = 0.01,
    period: float = 1.0,
    repeats: int | None = None,
    channels: int = 1,
    unit: str = "",
) -> Scene:
    """Compose a vibration of one frequency, once or repeatedly.

    y = amplitude e(t) sin(2 pi freq t).

    Parameters
    ----------
    freq : float
        Frequency in Hz, live as ``freq``.
    amplitude : float
        Peak in the unit of the outputs, live as ``amplitude``.
    duration : float
        From the first sample to the last of a burst, in s.
    ramp : float
        Time in s over which each burst rises, and falls, as a raised cosine.
    period : float
        From the start of a burst to that of the next, in s.
    repeats : int or None
        Number of bursts; by default they go on until it is stopped.
    channels : int
        Number of equal outputs: ``signal``, or ``signal0``, ``signal1``, ..
    unit : str
        Unit of the outputs, such as ``"m/s^2"``; by default none, a part of full scale.
        In N they state by ``active`` what a hand with a damping of 1 N s/m gets while a
        burst lasts: amplitude^2/2.

    Returns
    -------
    Scene
        No input, ``channels`` outputs in ``unit``.

    Raises
    ------
    BadValue
        A number that is not above 0, a ramp longer than half the duration, a period
        shorter than the duration; at compile time, a frequency not below fs/2.

    Notes
    -----
    The sinusoid runs on between the bursts.  Each begins at phase 0 where ``freq``
    times ``period`` is a whole number.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.scenes import tone
    >>> tone(freq=80.0, amplitude=2.0, unit="m/s^2")
    Scene(amplitude [m/s²], freq [1/s] -> signal [m/s²])
    >>> y = stimlib.render(
    ...     tone(duration=0.1, repeats=2, period=0.2), fs=8000, seconds=0.5
    ... )
    >>> [bool(abs(part).max() > 0.49) for part in y["signal"].reshape(5, -1)]
    [True, False, True, False, False]
    """
    e = bursts("tone", duration, ramp, period, repeats)
    y = Param("amplitude", amplitude, unit) * e * carrier(Param("freq", freq, "Hz"))
    return Scene(on_channels("tone", y, channels, amplitude * amplitude / 2))


@shipped(
    felt="A short push, once or repeated.",
    do="turn the sound on",
    words=(
        "y = amplitude e(t); e is 1 over duration, once in each period, and rises and falls as a"
        " raised cosine over ramp (our own)"
    ),
    drive={},
    ranges={"amplitude": (0.0, 1.0)},
)
def pulse(
    amplitude: float = 0.5,
    duration: float = 0.005,
    ramp: float = 0.0,
    period: float = 0.5,
    repeats: int | None = None,
    channels: int = 1,
    unit: str = "",
) -> Scene:
    """Compose a pulse, once or repeatedly.

    Parameters
    ----------
    amplitude : float
        Height in the unit of the outputs, live as ``amplitude``.
    duration : float
        Duration of each pulse with its ramps, in s.
    ramp : float
        Time in s over which it rises, and falls, as a raised cosine; 0 is a rectangle,
        and half the duration a Hann window.
    period : float
        From the start of a pulse to that of the next, in s.
    repeats : int or None
        Number of pulses; by default they go on until it is stopped.
    channels : int
        Number of equal outputs: ``signal``, or ``signal0``, ``signal1``, ..
    unit : str
        Unit of the outputs, such as ``"N"``; by default none, a part of full scale.
        In N they state by ``active`` what a hand with a damping of 1 N s/m gets while a
        pulse lasts: amplitude^2.

    Returns
    -------
    Scene
        No input, ``channels`` outputs in ``unit``.

    Raises
    ------
    BadValue
        A number that is not above 0, a ramp longer than half the duration, a period
        shorter than the duration; at compile time, a duration of less than half a
        sample.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.scenes import pulse
    >>> y = stimlib.render(pulse(duration=0.002, amplitude=1.0), fs=1000, seconds=0.005)
    >>> y["signal"]
    array([1., 1., 0., 0., 0.])
    """
    y = Param("amplitude", amplitude, unit) * bursts("pulse", duration, ramp, period, repeats)
    return Scene(on_channels("pulse", y, channels, amplitude * amplitude))
