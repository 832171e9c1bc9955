"""Divisions by 0 and other results that are not finite, wherever parameters alone decide: they are refused, not run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import make_dataclass
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from neuro.core.errors import ModelError
from neuro.core.grammar import Binary, Call, Expression, Name, Negative, Number, Tree
from neuro.core.units import UNITS
from neuro.model.equations import algebra
from neuro.model.equations.dimensions import placed, text_of
from neuro.model.equations.parameters import Parameter

Words = tuple[str, ...]

_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    **{"exp": np.exp, "expm1": np.expm1, "log": np.log, "sqrt": np.sqrt},
    **{"tanh": np.tanh, "sin": np.sin, "cos": np.cos, "abs": np.abs},
    "exprel": lambda x: np.where(np.abs(x) < 1e-8, 1.0 + 0.5 * x, np.expm1(x) / x),
    "min": np.minimum,
    "max": np.maximum,
    **{"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "^": np.float_power},
    **{"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal},
}


class Divisions:
    """Looks for them in the expressions of a model.

    Args:
        parameters: of the model.
        variables: names that are no parameters, though units may be called so.
        let: abbreviations in terms of what is defined before them.
        expressions: the others, by the words that lead to each.
        taus: those of them that are time constants.
    """

    def __init__(
        self,
        parameters: Mapping[str, Parameter],
        variables: Iterable[str],
        let: Mapping[str, Expression],
        expressions: Mapping[Words, Expression],
        taus: Iterable[Words] = (),
    ) -> None:
        self.parameters, self.let = parameters, let
        self.units = {name: of[0] for name, of in UNITS.items() if name not in {*parameters, *variables, *let}}
        self.all: dict[Words, Expression] = {("let", name): expression for name, expression in let.items()}
        self.all |= expressions
        self.taus = frozenset(taus)
        self.risky = {name for expression in self.all.values() for name in self._risky(expression.tree)}
        self.risky |= {name for path in self.taus for name in algebra.names(self.all[path].tree)}

    def _risky(self, tree: Tree) -> Iterator[str]:
        """The parameters, or abbreviations of them, of which a change may matter."""
        for part in algebra.within(tree):
            if isinstance(part, Call):
                yield from self._written_out(part)
            elif isinstance(part, Binary) and part.sign in "/^":
                yield from self._written_out(part.right if part.sign == "/" else part)

    def _written_out(self, tree: Tree) -> Iterator[str]:
        for name in algebra.names(tree):
            yield name
            if name in self.let:
                yield from self._written_out(self.let[name].tree)

    def mistakes(self, values: Mapping[str, Any]) -> Iterator[ModelError]:
        """What is wrong with some values of parameters.

        Args:
            values: by name, in the unit of each; what is not given is not checked.
        """
        if not self.risky & set(values) and len(values) < len(self.parameters):
            return
        known: dict[str, Any] = {
            name: np.asarray(value, dtype=np.float64) * self.parameters[name].factor
            for name, value in values.items()
            if name in self.parameters
        }
        with np.errstate(all="ignore"):
            for path, expression in self.all.items():
                look = _Look(expression, {**self.units, **known})
                try:
                    found = look.at(expression.tree)
                    if path in self.taus and found is not None and np.any(found <= 0.0):
                        raise look.mistake(
                            expression.tree, "is not above 0: expected a time constant > 0 ms", found > 0
                        )
                except ModelError as error:
                    error.hint = self._told(look, values)
                    yield placed(error, path)
                else:
                    if path[0] == "let" and found is not None:
                        known[path[1]] = found

    def _told(self, look: _Look, values: Mapping[str, Any]) -> str:
        """The values of the parameters on which a mistake depends."""
        texts = {}
        for name in self._written_out(look.blamed):
            if name in values:
                of_each = np.ravel(values[name])
                which, neuron = (f"{name}[{look.first}]", look.first) if of_each.size > 1 else (name, 0)
                texts[name] = f"{which} = {of_each[neuron]:g} {self.parameters[name].unit}".strip()
        return ", ".join(texts.values())


class _Look:
    """A look at one expression.

    Attributes:
        blamed: what a mistake is about.
        first: the first neuron of which it is one.
    """

    def __init__(self, whole: Expression, known: Mapping[str, Any]) -> None:
        self.whole, self.known = whole, known
        self.blamed, self.first = whole.tree, 0

    def mistake(self, tree: Tree, message: str, good: Any, at: int = 0) -> ModelError:
        self.blamed, self.first = tree, int(np.argmin(good))
        return self.whole.mistake(at, f"'{text_of(tree)}' {message}")

    def at(self, tree: Tree) -> Any:
        """The value of a part, None if it is not known; what is wrong within it is raised."""
        match tree:
            case Number(value, unit):
                return np.float64(value * UNITS[unit][0] if unit else value)
            case Name(name):
                return self.known.get(name)
            case Negative(of):
                value = self.at(of)
                return None if value is None else -value
            case Call("where", (Binary() as condition, first, second)):
                return self.choice(condition, first, second)
        parts = algebra.parts(tree)
        values = [self.at(part) for part in parts]
        sign = tree.sign if isinstance(tree, Binary) else tree.name
        if sign == "/" and values[1] is not None and np.any(values[1] == 0.0):
            raise self.mistake(parts[1], "is 0: expected a divisor other than 0", values[1] != 0.0, tree.at)
        if any(value is None for value in values):
            return None
        result = _FUNCTIONS[sign](*values)
        good = np.isfinite(result)
        if not good.all():
            worst = np.ravel(result)[np.argmin(good)]
            raise self.mistake(tree, f"is {worst:g}: expected a finite number", good, tree.at)
        return result

    def choice(self, condition: Binary, first: Tree, second: Tree) -> Any:
        """The value of a `where`: a part that is chosen for no neuron may be anything."""
        holds = self.at(condition)
        if holds is None or np.all(holds):
            found = self.at(first)
        if holds is None or not np.any(holds):
            found = self.at(second)
        return found if holds is not None and (np.all(holds) or not np.any(holds)) else None


class InEquations:
    """What the classes of models in equations share.

    Class attributes:
        definition: the words that define it, as they were given.
        divisions: finds parameters with which a constant of it is not finite.
    """

    definition: ClassVar[Mapping[str, Any]] = {}
    divisions: ClassVar[Divisions]

    @classmethod
    def identity(cls) -> str:
        """All words that decide what it does."""
        return json.dumps({k: v for k, v in cls.definition.items() if k not in ("doc", "source")}, default=repr)

    @classmethod
    def made(cls, name: str, fields: list[Any], arithmetic: ModuleType, **attributes: Any) -> Any:
        """Make the class of a model from its fields, the module of its functions and its class attributes."""
        model = make_dataclass(name, fields, bases=(cls,), namespace=attributes, frozen=True, kw_only=True, eq=False)
        model.__module__ = arithmetic.__name__
        return model
