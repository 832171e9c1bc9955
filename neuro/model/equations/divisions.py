"""Checks before a run for parameters that lead to divisions by 0 or other results that are not finite."""

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
from neuro.model.equations.dimensions import text_of, with_path
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
    """Search for expressions of a model that are not finite for given parameters.

    Args:
        parameters: parameters of the model.
        variables: names of states and receptors. They hide units of the same name.
        let: abbreviations. An abbreviation may use the abbreviations before it.
        expressions: the other expressions, by their paths in the words.
        taus: paths of the expressions that are time constants.
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
        self.units = {name: pair[0] for name, pair in UNITS.items() if name not in {*parameters, *variables, *let}}
        self.all: dict[Words, Expression] = {("let", name): expression for name, expression in let.items()}
        self.all |= expressions
        self.taus = frozenset(taus)
        self.risky_names = {name for expression in self.all.values() for name in self._risky_names(expression.tree)}
        self.risky_names |= {name for path in self.taus for name in algebra.names(self.all[path].tree)}

    def _risky_names(self, tree: Tree) -> Iterator[str]:
        """Yield the parameters and abbreviations in divisors, powers and function arguments."""
        for part in algebra.subtrees(tree):
            if isinstance(part, Call):
                yield from self._with_definitions(part)
            elif isinstance(part, Binary) and part.sign in "/^":
                yield from self._with_definitions(part.right if part.sign == "/" else part)

    def _with_definitions(self, tree: Tree) -> Iterator[str]:
        """Yield the names in a tree, and the names in the abbreviations that the tree uses."""
        for name in algebra.names(tree):
            yield name
            if name in self.let:
                yield from self._with_definitions(self.let[name].tree)

    def mistakes(self, values: Mapping[str, Any]) -> Iterator[ModelError]:
        """Yield an error for each expression that is not finite for these values of parameters.

        Args:
            values: values by name, in the unit of each parameter. Missing parameters are not checked.
        """
        if not self.risky_names & set(values) and len(values) < len(self.parameters):
            return
        known_values: dict[str, Any] = {
            name: np.asarray(value, dtype=np.float64) * self.parameters[name].factor
            for name, value in values.items()
            if name in self.parameters
        }
        with np.errstate(all="ignore"):
            for path, expression in self.all.items():
                evaluator = _Evaluator(expression, {**self.units, **known_values})
                try:
                    value_of_tree = evaluator.evaluate(expression.tree)
                    if path in self.taus and value_of_tree is not None and np.any(value_of_tree <= 0.0):
                        raise evaluator.mistake(
                            expression.tree, "is not above 0: expected a time constant > 0 ms", value_of_tree > 0
                        )
                except ModelError as error:
                    error.hint = self._dependencies(evaluator, values)
                    yield with_path(error, path)
                else:
                    if path[0] == "let" and value_of_tree is not None:
                        known_values[path[1]] = value_of_tree

    def _dependencies(self, evaluator: _Evaluator, values: Mapping[str, Any]) -> str:
        """Return the values of the parameters in the wrong subtree as text, e.g. "tau_m = 0 ms"."""
        texts = {}
        for name in self._with_definitions(evaluator.wrong_tree):
            if name in values:
                values_per_neuron = np.ravel(values[name])
                label, neuron = (
                    (f"{name}[{evaluator.first}]", evaluator.first) if values_per_neuron.size > 1 else (name, 0)
                )
                texts[name] = f"{label} = {values_per_neuron[neuron]:g} {self.parameters[name].unit}".strip()
        return ", ".join(texts.values())


class _Evaluator:
    """Evaluator of one expression for known values.

    Attributes:
        wrong_tree: the subtree with the last mistake.
        first: the index of the first neuron with this mistake.
    """

    def __init__(self, expression: Expression, values: Mapping[str, Any]) -> None:
        self.expression, self.known = expression, values
        self.wrong_tree, self.first = expression.tree, 0

    def mistake(self, tree: Tree, message: str, is_valid: Any, at: int = 0) -> ModelError:
        """Return the error of a subtree. `is_valid` has a boolean per neuron."""
        self.wrong_tree, self.first = tree, int(np.argmin(is_valid))
        return self.expression.mistake(at, f"'{text_of(tree)}' {message}")

    def evaluate(self, tree: Tree) -> Any:
        """Return the value of a subtree, or None if unknown. Raise an error for a mistake in the subtree."""
        match tree:
            case Number(value, unit):
                return np.float64(value * UNITS[unit][0] if unit else value)
            case Name(name):
                return self.known.get(name)
            case Negative(of):
                value = self.evaluate(of)
                return None if value is None else -value
            case Call("where", (Binary() as condition, first, second)):
                return self.choice(condition, first, second)
        operands = algebra.operands(tree)
        values = [self.evaluate(operand) for operand in operands]
        sign = tree.sign if isinstance(tree, Binary) else tree.name
        if sign == "/" and values[1] is not None and np.any(values[1] == 0.0):
            raise self.mistake(operands[1], "is 0: expected a divisor other than 0", values[1] != 0.0, tree.at)
        if any(value is None for value in values):
            return None
        result = _FUNCTIONS[sign](*values)
        is_finite = np.isfinite(result)
        if not is_finite.all():
            worst = np.ravel(result)[np.argmin(is_finite)]
            raise self.mistake(tree, f"is {worst:g}: expected a finite number", is_finite, tree.at)
        return result

    def choice(self, condition: Binary, first: Tree, second: Tree) -> Any:
        """Return the value of a `where`. A branch that no neuron selects need not be finite."""
        holds = self.evaluate(condition)
        if holds is None or np.all(holds):
            branch = self.evaluate(first)
        if holds is None or not np.any(holds):
            branch = self.evaluate(second)
        return branch if holds is not None and (np.all(holds) or not np.any(holds)) else None


class InEquations:
    """Mixin of the classes of models in equations.

    Class attributes:
        definition: the words that define the model.
        divisions: search for parameters that make a constant infinite or NaN.
    """

    definition: ClassVar[Mapping[str, Any]] = {}
    divisions: ClassVar[Divisions]

    @classmethod
    def identity(cls) -> str:
        """Return all words that affect the behaviour of the model."""
        return json.dumps({k: v for k, v in cls.definition.items() if k not in ("doc", "source")}, default=repr)

    @classmethod
    def create(cls, name: str, fields: list[Any], arithmetic: ModuleType, **attributes: Any) -> Any:
        """Create a model class from fields, the module of the functions, and class attributes."""
        model = make_dataclass(name, fields, bases=(cls,), namespace=attributes, frozen=True, kw_only=True, eq=False)
        model.__module__ = arithmetic.__name__
        return model
