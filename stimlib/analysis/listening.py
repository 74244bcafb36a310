"""Listening copies: audible versions of the vibration in an output."""

from __future__ import annotations

import os
from math import comb

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..core.graph import unmasked
from ..errors import BadValue, computed, public
from ..files.audio import write_frames
from ..files.sidecar import FileReport
from ..run.rendering import Rendering

CUTOFF = 40.0  # Hz: what is slower is no vibration
ORDER = 4
PEAK = 0.5  # of full scale, -6 dBFS
FADE = 0.01  # s at both ends, or they would click


@public
@computed
def vibration(y: ArrayLike, fs: float, cutoff: float = CUTOFF) -> np.ndarray:
    """Return the part of a signal above a cutoff frequency, without delay.

    It is the signal minus a penalised smoothing spline.

    Between its ends this is a Butterworth high-pass of order 4, forwards and backwards.
    Nothing is assumed about the signal beyond its ends, so a force that is cut off
    mid-movement leaves no transient. In the first and last half period of the cutoff,
    slow and fast parts cannot be separated: a tone of 4 times the cutoff is wrong there
    by up to 0.65 of its amplitude in the very last sample, and by 0.1 from a quarter
    period on.

    Corners of a smooth force contain fast components. Where the third derivative jumps
    by J, they leave up to 0.14 J/(2 pi cutoff)**3: above 40 Hz 0.8 mN of a minimum-jerk
    squeeze of 20 mm in 0.3 s on 2000 N/m, compared with a vibration of 140 mN (0.6 %);
    above 20 Hz it is 6 mN. In a pulse that never falls below 0, such as the half waves
    of a bump, the mean counts as slow.

    Parameters
    ----------
    y : array_like, shape (n,)
        A signal, in any unit. In a signal shorter than 2/3 period of the cutoff, the
        slow part is a straight line.
    fs : float
        Sample rate in Hz.
    cutoff : float
        In Hz; the amplitude there is halved, and falls by 48 dB per octave below.  By
        default 40 Hz, where flutter ends and vibration begins (Talbot et al. 1968).

    Returns
    -------
    ndarray, shape (n,)
        In the signal's unit.

    Raises
    ------
    BadValue
        No cutoff between 0 and fs/2.

    References
    ----------
    P. H. C. Eilers and B. D. Marx, "Flexible smoothing with B-splines and penalties",
    Statist. Sci. 11 (1996). W. H. Talbot, I. Darian-Smith, H. H. Kornhuber and V. B.
    Mountcastle, "The sense of flutter-vibration", J. Neurophysiol. 31 (1968).

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.analysis import vibration
    >>> t = np.arange(8000) / 8000
    >>> tone = 0.01 * np.sin(2 * np.pi * 200 * t)
    >>> bool(abs(vibration(40 * t + tone, 8000) - tone)[800:-800].max() < 1e-4)
    True
    """
    if not 0 < cutoff < fs / 2:
        raise BadValue(f"cutoff = {cutoff!r} Hz must be above 0 and below fs/2 = {fs / 2:g} Hz")
    y = unmasked(y)
    if y.ndim != 1 or not y.size:
        raise BadValue(f"vibration: y must be a row of numbers, got shape {y.shape}")
    step = max(1, round(fs / cutoff / 6))  # samples between two knots
    scale = np.abs(y).max() or 1.0  # sums of huge numbers are finite
    if y.size <= ORDER * step:
        return scale * scipy.signal.detrend(y / scale)
    spline = np.ones(1)
    for _ in range(6):  # of degree 5
        spline = np.convolve(spline, np.ones(step) / step)
    # of splines d samples apart
    pairs = [spline[: spline.size - d] * spline[d:] for d in range(0, spline.size, step)]
    want = _decimated(spline, y / scale, step)
    w = 2 * np.pi * cutoff * step / fs
    level = pairs[0].sum() + 2 * sum(p.sum() * np.cos(w * d) for d, p in enumerate(pairs[1:], 1))
    penalty = level / (2 * np.sin(w / 2)) ** (2 * ORDER)  # as much as the fit at the cutoff
    a = np.array([(-1.0) ** k * comb(ORDER, k) for k in range(ORDER + 1)])
    matrix = np.zeros((max(len(pairs), ORDER + 1), want.size))
    for d, pair in enumerate(pairs):
        matrix[d, : want.size - d] += _decimated(pair, np.ones(y.size), step)
    for d in range(ORDER + 1):
        matrix[d, : want.size - d] += penalty * np.convolve(
            np.ones(want.size - ORDER), a[: a.size - d] * a[d:]
        )
    c = scipy.linalg.solveh_banded(matrix, want, lower=True, check_finite=False)
    # one row for each knot, with what its neighbours add to the samples behind it
    near = np.lib.stride_tricks.sliding_window_view(np.pad(c, (5, 0)), 6)[:, ::-1]
    slow = near @ np.pad(spline, (0, 6 * step - spline.size)).reshape(6, step)
    return y - scale * slow.ravel()[spline.size - 1 :][: y.size]


