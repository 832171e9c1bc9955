"""Checks that third-party classes have the functions and methods that backends and the compiler call."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

T = TypeVar("T")


def check_functions(label: str, model: type[Any], functions: Mapping[str, int]) -> None:
    """Refuse a model if its arithmetic lacks a function, or a function has other arguments.

    Args:
        label: name of the model in messages.
        model: the class.
        functions: number of arguments of each function, by name.

    Raises:
        TypeError: a function is missing or has other arguments; the message names the function.
    """
    arithmetic = model.arithmetic
    for name, count in functions.items():
        code = getattr(getattr(arithmetic, name, None), "__code__", None)
        if code is None:
            raise TypeError(f"{label}: '{arithmetic.__name__}' has no function '{name}'")
        if code.co_argcount != count:
            raise TypeError(f"{label}: '{name}' takes {code.co_argcount} arguments: expected {count}")


def fill(label: str, model: type[Any], p: Any, c: Any) -> None:
    """Check that the constants of a model fit into an array, by computing them for a step of 0.1 ms.

    Args:
        label: name of the model in messages.
        model: the class.
        p: values of the parameters.
        c: array that receives the constants.

    Raises:
        TypeError: the model has more constants than `c` holds.
    """
    try:
        model.arithmetic.constants(p, 0.1, c)
    except (IndexError, ValueError) as error:
        raise TypeError(
            f"{label}: 'constants' fails for its defaults ({error}): "
            f"expected at most {len(c)} constants, its width, from {len(p)} parameters"
        ) from None


def check_method(part: type[T], base: type[Any], name: str, purpose: str) -> type[T]:
    """Check that a third-party class overrides a method of the base class, with the right arguments.

    Args:
        part: the class.
        base: base class of the kind of parts; its method has the right arguments.
        name: name of the method.
        purpose: verb phrase for the message, e.g. "draws the values".

    Raises:
        TypeError: the method is missing, or has other arguments.
    """
    base_method, method, message = getattr(base, name), getattr(part, name), f"{base.kind} '{part.__name__}'"
    expected = base_method.__code__.co_varnames[: base_method.__code__.co_argcount]
    if method is base_method:
        raise TypeError(f"{message} has no method '{name}', which {purpose}")
    arguments = method.__code__.co_argcount
    if arguments != len(expected):
        text = f"'{name}' takes {arguments} arguments: expected {len(expected)}, ({', '.join(expected)})"
        raise TypeError(f"{message}: {text}")
    return part
