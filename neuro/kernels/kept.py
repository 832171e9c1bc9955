"""Where machine code is kept: a file for each kernel and types of arguments, named by all that it follows from.

A file is written aside and moved into place, and never changed: any number of processes may compile at once. It begins
with a digest of its name and of the rest: what a disk has changed since would end the process, or compute something
else, and is compiled anew. No index says what there is. What has not been used for longest goes when there is too much.
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

import hashlib
import os
import pickle
import re
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import platformdirs

from neuro.kernels import compile_report
from neuro.kernels.key import digest
from neuro.kernels.numba_internals import CompileResult, dumps

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
