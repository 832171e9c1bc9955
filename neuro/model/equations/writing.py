"""Generation of Python from syntax trees. Generated lines contain only names and numbers of checked trees."""

from __future__ import annotations

import hashlib
import linecache
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from types import ModuleType

from neuro.core.grammar import COMPARISONS, Binary, Call, Name, Negative, Number, Tree
from neuro.core.units import UNITS
from neuro.model.equations import algebra
from neuro.model.equations.parameters import Parameter

Leaf = Callable[[Tree], str | None]
"""Function that returns the text of a subtree, or None to compose the text from the operands."""

_BINDING = {**dict.fromkeys(COMPARISONS, 1), "+": 2, "-": 2, "*": 3, "/": 3}
_NEGATIVE, _ATOM = 4, 6
_POWERS = {2.0: "square", 3.0: "cube", 4.0: "fourth"}
SAME_NAME = ("abs", "min", "max", "where")
"""Functions with the same name in expressions and in generated Python."""
_CONSTANT = re.compile(r"\bc\[(\d+)\]")


def local(name: str, role: str = "") -> str:
    """Return the Python variable of a name, e.g. `V_m_`. A variable with a role has another value, e.g. `V_m__next`.

    Names contain no `__` and do not end in `_`, so variables of different names cannot collide with each other or with
    Python's words.
    """
    return f"{name}__{role}" if role else f"{name}_"


def to_python(tree: Tree, leaf: Leaf) -> str:
    """Return a tree as a Python expression.

    Args:
        tree: the tree.
        leaf: function that returns the text of a subtree, or None to compose the text from the operands.
    """
    return _to_python(tree, leaf, 0)


def _to_python(tree: Tree, leaf: Leaf, binding: int) -> str:
    leaf_text = leaf(tree)
    if leaf_text is not None:
        return leaf_text
    match tree:
        case Number(value, unit):
            return repr(value * UNITS[unit][0] if unit else value)
        case Name(name):
            return repr(UNITS[name][0])
        case Negative(of):
            return _bracketed(f"-{_to_python(of, leaf, _NEGATIVE)}", _NEGATIVE, binding)
        case Call(name, arguments):
            function_name = name if name in SAME_NAME else f"of_{name}"
            return f"{function_name}({', '.join(_to_python(argument, leaf, 0) for argument in arguments)})"
        case Binary("^", left, Number(value, "")) if value in _POWERS:
            return f"{_POWERS[value]}({_to_python(left, leaf, 0)})"
        case Binary("^", left, right):
            return f"power({_to_python(left, leaf, 0)}, {_to_python(right, leaf, 0)})"
        case Binary("/", left, right) if not _is_constant(right, leaf):
            return f"divided({_to_python(left, leaf, 0)}, {_to_python(right, leaf, 0)})"
        case Binary(sign, left, right):
            own_binding = _BINDING[sign]
            text = f"{_to_python(left, leaf, own_binding)} {sign} {_to_python(right, leaf, own_binding + 1)}"
            return _bracketed(text, own_binding, binding)


def _bracketed(text: str, own_binding: int, binding: int) -> str:
    return f"({text})" if own_binding < binding else text


def _is_constant(tree: Tree, leaf: Leaf) -> bool:
    """Return whether a divisor is a number other than 0, or a constant. Constants were checked not to be 0."""
    return (isinstance(tree, Number) and tree.value != 0.0) or (leaf(tree) or "").startswith("c[")


