"""Units of signals: coherent SI units without prefixes.

Only the exponents are kept; pint knows what is no product of the usual names.
"""

from __future__ import annotations

import math
import re
from functools import cache, lru_cache

from ..errors import UnitError, public
from ..system.cache_folder import lock

_SHOWN = (
    "m",
    "s",
    "N",
    "V",
    "A",
    "m/s",
    "m/s**2",
    "N/m",
    "N*s/m",
    "N/s",
    "V/m",
    "kg",
    "Pa",
    "N*m",
    "W",
    "N/A",
    "N**2",
    "m**2",
    "s/m",
)
_BASE = ("kilogram", "meter", "second", "ampere")
_SHORT = dict(zip(_BASE, ("kg", "m", "s", "A"), strict=True))
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# powers of these: products of these names need no pint, which takes longer to load than
# the rest of a start
_POWERS = """
    kg   1  0  0  0
    m    0  1  0  0
    s    0  0  1  0
    A    0  0  0  1
    N    1  1 -2  0
    Pa   1 -1 -2  0
    J    1  2 -2  0
    W    1  2 -3  0
    V    1  2 -3 -1
    Hz   0  0 -1  0
    rad  0  0  0  0
    1    0  0  0  0
"""
_ROWS = map(str.split, _POWERS.strip().splitlines())
_SI = {name: tuple(map(int, powers)) for name, *powers in _ROWS}
_FACTOR = re.compile(rf"([*/])({'|'.join(_SI)})(?:\*\*([1-9]))?(?![\w.]|\*\*)")


class Unit:
    """A product of powers of SI base units.

    Compare units with ``==``; multiply, divide and raise them to powers with the usual
    operators. ``str`` gives the common name where there is one (``"N"``) and base units
    otherwise; an f-string prints it for readers (``N·s/m``). The unit N m, of a torque
    or an energy, is ``"N*m"``, which is right for both.

    Examples
    --------
    >>> from stimlib.core.units import unit
    >>> str(unit("N/m") * unit("m"))
    'N'
    >>> str(unit("m/s") / unit("s")), f"{unit('m/s') / unit('s')}"
    ('m/s**2', 'm/s²')
    """

    __slots__ = ("powers",)

    def __init__(self, powers: tuple[tuple[str, float], ...]):
        self.powers = powers  # sorted ((base unit, exponent), ...), no zero exponents

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Unit) and self.powers == other.powers

    def __hash__(self) -> int:
        return hash(self.powers)

    def __mul__(self, other: Unit) -> Unit:
        _is_unit(other)
        return _combine(self, other, 1.0)

    def __truediv__(self, other: Unit) -> Unit:
        _is_unit(other)
        return _combine(self, other, -1.0)

    def __pow__(self, n: float) -> Unit:
        return _combine(ONE, self, n)

    def __str__(self) -> str:
        return _names().get(self) or "*".join(
            u if p == 1 else f"{u}**{p:g}" for u, p in self.powers
        )

    def __format__(self, spec: str) -> str:
        """Return the unit for readers; ``str`` is for files."""
        text = (
            str(self)
            if self in _names()
            else "*".join(_SHORT.get(u, u) + (f"**{p:g}" if p != 1 else "") for u, p in self.powers)
        )
        return format(pretty(text), spec)

    def __repr__(self) -> str:
        return f"unit({str(self)!r})"


def pretty(text: str) -> str:
    """Return the name of a unit as it is printed for readers.

    Examples
    --------
    >>> from stimlib.core.units import pretty
    >>> pretty("N*s/m**2")
    'N·s/m²'
    """
    text = re.sub(r"(?:\*\*|\^)(-?\d+)(?![\d.])", lambda m: m[1].translate(_RAISED), text)
    return text.replace("**", "^").replace("*", "·")


def _is_unit(v: object) -> None:
    if not isinstance(v, Unit):
        raise UnitError(f"{v!r} is not a unit: write unit({str(v)!r}), from stimlib.core.units")


ONE = Unit(())
# pint computes a text, for hours if it is 9**9**9**9; scene files come from others
_HUGE = re.compile(r"[\d.]\s*(\*\*|\^)|\d[eE]|(?<![\d.])\d{3}")
_OF_GROUP = re.compile(r"\)\s*(\*\*|\^)")
# Nm; pint reads it as a number of yarns
_JOINED = re.compile(r"(?<![A-Za-z])([NVAWJ])([ms])(?![A-Za-z])")
# pint has a factor for them
_LEVEL = re.compile(r"(?<![A-Za-z])(dB[A-Za-z]*|decibel|neper|Np)(?![A-Za-z])")


