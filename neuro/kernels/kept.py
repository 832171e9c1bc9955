"""Machine code on disk, in a file for each kernel and types of arguments. The name of the file has a digest.

A file is written elsewhere, moved into place, and never changed, so any number of processes may compile at once. The
file begins with a digest of its name and content. Damaged code could end the process or compute wrong numbers, so a
kernel is compiled again if this digest is wrong. There is no index. If the folder is too large, the files that were
unused for the longest time are removed.

The digest in the name changes with any dependency of the code: the bytecode of the kernel, the values of all globals
that the bytecode reads, all kernels that are called, directly or not, the options of compilation, the compiler and the
processor. Source files are not part of it, so nothing is compiled after a comment was edited, and functions without a
file can be cached. There are exceptions: the source of the two files that define the compilation, and of the files
with intrinsics that a kernel uses.
"""

# mypy: disable-error-code="no-untyped-call,attr-defined"
from __future__ import annotations

import hashlib
import math
import os
import pickle
import platform
import re
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
import platformdirs
from numba import types

from neuro.kernels import compile_report
from neuro.kernels.numba_internals import CompileResult, Dispatcher, Intrinsic, dumps

_result: Any = CompileResult
_dumps: Any = dumps

MAX_BYTES = 1 << 28
"""Largest size of all machine code together, bytes. A network takes about one million."""

_OURS = re.compile(r".+-[0-9a-f]{32}(\.\d+)?", re.DOTALL)
_DAY_S = 86_400.0
_DIGEST = hashlib.sha256().digest_size


class KernelCache:
    """Machine code of one kernel on disk, with the interface of numba's dispatcher."""

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel
        self._began = compile_report.NO_BEGIN

    @property
    def cache_path(self) -> str | None:
        """The folder of machine code, or None if no folder can be written."""
        place = folder()
        return None if place is None else str(place)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the machine code for these types of arguments, or None if there is no valid file."""
        place = self._file(signature, target)
        content = None if place is None else _read(place)
        if content is not None:
            # A complete file may still come from other libraries and raise any error. Then the kernel compiles again.
            with suppress(Exception):
                parts = pickle.loads(content)
                if self._kernel.targetoptions.get("_nrt", True):
                    target.refresh()  # this call imports most of numba, so it is only made for code that allocates
                return _result._rebuild(target, *parts)
        self._began = compile_report.begin(cached=place is not None)
        return None

    def has(self, signature: Any, target: Any) -> bool:
        """Return True if there is a file of machine code for these types of arguments, even if the file is damaged."""
        place = self._file(signature, target)
        return place is not None and place.exists()

    def save_overload(self, signature: Any, code: Any) -> None:
        """Write machine code to its file. If this fails, e.g. on a full disk, the next process compiles again."""
        compile_report.end(self._began)
        place = self._file(signature, code.target_context)
        if place is None:
            return
        content = _dumps(code._reduce())
        try:
            _clear(place.parent, MAX_BYTES - len(content))
            _write(place, content)
        except OSError:
            return

    def flush(self) -> None:
        """Do nothing. Numba calls this method before recompiling; files named by digests are never outdated."""

    def _file(self, signature: Any, target: Any) -> Path | None:
        place = folder()
        if place is None:
            return None
        arguments = tuple(getattr(signature, "args", signature))
        return place / f"{self._kernel.py_func.__name__}-{digest(self._kernel, arguments, target)}"


@cache
def folder() -> Path | None:
    """Return the folder of machine code, in the user's cache or else in the temporary folder, or None.

    The content is executed. So the folder must belong to this user, must be writable only for this user, and must not
    be a link. None means that no such folder can be written.
    """
    for place in _places():
        try:
            place.mkdir(parents=True, exist_ok=True, mode=0o700)
            state = place.lstat()
            tempfile.TemporaryFile(dir=place).close()
        except OSError:
            continue
        if stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid() and not state.st_mode & 0o022:
            return place
    return None


def _places() -> Iterator[Path]:
    yield Path(platformdirs.user_cache_dir("neuro")) / "machine_code"
    try:
        yield Path(tempfile.gettempdir()) / f"neuro-{os.getuid()}"
    except FileNotFoundError:
        return


def _digest(name: str, content: bytes) -> bytes:
    """Return the digest of a file's name and content. So a renamed file is invalid."""
    return hashlib.sha256(name.encode() + b"/" + content).digest()


def _read(place: Path) -> bytes | None:
    """Return the content of a file; None if the file is missing or damaged."""
    try:
        data = place.read_bytes()
        os.utime(place)
    except OSError:
        return None
    content = data[_DIGEST:]
    return content if data[:_DIGEST] == _digest(place.name, content) else None


def _write(place: Path, content: bytes) -> None:
    aside = place.with_name(f"{place.name}.{os.getpid()}")
    try:
        aside.write_bytes(_digest(place.name, content) + content)
        aside.replace(place)
    except OSError:
        aside.unlink(missing_ok=True)
        raise


def _clear(place: Path, room: int) -> None:
    """Remove the files that were unused for the longest time, until the remaining files have at most `room` bytes.

    Partial files of killed processes are removed after a day. Files with other names stay.
    """
    files = []
    with os.scandir(place) as entries:
        for entry in entries:
            match = _OURS.fullmatch(entry.name)
            if match is None or not entry.is_file(follow_symlinks=False):
                continue
            state = entry.stat(follow_symlinks=False)
            if match[1] is None:
                files.append((state.st_mtime, state.st_size, entry.path))
            elif state.st_mtime < time.time() - _DAY_S:
                Path(entry.path).unlink(missing_ok=True)
    for _, size, path in sorted(files, reverse=True):
        room -= size
        if room < 0:
            Path(path).unlink(missing_ok=True)


