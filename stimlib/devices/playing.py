"""Playback of a rendering on a device, as ``Rendering.play``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..core.graph import Input
from ..core.scene import Scene
from ..errors import one_of, public
from ..run.rendering import Rendering
from ..run.safety import Safety, quiet_scale
from .available import SINKS, first_ready, make
from .session import SessionReport


@public
def play(
    result: Rendering,
    sink: str | None = None,
    full_scale: float | Mapping[str, float] | None = None,
    channels: int | Sequence[str | None] | None = None,
    **options: Any,
) -> SessionReport:
    """Play a rendering to its end, with the limits and fades of a sink.

    Parameters
    ----------
    result : Rendering
        Its sample rate must be one that the device has.
    sink : {"null", "jack", "portaudio", "nidaq"}, optional
        By default that of ``first_ready``: a JACK server or else a PortAudio device
        that is ready, and null if there is none.  NI-DAQ must be named.
    full_scale : float or dict of str to float, optional
        The value, in each output's unit, that is 1.0 at the device; nothing goes
        beyond.  Outputs without a unit play 20 dB below it by default.
    channels : int or sequence of str or None, optional
        As for ``Sink.open``.
    **options
        Options of the sink, such as ``name`` of a PortAudio device, ``log`` or
        ``calibration``, with which ``full_scale`` may be left out.

    Returns
    -------
    SessionReport

    Raises
    ------
    BadValue
        An unknown sink; no full scale, for outputs with a unit.
    SinkError
        The device is not there, has another sample rate, or has failed.

    Examples
    --------
    >>> import stimlib
    >>> from stimlib.scenes import tone
    >>> result = stimlib.render(tone(freq=80.0), fs=8000, seconds=0.1)
    >>> result.play(sink="null", clocked=False).delivered
    800
    """
    name = first_ready().sink if sink is None else sink
    one_of("play: sink", name, SINKS)
    scene = Scene({n: Input(n, unit) for n, unit in result.units.items()})
    safety = None if full_scale is None else Safety(full_scale)
    if safety is None and options.get("calibration") is None:
        safety = Safety(quiet_scale(scene))
    with make(
        name, scene, safety, motion={n: result[n] for n in result.outputs}, **options
    ) as playing:
        playing.open(result.fs, channels)
        playing.start()
        playing.wait()
    return playing.report()