@lru_cache(maxsize=4096)
def _combine(a: Unit, b: Unit, n: float) -> Unit:
    total = dict(a.powers)
    for name, p in b.powers:
        total[name] = total.get(name, 0.0) + n * p
    return Unit(tuple(sorted((k, v) for k, v in total.items() if v)))


@cache
def _names() -> dict[Unit, str]:
    return {ONE: "1", unit("1/s"): "1/s", **{unit(s): s for s in _SHOWN}}


@cache
def _registry():
    with lock:  # a fork waits until it is loaded
        import pint  # here, because it takes longer to load than the rest of stimlib together

        return pint.UnitRegistry()


@public
def unit(text: str) -> Unit:
    """Parse the name of a coherent SI unit.

    Parameters
    ----------
    text : str
        Such as ``"m"``, ``"N/m"``, ``"N*s/m"``; ``""`` and ``"1"`` mean no unit.

    Raises
    ------
    UnitError
        If the name is unknown, or carries a prefix or factor (``"mm"``: use ``"m"``).

    Examples
    --------
    >>> from stimlib.core.units import unit
    >>> unit("N*s/m") == unit("kg/s")
    True
    """
    if not isinstance(text, str):
        raise UnitError(f"a unit is a text such as 'N/m', got {type(text).__name__} {text!r:.40}")
    return ONE if text in ("", "1") else _parsed(text)


@cache
def _parsed(text: str) -> Unit:
    if len(text) > 100 or _HUGE.search(text) or len(_OF_GROUP.findall(text)) > 1:
        raise UnitError(
            f"unit {text[:40]!r} is not a product of SI names with small powers, such as 'N*s/m' or"
            " 'm**2'"
        )
    if not _FACTOR.sub("", "*" + text):
        factors = [
            (_SI[name], int(n or 1) * (1 if op == "*" else -1))
            for op, name, n in _FACTOR.findall("*" + text)
        ]
        total = [float(sum(n * powers[i] for powers, n in factors)) for i in range(len(_BASE))]
        return Unit(tuple(sorted((name, p) for name, p in zip(_BASE, total, strict=True) if p)))
    if (product := _JOINED.sub(r"\1*\2", text)) != text:
        raise UnitError(f"unit {text!r}: a product is written with a *; use {product!r}")
    if level := _LEVEL.search(text):
        raise UnitError(
            f"unit {text!r}: {level[1]} is a logarithm of a ratio; give the ratio, 10**(dB/20),"
            " without unit"
        )
    factor, powers = in_base_units(text)
    if not math.isfinite(factor) or any(not math.isfinite(p) for _, p in powers):
        raise UnitError(f"unit {text!r} is not a finite product of SI names")
    if abs(factor - 1.0) > 1e-12:
        plain = Unit(powers)
        if "dB" in text or "decibel" in text:
            raise UnitError(
                f"unit {text!r} is a level, not a unit: give 10**(dB/20) times the reference, in"
                " its unit"
            )
        raise UnitError(
            f"unit {text!r} is {factor:g} {plain}: inside stimlib everything is coherent SI without"
            f" prefixes; use {str(plain)!r} and multiply your numbers by {factor:g}"
        )
    return Unit(powers)


def in_base_units(text: str) -> tuple[float, tuple[tuple[str, float], ...]]:
    """Return a unit's factor to base units, and the power of each base unit."""
    try:
        base = _registry().Quantity(1.0, text).to_base_units()
        powers = {str(name): float(p) for name, p in base.unit_items()}
        powers.pop("radian", None)
        return float(base.magnitude), tuple(sorted(powers.items()))
    # pint computes the text as a formula: any error may come, a division by 0 too
    except Exception as e:
        powers_written = re.sub(r"(?<=[A-Za-z])(?=\d)", "**", text)
        hint = f"write {powers_written!r}, or " if powers_written != text else ""
        raise UnitError(
            f"unknown unit {text!r}: {hint}use SI names such as 'm', 's', 'N', 'V', 'A', 'N/m'"
            f" ({e})"
        ) from None