def _decimated(h: np.ndarray, y: np.ndarray, step: int) -> np.ndarray:
    """Return every step-th sample of the convolution of h and y.

    `scipy.signal.upfirdn` does so too; its import takes more than a minute of samples.
    """
    rows, size = -(-h.size // step), -(-(h.size + y.size - 1) // step)
    h = np.pad(h, (0, rows * step - h.size))[::-1].reshape(rows, step)
    y = np.pad(y, (rows * step - 1, size * step + 1 - y.size))
    parts = y[: (size + rows - 1) * step].reshape(-1, step) @ h.T
    return sum(parts[k : k + size, k] for k in range(rows))


@public
def listen(
    rendering: Rendering, output: str, path: str | os.PathLike, cutoff: float = CUTOFF
) -> FileReport:
    """Write a listening copy (an audible version) of one output.

    The slow part is removed, the peak is at -6 dBFS, and both ends are faded.

    Use it for listening only: the levels of two copies are not comparable, and a copy
    must not be played on a haptic device.

    Parameters
    ----------
    rendering : Rendering
    output : str
        Name of the output.
    path : path
        A format that holds floats, such as NAME-listen.wav; the sidecar has the
        amplification.
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
        The output has nothing above the cutoff, or the cutoff is not between 0 and
        fs/2.
    SinkError
        The place cannot be written, or fs is not a whole number.

    Examples
    --------
    >>> import tempfile, stimlib
    >>> from stimlib.analysis import listen
    >>> from stimlib.motion import minimum_jerk
    >>> squeezed = stimlib.render(
    ...     stimlib.scenes.squeeze(fingers=1),
    ...     {"x1": minimum_jerk()},
    ...     fs=8000,
    ...     seconds=1.0,
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     copy = listen(squeezed, "force1", folder + "/squeeze-listen.wav")
    >>> peak, most = copy.peak["force1 above 40 Hz"], squeezed["force1"].max()
    >>> print(f"{peak:.2f} N of {most:.0f} N")
    1.25 N of 40 N
    """
    whole = rendering[output]
    y = vibration(whole, rendering.fs, cutoff)
    ends = np.minimum(np.arange(1, y.size + 1), np.arange(y.size, 0, -1)) / max(
        1.0, FADE * rendering.fs
    )
    y *= np.minimum(ends, 1.0)
    top = float(np.abs(y).max())
    if top <= 1e-12 * np.abs(whole).max():  # what rounding leaves of a force that does not vibrate
        raise BadValue(
            f"output {output} has nothing above {cutoff:g} Hz to listen to: give a lower cutoff, or"
            " look at its picture"
        )
    scale = top / PEAK
    unit = str(rendering.scene.outputs[output].dim)
    channel = {"name": f"{output} above {cutoff:g} Hz", "unit": unit, "full_scale": scale}
    info = {"fs": rendering.fs, "frames": y.size, "channels": [channel]}
    return write_frames(path, [(y[:, None] / scale).astype(np.float32)], info)