class Constants:
    """Constants of a model: subexpressions of parameters only, which the function `constants` computes once.

    Args:
        parameters: parameters of the model, in order.
        first: index in `p` of the first parameter.
        variables: names other than parameters. They hide units of the same name.
        full: function that expands abbreviations.
    """

    def __init__(
        self,
        parameters: Mapping[str, Parameter],
        first: int,
        variables: Collection[str],
        full: Callable[[Tree], Tree],
    ) -> None:
        self.parameters, self.first, self.variables, self.full = parameters, first, variables, full
        self.places: dict[str, int] = {}

    def place(self, tree: Tree) -> str:
        """Return the element of `c` with the value of a tree of parameters."""
        return self.place_of(self.of_parameters(tree))

    def place_of(self, text: str) -> str:
        """Return the element of `c` with the value of an expression in the variables of `constants`, e.g. "c[3]"."""
        return f"c[{self.places.setdefault(text, len(self.places))}]"

    def of_parameters(self, tree: Tree) -> str:
        """Return a tree of parameters as an expression in the variables of `constants`."""
        return to_python(self.full(tree), self._parameter)

    def is_of_parameters(self, tree: Tree) -> bool:
        """Return whether a tree depends on parameters and units only."""
        names = list(self._names(tree))
        return all(name in self.parameters or (name in UNITS and name not in self.variables) for name in names)

    def leaf(self, variables: Mapping[str, str]) -> Leaf:
        """Return a `Leaf` that writes a name as its variable, and a subtree of parameters as an element of `c`."""

        def leaf(tree: Tree) -> str | None:
            if isinstance(tree, Name) and tree.name in variables:
                return variables[tree.name]
            if isinstance(tree, Number) or not self.is_of_parameters(tree):
                return None
            if not any(name in self.parameters for name in self._names(tree)):
                return None
            return self.place(tree)

        return leaf

    def _names(self, tree: Tree) -> Iterator[str]:
        return algebra.names(self.full(tree))

    def _parameter(self, tree: Tree) -> str | None:
        return local(tree.name) if isinstance(tree, Name) and tree.name in self.parameters else None

    def lines(self) -> Iterator[str]:
        """Yield the body of `constants`, which computes the constants."""
        yield from self.locals()
        yield from (f"c[{place}] = {text}" for text, place in self.places.items())

    def locals(self) -> Iterator[str]:
        """Yield the lines that set the parameters in mV, ms and pA."""
        for k, (name, parameter) in enumerate(self.parameters.items()):
            factor = "" if parameter.factor == 1.0 else f" * {parameter.factor!r}"
            yield f"{local(name)} = p[{self.first + k}]{factor}"


def hoist_constants(lines: list[str]) -> tuple[list[str], list[str]]:
    """Return the variables of the constants that lines read, and the lines with `c3` in place of `c[3]`."""
    numbers = dict.fromkeys(number for line in lines for number in _CONSTANT.findall(line))
    return [f"c{number}" for number in numbers], [_CONSTANT.sub(r"c\1", line) for line in lines]


def unpack_constants(names: list[str]) -> list[str]:
    """Return the lines that assign constants to variables."""
    return [f"{name} = c[{name[1:]}]" for name in names]


def function(head: str, doc: str, body: list[str]) -> str:
    """Return a function as text. The lines of the body have no indentation."""
    return "\n".join([f"def {head}:", f'    """{doc}"""', *(f"    {line}" for line in body)]) + "\n"


def indent(lines: list[str], levels: int = 1) -> list[str]:
    """Return lines with more indentation."""
    return [f"{'    ' * levels}{line}" for line in lines]


NAMES = "neuro_equations_"
"""Prefix of the names of generated modules."""


def module(text: str) -> ModuleType:
    """Return the module of a text. The same text gives the same module.

    Args:
        text: text generated from checked trees, never text from users.
    """
    name = NAMES + hashlib.sha256(text.encode()).hexdigest()[:16]
    if name not in sys.modules:
        file = f"<{name}>"
        new_module = ModuleType(name)
        new_module.__file__ = file
        linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
        exec(compile(text, file, "exec"), new_module.__dict__)
        sys.modules[name] = new_module
    return sys.modules[name]


def text_of(module: ModuleType) -> str:
    """Return the text of a generated module."""
    return "".join(linecache.cache[module.__file__ or ""][2])  # type: ignore[misc]
