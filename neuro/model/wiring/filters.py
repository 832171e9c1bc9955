"""Conditions on columns, in the grammar of `$(...)`: "synapses >= 5", "weight * 2 < limit"."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError, nearest
from neuro.core.grammar import (
    COMPARISONS,
    Binary,
    Call,
    Expression,
    Hints,
    Misread,
    Name,
    Negative,
    Number,
    Tree,
    parse,
)

_SIGNS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "^": np.power}
_ORDERS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}
_FUNCTIONS = {"sqrt": np.sqrt, "exp": np.exp, "log": np.log, "round": np.rint, "min": np.minimum, "max": np.maximum}
_HINTS = Hints({"$": "columns stand without $", "=": "a comparison is one of < <= > >="})


class Condition:
    """One comparison of columns and numbers.

    Args:
        text: the comparison.

    Raises:
        ModelError: it is none.
    """

    def __init__(self, text: str) -> None:
        try:
            self._whole: Expression = parse(text, _HINTS)
            tree = self._whole.tree
            if not isinstance(tree, Binary) or tree.sign not in COMPARISONS:
                raise self._whole.mistake(tree.at, "found no comparison: expected one such as synapses >= 5")
            self.names = tuple(dict.fromkeys(self._names(tree)))
        except Misread as error:
            raise error.at(None, "where") from None

    def _names(self, tree: Tree) -> Iterator[str]:
        match tree:
            case Name(name):
                yield name
            case Negative(of):
                yield from self._names(of)
            case Binary(_, left, right):
                yield from self._names(left)
                yield from self._names(right)
            case Call(name, arguments):
                if name not in _FUNCTIONS:
                    raise self._whole.mistake(tree.at, f"unknown function '{name}'", nearest(name, _FUNCTIONS))
                needs = 2 if name in ("min", "max") else 1
                if len(arguments) != needs:
                    raise self._whole.mistake(tree.at, f"{name}: found {len(arguments)} values: expected {needs}")
                for argument in arguments:
                    yield from self._names(argument)
            case Number(_, unit) if unit:
                raise self._whole.mistake(tree.at, f"found the unit '{unit}': expected a number without one")

    def holds(self, columns: Mapping[str, Any]) -> NDArray[np.bool_]:
        """Of each row whether it holds; where it has no value, as 0 / 0, it does not."""
        tree = self._whole.tree
        assert isinstance(tree, Binary)
        with np.errstate(all="ignore"):
            found: NDArray[np.bool_] = _ORDERS[tree.sign](self._of(tree.left, columns), self._of(tree.right, columns))
        if not np.ndim(found):
            raise ModelError(f"where: '{self._whole.text}' names no column: expected one")
        return found

    def _of(self, tree: Tree, columns: Mapping[str, Any]) -> Any:
        match tree:
            case Number(value, _):
                return value
            case Name(name):
                return columns[name]
            case Negative(of):
                return -self._of(of, columns)
            case Call(name, arguments):
                return _FUNCTIONS[name](*(self._of(argument, columns) for argument in arguments))
            case Binary(sign, left, right):
                return (_SIGNS | _ORDERS)[sign](self._of(left, columns), self._of(right, columns))
