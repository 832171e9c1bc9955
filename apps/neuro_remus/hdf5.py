"""HDF5 files that are whole or not there at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from neuro import ModelError


@contextmanager
def writing(path: Path) -> Iterator[Any]:
    """A new HDF5 file, written aside; it takes the name `path` when the block ends well.

    Raises:
        ModelError: it cannot be written.
    """
    import h5py

    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with h5py.File(aside, "w") as file:
            yield file
        aside.replace(path)
    except OSError as error:
        raise ModelError(f"{path}: cannot be written: {os.strerror(error.errno) if error.errno else error}") from None
    finally:
        aside.unlink(missing_ok=True)


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
    except (KeyError, TypeError, AttributeError) as error:
        raise ModelError(f"{path}: damaged {what}: {error}") from None
