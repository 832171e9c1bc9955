"""What the machine code of a kernel follows from, as one digest: if any of it changes, so does the digest.

A kernel's code rests on its own bytecode, on the values of all globals that it reads, on all kernels that it calls,
however far away their sources are, on how it is compiled, and on who compiles it for which processor. Values and
bytecode are looked at, not files: an edited comment compiles nothing, and a function without a file counts, too.
"""

# mypy: disable-error-code="attr-defined"
from __future__ import annotations

import hashlib
import math
import platform
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic

_COMPILER = (platform.python_version(), numba.__version__, llvmlite.__version__, np.__version__)
_config: Any = numba.config


def digest(kernel: Any, arguments: tuple[Any, ...], target: Any) -> str:
    """What the machine code of a kernel for these types of arguments follows from.

    Args:
        kernel: as `numba.njit` returns it.
        arguments: numba's types.
        target: the target context of numba for which it is compiled.

    Raises:
        TypeError: the kernel reads a global of which it is not known how it acts on the code.
    """
    numbers = {kernel: 0}
    parts: list[object] = [_COMPILER, target.codegen().magic_tuple(), _config.BOUNDSCHECK, _config.OPT]
    parts += [_typed(kind) for kind in arguments]
    waiting = [kernel]
    for each in waiting:
        reads, called = _own(each)
        for other in called:
            if other not in numbers:
                numbers[other] = len(numbers)
                waiting.append(other)
        parts.append((reads, [numbers[other] for other in called]))
    return _hashed(parts)[:32]


def _hashed(parts: list[object]) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def _typed(kind: Any) -> object:
    """A numba type as text; of a named tuple its fields, too, which numba's own text leaves out."""
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        return repr(kind), getattr(kind, "fields", ()), [_typed(part) for part in parts]
    return repr(kind)


@cache
def _own(kernel: Any) -> tuple[str, list[Any]]:
    """What a kernel itself says and reads, as a digest; and the kernels that it calls."""
    called: list[Any] = []
    return _hashed([sorted(kernel.targetoptions.items()), *_said(kernel.py_func, called)]), called


def _said(function: FunctionType, called: list[Any]) -> list[object]:
    """All that a function is made of; the kernels among it are added to `called`."""
    parts: list[object] = [function.__defaults__, function.__kwdefaults__]
    parts += [_value(function, "closure", cell.cell_contents, called) for cell in function.__closure__ or ()]
    for code in _codes(function.__code__):
        said = [_constant(c) for c in code.co_consts if not isinstance(c, CodeType) and c != function.__doc__]
        parts += [code.co_code, code.co_exceptiontable, code.co_flags, code.co_varnames, code.co_names, said]
        for name, value in _globals(code, function.__globals__):
            parts.append((name, _value(function, name, value, called)))
    return parts


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and those of the functions in it."""
    yield code
    for inside in code.co_consts:
        if isinstance(inside, CodeType):
            yield from _codes(inside)


def _constant(value: object) -> object:
    """A constant of a code; sets in an order that is the same in every process."""
    return sorted(map(repr, value)) if isinstance(value, frozenset) else value


def _globals(code: CodeType, scope: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """The globals that a code names, and what it may name of modules but those that numba knows by name."""
    for name in code.co_names:
        if name in scope:
            yield name, scope[name]
            if isinstance(scope[name], ModuleType) and scope[name] not in (math, np):
                of = vars(scope[name])
                yield from ((f"{name}.{attribute}", of[attribute]) for attribute in code.co_names if attribute in of)


def _value(function: FunctionType, name: str, value: Any, called: list[Any]) -> object:
    """How a global acts on the machine code; kernels are added to `called`."""
    match value:
        case Dispatcher():
            called.append(value)
            return "kernel"
        case _Intrinsic():
            return _intrinsic(value._defn)
        case None | bool() | int() | float() | complex() | str() | bytes() | np.generic():
            return type(value).__name__, repr(value)
        case tuple() | list():
            return type(value).__name__, [_value(function, name, item, called) for item in value]
        case np.ndarray():
            return str(value.dtype), value.shape, value.tobytes()
        case ModuleType():
            return value.__name__
        case type():
            return value.__module__, value.__qualname__, getattr(value, "_fields", ())
        case FunctionType() | BuiltinFunctionType():
            return value.__module__, value.__qualname__
        case np.ufunc():
            return value.__name__
    raise TypeError(
        f"kernel '{function.__module__}.{function.__qualname__}' reads '{name}', a {type(value).__name__}: "
        "expected numbers, words, tuples, arrays, modules or compiled functions"
    )


def _intrinsic(definition: FunctionType) -> object:
    """Code that writes machine code: the whole source of its module counts, and the numbers that it closes over."""
    closed = [cell.cell_contents for cell in definition.__closure__ or ()]
    numbers = [value for value in closed if isinstance(value, int | str)]
    return definition.__qualname__, _source(definition.__code__.co_filename), definition.__code__.co_code, numbers


@cache
def _source(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest() if Path(path).exists() else ""