_COMPILER = (platform.python_version(), numba.__version__, llvmlite.__version__, np.__version__)
_config: Any = numba.config
_COMPILE_FILES = tuple(Path(__file__).with_name(name) for name in ("jit.py", "numba_internals.py"))
_KNOWN_BY_NAME = {"numba", "numpy", *sys.stdlib_module_names}
"""Packages whose versions are in `_COMPILER`. Their functions are identified by name."""


def digest(kernel: Any, arguments: tuple[Any, ...], target: Any) -> str:
    """Return a digest of all dependencies of a kernel's machine code for these types of arguments.

    Args:
        kernel: a function compiled by `numba.njit`.
        arguments: numba's types.
        target: target context of numba.

    Raises:
        TypeError: the kernel reads a global of an unsupported type.
    """
    numbers = {kernel: 0}
    parts: list[object] = [_COMPILER, target.codegen().magic_tuple(), _config.BOUNDSCHECK, _config.OPT]
    parts += [_source(str(path)) for path in _COMPILE_FILES]
    parts += [_typed(kind) for kind in arguments]
    waiting = [kernel]
    for function in waiting:
        reads, callees = _own(function)
        for callee in callees:
            if callee not in numbers:
                numbers[callee] = len(numbers)
                waiting.append(callee)
        parts.append((reads, [numbers[callee] for callee in callees]))
    return _hashed(parts)[:32]


def _hashed(parts: list[object]) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def _typed(kind: Any) -> object:
    """Return a description of a numba type. Unlike numba's text, a description of a named tuple has the fields."""
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        return repr(kind), getattr(kind, "fields", ()), [_typed(part) for part in parts]
    return repr(kind)


@cache
def _own(kernel: Any) -> tuple[str, list[Any]]:
    """Return a digest of a function's own content and globals, and the functions that it calls."""
    callees: list[Any] = []
    if isinstance(kernel, FunctionType):
        return _hashed(_content(kernel, callees)), callees
    return _hashed([sorted(kernel.targetoptions.items()), *_content(kernel.py_func, callees)]), callees


def _content(function: FunctionType, callees: list[Any]) -> list[object]:
    """Return the content of a function, and add kernels and functions among its globals to `callees`."""
    parts: list[object] = [function.__defaults__, function.__kwdefaults__]
    codes = list(_codes(function.__code__))
    words = [word for code in codes for word in code.co_names]
    for cell in function.__closure__ or ():
        for name, value in _followed("closure", cell.cell_contents, words):
            parts.append((name, _value(function, name, value, callees)))
    for code in codes:
        constants = [
            sorted(map(repr, c)) if isinstance(c, frozenset) else c  # a set in the same order in every process
            for c in code.co_consts
            if not isinstance(c, CodeType) and c != function.__doc__
        ]
        parts += [code.co_code, code.co_exceptiontable, code.co_flags, code.co_varnames, code.co_names, constants]
    scope = function.__globals__
    for word in dict.fromkeys(word for word in words if word in scope):
        for name, value in _followed(word, scope[word], words):
            parts.append((name, _value(function, name, value, callees)))
    return parts


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a function's code and the code of its inner functions."""
    yield code
    for inside in code.co_consts:
        if isinstance(inside, CodeType):
            yield from _codes(inside)


def _followed(name: str, value: Any, words: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield a value, and for a module also the attributes that a function with the words `words` may read.

    Nested modules are followed, except `math` and `numpy`, which numba knows by name.
    """
    yield name, value
    visited, waiting = {math, np}, [(name, value)]
    for path, module in waiting:
        if not isinstance(module, ModuleType) or module in visited:
            continue
        visited.add(module)
        for word in dict.fromkeys(words):
            if hasattr(module, word):
                attribute = f"{path}.{word}", getattr(module, word)
                yield attribute
                waiting.append(attribute)


def _value(function: FunctionType, name: str, value: Any, callees: list[Any]) -> object:
    """Return the content of a global on which the machine code depends, and add kernels and functions to `callees`."""
    match value:
        case Dispatcher():
            callees.append(value)
            return "kernel"
        case Intrinsic():
            return _intrinsic(value._defn)
        case None | bool() | int() | float() | complex() | str() | bytes() | np.generic():
            return type(value).__name__, repr(value)
        case tuple() | list():
            return type(value).__name__, [_value(function, name, item, callees) for item in value]
        case np.ndarray():
            return str(value.dtype), value.shape, value.tobytes()
        case ModuleType():
            return value.__name__
        case type():
            return value.__module__, value.__qualname__, getattr(value, "_fields", ())
        case FunctionType() if value.__module__.partition(".")[0] not in _KNOWN_BY_NAME:
            callees.append(value)
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
    """Return the identity of an intrinsic: source of the module, bytecode, numbers and types in the closure."""
    closed = [cell.cell_contents for cell in definition.__closure__ or ()]
    simple_values = [
        _typed(v) if isinstance(v, types.Type) else repr(v)
        for v in closed
        if isinstance(v, int | str | tuple | types.Type)
    ]
    return definition.__qualname__, _source(definition.__code__.co_filename), definition.__code__.co_code, simple_values


@cache
def _source(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest() if Path(path).exists() else ""
