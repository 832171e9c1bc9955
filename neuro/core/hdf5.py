"""HDF5 files with a mark: the attribute `format`, by which a file is known and may be replaced by a new one."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neuro.core.errors import ModelError
from neuro.core.outputs import Kind, output
from neuro.core.paths import existing
from neuro.core.provenance import ATTRIBUTE

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["has_format", "kind", "new_file", "put", "reading", "take", "writing"]


def kind(format: str, what: str = "") -> Kind:
    """The kind of file of a format; it may be replaced by another of that format.

    Args:
        format: its attribute `format`, e.g. "neuro remus model 1".
        what: it is, for messages; "a" and the format if not given.
    """
    return Kind(what or f"a {format}", lambda path: has_format(path, format))


def has_format(path: Path, format: str) -> bool:
    """Whether there is an HDF5 file of a format."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("format") == format)
    except (OSError, RuntimeError, KeyError, TypeError, ValueError):
        return False


@contextmanager
def writing(path: Path, format: str, replace: bool = False, record: Mapping[str, Any] | None = None) -> Iterator[Any]:
    """A new HDF5 file of a format, which takes the name `path` when the block ends well.

    Args:
        path: of the file.
        format: its attribute `format`.
        replace: whether to replace any other file, too.
        record: where it comes from, see `neuro.core.provenance`; nothing is said of files that are kept for a while.

    Raises:
        Unwritable: as of `neuro.core.outputs.output`.
    """
    with output(path, kind(format), replace) as part, new_file(part) as file:
        file.attrs["format"] = format
        if record is not None:
            file.attrs[ATTRIBUTE] = json.dumps(record)
        yield file


@contextmanager
def new_file(path: Path, **options: Any) -> Iterator[Any]:
    """A new HDF5 file in the place of any other.

    Args:
        path: of the file.
        options: of `h5py.File`.

    Raises:
        OSError: it cannot be written, as on a full disk.
    """
    import h5py

    with _Disk(path) as disk:
        try:
            with h5py.File(disk, "w", **options) as file:
                yield file
        finally:
            if disk.error is not None:
                raise disk.error from None


class _Disk(io.FileIO):
    """A file that does not fail: HDF5 cannot let go of what it cannot write, and brings the process down with it.

    Attributes:
        error: of the first failure; what comes after it is thrown away.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+b")
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of it, or keep the first failure."""
        rest = memoryview(data)
        size = rest.nbytes
        try:
            while self.error is None and rest.nbytes:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Make it as long, or keep the first failure."""
        try:
            return super().truncate(size) if self.error is None else size or 0
        except OSError as error:
            self.error = error
            return size or 0


@contextmanager
def reading(path: Path, what: str, hint: str = "") -> Iterator[Any]:
    """An HDF5 file of a format.

    Args:
        path: the file.
        what: its attribute `format`, e.g. "neuro remus model 1".
        hint: what to do where it is damaged.

    Raises:
        ModelError: there is no such file, it is of another format, or damaged.
    """
    import h5py

    path = existing(path, f"a {what}")
    try:
        with h5py.File(path) as file:
            if file.attrs.get("format") != what:
                raise ModelError(f"{path}: not a {what}")
            yield file
    except ModelError:
        raise
    except OSError:
        raise ModelError(f"{path}: not a {what}") from None
    except (KeyError, TypeError, AttributeError, ValueError, RuntimeError) as error:  # h5py has all of these
        raise ModelError(f"{path}: damaged {what}: {error}", hint=hint) from None


def put(file: Any, name: str, part: npt.NDArray[Any] | Mapping[str, npt.NDArray[Any]]) -> None:
    """Write an array, or a group of arrays, into an open file; plain bytes are packed."""
    import numpy as np

    if isinstance(part, Mapping):
        group = file.create_group(name)
        for inner, array in part.items():
            group[inner] = array
    elif part.dtype == np.uint8:
        file.create_dataset(name, data=part, compression="gzip", compression_opts=1)
    else:
        file[name] = part


def take(file: Any, name: str) -> Any:
    """The array, or the arrays by name, that `put` wrote."""
    part = file[name]
    return {inner: data[()] for inner, data in part.items()} if hasattr(part, "items") else part[()]
