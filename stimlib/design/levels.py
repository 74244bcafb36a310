"""Amplitudes from levels as papers state them: RMS, peak to peak, dB."""

from __future__ import annotations

import math
import re

from ..core.units import in_base_units, pretty, unit as unit_of
from ..errors import BadValue, UnitError, public

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_POWER = r"[A-Za-zµ]+(?:_0)?(?:(?:\^|\*\*)-?[1-9])?"
_LEVEL = re.compile(
    rf"\s*(?P<number>{_NUMBER})\s*(?:(?P<db>dB)\s*(?:(?P<sl>SL)|re\s*(?P<reference>{_NUMBER})))?"
    rf"\s*(?P<unit>(?!(?:rms|pp|peak)\b)(?:1/)?{_POWER}(?:\s*[*/]\s*{_POWER})*?)?"
    r"\s*(?:\b(?P<kind>rms|pp|peak))?\s*",
    re.IGNORECASE,
)
_ANGLE = re.compile(r"rad|deg|rpm|rev|turn|cycle", re.IGNORECASE).search
PEAK = {None: 1.0, "peak": 1.0, "rms": math.sqrt(2.0), "pp": 0.5}


@public
def amplitude(level: str, unit: str, threshold: float | None = None) -> float:
    """Return the peak amplitude of a sinusoid from its level in one of the usual forms.

    Parameters
    ----------
    level : str
        ``"2 m/s^2"``, ``"2 m/s^2 rms"``, ``"5 um pp"``, ``"20 dB re 1 um"``, which is
        of peaks, ``"20 dB re 1 um rms"``, or ``"15 dB SL"``: above the threshold.  The
        acceleration of gravity is ``g_0``; ``g`` is a gram.
    unit : str
        SI, of the amplitude that is returned.
    threshold : float, optional
        Peak amplitude at the threshold of detection, in ``unit``; dB SL needs it.

    Returns
    -------
    float
        In ``unit``.

    Raises
    ------
    BadValue
        A text of another form; dB over a reference that is not above 0; dB SL without
        a threshold, or one not above 0.
    UnitError
        A level in another unit; a frequency in rad/s for one in Hz, or the other way
        round, or with RMS or dB.

    Examples
    --------
    >>> from stimlib.design.levels import amplitude
    >>> print(f"{amplitude('2 m/s^2 rms', 'm/s^2'):.4f} m/s^2")
    2.8284 m/s^2
    >>> print(f"{amplitude('20 dB re 1 um', 'm'):.1e} m")
    1.0e-05 m
    >>> print(f"{amplitude('15 dB SL', 'm', threshold=0.1e-6):.2e} m")
    5.62e-07 m
    """
    said = _LEVEL.fullmatch(level)
    value, over = (float(said[k] or 1) if said else math.nan for k in ("number", "reference"))
    if said is None or not (abs(value) <= (6000 if said["db"] else 1e308) and 0 < over < 1e308):
        raise BadValue(
            f"amplitude: {level[:60]!r} is not a level; write it as '2 m/s^2 rms', '5 um pp',"
            " '20 dB re 1 um' or '15 dB SL'"
        )
    if said["sl"]:
        if threshold is None or not threshold > 0 or said["unit"] or said["kind"]:
            raise BadValue(
                f"amplitude: {level[:60]!r} is above a threshold: give threshold=, its peak"
                f" amplitude in {pretty(unit)}, above 0, and write nothing after SL"
            )
        return threshold * 10.0 ** (value / 20)
    factor, powers = in_base_units((said["unit"] or "1").replace("^", "**"))
    turns = bool(_ANGLE(said["unit"] or "")) != bool(_ANGLE(unit)) or said["kind"] or said["db"]
    if powers != unit_of(unit).powers or (turns and powers == unit_of("Hz").powers):
        raise UnitError(
            f"amplitude: {level[:60]!r} is not in {pretty(unit) or '1'}, nor a multiple of it"
            + " (1 Hz is 2 pi rad/s)" * (powers == unit_of("Hz").powers)
        )
    if said["db"]:
        value = over * 10.0 ** (value / 20)
    kind = said["kind"]
    return value * factor * PEAK[kind and kind.lower()]
