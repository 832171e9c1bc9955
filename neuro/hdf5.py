"""HDF5 files that are whole or not there at all; what apps keep their models in."""

from __future__ import annotations

import errno
import glob
import os
from collections.abc import Iterator
from contextlib import contextmanager
from json import JSONDecodeError
from pathlib import Path
from typing import Any

from neuro.errors import ModelError

__all__ = ["check_writable", "reading", "writing"]


@contextmanager
def writing(path: Path) -> Iterator[Any]:
    """A new HDF5 file, written aside; it takes the name `path` when the block ends well.

    Args:
        path: of the file.

    Raises:
        ModelError: it cannot be written.
    """
    import h5py

    aside = _aside(path)
    try:
        with h5py.File(aside, "w") as file:
            yield file
        aside.replace(path)
    except OSError as error:
        raise _unwritable(path, error) from None
    finally:
        aside.unlink(missing_ok=True)


def check_writable(path: Path) -> None:
    """Find out before long work whether a file can be written, and clear what killed writers left of it.

    Args:
        path: of the file.

    Raises:
        ModelError: it cannot.
    """
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "")
        _aside(path).touch()
        for left in path.parent.glob(f".{glob.escape(path.name)}*.part"):
            left.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(path, error) from None


def _aside(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.part")


def _unwritable(path: Path, error: OSError) -> ModelError:
    return ModelError(f"{path}: cannot be written: {os.strerror(error.errno) if error.errno else error}")


@contextmanager
def reading(path: Path, what: str) -> Iterator[Any]:
    """An HDF5 file of a format.

    Args:
        path: the file.
        what: its attribute `format`, e.g. "neuro remus model 1".

    Raises:
        ModelError: there is no such file, it is of another format, or damaged.
    """
    import h5py

    if not path.is_file():
        raise ModelError(f"{path}: no such file: expected a {what}")
    try:
        with h5py.File(path) as file:
            if file.attrs.get("format") != what:
                raise ModelError(f"{path}: not a {what}")
            yield file
    except OSError:
        raise ModelError(f"{path}: not a {what}") from None
    except (KeyError, TypeError, AttributeError, JSONDecodeError) as error:
        raise ModelError(f"{path}: damaged {what}: {error}") from None
