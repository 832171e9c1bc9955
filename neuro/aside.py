"""Files that are whole or not there at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def aside(path: Path) -> Iterator[Path]:
    """A new empty file beside `path` to write into; it takes the name `path` when the block ends well.

    If the block fails or is interrupted nothing is left and what stood at `path` stays as it was. That the
    folder can be written to shows at once, before the work of the block begins.

    Raises:
        OSError: there is no such folder, it cannot be written to, `path` is a folder, or the disk is full; it has
            the name `path`.
    """
    part = _begin(path)
    try:
        yield part
        part.replace(path)
    except OSError as error:
        if error.strerror is None or error.filename not in (None, str(part)):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        part.unlink(missing_ok=True)


def try_out(path: Path) -> None:
    """Fail as `aside` would, and leave nothing."""
    _begin(path).unlink()


def _begin(path: Path) -> Path:
    part = path.parent / f".{path.name}.{os.getpid()}.part"
    try:
        if path.is_dir():
            raise IsADirectoryError(21, "is a folder, expected the name of a file")
        part.touch()
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    return part
