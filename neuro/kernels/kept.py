"""Where machine code is kept: a file for each kernel and types of arguments, named by all that it follows from.

A file is written aside and moved into place, and never changed: any number of processes may compile at once. It begins
with a digest of its name and of the rest: what a disk has changed since would end the process, or compute something
else, and is compiled anew. No index says what there is. What has not been used for longest goes when there is too much.

The name has a digest: if anything changes that the code follows from, so does the digest. A kernel's code rests on its
own bytecode, on the values of all globals that it reads, on all kernels that it calls, however far away their sources
are, on how it is compiled, and on which compiler makes it for which processor. Values and bytecode are looked at, not
files: an edited comment compiles nothing, and a function without a file counts, too. Two files alone are read: those
that say how kernels are compiled.
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

ROOM = 1 << 28
"""Bytes that all machine code may take together; a network takes about one million."""

_OURS = re.compile(r".+-[0-9a-f]{32}(\.\d+)?", re.DOTALL)
_DAY_S = 86_400.0
_DIGEST = hashlib.sha256().digest_size


class KernelCache:
    """The machine code of one kernel on disk, as numba's dispatcher asks for it."""

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel
        self._began = compile_report.NOW

    @property
    def cache_path(self) -> str | None:
        """The folder, None where no folder can be written."""
        place = folder()
        return None if place is None else str(place)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The machine code for these types of arguments, or None: it has to be compiled."""
        place = self._file(signature, target)
        content = None if place is None else _read(place)
        if content is not None:
            # What was written whole may still be of other libraries, and raise anything; compiling anew replaces it.
            with suppress(Exception):
                parts = pickle.loads(content)
                if self._kernel.targetoptions.get("_nrt", True):
                    target.refresh()  # for what allocates; it imports most of numba
                return _result._rebuild(target, *parts)
        self._began = compile_report.begin(kept=place is not None)
        return None

    def has(self, signature: Any, target: Any) -> bool:
        """Whether there is machine code for these types of arguments, be it damaged."""
        place = self._file(signature, target)
        return place is not None and place.exists()

    def save_overload(self, signature: Any, code: Any) -> None:
        """Keep what was compiled; where that fails, e.g. on a full disk, the next process compiles again."""
        compile_report.end(self._began)
        place = self._file(signature, code.target_context)
        if place is None:
            return
        content = _dumps(code._reduce())
        try:
            _clear(place.parent, ROOM - len(content))
            _write(place, content)
        except OSError:
            return

    def flush(self) -> None:
        """Numba asks for this before it compiles anew; files are named by what is in them, so none is wrong."""

    def _file(self, signature: Any, target: Any) -> Path | None:
        place = folder()
        if place is None:
            return None
        arguments = tuple(getattr(signature, "args", signature))
        return place / f"{self._kernel.py_func.__name__}-{digest(self._kernel, arguments, target)}"


@cache
def folder() -> Path | None:
    """Where machine code is kept: in the user's cache, else in the temporary folder; None if neither can be written.

    What lies there is run, so it must be a folder of this user into which no other user can write, and no link to one.
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
    """Of what a file of a name holds: of another kernel's file under this name it is another."""
    return hashlib.sha256(name.encode() + b"/" + content).digest()


def _read(place: Path) -> bytes | None:
    """What was written to a file; None where there is none, or not that to the bit."""
    try:
        whole = place.read_bytes()
        os.utime(place)
    except OSError:
        return None
    content = whole[_DIGEST:]
    return content if whole[:_DIGEST] == _digest(place.name, content) else None


def _write(place: Path, content: bytes) -> None:
    aside = place.with_name(f"{place.name}.{os.getpid()}")
    try:
        aside.write_bytes(_digest(place.name, content) + content)
        aside.replace(place)
    except OSError:
        aside.unlink(missing_ok=True)
        raise


def _clear(place: Path, room: int) -> None:
    """Remove machine code that has not been used for longest, until the rest takes at most so many bytes.

    What killed processes left half-written goes after a day; files of other names stay.
    """
    kept = []
    with os.scandir(place) as entries:
        for entry in entries:
            found = _OURS.fullmatch(entry.name)
            if found is None or not entry.is_file(follow_symlinks=False):
                continue
            state = entry.stat(follow_symlinks=False)
            if found[1] is None:
                kept.append((state.st_mtime, state.st_size, entry.path))
            elif state.st_mtime < time.time() - _DAY_S:
                Path(entry.path).unlink(missing_ok=True)
    for _, size, path in sorted(kept, reverse=True):
        room -= size
        if room < 0:
            Path(path).unlink(missing_ok=True)


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
