"""Units: a dimension is powers of mV, ms and pA, in which all values are computed.

These three fit each other: pA/mV is nS, pA ms/mV is pF, mV/pA is GOhm, 1/ms is kHz.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import TypeAlias

from neuro.core.errors import ModelError
from neuro.model.equations.grammar import Binary, Call, Expression, Name, Negative, Number, Tree, mistake, parse

Dimension: TypeAlias = tuple[Fraction, Fraction, Fraction]
"""Powers of mV, ms and pA."""


def _dimension(mv: int, ms: int, pa: int) -> Dimension:
    return Fraction(mv), Fraction(ms), Fraction(pa)


NONE = _dimension(0, 0, 0)
VOLTAGE, TIME, CURRENT = _dimension(1, 0, 0), _dimension(0, 1, 0), _dimension(0, 0, 1)
CONDUCTANCE = _dimension(-1, 0, 1)
UNITS: Mapping[str, tuple[float, Dimension]] = {
    name: (factor, dimension)
    for dimension, units in (
        (VOLTAGE, {"mV": 1.0, "V": 1e3, "uV": 1e-3}),
        (TIME, {"ms": 1.0, "s": 1e3, "us": 1e-3}),
        (CURRENT, {"pA": 1.0, "nA": 1e3, "uA": 1e6}),
        (CONDUCTANCE, {"nS": 1.0, "uS": 1e3, "mS": 1e6, "pS": 1e-3}),
        (_dimension(-1, 1, 1), {"pF": 1.0, "nF": 1e3, "uF": 1e6}),
        (_dimension(1, 0, -1), {"GOhm": 1.0, "MOhm": 1e-3, "kOhm": 1e-6}),
        (_dimension(0, -1, 0), {"kHz": 1.0, "Hz": 1e-3}),
    )
    for name, factor in units.items()
}
"""What one of a unit is in mV, ms and pA, and its dimension."""

_NAMES = {dimension: name for name, (factor, dimension) in UNITS.items() if factor == 1.0 and name != "kHz"}
_MEASURED = re.compile(r"\s*([-+]?(?:inf\b|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))\s*(.*)", re.S | re.ASCII)


def times(a: Dimension, b: Dimension, power: Fraction | int = 1) -> Dimension:
    """The dimension of a product of `a` and a power of `b`."""
    return a[0] + power * b[0], a[1] + power * b[1], a[2] + power * b[2]


def unit_of(dimension: Dimension) -> str:
    """How a dimension is written: "mV", "pA/ms", "1/(mV ms)"; "" for none."""
    if dimension == NONE:
        return ""
    if dimension in _NAMES:
        return _NAMES[dimension]
    if times(dimension, TIME) in _NAMES:
        return f"{_NAMES[times(dimension, TIME)]}/ms"
    powers = dict(zip(("mV", "ms", "pA"), dimension, strict=True))
    over = [_power(name, power) for name, power in powers.items() if power > 0]
    under = [_power(name, -power) for name, power in powers.items() if power < 0]
    if not under:
        return " ".join(over)
    return f"{' '.join(over) or '1'}/{under[0] if len(under) == 1 else '(' + ' '.join(under) + ')'}"


def _power(name: str, power: Fraction) -> str:
    return name if power == 1 else f"{name}^{power}"


def told(dimension: Dimension) -> str:
    """A dimension in a sentence."""
    return f"in {unit_of(dimension)}" if dimension != NONE else "without unit"


def measured(value: object) -> tuple[float, str]:
    """A number and its unit from `281 pF`, `0.04 1/(mV*ms)`, `-70 mV` or a number.

    Raises:
        ModelError: it is none of these.
    """
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), ""
    found = _MEASURED.fullmatch(value) if isinstance(value, str) else None
    text = found[2].strip() if found else ""
    if found is None or text.startswith("*"):
        hint = f"write {found[1]} {text.lstrip('* ')}" if found else ""
        raise ModelError(f"found {value!r:.40}: expected a number with its unit, e.g. 281 pF", hint=hint)
    return float(found[1]), text


def unit(text: str) -> tuple[float, Dimension]:
    """What one of a unit is in mV, ms and pA, and its dimension.

    Raises:
        ModelError: it is no unit; it tells the column.
    """
    if not text:
        return 1.0, NONE
    found = parse(f"1{text}" if text.startswith("/") else text)
    return _unit(found, found.tree)


def _unit(whole: Expression, tree: Tree) -> tuple[float, Dimension]:
    match tree:
        case Name(name) if name in UNITS:
            return UNITS[name]
        case Number(1.0, ""):
            return 1.0, NONE
        case Number(1.0, name) if name in UNITS:
            return UNITS[name]
        case Binary("*" | "/" as sign, left, right):
            (a, of_a), (b, of_b) = _unit(whole, left), _unit(whole, right)
            return (a * b, times(of_a, of_b)) if sign == "*" else (a / b, times(of_a, of_b, -1))
        case Binary("^", left, Number(power, "")) if power in (1.0, 2.0, 3.0):
            factor, dimension = _unit(whole, left)
            return factor**power, times(NONE, dimension, int(power))
        case Name() | Number() | Binary() | Call() | Negative():
            known = ", ".join(UNITS)
            raise mistake(whole.text, tree.at, "expected a unit", f"known: {known}, and their products with * / ^")
