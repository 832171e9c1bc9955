"""How backends compile: once, into a cache of their own that a change of any kernel leaves behind."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
import platformdirs

_njit: Any = numba.njit
_config: Any = numba.config


@cache
def folder(package: Path) -> str:
    """Where the compiled kernels of a backend are kept: named by a hash of all sources that they are made of.

    numba looks only at the file of the function that is cached, not at those of the functions it calls.

    Args:
        package: the folder of the backend's own sources.
    """
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    neuro = Path(__file__).parent.parent
    shared = [neuro / "kernels", neuro / "neurons", neuro / "synapses"]
    for source in sorted(file for place in [package, *shared] for file in place.glob("*.py")):
        digest.update(source.name.encode() + source.read_bytes())
    name = Path("kernels") / digest.hexdigest()[:16]
    for root in (Path(platformdirs.user_cache_dir("neuro")), Path(tempfile.gettempdir()) / f"neuro-{os.getuid()}"):
        try:
            (root / name).mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(root / name, os.W_OK):
            return str(root / name)
    return ""


@contextmanager
def _cached_in(place: str) -> Iterator[None]:
    before = _config.CACHE_DIR
    _config.CACHE_DIR = place
    try:
        yield
    finally:
        _config.CACHE_DIR = before


def kernel(function: Callable[..., Any]) -> Any:
    """Compile an entry point; its machine code is kept on disk.

    Kernels allocate nothing, so numba's reference counting, which costs more than a small network, is off.
    """
    place = folder(Path(function.__code__.co_filename).parent)
    with _cached_in(place):
        return _njit(cache=bool(place), error_model="numpy", nogil=True, _nrt=False)(function)


def inner(function: Callable[..., Any]) -> Any:
    """Compile a function that only other kernels call."""
    return _njit(error_model="numpy", _nrt=False)(function)


def merged(function: Callable[..., Any]) -> Any:
    """Compile a function that is always merged into its callers: for the few in the innermost loops."""
    return _njit(error_model="numpy", _nrt=False, forceinline=True)(function)


@cache
def compiled(function: FunctionType) -> Any:
    """Compile a model's plain function together with the plain functions that it calls."""
    scope = dict(function.__globals__)
    for name in function.__code__.co_names:
        called = scope.get(name)
        if isinstance(called, FunctionType):
            scope[name] = compiled(called)
    twin = FunctionType(function.__code__, scope, function.__name__, function.__defaults__)
    return _njit(error_model="numpy", _nrt=False)(twin)
