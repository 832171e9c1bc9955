"""What the machine code of a kernel follows from, as one digest: if any of it changes, so does the digest.

A kernel's code rests on its own bytecode, on the values of all globals that it reads, on all kernels that it calls,
however far away their sources are, on how it is compiled, and on which compiler makes it for which processor. Values
and bytecode are looked at, not files: an edited comment compiles nothing, and a function without a file counts, too.
Two files alone are read: those that say how kernels are compiled.
"""

# mypy: disable-error-code="attr-defined"
from __future__ import annotations

import hashlib
import math
import platform
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types

from neuro.kernels.numba_internals import Dispatcher, Intrinsic

_COMPILER = (platform.python_version(), numba.__version__, llvmlite.__version__, np.__version__)
_config: Any = numba.config
_HOW = tuple(Path(__file__).with_name(name) for name in ("jit.py", "numba_internals.py"))
_KNOWN_BY_NAME = {"numba", "numpy", *sys.stdlib_module_names}
"""Packages whose versions are in `_COMPILER`."""


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
    parts += [_source(str(path)) for path in _HOW]
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
    """What a kernel or a plain function itself says and reads, as a digest; and those that it calls."""
    called: list[Any] = []
    if isinstance(kernel, FunctionType):
        return _hashed(_said(kernel, called)), called
    return _hashed([sorted(kernel.targetoptions.items()), *_said(kernel.py_func, called)]), called


def _said(function: FunctionType, called: list[Any]) -> list[object]:
    """All that a function is made of; the kernels and functions among it are added to `called`."""
    parts: list[object] = [function.__defaults__, function.__kwdefaults__]
    codes = list(_codes(function.__code__))
    words = [word for code in codes for word in code.co_names]
    for cell in function.__closure__ or ():
        for name, value in _followed("closure", cell.cell_contents, words):
            parts.append((name, _value(function, name, value, called)))
    for code in codes:
        said = [
            sorted(map(repr, c)) if isinstance(c, frozenset) else c  # a set in the same order in every process
            for c in code.co_consts
            if not isinstance(c, CodeType) and c != function.__doc__
        ]
        parts += [code.co_code, code.co_exceptiontable, code.co_flags, code.co_varnames, code.co_names, said]
    scope = function.__globals__
    for word in dict.fromkeys(word for word in words if word in scope):
        for name, value in _followed(word, scope[word], words):
            parts.append((name, _value(function, name, value, called)))
    return parts


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and those of the functions in it."""
    yield code
    for inside in code.co_consts:
        if isinstance(inside, CodeType):
            yield from _codes(inside)


def _followed(name: str, value: Any, words: list[str]) -> Iterator[tuple[str, Any]]:
    """A value, and of a module all that a function of these words may read of it, through modules in modules.

    Modules that numba knows by name are not looked into.
    """
    yield name, value
    seen, waiting = {math, np}, [(name, value)]
    for path, module in waiting:
        if not isinstance(module, ModuleType) or module in seen:
            continue
        seen.add(module)
        for word in dict.fromkeys(words):
            if hasattr(module, word):
                found = f"{path}.{word}", getattr(module, word)
                yield found
                waiting.append(found)


def _value(function: FunctionType, name: str, value: Any, called: list[Any]) -> object:
    """How a global acts on the machine code; kernels and functions are added to `called`."""
    match value:
        case Dispatcher():
            called.append(value)
            return "kernel"
        case Intrinsic():
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
        case FunctionType() if value.__module__.partition(".")[0] not in _KNOWN_BY_NAME:
            called.append(value)
            return "function"
        case FunctionType() | BuiltinFunctionType():
            return value.__module__, value.__qualname__
        case np.ufunc():
            return value.__name__
    raise TypeError(
        f"kernel '{function.__module__}.{function.__name__}' reads '{name}', a {type(value).__name__}: "
        "expected numbers, words, tuples, arrays, modules or compiled functions"
    )


def _intrinsic(definition: FunctionType) -> object:
    """Code that writes machine code: its module's whole source counts, and what it closes over of numbers and types."""
    closed = [cell.cell_contents for cell in definition.__closure__ or ()]
    known = [
        _typed(v) if isinstance(v, types.Type) else repr(v)
        for v in closed
        if isinstance(v, int | str | tuple | types.Type)
    ]
    return definition.__qualname__, _source(definition.__code__.co_filename), definition.__code__.co_code, known


@cache
def _source(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest() if Path(path).exists() else ""
