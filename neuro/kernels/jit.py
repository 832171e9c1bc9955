"""Decorators that compile kernels. Machine code is cached until a dependency of the kernel changes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any, TypeVar
from uuid import uuid4

import numba

from neuro.core.errors import ModelError
from neuro.kernels.kept import KernelCache
from neuro.kernels.numba_internals import PartCompiler

_njit: Any = numba.njit
_PROCESS = uuid4().hex
F = TypeVar("F", bound=Callable[..., Any])
_PART = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": PartCompiler}


def must_compile(backend: str) -> None:
    """Refuse a backend whose kernels cannot run as plain Python.

    Raises:
        ModelError: numba is set to compile nothing.
    """
    config: Any = numba.config
    if config.DISABLE_JIT:
        raise ModelError(
            f"backend '{backend}' has to be compiled, and NUMBA_DISABLE_JIT is set: expected it to be unset",
            hint="unset it, or run on backend 'reference', which is not compiled",
        )


def kernel(function: Callable[..., Any]) -> Any:
    """Compile an entry point for Python and other kernels. The machine code is cached on disk.

    Kernels allocate no memory. Numba's reference counting is off, because it takes longer than a step of a small
    network.
    """
    return _cached(_njit(error_model="numpy", nogil=True, _nrt=False)(_with_unique_name(function)))


def allocating(function: Callable[..., Any]) -> Any:
    """Compile an entry point that allocates arrays."""
    return _cached(_njit(error_model="numpy", nogil=True)(_with_unique_name(function)))


def _with_unique_name(function: F) -> F:
    """Give a function a name that is unique among processes.

    Numba numbers functions of the same name, but only within a process. If two processes cached two functions that one
    factory made, both functions could have the same symbol, and a call could reach the wrong function.
    """
    function.__qualname__ = f"{function.__qualname__}.{_PROCESS}"
    return function


def _cached(dispatcher: Any) -> Any:
    dispatcher._cache = KernelCache(dispatcher)
    return dispatcher


def subkernel(function: Callable[..., Any]) -> Any:
    """Compile a function that only other kernels call."""
    return _njit(error_model="numpy", _nrt=False, **_PART)(_with_unique_name(function))


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a function that is always inlined into its callers. Only functions in innermost loops need this."""
    return _njit(error_model="numpy", _nrt=False, forceinline=True, **_PART)(_with_unique_name(function))


@cache
def compiled(function: FunctionType, decorator: Callable[[Callable[..., Any]], Any] = subkernel) -> Any:
    """Compile a plain Python function of a model. Plain functions that it calls or passes on are inlined."""
    scope = dict(function.__globals__)
    for name in function.__code__.co_names:
        callee = scope.get(name)
        if isinstance(callee, FunctionType):
            scope[name] = compiled(callee, inlined)
    twin = FunctionType(function.__code__, scope, function.__name__, function.__defaults__)
    return decorator(twin)
