"""Which files were read, so that what is made of them can tell."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["digest_of", "gathering", "record_input", "recorded_inputs"]

_BLOCK = 1 << 20
_read: dict[str, None] = {}
_lists: list[dict[str, None]] = []


def record_input(path: str | os.PathLike[str]) -> None:
    """A file is an input of what is made in this process from now on."""
    name = os.path.abspath(os.fspath(path))
    for each in (_read, *_lists):
        each[name] = None


def recorded_inputs() -> tuple[str, ...]:
    """All files that were read so far, as absolute paths, in the order in which they were first read."""
    return tuple(_read)


@contextmanager
def gathering() -> Iterator[dict[str, None]]:
    """The files that are read in a block, as keys."""
    found: dict[str, None] = {}
    _lists.append(found)
    try:
        yield found
    finally:
        _lists[:] = [each for each in _lists if each is not found]


def _of_folder(folder: Path) -> str:
    digest = hashlib.sha256()
    for root, folders, files in os.walk(folder):
        folders.sort()
        for name in sorted(files):
            path = Path(root, name)
            digest.update(f"{path.relative_to(folder)}\0{digest_of(path)}\n".encode())
    return digest.hexdigest()


_known: dict[tuple[str, int, int], str] = {}


def digest_of(path: str | os.PathLike[str]) -> str:
    """A hash of what a file holds, or of names and contents of all files in a folder; "" if it cannot be read twice.

    Of what was not touched since it is known.
    """
    try:
        state = os.stat(path)
        if stat.S_ISDIR(state.st_mode):
            return _of_folder(Path(path))
        if not stat.S_ISREG(state.st_mode):  # a pipe would be waited for
            return ""
        key = os.fspath(path), state.st_mtime_ns, state.st_size
        if key not in _known:
            digest = hashlib.sha256()
            with Path(path).open("rb") as file:
                while block := file.read(_BLOCK):
                    digest.update(block)
            _known[key] = digest.hexdigest()
        return _known[key]
    except OSError:
        return ""
