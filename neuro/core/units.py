"""Units and dimensions. A dimension is a product of powers of mV, ms and pA, the units of all computed values.

Derived units follow: pA/mV is nS, pA ms/mV is pF, mV/pA is GOhm, 1/ms is kHz.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import TypeAlias

from neuro.core.errors import ModelError, nearest
from neuro.core.grammar import Binary, Call, Expression, Name, Negative, Number, Tree, mistake, parse

Dimension: TypeAlias = tuple[Fraction, Fraction, Fraction]
"""Powers of mV, ms and pA."""


def _dimension(mv: int, ms: int, pa: int) -> Dimension:
    return Fraction(mv), Fraction(ms), Fraction(pa)


NONE = _dimension(0, 0, 0)
VOLTAGE, TIME, CURRENT = _dimension(1, 0, 0), _dimension(0, 1, 0), _dimension(0, 0, 1)
CONDUCTANCE = _dimension(-1, 0, 1)
TENS: Mapping[str, tuple[int, Dimension]] = {
    name: (tens, dimension)
    for dimension, units in (
        (VOLTAGE, {"mV": 0, "V": 3, "uV": -3}),
        (TIME, {"ms": 0, "s": 3, "us": -3}),
        (CURRENT, {"pA": 0, "nA": 3, "uA": 6}),
        (CONDUCTANCE, {"nS": 0, "uS": 3, "mS": 6, "pS": -3}),
        (_dimension(-1, 1, 1), {"pF": 0, "nF": 3, "uF": 6}),
        (_dimension(1, 0, -1), {"GOhm": 0, "MOhm": -3, "kOhm": -6}),
        (_dimension(0, -1, 0), {"kHz": 0, "Hz": -3}),
    )
    for name, tens in units.items()
}
"""Size of each unit in mV, ms and pA as a power of ten, and its dimension."""
UNITS: Mapping[str, tuple[float, Dimension]] = {
    name: (float(f"1e{tens}"), dimension) for name, (tens, dimension) in TENS.items()
}
"""Size of each unit in mV, ms and pA as a number, and its dimension."""

_NAMES = {dimension: name for name, (tens, dimension) in TENS.items() if tens == 0 and name != "kHz"}
_MEASURED = re.compile(r"\s*([-+]?(?:inf\b|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))\s*(.*)", re.S | re.ASCII)


def times(a: Dimension, b: Dimension, power: Fraction | int = 1) -> Dimension:
    """Return the dimension of a product of `a` and a power of `b`."""
    return a[0] + power * b[0], a[1] + power * b[1], a[2] + power * b[2]


def unit_of(dimension: Dimension) -> str:
    """Return the unit of a dimension: "mV", "pA/ms", "1/(mV ms)"; "" for none."""
    if dimension == NONE:
        return ""
    if dimension in _NAMES:
        return _NAMES[dimension]
    if times(dimension, TIME) in _NAMES:
        return f"{_NAMES[times(dimension, TIME)]}/ms"
    powers = dict(zip(("mV", "ms", "pA"), dimension, strict=True))
    top = [_power(name, power) for name, power in powers.items() if power > 0]
    bottom = [_power(name, -power) for name, power in powers.items() if power < 0]
    if not bottom:
        return " ".join(top)
    return f"{' '.join(top) or '1'}/{bottom[0] if len(bottom) == 1 else '(' + ' '.join(bottom) + ')'}"


def _power(name: str, power: Fraction) -> str:
    return name if power == 1 else f"{name}^{power}"


def phrase_of(dimension: Dimension) -> str:
    """Return a dimension as a phrase of a message, e.g. "in pA" or "without unit"."""
    return f"in {unit_of(dimension)}" if dimension != NONE else "without unit"


def measured(value: object) -> tuple[float, str]:
    """Return a number and its unit from `281 pF`, `0.04 1/(mV*ms)`, `-70 mV` or a number.

    Raises:
        ModelError: the value has another form.
    """
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), ""
    match = _MEASURED.fullmatch(value) if isinstance(value, str) else None
    text = match[2].strip() if match else ""
    if match is None or text.startswith("*"):
        hint = f"write {match[1]} {text.lstrip('* ')}" if match else ""
        raise ModelError(f"found {value!r:.40}: expected a number with its unit, e.g. 281 pF", hint=hint)
    return float(match[1]), text


def unit(text: str) -> tuple[float, Dimension]:
    """Return the size of a unit in mV, ms and pA, and its dimension.

    Raises:
        ModelError: the text is no unit; the message names the column.
    """
    tens, dimension = _tens_of(text)
    return float(f"1e{tens}"), dimension


def _tens_of(text: str) -> tuple[int, Dimension]:
    if not text:
        return 0, NONE
    expression = parse(f"1{text}" if text.startswith("/") else text)
    return _unit(expression, expression.tree)


def _unit(expression: Expression, tree: Tree) -> tuple[int, Dimension]:
    match tree:
        case Name(name) if name in TENS:
            return TENS[name]
        case Number(1.0, ""):
            return 0, NONE
        case Number(1.0, name) if name in TENS:
            return TENS[name]
        case Binary("*" | "/" as sign, left, right):
            (a, dim_a), (b, dim_b) = _unit(expression, left), _unit(expression, right)
            return (a + b, times(dim_a, dim_b)) if sign == "*" else (a - b, times(dim_a, dim_b, -1))
        case Binary("^", left, Number(power, "")) if power in (1.0, 2.0, 3.0):
            tens, dimension = _unit(expression, left)
            return tens * int(power), times(NONE, dimension, int(power))
        case Name() | Number() | Binary() | Call() | Negative():
            known_units = ", ".join(UNITS)
            raise mistake(
                expression.text, tree.at, "expected a unit", f"known: {known_units}, and their products with * / ^"
            )


_KINDS = {
    VOLTAGE: "a voltage",
    TIME: "a time",
    CURRENT: "a current",
    CONDUCTANCE: "a conductance",
    times(times(CURRENT, TIME), VOLTAGE, -1): "a capacitance",
    times(VOLTAGE, CURRENT, -1): "a resistance",
    times(NONE, TIME, -1): "a rate",
}
_LONGEST = 100
_WRITTEN = re.compile(
    r"\s*(?!0[xobXOB])([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![eE]\d)"
    r"\s*((?:1\s*)?/\s*[A-Za-z(].*|[A-Za-z].*?)\s*",
    re.S | re.ASCII,
)


def is_measure(value: object) -> bool:
    """Return True if a value is a text of a number and a possible unit: `10 ms`, `3 1/ms`, `3/ms`."""
    return isinstance(value, str) and len(value) <= _LONGEST and _WRITTEN.fullmatch(value) is not None


def dimension_of(text: str) -> Dimension:
    """Return the dimension of a unit, e.g. "ms".

    Raises:
        ModelError: the text is no unit.
    """
    return _tens_of(text)[1]


def in_base(value: str) -> tuple[float, Dimension]:
    """Convert a number with a unit, for which `is_measure` holds, to mV, ms and pA.

    Raises:
        ModelError: there is no such unit.
    """
    number, tens, dimension = _read(value)
    return scaled(number, tens), dimension


def converted(value: str, to_unit: str) -> float:
    """Convert a number with a unit to another unit, as the nearest double, e.g. `1 s` to 1000 in ms.

    Args:
        value: number with a unit, for which `is_measure` holds.
        to_unit: the other unit; "" for none.

    Raises:
        ModelError: the number has another dimension, or its unit is unknown.
    """
    try:
        wanted_tens, target = _tens_of(to_unit)
    except ModelError:
        match = _WRITTEN.fullmatch(value)  # a unit without conversion, e.g. a degree
        if match is None or match[2].strip() != to_unit:
            raise ModelError(f"expected a number in {to_unit}") from None
        return float(match[1])
    number, tens, dimension = _read(value)
    if dimension != target:
        kind = _KINDS.get(target, "a value")
        raise ModelError(f"expected {kind} in {to_unit}" if to_unit else "expected a number without unit", kind="unit")
    return scaled(number, tens - wanted_tens)


def scaled(number: str, tens: int) -> float:
    """Return the nearest double to a written number times a power of ten."""
    digits, _, exponent = number.lower().partition("e")
    return float(f"{digits}e{int(exponent or 0) + tens}")


def _read(value: str) -> tuple[str, int, Dimension]:
    match = _WRITTEN.fullmatch(value)
    assert match is not None
    try:
        return match[1], *_tens_of(match[2])
    except ModelError:
        raise ModelError(f"unknown unit '{match[2]}'", hint=nearest(match[2], UNITS)) from None
