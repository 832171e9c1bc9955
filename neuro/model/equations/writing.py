"""Trees as lines of Python, and these as modules. Only names and numbers of checked trees get into a line."""

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
"""How a part of a tree is written that is more than its parts; None if it is not."""

_BINDING = {**dict.fromkeys(COMPARISONS, 1), "+": 2, "-": 2, "*": 3, "/": 3}
_NEGATIVE, _ATOM = 4, 6
_POWERS = {2.0: "square", 3.0: "cube", 4.0: "fourth"}
AS_IT_IS = ("abs", "min", "max", "where")
"""Functions that are called what they are in expressions."""
_CONSTANT = re.compile(r"\bc\[(\d+)\]")


def local(name: str, role: str = "") -> str:
    """Return the variable of a name: `V_m_`, or `V_m__next` for one of its other values.

    Names have no two underscores in a row and none at their end, so variables of different names never collide, nor
    with a word of Python.
    """
    return f"{name}__{role}" if role else f"{name}_"


def written(tree: Tree, leaf: Leaf) -> str:
    """A tree as an expression of Python.

    Args:
        tree: the tree.
        leaf: writes what is not written part by part.
    """
    return _written(tree, leaf, 0)


def _written(tree: Tree, leaf: Leaf, binding: int) -> str:
    found = leaf(tree)
    if found is not None:
        return found
    match tree:
        case Number(value, unit):
            return repr(value * UNITS[unit][0] if unit else value)
        case Name(name):
            return repr(UNITS[name][0])
        case Negative(of):
            return _bracketed(f"-{_written(of, leaf, _NEGATIVE)}", _NEGATIVE, binding)
        case Call(name, arguments):
            called = name if name in AS_IT_IS else f"of_{name}"
            return f"{called}({', '.join(_written(argument, leaf, 0) for argument in arguments)})"
        case Binary("^", left, Number(value, "")) if value in _POWERS:
            return f"{_POWERS[value]}({_written(left, leaf, 0)})"
        case Binary("^", left, right):
            return f"power({_written(left, leaf, 0)}, {_written(right, leaf, 0)})"
        case Binary("/", left, right) if not _is_constant(right, leaf):
            return f"divided({_written(left, leaf, 0)}, {_written(right, leaf, 0)})"
        case Binary(sign, left, right):
            mine = _BINDING[sign]
            text = f"{_written(left, leaf, mine)} {sign} {_written(right, leaf, mine + 1)}"
            return _bracketed(text, mine, binding)


def _bracketed(text: str, own: int, binding: int) -> str:
    return f"({text})" if own < binding else text


def _is_constant(tree: Tree, leaf: Leaf) -> bool:
    """Whether what is divided by is a number or one constant, of which it is known that it is not 0."""
    return (isinstance(tree, Number) and tree.value != 0.0) or (leaf(tree) or "").startswith("c[")


class Constants:
    """What is worked out once, in `constants`: all parts of expressions that depend on parameters only.

    Args:
        parameters: of the model, in order.
        first: the place in `p` of the first of them.
        variables: names that are no parameters, though units may be called so.
        full: writes out abbreviations.
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
        """Where a tree of parameters stands."""
        return self.place_of(self.of_parameters(tree))

    def place_of(self, text: str) -> str:
        """Where a line in terms of the variables of `constants` stands, e.g. "c[3]"."""
        return f"c[{self.places.setdefault(text, len(self.places))}]"

    def of_parameters(self, tree: Tree) -> str:
        """A tree of parameters in terms of the variables of `constants`."""
        return written(self.full(tree), self._parameter)

    def is_of_parameters(self, tree: Tree) -> bool:
        """Whether a tree depends on parameters and units only."""
        names = list(self._names(tree))
        return all(name in self.parameters or (name in UNITS and name not in self.variables) for name in names)

    def leaf(self, variables: Mapping[str, str]) -> Leaf:
        """Write variables by their names and what depends on parameters as a constant."""

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
        """The body of `constants` that fills these places."""
        yield from self.locals()
        yield from (f"c[{place}] = {text}" for text, place in self.places.items())

    def locals(self) -> Iterator[str]:
        """The parameters in mV, ms and pA."""
        for k, (name, parameter) in enumerate(self.parameters.items()):
            factor = "" if parameter.factor == 1.0 else f" * {parameter.factor!r}"
            yield f"{local(name)} = p[{self.first + k}]{factor}"


def hoisted(lines: list[str]) -> tuple[list[str], list[str]]:
    """The constants that lines read, and the lines with a variable in place of each: `c3` for `c[3]`."""
    found = dict.fromkeys(number for line in lines for number in _CONSTANT.findall(line))
    return [f"c{number}" for number in found], [_CONSTANT.sub(r"c\1", line) for line in lines]


def unpacked(names: list[str]) -> list[str]:
    """The lines that put constants into variables."""
    return [f"{name} = c[{name[1:]}]" for name in names]


def function(head: str, doc: str, body: list[str]) -> str:
    """A function as text; the lines of its body are indented relative to it."""
    return "\n".join([f"def {head}:", f'    """{doc}"""', *(f"    {line}" for line in body)]) + "\n"


def indented(lines: list[str], levels: int = 1) -> list[str]:
    """Lines further right."""
    return [f"{'    ' * levels}{line}" for line in lines]


NAMES = "neuro_equations_"
"""How the names of generated modules begin."""


def module(text: str) -> ModuleType:
    """The module of a text; one text has one module.

    Args:
        text: of a generated module: it was written here from checked trees, never by users.
    """
    name = NAMES + hashlib.sha256(text.encode()).hexdigest()[:16]
    if name not in sys.modules:
        file = f"<{name}>"
        made = ModuleType(name)
        made.__file__ = file
        linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
        exec(compile(text, file, "exec"), made.__dict__)
        sys.modules[name] = made
    return sys.modules[name]


def text_of(module: ModuleType) -> str:
    """The text of a generated module."""
    return "".join(linecache.cache[module.__file__ or ""][2])  # type: ignore[misc]
