"""Where the arithmetic of a model stands, in its class or its module, and what third-party parts must have."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Mapping
from types import FunctionType
from typing import Any, TypeVar

T = TypeVar("T")


class OfModule:
    """The class attribute `arithmetic`: what has a model's functions, the nearest class or module that has one of some.

    The functions of a class are in its body, without `self`, since they are called as `model.arithmetic.step(...)`: so
    a subclass without functions, or with some of its own, has those of its base. Or they are in its module.

    Args:
        functions: names by which a class or a module is known.
    """

    def __init__(self, functions: Collection[str]) -> None:
        self._functions = functions

    def __get__(self, model: object, kind: type[Any]) -> Any:
        for each in kind.__mro__:
            if any(isinstance(vars(each).get(name), FunctionType) for name in self._functions):
                return kind
            module = sys.modules.get(each.__module__)
            if module is not None and any(hasattr(module, name) for name in self._functions):
                return module
        return sys.modules[kind.__module__]


def check_functions(label: str, model: type[Any], functions: Mapping[str, int]) -> None:
    """Refuse a model whose arithmetic lacks a function, or has one with other arguments.

    Args:
        label: what messages call the model.
        model: the class.
        functions: how many arguments each takes.

    Raises:
        TypeError: it says which.
    """
    arithmetic = model.arithmetic
    for name, count in functions.items():
        code = getattr(getattr(arithmetic, name, None), "__code__", None)
        if code is None:
            raise TypeError(f"{label}: '{arithmetic.__name__}' has no function '{name}'")
        if code.co_argcount != count:
            raise TypeError(f"{label}: '{name}' takes {code.co_argcount} arguments: expected {count}")


def fill(label: str, model: type[Any], p: Any, c: Any) -> None:
    """Compute the constants of a model for a step of 0.1 ms.

    Raises:
        TypeError: it has more of them than `c` holds.
    """
    try:
        model.arithmetic.constants(p, 0.1, c)
    except (IndexError, ValueError) as error:
        raise TypeError(
            f"{label}: 'constants' fails for its defaults ({error}): "
            f"expected at most {len(c)} constants, its width, from {len(p)} parameters"
        ) from None


def has_method(base: type[Any], name: str, does: str) -> Callable[[type[T]], type[T]]:
    """A function that returns a third-party class if it has a method of its own in place of that of a base.

    Args:
        base: of the kind of parts; its method has the right arguments.
        name: of the method.
        does: what the method does, for the message.
    """
    own = getattr(base, name)
    expected = own.__code__.co_varnames[: own.__code__.co_argcount]

    def complete(part: type[T]) -> type[T]:
        """Raise `TypeError` where the method is missing, or has other arguments."""
        method, message = getattr(part, name), f"{base.kind} '{part.__name__}'"
        if method is own:
            raise TypeError(f"{message} has no method '{name}', which {does}")
        taken = method.__code__.co_argcount
        if taken != len(expected):
            text = f"'{name}' takes {taken} arguments: expected {len(expected)}, ({', '.join(expected)})"
            raise TypeError(f"{message}: {text}")
        return part

    return complete
