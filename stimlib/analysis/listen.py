"""Copies for ears: what vibrates in an output, without the slow force that it rides on, at a level that can be heard."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BadValue
from ..files.audio import write_frames
from ..files.sidecar import FileReport
from ..run.rendering import Rendering

PEAK = 0.5  # of full scale, -6 dBFS
FADE = 0.01  # s at both ends, or they would click


def vibration(y: ArrayLike, fs: float, cutoff: float = 20.0) -> np.ndarray:
    """What a signal has above a frequency, without delay: a Butterworth high-pass, forwards and backwards.

    Parameters
    ----------
    y : array_like, shape (n,)
        A signal, in any unit.
    fs : float
        Sample rate in Hz.
    cutoff : float
        In Hz; the amplitude there is halved, and falls by 48 dB per octave below.

    Returns
    -------
    ndarray, shape (n,)
        In the signal's unit.

    Raises
    ------
    BadValue
        No cutoff between 0 and fs/2.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis.listen import vibration
    >>> t = np.arange(8000) / 8000
    >>> tone = 0.01 * np.sin(2 * np.pi * 200 * t)
    >>> bool(abs(vibration(40 * t + tone, 8000) - tone)[800:-800].max() < 1e-4)
    True
    """
    from scipy.signal import butter, sosfiltfilt

    if not 0 < cutoff < fs / 2:
        raise BadValue(f"cutoff = {cutoff!r} Hz must be above 0 and below fs/2 = {fs / 2:g} Hz")
    y = np.asarray(y, np.float64)
    # odd extension by a period and a half, so that a ramp or a force that is held does not ring at the ends
    return sosfiltfilt(butter(4, cutoff, "highpass", fs=fs, output="sos"), y, padlen=min(round(1.5 * fs / cutoff), y.size - 1))


def listen(rendering: Rendering, output: str, path: str | os.PathLike, cutoff: float = 20.0) -> FileReport:
    """Write a copy of one output for ears: the slow part removed, its peak at -6 dBFS, faded at both ends.

    It is for listening only: levels of two copies cannot be compared, and no device should be given one.

    Parameters
    ----------
    rendering : Rendering
    output : str
        Name of the output.
    path : path
        A format that holds floats, such as NAME-listen.wav; the sidecar has the amplification.
    cutoff : float
        In Hz, see ``vibration``.

    Returns
    -------
    FileReport
        Its ``peak`` is that of the vibration, in the output's unit.

    Raises
    ------
    UnknownName
        No such output.
    BadValue
        The output has nothing above the cutoff, or the cutoff is not between 0 and fs/2.
    SinkError
        The place cannot be written, or fs is not a whole number.

    Examples
    --------
    >>> import tempfile, stimlib
    >>> from stimlib.analysis.listen import listen
    >>> from stimlib.motion.generators import minimum_jerk
    >>> squeezed = stimlib.render(stimlib.scenes.squeeze(fingers=1), {"x1": minimum_jerk()}, fs=8000, seconds=1.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     copy = listen(squeezed, "force1", folder + "/squeeze-listen.wav")
    >>> print(f"{copy.peak['force1 above 20 Hz']:.2f} N of {squeezed['force1'].max():.0f} N")
    0.14 N of 40 N
    """
    whole = rendering[output]
    y = vibration(whole, rendering.fs, cutoff)
    ends = np.minimum(np.arange(1, y.size + 1), np.arange(y.size, 0, -1)) / max(1.0, FADE * rendering.fs)
    y *= np.minimum(ends, 1.0)
    top = float(np.abs(y).max())
    if top <= 1e-12 * np.abs(whole).max():  # what rounding leaves of a force that does not vibrate
        raise BadValue(
            f"output {output} has nothing above {cutoff:g} Hz to listen to: give a lower cutoff, or look at its picture"
        )
    scale = top / PEAK
    unit = str(rendering.scene.outputs[output].dim)
    channel = {"name": f"{output} above {cutoff:g} Hz", "unit": unit, "full_scale": scale}
    info = {"fs": rendering.fs, "frames": y.size, "channels": [channel]}
    return write_frames(path, [(y[:, None] / scale).astype(np.float32)], info)
