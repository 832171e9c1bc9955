"""Input files: checks of their paths, and a record of files with digests."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError

CLOSED = "NEURO_STREAMS_CLOSED"
"""Environment variable of processes that open no stream; child processes inherit it."""
__all__ = ["CLOSED", "digest_of", "existing", "file_path", "gathering", "record_input", "recorded_inputs"]

_BLOCK = 1 << 20
# Files that this process has read, and the files of each block of `gathering`, as the keys of dictionaries.
_read: dict[str, None] = {}
_lists: list[dict[str, None]] = []


def record_input(path: str | os.PathLike[str]) -> None:
    """Record a file as an input of all later results of this process."""
    name = os.path.abspath(os.fspath(path))
    for files in (_read, *_lists):
        files[name] = None


def recorded_inputs() -> tuple[str, ...]:
    """Return all files that were read so far, as absolute paths, in the order of the first read."""
    return tuple(_read)


@contextmanager
def gathering() -> Iterator[dict[str, None]]:
    """Collect the files read in a block, as the keys of a dictionary."""
    files: dict[str, None] = {}
    _lists.append(files)
    try:
        yield files
    finally:
        _lists[:] = [outer for outer in _lists if outer is not files]


def _folder_digest(folder: Path) -> str:
    digest = hashlib.sha256()
    for root, folders, files in os.walk(folder):
        folders.sort()
        for name in sorted(files):
            path = Path(root, name)
            digest.update(f"{path.relative_to(folder)}\0{digest_of(path)}\n".encode())
    return digest.hexdigest()


_digests: dict[tuple[str, int, int], str] = {}
"""Hashes by path, time of modification in ns, and size."""


def digest_of(path: str | os.PathLike[str]) -> str:
    """Return a hash of a file's content, or of the names and contents of all files in a folder.

    A hash is computed once for each path, size and time of modification. The hash is "" for a pipe, which can be read
    only once, and for a file that cannot be read.
    """
    try:
        state = os.stat(path)
        if stat.S_ISDIR(state.st_mode):
            return _folder_digest(Path(path))
        if not stat.S_ISREG(state.st_mode):  # reading a pipe would wait
            return ""
        key = os.fspath(path), state.st_mtime_ns, state.st_size
        if key not in _digests:
            digest = hashlib.sha256()
            with Path(path).open("rb") as file:
                while block := file.read(_BLOCK):
                    digest.update(block)
            _digests[key] = digest.hexdigest()
        return _digests[key]
    except OSError:
        return ""


def file_path(value: Any, label: str) -> Path:
    """Return a value as a path.

    Args:
        value: text or a path.
        label: name of the value in the message.

    Raises:
        ModelError: `value` is neither text nor a path, or cannot be the name of a file.
    """
    if not isinstance(value, str | os.PathLike) or not isinstance(os.fspath(value), str):
        raise ModelError(f"{label} = {value!r:.60}: expected the name of a file")
    if "\0" in os.fspath(value):
        raise ModelError(f"{label} = {os.fspath(value)!r:.60}: expected the name of a file, without a zero byte")
    return Path(value)


def existing(value: Any, expected: str = "") -> Path:
    """Return the path of an existing file.

    Args:
        value: text or a path.
        expected: noun for the message, e.g. "a state written by sim.save".

    Raises:
        ModelError: the file does not exist, or is a folder.
    """
    path = file_path(value, "path")
    suffix = f": expected {expected}" if expected else ""
    try:
        if path.is_dir():
            raise ModelError(f"{path}: is a folder{suffix or ': expected a file'}")
        if not path.exists():
            raise ModelError(f"{path}: no such file{suffix}")
        if not path.is_file():
            raise ModelError(f"{path}: is neither file nor folder{suffix or ': expected a file'}")
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    return path
