"""How kernels compile: all of them here, with one cache that any change of what they are made of leaves behind."""

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
    """Compile an entry point: Python calls it, other kernels may, and its machine code is kept on disk.

    Kernels allocate nothing, so numba's reference counting, which costs more than a small network, is off.
    """
    return _kept(_njit(error_model="numpy", nogil=True, _nrt=False)(_named(function)))


def allocating(function: Callable[..., Any]) -> Any:
    """Compile an entry point that makes arrays of its own."""
    return _kept(_njit(error_model="numpy", nogil=True)(_named(function)))


def _named(function: F) -> F:
    """Give a function a name that no other process gives.

    Numba numbers functions of one name within a process only. Two functions of one factory, kept by two processes,
    could have the same symbol, and one would be called for the other.
    """
    function.__qualname__ = f"{function.__qualname__}.{_PROCESS}"
    return function


def _kept(dispatcher: Any) -> Any:
    dispatcher._cache = KernelCache(dispatcher)
    return dispatcher


def subkernel(function: Callable[..., Any]) -> Any:
    """Compile a function that only other kernels call."""
    return _njit(error_model="numpy", _nrt=False, **_PART)(_named(function))


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a function that is always inlined into its callers: for the few in the innermost loops."""
    return _njit(error_model="numpy", _nrt=False, forceinline=True, **_PART)(_named(function))


@cache
def compiled(function: FunctionType, how: Callable[[Callable[..., Any]], Any] = subkernel) -> Any:
    """Compile a model's plain function; the plain functions that it calls, or hands on, are inlined into it."""
    scope = dict(function.__globals__)
    for name in function.__code__.co_names:
        called = scope.get(name)
        if isinstance(called, FunctionType):
            scope[name] = compiled(called, inlined)
    twin = FunctionType(function.__code__, scope, function.__name__, function.__defaults__)
    return how(twin)
