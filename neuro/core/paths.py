"""Names of files as users give them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError

__all__ = ["existing", "file_path"]


def file_path(given: Any, what: str) -> Path:
    """The path that a value is.

    Args:
        given: text or a path.
        what: its name in the message.

    Raises:
        ModelError: it is neither, or no file can have that name.
    """
    if not isinstance(given, str | os.PathLike) or not isinstance(os.fspath(given), str):
        raise ModelError(f"{what} = {given!r:.60}: expected the name of a file")
    if "\0" in os.fspath(given):
        raise ModelError(f"{what} = {os.fspath(given)!r:.60}: expected the name of a file, without a zero byte")
    return Path(given)


def existing(given: Any, expected: str = "") -> Path:
    """The path of a file that is there.

    Args:
        given: text or a path.
        expected: what it should be, for the message, e.g. "a state written by sim.save".

    Raises:
        ModelError: there is no such file, or it is a folder.
    """
    path = file_path(given, "path")
    wanted = f": expected {expected}" if expected else ""
    try:
        if path.is_dir():
            raise ModelError(f"{path}: is a folder{wanted or ': expected a file'}")
        if not path.exists():
            raise ModelError(f"{path}: no such file{wanted}")
        if not path.is_file():
            raise ModelError(f"{path}: is neither file nor folder{wanted or ': expected a file'}")
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    return path
